# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `verge`: a thick and a thin glass before a striped wall under a studio sky.

Near its verge a thin glass shows what is totally reflected at its inner face; the wall of the thick
one is so thick that light passes it without meeting the cavity. The glasses reach beyond the
picture above and below.

    python demo_scenes/verge.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# Metres.
HEIGHT = 0.40
IOR = 1.5
RADIUS = 0.045
GLASSES = {"Thick glass": (-0.095, 0.020), "Thin glass": (0.095, 0.0035)}
"""Place along x and wall thickness."""
WALL_DISTANCE = 0.30
WALL_SIZE = (0.52, 0.70)
STRIPES = 22
EYE = (0.0, -0.62, 0.20)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: the wall emits its stripes; the sky is seen either way.
    ``with_glass``: add the glasses by the extension's operator.
    """
    scene = common.empty_scene("verge")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    width, height = WALL_SIZE
    wall = common.quad(
        "Wall",
        (-width / 2, WALL_DISTANCE, EYE[2] - height / 2),
        (width, 0.0, 0.0),
        (0.0, 0.0, height),
    )
    pattern = common.stripes(round(STRIPES / width), 0.5, (0.80, 0.78, 0.70), (0.10, 0.24, 0.40))
    wall.materials.append(common.material("Wall stripes", pattern, unlit=unlit))
    common.link(scene, "Wall", wall)
    common.sky_world(scene)
    common.camera(scene, EYE, (0.0, 0.0, EYE[2]), 0.050)
    if with_glass:
        add_glasses()
    scene.refractive_glass.min_weight = 0.002
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    common.settle(scene, 1)
    return scene


def add_glasses() -> list[bpy.types.Object]:
    """Stand the two glasses side by side and return them."""
    made = []
    for name, (x, wall) in GLASSES.items():
        bpy.ops.object.refractive_glass_add(
            shape="CYLINDER", radius=RADIUS, wall_thickness=wall, height=HEIGHT, ior=IOR
        )
        glass = bpy.context.active_object
        glass.name = name
        glass.location = (x, 0.0, 0.0)
        made.append(glass)
    return made


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("verge", build))
