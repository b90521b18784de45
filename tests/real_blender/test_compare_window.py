# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare in a Blender with a window: Esc cancels, and its picture is shown."""

import pytest


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("compare", how="gui", seconds=400)


def test_esc_cancels_and_leaves_all_as_it_was(found):
    assert found["started"] == ["RUNNING_MODAL"]
    assert found["running"]
    assert found["cancelled"]
    assert found["same_after_cancel"]
    assert found["files_after_cancel"] == []


def test_the_end_shows_the_strip(found):
    assert found["same_at_the_end"]
    assert {"comparison.png", "report.md", "report.json"} <= set(found["files"])
    assert found["shown"] == ["comparison.png"]
