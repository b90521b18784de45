# SPDX-License-Identifier: GPL-3.0-or-later
"""A glass's faces of materials that are no glass, such as a label: seen as what they are."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.reference.cycles import render_reference, rendering_direct
from glass_refraction.reference.interfaces import Shell
from glass_refraction.reference.picture import finished
from glass_refraction.scene import material_link
from glass_refraction.scene import update as door
from glass_refraction.scene.rays.stage import placed_glasses
from glass_refraction.scene.read.glasses import read_glass
from glass_refraction.scene.read.glassy_materials import OPAQUE
from glass_refraction.scene.read.mesh_corners import triangles_of
from glass_refraction.scene.read.modifier_inputs import glass_modifier, read_input, write_input
from glass_refraction.scene.read.unread import unread
from glass_refraction.viewport.model import Model
from glass_refraction.viewport.news import News

SIZE = {"width": 80, "height": 60, "samples": 16, "shading": "TRUE", "surface": "GLASS"}
LABEL = (1.0, 0.5, 1.0)


def _material(kind, colour, **values):
    material = bpy.data.materials.new(kind)
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(f"ShaderNode{kind}")
    shader.inputs["Color"].default_value = (*colour, 1.0)
    for name, value in values.items():
        shader.inputs[name].default_value = value
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    return material


def _labelled(*, behind=False, location=(0.0, 0.0, 0.08)):
    """A ball of glass with a label of light: a patch before its middle, or behind it."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.04, location=location, segments=48, ring_count=24)
    bpy.ops.object.shade_smooth()
    ball = bpy.context.object
    ball.data.materials.append(_material("BsdfGlass", (1.0, 1.0, 1.0), Roughness=0.0))
    ball.data.materials.append(_material("Emission", LABEL))
    side = 1.0 if behind else -1.0
    for face in ball.data.polygons:
        x, y, z = face.center
        face.material_index = int(side * y > 0.0 and abs(x) < 0.022 and abs(z) < 0.022)
    return ball


def _glass(obj):
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    return obj


def _is_label(picture):
    return np.abs(picture[..., :3] - LABEL).max(axis=2) < 0.15


def _hidden(obj, scene):
    """The glass as a render evaluates it."""
    door.prepare(scene, scenes.depsgraph())
    bpy.context.view_layer.update()
    assert not read_input(glass_modifier(obj), "Show in Render")
    found = []

    def look(_scene, depsgraph):
        found.append(read_glass(obj, depsgraph).description)

    bpy.app.handlers.frame_change_post.append(look)
    try:
        bpy.ops.render.render()
    finally:
        bpy.app.handlers.frame_change_post.remove(look)
    return found[-1]


@pytest.mark.parametrize("behind", [False, True])
def test_a_label_is_seen_as_in_cycles(tmp_path, behind):
    """The faces of all materials were glass."""
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _glass(_labelled(behind=behind))
    found = scenes.picture(scene, tmp_path)
    assert door.status(scene).problems == []
    wanted = render_reference(scene, samples=256)
    off = np.abs(found - wanted)[..., :3].max(axis=2)
    assert np.quantile(off, 0.97) < 0.05
    seen, there = _is_label(found), _is_label(wanted)
    assert there.sum() > 60
    assert (seen != there).sum() < 0.15 * there.sum()
    # Without it there is none.
    write_input(glass_modifier(obj), OPAQUE, 0)
    for slot in obj.material_slots:
        slot.material = obj.material_slots[0].material
    assert not _is_label(scenes.picture(scene, tmp_path, "all_glass")).any()


