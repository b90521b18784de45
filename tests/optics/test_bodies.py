# SPDX-License-Identifier: GPL-3.0-or-later
"""Slabs with side faces and tubes with rims: rays through them obey the laws, all light arrives."""

import numpy as np
import pytest
from ways import ways

from glass_refraction import optics
from glass_refraction.optics import CylinderGlass, FlatGlass, SphereGlass
from glass_refraction.optics.axial import nearest, start
from glass_refraction.optics.bodies import Ball, Prism, Tube

SQUARE = ((-0.05, -0.04), (0.05, -0.04), (0.05, 0.04), (-0.05, 0.04))
NOTCHED = ((-0.05, -0.04), (0.0, -0.01), (0.05, -0.04), (0.05, 0.04), (-0.05, 0.04))
BODIES = {
    "slab": FlatGlass((0.02,), (1.5,), outline=SQUARE),
    "notched": FlatGlass((0.02,), (1.5,), outline=NOTCHED[::-1]),
    "layers": FlatGlass((0.01, 0.015), (1.5, 1.8), outline=SQUARE),
    "tube": CylinderGlass((0.04, 0.03), (1.5, 1.0), extent=(-0.03, 0.05)),
    "filled": CylinderGlass((0.04, 0.03), (1.5, 1.333), extent=(-0.03, 0.05)),
    "tank": FlatGlass((0.02,), (1.5,), ior_below=1.333, outline=SQUARE),
    "ball": SphereGlass((0.05,), (1.5,)),
    "bowl": SphereGlass((0.05, 0.047), (1.5, 1.333)),
    "rod": CylinderGlass((0.04,), (1.6,), extent=(-0.03, 0.05)),
}


def _rays(seed, count=4000):
    """Rays from all round, most of which meet a glass of that size."""
    rng = np.random.default_rng(seed)
    eye = rng.normal(size=(count, 3))
    eye *= 0.4 / np.linalg.norm(eye, axis=1, keepdims=True)
    return eye, rng.normal(scale=0.03, size=(count, 3)) - eye


def _met(name, seed, count):
    """The same, those before a tank's wall."""
    eye, directions = _rays(seed, count)
    keep = (eye[:, 2] > 0.0) | (name != "tank")
    return eye[keep], directions[keep]


@pytest.mark.parametrize("name", BODIES)
def test_all_light_of_a_ray_comes_from_somewhere(name):
    body = optics.body(BODIES[name])
    eye, directions = _met(name, 1, 400)
    ends = ways(body, eye, directions, min_weight=1e-3)
    brought = np.bincount(ends.ray, ends.weight, len(eye))
    assert (brought < 1.0 + 1e-12).all()
    # What is totally reflected round and round in a block never leaves it.
    caught = 1.0 - brought
    assert np.median(caught) < 0.02 and (caught > 0.05).mean() < 0.15


