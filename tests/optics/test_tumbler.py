# SPDX-License-Identifier: GPL-3.0-or-later
"""A tumbler against a tracer of its own: none missing, none false, every image at its place."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.optics import LightPath, Tumbler

PIXEL = 1.0 / 2400.0
PENCIL = Tumbler(0.04, 0.003, 0.12, 0.008, 1.5, 1.333, 0.07)


class Plain:
    """Rays through a tumbler by vectors, one surface after the other: all crossings with all
    surfaces are computed, the nearest counts. It knows the glass's public fields only."""

    def __init__(self, glass):
        inner, floor = glass.radius - glass.wall, glass.bottom
        level = floor + (glass.level or 0.0)
        wet = bool(glass.level)
        inside = glass.liquid_ior if wet else glass.ior_outside
        air, solid = glass.ior_outside, glass.ior
        # name, kind, place, from, to, ior in front (outside or above), ior behind
        self.surfaces = [
            ("outer", "wall", glass.radius, 0.0, glass.height, air, solid),
            ("base", "level", 0.0, 0.0, glass.radius, solid, air),
            ("floor", "level", floor, 0.0, inner, inside, solid),
            ("rim", "level", glass.height, inner, glass.radius, air, solid),
        ]
        if wet:
            self.surfaces.append(("wet", "wall", inner, floor, level, solid, inside))
            self.surfaces.append(("surface", "level", level, 0.0, inner, air, inside))
        if level < glass.height * (1.0 - 1e-9):
            self.surfaces.append(("dry", "wall", inner, level, glass.height, solid, air))
        self.small = 1e-8 * glass.radius

    def meet(self, origin, direction):
        """Number of the nearest surface (−1: none) and the way to it."""
        met = np.full(len(origin), -1)
        least = np.full(len(origin), np.inf)
        with np.errstate(all="ignore"):
            for number, (_, kind, place, low, high, _, _) in enumerate(self.surfaces):
                if kind == "level":
                    ways = [(place - origin[:, 2]) / direction[:, 2]]
                else:
                    a = np.sum(direction[:, :2] ** 2, axis=1)
                    b = np.sum(origin[:, :2] * direction[:, :2], axis=1)
                    c = np.sum(origin[:, :2] ** 2, axis=1) - place**2
                    root = np.sqrt(b * b - a * c)
                    ways = [(-b - root) / a, (-b + root) / a]
                for way in ways:
                    point = origin + way[:, None] * direction
                    along = point[:, 2] if kind == "wall" else np.hypot(*point[:, :2].T)
                    hit = (way > self.small) & (way < least) & (along >= low) & (along <= high)
                    least, met = np.where(hit, way, least), np.where(hit, number, met)
        return met, least

    def follow(self, origin, direction, path):
        """Rays that take a path whole: their indices, and for each stretch its beginnings,
        directions, lengths so far and lengths of its own; and their weight."""
        direction = direction / np.linalg.norm(direction, axis=1)[:, None]
        origin = np.broadcast_to(origin, direction.shape)
        index, length = np.arange(len(direction)), np.zeros(len(direction))
        weight, pieces = np.ones(len(direction)), []
        names = [surface[0] for surface in self.surfaces]
        for name, event in zip(path.interfaces, path.events, strict=True):
            met, way = self.meet(origin, direction)
            keep = met == names.index(name)
            pieces = [tuple(part[keep] for part in piece) for piece in pieces]
            index, origin, direction, length, way, weight = (
                part[keep] for part in (index, origin, direction, length, way, weight)
            )
            pieces.append((origin, direction, length, way))
            _, kind, place, _, _, front, behind = self.surfaces[names.index(name)]
            point = origin + way[:, None] * direction
            normal = np.zeros_like(point)
            if kind == "wall":
                normal[:, :2] = point[:, :2] / place
            else:
                normal[:, 2] = 1.0
            outward = np.sum(direction * normal, axis=1) > 0.0
            normal[outward] *= -1.0
            eta = np.where(outward, behind / front, front / behind)
            share = optics.fresnel(np.sum(direction * normal, axis=1), eta)
            if event == "R":
                direction, keep = optics.reflect(direction, normal), share > 0.0
            else:
                share = 1.0 - share
                direction, total = optics.refract(direction, normal, eta)
                keep = ~total
            origin, length, weight = point, length + way, weight * share
            pieces = [tuple(part[keep] for part in piece) for piece in pieces]
            index, origin, direction, length, weight = (
                part[keep] for part in (index, origin, direction, length, weight)
            )
        met, way = self.meet(origin, direction)
        keep = met < 0
        pieces.append((origin, direction, length, way))
        return index[keep], [tuple(part[keep] for part in piece) for piece in pieces], weight[keep]


