# SPDX-License-Identifier: GPL-3.0-or-later
"""A source's triangles and attributes out of Blender's meshes, and refined ones back into one."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np

from .arrays import (
    corner_normals,
    mesh_triangles,
    read_attribute,
    unit,
    write_attribute,
    write_polygons,
)
from .sources import Piece, world_positions
from .triangles import Triangles

# Attributes that Blender makes from the mesh itself or that belong to other domains.
_MATERIAL = "material_index"
_LEFT_OUT = {"position", "custom_normal", "sharp_edge", ".edge_verts", _MATERIAL}
_INTERPOLATED = {"FLOAT", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR"}
_TAKEN_OVER = {"INT", "INT8", "BOOLEAN"}


@dataclass(eq=False)
class SourceMesh:
    """The triangles of a source in the world, with what its corners, vertices and faces carry.

    Attributes
    ----------
    points : (N, 3) float64, world. corners : (T, 3) vertex indices.
    at_corner : name -> (kind, (T, 3, k)) values of the triangles' corners.
    of_face : name -> (kind, (T, k)) values of the triangles' faces.
    normals : (T, 3, 3) corner normals in the world.
    """

    points: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    at_corner: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    of_face: dict[str, tuple[str, np.ndarray]] = field(default_factory=dict)

    def parted(self, parts: Triangles) -> SourceMesh:
        """Parts of the triangles, with what these carry."""
        return SourceMesh(
            parts.points,
            parts.corners,
            unit(_at(self.normals, parts)),
            {name: (kind, _at(values, parts)) for name, (kind, values) in self.at_corner.items()},
            {name: (kind, values[parts.origin]) for name, (kind, values) in self.of_face.items()},
        )

    def repeated(self, number: int) -> SourceMesh:
        """The same triangles so many times, each time with points of their own."""

        def tiled(values: np.ndarray) -> np.ndarray:
            return np.tile(values, (number,) + (1,) * (values.ndim - 1))

        starts = len(self.points) * np.arange(number).repeat(len(self.corners))
        return SourceMesh(
            tiled(self.points),
            tiled(self.corners) + starts[:, None],
            tiled(self.normals),
            {name: (kind, tiled(values)) for name, (kind, values) in self.at_corner.items()},
            {name: (kind, tiled(values)) for name, (kind, values) in self.of_face.items()},
        )


def read_triangles(parts: list[Piece]) -> np.ndarray:
    """The triangles (T, 3) of the pieces, by vertices as they are numbered one after another."""
    starts = np.cumsum([0] + [len(part.mesh.vertices) for part in parts])
    found = [mesh_triangles(p.mesh) + s for p, s in zip(parts, starts[:-1], strict=True)]
    return np.concatenate(found or [np.empty((0, 3), np.int32)])


def read_source_mesh(parts: list[Piece], extra: dict[str, np.ndarray] | None = None) -> SourceMesh:
    """Join the pieces of a source; materials of later pieces follow those of earlier ones.

    Parameters
    ----------
    extra : further point attributes, name -> (N, 3), for all vertices in the pieces' order.
    """
    normals, slots = [], 0
    at_corner: dict[str, list] = {}
    of_face: dict[str, list] = {}
    counts = []
    for part in parts:
        mesh = part.mesh
        vertices, loops, faces = (
            mesh_triangles(mesh, what) for what in ("vertices", "loops", "polygon_index")
        )
        count = len(vertices)
        turn = np.linalg.inv(part.to_world[:3, :3]).T
        normals.append(unit(corner_normals(mesh)[loops] @ turn.T))
        for attribute in mesh.attributes:
            if attribute.name in _LEFT_OUT or attribute.domain == "EDGE":
                continue
            kind, domain = attribute.data_type, attribute.domain
            if kind in _INTERPOLATED and domain in {"POINT", "CORNER"}:
                values = read_attribute(attribute)[vertices if domain == "POINT" else loops]
                at_corner.setdefault(attribute.name, []).append((len(counts), kind, values))
            elif kind in _INTERPOLATED | _TAKEN_OVER and domain == "FACE":
                values = read_attribute(attribute)[faces]
                of_face.setdefault(attribute.name, []).append((len(counts), kind, values))
        material = np.full((count, 1), slots, np.int32)
        if _MATERIAL in mesh.attributes:
            material += read_attribute(mesh.attributes[_MATERIAL])[faces]
        of_face.setdefault(_MATERIAL, []).append((len(counts), "INT", material))
        slots += max(1, len(mesh.materials))
        counts.append(count)
    joined = read_triangles(parts)
    source = SourceMesh(world_positions(parts), joined, np.concatenate(normals))
    source.at_corner = {n: _filled(v, counts) for n, v in at_corner.items()}
    source.of_face = {n: _filled(v, counts) for n, v in of_face.items()}
    for name, values in (extra or {}).items():
        source.at_corner[name] = ("FLOAT_VECTOR", values[joined])
    return source


def _filled(entries: list, counts: list[int]) -> tuple[str, np.ndarray]:
    """One array over all pieces; pieces without the attribute, or with another kind, get zeros."""
    kind, shape = entries[0][1], entries[0][2].shape[1:]
    blocks = {number: values for number, k, values in entries if k == kind}
    return kind, np.concatenate(
        [
            blocks.get(number, np.zeros((count, *shape), entries[0][2].dtype))
            for number, count in enumerate(counts)
        ]
    )


def write_mesh(mesh: bpy.types.Mesh, source: SourceMesh) -> None:
    """Write triangles, with all that they carry, into the mesh, at their true places.

    The original normals go into ``rg_normal``.
    """
    mesh.clear_geometry()
    write_polygons(mesh, source.points, source.corners)
    for name, (kind, values) in source.at_corner.items():
        write_attribute(mesh, name, values, kind, "CORNER")
    for name, (kind, values) in source.of_face.items():
        write_attribute(mesh, name, values, kind, "FACE")
    write_attribute(mesh, "rg_normal", source.normals, "FLOAT_VECTOR", "CORNER")


def _at(values: np.ndarray, parts: Triangles) -> np.ndarray:
    """Values (T, 3, k) of source corners, interpolated at the corners of the parts."""
    return parts.weights @ values[parts.origin]
