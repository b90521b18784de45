# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of a surface without rendering it: a stand-in where no view shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum

import bpy
import numpy as np

from ..read.cutouts import Cutout
from ..read.node_ends import OF_CAMERAS, TOLD_APART, asks_for, leading_node, trees
from .beams import Beam

GLOSSY = 0.7
"""Roughness below which what a surface shows depends on where it is seen from."""
DIRECTED = {
    "BSDF_GLOSSY",
    "BSDF_METALLIC",
    "BSDF_GLASS",
    "BSDF_REFRACTION",
    "FRESNEL",
    "LAYER_WEIGHT",
}
"""Nodes by which it does, whatever their roughness."""
MIRROR = 0.3
"""Roughness below which images are seen in a surface."""
POLISHED = 0.15
"""Roughness below which these images are sharp enough to be told from one direction."""
SHINING = 2.0
"""Radiance, of the brightest of red, green and blue, from which on a surface shines."""
OUTSHINING = 10.0
"""The same from which on that is all there is to see, whatever else the surface sends back."""
DIELECTRIC = 0.04
"""Reflectance of a surface of ior 1.5 that is seen squarely."""


class Clear(Enum):
    """How other things are seen through a surface."""

    GLASS = "by rays that it refracts"
    ALPHA = "by rays that go straight on"


