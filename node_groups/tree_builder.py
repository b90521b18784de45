# SPDX-License-Identifier: GPL-3.0-or-later
"""The few steps that every node group is built from: sockets, nodes and links by name."""

from __future__ import annotations

import bpy

TAG = "refractive_glass"


class TreeBuilder:
    """Builds one Geometry Nodes group; nodes are laid out in the order they are made."""

    def __init__(self, name: str, role: str) -> None:
        old = bpy.data.node_groups.get(name)
        if old is not None:
            bpy.data.node_groups.remove(old)
        self.tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
        self.tree[TAG] = role
        self._column = 0

    def socket(
        self,
        name: str,
        kind: str,
        *,
        output: bool = False,
        default=None,
        minimum: float | None = None,
        maximum: float | None = None,
        subtype: str | None = None,
        description: str = "",
        hidden: bool = False,
    ):
        """Add an interface socket; ``kind`` is the part of its idname behind ``NodeSocket``."""
        item = self.tree.interface.new_socket(
            name,
            in_out="OUTPUT" if output else "INPUT",
            socket_type=f"NodeSocket{kind}",
            description=description,
        )
        if subtype is not None:
            item.subtype = subtype
        if minimum is not None:
            item.min_value = minimum
        if maximum is not None:
            item.max_value = maximum
        if default is not None:
            item.default_value = default
        item.hide_in_modifier = hidden
        return item

    def node(self, kind: str, *, label: str = "", **properties):
        """Add a node; ``kind`` without its ``GeometryNode`` prefix, or a full idname."""
        idname = (
            kind
            if kind.startswith(("ShaderNode", "NodeGroup", "Function"))
            else f"GeometryNode{kind}"
        )
        node = self.tree.nodes.new(idname)
        node.label = label
        node.location = (200 * self._column, -40 * (self._column % 5))
        self._column += 1
        for key, value in properties.items():
            setattr(node, key, value)
        return node

    def link(self, source, target) -> None:
        """Link an output socket into an input socket, or set the input to a plain value."""
        if isinstance(source, bpy.types.NodeSocket):
            self.tree.links.new(source, target)
        else:
            target.default_value = source

    def math(self, operation: str, first, second=None):
        """A Math node; returns its output socket."""
        node = self.node("ShaderNodeMath", operation=operation)
        self.link(first, node.inputs[0])
        if second is not None:
            self.link(second, node.inputs[1])
        return node.outputs[0]

    def whole(self, operation: str, first, second):
        """An Integer Math node; returns its output socket."""
        node = self.node("FunctionNodeIntegerMath", operation=operation)
        self.link(first, node.inputs[0])
        self.link(second, node.inputs[1])
        return node.outputs[0]

    def switch(self, kind: str, condition, false, true):
        """A Switch node of the given input type; returns its output socket."""
        node = self.node("Switch", input_type=kind)
        self.link(condition, node.inputs["Switch"])
        self.link(false, node.inputs["False"])
        self.link(true, node.inputs["True"])
        return node.outputs["Output"]

    def choice(self, kind: str, number, values):
        """An Index Switch node over ``values``; returns its output socket."""
        node = self.node("IndexSwitch", data_type=kind)
        while len(node.index_switch_items) < len(values):
            node.index_switch_items.new()
        self.link(number, node.inputs["Index"])
        for position, value in enumerate(values):
            self.link(value, node.inputs[str(position)])
        return node.outputs["Output"]


def enabled(sockets, name: str):
    """The visible socket of that name; nodes of several data types keep hidden twins."""
    return next(s for s in sockets if s.name == name and s.enabled)
