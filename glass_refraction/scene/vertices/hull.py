# SPDX-License-Identifier: GPL-3.0-or-later
"""The face of a glass that the eye's rays meet first, as a mesh: its outline in the picture."""

from __future__ import annotations

from functools import lru_cache, singledispatch

import numpy as np
from mathutils.geometry import tessellate_polygon

from ... import optics
from ...optics.axial import AxialGlass
from ...optics.tumbler import GLASS
from ..names import RefractiveGlassError
from ..read.glasses import Glass

SECTION = 0.02
"""Longest piece of a curved section, in units of the glass's size."""
SEGMENTS = 512
"""Round the axis: the polygon leaves the circle by 2e-5 of the radius, 0.01 px at 500 px."""


def first_face(glass: Glass, eye) -> tuple[np.ndarray, np.ndarray]:
    """The face of the glass towards the eye.

    Parameters
    ----------
    eye : (3,) in the glass's frame, or an ``optics.ParallelView`` in it.

    Returns
    -------
    vertices : (V, 3) float64 in the glass's frame.
    faces : (F, 3 or 4) int; normals point towards the side that the eye's rays come from.

    Raises
    ------
    RefractiveGlassError
        The eye is inside the glass's wall.
    """
    return _first_face(glass.description, glass, eye)


def faces_eye(vertices: np.ndarray, faces: np.ndarray, eye) -> np.ndarray:
    """(F,) whether the faces show the eye their front: the others are no part of the outline.

    A cylinder's far wall, seen through its open end, is such a one.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    if isinstance(eye, optics.ParallelView):
        return normal @ np.asarray(eye.direction) < 0
    return np.einsum("fk,fk->f", normal, np.asarray(eye) - a) > 0


@singledispatch
def _first_face(description, glass: Glass, eye) -> tuple[np.ndarray, np.ndarray]:
    """What `first_face` returns; a shape registers its own."""
    raise TypeError(f"no outline of a glass of type {type(description).__name__}")


@_first_face.register
def _(description: optics.FlatGlass, glass: Glass, eye):
    parallel = isinstance(eye, optics.ParallelView)
    depth = -sum(description.thickness)
    from_above = eye.direction[2] < 0 if parallel else eye[2] > 0
    if not parallel and depth <= eye[2] <= 0:
        raise _inside(glass)
    outline = description.outline
    height = 0.0 if from_above else depth
    vertices = np.column_stack((outline, np.full(len(outline), height)))
    triangles = np.array(tessellate_polygon([[(*p, 0.0) for p in np.asarray(outline)]]), int)
    a, b, c = (vertices[triangles[:, k], :2] for k in range(3))
    turn = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    upward = turn > 0
    flip = upward != from_above
    triangles[flip] = triangles[flip][:, ::-1]
    return vertices, triangles


@_first_face.register
def _(description: optics.CylinderGlass, glass: Glass, eye):
    radius, inward = _coaxial_face(description, glass, eye)
    if inward and not description.extent[0] < eye[2] < description.extent[1]:
        radius, inward = description.radius[0], False
    vertices, faces = _wall(radius, description.extent)
    return vertices, faces[:, ::-1] if inward else faces


@_first_face.register
def _(description: optics.SphereGlass, glass: Glass, eye):
    radius, inward = _coaxial_face(description, glass, eye)
    vertices, faces = _ball(radius)
    return vertices, faces[:, ::-1] if inward else faces


def _coaxial_face(description, glass: Glass, eye) -> tuple[float, bool]:
    """Radius of the face, and whether it is seen from within."""
    distance, radii = np.inf, description.radius
    if not isinstance(eye, optics.ParallelView):
        distance = float(description.distance_from_axis(np.asarray(eye)))
    if distance >= radii[0]:
        return radii[0], False
    if distance < radii[-1] and len(radii) > 1:
        return radii[-1], True
    raise _inside(glass)


@_first_face.register
def _(description: AxialGlass, glass: Glass, eye):
    """All interfaces of the medium that the eye is in, the far ones too: `faces_eye` tells."""
    medium = 0 if isinstance(eye, optics.ParallelView) else int(description.medium_at(eye))
    if medium == GLASS:
        raise _inside(glass)
    outlines = description.outlines(SECTION * description.scale)
    vertices, faces, count = [], [], 0
    for _, interface in description.around(medium):
        points, _ = outlines.get(interface.name, (np.zeros((0, 2)), None))
        if len(points) < 2:
            continue
        places = points if interface.front == medium else points[::-1]
        here, quads = _grid(SEGMENTS, _section(places), len(places))
        vertices.append(here)
        faces.append(quads + count)
        count += len(here)
    return np.concatenate(vertices), np.concatenate(faces)


def _section(points: np.ndarray):
    """``place(turn, row)`` for a section (K, 2) of radius and height."""

    def place(turn: np.ndarray, row: np.ndarray) -> np.ndarray:
        radius, height = points[np.rint(row * (len(points) - 1)).astype(int)].transpose(2, 0, 1)
        return np.stack((radius * np.cos(turn), radius * np.sin(turn), height), axis=-1)

    return place


def _inside(glass: Glass) -> RefractiveGlassError:
    return RefractiveGlassError(
        f'The camera is inside the wall of glass "{glass.name}": move the camera or the glass'
    )


@lru_cache(maxsize=16)
def _wall(radius: float, extent: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    def place(turn, row):
        z = extent[0] + row * (extent[1] - extent[0])
        return np.stack((radius * np.cos(turn), radius * np.sin(turn), z), axis=-1)

    return _kept(*_grid(SEGMENTS, place, 2))


@lru_cache(maxsize=16)
def _ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    def place(turn, row):
        polar = np.pi * (1.0 - row)
        ring = radius * np.sin(polar)
        height = radius * np.cos(polar)
        return np.stack((ring * np.cos(turn), ring * np.sin(turn), height), axis=-1)

    return _kept(*_grid(SEGMENTS, place, SEGMENTS // 2 + 1))


def _kept(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Arrays that several hold: nobody may write them."""
    for array in arrays:
        array.flags.writeable = False
    return arrays


def _grid(segments: int, place, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A surface of revolution from ``place(turn, row)``; row runs from 0 (foot) to 1 (top)."""
    turn = 2 * np.pi * np.arange(segments) / segments
    row = np.linspace(0.0, 1.0, rows)
    vertices = place(*np.meshgrid(turn, row)).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(segments), np.arange(rows - 1))
    right = (i + 1) % segments
    quads = np.stack(
        (
            j * segments + i,
            j * segments + right,
            (j + 1) * segments + right,
            (j + 1) * segments + i,
        ),
        axis=-1,
    )
    return vertices, quads.reshape(-1, 4)
