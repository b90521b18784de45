# SPDX-License-Identifier: GPL-3.0-or-later
"""Following changes: what stands after an update is what the same moment gives anew.

Whatever a user changes, an update that knows the past is compared with one that knows nothing.
"""

import tracemalloc

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.build.own_scenes import source_of
from glass_refraction.scene.read.arrays import positions, read_attribute
from glass_refraction.scene.read.viewpoint import read_viewpoint

TOLERANCE_PX = 0.25


def _scene(shape="CYLINDER", **values):
    scenes.camera()
    scenes.striped_wall(stripes=120)
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=48, ring_count=24, radius=0.02, location=(0.005, 0.12, 0.06)
    )
    ball = bpy.context.object
    glass = scenes.glass(shape=shape, **values)
    scene = scenes.settings(
        200, 150, surface="REFRACTION", shading="DISPLACED", tolerance_px=TOLERANCE_PX
    )
    return scene, ball, glass


def _follow(scene):
    """What a change leads to: structure where that changed, then an update."""
    bpy.context.view_layer.update()
    door.prepare(scene, scenes.depsgraph())
    return door.update(scene, scenes.depsgraph())


def _shown(scene):
    """(glass, path, source name) -> pixels (n, 2) of the vertices seen, in the carrier's order."""
    view = read_viewpoint(scene, scenes.depsgraph())
    found = {}
    for (glass, events, _), copy in find_layers(scene).copies().items():
        seen = copy.data.attributes.get("rg_seen")
        if seen is None or not len(seen.data):
            continue
        seen = read_attribute(seen)[:, 0] > 0.5
        found[glass, events, source_of(copy).name] = view.pixels(positions(copy.data)[seen])
    return found


def _assert_as_if_nothing_were_known(scene):
    followed = _shown(scene)
    door.forget()
    door.prepare(scene, scenes.depsgraph())
    door.update(scene, scenes.depsgraph())
    anew = _shown(scene)
    assert followed.keys() == anew.keys()
    for key, pixels in anew.items():
        np.testing.assert_array_equal(followed[key], pixels)


def _moved(scene, ball, glass):
    ball.location.x += 0.01


def _turned(scene, ball, glass):
    ball.rotation_euler = (0.3, 1.0, 0.2)
    ball.scale = (1.0, 1.5, 0.7)


def _animated(scene, ball, glass):
    ball.keyframe_insert("location", frame=1)
    ball.location.z += 0.02
    ball.keyframe_insert("location", frame=9)
    scene.frame_set(5)


def _driven(scene, ball, glass):
    ball.driver_add("location", 0).driver.expression = "0.001 * frame"
    scene.frame_set(12)


def _deformed(scene, ball, glass):
    modifier = ball.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.angle = "BEND", 1.0


def _subdivided(scene, ball, glass):
    ball.modifiers.new("Subdivision", "SUBSURF")


def _shape_key(scene, ball, glass):
    ball.shape_key_add(name="Basis")
    key = ball.shape_key_add(name="Long")
    for point in key.data:
        point.co.z *= 2.0
    key.value = 0.6


def _armature(scene, ball, glass):
    bpy.ops.object.armature_add(location=ball.location)
    rig = bpy.context.object
    group = ball.vertex_groups.new(name="Bone")
    group.add(range(len(ball.data.vertices)), 1.0, "REPLACE")
    ball.modifiers.new("Armature", "ARMATURE").object = rig
    rig.pose.bones["Bone"].location.x = 0.01


def _edited(scene, ball, glass):
    ball.data.vertices[0].co.z += 0.01
    ball.data.update()


def _replaced(scene, ball, glass):
    old = ball.data
    bpy.ops.mesh.primitive_cube_add(size=0.03)
    cube = bpy.context.object
    ball.data = cube.data
    bpy.data.objects.remove(cube)
    bpy.data.meshes.remove(old)


def _added(scene, ball, glass):
    bpy.ops.mesh.primitive_monkey_add(size=0.03, location=(-0.01, 0.15, 0.05))


def _deleted(scene, ball, glass):
    bpy.data.objects.remove(ball)


def _renamed(scene, ball, glass):
    ball.name, glass.name = "Marble", "Tumbler"


def _hidden(scene, ball, glass):
    ball.hide_render = True


def _parented(scene, ball, glass):
    ball.parent = glass
    glass.location.x = 0.01


