# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups' file is what the code beside it builds."""

import bpy

from glass_refraction.scene.names import NODE_GROUPS
from node_groups.build import build


def _value(socket):
    value = getattr(socket, "default_value", None)
    if isinstance(value, bpy.types.ID):
        return value.name
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _described(path):
    """Every group as text: sockets, nodes with their values, links."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (available, wanted):
        wanted.node_groups = list(available.node_groups)
    lines = []
    trees = [(m.name, m, m.node_tree) for m in bpy.data.materials]
    trees += [(group.name, group, group) for group in bpy.data.node_groups]
    for name, owner, group in sorted(trees, key=lambda tree: tree[0]):
        lines.append(f"{name} {owner.get('refractive_glass')}")
        for item in group.interface.items_tree:
            lines.append(f"  {item.in_out} {item.name} {item.socket_type} {item.description}")
        for node in group.nodes:
            lines.append(f"  {node.name} {node.bl_idname}")
            lines += [f"    {s.identifier} {_value(s)}" for s in node.inputs]
        lines += sorted(
            f"  {k.from_node.name}.{k.from_socket.identifier} -> "
            f"{k.to_node.name}.{k.to_socket.identifier}"
            for k in group.links
        )
    return "\n".join(lines)


def test_the_file_is_built_from_the_code(tmp_path):
    built = _described(build(tmp_path / "built.blend"))
    assert "Refractive Glass Copy copy" in built
    assert _described(NODE_GROUPS) == built
