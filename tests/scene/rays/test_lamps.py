# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as surfaces: closed forms, and the brightness at which Cycles shows them."""

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Euler, Matrix, Vector

from glass_refraction.scene.rays.lamps import lamp_shape, sun_of
from glass_refraction.scene.rays.looks import look_of

POSE = np.array(Matrix.LocRotScale(Vector((0.3, -0.2, 1.0)), Euler((0.4, 1.1, -0.3)), None), float)


def _lamp(kind, energy=3.0, colour=(1.0, 0.5, 0.25), **settings):
    light = bpy.data.lights.new("Lamp", kind)
    light.energy, light.color = energy, colour
    for name, value in settings.items():
        setattr(light, name, value)
    return light


def _areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


AREAS = (
    ({"shape": "SQUARE", "size": 0.2}, 0.04),
    ({"shape": "RECTANGLE", "size": 0.2, "size_y": 0.5}, 0.1),
    ({"shape": "DISK", "size": 0.2}, np.pi * 0.01),
    ({"shape": "ELLIPSE", "size": 0.2, "size_y": 0.4}, np.pi * 0.02),
)


@pytest.mark.parametrize(("settings", "area"), AREAS, ids=lambda v: str(v))
def test_an_area_lamp_gives_its_power_on_one_side(settings, area):
    light = _lamp("AREA", **settings)
    points, triangles, look = lamp_shape(light, POSE, "CYCLES")
    vectors = _areas(points, triangles)
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(area, rel=4e-3)
    # A Lambertian face sends its radiance times area times pi.
    np.testing.assert_allclose(
        np.array(look.radiance) * area * np.pi, 3.0 * np.array(light.color), rtol=1e-3
    )
    # It shines along its own -z.
    np.testing.assert_allclose(vectors.sum(axis=0) / area, -POSE[:3, 2], atol=4e-3)
    assert look.is_lamp
    assert look.faces == 1


@pytest.mark.parametrize("kind", ["POINT", "SPOT"])
def test_a_ball_of_light_gives_its_power(kind):
    light = _lamp(kind, shadow_soft_size=0.1)
    points, triangles, look = lamp_shape(light, POSE, "CYCLES")
    np.testing.assert_allclose(np.linalg.norm(points - POSE[:3, 3], axis=1), 0.1)
    area = np.linalg.norm(_areas(points, triangles), axis=1).sum()
    assert area == pytest.approx(4.0 * np.pi * 0.01, rel=0.03)
    power = np.array(look.radiance) * 4.0 * np.pi * 0.01 * np.pi
    np.testing.assert_allclose(power, 3.0 * np.array(light.color), rtol=1e-6)
    # All faces look outward.
    middles = points[triangles].mean(axis=1) - POSE[:3, 3]
    outward = np.einsum("tk,tk->t", _areas(points, triangles), middles)
    assert (outward > -1e-12).all()


def test_a_sun_disc_gives_its_irradiance():
    light = _lamp("SUN", angle=0.3)
    sun = sun_of(light, POSE, "CYCLES")
    np.testing.assert_allclose(sun.towards, POSE[:3, 2], atol=1e-12)
    assert sun.cosine == pytest.approx(np.cos(0.15))
    irradiance = np.array(sun.radiance) * np.pi * np.sin(0.15) ** 2
    np.testing.assert_allclose(irradiance, 3.0 * np.array(light.color), rtol=1e-6)


def test_lamps_of_no_size_have_no_image():
    assert sun_of(_lamp("SUN", angle=0.0), POSE, "CYCLES") is None
    assert lamp_shape(_lamp("POINT", shadow_soft_size=0.0), POSE, "CYCLES") is None
    assert lamp_shape(_lamp("AREA", size=0.0), POSE, "CYCLES") is None
    flat = POSE @ np.diag((1.0, 0.0, 1.0, 1.0))
    assert lamp_shape(_lamp("AREA", size=1.0), flat, "CYCLES") is None
    assert lamp_shape(_lamp("SUN", angle=0.1), POSE, "CYCLES") is None


