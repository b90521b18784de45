# SPDX-License-Identifier: GPL-3.0-or-later
"""What each level of subdivision buys: error in pixels, bound and measured, against vertices."""

from __future__ import annotations

import numpy as np

from glass_refraction import optics

from .cases import FINE_TOLERANCE, HOLLOW, WATER
from .forward import FOCAL_PX, angles_px
from .gaps import triangle_gaps
from .measure import seconds, spread
from .plots import Chart, Curve
from .settings import Settings
from .text import milliseconds, number, table

TITLE = "Tessellation"

TOLERANCES_PX = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.1)
LATTICE = 4
"""Places looked at inside a triangle: the points of a lattice with so many steps a side."""
SIZE = (1600, 1200)

# A flat wall behind the glass: name, glass, path, eye, a corner, and its two sides, metres.
WALLS = (
    (
        "water surface, T",
        WATER,
        "T",
        (0.0, -0.5, 0.3),
        (-0.15, -0.1, -0.2),
        (0.3, 0.0, 0.0),
        (0.0, 0.3, 0.0),
    ),
    (
        "hollow cylinder, TTTT",
        HOLLOW,
        "TTTT",
        (0.5, 0.0, 0.1),
        (-0.1, -0.035, 0.0),
        (0.0, 0.07, 0.0),
        (0.0, 0.0, 0.06),
    ),
    (
        "hollow cylinder, TRT",
        HOLLOW,
        "TRT",
        (0.5, 0.0, 0.1),
        (-0.2, 0.1, 0.0),
        (0.0, 0.1, 0.0),
        (0.0, 0.0, 0.06),
    ),
)


def run(settings: Settings) -> dict:
    """All figures of this part."""
    return {"walls": [_wall(settings, *wall) for wall in WALLS]}


def _wall(settings: Settings, name, glass, path, eye, corner, side, other) -> dict:
    levels = settings.pick(range(1, 4), range(1, 7), range(1, 9))
    corner, side, other = (np.asarray(vector) for vector in (corner, side, other))
    even = []
    for level in levels:
        points, triangles = grid(corner, side, other, 2**level)
        even.append({"level": level, **_measured(settings, glass, path, eye, points, triangles)})
    tolerances = settings.pick(TOLERANCES_PX[:2], TOLERANCES_PX[:6], TOLERANCES_PX)
    adaptive = []
    for tolerance in tolerances:
        whole = grid(corner, side, other, 1)
        taken, points, triangles = _refined(glass, path, eye, *whole, tolerance)
        row = _measured(settings, glass, path, eye, points, triangles)
        adaptive.append({"tolerance_px": tolerance, "refine_seconds": taken, **row})
    return {"name": name, "even": even, "adaptive": adaptive}


