# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever happens in an animation, each frame is as the frame rendered alone, to the bit."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import find_layers

FRAMES = scenes.FRAMES


def _scene(surface="GLASS"):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2, clip_start=0.001)
    scenes.striped_wall(0.2)
    glass = scenes.glass(shape="CYLINDER", radius=0.04)
    scene = scenes.settings(64, 48, surface=surface, min_weight=0.05)
    scene.render.engine, scene.display.render_aa = "BLENDER_WORKBENCH", "OFF"
    scene.display.shading.color_type = "MATERIAL"
    for material in bpy.data.materials:
        if material.name.startswith("stripe"):
            material.diffuse_color = (*np.eye(3)[int(material.name[-1])], 1.0)
    return scene, glass


def _eye_enters(scene, glass):
    # Through the wall, in whose glass nothing can be computed, into the cavity.
    scenes.key(scene.camera, "location", [(0, -0.2, 0.06), (0, -0.039, 0.06), (0, -0.02, 0.06)])


def _ior_crosses_one(scene, glass):
    scenes.key_input(glass, "IOR", [1.5, 1.0, 0.8])


def _thing_appears(scene, glass):
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0.01, 0.1, 0.06))
    scenes.key(bpy.context.object, "hide_render", [True, False, True])


def _thing_passes_before(scene, glass):
    bpy.ops.mesh.primitive_cube_add(size=0.03)
    places = [(0.0, 0.1, 0.06), (0.01, -0.1, 0.06), (0.5, 0.1, 0.06)]
    scenes.key(bpy.context.object, "location", places)


def _glass_appears(scene, glass):
    scenes.key(glass, "hide_render", [True, False, True])
    other = scenes.glass(shape="ROD", radius=0.01)
    other.location.x = 0.05


def _glasses_pass_one_another(scene, glass):
    other = scenes.glass(shape="ROD", radius=0.012)
    scenes.key(other, "location", [(0.02, -0.1, 0.0), (0.02, 0.1, 0.0), (0.5, 0.0, 0.0)])


def _glass_starts_to_disperse(scene, glass):
    # Each of its paths is computed three times. Colours part by less than a pixel.
    scene.refractive_glass.min_weight, scene.display.render_aa = 0.1, "8"
    scenes.key_input(glass, "Abbe Number", [0.0, 20.0, 0.0])


def _lens_becomes_parallel(scene, glass):
    scenes.key(scene.camera.data, "type", ["PERSP", "ORTHO", "PERSP"])
    scene.camera.data.ortho_scale = 0.2


HAPPENS = (
    _eye_enters,
    _ior_crosses_one,
    _thing_appears,
    _thing_passes_before,
    _glass_appears,
    _glasses_pass_one_another,
    _glass_starts_to_disperse,
    _lens_becomes_parallel,
)


@pytest.mark.in_turn(2)
@pytest.mark.parametrize("happens", HAPPENS, ids=lambda f: f.__name__.strip("_"))
def test_a_frame_of_an_animation_is_the_frame_alone(tmp_path, happens):
    scene, glass = _scene()
    happens(scene, glass)
    scene.frame_set(1)
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(tmp_path / "run_####.exr")
    scene.frame_start, scene.frame_end = FRAMES[0], FRAMES[-1]
    structures = door.counters["structures"]
    bpy.ops.render.render(animation=True)
    assert door.counters["structures"] == structures + 1
    run = {frame: scenes.load(tmp_path / f"run_{frame:04}.exr") for frame in FRAMES}
    assert np.abs(run[1] - run[2]).max() > 0.02
    for frame in reversed(FRAMES):
        door.remove(scene)
        scene.frame_set(frame)
        alone = scenes.picture(scene, tmp_path, f"alone{frame}")
        np.testing.assert_array_equal(run[frame], alone)


def test_where_the_ior_is_one_there_is_no_glass(tmp_path):
    scene, glass = _scene()
    _ior_crosses_one(scene, glass)
    scene.frame_set(2)
    through = scenes.picture(scene, tmp_path, "through")
    glass.hide_render = True
    np.testing.assert_array_equal(through, scenes.picture(scene, tmp_path, "direct"))


def test_no_scene_is_rendered_by_another_engine_than_the_users():
    scene, _ = _scene()
    for engine in ("BLENDER_WORKBENCH", "CYCLES", "BLENDER_EEVEE"):
        scene.render.engine = engine
        door.prepare(scene, scenes.depsgraph())
        layers = find_layers(scene)
        assert {made.render.engine for made in layers.all()} == {engine}
        assert {s for s in bpy.data.scenes if s != scene} == set(layers.all())


def test_what_exceeds_the_slots_is_told_of(tmp_path):
    scene, _ = _scene()
    scene.refractive_glass.min_weight = 1e-4
    door.prepare(scene, scenes.depsgraph())
    plan = door.memory_of(scene).plan
    (pane,) = plan.panes
    found = door.update(scene, scenes.depsgraph())
    kept = len(found.paths)
    assert kept <= pane.slots
    assert ("are left out" in " ".join(found.problems)) == (kept == pane.slots)
