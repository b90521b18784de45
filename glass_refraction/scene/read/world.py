# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as far as it is one colour, and what a picture makes of radiance."""

from __future__ import annotations

import bpy

from .node_ends import TOLD_APART, asks_for

Radiance = tuple[float, float, float]
BLACK: Radiance = (0.0, 0.0, 0.0)


def shown_world(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bpy.types.World | None:
    """The world that a view layer shows: in Cycles it may leave it out."""
    if scene.render.engine == "CYCLES" and not layer.use_sky:
        return None
    # Blender knows of a layer's own world from 5.0 on.
    return getattr(layer, "world_override", None) or scene.world


def uniform_radiance(world: bpy.types.World | None, engine: str) -> Radiance | None:
    """The radiance (linear red, green, blue) of a world of one colour, None of any other.

    Parameters
    ----------
    world : as it is evaluated. No world is black.
    engine : of the render; engines may have world outputs of their own.
    """
    if world is None:
        return BLACK
    if engine == "BLENDER_WORKBENCH" or world.node_tree is None:
        return tuple(float(c) for c in world.color)
    end = world.node_tree.get_output_node("CYCLES" if engine == "CYCLES" else "EEVEE")
    links = end.inputs["Surface"].links if end is not None else ()
    if not links:
        return BLACK
    node = links[0].from_node
    plain = node.type == "BACKGROUND" and not node.mute and not links[0].is_muted
    if not plain or any(socket.is_linked for socket in node.inputs):
        return None
    strength = float(node.inputs["Strength"].default_value)
    return tuple(float(c) * strength for c in node.inputs["Color"].default_value[:3])


def is_of_cameras(world: bpy.types.World | None, engine: str) -> bool:
    """Whether a world looks to a camera as it does not to light that has come through glass.

    Many a background is for cameras alone, by *Light Path* or *Ray Visibility*, and another world
    gives the light.
    """
    if world is None or engine == "BLENDER_WORKBENCH":
        return False
    if engine == "CYCLES" and not world.cycles_visibility.camera:
        return True
    return asks_for(world.node_tree, "LIGHT_PATH", TOLD_APART)


def film_exposure(scene: bpy.types.Scene) -> float:
    """By what the scene's engine multiplies radiance in its pictures."""
    return float(scene.cycles.film_exposure) if scene.render.engine == "CYCLES" else 1.0
