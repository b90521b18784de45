# SPDX-License-Identifier: GPL-3.0-or-later
"""Radiance views: what is computed of a camera is what Blender's camera of that name draws."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector

from glass_refraction.scene.rays.true import _aim_camera
from glass_refraction.scene.rays.views import aimed_view, direct_view, quantiles, virtual_eye
from glass_refraction.scene.read.viewpoint import Lens, border_window, read_viewpoint


def _frame(size=(96, 64), aspect=(1.0, 1.0), border=None, crop=False, **camera):
    scene = bpy.context.scene
    scenes.camera(**camera)
    render = scene.render
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    region = (0, 0, *size)
    if border:
        render.use_border, render.use_crop_to_border = True, crop
        (render.border_min_x, render.border_min_y) = border[:2]
        (render.border_max_x, render.border_max_y) = border[2:]
        region = border_window(scene)
    view = read_viewpoint(scene, scenes.depsgraph())
    return scene, direct_view(view, region, 0.01, 100.0)


def _directions(random, towards, spread, count=400):
    found = np.array(towards, float) + random.normal(0, spread, (count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


FRAMES = (
    {},
    {"size": (64, 96)},
    {"aspect": (2.0, 1.0)},
    {"aspect": (1.0, 1.5), "size": (80, 80)},
    {"border": (0.2, 0.3, 0.7, 0.9)},
    {"border": (0.2, 0.3, 0.7, 0.9), "crop": True, "aspect": (1.0, 1.4)},
    {"shift_x": 0.3, "lens": 90.0},
)


@pytest.mark.parametrize("settings", FRAMES, ids=str)
@pytest.mark.parametrize("towards", [(0, 1, 0), (0.3, -1, -0.4), (0, 0.01, -1)], ids=str)
def test_blenders_camera_projects_as_the_view(settings, towards):
    scene, direct = _frame(**settings)
    random = np.random.default_rng(2)
    render = scene.render
    aspect = render.pixel_aspect_y / render.pixel_aspect_x
    directions = _directions(random, towards, 0.2)
    eye = np.array((0.3, -0.2, 0.5))
    view = aimed_view(eye, directions, np.ones(len(directions)), 0.01, direct, aspect)
    camera = bpy.data.objects.new("capture", bpy.data.cameras.new("capture"))
    scene.collection.objects.link(camera)
    _aim_camera(camera, view, 10.0)
    scene.camera = camera
    bpy.context.view_layer.update()
    seen = read_viewpoint(scene, scenes.depsgraph())
    points = eye + directions * random.uniform(0.1, 5.0, (len(directions), 1))
    pixels, inside = view.pixels(points)
    ahead = (directions @ view.forward) > 0.2
    assert ahead.mean() > 0.9
    np.testing.assert_allclose(pixels[ahead], seen.pixels(points[ahead]), atol=2e-3)
    # Nearly all that it was opened for lies in what is drawn.
    assert inside.mean() > 0.9
    data = camera.data
    assert data.clip_start == pytest.approx(0.01)
    assert data.clip_end == pytest.approx(10.0)


@pytest.mark.parametrize("settings", FRAMES, ids=str)
@pytest.mark.parametrize("camera", [{}, {"type": "ORTHO", "ortho_scale": 0.4}], ids=str)
def test_a_twin_sees_what_the_users_camera_sees(settings, camera):
    scene, direct = _frame(**{"shift_x": 0.2, "shift_y": -0.1} | settings | camera)
    user = read_viewpoint(scene, scenes.depsgraph())
    twin = bpy.data.objects.new("capture", bpy.data.cameras.new("capture"))
    scene.collection.objects.link(twin)
    _aim_camera(twin, direct, 10.0)
    scene.camera = twin
    bpy.context.view_layer.update()
    points = np.random.default_rng(9).uniform((-0.3, 0.1, -0.1), (0.3, 0.5, 0.3), (50, 3))
    seen = read_viewpoint(scene, scenes.depsgraph())
    np.testing.assert_allclose(seen.pixels(points), user.pixels(points), atol=2e-3)


@pytest.mark.parametrize("camera", [{}, {"type": "ORTHO", "ortho_scale": 0.4}], ids=str)
@pytest.mark.parametrize("crop", [False, True])
def test_the_direct_view_is_the_users_camera(camera, crop):
    scene, direct = _frame(border=(0.25, 0.25, 0.75, 1.0), crop=crop, **camera)
    view = read_viewpoint(scene, scenes.depsgraph())
    random = np.random.default_rng(4)
    points = random.uniform((-0.3, 0.1, -0.1), (0.3, 0.5, 0.3), (300, 3))
    pixels, inside = direct.pixels(points)
    np.testing.assert_allclose(pixels, view.pixels(points), atol=1e-9)
    x0, y0, x1, y1 = direct.region
    within = np.all((pixels > (x0 + 0.5, y0 + 0.5)) & (pixels < (x1 - 0.5, y1 - 0.5)), axis=1)
    np.testing.assert_array_equal(inside, within)
    assert 0.05 < inside.mean() < 0.95
    # Looked up at u, v of the picture, which holds the window alone.
    low, high = np.array(view.window[:2]), np.array(view.window[2:])
    np.testing.assert_allclose(direct.uv(pixels) * (high - low) + low, pixels, atol=1e-9)
    # Sights run from where the camera begins to see to the points.
    origins, directions, lengths = direct.sight(points)
    np.testing.assert_allclose(origins + directions * lengths[:, None], points, atol=1e-12)
    np.testing.assert_allclose((origins - direct.eye) @ direct.forward, 0.01, atol=1e-9)


def test_the_virtual_eye_of_rays_through_a_point_is_the_point():
    random = np.random.default_rng(6)
    point = np.array((1.0, -2.0, 0.5))
    directions = _directions(random, (0.0, 1.0, 0.2), 0.1)
    origins = point + directions * random.uniform(-3, 3, (len(directions), 1))
    weights = random.uniform(0.1, 1.0, len(directions))
    np.testing.assert_allclose(virtual_eye(origins, directions, weights), point, atol=1e-9)


def test_the_virtual_eye_of_parallel_rays_is_their_middle():
    random = np.random.default_rng(7)
    origins = random.normal(0, 1, (50, 3))
    directions = np.tile((0.0, 0.6, 0.8), (50, 1))
    weights = random.uniform(0.1, 1.0, 50)
    mean = np.average(origins, axis=0, weights=weights)
    np.testing.assert_allclose(virtual_eye(origins, directions, weights), mean, atol=1e-9)
    one = virtual_eye(origins[:1], directions[:1], weights[:1])
    np.testing.assert_allclose(one, origins[0], atol=1e-9)


def test_views_of_one_direction_and_of_all_round_are_finite():
    scene, direct = _frame()
    del scene
    random = np.random.default_rng(8)
    everywhere = _directions(random, (0, 0, 0), 1.0)
    for directions in (
        np.array([(0.0, 0.0, 1.0)]),
        np.array([(0, 0, 1.0), (0, 0, -1)]),
        everywhere,
    ):
        view = aimed_view(np.zeros(3), directions, np.ones(len(directions)), 0.0, direct, 1.0)
        assert np.isfinite(view.projection).all()
        assert np.isfinite(view.to_camera).all()
        turn = view.to_camera[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        _, inside = view.pixels_of_sky(directions)
        assert inside.any()


def test_what_a_view_shows_of_a_point_depends_on_no_other_point():
    """BLAS rounds the last rows of an array otherwise than the first, and starts threads."""
    random = np.random.default_rng(12)
    _, direct = _frame()
    aims = _directions(random, (0.3, 0.9, -0.2), 0.5)
    view = aimed_view(np.array((0.3, -0.7, 0.2)), aims, np.ones(len(aims)), 0.05, direct, 1.0)
    points = random.normal(size=(5_003, 3)) * 10.0
    for told in (view.local, view.turned, view.lengths):
        alone = np.concatenate([told(points[k : k + 1]) for k in range(5_003)])
        np.testing.assert_array_equal(told(points), alone)


# ----------------------------------------------------------------------------------------- lenses


OPENINGS = [{}, {"aperture_blades": 5, "aperture_rotation": 0.4}, {"aperture_ratio": 2.0}]


def _with_lens(opening):
    scene, _ = _frame(lens=60.0, shift_x=0.1)
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 1.5
    dof.focus_object = bpy.data.objects.new("Focus", None)
    scene.collection.objects.link(dof.focus_object)
    dof.focus_object.location = scene.camera.matrix_world @ Vector((0.3, -0.2, -0.8))
    for name, value in opening.items():
        setattr(dof, name, value)
    view = read_viewpoint(scene, scenes.depsgraph())
    return scene, direct_view(view, (0, 0, *view.size), 0.01, 100.0)


@pytest.mark.parametrize("opening", OPENINGS, ids=str)
def test_an_own_cameras_lens_is_that_of_its_view(opening):
    scene, view = _with_lens(opening)
    assert view.lens.radius == pytest.approx(0.06 / 1.5 / 2.0)
    assert view.lens.focus == pytest.approx(0.8)
    camera = bpy.data.objects.new("capture", bpy.data.cameras.new("capture"))
    scene.collection.objects.link(camera)
    _aim_camera(camera, view, 10.0)
    scene.camera = camera
    found = read_viewpoint(scene, scenes.depsgraph()).lens
    assert vars(found) == pytest.approx(vars(view.lens))
    _aim_camera(camera, replace(view, lens=None), 10.0)
    assert read_viewpoint(scene, scenes.depsgraph()).lens is None


@pytest.mark.parametrize("opening", OPENINGS, ids=str)
def test_rays_from_all_over_a_lens_meet_in_the_sharp_plane(opening):
    _, view = _with_lens(opening)
    random = np.random.default_rng(5)
    place = np.repeat(random.uniform(0.0, view.size, (20, 2)), 30, axis=0)
    origins, directions = view.lens_rays(place, random.random((len(place), 2)))
    np.testing.assert_allclose((origins - view.eye) @ view.forward, view.near, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    for depth, is_sharp in ((view.lens.focus, True), (0.5 * view.lens.focus, False)):
        way = (depth - view.near) / (directions @ view.forward)
        pixels, _ = view.pixels(origins + way[:, None] * directions)
        off = np.linalg.norm(pixels - place, axis=1)
        assert (off.max() < 1e-6) == is_sharp
        assert off.max() <= view.focal_px * view.lens.blur(depth) * (1.0 + 1e-9) + 1e-9


@pytest.mark.parametrize("blades", [0, 3, 6])
def test_places_in_a_lens_stand_for_equal_areas(blades):
    steps = (np.arange(120) + 0.5) / 120
    unit = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    found = Lens(2.0, 1.0, blades=blades, rotation=0.3).places(unit)
    # Of a regular polygon round a circle's middle, corners on it.
    square = 2.0 / 3.0 * (2.0 + np.cos(2.0 * np.pi / blades)) if blades else 2.0
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=1e-9)
    assert (found**2).sum(axis=1).mean() == pytest.approx(square, rel=1e-3)
    assert np.linalg.norm(found, axis=1).max() <= 2.0


@pytest.mark.parametrize("far", [1.0, 1e9])
def test_quantiles_are_those_of_values_in_order(far):
    random = np.random.default_rng(5)
    values, weights = random.normal(size=500), random.integers(0, 4, 500).astype(float)
    values[7], parts = far, (0.0, 0.01, 0.5, 0.99, 1.0)
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    expected = values[order[np.searchsorted(summed, np.array(parts) * summed[-1])]]
    assert quantiles(values, weights, *parts) == pytest.approx(expected, abs=0.0)
