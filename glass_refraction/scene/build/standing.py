# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether all that was made for a scene still stands.

Scripts that clear a file (``for mesh in bpy.data.meshes: bpy.data.meshes.remove(mesh)``) take the
extension's data-blocks along with the user's.
"""

from __future__ import annotations

import bpy

from ..names import REFERENCE, own
from .compositor import group_node
from .own_scenes import find_own_scenes, user_scene_of


def made_for(scene: bpy.types.Scene) -> frozenset[int]:
    """Session uids of the own data-blocks that the scene's picture is made of."""
    return frozenset(block.session_uid for block in blocks_of(scene))


def blocks_of(scene: bpy.types.Scene) -> list[bpy.types.ID]:
    """These data-blocks; some may come more than once."""
    group = group_node(scene)
    blocks = held_by(group.node_tree if group is not None else None)
    for own_scene in find_own_scenes(scene):
        blocks += _in_own_scene(own_scene)
    return [block for block in blocks if own(block)]


def strays() -> list[bpy.types.ID]:
    """Own data-blocks of scenes that were deleted and of trees that nothing uses any more.

    They go with the next preparation. The materials and the modifier of glasses are the file's.
    """
    blocks: list[bpy.types.ID | None] = []
    for own_scene in [s for s in bpy.data.scenes if own(s) and user_scene_of(s) is None]:
        blocks += _in_own_scene(own_scene)
    for tree in bpy.data.node_groups:
        if own(tree, "composite") and tree.users == 0:
            blocks += held_by(tree)
    return [b for b in blocks if own(b) and not own(b, "glass") and b.library is None]


def _in_own_scene(own_scene: bpy.types.Scene) -> list[bpy.types.ID | None]:
    """The scene with all that is in it, also what is the user's. A comparison removes its own."""
    if own(own_scene, REFERENCE):
        return []
    found: list[bpy.types.ID | None] = [own_scene, *own_scene.collection.children]
    for obj in filter(own, own_scene.collection.all_objects):
        found += [obj, obj.data, *(obj.data.materials if obj.type == "MESH" else ())]
        found += [modifier.node_group for modifier in obj.modifiers]
    return found


def held_by(tree: bpy.types.NodeTree | None) -> list[bpy.types.ID | None]:
    """A node tree with the trees and images in it."""
    found: list[bpy.types.ID | None] = [tree]
    for node in tree.nodes if tree is not None else ():
        if node.bl_idname == "CompositorNodeGroup":
            found += held_by(node.node_tree)
        elif node.bl_idname == "CompositorNodeImage":
            found.append(node.image)
    return found
