# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's compositor tree: one node group goes in behind the Render Layers node, and out again.

The tree keeps every node and link of the user's. What the Render Layers nodes' Image fed is fed
through the group meanwhile. What the group holds is built elsewhere.

Three kinds of own nodes stand in the tree: the *group*; *asking* Render Layers nodes, which have
the own scenes rendered; and a *joint* for each further Render Layers node of the same view layer.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..bake.files import BAKE
from ..names import TAG, hidden_name, own
from ..read.visibility import rendered_layer
from .own_scenes import user_scene_of

_SCENE = "refractive_glass_scene"
_FROM = "refractive_glass_from"
"""On a joint: the name of the Render Layers node that fed what it feeds."""
_RIGHT, _BELOW, _STEP = 280, 220, 50
"""Places of own nodes beside the Render Layers node, in the node editor's units."""


def insert_group(
    scene: bpy.types.Scene, tree: bpy.types.NodeTree, own_scenes: Sequence[bpy.types.Scene]
) -> bpy.types.Node:
    """Put a node group behind the scene's Render Layers nodes and have own scenes rendered.

    Parameters
    ----------
    tree : a compositor node tree with the inputs Image and Alpha and an output Image.
    own_scenes : the scenes whose view layers the group reads.

    Returns
    -------
    The group node. Where the scene has no compositor tree, one is made; it goes with the group.
    """
    node = group_node(scene)
    if node is not None and _is_copied(scene):
        remove_group(scene)
        node = None
    if node is None:
        node = _new_group_node(scene, tree, own_scenes[0])
    else:
        # In place, and the former group stays for now: Blender 5.2 crashes where a render that has
        # begun finds a tree or a node freed.
        node.node_tree = tree
        node[_SCENE] = scene.name
    _ask(node, scene, own_scenes)
    return node


def remove_group(scene: bpy.types.Scene) -> None:
    """Take the extension's nodes out of the scene's tree and join again what they stood between.

    A tree that the extension made goes too, unless the user has built on it. It and the group are
    freed by :func:`own_scenes.remove_leftovers`.
    """
    tree = scene.compositing_node_group
    if tree is None:
        return
    _take_out(nodes_of(scene))
    if own(tree, "compositor") and not _hand_over(tree):
        scene.compositing_node_group = None


def group_node(scene: bpy.types.Scene) -> bpy.types.Node | None:
    """The node of the extension's group in the scene's tree."""
    return next((n for n in nodes_of(scene) if n[TAG] == "group"), None)


def has_group(scene: bpy.types.Scene) -> bool:
    """Whether the scene's tree holds the extension's group for this scene."""
    node = group_node(scene)
    return node is not None and node.node_tree is not None and not _is_copied(scene)


def can_insert(scene: bpy.types.Scene) -> bool:
    """Whether the scene's tree has a place for the group: a Render Layers node of the scene."""
    tree = _users_tree(scene)
    return tree is None or bool(_render_layers(scene, tree))


def shown_scenes(scene: bpy.types.Scene) -> list[bpy.types.Scene]:
    """The user's other scenes whose layers the scene's tree shows."""
    tree = scene.compositing_node_group
    nodes = tree.nodes if tree is not None else ()
    shown = [n.scene for n in nodes if n.bl_idname == "CompositorNodeRLayers" and not n.mute]
    return [s for s in dict.fromkeys(shown) if s not in (None, scene) and not own(s)]


def remove_stray_nodes() -> None:
    """Take the extension's nodes out of trees that no scene shows any more.

    The user may have replaced a tree while they stood in it, the extension's own too. Those of a
    bake stay: nothing could make them again.
    """
    shown = {scene.compositing_node_group for scene in bpy.data.scenes}
    for tree in bpy.data.node_groups:
        if tree.bl_idname == "CompositorNodeTree" and tree not in shown:
            nodes = [n for n in tree.nodes if n.get(TAG)]
            groups = [n.node_tree for n in nodes if n[TAG] == "group"]
            if tree.is_editable and not any(g is not None and BAKE in g for g in groups):
                _take_out(nodes)
                if own(tree, "compositor"):
                    _hand_over(tree)


def _hand_over(tree: bpy.types.NodeTree) -> bool:
    """Let the user have a tree that the extension made if they built on it; whether they did."""
    if _is_plain(tree):
        return False
    del tree[TAG]
    tree.name = "Compositing"
    return True


