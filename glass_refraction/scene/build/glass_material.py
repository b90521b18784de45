# SPDX-License-Identifier: GPL-3.0-or-later
"""Real glass as a material of Cycles, for meshes of which each face is one interface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from ..read.glasses import Glass
from ..read.glassy_materials import CLEAR
from .shaders import math_node

SURFACES = {"GLASS": "ShaderNodeBsdfGlass", "REFRACTION": "ShaderNodeBsdfRefraction"}

Value = float | bpy.types.NodeSocket


@dataclass(frozen=True)
class Interface:
    """What an interface's material depends on: numbers, or sockets that tell them of a face.

    Attributes
    ----------
    eta : how many times as dense its back is as its front.
    absorption : coefficients (red, green, blue, per metre) of the media at its front and back, or
        None where both are clear.
    roughness, colour : of the surface. mirrored : its colour for what it reflects, if another.
    """

    eta: Value
    absorption: tuple[Sequence[Value], Sequence[Value]] | None = None
    roughness: Value = 0.0
    colour: Sequence[Value] = CLEAR
    mirrored: Sequence[Value] | None = None


def surface_look(glass: Glass) -> tuple[float, Sequence[float], Sequence[float]]:
    """Roughness of a glass's surface, its colour, and that of what it reflects."""
    mesh = glass.description
    return (
        (mesh.roughness, mesh.refracted, mesh.reflected) if glass.is_mesh else (0.0, CLEAR, CLEAR)
    )


def glass_shader(
    tree: bpy.types.NodeTree, interface: Interface, surface: str = "GLASS"
) -> bpy.types.ShaderNode:
    """Add a shader of glass to a tree. ``surface``: a key of `SURFACES`.

    What a ray lost on its way to the surface, it loses there.
    """
    another = interface.mirrored is not None and interface.mirrored != interface.colour
    if another and interface.absorption is None and surface == "GLASS":
        return _principled(tree, interface)
    shader = tree.nodes.new(SURFACES[surface])
    _give(tree, interface.eta, shader.inputs["IOR"])
    _give(tree, interface.roughness, shader.inputs["Roughness"])
    colour = interface.colour
    if interface.absorption is not None:
        colour = _left_over(tree, *interface.absorption, colour)
    _join(tree, colour, shader.inputs["Color"])
    return shader


def _principled(tree: bpy.types.NodeTree, interface: Interface) -> bpy.types.ShaderNode:
    """Glass that mirrors in another colour than it lets through: the Glass BSDF has one."""
    shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
    _give(tree, interface.eta, shader.inputs["IOR"])
    _give(tree, interface.roughness, shader.inputs["Roughness"])
    shader.inputs["Transmission Weight"].default_value = 1.0
    # It refracts by the root of its colour.
    squares = [
        math_node(tree, "MULTIPLY", part, part)
        if isinstance(part, bpy.types.NodeSocket)
        else part**2
        for part in interface.colour
    ]
    _join(tree, squares, shader.inputs["Base Color"])
    _join(tree, interface.mirrored, shader.inputs["Specular Tint"])
    return shader


def _join(
    tree: bpy.types.NodeTree, channels: Sequence[Value], target: bpy.types.NodeSocket
) -> None:
    """Give a colour input red, green and blue."""
    if not any(isinstance(value, bpy.types.NodeSocket) for value in channels):
        target.default_value = (*channels, 1.0)
        return
    join = tree.nodes.new("ShaderNodeCombineColor")
    for value, channel in zip(channels, join.inputs, strict=True):
        _give(tree, value, channel)
    tree.links.new(join.outputs["Color"], target)


def _give(tree: bpy.types.NodeTree, value: Value, target: bpy.types.NodeSocket) -> None:
    if isinstance(value, bpy.types.NodeSocket):
        tree.links.new(value, target)
    else:
        target.default_value = value


def _left_over(
    tree: bpy.types.NodeTree,
    before: Sequence[Value],
    behind: Sequence[Value],
    colour: Sequence[Value],
) -> list[bpy.types.NodeSocket]:
    """Beer and Lambert's law for the way since the last surface, without a volume's noise.

    What is left is multiplied by the surface's colour. Ways that end at a thing within the glass
    meet no further surface of it: their last stretch is not tinted.
    """
    backfacing = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
    length = tree.nodes.new("ShaderNodeLightPath").outputs["Ray Length"]
    way, found = math_node(tree, "MULTIPLY", length, -1.0), []
    for front, back, part in zip(before, behind, colour, strict=True):
        more = math_node(tree, "SUBTRACT", back, front)
        # A ray that meets the back comes through what is behind.
        coefficient = math_node(tree, "MULTIPLY_ADD", backfacing, more, front)
        depth = math_node(tree, "MULTIPLY", coefficient, way)
        found.append(math_node(tree, "MULTIPLY", math_node(tree, "EXPONENT", depth), part))
    return found
