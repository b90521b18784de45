# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether anything was evaluated anew since the last look: what lets a still scene cost nothing.

Blender tells of every evaluation by ``depsgraph_update_post`` and ``frame_change_post``; the
handlers hand both on to :func:`note`. Who keeps results asks for :func:`generation` and looks
closer only if it has grown.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from .names import own

_generations: Counter[int] = Counter()
_shapes: Counter[int] = Counter()
_echoing: set[int] = set()
"""Session uids of scenes whose evaluations tell of nothing new."""


@contextmanager
def put_back(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Iterator[None]:
    """While a setting of the evaluated scene is changed and put back: that is no news.

    Blender evaluates the scene for it. What is due before and after is evaluated here, so that
    nothing that anyone else changes comes at the same time. To be called neither while drawing nor
    from a handler.
    """
    uid = scene.original.session_uid
    layer.update()
    try:
        yield
    finally:
        _echoing.add(uid)
        try:
            layer.update()
        finally:
            _echoing.discard(uid)


def is_echo(scene: bpy.types.Scene) -> bool:
    """Whether the evaluation that is told of is that of `put_back`."""
    return scene.original.session_uid in _echoing


def note(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Count an evaluation of the scene in which anything but the extension's own data changed."""
    if is_echo(scene):
        return
    if any(not own(update.id) for update in depsgraph.updates):
        _generations[scene.original.session_uid] += 1
    for update in depsgraph.updates:
        is_shape = update.is_updated_geometry and isinstance(update.id, bpy.types.Object)
        if is_shape or isinstance(update.id, bpy.types.Image):
            _shapes[update.id.original.session_uid] += 1


def generation(scene: bpy.types.Scene) -> int:
    """Grows whenever something in the scene was evaluated anew."""
    return _generations[scene.original.session_uid]


def shape_generation(block: bpy.types.Object | bpy.types.Image) -> int:
    """Grows whenever an object's geometry was evaluated anew, or an image was changed."""
    return _shapes[block.original.session_uid]
