# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain Newton steps, the yardstick of every time in the benchmark: whole arrays, nothing clever.

A fixed number of steps for all points alike, no safeguard but the domain's edge, no block, no
thread, no early end. It gives positions only: neither a residual nor whether the ray exists.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from glass_refraction import optics

Floats = np.ndarray
STEPS = 4
EDGE = 1.0 - 1e-6
"""Part of the domain's limit at which a step ends that would leave it."""


def slab_places(
    glass: optics.FlatGlass,
    eye: ArrayLike,
    points: Floats,
    steps: int = STEPS,
    dtype: DTypeLike = float,
) -> Floats:
    """Apparent positions (N, 3) of points (N, 3) below one slab in air, seen from above.

    One unknown: the tangent of the angle of incidence, from the unrefracted ray on.
    """
    eye_x, eye_y, eye_z = (float(part) for part in eye)
    points = points.astype(dtype, copy=False)
    square = (glass.ior[0] / glass.ior_above) ** 2
    thickness = glass.thickness[0]
    x, y = points[:, 0] - eye_x, points[:, 1] - eye_y
    lateral = np.hypot(x, y)
    air = (eye_z - thickness) - points[:, 2]
    tangent = lateral / (air + thickness)
    for _ in range(steps):
        inverse = 1.0 / np.sqrt(square + (square - 1.0) * tangent * tangent)
        error = (air + thickness * inverse) * tangent - lateral
        tangent = tangent - error / (air + thickness * square * inverse**3)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    inner = np.sqrt(1.0 - (1.0 - cosine * cosine) / square)
    length = air / cosine + thickness / inner
    part = length * tangent * cosine / np.maximum(lateral, 1e-30)
    return np.stack((eye_x + part * x, eye_y + part * y, eye_z - length * cosine), axis=1)


def cylinder_places(
    glass: optics.CylinderGlass,
    eye: ArrayLike,
    points: Floats,
    steps: int = STEPS,
    dtype: DTypeLike = float,
) -> Floats:
    """Apparent positions (N, 3) of points (N, 3) behind a cylinder of two interfaces, by "TTTT".

    Two unknowns, the ray invariants: angular momentum round the axis (ell) and momentum along it
    (zeta). The residual is the point's offset from the last stretch's line, across and along the
    axis, which is linear in the point. Rotations are products of unit complex numbers.
    """
    eye_x, eye_y, eye_z = (float(part) for part in eye)
    away = math.hypot(eye_x, eye_y)
    turn = complex(eye_x, eye_y) / away
    air = glass.ior_outside
    outer, inner = glass.radius
    wall, core = glass.ior
    passages = (
        (air, away, -1),
        (air, outer, 2),
        (wall, outer, -2),
        (wall, inner, 2),
        (core, inner, -2),
    )
    points = points.astype(dtype, copy=False)
    flat = (points[:, 0] + 1j * points[:, 1]) * turn.conjugate()
    height = points[:, 2] - eye_z

    across = flat - away
    size = np.sqrt(across.real**2 + across.imag**2 + height * height)
    ell, zeta = _inside(passages, air * away * across.imag / size, air * height / size)
    for _ in range(steps):
        ell, zeta = _inside(passages, *_step(passages, air, flat, height, ell, zeta))

    momentum2 = air * air - zeta * zeta
    azimuth, length = -1.0, 0.0
    for ior, radius, count in passages:
        p2 = ior * ior - zeta * zeta
        w = np.sqrt(p2 * (radius * radius) - ell * ell)
        phase = (w + 1j * ell) / np.sqrt(p2 * (radius * radius))
        azimuth = azimuth * (phase.conjugate() if count < 0 else phase) ** abs(count)
        length = length - count * ior * w / p2
    along = azimuth.real * flat.real + azimuth.imag * flat.imag
    length = length + air * along / np.sqrt(momentum2)
    radial = np.sqrt(momentum2 * (away * away) - ell * ell)
    aim = (1j * ell - radial) * (turn / (air * away))
    return np.stack(
        (
            eye_x + length * aim.real,
            eye_y + length * aim.imag,
            eye_z + length * zeta / air,
        ),
        axis=1,
    )


def _inside(passages, ell, zeta):
    """The unknowns moved into the domain, where every radial momentum is real."""
    most = min(ior for ior, _, _ in passages) * EDGE
    zeta = np.clip(zeta, -most, most)
    limit2 = passages[0][0] ** 2 * passages[0][1] ** 2 + 0.0 * zeta
    for ior, radius, _ in passages:
        limit2 = np.minimum(limit2, (ior * ior - zeta * zeta) * (radius * radius))
    limit = EDGE * np.sqrt(limit2)
    return np.clip(ell, -limit, limit), zeta


def _step(passages, air, flat, height, ell, zeta):
    """One Newton step of both unknowns."""
    azimuth = -1.0
    turn_ell = turn_zeta = foot = foot_ell = foot_zeta = 0.0
    for ior, radius, count in passages:
        p2 = ior * ior - zeta * zeta
        w = np.sqrt(p2 * (radius * radius) - ell * ell)
        phase = (w + 1j * ell) / np.sqrt(p2 * (radius * radius))
        azimuth = azimuth * (phase.conjugate() if count < 0 else phase) ** abs(count)
        turn_ell = turn_ell + count / w
        turn_zeta = turn_zeta + count * ell * zeta / (p2 * w)
        foot = foot - count * zeta * w / p2
        foot_ell = foot_ell + count * zeta * ell / (p2 * w)
        foot_zeta = foot_zeta - count * (
            w / p2 - zeta * zeta * (radius * radius) / (w * p2) + 2.0 * zeta * zeta * w / (p2 * p2)
        )
    p2 = air * air - zeta * zeta
    p = np.sqrt(p2)
    along = azimuth.real * flat.real + azimuth.imag * flat.imag
    across = azimuth.imag * flat.real - azimuth.real * flat.imag
    first = across - ell / p
    second = foot + zeta / p * along - height
    first_ell = along * turn_ell - 1.0 / p
    first_zeta = along * turn_zeta - ell * zeta / (p2 * p)
    second_ell = foot_ell - zeta / p * across * turn_ell
    second_zeta = foot_zeta + air * air / (p2 * p) * along - zeta / p * across * turn_zeta
    determinant = first_ell * second_zeta - first_zeta * second_ell
    return (
        ell - (first * second_zeta - second * first_zeta) / determinant,
        zeta - (second * first_ell - first * second_ell) / determinant,
    )
