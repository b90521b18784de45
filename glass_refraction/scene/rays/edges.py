# SPDX-License-Identifier: GPL-3.0-or-later
"""Lookups beside silhouettes in a view, moved to where it shows what they look for.

A pixel at a silhouette mixes the nearer thing with what is behind it. Looked up there, either would
be seen through the glass with a line of the other along its border. Of what shines even the small
part that the pixel filter takes into the next pixel is too much.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from .hits import TOGETHER, Scene, Views
from .looks import SHINING
from .sketches import MARGIN_PX, UNKNOWN, Sketch
from .things import Things
from .views import RadianceView

AROUND = sorted(product((-1, 0, 1), repeat=2), key=lambda step: (np.abs(step).sum(), step))
"""Steps to a pixel and its neighbours, the nearest first."""
FARTHER = sorted(
    (step for step in product(range(-2, 3), repeat=2) if max(map(abs, step)) == 2),
    key=lambda step: (np.square(step).sum(), step),
)
"""Steps to the pixels round these."""
GLARE = -3
"""In place of a surface's number: of pixels that have some of the light of what shines, not all."""


def off_edges(scene: Scene, views: Views, view: np.ndarray, pixels: np.ndarray, surface) -> None:
    """Move lookups beside silhouettes to the middle of a pixel that shows their surface.

    A lookup moves by less than two pixels, and beside what shines by less than three, as far as it
    must: what surfaces show near their own border stays. It stays where it is if a thing is too
    thin in a view to fill a pixel's middle.

    Parameters
    ----------
    view, pixels : (K,) number of the view and frame pixels (K, 2) in it, of each lookup; the
        pixels are changed. surface : (K,) numbers of the surfaces that they look for.
    """
    shines = shining_looks(scene.things)
    for number, shown in enumerate(views):
        rows = np.flatnonzero(view == number)
        if not len(rows) or shown.sky_only:
            continue
        blocks = np.split(rows, range(TOGETHER, len(rows), TOGETHER))
        seen = _Seen.by(scene.sketch(shown), (pixels[block] for block in blocks), shines)
        for block in blocks:
            pixels[block] = _moved(seen, shown, pixels[block], surface[block])


def shining_looks(things: Things) -> np.ndarray:
    """(L,) which surfaces shine."""
    return np.array([max(look.radiance) > SHINING for look in things.looks], bool)


def _moved(seen: _Seen, view: RadianceView, pixels: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Places (K, 2) near those given where a view's picture shows the surfaces (K,)."""
    cell = np.floor(pixels).astype(np.intp) - seen.origin
    near = np.flatnonzero(seen.at(seen.is_border, cell))
    found = cell.copy()

    def look(rows: np.ndarray, steps) -> np.ndarray:
        """Find the nearest cells of the surfaces; returns the rows that find none."""
        for step in steps:
            there = seen.at(seen.surface, cell[rows] + step) == surface[rows]
            found[rows[there]] += step
            rows = rows[~there]
        return rows

    left = look(near, AROUND)
    dazzled = seen.at(seen.is_dazzled, cell[left])
    left = np.concatenate((left[~dazzled], look(left[dazzled], FARTHER)))
    near = np.setdiff1d(near, left, assume_unique=True)
    there = found[near]
    moved = pixels[near] + (there - cell[near])
    for axis in range(2):
        middle = there[:, axis] + seen.origin[axis] + 0.5
        below, above = (seen.at(side, there) for side in seen.borders[axis])
        place = moved[:, axis]
        place = np.where(above & ~below, np.minimum(place, middle), place)
        moved[:, axis] = np.where(below & ~above, np.maximum(place, middle), place)
    low, high = np.array(view.region[:2]), np.array(view.region[2:])
    pixels[near] = np.clip(moved, low + 0.5, high - 0.5)
    return pixels


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a view's pixels show, by row and column.

    Attributes
    ----------
    origin, surface : see `Sketch`; along the border of what shines, on both sides, `GLARE`.
    borders : for x and for y, beside which pixels something else is seen nearer or farther: before
        them (left, below) and after them.
    is_border : whether that is so on any side. is_dazzled : what shines, and beside it.
    """

    origin: np.ndarray
    surface: np.ndarray
    borders: tuple[tuple[np.ndarray, np.ndarray], ...]
    is_border: np.ndarray
    is_dazzled: np.ndarray

    @staticmethod
    def by(sketch: Sketch, lookups: Iterable[np.ndarray], shines: np.ndarray) -> _Seen:
        """What the neighbours of lookups (K, 2) show, of several bundles.

        ``shines``: (L,) which surfaces do, by their numbers.
        """
        asked = np.zeros(sketch.surface.shape, bool)
        for pixels in lookups:
            x, y = (np.floor(pixels).astype(np.intp) - sketch.origin).T
            asked[y, x] = True
        for axis in range(2):
            asked = _spread(asked, axis, MARGIN_PX)
        sketch.look(asked)
        surface, dazzled = sketch.surface, np.zeros(asked.shape, bool)
        if shines.any():
            bright = (surface >= 0) & shines[np.maximum(surface, 0)]
            dazzled = _round(bright) & (surface != UNKNOWN)
            # Its outermost pixels have half of its light, and stand for it where it has no others.
            full = bright & ~_round(~bright & (surface != UNKNOWN))
            dim = bright & ~full & _round(full)
            surface = np.where(dim | (dazzled & ~bright), GLARE, surface)
        borders = tuple(_borders(surface, sketch.far, sketch.step, a) for a in (1, 0))
        is_border = np.logical_or.reduce([surface == GLARE, *(s for pair in borders for s in pair)])
        return _Seen(sketch.origin, surface, borders, is_border, dazzled)

    @staticmethod
    def at(picture: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """Values (K,) in cells (K, 2)."""
        return picture[cell[:, 1], cell[:, 0]]


def _pairs(axis: int) -> tuple[tuple, tuple]:
    """Where pixels and their next ones lie along an axis."""
    before, after = [slice(None)] * 2, [slice(None)] * 2
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    return tuple(before), tuple(after)


def _spread(mask: np.ndarray, axis: int, reach: int) -> np.ndarray:
    """A mask and all within so many pixels of it along an axis."""
    before, after = _pairs(axis)
    for _ in range(reach):
        wide = mask.copy()
        wide[before] |= mask[after]
        wide[after] |= mask[before]
        mask = wide
    return mask


def _round(mask: np.ndarray) -> np.ndarray:
    """A mask and the pixels round it."""
    return _spread(_spread(mask, 0, 1), 1, 1)


def _borders(surface, distance, step, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Before and after which pixels another surface is seen, nearer or farther than theirs."""
    before, after = _pairs(axis)
    other = surface[before] != surface[after]
    other &= (surface[before] != UNKNOWN) & (surface[after] != UNKNOWN)
    # Of two skies the difference is no number, and no border.
    with np.errstate(invalid="ignore"):
        gap = np.abs(distance[before] - distance[after])
    other &= (
        (gap > np.maximum(step[before], step[after]))
        | (surface[before] == GLARE)
        | (surface[after] == GLARE)
    )
    found = np.zeros(surface.shape, bool), np.zeros(surface.shape, bool)
    found[0][after], found[1][before] = other, other
    return found
