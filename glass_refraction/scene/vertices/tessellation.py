# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles split where their straight images would miss the true ones.

Pure arrays: a source's triangles go in, smaller triangles come out, each with the source triangle
that it is a part of and the barycentric coordinates of its corners there, from which
``mesh_arrays`` makes every attribute. A triangle is split at the middles of its edges and an edge
is shared by its triangles, so no cracks open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ... import optics
from ..read.triangles import Triangles
from ..read.viewpoint import Viewpoint

MAX_VERTICES = 100_000
"""Refinement stops here; the bound that is reported then tells what was reached."""
PER_PIXEL = 16
"""Vertices that may be added for each pixel that the glass covers: a cup in 80 x 80 pixels needs 8
to come to rest. In a small picture this ends a refinement that would never do so, such as of a face
that a bottle shows in many pieces."""
MAX_ROUNDS = 18
FINE_VERTICES = 30_000
FINE_SHARE = 0.2
"""A source that ends up small is split down to this part of the tolerance: a gap of a quarter pixel
at a hard edge of a texture costs 6 dB against a tenth, and on few vertices the gain is free."""
INTERIOR = 4.0 / 3.0
"""Largest gap inside a triangle over the largest at its edges' middles: with vector gaps e, a
quadratic map misses the flat one by 4 (e12 a b + e23 b c + e31 c a) at barycentric a, b, c."""
SHORT_EDGE_PX = 1.0
"""An edge whose ends appear this near to each other is not split, whatever lies between them."""
ACROSS_PX = 3.0
"""The same for an edge between whose ends an image slot ends."""

FAR = 1e18
"""Beyond all that a ray can meet: single precision holds its square, too."""
MOST_MET = 16
"""Triangles along one ray of a probe; another ray finds what lies behind so many."""
FEW_POINTS = 10_000
"""A mesh of more than this is taken to be fine: what is seen of a face is seen of a corner too."""


@dataclass(frozen=True, eq=False)
class Images:
    """Where points appear along one path.

    Attributes
    ----------
    position : (B, N, 3) in the world. valid : (B, N). stretch : (B,) of the path.
    """

    position: np.ndarray
    valid: np.ndarray
    stretch: np.ndarray


Solve = Callable[[np.ndarray], Images]


WIDER = 0.1
"""Part of its diagonal by which a box grows for rays that pass beside it."""


@dataclass(frozen=True, eq=False)
class Probe:
    """Rays of the region behind the first surface, to find what large faces they meet.

    ``origin`` and ``direction`` (R, 3), world; ``length`` (R,), metres, how far each goes.
    """

    origin: np.ndarray
    direction: np.ndarray
    length: np.ndarray

    def meets_box(self, points: np.ndarray) -> bool:
        """Whether a ray passes the points' bounding box, widened by `WIDER`."""
        low, high = points.min(axis=0), points.max(axis=0)
        wider = WIDER * np.linalg.norm(high - low)
        direction = np.where(np.abs(self.direction) < 1e-12, 1e-12, self.direction)
        first = (low - wider - self.origin) / direction
        second = (high + wider - self.origin) / direction
        enters = np.minimum(first, second).max(axis=1)
        leaves = np.maximum(first, second).min(axis=1)
        return bool(np.any((leaves >= 0) & (enters <= np.minimum(leaves, self.length))))


