# SPDX-License-Identifier: GPL-3.0-or-later
"""Suns that a picture's rays see through the glasses, as its pixel filter sees them."""

from __future__ import annotations

import numpy as np

from ...optics.vectors import dot, perpendiculars, rotated
from .columns import joined
from .exits import Neighbours, PictureRays, bell_means
from .follow import Follower, way_codes
from .hits import Ways
from .lamps import Sun
from .radiance import UNLIMITED, Clamp
from .views import squares

LARGE = 1.2
"""A sun's half angle, in the longest axis of a cone's bell, from which on places are looked at:
nearer ones would be missed between them."""
PLACES = 8
"""Along either axis of a cone, in which a large sun is looked for."""
FARTHEST = 5.5
"""Standard deviations of a bell beyond which nothing is left of it."""
LEAST_ANGLE = 1e-6
"""Radians: rounding of an angle between directions."""
LEAST_SPREAD = 1e-300
"""Keeps a quotient finite where neither cone nor sun has a size."""
WIDEST = 0.5
"""Radians beyond a sun's border within which it is looked for in a cone that no neighbour tells."""
MOST_PLACES = 2000
"""At about so many, at most, the light of a pixel is put in a disc."""
JUMP = 3.0
"""Times the difference to a neighbour on one side: so much larger, that on the other is an edge."""
BESIDE_PX = 0.1
"""From a pixel's centre to where a way is followed once more that no neighbour has."""


def sun_light(
    rays: PictureRays,
    beside: Neighbours,
    suns: tuple[Sun, ...],
    sigma: float,
    follower: Follower,
    clamp: Clamp = UNLIMITED,
) -> np.ndarray:
    """(K, 3) radiance of the suns along the ways of one ray a pixel, as the pixel filter sees it.

    A pixel's rays leave within a cone, which neighbouring pixels tell: their directions'
    differences, times the filter's standard deviation, are the axes of a Gauss bell. A sun that is
    smaller than the cone is a bell too, of its disc's second moments: what both have in common is
    what the pixel sees of it. In a larger one, places of the cone are looked at one by one.

    Of a way that is narrower than a pixel no neighbour tells. Where a sun may be in its cone, it is
    followed through places beside its pixel's centre; if it is not there either, next to nothing
    of the pixel sees the sun.
    """
    out = np.zeros((len(rays.ways), 3))
    sky = np.flatnonzero(rays.ways.is_sky)
    if not (len(sky) and suns):
        return out
    ways = rays.ways.take(sky)
    found = [slope(rays.ways.direction, beside, axis, sky) for axis in range(2)]
    slopes = [part for part, _ in found]
    light = _light(ways, suns, sigma, slopes, clamp)
    alone = np.stack([alone for _, alone in found], axis=1)
    near = np.any([_angle(ways, sun) < _half(sun) + WIDEST for sun in suns], axis=0)
    some = np.flatnonzero(near & alone.any(axis=1))
    if len(some):
        here, pixel = ways.take(some), rays.pixel[ways.ray[some]]
        followed = _followed_slopes(here, pixel, follower)
        slopes = [
            np.where(alone[some, axis, None], followed[axis], slopes[axis][some])
            for axis in range(2)
        ]
        light[some] = _light(here, suns, sigma, slopes, clamp)
    out[sky] = light
    return out


