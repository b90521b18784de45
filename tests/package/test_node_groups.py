# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups' file is what the code beside it builds."""

import hashlib

import bpy

from glass_refraction.scene.names import GLASS_VERSION, MODIFIER, NODE_GROUPS, VERSION_KEY
from node_groups.build import build

GLASS_GROUPS = {1: "d0a51eb15534", 2: "f4b98b5809de", 3: "55c90bb55706"}
"""What each version of the glass's node group is, in short: a changed group is a new version."""


def _value(socket):
    value = getattr(socket, "default_value", None)
    if isinstance(value, bpy.types.ID):
        return value.name
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _described(path):
    """The text of every group, by name: sockets, nodes with their values, links."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(path)) as (available, wanted):
        wanted.node_groups = list(available.node_groups)
    found = {}
    trees = [(m.name, m, m.node_tree) for m in bpy.data.materials]
    trees += [(group.name, group, group) for group in bpy.data.node_groups]
    for name, owner, group in sorted(trees, key=lambda tree: tree[0]):
        lines = found[name] = [f"{name} {owner.get('refractive_glass')}"]
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
    return {name: "\n".join(lines) for name, lines in found.items()}


def test_the_file_is_built_from_the_code(tmp_path):
    built = _described(build(tmp_path / "built.blend"))
    assert "Refractive Glass Copy" in built
    assert _described(NODE_GROUPS) == built
    assert bpy.data.node_groups[MODIFIER][VERSION_KEY] == GLASS_VERSION
    digest = hashlib.sha256(built[MODIFIER].encode()).hexdigest()[:12]
    assert digest == GLASS_GROUPS[GLASS_VERSION], "count VERSION in node_groups/glass.py and names"