def nodes_of(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    """The extension's nodes in the scene's tree but those of other scenes that share it."""
    tree = scene.compositing_node_group
    if tree is None:
        return []
    sharing = {s.name for s in bpy.data.scenes if s.compositing_node_group == tree and s != scene}
    return [n for n in tree.nodes if n.get(TAG) and n.get(_SCENE) not in sharing]


def as_if_in(own_scene: bpy.types.Scene):
    """A context in which a new Render Layers node takes the own scene.

    Blender counts the scene that it is made in as used once more than it is, for ever.
    """
    return bpy.context.temp_override(scene=own_scene)


def _new_group_node(
    scene: bpy.types.Scene, group: bpy.types.NodeTree, own_scene: bpy.types.Scene
) -> bpy.types.Node:
    """A node of the group behind the Render Layers nodes."""
    tree = _users_tree(scene) or _plain_tree(scene, own_scene)
    first, *others = _render_layers(scene, tree)
    node = _own_node(tree, scene, "CompositorNodeGroup", "group")
    node.node_tree = group
    node.label = "Refractive Glass"
    node.location = (first.location.x + _RIGHT, first.location.y)
    _move_links(tree, first.outputs["Image"], node.outputs["Image"])
    for render_layers in others:
        if not render_layers.outputs["Image"].links:
            continue
        joint = _own_node(tree, scene, "NodeReroute", "joint")
        joint[_FROM] = render_layers.name
        joint.location = (render_layers.location.x + _RIGHT, render_layers.location.y)
        _move_links(tree, render_layers.outputs["Image"], joint.outputs[0])
        tree.links.new(node.outputs["Image"], joint.inputs[0])
    tree.links.new(first.outputs["Image"], node.inputs["Image"])
    tree.links.new(first.outputs["Alpha"], node.inputs["Alpha"])
    return node


def _move_links(tree: bpy.types.NodeTree, former, new) -> None:
    """Have one output feed what another fed; links that are muted stay so."""
    for target, muted in [(link.to_socket, link.is_muted) for link in former.links]:
        # An input takes one link: the new one takes the former one's place.
        tree.links.new(new, target).is_muted = muted


def _ask(node: bpy.types.Node, scene: bpy.types.Scene, own_scenes) -> None:
    """Have the own scenes rendered: Blender 5.0 does only if the tree itself asks, not a group."""
    tree = node.id_data
    asking = [n for n in nodes_of(scene) if n[TAG] == "asking"]
    for number in range(len(asking), len(own_scenes)):
        with as_if_in(own_scenes[number]):
            made = _own_node(tree, scene, "CompositorNodeRLayers", "asking")
        made.hide = True
        made.location = (node.location.x, node.location.y - _BELOW - _STEP * number)
        asking.append(made)
    for number, asks in enumerate(asking):
        # One too many asks once more.
        asks.scene = own_scenes[min(number, len(own_scenes) - 1)]
        asks.label = f"Refractive Glass: {asks.scene[TAG]}"
        asks[_SCENE] = scene.name


def _own_node(
    tree: bpy.types.NodeTree, scene: bpy.types.Scene, idname: str, role: str
) -> bpy.types.Node:
    """A node of the extension's in the user's tree: not selected, and no name taken."""
    active = tree.nodes.active
    node = tree.nodes.new(idname)
    node[TAG], node[_SCENE] = role, scene.name
    node.name = hidden_name(role)
    node.select = False
    tree.nodes.active = active
    return node


def _take_out(nodes: list[bpy.types.Node]) -> None:
    """Remove own nodes; what the group and joints stood between is joined again."""
    for node in sorted(nodes, key=lambda n: n[TAG] != "joint"):
        tree = node.id_data
        if node[TAG] == "joint":
            fed = tree.nodes.get(node[_FROM])
            # Renamed or deleted meanwhile: the group's own source shows the same layer.
            source = (
                fed.outputs["Image"] if fed is not None else node.inputs[0].links[0].from_socket
            )
            _move_links(tree, node.outputs[0], source)
        if node[TAG] == "group" and node.inputs["Image"].is_linked:
            _move_links(tree, node.outputs["Image"], node.inputs["Image"].links[0].from_socket)
        tree.nodes.remove(node)


def _is_copied(scene: bpy.types.Scene) -> bool:
    """Whether the nodes came with a copy of another scene: what they ask for is that one's.

    Names do not tell: either scene may have been renamed.
    """
    asked = [n.scene for n in nodes_of(scene) if n[TAG] == "asking"]
    return any(own_scene is None or user_scene_of(own_scene) != scene for own_scene in asked)


def _users_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The scene's tree; None if the extension made it, perhaps for the scene this is a copy of."""
    tree = scene.compositing_node_group
    if own(tree, "compositor") and _is_plain(tree):
        return None
    return tree


def _is_plain(tree: bpy.types.NodeTree) -> bool:
    """Whether an own tree is as it was made, the extension's nodes left out."""
    nodes = [n.bl_idname for n in tree.nodes if not n.get(TAG)]
    return sorted(nodes) == ["CompositorNodeRLayers", "NodeGroupOutput"]


def _plain_tree(scene: bpy.types.Scene, own_scene: bpy.types.Scene) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new(hidden_name("compositor", scene.name), "CompositorNodeTree")
    tree[TAG] = "compositor"
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    with as_if_in(own_scene):
        render_layers = tree.nodes.new("CompositorNodeRLayers")
    render_layers.scene = scene
    render_layers.layer = rendered_layer(scene).name
    end = tree.nodes.new("NodeGroupOutput")
    end.location = (600, 0)
    tree.links.new(render_layers.outputs["Image"], end.inputs["Image"])
    scene.compositing_node_group = tree
    return tree


def _render_layers(scene: bpy.types.Scene, tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The user's Render Layers nodes of the view layer that the glass is computed in.

    Without one of that layer, the first of the scene.
    """
    nodes = [
        n
        for n in tree.nodes
        if n.bl_idname == "CompositorNodeRLayers" and n.scene == scene and not n.get(TAG)
    ]
    layer = rendered_layer(scene).name
    return [n for n in nodes if n.layer == layer] or nodes[:1]
