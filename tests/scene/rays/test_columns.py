# SPDX-License-Identifier: GPL-3.0-or-later
"""Columns that grow part by part, and blocks of rays: the same as all at once, and less memory."""

import tracemalloc
from dataclasses import dataclass

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.reference.cycles import scene_depsgraph
from glass_refraction.scene import update as door
from glass_refraction.scene.memory import counters, memory_of
from glass_refraction.scene.rays import edges, exits, follow, hits, true
from glass_refraction.scene.rays.columns import Columns, joined
from glass_refraction.scene.read.viewpoint import read_viewpoint

PART = 100_000


@dataclass(frozen=True, eq=False)
class Rows(Columns):
    number: np.ndarray
    place: np.ndarray


def _parts(count):
    for k in range(count):
        number = np.arange(k * PART, (k + 1) * PART, dtype=np.int32)
        yield Rows(number, np.stack((number, -number), axis=1).astype(float))


def test_parts_are_joined_in_their_order_and_none_is_held_twice():
    tracemalloc.start()
    found = joined(Rows, _parts(20))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(found.number, np.arange(20 * PART))
    np.testing.assert_array_equal(found.place[:, 1], -np.arange(20.0 * PART))
    assert (found.number.dtype, len(found), len(found.take([3, 5]))) == (np.int32, 20 * PART, 2)
    held = found.number.nbytes + found.place.nbytes
    # Beside it are a part and what it was made of.
    assert most < 1.3 * held


def test_joining_leaves_the_parts_as_they_were():
    one, other = list(_parts(2))
    found = joined(Rows, [one, other])
    found.number[:] = 7
    assert one.number[0] == 0 and other.number[-1] == 2 * PART - 1


def _computed(scene, monkeypatch):
    """The frame's pictures, and how many rays were followed for them."""
    results = []
    compute = true.compute

    def kept(*arguments):
        results.append(compute(*arguments))
        return results[-1]

    before = counters["exit_rays"]
    with monkeypatch.context() as patch:
        patch.setattr(true, "compute", kept)
        patch.setattr(true, "_write", lambda *_: None)
        depsgraph = scene_depsgraph(scene)
        true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
    (result,) = results
    pictures = [result.spread, result.known]
    for view, weight in zip(result.views, result.weights, strict=True):
        pictures += [view.where, view.colour, weight, *view.into, *sum(view.pairs, ())]
    return pictures, counters["exit_rays"] - before


@pytest.mark.parametrize("inside", [False, True])
def test_a_frame_in_many_blocks_is_the_same_to_the_bit(monkeypatch, inside):
    """Whether ways are kept for the next frame or not: a thing in the glass forbids that."""
    scenes.camera()
    scene = scenes.settings(48, 36, samples=1, shading="TRUE", surface="GLASS")
    scenes.glass(shape="SPHERE", radius=0.06, wall_thickness=0.002, location=(0.0, 0.0, 0.08))
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0, 0, 0.08) if inside else (0.1, 0.2, 0.1))
    cube = bpy.context.active_object
    frames = []
    for together in (100_000, 60):
        monkeypatch.setattr(follow, "TOGETHER", together)
        for module in (hits, exits, edges):
            monkeypatch.setattr(module, "TOGETHER", 10 * together)
        door.forget()
        door.prepare(scene, scene_depsgraph(scene), strict=True)
        cube.location.y = 0.0
        first, rays = _computed(scene, monkeypatch)
        cube.location.y = 0.004
        second, again = _computed(scene, monkeypatch)
        frames.append((first, second))
        assert again > 0.7 * rays if inside else again < 0.3 * rays
        blocks = sum(len(kept) for kept in memory_of(scene).kept.parts.values())
        assert (blocks == 0) == inside
        assert inside or (blocks > 10) == (together == 60)
    for one, other in zip(*frames, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
