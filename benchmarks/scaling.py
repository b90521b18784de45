# SPDX-License-Identifier: GPL-3.0-or-later
"""How time and memory grow with vertices, light paths and pixels."""

from __future__ import annotations

import numpy as np

from glass_refraction import optics

from .cases import BEHIND_HOLLOW, FILLED, HOLLOW, PIXEL_TOLERANCE
from .forward import FOCAL_PX
from .measure import peak_bytes, seconds, spread
from .plots import Chart, Curve
from .settings import Settings
from .text import milliseconds, number, table

TITLE = "Scaling"

EYE = BEHIND_HOLLOW.eye
PATHS = 8
WEIGHED = ("TTTT", "TRT", "R", "TTRTT", "TTTRTTT")
"""The paths that a picture of the hollow glass is made of."""
MEGAPIXELS = (
    (640, 480),
    (1024, 768),
    (1600, 1200),
    (2560, 1440),
    (3840, 2160),
)


def run(settings: Settings) -> dict:
    """All figures of this part."""
    return {
        "vertices": [_vertices(settings, count) for count in _counts(settings)],
        "paths": _paths(settings),
        "pixels": [_pixels(settings, size) for size in _sizes(settings)],
    }


def _counts(settings: Settings) -> tuple[int, ...]:
    return settings.pick(
        (1_000, 10_000),
        (10_000, 100_000),
        (10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000),
    )


def _sizes(settings: Settings) -> tuple[tuple[int, int], ...]:
    return settings.pick(((64, 48),), MEGAPIXELS[:3], MEGAPIXELS)


def _vertices(settings: Settings, count: int) -> dict:
    points = BEHIND_HOLLOW.points(settings.random(7), count)

    def solve(tolerance):
        return optics.apparent_points(HOLLOW, "TTTT", EYE, points, tolerance=tolerance)

    # Fewer repeats where one takes seconds.
    repeats = 1 if count > 1_000_000 else settings.repeats
    row = {"vertices": count}
    for name, tolerance in (("fast", PIXEL_TOLERANCE), ("exact", 1e-9)):
        kept = solve(tolerance)
        output = sum(
            getattr(kept, column).nbytes
            for column in ("direction", "distance", "position", "valid", "residual")
        )
        del kept
        taken = spread([seconds(lambda t=tolerance: solve(t)) for _ in range(repeats)])
        beyond = max(0, peak_bytes(lambda t=tolerance: solve(t)) - output)
        row[name] = {
            "seconds": taken,
            "output_bytes_a_point": output / count,
            "beyond_bytes_a_point": beyond / count,
            "beyond_bytes": beyond,
        }
    return row


def _paths(settings: Settings) -> list[dict]:
    """One to eight paths of a filled glass, the points before, beside and behind it."""
    count = settings.pick(200, 500, 20_000)
    paths = optics.light_paths(FILLED, EYE, min_weight=1e-4)[:PATHS]
    points = settings.random(8).uniform((-0.2, -0.15, -0.12), (0.1, 0.15, 0.18), (count, 3))
    rows, total = [], 0.0
    for number_of, path in enumerate(paths, 1):
        results = []

        def solve(path=path, results=results):
            results.append(
                optics.apparent_points(FILLED, path, EYE, points, tolerance=PIXEL_TOLERANCE)
            )

        taken = spread([seconds(solve)])
        total += taken["median"]
        valid = results[0].valid
        rows.append(
            {
                "paths": number_of,
                "path": path.events,
                "points": count,
                "seconds": taken,
                "total_seconds": total,
                "slots": int(valid.any(axis=1).sum()),
                "images": int(valid.sum()),
            }
        )
    return rows


def _pixels(settings: Settings, size: tuple[int, int]) -> dict:
    """Weights of all pixels that the hollow glass covers, edges smooth."""
    from glass_refraction.scene.vertices.regions import path_regions

    from .views import standing, viewpoint

    width, height = size
    extended = optics.CylinderGlass(HOLLOW.radius, HOLLOW.ior, extent=(0.0, 0.12))
    glass = standing(extended)
    view = viewpoint(EYE, (0.0, 0.0, 0.06), FOCAL_PX * width / 1600.0, size)
    paths = tuple(optics.LightPath(events) for events in WEIGHED)
    results = []

    def compute():
        results[:] = [path_regions(glass, view, paths)]

    taken = spread([seconds(compute) for _ in range(settings.repeats)])
    x0, y0, x1, y1 = results[0].rect
    return {
        "resolution": [width, height],
        "covered": (x1 - x0) * (y1 - y0),
        "hit": int(np.count_nonzero(results[0].hit)),
        "seconds": taken,
        "peak_bytes": peak_bytes(compute),
    }


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        'Points behind the hollow cylinder along "TTTT", cold. *Beyond*: the most memory that one '
        "call holds at a time, without its input and its result.",
        "",
        "![](scaling.png)",
        "",
    ]
    lines += table(
        (
            "vertices",
            "0.05 px, ms",
            "ns a vertex",
            "1e-9 rad, ms",
            "ns a vertex",
            "result, bytes a vertex",
            "beyond, bytes a vertex",
        ),
        [
            (
                row["vertices"],
                milliseconds(row["fast"]["seconds"]),
                1e9 * row["fast"]["seconds"]["median"] / row["vertices"],
                milliseconds(row["exact"]["seconds"]),
                1e9 * row["exact"]["seconds"]["median"] / row["vertices"],
                row["exact"]["output_bytes_a_point"],
                max(row[name]["beyond_bytes_a_point"] for name in ("fast", "exact")),
            )
            for row in found["vertices"]
        ],
    )
    points = number(found["paths"][0]["points"])
    lines += [
        f"Light paths of a water-filled glass, {points} points before, beside and behind it, all "
        "images of each:",
        "",
    ]
    lines += table(
        ("paths", "the last one", "slots", "images", "its time, ms", "all so far, ms"),
        [
            (
                row["paths"],
                row["path"],
                row["slots"],
                row["images"],
                milliseconds(row["seconds"]),
                1e3 * row["total_seconds"],
            )
            for row in found["paths"]
        ],
    )
    lines += [
        f"Weights of {', '.join(WEIGHED)} for every pixel of the hollow glass, everything new:",
        "",
    ]
    lines += table(
        ("resolution", "megapixels", "pixels on the glass", "time, ms", "ns a pixel", "peak, MB"),
        [
            (
                "{} x {}".format(*row["resolution"]),
                row["resolution"][0] * row["resolution"][1] / 1e6,
                row["hit"],
                milliseconds(row["seconds"]),
                1e9 * row["seconds"]["median"] / max(1, row["hit"]),
                row["peak_bytes"] / 1e6,
            )
            for row in found["pixels"]
        ],
    )
    return lines


def charts(found: dict) -> list[Chart]:
    """Time against size."""
    vertices = found["vertices"]
    return [
        Chart(
            "scaling",
            "Time of a solve against vertices, cold",
            "vertices",
            "time, ms",
            [
                Curve(
                    label,
                    [row["vertices"] for row in vertices],
                    [1e3 * row[name]["seconds"]["median"] for row in vertices],
                )
                for name, label in (("fast", "0.05 px"), ("exact", "1e-9 rad"))
            ],
        )
    ]
