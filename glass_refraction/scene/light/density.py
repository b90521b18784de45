# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of landed light each pixel of a view shows: a sum of bells in the surfaces it sees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..memory import counters
from ..progress import check
from ..rays.columns import Columns, joined
from ..rays.curtain import BLOCK_PX
from ..rays.views import RadianceView
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
"""Of a lamp's irradiance: light no stronger is spread as round as needs no rows."""
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
CELL, ROW_CELL = 0.75, 2.0
"""Standard deviations: sides of the cells in which bells are taken as one, and those of rows, at
most. Larger cells are a pattern where light is even; of rows there are many in each cell."""
PAIRS = 60_000
"""Of a bell and a pixel, that are looked at together."""
DEEP = 0.5
"""Of a bell's length: a pixel that shows what lies so far out of its plane has no part in it."""
BESIDE = 1e9
"""Metres: where a pixel is put that shows no surface."""
GRAZING = 0.01
"""Sine between surface and sight below which a view shows only streaks."""
ALIKE = 0.15
"""Sine: how far aside of a pixel's plane its neighbours may lie to be of its surface."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view's picture shows, pixel by pixel.

    Attributes
    ----------
    view : which. used : squares of it that are looked up, see `curtain.looked_up`; None: all.
    points, normals : (height, width, 3) float32, from the middle of what is looked at, metres, and
        unit towards the view.
    """

    view: RadianceView
    used: np.ndarray | None
    middle: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def density(landed: Landed, seen: Seen, sigma_px: float) -> np.ndarray:
    """Irradiance (height, width, 3) of landed light on what each pixel shows.

    Parameters
    ----------
    sigma_px : standard deviation of the pixel filter.
    """
    bells = _seen_bells(landed, seen, sigma_px)
    levels = 1 + int(bells.level.max(initial=0))
    points, normals = [seen.points], [seen.normals]
    for _ in range(levels - 1):
        points.append(points[-1][::2, ::2])
        normals.append(normals[-1][::2, ::2])
    total = np.zeros((*points[-1].shape[:2], 3))
    for level in reversed(range(levels)):
        if level < levels - 1:
            total = _finer(total, points[level + 1], points[level], normals[level])
        total += _summed(bells.take(np.flatnonzero(bells.level == level)), points[level], level)
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


@dataclass(frozen=True, eq=False)
class _Surfaces:
    """Where landed light lies, about which a view is linear.

    `x`, `y`: (K,) pixels. `place`: (K, 3) from the middle. `normal`: (K, 3). `slope`: (K, 2, 3)
    pixels per metre along a vector.
    """

    x: np.ndarray
    y: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True, eq=False)
class _Bells(Columns):
    """Bells of a view, each with its pixels.

    `pixel`: (K, 2) from the picture's lower left. `place`: (K, 3) from the middle. `plane`:
    (K, 3, 3): takes a vector to its two distances in standard deviations and that from the plane,
    in those that count. `light`: (K, 3) in its middle. `reach`: (K, 2) along x and y and
    `level`: (K,): it is summed so far in pixels of side 2 ** level.
    """

    pixel: np.ndarray
    place: np.ndarray
    plane: np.ndarray
    light: np.ndarray
    reach: np.ndarray
    level: np.ndarray


def _seen_bells(landed: Landed, seen: Seen, sigma_px: float) -> _Bells:
    parts = []
    for first in range(0, max(1, len(landed)), BLOCK):
        check()
        some = np.arange(first, min(first + BLOCK, len(landed)))
        some = some[_before(landed.point[some], landed.normal[some], seen)]
        spots = _spots(landed, some, seen, sigma_px)
        spots = spots.take(_inside(spots, seen))
        rows = _in_rows(spots, landed.strength[spots.source])
        parts.append(_in_cells(rows.take(_inside(rows, seen))))
    spots = _in_cells(joined(_Spots, parts))
    counters["bells"] += len(spots)
    surfaces = _surfaces(landed.point[spots.source], landed.normal[spots.source], seen)
    return _on_surfaces(spots, surfaces)


