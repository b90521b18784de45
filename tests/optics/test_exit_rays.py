# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through any number of glasses: laws, and an oracle that knows shapes but no state."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest
from ways import ways

from glass_refraction import optics
from glass_refraction.optics import solver
from glass_refraction.optics.bodies import Ball
from glass_refraction.optics.exit_rays import MIRRORED, PLAIN, STRONG, _interface_code, _path_on
from glass_refraction.optics.facets import ENDLESS

SQUARE = ((-0.06, -0.06), (0.06, -0.06), (0.06, 0.06), (-0.06, 0.06))
BODIES = {
    "tube": optics.body(optics.CylinderGlass((0.04, 0.036), (1.5, 1.0), extent=(0.0, 0.12))),
    "filled": optics.body(optics.CylinderGlass((0.04, 0.036), (1.5, 1.333), extent=(0.0, 0.12))),
    "slab": optics.body(optics.FlatGlass((0.02, 0.01), (1.5, 1.7), outline=SQUARE)),
    "ball": optics.body(optics.SphereGlass((0.05, 0.045), (1.5, 1.2))),
    "tumbler": optics.Tumbler(0.036, 0.0025, 0.11, 0.007, level=0.065),
    "bowl": optics.RevolutionGlass(
        ((0.0, 0.0), (0.03, 0.005), (0.04, 0.06)),
        ((0.0, 0.004), (0.027, 0.009), (0.038, 0.06)),
        level=0.03,
    ),
}


def random_pose(rng, reach=0.0):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.uniform(-reach, reach, 3)
    return pose


def moved(x=0.0, y=0.0, z=0.0):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rays_at(rng, box, count, away=0.4):
    """An eye and directions to places in a box."""
    eye = np.mean(box, axis=0) + away * unit(rng.normal(size=3))
    return eye, rng.uniform(box[0], box[1], (count, 3)) - eye


def sums(ends, count):
    return np.bincount(ends.ray, ends.weight, count) + ends.lost


def same_rays(one, other, at, atol=1e-9, paths=False, weight=1e-9):
    """Both results hold the same exit rays, whatever the order of a ray's rows. `at`: a plane far
    away through which places are compared, so that origins may lie differently on a line."""
    assert len(one.ray) == len(other.ray)
    keys = []
    for ends in (one, other):
        first = ends.path if paths else np.round(ends.direction @ (0.7, 0.5, 0.3), 7)
        keys.append(np.lexsort((first, np.round(ends.weight, 9), ends.ray)))
    a, b = keys
    np.testing.assert_array_equal(one.ray[a], other.ray[b])
    np.testing.assert_allclose(one.weight[a], other.weight[b], atol=weight)
    np.testing.assert_allclose(one.direction[a], other.direction[b], atol=atol)
    np.testing.assert_allclose(one.depth[a], other.depth[b], atol=1e-6, rtol=1e-6)
    lines = []
    for ends, order in ((one, a), (other, b)):
        origin, along = ends.origin[order], ends.direction[order]
        lines.append(origin - np.sum((origin - at) * along, axis=1)[:, None] * along)
    np.testing.assert_allclose(*lines, atol=atol)


# ---- one glass ----------------------------------------------------------------------------------


def test_surfaces_that_only_refract_end_a_ray_where_it_would_be_reflected_totally():
    """Steep rays in a rod go round in it for ever: they are black at once, and nothing is lost."""
    body = optics.body(optics.CylinderGlass((0.02,), (2.4,), extent=(0.0, 0.1)))
    rng = np.random.default_rng(5)
    place = np.array((0.0, 0.0, 0.05)) + rng.uniform(-0.01, 0.01, (500, 3))
    ends = optics.exit_rays(
        [optics.PlacedGlass(body, np.eye(4))], place, rng.normal(size=(500, 3)), fresnel=False
    )
    black = np.isinf(ends.depth).all(axis=1)
    assert 0.3 < black.mean() < 1.0
    assert (ends.events == 1).all() and not ends.lost.any()
    np.testing.assert_array_equal(black, ends.path & 1 == 1)


