# SPDX-License-Identifier: GPL-3.0-or-later
"""Cases at the limits of geometry and of floating point: never NaN, never a warning."""

import numpy as np
import pytest
from rays import false_images, missing_images, seen_points, segments

from glass_refraction import optics

PIXEL = 1.0 / 2400.0
HOLLOW = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
FILLED = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
BALL = optics.SphereGlass((0.04,), (1.5,))
BUBBLE = optics.SphereGlass((0.04, 0.037), (1.5, 1.0))
SLAB = optics.FlatGlass((0.01,), (1.5,))
EYE = np.array([0.5, 0.02, 0.1])


def cloud(count=200, seed=0, centre=(-0.2, -0.008, -0.04), size=0.1):
    return np.random.default_rng(seed).uniform(-size, size, (count, 3)) + centre


def proper(apparent):
    """Finite everywhere, unit directions, the shapes of the contract."""
    slots, count = apparent.valid.shape
    assert slots >= 1 and apparent.stretch.shape == (slots,)
    assert apparent.direction.shape == apparent.position.shape == (slots, count, 3)
    assert apparent.distance.shape == apparent.residual.shape == (slots, count)
    for field in ("direction", "distance", "position", "residual"):
        assert np.isfinite(getattr(apparent, field)).all(), field
    np.testing.assert_allclose(np.linalg.norm(apparent.direction, axis=-1), 1.0, atol=1e-12)
    return apparent


def checked(glass, path, eye, points, worst=1e-6 * PIXEL):
    apparent = proper(optics.apparent_points(glass, path, eye, points))
    false, miss = false_images(glass, path, np.asarray(eye, dtype=float), points, apparent)
    assert false == 0
    assert miss <= worst
    return apparent


@pytest.mark.parametrize(
    ("glass", "path"),
    [
        (optics.CylinderGlass((0.04, 0.037), (1.0, 1.0)), "TTTT"),
        (optics.CylinderGlass((0.04,), (1.0,)), "TT"),
        (optics.SphereGlass((0.04, 0.037), (1.0, 1.0)), "TTTT"),
        (optics.FlatGlass((0.01, 0.02), (1.0, 1.0)), "TTT"),
        (optics.CylinderGlass((0.04, 0.03), (1.333, 1.333), ior_outside=1.333), "TTTT"),
    ],
)
def test_equal_media_are_the_identity(glass, path):
    points = cloud(size=0.01)
    if isinstance(glass, optics.FlatGlass):
        points, eye = points - [0.0, 0.0, 0.3], np.array([0.1, 0.0, 0.2])
    else:
        eye = EYE
    apparent = checked(glass, path, eye, points)
    assert apparent.valid[-1].mean() > 0.9
    shown = apparent.valid[-1]
    np.testing.assert_allclose(apparent.position[-1][shown], points[shown], atol=1e-12)


@pytest.mark.parametrize("ior", [1.0 + 1e-9, 1.0 + 1e-6, 2.417])
@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
def test_weak_and_strong_glass(shape, ior):
    apparent = checked(shape((0.04, 0.037), (ior, 1.0)), "TTTT", EYE, cloud(size=0.02))
    assert apparent.valid[-1].any()
    checked(shape((0.04,), (ior,)), "TT", EYE, cloud(size=0.02))
    checked(optics.FlatGlass((0.01,), (ior,)), "TT", (0, 0, 1.0), cloud(centre=(0, 0, -1)))


@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
def test_wall_of_a_millionth(shape):
    glass = shape((0.04, 0.04 * (1.0 - 1e-6)), (1.5, 1.0))
    apparent = checked(glass, "TTTT", EYE, cloud(size=0.02))
    assert apparent.valid[-1].all()
    np.testing.assert_allclose(apparent.position[-1], cloud(size=0.02), atol=1e-5)