def _before(points: np.ndarray, normals: np.ndarray, seen: Seen) -> np.ndarray:
    """(K,) whether surfaces at points, with these normals (K, 3), turn to a view before them."""
    view = seen.view
    local = view.local(points)
    if view.is_parallel:
        facing, length = normals @ view.to_camera[2, :3], 1.0
    else:
        facing = -np.einsum("nk,nk->n", local, normals @ view.to_camera[:3, :3].T)
        length = np.sqrt(np.einsum("nk,nk->n", local, local))
    return (facing > GRAZING * length) & (-local[:, 2] > view.near)


def _surfaces(points: np.ndarray, normals: np.ndarray, seen: Seen) -> _Surfaces:
    """The surfaces at points, with these normals (K, 3), as a view shows them."""
    view = seen.view
    local = view.local(points)
    depth = -local[:, 2]
    slope = np.empty((len(points), 2, 3))
    for axis in (0, 1):
        per = 0.5 * view.size[axis] * view.projection[axis, axis]
        for k in range(3):
            slope[:, axis, k] = per * view.to_camera[axis, k]
            if not view.is_parallel:
                slope[:, axis, k] += per * local[:, axis] / depth * view.to_camera[2, k]
                slope[:, axis, k] /= depth
    x, y = (view.project(local, view.near)[0] - view.picture[:2]).T
    return _Surfaces(x, y, points - seen.middle, normals, slope)


def _spots(landed: Landed, some: np.ndarray, seen: Seen, sigma_px: float) -> _Spots:
    """Some of the landed light, by numbers (K,), as a view with this pixel filter shows it."""
    surfaces = _surfaces(landed.point[some], landed.normal[some], seen)
    (ax, ay), (bx, by) = (
        [np.einsum("nk,nk->n", surfaces.slope[:, axis], bell[some]) for axis in (0, 1)]
        for bell in (landed.major, landed.minor)
    )
    square = sigma_px**2
    area = np.abs(_area(surfaces))
    # In powers of 2: what lies side by side is measured alike.
    step = np.exp2(np.floor(-0.5 * np.log2(area)))
    above = np.rint(np.einsum("nk,nk->n", surfaces.place, surfaces.normal) / step)
    facing = np.rint(NORMAL_STEPS * surfaces.normal).T
    return _Spots(
        some,
        _hash(*facing, above, step.view(np.int64)),
        np.zeros(len(area)),
        surfaces.x,
        surfaces.y,
        ax * ax + bx * bx + square,
        ax * ay + bx * by,
        ay * ay + by * by + square,
        landed.flux[some] * area[:, None],
    )


def _area(surfaces: _Surfaces) -> np.ndarray:
    """(K,) pixels of a square metre."""
    (ax, ay, az), (bx, by, bz) = surfaces.slope.transpose(1, 2, 0)
    nx, ny, nz = surfaces.normal.T
    return nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)


