# SPDX-License-Identifier: GPL-3.0-or-later
"""The light paths that a glass's picture is made of: chosen anew, or those that stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ... import optics
from ...optics.axial import AxialGlass
from ...optics.tumbler import GLASS
from ..build.layers import Layers, Pane, border_key
from ..memory import counters, memory_of
from ..names import RefractiveGlassError
from ..read.glasses import Glass, glass_objects, read_glass
from ..read.sources import seen_through, source_objects
from ..read.viewpoint import Viewpoint
from .hull import first_face
from .neighbours import among, with_chains
from .path_keys import path_of
from .regions import coarse_weights

BARE = 0.08
"""A path counts that carries this part of ``min_weight``, where rays show it and no copies."""
OUTWARD = {"outer", "base", "rim"}
"""Interfaces of cups beyond which lies nothing that these hold."""
DARK, MOST_FILLING = 0.01, 20
"""Part of the rays that may lack half of their light, and paths that are added for them, at most.
"""
OPEN = 0.8
"""An open path counts that carries this many times ``min_weight``."""
MOST_OPEN = 14
"""Open paths, at most."""
MOST_BARE = 50
"""Paths without copies, at most."""


def kept_paths(scene, glass: Glass, view: Viewpoint) -> tuple[optics.LightPath, ...]:
    """The paths that the glass's picture is made of: a mean weight of ``min_weight`` or more.

    ``optics.light_paths`` lists what carries that much for *some* ray; close to the verge light
    runs round in the wall along a dozen paths, each too thin to be seen. Raises
    RefractiveGlassError where the eye is inside the wall.
    """
    least = scene.refractive_glass.min_weight
    paths, weights = _listed(scene, glass, view)
    mean = weights.mean(axis=1)
    return tuple(p for p, share in zip(paths, mean, strict=True) if share >= least)


def thin_paths(scene, glass: Glass, view: Viewpoint) -> tuple[optics.LightPath, ...]:
    """Further paths of a cup, which rays show without copies: each fills a small part alone."""
    least = scene.refractive_glass.min_weight
    paths, weights = _listed(scene, glass, view)
    mean = weights.mean(axis=1)
    order = np.argsort(-mean, kind="stable")
    thick = [number for number in order if mean[number] >= least]
    thin = [number for number in order if BARE * least <= mean[number] < least][:MOST_BARE]
    if scene.refractive_glass.surface == "GLASS":
        thin += _filling(weights, thick + thin)
    return tuple(paths[number] for number in thin)


def open_paths(scene, glass: Glass, view: Viewpoint) -> tuple[optics.LightPath, ...]:
    """The beginnings of paths on whose last stretch a cup's contents are seen."""
    settings = scene.refractive_glass
    paths = optics.light_paths(
        glass.description, view.eye_for(glass), min_weight=settings.min_weight
    )
    begins = {
        optics.LightPath(path.events[:count], path.interfaces[:count], open=True): None
        for path in paths
        for count in range(1, len(path) + 1)
    }
    eye = view.eye_for(glass)
    medium = 0 if view.is_parallel else int(glass.description.medium_at(eye))
    begins = tuple(b for b in begins if _shows_contents(glass.description, medium, b))
    if settings.surface != "GLASS":
        begins = tuple(begin for begin in begins if "R" not in begin.events)
    mean = coarse_weights(scene, glass, view, begins).mean(axis=1)
    least = BARE * settings.min_weight
    if settings.surface == "GLASS":
        least = OPEN * settings.min_weight
    order = np.argsort(-mean, kind="stable")[:MOST_OPEN]
    return tuple(begins[number] for number in order if mean[number] >= least)


def _shows_contents(description: AxialGlass, medium: int, begin: optics.LightPath) -> bool:
    """Whether the last stretch of an open path may run through what a cup holds.

    ``medium``: that the eye is in.
    """
    for name, event in zip(begin.interfaces, begin.events, strict=True):
        medium = medium if event == "R" else description.named(name).beyond(medium)
    # From the outer wall and the underside rays leave the cup, or run on in the glass.
    return medium != GLASS and begin.interfaces[-1] not in OUTWARD


def _listed(scene, glass: Glass, view: Viewpoint):
    """The paths that carry enough for some ray, and their weights (P, M) over its pixels."""
    settings = scene.refractive_glass
    fresnel = settings.surface == "GLASS"
    stamp = (glass.stamp(), view.stamp(), settings.min_weight, fresnel)
    known = memory_of(scene).paths.get(glass.key)
    if known is not None and known[0] == stamp:
        return known[1:]
    counters["listed"] += 1
    first_face(glass, view.eye_for(glass))
    paths = optics.light_paths(
        glass.description, view.eye_for(glass), min_weight=settings.min_weight
    )
    if not fresnel:
        paths = tuple(path for path in paths if "R" not in path.events)
    weights = coarse_weights(scene, glass, view, paths)
    memory_of(scene).paths[glass.key] = (stamp, paths, weights)
    return paths, weights


def _filling(weights: np.ndarray, kept: list[int]) -> list[int]:
    """Further paths, for rays of whose light kept ones bring less than half."""
    added: list[int] = []
    brought = weights[kept].sum(axis=0)
    while len(added) < MOST_FILLING:
        dark = brought < 0.5
        if dark.mean() < DARK:
            break
        gain = weights[:, dark].sum(axis=1)
        gain[kept + added] = 0.0
        best = int(np.argmax(gain))
        if gain[best] == 0.0:
            break
        added.append(best)
        brought = brought + weights[best]
    return added


def standing_panes(scene, layers: Layers, depsgraph, problems) -> list[tuple[Pane, Glass]]:
    """The glasses and paths that the own scenes were made for, as they are evaluated now."""
    keys, by_rays = layers.path_keys(), layers.by_rays()
    read = []
    for obj in glass_objects(depsgraph.view_layer):
        try:
            read.append((obj, read_glass(obj, depsgraph)))
        except RefractiveGlassError as error:
            problems.append(str(error))
    glasses = [glass for _, glass in read]
    sources = source_objects(depsgraph.view_layer) if len(read) > 1 else []
    panes = []
    for obj, glass in read:
        bands = [banded.key for banded in glass.bands() if banded.key in keys]
        known = {key: [tuple(map(path_of, some)) for some in keys[key]] for key in bands}
        borders = [key for key in bands if border_key(key) in keys]
        if borders or any(
            isinstance(path, optics.ChainedPath) for paths, _ in known.values() for path in paths
        ):
            glass = among(glass, glasses, seen_through(obj, sources), depsgraph, [])
        # What has come to stand otherwise since is seen no more until all is made anew.
        there = {None, *(other.name for other in glass.others)}
        shown = []
        for banded in glass.bands():
            if banded.key not in known:
                continue
            paths, bare = known[banded.key]
            banded = with_chains(banded, paths)
            paths = tuple(path for path in paths if getattr(path, "behind", None) in there)
            rays = by_rays.get(banded.key, 0)
            pane = Pane(obj, paths, (), bare=frozenset(bare), band=banded.band, rays=rays)
            if banded.key in borders:
                key = border_key(banded.key)
                alone = tuple(path for path in map(path_of, keys[key][0]) if path in paths)
                shown.append((replace(pane, paths=alone, rays=by_rays[key], borders=True), banded))
                pane = replace(pane, bare=pane.bare.union(alone), has_borders=True)
            panes.append((pane, banded))
        panes += shown
    return panes
