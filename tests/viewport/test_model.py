# SPDX-License-Identifier: GPL-3.0-or-later
"""What a 3D view reads of its scene."""

import bpy
import numpy as np
from mathutils import Euler, Matrix

from glass_refraction.viewport.model import Model
from glass_refraction.viewport.news import News


def test_a_profile_may_stand_nowhere_in_a_rays_way():
    """The curve of a vase was taken for a thing: none saw the world beside its things."""
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.0, 0.3, 0.0))
    bpy.ops.object.refractive_glass_everyday_add(kind="VASE")
    areas = (a for screen in bpy.data.screens for a in screen.areas if a.type == "VIEW_3D")
    layer = bpy.context.view_layer
    layer.update()
    model = Model()
    model.read(layer, next(areas).spaces.active, News(), anew=True)
    assert len(model.lines) == 2
    assert len(model._all_boxes()) == 1


def _instances_of(obj, matrices):
    """An object that shows another by instances."""
    for matrix in matrices:
        empty = bpy.data.objects.new("Instance", None)
        collection = bpy.data.collections.get("Instanced") or bpy.data.collections.new("Instanced")
        if obj.name not in collection.objects:
            collection.objects.link(obj)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        bpy.context.scene.collection.objects.link(empty)
        empty.matrix_world = matrix


def test_instances_of_other_sizes_share_what_is_made_of_their_mesh():
    """Also where the glass itself stands in the view layer: each drop took half a second."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.0, 0.0, 0.0))
    glass = bpy.context.object
    glass.data.vertices[0].co *= 1.5
    bpy.ops.object.refractive_glass_modifier_add()
    places = [
        Matrix.LocRotScale((x, 0.1, 0.0), Euler((x, 0.3, 0.0)), (s, s, s))
        for x, s in ((0.5, 0.3), (1.0, 1.7), (1.5, 4.0))
    ]
    _instances_of(glass, places)
    areas = (a for screen in bpy.data.screens for a in screen.areas if a.type == "VIEW_3D")
    layer, space = bpy.context.view_layer, next(areas).spaces.active
    layer.update()
    model, news = Model(), News()
    model.read(layer, space, news, anew=True)
    assert len(model.meshes._growing) == 1
    while model.meshes.waits:
        model.meshes.grow(1.0)
        model.read(layer, space, news, anew=True)
    assert len(model.glasses) == 4
    assert len({id(posed.body.tree) for posed in model.glasses}) == 1
    corners = np.array([v.co for v in glass.data.vertices])
    found = sorted(model.glasses, key=lambda posed: posed.to_world[0, 3])
    for posed, matrix in zip(found, (Matrix(), *places), strict=True):
        world = corners @ np.array(matrix.to_3x3()).T + np.array(matrix.translation)
        local = (world - posed.to_world[:3, 3]) @ posed.to_world[:3, :3]
        box = np.array((local.min(axis=0), local.max(axis=0)))
        np.testing.assert_allclose(box, posed.body.box, atol=1e-6)
