# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes, as the live view's shader reads them: triangles in a tree of boxes.

All leaves are on the last level. So a node's place tells those of its children, and the shader
walks the tree without a stack: children of node n are 2 n and 2 n + 1, the root is 1. It needs
neither Blender nor a GPU.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..optics.axial import BoundedGlass, Interface
from ..optics.facets import placed

LEAF = 2
"""Triangles of a leaf, at most."""
NODE_TEXELS = 2
"""Four floats each: the box of a child, see `_packed`. There is no node 0; in its place is the grid
of the boxes: its origin, and steps for a unit along each axis."""
TRIANGLE_TEXELS = 6
"""Of a triangle: a corner and the edges from it to the others; the normals of the corners. Their
fourth numbers are the corners' normals for rays from within, two each, see `_flattened`."""
PAINT_TEXELS = 4
"""Of a triangle of a painted mesh, behind all triangles: the parts of light that get through where
it is refracted, at each corner, and the corners' roughness. The fourth numbers are the parts where
it is reflected, see `_in_one`."""
ROW_BITS = 12
"""The texture is 2 to this power texels wide."""
MOST_TRIANGLES = 300_000
"""Of one glass: more of them take too long to be sorted between two events."""
LARGE, SLANTED = 64.0, 8.0
"""Of triangles that are halved before they are sorted: the area of their box, by the median of all
and by their own. The slivers that a face of many corners consists of are such."""
MARGIN = 2e-6
"""By how much boxes are wider than what they hold, in units of the glass: rounding."""
BITS = 16
"""Of a number of a box in the tree's grid."""


@dataclass(frozen=True)
class Pieces:
    """Parts of triangles, which stay the same parts where the triangles are deformed.

    Attributes
    ----------
    whole : (K,) triangles that are left as they are. parted : (P,) of which triangle each part is.
    shares : (P, 3, 3) of that triangle's corners in each of the part's corners.
    """

    whole: np.ndarray
    parted: np.ndarray
    shares: np.ndarray

    def of(self, values: np.ndarray) -> np.ndarray:
        """(K + P, 3, 3) points or normals of the pieces. Normals run on as they did."""
        if not len(self.parted):
            return values
        return np.concatenate((values[self.whole], self.shares @ values[self.parted]))


