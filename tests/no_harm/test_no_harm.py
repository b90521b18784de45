# SPDX-License-Identifier: GPL-3.0-or-later
"""No harm to any file: random walks through what users do, with the extension and without it.

The walk itself is ``tests/real_blender/inside/no_harm.py``; here it goes in the bpy wheel.
"""

import importlib.util
from pathlib import Path

import bpy
import pytest

import glass_refraction

_FILE = Path(__file__).parents[1] / "real_blender" / "inside" / "no_harm.py"
_spec = importlib.util.spec_from_file_location("no_harm", _FILE)
no_harm = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(no_harm)

STEPS = 250


def _fresh():
    bpy.ops.wm.read_factory_settings(use_empty=False)
    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()


@pytest.mark.in_turn(2)
@pytest.mark.parametrize("seed", [2013, 2014])
def test_what_the_user_has_stays_the_users(tmp_path, seed):
    did = no_harm.compare(seed, STEPS, tmp_path, _fresh)
    assert did["compared"] > STEPS / 2
    assert did["undo"] > 0