@pytest.mark.parametrize("name", BODIES)
def test_exit_rays_of_one_glass_are_its_light_paths(name):
    body, rng = BODIES[name], np.random.default_rng(3)
    count = 60 if name == "bowl" else 400
    eye, directions = rays_at(rng, body.box, count)
    pose = random_pose(rng, 0.5)
    absorption = rng.uniform(0.0, 20.0, (len(body.media), 3))
    absorption[0] = 0.0
    ends = optics.exit_rays(
        [optics.PlacedGlass(body, pose, absorption)],
        pose[:3, :3] @ eye + pose[:3, 3],
        directions @ pose[:3, :3].T,
        min_weight=0.02,
        most_events=ENDLESS - 1,
    )
    expected = ways(body, eye, directions, min_weight=0.02)
    numbers = {part.name: number for number, part in enumerate(body.interfaces)}
    paths = []
    for path in expected.paths:
        code = np.zeros(1, dtype=np.uint64)
        for interface, event in zip(path.interfaces, path.events, strict=True):
            number = _interface_code(np.array([0]), np.array([numbers[interface]]))
            code = _path_on(code, number + (event == "R"))
            code |= MIRRORED * np.uint64(event == "R")
        paths.append(code.view(np.int64)[0])
    path = np.array(paths)[expected.path]
    assert len(np.unique(paths)) == len(expected.paths)
    assert [bool(p & 1) for p in paths] == ["R" in part.events for part in expected.paths]
    assert len(ends.ray) == len(expected.ray)
    a, b = np.lexsort((ends.path, ends.ray)), np.lexsort((path, expected.ray))
    np.testing.assert_array_equal(ends.ray[a], expected.ray[b])
    np.testing.assert_array_equal(ends.path[a], path[b])
    np.testing.assert_allclose(ends.weight[a], expected.weight[b], atol=1e-12)
    turn, middle = pose[:3, :3], pose[:3, 3]
    np.testing.assert_allclose(ends.origin[a], expected.origin[b] @ turn.T + middle, atol=1e-10)
    np.testing.assert_allclose(ends.direction[a], expected.direction[b] @ turn.T, atol=1e-9)
    depth = expected.lengths @ absorption
    np.testing.assert_allclose(ends.depth[a], depth[b], rtol=1e-9, atol=1e-12)
    assert np.isinf(ends.distance).all()


@pytest.mark.parametrize("name", BODIES)
def test_no_light_is_made_and_what_is_not_followed_is_told(name):
    body, rng = BODIES[name], np.random.default_rng(4)
    eye, directions = rays_at(rng, body.box, 100)
    lost = []
    for least in (0.1, 0.01, 0.001):
        ends = optics.exit_rays(
            [optics.PlacedGlass(body, np.eye(4))], eye, directions, min_weight=least
        )
        np.testing.assert_allclose(sums(ends, 100), 1.0, atol=1e-12)
        assert (ends.weight > 0.0).all()
        lost.append(ends.lost.mean())
    # A white world is seen the whiter the more ways are followed.
    assert lost[0] > lost[1] > lost[2] and lost[2] < 0.02


def test_light_that_runs_round_too_often_is_lost():
    glass = optics.PlacedGlass(BODIES["tube"], np.eye(4))
    rng = np.random.default_rng(5)
    eye, directions = rays_at(rng, BODIES["tube"].box, 200)
    for most in (0, 1, 3):
        ends = optics.exit_rays([glass], eye, directions, min_weight=1e-6, most_events=most)
        assert ends.events.max(initial=0) <= most
        np.testing.assert_allclose(sums(ends, 200), 1.0, atol=1e-12)


def test_strong_light_is_followed_however_long_its_way_is():
    """A quarter of a pixel's light came out of a pane's edge after 33 events, and was lost."""
    body = optics.body(optics.FlatGlass((0.004,), (1.5,), outline=SQUARE))
    glass = optics.PlacedGlass(body, np.eye(4))
    # Into an edge, and from side to side of the pane to the next.
    eye, edge = np.array((0.1, 0.02, 0.3)), np.random.default_rng(8).uniform(size=(4000, 3))
    directions = np.array((0.06, -0.06, -0.004)) + edge * (0.0, 0.12, 0.004) - eye
    few = optics.exit_rays([glass], eye, directions, min_weight=0.05)
    many = optics.exit_rays([glass], eye, directions, min_weight=0.001)
    strong = [np.flatnonzero(ends.weight > STRONG) for ends in (few, many)]
    same = [
        set(zip(ends.ray[some].tolist(), ends.path[some].tolist(), strict=True))
        for ends, some in zip((few, many), strong, strict=True)
    ]
    assert same[0] == same[1]
    assert many.events[strong[1]].max() > 3 * PLAIN


def test_strong_light_comes_out_after_many_total_reflections():
    """Light that ran up a bottle's wall was dark after 64: a row of dark pixels at its foot."""
    pane = optics.body(optics.FlatGlass((0.001,), (1.5,), outline=SQUARE))
    # In at one edge, at 60 degrees, and out at the one across: a reflection each 1.4 mm.
    along = np.array((0.5, 0.0, np.sqrt(0.75)))
    eye = (-0.06, 0.0, -0.0005) - 0.01 * along
    ends = optics.exit_rays([optics.PlacedGlass(pane, np.eye(4))], eye, [along])
    leaves = np.argmax(ends.events)
    assert 80 < ends.events[leaves] < 90 and np.isclose(ends.origin[leaves, 0], 0.06)
    once = 1.0 - optics.fresnel(0.5, 1.0 / 1.5)
    np.testing.assert_allclose(ends.weight[leaves], once**2)
    np.testing.assert_allclose(ends.stuck, 0.0)


@pytest.mark.parametrize("tilt", [35.0, 45.0])
def test_light_that_began_in_a_block_and_never_leaves_it_is_told(tilt):
    """At 45 degrees to two pairs of faces all reflections are total; at 35 one pair's are not."""
    block = optics.body(optics.FlatGlass((0.05,), (1.5,), outline=SQUARE))
    angle = np.radians(tilt)
    along = [(np.sin(angle), 0.0, np.cos(angle))]
    ends = optics.exit_rays([optics.PlacedGlass(block, np.eye(4))], (0.01, 0.0, -0.02), along)
    np.testing.assert_allclose(sums(ends, 1), 1.0)
    assert ends.stuck[0] == (tilt == 45.0)


