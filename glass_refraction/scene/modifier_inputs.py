# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs of a Geometry Nodes modifier by socket name, in Blender 5.0 and in 5.2's new form."""

from __future__ import annotations

import bpy


def _identifiers(modifier: bpy.types.NodesModifier) -> dict[str, str]:
    items = modifier.node_group.interface.items_tree
    return {i.name: i.identifier for i in items if i.item_type == "SOCKET" and i.in_out == "INPUT"}


def _menu_items(modifier: bpy.types.NodesModifier, identifier: str):
    """(name, stored number) pairs of a menu socket; empty for other sockets (Blender < 5.2)."""
    items = modifier.id_properties_ui(identifier).as_dict().get("items") or ()
    return [(item[0], item[4]) for item in items]


def _is_menu(modifier: bpy.types.NodesModifier, name: str) -> bool:
    items = modifier.node_group.interface.items_tree
    return any(
        i.name == name and i.item_type == "SOCKET" and i.socket_type == "NodeSocketMenu"
        for i in items
    )


def has_input(modifier: bpy.types.NodesModifier, name: str) -> bool:
    """Whether the node group has the socket ``name``: a file may hold an earlier group."""
    return name in _identifiers(modifier)


def read_input(modifier: bpy.types.NodesModifier, name: str):
    """The value of the socket ``name``; a menu as the name of its item.

    Raises
    ------
    KeyError
        If the node group has no such socket.
    """
    identifier = _identifiers(modifier)[name]
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier).value
    value = modifier[identifier]
    if _is_menu(modifier, name):
        return next(item for item, number in _menu_items(modifier, identifier) if number == value)
    return value


def write_input(modifier: bpy.types.NodesModifier, name: str, value) -> None:
    """Set the socket ``name``, only if it differs: a write tags the object for evaluation."""
    if read_input(modifier, name) == value:
        return
    identifier = _identifiers(modifier)[name]
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        if _is_menu(modifier, name):
            value = dict(_menu_items(modifier, identifier))[value]
        modifier[identifier] = value
    modifier.id_data.update_tag()


def value_place(modifier: bpy.types.NodesModifier, name: str) -> tuple[bpy.types.bpy_struct, str]:
    """The piece of Blender data and its property that hold the socket's value, for layouts."""
    identifier = _identifiers(modifier)[name]
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def data_path(modifier: bpy.types.NodesModifier, name: str) -> str:
    """RNA path of the socket's value from the object, for keyframes, drivers and panels."""
    identifier = _identifiers(modifier)[name]
    own = f'modifiers["{modifier.name}"]'
    if hasattr(modifier, "properties"):
        return f"{own}.properties.inputs.{identifier}.value"
    return f'{own}["{identifier}"]'