def test_grazing_rays():
    angle = np.radians(89.99)
    eye = np.array([0.0, 0.0, 0.1])
    points = np.array([[0.1 * np.tan(angle) * 2.0, 0.0, -0.1], [5.0, 5.0, -0.02]])
    assert checked(SLAB, "TT", eye, points).valid.all()
    for glass in (HOLLOW, FILLED, BALL):
        impact = 0.04 * np.sin(angle)
        start = np.array([0.5, 0.0, 0.0])
        sine = impact / 0.5
        aim = np.array([[-np.sqrt(1.0 - sine * sine), sine, 0.0]])
        for path in optics.light_paths(glass, start)[:4]:
            traced = optics.trace(glass, start, aim, path)
            if traced.valid[0]:
                point = traced.origin + 0.1 * traced.direction
                apparent = checked(glass, path.events, start, point)
                off = np.linalg.norm(apparent.direction[:, 0] - aim[0], axis=1)
                assert off[apparent.valid[:, 0]].min() < 1e-9
    steep = np.array([[-0.1, 0.01, 0.3 * np.tan(angle)]])
    assert checked(HOLLOW, "TTTT", (0.2, 0.0, 0.0), steep, 1e-4 * PIXEL).valid.any()


@pytest.mark.parametrize("glass", [HOLLOW, FILLED, BALL])
def test_eyes_in_awkward_places(glass):
    points = np.concatenate([cloud(25), cloud(25, size=0.03, centre=(0, 0, 0))])
    radius = glass.radius
    places = [radius[0] + 1e-6, 0.0, radius[-1] * 0.5, 1e-12, radius[0], radius[-1]]
    if len(radius) > 1:
        places.append(0.5 * (radius[0] + radius[1]))
    for away in places:
        eye = np.array([away, 0.0, 0.01 if glass is not BALL else 0.0])
        for path in optics.light_paths(glass, eye, min_weight=0.05)[:3]:
            checked(glass, path.events, eye, points, 1e-5 * PIXEL)


def test_points_in_awkward_places():
    for glass, path in ((HOLLOW, "TTTT"), (FILLED, "TTTT"), (BALL, "TT")):
        points = np.array(
            [
                [0.0, 0.0, 0.0],
                [0.0, 0.0, 0.02],
                [0.037, 0.0, 0.01],
                [-0.04, 0.0, 0.01],
                [-1e6, 1e3, 10.0],
                [-1e6, 0.0, 1e6],
                [0.04, 0.0, 0.0],
                EYE,
            ]
        )
        apparent = checked(glass, path, EYE, points)
        assert apparent.valid[:, 4].any()
    assert checked(SLAB, "TT", (0, 0, 1.0), np.array([[1e6, 0, -1e6], [0, 0, -1e6]])).valid.all()


@pytest.mark.parametrize("size", [1e-6, 1e6])
@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
def test_size_does_not_matter(shape, size):
    points = cloud() * size / 0.04
    small = optics.apparent_points(shape((0.04, 0.037), (1.5, 1.333)), "TTTT", EYE, cloud())
    glass = shape((size, 0.925 * size), (1.5, 1.333))
    large = proper(optics.apparent_points(glass, "TTTT", EYE * size / 0.04, points))
    np.testing.assert_array_equal(small.valid, large.valid)
    np.testing.assert_allclose(small.direction, large.direction, atol=1e-9)
    slab = optics.FlatGlass((size,), (1.5,))
    assert checked(slab, "TT", (0, 0, size), cloud() * size - [0, 0, 3 * size]).valid.all()


def test_far_from_the_origin():
    far = np.array([1e5, -1e5, 0.0])
    points = cloud(centre=(0.1, 0.0, -0.5))
    near = optics.apparent_points(SLAB, "TT", (0.0, 0.0, 0.3), points)
    moved = proper(optics.apparent_points(SLAB, "TT", np.add(far, (0.0, 0.0, 0.3)), points + far))
    np.testing.assert_allclose(moved.direction, near.direction, atol=1e-9)
    high = np.array([0.0, 0.0, 1e5])
    near = optics.apparent_points(HOLLOW, "TTTT", EYE, cloud())
    moved = proper(optics.apparent_points(HOLLOW, "TTTT", EYE + high, cloud() + high))
    np.testing.assert_allclose(moved.direction, near.direction, atol=1e-9)


