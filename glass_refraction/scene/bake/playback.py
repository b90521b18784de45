# SPDX-License-Identifier: GPL-3.0-or-later
"""A baked scene: own objects and pictures that Blender plays back from files by itself.

The mark of a baked scene is on the extension's own node group in its compositor tree, so it goes
where the picture goes: the scene may be renamed, and what of it is undone is undone with the tree.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy

from ..build.compositor import group_node
from ..names import TAG, load_group, own
from ..read.modifier_inputs import read_input
from ..read.node_ends import trees
from ..read.viewpoint import render_size
from .files import (
    BAKE,
    CONTENTS,
    GEOMETRY,
    IMAGES,
    Contents,
    file_name,
    frame_ranges,
    image_file,
)

BAKED_GROUP = "Refractive Glass Baked"
under_way: set[int] = set()
"""Session uids of the scenes that are being baked."""


@dataclass(frozen=True)
class Baked:
    """What a baked scene plays back.

    Attributes
    ----------
    directory : the folder, as Blender writes paths (``//`` is the file's own folder).
    frames : the baked frames, as a reader writes them.
    first, last : before and after these frames the nearest one is held.
    size : width and height of the picture that it was baked for.
    shading : ``TRUE`` or ``DISPLACED``, as it took effect.
    """

    directory: str
    frames: str
    first: int
    last: int
    size: tuple[int, int]
    shading: str

    @property
    def folder(self) -> Path:
        return Path(bpy.path.abspath(self.directory))


def baked(scene: bpy.types.Scene) -> Baked | None:
    """What the scene plays back; None if it is computed."""
    group = composite_group(scene)
    if group is None or BAKE not in group:
        return None
    values = json.loads(group[BAKE])
    return Baked(**{**values, "size": tuple(values["size"])})


def is_held(scene: bpy.types.Scene) -> bool:
    """Whether the scene is not to be prepared or solved: it is baked, or a bake is at it."""
    return scene.session_uid in under_way or baked(scene) is not None


def bake_problems(scene: bpy.types.Scene) -> list[str]:
    """What of the scene no longer fits its bake, a line each; empty if it is not baked."""
    bake = baked(scene)
    if bake is None:
        return []
    found = []
    size = render_size(scene)
    if size != bake.size:
        found.append(
            f"Baked for {bake.size[0]} x {bake.size[1]} pixels, the picture has "
            f"{size[0]} x {size[1]}: bake again"
        )
    if scene.refractive_glass.shading != bake.shading:
        found.append(f"Baked for shading {bake.shading.title()}: bake again or set it back")
    if not (bake.folder / CONTENTS).is_file():
        found.append(f"The baked files in {bake.directory} are missing: bring them back or free")
    return found


def composite_group(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The extension's node group in the scene's compositor tree."""
    node = group_node(scene)
    return None if node is None else node.node_tree


def baked_scenes(scene: bpy.types.Scene) -> list[bpy.types.Scene]:
    """The own scenes that a baked scene plays back, whatever it is called by now."""
    group = composite_group(scene)
    return [s for s in bpy.data.scenes if group is not None and s.get(BAKE) == group and own(s)]


def bakeable_objects(own_scenes: list[bpy.types.Scene]) -> dict[str, bpy.types.Object]:
    """Folder name -> each own object that is rendered and that the extension writes each frame."""
    found: dict[str, bpy.types.Object] = {}
    for own_scene in own_scenes:
        for collection in own_scene.collection.children_recursive:
            for obj in collection.objects:
                if not own(obj) or obj.type != "MESH" or obj in found.values():
                    continue
                # Geometry Nodes alone stand such a one at its source's place.
                if _input(obj, "Carried"):
                    continue
                # The collection's properties say for which glass and path.
                parts = [str(collection[k]) for k in sorted(collection.keys()) if k != TAG]
                source = _input(obj, "Source")
                parts += [source.name] if source is not None else []
                name = file_name(obj[TAG], *parts)
                found[name if name not in found else file_name(obj[TAG], *parts, obj.name)] = obj
    return found


def bakeable_images(
    scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene]
) -> dict[str, bpy.types.Image]:
    """Folder name -> each own image that the extension writes frame by frame."""
    images = {node.image for node in _image_nodes(scene, own_scenes)}
    return {file_name(i.name.lstrip(".")): i for i in images}


def used_layers(own_scenes: list[bpy.types.Scene]) -> set[str]:
    """Names of the own view layers that are rendered now, which differ from frame to frame."""
    return {
        _layer_name(own_scene, layer)
        for own_scene in own_scenes
        for layer in own_scene.view_layers
        if layer.use
    }


