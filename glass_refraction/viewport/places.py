# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a 3D view shows glasses: themselves, and instances of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import bpy
import numpy as np

from ..scene.read.glasses import glass_objects, instances, named_glasses
from ..scene.read.modifier_inputs import glass_modifier, has_input, read_input

Key = tuple[int, int]
"""An object's session uid, and a number among the places of the same object."""


@dataclass(frozen=True, eq=False)
class Place:
    """An object where it is shown.

    Attributes
    ----------
    to_world : (4, 4) float64.
    host : what is selected with it: the object itself, or the one that shows the instance.
    number : 0 for the object itself, from 1 on for its instances.
    """

    obj: bpy.types.Object
    to_world: np.ndarray
    host: bpy.types.Object
    number: int = 0

    @property
    def key(self) -> Key:
        """What tells it from all others."""
        return self.obj.session_uid, self.number


def places(layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D) -> list[Place]:
    """The glasses that a view shows.

    To be called while it is drawn: all is evaluated then, see `instances`.
    """
    depsgraph = layer.depsgraph
    found = [
        _itself(obj, depsgraph)
        for obj in glass_objects(layer)
        if obj.visible_get(view_layer=layer, viewport=space)
    ]
    return found + _instances(layer, space, named_glasses(layer))


def profiles(
    layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D, found: list[Place]
) -> list[Place]:
    """The curves that are profiles of glasses, where they or instances of them stand."""
    curves: dict[int, bpy.types.Object] = {}
    for obj in {place.key[0]: place.obj for place in found}.values():
        modifier = glass_modifier(obj)
        # Older files' groups have none.
        profile = read_input(modifier, "Profile") if has_input(modifier, "Profile") else None
        if profile is not None:
            curves[profile.session_uid] = profile
    here = [_itself(obj, layer.depsgraph) for obj in curves.values() if obj.name in layer.objects]
    away = [obj for obj in curves.values() if obj.name not in layer.objects]
    return here + _instances(layer, space, away)


def _itself(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Place:
    return Place(obj, np.array(obj.evaluated_get(depsgraph).matrix_world, float), obj)


def _instances(
    layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D, objects: list[bpy.types.Object]
) -> list[Place]:
    """The places of instances of some objects; scenes of many instances are not walked for none."""
    if not objects:
        return []
    wanted = {obj.session_uid for obj in objects}
    found, count = [], Counter()
    for obj, instance in instances(layer.depsgraph):
        if obj.session_uid not in wanted:
            continue
        host = instance.parent
        if host is None or not host.original.visible_get(view_layer=layer, viewport=space):
            continue
        count[obj.session_uid] += 1
        to_world = np.array(instance.matrix_world, float)
        found.append(Place(obj, to_world, host.original, count[obj.session_uid]))
    return found
