# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of a cup over the picture: a plane mesh whose cells know all ways through the glass.

A cup's rays take hundreds of paths, each in a small part of the picture. So nothing is kept by
path: each cell has a few *slots*, one for every way that its rays take, the strongest first. A
slot says at each corner where the rays leave the glass, in which direction and with which light;
between corners this is interpolated linearly. What the glass holds, and what stands before it,
ends the rays on the stretch where they meet it: there a slot begins where that stretch begins.
The engine sends its own rays on from there, so all is lit where it is, and filtered and
anti-aliased as the engine does it. Cells are split until that is near enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import optics
from .glasses import Glass
from .obstacles import Obstacle
from .regions import ENOUGH, border_pixels, picture_rect
from .viewpoint import Viewpoint

FINEST = 4
"""Cells a side of a pixel where a strong way ends."""
COARSEST = 2
"""Pixels a side of the largest cells."""
TOLERANCE_PX = 0.15
"""Largest error, in pixels seen straight on and times the way's weight, of interpolated rays."""
WEIGHT_TOLERANCE = 0.04
"""Largest error of interpolated weights, times the cell's size in pixels."""
EDGE_PX = 0.3
"""Largest size in pixels, times the weight, of cells in which a way ends."""
NEAR = 2
"""Largest cells beside one that is split that are split too: a thin region may slip between rays.
"""
SLOTS = {"GLASS": 6, "REFRACTION": 4}
"""Ways that a cell keeps; the light of weaker ones is shared out among these."""
BEYOND = 2
"""Pixels round the glass that its screen covers: so far the pixel filter reaches."""

STRAIGHT = 0
"""The way of rays that miss the glass, or meet something before it."""


@dataclass(frozen=True, eq=False)
class RayScreen:
    """Rays over the picture.

    Attributes
    ----------
    rect : (x0, y0, x1, y1) pixels, half open. cover : (h, w) bool: those that the screen shows.
    pixels : (V, 2) where the cells' corners are in the picture. cells : (C, 4), anticlockwise.
    origins, directions, colours : (S, C, 4, 3) of the rays in each slot, world; 0 in empty ones.
    paths : those of the ways that carry ``min_weight`` of the light or more, the brightest first.
    """

    rect: tuple[int, int, int, int]
    cover: np.ndarray
    pixels: np.ndarray
    cells: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    colours: np.ndarray
    paths: tuple[optics.LightPath, ...]


def build_ray_screen(
    glass: Glass,
    view: Viewpoint,
    front: Sequence[Obstacle],
    held: Sequence[Obstacle],
    *,
    fresnel: bool,
    min_weight: float,
    depth: float,
    slots: int = SLOTS["GLASS"],
) -> RayScreen:
    """The rays through a glass, wherever it is seen.

    Parameters
    ----------
    front, held : what may stand before the glass, and what it holds.
    fresnel : weigh by Fresnel's equations; else surfaces only refract.
    min_weight : ways with less of a ray's light are left out, in small cells some more.
    depth : along the view direction, metres: from there on straight rays run.
    slots : ways that a cell keeps, at most.
    """
    rect = picture_rect(glass, view)
    rays = _Rays(glass, view, front, held, fresnel, min_weight, depth, np.array(rect[:2]) - BEYOND)
    cover = _cover(glass, view, rect)
    corners, ids = _split(rays, cover)
    vertices, cells = np.unique(ids, return_inverse=True)
    cells = cells.reshape(-1, 4)
    origins, directions, colours = _slots(rays, ids, slots)
    rows, owner = rays.rows(ids.ravel())
    area = (corners[:, 1, 0] - corners[:, 0, 0])[owner // 4] ** 2
    share = np.bincount(rays.way[rows], rays.weight[rows] * area, len(rays.paths))
    share[STRAIGHT] = 0.0
    share /= max(share.sum(), 1e-30)
    order = np.argsort(-share, kind="stable")
    paths = tuple(rays.paths[n] for n in order if share[n] >= min_weight)
    places = rays.pixels(vertices)
    return RayScreen(rect, cover, places, cells, origins, directions, colours, paths)


def _cover(glass: Glass, view: Viewpoint, rect) -> np.ndarray:
    """(h, w) the pixels that rays through the glass have a part in."""
    x0, y0, x1, y1 = rect
    x, y = np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)
    eye, directions = view.rays_in(glass, x.ravel(), y.ravel())
    direct = (optics.LightPath(""),)
    missed, _ = optics.path_weights(glass.description, eye, directions, direct)
    cover = (missed[0] < 0.5).reshape(x.shape)
    for _ in range(BEYOND):
        cover = cover | border_pixels(cover[None])
    return cover


