# SPDX-License-Identifier: GPL-3.0-or-later
"""Captures in Solid shading, whose light comes with the camera: all is there, lit as beside."""

import math

import pytest


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("capture_light", how="gui", seconds=300)


@pytest.mark.parametrize("face", ["+X", "-X", "+Y", "-Y"])
def test_a_table_reaches_to_the_horizon_in_every_side_face(found, face):
    """Blender left it out of faces that its culling took for others, and shook those it drew."""
    assert found[face]["part"] == pytest.approx(0.5, abs=0.02)


def test_the_face_below_is_full_and_the_one_above_empty(found):
    assert found["-Z"]["part"] == 1.0
    assert found["+Z"]["part"] == 0.0


def test_the_table_has_one_colour_in_all_faces(found):
    colours = [found[face]["colour"] for face in ("+X", "-X", "+Y", "-Y", "-Z")]
    assert min(colours) > 0.0
    assert math.log(max(colours) / min(colours)) < 0.1


def test_preferences_are_as_they_were(found):
    assert found["unsaved"][0] == found["unsaved"][1]
    assert found["smoothed"][0] == found["smoothed"][1] != "OFF"
