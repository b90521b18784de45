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
_expected: set[int] = set()
_echoed: set[int] = set()
"""Session uids of scenes: their next evaluation may tell of nothing new; their last one did."""


def expect_echo(scene: bpy.types.Scene) -> None:
    """A setting was changed and put back: an evaluation will name the scene, and nothing else."""
    _expected.add(scene.original.session_uid)


def is_echo(scene: bpy.types.Scene) -> bool:
    """Whether the last evaluation of a scene only tells of what `expect_echo` announced."""
    return scene.original.session_uid in _echoed


def _hear(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    uid = scene.original.session_uid
    _echoed.discard(uid)
    if uid in _expected:
        _expected.discard(uid)
        if all(isinstance(update.id, bpy.types.Scene) for update in depsgraph.updates):
            _echoed.add(uid)


def note(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Count an evaluation of the scene in which anything but the extension's own data changed.

    It is called before anyone asks `is_echo` of that evaluation.
    """
    _hear(scene, depsgraph)
    if not is_echo(scene) and any(not own(update.id) for update in depsgraph.updates):
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
