# SPDX-License-Identifier: GPL-3.0-or-later
"""Displaced copies: an appearance in, one carrier mesh a (glass, light path, source) out."""

from __future__ import annotations

import bpy
import numpy as np

from ..build.texture_coordinates import write_coordinates
from ..read.arrays import write_attribute
from ..read.mesh_arrays import SourceMesh, read_source_mesh, write_mesh
from ..read.modifier_inputs import write_input
from ..read.sources import Piece
from ..read.viewpoint import Viewpoint
from .appearance import Appearance, Source
from .tessellation import Images, view_pixels

MAX_REACH_PX = 8.0
"""How far a face may reach beyond its vertices that have an image."""


def write_copy(
    copy: bpy.types.Object,
    source: Source,
    shape: Appearance,
    view: Viewpoint,
    *,
    mesh: SourceMesh | None = None,
    before: Appearance | None = None,
) -> None:
    """Write where a source appears into the copy's carrier mesh.

    Parameters
    ----------
    mesh : the source's parts, where the appearance is refined.
    before : what the carrier holds of the same source.
    """
    if shape.images is None:
        if before is None or before.images is not None:
            empty_copy(copy)
        return
    slots = used_slots(shape.images.valid)
    seen = np.stack([seen_vertices(shape, slot, view) for slot in slots]).reshape(-1)
    where = shape.images.position[slots].reshape(-1, 3)
    write_input(copy.modifiers[0], "Whole", bool(seen.min() == 1.0))
    write_input(copy.modifiers[0], "Normals", _kept_normals(source, shape))
    if shape.refined:
        write_mesh(copy.data, mesh.repeated(len(slots)))
        _write_carrier(copy.data, where, seen, keep_mesh=True)
        return
    _write_carrier(copy.data, where, seen)
    write_coordinates(copy.data, source.extra, len(slots))
    write_input(copy.modifiers[0], "Slots", max(1, len(slots)))


def empty_copy(copy: bpy.types.Object) -> None:
    """Let a copy show nothing."""
    _write_carrier(copy.data, np.empty((0, 3)), np.empty(0))


def _kept_normals(source: Source, shape: Appearance) -> int:
    """Which normals the copy keeps, as its node group counts them."""
    return _NORMALS["CORNER" if shape.refined else source.normals]


_NORMALS = {"CORNER": 1, "POINT": 2, "FACE": 3}


def write_moment(copy: bpy.types.Object, shape: Appearance, position: np.ndarray) -> None:
    """Move a copy that shows ``shape`` to where its vertices (B, N, 3) are at another moment."""
    slots = used_slots(shape.images.valid)
    write_attribute(copy.data, "position", position[slots].reshape(-1, 3), "FLOAT_VECTOR")
    copy.data.update()
    copy.update_tag()


def write_true_mesh(obj: bpy.types.Object, parts: list[Piece]) -> None:
    """Write the pieces, where they are, into the object's own mesh (for sources not carried)."""
    write_mesh(obj.data, read_source_mesh(parts))
    obj.data.update_tag()


def used_slots(valid: np.ndarray) -> np.ndarray:
    """The image slots, of (B, N) flags, in which anything is seen."""
    return np.nonzero(valid.any(axis=1))[0]


def seen_vertices(shape: Appearance, slot: int, view: Viewpoint) -> np.ndarray:
    """(N,) 1 for vertices with an image, 0 for those placed on the fold near such a one.

    A vertex without an image that lies far from the images of its neighbours says nothing about
    where the surface ends: no face may hang on it.
    """
    images: Images = shape.images
    valid = images.valid[slot]
    seen = valid.astype(np.float32)
    if valid.all():
        return seen
    corners = shape.triangles.corners
    mixed = valid[corners].any(axis=1) & ~valid[corners].all(axis=1)
    if mixed.any():
        part = corners[mixed]
        places = view_pixels(view, images.position[slot])[part]
        good = valid[part][..., None]
        low = np.where(good, places, np.inf).min(axis=1, keepdims=True)
        high = np.where(good, places, -np.inf).max(axis=1, keepdims=True)
        away = np.maximum(low - places, places - high).max(axis=2)
        far = (away > MAX_REACH_PX) & ~valid[part]
        seen[part[far]] = -1e3
    return seen


def _write_carrier(mesh, where, seen, *, keep_mesh: bool = False) -> None:
    if not keep_mesh and (len(mesh.vertices) != len(where) or len(mesh.edges)):
        mesh.clear_geometry()
        mesh.vertices.add(len(where))
    if len(where):
        write_attribute(mesh, "position", where, "FLOAT_VECTOR")
    write_attribute(mesh, "rg_seen", seen, "FLOAT")
    mesh.update()
    mesh.update_tag()
