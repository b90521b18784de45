# SPDX-License-Identifier: GPL-3.0-or-later
"""A glass within another is seen, whatever the list's order."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.scene.rays.stage import _bands
from glass_refraction.scene.read.glasses import Glass

CLEAR = ((0.0, 0.0, 0.0),) * 2


def ball(name, radius, ior, x=0.0, priority=0):
    pose = np.eye(4)
    pose[0, 3] = x
    return Glass(name, optics.SphereGlass((radius,), (ior,)), pose, CLEAR, priority=priority)


def straight_through(glasses):
    """Whether a ray that passes the inner ball beside its middle leaves as though it was not."""
    ((_, placed),) = _bands(glasses)
    found = []
    for which in (placed, placed[:1]):
        ends = optics.exit_rays(which, (0.01, 0.0, 1.0), [(0.0, 0.0, -1.0)], min_weight=0.3)
        found.append(ends.direction[ends.weight.argmax()])
    return np.allclose(*found, atol=1e-9)


@pytest.mark.parametrize("order", [1, -1])
def test_of_equal_priorities_the_inner_glass_holds(order):
    tank, marble = ball("tank", 0.5, 1.333), ball("marble", 0.05, 1.6)
    ((_, placed),) = _bands([tank, marble][::order])
    ends = optics.exit_rays(placed, (0.01, 0.0, 1.0), [(0.0, 0.0, -1.0)], min_weight=0.3)
    assert ends.events[ends.weight.argmax()] == 4


def test_a_higher_priority_hides_what_is_within():
    tank, marble = ball("tank", 0.5, 1.333, priority=1), ball("marble", 0.05, 1.6)
    assert straight_through([tank, marble])
    assert not straight_through([tank, ball("marble", 0.05, 1.6, priority=1)])
