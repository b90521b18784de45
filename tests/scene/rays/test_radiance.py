# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that is known without a view: worlds of one colour, lamps, stand-ins."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene.rays.hits import KNOWN, UNSEEN, Scene, Shown, Ways
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.radiance import (
    COMPARED,
    UNLIMITED,
    Clamp,
    Lookups,
    known_light,
    stand_ins,
)
from glass_refraction.scene.rays.sky import Sky, sky_of
from glass_refraction.scene.rays.things import Things
from glass_refraction.scene.read.world import uniform_radiance


def _world(colour=(0.2, 0.4, 0.8), strength=2.0):
    world = bpy.data.worlds.new("World")
    node = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    node.inputs["Color"].default_value = (*colour, 1.0)
    node.inputs["Strength"].default_value = strength
    return world, node


@pytest.mark.parametrize("way", ["plain", "none", "unlinked"])
def test_a_world_of_one_colour_is_as_cycles_draws_it(tmp_path, way):
    scene = scenes.settings(4, 4, samples=1)
    scenes.camera()
    world, _ = _world()
    scene.world = None if way == "none" else world
    if way == "unlinked":
        world.node_tree.links.clear()
    found = scenes.picture(scene, tmp_path)[2, 2, :3]
    np.testing.assert_allclose(found, uniform_radiance(scene.world, "CYCLES"), rtol=1e-5)


def test_a_world_of_more_than_one_colour_is_not_known():
    world, node = _world()
    assert uniform_radiance(world, "CYCLES") == pytest.approx((0.4, 0.8, 1.6))
    texture = world.node_tree.nodes.new("ShaderNodeTexGradient")
    world.node_tree.links.new(texture.outputs["Color"], node.inputs["Color"])
    assert uniform_radiance(world, "CYCLES") is None


def test_a_worlds_node_that_is_muted_or_behind_another_is_not_taken_for_it(tmp_path):
    """Whatever stands between background and output, a known radiance is the drawn one."""
    scene = scenes.settings(4, 4, samples=1)
    scenes.camera()
    world, node = _world()
    scene.world = world
    node.mute = True
    known = uniform_radiance(world, "CYCLES")
    found = scenes.picture(scene, tmp_path)[2, 2, :3]
    if known is not None:
        np.testing.assert_allclose(found, known, rtol=1e-5)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_an_engines_own_output_of_the_world_counts(tmp_path, engine):
    """A world may have an output for each engine: the picture's sky tells which one holds."""
    scene = scenes.settings(4, 4, samples=1)
    scene.render.engine = engine
    scenes.camera()
    world, _ = _world()
    scene.world = world
    tree = world.node_tree
    (shared,) = (n for n in tree.nodes if n.type == "OUTPUT_WORLD")
    shared.target = "EEVEE"
    own = tree.nodes.new("ShaderNodeOutputWorld")
    own.target = "CYCLES"
    other = tree.nodes.new("ShaderNodeBackground")
    other.inputs["Color"].default_value = (0.9, 0.1, 0.3, 1.0)
    tree.links.new(other.outputs["Background"], own.inputs["Surface"])
    found = scenes.picture(scene, tmp_path)[2, 2, :3]
    np.testing.assert_allclose(found, uniform_radiance(world, engine), rtol=1e-3)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE", "BLENDER_WORKBENCH"])
def test_what_a_transparent_film_leaves_out(engine):
    """The hole is seen through glass, and mirrors show the world."""
    scene = scenes.settings()
    scene.render.engine = engine
    scene.world, _ = _world()
    ways = _ways(np.zeros((2, 3)), [-1, -1], path=(2, 3))
    assert not sky_of(scene, (), scene.world).is_clear(ways).any()
    scene.render.film_transparent = True
    assert sky_of(scene, (), scene.world).is_clear(ways).tolist() == [
        True,
        engine == "BLENDER_WORKBENCH",
    ]


def _ways(points, triangle, path=None):
    count = len(points)
    origins = np.asarray(points, float) - (0, 0, 1)
    sky = np.asarray(triangle) < 0
    return Ways(
        np.arange(count), np.resize(path or 1, count), np.ones(count), np.ones((count, 3)), origins,
        np.tile((0.0, 0.0, 1.0), (count, 1)), np.where(sky, np.inf, 1.0), np.asarray(triangle),
        np.ones(count, int), np.zeros(count, bool),
    )  # fmt: skip


def _things(*looks):
    """One triangle of each look, facing −z."""
    corners = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0)], float)
    points = np.concatenate([corners + np.array((3.0 * k, 0, 0)) for k in range(len(looks))])
    triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    surface = np.arange(len(looks), dtype=np.int32)
    return Things(points, triangles, surface, looks, tuple("abcdef"[: len(looks)]))


