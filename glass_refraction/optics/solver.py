# SPDX-License-Identifier: GPL-3.0-or-later
"""The safeguarded Newton solver that flat and coaxial equations share, and its blocks."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

BLOCK = 16384
"""Points a block, in float64: its arrays stay in a core's cache. Float32 takes twice as many."""

# Logical processors mostly come in pairs on one core, and two threads on one core, which share its
# cache and Python's lock, were slower here than one.
THREADS = max(1, min(2, (os.cpu_count() or 1) // 2))

_workers = ThreadPoolExecutor(max_workers=THREADS, thread_name_prefix="optics")


class Equations(Protocol):
    """What `newton` needs of a family of equations."""

    def step(self, *arrays: NDArray) -> tuple[NDArray, ...]:
        """From unknowns and targets to new unknowns and, last, the change in angle (radians)."""


def newton(
    equations: Equations,
    unknowns: Sequence[NDArray],
    targets: Sequence[NDArray],
    *,
    small: float,
    most: int,
) -> tuple[list[NDArray], NDArray[np.int8]]:
    """Newton's steps until the change in angle is below `small`, at most `most` of them.

    Every point stops by itself: its result does not depend on its neighbours. A point whose steps
    leave the domain again and again (change inf) is given up after `PATIENCE` steps.
    Returns unknowns and the number of steps each point took (`most` + 1 where it did not come to
    rest).
    """
    values, here, index = list(unknowns), list(targets), None
    steps = np.full(len(values[0]), most + 1, dtype=np.int8)
    for number in range(1, most + 1):
        *values, change = equations.step(*values, *here)
        going = ~(change < small)
        moving = np.flatnonzero(going & (change < np.inf) if number >= PATIENCE else going)
        if index is None:
            unknowns = list(values)
            if len(moving) == len(steps):
                continue
            np.putmask(steps, ~going, number)
            index = moving
        else:
            for unknown, value in zip(unknowns, values, strict=True):
                unknown[index] = value
            steps[index[~going]] = number
            index = index[moving]
        if not len(index):
            break
        values = [value[moving] for value in values]
        here = [target[moving] for target in here]
    return unknowns, steps


PATIENCE = 4
"""Steps after which a point must have come into the domain."""


def in_blocks(work: Callable[[slice], None], total: int, size: int = BLOCK) -> None:
    """Call `work` for slices that cover range(total), on two threads where there are the cores."""
    if total > size:
        # As many blocks for one thread as for the other, all alike.
        rounds = -(-total // (THREADS * size))
        size = -(-total // (THREADS * rounds))
    blocks = [slice(first, min(first + size, total)) for first in range(0, total, size)]
    if len(blocks) < 2 or THREADS < 2:
        for block in blocks:
            work(block)
        return
    for done in _workers.map(work, blocks):
        assert done is None
