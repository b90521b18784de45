# SPDX-License-Identifier: GPL-3.0-or-later
"""What a 3D view reads of its scene."""

import bpy

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
