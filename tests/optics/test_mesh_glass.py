# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes: against closed forms, and laws that hold for any mesh."""

import sys

import meshes
import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.optics import facets
from glass_refraction.optics.facets import CLEAR, SHARE
from glass_refraction.optics.placed import shared_media

SQUARE = ((-0.05, -0.04), (0.05, -0.04), (0.05, 0.04), (-0.05, 0.04))


def random_pose(rng, reach=0.0):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.uniform(-reach, reach, 3)
    return pose


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rays_at(rng, box, count, away=0.4):
    eye = np.mean(box, axis=0) + away * unit(rng.normal(size=3))
    return eye, rng.uniform(box[0], box[1], (count, 3)) - eye


def seen(ends, count, depth=True):
    """What rays see of a smooth world: of their exit rays, by direction and place."""
    along = ends.origin + 0.5 * ends.direction
    value = 1.0 + 0.5 * np.sin(3.0 * along @ (1.0, 2.0, -1.0)) + 0.3 * np.cos(4.0 * along[:, 1])
    value = value * ends.weight * (np.exp(-ends.depth[:, 0]) if depth else 1.0)
    return np.bincount(ends.ray, value, count)


def same_ends(one, other, atol=1e-6):
    """The same exit rays of every ray, in any order. By weight, then by direction."""
    assert len(one.ray) == len(other.ray)
    a, b = (
        np.lexsort((np.round(e.direction @ (0.7, 0.5, 0.3), 4), np.round(e.weight, 6), e.ray))
        for e in (one, other)
    )
    np.testing.assert_array_equal(one.ray[a], other.ray[b])
    for name in ("weight", "direction", "origin"):
        np.testing.assert_allclose(getattr(one, name)[a], getattr(other, name)[b], atol=atol)
    # Rays start off faces by some 1e-6 m.
    np.testing.assert_allclose(one.depth[a], other.depth[b], atol=1e-4)


def test_a_box_as_a_mesh_is_the_slab_with_its_sides():
    rng = np.random.default_rng(1)
    body = optics.body(optics.FlatGlass((0.02,), (1.5,), outline=SQUARE))
    pose = random_pose(rng, 0.2)
    mesh = meshes.box((-0.05, -0.04, -0.02), (0.05, 0.04, 0.0)).placed(pose)
    eye, directions = rays_at(rng, mesh.box, 300)
    tint = np.array((5.0, 10.0, 20.0))
    closed = optics.PlacedGlass(body, pose, np.array([0 * tint, tint]))
    meet = meshes.Caster([(0, mesh)])
    found = optics.exit_rays(
        [optics.PlacedMesh(1.5, tint)], eye, directions, meet=meet, min_weight=0.02
    )
    expected = optics.exit_rays([closed], eye, directions, min_weight=0.02)
    same_ends(found, expected)
    np.testing.assert_allclose(np.bincount(found.ray, found.weight, 300) + found.lost, 1.0)
    assert meet.calls == found.steps
    # The eye in the glass: known from the first back that is met.
    middle = pose[:3, :3] @ (0.01, 0.0, -0.008) + pose[:3, 3]
    found = optics.exit_rays(
        [optics.PlacedMesh(1.5, tint)], middle, directions, meet=meet, min_weight=0.02
    )
    expected = optics.exit_rays([closed], middle, directions, min_weight=0.02)
    same_ends(found, expected)


