# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass as meshes that a renderer can refract in: every interface once, with exact normals.

A glass is a set of surfaces, one an interface between two media. No surface lies on another, so a
renderer needs no rule for overlapping bodies: it refracts by the ratio of the two media that each
surface names. The first interface points out of the glass; each further one points away from the
layer that a ray has just passed, as an inner wall points into the cavity. Surfaces that meet share
the coordinates of their border bit by bit: nothing leaks between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import bpy
import numpy as np

from ...optics import CylinderGlass, FlatGlass, SphereGlass
from ...optics.axial import AxialGlass
from ...optics.bodies import Tube
from ...optics.surfaces import Cylinder, Plane, anticlockwise
from ..read.mesh_glasses import MeshGlass

# Facets round a full circle. A chord misses its arc by r * (pi / segments)**2 / 2: 1.2e-6 r for the
# cylinder, 1.9e-5 r for the sphere, whose number of faces grows with the square.
CYLINDER_SEGMENTS = 2048
SPHERE_SEGMENTS = 512
PROFILE_SEGMENTS = 768
# Length to width of a wall's facets: long slivers cost a renderer digits and time.
FACET_ASPECT = 32
MAX_BANDS = 64


@dataclass(frozen=True, eq=False)
class Surface:
    """One interface between two media, in the frame of its glass (metres).

    Attributes
    ----------
    name : what it is of the glass, e.g. ``"wall 0"`` or ``"upper rim 0"``.
    vertices : (V, 3) positions.
    corners : (C,) vertex of each face corner, face after face, anticlockwise seen from the side
        that the normals point to.
    sizes : (F,) number of corners of each face; a face may be a concave polygon.
    normals : (C, 3) unit, the true surface's normal at each corner.
    ior_inside, ior_outside : the media behind the surface and on the side of its normals.
    media : numbers of the media on the side of its normals and behind it, in the description of
        the one glass that it is of.
    finish : (C, 7) what a painted surface is like at each corner, see `Paint.at`; None: it is not.
    """

    name: str
    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    normals: np.ndarray
    ior_inside: float
    ior_outside: float
    media: tuple[int, int] | None = None
    finish: np.ndarray | None = None

    def moved(self, matrix: np.ndarray) -> Surface:
        """The same interface moved by a matrix (4, 4) that has an inverse."""
        linear = matrix[:3, :3]
        normals = self.normals @ np.linalg.inv(linear)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # A mirror image would be inside out.
        turn = slice(None, None, -1 if np.linalg.det(linear) < 0.0 else 1)
        return replace(
            self,
            vertices=self.vertices @ linear.T + matrix[:3, 3],
            corners=self.corners[turn],
            sizes=self.sizes[turn],
            normals=normals[turn],
            finish=None if self.finish is None else self.finish[turn],
        )

    def flipped(self) -> Surface:
        """The same interface, its normals on the other side."""
        return replace(
            self,
            corners=self.corners[::-1],
            sizes=self.sizes[::-1],
            normals=-self.normals[::-1],
            ior_inside=self.ior_outside,
            ior_outside=self.ior_inside,
            media=self.media and self.media[::-1],
            finish=None if self.finish is None else self.finish[::-1],
        )


def glass_surfaces(
    glass: FlatGlass | CylinderGlass | SphereGlass | AxialGlass | MeshGlass,
    *,
    segments: int | None = None,
    reach: float = 100.0,
) -> tuple[Surface, ...]:
    """All interfaces of a glass as finely tessellated surfaces.

    Parameters
    ----------
    glass : its optics description; a mesh has its own triangles.
    segments : facets round a full circle (a sphere: rounded up to a multiple of 4); by default
        ``CYLINDER_SEGMENTS`` or ``SPHERE_SEGMENTS``.
    reach : metres; an unbounded glass is cut off this far from its origin, without rims or sides.

    Notes
    -----
    A liquid fills its cylinder to the rims. The sides of a slab, and a cylinder's rims, stand in
    ``ior_above`` or ``ior_outside``. Rims between equal media are left out; walls are kept, so
    that a glass of the air's own ior still is a mesh.

    Raises
    ------
    ValueError
        ``segments`` below 4, ``reach`` not positive.
    TypeError
        ``glass`` is none of these.
    """
    if segments is not None and segments < 4:
        raise ValueError(f"segments must be at least 4, not {segments}")
    if not reach > 0:
        raise ValueError(f"reach must be positive, not {reach:g}")
    return _surfaces(glass, segments, reach)


@singledispatch
def _surfaces(glass, segments: int | None, reach: float) -> tuple[Surface, ...]:
    """What `glass_surfaces` returns; a shape registers its own."""
    raise TypeError(f"no mesh for a glass of type {type(glass).__name__}")


