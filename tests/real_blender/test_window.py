# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed extension in a Blender with a window: add a glass, F12, undo, disable, enable."""

import pytest


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("window", how="gui", seconds=400)


def test_glass_is_added_and_drawn(found):
    assert found["added"] == ["FINISHED"]
    assert found["active"] == "Refractive Glass"
    # The view of the first glass shows the refracted picture by itself; of the mesh it has lines.
    assert found["overlay"]
    assert found["evaluated_edges"] > 100
    assert found["problems_after_adding"] == []
    assert (found["folder"] / "window_glass_added.png").stat().st_size > 10_000


def test_f12_renders(found):
    assert found["render"] == ["complete"]
    assert found["problems_after_rendering"] == []
    assert (found["folder"] / "window_picture.png").is_file()


def test_the_view_comes_to_rest_beside_the_renders_window(found):
    """Its captures are drawn in the context of its own window: in the other's Blender crashed."""
    assert found["windows_after_render"] == 2
    assert found["failures"] == [""]
    assert found["faces_beside_render"] >= 6
    assert found["rest_beside_render"]


def test_a_timer_works_at_nothing_right_after_a_window_was_closed(found):
    """No context is current then, and Blender crashed where its state was asked for."""
    assert not found["at_home_beside_none"]


def test_undo_takes_the_glass_away_and_redo_brings_it_back(found):
    assert "Refractive Glass" not in found["objects_after_undo"]
    assert "Refractive Glass" in found["objects_after_redo"]


def test_views_of_another_workspace_have_the_glass_and_not_its_edges_alone(found):
    assert not found["edges_in_Modeling"]
    assert found["edges_in_Layout"]


def test_disabled_and_enabled_again(found):
    assert found["disabled"]
    assert found["enabled"]


def test_nothing_is_left_when_the_glass_is_removed(found):
    assert found["left_after_removal"] == []
