# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of revolution from a profile: a smooth curve of (radius, height) turned round z.

A profile is a list of cubic segments. A ray meets it where, for a way s along the ray and a place t
on the curve, x² + y² = r(t)² and z = z(t): two equations, solved by Newton's method. Where no
place is known to start from, the curve is taken as a chain of cones first, each of which a ray
meets where a quadratic equation says so; the nearest is then made exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .surfaces import (
    LEAST,
    SKIN,
    Flags,
    Floats,
    Patch,
    Rays,
    Viewpoint,
    azimuth_lines,
    behind,
)

SAG = 2e-4
"""How far a cone may lie from the curve, in units of the profile."""

ROUNDS = 8
"""Most steps of Newton's method to a meeting."""

EXACT = 1e-8
"""Step at which a meeting counts as found: the step that would follow is below rounding."""

WIDE = 1e6
"""Way beyond which nothing of a profile lies."""

FLAT_MEETING = 0.05
"""How far a ray's meetings with a curve and with its cones may lie apart, in units of the profile:
more than √(2 · SAG), where it just grazes."""

PAIRS = 1 << 18
"""Pairs of rays and cones looked at at once."""

GROUP = 16
"""Cones whose common box is looked at before each of them."""


@dataclass(frozen=True)
class Curve:
    """Cubic segments: `radius` and `height` (K, 4), coefficients of 1, τ, τ², τ³ with t = k + τ."""

    radius: tuple[tuple[float, ...], ...]
    height: tuple[tuple[float, ...], ...]

    @classmethod
    def through(cls, points: Floats) -> Curve:
        """The curve through points (K, 2): a cubic spline over their distances.

        It is level where it begins or ends on the axis, and free at other ends.
        """
        way = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
        count = len(points)
        matrix, right = np.zeros((count, count)), np.zeros((count, 2))
        for k in range(1, count - 1):
            before, after = way[k - 1], way[k]
            matrix[k, k - 1 : k + 2] = after, 2.0 * (before + after), before
            right[k] = 3.0 * (
                after / before * (points[k] - points[k - 1])
                + before / after * (points[k + 1] - points[k])
            )
        slopes = np.zeros((count, 2))
        for axis in range(2):
            system, wanted = matrix.copy(), right[:, axis].copy()
            for end, inner, step in ((0, 1, way[0]), (count - 1, count - 2, way[-1])):
                on_axis = points[end, 0] == 0.0
                if on_axis and axis == 1:
                    system[end, end], wanted[end] = 1.0, 0.0
                else:
                    system[end, end], system[end, inner] = 2.0, 1.0
                    chord = points[1] - points[0] if end == 0 else points[-1] - points[-2]
                    wanted[end] = 3.0 * chord[axis] / step
            slopes[:, axis] = np.linalg.solve(system, wanted)
        low, high = slopes[:-1] * way[:, None], slopes[1:] * way[:, None]
        return cls._hermite(points[:-1], points[1:], low, high)

    @classmethod
    def bezier(cls, points: Floats) -> Curve:
        """The curve of Bézier points (K, 3, 2): left handle, point, right handle."""
        begin, end = points[:-1, 1], points[1:, 1]
        return cls._hermite(begin, end, 3.0 * (points[:-1, 2] - begin), 3.0 * (end - points[1:, 0]))

    @classmethod
    def _hermite(cls, begin, end, low, high) -> Curve:
        parts = begin, low, 3.0 * (end - begin) - 2.0 * low - high, 2.0 * (begin - end) + low + high
        table = np.stack(parts, axis=-1)
        return cls(*(tuple(tuple(row) for row in table[:, axis].tolist()) for axis in range(2)))

    def scaled(self, factor: float) -> Curve:
        return Curve(
            *(
                tuple(tuple(part * factor for part in row) for row in rows)
                for rows in (self.radius, self.height)
            )
        )

    def pieces(self, sag: float) -> Floats:
        """Places t that cut the curve into chords which lie at most `sag` off it."""
        ts = [0.0]
        for k, rows in enumerate(zip(self.radius, self.height, strict=True)):
            bend = max(
                math.hypot(*(2.0 * row[2] + 6.0 * row[3] * tau for row in rows))
                for tau in (0.0, 0.5, 1.0)
            )
            parts = max(1, min(40, math.ceil(math.sqrt(bend / (8.0 * sag)))))
            ts += [k + (part + 1) / parts for part in range(parts)]
        return np.array(ts)


