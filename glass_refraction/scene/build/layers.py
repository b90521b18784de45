# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's own scenes, view layers and collections, in which the copies are rendered.

Four scenes belong to a user's scene:

* *lookup*: Cycles, one sample at each pixel's exact centre. One view layer a glass and light path,
  showing the copies with a material that emits where their true place is in the direct picture;
  and one with the depth of the direct picture.
* *mask*: Cycles, nothing but coverage. One view layer a glass: where it is not hidden.
* *displaced*: the user's engine and lights. One view layer a glass and light path, showing the
  copies shaded where they are drawn.
* *around*: Cycles. One view layer a light path, showing what its rays meet after they left any
  glass: the world, or the world and the user's own objects and lamps.

A compositor renders other scenes at the size of its own, whatever their own size is.
Nothing is added to the user's own view layers or collections.
"""

from __future__ import annotations

import math
import uuid
from dataclasses import dataclass

import bpy

from ... import optics
from ..bake.files import BAKE
from ..environment import (
    WORLD_SAMPLES,
    needs_copies,
    ray_material,
    shows_objects,
    surroundings,
)
from ..memory import counters
from ..names import COPY_GROUP, OCCLUDER_GROUP, TAG, hidden_name, load_group, own
from ..ray_screen import SLOTS
from ..read.glasses import banded_key, casts_shadow, glass_modifier
from ..read.modifier_inputs import read_input, write_input
from ..read.sources import is_carried
from ..read.viewpoint import render_size
from ..read.visibility import rendered_objects
from ..vertices.path_keys import Path, path_key, path_of, short_key
from ..vertices.regions import FILTER_WIDTH
from .shaders import curtain_material, depth_material, lookup_material, mask_material

FALLBACK_SHARE = 8
"""What stands in where copies fail takes this part of the scene's samples."""
LEAST_SAMPLES = 4
"""With less, edges in what rays show would not be smooth."""
MASK_SAMPLES = 32
"""Of the outlines; they cost next to nothing."""
FAINT_NOISE = 0.08
"""Cycles' measure of a pixel's noise, times the square root of the samples, at which rays that go
on from a glass get no more samples there: they stay less noisy than what the engine draws."""
BORDERS = "\u00b7 borders"
"""After a glass's name."""
ROLES = ("lookup", "mask", "displaced", "around")
DEPTH_LAYER = "depth"

_KEY = "refractive_glass_key"
_GLASS = "refractive_glass_name"
_PATH = "refractive_glass_path"
_OWNER = "refractive_glass_owner"
_LAYER = "refractive_glass_layer"
_MIRRORED = "refractive_glass_mirrored"
_PATHS = "refractive_glass_paths"
"""On a glass's hull: the keys of all its paths."""
_RAYS = "refractive_glass_by_rays"
"""On a glass's hull: how many slots its screen has, if rays show all that is seen through it."""

_SESSION = uuid.uuid4().hex
"""Blender numbers data-blocks anew in each session: in another this number is another's."""


def border_key(key: str) -> str:
    """What is made for the borders of a glass's paths is known by this."""
    return f"{key} {BORDERS}"


