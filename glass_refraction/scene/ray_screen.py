# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays over the picture: a plane mesh whose cells know all ways through a glass.

A cup's rays take hundreds of paths, each in a small part of the picture. So nothing is kept by
path: each cell has a few *slots*, one for every way that its rays take, the strongest first. A
slot says at each corner where the rays leave the glass, in which direction and with which light;
between corners this is interpolated linearly. What the glass holds, and what stands before it,
ends the rays on the stretch where they meet it: there a slot begins where that stretch begins.
The engine sends its own rays on from there, so all is lit where it is, and filtered and
anti-aliased as the engine does it. Cells are split until that is near enough.

Other glasses are shown so where their paths' regions end (`borders.py`). A second screen shows of
them, in the smooth middle, those paths alone that have no copies: the mirrors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import optics
from .read.glasses import Glass, as_body
from .read.obstacles import Obstacle
from .read.viewpoint import Viewpoint
from .vertices.chains import met_next
from .vertices.path_keys import Path
from .vertices.regions import ENOUGH, border_pixels

FINEST = 8
"""Cells a side of a pixel where a strong way ends."""
COARSEST = 2
"""Pixels a side of the largest cells."""
COARSEST_SMOOTH = 4
"""The same where only some paths are shown: they are weak there."""
TOLERANCE_PX = 0.15
"""Largest error, in pixels seen straight on and times the way's weight, of interpolated rays."""
WEIGHT_TOLERANCE = 0.04
"""Largest error of interpolated weights, times the cell's size in pixels."""
EDGE_PX = 0.15
"""Largest size in pixels, times the weight, of cells in which a way ends."""
NEAR = 2
"""Largest cells beside one that is split that are split too: a thin region may slip between rays.
"""
MOST_LEFT_OUT = 8.0
"""Times ``min_weight`` that ways must have in the smallest cells to be followed."""
FADE_PX = 0.5
"""Largest size in pixels of cells in which a path ends that is shown alone: the light of it fades
there, which must not reach beyond the pixels of which everything is shown."""
SLOTS = {"GLASS": 6, "REFRACTION": 4}
"""Ways that a cell keeps; the light of weaker ones is shared out among these."""
BEYOND = 2
"""Pixels round what a screen shows that it covers: so far the pixel filter reaches."""

STRAIGHT = 0
"""The way of rays that miss the glass, or meet something before it."""


@dataclass(frozen=True, eq=False)
class Zone:
    """What a screen shows where.

    Attributes
    ----------
    rect : (x0, y0, x1, y1) pixels, half open.
    cover : (h, w) bool: the pixels of which everything is shown.
    smooth : (h, w) bool: those of which only ``bare`` paths are, as though nothing stood before.
    kept, bare : kinds (:func:`path_kind`) of the paths among which the light is shared out in the
        smooth zone, and of those among them that the screen shows there.
    """

    rect: tuple[int, int, int, int]
    cover: np.ndarray
    smooth: np.ndarray
    kept: frozenset[tuple] = frozenset()
    bare: frozenset[tuple] = frozenset()

    def stamp(self) -> tuple:
        """Equal stamps ask for equal screens."""
        return (self.rect, self.cover.tobytes(), self.smooth.tobytes(), self.kept, self.bare)


def path_kind(path: Path) -> tuple[str, ...]:
    """What tells a path apart but for the interfaces that it meets."""
    if isinstance(path, optics.ChainedPath):
        return (path.first.events, path.behind, path.second.events)
    return (path.events,)


