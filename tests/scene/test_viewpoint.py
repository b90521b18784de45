# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera as arrays, against Blender's own projection."""

import bpy
import numpy as np
import pytest
import scenes
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.viewpoint import border_window, read_viewpoint

CAMERAS = [
    {},
    {"lens": 85.0, "shift_x": 0.2, "shift_y": -0.1},
    {"sensor_fit": "VERTICAL", "sensor_height": 20.0},
    {"type": "ORTHO", "ortho_scale": 0.7, "shift_x": 0.1},
]


def _view(**camera):
    obj = scenes.camera(**camera)
    obj.rotation_euler = (1.3, 0.2, 0.7)
    obj.scale = (2.0, 1.0, 3.0)
    scene = scenes.settings(120, 70)
    scene.render.pixel_aspect_x = 1.4
    bpy.context.view_layer.update()
    return obj, scene, read_viewpoint(scene, scenes.depsgraph())


@pytest.mark.parametrize("camera", CAMERAS)
def test_pixels_are_blenders(camera):
    obj, scene, view = _view(**camera)
    local = np.random.default_rng(2).uniform(-0.4, 0.4, (20, 3)) - (0, 0, 2.0)
    matrix = np.linalg.inv(view.to_camera)
    points = local @ matrix[:3, :3].T + matrix[:3, 3]
    found = view.pixels(points)
    for point, pixel in zip(points, found, strict=True):
        expected = world_to_camera_view(scene, obj, Vector(point))
        np.testing.assert_allclose(pixel, (expected.x * 120, expected.y * 70), atol=2e-3)


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_go_through_their_pixels(camera):
    _, _, view = _view(**camera)
    x, y = np.random.default_rng(3).uniform(0, (120, 70), (30, 2)).T
    origins, directions = view.rays(x, y)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-14)
    for distance in (0.5, 20.0):
        found = view.pixels(origins + distance * directions)
        np.testing.assert_allclose(found, np.column_stack((x, y)), atol=1e-9)


def test_no_camera_is_said():
    with pytest.raises(RefractiveGlassError, match="no camera"):
        read_viewpoint(bpy.context.scene, scenes.depsgraph())


def test_panoramic_camera_is_said():
    scenes.camera(type="PANO")
    with pytest.raises(RefractiveGlassError, match="lens type"):
        read_viewpoint(bpy.context.scene, scenes.depsgraph())


def test_a_border_ends_where_blender_rounds_it():
    """0.7 of 60 pixels: 41.99... in double precision, 42 as Blender multiplies."""
    scene = scenes.settings(60, 60)
    scene.render.border_min_x, scene.render.border_max_x = 0.3, 0.7
    assert border_window(scene)[::2] == (18, 42)


def test_sheared_camera_is_said():
    """The engine's picture is skewed: rays at right angles would miss what it shows."""
    obj = scenes.camera()
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (2.0, 0.5, 1.0)
    obj.parent = parent
    bpy.context.view_layer.update()
    scene = scenes.settings(120, 70)
    if not obj.rotation_euler.x % (0.5 * np.pi):
        obj.rotation_euler.x = 0.7
        bpy.context.view_layer.update()
    with pytest.raises(RefractiveGlassError, match="sheared"):
        read_viewpoint(scene, scenes.depsgraph())
