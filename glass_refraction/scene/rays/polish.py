# SPDX-License-Identifier: GPL-3.0-or-later
"""What polished faces mirror: something else to an exit ray than to the view that shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...optics import reflect
from ...optics.vectors import dot
from .follow import Follower
from .hits import SKIN, Scene, Shown, Views, Ways

FAINT = 0.004
"""Part of a ray's light from which on what is mirrored is looked for."""
APART = 1e-5
"""Least 1 − cosine between way and sight: nearer ones see the same."""


def polished(scene: Scene, ways: Ways, shown: Shown) -> np.ndarray:
    """Numbers of the ways that meet polished faces, where a view shows these."""
    polish = np.array([look.polish is not None for look in scene.things.looks] + [False])
    return np.flatnonzero(polish[scene.things.surfaces(ways.triangle)] & (shown.view >= 0))


def amendments(
    scene: Scene, views: Views, follower: Follower, ways: Ways, shown: Shown
) -> tuple[tuple[np.ndarray, Ways], tuple[np.ndarray, Ways]]:
    """For ways to polished faces: what they see mirrored there, and what the view does.

    The view shows the face with its own mirror image: the difference of both images amends it.
    Reflectances by Schlick's approximation of Fresnel's equations (1994).

    Returns
    -------
    For either, numbers (L,) of the ways that these belong to, and the mirrored ways. Colours of
    the view's are negative: they are taken away.
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
    parts = [straight + (1.0 - straight) * (1.0 - np.abs(c[:, None])) ** 5 for c in cosines]
    worth = ways.weight * np.maximum(*(part.mean(axis=1) for part in parts))
    rows = np.flatnonzero((worth > FAINT) & (1.0 - dot(ways.direction.T, sight.T) > APART))
    normal, lift = normal[rows], SKIN * ways.distance[rows] * np.sign(cosines[0][rows])
    begin = np.tile(point[rows] - lift[:, None] * normal, (2, 1))
    mirrored = np.concatenate([reflect(along[rows], normal) for along in sights])
    found = follower.onward(begin, mirrored)

    def those(first: int, factor: np.ndarray) -> tuple[np.ndarray, Ways]:
        some = np.flatnonzero(found.ray // max(1, len(rows)) == first)
        owner = rows[found.ray[some] - first * len(rows)]
        ended, factor = found.take(some), factor[owner] * ways.colour[owner]
        return owner, replace(
            ended,
            path=ended.path | 1,
            weight=ended.weight * np.abs(factor).mean(axis=1),
            colour=ended.colour * factor,
        )

    return those(0, parts[0]), those(1, -parts[1])
