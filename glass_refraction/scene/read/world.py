# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as far as it is one colour."""

from __future__ import annotations

import bpy


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


def world_colour(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph
) -> tuple[float, float, float]:
    """The linear colour that a uniform world has in the scene's picture, as it is evaluated."""
    if scene.world is None:
        return (0.0, 0.0, 0.0)
    world = scene.world.evaluated_get(depsgraph)
    if scene.render.engine == "BLENDER_WORKBENCH" or world.node_tree is None:
        return tuple(world.color)
    end = world.node_tree.get_output_node("CYCLES")
    links = end.inputs["Surface"].links if end is not None else ()
    if not links:
        return (0.0, 0.0, 0.0)
    inputs = links[0].from_node.inputs
    strength = inputs["Strength"].default_value
    if scene.render.engine == "CYCLES":
        strength *= scene.cycles.film_exposure
    red, green, blue, _ = inputs["Color"].default_value
    return (strength * red, strength * green, strength * blue)
