# SPDX-License-Identifier: GPL-3.0-or-later
"""What materials of meshes have and glasses do not show: lines for the user."""

from __future__ import annotations

import bpy
import numpy as np

from .glassy_materials import (
    PAINTED,
    glassy_materials,
    interface_node,
    material_absorption,
    material_interface,
    opaque_materials,
)
from .material_fields import UV_MAP, wanted_map
from .material_recipe import Recipe, bumps_of, paint_of
from .modifier_inputs import glass_modifier, has_input

_BESIDE_GLASS = ("Metallic", "Coat Weight", "Emission Strength", "Thin Film Thickness", "Thin Wall")
"""Inputs of a shader that make of a glass what is not computed; plain glass has 0. Blender has a
thin wall since 5.2."""


def unread(obj: bpy.types.Object, opaque: int) -> list[str]:
    """A line for each thing that an object's materials have and that is not seen in the glass.

    ``opaque``: see `corners_of`.
    """
    materials = glassy_materials(obj)
    if not materials:
        return []
    shown = _shown_materials(obj)
    first, others = materials[0], [m for m in materials[1:] if m in shown]
    found = [line for m in (first, *others) for line in _left_out(obj, m)]
    bumps = bumps_of(first)
    if isinstance(bumps, str):
        found.append(
            f'Glass "{obj.name}" is seen without the bumps of its material "{first.name}": '
            f"{bumps} is not known where rays go (a Displace modifier works)"
        )
    if any(_medium(m) != _medium(first) for m in others):
        found.append(
            f'Glass "{obj.name}" has ior, volume and bumps of its first glassy material, '
            f'"{first.name}", everywhere: separate the faces of others (Edit Mode, P > By '
            "Material), which then are glasses too"
        )
    modifier = glass_modifier(obj)
    is_old = modifier is not None and not has_input(modifier, UV_MAP)
    if is_old and (others or wanted_map(obj)):
        found.append(
            f'Glass "{obj.name}" may have its colours in other places: its modifier is of an older '
            "version, in a library. Open that file with this version, and save it"
        )
    known = {*materials, *opaque_materials(obj, opaque)}
    left = [m.name for m in shown if m not in known]
    if left:
        found.append(
            f'Glass "{obj.name}" is glass on its faces of "{", ".join(left)}" too: link these '
            "materials to Data (Material Properties), or separate the faces (Edit Mode, P > By "
            "Material)"
        )
    return found


def _shown_materials(obj: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials of an object's slots that any of its faces has."""
    index = np.empty(len(obj.data.polygons), np.int32)
    obj.data.polygons.foreach_get("material_index", index)
    shown = [slot.material for n, slot in enumerate(obj.material_slots) if (index == n).any()]
    return [m for m in dict.fromkeys(shown) if m is not None]


def _left_out(obj: bpy.types.Object, material: bpy.types.Material) -> list[str]:
    """Lines for inputs of a material's shader that do not count as they are."""
    node, found = interface_node(material), []
    told = "Normal", *PAINTED[node.type]
    links = ((i.name, i.links) for i in node.inputs if i.name not in told)
    linked = [name for name, of in links if any(not link.is_muted for link in of)]
    others = (node.inputs.get(name) for name in _BESIDE_GLASS)
    linked += [i.name for i in others if i is not None and not i.is_linked and i.default_value]
    without = f'Glass "{obj.name}" is seen without what its material "{material.name}" has as '
    if linked:
        found.append(f"{without}{', '.join(linked)}: it takes plain values of a glass")
    mixed = _mixed(material)
    if mixed:
        found.append(
            f'Glass "{obj.name}" is seen as if its material "{material.name}" were all '
            f'"{node.name}": {mixed} does not count'
        )
    unknown = paint_of(material)[1]
    if unknown:
        nodes = ", ".join(dict.fromkeys(unknown.values()))
        inputs = ", ".join(unknown)
        found.append(f"{without}{inputs}: {nodes} is not known where rays go; plain values count")
    return found


def _mixed(material: bpy.types.Material) -> str:
    """What mixes the shader of a glass with others; empty: nothing. By a Light Path it is left to
    the user: mostly light that lamps send is let through, and what the camera sees is all glass."""
    tree, waiting = material.node_tree, [interface_node(material)]
    if any(node.type == "LIGHT_PATH" for node in tree.nodes):
        return ""
    while waiting:
        links = [link for output in waiting.pop().outputs for link in output.links]
        for node in (link.to_node for link in links if not link.is_muted):
            if node.type in {"MIX_SHADER", "ADD_SHADER"} and not node.mute:
                return node.bl_label
            if node.type == "REROUTE":
                waiting.append(node)
    return ""


def _medium(material: bpy.types.Material) -> tuple:
    """What a mesh has one of."""
    bumps = bumps_of(material)
    bumps = bumps.stamp() if isinstance(bumps, Recipe) else bumps
    absorption = tuple(material_absorption(material))
    return round(material_interface(material).ior, 6), absorption, bumps
