# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies at the moments round a frame that a renderer asks for when it blurs motion.

The user's scene is rendered first and goes through all these moments, with everything evaluated:
where the copies' vertices are then is kept. When the copies' own scene goes through them, they are
put there.
"""

from __future__ import annotations

import bpy

from ..build.layers import Layers, find_layers
from ..build.own_scenes import source_of
from ..memory import Memory, counters, memory_of
from ..names import RefractiveGlassError
from ..read.glasses import read_glass
from ..read.sources import Snapshot, pieces
from ..read.viewpoint import Viewpoint
from .appearance import Solver, moment_of
from .copies import write_moment

SOLVED = 0.1
"""Part of the tolerance that edges have, to which apparent points are found."""


def begin_frame(scene: bpy.types.Scene) -> None:
    """A render begins a frame: the next evaluation is that of the frame's own time."""
    memory = memory_of(scene)
    memory.centre = memory.exposure = None
    memory.moments.clear()


def frame_time(scene: bpy.types.Scene) -> float:
    """The scene's frame with its sub-frame."""
    return scene.frame_current + scene.frame_subframe


def show_moment(scene: bpy.types.Scene, own_time: float) -> None:
    """Move the copies to where they are at a time round the frame (frames), for motion blur.

    The user's scene, rendered first, went through all these times; they were kept then.
    """
    layers, memory = find_layers(scene), memory_of(scene)
    if layers is None or not memory.moments:
        return
    nearest = min(memory.moments, key=lambda kept: abs(kept - own_time))
    for key, copy in layers.copies().items():
        if key in memory.moments[nearest]:
            write_moment(copy, memory.copies[key][2], memory.moments[nearest][key])


def keep_moment(scene, memory: Memory, layers: Layers, view: Viewpoint, depsgraph) -> None:
    """Find where the copies' vertices are now, between frames; what they hold stays."""
    moment = memory.moments.setdefault(frame_time(scene), {})
    objects = {obj.session_uid: obj for obj in scene.objects}
    uids = {pane.number: planned.uid for planned in memory.plan.glasses for pane in planned.panes}
    copies = layers.copies()
    for key, (_, _, shape) in memory.copies.items():
        number, slot, _ = key
        glass, paths = memory.shown[number]
        if key not in copies or slot not in paths or shape.images is None:
            continue
        try:
            now = read_glass(objects[uids[number]], depsgraph)
        except RefractiveGlassError:
            # It stays where the frame itself shows it, which says what is wrong.
            continue
        now = now.in_light(glass.band) if glass.band else now
        tolerance = SOLVED * scene.refractive_glass.tolerance_px
        solver = Solver(now, paths[slot], view, tolerance)
        original = source_of(copies[key])
        with pieces(original, depsgraph) as parts:
            position = moment_of(solver, Snapshot.of(parts), shape)
        if position is not None:
            moment[key] = position
            counters["solves"] += 1
