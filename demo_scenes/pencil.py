# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `pencil`: a pencil in a glass of water, on a table; the camera rises.

The pencil leans in a tumbler and stands across the water's surface. The camera begins below the
waterline, where the surface is a mirror, and ends high above it, where the pencil is seen through
the surface, the wall and the open top at once.

    python demo_scenes/pencil.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# The glass, standing at the table's origin. Metres.
RADIUS, WALL, HEIGHT, BOTTOM, LEVEL = 0.036, 0.0025, 0.110, 0.007, 0.065
IOR, WATER = 1.5, 1.333
FILM = 0.0005
"""Air between the table and the glass: they must not lie in one plane."""

# The pencil: from its tip on the glass's bottom up past the rim, which it leans against.
TIP, RIM_POINT = (-0.0215, 0.004, 0.0085), (0.0262, -0.004, 0.111)
LENGTH, THICKNESS = 0.165, 0.0072
CONE, LEAD, FERRULE, RUBBER = 0.018, 0.005, 0.010, 0.009

FRAMES = (1, 48)
EYES = {1: (0.03, -0.34, 0.052), 24: (0.03, -0.33, 0.135), 48: (0.03, -0.24, 0.290)}
TARGET = (0.002, 0.0, 0.066)
WALL_DISTANCE, TABLE_EDGE = 0.19, -0.22


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the glass of water by the extension's operator.
    """
    scene = common.empty_scene("pencil")
    scene.frame_start, scene.frame_end = FRAMES
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    tiles = common.tiles(
        0.03, 0.03, 0.002, ((0.36, 0.52, 0.50), (0.50, 0.64, 0.60)), (0.78, 0.77, 0.72)
    )
    common.table_before_wall(scene, TABLE_EDGE, WALL_DISTANCE, -FILM, tiles, unlit=unlit)
    pencil = common.link(scene, "Pencil", pencil_mesh(unlit=unlit))
    along = Vector(RIM_POINT) - Vector(TIP)
    common.place(pencil, TIP, along.to_track_quat("Z", "Y"))
    common.light_up(scene, unlit=unlit, sun_direction=(-0.6, 0.55, -0.75))
    animate_camera(scene)
    if with_glass:
        common.glass_of_water(RADIUS, WALL, HEIGHT, BOTTOM, LEVEL, IOR, WATER)
    common.settle_cup(scene, FRAMES[1] // 2, unlit=unlit)
    return scene


def animate_camera(scene: bpy.types.Scene) -> None:
    """Let the camera rise, always looking at the glass."""
    camera = common.camera(scene, EYES[1], TARGET, 0.060)
    common.keyframe_location(camera, EYES)
    target = common.link(scene, "Target", None)
    target.location = TARGET
    track = camera.constraints.new("TRACK_TO")
    track.target, track.track_axis, track.up_axis = target, "TRACK_NEGATIVE_Z", "UP_Y"


def pencil_mesh(*, unlit: bool) -> bpy.types.Mesh:
    """Return the pencil along z, its tip at the origin: lead, wood, paint, ferrule, rubber."""
    radius = THICKNESS / 2
    lead = radius * LEAD / CONE
    end = LENGTH - FERRULE - RUBBER
    # Height, radius and material up to the next ring; steps of 2 mm keep edges short.
    marks = [
        (0.0, 0.0002, 0),
        (LEAD, lead, 1),
        (CONE, radius, 2),
        (end, radius, 3),
        (end, radius * 1.04, 3),
        (LENGTH - RUBBER, radius * 1.04, 4),
        (LENGTH - RUBBER, radius * 0.96, 4),
        (LENGTH, radius * 0.96, 4),
    ]
    rings, kinds = [(0.0, 0.0)], [0]
    for (z0, r0, kind), (z1, r1, _) in pairwise(marks):
        steps = max(1, round((z1 - z0) / 0.002))
        for step in range(steps):
            share = step / steps
            rings.append((z0 + share * (z1 - z0), r0 + share * (r1 - r0)))
            kinds.append(kind)
    rings += [marks[-1][:2], (LENGTH, 0.0)]
    kinds.append(4)
    sides = 24
    angle = np.arange(sides) * (2 * np.pi / sides)
    # A rounded hexagon: flats where the cosine's third harmonic is low.
    shape = 1.0 + 0.035 * np.cos(6 * angle)
    heights, radii = np.array(rings).T
    positions = np.stack(
        (
            radii[:, None] * shape * np.cos(angle),
            radii[:, None] * shape * np.sin(angle),
            np.broadcast_to(heights[:, None], (len(rings), sides)),
        ),
        axis=-1,
    ).reshape(-1, 3)
    row, side = np.meshgrid(np.arange(len(rings) - 1), np.arange(sides), indexing="ij")
    onward = (side + 1) % sides
    faces = np.stack(
        (
            row * sides + side,
            row * sides + onward,
            (row + 1) * sides + onward,
            (row + 1) * sides + side,
        ),
        axis=-1,
    ).reshape(-1, 4)
    # Rings of a band: every second stretch of the paint is darker, so that bends are seen.
    kinds = np.repeat(kinds, sides)
    band = (np.repeat(heights[:-1], sides) // 0.016).astype(int) % 2 == 1
    kinds = np.where((kinds == 2) & band, 5, kinds)
    colours = (
        ("Lead", (0.05, 0.05, 0.06)),
        ("Pencil wood", (0.72, 0.48, 0.26)),
        ("Paint", (0.85, 0.42, 0.02)),
        ("Ferrule", (0.55, 0.52, 0.45)),
        ("Rubber", (0.75, 0.22, 0.20)),
        ("Dark paint", (0.55, 0.10, 0.03)),
    )
    return common.mesh(
        "Pencil",
        positions,
        faces.tolist(),
        materials=[common.material(name, colour, unlit=unlit) for name, colour in colours],
        material_index=kinds,
        smooth=True,
    )


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("pencil", build))
