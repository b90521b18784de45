# SPDX-License-Identifier: GPL-3.0-or-later
"""Columns that grow part by part: the same as all at once, and less memory."""

import tracemalloc
from dataclasses import dataclass

import numpy as np

from glass_refraction.scene.rays.columns import Columns, joined

PART = 100_000


@dataclass(frozen=True, eq=False)
class Rows(Columns):
    number: np.ndarray
    place: np.ndarray


def _parts(count):
    for k in range(count):
        number = np.arange(k * PART, (k + 1) * PART, dtype=np.int32)
        yield Rows(number, np.stack((number, -number), axis=1).astype(float))


def test_parts_are_joined_in_their_order_and_none_is_held_twice():
    tracemalloc.start()
    found = joined(Rows, _parts(20))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(found.number, np.arange(20 * PART))
    np.testing.assert_array_equal(found.place[:, 1], -np.arange(20.0 * PART))
    assert (found.number.dtype, len(found), len(found.take([3, 5]))) == (np.int32, 20 * PART, 2)
    held = found.number.nbytes + found.place.nbytes
    # Beside it are a part and what it was made of.
    assert most < 1.3 * held


def test_joining_leaves_the_parts_as_they_were():
    one, other = list(_parts(2))
    found = joined(Rows, [one, other])
    found.number[:] = 7
    assert one.number[0] == 0 and other.number[-1] == 2 * PART - 1
