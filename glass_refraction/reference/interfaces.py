# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that overlap, as interfaces that do not: each border of two media is there once.

A path tracer bends light at every surface by the ior that the surface names; it knows of no
priorities. So the glasses' triangles are cut along the lines where they run through each other.
Each piece then has one medium before it and one behind it, by the same rule as the exit rays'
(`optics.Media`). A piece with the same medium on both sides is left out, and of two that lie on
each other the one of the lower rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from mathutils.geometry import delaunay_2d_cdt

from .. import optics
from ..scene.rays.frame import placed_glasses
from ..scene.read.glasses import Glass, as_body
from ..scene.read.mesh_glasses import MeshGlass, triangles_of
from .glass_mesh import fill_mesh, glass_surfaces

SKIN = 1e-4
"""Of the size of all glasses: so far before and behind a piece its media are looked up, and nearer
surfaces lie on each other. Facets of closed forms miss the true surface by a fifth of that."""
SNAP = 1e-6
"""Of a triangle's edges: corners of its pieces that are nearer are one. `delaunay_2d_cdt` takes
places of float32."""
ASLANT = 0.1
"""Cosine to a face's normal from which on a ray tells well on which side of it it was."""
PROBES = np.array([(0.531, 0.262, 0.806), (-0.713, 0.487, 0.505), (0.218, -0.861, 0.459)])
"""Directions in which a mesh is looked for to know whether a place is in it: along no axis, where
meshes like to have their edges."""


@dataclass(frozen=True, eq=False)
class Interfaces:
    """Triangles in the world, each between two media.

    Attributes
    ----------
    points, normals : (P, 3, 3) float64: corners, metres, anticlockwise seen from the front; unit
        interpolated normals there.
    glass : (P,) number of the glass whose surface it is.
    ior : (P,) of the medium behind it over that before it.
    absorption : (P, 2, 3) coefficients before it and behind it, red, green, blue, per metre.
    """

    points: np.ndarray
    normals: np.ndarray
    glass: np.ndarray
    ior: np.ndarray
    absorption: np.ndarray


class _Shell:
    """A glass's triangles in the world, and a tree of them in a frame in which they are near 1."""

    def __init__(self, glass: Glass, placed: optics.Placed) -> None:
        self.placed = placed
        if isinstance(glass.description, MeshGlass):
            self.points, self.normals = glass.description.points, glass.description.normals
        else:
            points, normals = _closed_form(glass)
            self.points = glass.points_to_world(points)
            self.normals = normals @ glass.to_world[:3, :3].T
        self.box = np.array((self.points.min(axis=(0, 1)), self.points.max(axis=(0, 1))))

    @cached_property
    def _scale(self) -> float:
        return float(np.ptp(self.box, axis=0).max())

    def local(self, points: np.ndarray) -> np.ndarray:
        """World points in the tree's frame."""
        return (points - self.box[0]) / self._scale

    @cached_property
    def tree(self) -> BVHTree:
        return self.tree_of(self)

    def tree_of(self, other: _Shell) -> BVHTree:
        """A tree of another's triangles, in the own frame."""
        points = self.local(other.points).reshape(-1, 3)
        faces = np.arange(len(points)).reshape(-1, 3)
        return BVHTree.FromPolygons(points.tolist(), faces.tolist(), all_triangles=True)

    def near(self, box: np.ndarray) -> bool:
        """Whether a box (2, 3) in the world touches its own."""
        return bool(np.all((self.box[0] <= box[1]) & (self.box[1] >= box[0])))

    def crossings(self, other: _Shell) -> np.ndarray:
        """(N, 2) numbers of the own and the other's triangles that run through each other."""
        if not self.near(other.box):
            return np.zeros((0, 2), int)
        return np.array(self.tree.overlap(self.tree_of(other)), int).reshape(-1, 2)

    def touched(self, other: _Shell) -> bool:
        """Whether a corner of another's triangles lies on one of its own."""
        corners = self.local(other.points[:, 0])
        close = np.all((corners > -SKIN) & (corners < self.local(self.box[1]) + SKIN), axis=1)
        return any(
            self.tree.find_nearest(Vector(corner), SKIN)[0] is not None for corner in corners[close]
        )

    def medium_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) its medium at world points (N, 3), 0 outside it."""
        found = np.zeros(len(points), int)
        within = np.flatnonzero(np.all((points >= self.box[0]) & (points <= self.box[1]), axis=1))
        if isinstance(self.placed, optics.PlacedGlass):
            turn, middle = self.placed.pose[:3, :3], self.placed.pose[:3, 3]
            found[within] = self.placed.body.medium_at((points[within] - middle) @ turn)
            return found
        for number, place in zip(within, self.local(points[within]), strict=True):
            found[number] = self._holds(Vector(place))
        return found

    def _holds(self, place: Vector) -> bool:
        """Whether most probes from a place of the tree's frame come to a back of a face first."""
        votes = 0
        for probe in PROBES:
            _, normal, _, distance = self.tree.ray_cast(place, Vector(probe))
            if distance is None:
                votes -= 1
                continue
            cosine = float(normal.dot(Vector(probe).normalized()))
            if abs(cosine) > ASLANT:
                votes += 1 if cosine > 0.0 else -1
        return votes > 0