class Tree:
    """The triangles of a mesh, sorted.

    Attributes
    ----------
    count : of the triangles. order : (`LEAF` · leaves,) numbers of their pieces, leaf by leaf; -1:
        none is there. leaves : how many, a power of two.
    texels : (K, 4) float32: what the shader reads, nodes first. triangles, paint : its rows where
        these begin, 0: it is not painted. roughness : of its roughest corner, if it is painted.
    """

    def __init__(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        pieces: Pieces,
        order: np.ndarray,
        within: np.ndarray | None = None,
        finish: np.ndarray | None = None,
    ) -> None:
        self.count, self.order, self._pieces = len(points), order, pieces
        self.leaves = len(order) // LEAF
        self.triangles = NODE_TEXELS * self.leaves
        end = self.triangles + TRIANGLE_TEXELS * len(order)
        self.paint = 0 if finish is None else end
        self.roughness = 0.0 if finish is None else float(finish[..., 0].max())
        used = end if finish is None else end + PAINT_TEXELS * len(order)
        self.texels = np.zeros((used, 4), np.float32)
        within = None if within is None else pieces.of(within)
        self._write(pieces.of(points), pieces.of(normals), within)
        if finish is not None:
            slots = np.flatnonzero(order >= 0)
            rows = self.texels[end:].reshape(-1, PAINT_TEXELS, 4)
            finish = pieces.of(finish)[order[slots]]
            rows[slots, :3, :3], rows[slots, :3, 3] = finish[..., 1:4], _in_one(finish[..., 4:])
            rows[slots, 3, :3] = finish[..., 0]

    def refitted(self, points: np.ndarray, normals: np.ndarray) -> Tree:
        """The tree of as many triangles (T, 3, 3) in other places, in the same order."""
        return Tree(points, normals, self._pieces, self.order)

    def _write(self, points: np.ndarray, normals: np.ndarray, within: np.ndarray | None) -> None:
        slots = np.flatnonzero(self.order >= 0)
        order = self.order[slots]
        points, normals = points[order], normals[order]
        end = self.triangles + TRIANGLE_TEXELS * len(self.order)
        triangles = self.texels[self.triangles : end].reshape(-1, TRIANGLE_TEXELS, 4)
        triangles[slots, 0, :3] = points[:, 0]
        triangles[slots, 1:3, :3] = points[:, 1:] - points[:, :1]
        triangles[slots, 3:, :3] = normals
        if within is not None:
            triangles[slots, :, 3] = _flattened(within[order]).reshape(-1, TRIANGLE_TEXELS)
        # Boxes of leaves without a triangle enclose nothing.
        low = np.full((len(self.order), 3), np.inf)
        high = -low
        low[slots], high[slots] = points.min(axis=1) - MARGIN, points.max(axis=1) + MARGIN
        low = low.reshape(self.leaves, LEAF, 3).min(axis=1)
        high = high.reshape(self.leaves, LEAF, 3).max(axis=1)
        nodes = self.texels[: self.triangles].reshape(self.leaves, NODE_TEXELS, 4)
        # As the shader reads them.
        nodes[0, 0, :3] = low.min(axis=0) - MARGIN
        nodes[0, 1, :3] = (2**BITS - 1) / (high.max(axis=0) + MARGIN - nodes[0, 0, :3])
        origin, steps = nodes[0, :, :3].astype(float)
        low, high = np.floor((low - origin) * steps), np.ceil((high - origin) * steps)
        while len(low) > 1:
            half = len(low) // 2
            nodes[half : 2 * half] = _packed(low, high).reshape(half, 2, 4)
            low = low.reshape(half, 2, 3).min(axis=1)
            high = high.reshape(half, 2, 3).max(axis=1)


def _flattened(normals: np.ndarray) -> np.ndarray:
    """(…, 2) unit normals on an octahedron that is unfolded, above 0 (Z. Cigolle et al., A Survey
    of Efficient Representations for Independent Unit Vectors, 2014)."""
    flat = normals / np.abs(normals).sum(axis=-1, keepdims=True)
    sign = np.where(flat[..., :2] < 0.0, -1.0, 1.0)
    below = (1.0 - np.abs(flat[..., 1::-1])) * sign
    return np.where(flat[..., 2:] < 0.0, below, flat[..., :2]) + UNFOLDED


def _in_one(colours: np.ndarray) -> np.ndarray:
    """(…,) floats that hold colours (…, 3) from 0 to 1, of eight bits a channel."""
    return np.round(255.0 * colours) @ (65536.0, 256.0, 1.0)


UNFOLDED = 2.0
"""Of the two numbers: so none of them is 0, which says that there are none."""


