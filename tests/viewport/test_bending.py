# SPDX-License-Identifier: GPL-3.0-or-later
"""Which glasses displaced vertices show, and the frames and numbers that their shader gets."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.viewport import bending as module
from glass_refraction.viewport.bending import ByRays, bending, course_of
from glass_refraction.viewport.description import Posed, common_frame
from glass_refraction.viewport.eye import view_eye

SIZE = (640, 400)
SQUARE = [(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]
TURN, _ = np.linalg.qr([(1.0, 0.3, -0.2), (0.1, 0.4, 0.9), (-0.3, 1.0, 0.5)])
TURN *= np.sign(np.linalg.det(TURN))
POSE = np.block([[TURN, np.array([[0.5], [-0.2], [0.3]])], [np.zeros(3), 1.0]])

TUBE = optics.CylinderGlass((0.04, 0.03), (1.5, 1.0), extent=(-0.1, 0.1))
BALL = optics.SphereGlass((0.05, 0.04), (1.5, 1.0))
STACK = optics.FlatGlass((0.02, 0.01), (1.5, 1.7), ior_below=1.3, outline=SQUARE)


def view_from(local, parallel=False):
    """The view of a 3D view from a place in a glass's frame, towards the glass's origin."""
    eye = TURN @ np.array(local, float) + POSE[:3, 3]
    back = eye - POSE[:3, 3]
    back /= np.linalg.norm(back)
    side = np.cross((0.2, 0.3, 0.9), back)
    side /= np.linalg.norm(side)
    to_camera = np.eye(4)
    to_camera[:3, :3] = side, np.cross(back, side), back
    to_camera[:3, 3] = -to_camera[:3, :3] @ eye
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 3.0, 3.0 * SIZE[0] / SIZE[1]
    projection[2] = (0.0, 0.0, -1.002, -0.02)
    projection[3, 2] = -1.0
    if parallel:
        projection[2], projection[3] = (0.0, 0.0, -0.01, 0.0), (0.0, 0.0, 0.0, 1.0)
    return view_eye(SIZE, to_camera, projection, not parallel)


def posed(glass):
    return Posed(optics.body(glass), POSE)


@pytest.mark.parametrize(
    ("glass", "eye"),
    [
        (TUBE, (0.3, 0.1, 0.2)),
        (BALL, (-0.2, 0.3, -0.4)),
        (BALL, (0.0, 0.0, 0.5)),
        (STACK, (0.1, -0.05, 0.4)),
        (STACK, (-0.1, 0.2, -0.5)),
    ],
)
def test_what_is_not_bent_lies_where_the_view_shows_it(glass, eye):
    view, one = view_from(eye), posed(glass)
    bent = bending(0, one, view)
    frame = common_frame([one])
    block = bent.block(view, frame, np.eye(4)).astype(float)
    world = POSE[:3, 3] + np.random.default_rng(2).normal(0.0, 0.1, (50, 3))
    homogeneous = np.column_stack((world, np.ones(50)))
    local = (homogeneous @ bent.from_world.T)[:, :3]
    # As the shader does: a vector from the eye, and the eye itself.
    clip = np.column_stack((local - bent.eye, np.zeros(50))) @ block[:4] + block[8]
    assert clip == pytest.approx(homogeneous @ (view.projection @ view.to_camera).T, abs=1e-5)
    common = np.column_stack((local, np.ones(50))) @ block[4:8]
    assert common[:, :3] == pytest.approx(frame.place(world), abs=1e-5)
    # The eye is where the frame says, and lengths are those of the glass's unit.
    assert bent.from_world @ np.append(view.eye, 1.0) == pytest.approx([*bent.eye, 1.0], abs=1e-6)
    linear = bent.from_world[:3, :3] * one.body.scale
    assert linear @ linear.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(linear) > 0.0


def test_a_tube_keeps_its_axis_and_a_ball_its_middle():
    for glass in (TUBE, BALL):
        bent = bending(3, posed(glass), view_from((0.2, 0.3, 0.05)))
        assert bent.number == 3
        assert bent.eye[1:] == pytest.approx((0.0, 0.0))
        assert bent.inner == pytest.approx(glass.radius[1] / glass.radius[0])
        axis = bent.from_world[:3, :3] @ TURN[:, 2] * glass.radius[0]
        if glass is TUBE:
            assert axis == pytest.approx((0.0, 0.0, 1.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_layers_come_in_the_order_in_which_light_from_the_eye_meets_them(side):
    bent = bending(0, posed(STACK), view_from((0.05, 0.02, side * 0.4)))
    unit = bent.from_world[:3, :3]
    scale = 1.0 / np.cbrt(np.linalg.det(unit))
    thickness, ior = np.array(bent.layers).T
    away = 0.4 if side > 0.0 else 0.4 - sum(STACK.thickness)
    inner, media = list(STACK.thickness), [1.0, *STACK.ior, 1.3]
    if side < 0.0:
        inner.reverse()
        media.reverse()
    assert thickness * scale == pytest.approx([away, *inner, 0.0], abs=1e-6)
    assert ior == pytest.approx(media)
    assert bent.floor * scale == pytest.approx(sum(STACK.thickness))
    # The course is that of the rays that ``optics`` follows.
    faces = [0, 1, 2] if side > 0.0 else [2, 1, 0]
    assert bent.course == course_of(faces)
    assert bent.held == 0


def test_courses_tell_interfaces_and_their_order():
    courses = {
        course_of(list(faces))
        for faces in [(), (0,), (0, 0), (0, 3), (3, 0), (0, 3, 3, 0), (0, 1, 2), (2, 1, 0)]
    }
    assert len(courses) == 8
    longest = course_of([module.COURSE_BASE - 2] * module.MOST_DIGITS)
    assert longest < 2**31
    # And the whole path of a tube begins with that to its contents.
    bent = bending(0, posed(TUBE), view_from((0.3, 0.0, 0.0)))
    assert bent.course // module.COURSE_BASE**2 == bent.held


EYE = (0.3, 0.1, 0.25)


@pytest.mark.parametrize(
    ("glass", "eye", "reason"),
    [
        (optics.CylinderGlass((0.02,), (1.5,), extent=(0.0, 0.1)), EYE, module.SEVERAL),
        (optics.CylinderGlass((0.04, 0.03), (1.5, 1.33), extent=(0, 0.1)), EYE, module.SEVERAL),
        (optics.SphereGlass((0.05,), (1.5,)), EYE, module.SEVERAL),
        (optics.Tumbler(0.04, 0.003, 0.1, 0.008), EYE, module.SEVERAL),
        (
            optics.CylinderGlass((0.04, 0.03), (1.2, 1.33), 1.33, extent=(0, 0.1)),
            EYE,
            module.CLEAR,
        ),
        (TUBE, (0.01, 0.0, 0.05), module.WITHIN),
        (STACK, (0.01, 0.0, -0.01), module.WITHIN),
    ],
)
def test_rays_show_what_has_several_images(glass, eye, reason):
    with pytest.raises(ByRays, match=reason):
        bending(0, posed(glass), view_from(eye))


def test_rays_show_parallel_views_and_dispersing_glasses():
    with pytest.raises(ByRays, match=module.PARALLEL):
        bending(0, posed(TUBE), view_from(EYE, parallel=True))
    with pytest.raises(ByRays, match=module.DISPERSES):
        bending(0, posed(TUBE), view_from(EYE), disperses=True)
    thickness = (0.01,) * module.MOST_LAYERS
    iors = tuple(1.3 + 0.05 * k for k in range(module.MOST_LAYERS))
    with pytest.raises(ByRays, match=module.LAYERS):
        bending(0, posed(optics.FlatGlass(thickness, iors, outline=SQUARE)), view_from(EYE))