def random_tumbler(rng):
    radius = 10.0 ** rng.uniform(-2, 0)
    height = radius * rng.uniform(0.5, 4.0)
    bottom = height * rng.uniform(0.02, 0.3)
    level = rng.choice([None, 0.0, 0.3, 0.7, 1.0])
    return Tumbler(
        radius,
        radius * rng.uniform(0.02, 0.4),
        height,
        bottom,
        rng.uniform(1.3, 1.9),
        rng.uniform(1.1, 1.6),
        None if level is None else level * (height - bottom),
    )


def random_eye(rng, glass):
    """In front, above, below, inside."""
    kind = rng.integers(0, 4)
    if kind == 3:
        radius = (glass.radius - glass.wall) * rng.uniform(0.0, 0.95)
        z = rng.uniform(glass.bottom, glass.height)
    else:
        radius = glass.radius * (rng.uniform(1.1, 15.0) if kind else rng.uniform(0.0, 3.0))
        z = glass.height * rng.uniform(-0.5, 1.5) if kind else glass.height * rng.uniform(1.1, 8.0)
        if kind == 2:
            z = -glass.height * rng.uniform(0.1, 5.0)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([radius * np.cos(angle), radius * np.sin(angle), z])


def aimed(rng, glass, eye, count):
    """Directions at places all over the glass."""
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    radius = glass.radius * np.sqrt(rng.uniform(0.0, 1.0, count))
    z = glass.height * rng.uniform(-0.02, 1.02, count)
    places = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    return places - eye


def false_images(glass, path, eye, points, apparent):
    """Number of valid images whose ray, traced by the plain way, does not pass its point on its
    stretch at the distance told, and the largest miss as an angle at the eye."""
    plain, false, worst = Plain(glass), 0, 0.0
    for slot, stretch in enumerate(apparent.stretch):
        shown = np.flatnonzero(apparent.valid[slot])
        if not len(shown):
            continue
        taken, pieces, _ = plain.follow(eye, apparent.direction[slot, shown], path)
        false += len(shown) - len(taken)
        origin, direction, length, reach = pieces[stretch]
        towards = points[shown[taken]] - origin
        along = np.sum(towards * direction, axis=1)
        miss = np.linalg.norm(towards - along[:, None] * direction, axis=1)
        distance = apparent.distance[slot, shown[taken]]
        # From very far an angle no longer tells how far a ray passes by, nor from very near.
        worst = max(worst, float((miss / np.maximum(distance, glass.radius)).max(initial=0.0)))
        edge = 1e-7 * (distance + glass.radius)
        false += int(np.sum((along < -edge) | (along > reach + edge)))
        false += int(np.sum(np.abs(length + along - distance) > 1e-8 * (distance + glass.radius)))
    return false, worst


