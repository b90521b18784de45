# SPDX-License-Identifier: GPL-3.0-or-later
"""Everyday glasses: what ``object.refractive_glass_everyday_add`` puts together."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..optics import MEDIA

UPRIGHT = (math.pi / 2, 0.0, 0.0)
"""A slab lies in the plane z = 0; stood up, its face looks along the scene's -y."""
GLASS, WATER = MEDIA["Glass"], MEDIA["Water"]
LENGTHS = ("radius", "wall_thickness", "height", "bottom_thickness", "liquid_level")
"""The values that grow with a glass."""


@dataclass(frozen=True)
class Part:
    """One object of an everyday glass.

    Attributes
    ----------
    values : the properties of ``object.refractive_glass_add``; lengths in metres.
    location, rotation : in the whole; metres, radians (XYZ).
    vertices, faces : of a part that is a mesh; ``values`` holds its ior only.
    smooth : whether its faces of four corners are shaded smooth.
    priority : which part is there where they overlap, the higher.
    name : what the object's name says beside the glass's.
    """

    values: dict
    location: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    vertices: np.ndarray | None = None
    faces: list[tuple[int, ...]] = field(default_factory=list)
    smooth: bool = False
    priority: int = 0
    name: str = ""


@dataclass(frozen=True)
class Preset:
    """A glass as people know it.

    Attributes
    ----------
    label, description : as the menu shows them.
    icon : Blender's name of it.
    size : its largest extent, metres.
    parts : its objects; the first one carries the others.
    """

    label: str
    description: str
    icon: str
    size: float
    parts: tuple[Part, ...]

    @property
    def identifier(self) -> str:
        """Its name for scripts."""
        return self.label.upper().replace(" ", "_")


def _tumbler(level: float) -> Part:
    return Part(
        {
            "shape": "TUMBLER",
            "radius": 0.038,
            "wall_thickness": 0.002,
            "height": 0.1,
            "bottom_thickness": 0.006,
            "liquid_level": level,
            "ior": GLASS,
            "contents_ior": WATER,
        }
    )


def _turned(form: str, height: float, level: float = 0.0, **place) -> Part:
    values = {"shape": "REVOLUTION", "form": form, "height": height, "liquid_level": level}
    return Part({**values, "ior": GLASS, "contents_ior": WATER}, **place)


def _pane(thickness: float, behind: float, depth: float = 0.0, name: str = "") -> Part:
    values = {"shape": "SLAB", "radius": 0.5, "wall_thickness": thickness}
    return Part(
        {**values, "ior": GLASS, "contents_ior": behind},
        location=(0.0, depth, 0.5),
        rotation=UPRIGHT,
        name=name,
    )


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def _box(width: float, depth: float, low: float, high: float) -> np.ndarray:
    """Corners (8, 3) of an upright box, the lower four first."""
    half = 0.5 * np.array((width, depth))
    ring = half * _CORNERS
    return np.array([(x, y, z) for z in (low, high) for x, y in ring])


def _sides(first: int, *, inwards: bool = False) -> list[tuple[int, ...]]:
    """The side faces of a box whose corners begin with a number."""
    rings = [(first + k, first + (k + 1) % 4) for k in range(4)]
    faces = [(a, b, b + 4, a + 4) for a, b in rings]
    return [face[::-1] for face in faces] if inwards else faces


TANK, TANK_WALL, TANK_LEVEL = (0.6, 0.3, 0.36), 0.008, 0.30
"""An aquarium, metres: width, depth and height outside; its walls; where the water ends."""
OVERLAP = 0.001
"""Metres by which water reaches into the walls: so glass and water touch."""
ABOVE_TABLE = (0.0, 0.0, 0.0005)
"""Where a tank stands, metres: rounding would decide between its floor and a table in one plane."""


def _tank() -> tuple[Part, Part]:
    """A tank that is open above, and the water in it."""
    width, depth, height = TANK
    wall = TANK_WALL
    outside = _box(width, depth, 0.0, height)
    inside = _box(width - 2 * wall, depth - 2 * wall, wall, height)
    rim = [(4 + k, 4 + (k + 1) % 4, 12 + (k + 1) % 4, 12 + k) for k in range(4)]
    faces = [(3, 2, 1, 0), *_sides(0), *rim, *_sides(8, inwards=True), (8, 9, 10, 11)]
    into = wall - OVERLAP
    water = _box(width - 2 * into, depth - 2 * into, into, TANK_LEVEL)
    box = [(3, 2, 1, 0), *_sides(0), (4, 5, 6, 7)]
    return (
        Part(
            {"ior": GLASS},
            ABOVE_TABLE,
            vertices=np.concatenate((outside, inside)),
            faces=faces,
            priority=1,
        ),
        Part({"ior": WATER}, ABOVE_TABLE, vertices=water, faces=box, name="Water"),
    )


