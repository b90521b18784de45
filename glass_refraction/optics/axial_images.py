# SPDX-License-Identifier: GPL-3.0-or-later
"""All images of points along a path through a glass of revolution.

The rays that take a path fill a part of the first interface's rectangle. It is cut into *cells*,
finer where the path's region ends and where rays fan out unevenly; four corner rays and one
through the middle tell the bundle of a cell. On a stretch, a bundle is a tube round its middle
ray, and its corners move linearly in planes across that ray. So a target that the cell's rays can
reach is found by two tests: clusters of targets against tubes, then targets against the corners'
quadrangle. Every find is a start for Newton's method. Cells that a caustic crosses hold two images
or none: there Newton starts from several places. What it finds is kept only if the ray meets the
target and takes the whole path, interface by interface.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .axial import AxialGlass, first_rays, realisations, steps_of
from .axial_rays import Passage, Unknowns, _basis, unit
from .images import Slot
from .paths import LightPath, ParallelView
from .solver import in_blocks
from .surfaces import Floats

BASE = (24, 12)
"""Cells of the first lattice over the first interface."""

ENOUGH = 150
"""Cells that a path's region should have before refinement."""

DEEPEST = 4
"""Halvings of a cell where a path's region ends; two fewer where rays fan out unevenly."""

UNEVEN = 0.15
"""How far the middle ray of a cell may lie from its corners' mean, in sizes of the cell."""

CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.5, 0.5)])


@dataclass
class Tubes:
    """Bundles of all cells on one stretch.

    `middle`, `axis`, `first`, `second`: (C, 3) a point on the middle ray, its unit direction and
    two across. Corners lie at `at` + s·`fan`, (C, 4, 2), a way s along the axis. `low`, `high`:
    where the stretch runs, (C,). `loose`: corners are missing.
    """

    middle: Floats
    axis: Floats
    first: Floats
    second: Floats
    at: Floats
    fan: Floats
    low: Floats
    high: Floats
    loose: NDArray[np.bool_]


