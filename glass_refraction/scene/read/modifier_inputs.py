# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifier of a glass, and inputs of Geometry Nodes modifiers by socket name, in Blender 5.0
and in 5.2's new form."""

from __future__ import annotations

import bpy

from ..names import own

_places: dict[tuple[int, str], int] = {}
"""Where in its group's interface a socket was last: (the group's session uid, name) -> index."""


def glass_modifier(obj: bpy.types.Object) -> bpy.types.NodesModifier | None:
    """The object's ``Refractive Glass`` modifier, or None."""
    for modifier in obj.modifiers:
        if modifier.type == "NODES" and own(modifier.node_group, "glass"):
            return modifier
    return None


def _socket(modifier: bpy.types.NodesModifier, name: str) -> bpy.types.NodeTreeInterfaceSocket:
    """The input socket of that name; KeyError where there is none."""
    group = modifier.node_group
    items, key = group.interface.items_tree, (group.session_uid, name)
    place = _places.get(key, len(items))
    if place < len(items) and _is_input(items[place], name):
        return items[place]
    # The last of a name, should there be several.
    for place in reversed(range(len(items))):
        if _is_input(items[place], name):
            _places[key] = place
            return items[place]
    raise KeyError(name)


def _is_input(item: bpy.types.NodeTreeInterfaceItem, name: str) -> bool:
    return item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name


def _menu_items(modifier: bpy.types.NodesModifier, identifier: str):
    """(name, stored number) pairs of a menu socket; empty for other sockets (Blender < 5.2)."""
    items = modifier.id_properties_ui(identifier).as_dict().get("items") or ()
    return [(item[0], item[4]) for item in items]


def has_input(modifier: bpy.types.NodesModifier, name: str) -> bool:
    """Whether the node group has the socket ``name``: a file may hold an earlier group, or none."""
    group = modifier.node_group
    return group is not None and any(_is_input(i, name) for i in group.interface.items_tree)


def read_input(modifier: bpy.types.NodesModifier, name: str):
    """The value of the socket ``name``; a menu as the name of its item.

    Raises
    ------
    KeyError
        If the node group has no such socket.
    """
    socket = _socket(modifier, name)
    identifier = socket.identifier
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier).value
    value = modifier[identifier]
    if socket.socket_type == "NodeSocketMenu":
        return next(item for item, number in _menu_items(modifier, identifier) if number == value)
    return value


def write_input(modifier: bpy.types.NodesModifier, name: str, value) -> None:
    """Set the socket ``name``, only if it differs: a write tags the object for evaluation."""
    if read_input(modifier, name) == value:
        return
    socket = _socket(modifier, name)
    identifier = socket.identifier
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        if socket.socket_type == "NodeSocketMenu":
            value = dict(_menu_items(modifier, identifier))[value]
        modifier[identifier] = value
    modifier.id_data.update_tag()


def value_place(modifier: bpy.types.NodesModifier, name: str) -> tuple[bpy.types.bpy_struct, str]:
    """The piece of Blender data and its property that hold the socket's value, for layouts."""
    identifier = _socket(modifier, name).identifier
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def data_path(modifier: bpy.types.NodesModifier, name: str) -> str:
    """RNA path of the socket's value from the object, for keyframes, drivers and panels."""
    identifier = _socket(modifier, name).identifier
    own = f'modifiers["{modifier.name}"]'
    if hasattr(modifier, "properties"):
        return f"{own}.properties.inputs.{identifier}.value"
    return f'{own}["{identifier}"]'