@dataclass(frozen=True)
class Profile:
    """A curve turned round the axis; its front lies to the right of the way along it.

    `low`, `high`: heights between which it belongs to the interface (`low` excluded where
    `open_below`).
    """

    curve: Curve
    low: float = -math.inf
    high: float = math.inf
    open_below: bool = False
    table: Floats = field(init=False, repr=False, compare=False)
    chords: Floats = field(init=False, repr=False, compare=False)
    reach: float = field(init=False, repr=False, compare=False)
    ends: tuple[bool, bool] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        table = np.array([self.curve.radius, self.curve.height])  # (2, K, 4)
        object.__setattr__(self, "table", np.ascontiguousarray(np.moveaxis(table, 1, 2)))
        ts = self.curve.pieces(SAG)
        r, z, *_ = self.on_curve(ts)
        keep = (np.maximum(z[1:], z[:-1]) >= self.low) & (np.minimum(z[1:], z[:-1]) <= self.high)
        chords = np.stack([r[:-1], z[:-1], np.diff(r), np.diff(z), ts[:-1], np.diff(ts)])
        object.__setattr__(self, "chords", chords[:, keep])
        reach = max(r.max(), 0.0) + SAG
        object.__setattr__(self, "reach", float(reach))
        object.__setattr__(self, "ends", (abs(r[0]) < 1e-9, abs(r[-1]) < 1e-9))

    @property
    def count(self) -> int:
        return len(self.curve.radius)

    def on_curve(self, t) -> tuple:
        """r, z and their first and second derivatives by t."""
        k = np.clip(np.floor(t), 0, self.count - 1).astype(np.intp)
        tau = t - k
        values = []
        for rows in self.table:
            c0, c1, c2, c3 = (row[k] for row in rows)
            values.append(
                (
                    ((c3 * tau + c2) * tau + c1) * tau + c0,
                    (3.0 * c3 * tau + 2.0 * c2) * tau + c1,
                    6.0 * c3 * tau + 2.0 * c2,
                )
            )
        (r, r1, r2), (z, z1, z2) = values
        return r, z, r1, z1, r2, z2

    def _inside(self, t) -> Floats:
        """t folded back at ends on the axis, where the curve goes on as its mirror image."""
        if self.ends[0]:
            t = np.abs(t)
        if self.ends[1]:
            t = np.where(t > self.count, 2.0 * self.count - t, t)
        return t

    # ---- meetings -----------------------------------------------------------------------

    def meet(self, rays: Rays, back: bool, mark=None) -> tuple[Floats, Flags]:
        """As `Cylinder.meet`."""
        way, ahead, _ = self.meet_at(rays, back, mark)
        return way, ahead

    def meet_at(self, rays: Rays, back: bool, mark=None, limit=math.inf):
        """The way to the interface, whether it is ahead, and its mark (2, M): s and t.

        `mark`: a meeting of a ray nearby, to start from. Without, the nearest is looked for, and
        found if it lies within `limit`, a way or one for each ray.
        """
        # Rays that meet nothing may overflow.
        with np.errstate(all="ignore"):
            if mark is None:
                return self._found(rays, back, *self._search(rays, back, limit))
            way, t, exact = self._refine(rays, mark[0], mark[1])
            return self._told(rays, way, t, exact, back)

    def _found(self, rays: Rays, back: bool, mark, found):
        """The meetings that were searched for, made exact; the rays that have none are left out."""
        way, ahead = np.zeros(len(found)), np.zeros(len(found), dtype=bool)
        some = np.flatnonzero(found)
        if len(some):
            parts = (rays.place, rays.momentum)
            rays = Rays(*(tuple(np.broadcast_to(c, len(found))[some] for c in p) for p in parts))
            begin, t, exact = self._refine(rays, mark[0, some], mark[1, some])
            way[some], ahead[some], mark[:, some] = self._told(rays, begin, t, exact, back)
        return way, ahead, mark

    def _told(self, rays: Rays, way, t, exact, back: bool):
        ahead = exact & (way >= -SKIN) & (t >= -1e-9) & (t <= self.count + 1e-9)
        ahead &= self._facing(rays, t, way, back)
        return np.where(ahead, way, 0.0), ahead, np.stack([way, t])

    def _facing(self, rays: Rays, t, way, back: bool) -> Flags:
        _, _, r1, z1, _, _ = self.on_curve(t)
        x, y, _ = rays.at(way)
        px, py, pz = rays.momentum
        size = np.sqrt(np.maximum(x * x + y * y, LEAST))
        towards = z1 * (x * px + y * py) - r1 * pz * size
        return towards > 0.0 if back else towards < 0.0

    def _refine(self, rays: Rays, way, t):
        """Newton's steps in s and t together; and which came to rest."""
        x, y, z = rays.place
        px, py, pz = rays.momentum
        shape = np.broadcast_shapes(np.shape(way), np.shape(x), np.shape(px))
        parts = [px * px + py * py, x * px + y * py, x * x + y * y, z, pz]
        parts = [np.broadcast_to(part, shape) for part in parts]
        way, t = (np.array(np.broadcast_to(part, shape)) for part in (way, t))
        rests = np.zeros(shape, dtype=bool)
        index, here = None, (way, t)
        for _ in range(ROUNDS):
            p2, outward, size2, z, pz = parts
            s, at = here
            r, height, r1, z1, *_ = self.on_curve(at)
            off = ((p2 * s + 2.0 * outward) * s + size2) - r * r
            rise = z + s * pz - height
            w = 2.0 * (outward + s * p2)
            rr = 2.0 * r * r1
            determinant = rr * pz - w * z1
            inverse = 1.0 / np.where(determinant == 0.0, LEAST, determinant)
            step_way = np.clip((z1 * off - rr * rise) * inverse, -2.0, 2.0)
            step_t = np.clip((pz * off - w * rise) * inverse, -0.7, 0.7)
            s = s + step_way
            at = np.clip(self._inside(at + step_t), -0.5, self.count + 0.5)
            done = np.abs(step_t) + np.abs(step_way) < EXACT
            if index is None:
                index = np.arange(len(done))
            way[index], t[index], rests[index] = s, at, done
            going = np.flatnonzero(~done)
            if not len(going):
                break
            # Each stops by itself: its answer must not depend on the others.
            if len(going) == len(done):
                here = s, at
                continue
            index, here = index[going], (s[going], at[going])
            parts = [part[going] for part in parts]
        return way, t, rests

    @cached_property
    def _bounds(self) -> list[tuple[tuple[Floats, Floats, Floats], int]]:
        """Lowest and highest z and largest r of all chords together, of each group and of each.

        With each of the three goes how many of its boxes one of the boxes before it holds.
        """
        r0, z0, dr, dz, *_ = self.chords
        bottom, top = np.minimum(z0, z0 + dz) - NEAR, np.maximum(z0, z0 + dz) + NEAR
        bounds, counts = [(bottom, top, np.maximum(r0, r0 + dr) + NEAR)], []
        for count in (GROUP, -(-len(r0) // GROUP)):
            bottom, top, widest = bounds[0]
            starts = np.arange(0, len(bottom), count)
            lower = np.minimum.reduceat(bottom, starts)
            upper, wide = (np.maximum.reduceat(part, starts) for part in (top, widest))
            bounds.insert(0, (lower, upper, wide))
            counts.insert(0, count)
        return list(zip(bounds, (1, *counts), strict=True))

    def _search(self, rays: Rays, back: bool, limit):
        """Mark of the nearest meeting with the chain of cones, and which rays have one."""
        rays = Rays(
            *(np.broadcast_arrays(*parts, *rays.place)[:3] for parts in (rays.place, rays.momentum))
        )
        total = len(rays.place[0])
        limit = np.broadcast_to(limit, total)
        mark, found = np.zeros((2, total)), np.zeros(total, dtype=bool)
        if not self.chords.size:
            return mark, found
        size = max(1, PAIRS // self.chords.shape[1])
        for begin in range(0, total, size):
            some = slice(begin, begin + size)
            mark[:, some], found[some] = self._nearest_cone(rays.take(some), back, limit[some])
        return mark, found

    def _nearest_cone(self, rays: Rays, back: bool, limit: Floats):
        x, y, z = rays.place
        px, py, pz = rays.momentum
        p2 = np.maximum(px * px + py * py, LEAST)
        outward = x * px + y * py
        # The part of a ray ahead of it, within the cylinder round the profile: its heights, and
        # how near to the axis it comes there.
        ell = x * py - y * px
        square = p2 * self.reach**2 - ell * ell
        root = np.sqrt(np.maximum(square, 0.0))
        enters = np.maximum((-outward - root) / p2, 0.0) - NEAR
        leaves = np.minimum((root - outward) / p2, WIDE)
        leaves = np.minimum(np.where(p2 > 1e-12, leaves, WIDE), limit + FLAT_MEETING)
        begin, end = z + enters * pz, z + leaves * pz
        low, high = np.minimum(begin, end), np.maximum(begin, end)
        nearest = np.where(outward < 0.0, np.abs(ell) / np.sqrt(p2), np.sqrt(x * x + y * y))
        r0, z0, dr, dz, t0, dt = self.chords
        ray = np.flatnonzero((square > 0.0) & (leaves > 0.0))
        chord = np.zeros_like(ray)
        # Boxes of all chords first, then of a group of them, then of each.
        for bounds, count in self._bounds:
            chord = chord[:, None] * count + np.arange(count)
            ray = np.broadcast_to(ray[:, None], chord.shape)
            inside = chord < len(bounds[0])
            ray, chord = ray[inside], chord[inside]
            bottom, top, widest = bounds
            near = (low[ray] <= top[chord]) & (high[ray] >= bottom[chord])
            near = np.flatnonzero(near & (nearest[ray] <= widest[chord]))
            ray, chord = ray[near], chord[near]
        x, y, z, px, py, pz = (part[ray] for part in (x, y, z, px, py, pz))
        r0, z0, dr, dz = (part[chord] for part in (r0, z0, dr, dz))
        # (dz·ρ(s))² = (r0·dz + dr·(z(s) − z0))², a chord neither level nor upright by a hair
        dz = np.where(np.abs(dz) < 1e-9, 1e-9, dz)
        rise = r0 * dz + dr * (z - z0)
        slope = dr * pz
        dz2 = dz * dz
        a = dz2 * (px * px + py * py) - slope * slope
        b = dz2 * (x * px + y * py) - slope * rise
        c = dz2 * (x * x + y * y) - rise * rise
        # b² − a·c over dz², without the large terms that cancel
        square = (rise * px - slope * x) ** 2 + (rise * py - slope * y) ** 2
        square -= dz2 * (x * py - y * px) ** 2
        real = square >= 0.0
        q = -(b + np.copysign(dz * np.sqrt(np.maximum(square, 0.0)), b))
        per = 1.0 / (dr * dr + dz2)
        least, tau = np.full(len(ray), np.inf), np.zeros(len(ray))
        for over, below in ((q, a), (c, q)):
            way = over / np.where(below == 0.0, LEAST, below)
            height = z + way * pz - z0
            at_x, at_y = x + way * px, y + way * py
            size = np.sqrt(at_x * at_x + at_y * at_y)
            radius = size - r0
            along = (radius * dr + height * dz) * per
            hit = real & (along >= -NEAR) & (along <= 1.0 + NEAR) & (way > -1e-6) & (way < least)
            # Few are met between the cone's ends: the rest is for those only.
            some = np.flatnonzero(hit)
            across = radius[some] * dz[some] - height[some] * dr[some]
            inward = at_x[some] * px[some] + at_y[some] * py[some]
            towards = dz[some] * inward - slope[some] * size[some]
            hit = (towards > 0.0) if back else (towards < 0.0)
            hit &= np.abs(across) < 1e-6 * (1.0 + np.abs(way[some]))
            some = some[hit]
            least[some], tau[some] = way[some], along[some]
        total = len(rays.place[0])
        mark, found = np.zeros((2, total)), np.zeros(total, dtype=bool)
        some = np.flatnonzero(np.isfinite(least))
        # The nearest of each ray comes last, and stays.
        some = some[np.argsort(-least[some], kind="stable")]
        mark[0, ray[some]] = least[some]
        mark[1, ray[some]] = t0[chord[some]] + dt[chord[some]] * np.clip(tau[some], 0.0, 1.0)
        found[ray[some]] = True
        return mark, found

    def within(self, x, y, z) -> Flags:
        low = (z > self.low) if self.open_below else (z >= self.low)
        return low & (z <= self.high)

    # ---- at a meeting -------------------------------------------------------------------

    def frame(self, x, y, t):
        """Unit normal and meridian tangent (3 parts each), and the two curvatures."""
        r, _, r1, z1, r2, z2 = self.on_curve(t)
        length2 = r1 * r1 + z1 * z1
        per = 1.0 / np.sqrt(np.maximum(length2, LEAST))
        size = np.sqrt(np.maximum(x * x + y * y, LEAST))
        cosine, sine = x / size, y / size
        nr, nz = z1 * per, -r1 * per
        bend = (z2 * r1 - r2 * z1) * per**3
        near = np.abs(r) < 1e-7
        turn = np.where(near, bend, nr / np.where(near, 1.0, r))
        return (nr * cosine, nr * sine, nz), (-nz * cosine, -nz * sine, nr), bend, turn

    def normal(self, x, y, z, t=None) -> tuple:
        if t is None:
            t = self.nearest(np.sqrt(x * x + y * y), z)
        return self.frame(x, y, t)[0]

    def nearest(self, radius, z) -> Floats:
        """t of places on the curve."""
        ts = np.append(self.chords[4], self.chords[4, -1] + self.chords[5, -1])
        r, height, *_ = self.on_curve(ts)
        best = np.zeros(np.shape(radius))
        least = np.full(np.shape(radius), np.inf)
        for part in range(len(ts) - 1):
            dr, dz = r[part + 1] - r[part], height[part + 1] - height[part]
            along = ((radius - r[part]) * dr + (z - height[part]) * dz) / (dr * dr + dz * dz)
            along = np.clip(along, 0.0, 1.0)
            off = (radius - r[part] - along * dr) ** 2 + (z - height[part] - along * dz) ** 2
            closer = off < least
            least = np.where(closer, off, least)
            best = np.where(closer, ts[part] + along * (ts[part + 1] - ts[part]), best)
        for _ in range(4):
            at, up, r1, z1, r2, z2 = self.on_curve(best)
            gap_r, gap_z = at - radius, up - z
            slope = r1 * r1 + z1 * z1 + gap_r * r2 + gap_z * z2
            best = best - (gap_r * r1 + gap_z * z1) / np.where(slope > 0.0, slope, 1.0)
            best = np.clip(self._inside(best), 0.0, self.count)
        return best

    def pass_by(self, rays: Rays, way, gain, mark=None) -> tuple[Rays, Flags]:
        """As `Cylinder.pass_by`; `mark`: t of the meetings."""
        x, y, z = rays.at(way)
        p = rays.momentum
        t = self.nearest(np.sqrt(x * x + y * y), z) if mark is None else mark
        normal, tangent, bend, turn = self.frame(x, y, t)
        k = sum(a * b for a, b in zip(p, normal, strict=True))
        after, turned, possible = behind(k, gain, 1.0)
        change = after - k
        inverse = 1.0 / np.where(k == 0.0, LEAST, k)
        slopes = []
        for slope in rays.slopes:
            moved = [do + way * dp for do, dp in zip(slope[:3], slope[3:], strict=True)]
            more = -sum(a * b for a, b in zip(moved, normal, strict=True)) * inverse
            moved = [part + more * q for part, q in zip(moved, p, strict=True)]
            along = sum(a * b for a, b in zip(moved, tangent, strict=True))
            lean = along * (bend - turn)
            # Round the axis and along the meridian; what is left has no part along the normal.
            tilted = [turn * a + lean * b for a, b in zip(moved, tangent, strict=True)]
            rise = sum(a * b for a, b in zip(slope[3:], normal, strict=True))
            rise = rise + sum(a * b for a, b in zip(p, tilted, strict=True))
            rise = rise * (turned - 1.0)
            slopes.append(
                (
                    *moved,
                    *(
                        dp + rise * n + change * dn
                        for dp, n, dn in zip(slope[3:], normal, tilted, strict=True)
                    ),
                )
            )
        momentum = tuple(a + change * b for a, b in zip(p, normal, strict=True))
        return Rays((x, y, z), momentum, tuple(slopes)), possible

    def outline(self, longest: float) -> tuple[Floats, Floats]:
        """As `Cylinder.outline`: the part between `low` and `high`."""
        ts = []
        for k in range(self.count):
            r, z, *_ = self.on_curve(np.linspace(k, k + 1, 33))
            length = np.hypot(np.diff(r), np.diff(z)).sum()
            parts = max(1, math.ceil(length / longest))
            ts.append(k + np.arange(parts) / parts)
        ts = np.append(np.concatenate(ts), float(self.count))
        heights = self.on_curve(ts)[1]
        inside = np.flatnonzero((heights >= self.low) & (heights <= self.high))
        if not len(inside):
            return np.zeros((0, 2)), np.zeros((0, 2))
        first, last = inside[0], inside[-1]
        kept = ts[first : last + 1]
        if first:
            kept = np.insert(kept, 0, self._crossing(ts[first - 1], ts[first]))
        if last + 1 < len(ts):
            kept = np.append(kept, self._crossing(ts[last + 1], ts[last]))
        kept = kept[np.append(True, np.diff(kept) > 1e-9)]
        r, z, r1, z1, *_ = self.on_curve(kept)
        normals = np.stack([z1, -r1], axis=-1)
        normals /= np.maximum(np.sqrt(np.sum(normals**2, axis=1, keepdims=True)), LEAST)
        return np.stack([np.maximum(r, 0.0), z], axis=-1), normals

    def _crossing(self, outside: float, inside: float) -> float:
        """Where between two places of the curve the part between `low` and `high` ends."""
        for _ in range(60):
            middle = 0.5 * (outside + inside)
            height = self.on_curve(np.array([middle]))[1][0]
            if self.low <= height <= self.high:
                inside = middle
            else:
                outside = middle
        return inside

    # ---- as the first interface ---------------------------------------------------------

    def sample(self, start: Viewpoint, back: bool) -> Patch | None:
        towards = start.eye if not start.parallel else tuple(-part for part in start.direction)
        middle = math.atan2(towards[1], towards[0])
        ts = np.linspace(0.0, self.count, 16 * self.count + 1)
        _, z, *_ = self.on_curve(ts)
        inside = ts[(z >= self.low) & (z <= self.high)]
        if not len(inside):
            return None
        step = ts[1] if self.low > -math.inf or self.high < math.inf else 0.0
        first, last = max(0.0, inside[0] - step), min(float(self.count), inside[-1] + step)
        return Patch(self, (middle - math.pi, first), (middle + math.pi, last), (36, 20), 4, 3)

    def coordinates(self, x, y, z, t) -> tuple:
        return np.arctan2(y, x), t

    def place(self, azimuth, t) -> tuple:
        r, z, *_ = self.on_curve(t)
        return r * np.cos(azimuth), r * np.sin(azimuth), z, t

    def middle_line(self, patch: Patch, along, count: int) -> Floats:
        return azimuth_lines(patch, along, count)

    def tangents(self, x, y, z, t) -> tuple[tuple, tuple]:
        size = np.sqrt(np.maximum(x * x + y * y, LEAST))
        return (-y / size, x / size, np.zeros_like(x)), self.frame(x, y, t)[1]

    def slide(self, place: tuple, first, second) -> tuple:
        x, y, _, t = place
        r, _, r1, z1, _, _ = self.on_curve(t)
        angle = np.clip(first / np.maximum(r, 1e-9), -1.0, 1.0)
        cosine, sine = np.cos(angle), np.sin(angle)
        t = t + second / np.sqrt(np.maximum(r1 * r1 + z1 * z1, LEAST))
        # Over the axis the way leads on along the other side.
        x, y = x * cosine - y * sine, y * cosine + x * sine
        flip = 1.0
        if self.ends[0]:
            flip = np.where(t < 0.0, -1.0, flip)
        if self.ends[1]:
            flip = np.where(t > self.count, -1.0, flip)
        return self.onto((x * flip, y * flip, place[2], self._inside(t)))

    def onto(self, place: tuple) -> tuple:
        x, y, _, t = place
        t = np.clip(t, 0.0, self.count)
        r, z, *_ = self.on_curve(t)
        size = np.sqrt(x * x + y * y)
        lost = size < LEAST
        factor = r / np.where(lost, 1.0, size)
        return np.where(lost, r, x * factor), np.where(lost, 0.0, y * factor), z, t


NEAR = 1e-6
"""Parts of a cone by which a meeting may lie beyond its ends."""


def as_curve(name: str, value: ArrayLike) -> Curve:
    """The curve of points (K, 2) or Bézier points (K, 3, 2); ValueError naming the field."""
    try:
        points = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be (K, 2) or (K, 3, 2), not {value!r}") from None
    bezier = points.ndim == 3 and points.shape[1:] == (3, 2)
    if not bezier and (points.ndim != 2 or points.shape[1:] != (2,)):
        raise ValueError(f"{name} must be (K, 2) or (K, 3, 2), not of shape {points.shape}")
    if len(points) < 2 or not np.isfinite(points).all():
        raise ValueError(f"{name} must be two or more finite points, not {value!r}")
    nodes = points[:, 1] if bezier else points
    if (nodes[:, 0] < 0.0).any():
        raise ValueError(f"{name} must not have a negative radius: {value!r}")
    if not np.diff(nodes, axis=0).any(axis=1).all():
        raise ValueError(f"{name} must not repeat a point: {value!r}")
    return Curve.bezier(points) if bezier else Curve.through(points)
