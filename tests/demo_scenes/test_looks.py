# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that show what glass looks like: they build, lit and unlit, and hold their glasses."""

import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

FOLDER = Path(__file__).parents[2] / "demo_scenes"
sys.path.insert(0, str(FOLDER))

import aquarium  # noqa: E402
import fishbowl  # noqa: E402
import gems  # noqa: E402
import pencil  # noqa: E402
import tumbler  # noqa: E402
import two_glasses  # noqa: E402
import verge  # noqa: E402
import wine  # noqa: E402

import common  # noqa: E402
from glass_refraction.optics import MEDIA  # noqa: E402
from glass_refraction.scene.read.glasses import read_glasses  # noqa: E402
from glass_refraction.scene.read.sources import reaches_into  # noqa: E402

SCRIPTS = {
    "verge": verge,
    "aquarium": aquarium,
    "fishbowl": fishbowl,
    "gems": gems,
    "two_glasses": two_glasses,
    "pencil": pencil,
    "tumbler": tumbler,
    "wine": wine,
}
GLASSES = {"gems": len(MEDIA), "two_glasses": 2, "verge": 2}
"""Where there are more than one."""


@pytest.fixture(autouse=True)
def _extension():
    common.register_extension()


def _glasses():
    return {g.name: g for g in read_glasses(bpy.context.evaluated_depsgraph_get())}


@pytest.mark.parametrize("unlit", [False, True])
@pytest.mark.parametrize("name", SCRIPTS)
def test_it_builds_with_all_its_glasses(name, unlit):
    scene = SCRIPTS[name].build(unlit=unlit)
    assert len(_glasses()) == GLASSES.get(name, 1)
    assert scene.refractive_glass.shading == ("DISPLACED" if unlit else "TRUE")
    surfaces = {
        node.type
        for obj in scene.objects
        if obj.type == "MESH" and obj.name not in _glasses()
        for slot in obj.material_slots
        for node in slot.material.node_tree.nodes
    }
    assert ("EMISSION" in surfaces) == unlit
    assert ("BSDF_DIFFUSE" in surfaces) != unlit


def test_the_verges_walls_are_on_either_side_of_what_parts_them():
    verge.build()
    found = {name: g.description for name, g in _glasses().items()}
    # Pure two-refraction rays pass a wall only where the cavity is narrower than 1 / n.
    share = {name: d.radius[1] / d.radius[0] for name, d in found.items()}
    assert share["Thick glass"] < 1.0 / verge.IOR < share["Thin glass"]


def test_the_fish_swims_in_the_bowl_and_behind_the_wall():
    fishbowl.build()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (bowl,) = _glasses().values()
    assert reaches_into(bowl, bpy.data.objects["Goldfish"], depsgraph)
    assert not reaches_into(bowl, bpy.data.objects["Desk"], depsgraph)
    scene = aquarium.build()
    (wall,) = _glasses().values()
    for name in aquarium.FISH:
        corners = [
            scene.objects[name].matrix_world @ v.co for v in scene.objects[name].data.vertices
        ]
        assert wall.to_local(np.array(corners))[:, 2].max() < -aquarium.WALL


def test_the_still_life_has_things_before_behind_and_in_the_tumbler():
    scene = tumbler.build()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (glass,) = _glasses().values()
    eye = np.array(scene.camera.matrix_world.translation)

    def ends(name):
        obj = scene.objects[name]
        points = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
        ways = np.linalg.norm(points - eye, axis=1)
        return ways.min(), ways.max()

    away = np.linalg.norm(eye[:2])
    radius = glass.description.radius
    assert ends("Marble")[1] < np.hypot(away - radius, eye[2])
    assert ends("Lemon")[0] < np.hypot(away, eye[2])
    assert ends("Vase")[0] > away + radius
    for name in ("Straw", "Slice"):
        assert reaches_into(glass, scene.objects[name], depsgraph)
    for name in ("Marble", "Lemon", "Vase", "Orange", "Table"):
        assert not reaches_into(glass, scene.objects[name], depsgraph)
    # The straw stands across the surface, the slice below it; nothing cuts the glass itself.
    level = glass.description.bottom + glass.description.level
    held = {
        name: glass.to_local(
            np.array(
                [scene.objects[name].matrix_world @ v.co for v in scene.objects[name].data.vertices]
            )
        )
        for name in ("Straw", "Slice")
    }
    assert held["Straw"][:, 2].min() < level < held["Straw"][:, 2].max()
    assert held["Slice"][:, 2].max() < level
    for points in held.values():
        inside = points[points[:, 2] < glass.description.height]
        inner = glass.description.radius - glass.description.wall
        assert np.hypot(inside[:, 0], inside[:, 1]).max() < inner
        assert inside[:, 2].min() > glass.description.bottom


def test_every_medium_hangs_there_and_the_coloured_ones_are_tinted():
    gems.build()
    found = _glasses()
    for name, ior in MEDIA.items():
        assert found[name].description.ior[0] == pytest.approx(ior)
        assert found[name].is_tinted == (name in gems.COLOURS)


def test_the_sky_has_all_directions_and_no_seam():
    sky = common.sky_picture()
    assert sky.shape == (256, 512, 3)
    assert sky.min() > 0.0 and sky.max() > 2.0
    assert np.abs(sky[:, 0] - sky[:, -1]).max() < 0.1


def test_the_pane_stands_before_a_part_of_the_cup_and_the_eraser():
    scene = two_glasses.build()
    glasses, camera = _glasses(), scene.camera
    corners = np.array(glasses["Pane"].description.outline)
    corners = glasses["Pane"].points_to_world(np.column_stack((corners, np.zeros(len(corners)))))
    eye = np.array(camera.matrix_world.translation)
    away = corners - eye
    right = (away[:, 0] / away[:, 1]).max()

    def reach(name):
        points = [
            scene.objects[name].matrix_world @ v.co for v in scene.objects[name].data.vertices
        ]
        points = np.array(points) - eye
        return points[:, 0] / points[:, 1], points[:, 1].min()

    eraser, nearest = reach("Eraser")
    assert eraser.min() < right < eraser.max()
    cup = glasses["Glass"]
    assert (-cup.description.radius[0] - eye[0]) / -eye[1] < right
    assert away[:, 1].max() < min(nearest, -eye[1] - cup.description.radius[0])
