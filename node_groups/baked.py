# SPDX-License-Identifier: GPL-3.0-or-later
"""``Refractive Glass Baked``: plays geometry back from files, in place of the object's own.

The group is one Bake node. Blender reads its files itself, so what uses this group renders where
the extension is not installed.
"""

from __future__ import annotations

from .tree_builder import TreeBuilder

NAME = "Refractive Glass Baked"


def build():
    """Build the group and return it."""
    b = TreeBuilder(NAME, "baked")
    b.tree.is_modifier = True
    b.socket("Geometry", "Geometry", output=True)
    b.socket("Geometry", "Geometry")
    group = b.node("NodeGroupInput")
    bake = b.node("Bake")
    bake.bake_items.new("GEOMETRY", "Geometry")
    b.link(group.outputs["Geometry"], bake.inputs["Geometry"])
    end = b.node("NodeGroupOutput")
    b.link(bake.outputs["Geometry"], end.inputs[0])
    return b.tree
