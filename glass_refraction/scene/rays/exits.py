# SPDX-License-Identifier: GPL-3.0-or-later
"""Exit rays of a picture: one a pixel where ways are smooth, more where they end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from .columns import joined
from .follow import ENOUGH, SPREAD, Follower, way_codes
from .hits import TOGETHER, Shown, Ways

FINER = ((4, 0.05), (6, 0.2), (12, 0.6))
"""Rays of a pixel in which ways end, by the part of the light that ends there; see `_lattice`."""
FINER_IF_BLACK = ((4, 0.05), (6, 0.2), (28, 0.3))
"""The same where total reflection is black: edges are harder there, and each ray has one way. Also
for rough glass, of which each ray finds a few facets."""
FINER_OF_MESHES = ((4, 0.05), (12, 0.2))
"""The same where all glasses are meshes: their small curves mix many ways in a pixel, where closed
forms have straight edges of few ways."""
STEADY = 0.015
"""Part of a pixel's light: a way of which less ends is well shown by the pixel's centre."""
STEADY_PX = 1.5
"""Between the hits of neighbouring pixels, in a view's pixels: so far one ray a pixel is enough."""
END = 0.35
"""What light that ends counts: an outline is smooth with few rays."""
BRIGHTEST = 2.0
"""Light of a white pixel: what shines brighter counts no more where it ends, for all is white."""
STRETCH = 0.085
"""What each pixel beyond counts, times the way's part of the light, beside light that ends."""
MOST_STRETCHED_PX = 12.0
"""Beyond it stretches no more: a reflection that holds all the room is faint in every pixel."""
MOST_UNEVEN = 0.3
"""Of a way's light: from one pixel to the next it may change by so much where the centre's stands
for all of the pixel. Near total reflection it changes steeply."""
BLURRED = ((12, 1.5), (28, 4.0))
"""Rays of a pixel where a lens or motion blurs a glass, by the radius of the blur, pixels. Where it
is less, one point of the lens and one moment show it as well."""
MOST_BLURRED = 3_000_000
"""Such rays in one picture, of half a kilobyte each: pixels of large ones have fewer."""
FAINTER = 4.0
"""Times its own light: a way takes as many places as that asks for, its pixel's at most."""
FILTER_SIGMA = {"CYCLES": 0.278, "BLENDER_EEVEE": 0.281, "BLENDER_WORKBENCH": 1.0}
"""Of the engines' pixel filters as a Gauss bell, standard deviation over the filter's size: the
engines' own, whose window of Blackman and Harris is twice as wide, or `WORKBENCH_SIGMA`."""
WORKBENCH_SIGMA = {"OFF": 0.0, "FXAA": 0.35, "5": 0.38}
"""Pixels, by Workbench's anti-aliasing, as measured on an edge."""
WORKBENCH_MANY = 0.44
"""The same with more samples."""
LEAST_LIGHT = 1e-300
"""Keeps a quotient finite where there is none."""
MARGIN_PX = 2
"""Pixels round the glasses' outlines."""


def filter_sigma(engine: str, filter_size: float) -> float:
    """Standard deviation, pixels, of the engine's pixel filter; see `FILTER_SIGMA`."""
    return FILTER_SIGMA.get(engine, FILTER_SIGMA["CYCLES"]) * filter_size


@dataclass(frozen=True, eq=False)
class PictureRays:
    """Ways of a picture's rays.

    Attributes
    ----------
    pixel : (R,) number of each ray's pixel in the frame, row by row from the lower left.
    share : (R,) part of its pixel that a ray stands for.
    dark : (R,) part of a ray's light that stays in the glasses.
    ways : their ``ray`` counts these rays.
    """

    pixel: np.ndarray
    share: np.ndarray
    dark: np.ndarray
    ways: Ways


