# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths through two glasses, one after the other, each with a frame of its own.

Two glasses share no invariants, so nothing is left of the closed equations but each glass's own:
where a point appears is found by Newton's steps on the eye's direction, with rays traced forward
through both. They start from what the farther glass alone shows to a *virtual eye*, the point that
rays seem to come from after the nearer one. All is given in the nearer glass's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .apparent import apparent_points
from .axial import AxialGlass, nearest
from .axial import start as start_axial
from .glasses import FlatGlass, Glass
from .images import ApparentPoints
from .paths import LightPath, ParallelView, as_eye
from .solver import in_blocks
from .tracing import TracedRays, advance, meet, start, trace

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class ChainedPath:
    """A way of light through a glass and then, from where it left that, through another.

    Attributes
    ----------
    first, second : complete paths of the two glasses. behind : name of the second glass.
    """

    first: LightPath
    second: LightPath
    behind: str

    open = False

    @property
    def events(self) -> str:
        """Of both paths."""
        return self.first.events + self.second.events

    @property
    def interfaces(self) -> tuple[str, ...] | None:
        """Those of the first glass, where they have names."""
        return self.first.interfaces

    def __len__(self) -> int:
        return len(self.first) + len(self.second)

    def __str__(self) -> str:
        return f"{self.first} > {self.second} ({self.behind})"


@dataclass(frozen=True, eq=False)
class Pair:
    """Two glasses.

    Attributes
    ----------
    near, far : descriptions. pose : (4, 4), rigid: from the far one's frame to the near one's.
    """

    near: Glass | AxialGlass
    far: Glass | AxialGlass
    pose: Floats

    def to_far(self, places: Floats) -> Floats:
        """Places (..., 3) in the far glass's frame."""
        return (places - self.pose[:3, 3]) @ self.pose[:3, :3]

    def turned(self, directions: Floats) -> Floats:
        """Directions (..., 3) in the far glass's frame."""
        return directions @ self.pose[:3, :3]

    def to_near(self, places: Floats) -> Floats:
        """Places (..., 3) of the far glass's frame in the near one's."""
        return places @ self.pose[:3, :3].T + self.pose[:3, 3]


def trace_chain(
    pair: Pair, origin: ArrayLike, direction: ArrayLike, path: ChainedPath
) -> TracedRays:
    """The rays after a path's last event, in the near glass's frame; otherwise as `trace`.

    `origin` : (3,) or (M, 3); `direction` : (M, 3).
    """
    between = trace(pair.near, origin, direction, path.first)
    place, way = pair.to_far(between.origin), pair.turned(between.direction)
    after = trace(pair.far, place, way, path.second)
    valid = between.valid & after.valid & is_outside(pair.far, place)
    return TracedRays(
        pair.to_near(after.origin),
        after.direction @ pair.pose[:3, :3].T,
        between.length + after.length,
        valid,
    )


def is_outside(glass: Glass | AxialGlass, places: Floats) -> Flags:
    """Which places (N, 3) lie in the medium around a glass, or in that behind a flat one."""
    medium = glass.medium_at(places)
    outside = medium == 0
    if isinstance(glass, FlatGlass):
        outside |= medium == len(glass.media) - 1
    return outside


def first_met(glass: Glass | AxialGlass, origin: ArrayLike, direction: ArrayLike) -> Floats:
    """How far along rays (M, 3) from around a glass its first face is; inf where they miss it."""
    origin = np.broadcast_to(np.asarray(origin, dtype=float), np.shape(direction))
    found = np.full(len(origin), np.inf)
    if isinstance(glass, AxialGlass):
        for group in start_axial(glass, origin, direction):
            if group.medium == 0:
                met, way = nearest(glass, 0, group.rays)
                opaque = np.array([part.opaque for part in glass.interfaces])
                on = (met >= 0) & ~opaque[met]
                found[group.index[on]] = way[on] * glass.media[0] * glass.scale
        return found
    rays, proper = start(glass, origin, direction)
    meeting = meet(glass, rays)
    on = proper & meeting.inside & is_outside(glass, rays.origin)
    found[on] = meeting.distance[on]
    return found