@dataclass(frozen=True, eq=False)
class RayScreen:
    """Rays over the picture.

    Attributes
    ----------
    rect : (x0, y0, x1, y1) pixels, half open.
    cover : (h, w) bool: the pixels that the screen shows.
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
    paths: tuple[Path, ...]

    def without_rays(self) -> RayScreen:
        """What is left to know of it once the rays are written down."""
        none = np.zeros((0, *self.origins.shape[1:]), np.float32)
        return replace(self, origins=none, directions=none, colours=none)


def build_ray_screens(
    glass: Glass,
    view: Viewpoint,
    zone: Zone,
    front: Sequence[Obstacle],
    held: Sequence[Obstacle],
    *,
    fresnel: bool,
    min_weight: float,
    depth: float,
    slots: int = SLOTS["GLASS"],
) -> tuple[RayScreen, RayScreen | None]:
    """The rays through a glass that is a body, and then through the next that they meet.

    Parameters
    ----------
    zone : what is to be shown where.
    front, held : what may stand before the glass, and what it holds.
    fresnel : weigh by Fresnel's equations; else surfaces only refract.
    min_weight : ways with less of a ray's light are left out, in small cells some more.
    depth : along the view direction, metres: from there on straight rays run.
    slots : ways that a cell keeps, at most.

    Returns
    -------
    A screen of everything, over the zone's ``cover``, and one of the bare paths alone, over the
    ``smooth`` part; None if there are no such paths.
    """
    rays = _Rays(glass, view, zone, front, held, fresnel, min_weight, depth)
    whole = _screen(rays, zone.rect, zone.cover, slots, min_weight, whole=True)
    if not zone.bare:
        return whole, None
    return whole, _screen(rays, zone.rect, zone.smooth, slots, min_weight, whole=False)


def _screen(rays: _Rays, rect, pixels, slots: int, min_weight: float, *, whole: bool) -> RayScreen:
    corners, ids = _split(rays, pixels, whole)
    vertices, cells = np.unique(ids, return_inverse=True)
    cells = cells.reshape(-1, 4)
    shown = rays.shown(ids, whole)
    origins, directions, colours = _slots(rays, shown, len(ids), slots)
    area = (corners[:, 1, 0] - corners[:, 0, 0])[shown.cell] ** 2
    share = np.bincount(rays.way[shown.row], shown.weight * area, len(rays.paths))
    share[STRAIGHT] = 0.0
    share = share / max(share.sum(), 1e-30)
    order = np.argsort(-share, kind="stable")
    paths = tuple(rays.paths[n] for n in order if share[n] >= min_weight)
    places = rays.pixels(vertices)
    return RayScreen(rect, pixels, places, cells, origins, directions, colours, paths)


def met_pixels(glass: Glass, view: Viewpoint, rect) -> np.ndarray:
    """(h, w) the pixels of a rectangle whose rays meet a glass that is a body."""
    x0, y0, x1, y1 = rect
    x, y = np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)
    eye, directions = view.rays_in(glass, x.ravel(), y.ravel())
    return np.isfinite(optics.reach(glass.description, eye, directions)).reshape(x.shape)


def widened(pixels: np.ndarray) -> np.ndarray:
    """(h, w) the pixels, and those around that their rays have a part in."""
    for _ in range(BEYOND):
        pixels = pixels | border_pixels(pixels[None])
    return pixels


@dataclass(frozen=True, eq=False)
class _Shown:
    """What cells show at their points: rows of `_Rays`, with their weight there.

    ``cell``, ``corner`` : of which cell, and at which of its points.
    """

    row: np.ndarray
    weight: np.ndarray
    cell: np.ndarray
    corner: np.ndarray


class _Rays:
    """Ways of the rays through lattice points, each followed once.

    Lattice points are ``FINEST`` to a pixel, counted from ``BEYOND`` pixels outside the rectangle's
    lower left corner.

    Attributes
    ----------
    keys : (V,) of the points, in the order in which they were followed: a point's number.
    first, count : (V,) rows of a point.
    way, tint, origin, direction : (K,), (K, 3) of all rows; world.
    weight, bare_weight : (K,) part of the light where everything is shown, and where only the
        zone's bare paths are.
    paths : of the ways.
    """

    def __init__(self, glass, view, zone: Zone, front, held, fresnel, min_weight, depth) -> None:
        self.view, self._glass, self._zone, self._fresnel = view, glass, zone, fresnel
        self._front, self._held = front, held
        self._least, self._depth = min_weight, depth
        self._corner = np.array(zone.rect[:2]) - BEYOND
        self._known: dict[Path, int] = {optics.LightPath(""): STRAIGHT}
        self.keys = np.zeros(0, np.int64)
        self._sorted, self._order = self.keys, np.zeros(0, np.intp)
        self.first = self.count = self.way = np.zeros(0, np.intp)
        self.weight = self.bare_weight = np.zeros(0)
        self.tint = self.origin = self.direction = np.zeros((0, 3))

    @property
    def paths(self) -> list[Path]:
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
            self._follow(new, self._least * np.clip(COARSEST * FINEST / size, 1.0, MOST_LEFT_OUT))
            self._order = np.argsort(self.keys)
            self._sorted = self.keys[self._order]
        return self._order[np.searchsorted(self._sorted, keys)]

    def shown(self, numbers: np.ndarray, whole: bool) -> _Shown:
        """What cells with points (C, K) show there; ``whole``: everything."""
        points = numbers.ravel()
        count = self.count[points]
        owner = np.repeat(np.arange(len(points)), count)
        within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        row = np.repeat(self.first[points], count) + within
        cell, corner = np.divmod(owner, numbers.shape[1])
        weight = (self.weight if whole else self.bare_weight)[row]
        some = np.flatnonzero(weight)
        return _Shown(row[some], weight[some], cell[some], corner[some])

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
            stop=_stopper(glass, self._held),
            lengths=glass.is_tinted,
        )
        begin, along = view.rays(x, y)
        hidden = self._hidden(glass, eye, directions, begin, along)
        begin = begin + along * (self._depth / (along @ view.forward))[:, None]
        way = np.array([self._number(path) for path in ends.paths], np.intp)[ends.path]
        origin = glass.points_to_world(ends.origin)
        direction = ends.direction @ glass.to_world[:3, :3].T
        straight = way == STRAIGHT
        origin[straight] = begin[ends.ray[straight]]
        direction[straight] = along[ends.ray[straight]]
        rows = _Rows(ends.ray, way, ends.weight, _depths(glass, ends), origin, direction)
        if glass.others:
            held = np.array([path.open for path in ends.paths], bool)[ends.path]
            rows = self._through_others(rows, ~held, least)
        bare_weight = self._bare_weight(rows, total)
        weight = rows.weight
        if self._fresnel:
            # Too weak to be followed, or caught in the wall: shared out among the rest, or, where
            # that is little, the light that comes straight.
            brought = np.bincount(rows.ray, weight, total)
            weight = weight / np.maximum(brought, ENOUGH)[rows.ray]
            lacking = np.clip(1.0 - brought / ENOUGH, 0.0, 1.0)
        else:
            lacking = np.zeros(total)
        weight = np.where(hidden[rows.ray], 0.0, weight)
        lacking[hidden] = 1.0
        more = np.flatnonzero(lacking)
        straight = _Rows(
            more,
            np.full(len(more), STRAIGHT, np.intp),
            lacking[more],
            np.zeros((len(more), 3)),
            begin[more],
            along[more],
        )
        weight = np.concatenate((weight, straight.weight))
        bare_weight = np.concatenate((bare_weight, np.zeros(len(more))))
        rows = _Rows.joined(rows, straight)
        order = np.argsort(rows.ray, kind="stable")
        count = np.bincount(rows.ray, minlength=total)
        self.first = np.concatenate((self.first, len(self.way) + np.cumsum(count) - count))
        self.count = np.concatenate((self.count, count))
        self.keys = np.concatenate((self.keys, keys))
        self.way = np.concatenate((self.way, rows.way[order]))
        self.weight = np.concatenate((self.weight, weight[order]))
        self.bare_weight = np.concatenate((self.bare_weight, bare_weight[order]))
        self.tint = np.concatenate((self.tint, np.exp(-rows.depth[order])))
        self.origin = np.concatenate((self.origin, rows.origin[order]))
        self.direction = np.concatenate((self.direction, rows.direction[order]))

    def _bare_weight(self, rows: _Rows, total: int) -> np.ndarray:
        """(K,) the rows' weights where bare paths alone are shown: of what kept ones bring.

        Where these bring little, a border is near, and nobody looks.
        """
        if not self._zone.bare:
            return np.zeros(len(rows.way))
        kinds = [path_kind(path) for path in self.paths]
        kept = np.array([kind in self._zone.kept for kind in kinds])[rows.way]
        bare = np.array([kind in self._zone.bare for kind in kinds])[rows.way]
        brought = np.bincount(rows.ray[kept], rows.weight[kept], total)
        return np.where(bare, rows.weight / np.maximum(brought, ENOUGH)[rows.ray], 0.0)

    def _through_others(self, rows: _Rows, free: np.ndarray, least: float) -> _Rows:
        """The rows of rays, those followed on that are ``free`` and meet another glass."""
        some = np.flatnonzero(free)
        onward = met_next(self._glass, rows.origin[some], rows.direction[some])
        goes_on = np.zeros(len(free), bool)
        parts = []
        for which, other in enumerate(map(as_body, self._glass.others)):
            here = onward.which == which
            if other is None or not here.any():
                continue
            row = some[onward.index[here]]
            goes_on[row] = True
            ends = optics.follow_rays(
                other.description,
                other.to_local(onward.origin[here]),
                other.direction_to_local(onward.direction[here]),
                min_weight=least,
                fresnel=self._fresnel,
                stop=_stopper(other, self._glass.obstacles),
                lengths=other.is_tinted,
            )
            row, weight = row[ends.ray], ends.weight * rows.weight[row[ends.ray]]
            keep = np.flatnonzero(weight > least)
            row = row[keep]
            known, count = self.paths, len(ends.paths)
            pairs, place = np.unique(rows.way[row] * count + ends.path[keep], return_inverse=True)
            numbers = [
                self._number(
                    optics.ChainedPath(known[pair // count], ends.paths[pair % count], other.name)
                )
                for pair in pairs
            ]
            parts.append(
                _Rows(
                    rows.ray[row],
                    np.array(numbers, np.intp)[place],
                    weight[keep],
                    rows.depth[row] + _depths(other, ends)[keep],
                    other.points_to_world(ends.origin[keep]),
                    ends.direction[keep] @ other.to_world[:3, :3].T,
                )
            )
        return _Rows.joined(rows.take(~goes_on), *parts)

    def _number(self, path: Path) -> int:
        if not path.events:
            return STRAIGHT
        return self._known.setdefault(path, len(self._known))

    def _hidden(self, glass: Glass, eye, directions, begin, along) -> np.ndarray:
        """(M,) which rays meet a thing before they meet the glass."""
        hidden = np.zeros(len(directions), bool)
        if self._front:
            reach = optics.reach(glass.description, eye, directions)
            some = np.flatnonzero(np.isfinite(reach))
            for thing in self._front:
                hidden[some] |= thing.stops(begin[some], along[some], reach[some])
        return hidden


@dataclass(frozen=True, eq=False)
class _Rows:
    """Ways of rays: number of the ray (K,) and of the way, part of the light, optical depths (K, 3)
    by colour, and where they leave (K, 3) in which direction, in the world."""

    ray: np.ndarray
    way: np.ndarray
    weight: np.ndarray
    depth: np.ndarray
    origin: np.ndarray
    direction: np.ndarray

    def take(self, which: np.ndarray) -> _Rows:
        return _Rows(*(part[which] for part in vars(self).values()))

    @staticmethod
    def joined(*parts: _Rows) -> _Rows:
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return _Rows(*(np.concatenate(column) for column in columns))


_STRIDE = 1 << 20


def _stopper(glass: Glass, things: Sequence[Obstacle]) -> optics.Stop | None:
    """Tells how far rays in a glass get before they meet things in it, or that it touches."""
    if not things:
        return None

    def stop(events: int, medium: int, origin, direction, length) -> np.ndarray:
        if not events:
            return length
        origin = glass.points_to_world(origin)
        direction = direction @ glass.to_world[:3, :3].T
        for thing in things:
            length = np.minimum(length, thing.met_after(origin, direction, length))
        return length

    return stop


def _depths(glass: Glass, ends: optics.RayEnds) -> np.ndarray:
    """(K, 3) optical depths of the ways through a glass's media."""
    return ends.lengths @ np.array(glass.absorption[: ends.lengths.shape[1]])


