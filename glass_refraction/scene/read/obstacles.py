# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands between glasses: rays that left one and meet this do not reach the other."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree


@dataclass(eq=False)
class Obstacle:
    """A source's triangles, in the world.

    ``points`` (N, 3), ``corners`` (T, 3).
    """

    points: np.ndarray
    corners: np.ndarray
    _tree: BVHTree | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        # The tree holds float32: round the triangles' own middle and size that is enough.
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        self._middle, self._size = 0.5 * (low + high), max(float((high - low).max()), 1e-30)
        self._low, self._high = low, high
        self.stamp = (zlib.crc32(self.points.tobytes()), zlib.crc32(self.corners.tobytes()))

    def box(self) -> np.ndarray:
        """The corners (8, 3) of a box round it."""
        sides = np.stack((self._low, self._high))
        return np.stack([sides[[k & 1, k >> 1 & 1, k >> 2], range(3)] for k in range(8)])

    def overlaps(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether any of it may lie in a box."""
        return bool(np.all(self._low <= high) and np.all(self._high >= low))

    def stops(self, origin: np.ndarray, direction: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """(M,) which rays, unit directions, meet it within their reach."""
        return np.isfinite(self.met_after(origin, direction, reach))

    def met_after(self, origin: np.ndarray, direction: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """(M,) metres to where rays, unit directions, meet it within their reach; else infinite."""
        safe = np.where(np.abs(direction) < 1e-30, 1e-30, direction)
        first, second = (self._low - origin) / safe, (self._high - origin) / safe
        enters = np.minimum(first, second).max(axis=1)
        leaves = np.maximum(first, second).min(axis=1)
        found = np.full(len(origin), np.inf)
        some = np.flatnonzero((leaves >= np.maximum(enters, 0.0)) & (enters <= reach))
        if not len(some):
            return found
        if self._tree is None:
            self._tree = BVHTree.FromPolygons(
                ((self.points - self._middle) / self._size).tolist(),
                self.corners.tolist(),
                all_triangles=True,
            )
        start = ((origin[some] - self._middle) / self._size).tolist()
        way = (reach[some] / self._size).tolist()
        cast = self._tree.ray_cast
        for number, place, along, far in zip(
            some.tolist(), start, direction[some].tolist(), way, strict=True
        ):
            distance = cast(Vector(place), Vector(along), far)[3]
            if distance is not None:
                found[number] = distance * self._size
        return found
