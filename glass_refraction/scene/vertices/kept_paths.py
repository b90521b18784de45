# SPDX-License-Identifier: GPL-3.0-or-later
"""The light paths that a glass's picture is made of, and how many slots it has for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Hashable
from functools import partial

import bpy

from ... import optics
from ...optics.axial import AxialGlass
from ...optics.tumbler import GLASS
from ..memory import counters, memory_of
from ..read.glasses import Glass
from ..read.viewpoint import Viewpoint
from ..steps import Step, Work
from .hull import first_face
from .regions import mean_weights

SLOTS = {
    ("GLASS", False): 10,
    ("REFRACTION", False): 4,
    ("GLASS", True): 18,
    ("REFRACTION", True): 8,
}
"""(surface, whether the shape's paths name their interfaces) -> slots of a glass.

Most paths of ``COMMON_WEIGHT`` were 8, 1, 16 and 4, of fifteen eyes round every shape."""
OPEN_SLOTS = 6
"""More of them, for open paths of shapes that name their interfaces: as many were seen at most."""
OUTWARD = {"outer", "base", "rim"}
"""Interfaces of cups beyond which lies nothing that these hold."""
COMMON_WEIGHT = 0.01
"""The ``min_weight`` for which ``SLOTS`` are enough."""
MOST_SLOTS = 32
"""Each slot is a view layer: with more of them Blender takes longer to list than to render."""


def slot_count(scene: bpy.types.Scene, *, named: bool) -> int:
    """How many light paths of one glass a frame may show.

    A path's light falls with each mirror by about the same factor, and the number of paths grows
    with the number of mirrors: half of the weight asks for a fixed number more of them.

    Parameters
    ----------
    named : the shape's paths name their interfaces; there are dozens.
    """
    settings = scene.refractive_glass
    count = SLOTS[settings.surface, named]
    if settings.surface == "GLASS" and settings.min_weight < COMMON_WEIGHT:
        halvings = math.log2(COMMON_WEIGHT / settings.min_weight)
        count += math.ceil(halvings * SLOTS["REFRACTION", named] / 2)
    return min(count, MOST_SLOTS)


Paths = tuple[optics.LightPath, ...]
InSteps = Callable[[Hashable, str, Work], Generator[Step, None, Paths]]
"""Does long work, and steps while it goes on."""


def kept_paths(
    scene: bpy.types.Scene, glass: Glass, view: Viewpoint, apart: InSteps
) -> Generator[Step, None, Paths]:
    """The paths with a mean weight of ``min_weight`` or more, the brightest first.

    ``optics.light_paths`` lists what carries that much for *some* ray; close to the verge light
    runs round in the wall along a dozen paths, each too thin to be seen. Raises
    RefractiveGlassError where the eye is inside the wall.
    """
    return _remembered(scene, glass, view, bright_paths, apart)


def _remembered(scene, glass: Glass, view: Viewpoint, find, apart: InSteps):
    """What the scene's memory holds of a kind of paths; found first where it holds none."""
    settings, paths = scene.refractive_glass, memory_of(scene).paths
    asked = (settings.min_weight, settings.surface == "GLASS")
    key, stamp = (glass.key, find), (glass.stamp(), view.stamp(), *asked)
    known = paths.get(key)
    if known is None or known[0] != stamp:
        counters["listed"] += 1
        found = yield from apart(key, "paths", partial(find, glass, view, *asked))
        known = paths[key] = (stamp, found)
    return known[1]


def bright_paths(glass: Glass, view: Viewpoint, min_weight: float, fresnel: bool) -> Paths:
    """What :func:`kept_paths` remembers, of no data of Blender's."""
    eye = view.eye_for(glass)
    first_face(glass, eye)
    paths = optics.light_paths(glass.description, eye, min_weight=min_weight)
    if not fresnel:
        paths = tuple(path for path in paths if "R" not in path.events)
    return _brightest(glass, view, paths, min_weight, fresnel)


def _brightest(glass, view, paths, min_weight, fresnel, most=None) -> Paths:
    """Those of a mean weight of at least so much, the brightest first."""
    mean = mean_weights(glass, view, paths, fresnel=fresnel)
    order = sorted(range(len(paths)), key=lambda number: -mean[number])[:most]
    return tuple(paths[number] for number in order if mean[number] >= min_weight)


def open_paths(
    scene: bpy.types.Scene, glass: Glass, view: Viewpoint, apart: InSteps
) -> Generator[Step, None, Paths]:
    """The beginnings of paths on whose last stretch a cup's contents are seen, the brightest first.

    They show contents to the light that no kept path carries on: it is lost in the wall or the
    base, or runs along paths that are too thin each to be kept.
    """
    return _remembered(scene, glass, view, _bright_begins, apart)


def _bright_begins(glass: Glass, view: Viewpoint, min_weight: float, fresnel: bool) -> Paths:
    eye = view.eye_for(glass)
    paths = optics.light_paths(glass.description, eye, min_weight=min_weight)
    begins = dict.fromkeys(
        optics.LightPath(path.events[:count], path.interfaces[:count], open=True)
        for path in paths
        for count in range(1, len(path) + 1)
    )
    medium = 0 if view.is_parallel else int(glass.description.medium_at(eye))
    begins = tuple(b for b in begins if _shows_contents(glass.description, medium, b))
    if not fresnel:
        begins = tuple(begin for begin in begins if "R" not in begin.events)
    return _brightest(glass, view, begins, min_weight, fresnel, OPEN_SLOTS)


def _shows_contents(description: AxialGlass, medium: int, begin: optics.LightPath) -> bool:
    """Whether the last stretch of an open path may run through what a cup holds.

    ``medium``: that the eye is in.
    """
    for name, event in zip(begin.interfaces, begin.events, strict=True):
        medium = medium if event == "R" else description.named(name).beyond(medium)
    # From the outer wall and the underside rays leave the cup, or run on in the glass.
    return medium != GLASS and begin.interfaces[-1] not in OUTWARD
