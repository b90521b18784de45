# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths and their weights: energy is kept, regions are complete."""

import numpy as np
import pytest
from rays import aimed, random_glass

from glass_refraction import optics
from glass_refraction.optics import tracing
from glass_refraction.optics.coaxial import domain_of, taken_branches
from glass_refraction.optics.paths import branches
from glass_refraction.optics.weights import _follow as follow
from glass_refraction.optics.weights import _towards as towards


@pytest.mark.parametrize("kind", ["flat", "cylinder", "sphere"])
@pytest.mark.parametrize("seed", range(4))
def test_energy_sums_to_one(kind, seed):
    """Many paths leave little; what is left is what has not come out yet, never less than 0."""
    rng = np.random.default_rng([seed, 7])
    glass, eye = random_glass(rng, kind)
    if kind != "flat" and glass.medium_at(eye) > 0:
        eye = eye * 3.0 + (2.0, 0.0, 0.0)
    if kind == "flat":
        eye[2] = 1.0  # light within a layer may be trapped for ever
    aims = aimed(rng, glass, eye, 500)
    paths = ["", *optics.light_paths(glass, eye, min_weight=0.005)]
    weights, rest = optics.path_weights(glass, eye, aims, paths)
    assert weights.shape == (len(paths), 500) and rest.shape == (500,)
    assert (weights >= 0.0).all() and (rest >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=0) + rest, 1.0, atol=1e-12)
    assert np.median(rest) < 0.05
    for path, weight in zip(paths, weights, strict=True):
        np.testing.assert_array_equal(optics.trace(glass, eye, aims, path).valid, weight > 0.0)


def test_normal_incidence_through_a_slab():
    slab = optics.FlatGlass((0.01,), (1.5,))
    weights, _ = optics.path_weights(slab, (0, 0, 1.0), [[0, 0, -3.0]], ["TT", "R", "TRT", "TRRT"])
    part = 0.04
    expected = [0.96**2, part, 0.96**2 * part, 0.96**2 * part**2]
    np.testing.assert_allclose(weights[:, 0], expected, atol=1e-15)


def test_drinking_glass_paths_in_order():
    """Means over the pixels of a hollow glass, as measured before: the order of the first."""
    glass = optics.CylinderGlass((0.05, 0.046), (1.52, 1.0), extent=(0.0, 0.12))
    found = [path.events for path in optics.light_paths(glass, (0.5, 0.0, 0.2))]
    assert found[0] == "TTTT" and {"R", "TRT", "TTRTT", "TTTRTTT", "TRRRT"} <= set(found)
    assert set(found[1:3]) == {"R", "TRT"} and found[3] == "TTRTT"
    assert "" not in found


def test_eyes_on_every_side():
    slab = optics.FlatGlass((0.01,), (1.5,), ior_below=1.333)
    for height in (1.0, -0.005, -1.0):
        assert optics.light_paths(slab, (0.0, 0.0, height))
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
    assert optics.light_paths(glass, (0.01, 0.0, 0.0))[0].events == "TT"
    assert optics.light_paths(optics.CylinderGlass((0.04,), (1.5,)), (0.3, 0, 0))[0].events == "TT"
    with pytest.raises(ValueError, match="min_weight"):
        optics.light_paths(slab, (0.0, 0.0, 1.0), min_weight=0.0)


def test_outlines_and_extents_bound_the_paths():
    pane = optics.FlatGlass((0.1,), (1.5,), outline=[(-1, -1), (1, -1), (1, 1), (-1, 1)])
    aims = np.array([[0.0, 0.0, -1.0], [3.0, 0.0, -1.0], [0.99, 0.0, -1.0]])
    weights, rest = optics.path_weights(pane, (0.0, 0.0, 1.0), aims, ["", "TT", "R"])
    np.testing.assert_array_equal(weights[0], [0.0, 1.0, 0.0])
    assert weights[1, 0] > 0.9 and weights[1, 2] == 0.0  # leaves by the side face
    assert rest[2] > 0.5
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.0, 0.1))
    aims = np.array([[-1.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 0.1]])
    weights, _ = optics.path_weights(glass, (0.5, 0.0, 0.05), aims, ["", "TTTT"])
    np.testing.assert_array_equal(weights[0], [0.0, 1.0, 0.0])
    assert weights[1, 0] > 0.8 and weights[1, 2] == 0.0  # leaves above the far wall


def test_rays_that_are_none():
    glass = optics.SphereGlass((0.1,), (1.5,))
    aims = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 0.0], [-1e300, 0, 0]])
    traced = optics.trace(glass, (1.0, 0.0, 0.0), aims, "TT")
    np.testing.assert_array_equal(traced.valid, [False, False, False, True])
    assert np.isfinite(traced.origin).all() and np.isfinite(traced.direction).all()
    weights, rest = optics.path_weights(glass, (1.0, 0.0, 0.0), aims, ["TT"])
    assert np.isfinite(weights).all() and np.isfinite(rest).all()