@pytest.mark.parametrize("seed", range(12))
def test_every_path_and_stretch_of_random_tumblers(seed):
    """Points picked on plainly traced rays must be seen along just these rays; whatever else is
    reported must trace back to its point."""
    rng = np.random.default_rng([seed, 606])
    glass = random_tumbler(rng)
    eye = random_eye(rng, glass)
    known = missing = 0
    for path in optics.light_paths(glass, eye, min_weight=0.05)[:6]:
        directions = aimed(rng, glass, eye, 4000)
        taken, pieces, _ = Plain(glass).follow(eye, directions, path)
        if len(taken) < 40:
            continue  # a region this thin is less than a hundredth of the glass
        unit = directions[taken] / np.linalg.norm(directions[taken], axis=1)[:, None]
        for stretch in range(1, len(path) + 1):
            origin, direction, _, length = pieces[stretch]
            some = rng.permutation(len(taken))[:150]
            far = glass.radius * 10.0 ** rng.uniform(-1.5, 1.0, len(some))
            reach = np.where(np.isfinite(length[some]), length[some], far)
            along = rng.uniform(0.001, 0.999, len(some)) * reach
            points = origin[some] + along[:, None] * direction[some]
            apparent = optics.apparent_points(glass, path, eye, points)
            off = np.linalg.norm(apparent.direction - unit[some], axis=2)
            off = np.where(apparent.valid & (apparent.stretch == stretch)[:, None], off, np.inf)
            known += len(some)
            missing += int(np.sum(off.min(axis=0) > 1e-6))
            false, worst = false_images(glass, path, eye, points, apparent)
            assert false == 0
            assert worst <= 1e-6 * PIXEL
    assert known > 300
    assert missing == 0


def cloud(rng, size, count, middle):
    """Points (N, 3) in a cube round a place."""
    return np.add(rng.uniform(-size, size, (count, 3)), middle)


def wall_paths(*names_of_events):
    return LightPath("T" * len(names_of_events), names_of_events)


THROUGH_LIQUID = wall_paths("outer", "wet", "wet", "outer")
THROUGH_AIR = wall_paths("outer", "dry", "dry", "outer")


@pytest.mark.parametrize("eye", [(0.5, 0.1, 0.05), (0.05, 0.02, 0.4), (0.3, 0.0, -0.2)])
def test_snell_and_the_mirror_law_at_every_interface(eye):
    """n·(d × N) is the same on both sides, wherever a path of the library meets an interface."""
    rng = np.random.default_rng(1)
    directions = aimed(rng, PENCIL, np.array(eye), 3000)
    checked = 0
    for path in optics.light_paths(PENCIL, eye, min_weight=0.05)[:8]:
        for end in range(len(path), len(path) + 1):
            traced = optics.trace(PENCIL, eye, directions, path)
            taken, pieces, _ = Plain(PENCIL).follow(np.array(eye), directions, path)
            assert np.array_equal(np.flatnonzero(traced.valid), taken)
            origin, direction, length, _ = pieces[end]
            np.testing.assert_allclose(traced.origin[taken], origin, atol=1e-12)
            np.testing.assert_allclose(traced.direction[taken], direction, atol=1e-10)
            np.testing.assert_allclose(traced.length[taken], length, atol=1e-12)
            media = _media(PENCIL, path, 0)
            for number, name in enumerate(path.interfaces):
                before, after = pieces[number][1], pieces[number + 1][1]
                point = pieces[number + 1][0]
                wall = name in ("outer", "wet", "dry")
                normal = point * (1, 1, 0) if wall else np.broadcast_to((0, 0, 1.0), point.shape)
                normal = normal / np.linalg.norm(normal, axis=1)[:, None]
                np.testing.assert_allclose(
                    media[number] * np.cross(before, normal),
                    media[number + 1] * np.cross(after, normal),
                    atol=1e-12,
                )
                checked += len(taken)
    assert checked > 1000


def _media(glass, path, medium):
    """The ior of every stretch."""
    media = [glass.media[medium]]
    for name, event in zip(path.interfaces, path.events, strict=True):
        interface = glass.named(name)
        if event == "T":
            medium = interface.back if medium == interface.front else interface.front
        media.append(glass.media[medium])
    return media