@pytest.mark.parametrize("shape", ["rod", "ball"])
def test_a_mesh_is_nearer_to_the_round_glass_the_finer_it_is(shape):
    rng = np.random.default_rng(2)
    count = 150
    if shape == "rod":
        body = optics.body(optics.CylinderGlass((0.04,), (1.5,), extent=(0.0, 0.1)))
    else:
        body = optics.body(optics.SphereGlass((0.04,), (1.5,)))
    eye, directions = rays_at(rng, 0.6 * body.box, count)
    tint = np.array((8.0, 8.0, 8.0))
    closed = optics.PlacedGlass(body, np.eye(4), np.array([0 * tint, tint]))
    expected = seen(optics.exit_rays([closed], eye, directions, min_weight=0.02), count)
    off, asked = [], []
    for fine in (10, 20, 40):
        mesh = meshes.rod(0.04, 0.0, 0.1, 2 * fine) if shape == "rod" else meshes.ball(0.04, fine)
        meet = meshes.Caster([(0, mesh)])
        ends = optics.exit_rays(
            [optics.PlacedMesh(1.5, tint)], eye, directions, meet=meet, min_weight=0.02
        )
        np.testing.assert_allclose(np.bincount(ends.ray, ends.weight, count) + ends.lost, 1.0)
        off.append(np.median(np.abs(seen(ends, count) - expected)))
        asked.append(meet.rays)
    # Chords lie off the arc by a quarter where there are twice as many.
    assert off[1] < 0.5 * off[0] and off[2] < 0.5 * off[1] and off[2] < 4e-3
    # What is asked for grows with rays and bounces, not with triangles.
    assert max(asked) < 1.3 * min(asked)


def test_a_diamond_loses_no_light():
    rng = np.random.default_rng(3)
    mesh = meshes.diamond(0.01).placed(random_pose(rng, 0.05))
    eye, directions = rays_at(rng, mesh.box, 300, away=0.1)
    lost = []
    for least in (0.05, 0.005):
        ends = optics.exit_rays(
            [optics.PlacedMesh(2.417)],
            eye,
            directions,
            meet=meshes.Caster([(0, mesh)]),
            min_weight=least,
            most_events=100,
        )
        np.testing.assert_allclose(np.bincount(ends.ray, ends.weight, 300) + ends.lost, 1.0)
        lost.append(ends.lost.mean())
    assert lost[1] < 0.5 * lost[0] and lost[0] < 0.05
    # No ray stays in it: they leave through its faces, to the outside.
    ahead = meshes.Caster([(0, mesh)])(ends.origin + 1e-6 * ends.direction, ends.direction)[1]
    assert np.isinf(ahead).all()


@pytest.mark.parametrize("overlap", [0.0, 2e-9, -2e-9, 1e-3])
def test_meshes_that_overlap_or_touch_by_priority(overlap):
    """Two boxes, one on the other: as a stack of two layers."""
    rng = np.random.default_rng(4)
    stack = optics.PlacedGlass(
        optics.body(optics.FlatGlass((0.02, 0.03), (1.5, 1.333), outline=SQUARE)), np.eye(4)
    )
    upper = meshes.box((-0.05, -0.04, -0.02), (0.05, 0.04, 0.0))
    lower = meshes.box((-0.05, -0.04, -0.05), (0.05, 0.04, -0.02 + overlap))
    eye, directions = rays_at(rng, 0.8 * stack.body.box, 200)
    expected = optics.exit_rays([stack], eye, directions, min_weight=0.03)
    glasses = [optics.PlacedMesh(1.5, None, 1), optics.PlacedMesh(1.333, None, 0)]
    meet = meshes.Caster([(0, upper), (1, lower)], apart=True)
    found = optics.exit_rays(glasses, eye, directions, meet=meet, min_weight=0.03)
    same_ends(found, expected)
    # A mesh and a closed form.
    closed = optics.PlacedGlass(
        optics.body(optics.FlatGlass((0.02,), (1.5,), outline=SQUARE)), np.eye(4), None, 1
    )
    meet = meshes.Caster([(1, lower)])
    found = optics.exit_rays([closed, glasses[1]], eye, directions, meet=meet, min_weight=0.03)
    same_ends(found, expected)


