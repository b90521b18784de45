# SPDX-License-Identifier: GPL-3.0-or-later
"""What surrounds the shader: its rays' block, the faces of captures, rectangles."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.viewport import capture, paint
from glass_refraction.viewport.description import Posed, common_frame
from glass_refraction.viewport.eye import CAPTURES, common_line, depths, pack_view, view_eye
from glass_refraction.viewport.model import captures_of

SIZE = (640, 400)
PERSPECTIVE = [(1.5, 0, 0.1, 0), (0, 2.4, -0.05, 0), (0, 0, -1.004, -0.2004), (0, 0, -1, 0)]
PARALLEL = [(1.0, 0, 0, 0.1), (0, 1.6, 0, 0), (0, 0, -1 / 50, 0), (0, 0, 0, 1)]


def glass(place=(0.1, 0.2, 0.3)):
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return Posed(optics.body(optics.SphereGlass((0.05,), (1.5,))), matrix)


@pytest.mark.parametrize(("window", "is_perspective"), [(PERSPECTIVE, True), (PARALLEL, False)])
def test_rays_and_depths_of_the_block_are_the_views(window, is_perspective):
    matrix = np.eye(4)
    matrix[:3, 3] = (-0.1, -0.2, -1.3)
    view = view_eye(SIZE, matrix, window, is_perspective)
    frame = common_frame([glass()])
    block = pack_view(view, frame, [], 0, 2.0).astype(float)
    pixels = np.array([(10.5, 20.5), (320.0, 200.0), (600.5, 380.5)])
    origins, directions = view.rays(*pixels.T)
    plane, right, up, eye = block[6, :3], block[7, :3], block[8, :3], block[9]
    places = plane + pixels[:, :1] * right + pixels[:, 1:] * up
    along = places - eye[:3] if is_perspective else np.broadcast_to(eye[:3], places.shape)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    assert along == pytest.approx(directions, abs=1e-5)
    shift = places - frame.place(origins)
    assert np.cross(shift, directions) == pytest.approx(0.0, abs=1e-4 * np.abs(shift).max())
    # Depths by the matrix's row and by the depth buffer's value are the same.
    world = frame.origin + frame.unit * places
    common = np.column_stack((places, np.ones(3)))
    clip = common @ block[:4]
    value = 0.5 * (clip[:, 2] / clip[:, 3] + 1.0)
    found = depths(common_line(view, frame), value)
    assert common @ block[4] == pytest.approx(found, abs=2e-3)
    assert view.pixels(world) == pytest.approx(pixels, abs=0.01)
    assert block[10, 2:] == pytest.approx(depths(common_line(view, frame), np.array([0.0, 1.0])))


@pytest.mark.parametrize("face", range(capture.FACES))
def test_a_face_looks_along_its_axis_and_is_no_mirror_image(face):
    right, up, forward = capture.axes(face)
    assert np.cross(right, up) == pytest.approx(-forward)
    centre = np.array((1.0, 2.0, 3.0))
    ahead = np.append(centre + 2.0 * forward + 0.5 * right, 1.0)
    clip = (
        capture.face_projection(0.1, 10.0) @ capture.face_view(capture.axes(face), centre) @ ahead
    )
    assert clip[:2] / clip[3] == pytest.approx((0.25, 0.0))
    assert clip[3] == pytest.approx(2.0)


def test_a_close_picture_looks_where_it_is_told():
    rng = np.random.default_rng(3)
    for along in (*np.eye(3), *-np.eye(3), *rng.normal(size=(20, 3))):
        right, up, forward = rows = capture.aimed(along)
        assert rows @ rows.T == pytest.approx(np.eye(3))
        assert np.cross(right, up) == pytest.approx(-forward)
        assert forward == pytest.approx(along / np.linalg.norm(along))


def test_how_far_a_box_is_along_a_ray_is_told_by_points_on_the_way():
    rng = np.random.default_rng(6)
    box = box_at((0.1, -0.2, 0.3), (0.2, 0.05, 0.4))
    met = 0
    for _ in range(300):
        one, along = rng.uniform(-0.8, 0.8, 3), rng.normal(size=3)
        along /= np.linalg.norm(along)
        way = box.way_from(one, along)
        if np.isfinite(way):
            assert box.distance((one + way * along)[None])[0] == pytest.approx(0.0, abs=1e-9)
            met += 1
        else:
            parts = np.linspace(0.0, 4.0, 401)[:, None]
            assert box.distance(one + parts * along).min() > -1e-3
    assert 10 < met < 290


def test_close_pictures_stay_while_they_look_nearly_where_they_should():
    captures = capture.Captures()
    captures.centres = [np.zeros(3)]
    captures.aim({0: np.array((0.0, 1.0, 0.0))})
    assert captures.left == 1
    captures._stale.clear()
    captures.aim({0: np.array((0.5 * capture.AIM_KEPT, 1.0, 0.0))})
    assert captures.left == 0
    captures.aim({0: np.array((2.0 * capture.AIM_KEPT, 1.0, 0.0))})
    assert captures.left == 1
    captures.aim({})
    assert captures.left == 0


def test_all_faces_are_drawn_in_turn_though_each_motion_outdates_them():
    captures = capture.Captures()
    captures.glasses = 2
    faces = []
    for _ in range(4 * capture.FACES):
        captures.outdate()
        faces.append(captures._next())
        captures._note(*faces[-1])
    half = 2 * capture.FACES
    assert faces[:half] == sorted(set(faces)) == faces[half:]


def test_a_capture_stands_in_the_glass_and_out_of_the_way_of_things():
    one = glass()
    middle = one.middle()
    assert capture.centre_of(one, [], middle) == pytest.approx(middle)
    to_box = np.eye(4)
    to_box[:3, 3] = -middle
    box = capture.Box(to_box, np.array((0.02, 0.02, 0.02)))
    found = capture.centre_of(one, [box], middle)
    assert box.distance(found[None])[0] > 0.0
    assert np.all(np.abs(found - middle) <= 0.05)
    # A place that is as good as any stays.
    assert capture.centre_of(one, [box], found) == pytest.approx(found)
    assert box.corners == pytest.approx(middle + 0.02 * np.sign(box.corners - middle), abs=1e-12)


def test_a_capture_stands_in_a_pane_and_not_in_the_bar_between_two():
    """It stood in the bar, which hid what the panes mirror."""
    one = glass()
    middle = one.middle()
    box = box_at(middle, (0.05, 0.05, 0.05))
    square = 0.1 * np.array(((0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)))
    sides = [middle + square + (x, 0.0, 0.0) for x in (-0.001, 0.001)]
    faces = np.array([side[list(three)] for side in sides for three in ((0, 1, 2), (0, 2, 3))])
    framed = capture.framed(box, faces)
    assert box.distance(middle[None])[0] < 0.0
    found = capture.centre_of(one, [framed], middle)
    assert np.abs(found - middle)[0] > 0.01
    assert capture.framed(box, faces[:0]) is box


def test_the_distance_to_faces_is_that_to_their_nearest_point():
    rng = np.random.default_rng(6)
    faces = rng.uniform(-1.0, 1.0, (5, 3, 3))
    framed = capture.framed(box_at(np.zeros(3), np.ones(3)), faces)
    places = rng.uniform(-1.5, 1.5, (40, 3))
    shares = rng.dirichlet(np.ones(3), 60_000)
    for place, found in zip(places, framed.distance(places), strict=True):
        edges = np.linspace(0.0, 1.0, 2001)[:, None]
        points = [shares @ face for face in faces]
        points += [a + edges * (b - a) for f in faces for a, b in zip(f, f[[1, 2, 0]], strict=True)]
        points = np.concatenate(points)
        assert found == pytest.approx(np.linalg.norm(points - place, axis=1).min(), abs=4e-3)


def box_at(place, half):
    to_box = np.eye(4)
    to_box[:3, 3] = -np.asarray(place)
    return capture.Box(to_box, np.array(half))


def test_a_box_lies_between_places_as_points_on_the_way_tell():
    rng = np.random.default_rng(5)
    box = box_at((0.1, -0.2, 0.3), (0.2, 0.05, 0.4))
    one, places = np.array((-0.6, -0.5, 0.2)), rng.uniform(-1.0, 1.0, (2000, 3))
    parts = np.linspace(0.0, 1.0, 801)[:, None]
    distance = [box.distance(one + parts * (place - one)).min() for place in places]
    found, clear = box.lies_between(one, places), np.abs(distance) > 2e-3
    np.testing.assert_array_equal(found[clear], (np.array(distance) < 0.0)[clear])
    assert 100 < found.sum() < 1900


def test_a_second_capture_stands_behind_what_hides_much_from_the_first():
    one = glass()
    middle = one.middle()
    first = middle - np.array((0.02, 0.0, 0.0))
    plate = box_at(middle, (0.002, 0.04, 0.04))
    found = capture.second_centre_of(one, [plate], first)
    assert plate.lies_between(first, found[None])[0]
    assert plate.distance(found[None])[0] > 0.01
    straw = box_at(middle, (0.002, 0.002, 0.1))
    room = box_at(middle, (1.0, 1.0, 1.0))
    assert capture.second_centre_of(one, [], first) is None
    assert capture.second_centre_of(one, [straw, room], first) is None


def test_glasses_without_a_capture_of_their_own_share_the_nearest():
    places = [np.array((float(k), 0.0, 0.0)) for k in range(CAPTURES)]
    more = [np.array((2.2, 0.1, 0.0)), np.array((0.0, 5.0, 0.0))]
    assert captures_of([*places, *more]) == [*range(CAPTURES), 2, 0]
    assert captures_of([]) == []


def test_rectangles_that_meet_become_one_and_cover_the_same():
    rects = [(0.0, 0.0, 0.2, 0.2), None, (0.5, 0.5, 0.6, 0.6), (0.1, 0.1, 0.55, 0.3)]
    assert sorted(paint.merged(rects)) == [(0.0, 0.0, 0.55, 0.3), (0.5, 0.5, 0.6, 0.6)]
    assert paint.merged([*rects, (0.5, 0.2, 0.6, 0.6)]) == [(0.0, 0.0, 0.6, 0.6)]
