# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the optics library: laws of light, not golden numbers. No Blender needed."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
for folder in (ROOT, HERE):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))


def pytest_configure(config):
    config.addinivalue_line("markers", "slow: large runs and timings, minutes rather than seconds")


def pytest_collection_modifyitems(config, items):
    # Left out unless they are asked for, by -m or by name.
    if config.getoption("-m") or any("::" in str(arg) for arg in config.args):
        return
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(pytest.mark.skip(reason="slow: run with -m slow"))
