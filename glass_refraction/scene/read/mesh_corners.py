# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles of a mesh that is a glass, in its own frame, and what is known at their corners."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .arrays import (
    corner_normals,
    mesh_triangles,
    positions,
    read_attribute,
    triangle_slots,
)
from .glassy_materials import MOST_SLOTS

CORNER_NORMAL = "rg_corner_normal"
"""Attribute of the loose points, three a triangle, that the modifier leaves of a mesh where it
hides it; `node_groups.glass` makes them."""
CORNER_MARK = "rg_corner_mark"
"""Another: the place on the UV map that the modifier is told of, and the material slot."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a mesh's triangles in its own frame.

    Attributes
    ----------
    points, normals : (T, 3, 3): points are anticlockwise seen from outside.
    slots : (T,) material slots.
    uv : (T, 3, 2) the UV map that the modifier is told of, if renders left it; else None.
    within : (T, 3, 3) the normals for rays that come from within, if bumps make them others.
    missed : part of the edges between whose ends bumps are other than the normals.
    source : (T,) of which triangle of the mesh each is a part, and (T, 3, 3) where in it its
        corners lie; None: they are the mesh's.
    finish : (T, 3, 7) see `Paint.at`, where it was asked for.
    """

    points: np.ndarray
    normals: np.ndarray
    slots: np.ndarray
    uv: np.ndarray | None = None
    within: np.ndarray | None = None
    missed: float = 0.0
    source: tuple[np.ndarray, np.ndarray] | None = None
    finish: np.ndarray | None = None


def triangles_of(mesh: bpy.types.Mesh, opaque: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (T, 3, 3) of a mesh's triangles alone, see `corners_of`."""
    corners = corners_of(mesh, opaque)
    return corners.points, corners.normals


def corners_of(mesh: bpy.types.Mesh, opaque: int = 0) -> Corners:
    """The corners of a mesh's triangles, in its own frame.

    Parameters
    ----------
    opaque : what `opaque_bits` has of the glass; its faces that are no glass are left out.

    Raises
    ------
    ValueError
        No faces, or coordinates that are no numbers.
    """
    points, uv = positions(mesh).astype(float), None
    if is_hidden(mesh):
        normals = read_attribute(mesh.attributes[CORNER_NORMAL]).astype(float)
        # What casts the shadow and what is opaque have no such normals.
        own_points = normals.any(axis=1)
        points, normals = points[own_points], normals[own_points]
        slots = np.zeros(len(points) // 3, np.int32)
        if CORNER_MARK in mesh.attributes:
            marks = read_attribute(mesh.attributes[CORNER_MARK])[own_points].reshape(-1, 3, 3)
            uv, slots = marks[..., :2].astype(float), marks[:, 0, 2].astype(np.int32)
    else:
        glass = np.flatnonzero(~_is_opaque(mesh, opaque))
        normals = corner_normals(mesh).astype(float)[mesh_triangles(mesh, "loops")[glass]]
        points, slots = points[mesh_triangles(mesh)[glass]], triangle_slots(mesh)[glass]
    if not len(points):
        raise ValueError("its mesh has no faces: a glass needs some")
    if not np.isfinite(points).all():
        raise ValueError("its mesh has a point that is no number: delete or move it")
    return Corners(points.reshape(-1, 3, 3), normals.reshape(-1, 3, 3), slots, uv)


def is_hidden(mesh: bpy.types.Mesh) -> bool:
    """Whether a glass's modifier left its glass's corners of an evaluated mesh, and no face."""
    return CORNER_NORMAL in mesh.attributes


def _is_opaque(mesh: bpy.types.Mesh, opaque: int) -> np.ndarray:
    """(T,) whether each of a mesh's triangles is of one of the opaque slots."""
    slots = np.minimum(triangle_slots(mesh), MOST_SLOTS)
    return (opaque >> slots & 1).astype(bool)
