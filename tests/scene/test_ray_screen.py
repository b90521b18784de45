# SPDX-License-Identifier: GPL-3.0-or-later
"""A cup's rays over the picture: each is the true one, nothing is lost, things end them."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.ray_screen import (
    SLOTS,
    TOLERANCE_PX,
    Zone,
    build_ray_screens,
    met_pixels,
    widened,
)
from glass_refraction.scene.read.glasses import glass_modifier, read_glasses
from glass_refraction.scene.read.modifier_inputs import write_input
from glass_refraction.scene.read.obstacles import Obstacle
from glass_refraction.scene.read.things import may_hide, obstacle_of, within
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.update import counters, memory_of, prepare, status, update
from glass_refraction.scene.vertices.regions import picture_rect

DEPTH = 0.0116


def _glass_and_view(scene):
    depsgraph = scenes.depsgraph()
    return read_glasses(depsgraph)[0], read_viewpoint(scene, depsgraph)


def _screen(glass, view, front=(), *, fresnel):
    rect = picture_rect(glass, view)
    cover = widened(met_pixels(glass, view, rect))
    zone = Zone(rect, cover, np.zeros_like(cover))
    found, mirrors = build_ray_screens(
        glass, view, zone, front, (), fresnel=fresnel, min_weight=0.01, depth=DEPTH
    )
    assert mirrors is None
    return found


@pytest.mark.parametrize("eye", [scenes.LOW, scenes.HIGH])
def test_all_light_has_a_slot_at_every_corner(eye):
    scenes.cup(eye)
    glass, view = _glass_and_view(scenes.settings(40, 30))
    screen = _screen(glass, view, fresnel=True)
    assert len(screen.colours) <= SLOTS["GLASS"]
    np.testing.assert_allclose(screen.colours.sum(axis=0), 1.0, atol=2e-6)
    lit = screen.colours.max(axis=3) > 0
    np.testing.assert_allclose(np.linalg.norm(screen.directions[lit], axis=1), 1.0, atol=1e-6)
    for number, corners in enumerate(screen.pixels[screen.cells]):
        size = np.ptp(corners, axis=0)
        assert size[0] == size[1] > 0, number


def test_between_the_corners_rays_are_nearly_the_true_ones():
    """Interpolated where a cell is in one region, they go where the traced ones go."""
    scenes.cup(scenes.LOW)
    glass, view = _glass_and_view(scenes.settings(80, 60))
    screen = _screen(glass, view, fresnel=False)
    whole = (screen.colours[0].min(axis=(1, 2)) == 1.0) & ~screen.colours[1:].any(axis=(0, 2, 3))
    # In smaller ones, at the borders, nothing is measured.
    whole &= np.ptp(screen.pixels[screen.cells][..., 0], axis=1) > 0.5
    corners = screen.pixels[screen.cells[whole]]
    part = np.array((0.3, 0.6))
    places = corners[:, 0] + part * (corners[:, 2] - corners[:, 0])
    u, v = part
    weights = np.array(((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v))
    direction = np.einsum("k,ckv->cv", weights, screen.directions[0, whole])
    eye, rays = view.rays_in(glass, *places.T)
    ends = optics.follow_rays(glass.description, eye, rays, fresnel=False)
    assert (np.bincount(ends.ray, minlength=len(places)) == 1).mean() > 0.98
    true = ends.direction @ glass.to_world[:3, :3].T
    off = np.linalg.norm(direction[ends.ray] - true, axis=1) * view.focal_px
    through = np.array([len(path) > 0 for path in ends.paths])[ends.path]
    assert through.sum() > 300
    assert np.quantile(off[through], 0.95) < TOLERANCE_PX
    assert off[~through].max() < 0.02


def test_what_stands_before_the_glass_leaves_its_rays_straight():
    scenes.cup(scenes.LOW)
    rod = scenes.rod((0.0, -0.1, 0.05), 0.0)
    glass, view = _glass_and_view(scenes.settings(60, 45))
    thing = obstacle_of(rod, scenes.depsgraph())
    assert may_hide(thing, view, (20, 10, 40, 40), 0.4)
    assert not may_hide(thing, view, (20, 10, 40, 40), 0.1)
    assert not within(thing, glass)
    screen = _screen(glass, view, (thing,), fresnel=True)
    origins, directions = view.rays(*screen.pixels[screen.cells[:, 0]].T)
    hidden = thing.stops(origins, directions, np.full(len(origins), 0.28))
    assert hidden.sum() > 20
    np.testing.assert_allclose(screen.directions[0, hidden, 0], directions[hidden], atol=1e-6)
    np.testing.assert_allclose(screen.colours[0, hidden, 0], 1.0, atol=1e-6)


def test_rays_meet_a_triangle_where_it_is():
    points = np.array([(0.0, 0.0, 1e3), (1.0, 0.0, 1e3), (0.0, 1.0, 1e3)])
    thing = Obstacle(points, np.array([(0, 1, 2)]))
    origin = np.tile((0.2, 0.2, 999.0), (4, 1))
    direction = np.array([(0.0, 0, 1), (0, 0, -1), (0, 0, 1), (1, 0, 0)])
    length = np.array([np.inf, np.inf, 0.5, 3.0])
    found = thing.met_after(origin, direction, length)
    np.testing.assert_allclose(found, (1.0, np.inf, np.inf, np.inf), rtol=1e-6)
    np.testing.assert_array_equal(thing.box().min(axis=0), points.min(axis=0))
    np.testing.assert_array_equal(thing.box().max(axis=0), points.max(axis=0))
    assert thing.stamp == Obstacle(points.copy(), thing.corners).stamp
    assert thing.stamp != Obstacle(points + 1e-9, thing.corners).stamp


@pytest.mark.parametrize("view", ["parallel", "in the liquid", "cropped"])
def test_other_eyes_see_what_real_glass_shows(tmp_path, view):
    scenes.cup((0.0, -0.01, 0.05) if view == "in the liquid" else scenes.HIGH)
    scenes.rod((0.005, 0.012, 0.06), 0.3)
    scene = scenes.settings(60, 60, samples=32, surface="REFRACTION", shading="DISPLACED")
    camera, render = scene.camera.data, scene.render
    if view == "parallel":
        camera.type, camera.ortho_scale = "ORTHO", 0.16
    elif view == "in the liquid":
        camera.lens, camera.clip_start = 20.0, 0.001
    else:
        render.use_border = render.use_crop_to_border = True
        render.border_min_x, render.border_max_x = 0.3, 0.7
        render.border_min_y, render.border_max_y = 0.2, 0.6
    bpy.context.view_layer.update()
    found = scenes.picture(scene, tmp_path)
    reference = render_reference(scene, surface="REFRACTION")
    assert found.shape == reference.shape
    gap = np.clip(found, 0, 1)[..., :3] - np.clip(reference, 0, 1)[..., :3]
    assert -10 * np.log10(np.mean(gap**2)) > 26.0


def test_workbench_shows_the_thing_in_the_liquid_as_wide_as_it_appears(tmp_path):
    """That engine sends no rays on: copies stand for what the glass holds."""
    scenes.cup((0.0, -0.33, 0.05))
    rod = scenes.rod((0.0, 0.0, 0.06), 0.0, depth=0.1)
    rod.data.materials[0].diffuse_color = (1.0, 0.0, 0.0, 1.0)
    bpy.data.objects["Wall"].hide_render = True
    scene = scenes.settings(160, 120, surface="REFRACTION", shading="DISPLACED")
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.light, scene.display.shading.color_type = "FLAT", "MATERIAL"
    drawn = scenes.picture(scene, tmp_path)
    assert not status(scene).problems
    assert find_layers(scene).copies()
    red = (drawn[..., 0] > 0.8) & (drawn[..., 1] < 0.2)
    view = read_viewpoint(scene, scenes.depsgraph())
    wide = [
        red[int(view.pixels(np.array([(0.0, 0.0, height)]))[0, 1])].sum()
        for height in (0.045, 0.09)
    ]
    assert wide[1] >= 4
    assert wide[0] > 1.2 * wide[1]


def test_rays_are_found_anew_only_when_something_moves():
    scenes.cup(scenes.LOW)
    rod = scenes.rod()
    scene = scenes.settings(40, 30)
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph(), exact=True)
    before = counters["masks"]
    update(scene, scenes.depsgraph(), exact=True)
    assert counters["masks"] == before
    rod.location.x += 0.001
    bpy.context.view_layer.update()
    update(scene, scenes.depsgraph(), exact=True)
    assert counters["masks"] == before + 1
    assert any(path.endswith("...") is False for path in status(scene).paths)
    # Nothing is rendered for such a glass but the rays.
    layers = find_layers(scene)
    assert layers.rendered() == (layers.around,)
    assert not layers.copies() and memory_of(scene).ray_screens


def test_a_coloured_liquid_tints_what_stands_in_it(tmp_path):
    """The way up to a thing counts, not the way through: Beer and Lambert's law on the axis.

    The reference cannot tell: it tints rays where they meet the glass next.
    """
    obj = scenes.cup((0.0, -0.33, 0.04))
    scene = bpy.context.scene
    scene.camera.rotation_euler, scene.camera.data.lens = (np.pi / 2, 0.0, 0.0), 900.0
    modifier = glass_modifier(obj)
    colour, distance, front = np.array((0.6, 0.3, 0.1)), 0.02, -0.013
    write_input(modifier, "Contents Absorption Color", (*colour, 1.0))
    write_input(modifier, "Contents Absorption Distance", distance)
    bpy.ops.mesh.primitive_cube_add(size=0.01)
    cube = bpy.context.object
    cube.location = (0.0, front + 0.005, 0.04)
    cube.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    bpy.context.view_layer.update()
    scenes.settings(41, 41, samples=4, surface="REFRACTION", shading="DISPLACED")
    found = scenes.picture(scene, tmp_path)[20, 20, :3]
    inner = scenes.CUP["radius"] - scenes.CUP["wall_thickness"]
    np.testing.assert_allclose(found, colour ** ((inner + front) / distance), rtol=1e-3)
