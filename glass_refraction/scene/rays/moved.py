# SPDX-License-Identifier: GPL-3.0-or-later
"""What of the things is not as it was, and which rays pass where that is or was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...optics.boxes import meets_boxes
from ...optics.facets import fold
from ...optics.vectors import columns, rotated
from .things import Things

BOXES = 8
"""Boxes in which all that moved lies: more would fit it better and take longer to look through."""

MEASURED = 10_000
"""Corners that tell along which axes boxes lie."""


class Known:
    """Triangles of a frame as the next frame knows them again.

    Parameters
    ----------
    counts : (T,) bool, which triangles rays see that have passed a glass; None: all.
    """

    def __init__(self, things: Things, counts: np.ndarray | None) -> None:
        self.corners = things.points[things.triangles]
        looks = zip(things.owners, things.looks, strict=True)
        # Where lamps are dark they are not there, nor what a material cuts out.
        kinds = [
            (
                owner,
                look.is_lamp,
                look.beam,
                any(look.radiance),
                look.faces,
                look.is_hidden,
                look.cutout and look.cutout.stamp,
            )
            for owner, look in looks
        ]
        kind = np.array([hash(kind) for kind in kinds], np.int64)
        seen = 1 if counts is None else counts.astype(np.int64)
        code = kind[things.surface].view(np.uint64)
        for part in (np.broadcast_to(seen, len(code)), *_bits(self.corners)):
            code = fold(code, part)
        if things.uv is not None:
            cut = np.flatnonzero(things.uv_row >= 0)
            for part in _bits(things.uv[things.uv_row[cut]].astype(float)):
                code[cut] = fold(code[cut], part)
        self._code = code

    def moved_to(self, other: Known) -> tuple[Boxes, np.ndarray]:
        """What is different in another frame.

        Returns
        -------
        boxes : round all triangles that only one of both has.
        number : (T,) of each triangle in the other frame, −1 where it has none that is the same.
        """
        number = np.full(len(self._code), -1)
        count = min(len(number), len(other._code))
        same = np.flatnonzero(self._code[:count] == other._code[:count])
        number[same] = same
        gone, new = np.flatnonzero(number < 0), np.delete(np.arange(len(other._code)), same)
        # Others have come or gone before some.
        place = _places(self._code[gone], other._code[new])
        found, gone = gone[place >= 0], gone[place < 0]
        number[found] = new[place[place >= 0]]
        new = new[_places(other._code[new], self._code[found]) < 0]
        return Boxes.round(np.concatenate((self.corners[gone], other.corners[new]))), number


def _places(codes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(T,) where each code is among others, −1 where it is not."""
    if not len(others):
        return np.full(len(codes), -1)
    order = np.argsort(others, kind="stable")
    found = order[np.minimum(np.searchsorted(others[order], codes), len(others) - 1)]
    return np.where(others[found] == codes, found, -1)


def _bits(corners: np.ndarray) -> np.ndarray:
    """(3 k, T) whole numbers that are equal where corners (T, 3, k) are."""
    _, three, width = corners.shape
    flat = corners.reshape(-1, three * width)
    return np.ascontiguousarray(flat.T).view(np.int64)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes that lie along the main axes of what is in them.

    Attributes
    ----------
    axes : (3, 3) rows, unit vectors in the world. bounds : (B, 2, 3) along these.
    """

    axes: np.ndarray
    bounds: np.ndarray

    @staticmethod
    def round(corners: np.ndarray) -> Boxes:
        """Round triangles (n, 3, 3), in runs along their longest axis."""
        if not len(corners):
            return NOWHERE
        places = corners.reshape(-1, 3)
        some = places[:: max(1, len(places) // MEASURED)]
        some = some - some.mean(axis=0)
        # The longest axis is the last: a slender thing that leans fills its boxes.
        axes = np.linalg.eigh(some.T @ some)[1].T
        along = rotated(axes, places.T).reshape(3, -1, 3)
        order = np.argsort(along[2, :, 0], kind="stable")
        runs = np.array_split(order, min(BOXES, len(order)))
        runs = [along.take(run, axis=1).reshape(3, -1) for run in runs]
        return Boxes(axes, np.array([(run.min(axis=1), run.max(axis=1)) for run in runs]))

    def __len__(self) -> int:
        return len(self.bounds)

    def corners(self, margin: float = 0.0) -> np.ndarray:
        """(B, 8, 3) in the world, of boxes larger by so many metres."""
        wide = self.bounds + np.array((-margin, margin))[:, None]
        boxes = [np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3) for box in wide]
        return np.array(boxes).reshape(-1, 8, 3) @ self.axes

    def touched(self, margin: float, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(S,) which stretches, from begin to end (S, 3), come into a box; there is one at least.

        ``margin``: metres by which boxes are larger.
        """
        low, high = self.bounds[:, 0].min(axis=0) - margin, self.bounds[:, 1].max(axis=0) + margin
        found, some = np.zeros(len(begin), bool), np.arange(len(begin))
        # Most lie beside all of them.
        for axis in range(3):
            a, b = (rotated(self.axes[axis : axis + 1], part.T)[0] for part in (begin, end))
            near = (np.minimum(a, b) <= high[axis]) & (np.maximum(a, b) >= low[axis])
            near = np.flatnonzero(near)
            some, begin, end = (part.take(near, axis=0) for part in (some, begin, end))
        place = rotated(self.axes, begin.T)
        along = rotated(self.axes, end.T) - place
        for box in self.bounds:
            met = meets_boxes(box[None], margin, place, along, np.ones(len(some)))
            found[some[met]] = True
            left = np.flatnonzero(~met)
            some, place, along = some[left], columns(place, left), columns(along, left)
        return found


NOWHERE = Boxes(np.eye(3), np.zeros((0, 2, 3)))
"""Nothing moved."""