def _instanced(scene, ball, glass):
    scene.collection.objects.unlink(ball)
    group = bpy.data.collections.new("Balls")
    group.objects.link(ball)
    empty = bpy.data.objects.new("Balls", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.location.x = -0.01
    scene.collection.objects.link(empty)


def _glass_moved(scene, ball, glass):
    glass.location.x += 0.01
    glass.rotation_euler = (0.1, 0.05, 0.3)


def _glass_animated(scene, ball, glass):
    glass.keyframe_insert("rotation_euler", frame=1)
    glass.rotation_euler.x = 0.4
    glass.keyframe_insert("rotation_euler", frame=11)
    scene.frame_set(6)


def _glass_reshaped(scene, ball, glass):
    from glass_refraction.scene.read.modifier_inputs import write_input

    write_input(glass.modifiers[0], "IOR", 1.7)
    write_input(glass.modifiers[0], "Radius", 0.05)


def _camera_moved(scene, ball, glass):
    scene.camera.location.x += 0.05
    scene.camera.data.lens = 40


def _other_camera(scene, ball, glass):
    scenes.camera(location=(0.1, -0.5, 0.1))


def _tolerance(scene, ball, glass):
    scene.refractive_glass.tolerance_px = 0.5


CHANGES = [value for name, value in list(globals().items()) if getattr(value, "__code__", None)]
CHANGES = [c for c in CHANGES if c.__code__.co_varnames[:3] == ("scene", "ball", "glass")]


@pytest.mark.in_turn(4)
@pytest.mark.parametrize("change", CHANGES, ids=lambda f: f.__name__.strip("_"))
def test_every_change_is_followed(change):
    scene, ball, glass = _scene()
    _follow(scene)
    change(scene, ball, glass)
    _follow(scene)
    _assert_as_if_nothing_were_known(scene)


def test_what_comes_into_sight_is_shown():
    scene, ball, _ = _scene()
    ball.location.x = 3.0
    _follow(scene)
    assert ball.name not in {name for _, _, name in _shown(scene)}
    ball.location.x = 0.0
    _follow(scene)
    assert ball.name in {name for _, _, name in _shown(scene)}


def test_a_still_scene_is_not_even_read():
    scene, _, _ = _scene()
    _follow(scene)
    before = dict(door.counters)
    for _ in range(3):
        door.update(scene, scenes.depsgraph())
    assert dict(door.counters) == before


def test_an_update_makes_no_data_block():
    """In a frame-change handler of a render that would crash Blender."""
    scene, ball, glass = _scene()
    bpy.context.view_layer.update()
    door.prepare(scene, scenes.depsgraph())
    kinds = [name for name in dir(bpy.data) if hasattr(getattr(bpy.data, name), "new")]
    before = {name: {b.name for b in getattr(bpy.data, name)} for name in kinds}
    for change in (_moved, _glass_moved, _camera_moved, _subdivided):
        change(scene, ball, glass)
        bpy.context.view_layer.update()
        door.update(scene, scenes.depsgraph())
        assert {name: {b.name for b in getattr(bpy.data, name)} for name in kinds} == before


def test_memory_stays_flat_over_a_long_playback():
    scene, ball, _ = _scene()
    ball.keyframe_insert("location", frame=1)
    ball.location.x += 0.02
    ball.keyframe_insert("location", frame=20)
    _follow(scene)

    def play():
        for frame in range(1, 21):
            scene.frame_set(frame)
            door.update(scene, scenes.depsgraph())

    play()
    tracemalloc.start()
    try:
        play()
        first = tracemalloc.get_traced_memory()[0]
        for _ in range(2):
            play()
        # An array of the ball's vertices kept from every frame would be 1.1 MB; Python's and
        # NumPy's own lists of free blocks take some hundred bytes a frame.
        assert tracemalloc.get_traced_memory()[0] < first + 400_000
    finally:
        tracemalloc.stop()


def test_the_picture_after_updates_is_that_of_a_scene_that_was_never_updated(tmp_path):
    scene, ball, _ = _scene()
    scene.render.engine = "BLENDER_WORKBENCH"
    _follow(scene)
    for _ in range(3):
        ball.location.x += 0.004
        _follow(scene)
    after = scenes.picture(scene, tmp_path, "after")
    door.forget()
    alone = scenes.picture(scene, tmp_path, "alone")
    np.testing.assert_array_equal(after, alone)
