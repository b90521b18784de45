# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of the solver against its time: ours, plain Newton steps, and the paper's own method."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from glass_refraction import optics
from glass_refraction.optics.axial import AxialGlass

from . import newton, paper
from .cases import (
    BEHIND_HOLLOW,
    BEHIND_SLAB,
    CASES,
    FINE_TOLERANCE,
    HOLLOW,
    PIXEL_TOLERANCE,
    SLAB,
    Case,
    eraser,
)
from .forward import FOCAL_PX, angles_px, check, direction_errors, summary
from .measure import seconds, spread, timings
from .plots import Chart, Curve
from .settings import Settings
from .text import milliseconds, table

TITLE = "Solver"

TOLERANCES = (2e-4, PIXEL_TOLERANCE, 4e-6, FINE_TOLERANCE, 4e-8, 1e-9)
LISTED = (PIXEL_TOLERANCE, FINE_TOLERANCE, 1e-9)
"""The tolerances of the report's table; the chart shows all."""
ROUNDS = (1, 2, 5, 10, 20, 40)
MOVED = 1e-3
"""How far points move from one frame to the next, metres."""
SLIDE = 0.037
"""How far the eraser of the paper's tables slides in all: from behind the glass to half beside."""

# The paper's tables 1, 2 and 3: frames a second on an Intel Core i7 at 3.4 GHz with an NVIDIA
# GeForce GTX 570, drawing included.
TABLE_1 = {
    100_000: 122,
    200_000: 81,
    300_000: 55,
    400_000: 42,
    500_000: 36,
    600_000: 30,
    700_000: 26,
    800_000: 22,
}
TABLE_2 = {  # worst, best, average; ray tracing on the GPU
    100_000: (65, 130, 96, 26),
    200_000: (37, 75, 56, 25),
    300_000: (24, 54, 39, 24),
    400_000: (18, 42, 30, 22),
    500_000: (15, 34, 25, 21),
    600_000: (12, 28, 20, 21),
    700_000: (10, 24, 17, 20),
    800_000: (9, 22, 16, 20),
}
TABLE_3 = {  # width, height: this method, ray tracing on the GPU
    (640, 480): (98, 60),
    (800, 600): (98, 45),
    (1024, 768): (97, 34),
    (1600, 1200): (96, 26),
}


def run(settings: Settings) -> dict:
    """All figures of this part."""
    return {
        "cases": [
            _case(settings, number, case)
            for number, case in enumerate(CASES)
            if settings.size == "full" or not case.slow
        ],
        "rivals": {
            "slab": _slab_rivals(settings),
            "cylinder": _cylinder_rivals(settings),
        },
        "table_1": _table_1(settings),
        "table_2": _table_2(settings),
        "table_3": _table_3(settings),
    }


# --- ours, over shapes, paths and tolerances -----------------------------------------------------


def _case(settings: Settings, place: int, case: Case) -> dict:
    count = settings.pick(500, 20_000, 100_000)
    tolerances = TOLERANCES
    if case.searched:
        count, tolerances = settings.pick(100, 1_000, 3_000), LISTED
    points = case.points(settings.random(1, place), count)
    eye = np.asarray(case.eye)
    # Of a glass whose interfaces have names, what the benchmark's points lie in: the last stretch.
    last = isinstance(case.glass, AxialGlass)
    true = optics.apparent_points(case.glass, case.path, eye, points, last=last)
    checked = check(case.glass, case.path, eye, points, true)
    before = {
        tolerance: optics.apparent_points(
            case.glass, case.path, eye, points - (0.0, MOVED, 0.0), tolerance=tolerance, last=last
        )
        for tolerance in tolerances
    }

    def solve(tolerance, guess=None):
        return optics.apparent_points(
            case.glass, case.path, eye, points, tolerance=tolerance, guess=guess, last=last
        )

    candidates, figures = {}, {}
    for tolerance in tolerances:
        for start, guess in (("cold", None), ("warm", before[tolerance])):
            candidates[f"{start} {tolerance:g}"] = lambda t=tolerance, g=guess: solve(t, g)

    def judge(name, found):
        errors, different = direction_errors(found, true)
        if name.endswith(f" {LISTED[-1]:g}"):
            # The reference itself: only the trace can tell.
            errors = check(case.glass, case.path, eye, points, found).errors_px
        figures[name] = {
            "steps": found.iterations,
            "different_images": different,
            **summary(errors),
        }

    times = timings(candidates, settings.pick(1, 1, 3), judge)
    rows = [
        {
            "tolerance": tolerance,
            "tolerance_px": FOCAL_PX * tolerance,
            "listed": tolerance in LISTED,
            **{
                start: {
                    "seconds": times[f"{start} {tolerance:g}"],
                    **figures[f"{start} {tolerance:g}"],
                }
                for start in ("cold", "warm")
            },
        }
        for tolerance in tolerances
    ]
    return {
        "name": case.name,
        "points": count,
        "images": checked.images,
        "held": checked.held,
        "forward_px": checked.worst_px,
        "rows": rows,
    }