@dataclass(frozen=True)
class Pane:
    """One glass and the light paths that its picture is made of."""

    glass: bpy.types.Object
    paths: tuple[Path, ...]
    sources: tuple[bpy.types.Object, ...]
    contents: tuple[bpy.types.Object, ...] = ()
    """The sources that reach into the glass."""
    bare: frozenset[Path] = frozenset()
    """Paths whose last stretch the engine's rays show, without copies."""
    band: str = ""
    """The colour of the light, where the glass disperses it."""
    beyond: tuple[bpy.types.Object, ...] = ()
    """The sources that reach into other glasses that are shown through this one."""
    traced: frozenset[Path] = frozenset()
    """Paths of which copies show nothing but what the glass itself holds."""
    rays: int = 0
    """Where the engine's rays show everything, the slots of the screen: it has no paths of its own
    here."""
    borders: bool = False
    """Rays show the borders of the paths of the glass's other pane, and those of its paths that
    have no copies; else they show a cup."""
    has_borders: bool = False
    """There is such a pane."""

    @property
    def key(self) -> str:
        """As the glass's, :func:`glasses.banded_key`, or that of its borders."""
        key = banded_key(self.glass.name, self.band)
        return border_key(key) if self.borders else key

    def held_along(self, path: Path) -> tuple[bpy.types.Object, ...]:
        """The sources that reach into any glass of the path."""
        if isinstance(path, optics.ChainedPath):
            return tuple(dict.fromkeys((*self.contents, *self.beyond)))
        return self.contents

    def carried(self, path: Path, around: str) -> tuple[bpy.types.Object, ...]:
        """The sources of which displaced copies are shown along the path.

        ``around`` as :func:`environment.surroundings` has it. Where open paths show what the glass
        holds, the others show only what is seen after they left it.
        """
        if path.open:
            return self.contents
        if path.interfaces is not None:
            here = path not in self.bare | self.traced and needs_copies(path, around)
            return self.sources if here else ()
        here = path not in self.traced and needs_copies(path, around)
        return self.sources if here else self.held_along(path)

    def layer(self, path: Path) -> str:
        """Name of the view layer of one path's copies, in both scenes."""
        return f"{self.key} {short_key(path)}"

    def ray_layer(self, path: Path) -> str:
        """Name of the view layer of what rays look up where a path's copies do not show it."""
        return banded_key(short_key(path), self.band)

    def before(self, path: Path) -> tuple[optics.LightPath, ...]:
        """The open paths that the path begins with: what they show stands before it."""
        return tuple(p for p in self.paths if p.open and p != path and p.begins(path))

    def border_pane(self, around: str, slots: int) -> Pane:
        """Another pane, whose rays show this one's borders and paths without copies."""
        paths = tuple(self.paths[number] for number in self.without_copies(around))
        return Pane(
            self.glass,
            paths,
            self.sources,
            bare=frozenset(paths),
            band=self.band,
            rays=slots,
            borders=True,
        )

    def without_copies(self, around: str) -> tuple[int, ...]:
        """Numbers of the whole paths that the engine's rays show alone."""
        return tuple(
            number
            for number, path in enumerate(self.paths)
            if around and not path.open and not self.carried(path, around)
        )

    @property
    def screened(self) -> tuple[int, ...]:
        """Numbers of the paths whose rays this pane's own screen knows."""
        return tuple(
            number
            for number, path in enumerate(self.paths)
            if not (self.has_borders and path in self.bare)
        )

    def mirror_layers(self, around: str) -> dict[str, tuple[int, ...]]:
        """View layers of all paths that have no copies, and their numbers.

        One for all that the same things stand before, and the same for all glasses: where one
        stands before another, that is hidden anyway.
        """
        if self.rays:
            name = "borders" if self.borders else "rays"
            return {banded_key(name, self.band): tuple(range(self.rays))}
        groups: dict[tuple, list[int]] = {}
        for number in self.without_copies(around):
            groups.setdefault(self.before(self.paths[number]), []).append(number)
        named = enumerate(groups.values())
        return {banded_key(f"mirrors {n}", self.band): tuple(group) for n, group in named}

    def ray_layers(self, around: str) -> dict[str, tuple[int, ...]]:
        """View layers of what rays look up, and the numbers of the paths that each shows."""
        layers = self.mirror_layers(around)
        if self.rays:
            return layers
        for number, path in enumerate(self.paths):
            if around and not path.open and self.carried(path, around):
                layers[self.ray_layer(path)] = (number,)
        return layers

    @property
    def drawn(self) -> tuple[Path, ...]:
        """The paths that may have copies."""
        return tuple(path for path in self.paths if path not in self.bare)

    @property
    def mask_layer(self) -> str:
        return f"{self.glass.name} mask"