SHAPES = (
    ("AREA", {"shape": "SQUARE", "size": 1.0}, (1.0, 1.0, 1.0)),
    ("AREA", {"shape": "RECTANGLE", "size": 1.0, "size_y": 0.7}, (2.0, 1.5, 1.0)),
    ("AREA", {"shape": "DISK", "size": 1.0}, (1.0, 1.0, 1.0)),
    ("POINT", {"shadow_soft_size": 0.5}, (1.0, 1.0, 1.0)),
    ("POINT", {"shadow_soft_size": 0.5}, (2.0, 2.0, 2.0)),
    ("SUN", {"angle": 0.5}, (1.0, 1.0, 1.0)),
    ("AREA", {"size": 1.0, "use_temperature": True, "temperature": 3000.0}, (1.0, 1.0, 1.0)),
    ("AREA", {"size": 1.0, "exposure": 1.5}, (1.0, 1.0, 1.0)),
    ("AREA", {"size": 0.6, "normalize": False}, (1.0, 1.0, 1.0)),
    ("POINT", {"shadow_soft_size": 0.5, "normalize": False}, (1.0, 1.0, 1.0)),
    ("SPOT", {"shadow_soft_size": 0.5, "spot_size": 1.0, "spot_blend": 0.0}, (1.0, 1.0, 1.0)),
    ("SUN", {"angle": 0.5, "normalize": False}, (1.0, 1.0, 1.0)),
)


@pytest.mark.parametrize(("kind", "settings", "scale"), SHAPES, ids=str)
def test_cycles_shows_the_lamp_as_bright(tmp_path, kind, settings, scale):
    """In a mirror, where Cycles shows lamps: none is seen by a camera."""
    if not set(settings) <= set(_lamp(kind).bl_rna.properties.keys()):
        pytest.skip("this Blender has no such setting")
    light = _lamp(kind, **settings)
    matrix, found = _mirrored(tmp_path, light, scale)
    if kind == "SUN":
        radiance = sun_of(light, matrix, "CYCLES").radiance
    else:
        radiance = lamp_shape(light, matrix, "CYCLES")[2].radiance
    np.testing.assert_allclose(found, radiance, rtol=2e-3)


BEAMS = (
    ("AREA", {"spread": 1.0}, 0.0),
    ("AREA", {"spread": 1.0}, 0.3),
    ("AREA", {"spread": 1.0}, 0.6),
    ("AREA", {"spread": 3.0}, 0.5),
    ("AREA", {}, 1.2),
    ("SPOT", {"spot_size": 1.0, "spot_blend": 0.5}, 0.1),
    ("SPOT", {"spot_size": 1.0, "spot_blend": 0.5}, 0.4),
    ("SPOT", {"spot_size": 1.0, "spot_blend": 0.5}, 0.6),
)
"""Kind, settings and radians by which the lamp looks past the mirror."""


@pytest.mark.parametrize(("kind", "settings", "turn"), BEAMS, ids=str)
def test_cycles_shows_the_lamp_as_bright_beside_its_axis(tmp_path, kind, settings, turn):
    size = {"size": 1.0} if kind == "AREA" else {"shadow_soft_size": 0.5}
    light = _lamp(kind, **size, **settings)
    matrix, found = _mirrored(tmp_path, light, turn=turn)
    look = lamp_shape(light, matrix, "CYCLES")[2]
    # Through the middle of a pixel beside the picture's own.
    slope = 0.5 * 36.0 / 200.0 / 8.0
    direction = np.array([(-slope, -slope, -1.0)])
    direction /= np.linalg.norm(direction)
    part = 1.0 if look.beam is None else look.beam.part(direction)
    np.testing.assert_allclose(found, part * np.array(look.radiance), rtol=5e-3, atol=1e-6)


def test_only_cycles_knows_spread_and_lamps_nodes():
    light = _lamp("AREA", size=1.0, spread=1.0)
    plain = lamp_shape(light, POSE, "CYCLES")[2].radiance
    _emission(light, (0.5, 0.2, 0.1), 3.0)
    look = lamp_shape(light, POSE, "BLENDER_EEVEE")[2]
    assert look.beam is None
    np.testing.assert_allclose(look.radiance, plain)


@pytest.mark.parametrize("kind", ["AREA", "SUN"])
def test_eevee_multiplies_what_is_mirrored_of_a_lamp_and_what_comes_through(kind):
    size = {"angle": 0.1} if kind == "SUN" else {"size": 1.0}
    light = _lamp(kind, specular_factor=0.25, transmission_factor=0.5, **size)
    for engine, wanted in ("BLENDER_EEVEE", (0.5, 0.25)), ("CYCLES", (1.0, 1.0)):
        found = (sun_of if kind == "SUN" else lamp_shape)(light, POSE, engine)
        look = found if kind == "SUN" else found[2]
        assert look.factors == wanted


