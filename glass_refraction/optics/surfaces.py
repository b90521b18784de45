# SPDX-License-Identifier: GPL-3.0-or-later
"""Interfaces that are symmetric round the z axis, and what a ray does at them.

Rays are followed by their optical momentum p = n·d: a cylinder keeps p_z, a plane across the axis
keeps p_x and p_y, and every one of them keeps |p| = n of the medium. So a refraction costs one
square root. Along with a ray its *slopes* can be carried, the derivatives of place and momentum by
the two unknowns of the ray at the eye (ray differentials: H. Igehy, Tracing Ray Differentials,
1999); that gives Newton's method its Jacobian and tells where caustics lie.

Every interface has a *front* and a *back*: outside and inside of a cylinder, above and below a
plane. A ray comes from the side of the medium it runs in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .outlines import Outline

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SKIN = 1e-12
"""How far behind its start, in outer radii, a ray may still meet an interface (rounding)."""

HORIZON = 1e9
"""Way in outer radii beyond which a plane is not met."""

RUN = 8
"""Faces of an outline side by side that a ray meets only if it comes into a circle round them."""

GRAZING = 1e-7
"""Angle in radians, seen from the axis, that a patch keeps from grazing incidence."""

LEAST = 1e-150
"""Stands for a divisor of 0; what it divides is no ray's and is thrown away."""


@dataclass
class Rays:
    """Rays by components: place (x, y, z), momentum (px, py, pz), each (M,) or a number.

    `slopes`: derivatives of the six by each unknown, as tuples; empty where none are wanted.
    """

    place: tuple
    momentum: tuple
    slopes: tuple = ()

    def at(self, way) -> tuple:
        """Places after a way t along the momentum (geometric length t·n)."""
        return tuple(o + way * p for o, p in zip(self.place, self.momentum, strict=True))

    def take(self, which) -> Rays:
        """Some of the rays, without slopes."""
        return Rays(
            tuple(part[which] for part in self.place),
            tuple(part[which] for part in self.momentum),
        )


