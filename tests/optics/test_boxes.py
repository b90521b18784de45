# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes: groups that lie apart, and few boxes round many."""

import numpy as np
import pytest

from glass_refraction.optics import boxes


def random_boxes(rng, count, size=0.1):
    low = rng.uniform(0.0, 1.0, (count, 3))
    return np.stack((low, low + rng.uniform(0.2, 1.0, (count, 3)) * size), axis=1)


def overlap(one, other):
    return bool(np.all((one[0] <= other[1]) & (one[1] >= other[0])))


@pytest.mark.parametrize("most", [None, 3])
def test_of_a_group_no_two_boxes_overlap(most):
    some = random_boxes(np.random.default_rng(1), 150, 0.25)
    group = boxes.apart(some, most)
    _, first = np.unique(group, return_index=True)
    assert (np.diff(first) > 0).all()
    assert group.max() == (2 if most else len(first) - 1)
    for number in range(group.max() + 1):
        of_group = some[group == number]
        if most and number == most - 1:
            continue
        for k, one in enumerate(of_group):
            assert not any(overlap(one, other) for other in of_group[:k])
    # The first group is filled as far as it goes.
    for one in some[group > 0]:
        assert any(overlap(one, other) for other in some[group == 0])


def test_boxes_that_touch_are_not_apart():
    one = np.array([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
    for gap, expected in ((0.0, [0, 1]), (1e-9, [0, 1]), (1e-3, [0, 0])):
        assert boxes.apart([one, np.add(one, (1.0 + gap, 0.0, 0.0))]).tolist() == expected
    assert boxes.apart([]).tolist() == []


def test_few_boxes_hold_many():
    some = random_boxes(np.random.default_rng(2), 200)
    for most in (1, 7, 16, 500):
        few = boxes.fewer(some, most)
        assert len(few) == min(most, len(some))
        for low, high in some:
            assert ((few[:, 0] <= low) & (few[:, 1] >= high)).all(axis=1).any()
    # Those in one place go into one box: 16 hold hardly more room than there is.
    places = np.repeat(random_boxes(np.random.default_rng(3), 16, 0.01), 10, axis=0)
    few = boxes.fewer(places, 16)
    assert np.ptp(few, axis=1).max() < 0.5
    assert len(boxes.fewer(some[:0], 16)) == 0
    same = np.broadcast_to(some[0], (5, 2, 3))
    np.testing.assert_array_equal(boxes.fewer(same, 2), same[:2])