def test_glass_of_the_surroundings_ior_is_not_there():
    body = optics.Tumbler(0.036, 0.0025, 0.11, 0.007, 1.0, 1.0, level=0.065)
    rng = np.random.default_rng(6)
    eye, directions = rays_at(rng, body.box, 300)
    ends = optics.exit_rays([optics.PlacedGlass(body, random_pose(rng))], eye, directions)
    np.testing.assert_array_equal(ends.ray, np.arange(300))
    np.testing.assert_allclose(ends.weight, 1.0, atol=1e-12)
    np.testing.assert_allclose(ends.direction, unit(directions), atol=1e-12)


def test_surfaces_that_only_refract_split_nothing():
    rng = np.random.default_rng(7)
    body = BODIES["tumbler"]
    eye, directions = rays_at(rng, body.box, 300)
    ends = optics.exit_rays([optics.PlacedGlass(body, np.eye(4))], eye, directions, fresnel=False)
    assert set(ends.weight) == {1.0}
    assert np.bincount(ends.ray).max() == 1
    np.testing.assert_array_equal(np.bincount(ends.ray, minlength=300) + ends.lost, 1.0)
    # Where nothing is totally reflected these are the ways without reflections.
    plain = ways(body, eye, directions, fresnel=False)
    rows = np.searchsorted(ends.ray, plain.ray)
    np.testing.assert_allclose(ends.direction[rows], plain.direction, atol=1e-9)
    assert len(ends.ray) > len(plain.ray)


@pytest.mark.parametrize("name", ["filled", "slab", "ball", "tumbler", "bowl"])
def test_light_takes_the_same_way_back(name):
    rng = np.random.default_rng(8)
    body = BODIES[name]
    glass = optics.PlacedGlass(body, random_pose(rng, 0.1))
    box = glass.pose[:3, 3] + 0.03 * np.array([(-1.0, -1, -1), (1, 1, 1)])
    eye, directions = rays_at(rng, box, 60)
    there = optics.exit_rays([glass], eye, directions, min_weight=0.03)
    some = np.flatnonzero(there.events > 0)
    start = there.origin[some] + 0.3 * there.direction[some]
    back = optics.exit_rays([glass], start, -there.direction[some], min_weight=0.01)
    towards = -unit(directions)[there.ray[some]]
    found = np.zeros(len(some), dtype=bool)
    same = np.abs(back.direction - towards[back.ray]).max(axis=1) < 1e-6
    same &= np.abs(back.weight - there.weight[some][back.ray]) < 1e-7
    passes = eye - back.origin
    off = passes - np.sum(passes * back.direction, axis=1)[:, None] * back.direction
    same &= np.linalg.norm(off, axis=1) < 1e-6
    found[back.ray[same]] = True
    assert found.mean() > 0.98


