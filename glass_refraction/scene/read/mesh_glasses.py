# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes: their triangles in the world, and what their material says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import bpy
import numpy as np

from ...optics.facets import placed
from ..names import own
from .arrays import (
    corner_normals,
    edges_of_corners,
    mesh_triangles,
    positions,
    read_attribute,
    triangle_slots,
)
from .modifier_inputs import has_input, read_input
from .node_ends import leading_node

CORNER_NORMAL = "rg_corner_normal"
"""Attribute of the loose points, three a triangle, that the modifier leaves of a mesh where it
hides it; `node_groups.glass` makes them."""
CLEAR = (1.0, 1.0, 1.0)
OPAQUE = "Opaque Slots"
"""Input of the glass's modifier: bit k says that the faces of material slot k are no glass."""
MOST_SLOTS = 30
"""Material slots that have a bit; the faces of others are glass (`node_groups.glass`)."""


@dataclass(frozen=True, eq=False)
class MeshGlass:
    """A glass that is a mesh, in the world.

    Attributes
    ----------
    points, normals : (T, 3, 3) float64: corners of each triangle, metres, anticlockwise seen from
        outside; unit interpolated normals there.
    ior : of the glass.
    roughness : of its surface, 0 to 1, as a Glass BSDF has it.
    refracted, reflected : parts of the light (red, green, blue) that get through the surface where
        they are refracted and reflected, beside Fresnel's law.
    opaque : (K, 3, 3) corners of the triangles of the mesh that are no glass: with these it
        encloses what is within.
    within : (T, 3, 3) the normals for rays that come from within, if bumps make them others.
    """

    points: np.ndarray
    normals: np.ndarray
    ior: float
    roughness: float = 0.0
    refracted: tuple[float, float, float] = CLEAR
    reflected: tuple[float, float, float] = CLEAR
    opaque: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    within: np.ndarray | None = None

    has_contents: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.ior) and self.ior > 0.0):
            raise ValueError(f"ior must be a number above 0, not {self.ior!r}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MeshGlass) and all(
            np.array_equal(mine, theirs)
            for mine, theirs in zip(self._parts(), other._parts(), strict=True)
        )

    __hash__ = None

    def _parts(self) -> tuple:
        own = self.ior, self.roughness, self.refracted, self.reflected
        return (*own, self.points, self.normals, self.opaque, self.within)

    def recoloured(self, glass: Callable[[float], float], _contents) -> MeshGlass:
        """The same glass as light of another colour finds it, from its ior."""
        return replace(self, ior=glass(self.ior))

    @property
    def media(self) -> tuple[float, float]:
        """The ior around it and its own."""
        return (1.0, self.ior)

    @cached_property
    def box(self) -> np.ndarray:
        """(2, 3): its lowest and highest coordinates."""
        return np.array((self.points.min(axis=(0, 1)), self.points.max(axis=(0, 1))))


@dataclass(frozen=True)
class Interface:
    """What a material says of a glass; fields as of `MeshGlass`."""

    ior: float
    roughness: float = 0.0
    refracted: tuple[float, float, float] = CLEAR
    reflected: tuple[float, float, float] = CLEAR


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a mesh's triangles in its own frame.

    Attributes
    ----------
    points, normals : (T, 3, 3), see `triangles_of`.
    within : (T, 3, 3) the normals for rays that come from within, if bumps make them others.
    missed : part of the edges between whose ends bumps are other than the normals.
    """

    points: np.ndarray
    normals: np.ndarray
    within: np.ndarray | None = None
    missed: float = 0.0


def placed_triangles(
    mesh: bpy.types.Mesh, to_world: np.ndarray, opaque: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (T, 3, 3) of an evaluated mesh's triangles in the world.

    Parameters
    ----------
    to_world : (4, 4), any that has an inverse.
    opaque : see `triangles_of`.

    Raises
    ------
    ValueError
        No faces, or coordinates that are no numbers.
    """
    return placed_corners(Corners(*triangles_of(mesh, opaque)), to_world)[:2]


def placed_corners(corners: Corners, to_world: np.ndarray) -> tuple:
    """Points and unit normals (T, 3, 3) of triangles in the world, those from within or None.

    Raises
    ------
    ValueError
        None of them has an area.
    """
    place = to_world[:3, :3], to_world[:3, 3]
    points, normals, area = placed(corners.points, corners.normals, *place)
    kept = area > 0.0
    if not kept.any():
        raise ValueError("its mesh has no area")
    found = [points, normals]
    if corners.within is not None:
        found.append(placed(corners.points, corners.within, *place)[1])
    found = [np.ascontiguousarray(part[kept]) for part in found]
    return (*found, None)[:3]


