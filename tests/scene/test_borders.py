# SPDX-License-Identifier: GPL-3.0-or-later
"""Rims, side faces, open ends and borders of paths: rays show there what Cycles shows."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.reference.metrics import psnr, to_srgb
from glass_refraction.scene.borders import border_zone
from glass_refraction.scene.build.layers import border_key, find_layers
from glass_refraction.scene.read.glasses import as_body, read_glasses
from glass_refraction.scene.read.modifier_inputs import write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.update import counters, memory_of, prepare, status, update

NAME = "Refractive Glass"
SHAPES = {
    "upright tube": ({"shape": "CYLINDER", "radius": 0.04, "wall_thickness": 0.006}, (0, 0, 0)),
    "tube from above": (
        {"shape": "CYLINDER", "radius": 0.04, "wall_thickness": 0.006},
        (0.7, 0, 0),
    ),
    "filled tube": (
        {"shape": "CYLINDER", "radius": 0.04, "wall_thickness": 0.006, "contents_ior": 1.333},
        (0.5, 0.2, 0),
    ),
    "rod": ({"shape": "ROD", "radius": 0.03}, (0.6, 0.3, 0)),
    "slab": ({"shape": "SLAB", "radius": 0.05, "wall_thickness": 0.02}, (1.2, 0, 0.5)),
    "diamond": ({"shape": "SPHERE", "radius": 0.045, "wall_thickness": 0.0, "ior": 2.4}, (0, 0, 0)),
}


def _scene(name, samples=16, size=(96, 72), **settings):
    """A glass in the middle of the picture; the world is grey."""
    values, turn = SHAPES[name]
    scenes.camera(location=(0.0, -0.4, 0.04), tilt=np.pi / 2, lens=60.0)
    scene = scenes.settings(*size, samples=samples, surface="GLASS", **settings)
    glass = scenes.glass(height=0.08, **values)
    glass.rotation_euler = turn
    if values["shape"] in {"SPHERE", "SLAB"}:
        glass.location.z = 0.04
    bpy.context.view_layer.update()
    return scene, glass


def _white_world(scene):
    world = bpy.data.worlds.new("white")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    scene.world = world


def _shown(scene):
    """The pixels that the borders' screen shows."""
    _, screen = memory_of(scene).ray_screens[border_key(NAME)]
    x0, y0, x1, y1 = screen.rect
    found = np.zeros((scene.render.resolution_y, scene.render.resolution_x), bool)
    found[y0:y1, x0:x1] = screen.cover
    return found


@pytest.mark.parametrize("name", SHAPES)
def test_ends_look_as_in_cycles(tmp_path, name):
    scene, _ = _scene(name, shading="DISPLACED")
    scenes.striped_wall(0.25, stripes=12)
    found = scenes.picture(scene, tmp_path)
    shown = _shown(scene)
    assert shown.sum() > 200
    one, other = (render_reference(scene, samples=64, seed=seed) for seed in (1, 2))
    found, one, other = (to_srgb(picture[..., :3]) for picture in (found, one, other))
    # At a fourth of the samples noise is 6 dB more.
    assert psnr(found, 0.5 * (one + other), shown) > min(psnr(one, other, shown) - 6.0, 33.0)


@pytest.mark.parametrize("name", SHAPES)
def test_in_a_white_world_any_glass_is_white(tmp_path, name):
    """No light is lost and none is added, at no angle and at no end."""
    scene, _ = _scene(name, shading="TRUE")
    _white_world(scene)
    bpy.ops.mesh.primitive_plane_add(size=1e-3, location=(0.0, 500.0, -500.0))
    found = scenes.picture(scene, tmp_path)[..., :3]
    shown = _shown(scene)
    np.testing.assert_allclose(found[shown], 1.0, atol=2e-3)
    assert found.mean() == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(np.median(found, axis=(0, 1)), 1.0, atol=1e-4)