@pytest.mark.parametrize("eye", [(0.5, 0.1, 0.05), (0.05, 0.02, 0.4), (0.3, 0.0, -0.2)])
def test_the_way_back_reaches_the_eye(eye):
    rng = np.random.default_rng(3)
    eye = np.array(eye)
    points = cloud(rng, 0.2, 2000, (0.0, 0.0, 0.06))
    used = 0
    for path in optics.light_paths(PENCIL, eye, min_weight=0.1)[:6]:
        apparent = optics.apparent_points(PENCIL, path, eye, points)
        for slot in np.flatnonzero(apparent.stretch == len(path)):
            shown = np.flatnonzero(apparent.valid[slot])
            _, pieces, _ = Plain(PENCIL).follow(eye, apparent.direction[slot, shown], path)
            back = LightPath(path.events[::-1], path.interfaces[::-1])
            returned = optics.trace(PENCIL, points[shown], -pieces[-1][1], back)
            usable = returned.valid
            towards = eye - returned.origin[usable]
            miss = np.linalg.norm(np.cross(towards, returned.direction[usable]), axis=1)
            assert usable.mean() > 0.95 or len(shown) < 20
            assert np.median(miss) < 1e-10 and miss.max() < 1e-6
            used += int(usable.sum())
    assert used > 50


@pytest.mark.parametrize("eye", [(0.5, 0.1, 0.05), (0.05, 0.02, 0.4), (0.01, 0.0, 0.05)])
def test_weights_are_fresnels_and_sum_to_one(eye):
    rng = np.random.default_rng(7)
    eye = np.array(eye)
    directions = aimed(rng, PENCIL, eye, 3000)
    paths = (LightPath(""), *optics.light_paths(PENCIL, eye, min_weight=0.001))
    weights, rest = optics.path_weights(PENCIL, eye, directions, paths)
    assert (weights >= 0.0).all() and (rest >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=0) + rest, 1.0, atol=1e-12)
    for path, weight in list(zip(paths, weights, strict=True))[1:12]:
        taken, _, share = Plain(PENCIL).follow(eye, directions, path)
        expected = np.zeros(len(directions))
        expected[taken] = share
        np.testing.assert_allclose(weight, expected, atol=1e-10)
    # No light is lost but on rays that are caught in the wall.
    assert np.median(rest) < 0.02
    # Events without interfaces stand for all the ways that have them.
    for events in ("TTTT", "R"):
        parts = [path for path in paths if path.events == events]
        together, left = optics.path_weights(PENCIL, eye, directions, [events])
        alone, _ = optics.path_weights(PENCIL, eye, directions, parts)
        assert (together[0] >= alone.sum(axis=0) - 1e-12).all()
        np.testing.assert_allclose(together[0] + left, 1.0, atol=1e-12)


def test_light_paths_are_distinct_and_told_by_interface():
    paths = optics.light_paths(PENCIL, (0.5, 0.0, 0.06), min_weight=0.05)
    assert len(set(paths)) == len(paths)
    assert {THROUGH_LIQUID, THROUGH_AIR} <= set(paths[:2])
    assert str(THROUGH_AIR) == "T outer, T dry, T dry, T outer"
    below = optics.light_paths(PENCIL, (0.3, 0.0, -0.3), min_weight=0.05)
    assert LightPath("TTRTT", ("outer", "wet", "surface", "wet", "outer")) in below
    # The eye at rest in the liquid sees up through the surface.
    inside = optics.light_paths(PENCIL, (0.0, 0.0, 0.03), min_weight=0.05)
    assert LightPath("T", ("surface",)) in inside
    with pytest.raises(ValueError, match=r"interfaces.*'lid'"):
        optics.trace(PENCIL, (1, 0, 0), [[-1, 0, 0]], LightPath("T", ("lid",)))
    with pytest.raises(ValueError, match="interfaces"):
        LightPath("TT", ("outer",))


