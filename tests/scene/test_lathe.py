# SPDX-License-Identifier: GPL-3.0-or-later
"""Turned meshes: their profiles, and that a glass of revolution of one is the same body."""

from itertools import pairwise

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene.read.glasses import read_glass
from glass_refraction.scene.read.lathe import lathe_of
from glass_refraction.scene.read.modifier_inputs import glass_modifier, read_input

CUP = ((0, 0), (0.03, 0), (0.035, 0.1), (0.032, 0.1), (0.027, 0.006), (0, 0.006))
"""Radius and height, metres: up the outside, over the rim, down the inside."""


def _screwed(points=CUP, **settings):
    """An object whose mesh is a line that a Screw modifier turns about the z axis."""
    mesh = bpy.data.meshes.new("Profile")
    mesh.from_pydata(
        [(r, 0, z) for r, z in points], [(k, k + 1) for k in range(len(points) - 1)], []
    )
    obj = bpy.data.objects.new("Cup", mesh)
    bpy.context.scene.collection.objects.link(obj)
    modifier = obj.modifiers.new("Screw", "SCREW")
    modifier.steps = modifier.render_steps = 64
    for name, value in settings.items():
        setattr(modifier, name, value)
    bpy.context.view_layer.objects.active = obj
    return obj


def _lathe(obj):
    return lathe_of(obj.evaluated_get(scenes.depsgraph()).data)


@pytest.mark.parametrize("merged", [False, True])
def test_a_screwed_profile_is_found(merged):
    found = _lathe(_screwed(use_merge_vertices=merged))
    np.testing.assert_allclose(found.outer, CUP[:3], atol=1e-7)
    np.testing.assert_allclose(found.inner, CUP[:2:-1], atol=1e-7)


def test_a_spun_mesh_is_found():
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.05)
    found = _lathe(bpy.context.object)
    assert found.inner is None
    np.testing.assert_allclose(np.linalg.norm(found.outer, axis=1), 0.05, atol=1e-7)
    assert found.outer[0] == pytest.approx((0.0, -0.05))
    assert found.outer[-1] == pytest.approx((0.0, 0.05))


def test_subdivision_and_solidify_of_a_screwed_line_are_found():
    obj = _screwed(((0, 0), (0.03, 0), (0.035, 0.1)), use_merge_vertices=True)
    assert _lathe(obj) is None
    obj.modifiers.new("Solidify", "SOLIDIFY").thickness = 0.003
    obj.modifiers.new("Subdivision", "SUBSURF").levels = 2
    found = _lathe(obj)
    assert found.inner is not None
    assert len(found.outer) > 6


@pytest.mark.parametrize("kind", ["torus", "cube", "monkey", "ico_sphere"])
def test_other_meshes_are_not(kind):
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")()
    assert _lathe(bpy.context.object) is None


def test_a_handle_is_no_part_of_a_turned_body():
    obj = _screwed()
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.ops.object.convert(target="MESH")
    assert _lathe(bpy.context.object) is not None
    bpy.ops.mesh.primitive_torus_add(
        major_radius=0.02, minor_radius=0.004, location=(0.04, 0, 0.05)
    )
    bpy.context.object.select_set(True)
    obj = bpy.data.objects["Cup"]
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.join()
    assert _lathe(bpy.context.object) is None


def test_making_it_a_glass_offers_revolution_with_its_profile():
    obj = _screwed()
    assert bpy.ops.object.refractive_glass_modifier_add() == {"FINISHED"}
    assert read_input(glass_modifier(obj), "Shape") == "Mesh"
    operator = bpy.context.window_manager.operators
    assert not operator or operator[-1].is_turned
    obj.modifiers.remove(glass_modifier(obj))
    assert bpy.ops.object.refractive_glass_modifier_add(shape="REVOLUTION") == {"FINISHED"}
    profile = read_input(glass_modifier(obj), "Profile")
    assert profile.parent == obj
    description = read_glass(obj, scenes.depsgraph()).description
    np.testing.assert_allclose([p[1] for p in description.outer], CUP[:3], atol=1e-6)
    np.testing.assert_allclose([p[1] for p in description.inner], CUP[:2:-1], atol=1e-6)


def test_corners_stay_corners_and_round_sides_round():
    obj = _screwed()
    assert bpy.ops.object.refractive_glass_modifier_add(shape="REVOLUTION") == {"FINISHED"}
    outer = np.array(read_glass(obj, scenes.depsgraph()).description.outer)
    for (_, start, leaving), (arriving, end, _) in pairwise(outer):
        for share, handle in ((1 / 3, leaving), (2 / 3, arriving)):
            np.testing.assert_allclose(handle, start + share * (end - start), atol=1e-6)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.05, segments=48, ring_count=24)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="REVOLUTION") == {"FINISHED"}
    left, middle, right = np.moveaxis(
        np.array(read_glass(bpy.context.object, scenes.depsgraph()).description.outer), 1, 0
    )
    halves = (middle[:-1] + 3 * right[:-1] + 3 * left[1:] + middle[1:]) / 8
    # Chords of a ball are 0.2 % too deep in the middle.
    np.testing.assert_allclose(np.linalg.norm(halves, axis=1), 0.05, rtol=3e-4)