class Lattice:
    """The cells of one path from one viewpoint: `unknowns` (C, 5, 3) of corners and middle."""

    def __init__(self, passage: Passage) -> None:
        self.passage = passage
        stage = passage.stages[0]
        self.patch = stage.surface.sample(passage.view, stage.back)
        self.unknowns = np.zeros((0, 5, 3))
        self.tubes: dict[int, Tubes] = {}
        if self.patch is None:
            return
        rows, columns = BASE
        cells = np.stack(
            np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1
        ).reshape(-1, 2) / (rows, columns)
        size = np.broadcast_to(1.0 / np.array(BASE), cells.shape)
        kept = []
        for level in range(DEEPEST + 1):
            unknowns, lines, real = self._look(cells, size)
            some = real.any(axis=1)
            if not some.any() and level < 2:
                cells, size = _halve(cells, size)  # a thin region may lie between the rays
                continue
            cells, size, unknowns, real = cells[some], size[some], unknowns[some], real[some]
            lines = [tuple(part[some] for part in line) for line in lines]
            if level == DEEPEST:
                split = np.zeros(len(cells), dtype=bool)
            elif len(cells) < ENOUGH and level < DEEPEST - 1:
                split = np.ones(len(cells), dtype=bool)
            else:
                split = ~real.all(axis=1)
                if level < DEEPEST - 2:
                    split |= _uneven(lines)
            kept.append(unknowns[~split])
            cells, size = _halve(cells[split], size[split])
            if not len(cells):
                break
        self.unknowns = np.concatenate(kept) if kept else self.unknowns

    def _look(self, cells, size):
        """Unknowns (C, 5, 3), lines on every stretch, and which rays take the path."""
        share = cells[:, None] + size[:, None] * CORNERS
        places = tuple(part.ravel() for part in self.patch.places(share))
        rays, _ = first_rays(self.passage.glass, self.passage.view, places)
        flat = self._unknowns(rays)
        course = self.passage.course(flat)
        real = self.passage.taken(course).reshape(-1, 5)
        shape = (len(cells), 5, 3)
        lines = [_arrays(line, shape) for line in course.lines]
        return np.stack(flat, axis=-1).reshape(shape), lines, real

    def _unknowns(self, rays) -> Unknowns:
        if not self.passage.view.parallel:
            return unit(rays.momentum)
        direction = self.passage.view.direction
        ahead = sum(o * d for o, d in zip(rays.place, direction, strict=True))
        return tuple(o - ahead * d for o, d in zip(rays.place, direction, strict=True))

    def on(self, stretch: int) -> Tubes:
        """The bundles on a stretch."""
        if stretch not in self.tubes:
            self.tubes[stretch] = self._tubes(stretch)
        return self.tubes[stretch]

    def _tubes(self, stretch: int) -> Tubes:
        shape = self.unknowns.shape
        flat = tuple(self.unknowns[..., axis].ravel() for axis in range(3))
        course = self.passage.course(flat)
        place, axis = _arrays(course.lines[stretch], shape)
        ior = self.passage.glass.media[self.passage.media[stretch]]
        way = (course.ways[stretch] * ior).reshape(shape[:2])
        exists = course.exists.reshape(shape[:2])
        loose = ~exists[:, :4].all(axis=1)
        # Missing rays are stood for by one that exists.
        stand_in = np.argmax(exists, axis=1)
        stand_in = np.where(exists[:, 4], 4, stand_in)
        rows = np.arange(shape[0])[:, None]
        column = np.where(exists, np.arange(5), stand_in[:, None])
        place, axis, way = place[rows, column], axis[rows, column], way[rows, column]
        middle, along = place[:, 4], axis[:, 4]
        first, second = (np.stack(part, axis=-1) for part in _basis(*along.T))
        facing = np.einsum("cjk,ck->cj", axis, along)
        loose |= (facing < 0.3).any(axis=1)
        facing = np.maximum(facing, 0.3)
        offset = place - middle[:, None]
        ahead = np.einsum("cjk,ck->cj", offset, along)
        onto = offset - (ahead / facing)[..., None] * axis

        def across(vectors):
            return np.stack(
                [np.einsum("cjk,ck->cj", vectors, side) for side in (first, second)], axis=-1
            )

        at, fan = across(onto), across(axis / facing[..., None])
        ends = ahead + way * facing
        spread = np.sqrt(np.sum(offset * offset, axis=-1)).max(axis=1)
        return Tubes(
            middle,
            along,
            first,
            second,
            at[:, :4],
            fan[:, :4],
            ahead.min(axis=1) - 0.5 * spread,
            ends.max(axis=1) + 0.5 * spread,
            loose,
        )


def _arrays(line, shape) -> tuple[Floats, Floats]:
    """Places and unit directions of rays as (C, 5, 3)."""
    count = shape[0] * shape[1]
    place, momentum = (
        np.stack([np.broadcast_to(part, count) for part in parts], axis=-1).reshape(shape)
        for parts in (line.place, line.momentum)
    )
    size = np.sqrt(np.sum(momentum * momentum, axis=-1, keepdims=True))
    return place, momentum / np.maximum(size, 1e-300)


def _halve(cells, size):
    half = 0.5 * size
    return (
        (cells[:, None] + half[:, None] * CORNERS[:4]).reshape(-1, 2),
        np.repeat(half, 4, axis=0),
    )


def _uneven(lines) -> NDArray[np.bool_]:
    """Cells whose middle ray lies far from the mean of their corners, on any stretch."""
    uneven = False
    for parts in lines[1:]:
        for part in parts:
            middle = part[:, 4]
            off = np.linalg.norm(part[:, :4].mean(axis=1) - middle, axis=-1)
            reach = np.linalg.norm(part[:, :4] - middle[:, None], axis=-1).max(axis=1)
            uneven = uneven | (off > UNEVEN * reach)
    return uneven