class EdgeImages:
    """How edges appear: by their ends, and by their middles where those are asked for.

    Attributes
    ----------
    gap : (E,) pixels between the middle of the straight image and the image of the middle
        (optics notes, section 6), the largest over the slots; 0 where no middle was measured.
    length : (E,) pixels between the images of the ends; infinite where only the middle is seen.
    box : (E, 4) pixels: low and high corner of what is seen; low > high where nothing is.
    across : (E,) a slot ends between the edge's ends.
    """

    def __init__(
        self,
        points: np.ndarray,
        edges: np.ndarray,
        ends: Images,
        view: Viewpoint,
    ) -> None:
        """Of the edges (E, 2) of points (N, 3), whose images are ``ends``, their ends alone."""
        count = len(edges)
        self.edges, self.ends, self.view = edges, ends, view
        self.gap, self.length = np.zeros(count), np.zeros(count)
        self.across = np.zeros(count, bool)
        self.box = np.empty((count, 4))
        self.box[:, :2], self.box[:, 2:] = np.inf, -np.inf
        self.places = [view_pixels(view, ends.position[slot]) for slot in range(len(ends.stretch))]
        self._direct = np.zeros(count)
        for slot in range(len(ends.stretch)):
            valid = ends.valid[slot][edges]
            if not valid.any():
                continue
            first, second = (self.places[slot][edges[:, k]] for k in range(2))
            apart = np.linalg.norm(second - first, axis=1)
            # Where a slot ends between two vertices (at an interface, a fold, the edge of what the
            # path can reach), what it says of the farther one means little: take the edge as it
            # stands.
            here = valid[:, 0] != valid[:, 1]
            if here.any():
                pair = view_pixels(view, points[edges[here]].reshape(-1, 3)).reshape(-1, 2, 2)
                self._direct[here] = np.linalg.norm(pair[:, 1] - pair[:, 0], axis=1)
                apart[here] = self._direct[here]
            self.across |= here
            self.length = np.maximum(self.length, np.where(valid.any(axis=1), apart, 0.0))
            self._widen(slice(None), first, valid[:, 0])
            self._widen(slice(None), second, valid[:, 1])

    def doubtful(self, near: np.ndarray, aim: float, search: bool) -> np.ndarray:
        """(E,) whose middles have to be solved: long enough to be split, and near enough.

        Parameters
        ----------
        near : (E,) as :meth:`near` says.
        search : also those that lie elsewhere by their ends, or of which neither end is seen.
        """
        long = self.length > np.where(self.across, *self._least(aim))
        return long | (self.length == 0) if search else long & near

    def measure(self, which: np.ndarray, middles: Images) -> None:
        """Take in the images of the middles of the edges ``which`` (K,), indices."""
        edges, names = self.edges[which], _slot_names(middles)
        for slot, name in enumerate(_slot_names(self.ends)):
            valid = self.ends.valid[slot][edges]
            chord = self.ends.position[slot][edges].mean(axis=1)
            place, middle_valid = chord, np.zeros(len(edges), bool)
            if name in names:
                place = middles.position[names.index(name)]
                middle_valid = middles.valid[names.index(name)]
            middle = view_pixels(self.view, place)
            off = np.linalg.norm(middle - view_pixels(self.view, chord), axis=1)
            off = np.where(valid[:, 0] != valid[:, 1], self._direct[which], off)
            seen = valid.any(axis=1) | middle_valid
            self.gap[which] = np.maximum(self.gap[which], np.where(seen, off, 0.0))
            self.length[which[middle_valid & ~valid.any(axis=1)]] = np.inf
            self._widen(which, middle, middle_valid)

    def near(self, triangle_edges: np.ndarray, rect) -> np.ndarray:
        """(E,) whether a triangle (T, 3) of the edge appears in the pixel rectangle."""
        near = np.zeros(len(self.gap), bool)
        near[triangle_edges[overlaps(face_boxes(self.box, triangle_edges), rect)].ravel()] = True
        return near

    def bound(self, near: np.ndarray) -> float:
        """The largest gap in pixels that a triangle with these edges (E,) bool can have."""
        seen = near & (self.length > SHORT_EDGE_PX) & ~self.across
        return INTERIOR * float(self.gap[seen].max(initial=0.0))

    def wrong(self, near: np.ndarray, aim: float) -> np.ndarray:
        """(E,) which of these edges miss by more than ``aim`` pixels and are long enough."""
        return near & (self.length > np.where(self.across, *self._least(aim))) & (self.gap > aim)

    def _least(self, aim: float) -> tuple[float, float]:
        """Pixels that an edge has to be long to be split: where a slot ends in it, elsewhere."""
        least = max(ACROSS_PX, 4 * aim)
        return least, max(SHORT_EDGE_PX, aim)

    def _widen(self, which, places: np.ndarray, counts: np.ndarray) -> None:
        box = self.box[which]
        counts = counts[:, None]
        box[:, :2] = np.where(counts, np.minimum(box[:, :2], places), box[:, :2])
        box[:, 2:] = np.where(counts, np.maximum(box[:, 2:], places), box[:, 2:])
        self.box[which] = box


