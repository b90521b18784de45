# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `bathroom`: a wavy pane before a tiled wall, a shelf with bottles and a rubber duck.

The pane is a mesh: flat at its back, with waves at its front. It ends within the picture, so that
all of it is seen both through the glass and beside it.

    python demo_scenes/bathroom.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

IOR = 1.52
# Metres.
LOW, HIGH = (-0.06, -0.05), (0.26, 0.27)
BACK, THICKNESS = 0.0, 0.006
WAVES = (((62.0, 21.0), 0.00040), ((-33.0, 88.0), 0.00028), ((140.0, -75.0), 0.00010))
"""Wave vectors along x and z, radians per metre, and heights, metres."""
STEP, HOLD = 0.002, 0.0001
"""Between vertices, and from an edge to the loop that holds it: Cycles smooths sharp edges."""
WALL_DISTANCE, SHELF_EDGE = 0.22, 0.06
BOTTLES = (
    ((-0.13, 0.15), 0.022, 0.13, (0.10, 0.28, 0.45)),
    ((0.02, 0.16), 0.026, 0.17, (0.62, 0.20, 0.16)),
    ((0.16, 0.15), 0.020, 0.10, (0.16, 0.42, 0.22)),
)
"""Place on the shelf (x, y), radius, height and colour of the stripes."""
DUCK_AT, YELLOW, ORANGE = (0.09, 0.11), (0.80, 0.60, 0.06), (0.80, 0.25, 0.03)
SHARP = math.radians(30.0)
EYE, TARGET = (0.02, -0.55, 0.13), (0.03, 0.1, 0.08)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the pane.
    """
    scene = common.empty_scene("bathroom")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    tiles = common.tiles(
        0.05, 0.05, 0.004, ((0.62, 0.66, 0.68), (0.25, 0.48, 0.55)), (0.30, 0.32, 0.33)
    )
    common.table_before_wall(scene, SHELF_EDGE, WALL_DISTANCE, 0.0, tiles, unlit=unlit)
    for number, (place, radius, height, colour) in enumerate(BOTTLES):
        bpy.ops.mesh.primitive_cylinder_add(
            vertices=64, radius=radius, depth=height, location=(*place, 0.5 * height)
        )
        stripes = common.stripes(8, 0.5, (0.70, 0.68, 0.62), colour)
        _finish(f"Bottle {number}", stripes, unlit=unlit)
    x, y = DUCK_AT
    for name, radius, place, colour in (
        ("Duck", 0.026, (x, y, 0.024), YELLOW),
        ("Duck head", 0.016, (x - 0.014, y - 0.008, 0.058), YELLOW),
        ("Duck beak", 0.006, (x - 0.028, y - 0.015, 0.056), ORANGE),
    ):
        bpy.ops.mesh.primitive_uv_sphere_add(
            segments=48, ring_count=24, radius=radius, location=place
        )
        _finish(name, colour, unlit=unlit)
    common.light_up(scene, unlit=unlit, sun_direction=(-0.5, 0.6, -0.8))
    common.camera(scene, EYE, TARGET, 0.040)
    if with_glass:
        common.own_mesh_glass(common.link(scene, "Pane", wavy_pane()), IOR)
    common.settle_cup(scene, 1, unlit=unlit)
    scene.refractive_glass.shading = "TRUE"
    common.limit_samples(scene)
    return scene


def _finish(name: str, colour, *, unlit: bool) -> None:
    """Name and smooth the mesh that was added last, and give it its material."""
    obj = bpy.context.active_object
    obj.name = name
    obj.data.materials.append(common.material(name, colour, unlit=unlit))
    obj.data.shade_smooth()
    obj.data.set_sharp_from_angle(angle=SHARP)


def wavy_pane() -> bpy.types.Mesh:
    """An upright pane, waves at its front and flat at its back; its edges are sharp."""
    x, z = (
        np.concatenate(
            ((low,), np.linspace(low + HOLD, high - HOLD, round((high - low) / STEP)), (high,))
        )
        for low, high in zip(LOW, HIGH, strict=True)
    )
    across, up = (part.ravel() for part in np.meshgrid(x, z))
    front = np.full(len(across), BACK - THICKNESS)
    for (along_x, along_z), height in WAVES:
        front -= height * np.sin(along_x * across + along_z * up)
    columns, rows = len(x), len(z)
    grid = common.grid_faces(rows, columns, flip=True)
    edge = np.concatenate(
        (
            np.arange(columns),
            columns * np.arange(1, rows) + columns - 1,
            columns * (rows - 1) + np.arange(columns - 1)[::-1],
            columns * np.arange(1, rows - 1)[::-1],
        )
    )
    points = np.concatenate(
        (
            np.stack((across, front, up), axis=1),
            np.stack((across[edge], np.full(len(edge), BACK), up[edge]), axis=1),
        )
    )
    behind = len(across) + np.arange(len(edge))
    sides = np.stack((edge, behind, np.roll(behind, -1), np.roll(edge, -1)), axis=1)
    faces = [*map(tuple, grid), *map(tuple, sides), tuple(behind[::-1])]
    data = common.mesh("Pane", points, faces)
    data.polygons.foreach_set("use_smooth", np.arange(len(faces)) < len(grid))
    data.update()
    return data


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("bathroom", build))
