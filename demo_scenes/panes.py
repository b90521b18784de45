# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `panes`: four Utah teapots, each behind its own flat pane of glass.

After figure 9 of Mukai, Makino and Chang (MODSIM 2013): a circular pane inclined by 5 deg and by
30 deg, and a star-shaped pane of thickness 0.2 and 1.0 (in the teapot's classic units). Where an
outline of the pot enters a pane it breaks, and the gap grows with inclination and thickness.

    python demo_scenes/panes.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported
from teapot import PARTS, teapot

UNIT = 0.05
"""Metres in one of the teapot's classic units: the pot is 16 cm high. Thicknesses scale along."""

IOR = 1.5
POT_TURN = math.radians(-12.0)  # the spout points right and a little towards the camera
SHELF_HEIGHT, SHELF_BOARD = 4.95, 0.22
COLUMN = 3.5  # the pots stand this far left and right of the middle

STRIPES = 24  # round the pot's wall
PART_STRIPES = {"lid": 12, "handle": 4, "spout": 6}

CAMERA = (0.2, -19.0, 5.0)
TARGET = (0.2, 0.0, 3.9)
FOCAL_LENGTH = 0.046

# A pane's centre: the place in the pot's frame that it hides, then so far from there towards the
# camera. From here its border crosses both the spout and the handle, and no pane hides another.
HIDDEN = {"CIRCLE": (0.25, 0.0, 1.85), "STAR": (0.25, 0.0, 1.6)}
STAND_OFF = 4.2


class Pane(NamedTuple):
    """A pane and its place; lengths in classic units."""

    outline: str  # CIRCLE or STAR
    inclination: float  # radians, between its normal and the line from its centre to the camera
    thickness: float
    column: int  # -1 left, 1 right
    row: int  # 0 lower, 1 upper shelf
    radius: float


# The paper leaves the circles' thickness and the stars' inclination open.
PANES = {
    "Pane circle 5 deg": Pane("CIRCLE", math.radians(5.0), 1.0, -1, 1, 1.85),
    "Pane circle 30 deg": Pane("CIRCLE", math.radians(30.0), 1.0, 1, 1, 1.85),
    "Pane star 0.2": Pane("STAR", math.radians(35.0), 0.2, -1, 0, 2.35),
    "Pane star 1.0": Pane("STAR", math.radians(35.0), 1.0, 1, 0, 2.35),
}


def build(
    *, unlit: bool = False, with_glass: bool = True, subdivision: int = 16
) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the panes by the extension's operator; without them the direct view
    remains. ``subdivision``: edges along each side of the teapot's patches.
    """
    scene = common.empty_scene("panes")
    scene.frame_start = scene.frame_end = 1
    wall = common.quad("Wall", _units(-14, 2.6, -4), _units(28, 0, 0), _units(0, 0, 16))
    paper = common.tiles(
        0.5 * UNIT, 0.5 * UNIT, 0.035 * UNIT, ((0.60, 0.52, 0.34), (0.70, 0.62, 0.43)),
        (0.36, 0.27, 0.15),
    )  # fmt: skip
    wall.materials.append(common.material("Wall paper", paper, unlit=unlit))
    common.link(scene, "Wall", wall)

    grain = common.wood((0.42, 0.22, 0.11), (0.27, 0.13, 0.06), ring=0.25 * UNIT)
    timber = common.material("Shelf wood", grain, unlit=unlit)
    board = shelf_board()
    board.materials.append(timber)
    for row in (0, 1):
        shelf = common.link(scene, f"Shelf {row}", board)
        shelf.location.z = row * SHELF_HEIGHT * UNIT

    pot = teapot_mesh(subdivision)
    glaze = common.stripes(STRIPES, 0.36, (0.82, 0.80, 0.74), (0.05, 0.14, 0.42))
    pot.materials.append(common.material("Teapot glaze", glaze, unlit=unlit))
    for name, pane in PANES.items():
        obj = common.link(scene, name.replace("Pane", "Teapot"), pot)
        common.place(obj, pot_matrix(pane).translation, pot_matrix(pane).to_3x3())

    common.light_up(scene, unlit=unlit, sun_direction=(0.50, 0.75, -0.34), sun_strength=2.4)
    common.camera(scene, _units(*CAMERA), _units(*TARGET), FOCAL_LENGTH)
    if with_glass:
        add_panes(scene)
    common.settle(scene, scene.frame_start)
    return scene


def add_panes(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Make the panes, flat outlines with the extension's modifier, and return them."""
    common.register_extension()
    panes = pane_outlines(scene)
    for obj in panes:
        common.activate(obj)
        bpy.ops.object.refractive_glass_modifier_add(
            shape="SLAB", wall_thickness=PANES[obj.name].thickness * UNIT, ior=IOR
        )
    return panes


def pane_outlines(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Add the panes' upper faces, flat polygons that face the camera but for their inclination."""
    eye = Vector(_units(*CAMERA))
    result = []
    for name, pane in PANES.items():
        corners = (circle if pane.outline == "CIRCLE" else star)(pane.radius * UNIT)
        data = common.mesh(name, np.pad(corners, ((0, 0), (0, 1))), [range(len(corners))])
        obj = common.link(scene, name, data)
        hidden = pot_matrix(pane) @ Vector(_units(*HIDDEN[pane.outline]))
        to_camera = (eye - hidden).normalized()
        # Facing the camera with its Y axis upright, then leaning back: what is seen through it
        # moves up or down, which breaks spout and handle at the pane's left and right borders.
        facing = to_camera.to_track_quat("Z", "Y")
        rotation = facing.to_matrix() @ Matrix.Rotation(-pane.inclination, 3, "X")
        common.place(obj, hidden + STAND_OFF * UNIT * to_camera, rotation)
        result.append(obj)
    return result


def pot_matrix(pane: Pane) -> Matrix:
    """Return the world matrix of the pot behind ``pane``; the pot's mesh is in metres."""
    place = _units(pane.column * COLUMN, 0.0, pane.row * SHELF_HEIGHT)
    return Matrix.Translation(place) @ Matrix.Rotation(POT_TURN, 4, "Z")


def teapot_mesh(subdivision: int) -> bpy.types.Mesh:
    """Return the teapot as a mesh in metres, with smooth normals."""
    pot = teapot(subdivision)
    # Fewer stripes round the narrow parts, so that stripes are about equally wide everywhere.
    share = np.array([PART_STRIPES.get(name, STRIPES) / STRIPES for name in PARTS])
    uv = pot.uv.copy()
    uv[:, 0] *= np.repeat(share[pot.part], [len(face) for face in pot.faces])
    return common.mesh("Teapot", pot.positions * UNIT, pot.faces, uv=uv, smooth=True)


def shelf_board() -> bpy.types.Mesh:
    """Return a board whose upper side is z = 0, open at its ends and back, which nobody sees."""
    x, front, back, low = 14.0, -2.6, 2.6, -SHELF_BOARD
    rows = ((back, 0.0), (front, 0.0), (front, low), (back, low))
    positions = np.array([(s * x, y, z) for y, z in rows for s in (-1, 1)]) * UNIT
    faces = [(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(3)]
    # Grain along x: U is x, V the way round the edge, both in metres.
    way = np.array((0.0, back - front, back - front - low, 2 * (back - front) - low)) * UNIT
    uv = [(s * x * UNIT, way[j]) for k in range(3)
          for s, j in ((-1, k), (-1, k + 1), (1, k + 1), (1, k))]  # fmt: skip
    return common.mesh("Shelf", positions, faces, uv=np.array(uv))


def circle(radius: float, sides: int = 128) -> np.ndarray:
    """Return a circle as a counter-clockwise polygon (sides, 2)."""
    angle = np.arange(sides) * (2.0 * math.pi / sides)
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def star(radius: float, points: int = 5, waist: float = 0.58) -> np.ndarray:
    """Return a star as a counter-clockwise polygon (2 points, 2), one point up the y axis.

    ``waist``: inner radius over outer radius (0.38 would be a pentagram).
    """
    angle = math.pi / 2 + np.arange(2 * points) * (math.pi / points)
    reach = np.where(np.arange(2 * points) % 2, waist, 1.0) * radius
    return reach[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def _units(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Classic units to metres."""
    return (x * UNIT, y * UNIT, z * UNIT)


if __name__ == "__main__":
    sys.exit(common.run("panes", build))