def test_lengths_in_the_media():
    eye, directions = (0.5, 0.0, 0.05), [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    lengths, media = optics.path_lengths(PENCIL, eye, directions, THROUGH_LIQUID)
    np.testing.assert_allclose(lengths[:, 0], [0.003, 0.074, 0.003], atol=1e-12)
    assert media[:, 0].tolist() == [1, 2, 1]
    assert (lengths[:, 1] == 0.0).all()


@pytest.mark.parametrize("liquid", [1.333, 1.0])
def test_far_from_bottom_and_rim_it_is_a_cylinder(liquid):
    glass = Tumbler(0.04, 0.003, 2.0, 0.01, 1.5, liquid, 1.99)
    tube = optics.CylinderGlass((0.04, 0.037), (1.5, liquid))
    rng = np.random.default_rng(0)
    eye = np.array([0.5, 0.1, 1.0])
    for points in (
        cloud(rng, 0.2, 800, (-0.3, 0.0, 1.0)),
        cloud(rng, 0.02, 800, (0.0, 0.0, 1.0)),
    ):
        mine = optics.apparent_points(glass, THROUGH_LIQUID, eye, points)
        theirs = optics.apparent_points(tube, "TTTT", eye, points)
        np.testing.assert_array_equal(mine.valid.sum(axis=0), theirs.valid.sum(axis=0))
        for slot in range(len(theirs.stretch)):
            shown = np.flatnonzero(theirs.valid[slot])
            off = np.linalg.norm(mine.direction[:, shown] - theirs.direction[slot, shown], axis=2)
            off = np.where(mine.valid[:, shown], off, np.inf)
            assert off.min(axis=0).max(initial=0.0) < 1e-8


def test_looking_down_it_is_a_pane_under_water():
    """Through a wide surface, straight down: flat layers of liquid and glass."""
    glass = Tumbler(50.0, 0.1, 0.12, 0.02, 1.5, 1.333, 0.05)
    flat = optics.FlatGlass((0.05, 0.02), (1.333, 1.5))
    rng = np.random.default_rng(0)
    eye = np.array([0.1, 0.0, 0.5])
    points = rng.uniform(-0.2, 0.2, (300, 3)) - (0.0, 0.0, 0.3)
    path = LightPath("TTT", ("surface", "floor", "base"))
    mine = optics.apparent_points(glass, path, eye, points)
    theirs = optics.apparent_points(flat, "TTT", eye - (0, 0, 0.07), points - (0, 0, 0.07))
    both = mine.valid.any(axis=0)
    np.testing.assert_array_equal(both, theirs.valid.any(axis=0))
    np.testing.assert_allclose(
        mine.direction[0, both], theirs.direction[0, both], atol=1e-9 * 50 / 0.5
    )


def test_ior_one_changes_nothing():
    glass = Tumbler(0.04, 0.003, 0.12, 0.008, 1.0, 1.0, 0.05)
    rng = np.random.default_rng(0)
    eye = np.array([0.4, 0.0, 0.15])
    points = cloud(rng, 0.1, 500, (0.0, 0.0, 0.06))
    towards = points - eye
    distance = np.linalg.norm(towards, axis=1)
    seen = np.zeros(len(points), dtype=int)
    for path in optics.light_paths(glass, eye):
        assert "R" not in path.events
        apparent = optics.apparent_points(glass, path, eye, points)
        seen += apparent.valid.sum(axis=0)
        for slot, valid in enumerate(apparent.valid):
            np.testing.assert_allclose(apparent.position[slot, valid], points[valid], atol=1e-9)
            np.testing.assert_allclose(apparent.distance[slot, valid], distance[valid], atol=1e-9)
    # In front there is the direct view.
    assert np.isin(seen, (0, 1)).mean() > 0.97 and seen.max() < 8
    assert (seen > 0).mean() > 0.1


def test_a_pencil_is_whole_at_the_waterline():
    """Its two parts lie on paths of their own and meet, on the surface, at both paths' edges."""
    level = PENCIL.bottom + PENCIL.level
    eye = np.array([0.5, 0.02, 0.1])
    height = np.linspace(0.02, 0.115, 400)
    pencil = np.column_stack([0.01 + 0.1 * (height - level), np.zeros(400), height])
    wet = optics.apparent_points(PENCIL, THROUGH_LIQUID, eye, pencil)
    dry = optics.apparent_points(PENCIL, THROUGH_AIR, eye, pencil)
    under = wet.valid[wet.stretch == 2].any(axis=0)
    above = dry.valid[dry.stretch == 2].any(axis=0)
    # Seen from above the level, what is close to it is seen on paths that meet the surface: just
    # above it on the stretch before, just under it on the one behind.
    path = LightPath("TTTTT", ("outer", "dry", "surface", "wet", "outer"))
    down = optics.apparent_points(PENCIL, path, eye, pencil)
    above |= down.valid[down.stretch == 2].any(axis=0)
    sunk = down.valid[down.stretch == 3].any(axis=0)
    assert sunk.any()
    assert (under | above | sunk).all()
    assert not (sunk & (height > level + 1e-9)).any()
    assert not (above & (height < level - 1e-9)).any()
    assert not (under & (height > level + 1e-9)).any()


def test_points_on_the_surface_and_on_the_walls_are_seen():
    level = PENCIL.bottom + PENCIL.level
    angle = np.linspace(0.0, 2.0 * np.pi, 9)
    eye = np.array([0.02, 0.01, 0.3])
    ring = np.column_stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), np.full(9, level)])
    path = LightPath("TTT", ("surface", "floor", "base"))
    assert optics.apparent_points(PENCIL, path, eye, ring).valid.any(axis=0).all()
    floor = ring - (0.0, 0.0, level - PENCIL.bottom)
    assert optics.apparent_points(PENCIL, path, eye, floor).valid.any(axis=0).all()
    base = ring - (0.0, 0.0, level)
    assert optics.apparent_points(PENCIL, path, eye, base).valid.any(axis=0).all()


