# SPDX-License-Identifier: GPL-3.0-or-later
"""What light paths end at: the world, and what lies where neither copies nor the direct picture go.

A mesh before the camera, the *screen*, knows where each path's rays leave the glass and in which
direction (``screen.build_screen``). It wears a material that sends each of the engine's own rays on
from there (a ray portal): so the world, whatever nodes it is made of, is looked up in exact
directions and filtered as the engine filters. With the user's objects in the same scene, mirrored
things that the direct picture does not show are seen too, lit where they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from .. import optics
from .names import TAG, hidden_name, own
from .ray_screen import RayScreen
from .read.arrays import positions, write_attribute, write_polygons
from .read.glasses import NAMED_SHAPES, glass_modifier, glass_objects
from .read.modifier_inputs import read_input
from .read.viewpoint import Viewpoint
from .screen import Screen

WORLD_SAMPLES = 8
"""Of a world alone: it has no noise, only edges."""

_KEY = "refractive_glass_rays"
_PARTS = ("origin", "direction", "weight")


def surroundings(scene: bpy.types.Scene, shading: str) -> str:
    """What the engine's rays look up where the copies do not show it.

    Returns
    -------
    ``MIRRORED`` : objects, lamps and the world; paths with a mirror have no copies.
    ``HIDDEN`` : the same, but every path has copies (their light is looked up in the direct
        picture, which does not show all), or some paths have none (a tumbler has too many, and
        one glass behind another).
    ``WORLD`` : the world alone.
    empty : nothing; the world is one colour, or the engine shows none.
    """
    if scene.render.engine == "BLENDER_WORKBENCH":
        return ""
    if scene.refractive_glass.mirrors == "RAYS" and scene.refractive_glass.surface == "GLASS":
        return "MIRRORED"
    if shading == "TRUE" or _has_bare_paths(scene):
        return "HIDDEN"
    return "" if is_uniform(scene.world) else "WORLD"


def _has_bare_paths(scene: bpy.types.Scene) -> bool:
    """Whether there may be paths that cannot have copies.

    Of shapes that have too many, and through two glasses.
    """
    glasses = glass_objects(scene.view_layers[0])
    return len(glasses) > 1 or any(
        read_input(glass_modifier(glass), "Shape") in NAMED_SHAPES for glass in glasses
    )


def shows_objects(around: str) -> bool:
    """Whether the rays meet the user's objects (``around`` as :func:`surroundings` has it)."""
    return around in {"MIRRORED", "HIDDEN"}


def needs_copies(path: optics.LightPath, around: str) -> bool:
    """Whether displaced copies show what is seen along the path.

    Mirrors show what lies behind the camera, beside the picture or the back of things: next to
    nothing of it is in the direct picture, where the copies would look.
    """
    return around != "MIRRORED" or "R" not in path.events


def is_uniform(world: bpy.types.World | None) -> bool:
    """Whether the world has one colour for all directions."""
    if world is None or world.node_tree is None:
        return True
    end = world.node_tree.get_output_node("CYCLES")
    links = end.inputs["Surface"].links if end is not None else ()
    if not links:
        return True
    node = links[0].from_node
    return node.bl_idname == "ShaderNodeBackground" and not any(s.is_linked for s in node.inputs)


def ray_material(key: str, numbers: Sequence[int], *, weighed: bool) -> bpy.types.Material:
    """The material of a screen that sends rays on along paths.

    Of several paths the engine follows one a sample, picked by weight: their sum costs what one of
    them does.

    Parameters
    ----------
    key : of the same key there is one material.
    numbers : the paths', in the screen mesh's attributes.
    weighed : multiply by the paths' weights; else a path counts wholly wherever its ray is known.
    """
    for material in bpy.data.materials:
        if own(material, "rays") and material.get(_KEY) == key and material.library is None:
            bpy.data.materials.remove(material)
            break
    material = bpy.data.materials.new(hidden_name("rays", key))
    material[TAG], material[_KEY] = "rays", key
    tree = material.node_tree
    tree.nodes.clear()
    surface = None
    for number in numbers:
        portal = _portal(tree, number, weighed)
        if surface is not None:
            both = tree.nodes.new("ShaderNodeAddShader")
            tree.links.new(surface, both.inputs[0])
            tree.links.new(portal, both.inputs[1])
            portal = both.outputs[0]
        surface = portal
    # A mirrored ray may come back to the camera; there it passes the screen.
    side = tree.nodes.new("ShaderNodeNewGeometry")
    passing = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(side.outputs["Backfacing"], passing.inputs[0])
    tree.links.new(surface, passing.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], passing.inputs[2])
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(passing.outputs[0], end.inputs["Surface"])
    return material


