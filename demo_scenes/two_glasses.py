# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `two_glasses`: the eraser behind its glass, and a slanting pane before both.

The pane ends in the middle of the picture: left of its edge the glass and the eraser are seen
through it, and shifted.

    python demo_scenes/two_glasses.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported
import eraser

# The pane, standing on the desk's near part. Metres.
SIDE = 0.22
THICKNESS = 0.010
PLACE = (-0.060, -0.115)
TURN = math.radians(30.0)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it; ``unlit`` and ``with_glass`` as ever."""
    scene = eraser.build(unlit=unlit, with_glass=with_glass)
    scene.name = "two_glasses"
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    if with_glass:
        add_pane()
        common.settle(scene, eraser.PICTURE_FRAME)
    return scene


def add_pane() -> bpy.types.Object:
    """Stand the pane before the glass and return it."""
    bpy.ops.object.refractive_glass_add(
        shape="SLAB", radius=0.5 * SIDE, wall_thickness=THICKNESS, ior=eraser.GLASS_IOR
    )
    pane = bpy.context.active_object
    pane.name = "Pane"
    pane.location = (*PLACE, 0.5 * SIDE)
    pane.rotation_euler = (0.5 * math.pi, 0.0, TURN)
    return pane


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("two_glasses", build))