@_surfaces.register
def _(glass: MeshGlass, _segments: int | None, _reach: float) -> tuple[Surface, ...]:
    count, finish = len(glass.points), None
    if glass.paint is not None:
        finish = glass.paint.at(np.repeat(np.arange(count), 3), np.tile(np.eye(3), (count, 1)))
    surface = Surface(
        name="mesh",
        vertices=glass.points.reshape(-1, 3),
        corners=np.arange(3 * count),
        sizes=np.full(count, 3),
        normals=glass.normals.reshape(-1, 3),
        ior_inside=glass.ior,
        ior_outside=1.0,
        media=(0, 1),
        finish=finish,
    )
    return (surface,)


FILM = 2e-5
"""Part by which real glass is smaller: where it touches a thing there is a film of air."""


def film(points: np.ndarray) -> np.ndarray:
    """(4, 4): shrinks a mesh's points (N, 3) towards the middle of their box, by `FILM`.

    A path tracer meets either of two faces in one place; True shading has a film of air there.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)).astype(float)
    matrix = np.diag((1.0 - FILM,) * 3 + (1.0,))
    matrix[:3, 3] = FILM * middle
    return matrix


def fill_mesh(mesh: bpy.types.Mesh, surfaces: Sequence[Surface]) -> None:
    """Put all surfaces into one mesh, smooth, with their own normals at every face corner."""
    vertices = np.concatenate([s.vertices for s in surfaces])
    first = np.cumsum([0, *(len(s.vertices) for s in surfaces[:-1])])
    corners = np.concatenate(
        [s.corners + offset for s, offset in zip(surfaces, first, strict=True)]
    )
    sizes = np.concatenate([s.sizes for s in surfaces])
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
    mesh.polygons.add(len(sizes))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(sizes) - sizes).astype(np.int32))
    mesh.update(calc_edges=True)
    normals = np.concatenate([s.normals for s in surfaces])
    attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())


@_surfaces.register
def _(glass: FlatGlass, _segments: int | None, reach: float) -> tuple[Surface, ...]:
    """Interfaces from the top down, then the sides of each layer."""
    if glass.outline is None:
        outline = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * float(reach)
    else:
        outline = anticlockwise(np.asarray(glass.outline, float))
    heights = glass.heights
    surfaces = []
    for i, height in enumerate(heights):
        face = _polygon(f"interface {i}", outline, height, glass.media, (i, i + 1))
        surfaces.append(face if i == 0 else face.flipped())
    if glass.outline is not None:
        for i, ior in enumerate(glass.ior):
            if ior != glass.ior_above:
                layer = heights[i : i + 2]
                surfaces.append(_sides(f"sides {i}", outline, layer, glass.media, (0, i + 1)))
    return tuple(surfaces)


@_surfaces.register
def _(glass: CylinderGlass, segments: int | None, reach: float) -> tuple[Surface, ...]:
    """Those of its body, turned to the surroundings; without ends it has no rims."""
    tube = Tube(glass if glass.extent is not None else replace(glass, extent=(-reach, reach)))
    core, found = f"wall {len(glass.ior) - 1}", []
    for surface in _surfaces(tube, segments, reach):
        if surface.name == core:
            # The body takes an open core for the surroundings, be it coloured.
            surface = replace(surface, media=(surface.media[0], len(glass.ior)))
        if glass.extent is not None or surface.name.startswith("wall"):
            found.append(surface.flipped() if surface.media[0] else surface)
    return tuple(found)


@_surfaces.register
def _(glass: SphereGlass, segments: int | None, _reach: float) -> tuple[Surface, ...]:
    """Shells from the outside in."""
    directions, corners = _cube_sphere(-(-(segments or SPHERE_SEGMENTS) // 4))
    surfaces = []
    for i, radius in enumerate(glass.radius):
        shell = Surface(
            name=f"shell {i}",
            vertices=radius * directions,
            corners=corners.ravel(),
            sizes=np.full(len(corners), 4),
            normals=directions[corners.ravel()],
            ior_inside=glass.media[i + 1],
            ior_outside=glass.media[i],
            media=(i, i + 1),
        )
        surfaces.append(shell if i == 0 else shell.flipped())
    return tuple(surfaces)


@_surfaces.register
def _(glass: AxialGlass, segments: int | None, _reach: float) -> tuple[Surface, ...]:
    """Every interface once, by its name: lathed sections that share their ends."""
    straight = all(isinstance(part.surface, (Cylinder, Plane)) for part in glass.interfaces)
    segments = segments or (CYLINDER_SEGMENTS if straight else PROFILE_SEGMENTS)
    circle = _unit_circle(segments)
    facet = 2 * np.pi * glass.scale / segments
    _, low, high = glass.hull
    longest = max(FACET_ASPECT * facet, (high - low) * glass.scale / MAX_BANDS)
    outlines = glass.outlines(longest if straight else facet)
    surfaces = []
    for interface in glass.interfaces:
        if interface.name in outlines:
            media = (interface.front, interface.back)
            surfaces.append(
                _lathed(interface.name, circle, *outlines[interface.name], glass.media, media)
            )
    return tuple(surfaces)


def _lathed(
    name: str,
    circle: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    iors: tuple[float, ...],
    media: tuple[int, int],
) -> Surface:
    """A section (K, 2) of radius and height turned about the axis; normals (K, 2) likewise."""
    count = len(circle)
    around = [1 if radius == 0.0 else count for radius in points[:, 0]]
    first = np.cumsum([0, *around])
    vertices = np.concatenate(
        [
            np.column_stack((r * circle[:n], np.full(n, z)))
            for (r, z), n in zip(points, around, strict=True)
        ]
    )
    here = np.arange(count)
    onward = np.roll(here, -1)
    corners, sizes, of_row, turn = [], [], [], []
    for row in range(len(points) - 1):
        low, high = first[row], first[row + 1]
        if around[row] == 1 and around[row + 1] == 1:
            raise ValueError(f"{name} must not run along the axis")
        if around[row] == 1:
            ring, rows = (here * 0 + low, onward + high, here + high), (row, row + 1, row + 1)
            turns = (here, onward, here)
        elif around[row + 1] == 1:
            ring, rows = (here + low, onward + low, here * 0 + high), (row, row, row + 1)
            turns = (here, onward, here)
        else:
            ring = (here + low, onward + low, onward + high, here + high)
            rows, turns = (row, row, row + 1, row + 1), (here, onward, onward, here)
        corners.append(np.column_stack(ring).ravel())
        sizes.append(np.full(count, len(ring)))
        of_row.append(np.tile(rows, count))
        turn.append(np.column_stack(turns).ravel())
    of_row, turn = np.concatenate(of_row), np.concatenate(turn)
    flat = normals[of_row]
    return Surface(
        name=name,
        vertices=vertices,
        corners=np.concatenate(corners),
        sizes=np.concatenate(sizes),
        normals=np.column_stack((flat[:, :1] * circle[turn], flat[:, 1])),
        ior_inside=iors[media[1]],
        ior_outside=iors[media[0]],
        media=media,
    )


def _polygon(
    name: str,
    outline: np.ndarray,
    height: float,
    iors: tuple[float, ...],
    media: tuple[int, int],
) -> Surface:
    """The polygon (K, 2) at z = height as one face that looks up; of its media first that above."""
    count = len(outline)
    return Surface(
        name=name,
        vertices=np.column_stack((outline, np.full(count, height))),
        corners=np.arange(count),
        sizes=np.array([count]),
        normals=np.tile((0.0, 0.0, 1.0), (count, 1)),
        ior_inside=iors[media[1]],
        ior_outside=iors[media[0]],
        media=media,
    )


def _sides(
    name: str,
    outline: np.ndarray,
    heights: np.ndarray,
    iors: tuple[float, ...],
    media: tuple[int, int],
) -> Surface:
    """The side faces under the polygon (K, 2) between two heights, upper first; flat, outward."""
    count = len(outline)
    along = np.roll(outline, -1, axis=0) - outline
    outward = np.column_stack((along[:, 1], -along[:, 0], np.zeros(count)))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    vertices = np.concatenate(
        [np.column_stack((outline, np.full(count, height))) for height in heights[::-1]]
    )
    # Cycles knows one normal a vertex: faces at an angle must not share any.
    return Surface(
        name=name,
        vertices=vertices[_band(count).ravel()],
        corners=np.arange(4 * count),
        sizes=np.full(count, 4),
        normals=np.repeat(outward, 4, axis=0),
        ior_inside=iors[media[1]],
        ior_outside=iors[media[0]],
        media=media,
    )


def _unit_circle(count: int) -> np.ndarray:
    """Points (count, 2) round the unit circle, anticlockwise."""
    angle = np.arange(count) * (2 * np.pi / count)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def _band(count: int) -> np.ndarray:
    """Quads (count, 4) between the closed rows 0 .. count - 1 and count .. 2 count - 1."""
    here = np.arange(count)
    onward = np.roll(here, -1)
    return np.column_stack((here, onward, onward + count, here + count))


def _cube_sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (V, 3) and outward quads (F, 4): a cube's faces of count x count, blown up.

    The quads are of nearly equal angles, unlike those between meridians, and none degenerates.
    """
    step = np.arange(-count, count + 1, 2)
    u, v = (grid.ravel() for grid in np.meshgrid(step, step, indexing="ij"))
    lattice = np.concatenate(
        [
            np.roll(np.column_stack((u, v, np.full(u.size, side * count))), axis, axis=1)
            for side in (-1, 1)
            for axis in range(3)
        ]
    )
    here = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    quad = np.column_stack((here, here + count + 1, here + count + 2, here + 1))
    face = (count + 1) ** 2
    quads = np.concatenate([quad[:, ::-1] + i * face for i in range(3)])
    quads = np.concatenate((quads, *(quad + i * face for i in range(3, 6))))
    # The faces share their lattice points on edges: whole numbers, so equal ones are found exactly.
    points, index = np.unique(lattice, axis=0, return_inverse=True)
    directions = np.tan(points * (np.pi / (4 * count)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, index.ravel()[quads]
