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

from .axial import AxialGlass, realisations, steps_of
from .axial_rays import Passage, Unknowns
from .images import Slot
from .paths import LightPath, ParallelView
from .solver import in_blocks
from .surfaces import Floats
from .vectors import basis

ENOUGH = 40
"""Cells that a path's region should have before refinement."""

DRAWN = 16
"""Halvings of the way to where rays begin to exist."""

INSIDE = 1e-4
"""Distance from the edges of the first interface's rectangle, in parts of it, for the same."""

AROUND = 0.3
"""Parts of a cell around it in which the path's region counts as touching it."""

WORK = 60_000
"""Cells times events of a level that is still looked at closely. A path that runs round in the wall
along ten mirrors has a region of threads: finer levels took a minute and more."""

UNEVEN = 0.15
"""How far the middle ray of a cell may lie from its corners' mean, in sizes of the cell."""

CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.5, 0.5)])


@dataclass
class Tubes:
    """Bundles of all cells on one stretch.

    `middle`, `axis`: (C, 3) a point on the middle ray and its unit direction. `corners`:
    (2, 2, 4, C) places of the corners across the axis, [constant and per way s along it, side,
    corner]. `table`: (28, C) what `Search.shares` needs: three lines of a frame with its origin,
    and the quadrangle's mean, two edges and twist, each as in `corners`. `low`, `high`: where the
    stretch runs, (C,). `loose`: rays fan out too widely for all this.
    """

    middle: Floats
    axis: Floats
    corners: Floats
    table: Floats
    low: Floats
    high: Floats
    loose: NDArray[np.bool_]


