# SPDX-License-Identifier: GPL-3.0-or-later
"""What polished faces mirror: something else to an exit ray than to the view that shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...optics import reflect
from ...optics.vectors import dot
from .follow import Follower
from .hits import SKIN, Scene, Shown, Views, Ways
from .mirrors import schlick

FAINT = 0.004
"""Part of a ray's light from which on what is mirrored is looked for."""
LEAST_MATTE = 0.25
"""Part of the light that is left for the matte part at least: what a view shows of it at grazing
incidence is noise."""
METAL = 0.2
"""Reflectance of what has no matte part."""
APART = 1e-5
"""Least 1 − cosine between way and sight: nearer ones see the same."""


def polished(scene: Scene, ways: Ways, shown: Shown) -> np.ndarray:
    """Numbers of the ways that meet polished faces, where a view shows these."""
    polish = np.array([look.polish is not None for look in scene.things.looks] + [False])
    return np.flatnonzero(polish[scene.things.surfaces(ways.triangle)] & (shown.view >= 0))


Mirrored = tuple[np.ndarray, Ways]
"""Numbers (L,) of the ways that mirrored ones belong to, and these."""


def amendments(
    scene: Scene, views: Views, follower: Follower, ways: Ways, shown: Shown
) -> tuple[np.ndarray, Mirrored, Mirrored]:
    """What makes the colour of polished faces that a view shows theirs as ways meet them.

    The colour that a view shows is m (1 − F) + F L: a matte part, dimmed by Fresnel's reflectance
    F, and the mirrored light L. F and L are others along the way.

    Returns
    -------
    matte : (K,) by what the view's colour is multiplied.
    seen, shown : what the ways see mirrored, and what the view does, whose colours are negative.
    """
    straight = np.array([look.polish or (0.0,) * 3 for look in scene.things.looks]).reshape(-1, 3)
    straight = straight[scene.things.surface[ways.triangle]]
    normal, point = scene.normals[ways.triangle], ways.point
    sight = np.empty_like(point)
    for number in np.unique(shown.view):
        here = np.flatnonzero(shown.view == number)
        sight[here] = views[number].sight(point[here])[1]
    sights = ways.direction, sight
    cosines = [dot(along.T, normal.T) for along in sights]
    parts = [schlick(straight, np.abs(cosine[:, None])) for cosine in cosines]
    worth = ways.weight * np.maximum(*(part.mean(axis=1) for part in parts))
    rows = np.flatnonzero((worth > FAINT) & (1.0 - dot(ways.direction.T, sight.T) > APART))
    normal, lift = normal[rows], SKIN * ways.distance[rows] * np.sign(cosines[0][rows])
    begin = np.tile(point[rows] - lift[:, None] * normal, (2, 1))
    mirrored = np.concatenate([reflect(along[rows], normal) for along in sights])
    found = follower.onward(begin, mirrored)

    matte = np.ones(len(ways))
    dull = rows[straight[rows].max(axis=1) < METAL]
    left = [np.maximum(1.0 - part[dull].mean(axis=1), LEAST_MATTE) for part in parts]
    matte[dull] = left[0] / left[1]

    def those(first: int, factor: np.ndarray) -> Mirrored:
        some = np.flatnonzero(found.ray // max(1, len(rows)) == first)
        owner = rows[found.ray[some] - first * len(rows)]
        ended, factor = found.take(some), factor[owner] * ways.colour[owner]
        return owner, replace(
            ended,
            path=ended.path | 1,
            weight=ended.weight * np.abs(factor).mean(axis=1),
            colour=ended.colour * factor,
        )

    return matte, those(0, parts[0]), those(1, -parts[1] * matte[:, None])
