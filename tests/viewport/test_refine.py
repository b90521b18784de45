# SPDX-License-Identifier: GPL-3.0-or-later
"""Large triangles are divided: nothing of them is lost, and no gap opens between their parts."""

from collections import Counter

import numpy as np
import pytest

from glass_refraction.viewport.refine import BY_DISTANCE, FINEST, is_far, is_large, refined

FLOOR = np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0), (2, 2, 1.5)], float)
TRIANGLES = np.array([(0, 1, 2), (0, 2, 3), (1, 4, 2)], np.int32)
GLASSES = [(np.array((0.1, 0.3, 0.06)), 0.07), (np.array((-1.0, 0.3, 0.1)), 0.1)]


def areas(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


@pytest.fixture(scope="module")
def parts():
    return refined(FLOOR, TRIANGLES, GLASSES)


def test_the_parts_are_the_whole(parts):
    found, whole = areas(*parts), areas(FLOOR, TRIANGLES)
    assert np.linalg.norm(found, axis=1).sum() == pytest.approx(np.linalg.norm(whole, axis=1).sum())
    # Each is turned as the triangle that it is a part of.
    assert found.sum(axis=0) == pytest.approx(whole.sum(axis=0))


def test_no_edge_is_longer_than_it_may_be_where_it_lies(parts):
    points, triangles = parts
    assert not is_large(points, triangles, GLASSES).any()
    a, b = points[triangles], np.roll(points[triangles], -1, axis=1)
    length = np.linalg.norm(b - a, axis=2)
    for middle, reach in GLASSES:
        away = np.maximum(np.linalg.norm(0.5 * (a + b) - middle, axis=2) - reach, 0.0)
        assert (length <= np.maximum(FINEST * reach, BY_DISTANCE * away) * (1 + 1e-9)).all()
    assert len(triangles) < 100_000


def test_no_gap_opens(parts):
    points, triangles = parts
    names = {tuple(p): n for n, p in enumerate(points.tolist())}
    number = np.array([names[tuple(p)] for p in points.tolist()])
    merged = number[triangles]
    edges = Counter(
        tuple(sorted(pair)) for t in merged.tolist() for pair in zip(t, t[1:] + t[:1], strict=True)
    )
    # What only one triangle has lies on the border: on one of the mesh's own open edges.
    border = [edge for edge, count in edges.items() if count == 1]
    assert max(edges.values()) == 2
    length = sum(np.linalg.norm(points[a] - points[b]) for a, b in border)
    assert length == pytest.approx(4 + 4 + 4 + 1.5 + np.hypot(4, 1.5))


def test_small_triangles_and_scenes_without_glass_stay_as_they_are():
    small = FLOOR * 1e-3
    assert not is_large(small, TRIANGLES, GLASSES).any()
    assert not is_large(FLOOR, TRIANGLES, []).any()
    points, triangles = refined(small, TRIANGLES, GLASSES)
    assert np.array_equal(points, small) and np.array_equal(triangles, TRIANGLES)


def test_what_is_not_far_holds_all_that_a_glass_may_hold(parts):
    points, triangles = parts
    near = ~is_far(points, triangles, GLASSES)
    assert 0 < near.sum() < 0.7 * len(triangles)
    places = points[triangles].mean(axis=1)
    for middle, reach in GLASSES:
        assert near[np.linalg.norm(places - middle, axis=1) < 1.25 * reach].all()