@dataclass(frozen=True)
class Layers:
    """The own scenes of a user's scene."""

    lookup: bpy.types.Scene
    mask: bpy.types.Scene
    displaced: bpy.types.Scene
    around: bpy.types.Scene

    def all(self) -> tuple[bpy.types.Scene, ...]:
        """All four."""
        return (self.lookup, self.mask, self.displaced, self.around)

    def rendered(self) -> tuple[bpy.types.Scene, ...]:
        """Those of which any view layer is rendered."""
        return tuple(s for s in self.all() if any(layer.use for layer in s.view_layers))

    def copies(self) -> dict[tuple[str, str, int], bpy.types.Object]:
        """(glass name, path key, source's session uid) -> copy."""
        found = {}
        for collection in self.lookup.collection.children:
            if not own(collection, "copies"):
                continue
            for obj in collection.objects:
                source = source_of(obj)
                if source is not None:
                    found[collection[_GLASS], collection[_PATH], source.session_uid] = obj
        return found

    def path_keys(self) -> dict[str, tuple[list[str], list[str]]]:
        """Glass name -> keys of all its paths in their order, and of those without copies."""
        drawn = {(c[_GLASS], c[_PATH]) for c in self.lookup.collection.children if own(c, "copies")}
        found = {}
        for hull in self.mask.collection.children:
            if own(hull, "hull"):
                name, keys = hull[_GLASS], hull[_PATHS].split("\n") if hull[_PATHS] else []
                found[name] = keys, [key for key in keys if (name, key) not in drawn]
        return found

    def by_rays(self) -> dict[str, int]:
        """Names of the glasses of which rays show everything, and their screens' slots."""
        hulls = [c for c in self.mask.collection.children if own(c, "hull")]
        return {hull[_GLASS]: hull[_RAYS] for hull in hulls if hull[_RAYS]}

    def occluders(self) -> dict[int, bpy.types.Object]:
        """Source's session uid -> the object that stands at its true place."""
        collection = _child(self.lookup, "occluders")
        return {source_of(o).session_uid: o for o in collection.objects if source_of(o) is not None}

    def hull(self, glass_name: str) -> bpy.types.Object:
        """The object that shows where the glass is seen."""
        for collection in self.mask.collection.children:
            if own(collection, "hull") and collection[_GLASS] == glass_name:
                return collection.objects[0]
        raise KeyError(glass_name)

    def screen(self, glass_name: str, mirrored: bool | None = None) -> bpy.types.Mesh:
        """The mesh that knows where a glass's rays go.

        ``mirrored``: of the layers of paths without copies, where they have one of their own, or of
        the others.
        """
        for collection in self.around.collection.children:
            wanted = own(collection, "screen") and collection[_GLASS] == glass_name
            if wanted and mirrored in (None, collection[_MIRRORED]):
                return collection.objects[0].data
        raise KeyError(glass_name)

    def curtain(self) -> bpy.types.Object:
        """The object that hides from the camera what lies beside the screens."""
        return _child(self.around, "curtain").objects[0]


def source_of(copy: bpy.types.Object) -> bpy.types.Object | None:
    """The object that a copy or occluder shows; None for a baked object that has no source."""
    if own(copy.modifiers[0].node_group, "baked"):
        return None
    return read_input(copy.modifiers[0], "Source")


def find_layers(scene: bpy.types.Scene) -> Layers | None:
    """The own scenes of a user's scene, if they exist."""
    found = {}
    for role in ROLES:
        for candidate in bpy.data.scenes:
            if _is_of(candidate, role, scene):
                found[role] = candidate
    return Layers(**found) if len(found) == len(ROLES) else None


def user_scene_of(own_scene: bpy.types.Scene) -> bpy.types.Scene | None:
    """The user's scene that an own scene belongs to."""
    users = [scene for scene in bpy.data.scenes if not own(scene)]
    for scene in users:
        if own_scene.get(_OWNER) == _owner(scene):
            return scene
    # From a file.
    for scene in users:
        if _plays_back(scene, own_scene):
            return scene
    return next((s for s in users if (s.name, s.library) == (own_scene[_GLASS], None)), None)


def _owner(scene: bpy.types.Scene) -> str:
    return f"{_SESSION} {scene.session_uid}"


def _plays_back(scene: bpy.types.Scene, own_scene: bpy.types.Scene) -> bool:
    """Whether the scene shows the own scene baked, be it renamed or without a glass meanwhile."""
    group, tree = own_scene.get(BAKE), scene.compositing_node_group
    if group is None or tree is None:
        return False
    return any(n.get(TAG) == "group" and n.node_tree == group for n in tree.nodes)


def _is_of(candidate: bpy.types.Scene, role: str, scene: bpy.types.Scene) -> bool:
    # What was linked with a library's scene is the library's.
    return own(candidate, role) and not candidate.library and user_scene_of(candidate) == scene


