# SPDX-License-Identifier: GPL-3.0-or-later
"""The method of Mukai, Makino and Chang (MODSIM 2013), to be measured beside ours.

Vertices are moved so that the unrefracted view of them is the refracted view of the object. For a
slab one equation (5) is solved for the angle of incidence, and (2) moves the vertex along the
slab's normal. For a cylinder one interface is undone at a time, last interface first: with the eye
on the interface before it, the vertex moves by (8) along the normal at the place of refraction.
Where that eye lies is not known: it is taken from the last round, and the rounds are repeated.

The paper names no iteration for (5); Newton's steps from the straight ray are taken here, which
favours it. Like ours it runs in blocks that fit the cache, on two threads.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from glass_refraction import optics
from glass_refraction.optics.solver import in_blocks

Floats = np.ndarray

RELAXATION = 0.7
"""Part of the way that a place of refraction moves in a round; with all of it more points swing."""
ROUNDS = 20
ANGLE_STEPS = 4
"""Newton steps of (5) for a slab: rounding is reached."""
STEEPEST = 0.5 * np.pi * (1.0 - 1e-9)


def slab_places(
    glass: optics.FlatGlass, eye: ArrayLike, points: Floats, steps: int = ANGLE_STEPS
) -> Floats:
    """Where points behind one slab in one medium are moved to (N, 3), by equations (5) and (2).

    Parameters
    ----------
    glass : one layer, the same medium on either side.
    eye : (3,) above the slab. points : (N, 3) below it. Metres.
    steps : Newton steps of (5).
    """
    thickness, ratio = glass.thickness[0], glass.ior_above / glass.ior[0]
    moved = points.copy()

    def work(block: slice) -> None:
        x = np.hypot(points[block, 0] - eye[0], points[block, 1] - eye[1])
        y = eye[2] - points[block, 2]
        theta = np.arctan2(x, y)
        for _ in range(steps):
            sine = ratio * np.sin(theta)
            tangent = np.tan(theta)
            error = (y - thickness) * tangent + thickness * np.tan(np.arcsin(sine)) - x
            slope = (y - thickness) * (1.0 + tangent * tangent)
            slope += thickness * ratio * np.cos(theta) * (1.0 - sine * sine) ** -1.5
            theta = np.clip(theta - error / slope, 0.0, STEEPEST)
        phi = np.arcsin(ratio * np.sin(theta))
        # At normal incidence tan(phi) tan(pi/2 - theta) is 0 times infinity; the ratio is its
        # limit.
        product = np.full(len(theta), ratio)
        steep = theta > 1e-12
        np.multiply(np.tan(phi), np.tan(0.5 * np.pi - theta), out=product, where=steep)
        moved[block, 2] += thickness * (1.0 - product)

    in_blocks(work, len(points))
    return moved


def cylinder_places(
    glass: optics.CylinderGlass,
    eye: ArrayLike,
    points: Floats,
    rounds: int = ROUNDS,
    angle_steps: int = 2,
) -> Floats:
    """Where points behind a cylinder are moved to (N, 3), interface by interface, by equation (8).

    Parameters
    ----------
    glass : all its interfaces are passed, inwards and out again.
    eye : (3,) outside, before the cylinder. points : (N, 3) outside, behind it. Metres.
    rounds : how often all interfaces are undone.
    angle_steps : Newton steps of (5) an interface and round; each starts from the last round's.
    """
    moved = np.empty_like(points)

    def work(block: slice) -> None:
        targets = np.ascontiguousarray(points[block].T)
        moved[block] = (
            _Cylinder(glass, np.asarray(eye, float), targets).moved(rounds, angle_steps).T
        )

    in_blocks(work, len(points))
    return moved


class _Cylinder:
    """Points (3, N) behind a cylinder; every array here is by component."""

    def __init__(self, glass: optics.CylinderGlass, eye: Floats, points: Floats) -> None:
        self.points = points
        self.eye = np.repeat(eye[:, None], points.shape[1], axis=1)
        self.radii = (*glass.radius, *reversed(glass.radius))
        # The media on the eye's and on the object's side of the interfaces passed.
        self.media = (
            glass.ior_outside,
            *glass.ior,
            *reversed(glass.ior[:-1]),
            glass.ior_outside,
        )
        self.entered = len(glass.radius)
        straight = points - self.eye
        self.places = [self._meeting(k, self.eye, straight) for k in range(len(self.radii))]
        self.tangents: list[Floats | None] = [None] * len(self.radii)

    def moved(self, rounds: int, angle_steps: int) -> Floats:
        """Where the points are seen from the eye without any interface (3, N)."""
        shown = [self.points] * (len(self.radii) + 1)
        for _ in range(rounds):
            for number in reversed(range(len(self.radii))):
                shown[number] = self._undone(number, shown[number + 1], angle_steps)
            start = self.eye
            for number, place in enumerate(self.places):
                found = self._meeting(number, start, shown[number] - start)
                place += RELAXATION * (found - place)
                self._onto(number, place)
                start = place
        return shown[0]

    def _undone(self, number: int, points: Floats, steps: int) -> Floats:
        """Points moved along the normal to where the eye before an interface sees them without."""
        eye = self.places[number - 1] if number else self.eye
        place = self.places[number]
        outwards = (-1.0 if number < self.entered else 1.0) / self.radii[number]
        normal_x, normal_y = outwards * place[0], outwards * place[1]
        ratio = self.media[number] / self.media[number + 1]
        from_eye = (place[0] - eye[0]) * normal_x + (place[1] - eye[1]) * normal_y
        depth = (points[0] - place[0]) * normal_x + (points[1] - place[1]) * normal_y
        # The first rounds may put a point on the wrong side of a tangent plane.
        from_eye, depth = np.maximum(from_eye, 1e-12), np.maximum(depth, 1e-12)
        # Across the normal: along the axis, and along the circle.
        along = (points[1] - eye[1]) * normal_x - (points[0] - eye[0]) * normal_y
        x = np.hypot(along, points[2] - eye[2])
        # Equation (5) for one interface, in t = tan(theta), theta on the eye's side:
        # from_eye t + depth k t / sqrt(1 + (1 - k^2) t^2) = x.
        bend = 1.0 - ratio * ratio
        most = np.inf if bend >= 0.0 else (1.0 - 1e-9) / np.sqrt(-bend)  # the critical angle
        tangent = self.tangents[number]
        if tangent is None:
            tangent = np.minimum(x / (from_eye + depth), most)
        for _ in range(steps):
            inverse = 1.0 / np.sqrt(1.0 + bend * tangent * tangent)
            error = (from_eye + depth * ratio * inverse) * tangent - x
            slope = from_eye + depth * ratio * inverse**3
            tangent = np.clip(tangent - error / slope, 0.0, most)
        self.tangents[number] = tangent
        # Equation (8): L' = L (n_eye cos theta) / (n_object cos phi).
        change = depth * (ratio / np.sqrt(1.0 + bend * tangent * tangent) - 1.0)
        return np.stack((points[0] + change * normal_x, points[1] + change * normal_y, points[2]))

    def _meeting(self, number: int, start: Floats, towards: Floats) -> Floats:
        """Where lines meet an interface, on their way in or out; where they miss it, nearest."""
        radius = self.radii[number]
        square = np.maximum(towards[0] ** 2 + towards[1] ** 2, 1e-300)
        half = start[0] * towards[0] + start[1] * towards[1]
        outside = start[0] ** 2 + start[1] ** 2 - radius * radius
        root = np.sqrt(np.maximum(half * half - square * outside, 0.0))
        way = (-half - root if number < self.entered else -half + root) / square
        place = start + way * towards
        self._onto(number, place)
        return place

    def _onto(self, number: int, place: Floats) -> None:
        """Move places onto their interface, in place."""
        distance = np.maximum(np.hypot(place[0], place[1]), 1e-300)
        place[:2] *= self.radii[number] / distance
