# SPDX-License-Identifier: GPL-3.0-or-later
"""Where what shines is so small that a picture's rays may pass on either side of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...optics.vectors import dot
from .exits import Neighbours
from .hits import Scene, Ways, blocks_of
from .suns import slope
from .things import Things

MOST = 48
"""Capsules of what shines: each asks all ways."""
FEW = 4
"""Triangles that are not divided any more."""
REACH = 0.75
"""Of a pixel, in which its finer rays lie."""
LEAST = 1e-12
"""Keeps a quotient finite where a way runs along a capsule."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """All within ``radius`` of an axis.

    Attributes
    ----------
    axis : (2, 3) where it begins and ends. radius : metres. look : number of what shines there.
    """

    axis: np.ndarray
    radius: float
    look: int

    @staticmethod
    def round_about(points: np.ndarray, look: int) -> Capsule:
        """One that holds points (n, 3), along the direction in which they lie apart most."""
        middle = points.mean(axis=0)
        away = points - middle
        along = np.linalg.eigh(np.einsum("nk,nl->kl", away, away))[1][:, 2]
        far = np.einsum("nk,k->n", away, along)
        radius = float(np.linalg.norm(away - far[:, None] * along, axis=1).max())
        low, high = far.min() + radius, far.max() - radius
        ends = np.array((low, high)) if low < high else np.full(2, 0.5 * (low + high))
        return Capsule(middle + ends[:, None] * along, radius, look)


def capsules(things: Things, shines: np.ndarray) -> list[Capsule]:
    """Those round what shines, `MOST` at most: the thickest are divided, as long as there is room.
    Lamps are round or flat, and stay whole.

    ``shines``: (L,) which looks do.
    """
    some = np.flatnonzero(shines[things.surface]) if shines.any() else np.zeros(0, int)
    surface = things.surface[some]
    parts = [some[surface == number] for number in np.unique(surface)[:MOST]]

    def held(part: np.ndarray) -> Capsule:
        points = things.points[things.triangles[part]].reshape(-1, 3)
        return Capsule.round_about(points, int(things.surface[part[0]]))

    found = [(held(part), part) for part in parts]
    while len(found) < MOST:
        thick = [
            0.0 if len(part) <= FEW or things.looks[one.look].is_lamp else one.radius
            for one, part in found
        ]
        widest = int(np.argmax(thick)) if thick else 0
        if not thick or thick[widest] == 0.0:
            break
        _, part = found.pop(widest)
        middles = things.points[things.triangles[part]].mean(axis=1)
        axis = int(np.ptp(middles, axis=0).argmax())
        order = part[np.argsort(middles[:, axis], kind="stable")]
        found += [(held(half), half) for half in np.array_split(order, 2)]
    return [one for one, _ in found]


def small_lights(scene: Scene, ways: Ways, beside: Neighbours, radiance: np.ndarray) -> np.ndarray:
    """(K,) radiance of what shines beside each way, so small that one ray a pixel may miss it.

    Neighbouring pixels tell how far apart their ways are where they pass something. What is
    thicker than that is met by the ways themselves.

    Parameters
    ----------
    radiance : (L + 1,) of surfaces.
    """
    found = np.zeros(len(ways))
    some = capsules(scene.things, scene.is_shining)
    for rows in blocks_of(len(ways) if some else 0):
        origin, direction = (p.take(rows, axis=0).T.copy() for p in (ways.origin, ways.direction))
        apart = [
            [slope(part, beside, axis, rows)[0].T.copy() for part in (ways.origin, ways.direction)]
            for axis in range(2)
        ]
        distance, brightest = ways.distance[rows], np.zeros(len(rows))
        for one in some:
            far, gap = _passed(one, origin, direction)
            wide = [start + far * turn for start, turn in apart]
            wide = [np.sqrt(dot(part, part)) for part in wide]
            spread = np.maximum(*wide)
            near = gap < one.radius + REACH * np.hypot(*wide)
            near &= (one.radius < spread) & (far > 0.0) & (far - spread < distance)
            brightest[near] = np.maximum(brightest[near], radiance[one.look])
        found[rows] = brightest
    return found


def _passed(
    one: Capsule, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far (K,) along ways, from (3, K) on, they pass a capsule's axis, and how near (K,)."""
    begin, end = one.axis
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / max(length, LEAST)
    to_begin = begin[:, None] - origin
    ahead, aside = dot(direction, to_begin), dot(to_begin, along)
    slant = dot(direction, along)
    place = (slant * ahead - aside) / np.maximum(1.0 - slant * slant, LEAST)
    place = np.clip(place, 0.0, length)
    far = ahead + place * slant
    gap = to_begin + place * along[:, None] - far * direction
    return far, np.sqrt(dot(gap, gap))