def grid(corner, side, other, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a rectangle of `cells` by `cells` cells."""
    ticks = np.linspace(0.0, 1.0, cells + 1)
    u, v = np.meshgrid(ticks, ticks, indexing="ij")
    points = corner + u.reshape(-1, 1) * side + v.reshape(-1, 1) * other
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    here = np.stack((first, first + cells + 1, first + cells + 2), axis=1)
    there = np.stack((first, first + cells + 2, first + 1), axis=1)
    return points, np.concatenate((here, there))


def _refined(glass, path, eye, points, triangles, tolerance_px):
    """The product's own refinement of a mesh: seconds, points and triangles."""
    from glass_refraction.scene.vertices.tessellation import Images, Triangles, refine, region_probe

    from .views import standing, viewpoint

    view = viewpoint(eye, points.mean(axis=0), FOCAL_PX, SIZE)

    def solve(places):
        found = optics.apparent_points(
            glass, path, eye, places, tolerance=0.1 * tolerance_px / FOCAL_PX
        )
        return Images(found.position, found.valid, found.stretch)

    rect = (0, 0, *SIZE)
    probe = region_probe(standing(glass), view, optics.LightPath(path), rect)
    results = []
    taken = seconds(
        lambda: results.append(
            refine(Triangles.whole(points, triangles), solve, probe, view, rect, tolerance_px)
        )
    )
    refined = results[0].triangles
    return taken, refined.points, refined.corners


def _measured(settings: Settings, glass, path, eye, points, triangles) -> dict:
    """Vertices, time of their solve, and the gaps of triangles: bound and measured, pixels."""
    eye = np.asarray(eye, float)

    def solve(places, tolerance=FINE_TOLERANCE):
        return optics.apparent_points(glass, path, eye, places, tolerance=tolerance)

    apparent = solve(points)
    taken = spread([seconds(lambda: solve(points)) for _ in range(settings.repeats)])
    bound = triangle_gaps(glass, path, eye, points, triangles, apparent, focal_px=FOCAL_PX)
    inner = _inner_weights()
    corners = points[triangles]
    places = np.einsum("pk,tkc->tpc", inner, corners).reshape(-1, 3)
    true = solve(places, 1e-9)
    bounds, gaps = [], []
    for slot, sheet in enumerate(apparent.sheet):
        if sheet not in true.sheet:
            continue
        row = true.sheet.index(sheet)
        whole = apparent.valid[slot][triangles].all(axis=1)
        seen = true.valid[row].reshape(len(triangles), -1).all(axis=1)
        smooth = whole & seen & np.isfinite(bound[slot])
        drawn = np.einsum("pk,tkc->tpc", inner, apparent.position[slot][triangles[smooth]]) - eye
        drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
        shown = true.direction[row].reshape(len(triangles), -1, 3)[smooth]
        off = angles_px(drawn.reshape(-1, 3), shown.reshape(-1, 3)).reshape(-1, len(inner))
        gaps.append(off.max(axis=1))
        bounds.append(bound[slot][smooth])
    gaps, bounds = np.concatenate([[], *gaps]), np.concatenate([[], *bounds])
    return {
        "vertices": len(points),
        "triangles": len(triangles),
        "judged": len(gaps),
        "solve": taken,
        "bound_px": float(bounds.max(initial=0.0)),
        "measured_px": float(gaps.max(initial=0.0)),
        "mean_px": float(gaps.mean()) if len(gaps) else 0.0,
        "above_bound": int((gaps > bounds).sum()),
    }


def _inner_weights() -> np.ndarray:
    """Barycentric weights (P, 3) of a lattice over a triangle, its corners left out."""
    steps = [
        (i, j, LATTICE - i - j)
        for i in range(LATTICE + 1)
        for j in range(LATTICE + 1 - i)
        if max(i, j, LATTICE - i - j) < LATTICE
    ]
    return np.array(steps) / LATTICE


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "A flat wall behind the glass, split evenly (two triangles for the first level's four "
        "cells, and so on) and by the product's own refinement to a tolerance. *Measured*: the "
        "largest angle between a place inside a straight-edged image triangle and the true image "
        "of that place, at 12 places a triangle. *Bound*: what the library says without looking "
        "there. Triangles over which a sheet or a region ends are left out; *judged* are the rest. "
        "The refinement takes a fifth of the tolerance as long as vertices are few.",
        "",
        "![](tessellation.png)",
        "",
    ]
    for wall in found["walls"]:
        rows = [(f"2^{row['level']} cells a side", None, *_row(row)) for row in wall["even"]]
        rows += [
            (f"to {row['tolerance_px']:g} px", 1e3 * row["refine_seconds"], *_row(row))
            for row in wall["adaptive"]
        ]
        lines += table(
            (
                wall["name"],
                "refining, ms",
                "vertices",
                "solve, ms",
                "bound, px",
                "measured, px",
                "mean, px",
                "judged",
                "above bound",
            ),
            rows,
        )
    above = sum(row["above_bound"] for wall in found["walls"] for row in wall["even"])
    judged = sum(row["judged"] for wall in found["walls"] for row in wall["even"])
    lines += [f"Above the bound: {above} of {number(judged)} evenly split triangles.", ""]
    return lines


def _row(row: dict) -> tuple:
    return (
        row["vertices"],
        milliseconds(row["solve"]),
        row["bound_px"],
        row["measured_px"],
        row["mean_px"],
        row["judged"],
        row["above_bound"],
    )


def charts(found: dict) -> list[Chart]:
    """Error against vertices."""
    curves = []
    for place, wall in enumerate(found["walls"]):
        for way, word in (("even", "even"), ("adaptive", "refined")):
            rows = wall[way]
            curves.append(
                Curve(
                    f"{wall['name']}, {word}",
                    [row["vertices"] for row in rows],
                    [row["measured_px"] for row in rows],
                    dashed=way == "adaptive",
                    number=place,
                )
            )
    return [
        Chart(
            "tessellation",
            "Largest gap between straight and true image, measured",
            "vertices",
            "largest error, px",
            curves,
            level=(0.25, "0.25 px, the default tolerance"),
        )
    ]