def test_snells_law_by_cross_products():
    """The parts of n·d along the surface are the same before and behind, in whatever media."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        radius, ior, around = rng.uniform(0.01, 2.0), rng.uniform(1.0, 2.5), rng.uniform(1.0, 1.5)
        middle = rng.uniform(-1.0, 1.0, 3)
        body = optics.body(optics.SphereGlass((radius,), (ior,), around))
        eye = middle + radius * rng.uniform(1.2, 5.0) * unit(rng.normal(size=3))
        directions = middle + 0.7 * radius * unit(rng.normal(size=(50, 3))) - eye

        def just_inside(origin, along, middle=middle, radius=radius):
            inside = np.abs(np.linalg.norm(origin - middle, axis=1) - radius) < 1e-9 * radius
            inside &= np.sum((origin - middle) * along, axis=1) < 0.0
            return np.where(inside, 1e-3 * radius, np.inf), np.where(inside, 0, -1)

        ends = optics.exit_rays(
            [optics.PlacedGlass(body, moved(*middle))],
            eye,
            directions,
            cast=just_inside,
            min_weight=0.0,
        )
        through = np.isfinite(ends.distance)
        assert through.sum() > 20
        normal = (ends.origin[through] - middle) / radius
        before = around * np.cross(unit(directions)[ends.ray[through]], normal)
        behind = ior * np.cross(ends.direction[through], normal)
        np.testing.assert_allclose(before, behind, atol=1e-12)


# ---- several glasses ----------------------------------------------------------------------------


def nested_balls(priorities):
    outer = optics.body(optics.SphereGlass((0.05,), (1.333,)))
    inner = optics.body(optics.SphereGlass((0.03,), (1.6,)))
    pose = moved(0.1, -0.2, 0.3)
    coefficients = np.array([(0.0, 0, 0), (3.0, 2, 1)]), np.array([(0.0, 0, 0), (10.0, 20, 30)])
    return [
        optics.PlacedGlass(body, pose, part, priority)
        for body, part, priority in zip((outer, inner), coefficients, priorities, strict=True)
    ]


def test_a_ball_in_a_ball_is_one_glass_of_two_layers():
    rng = np.random.default_rng(10)
    whole = optics.body(optics.SphereGlass((0.05, 0.03), (1.333, 1.6)))
    layers = np.array([(0.0, 0, 0), (3.0, 2, 1), (10.0, 20, 30)])
    glass = optics.PlacedGlass(whole, moved(0.1, -0.2, 0.3), layers)
    eye, directions = rays_at(rng, whole.box + glass.pose[:3, 3], 300)
    expected = optics.exit_rays([glass], eye, directions, min_weight=0.01)
    pair = nested_balls((0, 1))
    for glasses in (pair, pair[::-1]):
        found = optics.exit_rays(glasses, eye, directions, min_weight=0.01)
        same_rays(found, expected, eye)
    # The eye may be in it: in the outer, in the inner.
    for away in (0.04, 0.01):
        eye = glass.pose[:3, 3] + (away, 0.0, 0.0)
        expected = optics.exit_rays([glass], eye, directions, min_weight=0.01)
        same_rays(optics.exit_rays(pair, eye, directions, min_weight=0.01), expected, eye)


def test_of_equal_priorities_the_one_entered_first_holds():
    rng = np.random.default_rng(11)
    outer = nested_balls((0, 0))[:1]
    eye, directions = rays_at(rng, outer[0].body.box + outer[0].pose[:3, 3], 200)
    expected = optics.exit_rays(outer, eye, directions, min_weight=0.01)
    pair = nested_balls((0, 0))
    for glasses in (pair, pair[::-1], nested_balls((1, 0))):
        same_rays(optics.exit_rays(glasses, eye, directions, min_weight=0.01), expected, eye)


def water_and_cup(radius, low, high):
    """An empty cup and a cylinder of water, and the cup that is filled to the same level."""
    empty = optics.Tumbler(0.036, 0.0025, 0.11, 0.007)
    filled = optics.Tumbler(0.036, 0.0025, 0.11, 0.007, level=0.065)
    water = optics.body(optics.CylinderGlass((radius,), (1.333,), extent=(low, high)))
    tint = np.array([(0.0, 0, 0), (5.0, 0, 1)])
    drink = np.array([(0.0, 0, 0), (0.0, 9, 30)])
    pose = moved(0.0, 0.1, 1.0)
    both = np.concatenate([tint, drink[1:]])
    return (
        [optics.PlacedGlass(empty, pose, tint, 1), optics.PlacedGlass(water, pose, drink, 0)],
        optics.PlacedGlass(filled, pose, both),
    )


@pytest.mark.parametrize("overlap", [0.0, 1e-5, 1e-3])
def test_water_that_overlaps_or_touches_its_cup_fills_it(overlap):
    rng = np.random.default_rng(12)
    inner, floor, level = 0.036 - 0.0025, 0.007, 0.007 + 0.065
    parts, filled = water_and_cup(inner + overlap, floor - overlap, level)
    eye, directions = rays_at(rng, filled.body.box + filled.pose[:3, 3], 400)
    expected = optics.exit_rays([filled], eye, directions, min_weight=0.02, most_events=30)
    for glasses in (parts, parts[::-1]):
        found = optics.exit_rays(glasses, eye, directions, min_weight=0.02, most_events=30)
        same_rays(found, expected, eye, atol=1e-6, weight=1e-7)


def test_water_in_a_closed_hollow_ball_fills_it():
    rng = np.random.default_rng(20)
    pose = moved(0.2, 0.0, 0.1)
    full = optics.PlacedGlass(optics.body(optics.SphereGlass((0.05, 0.047), (1.5, 1.333))), pose)
    eye, directions = rays_at(rng, full.body.box + pose[:3, 3], 300)
    expected = optics.exit_rays([full], eye, directions, min_weight=0.02)
    shell = optics.body(optics.SphereGlass((0.05, 0.047), (1.5, 1.0)))
    for radius in (0.047, 0.0485):
        water = optics.body(optics.SphereGlass((radius,), (1.333,)))
        glasses = [optics.PlacedGlass(water, pose), optics.PlacedGlass(shell, pose, None, 1)]
        found = optics.exit_rays(glasses, eye, directions, min_weight=0.02)
        same_rays(found, expected, eye, atol=1e-7, weight=1e-7)


def test_a_bubble_of_higher_priority_is_a_hole():
    rng = np.random.default_rng(21)
    hollow = optics.PlacedGlass(
        optics.body(optics.SphereGlass((0.05, 0.02), (1.5, 1.0))), np.eye(4)
    )
    eye, directions = rays_at(rng, hollow.body.box, 300)
    expected = optics.exit_rays([hollow], eye, directions, min_weight=0.02)
    ball = optics.PlacedGlass(optics.body(optics.SphereGlass((0.05,), (1.5,))), np.eye(4))
    bubble = optics.PlacedGlass(Ball(optics.SphereGlass((0.02,), (1.0,))), np.eye(4), None, 1)
    for glasses in ([ball, bubble], [bubble, ball]):
        found = optics.exit_rays(glasses, eye, directions, min_weight=0.02)
        same_rays(found, expected, eye)


def test_thin_gaps_are_gaps():
    """Two panes with air between reflect totally at it; panes that touch are one."""
    pane = optics.body(optics.FlatGlass((0.01,), (1.5,), outline=SQUARE))
    thick = optics.PlacedGlass(
        optics.body(optics.FlatGlass((0.02,), (1.5,), outline=SQUARE)), np.eye(4)
    )
    rng = np.random.default_rng(13)
    eye, directions = rays_at(rng, 0.5 * thick.body.box, 200)
    expected = optics.exit_rays([thick], eye, directions, min_weight=0.02)

    def stacked(gap):
        glasses = [
            optics.PlacedGlass(pane, np.eye(4)),
            optics.PlacedGlass(pane, moved(z=-0.01 - gap)),
        ]
        return optics.exit_rays(glasses, eye, directions, min_weight=0.02)

    for gap in (0.0, 1e-9, -1e-9):
        same_rays(stacked(gap), expected, eye, atol=1e-7, weight=1e-7)
    from_inside = np.array([(0.0, 0.0, -0.005)]), unit(np.array([(1.0, 0.0, -1.0)]))
    for gap in (1e-5, 1e-4):
        glasses = [
            optics.PlacedGlass(pane, np.eye(4)),
            optics.PlacedGlass(pane, moved(z=-0.01 - gap)),
        ]
        ends = optics.exit_rays(glasses, *from_inside, min_weight=0.02)
        assert (ends.origin[:, 2] > -0.01 - 1e-9).all()


def test_cost_grows_with_the_rays_that_meet_glasses_not_with_glasses(monkeypatch):
    """Interfaces are looked for where a ray passes the ball round their glass, and nowhere else."""
    module = sys.modules["glass_refraction.optics.exit_rays"]
    nearest, asked = module.nearest, []

    def counted(body, medium, rays):
        asked.append(len(rays.place[0]))
        return nearest(body, medium, rays)

    monkeypatch.setattr(module, "nearest", counted)
    rng = np.random.default_rng(22)
    body, eye = BODIES["tumbler"], np.array([0.0, -0.5, 0.3])
    first = optics.PlacedGlass(body, np.eye(4))
    directions = rng.uniform(*body.box, (400, 3)) - eye
    optics.exit_rays([first], eye, directions, min_weight=0.02)
    alone = sum(asked)
    asked.clear()
    # Eleven more, where hardly any ray comes.
    others = [optics.PlacedGlass(body, moved(5.0 + k, 3.0, 9.0)) for k in range(11)]
    optics.exit_rays([first, *others], eye, directions, min_weight=0.02)
    assert alone <= sum(asked) < 1.02 * alone


# ---- things -------------------------------------------------------------------------------------


class Floor:
    """A level thing, seen from both sides, and how often it was asked for."""

    def __init__(self, height):
        self.height, self.calls, self.rays, self.number = height, 0, 0, 7

    def __call__(self, origin, direction):
        self.calls += 1
        self.rays += len(origin)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (self.height - origin[:, 2]) / direction[:, 2]
        met = way > 0.0
        return np.where(met, way, np.inf), np.where(met, self.number, -1)

    @property
    def box(self):
        return np.array([[(-9.0, -9.0, self.height), (9.0, 9.0, self.height)]])


@pytest.mark.parametrize("rise", [0.0, 1e-8, -1e-8])
def test_a_glass_that_stands_on_a_table_shows_it_through_a_film(rise):
    """The underside is an interface with air, whatever rounding says of which is higher."""
    rng = np.random.default_rng(14)
    body = BODIES["tumbler"]
    glass = optics.PlacedGlass(body, moved(z=1.0))
    eye = np.array([0.05, -0.3, 1.25])
    directions = rng.uniform(*(body.box + glass.pose[:3, 3]), (300, 3)) - eye
    table = Floor(1.0 + rise)
    ends = optics.exit_rays([glass], eye, directions, cast=table, min_weight=0.02)
    assert table.calls == ends.steps
    np.testing.assert_allclose(sums(ends, 300), 1.0, atol=1e-12)
    place = (
        ends.origin
        + np.where(np.isfinite(ends.distance), ends.distance, 0.0)[:, None] * ends.direction
    )
    assert (place[:, 2] >= 1.0 - 1e-6).all()
    seen = np.isfinite(ends.distance)
    np.testing.assert_array_equal(ends.thing, np.where(seen, table.number, -1))
    np.testing.assert_allclose(place[seen, 2], 1.0, atol=1e-6)
    under = seen & (np.hypot(*place[:, :2].T) < 0.0359)
    assert under.sum() > 50 and (ends.distance[under] < 1e-5).all()
    # With the glass a hair above the table the same is seen, but for the hair.
    hair = Floor(1.0 - 1e-5)
    other = optics.exit_rays([glass], eye, directions, cast=hair, min_weight=0.02)
    light = [
        np.bincount(e.ray[np.isfinite(e.distance)], e.weight[np.isfinite(e.distance)], 300)
        for e in (ends, other)
    ]
    np.testing.assert_allclose(*light, atol=0.1)
    assert np.abs(light[0] - light[1]).mean() < 5e-3


@pytest.mark.parametrize("size", [3.0, 30.0, 300.0])
def test_a_caster_of_few_digits_lets_no_light_through_the_table(size):
    """Float32 is off by parts of a face's size, however near the face is."""
    rng = np.random.default_rng(18)
    body = BODIES["tumbler"]
    glass = optics.PlacedGlass(body, np.eye(4))
    eye = np.array([0.05, -0.3, 0.25])
    directions = rng.uniform(*body.box, (400, 3)) - eye
    table = Floor(0.0)

    def blurred(origin, direction):
        with np.errstate(divide="ignore", invalid="ignore"):
            way = -origin[:, 2] / direction[:, 2]
        way = way + 2.0e-7 * size * rng.uniform(-1.0, 1.0, len(way))
        return np.where(way > 0.0, way, np.inf), np.where(way > 0.0, 0, -1)

    box = np.array([[(-0.5 * size, -0.5 * size, 0.0), (0.5 * size, 0.5 * size, 0.0)]])
    exact = optics.exit_rays([glass], eye, directions, cast=table, min_weight=0.02)
    found = optics.exit_rays([glass], eye, directions, cast=blurred, things=box, min_weight=0.02)
    down = found.direction[:, 2] < -1e-2
    assert down.sum() > 200 and np.isfinite(found.distance[down]).all()
    np.testing.assert_allclose(*(sums(ends, 400) for ends in (exact, found)), atol=1e-12)
    light = [
        np.bincount(ends.ray, ends.weight * (ends.direction[:, 2] < 0.0), 400)
        for ends in (exact, found)
    ]
    # But for rays that leave next to the foot, where it cannot be told who was there first.
    assert np.mean(np.abs(light[0] - light[1]) > 1e-6) < 0.02


