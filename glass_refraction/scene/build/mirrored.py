# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses as mirrors and windows show them, in Cycles: real glass, which cameras do not see.

The engine renders the picture without glasses, so a polished floor would show none, nor would a
window before them that is of the engine's own glass. Each glass's modifier instances an own object,
which only mirrored and refracted rays meet. What that object is of is a frame's: nothing, where no
mirror and no window shows a glass.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ..memory import counters
from ..names import hidden_name, own
from ..progress import in_main_thread
from ..read.glasses import Glass
from ..read.modifier_inputs import glass_modifier, has_input, read_input, write_input
from .glass_material import Interface, glass_shader, surface_look
from .glass_mesh import Surface, fill_mesh, film, glass_surfaces
from .own_scenes import new_collection, new_object, remove_objects, show_only
from .shaders import math_node, met_where, new_surface, own_material

MIRRORED = "mirrored"
"""Role of the objects and of their material."""
INPUT = "In Mirrors"
"""Of the glass's modifier: the object that is instanced."""
SEGMENTS = 256
"""Facets round a full circle: mirror images are small, and normals are exact."""
_GLASS = "refractive_glass_of"
"""Property of an own object: session uid of its glass."""
_ETA, _ROUGHNESS, _COLOUR, _BEFORE, _BEHIND, _THROUGH = (
    f"rg_{name}" for name in ("eta", "roughness", "colour", "before", "behind", "through")
)
"""Attributes of faces: fields of `Interface`, and whether refracted rays meet them."""


def prepare_mirrored(
    scene: bpy.types.Scene, cast: bpy.types.Scene, glasses: Iterable[bpy.types.Object]
) -> None:
    """Have each glass instance an own object, if the scene's engine is Cycles.

    Parameters
    ----------
    cast : the own scene that holds them; it shows none. glasses : objects that can be written.
    """
    collection = _collection(cast)
    if collection is None:
        collection = new_collection(MIRRORED, cast)
    wanted = {}
    if scene.render.engine == "CYCLES":
        wanted = {g.session_uid: g for g in glasses if has_input(glass_modifier(g), INPUT)}
    standing = {obj[_GLASS]: obj for obj in collection.objects}
    remove_objects([obj for uid, obj in standing.items() if uid not in wanted])
    for uid, glass in wanted.items():
        obj = standing.get(uid) or _new(collection, glass)
        write_input(glass_modifier(glass), INPUT, obj)
    shown = [c for c in cast.collection.children if c != collection]
    for layer in cast.view_layers:
        show_only(layer, *shown)


def _collection(cast: bpy.types.Scene) -> bpy.types.Collection | None:
    return next((c for c in cast.collection.children if own(c, MIRRORED)), None)


def _new(collection: bpy.types.Collection, glass: bpy.types.Object) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(hidden_name(MIRRORED, glass.name))
    obj = new_object(MIRRORED, mesh, collection, glass.name)
    obj[_GLASS] = glass.session_uid
    mesh.materials.append(own_material(MIRRORED, _build_material))
    for kind in ("camera", "diffuse", "volume_scatter", "shadow"):
        setattr(obj, f"visible_{kind}", False)
    return obj


def _build_material(tree: bpy.types.NodeTree) -> None:
    """Glass whose faces tell what they are; rays of light that something scattered pass it.

    A matte surface's light is followed by the extension itself, without noise.
    """

    def parts(name: str) -> Sequence[bpy.types.NodeSocket]:
        split = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(_attribute(tree, name).outputs["Vector"], split.inputs[0])
        return split.outputs

    interface = Interface(
        _attribute(tree, _ETA).outputs["Factor"],
        (parts(_BEFORE), parts(_BEHIND)),
        _attribute(tree, _ROUGHNESS).outputs["Factor"],
        parts(_COLOUR),
    )
    shader = glass_shader(tree, interface)
    ray = tree.nodes.new("ShaderNodeLightPath").outputs
    through = _attribute(tree, _THROUGH).outputs["Factor"]
    refracted = math_node(tree, "MULTIPLY", ray["Transmission Depth"], through)
    images = math_node(tree, "MAXIMUM", ray["Glossy Depth"], refracted)
    seen = math_node(
        tree, "GREATER_THAN", images, math_node(tree, "MULTIPLY", ray["Diffuse Depth"], 1e3)
    )
    new_surface(tree, met_where(tree, seen, shader.outputs[0]))


def _attribute(tree: bpy.types.NodeTree, name: str) -> bpy.types.ShaderNode:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = name
    return node


