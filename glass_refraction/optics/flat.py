# SPDX-License-Identifier: GPL-3.0-or-later
"""Equations of flat layers: one unknown decides a whole path.

The tangential part κ of the optical momentum n·d is the same in every layer. A target at the
lateral distance u from the eye, reached through the vertical ways h_j in media n_j, is seen where

    Σ h_j tan θ_j = u,   tan θ_j = κ / √(n_j² − κ²).

The unknown is x = tan θ in the thinnest medium passed, which knows no bound: each term is
h·x / √(a + (a − 1) x²) with a = (n_j / n_thinnest)², increasing and concave. Newton's steps from
the left of the root then rise to it and never overshoot. For one pane in air this is equation (5)
of Mukai, Makino and Chang (MODSIM 2013), written without its 0 · ∞ at normal incidence.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .glasses import FlatGlass
from .images import View
from .outlines import in_polygon
from .paths import Branch, ParallelView

Floats = NDArray[np.float64]


class FlatPassage:
    """One stretch of one branch through flat layers, for one viewpoint."""

    direct = True  # exactly one image a point
    smooth = guessable = False  # a start this good gains nothing from either
    solved = 3
    most = 40

    def __init__(
        self, glass: FlatGlass, eye: Floats | ParallelView, branch: Branch, stretch: int
    ) -> None:
        self.glass = glass
        heights = glass.heights
        media = glass.media
        self.branch, self.number = branch, stretch
        self.stretch = branch.stretches[stretch]
        self.heading = branch.stretches[0].enters
        self.eye_ior = media[branch.stretches[0].medium]
        self.ior = media[self.stretch.medium]
        edges = np.array((np.inf, *heights, -np.inf))
        self.top, self.bottom = edges[self.stretch.medium], edges[self.stretch.medium + 1]
        self.begin = float(heights[branch.interfaces[stretch - 1]])
        self.parallel = isinstance(eye, ParallelView)
        # Vertical ways in each medium before this stretch, and the planes met on the way.
        ways: dict[float, float] = {}
        self.met: list[tuple[float, float]] = []
        if self.parallel:
            self.direction = np.asarray(eye.direction)
            level = float(heights[branch.interfaces[0]])
        else:
            self.eye = eye
            level = float(eye[2])
        self.level = level
        for number, interface in enumerate(branch.interfaces):
            height = float(heights[interface])
            ior = media[branch.stretches[number].medium]
            self.met.append((ior, height))
            if number < stretch:
                ways[ior] = ways.get(ior, 0.0) + abs(height - level)
            level = height
        ways.setdefault(self.ior, 0.0)
        self.ways = tuple(sorted(ways.items()))
        # The thinnest medium of the stretches passed bounds κ here, that of the whole path there.
        self.thinnest = self.ways[0][0]
        self.limit = min(media[piece.medium] for piece in branch.stretches)

    # ---- targets ------------------------------------------------------------------------

    def empty(self) -> bool:
        """Whether no ray takes the path at all."""
        return self.parallel and self.seen_along() is None

    def targets(self, points: Floats) -> tuple[Floats, ...]:
        """Lateral distance, vertical way in the last medium, a floor of x, and unit direction.

        Points outside the medium are moved vertically to its nearest interface.
        """
        z = np.clip(points[:, 2], self.bottom, self.top)
        way = np.abs(z - self.begin)
        if self.parallel:
            across_x, across_y = self.direction[:2, None] * np.ones(len(points))
        else:
            across_x, across_y = points[:, 0] - self.eye[0], points[:, 1] - self.eye[1]
        lateral = np.hypot(across_x, across_y)
        inverse = 1.0 / np.where(lateral > 0.0, lateral, 1.0)
        floor = self._floor(lateral, way)
        return lateral, way, floor, across_x * inverse, across_y * inverse

    def _terms(self, way):
        for ior, fixed in self.ways:
            yield ior, (ior / self.thinnest) ** 2, fixed + way if ior == self.ior else fixed

    def start(self, lateral, way, floor):
        """Where Newton's steps begin: left of the root, from where they rise to it."""
        return (floor.copy(),)

    def _floor(self, lateral, way):
        """A point left of the root: the larger of two lower bounds of it."""
        if self.parallel:
            return np.full(len(lateral), self.seen_along())
        total, bounded, thin = 0.0, 0.0, 0.0
        for _, a, height in self._terms(way):
            total = total + height
            if a > 1.0:
                bounded = bounded + height / math.sqrt(a - 1.0)
            else:
                thin = thin + height
        # Each term is at most h·x, and the terms of denser media are at most h / √(a − 1).
        total = np.maximum(total, SHORTEST)
        start = np.maximum(lateral / total, (lateral - bounded) / np.maximum(thin, SHORTEST))
        return np.minimum(start, STEEPEST)

    def step(self, x, lateral, way, floor):
        """One Newton step; `floor` is a known lower bound. Returns x and the change in angle."""
        if self.parallel:
            return x, np.zeros(len(x))
        offset, slope = -lateral, 0.0
        x2 = x * x
        for _, a, height in self._terms(way):
            inverse = 1.0 / (a + (a - 1.0) * x2)
            tangent = height * np.sqrt(inverse)
            offset = offset + tangent * x
            slope = slope + tangent * inverse * a
        new = x - offset / np.maximum(slope, SHORTEST)
        new = np.clip(new, floor, STEEPEST)
        return new, np.abs(new - x) / (1.0 + x2)

    # ---- images -------------------------------------------------------------------------

    def steepest(self) -> float:
        """The x beyond which no ray takes the whole path."""
        if self.limit >= self.thinnest:
            return STEEPEST
        return self.limit / math.sqrt((self.thinnest - self.limit) * (self.thinnest + self.limit))

    def seen_along(self) -> float | None:
        """The x of a parallel view; None where its rays do not take this path."""
        across = math.hypot(self.direction[0], self.direction[1])
        kappa = self.eye_ior * across
        if kappa >= self.limit or self.direction[2] * self.heading >= 0.0:
            return None
        return kappa / math.sqrt((self.thinnest - kappa) * (self.thinnest + kappa))

    def _cosine(self, ior, x2):
        a = (ior / self.thinnest) ** 2
        return np.sqrt((a + (a - 1.0) * x2) / (a * (1.0 + x2)))

    def image(self, unknowns, targets, points, miss: float, view: View):
        """Write what the eye sees of targets.

        Returns which points need no further search (all), and which have an image.
        """
        lateral, way, _, unit_x, unit_y = targets
        steepest = self.steepest()
        x = np.minimum(unknowns[0], steepest)
        x2 = x * x
        offset, length = 0.0, 0.0
        for ior, a, height in self._terms(way):
            offset = offset + height * (x / np.sqrt(a + (a - 1.0) * x2))
            length = length + height / self._cosine(ior, x2)
        sine = (self.thinnest / self.eye_ior) * x / np.sqrt(1.0 + x2)
        down = -self.heading * self._cosine(self.eye_ior, x2)
        direction = sine * unit_x, sine * unit_y, down
        if self.parallel:
            origin = points[:, 0] - offset * unit_x, points[:, 1] - offset * unit_y, self.level
            direction = self.direction
            distance = length + sum(o * d for o, d in zip(origin, direction, strict=True))
            residual = 0.0
        else:
            origin, distance = self.eye, length
            residual = np.abs(offset - lateral) * self._cosine(self.ior, x2)
        position = [o + length * d for o, d in zip(origin, direction, strict=True)]
        view.write(direction, distance, position, residual)
        valid = (unknowns[0] < steepest) & (residual <= miss * length + SHORTEST)
        if self.glass.outline is not None:
            for at_x, at_y in self.crossings(x, way, unit_x, unit_y, points):
                valid &= in_polygon(self.glass.outline, at_x, at_y)
        return np.ones(len(x), dtype=bool), valid

    def crossings(self, x, way, unit_x, unit_y, points):
        """x and y of every interface that the path meets, the stretches to come included."""
        sine = self.thinnest * x / np.sqrt(1.0 + x * x)
        if self.parallel:
            offset = sum(h * (x / np.sqrt(a + (a - 1.0) * x * x)) for _, a, h in self._terms(way))
            at_x, at_y = points[:, 0] - offset * unit_x, points[:, 1] - offset * unit_y
        else:
            at_x, at_y = self.eye[:2, None] * np.ones(len(x))
        level = self.level
        for ior, height in self.met:
            room = np.maximum((ior - sine) * (ior + sine), SHORTEST)
            tangent = abs(height - level) * sine / np.sqrt(room)
            at_x, at_y = at_x + tangent * unit_x, at_y + tangent * unit_y
            level = height
            yield at_x, at_y


SHORTEST = 1e-200
"""Floor of vertical ways and slopes in metres: keeps quotients finite on an interface."""

STEEPEST = 1e140
"""Largest tangent; its square is finite."""
