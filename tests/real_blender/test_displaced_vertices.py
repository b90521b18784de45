# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view's vertex shader puts points where ``optics.apparent_points`` says."""

import pytest

SHAPES = ("slab", "stack", "tank", "surface", "tube", "thick", "thin", "ball", "bubble")


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("apparent", how="gui", seconds=900)


@pytest.mark.parametrize("shape", SHAPES)
def test_vertices_appear_where_optics_says(found, shape):
    result = found[shape]
    assert result["points"] > 33_000
    assert result["infinite"] == 0
    # Pixels of 800, over which the glass is spread.
    assert result["error"] < 0.05
    assert result["way"] < 1e-4
    # Both agree which points have an image, but for some at the very limit.
    assert result["missed"] == 0
    assert result["wrong"] < 2e-3 * result["points"]


@pytest.fixture(scope="module")
def view(installed):
    return installed.script("displaced_view", how="gui", seconds=900)


@pytest.mark.parametrize("name", ["first", "after", "filled", "parallel"])
def test_displaced_things_look_as_by_rays(view, name):
    assert view["failures"] == []
    assert view["psnr"][name] > 32.0
    # Two ways of drawing never agree to the last bit: else something covers the view.
    assert (view["psnr"][name] < 90.0) == (name != "parallel")


def test_a_mesh_is_handed_over_again_only_when_it_changed(view):
    assert view["uploads"] == {"moved": 0, "edited": 1, "doubted": 4}


def test_the_view_says_what_rays_show_and_why(view):
    told = {name: " ".join(lines) for name, lines in view["status"].items()}
    assert "2 glasses" in told["first"] and "By rays" not in told["first"]
    assert "1 glass:" in told["filled"] and "several images" in told["filled"]
    assert "orthographic" in told["parallel"] and "displaced" not in told["parallel"]
