# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of landed light each pixel of a view shows: a sum of bells in the surfaces it sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..progress import check
from ..rays.columns import Columns
from ..rays.curtain import BLOCK_PX
from ..rays.views import RadianceView
from .landed import Landed, ellipse

REACH = 2.6
"""Standard deviations to which a bell is summed: 97 % of it, the rest is made up for."""
CUT = 1.0 - float(np.exp(-0.5 * REACH**2))
"""The part of a bell within."""
FINEST_PX = 0.45
"""Standard deviation, pixels, from twice which on a bell is looked at in each other pixel only."""
LONG = 2.5
"""Bells longer than this, over their width, are taken as rows of shorter ones."""
STEP = 1.5
"""Widths between the bells of such a row."""
FAINT = 0.02
"""Of a lamp's irradiance: light no stronger is spread as round as needs no rows."""
LEAST = 1e-9
"""Relative: what differs less is equal."""
MOST_IN_ROW = 32
PAIRS = 400_000
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
class _Bells(Columns):
    """Bells of a view, each with its pixels.

    `pixel`: (K, 2) from the picture's lower left. `place`: (K, 3) from the middle. `plane`:
    (K, 3, 3): takes a vector to its two distances in standard deviations and that from the plane,
    in those that count. `light`: (K, 3) in its middle. `reach`: (K,) pixels. `level`: (K,) it is
    summed in pixels of side 2 ** level.
    """

    pixel: np.ndarray
    place: np.ndarray
    plane: np.ndarray
    light: np.ndarray
    reach: np.ndarray
    level: np.ndarray


def _seen_bells(landed: Landed, seen: Seen, sigma_px: float) -> _Bells:
    view = seen.view
    x0, y0, x1, y1 = view.picture
    # Of what turns to the view and lies before it.
    away = view.forward if view.is_parallel else landed.point - view.eye
    length = np.sqrt((away * away).sum(axis=-1))
    facing = -(away * landed.normal).sum(axis=-1)
    local = view.local(landed.point)
    some = np.flatnonzero((facing > GRAZING * length) & (-local[:, 2] > view.near))
    landed, local = landed.take(some), local[some]
    check()
    # Pixels per metre along two directions in the surface.
    ahead = -local[:, 2]
    pixel = view.project(local, view.near)[0] - (x0, y0)
    per = 0.5 * np.array(view.size) * (view.projection[0, 0], view.projection[1, 1])
    basis = _basis(landed)
    turn = view.to_camera[:3, :3]
    matrix = np.empty((len(landed.point), 2, 2))
    for column, vector in enumerate(basis):
        moved = vector @ turn.T
        for row in (0, 1):
            slope = moved[:, row]
            if not view.is_parallel:
                slope = (slope + local[:, row] / ahead * moved[:, 2]) / ahead
            matrix[:, row, column] = per[row] * slope
    major, minor = (np.sqrt((part * part).sum(axis=1)) for part in (landed.major, landed.minor))
    x, y = matrix[:, 0] * np.stack((major, minor), 1), matrix[:, 1] * np.stack((major, minor), 1)
    (long, short), angle = ellipse(
        (x * x).sum(axis=1) + sigma_px**2,
        (x * y).sum(axis=1),
        (y * y).sum(axis=1) + sigma_px**2,
    )
    inside = np.ones(len(pixel), bool)
    for axis, last in enumerate((x1 - x0, y1 - y0)):
        inside &= (pixel[:, axis] > -REACH * long) & (pixel[:, axis] < last + REACH * long)
    some = np.flatnonzero(inside)
    if seen.used is not None:
        some = some[_reaches(seen.used, pixel[some] + (x0, y0), REACH * long[some])]
    landed, pixel, matrix = landed.take(some), pixel[some], matrix[some]
    basis = [part[some] for part in basis]
    long, short, angle = long[some], short[some], angle[some]
    # Long ones as rows, or where it does not matter as wider ones.
    slender = LONG * np.maximum(1.0, landed.strength / FAINT)
    short = np.maximum(short, long / slender)
    count = np.where(long > LONG * short * (1.0 + LEAST), np.ceil(4.0 * long / (STEP * short)), 1.0)
    count = np.minimum(count, MOST_IN_ROW).astype(np.intp)
    row = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    many = count > 1
    own = np.where(many, np.maximum(short, 4.0 * long / (STEP * MOST_IN_ROW)), long)
    rest = np.sqrt(np.maximum(long**2 - own**2, 0.0))
    offset = (2.0 * (rank + 0.5) / count[row] - 1.0) * 2.0 * many[row]
    weight = np.exp(-0.5 * offset**2)
    weight /= np.bincount(row, weight, len(count))[row]
    axis = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    (xx, xy), (yx, yy) = matrix.transpose(1, 2, 0)
    area = xx * yy - xy * yx
    step_px = rest[:, None] * axis
    along = (yy * step_px[:, 0] - xy * step_px[:, 1]) / area
    aside = (xx * step_px[:, 1] - yx * step_px[:, 0]) / area
    step = along[:, None] * basis[0] + aside[:, None] * basis[1]
    place = (landed.point - seen.middle)[row] + offset[:, None] * step[row]
    # A vector in the surface, in standard deviations along and across.
    plane = np.empty((len(count), 3, 3))
    cosine, sine = axis.T
    for number, (x, y) in enumerate(((cosine / own, sine / own), (-sine / short, cosine / short))):
        first, second = x * xx + y * yx, x * xy + y * yy
        plane[:, number] = first[:, None] * basis[0] + second[:, None] * basis[1]
    # How long the bell is in the surface, on its longer side.
    steepness = np.sqrt((plane[:, :2] ** 2).sum(axis=(1, 2)))
    plane[:, 2] = landed.normal * (steepness / DEEP)[:, None]
    middle = np.abs(area) / (2.0 * np.pi * own * short * CUT)
    level = np.floor(np.log2(np.maximum(np.minimum(own, short) / FINEST_PX, 1.0)))
    reach = REACH * np.maximum(own, short) / 2.0**level
    return _Bells(
        (pixel[row] + offset[:, None] * step_px[row]).astype(np.float32),
        place.astype(np.float32),
        plane[row].astype(np.float32),
        (landed.flux * middle[:, None])[row] * weight[:, None],
        np.ceil(reach[row]).astype(np.intp),
        level[row].astype(np.intp),
    )


