# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `wine`: a wine glass half full of red wine, before a tiled wall.

The glass is a profile curve turned about its axis; the wine takes light by Beer and Lambert's law.

    python demo_scenes/wine.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# Metres.
FILM = 0.0005
LEVEL, IOR, WINE = 0.048, 1.5, 1.345
RED, DEPTH = (0.55, 0.03, 0.06, 1.0), 0.02
WALL_DISTANCE, TABLE_EDGE = 0.16, -0.30
EYE, TARGET = (0.0, -0.46, 0.16), (0.0, 0.0, 0.092)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the glass by the extension's operator.
    """
    scene = common.empty_scene("wine")
    scene.render.resolution_x, scene.render.resolution_y = 480, 640
    tiles = common.tiles(
        0.03, 0.03, 0.002, ((0.62, 0.60, 0.52), (0.74, 0.70, 0.60)), (0.30, 0.34, 0.38)
    )
    common.table_before_wall(scene, TABLE_EDGE, WALL_DISTANCE, -FILM, tiles, unlit=unlit)
    common.light_up(scene, unlit=unlit, sun_direction=(-0.5, 0.6, -0.8))
    common.camera(scene, EYE, TARGET, 0.060)
    if with_glass:
        add_glass()
    common.settle_cup(scene, 1, unlit=unlit)
    return scene


def add_glass() -> bpy.types.Object:
    """Stand the glass of wine on the table and return it."""
    common.register_extension()
    from glass_refraction.scene.read.glasses import glass_modifier
    from glass_refraction.scene.read.modifier_inputs import write_input

    bpy.ops.object.refractive_glass_add(
        shape="REVOLUTION", liquid_level=LEVEL, ior=IOR, contents_ior=WINE
    )
    glass = bpy.context.active_object
    glass.name = "Wine glass"
    modifier = glass_modifier(glass)
    write_input(modifier, "Contents Absorption Color", RED)
    write_input(modifier, "Contents Absorption Distance", DEPTH)
    return glass


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("wine", build))
