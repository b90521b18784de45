# SPDX-License-Identifier: GPL-3.0-or-later
"""``Refractive Glass Copy``: a source's mesh drawn where it appears through a glass.

The object's own mesh is the *carrier*: loose vertices, one for each vertex of the source and image
slot, whose positions NumPy writes. The group takes the source by Object Info, moves its vertices
onto the carrier's and keeps all else: faces, UVs, materials, attributes and original normals. A
carrier that has faces of its own (a refined source) is drawn itself.

Carrier attributes: ``rg_seen`` (float, point; 1 = has an image, 0 = lies on the fold instead, far
below 0 = no face may use it), ``rg_normal`` (vector, corner; refined carriers only).
"""

from __future__ import annotations

from .tree_builder import TreeBuilder, enabled

NAME = "Refractive Glass Copy"
COORDINATES = ("rg_generated", "rg_object", "rg_position")
"""Texture coordinates of the true place, for materials that would else see the displaced one."""


def build():
    """Build the group and return it."""
    b = TreeBuilder(NAME, "copy")
    b.tree.is_modifier = True
    b.socket("Geometry", "Geometry", output=True)
    b.socket("Geometry", "Geometry", description="The carrier")
    b.socket("Source", "Object", description="The object that is seen through the glass")
    b.socket("Slots", "Int", default=1, minimum=1, description="Images of each vertex")
    b.socket("Whole", "Bool", description="Every vertex has an image: no face is to be dropped")
    b.socket(
        "Normals",
        "Int",
        default=1,
        minimum=1,
        maximum=3,
        description="Normals kept: those of 1 corners, 2 vertices, 3 faces",
    )
    group = b.node("NodeGroupInput")
    carrier = group.outputs["Geometry"]

    faces = b.node("AttributeDomainSize", component="MESH")
    b.link(carrier, faces.inputs[0])
    refined = b.node("FunctionNodeCompare", data_type="INT", operation="GREATER_THAN")
    b.link(faces.outputs["Face Count"], enabled(refined.inputs, "A"))
    enabled(refined.inputs, "B").default_value = 0
    mesh = b.switch("GEOMETRY", refined.outputs[0], _source(b, group), carrier)

    original = b.node("InputNormal")
    stored = b.node("InputNamedAttribute", data_type="FLOAT_VECTOR")
    stored.inputs["Name"].default_value = "rg_normal"
    normal = b.switch(
        "VECTOR",
        refined.outputs[0],
        original.outputs["Normal"],
        enabled(stored.outputs, "Attribute"),
    )
    # Of a smooth mesh, its vertices' normals say all, and there are four corners to a vertex.
    kept = []
    for domain in ("CORNER", "POINT", "FACE"):
        capture = b.node("CaptureAttribute", domain=domain)
        capture.capture_items.new("VECTOR", "Normal")
        b.link(mesh, capture.inputs["Geometry"])
        b.link(normal, capture.inputs["Normal"])
        kept.append((domain, capture))
    choice = group.outputs["Normals"]
    captured = b.choice("GEOMETRY", choice, [mesh, *(c.outputs["Geometry"] for _, c in kept)])

    index = b.node("InputIndex").outputs[0]

    def from_carrier(kind: str, value):
        sample = b.node("SampleIndex", data_type=kind, domain="POINT")
        b.link(carrier, sample.inputs["Geometry"])
        b.link(value, enabled(sample.inputs, "Value"))
        b.link(index, sample.inputs["Index"])
        return enabled(sample.outputs, "Value")

    def named(kind: str, name: str):
        node = b.node("InputNamedAttribute", data_type=kind)
        node.inputs["Name"].default_value = name
        return enabled(node.outputs, "Attribute")

    stored = captured
    kind = "FLOAT_VECTOR"
    for name in COORDINATES:
        store = b.node("StoreNamedAttribute", data_type=kind, domain="POINT")
        store.inputs["Name"].default_value = name
        b.link(stored, store.inputs["Geometry"])
        b.link(from_carrier(kind, named(kind, name)), enabled(store.inputs, "Value"))
        # Only what the carrier holds, lest the source's own attribute of that name be lost.
        there = b.node("InputNamedAttribute", data_type=kind)
        there.inputs["Name"].default_value = name
        held = b.node("SampleIndex", data_type="BOOLEAN", domain="POINT")
        b.link(carrier, held.inputs["Geometry"])
        b.link(there.outputs["Exists"], enabled(held.inputs, "Value"))
        stored = b.switch("GEOMETRY", enabled(held.outputs, "Value"), stored, store.outputs[0])

    move = b.node("SetPosition")
    b.link(stored, move.inputs["Geometry"])
    b.link(
        from_carrier("FLOAT_VECTOR", b.node("InputPosition").outputs[0]), move.inputs["Position"]
    )

    # A face stays while any of its corners has an image: the others lie on the fold.
    seen = b.node("FieldOnDomain", data_type="FLOAT", domain="POINT")
    b.link(from_carrier("FLOAT", named("FLOAT", "rg_seen")), enabled(seen.inputs, "Value"))
    unseen = b.node("FunctionNodeCompare", data_type="FLOAT", operation="LESS_EQUAL")
    b.link(enabled(seen.outputs, "Value"), enabled(unseen.inputs, "A"))
    enabled(unseen.inputs, "B").default_value = 0.0
    drop = b.node("DeleteGeometry", domain="FACE", mode="ALL")
    b.link(move.outputs[0], drop.inputs["Geometry"])
    b.link(unseen.outputs[0], drop.inputs["Selection"])

    # Looking for faces to drop takes as long as all the rest.
    left = b.switch("GEOMETRY", group.outputs["Whole"], drop.outputs[0], move.outputs[0])

    shown = [left]
    for domain, capture in kept:
        normals = b.node("SetMeshNormal", mode="FREE", domain=domain)
        b.link(left, normals.inputs["Mesh"])
        b.link(capture.outputs["Normal"], enabled(normals.inputs, "Custom Normal"))
        shown.append(normals.outputs[0])
    end = b.node("NodeGroupOutput")
    b.link(b.choice("GEOMETRY", choice, shown), end.inputs[0])
    return b.tree


