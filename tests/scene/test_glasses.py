# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass objects read as optics descriptions."""

import math

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector

from glass_refraction import optics
from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.glasses import read_glass, read_glasses, rigid_pose
from glass_refraction.scene.read.modifier_inputs import (
    data_path,
    glass_modifier,
    has_input,
    read_input,
    write_input,
)


def _read(obj):
    return read_glass(obj, scenes.depsgraph())


def test_operator_values_reach_the_description():
    obj = scenes.glass(
        shape="CYLINDER",
        radius=0.05,
        wall_thickness=0.004,
        height=0.2,
        ior=1.52,
        contents_ior=1.333,
    )
    found = _read(obj).description
    assert isinstance(found, optics.CylinderGlass)
    np.testing.assert_allclose(found.radius, (0.05, 0.046), rtol=1e-6)
    np.testing.assert_allclose(found.ior, (1.52, 1.333), rtol=1e-6)
    np.testing.assert_allclose(found.extent, (0.0, 0.2), rtol=1e-6)


@pytest.mark.parametrize(
    ("shape", "kind", "layers"),
    [("ROD", optics.CylinderGlass, 1), ("SPHERE", optics.SphereGlass, 2)],
)
def test_other_shapes(shape, kind, layers):
    found = _read(scenes.glass(shape=shape)).description
    assert isinstance(found, kind)
    assert len(found.radius) == layers


def test_sphere_without_wall_is_a_ball():
    assert len(_read(scenes.glass(shape="SPHERE", wall_thickness=0.0)).description.radius) == 1


def test_uniform_scale_and_pose_are_taken_apart():
    obj = scenes.glass(shape="CYLINDER")
    obj.location, obj.rotation_euler, obj.scale = (1.0, 2.0, 3.0), (0.3, -0.8, 2.0), (2.5,) * 3
    bpy.context.view_layer.update()
    found = _read(obj)
    np.testing.assert_allclose(found.description.radius, (0.1, 0.0925), rtol=1e-6)
    rotation = found.to_world[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-14)
    local = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(found.to_local(found.points_to_world(local)), local, atol=1e-14)


def test_slab_frame_has_the_upper_face_at_zero_and_glass_below():
    obj = scenes.glass(shape="SLAB", radius=0.2, wall_thickness=0.01)
    obj.rotation_euler = (0.4, 0.9, -0.3)
    bpy.context.view_layer.update()
    found = _read(obj)
    assert found.description.thickness == pytest.approx((0.01,))
    normal = np.array(obj.matrix_world.to_3x3().col[2])
    np.testing.assert_allclose(found.to_world[:3, 2], normal, atol=1e-6)
    corners = np.column_stack((found.description.outline, np.zeros(4)))
    expected = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
    gaps = np.linalg.norm(found.points_to_world(corners)[:, None] - expected, axis=2)
    assert gaps.min(axis=0).max() < 1e-6
    assert sorted(gaps.argmin(axis=0)) == [0, 1, 2, 3]


def test_star_outline_keeps_its_order_and_area():
    turn = np.pi * np.arange(10) / 5
    radius = np.where(np.arange(10) % 2, 0.05, 0.12)
    points = np.stack((radius * np.cos(turn), radius * np.sin(turn), np.full(10, 0.03)), axis=1)
    mesh = bpy.data.meshes.new("Star")
    mesh.from_pydata(points.tolist(), [], [tuple(range(10))])
    star = bpy.data.objects.new("Star", mesh)
    bpy.context.scene.collection.objects.link(star)
    bpy.context.view_layer.objects.active = star
    bpy.ops.object.refractive_glass_modifier_add(shape="SLAB", wall_thickness=0.02)
    outline = np.array(_read(star).description.outline)
    x, y = outline.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert abs(area) == pytest.approx(mesh.polygons[0].area, rel=1e-5)


def test_animated_input_is_read_as_evaluated():
    obj = scenes.glass(shape="CYLINDER", radius=0.04)
    modifier = glass_modifier(obj)
    path = data_path(modifier, "Radius")
    obj.keyframe_insert(path, frame=1)
    write_input(modifier, "Radius", 0.08)
    obj.keyframe_insert(path, frame=11)
    bpy.context.scene.frame_set(11)
    assert _read(obj).description.radius[0] == pytest.approx(0.08)
    bpy.context.scene.frame_set(1)
    assert _read(obj).description.radius[0] == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("socket", "value", "word"),
    [
        ("IOR", 0.0, "ior"),
        ("IOR", -1.5, "ior"),
        ("IOR", math.nan, "ior"),
        ("Contents IOR", 0.0, "ior"),
        ("Wall Thickness", 0.04, "wall"),
        ("Wall Thickness", 0.0, "wall"),
        ("Height", 0.0, "height"),
    ],
)
def test_impossible_glass_names_object_and_field(socket, value, word):
    obj = scenes.glass(shape="CYLINDER")
    obj.name = "My Cup"
    write_input(glass_modifier(obj), socket, value)
    with pytest.raises(RefractiveGlassError, match="My Cup") as error:
        _read(obj)
    assert word in str(error.value).lower()


