# SPDX-License-Identifier: GPL-3.0-or-later
"""The starter scene: whole, its own, and nothing of the user's is touched."""

import bpy

from glass_refraction.scene import update as door
from glass_refraction.scene.read.glasses import glass_objects


def test_it_is_a_scene_of_its_own_with_a_glass_that_can_be_rendered():
    user = bpy.context.scene
    before = {obj.name: tuple(obj.location) for obj in user.objects}
    assert bpy.ops.scene.refractive_glass_starter() == {"FINISHED"}
    scene = bpy.context.window.scene
    assert scene != user
    assert {obj.name: tuple(obj.location) for obj in user.objects} == before
    assert [o.name for o in glass_objects(scene.view_layers[0])] == ["Glass of Water"]
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.use_world_space_lighting = True
    scene.render.resolution_x, scene.render.resolution_y = 80, 60
    bpy.ops.render.render(scene=scene.name)
    status = door.status(scene)
    assert not status.problems
    assert status.covered > 300
    bpy.context.window.scene = user


def test_the_straw_stands_in_the_water_and_in_no_glass():
    bpy.ops.scene.refractive_glass_starter()
    scene = bpy.context.window.scene
    bpy.context.view_layer.update()
    straw = next(o for o in scene.objects if o.name.startswith("Straw"))
    places = [straw.matrix_world @ v.co for v in straw.data.vertices]
    # The tumbler's inside: radius 36 mm above a base of 6 mm; water up to 65 mm above that.
    assert min(p.z for p in places) > 0.006
    assert min(p.z for p in places) < 0.02
    inside = [p for p in places if p.z < 0.1]
    assert inside and max(p.xy.length for p in inside) < 0.036
    assert max(p.z for p in places) > 0.12
