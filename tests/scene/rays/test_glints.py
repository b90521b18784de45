# SPDX-License-Identifier: GPL-3.0-or-later
"""Chance is evened out, and nothing else: edges, pixels of one ray, the light in all."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from glass_refraction.scene.rays.glints import evened

SIZE = 40, 60
RAYS = 12
LAMP = np.array((9.0, 6.0, 3.0))


def _picture(hits, rays):
    """What is evened of rays (height, width, `RAYS`) that meet a lamp or not."""
    pixel = np.nonzero(hits.reshape(-1, RAYS))[0]
    light = LAMP / rays.ravel()[pixel][:, None]
    found, colour = evened(pixel, light, rays)
    assert (np.diff(found) > 0).all()
    out = np.zeros((hits.shape[0] * hits.shape[1], 3))
    out[found] = colour
    return out.reshape(*hits.shape[:2], 3)


@pytest.mark.parametrize("part", [0.02, 0.1, 0.5])
def test_what_rays_meet_by_chance_comes_near_what_all_would(part):
    rng = np.random.default_rng(5)
    hits = rng.random((*SIZE, RAYS)) < part
    found = _picture(hits, np.full(SIZE, RAYS))
    plain = hits.mean(axis=2)[..., None] * LAMP
    was, is_now = (np.sqrt(((p - part * LAMP) ** 2).mean()) for p in (plain, found))
    assert is_now < 0.6 * was
    assert found.sum() == pytest.approx(plain.sum(), rel=0.05)


def test_edges_and_colours_stay():
    hits = np.zeros((*SIZE, RAYS), bool)
    hits[5:30, 8:50] = True
    found = _picture(hits, np.full(SIZE, RAYS))
    assert found == pytest.approx(hits.all(axis=2)[..., None] * LAMP, abs=1e-9)


def test_pixels_of_one_ray_neither_give_nor_take():
    rng = np.random.default_rng(6)
    rays = np.full(SIZE, RAYS)
    rays[:, ::2] = 1
    hits = (rng.random((*SIZE, RAYS)) < 0.05) & ((np.arange(RAYS) == 0) | (rays > 1)[..., None])
    hits[:, ::2, 0] = rng.random((SIZE[0], SIZE[1] // 2)) < 0.3
    found = _picture(hits, rays)
    assert found[:, ::2] == pytest.approx(hits[:, ::2, :1] * LAMP, abs=1e-9)
    # What is left of one pixel goes to those above and below, of a column alone.
    columns = hits[:, 1::2].any(axis=(0, 2))
    assert (found[:, 1::2].any(axis=(0, 2)) == columns).all()


def test_light_in_a_corner_stays_there():
    for row, column in ((0, 0), (SIZE[0] - 1, SIZE[1] - 1)):
        hits = np.zeros((*SIZE, RAYS), bool)
        hits[row, column, 3] = True
        found = _picture(hits, np.full(SIZE, RAYS)).any(axis=2)
        rows, columns = np.nonzero(found)
        assert len(rows) == 4
        assert (abs(rows - row) <= 1).all() and (abs(columns - column) <= 1).all()


def test_nothing_stays_nothing():
    pixel, light = evened(np.zeros(0, int), np.zeros((0, 3)), np.ones(SIZE, int))
    assert len(pixel) == len(light) == 0
