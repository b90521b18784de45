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
        """A slot to be written; vectors lie component by component in memory."""
        # One piece of memory, which the system can hand out in larger pages than eight small ones.
        columns = np.empty((8, count))
        return cls(
            sheet, columns[:3].T, columns[6], columns[3:6].T, np.empty(count, bool), columns[7]
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

    def room(self) -> tuple[list[Floats], list[Floats]]:
        """Components of direction and position to be computed in place where that can be."""
        vectors = self.slot.direction, self.slot.position
        if isinstance(self.where, slice):
            return tuple([vector[self.where, axis] for axis in range(3)] for vector in vectors)
        return tuple([np.empty(len(self.where)) for _ in range(3)] for _ in vectors)

    def directions(self, which) -> Floats:
        """Directions (K, 3) that were written for some of the points."""
        if isinstance(self.where, slice):
            return self.slot.direction[self.where][which]
        return self.slot.direction[self.where[which]]

    def write(self, direction, distance, position, residual) -> None:
        """Components of vectors as separate arrays (or numbers), in `room` or elsewhere."""
        slot, where = self.slot, self.where
        for vector, parts in ((slot.direction, direction), (slot.position, position)):
            for axis, part in enumerate(parts):
                target = vector[:, axis]
                if not (isinstance(where, slice) and np.ndim(part) and part.base is vector.base):
                    target[where] = part
        slot.distance[where], slot.residual[where] = distance, residual
