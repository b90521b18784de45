# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `suzanne`: Blender's monkey as a head of glass on a table, before a tiled wall.

Her mesh itself is the glass, subdivided by a modifier; it is open round the eyes.

    python demo_scenes/suzanne.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# Metres.
SIZE, IOR = 0.055, 1.5
TILT, TURN = math.radians(-35.0), math.radians(25.0)
HEIGHT = 0.0505
WALL_DISTANCE, TABLE_EDGE = 0.16, -0.30
EYE, TARGET = (0.0, -0.42, 0.12), (0.0, 0.0, 0.047)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the head.
    """
    scene = common.empty_scene("suzanne")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    tiles = common.tiles(
        0.02, 0.02, 0.0015, ((0.62, 0.60, 0.52), (0.35, 0.45, 0.55)), (0.20, 0.22, 0.25)
    )
    common.table_before_wall(scene, TABLE_EDGE, WALL_DISTANCE, 0.0, tiles, unlit=unlit)
    common.light_up(scene, unlit=unlit, sun_direction=(-0.5, 0.6, -0.8))
    common.camera(scene, EYE, TARGET, 0.060)
    if with_glass:
        add_head()
    common.settle_cup(scene, 1, unlit=unlit)
    scene.refractive_glass.shading = "TRUE"
    common.limit_samples(scene)
    return scene


def add_head() -> bpy.types.Object:
    """Put the head on the table and return it."""
    bpy.ops.mesh.primitive_monkey_add(size=2.0 * SIZE)
    head = bpy.context.active_object
    head.name = "Suzanne"
    head.location, head.rotation_euler = (0.0, 0.0, HEIGHT), (TILT, 0.0, TURN)
    head.data.shade_smooth()
    subdivision = head.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 2
    return common.own_mesh_glass(head, IOR)


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("suzanne", build))
