"""Where points appear along a light path: all images of all points, sheet by sheet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .coaxial import Passage, frame_of
from .flat import FlatPassage
from .glasses import FlatGlass, Glass
from .images import ApparentPoints
from .paths import LightPath, ParallelView, as_eye, as_path, branches
from .solver import in_blocks, newton
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
    if isinstance(glass, FlatGlass):
        solve = _flat_slots
    else:
        solve = _coaxial_slots
    for branch in branches(glass, medium, path):
        for stretch in range(1, len(branch.stretches)):
            found, steps = solve(glass, eye, branch, stretch, some, tolerance, guess)
            slots += found
            iterations = max(iterations, steps)
    slots.sort(key=lambda slot: slot[0])
    return _gather(slots, finite, eye, len(path), iterations)


def _blank(count, eye):
    direction = np.zeros((count, 3))
    direction[:] = eye.direction if isinstance(eye, ParallelView) else (0.0, 0.0, -1.0)
    position = np.zeros((count, 3)) if isinstance(eye, ParallelView) else np.tile(eye, (count, 1))
    return direction, np.zeros(count), position, np.zeros(count, dtype=bool), np.zeros(count)


def _gather(slots, finite, eye, stretches, iterations):
    shown = [slot for slot in slots if slot[4].any()] or [(stretches, *_blank(finite.sum(), eye))]
    columns = []
    for field, blank in enumerate(_blank(len(finite), eye)):
        column = np.repeat(blank[None], len(shown), axis=0)
        for row, slot in enumerate(shown):
            column[row, finite] = slot[field + 1]
        columns.append(column)
    return ApparentPoints(
        *columns, np.array([slot[0] for slot in shown], dtype=np.intp), iterations
    )


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
        (stretch, image.direction, image.distance, image.position, valid, image.residual)
    ], int(steps.max(initial=0))


def _coaxial_slots(glass, eye, branch, stretch, points, tolerance, guess):
    passage = Passage(glass, frame_of(glass, eye), branch, stretch)
    candidates = passage.candidates(points)
    if not candidates.any() or passage.domain.zeta_max <= 0.0:
        return [], 0
    x, y, z = passage.targets(points)
    unknowns = passage.start(x, y, z)
    (ell, zeta), steps = newton(passage, unknowns, [x, y, z], small=1e-7, most=12)
    image, along = passage.image(ell, zeta, x, y, z, points, 0)
    valid = candidates & (steps <= 12) & (image.residual <= 1e-8 * image.distance)
    return [
        (stretch, image.direction, image.distance, image.position, valid, image.residual)
    ], int(steps.max(initial=0))
