# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3D view's eye: where points appear and how deep they are, against Blender's own matrices."""

import numpy as np
import pytest

from glass_refraction.viewport.description import Frame
from glass_refraction.viewport.eye import depth_line, least_depth, view_eye

SIZE = (640, 400)
NEAR, FAR = 0.1, 50.0


def perspective(lens=1.5):
    a, b = -(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
    aspect = SIZE[0] / SIZE[1]
    return [(lens, 0, 0.1, 0), (0, lens * aspect, -0.05, 0), (0, 0, a, b), (0, 0, -1, 0)]


def parallel(width=2.0):
    # A parallel 3D view shows what lies behind its origin too: near is -far.
    x, y = 2 / width, 2 / width * SIZE[0] / SIZE[1]
    return [(x, 0, 0, 0.1), (0, y, 0, 0), (0, 0, -1 / FAR, 0), (0, 0, 0, 1)]


TURN, _ = np.linalg.qr([(1.0, 0.3, -0.2), (0.1, 0.4, 0.9), (-0.3, 1.0, 0.5)])
TURN *= np.sign(np.linalg.det(TURN))
STAND = np.array((0.3, -2.0, 1.1))
VIEW = np.float32(np.block([[TURN, -TURN @ STAND[:, None]], [np.zeros(3), 1.0]]))


@pytest.mark.parametrize(("window", "is_perspective"), [(perspective(), True), (parallel(), False)])
def test_points_depths_and_rays_are_those_of_the_matrices(window, is_perspective):
    eye = view_eye(SIZE, VIEW, window, is_perspective)
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (50, 3)) + 2.0 * eye.forward
    points += STAND
    clip = np.column_stack((points, np.ones(50))) @ (np.array(window) @ VIEW).T
    ndc = clip[:, :3] / clip[:, 3:]
    expected = 0.5 * (ndc[:, :2] + 1) * SIZE
    assert eye.pixels(points) == pytest.approx(expected, abs=0.01)

    a, b, c, d = depth_line(eye)
    value = 0.5 * (ndc[:, 2] + 1)
    depth = eye.clip(points)[:, 3]
    assert (depth > 0).all()
    assert (a + b * value) / (c + d * value) == pytest.approx(depth, rel=2e-3)

    origins, directions = eye.rays(*expected.T)
    along = np.einsum("nk,nk->n", points - origins, directions)
    assert (along > 0).all()
    assert origins + along[:, None] * directions == pytest.approx(points, abs=1e-4)
    assert eye.is_parallel != is_perspective


def test_a_parallel_view_counts_as_far_away_as_a_camera_that_shows_as_much():
    """Else the ends of rings kept their lines there."""
    frame = Frame(STAND, 0.1, 1.0)
    width, lens = 2.0, 50.0 / 18.0
    seen = view_eye(SIZE, VIEW, parallel(width), False)
    camera = view_eye(SIZE, VIEW, perspective(lens), True)
    far = least_depth(seen, frame) * frame.unit
    assert 2.0 * far / lens == pytest.approx(width)
    assert least_depth(camera, frame) == 1.0
