# SPDX-License-Identifier: GPL-3.0-or-later
"""The glasses that a 3D view shows, read from the scene and written down for the shader."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from .. import optics
from ..optics.axial import BoundedGlass
from ..scene.names import RefractiveGlassError, own
from ..scene.read.glasses import as_body, glass_objects, is_mesh_glass, named_glasses, read_glass
from ..scene.read.glassy_materials import opaque_bits
from ..scene.read.mesh_glasses import placed_opaque
from ..scene.read.modifier_inputs import glass_modifier
from ..scene.read.sources import source_objects
from ..scene.read.viewpoint import Viewpoint
from .capture import Box, box_of, framed
from .description import Frame, Posed, TooMuch, common_frame, pack
from .eye import CAPTURES
from .mesh_glasses import MeshGlasses
from .news import News
from .places import Place, places, profiles
from .trees import MeshBody

NEVER_SEEN = {"CAMERA", "LIGHT", "LIGHT_PROBE", "SPEAKER", "ARMATURE", "LATTICE"}
"""Kinds of objects that are neither glasses nor seen through one."""
NEVER_SURFACES = {"BOUNDS", "WIRE"}
"""Ways of display that leave an object to overlays."""
SPREADING = {"NODES", "PARTICLE_SYSTEM", "PARTICLE_INSTANCE", "EXPLODE", "OCEAN", "FLUID"}
"""Kinds of modifiers that may put something outside of an object's box."""
WITHIN = 0.01
"""Part of a glass's size by which a thing must reach into it to stand in it."""
FAR_AWAY = 1e3
"""From where the rays of a parallel view come, in reaches of a glass."""


