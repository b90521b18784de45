# SPDX-License-Identifier: GPL-3.0-or-later
"""One glass seen through, and in, another."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.reference.metrics import psnr, to_srgb
from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import border_key, find_layers
from glass_refraction.scene.memory import memory_of, status
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.vertices.chains import exits, pair
from glass_refraction.scene.vertices.neighbours import among
from glass_refraction.scene.vertices.panes import standing_panes
from glass_refraction.scene.vertices.path_keys import path_key, path_of

DISTANCE, STRIPES, SIZE = 0.3, 24, 1.0
THROUGH = optics.ChainedPath(optics.LightPath("TT"), optics.LightPath("TT"), "Far")


def _pane(name, location, turn, thickness=0.03, radius=0.07):
    obj = scenes.glass(shape="SLAB", radius=radius, wall_thickness=thickness)
    obj.name = name
    obj.location, obj.rotation_euler = location, (np.pi / 2, 0.0, turn)
    return obj


def _two_panes(size=(120, 90), samples=4, **settings):
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2, lens=60.0)
    scenes.striped_wall(DISTANCE, STRIPES, SIZE)
    scene = scenes.settings(*size, samples=samples, **settings)
    _pane("Near", (0.0, -0.1, 0.06), 0.5)
    _pane("Far", (0.03, 0.06, 0.06), -0.6)
    bpy.context.view_layer.update()
    return scene


def _block(location, size=0.02):
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    block = bpy.context.object
    block.name = "Block"
    block.data.materials.append(scenes.emissive("block", (0.9, 0.9, 0.1)))
    bpy.context.view_layer.update()
    return block


def _prepared(scene):
    door.prepare(scene, scenes.depsgraph())
    door.update(scene, scenes.depsgraph(), exact=True)
    found = standing_panes(scene, find_layers(scene), scenes.depsgraph(), [])
    return {glass.name: (pane, glass) for pane, glass in found if not pane.borders}


def test_paths_through_two_glasses_are_known_by_their_keys():
    named = optics.LightPath("TR", ("outer", "wet"))
    for path in (
        THROUGH,
        optics.ChainedPath(optics.LightPath("R"), named, "Cup (copy) > 1"),
        optics.ChainedPath(named, optics.LightPath("TTRTT"), "Glas"),
    ):
        assert path_of(path_key(path)) == path


def _shown_by(screen, view):
    """The pixels of the picture that a screen shows."""
    x0, y0, x1, y1 = screen.rect
    out = np.zeros(view.size[::-1], bool)
    out[y0:y1, x0:x1] = screen.cover
    return out


@pytest.mark.parametrize("shading", ["DISPLACED", "TRUE"])
def test_each_pixel_shows_where_its_ray_ends_behind_both(tmp_path, shading):
    scene = _two_panes(surface="REFRACTION", shading=shading)
    found = scenes.picture(scene, tmp_path)
    assert path_key(THROUGH) in status(scene).paths
    view = read_viewpoint(scene, scenes.depsgraph())
    glasses = {glass.name: glass for glass in read_glasses(scenes.depsgraph())}
    near = among(glasses["Near"], glasses.values(), [], scenes.depsgraph(), [])
    _, regions = memory_of(scene).regions["Near"]
    inside = regions.full(regions.weights, view.size)[regions.paths.index(THROUGH)] == 1.0
    # Where rays meet the sides of either pane, rays show what they see.
    _, borders = memory_of(scene).ray_screens[border_key("Near")]
    inside &= ~_shown_by(borders, view)
    rows, columns = np.nonzero(inside)

    def wall_x(offset):
        starts, rays = view.rays_in(near, columns + 0.5 + offset, rows + 0.5)
        end = exits(near, starts, rays, THROUGH)
        way = (DISTANCE - end.origin[:, 1]) / end.direction[:, 1]
        return np.where(end.valid, end.origin[:, 0] + way * end.direction[:, 0], np.nan)

    left, x, right = wall_x(-1.5), wall_x(0.0), wall_x(1.5)
    place = (np.nan_to_num(x) + SIZE / 2) / SIZE * STRIPES
    expected = np.eye(3)[np.floor(place).astype(int) % 3] * 0.7 + 0.1
    border = np.abs(place - np.round(place)) * SIZE / STRIPES
    reach = np.fmax(np.abs(left - x), np.abs(right - x)) + SIZE / 120
    clear = np.isfinite(left + x + right) & (border > reach)
    assert clear.sum() > 100
    off = np.abs(found[rows, columns, :3] - expected).max(axis=1)[clear]
    assert np.quantile(off, 0.99) < (0.01 if shading == "DISPLACED" else 0.05)


def test_two_panes_and_what_stands_between_and_behind_look_as_in_cycles(tmp_path):
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2, lens=60.0)
    scenes.striped_wall(DISTANCE, STRIPES, SIZE)
    scene = scenes.settings(96, 72, samples=24)
    _pane("Near", (0.0, -0.1, 0.06), 0.5, radius=0.08)
    _pane("Far", (0.03, 0.06, 0.06), -0.6, thickness=0.003)
    _block((0.02, -0.02, 0.05))
    _block((-0.01, 0.2, 0.07), size=0.04)
    found = scenes.picture(scene, tmp_path)
    real = render_reference(scene, samples=48)
    assert psnr(to_srgb(found[..., :3]), to_srgb(real[..., :3])) > 32.0


@pytest.mark.parametrize("shape", ["CYLINDER", "SPHERE", "ROD"])
def test_weights_of_a_pane_before_another_glass_sum_to_one(shape):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(64, 48)
    _pane("Near", (0.0, -0.15, 0.06), 0.3, 0.006)
    scenes.glass(shape=shape).name = "Far"
    bpy.context.view_layer.update()
    _prepared(scene)
    _, regions = memory_of(scene).regions["Near"]
    chained = [isinstance(path, optics.ChainedPath) for path in regions.paths]
    assert any(chained)
    assert regions.weights[chained].sum(axis=0).max() > 0.8
    total = regions.shares.sum(axis=0)[regions.hit]
    assert total.max() < 1.0 + 1e-6
    assert np.quantile(total, 0.02) > 0.999


def test_what_stands_between_two_glasses_hides_the_farther():
    scene = _two_panes()
    _prepared(scene)
    _, before = memory_of(scene).regions["Near"]
    chained, alone = before.paths.index(THROUGH), before.paths.index(THROUGH.first)
    assert before.weights[chained].max() > 0.8
    # Near the camera's axis, where rays go from pane to pane.
    _block((0.01, -0.02, 0.06))
    _prepared(scene)
    _, after = memory_of(scene).regions["Near"]
    hidden = (before.weights[chained] > 0.8) & (after.weights[chained] == 0.0)
    assert hidden.sum() > 50
    assert after.weights[alone][hidden].min() > 0.8


def test_moving_the_farther_glass_redoes_what_is_seen_through_both():
    scene = _two_panes()
    _prepared(scene)
    far = bpy.data.objects["Far"]
    far.location.x += 0.002
    bpy.context.view_layer.update()
    memory = memory_of(scene)
    before, regions = dict(memory.copies), dict(memory.regions)
    door.update(scene, scenes.depsgraph(), exact=True)
    renewed = {key[:2] for key in memory.copies if memory.copies[key] is not before.get(key)}
    assert renewed >= {("Near", path_key(THROUGH)), ("Far", "TT")}
    assert all(memory.regions[name] is not regions[name] for name in ("Near", "Far"))
    solves = door.counters["solves"]
    door.update(scene, scenes.depsgraph(), exact=True)
    assert door.counters["solves"] == solves


def test_a_glass_in_another_and_one_in_water_are_left_out_and_told_of():
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(40, 30)
    scenes.glass(shape="CYLINDER").name = "Cup"
    ball = scenes.glass(shape="SPHERE", radius=0.01, wall_thickness=0.0)
    ball.name, ball.location = "Marble", (0.0, 0.0, 0.04)
    tank = scenes.glass(shape="SLAB", contents_ior=1.333)
    tank.name, tank.location, tank.rotation_euler = "Tank", (0, 0.1, 0.06), (np.pi / 2, 0, 0)
    bpy.context.view_layer.update()
    _prepared(scene)
    told = " ".join(status(scene).problems)
    assert '"Marble" is not seen through or in glass "Cup"' in told
    assert '"Cup" is not seen through or in glass "Tank"' in told
    assert '"Tank" is not seen' not in told


def test_two_glasses_as_the_optics_pair_them():
    _two_panes()
    glasses = {glass.name: glass for glass in read_glasses(scenes.depsgraph())}
    both = pair(glasses["Near"], glasses["Far"])
    places = np.random.default_rng(1).normal(size=(20, 3))
    far = glasses["Far"].to_local(glasses["Near"].points_to_world(places))
    assert np.abs(both.to_far(places) - far).max() < 1e-12
    assert np.abs(both.to_near(far) - places).max() < 1e-12


def test_an_engine_without_rays_shows_nothing_where_chains_have_no_copies():
    # In a parallel view rays alone show what is seen through two glasses, where there are any.
    scene = _two_panes((60, 45), surface="GLASS", shading="DISPLACED")
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 0.2
    pane, _ = _prepared(scene)["Near"]
    assert THROUGH in pane.paths


def test_paths_are_listed_once_while_glasses_and_eye_stand_still():
    scene = _two_panes((60, 45), surface="GLASS")
    block = _block((0.0, 0.2, 0.06))
    _prepared(scene)
    listed = door.counters["listed"]
    assert listed >= 4  # each glass alone, and with the other
    block.location.x += 0.01
    bpy.context.view_layer.update()
    _prepared(scene)
    assert door.counters["listed"] == listed
    bpy.data.objects["Far"].location.x += 0.01
    bpy.context.view_layer.update()
    pane, _ = _prepared(scene)["Near"]
    # Alone only the one that moved; both with the other.
    assert door.counters["listed"] == listed + 3
    fresh = pane.paths
    door.forget()
    pane, _ = _prepared(scene)["Near"]
    assert pane.paths == fresh


def test_a_cup_beside_another_glass_is_shown_by_rays_and_the_other_by_copies():
    scenes.camera(location=(0.0, -0.6, 0.06), tilt=np.pi / 2)
    scenes.striped_wall()
    scene = scenes.settings(60, 45, samples=1, surface="GLASS", shading="TRUE")
    for shape, place in (("TUMBLER", -0.08), ("CYLINDER", 0.08)):
        glass = scenes.glass(shape=shape, radius=0.03, height=0.08)
        glass.name, glass.location.x = shape, place
    bpy.context.view_layer.update()
    panes = _prepared(scene)
    cup, _ = panes["TUMBLER"]
    other, _ = panes["CYLINDER"]
    assert cup.rays and not cup.paths
    assert "TTTT" in map(path_key, other.paths) and not other.rays
