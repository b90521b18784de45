# SPDX-License-Identifier: GPL-3.0-or-later
"""What the materials of a mesh say of it as a glass: ior, colours, roughness, and which faces are
none."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..names import own
from .modifier_inputs import has_input, read_input
from .node_ends import leading_node

CLEAR = (1.0, 1.0, 1.0)
OPAQUE = "Opaque Slots"
"""Input of the glass's modifier: bit k says that the faces of material slot k are no glass."""
MOST_SLOTS = 30
"""Material slots that have a bit; the faces of others are glass (`node_groups.glass`)."""


@dataclass(frozen=True)
class Interface:
    """What a material says of a glass; fields as of `MeshGlass`."""

    ior: float
    roughness: float = 0.0
    refracted: tuple[float, float, float] = CLEAR
    reflected: tuple[float, float, float] = CLEAR


def opaque_bits(modifier: bpy.types.NodesModifier | None) -> int:
    """What the modifier of a glass knows of its opaque slots; an older one, or None, of none."""
    knows = modifier is not None and has_input(modifier, OPAQUE)
    return int(read_input(modifier, OPAQUE)) if knows else 0


def wanted_bits(obj: bpy.types.Object) -> int:
    """What the modifier of a glass should know: the slots of materials beside its glassy ones.

    None is opaque where none is glassy: then the mesh is glass whatever it is of. What is linked
    to the object is not among a mesh's materials, so no mesh that is taken apart shows it.
    """
    slots, glassy = obj.material_slots[:MOST_SLOTS], glassy_materials(obj)
    opaque = (s.slot_index for s in slots if s.material not in glassy and s.link == "DATA")
    return sum(1 << number for number in opaque) if glassy else 0


def opaque_materials(obj: bpy.types.Object, opaque: int) -> set[bpy.types.Material | None]:
    """The materials of an object's slots that are among the opaque ones."""
    slots = obj.original.material_slots[:MOST_SLOTS]
    return {slot.material for slot in slots if opaque >> slot.slot_index & 1}


def interface_of(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, ior: float) -> Interface:
    """What the first glassy material of an object says as it is evaluated; else the given ior."""
    material = next(iter(glassy_materials(obj)), None)
    found = material and material_interface(material.evaluated_get(depsgraph))
    return found or Interface(ior)


def volume_absorption(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """(3,) absorption coefficients, per metre, of an object's first glassy material."""
    material = next(iter(glassy_materials(obj)), None)
    if material is None:
        return np.zeros(3)
    return material_absorption(material.evaluated_get(depsgraph))


def material_absorption(material: bpy.types.Material) -> np.ndarray:
    """(3,) absorption coefficients, per metre.

    They are those of a Volume Absorption node that leads to the material's output, as Cycles has
    them; of all other volumes 0. Inputs with links count as they would without.
    """
    node = leading_node(material.node_tree, "Volume", "VOLUME_ABSORPTION")
    if node is None:
        return np.zeros(3)
    return max(_value(node, "Density"), 0.0) * (1.0 - _colour(node, "Color"))


def glassy_materials(obj: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials of an object that say what a glass is: the first counts for all of it.

    They are those of its slots, not those that modifiers give it: where renders hide the mesh, its
    evaluated one has none.
    """
    slots = (slot.material for slot in obj.original.material_slots)
    return [m for m in dict.fromkeys(slots) if material_interface(m) is not None]


def material_interface(material: bpy.types.Material | None) -> Interface | None:
    """What a material says of a glass; None where it is none, or the extension's own.

    It is read of a Glass or Refraction BSDF, or a Principled BSDF with transmission, that leads to
    the surface. Inputs with links count as they would without.
    """
    node = interface_node(material)
    return None if node is None else _READERS[node.type](node)


def interface_node(material: bpy.types.Material | None) -> bpy.types.ShaderNode | None:
    """The node of a material that says what a glass is, see `material_interface`."""
    if material is None or material.node_tree is None or own(material):
        return None
    shaders = (node for node in material.node_tree.nodes if node.type in _READERS)
    linked = (node for node in shaders if any(output.is_linked for output in node.outputs))
    return next((node for node in linked if _READERS[node.type](node) is not None), None)


def _value(node, name: str) -> float:
    return float(node.inputs[name].default_value)


def _colour(node, name: str) -> np.ndarray:
    return np.clip(np.array(node.inputs[name].default_value[:3], float), 0.0, 1.0)


def _glass(node) -> Interface:
    colour = tuple(map(float, _colour(node, "Color")))
    return Interface(_value(node, "IOR"), _value(node, "Roughness"), colour, colour)


def _principled(node) -> Interface | None:
    if _value(node, "Transmission Weight") < LEAST_TRANSMISSION:
        return None
    # Cycles refracts by the root of the base colour: a closed body has two surfaces.
    colour = tuple(map(float, np.sqrt(_colour(node, "Base Color"))))
    tint = tuple(map(float, _colour(node, "Specular Tint")))
    return Interface(_value(node, "IOR"), _value(node, "Roughness"), colour, tint)


PAINTED = {
    "BSDF_GLASS": ("Color", "Color", "Roughness"),
    "BSDF_REFRACTION": ("Color", "Color", "Roughness"),
    "BSDF_PRINCIPLED": ("Base Color", "Specular Tint", "Roughness"),
}
"""Inputs of shaders that tell the colour of what is refracted, of what is reflected, and the
roughness; these may differ from place to place."""
LEAST_TRANSMISSION = 0.5
"""Of a Principled BSDF, from which on it is a glass."""
_READERS = {"BSDF_GLASS": _glass, "BSDF_REFRACTION": _glass, "BSDF_PRINCIPLED": _principled}
