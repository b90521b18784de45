# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of points: the record that callers get, and the piece that each family computes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .paths import ParallelView

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ApparentPoints:
    """Where points appear along one light path.

    The leading axis B counts images (slots): in a slot all images lie on one stretch and one
    sheet, so that neighbouring vertices in it belong together.

    Attributes
    ----------
    direction : (B, N, 3)
        Unit vectors from the eye towards the image; in a parallel view, the view's direction.
    distance : (B, N)
        Geometric length of the light path in metres; in a parallel view counted from the plane
        through the frame's origin across the view's direction.
    position : (B, N, 3)
        Where the displaced vertex goes, metres, in the glass's frame. Where `valid` is False it
        lies at the nearest edge of the sheet that was found, so that a triangle ends there.
    valid : (B, N) bool
        This image exists.
    residual : (B, N)
        Distance at which the traced ray passes the point, metres.
    stretch : (B,) int
        Events passed before the point is met.
    iterations : int
        Most solver steps that any point took.
    sheet : tuple, one entry a slot
        Name of the slot's sheet: (stretch, interfaces met, upright, rank, winding, copy). The same
        sheet has the same name for other points and in other calls.
    """

    direction: Floats
    distance: Floats
    position: Floats
    valid: NDArray[np.bool_]
    residual: Floats
    stretch: NDArray[np.intp]
    iterations: int
    sheet: tuple[tuple, ...] = ()


@dataclass
class Slot:
    """One image of N points: as in `ApparentPoints`, without the axis B."""

    sheet: tuple
    direction: Floats
    distance: Floats
    position: Floats
    valid: NDArray[np.bool_]
    residual: Floats

    @classmethod
    def empty(cls, sheet: tuple, count: int) -> Slot:
        """A slot to be written."""
        return cls(
            sheet,
            np.empty((count, 3)),
            np.empty(count),
            np.empty((count, 3)),
            np.empty(count, dtype=bool),
            np.empty(count),
        )

    @classmethod
    def blank(cls, sheet: tuple, count: int, eye: Floats | ParallelView) -> Slot:
        """A slot without images: everything at the eye."""
        parallel = isinstance(eye, ParallelView)
        slot = cls.empty(sheet, count)
        slot.direction[:] = eye.direction if parallel else (0.0, 0.0, -1.0)
        slot.position[:] = 0.0 if parallel else eye
        slot.distance[:], slot.residual[:], slot.valid[:] = 0.0, 0.0, False
        return slot

    def columns(self) -> tuple:
        return self.direction, self.distance, self.position, self.valid, self.residual

    def part(self, where) -> View:
        return View(self, where)


@dataclass
class View:
    """Some points of a slot, to be written component by component."""

    slot: Slot
    where: slice | NDArray[np.intp]

    def write(self, direction, distance, position, residual) -> None:
        """Components of vectors as separate arrays (or numbers)."""
        slot, where = self.slot, self.where
        for axis in range(3):
            slot.direction[where, axis] = direction[axis]
            slot.position[where, axis] = position[axis]
        slot.distance[where], slot.residual[where] = distance, residual