class Lattice:
    """The cells of one path from one viewpoint: `unknowns` (C, 5, 3) of corners and middle, and
    `cells` (C, 2, 2): low corner and size in shares of the first interface's rectangle."""

    def __init__(self, passage: Passage) -> None:
        self.passage = passage
        stage = passage.stages[0]
        self.patch = stage.surface.sample(passage.view, stage.back)
        self.unknowns, self.cells = np.zeros((0, 5, 3)), np.zeros((0, 2, 2))
        self.tubes: dict[int, Tubes] = {}
        if self.patch is None:
            return
        rows, columns = self.patch.base
        cells = np.stack(
            np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1
        ).reshape(-1, 2) / (rows, columns)
        size = np.broadcast_to(1.0 / np.array(self.patch.base), cells.shape)
        kept = []
        for level in range(self.patch.deepest + 1):
            # The cells of the path's region; where rays are no longer taken but still exist,
            # cells reach over its end.
            some = self._touched(cells, size) if level else self._touched_first()
            if not some.any() and level < 2:
                cells, size = _halve(cells, size)  # a thin region may lie between the rays
                continue
            cells, size = cells[some], size[some]
            share = cells[:, None] + size[:, None] * CORNERS
            unknowns, course = self._look(share)
            if level == self.patch.deepest or 4 * len(cells) * len(passage.stages) > WORK:
                split = np.zeros(len(cells), dtype=bool)
            elif len(cells) < ENOUGH and level < self.patch.deepest - 1:
                split = np.ones(len(cells), dtype=bool)
            else:
                split = ~course.exists.reshape(-1, 5).all(axis=1)
                if level < 2:
                    split |= _uneven([_arrays(line, unknowns.shape[:2]) for line in course.lines])
            kept.append((share[~split], np.stack([cells, size], axis=1)[~split]))
            cells, size = _halve(cells[split], size[split])
            if not len(cells):
                break
        if kept:
            share, cells = (np.concatenate(parts) for parts in zip(*kept, strict=True))
            share, found = self._drawn_in(share)
            self.unknowns, course = self._look(share)
            self.cells = cells[found]
            self.marks = [None if mark is None else mark[:, 4::5] for mark in course.marks]

    def _takes(self, share) -> NDArray[np.bool_]:
        # Just inside the rectangle's edges: thin regions often lie along them.
        share = np.clip(share, INSIDE, 1.0 - INSIDE)
        flat = tuple(part.ravel() for part in self.patch.places(share))
        return self.passage.takes(flat).reshape(share.shape[:-1])

    def _touched_first(self) -> NDArray[np.bool_]:
        """Cells of the first lattice that the path's region touches, or their neighbours'
        nearer parts."""
        base, looks = self.patch.base, self.patch.looks
        rows, columns = (count * looks + 1 for count in base)
        share = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
        self.grid = self._takes(np.stack(share, axis=-1))
        takes = np.pad(self.grid, looks // 2)
        touched = np.zeros(base, dtype=bool)
        for row in range(2 * looks + 1):
            part = takes[row : row + base[0] * looks : looks]
            for column in range(2 * looks + 1):
                touched |= part[:, column : column + base[1] * looks : looks]
        self.inner = _eroded(self.grid)
        return touched.ravel()

    def certain(self, unknowns: Unknowns) -> NDArray[np.bool_]:
        """Rays deep within the path's region: they need no proof that they take it."""
        rows, columns = self.inner.shape
        first, second = self.patch.shares(unknowns)
        row, column = np.rint(first * (rows - 1)), np.rint(second * (columns - 1))
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = (np.where(inside, part, 0).astype(np.intp) for part in (row, column))
        return inside & self.inner[row, column]

    def _touched(self, cells, size) -> NDArray[np.bool_]:
        """Cells that the path's region touches, or comes near to."""
        side = np.linspace(-AROUND, 1.0 + AROUND, self.patch.looks)
        inner = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
        return self._takes(cells[:, None] + size[:, None] * inner).any(axis=1)

    def _look(self, share):
        """Unknowns (C, K, 3) of rays at shares (C, K, 2) of the rectangle, and their course."""
        flat = tuple(part.ravel() for part in self.patch.places(share))
        unknowns = np.stack(flat, axis=-1).reshape(*share.shape[:2], len(flat))
        return unknowns, self.passage.course(flat)

    def _drawn_in(self, share):
        """Cells (C, 5, 2) whose missing rays are drawn in to where rays exist; which have any."""
        exists = self._look(share)[1].exists.reshape(-1, 5)
        found = exists.any(axis=1)
        share, exists = share[found].copy(), exists[found]
        # A corner is drawn in along an edge, if it can: neighbours then leave no gap.
        towards = np.broadcast_to(np.argmax(exists, axis=1)[:, None], exists.shape).copy()
        towards[exists[:, 4]] = 4
        for corner in range(4):
            for neighbour in ((corner - 1) % 4, (corner + 1) % 4):
                towards[exists[:, neighbour], corner] = neighbour
        self._draw(share, *np.nonzero(~exists[:, :4]), towards)
        middle = np.flatnonzero(~exists[:, 4])
        share[middle, 4] = share[middle, :4].mean(axis=1)
        missing = ~self._look(share[middle, 4:])[1].exists
        self._draw(share, middle[missing], np.full(missing.sum(), 4), towards)
        return share, found

    def _draw(self, share, cell, ray, towards) -> None:
        """Move rays of cells to where rays begin to exist on the way to other rays."""
        inside, outside = share[cell, towards[cell, ray]], share[cell, ray]
        for _ in range(DRAWN if len(cell) else 0):
            half = 0.5 * (inside + outside)
            there = self._look(half[:, None])[1].exists[:, None]
            inside, outside = np.where(there, half, inside), np.where(there, outside, half)
        share[cell, ray] = inside

    def on(self, stretch: int) -> Tubes:
        """The bundles on a stretch."""
        if stretch not in self.tubes:
            self.tubes[stretch] = self._tubes(stretch)
        return self.tubes[stretch]

    def _tubes(self, stretch: int) -> Tubes:
        shape = self.unknowns.shape[:2]
        flat = tuple(np.moveaxis(self.unknowns, -1, 0).reshape(self.unknowns.shape[-1], -1))
        course = self.passage.course(flat)
        place, axis = _arrays(course.lines[stretch], shape)
        ior = self.passage.glass.media[self.passage.media[stretch]]
        way = (course.ways[stretch] * ior).reshape(shape)
        middle, along = place[:, 4], axis[:, 4]
        first, second = (np.stack(part, axis=-1) for part in basis(*along.T))
        facing = np.einsum("cjk,ck->cj", axis, along)
        loose = (facing < 0.3).any(axis=1)
        facing = np.maximum(facing, 0.3)
        offset = place - middle[:, None]
        ahead = np.einsum("cjk,ck->cj", offset, along)
        onto = offset - (ahead / facing)[..., None] * axis

        def across(vectors):
            return np.stack(
                [np.einsum("cjk,ck->cj", vectors, side) for side in (first, second)], axis=-1
            )

        ends = ahead + way * facing
        spread = np.sqrt(np.sum(offset * offset, axis=-1)).max(axis=1)
        corners = np.stack([across(onto), across(axis / facing[..., None])])[:, :, :4]
        corners = np.ascontiguousarray(np.moveaxis(corners, 1, -1).swapaxes(1, 2))
        one, two, three, four = np.moveaxis(corners, 2, 0)
        forms = np.stack(
            [
                0.25 * (one + two + three + four),
                0.5 * (two + three - one - four),
                0.5 * (three + four - one - two),
                one + three - two - four,
            ]
        )
        frame = [
            np.column_stack([side, -np.sum(side * middle, axis=1)])
            for side in (along, first, second)
        ]
        table = np.concatenate([*(part.T for part in frame), forms.reshape(16, -1)])
        return Tubes(
            middle,
            along,
            corners,
            table,
            ahead.min(axis=1) - 0.5 * spread,
            ends.max(axis=1) + 0.5 * spread,
            loose,
        )


def _arrays(line, shape) -> tuple[Floats, Floats]:
    """Places and unit directions of rays as (C, 5, 3)."""
    count = shape[0] * shape[1]
    place, momentum = (
        np.stack([np.broadcast_to(part, count) for part in parts], axis=-1).reshape(*shape, 3)
        for parts in (line.place, line.momentum)
    )
    size = np.sqrt(np.sum(momentum * momentum, axis=-1, keepdims=True))
    return place, momentum / np.maximum(size, 1e-300)


def _eroded(grid) -> NDArray[np.bool_]:
    """Places of a grid whose neighbours up to two off are set too."""
    padded = np.pad(grid, 2)
    result = grid.copy()
    for row in range(5):
        for column in range(5):
            result &= padded[row : row + grid.shape[0], column : column + grid.shape[1]]
    return result


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
def lattice_of(glass: AxialGlass, eye, steps, is_open: bool = False) -> Lattice | None:
    """The lattice of a path; None where no ray takes it. `eye`: a tuple or a parallel view."""
    where = eye if isinstance(eye, ParallelView) else np.array(eye)
    passage = Passage(glass, where, steps, is_open)
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

    def members(self, group, cell) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pairs of targets and cells from pairs of groups and cells."""
        count = self.count[group]
        begins = np.repeat(self.first[group] - (np.cumsum(count) - count), count)
        return self.order[begins + np.arange(len(begins))], np.repeat(cell, count)


def cluster(points: Floats) -> Clusters:
    """Groups of targets (N, 3), of a size that grows with the distance from the glass."""
    reach = np.sqrt(np.sum(points * points, axis=1))
    squeezed = points / (1.0 + reach / NEAR)[:, None]
    low = squeezed.min(axis=0)
    span = max(float((squeezed.max(axis=0) - low).max()), 1e-9)
    parts = max(1, min(14, round((len(points) / 40.0) ** 0.4)))
    if len(points) <= 400:
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


def _locate(x, y, forms):
    """Shares (−½ to ½) of places in quadrangles, how uneven these are, and which a caustic may
    cross."""
    (mean_x, mean_y), (ax, ay), (bx, by), (tx, ty) = forms
    area = ax * by - ay * bx
    # Area at the corners: half the twist added or taken away
    lean = np.abs(ax * ty - ay * tx) + np.abs(tx * by - ty * bx)
    inverse = 1.0 / np.where(area == 0.0, 1e-300, area)

    def solve(x, y):
        return (x * by - y * bx) * inverse, (ax * y - ay * x) * inverse

    x, y = x - mean_x, y - mean_y
    first, second = (np.clip(part, -2.0, 2.0) for part in solve(x, y))
    product = first * second
    first, second = (np.clip(part, -9.0, 9.0) for part in solve(x - product * tx, y - product * ty))
    bulges = [np.abs(part) for part in solve(mean_x, mean_y)]
    return first, second, bulges, (np.abs(area) <= 0.75 * lean) | (np.maximum(*bulges) > 0.5)


NEAR = 8.0
"""Distance in outer radii from which groups of targets grow."""

WIDER = 1.4
"""A cell's rays may lie this much farther from its middle than its corners do."""

FOLD_BRIM = 0.15
"""The same for cells that a caustic may cross, in parts of the box round their corners."""

BRIM = 0.12
"""Part of a cell by which targets may lie outside it, besides what its unevenness tells."""


class Search:
    """The images of some targets on one stretch."""

    def __init__(self, lattice: Lattice, stretch: int, targets: Floats, tolerance: float) -> None:
        self.lattice, self.stretch, self.targets = lattice, stretch, targets
        self.passage = lattice.passage
        self.tolerance = tolerance
        self.tubes = lattice.on(stretch)
        self.columns = tuple(np.ascontiguousarray(part) for part in targets.T)

    def starts(self):
        """Candidates: target, unknowns, those of a ray that exists, and its marks."""
        groups = cluster(self.targets)
        group, cell, self.nearest = self._pairs(groups)
        calm, best = self._calm(groups, group, cell)
        self.rough = np.ones(len(self.targets), dtype=bool)
        self.rough[groups.order[np.repeat(calm, groups.count)]] = False
        # Groups that one sheet covers: any cell of it tells where a target is.
        index = groups.order[np.repeat(calm, groups.count)]
        cells = np.repeat(best, groups.count)[np.repeat(calm, groups.count)]
        near, _, _ = self._shares(index, cells)
        found = [(index, cells, np.clip(near, -FAR_OFF, FAR_OFF))]
        # The others, target by target
        rough = ~calm[group]
        target, cell = groups.members(group[rough], cell[rough])
        for part in range(0, len(target), PIECE):
            some = slice(part, part + PIECE)
            near, inside, fold = self._shares(target[some], cell[some])
            found.append(
                (target[some][inside], cell[some][inside], np.clip(near[inside], -0.75, 0.75))
            )
            folded = np.flatnonzero(fold)
            for inset in FOLDED:
                shares = np.broadcast_to(inset, (len(folded), 2))
                found.append((target[some][folded], cell[some][folded], shares))
        index, cells, shares = (np.concatenate(part) for part in zip(*found, strict=True))
        anchor = tuple(self.lattice.unknowns[cells, 4].T)
        return index, self._blend(cells, shares), anchor, self._marks(cells)

    def _marks(self, cells):
        return [None if mark is None else mark[:, cells] for mark in self.lattice.marks]

    def waiting(self, index) -> Found:
        """The rays that come nearest to targets without an image."""
        cells = self.nearest[index]
        shares, _, _ = self._shares(index, cells)
        unknowns = self._blend(cells, np.clip(shares, -0.5, 0.5))
        aims = tuple(self.targets[index].T)
        ones = np.ones(len(index))
        return self._describe(index, unknowns, aims, ones, self._marks(cells), proof=False)

    def _pairs(self, groups: Clusters):
        """Which groups may have targets in which tubes, and the tube nearest to each target."""
        tubes, n = self.tubes, len(groups.centre)
        found_group, found_cell = [], []
        nearest = np.zeros(n, dtype=np.intp)
        rows = max(1, SMALL_PIECE // max(1, len(tubes.low)))
        # |at + s·fan|² of every corner as coefficients of 1, s, s²; single precision will do.
        at, fan = tubes.corners
        squares = [np.sum(at**2, axis=0), 2.0 * np.sum(at * fan, axis=0), np.sum(fan**2, axis=0)]
        squares = [part.astype(np.float32) for part in squares]
        axis, middle = (part.T.astype(np.float32) for part in (tubes.axis, tubes.middle))
        origin = np.sum(tubes.middle * tubes.axis, axis=1).astype(np.float32)
        size2 = np.sum(tubes.middle**2, axis=1).astype(np.float32)
        low, high = tubes.low.astype(np.float32), tubes.high.astype(np.float32)
        wider = np.where(tubes.loose, 2.0 * WIDER, WIDER).astype(np.float32)
        centres, radii = groups.centre.astype(np.float32), groups.radius.astype(np.float32)
        lengths2 = np.sum(groups.centre**2, axis=1).astype(np.float32)
        for begin in range(0, n, rows):
            some = slice(begin, begin + rows)
            s = centres[some] @ axis
            away = centres[some] @ middle
            s -= origin
            away *= -2.0
            away += lengths2[some, None]
            away += size2
            away -= s * s
            np.maximum(away, 0.0, out=away)
            np.sqrt(away, out=away)
            spread = np.zeros_like(s)
            for constant, linear, square in zip(*squares, strict=True):
                reach = square * s
                reach += linear
                reach *= s
                reach += constant
                np.maximum(spread, reach, out=spread)
            np.sqrt(spread, out=spread)
            beyond = np.maximum(low - s, s - high)
            np.maximum(beyond, 0.0, out=beyond)
            blur = radii[some] + 1e-6 + 2e-3 * np.sqrt(lengths2[some])
            blur = blur[:, None]
            hit = away <= blur + wider * spread
            hit &= beyond <= blur
            group, cell = np.nonzero(hit)
            found_group.append(group + begin)
            found_cell.append(cell)
            away -= spread
            np.maximum(away, 0.0, out=away)
            away += beyond
            away /= 1.0 + np.abs(s)
            nearest[some] = np.argmin(away, axis=1)
        every = np.empty(len(groups.order), dtype=np.intp)
        every[groups.order] = np.repeat(nearest, groups.count)
        return np.concatenate(found_group), np.concatenate(found_cell), every

    def _calm(self, groups: Clusters, group, cell):
        """Groups whose tubes all belong to one sheet that no caustic crosses; and a cell of it."""
        n = len(groups.centre)
        centre, radius = groups.centre[group].T, groups.radius[group]
        s, x, y, forms = self._quadrangle(centre, cell)
        first, second, _, fold = _locate(x, y, forms)
        steady = ~fold & ~self.tubes.loose[cell]
        area = forms[1][0] * forms[2][1] - forms[1][1] * forms[2][0]
        for shift in (-radius, radius):
            (ax, ay), (bx, by), _ = self._forms(s + shift, cell)[1:]
            steady &= (ax * by - ay * bx) * area > 0.0
        rough = np.bincount(group[~steady], minlength=n) > 0
        rough |= np.bincount(group, minlength=n) == 0
        low, high = np.full((2, n), np.inf), np.full((2, n), -np.inf)
        size = np.zeros((2, n))
        for axis, share in enumerate((first, second)):
            corner, width = self.lattice.cells[cell, 0, axis], self.lattice.cells[cell, 1, axis]
            place = corner + (share + 0.5) * width
            np.minimum.at(low[axis], group, place)
            np.maximum.at(high[axis], group, place)
            np.maximum.at(size[axis], group, width)
        sign_low, sign_high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(sign_low, group, np.sign(area))
        np.maximum.at(sign_high, group, np.sign(area))
        calm = ~rough & (sign_low == sign_high) & ~(high - low > 1.5 * size).any(axis=0)
        off = np.maximum(np.abs(first), np.abs(second))
        order = np.lexsort((off, group))
        best = np.zeros(n, dtype=np.intp)
        leads = np.append(True, group[order][1:] != group[order][:-1])[: len(order)]
        best[group[order][leads]] = cell[order][leads]
        return calm, best

    def _forms(self, s, cell):
        """Mean, edges and twist of the quadrangle across the middle ray at s: pairs of sides."""
        return [
            [constant[cell] + s * growth[cell] for constant, growth in zip(*form, strict=True)]
            for form in self.tubes.table[12:].reshape(4, 2, 2, -1)
        ]

    def _quadrangle(self, places, cell):
        """Where places (3 parts) lie along the middle ray and across it, and the forms there."""
        frame = self.tubes.table[:12].reshape(3, 4, -1)
        s, x, y = (
            places[0] * line[0][cell]
            + places[1] * line[1][cell]
            + places[2] * line[2][cell]
            + line[3][cell]
            for line in frame
        )
        return s, x, y, self._forms(s, cell)

    def _shares(self, target, cell):
        """Where targets lie in cells (P, 2), −½ to ½; which are inside; which need more starts."""
        places = [part[target] for part in self.columns]
        _, x, y, forms = self._quadrangle(places, cell)
        first, second, bulges, fold = _locate(x, y, forms)
        fold |= self.tubes.loose[cell]
        inside = ~fold
        for part, bulge in zip((first, second), bulges, strict=True):
            inside &= np.abs(part) <= 0.5 + BRIM + bulge
        for off, mean, one, other, twist in zip((x, y), *forms, strict=True):
            reach = np.abs(one) + np.abs(other) + 0.5 * np.abs(twist)
            fold &= np.abs(off - mean) <= (0.5 + FOLD_BRIM) * reach + np.abs(mean) + 1e-6
        return np.stack([first, second], axis=-1), inside, fold

    def _blend(self, cells, shares) -> Unknowns:
        """Unknowns at shares (−½ to ½) of cells."""
        u = self.lattice.unknowns[cells]
        first, second = (shares + 0.5).T
        weights = (
            (1.0 - first) * (1.0 - second),
            first * (1.0 - second),
            first * second,
            (1.0 - first) * second,
        )
        blended = tuple(
            sum(weight * u[:, corner, axis] for corner, weight in enumerate(weights))
            for axis in range(u.shape[-1])
        )
        return self.passage.first.onto(blended)

    def images(self) -> tuple[Found, int]:
        """Images, and the most steps taken."""
        index, unknowns, anchor, marks = self.starts()
        count = len(index)
        parts: list[tuple[int, Found, int]] = []

        def work(block: slice) -> None:
            aims = tuple(self.targets[index[block]].T)
            some = tuple(part[block] for part in unknowns)
            sure = tuple(part[block] for part in anchor)
            near = [None if mark is None else mark[:, block] for mark in marks]
            parts.append((block.start, *self._settle(index[block], some, sure, aims, near)))

        if count:
            in_blocks(work, count, BLOCK)
        else:
            work(slice(0, 0))
        # The order in which threads end must not show.
        parts.sort(key=lambda part: part[0])
        found = _join([part for _, part, _ in parts])
        most = max(steps for *_, steps in parts)
        rough = np.flatnonzero(self.rough[found.index])
        if len(rough):
            found = _join([found, self._partners(found.take(rough))])
        return _distinct(found, max(1e-7, 3.0 * self.tolerance)), most

    def _partners(self, found: Found) -> Found:
        """The images across the fold next to these: two that are close may share all starts.

        Along the direction n in which the Jacobian is weakest its determinant is 0 a way
        −D / (∂D/∂n) off, and the other image lies twice as far.
        """
        passage = self.passage
        unknowns = tuple(found.unknowns.T)
        aims = tuple(self.targets[found.index].T)
        with np.errstate(all="ignore"):
            marks = _split(found.marks)
            one, other, bend, marks = passage.weakest(unknowns, aims, self.stretch, marks)
            moved = passage.first.slide(unknowns, NUDGE * one, NUDGE * other)
            _, _, bent, exists, marks = passage.step(moved, aims, self.stretch, marks)
            way = -2.0 * NUDGE * bend / (bent - bend)
            near = np.flatnonzero(exists & (np.abs(way) < ACROSS))
        some = tuple(part[near] for part in unknowns)
        way, one, other = way[near], one[near], other[near]
        begins = passage.first.slide(some, way * one, way * other)
        marks = [None if mark is None else mark[:, near] for mark in marks]
        marks += [None] * (len(passage.stages) - len(marks))
        aims = tuple(part[near] for part in aims)
        return self._settle(found.index[near], begins, some, aims, marks)[0]

    def _settle(self, index, unknowns, anchor, aims, marks) -> tuple[Found, int]:
        """Solve from all starts; what meets its target, described."""
        fine = self.tolerance <= 1e-8
        small = 1e-6 if fine else 0.03 * self.tolerance**0.5
        unknowns, bend, steps, rests, marks = self.passage.solve(
            unknowns, anchor, aims, self.stretch, marks, small=small, most=MOST
        )
        keep = np.flatnonzero(rests)
        unknowns, aims = (tuple(part[keep] for part in parts) for parts in (unknowns, aims))
        marks = [None if mark is None else mark[:, keep] for mark in marks]
        found = self._describe(index[keep], unknowns, aims, bend[keep], marks)
        again = np.flatnonzero(found.miss > self._allowed())
        if len(again):
            some, goal = (tuple(part[again] for part in parts) for parts in (unknowns, aims))
            marks = [None if mark is None else mark[:, again] for mark in marks]
            some, bend, _, _, marks = self.passage.solve(
                some, some, goal, self.stretch, marks, small=1e-12, most=MOST
            )
            found.put(again, self._describe(found.index[again], some, goal, bend, marks))
        passes = np.flatnonzero(found.miss <= 10.0 * self._allowed())
        return found.take(passes), int(steps[keep].max(initial=0))

    def _allowed(self) -> float:
        return max(self.tolerance * 0.03, 1e-12)

    def _describe(self, index, unknowns, aims, bend, marks, proof=True) -> Found:
        """Where rays run that should meet targets."""
        passage, stretch = self.passage, self.stretch
        course = passage.course(unknowns, marks)
        line = course.lines[stretch]
        ior = passage.glass.media[passage.media[stretch]]
        e = [q - o for q, o in zip(aims, line.place, strict=True)]
        way = sum(part * p for part, p in zip(e, line.momentum, strict=True)) / ior**2
        off = [part - way * p for part, p in zip(e, line.momentum, strict=True)]
        residual = np.sqrt(sum(part * part for part in off))
        length = course.lengths[stretch] + way * ior
        edge = 1e-9 * (1.0 + np.abs(length))
        on = course.exists & (way >= -edge) & (way <= course.ways[stretch] + edge)
        unsure = np.flatnonzero(on & ~self.lattice.certain(unknowns)) if proof else []
        on[unsure] = passage.takes(tuple(part[unsure] for part in unknowns))
        if passage.open and stretch == len(passage.stages):
            on &= ~passage.cut_off(line, way, on)
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
            on,
            bend * passage.upright_sign(stretch) > 0.0,
            ell * np.ones_like(residual),
            outward,
            _joined(course.marks, len(residual)),
        )


PIECE = 262144
"""Pairs of targets and cells looked at at once."""

SMALL_PIECE = 65536
"""Pairs of groups and cells looked at at once: they stay in a core's cache."""

FARTHEST = 1e9
"""Outer radii beyond which a target is moved nearer."""

FAR_OFF = 3.0
"""Cells by which a target may lie outside the cell that tells its start."""

BLOCK = 8192
"""Starts solved at once."""

NUDGE = 1e-6
"""Step of a derivative by the unknowns."""

ACROSS = 0.5
"""How far apart on the first interface two rays may be, outer radii, to be looked for across the
fold between them."""

MOST = 12
"""Most steps of Newton's method from one start."""

FOLDED = ((0.0, 0.0), (-0.35, -0.35), (0.35, -0.35), (0.35, 0.35), (-0.35, 0.35))
"""Starts in a cell that a caustic may cross."""


@dataclass
class Found:
    """Rays that meet targets: (F,) each, unknowns (F, 3 or 4), marks (F, events or 0, 2)."""

    index: NDArray[np.intp]
    unknowns: Floats
    length: Floats
    residual: Floats
    miss: Floats
    valid: NDArray[np.bool_]
    upright: NDArray[np.bool_]
    ell: Floats
    outward: NDArray[np.bool_]
    marks: Floats

    def columns(self):
        return tuple(vars(self).values())

    def take(self, which) -> Found:
        return Found(*(part[which] for part in self.columns()))

    def blank(self, count: int) -> Found:
        """Arrays for that many, to be written."""
        return Found(*(np.empty((count, *part.shape[1:]), part.dtype) for part in self.columns()))

    def put(self, where, other: Found) -> None:
        for mine, part in zip(self.columns(), other.columns(), strict=True):
            mine[where] = part


def _joined(marks, count: int) -> Floats:
    """Marks of all events in one array, empty where no surface needs them."""
    if all(mark is None for mark in marks):
        return np.zeros((count, 0, 2))
    nothing = np.full((2, count), np.nan)
    return np.stack([nothing if mark is None else mark for mark in marks]).transpose(2, 0, 1)


def _split(marks: Floats):
    """The reverse of `_joined`, or None."""
    return list(marks.transpose(1, 2, 0)) if marks.shape[1] else None


def _join(parts: list[Found]) -> Found:
    return Found(
        *(np.concatenate(columns) for columns in zip(*(p.columns() for p in parts), strict=True))
    )


def _distinct(found: Found, close: float) -> Found:
    """One of each image that was found from several starts; in order of the targets."""
    mark = found.unknowns[:, :3] @ (0.6123724356957945, 0.5314370481203, 0.5853694070049635)
    order = np.lexsort((mark, found.index))
    found = found.take(order)
    same = np.append(False, found.index[1:] == found.index[:-1])[: len(order)]
    gap = np.abs(np.diff(found.unknowns, axis=0, prepend=np.inf)).max(axis=1, initial=0.0)
    alike = np.append(False, found.upright[1:] == found.upright[:-1])[: len(order)]
    again = same & ((gap < 1e-10) | (alike & (gap < close)))
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
        unknowns = tuple(part.ravel() for part in lattice.patch.places(share))
        real = passage.takes(unknowns)
        line, exists, _ = passage.line(unknowns, stretch)
        x, y, z = line.place
        px, py, self.pz = line.momentum
        self.x, self.z = x * self.along[0] + y * self.along[1], z * np.ones_like(px)
        self.px = px * self.along[0] + py * self.along[1]
        # Out of the plane only one combination of the two slopes leads: the one across.
        one, other = passage.first.tangents(*unknowns)
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
        with np.errstate(all="ignore"):
            return self._upright(result, radius, z, outward)

    def _upright(self, result, radius, z, outward):
        slope = self.pz / np.where(self.px == 0.0, 1e-300, self.px)
        rows = max(1, PIECE // max(1, self.x.size))
        for begin in range(0, len(radius), rows):
            some = slice(begin, begin + rows)
            for side in (-1.0, 1.0):
                x = side * radius[some, None]
                ahead = (x - self.x) / np.where(self.px == 0.0, 1e-300, self.px)
                over = self.z + slope * (x - self.x) - z[some, None]
                leg = ((side * self.px > 0.0) == outward[some, None]) & (ahead > -1e-9)
                upright = self.off > -ahead * self.turn
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
    # Only images upside down, or one of several, need to be told apart.
    again = np.append(False, found.index[1:] == found.index[:-1])[: len(rank)]
    again[:-1] |= again[1:]
    some = np.flatnonzero(again | ~found.upright)
    if not len(some):
        return rank
    key = "central", search.stretch
    lattice = search.lattice
    if key not in lattice.tubes:
        lattice.tubes[key] = Central(lattice, search.stretch)
    central = lattice.tubes[key]
    if central.on_axis:
        return rank
    targets = search.targets[found.index[some]]
    radius = np.hypot(targets[:, 0], targets[:, 1])
    upright = central.upright(radius, targets[:, 2], found.outward[some])
    apart = upright != np.where(found.upright[some], 1, -1)
    rank[some] = apart & (found.ell[some] > 0.0)
    return rank


def axial_slots(
    glass: AxialGlass, path: LightPath, eye, points: Floats, tolerance: float, only: int | None
) -> tuple[list[Slot], int]:
    """The images of finite points (N, 3) along a path, a slot a sheet, and the most steps.

    `only`: on this stretch, None for all.
    """
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
        lattice = lattice_of(glass, where, steps, path.open)
        if lattice is None:
            continue
        for stretch in range(1, len(steps) + 1):
            if only not in (None, stretch):
                continue
            inside = np.flatnonzero(glass.holds(lattice.passage.media[stretch], points))
            if not len(inside):
                continue
            # Beyond any picture all points are equally far; their squares must not overflow.
            targets = np.clip(points[inside] / glass.scale, -FARTHEST, FARTHEST)
            search = Search(lattice, stretch, targets, tolerance)
            found, number = search.images()
            if not found.valid.any():
                continue
            most = max(most, number)
            slots += _slots(search, found, inside, len(points), eye)
    return slots, most


def _slots(search: Search, found: Found, inside, count: int, eye) -> list[Slot]:
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
    # The name of a sheet as one number: sorting columns is slow.
    keys = found.upright + 2 * rank + 4 * copy
    sheets = []
    lost = np.zeros(len(inside), dtype=bool)
    for key in np.unique(keys[found.valid]).tolist():
        some = np.flatnonzero(keys == key)
        has = np.zeros(len(inside), dtype=bool)
        has[found.index[some]] = True
        name = key % 2, key // 2 % 2, key // 4
        first = some[:0]
        if name[1]:
            # Round a cusp the sheets of one orientation are one: go on along the first.
            first = np.flatnonzero((keys == name[0]) & ~has[found.index])
            has[found.index[first]] = True
        sheets.append((name, some, first))
        lost |= ~has
    lost = np.flatnonzero(lost)
    stays = search.waiting(lost)
    for (upright, own_rank, own_copy), some, first in sheets:
        images = found.blank(len(inside))
        images.put(lost, stays)
        images.put(found.index[first], found.take(first))
        images.valid[:] = False
        images.put(found.index[some], found.take(some))
        sheet = (search.stretch, names, upright, own_rank, 0, own_copy)
        slots.append(_written(passage, sheet, images, inside, count, eye))
    return slots


def _written(passage: Passage, sheet, images: Found, inside, count: int, eye) -> Slot:
    """A slot of all points, in metres."""
    slot = Slot.blank(sheet, count, eye)
    scale = passage.glass.scale
    towards = np.stack(passage.directions(tuple(images.unknowns.T))[0], axis=-1)
    slot.direction[inside] = towards
    distance = images.length
    if passage.view.parallel:
        distance = distance - passage.away
        places = images.unknowns[:, :3]
        ahead = np.sum(places * towards, axis=1)
        start = (places - ahead[:, None] * towards) * scale
        slot.direction[:] = passage.view.direction
    else:
        start = eye
    slot.position[inside] = start + (distance * scale)[:, None] * towards
    slot.distance[inside] = distance * scale
    slot.residual[inside] = images.residual * scale
    slot.valid[inside] = images.valid
    return slot
