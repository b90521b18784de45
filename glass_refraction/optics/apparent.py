"""Where points appear along a light path: all images of all points, sheet by sheet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coaxial import Passage, frame_of
from .flat import FlatPassage
from .glasses import FlatGlass, Glass
from .images import ApparentPoints
from .paths import LightPath, ParallelView, as_eye, as_path, branches
from .sheets import Curves, Leg, Placing, rank_of
from .solver import BLOCK, in_blocks, newton
from .tracing import inside_outline


def apparent_points(
    glass: Glass,
    path: LightPath | str,
    eye: ArrayLike | ParallelView,
    points: ArrayLike,
    *,
    tolerance: float = 1e-9,
    guess: ApparentPoints | None = None,
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
    finite = np.isfinite(points).all(axis=-1)
    some = points if finite.all() else points[finite]
    slots, iterations = [], 0
    if isinstance(eye, ParallelView):
        medium = 0
        if isinstance(glass, FlatGlass) and eye.direction[2] > 0.0:
            medium = len(glass.media) - 1
    else:
        medium = int(glass.medium_at(eye))
    solve = _flat_slots if isinstance(glass, FlatGlass) else _coaxial_slots
    for branch in branches(glass, medium, path):
        for stretch in range(1, len(branch.stretches)):
            found, steps = solve(glass, eye, branch, stretch, some, tolerance, guess)
            slots += found
            iterations = max(iterations, steps)
    slots = sorted((slot for slot in slots if slot[4].any()), key=lambda slot: slot[0])
    return _gather(slots, finite, eye, len(path), iterations)


def _blank(count, eye):
    """A slot's image where there is none: direction, distance, position, valid, residual."""
    parallel = isinstance(eye, ParallelView)
    direction = np.zeros((count, 3))
    direction[:] = eye.direction if parallel else (0.0, 0.0, -1.0)
    position = np.zeros((count, 3))
    position[:] = 0.0 if parallel else eye
    return direction, np.zeros(count), position, np.zeros(count, dtype=bool), np.zeros(count)


def _gather(slots, finite, eye, last, iterations):
    """One record of all slots; at least one slot, so that row 0 always exists."""
    slots = slots or [((last, (), 1, 0, 0, 0), *_blank(int(finite.sum()), eye))]
    if len(slots) == 1 and finite.all():
        columns = [column[None] for column in slots[0][1:]]
    else:
        columns = []
        for number, blank in enumerate(_blank(len(finite), eye)):
            column = np.repeat(blank[None], len(slots), axis=0)
            for row, slot in enumerate(slots):
                column[row, finite] = slot[number + 1]
            columns.append(column)
    sheets = tuple(slot[0] for slot in slots)
    stretch = np.array([sheet[0] for sheet in sheets], dtype=np.intp)
    return ApparentPoints(*columns, stretch, iterations, sheets)


def _flat_slots(glass, eye, branch, stretch, points, tolerance, guess):
    passage = FlatPassage(glass, eye, branch, stretch)
    candidates = passage.candidates(points)
    if not candidates.any():
        return [], 0
    lateral, way, unit_x, unit_y = passage.targets(points)
    valid = candidates
    if passage.parallel:
        along = passage.seen_along()
        if along is None:
            return [], 0
        x = np.full(len(points), along)
        steps = np.zeros(1, dtype=int)
    else:
        floor = passage.start(lateral, way)
        x = floor.copy()
        (x,), steps = newton(passage, [x], [lateral, way, floor], small=1e-7, most=40)
        steepest = passage.steepest()
        valid = valid & (x < steepest)
        x = np.minimum(x, steepest)
    image = passage.image(x, lateral, way, unit_x, unit_y, points)
    if glass.outline is not None:
        for at_x, at_y in passage.crossings(x, lateral, way, unit_x, unit_y, points):
            valid = valid & inside_outline(glass.outline, np.stack([at_x, at_y], axis=-1))
    return [
        (
            (stretch, branch.interfaces, 1, 0, 0, 0),
            image.direction,
            image.distance,
            image.position,
            valid,
            image.residual,
        )
    ], int(steps.max(initial=0))


