# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur in the glass: where all stands while the shutter is open, and whole pictures."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene import update as door
from glass_refraction.scene.rays.blur import PARTS
from glass_refraction.scene.rays.exits import TIMES, TimePiece, _times
from glass_refraction.scene.rays.hits import Ways
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.shutter import Moment, Shutter, put_back
from glass_refraction.scene.rays.things import Met, Things
from glass_refraction.scene.read.glasses import Glass
from glass_refraction.scene.read.mesh_glasses import MeshGlass
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import Viewpoint

SIZE = (64, 48)

# ------------------------------------------------------------------------- where all stands


def _pose(angle, place):
    pose = np.array(Matrix.Rotation(angle, 4, (1.0, 2.0, -0.5)), float)
    # Blender's own are of single precision.
    u, _, vt = np.linalg.svd(pose[:3, :3])
    pose[:3, :3], pose[:3, 3] = u @ vt, place
    return pose


def _view(angle, place):
    to_camera = np.linalg.inv(_pose(angle, place))
    projection = np.diag((1.5, 2.0, -1.0, 0.0))
    projection[3, 2] = -1.0
    return Viewpoint(np.array(place, float), to_camera, projection, SIZE, (0, 0, *SIZE), False)


def _things(points):
    looks = (Look(),)
    return Things(points, np.array([(0, 1, 2)], np.int32), np.zeros(1, np.int32), looks, ("a",))


def _moment(time, angle, place, points):
    tube = optics.CylinderGlass((0.04,), (1.5,), extent=(0.0, 1.0))
    glass = Glass("tube", tube, _pose(angle, place))
    return Moment(time, _view(angle, place), (glass,), _things(points))


def _shutter(angles, places, points, opens=0.5, closes=1.5):
    times = np.linspace(opens, closes, len(angles))
    moments = [_moment(*one) for one in zip(times, angles, places, points, strict=True)]
    own = moments[len(moments) // 2]
    shutter = Shutter(opens, closes, own, (own,))
    return shutter.with_moments(m for m in moments if m is not own), moments


def test_all_that_moves_goes_straight_and_turns_evenly_between_moments():
    random = np.random.default_rng(5)
    places, points = random.normal(size=(3, 3)), random.normal(size=(3, 3, 3))
    angles = np.array((-0.7, 0.1, 0.9))
    shutter, moments = _shutter(angles, places, points)
    for part in (0.0, 0.1, 0.25, 0.5, 0.8, 1.0):
        found = shutter.at(part)
        first = int(part > 0.5)
        angle, place, corners = (
            a[first] + (2 * part - first) * (a[first + 1] - a[first])
            for a in (angles, places, points)
        )
        wanted = _pose(angle, place)
        np.testing.assert_allclose(found.glasses[0].to_world, wanted, atol=1e-7)
        np.testing.assert_allclose(np.linalg.inv(found.view.to_camera), wanted, atol=1e-7)
        np.testing.assert_allclose(found.view.eye, place)
        np.testing.assert_allclose(found.things.points, corners)
        turn = found.glasses[0].to_world[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert shutter.at(0.5).time == moments[1].time
    assert not shutter.moves_camera_alone


def test_beyond_the_moments_that_are_known_all_stands_where_the_last_has_it():
    points = np.zeros((3, 3, 3))
    shutter, moments = _shutter((0.1, 0.2, 0.3), np.zeros((3, 3)), points)
    late = replace(shutter, opens=0.0, closes=2.0)
    assert late.at(0.0) is shutter.moments[0] and late.at(1.0) is shutter.moments[-1]
    alone = Shutter(0.5, 1.5, moments[1], (moments[1],))
    assert alone.at(0.9) is moments[1] and alone.moves_camera_alone
    moving = alone.with_moments([replace(moments[1], time=1.5, view=moments[2].view)])
    assert moving.moves_camera_alone and alone.is_still and not moving.is_still


def test_a_mesh_is_between_its_moments_and_one_that_changes_stays_the_frames():
    random = np.random.default_rng(7)
    corners = random.normal(size=(2, 4, 3, 3))
    normals = random.normal(size=(2, 4, 3, 3))
    normals /= np.linalg.norm(normals, axis=3, keepdims=True)
    still = _things(np.zeros((3, 3)))

    def moment(time, number, count=4):
        mesh = MeshGlass(corners[number, :count], normals[number, :count], 1.5)
        return Moment(time, _view(0.0, (0, 0, 0)), (Glass("cup", mesh, np.eye(4)),), still)

    own = moment(1.0, 0)
    shutter = Shutter(1.0, 2.0, own, (own,)).with_moments([moment(2.0, 1)])
    found = shutter.at(0.25).glasses[0].description
    np.testing.assert_allclose(found.points, 0.75 * corners[0] + 0.25 * corners[1])
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=2), 1.0)
    other = Shutter(1.0, 2.0, own, (own,)).with_moments([moment(2.0, 1, count=3)])
    np.testing.assert_array_equal(other.at(0.9).glasses[0].description.points, corners[0])


