# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as surfaces: closed forms, and the brightness at which Cycles shows them."""

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Euler, Matrix, Vector

from glass_refraction.scene.rays.lamps import lamp_shape, sun_of

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
    points, triangles, look = lamp_shape(light, POSE)
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
    points, triangles, look = lamp_shape(light, POSE)
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
    sun = sun_of(light, POSE)
    np.testing.assert_allclose(sun.towards, POSE[:3, 2], atol=1e-12)
    assert sun.cosine == pytest.approx(np.cos(0.15))
    irradiance = np.array(sun.radiance) * np.pi * np.sin(0.15) ** 2
    np.testing.assert_allclose(irradiance, 3.0 * np.array(light.color), rtol=1e-6)


def test_lamps_of_no_size_have_no_image():
    assert sun_of(_lamp("SUN", angle=0.0), POSE) is None
    assert lamp_shape(_lamp("POINT", shadow_soft_size=0.0), POSE) is None
    assert lamp_shape(_lamp("AREA", size=0.0), POSE) is None
    flat = POSE @ np.diag((1.0, 0.0, 1.0, 1.0))
    assert lamp_shape(_lamp("AREA", size=1.0), flat) is None
    assert lamp_shape(_lamp("SUN", angle=0.1), POSE) is None


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
    scene = scenes.settings(8, 8, samples=1)
    scenes.camera(location=(0.0, 0.0, 2.0), tilt=0.0, lens=200.0)
    light = _lamp(kind, **settings)
    lamp = bpy.data.objects.new("Lamp", light)
    scene.collection.objects.link(lamp)
    lamp.location, lamp.scale = (0.0, 0.0, 4.0), scale
    bpy.ops.mesh.primitive_plane_add(size=2.0)
    material = bpy.data.materials.new("Mirror")
    bsdf = material.node_tree.nodes["Principled BSDF"]
    bsdf.inputs["Metallic"].default_value, bsdf.inputs["Roughness"].default_value = 1.0, 0.0
    bsdf.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    bpy.context.object.data.materials.append(material)
    bpy.context.view_layer.update()
    matrix = np.array(lamp.matrix_world, float)
    if kind == "SUN":
        radiance = sun_of(light, matrix).radiance
    else:
        radiance = lamp_shape(light, matrix)[2].radiance
    found = scenes.picture(scene, tmp_path)[4, 4, :3]
    np.testing.assert_allclose(found, radiance, rtol=2e-3)