def _coaxial_slots(glass, eye, branch, stretch, points, tolerance, guess):
    passage = Passage(glass, frame_of(glass, eye), branch, stretch)
    candidates = passage.candidates(points)
    if not candidates.any() or passage.domain.zeta_max <= 0.0:
        return [], 0
    zeta = passage.frame.zeta
    if zeta is not None and abs(zeta) >= passage.domain.zeta_max:  # a parallel view
        return [], 0
    single = passage.single()
    targets = passage.targets(points)
    sheets: dict[tuple, list[NDArray]] = {}
    blocks: list[tuple[NDArray, list[Placing]]] = []
    found: list[tuple[NDArray, list]] = []
    total = len(points)
    steps = 0
    left = np.arange(total)
    if single and "R" not in branch.events[:stretch]:
        sheet, steps, done = _straight_newton(passage, targets, tolerance)
        sheets[(1, 0, 0, 0)] = sheet
        left = np.flatnonzero(~done)

    def search(block: slice) -> None:
        index = left[block]
        part = [target[index] for target in targets]
        legs = [Leg(Curves(passage, side, *part), 1 if single else CELLS) for side in passage.sides]
        found.append((index, _sorted_roots(passage, legs)))
        blocks.append((index, [Placing(leg) for leg in legs]))

    in_blocks(search, len(left), BLOCK if single else BLOCK // CELLS)
    for block, roots in found:
        for key, index, ell, zeta, side in roots:
            if key not in sheets:
                sheets[key] = [np.zeros(total), np.zeros(total), np.ones(total), np.zeros(total)]
            sheet = sheets[key]
            index = block[index]
            sheet[0][index], sheet[1][index], sheet[2][index] = ell, zeta, side
            sheet[3][index] = 1.0
    keys = sorted(key for key, sheet in sheets.items() if (sheet[3] * candidates).any())
    slots = []
    for key in keys:
        ell, zeta, side, has = sheets[key]
        has = has > 0.0
        first = sheets.get((key[0], 0, *key[2:]))
        if key[1] and first is not None:
            # In front of a cusp the sheets round it are one: continue on the first.
            missing = ~has & (first[3] > 0.0)
        else:
            missing = np.zeros(total, dtype=bool)
        for block, placings in blocks:
            lost = np.flatnonzero(~has[block])
            if len(lost):
                _place(key, block, placings, lost, ell, zeta, side)
        if missing.any():
            for mine, other in zip((ell, zeta, side), first, strict=False):
                mine[missing] = other[missing]
        image, _ = passage.image(ell, zeta, *targets, points, side)
        # No ray is tilted enough for targets too high; they were left at the edge of the domain.
        valid = has & candidates & passage.taken(ell, zeta)
        valid &= image.residual <= max(MISS, tolerance) * (image.distance + passage.frame.scale)
        extent = getattr(glass, "extent", None)
        if extent is not None:
            low = 0.0 if passage.frame.eye is None else passage.frame.eye[2]
            low, high = (end / passage.frame.scale - low for end in extent)
            for level in passage.crossings(ell, zeta, *targets):
                valid &= (level >= low) & (level <= high)
        slots.append(
            (
                (stretch, branch.interfaces, *key),
                image.direction,
                image.distance,
                image.position,
                valid,
                image.residual,
            )
        )
    return slots, steps


SMALL = 0.003
"""A last step of SMALL · √tolerance leaves an error well below the tolerance (Newton squares it)."""

MISS = 1e-9
"""Residual in parts of the distance beyond which a ray does not count as passing a point."""

CELLS = 12
"""Cells along a curve that may meet caustics."""


def _straight_newton(passage, targets, tolerance):
    """The one image of each point, by Newton's steps from the straight ray; and which found it."""
    total = len(targets[0])
    ell, zeta, side = (np.empty(total) for _ in range(3))
    done = np.empty(total, dtype=bool)
    most = []

    def work(block: slice) -> None:
        x, y, z = (target[block] for target in targets)
        (here_ell, here_zeta), steps = newton(
            passage,
            passage.start(x, y, z),
            (x, y, z),
            small=SMALL * tolerance**0.5,
            most=12,
        )
        line = passage.follow(here_ell, here_zeta, slopes=False)
        along, across, rise, _ = line.misses(x, y, z)
        if passage.frame.zeta is not None:
            rise = 0.0
        near = np.abs(across) + np.abs(rise) <= max(MISS, tolerance) * (1.0 + line.length)
        here_side = np.where(along < 0.0, -1.0, 1.0)
        near &= np.isin(here_side, passage.sides) & (steps <= 12)
        ell[block], zeta[block], side[block], done[block] = here_ell, here_zeta, here_side, near
        most.append(int(steps[near].max(initial=0)))

    in_blocks(work, total)
    return [ell, zeta, side, done.astype(float)], max(most, default=0), done


def _sorted_roots(passage, legs):
    """Images of a block, by sheet: (key, indices, ℓ, ζ, side)."""
    found = []
    taken: dict[tuple, NDArray] = {}
    for leg in legs:
        roots = leg.roots()
        side = leg.curves.side
        ell, zeta = leg.curves.take(roots.index).invariants(roots.tau, roots.tangent, roots.mirror)
        upright = roots.rising == (passage.orientation(side) > 0)
        ranks = rank_of(roots.piece, roots.mirror)
        keys = np.stack([upright, ranks, roots.winding], axis=-1).astype(int)
        for key in np.unique(keys, axis=0):
            which = np.flatnonzero((keys == key).all(axis=-1))
            index = roots.index[which]
            key = tuple(int(part) for part in key)
            used = taken.setdefault(key, np.zeros(len(leg.curves.radius), dtype=bool))
            # Both legs may hold an image of one sheet: the second gets a slot of its own.
            again = used[index]
            used[index] = True
            for mask, copy in ((~again, 0), (again, 1)):
                if mask.any():
                    part = which[mask]
                    found.append(
                        (
                            (*key, copy),
                            roots.index[part],
                            ell[part],
                            zeta[part],
                            np.full(len(part), float(side)),
                        )
                    )
    return found


def _place(key, block, placings, lost, ell, zeta, side):
    """Put targets without an image at the nearest edge of the sheet."""
    upright, rank, winding, _ = key
    best = np.full(len(lost), np.inf)
    for placing in placings:
        at_ell, at_zeta, gap = placing.nearest(bool(upright), rank, winding, lost)
        closer = gap < best
        index = block[lost[closer]]
        ell[index], zeta[index], side[index] = (
            at_ell[closer],
            at_zeta[closer],
            placing.curves.side,
        )
        best = np.where(closer, gap, best)