def test_a_thing_in_the_liquid_ends_rays_there():
    body = BODIES["tumbler"]
    drink = np.array([(0.0, 0, 0), (0.0, 0, 0), (7.0, 8, 9)])
    glass = optics.PlacedGlass(body, np.eye(4), drink)
    rng = np.random.default_rng(15)
    eye, directions = rays_at(rng, body.box, 300)
    height = 0.03
    ends = optics.exit_rays([glass], eye, directions, cast=Floor(height), min_weight=0.02)
    seen = np.isfinite(ends.distance)
    place = ends.origin[seen] + ends.distance[seen, None] * ends.direction[seen]
    np.testing.assert_allclose(place[:, 2], height, atol=1e-9)
    wet = np.hypot(*ends.origin[seen, :2].T) < 0.0336
    two = wet & (ends.events[seen] == 2) & (np.hypot(*place[:, :2].T) < 0.0335)
    assert two.sum() > 30
    expected = ends.distance[seen][two, None] * drink[2]
    np.testing.assert_allclose(ends.depth[seen][two], expected, rtol=1e-9)


def test_what_ends_black_in_the_glass_has_met_no_thing():
    """A thing behind the interface was looked for, and a ray that ends there never came to it."""
    body = optics.body(optics.CylinderGlass((0.02,), (2.4,), extent=(0.0, 0.1)))
    rng = np.random.default_rng(6)
    place = np.array((0.0, 0.0, 0.05)) + rng.uniform(-0.01, 0.01, (500, 3))
    ends = optics.exit_rays(
        [optics.PlacedGlass(body, np.eye(4))],
        place,
        rng.normal(size=(500, 3)),
        cast=Floor(-0.1),
        fresnel=False,
    )
    met = np.isfinite(ends.distance)
    black = np.isinf(ends.depth).all(axis=1)
    assert met.sum() > 50 and black.sum() > 50
    np.testing.assert_array_equal(ends.thing, np.where(met, 7, -1))