def test_what_is_known_of_a_ray_does_not_grow_with_drops():
    """Meshes of one medium that lie apart share what is known of a ray; the rays are the same."""
    rng = np.random.default_rng(6)
    drops = [meshes.box(low, low + 0.06) for low in rng.uniform(-0.2, 0.2, (40, 3))]
    drops = [drop.placed(random_pose(rng)) for drop in drops]
    eye, directions = rays_at(rng, np.array([(-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)]), 150, away=1.0)
    meet = meshes.Caster(list(enumerate(drops)), apart=True)
    results, rows = [], []
    for boxes in ([None] * len(drops), [drop.box for drop in drops]):
        glasses = [optics.PlacedMesh(1.333, (1.0, 2.0, 3.0), box=box) for box in boxes]
        rows.append(len(shared_media(glasses)[1]))
        results.append(optics.exit_rays(glasses, eye, directions, meet=meet, min_weight=0.02))
    assert rows[0] == len(drops)
    assert 1 < rows[1] < len(drops) / 3
    for name in ("ray", "path"):
        np.testing.assert_array_equal(*(getattr(ends, name) for ends in results))
    for name in ("weight", "depth", "origin", "direction", "lost"):
        np.testing.assert_allclose(*(getattr(ends, name) for ends in results), atol=1e-5)
    # What differs in its medium or priority does not share, nor what is no mesh.
    box = drops[0].box
    others = [optics.PlacedMesh(1.333, box=box + 10.0 * k, priority=k % 2) for k in range(4)]
    others += [optics.PlacedMesh(1.5, box=box - 10.0), optics.PlacedMesh(1.5, (0, 0, 1), box=box)]
    closed = optics.PlacedGlass(optics.body(optics.SphereGlass((0.1,), (1.5,))), np.eye(4))
    row, firsts = shared_media([*others, closed, closed])
    assert row.tolist() == [0, 1, 0, 1, 2, 3, 4, 5]
    assert firsts == [*others[:2], *others[4:], closed, closed]


def test_a_mesh_stays_where_boxes_say_it_is():
    rng = np.random.default_rng(5)
    one, two = meshes.ball(0.03, 12), meshes.box((0.1, -0.02, -0.02), (0.14, 0.02, 0.02))
    eye, directions = rays_at(rng, np.array([(-0.1, -0.1, -0.1), (0.2, 0.1, 0.1)]), 300)
    results, asked = [], []
    for boxes in ((None, None), (one.box, two.box)):
        meet = meshes.Caster([(0, one), (1, two)])
        glasses = [optics.PlacedMesh(1.5, box=boxes[0]), optics.PlacedMesh(1.6, box=boxes[1])]
        results.append(optics.exit_rays(glasses, eye, directions, meet=meet, min_weight=0.02))
        asked.append(meet.rays)
    for name in ("ray", "path"):
        np.testing.assert_array_equal(*(getattr(ends, name) for ends in results))
    # Boxes also tell how coarse float32 is there, by which rays start off faces.
    for name in ("weight", "origin", "direction", "lost"):
        np.testing.assert_allclose(*(getattr(ends, name) for ends in results), atol=1e-5)
    assert asked[1] < 0.7 * asked[0]


def test_an_open_mesh_is_glass_behind_its_front_without_end():
    sheet = meshes.Mesh(np.array([(-9.0, -9, 0), (9, -9, 0), (0, 9, 0)]), np.array([(0, 1, 2)]))
    meet = meshes.Caster([(0, sheet)])
    down = unit(np.array([(0.6, 0.0, -0.8)]))
    ends = optics.exit_rays([optics.PlacedMesh(1.5, (1, 1, 1))], (0, 0, 1), down, meet=meet)
    inside = ends.direction[ends.direction[:, 2] < 0.0][0]
    assert inside[0] == pytest.approx(0.6 / 1.5) and len(ends.ray) == 2
    assert np.isfinite(ends.depth).all() and (ends.depth == 0.0).all()
    # From behind it is left.
    up = unit(np.array([(0.3, 0.0, 0.95)]))
    ends = optics.exit_rays([optics.PlacedMesh(1.5)], (0, 0, -1), up, meet=meet)
    outside = ends.direction[ends.direction[:, 2] > 0.0][0]
    assert outside[0] == pytest.approx(1.5 * up[0, 0])