# --- rivals --------------------------------------------------------------------------------------


def _slab_rivals(settings: Settings) -> list[dict]:
    case = BEHIND_SLAB
    count = settings.pick(500, 20_000, 100_000)
    points = case.points(settings.random(2), count)
    candidates = {
        f"plain Newton, float64, {k} steps": (
            lambda k=k: newton.slab_places(SLAB, case.eye, points, k)
        )
        for k in range(1, 6)
    }
    candidates |= {
        f"plain Newton, float32, {k} steps": (
            lambda k=k: newton.slab_places(SLAB, case.eye, points, k, np.float32)
        )
        for k in range(1, 6)
    }
    candidates |= {
        f"the paper's method, {k} steps": lambda k=k: paper.slab_places(SLAB, case.eye, points, k)
        for k in range(1, 6)
    }
    return _rivals(settings, case, points, candidates)


def _cylinder_rivals(settings: Settings) -> list[dict]:
    case = BEHIND_HOLLOW
    count = settings.pick(500, 20_000, 100_000)
    points = case.points(settings.random(3), count)
    candidates = {
        f"plain Newton, float64, {k} steps": (
            lambda k=k: newton.cylinder_places(HOLLOW, case.eye, points, k)
        )
        for k in range(1, 6)
    }
    candidates |= {
        f"plain Newton, float32, {k} steps": (
            lambda k=k: newton.cylinder_places(HOLLOW, case.eye, points, k, np.float32)
        )
        for k in range(1, 6)
    }
    candidates |= {
        f"the paper's method, {k} rounds": (
            lambda k=k: paper.cylinder_places(HOLLOW, case.eye, points, k)
        )
        for k in ROUNDS
    }
    return _rivals(settings, case, points, candidates)


def _rivals(settings: Settings, case: Case, points, candidates) -> list[dict]:
    """Errors and times of functions that give positions, and of ours beside them."""
    eye = np.asarray(case.eye)
    true = optics.apparent_points(case.glass, case.path, eye, points)
    before = optics.apparent_points(case.glass, case.path, eye, points - (0.0, MOVED, 0.0))
    (slot,) = np.flatnonzero(true.valid.any(axis=1))

    def ours(tolerance, guess):
        return optics.apparent_points(
            case.glass, case.path, eye, points, tolerance=tolerance, guess=guess
        ).position[slot]

    for tolerance in TOLERANCES:
        name = f"{FOCAL_PX * tolerance:.2g} px asked for"
        candidates[f"ours, {name}"] = lambda t=tolerance: ours(t, None)
        candidates[f"ours from the last frame, {name}"] = lambda t=tolerance: ours(t, before)
    figures = {}

    def judge(name, positions):
        towards = positions.astype(float) - eye
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        shown = true.valid[slot]
        errors = angles_px(towards[shown], true.direction[slot, shown])
        figures[name] = {
            "off_share": float((errors > 0.05).mean()),
            "median_px": float(np.median(errors)),
            **summary(errors),
        }

    times = timings(candidates, settings.pick(1, 1, 3), judge)
    return [{"name": name, "seconds": times[name], **figures[name]} for name in candidates]


# --- the paper's tables --------------------------------------------------------------------------


def _rates(frames: Iterable[float]) -> dict[str, float]:
    """Worst, best and average updates a second from the seconds of each."""
    taken = list(frames)
    return {
        "worst": 1.0 / max(taken),
        "best": 1.0 / min(taken),
        "average": len(taken) / sum(taken),
    }


def _counts(settings: Settings) -> tuple[int, ...]:
    return settings.pick((1_000,), (100_000, 400_000), tuple(TABLE_2))


def _table_1(settings: Settings) -> list[dict]:
    """Points that move behind a slab, frame by frame."""
    rows = []
    for count in _counts(settings):
        points = BEHIND_SLAB.points(settings.random(5), count)

        def frames(points=points):
            for frame in range(settings.pick(2, 4, 12)):
                moved = points + np.array((0.003 * frame, 0.0, 0.0))
                yield seconds(
                    lambda moved=moved: optics.apparent_points(
                        SLAB, "TT", BEHIND_SLAB.eye, moved, tolerance=PIXEL_TOLERANCE
                    )
                )

        rows.append({"vertices": count, **_rates(frames()), "paper": TABLE_1.get(count)})
    return rows


