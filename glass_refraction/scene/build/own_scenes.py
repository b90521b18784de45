# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of the extension's own: made, given the user's settings, found again and removed.

An own scene belongs to one scene of the user's, has a *role* and a number among its role's. It is
rendered because the user's compositor tree asks for it. Nothing is ever added to the user's own
view layers or collections.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterable, Mapping, Sequence

import bpy

from ..bake.files import BAKE
from ..memory import counters
from ..names import REFERENCE, TAG, hidden_name, load_group, own
from ..read.modifier_inputs import glass_modifier, has_input, read_input, write_input
from ..read.sources import is_carried

NUMBER = "refractive_glass_number"
"""Custom property of own scenes: which one of its role it is."""

_OWNER = "refractive_glass_owner"
_SCENE = "refractive_glass_name"

_SESSION = uuid.uuid4().hex
"""Blender numbers data-blocks anew in each session: in another this number is another's."""


def owner_of(scene: bpy.types.Scene) -> str:
    """What tells the user's scene from all others in this session, whatever it is called."""
    return f"{_SESSION} {scene.session_uid}"


def own_scene(scene: bpy.types.Scene, role: str, number: int = 0) -> bpy.types.Scene:
    """The own scene of a user's scene in that role; made if it is not there yet."""
    found = next((s for s in find_own_scenes(scene, (role,)) if s[NUMBER] == number), None)
    if found is not None:
        return found
    made = bpy.data.scenes.new(hidden_name(role, str(number), scene.name))
    made[TAG], made[NUMBER] = role, number
    made[_SCENE], made[_OWNER] = scene.name, owner_of(scene)
    return made


def find_own_scenes(
    scene: bpy.types.Scene, roles: Iterable[str] | None = None
) -> list[bpy.types.Scene]:
    """The own scenes of a user's scene, by role and number; of these roles, if any are given."""
    wanted = None if roles is None else set(roles)
    found = [
        candidate
        for candidate in bpy.data.scenes
        # What was linked with a library's scene is the library's.
        if own(candidate)
        and not candidate.library
        and (wanted is None or candidate[TAG] in wanted)
        and user_scene_of(candidate) == scene
    ]
    return sorted(found, key=lambda s: (s[TAG], s.get(NUMBER, 0)))


def list_objects(scenes: Iterable[bpy.types.Scene]) -> None:
    """Have Blender list anew what is in the scenes' view layers, where that is out of date.

    Adding or hiding an object anywhere makes all lists out of date. Blender 5.2 crashes where the
    compositor of a render names a scene whose list is: it lists the objects of its evaluated copy
    then, which lead to no originals.
    """
    for scene in scenes:
        for layer in scene.view_layers:
            # To read the active object lists them; to walk through the objects does not.
            getattr(layer.objects, "active")  # noqa: B009


def user_scene_of(own_scene: bpy.types.Scene) -> bpy.types.Scene | None:
    """The user's scene that an own scene belongs to."""
    users = [scene for scene in bpy.data.scenes if not own(scene)]
    for scene in users:
        if own_scene.get(_OWNER) == owner_of(scene):
            return scene
    # From a file.
    for scene in users:
        if _plays_back(scene, own_scene):
            return scene
    return next((s for s in users if (s.name, s.library) == (own_scene.get(_SCENE), None)), None)


def _plays_back(scene: bpy.types.Scene, own_scene: bpy.types.Scene) -> bool:
    """Whether the scene shows the own scene baked, be it renamed or without a glass meanwhile."""
    group, tree = own_scene.get(BAKE), scene.compositing_node_group
    if group is None or tree is None:
        return False
    return any(n.get(TAG) == "group" and n.node_tree == group for n in tree.nodes)


def remove_own_scenes(scene: bpy.types.Scene, roles: Iterable[str] | None = None) -> None:
    """Remove own scenes of a user's scene with everything in them that is the extension's."""
    for found in find_own_scenes(scene, roles):
        _remove_scene(found)


def remove_leftovers() -> None:
    """Remove what the extension made and nothing needs any more, in any scene.

    Own scenes of scenes that were deleted or have no glass any more, and own data-blocks without a
    user. Not while a render goes on: Blender 5.2 crashes where one finds a node group freed.
    """
    for candidate in [s for s in bpy.data.scenes if own(s) and not s.library]:
        if own(candidate, REFERENCE):
            continue
        owner = user_scene_of(candidate)
        if owner is None or not (_has_glass(owner) or _plays_back(owner, candidate)):
            _remove_scene(candidate)
    # What goes may have been the last to hold another. A scene that stands has no users: which of
    # them are left over is told above.
    while unused := [b for b in own_blocks() if b.users == 0 and b.id_type != "SCENE"]:
        _remove(unused)
    _remove(_unused_materials())


