# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that overlap, as interfaces that do not: each border of two media is there once.

A path tracer bends light at every surface by the ior that the surface names; it knows of no
priorities. So the glasses' triangles are cut along the lines where they run through each other.
Each piece then has one medium before it and one behind it, by the same rule as the exit rays'
(`optics.Media`). A piece with the same medium on both sides is left out, and of two that lie on
each other the one of the lower rank.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from mathutils.geometry import delaunay_2d_cdt

from .. import optics
from ..scene.build.glass_mesh import fill_mesh, glass_surfaces
from ..scene.rays.stage import placed_glasses
from ..scene.read.glasses import Glass, as_body
from ..scene.read.mesh_corners import triangles_of

SKIN = 1e-4
"""Of the size of all glasses: so far before and behind a piece its media are looked up, and nearer
surfaces lie on each other. Facets of closed forms miss the true surface by a fifth of that."""
SNAP = 1e-6
"""Of a triangle's edges: corners of its pieces that are nearer are one. `delaunay_2d_cdt` takes
places of float32."""
PAIRS = 1 << 17
"""Pairs of triangles that are cut together: some hundred megabytes of memory."""
BRANCHES = 8
"""Boxes in a box, where triangles that touch are looked for."""
CELLS = 1 << 12
"""Along each axis, by which triangles are ordered."""
LEAST = 1e-300
"""Keeps a quotient finite where all triangles are in one place."""
ASLANT = 0.1
"""Cosine to a face's normal from which on a ray tells well on which side of it it was."""
PROBES = tuple(
    Vector(way).normalized()
    for way in ((0.531, 0.262, 0.806), (-0.713, 0.487, 0.505), (0.218, -0.861, 0.459))
)
"""Directions in which a mesh is looked for to know whether a place is in it: along no axis, where
meshes like to have their edges."""
ENOUGH = 2
"""Probes that agree."""


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


class Shell:
    """A glass's triangles in the world, and a tree of them in a frame in which they are near 1.

    Once it is made it reads nothing of Blender's: what is done with it may run in a thread.
    """

    def __init__(self, glass: Glass, placed: optics.Placed) -> None:
        self.glass, self.placed = glass, placed
        if glass.is_mesh:
            mesh = glass.description
            self.points, self.normals, self._opaque = mesh.points, mesh.normals, mesh.opaque
        else:
            points, normals = _closed_form(glass)
            self.points = glass.points_to_world(points)
            self.normals = normals @ glass.to_world[:3, :3].T
            self._opaque = np.zeros((0, 3, 3))
        corners = np.concatenate((self.points, self._opaque)).reshape(-1, 3)
        self.box = np.array((corners.min(axis=0), corners.max(axis=0)))

    @cached_property
    def _scale(self) -> float:
        return float(np.ptp(self.box, axis=0).max())

    def local(self, points: np.ndarray) -> np.ndarray:
        """World points in the tree's frame."""
        return (points - self.box[0]) / self._scale

    @cached_property
    def boxes(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """See `_boxes`."""
        return _boxes(self.points)

    @cached_property
    def planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Of its triangles: normals (T, 3), as long as twice their areas, and (T,) what distances
        along these count as none."""
        return _planes(self.points)

    @cached_property
    def tree(self) -> BVHTree:
        """Its triangles; of a mesh also those that are no glass: they bound what is in it too."""
        points = self.local(np.concatenate((self.points, self._opaque))).reshape(-1, 3)
        faces = np.arange(len(points)).reshape(-1, 3)
        return BVHTree.FromPolygons(points.tolist(), faces.tolist(), all_triangles=True)

    def medium_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) its medium at world points (N, 3), 0 outside it."""
        found = np.zeros(len(points), int)
        within = np.flatnonzero(np.all((points >= self.box[0]) & (points <= self.box[1]), axis=1))
        if not self.placed.is_mesh:
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
            _, normal, _, distance = self.tree.ray_cast(place, probe)
            cosine = -1.0 if distance is None else normal.dot(probe)
            if abs(cosine) > ASLANT:
                votes += 1 if cosine > 0.0 else -1
            if abs(votes) == ENOUGH:
                break
        return votes > 0


def _closed_form(glass: Glass) -> tuple[np.ndarray, np.ndarray]:
    """Corners of triangles, and normals there, (T, 3, 3), in the glass's own frame."""
    mesh = bpy.data.meshes.new("interfaces")
    try:
        fill_mesh(mesh, glass_surfaces(glass.description))
        return triangles_of(mesh)
    finally:
        bpy.data.meshes.remove(mesh)


def near_shells(glasses: Sequence[Glass]) -> list[Shell]:
    """Of the glasses with bounds whose boxes touch that of another one, and of all of their names:
    instances share one."""
    bounded = [glass for glass in glasses if as_body(glass) is not None]
    bodies = [as_body(glass) for glass in bounded]
    boxes = np.array([_box(body) for body in bodies]).reshape(-1, 2, 3)
    touch = (boxes[:, None, 0] <= boxes[:, 1]) & (boxes[:, None, 1] >= boxes[:, 0])
    near = touch.all(axis=2).sum(axis=1) > 1
    names = {bounded[number].name for number in np.flatnonzero(near)}
    pairs = zip(bounded, placed_glasses(bodies), strict=True)
    return [Shell(glass, placed) for glass, placed in pairs if glass.name in names]


def overlapping(shells: Sequence[Shell]) -> frozenset[str]:
    """Names of the glasses that run through another one, or lie in one or on one."""
    found: set[str] = set()
    for one, other in combinations(shells, 2):
        names = {one.glass.name, other.glass.name}
        if not names <= found and _touch(one, other):
            found |= names
    return frozenset(found)


def _box(body: Glass) -> np.ndarray:
    """(2, 3): a box round a glass in the world."""
    box = np.asarray(body.description.box)
    corners = body.points_to_world(np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))
    return np.array((corners.min(axis=0), corners.max(axis=0)))


