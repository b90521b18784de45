# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples as the pictures that the compositor sums: which place of which view, for which pixel.

The samples of one view lie one after another in a packed picture, those of one pixel side by side.
There the view is looked up once a sample and multiplied by the sample's colour. Then neighbours of
one pixel are added in pairs, level by level, until each pixel has one sum; each level is another
packed picture, half as large at most. So the compositor's work goes with the number of samples,
not with the picture's size, and any number of samples a pixel is summed exactly. After a few levels
most pixels have their sum; only the others go through the further ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..progress import check

WIDTH = 2048
"""Pixels in a row of a packed picture, a power of 2."""
LEVELS = 8
"""Of pairwise sums: up to 2⁸ samples a pixel and view."""
EARLY = 3
"""Levels after which a pixel's sum is taken if it is one: few have more than 2³ samples."""
MOST = 1 << LEVELS


@dataclass(frozen=True, eq=False)
class Packed:
    """The pictures of one view's samples, each (rows, `WIDTH`, 4) float32.

    Attributes
    ----------
    where : place in the view (u, v) and 1, or 0 where there is no sample.
    colour : what is looked up is multiplied by this. Alpha is the most that the mean of red,
        green and blue may then be.
    pairs : for each level the places in the level below of both addends, and 1 or 0.
    into : for the packed pixels, the place of their sum after `EARLY` levels, and 1 or 0; and for
        the others that in the last level.
    """

    where: np.ndarray
    colour: np.ndarray
    pairs: list[tuple[np.ndarray, np.ndarray]]
    into: tuple[np.ndarray, np.ndarray]

    def alpha(self, weight: np.ndarray) -> np.ndarray:
        """The picture of the samples' weights (K,), like `colour`."""
        return _picture(np.repeat(weight[:, None], 3, axis=1), len(self.colour))


@dataclass(frozen=True, eq=False)
class PackedPixels:
    """Which pixels have samples.

    Attributes
    ----------
    pixels : (P,) their numbers in the picture, rising.
    """

    pixels: np.ndarray

    def known(self, values: np.ndarray, pixel: np.ndarray) -> np.ndarray:
        """Picture of sums of values (K, 3), of the pixels (K,) that are numbered in the picture."""
        place = np.searchsorted(self.pixels, pixel)
        sums = [np.bincount(place, column, len(self.pixels)) for column in values.T]
        return _picture(np.stack(sums, axis=1) if len(sums) else np.empty((0, 3)))

    def spread(self, beside: np.ndarray) -> np.ndarray:
        """Picture (height, width, 4) that brings the packed pixels to their places.

        Its alpha is ``beside`` (height, width): the part of each pixel that no glass covers.
        """
        height, width = beside.shape
        out = np.zeros((height * width, 4), np.float32)
        out[:, 3] = beside.ravel()
        out[self.pixels, :3] = _places(np.arange(len(self.pixels)), _rows(len(self.pixels)))
        return out.reshape(height, width, 4)


def pack(
    pixels: PackedPixels, pixel: np.ndarray, uv: np.ndarray, colour: np.ndarray, most: np.ndarray
) -> Packed:
    """The pictures of one view's samples.

    Parameters
    ----------
    pixel : (K,) number of each sample's pixel in the picture, rising; at most `MOST` equal ones.
    uv : (K, 2) places in the view, 0 to 1. colour, most : (K, 3) and (K,), see `Packed.colour`.
    """
    check()
    rows = _rows(len(pixel))
    where = np.ones((len(pixel), 3), np.float32)
    where[:, :2] = uv
    pairs, into = [], []

    def end(owner: np.ndarray, at: np.ndarray, below: int) -> None:
        # One row of nothing is enough to be added to something.
        is_nothing = not len(owner) and (into or not len(pixel))
        count = 0 if is_nothing else len(pixels.pixels)
        found = np.zeros((count, 3), np.float32)
        found[np.searchsorted(pixels.pixels, owner)] = _places(at, below)
        into.append(_picture(found))

    owner, at, below = pixel, np.arange(len(pixel)), rows
    for level in range(LEVELS):
        if level == EARLY:
            alone = _are_alone(owner)
            end(owner[alone], at[alone], below)
            owner, at = owner[~alone], at[~alone]
        first, second, both, owner = _halved(owner)
        places = _places(at[first], below), _places(at[second], below)
        # Column by column: NumPy is slow on rows of three.
        for column in places[1].T:
            column *= both
        pairs.append(tuple(map(_picture, places)))
        at, below = np.arange(len(owner)), _rows(len(owner))
    end(owner, at, below)
    colour = _picture(colour, rows)
    colour.reshape(-1, 4)[: len(most), 3] = most
    return Packed(_picture(where, rows), colour, pairs, tuple(into))


def strongest(pixel: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Which samples (K,) are among the `MOST` strongest of their pixel; ``pixel`` rises."""
    count = np.bincount(pixel) if len(pixel) else np.zeros(0, np.intp)
    if not (count > MOST).any():
        return np.ones(len(pixel), bool)
    order = np.lexsort((-weight, pixel))
    start = np.cumsum(count) - count
    rank = np.empty(len(pixel), np.intp)
    rank[order] = np.arange(len(pixel)) - start[pixel[order]]
    return rank < MOST


def _are_alone(owner: np.ndarray) -> np.ndarray:
    """(K,) which have no equal beside them."""
    same = np.concatenate(([False], owner[1:] == owner[:-1], [False]))
    return ~(same[1:] | same[:-1])[: len(owner)]


def _halved(owner: np.ndarray):
    """Places of the addends of each pairwise sum, whether there are two, and the sums' owners."""
    if not len(owner):
        nothing = np.zeros(0, np.intp)
        return nothing, nothing, np.zeros(0, np.float32), owner
    begins = np.flatnonzero(np.concatenate(([True], owner[1:] != owner[:-1])))
    ends = np.append(begins[1:], len(owner))
    sums = (ends - begins + 1) // 2
    past = np.cumsum(sums)
    first = 2 * np.arange(past[-1]) + np.repeat(begins - 2 * (past - sums), sums)
    both = first + 1 < np.repeat(ends, sums)
    return first, np.where(both, first + 1, 0), both.astype(np.float32), owner[first]


def _rows(count: int) -> int:
    return max(1, -(-count // WIDTH))


def _places(numbers: np.ndarray, rows: int) -> np.ndarray:
    """Centres (K, 2) of numbered pixels in a packed picture of so many rows, and 1: (K, 3)."""
    out = np.ones((len(numbers), 3), np.float32)
    row, column = numbers // WIDTH, numbers & WIDTH - 1
    out[:, 0] = (column + 0.5) / WIDTH
    out[:, 1] = (row + 0.5) / rows
    return out


def _picture(values: np.ndarray, rows: int | None = None) -> np.ndarray:
    """Values (K, 3) as a packed picture; the rest is 0."""
    rows = _rows(len(values)) if rows is None else rows
    out = np.zeros((rows * WIDTH, 4), np.float32)
    out[:, 3] = 1.0
    out[: len(values), :3] = values
    return out.reshape(rows, WIDTH, 4)
