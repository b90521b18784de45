# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `tumbler`: a glass of water in a still life, with things before, behind and in it.

A lemon and a spoon's ball lie in front and at the side, a jug-like vase stands behind, and a slice
of lemon and a straw are in the water, the straw across its surface.

    python demo_scenes/tumbler.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Vector

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# The glass, standing at the table's origin. Metres.
RADIUS, WALL, HEIGHT, BOTTOM, LEVEL = 0.034, 0.002, 0.095, 0.009, 0.060
IOR, WATER = 1.5, 1.333
FILM = 0.0005
"""Air between the table and the glass: they must not lie in one plane."""

EYE, TARGET = (0.045, -0.40, 0.155), (0.0, 0.0, 0.046)
WALL_DISTANCE, TABLE_EDGE = 0.26, -0.25

STRAW = ((-0.019, 0.006, 0.012), (0.027, -0.004, 0.128), 0.0028)
"""Lower end, a point further up, radius."""
SLICE = ((0.006, 0.004, 0.034), 0.021, 0.005)
"""Centre, radius, thickness."""
LEMON = ((-0.058, -0.052), 0.021)
"""Place on the table, in front of the glass's edge; radius of its middle."""
MARBLE = ((0.016, -0.078), 0.010)
VASE = (0.035, 0.120)
ORANGE = ((-0.085, 0.085), 0.034)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the glass of water by the extension's operator.
    """
    scene = common.empty_scene("tumbler")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    tiles = common.tiles(
        0.04, 0.04, 0.0025, ((0.58, 0.52, 0.44), (0.70, 0.64, 0.54)), (0.30, 0.27, 0.24)
    )
    common.table_before_wall(scene, TABLE_EDGE, WALL_DISTANCE, -FILM, tiles, unlit=unlit)

    def add(name: str, profile, colours, count: int = 9) -> bpy.types.Object:
        return common.link(scene, name, turned(name, profile, colours, count, unlit=unlit))

    (x, y), radius = LEMON
    lemon = add("Lemon", lemon_profile(radius), ((0.92, 0.74, 0.08), (0.86, 0.66, 0.05)))
    common.place(lemon, (x, y, radius - FILM), Euler((np.pi / 2, 0.0, 0.9)).to_quaternion())
    (x, y), radius = MARBLE
    marble = add("Marble", ball_profile(radius), ((0.10, 0.25, 0.62), (0.85, 0.88, 0.90)), 5)
    common.place(marble, (x, y, radius - FILM), Euler((0.9, 0.4, 0.0)).to_quaternion())
    vase = add("Vase", vase_profile(), ((0.16, 0.30, 0.34), (0.55, 0.66, 0.62)), 12)
    vase.location = (*VASE, -FILM)
    (x, y), radius = ORANGE
    orange = add("Orange", ball_profile(radius), ((0.90, 0.38, 0.03), (0.84, 0.32, 0.02)), 10)
    orange.location = (x, y, radius - FILM)
    low, high, radius = STRAW
    along = Vector(high) - Vector(low)
    straw = add(
        "Straw", rod_profile(radius, along.length), ((0.88, 0.16, 0.14), (0.93, 0.92, 0.88))
    )
    common.place(straw, low, along.to_track_quat("Z", "Y"))
    centre, radius, thick = SLICE
    rind = ((0.95, 0.86, 0.30), (0.98, 0.93, 0.62))
    piece = add("Slice", slice_profile(radius, thick), rind, 16)
    common.place(piece, centre, Euler((1.15, 0.25, 0.3)).to_quaternion())

    common.light_up(scene, unlit=unlit, sun_direction=(0.55, 0.6, -0.8))
    common.camera(scene, EYE, TARGET, 0.070)
    if with_glass:
        common.glass_of_water(RADIUS, WALL, HEIGHT, BOTTOM, LEVEL, IOR, WATER)
    common.settle_cup(scene, 1, unlit=unlit)
    return scene


def turned(
    name: str,
    profile: np.ndarray,
    colours: tuple[common.Colour, common.Colour],
    count: int,
    *,
    unlit: bool,
) -> bpy.types.Mesh:
    """Return a profile (K, 2) of radius and height turned about z, with ``count`` stripes.

    Stripes run up a thing's side, so that one sees how it is bent; two colours alternate.
    """
    around = 64
    turn = 2 * np.pi * np.arange(around + 1) / around
    radius, height = profile.T
    positions = np.stack(
        (
            radius[:, None] * np.cos(turn),
            radius[:, None] * np.sin(turn),
            np.broadcast_to(height[:, None], (len(profile), around + 1)),
        ),
        axis=-1,
    )
    faces = common.grid_faces(len(profile), around + 1, flip=False)
    way = np.concatenate(([0.0], np.hypot(*np.diff(profile, axis=0).T).cumsum()))
    u, v = np.broadcast_arrays(turn / (2 * np.pi), (way / way[-1])[:, None])
    uv = np.stack((u, v), axis=-1).reshape(-1, 2)[faces.ravel()]
    material = common.material(name, common.stripes(count, 0.5, *colours), unlit=unlit)
    return common.mesh(
        name, positions.reshape(-1, 3), faces, uv=uv, materials=(material,), smooth=True
    )


def ball_profile(radius: float) -> np.ndarray:
    """A sphere round the origin, from its lowest point up."""
    angle = np.linspace(-0.5, 0.5, 33) * np.pi
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))


def lemon_profile(radius: float) -> np.ndarray:
    """An egg with a knob at either end, its axis along z."""
    share = np.linspace(-1.0, 1.0, 41)
    body = np.sqrt(np.maximum(1.0 - share**2, 0.0))
    knob = 0.16 * np.sqrt(np.maximum(1.0 - share**8, 0.0))
    return radius * np.column_stack((np.maximum(body**1.2, knob), 1.35 * share))


def vase_profile() -> np.ndarray:
    """A vase that stands on its origin: belly, neck and lip."""
    height = np.linspace(0.0, 0.15, 49)
    marks = (0.0, 0.01, 0.045, 0.10, 0.135, 0.15)
    radius = np.interp(height, marks, (0.020, 0.026, 0.036, 0.016, 0.015, 0.021))
    smooth = np.convolve(np.pad(radius, 4, mode="edge"), np.full(9, 1 / 9), mode="valid")
    side = np.column_stack((smooth, height))
    return np.concatenate(([(0.0, 0.0)], side, [(0.0, 0.15)]))


def rod_profile(radius: float, length: float) -> np.ndarray:
    """A closed rod from the origin up; its rings are near each other."""
    height = np.linspace(0.0, length, 1 + round(length / 0.002))
    side = np.column_stack((np.full(len(height), radius), height))
    return np.concatenate(([(0.0, 0.0)], side, [(0.0, length)]))


def slice_profile(radius: float, thickness: float) -> np.ndarray:
    """A disc across z, its edge a little rounded."""
    half = thickness / 2
    reach = np.linspace(0.0, radius - half / 2, 17)
    lower, upper = (np.column_stack((reach, np.full(17, z))) for z in (-half, half))
    bow = np.linspace(-0.5, 0.5, 9)[1:-1] * np.pi
    edge = np.column_stack((radius - half / 2 + half / 2 * np.cos(bow), half * np.sin(bow)))
    return np.concatenate((lower, edge, upper[::-1]))


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("tumbler", build))
