# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of landed light each pixel of a view shows: a sum of bells in the surfaces it sees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..memory import counters
from ..progress import check
from ..rays.columns import Columns, joined
from ..rays.curtain import BLOCK_PX
from ..rays.views import LEAST_AHEAD, RadianceView
from .landed import BLOCK, LEAST_LENGTH, Landed, ellipse

REACH = 2.4
"""Widths to which a bell is summed."""
LEFT = float(np.exp(-0.5 * REACH**2))
"""What a Gauss bell is there over its middle: so much is taken off it, or its end were seen."""
WITHIN = 1.0 - LEFT * (1.0 + 0.5 * REACH**2)
"""The part of a Gauss bell that stays so."""
WIDTH = (WITHIN / (WITHIN - LEFT * REACH**4 / 8.0)) ** 0.5
"""Standard deviations in a bell's width: what stays is as wide as the whole Gauss bell was."""
FINEST_PX = 0.45
"""Standard deviation, pixels, from twice which on a bell is looked at in each other pixel only."""
LONG = 2.5
"""Bells longer than this, over their width, are taken as rows of shorter ones."""
STEP = 1.5
"""Their lengths from one to the next."""
FAINT = 0.02
"""Of a lamp's irradiance: light no stronger is spread as round as needs no rows, in large cells."""
LEAST = 1e-9
"""Relative: what differs less is equal."""
IN_ROW = 1.5
"""Lengths of these, over their widths."""
MOST_IN_ROW = 32
SIZES = 2
"""Steps of an octave: bells whose widths are in one, and whose lengths, may be taken as one."""
TURNS = 6
"""Of half a turn: long bells whose directions are in one of these parts may be taken as one."""
NORMAL_STEPS = 8.0
"""Of a unit: so near to each other surfaces lie in one plane."""
CELL, LARGE_CELL = 0.75, 2.0
"""Standard deviations: sides of the cells in which bells are taken as one, and those of rows and of
faint light, at most. Larger cells are a pattern where light is even; of rows there are many in each
cell, and in faint light it is not seen."""
PAIRS = 60_000
"""Of a bell and a pixel, that are looked at together."""
DEEP = 0.35
"""Of a bell's width: a pixel that shows what lies so far out of its plane has no part in it."""
BESIDE = 1e30
"""Nearness where a pixel shows no surface: in no plane."""
GRAZING = 0.01
"""Sine between surface and sight below which a view shows only streaks."""
ALIKE = 0.15
"""Slope: how far out of a pixel's plane its neighbours may lie to be of its surface."""