def view_pixels(view: Viewpoint, points: np.ndarray) -> np.ndarray:
    """Pixel coordinates (N, 2), finite also for points behind the eye (then far off)."""
    clip = view.clip(points)
    w = np.where(clip[:, 2] > 1e-9, clip[:, 2], 1e-9)
    return np.clip(clip[:, :2] / w[:, None] * view.size, -1e5, 1e5)


def face_boxes(box: np.ndarray, triangle_edges: np.ndarray) -> np.ndarray:
    """Boxes (T, 4) round the seen parts of the triangles' edges."""
    return np.concatenate(
        (box[triangle_edges, :2].min(axis=1), box[triangle_edges, 2:].max(axis=1)), axis=1
    )


def overlaps(box: np.ndarray, rect: tuple[int, int, int, int]) -> np.ndarray:
    """Which boxes (K, 4), low and high corner, meet the pixel rectangle."""
    return (
        (box[:, 0] < rect[2])
        & (box[:, 2] > rect[0])
        & (box[:, 1] < rect[3])
        & (box[:, 3] > rect[1])
    )


@dataclass(frozen=True, eq=False)
class Refined:
    """What a refinement ended with: the triangles, and a bound on the gaps left."""

    triangles: Triangles
    bound_px: float
    visible: bool


def refine(
    triangles: Triangles,
    solve: Solve,
    probe: Probe,
    view: Viewpoint,
    rect: tuple[int, int, int, int],
    tolerance_px: float,
    importance: float = 1.0,
) -> Refined:
    """Split triangles until no edge's image in ``rect`` misses the true one by more than tolerated.

    Every point is solved once: the middle of an edge that is split becomes a vertex.

    Parameters
    ----------
    importance : the path's part of the light; of the vertices that may be made it gets this part.
    """
    pixels = (rect[2] - rect[0]) * (rect[3] - rect[1])
    most = min(importance * MAX_VERTICES, len(triangles.points) + PER_PIXEL * pixels)
    fine = importance * FINE_VERTICES
    ends = solve(triangles.points)
    middles = _Middles(solve, _empty(ends))
    worst, visible = 0.0, False
    for _ in range(MAX_ROUNDS):
        edges, triangle_edges = triangles.edges()
        keys = edges[:, 0].astype(np.int64) << 32 | edges[:, 1]
        aim = tolerance_px / INTERIOR
        if len(triangles.points) < fine:
            aim *= FINE_SHARE
        found = EdgeImages(triangles.points, edges, ends, view)
        near = found.near(triangle_edges, rect)
        doubtful = found.doubtful(near, aim, may_hide_more(ends))
        asked = np.nonzero(doubtful)[0]
        found.measure(asked, middles.of(keys[asked], triangles.points[edges[asked]]))
        near = found.near(triangle_edges, rect)
        worst = found.bound(near)
        visible = bool(near.any())
        chosen = found.wrong(near, aim)
        # A large face may be seen only somewhere in its middle: ask the rays.
        # (A corner may have an image beside the picture's part, in the glass without its ends.)
        beside = ~overlaps(face_boxes(found.box, triangle_edges), rect)
        whole = ends.valid[:, triangles.corners].all(axis=2).any(axis=0)
        unseen = np.nonzero(beside & ~whole)[0]
        met = unseen[_met_by(probe, triangles.points[triangles.corners[unseen]])]
        chosen[triangle_edges[met].ravel()] = True
        # With its longest edge whole, a triangle that is split again and again becomes a sliver.
        along = triangles.points[edges[:, 1]] - triangles.points[edges[:, 0]]
        size = np.linalg.norm(along, axis=1)[triangle_edges]
        longest = triangle_edges[np.arange(len(triangle_edges)), size.argmax(axis=1)]
        chosen[longest[chosen[triangle_edges].any(axis=1)]] = True
        if not chosen.any() or len(triangles.points) + chosen.sum() > most:
            break
        ends = _joined(ends, middles.of(keys[chosen], triangles.points[edges[chosen]]))
        triangles = triangles.split(edges, triangle_edges, chosen)
    return Refined(triangles, worst, visible)


