# SPDX-License-Identifier: GPL-3.0-or-later
"""Coloured glass: what Beer and Lambert's law leaves of the light, here and in the reference."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input

COLOUR = np.array((0.2, 0.5, 0.8))
THICKNESS = 0.02


def _white(scene):
    scene.world = bpy.data.worlds.new("World")
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)


def _tint(obj, colour, distance, medium=""):
    write_input(glass_modifier(obj), f"{medium}Absorption Color", (*colour, 1.0))
    write_input(glass_modifier(obj), f"{medium}Absorption Distance", distance)


def _coloured_pane(**settings):
    """A pane seen square on, in a white world; its colour is that of light once through it."""
    scenes.camera(location=(0.0, 0.0, 0.5), tilt=0.0, lens=200.0)
    scene = scenes.settings(24, 18, samples=64, surface="GLASS", **settings)
    scene.refractive_glass.min_weight = 1e-4
    _white(scene)
    bpy.ops.mesh.primitive_plane_add(size=1e-3, location=(0.0, 500.0, -500.0))
    bpy.context.object.data.materials.append(scenes.emissive("speck", (1.0, 1.0, 1.0)))
    pane = scenes.glass(shape="SLAB", radius=0.3, wall_thickness=THICKNESS)
    _tint(pane, COLOUR, THICKNESS)
    return scene


def _between_mirrors():
    """What a pane in white light shows square on: a geometric series over the passes."""
    lost = float(optics.fresnel(np.array([1.0]), 1.0 / 1.5)[0])
    return lost + (1.0 - lost) ** 2 * COLOUR / (1.0 - lost * COLOUR)


@pytest.mark.parametrize("shading", ["DISPLACED"])
def test_a_pane_has_its_colour_once_a_pass(tmp_path, shading):
    scene = _coloured_pane(shading=shading)
    found = scenes.picture(scene, tmp_path)[6:12, 8:16, :3]
    # One path a sample is followed: a mean over pixels.
    np.testing.assert_allclose(found.mean(axis=(0, 1)), _between_mirrors(), atol=4e-3)


def test_the_reference_has_the_same_colour():
    scene = _coloured_pane()
    found = render_reference(scene, samples=256)[6:12, 8:16, :3]
    np.testing.assert_allclose(found.mean(axis=(0, 1)), _between_mirrors(), atol=4e-3)


def test_a_scaled_glass_looks_the_same():
    scenes.camera()
    scenes.striped_wall()
    scenes.settings()
    obj = scenes.glass(shape="CYLINDER", contents_ior=1.333)
    _tint(obj, COLOUR, 0.01)
    _tint(obj, COLOUR[::-1], 0.02, "Contents ")
    bpy.context.view_layer.update()
    small = read_glasses(scenes.depsgraph())[0]
    obj.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    large = read_glasses(scenes.depsgraph())[0]
    eye, direction, path = np.array((0.0, -1.0, 0.1)), np.array([(0.01, 1.0, 0.02)]), "TTTT"
    path = optics.LightPath(path)
    seen = small.transmittance(eye, direction, path)
    np.testing.assert_allclose(large.transmittance(2.0 * eye, direction, path), seen, rtol=1e-6)
    assert (seen < 1.0).all()


def test_white_is_clear_and_black_is_not_infinite():
    scenes.camera()
    scenes.striped_wall()
    obj = scenes.glass(shape="SPHERE", wall_thickness=0.0)
    assert not read_glasses(scenes.depsgraph())[0].is_tinted
    _tint(obj, (0.0, 0.0, 0.0), 0.0)
    bpy.context.view_layer.update()
    found = read_glasses(scenes.depsgraph())[0]
    assert found.is_tinted
    assert np.isfinite(found.absorption).all()
    eye, direction = np.array((0.0, -1.0, 0.0)), np.array([(0.0, 1.0, 0.0)])
    seen = found.transmittance(eye, direction, optics.LightPath("TT"))
    np.testing.assert_array_equal(seen, 0.0)


@pytest.mark.parametrize("touching", [False, True])
def test_the_outline_of_a_thing_before_coloured_glass_mixes_it_with_no_white(tmp_path, touching):
    """A black star before a pane, in white light: in each pixel the pane's colour, as much as the
    picture without glass has of white. Half of that once came unchanged."""
    scenes.camera(location=(0.0, 0.0, 0.5), tilt=0.0, lens=150.0)
    scene = scenes.settings(80, 60, samples=256, surface="REFRACTION", shading="TRUE")
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.0, 0.0, -0.1))
    bpy.context.object.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    bpy.ops.mesh.primitive_circle_add(
        vertices=5, radius=0.03, fill_type="NGON", location=(0.0, 0.0, 0.02), rotation=(0, 0, 0.2)
    )
    bpy.context.object.data.materials.append(scenes.emissive("black", (0.0, 0.0, 0.0)))
    if touching:
        # A thing that runs into the pane, so that rays look for things within it.
        bpy.ops.mesh.primitive_cube_add(size=0.01, location=(0.2, 0.0, 0.0))
    pane = scenes.glass(shape="SLAB", radius=0.3, wall_thickness=THICKNESS)
    _tint(pane, COLOUR, THICKNESS)
    found = scenes.picture(scene, tmp_path)[..., :3]
    scene.refractive_glass.enabled = False
    pane.hide_render = True
    plain = scenes.picture(scene, tmp_path, "plain")[..., :3]
    passed = found[plain.min(axis=-1) > 0.999].mean(axis=0)
    np.testing.assert_allclose(passed, COLOUR, atol=0.01)
    outline = (plain.max(axis=-1) > 0.1) & (plain.min(axis=-1) < 0.9)
    assert outline.sum() > 50
    # What the thing's own pixels have of white at its border is left: a third of before.
    assert np.abs(found[outline] - plain[outline] * passed).mean() < 0.08


def test_lamps_seen_through_glass_add_their_light_to_what_is_behind_them(tmp_path):
    """Two lamps before a white wall, seen through a pane: as Cycles shows them. A dim lamp once hid
    the wall and the other lamp."""
    scenes.camera(location=(0.0, 0.0, 0.5), tilt=0.0, lens=150.0)
    scene = scenes.settings(32, 24, samples=64, surface="REFRACTION", shading="TRUE")
    bpy.ops.mesh.primitive_plane_add(size=2.0, location=(0.0, 0.0, -0.5))
    bpy.context.object.data.materials.append(scenes.emissive("wall", (0.3, 0.2, 0.1)))
    for name, left, radiance in (("near", -0.005, 0.2), ("far", 0.005, 0.25)):
        lamp = bpy.data.lights.new(name, "AREA")
        lamp.size = 0.03
        lamp.energy = radiance * np.pi * lamp.size**2
        obj = bpy.data.objects.new(name, lamp)
        # An area lamp shines along its own −z: towards the camera above.
        obj.location, obj.rotation_euler = (left, 0.0, -0.2 - 8.0 * left), (np.pi, 0.0, 0.0)
        scene.collection.objects.link(obj)
    scenes.glass(shape="SLAB", radius=0.3, wall_thickness=THICKNESS)
    found = scenes.picture(scene, tmp_path)[..., :3]
    expected = render_reference(scene, samples=64, surface="REFRACTION")[..., :3]
    middle = found[12, 16]
    np.testing.assert_allclose(middle, (0.75, 0.65, 0.55), atol=0.01)
    assert np.abs(found - expected).mean() < 0.005
