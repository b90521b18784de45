# SPDX-License-Identifier: GPL-3.0-or-later
"""Which views show what: cameras for captures, and the part of the light that none shows."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.rays import exits, hits


def _floor_and_tube(captures):
    """A tube on a floor: its outside mirrors the floor from all round it to the eye."""
    scenes.camera()
    scene = scenes.settings(160, 120, samples=1, shading="TRUE", captures=captures)
    bpy.ops.mesh.primitive_plane_add(size=4.0, location=(0.0, 0.0, -0.002))
    bpy.context.object.data.materials.append(scenes.emissive("Floor", (0.8, 0.4, 0.1)))
    scenes.glass(shape="CYLINDER")
    return scene


def test_one_camera_shows_surfaces_that_are_met_from_all_sides():
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    point = np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=1)
    eye = np.array((0.0, 0.0, 0.05))
    direction = (point - eye) / np.linalg.norm(point - eye, axis=1, keepdims=True)
    normal = np.tile((0.0, 0.0, 1.0), (len(turn), 1))
    side, sine = np.sign(direction[:, 2]), np.abs(direction[:, 2])
    numbers = np.zeros(len(turn), int)
    found = hits.Hits(point, direction, numbers, normal, side, sine, *[numbers > 0] * 3)
    before = hits._eye_before(found, np.ones(len(turn)))
    towards = point - before
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert before[2] > 0.0
    assert (towards @ (0.0, 0.0, -1.0) > np.cos(hits.WIDEST)).all()


def test_the_sky_has_no_eye_before_it():
    sky = -np.ones(3, int)
    rays = np.tile((0.0, 1.0, 0.0), (3, 1))
    found = hits.Hits(rays, rays, sky, 0.0 * rays, np.ones(3), np.ones(3), *[sky > 0] * 3)
    assert hits._eye_before(found, np.ones(3)) is None


def test_light_that_no_view_shows_counts_by_its_part_of_the_picture(monkeypatch, tmp_path):
    """More rays in a pixel share it: they leave the part that is not shown as it is."""
    scene = _floor_and_tube(captures=0)
    found, rays = [], []
    # The second time no pixel is worth more rays than one.
    for least in (0.0, 2.0):
        tiers = tuple((count, least + limit) for count, limit in exits.FINER)
        monkeypatch.setattr(exits, "FINER", tiers)
        scenes.picture(scene, tmp_path)
        found.append(door.status(scene).unseen)
        rays.append(door.status(scene).rays)
    assert rays[0] > 1.5 * rays[1]
    assert found[1] > 0.005
    assert abs(found[0] - found[1]) < 0.02 * found[1], found


@pytest.mark.parametrize("period", range(1, 9))
@pytest.mark.parametrize("count", [20_000, 85_929, 160_000, 1_000_003])
def test_captures_are_judged_by_each_kind_of_way_alike(count, period):
    """Where each ray has as many ways, every fourth of all would be of one path alone."""
    rows = hits.judged(count)
    assert (np.diff(rows) > 0).all() and rows[-1] < count
    assert len(rows) >= min(count, 20_000)
    kinds = np.bincount(rows % period, minlength=period) / len(rows)
    np.testing.assert_allclose(kinds, 1.0 / period, rtol=0.02)
