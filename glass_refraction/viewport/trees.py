# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes, as the live view's shader reads them: triangles in a tree of boxes.

The tree is balanced: at each level every node's triangles are halved. So a node's place tells those
of its children, and the shader walks it without a stack: children of node n are 2 n and 2 n + 1,
the root is 1, and the leaves are the last level. It needs neither Blender nor a GPU.
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
ROW_BITS = 12
"""The texture is 2 to this power texels wide."""
MOST_TRIANGLES = 300_000
"""Of one glass: more of them take too long to be sorted between two events."""
MARGIN = 2e-6
"""By how much boxes are wider than what they hold, in units of the glass: rounding."""
BITS = 16
"""Of a number of a box in the tree's grid."""


class Tree:
    """The triangles of a mesh, sorted.

    Attributes
    ----------
    order : (T,) numbers of the triangles, leaf by leaf. leaves : how many, a power of two.
    texels : (K, 4) float32: what the shader reads, nodes first. triangles : its row where they
        begin.
    """

    def __init__(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        order: np.ndarray,
        within: np.ndarray | None = None,
    ) -> None:
        self.order = order
        self.leaves = leaves_of(len(order))
        self.triangles = NODE_TEXELS * self.leaves
        rows = self.triangles + TRIANGLE_TEXELS * LEAF * self.leaves
        self.texels = np.zeros((rows, 4), np.float32)
        self._write(points, normals, within)

    def refitted(
        self, points: np.ndarray, normals: np.ndarray, within: np.ndarray | None = None
    ) -> Tree:
        """The tree of as many triangles (T, 3, 3) in other places, in the same order."""
        return Tree(points, normals, self.order, within)

    def _write(self, points: np.ndarray, normals: np.ndarray, within: np.ndarray | None) -> None:
        bounds = bounds_of(len(self.order), self.leaves)
        points, normals = points[self.order], normals[self.order]
        leaf = np.repeat(np.arange(self.leaves), np.diff(bounds))
        slot = LEAF * leaf + np.arange(len(self.order)) - bounds[leaf]
        triangles = self.texels[self.triangles :].reshape(-1, TRIANGLE_TEXELS, 4)
        triangles[slot, 0, :3] = points[:, 0]
        triangles[slot, 1:3, :3] = points[:, 1:] - points[:, :1]
        triangles[slot, 3:, :3] = normals
        if within is not None:
            triangles[slot, :, 3] = _flattened(within[self.order]).reshape(-1, TRIANGLE_TEXELS)
        low = np.minimum.reduceat(points.min(axis=1), bounds[:-1]) - MARGIN
        high = np.maximum.reduceat(points.max(axis=1), bounds[:-1]) + MARGIN
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


UNFOLDED = 2.0
"""Of the two numbers: so none of them is 0, which says that there are none."""


def _packed(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N, 4) float32: boxes of whole numbers (N, 3) from 0 on, of `BITS` bits.

    To read a texel takes software longer than to take it apart. The third number of a corner lies
    in the upper bits of the two others: floats hold 24 bits exactly.
    """
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


def bounds_of(triangles: int, parts: int) -> np.ndarray:
    """(parts + 1,) where each part of sorted triangles begins: halved again and again."""
    return np.arange(parts + 1, dtype=np.int64) * triangles // parts


def grow(
    points: np.ndarray, normals: np.ndarray, within: np.ndarray | None = None
) -> Iterator[Tree | None]:
    """Sort triangles (T, 3, 3) into a tree: an axis of a level at each step, and the tree at last.

    Every node is halved across the axis for which rays look at the fewest triangles: a ray meets a
    box as often as this has area (the surface area heuristic; J. D. MacDonald and K. S. Booth,
    Heuristics for Ray Tracing Using Space Subdivision, 1990).
    """
    order = np.arange(len(points))
    middles, lows, highs = points.mean(axis=1), points.min(axis=1), points.max(axis=1)
    leaves, parts = leaves_of(len(points)), 1
    while parts < leaves:
        part = np.repeat(np.arange(parts), np.diff(bounds_of(len(points), parts)))
        bounds = bounds_of(len(points), 2 * parts)
        sorts, costs = [], []
        for axis in range(3):
            sort = order[np.lexsort((middles[order, axis], part))]
            size = np.maximum.reduceat(highs[sort], bounds[:-1])
            size -= np.minimum.reduceat(lows[sort], bounds[:-1])
            area = (size * np.roll(size, 1, axis=1)).sum(axis=1)
            sorts.append(sort)
            costs.append((area * np.diff(bounds)).reshape(parts, 2).sum(axis=1))
            yield None
        order = np.choose(np.argmin(costs, axis=0)[part], sorts)
        parts *= 2
    yield Tree(points, normals, order, within)


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
    """

    tree: Tree
    ior: float
    unit: float
    half: tuple[float, float, float]
    refracted: tuple[float, float, float] = (1.0, 1.0, 1.0)
    reflected: tuple[float, float, float] = (1.0, 1.0, 1.0)

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
    middle : (3,) metres, of the frame in which `stretch` leaves the mesh.
    """

    points: np.ndarray
    normals: np.ndarray
    scale: float
    half: tuple[float, float, float]
    middle: np.ndarray
    within: np.ndarray | None = None


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
) -> Shaped:
    """Triangles (T, 3, 3) of a mesh, stretched, in a frame of their own.

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
    )
