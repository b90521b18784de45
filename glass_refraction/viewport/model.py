# SPDX-License-Identifier: GPL-3.0-or-later
"""The glasses that a 3D view shows, read from the scene and written down for the shader."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from .. import optics
from ..scene.names import RefractiveGlassError
from ..scene.read.glasses import as_body, glass_objects, is_mesh_glass, read_glass
from ..scene.read.sources import source_objects
from ..scene.read.viewpoint import Viewpoint
from .capture import Box, boxes_of
from .description import Frame, Posed, TooMuch, common_frame, pack
from .eye import CAPTURES

WITHIN = 0.01
"""Part of a glass's size by which a thing must reach into it to stand in it."""
FAR_AWAY = 1e3
"""From where the rays of a parallel view come, in reaches of a glass."""


class Model:
    """What a view shows its scene through.

    Attributes
    ----------
    key : what it was read from. enabled : the scene's setting, None before the first look.
    glasses, frame, block : see :mod:`description`. boxes : see `capture.boxes_of`.
    bands : the same blocks for red, green and blue light; empty if no glass disperses.
    within : the glass that the eye is in, -1 for none, and the medium there.
    problems : one line for each glass that is left out.
    """

    def __init__(self) -> None:
        self.key: tuple = ()
        self.enabled: bool | None = None
        self.glasses: list[Posed] = []
        self.frame: Frame | None = None
        self.block: np.ndarray | None = None
        self.bands: list[np.ndarray] = []
        self._bands: list[list] = []
        self._names: tuple[int, ...] = ()
        self.boxes: list[Box] = []
        self.within = (-1, 0)
        self.problems: list[str] = []

    def read(self, layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D) -> None:
        """Read the glasses of a view layer; those hidden in the view are none."""
        depsgraph = layer.depsgraph
        self.problems = []

        def visible(obj: bpy.types.Object) -> bool:
            return obj.visible_get(view_layer=layer, viewport=space)

        things = [obj for obj in source_objects(layer) if visible(obj)]
        self.boxes = boxes_of(things, depsgraph)
        self._names = tuple(obj.session_uid for obj in things)
        found, self._bands = [], []
        for obj in glass_objects(layer):
            if not visible(obj) or is_mesh_glass(obj):
                continue
            try:
                read = read_glass(obj, depsgraph)
            except RefractiveGlassError as error:
                self.problems.append(str(error))
                continue
            glass = as_body(read)
            if glass is not None:
                found.append(Posed(glass.description, glass.to_world, glass.absorption))
                seen = [as_body(band).description for band in read.bands()]
                self._bands.append(seen * (len(optics.LINES) // len(seen)))
        self.glasses = [
            replace(
                glass,
                capture=min(number, CAPTURES - 1),
                things=tuple(box.unit() for box in self.boxes if _reaches_in(box, glass)),
            )
            for number, glass in enumerate(found)
        ]
        self.block = None
        self.frame = common_frame(self.glasses) if self.glasses else None

    def signature(self) -> tuple:
        """What tells of glasses and of which things are there; equal ones look the same."""
        return (self._names, *((g.body, g.to_world.tobytes(), g.absorption) for g in self.glasses))

    def scene_reach(self) -> float:
        """Metres from the frame's origin within which all things are."""
        if not self.boxes:
            return 0.0
        corners = np.concatenate([box.corners() for box in self.boxes])
        return float(np.linalg.norm(corners - self.frame.origin, axis=1).max())

    def look_from(self, view: Viewpoint) -> None:
        """Tell in which media the eye is, and write the block if that changed."""
        within, outer = (-1, 0), []
        for number, glass in enumerate(self.glasses):
            if view.is_parallel:
                eye = glass.middle() - FAR_AWAY * glass.reach() * view.forward
            else:
                eye = view.eye
            local = (eye - glass.to_world[:3, 3]) @ glass.to_world[:3, :3]
            medium = int(glass.body.medium_at(local))
            if medium in glass.body.endless:
                outer.append(medium)
            else:
                outer.append(0)
                within = (number, medium)
        self.within = within
        if self.block is not None and outer == [glass.outer for glass in self.glasses]:
            return
        self.glasses = [
            replace(glass, outer=medium) for glass, medium in zip(self.glasses, outer, strict=True)
        ]
        while self.glasses:
            try:
                self.block = pack(self.glasses, self.frame)
                self.bands = self._pack_bands()
                return
            except TooMuch as error:
                self.problems.append(f"A glass is left out of the view: {error}")
                self.glasses.pop()

    def dispersing(self) -> list[bool]:
        """Of each glass whether red, green and blue light go different ways."""
        return [len(set(seen)) > 1 for seen in self._bands[: len(self.glasses)]]

    def _pack_bands(self) -> list[np.ndarray]:
        count = len(self.glasses)
        if all(len(set(seen)) == 1 for seen in self._bands[:count]):
            return []
        return [
            pack(
                [
                    replace(glass, body=seen[number])
                    for glass, seen in zip(self.glasses, self._bands[:count], strict=True)
                ],
                self.frame,
            )
            for number in range(len(optics.LINES))
        ]


def _reaches_in(box: Box, glass: Posed) -> bool:
    """Whether a thing's box may reach into a glass."""
    if not box.is_near(glass.middle(), glass.reach()):
        return False
    low, high = glass.body.box
    skin = WITHIN * (high - low)
    local = (box.corners() - glass.to_world[:3, 3]) @ glass.to_world[:3, :3]
    return bool(np.all(local.min(axis=0) < high - skin) and np.all(local.max(axis=0) > low + skin))
