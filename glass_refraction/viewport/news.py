# SPDX-License-Identifier: GPL-3.0-or-later
"""What was evaluated anew since the last look, object by object.

A thing that moves need not have all glasses and things read again. Blender names the data-blocks
of an update; of objects, and of the data that only they use, it names the objects too.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import bpy

from ..scene.names import own

_OF_OBJECTS = (
    bpy.types.Object,
    bpy.types.Mesh,
    bpy.types.Curve,
    bpy.types.Camera,
    bpy.types.Light,
    bpy.types.Armature,
    bpy.types.Lattice,
    bpy.types.Key,
    bpy.types.Action,
)
"""Data-blocks whose change is that of objects, which are named beside them."""
_SHOWING = (
    bpy.types.Material,
    bpy.types.World,
    bpy.types.Light,
    bpy.types.Image,
    bpy.types.Texture,
)
"""Data-blocks whose change may be seen though nothing moves."""
_UNSEEN = {"CAMERA", "SPEAKER"}
"""Kinds of objects that no view shows: where one is, is no matter but to the view through it."""


@dataclass
class News:
    """Of one scene.

    Attributes
    ----------
    serial : grows with each evaluation. everything : the last one of which more than some objects
        changed. objects, shapes : by the session uid of an object, the last evaluation that changed
        it, and the last one that changed its geometry. seen : how often something changed that may
        be seen. began : the serial since when changes were noted.
    """

    serial: int = 0
    everything: int = 0
    objects: dict[int, int] = field(default_factory=dict)
    shapes: dict[int, int] = field(default_factory=dict)
    seen: int = 0
    began: int = 0

    def shape_of(self, obj: bpy.types.Object) -> int:
        """Equal numbers, equal geometry of an object."""
        return self.shapes.get(obj.session_uid, self.began)


_news: defaultdict[int, News] = defaultdict(News)
"""By the session uid of a scene."""


def news(scene: bpy.types.Scene) -> News:
    """What changed in a scene while a view asked."""
    return _news[scene.original.session_uid]


def forget() -> None:
    """Nothing is known any more: data-blocks may have been replaced."""
    for one in _news.values():
        one.serial += 1
        one.everything = one.began = one.serial
        one.objects.clear()
        one.shapes.clear()
        one.seen += 1


def note(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, new_frame: bool) -> None:
    """Count an evaluation.

    What the extension makes for renders comes and goes in one update with everything that shares
    data with it; nothing of that may be seen.

    Parameters
    ----------
    new_frame : the frame changed, which counts as a change of the scene itself.
    """
    one = news(scene)
    one.serial += 1
    updates = [(update, own(update.id)) for update in depsgraph.updates]
    echo = any(mine for _, mine in updates)
    seen = False
    for update, mine in updates:
        block = update.id
        if mine:
            continue
        moved = update.is_updated_transform or update.is_updated_geometry
        if isinstance(block, bpy.types.Object):
            # Only the original has a uid.
            uid = block.original.session_uid
            one.objects[uid] = one.serial
            if update.is_updated_geometry:
                one.shapes[uid] = one.serial
            seen = seen or (moved and block.type not in _UNSEEN)
        elif not isinstance(block, _OF_OBJECTS) and not (
            new_frame and isinstance(block, bpy.types.Scene)
        ):
            one.everything = one.serial
        seen = seen or (isinstance(block, _SHOWING) and not echo)
    one.seen += seen
