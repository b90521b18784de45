# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3D view that Blender composites, in a Blender with a window."""


def test_a_view_as_large_as_the_last_render_shows_no_hole_where_its_glass_was(installed):
    """Captures are not drawn for views: what the frame looks up in them was black there."""
    found = installed.script("composited_view", how="gui", seconds=400)
    assert found["spread"] > 0.02
    assert found["off"] < 0.001
