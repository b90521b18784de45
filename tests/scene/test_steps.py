# SPDX-License-Identifier: GPL-3.0-or-later
"""An update in steps: progress that only grows, and a stop between any two that does no harm."""

import bpy
import pytest
import scenes

from glass_refraction.scene import update as door


def _scene():
    scenes.camera()
    scenes.striped_wall()
    for x in (-0.02, 0.02):
        bpy.ops.mesh.primitive_cube_add(size=0.02, location=(x, 0.1, 0.06))
    scenes.glass(shape="CYLINDER")
    scene = scenes.settings(80, 60, min_weight=0.1)
    door.prepare(scene, scenes.depsgraph())
    return scene


def test_progress_grows_and_names_what_comes():
    scene = _scene()
    steps = list(door.updating(scene, scenes.depsgraph()))
    shares = [step.share for step in steps]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] < 1.0
    assert all("Cube" in step.label or "Wall" in step.label for step in steps)
    assert len(steps) == len({step.label for step in steps})


@pytest.mark.parametrize("stop_after", [0, 1, 2])
def test_an_update_that_was_stopped_is_made_up_for(stop_after):
    scene = _scene()
    solved = door.counters["solves"]
    steps = door.updating(scene, scenes.depsgraph())
    for _ in range(stop_after + 1):
        next(steps)
    steps.close()
    assert door.counters["solves"] == solved + stop_after
    whole = len(list(door.updating(scene, scenes.depsgraph())))
    # What was found stays found; the rest comes now, and then all is still.
    assert door.counters["solves"] == solved + whole
    door.update(scene, scenes.depsgraph())
    assert door.counters["solves"] == solved + whole
