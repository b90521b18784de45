# SPDX-License-Identifier: GPL-3.0-or-later
"""What the middles of a view's pixels meet: whether it shows a hit, and beside which silhouettes.

A ray through each pixel's middle is cast once, for all hits that are looked for near it. Hits among
middles that meet the same surface need no ray of their own, and of a view that stays the middles
are known from the last frame, but where something moved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .caster import Caster, Past
from .moved import Boxes
from .things import Things
from .views import RadianceView

STEP = 3.0
"""Distances in neighbouring pixels may differ by so many times what the surface's slope tells."""
DIAGONAL = 1.5
"""The same, of a hit and the four middles round it: they lie a pixel's diagonal apart at most."""
LEAST_SINE = 0.1
"""Of the angle between sight and surface by which its slope is reckoned."""
UNKNOWN = -2
"""In place of a triangle's or surface's number, or of −1 for the sky: nobody asked."""
MARGIN_PX = 2
"""Pixels round what is drawn, so that no neighbour's neighbour lies outside."""
TOGETHER = 200_000
"""Middles that are cast together."""
MOST_KEPT = 1_000_000
"""Pixels of a view whose middles are kept for the next frame, 16 bytes each."""
BESIDE_PX = 2
"""Pixels round a box that moved: in it, or in what rounding adds to it, their middles may lie."""