def _cylinder_frames(settings: Settings, count: int, tolerance: float, weights=None):
    """Seconds of each frame while the eraser slides behind the hollow glass, to half beside it."""
    points = eraser(settings.random(6), count, 0.0)
    total = settings.pick(2, 4, 12)
    found = None
    for frame in range(-1, total):
        moved = points + np.array((0.0, SLIDE * (frame + 1) / total, 0.0))

        def update(moved=moved, guess=found):
            if weights is not None:
                weights()
            return optics.apparent_points(
                HOLLOW, "TTTT", BEHIND_HOLLOW.eye, moved, tolerance=tolerance, guess=guess
            )

        results = []
        taken = seconds(lambda update=update, results=results: results.append(update()))
        found = results[0]
        if frame >= 0:
            yield taken


def _table_2(settings: Settings) -> list[dict]:
    rows = []
    for count in _counts(settings):
        points = eraser(settings.random(6), count, 0.0)
        plain = seconds(lambda p=points: newton.cylinder_places(HOLLOW, BEHIND_HOLLOW.eye, p))
        row = {"vertices": count, "paper": TABLE_2.get(count)}
        row |= _rates(_cylinder_frames(settings, count, PIXEL_TOLERANCE))
        row["of_plain"] = 1.0 / row["average"] / plain
        row["nested"] = None
        if count <= settings.pick(1_000, 100_000, 400_000):
            nested = seconds(lambda p=points: paper.cylinder_places(HOLLOW, BEHIND_HOLLOW.eye, p))
            row["nested"] = 1.0 / nested
        rows.append(row)
    return rows


def _table_3(settings: Settings) -> list[dict]:
    rows = []
    count = settings.pick(500, 100_000, 100_000)
    for (width, height), known in TABLE_3.items():
        # The same picture at every size: half a picture's width is 0.333 in tangents.
        focal = FOCAL_PX * width / 1600.0
        directions = _picture_rays(width, height, focal)
        if settings.size == "tiny":
            directions = directions[::1000]

        def weights(directions=directions):
            return optics.path_weights(HOLLOW, BEHIND_HOLLOW.eye, directions, ("TTTT", "TRT"))

        tolerance = 0.05 / focal
        rows.append(
            {
                "resolution": [width, height],
                "paper": known,
                "still": _rates(_cylinder_frames(settings, count, tolerance)),
                "moving": _rates(_cylinder_frames(settings, count, tolerance, weights)),
                "weights": spread([seconds(weights) for _ in range(settings.repeats)]),
            }
        )
    return rows


