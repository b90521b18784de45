# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `still_life`: a bottle of water with a label, a wine glass, an ice cube and a lens.

All as artists make them: bottle and lens are profiles turned by Screw modifiers, the ice is a cube
with a bevel. The water overlaps its bottle by a little; the bottle's priority is the higher one, so
light finds glass and water touching. The wine glass is a closed form.

    python demo_scenes/still_life.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

GLASS, WATER, ICE, FLINT = 1.52, 1.333, 1.31, 1.62
STEPS = 96
# Metres.
FILM = 0.0005
WALL, OVERLAP, LEVEL = 0.003, 0.0008, 0.085
OUTSIDE = (
    (0.0, 0.0), (0.028, 0.0), (0.031, 0.003), (0.031, 0.095), (0.029, 0.107), (0.020, 0.122),
    (0.0125, 0.134), (0.0115, 0.145), (0.0115, 0.165), (0.013, 0.167), (0.013, 0.174),
)  # fmt: skip
BOTTLE_AT, WINE_AT = (-0.045, 0.02, 0.0), (0.065, 0.055, 0.0)
ICE_AT, ICE_SIZE = (0.028, -0.035, 0.0125), 0.025
LENS_AT, LENS_RADIUS, LENS_BULGE = (-0.012, -0.075, 0.022), 0.022, 0.005
WALL_DISTANCE, TABLE_EDGE = 0.20, -0.30
EYE, TARGET = (0.02, -0.48, 0.15), (0.0, 0.0, 0.075)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the glasses; the label hangs in the air without them.
    """
    scene = common.empty_scene("still_life")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    tiles = common.tiles(
        0.03, 0.03, 0.002, ((0.62, 0.60, 0.52), (0.40, 0.50, 0.60)), (0.25, 0.28, 0.31)
    )
    common.table_before_wall(scene, TABLE_EDGE, WALL_DISTANCE, -FILM, tiles, unlit=unlit)
    common.light_up(scene, unlit=unlit, sun_direction=(-0.5, 0.6, -0.8))
    common.camera(scene, EYE, TARGET, 0.058)
    add_label(scene, unlit=unlit)
    if with_glass:
        add_glasses(scene)
    common.settle_cup(scene, 1, unlit=unlit)
    scene.refractive_glass.shading = "TRUE"
    common.limit_samples(scene)
    return scene


def turned(
    scene: bpy.types.Scene, name: str, profile: Sequence[Sequence[float]]
) -> bpy.types.Object:
    """A profile of points (radius, height), anticlockwise round its right side, turned by Screw."""
    data = bpy.data.meshes.new(name)
    points = [(radius, 0.0, height) for radius, height in profile]
    data.from_pydata(points, [(k, k + 1) for k in range(len(points) - 1)], [])
    obj = common.link(scene, name, data)
    screw = obj.modifiers.new("Screw", "SCREW")
    screw.axis, screw.angle = "Z", 2.0 * math.pi
    screw.steps = screw.render_steps = STEPS
    screw.use_merge_vertices, screw.merge_threshold = True, 1e-6
    screw.use_smooth_shade = True
    screw.use_normal_flip = True
    return obj


def inside() -> list[tuple[float, float]]:
    """The bottle's inner profile, from the mouth down to the axis."""
    outer = np.array(OUTSIDE[2:])
    steps = np.gradient(outer, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    inner = outer - WALL * np.stack((steps[:, 1], -steps[:, 0]), axis=1)
    inner[:, 0] = np.minimum(inner[:, 0], outer[:, 0] - 0.7 * WALL)
    inner[-1, 1] = outer[-1, 1]
    inner[0] = (outer[0, 0] - WALL, 2.0 * WALL)
    return [(0.0, 1.6 * WALL), *map(tuple, inner)][::-1]


def add_label(scene: bpy.types.Scene, *, unlit: bool) -> bpy.types.Object:
    """Stick a label round the front of the bottle and return it."""
    angles = np.linspace(math.radians(215.0), math.radians(330.0), 33)
    radius, low, high = OUTSIDE[3][0] + FILM, 0.030, 0.065
    rows = [
        np.stack((radius * np.cos(angles), radius * np.sin(angles), np.full_like(angles, z)), -1)
        for z in (low, high)
    ]
    faces = common.grid_faces(2, len(angles), flip=True)
    corners = np.stack((np.tile(np.linspace(0, 1, len(angles)), 2), np.repeat((0, 1), 33)), -1)
    data = common.mesh("Label", np.concatenate(rows), faces, uv=corners[faces.ravel()], smooth=True)
    stripes = common.stripes(9, 0.5, (0.75, 0.68, 0.50), (0.45, 0.08, 0.07))
    data.materials.append(common.material("Label", stripes, unlit=unlit))
    label = common.link(scene, "Label", data)
    label.location = BOTTLE_AT
    return label


def add_glasses(scene: bpy.types.Scene) -> None:
    """Put bottle, water, wine glass, ice and lens on the table."""
    common.register_extension()
    bottle = turned(scene, "Bottle", [*OUTSIDE, *inside()])
    bottle.location = BOTTLE_AT
    common.own_mesh_glass(bottle, GLASS, priority=1)
    wet = [(r + OVERLAP, z) for r, z in inside()[::-1][1:] if z < LEVEL - 0.01]
    below = (0.0, 1.6 * WALL - OVERLAP)
    first = (wet[0][0], wet[0][1] - OVERLAP)
    top = (wet[-1][0], LEVEL)
    water = turned(scene, "Water", [below, first, *wet[1:], top, (0.0, LEVEL)])
    water.location = BOTTLE_AT
    common.own_mesh_glass(water, WATER)
    bpy.ops.object.refractive_glass_add(shape="REVOLUTION", ior=GLASS, location=WINE_AT)
    bpy.context.active_object.name = "Wine glass"
    bpy.ops.mesh.primitive_cube_add(size=ICE_SIZE, location=ICE_AT, rotation=(0.0, 0.0, 0.5))
    ice = bpy.context.active_object
    ice.name = "Ice"
    bevel = ice.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.12 * ICE_SIZE, 4
    common.own_mesh_glass(ice, ICE)
    lens = turned(scene, "Lens", lens_profile())
    lens.location, lens.rotation_euler = LENS_AT, (math.pi / 2.0, 0.0, 0.25)
    common.own_mesh_glass(lens, FLINT)


def lens_profile() -> list[tuple[float, float]]:
    """Two caps of spheres, from the lower middle round the rim to the upper one."""
    sphere = (LENS_RADIUS**2 + LENS_BULGE**2) / (2.0 * LENS_BULGE)
    half = math.asin(LENS_RADIUS / sphere)
    angles = np.linspace(0.0, half, 17)
    cap = np.stack((sphere * np.sin(angles), sphere * (1.0 - np.cos(angles)) - LENS_BULGE), axis=1)
    cap[0, 0] = 0.0
    return [*map(tuple, cap), *map(tuple, cap[-2::-1] * (1.0, -1.0))]


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("still_life", build))
