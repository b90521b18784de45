# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights and lengths of paths through cylinders and spheres, from a ray's invariants alone.

With w_j = √(P_j² r² − ℓ²) on either side of an interface of radius r, the cosines of the angles
with its normal are w_j / (r·n_j), so that Fresnel's amplitudes are (w_a − w_b) / (w_a + w_b) and
(n_b² w_a − n_a² w_b) / (n_b² w_a + n_a² w_b): the same wherever the ray meets that interface, and
from either side. A path's weight is then a product of powers, and which path a ray takes follows
from comparing ℓ² with the P_j² r². Invariants as in `coaxial`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from .coaxial import taken_branches
from .glasses import CylinderGlass, SphereGlass
from .paths import Branch, Stretch

Floats = NDArray[np.float64]


class RadialWeights:
    """Weights of some paths for rays that start in one medium of a coaxial glass."""

    def __init__(
        self, glass: CylinderGlass | SphereGlass, medium: int, wanted: Iterable[str]
    ) -> None:
        self.glass, self.medium = glass, medium
        self.radii = [radius / glass.radius[0] for radius in glass.radius]
        self.wanted = tuple(wanted)
        self.branches = [
            (name, branch, domain)
            for name in self.wanted
            if name
            for branch, domain in taken_branches(glass, medium, name)
        ]

    def weights(self, origins: Floats, directions: Floats) -> Iterator[tuple] | None:
        """(events, indices of rays, weights) of complete paths; None for rays out of range.

        `origins` (3,) or (M, 3), finite; `directions` (M, 3), not unit.
        """
        rays = _Rays.of(self.glass, self.medium, self.radii, origins, directions)
        return None if rays is None else self._weights(rays)

    def lengths(self, origins: Floats, directions: Floats) -> Iterator[tuple] | None:
        """(indices of rays, lengths, media) branch by branch; None for rays out of range.

        Lengths (S, rays) in metres and media (S, 1) of the stretches between the path's events.
        """
        rays = _Rays.of(self.glass, self.medium, self.radii, origins, directions)
        return None if rays is None else self._lengths(rays)

    def _weights(self, rays: _Rays) -> Iterator[tuple]:
        if "" in self.wanted:
            missed = np.flatnonzero(~rays.meets_first())
            yield "", missed, np.ones(len(missed))
        for met, on, name, branch, index in self._taken(rays):
            whole = len(index) == len(met.ell2)
            weight = np.ones(len(index))
            for (interface, event), count in Counter(
                zip(branch.interfaces, branch.events, strict=True)
            ).items():
                share = met.reflectance(interface)
                share = share if whole else share[index]
                share = share if event == "R" else 1.0 - share
                for _ in range(count):
                    weight *= share
            yield name, (index if on is None else on[index]), weight

    def _lengths(self, rays: _Rays) -> Iterator[tuple]:
        for met, on, _, branch, index in self._taken(rays):
            inner = branch.stretches[1:-1]
            ends = zip(inner, branch.interfaces, branch.interfaces[1:], strict=False)
            lengths = np.empty((len(inner), len(index)))
            for row, (stretch, begin, end) in enumerate(ends):
                lengths[row] = met.between(stretch, begin, end)[index]
            media = np.array([[stretch.medium] for stretch in inner], dtype=np.intp)
            yield (index if on is None else on[index]), lengths, media.reshape(-1, 1)

    def _taken(self, rays: _Rays) -> Iterator[tuple]:
        """Which rays take which branch: rays met, their indices, events, branch, which of them."""
        on = None
        if self.medium == 0:
            on = np.flatnonzero(rays.meets(0) & rays.inward)
            rays = rays.take(on)
        if not len(rays.ell2):
            return
        for name, branch, domain in self.branches:
            heading = branch.stretches[0].enters > 0
            taken = rays.inward if heading else ~rays.inward
            taken = taken & rays.moving
            for n2, r2 in domain.upper:
                taken &= rays.ell2 < rays.room(n2, r2)
            for n2, r2 in domain.lower:
                taken &= rays.ell2 >= rays.room(n2, r2)
            if self.glass.__class__ is CylinderGlass and self.glass.extent is not None:
                low, high = self.glass.extent
                for level in rays.crossings(branch):
                    taken &= (level >= low) & (level <= high)
            index = np.flatnonzero(taken)
            if len(index):
                yield rays, on, name, branch, index