def build_layers(scene: bpy.types.Scene, panes: list[Pane], around: str) -> tuple[Layers, bool]:
    """Make the own scenes show exactly these glasses, paths and sources.

    ``around`` as :func:`environment.surroundings` has it. Returns the layers and whether they were
    made anew (node trees must then follow).
    """
    key = repr(
        [
            (p.key, [path_key(q) for q in p.paths], len(p.drawn), p.rays, p.ray_layers(around))
            for p in panes
        ]
    )
    layers = find_layers(scene)
    anew = layers is None or layers.lookup.get(_KEY) != key
    if anew:
        remove_layers(scene)
        layers = Layers(**{role: _own_scene(scene, role) for role in ROLES})
        _make_layers(scene, layers, panes, around)
        layers.lookup[_KEY] = key
    _match_sources(layers, panes, around)
    lamps = {o for o in scene.objects if o.type == "LIGHT" and not o.hide_render}
    _match_linked(_child(layers.displaced, "lights"), lamps)
    shown = {
        o
        for o in rendered_objects(scene.view_layers[0])
        if glass_modifier(o) is None or casts_shadow(o)
    }
    shown = shown if shows_objects(around) else set()
    lamps = {o for o in shown if o.type == "LIGHT"}
    _match_linked(_child(layers.around, "shown"), shown - lamps)
    _match_lamps(_child(layers.around, "lamps"), lamps)
    for constraint in layers.curtain().constraints:
        if constraint.target != scene.camera:
            constraint.target = scene.camera
    for view_layer in layers.around.view_layers:
        for child in _layer_collections(view_layer):
            screen = child.collection
            hidden = own(screen, "screen") and screen[_LAYER] != view_layer.name
            if child.exclude != hidden:
                child.exclude = hidden
    for own_scene in layers.all():
        for view_layer in own_scene.view_layers:
            _synchronise(view_layer)
    return layers, anew


def remove_layers(scene: bpy.types.Scene) -> None:
    """Remove the own scenes of a user's scene with everything in them that is the extension's."""
    for role in ROLES:
        for candidate in [s for s in bpy.data.scenes if _is_of(s, role, scene)]:
            _remove_scene(candidate)


def remove_leftovers() -> None:
    """Remove what the extension made and nothing needs any more, in any scene.

    Own scenes of scenes that were deleted or have no glass any more, and own data-blocks without a
    user. Not while a render goes on: Blender 5.2 crashes where one finds a node group freed.
    """
    for candidate in [s for s in bpy.data.scenes if own(s) and not s.library]:
        owner = user_scene_of(candidate)
        if owner is None or not (_has_glass(owner) or _plays_back(owner, candidate)):
            _remove_scene(candidate)
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.collections, bpy.data.node_groups)
    kinds += (bpy.data.materials, bpy.data.images, bpy.data.lights)
    removed = True
    while removed:
        # What goes may have been the last to hold another.
        removed = False
        for blocks in kinds:
            for block in [b for b in blocks if b.users == 0 and own(b) and not b.library]:
                blocks.remove(block)
                removed = True


def _has_glass(scene: bpy.types.Scene) -> bool:
    return any(obj.type == "MESH" and glass_modifier(obj) is not None for obj in scene.objects)


def _remove_scene(own_scene: bpy.types.Scene) -> None:
    # Where the user's scene is gone, what was in it is the user's to keep.
    owner = user_scene_of(own_scene)
    keep = owner is None or own_scene.get(_OWNER) != _owner(owner)
    for collection in [c for c in own_scene.collection.children if own(c)]:
        for obj in list(collection.objects):
            if own(obj):
                _remove_object(obj, keep=keep)
        if not keep:
            _match_linked(collection, set())
        bpy.data.collections.remove(collection)
    bpy.data.scenes.remove(own_scene)


def _remove_object(obj: bpy.types.Object, *, keep: bool = False) -> None:
    data = obj.data
    source = source_of(obj) if obj.modifiers else None
    bpy.data.objects.remove(obj)
    if data.users == 0 and own(data):
        (bpy.data.lights if isinstance(data, bpy.types.Light) else bpy.data.meshes).remove(data)
    if source is not None and not keep:
        _let_go(source)


def _let_go(obj: bpy.types.Object) -> None:
    """Remove an object of the user's that only the extension still held.

    Deleted by the user, who could not know that: Blender unlinks what is in use elsewhere.
    """
    if obj.users == 0:
        bpy.data.objects.remove(obj)


def _own_scene(scene: bpy.types.Scene, role: str) -> bpy.types.Scene:
    made = bpy.data.scenes.new(hidden_name(role, scene.name))
    made[TAG] = role
    made[_GLASS], made[_OWNER] = scene.name, _owner(scene)
    return made


