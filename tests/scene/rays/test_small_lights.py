# SPDX-License-Identifier: GPL-3.0-or-later
"""Capsules hold what shines; ways are told of what they pass by, and of nothing else."""

import numpy as np
import pytest

from glass_refraction.scene.rays.exits import Neighbours
from glass_refraction.scene.rays.hits import Scene, Ways
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.sky import Sky
from glass_refraction.scene.rays.small_lights import MOST, capsules, small_lights
from glass_refraction.scene.rays.things import Things

SIZE = 12
"""Pixels along either side."""
STEP = 0.1
"""Metres between the ways of neighbouring pixels, which run along z."""
BRIGHT = Look((0.0, 0.0, 0.0), (9.0, 5.0, 1.0), is_plain=True)


def _strip(begin, end, width, pieces):
    """Triangles of a strip in z = 0 from one place to another."""
    t = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    begin, end = np.array(begin), np.array(end)
    across = np.array((begin[1] - end[1], end[0] - begin[0]))
    across = 0.5 * width * across / np.linalg.norm(across)
    middle = begin + t * (end - begin)
    flat = np.concatenate((middle - across, middle + across))
    a, b = np.arange(pieces), np.arange(pieces) + pieces + 1
    triangles = np.concatenate((np.stack((a, a + 1, b), 1), np.stack((a + 1, b + 1, b), 1)))
    return np.column_stack((flat, np.zeros(len(flat)))), triangles.astype(np.int32)


def _things(points, triangles, look=BRIGHT):
    return Things(points, triangles, np.zeros(len(triangles), np.int32), (look,), ("",))


def _told(things, distance=np.inf):
    """(SIZE, SIZE) what is told of parallel ways, all of one path."""
    number = np.arange(SIZE * SIZE)
    x, y = number % SIZE, number // SIZE
    zero, one = np.zeros(len(number)), np.ones(len(number))
    ways = Ways(
        number.astype(np.int32),
        np.zeros(len(number), np.int64),
        one,
        np.ones((len(number), 3)),
        STEP * np.column_stack((x, y, zero)) - (0.0, 0.0, 1.0),
        np.tile((0.0, 0.0, 1.0), (len(number), 1)),
        np.full(len(number), distance),
        np.full(len(number), -1),
        np.ones(len(number), int),
        zero.astype(bool),
    )
    inner = [(p < SIZE - 1, p > 0) for p in (x, y)]
    ahead = tuple(np.where(i[0], number + s, -1) for i, s in zip(inner, (1, SIZE), strict=True))
    behind = tuple(np.where(i[1], number - s, -1) for i, s in zip(inner, (1, SIZE), strict=True))
    beside = Neighbours(number, ahead, behind, tuple(inner))
    scene = Scene(None, things, Sky((0.0, 0.0, 0.0)))
    return small_lights(scene, ways, beside, np.array((9.0, 1.0))).reshape(SIZE, SIZE)


@pytest.mark.parametrize("pieces", [1, 7, 400])
def test_capsules_hold_what_shines(pieces):
    points, triangles = _strip((0.0, 0.0), (1.0, 0.3), 0.02, pieces)
    found = capsules(_things(points, triangles), np.array((True,)))
    assert 1 <= len(found) <= MOST
    apart = []
    for one in found:
        begin, end = one.axis
        along = end - begin
        share = (points - begin) @ along / max(along @ along, 1e-12)
        foot = begin + np.clip(share, 0.0, 1.0)[:, None] * along
        apart.append(np.linalg.norm(points - foot, axis=1) - one.radius)
    # Ends are round: corners may stand out by what a half circle lacks of a square.
    assert np.min(apart, axis=0).max() < 0.5 * 0.02


def test_what_does_not_shine_has_no_capsules():
    things = _things(*_strip((0.0, 0.0), (1.0, 0.0), 0.02, 3), Look())
    assert capsules(things, np.array((False,))) == []
    assert not _told(things).any()


@pytest.mark.parametrize("pieces", [1, 40])
@pytest.mark.parametrize("turn", [0.0, 0.12, 0.8, 1.5])
def test_no_pixel_misses_a_thin_wire(turn, pieces):
    middle = STEP * np.array((5.3, 5.6))
    half = 0.3 * np.array((np.cos(turn), np.sin(turn)))
    told = _told(_things(*_strip(middle - half, middle + half, 0.01, pieces)))
    share = np.linspace(-1.0, 1.0, 500)[:, None]
    x, y = np.rint((middle + share * half) / STEP).astype(int).T
    assert (told[y, x] == 9.0).all()
    assert (told > 0.0).sum() < 4 * len(np.unique(y * SIZE + x))


def test_what_is_wider_than_pixels_or_hidden_is_not_told():
    wide = _things(*_strip((0.3, 0.5), (0.8, 0.5), 0.5, 1))
    assert not _told(wide).any()
    thin = _things(*_strip((0.3, 0.5), (0.8, 0.5), 0.01, 1))
    assert _told(thin).any()
    assert not _told(thin, distance=0.5).any()