def has_chained_images(glass: Glass | AxialGlass, path: LightPath) -> bool:
    """Whether `chained_points` finds all images behind a near glass.

    It must have an image of every eye: a flat glass has, and a hollow one, which hardly bends. A
    rod, a ball or a filled glass gathers rays to caustics.
    """
    if isinstance(glass, AxialGlass):
        return False
    if isinstance(glass, FlatGlass):
        return True
    hollow = len(glass.radius) == 2 and glass.ior[-1] == glass.ior_outside
    return hollow and path.events == "TTTT"


def chained_points(
    pair: Pair,
    path: ChainedPath,
    eye: ArrayLike,
    points: ArrayLike,
    *,
    tolerance: float = 1e-9,
) -> ApparentPoints:
    """Where points appear along a path through two glasses: in and behind both of them.

    Of the stretch between the glasses nothing is reported: what stands there is seen along the
    first path. In a parallel view, and where `has_chained_images` does not hold, only what is in
    the near glass is. Points that the search does not settle are marked as without an image.

    Parameters
    ----------
    eye : (3,) or ParallelView. points : (N, 3). tolerance : as for `apparent_points`.

    Returns
    -------
    ApparentPoints
        In the near glass's frame. `stretch` counts on from the first glass to the second.

    Raises
    ------
    ValueError
        As `apparent_points`.
    """
    eye = as_eye(eye)
    points = np.asarray(points, dtype=float)
    within = apparent_points(pair.near, path.first, eye, points, tolerance=tolerance)
    rows = [
        _row(within, slot, ("near", *within.sheet[slot]))
        for slot in np.flatnonzero(within.stretch < len(path.first))
    ]
    most = within.iterations
    if not isinstance(eye, ParallelView) and has_chained_images(pair.near, path.first):
        known = np.isfinite(points).all(axis=-1)
        safe = np.where(known[:, None], points, 0.0)
        search = _Search(pair, path, eye, safe, tolerance)
        for slot, sheet in enumerate(search.seen.sheet):
            row, steps = search.row(slot, ("far", *sheet))
            row.valid &= known
            _drop_repeated(row, rows, tolerance)
            rows.append(row)
            most = max(most, steps)
    if not any(row.valid.any() for row in rows):
        rows = [_row(within, 0, ("near",))]
        rows[0].valid[:] = False
    rows = [row for row in rows if row.valid.any()] or rows
    return ApparentPoints(
        *(
            np.stack([getattr(row, name) for row in rows])
            for name in ("direction", "distance", "position", "valid", "residual")
        ),
        np.array([row.stretch for row in rows], dtype=np.intp),
        most,
        tuple(row.sheet for row in rows),
    )


@dataclass
class _Row:
    """One slot of a result."""

    sheet: tuple
    stretch: int
    direction: Floats
    distance: Floats
    position: Floats
    valid: Flags
    residual: Floats


def _row(found: ApparentPoints, slot: int, sheet: tuple) -> _Row:
    columns = (found.direction, found.distance, found.position, found.valid, found.residual)
    return _Row(sheet, int(found.stretch[slot]), *(column[slot].copy() for column in columns))


def _drop_repeated(row: _Row, others: list[_Row], tolerance: float) -> None:
    """Sheets that were two for the virtual eye may be one here: an image counts once."""
    for other in others:
        if other.stretch == row.stretch:
            apart = np.abs(row.direction - other.direction).max(axis=1)
            row.valid &= ~(other.valid & (apart < 10.0 * tolerance))


STEP = 1e-6
"""Radians between rays whose difference stands for the derivative."""
MOST, FEW = 16, 5
"""Newton's steps where all digits are asked for, and where few are."""
LONGEST = 0.3
"""Radians of the longest step."""
SAMPLES = 33
"""Points towards which the virtual eye is found."""
MISS = 1e-10
"""Residual in parts of the distance beyond which a ray does not count as passing a point."""


