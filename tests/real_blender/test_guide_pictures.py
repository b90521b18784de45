# SPDX-License-Identifier: GPL-3.0-or-later
"""The guide's screenshots: the installed extension's window still looks as they show it."""

import shutil
from pathlib import Path

import flip_evaluator
import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = ("screenshots.py", "first_glass.py")
MOST = 0.05
"""FLIP, mean over the window: a glass or a panel that is not there is more."""


@pytest.fixture(scope="module")
def made(installed):
    """The folder of the screenshots, made anew by the guide's script."""
    folder = installed.folder / "guide"
    folder.mkdir()
    for name in SCRIPTS:
        shutil.copy(ROOT / "scripts" / name, folder)
    script = folder / "screenshots.py"
    found = installed.run(["gui", "--python", script, "--", folder, "first_glass"], 500)
    assert found.returncode == 0, found.stdout
    return folder


@pytest.mark.parametrize("name", ["add_menu", "first_glass"])
def test_the_window_looks_as_the_guide_shows_it(made, name):
    shown = ROOT / "docs" / "pictures" / "guide" / f"{name}.png"
    _, mean, _ = flip_evaluator.evaluate(str(shown), str(made / f"{name}.png"), "LDR")
    assert mean <= MOST