def out_of_focus(
    pixel: np.ndarray, light: np.ndarray, blur: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Light (n, 3) of pixels (n,) as a lens shows it, and the pixels that have it.

    Parameters
    ----------
    blur : (height, width) radius, pixels, of the disc as which each pixel's light is seen. What
        falls beside the frame is left out.
    """
    height, width = blur.shape
    radius = blur.ravel()[pixel]
    pixels, lights = [pixel[radius == 0.0]], [light[radius == 0.0]]
    for one in np.unique(radius[radius > 0.0]):
        some = np.flatnonzero(radius == one)
        step = max(1, int(one * np.sqrt(np.pi / MOST_PLACES)))
        steps = np.arange(-int(one), int(one) + 1, step)
        x, y = (part.ravel() for part in np.meshgrid(steps, steps))
        x, y = (part[x * x + y * y <= one * one] for part in (x, y))
        row, column = np.divmod(pixel[some, None], width)
        row, column = row + y, column + x
        there = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        which, _ = np.nonzero(there)
        pixels.append((row * width + column)[there])
        lights.append(light[some[which]] / len(x))
    return np.concatenate(pixels), np.concatenate(lights)


def _light(
    ways: Ways, suns: tuple[Sun, ...], sigma: float, slopes: list[np.ndarray], clamp: Clamp
) -> np.ndarray:
    """(n, 3) radiance of the suns along ways, from how their directions differ (n, 3) a pixel along
    either axis; where that is infinite there is none."""
    out = np.zeros((len(ways), 3))
    slopes = [sigma * part for part in slopes]
    longest = np.maximum(*(np.linalg.norm(part, axis=1) for part in slopes))
    for sun in suns:
        half = _half(sun)
        is_near = _angle(ways, sun) < half + FARTHEST * longest + LEAST_ANGLE
        near = np.flatnonzero(is_near & np.isfinite(longest))
        large = half > LARGE * longest[near]
        for seen, some in ((_disc_in_cone, near[large]), (_bell_in_cone, near[~large])):
            if len(some):
                axes = [part[some] for part in slopes]
                here = ways.take(some)
                factor = np.take(sun.factors, here.path & 1)
                part = seen(sun, here.direction, *axes)
                out[some] += clamp.limited(factor[:, None] * sun.radiance, here, part)
    return out


def _angle(ways: Ways, sun: Sun) -> np.ndarray:
    """(n,) radians from ways' directions to a sun's middle."""
    return np.arccos(np.clip(dot(ways.direction.T, sun.towards), -1.0, 1.0))


def _half(sun: Sun) -> float:
    """Radians from a sun's middle to its border."""
    return float(np.arccos(np.clip(sun.cosine, -1.0, 1.0)))


def _followed_slopes(ways: Ways, pixel: np.ndarray, follower: Follower) -> list[np.ndarray]:
    """How directions of ways of some pixels (n,) differ (n, 3) a pixel along either axis, infinite
    where a way is on neither side of the centre."""
    places = BESIDE_PX * np.array(((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)))
    parts = list(follower.blocks([(np.unique(pixel), places)]))
    owner = [part.pixels[part.ways.ray // 4] * 4 + part.ways.ray % 4 for part in parts]
    beside = joined(Ways, (part.ways for part in parts))
    codes = way_codes(np.concatenate(owner), beside.path)
    order = np.argsort(codes, kind="stable")
    directions = []
    for place in range(4):
        wanted = way_codes(pixel * 4 + place, ways.path)
        at = np.searchsorted(codes, wanted, sorter=order)
        row = order[np.minimum(at, len(order) - 1)] if len(order) else np.zeros(len(ways), int)
        there = codes[row] == wanted if len(order) else np.zeros(len(ways), bool)
        found = np.full((len(ways), 3), np.nan)
        found[there] = beside.direction[row[there]]
        directions.append(found)
    slopes = []
    for low, high in (directions[:2], directions[2:]):
        steps = np.stack((high - ways.direction, ways.direction - low))
        is_known = np.isfinite(steps)
        count = is_known.sum(axis=0)
        total = np.where(is_known, steps, 0.0).sum(axis=0)
        found = total / (BESIDE_PX * np.maximum(count, 1))
        slopes.append(np.where(count > 0, found, np.inf))
    return slopes


def slope(
    values: np.ndarray, beside: Neighbours, axis: int, some: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Differences (n, 3) of values (K, 3) from one pixel to the next, 0 where there is no next, and
    where (n,) that is. Over an edge of the glass, where they jump, those on this side of it."""
    ahead, behind = beside.ahead[axis][some], beside.behind[axis][some]
    here = values.take(some, axis=0)
    up = values.take(np.where(ahead >= 0, ahead, some), axis=0) - here
    down = here - values.take(np.where(behind >= 0, behind, some), axis=0)
    long_up, long_down = squares(up), squares(down)
    takes_up = (ahead >= 0) & ((behind < 0) | (long_up <= JUMP**2 * long_down))
    takes_down = (behind >= 0) & ((ahead < 0) | (long_down <= JUMP**2 * long_up))
    count = takes_up.astype(float) + takes_down
    total = takes_up[:, None] * up + takes_down[:, None] * down
    return total / np.maximum(count, 1.0)[:, None], count == 0.0


def _bell_in_cone(sun: Sun, direction, first, second) -> np.ndarray:
    """(n,) what part of the light in a cone's middle a sun gives that is smaller than the cone.

    Parameters
    ----------
    direction, first, second : (n, 3) the cone's axis, and its bell's axes.
    """
    towards = np.array(sun.towards)
    frame = np.stack(perpendiculars(towards))
    ox, oy = rotated(frame, (towards - direction).T)
    (ax, ay), (bx, by) = (rotated(frame, axis.T) for axis in (first, second))
    square = max(1.0 - sun.cosine**2, 0.0)
    # A disc of radius r has the second moments r²/4.
    xx = ax * ax + bx * bx + 0.25 * square
    yy = ay * ay + by * by + 0.25 * square
    xy = ax * ay + bx * by
    determinant = np.maximum(xx * yy - xy * xy, LEAST_SPREAD)
    distance = (yy * ox * ox - 2.0 * xy * ox * oy + xx * oy * oy) / determinant
    return 0.5 * square * np.exp(-0.5 * distance) / np.sqrt(determinant)


def _disc_in_cone(sun: Sun, direction, first, second) -> np.ndarray:
    """(n,) what part of a cone lies in a sun that is not much smaller; arguments as above."""
    steps = bell_means(PLACES)
    inside = np.zeros(len(direction))
    for x in steps:
        for y in steps:
            place = direction + x * first + y * second
            inside += dot(place.T, sun.towards) > sun.cosine * np.linalg.norm(place, axis=1)
    return inside / PLACES**2
