# SPDX-License-Identifier: GPL-3.0-or-later
"""What a displaced copy keeps of its source."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.read.arrays import corner_normals
from glass_refraction.scene.read.modifier_inputs import read_input
from glass_refraction.scene.vertices import tessellation


def _ball(shading):
    """A round source behind the glass: smooth, flat, or flat with a smooth half."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.03, location=(0, 0.15, 0.06))
    ball = bpy.context.object
    ball.rotation_euler = (0.3, 0.4, 0.5)
    smooth = np.full(len(ball.data.polygons), shading == "SMOOTH")
    if shading == "MIXED":
        smooth[::2] = True
    ball.data.polygons.foreach_set("use_smooth", smooth)
    ball.data.update()
    bpy.context.view_layer.update()
    return ball


@pytest.mark.parametrize("shading, domain", [("SMOOTH", 2), ("FLAT", 3), ("MIXED", 1)])
def test_a_shaded_copy_keeps_the_sources_normals(shading, domain):
    scenes.camera()
    ball = _ball(shading)
    scenes.glass(shape="CYLINDER", radius=0.05)
    # Coarse enough that the source's own faces are drawn, not parts of them.
    scene = scenes.settings(surface="REFRACTION", shading="DISPLACED", tolerance_px=8.0)
    assert bpy.ops.scene.refractive_glass_update() == {"FINISHED"}
    layers = find_layers(scene)
    copy = next(copy for (_, slot, _), copy in layers.copies().items() if slot == 0)
    shape = next(shape for _, _, shape in door.memory_of(scene).copies.values())
    assert not shape.refined
    # Else faces at the fold are dropped, and corners no longer match one to one.
    assert shape.images.valid.all()
    layer = next(v for v in layers.displaced.view_layers if copy.name in v.objects)
    layer.update()
    shown = copy.evaluated_get(layer.depsgraph)
    assert read_input(copy.modifiers[0], "Normals") == domain
    turned = np.array(ball.matrix_world)[:3, :3]
    expected = corner_normals(ball.data) @ turned.T
    np.testing.assert_allclose(corner_normals(shown.data), expected, atol=2e-3)


def test_a_source_whose_refinement_stops_before_any_vertex_is_seen_shows_nothing(monkeypatch):
    scenes.camera()
    # Of this wall the middle of its diagonal is seen, and no vertex.
    bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 0.5, 0.06), rotation=(np.pi / 2, 0, 0))
    scenes.glass(shape="CYLINDER", radius=0.05)
    scene = scenes.settings(surface="REFRACTION", shading="DISPLACED")
    assert bpy.ops.scene.refractive_glass_update() == {"FINISHED"}
    drawn = [shape.vertices for _, _, shape in door.memory_of(scene).copies.values()]
    assert max(drawn) > 0
    door.memory_of(scene).copies.clear()
    monkeypatch.setattr(tessellation, "PER_PIXEL", 0)
    assert bpy.ops.scene.refractive_glass_update() == {"FINISHED"}
    drawn = [shape.vertices for _, _, shape in door.memory_of(scene).copies.values()]
    assert drawn and max(drawn) == 0
