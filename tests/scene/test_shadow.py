# SPDX-License-Identifier: GPL-3.0-or-later
"""The shadow that a glass casts if it is told to."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.optics import fresnel
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input

TINT = np.array([0.9, 0.5, 0.2])


def _floor_in_the_sun(angle):
    """A white floor seen from above at a slant, a parallel lamp, no sky; the sunlit colour is 1."""
    scenes.camera(location=(0.0, -1.0, 0.8), tilt=np.arctan2(1.0, 0.8), lens=60.0)
    bpy.ops.mesh.primitive_plane_add(size=4.0)
    material = bpy.data.materials.new("White")
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], end.inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    data = bpy.data.lights.new("Sun", "SUN")
    data.angle, data.energy = 0.0, np.pi / np.cos(angle)
    sun = bpy.data.objects.new("Sun", data)
    sun.rotation_euler = (0.0, angle, 0.0)
    bpy.context.scene.collection.objects.link(sun)
    scene = scenes.settings(60, 45, samples=4, surface="GLASS")
    scene.world = None
    scene.cycles.max_bounces = 0
    return scene


def _hung(height=2.0, **values):
    """A glass high over the picture, its shadow in the middle whatever the lamp's angle."""
    obj = scenes.glass(**values)
    obj.location.z = height
    modifier = glass_modifier(obj)
    write_input(modifier, "Absorption Color", (*TINT, 1.0))
    write_input(modifier, "Absorption Distance", 0.01)
    return obj, modifier


@pytest.mark.parametrize("angle", [0.0, 0.6, 1.1])
def test_a_panes_shadow_is_what_fresnel_and_beer_leave(tmp_path, angle):
    scene = _floor_in_the_sun(angle)
    pane, modifier = _hung(shape="SLAB", radius=0.5, wall_thickness=0.01, ior=1.5)
    # The sun comes from the side that it is turned to.
    pane.location.x = 2.0 * np.tan(angle)
    clear = scenes.picture(scene, tmp_path)
    np.testing.assert_allclose(clear[20:25, 28:32, :3], 1.0, atol=2e-3)
    write_input(modifier, "Casts Shadow", True)
    shaded = scenes.picture(scene, tmp_path)[20:25, 28:32, :3].mean(axis=(0, 1))
    inside = np.sqrt(1 - (np.sin(angle) / 1.5) ** 2)
    faces = (1 - fresnel(np.cos(angle), 1 / 1.5)) ** 2
    np.testing.assert_allclose(shaded, faces * TINT ** (1 / inside), rtol=5e-3)


def test_a_balls_shadow_is_darkest_in_the_middle(tmp_path):
    scene = _floor_in_the_sun(0.0)
    _, modifier = _hung(shape="SPHERE", radius=0.1, wall_thickness=0.0, ior=1.0)
    write_input(modifier, "Casts Shadow", True)
    write_input(modifier, "Absorption Distance", 0.2)
    shaded = scenes.picture(scene, tmp_path)
    # A diameter of the tint's distance: its colour, once.
    np.testing.assert_allclose(shaded[22, 30, :3], TINT, rtol=0.02)
    assert (shaded[..., 1] > TINT[1] - 0.01).all()


def test_the_glass_itself_stays_out_of_the_picture(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(64, 48, surface="GLASS", shading="DISPLACED")
    obj = scenes.glass(shape="CYLINDER")
    without = scenes.picture(scene, tmp_path)
    write_input(glass_modifier(obj), "Casts Shadow", True)
    # Nothing here is lit: every surface emits.
    off = np.abs(scenes.picture(scene, tmp_path) - without)
    assert np.quantile(off, 0.99) < 2e-3
