# SPDX-License-Identifier: GPL-3.0-or-later
"""The eye of a 3D view."""

from __future__ import annotations

import numpy as np

from ..scene.read.viewpoint import Viewpoint


def view_eye(size: tuple[int, int], view_matrix, window_matrix, is_perspective: bool) -> Viewpoint:
    """The viewpoint of a 3D view of ``size`` pixels, from its (4, 4) matrices.

    A parallel view has no eye and shows what lies behind its matrix's origin too; the eye is then
    put onto the near plane, so that every depth is positive.
    """
    to_camera = np.array(view_matrix, float)
    projection = np.array(window_matrix, float)
    # Blender's matrices are float32: take the nearest rotation, and keep the origin in its place.
    u, _, vt = np.linalg.svd(to_camera[:3, :3])
    rotation = u @ vt
    eye = -np.linalg.solve(to_camera[:3, :3], to_camera[:3, 3])
    if not is_perspective:
        near = (-1.0 - projection[2, 3]) / projection[2, 2]
        eye = eye + near * rotation[2]
        projection[2, 3] = -1.0
    to_camera[:3, :3] = rotation
    to_camera[:3, 3] = -rotation @ eye
    width, height = size
    return Viewpoint(
        eye, to_camera, projection, (width, height), (0, 0, width, height), not is_perspective
    )


def depth_line(view: Viewpoint) -> tuple[float, float, float, float]:
    """(a, b, c, d) so that a depth buffer's value v means a depth of (a + b v) / (c + d v)."""
    p, q = view.projection[2, 2], view.projection[2, 3]
    if view.is_parallel:
        return (1.0 + q, -2.0, p, 0.0)
    return (q, 0.0, p - 1.0, 2.0)
