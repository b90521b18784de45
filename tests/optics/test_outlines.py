# SPDX-License-Identifier: GPL-3.0-or-later
"""A polygon's grid against all of its sides, and faces met through it against each face alone."""

from __future__ import annotations

import numpy as np
import pytest

from glass_refraction.optics.axial import nearest
from glass_refraction.optics.bodies import Prism
from glass_refraction.optics.glasses import FlatGlass
from glass_refraction.optics.outlines import Outline
from glass_refraction.optics.surfaces import Fence, Rays


def circle(count: int) -> tuple:
    angle = np.arange(count) * 2.0 * np.pi / count
    return tuple(map(tuple, np.stack((np.cos(angle), np.sin(angle)), axis=1).tolist()))


def star() -> tuple:
    angle, radius = np.arange(10) * np.pi / 5.0, np.tile((1.0, 0.4), 5)
    corners = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    return tuple(map(tuple, corners.tolist()))


OUTLINES = {
    "triangle": ((0.0, 0.0), (1.0, 0.0), (0.2, 0.7)),
    "star": star(),
    "circle": circle(128),
    "sliver": ((0.0, 0.0), (1.0, 0.0), (1.0, 1e-6), (0.0, 1e-6)),
    "far": tuple((x + 1e6, y - 1e6) for x, y in star()),
}


@pytest.fixture(params=OUTLINES)
def outline(request) -> Outline:
    return Outline(OUTLINES[request.param])


def places(outline: Outline, count: int = 20_000) -> np.ndarray:
    """Places (2, N) in and round a polygon's box, corners and places on sides among them."""
    random = np.random.default_rng(5)
    corners = np.array(outline.corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    spread = random.uniform(low - 0.3 * (high - low), high + 0.3 * (high - low), (count, 2))
    begin, end = np.moveaxis(np.array(outline.sides), 1, 0)
    on = begin + random.uniform(0.0, 1.0, (len(begin), 1)) * (end - begin)
    return np.concatenate([spread, corners, on, [(1e30, -1e30)]]).T


def test_a_place_is_held_as_all_sides_say(outline):
    x, y = places(outline)
    inside = np.zeros(len(x), bool)
    for (ax, ay), (bx, by) in outline.sides:
        if ay != by:
            inside ^= ((ay <= y) != (by <= y)) & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    assert np.array_equal(outline.holds(x, y), inside)
    assert inside.any()


def test_no_side_is_nearer_than_the_grid_says(outline):
    x, y = places(outline)
    distance = np.full(len(x), np.inf)
    for begin, end in np.array(outline.sides):
        way = end - begin
        along = np.clip(((x - begin[0]) * way[0] + (y - begin[1]) * way[1]) / (way @ way), 0, 1)
        distance = np.minimum(
            distance, np.hypot(x - begin[0] - along * way[0], y - begin[1] - along * way[1])
        )
    size = np.ptp(np.array(outline.corners), axis=0).max()
    clear = outline.clear(x, y)
    assert (clear <= distance + 1e-15 * np.abs(outline.corners).max()).all()
    # And it says something: inside of what is wide, most places are known to be clear.
    assert clear[np.hypot(x, y) < 1e29].max() > 0.05 * size


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("name", ["triangle", "star", "circle"])
def test_faces_are_met_as_each_face_alone_is(name, back):
    outline = Outline(OUTLINES[name])
    fence = Fence(outline, -0.1, 0.2)
    random = np.random.default_rng(7)
    count = 5_000
    place, way = random.uniform(-1.2, 1.2, (2, 3, count))
    place[2] *= 0.3
    if back:
        keep = outline.holds(place[0], place[1]) & (place[2] > -0.1) & (place[2] < 0.2)
        place, way = place[:, keep], way[:, keep]
    way[:, : len(way.T) // 10] *= np.array([[1.0], [1.0], [0.0]])
    limit = random.choice([np.inf, 0.3, 1.0], way.shape[1])
    met, face, found = fence.meet(Rays(tuple(place), tuple(way)), back, limit)
    least, first = limit.copy(), np.full(way.shape[1], -1)
    for number, ((ax, ay), (bx, by)) in enumerate(outline.sides):
        length = np.hypot(bx - ax, by - ay)
        dx, dy = (bx - ax) / length, (by - ay) / length
        outward = way[0] * dy - way[1] * dx
        with np.errstate(all="ignore"):
            t = ((ax - place[0]) * dy - (ay - place[1]) * dx) / outward
            x, y, z = place + t * way
        along = (x - ax) * dx + (y - ay) * dy
        hit = ((outward > 0.0) == back) & (outward != 0.0) & (t >= 0.0) & (t < least)
        hit &= (along >= 0.0) & (along <= length) & (z >= -0.1) & (z <= 0.2)
        least[hit], first[hit] = t[hit], number
    assert np.array_equal(met, np.flatnonzero(first >= 0))
    assert np.array_equal(face, first[met])
    assert np.allclose(found, least[met], rtol=1e-12, atol=1e-12)
    assert len(met) > 50


def test_from_within_every_ray_meets_a_face_or_a_lid():
    """No ray leaks through a gap between faces, also where they and the lids touch."""
    body = Prism(FlatGlass((0.3,), (1.5,), outline=circle(64)))
    random = np.random.default_rng(3)
    place = random.uniform(-0.3, 0.3, (3, 20_000))
    place[2] = -0.075
    aim = np.array(circle(64))[random.integers(0, 64, 20_000)].T / body.scale
    way = np.concatenate([aim, random.choice([0.0, -0.15], (1, 20_000))]) - place
    met, length, _ = nearest(body, 1, Rays(tuple(place), tuple(1.5 * way)))
    assert (met >= 0).all()
    assert np.allclose(1.5 * length, 1.0, atol=1e-9)
