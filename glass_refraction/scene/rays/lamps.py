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
SQUARE, DISC, BALL = range(3)
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
    body = lamp_body(light, to_world, engine)
    if body is None:
        return None
    points, corners = _ball() if body.kind == BALL else _flat(body.kind == DISC)
    return points @ body.to_world[:3, :3].T + body.to_world[:3, 3], corners, body.look


@dataclass(frozen=True)
class LampBody:
    """A lamp of a size: a square from −1 to 1, a disc or a ball of radius 1, led into the world.

    Flat ones lie in z = 0; light leaves along −z, and balls' beams go there.

    Attributes
    ----------
    kind : `SQUARE`, `DISC` or `BALL`. to_world : (4, 4). look : what it shows.
    """

    kind: int
    to_world: np.ndarray
    look: Look


def lamp_body(light: bpy.types.Light, to_world: np.ndarray, engine: str) -> LampBody | None:
    """The body of a lamp with a pose (4, 4); None for one of no size."""
    pose = np.array(to_world, float)
    if light.type == "AREA":
        wide = float(light.size)
        high = float(light.size_y) if light.shape in {"RECTANGLE", "ELLIPSE"} else wide
        pose[:3, :2] *= 0.5 * wide, 0.5 * high
        kind = DISC if light.shape in {"DISK", "ELLIPSE"} else SQUARE
        least = 2.0 * np.linalg.norm(pose[:3, :2], axis=0).min()
        area = (np.pi if kind == DISC else 4.0) * np.linalg.norm(np.cross(*pose[:3, :2].T))
    elif light.type in {"POINT", "SPOT"}:
        least = radius = float(light.shadow_soft_size)
        pose[:3, :3] *= radius / np.maximum(np.linalg.norm(pose[:3, :3], axis=0), LEAST_SIZE)
        kind, area = BALL, 4.0 * np.pi * radius**2
    else:
        return None
    if least < LEAST_SIZE:
        return None
    radiance = lamp_power(light, engine) / np.pi
    if lamp_is_normalised(light):
        radiance = radiance / area
    # Of its front: what light has passed that does not meet it again.
    look = Look(
        (0.0, 0.0, 0.0),
        _radiance(radiance),
        is_lamp=True,
        faces=1,
        beam=beam_of(light, to_world, engine),
        factors=lamp_factors(light, engine),
    )
    return LampBody(kind, pose, look)


def _flat(is_disc: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a unit disc or square."""
    if is_disc:
        angle = np.linspace(0.0, 2.0 * np.pi, DISC_CORNERS, endpoint=False)
        points = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    else:
        points = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
    fan = np.arange(1, len(points) - 1)
    # Light leaves along −z: the corners run clockwise as seen from there.
    return points, np.stack((np.zeros_like(fan), fan + 1, fan), axis=1).astype(np.int32)


def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a unit ball."""
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
    return unit.reshape(-1, 3), corners.astype(np.int32)