def test_beside_a_caustic():
    """From the fold to either side: two images, or none, never a false one."""
    eye = np.array([0.8, 0.0, 0.1])
    low, high = 0.0, 0.03

    def images(across):
        points = np.array([[-0.07, across, 0.01]])
        return int(checked(FILLED, "TTTT", eye, points).valid.sum())

    assert images(low) == 3 and images(high) == 1
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if images(middle) == 3 else (low, middle)
    for gap in (1e-12, 1e-9, 1e-6, 1e-3):
        assert images(low - gap) == 3
        assert images(low + gap) == 1


def test_no_point_one_point_and_broken_points():
    for glass, path, eye in (
        (HOLLOW, "TTTT", EYE),
        (FILLED, "TTTT", EYE),
        (BALL, "TRT", EYE),
        (SLAB, "TT", (0.0, 0.0, 1.0)),
        (HOLLOW, "TTTT", optics.ParallelView((-1.0, 0.0, 0.1))),
        (HOLLOW, "", EYE),
        (HOLLOW, "RRRR", EYE),
    ):
        empty = proper(optics.apparent_points(glass, path, eye, np.zeros((0, 3))))
        assert empty.valid.shape[1] == 0
        points = cloud(100) - ((0.0, 0.0, 0.5) if glass is SLAB else (0.0, 0.0, 0.0))
        whole = proper(optics.apparent_points(glass, path, eye, points))
        again = optics.apparent_points(glass, path, eye, points)
        mixed = points.copy()
        broken = [3, 50, 99]
        mixed[broken] = [[np.nan, 0, 0], [np.inf, 0, 0], [0, -np.inf, np.nan]]
        part = proper(optics.apparent_points(glass, path, eye, mixed))
        good = np.setdiff1d(np.arange(100), broken)
        assert not part.valid[:, broken].any()
        for field in ("direction", "distance", "position", "valid", "residual"):
            first, second = getattr(whole, field), getattr(part, field)
            np.testing.assert_array_equal(first, getattr(again, field))
            np.testing.assert_array_equal(first[:, good], second[:, good])
        one = proper(optics.apparent_points(glass, path, eye, points[:1]))
        assert one.valid[:, 0].sum() == whole.valid[:, 0].sum()


def test_float32_lists_and_other_inputs():
    points = cloud(50).astype(np.float32)
    single = optics.apparent_points(HOLLOW, "TTTT", EYE, points)
    double = optics.apparent_points(HOLLOW, "TTTT", EYE, points.astype(float))
    np.testing.assert_array_equal(single.direction, double.direction)
    listed = optics.apparent_points(HOLLOW, optics.LightPath("TTTT"), EYE.tolist(), points.tolist())
    np.testing.assert_array_equal(single.direction, listed.direction)
    turned = np.asfortranarray(points.astype(float))
    strided = optics.apparent_points(HOLLOW, "TTTT", EYE, turned)
    np.testing.assert_array_equal(single.direction, strided.direction)


