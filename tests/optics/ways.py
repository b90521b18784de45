# SPDX-License-Identifier: GPL-3.0-or-later
"""All ways of rays through one glass, with the paths' names: what exit rays are held against."""

from dataclasses import dataclass

import numpy as np

from glass_refraction.optics import axial
from glass_refraction.optics.exit_rays import PLAIN, STRONG
from glass_refraction.optics.facets import ENDLESS


@dataclass
class Ways:
    """One way a row: number of the ray, of the path in `paths`, share of the light, the ray after
    the last event (K, 3), and lengths (K, media) in each medium after the first event."""

    ray: np.ndarray
    path: np.ndarray
    paths: tuple
    weight: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    lengths: np.ndarray


def ways(body, eye, directions, min_weight=0.005, fresnel=True):
    """Ways that carry enough of the light, by the tracer of light paths (`axial.follow`)."""
    directions = np.atleast_2d(np.asarray(directions, float))

    def onward(steps, weight):
        if not fresnel:
            return None if steps[-1][1] == "R" else np.ones(len(weight), bool)
        if len(steps) >= ENDLESS:
            return None
        least = min_weight * max(1.0, len(steps) / PLAIN)
        return weight > min(least, max(min_weight, STRONG))

    paths, rows = {}, []
    for group in axial.follow(body, axial.start(body, eye, directions), onward):
        count = len(group.index)
        lengths = np.zeros((count, len(body.media)))
        for medium, way in group.trail[1:]:
            lengths[:, medium] += way * body.scale
        momentum = np.stack(group.rays.momentum, axis=-1)
        rows.append(
            (
                group.index,
                np.full(count, paths.setdefault(group.steps, len(paths))),
                group.weight if fresnel else np.ones(count),
                np.stack(group.rays.place, axis=-1) * body.scale,
                momentum / np.linalg.norm(momentum, axis=-1, keepdims=True),
                lengths,
            )
        )
    ray, path, *rest = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Ways(ray, path, tuple(axial.path_of(steps) for steps in paths), *rest)
