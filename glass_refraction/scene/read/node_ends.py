# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees: the groups in them, what leads to their output, and what they ask for."""

from __future__ import annotations

from collections.abc import Container

import bpy

TOLD_APART = {"Is Camera Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray"}
TOLD_APART |= {"Is Transmission Ray", "Ray Length", "Ray Depth", "Diffuse Depth", "Glossy Depth"}
TOLD_APART |= {"Transparent Depth", "Transmission Depth", "Portal Depth"}
"""Outputs of a Light Path node by which a camera's ray and one through glass may differ."""
OF_CAMERAS = {"Is Camera Ray", "Is Transmission Ray", "Is Singular Ray"}
"""Those that are the same behind one pane as behind any glass."""


def trees(tree: bpy.types.NodeTree | None) -> list[bpy.types.NodeTree]:
    """A tree and all groups in it, each once; of None none."""
    found, waiting = {}, [tree]
    while waiting:
        tree = waiting.pop()
        if tree is not None and tree not in found:
            found[tree] = None
            waiting += [node.node_tree for node in tree.nodes if node.type == "GROUP"]
    return list(found)


def leading_node(
    tree: bpy.types.NodeTree | None, socket: str, kind: str
) -> bpy.types.ShaderNode | None:
    """The node of a kind that leads to a socket of a tree's output.

    None where there is none, where another node does, and where it or its link is muted.
    """
    end = tree.get_output_node("ALL") if tree is not None else None
    links = end.inputs[socket].links if end is not None else ()
    if not links or links[0].is_muted:
        return None
    node = links[0].from_node
    return node if node.type == kind and not node.mute else None


def asks_for(tree: bpy.types.NodeTree | None, kind: str, outputs: Container[str]) -> bool:
    """Whether a node of a kind, in the tree or its groups, has any of these outputs linked."""
    for node in tree.nodes if tree is not None else ():
        if node.mute:
            continue
        if node.type == kind and any(o.is_linked and o.name in outputs for o in node.outputs):
            return True
        if node.type == "GROUP" and asks_for(node.node_tree, kind, outputs):
            return True
    return False
