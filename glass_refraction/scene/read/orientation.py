# SPDX-License-Identifier: GPL-3.0-or-later
"""Which way a mesh's faces look: a glass is behind their fronts, so all of a body must look out."""

from __future__ import annotations

from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from .arrays import edges, edges_of_corners, mesh_triangles, positions

FLAT = 1e-9
"""Of a body's size cubed: less volume than this is neither inside nor outside."""

MOST_EDGES = 200_000
"""Of a mesh whose bodies are told apart in `orientation_of`: a larger one counts as one body, for a
panel must not wait."""


@dataclass(frozen=True)
class Orientation:
    """What is wrong with a mesh's normals.

    Attributes
    ----------
    edges : between two faces of which one looks out and the other in.
    bodies : closed, all of whose faces look in.
    """

    edges: int
    bodies: int

    @property
    def is_right(self) -> bool:
        return not (self.edges or self.bodies)


def orientation_of(mesh: bpy.types.Mesh) -> Orientation:
    """What is wrong with the normals of an evaluated mesh.

    A body within another may be a cavity: its faces may look in. Of an open mesh nobody can tell
    which side is outside.
    """
    if not len(mesh.polygons):
        return Orientation(0, 0)
    edge, vertex = edges_of_corners(mesh), np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex)
    count = np.bincount(edge, minlength=len(mesh.edges))
    # Two faces that look the same way run along the edge between them in opposite directions.
    along = np.where(edges(mesh)[edge, 0] == vertex, 1, -1)
    turns = np.bincount(edge, along, len(mesh.edges))
    disagreeing = (count == 2) & (turns != 0)
    large = len(mesh.edges) > MOST_EDGES
    bodies = np.zeros(len(mesh.vertices), np.intp) if large else bodies_of(mesh)
    closed = np.ones(bodies.max() + 1, bool)
    wrong = (count == 1) | (count > 2) | disagreeing
    closed[bodies[edges(mesh)[wrong, 0]]] = False
    volume, box = _volumes(mesh, bodies)
    size = np.ptp(box, axis=1).max(axis=1)
    looks_in = closed & (volume < -FLAT * size**3)
    inside_out = [
        b for b in np.flatnonzero(looks_in) if not is_within(box[b], np.delete(box, b, 0))
    ]
    return Orientation(int(disagreeing.sum()), len(inside_out))


def bodies_of(mesh: bpy.types.Mesh) -> np.ndarray:
    """(V,) number of the body of connected faces that each vertex belongs to."""
    number = np.arange(len(mesh.vertices))
    one, other = edges(mesh).T
    while True:
        lowest = np.minimum(number[one], number[other])
        before = number.copy()
        np.minimum.at(number, number[one], lowest)
        np.minimum.at(number, number[other], lowest)
        # Each points on to what its own body's lowest points to.
        while (number != number[number]).any():
            number = number[number]
        if (number == before).all():
            return np.unique(number, return_inverse=True)[1].reshape(-1)


def _volumes(mesh: bpy.types.Mesh, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Volume (B,), below 0 where its faces look in, and box (B, 2, 3) of each body."""
    points = positions(mesh).astype(float)
    corners = mesh_triangles(mesh)
    total = bodies.max() + 1
    box = np.empty((total, 2, 3))
    box[:, 0], box[:, 1] = np.inf, -np.inf
    np.minimum.at(box[:, 0], bodies, points)
    np.maximum.at(box[:, 1], bodies, points)
    body = bodies[corners[:, 0]]
    a, b, c = np.moveaxis(points[corners] - box[body, 0][:, None], 1, 0)
    part = np.einsum("nk,nk->n", a, np.cross(b, c)) / 6.0
    return np.bincount(body, part, total), box


def is_within(box: np.ndarray, others: np.ndarray) -> bool:
    """Whether a box (2, 3) lies within one of others (B, 2, 3)."""
    return bool(((others[:, 0] < box[0]) & (others[:, 1] > box[1])).all(axis=1).any())


def turn_outwards(mesh: bpy.types.Mesh) -> int:
    """Turn faces of a mesh so that all of a body's look the same way, and out; returns how many.

    A body within another keeps the way that most of its faces look: it may be a cavity.
    """
    if not len(mesh.polygons):
        return 0
    before, after = _normals(mesh), np.empty((len(mesh.polygons), 3))
    found = bmesh.new()
    try:
        found.from_mesh(mesh)
        bmesh.ops.recalc_face_normals(found, faces=found.faces)
        after[:] = [face.normal for face in found.faces]
    finally:
        found.free()
    turned = np.einsum("nk,nk->n", before, after) < 0.0
    bodies = bodies_of(mesh)
    body = bodies[_first_vertices(mesh)]
    _, box = _volumes(mesh, bodies)
    for number in np.unique(body[turned]):
        some = body == number
        if turned[some].mean() > 0.5 and is_within(box[number], np.delete(box, number, axis=0)):
            turned[some] = ~turned[some]
    for number in np.flatnonzero(turned).tolist():
        mesh.polygons[number].flip()
    mesh.update()
    return int(turned.sum())


def turn_all(mesh: bpy.types.Mesh) -> None:
    """Turn all faces of a mesh."""
    for face in mesh.polygons:
        face.flip()
    mesh.update()


def _normals(mesh: bpy.types.Mesh) -> np.ndarray:
    """Unit normals (F, 3) of a mesh's faces."""
    found = np.empty((len(mesh.polygons), 3), np.float32)
    mesh.polygons.foreach_get("normal", found.ravel())
    return found


def _first_vertices(mesh: bpy.types.Mesh) -> np.ndarray:
    """(F,) a vertex of each face."""
    first = np.empty(len(mesh.polygons), np.int32)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.polygons.foreach_get("loop_start", first)
    mesh.loops.foreach_get("vertex_index", vertex)
    return vertex[first]