def write_mirrored(
    cast: bpy.types.Scene,
    glasses: Sequence[Glass],
    places: dict[str, np.ndarray],
    known: dict[int, tuple],
    *,
    through: bool,
) -> set[str]:
    """Make the own objects of these glasses real glass, and those of all others nothing.

    Parameters
    ----------
    places : name -> (4, 4) of the object that is that glass, in the world; of those that stand
        there themselves.
    known : session uid of an own object -> stamp of what it holds; written.
    through : rays meet it that other glass has refracted, beside those that were mirrored.

    Returns
    -------
    The names of the glasses in these places that have such an object; none, if the main thread had
    no time to write it.
    """
    # Objects come before their instances.
    by_name = {glass.name: glass for glass in reversed(glasses) if glass.name in places}
    collection = _collection(cast)
    objects = list(collection.objects) if collection is not None else []
    uids = {obj[_GLASS] for obj in objects}
    names = {obj.session_uid: obj.name for obj in bpy.data.objects if obj.session_uid in uids}
    changed: list[tuple[bpy.types.Mesh, _Filling]] = []
    stamps, found = {}, set()
    for obj in objects:
        name = names.get(obj[_GLASS], "")
        if name in places:
            found.add(name)
        glass, stamp = by_name.get(name), ()
        if glass is not None:
            stamp = (glass.stamp(), places[name].tobytes(), through)
        if known.get(obj.session_uid, None if obj.data.vertices else ()) == stamp:
            continue
        stamps[obj.session_uid] = stamp
        to_local = None if glass is None else np.linalg.inv(places[name])
        changed.append((obj.data, _filling(glass, to_local, through)))

    def write() -> None:
        for mesh, filling in changed:
            counters["mirrored"] += 1
            _fill(mesh, filling)
        known.update(stamps)

    # 3D views have evaluated the objects too.
    return found if not changed or in_main_thread(write) else set()


@dataclass(frozen=True)
class _Filling:
    """What a mesh is filled with: interfaces, and attributes (name, kind, field, values a face)."""

    surfaces: Sequence[Surface] = ()
    attributes: Sequence[tuple[str, str, str, np.ndarray]] = ()


def _filling(glass: Glass | None, to_local: np.ndarray | None, through: bool) -> _Filling:
    """A glass's interfaces, each face with what it is; of None nothing."""
    if glass is None:
        return _Filling()
    surfaces = glass_surfaces(glass.description, segments=SEGMENTS)
    points = np.concatenate([surface.vertices for surface in surfaces])
    matrix = to_local @ glass.to_world @ film(points)
    faces, media = [len(surface.sizes) for surface in surfaces], glass.description.media
    tints = np.array(glass.absorption if glass.is_tinted else ((0.0,) * 3,) * len(media))
    before, behind = (tints[[s.media[side] for s in surfaces]] for side in (0, 1))
    looks = np.concatenate([_looks(glass, surface) for surface in surfaces])
    eta = np.array([surface.ior_inside / surface.ior_outside for surface in surfaces])
    attributes = (
        (_ETA, "FLOAT", "value", eta),
        (_THROUGH, "FLOAT", "value", np.full(len(faces), float(through))),
        (_BEFORE, "FLOAT_VECTOR", "vector", before),
        (_BEHIND, "FLOAT_VECTOR", "vector", behind),
    )
    return _Filling(
        [surface.moved(matrix) for surface in surfaces],
        [
            (_ROUGHNESS, "FLOAT", "value", looks[:, 0]),
            (_COLOUR, "FLOAT_VECTOR", "vector", looks[:, 1:]),
            *((*where, np.repeat(values, faces, axis=0)) for *where, values in attributes),
        ],
    )


def _looks(glass: Glass, surface: Surface) -> np.ndarray:
    """(F, 4) roughness and colour of each face of a glass's surface."""
    if surface.finish is None:
        roughness, colour, _ = surface_look(glass)
        return np.tile((roughness, *colour), (len(surface.sizes), 1))
    begins = np.cumsum(surface.sizes) - surface.sizes
    return np.add.reduceat(surface.finish[:, :4], begins) / surface.sizes[:, None]


def _fill(mesh: bpy.types.Mesh, filling: _Filling) -> None:
    mesh.clear_geometry()
    if filling.surfaces:
        fill_mesh(mesh, filling.surfaces)
    for name, kind, field, values in filling.attributes:
        attribute = mesh.attributes.new(name, kind, "FACE")
        attribute.data.foreach_set(field, values.astype("f4").ravel())
    mesh.update()


def remove_mirrored(cast: bpy.types.Scene) -> None:
    """Let go of what glasses instance; the own scene takes the objects along."""
    for obj in bpy.data.objects:
        modifier = glass_modifier(obj) if obj.type == "MESH" and obj.is_editable else None
        if modifier is None or not has_input(modifier, INPUT):
            continue
        held = read_input(modifier, INPUT)
        if own(held, MIRRORED) and cast in held.users_scene:
            write_input(modifier, INPUT, None)
