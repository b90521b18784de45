# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of own layers."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ..names import TAG, hidden_name, own


def own_material(role: str, build: Callable[[bpy.types.NodeTree], None]) -> bpy.types.Material:
    """The own material of that role; ``build`` fills the tree of one that is not there yet."""
    found = (m for m in bpy.data.materials if own(m, role) and not m.library)
    material = next(found, None)
    if material is None:
        material = bpy.data.materials.new(hidden_name(role))
        material[TAG] = role
        material.node_tree.nodes.clear()
        build(material.node_tree)
    return material


def object_colour_material() -> bpy.types.Material:
    """Emits the colour of the object that wears it, which Workbench shows without a material."""
    return own_material("object colour", _emit_object_colour)


def _emit_object_colour(tree: bpy.types.NodeTree) -> None:
    info = tree.nodes.new("ShaderNodeObjectInfo")
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(info.outputs["Color"], emission.inputs["Color"])
    new_surface(tree, emission.outputs[0])


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


def met_where(
    tree: bpy.types.NodeTree, meets: bpy.types.NodeSocket, shader: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """A shader for rays for which ``meets`` is 1; others go on as though nothing were there."""
    mix = tree.nodes.new("ShaderNodeMixShader")
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    for socket, slot in zip((meets, clear.outputs[0], shader), mix.inputs, strict=True):
        tree.links.new(socket, slot)
    return mix.outputs[0]


def new_surface(tree: bpy.types.NodeTree, shader: bpy.types.NodeSocket) -> bpy.types.ShaderNode:
    """The material's output, whose surface is the shader."""
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader, end.inputs["Surface"])
    return end