@pytest.mark.parametrize("scale", [(-2.0, 2.0, 2.0), (2.0, 2.0, -2.0), (-2.0, -2.0, -2.0)])
def test_a_mirrored_glass_with_an_axis_is_where_its_points_are(scale):
    obj = scenes.glass(shape="CYLINDER", radius=0.04, height=0.1)
    obj.scale, obj.rotation_euler, obj.location = scale, (0.3, 0.4, 0.5), (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    found = _read(obj)
    assert np.linalg.det(found.to_world[:3, :3]) == pytest.approx(1.0)
    assert found.description.radius[0] == pytest.approx(0.08)
    # As the object has them: its axis stays where it is.
    for z in (0.0, 0.1):
        there = obj.matrix_world @ Vector((0.0, 0.0, z))
        np.testing.assert_allclose(found.to_world @ (0, 0, 2 * z, 1), (*there, 1), atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "scale"),
    [
        ("CYLINDER", (1.0, 1.0, 2.0)),
        ("CYLINDER", (-1.0, 1.0, 2.0)),
        ("SLAB", (-1.0, 1.0, 1.0)),
        ("CYLINDER", (0.0, 0.0, 0.0)),
    ],
)
def test_uneven_scale_and_a_mirrored_slab_are_refused(shape, scale):
    obj = scenes.glass(shape=shape)
    obj.scale = scale
    bpy.context.view_layer.update()
    with pytest.raises(RefractiveGlassError, match="scale"):
        _read(obj)


def test_shear_is_refused():
    matrix = np.eye(4)
    matrix[0, 1] = 0.1
    with pytest.raises(RefractiveGlassError, match="sheared"):
        rigid_pose(matrix, "Pane")


@pytest.mark.parametrize("name", ["two faces apart", "bent", "no face"])
def test_slab_needs_one_flat_outline(name):
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    vertices, faces = square, [(0, 1, 2, 3)]
    if name == "two faces apart":
        vertices = square + [(x + 3, y, z) for x, y, z in square]
        faces = [(0, 1, 2, 3), (4, 5, 6, 7)]
    elif name == "bent":
        vertices = [*square[:3], (0, 1, 0.5)]
    else:
        faces = []
    obj = scenes.glass(shape="SLAB")
    obj.name = "Bad"
    obj.data.clear_geometry()
    obj.data.from_pydata(vertices, [], faces)
    with pytest.raises(RefractiveGlassError, match="Bad"):
        _read(obj)


def test_one_bad_glass_does_not_hide_the_others():
    good, bad = scenes.glass(shape="CYLINDER"), scenes.glass(shape="CYLINDER")
    write_input(glass_modifier(bad), "IOR", -1.0)
    problems = []
    assert [g.name for g in read_glasses(scenes.depsgraph(), problems)] == [good.name]
    assert len(problems) == 1
    with pytest.raises(RefractiveGlassError):
        read_glasses(scenes.depsgraph())


def test_menu_input_by_name():
    modifier = glass_modifier(scenes.glass(shape="ROD"))
    assert read_input(modifier, "Shape") == "Rod"
    write_input(modifier, "Shape", "Sphere")
    assert read_input(modifier, "Shape") == "Sphere"


@pytest.mark.parametrize("shape", ["SLAB", "CYLINDER", "ROD", "SPHERE"])
def test_the_modifiers_mesh_is_closed_and_has_the_volume(shape):
    import bmesh

    obj = scenes.glass(shape=shape, radius=0.04, wall_thickness=0.01, height=0.12)
    evaluated = obj.evaluated_get(scenes.depsgraph())
    solid = bmesh.new()
    solid.from_mesh(evaluated.data)
    assert all(edge.is_manifold for edge in solid.edges)
    expected = {
        "SLAB": 0.08**2 * 0.01,
        "CYLINDER": np.pi * (0.04**2 - 0.03**2) * 0.12,
        "ROD": np.pi * 0.04**2 * 0.12,
        "SPHERE": 4 / 3 * np.pi * (0.04**3 - 0.03**3),
    }[shape]
    # An inscribed mesh of 128 segments misses at most 0.1 %; turned inside out it is negative.
    assert solid.calc_volume(signed=True) == pytest.approx(expected, rel=2e-3)
    solid.free()


def test_inputs_are_read_where_they_are_now():
    modifier = glass_modifier(scenes.glass(shape="CYLINDER", ior=1.41))
    group = modifier.node_group.copy()
    modifier.node_group = group
    assert read_input(modifier, "IOR") == pytest.approx(1.41)
    items = group.interface
    for name in ("IOR", "Radius", "Height"):
        before = read_input(modifier, name)
        items.move(next(i for i in items.items_tree if i.name == name), 0)
        assert read_input(modifier, name) == before
    items.remove(next(i for i in items.items_tree if i.name == "Radius"))
    assert not has_input(modifier, "Radius")
    with pytest.raises(KeyError, match="Radius"):
        read_input(modifier, "Radius")
    assert read_input(modifier, "IOR") == pytest.approx(1.41)
