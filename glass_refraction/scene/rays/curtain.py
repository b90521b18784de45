# SPDX-License-Identifier: GPL-3.0-or-later
"""What hangs before a capture's camera: a curtain, a pane.

What nobody looks up is hidden behind a curtain, which costs a path tracer nothing. Rays are no
camera's any more behind a pane.

A compositor renders other scenes whole: their own render borders are not asked.
"""

from __future__ import annotations

import numpy as np

from .sum_tree import SHARPENINGS
from .views import RadianceView

BLOCK_PX = 8
"""Side of the curtain's squares, pixels."""
REACH_PX = SHARPENINGS + 4
"""Pixels round a place that its lookup, or a pixel filter, can reach."""
BEHIND_NEAR = 1.05
"""Of the distance at which the view begins to see: where the curtain hangs."""
BEHIND_CURTAIN = 1.1
"""The same, of the pane."""


def looked_up(view: RadianceView, pixels: np.ndarray) -> np.ndarray:
    """(rows, columns) which squares of a view's frame are looked up, or can be reached from there.

    Parameters
    ----------
    pixels : (K, 2) the places in the frame that are looked up.
    """
    width, height = view.size
    columns, rows = -(-width // BLOCK_PX), -(-height // BLOCK_PX)
    used = np.zeros((rows, columns), bool)
    flat = used.ravel()
    # Of all places in a pixel one look is enough.
    x, y = (np.clip(part, 0, most - 1) for part, most in zip(pixels.T, view.size, strict=True))
    cells = np.bincount(y.astype(np.intp) * width + x.astype(np.intp))
    pixels = np.stack(np.divmod(np.flatnonzero(cells), width)[::-1], axis=1)
    # A block is no wider than what is reached: its neighbours count by the reach's ends.
    shifts = (-REACH_PX, 0, REACH_PX)
    x, y = (
        [np.clip((part + d) // BLOCK_PX, 0, count - 1) for d in shifts]
        for part, count in zip(pixels.T, (columns, rows), strict=True)
    )
    for row in y:
        for column in x:
            flat[row * columns + column] = True
    return used


def curtain(view: RadianceView, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) in camera space and quads (F, 4) before all squares that are not looked up."""
    rows = len(used)
    corners = []
    for row in range(rows):
        # Neighbouring squares of a row are one.
        edges = np.diff(np.concatenate(([0], ~used[row], [0])).astype(int))
        for begin, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            corners.append(((begin, row), (end, row), (end, row + 1), (begin, row + 1)))
    if not corners:
        return np.zeros((0, 3)), np.zeros((0, 4), int)
    return _hung(view, np.array(corners) * BLOCK_PX, BEHIND_NEAR * view.near)


def pane(view: RadianceView) -> tuple[np.ndarray, np.ndarray]:
    """The same of one quad before the whole frame."""
    frame = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * view.size
    return _hung(view, frame, BEHIND_CURTAIN * view.near)


def _hung(view: RadianceView, places: np.ndarray, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Quads with corners before pixels of the frame (…, 2), so many metres before the camera."""
    places = places.reshape(-1, 2)
    p, ndc = view.projection, 2.0 * places / view.size - 1.0
    points = np.empty((len(places), 3))
    if view.is_parallel:
        points[:, :2] = (ndc - p[:2, 3]) / p.diagonal()[:2]
    else:
        points[:, :2] = (ndc + p[:2, 2]) / p.diagonal()[:2] * depth
    points[:, 2] = -depth
    return points, np.arange(len(points)).reshape(-1, 4)