@dataclass(frozen=True)
class Cylinder:
    """A wall: radius, and its ends in z (`low` excluded where `open_below`)."""

    radius: float
    low: float
    high: float
    open_below: bool = False

    def meet(self, rays: Rays, back: bool) -> tuple[Floats, Flags]:
        """The way to the interface, whatever its ends (0 where it is not ahead), and whether it is
        ahead."""
        x, y, _ = rays.place
        px, py, _ = rays.momentum
        p2 = np.maximum(px * px + py * py, LEAST)
        ell = x * py - y * px
        square = p2 * self.radius**2 - ell * ell
        size = np.sqrt(x * x + y * y)
        return _meet_round(self.radius, size, x * px + y * py, p2, square, back)

    def within(self, x, y, z) -> Flags:
        """Which places on the cylinder lie between its ends."""
        return ((z > self.low) if self.open_below else (z >= self.low)) & (z <= self.high)

    def normal(self, x, y, z) -> tuple:
        """Unit normal towards the front."""
        per = 1.0 / self.radius
        return x * per, y * per, np.zeros_like(x)

    def pass_by(self, rays: Rays, way, gain: float | None, mark=None) -> tuple[Rays, Flags]:
        """Rays behind the interface: `gain` = n'² − n² where refracted, None where reflected.

        Also which of them are not totally reflected; the others run along the interface. `mark`:
        what the surface itself knows of the meetings, see `Profile`.
        """
        px, py, pz = rays.momentum
        x, y, z = rays.at(way)
        before = x * px + y * py
        per = 1.0 / self.radius**2
        after, turned, possible = behind(before, gain, self.radius**2)
        change = (after - before) * per
        inverse = 1.0 / np.where(before == 0.0, LEAST, before)
        slopes = []
        for dx, dy, dz, dpx, dpy, dpz in rays.slopes:
            dx = dx + way * dpx
            dy = dy + way * dpy
            dz = dz + way * dpz
            more = -(x * dx + y * dy) * inverse
            dx = dx + more * px
            dy = dy + more * py
            dz = dz + more * pz
            rise = dx * px + dy * py
            rise += x * dpx
            rise += y * dpy
            rise *= (turned - 1.0) * per
            slopes.append(
                (dx, dy, dz, dpx + rise * x + change * dx, dpy + rise * y + change * dy, dpz)
            )
        return Rays((x, y, z), (px + change * x, py + change * y, pz), tuple(slopes)), possible

    def outline(self, longest: float) -> tuple[Floats, Floats]:
        """Points (K, 2) of radius and height along the section, the front on the right, and the
        unit normals (K, 2) towards the front; no two points further apart than `longest`."""
        count = max(1, math.ceil((self.high - self.low) / longest)) + 1
        heights = np.linspace(self.low, self.high, count)
        points = np.column_stack((np.full(count, self.radius), heights))
        return points, np.tile((1.0, 0.0), (count, 1))

    def coordinates(self, x, y, z) -> tuple:
        """The coordinates of places in a patch: azimuth and height."""
        return np.arctan2(y, x), z

    def sample(self, start: Viewpoint, back: bool) -> Patch | None:
        """The part that rays of a viewpoint can meet, as a rectangle (azimuth, height)."""
        if start.parallel:
            px, py, _ = start.direction
            if np.hypot(px, py) < 1e-12:
                return None
            middle, half = np.arctan2(-py, -px), 0.5 * np.pi
        else:
            x, y, _ = start.eye
            away = float(np.hypot(x, y))
            middle = np.arctan2(y, x) if away > 0.0 else 0.0
            if away <= self.radius:
                if not back:
                    return None
                half = 0.0
            else:
                half = np.arccos(self.radius / away)
        if half:
            # Rays at exactly grazing incidence are neither here nor there.
            half += GRAZING if back else -GRAZING
        low, high = middle - half, middle + half
        if back:
            low, high = high, low + 2.0 * np.pi
        return Patch(self, (low, self.low), (high, self.high))

    def place(self, azimuth, height) -> tuple:
        """Places of a patch's coordinates."""
        return self.radius * np.cos(azimuth), self.radius * np.sin(azimuth), height

    def middle_line(self, patch: Patch, along, count: int) -> Floats:
        """Shares of a patch at the azimuths of `along` and against it."""
        return azimuth_lines(patch, along, count)

    def tangents(self, x, y, z) -> tuple[tuple, tuple]:
        """Two unit vectors along the surface, their cross product towards the front."""
        per, none = 1.0 / self.radius, np.zeros_like(x)
        return (-y * per, x * per, none), (none, none, none + 1.0)

    def slide(self, place: tuple, first, second) -> tuple:
        """Places moved along the surface by lengths along both tangents."""
        x, y, z = place
        angle = first * (1.0 / self.radius)
        cosine, sine = np.cos(angle), np.sin(angle)
        return self.onto((x * cosine - y * sine, y * cosine + x * sine, z + second))

    def onto(self, place: tuple) -> tuple:
        """Places near the surface moved onto it."""
        x, y, z = place
        factor = self.radius / np.sqrt(np.maximum(x * x + y * y, LEAST))
        return x * factor, y * factor, z


@dataclass(frozen=True)
class Plane:
    """A plane across the axis: its height, and the ring of radii that belongs to it."""

    height: float
    inner: float
    outer: float

    def meet(self, rays: Rays, back: bool) -> tuple[Floats, Flags]:
        pz = rays.momentum[2]
        towards = pz > 0.0 if back else pz < 0.0
        way = (self.height - rays.place[2]) / np.where(towards, pz, 1.0)
        ahead = towards & (way >= -SKIN) & (way < HORIZON)
        return np.where(ahead, way, 0.0), ahead

    def within(self, x, y, z) -> Flags:
        radius2 = x * x + y * y
        inside = radius2 <= self.outer**2
        return inside & (radius2 >= self.inner**2) if self.inner else inside

    def normal(self, x, y, z) -> tuple:
        none = np.zeros_like(x)
        return none, none, none + 1.0

    def pass_by(self, rays: Rays, way, gain: float | None, mark=None) -> tuple[Rays, Flags]:
        px, py, pz = rays.momentum
        x, y, _ = rays.at(way)
        after, turned, possible = behind(pz, gain, 1.0)
        inverse = 1.0 / np.where(pz == 0.0, LEAST, pz)
        slopes = []
        for dx, dy, dz, dpx, dpy, dpz in rays.slopes:
            more = -(dz + way * dpz) * inverse
            dx = dx + way * dpx + more * px
            dy = dy + way * dpy + more * py
            slopes.append((dx, dy, np.zeros_like(dx), dpx, dpy, dpz * turned))
        return Rays((x, y, self.height + 0.0 * x), (px, py, after), tuple(slopes)), possible

    def outline(self, longest: float) -> tuple[Floats, Floats]:
        points = np.array([(self.outer, self.height), (self.inner, self.height)])
        return points, np.tile((0.0, 1.0), (2, 1))

    def coordinates(self, x, y, z) -> tuple:
        return np.arctan2(y, x), np.sqrt(x * x + y * y)

    def sample(self, start: Viewpoint, back: bool) -> Patch | None:
        if start.parallel:
            rise = start.direction[2]
            seen = rise > 0.0 if back else rise < 0.0
        else:
            rise = start.eye[2] - self.height
            seen = rise < 0.0 if back else rise >= 0.0
        ends = (-np.pi, self.inner), (np.pi, self.outer)
        return Patch(self, *ends) if seen else None

    def place(self, azimuth, radius) -> tuple:
        return radius * np.cos(azimuth), radius * np.sin(azimuth), np.full_like(radius, self.height)

    def tangents(self, x, y, z) -> tuple[tuple, tuple]:
        none = np.zeros_like(x)
        return (none + 1.0, none, none), (none, none + 1.0, none)

    def slide(self, place: tuple, first, second) -> tuple:
        return place[0] + first, place[1] + second, place[2]

    def onto(self, place: tuple) -> tuple:
        return place[0], place[1], np.full_like(place[0], self.height)

    def middle_line(self, patch: Patch, along, count: int) -> Floats:
        return azimuth_lines(patch, along, count)