def _packed(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N, 4) float32: boxes of whole numbers (N, 3) from 0 on, of `BITS` bits.

    To read a texel takes software longer than to take it apart. The third number of a corner lies
    in the upper bits of the two others: floats hold 24 bits exactly. What encloses nothing is a
    corner of the grid, where nothing is.
    """
    is_empty = low > high
    low, high = np.where(is_empty, 0.0, low), np.where(is_empty, 0.0, high)
    upper, lower = np.divmod(np.stack((low[:, 2], high[:, 2]), axis=1), 2 ** (BITS // 2))
    found = np.concatenate((low[:, :2], high[:, :2]), axis=1)
    found[:, ::2] += 2**BITS * lower
    found[:, 1::2] += 2**BITS * upper
    return found.astype(np.float32)


def leaves_of(triangles: int) -> int:
    """How many leaves a tree of as many triangles has."""
    leaves = 1
    while LEAF * leaves < triangles:
        leaves *= 2
    return leaves


def grow(
    points: np.ndarray,
    normals: np.ndarray,
    within: np.ndarray | None = None,
    finish: np.ndarray | None = None,
) -> Iterator[Tree | None]:
    """Sort triangles (T, 3, 3) into a tree: an axis of a level at each step, and the tree at last.

    Every node is cut where rays look at the fewest triangles, as far as both parts have room: a ray
    meets a box as often as this has area (the surface area heuristic; J. D. MacDonald and K. S.
    Booth, Heuristics for Ray Tracing Using Space Subdivision, 1990).
    """
    pieces = halved(points)
    yield None
    parts = pieces.of(points)
    middles = parts.mean(axis=1).T
    # Of boxes lower ends and, turned round, upper ones: the least of both is what encloses all.
    ends = np.concatenate((parts.min(axis=1).T, -parts.max(axis=1).T))
    sorts = [np.argsort(middles[axis]) for axis in range(3)]
    yield None
    node, sizes = np.zeros(len(parts), np.uint32), np.array([len(parts)])
    leaves = leaves_of(len(parts))
    while len(sizes) < leaves:
        room = LEAF * leaves // (2 * len(sizes))
        filled = np.flatnonzero(sizes)
        first = (np.cumsum(sizes) - sizes)[filled]
        own = np.repeat(np.arange(len(sizes)), sizes)
        before = np.arange(len(parts)) - np.repeat(first, sizes[filled])
        after = sizes[own] - before
        cuts, costs = np.zeros((3, len(sizes)), np.intp), np.zeros((3, len(sizes)))
        for axis, sort in enumerate(sorts):
            # Of each node cut before each of its triangles.
            sorted_ = ends[:, sort]
            left = np.roll(_swept(sorted_, own), 1)
            right = _swept(sorted_[:, ::-1], own[-1] - own[::-1])[::-1]
            cost = np.where(before > 0, before * left, 0.0) + after * right
            cost[(before > room) | (after > room)] = np.inf
            costs[axis, filled] = np.minimum.reduceat(cost, first)
            best = np.flatnonzero(cost == costs[axis][own])[::-1]
            cuts[axis, own[best]] = before[best]
            yield None
        axis = np.argmin(costs, axis=0)
        cut = np.choose(axis, cuts)
        order = np.choose(axis[own], sorts)
        node[order] = 2 * own + (before >= cut[own])
        sizes = np.stack((cut, sizes - cut), axis=1).ravel()
        sorts = [sort[np.argsort(node[sort], kind="stable")] for sort in sorts]
    slots = np.full((leaves, LEAF), -1)
    slots[np.arange(LEAF) < sizes[:, None]] = sorts[0]
    yield None
    yield Tree(points, normals, pieces, slots.ravel(), within, finish)


def _swept(ends: np.ndarray, within: np.ndarray) -> np.ndarray:
    """(N,) half the area of the box round all boxes of a node up to each.

    ``ends``: (6, N) lower ends of boxes, and upper ones turned round. ``within``: (N,) their nodes.
    """
    # Each node lies beyond all that was met before it.
    apart = within * (2.0 * np.ptp(ends))
    ends = np.minimum.accumulate(ends - apart, axis=1) + apart
    x, y, z = -ends[3:] - ends[:3]
    return x * y + y * z + z * x


def halved(points: np.ndarray) -> Pieces:
    """Triangles (T, 3, 3), those halved again and again whose boxes are large for what they hold.

    A tree parts boxes: where many lie over each other, all of them are looked at. (M. Ernst and G.
    Greiner, Early Split Clipping for Bounding Volume Hierarchies, 2007.) There are at most twice as
    many pieces as triangles.
    """
    most, limit = min(2 * len(points), MOST_TRIANGLES), LARGE * np.median(_box_areas(points))

    def is_large(parts: np.ndarray) -> np.ndarray:
        box, own = _box_areas(parts), np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0])
        return (box > limit) & (box > SLANTED * np.abs(own).sum(axis=1))

    large = is_large(points)
    whole, parted = np.flatnonzero(~large), np.flatnonzero(large)
    shares = np.tile(np.eye(3), (len(parted), 1, 1))
    while True:
        parts = shares @ points[parted]
        some = is_large(parts)
        if not some.any() or len(whole) + len(parts) + some.sum() > most:
            return Pieces(whole, parted, shares)
        longest = np.linalg.norm(parts[some] - np.roll(parts[some], -1, axis=1), axis=2)
        corners = (longest.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.swapaxes(np.take_along_axis(shares[some], corners[..., None], axis=1), 0, 1)
        middle = 0.5 * (a + b)
        both = np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)
        parted = np.concatenate((parted[~some], parted[some], parted[some]))
        shares = np.concatenate((shares[~some], *both))


def _box_areas(points: np.ndarray) -> np.ndarray:
    """(T,) half the area of the boxes of triangles (T, 3, 3)."""
    size = np.ptp(points, axis=1)
    return (size * np.roll(size, 1, axis=1)).sum(axis=1)


@dataclass(frozen=True)
class Triangles:
    """Stands for the surface of a mesh, among those of other glasses."""

    tree: Tree


@dataclass(frozen=True)
class MeshBody(BoundedGlass):
    """A glass that is a mesh, in a frame of its own: its box's middle is the origin.

    Attributes
    ----------
    tree : its triangles, in units of `scale`.
    ior : of the glass.
    unit : `scale`, metres.
    half : (3,) half the sides of its box, metres.
    refracted, reflected : parts of the light, red, green, blue, that get through where it is
        refracted and reflected, beside Fresnel's law.
    roughness : of its surface; of a painted one 0 only if it is smooth everywhere.
    """

    tree: Tree
    ior: float
    unit: float
    half: tuple[float, float, float]
    refracted: tuple[float, float, float] = (1.0, 1.0, 1.0)
    reflected: tuple[float, float, float] = (1.0, 1.0, 1.0)
    roughness: float = 0.0

    @property
    def scale(self) -> float:
        return self.unit

    @property
    def media(self) -> tuple[float, float]:
        return (1.0, self.ior)

    @property
    def interfaces(self) -> tuple[Interface, ...]:
        return (Interface("surface", Triangles(self.tree), 0, 1),)

    @property
    def box(self) -> np.ndarray:
        return np.array((self.half, self.half)) * ((-1.0,), (1.0,))

    def medium_at(self, points: np.ndarray) -> np.ndarray:
        """0: rays that start in a mesh learn it from the first face that they meet."""
        return np.zeros(np.shape(points)[:-1], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Shaped:
    """Triangles of a mesh in the frame of a `MeshBody`, and that frame.

    Attributes
    ----------
    points, normals : (T, 3, 3), in units of `scale`. half : see `MeshBody`.
    within : (T, 3, 3) the normals for rays that come from within, if they are others.
    finish : (T, 3, 7) as of `Corners`.
    middle : (3,) metres, of the frame in which `stretch` leaves the mesh.
    """

    points: np.ndarray
    normals: np.ndarray
    scale: float
    half: tuple[float, float, float]
    middle: np.ndarray
    within: np.ndarray | None = None
    finish: np.ndarray | None = None


def polar(linear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (3, 3) matrix as a rotation after a stretch, which mirrors if the matrix does."""
    left, size, right = np.linalg.svd(linear)
    sign = np.sign(np.linalg.det(linear))
    return sign * left @ right, sign * (right.T * size) @ right


def shaped(
    points: np.ndarray,
    normals: np.ndarray,
    stretch: np.ndarray,
    within: np.ndarray | None = None,
    finish: np.ndarray | None = None,
) -> Shaped:
    """Triangles (T, 3, 3) of a mesh, stretched, in a frame of their own. ``finish`` goes with them.

    Raises
    ------
    ValueError
        They have no area.
    """
    if within is not None:
        within = placed(points, within, stretch, 0.0)[1]
    points, normals, _ = placed(points, normals, stretch, 0.0)
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    scale = float(half.max())
    if scale == 0.0:
        raise ValueError("its mesh has no area")
    return Shaped(
        np.ascontiguousarray((points - middle) / scale),
        np.ascontiguousarray(normals),
        scale,
        tuple(half.tolist()),
        middle,
        within,
        finish,
    )
