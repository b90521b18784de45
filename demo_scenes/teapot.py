# SPDX-License-Identifier: GPL-3.0-or-later
"""The Utah teapot, evaluated from Martin Newell's published Bezier control points.

32 bicubic patches in classic units (the pot is 3.15 high and stands on z = 0, the spout points
along +x). Newell's table lists every control point of every patch; his pot is made of surfaces of
revolution and of halves mirrored in y, so the same points are written here as profiles and
outlines, and :func:`control_points` unfolds them into the table again. Pure NumPy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# A quarter turn of a surface of revolution has in each of its rows the control points
# (radius, 0), (radius, -side), (side, -radius), (0, -radius): here (radius, side, z).
# Four rows make a patch; patches that follow each other share a row.
TURNED = {
    "rim": [(1.4, 0.784, 2.4), (1.3375, 0.749, 2.53125), (1.4375, 0.805, 2.53125),
            (1.5, 0.84, 2.4)],
    "body": [(1.5, 0.84, 2.4), (1.75, 0.98, 1.875), (2.0, 1.12, 1.35), (2.0, 1.12, 0.9),
             (2.0, 1.12, 0.45), (1.5, 0.84, 0.225), (1.5, 0.84, 0.15)],
    "lid": [(0.0, 0.0, 3.15), (0.8, 0.45, 3.15), (0.0, 0.0, 2.85), (0.2, 0.112, 2.7),
            (0.4, 0.224, 2.55), (1.3, 0.728, 2.55), (1.3, 0.728, 2.4)],
    "bottom": [(1.5, 0.84, 0.15), (1.5, 0.84, 0.075), (1.425, 0.798, 0.0), (0.0, 0.0, 0.0)],
}  # fmt: skip

# One half of a tube has in each of its rows the control points (x0, 0, z0), (x0, -side, z0),
# (x1, -side, z1), (x1, 0, z1): here (x0, z0, x1, z1, side).
TUBES = {
    "handle": [(-1.6, 2.025, -1.5, 2.25, 0.3), (-2.3, 2.025, -2.5, 2.25, 0.3),
               (-2.7, 2.025, -3.0, 2.25, 0.3), (-2.7, 1.8, -3.0, 1.8, 0.3),
               (-2.7, 1.575, -3.0, 1.35, 0.3), (-2.5, 1.125, -2.65, 0.9375, 0.3),
               (-2.0, 0.9, -1.9, 0.6, 0.3)],
    "spout": [(1.7, 1.425, 1.7, 0.6, 0.66), (2.6, 1.425, 3.1, 0.825, 0.66),
              (2.3, 2.1, 2.4, 2.025, 0.25), (2.7, 2.4, 3.3, 2.4, 0.25),
              (2.8, 2.475, 3.525, 2.49375, 0.25), (2.9, 2.475, 3.45, 2.5125, 0.15),
              (2.8, 2.4, 3.2, 2.4, 0.15)],
}  # fmt: skip

PARTS = (*TURNED, *TUBES)


class Teapot(NamedTuple):
    """The pot as a mesh. Its parts touch or run into each other but share no vertex."""

    positions: np.ndarray
    """(V, 3), classic units."""
    normals: np.ndarray
    """(V, 3), unit, outwards, from the patches' own derivatives."""
    faces: list[tuple[int, ...]]
    """Quads, and triangles round the two poles; counter-clockwise seen from outside."""
    uv: np.ndarray
    """(corners, 2): U once round the part, V 0..1 along it."""
    part: np.ndarray
    """(F,) index into ``PARTS``; the pot's wall is rim, body and bottom welded together."""


def control_points() -> np.ndarray:
    """Return the control points of all patches, (32, 4, 4, 3), in the order of ``PARTS``."""
    return np.concatenate([_patches(name).reshape(-1, 4, 4, 3) for name in PARTS])


def _patches(name: str) -> np.ndarray:
    """Return (along, round, 4, 4, 3): the patches of a part, first its rows, then its turns."""
    if name in TURNED:
        radius, side, z = np.array(TURNED[name]).T
        none = np.zeros_like(z)
        quarter = np.stack(
            [
                np.stack((x, y, z), axis=-1)
                for x, y in ((radius, none), (radius, -side), (side, -radius), (none, -radius))
            ],
            axis=1,
        )
        # Quarter turns about z only swap and negate: exact.
        turns, turn = [quarter], quarter
        for _ in range(3):
            turn = np.stack((turn[..., 1], -turn[..., 0], turn[..., 2]), axis=-1)
            turns.append(turn)
    else:
        x0, z0, x1, z1, side = np.array(TUBES[name]).T
        none = np.zeros_like(side)
        half = np.stack(
            [
                np.stack(column, axis=-1)
                for column in ((x0, none, z0), (x0, -side, z0), (x1, -side, z1), (x1, none, z1))
            ],
            axis=1,
        )
        turns = [half, half[:, ::-1] * (1.0, -1.0, 1.0)]
    rows = np.stack(turns)  # (round, rows, 4, 3)
    along = [rows[:, first : first + 4] for first in range(0, rows.shape[1] - 1, 3)]
    return np.stack(along)