@pytest.mark.parametrize("tolerance", [1e-9, 4e-7, 2e-5])
@pytest.mark.parametrize("glass", [HOLLOW, FILLED, BALL, BUBBLE])
def test_guesses_change_nothing(glass, tolerance):
    path = "TT" if glass is BALL else "TTTT"
    points = cloud(3000)
    truth = optics.apparent_points(glass, path, EYE, points)
    rng = np.random.default_rng(0)

    def garbage(values):
        return optics.ApparentPoints(
            values,
            truth.distance,
            truth.position,
            truth.valid,
            truth.residual,
            truth.stretch,
            0,
            truth.sheet,
        )

    shape = truth.direction.shape
    last_frame = optics.apparent_points(glass, path, EYE, points + 0.001)
    for guess in (
        None,
        truth,
        last_frame,
        garbage(rng.normal(size=shape)),
        garbage(np.full(shape, np.nan)),
        garbage(np.full(shape, 1e300)),
        garbage(np.zeros(shape)),
    ):
        found = proper(
            optics.apparent_points(glass, path, EYE, points, tolerance=tolerance, guess=guess)
        )
        np.testing.assert_array_equal(found.valid, truth.valid)
        off = np.linalg.norm(found.direction - truth.direction, axis=-1)[truth.valid]
        assert off.max() <= max(tolerance, 1e-9)


@pytest.mark.parametrize("glass", [HOLLOW, FILLED, BALL, SLAB])
def test_parallel_view_against_a_far_eye(glass):
    direction = np.array([-0.8, 0.1, -0.59])
    view = optics.ParallelView(direction)
    direction = np.asarray(view.direction)
    paths = ("TT", "R", "TRT") if glass in (BALL, SLAB) else ("TTTT", "R", "TRT")
    points = cloud(300, centre=(-0.15, 0.02, -0.15))
    away = 1e6
    for path in paths:
        parallel = proper(optics.apparent_points(glass, path, view, points))
        far = proper(optics.apparent_points(glass, path, -away * direction, points))
        assert (parallel.direction == direction).all()
        assert parallel.sheet == far.sheet
        same = parallel.valid & far.valid
        assert (parallel.valid != far.valid).mean() < 0.01
        np.testing.assert_allclose(parallel.position[same], far.position[same], atol=1e-5)
        np.testing.assert_allclose(parallel.distance[same], far.distance[same] - away, atol=1e-5)
        # Exactly: the ray from in front of the glass along the view passes the point.
        for slot in np.flatnonzero(parallel.stretch == len(path)):
            shown = parallel.valid[slot]
            start = parallel.position[slot, shown] - 2.0 * direction
            start -= ((start @ direction) + 2.0)[:, None] * direction
            traced = optics.trace(glass, start, np.broadcast_to(direction, start.shape), path)
            assert traced.valid.all()
            towards = points[shown] - traced.origin
            miss = np.linalg.norm(np.cross(towards, traced.direction), axis=1)
            along = traced.length + np.sum(towards * traced.direction, axis=1)
            assert miss.max(initial=0.0) < 1e-9
            np.testing.assert_allclose(along - 2.0, parallel.distance[slot, shown], atol=1e-9)


def test_parallel_views_along_and_across_the_axis():
    for direction in ((0, 0, -1), (0, 0, 1), (1, 0, 0), (0, 1, 1e-9)):
        view = optics.ParallelView(direction)
        for glass, path in ((HOLLOW, "TTTT"), (FILLED, "TTTT"), (BALL, "TT"), (SLAB, "TT")):
            proper(optics.apparent_points(glass, path, view, cloud()))
            optics.light_paths(glass, view)


