# SPDX-License-Identifier: GPL-3.0-or-later
"""``Refractive Glass Occluder``: a source at its true place, for depth and for hiding the glass."""

from __future__ import annotations

from .tree_builder import TreeBuilder

NAME = "Refractive Glass Occluder"


def build():
    """Build the group and return it."""
    b = TreeBuilder(NAME, "occluder")
    b.tree.is_modifier = True
    b.socket("Geometry", "Geometry", output=True)
    b.socket("Geometry", "Geometry")
    b.socket("Source", "Object", description="The object that may hide the glass")
    b.socket(
        "Carried",
        "Bool",
        default=True,
        description="Off: the object's own mesh stands for the source (a curve or text)",
    )
    group = b.node("NodeGroupInput")
    info = b.node("ObjectInfo", transform_space="RELATIVE")
    b.link(group.outputs["Source"], info.inputs["Object"])
    realized = b.node("RealizeInstances")
    b.link(info.outputs["Geometry"], realized.inputs[0])
    parts = b.node("SeparateComponents")
    b.link(realized.outputs[0], parts.inputs[0])
    shown = b.switch(
        "GEOMETRY", group.outputs["Carried"], group.outputs["Geometry"], parts.outputs["Mesh"]
    )
    end = b.node("NodeGroupOutput")
    b.link(shown, end.inputs[0])
    return b.tree
