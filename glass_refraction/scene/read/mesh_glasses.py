# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes: their triangles in the world, and what their material says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import bpy
import numpy as np

from ...optics.facets import placed
from .arrays import (
    edges_of_corners,
    mesh_triangles,
    positions,
    triangle_slots,
)
from .glassy_materials import CLEAR, opaque_materials
from .mesh_corners import Corners, corners_of
from .paint import Paint


@dataclass(frozen=True, eq=False)
class MeshGlass:
    """A glass that is a mesh, in the world.

    Attributes
    ----------
    points, normals : (T, 3, 3) float64: corners of each triangle, metres, anticlockwise seen from
        outside; unit interpolated normals there.
    ior : of the glass.
    roughness : of its surface, 0 to 1, as a Glass BSDF has it.
    refracted, reflected : parts of the light (red, green, blue) that get through the surface where
        they are refracted and reflected, beside Fresnel's law.
    opaque : (K, 3, 3) corners of the triangles of the mesh that are no glass: with these it
        encloses what is within.
    within : (T, 3, 3) the normals for rays that come from within, if bumps make them others.
    paint : what tells roughness and the parts of the light in each place, if they differ.
    """

    points: np.ndarray
    normals: np.ndarray
    ior: float
    roughness: float = 0.0
    refracted: tuple[float, float, float] = CLEAR
    reflected: tuple[float, float, float] = CLEAR
    opaque: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    within: np.ndarray | None = None
    paint: Paint | None = None

    has_contents: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.ior) and self.ior > 0.0):
            raise ValueError(f"ior must be a number above 0, not {self.ior!r}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MeshGlass) and all(
            np.array_equal(mine, theirs)
            for mine, theirs in zip(self._parts(), other._parts(), strict=True)
        )

    __hash__ = None

    def _parts(self) -> tuple:
        own = self.ior, self.roughness, self.refracted, self.reflected
        return (*own, self.points, self.normals, self.opaque, self.within, self.paint)

    def recoloured(self, glass: Callable[[float], float], _contents) -> MeshGlass:
        """The same glass as light of another colour finds it, from its ior."""
        return replace(self, ior=glass(self.ior))

    @property
    def media(self) -> tuple[float, float]:
        """The ior around it and its own."""
        return (1.0, self.ior)

    @cached_property
    def box(self) -> np.ndarray:
        """(2, 3): its lowest and highest coordinates."""
        return np.array((self.points.min(axis=(0, 1)), self.points.max(axis=(0, 1))))


def placed_triangles(
    mesh: bpy.types.Mesh, to_world: np.ndarray, opaque: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (T, 3, 3) of an evaluated mesh's triangles in the world.

    Parameters
    ----------
    to_world : (4, 4), any that has an inverse.
    opaque : see `corners_of`.

    Raises
    ------
    ValueError
        No faces, or coordinates that are no numbers.
    """
    return placed_corners(corners_of(mesh, opaque), to_world)[:2]


def placed_corners(
    corners: Corners, to_world: np.ndarray, paint: Paint | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, Paint | None]:
    """Points and unit normals (T, 3, 3) of triangles in the world, those from within or None, and
    their paint.

    Raises
    ------
    ValueError
        None of them has an area.
    """
    place = to_world[:3, :3], to_world[:3, 3]
    points, normals, area = placed(corners.points, corners.normals, *place)
    kept = area > 0.0
    if not kept.any():
        raise ValueError("its mesh has no area")
    found = [points, normals]
    if corners.within is not None:
        found.append(placed(corners.points, corners.within, *place)[1])
    found = [np.ascontiguousarray(part[kept]) for part in found]
    return *(*found, None)[:3], None if paint is None else paint.of_some(kept)


def placed_opaque(obj: bpy.types.Object, to_world: np.ndarray, opaque: int) -> np.ndarray:
    """(K, 3, 3) corners in the world of the triangles of an evaluated glass that are no glass.

    They are known by their materials: what is left of a mesh may have these in other slots.
    """
    if not opaque:
        return np.zeros((0, 3, 3))
    mesh, known = obj.data, opaque_materials(obj, opaque)
    is_opaque = [(None if m is None else m.original) in known for m in mesh.materials]
    chosen = np.array([*is_opaque, False])[np.minimum(triangle_slots(mesh), len(is_opaque))]
    points = positions(mesh).astype(float)[mesh_triangles(mesh)[chosen]]
    return points @ to_world[:3, :3].T + to_world[:3, 3]


def open_edges(mesh: bpy.types.Mesh) -> tuple[int, int]:
    """Edges of a mesh that bound one face only, and those that bound more than two."""
    count = np.bincount(edges_of_corners(mesh), minlength=len(mesh.edges))
    return int((count == 1).sum()), int((count > 2).sum())