def grid(rects: list[tuple[int, int, int, int]], size: tuple[int, int]) -> np.ndarray:
    """Numbers (N,), rising, of the frame's pixels in any rectangle (x0, y0, x1, y1), half open."""
    width, height = size
    wanted = np.zeros((height, width), bool)
    for x0, y0, x1, y1 in rects:
        wanted[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = True
    return np.flatnonzero(wanted)


def centre_rays(pixels: np.ndarray, follower: Follower) -> PictureRays:
    """One ray through the centre of each pixel (N,); those that meet a glass have ways."""
    left: list[tuple[np.ndarray, np.ndarray]] = []

    def parts() -> Iterator[Ways]:
        first = 0
        for part in follower.blocks([(pixels, np.zeros((1, 2)))]):
            yield replace(part.ways, ray=part.ways.ray + np.int32(first))
            left.append((part.lost, part.dark))
            first += len(part.pixels)

    ways = joined(Ways, parts())
    lost, dark = map(np.concatenate, zip(*left, strict=True))
    # What was not followed goes with what was.
    brought = np.bincount(ways.ray, ways.weight, len(lost))
    factor = (brought + lost) / np.maximum(brought, ENOUGH)
    dark = dark + _left(brought + lost, brought * factor)
    return PictureRays(pixels, np.ones(len(pixels)), dark, ways.scaled(factor[ways.ray]))


def _left(wanted: np.ndarray, brought: np.ndarray) -> np.ndarray:
    """What is left of wanted light: too little was followed there to stand for all of it."""
    return np.maximum(wanted - brought, 0.0)


class FinerRays:
    """More rays in the pixels where ways end, spread as the pixel filter weighs places.

    Ways of a pixel's centre that do not end there stay, and those that carry little: only the
    others are followed through more places. Together they bring all the light that comes. Ways
    that stay and are stretched are looked up at several places, for which no ray is followed.

    Attributes
    ----------
    kept : (K',) numbers of the ways of `coarse` that stay, each as often as it is looked up.
    offset : (K', 2) pixels from its pixel's centre at which it is. share : (K',) of the pixel that
        it is seen in there. pixel : (R,) of its rays.
    rays : (width · height,) of each pixel.

    Parameters
    ----------
    coarse : one ray a pixel. ends : of its ways.
    blur : (width · height,) pixels, the radius by which lens and motion blur what is in each.
        Where it is too large for one point of the lens and one moment, rays come from all over the
        lens and all the time, and of the centre's ways only those that carry little stay.
    """

    def __init__(
        self,
        coarse: PictureRays,
        ends: Endings,
        sigma: float,
        follower: Follower,
        blur: np.ndarray,
    ) -> None:
        self._sigma, self._follower = sigma, follower
        self.pixel, self._dark = coarse.pixel, coarse.dark
        self._tiers = FINER_OF_MESHES if follower.only_meshes else FINER
        if follower.rough or not follower.fresnel:
            self._tiers = FINER_IF_BLACK
        pixel = coarse.pixel[coarse.ways.ray]
        most = ends.pixel.copy()
        np.maximum.at(most, pixel, ends.stretched)
        # What ends beside stretched ways takes as many rays as these take places.
        self._blurred = blur > BLURRED[0][1]
        self._rough = self._blurred | ((most > self._tiers[0][1]) & (ends.pixel > STEADY))
        self.rays = _places(np.where(self._rough, most, 0.0), self._tiers)
        self.rays[self._blurred] = blurred_places(blur[self._blurred])
        settled = (ends.way <= STEADY) & ~self._blurred[pixel]
        settled |= coarse.ways.weight < follower.fine_weight
        # The facets of rough glass differ from ray to ray: the centre's is one among all.
        settled |= follower.rough
        stay = np.flatnonzero(settled | ~self._rough[pixel])
        within = stay[self._rough[pixel[stay]] & (not follower.rough)]
        self._codes = np.sort(way_codes(pixel[within], coarse.ways.path[within]))
        own = ends.stretched[stay]
        own = np.where(own > STEADY, np.minimum(most[pixel[stay]], FAINTER * own), 0.0)
        count = _places(own, self._tiers)
        self.kept, self.share = np.repeat(stay, count), np.repeat(1.0 / count, count)
        self.offset = self._offsets(count)
        self._known = pixel[self.kept].astype(np.int32)
        if follower.rough:
            # The centre's ray is one more.
            self.share /= (self.rays + (self.rays > 1))[self._known]
        # Of no ways at all NumPy counts in whole numbers.
        light = self.share * coarse.ways.weight[self.kept]
        self._kept_light = np.bincount(self._known, light, len(most)).astype(float)
        self._brought = self._kept_light.copy()
        # What stays is left out where more rays are followed, and counts with what they lose.
        self._wanted = np.where(self._rough & (not follower.rough), 0.0, self._brought)
        self._stays, self._met = np.zeros(len(most)), np.zeros(len(most), bool)

    def _offsets(self, count: np.ndarray) -> np.ndarray:
        """(K', 2) pixels from the centre, of ways by how often they are looked up."""
        offset, first = np.zeros((count.sum(), 2)), np.cumsum(count) - count
        for many, _ in self._tiers:
            begin = first[count == many]
            offset[begin[:, None] + np.arange(many)] = self._sigma * _lattice(many)
        return offset

    def parts(self) -> Iterator[PictureRays]:
        """The further rays from the eye in bundles, as many of their ways together as are looked
        for together.

        Each block of pixels alone would mean more and smaller casts.
        """
        sets = []
        for count, _ in self._tiers:
            pixels = np.flatnonzero((self.rays == count) & ~self._blurred)
            sets.append((pixels, self._sigma * _lattice(count)))
        return self._bundles(self._follower, sets)

    def blurred_parts(self, follower: Follower, piece: TimePiece) -> Iterator[PictureRays]:
        """The same of rays from places all over the lens, of some of the time.

        ``follower``: has all where it stands then.
        """
        sets = []
        for count in LATTICE:
            pixels = np.flatnonzero((self.rays == count) & self._blurred)
            pixels = pixels[piece.has(pixels)]
            times = _times(count)
            rows = np.flatnonzero(piece.holds(times))
            if len(pixels) and len(rows):
                parts = self._sigma * _lattice(count), _square(count), times[:, None]
                sets.append((pixels, np.concatenate(parts, axis=1)[rows]))
        return self._bundles(follower, sets)

    def _bundles(
        self, follower: Follower, sets: list[tuple[np.ndarray, np.ndarray]]
    ) -> Iterator[PictureRays]:
        ready: list[PictureRays] = []
        for block in self._blocks(follower, sets):
            ready.append(block)
            if sum(len(part.ways) for part in ready) >= TOGETHER:
                yield together(ready)
                ready = []
        if ready:
            yield together(ready)

    def _blocks(
        self, follower: Follower, sets: list[tuple[np.ndarray, np.ndarray]]
    ) -> Iterator[PictureRays]:
        for some, places, ways, lost, dark in follower.blocks(sets, self._codes):
            count, all_rays = len(places), self.rays[some]
            one = 1.0 / (all_rays + follower.rough)
            light = np.bincount(ways.ray, ways.weight, len(lost))
            blank = np.flatnonzero(light + lost + dark == 0.0)
            light, left, dark = (
                one * p.reshape(-1, count).sum(axis=1) for p in (light, lost, dark)
            )
            self._stays[some] += dark
            self._brought[some] += light
            self._wanted[some] += light + left
            stay = count / all_rays * self._kept_light[some]
            factor = _factor(stay + light, stay * follower.rough + light + left)
            pixel, share = np.repeat(some, count), np.repeat(one, count)
            ways = ways.scaled(factor[ways.ray // count])
            if self._blurred[some].any():
                # The picture of such a pixel shows all the time what these see some of the time.
                met = np.ones(len(lost), bool)
                met[blank] = False
                self._met[some] |= met.reshape(-1, count).any(axis=1)
                others = follower.beside(some, places, blank)
            else:
                # The picture of such a pixel also shows what is behind the glass, unrefracted.
                others = follower.before(some, places, blank)
            ways = joined(Ways, (ways, others))
            yield PictureRays(pixel, share, np.zeros(len(lost)), ways)

    @property
    def factor(self) -> np.ndarray:
        """(K',) of the ways that stay, when all further rays are known."""
        return _factor(self._brought, self._wanted)[self._known]

    @property
    def unmet(self) -> np.ndarray:
        """(width · height,) blurred pixels of which no ray meets a glass: the picture has them."""
        return self._blurred & ~self._met

    @property
    def dark(self) -> np.ndarray:
        """(R,) what is dark in the pixels of `coarse` then."""
        factor = _factor(self._brought, self._wanted)
        dark = self._stays + _left(self._wanted, self._brought * factor)
        return np.where(self._rough[self.pixel], dark[self.pixel], self._dark)


def _factor(brought: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """By what pixels' ways that bring so much light are multiplied to bring all that is wanted."""
    return wanted / np.maximum(np.maximum(brought, ENOUGH * wanted), LEAST_LIGHT)


@dataclass(frozen=True)
class TimePiece:
    """Some of the time that the shutter is open, for some of the pixels.

    Pixels side by side take turns, so that there are as many moments as ``parts`` times ``turns``,
    of which each pixel has one in each part.
    """

    number: int = 0
    parts: int = 1
    turns: int = 1

    @property
    def middle(self) -> float:
        """Part of the time that has gone by in its middle."""
        return (self.number + 0.5) / (self.parts * self.turns)

    def has(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) which pixels' turn it is."""
        turn = (pixels * SPREAD[0] % 1.0 * self.turns).astype(int)
        return turn == self.number % self.turns

    def holds(self, times: np.ndarray) -> np.ndarray:
        """(P,) which times, from 0 to 1, are in its part."""
        return (times * self.parts).astype(int) == self.number // self.turns


def _places(value: np.ndarray, tiers: tuple[tuple[int, float], ...]) -> np.ndarray:
    """(N,) places in a pixel, by what asks for them (N,), as tiers tell; else one."""
    count = np.ones(len(value), np.int32)
    for many, least in tiers:
        count[value > least] = many
    return count


def blurred_places(blur: np.ndarray) -> np.ndarray:
    """(N,) rays of pixels, by the radii (N,) of their blur, pixels; in all as many as there may be,
    if not the least that pixels have."""
    count = _places(blur, BLURRED)
    for most in sorted(LATTICE, reverse=True):
        count = np.minimum(count, most)
        if count.sum() <= MOST_BLURRED:
            break
    return count


def together(parts: list[PictureRays]) -> PictureRays:
    """Rays of several blocks of pixels, numbered one after another."""
    starts = np.cumsum([0, *(len(part.pixel) for part in parts)], dtype=np.int32)
    numbered = zip(parts, starts[:-1], strict=True)
    return PictureRays(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("pixel", "share", "dark")),
        joined(Ways, (replace(part.ways, ray=part.ways.ray + first) for part, first in numbered)),
    )


def _lattice(count: int) -> np.ndarray:
    """Places (count, 2) that a pixel filter of standard deviation 1 weighs alike.

    No two share a row or a column: an edge along an axis is smoothed in as many steps as there are
    places. (Korobov's lattices; of 4 places: the rotated grid.)
    """
    first = np.arange(1, count + 1)
    steps = bell_means(count)
    return np.stack((steps, steps[first * LATTICE[count] % (count + 1) - 1]), axis=-1)


LATTICE = {4: 2, 6: 3, 12: 5, 28: 12}
"""Steps of the second coordinate; number of places and 1 is a prime."""


def _square(count: int) -> np.ndarray:
    """Places (count, 2) in a lens, see `Lens.places`, spread evenly, whatever their order: each has
    one opposite, so that what is blurred stays where it is."""
    half = np.arange(count // 2)[:, None] * SPREAD
    return np.stack((half, half + np.array((0.0, 0.5))), axis=1).reshape(-1, 2) % 1.0


def _times(count: int) -> np.ndarray:
    """(count,) times from 0 to 1, the middles of as many equal parts.

    They are in another order than the places of `_lattice` along either axis: else an edge that
    moves would look like one that is askew.
    """
    first = np.arange(1, count + 1)
    return (first * TIMES[count] % (count + 1) - 0.5) / count


TIMES = {4: 3, 6: 2, 12: 3, 28: 8}
"""Steps of the times, as of `LATTICE`."""


def bell_means(count: int) -> np.ndarray:
    """Means (count,) of as many equally likely parts of the standard normal distribution."""
    # The density at the parts' ends tells their means: ∫ x φ(x) dx = −φ(x).
    ends = np.array([_quantile(k / count) for k in range(count + 1)])
    density = np.exp(-0.5 * ends**2) / np.sqrt(2.0 * np.pi)
    return count * (density[:-1] - density[1:])


def _quantile(probability: float) -> float:
    """Quantile of the standard normal distribution."""
    if probability <= 0.0:
        return -np.inf
    return np.inf if probability >= 1.0 else NormalDist().inv_cdf(probability)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """For each way of one ray a pixel, the same way one pixel further.

    Attributes
    ----------
    pixel : (K,) the way's own pixel.
    ahead, behind : for x and for y, (K,) numbers of the ways, −1 where it ends there.
    inner : the same, whether there is a pixel at all.
    """

    pixel: np.ndarray
    ahead: tuple[np.ndarray, np.ndarray]
    behind: tuple[np.ndarray, np.ndarray]
    inner: tuple[tuple[np.ndarray, np.ndarray], ...]


def neighbours(rays: PictureRays, size: tuple[int, int]) -> Neighbours:
    """Which ways of neighbouring pixels run through the same interfaces."""
    width, height = size
    ways = rays.ways
    paths, path = np.unique(ways.path, return_inverse=True)
    pixel = rays.pixel[ways.ray]
    code = pixel.astype(np.int64) * len(paths) + path
    order = np.argsort(code, kind="stable")
    sorted_code = code[order]
    found: list[list[np.ndarray]] = []
    inner = []
    for axis, step in enumerate((1, width)):
        place = pixel % width if axis == 0 else pixel // width
        possible = place < (width, height)[axis] - 1, place > 0
        inner.append(possible)
        both = []
        for sign, there in zip((1, -1), possible, strict=True):
            wanted = code + sign * step * len(paths)
            at = np.minimum(np.searchsorted(sorted_code, wanted), max(len(code) - 1, 0))
            same = there & (sorted_code[at] == wanted) if len(code) else there
            both.append(np.where(same, order[at] if len(code) else 0, -1))
        found.append(both)
    (ahead_x, behind_x), (ahead_y, behind_y) = found
    return Neighbours(pixel, (ahead_x, ahead_y), (behind_x, behind_y), tuple(inner))


def spacing(ways: Ways, beside: Neighbours, rows: np.ndarray) -> np.ndarray:
    """(n,) metres from the hits of some ways, by their numbers (n,), to the nearest of the same
    ways in neighbouring pixels."""
    found, points = np.full(len(rows), np.inf), ways.points(rows)
    for partner in (*beside.ahead, *beside.behind):
        there = np.flatnonzero(partner[rows] >= 0)
        apart = points.take(there, axis=0) - ways.points(partner[rows[there]])
        found[there] = np.minimum(found[there], np.linalg.norm(apart, axis=1))
    return found


@dataclass(frozen=True, eq=False)
class Endings:
    """How much of the light of one ray a pixel ends or is stretched between pixels.

    Attributes
    ----------
    pixel : (width · height,) part of each pixel's light that ends, the most of any way.
    way : (K,) of each way.
    stretched : (K,) of each way that runs on to all pixels beside: these tell where it leads
        between them, so no further ray need. What else is stretched ends.
    """

    pixel: np.ndarray
    way: np.ndarray
    stretched: np.ndarray


def ending(
    rays: PictureRays,
    beside: Neighbours,
    shown: Shown,
    label: np.ndarray,
    size: tuple[int, int],
    radiance: np.ndarray | float = 1.0,
    shines: np.ndarray | None = None,
    small: np.ndarray | float = 0.0,
) -> Endings:
    """Where ways end.

    Parameters
    ----------
    rays : one ray a pixel. label : (K,) what their ways meet; where another begins, a way ends.
    radiance : (K,) of what they meet, as far as it is known to be brighter than white.
    shines : (K,) whether that shines, as `edges.shining_looks` has it; by default nothing does.
    small : (K,) radiance of what ways may pass by, see `small_lights`.
    """
    width, height = size
    ways, pixel = rays.ways, beside.pixel
    bright = np.maximum(ways.weight, np.minimum(ways.weight * radiance, BRIGHTEST))
    way, beyond = END * np.minimum(ways.weight * small, BRIGHTEST), np.zeros(width * height)
    x, y = np.ascontiguousarray(shown.pixels.T)
    stretched, runs_on = np.zeros(len(ways)), ~ways.rough & (way == 0.0)
    for axis, step in enumerate((1, width)):
        ahead, behind = beside.ahead[axis], beside.behind[axis]
        for sign, partner, there in zip((1, -1), (ahead, behind), beside.inner[axis], strict=True):
            ends = np.flatnonzero(there & (partner < 0))
            runs_on[ends] = False
            light = END * bright[ends]
            way[ends] = np.maximum(way[ends], light)
            np.maximum.at(beyond, pixel[ends] + sign * step, light)
        a = np.flatnonzero(ahead >= 0)
        b = ahead[a]
        weight = np.maximum(ways.weight[a], ways.weight[b])
        apart = np.sqrt((x[a] - x[b]) ** 2 + (y[a] - y[b]) ** 2)
        other_view, other = shown.view[a] != shown.view[b], label[a] != label[b]
        looked_up = ~other_view & (shown.view[a] >= 0)
        stretch = STRETCH * np.clip(apart - STEADY_PX, 0.0, MOST_STRETCHED_PX)
        # Elsewhere nothing has filtered what lies between the two. Beside what shines a view has,
        # but lookups keep off that.
        unfiltered = ~looked_up if shines is None else ~looked_up | shines[a] | shines[b]
        ended = np.maximum(bright[a], bright[b]) * (END * (unfiltered & (other_view | other)))
        stretch *= weight * looked_up
        uneven = np.abs(ways.weight[a] - ways.weight[b]) > MOST_UNEVEN * weight
        for some in (a, b):
            runs_on[some[other_view | other | uneven]] = False
            way[some] = np.maximum(way[some], ended)
            stretched[some] = np.maximum(stretched[some], stretch)
    way = np.maximum(way, np.where(runs_on, 0.0, stretched))
    np.maximum.at(beyond, pixel, way)
    if rays.dark.any():
        dark = np.zeros(width * height)
        dark[rays.pixel] = rays.dark
        dark, frame = dark.reshape(height, width), beyond.reshape(height, width)
        for one, other in (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]):
            light = END * np.abs(dark[one] - dark[other])
            for side in (one, other):
                np.maximum(frame[side], light, out=frame[side])
    return Endings(beyond, way, np.where(runs_on, stretched, 0.0))


def between(
    places: np.ndarray,
    beside: Neighbours,
    rows: np.ndarray,
    offset: np.ndarray,
    region: tuple[int, int, int, int],
) -> np.ndarray:
    """Places (n, 2) in views, of places between pixels, on a parabola through those of each way and
    of its neighbours.

    Parameters
    ----------
    places : (K, 2) of all ways. rows : (n,) numbers of some, equal ones side by side.
    offset : (n, 2) pixels from their pixels' centres.
    region : (x0, y0, x1, y1) that views draw: places stay within its outermost pixels' middles.
    """
    found = places.take(rows, axis=0)
    moved = np.flatnonzero((offset[:, 0] != 0.0) | (offset[:, 1] != 0.0))
    away = found.take(moved, axis=0)
    begins = np.diff(rows[moved], prepend=-1) != 0
    way, run = rows[moved[begins]], np.cumsum(begins) - 1
    here = places.take(way, axis=0)
    for axis in range(2):
        ahead, behind = (part[axis][way] for part in (beside.ahead, beside.behind))
        up = places.take(np.where(ahead < 0, way, ahead), axis=0) - here
        down = here - places.take(np.where(behind < 0, way, behind), axis=0)
        # At the picture's border there is but one neighbour, and a line through both.
        both = ((ahead >= 0) & (behind >= 0))[:, None]
        slope, bend = np.where(both, 0.5, 1.0) * (up + down), np.where(both, 0.5, 0.0) * (up - down)
        t = offset[moved, axis, None]
        away += t * (slope.take(run, axis=0) + t * bend.take(run, axis=0))
    for place, low, high in zip(away.T, region[:2], region[2:], strict=True):
        np.clip(place, low + 0.5, high - 0.5, out=place)
    found[moved] = away
    return found