def _inside(spots: _Spots, seen: Seen) -> np.ndarray:
    """Numbers of the spots that reach into the picture, and there what is looked up."""
    height, width, _ = seen.points.shape
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
    changed = replace(
        spots,
        cell=np.where(many, ROW_CELL, CELL) * np.exp2(size / SIZES),
        code=_hash(spots.code, size, shape, turn, many, np.sign(spots.light.sum(axis=1))),
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
    order = np.argsort(code, kind="stable")
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


def _on_surfaces(spots: _Spots, surfaces: _Surfaces) -> _Bells:
    """Spots as bells, each in the plane of its surface."""
    sides, angle = ellipse(spots.xx, spots.xy, spots.yy)
    long, short = (WIDTH * side for side in sides)
    # A vector in the surface, in standard deviations along and across.
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = np.array(((cosine / long, sine / long), (-sine / short, cosine / short)))
    plane = np.empty((len(spots), 3, 3))
    plane[:, :2] = turned.transpose(2, 0, 1) @ surfaces.slope
    # How long the bell is in the surface, on its longer side.
    across = plane[:, :2] - (plane[:, :2] @ surfaces.normal[..., None]) * surfaces.normal[:, None]
    steepness = np.sqrt((across**2).sum(axis=(1, 2)))
    plane[:, 2] = surfaces.normal * (steepness / DEEP)[:, None]
    # A pixel aside lies in the plane where the other's slope does not change.
    first, second = surfaces.slope.transpose(1, 0, 2)
    right = np.cross(second, surfaces.normal) * (spots.x - surfaces.x)[:, None]
    up = np.cross(surfaces.normal, first) * (spots.y - surfaces.y)[:, None]
    level = np.floor(np.log2(np.maximum(sides[1] / FINEST_PX, 1.0)))
    return _Bells(
        np.stack((spots.x, spots.y), axis=1).astype(np.float32),
        (surfaces.place + (right + up) / _area(surfaces)[:, None]).astype(np.float32),
        plane.astype(np.float32),
        spots.light / (2.0 * np.pi * WITHIN * long * short)[:, None],
        np.ceil(REACH * WIDTH * np.sqrt((spots.xx, spots.yy)) / 2.0**level).T.astype(np.intp),
        level.astype(np.intp),
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


def _summed(bells: _Bells, points: np.ndarray, level: int) -> np.ndarray:
    """Irradiance (height, width, 3) of bells on places (height, width, 3)."""
    height, width = points.shape[:2]
    border = 2 * int(bells.reach.max(initial=0))
    padded = np.full((3, height + 2 * border, width + 2 * border), BESIDE, np.float32)
    padded[:, border : border + height, border : border + width] = np.moveaxis(points, -1, 0)
    wide = padded.shape[2]
    padded = padded.reshape(3, -1)
    total = np.zeros((3, padded.shape[1]))
    nearest = np.rint((bells.pixel - 0.5) / 2.0**level).astype(np.intp)
    near = (nearest >= -bells.reach) & (nearest < np.array((width, height)) + bells.reach)
    near = near.all(axis=1)
    grey = np.ptp(bells.light, axis=1).max(initial=0.0) <= 0.0
    some = np.flatnonzero(near)
    code = bells.reach[some] @ (wide, 1)
    order = np.argsort(code, kind="stable")
    some, code = some[order], code[order]
    groups = np.split(some, np.flatnonzero(np.diff(code)) + 1) if len(some) else []
    for group in groups:
        right, up = (np.arange(-part, part + 1) for part in bells.reach[group[0]])
        offsets = (up[:, None] * wide + right).ravel()
        for part in np.array_split(group, -(-len(group) * len(offsets) // PAIRS)):
            check()
            centre = (nearest[part, 1] + border) * wide + nearest[part, 0] + border
            index = centre[:, None] + offsets
            counters["bell_pixels"] += index.size
            apart = [padded[k].take(index) for k in range(3)]
            for k in range(3):
                apart[k] -= bells.place[part, k : k + 1]
            first, second, above = (
                sum(apart[k] * bells.plane[part, number, k : k + 1] for k in range(3))
                for number in range(3)
            )
            bell = np.exp(-0.5 * (first * first + second * second)) - np.float32(LEFT)
            bell *= (bell > 0.0) & (np.abs(above) <= 1.0)
            for k in range(1 if grey else 3):
                light = bell * bells.light[part, k : k + 1]
                total[k] += np.bincount(index.ravel(), light.ravel(), total.shape[1])
    if grey:
        total[1:] = total[0]
    total = total.reshape(3, -1, wide)[:, border : border + height, border : border + width]
    return np.moveaxis(total, 0, -1)


def _finer(total, coarse, points, normals) -> np.ndarray:
    """Values of each other pixel for all pixels, of the nearest that lie in the pixel's plane."""
    height, width = points.shape[:2]
    found = np.zeros((height, width, 3))
    for odd_row in (0, 1):
        for odd_column in (0, 1):
            some = np.s_[odd_row::2, odd_column::2]
            place, normal = points[some], normals[some]
            rows, columns = place.shape[:2]
            out, shares = np.zeros(place.shape), np.zeros((rows, columns, 1))
            for down in range(1 + odd_row):
                for right in range(1 + odd_column):
                    r = np.minimum(np.arange(rows) + down, len(total) - 1)[:, None]
                    c = np.minimum(np.arange(columns) + right, total.shape[1] - 1)
                    apart = coarse[r, c] - place
                    above = np.abs(np.einsum("ijk,ijk->ij", apart, normal))
                    length = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
                    share = (above <= ALIKE * length)[..., None]
                    out += share * total[r, c]
                    shares += share
            nearest = total[:rows, :columns]
            found[some] = np.where(shares > 0.0, out / np.maximum(shares, 1.0), nearest)
    return found
