# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view's vertex shader puts points where ``optics.apparent_points`` says."""

import pytest

SHAPES = ("slab", "stack", "tank", "surface", "tube", "thick", "thin", "ball", "bubble")


@pytest.fixture(scope="module")
def found(installed):
    installed.script("no_splash")
    return installed.script("apparent", how="gui", seconds=900)


@pytest.mark.parametrize("shape", SHAPES)
def test_vertices_appear_where_optics_says(found, shape):
    result = found[shape]
    assert result["points"] > 100_000
    assert result["infinite"] == 0
    # Pixels of 800, over which the glass is spread.
    assert result["error"] < 0.05
    assert result["way"] < 1e-4
    # Both agree which points have an image, but for some at the very limit.
    assert result["missed"] == 0
    assert result["wrong"] < 2e-3 * result["points"]