def test_interpolated_normals_reflect_no_ray_into_the_face():
    rng = np.random.default_rng(6)
    count = 20_000
    flat = unit(rng.normal(size=(count, 3))).T
    along = unit(rng.normal(size=(count, 3))).T
    flat = flat * np.where(np.sum(flat * along, axis=0) > 0.0, -1.0, 1.0)
    smooth = unit(flat.T + rng.uniform(0.0, 2.0, (count, 1)) * rng.normal(size=(count, 3))).T
    bent = facets.bent(smooth, flat, along)
    np.testing.assert_allclose(np.linalg.norm(bent, axis=0), 1.0)
    facing = -np.sum(flat * along, axis=0)
    up = np.sum(optics.reflect(along.T, bent.T) * flat.T, axis=1)
    assert (up >= np.minimum(SHARE * facing, CLEAR) - 1e-12).all()
    assert (np.sum(bent * along, axis=0) < 0.0).all()
    # Those that were right are left alone.
    kept = (bent == smooth).all(axis=0)
    assert kept.mean() > 0.3
    np.testing.assert_array_equal(facets.bent(flat, flat, along), flat)


def test_light_refracted_to_the_wrong_side_of_a_face_ends_black():
    """A face whose normals lean by 60°: from within, light is refracted back into it."""
    lean = np.radians(60.0)
    leaning = np.array((np.sin(lean), 0.0, np.cos(lean)))

    def meet(origins, directions):
        count = len(origins)
        way = np.where(directions[:, 2] != 0.0, -origins[:, 2] / directions[:, 2], np.inf)
        way = np.where(way > 1e-6, way, np.inf)
        up = np.tile((0.0, 0.0, 1.0), (count, 1))
        return np.zeros(count, int), way, up, np.tile(leaning, (count, 1))

    # It leaves at 39° to that normal, 99° to the face's.
    tilt = np.radians(85.0)
    along = (np.sin(tilt), 0.0, np.cos(tilt))

    def cast(origins, directions):
        return np.full(len(origins), 1e3), np.zeros(len(origins), int)

    ends = optics.exit_rays(
        [optics.PlacedMesh(1.5)], (0.0, 0.0, -1.0), [along], min_weight=1e-4, meet=meet, cast=cast
    )
    np.testing.assert_allclose(np.bincount(ends.ray, ends.weight) + ends.lost, 1.0)
    black = np.isinf(ends.depth).all(axis=1)
    cosine = np.array(along) @ leaning
    reflectance = optics.fresnel(cosine, 1.5)
    assert ends.weight[black].sum() == pytest.approx(1.0 - reflectance, abs=1e-9)
    assert (ends.distance[black] == np.inf).all()
    # It sees nothing, though something stands there.
    assert (ends.thing == np.where(black, -1, 0)).all()


@pytest.mark.parametrize("tilt", [0.0, 1e-3])
def test_light_that_interpolated_normals_keep_is_told_from_what_is_not_followed(tilt):
    """A light guide without end: off its own normals light comes to where it ends some time."""
    calls = []

    def meet(origins, along):
        calls.append(len(along))
        normal = np.tile((0.0, 0.0, -1.0), (len(along), 1))
        way = np.where(along[:, 2] > 0.0, 1.0, np.inf)
        if len(calls) > 1:
            normal = np.sign(along) * (1.0, 0.0, 0.0)
        return np.zeros(len(along), int), way, normal, normal + np.array((0.0, tilt, 0.0))

    along = np.array([(0.75, 0.0, np.sqrt(1.0 - 0.75**2))])
    ends = optics.exit_rays([optics.PlacedMesh(1.5)], (0.0, 0.0, -1.0), along, meet=meet)
    mirrored = optics.fresnel(along[0, 2], 1.0 / 1.5)
    np.testing.assert_allclose(ends.weight, mirrored, rtol=1e-2)
    np.testing.assert_allclose(ends.lost, 1.0 - mirrored, rtol=1e-3)
    np.testing.assert_array_equal(ends.stuck, ends.lost * (tilt > 0.0))


def test_meshes_need_somebody_who_knows_where_they_are():
    with pytest.raises(ValueError, match="meet must tell"):
        optics.exit_rays([optics.PlacedMesh(1.5)], (0, 0, 0), [(0, 0, 1)])
    with pytest.raises(ValueError, match="ior must be"):
        optics.PlacedMesh(0.0)


