# SPDX-License-Identifier: GPL-3.0-or-later
"""Interfaces of glasses that overlap: areas and volumes of boxes, of which the sums are known."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import glass_refraction.reference.interfaces as module  # noqa: E402
from glass_refraction.optics import SphereGlass  # noqa: E402
from glass_refraction.reference.interfaces import interfaces, near_shells, overlapping  # noqa: E402
from glass_refraction.scene.read.glasses import Glass  # noqa: E402
from glass_refraction.scene.read.mesh_glasses import MeshGlass  # noqa: E402

GLASS, WATER = 1.5, 1.333
CLEAR = ((0.0, 0.0, 0.0),) * 2


def box(low, high, ior, name, priority=0, tint=(0.0, 0.0, 0.0)):
    """A mesh of twelve triangles, its faces outwards."""
    low, high = np.array(low, float), np.array(high, float)
    points, normals = [], []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        corners = np.tile(0.5 * (low + high), (4, 1))
        corners[:, axis] = (low, high)[sign > 0][axis]
        corners[:, u] = [low[u], high[u], high[u], low[u]]
        corners[:, v] = [low[v], low[v], high[v], high[v]]
        corners = corners[::sign]
        normal = np.zeros(3)
        normal[axis] = sign
        points += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
        normals += [np.tile(normal, (3, 1))] * 2
    mesh = MeshGlass(np.array(points), np.array(normals), ior)
    return Glass(name, mesh, np.eye(4), (CLEAR[0], tint), priority=priority)


def area(points):
    """Area vectors (P, 3) of triangles."""
    return 0.5 * np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])


def areas(found):
    """(glass, ior behind over ior before) -> area."""
    sizes = np.linalg.norm(area(found.points), axis=1)
    kinds = {}
    for glass, ior, size in zip(found.glass.tolist(), found.ior, sizes, strict=True):
        key = glass, round(float(ior), 6)
        kinds[key] = kinds.get(key, 0.0) + size
    return kinds


def volume(found, which):
    """Of what is within some of the triangles, by Gauss's law."""
    return (area(found.points[which]) * found.points[which].mean(axis=1)).sum() / 3.0


APART = (0.013, -0.021, 0.17)


