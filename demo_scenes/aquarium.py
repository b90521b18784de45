# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `aquarium`: fish behind the glass wall of a tank, seen at a slant.

The wall is a slab with water behind it; the water ends where something is.

    python demo_scenes/aquarium.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# Metres.
WALL, IOR, WATER = 0.012, 1.5, 1.333
HALF = 0.7
"""Half the wall's width: it fills the picture."""
DEPTH, HEIGHT = 0.40, 0.60
EYE, TARGET = (-0.42, -0.52, 0.30), (0.03, 0.12, 0.17)
FISH = {
    "Clown fish": ((-0.04, 0.10, 0.20), 0.15, 0.3, ((0.90, 0.35, 0.05), (0.95, 0.95, 0.92))),
    "Blue fish": ((0.14, 0.22, 0.26), 0.18, 2.8, ((0.05, 0.20, 0.60), (0.90, 0.80, 0.15))),
    "Striped fish": ((0.05, 0.30, 0.11), 0.13, -0.4, ((0.80, 0.80, 0.75), (0.06, 0.06, 0.07))),
}
"""Place, length, turn about z (radians) and the two colours."""


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the wall by the extension's operator.
    """
    scene = common.empty_scene("aquarium")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    back = common.quad("Back", (-1.5, DEPTH, 0.0), (3.0, 0.0, 0.0), (0.0, 0.0, 1.5))
    tiles = common.tiles(
        0.06, 0.06, 0.004, ((0.16, 0.42, 0.50), (0.22, 0.52, 0.58)), (0.60, 0.70, 0.70)
    )
    back.materials.append(common.material("Back tiles", tiles, unlit=unlit))
    common.link(scene, "Back", back)
    floor = common.quad("Sand", (-1.5, 0.02, 0.0), (3.0, 0.0, 0.0), (0.0, DEPTH - 0.02, 0.0))
    sand = common.wood((0.75, 0.66, 0.48), (0.55, 0.46, 0.30), ring=0.03)
    floor.materials.append(common.material("Sand", sand, unlit=unlit))
    common.link(scene, "Sand", floor)
    for name, (place, length, turn, colours) in FISH.items():
        fish = common.link(scene, name, fish_mesh(name, length, colours, unlit=unlit))
        fish.location = place
        fish.rotation_euler.z = turn
    common.light_up(scene, unlit=unlit, sun_direction=(0.25, 0.45, -0.8), sun_strength=2.5)
    common.camera(scene, EYE, TARGET, 0.050)
    if with_glass:
        add_wall()
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    common.settle(scene, 1)
    return scene


def add_wall() -> bpy.types.Object:
    """Stand the tank's wall before the water and return it."""
    bpy.ops.object.refractive_glass_add(
        shape="SLAB", radius=HALF, wall_thickness=WALL, ior=IOR, contents_ior=WATER
    )
    wall = bpy.context.active_object
    wall.name = "Tank wall"
    wall.location = (0.0, 0.0, 0.2)
    wall.rotation_euler.x = math.pi / 2  # its upper face to the room, its back to the water
    return wall


def fish_mesh(
    name: str, length: float, colours: tuple[common.Colour, common.Colour], *, unlit: bool
) -> bpy.types.Mesh:
    """Return a fish that swims along +x, centred, with stripes along its length."""
    around, along = 32, 48
    share = np.linspace(0.0, 1.0, along)
    # Nose, body, narrow before the tail, and the tail fin.
    height = np.interp(share, (0, 0.06, 0.3, 0.55, 0.8, 1.0), (0.0, 0.10, 0.21, 0.17, 0.05, 0.19))
    width = np.interp(share, (0, 0.06, 0.3, 0.55, 0.8, 1.0), (0.0, 0.06, 0.09, 0.07, 0.02, 0.004))
    angle = 2 * np.pi * np.arange(around + 1) / around
    positions = np.empty((along, around + 1, 3))
    positions[..., 0] = (0.5 - share)[:, None]
    positions[..., 1] = width[:, None] * np.cos(angle)
    positions[..., 2] = height[:, None] * np.sin(angle)
    faces = common.grid_faces(along, around + 1, flip=False)
    u, v = np.meshgrid(share, angle / (2 * np.pi), indexing="ij")
    uv = np.stack((u, v), axis=-1).reshape(-1, 2)[faces.ravel()]
    pattern = common.stripes(7, 0.45, *colours)
    material = common.material(name, pattern, unlit=unlit)
    return common.mesh(
        name, positions.reshape(-1, 3) * length, faces, uv=uv, materials=(material,), smooth=True
    )


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("aquarium", build))
