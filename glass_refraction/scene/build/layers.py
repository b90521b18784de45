# SPDX-License-Identifier: GPL-3.0-or-later
"""The own scenes in which displaced copies are rendered, both by the user's own engine.

* *displaced*: one view layer a pane and slot, with the copies that are seen along one light path,
  and the user's lamps. The film is transparent.
* *mask*: one view layer a glass. It is white where the glass is seen, and black where another glass
  or an object stands before it. Every object has the plain colour of its own: as Workbench draws
  it, and in the other engines by an emitting material.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy

from ..names import COPY_GROUP, OCCLUDER_GROUP, TAG, hidden_name, own
from ..plan import GlassPlan, Pane, Plan
from ..read.viewpoint import render_size
from .own_scenes import (
    child_collection,
    find_own_scenes,
    match_linked,
    match_settings,
    new_carrier,
    new_collection,
    new_object,
    own_scene,
    remove_objects,
    remove_own_scenes,
    show_only,
    source_of,
    synchronise,
    write_setting,
)
from .shaders import object_colour_material

ROLES = ("displaced", "mask")

_PANE = "refractive_glass_pane"
_SLOT = "refractive_glass_slot"
_GLASS = "refractive_glass_of"
_WHITE, _BLACK = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0)

CopyKey = tuple[int, int, int]
"""Number of the pane, of the slot, and the source's session uid."""


@dataclass(frozen=True)
class Layers:
    """The own scenes of a user's scene."""

    displaced: bpy.types.Scene
    mask: bpy.types.Scene

    def all(self) -> tuple[bpy.types.Scene, ...]:
        """Both."""
        return (self.displaced, self.mask)

    def copies(self) -> dict[CopyKey, bpy.types.Object]:
        """All copies."""
        found = {}
        for collection in self.displaced.collection.children:
            if not own(collection, "copies"):
                continue
            for obj in collection.objects:
                source = source_of(obj)
                if source is not None:
                    found[collection[_PANE], collection[_SLOT], source.session_uid] = obj
        return found

    def occluders(self) -> dict[int, bpy.types.Object]:
        """Source's session uid -> the object that stands at its true place."""
        collection = child_collection(self.mask, "occluders")
        return {source_of(o).session_uid: o for o in collection.objects if source_of(o) is not None}

    def hull(self, number: int) -> bpy.types.Mesh:
        """The mesh of a glass's outline, which its white and its black object share."""
        for collection in self.mask.collection.children:
            if own(collection, "hull") and collection[_GLASS] == number:
                return collection.objects[0].data
        raise KeyError(number)


def find_layers(scene: bpy.types.Scene) -> Layers | None:
    """The own scenes of a user's scene, if they exist."""
    found = {own_scene[TAG]: own_scene for own_scene in find_own_scenes(scene, ROLES)}
    return Layers(**found) if len(found) == len(ROLES) else None


def build_layers(
    scene: bpy.types.Scene, plan: Plan, objects: dict[int, bpy.types.Object], *, anew: bool
) -> Layers:
    """Make the own scenes show exactly what is planned.

    Parameters
    ----------
    objects : session uid -> source. anew : view layers are made again too.
    """
    layers = find_layers(scene)
    if anew or layers is None:
        remove_own_scenes(scene, ROLES)
        layers = Layers(**{role: own_scene(scene, role) for role in ROLES})
        _make_displaced(layers.displaced, plan.panes)
        _make_mask(layers.mask, plan.glasses)
    _match_copies(layers, plan, objects)
    _match_occluders(layers, plan, objects)
    lamps = {o for o in scene.objects if o.type == "LIGHT" and not o.hide_render}
    match_linked(child_collection(layers.displaced, "lights"), lamps)
    for made in layers.all():
        for view_layer in made.view_layers:
            synchronise(view_layer)
    return layers


def _make_displaced(displaced: bpy.types.Scene, panes: Iterable[Pane]) -> None:
    lights = new_collection("lights", displaced)
    copies = {}
    for pane in panes:
        for slot in range(pane.slots):
            made = copies[pane.layer(slot)] = new_collection("copies", displaced)
            made[_PANE], made[_SLOT] = pane.number, slot
    _name_layers(displaced, list(copies))
    for name, collection in copies.items():
        show_only(displaced.view_layers[name], collection, lights)