class _Middles:
    """Images of the middles of edges, each solved once however often it is asked for."""

    def __init__(self, solve: Solve, none: Images) -> None:
        self.solve, self.keys, self.images = solve, np.empty(0, np.int64), none

    def of(self, keys: np.ndarray, ends: np.ndarray) -> Images:
        """Of edges with these keys (K,) and ends (K, 2, 3), in their order."""
        new = ~np.isin(keys, self.keys)
        if new.any():
            self.keys = np.concatenate((self.keys, keys[new]))
            self.images = _joined(self.images, self.solve(ends[new].mean(axis=1)))
        order = np.argsort(self.keys)
        return _taken(self.images, order[np.searchsorted(self.keys, keys, sorter=order)])


def may_hide_more(images: Images) -> bool:
    """Whether large faces may be seen although none of their vertices is."""
    return images.valid.shape[1] < FEW_POINTS and not images.valid.any(axis=0).all()


def _slot_names(images: Images) -> list[tuple[int, int]]:
    """(stretch, number within it) of each slot: what a slot is called from one call to the next."""
    names, counts = [], {}
    for stretch in images.stretch.tolist():
        names.append((stretch, counts.get(stretch, 0)))
        counts[stretch] = counts.get(stretch, 0) + 1
    return names


def _empty(like: Images) -> Images:
    slots = len(like.stretch)
    return Images(np.empty((slots, 0, 3)), np.empty((slots, 0), bool), like.stretch)


def _taken(images: Images, which: np.ndarray) -> Images:
    return Images(images.position[:, which], images.valid[:, which], images.stretch)


def _joined(first: Images, second: Images) -> Images:
    """Images of the points of both, slot by slot; a slot that one lacks has no images there."""
    names = sorted({*_slot_names(first), *_slot_names(second)})
    total = first.valid.shape[1] + second.valid.shape[1]
    position = np.zeros((len(names), total, 3))
    valid = np.zeros((len(names), total), bool)
    start = 0
    for images in (first, second):
        end = start + images.valid.shape[1]
        for slot, name in enumerate(_slot_names(images)):
            position[names.index(name), start:end] = images.position[slot]
            valid[names.index(name), start:end] = images.valid[slot]
        start = end
    return Images(position, valid, np.array([name[0] for name in names]))


def _met_by(probe: Probe, corners: np.ndarray) -> np.ndarray:
    """Which triangles (T, 3, 3) a ray of the probe meets, however many it meets before."""
    met = np.zeros(len(corners), bool)
    if not met.size or not len(probe.origin):
        return met
    # The tree holds float32: round the triangles' own middle and size that is enough.
    points = corners.reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = max(np.ptp(points, axis=0).max(), 1e-30)
    tree = BVHTree.FromPolygons(
        ((points - middle) / size).tolist(),
        np.arange(len(points)).reshape(-1, 3).tolist(),
        all_triangles=True,
    )
    step = 1e-6
    rays = zip((probe.origin - middle) / size, probe.direction, probe.length / size, strict=True)
    for start, direction, left in rays:
        place, along = Vector(start), Vector(direction)
        for _ in range(MOST_MET):
            hit, _, number, way = tree.ray_cast(place, along, min(left, FAR))
            if hit is None:
                break
            met[number] = True
            place = hit + along * step
            left -= way + step
            if left <= 0.0:
                break
    return met


PROBE_SIDE = 24
"""Rays along each side of the rectangle in which a path is probed."""


def region_probe(glass, view: Viewpoint, path, rect) -> Probe:
    """Rays through a grid of the rectangle's pixels that take the path, on all of its stretches.

    A glass holds things: what stands in it is met on the way.
    """
    x0, y0, x1, y1 = rect
    steps = (np.arange(PROBE_SIDE) + 0.5) / PROBE_SIDE
    x, y = np.meshgrid(x0 + steps * (x1 - x0), y0 + steps * (y1 - y0))
    origins, directions = view.rays(x.ravel(), y.ravel())
    origin, direction, length = optics.stretches(
        glass.description, glass.to_local(origins), glass.direction_to_local(directions), path
    )
    if path.interfaces is not None:
        # A cup's things lie across its surfaces: they are split where they go on, too.
        length = np.full(len(length), np.inf)
    turned = direction @ glass.to_world[:3, :3].T
    return Probe(glass.points_to_world(origin), turned, length)