class _Search:
    """The images of points behind the near glass, a slot a sheet of the far one."""

    def __init__(self, pair: Pair, path: ChainedPath, eye, points, tolerance: float) -> None:
        self.pair, self.path, self.eye = pair, path, eye
        self.tolerance = tolerance
        self.miss = tolerance if tolerance > 1e-8 else MISS
        # Those that take many steps lie where hardly anything of them is seen.
        self.most = MOST if tolerance <= 1e-8 else FEW
        self.points = pair.to_far(points)
        self.virtual = pair.to_far(_virtual_eye(pair.near, path.first, eye, points))
        if not is_outside(pair.far, self.virtual[None])[0]:
            self.virtual = pair.to_far(eye)
        # With all digits: near grazing a start with less does not take the path.
        self.seen = apparent_points(pair.far, path.second, self.virtual, self.points)

    def row(self, slot: int, sheet: tuple) -> tuple[_Row, int]:
        """The images on a sheet of the far glass, and the most steps that a point took."""
        stretch = int(self.seen.stretch[slot])
        directions, distances = self._start(slot)
        count = len(self.points)
        residual, valid = np.zeros(count), np.zeros(count, bool)
        steps = np.zeros(count, int)

        def work(block: slice) -> None:
            found = self._newton(
                self.points[block], directions[block], stretch, self.seen.valid[slot][block]
            )
            directions[block], steps[block], rest = found
            miss, length, takes = self._checked(self.points[block], directions[block], stretch)
            valid[block] = takes & rest & (miss <= self.miss * length)
            residual[block] = np.where(takes, miss, 0.0)
            distances[block] = np.where(valid[block], length, distances[block])

        in_blocks(work, count)
        position = self.eye + distances[:, None] * directions
        number = len(self.path.first) + stretch
        row = _Row(sheet, number, directions, distances, position, valid, residual)
        return row, int((steps * valid).max(initial=0))

    def _start(self, slot: int) -> tuple[Floats, Floats]:
        """Directions from the eye (N, 3), near those sought, and distances."""
        pair, seen = self.pair, self.seen
        entry = followed(pair.far, self.virtual, seen.direction[slot], self.path.second, 1)
        places = np.where(entry.valid[:, None], entry.origin, seen.position[slot])
        places = pair.to_near(places)
        found = apparent_points(pair.near, self.path.first, self.eye, places)
        straight = places - self.eye
        away = np.sqrt(np.sum(straight * straight, axis=1))
        directions = straight / np.where(away > 0.0, away, 1.0)[:, None]
        directions[away == 0.0] = (0.0, 0.0, 1.0)
        for number in np.flatnonzero(found.stretch == len(self.path.first)):
            on = found.valid[number]
            directions[on] = found.direction[number][on]
        beyond = np.where(entry.valid, seen.distance[slot] - entry.length, 0.0)
        return directions, away + np.maximum(beyond, 0.0)

    def _lines(self, directions: Floats, stretch: int) -> TracedRays:
        """Rays (M, 3) from the eye, followed to a stretch of the far glass, in its frame."""
        between = trace(self.pair.near, self.eye, directions, self.path.first)
        place, way = self.pair.to_far(between.origin), self.pair.turned(between.direction)
        after = followed(self.pair.far, place, way, self.path.second, stretch)
        valid = between.valid & after.valid & is_outside(self.pair.far, place)
        return TracedRays(after.origin, after.direction, between.length + after.length, valid)

    def _newton(self, points: Floats, directions: Floats, stretch: int, seen: Flags):
        """Directions (M, 3), steps taken (M,), and who came to rest (M,).

        ``seen`` (M,): by the virtual eye. Of other points only those are tried that it nearly sees.
        """
        directions = directions.copy()
        steps = np.zeros(len(points), int)
        small = 1e-2 * self.tolerance**0.5
        index = np.arange(len(points))
        lines = self._lines(directions, stretch)
        if self.most == MOST and lines.valid.any() and (seen & ~lines.valid).any():
            directions = self._pulled_in(directions, lines.valid, seen & ~lines.valid, stretch)
            lines = self._lines(directions, stretch)
        off = _offsets(points, lines)
        least = _dot(off, off)
        tried = lines.valid & (seen | (least < (NEARLY * lines.length) ** 2))
        # Where few digits are asked for, what the virtual eye sees is mostly near enough.
        rest = tried & seen & (least < (0.1 * self.miss * lines.length) ** 2)
        index = index[tried & ~rest]
        off, lines = off[index], _taken(lines, index)
        for number in range(1, self.most + 1):
            if not len(index):
                break
            here = directions[index]
            step, regular = self._step(points[index], here, off, lines, stretch)
            size = np.sqrt(np.sum(step * step, axis=1))
            step *= np.minimum(1.0, LONGEST / np.maximum(size, LONGEST))[:, None]
            least = np.sqrt(np.sum(off * off, axis=1))
            part = np.ones(len(index))
            better = np.zeros(len(index), bool)
            for _ in range(HALVINGS):
                some = np.flatnonzero(~better & regular)
                if not len(some):
                    break
                tried = _unit(here[some] + part[some, None] * step[some])
                found = self._lines(tried, stretch)
                new = _offsets(points[index[some]], found)
                # Rounding alone decides between two that are as good as exact.
                shorter = np.sqrt(np.sum(new * new, axis=1)) < least[some] + EXACT * found.length
                good = found.valid & shorter
                won = some[good]
                better[won] = True
                here[won], off[won] = tried[good], new[good]
                for whole, few in zip(_columns(lines), _columns(found), strict=True):
                    whole[won] = few[good]
                part[some[~good]] *= 0.25
            directions[index[better]] = here[better]
            steps[index] = number
            near = np.sqrt(_dot(off, off)) <= 0.1 * self.miss * lines.length
            still = better & (part == 1.0) & (size < small) & near
            rest[index[still]] = True
            going = better & ~still
            if number >= PATIENCE:
                going &= _dot(off, off) < (SLOW * least) ** 2
            index, off, lines = index[going], off[going], _taken(lines, going)
        return directions, steps, rest

    def _pulled_in(self, directions: Floats, valid: Flags, beside: Flags, stretch: int) -> Floats:
        """Directions just beside the valid ones that take the path, moved towards them."""
        middle = _unit(directions[valid].mean(axis=0)[None])
        directions = directions.copy()
        left = np.flatnonzero(beside)
        for part in PULLS:
            tried = _unit(directions[left] + part * (middle - directions[left]))
            good = self._lines(tried, stretch).valid
            directions[left[good]] = tried[good]
            left = left[~good]
        return directions

    def _step(self, points, directions, off, lines: TracedRays, stretch: int):
        """Newton's steps (M, 3) across the directions, and where there is one (M,)."""
        first, second = _across(directions)
        count = len(points)
        here, sides = np.tile(directions, (2, 1)), np.concatenate((first, second))
        ends, offs = np.tile(points, (2, 1)), np.tile(off, (2, 1))
        # Rays for both columns at once: of few points the calls cost more than the rays.
        ahead = self._lines(_unit(here + STEP * sides), stretch)
        change, known = (_offsets(ends, ahead) - offs) / STEP, ahead.valid.copy()
        back = np.flatnonzero(~known)
        if len(back):
            behind = self._lines(_unit(here[back] - STEP * sides[back]), stretch)
            change[back] = (offs[back] - _offsets(ends[back], behind)) / STEP
            known[back] = behind.valid
        columns, known = (change[:count], change[count:]), known[:count] & known[count:]
        right, up = _across(lines.direction)
        a, c = (_dot(column, right) for column in columns)
        b, d = (_dot(column, up) for column in columns)
        x, y = _dot(off, right), _dot(off, up)
        determinant = a * d - b * c
        regular = known & (np.abs(determinant) > 1e-12 * (a * a + b * b + c * c + d * d))
        safe = np.where(regular, determinant, 1.0)
        u, v = -(d * x - c * y) / safe, -(a * y - b * x) / safe
        return np.where(regular[:, None], u[:, None] * first + v[:, None] * second, 0.0), regular

    def _checked(self, points, directions, stretch: int):
        """Distances (M,) at which rays pass points, lengths up to there, and who takes the path."""
        lines = self._lines(directions, stretch)
        along = _dot(points - lines.origin, lines.direction)
        off = _offsets(points, lines)
        length = lines.length + along
        slack = MISS * np.abs(length)
        takes = lines.valid & (along >= -slack)
        if stretch < len(self.path.second):
            later = self._lines(directions, stretch + 1)
            takes &= later.valid & (length <= later.length + slack)
            takes &= self._lines(directions, len(self.path.second)).valid
        return np.sqrt(_dot(off, off)), np.maximum(length, 0.0), takes


