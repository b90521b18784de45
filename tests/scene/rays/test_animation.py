# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever happens in an animation, each frame is as the frame rendered alone, to the bit."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door

FRAMES = scenes.FRAMES


def _scene():
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2, clip_start=0.001)
    scenes.striped_wall(0.2)
    glass = scenes.glass(shape="CYLINDER", radius=0.04)
    scene = scenes.settings(48, 36, shading="TRUE")
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.color_type = "MATERIAL"
    for material in bpy.data.materials:
        if material.name.startswith("stripe"):
            material.diffuse_color = (*np.eye(3)[int(material.name[-1])], 1.0)
    return scene, glass


def _cube(location, size=0.03):
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    return bpy.context.object


def _eye_enters(scene, glass):
    # Through the wall into the cavity.
    scenes.key(scene.camera, "location", [(0, -0.2, 0.06), (0, -0.039, 0.06), (0, -0.02, 0.06)])


def _ior_crosses_one(scene, glass):
    scenes.key_input(glass, "IOR", [1.5, 1.0, 0.8])


def _thing_appears(scene, glass):
    scenes.key(_cube((0.01, 0.1, 0.06)), "hide_render", [True, False, True])


def _thing_passes_before(scene, glass):
    places = [(0.0, 0.1, 0.06), (0.01, -0.1, 0.06), (0.5, 0.1, 0.06)]
    scenes.key(_cube((0, 0, 0)), "location", places)


def _thing_enters_the_cavity(scene, glass):
    places = [(0.0, 0.1, 0.06), (0.01, 0.0, 0.06), (0.0, 0.1, 0.06)]
    scenes.key(_cube((0, 0, 0)), "location", places)


def _glass_appears(scene, glass):
    scenes.key(glass, "hide_render", [True, False, True])
    other = scenes.glass(shape="ROD", radius=0.01)
    other.location.x = 0.05


def _glasses_pass_one_another(scene, glass):
    other = scenes.glass(shape="ROD", radius=0.012)
    scenes.key(other, "location", [(0.02, -0.1, 0.0), (0.02, 0.1, 0.0), (0.5, 0.0, 0.0)])


def _glass_starts_to_disperse(scene, glass):
    scenes.key_input(glass, "Abbe Number", [0.0, 20.0, 0.0])


def _lens_becomes_parallel(scene, glass):
    scene.camera.data.ortho_scale = 0.2
    scenes.key(scene.camera.data, "type", ["PERSP", "ORTHO", "PERSP"])


def _captures_come_and_go(scene, glass):
    # What the mirror image shows stands behind the camera.
    scenes.key(_cube((0, 0, 0), 0.3), "location", [(0, -1, 0), (0.2, -0.8, 0.1), (0, 9, 0)])


def _world_changes(scene, glass):
    scene.world = bpy.data.worlds.new("World")
    scene.display.shading.background_type = "WORLD"
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    scenes.key(scene.world, "color", [(1, 0, 0), (0, 1, 0), (0, 0, 1)])


def _focus_is_pulled(scene, glass):
    scene.display.shading.use_dof = True
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 1.0
    dof.focus_object = bpy.data.objects.new("Focus", None)
    scene.collection.objects.link(dof.focus_object)
    scenes.key(dof.focus_object, "location", [(0, -0.04, 0), (0, 1.1, 0), (0, -0.2, 0)])


HAPPENS = (
    _eye_enters,
    _ior_crosses_one,
    _thing_appears,
    _thing_passes_before,
    _thing_enters_the_cavity,
    _glass_appears,
    _glasses_pass_one_another,
    _glass_starts_to_disperse,
    _lens_becomes_parallel,
    _captures_come_and_go,
    _world_changes,
    _focus_is_pulled,
)


def _animation(scene, folder):
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(folder / "run_####.exr")
    scene.frame_start, scene.frame_end = FRAMES[0], FRAMES[-1]
    bpy.ops.render.render(animation=True)
    return {frame: scenes.load(folder / f"run_{frame:04}.exr") for frame in FRAMES}


@pytest.mark.in_turn(4)
@pytest.mark.parametrize("happens", HAPPENS, ids=lambda f: f.__name__.strip("_"))
def test_a_frame_of_an_animation_is_the_frame_alone(tmp_path, happens):
    scene, glass = _scene()
    happens(scene, glass)
    scene.frame_set(1)
    structures = door.counters["structures"]
    run = _animation(scene, tmp_path)
    # Made once; frames only write values.
    assert door.counters["structures"] == structures + 1
    assert np.abs(run[1] - run[2]).max() > 0.02
    for frame in (3, 2):
        door.remove(scene)
        door.forget()
        scene.frame_set(frame)
        alone = scenes.picture(scene, tmp_path, f"alone{frame}")
        np.testing.assert_array_equal(run[frame], alone)


def test_a_world_of_one_colour_that_changes_is_that_of_the_frame(tmp_path):
    """In Cycles such a world is known without a view of it: it must be the evaluated one."""
    scene, _ = _scene()
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.world = bpy.data.worlds.new("World")
    node = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    for frame, value in zip(FRAMES, (0.25, 1.0, 0.5), strict=True):
        node.inputs["Strength"].default_value = value
        node.inputs["Strength"].keyframe_insert("default_value", frame=frame)
    node.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    scene.frame_set(1)
    run = _animation(scene, tmp_path)
    for frame, value in zip(FRAMES, (0.25, 1.0, 0.5), strict=True):
        np.testing.assert_allclose(run[frame][..., :3], value, rtol=0.005)


def test_the_target_of_rays_is_made_once_for_things_that_stay(tmp_path):
    scene, _ = _scene()
    scenes.key(scene.camera, "location", [(0, -0.4, 0.06), (0.01, -0.4, 0.06), (0.02, -0.4, 0.06)])
    scene.frame_set(1)
    targets = door.counters["targets"]
    _animation(scene, tmp_path)
    # One for things; meshes that are glasses have none here.
    assert door.counters["targets"] - targets <= 1 + 3
    before = door.counters["targets"]
    _animation(scene, tmp_path)
    assert door.counters["targets"] == before
