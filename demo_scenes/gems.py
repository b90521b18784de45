# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `gems`: balls and panes of the eighteen media, from vacuum to diamond.

python demo_scenes/gems.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# Metres.
COLUMNS, SPACING = 6, 0.10
RADIUS = 0.034
PANE_HALF, PANE_THICKNESS, PANE_TURN = 0.036, 0.016, math.radians(35.0)
WALL_DISTANCE = 0.22
EYE_DISTANCE = 0.95
COLOURS = {
    "Emerald": (0.15, 0.85, 0.40),
    "Topaz": (1.00, 0.75, 0.30),
    "Ruby/Sapphire": (0.90, 0.10, 0.20),
}
"""What white light becomes that runs a ball's radius through a gem."""


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: the wall emits its tiles; the sky is seen either way.
    ``with_glass``: add the gems by the extension's operator.
    """
    scene = common.empty_scene("gems")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    wall = common.quad("Wall", (-0.36, WALL_DISTANCE, -0.25), (0.72, 0.0, 0.0), (0.0, 0.0, 0.50))
    tiles = common.tiles(
        0.03, 0.03, 0.003, ((0.75, 0.72, 0.62), (0.20, 0.34, 0.48)), (0.10, 0.10, 0.12)
    )
    wall.materials.append(common.material("Wall tiles", tiles, unlit=unlit))
    common.link(scene, "Wall", wall)
    common.sky_world(scene)
    common.camera(scene, (0.0, -EYE_DISTANCE, 0.0), (0.0, 0.0, 0.0), 0.050)
    if with_glass:
        add_gems()
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    scene.refractive_glass.min_weight = 0.02
    common.settle(scene, 1)
    return scene


def add_gems() -> list[bpy.types.Object]:
    """Hang the gems up in rows, balls and panes by turns, and return them."""
    from glass_refraction.optics import MEDIA
    from glass_refraction.scene.read.glasses import glass_modifier
    from glass_refraction.scene.read.modifier_inputs import write_input

    made = []
    for number, (name, ior) in enumerate(MEDIA.items()):
        row, column = divmod(number, COLUMNS)
        is_ball = (row + column) % 2 == 0
        bpy.ops.object.refractive_glass_add(
            shape="SPHERE" if is_ball else "SLAB",
            radius=RADIUS if is_ball else PANE_HALF,
            wall_thickness=0.0 if is_ball else PANE_THICKNESS,
            ior=ior,
        )
        gem = bpy.context.active_object
        gem.name = name
        gem.location = ((column - 0.5 * (COLUMNS - 1)) * SPACING, 0.0, (1 - row) * SPACING)
        if not is_ball:
            gem.rotation_euler = (math.pi / 2, 0.0, PANE_TURN)
        if name in COLOURS:
            write_input(glass_modifier(gem), "Absorption Color", (*COLOURS[name], 1.0))
            write_input(glass_modifier(gem), "Absorption Distance", RADIUS)
        made.append(gem)
    return made


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("gems", build))
