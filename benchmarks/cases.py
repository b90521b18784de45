# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses, eyes and clouds of points that several parts of the benchmark share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glass_refraction import optics
from glass_refraction.optics.glasses import Glass

SLAB = optics.FlatGlass((0.01,), (1.5,))
HOLLOW = optics.CylinderGlass((0.040, 0.037), (1.5, 1.0))
FILLED = optics.CylinderGlass((0.040, 0.037), (1.5, 1.333))
ROD = optics.CylinderGlass((0.02,), (1.5,))
BUBBLE = optics.SphereGlass((0.040, 0.037), (1.5, 1.0))
BALL = optics.SphereGlass((0.040,), (1.5,))
WATER = optics.FlatGlass((), (), ior_below=1.333)
TUMBLER = optics.Tumbler(0.040, 0.003, 0.12, 0.008, level=0.07)
BOWL = optics.RevolutionGlass(
    ((0.0, 0.0), (0.030, 0.008), (0.040, 0.035), (0.034, 0.075)),
    ((0.0, 0.006), (0.027, 0.013), (0.037, 0.036), (0.032, 0.075)),
    level=0.045,
)
TANK = optics.FlatGlass((0.01,), (1.5,), ior_below=1.333)

PIXEL_TOLERANCE = 2e-5
"""Tolerance of the direction in radians: 0.05 px at 2400 px a radian."""
FINE_TOLERANCE = 1e-3 / 2400.0


@dataclass(frozen=True)
class Case:
    """A glass, a light path through it, and where eye and points are, metres.

    `searched`: a point may have several images, which takes a search along curves in place of a
    few steps; neither the tolerance nor the last frame's result changes its time much. `slow`:
    the first call for a viewpoint takes seconds, which only a full run spends.
    """

    name: str
    glass: Glass
    path: str | optics.LightPath
    eye: tuple[float, float, float]
    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    searched: bool = False
    slow: bool = False

    def points(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Points (count, 3), evenly spread over a box."""
        return random.uniform(-1.0, 1.0, (count, 3)) * self.half + self.centre


_SIDE, _TOP = (0.5, 0.02, 0.1), (0.0, 0.0, 0.3)
_BEHIND, _BOX = (-0.09, 0.0, 0.02), (0.02, 0.03, 0.05)
_BELOW, _FIELD = (0.0, 0.0, -0.5), (0.3, 0.3, 0.3)

_LOW = (0.02, 0.03, 0.02)
_THROUGH_WATER = optics.LightPath("TTTT", ("outer", "wet", "wet", "outer"))
_UNDER_SURFACE = optics.LightPath("TTRTT", ("outer", "wet", "surface", "wet", "outer"))

BEHIND_SLAB = Case("slab, TT", SLAB, "TT", _TOP, _BELOW, _FIELD)
BEHIND_HOLLOW = Case("hollow cylinder, TTTT", HOLLOW, "TTTT", _SIDE, _BEHIND, _BOX)

CASES = (
    BEHIND_SLAB,
    Case("slab, TRRT", SLAB, "TRRT", _TOP, _BELOW, _FIELD),
    Case("water surface, T", WATER, "T", _TOP, _BELOW, _FIELD),
    Case("tank wall before water, TT", TANK, "TT", _TOP, _BELOW, _FIELD),
    BEHIND_HOLLOW,
    Case("hollow cylinder, TRT", HOLLOW, "TRT", _SIDE, (-0.25, 0.17, 0.0), (0.1, 0.06, 0.05), True),
    Case("hollow cylinder, R", HOLLOW, "R", _SIDE, (0.2, 0.1, 0.05), _BOX, True),
    Case("hollow cylinder, TTRTT", HOLLOW, "TTRTT", _SIDE, (0.2, 0.1, 0.05), _BOX, True),
    Case("filled cylinder, TTTT", FILLED, "TTTT", _SIDE, _BEHIND, _BOX, True),
    Case("rod, TT", ROD, "TT", _SIDE, _BEHIND, _BOX, True),
    Case("hollow sphere, TTTT", BUBBLE, "TTTT", (0.5, 0.02, 0.03), (-0.09, 0.0, 0.0), _BOX),
    Case("ball, TT", BALL, "TT", (0.5, 0.02, 0.03), (-0.09, 0.0, 0.0), _BOX, True),
    Case("tumbler of water, TTTT", TUMBLER, _THROUGH_WATER, _SIDE, _BEHIND, _LOW, True),
    Case(
        "tumbler of water, mirror under the surface",
        TUMBLER,
        _UNDER_SURFACE,
        (0.4, 0.02, 0.0),
        (-0.09, 0.0, 0.055),
        _LOW,
        True,
    ),
    Case("bowl of water, TTTT", BOWL, _THROUGH_WATER, _SIDE, _BEHIND, _LOW, True, slow=True),
)


def eraser(random: np.random.Generator, count: int, across: float) -> np.ndarray:
    """Points (count, 3) of a block of 18 x 86 x 40 mm behind :data:`HOLLOW`, `across` metres
    beside its axis: the object of the paper's figure 1."""
    return random.uniform(-0.5, 0.5, (count, 3)) * (0.018, 0.086, 0.040) + (-0.09, across, 0.02)
