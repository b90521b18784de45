# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against triangles: Blender's caster against a brute-force one in NumPy."""

import bpy
import numpy as np
import pytest

from glass_refraction.scene.memory import counters
from glass_refraction.scene.rays.caster import THINGS, Caster, fill_cast_collection
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.things import Things


def things_of(points, triangles, owners=("thing",)):
    """A soup of one surface."""
    triangles = np.asarray(triangles, np.int32).reshape(-1, 3)
    surface = np.zeros(len(triangles), np.int32)
    return Things(np.asarray(points, float), triangles, surface, (Look(),), tuple(owners))


def caster_in_a_new_scene():
    """A caster in a scene as the extension makes it."""
    scene = bpy.data.scenes.new("cast")
    collection = bpy.data.collections.new("cast")
    scene.collection.children.link(collection)
    fill_cast_collection(collection)
    _ = scene.view_layers[0].active_layer_collection
    return Caster(scene, THINGS)


def _soup(random, count, centre=(0.0, 0.0, 0.0), scale=1.0):
    middles = random.uniform(-1, 1, (count, 1, 3))
    points = (middles + random.normal(0, 0.15, (count, 3, 3))).reshape(-1, 3) * scale + centre
    return things_of(points, np.arange(3 * count))


def _rays(random, count, centre=(0.0, 0.0, 0.0), scale=1.0):
    origins = random.uniform(-2, 2, (count, 3)) * scale + centre
    aims = random.uniform(-1, 1, (count, 3)) * scale + centre
    directions = aims - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def brute_force(things, origins, directions):
    """Distance and triangle first met (Moeller and Trumbore), all rays against all triangles.

    The third result is the distance, in barycentric units, to the nearest edge of any triangle's
    plane that the ray meets: near 0 rounding decides.
    """
    a, b, c = (things.points[things.triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    p = np.cross(directions[:, None], v)
    determinant = np.einsum("tk,mtk->mt", u, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origins[:, None] - a
        first = np.einsum("mtk,mtk->mt", s, p) / determinant
        q = np.cross(s, u)
        second = np.einsum("mk,mtk->mt", directions, q) / determinant
        distance = np.einsum("tk,mtk->mt", v, q) / determinant
    inner = np.minimum(np.minimum(first, second), 1.0 - first - second)
    ahead = distance > 0.0
    met = ahead & (inner >= 0.0)
    distance = np.where(met, distance, np.inf)
    nearest = distance.argmin(axis=1)
    found = distance[np.arange(len(origins)), nearest]
    edge = np.where(ahead, np.abs(inner), np.inf).min(axis=1)
    return found, np.where(np.isfinite(found), nearest, -1), edge


@pytest.mark.parametrize(
    ("centre", "scale"),
    [((0, 0, 0), 1.0), ((3e4, -2e4, 1e4), 1.0), ((0, 0, 0), 1e-5), ((5, 5, 5), 1e6)],
    ids=["plain", "far away", "tiny", "huge"],
)
def test_casts_meet_what_a_brute_force_tracer_meets(centre, scale):
    random = np.random.default_rng(3)
    things = _soup(random, 60, centre, scale)
    origins, directions = _rays(random, 500, centre, scale)
    caster = caster_in_a_new_scene()
    caster.aim(things, np.array(centre, float), scale)
    distance, triangle = caster.cast(origins, directions)
    expected, number, edge = brute_force(things, origins, directions)
    clear = edge > 1e-4
    assert 0.1 < (number >= 0).mean() < 0.9
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(triangle[clear], number[clear])
    hit = clear & (number >= 0)
    np.testing.assert_allclose(distance[hit], expected[hit], rtol=1e-4, atol=2e-5 * scale)
    assert np.all(np.isinf(distance[triangle < 0]))


def test_numbers_of_triangles_stay_exact_beyond_a_float_with_few_digits():
    """A cast hands the numbers over as float32, which counts up to 2**24."""
    side = 400
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
    points = np.stack((x.ravel(), y.ravel(), 0.0 * x.ravel()), axis=1)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    triangles = np.concatenate(
        [np.stack((corner, corner + 1, corner + side + 2), 1),
         np.stack((corner, corner + side + 2, corner + side + 1), 1)]
    )  # fmt: skip
    caster = caster_in_a_new_scene()
    caster.aim(things_of(points, triangles), np.zeros(3), 1.0)
    wanted = np.random.default_rng(0).integers(0, len(triangles), 300)
    middles = points[triangles[wanted]].mean(axis=1)
    down = np.broadcast_to((0.0, 0.0, -1.0), middles.shape)
    _, triangle = caster.cast(middles - down, down)
    np.testing.assert_array_equal(triangle, wanted)


def test_nothing_to_meet_and_no_rays():
    caster = caster_in_a_new_scene()
    rays = np.zeros((2, 3)), np.tile((0.0, 0.0, 1.0), (2, 1))
    nothing = np.full(2, np.inf), np.full(2, -1)
    for found in (caster.cast(*rays),):
        np.testing.assert_array_equal(found, nothing)
    caster.aim(things_of(np.empty((0, 3)), []), np.zeros(3), 1.0)
    np.testing.assert_array_equal(caster.cast(*rays), nothing)
    caster.aim(things_of([(0, 0, 1), (1, 0, 1), (0, 1, 1)], [0, 1, 2]), np.zeros(3), 1.0)
    distance, triangle = caster.cast(np.empty((0, 3)), np.empty((0, 3)))
    assert distance.shape == triangle.shape == (0,)


def test_the_target_is_made_again_only_where_it_differs():
    random = np.random.default_rng(1)
    caster, things = caster_in_a_new_scene(), _soup(random, 20)
    same = Things(things.points.copy(), things.triangles.copy(), *list(vars(things).values())[2:])
    before = counters["targets"]
    caster.aim(things, np.zeros(3), 1.0)
    caster.aim(things, np.zeros(3), 1.0)
    caster.aim(same, np.zeros(3), 1.0)
    assert counters["targets"] == before + 1
    moved = Things(things.points + 1e-3, *list(vars(things).values())[1:])
    caster.aim(moved, np.zeros(3), 1.0)
    assert counters["targets"] == before + 2
    origins, directions = _rays(random, 200)
    distance, triangle = caster.cast(origins, directions)
    expected, number, edge = brute_force(moved, origins, directions)
    clear = edge > 1e-4
    np.testing.assert_array_equal(triangle[clear], number[clear])
    hit = clear & (number >= 0)
    np.testing.assert_allclose(distance[hit], expected[hit], atol=1e-5)


def test_casts_of_other_sizes_follow_one_another():
    random = np.random.default_rng(5)
    caster, things = caster_in_a_new_scene(), _soup(random, 30)
    caster.aim(things, np.zeros(3), 1.0)
    for count in (7, 500, 1, 500, 33):
        origins, directions = _rays(random, count)
        _, number, edge = brute_force(things, origins, directions)
        _, triangle = caster.cast(origins, directions)
        clear = edge > 1e-4
        np.testing.assert_array_equal(triangle[clear], number[clear])
