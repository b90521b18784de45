# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths of the stretches of a path: what plain forward tracing measures, stretch by stretch."""

import numpy as np
import pytest
from rays import aimed, random_glass, segments

from glass_refraction import optics

EYE = np.array([0.5, 0.02, 0.1])


@pytest.mark.parametrize("kind", ["flat", "cylinder", "sphere", "bounded"])
@pytest.mark.parametrize("seed", range(3))
def test_each_stretch_is_as_long_as_traced(kind, seed):
    rng = np.random.default_rng([seed, 21])
    glass, eye = random_glass(rng, "cylinder" if kind == "bounded" else kind)
    if kind == "bounded":
        glass = optics.CylinderGlass(glass.radius, glass.ior, extent=(-1.0, 1.5))
    aims = aimed(rng, glass, eye, 400)
    seen = 0
    for path in [*optics.light_paths(glass, eye, min_weight=0.02), "TT", "RRRR", ""]:
        events = str(path)
        lengths, media = optics.path_lengths(glass, eye, aims, path)
        assert lengths.shape == media.shape == (max(len(events) - 1, 0), 400)
        traced = optics.trace(glass, eye, aims, path)
        taken, pieces = segments(glass, eye, aims, events)
        others = np.setdiff1d(np.arange(400), taken)
        assert (lengths[:, others] == 0.0).all() and (media[:, others] == 0).all()
        if not len(lengths) or not len(taken):
            continue
        seen += len(taken)
        first = pieces[0][3]
        # Next to grazing the rounding of the invariants, from a far eye, is what differs.
        apart = np.abs(lengths.sum(axis=0)[taken] + first - traced.length[taken])
        assert np.median(apart) < 1e-12 and apart.max() < 1e-5
        for row, (origin, direction, _, reach) in enumerate(pieces[1:-1]):
            apart = np.abs(lengths[row, taken] - reach)
            assert np.median(apart) < 1e-12 and apart.max() < 1e-5
            middle = origin + 0.5 * reach[:, None] * direction
            clear = reach > 1e-3
            at = glass.medium_at(middle)
            np.testing.assert_array_equal(media[row, taken][clear], at[clear])
    assert seen > 10 or (kind == "flat" and len(glass.heights) == 1)


def test_rays_of_one_path_in_different_media():
    """With three interfaces a ray may turn round in one medium where another goes deeper."""
    glass = optics.CylinderGlass((1.0, 0.9, 0.5), (1.5, 1.2, 1.4))
    eye = np.array([3.0, 0.0, 0.0])
    aims = np.stack([np.full(2000, -3.0), np.linspace(0.0, 1.1, 2000), np.zeros(2000)], axis=1)
    lengths, media = optics.path_lengths(glass, eye, aims, "TTTRTTT")
    met = lengths.any(axis=0)
    assert met.any()
    np.testing.assert_array_equal(met, optics.trace(glass, eye, aims, "TTTRTTT").valid)
    assert len(np.unique(media[2, met])) == 2


def test_absorption_of_a_pane():
    pane = optics.FlatGlass((0.01, 0.02), (1.5, 1.3))
    lengths, media = optics.path_lengths(pane, (0, 0, 1.0), [[0, 0, -1.0], [0, 0, 1.0]], "TTT")
    np.testing.assert_allclose(lengths, [[0.01, 0.0], [0.02, 0.0]], atol=1e-15)
    coefficients = np.array([0.0, 10.0, 5.0, 0.0])
    through = np.exp(-(coefficients[media] * lengths).sum(axis=0))
    np.testing.assert_allclose(through, [np.exp(-0.2), 1.0], atol=1e-15)


def test_rays_that_start_apart_and_rays_that_are_none():
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
    rng = np.random.default_rng(3)
    aims = aimed(rng, glass, EYE, 50)
    starts = EYE - aims * rng.uniform(0.0, 0.1, (50, 1))
    one, _ = optics.path_lengths(glass, EYE, aims, "TTTT")
    apart, _ = optics.path_lengths(glass, starts, aims, "TTTT")
    np.testing.assert_allclose(one, apart, atol=1e-12)
    assert one.any()
    aims[:3] = [[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 0.0]]
    broken, media = optics.path_lengths(glass, EYE, aims, "TTTT")
    assert (broken[:, :3] == 0.0).all() and (media[:, :3] == 0).all()
    np.testing.assert_allclose(broken[:, 3:], one[:, 3:], atol=1e-12)