def test_what_rays_meet_is_put_where_the_same_spot_is_in_the_frame():
    random = np.random.default_rng(3)
    then, now = (_things(random.normal(size=(3, 3))) for _ in range(2))
    shares = random.dirichlet((1.0, 1.0, 1.0), size=20)
    places, wanted = shares @ then.points, shares @ now.points
    direction = random.normal(size=(20, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    way = random.uniform(0.5, 2.0, 20)
    triangle = np.zeros(20, np.int32)
    triangle[-1] = -1
    ways = Ways(
        np.arange(20),
        np.zeros(20, np.int64),
        np.ones(20),
        np.ones((20, 3)),
        places - way[:, None] * direction,
        direction,
        np.where(triangle < 0, np.inf, way),
        triangle,
        np.zeros(20, np.int16),
        np.zeros(20, bool),
    )
    found = put_back(ways, then, now)
    np.testing.assert_allclose(found.point[:-1], wanted[:-1], atol=1e-12)
    np.testing.assert_array_equal(found.origin[-1], ways.origin[-1])
    np.testing.assert_array_equal(found.direction, direction)
    assert put_back(ways, then, then) is ways
    met = Met(triangle[:-1], way[:-1], ways.origin[:-1], direction[:-1])
    np.testing.assert_allclose(then.shares(met), shares[:-1], atol=1e-12)


@pytest.mark.parametrize("turns", [1, 2, 3])
@pytest.mark.parametrize("count", [12, 28])
def test_each_ray_of_a_pixel_has_its_time_once(count, turns):
    times = _times(count)
    np.testing.assert_allclose(np.sort(times), (np.arange(count) + 0.5) / count)
    pixels, rays = np.arange(500), np.zeros((500, count), int)
    middles = []
    for number in range(PARTS * turns):
        piece = TimePiece(number, PARTS, turns)
        rays += piece.has(pixels)[:, None] & piece.holds(times)
        middles.append(piece.middle)
        held = times[piece.holds(times)]
        assert np.all(np.abs(held - piece.middle) <= 1.0 / PARTS)
    assert (rays == 1).all()
    np.testing.assert_allclose(np.diff(middles), 1.0 / (PARTS * turns))
    assert set(TIMES) >= {12, 28}


# --------------------------------------------------------------------------- whole pictures


def _scene(engine, samples=16, **given):
    scene = scenes.settings(*SIZE, samples=samples, shading="TRUE", **given)
    scene.render.engine, scene.eevee.taa_render_samples = engine, samples
    if engine == "BLENDER_EEVEE":
        scenes.coarse_eevee(scene)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    return scene


def _move(obj, path, way):
    """Let an object be where it is in frame 2, and pass there at an even pace, metres a frame."""
    place = np.array(getattr(obj, path))
    for frame in (1, 3):
        setattr(obj, path, place + (frame - 2) * np.array(way))
        obj.keyframe_insert(path, frame=frame)
    scenes.linear(obj)


def _problems(scene):
    return door.memory_of(scene).status.problems


def _dark_pane(engine):
    """A dark pane before a bright wall; its right edge is in the picture's middle."""
    scenes.camera(location=(0.0, -0.5, 0.0), tilt=np.pi / 2, clip_start=0.01)
    bpy.ops.mesh.primitive_plane_add(size=9, location=(0, 0.5, 0), rotation=(np.pi / 2, 0, 0))
    bpy.context.object.data.materials.append(scenes.emissive("bright", (0.5, 0.5, 0.5)))
    scene = _scene(engine, surface="REFRACTION")
    pane = scenes.glass(shape="SLAB", radius=0.2, wall_thickness=0.001, ior=1.01)
    pane.location, pane.rotation_euler = (-0.2, -0.2, 0.0), (np.pi / 2, 0.0, 0.0)
    write_input(glass_modifier(pane), "Absorption Color", (1e-6, 1e-6, 1e-6, 1.0))
    write_input(glass_modifier(pane), "Absorption Distance", 1e-4)
    return scene, pane


@pytest.mark.parametrize("position", ["CENTER", "START"])
@pytest.mark.parametrize("mover", ["pane", "camera"])
@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_the_edge_of_a_glass_that_passes_is_a_ramp(tmp_path, engine, mover, position):
    if engine == "BLENDER_EEVEE" and position == "START":
        pytest.skip("the engines share what the shutter's times are read by")
    scene, pane = _dark_pane(engine)
    scene.render.motion_blur_position = position
    speed = 0.06
    _move(pane if mover == "pane" else scene.camera, "location", (speed, 0.0, 0.0))
    scene.frame_set(2)
    found = scenes.picture(scene, tmp_path)[12:36, :, 0].mean(axis=0) / 0.5
    assert _problems(scene) == []
    width = 64 * 50 / 36 * 0.5 * speed / 0.3
    left = {"CENTER": -0.5 * width, "START": 0.0 if mover == "pane" else -width}[position]
    assert width > 8.0
    wanted = np.clip((np.arange(64) - 31.5 - left) / width, 0.0, 1.0)
    np.testing.assert_allclose(found, wanted, atol=0.06)
    if engine == "CYCLES":
        real = render_reference(scene, samples=64, surface="REFRACTION")
        real = real[12:36, :, 0].mean(axis=0) / 0.5
        np.testing.assert_allclose(real, wanted, atol=0.06)


@pytest.mark.parametrize("mover", ["wall", "camera", "glass", "camera and glass", "all"])
def test_through_a_glass_that_hardly_refracts_motion_is_blurred_as_without(tmp_path, mover):
    eyes = scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    wall = scenes.striped_wall(0.2, stripes=16)
    scene = _scene("CYCLES", samples=64, surface="REFRACTION")
    glass = scenes.glass(shape="CYLINDER", ior=1.0001)
    moving = {"wall": [wall], "camera": [eyes], "glass": [glass], "all": [wall, eyes, glass]}
    moving["camera and glass"] = [eyes, glass]
    for obj in moving[mover]:
        against = obj is eyes and mover == "all"
        _move(obj, "location", (-0.05 if against else 0.05, 0.0, 0.0))
    scene.frame_set(2)
    through = scenes.picture(scene, tmp_path, "through")
    assert _problems(scene) == []
    covered = door.memory_of(scene).covered
    scene.refractive_glass.enabled, glass.hide_render = False, True
    direct = scenes.picture(scene, tmp_path, "direct")
    scene.render.use_motion_blur = False
    sharp = scenes.picture(scene, tmp_path, "sharp")
    # The wall's stripes are upright: along them noise is averaged out.
    within = covered[12:36].all(axis=0)
    columns = [p[12:36, within, :3].mean(axis=0) for p in (through, direct, sharp)]
    off, blur = (np.abs(columns[1] - other).mean() for other in (columns[0], columns[2]))
    assert within.sum() > 10 and off < 0.015
    assert mover == "glass" or off < 0.2 * blur


def test_a_frame_with_motion_blur_is_the_same_alone(tmp_path):
    eyes = scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    wall = scenes.striped_wall(0.2)
    scene = _scene("BLENDER_EEVEE", samples=2)
    glass = scenes.glass(shape="CYLINDER")
    for obj in (wall, eyes, glass):
        _move(obj, "location", (0.02, 0.0, 0.0))
    run = scenes.animation(scene, tmp_path, [1, 2, 3])
    door.forget()
    scene.frame_set(2)
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path, "alone"), run[2])


def test_motion_blur_without_room_for_a_sharp_view_is_told_of(tmp_path):
    eyes = scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    wall = scenes.striped_wall(0.2)
    scene = _scene("CYCLES", samples=1)
    scenes.glass(shape="CYLINDER")
    holder = bpy.data.objects.new("Holder", None)
    scene.collection.objects.link(holder)
    wall.parent, scene.refractive_glass.captures = holder, 1
    # Its colour is keyed, not its place.
    wall.keyframe_insert("color", frame=1)
    scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
    holder.keyframe_insert("location", frame=1)
    scenes.picture(scene, tmp_path)
    (line,) = _problems(scene)
    assert '"Wall" may move' in line and "two captures" in line
    eyes.keyframe_insert("location", frame=1)
    scene.refractive_glass.captures = 2
    scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
