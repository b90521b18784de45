# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle meshes, and a caster that tries every triangle: it decides what a mesh glass meets."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Mesh:
    """Vertices (V, 3), triangles (F, 3) seen anticlockwise from outside, normals at their corners.

    `corners`: (F, 3, 3), or None for flat faces.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    corners: np.ndarray | None = None

    def placed(self, pose):
        turn = pose[:3, :3]
        corners = None if self.corners is None else self.corners @ turn.T
        return Mesh(self.vertices @ turn.T + pose[:3, 3], self.triangles, corners)

    @property
    def box(self):
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])


class Caster:
    """`meet` of some meshes, (number of the glass, mesh) each; counts its calls and rays.

    `apart`: a row of answers for each mesh, so that meshes may touch.
    """

    def __init__(self, meshes, apart=False):
        self.meshes, self.apart = meshes, apart
        self.calls, self.rays = 0, 0

    def __call__(self, origin, direction):
        self.calls += 1
        self.rays += len(origin)
        rows = [self._meet(number, mesh, origin, direction) for number, mesh in self.meshes]
        glass, way, flat, smooth = (np.stack(parts) for parts in zip(*rows, strict=True))
        if self.apart:
            return glass, way, flat, smooth
        first, rays = np.argmin(way, axis=0), np.arange(len(origin))
        return tuple(part[first, rays] for part in (glass, way, flat, smooth))

    @staticmethod
    def _meet(number, mesh, origin, direction):
        """Möller and Trumbore, every ray with every triangle."""
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        one, two = b - a, c - a
        normals = np.cross(one, two)
        count = len(origin)
        way, face = np.full(count, np.inf), np.zeros(count, dtype=int)
        share = np.zeros((count, 2))
        size = max(1, 400_000 // len(a))
        for first in range(0, count, size):
            some = slice(first, first + size)
            o, d = origin[some, None], direction[some, None]
            across = np.cross(d, two)
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = 1.0 / np.sum(across * one, axis=-1)
                off = o - a
                u = np.sum(off * across, axis=-1) * inverse
                turned = np.cross(off, one)
                v = np.sum(d * turned, axis=-1) * inverse
                t = np.sum(two * turned, axis=-1) * inverse
                hit = (u >= -1e-12) & (v >= -1e-12) & (u + v <= 1.0 + 1e-12) & (t > 0.0)
            t = np.where(hit, t, np.inf)
            best = np.argmin(t, axis=1)
            rows = np.arange(len(best))
            way[some], face[some] = t[rows, best], best
            share[some] = np.stack([u[rows, best], v[rows, best]], axis=-1)
        share[~np.isfinite(way)] = 0.0
        flat = normals[face]
        smooth = flat
        if mesh.corners is not None:
            weights = np.column_stack([1.0 - share.sum(axis=1), share])
            smooth = np.sum(weights[:, :, None] * mesh.corners[face], axis=1)
        return np.full(count, number), way, flat, smooth


def box(low, high):
    """A box with flat faces."""
    x, y, z = zip(low, high, strict=True)
    corners = np.array([(i, j, k) for k in z for j in y for i in x], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [(q[0], q[k], q[k + 1]) for q in quads for k in (1, 2)]
    return Mesh(corners, np.array(triangles))


def rod(radius, low, high, around, smooth=True):
    """A cylinder of flat strips, with normals of the round wall if smooth."""
    angle = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    vertices = np.concatenate(
        [
            np.column_stack([ring, np.full(around, low)]),
            np.column_stack([ring, np.full(around, high)]),
            [(0.0, 0.0, low), (0.0, 0.0, high)],
        ]
    )
    k = np.arange(around)
    n = (k + 1) % around
    parts = [
        np.column_stack([k, n, n + around]),
        np.column_stack([k, n + around, k + around]),
        np.column_stack([n, k, np.full(around, 2 * around)]),
        np.column_stack([k + around, n + around, np.full(around, 2 * around + 1)]),
    ]
    triangles = np.concatenate(parts)
    if not smooth:
        return Mesh(vertices, triangles)
    corners = np.zeros((len(triangles), 3, 3))
    corners[: 2 * around, :, :2] = vertices[triangles[: 2 * around], :2] / radius
    corners[2 * around : 3 * around, :, 2] = -1.0
    corners[3 * around :, :, 2] = 1.0
    return Mesh(vertices, triangles, corners)


def ball(radius, rows, smooth=True):
    """A sphere of twice as many columns as rows."""
    columns = 2 * rows
    angle, height = 2.0 * np.pi * np.arange(columns) / columns, np.pi * np.arange(1, rows) / rows
    ring = np.stack(
        [
            np.outer(np.sin(height), np.cos(angle)),
            np.outer(np.sin(height), np.sin(angle)),
            np.outer(np.cos(height), np.ones(columns)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate([ring, [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]])
    top, bottom = len(ring), len(ring) + 1
    k = np.arange(columns)
    n = (k + 1) % columns
    parts = [np.column_stack([np.full(columns, top), k, n])]
    for row in range(rows - 2):
        a, b = row * columns, (row + 1) * columns
        parts += [np.column_stack([a + k, b + k, b + n]), np.column_stack([a + k, b + n, a + n])]
    last = (rows - 2) * columns
    parts.append(np.column_stack([last + k, np.full(columns, bottom), last + n]))
    triangles = np.concatenate(parts)
    corners = vertices[triangles] if smooth else None
    return Mesh(radius * vertices, triangles, corners)


def diamond(size):
    """A brilliant of this diameter: table, eight stars, crown, girdle of sixteen, pavilion.

    It is what planes enclose; the crown rises by 34.5, the pavilion falls by 40.75 degrees, the
    facets between those by a little more, as is usual.
    """
    table, girdle, thin = 0.162, 0.5, 0.01
    planes = [(0.0, 0.0, 1.0, table)]
    for number in range(16):
        turn, main = np.pi * number / 8.0, number % 2 == 0
        facets = [(0.5 * np.pi, 1.0, girdle)]
        for degrees, side in ((34.5 if main else 42.0, 1.0), (40.75 if main else 42.0, -1.0)):
            tilt = np.radians(degrees)
            facets.append((tilt, side, girdle * np.sin(tilt) + thin * np.cos(tilt)))
        if main:
            # A star, through the edge of the table.
            tilt = np.radians(20.0)
            facets.append((tilt, 1.0, 0.26 * np.sin(tilt) + table * np.cos(tilt)))
        for tilt, side, away in facets:
            across, up = np.sin(tilt), side * np.cos(tilt)
            planes.append((across * np.cos(turn), across * np.sin(turn), up, away))
    return hull(np.array(planes) * (1.0, 1.0, 1.0, size))


def hull(planes):
    """The convex body of half spaces n·x <= d, rows (n, d): its faces as triangles."""
    normals, offs = planes[:, :3], planes[:, 3]
    triples = np.array([(i, j, k) for i in range(len(planes)) for j in range(i) for k in range(j)])
    matrices = normals[triples]
    good = np.abs(np.linalg.det(matrices)) > 1e-9
    points = np.linalg.solve(matrices[good], offs[triples[good]][..., None])[..., 0]
    size = np.abs(offs).max()
    points = points[(points @ normals.T <= offs + 1e-9 * size).all(axis=1)]
    _, first = np.unique(np.round(points / size, 9), axis=0, return_index=True)
    points = points[first]
    triangles = []
    for normal, off in zip(normals, offs, strict=True):
        on = np.flatnonzero(np.abs(points @ normal - off) < 1e-8 * size)
        if len(on) < 3:
            continue
        middle = points[on].mean(axis=0)
        one = points[on[0]] - middle
        other = np.cross(normal, one)
        order = np.argsort(np.arctan2((points[on] - middle) @ other, (points[on] - middle) @ one))
        on = on[order]
        triangles += [(on[0], on[k], on[k + 1]) for k in range(1, len(on) - 1)]
    return Mesh(points, np.array(triangles))