def _picture_rays(width: int, height: int, focal: float) -> np.ndarray:
    """Directions (M, 3) through all pixels of a picture that looks at the hollow glass."""
    eye = np.asarray(BEHIND_HOLLOW.eye)
    forward = np.array([0.0, 0.0, 0.06]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    return forward + (x.reshape(-1, 1) * right + y.reshape(-1, 1) * up) / focal


# --- words ---------------------------------------------------------------------------------------


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        f"Errors are angles at the eye in pixels, {FOCAL_PX:.0f} px a radian, between an image and "
        "the same image at a tolerance of 1e-9 rad (2.4e-6 px), which in turn is traced forward "
        "with plain vector refraction: its own row tells by how much the ray misses. Times are "
        "medians (and the range) of a whole call; *warm* starts from the result for the points "
        f"{1e3 * MOVED:g} mm away. Float32 is used where the tolerance leaves room for it.",
        "",
        "### Every shape and path",
        "",
        "![](solver_cases.png)",
        "",
    ]
    rows = []
    for case in found["cases"]:
        for row in case["rows"]:
            if not row["listed"]:
                continue
            rows.append(
                (
                    case["name"],
                    case["points"],
                    row["tolerance_px"],
                    milliseconds(row["cold"]["seconds"]),
                    milliseconds(row["warm"]["seconds"]),
                    row["cold"]["max_px"],
                    row["cold"]["p999_px"],
                    row["cold"]["mean_px"],
                    row["warm"]["max_px"],
                    row["cold"]["different_images"] + row["warm"]["different_images"],
                )
            )
    lines += table(
        (
            "case",
            "points",
            "asked, px",
            "cold, ms",
            "warm, ms",
            "max, px",
            "99.9 %, px",
            "mean, px",
            "warm max, px",
            "other images",
        ),
        rows,
    )
    lines += [
        "*Other images*: images, of both runs, that are there in one tolerance and not in the "
        "finest; they lie within the tolerance of where a region or a sheet ends.",
        "",
    ]
    lines += table(
        ("case", "images", "held by forward trace", "largest miss, px"),
        [(c["name"], c["images"], c["held"], c["forward_px"]) for c in found["cases"]],
    )
    lines += [
        "### Against plain Newton steps and the paper's own method",
        "",
        "Plain Newton: whole arrays, the same number of steps for all points, without residual, "
        "validity or safeguard. The paper's method: equations (5) and (2) for the slab; for the "
        "cylinder one interface undone at a time by (5) and (8), the unknown eye positions taken "
        f"from the last round and relaxed by {paper.RELAXATION}, in blocks on two threads as ours.",
        "",
        "![](solver_cylinder.png)",
        "![](solver_slab.png)",
        "",
    ]
    for name, rivals in found["rivals"].items():
        lines += table(
            (name, "time, ms", "max, px", "99.9 %, px", "median, px", "off by more than 0.05 px"),
            [
                (
                    row["name"],
                    milliseconds(row["seconds"]),
                    row["max_px"],
                    row["p999_px"],
                    row["median_px"],
                    f"{100 * row['off_share']:.3g} %",
                )
                for row in rivals
            ],
        )
    lines += [
        "### The paper's tables",
        "",
        "Theirs: frames a second, drawing included, on an Intel Core i7 at 3.4 GHz with an NVIDIA "
        "GeForce GTX 570 (2013); OptiX is ray tracing on that GPU. Ours: updates a second of all "
        "positions to 0.05 px **without drawing**, on the machine named above and on its "
        "processor alone; the object slides from behind the cylinder to half beside it, and each "
        "frame starts from the last one's result. The two machines cannot be compared; how the "
        "figures grow can; the live view's frames, drawn, stand under *Live view*. *Of plain*: "
        "time of an average update over that of four plain steps. *Nested*: the paper's method on "
        f"this machine, {paper.ROUNDS} rounds.",
        "",
        "Table 1, slab:",
        "",
    ]
    lines += table(
        ("vertices", "paper", "ours, worst", "best", "average"),
        [
            (row["vertices"], row["paper"], row["worst"], row["best"], row["average"])
            for row in found["table_1"]
        ],
    )
    lines += ["Table 2, cylinder:", ""]
    lines += table(
        (
            "vertices",
            "paper, worst",
            "best",
            "average",
            "OptiX",
            "ours, worst",
            "best",
            "average",
            "of plain",
            "nested",
        ),
        [
            (
                row["vertices"],
                *(row["paper"] or (None,) * 4),
                row["worst"],
                row["best"],
                row["average"],
                row["of_plain"],
                row["nested"],
            )
            for row in found["table_2"]
        ],
    )
    lines += [
        "Table 3, cylinder, 100,000 vertices in the full run. *Glass and eye move*: the weights of "
        "two paths are computed for every pixel as well.",
        "",
    ]
    lines += table(
        ("resolution", "paper", "OptiX", "ours, object moves", "ours, glass and eye move"),
        [
            (
                "{} x {}".format(*row["resolution"]),
                *row["paper"],
                row["still"]["average"],
                row["moving"]["average"],
            )
            for row in found["table_3"]
        ],
    )
    return lines


def charts(found: dict) -> list[Chart]:
    """Error against time."""
    made = [
        Chart(
            "solver_cases",
            "Largest error against time, cold, by tolerance",
            "time a point, µs",
            "largest error, px",
            [
                Curve(
                    case["name"],
                    [
                        1e6 * row["cold"]["seconds"]["median"] / case["points"]
                        for row in case["rows"]
                    ],
                    [max(row["cold"]["max_px"], case["forward_px"]) for row in case["rows"]],
                    dashed=number >= 6,
                    number=number % 6,
                )
                for number, case in enumerate(found["cases"])
            ],
            level=(0.05, "0.05 px"),
        )
    ]
    for name, rivals in found["rivals"].items():
        curves = []
        for label in dict.fromkeys(_label(row) for row in rivals):
            rows = [row for row in rivals if _label(row) == label]
            x = [1e3 * row["seconds"]["median"] for row in rows]
            place = len(curves)
            curves.append(
                Curve(label + ", largest", x, [max(r["max_px"], FLOOR) for r in rows], number=place)
            )
        if name == "cylinder":
            rows = [row for row in rivals if _label(row) == "the paper's method"]
            x = [1e3 * row["seconds"]["median"] for row in rows]
            y = [max(row["median_px"], FLOOR) for row in rows]
            curves.append(Curve("the paper's method, median", x, y, dashed=True, number=2))
        made.append(
            Chart(
                f"solver_{name}",
                f"Error against time: {'hollow cylinder, TTTT' if name == 'cylinder' else name}",
                "time, ms",
                "error, px",
                curves,
                level=(0.05, "0.05 px"),
            )
        )
    return made


FLOOR = 1e-13
"""Least error that a chart shows; the exact ones would have no place on its axis."""


def _label(row: dict) -> str:
    """What a rival is called without its number of steps."""
    words = row["name"].split(", ")
    return ", ".join(words[:-1])
