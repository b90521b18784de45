# SPDX-License-Identifier: GPL-3.0-or-later
"""Many of a kind as columns: dataclasses of arrays whose first axis counts them."""

from __future__ import annotations

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


def joined(kind: type[Kind], parts: list[Kind]) -> Kind:
    """All of several parts of a kind, one after another; the list is empty then.

    Columns are joined one by one and their parts forgotten: not all are held twice.
    """
    if len(parts) == 1:
        return parts.pop()
    rows = [list(vars(part).values()) for part in parts]
    parts.clear()
    return kind(*(np.concatenate([row.pop(0) for row in rows]) for _ in range(len(rows[0]))))
