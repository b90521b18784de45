# SPDX-License-Identifier: GPL-3.0-or-later
"""The composited picture, against forward traced rays and against the plain render."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.scene.read.glasses import glass_objects, read_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.vertices.regions import region_masks

DISTANCE, STRIPES, SIZE = 0.3, 24, 1.0


def _colour(x):
    """Colour and distance to the next border, metres, of the striped wall at x."""
    place = (x + SIZE / 2) / SIZE * STRIPES
    number = np.floor(place).astype(int) % 3
    return np.eye(3)[number] * 0.7 + 0.1, np.abs(place - np.round(place)) * SIZE / STRIPES


def _plain(scene, folder):
    """The same frame without the extension's part in it."""
    glasses = glass_objects(scene.view_layers[0])
    scene.refractive_glass.enabled = False
    for obj in glasses:
        obj.hide_render = True
    found = scenes.picture(scene, folder, "plain")
    for obj in glasses:
        obj.hide_render = False
    scene.refractive_glass.enabled = True
    return found


@pytest.mark.parametrize("shading", ["DISPLACED"])
@pytest.mark.parametrize("camera", [{"lens": 150.0}, {"type": "ORTHO", "ortho_scale": 0.16}])
def test_each_pixel_shows_where_its_traced_ray_ends(tmp_path, shading, camera):
    scenes.camera(location=(0.005, -0.5, 0.06), tilt=np.pi / 2, **camera)
    scenes.striped_wall(DISTANCE, STRIPES, SIZE)
    scene = scenes.settings(120, 90, samples=4, surface="REFRACTION", shading=shading)
    scenes.glass(shape="CYLINDER", contents_ior=1.0)
    found = scenes.picture(scene, tmp_path)

    view = read_viewpoint(scene, scenes.depsgraph())
    glass = read_glasses(scenes.depsgraph())[0]
    inside = region_masks(scene, scenes.depsgraph())["TTTT"]
    rows, columns = np.nonzero(inside)

    def wall_x(offset):
        origins, directions = view.rays(columns + 0.5 + offset, rows + 0.5)
        local, heading = glass.to_local(origins), glass.direction_to_local(directions)
        traced = optics.trace(glass.description, local, heading, "TTTT")
        origin = glass.points_to_world(traced.origin)
        direction = traced.direction @ glass.to_world[:3, :3].T
        x = origin[:, 0] + (DISTANCE - origin[:, 1]) / direction[:, 1] * direction[:, 0]
        return np.where(traced.valid, x, np.nan)

    # A pixel is compared where its whole footprint, and its lookup's, lies on one stripe.
    left, x, right = wall_x(-1.5), wall_x(0.0), wall_x(1.5)
    expected, border = _colour(np.nan_to_num(x))
    reach = np.fmax(np.abs(left - x), np.abs(right - x)) + SIZE / 120
    clear = np.isfinite(left + x + right) & (border > reach)
    assert clear.sum() > 100
    off = np.abs(found[rows, columns, :3] - expected).max(axis=1)[clear]
    assert np.quantile(off, 0.99) < (0.01 if shading == "DISPLACED" else 0.05)
    np.testing.assert_allclose(found[rows, columns, 3], 1.0, atol=1e-3)


@pytest.mark.parametrize(("shading", "most"), [("DISPLACED", 0.02)])
def test_glass_of_the_airs_own_ior_is_not_there(tmp_path, shading, most):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(100, 75, samples=8, surface="GLASS", shading=shading)
    obj = scenes.glass(shape="CYLINDER")
    write_input(glass_modifier(obj), "IOR", 1.0)
    found, plain = scenes.picture(scene, tmp_path), _plain(scene, tmp_path)
    off = np.abs(found - plain).max(axis=2)
    assert np.quantile(off, 0.98) < most
    assert off.mean() < 0.01


def test_beside_the_glass_the_picture_is_the_plain_one_to_the_bit(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(100, 75, surface="REFRACTION")
    scenes.glass(shape="CYLINDER")
    found, plain = scenes.picture(scene, tmp_path), _plain(scene, tmp_path)
    beside = region_masks(scene, scenes.depsgraph())[""]
    assert 0.5 < beside.mean() < 1.0
    np.testing.assert_array_equal(found[beside], plain[beside])
    assert np.abs(found - plain)[~beside].max() > 0.3


@pytest.mark.parametrize("shading", ["DISPLACED"])
def test_what_stands_before_the_glass_hides_it(tmp_path, shading):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(100, 75, surface="REFRACTION", shading=shading)
    scenes.glass(shape="CYLINDER")
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0.0, -0.15, 0.07))
    bpy.context.object.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    found = scenes.picture(scene, tmp_path)
    view = read_viewpoint(scene, scenes.depsgraph())
    column, row = (view.pixels(np.array([(0.0, -0.165, 0.07)]))[0]).astype(int)
    np.testing.assert_allclose(
        found[row - 1 : row + 2, column - 1 : column + 2, :3], 1.0, atol=1e-3
    )


