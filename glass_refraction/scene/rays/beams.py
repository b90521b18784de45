# SPDX-License-Identifier: GPL-3.0-or-later
"""How a lamp's light falls off beside its axis, as the engines have it."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...optics.vectors import dot

SHARPEST = 1e-4
"""Least width of a spot's border, by cosines."""
NARROWEST = 1e-3
"""Radians: least half angle of a spread beam."""


@dataclass(frozen=True)
class SpotBeam:
    """A cone with a soft border.

    Attributes
    ----------
    axis : unit direction (3,) that the light goes along.
    cosine, border : of the half angle, and the width of the border by cosines.
    """

    axis: tuple[float, float, float]
    cosine: float
    border: float

    def part(self, directions: np.ndarray) -> np.ndarray:
        """(N,) part of the light that goes in unit directions (N, 3)."""
        share = np.clip((dot(directions.T, self.axis) - self.cosine) / self.border, 0.0, 1.0)
        return share * share * (3.0 - 2.0 * share)


@dataclass(frozen=True)
class SpreadBeam:
    """What a grid before a flat lamp lets through, in Cycles; the lamp's power stays the same.

    Attributes
    ----------
    axis : unit direction (3,) that the light goes along.
    half : half angle, radians, below π / 2.
    """

    axis: tuple[float, float, float]
    half: float

    def part(self, directions: np.ndarray) -> np.ndarray:
        """(N,) by what radiance in unit directions (N, 3) is more than that of a bare lamp."""
        ahead = dot(directions.T, self.axis)
        aside = np.sqrt(np.maximum(1.0 - ahead * ahead, 0.0))
        tangent = np.tan(self.half)
        slope = aside / np.maximum(ahead, np.finfo(float).tiny)
        return np.maximum(tangent - slope, 0.0) / (tangent - self.half)


Beam = SpotBeam | SpreadBeam


def beam_of(light: bpy.types.Light, to_world: np.ndarray, engine: str) -> Beam | None:
    """The beam of a lamp with a pose (4, 4); None where light goes to all sides alike."""
    axis = -to_world[:3, 2] / max(float(np.linalg.norm(to_world[:3, 2])), np.finfo(float).tiny)
    axis = tuple(float(part) for part in axis)
    if light.type == "SPOT":
        cosine = float(np.cos(0.5 * light.spot_size))
        return SpotBeam(axis, cosine, max((1.0 - cosine) * float(light.spot_blend), SHARPEST))
    if light.type == "AREA" and engine == "CYCLES" and light.spread < np.float32(np.pi):
        return SpreadBeam(axis, max(0.5 * float(light.spread), NARROWEST))
    return None