def test_cycles_shows_what_a_lamps_nodes_emit(tmp_path):
    light = _lamp("AREA", size=1.0)
    _emission(light, (0.5, 0.2, 0.1), 3.0)
    matrix, found = _mirrored(tmp_path, light)
    np.testing.assert_allclose(found, lamp_shape(light, matrix, "CYCLES")[2].radiance, rtol=2e-3)


def _emission(light, colour, strength):
    light.use_nodes = True
    emission = next(node for node in light.node_tree.nodes if node.type == "EMISSION")
    emission.inputs["Color"].default_value = (*colour, 1.0)
    emission.inputs["Strength"].default_value = strength


def _mirrored(tmp_path, light, scale=(1.0, 1.0, 1.0), turn=0.0):
    """A lamp's pose, and its colour in Cycles in a mirror that it shines on from above."""
    scene = scenes.settings(8, 8, samples=1)
    scenes.camera(location=(0.0, 0.0, 2.0), tilt=0.0, lens=200.0)
    lamp = bpy.data.objects.new("Lamp", light)
    scene.collection.objects.link(lamp)
    lamp.location, lamp.scale, lamp.rotation_euler.y = (0.0, 0.0, 4.0), scale, turn
    bpy.ops.mesh.primitive_plane_add(size=2.0)
    material = bpy.data.materials.new("Mirror")
    bsdf = material.node_tree.nodes["Principled BSDF"]
    bsdf.inputs["Metallic"].default_value, bsdf.inputs["Roughness"].default_value = 1.0, 0.0
    bsdf.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    bpy.context.object.data.materials.append(material)
    bpy.context.view_layer.update()
    return np.array(lamp.matrix_world, float), scenes.picture(scene, tmp_path)[4, 4, :3]


def test_a_wire_thinner_than_a_pixel_is_as_bright_through_a_pane_as_beside_it(tmp_path):
    """No view shows its own brightness; the material tells it."""
    scenes.camera(location=(0.0, -1.0, 0.0), tilt=np.pi / 2)
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.0, 0.5, 0.0))
    wire = bpy.context.object
    # A pixel is 13 mm wide there.
    wire.scale, wire.rotation_euler = (0.9, 0.006, 1.0), (np.pi / 2, 0.12, 0.0)
    wire.data.materials.append(scenes.emissive("Wire", (8.0, 4.0, 4.0)))
    bpy.ops.mesh.primitive_plane_add(size=0.6, location=(0.3, 0.0, 0.0), rotation=(np.pi / 2, 0, 0))
    assert bpy.ops.object.refractive_glass_modifier_add(wall_thickness=0.001) == {"FINISHED"}
    scene = scenes.settings(80, 60, 64, shading="TRUE")
    picture = scenes.picture(scene, tmp_path)[..., 0]
    beside, through = picture[:, 18:36].sum(), picture[:, 44:62].sum()
    reflected = 0.04
    assert through / beside == pytest.approx((1 - reflected) / (1 + reflected), rel=0.08)


def test_what_shines_in_one_colour_is_known_and_nothing_else_is():
    bright = scenes.emissive("Bright", (1.0, 0.5, 0.5))
    emission = next(n for n in bright.node_tree.nodes if n.type == "EMISSION")
    emission.inputs["Strength"].default_value = 9.0
    assert look_of(bright).is_plain
    np.testing.assert_allclose(look_of(bright).radiance, (9.0, 4.5, 4.5))
    emission.inputs["Strength"].default_value = 1.5
    assert not look_of(bright).is_plain
    emission.inputs["Strength"].default_value = 9.0
    image = bright.node_tree.nodes.new("ShaderNodeTexNoise")
    bright.node_tree.links.new(image.outputs["Color"], emission.inputs["Color"])
    assert not look_of(bright).is_plain


def test_a_principled_material_that_outshines_what_it_sends_back_is_known():
    material = bpy.data.materials.new("Filament")
    inputs = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED").inputs
    inputs["Emission Color"].default_value = (1.0, 0.6, 0.2, 1.0)
    inputs["Emission Strength"].default_value = 30.0
    assert look_of(material).is_plain
    np.testing.assert_allclose(look_of(material).radiance, (30.0, 18.0, 6.0), rtol=1e-6)
    inputs["Alpha"].default_value = 0.5
    assert not look_of(material).is_plain
    inputs["Alpha"].default_value = 1.0
    inputs["Emission Strength"].default_value = 4.0
    assert not look_of(material).is_plain