def attach(
    scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene], directory: str, contents: Contents
) -> None:
    """Let the scene play the folder's frames back; nothing is computed any more.

    Parameters
    ----------
    directory : the folder, as Blender writes paths.
    """
    base = directory.rstrip("/\\")
    for name, obj in bakeable_objects(own_scenes).items():
        _play_geometry(obj, f"{base}/{GEOMETRY}/{name}")
    span = contents.span
    nodes = list(_image_nodes(scene, own_scenes))
    for name, image in bakeable_images(scene, own_scenes).items():
        image.filepath = f"{base}/{IMAGES}/{name}/{image_file(name, span.start)}"
        image.source = "SEQUENCE"
        for node in nodes:
            if node.image == image:
                # Of shaders a part of the node has what compositor nodes have themselves.
                user = getattr(node, "image_user", node)
                user.frame_start, user.frame_duration = span.start, len(span)
                # The file's number is the frame's.
                user.frame_offset = span.start - 1
                user.use_cyclic, user.use_auto_refresh = False, True
    for own_scene in own_scenes:
        for layer in own_scene.view_layers:
            layer.use = _layer_name(own_scene, layer) in contents.layers
    _take_cameras(scene, own_scenes)
    _set_border(scene, own_scenes, contents.border)
    bake = Baked(
        directory,
        frame_ranges(contents.frames),
        span.start,
        span.stop - 1,
        contents.size,
        contents.shading,
    )
    group = composite_group(scene)
    group[BAKE] = json.dumps(asdict(bake))
    for own_scene in own_scenes:
        own_scene[BAKE] = group


def detach(scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene]) -> None:
    """Undo :func:`attach`: what was played back is empty until it is computed."""
    for obj in bakeable_objects(own_scenes).values():
        for modifier in list(obj.modifiers):
            if own(modifier.node_group, "baked"):
                obj.modifiers.remove(modifier)
            else:
                modifier.show_render = modifier.show_viewport = True
    for image in bakeable_images(scene, own_scenes).values():
        if image.source == "SEQUENCE":
            image.source = "GENERATED"
            image.use_generated_float = True
            image.filepath = ""
    for own_scene in own_scenes:
        own_scene.timeline_markers.clear()
        own_scene.pop(BAKE, None)
    group = composite_group(scene)
    if group is not None and BAKE in group:
        del group[BAKE]


def _play_geometry(obj: bpy.types.Object, directory: str) -> None:
    # What the carrier held would only make the file larger.
    obj.data.clear_geometry()
    for slot in obj.material_slots:
        # Materials of the mesh itself do not come back from the files.
        if slot.link == "DATA":
            material = slot.material
            slot.link = "OBJECT"
            slot.material = material
    for modifier in obj.modifiers:
        modifier.show_render = modifier.show_viewport = False
    modifier = obj.modifiers.new(BAKED_GROUP, "NODES")
    modifier.node_group = load_group(BAKED_GROUP)
    bake = modifier.bakes[0]
    bake.bake_mode, bake.bake_target = "ANIMATION", "DISK"
    bake.use_custom_path, bake.directory = True, directory


def _image_nodes(
    scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene]
) -> Iterator[bpy.types.Node]:
    """The nodes with the extension's own images: in its compositor group, in own materials."""
    found = dict.fromkeys(trees(composite_group(scene)))
    for obj in bakeable_objects(own_scenes).values():
        materials = [slot.material for slot in obj.material_slots]
        found |= dict.fromkeys(t for m in materials if own(m) for t in trees(m.node_tree))
    for tree in found:
        yield from (node for node in tree.nodes if own(getattr(node, "image", None)))


def _layer_name(own_scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> str:
    return f"{own_scene[TAG]} {layer.name}"


def _take_cameras(scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene]) -> None:
    """Markers that switch the camera do so in the own scenes too."""
    for own_scene in own_scenes:
        own_scene.timeline_markers.clear()
        for marker in scene.timeline_markers:
            if marker.camera is not None:
                own_scene.timeline_markers.new(
                    marker.name, frame=marker.frame
                ).camera = marker.camera


def _set_border(scene: bpy.types.Scene, own_scenes: list[bpy.types.Scene], border) -> None:
    if scene.render.use_border:
        return
    for own_scene in own_scenes:
        render = own_scene.render
        render.border_min_x, render.border_min_y = border[:2]
        render.border_max_x, render.border_max_y = border[2:]


def _input(obj: bpy.types.Object, name: str):
    """An input of the object's own first modifier; None where it has none of that name."""
    if not obj.modifiers or obj.modifiers[0].node_group is None:
        return None
    names = {i.name for i in obj.modifiers[0].node_group.interface.items_tree}
    return read_input(obj.modifiers[0], name) if name in names else None
