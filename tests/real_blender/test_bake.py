# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked files in a Blender that has never seen the extension, and the bake in a window."""

import shutil
import tempfile
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def farm(blender):
    """A Blender with a home folder of its own, in which no extension is installed."""
    home = Path(tempfile.mkdtemp(prefix="farm_", dir=blender.folder))
    (home / "home").mkdir()
    yield type(blender)(home, blender.screen)
    shutil.rmtree(home, ignore_errors=True)


PARTS = [("-f", "3", "-s", "1", "-e", "2", "-a"), ("-f", "2", "-f", "3", "-f", "1")]
"""As a farm splits a range: parts, and single frames in any order. Each starts with a frame that
counts for nothing: some engines' very first picture of a session differs."""


@pytest.mark.in_turn(3)
@pytest.mark.parametrize(
    ("engine", "last", "parts"),
    [
        ("CYCLES", 3, PARTS),
        ("BLENDER_WORKBENCH", 3, PARTS),
        # By software it takes over ten seconds a frame.
        ("BLENDER_EEVEE", 2, [("-f", "2", "-s", "1", "-e", "2", "-a")]),
    ],
)
def test_a_farm_renders_the_same_pictures(installed, farm, engine, last, parts):
    made = installed.script("bake_scene", engine, last)
    assert made["baked"] == ["FINISHED"]
    file = made["folder"] / "scene.blend"
    for arguments in parts:
        found = farm.run(["run", file, "-o", "//farm_####", *arguments], 600)
        assert found.returncode == 0, found.stdout
    found = farm.script("bake_differences", made["folder"])
    assert not found["extension"]
    assert found["moves"] > 0.1
    differences = {k: v for k, v in found.items() if k.startswith("farm_")}
    assert differences == {f"farm_{frame:04d}": 0.0 for frame in range(1, last + 1)}


@pytest.fixture(scope="module")
def window(installed):
    return installed.script("bake_window", how="gui", seconds=400)


def test_the_operator_bakes_between_redraws(window):
    assert window["invoked"] == ["RUNNING_MODAL"]
    assert window["baked"] == "2-5"
    assert window["frame_after_baking"] == 3


def test_f12_shows_the_bake_and_solves_nothing(window):
    assert window["live_ended"] == window["again_ended"] == ["complete"]
    assert window["difference"] == 0.0
    assert not window["solved"]
    assert not window["folder_after_freeing"]


def test_escape_cancels(window):
    assert window["invoked_again"] == ["RUNNING_MODAL"]
    assert window["under_way"] == 1
    assert 1 < window["frame_under_way"] < 40
    assert window["baked_after_escape"] is None
    assert not window["folder_after_escape"]
    assert window["frame_after_escape"] == 3
