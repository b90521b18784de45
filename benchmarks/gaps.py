# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the straight edges of a displaced mesh lie from the curved image they stand for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glass_refraction.optics import ApparentPoints, LightPath, ParallelView, apparent_points
from glass_refraction.optics.glasses import Glass
from glass_refraction.optics.paths import as_eye

Floats = NDArray[np.float64]

SAMPLES = np.array([0.25, 0.5, 0.75])
"""Where along an edge the true image is looked at."""

QUIET_PX = 1e-3
"""Error of the sampled images in pixels; added to every bound."""


def edge_gaps(
    glass: Glass,
    path: LightPath | str,
    eye: ArrayLike | ParallelView,
    points: ArrayLike,
    edges: ArrayLike,
    apparent: ApparentPoints,
    *,
    focal_px: float,
) -> Floats:
    """Upper bounds on the gap between displaced edges and the true image of the edges.

    An edge is drawn straight between its displaced ends, a point at part t of it at part t of the
    chord. The true image of that point is computed at three places; the greatest gap there plus
    half the greatest second difference bounds the gap all along (for a smooth image an eighth
    would do, the rest is for the square root by which an image approaches a fold).

    Parameters
    ----------
    glass, path, eye
        As for `apparent_points`.
    points : (N, 3)
        Metres.
    edges : (E, 2) of int
        Indices into `points`.
    apparent : ApparentPoints
        The result for `points`.
    focal_px : float
        Pixels a radian at the eye; in a parallel view, pixels a metre.

    Returns
    -------
    (B, E)
        Pixels. 0 where neither end has this image nor any of the sampled places, inf where only
        some of ends and samples have it: there the edge crosses the end of a sheet.
    """
    eye = as_eye(eye)
    points = np.asarray(points, dtype=float)
    edges = np.asarray(edges, dtype=np.intp).reshape(-1, 2)
    count = len(edges)
    parts = SAMPLES[:, None, None]
    places = (1.0 - parts) * points[edges[:, 0]] + parts * points[edges[:, 1]]
    gaps, seen = _gaps_at(
        glass, path, eye, places, edges, np.stack([1.0 - SAMPLES, SAMPLES]), apparent, focal_px
    )
    ends = apparent.valid[:, edges]
    none = ~(ends.any(axis=2) | seen.any(axis=1))
    smooth = ends.all(axis=2) & seen.all(axis=1)
    zero = np.zeros((len(ends), 1, count, 3))
    errors = np.concatenate([zero, gaps, zero], axis=1)
    bends = errors[:, 2:] - 2.0 * errors[:, 1:-1] + errors[:, :-2]
    bound = _size(gaps).max(axis=1) + 0.5 * _size(bends).max(axis=1) + QUIET_PX
    return np.where(none, 0.0, np.where(smooth, bound, np.inf))


def triangle_gaps(
    glass: Glass,
    path: LightPath | str,
    eye: ArrayLike | ParallelView,
    points: ArrayLike,
    triangles: ArrayLike,
    apparent: ApparentPoints,
    *,
    focal_px: float,
) -> Floats:
    """Upper bounds on the gap between displaced triangles and the true image of their insides.

    As `edge_gaps`, for `triangles` (T, 3) of int; returns (B, T) pixels. A quadratic image is
    nowhere in a triangle further off than 4/3 of its greatest gap along the edges; the middle of
    the triangle is looked at as well.
    """
    eye = as_eye(eye)
    points = np.asarray(points, dtype=float)
    triangles = np.asarray(triangles, dtype=np.intp).reshape(-1, 3)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    along = edge_gaps(glass, path, eye, points, edges, apparent, focal_px=focal_px)
    greatest = along[:, which.reshape(-1, 3)].max(axis=2)
    middle = points[triangles].mean(axis=1)[None]
    gaps, seen = _gaps_at(
        glass, path, eye, middle, triangles, np.full((3, 1), 1.0 / 3.0), apparent, focal_px
    )
    inside = np.where(seen[:, 0], 1.5 * _size(gaps[:, 0]), 0.0)
    corners = apparent.valid[:, triangles].all(axis=2)
    broken = corners != seen[:, 0]
    bound = np.maximum(4.0 / 3.0 * greatest, inside)
    return np.where(broken, np.inf, bound)


def _size(vectors: Floats) -> Floats:
    return np.sqrt(np.sum(vectors * vectors, axis=-1))


def _gaps_at(glass, path, eye, places, corners, parts, apparent, focal_px):
    """Gaps in pixels as vectors (B, K, E, 3) at `places` (K, E, 3), and where both exist.

    `corners` (E, C) are the vertices between which `parts` (C, K) interpolate.
    """
    if not focal_px > 0.0:
        raise ValueError(f"focal_px must be positive, not {focal_px!r}")
    flat = places.reshape(-1, 3)
    drawn = np.einsum("ck,becd->bked", parts, apparent.position[:, corners])
    parallel = isinstance(eye, ParallelView)
    if parallel:
        aims = np.broadcast_to(eye.direction, drawn.shape)
        tolerance = 1e-9
    else:
        aims = drawn - eye
        size = _size(aims)[..., None]
        aims = aims / np.where(size > 0.0, size, 1.0)
        tolerance = max(1e-9, 0.5 * QUIET_PX / focal_px)
    # The drawn places are good guesses of the true ones.
    rows = (len(drawn), len(flat))
    guess = ApparentPoints(
        aims.reshape(*rows, 3),
        np.zeros(rows),
        drawn.reshape(*rows, 3),
        np.ones(rows, dtype=bool),
        np.zeros(rows),
        apparent.stretch,
        0,
        apparent.sheet,
    )
    true = apparent_points(glass, path, eye, flat, tolerance=tolerance, guess=guess)
    gaps = np.zeros(drawn.shape)
    seen = np.zeros(drawn.shape[:3], dtype=bool)
    for row, sheet in enumerate(apparent.sheet):
        if sheet not in true.sheet:
            continue
        slot = true.sheet.index(sheet)
        seen[row] = true.valid[slot].reshape(seen.shape[1:])
        if parallel:
            off = true.position[slot].reshape(drawn.shape[1:]) - drawn[row]
            direction = np.asarray(eye.direction)
            off = off - (off @ direction)[..., None] * direction
        else:
            off = true.direction[slot].reshape(drawn.shape[1:]) - aims[row]
            # From the chord between two directions to the angle between them.
            half = np.minimum(0.5 * _size(off), 1.0)
            off = off * (np.arcsin(half) / np.where(half > 0.0, half, 1.0))[..., None]
        gaps[row] = focal_px * off
    return gaps, seen
