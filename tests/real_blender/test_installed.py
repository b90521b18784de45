# SPDX-License-Identifier: GPL-3.0-or-later
"""The zip installed in a real Blender: its command line, and pictures without a window."""

import numpy as np
import pytest


def test_zip_is_valid(blender, archive):
    found = blender.command("extension", "validate", archive)
    assert found.returncode == 0, found.stdout


def test_command_line(installed):
    found = installed.command("refractive_glass", "--help")
    assert found.returncode == 0
    assert "compare" in found.stdout


def test_bad_input_ends_with_status_2_and_one_line(installed):
    found = installed.command("refractive_glass", "render", "missing.blend", "-o", "x.png")
    assert found.returncode == 2
    (line,) = [line for line in found.stdout.splitlines() if "refractive_glass" in line]
    assert "missing.blend: no such file" in line


@pytest.fixture(scope="module", params=["CYCLES", "BLENDER_EEVEE"])
def tilted_pane(installed, request):
    return installed.script("tilted_pane", request.param)


def test_tilted_pane_shifts_what_is_behind_it(tilted_pane):
    found = tilted_pane
    direct, glass = (np.load(found["folder"] / f"{name}.npy") for name in ("direct", "glass"))
    height, width, _ = direct.shape
    x = (np.arange(width) + 0.5) / width - 0.5  # in widths of the picture
    x *= found["view"]
    rows = slice(height // 4, 3 * height // 4)

    outside = np.abs(x) > 0.07
    assert np.abs(glass - direct)[:, outside].max() < 1e-3

    # By Snell's law the whole wall is shifted alike; red grows from 0 to 1 across the wall.
    inside = np.abs(x) < 0.012
    shifts = (glass - direct)[rows, inside, 0]
    pixel = found["view"] / width / (2 * found["view"])  # of red
    assert shifts == pytest.approx(np.full(shifts.shape, found["shift"]), abs=0.1 * pixel)
    assert np.abs(glass - direct)[rows, inside, 1:].max() < 0.1 * pixel


def test_removing_the_glass_removes_what_was_made_for_it(tilted_pane):
    found = tilted_pane
    assert found["added"] == ["FINISHED"]
    direct, again = (np.load(found["folder"] / f"{name}.npy") for name in ("direct", "again"))
    assert np.array_equal(direct, again)
    for kind, names in found["before"].items():
        left = [n for n in found["after"][kind] if n not in names and n.startswith(".RG")]
        assert left == [], kind


def test_settings_may_change_between_renders(installed):
    """Blender 5.2 crashes where a render that has begun finds a node group freed."""
    assert installed.script("rerender")["rendered"] == 6


def test_the_compositor_may_name_another_scene_of_the_users(installed):
    """Blender 5.2 crashes where that scene's objects were not listed since the glass was made."""
    assert installed.script("composited")["color"] == pytest.approx([0, 0, 1], abs=0.01)


def test_handlers_of_the_users_may_hide_things(installed):
    """Blender 5.2 crashes where a frame change or a render finds a scene's list out of date."""
    assert installed.script("users_handlers")["events"] == 8


def test_the_asset_library_is_written_and_goes_again(installed):
    found = installed.script("assets")
    assert found["assets"] >= 14
    assert found["inside_the_extension"] is False
    assert found["left"] is False