@dataclass(frozen=True, eq=False)
class Surfaces(Columns):
    """Surfaces as a view shows them, each as its plane.

    A place's nearness is 1 over its depth, in a parallel view its depth below 0: of a plane it is
    linear in the picture.

    Attributes
    ----------
    x, y : (K,) pixels from the picture's lower left.
    sine : (K,) between surface and sight; below 0 where the view does not see it.
    per : (K, 2) pixels along x and y that are 1 metre across the view's axis.
    slope : (K, 2) of the sight, from the view's axis.
    area : (K,) pixels of a square metre of the surface.
    nearness : (K,) of the place. rise : (K, 2) of its plane, from one pixel to the next.
    width : (K,) how much nearer or farther a place is that lies as far out of the plane as a pixel
        is wide in it.
    """

    x: np.ndarray
    y: np.ndarray
    sine: np.ndarray
    per: np.ndarray
    slope: np.ndarray
    area: np.ndarray
    nearness: np.ndarray
    rise: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, view: RadianceView, points: np.ndarray, normals: np.ndarray) -> Surfaces:
        """Those at world points, with these unit normals (K, 3)."""
        local, normal = view.local(points), view.turned(normals)
        depth = -local[:, 2]
        x, y = (view.project(local, view.near)[0] - view.picture[:2]).T
        scale, slope = np.ones(len(local)), np.zeros((len(local), 2))
        if not view.is_parallel:
            scale /= np.maximum(depth, LEAST_AHEAD)
            slope = local[:, :2] * scale[:, None]
        focal = 0.5 * np.array(view.size) * np.diag(view.projection)[:2]
        per = focal * scale[:, None]
        facing = normal[:, 2] - normal[:, 0] * slope[:, 0] - normal[:, 1] * slope[:, 1]
        sine = facing / np.sqrt(1.0 + slope[:, 0] ** 2 + slope[:, 1] ** 2)
        facing = np.maximum(facing, GRAZING)
        steep, area = scale / facing, per[:, 0] * per[:, 1] * facing
        return cls(
            x,
            y,
            np.where(depth > view.near, sine, -1.0),
            per,
            slope,
            area,
            -depth if view.is_parallel else scale,
            normal[:, :2] * (-steep[:, None] / focal),
            scale * steep / np.sqrt(area),
        )

    def across(self, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vectors (K, 3) of the view's space from these places, in pixels along x and y."""
        x, y = ((vectors[:, :2] + self.slope * vectors[:, 2:]) * self.per).T
        return x, y


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view's picture shows, pixel by pixel.

    Attributes
    ----------
    view : which. used : squares of it that are looked up, see `curtain.looked_up`; None: all.
    nearness, width : (height, width) and rise : (height, width, 2), of `Surfaces`; `BESIDE` where a
        pixel shows no surface.
    """

    view: RadianceView
    used: np.ndarray | None
    nearness: np.ndarray
    rise: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, view: RadianceView, used, pixel, points, normals) -> Seen:
        """Pixels (K,), numbers in the picture, that show surfaces at points with normals (K, 3)."""
        x0, y0, x1, y1 = view.picture
        surfaces = Surfaces.of(view, points, normals)
        kinds = (surfaces.nearness, BESIDE), (surfaces.rise, 0.0), (surfaces.width, 0.0)
        parts = []
        for part, beside in kinds:
            whole = np.full(((y1 - y0) * (x1 - x0), *part.shape[1:]), beside)
            whole[pixel] = part
            parts.append(whole.reshape(y1 - y0, x1 - x0, *part.shape[1:]))
        return cls(view, used, *parts)

    def every(self, step: int) -> Seen:
        """Each so many pixels."""
        parts = (part[::step, ::step] for part in (self.nearness, self.rise, self.width))
        return Seen(self.view, self.used, *parts)


def density(landed: Landed, seen: Seen, sigma_px: float) -> np.ndarray:
    """Irradiance (height, width, 3) of landed light on what each pixel shows.

    Parameters
    ----------
    sigma_px : standard deviation of the pixel filter.
    """
    spots, surfaces = _seen_spots(landed, seen, sigma_px)
    level = np.floor(np.log2(np.maximum(spots.short / FINEST_PX, 1.0))).astype(np.intp)
    coarsest = int(level.max(initial=0))
    total = np.zeros((*seen.every(2**coarsest).nearness.shape, 3))
    for number in reversed(range(coarsest + 1)):
        pixels = seen.every(2**number)
        if number < coarsest:
            total = _finer(total, pixels, 2**number)
        some = np.flatnonzero(level == number)
        total += _summed(spots.take(some), surfaces.take(some), pixels, 2**number)
    return total


@dataclass(frozen=True, eq=False)
class _Spots(Columns):
    """Bells as a view shows them.

    `source`: (K,) number of the landed light in whose surface each lies. `code`: (K,) int64, alike
    for those of nearly one plane, shape and sign. `x`, `y`: (K,) its middle, pixels from the
    picture's lower left. `xx`, `xy`, `yy`: (K,) moments about it, square pixels. `light`: (K, 3)
    its light times the pixels of a square metre. `cell`: (K,) side of the cells in which they may
    be one, pixels.
    """

    source: np.ndarray
    code: np.ndarray
    cell: np.ndarray
    x: np.ndarray
    y: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    light: np.ndarray

    @property
    def short(self) -> np.ndarray:
        """(K,) the lesser of their standard deviations, pixels."""
        return ellipse(self.xx, self.xy, self.yy)[0][1]


def _seen_spots(landed: Landed, seen: Seen, sigma_px: float) -> tuple[_Spots, Surfaces]:
    """Bells as a view with this pixel filter shows them, and the surfaces that they lie in."""
    middle = landed.point.mean(axis=0) if len(landed) else np.zeros(3)
    parts, planes = [], []
    for first in range(0, max(1, len(landed)), BLOCK):
        check()
        some = np.arange(first, min(first + BLOCK, len(landed)))
        surfaces = Surfaces.of(seen.view, landed.point[some], landed.normal[some])
        planes.append(surfaces)
        shown = np.flatnonzero(surfaces.sine > GRAZING)
        spots = _spots(landed, some[shown], middle, surfaces.take(shown), seen.view, sigma_px)
        spots = spots.take(_inside(spots, seen))
        rows = _in_rows(spots, landed.strength[spots.source])
        parts.append(_in_cells(rows.take(_inside(rows, seen))))
    spots = _in_cells(joined(_Spots, parts))
    counters["bells"] += len(spots)
    return spots, joined(Surfaces, planes).take(spots.source)


def _spots(landed, some, middle, surfaces: Surfaces, view: RadianceView, sigma_px: float) -> _Spots:
    """Some of the landed light, by numbers (K,), as a view shows it on its surfaces."""
    (ax, ay), (bx, by) = (
        surfaces.across(view.turned(bell[some])) for bell in (landed.major, landed.minor)
    )
    square = sigma_px**2
    # In powers of 2: what lies side by side is measured alike.
    step = np.exp2(np.floor(-0.5 * np.log2(surfaces.area)))
    normal = landed.normal[some]
    above = np.rint(np.einsum("nk,nk->n", landed.point[some] - middle, normal) / step)
    return _Spots(
        some,
        _hash(*np.rint(NORMAL_STEPS * normal).T, above, step.view(np.int64)),
        np.zeros(len(some)),
        surfaces.x,
        surfaces.y,
        ax * ax + bx * bx + square,
        ax * ay + bx * by,
        ay * ay + by * by + square,
        landed.flux[some] * surfaces.area[:, None],
    )


def _inside(spots: _Spots, seen: Seen) -> np.ndarray:
    """Numbers of the spots that reach into the picture, and there what is looked up."""
    height, width = seen.nearness.shape
    wide, high = (REACH * WIDTH * np.sqrt(part) for part in (spots.xx, spots.yy))
    some = np.flatnonzero(
        (spots.x > -wide) & (spots.x < width + wide) & (spots.y > -high) & (spots.y < height + high)
    )
    if seen.used is None:
        return some
    x0, y0, *_ = seen.view.picture
    x, y, wide, high = spots.x[some] + x0, spots.y[some] + y0, wide[some], high[some]
    return some[_reaches(seen.used, (x - wide, y - high), (x + wide, y + high))]


def _in_rows(spots: _Spots, strength: np.ndarray) -> _Spots:
    """Long spots as rows of shorter ones, or where it does not matter as wider ones.

    Parameters
    ----------
    strength : (K,) of `Landed`.
    """
    (long, short), angle = ellipse(spots.xx, spots.xy, spots.yy)
    short = np.maximum(short, long / (LONG * np.maximum(1.0, strength / FAINT)))
    # What is longer than the longest row is wider.
    short = np.maximum(short, 4.0 * long / (STEP * MOST_IN_ROW * IN_ROW))
    many = long > LONG * short * (1.0 + LEAST)
    own = np.where(many, IN_ROW * short, long)
    count = np.where(many, np.ceil(4.0 * long / (STEP * own)), 1.0).astype(np.intp)
    cosine, sine = np.cos(angle), np.sin(angle)
    square, other = own**2, short**2
    rest = np.sqrt(np.maximum(long**2 - square, 0.0))
    size, shape = np.floor(SIZES * np.log2(short)), np.floor(SIZES * np.log2(own / short))
    turn = np.where(shape > 0.0, np.floor(angle * (TURNS / np.pi)), 0.0)
    large = many | (strength < FAINT)
    changed = replace(
        spots,
        cell=np.where(large, LARGE_CELL, CELL) * np.exp2(size / SIZES),
        code=_hash(spots.code, size, shape, turn, large, np.sign(spots.light.sum(axis=1))),
        xx=square * cosine**2 + other * sine**2,
        xy=(square - other) * cosine * sine,
        yy=square * sine**2 + other * cosine**2,
    )
    row = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    offset = (2.0 * (rank + 0.5) / count[row] - 1.0) * 2.0 * many[row]
    weight = np.exp(-0.5 * offset**2)
    weight /= np.bincount(row, weight, len(count))[row]
    rows = changed.take(row)
    return replace(
        rows,
        x=rows.x + offset * (rest * cosine)[row],
        y=rows.y + offset * (rest * sine)[row],
        light=rows.light * weight[:, None],
    )


def _in_cells(spots: _Spots) -> _Spots:
    """Spots of one code that lie in one cell of the picture as one, with their moments."""
    if not len(spots):
        return spots
    column, row = np.floor(spots.x / spots.cell), np.floor(spots.y / spots.cell)
    code = _hash(spots.code, column, row)
    order = np.argsort(code)
    begins = np.concatenate(([True], np.diff(code[order]) != 0))
    first = order[begins]
    group = np.empty(len(order), np.intp)
    group[order] = np.cumsum(begins) - 1
    red, green, blue = spots.light.T
    weight = np.abs(red) + np.abs(green) + np.abs(blue) + LEAST_LENGTH
    weight /= np.bincount(group, weight)[group]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(group, weight * values)

    # From the cell's corner: nothing cancels.
    column, row = column * spots.cell, row * spots.cell
    right, up = spots.x - column, spots.y - row
    x, y = mean(right), mean(up)
    return _Spots(
        spots.source[first],
        spots.code[first],
        spots.cell[first],
        column[first] + x,
        row[first] + y,
        mean(right * right + spots.xx) - x * x,
        mean(right * up + spots.xy) - x * y,
        mean(up * up + spots.yy) - y * y,
        np.stack([np.bincount(group, part) for part in (red, green, blue)], axis=1),
    )


def _hash(*columns: np.ndarray) -> np.ndarray:
    """(K,) int64 that tells rows of whole numbers apart."""
    found = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        found ^= column.astype(np.int64).view(np.uint64)
        found *= np.uint64(0x9E3779B97F4A7C15)
        found ^= found >> np.uint64(29)
    return found.view(np.int64)


def _reaches(used: np.ndarray, low, high) -> np.ndarray:
    """(K,) which boxes of a frame, x and y (K,) of their corners, touch squares that are used."""
    sums = np.zeros((used.shape[0] + 1, used.shape[1] + 1), np.intp)
    sums[1:, 1:] = used.cumsum(axis=0).cumsum(axis=1)
    (x0, y0), (x1, y1) = (
        [
            np.clip(np.floor(part / BLOCK_PX) + last, 0, count).astype(np.intp)
            for part, count in zip(corner, used.shape[::-1], strict=True)
        ]
        for corner, last in ((low, 0), (high, 1))
    )
    return sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0] > 0


def _summed(spots: _Spots, surfaces: Surfaces, seen: Seen, side: int) -> np.ndarray:
    """Irradiance (height, width, 3) of spots, each on its surface, in pixels ``side`` apart."""
    height, width = seen.nearness.shape
    column, row = (np.rint((part - 0.5) / side).astype(np.intp) for part in (spots.x, spots.y))
    right, up = (
        np.ceil(REACH * WIDTH / side * np.sqrt(part)).astype(np.intp)
        for part in (spots.xx, spots.yy)
    )
    rise, rise_up = surfaces.rise.T
    determinant = spots.xx * spots.yy - spots.xy**2
    inverse = -0.5 / WIDTH**2 / determinant
    columns = (
        # From the bell's middle to the pixel nearest to it.
        side * column + 0.5 - spots.x,
        side * row + 0.5 - spots.y,
        # It is exp(x (xx x + xy y) + yy y²).
        spots.yy * inverse,
        -2.0 * spots.xy * inverse,
        spots.xx * inverse,
        # The plane, and how far out of it pixels may lie.
        surfaces.nearness + rise * (spots.x - surfaces.x) + rise_up * (spots.y - surfaces.y),
        rise,
        rise_up,
        DEEP * WIDTH * spots.short * surfaces.width,
        *spots.light.T / (2.0 * np.pi * WITHIN * WIDTH**2 * np.sqrt(determinant)),
    )
    is_grey = np.array_equal(spots.light[:, :2], spots.light[:, 1:])
    bells = np.stack(columns[:-2] if is_grey else columns)
    border = 2 * int(max(right.max(initial=0), up.max(initial=0)))
    padded = np.pad(seen.nearness, border, constant_values=BESIDE)
    total = np.zeros((3, *padded.shape))
    near = (column >= -right) & (column < width + right) & (row >= -up) & (row < height + up)
    near = np.flatnonzero(near)
    # Bells of one size go row by row: those that are summed together lie in a few rows.
    size = up * padded.shape[1] + right
    order = near[np.argsort(size[near] * len(padded) + row[near])]
    ends = np.flatnonzero(np.diff(size[order])) + 1
    for group in np.split(order, ends) if len(order) else ():
        steps, steps_up = (np.arange(-most[group[0]], most[group[0]] + 1) for most in (right, up))
        pixels = len(steps) * len(steps_up)
        for part in np.array_split(group, -(-len(group) * pixels // PAIRS)):
            check()
            low = row[part[0]] + steps_up[0] + border
            rows = np.s_[low : row[part[-1]] + steps_up[-1] + border + 1]
            shown, sums = padded[rows], total[:, rows]
            # Bells come last: NumPy is slow on short rows.
            index = (steps_up[:, None] * shown.shape[1] + steps + border)[..., None]
            index = index + ((row[part] + border - low) * shown.shape[1] + column[part])
            counters["bell_pixels"] += index.size
            x, y, xx, xy, yy, nearness, rise, rise_up, deep, *light = bells.take(part, axis=1)
            x, y = x + side * steps[:, None], y + side * steps_up[:, None]
            bell = (xy * x).astype(np.float32) + (yy * y).astype(np.float32)[:, None]
            bell *= y.astype(np.float32)[:, None]
            bell += (xx * x * x).astype(np.float32)
            there = shown.take(index)
            if not seen.view.is_parallel:
                # What is farther away is wider than it looks here.
                bell *= np.square(nearness / there, dtype=np.float32)
            np.exp(bell, out=bell)
            bell -= np.float32(LEFT)
            np.maximum(bell, 0.0, out=bell)
            there -= rise * x + (rise_up * y + nearness)[:, None]
            bell *= np.abs(there, out=there) <= deep
            for channel, colour in zip(sums, light, strict=False):
                found = np.bincount(index.ravel(), (bell * colour).ravel(), shown.size)
                channel += found.reshape(shown.shape)
    if is_grey:
        total[1:] = total[0]
    inner = np.s_[border : border + height, border : border + width]
    return np.moveaxis(total[:, *inner], 0, -1)


def _finer(coarse: np.ndarray, seen: Seen, side: int) -> np.ndarray:
    """Values of each other pixel for all of these, of the nearest that lie in the pixel's plane.

    Parameters
    ----------
    side : from one of these to the next, pixels of the picture.
    """
    nearness = np.pad(seen.nearness[::2, ::2], (0, 1), constant_values=BESIDE)
    # Channels come first: NumPy is slow on short rows.
    values = np.pad(np.moveaxis(coarse, -1, 0), ((0, 0), (0, 1), (0, 1)), mode="edge")
    found = np.empty((3, *seen.nearness.shape))
    for odd in np.ndindex(2, 2):
        some = np.s_[odd[0] :: 2, odd[1] :: 2]
        place, rise, width = seen.nearness[some], seen.rise[some], seen.width[some]
        height, across = place.shape
        out, shares = np.zeros((3, *place.shape)), np.zeros(place.shape)
        for down, right in np.ndindex(1 + odd[0], 1 + odd[1]):
            part = np.s_[down : down + height, right : right + across]
            x, y = side * (2 * right - odd[1]), side * (2 * down - odd[0])
            above = nearness[part] - place - x * rise[..., 0] - y * rise[..., 1]
            share = np.abs(above) <= ALIKE * np.hypot(x, y) * width
            out += share * values[:, *part]
            shares += share
        nearest = values[:, :height, :across]
        found[:, *some] = np.where(shares > 0.0, out / np.maximum(shares, 1.0), nearest)
    return np.moveaxis(found, 0, -1)
