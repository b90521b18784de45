# SPDX-License-Identifier: GPL-3.0-or-later
"""Everyday glasses: the public operator with other values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..optics import MEDIA

UPRIGHT = (math.pi / 2, 0.0, 0.0)
"""A slab lies in the plane z = 0; stood up, its face looks along the scene's -y."""


@dataclass(frozen=True)
class Preset:
    """A glass as people know it.

    Attributes
    ----------
    label, description : as the menu shows them.
    icon : Blender's name of it.
    values : the properties of ``object.refractive_glass_add``; lengths in metres.
    """

    label: str
    description: str
    icon: str
    values: dict


PRESETS = (
    Preset(
        "Window Pane",
        "An upright pane, 1 m wide and 4 mm thick",
        "MESH_PLANE",
        {
            "shape": "SLAB",
            "radius": 0.5,
            "wall_thickness": 0.004,
            "ior": MEDIA["Glass"],
            "contents_ior": 1.0,
            "rotation": UPRIGHT,
        },
    ),
    Preset(
        "Tumbler",
        "An empty drinking glass",
        "MESH_CYLINDER",
        {
            "shape": "TUMBLER",
            "radius": 0.038,
            "wall_thickness": 0.002,
            "height": 0.1,
            "bottom_thickness": 0.006,
            "liquid_level": 0.0,
            "ior": MEDIA["Glass"],
            "contents_ior": MEDIA["Water"],
        },
    ),
    Preset(
        "Glass of Water",
        "A drinking glass, two thirds full of water",
        "MESH_CYLINDER",
        {
            "shape": "TUMBLER",
            "radius": 0.038,
            "wall_thickness": 0.002,
            "height": 0.1,
            "bottom_thickness": 0.006,
            "liquid_level": 0.065,
            "ior": MEDIA["Glass"],
            "contents_ior": MEDIA["Water"],
        },
    ),
    Preset(
        "Glass Rod",
        "A solid rod, 10 mm thick and 25 cm long",
        "MESH_CYLINDER",
        {"shape": "ROD", "radius": 0.005, "height": 0.25, "ior": MEDIA["Glass"]},
    ),
    Preset(
        "Crystal Ball",
        "A solid ball of 10 cm",
        "MESH_UVSPHERE",
        {"shape": "SPHERE", "radius": 0.05, "wall_thickness": 0.0, "ior": MEDIA["Glass"]},
    ),
    Preset(
        "Fish Bowl",
        "A round bowl of 30 cm, full of water",
        "MESH_UVSPHERE",
        {
            "shape": "SPHERE",
            "radius": 0.15,
            "wall_thickness": 0.003,
            "ior": MEDIA["Glass"],
            "contents_ior": MEDIA["Water"],
        },
    ),
    Preset(
        "Aquarium Wall",
        "An upright pane, 1 m wide and 10 mm thick: all that is seen through it is under water",
        "MESH_PLANE",
        {
            "shape": "SLAB",
            "radius": 0.5,
            "wall_thickness": 0.01,
            "ior": MEDIA["Glass"],
            "contents_ior": MEDIA["Water"],
            "rotation": UPRIGHT,
        },
    ),
)