def _split(rays: _Rays, pixels: np.ndarray, whole: bool) -> tuple[np.ndarray, np.ndarray]:
    """Cells over pixels (h, w), size by size: their corners on the lattice (C, 4, 2), and as
    numbers (C, 4)."""
    height, width = pixels.shape
    summed = np.pad(pixels.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    largest = size = (COARSEST if whole else COARSEST_SMOOTH) * FINEST
    # The filter of the outermost pixels reaches a little beyond these.
    steps = (np.arange(0, (n + 2 * BEYOND) * FINEST, size) for n in (width, height))
    low = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    found, known = [], []
    while len(low):
        low = low[_any_covered(summed, low, size)]
        corners = low[:, None] + size * square
        # Within half a pixel nothing bends: only whether a way ends there is asked.
        middle = low + size // 2 if size > FINEST // 2 else low
        points = np.concatenate((corners, middle[:, None]), axis=1)
        # Where copies bring the rest of the light, nothing may be missing from it.
        numbers = rays.numbers(points, size if whole else largest)
        rough = np.zeros(len(low), bool)
        if size > 1:
            rough = _is_rough(rays, numbers, whole, size / FINEST)
        if size == largest:
            rough = _and_near(rough, low // size)
        found.append(corners[~rough])
        known.append(numbers[~rough, :MIDDLE])
        half = size // 2
        low = (low[rough][:, None] + half * square).reshape(-1, 2)
        size = half
    return np.concatenate(found), np.concatenate(known)


def _any_covered(summed: np.ndarray, low: np.ndarray, size: int) -> np.ndarray:
    """Whether a cell is near any covered pixel, from these pixels' summed table."""
    height, width = summed.shape[0] - 1, summed.shape[1] - 1
    a, b = np.clip(low // FINEST - 2 * BEYOND, 0, (width, height)).T
    c, d = np.clip(-(-(low + size) // FINEST), 0, (width, height)).T
    return summed[d, c] - summed[b, c] - summed[d, a] + summed[b, a] > 0


def _and_near(marked: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Marks (C,) of cells at places (C, 2) of a grid, and those of cells near marked ones."""
    grid = np.zeros((places.max(initial=0, axis=0) + 1)[::-1], bool)
    grid[places[marked, 1], places[marked, 0]] = True
    for _ in range(NEAR):
        grid |= border_pixels(grid[None])
    return grid[places[:, 1], places[:, 0]]


MIDDLE = 4
"""After the four corners of a cell."""


def _is_rough(rays: _Rays, numbers: np.ndarray, whole: bool, size_px: float) -> np.ndarray:
    """Which cells must be split: (C,) by what the rays at their corners and middles (C, 5) do."""
    shown = rays.shown(numbers, whole)
    ways = len(rays.paths)
    pairs, group = np.unique(shown.cell * ways + rays.way[shown.row], return_inverse=True)
    cell_of, way_of = pairs // ways, pairs % ways
    middle = shown.corner == MIDDLE
    around = np.bincount(group[~middle], minlength=len(pairs))
    centre = np.full(len(pairs), -1)
    centre[group[middle]] = np.flatnonzero(middle)
    strongest = np.zeros(len(pairs))
    np.maximum.at(strongest, group, shown.weight)
    steady = (around == 4) & (centre >= 0)
    # A bare path may end within what the screen of everything covers, and fade there.
    rough = ~steady & ((strongest * size_px > EDGE_PX) | (not whole and size_px > FADE_PX))
    some = np.flatnonzero(~middle & steady[group])
    to = group[some]

    def gap(values: np.ndarray) -> np.ndarray:
        mean = np.stack([np.bincount(to, column[some], len(pairs)) for column in values.T], axis=1)
        return np.linalg.norm(0.25 * mean - values[centre], axis=1)

    view, weight = rays.view, shown.weight[centre]
    origin, direction = rays.origin[shown.row], rays.direction[shown.row]
    if view.is_parallel:
        off = gap(direction) * max(view.size) + gap(origin) * view.focal_px
    else:
        far = np.maximum(np.linalg.norm(origin[centre] - view.eye, axis=1), 1e-9)
        off = (gap(direction) + gap(origin) / far) * view.focal_px
    curved = (weight * off > TOLERANCE_PX) | (
        gap(shown.weight[:, None]) * size_px > WEIGHT_TOLERANCE
    )
    rough |= steady & (way_of != STRAIGHT) & curved & (size_px > 0.5)
    return np.bincount(cell_of, rough, len(numbers)) > 0


def _slots(
    rays: _Rays, shown: _Shown, total: int, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins, directions and colours (S, C, 4, 3) of the cells."""
    ways = len(rays.paths)
    pairs, group = np.unique(shown.cell * ways + rays.way[shown.row], return_inverse=True)
    cell_of = pairs // ways
    order = np.lexsort((-np.bincount(group, shown.weight), cell_of))
    start = np.searchsorted(cell_of[order], np.arange(total))
    rank = np.empty(len(pairs), np.intp)
    rank[order] = np.arange(len(pairs)) - start[cell_of[order]]
    slots = min(most, int(rank.max(initial=0)) + 1)
    kept = rank[group] < slots
    # The light of ways without a slot is shared out among the others at that corner.
    place = shown.cell * 4 + shown.corner
    light = np.bincount(place, shown.weight, 4 * total)
    left = np.bincount(place[kept], shown.weight[kept], 4 * total)
    share = np.where(left > 0, light / np.where(left > 0, left, 1.0), 1.0)
    rows, group, place = shown.row[kept], group[kept], place[kept]
    cell, corner = np.divmod(place, 4)
    out = [np.zeros((slots, total, 4, 3), np.float32) for _ in range(3)]
    known = rank < slots
    count = np.bincount(group, minlength=len(pairs))
    for target, values in zip(out[:2], (rays.origin, rays.direction), strict=True):
        # Corners that a way does not reach get the mean of those that it does: it fades out there.
        sums = [np.bincount(group, column[rows], len(pairs)) for column in values.T]
        mean = np.stack(sums, axis=1)[known] / count[known, None]
        target[rank[known], cell_of[known]] = mean[:, None, :]
        target[rank[group], cell, corner] = values[rows]
    light = shown.weight[kept] * share[place]
    out[2][rank[group], cell, corner] = rays.tint[rows] * light[:, None]
    return out[0], out[1], out[2]
