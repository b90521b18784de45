# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of all light paths over the picture, as a plane mesh that is fine where they need it.

Every vertex knows, for each path, where the ray through it leaves the glass, in which direction,
and which part of the light takes the path; between vertices this is interpolated linearly. Cells
are split until that is near enough: to quarters of a pixel where a path's region ends, hardly at
all in the smooth middle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .read.glasses import Glass
from .read.viewpoint import Viewpoint
from .vertices.chains import exits
from .vertices.path_keys import Path
from .vertices.regions import PathRays, Regions, border_pixels, may_lack_light

FINEST = 4
"""Cells a side of a pixel where a path's region ends."""
COARSEST = 8
"""Pixels a side of the largest cells."""
BEYOND = 2
"""Pixels beyond the regions' rectangle: where it ends with the picture, the filter reaches on."""
TOLERANCE_PX = 0.25
"""Largest error, in pixels seen straight on and times the path's weight, of interpolated rays."""
WEIGHT_TOLERANCE = 0.003
"""Largest error of interpolated weights."""

FAINT = 0.02
"""Weight below which the end of a path is not looked at, where there are dozens of paths."""

_MARGIN = 2 * FINEST  # steps outwards: what the pixel filter reaches of a half covered pixel


@dataclass(frozen=True, eq=False)
class Screen:
    """Rays over the picture.

    Attributes
    ----------
    numbers : of the P paths among the glass's.
    pixels : (V, 2) where the vertices are in the picture.
    cells : (C, 4) squares of vertices, anticlockwise.
    weights : (P, V) part of the light along each path; the parts of a ray sum to one. A few pixels
        beyond the outline those of the nearest rays in it.
    tints : (P, V, 3) what the glass's media let through of it.
    origins, directions : (P, V, 3) of the rays after the path's last event, in the world; 0 where
        no ray near takes the path.
    """

    numbers: tuple[int, ...]
    pixels: np.ndarray
    cells: np.ndarray
    weights: np.ndarray
    tints: np.ndarray
    origins: np.ndarray
    directions: np.ndarray


def build_screen(
    glass: Glass,
    view: Viewpoint,
    regions: Regions,
    *,
    fresnel: bool,
    numbers: tuple[int, ...],
    finest: float = 1.0 / FINEST,
) -> Screen:
    """The rays of the regions' paths over their rectangle.

    Parameters
    ----------
    numbers : of the paths that are wanted. finest : pixels a side of the smallest cells.
    """
    chosen = list(numbers)
    regions = replace(
        regions,
        paths=tuple(regions.paths[number] for number in chosen),
        weights=regions.weights[chosen],
        inside=regions.inside[chosen],
        shares=regions.shares[chosen],
    )
    samples = _Samples(glass, view, regions, fresnel)
    cells = np.concatenate([*_split(samples, regions, view, round(finest * FINEST))])
    corners, index = np.unique(_key(cells), return_inverse=True)
    cells = index.reshape(-1, 4)
    weights, hit, taken, origins, directions = samples.at(corners)
    tints = np.ones_like(origins)
    for number, path in enumerate(regions.paths):
        on = taken[number]
        if glass.tints(path):
            tints[number, on] = samples.transmittance(path, corners[on])
        rays = np.concatenate((origins[number], directions[number], tints[number]), axis=1)
        _spread(rays, on.copy(), cells)
        origins[number], directions[number], tints[number] = np.split(rays, 3, axis=1)
    parts = samples.shared(weights).T.copy()
    _spread(parts, hit.copy(), cells)
    return Screen(numbers, samples.pixels(corners), cells, parts.T, tints, origins, directions)


_STRIDE = 1 << 20


def _key(lattice: np.ndarray) -> np.ndarray:
    """One whole number for each lattice point (..., 2)."""
    return lattice[..., 1] * _STRIDE + lattice[..., 0]


