# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that is known without a view: lamps, a sky of one colour, and what no view shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...optics.vectors import LEAST
from .columns import Columns
from .hits import GOLDEN, KNOWN, SKIN, UNSEEN, Scene, Shown, Ways, judged
from .sky import Sky
from .things import Things

COMPARED = 400
"""Hits of one surface among which the nearest is looked for, for one that no view shows."""
OPENINGS = 8
"""Rays that tell how open a place is to light."""
HALF_OPEN = 4.0
"""Sizes of a surface, from where half the light is taken to come."""
LEAST_OPEN = 0.05
"""Of a place that a view shows: it is lit."""
BLOCK = 256
"""Hits compared at a time: their distances stay in the processor's cache."""


@dataclass(frozen=True)
class Clamp:
    """Most light of one sample, as the user's engine has it: the mean of red, green and blue.

    An engine follows one way of a sample and finds the light undimmed by Fresnel's laws: a sun's
    image in a glass is in few samples, and as bright as the sun. So it is the light along a whole
    way that is limited, not what the way brings to a pixel.

    Attributes
    ----------
    direct : of ways with one event, such as a lamp's mirror image. indirect : of all others.
        0: no limit.
    """

    direct: float = 0.0
    indirect: float = 0.0

    def limited(self, radiance: ArrayLike, ways: Ways, part: ArrayLike = 1.0) -> np.ndarray:
        """Light (K, 3) of radiances (3,) or (K, 3) along ways, of which none is above its limit.

        ``part``: (K,) of a way's light that is of that radiance. Behind a sharp surface few samples
        find a small lamp and many do not. A rough one gathers it in each sample, by its part.
        """
        light = np.broadcast_to(np.asarray(radiance, float), (len(ways), 3))
        tint = ways.colour / np.where(ways.weight > 0.0, ways.weight, 1.0)[:, None]
        most = self.most(ways)
        found = np.abs(light * tint).mean(axis=1) * np.where(ways.rough, part, 1.0)
        return light * (part * most / np.maximum(found, most))[:, None]

    def most(self, ways: Ways) -> np.ndarray:
        """(K,) most light along each way."""
        direct, indirect = (limit or NO_LIMIT for limit in (self.direct, self.indirect))
        return np.where(ways.events > 1, indirect, direct)


NO_LIMIT = 1e30
"""More than any light."""
UNLIMITED = Clamp()


def known_light(things: Things, normals: np.ndarray, sky: Sky, ways: Ways) -> np.ndarray:
    """(K, 3) radiance of ways whose light is known without a view."""
    out = np.zeros((len(ways), 3))
    if sky.radiance is not None:
        out[ways.is_sky & ~sky.is_clear(ways)] = sky.radiance
    some = np.flatnonzero(~ways.is_sky)
    triangle = ways.triangle[some]
    surface = things.surface[triangle]
    radiance = np.array([look.radiance for look in things.looks]).reshape(-1, 3)
    out[some] = radiance[surface]
    for number in np.unique(surface):
        here = np.flatnonzero(surface == number)
        look, rows = things.looks[number], some[here]
        part = look.lights(normals[triangle[here]], ways.direction[rows])
        out[rows] *= (part * np.take(look.factors, ways.path[rows] & 1))[:, None]
    return out


@dataclass(eq=False)
class Lookups(Columns):
    """What is left of ways when it is known what shows their hits.

    Attributes
    ----------
    pixel : (K,) its number in the picture. share : (K,) part of it that the way's ray stands for.
    weight : (K,) part of the pixel's light. colour : (K, 3) of the ray's light, with tints.
    most : (K,) light that it brings to its pixel at most, tints counted: see `Clamp`.
    view, place : (K,) number of the view or `UNSEEN` or `KNOWN`, and pixels (K, 2) there.
    triangle : (K,) of the things that is met, −1: the sky.
    at : (K, 3) where that is; in the sky the direction.
    side : (K,) 1 or -1 for the side of the triangle that is met, 0 in the sky.
    clear : (K,) which show a hole of the film.
    light : (n, 3) radiance of those ways only that are known, in their order.
    """

    pixel: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    colour: np.ndarray
    most: np.ndarray
    view: np.ndarray
    place: np.ndarray
    triangle: np.ndarray
    at: np.ndarray
    side: np.ndarray
    clear: np.ndarray
    light: np.ndarray

    @staticmethod
    def of(
        scene: Scene, ways: Ways, shown: Shown, pixel: np.ndarray, share: np.ndarray, clamp: Clamp
    ) -> Lookups:
        """Those of ways, whose pixels (K,) and shares (K,) of these are given."""
        known = ways.take(np.flatnonzero(shown.view == KNOWN))
        light = known_light(scene.things, scene.normals, scene.sky, known)
        return Lookups(
            pixel.astype(np.int32),
            share,
            ways.weight * share,
            ways.colour,
            (clamp.most(ways) * ways.weight * share).astype(np.float32),
            shown.view,
            shown.pixels,
            ways.triangle,
            _where(ways),
            scene.side(ways),
            scene.is_clear(ways),
            clamp.limited(light, known),
        )


