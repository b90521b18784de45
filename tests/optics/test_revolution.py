# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses of revolution against the shapes they can be: a tumbler, a ball, a carafe of its own."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.optics import LightPath, RevolutionGlass, SphereGlass, Tumbler, revolution

PIXEL = 1.0 / 2400.0
OUTER = [(0, 0), (0.02, 0.001), (0.035, 0.02), (0.042, 0.05), (0.036, 0.09), (0.03, 0.11)]
INNER = [(0, 0.004), (0.018, 0.006), (0.032, 0.022), (0.039, 0.05), (0.0335, 0.09), (0.0285, 0.11)]
CARAFE = RevolutionGlass(OUTER, INNER, 1.5, 1.333, 0.05)
THROUGH = LightPath("TTTT", ("outer", "wet", "wet", "outer"))


def polygon(*corners):
    """Bézier points of straight edges with corners."""
    corners = np.array(corners, dtype=float)
    before = np.concatenate([corners[:1], corners[:-1]])
    after = np.concatenate([corners[1:], corners[-1:]])
    return np.stack([(2 * corners + before) / 3, corners, (2 * corners + after) / 3], axis=1)


def half_circle(radius, count=61):
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)
    points = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    points[[0, -1], 0] = 0.0
    return points


def merged(path):
    """A tumbler's path by the names of a profile that runs round the corners."""
    names = {"base": "outer", "floor": "wet"}
    return LightPath(path.events, tuple(names.get(name, name) for name in path.interfaces))


@pytest.mark.parametrize("eye", [(0.4, 0.05, 0.06), (0.05, 0.02, 0.4)])
def test_a_profile_with_corners_is_a_tumbler(eye):
    """The same rays by the same ways, with the same weights."""
    tumbler = Tumbler(0.04, 0.003, 0.12, 0.008, 1.5, 1.333, 0.07)
    glass = RevolutionGlass(
        polygon((0, 0), (0.04, 0), (0.04, 0.12)),
        polygon((0, 0.008), (0.037, 0.008), (0.037, 0.12)),
        1.5,
        1.333,
        0.07,
    )
    rng = np.random.default_rng(0)
    directions = np.add(rng.uniform(-0.05, 0.05, (1500, 3)), (0, 0, 0.06)) - eye
    paths = optics.light_paths(tumbler, eye, min_weight=0.05)[:8]
    weights, _ = optics.path_weights(tumbler, eye, directions, paths)
    together = {}
    for path, weight in zip(paths, weights, strict=True):
        name = merged(path)
        together[name] = together.get(name, 0.0) + weight
    for path, weight in together.items():
        mine, _ = optics.path_weights(glass, eye, directions, [path])
        theirs = weight > 0.0
        # Paths of the tumbler that were not listed may share the name.
        np.testing.assert_allclose(mine[0, theirs], weight[theirs], atol=1e-9)
    points = np.add(rng.uniform(-0.1, 0.1, (60, 3)), (-0.15, 0.0, 0.04))
    path = paths[0]
    theirs = optics.apparent_points(tumbler, path, eye, points)
    mine = optics.apparent_points(glass, merged(path), eye, points)
    for slot, valid in enumerate(theirs.valid):
        shown = np.flatnonzero(valid)
        off = np.linalg.norm(mine.direction[:, shown] - theirs.direction[slot, shown], axis=2)
        off = np.where(mine.valid[:, shown], off, np.inf)
        assert off.min(axis=0).max(initial=0.0) < 1e-8


def test_a_half_circle_makes_a_ball():
    ball = SphereGlass((0.05,), (1.5,))
    glass = RevolutionGlass(half_circle(0.05))
    rng = np.random.default_rng(1)
    eye = np.array([0.3, 0.05, 0.08])
    directions = rng.uniform(-0.06, 0.06, (800, 3)) - eye
    path = LightPath("TT", ("outer", "outer"))
    mine = optics.trace(glass, eye, directions, path)
    theirs = optics.trace(ball, eye, directions, "TT")
    both = mine.valid & theirs.valid
    assert (mine.valid == theirs.valid).mean() > 0.995 and both.sum() > 300
    np.testing.assert_allclose(mine.origin[both], theirs.origin[both], atol=1e-6)
    points = rng.uniform(-0.03, 0.03, (80, 3))
    mine = optics.apparent_points(glass, path, eye, points)
    theirs = optics.apparent_points(ball, "TT", eye, points)
    seen = theirs.valid & (theirs.stretch == 1)[:, None]
    for slot in np.flatnonzero(seen.any(axis=1)):
        shown = np.flatnonzero(seen[slot])
        off = np.linalg.norm(mine.direction[:, shown] - theirs.direction[slot, shown], axis=2)
        off = np.where(mine.valid[:, shown] & (mine.stretch == 1)[:, None], off, np.inf)
        assert np.median(off.min(axis=0)) < 1e-5
        assert (off.min(axis=0) < 1e-4).mean() > 0.97