def _make_layers(scene: bpy.types.Scene, layers: Layers, panes: list[Pane], around: str) -> None:
    lookup, displaced = layers.lookup, layers.displaced
    occluders = _new_collection("occluders", lookup, layers.mask)
    _new_collection("lights", displaced)
    copies = {}
    hulls = {}
    for pane in panes:
        hull = _new_collection("hull", layers.mask)
        hull[_GLASS] = pane.key
        hull[_PATHS] = "\n".join(path_key(path) for path in pane.paths)
        hull[_RAYS] = pane.rays
        hulls[pane.key] = hull
        if not pane.borders:
            mesh = bpy.data.meshes.new(hidden_name("hull", pane.key))
            mesh.materials.append(mask_material())
            _new_object("hull", mesh, hull)
        for path in pane.drawn:
            made = _new_collection("copies", lookup, displaced)
            made[_GLASS], made[_PATH] = pane.key, path_key(path)
            made[_LAYER] = pane.layer(path)
            copies[pane.layer(path)] = made
            held = _new_collection("held", displaced)
            held[_GLASS], held[_PATH] = pane.key, path_key(path)
            held[_LAYER] = pane.layer(path)

    _make_around(scene, layers.around, panes, around)
    first = lookup.view_layers[0]
    first.name = DEPTH_LAYER
    first.material_override = depth_material()
    _show_only(first, occluders)
    names = [pane.layer(path) for pane in panes for path in pane.drawn]
    _name_layers(displaced, names)
    _name_layers(layers.mask, list(dict.fromkeys(pane.mask_layer for pane in panes)))
    for pane in panes:
        if pane.borders:
            continue
        # Light of all colours has the same outline: the last one's hull serves.
        mask = layers.mask.view_layers[pane.mask_layer]
        _show_only(mask, hulls[pane.key], occluders)
        for child in _layer_collections(mask):
            child.holdout = child.collection == occluders
        for path in pane.drawn:
            layer = lookup.view_layers.new(pane.layer(path))
            layer.material_override = lookup_material()
            _show_only(layer, copies[pane.layer(path)])
            layer = displaced.view_layers[pane.layer(path)]
            _show_only(layer, copies[pane.layer(path)], _child(displaced, "lights"))


def _make_around(
    scene: bpy.types.Scene, around: bpy.types.Scene, panes: list[Pane], mode: str
) -> None:
    _new_collection("shown", around)
    _new_collection("lamps", around)
    mesh = bpy.data.meshes.new(hidden_name("curtain", scene.name))
    mesh.materials.append(curtain_material())
    curtain = _new_object("curtain", mesh, _new_collection("curtain", around), scene.name)
    for kind in ("COPY_LOCATION", "COPY_ROTATION"):
        curtain.constraints.new(kind)
    _show_to_camera_only(curtain)
    names = []
    for pane in panes:
        meshes = {}
        for name, numbers in pane.ray_layers(mode).items():
            names.append(name)
            mirrored = name in pane.mirror_layers(mode)
            apart = mirrored and pane.has_borders
            mesh = meshes.get(apart)
            if mesh is None:
                mesh = meshes[apart] = bpy.data.meshes.new(hidden_name("screen", pane.key))
                mesh[TAG] = "screen"
                mesh.materials.append(None)
            if apart:
                numbers = range(SLOTS[scene.refractive_glass.surface])
            screen = _new_collection("screen", around)
            screen[_GLASS], screen[_LAYER] = pane.key, name
            screen[_MIRRORED] = mirrored
            obj = _new_object("screen", mesh, screen, pane.key, name)
            _show_to_camera_only(obj)
            slot = obj.material_slots[0]
            slot.link = "OBJECT"
            key = f"{scene.name} {pane.key} {name}"
            slot.material = ray_material(key, numbers, weighed=mirrored)
    _name_layers(around, list(dict.fromkeys(names)))


def _show_to_camera_only(obj: bpy.types.Object) -> None:
    for kind in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(obj, f"visible_{kind}", False)


def _name_layers(own_scene: bpy.types.Scene, names: list[str]) -> None:
    for number, name in enumerate(names):
        layer = own_scene.view_layers[0] if number == 0 else own_scene.view_layers.new(name)
        layer.name = name


def _new_collection(role: str, *scenes: bpy.types.Scene) -> bpy.types.Collection:
    collection = bpy.data.collections.new(hidden_name(role))
    collection[TAG] = role
    for scene in scenes:
        scene.collection.children.link(collection)
    return collection


def _child(scene: bpy.types.Scene, role: str) -> bpy.types.Collection:
    return next(c for c in scene.collection.children if own(c, role))


def _layer_collections(view_layer: bpy.types.ViewLayer):
    _synchronise(view_layer)
    return view_layer.layer_collection.children


def _synchronise(view_layer: bpy.types.ViewLayer) -> None:
    """Have Blender bring the layer's collections and objects up to date.

    Blender 5.2 puts that off, and does not make up for it when a render starts: the first layer of
    a new scene has no collections, and rendering such a layer crashes. Asking for the active
    collection does it, without an evaluation.
    """
    _ = view_layer.active_layer_collection