class _Rays:
    """Invariants of rays, lengths in outer radii; what follows from them is kept."""

    @classmethod
    def of(cls, glass, medium, radii, origins, directions) -> _Rays | None:
        axes = 2 if isinstance(glass, CylinderGlass) else 3
        scale = 1.0 / glass.radius[0]
        x, y, z = (origins[..., axis] * scale for axis in range(3))
        dx, dy, dz = (np.ascontiguousarray(directions[:, axis]) for axis in range(3))
        # Squares must neither overflow nor vanish, and a ray needs a direction.
        with np.errstate(over="ignore", invalid="ignore"):
            flat = dx * dx + dy * dy
            square = flat + dz * dz
        if not ((square > 1e-200) & (square < 1e200)).all():
            return None
        rays = object.__new__(cls)
        ior2 = glass.media[medium] ** 2
        turning = x * dy - y * dx
        along = x * dx + y * dy
        rays.media2 = [ior * ior for ior in glass.media]
        rays.own2, rays.medium, rays.radii, rays.scale = ior2, medium, radii, glass.radius[0]
        rays.extent = getattr(glass, "extent", None)
        per = ior2 / square
        rays.ell2 = turning * turning
        if axes == 3:
            rays.ell2 += (y * dz - z * dy) ** 2 + (z * dx - x * dz) ** 2
            along += z * dz
            rays.momentum2 = None
        else:
            rays.momentum2 = flat * per
        rays.ell2 *= per
        rays.inward = along < 0.0
        # A ray along the axis meets no wall.
        rays.moving = np.ones(1, dtype=bool) if axes == 3 else flat > 1e-300 * square
        if rays.extent is not None:
            rays.slope = dz / np.where(rays.moving, flat, 1.0)  # ζ / P² · momentum
            rays.foot = (z - along * rays.slope) * rays.scale
            rays.zeta = dz * np.sqrt(per)
        rays._reflectance, rays._radial = {}, {}
        return rays

    def take(self, which) -> _Rays:
        part = object.__new__(_Rays)
        part.__dict__.update(self.__dict__)
        part._reflectance, part._radial = {}, {}
        names = ["ell2", "inward"]
        if self.momentum2 is not None:
            names += ["momentum2", "moving"]
        if self.extent is not None:
            names += ["foot", "zeta"]
        for name in names:
            setattr(part, name, getattr(self, name)[which])
        return part

    def squared(self, n2: float):
        """P² in a medium of squared index n2."""
        if self.momentum2 is None:
            return n2
        return self.momentum2 if n2 == self.own2 else self.momentum2 + (n2 - self.own2)

    def room(self, n2: float, r2: float):
        """The limit of ℓ² at a radius."""
        return self.squared(n2) * r2

    def meets(self, interface: int) -> NDArray[np.bool_]:
        """Which rays would meet an interface from their own medium, on their way inward."""
        return (self.ell2 < self.room(self.own2, self.radii[interface] ** 2)) & self.moving

    def meets_first(self) -> NDArray[np.bool_]:
        """Which rays meet a face at all, within the extent."""
        innermost = self.medium == len(self.radii)
        nothing = np.zeros(len(self.ell2), dtype=bool)
        deeper = nothing if innermost else self.inward & self.meets(self.medium)
        met = deeper if self.medium == 0 else self.moving | nothing
        if self.extent is None:
            return met
        low, high = self.extent
        if innermost:
            level = self.foot + self.way(self.medium, self.medium - 1)
        else:
            level = self.foot - self.way(self.medium, self.medium)
            if self.medium > 0:
                level = np.where(deeper, level, self.foot + self.way(self.medium, self.medium - 1))
        return met & (level >= low) & (level <= high)

    def radial(self, medium: int, interface: int) -> Floats:
        """w in a medium at an interface's radius, 0 where it is not reached."""
        key = medium, interface
        if key not in self._radial:
            w = self.room(self.media2[medium], self.radii[interface] ** 2) - self.ell2
            np.maximum(w, 0.0, out=w)
            self._radial[key] = np.sqrt(w, out=w)
        return self._radial[key]

    def way(self, medium: int, interface: int) -> Floats:
        """Height gained in a medium between a ray's foot and an interface, metres."""
        p2 = np.maximum(self.squared(self.media2[medium]), 1e-300)
        return self.zeta * self.radial(medium, interface) * self.scale / p2

    def between(self, stretch: Stretch, begin: int, end: int) -> Floats:
        """Geometric length of a stretch between two interfaces, metres."""
        n2 = self.media2[stretch.medium]
        w = stretch.enters * self.radial(stretch.medium, begin)
        w = w - stretch.leaves * self.radial(stretch.medium, end)
        w *= self.scale * n2**0.5
        return np.maximum(w / np.maximum(self.squared(n2), 1e-300), 0.0)

    def crossings(self, branch: Branch) -> Iterator[Floats]:
        """z of every meeting on a branch, metres."""
        level = self.foot
        for number, interface in enumerate(branch.interfaces):
            before, after = branch.stretches[number : number + 2]
            level = level - before.leaves * self.way(before.medium, interface)
            yield level
            level = level + after.enters * self.way(after.medium, interface)

    def reflectance(self, interface: int) -> Floats:
        """Fresnel's unpolarised reflectance at an interface, from either side."""
        if interface not in self._reflectance:
            a, b = self.media2[interface], self.media2[interface + 1]
            first = np.maximum(self.radial(interface, interface), 1e-150)
            second = self.radial(interface + 1, interface)
            perpendicular = (first - second) / (first + second)
            first = first * b
            second = second * a
            parallel = (first - second) / (first + second)
            perpendicular *= perpendicular
            parallel *= parallel
            perpendicular += parallel
            perpendicular *= 0.5
            self._reflectance[interface] = perpendicular
        return self._reflectance[interface]
