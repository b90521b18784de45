# SPDX-License-Identifier: GPL-3.0-or-later
"""The bound on the interpolation error holds, and is not much more than the error."""

import numpy as np
import pytest

from benchmarks.gaps import edge_gaps, triangle_gaps
from glass_refraction import optics

FOCAL = 2400.0
EYE = np.array([0.5, 0.02, 0.1])
HOLLOW = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
FILLED = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
BOWL = optics.SphereGlass((0.04, 0.037), (1.5, 1.333))
SLAB = optics.FlatGlass((0.05,), (1.5,))
VIEW = optics.ParallelView((-0.9, 0.0, -0.3))
CASES = [
    (HOLLOW, "TTTT", EYE, (-0.25, 0.0, 0.0)),
    (HOLLOW, "TRT", EYE, (0.1, 0.3, 0.0)),
    (FILLED, "TTTT", EYE, (-0.25, 0.0, 0.0)),
    (FILLED, "TTTT", EYE, (-0.08, 0.0, 0.0)),
    (BOWL, "TTTT", EYE, (-0.25, 0.0, 0.0)),
    (SLAB, "TT", EYE, (0.0, 0.0, -0.4)),
    (HOLLOW, "TTTT", VIEW, (-0.25, 0.0, -0.1)),
]


def true_gaps(glass, path, eye, corners, parts, apparent, rows):
    """Gaps in pixels between drawn and true places at `parts` (K, C) of simplices (E, C, 3)."""
    worst = np.zeros((len(apparent.sheet), len(corners)))
    for part in parts:
        place = np.einsum("c,ecd->ed", part, corners)
        drawn = np.einsum("c,becd->bed", part, apparent.position[:, rows])
        true = optics.apparent_points(glass, path, eye, place)
        for row, sheet in enumerate(apparent.sheet):
            if sheet not in true.sheet:
                continue
            slot = true.sheet.index(sheet)
            if isinstance(eye, optics.ParallelView):
                off = true.position[slot] - drawn[row]
                gap = np.linalg.norm(np.cross(off, eye.direction), axis=1)
            else:
                aim = drawn[row] - eye
                across = np.linalg.norm(np.cross(aim, true.direction[slot]), axis=1)
                gap = np.arctan2(across, np.sum(aim * true.direction[slot], axis=1))
            gap = np.where(true.valid[slot], FOCAL * gap, 0.0)
            worst[row] = np.maximum(worst[row], gap)
    return worst


@pytest.mark.parametrize(("glass", "path", "eye", "centre"), CASES)
def test_the_gap_along_an_edge_stays_below_its_bound(glass, path, eye, centre):
    rng = np.random.default_rng(8)
    count = 250
    begin = rng.uniform(-0.1, 0.1, (count, 3)) * 0.7 + centre
    length = 10.0 ** rng.uniform(-3.5, -1.2, (count, 1))
    points = np.concatenate([begin, begin + rng.normal(size=(count, 3)) * length])
    edges = np.stack([np.arange(count), np.arange(count) + count], axis=1)
    apparent = optics.apparent_points(glass, path, eye, points)
    bound = edge_gaps(glass, path, eye, points, edges, apparent, focal_px=FOCAL)
    assert bound.shape == (len(apparent.stretch), count)
    along = np.linspace(0.0, 1.0, 30)[1:-1]
    parts = np.stack([1.0 - along, along], axis=1)
    true = true_gaps(glass, path, eye, points[edges], parts, apparent, edges)
    ends = apparent.valid[:, edges]
    assert (np.isinf(bound) | (ends[..., 0] == ends[..., 1])).all()
    both = ends.all(axis=2) & np.isfinite(bound)
    assert both.sum() > 50
    assert (true[both] <= bound[both]).all()
    seen = both & (true > 0.05)
    assert np.median(bound[seen] / true[seen]) < 1.6


@pytest.mark.parametrize(("glass", "path", "eye", "centre"), CASES)
def test_the_gap_within_a_triangle_stays_below_its_bound(glass, path, eye, centre):
    rng = np.random.default_rng(9)
    count = 80
    begin = rng.uniform(-0.1, 0.1, (count, 3)) * 0.7 + centre
    length = 10.0 ** rng.uniform(-3.0, -1.5, (count, 1))
    others = [begin + rng.normal(size=(count, 3)) * length for _ in range(2)]
    points = np.concatenate([begin, *others])
    triangles = np.arange(3 * count).reshape(3, count).T
    apparent = optics.apparent_points(glass, path, eye, points)
    bound = triangle_gaps(glass, path, eye, points, triangles, apparent, focal_px=FOCAL)
    parts = rng.dirichlet((1.0, 1.0, 1.0), 25)
    true = true_gaps(glass, path, eye, points[triangles], parts, apparent, triangles)
    whole = apparent.valid[:, triangles].all(axis=2) & np.isfinite(bound)
    assert whole.sum() > 15
    assert (true[whole] <= bound[whole]).all()


def test_edges_over_the_end_of_a_sheet():
    eye = np.array([0.8, 0.0, 0.1])
    points = np.array([[-0.07, 0.0, 0.01], [-0.07, 0.02, 0.01], [-0.07, 0.03, 0.01]])
    apparent = optics.apparent_points(FILLED, "TTTT", eye, points)
    edges = np.array([[0, 1], [1, 2], [0, 2]])
    bound = edge_gaps(FILLED, "TTTT", eye, points, edges, apparent, focal_px=FOCAL)
    ends = apparent.valid[:, edges]
    assert np.isinf(bound[ends[..., 0] != ends[..., 1]]).all()
    assert (bound[~ends.any(axis=2)] == 0.0).any()


def test_halving_an_edge_quarters_its_gap():
    points = np.array([[-0.25, 0.005, 0.0], [-0.25, 0.025, 0.0], [-0.25, 0.015, 0.0]])
    apparent = optics.apparent_points(HOLLOW, "TTTT", EYE, points)
    whole, *halves = edge_gaps(
        HOLLOW, "TTTT", EYE, points, [[0, 1], [0, 2], [2, 1]], apparent, focal_px=FOCAL
    )[0]
    assert np.mean(halves) == pytest.approx(whole / 4.0, rel=0.3)


def test_bad_input():
    apparent = optics.apparent_points(HOLLOW, "TTTT", EYE, np.zeros((2, 3)))
    with pytest.raises(ValueError, match="focal_px"):
        edge_gaps(HOLLOW, "TTTT", EYE, np.zeros((2, 3)), [[0, 1]], apparent, focal_px=0)
    none = edge_gaps(
        HOLLOW, "TTTT", EYE, np.zeros((2, 3)), np.zeros((0, 2)), apparent, focal_px=FOCAL
    )
    assert none.shape == (len(apparent.stretch), 0)
