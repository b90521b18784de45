# SPDX-License-Identifier: GPL-3.0-or-later
"""What of the things is not as it was, and which rays pass where that is or was."""

from __future__ import annotations

import numpy as np

from ...optics.exit_rays import meets_boxes
from ...optics.facets import fold
from ...optics.vectors import columns
from .things import Things

BOXES = 8
"""Boxes in which all that moved lies: more would fit it better and take longer to look through."""


class Known:
    """Triangles of a frame as the next frame knows them again.

    Parameters
    ----------
    counts : (T,) bool, which triangles rays see that have passed a glass; None: all.
    """

    def __init__(self, things: Things, counts: np.ndarray | None) -> None:
        self.corners = things.points[things.triangles]
        looks = zip(things.owners, things.looks, strict=True)
        kind = np.array([hash((owner, look.is_lamp)) for owner, look in looks], np.int64)
        seen = 1 if counts is None else counts.astype(np.int64)
        code = kind[things.surface].view(np.uint64)
        for part in (np.broadcast_to(seen, len(code)), *_bits(self.corners)):
            code = fold(code, part)
        self._code = code

    def moved_to(self, other: Known) -> tuple[np.ndarray, np.ndarray]:
        """What is different in another frame.

        Returns
        -------
        boxes : (B, 2, 3) round all triangles that only one of both has.
        number : (T,) of each triangle in the other frame, −1 where it has none that is the same.
        """
        number, new = _places(self._code, other._code), _places(other._code, self._code) < 0
        return _boxes(np.concatenate((self.corners[number < 0], other.corners[new]))), number


def _places(codes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(T,) where each code is among others, −1 where it is not."""
    if not len(others):
        return np.full(len(codes), -1)
    order = np.argsort(others, kind="stable")
    found = order[np.minimum(np.searchsorted(others, codes, sorter=order), len(others) - 1)]
    return np.where(others[found] == codes, found, -1)


def _bits(corners: np.ndarray) -> np.ndarray:
    """(9, T) whole numbers that are equal where corners (T, 3, 3) are."""
    return np.ascontiguousarray(corners.reshape(-1, 9).T).view(np.int64)


def _boxes(corners: np.ndarray) -> np.ndarray:
    """(B, 2, 3): boxes round triangles (n, 3, 3), in runs along the longest side of all."""
    if not len(corners):
        return np.zeros((0, 2, 3))
    middles = corners.mean(axis=1)
    order = np.argsort(middles[:, np.ptp(middles, axis=0).argmax()], kind="stable")
    runs = np.array_split(corners[order], min(BOXES, len(order)))
    return np.array([(run.min(axis=(0, 1)), run.max(axis=(0, 1))) for run in runs])


def touched(boxes: np.ndarray, margin: float, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(S,) which stretches, from begin to end (S, 3), come into a box (B, 2, 3), B ≥ 1.

    ``margin``: metres by which boxes are larger.
    """
    found, some = np.zeros(len(begin), bool), slice(None)
    # Most lie beside all of them.
    for axis in range(3):
        a, b = begin[some, axis], end[some, axis]
        low, high = boxes[:, 0, axis].min() - margin, boxes[:, 1, axis].max() + margin
        near = np.flatnonzero((np.minimum(a, b) <= high) & (np.maximum(a, b) >= low))
        some = near if axis == 0 else some[near]
    place, along = (np.ascontiguousarray(part[some].T, float) for part in (begin, end))
    along -= place
    for box in boxes:
        met = meets_boxes(box[None], margin, place, along, np.ones(len(some)))
        found[some[met]] = True
        left = np.flatnonzero(~met)
        some, place, along = some[left], columns(place, left), columns(along, left)
    return found
