# SPDX-License-Identifier: GPL-3.0-or-later
"""Which glasses are seen through or in which others, and along which paths."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import bpy
import numpy as np

from ... import optics
from ...optics.axial import AxialGlass
from ..memory import counters, memory_of
from ..read.glasses import Glass
from ..read.things import obstacle_of
from ..read.viewpoint import Viewpoint
from .regions import coarse_weights

MOST_CHAINED = 12
"""Paths through two glasses, of one nearer glass, at most."""
SLIVER = 0.3
"""Part of the glass's rays that count at least where the mean weight of a path with mirrors is."""


def among(
    glass: Glass,
    glasses: Iterable[Glass],
    sources: Sequence[bpy.types.Object],
    depsgraph: bpy.types.Depsgraph,
    problems: list[str],
) -> Glass:
    """The glass with the others that its rays may meet, and with what stands between.

    Parameters
    ----------
    sources : what may be seen through it.
    problems : takes a line for each glass that cannot be seen through this one.
    """
    others = []
    for other in glasses:
        if other.name == glass.name:
            continue
        reason = _why_not(glass, other)
        if reason:
            problems.append(
                f'Glass "{other.name}" is not seen through or in glass "{glass.name}": {reason}'
            )
        else:
            others.append(other)
    if not others:
        return glass
    box = np.concatenate([glass_box(each) for each in (glass, *others)])
    low, high = box.min(axis=0), box.max(axis=0)
    between = []
    for source in sources:
        obstacle = obstacle_of(source, depsgraph)
        if obstacle is not None and obstacle.overlaps(low, high):
            between.append(obstacle)
    return replace(glass, others=tuple(others), obstacles=tuple(between))


def _why_not(glass: Glass, other: Glass) -> str:
    """Why no path goes on from one glass to the other; empty where paths do."""
    if not _stands_in_air(glass):
        return f'what is behind "{glass.name}" is not air'
    for outer, inner in ((glass, other), (other, glass)):
        if outer.holds(glass_box(inner).mean(axis=0, keepdims=True))[0]:
            return f'"{inner.name}" stands in "{outer.name}"'
    return ""


def _stands_in_air(glass: Glass) -> bool:
    media = glass.description.media
    return media[0] == 1.0 and (
        not isinstance(glass.description, optics.FlatGlass) or media[-1] == 1.0
    )


def glass_box(glass: Glass) -> np.ndarray:
    """The corners (8, 3) of a box round a glass, in the world."""
    description = glass.description
    if isinstance(description, optics.FlatGlass):
        outline = np.asarray(description.outline)
        low = (*outline.min(axis=0), -sum(description.thickness))
        high = (*outline.max(axis=0), 0.0)
    elif isinstance(description, AxialGlass):
        radius, bottom, top = (part * description.scale for part in description.hull)
        low, high = (-radius, -radius, bottom), (radius, radius, top)
    else:
        radius = description.radius[0]
        bottom, top = getattr(description, "extent", None) or (-radius, radius)
        low, high = (-radius, -radius, bottom), (radius, radius, top)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    return glass.points_to_world(corners)


def chained_paths(
    scene: bpy.types.Scene,
    glass: Glass,
    view: Viewpoint,
    kept: Mapping[str, Sequence[optics.LightPath]],
) -> tuple[optics.ChainedPath, ...]:
    """The paths through this glass and another one that carry enough to be shown.

    ``min_weight`` is asked of the mean over the rays that meet the other glass; of paths with a
    mirror, over no less than ``SLIVER`` of all rays.

    Parameters
    ----------
    glass : as :func:`among` returns it. kept : the paths of each glass alone, by name.
    """
    candidates = tuple(
        optics.ChainedPath(first, second, other.name)
        for first, other in product(kept[glass.name], glass.others)
        for second in kept.get(other.name, ())
    )
    if not candidates:
        return ()
    settings, memory = scene.refractive_glass, memory_of(scene)
    stamp = (glass.seen_stamp(), view.stamp(), settings.min_weight, settings.surface, candidates)
    known = memory.chains.get(glass.key)
    if known is None or known[0] != stamp:
        counters["listed"] += 1
        known = memory.chains[glass.key] = (stamp, _carrying(scene, glass, view, candidates))
    return known[1]


def _carrying(
    scene: bpy.types.Scene, glass: Glass, view: Viewpoint, candidates: tuple
) -> tuple[optics.ChainedPath, ...]:
    """Those of the candidates that :func:`chained_paths` keeps."""
    weights = coarse_weights(scene, with_chains(glass, candidates), view, candidates)
    arrives: dict[tuple, np.ndarray] = {}
    for path, weight in zip(candidates, weights, strict=True):
        key = (path.first, path.behind)
        arrives[key] = arrives.get(key, 0.0) + weight
    least = scene.refractive_glass.min_weight
    found = []
    for path, weight in zip(candidates, weights, strict=True):
        rays = np.count_nonzero(arrives[path.first, path.behind] > 0.0)
        total = weight.sum()
        if "R" in path.events:
            # Mirrored in a sliver, who would see it?
            rays = max(rays, SLIVER * len(weight))
        if total > 0.0 and total >= least * rays:
            found.append((-total, len(found), path))
    return tuple(path for _, _, path in sorted(found)[:MOST_CHAINED])


def with_chains(glass: Glass, paths: Iterable) -> Glass:
    """The glass, knowing beyond which of its paths others are shown."""
    chained = {(p.first, p.behind) for p in paths if isinstance(p, optics.ChainedPath)}
    return replace(glass, chained=frozenset(chained))
