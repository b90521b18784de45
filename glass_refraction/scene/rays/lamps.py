# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as the surfaces and the discs of sky that give their light.

Radiances are those of Blender's engines, checked against Cycles: power P (watts) leaves a ball as
P / (4 π² r²), a flat area A as P / (π A); a sun of irradiance E as E / (π sin² of its half angle).
A lamp that is not *normalised* by its size has the radiance P / π or E, whatever its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .beams import beam_of
from .looks import Look

LEAST_SIZE = 1e-6
"""Metres: smaller lamps have no image."""
DISC_CORNERS = 48
"""Corners of a round area lamp: its area is then 0.3 % short."""
BALL_ROWS, BALL_COLUMNS = 12, 24
"""Of a point or spot lamp's ball."""


@dataclass(frozen=True)
class Sun:
    """A disc of the sky: unit direction (3,) towards it, cosine of its half angle, radiance, and
    `lamp_factors`."""

    towards: tuple[float, float, float]
    cosine: float
    radiance: tuple[float, float, float]
    factors: tuple[float, float] = (1.0, 1.0)


def lamp_power(light: bpy.types.Light, engine: str) -> np.ndarray:
    """Power, or a sun's irradiance, by colour; in Cycles times what a lamp's own nodes emit."""
    colour = np.array(light.color, float)
    if getattr(light, "use_temperature", False):
        colour = colour * np.array(light.temperature_color[:3], float)
    if engine == "CYCLES" and light.use_nodes and light.node_tree is not None:
        emission = next((n for n in light.node_tree.nodes if n.type == "EMISSION"), None)
        if emission is not None:
            strength = float(emission.inputs["Strength"].default_value)
            colour = colour * np.array(emission.inputs["Color"].default_value[:3]) * strength
    return colour * float(light.energy) * 2.0 ** float(getattr(light, "exposure", 0.0))


def lamp_factors(light: bpy.types.Light, engine: str) -> tuple[float, float]:
    """By what a lamp's light is multiplied that comes through a glass, and that one mirrors: in
    EEVEE its *Transmission* and *Specular*."""
    if engine == "BLENDER_EEVEE":
        return float(light.transmission_factor), float(light.specular_factor)
    return 1.0, 1.0


def lamp_is_normalised(light: bpy.types.Light) -> bool:
    """Whether a larger lamp of the same power is darker."""
    return bool(getattr(light, "normalize", True))


def _radiance(colour: np.ndarray) -> tuple[float, float, float]:
    return tuple(float(part) for part in colour)


def sun_of(light: bpy.types.Light, to_world: np.ndarray, engine: str) -> Sun | None:
    """A sun lamp that is seen as a disc; None for one of no size."""
    half = 0.5 * float(light.angle)
    if half <= 0.0:
        return None
    axis = to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])
    radiance = lamp_power(light, engine)
    if lamp_is_normalised(light):
        radiance = radiance / (np.pi * np.sin(min(half, 0.5 * np.pi)) ** 2)
    towards = tuple(float(part) for part in axis)
    return Sun(towards, float(np.cos(half)), _radiance(radiance), lamp_factors(light, engine))


def lamp_shape(light: bpy.types.Light, to_world: np.ndarray, engine: str):
    """Points (V, 3) in the world, triangles (T, 3) and look of a lamp; None for one of no size."""
    shape = {"AREA": _area, "POINT": _ball, "SPOT": _ball}.get(light.type)
    found = None if shape is None else shape(light, to_world)
    if found is None:
        return None
    points, corners, size, faces = found
    radiance = lamp_power(light, engine) / np.pi
    if lamp_is_normalised(light):
        radiance = radiance / size
    beam = beam_of(light, to_world, engine)
    factors = lamp_factors(light, engine)
    look = Look((0.0, 0.0, 0.0), _radiance(radiance), True, False, faces, beam, factors=factors)
    return points, corners, look


def _area(light: bpy.types.AreaLight, to_world: np.ndarray):
    """Points, triangles, area (m²) and `Look.faces`."""
    wide = float(light.size)
    high = float(light.size_y) if light.shape in {"RECTANGLE", "ELLIPSE"} else wide
    x, y = to_world[:3, 0] * wide, to_world[:3, 1] * high
    if min(np.linalg.norm(x), np.linalg.norm(y)) < LEAST_SIZE:
        return None
    if light.shape in {"DISK", "ELLIPSE"}:
        angle = np.linspace(0.0, 2.0 * np.pi, DISC_CORNERS, endpoint=False)
        flat = 0.5 * np.stack((np.cos(angle), np.sin(angle)), axis=1)
        area = 0.25 * np.pi * np.linalg.norm(np.cross(x, y))
    else:
        flat = 0.5 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        area = np.linalg.norm(np.cross(x, y))
    points = to_world[:3, 3] + flat[:, :1] * x + flat[:, 1:] * y
    fan = np.arange(1, len(flat) - 1)
    # Its light leaves along −z: the corners run clockwise as seen from there.
    corners = np.stack((np.zeros_like(fan), fan + 1, fan), axis=1)
    return points, corners.astype(np.int32), area, 1


def _ball(light: bpy.types.PointLight | bpy.types.SpotLight, to_world: np.ndarray):
    """Points, triangles, area (m²) and `Look.faces`."""
    radius = float(light.shadow_soft_size)
    if radius < LEAST_SIZE:
        return None
    across = np.linspace(0.0, np.pi, BALL_ROWS + 1)
    around = np.linspace(0.0, 2.0 * np.pi, BALL_COLUMNS, endpoint=False)
    polar, azimuth = np.meshgrid(across, around, indexing="ij")
    unit = np.stack(
        (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=-1
    )
    numbers = np.arange(unit[..., 0].size).reshape(unit.shape[:2])
    a, b = numbers[:-1], numbers[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    corners = np.concatenate(
        [
            np.stack((one, two, three), axis=-1).reshape(-1, 3)
            for one, two, three in ((a, b, c), (a, c, d))
        ]
    )
    points = unit.reshape(-1, 3) * radius + to_world[:3, 3]
    # Of its outside: what light has passed its front does not meet it again.
    return points, corners.astype(np.int32), 4.0 * np.pi * radius**2, 1
