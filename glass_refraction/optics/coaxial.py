# SPDX-License-Identifier: GPL-3.0-or-later
"""Equations of cylinders round one axis and of spheres round one centre.

A ray keeps two invariants here, in every medium: ζ = n·d_z and ℓ = n·(x·d_y − y·d_x), with d its
unit direction. In a medium of index n its transverse momentum is P = √(n² − ζ²), and at radius r
w = √(P²r² − ℓ²) is r times its radial momentum. With A = arcsin(ℓ / (P r)), passing a radius adds
±A to the azimuth of the ray's line and ∓w/P² to its length, so that a whole path is a list of
*terms* (n, r, c):

    azimuth of the line   ψ = constant + Σ c·A
    height at its foot    z = −ζ Σ c·w / P²
    geometric length      s = −Σ c·n·w / P²

The eye is one more term, and so is the target (c = +1 on the way in, −1 on the way out). ψ and z
are the derivatives by ℓ and ζ of one function, the radial action (Fermat's principle), so their
Jacobian is symmetric. Derived for this project; ray invariants as in any book on Hamiltonian
optics (for example R. K. Luneburg, Mathematical Theory of Optics).

Spheres are the case ζ = 0 in the plane through eye, centre and target; a parallel view of
cylinders is the case of a known ζ without the term of the eye.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .glasses import CylinderGlass, SphereGlass
from .images import View
from .paths import Branch, LightPath, ParallelView, branches
from .tracing import advance, meet, start, trace
from .vectors import perpendiculars

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """Where rays start and how points are told, in units of the outermost radius.

    Targets become (x, y, z): x towards the eye (against the view's direction in a parallel view),
    y across, z along the axis from the eye; for spheres y ≥ 0 and z = 0.
    `eye_radius` is None in a parallel view; `zeta` is None where it is unknown.
    """

    scale: float
    medium: int
    eye: Floats | None
    eye_radius: float | None
    axes: Floats  # rows x, y, z of the frame; spheres: row x only
    direction: Floats | None
    zeta: float | None
    spherical: bool


def frame_of(glass: CylinderGlass | SphereGlass, eye: Floats | ParallelView) -> Frame:
    """The frame of a viewpoint."""
    scale = glass.radius[0]
    spherical = isinstance(glass, SphereGlass)
    parallel = isinstance(eye, ParallelView)
    if parallel:
        direction = np.asarray(eye.direction)
        towards, medium, position, zeta = -direction, 0, None, glass.ior_outside * direction[2]
    else:
        direction, zeta = None, None
        medium = int(glass.medium_at(eye))
        position = towards = eye / scale
    across = towards.copy()
    if spherical:
        zeta = 0.0
    else:
        across[2] = 0.0
    radius = float(np.sqrt(across @ across))
    if radius < TINY:
        # On the axis every azimuth is as good: the eye is moved off it by less than rounding.
        axis, radius = np.array([1.0, 0.0, 0.0]), TINY
    else:
        axis = across / radius
    if spherical:
        axes = axis[None]
    else:
        axes = np.array([axis, [-axis[1], axis[0], 0.0], [0.0, 0.0, 1.0]])
    return Frame(
        scale,
        medium,
        position,
        None if parallel else radius,
        axes,
        direction,
        zeta,
        spherical,
    )


TINY = 1e-15
"""Distance from the axis, in outer radii, below which a point counts as on it."""


@dataclass(frozen=True)
class Term:
    """A passage: `count` times the angle at `radius` in the medium of index `ior`."""

    ior: float
    radius: float
    count: int


@dataclass(frozen=True)
class Domain:
    """Which rays (ℓ, ζ) take a branch: lower(ζ) ≤ |ℓ| < upper(ζ), |ζ| < zeta_max.

    `upper` and `lower` hold (n², r²): the limits are the least √((n² − ζ²) r²) over `upper` and
    the greatest over `lower` (0 if empty). `zeta_max` is 0 where no ray takes the branch.
    """

    upper: tuple[tuple[float, float], ...]
    lower: tuple[tuple[float, float], ...]
    zeta_max: float


def domain_of(glass: CylinderGlass | SphereGlass, branch: Branch) -> Domain:
    """The domain of a branch, all its stretches included."""
    media = [ior * ior for ior in glass.media]
    squares = [(radius / glass.radius[0]) ** 2 for radius in glass.radius]
    upper, lower = set(), set()
    for number, interface in enumerate(branch.interfaces):
        upper.add((media[branch.stretches[number].medium], squares[interface]))
        upper.add((media[branch.stretches[number + 1].medium], squares[interface]))
    for stretch in branch.stretches:
        if stretch.turns and stretch.medium < len(squares):
            lower.add((media[stretch.medium], squares[stretch.medium]))
    # upper² − lower² falls with ζ² (outer radii are larger), so the domain ends once.
    end = min(n2 for n2, _ in upper)
    for n2_low, r2_low in lower:
        for n2, r2 in upper:
            if r2 > r2_low:
                end = min(end, (n2 * r2 - n2_low * r2_low) / (r2 - r2_low))
            elif n2 <= n2_low:
                end = 0.0
    zeta_max = math.sqrt(end) if end > 0.0 else 0.0
    return Domain(_extremal(upper, zeta_max, min), _extremal(lower, zeta_max, max), zeta_max)


@lru_cache(maxsize=4096)
def taken_branches(
    glass: CylinderGlass | SphereGlass, medium: int, events: str
) -> tuple[tuple[Branch, Domain], ...]:
    """The branches of a path that some ray takes, and their domains.

    Most of what the order of the interfaces allows no ray takes, and what has begun so needs no
    end: a path of 16 reflections in a wall has one branch in 65,536.
    """
    domains: dict[Branch, Domain] = {}

    def possible(begun: Branch) -> bool:
        if not begun.interfaces:
            return True
        domains[begun] = domain_of(glass, begun)
        return domains[begun].zeta_max > 0.0

    found = branches(glass, medium, LightPath(events), possible)
    return tuple((branch, domains[branch]) for branch in found if branch.interfaces)


def _extremal(lines, zeta_max, which) -> tuple[tuple[float, float], ...]:
    """The limits that are the least (or greatest) for some ζ; they are straight lines in ζ²."""
    end = zeta_max * zeta_max
    at_ends = {(n2, r2): (n2 * r2, (n2 - end) * r2) for n2, r2 in lines}

    def beats(one, other) -> bool:
        first, second = at_ends[one], at_ends[other]
        if first == second:
            return one < other
        return all(which(a, b) == a for a, b in zip(first, second, strict=True))

    return tuple(line for line in sorted(lines) if not any(beats(o, line) for o in lines))


def _paired(walls: tuple[Term, ...]):
    """Terms of one ior in pairs of opposite counts, the rest, and what all counts divide by.

    A pair costs one division and half the products of two single terms.
    """
    power = math.gcd(*(term.count for term in walls)) or 1
    pairs, singles = [], []
    for ior in sorted({term.ior for term in walls}):
        plus = [[term.radius**2, term.count] for term in walls if term.ior == ior]
        minus = [part for part in plus if part[1] < 0]
        plus = [part for part in plus if part[1] > 0]
        while plus and minus:
            count = min(plus[-1][1], -minus[-1][1])
            pairs.append((ior, plus[-1][0], minus[-1][0], count))
            plus[-1][1] -= count
            minus[-1][1] += count
            plus, minus = ([part for part in parts if part[1]] for parts in (plus, minus))
        singles += [(ior, radius2, count) for radius2, count in plus + minus]
    return tuple(pairs), tuple(singles), power


class Rows:
    """The terms of a passage as columns, for all rays at once: pairs first, the eye last.

    `limits`: n²r² and r² of each row, `squares` and `iors`: n² and n of each medium, by the size
    of the numbers in bytes. `pairs`: (medium, count, whether the first of its medium, factors of
    the turn); `singles` and `eye` (or None): the row first, then the same; `own`: the medium of
    the stretch; `untouched`: media without a term.
    """

    def __init__(self, passage: CoaxialPassage) -> None:
        pairs, singles = passage.paired, passage.unpaired
        lines = [(ior, plus2) for ior, plus2, _, _ in pairs]
        lines += [(ior, minus2) for ior, _, minus2, _ in pairs]
        lines += [(ior, radius2) for ior, radius2, _ in singles]
        self.media = sorted({ior for ior, _ in lines} | {passage.ior, passage.eye_ior})
        medium = {ior: number for number, ior in enumerate(self.media)}
        untouched = set(range(len(self.media)))

        def first(number: int) -> bool:
            """Whether this is the first term of a medium: it is written, not added."""
            if number not in untouched:
                return False
            untouched.remove(number)
            return True

        self.pairs = [
            (medium[ior], count, first(medium[ior]), count // passage.power)
            for ior, _, _, count in pairs
        ]
        self.singles = [
            (
                2 * len(pairs) + number,
                medium[ior],
                count,
                first(medium[ior]),
                abs(count) // passage.power,
            )
            for number, (ior, _, count) in enumerate(singles)
        ]
        self.own, self.eye = medium[passage.ior], None
        met = {ior for ior, _ in lines}
        if passage.eye_term is not None:
            term = passage.eye_term
            number = medium[term.ior]
            self.eye = len(lines), number, term.count, first(number)
            lines.append((term.ior, term.radius**2))
            met.add(term.ior)
        # Whether ζ is bounded by a medium that no term knows.
        self.loose = not met >= {passage.ior, passage.eye_ior}
        self.untouched = sorted(untouched)
        lines = np.array(lines).reshape(-1, 2)
        columns = (lines[:, :1] ** 2 * lines[:, 1:], lines[:, 1:].copy())
        iors = np.array(self.media)[:, None]
        kinds = (np.float32, np.float64)
        self.limits = {kind().itemsize: tuple(c.astype(kind) for c in columns) for kind in kinds}
        self.iors = {kind().itemsize: iors.astype(kind) for kind in kinds}
        self.squares = {kind().itemsize: (iors * iors).astype(kind) for kind in kinds}


class CoaxialPassage:
    """One stretch of one branch: everything its equations need, for one viewpoint.

    Lengths are in outer radii. `turn` is the constant part of the line's azimuth in half turns.
    """

    solved = 3
    most = 12

    def __init__(
        self,
        glass: CylinderGlass | SphereGlass,
        eye: Floats | ParallelView,
        branch: Branch,
        stretch: int,
    ) -> None:
        frame = frame_of(glass, eye)
        media = glass.media
        self.glass, self.extent = glass, getattr(glass, "extent", None)
        radii = [radius / frame.scale for radius in glass.radius]
        self.frame = frame
        self.media, self.radii = media, radii
        self.branch = branch
        self.number = stretch
        self.stretch = branch.stretches[stretch]
        self.ior = media[self.stretch.medium]
        self.eye_ior = media[frame.medium]
        self.eye_side = -branch.stretches[0].enters  # +1: the ray runs away from the axis
        self.domain = domain_of(glass, branch)
        edges = (math.inf, *radii, 0.0)
        self.outer, self.inner = edges[self.stretch.medium], edges[self.stretch.medium + 1]
        # The legs of the stretch that a target can lie on: before (−1), after (+1) the foot.
        self.sides = tuple(sorted({-self.stretch.enters, -self.stretch.leaves}))

        counts: Counter[tuple[float, float]] = Counter()
        turn = -1 if self.eye_side < 0 else 0
        for number, interface in enumerate(branch.interfaces[:stretch]):
            before, after = branch.stretches[number], branch.stretches[number + 1]
            # arg e = −A on the way out, π + A on the way in
            counts[media[before.medium], radii[interface]] += before.leaves
            counts[media[after.medium], radii[interface]] -= after.enters
            turn += (before.leaves > 0) - (after.enters > 0)
        self.turn = turn
        self.walls = tuple(Term(n, r, c) for (n, r), c in sorted(counts.items()) if c)
        self.eye_term = (
            None
            if frame.eye_radius is None
            else Term(self.eye_ior, frame.eye_radius, self.eye_side)
        )
        self.terms = self.walls + ((self.eye_term,) if self.eye_term else ())
        self.paired, self.unpaired, self.power = _paired(self.walls)
        self.rows = Rows(self)
        least = min((self.ior, *(term.ior for term in self.terms)))
        self.zeta_max = least
        limits = {(term.ior * term.ior, term.radius * term.radius) for term in self.terms}
        if not limits:
            limits = {(self.ior * self.ior, 1.0)}
        self.limits = _extremal(limits, least, min)
        self.single = self.empty() or self._single()
        # From very far an angle no longer tells how far a ray passes by: measure as from 100 radii.
        away = 0.0 if frame.eye is None else float(np.sqrt(frame.eye @ frame.eye))
        self.finer = max(1.0, away / FAR)
        # The straight ray is a good start unless something is reflected.
        self.direct = self.single and "R" not in branch.events[:stretch]
        # Float32 holds the squares and products of radii that differ little.
        self.smooth = (
            min(radii) > 0.05
            and len(branch.interfaces) <= 8
            and (frame.eye_radius is None or 0.05 < frame.eye_radius < 1e3)
        )
        # Metres within which squares of coordinates keep in float32.
        self.widest = 1e15 * frame.scale
        self.guessable = frame.eye is not None

    # ---- limits -------------------------------------------------------------------------

    def upper_limit(self, zeta2, target_radius2=None):
        """Squared upper limit of |ℓ| so far, and the squared radius that sets it.

        The eye's radius limits ℓ too, and so does a target's, if it is given. What the path does
        after this stretch is no matter here, so that positions go on smoothly beyond the rays
        that take the whole path.
        """
        least = at = None
        for n2, r2 in (
            self.limits
            if target_radius2 is None
            else (
                *self.limits,
                (self.ior * self.ior, target_radius2),
            )
        ):
            value = (n2 - zeta2) * r2
            if least is None:
                least, at = value, r2
            else:
                at = np.where(value < least, r2, at)
                least = np.minimum(value, least)
        return least, at

    def taken(self, ell, zeta, sure=False) -> NDArray[np.bool_]:
        """Which rays take the whole branch; with `sure`, whatever rounding does to them."""
        ell2, zeta2 = ell * ell, zeta * zeta
        inside = zeta2 < self.domain.zeta_max**2
        near = far = 1.0
        if sure:
            margin = 2.0 * ROUNDING * max(1.0, self.eye_ior * (self.frame.eye_radius or 0.0))
            near, far = 1.0 - 2.0 * margin, 1.0 + 2.0 * margin
        for n2, r2 in self.domain.upper:
            inside &= ell2 < (n2 - zeta2) * (r2 * near)
        for n2, r2 in self.domain.lower:
            inside &= ell2 >= (n2 - zeta2) * (r2 * far)
        return inside

    # ---- rays ---------------------------------------------------------------------------

    def room(self, ell2, zeta2):
        """w² of all terms, a row a term, in the order of `rows`."""
        const, falls = self.rows.limits[ell2.dtype.itemsize]
        room = falls * zeta2
        np.subtract(const, room, out=room)
        room -= ell2
        return room

    def follow(self, ell, zeta, slopes=True) -> Line:
        """The line on which rays (ℓ, ζ) run in this stretch, with its derivatives."""
        ell2, zeta2 = ell * ell, zeta * zeta
        w = self.room(ell2, zeta2)
        return self._follow(ell, zeta, ell2, zeta2, w, w.min(initial=np.inf), slopes)

    def _within(self, ell, zeta):
        """Unknowns moved into the domain, with their squares and w² (arguments of `_follow`), and
        which of them were outside (None: no one)."""
        if self.rows.loose:
            ell, zeta = self.into_domain(ell, zeta)
        ell2, zeta2 = ell * ell, zeta * zeta
        w = self.room(ell2, zeta2)
        outside, least = None, w.min(initial=np.inf)
        if least <= SMALLEST:
            outside = np.flatnonzero((w <= SMALLEST).any(axis=0))
            ell, zeta = ell.copy(), zeta.copy()
            ell[outside], zeta[outside] = self.into_domain(ell[outside], zeta[outside])
            ell2, zeta2 = ell * ell, zeta * zeta
            w = self.room(ell2, zeta2)
            least = w.min()
        return (ell, zeta, ell2, zeta2, w, least), outside

    def _follow(self, ell, zeta, ell2, zeta2, w, least, slopes) -> Line:
        """`follow` with the squares, w² (overwritten) and the least of these at hand."""
        rows = self.rows
        pairs = rows.pairs
        floor = SMALLEST if w.dtype == np.float64 else NARROW[0]
        if least < floor:
            np.maximum(w, floor, out=w)
        np.sqrt(w, out=w)
        p2 = rows.squares[w.dtype.itemsize] - zeta2
        inverse = 1.0 / p2
        sums = np.empty((len(rows.media), len(ell)), dtype=w.dtype)
        spreads = np.empty_like(sums) if slopes else None
        for number in rows.untouched:
            sums[number] = 0.0
            if slopes:
                spreads[number] = 0.0
        eye_inverse = real = imag = None
        if pairs:
            # (first + iℓ)(second − iℓ), and the two quotients over one denominator
            first, second = w[: len(pairs)], w[len(pairs) : 2 * len(pairs)]
            products, gaps = first * second, second - first
            quotients = gaps / products if slopes else None
            for row, (medium, count, new, _) in enumerate(pairs):
                _add(sums[medium], gaps[row], -count, new)
                if slopes:
                    _add(spreads[medium], quotients[row], count, new)
            products += ell2
            gaps *= ell
            for row, (*_, factors) in enumerate(pairs):
                for _ in range(factors):
                    real, imag = _times(real, imag, products[row], gaps[row])
        for row, medium, count, new, factors in rows.singles:
            _add(sums[medium], w[row], count, new)
            if slopes:
                _add(spreads[medium], 1.0 / w[row], count, new)
            step = ell if count > 0 else -ell
            for _ in range(factors):
                real, imag = _times(real, imag, w[row], step)
        walls_real, walls_imag = real, imag
        for _ in range(self.power - 1 if real is not None else 0):
            real, imag = _times(real, imag, walls_real, walls_imag)
        if rows.eye is not None:
            row, medium, outward, new = rows.eye
            at_eye = w[row]
            real, imag = _times(real, imag, at_eye, ell if outward > 0 else -ell)
            _add(sums[medium], at_eye, outward, new)
            if slopes:
                eye_inverse = 1.0 / at_eye
                _add(spreads[medium], eye_inverse, outward, new)
        if real is None:
            real, imag = np.ones_like(ell), np.zeros_like(ell)
        norm = real * real
        norm += imag * imag
        if norm.min(initial=1.0) < 1e-30:
            np.maximum(norm, 1e-300 if norm.dtype == np.float64 else NARROW[1], out=norm)
        np.sqrt(norm, out=norm)
        np.divide(-1.0 if self.turn % 2 else 1.0, norm, out=norm)
        real = real * norm
        imag = imag * norm
        part = sums
        part *= inverse
        height = -_total(part)
        length = turn_ell = bend = height_zeta = 0.0
        if slopes:
            turn_ell = _total(spreads)
            spreads *= inverse
            bend = _total(spreads)
            part *= rows.squares[w.dtype.itemsize]
            spreads *= zeta2 * ell2
            part -= spreads
            part *= inverse
            height_zeta = -_total(part)
            bend *= ell
            bend *= zeta
        else:
            part *= rows.iors[w.dtype.itemsize]
            length = -_total(part)
        height *= zeta
        return Line(
            ell,
            zeta,
            np.sqrt(inverse[rows.own]),
            real,
            imag,
            height,
            length,
            turn_ell,
            bend,
            height_zeta,
            eye_inverse,
        )

    # ---- targets ------------------------------------------------------------------------

    def empty(self) -> bool:
        """Whether no ray takes the path at all."""
        zeta = self.frame.zeta
        return self.domain.zeta_max <= abs(zeta or 0.0)

    def targets(self, points: Floats, kind=np.float64) -> tuple[Floats, ...]:
        """Points in the frame: x, y, z in outer radii, moved radially into the medium."""
        frame = self.frame
        if kind is not np.float64 and not frame.spherical:
            return self._narrow_targets(points, kind)
        per = 1.0 / frame.scale
        if frame.spherical:
            scaled = points * per
            x = scaled @ frame.axes[0]
            y = np.sqrt(np.sum((scaled - x[:, None] * frame.axes[0]) ** 2, axis=-1))
            z = np.zeros(len(x))
        else:
            cosine, sine = (float(part) * per for part in frame.axes[0, :2])
            x = points[:, 0] * cosine + points[:, 1] * sine
            y = points[:, 1] * cosine - points[:, 0] * sine
            z = points[:, 2] * per
            if frame.eye is not None:
                z -= float(frame.eye[2])
        radius2 = x * x + y * y
        low = max(self.inner, TINY)
        if radius2.min(initial=np.inf) < low * low or radius2.max(initial=0.0) > self.outer**2:
            radius = np.hypot(x, y)
            on_axis = radius < TINY
            factor = np.clip(radius, low, self.outer) / np.where(on_axis, 1.0, radius)
            x, y = np.where(on_axis, -low, x * factor), np.where(on_axis, 0.0, y * factor)
        return tuple(part.astype(kind, copy=False) for part in (x, y, z))

    def _narrow_targets(self, points, kind):
        """`targets` for a cylinder, rounded as early as digits allow."""
        frame = self.frame
        per = 1.0 / frame.scale
        cosine, sine = (kind(part * per) for part in frame.axes[0, :2])
        flat_x, flat_y = points[:, 0].astype(kind), points[:, 1].astype(kind)
        z = np.empty(len(points), dtype=kind)
        # Here eye and point may be near each other and far from the origin.
        base = 0.0 if frame.eye is None else float(frame.eye[2]) * frame.scale
        np.subtract(points[:, 2], base, out=z, casting="same_kind")
        z *= kind(per)
        x, y = flat_x * cosine, flat_y * cosine
        x += flat_y * sine
        y -= flat_x * sine
        radius2 = x * x
        radius2 += y * y
        low, high = max(self.inner, TINY) ** 2, self.outer**2
        if radius2.min(initial=np.inf) <= low * 1.00001 or radius2.max(initial=0.0) >= high:
            radius = np.sqrt(radius2)
            on_axis = radius < TINY
            factor = np.clip(radius, kind(low**0.5), kind(self.outer))
            factor /= np.where(on_axis, kind(1.0), radius)
            x = np.where(on_axis, kind(-(low**0.5)), x * factor)
            y = np.where(on_axis, kind(0.0), y * factor)
        return x, y, z

    def from_directions(self, direction, x, y, z):
        """Invariants of rays that leave the eye along `direction` (N, 3), as a start.

        Components must lie between −1 and 1, or thereabouts.
        """
        frame, kind = self.frame, x.dtype.type
        if frame.spherical:
            along = sum(direction[:, axis] * part for axis, part in enumerate(frame.axes[0]))
            ell = np.sqrt(np.maximum(1.0 - along * along, 0.0))
            ell *= self.eye_ior * frame.eye_radius
            return ell.astype(kind), np.zeros(len(ell), dtype=kind)
        cosine, sine = (
            kind(part * self.eye_ior * frame.eye_radius) for part in frame.axes[0, :2].tolist()
        )
        ell = direction[:, 1].astype(kind)
        ell *= cosine
        zeta = direction[:, 0].astype(kind)
        zeta *= sine
        ell -= zeta
        np.multiply(direction[:, 2], self.eye_ior, out=zeta, casting="same_kind")
        return ell, zeta

    def start(self, x, y, z):
        """The invariants of the straight ray from the eye, moved into the domain."""
        frame = self.frame
        if frame.eye is None:
            zeta = np.full(len(x), frame.zeta, dtype=x.dtype)
            ell = np.sqrt(np.maximum(self.eye_ior**2 - zeta * zeta, 0.0)) * y
        else:
            away = x - frame.eye_radius
            away *= away
            away += y * y
            away += z * z
            np.sqrt(away, out=away)
            if not away.all():
                # A point at the eye lies in every direction.
                away[away == 0.0] = 1.0
            np.divide(self.eye_ior, away, out=away)
            zeta = z * away
            away *= y
            away *= frame.eye_radius
            ell = away
        return self.into_domain(ell, zeta, 0.95)

    def into_domain(self, ell, zeta, part=None):
        """The nearest invariants within `part` of the domain."""
        if part is None:
            part = 1.0 - 1e-12 if ell.dtype == np.float64 else 1.0 - 1e-6
        zeta2 = zeta * zeta
        end = part * self.zeta_max
        if self.frame.zeta is None and zeta2.max(initial=0.0) > end * end:
            zeta = np.clip(zeta, -end, end)
            zeta2 = zeta * zeta
        bound = self.upper_limit(zeta2)[0] * (part * part)
        if (ell * ell > bound).any():
            bound = np.sqrt(bound)
            ell = np.clip(ell, -bound, bound)
        return ell, zeta

    def step(self, ell, zeta, x, y, z):
        """One Newton step in both invariants, from within the domain; and its angle at the eye
        (inf where the start was outside)."""
        within, outside = self._within(ell, zeta)
        ell, zeta = within[:2]
        line = self._follow(*within, True)
        along, side = line.along(x, y)
        per = line.per
        # The residuals are linear in the target: distance from the line across, and along z.
        across = ell * per
        across += side
        a = line.turn_ell * along
        np.subtract(per, a, out=a)
        if self.frame.zeta is not None:
            if not a.all():
                a = np.where(a == 0.0, FLAT, a)
            np.divide(across, a, out=across)
            new_ell, new_zeta = ell - across, zeta
            change = np.abs(across, out=across)
            if self.eye_term is not None:
                change *= line.eye_inverse
        else:
            slope = zeta * per
            rise = slope * along
            rise += line.height
            rise -= z
            per2 = per * per
            b = per2 * ell
            b *= slope
            b -= line.turn_zeta * along
            slope *= side
            c = slope * line.turn_ell
            c += line.turn_zeta
            along *= per
            along *= per2
            along *= self.ior * self.ior
            along += line.height_zeta
            slope *= line.turn_zeta
            along += slope
            d = along
            determinant = a * d
            determinant -= b * c
            if not determinant.all():
                determinant = np.where(determinant == 0.0, FLAT, determinant)
            np.divide(-1.0, determinant, out=determinant)
            d *= across
            b *= rise
            d -= b
            d *= determinant
            a *= rise
            c *= across
            a -= c
            a *= determinant
            new_ell, new_zeta = ell + d, zeta + a
            # The angle at the eye: part along the axis and part across it.
            change = np.abs(a, out=a)
            if self.eye_ior == self.ior:
                change *= per
            else:
                change /= np.sqrt(self.eye_ior**2 - zeta * zeta)
            d *= line.eye_inverse
            change += np.abs(d, out=d)
        if self.finer != 1.0:
            change *= self.finer
        if outside is not None:
            change[outside] = np.inf
        return new_ell, new_zeta, change

    def orientation(self, side: int) -> int:
        """Sign of dF/dℓ on a leg for images that no caustic has turned over."""
        return self.eye_side * side

    def upright(self, ell, zeta, x, y, z) -> NDArray[np.bool_]:
        """Whether no caustic, or an even number, lies between the eye and each image."""
        line = self.follow(ell, zeta)
        along, side = line.along(x, y)
        per = line.per
        tilt = zeta * per
        determinant = (per - line.turn_ell * along) * (
            line.height_zeta + along * self.ior**2 * per**3 + tilt * line.turn_zeta * side
        ) - (ell * tilt * per**2 - line.turn_zeta * along) * (
            line.turn_zeta + tilt * line.turn_ell * side
        )
        return (determinant > 0.0) == (self.eye_side < 0)

    def _single(self) -> bool:
        """Whether every target has at most one image here, whatever its place.

        ∂ψ/∂ℓ at fixed ζ is Σ c/√(k² − ℓ²), k = P·r; its Taylor coefficients in ℓ² are positive
        multiples of Σ c / k^(2m+1). If these have one sign for all m and all ζ, no caustic
        exists in the plane problem, hence none at all: the plane path is a strict minimum (or
        maximum) of the optical length, which makes the height a monotone function of ζ. With
        less than a half turn on either side, no circle is met twice.
        """
        tilt = (np.linspace(0.0, 0.999, 5) * self.zeta_max) ** 2
        if self.frame.zeta is not None:
            tilt = np.array([self.frame.zeta**2])
        least = self.upper_limit(tilt)[0]
        exponents = 2.0 * MOMENTS + 1.0
        fixed = self._moments(self.terms, tilt, least, exponents)
        for side in self.sides:
            ends = []
            for radius in (self.inner, self.outer):
                target = Term(self.ior, radius, -side)
                if radius == math.inf:
                    ends.append(0.0)
                elif ((self.ior * self.ior - tilt) * radius**2 < least).any():
                    ends.append(-side * np.inf)  # the target itself is the limit there
                else:
                    ends.append(self._moments((target,), tilt, least, exponents))
            if not any(
                (sign * (fixed + end) >= -1e-12).all()
                for sign in (-1, 1)
                for end in [ends[1] if sign == -side else ends[0]]
            ):
                return False
        return True

    @staticmethod
    def _moments(terms, tilt, least, exponents):
        total = 0.0
        for term in terms:
            room = (term.ior * term.ior - tilt) * term.radius**2
            ratio = np.sqrt(least / room)
            total = total + term.count * ratio[:, None] ** exponents
        return total

    def crossings(self, ell, zeta, x, y, z):
        """z of every meeting on the whole path, in outer radii from the eye's height.

        In a parallel view from the frame's origin.
        """
        frame = self.frame
        ell2, zeta2 = ell * ell, zeta * zeta

        def way(ior, radius):
            p2 = ior * ior - zeta2
            return zeta * np.sqrt(np.maximum(p2 * (radius * radius) - ell2, 0.0)) / p2

        if frame.eye is None:
            line = self.follow(ell, zeta, slopes=False)
            along, _ = line.along(x, y)
            level = z - line.height - zeta * along * line.per
        else:
            level = -self.eye_side * way(self.eye_ior, frame.eye_radius)
        for number, interface in enumerate(self.branch.interfaces):
            before, after = self.branch.stretches[number : number + 2]
            radius = self.radii[interface]
            level = level - before.leaves * way(self.media[before.medium], radius)
            yield level
            level = level + after.enters * way(self.media[after.medium], radius)

    # ---- images -------------------------------------------------------------------------

    def image(self, unknowns, targets, points, miss: float, view: View):
        """Write what the eye sees along rays (ℓ, ζ).

        A third unknown is the leg (−1 before the foot, 1 after it) on which the image lies, where
        the ray meets the target's radius; without it, it lies nearest to the target.
        Returns which rays pass their targets, and which of them take the whole path too.
        """
        frame, scale = self.frame, self.frame.scale
        ell, zeta, *leg = unknowns
        x, y, z = targets
        if leg:
            line = self.follow(ell, zeta, slopes=False)
        else:
            within, _ = self._within(ell, zeta)
            ell, zeta = within[:2]
            line = self._follow(*within, False)
        along, across, rise = line.misses(x, y, z)
        per = line.per
        if leg:
            off = ell * per
            along = leg[0] * np.sqrt(np.maximum(x * x + y * y - off * off, 0.0))
        residual = across * across
        if frame.zeta is None:  # else the ray's height is free, or no matter in a sphere
            rise /= per
            rise *= 1.0 / self.ior
            rise *= rise
            residual += rise
        np.sqrt(residual, out=residual)
        length = along * per
        length *= self.ior
        length += line.length
        if ell.dtype == np.float64:
            away = x if frame.eye is None else x - frame.eye_radius
            reach = 1.0 + np.sqrt(away * away + y * y + z * z)
            # Along the axis P² = n² − ζ² keeps few digits, and with it the height of the meeting;
            # the ray passes the point by that times the sine of its angle with the axis.
            blurred = 1e-15 * self.eye_ior**2 / (self.zeta_max**2 - zeta * zeta)
            blurred /= self.ior * per
            passes = residual <= miss * np.minimum(reach, FAR) + (1e-12 + blurred) * reach
        else:
            passes = residual <= miss * np.minimum(1.0 + length, FAR)
        if not leg and len(self.sides) == 1:
            passes &= along * self.sides[0] >= 0.0
        if frame.eye is None:
            self._write_parallel(ell, zeta, line, along, z, length, residual, points, view)
        else:
            self._write_perspective(ell, zeta, length, residual, points, view)
        if miss <= SHARP:
            self._resolved(ell, zeta, targets, length, passes, points, view)
        valid = self.taken(ell, zeta, sure=miss <= SHARP) & passes
        if self.extent is not None:
            start = 0.0 if frame.eye is None else float(frame.eye[2])
            low, high = (end / scale - start for end in self.extent)
            for level in self.crossings(ell, zeta, x, y, z):
                valid &= (level >= low) & (level <= high)
        return passes, valid

    def _resolved(self, ell, zeta, targets, length, passes, points, view) -> None:
        """Unset `passes` where float64 cannot tell a direction that meets the target.

        Near the edge of the domain the line turns by ∂ψ/∂ℓ ~ 1/w: there the last digit of the
        direction at the eye moves the far end of the ray. Up to `RESOLVED` that is no matter, and
        up to `DOUBTFUL` following the ray itself decides.
        """
        upper2, _ = self.upper_limit(zeta * zeta)
        close = np.flatnonzero(passes & (upper2 - ell * ell < 1e-9 * upper2))
        if not len(close):
            return
        line = self.follow(ell[close], zeta[close])
        along, _ = line.along(*(target[close] for target in targets[:2]))
        slope = np.abs(line.per - line.turn_ell * along)
        digit = ROUNDING * self.eye_ior * (self.frame.eye_radius or 1.0)
        reach = np.maximum(length[close], 1e-3)
        if self.frame.eye_radius is None:
            reach = 1.0
        moved = slope * digit / reach
        passes[close] = moved <= RESOLVED
        if self.frame.eye is not None:
            doubtful = close[(moved > RESOLVED) & (moved <= DOUBTFUL)]
            passes[doubtful] = self._traced(doubtful, points, length, view)

    def _traced(self, which, points, length, view) -> NDArray[np.bool_]:
        """Whether the rays written for some points take the path and pass them, traced forward."""
        directions = view.directions(which)
        eye = self.frame.eye * self.frame.scale
        good = trace(self.glass, eye, directions, self.branch.events).valid
        taken = np.flatnonzero(good)
        rays, _ = start(self.glass, eye, directions[taken])
        for event in self.branch.events[: self.number]:
            rays, _ = advance(self.glass, rays, meet(self.glass, rays), event)
        towards = points[which[taken]] - rays.origin
        towards -= np.sum(towards * rays.direction, axis=1)[:, None] * rays.direction
        miss = np.sqrt(np.sum(towards * towards, axis=1))
        good[taken] = miss <= RESOLVED * length[which[taken]] * self.frame.scale
        return good

    def _basis(self, points):
        """Components of the frame's x and y axes: numbers, or (N,) arrays for spheres."""
        if self.frame.spherical:
            return self.frame.axes[0], self._sideways(points).T
        return self.frame.axes[0], self.frame.axes[1]

    def _write_perspective(self, ell, zeta, length, residual, points, view) -> None:
        frame = self.frame
        first, second = self._basis(points)
        per = 1.0 / (frame.eye_radius * self.eye_ior)
        # In float64, so that directions are unit vectors to the last digits whatever the tolerance.
        ell, zeta = (part.astype(np.float64, copy=False) for part in (ell, zeta))
        # n·d is w/r along the radius of the eye, ℓ/r across it and ζ along the axis.
        w = zeta * zeta
        np.subtract(self.eye_ior**2, w, out=w)
        w *= frame.eye_radius**2
        w -= ell * ell
        np.maximum(w, 0.0, out=w)
        np.sqrt(w, out=w)
        w *= self.eye_side * per
        turned = ell * per
        distance = length.astype(np.float64)
        distance *= frame.scale
        direction, position = view.room()
        for a, b, part in zip(first.tolist(), second, direction, strict=True):
            np.multiply(turned, b, out=part)
            part += w * a
        if not frame.spherical:
            np.multiply(zeta, 1.0 / self.eye_ior, out=direction[2])
        for origin, part, place in zip(frame.eye.tolist(), direction, position, strict=True):
            np.multiply(distance, part, out=place)
            place += origin * frame.scale
        residual *= frame.scale
        view.write(direction, distance, position, residual)

    def _write_parallel(self, ell, zeta, line, along, z, length, residual, points, view) -> None:
        frame = self.frame
        _, second = self._basis(points)
        off = ell / np.sqrt(self.eye_ior**2 - zeta * zeta)
        foot = [off * b for b in second]
        if not frame.spherical:
            foot[2] = z - line.height - zeta * along * line.per
        position = [
            frame.scale * (f + length * d) for f, d in zip(foot, frame.direction, strict=True)
        ]
        distance = sum(p * d for p, d in zip(position, frame.direction, strict=True))
        view.write(frame.direction, distance, position, residual * frame.scale)

    def _sideways(self, points):
        """For spheres: the unit direction of y of each point, (N, 3)."""
        axis = self.frame.axes[0]
        across = points - (points @ axis)[:, None] * axis
        across = across - (across @ axis)[:, None] * axis
        size = np.sqrt(np.sum(across * across, axis=-1))
        # On the axis any perpendicular will do.
        other, _ = perpendiculars(axis)
        lost = size < TINY * self.frame.scale
        unit = across / np.where(lost, 1.0, size)[:, None]
        return np.where(lost[:, None], other, unit)


MOMENTS = np.unique(np.concatenate([np.arange(6), np.geomspace(6, 1e8, 26).round()]))
"""Orders at which `CoaxialPassage.single` looks; thin walls need high ones."""

COARSE = 5e-6
"""Tolerance in radians above which float32 will do to the end."""

SHARP = 1e-8
"""Tolerance in radians below which images are held to what float64 can resolve."""

RESOLVED = 1e-10
"""Angle in radians, below 1e-6 px at a focal length of 2400 px, that the last digit of a direction
may move the point it meets."""

DOUBTFUL = 8e-10
"""The same, up to which most such directions still meet their point, by less than `RESOLVED`."""

ROUNDING = 3e-16
"""What rounding does to the components of a direction."""

FAR = 100.0
"""Outer radii beyond which distance no longer excuses an error."""


SMALLEST = 1e-44
"""Floor of w², so that 1/w stays finite at the edge of a domain. It is below what rounding leaves
of w² at an eye on the axis, which counts as `TINY` off it."""

NARROW = 1e-12, 1e-34
"""The same in float32, and its floor of the squared modulus of a turn."""

FLAT = 1e-30
"""Stands for a determinant of 0, on a caustic: the step then ends at the edge of the domain."""


def _total(rows):
    """The sum of the rows, as an array of its own."""
    if len(rows) == 1:
        return rows[0].copy()
    total = rows[0] + rows[1]
    for row in rows[2:]:
        total += row
    return total


def _add(total, value, count: int, new: bool) -> None:
    """Add `count` times a value to a row, or write it there."""
    if new:
        np.multiply(value, count, out=total)
    elif count == 1:
        total += value
    elif count == -1:
        total -= value
    else:
        total += count * value


def _times(real, imag, other_real, other_imag):
    """Product of two complex arrays given by their parts; the first may be None, for 1."""
    if real is None:
        return other_real, other_imag
    product, turned = real * other_real, real * other_imag
    product -= imag * other_imag
    turned += imag * other_real
    return product, turned


@dataclass(frozen=True)
class Line:
    """Where rays run in one stretch: transverse direction, foot, and derivatives.

    `per`: 1/P. `ux`, `uy`: unit transverse direction. `height`, `length`: z and geometric length at
    the foot (the point nearest the axis). `turn_ell` = ∂ψ/∂ℓ, `turn_zeta` = ∂ψ/∂ζ = ∂height/∂ℓ,
    `height_zeta` = ∂height/∂ζ; `eye_inverse` = 1/w at the eye. `length` is left 0 where slopes were
    asked for, and the slopes where they were not.
    """

    ell: Floats
    zeta: Floats
    per: Floats
    ux: Floats
    uy: Floats
    height: Floats
    length: Floats
    turn_ell: Floats | float
    turn_zeta: Floats | float
    height_zeta: Floats | float
    eye_inverse: Floats | None

    def misses(self, x, y, z):
        """Way from the foot to a target, and its distances from the line across and along z."""
        along, side = self.along(x, y)
        across = self.ell * self.per
        across += side
        rise = self.zeta * self.per
        rise *= along
        rise += self.height
        rise -= z
        return along, across, rise

    def along(self, x, y):
        """Coordinates of a target along the line and across it."""
        along, side = self.ux * x, self.ux * y
        along += self.uy * y
        side -= self.uy * x
        return along, side