def test_only_rays_that_can_meet_a_thing_are_cast():
    rng = np.random.default_rng(16)
    glasses = [
        optics.PlacedGlass(BODIES["tumbler"], moved(x=-0.06)),
        optics.PlacedGlass(BODIES["filled"], moved(x=0.06)),
    ]
    eye, directions = rays_at(rng, np.array([(-0.1, -0.05, 0.0), (0.1, 0.05, 0.12)]), 300)
    every, few = Floor(-0.001), Floor(-0.001)
    one = optics.exit_rays(glasses, eye, directions, cast=every, min_weight=0.02)
    two = optics.exit_rays(glasses, eye, directions, cast=few, things=few.box, min_weight=0.02)
    for name in ("ray", "weight", "origin", "direction", "distance", "path", "lost"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert few.rays < 0.6 * every.rays and few.calls <= every.calls == one.steps


# ---- the oracle ---------------------------------------------------------------------------------


@dataclass
class Shape:
    """A convex solid: a ball, a box or a rod of size 1 in a frame, scaled."""

    kind: str
    pose: np.ndarray
    size: float
    ior: float
    priority: int

    @property
    def placed(self):
        if self.kind == "ball":
            glass = optics.SphereGlass((self.size,), (self.ior,))
        elif self.kind == "rod":
            glass = optics.CylinderGlass((self.size,), (self.ior,), extent=(-self.size, self.size))
        else:
            corners = self.size * np.array([(-1.0, -1), (1, -1), (1, 1), (-1, 1)])
            glass = optics.FlatGlass((self.size,), (self.ior,), outline=corners)
        return optics.PlacedGlass(optics.body(glass), self.pose, priority=self.priority)

    def functions(self):
        """Inequalities q·A·q + b·q + c < 0, one a face, and what is in all is inside."""
        eye, none = np.eye(3), np.zeros(3)
        if self.kind == "ball":
            return [(eye, none, -(self.size**2))]
        if self.kind == "rod":
            ends = [(0 * eye, s * eye[2], -self.size) for s in (1.0, -1.0)]
            return [(np.diag((1.0, 1, 0)), none, -(self.size**2)), *ends]
        sides = [(0 * eye, s * eye[axis], -self.size) for axis in (0, 1) for s in (1.0, -1.0)]
        return [*sides, (0 * eye, eye[2], 0.0), (0 * eye, -eye[2], -self.size)]

    def inside(self, point):
        q = (point - self.pose[:3, 3]) @ self.pose[:3, :3]
        return all(q @ a @ q + b @ q + c < 0.0 for a, b, c in self.functions())

    def crossings(self, origin, along):
        """Ways to the faces' crossings, with normals in the world."""
        turn = self.pose[:3, :3]
        o, d = (origin - self.pose[:3, 3]) @ turn, along @ turn
        for a, b, c in self.functions():
            square, linear, rest = d @ a @ d, 2.0 * (o @ a @ d) + b @ d, o @ a @ o + b @ o + c
            if square == 0.0:
                ways = [] if linear == 0.0 else [-rest / linear]
            else:
                under = linear**2 - 4.0 * square * rest
                root = np.sqrt(max(under, 0.0))
                ways = (
                    [] if under <= 0.0 else [(-linear + s * root) / (2.0 * square) for s in (-1, 1)]
                )
            for way in ways:
                q = o + way * d
                yield way, turn @ (2.0 * a @ q + b)


def ior_at(shapes, point):
    held = [shape for shape in shapes if shape.inside(point)]
    return max(held, key=lambda shape: shape.priority).ior if held else 1.0


def followed(shapes, origin, along, weight, events, least):
    """Recursively: (weight, origin, direction) of all exit rays, by what lies on either side of
    every place where a line crosses any face."""
    small = 1e-7
    ways = sorted(
        ((way, normal) for shape in shapes for way, normal in shape.crossings(origin, along)),
        key=lambda pair: pair[0],
    )
    for way, normal in ways:
        if way < small:
            continue
        point = origin + way * along
        before, behind = (ior_at(shapes, point + s * small * along) for s in (-1.0, 1.0))
        if before == behind:
            continue
        normal = normal / np.linalg.norm(normal)
        if normal @ along > 0.0:
            normal = -normal
        eta = before / behind
        share = float(optics.fresnel(normal @ along, eta))
        events += 1
        found = []
        for part, turned in (
            (weight * (1.0 - share), optics.refract(along, normal, eta)[0]),
            (weight * share, optics.reflect(along, normal)),
        ):
            if part > min(least * max(1.0, events / 6.0), max(least, 0.1)):
                found += followed(shapes, point, turned, part, events, least)
        return found
    return [(weight, origin, along)]


@pytest.mark.parametrize("seed", range(8))
def test_random_scenes_against_a_plain_recursive_tracer(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 5))
    shapes = [
        Shape(
            str(rng.choice(["ball", "box", "rod"])),
            random_pose(rng, 1.0),
            rng.uniform(0.4, 1.0),
            rng.uniform(1.1, 1.8),
            number,
        )
        for number in rng.permutation(count)
    ]
    eye = rng.uniform(-1.0, 1.0, 3) if seed % 3 == 0 else 4.0 * unit(rng.normal(size=3))
    directions = unit(rng.uniform(-1.0, 1.0, (24, 3)) - eye)
    ends = optics.exit_rays(
        [shape.placed for shape in shapes], eye, directions, min_weight=0.03, most_events=200
    )
    agree = 0
    for ray, along in enumerate(directions):
        found = followed(shapes, eye, along, 1.0, 0, 0.03)
        rows = ends.ray == ray
        if len(found) != rows.sum():
            continue
        expected = sorted(found, key=lambda end: -end[0])
        order = np.argsort(-ends.weight[rows], kind="stable")
        weights = np.array([end[0] for end in expected])
        np.testing.assert_allclose(ends.weight[rows][order], weights, atol=1e-6)
        for weight, origin, along in expected:
            off = np.abs(ends.weight[rows] - weight) + np.linalg.norm(
                np.cross(ends.origin[rows] - origin, along), axis=1
            )
            off += np.linalg.norm(ends.direction[rows] - along, axis=1)
            assert off.min() < 1e-5
        agree += 1
    # A weight next to the least may fall on either side of it.
    assert agree >= len(directions) - 1