def _closed_form(glass: Glass) -> tuple[np.ndarray, np.ndarray]:
    """Corners of triangles, and normals there, (T, 3, 3), in the glass's own frame."""
    mesh = bpy.data.meshes.new("interfaces")
    try:
        fill_mesh(mesh, glass_surfaces(glass.description))
        return triangles_of(mesh)
    finally:
        bpy.data.meshes.remove(mesh)


def overlapping(glasses: Sequence[Glass]) -> frozenset[str]:
    """Names of the glasses that run through another one, or lie in one or on one."""
    bodies = [body for body in map(as_body, glasses) if body is not None]
    boxes = [_box(body) for body in bodies]
    near = [
        (a, b)
        for b in range(len(bodies))
        for a in range(b)
        if np.all((boxes[a][0] <= boxes[b][1]) & (boxes[a][1] >= boxes[b][0]))
    ]
    if not near:
        return frozenset()
    placed = placed_glasses(bodies)
    shells = {n: _Shell(bodies[n], placed[n]) for n in sorted({n for pair in near for n in pair})}
    found = set()
    for pair in near:
        names = {bodies[n].name for n in pair}
        if not names <= found and _touch(*(shells[n] for n in pair)):
            found |= names
    return frozenset(found)


def _box(body: Glass) -> np.ndarray:
    """(2, 3): a box round a glass in the world."""
    box = np.asarray(body.description.box)
    corners = body.points_to_world(np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))
    return np.array((corners.min(axis=0), corners.max(axis=0)))


def _touch(one: _Shell, other: _Shell) -> bool:
    """Whether two glasses run through each other, or a corner of one is in the other or on it."""
    if len(one.crossings(other)):
        return True
    return any(
        a.medium_at(b.points[:, 0]).any() or a.touched(b) for a, b in ((one, other), (other, one))
    )


def interfaces(glasses: Sequence[Glass]) -> Interfaces:
    """The interfaces of glasses that may overlap; numbers of glasses are those of the list.

    Raises
    ------
    ValueError
        A glass has no bounds.
    """
    bodies = [as_body(glass) for glass in glasses]
    if None in bodies:
        raise ValueError("glasses must have bounds")
    placed = placed_glasses(bodies)
    media = optics.Media(placed)
    shells = [_Shell(glass, one) for glass, one in zip(glasses, placed, strict=True)]
    skin = SKIN * float(np.ptp(np.concatenate([shell.box for shell in shells]), axis=0).max())
    parts = [_pieces(shell, [o for o in shells if o is not shell]) for shell in shells]
    owner = np.repeat(np.arange(len(parts)), [len(points) for points, _ in parts])
    points, normals = (np.concatenate(part) for part in zip(*parts, strict=True))
    flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    area = np.linalg.norm(flat, axis=1)
    kept = np.flatnonzero(area > 0.0)
    points, normals, owner = points[kept], normals[kept], owner[kept]
    off = skin * flat[kept] / area[kept, None]
    middle = points.mean(axis=1)
    sides = [
        np.stack([shell.medium_at(middle + sign * off) for shell in shells]) for sign in (1, -1)
    ]
    for number, one in enumerate(placed):
        # A mesh's own faces tell, whatever else of it is near.
        if isinstance(one, optics.PlacedMesh):
            for side, medium in zip(sides, (0, 1), strict=True):
                side[number, owner == number] = medium
    changes = sides[0] != sides[1]
    hidden = (changes & (media.rank[:, None] > media.rank[owner])).any(axis=0)
    entered = np.zeros(sides[0].shape, int)
    front, back = (np.stack(media.holding(side, entered)) for side in sides)
    seen = np.flatnonzero(~hidden & (front != back).any(axis=0))
    front, back = tuple(front[:, seen]), tuple(back[:, seen])
    return Interfaces(
        points[seen],
        normals[seen],
        owner[seen],
        media.ior[back] / media.ior[front],
        np.stack((media.absorption[front], media.absorption[back]), axis=1),
    )


