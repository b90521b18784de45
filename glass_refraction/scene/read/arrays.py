# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh data as NumPy arrays: the one place with ``foreach_get`` and ``foreach_set``."""

from __future__ import annotations

import bpy
import numpy as np

# Attribute kind -> (property, components, type) as foreach_get and foreach_set take them.
KINDS = {
    "FLOAT": ("value", 1, np.float32),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
    "QUATERNION": ("value", 4, np.float32),
    "FLOAT4X4": ("value", 16, np.float32),
    "INT": ("value", 1, np.int32),
    "INT8": ("value", 1, np.int32),
    "INT16_2D": ("value", 2, np.int32),
    "INT32_2D": ("value", 2, np.int32),
    "BOOLEAN": ("value", 1, np.bool_),
}


def unit(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) of that direction; of none 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def affine(points: np.ndarray, matrix: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Points (N, 3) times an affine (k, 4) matrix into ``out`` (N, k), in blocks that fit a cache.

    Worked out in float64 whatever the points are: a vertex far from the origin keeps its digits.
    """
    columns, block = np.ascontiguousarray(matrix.T), np.ones((min(len(points), _BLOCK), 4))
    for start in range(0, len(points), _BLOCK):
        end = min(start + _BLOCK, len(points))
        homogeneous = block[: end - start]
        homogeneous[:, :3] = points[start:end]
        np.dot(homogeneous, columns, out=out[start:end])
    return out


_BLOCK = 8192


def positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertex positions (N, 3), float32, in the mesh's own frame."""
    out = np.empty((len(mesh.vertices), 3), np.float32)
    place = mesh.attributes.get("position")
    if place is not None and len(out):
        place.data.foreach_get("vector", out.ravel())
    elif len(out):
        # In Edit Mode the attribute is missing. This is a hundred times slower.
        mesh.vertices.foreach_get("co", out.ravel())
    return out


def uv_map(mesh: bpy.types.Mesh, name: str = "") -> np.ndarray:
    """A UV map (L, 2), float32; without a name the one that renders use, 0 where there is none."""
    used = (layer.name for layer in mesh.uv_layers if layer.active_render)
    layer = mesh.attributes.get(name or next(used, ""))
    if layer is None or (layer.data_type, layer.domain) != ("FLOAT2", "CORNER"):
        return np.zeros((len(mesh.loops), 2), np.float32)
    return read_attribute(layer)


def edges(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertex pairs (E, 2), int32."""
    out = np.empty((len(mesh.edges), 2), np.int32)
    mesh.edges.foreach_get("vertices", out.ravel())
    return out


def edges_of_corners(mesh: bpy.types.Mesh) -> np.ndarray:
    """(L,) int32, the edge that each face corner begins: one face has it once."""
    out = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("edge_index", out)
    return out


def mesh_triangles(mesh: bpy.types.Mesh, what: str = "vertices") -> np.ndarray:
    """A property of a mesh's triangles, int32: ``vertices`` or ``loops`` (T, 3), others (T,)."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    out = np.empty((count, 3) if what in {"vertices", "loops"} else count, np.int32)
    mesh.loop_triangles.foreach_get(what, out.ravel())
    return out


def triangle_slots(mesh: bpy.types.Mesh) -> np.ndarray:
    """(T,) int32, the material slot of each of a mesh's triangles."""
    if "material_index" in mesh.attributes:
        return mesh_triangles(mesh, "material_index")
    mesh.calc_loop_triangles()
    return np.zeros(len(mesh.loop_triangles), np.int32)


def corner_normals(mesh: bpy.types.Mesh) -> np.ndarray:
    """Normals (L, 3) of the face corners, custom normals and sharp edges included."""
    out = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", out.ravel())
    return out


def read_attribute(attribute: bpy.types.Attribute, name: str | None = None) -> np.ndarray:
    """All values (n, k) of an attribute; ``name``: of another of its properties than usual."""
    usual, components, dtype = KINDS[attribute.data_type]
    out = np.empty((len(attribute.data), components), dtype)
    if len(out):
        attribute.data.foreach_get(name or usual, out.ravel())
    return out


def write_attribute(
    mesh: bpy.types.Mesh, name: str, values: np.ndarray, kind: str, domain: str = "POINT"
) -> None:
    """Set the attribute ``name``; made anew where it is missing or of another kind."""
    attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.data_type != kind or attribute.domain != domain):
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.attributes.new(name, kind, domain)
    if len(values):
        field, _, dtype = KINDS[kind]
        attribute.data.foreach_set(field, np.ascontiguousarray(values, dtype).ravel())


def write_polygons(mesh: bpy.types.Mesh, points: np.ndarray, polygons: np.ndarray) -> None:
    """Fill an empty mesh with points (V, 3) and polygons of equal numbers of corners (F, k)."""
    count, corners = polygons.shape
    mesh.vertices.add(len(points))
    mesh.loops.add(count * corners)
    mesh.polygons.add(count)
    # As attributes: that is a copy, where by the properties Blender sets one element after another.
    write_attribute(mesh, "position", points, "FLOAT_VECTOR")
    write_attribute(mesh, ".corner_vert", polygons, "INT", "CORNER")
    mesh.polygons.foreach_set("loop_start", np.arange(0, count * corners, corners, dtype=np.int32))
    mesh.update(calc_edges=True)


def write_image(image: bpy.types.Image, pixels: np.ndarray) -> None:
    """Set all pixels (H, W, 4), bottom row first; the image is scaled to that size first."""
    height, width = pixels.shape[:2]
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.update()