# ---- odds and ends ------------------------------------------------------------------------------


@pytest.mark.parametrize("names", [("tumbler", "slab"), ("bowl", "ball")])
def test_a_ray_does_not_depend_on_its_neighbours(monkeypatch, names):
    """Nor on the blocks and threads in which rays are followed: all of it is the same to the bit,
    the order of its exit rays too."""
    rng = np.random.default_rng(17)
    glasses = [
        optics.PlacedGlass(BODIES[name], random_pose(rng, 0.05), priority=priority)
        for priority, name in enumerate(names)
    ]
    eye, directions = rays_at(rng, BODIES[names[0]].box, 200)
    whole = optics.exit_rays(glasses, eye, directions, min_weight=0.02)
    some = np.sort(rng.permutation(200)[:31])
    part = optics.exit_rays(glasses, eye, directions[some], min_weight=0.02)
    blocks = solver.in_blocks
    with ThreadPoolExecutor(2) as workers:
        monkeypatch.setattr(solver, "THREADS", 2)
        monkeypatch.setattr(solver, "_workers", workers)
        monkeypatch.setattr(
            sys.modules["glass_refraction.optics.exit_rays"],
            "in_blocks",
            lambda work, total: blocks(work, total, 17),
        )
        split = optics.exit_rays(glasses, eye, directions, min_weight=0.02)
    for other, rays in ((part, some), (split, np.arange(200))):
        rows = np.flatnonzero(np.isin(whole.ray, rays))
        np.testing.assert_array_equal(whole.ray[rows], rays[other.ray])
        for name in ("path", "weight", "origin", "direction", "events"):
            np.testing.assert_array_equal(getattr(whole, name)[rows], getattr(other, name))
        np.testing.assert_array_equal(whole.lost[rays], other.lost)