def _portal(tree: bpy.types.NodeTree, number: int, weighed: bool) -> bpy.types.NodeSocket:
    portal = tree.nodes.new("ShaderNodeBsdfRayPortal")
    values = {}
    for part in _PARTS:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = _attribute(part, number)
        values[part] = attribute.outputs["Vector"]
    if not weighed:
        # A step beyond where it is taken too: the mean over a pixel is weighed as a whole.
        length = tree.nodes.new("ShaderNodeVectorMath")
        length.operation = "LENGTH"
        tree.links.new(values["direction"], length.inputs[0])
        known = tree.nodes.new("ShaderNodeMath")
        known.operation = "GREATER_THAN"
        known.inputs[1].default_value = 0.5
        tree.links.new(length.outputs["Value"], known.inputs[0])
        values["weight"] = known.outputs[0]
    for part, socket in zip(_PARTS, ("Position", "Direction", "Color"), strict=True):
        tree.links.new(values[part], portal.inputs[socket])
    return portal.outputs[0]


def _attribute(part: str, number: int) -> str:
    return f"rg_{part}_{number}"


def write_screen(mesh: bpy.types.Mesh, view: Viewpoint, screen: Screen, depth: float) -> None:
    """Make the mesh the screen, across the view before the camera.

    Parameters
    ----------
    depth : along the view direction, metres; less than that of anything to be seen.
    """
    origins, directions = view.rays(*screen.pixels.T)
    places = origins + directions * (depth / (directions @ view.forward))[:, None]
    mesh.clear_geometry()
    write_polygons(mesh, places, screen.cells)
    for row, number in enumerate(screen.numbers):
        colour = screen.weights[row][:, None] * screen.tints[row]
        for part, values in zip(
            _PARTS, (screen.origins[row], screen.directions[row], colour), strict=True
        ):
            write_attribute(mesh, _attribute(part, number), values, "FLOAT_VECTOR")
    mesh.update()
    mesh.update_tag()


def write_ray_screen(
    mesh: bpy.types.Mesh, view: Viewpoint, screen: RayScreen, depth: float
) -> None:
    """Make the mesh a cup's screen, as :func:`write_screen` does; a slot is a path there."""
    origins, directions = view.rays(*screen.pixels.T)
    places = origins + directions * (depth / (directions @ view.forward))[:, None]
    mesh.clear_geometry()
    write_polygons(mesh, places, screen.cells)
    all_values = (screen.origins, screen.directions, screen.colours)
    for part, values in zip(_PARTS, all_values, strict=True):
        for number, value in enumerate(values):
            write_attribute(mesh, _attribute(part, number), value, "FLOAT_VECTOR", "CORNER")
        # Slots that are empty now.
        number = len(values)
        while (unused := mesh.attributes.get(_attribute(part, number))) is not None:
            mesh.attributes.remove(unused)
            number += 1
    mesh.update()
    mesh.update_tag()


def write_curtain(mesh: bpy.types.Mesh, depth: float, width: float) -> None:
    """Make the mesh a black square close behind the screens, in the camera's frame.

    A compositor renders other scenes at its own scene's size, whatever border they have: without
    the curtain the engine would draw all that lies beside the glasses too, for nothing.

    Parameters
    ----------
    depth : along the view direction, metres: beyond the screens, before anything to be seen.
    width : of the picture there, metres, or more.
    """
    half = 0.5 * width
    corners = [(-half, -half, -depth), (half, -half, -depth), (half, half, -depth)]
    corners.append((-half, half, -depth))
    corners = np.array(corners, np.float32)
    if len(mesh.vertices) == 4 and np.array_equal(positions(mesh), corners):
        return
    mesh.clear_geometry()
    write_polygons(mesh, corners, np.array([(0, 1, 2, 3)]))
    mesh.update()
    mesh.update_tag()
