# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension is disabled in a window while it is at work: nothing fails, nothing stays behind.

What Blender prints is looked through as well: a traceback fails all of it.
"""

import pytest

PARTS = ("computed", "drawn", "again", "animated", "compared", "composited", "baked", "shown")


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("disabled", how="gui", seconds=600)


@pytest.mark.parametrize("part", PARTS)
def test_nothing_is_left(found, part):
    assert found[part]["left"] == []


def test_what_a_render_computes_ends_at_once(found):
    assert found["computed"]["at"].startswith("following light")
    assert found["computed"]["after"] is None


def test_an_own_scene_stays_as_long_as_an_engine_draws_it(found):
    assert found["drawn"]["running"]
    assert found["drawn"]["at"].startswith("rendering what else")


def test_enabled_again_while_a_render_goes_on(found):
    assert found["again"]["running"]
    assert found["again"]["ended"] == ["complete"]
    assert not any("was ended before" in line for line in found["again"]["problems"])
    assert found["again"]["covered"] > 0


def test_what_buttons_hold_stays_until_no_engine_reads_the_scene(found):
    """Blender 5.2 crashes on a button whose panel, operator or property has gone."""
    assert found["animated"]["running"]
    assert all(found["animated"]["stays"].values())
    assert not found["animated"]["shown"]
    assert not any(found["animated"]["ends"].values())
    assert found["animated"]["back"]


def test_a_comparison_ends_when_its_render_has(found):
    assert found["compared"]["running"]


def test_what_the_compositor_works_with_stays(found):
    """It crashed where a file was saved, or the extension disabled, while it worked."""
    assert found["composited"]["running"] == [True, True]


def test_a_picture_keeps_its_glass_when_the_file_is_saved(found):
    assert found["composited"]["changed"] < 0.0005
    assert len(found["composited"]["saved"]) == 1


def test_a_bake_is_cancelled(found):
    assert found["baked"]["under_way"] == 1
    assert found["baked"]["after"] == 0
    assert found["baked"]["files"] == []


def test_views_show_no_refracted_picture_any_more(found):
    assert found["shown"]["handles"] == 3
    assert found["shown"]["after"] == 0