@pytest.mark.parametrize("path", ["TTTT", "TRT", "TTRTT", "TTTRTTT"])
def test_rays_that_graze_an_interface(path):
    """Points met by rays within 1e-10 to 1e-2 of grazing: what is shown is right to 1e-6 px.

    Nearer than about 1e-6 the last digit of the direction decides where the ray ends: such an
    image is not shown, though it keeps its position.
    """
    rng = np.random.default_rng([4, len(path)])
    shown = 0
    for wall, core, far in ((1.24, 1.0, 1.05), (2.3, 1.333, 3.4), (1.7, 1.0, 90.0)):
        glass = optics.CylinderGlass((1.0, 0.8), (wall, core))
        eye = np.array([far, 0.0, 0.1])
        limit = min(1.0, 0.8 * core, 0.8 * wall)
        grazing = 10.0 ** rng.uniform(-10.0, -2.0, 100)
        impact = limit * np.sqrt(1.0 - grazing**2) * rng.choice([-1.0, 1.0], 100)
        if path == "TRT":
            impact = limit * np.sqrt(1.0 + grazing**2)
        sine = np.minimum(impact / far, 1.0)
        aims = np.stack([-np.sqrt(1.0 - sine**2), sine, np.zeros(100)], axis=1)
        for stretch in range(1, len(path) + 1):
            points, _ = seen_points(rng, glass, eye, aims, path, stretch)
            apparent = optics.apparent_points(glass, path, eye, points)
            for slot, at in enumerate(apparent.stretch):
                seen = np.flatnonzero(apparent.valid[slot])
                taken, pieces = segments(glass, eye, apparent.direction[slot, seen], path)
                assert len(taken) == len(seen)
                origin, direction, *_ = pieces[at]
                miss = np.linalg.norm(np.cross(points[seen] - origin, direction), axis=1)
                assert (miss <= 4e-10 * apparent.distance[slot, seen]).all()
                shown += len(seen)
    assert shown > 100


@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
@pytest.mark.parametrize("path", ["TTTT", "TRT", "TTRTT"])
def test_images_within_a_ten_thousandth_of_grazing_are_reported(shape, path):
    """Cosines from 1e-5 to 1e-4 at an interface: nearly every known image is shown, and what is
    shown passes its point."""
    rng = np.random.default_rng([5, len(path)])
    known = lost = 0
    for wall, core, inner, far in ((1.5, 1.0, 0.925, 12.0), (1.9, 1.333, 0.8, 40.0)):
        glass = shape((1.0, inner), (wall, core))
        eye = np.array([far, 0.0, 0.0])
        grazing = 10.0 ** rng.uniform(-5.0, -4.0, 150)
        limits = np.array([1.0, inner * core, inner * wall])
        impact = rng.choice(limits, 150) * rng.choice([-1.0, 1.0], 150)
        impact *= np.sqrt(1.0 + rng.choice([-1.0, 1.0], 150) * grazing**2)
        sine = impact / far
        aims = np.stack([-np.sqrt(1.0 - sine**2), sine, np.zeros(150)], axis=1)
        for stretch in range(1, len(path) + 1):
            points, seen = seen_points(rng, glass, eye, aims, path, stretch)
            if not len(points):
                continue
            apparent = optics.apparent_points(glass, path, eye, points)
            known += len(points)
            lost += missing_images(seen, stretch, apparent)
            for slot, at in enumerate(apparent.stretch):
                shown = np.flatnonzero(apparent.valid[slot])
                taken, pieces = segments(glass, eye, apparent.direction[slot, shown], path)
                assert len(taken) == len(shown)
                origin, direction, *_ = pieces[at]
                miss = np.linalg.norm(np.cross(points[shown] - origin, direction), axis=1)
                assert (miss <= 4e-10 * apparent.distance[slot, shown]).all()
    assert known > 100
    assert lost <= 0.005 * known


@pytest.mark.parametrize("tolerance", [1e-9, 4e-7, 2e-5])
@pytest.mark.parametrize("glass", [SLAB, HOLLOW, BUBBLE])
def test_a_point_at_the_eye_disturbs_no_other(glass, tolerance):
    behind = cloud(4)
    points = np.concatenate((EYE[None], behind))
    for path in ("TTTT", "TT", "R", "TRT"):
        alone = optics.apparent_points(glass, path, EYE, behind, tolerance=tolerance)
        found = optics.apparent_points(glass, path, EYE, points, tolerance=tolerance)
        proper(found)
        for slot, sheet in enumerate(alone.sheet):
            some = alone.valid[slot]
            if some.any():
                here = found.sheet.index(sheet)
                assert found.valid[here, 1:][some].all()
                np.testing.assert_allclose(
                    found.direction[here, 1:][some], alone.direction[slot, some], atol=tolerance
                )


