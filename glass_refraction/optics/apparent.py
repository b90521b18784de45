# SPDX-License-Identifier: GPL-3.0-or-later
"""Where points appear along a light path: all images of all points, sheet by sheet."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import AxialGlass
from .axial_images import axial_slots
from .coaxial import COARSE, CoaxialPassage, taken_branches
from .flat import FlatPassage
from .glasses import FlatGlass, Glass
from .images import ApparentPoints, Slot
from .paths import Branch, LightPath, ParallelView, as_eye, as_path, branches
from .sheets import NO_PIECE, Curves, Leg, Placing, rank_of, strays
from .solver import BLOCK, in_blocks, newton

FARTHEST = 1e100
"""Metres: what lies farther, or nowhere, has no image. Products of such lengths overflow."""


def apparent_points(
    glass: Glass,
    path: LightPath | str,
    eye: ArrayLike | ParallelView,
    points: ArrayLike,
    *,
    tolerance: float = 1e-9,
    guess: ApparentPoints | None = None,
    last: bool = False,
) -> ApparentPoints:
    """Where points appear along one light path.

    Parameters
    ----------
    glass
        In whose frame everything is given, metres.
    path
        A `LightPath` or its events.
    eye : (3,) or ParallelView
    points : (N, 3)
    tolerance : float
        Angle at the eye in radians by which `direction` may be off.
    guess : ApparentPoints, optional
        An earlier result for the same N points. It changes the time, never the answer.

    last : bool
        Leave out all stretches but the last, where a glass's interfaces have names.

    Returns
    -------
    ApparentPoints

    Raises
    ------
    ValueError
        For points that are not (N, 3), an eye that is not (3,), a tolerance that is not positive,
        letters other than T and R, or a guess for another N. Never for a point without an image.
    """
    path, eye = as_path(path), as_eye(eye)
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must be (N, 3), not {points.shape}")
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be positive, not {tolerance!r}")
    if guess is not None and guess.valid.shape[-1] != len(points):
        raise ValueError(f"guess must be for {len(points)} points, not {guess.valid.shape[-1]}")
    largest = _largest(points)
    finite = None if largest <= FARTHEST else (np.abs(points) <= FARTHEST).all(axis=-1)
    some = points if finite is None else points[finite]
    if finite is not None:
        largest = _largest(some)
    if isinstance(glass, AxialGlass):
        slots, iterations = axial_slots(
            glass, path, eye, some, tolerance, len(path) if last else None
        )
    else:
        slots, iterations = _slots(glass, path, eye, some, tolerance, guess, finite, largest)
    if finite is None:
        finite = np.ones(len(points), dtype=bool)
    slots = sorted((slot for slot in slots if slot.valid.any()), key=lambda slot: slot.sheet)
    return _gather(slots, finite, eye, len(path), iterations)


def _slots(glass, path, eye, some, tolerance, guess, finite, largest) -> tuple[list[Slot], int]:
    """The slots of finite points in all passages of a path, and the most steps."""
    slots, iterations = [], 0
    if isinstance(eye, ParallelView):
        medium, viewpoint = 0, eye
        if isinstance(glass, FlatGlass) and eye.direction[2] > 0.0:
            medium = len(glass.media) - 1
    else:
        medium, viewpoint = int(glass.medium_at(eye)), tuple(eye.tolist())
    places = glass.places(some)
    for branch in _branches(glass, medium, path):
        for stretch in range(1, len(branch.stretches)):
            inside = glass.holds(branch.stretches[stretch].medium, places)
            if not inside.any():
                continue
            passage = _passage(glass, viewpoint, branch, stretch)
            if passage.empty():
                continue
            slots_here = Slots(passage, some, inside, tolerance, largest)
            first = _guessed(guess, passage, finite) if passage.direct else None
            iterations = max(iterations, _find(slots_here, first))
            slots += slots_here.by_key.values()
    return slots, iterations


def _largest(vectors) -> float:
    """The greatest absolute component; NaN if there is one."""
    return max(-vectors.min(initial=0.0), vectors.max(initial=0.0))


@lru_cache(maxsize=256)
def _branches(glass: Glass, medium: int, path: LightPath) -> tuple[Branch, ...]:
    if isinstance(glass, FlatGlass):
        return tuple(branches(glass, medium, path))
    return tuple(branch for branch, _ in taken_branches(glass, medium, path.events))


@lru_cache(maxsize=256)
def _passage(glass: Glass, eye: tuple | ParallelView, branch: Branch, stretch: int):
    """The equations of a stretch: many calls ask for the same ones."""
    family = FlatPassage if isinstance(glass, FlatGlass) else CoaxialPassage
    return family(glass, eye if isinstance(eye, ParallelView) else np.array(eye), branch, stretch)


def _gather(slots, finite, eye, last, iterations):
    """One record of all slots; at least one slot, so that row 0 always exists."""
    if not slots:
        slots = [Slot.blank((last, (), *MAIN), int(finite.sum()), eye)]
    sheets = tuple(slot.sheet for slot in slots)
    if finite.all() and len(slots) == 1:
        columns = [column[None] for column in slots[0].columns()]
    else:
        columns = _stacked(slots, finite, eye)
    stretch = np.array([sheet[0] for sheet in sheets], dtype=np.intp)
    return ApparentPoints(*columns, stretch, iterations, sheets)


def _stacked(slots, finite, eye) -> tuple:
    """All slots, emptied one by one, with blank places for points that are not finite."""
    numbers = np.empty((len(slots), 8, len(finite)))
    valid = np.zeros((len(slots), len(finite)), dtype=bool)
    vectors = numbers[:, :3].transpose(0, 2, 1), numbers[:, 3:6].transpose(0, 2, 1)
    columns = vectors[0], numbers[:, 6], vectors[1], valid, numbers[:, 7]
    whole, blank = finite.all(), Slot.blank((), 1, eye)
    for row in range(len(slots)):
        slot, slots[row] = slots[row], None
        for column, part, nothing in zip(columns, slot.columns(), blank.columns(), strict=True):
            if whole:
                column[row] = part
            else:
                column[row] = nothing
                column[row, finite] = part
    return columns


MAIN = (1, 0, 0, 0)
"""The sheet that no caustic has turned over and no winding has shifted."""

ROUGH = 6
"""Most steps in float32."""

CELLS = 12
"""Cells along a curve that may meet caustics."""

MISS = 1e-10
"""Residual in parts of the distance beyond which a ray does not count as passing a point."""


class Slots:
    """The images of points in one passage, a slot a sheet."""

    def __init__(self, passage, points, inside, tolerance: float, largest: float) -> None:
        self.passage, self.points, self.inside = passage, points, inside
        self.tolerance, self.largest = tolerance, largest
        self.by_key: dict[tuple, Slot] = {}

    def slot(self, key: tuple) -> Slot:
        """The slot of a sheet, begun where it is new."""
        if key not in self.by_key:
            name = (self.passage.number, self.passage.branch.interfaces, *key)
            slot = self.by_key[key] = Slot.empty(name, len(self.points))
            main = self.by_key.get(MAIN)
            if key != MAIN and main is not None:
                # Points that were settled at once have no image here: they stay where they are.
                for mine, other in zip(slot.columns(), main.columns(), strict=True):
                    mine[...] = other
                slot.valid[:] = False
        return self.by_key[key]

    def put(self, key, where, unknowns, targets, found) -> NDArray[np.bool_]:
        """Write images of the points `where` (slice or indices); returns which rays pass them."""
        slot = self.slot(key)
        miss = self.tolerance if self.tolerance > 1e-8 else MISS
        passes, valid = self.passage.image(
            unknowns, targets, self.points[where], miss, slot.part(where)
        )
        slot.valid[where] = valid & found & self.inside[where]
        return passes


def _find(slots: Slots, guess) -> int:
    """Fill the slots of one passage; returns the most steps that a point took."""
    left, steps = np.arange(len(slots.points)), 0
    if slots.passage.direct:
        left, steps = _directly(slots, guess)
    if len(left):
        _by_curves(slots, left)
    return steps


def _directly(slots: Slots, guess) -> tuple[NDArray[np.intp], int]:
    """The one image of each point, by Newton's steps from the straight ray or a guess.

    Returns the points that this did not settle, and the most steps of the others.
    """
    passage, tolerance = slots.passage, slots.tolerance
    slots.slot(MAIN)
    # Newton squares the error: the step that follows one this small is below the tolerance. Near
    # the edge of a domain the square is multiplied by 10⁵ and more: where only few digits are asked
    # for, what `put` finds wrong takes further steps, down to `least`.
    coarse = tolerance > 1e-7 and passage.smooth and slots.largest < passage.widest
    narrow = coarse and tolerance > COARSE
    small = 1e-9 if tolerance <= 1e-8 else (0.5 if narrow else 0.3) * tolerance**0.5
    least = max(0.1 * tolerance, 1e-9)
    left, most, retry = [], [], []

    def refine(unknowns, solved, small):
        unknowns = [part.astype(np.float64, copy=False) for part in unknowns]
        return newton(passage, unknowns, solved, small=small, most=passage.most)

    def work(block: slice) -> None:
        points = slots.points[block]
        targets = passage.targets(points, np.float32) if narrow else passage.targets(points)
        solved = targets[: passage.solved]
        if guess is not None:
            unknowns = passage.from_directions(guess[block], *solved)
        else:
            unknowns = passage.start(*solved)
        steps = 0
        if coarse:
            # Early steps need few digits: half the width, half the memory.
            unknowns, steps = newton(
                passage,
                [part.astype(np.float32, copy=False) for part in unknowns],
                [part.astype(np.float32, copy=False) for part in solved],
                small=small if narrow else 3e-3,
                most=ROUGH,
            )
            rested = steps <= ROUGH
        if not narrow:
            # Who does not come to rest, mostly for want of an image, is left to the search.
            some = np.flatnonzero(rested) if coarse else slice(None)
            if coarse and len(some) < len(steps):
                fine, more = refine([u[some] for u in unknowns], [t[some] for t in solved], small)
                unknowns = [part.astype(np.float64) for part in unknowns]
                for unknown, part in zip(unknowns, fine, strict=True):
                    unknown[some] = part
                steps[some] += more
            else:
                unknowns, more = refine(unknowns, solved, small)
                steps = steps + more
        settled = slots.put(MAIN, block, unknowns, targets, True)
        if narrow and not settled.all():
            # A step was not enough near the edge of the domain: most of these need one more.
            some = np.flatnonzero(~settled & rested)
            nearer, more = newton(
                passage, [u[some] for u in unknowns], [t[some] for t in solved], small=least, most=2
            )
            for unknown, part in zip(unknowns, nearer, strict=True):
                unknown[some] = part
            steps[some] += more
            part = [target[some] for target in targets]
            settled[some] = slots.put(MAIN, block.start + some, nearer, part, True)
        if not settled.all():
            lost = ~settled
            if coarse:
                again = np.flatnonzero(lost & rested)
                retry.append((block.start + again, *(u[again] for u in unknowns), steps[again]))
                lost[again] = False
            left.append(block.start + np.flatnonzero(lost))
        most.append(int((steps * settled).max(initial=0)))

    in_blocks(work, len(slots.points), 2 * BLOCK if narrow else BLOCK)
    if retry:
        # Where that was not enough, on from where it led.
        index, *unknowns, steps = (np.concatenate(part) for part in zip(*retry, strict=True))

        def again(block: slice) -> None:
            targets = passage.targets(slots.points[index[block]])
            fine, more = refine([u[block] for u in unknowns], targets[: passage.solved], least)
            settled = slots.put(MAIN, index[block], fine, targets, True)
            left.append(index[block][~settled])
            most.append(int(((steps[block] + more) * settled).max(initial=0)))

        in_blocks(again, len(index))
    left = np.sort(np.concatenate(left)) if left else np.zeros(0, dtype=np.intp)
    return left, max(most, default=0)


def _guessed(guess, passage, finite) -> NDArray | None:
    """Directions of an earlier result on the sheet of a direct passage, if they are of use."""
    name = (passage.number, passage.branch.interfaces, *MAIN)
    if guess is None or not passage.guessable or name not in guess.sheet:
        return None
    directions = np.asarray(guess.direction[guess.sheet.index(name)], dtype=float)
    if finite is not None:
        directions = directions[finite]
    return directions if _largest(directions) < 1.0 + 1e-6 else None


def _by_curves(slots: Slots, left) -> None:
    """All images of the points `left`, sheet by sheet, by bracketing on their curves."""
    passage = slots.passage
    cells = 1 if passage.direct or passage.single else CELLS
    found: list[tuple] = []

    def search(block: slice) -> None:
        index = left[block]
        targets = passage.targets(slots.points[index])
        legs = [Leg(Curves(passage, side, *targets[:3]), cells) for side in passage.sides]
        sheets = _images(passage, legs, targets)
        found.append((index, targets, sheets, [Placing(leg) for leg in legs]))

    in_blocks(search, len(left), BLOCK // cells)
    keys = sorted({key for _, _, sheets, _ in found for key in sheets} | set(slots.by_key))

    def write(number: slice) -> None:
        index, targets, sheets, placings = found[number.start]
        for key in keys:
            ell, zeta, side, has = _sheet(key, sheets, placings, len(index))
            slots.put(key, index, (ell, zeta, side), targets, has)

    for key in keys:
        slots.slot(key)
    in_blocks(write, len(found), 1)


def _images(passage, legs, targets) -> dict[tuple, tuple]:
    """Images on the curves of a block, by sheet: indices, ℓ, ζ and leg."""
    parts = []
    for leg in legs:
        roots, side = leg.roots(), leg.curves.side
        ell, zeta = leg.curves.take(roots.index).invariants(roots.tau, roots.tangent, roots.mirror)
        upright = roots.rising == (passage.orientation(side) > 0)
        ranks = rank_of(roots.piece, roots.mirror)
        parts.append((upright, ranks, roots.winding, roots.index, ell, zeta, side))
    for leg, (*_, index, ell, zeta, side) in zip(legs, list(parts), strict=True):
        index, ell, zeta, upright = strays(leg.curves, targets, (index, ell, zeta))
        parts.append((upright, 0, 0, index, ell, zeta, side))
    upright, rank, winding, index, ell, zeta, side = (
        np.concatenate([np.broadcast_to(part[field], part[3].shape) for part in parts])
        for field in range(7)
    )
    # Two legs, or a stray, may hold images of one sheet: the second gets a slot of its own. What
    # both legs find where they meet is one image.
    order = np.lexsort((index, winding, rank, upright))
    names = np.stack([upright, rank, winding, index]).astype(int)[:, order]
    again = np.append(False, (names[:, 1:] == names[:, :-1]).all(axis=0))[: len(order)]
    copy = np.arange(len(order)) - np.maximum.accumulate(np.where(again, 0, np.arange(len(order))))
    ell, zeta, side = ell[order], zeta[order], side[order]
    near = np.abs(np.diff(ell, prepend=np.inf)) + np.abs(np.diff(zeta, prepend=np.inf)) < 1e-9
    keep = ~(again & near)
    keys = np.concatenate([names[:3], copy[None]])[:, keep]
    index, ell, zeta, side = names[3][keep], ell[keep], zeta[keep], side[keep]
    # All sheets in one number each: sorting numbers is fast, sorting columns is not.
    low = keys.min(axis=1, initial=0)
    sizes = keys.max(axis=1, initial=0) - low + 1
    code = np.ravel_multi_index(tuple(keys - low[:, None]), tuple(sizes))
    sheets = {}
    for number in np.unique(code):
        some = np.flatnonzero(code == number)
        name = tuple(int(part) for part in keys[:, some[0]])
        sheets[name] = index[some], ell[some], zeta[some], side[some]
    return sheets


def _sheet(key, sheets, placings, count):
    """ℓ, ζ, leg of one sheet for all points of a block, and which of them have the image.

    Points without the image lie at the sheet's nearest edge; in front of a cusp, where the sheets
    round it are one, they go on along the first.
    """
    ell, zeta, side = np.zeros(count), np.zeros(count), np.ones(count)
    upright, rank, winding, _ = key
    has = _copy(sheets.get(key), (ell, zeta, side), np.ones(count, dtype=bool))
    lost = np.flatnonzero(~has)
    best = np.full(len(lost), np.inf)
    for placing in placings if len(lost) else ():
        at_ell, at_zeta, gap = placing.nearest(bool(upright), rank, winding, lost)
        closer = gap < best
        index = lost[closer]
        ell[index], zeta[index] = at_ell[closer], at_zeta[closer]
        side[index] = placing.curves.side
        best = np.where(closer, gap, best)
    if rank:
        open_to = np.zeros(count, dtype=bool)
        open_to[lost[best >= NO_PIECE]] = True
        _copy(sheets.get((upright, 0, winding, 0)), (ell, zeta, side), open_to)
    return ell, zeta, side, has


def _copy(sheet, unknowns, open_to) -> NDArray[np.bool_]:
    """Copy a sheet's images to the points that are open to them; returns which got one."""
    got = np.zeros(len(open_to), dtype=bool)
    if sheet is not None:
        index, *values = sheet
        some = open_to[index]
        for unknown, value in zip(unknowns, values, strict=True):
            unknown[index[some]] = value[some]
        got[index[some]] = True
    return got