def test_lamps_and_sky_give_their_own_light():
    lamp = Look((0, 0, 0), (3.0, 2.0, 1.0), True, False, 1)
    things = _things(Look(), lamp, lamp)
    normals = np.array([(0, 0, -1.0), (0, 0, -1.0), (0, 0, 1.0)])
    ways = _ways(np.zeros((5, 3)), [0, 1, 2, -1, 1])
    found = known_light(things, normals, Sky((0.5, 0.6, 0.7)), ways)
    # An area lamp gives light on the side of its face alone.
    np.testing.assert_array_equal(
        found, [(0, 0, 0), (3, 2, 1), (0, 0, 0), (0.5, 0.6, 0.7), (3, 2, 1)]
    )


def test_a_lamps_light_is_multiplied_by_whether_it_is_mirrored():
    things = _things(Look((0, 0, 0), (4.0, 4.0, 4.0), True, factors=(0.5, 0.25)))
    ways = _ways(np.zeros((2, 3)), [0, 0], path=[2, 3])
    found = known_light(things, np.array([(0, 0, -1.0)]), Sky(None), ways)
    np.testing.assert_array_equal(found[:, 0], [2.0, 1.0])


class _Lid:
    """Meets ways that go up, so far away, from one x on."""

    def __init__(self, distance=np.inf, begin=0.0):
        self.distance, self.begin = distance, begin

    def cast(self, origins, directions):
        met = (origins[:, 0] > self.begin) & (directions[:, 2] > 0.0)
        return np.where(met, self.distance, np.inf), np.where(met, 0, -1)


def _scene(things, normals=None, lid=None):
    scene = Scene(lid or _Lid(), things, Sky(None))
    if normals is not None:
        scene.normals = np.array(normals, float)
    return scene


def _lookups(scene, ways, shown):
    count = len(ways)
    return Lookups.of(scene, ways, shown, np.arange(count), np.ones(count), UNLIMITED)


def test_a_hit_that_no_view_shows_takes_the_nearest_of_its_surface():
    scene = _scene(_things(Look(), Look((0.2, 0.4, 0.6), (1.0, 0.0, 0.0))))
    points = [(0, 0, 0), (0.5, 0, 0), (0.45, 0, 0), (0.44, 0, 0), (3, 0, 0)]
    ways = _ways(points, [0, 0, 0, 1, 1])
    pixels = np.arange(10.0).reshape(5, 2)
    shown = Shown(np.array([0, 1, UNSEEN, UNSEEN, UNSEEN]), pixels.copy())
    lookups = _lookups(scene, ways, shown)
    lacking, guessed = stand_ins(scene, lookups)
    np.testing.assert_array_equal(lookups.view, [0, 1, 1, KNOWN, KNOWN])
    np.testing.assert_array_equal(lookups.place[2], pixels[1])
    # Nothing of the other surface is shown: its own light, and its colour under a mean light.
    np.testing.assert_array_equal(lacking, [2, 3, 4])
    np.testing.assert_allclose(guessed, [(0, 0, 0)] + [(1.1, 0.2, 0.3)] * 2)


def test_a_stand_in_is_turned_as_the_hit_that_it_stands_for():
    """Round a slender rod: along it all is lit alike, and not from one side to the other."""
    random = np.random.default_rng(0)
    angle, along = random.uniform(0, 2 * np.pi, 600), random.uniform(0, 1.0, 600)
    around = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    points = np.concatenate((0.02 * around, along[:, None]), axis=1)
    scene = _scene(_things(Look()), np.concatenate((around, 0 * along[:, None]), axis=1))
    scene.things = replace(scene.things, surface=np.zeros(600, int))
    hidden = (along > 0.4) & (along < 0.6)
    pixels = random.uniform(0, 100, (600, 2))
    shown = Shown(np.where(hidden, UNSEEN, 0), pixels.copy())
    lookups = _lookups(scene, _ways(points, np.arange(600)), shown)
    stand_ins(scene, lookups)
    # By the place of each stand-in, whose it is.
    whose = (lookups.place[hidden, None] == pixels).all(axis=-1).argmax(axis=1)
    turned = np.abs((angle[hidden] - angle[whose] + np.pi) % (2 * np.pi) - np.pi)
    assert not hidden[whose].any() and turned.max() < 0.5
    assert np.abs(along[hidden] - along[whose]).max() < 0.3


@pytest.mark.parametrize("radiance", [(0.0,) * 3, (1.0,) * 3])
def test_a_stand_in_is_darker_where_less_light_comes(radiance):
    """Under a lid; on the other side of the face, which is not under it, and what shines, not."""
    scene = _scene(_things(Look((0.5,) * 3, radiance)), [(0, 0, 1.0)], lid=_Lid(0.1, 5.0))
    points = np.array([(0, 0, 0), (9, 0, 0), (9, 0, 0), (0, 0, 0), (4, 0, 0)], float)
    ways = _ways(points, [0] * 5)
    ways = replace(
        ways, direction=np.array([(0, 0, -1.0)] * 2 + [(0, 0, 1.0)] + [(0, 0, -1.0)] * 2)
    )
    lookups = _lookups(scene, ways, Shown(np.array([0, UNSEEN, UNSEEN, 0, 0]), np.zeros((5, 2))))
    before = lookups.colour.copy()
    stand_ins(scene, lookups)
    factor = (lookups.colour / before)[:, 0]
    assert (factor[1] < 0.1) == (not any(radiance))
    np.testing.assert_array_equal(np.delete(factor, 1), 1.0)