def _source(b: TreeBuilder, group):
    """The source as one mesh in world space, once an image slot, in the carrier's vertex order."""
    info = b.node("ObjectInfo", transform_space="RELATIVE")
    b.link(group.outputs["Source"], info.inputs["Object"])
    realized = b.node("RealizeInstances")
    b.link(info.outputs["Geometry"], realized.inputs[0])
    parts = b.node("SeparateComponents")
    b.link(realized.outputs[0], parts.inputs[0])
    mesh = parts.outputs["Mesh"]
    # Repeating merges equal materials; the copy's own slots count on the source's numbers.
    slot = b.node("CaptureAttribute", domain="FACE")
    slot.capture_items.new("INT", "Material Index")
    b.link(mesh, slot.inputs["Geometry"])
    b.link(b.node("InputMaterialIndex").outputs[0], slot.inputs["Material Index"])
    line = b.node("MeshLine")
    b.link(group.outputs["Slots"], line.inputs["Count"])
    line.inputs["Offset"].default_value = (0.0, 0.0, 0.0)
    repeat = b.node("InstanceOnPoints")
    b.link(line.outputs["Mesh"], repeat.inputs["Points"])
    b.link(slot.outputs["Geometry"], repeat.inputs["Instance"])
    repeated = b.node("RealizeInstances")
    b.link(repeat.outputs[0], repeated.inputs[0])
    numbered = b.node("SetMaterialIndex")
    b.link(repeated.outputs[0], numbered.inputs["Geometry"])
    b.link(slot.outputs["Material Index"], numbered.inputs["Material Index"])
    several = b.node("FunctionNodeCompare", data_type="INT", operation="GREATER_THAN")
    b.link(group.outputs["Slots"], enabled(several.inputs, "A"))
    enabled(several.inputs, "B").default_value = 1
    return b.switch("GEOMETRY", several.outputs[0], mesh, numbered.outputs[0])