@pytest.mark.parametrize("name", BODIES)
def test_light_goes_back_the_way_it_came(name):
    body = optics.body(BODIES[name])
    eye, directions = _met(name, 2, 150)
    ends = ways(body, eye, directions, min_weight=0.03)
    # What leaves a tank by its wall's sides ends beside the water: nobody says in what.
    kept = [len(path) > 0 and not (name == "tank" and _has_end(path)) for path in ends.paths]
    some = np.flatnonzero(np.array(kept)[ends.path])
    far = ends.origin[some] + 0.3 * ends.direction[some]
    back = ways(body, far, -ends.direction[some], min_weight=0.01)
    along = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    found = np.zeros(len(some), bool)
    for ray, path, weight, origin, direction in zip(
        back.ray, back.path, back.weight, back.origin, back.direction, strict=True
    ):
        there = some[ray]
        names = ends.paths[ends.path[there]].interfaces
        if back.paths[path].interfaces != names[::-1]:
            continue
        first = ends.ray[there]
        assert weight == pytest.approx(ends.weight[there], rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(direction, -along[first], atol=1e-7)
        aside = np.cross(eye[first] - origin, along[first])
        np.testing.assert_allclose(aside, 0.0, atol=1e-8)
        found[ray] = True
    # But for rays at the very edge of a face.
    assert found.mean() > 0.99


@pytest.mark.parametrize("name", BODIES)
def test_rays_that_meet_no_end_take_the_paths_of_the_unbounded_glass(name):
    """Where the bounded description says that all faces are met within, the body says the same."""
    glass = BODIES[name]
    body = optics.body(glass)
    eye, directions = _met(name, 3, 700)
    ends = ways(body, eye, directions, min_weight=0.003)
    paths = tuple(dict.fromkeys(path.events for path in ends.paths if path.events))
    paths = tuple(sorted(paths, key=len)[:20])
    within, _ = optics.path_weights(glass, eye, directions, paths)
    checked = 0
    for number, events in enumerate(paths):
        rows = [n for n, path in enumerate(ends.paths) if path.events == events]
        plain = np.isin(ends.path, rows)
        ends_met = np.array([not _has_end(path) for path in ends.paths])[ends.path]
        light = np.zeros(len(eye))
        np.add.at(light, ends.ray[plain & ends_met], ends.weight[plain & ends_met])
        both = (within[number] > 0.01) & ~_crosses_notch(name, eye, directions)
        np.testing.assert_allclose(light[both], within[number][both], atol=1e-9)
        checked += int(both.sum())
    assert checked > 70


def _has_end(path):
    return any(name.startswith(("side", "upper", "lower")) for name in path.interfaces)


def _crosses_notch(name, eye, directions):
    """Rays through the notch's neighbourhood, where faces are met that the slab's do not know."""
    if name != "notched":
        return np.zeros(len(eye), bool)
    at_top = eye - (eye[:, 2] / directions[:, 2])[:, None] * directions
    low = eye - ((eye[:, 2] + 0.02) / directions[:, 2])[:, None] * directions
    return (np.minimum(at_top[:, 1], low[:, 1]) < 0.0) | (np.abs(directions[:, 2]) < 0.1)


@pytest.mark.parametrize("slope", [0.0, 0.02, 0.07])
def test_a_corner_sends_light_back(slope):
    """Two upright sides at a right angle, both reflecting: what comes in returns antiparallel."""
    glass = FlatGlass((0.02,), (1.5,), outline=((0.0, 0.05), (-0.05, 0.0), (0.05, 0.0)))
    body = optics.body(glass)
    x = np.linspace(-0.02, 0.02, 41)
    origin = np.column_stack((x, np.full(41, -0.3), np.full(41, -0.01)))
    origin[:, 0] -= 0.3 * slope
    direction = np.tile((slope, 1.0, 0.0), (41, 1))
    ends = ways(body, origin, direction, min_weight=0.5)
    events = np.array([ends.paths[n].events for n in ends.path])
    back = events == "TRRT"
    assert back.sum() > 20
    expected = -direction[0] / np.linalg.norm(direction[0])
    np.testing.assert_allclose(ends.direction[back], np.tile(expected, (back.sum(), 1)), atol=1e-12)


def test_bodies_say_where_they_are():
    for glass in BODIES.values():
        body = optics.body(glass)
        low, high = body.box
        rng = np.random.default_rng(4)
        points = rng.uniform(1.5 * low - 0.01, 1.5 * high + 0.01, (4000, 3))
        outside = ((points < low) | (points > high)).any(axis=1)
        medium = body.medium_at(points)
        assert np.isin(medium[outside], body.endless).all()
        assert medium.max() == len(body.media) - 1
        # A ray that starts in a medium meets an interface of it first.
        some = np.flatnonzero(~np.isin(medium, body.endless))
        for group in start(body, points[some], rng.normal(size=(len(some), 3))):
            interface, way, _ = nearest(body, group.medium, group.rays)
            assert (interface >= 0).all() and np.isfinite(way).all()


def test_no_bodies_where_none_are():
    assert isinstance(optics.body(BODIES["slab"]), Prism)
    assert isinstance(optics.body(BODIES["rod"]), Tube)
    assert isinstance(optics.body(BODIES["ball"]), Ball)
    assert optics.body(SphereGlass((0.1, 0.09), (1.0, 1.5))) is None
    assert optics.body(FlatGlass((0.02,), (1.5,))) is None
    assert optics.body(FlatGlass((0.02,), (1.0,), outline=SQUARE)) is None
    assert optics.body(CylinderGlass((0.04,), (1.5,))) is None
    assert optics.body(CylinderGlass((0.04, 0.03), (1.0, 1.0), extent=(0.0, 0.1))) is None
