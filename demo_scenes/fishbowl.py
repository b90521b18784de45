# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `fishbowl`: a fish in a ball of glass full of water, before a tiled wall.

The bowl is a whole ball. What is in it appears magnified, what is behind it upside down.

    python demo_scenes/fishbowl.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from aquarium import fish_mesh

import common  # the script's own folder is not on the path when it is imported

# Metres.
RADIUS, WALL, IOR, WATER = 0.12, 0.003, 1.5, 1.333
CENTRE = (0.0, 0.0, 0.13)
FISH_PLACE, FISH_LENGTH, FISH_TURN = (0.01, 0.02, 0.135), 0.075, 2.75
FISH_COLOURS = ((0.90, 0.32, 0.04), (0.95, 0.80, 0.55))
WALL_DISTANCE = 0.30
EYE, TARGET = (0.05, -0.72, 0.22), (0.0, 0.0, 0.13)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the bowl by the extension's operator.
    """
    scene = common.empty_scene("fishbowl")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    desk = common.quad("Desk", (1.0, -1.2, 0.0), (0.0, 1.2 + WALL_DISTANCE, 0.0), (-2.0, 0.0, 0.0))
    grain = common.wood((0.50, 0.31, 0.16), (0.36, 0.20, 0.09), ring=0.03)
    desk.materials.append(common.material("Desk wood", grain, unlit=unlit))
    common.link(scene, "Desk", desk)
    wall = common.quad("Wall", (-1.0, WALL_DISTANCE, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    tiles = common.tiles(
        0.07, 0.07, 0.005, ((0.62, 0.52, 0.40), (0.72, 0.62, 0.50)), (0.30, 0.34, 0.38)
    )
    wall.materials.append(common.material("Wall tiles", tiles, unlit=unlit))
    common.link(scene, "Wall", wall)
    data = fish_mesh("Goldfish", FISH_LENGTH, FISH_COLOURS, unlit=unlit)
    fish = common.link(scene, "Goldfish", data)
    fish.location, fish.rotation_euler.z = FISH_PLACE, FISH_TURN
    common.light_up(scene, unlit=unlit, sun_direction=(0.5, 0.6, -0.7), sun_strength=2.5)
    common.camera(scene, EYE, TARGET, 0.060)
    if with_glass:
        add_bowl()
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    common.settle(scene, 1)
    return scene


def add_bowl() -> bpy.types.Object:
    """Hang the bowl round the fish and return it."""
    bpy.ops.object.refractive_glass_add(
        shape="SPHERE", radius=RADIUS, wall_thickness=WALL, ior=IOR, contents_ior=WATER
    )
    bowl = bpy.context.active_object
    bowl.name = "Bowl"
    bowl.location = CENTRE
    return bowl


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("fishbowl", build))