@pytest.mark.parametrize("kind", ["cylinder", "sphere", "bounded"])
@pytest.mark.parametrize("seed", range(6))
def test_the_closed_form_agrees_with_the_tracer(kind, seed):
    """Coaxial weights come from the invariants; following every ray gives the same."""
    rng = np.random.default_rng([seed, 11])
    glass, eye = random_glass(rng, "sphere" if kind == "sphere" else "cylinder")
    if seed >= 4:
        eye = eye * (0.6 / np.linalg.norm(eye[:2]))  # in the core or the wall
    if kind == "bounded":
        glass = optics.CylinderGlass(glass.radius, glass.ior, extent=(-1.0, 1.5))
    aims = aimed(rng, glass, eye, 3000) * rng.uniform(0.1, 10.0, (3000, 1))
    aims[:3] = [[0.0, 0.0, 1.0], [0.0, 0.0, -2.0], -eye]
    paths = ["", *optics.light_paths(glass, eye, min_weight=0.005), "TRTRT", "RR"]
    names = [str(path) for path in paths]
    weights, _ = optics.path_weights(glass, eye, aims, paths)
    rays, _ = tracing.start(glass, eye, aims)
    traced = np.zeros_like(weights)
    for name, which, weight in follow(glass, rays, towards(names)):
        if name in names:
            traced[names.index(name), which] = weight
    # Next to grazing the tracer's own rounding, from a far eye, is what differs.
    apart = np.abs(weights - traced).max(axis=0)
    assert np.median(apart) < 1e-15
    assert np.quantile(apart, 0.99) < 1e-12
    assert apart.max() < 1e-9
    assert (traced.sum(axis=0) > 0.5).mean() > 0.5


@pytest.mark.parametrize("seed", range(40))
def test_branches_that_rays_take_are_those_whose_domain_is_not_empty(seed):
    random = np.random.default_rng(seed)
    glass, _ = random_glass(random, ("cylinder", "sphere")[seed % 2])
    for medium in range(len(glass.media)):
        events = "".join(random.choice(["T", "R"], random.integers(1, 8)))
        listed = branches(glass, medium, optics.LightPath(events))
        whole = [(branch, domain_of(glass, branch)) for branch in listed]
        expected = [(branch, domain) for branch, domain in whole if domain.zeta_max > 0.0]
        assert list(taken_branches(glass, medium, events)) == expected


def test_a_path_of_many_reflections_is_listed_at_once():
    # Each of them could be at either face: 2^60 orders, of which rays take few.
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
    assert len(taken_branches(glass, 0, "T" + 60 * "R" + "T")) < 10


@pytest.mark.parametrize(
    "glass",
    [
        optics.CylinderGlass((0.04, 0.037), (1.5, 1.333)),
        optics.SphereGlass((0.15, 0.147), (1.5, 1.333)),
        optics.CylinderGlass((0.04, 0.036, 0.03), (1.5, 1.3, 1.7)),
    ],
)
def test_long_mirror_chains_are_listed_if_they_carry_enough(glass):
    """Light that runs round in a liquid, mirrored at the outer wall, for 25 events and more."""
    eye, least = np.array([0.3, 0.05, 0.0]), 0.002
    listed = {path.events for path in optics.light_paths(glass, eye, min_weight=least)}
    impact = np.concatenate([np.linspace(0.0, 0.99, 2000), 1.0 - np.geomspace(1e-9, 1e-2, 4000)])
    angle = np.arctan2(-eye[1], -eye[0]) + np.arcsin(impact * glass.radius[0] / np.hypot(*eye[:2]))
    directions = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    chains = ["TT" + "TRT" * count + "TT" for count in range(18)]
    weights, _ = optics.path_weights(glass, eye, directions, chains)
    peaks = dict(zip(chains, weights.max(axis=1), strict=True))
    assert max(len(chain) for chain in chains if peaks[chain] > least) > 30
    for chain, peak in peaks.items():
        # The sample of rays may miss a peak by a little.
        if peak > 1.1 * least:
            assert chain in listed, (chain, peak)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"paths": "TT"}, "several"),
        ({"directions": [[0.0, 1.0]]}, r"\(M, 3\)"),
        ({"eye": (0.0, 1.0)}, r"eye must be"),
        ({"eye": np.zeros((2, 3))}, r"eye must be"),
    ],
)
def test_bad_input_is_told(given, told):
    good = {"eye": (0.0, 0.0, 1.0), "directions": [[0.0, 0.0, -1.0]], "paths": ["TT"]}
    slab = optics.FlatGlass((0.01,), (1.5,))
    optics.path_weights(slab, **good)
    with pytest.raises(ValueError, match=told):
        optics.path_weights(slab, **{**good, **given})