def test_glass_beside_a_label_keeps_its_normals(tmp_path):
    """Apart from its neighbours a smooth face would be flat, and refract as a facet does."""
    scenes.camera()
    scene = scenes.settings(24, 18, samples=1, shading="TRUE", surface="GLASS")
    obj = _glass(_labelled(location=(0.0, 0.0, 0.0)))
    bits = 0b10
    wanted = np.concatenate(triangles_of(obj.data, bits), axis=2)
    glass = _hidden(obj, scene)
    assert read_input(glass_modifier(obj), OPAQUE) == bits
    found = np.concatenate((glass.points, glass.normals), axis=2)
    assert found.shape == wanted.shape
    assert len(found) < len(triangles_of(obj.data)[0])
    one, other = (np.unique(x.reshape(-1, 6).round(4) + 0.0, axis=0) for x in (found, wanted))
    apart = np.abs(one[:, None] - other).max(axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 5e-4


def test_the_modifier_follows_the_materials():
    obj = _glass(_labelled())
    modifier = glass_modifier(obj)
    material_link.tell_modifier(obj)
    assert read_input(modifier, OPAQUE) == 0b10
    glass, label = (slot.material for slot in obj.material_slots)
    obj.material_slots[0].material, obj.material_slots[1].material = label, glass
    material_link.tell_modifier(obj)
    assert read_input(modifier, OPAQUE) == 0b01
    obj.material_slots[1].material = label
    # No material of it is a glass, so all of it is.
    material_link.tell_modifier(obj)
    assert read_input(modifier, OPAQUE) == 0
    obj.material_slots[0].material = glass
    material_link.tell_modifier(obj)
    assert read_input(modifier, OPAQUE) == 0b10
    write_input(modifier, "Shape", "Sphere")
    material_link.tell_modifier(obj)
    assert read_input(modifier, OPAQUE) == 0


def test_an_edit_tells_the_modifier():
    obj = _glass(_labelled())
    bpy.context.view_layer.update()
    assert read_input(glass_modifier(obj), OPAQUE) == 0b10
    obj.material_slots[1].material = obj.material_slots[0].material
    bpy.context.view_layer.update()
    assert read_input(glass_modifier(obj), OPAQUE) == 0


def test_a_label_that_is_linked_to_the_object_is_told():
    scenes.camera()
    scene = scenes.settings(**SIZE)
    obj = _glass(_labelled())
    slot = obj.material_slots[1]
    label = slot.material
    slot.link = "OBJECT"
    slot.material = label
    door.prepare(scene, scenes.depsgraph())
    assert read_input(glass_modifier(obj), OPAQUE) == 0
    (line,) = unread(obj, 0)
    assert label.name in line and "link these materials to Data" in line
    assert line in door.status(scene).problems


def test_faces_of_another_glass_are_told():
    obj = _glass(_labelled())
    water = _material("BsdfGlass", (1.0, 1.0, 1.0), IOR=1.33)
    obj.material_slots[1].material = water
    (line,) = unread(obj, 0)
    assert obj.material_slots[0].material.name in line and "P > By Material" in line
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.separate(type="MATERIAL")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    found = [read_glass(o, scenes.depsgraph()) for o in bpy.data.objects if o.type == "MESH"]
    assert sorted(g.description.ior for g in found) == pytest.approx([1.33, 1.5])
    assert not any(unread(o, 0) for o in bpy.data.objects if o.type == "MESH")


def test_instances_have_their_labels(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _glass(_labelled(location=(0.0, 0.0, 0.0)))
    collection = bpy.data.collections.new("Glasses")
    scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location = (0.0, 0.0, 0.08)
    scene.collection.objects.link(empty)
    instanced = scenes.picture(scene, tmp_path, "instanced")
    assert _is_label(instanced).sum() > 60
    bpy.data.objects.remove(empty)
    real = obj.copy()
    real.location = (0.0, 0.0, 0.08)
    scene.collection.objects.link(real)
    np.testing.assert_allclose(instanced, scenes.picture(scene, tmp_path, "real"), atol=2e-3)


def test_a_label_is_seen_through_its_own_glass_whatever_else_is(tmp_path):
    scenes.camera()
    wall = scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _glass(_labelled(behind=True))
    with_all = scenes.picture(scene, tmp_path, "all")
    collection = bpy.data.collections.new("Seen")
    scene.collection.children.link(collection)
    collection.objects.link(wall)
    write_input(glass_modifier(obj), "Seen Through", collection)
    chosen = scenes.picture(scene, tmp_path, "chosen")
    assert _is_label(with_all).sum() > 60
    assert (_is_label(with_all) != _is_label(chosen)).sum() < 3


def test_the_picture_without_glass_has_its_label(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _glass(_labelled())
    shown = scenes.picture(scene, tmp_path)
    direct = finished(rendering_direct(scene))
    assert _is_label(direct).sum() > 60
    assert (_is_label(direct) != _is_label(shown)).sum() < 20
    assert not read_input(glass_modifier(obj), "Show in Render")


def test_the_live_view_has_a_label_among_its_things():
    scenes.camera()
    obj = _glass(_labelled())
    material_link.tell_modifier(obj)
    bpy.context.view_layer.update()
    model = Model()
    space = None
    model.read(bpy.context.view_layer, space, News(), True)
    assert len(model.boxes) == 1
    write_input(glass_modifier(obj), OPAQUE, 0)
    model.read(bpy.context.view_layer, space, News(), True)
    assert model.boxes == []


def test_what_is_behind_a_label_is_within_the_glass():
    """The reference cuts overlapping glasses along each other: a label was a hole in its glass."""
    scenes.camera()
    obj = _glass(_labelled(location=(0.0, 0.0, 0.0)))
    bpy.context.view_layer.update()
    glass = read_glass(obj, scenes.depsgraph())
    assert len(glass.description.opaque) > 10
    (placed,) = placed_glasses([glass])
    label = glass.description.opaque.mean(axis=1)
    found = [Shell(glass, placed).medium_at(label * part) for part in (0.95, 1.02)]
    assert found[0].all() and not found[1].any()