def _touch(one: Shell, other: Shell) -> bool:
    """Whether two glasses run through each other or touch, or one is in the other."""
    if any(len(numbers) for numbers, _ in _lines(one, other)):
        return True
    return any(a.medium_at(b.points[:, 0]).any() for a, b in ((one, other), (other, one)))


def interfaces(shells: Sequence[Shell]) -> Interfaces:
    """The interfaces of glasses that may overlap; numbers of glasses are those of the list."""
    placed = [shell.placed for shell in shells]
    media = optics.Media(placed)
    skin = SKIN * float(np.ptp(np.concatenate([shell.box for shell in shells]), axis=0).max())
    cuts: list[list] = [[] for _ in shells]
    for one, other in combinations(range(len(shells)), 2):
        for found, cut in zip((one, other), _cuts(shells[one], shells[other]), strict=True):
            cuts[found].append(cut)
    parts = [_pieces(*pair) for pair in zip(shells, cuts, strict=True)]
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
        if one.is_mesh:
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


def _pieces(
    shell: Shell, cuts: Sequence[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (P, 3, 3) of a glass's triangles, cut along lines (see `_cuts`)."""
    triangle = np.concatenate([part for part, _ in cuts] or [np.zeros(0, int)])
    if not len(triangle):
        return shell.points, shell.normals
    order = np.argsort(triangle, kind="stable")
    segment = np.concatenate([part for _, part in cuts])[order]
    cut, first = np.unique(triangle[order], return_index=True)
    whole = np.ones(len(shell.points), bool)
    whole[cut] = False
    points, normals = [shell.points[whole]], [shell.normals[whole]]
    for number, segments in zip(cut, np.split(segment, first[1:]), strict=True):
        shares = _divided(segments)
        points.append(shares @ shell.points[number])
        normals.append(shares @ shell.normals[number])
    points, normals = np.concatenate(points), np.concatenate(normals)
    return points, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def _cuts(one: Shell, other: Shell) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lines along which two glasses cut each other's triangles: of each glass the numbers (N,) of
    its triangles, and ends (N, 2, 2).

    The ends are shares of the triangle's second and third corner.
    """
    pairs, ends = np.zeros((0, 2), int), np.zeros((0, 2, 3))
    found = [(pairs, ends), *_lines(one, other)]
    pairs, ends = (np.concatenate(part) for part in zip(*found, strict=True))
    sides = zip((one, other), pairs.T, strict=True)
    return [(numbers, _shares(shell.points[numbers], ends)) for shell, numbers in sides]


def _lines(one: Shell, other: Shell) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Numbers (N, 2) of two glasses' triangles that cut each other, and the ends (N, 2, 3) of the
    lines along which they do, some at a time."""
    near = _near(one, other)
    for begin in range(0, len(near), PAIRS):
        pairs = near[begin : begin + PAIRS]
        # Most lie all on one side of each other's planes, or in these.
        sides = np.stack((_sides(one, other, pairs), _sides(other, one, pairs[:, ::-1])))
        beside = (sides == 1).all(axis=2) | (sides == -1).all(axis=2)
        pairs = pairs[~(beside.any(axis=0) | (sides == 0).all(axis=(0, 2)))]
        mine, theirs = one.points[pairs[:, 0]], other.points[pairs[:, 1]]
        planes = [
            [part[numbers] for part in shell.planes]
            for shell, numbers in zip((one, other), pairs.T, strict=True)
        ]
        # Where an edge of either runs through the other: of up to six places two are the ends.
        places, met = [], []
        for edges, faces, plane in ((mine, theirs, planes[1]), (theirs, mine, planes[0])):
            for corner in range(3):
                place, on = _through(edges[:, corner], edges[:, (corner + 1) % 3], faces, *plane)
                places.append(place)
                met.append(on)
        places, met = np.stack(places, axis=1), np.stack(met, axis=1)
        some = np.flatnonzero(met.sum(axis=1) > 1)
        pairs, places, met = pairs[some], places[some], met[some]
        apart = np.linalg.norm(places[:, :, None] - places[:, None], axis=-1)
        apart[~(met[:, :, None] & met[:, None])] = -1.0
        far = apart.reshape(len(pairs), places.shape[1] ** 2)
        ends = np.stack(np.unravel_index(far.argmax(axis=1), apart.shape[1:]), axis=1)
        cut = np.flatnonzero(far.max(axis=1, initial=-1.0) > 0.0)
        yield pairs[cut], places[cut[:, None], ends[cut]]


def _planes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """See `Shell.planes`; points (T, 3, 3)."""
    edges = points[:, 1:] - points[:, :1]
    normal = np.cross(edges[:, 0], edges[:, 1])
    # What rounding may put off the plane is on it.
    return normal, SNAP * np.linalg.norm(normal, axis=1) * np.abs(edges).max(axis=(1, 2))


def _sides(one: Shell, other: Shell, pairs: np.ndarray) -> np.ndarray:
    """(N, 3) on which side, 1 or -1, of the other glass's triangles the corners of one's lie, by
    pairs (N, 2); 0: in their plane."""
    normal, least = (part[pairs[:, 1]] for part in other.planes)
    corners = one.points[pairs[:, 0]] - other.points[pairs[:, 1], :1]
    off = np.einsum("nk,njk->nj", normal, corners)
    return np.where(np.abs(off) < least[:, None], 0, np.sign(off)).astype(np.int8)


def _near(mine: Shell, theirs: Shell) -> np.ndarray:
    """Pairs (N, 2) of numbers of two glasses' triangles whose boxes touch."""
    slack = SNAP * float(max(np.ptp(shell.box, axis=0).max() for shell in (mine, theirs)))
    trees = [mine.boxes, theirs.boxes]
    levels = [len(boxes) - 1 for _, boxes in trees]
    pairs = np.zeros((2, 1), int)
    while True:
        one, other = (
            boxes[level][numbers]
            for (_, boxes), level, numbers in zip(trees, levels, pairs, strict=True)
        )
        touch = (one[:, 0] <= other[:, 1] + slack) & (one[:, 1] >= other[:, 0] - slack)
        pairs = pairs[:, touch.all(axis=1)]
        if not any(levels):
            break
        # On in both where they are of one level, else in the larger tree.
        deepest = max(levels)
        for side in range(2):
            if levels[side] < deepest:
                continue
            levels[side] -= 1
            below = BRANCHES * pairs[side][:, None] + np.arange(BRANCHES)
            pairs = np.repeat(pairs, BRANCHES, axis=1)
            pairs[side] = below.ravel()
            pairs = pairs[:, pairs[side] < len(trees[side][1][levels[side]])]
    return np.stack([order[numbers] for (order, _), numbers in zip(trees, pairs, strict=True)], 1)


def _boxes(points: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """An order (T,) of triangles in which neighbours are near each other, and boxes round them.

    Boxes are (B, 2, 3), of each triangle first, then of `BRANCHES` boxes each, up to one of all.
    """
    low, high = points.min(axis=1), points.max(axis=1)
    middle = 0.5 * (low + high)
    cell = middle - middle.min(axis=0)
    cell = (cell * ((CELLS - 1) / max(float(cell.max()), LEAST))).astype(np.int64)
    # Morton's order: the bits of the three coordinates in turn.
    code = np.zeros(len(points), np.int64)
    for bit in range(CELLS.bit_length() - 1):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.argsort(code, kind="stable")
    boxes = [np.stack((low, high), axis=1)[order]]
    while len(boxes[-1]) > 1:
        starts = np.arange(0, len(boxes[-1]), BRANCHES)
        lower = np.minimum.reduceat(boxes[-1][:, 0], starts)
        upper = np.maximum.reduceat(boxes[-1][:, 1], starts)
        boxes.append(np.stack((lower, upper), axis=1))
    return order, boxes


def _through(
    begin: np.ndarray, end: np.ndarray, faces: np.ndarray, normal: np.ndarray, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where lines (N, 3) to (N, 3) run through triangles (N, 3, 3), and (N,) whether they do.

    A line that ends on a triangle does; one in its plane does not. For the planes see
    `Shell.planes`.
    """
    before, behind = (np.einsum("nk,nk->n", normal, place - faces[:, 0]) for place in (begin, end))
    before, behind = (np.where(np.abs(off) < least, 0.0, off) for off in (before, behind))
    crosses = (np.sign(before) * np.sign(behind) <= 0.0) & (before != behind)
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
