# SPDX-License-Identifier: GPL-3.0-or-later
"""How far light runs in each medium along a path: what absorption needs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import AxialGlass, lengths_axial
from .glasses import Glass
from .paths import LightPath, as_path
from .solver import in_blocks
from .tracing import along, meet, start
from .weights import radial_weights


def path_lengths(
    glass: Glass, eye: ArrayLike, directions: ArrayLike, path: LightPath | str
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """How far rays run between the interfaces that a path meets, and in which media.

    By Beer and Lambert, a medium of absorption coefficient a (per metre) lets exp(-a·length)
    through: ``np.exp(-(coefficients[media] * lengths).sum(axis=0))`` with one coefficient for each
    of ``glass.media`` is the part of the light that all stretches together let through.

    Parameters
    ----------
    glass
        In whose frame everything is given, metres.
    eye : (3,), or (M, 3) for rays that start apart (an orthographic camera)
    directions : (M, 3)
        Need not be unit.
    path
        A `LightPath` or its events.

    Returns
    -------
    lengths : (S, M)
        Geometric length in metres of stretch 1 to S of the path, those between its first and its
        last event: S = len(path) − 1, and 0 for the path "". 0 where the ray does not take the
        path. What lies in front of the first event and behind the last is not the path's to tell.
    media : (S, M) of int
        Index into ``glass.media`` of the medium each stretch runs in; 0 where the ray does not
        take the path. Rays of one path may differ here, if the glass has three interfaces or more.
    """
    path = as_path(path)
    events = path.events
    directions = np.atleast_2d(np.asarray(directions, dtype=float))
    eye = np.asarray(eye, dtype=float)
    total, rows = len(directions), max(len(events) - 1, 0)
    origins = np.broadcast_to(eye, (total, 3))
    lengths, media = np.zeros((rows, total)), np.zeros((rows, total), dtype=np.intp)
    if not rows:
        return lengths, media
    axial = isinstance(glass, AxialGlass)
    radial = None if axial else radial_weights(glass, eye, (events,))

    def work(block: slice) -> None:
        parts = lengths_axial(glass, origins[block], directions[block], path) if axial else None
        if radial is not None:
            here = eye if eye.ndim == 1 else origins[block]
            parts = radial.lengths(here, directions[block])
        if parts is None:
            parts = _followed(glass, origins[block], directions[block], events)
        for which, ways, through in parts:
            lengths[:, block.start + which] = ways
            media[:, block.start + which] = through

    in_blocks(work, total)
    return lengths, media


def _followed(glass, origins, directions, events):
    """Indices of rays that take the path, their lengths and media, by following every ray."""
    rays, proper = start(glass, origins, directions)
    _, *steps = along(glass, rays.take(proper), events)
    index, last = steps[-1]
    index = index[~meet(glass, last).met]
    # What each stretch adds, and its medium, of those that came to the end.
    steps = [rays.take(np.searchsorted(which, index)) for which, rays in steps]
    ways = np.stack([after.length - before.length for before, after in pairwise(steps)])
    through = np.stack([rays.medium for rays in steps[:-1]])
    return [(np.flatnonzero(proper)[index], ways, through)]
