# SPDX-License-Identifier: GPL-3.0-or-later
"""How edges of glasses are drawn wider: shifted by whole pixels."""

from types import SimpleNamespace

import numpy as np
import pytest

from glass_refraction.viewport.eye import overlay_nearer
from glass_refraction.viewport.wires import BESIDE, HERE, _shifted


def test_edges_are_shifted_by_whole_pixels():
    size = (640, 480)
    rng = np.random.default_rng(0)
    to_clip, place = rng.normal(size=(4, 4)), np.append(rng.normal(size=3), 1.0)

    def pixel(matrix):
        clip = matrix @ place
        return 0.5 * (clip[:2] / clip[3] + 1.0) * size

    for shift, columns in zip(BESIDE, _shifted(to_clip, BESIDE, size), strict=True):
        moved = pixel(np.reshape(columns, (4, 4)).T)
        assert moved - pixel(to_clip) == pytest.approx(shift, abs=1e-6)


@pytest.mark.parametrize("degrees", range(0, 180, 15))
def test_every_pixel_beside_an_edge_is_drawn_whatever_its_slant(degrees):
    """An edge has one pixel in each column, or in each row where it is steep."""
    along = np.array((np.cos(np.radians(degrees)), np.sin(np.radians(degrees))))
    edge = np.arange(-20, 21)[:, None] * along / np.abs(along).max()
    shifted = np.round(edge)[:, None] + np.array((HERE, *BESIDE))
    drawn = {tuple(pixel) for pixel in shifted.reshape(-1, 2).astype(int)}
    across = np.array((-along[1], along[0]))
    near = [p for p in np.ndindex(9, 9) if abs((np.array(p) - 4) @ across) <= 1.0]
    assert {(x - 4, y - 4) for x, y in near} <= drawn


@pytest.mark.parametrize(
    ("kind", "expected"), [("PERSP", 0.0), ("ORTHO", 2.5e-5), ("CAMERA", 1e-5)]
)
def test_overlays_draw_lines_nearer_in_parallel_views(kind, expected):
    """By half a hundred-thousandth of the view's distance; a camera's view has its size for it."""
    matrix = np.diag((0.25, 0.5, 1.0, 1.0))
    region = SimpleNamespace(
        is_perspective=kind == "PERSP",
        view_perspective=kind,
        view_distance=5.0,
        window_matrix=matrix,
    )
    assert overlay_nearer(region) == pytest.approx(expected)