class _Samples:
    """What the rays through lattice points do, each computed once.

    Lattice points are ``FINEST`` to a pixel, counted from the rectangle's lower left corner.
    """

    def __init__(self, glass: Glass, view: Viewpoint, regions: Regions, fresnel: bool) -> None:
        self._glass, self._view, self._paths = glass, view, regions.paths
        self._rays = PathRays(glass, view, regions.paths, fresnel)
        self.shared = self._rays.shared
        self._origin = np.array(regions.rect[:2]) - BEYOND
        self._keys = np.zeros(0, np.int64)
        count = len(self._paths)
        self._values = [
            np.zeros((count, 0)),
            np.zeros(0, bool),
            np.zeros((count, 0), bool),
            np.zeros((count, 0, 3)),
            np.zeros((count, 0, 3)),
        ]

    def pixels(self, keys: np.ndarray) -> np.ndarray:
        """(N, 2) places in the picture."""
        return np.column_stack((keys % _STRIDE, keys // _STRIDE)) / FINEST + self._origin

    def transmittance(self, path: Path, keys: np.ndarray) -> np.ndarray:
        """(N, 3) what the glass's media let through along a path that all these rays take."""
        return self._rays.transmittance(path, *self.pixels(keys).T)

    def at(self, keys: np.ndarray):
        """Weights (P, N), hit (N,), taken (P, N), origins and directions (P, N, 3)."""
        new = np.setdiff1d(keys, self._keys)
        if len(new):
            self._keys = np.concatenate((self._keys, new))
            order = np.argsort(self._keys)
            self._keys = self._keys[order]
            found = self._trace(*self.pixels(new).T)
            for number, (known, more) in enumerate(zip(self._values, found, strict=True)):
                axis = 0 if known.ndim == 1 else 1
                joined = np.concatenate((known, more), axis=axis)
                self._values[number] = np.take(joined, order, axis=axis)
        place = np.searchsorted(self._keys, keys)
        return [np.take(v, place, axis=0 if v.ndim == 1 else 1) for v in self._values]

    def _trace(self, x: np.ndarray, y: np.ndarray):
        weights, hit, taken = self._rays.weights(x, y)
        weights = np.where(taken, weights, 0.0)
        glass, view = self._glass, self._view
        starts, rays = view.rays_in(glass, x, y)
        starts = np.broadcast_to(starts, rays.shape)
        origins = np.zeros((*taken.shape, 3))
        directions = np.zeros((*taken.shape, 3))
        for number, path in enumerate(self._paths):
            if path.open:
                continue
            on = np.flatnonzero(taken[number])
            found = exits(glass, starts[on], rays[on], path)
            taken[number, on] = found.valid
            origins[number, on] = found.origin
            directions[number, on] = found.direction
        return weights, hit, taken, origins, directions


def _split(samples: _Samples, regions: Regions, view: Viewpoint, finest: int):
    """The cells' corners (C, 4, 2) on the lattice, size by size down to ``finest``."""
    x0, y0, x1, y1 = regions.rect
    named = any(may_lack_light(path) for path in regions.paths)
    counts = regions.weights > (FAINT if named else 0.0)
    border = border_pixels(np.concatenate((counts, regions.hit[None])))
    summed = np.pad(border.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    size = COARSEST * FINEST
    x, y = np.meshgrid(
        np.arange(0, (x1 - x0 + 2 * BEYOND) * FINEST, size),
        np.arange(0, (y1 - y0 + 2 * BEYOND) * FINEST, size),
    )
    low = np.column_stack((x.ravel(), y.ravel()))
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    while len(low):
        corners = low[:, None] + size * square
        if size <= finest:
            yield corners
            return
        middle = low + size // 2
        found = samples.at(np.concatenate((_key(corners).ravel(), _key(middle))))
        rough = _is_rough(found, len(low), view, named)
        if size > FINEST:
            rough |= _holds(summed, low // FINEST - BEYOND, size // FINEST)
        yield corners[~rough]
        half = size // 2
        low = (low[rough][:, None] + half * square).reshape(-1, 2)
        size = half


def _holds(summed: np.ndarray, low: np.ndarray, size: int) -> np.ndarray:
    """Whether any marked pixel lies in each square, from the marks' summed table."""
    height, width = summed.shape[0] - 1, summed.shape[1] - 1
    a, b = np.clip(low, 0, (width, height)).T
    c, d = np.clip(low + size, 0, (width, height)).T
    return summed[d, c] - summed[b, c] - summed[d, a] + summed[b, a] > 0


def _is_rough(found, count: int, view: Viewpoint, named: bool) -> np.ndarray:
    """Which cells must be split, from what the rays at their corners and middles do."""
    weights, hit, taken, origins, directions = found
    if named:
        taken = taken & (weights > FAINT)
    labels = np.concatenate((taken, hit[None]))
    around, middle = labels[:, : 4 * count].reshape(-1, count, 4), labels[:, 4 * count :]
    mixed = np.any(around != middle[..., None], axis=(0, 2))

    def gap(values: np.ndarray) -> np.ndarray:
        mean = values[:, : 4 * count].reshape(len(values), count, 4, -1).mean(axis=2)
        return np.linalg.norm(mean - values[:, 4 * count :].reshape(len(values), count, -1), axis=2)

    far = 1.0
    if not view.is_parallel:
        far = np.linalg.norm(origins[:, 4 * count :] - view.eye, axis=2)
        far = np.where(far > 0, far, 1.0)
    off = (gap(directions) + gap(origins) / far) * view.focal_px
    if view.is_parallel:
        off = gap(directions) * max(view.size) + gap(origins) * view.focal_px
    worst = (weights[:, 4 * count :] * off).max(axis=0, initial=0.0)
    uneven = gap(weights[..., None]) > (FAINT if named else WEIGHT_TOLERANCE)
    return mixed | (worst > TOLERANCE_PX) | uneven.any(axis=0)


def _spread(values: np.ndarray, known: np.ndarray, cells: np.ndarray) -> None:
    """Give vertices (V, K) near known ones the mean of those in their cells, in place."""
    for _ in range(_MARGIN):
        have = known[cells]
        mixed = have.any(axis=1) & ~have.all(axis=1)
        if not mixed.any():
            return
        part, have = cells[mixed], have[mixed]
        mean = np.einsum("ckv,ck->cv", values[part], have) / have.sum(axis=1)[:, None]
        cell, corner = np.nonzero(~have)
        vertex = part[cell, corner]
        total = np.zeros_like(values)
        times = np.zeros(len(values))
        np.add.at(total, vertex, mean[cell])
        np.add.at(times, vertex, 1.0)
        new = np.unique(vertex)
        values[new] = total[new] / times[new, None]
        known[new] = True
