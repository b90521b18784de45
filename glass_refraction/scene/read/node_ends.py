# SPDX-License-Identifier: GPL-3.0-or-later
"""What leads to the output of a material's nodes."""

from __future__ import annotations

import bpy


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