def test_the_mirror_under_the_surface():
    """From below the level, the surface reflects totally: the image is the mirrored one's."""
    eye = np.array([0.3, 0.0, -0.05])
    path = LightPath("TTRTT", ("outer", "wet", "surface", "wet", "outer"))
    rng = np.random.default_rng(0)
    points = cloud(rng, 0.01, 300, (-0.005, 0.0, 0.06))
    level = PENCIL.bottom + PENCIL.level
    seen = optics.apparent_points(PENCIL, path, eye, points)
    reflected = seen.valid & (seen.stretch == 3)[:, None]
    assert reflected.any(axis=0).mean() > 0.2
    tall = Tumbler(0.04, 0.003, 0.3, 0.008, 1.5, 1.333, 0.29)
    mirrored = points * (1, 1, -1) + (0, 0, 2.0 * level)
    straight = optics.apparent_points(tall, THROUGH_LIQUID, eye, mirrored)
    for slot in np.flatnonzero(seen.stretch == 3):
        shown = np.flatnonzero(seen.valid[slot])
        off = np.linalg.norm(straight.direction[:, shown] - seen.direction[slot, shown], axis=2)
        off = np.where((straight.stretch == 2)[:, None] & straight.valid[:, shown], off, np.inf)
        assert off.min(axis=0).max(initial=0.0) < 1e-9


def test_parallel_views_are_far_eyes():
    rng = np.random.default_rng(0)
    points = cloud(rng, 0.02, 200, (0.0, 0.0, 0.04))
    direction = np.array([-1.0, 0.2, -0.1])
    direction /= np.linalg.norm(direction)
    view = optics.ParallelView(direction)
    paths = optics.light_paths(PENCIL, view, min_weight=0.1)
    assert THROUGH_LIQUID in paths
    seen = optics.apparent_points(PENCIL, THROUGH_LIQUID, view, points)
    shown = seen.valid & (seen.stretch == 2)[:, None]
    assert shown.any(axis=0).mean() > 0.9
    np.testing.assert_allclose(seen.position @ direction, seen.distance, atol=1e-12)
    eye = -2000.0 * direction
    far = optics.apparent_points(PENCIL, THROUGH_LIQUID, eye, points)
    for slot in np.flatnonzero(seen.stretch == 2):
        both = np.flatnonzero(seen.valid[slot])
        lateral = np.cross(seen.position[slot, both] - far.position[:, both], direction)
        lateral = np.linalg.norm(lateral, axis=2)
        lateral = np.where(far.valid[:, both] & (far.stretch == 2)[:, None], lateral, np.inf)
        assert lateral.min(axis=0).max(initial=0.0) < 1e-5
        start = seen.position[slot, both] - seen.distance[slot, both, None] * direction
        taken, pieces, _ = Plain(PENCIL).follow(
            start - direction, np.broadcast_to(direction, start.shape), THROUGH_LIQUID
        )
        assert len(taken) == len(both)
        towards = points[both] - pieces[2][0]
        along = np.sum(towards * pieces[2][1], axis=1)
        miss = np.linalg.norm(towards - along[:, None] * pieces[2][1], axis=1)
        assert miss.max(initial=0.0) < 1e-11
        np.testing.assert_allclose(
            pieces[2][2] + along - 1.0, seen.distance[slot, both], atol=1e-10
        )


