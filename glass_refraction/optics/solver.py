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
"""Points a block: its arrays stay in a core's cache."""

_workers = ThreadPoolExecutor(
    max_workers=max(1, min(2, os.cpu_count() or 1)), thread_name_prefix="optics"
)


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
) -> tuple[list[NDArray], NDArray[np.intp]]:
    """Newton's steps until the change in angle is below `small`, at most `most` of them.

    Every point stops by itself: its result does not depend on its neighbours. Unknowns are
    changed in place. Returns them and the number of steps each point took (`most` + 1 where it
    did not come to rest).
    """
    unknowns = list(unknowns)
    steps = np.full(len(unknowns[0]), most + 1, dtype=np.intp)
    index = np.arange(len(steps))
    values, here = list(unknowns), list(targets)
    for number in range(1, most + 1):
        if not len(index):
            break
        *values, change = equations.step(*values, *here)
        moving = ~(change < small)
        for unknown, value in zip(unknowns, values, strict=True):
            unknown[index] = value
        steps[index[~moving]] = number
        if not moving.all():
            index = index[moving]
            values = [value[moving] for value in values]
            here = [target[moving] for target in here]
    return unknowns, steps


def in_blocks(work: Callable[[slice], None], total: int, size: int = BLOCK) -> None:
    """Call `work` for slices that cover range(total), on two threads where there is enough."""
    blocks = [slice(first, min(first + size, total)) for first in range(0, total, size)]
    if len(blocks) < 2:
        for block in blocks:
            work(block)
        return
    for done in _workers.map(work, blocks):
        assert done is None
