# SPDX-License-Identifier: GPL-3.0-or-later
"""The shadow of a glass: a material that only light on its way to other things notices.

A ray runs straight through. Each face lets through what Fresnel's equations leave, and half the
tint of the wall that it bounds (of a solid glass: half the chord). Light is not bent: no caustics.
"""

from __future__ import annotations

import bpy

from .tree_builder import TAG, TreeBuilder

NAME = ".Refractive Glass Shadow"
COLOUR, WALL = "rg_shadow_colour", "rg_shadow_wall"
"""On the faces: the tint; half the wall (of a solid: its radius) in distances of the tint, the ior,
and whether the glass is solid."""


def cast(b: TreeBuilder, mesh, group, solid):
    """The mesh as what casts the shadow; ``group``: the modifier's inputs, ``solid``: 1 or 0."""
    radius, wall = group.outputs["Radius"], group.outputs["Wall Thickness"]
    half = b.switch("FLOAT", solid, b.math("MULTIPLY", wall, 0.5), radius)
    distance = b.math("MAXIMUM", group.outputs["Absorption Distance"], 1e-6)
    numbers = b.node("ShaderNodeCombineXYZ")
    b.link(b.math("DIVIDE", half, distance), numbers.inputs[0])
    b.link(group.outputs["IOR"], numbers.inputs[1])
    b.link(b.switch("FLOAT", solid, 0.0, 1.0), numbers.inputs[2])
    for kind, name, value in (
        ("FLOAT_COLOR", COLOUR, group.outputs["Absorption Color"]),
        ("FLOAT_VECTOR", WALL, numbers.outputs[0]),
    ):
        store = b.node("StoreNamedAttribute", data_type=kind, domain="FACE")
        b.link(mesh, store.inputs["Geometry"])
        store.inputs["Name"].default_value = name
        b.link(value, next(s for s in store.inputs if s.name == "Value" and s.enabled))
        mesh = store.outputs[0]
    dressed = b.node("SetMaterial")
    b.link(mesh, dressed.inputs["Geometry"])
    dressed.inputs["Material"].default_value = _material()
    return dressed.outputs[0]


def _material() -> bpy.types.Material:
    material = bpy.data.materials.new(NAME)
    material[TAG] = "shadow"
    tree = material.node_tree
    tree.nodes.clear()

    def node(kind: str, **properties):
        made = tree.nodes.new(f"ShaderNode{kind}")
        made.location = (180 * (len(tree.nodes) // 5), -160 * (len(tree.nodes) % 5))
        for name, value in properties.items():
            setattr(made, name, value)
        return made

    def math(operation: str, *values):
        made = node("Math", operation=operation)
        for slot, value in enumerate(values):
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, made.inputs[slot])
            else:
                made.inputs[slot].default_value = value
        return made.outputs[0]

    place = node("NewGeometry")
    numbers = node("SeparateXYZ")
    tree.links.new(node("Attribute", attribute_name=WALL).outputs["Vector"], numbers.inputs[0])
    depth, ior, solid = numbers.outputs

    # From behind, the node takes the reciprocal; the ray runs straight, so both faces of a wall
    # are met at the angle that it comes at.
    back = place.outputs["Backfacing"]
    reciprocal = math("DIVIDE", 1.0, ior)
    seen_ior = math("ADD", ior, math("MULTIPLY", back, math("SUBTRACT", reciprocal, ior)))
    fresnel = node("Fresnel")
    tree.links.new(seen_ior, fresnel.inputs["IOR"])
    through = math("SUBTRACT", 1.0, fresnel.outputs[0])

    dot = node("VectorMath", operation="DOT_PRODUCT")
    tree.links.new(place.outputs["Normal"], dot.inputs[0])
    tree.links.new(place.outputs["Incoming"], dot.inputs[1])
    cosine = math("ABSOLUTE", dot.outputs["Value"])
    sine = math("DIVIDE", math("SUBTRACT", 1.0, math("MULTIPLY", cosine, cosine)), ior)
    inside = math("SQRT", math("MAXIMUM", math("SUBTRACT", 1.0, math("DIVIDE", sine, ior)), 1e-3))
    slant = math("DIVIDE", 1.0, inside)
    chord = math("ADD", slant, math("MULTIPLY", solid, math("SUBTRACT", cosine, slant)))
    length = math("MULTIPLY", depth, chord)

    tint = node("SeparateColor")
    tree.links.new(node("Attribute", attribute_name=COLOUR).outputs["Color"], tint.inputs[0])
    ray = node("LightPath")
    # What looks for things to show finds nothing here; light on its way to them does.
    looks = math("MAXIMUM", ray.outputs["Is Camera Ray"], ray.outputs["Is Singular Ray"])
    join = node("CombineColor")
    for channel in range(3):
        left = math("POWER", math("MAXIMUM", tint.outputs[channel], 1e-6), length)
        lost = math("SUBTRACT", 1.0, math("MULTIPLY", left, through))
        kept = math("SUBTRACT", 1.0, math("MULTIPLY", lost, math("SUBTRACT", 1.0, looks)))
        tree.links.new(kept, join.inputs[channel])
    clear = node("BsdfTransparent")
    tree.links.new(join.outputs[0], clear.inputs["Color"])
    tree.links.new(clear.outputs[0], node("OutputMaterial").inputs["Surface"])
    return material