def test_stretches_lead_from_the_eye_over_all_interfaces_to_exit_rays():
    rng = np.random.default_rng(19)
    glasses = [
        optics.PlacedGlass(BODIES["filled"], moved()),
        optics.PlacedGlass(BODIES["ball"], moved(x=0.1)),
    ]
    eye, directions = rays_at(rng, BODIES["filled"].box, 300)
    ends = optics.exit_rays(glasses, eye, directions, min_weight=0.02, stretches=True)
    plain = optics.exit_rays(glasses, eye, directions, min_weight=0.02)
    assert not len(plain.passed)
    np.testing.assert_array_equal(plain.weight, ends.weight)
    eye = eye.astype(np.float32)
    for ray in range(300):
        begin, end = np.moveaxis(ends.passed[ends.passed_ray == ray], 1, 0)
        known = {tuple(eye.tolist()), *map(tuple, end.tolist())}
        # Each goes on where another ended, and each exit ray begins where one did.
        assert {tuple(place) for place in begin.tolist()} <= known
        bent = (ends.ray == ray) & (ends.events > 0)
        assert {tuple(p) for p in ends.origin[bent].astype(np.float32).tolist()} <= known
        assert len(begin) >= ends.events[bent].max(initial=0)
    assert (ends.events > 4).any()


def test_no_glass_no_rays_and_rays_that_are_none():
    ends = optics.exit_rays([], (0.0, 0.0, 0.0), [(0.0, 0.0, 2.0)])
    assert (ends.weight, ends.events, ends.path, ends.distance) == (1.0, 0, 0, np.inf)
    np.testing.assert_array_equal(ends.direction, [(0.0, 0.0, 1.0)])
    glass = optics.PlacedGlass(BODIES["ball"], np.eye(4))
    ends = optics.exit_rays([glass], (0.0, 0.0, 1.0), np.zeros((0, 3)))
    assert len(ends.ray) == len(ends.lost) == ends.steps == 0
    bad = [(np.nan, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    ends = optics.exit_rays([glass], (0.0, 0.0, 1.0), bad)
    np.testing.assert_array_equal(ends.ray, [2])
    np.testing.assert_array_equal(ends.lost, [1.0, 1.0, 0.0])


def test_poses_of_float32_are_made_rigid():
    rng = np.random.default_rng(19)
    pose = random_pose(rng, 1.0)
    placed = optics.PlacedGlass(BODIES["ball"], pose.astype(np.float32))
    turn = placed.pose[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(placed.pose, pose, atol=1e-6)


def test_bad_input_is_named():
    body = BODIES["ball"]
    with pytest.raises(ValueError, match="pose must be a rigid"):
        optics.PlacedGlass(body, 2.0 * np.eye(4))
    with pytest.raises(ValueError, match="pose must be a rigid"):
        optics.PlacedGlass(body, np.eye(3))
    with pytest.raises(ValueError, match="absorption must be"):
        optics.exit_rays(
            [optics.PlacedGlass(body, np.eye(4), np.zeros((1, 3)))], (0, 0, 1), [(0, 0, 1)]
        )
    other = optics.PlacedGlass(optics.body(optics.SphereGlass((1.0,), (1.5,), 1.2)), np.eye(4))
    with pytest.raises(ValueError, match="the same surroundings"):
        optics.exit_rays([optics.PlacedGlass(body, np.eye(4)), other], (0, 0, 1), [(0, 0, 1)])


def test_what_is_raised_between_steps_ends_the_call():
    def pressed():
        raise KeyboardInterrupt

    glass = optics.PlacedGlass(optics.SphereGlass((0.05,), (1.5,)), np.eye(4))
    with pytest.raises(KeyboardInterrupt):
        optics.exit_rays([glass], (0.0, 0.0, 1.0), [[0.0, 0.0, -1.0]], between=pressed)