def test_an_object_in_the_glass_is_seen_in_it(tmp_path):
    scenes.camera(tilt=np.pi / 2)
    scenes.striped_wall()
    scene = scenes.settings(120, 90, surface="REFRACTION", shading="DISPLACED")
    scenes.glass(shape="CYLINDER", contents_ior=1.333)
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=48, ring_count=24, radius=0.012, location=(0.0, 0.0, 0.09)
    )
    bpy.context.object.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    found = scenes.picture(scene, tmp_path)
    white = np.all(found[..., :3] > 0.95, axis=2)
    rows, columns = np.nonzero(white)
    view = read_viewpoint(scene, scenes.depsgraph())
    straight = np.ptp(view.pixels(np.array([(-0.012, 0, 0.09), (0.012, 0, 0.09)]))[:, 0])
    # Water magnifies what stands in it sideways, by about its ior, and not upwards.
    wide, high = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert 1.15 < wide / straight < 1.5
    assert 0.8 < high / straight < 1.1


def test_workbench_draws_the_copies(tmp_path):
    scenes.camera()
    wall = scenes.striped_wall()
    for slot in wall.material_slots:
        slot.material.diffuse_color = (
            slot.material.node_tree.nodes["Emission"].inputs[0].default_value
        )
    scene = scenes.settings(100, 75, surface="REFRACTION", shading="DISPLACED")
    scenes.glass(shape="CYLINDER")
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.light = "FLAT"
    scene.display.shading.color_type = "MATERIAL"
    found, plain = scenes.picture(scene, tmp_path), _plain(scene, tmp_path)
    masks = region_masks(scene, scenes.depsgraph())
    assert np.abs(found - plain)[masks["TTTT"]].max() > 0.3
    np.testing.assert_array_equal(found[masks[""]], plain[masks[""]])


def test_a_transparent_film_stays_transparent_behind_the_glass(tmp_path):
    scenes.camera()
    wall = scenes.striped_wall()
    wall.location.z = 0.55
    scene = scenes.settings(100, 75, surface="REFRACTION")
    scene.render.film_transparent = True
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    inside = region_masks(scene, scenes.depsgraph())["TTTT"]
    alpha = found[inside][:, 3]
    assert alpha.min() < 0.01
    assert alpha.max() > 0.99


@pytest.mark.parametrize("crop", [False, True])
@pytest.mark.parametrize("shading", ["DISPLACED"])
def test_a_border_shows_its_part_of_the_whole_picture(tmp_path, crop, shading):
    scenes.camera(lens=120.0)
    scenes.striped_wall()
    scene = scenes.settings(100, 80, samples=1, surface="REFRACTION", shading=shading)
    scene.cycles.filter_width = 0.01
    scenes.glass(shape="CYLINDER")
    whole = scenes.picture(scene, tmp_path, "whole")
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x = 0.2, 0.6
    render.border_min_y, render.border_max_y = 0.3, 0.9
    part = scenes.picture(scene, tmp_path, "part")
    assert part.shape[:2] == ((48, 40) if crop else (80, 100))
    if not crop:
        part = part[24:72, 20:60]
    # Near the border a lookup's spline has fewer pixels to go by.
    off = np.abs(part - whole[24:72, 20:60]).max(axis=2)[10:-10, 10:-10]
    assert np.quantile(off, 0.97) < 0.05


def test_the_order_of_two_glasses_in_the_scene_does_not_matter(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(80, 60, surface="REFRACTION", shading="DISPLACED")
    one, other = (scenes.glass(shape="CYLINDER", contents_ior=1.333) for _ in range(2))
    found = []
    for place in (-0.1, 0.1):
        one.location.y, other.location.y = place, -place
        found.append(scenes.picture(scene, tmp_path))
    inside = region_masks(scene, scenes.depsgraph())["TTTT"]
    assert inside.sum() > 300
    np.testing.assert_allclose(found[0], found[1], atol=1e-4)
