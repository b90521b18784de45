# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes that are held against Cycles: a seed is a scene, and both pictures show it."""

import importlib.util
import json
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

_FILE = Path(__file__).parents[2] / "scripts" / "random_scenes.py"
_spec = importlib.util.spec_from_file_location("random_scenes", _FILE)
random_scenes = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(random_scenes)


def test_a_seed_is_a_scene():
    found = []
    for seed in (1, 1, 2):
        maker = random_scenes.Maker(seed)
        places = [tuple(obj.matrix_basis.translation) for obj in maker.scene().objects]
        found.append((maker.notes, places))
    assert found[0] == found[1] != found[2]


def test_a_scene_is_rendered_both_ways_and_told_of(tmp_path, monkeypatch):
    for name, value in (("SIZE", (60, 45)), ("SAMPLES", 8), ("REFERENCE_SAMPLES", 8)):
        monkeypatch.setattr(random_scenes, name, value)
    row = random_scenes.held_against_cycles(2, "CYCLES", tmp_path)
    assert json.loads(json.dumps(row)) == row
    assert row["pixels"] > 100
    assert row["inside"] < 0.03
    assert row["inside"] <= row["worst"] < 0.1
    assert row["beside"] < 0.02
    assert (tmp_path / "2.png").is_file()
