# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and point clouds as triangles: engines draw them round, from a radius a point.

The shapes are coarse, and seen from all sides together as large as what is drawn.
"""

from __future__ import annotations

import bmesh
import bpy
import numpy as np

from .arrays import read_attribute, unit

SIDES = 3
"""Of a strand's cross-section."""
RADIUS = 0.01
"""Metres, of strands that tell none."""
FINE_BALLS = 10_000
"""Points up to so many are balls of 80 triangles, more have 20 each."""

MOST_TRIANGLES = 2_000_000
"""Of a scene's hair and points: more are not met."""

LEAST_POWER = 1e-3
"""Keeps a quotient finite."""

Shape = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Points (V, 3), triangles (T, 3), and their material slots (T,)."""


def strands(curves: bpy.types.Curves) -> Shape:
    """Each curve as a prism from point to point."""
    place = _values(curves, "position", np.zeros((len(curves.points), 3)))
    radius = _values(curves, "radius", np.full((len(place), 1), RADIUS))
    slots = _values(curves, "material_index", np.zeros((len(curves.curves), 1), int))[:, 0]
    starts = np.empty(len(curves.curves) + 1, np.int32)
    curves.curve_offset_data.foreach_get("value", starts)
    return _prisms(place, radius, np.repeat(np.arange(len(slots)), np.diff(starts)), slots)


def fur(obj: bpy.types.Object, system: bpy.types.ParticleSystem, mode: str) -> Shape | None:
    """The hair of an evaluated object's particles, as a depsgraph's mode has it; None: too much."""
    settings = system.settings
    steps = 2 ** (settings.render_step if mode == "RENDER" else settings.display_step)
    steps += settings.kink_extra_steps if settings.kink == "SPIRAL" else 0
    parents, children = len(system.particles), len(system.child_particles)
    # Children are drawn in place of their parents.
    first = parents if children else 0
    count = parents + children - first
    if 2 * SIDES * count * steps > MOST_TRIANGLES:
        return None
    numbers = range(first, first + count)
    place = [
        system.co_hair(object=obj, particle_no=k, step=s) for k in numbers for s in range(steps + 1)
    ]
    place = np.array(place).reshape(-1, 3)
    to_local = np.array(obj.matrix_world.inverted_safe())
    place = place @ to_local[:3, :3].T + to_local[:3, 3]
    shape, left = settings.shape, np.linspace(1.0, 0.0, steps + 1)
    left = left ** (1.0 + shape if shape < 0.0 else 1.0 / max(1.0 - shape, LEAST_POWER))
    root, tip = (
        0.5 * settings.radius_scale * r for r in (settings.root_radius, settings.tip_radius)
    )
    radius = np.tile(tip + (root - tip) * left, count)[:, None]
    curve = np.repeat(np.arange(count), steps + 1)
    return _prisms(place, radius, curve, np.full(count, settings.material - 1))


def _prisms(place: np.ndarray, radius: np.ndarray, curve: np.ndarray, slots: np.ndarray) -> Shape:
    """Those of curves: points (N, 3), radii (N, 1) and the curve (N,) of each, and their slots."""
    begin = np.flatnonzero(curve[1:] == curve[:-1])
    if not len(begin):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int32)
    along = np.zeros_like(place)
    step = place[begin + 1] - place[begin]
    along[begin] += step
    along[begin + 1] += step
    along = unit(along)
    # Across a curve, as far as it is flat: there it turns round its own direction the least.
    spread = np.zeros((len(slots), 3, 3))
    np.add.at(spread, curve, along[:, :, None] * along[:, None, :])
    up = np.linalg.eigh(spread)[1][curve, :, 0]
    right = unit(np.cross(along, up))
    up = np.cross(right, along)
    # A convex outline is as wide, on average, as its length over π.
    wide = radius * np.pi / (SIDES * np.sin(np.pi / SIDES))
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    points = place[:, None] + wide[:, None] * ring
    side = np.arange(SIDES)
    a, b = side, (side + 1) % SIDES
    quads = np.concatenate(
        (np.stack((a, b, b + SIDES), axis=1), np.stack((a, b + SIDES, a + SIDES), axis=1))
    )
    triangles = (SIDES * begin[:, None, None] + quads).reshape(-1, 3)
    return points.reshape(-1, 3), triangles, np.repeat(slots[curve[begin]], len(quads))


def balls(cloud: bpy.types.PointCloud) -> Shape:
    """Each point as a ball."""
    place = _values(cloud, "position", np.zeros((len(cloud.points), 3)))
    radius = _values(cloud, "radius", np.full((len(place), 1), RADIUS))
    slots = _values(cloud, "material_index", np.zeros((len(place), 1), int))[:, 0]
    ball, faces = _ball(2 if len(place) <= FINE_BALLS else 1)
    points = place[:, None] + radius[:, None] * ball
    triangles = (len(ball) * np.arange(len(place))[:, None, None] + faces).reshape(-1, 3)
    return points.reshape(-1, 3), triangles, np.repeat(slots, len(faces))


def _ball(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles that are seen from all sides together as large as a ball of radius 1."""
    mesh = bmesh.new()
    bmesh.ops.create_icosphere(mesh, subdivisions=subdivisions, radius=1.0)
    points = np.array([vertex.co for vertex in mesh.verts])
    faces = np.array([[vertex.index for vertex in face.verts] for face in mesh.faces])
    mesh.free()
    a, b, c = (points[faces[:, k]] for k in range(3))
    # A convex body shows, on average, a quarter of its surface.
    surface = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return points * np.sqrt(4.0 * np.pi / surface), faces


def _values(data: bpy.types.Curves | bpy.types.PointCloud, name: str, default: np.ndarray):
    """An attribute (N, k); where it is missing, what it is then."""
    attribute = data.attributes.get(name)
    if attribute is None or len(attribute.data) != len(default):
        return default
    return read_attribute(attribute).astype(default.dtype)