@pytest.mark.parametrize("first", [GLASS, WATER])
def test_boxes_that_overlap_have_each_border_once(first):
    """Of 1 m and moved by half: the common part is a box too, and its faces are of the higher."""
    move = np.array((0.5, 0.4, 0.3))
    glass = box(APART, np.add(APART, 1.0), GLASS, "glass", priority=int(first == GLASS))
    water = box(APART + move, APART + move + 1.0, WATER, "water", priority=int(first == WATER))
    found = interfaces(near_shells([glass, water]))
    x, y, z = 1.0 - move
    within = x * y + y * z + z * x
    high, low = (GLASS, WATER) if first == GLASS else (WATER, GLASS)
    owner = int(first == WATER)
    expected = {
        (owner, round(high, 6)): 6.0 - within,
        (owner, round(high / low, 6)): within,
        (1 - owner, round(low, 6)): 6.0 - within,
    }
    assert areas(found) == pytest.approx(expected, rel=1e-5)
    # The pieces of each glass close, with those of the higher one that bound the lower.
    between = np.isclose(found.ior, high / low)
    of_low = found.glass == 1 - owner
    flow = area(found.points)
    np.testing.assert_allclose(flow[~of_low].sum(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(flow[of_low].sum(axis=0), flow[between].sum(axis=0), atol=1e-6)
    assert volume(found, ~of_low) == pytest.approx(1.0, rel=1e-5)
    left = volume(found, of_low) - volume(found, between)
    assert left == pytest.approx(1.0 - x * y * z, rel=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=2), 1.0)


@pytest.mark.parametrize("turn", [0.0, 0.3])
@pytest.mark.parametrize("overlap", [0.0, 2e-5, 0.01])
def test_water_that_touches_its_glass_or_runs_into_it_a_little_has_one_border(overlap, turn):
    glass = turned(box((0, 0, 0), (1, 1, 1), GLASS, "glass", priority=1), turn)
    water = turned(box((0.2, 0.2, 1 - overlap), (0.7, 0.7, 2), WATER, "water"), turn)
    assert overlapping(near_shells([glass, water])) == {"glass", "water"}
    # What lies nearer than the skin counts as touching.
    found = areas(interfaces(near_shells([glass, water])))
    assert found.pop((0, round(GLASS / WATER, 6))) == pytest.approx(0.25, abs=1e-4)
    assert found.pop((0, GLASS)) == pytest.approx(5.75, abs=1e-4)
    assert found.pop((1, WATER)) == pytest.approx(2.25, abs=1e-4)
    assert not found


def turned(glass, angle):
    """A mesh glass turned about z and shifted, in float32 as Blender has its places."""
    turn = np.eye(3)
    turn[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
    mesh = glass.description
    points = (mesh.points @ turn.T + APART).astype(np.float32).astype(float)
    return replace(glass, description=replace(mesh, points=points, normals=mesh.normals @ turn.T))


@pytest.mark.parametrize("order", [1, -1])
def test_of_equal_priorities_the_inner_glass_is_seen(order):
    tint = (1.0, 2.0, 3.0)
    pose = np.eye(4)
    pose[:3, 3] = (0.5, 0.5, 0.5)
    tank = box((0, 0, 0), (1, 1, 1), WATER, "tank", tint=tint)
    ball = Glass("ball", SphereGlass((0.2,), (1.7,)), pose, CLEAR)
    glasses = [tank, ball][::order]
    assert overlapping(near_shells(glasses)) == {"tank", "ball"}
    found = interfaces(near_shells(glasses))
    sizes = areas(found)
    marble = glasses.index(ball)
    assert sizes[(1 - marble, WATER)] == pytest.approx(6.0)
    assert sizes[(marble, round(1.7 / WATER, 6))] == pytest.approx(4 * np.pi * 0.04, rel=1e-3)
    np.testing.assert_array_equal(
        found.absorption[found.glass == marble, 0], [tint] * sum(found.glass == marble)
    )
    assert not found.absorption[found.glass == marble, 1].any()


def test_what_is_hidden_in_a_higher_priority_is_left_out():
    tank = box((0, 0, 0), (1, 1, 1), WATER, "tank", priority=1)
    found = interfaces(near_shells([tank, box((0.3,) * 3, (0.6,) * 3, GLASS, "hidden")]))
    assert areas(found) == pytest.approx({(0, WATER): 6.0})


def test_glasses_apart_do_not_overlap_even_if_their_boxes_do():
    pose = np.eye(4)
    pose[:3, 3] = 0.9
    near = Glass("near", SphereGlass((0.5,), (1.5,)), pose, CLEAR)
    far = Glass("far", SphereGlass((1.0,), (1.5,)), np.eye(4), CLEAR)
    assert overlapping(near_shells([near, far])) == frozenset()
    pose = np.eye(4)
    pose[:3, 3] = 0.8
    nearer = Glass("nearer", near.description, pose, CLEAR)
    assert overlapping(near_shells([nearer, far])) == {"nearer", "far"}


def tube(middle, name, facets=200):
    """A mesh of slivers: an upright tube without ends, its faces outwards."""
    angle = 2.0 * np.pi * np.arange(facets) / facets
    ring = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    low, high = (np.add(ring, (middle, 0.0, z)) for z in (0.0, 5.0))
    after = np.roll(np.arange(facets), -1)
    points = np.concatenate(
        [np.stack((low, low[after], high), 1), np.stack((high, low[after], high[after]), 1)]
    )
    normals = np.repeat(np.tile(ring, (2, 1))[:, None], 3, axis=1)
    return Glass(name, MeshGlass(points, normals, GLASS), np.eye(4), CLEAR)


def test_only_triangles_that_may_cut_each_other_are_cut(monkeypatch):
    """Boxes of slivers touch those of many more: glasses of such once took minutes."""
    cut = []
    through = module._through
    monkeypatch.setattr(
        module, "_through", lambda begin, *rest: cut.append(len(begin)) or through(begin, *rest)
    )
    shells = near_shells([tube(0.0, "one"), tube(0.02, "other")])
    pairs, edges = len(module._near(*shells)), 6
    assert sum(map(len, module._cuts(*shells)[0])) > 0
    assert sum(cut) < edges * pairs / 4
