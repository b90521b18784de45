# SPDX-License-Identifier: GPL-3.0-or-later
"""What node trees are built from: sums and products of pictures or vectors, node by node."""

from __future__ import annotations

import bpy


class NodeSums:
    """Adds nodes to ``tree``; values are sockets or constants."""

    tree: bpy.types.NodeTree

    def _with_alpha(self, colour, alpha):
        split = self._node("ShaderNodeSeparateXYZ")
        self._link(colour, split.inputs[0])
        join = self._node("CompositorNodeCombineColor")
        for slot in range(3):
            self._link(split.outputs[slot], join.inputs[slot])
        self._link(alpha, join.inputs["Alpha"])
        return join.outputs[0]

    def _scaled(self, colour, factor):
        node = self._node("ShaderNodeVectorMath", operation="SCALE")
        self._feed(colour, node.inputs[0])
        self._feed(factor, node.inputs["Scale"])
        return node.outputs[0]

    def _vector(self, operation: str, *values):
        node = self._node("ShaderNodeVectorMath", operation=operation)
        for value, socket in zip(values, node.inputs, strict=False):
            self._feed(value, socket)
        return node.outputs["Value" if operation in {"DOT_PRODUCT", "DISTANCE"} else "Vector"]

    def _math(self, operation: str, first, second, *, clamp: bool = False):
        node = self._node("ShaderNodeMath", operation=operation, use_clamp=clamp)
        for slot, value in enumerate((first, second)):
            self._feed(value, node.inputs[slot])
        return node.outputs[0]

    def _feed(self, value, target) -> None:
        """Link an output to an input, or set the input to a constant."""
        if isinstance(value, bpy.types.NodeSocket):
            self._link(value, target)
        else:
            target.default_value = value

    def _node(self, idname: str, **properties):
        node = self.tree.nodes.new(idname)
        count = len(self.tree.nodes)
        node.location = (190 * (count // 8), -190 * (count % 8))
        for key, value in properties.items():
            setattr(node, key, value)
        return node

    def _link(self, source, target) -> None:
        self.tree.links.new(source, target)
