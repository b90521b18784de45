# SPDX-License-Identifier: GPL-3.0-or-later
"""The compositor tree of True shading: small trees, all of which go again."""

import sys
from pathlib import Path

import bpy
import numpy as np

from glass_refraction.scene import update as door
from glass_refraction.scene.names import own

sys.path.insert(0, str(Path(__file__).parent.parent))
import scenes

MOST_NODES = 100
"""Blender goes through all of a tree for each node and link that is added: 400 took a second."""


def _own_trees():
    return [tree for tree in bpy.data.node_groups if own(tree) and not own(tree, "cast")]


def test_no_tree_is_so_large_that_building_it_holds_the_window():
    scenes.camera()
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    scene = scenes.settings(32, 24, samples=1, shading="TRUE")
    scene.render.film_transparent = True
    before = set(_own_trees())
    door.prepare(scene, bpy.context.evaluated_depsgraph_get())
    made = [t for t in _own_trees() if t not in before and t.bl_idname == "CompositorNodeTree"]
    assert len(made) > 2
    assert max(len(tree.nodes) for tree in made) < MOST_NODES


def test_trees_of_views_go_with_the_whole():
    scenes.camera()
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    scene = scenes.settings(32, 24, samples=1, shading="TRUE")
    before = len(_own_trees())
    counts = []
    for alpha in (False, True, False):
        scene.render.film_transparent = alpha
        door.prepare(scene, bpy.context.evaluated_depsgraph_get())
        counts.append(len(_own_trees()))
    assert counts[0] == counts[2] < counts[1]
    door.withdraw(scene)
    assert len(_own_trees()) <= before


def test_a_picture_of_another_size_than_the_last_frames_passes_as_it_is(tmp_path):
    """Such as that of a 3D view that is composited; new pictures have four pixels a side."""
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    scene = scenes.settings(32, 24, samples=1, shading="TRUE")
    door.prepare(scene, bpy.context.evaluated_depsgraph_get())
    names = ("render_init", "render_pre", "frame_change_post")
    lists = [getattr(bpy.app.handlers, name) for name in names]
    kept = [list(some) for some in lists]
    for some in lists:
        some.clear()
    try:
        composited = scenes.picture(scene, tmp_path, "composited")
        scene.compositing_node_group = None
        plain = scenes.picture(scene, tmp_path, "plain")
    finally:
        for some, functions in zip(lists, kept, strict=True):
            some.extend(functions)
    assert plain.std() > 0.05
    assert np.array_equal(composited, plain)
