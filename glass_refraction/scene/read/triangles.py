# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles in parts: each part knows its source triangle and where in it it lies.

A triangle is split at the middles of its edges, and an edge is shared by its triangles, so no
cracks open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Triangles:
    """Parts of source triangles.

    Attributes
    ----------
    points : (N, 3) float64, world. corners : (T, 3) indices of points.
    origin : (T,) the source triangle. weights : (T, 3, 3) the corners' barycentric coordinates in
        it.
    """

    points: np.ndarray
    corners: np.ndarray
    origin: np.ndarray
    weights: np.ndarray

    @classmethod
    def whole(cls, points: np.ndarray, corners: np.ndarray) -> Triangles:
        """The source triangles themselves."""
        count = len(corners)
        weights = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
        return cls(points, corners, np.arange(count), weights)

    def moved(self, points: np.ndarray) -> Triangles:
        """The same triangles of points that are elsewhere."""
        other = replace(self, points=points)
        if "_edges" in self.__dict__:
            other.__dict__["_edges"] = self._edges
        return other

    def followed(self, points: np.ndarray, corners: np.ndarray) -> Triangles:
        """The same parts of the source's triangles (corners) of points that are elsewhere."""
        whole, weights = self._rows
        return self.moved(np.einsum("nj,njk->nk", weights, points[corners[whole]]))

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Of each point a source triangle (N,) and where in it the point lies (N, 3)."""
        where = np.zeros(len(self.points), int)
        where[self.corners.ravel()] = np.arange(self.corners.size)
        return self.origin[where // 3], self.weights.reshape(-1, 3)[where]

    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """The distinct edges (E, 2), and each triangle's edges (T, 3): 01, 12 and 20."""
        return self._edges

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        sides = self.corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        sides = np.sort(sides, axis=1)
        keys = sides[:, 0].astype(np.int64) * len(self.points) + sides[:, 1]
        _, first, number = np.unique(keys, return_index=True, return_inverse=True)
        return sides[first], number.reshape(-1, 3)

    def split(self, edges: np.ndarray, triangle_edges: np.ndarray, chosen: np.ndarray) -> Triangles:
        """Split the chosen edges (E,) bool at their middles, and the triangles that have them."""
        middle = np.full(len(edges), -1)
        middle[chosen] = len(self.points) + np.arange(chosen.sum())
        points = np.concatenate((self.points, self.points[edges[chosen]].mean(axis=1)))
        new = middle[triangle_edges]
        count = (new >= 0).sum(axis=1)
        parts = [_Parts(self, count == 0).kept()]
        for number, way in ((1, _ONE), (2, _TWO), (3, _THREE)):
            which = np.nonzero(count == number)[0]
            if len(which):
                parts.append(_Parts(self, which).cut(new[which], number, way))
        corners, origin, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Triangles(points, corners, origin, weights)


# Corners 0, 1, 2 and edge middles 3 (of 01), 4 (of 12), 5 (of 20); turned so that one split edge
# is 01, and two are 01 and 12.
_ONE = ((0, 3, 2), (3, 1, 2))
_TWO = ((3, 1, 4), (0, 3, 2), (3, 4, 2))
_THREE = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))


class _Parts:
    """Some triangles of a set on their way through a split."""

    def __init__(self, triangles: Triangles, which: np.ndarray) -> None:
        self.corners = triangles.corners[which]
        self.origin = triangles.origin[which]
        self.weights = triangles.weights[which]

    def kept(self):
        return self.corners, self.origin, self.weights

    def cut(self, new: np.ndarray, number: int, way):
        """Apply a pattern; ``new`` (K, 3): index of each edge's middle, or -1."""
        if number == 1:
            turn = np.argmax(new >= 0, axis=1)
        elif number == 2:
            turn = (np.argmax(new < 0, axis=1) + 1) % 3
        else:
            turn = np.zeros(len(new), int)
        order = (turn[:, None] + np.arange(3)) % 3
        rows = np.arange(len(new))[:, None]
        six = np.concatenate((self.corners[rows, order], new[rows, order]), axis=1)
        weights = self.weights[rows, order]
        middles = 0.5 * (weights + weights[:, [1, 2, 0]])
        weights = np.concatenate((weights, middles), axis=1)
        pattern = np.array(way)
        repeated = np.repeat(self.origin, len(pattern))
        return (
            six[:, pattern].reshape(-1, 3),
            repeated,
            weights[:, pattern].reshape(-1, 3, 3),
        )