def _show_only(view_layer: bpy.types.ViewLayer, *shown: bpy.types.Collection) -> None:
    for child in _layer_collections(view_layer):
        child.exclude = child.collection not in shown


def _new_object(role: str, mesh: bpy.types.Mesh, collection, *parts: str) -> bpy.types.Object:
    mesh[TAG] = role
    obj = bpy.data.objects.new(hidden_name(role, *parts), mesh)
    obj[TAG] = role
    collection.objects.link(obj)
    return obj


def _match_sources(layers: Layers, panes: list[Pane], around: str) -> None:
    """One copy a glass, path and source, and one occluder a source; the others go."""
    wanted = {
        (pane.key, path_key(path), source.session_uid): source
        for pane in panes
        for path in pane.drawn
        for source in pane.carried(path, around)
    }
    existing = layers.copies()
    # Copies whose source is gone have no key any more.
    keep = {obj.name for key, obj in existing.items() if key in wanted}
    for collection in layers.lookup.collection.children:
        if own(collection, "copies"):
            for obj in [o for o in collection.objects if o.name not in keep]:
                _remove_object(obj)
    for collection in layers.lookup.collection.children:
        if not own(collection, "copies"):
            continue
        for (glass, path, uid), source in wanted.items():
            if (glass, path, uid) not in existing and (
                (collection[_GLASS], collection[_PATH]) == (glass, path)
            ):
                _new_carrier("copy", COPY_GROUP, source, collection)

    _match_held(layers, panes)
    seen = {source.session_uid: source for pane in panes for source in pane.sources}
    collection = _child(layers.lookup, "occluders")
    for obj in list(collection.objects):
        source = source_of(obj)
        if source is None or seen.pop(source.session_uid, None) is None:
            _remove_object(obj)
    for source in seen.values():
        _new_carrier("occluder", OCCLUDER_GROUP, source, collection)


def _match_held(layers: Layers, panes: list[Pane]) -> None:
    """Copies of what a glass holds are in a collection of their own as well."""
    held = {
        (pane.key, path_key(path)): {source.session_uid for source in pane.held_along(path)}
        for pane in panes
        for path in pane.drawn
    }
    copies = layers.copies()
    for collection in layers.displaced.collection.children:
        if own(collection, "held"):
            place = (collection[_GLASS], collection[_PATH])
            wanted = {
                o for (*at, uid), o in copies.items() if tuple(at) == place and uid in held[place]
            }
            _match_linked(collection, wanted)


def _new_carrier(role: str, group: str, source: bpy.types.Object, collection) -> None:
    mesh = bpy.data.meshes.new(hidden_name(role, source.name))
    obj = _new_object(role, mesh, collection, source.name)
    modifier = obj.modifiers.new(group, "NODES")
    modifier.node_group = load_group(group)
    write_input(modifier, "Source", source)
    if role == "occluder":
        write_input(modifier, "Carried", is_carried(source))


def _match_linked(collection: bpy.types.Collection, wanted: set[bpy.types.Object]) -> None:
    """Link exactly these of the user's own objects to the collection."""
    for obj in [o for o in collection.objects if o not in wanted]:
        collection.objects.unlink(obj)
        _let_go(obj)
    for obj in wanted - set(collection.objects):
        collection.objects.link(obj)


def _match_lamps(collection: bpy.types.Collection, lamps: set[bpy.types.Object]) -> None:
    """Stand-ins for the lamps, which rays that come from a glass see.

    A portal's rays are the camera's still, and cameras see no lamps unless told to; behind a real
    glass they are glossy rays, which do.
    """
    missing = set(lamps)
    for obj in list(collection.objects):
        lamp = obj.constraints[0].target
        if lamp in missing and _stands_for(obj.data, lamp.data):
            missing.discard(lamp)
        else:
            _remove_object(obj)
    for lamp in missing:
        stand_in = lamp.copy()
        stand_in.name = hidden_name("lamp", lamp.name)
        if lamp.data.node_tree is None:
            # Light of its own: with one user more Make Single User would copy what is the user's.
            stand_in.data = lamp.data.copy()
            stand_in.data.name = hidden_name("lamp", lamp.data.name)
            stand_in.data.use_fake_user = False
            stand_in.data.animation_data_clear()
            stand_in.data[TAG] = "lamp"
        stand_in.animation_data_clear()
        stand_in.constraints.clear()
        stand_in.modifiers.clear()
        stand_in.parent = None
        stand_in[TAG] = "lamp"
        stand_in.constraints.new("COPY_TRANSFORMS").target = lamp
        collection.objects.link(stand_in)
    for obj in collection.objects:
        lamp = obj.constraints[0].target
        if obj.visible_camera != lamp.visible_glossy:
            obj.visible_camera = lamp.visible_glossy