PULLS = (0.002, 0.01, 0.04, 0.15)
"""Parts of the way to the middle of a path's rays by which starts beside it are moved."""
NEARLY = 0.02
"""Part of its distance by which a ray may miss a point that is then taken to be nearly seen."""
PATIENCE, SLOW = 3, 0.7
"""From this step on, steps that leave more than this part of the residual are the last."""
HALVINGS = 3
"""Shorter steps tried where one does not help."""
EXACT = 1e-15
"""Part of the length of a path below which two residuals are as good as one another."""


def followed(glass, origin, direction, path: LightPath, count: int) -> TracedRays:
    """Rays (M, 3) after `count` events of a path (1 or more), the whole path if that is all.

    `valid`: they take these events; after the last event, that they meet nothing further.
    """
    if count == len(path):
        return trace(glass, origin, direction, path)
    if isinstance(glass, AxialGlass):
        begin = LightPath(path.events[:count], path.interfaces[:count], open=True)
        return trace(glass, origin, direction, begin)
    rays, proper = start(glass, origin, direction)
    columns = [rays.origin.copy(), rays.direction.copy(), rays.length.copy()]
    index = np.flatnonzero(proper)
    rays = rays.take(index)
    for event in path.events[:count]:
        meeting = meet(glass, rays)
        on = np.flatnonzero(meeting.inside)
        rays, possible = advance(glass, rays.take(on), meeting.take(on), event)
        index, rays = index[on][possible], rays.take(possible)
    valid = np.zeros(len(proper), bool)
    valid[index] = True
    for column, part in zip(columns, (rays.origin, rays.direction, rays.length), strict=True):
        column[index] = part
    return TracedRays(*columns, valid)


