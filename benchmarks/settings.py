# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run of the benchmark is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

Value = TypeVar("Value")
SIZES = ("tiny", "quick", "full")


@dataclass(frozen=True)
class Settings:
    """How much is measured, and with which random numbers.

    Attributes
    ----------
    size : ``full`` for figures to be quoted, ``quick`` for a look, ``tiny`` for tests.
    seed : of every random choice.
    scenes : .blend files for the parts that render.
    folder : where parts put pictures that are no charts; None: nowhere.
    """

    size: str = "full"
    seed: int = 0
    scenes: tuple[Path, ...] = ()
    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.size not in SIZES:
            raise ValueError(f"size must be one of {', '.join(SIZES)}, not {self.size!r}")

    def pick(self, tiny: Value, quick: Value, full: Value) -> Value:
        """The value for this size."""
        return (tiny, quick, full)[SIZES.index(self.size)]

    @property
    def repeats(self) -> int:
        """How often each time is taken."""
        return self.pick(1, 3, 7)

    def random(self, *place: int) -> np.random.Generator:
        """Random numbers of one place in the benchmark, the same whatever else is run."""
        return np.random.default_rng([self.seed, *place])
