# SPDX-License-Identifier: GPL-3.0-or-later
"""Which way faces look: what is told of a mesh, and what the operator mends."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene.read.orientation import (
    Orientation,
    orientation_of,
    turn_all,
    turn_outwards,
)

RIGHT = Orientation(0, 0)


def _ball(radius=1.0):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, segments=16, ring_count=8)
    return bpy.context.object


def _flip(mesh, *faces):
    for face in faces:
        mesh.polygons[face].flip()
    mesh.update()


def _hollow():
    """A ball with a cavity, whose faces look into it."""
    inner = _ball(0.5)
    turn_all(inner.data)
    outer = _ball()
    inner.select_set(True)
    bpy.ops.object.join()
    return outer


@pytest.mark.parametrize("make", [_ball, _hollow])
def test_a_right_mesh_stays_as_it_is(make):
    mesh = make().data
    assert orientation_of(mesh) == RIGHT
    assert turn_outwards(mesh) == 0


def test_open_meshes_are_not_told_to_be_inside_out():
    bpy.ops.mesh.primitive_plane_add()
    mesh = bpy.context.object.data
    turn_all(mesh)
    assert orientation_of(mesh) == RIGHT


def test_a_mesh_inside_out_is_turned():
    mesh = _ball().data
    turn_all(mesh)
    assert orientation_of(mesh) == Orientation(0, 1)
    assert turn_outwards(mesh) == len(mesh.polygons)
    assert orientation_of(mesh) == RIGHT


@pytest.mark.parametrize("make", [_ball, _hollow])
def test_faces_turned_against_their_neighbours_are_turned_back(make):
    mesh = make().data
    before = np.array([face.normal for face in mesh.polygons])
    # Two faces of four corners far apart; of the hollow ball one within and one without.
    squares = [face for face in mesh.polygons if len(face.vertices) == 4]
    order = sorted(squares, key=lambda face: (round(face.center.length, 2), face.center.x))
    _flip(mesh, order[0].index, order[-1].index)
    assert orientation_of(mesh).edges == 8
    assert turn_outwards(mesh) == 2
    assert orientation_of(mesh) == RIGHT
    np.testing.assert_allclose([face.normal for face in mesh.polygons], before, atol=1e-6)


def test_the_operator_mends_a_glass_and_says_so():
    obj = _ball(0.04)
    turn_all(obj.data)
    _flip(obj.data, 5)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    assert bpy.ops.object.refractive_glass_turn_normals() == {"FINISHED"}
    assert orientation_of(obj.data) == RIGHT
    assert obj.modifiers[-1].show_viewport


def test_faces_that_a_screw_modifier_makes_are_turned_there():
    mesh = bpy.data.meshes.new("Line")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], [(0, 1), (1, 2), (2, 3)], [])
    obj = bpy.data.objects.new("Screwed", mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    screw = obj.modifiers.new("Screw", "SCREW")
    screw.use_merge_vertices = True

    def found():
        return orientation_of(obj.evaluated_get(scenes.depsgraph()).data)

    screw.use_normal_flip = found() == RIGHT
    bpy.context.view_layer.update()
    assert found() == Orientation(0, 1)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    assert bpy.ops.object.refractive_glass_turn_normals() == {"FINISHED"}
    obj.modifiers.remove(obj.modifiers[-1])
    bpy.context.view_layer.update()
    assert found() == RIGHT