def triangles_of(mesh: bpy.types.Mesh, opaque: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (T, 3, 3) of the corners of a mesh's triangles, in its own frame.

    Parameters
    ----------
    opaque : what `opaque_bits` has of the glass; its faces that are no glass are left out.

    Raises
    ------
    ValueError
        No faces, or coordinates that are no numbers.
    """
    points = positions(mesh).astype(float)
    if is_hidden(mesh):
        normals = read_attribute(mesh.attributes[CORNER_NORMAL]).astype(float)
        # What casts the shadow and what is opaque have no such normals.
        own_points = normals.any(axis=1)
        points, normals = points[own_points], normals[own_points]
    else:
        glass = np.flatnonzero(~_is_opaque(mesh, opaque))
        normals = corner_normals(mesh).astype(float)[mesh_triangles(mesh, "loops")[glass]]
        points = points[mesh_triangles(mesh)[glass]]
    if not len(points):
        raise ValueError("its mesh has no faces: a glass needs some")
    if not np.isfinite(points).all():
        raise ValueError("its mesh has a point that is no number: delete or move it")
    return points.reshape(-1, 3, 3), normals.reshape(-1, 3, 3)


def is_hidden(mesh: bpy.types.Mesh) -> bool:
    """Whether a glass's modifier left its glass's corners of an evaluated mesh, and no face."""
    return CORNER_NORMAL in mesh.attributes


def _is_opaque(mesh: bpy.types.Mesh, opaque: int) -> np.ndarray:
    """(T,) whether each of a mesh's triangles is of one of the opaque slots."""
    slots = np.minimum(triangle_slots(mesh), MOST_SLOTS)
    return (opaque >> slots & 1).astype(bool)


def placed_opaque(obj: bpy.types.Object, to_world: np.ndarray, opaque: int) -> np.ndarray:
    """(K, 3, 3) corners in the world of the triangles of an evaluated glass that are no glass.

    They are known by their materials: what is left of a mesh may have these in other slots.
    """
    if not opaque:
        return np.zeros((0, 3, 3))
    mesh, known = obj.data, opaque_materials(obj, opaque)
    is_opaque = [(None if m is None else m.original) in known for m in mesh.materials]
    chosen = np.array([*is_opaque, False])[np.minimum(triangle_slots(mesh), len(is_opaque))]
    points = positions(mesh).astype(float)[mesh_triangles(mesh)[chosen]]
    return points @ to_world[:3, :3].T + to_world[:3, 3]


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
    """(3,) absorption coefficients, per metre, of the volume of an object's first glassy material.

    They are those of a Volume Absorption node that leads to the material's output, as Cycles has
    them; of all other volumes 0. Inputs with links count as they would without.
    """
    material = next(iter(glassy_materials(obj)), None)
    if material is None:
        return np.zeros(3)
    tree = material.evaluated_get(depsgraph).node_tree
    node = leading_node(tree, "Volume", "VOLUME_ABSORPTION")
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


def unread(obj: bpy.types.Object, opaque: int) -> list[str]:
    """A line for each thing that an object's materials have and that is not seen in the glass.

    ``opaque``: see `triangles_of`.
    """
    materials = glassy_materials(obj)
    if not materials:
        return []
    found, node = [], interface_node(materials[0])
    # Of normals `bumps.lost_bumps` tells.
    links = ((i.name, i.links) for i in node.inputs if i.name != "Normal")
    linked = [name for name, of in links if any(not link.is_muted for link in of)]
    others = (node.inputs.get(name) for name in _BESIDE_GLASS)
    linked += [i.name for i in others if i is not None and not i.is_linked and i.default_value]
    if linked:
        found.append(
            f'Glass "{obj.name}" is seen without what its material "{materials[0].name}" has as '
            f"{', '.join(linked)}: it takes plain values of a glass"
        )
    index = np.empty(len(obj.data.polygons), np.int32)
    obj.data.polygons.foreach_get("material_index", index)
    shown = [slot.material for n, slot in enumerate(obj.material_slots) if (index == n).any()]
    used = [m for m in dict.fromkeys(shown) if m is not None]
    if any(m in materials[1:] for m in used):
        found.append(
            f'Glass "{obj.name}" is all of its first glassy material, "{materials[0].name}": '
            "separate the faces of others (Edit Mode, P > By Material), which then are glasses too"
        )
    known = {*materials, *opaque_materials(obj, opaque)}
    left = [m.name for m in used if m not in known]
    if left:
        found.append(
            f'Glass "{obj.name}" is glass on its faces of "{", ".join(left)}" too: link these '
            "materials to Data (Material Properties), or separate the faces (Edit Mode, P > By "
            "Material)"
        )
    return found


_BESIDE_GLASS = ("Metallic", "Coat Weight", "Emission Strength", "Thin Film Thickness", "Thin Wall")
"""Inputs of a shader that make of a glass what is not computed; plain glass has 0. Blender has a
thin wall since 5.2."""


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


LEAST_TRANSMISSION = 0.5
"""Of a Principled BSDF, from which on it is a glass."""
_READERS = {"BSDF_GLASS": _glass, "BSDF_REFRACTION": _glass, "BSDF_PRINCIPLED": _principled}


def open_edges(mesh: bpy.types.Mesh) -> tuple[int, int]:
    """Edges of a mesh that bound one face only, and those that bound more than two."""
    count = np.bincount(edges_of_corners(mesh), minlength=len(mesh.edges))
    return int((count == 1).sum()), int((count > 2).sum())