@pytest.mark.parametrize("path", [THROUGH_LIQUID, THROUGH_AIR, LightPath("R", ("outer",))])
def test_dense_scan_in_the_plane_of_the_axis_finds_the_same_images(path):
    """In a plane across the axis the images are counted from 40,000 plainly traced rays."""
    eye = np.array([0.3, 0.05, 0.05 if "wet" in path.interfaces else 0.1])
    aim = np.arctan2(-eye[1], -eye[0])
    half = np.arcsin(PENCIL.radius / np.hypot(*eye[:2])) * (1.0 - 1e-12)
    angle = aim + half * np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 40_001))
    directions = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    taken, pieces, _ = Plain(PENCIL).follow(eye, directions, path)
    origin, direction = pieces[-1][:2]
    neighbours = np.diff(taken) == 1
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (60, 2)), np.full(60, eye[2])])
    points = points[np.hypot(*points[:, :2].T) > 0.05]
    apparent = optics.apparent_points(PENCIL, path, eye, points)
    counted = 0
    for number, point in enumerate(points):
        towards = point - origin
        across = towards[:, 0] * direction[:, 1] - towards[:, 1] * direction[:, 0]
        ahead = np.sum(towards * direction, axis=1) > 0.0
        usable = neighbours & ahead[1:] & ahead[:-1]
        scanned = np.sum(usable & (np.sign(across[1:]) != np.sign(across[:-1])))
        shown = apparent.valid[:, number] & (apparent.stretch == len(path))
        assert shown.sum() == scanned
        counted += int(scanned)
    assert counted > 5


@pytest.mark.parametrize("level", [None, 0.0, 0.112, 0.042])
def test_levels_at_floor_rim_and_eye(level):
    """0.042 puts the surface at the eye's height; 0.112 is full."""
    glass = Tumbler(0.04, 0.003, 0.12, 0.008, 1.5, 1.333, level)
    rng = np.random.default_rng(0)
    eye = np.array([0.4, 0.0, 0.05])
    points = cloud(rng, 0.1, 400, (-0.05, 0.0, 0.06))
    paths = optics.light_paths(glass, eye, min_weight=0.05)
    assert paths
    names = {name for path in paths for name in path.interfaces}
    assert ("wet" in names) == bool(level)
    assert ("dry" in names) == (level != 0.112)
    for path in paths[:6]:
        apparent = optics.apparent_points(glass, path, eye, points)
        false, worst = false_images(glass, path, eye, points, apparent)
        assert false == 0 and worst <= 1e-6 * PIXEL


def test_hard_points_disturb_no_other():
    rng = np.random.default_rng(0)
    eye = np.array([0.4, 0.0, 0.05])
    points = rng.uniform(-0.2, 0.2, (300, 3))
    whole = optics.apparent_points(PENCIL, THROUGH_LIQUID, eye, points)
    broken = points.copy()
    broken[::7] = np.nan
    broken[3::7, 1] = np.inf
    broken[5::7] = (1e300, -1e300, 1e300)
    apparent = optics.apparent_points(PENCIL, THROUGH_LIQUID, eye, broken)
    bad = ~np.isfinite(broken).all(axis=1)
    assert not apparent.valid[:, bad].any()
    good = np.ones(300, dtype=bool)
    good[::7] = good[3::7] = good[5::7] = False
    for slot, name in enumerate(whole.sheet):
        if whole.valid[slot, good].any():
            other = apparent.sheet.index(name)
            np.testing.assert_array_equal(whole.valid[slot, good], apparent.valid[other, good])
            shown = good & whole.valid[slot]
            np.testing.assert_allclose(
                whole.direction[slot, shown], apparent.direction[other, shown], atol=1e-9
            )
    for part in (apparent.direction, apparent.distance, apparent.position, apparent.residual):
        assert np.isfinite(part).all()
    none = optics.apparent_points(PENCIL, THROUGH_LIQUID, eye, np.zeros((0, 3)))
    assert none.direction.shape == (1, 0, 3) and none.valid.shape == (1, 0)


