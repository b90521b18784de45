# SPDX-License-Identifier: GPL-3.0-or-later
"""What a view finds: as little as changed, following what moves, exact at rest."""

import bpy
import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.scene.update import kept_paths
from glass_refraction.viewport import picture as module
from glass_refraction.viewport.eye import view_eye
from glass_refraction.viewport.picture import Picture, cut, drawn, weight_planes

SIZE = (200, 150)


@pytest.fixture
def scene():
    """A ball and a wall behind a hollow glass; surfaces that only refract, so few paths."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.refractive_glass.surface = "REFRACTION"
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0, 0.3, 0.1), rotation=(np.pi / 2, 0, 0))
    bpy.context.object.name = "Wall"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.03, location=(0.01, 0.12, 0.06))
    bpy.context.object.name = "Ball"
    bpy.ops.object.refractive_glass_add(shape="CYLINDER")
    bpy.context.object.name = "Glass"
    data = bpy.data.cameras.new("Camera")
    camera = scene.camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0.0, -0.5, 0.09), (np.pi / 2 * 0.97, 0, 0)
    bpy.context.view_layer.update()
    return scene


def eye(scene):
    camera = scene.camera
    bpy.context.view_layer.update()
    window = camera.calc_matrix_camera(scene.view_layers[0].depsgraph, x=SIZE[0], y=SIZE[1])
    return view_eye(SIZE, camera.matrix_world.inverted(), window, True)


def update(picture, scene, *, exact):
    view = eye(scene)
    layer = scene.view_layers[0]
    module.counters.clear()
    picture.update(scene, layer, layer.depsgraph, view, exact=exact)
    return dict(module.counters)


def ball(picture):
    pane = picture.panes["Glass"]
    uid = bpy.data.objects["Ball"].session_uid
    return pane.shapes["TTTT", uid]


def middle(shape, view):
    """The mean pixel of where the ball's vertices appear."""
    images = shape.found.images
    (slot,) = module.used_slots(images.valid)
    return view.pixels(images.position[slot][images.valid[slot]]).mean(axis=0)


def test_a_still_scene_costs_nothing(scene):
    picture = Picture()
    assert update(picture, scene, exact=False)["solves"] > 0
    assert not picture.exact
    assert update(picture, scene, exact=True)["regions"] == 1
    assert picture.exact
    assert update(picture, scene, exact=True) == {}
    assert update(picture, scene, exact=False) == {}
    assert picture.exact


def test_an_evaluation_that_moves_nothing_solves_nothing(scene):
    picture = Picture()
    update(picture, scene, exact=True)
    bpy.data.objects["Ball"].update_tag()
    found = update(picture, scene, exact=False)
    assert found.get("solves", 0) == found.get("regions", 0) == 0
    assert picture.exact


def test_a_moved_source_is_solved_alone_and_no_region(scene):
    picture = Picture()
    update(picture, scene, exact=True)
    bpy.data.objects["Ball"].location.x += 0.004
    found = update(picture, scene, exact=False)
    assert found["solves"] == len(picture.panes["Glass"].followed)
    assert "regions" not in found
    assert not picture.exact


def test_a_moved_eye_finds_the_regions_on_a_coarse_grid(scene):
    picture = Picture()
    fine = update(picture, scene, exact=True)["ray_pixels"]
    scene.camera.location.x += 0.01
    coarse = update(picture, scene, exact=False)["ray_pixels"]
    assert coarse < fine / 8
    planes = weight_planes(picture.panes["Glass"])
    assert all(np.isfinite(plane).all() for plane in planes)
    total = sum(plane[..., 0] for plane in planes)
    known = planes[0][..., 1]
    assert total[known > 0] == pytest.approx(known[known > 0], abs=1e-3)


def test_following_agrees_with_the_exact_answer(scene):
    followed, exact = Picture(), Picture()
    update(followed, scene, exact=True)
    for _ in range(3):
        scene.camera.location.x += 0.005
        bpy.data.objects["Ball"].location.x -= 0.003
        update(followed, scene, exact=False)
    update(exact, scene, exact=True)
    view = exact.view
    assert middle(ball(followed), view) == pytest.approx(middle(ball(exact), view), abs=1.0)


def test_a_source_that_comes_into_sight_while_all_moves_is_seen(scene):
    picture = Picture()
    thing = bpy.data.objects["Ball"]
    thing.location.z = 5.0
    update(picture, scene, exact=True)
    assert ball(picture).found.images is None
    thing.location.z = 0.06
    update(picture, scene, exact=False)
    assert ball(picture).found.images is not None


def test_sources_and_glasses_come_and_go(scene):
    picture = Picture()
    update(picture, scene, exact=True)
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    update(picture, scene, exact=False)
    assert len({uid for _, uid in picture.panes["Glass"].shapes}) == 1
    bpy.data.objects["Glass"].hide_set(True)
    update(picture, scene, exact=False)
    assert picture.panes == {}


def test_an_eye_in_the_wall_is_a_problem_and_no_error(scene):
    picture = Picture()
    scene.camera.location = (0.0385, 0.0, 0.05)
    update(picture, scene, exact=False)
    assert picture.panes == {}
    assert "inside the wall" in picture.problems[0]


def test_steps_can_be_left_off_and_taken_up(scene):
    picture = Picture()
    layer, view = scene.view_layers[0], eye(scene)
    steps = picture.steps(scene, layer, layer.depsgraph, view, exact=True)
    next(steps)
    assert not picture.exact
    steps.close()
    update(picture, scene, exact=True)
    assert picture.exact


def test_drawn_triangles_appear_where_the_images_are(scene):
    picture = Picture()
    update(picture, scene, exact=True)
    shape, view = ball(picture), picture.view
    rect = picture.panes["Glass"].rect
    arrays = drawn(shape, view, rect)
    ndc = arrays.clip[:, :2] / arrays.clip[:, 3:]
    low, high = np.array(rect[:2]), np.array(rect[2:])
    pixels = low + 0.5 * (ndc + 1) * (high - low)
    (slot,) = module.used_slots(shape.found.images.valid)
    assert pixels == pytest.approx(view.pixels(shape.found.images.position[slot]), abs=0.01)
    place = arrays.place[:, :2] / arrays.place[:, 2:3] * SIZE
    assert place == pytest.approx(view.pixels(shape.found.triangles.points), abs=0.01)
    assert arrays.corners.max() < len(arrays.clip) == len(arrays.colours)


def test_large_faces_are_cut_without_a_solve(scene):
    view = eye(scene)
    wall = np.array([(-0.5, 0.3, -0.4), (0.5, 0.3, -0.4), (0.5, 0.3, 0.6), (-0.5, 0.3, 0.6)])
    whole = module.Triangles.whole(wall, np.array([(0, 1, 2), (0, 2, 3)]))
    parts = cut(whole, view)
    ends = view.pixels(parts.points)[parts.edges()[0]]
    inside = ((ends > 0) & (ends < SIZE)).all(axis=(1, 2))
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[inside].max() <= module.LIVE_EDGE_PX
    a, b, c = (parts.points[parts.corners[:, k]] for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(1.0)


def test_the_paths_are_those_of_a_render(scene):
    picture = Picture()
    update(picture, scene, exact=True)
    pane = picture.panes["Glass"]
    assert pane.paths == kept_paths(scene, pane.glass, picture.view)
    assert optics.LightPath("TTTT") in pane.followed