@dataclass(frozen=True)
class Lid(Plane):
    """A plane across the axis, of which a polygon belongs to it; the radii do not count."""

    inner: float = 0.0
    outer: float = math.inf
    outline: Outline | None = None

    def within(self, x, y, z) -> Flags:
        return self.outline.holds(x, y)


@dataclass(frozen=True)
class Fence:
    """All upright faces of a layer: an outline, from z = `low` to `high`."""

    outline: Outline
    low: float
    high: float

    @cached_property
    def _runs(self) -> list[tuple[Floats, ...]]:
        """Runs of faces: of each face, as columns (K, 1), begin, unit vector from there, length."""
        begin, end = np.moveaxis(np.array(self.outline.sides), 1, 0)
        length = np.hypot(*(end - begin).T)
        faces = np.column_stack((begin, (end - begin) / length[:, None], length))
        return [
            tuple(column[:, None] for column in faces[first : first + RUN].T)
            for first in range(0, len(faces), RUN)
        ]

    @cached_property
    def _circles(self) -> tuple[Floats, Floats, Floats]:
        """Circles (x, y, radius), as columns (R, 1), round the faces of each run."""
        found = []
        for bx, by, ax, ay, length in self._runs:
            corners = np.hstack(
                (np.vstack((bx, bx + length * ax)), np.vstack((by, by + length * ay)))
            )
            middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
            found.append((*middle, np.hypot(*(corners - middle).T).max()))
        x, y, radius = np.array(found).T[:, :, None]
        return x, y, radius

    def meet(
        self, rays: Rays, back: bool, limit: Floats
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
        """Which rays meet a face within a way of `limit`, which face is their first, and the way.

        `back`: they come from within.
        """
        near, passed = self._near(rays, limit)
        face, least = np.full(len(near), -1), limit[near]
        rays = rays.take(near)
        for number, faces in enumerate(self._runs):
            some = np.flatnonzero(passed[number])
            if not len(some):
                continue
            found, way = self._first(faces, rays.take(some), back, least[some])
            met = np.flatnonzero(found >= 0)
            face[some[met]], least[some[met]] = RUN * number + found[met], way[met]
        met = face >= 0
        return near[met], face[met], least[met]

    def _first(
        self, faces: tuple[Floats, ...], rays: Rays, back: bool, limit: Floats
    ) -> tuple[NDArray[np.intp], Floats]:
        """The face that each ray meets first, -1 for none within its limit, and the way there."""
        bx, by, ax, ay, length = faces
        x, y, z = rays.place
        px, py, pz = rays.momentum
        outward = px * ay - py * ax
        towards = outward > 0.0 if back else outward < 0.0
        way = ((bx - x) * ay - (by - y) * ax) / np.where(towards, outward, 1.0)
        ahead = towards & (way >= -SKIN) & (way < np.minimum(limit, HORIZON))
        way = np.where(ahead, way, 0.0)
        along = (x + way * px - bx) * ax + (y + way * py - by) * ay
        height = z + way * pz
        # With a skin: where faces meet, rounding leaves no gap.
        ahead &= (along >= -SKIN) & (along <= length + SKIN)
        ahead &= (height >= self.low - SKIN) & (height <= self.high + SKIN)
        way = np.where(ahead, way, np.inf)
        face = way.argmin(axis=0)
        least = way[face, np.arange(len(face))]
        return np.where(np.isfinite(least), face, -1), least

    def _near(self, rays: Rays, limit: Floats) -> tuple[NDArray[np.intp], Flags]:
        """Which rays may meet a face within a way of at most `limit`: all others do not.

        Second, (R, n): the runs whose circles they come into.
        """
        z, rise = rays.place[2], rays.momentum[2]
        level = np.abs(rise) < LEAST
        per = 1.0 / np.where(level, 1.0, rise)
        # As wide as faces are taken to be, and more for rounding.
        skin = 4.0 * SKIN
        down, up = (self.low - skin - z) * per, (self.high + skin - z) * per
        beside = level & ((z < self.low - skin) | (z > self.high + skin))
        begin = np.where(level, 0.0, np.maximum(np.minimum(down, up), 0.0))
        end = np.where(level, HORIZON, np.minimum(np.maximum(down, up), HORIZON))
        end = np.where(beside, -1.0, np.minimum(end, limit))
        begin = np.minimum(begin, HORIZON)
        x, y = (rays.place[axis] + begin * rays.momentum[axis] for axis in (0, 1))
        across = np.hypot(rays.momentum[0], rays.momentum[1])
        way = across * (end - begin)
        # What is rounded in places far off counts as well.
        skin = skin * (1.0 + sum(np.abs(part) for part in (x, y, *rays.place)))
        near = np.flatnonzero((end - begin >= -skin) & (way + skin >= self.outline.clear(x, y)))
        x, y, way, skin, across = (part[near] for part in (x, y, way, skin, across))
        ux, uy = (part[near] / np.maximum(across, LEAST) for part in rays.momentum[:2])
        cx, cy, radius = self._circles
        # From the way's point nearest to the circle's middle.
        cx, cy = cx - x, cy - y
        along = np.clip(cx * ux + cy * uy, 0.0, np.maximum(way, 0.0))
        away = (cx - along * ux) ** 2 + (cy - along * uy) ** 2
        return near, away <= (radius + skin) ** 2


@dataclass(frozen=True)
class Side:
    """An upright face, its front on the right of the way from `begin` to `end` (x, y).

    `fence`: all faces of its layer, which tells how high they are and where they are met.
    """

    begin: tuple[float, float]
    end: tuple[float, float]
    fence: Fence

    @cached_property
    def _along(self) -> tuple[float, float]:
        """Unit vector from begin to end."""
        dx, dy = self.end[0] - self.begin[0], self.end[1] - self.begin[1]
        length = math.hypot(dx, dy)
        return dx / length, dy / length

    def normal(self, x, y, z) -> tuple:
        ax, ay = self._along
        none = np.zeros_like(x)
        return none + ay, none - ax, none

    def pass_by(self, rays: Rays, way, gain: float | None, mark=None) -> tuple[Rays, Flags]:
        """As `Cylinder.pass_by`, for rays without slopes."""
        ax, ay = self._along
        px, py, pz = rays.momentum
        before = px * ay - py * ax
        after, _, possible = behind(before, gain, 1.0)
        change = after - before
        return Rays(rays.at(way), (px + change * ay, py - change * ax, pz)), possible


@dataclass(frozen=True)
class Shell:
    """A sphere round the origin."""

    radius: float

    def meet(self, rays: Rays, back: bool) -> tuple[Floats, Flags]:
        place, momentum = rays.place, rays.momentum
        p2 = sum(p * p for p in momentum)
        outward = sum(q * p for q, p in zip(place, momentum, strict=True))
        turn = cross(place, momentum)
        square = p2 * self.radius**2 - sum(part * part for part in turn)
        size = np.sqrt(sum(q * q for q in place))
        return _meet_round(self.radius, size, outward, p2, square, back)

    def within(self, x, y, z) -> Flags:
        return np.ones(np.shape(x), dtype=bool)

    def normal(self, x, y, z) -> tuple:
        per = 1.0 / self.radius
        return x * per, y * per, z * per

    def pass_by(self, rays: Rays, way, gain: float | None, mark=None) -> tuple[Rays, Flags]:
        """As `Cylinder.pass_by`, for rays without slopes."""
        place = rays.at(way)
        before = sum(q * p for q, p in zip(place, rays.momentum, strict=True))
        after, _, possible = behind(before, gain, self.radius**2)
        change = (after - before) * (1.0 / self.radius**2)
        turned = (p + change * q for q, p in zip(place, rays.momentum, strict=True))
        return Rays(place, tuple(turned)), possible


def _meet_round(radius: float, size, outward, p2, square, back: bool) -> tuple[Floats, Flags]:
    """`meet` of a circle or sphere, for rays at distances `size` from its middle.

    `outward`: place · momentum, `p2`: momentum², `square`: of the momentum's part across the
    surface where it is met, times the radius; below 0 where it is missed.
    """
    root = np.sqrt(np.maximum(square, 0.0))
    beyond = (size - radius) * (size + radius)
    # The two roots' product is beyond / p²: neither is a difference of large numbers.
    if back:
        far = root + np.abs(outward)
        way = np.where(outward > 0.0, -beyond / np.maximum(far, LEAST), far / p2)
        ahead = square > 0.0
    else:
        way = beyond / np.maximum(root - outward, LEAST)
        ahead = (square > 0.0) & (outward < 0.0)
    ahead &= way >= -SKIN
    return np.where(ahead, way, 0.0), ahead


def cross(a: tuple, b: tuple) -> tuple:
    """The cross product of vectors by components."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def anticlockwise(outline: Floats) -> Floats:
    """The polygon (K, 2) in anticlockwise order."""
    x, y = outline.T
    signed_area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return outline if signed_area > 0 else outline[::-1]


def azimuth_lines(patch: Patch, along, count: int) -> Floats:
    """Shares of a patch (azimuth, other) at the azimuths of `along` and against it."""
    first = np.arctan2(along[1], along[0])
    span = patch.high[0] - patch.low[0]
    lines = []
    for azimuth in (first, first + np.pi):
        share = np.mod(azimuth - patch.low[0], 2.0 * np.pi) / span if span else 2.0
        if share <= 1.0:
            line = np.full((count, 2), share)
            line[:, 1] = np.linspace(0.0, 1.0, count)
            lines.append(line)
    return np.array(lines).reshape(-1, count, 2)


def behind(before, gain, scale):
    """The part of the momentum across an interface behind it (times √scale), how it changes with
    that before it, and where there is any."""
    if gain is None:
        return -before, -1.0, True
    square = before * before + gain * scale
    root = np.sqrt(np.maximum(square, LEAST))
    after = np.copysign(root, before)
    return after, before / after, square > 0.0


@dataclass(frozen=True)
class Viewpoint:
    """Where rays start: `eye` (3,), or None in a parallel view along `direction`; outer radii."""

    eye: tuple | None
    direction: tuple | None
    medium: int

    @property
    def parallel(self) -> bool:
        return self.eye is None


@dataclass(frozen=True)
class Patch:
    """The rectangle of an interface's coordinates in which a viewpoint's rays first meet it.

    `base`: into how many cells it is cut first, `looks`: rays along the side of a cell that look
    for a path's region, `deepest`: halvings of a cell where rays end to exist.
    """

    surface: object
    low: tuple[float, float]
    high: tuple[float, float]
    base: tuple[int, int] = (24, 12)
    looks: int = 8
    deepest: int = 4

    def places(self, share) -> tuple:
        """Places at shares (..., 2) of the rectangle: x, y, z and what else the surface needs."""
        first = self.low[0] + (self.high[0] - self.low[0]) * share[..., 0]
        second = self.low[1] + (self.high[1] - self.low[1]) * share[..., 1]
        return self.surface.place(first, second)

    def shares(self, place: tuple) -> tuple:
        """The reverse of `places`: two parts."""
        first, second = self.surface.coordinates(*place)
        turn = np.mod(first - self.low[0], 2.0 * np.pi)
        return (
            turn / (self.high[0] - self.low[0]),
            (second - self.low[1]) / (self.high[1] - self.low[1]),
        )

    def middle_line(self, along, count: int) -> Floats:
        """Shares of places in the plane through the axis along `along` (2,), (K, count, 2)."""
        return self.surface.middle_line(self, along, count)
