# SPDX-License-Identifier: GPL-3.0-or-later
"""Arithmetic of many vectors at once, by components: (3, L), the last axis counts them.

Sums of products are written out. BLAS and einsum round the last columns of an array otherwise than
the first, so that a ray's way would depend on its neighbours. OpenBLAS starts threads for long
arrays, and they wait busily for a tenth of a second after each product.
"""

from __future__ import annotations

from typing import Self

import numpy as np

from .surfaces import Floats

LEAST = 1e-300
"""Stands for a square of 0."""


def columns(array, which):
    """Some columns of an array (…, L), by their numbers or a slice.

    By numbers, ``take`` is about four times as fast as indexing with an ellipsis or a colon.
    """
    return array[..., which] if isinstance(which, slice) else array.take(which, axis=-1)


class Columns:
    """What dataclasses of arrays share whose last axis counts the same."""

    def take(self, which) -> Self:
        """Some of them, see `columns`."""
        return type(self)(*(columns(part, which) for part in vars(self).values()))


def dot(a: Floats, b: Floats) -> Floats:
    """Inner products (L,) of vectors (3, L)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def rotated(matrix: Floats, vectors: Floats) -> Floats:
    """The product of a matrix (M, 3) with vectors (3, L): (M, L)."""
    found = np.empty((len(matrix), *vectors.shape[1:]))
    x, y, z = vectors
    for line, (a, b, c) in zip(found, matrix, strict=True):
        # In place: temporaries of large pictures leave the processor's cache.
        np.multiply(a, x, out=line)
        line += b * y
        line += c * z
    return found


def units(vectors: Floats) -> Floats:
    """Vectors (3, L) made unit; 0 stays 0."""
    return vectors / np.sqrt(np.maximum(dot(vectors, vectors), LEAST))


def perpendiculars(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors across a unit direction and each other: (3,), or (3, L) of as many."""
    least = np.eye(3)[np.abs(direction).argmin(axis=0)].T
    right = units(np.cross(direction, least, axis=0))
    return right, np.cross(right, direction, axis=0)


def basis(x, y, z):
    """Two unit vectors that make a right-handed frame with the unit vector (x, y, z) last.

    T. Duff et al., Building an Orthonormal Basis, Revisited (2017): without branches.
    """
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


def against(normal: Floats, direction: Floats) -> Floats:
    """The sign (L,) that turns normals (3, L) to the side that rays come from."""
    return np.where(dot(normal, direction) > 0.0, -1.0, 1.0)


def refracted(direction, normal, cosine, behind, eta) -> Floats:
    """Unit directions (3, L) behind a surface, the normal against `direction`."""
    return units(eta * direction + (eta * cosine - behind) * normal)