MUG, MUG_WALL, HANDLE, TUBE = (0.042, 0.095), 0.004, 0.030, 0.006
"""A mug, metres: radius and height; its wall; radii of the handle's arc and of its tube."""
ARC_STEPS, TUBE_STEPS = 24, 16


def _handle() -> Part:
    """Half a ring whose ends stand within the mug's wall."""
    radius, height = MUG
    start = radius - 0.5 * MUG_WALL
    arc = np.linspace(-0.5 * math.pi, 0.5 * math.pi, ARC_STEPS + 1)
    round_ = np.linspace(0.0, 2.0 * math.pi, TUBE_STEPS, endpoint=False)
    reach = HANDLE + TUBE * np.cos(round_)
    x = start + np.cos(arc)[:, None] * reach
    z = 0.5 * height + np.sin(arc)[:, None] * reach
    y = np.broadcast_to(TUBE * np.sin(round_), x.shape)
    faces = []
    for ring in range(ARC_STEPS):
        for k in range(TUBE_STEPS):
            here, there = ring * TUBE_STEPS, (ring + 1) * TUBE_STEPS
            following = (k + 1) % TUBE_STEPS
            faces.append((here + following, there + following, there + k, here + k))
    first, last = range(TUBE_STEPS), range(ARC_STEPS * TUBE_STEPS, (ARC_STEPS + 1) * TUBE_STEPS)
    vertices = np.stack((x, y, z), axis=-1).reshape(-1, 3)
    faces += [tuple(first)[::-1], tuple(last)]
    return Part({"ior": GLASS}, vertices=vertices, faces=faces, smooth=True, name="Handle")


def _mug() -> Part:
    radius, height = MUG
    values = {"radius": radius, "wall_thickness": MUG_WALL, "height": height}
    values |= {"bottom_thickness": 0.007, "liquid_level": 0.065}
    return Part({"shape": "TUMBLER", **values, "ior": GLASS, "contents_ior": WATER})


PRESETS = (
    Preset("Tumbler", "An empty drinking glass", "MESH_CYLINDER", 0.1, (_tumbler(0.0),)),
    Preset(
        "Glass of Water",
        "A drinking glass, two thirds full of water",
        "MESH_CYLINDER",
        0.1,
        (_tumbler(0.065),),
    ),
    Preset(
        "Wine Glass",
        "A wine glass with a foot and a stem, filled a little",
        "CURVE_DATA",
        0.185,
        (_turned("WINE", 0.185, 0.04),),
    ),
    Preset(
        "Mug", "A glass mug with a handle, full of water", "MESH_TORUS", 0.118, (_mug(), _handle())
    ),
    Preset(
        "Bottle",
        "A bottle with a neck, more than half full",
        "CURVE_DATA",
        0.3,
        (_turned("BOTTLE", 0.3, 0.17),),
    ),
    Preset(
        "Vase", "A vase, half full of water", "CURVE_DATA", 0.25, (_turned("VASE", 0.25, 0.12),)
    ),
    Preset(
        "Fish Bowl",
        "A round bowl of 30 cm with an opening, filled up to a level",
        "MESH_UVSPHERE",
        0.3,
        (_turned("BOWL", 0.24, 0.17),),
    ),
    Preset(
        "Aquarium",
        "A tank of 60 cm, open above, with water in it: two meshes",
        "MESH_CUBE",
        0.6,
        _tank(),
    ),
    Preset(
        "Window Pane",
        "An upright pane, 1 m wide and 4 mm thick",
        "MESH_PLANE",
        1.0,
        (_pane(0.004, 1.0),),
    ),
    Preset(
        "Double Glazing",
        "Two upright panes of 4 mm, 16 mm apart",
        "MESH_PLANE",
        1.0,
        (_pane(0.004, 1.0), _pane(0.004, 1.0, 0.02, "Back")),
    ),
    Preset(
        "Aquarium Wall",
        "An upright pane, 1 m wide and 10 mm thick: all that is seen through it is under water",
        "MESH_PLANE",
        1.0,
        (_pane(0.01, WATER),),
    ),
    Preset(
        "Lens",
        "An upright lens of 8 cm that magnifies",
        "CURVE_DATA",
        0.08,
        (_turned("LENS", 0.02343, location=(0.0, 0.0, 0.04), rotation=UPRIGHT),),
    ),
    Preset(
        "Crystal Ball",
        "A solid ball of 10 cm",
        "MESH_UVSPHERE",
        0.1,
        (
            Part(
                {"shape": "SPHERE", "radius": 0.05, "wall_thickness": 0.0, "ior": GLASS},
                location=(0.0, 0.0, 0.05),
            ),
        ),
    ),
    Preset(
        "Glass Rod",
        "A solid rod, 10 mm thick and 25 cm long",
        "MESH_CYLINDER",
        0.25,
        (Part({"shape": "ROD", "radius": 0.005, "height": 0.25, "ior": GLASS}),),
    ),
)
