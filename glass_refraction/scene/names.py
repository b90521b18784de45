# SPDX-License-Identifier: GPL-3.0-or-later
"""How the extension's own data-blocks are named and recognised."""

from __future__ import annotations

from pathlib import Path

import bpy

TAG = "refractive_glass"
"""Custom property on every data-block that the extension made; its value is the block's role."""

REFERENCE = "reference"
"""Role of what a comparison makes, and removes itself."""

MODIFIER = "Refractive Glass"
COPY_GROUP = "Refractive Glass Copy"
OCCLUDER_GROUP = "Refractive Glass Occluder"

NODE_GROUPS = Path(__file__).resolve().parents[2] / "node_groups" / "refractive_glass.blend"

VERSION_KEY = f"{TAG}_version"
GLASS_VERSION = 3
"""Of the modifier's node group; ``node_groups/glass.py`` counts it. Older files have older ones."""


def own(data_block: bpy.types.ID | None, role: str | None = None) -> bool:
    """Whether the extension made this data-block (in that role, if one is given)."""
    if data_block is None:
        return False
    made = data_block.get(TAG)
    return made is not None and (role is None or made == role)


def hidden_name(*parts: str) -> str:
    """A data-block name that Blender's menus leave out (leading dot)."""
    return ".RG " + " ".join(parts)


class RefractiveGlassError(Exception):
    """Bad input: one clear line that names the object and the remedy."""


def _is_current(group: bpy.types.NodeTree, name: str) -> bool:
    """Whether a group that a file brings along can do all that the extension's own can."""
    return name != MODIFIER or group.get(VERSION_KEY, 0) >= GLASS_VERSION


def _sockets(group: bpy.types.NodeTree) -> set[tuple[str, str, str]]:
    """What modifiers and drivers know a group's inputs and outputs by."""
    items = (item for item in group.interface.items_tree if item.item_type == "SOCKET")
    return {(item.identifier, item.name, item.socket_type) for item in items}


def renew_groups() -> None:
    """Have glasses of an older version use the node group of this one.

    Called as a file is opened, before Blender's undo begins. Their values, keyframes and drivers
    stay, for they go by sockets; a group that has others than today's is left as it is.
    """
    for old in list(bpy.data.node_groups):
        is_ours = own(old, "glass") and old.library is None
        if not is_ours or old.override_library or _is_current(old, MODIFIER):
            continue
        new = load_group(MODIFIER)
        if _sockets(old) <= _sockets(new):
            modifiers = (m for obj in bpy.data.objects for m in obj.modifiers if m.type == "NODES")
            for modifier in modifiers:
                if modifier.node_group == old:
                    # So it gets the inputs that are new.
                    modifier.node_group = new
            old.user_remap(new)
            bpy.data.node_groups.remove(old)
            new.name = MODIFIER
        elif not new.users:
            bpy.data.node_groups.remove(new)


def load_group(name: str) -> bpy.types.NodeTree:
    """The node group of that name, taken from the extension's file when it is not there yet."""
    for group in bpy.data.node_groups:
        known = group.name.lstrip(".").split(".")[0] == name
        if own(group) and group.library is None and known and _is_current(group, name):
            return group
    with bpy.data.libraries.load(str(NODE_GROUPS)) as (available, wanted):
        wanted.node_groups = [n for n in available.node_groups if n == name]
    group = wanted.node_groups[0]
    if group.asset_data is not None:
        # The mark is for the library; it would litter the asset browser of the user's own file.
        group.asset_clear()
    group.use_fake_user = False
    if name != MODIFIER:
        # Nothing that a user would pick from a menu.
        group.name = f".{name}"
    return group
