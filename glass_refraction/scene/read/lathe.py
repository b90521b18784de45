# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that are turned about their z axis, as Screw, Spin and Subdivision make them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import bpy
import numpy as np

from .arrays import edges, edges_of_corners, positions

NEAR = 1e-4
"""Part of the mesh's size within which places are the same, or on the axis."""
OFF = 0.015
"""Part of the mesh's size by which points may be off the profile: Subdivision makes rings of
many corners that are not quite round."""
LEAST_STEPS = 12
"""Places round the axis from which on a mesh is meant to be round."""


@dataclass(frozen=True, eq=False)
class Lathe:
    """The profile of a mesh that is turned about its z axis, as a glass of revolution has it.

    Attributes
    ----------
    outer : (K, 2) radius and height, in the object's units: from the axis below up to the rim, or
        to the axis again.
    inner : (L, 2) of the cup in it, from the axis up to the rim; None for a solid body.
    """

    outer: np.ndarray
    inner: np.ndarray | None = None


def lathe_of(mesh: bpy.types.Mesh) -> Lathe | None:
    """The profile of an evaluated mesh that is a turned, closed body; None of any other mesh.

    A body with a hole along its axis, such as a ring, has no such profile.
    """
    points = positions(mesh).reshape(-1, 3).astype(float)
    if not len(mesh.polygons) or not np.isfinite(points).all():
        return None
    size = float(np.ptp(points, axis=0).max())
    radius, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    off_axis = radius > NEAR * size
    if not off_axis.any():
        return None
    ends = edges(mesh)
    if _is_open(mesh, off_axis[ends].any(axis=1)):
        return None
    angle = np.arctan2(points[:, 1], points[:, 0])
    if not _is_all_round(angle[off_axis]):
        return None
    start = angle[np.argmax(radius)]
    aside = np.abs(np.angle(np.exp(1j * (angle - start)))) * radius
    section = ~off_axis | (aside < NEAR * size)
    profile = np.stack((np.where(off_axis, radius, 0.0), height), axis=1)
    path = _path(ends, profile, section, NEAR * size)
    if path is None or _distance(profile, path) > OFF * size:
        return None
    return _sides(path, NEAR * size)


def _is_open(mesh: bpy.types.Mesh, counted: np.ndarray) -> bool:
    """Whether edges that count (E,) bound one face only or more than two."""
    faces = np.bincount(edges_of_corners(mesh), minlength=len(counted))
    return bool((faces[counted] != 2).any())


def _is_all_round(angles: np.ndarray) -> bool:
    """Whether places lie round the whole axis, densely enough for a round body."""
    turned = np.sort(angles)
    gaps = np.diff(np.append(turned, turned[0] + 2.0 * np.pi))
    return bool(gaps.max() <= 2.0 * np.pi / LEAST_STEPS * (1.0 + NEAR))


def _path(
    edges: np.ndarray, profile: np.ndarray, section: np.ndarray, near: float
) -> np.ndarray | None:
    """The section's edges as one path (K, 2) from axis to axis; None where they are none.

    A flat face that has no point on the axis closes the body there.
    """
    edges = edges[section[edges].all(axis=1)]
    # Places that are the same count as one: Screw leaves a point on the axis for each step.
    cells = np.round(profile / near).astype(np.int64)
    places, number = np.unique(cells, axis=0, return_inverse=True)
    number = number.reshape(-1)
    pairs = np.unique(np.sort(number[edges], axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    on_axis = places[:, 0] == 0
    pairs = pairs[~on_axis[pairs].all(axis=1)]
    if not len(pairs):
        return None
    beside: dict[int, list[int]] = {}
    for one, other in pairs.tolist():
        beside.setdefault(one, []).append(other)
        beside.setdefault(other, []).append(one)
    ends = [place for place, others in beside.items() if len(others) == 1]
    if len(ends) != 2 or any(len(others) > 2 for others in beside.values()):
        return None
    path = [ends[0]]
    while len(path) < len(beside):
        further = [place for place in beside[path[-1]] if place not in path[-2:]]
        if len(further) != 1:
            return None
        path.append(further[0])
    first = {int(place): row for row, place in reversed(list(enumerate(number)))}
    found = [profile[first[place]] for place in path]
    if found[0][0] > 0.0:
        found.insert(0, np.array((0.0, found[0][1])))
    if found[-1][0] > 0.0:
        found.append(np.array((0.0, found[-1][1])))
    return np.array(found)


def _distance(points: np.ndarray, path: np.ndarray) -> float:
    """The farthest that any of the points (N, 2) is from a path (K, 2)."""
    nearest = np.full(len(points), np.inf)
    for one, other in pairwise(path):
        along = other - one
        share = np.clip((points - one) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        off = np.linalg.norm(points - one - share[:, None] * along, axis=1)
        nearest = np.minimum(nearest, off)
    return float(nearest.max())


def _sides(path: np.ndarray, near: float) -> Lathe:
    """The outside and the inside of a path from axis to axis; they meet at the rim, the top."""
    if path[0, 1] > path[-1, 1]:
        path = path[::-1]
    top = np.flatnonzero(path[:, 1] > path[:, 1].max() - near)
    if path[-1, 1] > path[:, 1].max() - near:
        return Lathe(path)
    return Lathe(path[: top[0] + 1], path[top[-1] :][::-1])
