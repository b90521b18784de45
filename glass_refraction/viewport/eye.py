# SPDX-License-Identifier: GPL-3.0-or-later
"""The eye of a 3D view, and what the shader needs to know of it."""

from __future__ import annotations

import numpy as np

from ..scene.read.viewpoint import Viewpoint
from .description import Frame

CAPTURES = 8
"""Captures that the shader's block has room for."""

WORLD = CAPTURES
"""Number of the one after them, which shows the world alone."""

LAMPS = 16
"""Lamps that it has room for: the strongest."""

LAMP_ROWS = 5
NO_LAMPS = np.zeros((0, 4))

VIEW_ROWS = 12 + 4 * (WORLD + 1) + LAMP_ROWS * LAMPS
"""Rows of four floats in the block of a view."""

LEAST_AHEAD = 0.5
"""How far ahead of the eye, in units of the common frame, the plane lies that rays are led through,
should the glasses be nearer or behind it."""

DEPTH_OF_WIDTH = 50.0 / 36.0
"""Depth over width of what a camera shows: of its lens, 50 mm on 36 mm."""

NO_LIMIT = 1e30
"""More than any light."""

MARGIN = 1.01
"""By how much the ball in which rays begin is larger than what the glasses fill."""


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


def overlay_nearer(region_3d) -> float:
    """By how much, in clip space, overlays draw lines nearer in a parallel view; else 0.

    It grows with how far such a view says that it is, and may be many times the glasses' size
    (`GPU_polygon_offset_calc`). In perspective it is a small part of the depth.
    """
    if region_3d.is_perspective:
        return 0.0
    distance = region_3d.view_distance
    if region_3d.view_perspective == "CAMERA":
        distance = 1.0 / max(abs(region_3d.window_matrix[k][k]) for k in range(2))
    return 0.5e-5 * distance


def least_depth(view: Viewpoint, frame: Frame) -> float:
    """Depth, in units of the common frame, of which differences of lines' depths are part at least.

    A parallel view has no depth of its own: it counts as far away as a view in perspective whose
    picture is as wide there.
    """
    if not view.is_parallel:
        return 1.0
    return max(1.0, DEPTH_OF_WIDTH * pixel_width(view, frame)[0] * max(view.size))


def depth_line(view: Viewpoint) -> tuple[float, float, float, float]:
    """(a, b, c, d) so that a depth buffer's value v means a depth of (a + b v) / (c + d v)."""
    p, q = view.projection[2, 2], view.projection[2, 3]
    if view.is_parallel:
        return (1.0 + q, -2.0, p, 0.0)
    return (q, 0.0, p - 1.0, 2.0)


def depth_begin(view: Viewpoint, frame: Frame) -> float:
    """Depth along the view, in units of the common frame, from which the shader counts.

    A parallel view's near plane may be a kilometre before the glasses: single precision would not
    tell what lies there apart. Its depths are counted from the middle of the glasses.
    """
    if not view.is_parallel:
        return 0.0
    return float(-view.to_camera[2] @ np.append(frame.origin, 1.0)) / frame.unit


def common_line(view: Viewpoint, frame: Frame) -> tuple[float, float, float, float]:
    """As `depth_line`, for depths in units of the common frame from `depth_begin` on."""
    a, b, c, d = depth_line(view)
    begin = depth_begin(view, frame) * frame.unit
    return (a - begin * c, b - begin * d, c * frame.unit, d * frame.unit)


def depths(line: tuple[float, float, float, float], values: np.ndarray) -> np.ndarray:
    """Depths that a depth buffer's values mean, by the numbers of `common_line`."""
    a, b, c, d = line
    return (a + b * values) / (c + d * values)


def pixel_width(view: Viewpoint, frame: Frame) -> tuple[float, float]:
    """(a, b) so that a pixel is a + b z wide at a depth of z, both in units of the common frame."""
    width = float(np.linalg.norm(view.ray_matrix()[:, 0]))
    return (width / frame.unit, 0.0) if view.is_parallel else (0.0, width)


def pack_view(
    view: Viewpoint,
    frame: Frame,
    captures: list[tuple[np.ndarray, int, np.ndarray | None]],
    seconds: int,
    scene_reach: float,
    lamps: np.ndarray = NO_LAMPS,
    limits: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """The shader's block of a view, float32; see ``View`` in :mod:`glsl`.

    Parameters
    ----------
    captures : for each its centre (3,) in the world, the pixels of a face's side, 0 while nothing
        of it is drawn, and of its close picture (3, 3) rows as `capture.aimed` gives them, or None;
        the world's is number `WORLD`.
    seconds : how many numbers after a glass's capture its second one comes.
    scene_reach : metres from the frame's origin within which all things are.
    lamps, limits : see `lamps.Lamps`.
    """
    to_world, unit = frame.to_world(), frame.unit
    block = np.zeros((VIEW_ROWS, 4))
    # Column by column, as GLSL keeps matrices.
    block[:4] = (view.projection @ view.to_camera @ to_world).T
    begin = depth_begin(view, frame)
    block[4] = -view.to_camera[2] @ to_world / unit
    block[4, 3] -= begin
    line = common_line(view, frame)
    near, far = (float(v) for v in depths(line, np.array([0.0, 1.0])))
    longest = 2.0 * frame.reach + 2.0 * scene_reach / unit
    middle = float(-view.to_camera[2] @ np.append(frame.origin, 1.0)) / unit
    matrix = view.ray_matrix()
    if view.is_parallel:
        place = matrix[:, 3] + view.forward * middle * unit
        block[6, :3] = (place - frame.origin) / unit
        block[7, :3], block[8, :3] = matrix[:, 0] / unit, matrix[:, 1] / unit
        block[9] = (*view.forward, 0.0)
    else:
        ahead = max(middle, LEAST_AHEAD)
        place = (view.eye - frame.origin) / unit
        block[6, :3] = place + ahead * matrix[:, 3]
        block[7, :3], block[8, :3] = ahead * matrix[:, 0], ahead * matrix[:, 1]
        block[9] = (*place, 1.0)
    block[5] = *pixel_width(view, frame), *(limit or NO_LIMIT for limit in limits)
    block[10] = *view.size, near, far
    block[11] = MARGIN * frame.reach, seconds, longest, len(lamps) // LAMP_ROWS
    block[12 + 4 * (WORLD + 1) :][: len(lamps)] = lamps
    for number, (centre, side, close) in enumerate(captures):
        block[12 + number] = *frame.place(centre), side
        if close is not None:
            right, up, forward = close
            rows = block[13 + WORLD + 3 * number :]
            rows[0], rows[1, :3], rows[2, :3] = (*forward, 1.0), right, up
    return block.astype(np.float32)