class Model:
    """What a view shows its scene through.

    Attributes
    ----------
    key : what it was read from. enabled : the scene's setting, None before the first look.
    glasses, frame, block : see :mod:`description`.
    bands : the same blocks for red, green and blue light; empty if no glass disperses.
    lines : glasses and profiles, which views show by lines. meshes : glasses that are meshes.
    clear : (8, 3) corners in the world of each glass that changes nothing, one of the ior of what
        is around it: rays do not know it, but the lines that it is drawn by are hidden as ever.
    problems : one line for each glass that is left out. lamps : names of all, shown or not.
    """

    def __init__(self) -> None:
        self.key: tuple = ()
        self.enabled: bool | None = None
        self.glasses: list[Posed] = []
        self.clear: list[np.ndarray] = []
        self.frame: Frame | None = None
        self.block: np.ndarray | None = None
        self.bands: list[np.ndarray] = []
        self.lines: list[Place] = []
        self.meshes = MeshGlasses()
        self.problems: list[str] = []
        self.lamps: list[str] = []
        self._bands: list[list] = []
        self._world: list[np.ndarray] | None = None
        self._things: dict[int, str] = {}
        self._boxes: dict[int, Box] = {}
        self._units: dict[tuple[int, int], np.ndarray | None] = {}
        self._beside: set[int] = set()
        self._glasses: set[int] = set()
        """Session uids of the objects that are shown as glasses."""
        self._spread: set[int] = set()
        """Of the things, those that may reach out of their boxes."""
        self._showing: set[int] = set()
        """Of the things, those that may show instances."""
        self._has_instances = False
        """Whether a glass is shown by instances."""
        self._has_others = False
        """Whether the view shows what is neither glass nor thing."""
        self._serial = -1

    @property
    def is_shown(self) -> bool:
        """Whether there is any glass, be it clear."""
        return bool(self.glasses or self.clear)

    @property
    def is_rough(self) -> bool:
        """Whether any glass is."""
        return any(isinstance(g.body, MeshBody) and g.body.roughness > 0.0 for g in self.glasses)

    @property
    def boxes(self) -> list[Box]:
        """Of all things, see `capture.box_of`."""
        return list(self._boxes.values())

    def read(
        self, layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D, news: News, anew: bool
    ) -> bool:
        """Read what changed of a view layer; glasses that are hidden in the view are none.

        Parameters
        ----------
        anew : everything, whatever the news are.

        Returns
        -------
        bool
            Whether the glasses were read.
        """
        changed = {uid for uid, serial in news.objects.items() if serial > self._serial}
        anew = anew or self._serial < news.everything
        self._serial = news.serial
        # What is neither glass nor thing, nor anything that never is one, may have become one.
        anew = anew or not changed <= self._things.keys() | self._glasses | self._beside
        anew = anew or any(name not in layer.objects for name in self.lamps)
        if not anew:
            anew = not self._read_boxes(layer, space, changed & self._things.keys())
        if anew:
            self._list_things(layer, space)
        read = anew or bool(changed & self._glasses) or self._moves_instances(layer, changed)
        if read:
            self._read_glasses(layer, space, news)
        if read or changed & self._things.keys():
            self._place_things()
        return read

    def _moves_instances(self, layer: bpy.types.ViewLayer, changed: set[int]) -> bool:
        """Whether what changed may show glasses elsewhere."""
        if changed.isdisjoint(self._showing):
            return False
        return self._has_instances or bool(named_glasses(layer))

    def _list_things(self, layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D) -> None:
        """Find all things, and read their boxes."""
        # Of a glass, what is opaque of its mesh.
        glasses = (obj for obj in glass_objects(layer) if opaque_bits(glass_modifier(obj)))
        things = [
            o
            for o in (*source_objects(layer), *glasses)
            if o.visible_get(view_layer=layer, viewport=space)
        ]
        self._things = {obj.session_uid: obj.name for obj in things}
        self._beside = {o.session_uid for o in layer.objects if o.type in NEVER_SEEN}
        self.lamps = [o.name for o in layer.objects if o.type == "LIGHT" and not own(o)]
        # Profiles are curves without a surface.
        lines = profiles(layer, space, places(layer, space))
        lines = {place.obj.session_uid for place in lines}
        self._has_others = any(
            o.session_uid not in self._things.keys() | lines
            and o.type not in NEVER_SEEN | {"EMPTY"}
            and o.display_type not in NEVER_SURFACES
            and not (o.type == "MESH" and glass_modifier(o) is not None)
            and o.visible_get(view_layer=layer, viewport=space)
            for o in layer.objects
        )
        self._boxes, self._units, self._spread, self._showing = {}, {}, set(), set()
        self._read_boxes(layer, space, self._things.keys())

    def _read_boxes(self, layer: bpy.types.ViewLayer, space, which) -> bool:
        """Read the boxes of things that were found before; False if one is a thing no more."""
        for uid in which:
            obj = layer.objects.get(self._things[uid])
            if obj is None or obj.session_uid != uid or obj.hide_render:
                return False
            if not obj.visible_get(view_layer=layer, viewport=space):
                return False
            self._boxes.pop(uid, None)
            for kept, holds in ((self._spread, _spreads), (self._showing, _may_show_instances)):
                kept.discard(uid)
                if holds(obj):
                    kept.add(uid)
            box = box_of(obj, layer.depsgraph)
            if box is not None and is_mesh_glass(obj):
                evaluated = obj.evaluated_get(layer.depsgraph)
                place, bits = np.array(evaluated.matrix_world), opaque_bits(glass_modifier(obj))
                box = framed(box, placed_opaque(evaluated, place, bits))
            if box is not None:
                self._boxes[uid] = box
            for key in [k for k in self._units if k[1] == uid]:
                del self._units[key]
        return True

    def _read_glasses(
        self, layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D, news: News
    ) -> None:
        self.problems, self.clear = [], []
        found, self._bands, self._units = [], [], {}
        shown = places(layer, space)
        self._glasses = {place.obj.session_uid for place in shown}
        self._has_instances = any(place.number for place in shown)
        self.lines = shown + profiles(layer, space, shown)
        for place in shown:
            obj = place.obj
            try:
                if is_mesh_glass(obj):
                    one = self.meshes.read(place, layer.depsgraph, news)
                else:
                    one = _closed_form(place, layer.depsgraph)
            except RefractiveGlassError as error:
                self.problems.append(str(error))
                continue
            if one is not None:
                found.append(one[0])
                self._bands.append(one[1])
            elif not is_mesh_glass(obj):
                box = box_of(obj, layer.depsgraph, place.to_world)
                self.clear += [] if box is None else [box.corners]
        self.meshes.keep(shown)
        numbers = captures_of([glass.middle() for glass in found])
        self.glasses = [
            replace(glass, capture=number) for number, glass in zip(numbers, found, strict=True)
        ]
        self.frame = None
        if self.is_shown:
            self.frame = common_frame(self.glasses) if self.glasses else _frame_of(self.clear)

    def _place_things(self) -> None:
        """Tell each glass which things reach into it."""
        for number, glass in enumerate(self.glasses):
            units = []
            for uid, box in self._boxes.items():
                key = number, uid
                if key not in self._units:
                    self._units[key] = box.unit() if _reaches_in(box, glass) else None
                if self._units[key] is not None:
                    units.append(self._units[key])
            self.glasses[number] = replace(glass, things=tuple(units))
        self.block = None

    def signature(self) -> tuple:
        """What tells of glasses and of which things are there; equal ones look the same."""
        poses = ((g.body, g.to_world.tobytes(), g.absorption) for g in self.glasses)
        return (tuple(self._things), *poses, *(corners.tobytes() for corners in self.clear))

    def scene_reach(self) -> float:
        """Metres from the frame's origin within which all things are."""
        if not self._boxes:
            return 0.0
        corners = np.concatenate([box.corners for box in self._boxes.values()])
        return float(np.linalg.norm(corners - self.frame.origin, axis=1).max())

    def look_from(self, view: Viewpoint) -> None:
        """Tell in which media the eye is, and write the block if that changed."""
        outer = []
        for glass in self.glasses:
            if view.is_parallel:
                eye = glass.middle() - FAR_AWAY * glass.reach() * view.forward
            else:
                eye = view.eye
            local = (eye - glass.to_world[:3, 3]) @ glass.to_world[:3, :3]
            outer.append(int(glass.body.medium_at(local)))
        if self.block is not None and outer == [glass.outer for glass in self.glasses]:
            return
        self.glasses = [
            replace(glass, outer=medium) for glass, medium in zip(self.glasses, outer, strict=True)
        ]
        self._world = self._all_boxes()
        while True:
            try:
                self.block = pack(self.glasses, self.frame, self._world)
                self.bands = self._pack_bands()
                return
            except TooMuch as error:
                self.problems.append(f"A glass is left out of the view: {error}")
                self.glasses.pop()

    def _all_boxes(self) -> list[np.ndarray] | None:
        """Boxes outside of which nothing is shown, see `pack`; None if something may be."""
        if self._has_others or self._spread or len(self._boxes) < len(self._things):
            return None
        return [box.unit() for box in self._boxes.values()]

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
                self._world,
            )
            for number in range(len(optics.LINES))
        ]


