# SPDX-License-Identifier: GPL-3.0-or-later
"""The light paths that a glass's picture is made of: chosen anew, or those that stand."""

from __future__ import annotations

from dataclasses import replace

from .. import optics
from .glasses import Glass, glass_objects, read_glass
from .hull import first_face
from .layers import Layers, Pane
from .memory import memory_of
from .names import RefractiveGlassError, own
from .regions import path_regions, picture_rect
from .viewpoint import Viewpoint

PATH_SEARCH_SIDE = 96
"""Rays across a glass, its shorter way, with which the paths' mean weights are found: a verge of a
hundredth of it is met by one of them, however few pixels the glass has in the picture."""


def kept_paths(scene, glass: Glass, view: Viewpoint) -> tuple[optics.LightPath, ...]:
    """The paths that the glass's picture is made of: a mean weight of ``min_weight`` or more.

    ``optics.light_paths`` lists what carries that much for *some* ray; close to the verge light
    runs round in the wall along a dozen paths, each too thin to be seen. Raises
    RefractiveGlassError where the eye is inside the wall.
    """
    settings = scene.refractive_glass
    fresnel = settings.surface == "GLASS"
    stamp = (glass.stamp(), view.stamp(), settings.min_weight, fresnel)
    known = memory_of(scene).paths.get(glass.name)
    if known is not None and known[0] == stamp:
        return known[1]
    first_face(glass, view.eye_for(glass))
    paths = optics.light_paths(
        glass.description, view.eye_for(glass), min_weight=settings.min_weight
    )
    x0, y0, x1, y1 = picture_rect(glass, view, margin=0)
    finer = PATH_SEARCH_SIDE / max(1, min(x1 - x0, y1 - y0))
    size = tuple(max(1, round(n * finer)) for n in view.size)
    coarse = replace(view, size=size, window=(0, 0, *size))
    found = path_regions(glass, coarse, paths, fresnel=fresnel, smooth=False)
    mean = found.weights[:, found.hit].sum(axis=1) / max(1, found.hit.sum())
    kept = tuple(p for p, share in zip(paths, mean, strict=True) if share >= settings.min_weight)
    memory_of(scene).paths[glass.name] = (stamp, kept)
    return kept


def standing_panes(scene, layers: Layers, depsgraph, problems) -> list[tuple[Pane, Glass]]:
    """The glasses and paths that the own scenes were made for, as they are evaluated now."""
    events: dict[str, list[str]] = {}
    for collection in layers.lookup.collection.children:
        if own(collection, "copies"):
            name = collection["refractive_glass_name"]
            events.setdefault(name, []).append(collection["refractive_glass_path"])
    panes = []
    for obj in glass_objects(depsgraph.view_layer):
        if obj.name not in events:
            continue
        try:
            glass = read_glass(obj, depsgraph)
        except RefractiveGlassError as error:
            problems.append(str(error))
            continue
        paths = tuple(optics.LightPath(e) for e in events[obj.name])
        panes.append((Pane(obj, paths, ()), glass))
    return panes
