# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh data as NumPy arrays: the one place with ``foreach_get`` and ``foreach_set``."""

from __future__ import annotations

import bpy
import numpy as np

_FIELD = {"FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color", "FLOAT": "value", "INT": "value"}


def positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertex positions (N, 3), float32, in the mesh's own frame."""
    out = np.empty((len(mesh.vertices), 3), np.float32)
    if len(out):
        mesh.attributes["position"].data.foreach_get("vector", out.ravel())
    return out


def edges(mesh: bpy.types.Mesh) -> np.ndarray:
    """Vertex pairs (E, 2), int32."""
    out = np.empty((len(mesh.edges), 2), np.int32)
    mesh.edges.foreach_get("vertices", out.ravel())
    return out


def corner_normals(mesh: bpy.types.Mesh) -> np.ndarray:
    """Normals (L, 3) of the face corners, custom normals and sharp edges included."""
    out = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", out.ravel())
    return out


def write_positions(mesh: bpy.types.Mesh, values: np.ndarray) -> None:
    """Set all vertex positions (N, 3)."""
    if len(values):
        _write(mesh.attributes["position"], values)


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
        _write(attribute, values)


def _write(attribute: bpy.types.Attribute, values: np.ndarray) -> None:
    flat = np.ascontiguousarray(values, np.int32 if attribute.data_type == "INT" else np.float32)
    attribute.data.foreach_set(_FIELD[attribute.data_type], flat.ravel())


def write_image(image: bpy.types.Image, pixels: np.ndarray) -> None:
    """Set all pixels (H, W, 4), bottom row first; the image is scaled to that size first."""
    height, width = pixels.shape[:2]
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.update()