def _stands_for(stand_in: bpy.types.Light, light: bpy.types.Light) -> bool:
    """Whether a stand-in's light can be that of the lamp: its own, or the lamp's with its nodes."""
    if light.node_tree is not None:
        return stand_in == light
    return own(stand_in) and stand_in.type == light.type


def match_lights(layers: Layers, depsgraph: bpy.types.Depsgraph) -> None:
    """Give the lamps' stand-ins the light that the lamps have at this moment."""
    for obj in _child(layers.around, "lamps").objects:
        lamp, light = obj.constraints[0].target, obj.data
        if lamp is None or not own(light):
            continue
        now = lamp.evaluated_get(depsgraph).data
        kept = {name: getattr(light, name) for name in _OF_A_BLOCK}
        _copy_properties(now, light, kept)
        _copy_properties(now.cycles, light.cycles, {})


_OF_A_BLOCK = ("name", "use_fake_user", "use_extra_user", "is_runtime_data")
"""Of any data-block, whatever it holds."""


def match_settings(
    scene: bpy.types.Scene,
    layers: Layers,
    rect: tuple[int, int, int, int],
    true_shading: bool,
) -> None:
    """Give the own scenes the user's camera and render settings.

    Parameters
    ----------
    rect : the pixels that any glass covers; nothing else is rendered.
    true_shading : the copies are looked up; else they are drawn shaded only.
    """
    size = render_size(scene)
    around = surroundings(scene, "TRUE" if true_shading else "DISPLACED")
    picture: dict[str, object] = {"use_compositing": False}
    if not scene.render.use_border:
        picture |= {"use_border": True, "use_crop_to_border": False}
        for place, name in enumerate(("min_x", "min_y", "max_x", "max_y")):
            picture[f"border_{name}"] = rect[place] / size[place % 2]
    displaced: tuple[dict, dict] = {}, {}
    opened = any(path_of(key).open for keys, _ in layers.path_keys().values() for key in keys)
    if around or opened:
        # What the copies leave uncovered comes from the scene around, or from other paths.
        displaced[0]["film_transparent"] = True
    if true_shading:
        # Only slivers of what the glass holds come from here.
        displaced[1]["samples"] = max(1, scene.cycles.samples // FALLBACK_SHARE)
    _match(scene, layers.displaced, picture, *displaced, lit=True)
    _match(scene, layers.around, picture, *_around_settings(scene), lit=True)
    for own_scene, samples, width in (
        (layers.lookup, 1, 0.01),
        (layers.mask, MASK_SAMPLES, FILTER_WIDTH),
    ):
        _match(scene, own_scene, picture, *_emission_settings(samples, width), lit=False)
    _match_samples(scene, layers.around, around)
    _draw_all_or_held(layers.displaced, shows_objects(around) and true_shading)
    copied = bool(layers.path_keys().keys() - layers.by_rays().keys())
    for own_scene, used in (
        (layers.lookup, true_shading and copied),
        (layers.mask, copied),
        (layers.displaced, copied),
        (layers.around, bool(around)),
    ):
        for layer in own_scene.view_layers:
            shows = used and (own_scene in (layers.around, layers.mask) or not _is_empty(layer))
            if layer.use != shows:
                layer.use = shows


def _draw_all_or_held(displaced: bpy.types.Scene, held: bool) -> None:
    """Draw a path's copies, or only those of what the glass holds: rays do not meet that."""
    for view_layer in displaced.view_layers:
        for child in view_layer.layer_collection.children:
            collection = child.collection
            if own(collection, "copies") or own(collection, "held"):
                shown = own(collection, "held") == held
                here = collection[_LAYER] == view_layer.name
                if child.exclude == (shown and here):
                    child.exclude = not (shown and here)


def _is_empty(layer: bpy.types.ViewLayer) -> bool:
    """Whether the layer of a path has no copies."""
    shown = [c.collection for c in layer.layer_collection.children if not c.exclude]
    copies = [c for c in shown if own(c, "copies") or own(c, "held")]
    return bool(copies) and not any(c.objects for c in copies)


def _match(
    scene: bpy.types.Scene,
    own_scene: bpy.types.Scene,
    picture: dict[str, object],
    render: dict[str, object],
    cycles: dict[str, object],
    *,
    lit: bool,
) -> None:
    """Give an own scene the user's settings, but for those that are named.

    Only what differs is written: a write in a render's thread has all open views told, and a
    3D view with its own engine then crashes Blender 5.2, for want of a graphics context there.
    """
    _copy_properties(scene.render, own_scene.render, picture | render)
    if lit:
        _copy_properties(scene.cycles, own_scene.cycles, cycles)
        for group in ("eevee", "display"):
            _copy_properties(getattr(scene, group), getattr(own_scene, group), {})
    else:
        for name, value in cycles.items():
            _write(own_scene.cycles, name, value)
    _write(own_scene, "camera", scene.camera)
    _write(own_scene, "frame_current", scene.frame_current)
    _write(own_scene, "world", scene.world if lit else None)


_CONSTANT_ONCE = {
    "use_adaptive_sampling": True,
    "adaptive_threshold": 1e-5,
    "adaptive_min_samples": 4,
}
"""Cycles: pixels of which all samples are alike get no more of them; those with noise get all."""


def _around_settings(scene: bpy.types.Scene) -> tuple[dict, dict]:
    """Render and Cycles settings of the scene around."""
    by_cycles = scene.render.engine == "CYCLES"
    cycles = {
        "samples": scene.cycles.samples if by_cycles else scene.eevee.taa_render_samples,
        "use_layer_samples": "USE",
        # The way through the screen counts as a transparent bounce, and past the curtain.
        "transparent_max_bounces": scene.cycles.transparent_max_bounces + 3,
    }
    if not scene.cycles.use_adaptive_sampling:
        # A mirror that brings little light brings little noise: it needs no more samples than that.
        cycles |= {
            "use_adaptive_sampling": True,
            "adaptive_threshold": FAINT_NOISE / math.sqrt(max(1, cycles["samples"])),
            "adaptive_min_samples": 8,
        }
    if not by_cycles:
        cycles["pixel_filter_type"] = "BLACKMAN_HARRIS"
        cycles["filter_width"] = max(scene.render.filter_size, 0.01)
    return {"engine": "CYCLES", "use_motion_blur": False}, cycles


def _match_samples(scene: bpy.types.Scene, around: bpy.types.Scene, mode: str) -> None:
    """Few samples where the copies leave little to show."""
    samples = around.cycles.samples
    mirrors = {c[_LAYER] for c in around.collection.children if own(c, "screen") and c[_MIRRORED]}
    for layer in around.view_layers:
        worth = samples if layer.name in mirrors else samples // FALLBACK_SHARE
        if not shows_objects(mode):
            worth = WORLD_SAMPLES
        _write(layer, "samples", min(samples, max(worth, LEAST_SAMPLES)))


def _emission_settings(samples: int, filter_width: float) -> tuple[dict, dict]:
    """Cycles with nothing else in the picture than what the first surface emits."""
    render = {"engine": "CYCLES", "film_transparent": True, "use_motion_blur": False}
    cycles = {
        "device": "CPU",
        "samples": samples,
        **_CONSTANT_ONCE,
        "use_denoising": False,
        "pixel_filter_type": "BLACKMAN_HARRIS",
        "filter_width": filter_width,
        "film_exposure": 1.0,
        "max_bounces": 0,
        "transparent_max_bounces": 0,
        "sample_clamp_direct": 0.0,
    }
    return render, cycles


_WARNING = {"wireframe_color_type"}
"""Of wireframes alone, and Blender warns whenever a scene's is read."""


def _copy_properties(source, target, others: dict[str, object]) -> None:
    """Copy the plain settings of one property group to another; ``others`` have their own value."""
    for prop in source.bl_rna.properties:
        name = prop.identifier
        if prop.type == "POINTER":
            if name in {"shading", "ray_tracing_options"}:
                _copy_properties(getattr(source, name), getattr(target, name), {})
            continue
        if prop.is_readonly or prop.type == "COLLECTION" or name in _WARNING:
            continue
        value = others[name] if name in others else getattr(source, name)
        # A dynamic enum reads as empty where its present items do not hold the stored one.
        if not (prop.type == "ENUM" and value == ""):
            _write(target, name, value)


def _write(target, name: str, value) -> None:
    """Set a property that has another value."""
    present = getattr(target, name)
    if isinstance(value, float):
        # Blender may keep it in single precision.
        same = math.isclose(value, present, rel_tol=1e-6, abs_tol=1e-12)
    elif hasattr(value, "__len__") and not isinstance(value, (str, set)):
        same = tuple(value) == tuple(present)
    else:
        same = value == present
    if not same:
        counters["settings"] += 1
        setattr(target, name, value)
