# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh's own material and its modifier: change the ior of one, the other follows."""

import bpy
import pytest
import scenes

from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene import material_link
from glass_refraction.scene.read.glasses import read_glass
from glass_refraction.scene.read.modifier_inputs import (
    data_path,
    glass_modifier,
    read_input,
    write_input,
)


def _material(name="Own", ior=1.7, kind="ShaderNodeBsdfGlass"):
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(kind)
    shader.inputs["IOR"].default_value = ior
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    return material, shader.inputs["IOR"]


def _glass(*materials):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.04)
    obj = bpy.context.object
    for material in materials:
        obj.data.materials.append(material)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    bpy.context.view_layer.update()
    return obj


def _ior(obj):
    return read_input(glass_modifier(obj), "IOR")


def _write(obj, value):
    write_input(glass_modifier(obj), "IOR", value)
    bpy.context.view_layer.update()


@pytest.mark.parametrize("kind", ["Glass", "Refraction"])
def test_each_follows_the_other(kind):
    material, socket = _material(kind=f"ShaderNodeBsdf{kind}")
    obj = _glass(material)
    assert _ior(obj) == pytest.approx(1.7)
    _write(obj, 1.4)
    assert socket.default_value == pytest.approx(1.4)
    socket.default_value = 2.0
    bpy.context.view_layer.update()
    assert _ior(obj) == pytest.approx(2.0)
    assert read_glass(obj, scenes.depsgraph()).description.ior == pytest.approx(2.0)


@pytest.mark.parametrize("has_material", [False, True])
def test_a_reference_of_colours_changes_no_ior(has_material):
    """It lends the mesh a material for each colour, which the modifier once followed."""
    scenes.camera()
    obj = _glass(*([_material()[0]] if has_material else []))
    write_input(glass_modifier(obj), "Abbe Number", 20.0)
    bpy.context.view_layer.update()
    before = _ior(obj)
    render_reference(scenes.settings(16, 12, samples=1))
    bpy.context.view_layer.update()
    assert _ior(obj) == before


def test_the_medium_by_name_is_the_materials_too():
    material, socket = _material()
    obj = _glass(material)
    obj.refractive_glass_medium = "DIAMOND"
    bpy.context.view_layer.update()
    assert socket.default_value == pytest.approx(_ior(obj)) != pytest.approx(1.7)


def test_glasses_of_one_material_follow_each_other():
    material, _ = _material()
    one, other = _glass(material), _glass(material)
    _write(one, 1.3)
    bpy.context.view_layer.update()
    assert _ior(other) == pytest.approx(1.3)


def test_a_file_is_left_as_it_is_until_something_is_changed():
    material, socket = _material()
    obj = _glass(material)
    material_link.remember()
    write_input(glass_modifier(obj), "IOR", 1.5)
    material_link.remember()
    obj.location.x = 1.0
    bpy.context.view_layer.update()
    assert (_ior(obj), socket.default_value) == pytest.approx((1.5, 1.7))
    socket.default_value = 1.8
    bpy.context.view_layer.update()
    assert _ior(obj) == pytest.approx(1.8)


def test_what_is_animated_is_not_written():
    material, socket = _material()
    obj = _glass(material)
    socket.keyframe_insert("default_value", frame=1)
    _write(obj, 1.4)
    assert socket.default_value == pytest.approx(1.7)
    other_material, other = _material("Other")
    second = _glass(other_material)
    second.keyframe_insert(data_path(glass_modifier(second), "IOR"), frame=1)
    other.default_value = 1.9
    bpy.context.view_layer.update()
    assert _ior(second) == pytest.approx(1.7)


def test_the_first_of_several_glassy_materials_counts():
    (one, socket), (two, other) = _material("One", 1.6), _material("Two", 1.9)
    obj = _glass(one, two)
    assert read_glass(obj, scenes.depsgraph()).description.ior == pytest.approx(1.6)
    _write(obj, 1.45)
    assert (socket.default_value, other.default_value) == pytest.approx((1.45, 1.9))