def _pieces(shell: _Shell, others: Sequence[_Shell]) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (P, 3, 3) of a glass's triangles, cut along other glasses."""
    found = [_cuts(shell, other, pairs) for other in others if len(pairs := shell.crossings(other))]
    if not found:
        return shell.points, shell.normals
    triangle, segment = (np.concatenate(part) for part in zip(*found, strict=True))
    whole = np.ones(len(shell.points), bool)
    whole[triangle] = False
    order = np.argsort(triangle, kind="stable")
    cut, first = np.unique(triangle[order], return_index=True)
    points, normals = [shell.points[whole]], [shell.normals[whole]]
    for number, segments in zip(cut, np.split(segment[order], first[1:]), strict=True):
        shares = _divided(segments)
        points.append(shares @ shell.points[number])
        normals.append(shares @ shell.normals[number])
    points, normals = np.concatenate(points), np.concatenate(normals)
    return points, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def _cuts(shell: _Shell, other: _Shell, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines along which triangles are cut: their numbers (N,), and ends (N, 2, 2).

    The ends are shares of the triangle's second and third corner.
    """
    mine, theirs = shell.points[pairs[:, 0]], other.points[pairs[:, 1]]
    # Where an edge of either runs through the other: up to six places, of which two are the ends.
    places, met = [], []
    for edges, faces in ((mine, theirs), (theirs, mine)):
        for corner in range(3):
            place, on = _through(edges[:, corner], edges[:, (corner + 1) % 3], faces)
            places.append(place)
            met.append(on)
    places, met = np.stack(places, axis=1), np.stack(met, axis=1)
    apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
    apart[~(met[:, :, None] & met[:, None])] = -1.0
    far = apart.reshape(len(pairs), -1)
    ends = np.stack(np.unravel_index(far.argmax(axis=1), apart.shape[1:]), axis=1)
    cut = np.flatnonzero(far.max(axis=1, initial=-1.0) > 0.0)
    chosen = places[cut[:, None], ends[cut]]
    return pairs[cut, 0], _shares(mine[cut], chosen)


def _through(begin: np.ndarray, end: np.ndarray, faces: np.ndarray) -> tuple:
    """Where lines (N, 3) to (N, 3) run through triangles (N, 3, 3), and (N,) whether they do."""
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    before, behind = (np.einsum("nk,nk->n", normal, place - faces[:, 0]) for place in (begin, end))
    crosses = (before > 0.0) != (behind > 0.0)
    step = np.where(crosses, before - behind, 1.0)
    place = begin + (before / step)[:, None] * (end - begin)
    shares = _shares(faces, place[:, None])[:, 0]
    inside = (shares > -SNAP).all(axis=1) & (shares.sum(axis=1) < 1.0 + SNAP)
    return place, crosses & inside


def _shares(faces: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(N, K, 2) shares of triangles' (N, 3, 3) second and third corners in places (N, K, 3)."""
    a, b = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    place = places - faces[:, :1]
    aa, ab, bb = (np.einsum("nk,nk->n", u, v)[:, None] for u, v in ((a, a), (a, b), (b, b)))
    pa, pb = (np.einsum("njk,nk->nj", place, edge) for edge in (a, b))
    area = aa * bb - ab * ab
    area = np.where(area > 0.0, area, 1.0)
    return np.stack(((bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area), axis=2)


def _divided(segments: np.ndarray) -> np.ndarray:
    """Shares (P, 3, 3) of a triangle's corners in the corners of its pieces.

    Parameters
    ----------
    segments : (N, 2, 2) the lines that cut it, see `_cuts`.
    """
    corners = np.concatenate((((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), segments.reshape(-1, 2)))
    edges = [(0, 1), (1, 2), (2, 0)]
    edges += [(k, k + 1) for k in range(3, len(corners), 2)]
    places, _, faces, *_ = delaunay_2d_cdt(corners.tolist(), edges, [], 0, SNAP)
    uv = np.array([tuple(place) for place in places])
    shares = np.column_stack((1.0 - uv.sum(axis=1), uv))
    return shares[np.array(faces, int)]
