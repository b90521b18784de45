# SPDX-License-Identifier: GPL-3.0-or-later
"""Work and memory grow with the number of points and no faster: counted, never timed."""

import tracemalloc

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.optics import apparent, axial_images, coaxial, sheets
from glass_refraction.optics.axial_rays import Passage
from glass_refraction.optics.solver import BLOCK

EYE = np.array([0.5, 0.02, 0.1])
HOLLOW = optics.CylinderGlass((0.04, 0.037), (1.5, 1.0))
FILLED = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333))
BALL = optics.SphereGlass((0.04,), (1.5,))
STEM = [(0.036, 0.001), (0.036, 0.003), (0.016, 0.007), (0.006, 0.013), (0.004, 0.032)]
BOWL = [(0.004, 0.07), (0.022, 0.097), (0.036, 0.121), (0.04, 0.146), (0.033, 0.2)]
HOLLOWED = [(0, 0.091), (0.021, 0.099), (0.035, 0.122), (0.038, 0.146), (0.031, 0.2)]
WINE_GLASS = optics.RevolutionGlass([(0, 0), *STEM, *BOWL], HOLLOWED, 1.5)
SLAB = optics.FlatGlass((0.01,), (1.5,))


def cloud(count):
    """Points behind a glass, or below a pane, some of them out of sight."""
    return np.random.default_rng(0).uniform(-0.1, 0.1, (count, 3)) - (0.2, 0.0, 0.15)


def peak_bytes(glass, path, count, tolerance):
    """Bytes in use at most, output included, input not; and those of the output."""
    points = cloud(count)
    tracemalloc.start()
    found = optics.apparent_points(glass, path, EYE, points, tolerance=tolerance)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    fields = "direction", "distance", "position", "valid", "residual"
    return peak, sum(getattr(found, field).nbytes for field in fields)


@pytest.mark.parametrize(
    ("glass", "path", "tolerance"),
    [
        (HOLLOW, "TTTT", 1e-9),
        (HOLLOW, "TTTT", 2e-5),
        (HOLLOW, "TTRTT", 2e-5),
        (FILLED, "TTTT", 1e-9),
        (BALL, "TT", 1e-9),
        (SLAB, "TT", 1e-9),
    ],
)
def test_memory_grows_by_less_than_300_bytes_a_point(glass, path, tolerance):
    """Blocks need the same whatever the number of points: what grows with it is what counts."""
    peak_bytes(glass, path, 100, tolerance)
    few, many = 2 * BLOCK, 4 * BLOCK  # two full blocks at a time in either case
    few_peak, few_output = peak_bytes(glass, path, few, tolerance)
    many_peak, many_output = peak_bytes(glass, path, many, tolerance)
    beyond = (many_peak - many_output) - (few_peak - few_output)
    assert beyond / (many - few) <= 300.0


def counted(monkeypatch, owner, name, size_of):
    """Elements that calls of a method worked on, as a list that grows."""
    sizes, method = [], getattr(owner, name)

    def counting(self, *arguments, **options):
        result = method(self, *arguments, **options)
        sizes.append(size_of(result))
        return result

    monkeypatch.setattr(owner, name, counting)
    return sizes


def test_steps_a_point_of_one_image(monkeypatch):
    """A hollow glass: few steps from the straight ray, one from the last frame's result."""
    steps = counted(monkeypatch, coaxial.CoaxialPassage, "step", lambda result: len(result[0]))
    points = np.random.default_rng(1).uniform(-0.03, 0.03, (20_000, 3)) - (0.2, 0.0, 0.05)
    last = optics.apparent_points(HOLLOW, "TTTT", EYE, points)
    moved = points + np.random.default_rng(2).normal(size=points.shape) * 0.001 / np.sqrt(3.0)
    for tolerance, guess, most in ((4e-7, None, 4.2), (4e-7, last, 2.6), (2e-5, last, 1.5)):
        steps.clear()
        optics.apparent_points(HOLLOW, "TTTT", EYE, moved, tolerance=tolerance, guess=guess)
        assert sum(steps) <= most * len(points)


@pytest.mark.parametrize(
    ("glass", "path", "most"), [(FILLED, "TTTT", 40), (HOLLOW, "TTRTT", 60), (BALL, "TT", 25)]
)
def test_evaluations_a_point_of_several_images(monkeypatch, glass, path, most):
    """As many for each point of many as for each of few."""
    sizes = counted(monkeypatch, sheets.Curves, "state", lambda state: state.ell.size)
    optics.apparent_points(glass, path, EYE, cloud(300))
    few = sum(sizes) / 300
    sizes.clear()
    optics.apparent_points(glass, path, EYE, cloud(6000))
    many = sum(sizes) / 6000
    assert many <= most
    assert many == pytest.approx(few, rel=0.2)


@pytest.mark.parametrize("shape", [optics.CylinderGlass, optics.SphereGlass])
@pytest.mark.parametrize("tolerance", [1e-9, 4e-7, 2e-5])
def test_only_points_without_an_image_are_searched_for(monkeypatch, shape, tolerance):
    """Few digits asked for must not mean that points near the verge are solved twice."""
    glass, search, searched = shape((0.04, 0.037), (1.5, 1.0)), apparent._by_curves, []

    def counting(slots, left):
        searched.append(len(left))
        search(slots, left)

    monkeypatch.setattr(apparent, "_by_curves", counting)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (3000, 3)) - (0.35, 0.0, 0.0)
    found = optics.apparent_points(glass, "TTTT", (0.5, 0.0, 0.01), points, tolerance=tolerance)
    unseen = int((~found.valid.any(axis=0)).sum())
    assert 0 < unseen <= sum(searched) <= unseen + 0.03 * len(points)


@pytest.mark.in_turn(2)
@pytest.mark.parametrize("mirrors", [2, 8])
def test_rays_that_a_whispering_path_is_searched_with(monkeypatch, mirrors):
    """A path that runs round in the wall by ten mirrors costs no more than one by two."""
    rays = []
    for name in ("takes", "course"):
        method = getattr(Passage, name)

        def counting(self, unknowns, *arguments, method=method):
            rays.append(len(unknowns[0]))
            return method(self, unknowns, *arguments)

        monkeypatch.setattr(Passage, name, counting)
    steps = (("outer", "T"), *[("outer", "R")] * mirrors, ("outer", "T"))
    lattice = axial_images.Lattice(Passage(WINE_GLASS, np.array((0.13, -0.87, 0.05)), steps))
    assert len(lattice.cells) > 0
    assert sum(rays) * len(steps) <= 2_500_000