def _frame_of(clear: list[np.ndarray]) -> Frame:
    """A common frame, metres, where no glass is but clear ones."""
    return Frame(np.concatenate(clear).mean(axis=0), 1.0, 0.0)


def captures_of(middles: list[np.ndarray]) -> list[int]:
    """Of each glass the number of its capture; those for which there is none share the nearest."""
    own = middles[:CAPTURES]
    return [
        min(range(len(own)), key=lambda k: float(np.linalg.norm(own[k] - middle)))
        for middle in middles
    ]


def _closed_form(
    place: Place, depsgraph: bpy.types.Depsgraph
) -> tuple[Posed, list[BoundedGlass]] | None:
    """A glass of closed form, and how red, green and blue light find it; None: it bounds nothing.

    Raises
    ------
    RefractiveGlassError
    """
    read = read_glass(place.obj, depsgraph, place.to_world)
    glass = as_body(read)
    if glass is None:
        return None
    posed = Posed(glass.description, glass.to_world, glass.absorption, priority=glass.priority)
    seen = [as_body(band).description for band in read.bands()]
    return posed, seen * (len(optics.LINES) // len(seen))


def _spreads(obj: bpy.types.Object) -> bool:
    """Whether something of a thing may be outside of its box: instances, hair, a curve's bevel."""
    return obj.type != "MESH" or _may_show_instances(obj)


def _may_show_instances(obj: bpy.types.Object) -> bool:
    if obj.type == "MESH" and glass_modifier(obj) is not None:
        return False
    return (
        obj.instance_collection is not None
        or obj.is_instancer
        or any(modifier.type in SPREADING for modifier in obj.modifiers)
    )


def _reaches_in(box: Box, glass: Posed) -> bool:
    """Whether a thing's box may reach into a glass."""
    if not box.is_near(glass.middle(), glass.reach()):
        return False
    low, high = glass.body.box
    skin = WITHIN * (high - low)
    local = (box.corners - glass.to_world[:3, 3]) @ glass.to_world[:3, :3]
    return bool(np.all(local.min(axis=0) < high - skin) and np.all(local.max(axis=0) > low + skin))