def strongest(ends):
    """Directions (M, 3) of the way of each ray that brings most of its light."""
    order = np.lexsort((-ends.weight, ends.ray))
    return ends.direction[order][np.unique(ends.ray[order], return_index=True)[1]]


def test_a_ball_far_from_the_origin_is_the_ball():
    """Float32 is 8 mm coarse there: a closed form does not mind, and a mesh need not."""
    rng = np.random.default_rng(13)
    body = optics.body(optics.SphereGlass((0.04,), (1.5,)))
    mesh, eye = meshes.ball(0.04, 24), np.array((0.2, 0.01, 0.02))
    directions = unit(rng.normal(size=(100, 3)) * (0.0, 0.012, 0.012) - eye)
    found, pose = [], np.eye(4)
    for shift in (0.0, 1e5):
        pose[:3, 3] = shift
        placed = mesh.placed(pose)
        glass = optics.PlacedMesh(1.5, box=placed.box)
        meet = meshes.Caster([(0, placed)])
        found.append(optics.exit_rays([glass], eye + shift, directions, meet=meet))
    exact = strongest(optics.exit_rays([optics.PlacedGlass(body, pose)], eye + 1e5, directions))
    near, far = (np.abs(strongest(ends) - exact).max(axis=1) for ends in found)
    assert max(near.max(), far.max()) < 0.05
    np.testing.assert_allclose(*map(strongest, found), atol=1e-3)


# ---- roughness ----------------------------------------------------------------------------------


def pane(roughness):
    body = optics.body(optics.FlatGlass((0.02,), (1.5,), outline=SQUARE))
    return optics.PlacedGlass(body, np.eye(4), roughness=roughness)


def test_facets_are_those_of_ggx():
    """At normal incidence half of the visible normals are within tan = roughness²."""

    def just_inside(origin, along):
        inside = np.abs(origin[:, 2]) < 1e-9
        return np.where(inside, 1e-4, np.inf), np.where(inside, 0, -1)

    count = 2000
    for roughness in (0.1, 0.2, 0.3):
        ends = optics.exit_rays(
            [pane(roughness)], (0, 0, 0.3), np.tile((0.0, 0, -1), (count, 1)), cast=just_inside
        )
        inside = ends.direction[np.isfinite(ends.distance) & (ends.direction[:, 2] < 0.0)]
        assert len(inside) > 5 * count
        normals = unit(np.array([(0.0, 0, -1)]) - 1.5 * inside)
        tangent = np.hypot(normals[:, 0], normals[:, 1]) / np.abs(normals[:, 2])
        for part in (0.1, 0.3, 0.5, 0.7, 0.9):
            expected = roughness**2 * np.sqrt(part / (1.0 - part))
            assert np.mean(tangent < expected) == pytest.approx(part, abs=0.015)
        # And no side is preferred.
        assert np.abs(normals[:, :2].mean(axis=0)).max() < 0.02


def test_rough_glass_keeps_its_light_and_is_smooth_glass_in_the_limit():
    rng = np.random.default_rng(7)
    body = optics.body(optics.CylinderGlass((0.04, 0.036), (1.5, 1.333), extent=(0.0, 0.1)))
    eye, directions = rays_at(rng, 0.7 * body.box, 300)
    results = []
    for roughness in (0.0, 1e-3, 0.3):
        glass = optics.PlacedGlass(body, np.eye(4), roughness=roughness)
        ends = optics.exit_rays([glass], eye, directions, min_weight=0.01)
        np.testing.assert_allclose(np.bincount(ends.ray, ends.weight, 300) + ends.lost, 1.0)
        results.append(seen(ends, 300))
    smooth, nearly, rough = results
    assert np.median(np.abs(nearly - smooth)) < 1e-4
    assert np.median(np.abs(rough - smooth)) > 1e-2