@pytest.mark.parametrize("name", ["upright tube", "slab"])
def test_the_smooth_middle_is_left_to_the_copies(name):
    """Rays of the middle pixel meet no end and no border; the outline's do."""
    scene, _ = _scene(name, shading="DISPLACED", size=(192, 144))
    scenes.striped_wall(0.25)
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph(), exact=True)
    shown = _shown(scene)
    view = read_viewpoint(scene, scenes.depsgraph())
    body = as_body(read_glasses(scenes.depsgraph())[0])
    x, y = np.meshgrid(np.arange(192) + 0.5, np.arange(144) + 0.5)
    eye, rays = view.rays_in(body, x.ravel(), y.ravel())
    met = np.isfinite(optics.reach(body.description, eye, rays)).reshape(x.shape)
    assert shown[met].mean() < 0.8
    edge = met & ~(
        np.roll(met, 1, 0) & np.roll(met, -1, 0) & np.roll(met, 1, 1) & np.roll(met, -1, 1)
    )
    assert shown[edge].all()
    ends = optics.follow_rays(body.description, eye, rays, min_weight=0.05)
    at_end = [any("side" in n or "rim" in n for n in path.interfaces or ()) for path in ends.paths]
    rows = np.array(at_end)[ends.path] & (ends.weight > 0.05)
    places = np.zeros(met.size, bool)
    places[ends.ray[rows]] = True
    assert places.any() and shown.ravel()[places].all()


def test_what_a_rim_stands_on_is_seen_through_it(tmp_path):
    """Between a glass and what touches it there is no air that would reflect."""
    scene, _ = _scene("upright tube", shading="DISPLACED", samples=32)
    scene.camera.location, scene.camera.rotation_euler.x = (0.0, -0.3, 0.2), 1.0
    _white_world(scene)
    bpy.ops.mesh.primitive_plane_add(size=1.0)
    bpy.context.object.data.materials.append(scenes.emissive("black", (0.0, 0.0, 0.0)))
    lifted = []
    for height in (0.0, 0.002):
        bpy.data.objects[NAME].location.z = height
        found = scenes.picture(scene, tmp_path)[..., 0]
        lifted.append(found[found > 0.5].size)
    # With air below, the rim mirrors the world.
    assert lifted[1] > lifted[0] + 20


@pytest.mark.parametrize(
    "place", [(5.0, 0.0, 0.0), (0.0, 0.0, -5.0), (0.0, -1.0, 0.0), (0.0, -0.4, 0.0)]
)
def test_glasses_out_of_the_picture_and_round_the_eye_have_no_borders(place):
    scene, glass = _scene("upright tube", shading="TRUE")
    scenes.striped_wall(0.25)
    glass.location = place
    bpy.context.view_layer.update()
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph(), exact=True)
    _, screen = memory_of(scene).ray_screens[border_key(NAME)]
    assert not screen.cover.any() and not len(screen.cells)
    assert not status(scene).problems


def test_without_rays_in_the_scene_nothing_is_added():
    scene, _ = _scene("upright tube", shading="DISPLACED")
    scene.refractive_glass.surface = "REFRACTION"
    scenes.striped_wall(0.25)
    prepare(scene, scenes.depsgraph())
    assert border_key(NAME) not in find_layers(scene).path_keys()


def test_a_still_scene_follows_no_ray_again():
    scene, glass = _scene("slab", shading="TRUE")
    scenes.striped_wall(0.25)
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph(), exact=True)
    before = dict(counters)
    memory_of(scene).still = None
    update(scene, scenes.depsgraph(), exact=True)
    assert counters["masks"] == before["masks"]
    glass.location.x += 0.01
    bpy.context.view_layer.update()
    update(scene, scenes.depsgraph(), exact=True)
    assert counters["masks"] == before["masks"] + 2


def test_light_of_all_colours_has_one_zone():
    """Else one colour's screen would be missing where another one's is shown."""
    scene, _ = _scene("slab", shading="DISPLACED")
    scenes.striped_wall(0.25)
    modifier = bpy.data.objects[NAME].modifiers[0]
    write_input(modifier, "Abbe Number", 20.0)
    bpy.context.view_layer.update()
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph(), exact=True)
    screens = memory_of(scene).ray_screens
    covers = [screens[key][1].cover for key in screens]
    assert len(covers) == 3
    assert all(np.array_equal(covers[0], cover) for cover in covers[1:])


def test_a_zone_is_smooth_only_where_paths_have_no_copies():
    scene, _ = _scene("upright tube")
    view = read_viewpoint(scene, scenes.depsgraph())
    glass = read_glasses(scenes.depsgraph())[0]
    cover, hit = np.zeros((30, 40), bool), np.zeros((30, 40), bool)
    hit[5:25, 5:35] = True
    cover[5:15] = hit[5:15]
    paths = (optics.LightPath("TTTT"), optics.LightPath("R"))
    alone = border_zone(glass, view, [(cover, hit)], paths, paths[1:])
    assert alone.smooth[15:25, 10:30].all() and not alone.smooth[~hit].any()
    # A pixel of the smooth part may still be filtered over the cover's outermost.
    assert alone.smooth[13, 20] and not alone.smooth[9, 20]
    assert not border_zone(glass, view, [(cover, hit)], paths, ()).bare
