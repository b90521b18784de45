# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of own layers."""

from __future__ import annotations

import bpy

from ..names import TAG, hidden_name


def object_colour_material() -> bpy.types.Material:
    """Emits the colour of the object that wears it, which Workbench shows without a material."""
    role = "object colour"
    for material in bpy.data.materials:
        if material.get(TAG) == role and material.library is None:
            return material
    material = bpy.data.materials.new(hidden_name(role))
    material[TAG] = role
    tree = material.node_tree
    tree.nodes.clear()
    info = tree.nodes.new("ShaderNodeObjectInfo")
    emission = tree.nodes.new("ShaderNodeEmission")
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(info.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
    return material


def math_node(tree: bpy.types.NodeTree, operation: str, *values) -> bpy.types.NodeSocket:
    """Add a Math node of plain values or sockets; returns its output socket."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for slot, value in enumerate(values):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, node.inputs[slot])
        else:
            node.inputs[slot].default_value = value
    return node.outputs[0]