def _reaches(used: np.ndarray, pixel: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(K,) which places (K, 2) of a frame are no farther from squares that are used than this."""
    sums = np.zeros((used.shape[0] + 1, used.shape[1] + 1), np.intp)
    sums[1:, 1:] = used.cumsum(axis=0).cumsum(axis=1)
    sides = [
        np.clip(np.floor((pixel + sign * reach[:, None]) / BLOCK_PX) + last, 0, used.shape[::-1])
        for sign, last in ((-1.0, 0), (1.0, 1))
    ]
    (x0, y0), (x1, y1) = (side.T.astype(np.intp) for side in sides)
    return sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0] > 0


def _basis(landed: Landed) -> list[np.ndarray]:
    """Two unit vectors (K, 3) in each surface, along its bell's axes where it has any."""
    length = np.sqrt((landed.major**2).sum(axis=1))
    bare = length <= 0.0
    first = np.where(bare[:, None], 0.0, landed.major / np.where(bare, 1.0, length)[:, None])
    some = np.flatnonzero(bare)
    side = np.cross(landed.normal[some], np.eye(3)[np.abs(landed.normal[some]).argmin(axis=1)])
    first[some] = side / np.linalg.norm(side, axis=1, keepdims=True)
    return [first, np.cross(landed.normal, first)]


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
    near = (nearest >= -bells.reach[:, None]).all(axis=1)
    near &= (nearest < np.array((width, height)) + bells.reach[:, None]).all(axis=1)
    grey = np.ptp(bells.light, axis=1).max(initial=0.0) <= 0.0
    for reach in np.unique(bells.reach):
        some = np.flatnonzero(near & (bells.reach == reach))
        steps = np.arange(-reach, reach + 1)
        offsets = (steps[:, None] * wide + steps).ravel()
        block = max(1, PAIRS // len(offsets))
        for start in range(0, len(some), block):
            check()
            part = some[start : start + block]
            centre = (nearest[part, 1] + border) * wide + nearest[part, 0] + border
            index = centre[:, None] + offsets
            apart = [padded[k][index] - bells.place[part, k : k + 1] for k in range(3)]
            plane = bells.plane[part]
            square = np.zeros(index.shape, np.float32)
            for number in range(3):
                along = sum(apart[k] * plane[:, number, k : k + 1] for k in range(3))
                if number < 2:
                    square += along * along
                else:
                    square[np.abs(along) > 1.0] = np.inf
            bell = np.exp(-0.5 * square)
            bell[square > REACH**2] = 0.0
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
    row, column = np.arange(height), np.arange(width)
    rows = (row // 2, np.minimum((row + 1) // 2, len(total) - 1))
    columns = (column // 2, np.minimum((column + 1) // 2, total.shape[1] - 1))
    out, shares = np.zeros((height, width, 3)), np.zeros((height, width))
    for r in rows:
        for c in columns:
            apart = coarse[r[:, None], c] - points
            height_over = np.abs(np.einsum("ijk,ijk->ij", apart, normals))
            length = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
            share = (height_over <= ALIKE * length).astype(float)
            out += share[..., None] * total[r[:, None], c]
            shares += share
    nearest = total[rows[0][:, None], columns[0]]
    found = shares > 0.0
    return np.where(found[..., None], out / np.where(found, shares, 1.0)[..., None], nearest)