def test_the_facets_of_a_pixel_are_always_the_same():
    rng = np.random.default_rng(8)
    eye, directions = rays_at(rng, pane(0.3).body.box, 200)
    pixel = rng.permutation(1000)[:200]
    whole = optics.exit_rays([pane(0.3)], eye, directions, pixel=pixel)
    some = np.arange(50, 90)
    part = optics.exit_rays([pane(0.3)], eye, directions[some], pixel=pixel[some])
    rows = np.isin(whole.ray, some)
    for name in ("weight", "direction", "origin", "path"):
        a, b = getattr(whole, name)[rows], getattr(part, name)
        order = (
            np.lexsort((x[:, 0] if x.ndim > 1 else x, r))
            for x, r in ((a, whole.ray[rows]), (b, part.ray))
        )
        one, other = order
        np.testing.assert_array_equal(a[one], b[other])
    # Another pixel has others, and a steeper ray of the same pixel nearly the same.
    other = optics.exit_rays([pane(0.3)], eye, directions, pixel=pixel[::-1].copy())
    assert np.median(np.abs(seen(other, 200) - seen(whole, 200))) > 1e-4
    near = optics.exit_rays([pane(0.3)], eye, directions + 1e-7, pixel=pixel)
    assert np.median(np.abs(seen(near, 200) - seen(whole, 200))) < 1e-5


def test_few_facets_stand_for_many(monkeypatch):
    """The mean over pixels is that of many facets, at both faces."""
    module = sys.modules["glass_refraction.optics.exit_rays"]
    count = 3000
    along = np.tile(unit(np.array([(0.3, 0.1, -1.0)])), (count, 1))
    results = []
    for number_of_facets in (6, 100):
        monkeypatch.setattr(module, "FACETS", number_of_facets)
        number = count if number_of_facets == 6 else 180
        ends = optics.exit_rays([pane(0.4)], (-0.09, -0.03, 0.3), along[:number])
        results.append(seen(ends, number))
    few, many = results
    spread = few.std() / np.sqrt(len(few)) + many.std() / np.sqrt(len(many))
    assert abs(few.mean() - many.mean()) < 4.0 * spread < 0.01
    assert many.std() < 0.5 * few.std()


def test_ways_have_as_many_facets_as_their_light_asks_for():
    """Six get through, two are mirrored and two come back from within; their light is Fresnel's."""
    along = np.tile(unit(np.array([(0.1, 0.05, -1.0)])), (500, 1))
    smooth, rough = (
        optics.exit_rays([pane(value)], (0, 0, 0.3), along, min_weight=0.01)
        for value in (0.0, 0.05)
    )
    for path in np.unique(smooth.path):
        light = smooth.weight[smooth.path == path].mean()
        some = rough.path == path
        assert some.sum() == 500 * np.ceil(6 * np.sqrt(light))
        assert rough.weight[some].sum() == pytest.approx(500 * light, rel=1e-3)


def test_samples_of_a_pixel_share_its_facets_evenly():
    """Sixteen rays of a pixel that know each other see it with less noise than strangers."""
    pixels, samples = 60, 16
    count = pixels * samples
    along = np.tile(unit(np.array([(0.3, 0.1, -1.0)])), (count, 1))
    pixel, sample = np.divmod(np.arange(count), samples)
    noise = []
    for numbers in ({"pixel": pixel, "sample": sample}, {}):
        ends = optics.exit_rays([pane(0.3)], (-0.09, -0.03, 0.3), along, **numbers)
        aside = ends.weight * (ends.direction[:, 0] > along[0, 0])
        light = np.bincount(ends.ray, aside, count)
        noise.append(light.reshape(pixels, samples).mean(axis=1).std())
    assert noise[0] < 0.75 * noise[1]


def test_roughness_and_pixels_that_are_none():
    with pytest.raises(ValueError, match="roughness must be"):
        pane(1.5)
    with pytest.raises(ValueError, match="roughness must be"):
        optics.PlacedMesh(1.5, roughness=float("nan"))
    with pytest.raises(ValueError, match="pixel must be"):
        optics.exit_rays([pane(0.1)], (0, 0, 1), [(0, 0, -1)], pixel=[0.5])
    with pytest.raises(ValueError, match="sample must be"):
        optics.exit_rays([pane(0.1)], (0, 0, 1), [(0, 0, -1)], sample=[1, 2])


