# SPDX-License-Identifier: GPL-3.0-or-later
"""Images against plain forward tracing: none missing, none false, every one at its place."""

import numpy as np
import pytest
from rays import aimed, false_images, missing_images, random_glass, seen_points, segments

from glass_refraction import optics

KINDS = ("flat", "cylinder", "sphere")
PIXEL = 1.0 / 2400.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_every_path_and_stretch_of_random_glasses(kind, seed):
    """Points picked on traced rays must be seen along just these rays; whatever else is reported
    must trace back to its point."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    glass, eye = random_glass(rng, kind)
    known = 0
    for path in optics.light_paths(glass, eye, min_weight=0.03)[:4]:
        directions = aimed(rng, glass, eye, 60)
        for stretch in range(1, len(path) + 1):
            points, seen_along = seen_points(rng, glass, eye, directions, path.events, stretch)
            if not len(points):
                continue
            known += len(points)
            apparent = optics.apparent_points(glass, path, eye, points)
            assert missing_images(seen_along, stretch, apparent) == 0
            false, worst = false_images(glass, path.events, eye, points, apparent)
            assert false == 0
            assert worst <= 1e-6 * PIXEL
            assert apparent.residual[apparent.valid].max() <= 1e-6 * PIXEL * 1000.0
    assert known > 50


class DenseScan:
    """Rays of a path in the plane z = 0, fine enough to count the images of points there."""

    def __init__(self, glass, eye, path, count=40_001):
        aim = np.arctan2(-eye[1], -eye[0])
        half = np.arcsin(glass.radius[0] / np.hypot(*eye[:2])) * (1.0 - 1e-12)
        # Dense towards grazing incidence.
        angle = aim + half * np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, count))
        self.directions = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
        self.traced = optics.trace(glass, eye, self.directions, path)
        self.step = 2.0 * half / count * 2.0

    def images(self, target):
        """Directions between which the signed distance from the target changes its sign."""
        traced = self.traced
        towards = target - traced.origin
        across = towards[:, 0] * traced.direction[:, 1] - towards[:, 1] * traced.direction[:, 0]
        ahead = np.sum(towards * traced.direction, axis=1) > 0.0
        usable = traced.valid[1:] & traced.valid[:-1] & ahead[1:] & ahead[:-1]
        crossing = usable & (np.sign(across[1:]) != np.sign(across[:-1]))
        return self.directions[1:][crossing]


@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
@pytest.mark.parametrize(
    ("radius", "ior", "path"),
    [
        ((0.04, 0.037), (1.5, 1.333), "TTTT"),
        ((0.04,), (1.5,), "TT"),
        ((0.04, 0.037), (1.5, 1.0), "TTTT"),
        ((0.04, 0.037), (1.5, 1.0), "TRT"),
        ((0.04, 0.037), (1.5, 1.0), "TTRTT"),
        ((0.04, 0.037), (1.5, 1.333), "TTTRTTT"),
        ((0.04,), (1.5,), "TRT"),
        ((0.04,), (1.5,), "R"),
        ((0.04, 0.02), (1.5, 1.0), "TT"),
    ],
)
def test_dense_scan_finds_the_same_images(shape, radius, ior, path):
    """In the plane through eye and axis the number of images is known from 40,000 rays."""
    rng = np.random.default_rng(5)
    glass, eye = shape(radius, ior), np.array([0.3, 0.05, 0.0])
    points = np.column_stack([rng.uniform(-0.5, 0.5, (60, 2)), np.zeros(60)])
    points = points[np.hypot(*points[:, :2].T) > 0.05]
    apparent = optics.apparent_points(glass, path, eye, points)
    scan, counted = DenseScan(glass, eye, path), 0
    for number, point in enumerate(points):
        scanned = scan.images(point)
        shown = apparent.valid[:, number] & (apparent.stretch == len(path))
        mine = apparent.direction[shown, number]
        counted += len(mine)
        assert len(mine) == len(scanned)
        for direction in scanned:
            assert np.linalg.norm(mine - direction, axis=1).min() < 2.0 * scan.step
    assert counted > 5


def test_three_images_behind_a_filled_glass():
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
    apparent = optics.apparent_points(glass, "TTTT", (1.0, 0.0, 0.0), [[-0.07, 0.001, 0.0]])
    assert apparent.valid[:, 0].sum() == 3


def test_slots_are_smooth_over_a_fine_grid():
    """Within a slot neighbours stay neighbours: no jump from sheet to sheet."""
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
    across = np.linspace(-0.03, 0.03, 4001)
    points = np.column_stack([np.full(4001, -0.07), across, np.full(4001, 0.01)])
    apparent = optics.apparent_points(glass, "TTTT", (0.8, 0.0, 0.1), points)
    assert len(apparent.stretch) == 3
    steps = np.linalg.norm(np.diff(apparent.direction, axis=1), axis=2)
    both = apparent.valid[:, 1:] & apparent.valid[:, :-1]
    # Towards a fold an image moves as a square root: at most some 0.1 rad · √(1/2000).
    assert steps[both].max() < 3e-3
    # A point without an image waits at the fold: the step over it is as small.
    assert steps.max() < 6e-3


def test_points_on_interfaces_are_seen():
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
    eye = np.array([0.5, 0.0, 0.0])
    angle = np.linspace(-0.3, 0.3, 7)
    for radius in glass.radius:
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(7, 0.01)])
        apparent = optics.apparent_points(glass, "TTTT", eye, points)
        assert apparent.valid.any(axis=0).all()
    slab = optics.FlatGlass((0.01,), (1.5,))
    points = np.array([[0.1, 0.0, 0.0], [0.1, 0.0, -0.01]])
    assert optics.apparent_points(slab, "TT", (0.0, 0.0, 1.0), points).valid.any(axis=0).all()


def test_stretches_of_a_cavity_a_wall_and_behind():
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
    eye = (0.5, 0.0, 0.02)
    points = np.array([[0.0, 0.01, 0.0], [-0.2, 0.01, 0.0], [0.0385, 0.0, 0.0], [-0.0385, 0, 0]])
    apparent = optics.apparent_points(glass, "TTTT", eye, points)
    seen = {
        number: sorted(apparent.stretch[apparent.valid[:, number]].tolist()) for number in range(4)
    }
    assert seen == {0: [2], 1: [4], 2: [1], 3: [3]}


@pytest.mark.parametrize("path", ["TTTT", "TRT", "TTRTT"])
@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
def test_position_distance_and_reversal(shape, path):
    """position = eye + distance · direction, and the way back from the point reaches the eye."""
    rng = np.random.default_rng(2)
    glass = shape((0.04, 0.037), (1.5, 1.0))
    eye = np.array([0.4, 0.1, 0.05])
    points = rng.uniform(-0.3, 0.3, (400, 3))
    apparent = optics.apparent_points(glass, path, eye, points)
    np.testing.assert_allclose(
        apparent.position,
        eye + apparent.distance[..., None] * apparent.direction,
        atol=1e-14,
    )
    np.testing.assert_allclose(np.linalg.norm(apparent.direction, axis=-1), 1.0, atol=1e-14)
    for slot in np.flatnonzero(apparent.stretch == len(path)):
        shown = apparent.valid[slot]
        taken, pieces = segments(glass, eye, apparent.direction[slot, shown], path)
        back = optics.trace(glass, points[shown][taken], -pieces[-1][1], path[::-1])
        usable = back.valid
        towards = eye - back.origin[usable]
        miss = np.linalg.norm(np.cross(towards, back.direction[usable]), axis=1)
        assert usable.mean() > 0.95  # a point in front of the glass may not see it
        assert np.median(miss) < 1e-10 and miss.max() < 1e-7


def test_bounded_glasses_lose_images_but_not_positions():
    eye = np.array([0.5, 0.0, 0.06])
    rng = np.random.default_rng(4)
    points = np.add(rng.uniform(-0.05, 0.05, (500, 3)), (-0.2, 0.0, 0.06))
    free = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
    cut = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.05, 0.07))
    whole = optics.apparent_points(free, "TTTT", eye, points)
    part = optics.apparent_points(cut, "TTTT", eye, points)
    np.testing.assert_array_equal(whole.position, part.position)
    traced = optics.trace(cut, eye, whole.direction[0], "TTTT")
    np.testing.assert_array_equal(traced.valid, part.valid[0])
    assert 0 < part.valid.sum() < whole.valid.sum()

    star = [
        (np.cos(a) * r, np.sin(a) * r)
        for a, r in zip(np.linspace(0, 2 * np.pi, 10, endpoint=False), [1.0, 0.4] * 5, strict=True)
    ]
    pane, open_pane = (
        optics.FlatGlass((0.2,), (1.5,), outline=star),
        optics.FlatGlass((0.2,), (1.5,)),
    )
    points = rng.uniform(-2.0, 2.0, (800, 3)) * (1, 1, 0.2) - (0, 0, 1.0)
    whole = optics.apparent_points(open_pane, "TT", (0.1, 0.2, 1.5), points)
    part = optics.apparent_points(pane, "TT", (0.1, 0.2, 1.5), points)
    np.testing.assert_array_equal(whole.position, part.position)
    traced = optics.trace(pane, (0.1, 0.2, 1.5), whole.direction[0], "TT")
    np.testing.assert_array_equal(traced.valid, part.valid[0])
    assert 0 < part.valid.sum() < whole.valid.sum()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_million_random_cases(kind):
    """Reprojection of every valid image over random glasses: 10⁶ cases in all."""
    worst, cases = 0.0, 0
    for seed in range(10_000):
        rng = np.random.default_rng([seed, KINDS.index(kind), 9])
        glass, eye = random_glass(rng, kind)
        points = rng.normal(size=(2000, 3)) * 10.0 ** rng.uniform(-1, 1, (2000, 1))
        for path in optics.light_paths(glass, eye, min_weight=0.05)[:3]:
            apparent = optics.apparent_points(glass, path, eye, points)
            false, miss = false_images(glass, path.events, eye, points, apparent)
            assert false == 0
            worst, cases = max(worst, miss), cases + int(apparent.valid.sum())
        if cases > 333_334:
            break
    print(f"{kind}: {cases} images, worst {worst / PIXEL:.2e} px")
    assert worst <= 1e-6 * PIXEL
