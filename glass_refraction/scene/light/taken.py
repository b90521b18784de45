# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of a lamp that would come straight, and that glasses stand in the way of."""

from __future__ import annotations

import numpy as np

from ... import optics
from ..progress import check
from ..rays.follow import Follower
from .emitters import Emitter
from .landed import Grids

FINE_SIDE = 7
"""Places along either side of a lamp, of which a place in half shadow sees some only."""


def taken_light(
    emitter: Emitter,
    grids: Grids,
    follower: Follower,
    points: np.ndarray,
    normals: np.ndarray,
    skin: float,
) -> np.ndarray:
    """Irradiance (N,), over the lamp's power, that glasses keep off places that it would light.

    Parameters
    ----------
    follower : any of the lamp's, for its glasses and its caster.
    points, normals : (N, 3) world. skin : metres off a surface that it is looked from there.
    """
    places = grids.places
    total, seen = np.zeros(len(points)), np.zeros(len(points), np.intp)
    for number, place in enumerate(places):
        some = np.flatnonzero(grids.seen(number, points))
        light = _kept_off(emitter, follower, place, points[some], normals[some], skin)
        total[some] += light / len(places)
        seen[some] += light > 0.0
    # In half shadow more places are asked.
    half = np.flatnonzero((seen > 0) & (seen < len(places)))
    if len(half):
        fine = emitter.places(emitter.lattice(FINE_SIDE), grids.centre)
        parts = (
            _kept_off(emitter, follower, place, points[half], normals[half], skin)
            for place in fine
        )
        total[half] = sum(parts) / len(fine)
    return total


def _kept_off(emitter, follower, place, points, normals, skin: float) -> np.ndarray:
    """(N,) irradiance by one place of the lamp, where nothing but glass stands in between."""
    check()
    found = np.zeros(len(points))
    towards, distance, light = emitter.seen_from(points, place)
    light = light * np.einsum("nk,nk->n", towards, normals)
    lit = np.flatnonzero(light > 0.0)
    start, along = points[lit] + skin * normals[lit], np.array(towards[lit])
    if not len(lit):
        return found

    def lamp(origins: np.ndarray, _) -> tuple[np.ndarray, np.ndarray]:
        return np.linalg.norm(place - origins, axis=1), np.zeros(len(origins), np.intp)

    ends = optics.exit_rays(
        follower.bands[0][1],
        start,
        along,
        most_events=0,
        cast=None if emitter.is_sun else lamp,
        meet=follower.meshes.meet if follower.meshes else None,
        between=check,
    )
    turned = np.flatnonzero(ends.lost > 0.0)
    way, _ = follower.caster.cast(start[turned], along[turned])
    open_ = turned[way >= distance[lit[turned]]]
    found[lit[open_]] = light[lit[open_]]
    return found