@pytest.mark.parametrize("height", [1e5, 1e7, 1e9])
@pytest.mark.parametrize("eye", [(0.3, 0.05, 0.02), (0.0, -0.5, 0.1)])
def test_points_far_along_the_axis_have_no_false_images(height, eye):
    """Rays next to the axis' direction keep too few digits to meet them: none are shown then."""
    points = np.array([(0.0, 0.0, height), (0.0, 0.0, -height)])
    for path in ("TTTT", "TTRTT", "R"):
        apparent = optics.apparent_points(HOLLOW, path, eye, points)
        assert (apparent.residual[apparent.valid] < 1e-8 * height).all()


@pytest.mark.parametrize("core", [1.0, 1.333])
@pytest.mark.parametrize("exponent", [-5, -4, -3])
def test_points_far_along_the_axis_are_seen_as_long_as_digits_last(core, exponent):
    rng = np.random.default_rng(3)
    glass, eye = optics.CylinderGlass((0.04, 0.037), (1.5, core)), np.array([0.3, 0.05, 0.02])
    across = 10.0 ** (exponent + rng.random(500))
    azimuth = np.arctan2(-eye[1], -eye[0]) + rng.uniform(-0.12, 0.12, 500)
    flat = across[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    directions = np.column_stack([flat, np.sqrt(1.0 - across**2)])
    for stretch in (2, 4):
        points, seen = seen_points(rng, glass, eye, directions, "TTTT", stretch)
        apparent = optics.apparent_points(glass, "TTTT", eye, points)
        assert missing_images(seen, stretch, apparent) == 0


@pytest.mark.parametrize("off", [0.0, 1e-17, 1e-14, 1e-10, 1e-6])
@pytest.mark.parametrize(
    "glass",
    [
        optics.CylinderGlass((0.04,), (2.1,)),
        optics.CylinderGlass((0.04, 0.037), (1.5, 1.0)),
        optics.CylinderGlass((0.04, 0.037), (1.5, 1.333)),
    ],
)
def test_an_eye_on_the_axis_sees_all_round(glass, off):
    """Rays across the line from the axis to the eye are like any other."""
    rng = np.random.default_rng(4)
    eye, path = np.array([off, 0.0, 0.01]), "T" * len(glass.radius)
    lean = 10.0 ** rng.uniform(-5.0, 0.0, 400) * rng.choice([-1.0, 1.0], 400)
    azimuth = 0.5 * np.pi * rng.choice([-1.0, 1.0], 400) + lean
    height = rng.uniform(-0.45, 0.45, 400)
    flat = np.sqrt(1.0 - height**2)
    directions = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height])
    for stretch in range(1, len(path) + 1):
        points, seen = seen_points(rng, glass, eye, directions, path, stretch)
        apparent = optics.apparent_points(glass, path, eye, points)
        assert missing_images(seen, stretch, apparent) == 0
        count, worst = false_images(glass, path, eye, points, apparent)
        assert count == 0 and worst < 1e-9


@pytest.mark.parametrize("far", [1e120, 1e155, 1e300, np.inf, np.nan])
def test_what_lies_too_far_for_its_square_has_no_image(far):
    """The point beside it has the image that it has alone, to the bit."""
    glasses = (
        (optics.FlatGlass((0.01,), (1.5,)), "TT"),
        (optics.CylinderGlass((0.04, 0.03), (1.5, 1.0)), "TTTT"),
    )
    eye, near = (0.0, -0.5, 0.1), (0.01, 0.3, -0.2)
    for glass, path in glasses:
        alone = optics.apparent_points(glass, path, eye, [near])
        for axis in np.eye(3):
            point = np.where(axis > 0.0, far, 0.0)
            both = optics.apparent_points(glass, path, eye, [point, near])
            assert not both.valid[:, 0].any()
            np.testing.assert_array_equal(both.position[:, 1], alone.position[:, 0])