def _make_mask(mask: bpy.types.Scene, glasses: tuple[GlassPlan, ...]) -> None:
    occluders = new_collection("occluders", mask)
    white, black = {}, {}
    for glass in glasses:
        mesh = bpy.data.meshes.new(hidden_name("hull", str(glass.number)))
        looks = [("hull", white, _WHITE)]
        if len(glasses) > 1:
            looks.append(("shade", black, _BLACK))
        for role, found, colour in looks:
            made = found[glass.number] = new_collection(role, mask)
            made[_GLASS] = glass.number
            new_object("hull", mesh, made, role, str(glass.number)).color = colour
    _name_layers(mask, [glass.mask_layer for glass in glasses])
    for glass in glasses:
        others = [made for number, made in black.items() if number != glass.number]
        layer = mask.view_layers[glass.mask_layer]
        show_only(layer, white[glass.number], occluders, *others)
        layer.material_override = object_colour_material()


def _name_layers(own_scene: bpy.types.Scene, names: list[str]) -> None:
    own_scene.view_layers[0].name = names[0]
    for name in names[1:]:
        own_scene.view_layers.new(name)


def _match_copies(layers: Layers, plan: Plan, objects: dict[int, bpy.types.Object]) -> None:
    """One copy a pane, slot and source; the others go."""
    wanted = {
        (pane.number, slot, uid)
        for glass in plan.glasses
        for pane in glass.panes
        for slot in range(pane.slots)
        for uid in glass.sources
    }
    existing = layers.copies()
    # Copies whose source is gone have no key any more.
    keep = {obj for key, obj in existing.items() if key in wanted}
    for collection in layers.displaced.collection.children:
        if not own(collection, "copies"):
            continue
        place = (collection[_PANE], collection[_SLOT])
        remove_objects([o for o in collection.objects if o not in keep])
        missing = sorted(uid for *at, uid in wanted - existing.keys() if tuple(at) == place)
        for uid in missing:
            new_carrier("copy", COPY_GROUP, objects[uid], collection)


def _match_occluders(layers: Layers, plan: Plan, objects: dict[int, bpy.types.Object]) -> None:
    collection = child_collection(layers.mask, "occluders")
    missing, surplus = dict.fromkeys(plan.sources), []
    for obj in collection.objects:
        source = source_of(obj)
        if source is not None and source.session_uid in missing:
            del missing[source.session_uid]
        else:
            surplus.append(obj)
    remove_objects(surplus)
    for uid in missing:
        made = new_carrier("occluder", OCCLUDER_GROUP, objects[uid], collection)
        made.color = _BLACK


def write_settings(scene: bpy.types.Scene, layers: Layers, rect: tuple[int, int, int, int]) -> None:
    """Give the own scenes the user's camera and render settings.

    Parameters
    ----------
    rect : the pixels that any glass covers; nothing else is rendered.
    """
    picture: dict[str, object] = {"use_compositing": False, "film_transparent": True}
    if not scene.render.use_border:
        size = render_size(scene)
        picture |= {"use_border": True, "use_crop_to_border": False}
        for place, name in enumerate(("min_x", "min_y", "max_x", "max_y")):
            picture[f"border_{name}"] = rect[place] / size[place % 2]
    match_settings(scene, layers.displaced, {"render": picture})
    match_settings(
        scene,
        layers.mask,
        {
            "render": picture | {"use_freestyle": False},
            "cycles": {"use_denoising": False, "film_exposure": 1.0},
            "display.shading": _FLAT,
            "scene": {"world": None},
        },
    )


_FLAT = {
    "light": "FLAT",
    "color_type": "OBJECT",
    "show_shadows": False,
    "show_cavity": False,
    "show_object_outline": False,
    "show_specular_highlight": False,
    "show_xray": False,
    "use_dof": False,
}
"""Workbench: every object has its own colour, and nothing else tells."""


def use_layers(own_scene: bpy.types.Scene, used: set[str]) -> None:
    """Render these of an own scene's view layers; at least one, for Blender renders no fewer."""
    for number, layer in enumerate(own_scene.view_layers):
        write_setting(layer, "use", layer.name in used or (number == 0 and not used))