@pytest.mark.parametrize("size", [1e-6, 1e4])
def test_size_does_not_matter(size):
    rng = np.random.default_rng(0)
    eye = np.array([0.4, 0.0, 0.05])
    points = rng.uniform(-0.2, 0.2, (300, 3))
    scaled = Tumbler(0.04 * size, 0.003 * size, 0.12 * size, 0.008 * size, 1.5, 1.333, 0.07 * size)
    for path in (
        THROUGH_LIQUID,
        LightPath("TTTRTTT", (*["outer", "wet", "wet", "outer"], *["wet", "wet", "outer"])),
    ):
        one = optics.apparent_points(PENCIL, path, eye, points)
        other = optics.apparent_points(scaled, path, eye * size, points * size)
        np.testing.assert_array_equal(one.valid, other.valid)
        for slot, valid in enumerate(one.valid):
            np.testing.assert_allclose(
                one.direction[slot, valid], other.direction[slot, valid], atol=1e-7
            )


def test_eye_on_the_axis():
    rng = np.random.default_rng(0)
    eye = np.array([0.0, 0.0, 0.5])
    points = rng.uniform(-0.02, 0.02, (200, 3)) * (1, 1, 0.5)
    points[0] = points[1] * (0, 0, 1)
    path = LightPath("TTT", ("surface", "floor", "base"))
    points[:, 2] -= 0.05
    apparent = optics.apparent_points(PENCIL, path, eye, points)
    assert apparent.valid.any(axis=0).all()
    np.testing.assert_allclose(
        apparent.direction[apparent.valid[:, 0], 0], [[0, 0, -1]], atol=1e-12
    )
    false, worst = false_images(PENCIL, path, eye, points, apparent)
    assert false == 0 and worst <= 1e-6 * PIXEL


def test_looser_tolerance_is_kept():
    rng = np.random.default_rng(0)
    eye = np.array([0.4, 0.0, 0.08])
    points = rng.uniform(-0.2, 0.2, (3000, 3))
    for path in (THROUGH_LIQUID, THROUGH_AIR):
        exact = optics.apparent_points(PENCIL, path, eye, points)
        rough = optics.apparent_points(PENCIL, path, eye, points, tolerance=2e-5)
        for slot, name in enumerate(exact.sheet):
            if name not in rough.sheet:
                assert exact.valid[slot].sum() < 5
                continue
            other = rough.sheet.index(name)
            both = exact.valid[slot] & rough.valid[other]
            assert both.sum() >= 0.98 * exact.valid[slot].sum()
            off = np.linalg.norm(exact.direction[slot, both] - rough.direction[other, both], axis=1)
            assert off.max(initial=0.0) < 2e-5


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("radius", 0.0),
        ("wall", 0.05),
        ("wall", -1.0),
        ("height", np.nan),
        ("bottom", 0.2),
        ("ior", "glass"),
        ("liquid_ior", np.inf),
        ("level", -0.01),
        ("level", 0.2),
        ("level", "full"),
        ("ior_outside", None),
    ],
)
def test_bad_fields_are_named(field, value):
    fields = {"radius": 0.04, "wall": 0.003, "height": 0.12, "bottom": 0.008, field: value}
    with pytest.raises(ValueError, match=field) as error:
        Tumbler(**fields)
    assert repr(value) in str(error.value)