def _where(ways: Ways) -> np.ndarray:
    """(K, 3) where ways end; of those in the sky the direction."""
    found, sky = ways.point, np.flatnonzero(ways.is_sky)
    found[sky] = ways.direction.take(sky, axis=0)
    return found


def stand_ins(scene: Scene, lookups: Lookups) -> tuple[np.ndarray, np.ndarray]:
    """For hits that no view shows: the nearest hit of the same surface that one shows.

    Where a surface is turned otherwise it is lit otherwise: a face that is turned by one radian
    counts as though it were as far away as the surface is large there. Where it is less open to
    light, as under a thing, it is darker in proportion; what gives light itself is not.

    Its view and place are written into the lookups; where there is none, `KNOWN`. Returns the
    numbers (n,) of all such hits, and radiances (n, 3) for those that have not even that: their
    surface's own light, and its colour under a mean light of 1/2; 0 of the others.
    """
    view, place, things = lookups.view, lookups.place, scene.things
    surface = things.surfaces(lookups.triangle)
    lacking, viewed = np.flatnonzero(view == UNSEEN), view >= 0
    light = np.zeros((len(lacking), 3))
    lit: list[tuple[np.ndarray, np.ndarray, float]] = []
    for number in np.unique(surface[lacking]):
        which = np.flatnonzero(surface[lacking] == number)
        here = lacking[which]
        seen = np.flatnonzero((surface == number) & viewed)
        if not len(seen):
            if number >= 0:
                look = things.looks[number]
                light[which] = np.array(look.radiance) + 0.5 * np.array(look.albedo)
            view[here] = KNOWN
            continue
        seen = seen[judged(len(seen), COMPARED)]
        both = [lookups.at[seen], lookups.at[here]]
        size = 0.0
        if number >= 0:
            size = np.sqrt(both[0].var(axis=0).sum())
            both = [
                np.concatenate((at, size * _facing(scene, lookups, rows)), axis=1)
                for at, rows in zip(both, (seen, here), strict=True)
            ]
        nearest = np.empty_like(here)
        for start in range(0, len(here), BLOCK):
            part = slice(start, start + BLOCK)
            pairs = zip(both[0].T, both[1][part].T, strict=True)
            apart = sum((asked[:, None] - known) ** 2 for known, asked in pairs)
            nearest[part] = seen[apart.argmin(axis=1)]
        view[here], place[here] = view[nearest], place[nearest]
        if size > 0.0 and not any(things.looks[number].radiance):
            lit.append((here, nearest, size))
    if lit:
        _darken(scene, lookups, lit)
    return lacking, light


def _facing(scene: Scene, lookups: Lookups, rows: np.ndarray) -> np.ndarray:
    """(K, 3) normals of what some lookups meet, on the side on which they do."""
    return lookups.side[rows, None] * scene.normals[lookups.triangle[rows]]


def _darken(scene: Scene, lookups: Lookups, lit: list[tuple[np.ndarray, np.ndarray, float]]):
    """Make hits that are less open to light than those that stand in for them darker.

    ``lit``: numbers of the hits, of those that stand in, and the size of each of their surfaces.
    """
    here, nearest = (np.concatenate(rows) for rows in list(zip(*lit, strict=True))[:2])
    size = np.repeat([size for *_, size in lit], [len(rows) for rows, *_ in lit])
    # One that stands in for many is asked once.
    stands, first, of = np.unique(nearest, return_index=True, return_inverse=True)
    rows = np.concatenate((here, stands))
    found = _openness(
        scene, lookups.at[rows], _facing(scene, lookups, rows), np.append(size, size[first])
    )
    there = np.maximum(found[len(here) :][of], LEAST_OPEN)
    lookups.colour[here] *= np.minimum(found[: len(here)] / there, 1.0)[:, None]


def _openness(
    scene: Scene, points: np.ndarray, normals: np.ndarray, size: np.ndarray
) -> np.ndarray:
    """(K,) how far points (K, 3) see on the side of unit normals (K, 3), from 0 to 1.

    ``size``: (K,) metres, of their surfaces.
    """
    across = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, across)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), LEAST)
    second = np.cross(normals, first)
    ways = []
    for number in range(OPENINGS):
        part, angle = (number + 0.5) / OPENINGS, 2.0 * np.pi * GOLDEN * number
        flat = np.sqrt(part) * np.array((np.cos(angle), np.sin(angle)))
        ways.append(flat[0] * first + flat[1] * second + np.sqrt(1.0 - part) * normals)
    origins = np.tile(points + SKIN * size[:, None] * normals, (OPENINGS, 1))
    distance, _ = scene.caster.cast(origins, np.concatenate(ways))
    half = HALF_OPEN * size
    return (1.0 - half / (half + distance.reshape(OPENINGS, -1))).mean(axis=0)