@pytest.mark.parametrize("events", ["TTTT", "R", "TRT"])
def test_images_trace_back_to_their_points(events):
    """Points picked on traced rays are seen along just these, and every image traces back."""
    rng = np.random.default_rng(2)
    eye = np.array([0.5, 0.02, 0.06])
    paths = [
        path for path in optics.light_paths(CARAFE, eye, min_weight=0.1) if path.events == events
    ][:2]
    assert paths
    directions = np.add(rng.uniform(-0.05, 0.05, (1500, 3)), (0, 0, 0.05)) - eye
    for path in paths:
        traced = optics.trace(CARAFE, eye, directions, path)
        some = np.flatnonzero(traced.valid)[:100]
        way = rng.uniform(0.0, 0.3, (len(some), 1))
        points = traced.origin[some] + way * traced.direction[some]
        unit = directions[some] / np.linalg.norm(directions[some], axis=1)[:, None]
        apparent = optics.apparent_points(CARAFE, path, eye, points)
        last = (apparent.stretch == len(path))[:, None]
        off = np.linalg.norm(apparent.direction - unit, axis=2)
        off = np.where(apparent.valid & last, off, np.inf).min(axis=0)
        assert (off < 1e-6).mean() > 0.98
        for slot in np.flatnonzero(last[:, 0]):
            shown = np.flatnonzero(apparent.valid[slot])
            again = optics.trace(CARAFE, eye, apparent.direction[slot, shown], path)
            assert again.valid.mean() > 0.98
            kept = np.flatnonzero(again.valid)
            towards = points[shown[kept]] - again.origin[kept]
            miss = np.linalg.norm(np.cross(towards, again.direction[kept]), axis=1)
            assert (miss / apparent.distance[slot, shown[kept]]).max(initial=0.0) < 1e-4 * PIXEL


def test_snell_on_the_curve():
    """n·(d × N) is the same on both sides, with normals by differences along the spline."""
    rng = np.random.default_rng(3)
    eye = np.array([0.5, 0.02, 0.06])
    directions = np.add(rng.uniform(-0.03, 0.03, (300, 3)), (0, 0, 0.06)) - eye
    into = optics.trace(CARAFE, eye, directions, LightPath("R", ("outer",)))
    surface = CARAFE.named("outer").surface
    t = np.linspace(0.0, surface.count, 200_001)
    radius, height, *_ = surface.on_curve(t)
    where = into.origin[into.valid] / CARAFE.scale
    spot = [np.argmin((radius - np.hypot(*p[:2])) ** 2 + (height - p[2]) ** 2) for p in where]
    spot = np.clip(spot, 1, len(t) - 2)
    off = np.hypot(radius[spot] - np.hypot(*where[:, :2].T), height[spot] - where[:, 2])
    assert off.max() < 1e-4
    dr, dz = (part[np.add(spot, 1)] - part[np.subtract(spot, 1)] for part in (radius, height))
    outward = where[:, :2] / np.hypot(*where[:, :2].T)[:, None]
    normal = np.column_stack([outward * dz[:, None], -dr])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    before = directions[into.valid] / np.linalg.norm(directions[into.valid], axis=1)[:, None]
    mirrored = optics.reflect(before, normal)
    np.testing.assert_allclose(into.direction[into.valid], mirrored, atol=1e-4)


def test_weights_sum_to_one():
    rng = np.random.default_rng(4)
    eye = (0.5, 0.02, 0.06)
    directions = np.add(rng.uniform(-0.06, 0.06, (400, 3)), (0, 0, 0.05)) - eye
    paths = (LightPath(""), *optics.light_paths(CARAFE, eye, min_weight=0.05))
    weights, rest = optics.path_weights(CARAFE, eye, directions, paths)
    np.testing.assert_allclose(weights.sum(axis=0) + rest, 1.0, atol=1e-12)
    assert THROUGH in paths
    missed = weights[0] == 1.0
    assert 0.1 < missed.mean() < 0.9 and (rest[missed] == 0.0).all()


def test_an_eye_that_is_far_away_costs_no_look_at_the_outline(monkeypatch):
    """The 3D view asks at each redraw."""
    CARAFE.medium_at(np.zeros((1, 3)))

    def refuse(*_):
        raise AssertionError("the outline was walked")

    monkeypatch.setattr(revolution, "_encloses", refuse)
    assert CARAFE.medium_at(np.array([0.4, 0.0, 0.05])) == 0
    with pytest.raises(AssertionError):
        CARAFE.medium_at(np.array([0.0, 0.0, 0.05]))


def test_nothing_but_numbers():
    points = np.array([[np.nan, 0, 0], [-0.2, 0.0, 0.0545], [np.inf, 0, 0], [1e300, 0, 0]])
    apparent = optics.apparent_points(CARAFE, THROUGH, (0.5, 0.0, 0.05), points)
    assert not apparent.valid[:, [0, 2]].any() and apparent.valid[:, 1].any()
    for part in (apparent.direction, apparent.distance, apparent.position, apparent.residual):
        assert np.isfinite(part).all()
    none = optics.apparent_points(CARAFE, THROUGH, (0.5, 0.0, 0.05), np.zeros((0, 3)))
    assert none.direction.shape == (1, 0, 3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("outer", [(0.01, 0), (0.02, 0.1)]),
        ("outer", [(0, 0)]),
        ("outer", "glass"),
        ("inner", [(0, 0.01), (np.nan, 0.1)]),
        ("inner", [(0, 0.01), (-0.1, 0.1)]),
        ("ior", -1.0),
        ("level", 1.0),
        ("level", "full"),
    ],
)
def test_bad_fields_are_named(field, value):
    fields = {"outer": OUTER, "inner": INNER, field: value}
    with pytest.raises(ValueError, match=field):
        RevolutionGlass(**fields)
