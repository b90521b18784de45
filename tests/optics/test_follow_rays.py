# SPDX-License-Identifier: GPL-3.0-or-later
"""All ways of rays through a cup at once, against the paths one by one."""

import numpy as np
import pytest

from glass_refraction import optics

GLASSES = {
    "tumbler": optics.Tumbler(0.036, 0.0025, 0.11, 0.007, level=0.065),
    "empty": optics.Tumbler(0.036, 0.0025, 0.11, 0.007),
    "bowl": optics.RevolutionGlass(
        ((0.0, 0.0), (0.03, 0.005), (0.04, 0.06)),
        ((0.0, 0.004), (0.027, 0.009), (0.038, 0.06)),
        level=0.03,
    ),
}
EYES = ((0.03, -0.34, 0.0515), (0.03, -0.24, 0.29))


def _rays(glass, eye, count=120, seed=2):
    radius, low, high = (part * glass.scale for part in glass.hull)
    aim = np.random.default_rng(seed).uniform(
        (-radius, -radius, low), (radius, radius, high), (count, 3)
    )
    return np.array(eye), aim - eye


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", GLASSES)
def test_every_way_is_a_path_and_has_its_weight(name, eye):
    glass = GLASSES[name]
    eye, directions = _rays(glass, eye)
    ends = optics.follow_rays(glass, eye, directions, min_weight=0.05)
    assert len(ends.paths) > 5
    for number, path in enumerate(ends.paths):
        some = ends.path == number
        ray = ends.ray[some]
        weights, _ = optics.path_weights(glass, eye, directions[ray], [path])
        np.testing.assert_allclose(ends.weight[some], weights[0], atol=1e-12)
        if not len(path):
            continue
        traced = optics.trace(glass, eye, directions[ray], path)
        assert traced.valid.all()
        np.testing.assert_allclose(ends.origin[some], traced.origin, atol=1e-12)
        np.testing.assert_allclose(ends.direction[some], traced.direction, atol=1e-12)
        lengths, media = optics.path_lengths(glass, eye, directions[ray], path)
        for medium in range(len(glass.media)):
            through = np.where(media == medium, lengths, 0.0).sum(axis=0)
            np.testing.assert_allclose(ends.lengths[some, medium], through, atol=1e-12)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", GLASSES)
def test_energy_is_kept_and_hardly_any_is_left_out(name, eye):
    glass = GLASSES[name]
    eye, directions = _rays(glass, eye)
    ends = optics.follow_rays(glass, eye, directions, min_weight=0.01, lengths=False)
    brought = np.bincount(ends.ray, ends.weight, len(directions))
    assert brought.max() < 1.0 + 1e-12
    assert brought.mean() > 0.95
    assert not ends.lengths.any()


def test_surfaces_that_only_refract_take_no_light_and_mirror_nothing():
    glass = GLASSES["tumbler"]
    eye, directions = _rays(glass, EYES[1])
    ends = optics.follow_rays(glass, eye, directions, fresnel=False)
    assert set(ends.weight) == {1.0}
    assert not any("R" in path.events for path in ends.paths)
    assert np.bincount(ends.ray).max() == 1


def test_what_stands_in_the_way_ends_rays_there():
    """A wall across the cup: no way passes it, and the lengths end at it."""
    glass = GLASSES["tumbler"]
    eye, directions = _rays(glass, EYES[0])
    wall = 0.004

    def stop(events, medium, origin, direction, length):
        assert medium != 1
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (wall - origin[:, 1]) / direction[:, 1]
        inside = events > 0
        return np.where(inside & (way > 1e-9) & (way < length), way, length)

    free = optics.follow_rays(glass, eye, directions, min_weight=0.02)
    ends = optics.follow_rays(glass, eye, directions, min_weight=0.02, stop=stop)
    held = np.array([path.open for path in ends.paths])[ends.path]
    assert held.sum() > 40
    crossing = np.abs(ends.direction[held, 1]) > 1e-6
    ahead = (wall - ends.origin[held, 1]) * np.sign(ends.direction[held, 1])
    assert (ahead[crossing] > -1e-9).all()
    # As much light as without the wall, up to what was too weak to follow.
    for found in (free, ends):
        assert np.bincount(found.ray, found.weight, len(directions)).mean() > 0.9
    # The last stretch counts: from where it begins to the wall, through the liquid.
    for row in np.flatnonzero(held):
        path = ends.paths[ends.path[row]]
        if path.interfaces == ("outer", "wet"):
            way = (wall - ends.origin[row, 1]) / ends.direction[row, 1]
            assert ends.lengths[row, 2] == pytest.approx(way, abs=1e-12)


def test_a_stop_that_stops_nothing_changes_nothing():
    """Ways in metres and in the glass's own unit differ by rounding: no ray may end for that."""
    glass = GLASSES["tumbler"]
    eye, directions = _rays(glass, EYES[1], 2000)
    free = optics.follow_rays(glass, eye, directions, min_weight=0.05)
    ends = optics.follow_rays(
        glass, eye, directions, min_weight=0.05, stop=lambda *parts: parts[-1]
    )
    assert ends.paths == free.paths
    np.testing.assert_array_equal(ends.weight, free.weight)


def test_rays_that_are_none_and_no_rays_at_all():
    glass = GLASSES["tumbler"]
    ends = optics.follow_rays(glass, EYES[0], np.zeros((0, 3)))
    assert len(ends.ray) == 0 and ends.origin.shape == (0, 3)
    ends = optics.follow_rays(glass, EYES[0], [(np.nan, 0.0, 1.0), (0.0, 0.0, 0.0)])
    assert len(ends.ray) == 0
