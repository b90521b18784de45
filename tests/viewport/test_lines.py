# SPDX-License-Identifier: GPL-3.0-or-later
"""The line in a view that says what it is working on."""

import time
from types import SimpleNamespace

import pytest

from glass_refraction.viewport import views


@pytest.fixture
def view():
    """One by Cycles whose captures are drawn, which shows a whole sample of a few of Cycles'."""
    found = views._View()
    found.model.clear = [None]
    found.is_threaded = found.is_early = True
    found.captures = SimpleNamespace(left=0, total=6)
    return found


def test_a_view_by_cycles_says_that_it_waits_for_the_last_sample(view):
    """It may take a minute, in which edges are stairs."""
    assert view.line() == views.UNREFINED
    view.final = True
    assert view.line() == ""


def test_it_says_so_of_no_engine_that_draws_at_once(view):
    view.is_threaded = False
    assert view.line() == ""


def test_captures_are_told_of_first(view):
    view.captures.left = 2
    assert view.line() == "Surroundings of the glasses: 4 of 6"


def test_nothing_is_told_while_things_move(view):
    """Captures wait for rest: all along an orbit and while an animation played, none was drawn."""
    view.captures.left = 6
    view.changed = time.perf_counter()
    assert view.line() == ""
    view.changed -= 2.0 * views.REST_SECONDS
    assert view.line() == "Surroundings of the glasses: 0 of 6"


def test_what_shows_no_captures_says_so_at_rest_too(view):
    view.is_blind = view.final = True
    assert view.line() == views.BLIND
