# SPDX-License-Identifier: GPL-3.0-or-later
"""One path through a glass of revolution: its rays by their unknowns, and Newton's method on them.

A ray is told by where it meets the first interface, and Newton's steps are taken along that
surface. So no direction is special, neither along the axis nor through it; rays that graze the
first interface are regular (told by their direction they would not be: there a path's end moves as
the square root of it); and a parallel view differs from an eye by its slopes only. A target q, seen
on a stretch whose line runs through o with momentum p, leaves e = q − o − t p; with A and B the
slopes of o + t p by the two unknowns, the step is

    δa = (e × B) · p / D,  δb = (A × e) · p / D,  D = (A × B) · p,

and D = 0 on caustics. The sign of D tells whether the image is upright.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .axial import AxialGlass, Steps, viewpoint
from .profiles import Profile
from .surfaces import LEAST, SKIN, Floats, Rays, cross

Unknowns = tuple[Floats, ...]
"""Places on the first interface: x, y, z and what else its surface needs, each (M,)."""

Marks = list
"""For every event what its surface knows of the meetings: (2, M), or None; see `Profile`."""


@dataclass(frozen=True)
class Stage:
    """What a path does at one interface, as numbers."""

    surface: object
    back: bool
    gain: float | None
    number: int


@dataclass
class Course:
    """A path as one bundle of rays takes it.

    `lines`: the rays on each stretch. `ways`: to the interface at the end of each (along the
    momentum). `lengths`: geometric, to the begin of each stretch. `exists`: the ray meets all
    the interfaces looked at, these being endless. `marks`: of all meetings.
    """

    lines: list[Rays]
    ways: list[Floats]
    lengths: list[Floats | float]
    exists: NDArray[np.bool_]
    marks: Marks


class Passage:
    """A path through a glass from one viewpoint; lengths in units of `glass.scale`."""

    def __init__(self, glass: AxialGlass, eye, steps: Steps, is_open: bool = False) -> None:
        self.glass, self.steps, self.open = glass, steps, is_open
        self.view = viewpoint(glass, eye)
        medium = self.view.medium
        stages, media = [], [medium]
        for name, event in steps:
            interface = glass.named(name)
            if interface.opaque or medium not in (interface.front, interface.back):
                stages = None
                break
            number = glass.interfaces.index(interface)
            beyond = interface.beyond(medium)
            gain = None if event == "R" else glass.media[beyond] ** 2 - glass.media[medium] ** 2
            stages.append(Stage(interface.surface, interface.back == medium, gain, number))
            medium = medium if event == "R" else beyond
            media.append(medium)
        self.possible = stages is not None and (is_open or medium == 0)
        self.stages = tuple(stages or ())
        self.media = tuple(media)
        self.ior = glass.media[self.view.medium]
        self.first = self.stages[0].surface if self.stages else None
        self.away = 2.0 + 2.0 * sum(abs(end) for end in glass.hull)

    def upright_sign(self, stretch: int) -> float:
        """The sign that D has on a stretch for upright images."""
        sign = 1.0 if self.stages[0].back else -1.0  # how the first surface's tangents turn
        mirrors = sum(event == "R" for _, event in self.steps[:stretch])
        return -sign if mirrors % 2 else sign

    # ---- rays ---------------------------------------------------------------------------

    def directions(self, unknowns: Unknowns) -> tuple[tuple, Floats]:
        """Unit directions of the rays that meet the first interface there, and their lengths.

        In a parallel view lengths count from a plane `away` before the origin.
        """
        if self.view.parallel:
            direction = self.view.direction
            ahead = sum(q * d for q, d in zip(unknowns[:3], direction, strict=True))
            same = np.ones_like(ahead)
            return tuple(part * same for part in direction), ahead + self.away
        towards = tuple(q - e for q, e in zip(unknowns[:3], self.view.eye, strict=True))
        length = np.sqrt(sum(part * part for part in towards))
        per = 1.0 / np.maximum(length, LEAST)
        return tuple(part * per for part in towards), length

    def begin(self, unknowns: Unknowns, slopes: bool):
        """The rays at the first interface, before it, which come from its right side, and their
        lengths up to there."""
        n, stage = self.ior, self.stages[0]
        direction, length = self.directions(unknowns)
        normal = self.first.normal(*unknowns)
        outward = sum(d * part for d, part in zip(direction, normal, strict=True))
        exists = (outward > 0.0) if stage.back else (outward < 0.0)
        tilts = []
        if slopes:
            per = n / np.maximum(length, LEAST)
            for tangent in self.first.tangents(*unknowns):
                if self.view.parallel:
                    tilts.append((*tangent, 0.0, 0.0, 0.0))
                    continue
                along = sum(t * d for t, d in zip(tangent, direction, strict=True))
                turned = ((t - along * d) * per for t, d in zip(tangent, direction, strict=True))
                tilts.append((*tangent, *turned))
        momentum = tuple(n * part for part in direction)
        return Rays(tuple(unknowns[:3]), momentum, tuple(tilts)), exists, length

    def _from_eye(self, rays: Rays, length: Floats) -> Rays:
        """The rays of the first stretch, from where they begin."""
        pairs = zip(rays.place, rays.momentum, strict=True)
        return Rays(tuple(q - length * (p / self.ior) for q, p in pairs), rays.momentum)

    def _meet(self, number: int, rays: Rays, unknowns: Unknowns, marks):
        """Way to the interface of an event, which rays meet it, its mark, and where on a curve."""
        stage = self.stages[number]
        if not number:
            way, ahead, mark = 0.0, True, np.stack([unknowns[3]] * 2) if len(unknowns) > 3 else None
        elif not isinstance(stage.surface, Profile):
            return *stage.surface.meet(rays, stage.back), None, None
        else:
            known = None if marks is None else marks[number]
            way, ahead, mark = stage.surface.meet_at(rays, stage.back, known)
        return way, ahead, mark, None if mark is None else mark[1]

    def line(self, unknowns: Unknowns, stretch: int, marks: Marks | None = None):
        """The rays on one stretch, with slopes, which of them come so far, and their marks."""
        # Rays that do not exist may overflow.
        with np.errstate(all="ignore"):
            rays, exists, _ = self.begin(unknowns, True)
            seen = []
            for number, stage in enumerate(self.stages[:stretch]):
                way, ahead, mark, spot = self._meet(number, rays, unknowns, marks)
                rays, possible = stage.surface.pass_by(rays, way, stage.gain, spot)
                exists = exists & ahead & possible
                seen.append(mark)
        return rays, exists, seen

    def course(self, unknowns: Unknowns, marks: Marks | None = None) -> Course:
        """The rays on every stretch, without slopes."""
        with np.errstate(all="ignore"):
            rays, exists, length = self.begin(unknowns, False)
            lines, ways, lengths = (
                [self._from_eye(rays, length)],
                [length / self.ior],
                [0.0 * length, length],
            )
            seen = []
            for number, stage in enumerate(self.stages):
                way, ahead, mark, spot = self._meet(number, rays, unknowns, marks)
                seen.append(mark)
                if number:
                    ways.append(way)
                    lengths.append(lengths[-1] + way * self.glass.media[self.media[number]])
                before = rays
                rays, possible = stage.surface.pass_by(rays, way, stage.gain, spot)
                exists = exists & ahead & possible
                if not np.all(exists):
                    # What does not exist stays where it was: its numbers must not grow.
                    both = (rays.place, before.place), (rays.momentum, before.momentum)
                    rays = Rays(*(_where(exists, *parts) for parts in both))
                lines.append(rays)
            ways.append(np.full(len(length), np.inf))
            return Course(lines, ways, lengths, exists, seen)

    def takes(self, unknowns: Unknowns) -> NDArray[np.bool_]:
        """Which rays take the whole path; those that leave it are dropped on the way."""
        result = np.zeros(len(unknowns[0]), dtype=bool)
        with np.errstate(all="ignore"):
            rays, exists, length = self.begin(unknowns, False)
            index, way = np.arange(len(result)), 0.0
            for number, stage in enumerate(self.stages):
                way, ahead, _, spot = self._meet(number, rays, unknowns, None)
                if number:
                    exists = ahead & stage.surface.within(*rays.at(way))
                    exists &= ~self._hidden(number, rays, way, exists)
                else:
                    exists &= stage.surface.within(*unknowns[:3])
                    first = self._from_eye(rays, length)
                    exists &= ~self._hidden(0, first, length / self.ior, exists)
                rays, possible = stage.surface.pass_by(rays, way, stage.gain, spot)
                keep = np.flatnonzero(exists & possible)
                rays, index = rays.take(keep), index[keep]
            free = np.ones(len(index), dtype=bool)
            if not self.open:
                free &= ~self._hidden(len(self.stages), rays, np.full(len(index), np.inf), free)
            result[index[free]] = True
        return result

    def cut_off(self, line: Rays, way, where) -> NDArray[np.bool_]:
        """Which rays on the last stretch (of those `where`) meet something before that way."""
        return self._hidden(len(self.stages), line, way, where)

    def _hidden(self, number: int, rays: Rays, way, where) -> NDArray[np.bool_]:
        """Which rays (of those `where`) meet something else before the end of a stretch."""
        hidden = np.zeros(len(where), dtype=bool)
        left = self.steps[number - 1][0] if number else None
        met = self.steps[number][0] if number < len(self.steps) else None
        if not self.glass.sure(self.media[number], left, met):
            some = np.flatnonzero(where)
            if len(some):
                hidden[some] = self._blocked(number, met is None, rays, way, some)
        return hidden

    def _blocked(self, number: int, last: bool, line: Rays, way, some) -> NDArray[np.bool_]:
        """Which of some rays meet another interface on a stretch before its end."""
        medium = self.media[number]
        shape = way.shape
        place, momentum = (
            tuple(np.broadcast_to(part, shape)[some] for part in parts)
            for parts in (line.place, line.momentum)
        )
        rays, end = Rays(place, momentum), way[some]
        blocked = np.zeros(len(some), dtype=bool)
        for other, interface in self.glass.around(medium):
            if not last and other == self.stages[number].number:
                continue
            before, ahead = interface.surface.meet(rays, interface.back == medium)
            hits = ahead & (before < end - SKIN)
            if hits.any():
                blocked |= hits & interface.surface.within(*rays.at(before))
        return blocked

    # ---- images -------------------------------------------------------------------------

    def _tangents(self, unknowns: Unknowns, targets, stretch: int, marks: Marks | None):
        """Momentum p, e, A and B of the module's notes, which rays exist, and their marks."""
        rays, exists, seen = self.line(unknowns, stretch, marks)
        n2 = self.glass.media[self.media[stretch]] ** 2
        o, p = rays.place, rays.momentum
        e = [q - part for q, part in zip(targets, o, strict=True)]
        way = (e[0] * p[0] + e[1] * p[1] + e[2] * p[2]) * (1.0 / n2)
        e = [part - way * tilt for part, tilt in zip(e, p, strict=True)]
        a, b = ([slope[axis] + way * slope[axis + 3] for axis in range(3)] for slope in rays.slopes)
        return p, e, a, b, exists, seen

    def weakest(self, unknowns: Unknowns, targets, stretch: int, marks: Marks):
        """Unit steps (δa, δb) that move the ray at its target the least, D, and marks."""
        p, _, a, b, _, seen = self._tangents(unknowns, targets, stretch, marks)
        determinant = sum(part * side for part, side in zip(cross(p, a), b, strict=True))
        per = 1.0 / self.glass.media[self.media[stretch]] ** 2
        a, b = (
            [
                part - per * sum(x * y for x, y in zip(side, p, strict=True)) * q
                for part, q in zip(side, p, strict=True)
            ]
            for side in (a, b)
        )
        aa, ab, bb = (
            sum(x * y for x, y in zip(one, other, strict=True))
            for one, other in ((a, a), (a, b), (b, b))
        )
        # The half angle of the axes of the ellipse a cos t + b sin t
        angle = 0.5 * np.arctan2(2.0 * ab, aa - bb) + 0.5 * np.pi
        return np.cos(angle), np.sin(angle), determinant, seen

    def step(self, unknowns: Unknowns, targets, stretch: int, marks: Marks | None = None):
        """Newton's step (δa, δb), D, which rays exist, and their marks."""
        p, e, a, b, exists, seen = self._tangents(unknowns, targets, stretch, marks)
        # p × a, of which all three triple products need one
        turn = cross(p, a)
        determinant = turn[0] * b[0] + turn[1] * b[1] + turn[2] * b[2]
        inverse = 1.0 / np.where(determinant == 0.0, LEAST, determinant)
        second = (turn[0] * e[0] + turn[1] * e[1] + turn[2] * e[2]) * inverse
        turn = cross(b, p)
        first = (turn[0] * e[0] + turn[1] * e[1] + turn[2] * e[2]) * inverse
        return first, second, determinant, exists, seen

    def solve(self, unknowns: Unknowns, anchor: Unknowns, targets, stretch, marks, *, small, most):
        """Newton's steps from `unknowns`, halved where they leave the rays that exist.

        `anchor`: unknowns of rays that exist, for starts that do not. `marks`: of rays nearby.
        Returns the unknowns, D there, steps taken, which came to rest, and marks.
        """
        count = len(targets[0])
        result = tuple(part.copy() for part in unknowns)
        determinant = np.ones(count)
        steps = np.full(count, most, dtype=np.intp)
        rests = np.zeros(count, dtype=bool)
        index = np.arange(count)
        # Close to the eye a short way is a wide angle.
        nearness = np.minimum(self.directions(unknowns)[1], 1.0)
        here, good, aims = unknowns, anchor, targets
        final = [None if mark is None else mark.copy() for mark in marks]
        for number in range(1, most + 1):
            if not len(index):
                break
            # Rays that do not exist may overflow; they are put back below.
            with np.errstate(all="ignore"):
                first, second, bend, exists, seen = self.step(here, aims, stretch, marks)
                size = np.sqrt(first * first + second * second)
            exists &= np.isfinite(size)
            factor = np.where(exists, np.minimum(1.0, LARGEST / np.fmax(size, LARGEST)), 0.0)
            if not exists.all():
                first, second = np.where(exists, first, 0.0), np.where(exists, second, 0.0)
            moved = self.first.slide(here, first * factor, second * factor)
            if not exists.all():
                # Half way back to the last rays that exist.
                half = tuple(0.5 * (old + last) for old, last in zip(here, good, strict=True))
                moved = _where(exists, moved, self.first.onto(half))
                good = _where(exists, here, good)
            else:
                good = here
            done = exists & (size < small * nearness[index])
            for whole, part in zip(result, moved, strict=True):
                whole[index] = part
            marks = [
                old if new is None else np.where(exists, new, old)
                for new, old in zip((*seen, *marks[len(seen) :]), marks, strict=True)
            ]
            for whole, part in zip(final, marks, strict=True):
                if whole is not None:
                    whole[:, index] = part
            determinant[index] = bend
            rests[index[done]] = True
            steps[index[done]] = number
            if number >= HOPELESS:
                # What wanders still has nothing to find.
                done |= ~(size < WANDERS)
            if done.any():
                going = np.flatnonzero(~done)
                index = index[going]
                moved, good, aims = (
                    tuple(part[going] for part in parts) for parts in (moved, good, aims)
                )
                marks = [None if mark is None else mark[:, going] for mark in marks]
            here = moved
        return result, determinant, steps, rests, final


def _where(which: NDArray[np.bool_], ones: tuple, others: tuple) -> tuple:
    """Of pairs of arrays the one, or the other where it does not hold."""
    return tuple(np.where(which, one, other) for one, other in zip(ones, others, strict=True))


HOPELESS, WANDERS = 6, 0.05
"""Steps after which a start is given up if it still takes such steps."""

LARGEST = 0.5
"""Longest step, outer radii."""
