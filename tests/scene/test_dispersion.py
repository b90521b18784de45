# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that send colours different ways."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input


def _white_stripe():
    """A white stripe on a black wall."""
    wall = scenes.striped_wall(stripes=15)
    for number, slot in enumerate(wall.material_slots):
        slot.material = scenes.emissive(f"grey {number}", (1.0,) * 3 if number == 0 else (0.0,) * 3)
    wall.data.polygons.foreach_set(
        "material_index", np.where(np.arange(15) == 7, 0, 1).astype(np.int32)
    )
    return wall


@pytest.mark.parametrize("shading", ["DISPLACED"])
@pytest.mark.parametrize("surface", ["GLASS", "REFRACTION"])
def test_no_dispersion_is_the_same_to_the_bit(tmp_path, shading, surface):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(64, 48, surface=surface, shading=shading, min_weight=0.1)
    obj = scenes.glass(shape="CYLINDER")
    before = scenes.picture(scene, tmp_path)
    write_input(glass_modifier(obj), "Abbe Number", 30.0)
    spread = scenes.picture(scene, tmp_path)
    write_input(glass_modifier(obj), "Abbe Number", 0.0)
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path), before)
    assert np.abs(spread - before).max() > 0.01


@pytest.mark.parametrize("shading", ["DISPLACED"])
def test_red_green_and_blue_are_seen_each_through_a_glass_of_its_own_ior(tmp_path, shading):
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2)
    _white_stripe()
    scene = scenes.settings(96, 72, samples=8, surface="GLASS", shading=shading)
    obj = scenes.glass(shape="CYLINDER", contents_ior=1.333)
    modifier = glass_modifier(obj)
    write_input(modifier, "Abbe Number", 20.0)
    write_input(modifier, "Contents Abbe Number", 15.0)
    spread = scenes.picture(scene, tmp_path)
    assert find_layers(scene) is not None
    write_input(modifier, "Abbe Number", 0.0)
    write_input(modifier, "Contents Abbe Number", 0.0)
    for channel, length in enumerate(optics.LINES.values()):
        write_input(modifier, "IOR", optics.dispersed_ior(1.5, 20.0, length))
        write_input(modifier, "Contents IOR", optics.dispersed_ior(1.333, 15.0, length))
        one = scenes.picture(scene, tmp_path)
        # The modifier's numbers are of single precision.
        off = np.abs(spread - one)[..., channel]
        assert np.quantile(off, 0.99) < 1e-3
        assert off.mean() < 1e-3
        np.testing.assert_allclose(spread[..., 3], 1.0, atol=1e-3)


def test_each_colour_starts_from_the_last(monkeypatch):
    scenes.camera()
    scenes.striped_wall()
    scenes.settings(surface="REFRACTION", tolerance_px=4.0)
    obj = scenes.glass(shape="CYLINDER")
    write_input(glass_modifier(obj), "Abbe Number", 30.0)
    guessed = []
    solve = optics.apparent_points

    def counted(*args, guess=None, **kwargs):
        guessed.append(guess is not None)
        return solve(*args, guess=guess, **kwargs)

    monkeypatch.setattr(optics, "apparent_points", counted)
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=64, ring_count=32, radius=0.02, location=(0.0, 0.1, 0.06)
    )
    bpy.ops.scene.refractive_glass_update()
    assert sum(guessed) >= 2


def test_an_abbe_number_that_no_glass_can_have_is_an_error():
    scenes.camera()
    scenes.striped_wall()
    obj = scenes.glass(shape="CYLINDER", ior=1.5)
    write_input(glass_modifier(obj), "Abbe Number", 0.05)
    with pytest.raises(RefractiveGlassError, match="abbe_number"):
        read_glasses(scenes.depsgraph())
