# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources with long edges, subdivided where their straight images would miss the true ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from .. import optics
from .arrays import corner_normals, edges, positions
from .sources import Piece
from .viewpoint import Viewpoint

MAX_VERTICES = 400_000
"""Refinement stops here; the bound that is reported then tells what was reached."""
MAX_ROUNDS = 16
SHORT_EDGE_PX = 1.0
"""An edge whose ends appear this near to each other is not split, whatever lies between them."""


@dataclass(frozen=True, eq=False)
class Images:
    """Where points appear along one path: world positions (B, N, 3) and whether they do (B, N)."""

    position: np.ndarray
    valid: np.ndarray


Solve = Callable[[np.ndarray], Images]


@dataclass(frozen=True, eq=False)
class Probe:
    """Rays of the region after the path's last event, to find what large faces they meet.

    ``origin`` and ``direction`` (R, 3), world.
    """

    origin: np.ndarray
    direction: np.ndarray


def interpolation_gaps(
    points: np.ndarray, pairs: np.ndarray, images: Images, solve: Solve, view: Viewpoint
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far the middle of each edge's straight image lies from the image of its middle.

    Second order in the edge's length (optics notes, section 6). Where an end has no image the
    place on the fold stands for it.

    Parameters
    ----------
    points : (N, 3) world. pairs : (E, 2) vertex indices. images : of ``points``.

    Returns
    -------
    gap : (E,) pixels, the largest over the image slots; 0 where neither ends nor middle are seen.
    length : (E,) pixels between the images of the ends, the largest over the slots; infinite
        where only the middle is seen.
    box : (E, 4) pixels: the low and high corner of the images of ends and middle.
    """
    middles = solve(0.5 * (points[pairs[:, 0]] + points[pairs[:, 1]]))
    # Where a source reaches through an interface, its parts are in different slots, and a face
    # across the interface shows in both: such edges are gaps themselves.
    several = images.valid.any(axis=1).sum() > 1
    direct = np.linalg.norm(
        np.diff(_pixels(view, points).reshape(-1, 2)[pairs], axis=1)[:, 0], axis=1
    )
    gap = np.zeros(len(pairs))
    length = np.zeros(len(pairs))
    low, high = np.full((len(pairs), 2), np.inf), np.full((len(pairs), 2), -np.inf)
    for slot in range(min(len(images.valid), len(middles.valid))):
        ends = images.position[slot][pairs]
        both = images.valid[slot][pairs]
        seen = both.any(axis=1) | middles.valid[slot]
        chord = _pixels(view, ends.mean(axis=1))
        first, second = _pixels(view, ends[:, 0]), _pixels(view, ends[:, 1])
        middle = _pixels(view, middles.position[slot])
        off = np.linalg.norm(middle - chord, axis=1)
        apart = np.linalg.norm(second - first, axis=1)
        # Only its middle is seen: nothing tells yet how long the edge's image is.
        apart = np.where(both.any(axis=1), apart, np.where(middles.valid[slot], np.inf, 0.0))
        if several:
            # Beyond the interface a slot's places mean little: take the edge as it stands.
            across = both[:, 0] != both[:, 1]
            off, apart = np.where(across, direct, off), np.where(across, direct, apart)
        gap = np.maximum(gap, np.where(seen, off, 0.0))
        length = np.maximum(length, apart)
        ends_count = both.any(axis=1)
        if several:
            first = np.where(both[:, :1], first, middle)
            second = np.where(both[:, 1:], second, middle)
        for corner, counts in ((first, ends_count), (second, ends_count), (middle, seen)):
            low = np.where(counts[:, None], np.minimum(low, corner), low)
            high = np.where(counts[:, None], np.maximum(high, corner), high)
    return gap, length, np.concatenate((low, high), axis=1)


def _pixels(view: Viewpoint, points: np.ndarray) -> np.ndarray:
    clip = view.clip(points)
    w = np.where(clip[:, 2] > 1e-12, clip[:, 2], 1e-12)
    return np.clip(clip[:, :2] / w[:, None] * view.size, -1e6, 1e6)


def overlaps(box: np.ndarray, rect: tuple[int, int, int, int]) -> np.ndarray:
    """Which boxes (E, 4), low and high corner, meet the pixel rectangle."""
    return (
        (box[:, 0] < rect[2]) & (box[:, 2] > rect[0]) & (box[:, 1] < rect[3]) & (box[:, 3] > rect[1])
    )


def refine(
    parts: list[Piece],
    mesh: bpy.types.Mesh,
    solve: Solve,
    probe: Probe,
    view: Viewpoint,
    rect: tuple[int, int, int, int],
    tolerance_px: float,
) -> float:
    """Write the pieces, joined in world space and subdivided, into ``mesh``.

    Triangles are split at the edges' middles, and an edge is shared by its triangles, so no cracks
    open. All attributes are interpolated (bmesh); the original corner normals end up in
    ``rg_normal``.

    Returns
    -------
    float : the largest gap in pixels that is left inside ``rect``.
    """
    joined = bmesh.new()
    try:
        for part in parts:
            start = len(joined.verts)
            joined.from_mesh(part.mesh)
            joined.verts.ensure_lookup_table()
            bmesh.ops.transform(
                joined, matrix=Matrix(part.to_world.tolist()), verts=joined.verts[start:]
            )
        bmesh.ops.triangulate(joined, faces=joined.faces[:])
        worst = 0.0
        for _ in range(MAX_ROUNDS):
            joined.to_mesh(mesh)
            split, worst = _edges_to_split(mesh, solve, probe, view, rect, tolerance_px)
            if not len(split) or len(joined.verts) + len(split) > MAX_VERTICES:
                break
            joined.edges.ensure_lookup_table()
            bmesh.ops.subdivide_edges(
                joined, edges=[joined.edges[i] for i in split], cuts=1, use_grid_fill=True
            )
            bmesh.ops.triangulate(joined, faces=[f for f in joined.faces if len(f.verts) > 3])
    finally:
        joined.free()
    normals = corner_normals(mesh)
    attribute = mesh.attributes.new("rg_normal", "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", normals.ravel())
    return worst


def _edges_to_split(mesh, solve, probe, view, rect, tolerance_px) -> tuple[np.ndarray, float]:
    """Indices of the edges to split, and the largest gap inside the rectangle."""
    points = positions(mesh).astype(float)
    pairs = edges(mesh)
    images = solve(points)
    gap, length, box = interpolation_gaps(points, pairs, images, solve, view)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    corner_edges = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("edge_index", corner_edges)
    triangles, triangle_edges = corners.reshape(-1, 3), corner_edges.reshape(-1, 3)

    # A face counts where the box round its images meets the glass's rectangle.
    face_box = np.concatenate(
        (box[triangle_edges, :2].min(axis=1), box[triangle_edges, 2:].max(axis=1)), axis=1
    )
    near = np.zeros(len(pairs), bool)
    near[triangle_edges[overlaps(face_box, rect)].ravel()] = True
    wrong = near & (gap > tolerance_px)
    long = length > SHORT_EDGE_PX
    split = wrong & long

    # A face may be seen only somewhere in its middle: ask the rays.
    unseen = ~images.valid.any(axis=0)[triangles].any(axis=1)
    unseen &= ~np.isfinite(box[triangle_edges, 0]).any(axis=1)
    candidates = np.nonzero(unseen)[0]
    met = candidates[_met_by(probe, points[triangles[candidates]])]
    split[triangle_edges[met].ravel()] = True
    return np.nonzero(split)[0], float(gap[near & long].max(initial=0.0))


def _met_by(probe: Probe, corners: np.ndarray) -> np.ndarray:
    """Which triangles (T, 3, 3) a ray of the probe meets (Moeller and Trumbore 1997)."""
    met = np.zeros(len(corners), bool)
    block = max(1, 2_000_000 // max(1, len(probe.origin)))
    for start in range(0, len(corners), block):
        a, b, c = (corners[start : start + block, k] for k in range(3))
        first, second = b - a, c - a
        p = np.cross(probe.direction[:, None], second[None])
        det = np.einsum("rtk,tk->rt", p, first)
        safe = np.where(det == 0, 1.0, det)
        to_origin = probe.origin[:, None] - a[None]
        u = np.einsum("rtk,rtk->rt", to_origin, p) / safe
        q = np.cross(to_origin, first[None])
        v = np.einsum("rk,rtk->rt", probe.direction, q) / safe
        distance = np.einsum("tk,rtk->rt", second, q) / safe
        hit = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
        met[start : start + block] = hit.any(axis=0)
    return met


def region_probe(glass, view: Viewpoint, path: optics.LightPath, rect, side: int = 24) -> Probe:
    """Rays through a grid of the rectangle's pixels that take the path, after its last event."""
    x0, y0, x1, y1 = rect
    x, y = np.meshgrid(
        x0 + (np.arange(side) + 0.5) * (x1 - x0) / side,
        y0 + (np.arange(side) + 0.5) * (y1 - y0) / side,
    )
    origins, directions = view.rays(x.ravel(), y.ravel())
    traced = optics.trace(
        glass.description, glass.to_local(origins), glass.direction_to_local(directions), path
    )
    origin = glass.points_to_world(traced.origin[traced.valid])
    direction = traced.direction[traced.valid] @ glass.to_world[:3, :3].T
    return Probe(origin, direction)