def own_blocks() -> list[bpy.types.ID]:
    """All own data-blocks that are no library's, scenes last."""
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.collections, bpy.data.node_groups)
    kinds += (bpy.data.materials, bpy.data.images, bpy.data.lights, bpy.data.cameras)
    kinds += (bpy.data.scenes,)
    return [block for kind in kinds for block in kind if own(block) and not block.library]


def _unused_materials() -> list[bpy.types.Material]:
    """The materials of glasses that no data-block names, whatever their number of users.

    Blender 5.2 counts what a modifier's inputs name once more with each save, and never less.
    """
    found = {m for m in bpy.data.materials if own(m, "glass") and not m.library}
    for obj in bpy.data.objects if found else ():
        modifier = glass_modifier(obj)
        if modifier is not None and has_input(modifier, "Material"):
            found.discard(read_input(modifier, "Material"))
    if not found:
        return []
    # All of the file is looked through: only where a glass was removed.
    users = bpy.data.user_map(subset=found)
    return [m for m in found if not users[m] and not m.use_fake_user]


def _has_glass(scene: bpy.types.Scene) -> bool:
    """Whether any glass may be shown in the scene, be it by an instance of its collection."""
    objects = set(scene.objects)
    for empty in scene.objects:
        if empty.instance_collection is not None:
            objects.update(empty.instance_collection.all_objects)
    return any(obj.type == "MESH" and glass_modifier(obj) is not None for obj in objects)


def _remove_scene(own_scene: bpy.types.Scene) -> None:
    # Where the user's scene is gone, what was in it is the user's to keep.
    owner = user_scene_of(own_scene)
    keep = owner is None or own_scene.get(_OWNER) != owner_of(owner)
    for collection in [c for c in own_scene.collection.children if own(c)]:
        remove_objects([o for o in collection.objects if own(o)], keep=keep)
        if not keep:
            match_linked(collection, set())
        bpy.data.collections.remove(collection)
    # Workbench and EEVEE keep a scene's depsgraph after a compositor rendered it, and Blender walks
    # through all depsgraphs whenever nodes are linked: it crashed where the scene was freed. This
    # setting has the engine freed.
    own_scene.render.use_persistent_data = False
    bpy.data.scenes.remove(own_scene)


def remove_objects(objects: Sequence[bpy.types.Object], *, keep: bool = False) -> None:
    """Remove own objects and their data, and what of the user's only they still held.

    ``keep``: that stays in the file. Else it was deleted by the user, who could not know who held
    it: Blender unlinks what is in use elsewhere.
    """
    data = {o.data for o in objects} - {None}
    sources = {source_of(o) for o in objects if o.modifiers and not keep} - {None}
    _remove(objects)
    _remove([d for d in data if d.users == 0 and own(d)])
    _remove([s for s in sources if s.users == 0])


def _remove(blocks: Sequence[bpy.types.ID]) -> None:
    """Remove data-blocks all at once: for each call Blender looks through the whole file."""
    if blocks:
        bpy.data.batch_remove(blocks)


def source_of(carrier: bpy.types.Object) -> bpy.types.Object | None:
    """The object that an own object shows; None for a baked object that has no source."""
    modifier = carrier.modifiers[0]
    if own(modifier.node_group, "baked") or not has_input(modifier, "Source"):
        return None
    return read_input(modifier, "Source")


def new_collection(role: str, scene: bpy.types.Scene) -> bpy.types.Collection:
    """A new own collection in an own scene."""
    collection = bpy.data.collections.new(hidden_name(role))
    collection[TAG] = role
    scene.collection.children.link(collection)
    return collection


def child_collection(scene: bpy.types.Scene, role: str) -> bpy.types.Collection:
    """The first own collection of that role in an own scene."""
    return next(c for c in scene.collection.children if own(c, role))


def new_object(role: str, data: bpy.types.ID, collection, *parts: str) -> bpy.types.Object:
    """A new own object, in an own collection, with own data."""
    data[TAG] = role
    obj = bpy.data.objects.new(hidden_name(role, *parts), data)
    obj[TAG] = role
    collection.objects.link(obj)
    return obj


