# SPDX-License-Identifier: GPL-3.0-or-later
"""An update in steps: progress that only grows, and a stop between any two that does no harm."""

import threading
import time
from contextlib import closing

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.memory import memory_of
from glass_refraction.scene.progress import Stopped, check
from glass_refraction.scene.steps import Apart
from glass_refraction.scene.vertices import displaced, kept_paths
from glass_refraction.scene.vertices.appearance import Search


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


def test_windows_wait_for_no_long_work(monkeypatch):
    """An update held them for 22 s at a time; what is found is the same."""
    scene = _scene()
    door.update(scene, scenes.depsgraph())
    at_once = memory_of(scene)
    door.forget(scene)
    door.prepare(scene, scenes.depsgraph())
    threads = []

    def spied(work):
        def spy(*args, **kwargs):
            threads.append(threading.current_thread())
            return work(*args, **kwargs)

        return spy

    for room, name in (
        (displaced, "path_regions"),
        (kept_paths, "bright_paths"),
        (Search, "find"),
    ):
        monkeypatch.setattr(room, name, spied(getattr(room, name)))
    with closing(Apart()) as apart:
        steps = list(door.updating(scene, scenes.depsgraph(), apart))
    assert len(threads) > 4 and threading.main_thread() not in threads
    assert len(steps) > len({step.label for step in steps})
    found = memory_of(scene)
    assert found.copies.keys() == at_once.copies.keys()
    for key, (_, _, shape) in found.copies.items():
        _, _, expected = at_once.copies[key]
        assert (shape.images is None) == (expected.images is None)
        if shape.images is not None:
            np.testing.assert_array_equal(shape.images.position, expected.images.position)


def test_work_that_nobody_waits_for_ends():
    begun = threading.Event()

    def work():
        begun.set()
        while True:
            check()
            time.sleep(0.001)

    apart = Apart()
    going = apart("a glass", "its paths", work)
    assert begun.wait(10.0)
    apart.close()
    assert isinstance(going.exception(timeout=10.0), Stopped)