def test_stand_ins_are_looked_for_among_each_rays_ways_alike():
    """Each ray's two ways meet two far ends of a surface, in turns."""
    count = 2 * COMPARED
    along = np.repeat(np.linspace(0.0, 1.0, count), 2) + np.tile((0.0, 9.0), count)
    along = np.append(along, (0.5, 9.5))
    scene = _scene(_things(Look()))
    points = np.stack((along, 0 * along, 0 * along), axis=1)
    pixels = points[:, :2].copy()
    view = np.append(np.zeros(2 * count, int), (UNSEEN, UNSEEN))
    lookups = _lookups(scene, _ways(points, np.zeros(len(along), int)), Shown(view, pixels))
    stand_ins(scene, lookups)
    np.testing.assert_allclose(lookups.place[-2:, 0], (0.5, 9.5), atol=0.02)


def test_no_ways_need_no_stand_in():
    ways = _ways(np.zeros((0, 3)), np.zeros(0, int))
    shown = Shown(np.zeros(0, int), np.zeros((0, 2)))
    scene = _scene(_things(Look()))
    lookups = _lookups(scene, ways, shown)
    lacking, guessed = stand_ins(scene, lookups)
    assert len(lookups) == len(lacking) == len(guessed) == 0


def test_light_of_one_sample_is_clamped_as_the_engine_does():
    ways = replace(
        _ways(np.zeros((4, 3)), [-1] * 4),
        weight=np.array([1.0, 0.5, 0.5, 0.5]),
        colour=np.array([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.5, 0.5, 0.5], [0.05, 0.05, 0.05]]),
        events=np.array([1, 2, 2, 2]),
    )
    clamp = Clamp(0.0, 10.0)
    light = clamp.limited((900.0, 600.0, 300.0), ways)
    # A mirror image counts as direct light. Fresnel's part is no part of a sample, a tint is.
    np.testing.assert_allclose(light[0], (900, 600, 300))
    np.testing.assert_allclose(light[1:3], [(15, 10, 5)] * 2)
    np.testing.assert_allclose(light[3], (150, 100, 50))
    np.testing.assert_allclose(clamp.limited((3.0, 2.0, 1.0), ways), [(3, 2, 1)] * 4)
    np.testing.assert_allclose(
        UNLIMITED.limited((900.0, 600.0, 300.0), ways), [(900, 600, 300)] * 4
    )


def test_rough_surfaces_gather_a_small_lamp_in_every_sample():
    ways = replace(_ways(np.zeros((2, 3)), [-1, -1]), events=np.array([2, 2]))
    ways = replace(ways, rough=np.array([False, True]))
    light = Clamp(0.0, 10.0).limited((1000.0, 1000.0, 1000.0), ways, np.array([0.005, 0.005]))
    np.testing.assert_allclose(light, [(0.05,) * 3, (5.0,) * 3])


def _glass_ball():
    """A scene of a glass ball, in which samples are clamped to 2."""
    scenes.camera()
    scene = scenes.settings(48, 36, samples=4, shading="TRUE", surface="GLASS")
    scene.cycles.sample_clamp_indirect = 2.0
    scene.world = None
    scenes.glass(shape="SPHERE", radius=0.06, wall_thickness=0.0, location=(0.0, 0.0, 0.08))
    return scene


def _in_the_ball(scene, tmp_path):
    """What is seen in its middle, as the extension shows it and as Cycles does."""
    found, wanted = scenes.picture(scene, tmp_path), render_reference(scene, samples=128)
    return found[18:30, 20:36, 1], wanted[18:30, 20:36, 1]


def test_what_shines_is_as_bright_in_a_glass_as_samples_may_be(tmp_path):
    """A ball of 30 in a glass ball: Cycles clamps what is seen by two refractions, ours was 30."""
    scene = _glass_ball()
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.1, location=(0.0, 1.0, 0.1))
    bpy.context.object.data.materials.append(scenes.emissive("Fire", (30.0, 30.0, 30.0)))
    found, wanted = _in_the_ball(scene, tmp_path)
    assert wanted.max() == pytest.approx(2.0, rel=0.1)
    assert found.max() == pytest.approx(wanted.max(), rel=0.1)
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.1)


def test_a_suns_image_in_a_glass_is_as_bright_as_in_cycles(tmp_path):
    """A sun of 20 degrees behind a ball, far brighter than what samples may have."""
    scene = _glass_ball()
    light = bpy.data.lights.new("Sun", "SUN")
    light.angle, light.energy = np.radians(20.0), 30.0
    lamp = bpy.data.objects.new("Sun", light)
    lamp.rotation_euler = (-1.9, 0.0, 0.2)
    scene.collection.objects.link(lamp)
    found, wanted = _in_the_ball(scene, tmp_path)
    assert wanted.max() == pytest.approx(2.0, rel=0.1)
    assert found.max() == pytest.approx(wanted.max(), rel=0.02)
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.05)
