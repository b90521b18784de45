# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendered animation: each frame as it is when rendered alone, and motion blur."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door


def _scene(width=96, height=72, **settings):
    scenes.camera()
    scenes.striped_wall()
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0, 0.1, 0.06))
    cube = bpy.context.object
    cube.data.materials.append(scenes.emissive("Yellow", (1, 1, 0)))
    for frame, x in ((1, -0.08), (5, 0.08)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    scenes.linear(cube)
    settings.setdefault("surface", "REFRACTION")
    ior = settings.pop("ior", 1.5)
    scenes.glass(shape="CYLINDER", ior=ior)
    glass = bpy.context.object
    scene = scenes.settings(width, height, **settings)
    scene.frame_start, scene.frame_end = 1, 5
    return scene, cube, glass


@pytest.mark.parametrize("persistent", [False, True])
def test_a_frame_is_the_same_in_any_order(tmp_path, persistent):
    scene, _, glass = _scene(shading="DISPLACED")
    scene.render.engine, scene.display.render_aa = "BLENDER_WORKBENCH", "OFF"
    scene.render.use_persistent_data = persistent
    glass.keyframe_insert("rotation_euler", frame=1)
    glass.rotation_euler.x = 0.3
    glass.keyframe_insert("rotation_euler", frame=5)
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.location.x = 0.1
    scene.camera.keyframe_insert("location", frame=5)
    (tmp_path / "run").mkdir()
    run = scenes.animation(scene, tmp_path / "run", [1, 2, 3, 4])
    assert np.abs(run[1] - run[4]).max() > 0.1
    for frame in (4, 2, 3):
        door.forget()
        scene.frame_set(frame)
        alone = scenes.picture(scene, tmp_path, f"alone{frame}")
        np.testing.assert_array_equal(run[frame], alone)
    # A sub-range that starts elsewhere.
    (tmp_path / "sub").mkdir()
    sub = scenes.animation(scene, tmp_path / "sub", [3, 4])
    for frame in (3, 4):
        np.testing.assert_array_equal(run[frame], sub[frame])


@pytest.mark.parametrize("shading", ["DISPLACED"])
def test_motion_blur_through_a_glass_that_does_not_refract(tmp_path, shading):
    scene, _, glass = _scene(shading=shading, ior=1.0, samples=64)
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 1.0
    scene.frame_set(3)
    through = scenes.picture(scene, tmp_path, "through")
    scene.refractive_glass.enabled = False
    glass.hide_render = True
    direct = scenes.picture(scene, tmp_path, "direct")
    scene.render.use_motion_blur = False
    sharp = scenes.picture(scene, tmp_path, "sharp")
    moving = np.abs(direct - sharp)[..., :3] > 0.1
    assert moving.sum() > 60
    off = np.abs(through - direct)[..., :3][moving]
    assert off.mean() < 0.15 * np.abs(direct - sharp)[..., :3][moving].mean()


def test_sub_frames_leave_the_frame_itself_alone(tmp_path):
    """Motion blur looks at other times; masks and places stay those of the frame."""
    scene, _, _ = _scene(shading="DISPLACED", samples=1)
    scene.render.use_motion_blur = True
    scene.frame_set(3)
    first = scenes.picture(scene, tmp_path, "first")
    solved, masks = door.counters["solves"], door.counters["masks"]
    second = scenes.picture(scene, tmp_path, "second")
    np.testing.assert_array_equal(first, second)
    # What does not change is not solved again; the moments round it are another frame's business.
    assert door.counters["masks"] == masks
    assert door.counters["solves"] > solved
