# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether anything was evaluated anew since the last look: what lets a still scene cost nothing.

Blender tells of every evaluation by ``depsgraph_update_post`` and ``frame_change_post``; the
handlers hand both on to :func:`note`. Who keeps results asks for :func:`generation` and looks
closer only if it has grown.
"""

from __future__ import annotations

from collections import Counter

import bpy

from .names import own

_generations: Counter[int] = Counter()
_shapes: Counter[int] = Counter()


def note(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Count an evaluation of the scene in which anything but the extension's own data changed."""
    if any(not own(update.id) for update in depsgraph.updates):
        _generations[scene.original.session_uid] += 1
    for update in depsgraph.updates:
        if update.is_updated_geometry and isinstance(update.id, bpy.types.Object):
            _shapes[update.id.original.session_uid] += 1


def generation(scene: bpy.types.Scene) -> int:
    """Grows whenever something in the scene was evaluated anew."""
    return _generations[scene.original.session_uid]


def shape_generation(obj: bpy.types.Object) -> int:
    """Grows whenever an object's geometry was evaluated anew."""
    return _shapes[obj.original.session_uid]
