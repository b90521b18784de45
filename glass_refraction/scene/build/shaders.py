# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of the own layers: where to look, how deep, and whether the glass is seen."""

from __future__ import annotations

import bpy

from ..names import TAG, hidden_name


def lookup_material() -> bpy.types.Material:
    """Emits where the surface's true place is in the direct picture.

    Red, green: picture coordinates 0 to 1; blue: 1 / depth of the true place. The division happens
    here, per pixel, on the linearly interpolated ``rg_lookup`` (x, y, w, depth). A place behind
    the camera gets coordinates outside the picture.
    """
    material, tree, new = _own_material("lookup")
    if not new:
        return material
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "rg_lookup"
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    join = tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(attribute.outputs["Vector"], split.inputs[0])
    w = split.outputs["Z"]
    in_front = math_node(tree, "GREATER_THAN", w, 1e-9)
    for axis, name in enumerate("XY"):
        inside = math_node(tree, "DIVIDE", split.outputs[name], w)
        shifted = math_node(tree, "ADD", math_node(tree, "MULTIPLY", inside, in_front), -9.0)
        chosen = math_node(tree, "ADD", shifted, math_node(tree, "MULTIPLY", in_front, 9.0))
        tree.links.new(chosen, join.inputs[axis])
    tree.links.new(math_node(tree, "DIVIDE", 1.0, attribute.outputs["Alpha"]), join.inputs[2])
    _emit(tree, join.outputs[0])
    return material


def depth_material() -> bpy.types.Material:
    """Emits 1 / depth: affine over the picture of a plane, so it may be interpolated there."""
    material, tree, new = _own_material("depth")
    if new:
        camera = tree.nodes.new("ShaderNodeCameraData")
        _emit(tree, math_node(tree, "DIVIDE", 1.0, camera.outputs["View Z Depth"]))
    return material


def mask_material() -> bpy.types.Material:
    """White: only coverage counts."""
    material, tree, new = _own_material("mask")
    if new:
        white = tree.nodes.new("ShaderNodeRGB")
        white.outputs[0].default_value = (1.0, 1.0, 1.0, 1.0)
        _emit(tree, white.outputs[0])
    return material


def curtain_material() -> bpy.types.Material:
    """Black from the front, clear from the back."""
    material, tree, new = _own_material("curtain")
    if not new:
        return material
    side = tree.nodes.new("ShaderNodeNewGeometry")
    shown = tree.nodes.new("ShaderNodeMixShader")
    black = tree.nodes.new("ShaderNodeEmission")
    black.inputs["Strength"].default_value = 0.0
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(side.outputs["Backfacing"], shown.inputs[0])
    tree.links.new(black.outputs[0], shown.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], shown.inputs[2])
    tree.links.new(shown.outputs[0], end.inputs["Surface"])
    return material


def _own_material(role: str):
    """The extension's material in that role, its emptied node tree, and whether it is new."""
    for material in bpy.data.materials:
        if material.get(TAG) == role and material.library is None:
            return material, material.node_tree, False
    material = bpy.data.materials.new(hidden_name(role))
    material[TAG] = role
    material.node_tree.nodes.clear()
    return material, material.node_tree, True


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


def _emit(tree, colour) -> None:
    emission = tree.nodes.new("ShaderNodeEmission")
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(colour, emission.inputs["Color"])
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
