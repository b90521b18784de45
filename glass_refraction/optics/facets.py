# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals for refraction that are not the surface's own: interpolated ones, and those of facets.

A mesh's faces are flat but shaded by interpolated normals; a rough surface consists of facets. In
both cases rays must end on the side of the surface where they belong.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surfaces import Floats
from .vectors import basis, dot, units


def placed(points: Floats, normals: Floats, linear: Floats, shift: Floats | float):
    """Corners and unit normals (T, 3, 3) of triangles elsewhere, and twice their areas (T,).

    Where a corner has no normal it gets the face's.
    """
    points, normals = points @ linear.T + shift, normals @ np.linalg.inv(linear)
    if np.linalg.det(linear) < 0.0:
        # A mirrored triangle runs the other way round.
        points, normals = points[:, ::-1], normals[:, ::-1]
    flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    area = np.linalg.norm(flat, axis=1)
    flat = flat / np.where(area > 0.0, area, 1.0)[:, None]
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    usable = np.isfinite(length) & (length > 0.0)
    return points, np.where(usable, normals / np.where(usable, length, 1.0), flat[:, None]), area


ENDLESS = 128
"""Events after which no way is followed on."""


def bent(normal: Floats, flat: Floats, direction: Floats) -> Floats:
    """Interpolated normals turned towards the face's as little as is needed.

    Off them no ray is reflected to the wrong side of the face. That is what Cycles'
    ``ensure_valid_specular_reflection`` does, with the same least angle to the face.
    """
    grazing = np.minimum(-SHARE * dot(flat, direction), CLEAR)

    def right(part, which) -> NDArray[np.bool_]:
        d, f = direction[:, which], flat[:, which]
        cosine = -dot(part, d)
        up = dot(d, f) + 2.0 * cosine * dot(part, f)
        return (cosine > 0.0) & (up >= grazing[which])

    wrong = np.flatnonzero(~right(normal, slice(None)) & (normal != flat).any(axis=0))
    if not len(wrong):
        return normal
    one, other = normal[:, wrong], flat[:, wrong]
    low, high = np.zeros(len(wrong)), np.ones(len(wrong))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = right(units(one + middle * (other - one)), wrong)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    bent = normal.copy()
    bent[:, wrong] = units(one + high * (other - one))
    return bent


SHARE, CLEAR = 0.9, 0.01
"""Least cosine between a ray that leaves a face and the face's normal: this share of that of the
ray it comes from, or this, as in Cycles."""

HALVINGS = 12
"""By which the least turn of a normal is found: to 1/4096 of the whole."""


def visible_facets(normal: Floats, direction: Floats, alpha: Floats, first, second) -> Floats:
    """Normals (3, L) of facets of a rough surface as a ray sees them.

    GGX, visible normals, by two shares (L,) between 0 and 1 (J. Dupuy and A. Benyoub, Sampling
    Visible GGX Normals with Spherical Caps, 2023). `alpha`: roughness squared.
    """
    one, other = map(np.stack, basis(*normal))
    across = (-alpha * dot(axis, direction) for axis in (one, other))
    view = units(np.stack([*across, -dot(normal, direction)]))
    azimuth = 2.0 * np.pi * first
    height = (1.0 - second) * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    x, y, z = (
        radius * np.cos(azimuth) + view[0],
        radius * np.sin(azimuth) + view[1],
        height + view[2],
    )
    return units(alpha * x * one + alpha * y * other + np.maximum(z, 0.0) * normal)


def facet_shares(pixel, sample, events) -> tuple[Floats, Floats]:
    """Two numbers between 0 and 1 for a sample of a pixel at an event: always the same ones.

    At the first two events the samples of a pixel are spread evenly over the facets of both
    (J. Halton, 1960), from a place that the pixel chooses. At later ones each sample has its own.
    """
    found = []
    early = events < 2
    for axis in range(2):
        row = np.minimum(events, 1) * 2 + axis
        code = np.where(early, row, (sample * ENDLESS + events) * 2 + axis).astype(np.int64)
        # Twice: one round leaves neighbours' high digits alike.
        start = fold(fold(pixel.astype(np.uint64), code + 1), np.int64(1))
        begin = (start >> np.uint64(11)).astype(float) * 2.0**-53
        first, second = (_mirrored_digits(sample, base) for base in BASES[axis::2])
        spread = np.where(events == 0, first, second)
        found.append((begin + np.where(early, spread, 0.0)) % 1.0)
    return found[0], found[1]


BASES = 2, 3, 5, 7
"""Of the sequences for both shares at the first event and at the second."""


def _mirrored_digits(number: NDArray[np.int64], base: int) -> Floats:
    """The digits of whole numbers behind the point, the last one first."""
    found, place = np.zeros(len(number)), 1.0 / base
    while number.any():
        number, digit = np.divmod(number, base)
        found += digit * place
        place /= base
    return found


def fold(path: NDArray[np.uint64], code: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The hash of a sequence that goes on with a code (a multiplicative hash, xor-shifted)."""
    mixed = (path ^ code.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
    return mixed ^ (mixed >> np.uint64(32))