@lru_cache(maxsize=128)
def lattice_of(glass: AxialGlass, eye, steps) -> Lattice | None:
    """The lattice of a path; None where no ray takes it. `eye`: a tuple or a parallel view."""
    passage = Passage(glass, eye if isinstance(eye, ParallelView) else np.array(eye), steps)
    if not passage.possible:
        return None
    lattice = Lattice(passage)
    return lattice if len(lattice.unknowns) else None


# ---- targets --------------------------------------------------------------------------------


@dataclass
class Clusters:
    """Targets in groups of near ones: centres, radii, and the targets in order of the groups."""

    centre: Floats
    radius: Floats
    order: NDArray[np.intp]
    first: NDArray[np.intp]
    count: NDArray[np.intp]


def cluster(points: Floats) -> Clusters:
    """Groups of targets (N, 3), of a size that grows with the distance from the glass."""
    reach = np.sqrt(np.sum(points * points, axis=1))
    squeezed = points / (1.0 + reach / NEAR)[:, None]
    low = squeezed.min(axis=0)
    span = max(float((squeezed.max(axis=0) - low).max()), 1e-9)
    parts = max(1, min(16, round((len(points) / 12.0) ** (1.0 / 2.0) / 2.0)))
    if len(points) <= 64:
        parts = 4096
    keys = np.minimum((squeezed - low) * (parts / span), parts - 1).astype(np.int64)
    code = (keys[:, 0] * parts + keys[:, 1]) * parts + keys[:, 2]
    order = np.argsort(code, kind="stable")
    code = code[order]
    first = np.flatnonzero(np.append(True, code[1:] != code[:-1]))
    count = np.diff(np.append(first, len(order)))
    ordered = points[order]
    centre = np.add.reduceat(ordered, first, axis=0) / count[:, None]
    away = ordered - np.repeat(centre, count, axis=0)
    radius = np.sqrt(np.maximum.reduceat(np.sum(away * away, axis=1), first))
    return Clusters(centre, radius, order, first, count)


NEAR = 8.0
"""Distance in outer radii from which groups of targets grow."""

WIDER = 1.4
"""A cell's rays may lie this much farther from its middle than its corners do."""

BRIM = 0.12
"""Part of a cell by which targets may lie outside it, besides what its unevenness tells."""