@dataclass(frozen=True)
class Look:
    """A surface's colours.

    Attributes
    ----------
    albedo : part of the light (red, green, blue) that it sends back.
    radiance : light of its own, scene-linear.
    is_lamp : the radiance is all that it shows, and no view shows it. It is not there for light
        that it does not meet with its own.
    is_hidden : from cameras.
    is_passed : by light that has come through a glass: *Transmission* is off.
    is_uncaptured : captures do not show it, or otherwise than the picture.
    is_hole : a holdout: pictures have a hole there, and those of other scenes' cameras have not.
    is_glossy : what it shows depends on where it is seen from.
    is_of_cameras : light that comes through glass meets it otherwise, by *Light Path*: views
        show it so behind a pane.
    is_of_paths : and otherwise than behind a pane.
    clear : how other things are seen through it; None: not at all, or nobody knows.
    is_mirror : other things are seen in it.
    reflectance : part of the light that it mirrors where it is seen squarely.
    is_plain : it shines, and shows that alone wherever it is seen from: no view need show it.
    polish : part of the light (red, green, blue) that it mirrors where it is seen squarely, of what
        is polished, flat and of one kind all over; else None.
    faces : 1: it is there on the side of its normals only; −1: on the other; 0: on both.
    beam : how the radiance depends on the direction that light goes in; None: not at all.
    factors : of its light that comes through a glass, and that one mirrors.
    cutout : where nothing of it is there.
    """

    albedo: tuple[float, float, float] = (0.8, 0.8, 0.8)
    radiance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_lamp: bool = False
    is_glossy: bool = False
    faces: int = 0
    beam: Beam | None = None
    is_hidden: bool = False
    is_passed: bool = False
    is_hole: bool = False
    is_uncaptured: bool = False
    is_of_cameras: bool = False
    is_of_paths: bool = False
    clear: Clear | None = None
    is_mirror: bool = False
    reflectance: float = DIELECTRIC
    factors: tuple[float, float] = (1.0, 1.0)
    is_plain: bool = False
    polish: tuple[float, float, float] | None = None
    cutout: Cutout | None = None

    def lights(self, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(K,) how bright it is, over its radiance, for ways that meet it.

        Parameters
        ----------
        normals : (K, 3) of what they meet of it. directions : (K, 3) unit, away from the eye.
        """
        part = self.is_before(normals, directions).astype(float)
        return part if self.beam is None else part * self.beam.part(-directions)

    def is_before(self, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(K,) whether ways meet it on a side on which it is there; arguments as of `lights`."""
        if not self.faces:
            return np.ones(len(directions), bool)
        return self.faces * np.einsum("nk,nk->n", normals, directions) < 0.0


LookOf = Callable[[bpy.types.Material | None], Look | None]
"""The look of what has a material; None where no ray meets it."""


def look_of(material: bpy.types.Material | None) -> Look:
    """The look of a material."""
    if material is None:
        return Look()
    tree, look = material.node_tree, _shader_look(material)
    own_light = _own_light(tree) or _outshining(tree)
    if own_light and max(own_light) > SHINING:
        look = replace(look, radiance=own_light, is_plain=True)
    return replace(
        look,
        is_glossy=look.is_glossy or _is_glossy(tree),
        polish=_polish(tree),
        clear=next(filter(None, map(_clear, _nodes(tree))), None),
        is_uncaptured=_asks_for_camera(tree),
        is_of_cameras=asks_for(tree, "LIGHT_PATH", TOLD_APART),
        is_of_paths=asks_for(tree, "LIGHT_PATH", TOLD_APART - OF_CAMERAS),
    )


def _polish(tree: bpy.types.NodeTree | None) -> tuple[float, float, float] | None:
    """`Look.polish` of a flat face, by the Principled BSDF that leads to the output."""
    node = leading_node(tree, "Surface", "BSDF_PRINCIPLED")
    if node is None:
        return None
    metallic, colour, *rest = (node.inputs[name] for name in POLISH_INPUTS)
    if any(i.is_linked for i in (metallic, *rest)) or (metallic.default_value and colour.is_linked):
        return None
    roughness, ior, level, _, *others = (i.default_value for i in rest)
    if roughness >= POLISHED or any(others) or node.inputs["Alpha"].default_value < 1.0:
        return None
    straight = 2.0 * level * ((ior - 1.0) / (ior + 1.0)) ** 2
    metallic = metallic.default_value
    return tuple(straight + (float(c) - straight) * metallic for c in colour.default_value[:3])


POLISH_INPUTS = ("Metallic", "Base Color", "Roughness", "IOR", "Specular IOR Level", "Normal")
POLISH_INPUTS += ("Transmission Weight", "Coat Weight", "Thin Film Thickness", "Anisotropic")
"""Of a Principled BSDF, on which its mirror images depend; the last four make them other ones."""


def _is_glossy(tree: bpy.types.NodeTree | None) -> bool:
    """Whether anything in a material's tree or its groups depends on where it is seen from."""
    return (
        any(node.type in DIRECTED for node in _nodes(tree))
        or asks_for(tree, "NEW_GEOMETRY", {"Incoming"})
        or asks_for(tree, "TEX_COORD", {"Reflection"})
    )


def _clear(node: bpy.types.Node) -> Clear | None:
    """How a shader surely lets light through: what is linked may be anything."""
    if node.type in {"BSDF_GLASS", "BSDF_REFRACTION"}:
        return Clear.GLASS
    if node.type != "BSDF_PRINCIPLED":
        return None
    for name, solid, clear in (
        ("Alpha", 1.0, Clear.ALPHA),
        ("Transmission Weight", 0.0, Clear.GLASS),
    ):
        if not node.inputs[name].is_linked and node.inputs[name].default_value != solid:
            return clear
    return None


def _nodes(tree: bpy.types.NodeTree | None) -> Iterator[bpy.types.Node]:
    """The nodes of a tree and its groups that are not muted."""
    return (node for one in trees(tree) for node in one.nodes if not node.mute)


def _asks_for_camera(tree: bpy.types.NodeTree | None) -> bool:
    """Whether a material looks otherwise to a camera that stands elsewhere, however matte it is."""
    distance = {"View Vector", "View Z Depth", "View Distance"}
    return asks_for(tree, "CAMERA", distance) or asks_for(tree, "TEX_COORD", {"Camera", "Window"})


def _shader_look(material: bpy.types.Material) -> Look:
    """The look of a material: that of its first shader that tells a colour."""
    plain = tuple(float(c) for c in material.diffuse_color[:3])
    tree = material.node_tree
    if tree is None:
        return Look(plain, is_glossy=material.roughness < GLOSSY)
    for node in tree.nodes:
        if node.type == "EMISSION":
            return Look((0.0, 0.0, 0.0), _emitted(node, ""))
        if node.type == "BSDF_PRINCIPLED":
            colour = tuple(float(c) for c in node.inputs["Base Color"].default_value[:3])
            roughness = float(node.inputs["Roughness"].default_value)
            metallic = float(node.inputs["Metallic"].default_value)
            straight = DIELECTRIC + (sum(colour) / 3.0 - DIELECTRIC) * metallic
            mirrors = metallic > 0.0 or node.inputs["Specular IOR Level"].default_value > 0.0
            return Look(
                colour,
                _emitted(node, "Emission "),
                is_glossy=mirrors and roughness < GLOSSY,
                is_mirror=mirrors and roughness < MIRROR,
                reflectance=straight,
            )
        if node.type in {"BSDF_DIFFUSE", "BSDF_GLOSSY"}:
            colour = tuple(float(c) for c in node.inputs["Color"].default_value[:3])
            if node.type == "BSDF_DIFFUSE":
                return Look(colour)
            return Look(colour, is_glossy=True, is_mirror=True, reflectance=sum(colour) / 3.0)
    return Look(plain)


def _emitted(node: bpy.types.Node, prefix: str) -> tuple[float, float, float]:
    """The light that a shader gives by its own inputs, whose names begin so."""
    strength = float(node.inputs[f"{prefix}Strength"].default_value)
    return tuple(float(c) * strength for c in node.inputs[f"{prefix}Color"].default_value[:3])


def marked_look(look: LookOf, **marks: bool | None) -> LookOf:
    """The same looks with some of their marks set, such as ``is_passed``."""

    def marked(material: bpy.types.Material | None) -> Look | None:
        found = look(material)
        return found and replace(found, **marks)

    return marked


def look_among(look: LookOf, materials: set[bpy.types.Material | None]) -> LookOf:
    """The same look of some (original) materials; None of all others."""

    def chosen(material: bpy.types.Material | None) -> Look | None:
        original = None if material is None else material.original
        return look(material) if original in materials else None

    return chosen


def hole_look(_material: bpy.types.Material | None) -> Look:
    """The look of a holdout."""
    return Look((0.0, 0.0, 0.0), is_hole=True)


def softbox_look(material: bpy.types.Material | None) -> Look | None:
    """The look of what is hidden from cameras: that of a lamp if it emits one colour, else None."""
    light = _own_light(material and material.node_tree)
    return light and Look((0.0, 0.0, 0.0), light, is_lamp=True, is_hidden=True)


def _own_light(tree: bpy.types.NodeTree | None) -> tuple[float, float, float] | None:
    """The radiance of what emits one colour and does nothing else; None of all others."""
    node = leading_node(tree, "Surface", "EMISSION")
    if node is None or node.inputs["Color"].is_linked or node.inputs["Strength"].is_linked:
        return None
    return _emitted(node, "")


def _outshining(tree: bpy.types.NodeTree | None) -> tuple[float, float, float] | None:
    """The radiance of a Principled BSDF that emits one colour, so much that nothing else counts."""
    node = leading_node(tree, "Surface", "BSDF_PRINCIPLED")
    if node is None or node.inputs["Alpha"].default_value < 1.0:
        return None
    if any(
        node.inputs[name].is_linked for name in ("Alpha", "Emission Color", "Emission Strength")
    ):
        return None
    light = _emitted(node, "Emission ")
    return light if max(light) > OUTSHINING else None


def card_look(material: bpy.types.Material | None) -> Look:
    """The look of what is hidden from cameras alone, a softbox or not."""
    softbox = softbox_look(material)
    return softbox or replace(look_of(material), is_hidden=True, is_of_cameras=True)
