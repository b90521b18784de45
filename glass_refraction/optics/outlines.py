# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons across the axis: which places lie in one, and how far off its sides are at least.

A grid knows both for whole cells, so that of many places few are held against all sides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

CELLS = 48
"""Cells along each side of a polygon's box."""


@dataclass(frozen=True)
class Outline:
    """A polygon.

    Attributes
    ----------
    corners : (K, 2), in order; no side joins a corner to itself.
    """

    corners: tuple[tuple[float, float], ...]

    @cached_property
    def _bounds(self) -> Floats:
        """The lowest and the highest corner (2, 2) of the polygon's box."""
        corners = np.array(self.corners)
        return np.array((corners.min(axis=0), corners.max(axis=0)))

    @cached_property
    def _box(self) -> tuple[Floats, Floats]:
        """The lower corner (2,) of the polygon's box, and the size (2,) of a cell."""
        low, high = self._bounds
        size = high - low
        return low, np.where(size > 0.0, size, 1.0) / CELLS

    @cached_property
    def _cells(self) -> tuple[Floats, Flags]:
        """Of each cell (`CELLS`², columns first): how far the sides are from all of it at least,
        and whether its middle lies in the polygon."""
        low, step = self._box
        x, y = (low[axis] + step[axis] * (np.arange(CELLS) + 0.5) for axis in (0, 1))
        x, y = (part.ravel() for part in np.meshgrid(x, y, indexing="ij"))
        distance = np.full(len(x), np.inf)
        for (ax, ay), (bx, by) in self.sides:
            dx, dy = bx - ax, by - ay
            along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
            along = np.clip(along, 0.0, 1.0)
            np.minimum(distance, np.hypot(x - ax - along * dx, y - ay - along * dy), out=distance)
        # Cells are taken as a little larger: a place on a cell's edge may count to either.
        reach = 0.5 * (1.0 + 1e-9) * float(np.hypot(*step))
        return np.maximum(distance - reach, 0.0), in_polygon(self.corners, x, y)

    @cached_property
    def _rows(self) -> tuple[Floats, ...]:
        """Of each row of cells, the sides that reach into it: ax, ay, bx, by, each (most, CELLS).

        Where there are fewer, a side without length stands in, which no line crosses.
        """
        low, step = self._box
        sides = np.array(self.sides).reshape(-1, 4)
        reach = np.sort(sides[:, 1::2], axis=1)
        # Rows are taken as a little higher: a place on a row's edge may count to either.
        first = np.clip(np.floor((reach[:, 0] - low[1]) / step[1] - 1e-6), 0, CELLS - 1)
        last = np.clip(np.floor((reach[:, 1] - low[1]) / step[1] + 1e-6), 0, CELLS - 1)
        row = np.arange(CELLS)
        members = [sides[(first <= number) & (number <= last)] for number in row]
        rows = np.zeros((max(map(len, members)), CELLS, 4))
        for number, some in enumerate(members):
            rows[: len(some), number] = some
        return tuple(np.ascontiguousarray(part) for part in np.moveaxis(rows, -1, 0))

    @property
    def sides(self) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
        """Begin and end of each side."""
        return tuple(zip(self.corners, (*self.corners[1:], self.corners[0]), strict=True))

    def _cell(self, x, y) -> NDArray[np.intp]:
        """The cell of each place; of places beyond the box, one at its border."""
        low, step = self._box
        column, row = (
            np.fmin(np.fmax((part - low[axis]) / step[axis], 0.0), CELLS - 1.0).astype(np.intp)
            for axis, part in ((0, x), (1, y))
        )
        return column * CELLS + row

    def _beyond(self, x, y) -> tuple[Floats, Floats]:
        """How far places lie beyond the box along x and along y; 0 within."""
        low, high = self._bounds
        first, second = (
            np.maximum(np.maximum(low[axis] - part, part - high[axis]), 0.0)
            for axis, part in ((0, x), (1, y))
        )
        return first, second

    def clear(self, x, y) -> Floats:
        """No more than the distance of places (x, y) to the nearest side."""
        first, second = self._beyond(x, y)
        outside = np.maximum(first, second)
        return np.where(outside > 0.0, outside, self._cells[0][self._cell(x, y)])

    def holds(self, x, y) -> Flags:
        """Which places lie in the polygon."""
        x, y = np.asarray(x), np.asarray(y)
        cell = self._cell(x, y)
        clear, within = self._cells
        first, second = self._beyond(x, y)
        inside = within[cell] & (np.maximum(first, second) <= 0.0)
        close = np.flatnonzero(clear[cell].ravel() <= 0.0)
        row = cell.ravel()[close] % CELLS
        sides = (tuple(part.take(row) for part in side) for side in zip(*self._rows, strict=True))
        inside.reshape(-1)[close] = _odd(sides, x.ravel()[close], y.ravel()[close])
        return inside


def in_polygon(corners: Sequence[tuple[float, float]], x, y) -> Flags:
    """Which places lie in a polygon, by how often a line towards +x crosses its sides."""
    return _odd((a + b for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)), x, y)


def _odd(sides: Iterable[tuple], x, y) -> Flags:
    """Whether a line from places towards +x crosses an odd number of sides (ax, ay, bx, by).

    The sides' coordinates are numbers, or of each place its own.
    """
    inside = np.zeros(np.shape(x), dtype=bool)
    for ax, ay, bx, by in sides:
        height = by - ay
        slope = (bx - ax) / np.where(height != 0.0, height, 1.0)
        inside ^= ((ay <= y) != (by <= y)) & (x < ax + (y - ay) * slope)
    return inside