class Search:
    """The images of some targets on one stretch."""

    def __init__(self, lattice: Lattice, stretch: int, targets: Floats, tolerance: float) -> None:
        self.lattice, self.stretch, self.targets = lattice, stretch, targets
        self.passage = lattice.passage
        self.tolerance = tolerance
        self.tubes = lattice.on(stretch)

    def starts(self):
        """Candidates: target, unknowns (3 parts), and unknowns of a ray that exists; and for
        every target the unknowns of the rays that come nearest to it."""
        groups = cluster(self.targets)
        target, cell, nearest = self._pairs(groups)
        shares, index, cells = [], [], []
        for part in range(0, len(target), PIECE):
            some = slice(part, part + PIECE)
            near, inside, fold = self._shares(target[some], cell[some])
            shares.append(near[inside])
            index.append(target[some][inside])
            cells.append(cell[some][inside])
            folded = np.flatnonzero(fold)
            for inset in FOLDED:
                shares.append(np.broadcast_to(inset, (len(folded), 2)))
                index.append(target[some][folded])
                cells.append(cell[some][folded])
        empty = np.zeros(0, dtype=np.intp)
        index = np.concatenate(index) if index else empty
        cells = np.concatenate(cells) if cells else empty
        shares = np.concatenate(shares) if shares else np.zeros((0, 2))
        waiting, _, _ = self._shares(np.arange(len(self.targets)), nearest)
        return (
            index,
            self._blend(cells, shares),
            tuple(self.lattice.unknowns[cells, 4, axis] for axis in range(3)),
            self._blend(nearest, np.clip(waiting, -0.5, 0.5)),
        )

    def _pairs(self, groups: Clusters):
        """Which targets may lie in which tubes, and the tube nearest to each target."""
        tubes, n = self.tubes, len(groups.centre)
        found_group, found_cell = [], []
        nearest = np.zeros(n, dtype=np.intp)
        rows = max(1, PIECE // max(1, len(tubes.low)))
        # |at + s·fan|² of every corner as coefficients of 1, s, s²
        squares = np.stack(
            [
                np.sum(tubes.at**2, axis=-1),
                2.0 * np.sum(tubes.at * tubes.fan, axis=-1),
                np.sum(tubes.fan**2, axis=-1),
            ]
        )
        origin = np.sum(tubes.middle * tubes.axis, axis=1)
        size2 = np.sum(tubes.middle**2, axis=1)
        for begin in range(0, n, rows):
            centre = groups.centre[begin : begin + rows]
            radius = groups.radius[begin : begin + rows, None]
            s = centre @ tubes.axis.T - origin
            away2 = np.sum(centre * centre, axis=1)[:, None] - 2.0 * centre @ tubes.middle.T
            away2 += size2
            away2 -= s * s
            away = np.sqrt(np.maximum(away2, 0.0))
            spread2 = np.full_like(s, 0.0)
            for corner in range(4):
                constant, linear, square = squares[:, :, corner]
                np.maximum(spread2, (square * s + linear) * s + constant, out=spread2)
            spread = np.sqrt(spread2)
            beyond = np.maximum(np.maximum(tubes.low - s, s - tubes.high), 0.0)
            hit = (away <= radius + WIDER * spread + 1e-6) & (beyond <= radius + 1e-6)
            hit |= tubes.loose & (away <= radius + 3.0 * spread + 1e-6) & (beyond <= radius + 1e-6)
            group, cell = np.nonzero(hit)
            found_group.append(group + begin)
            found_cell.append(cell)
            miss = (np.maximum(away - spread, 0.0) + beyond + 1e-3 * away) / (1.0 + np.abs(s))
            nearest[begin : begin + rows] = np.argmin(miss, axis=1)
        group, cell = np.concatenate(found_group), np.concatenate(found_cell)
        # From groups to their targets
        count = groups.count[group]
        total = int(count.sum())
        starts = np.repeat(groups.first[group] - (np.cumsum(count) - count), count)
        target = groups.order[starts + np.arange(total)]
        every = np.empty(len(groups.order), dtype=np.intp)
        every[groups.order] = np.repeat(nearest, groups.count)
        return target, np.repeat(cell, count), every

    def _shares(self, target, cell):
        """Where targets lie in cells (P, 2), −½ to ½; which are inside; which need more starts."""
        tubes = self.tubes
        off = self.targets[target] - tubes.middle[cell]
        axis = tubes.axis[cell]
        s = np.einsum("pk,pk->p", off, axis)
        x = np.einsum("pk,pk->p", off, tubes.first[cell])
        y = np.einsum("pk,pk->p", off, tubes.second[cell])
        corner = tubes.at[cell] + s[:, None, None] * tubes.fan[cell]
        cx, cy = corner[..., 0], corner[..., 1]
        mean_x, mean_y = cx.mean(axis=1), cy.mean(axis=1)
        # Edges of the quadrangle: along the first coordinate below and above, then the second
        ax, ay = (
            0.5 * (cx[:, 1] + cx[:, 2] - cx[:, 0] - cx[:, 3]),
            0.5 * (cy[:, 1] + cy[:, 2] - cy[:, 0] - cy[:, 3]),
        )
        bx, by = (
            0.5 * (cx[:, 2] + cx[:, 3] - cx[:, 0] - cx[:, 1]),
            0.5 * (cy[:, 2] + cy[:, 3] - cy[:, 0] - cy[:, 1]),
        )
        tx, ty = (
            cx[:, 0] + cx[:, 2] - cx[:, 1] - cx[:, 3],
            cy[:, 0] + cy[:, 2] - cy[:, 1] - cy[:, 3],
        )
        area = ax * by - ay * bx
        # Area at the corners: half the twist added or taken away
        lean_a, lean_b = 0.5 * (ax * ty - ay * tx), 0.5 * (tx * by - ty * bx)
        fold = np.abs(area) <= (np.abs(lean_a) + np.abs(lean_b)) * 1.5
        inverse = 1.0 / np.where(area == 0.0, 1e-300, area)

        def solve(x, y):
            return (x * by - y * bx) * inverse, (ax * y - ay * x) * inverse

        with_twist = []
        first, second = solve(x - mean_x, y - mean_y)
        first, second = np.clip(first, -2.0, 2.0), np.clip(second, -2.0, 2.0)
        product = first * second
        first, second = solve(x - mean_x - product * tx, y - mean_y - product * ty)
        bulge = np.abs(np.stack(solve(mean_x, mean_y), axis=-1))
        with_twist = np.stack([np.clip(first, -9.0, 9.0), np.clip(second, -9.0, 9.0)], axis=-1)
        fold |= tubes.loose[cell] | (bulge > 0.5).any(axis=1)
        inside = ~fold & (np.abs(with_twist) <= 0.5 + BRIM + bulge).all(axis=1)
        reach2 = ((cx - mean_x[:, None]) ** 2 + (cy - mean_y[:, None]) ** 2).max(axis=1)
        near = (x - mean_x) ** 2 + (y - mean_y) ** 2 <= 4.0 * reach2 + 1e-12
        return with_twist, inside, fold & near

    def _blend(self, cells, shares) -> Unknowns:
        """Unknowns at shares (−½ to ½) of cells."""
        u = self.lattice.unknowns[cells]
        first, second = (np.clip(shares, -0.75, 0.75) + 0.5).T
        weights = (
            (1.0 - first) * (1.0 - second),
            first * (1.0 - second),
            first * second,
            (1.0 - first) * second,
        )
        blended = tuple(
            sum(weight * u[:, corner, axis] for corner, weight in enumerate(weights))
            for axis in range(3)
        )
        return blended if self.passage.view.parallel else unit(blended)

    def images(self) -> tuple[Found, Found, int]:
        """Images, what is shown for targets without one, and the most steps taken."""
        index, unknowns, anchor, waiting = self.starts()
        count = len(index)
        parts: list[Found | None] = [None] * (count // BLOCK + 1)
        most = [0] * len(parts)

        def work(block: slice) -> None:
            aims = tuple(self.targets[index[block]].T)
            some = tuple(part[block] for part in unknowns)
            sure = tuple(part[block] for part in anchor)
            number = block.start // BLOCK
            found, most[number] = self._settle(index[block], some, sure, aims)
            parts[number] = found

        if count:
            in_blocks(work, count, BLOCK)
        else:
            work(slice(0, 0))
        found = _join([part for part in parts if part is not None])
        every = np.arange(len(self.targets))
        stays = self._describe(every, waiting, tuple(self.targets.T), np.ones(len(every)))
        return _distinct(found), stays, max(most)

    def _settle(self, index, unknowns, anchor, aims) -> tuple[Found, int]:
        """Solve from all starts; what meets its target, described."""
        fine = self.tolerance <= 1e-8
        small = 1e-6 if fine else 0.3 * self.tolerance**0.5
        unknowns, bend, steps, rests = self.passage.solve(
            unknowns, anchor, aims, self.stretch, small=small, most=MOST
        )
        keep = np.flatnonzero(rests)
        unknowns, aims = (tuple(part[keep] for part in parts) for parts in (unknowns, aims))
        found = self._describe(index[keep], unknowns, aims, bend[keep])
        again = np.flatnonzero(found.miss > self._allowed())
        if len(again):
            some, goal = (tuple(part[again] for part in parts) for parts in (unknowns, aims))
            some, bend, _, rests = self.passage.solve(
                some, some, goal, self.stretch, small=1e-12, most=6
            )
            found.put(again, self._describe(found.index[again], some, goal, bend))
        passes = np.flatnonzero(found.miss <= 10.0 * self._allowed())
        return found.take(passes), int(steps[keep].max(initial=0))

    def _allowed(self) -> float:
        return max(self.tolerance * 0.03, 1e-12)

    def _describe(self, index, unknowns, aims, bend) -> Found:
        """Where rays run that should meet targets."""
        passage, stretch = self.passage, self.stretch
        course = passage.course(unknowns)
        line = course.lines[stretch]
        ior = passage.glass.media[passage.media[stretch]]
        e = [q - o for q, o in zip(aims, line.place, strict=True)]
        way = sum(part * p for part, p in zip(e, line.momentum, strict=True)) / ior**2
        off = [part - way * p for part, p in zip(e, line.momentum, strict=True)]
        residual = np.sqrt(sum(part * part for part in off))
        length = course.lengths[stretch] + way * ior
        edge = 1e-9 * (1.0 + np.abs(length))
        on = (way >= -edge) & (way <= course.ways[stretch] + edge)
        x, y, _ = (np.broadcast_to(part, residual.shape) for part in line.at(way))
        outward = x * line.momentum[0] + y * line.momentum[1] > 0.0
        # ℓ, the invariant of all of the ray
        ell = line.place[0] * line.momentum[1] - line.place[1] * line.momentum[0]
        return Found(
            np.array(index),
            np.stack(unknowns, axis=-1),
            np.array(length),
            residual,
            residual / (1.0 + np.abs(length)),
            on & passage.taken(course),
            (bend > 0.0) != passage.mirrored(stretch),
            ell * np.ones_like(residual),
            outward,
        )


PIECE = 262144
"""Pairs of targets and cells looked at at once."""

BLOCK = 8192
"""Starts solved at once."""

MOST = 24
"""Most steps of Newton's method from one start."""

FOLDED = ((0.0, 0.0), (-0.35, -0.35), (0.35, -0.35), (0.35, 0.35), (-0.35, 0.35))
"""Starts in a cell that a caustic may cross."""


@dataclass
class Found:
    """Rays that meet targets: (F,) each, unknowns (F, 3)."""

    index: NDArray[np.intp]
    unknowns: Floats
    length: Floats
    residual: Floats
    miss: Floats
    valid: NDArray[np.bool_]
    upright: NDArray[np.bool_]
    ell: Floats
    outward: NDArray[np.bool_]

    def columns(self):
        return tuple(getattr(self, name) for name in self.__dataclass_fields__)

    def take(self, which) -> Found:
        return Found(*(part[which] for part in self.columns()))

    def put(self, where, other: Found) -> None:
        for mine, part in zip(self.columns(), other.columns(), strict=True):
            mine[where] = part


def _join(parts: list[Found]) -> Found:
    return Found(
        *(np.concatenate(columns) for columns in zip(*(p.columns() for p in parts), strict=True))
    )


def _distinct(found: Found) -> Found:
    """One of each image that was found from several starts; in order of the targets."""
    mark = found.unknowns @ (0.6123724356957945, 0.5314370481203, 0.5853694070049635)
    order = np.lexsort((mark, found.index))
    found = found.take(order)
    same = np.append(False, found.index[1:] == found.index[:-1])[: len(order)]
    gap = np.abs(np.diff(found.unknowns, axis=0, prepend=np.inf)).max(axis=1, initial=0.0)
    alike = np.append(False, found.upright[1:] == found.upright[:-1])[: len(order)]
    again = same & ((gap < 1e-10) | (alike & (gap < 1e-7)))
    return found.take(np.flatnonzero(~again))


# ---- sheets ---------------------------------------------------------------------------------


class Central:
    """Rays of a path in the plane of eye and axis (ℓ = 0), and where they are upright.

    Round the axis they decide how images on either side of that plane are named: where the
    central ray to a target's circle is upright, no caustic lies between, and images that are
    upside down come in two, left and right of it; where it is upside down itself, all of these
    are one sheet.
    """

    def __init__(self, lattice: Lattice, stretch: int) -> None:
        passage = lattice.passage
        self.stretch = stretch
        view = passage.view
        towards = view.eye if not view.parallel else tuple(-part for part in view.direction)
        away = float(np.hypot(towards[0], towards[1]))
        self.on_axis = away < 1e-9 * (1.0 + abs(towards[2]))
        if self.on_axis:
            return
        self.along = np.array(towards[:2]) / away
        share = lattice.patch.middle_line(self.along, CENTRAL)
        places = tuple(part.ravel() for part in lattice.patch.places(share))
        rays, _ = first_rays(passage.glass, view, places)
        unknowns = lattice._unknowns(rays)
        real = passage.taken(passage.course(unknowns))
        line, exists = passage.line(unknowns, stretch)
        x, y, z = line.place
        px, py, self.pz = line.momentum
        self.x, self.z = x * self.along[0] + y * self.along[1], z * np.ones_like(px)
        self.px = px * self.along[0] + py * self.along[1]
        # Out of the plane only one combination of the two slopes leads: the one across.
        one, other = passage.basis if view.parallel else _basis(*unknowns)
        across = [-tilt[0] * self.along[1] + tilt[1] * self.along[0] for tilt in (one, other)]
        size = np.maximum(across[0] ** 2 + across[1] ** 2, 1e-300)

        def sideways(axis):
            moved = 0.0
            for share, slope in zip(across, line.slopes, strict=True):
                part = -slope[axis] * self.along[1] + slope[axis + 1] * self.along[0]
                moved = moved + share * part
            return moved / size

        self.off, self.turn = sideways(0), sideways(3)
        self.joined = real & exists
        self.joined = self.joined[:, None].reshape(share.shape[:2])
        self.shape = share.shape[:2]

    def upright(self, radius: Floats, z: Floats, outward) -> NDArray[np.intp]:
        """+1 where the central ray to a circle (on its leg out or in) is upright, −1 upside down,
        0 where there is none."""
        result = np.zeros(len(radius), dtype=np.intp)
        if self.on_axis:
            return result
        slope = self.pz / np.where(self.px == 0.0, 1e-300, self.px)
        rows = max(1, PIECE // max(1, self.x.size))
        for begin in range(0, len(radius), rows):
            some = slice(begin, begin + rows)
            for side in (-1.0, 1.0):
                x = side * radius[some, None]
                ahead = (x - self.x) / np.where(self.px == 0.0, 1e-300, self.px)
                over = self.z + slope * (x - self.x) - z[some, None]
                leg = ((side * self.px > 0.0) == outward[some, None]) & (ahead > -1e-9)
                upright = self.off + ahead * self.turn > 0.0
                leg &= self.joined.ravel()
                leg, over, upright = (
                    part.reshape(-1, *self.shape) for part in (leg, over, upright)
                )
                crosses = (over[..., 1:] > 0.0) != (over[..., :-1] > 0.0)
                crosses &= leg[..., 1:] & leg[..., :-1]
                up, down = (
                    (crosses & part[..., 1:]).any(axis=(1, 2)) for part in (upright, ~upright)
                )
                result[some] = np.where(up, 1, np.where(down, -1, result[some]))
        return result


CENTRAL = 65
"""Rays in the plane of eye and axis."""


def _ranks(search: Search, found: Found) -> NDArray[np.intp]:
    """Number of each image among those of its orientation: 0, or 0 left and 1 right."""
    rank = np.zeros(len(found.index), dtype=np.intp)
    if not len(rank):
        return rank
    again = np.append(False, found.index[1:] == found.index[:-1])[: len(rank)]
    if found.upright.all() and not again.any():
        return rank
    key = "central", search.stretch
    lattice = search.lattice
    if key not in lattice.tubes:
        lattice.tubes[key] = Central(lattice, search.stretch)
    central = lattice.tubes[key]
    targets = search.targets[found.index]
    upright = central.upright(np.hypot(targets[:, 0], targets[:, 1]), targets[:, 2], found.outward)
    apart = (upright != np.where(found.upright, 1, -1)) & (not central.on_axis)
    rank[apart & (found.ell > 0.0)] = 1
    return rank


def axial_slots(
    glass: AxialGlass, path: LightPath, eye, points: Floats, tolerance: float
) -> tuple[list[Slot], int]:
    """The images of finite points (N, 3) along a path, a slot a sheet, and the most steps."""
    where = eye if isinstance(eye, ParallelView) else tuple(float(part) for part in eye)
    if path.interfaces is None:
        ways = realisations(glass, where, path.events)
    else:
        for name in path.interfaces:
            glass.named(name)
        ways = (steps_of(path),)
    slots, most = [], 0
    for steps in ways:
        if not steps or not len(points):
            continue
        lattice = lattice_of(glass, where, steps)
        if lattice is None:
            continue
        for stretch in range(1, len(steps) + 1):
            inside = np.flatnonzero(glass.holds(lattice.passage.media[stretch], points))
            if not len(inside):
                continue
            search = Search(lattice, stretch, points[inside] / glass.scale, tolerance)
            found, stays, number = search.images()
            if not found.valid.any():
                continue
            most = max(most, number)
            slots += _slots(search, found, stays, inside, len(points), eye)
    return slots, most


def _slots(search: Search, found: Found, stays: Found, inside, count: int, eye) -> list[Slot]:
    """One slot a sheet; points without an image wait where the sheet ends."""
    passage = search.passage
    names = tuple(step[0] for step in passage.steps)
    rank = _ranks(search, found)
    # Which of several images of one name: the valid first, then nearest to the central plane.
    order = np.lexsort((np.abs(found.ell), ~found.valid, rank, found.upright, found.index))
    found, rank = found.take(order), rank[order]
    same = np.append(
        False,
        (found.index[1:] == found.index[:-1])
        & (rank[1:] == rank[:-1])
        & (found.upright[1:] == found.upright[:-1]),
    )[: len(rank)]
    number = np.arange(len(rank))
    copy = number - np.maximum.accumulate(np.where(same, 0, number))
    slots = []
    keys = np.stack([found.upright, rank, copy])
    for key in np.unique(keys[:, found.valid], axis=1).T:
        upright, own_rank, own_copy = (int(part) for part in key)
        images = stays.take(slice(None))
        images = Found(*(np.array(part) for part in images.columns()))
        images.valid[:] = False
        some = np.flatnonzero((keys == key[:, None]).all(axis=0))
        images.put(found.index[some], found.take(some))
        if own_rank:
            # Round a cusp the sheets of one orientation are one: go on along the first.
            lost = np.ones(len(images.index), dtype=bool)
            lost[found.index[some]] = False
            first = np.flatnonzero(
                (keys[0] == upright) & (keys[1] == 0) & (keys[2] == 0) & lost[found.index]
            )
            images.put(found.index[first], found.take(first))
            images.valid[found.index[first]] = False
        sheet = (search.stretch, names, upright, own_rank, 0, own_copy)
        slots.append(_written(passage, sheet, images, inside, count, eye))
    return slots


def _written(passage: Passage, sheet, images: Found, inside, count: int, eye) -> Slot:
    """A slot of all points, in metres."""
    slot = Slot.blank(sheet, count, eye)
    scale = passage.glass.scale
    if passage.view.parallel:
        direction = np.array(passage.view.direction)
        distance = images.length - passage.away
        slot.direction[:] = direction
        slot.position[inside] = (images.unknowns + distance[:, None] * direction) * scale
    else:
        distance = images.length
        slot.direction[inside] = images.unknowns
        slot.position[inside] = eye + (distance * scale)[:, None] * images.unknowns
    slot.distance[inside] = distance * scale
    slot.residual[inside] = images.residual * scale
    slot.valid[inside] = images.valid
    return slot
