# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that is known without a view: lamps, a sky of one colour, and what no view shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .hits import KNOWN, UNSEEN, Shown, Ways
from .sky import Sky
from .things import Things

COMPARED = 400
"""Hits of one surface among which the nearest is looked for, for one that no view shows."""
BLOCK = 4096
"""Hits compared at a time."""


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
        most = np.where(ways.events > 1, self.indirect, self.direct)
        found = (np.abs(light) * tint).mean(axis=1) * np.where(ways.rough, part, 1.0)
        over = (most > 0.0) & (found > most)
        return light * (part * np.where(over, most / np.where(over, found, 1.0), 1.0))[:, None]


UNLIMITED = Clamp()


def known_light(
    things: Things, normals: np.ndarray, sky: Sky, ways: Ways, shown: Shown
) -> np.ndarray:
    """(K, 3) radiance of ways whose light is known; 0 of the others."""
    out = np.zeros((len(ways), 3))
    known = shown.view == KNOWN
    is_sky = ways.is_sky
    if sky.radiance is not None:
        out[known & is_sky & ~sky.is_clear(ways)] = sky.radiance
    some = np.flatnonzero(known & ~is_sky)
    triangle = ways.triangle[some]
    surface = things.surface[triangle]
    radiance = np.array([look.radiance for look in things.looks]).reshape(-1, 3)
    faces = np.array([look.faces for look in things.looks], int)
    facing = np.einsum("nk,nk->n", normals[triangle], ways.direction[some]) < 0.0
    out[some] = radiance[surface] * (facing | (faces[surface] == 0))[:, None]
    return out


def stand_ins(things: Things, ways: Ways, shown: Shown) -> tuple[Shown, np.ndarray]:
    """For hits that no view shows: the nearest hit of the same surface that one shows.

    Returns what is shown by which view then, and the radiance (K, 3) of hits that have not even
    that: their surface's own light, and its colour under a mean light of 1/2.
    """
    view, pixels = shown.view.copy(), shown.pixels.copy()
    out = np.zeros((len(ways), 3))
    lacking = np.flatnonzero(shown.view == UNSEEN)
    if not len(lacking):
        return shown, out
    surface = things.surfaces(ways.triangle)
    # A place of a hit: the point, or in the sky the direction.
    place = np.where(ways.is_sky[:, None], ways.direction, ways.point)
    for number in np.unique(surface[lacking]):
        here = lacking[surface[lacking] == number]
        seen = np.flatnonzero((surface == number) & (shown.view >= 0))
        if not len(seen):
            if number >= 0:
                look = things.looks[number]
                out[here] = np.array(look.radiance) + 0.5 * np.array(look.albedo)
            view[here] = KNOWN
            continue
        seen = seen[:: max(1, len(seen) // COMPARED)]
        for start in range(0, len(here), BLOCK):
            part = here[start : start + BLOCK]
            apart = ((place[part, None] - place[None, seen]) ** 2).sum(axis=-1)
            nearest = seen[apart.argmin(axis=1)]
            view[part], pixels[part] = shown.view[nearest], shown.pixels[nearest]
    return Shown(view, pixels), out