def painted(meet, finish):
    """`meet` that tells, too, what surfaces are like: by what `finish` makes of places."""

    def tell(origins, directions):
        glass, way, *normals = meet(origins, directions)
        places = origins + np.where(np.isfinite(way), way, 0.0)[..., None] * directions
        return glass, way, *normals, finish(places)

    return tell


@pytest.mark.parametrize("roughness", [0.0, 0.2])
def test_a_glass_painted_alike_everywhere_is_the_plain_one(roughness):
    rng = np.random.default_rng(8)
    mesh = meshes.ball(0.04, 12)
    eye, directions = rays_at(rng, mesh.box, 200)
    tints = (0.9, 0.5, 0.2), (0.7, 0.8, 1.0)
    plain = optics.PlacedMesh(1.5, roughness=roughness, tints=tints)
    meet = meshes.Caster([(0, mesh)])
    expected = optics.exit_rays([plain], eye, directions, meet=meet, min_weight=0.02)
    row = np.concatenate(([roughness], *tints))
    found = optics.exit_rays(
        [optics.PlacedMesh(1.5, roughness=roughness, is_painted=True)],
        eye,
        directions,
        meet=painted(meet, lambda places: np.broadcast_to(row, (*places.shape[:-1], 7))),
        min_weight=0.02,
    )
    for name in ("ray", "weight", "depth", "origin", "direction", "path", "lost"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_paint_dims_what_passes_it_and_only_that():
    rng = np.random.default_rng(9)
    mesh = meshes.box((-0.05, -0.04, -0.02), (0.05, 0.04, 0.0))
    places = rng.uniform((-0.05, -0.04), (0.05, 0.04), (300, 2))
    eyes = np.column_stack((places, np.full(300, 0.3)))
    down = np.tile((0.0, 0.0, -1.0), (300, 1))

    def upper_right_is_red(places):
        parts = np.ones((*places.shape[:-1], 7))
        parts[..., 0] = 0.0
        parts[(places[..., 0] > 0.01) & (places[..., 2] > -0.01), 2:4] = 0.25, 0.0
        return parts

    bare = meshes.Caster([(0, mesh)])
    meet, glass = painted(bare, upper_right_is_red), optics.PlacedMesh(1.5, is_painted=True)
    with pytest.raises(ValueError, match="painted"):
        optics.exit_rays([glass], eyes, down, meet=bare)
    found = optics.exit_rays([glass], eyes, down, meet=meet, min_weight=1e-3)
    through = np.flatnonzero((found.direction[:, 2] < 0.0) & (found.events == 2))
    assert len(through) == 300
    light = np.exp(-found.depth[through])
    red = places[found.ray[through], 0] > 0.01
    np.testing.assert_allclose(light[~red], 1.0)
    np.testing.assert_allclose(light[red, :2], np.tile((1.0, 0.25), (red.sum(), 1)))
    assert (light[red, 2] < 1e-5).all()
    # Light that goes to and fro in the slab passes the upper face once; it meets it from within.
    mirrored = (found.direction[:, 2] < 0.0) & (found.events == 4)
    red = places[found.ray[mirrored], 0] > 0.01
    np.testing.assert_allclose(np.exp(-found.depth[mirrored][:, 1]), np.where(red, 0.25, 1.0))
    # A pane of closed form below it has no paint, and dims nothing.
    pose = np.eye(4)
    pose[2, 3] = -0.1
    pane = optics.PlacedGlass(optics.body(optics.FlatGlass((0.02,), (1.5,), outline=SQUARE)), pose)
    found = optics.exit_rays([glass, pane], eyes, down, meet=meet, min_weight=1e-3)
    through = np.flatnonzero((found.direction[:, 2] < 0.0) & (found.events == 4))
    through = through[np.argsort(-found.weight[through], kind="stable")[:300]]
    red = places[found.ray[through], 0] > 0.01
    np.testing.assert_allclose(np.exp(-found.depth[through][:, 1]), np.where(red, 0.25, 1.0))