class Sketch:
    """What the middles of a view's pixels meet, by row and column.

    Attributes
    ----------
    origin : (2,) the frame's pixel in column and row 0.
    triangle, surface : numbers, −1 for the sky, or `UNKNOWN`.
    far : metres to it from where the view begins to see. step : by how much that differs from one
        pixel to the next at most, on a surface.
    """

    def __init__(
        self, view: RadianceView, things: Things, normals: np.ndarray, caster: Caster | Past
    ):
        self._view = view
        self.origin = np.array(view.region[:2]) - MARGIN_PX
        width, height = np.array(view.region[2:]) + MARGIN_PX - self.origin
        self.triangle = np.full((height, width), UNKNOWN, np.int32)
        self.far = np.full((height, width), np.inf, np.float32)
        self.step = np.zeros((height, width), np.float32)
        self.use(things, normals, caster)

    def use(self, things: Things, normals: np.ndarray, caster: Caster | Past) -> None:
        """Take the things of a frame, whose triangles have the numbers that are written here."""
        self._things, self._normals, self._caster = things, normals, caster
        surface = np.append(things.surface, (UNKNOWN, -1)).astype(np.int32)
        self.surface = surface[self.triangle]

    def look(self, asked: np.ndarray) -> None:
        """Know what the middles of some pixels (rows, columns) meet."""
        view, width = self._view, self.triangle.shape[1]
        cells = np.flatnonzero(asked & (self.triangle == UNKNOWN))
        for block in np.split(cells, range(TOGETHER, len(cells), TOGETHER)):
            row, column = np.divmod(block, width)
            origins, directions = view.rays(np.stack((column, row), axis=1) + self.origin + 0.5)
            distance, triangle = self._caster.cast(origins, directions)
            met = triangle >= 0
            sine = np.ones(len(row))
            rows = np.flatnonzero(met)
            normal = self._normals.take(triangle[rows], axis=0)
            sine[rows] = np.abs(np.einsum("nk,nk->n", directions[rows], normal))
            # Metres a pixel, there.
            pixel = (1.0 if view.is_parallel else np.where(met, distance, 0.0)) / view.focal_px
            self.triangle[row, column], self.far[row, column] = triangle, distance
            self.surface[row, column] = self._things.surfaces(triangle)
            self.step[row, column] = STEP * pixel / np.maximum(sine, LEAST_SINE)

    def met(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (K,) that the middles of pixels (K, 2) meet, and metres (K,) to them."""
        asked, (column, row) = np.zeros(self.triangle.shape, bool), (pixels - self.origin).T
        asked[row, column] = True
        self.look(asked)
        return self.triangle[row, column], self.far[row, column].astype(float)

    def shows(self, pixels: np.ndarray, triangle: np.ndarray, length: np.ndarray):
        """Whether hits are seen, as the four nearest middles tell.

        Parameters
        ----------
        pixels : (K, 2) where they would be. triangle : (K,) that is hit; −1: the sky.
        length : (K,) metres to it from where the view begins to see, infinite to the sky.

        Returns
        -------
        shown : (K,) all four meet its surface, as far away. hidden : (K,) all four meet something
            nearer.
        """
        width = self.triangle.shape[1]
        column, row = (np.floor(pixels - 0.5).astype(np.intp) - self.origin).T
        cell = row * width + column
        asked = np.zeros(self.triangle.size, bool)
        asked[cell] = True
        for axis in range(2):
            asked = asked | np.roll(asked, (1, width)[axis])
        self.look(asked.reshape(self.triangle.shape))
        surface = self._things.surfaces(triangle)
        shown, hidden = np.ones(len(cell), bool), np.ones(len(cell), bool)
        nearest, farthest, least = (np.full(len(cell), k) for k in (np.inf, -np.inf, np.inf))
        for corner in (0, 1, width, width + 1):
            there = cell + corner
            far, step = self.far.take(there), self.step.take(there)
            shown &= self.surface.take(there) == surface
            hidden &= far + step < length
            nearest, farthest = np.minimum(nearest, far), np.maximum(farthest, far)
            # One steep middle tells that a fold's other side may be another part of the surface.
            least = np.minimum(least, step)
        least *= DIAGONAL / STEP
        # Of the sky's middles and hits both lengths are infinite.
        shown &= (length - least <= nearest) & (farthest <= length + least)
        return shown, hidden

    def still(self, boxes: Boxes, number: np.ndarray, margin: float) -> bool:
        """Forget what is seen where something moved in boxes; whether anything is left.

        Parameters
        ----------
        number : (T,) of the triangles that were met before, as they are now.
        margin : metres by which boxes are larger.
        """
        known = np.flatnonzero(self.triangle.ravel() >= 0)
        flat = self.triangle.ravel()
        flat[known] = number[flat[known]]
        for low, high in _outlines(self._view, boxes.corners(margin)):
            x0, y0 = np.maximum(np.floor(low) - self.origin - BESIDE_PX, 0.0).astype(int)
            x1, y1 = np.maximum(np.ceil(high) - self.origin + BESIDE_PX, 0.0).astype(int)
            self.triangle[y0:y1, x0:x1] = UNKNOWN
        return bool((self.triangle != UNKNOWN).any())


def _outlines(view: RadianceView, corners: np.ndarray):
    """Lowest and highest pixels (2,) of boxes, by their corners (B, 8, 3)."""
    for box in corners:
        local = view.local(box)
        ahead = -local[:, 2]
        if view.is_parallel or ahead.min() > view.near > 0.0:
            pixels, _ = view.project(local, -np.inf)
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            yield np.clip(low, *_ALL), np.clip(high, *_ALL)
        elif ahead.max() > 0.0:
            yield np.full(2, _ALL[0]), np.full(2, _ALL[1])


_ALL = -1e6, 1e6
"""Pixels beyond those of any picture."""


@dataclass
class Sketches:
    """Those of a frame's views, and of the last frame's as far as they hold.

    Attributes
    ----------
    last, now : by the views' stamps.
    """

    last: dict[tuple, Sketch] = field(default_factory=dict)
    now: dict[tuple, Sketch] = field(default_factory=dict)

    def next_frame(self, boxes: Boxes, number: np.ndarray, margin: float) -> None:
        """Go on to a frame in which things moved; arguments as of `Sketch.still`."""
        self.last, self.now = self.now, {}
        for stamp, sketch in list(self.last.items()):
            if sketch.triangle.size > MOST_KEPT or not sketch.still(boxes, number, margin):
                del self.last[stamp]

    def of(
        self, view: RadianceView, things: Things, normals: np.ndarray, caster: Caster | Past
    ) -> Sketch:
        """That of a view."""
        stamp = view.stamp
        if stamp not in self.now:
            known = self.last.pop(stamp, None)
            if known is not None:
                known.use(things, normals, caster)
            self.now[stamp] = known or Sketch(view, things, normals, caster)
        return self.now[stamp]
