# SPDX-License-Identifier: GPL-3.0-or-later
"""Many of a kind as columns: dataclasses of arrays whose first axis counts them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self, TypeVar

import numpy as np

Kind = TypeVar("Kind")


class Columns:
    """What such dataclasses share."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def take(self, which: np.ndarray) -> Self:
        """Some of them, by their numbers."""
        return type(self)(*(part.take(which, axis=0) for part in vars(self).values()))


def joined(kind: type[Kind], parts: Iterable[Kind]) -> Kind:
    """All of several parts of a kind, at least one, one after another.

    The columns grow by each part that comes: if nobody holds it, it is not held twice. Parts of a
    list are held anyway.
    """
    if isinstance(parts, list):
        rows = zip(*(vars(part).values() for part in parts), strict=True)
        return kind(*(np.concatenate(same) for same in rows))
    columns: list[np.ndarray] = []
    for part in parts:
        rows = vars(part).values()
        columns = columns or [np.empty((0, *row.shape[1:]), row.dtype) for row in rows]
        for column, row in zip(columns, rows, strict=True):
            count = len(column)
            # Nobody else refers to its memory.
            column.resize((count + len(row), *row.shape[1:]), refcheck=False)
            column[count:] = row
    return kind(*columns)
