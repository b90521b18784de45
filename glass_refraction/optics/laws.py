# SPDX-License-Identifier: GPL-3.0-or-later
"""What happens to a ray at one interface: Snell's law, the mirror law and Fresnel's equations."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def reflect(direction: ArrayLike, normal: ArrayLike) -> NDArray[np.float64]:
    """Mirror directions at a surface.

    Parameters
    ----------
    direction, normal : array_like, (..., 3)
        Unit vectors in the same frame. The sign of the normal does not matter.

    Returns
    -------
    ndarray, (..., 3)
        direction − 2 (direction · normal) normal.
    """
    direction = np.asarray(direction, dtype=float)
    normal = np.asarray(normal, dtype=float)
    along = np.sum(direction * normal, axis=-1, keepdims=True)
    return direction - 2.0 * along * normal


def proper_rays(origin: ArrayLike, direction: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
    """Origins and unit directions (M, 3) of rays, and which are finite and have a direction.

    Those that are not get numbers that can be computed with.
    """
    direction = np.atleast_2d(np.asarray(direction, dtype=float))
    origin = np.broadcast_to(np.asarray(origin, dtype=float), direction.shape)
    largest = np.abs(direction).max(axis=-1, initial=0.0)
    proper = np.isfinite(largest) & (largest > 0.0) & np.isfinite(origin).all(axis=-1)
    direction = np.where(proper[:, None], direction, (0.0, 0.0, 1.0))
    direction = direction / np.where(proper, largest, 1.0)[:, None]
    direction = direction / np.sqrt(np.sum(direction * direction, axis=-1, keepdims=True))
    return np.where(proper[:, None], origin, 0.0), direction, proper


def refract(
    direction: ArrayLike, normal: ArrayLike, eta: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Refract directions at a surface by Snell's law (Heckbert's vector form).

    Parameters
    ----------
    direction, normal : array_like, (..., 3)
        Unit vectors in the same frame, the normal on the side the ray comes from
        (direction · normal ≤ 0).
    eta : array_like, broadcastable to (...)
        n1 / n2, the ior before the surface over the ior behind it.

    Returns
    -------
    refracted : ndarray, (..., 3)
        Unit directions behind the surface, zeros where totally reflected.
    totally_reflected : ndarray of bool, (...)
    """
    direction = np.asarray(direction, dtype=float)
    normal = np.asarray(normal, dtype=float)
    eta = np.asarray(eta, dtype=float)
    cos_incident = -np.sum(direction * normal, axis=-1)
    cos_squared = _cos_squared_behind(cos_incident, eta)
    totally_reflected = cos_squared < 0.0
    cos_behind = np.sqrt(np.maximum(cos_squared, 0.0))
    refracted = eta[..., None] * direction + (eta * cos_incident - cos_behind)[..., None] * normal
    # The formula yields unit vectors only up to the rounding of its inputs; a path of many
    # interfaces would let that grow.
    length = np.sqrt(np.sum(refracted * refracted, axis=-1, keepdims=True))
    refracted = refracted / np.where(length > 0.0, length, 1.0)
    refracted = np.where(totally_reflected[..., None], 0.0, refracted)
    return refracted, totally_reflected


def fresnel(cos_incident: ArrayLike, eta: ArrayLike) -> NDArray[np.float64]:
    """Reflectance of an interface for unpolarised light.

    Parameters
    ----------
    cos_incident : array_like
        Cosine of the angle between ray and normal, before the surface (its sign is ignored).
    eta : array_like
        n1 / n2, broadcast against `cos_incident`.

    Returns
    -------
    ndarray
        Between 0 and 1; exactly 1 under total reflection and at grazing incidence.
    """
    cos_incident, eta = np.broadcast_arrays(
        np.minimum(np.abs(np.asarray(cos_incident, dtype=float)), 1.0),
        np.asarray(eta, dtype=float),
    )
    return reflectance_and_cosine(cos_incident, eta)[0]


def reflectance_and_cosine(
    cos_incident: NDArray[np.float64], eta: NDArray[np.float64] | float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reflectance as `fresnel`, and the cosine behind the surface (0 under total reflection).

    `cos_incident` between 0 and 1.
    """
    cos_squared = _cos_squared_behind(cos_incident, eta)
    cos_behind = np.sqrt(np.maximum(cos_squared, 0.0))
    one = (cos_squared <= 0.0) | (cos_incident == 0.0)
    across = np.where(one, 1.0, eta * cos_incident + cos_behind)
    along = np.where(one, 1.0, cos_incident + eta * cos_behind)
    perpendicular = (eta * cos_incident - cos_behind) / across
    parallel = (cos_incident - eta * cos_behind) / along
    reflectance = 0.5 * (perpendicular * perpendicular + parallel * parallel)
    return np.where(one, 1.0, reflectance), cos_behind


def _cos_squared_behind(cos_incident, eta):
    """Squared cosine behind the surface, negative under total reflection."""
    # 1 − eta² (1 − c²), arranged so that eta = 1 returns c² without rounding at grazing angles.
    return (1.0 - eta) * (1.0 + eta) + (eta * cos_incident) ** 2
