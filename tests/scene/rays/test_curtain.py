# SPDX-License-Identifier: GPL-3.0-or-later
"""The curtain before a capture hides what nobody looks up, and nothing else."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene.rays import true
from glass_refraction.scene.rays.curtain import BLOCK_PX, REACH_PX, curtain, looked_up
from glass_refraction.scene.rays.frame import NO_CURTAIN
from glass_refraction.scene.rays.views import RadianceView


def _view(size=(100, 70), shift=(0.3, -0.2), near=0.02, is_parallel=False):
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 1.5, 1.5 * size[0] / size[1]
    if is_parallel:
        projection[3, 3], projection[:2, 3] = 1.0, shift
    else:
        projection[3, 2], projection[:2, 2] = -1.0, shift
    frame = (0, 0, *size)
    return RadianceView(
        np.zeros(3), np.eye(4), projection, size, frame, frame, near, is_parallel=is_parallel
    )


def _hidden(view, points, quads):
    """(height, width) pixels whose centres lie behind a quad."""
    width, height = view.size
    found = np.zeros((height, width), bool)
    pixels, _ = view.pixels(points)
    for quad in quads:
        low, high = pixels[quad].min(axis=0), pixels[quad].max(axis=0)
        x = np.arange(width) + 0.5
        y = np.arange(height) + 0.5
        found |= np.outer((y > low[1]) & (y < high[1]), (x > low[0]) & (x < high[0]))
    return found


@pytest.mark.parametrize("is_parallel", [False, True])
@pytest.mark.parametrize("count", [0, 1, 5, 200])
def test_it_hides_no_pixel_within_reach_of_a_place(count, is_parallel):
    view = _view(is_parallel=is_parallel)
    random = np.random.default_rng(count)
    places = random.uniform((0, 0), view.size, (count, 2))
    hidden = _hidden(view, *curtain(view, looked_up(view, places)))
    y, x = np.nonzero(hidden)
    apart = np.abs(np.stack((x + 0.5, y + 0.5), axis=1)[:, None] - places[None])
    assert not (apart.max(axis=2) < REACH_PX).any()
    # Beyond, it hides whole blocks.
    beyond = np.abs(np.stack(np.meshgrid(np.arange(100), np.arange(70)), -1)[..., None, :] - places)
    far = (beyond.max(axis=-1) > REACH_PX + BLOCK_PX + 1).all(axis=-1)
    assert hidden[far].all()


def test_it_hangs_before_all_that_the_view_sees():
    view = _view()
    points, quads = curtain(view, looked_up(view, np.array([(50.0, 35.0)])))
    assert len(quads)
    assert (points[:, 2] < -view.near).all()
    assert (points[:, 2] > -1.1 * view.near).all()


def test_the_picture_is_the_same_with_and_without_it(tmp_path, monkeypatch):
    scenes.camera()
    scenes.striped_wall(0.2)
    assert bpy.context.scene.camera
    scene = scenes.settings(64, 48, samples=2, shading="TRUE")
    scenes.glass(shape="CYLINDER", radius=0.04)
    scenes.rod((0.1, -0.6, 0.05))
    with_it = scenes.picture(scene, tmp_path, "with")
    hung = []

    def none(view, role, _):
        hung.append(view)
        hang(view, role, NO_CURTAIN)

    hang = true._hang
    monkeypatch.setattr(true, "_hang", none)
    without = scenes.picture(scene, tmp_path, "without")
    assert hung
    # The compositor's convolution rounds by what all pixels are.
    np.testing.assert_allclose(with_it, without, rtol=0.0, atol=1e-6)