def evaluate(patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the point of a bicubic Bezier patch (..., 4, 4, 3) at ``u`` (rows), ``v`` (columns).

    ``u`` (M,) and ``v`` (N,) in 0..1 span a grid: the result is (..., M, N, 3).
    """
    return np.einsum("mi,nj,...ijk->...mnk", _bernstein(u), _bernstein(v), patch)


def _bernstein(t: np.ndarray) -> np.ndarray:
    """Return the four cubic Bernstein polynomials at ``t`` (M,) as (M, 4)."""
    s = 1.0 - t
    return np.stack((s**3, 3 * s**2 * t, 3 * s * t**2, t**3), axis=-1)


def teapot(subdivision: int = 16) -> Teapot:
    """Return the pot with ``subdivision`` edges along each side of each patch (at least 2).

    Closed but for the openings that Newell gave it: the pot's mouth, the lower edge of the lid,
    and both ends of handle and spout. Shared patch borders are welded: no cracks.
    """
    positions, normals, faces, uv, part = [], [], [], [], []
    count = 0
    # Rim, body and bottom are one sheet: their profiles meet in a common row.
    for names in (("rim", "body", "bottom"), ("lid",), ("handle",), ("spout",)):
        patches = np.concatenate([_patches(name) for name in names])
        per_patch = np.concatenate(
            [np.full(len(_patches(name)), PARTS.index(name)) for name in names]
        )
        points, directions, sheet_faces, sheet_uv, patch_of_face = _sheet(patches, subdivision)
        positions.append(points)
        normals.append(directions)
        faces += [tuple(corner + count for corner in face) for face in sheet_faces]
        uv += sheet_uv
        part.append(per_patch[patch_of_face])
        count += len(points)
    return Teapot(
        np.vstack(positions), np.vstack(normals), faces, np.array(uv), np.concatenate(part)
    )


def _sheet(
    patches: np.ndarray, subdivision: int
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, ...]], list[tuple[float, float]], np.ndarray]:
    """Return one part (along, round, 4, 4, 3) as a sheet that closes on itself round it."""
    along, turns = patches.shape[:2]
    n = subdivision
    t = np.linspace(0.0, 1.0, n + 1)
    rows, columns = along * n + 1, turns * n
    grid = np.empty((rows, columns, 3))
    normal = np.empty((rows, columns, 3))
    for i in range(along):
        for j in range(turns):
            # Borders are written twice, by equal numbers: neighbours share their control points.
            keep = slice(None) if i == along - 1 else slice(0, n)
            where = (slice(i * n, i * n + len(t[keep])), slice(j * n, (j + 1) * n))
            grid[where] = evaluate(patches[i, j], t[keep], t[:-1])
            normal[where] = _normals(patches[i, j], t[keep], t[:-1])

    # A row that shrinks to a point (the poles of lid and bottom) becomes one vertex.
    index = np.empty((rows, columns), dtype=np.int64)
    points, directions = [], []
    for row in range(rows):
        single = np.ptp(grid[row], axis=0).max() < 1e-12
        kept = slice(0, 1) if single else slice(None)
        index[row] = len(points) + (0 if single else np.arange(columns))
        points += list(grid[row, kept])
        directions += list(normal[row, kept])

    faces, uv, patch_of_face = [], [], []
    for row in range(rows - 1):
        for column in range(columns):
            after = (column + 1) % columns
            corners = (
                (index[row, column], row, column),
                (index[row, after], row, column + 1),
                (index[row + 1, after], row + 1, column + 1),
                (index[row + 1, column], row + 1, column),
            )
            # At a pole two corners are one vertex: keep the first.
            face = {int(v): (1.0 - c / columns, 1.0 - r / (rows - 1)) for v, r, c in corners}
            faces.append(tuple(face))
            uv += face.values()
            patch_of_face.append(row // n)
    return np.array(points), np.array(directions), faces, uv, np.array(patch_of_face)


def _normals(patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the unit normals on the outer side, (M, N, 3).

    Where a row of control points is one point, the derivative along it vanishes; a hair's breadth
    beside it is close enough to the axis, which then is the normal.
    """
    pole = np.ptp(patch, axis=1).max(axis=1) == 0.0
    inside = u.copy()
    if pole[0]:
        inside[u == 0.0] = 1e-6
    if pole[3]:
        inside[u == 1.0] = 1.0 - 1e-6
    du = np.einsum("mi,nj,ijk->mnk", _quadratic(inside), _bernstein(v), 3 * np.diff(patch, axis=0))
    dv = np.einsum("mi,nj,ijk->mnk", _bernstein(inside), _quadratic(v), 3 * np.diff(patch, axis=1))
    result = np.cross(dv, du)  # rows run down or outwards, columns clockwise seen from there
    return result / np.linalg.norm(result, axis=-1, keepdims=True)


def _quadratic(t: np.ndarray) -> np.ndarray:
    """Return the three quadratic Bernstein polynomials at ``t`` (M,) as (M, 3)."""
    s = 1.0 - t
    return np.stack((s**2, 2 * s * t, t**2), axis=-1)