def new_carrier(
    role: str, group: str, source: bpy.types.Object, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A new own mesh object whose node group takes another object's mesh."""
    mesh = bpy.data.meshes.new(hidden_name(role, source.name))
    obj = new_object(role, mesh, collection, source.name)
    modifier = obj.modifiers.new(group, "NODES")
    modifier.node_group = load_group(group)
    write_input(modifier, "Source", source)
    if role == "occluder":
        write_input(modifier, "Carried", is_carried(source))
    return obj


def match_linked(collection: bpy.types.Collection, wanted: set[bpy.types.Object]) -> None:
    """Link exactly these of the user's own objects to an own collection."""
    for obj in [o for o in collection.objects if o not in wanted]:
        collection.objects.unlink(obj)
        if obj.users == 0:
            # The user deleted it, see `remove_objects`.
            bpy.data.objects.remove(obj)
    for obj in wanted - set(collection.objects):
        collection.objects.link(obj)


def show_only(view_layer: bpy.types.ViewLayer, *shown: bpy.types.Collection) -> None:
    """Exclude all other collections from an own view layer."""
    synchronise(view_layer)
    for child in view_layer.layer_collection.children:
        exclude = child.collection not in shown
        if child.exclude != exclude:
            child.exclude = exclude


def synchronise(view_layer: bpy.types.ViewLayer) -> None:
    """Have Blender bring the layer's collections and objects up to date.

    Blender 5.2 puts that off, and does not make up for it when a render starts: the first layer of
    a new scene has no collections, and rendering such a layer crashes. Asking for the active
    collection does it, without an evaluation.
    """
    _ = view_layer.active_layer_collection


GROUPS = ("render", "cycles", "eevee", "display")
"""The groups of settings that :func:`match_settings` copies, as attributes of a scene."""


def match_settings(
    scene: bpy.types.Scene,
    own_scene: bpy.types.Scene,
    overrides: Mapping[str, Mapping[str, object]],
) -> None:
    """Give an own scene the user's render settings, camera, world and frame, but for some.

    Only what differs is written: a write in a render's thread has all open views told, and a
    3D view with its own engine then crashes Blender 5.2, for want of a graphics context there.

    Parameters
    ----------
    overrides : group -> setting -> value. Groups: those of ``GROUPS``, ``display.shading``, and
        ``scene`` for the scene's own (``camera``, ``world``).
    """
    _copy_properties(scene.render, own_scene.render, overrides.get("render", {}))
    for name in GROUPS[1:]:
        # A build of Blender may lack Cycles.
        if hasattr(scene, name):
            source, target = getattr(scene, name), getattr(own_scene, name)
            nested = {
                key.partition(".")[2]: values
                for key, values in overrides.items()
                if key.startswith(f"{name}.")
            }
            _copy_properties(source, target, overrides.get(name, {}), nested)
    # With the part of a frame that scripts may have gone on to.
    plain = {name: getattr(scene, name) for name in ("camera", "world", "frame_float")}
    for name, value in (plain | dict(overrides.get("scene", {}))).items():
        write_setting(own_scene, name, value)


_WARNING = {"wireframe_color_type"}
"""Of wireframes alone, and Blender warns whenever a scene's is read."""
_BUILT = {"denoiser"}
"""Enums whose items depend on how Blender was built: where they lack the value that is stored,
Blender warns whenever it is read."""
_NESTED = {"shading", "ray_tracing_options"}
"""Groups of settings within a group that are copied too."""


def _copy_properties(source, target, others: Mapping[str, object], nested=None) -> None:
    """Copy the plain settings of one property group to another; ``others`` have their own value."""
    nested = nested or {}
    for prop in source.bl_rna.properties:
        name = prop.identifier
        if prop.type == "POINTER":
            if name in _NESTED:
                _copy_properties(getattr(source, name), getattr(target, name), nested.get(name, {}))
            continue
        if prop.is_readonly or prop.type == "COLLECTION" or name in _WARNING:
            continue
        if name in _BUILT:
            _copy_stored(source, target, name)
            continue
        value = others[name] if name in others else getattr(source, name)
        # A dynamic enum reads as empty where its present items do not hold the stored one.
        if not (prop.type == "ENUM" and value == ""):
            write_setting(target, name, value)


def _copy_stored(source, target, name: str) -> None:
    """Copy an enum by its number, as files hold it; one that was never set stays the default."""
    stored = source.bl_system_properties_get()
    number = None if stored is None else stored.get(name)
    present = target.bl_system_properties_get()
    if number == (None if present is None else present.get(name)):
        return
    counters["settings"] += 1
    present = target.bl_system_properties_get(do_create=True)
    if number is None:
        del present[name]
    else:
        present[name] = number


def write_setting(target, name: str, value) -> None:
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
