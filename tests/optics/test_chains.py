# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths through two glasses, one after the other."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from glass_refraction import optics

PANE = optics.FlatGlass((0.006,), (1.5,))
CUP = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
FILLED = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
BALL = optics.SphereGlass((0.04,), (1.5,))
BUBBLE = optics.SphereGlass((0.05, 0.046), (1.5, 1.0))
TUMBLER = optics.Tumbler(0.04, 0.003, 0.12, 0.005, 1.5, 1.333, 0.06)
SUBMERGED = optics.LightPath("TTTT", ("outer", "wet", "wet", "outer"))


def turned(axis, angle):
    """(3, 3) about axis 0, 1 or 2."""
    first, second = [k for k in (1, 2, 0, 1, 2) if k != axis][:2]
    found = np.eye(3)
    found[first, first] = found[second, second] = np.cos(angle)
    found[first, second], found[second, first] = -np.sin(angle), np.sin(angle)
    return found


def posed(rotation, place):
    """(4, 4)."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation, place
    return found


UPRIGHT = turned(0, np.pi / 2)
BESIDE, ABOVE = np.array([0.01, -0.4, 0.02]), np.array([0.02, 0.05, 0.4])
CASES = {
    "panes": (PANE, PANE, posed(turned(0, 0.5) @ turned(1, 0.2), (0, 0, -0.1)), "TT", "TT", ABOVE),
    "round a pane": (PANE, PANE, posed(turned(0, 0.5), (0, 0, -0.1)), "TRRT", "TT", ABOVE),
    "pane, cup": (PANE, CUP, posed(turned(0, 1.7), (0, 0, -0.15)), "TT", "TTTT", ABOVE),
    "pane, its verge": (PANE, CUP, posed(turned(0, 1.7), (0, 0, -0.15)), "TT", "TRT", ABOVE),
    "pane, water": (PANE, FILLED, posed(turned(0, 1.7), (0, 0, -0.15)), "TT", "TTTT", ABOVE),
    "pane, ball": (PANE, BALL, posed(np.eye(3), (0, 0, -0.15)), "TT", "TT", ABOVE),
    "pane, tumbler": (PANE, TUMBLER, posed(UPRIGHT.T, (0, -0.02, -0.15)), "TT", SUBMERGED, ABOVE),
    "cup, pane": (CUP, PANE, posed(UPRIGHT.T @ turned(1, 0.3), (0, 0.15, 0)), "TTTT", "TT", BESIDE),
    "cups": (CUP, CUP, posed(turned(1, 0.3), (0.02, 0.15, 0)), "TTTT", "TTTT", BESIDE),
    "bubble, cup": (BUBBLE, CUP, posed(turned(1, 0.3), (0.02, 0.15, 0)), "TTTT", "TTTT", BESIDE),
    "cup, water": (CUP, FILLED, posed(turned(1, 0.3), (0.02, 0.15, 0)), "TTTT", "TTTT", BESIDE),
    "mirrored cup": (PANE, CUP, posed(turned(0, 1.7), (0, 0, 0.15)), "R", "TTTT", (0.1, 0.25, 0.4)),
}


def chained(first, second):
    paths = [p if isinstance(p, optics.LightPath) else optics.LightPath(p) for p in (first, second)]
    return optics.ChainedPath(*paths, "far")


def beyond(rng, name, count, reach=0.4):
    """A pair, a path, an eye, points behind both glasses, and the directions they appear in."""
    near, far, pose, first, second, eye = CASES[name]
    pair, path, eye = optics.Pair(near, far, pose), chained(first, second), np.asarray(eye, float)
    targets = pose[:3, 3] + rng.normal(size=(count, 3)) * 0.03
    if isinstance(far, optics.Tumbler):
        targets += pose[:3, :3] @ (0.0, 0.0, 0.04)
    directions = targets - eye
    rays = optics.trace_chain(pair, eye, directions, path)
    way = rng.uniform(0.01, reach, count)
    points = rays.origin + way[:, None] * rays.direction
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    assert rays.valid.sum() > 20
    return (
        pair,
        path,
        eye,
        points[rays.valid],
        directions[rays.valid],
        (rays.length + way)[rays.valid],
    )


def false_images(pair, path, eye, points, found):
    """Valid images behind both glasses whose ray, traced forward, passes its point by."""
    wrong = 0
    for slot in np.flatnonzero(found.stretch == len(path)):
        on = found.valid[slot]
        rays = optics.trace_chain(pair, eye, found.direction[slot][on], path)
        away = points[on] - rays.origin
        along = np.sum(away * rays.direction, axis=1)
        off = np.linalg.norm(away - along[:, None] * rays.direction, axis=1)
        length = rays.length + along
        good = rays.valid & (off < 1e-9 * np.maximum(length, 1.0)) & (along > -1e-12)
        good &= np.abs(length - found.distance[slot][on]) < 1e-9 * length
        wrong += int((~good).sum())
    return wrong


@pytest.mark.parametrize("name", CASES)
def test_what_rays_pass_through_two_glasses_is_found_again(name):
    rng = np.random.default_rng(7)
    count = 300 if "tumbler" in name else 1500
    pair, path, eye, points, directions, lengths = beyond(rng, name, count)
    found = optics.chained_points(pair, path, eye, points)
    assert false_images(pair, path, eye, points, found) == 0
    last = found.stretch == len(path)
    same = found.valid & (np.abs(found.direction - directions).max(axis=2) < 1e-7) & last[:, None]
    # Behind rods and filled glasses a point may appear so near a caustic that it is found once.
    assert same.any(axis=0).mean() > (0.97 if "water" in name else 0.995)
    slot = same.argmax(axis=0)
    each = np.arange(len(points))
    on = same.any(axis=0)
    assert np.abs(found.distance[slot, each] - lengths)[on].max() < 1e-9
    apart = eye + found.distance[..., None] * found.direction - found.position
    assert np.abs(apart).max() < 1e-12


@pytest.mark.parametrize("name", ["panes", "pane, cup", "cups"])
def test_a_glass_of_air_leaves_the_other(name):
    rng = np.random.default_rng(3)
    near, far, pose, first, second, eye = CASES[name]
    *_, points, _, _ = beyond(rng, name, 400)

    def air(glass):
        return replace(glass, ior=(1.0,) * len(glass.ior))

    path = chained(first, second)
    alone = optics.apparent_points(near, first, eye, points)
    found = optics.chained_points(optics.Pair(near, air(far), pose), path, eye, points)
    rows = found.stretch == len(path)
    last = alone.stretch == len(path.first)
    both = found.valid[rows][0] & alone.valid[last][0]
    assert both.sum() > 50
    assert np.abs(found.direction[rows][0] - alone.direction[last][0])[both].max() < 1e-9

    found = optics.chained_points(optics.Pair(air(near), far, pose), path, eye, points)
    pair = optics.Pair(near, far, pose)
    alone = optics.apparent_points(far, second, pair.to_far(eye), pair.to_far(points))
    last = alone.stretch == len(path.second)
    rows = found.stretch == len(path)
    both = found.valid[rows][0] & alone.valid[last][0]
    assert both.sum() > 50
    off = pair.turned(found.direction[rows][0]) - alone.direction[last][0]
    assert np.abs(off[both]).max() < 1e-9


def test_parallel_panes_are_one_stack():
    rng = np.random.default_rng(5)
    stack = optics.FlatGlass((0.006, 0.05, 0.01), (1.5, 1.0, 1.7))
    pair = optics.Pair(PANE, optics.FlatGlass((0.01,), (1.7,)), posed(np.eye(3), (0, 0, -0.056)))
    points = rng.uniform(-1.0, 1.0, (500, 3)) - (0.0, 0.0, 1.2)
    eye = np.array([0.1, 0.0, 0.3])
    found = optics.chained_points(pair, chained("TT", "TT"), eye, points)
    known = optics.apparent_points(stack, "TTTT", eye, points)
    (slot,) = np.flatnonzero(found.stretch == 4)
    (same,) = np.flatnonzero(known.stretch == 4)
    assert found.valid[slot].all() and known.valid[same].all()
    assert np.abs(found.direction[slot] - known.direction[same]).max() < 1e-9
    assert np.abs(found.distance[slot] - known.distance[same]).max() < 1e-9


@pytest.mark.parametrize("name", ["panes", "pane, cup", "cup, pane", "cups", "bubble, cup"])
def test_light_takes_the_same_way_back(name):
    rng = np.random.default_rng(11)
    pair, path, eye, points, _, lengths = beyond(rng, name, 40)
    back = optics.Pair(pair.far, pair.near, np.linalg.inv(pair.pose))
    returned = chained(path.second, path.first)
    number = 0
    for point, length in zip(pair.to_far(points), lengths, strict=True):
        if not optics.chains.is_outside(pair.far, point[None])[0]:
            continue
        found = optics.chained_points(back, returned, point, pair.to_far(eye)[None])
        last = np.flatnonzero(found.stretch == len(path))
        if len(last) and found.valid[last].any():
            number += 1
            assert np.abs(found.distance[last] - length).min() < 1e-8
    assert number > 15


def test_what_the_far_glass_holds_is_seen_on_its_inner_stretches():
    rng = np.random.default_rng(2)
    pair = optics.Pair(PANE, CUP, posed(UPRIGHT, (0, 0, -0.15)))
    path = chained("TT", "TTTT")
    points = pair.to_near(rng.uniform(-0.02, 0.02, (200, 3)))
    found = optics.chained_points(pair, path, ABOVE, points)
    (slot,) = np.flatnonzero(found.stretch == 4)
    assert found.valid[slot].all()
    seen = optics.trace(PANE, ABOVE, found.direction[slot], "TT")
    # Where the ray leaves the pane, an eye would see the point in the ray's direction.
    cavity = optics.apparent_points(
        CUP, "TTTT", pair.to_far(seen.origin[0]), pair.to_far(points[:1])
    )
    inner = cavity.direction[np.flatnonzero(cavity.stretch == 2)[0], 0]
    assert np.abs(inner - pair.turned(seen.direction[0])).max() < 1e-9


def test_what_the_near_glass_holds_is_seen_as_ever():
    rng = np.random.default_rng(2)
    pair = optics.Pair(FILLED, PANE, posed(UPRIGHT.T, (0, 0.15, 0)))
    points = rng.uniform(-0.02, 0.02, (200, 3))
    for view in (BESIDE, optics.ParallelView((0.0, 1.0, 0.1))):
        alone = optics.apparent_points(FILLED, "TTTT", view, points)
        found = optics.chained_points(pair, chained("TTTT", "TT"), view, points)
        assert found.stretch.tolist() == alone.stretch.tolist() == [2] * len(alone.stretch)
        assert np.array_equal(found.valid, alone.valid)
        assert np.array_equal(found.position[found.valid], alone.position[found.valid])


def test_awkward_points_thin_panes_and_far_ones_warn_of_nothing():
    thin = optics.FlatGlass((1e-6,), (1.5,))
    points = np.array(
        [
            (np.nan, 0.0, 0.0),
            (np.inf, 0.0, -1.0),
            (0.0, 0.0, -1e5),
            (3e3, 0.0, -1.0),  # grazing
            ABOVE,
            (0.0, 0.0, 0.0),
            (0.0, 0.0, -0.1),
            (0.0, 0.0, -0.3),
        ]
    )
    for far, second in ((PANE, "TT"), (CUP, "TTTT"), (BALL, "TT")):
        pair = optics.Pair(thin, far, posed(turned(0, 1.2), (0, 0, -0.15)))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = optics.chained_points(pair, chained("TT", second), ABOVE, points)
            none = optics.chained_points(pair, chained("TT", second), ABOVE, np.zeros((0, 3)))
        for array in (found.direction, found.distance, found.position, found.residual):
            assert np.isfinite(array).all()
        assert not found.valid[:, :2].any()
        assert none.valid.shape[1] == 0
        assert false_images(pair, chained("TT", second), ABOVE, np.nan_to_num(points), found) == 0


@pytest.mark.parametrize(
    "glass",
    [
        optics.FlatGlass((0.01,), (1.5,), outline=((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1))),
        optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.0, 0.1)),
        BALL,
        TUMBLER,
    ],
    ids=["pane", "cup", "ball", "tumbler"],
)
def test_the_first_face_is_where_rays_that_do_not_miss_begin_to_bend(glass):
    rng = np.random.default_rng(4)
    eye = np.array([0.2, -0.3, 0.25])
    directions = rng.normal(size=(2000, 3)) * 0.08 - eye
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    way = optics.first_met(glass, eye, directions)
    missed = optics.path_weights(glass, eye, directions, ("",))[0][0] > 0.5
    if not isinstance(glass, optics.Tumbler):
        assert np.array_equal(np.isinf(way), missed)
    mirrored = optics.trace(glass, eye, directions, "R")
    on = mirrored.valid & np.isfinite(way)
    assert on.sum() > 100
    assert np.abs(way - mirrored.length)[on].max() < 1e-12