def _virtual_eye(near, path: LightPath, eye: Floats, points: Floats) -> Floats:
    """The place (3,) that rays from the eye to the points seem to come from behind a glass.

    The place nearest to all of their lines, in the sense of least squares.
    """
    some = points[:: max(1, len(points) // SAMPLES)]
    found = apparent_points(near, path, eye, some)
    last = np.flatnonzero(found.stretch == len(path))
    directions = [found.direction[slot][found.valid[slot]] for slot in last]
    directions = np.concatenate([*directions, np.zeros((0, 3))])
    rays = trace(near, eye, directions, path)
    origin, along = rays.origin[rays.valid], rays.direction[rays.valid]
    if not len(origin):
        return eye
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    # One line alone leaves open where on it: then as far off as the eye.
    back = origin - rays.length[rays.valid][:, None] * along
    hold = 1e-9 * len(origin)
    matrix = across.sum(axis=0) + hold * np.eye(3)
    right = np.einsum("nij,nj->i", across, origin) + hold * back.mean(axis=0)
    place = np.linalg.solve(matrix, right)
    # Rays that meet in front of the glass seem to come from nowhere behind it.
    return place if (_dot(place - origin, along) < 0.0).all() else back.mean(axis=0)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.sum(a * b, axis=-1)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.sqrt(_dot(vectors, vectors))[:, None]


def _across(directions: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (M, 3) each, across unit directions and one another."""
    axis = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = _unit(np.cross(directions, axis))
    return first, np.cross(directions, first)


def _offsets(points: Floats, lines: TracedRays) -> Floats:
    """From the lines to the points (M, 3), across the lines."""
    away = points - lines.origin
    return away - _dot(away, lines.direction)[:, None] * lines.direction


def _columns(rays: TracedRays) -> tuple:
    return rays.origin, rays.direction, rays.length, rays.valid


def _taken(rays: TracedRays, which) -> TracedRays:
    return TracedRays(*(column[which] for column in _columns(rays)))
