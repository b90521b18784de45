# SPDX-License-Identifier: GPL-3.0-or-later
"""Esc ends a render of a window while what it shows in the glass is still computed."""

import pytest


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("escape", how="gui", seconds=400)


def test_esc_stops_what_is_computed(found):
    assert "glass" in found["doing"]
    assert found["ended"] == ["cancelled"]
    assert "was ended before" in found["problems"][0]


def test_every_window_is_watched_until_the_render_ends(found):
    assert len(found["watched"]) > 1 and all(found["watched"])
    assert not any(found["watched_afterwards"])


def test_closing_the_window_of_a_render_stops_it_too(found):
    """Blender waits for the render's thread with all windows held: a minute was seen."""
    assert found["closed"]
    assert "was ended before" in found["problems_closed"][0]


def test_the_next_picture_is_whole(found):
    assert found["ended_again"] == ["complete"]
    assert not any("was ended before" in line for line in found["problems_again"])
    assert found["covered"] > 0