class _Rays:
    """Ways of the rays through lattice points, each followed once.

    Lattice points are ``FINEST`` to a pixel, counted from ``BEYOND`` pixels outside the rectangle's
    lower left corner.

    Attributes
    ----------
    keys : (V,) of the points, in the order in which they were followed: a point's number.
    first, count : (V,) rows of a point.
    way, weight, colour, origin, direction : (K,), (K,), (K, 3) of all rows; world.
    paths : of the ways.
    """

    def __init__(self, glass, view, front, held, fresnel, min_weight, depth, corner) -> None:
        self.view, self._glass, self._fresnel = view, glass, fresnel
        self._front, self._held = front, held
        self._least, self._depth, self._corner = min_weight, depth, corner
        self._known: dict[optics.LightPath, int] = {optics.LightPath(""): STRAIGHT}
        self.keys = np.zeros(0, np.int64)
        self._sorted, self._order = self.keys, np.zeros(0, np.intp)
        self.first = self.count = self.way = np.zeros(0, np.intp)
        self.weight = np.zeros(0)
        self.colour = self.origin = self.direction = np.zeros((0, 3))

    @property
    def paths(self) -> list[optics.LightPath]:
        return list(self._known)

    def pixels(self, numbers: np.ndarray) -> np.ndarray:
        """(N, 2) places in the picture."""
        return self._places(self.keys[numbers])

    def _places(self, keys: np.ndarray) -> np.ndarray:
        return np.column_stack((keys % _STRIDE, keys // _STRIDE)) / FINEST + self._corner

    def numbers(self, lattice: np.ndarray, size: int) -> np.ndarray:
        """Numbers (...) of lattice points (..., 2), which are followed if they are new.

        ``size`` of the cells that need them: in small ones weak ways need not be known.
        """
        keys = lattice[..., 1] * _STRIDE + lattice[..., 0]
        asked = np.unique(keys)
        new = asked[~np.isin(asked, self._sorted, assume_unique=True)]
        if len(new):
            self._follow(new, self._least * (COARSEST * FINEST / size))
            self._order = np.argsort(self.keys)
            self._sorted = self.keys[self._order]
        return self._order[np.searchsorted(self._sorted, keys)]

    def rows(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All rows of points (N,), and the place in ``numbers`` of each row's point."""
        count = self.count[numbers]
        owner = np.repeat(np.arange(len(numbers)), count)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        return np.repeat(self.first[numbers], count) + within, owner

    def _follow(self, keys: np.ndarray, least: float) -> None:
        x, y = self._places(keys).T
        glass, view, total = self._glass, self.view, len(keys)
        eye, directions = view.rays_in(glass, x, y)
        ends = optics.follow_rays(
            glass.description,
            eye,
            directions,
            min_weight=least,
            fresnel=self._fresnel,
            stop=self._stop if self._front or self._held else None,
            lengths=glass.is_tinted,
        )
        way = np.array([self._number(path) for path in ends.paths], np.intp)[ends.path]
        depth = ends.lengths @ np.array(glass.absorption[: ends.lengths.shape[1]])
        origin = glass.points_to_world(ends.origin)
        direction = ends.direction @ glass.to_world[:3, :3].T
        straight = way == STRAIGHT
        begin, along = view.rays(x, y)
        begin = begin + along * (self._depth / (along @ view.forward))[:, None]
        direction[straight] = along[ends.ray[straight]]
        weight, ray = ends.weight, ends.ray
        brought = np.bincount(ray, weight, total)
        if self._fresnel:
            # Too weak to be followed, or caught in the wall: shared out among the rest, or, where
            # that is little, the light that comes straight.
            weight = weight / np.maximum(brought, ENOUGH)[ray]
            dark = np.flatnonzero(brought < ENOUGH)
            ray = np.concatenate((ray, dark))
            way = np.concatenate((way, np.full(len(dark), STRAIGHT, np.intp)))
            weight = np.concatenate((weight, 1.0 - brought[dark] / ENOUGH))
            depth = np.concatenate((depth, np.zeros((len(dark), 3))))
            origin = np.concatenate((origin, begin[dark]))
            direction = np.concatenate((direction, along[dark]))
        straight = way == STRAIGHT
        origin[straight] = begin[ray[straight]]
        order = np.argsort(ray, kind="stable")
        count = np.bincount(ray, minlength=total)
        self.first = np.concatenate((self.first, len(self.way) + np.cumsum(count) - count))
        self.count = np.concatenate((self.count, count))
        self.keys = np.concatenate((self.keys, keys))
        self.way = np.concatenate((self.way, way[order]))
        self.weight = np.concatenate((self.weight, weight[order]))
        colour = weight[:, None] * np.exp(-depth)
        self.colour = np.concatenate((self.colour, colour[order]))
        self.origin = np.concatenate((self.origin, origin[order]))
        self.direction = np.concatenate((self.direction, direction[order]))

    def _number(self, path: optics.LightPath) -> int:
        if not path.events:
            return STRAIGHT
        return self._known.setdefault(path, len(self._known))

    def _stop(self, events: int, medium: int, origin, direction, length) -> np.ndarray:
        things = self._held if events else self._front
        if not things:
            return length
        origin = self._glass.points_to_world(origin)
        direction = direction @ self._glass.to_world[:3, :3].T
        for thing in things:
            length = np.minimum(length, thing.met_after(origin, direction, length))
        return length


_STRIDE = 1 << 20


def _split(rays: _Rays, cover: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells, size by size: their corners on the lattice (C, 4, 2), and as numbers (C, 4)."""
    height, width = cover.shape
    summed = np.pad(cover.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    size = COARSEST * FINEST
    # The filter of the outermost covered pixels reaches a little beyond these.
    steps = (np.arange(0, (n + 2 * BEYOND) * FINEST, size) for n in (width, height))
    low = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    found, known = [], []
    while len(low):
        low = low[_any_covered(summed, low, size)]
        corners = low[:, None] + size * square
        # Within half a pixel nothing bends: only whether a way ends there is asked.
        middle = low + size // 2 if size > FINEST // 2 else low
        numbers = rays.numbers(np.concatenate((corners, middle[:, None]), axis=1), size)
        rough = np.zeros(len(low), bool)
        if size > 1:
            rough = _is_rough(rays, numbers, size / FINEST)
        if size == COARSEST * FINEST:
            rough = _and_near(rough, low // size)
        numbers = numbers[:, :MIDDLE]
        found.append(corners[~rough])
        known.append(numbers[~rough])
        half = size // 2
        low = (low[rough][:, None] + half * square).reshape(-1, 2)
        size = half
    return np.concatenate(found), np.concatenate(known)


def _and_near(marked: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Marks (C,) of cells at places (C, 2) of a grid, and those of cells near marked ones."""
    grid = np.zeros((places.max(initial=0, axis=0) + 1)[::-1], bool)
    grid[places[marked, 1], places[marked, 0]] = True
    for _ in range(NEAR):
        grid |= border_pixels(grid[None])
    return grid[places[:, 1], places[:, 0]]


def _any_covered(summed: np.ndarray, low: np.ndarray, size: int) -> np.ndarray:
    """Whether a cell is near any covered pixel, from these pixels' summed table."""
    height, width = summed.shape[0] - 1, summed.shape[1] - 1
    a, b = np.clip(low // FINEST - 2 * BEYOND, 0, (width, height)).T
    c, d = np.clip(-(-(low + size) // FINEST), 0, (width, height)).T
    return summed[d, c] - summed[b, c] - summed[d, a] + summed[b, a] > 0


MIDDLE = 4
"""After the four corners of a cell."""


def _is_rough(rays: _Rays, numbers: np.ndarray, size_px: float) -> np.ndarray:
    """Which cells must be split: (C,) by what the rays at their corners and middles (C, 5) do."""
    rows, owner = rays.rows(numbers.ravel())
    cell, corner = owner // 5, owner % 5
    ways = len(rays.paths)
    pairs, group = np.unique(cell * ways + rays.way[rows], return_inverse=True)
    cell_of, way_of = pairs // ways, pairs % ways
    middle = corner == MIDDLE
    around = np.bincount(group[~middle], minlength=len(pairs))
    centre = np.full(len(pairs), -1)
    centre[group[middle]] = rows[middle]
    strongest = np.zeros(len(pairs))
    np.maximum.at(strongest, group, rays.weight[rows])
    whole = (around == 4) & (centre >= 0)
    rough = ~whole & (strongest * size_px > EDGE_PX)
    outer = ~middle & whole[group]
    some, to = rows[outer], group[outer]

    def gap(values: np.ndarray) -> np.ndarray:
        mean = np.stack([np.bincount(to, column[some], len(pairs)) for column in values.T], axis=1)
        return np.linalg.norm(0.25 * mean - values[centre], axis=1)

    view, weight = rays.view, rays.weight[centre]
    if view.is_parallel:
        off = gap(rays.direction) * max(view.size) + gap(rays.origin) * view.focal_px
    else:
        far = np.maximum(np.linalg.norm(rays.origin[centre] - view.eye, axis=1), 1e-9)
        off = (gap(rays.direction) + gap(rays.origin) / far) * view.focal_px
    curved = (weight * off > TOLERANCE_PX) | (
        gap(rays.weight[:, None]) * size_px > WEIGHT_TOLERANCE
    )
    rough |= whole & (way_of != STRAIGHT) & curved & (size_px > 0.5)
    return np.bincount(cell_of, rough, len(numbers)) > 0


def _slots(
    rays: _Rays, numbers: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins, directions and colours (S, C, 4, 3) of the cells with corners (C, 4)."""
    total = len(numbers)
    rows, owner = rays.rows(numbers.ravel())
    cell, corner = owner // 4, owner % 4
    ways = len(rays.paths)
    pairs, group = np.unique(cell * ways + rays.way[rows], return_inverse=True)
    cell_of = pairs // ways
    order = np.lexsort((-np.bincount(group, rays.weight[rows]), cell_of))
    start = np.searchsorted(cell_of[order], np.arange(total))
    rank = np.empty(len(pairs), np.intp)
    rank[order] = np.arange(len(pairs)) - start[cell_of[order]]
    slots = min(most, int(rank.max(initial=0)) + 1)
    kept = rank[group] < slots
    # The light of ways without a slot is shared out among the others at that corner.
    place = cell * 4 + corner
    light = np.bincount(place, rays.weight[rows], 4 * total)
    left = np.bincount(place[kept], rays.weight[rows[kept]], 4 * total)
    share = np.where(left > 0, light / np.where(left > 0, left, 1.0), 1.0)
    rows, group, cell, corner = rows[kept], group[kept], cell[kept], corner[kept]
    out = [np.zeros((slots, total, 4, 3), np.float32) for _ in range(3)]
    known = rank < slots
    count = np.bincount(group, minlength=len(pairs))
    for target, values in zip(out[:2], (rays.origin, rays.direction), strict=True):
        # Corners that a way does not reach get the mean of those that it does: it fades out there.
        sums = [np.bincount(group, column[rows], len(pairs)) for column in values.T]
        mean = np.stack(sums, axis=1)[known] / count[known, None]
        target[rank[known], cell_of[known]] = mean[:, None, :]
        target[rank[group], cell, corner] = values[rows]
    out[2][rank[group], cell, corner] = rays.colour[rows] * share[cell * 4 + corner, None]
    return out[0], out[1], out[2]
