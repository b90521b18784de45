# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures that are known without this library."""

from pathlib import Path

import numpy as np
import pytest
from scipy import io, optimize

from glass_refraction import optics

N_BK7 = 1.5168


@pytest.mark.parametrize(
    ("degrees", "shift"),
    [(15, 0.09155), (30, 0.19762), (45, 0.33450), (60, 0.51830), (75, 0.75215)],
)
def test_lateral_shift_of_a_slab(degrees, shift):
    """d = t·sin θ·(1 − cos θ / (n·cos φ))."""
    angle = np.radians(degrees)
    aim = np.array([[np.sin(angle), 0.0, -np.cos(angle)]])
    slab = optics.FlatGlass((1.0,), (N_BK7,))
    traced = optics.trace(slab, (0.0, 0.0, 1.0), aim, "TT")
    across = np.array([np.cos(angle), 0.0, np.sin(angle)])
    moved = abs((traced.origin[0] - (0.0, 0.0, 1.0)) @ across)
    assert moved == pytest.approx(shift, abs=5e-6)
    inside = np.arcsin(np.sin(angle) / N_BK7)
    exact = np.sin(angle) * (1.0 - np.cos(angle) / (N_BK7 * np.cos(inside)))
    assert moved == pytest.approx(exact, abs=1e-14)
    # And the point behind is seen along the very same ray.
    point = traced.origin + 0.7 * traced.direction
    apparent = optics.apparent_points(slab, "TT", (0.0, 0.0, 1.0), point)
    np.testing.assert_allclose(apparent.direction[0], aim, atol=1e-14)


def test_equation_five_of_the_paper():
    """(y − W)·tan θ + W·tan(arcsin(sin θ / n)) = x, Mukai, Makino and Chang 2013."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (500, 3)) - (0.0, 0.0, 1.5)
    slab = optics.FlatGlass((0.2,), (1.5,))
    found = optics.apparent_points(slab, "TT", (0.0, 0.0, 1.0), points).direction[0]
    angle = np.arctan2(np.hypot(found[:, 0], found[:, 1]), -found[:, 2])
    depth = 1.0 - points[:, 2]
    left = (depth - 0.2) * np.tan(angle) + 0.2 * np.tan(np.arcsin(np.sin(angle) / 1.5))
    np.testing.assert_allclose(left, np.hypot(points[:, 0], points[:, 1]), atol=1e-13)


def test_apparent_depth_of_water():
    water = optics.FlatGlass((), (), ior_below=4.0 / 3.0)
    near = optics.apparent_points(water, "T", (0.0, 0.0, 1.0), [[1e-7, 0.0, -1.0]])
    aim = near.direction[0, 0]
    assert aim[0] / -aim[2] == pytest.approx(1e-7 / 1.75, rel=1e-9)  # depth 1 seems 3/4


@pytest.mark.parametrize(
    ("tilt", "index"), [(0, 1.5168), (30, 1.6536), (45, 1.8977), (60, 2.4905), (75, 4.5185)]
)
def test_effective_index_of_skew_rays(tilt, index):
    """A skew ray through a rod turns in projection as in a plane with √(n² − ζ²)/√(1 − ζ²)."""
    tilt = np.radians(tilt)
    rod = optics.CylinderGlass((1.0,), (N_BK7,))
    impact = 0.5
    flat = np.array([-np.sqrt(1.0 - (impact / 3.0) ** 2), impact / 3.0, 0.0])
    aim = (np.cos(tilt) * flat + (0.0, 0.0, np.sin(tilt)))[None]
    traced = optics.trace(rod, (3.0, 0.0, 0.0), aim, "TT")
    before, after = flat[:2], traced.direction[0, :2]
    after = after / np.linalg.norm(after)
    turned = np.arccos(np.clip(before @ after, -1.0, 1.0))
    inside = np.arcsin(impact) - turned / 2.0
    assert impact / np.sin(inside) == pytest.approx(index, abs=5e-5)


def test_focus_of_a_rod():
    """f = n·R / (2 (n − 1)) from the centre: paraxial rays of a parallel view meet there."""
    rod = optics.CylinderGlass((1.0,), (1.5,))
    origin = np.array([[3.0, 1e-5, 0.0]])
    traced = optics.trace(rod, origin, [[-1.0, 0.0, 0.0]], "TT")
    way = -traced.origin[0, 1] / traced.direction[0, 1]
    assert -(traced.origin[0, 0] + way * traced.direction[0, 0]) == pytest.approx(1.5, abs=1e-8)


def test_regions_of_skew_rays():
    """|ℓ| < P_core·r: both walls; else |ℓ| < P_wall·r: total reflection; else the wall alone."""
    rng = np.random.default_rng(1)
    outer, inner, ior = 1.0, 0.6, 1.4
    glass = optics.CylinderGlass((outer, inner), (ior, 1.0))
    eye = np.array([4.0, 0.0, 0.0])
    targets = np.column_stack(
        [np.zeros(20_000), rng.uniform(-0.95, 0.95, 20_000), rng.normal(size=20_000) * 3.0]
    )
    aims = (targets - eye) / np.linalg.norm(targets - eye, axis=1)[:, None]
    ell, zeta = abs(eye[0] * aims[:, 1]), aims[:, 2]
    room, wall = np.sqrt(1.0 - zeta**2), np.sqrt(ior**2 - zeta**2)
    hits = ell < room * outer
    both = hits & (ell < room * inner)
    total = hits & ~both & (ell < wall * inner)
    alone = hits & ~both & ~total
    assert both.any() and total.any() and alone.any()
    np.testing.assert_array_equal(optics.trace(glass, eye, aims, "TTTT").valid, both)
    # Inside `both` the inner face reflects a part; beyond it reflects all.
    weights, _ = optics.path_weights(glass, eye, aims, ["TRT", "TT", ""])
    np.testing.assert_array_equal(optics.trace(glass, eye, aims, "TT").valid, alone)
    np.testing.assert_array_equal(weights[2] == 1.0, ~hits)
    assert (weights[0][total] > 0.0).all() and (weights[1][alone] > 0.0).all()


PHOTOGRAPH = Path(__file__).resolve().parents[3] / "shared/data/agrawal2012/RealData.mat"


@pytest.mark.skipif(not PHOTOGRAPH.exists(), reason=f"no photograph at {PHOTOGRAPH}")
def test_photograph_through_a_water_tank():
    """A. Agrawal et al., CVPR 2012: 144 corners seen through 260 mm of water, ior 1.33. Only the
    slab's normal is fitted (two angles)."""
    data = io.loadmat(PHOTOGRAPH)
    corners = (data["Rgt"] @ data["Pall"] + data["Tgt"].reshape(3, 1)).T / 1000.0
    pixels = data["CameraRays"][:2].T
    tank = optics.FlatGlass((0.26,), (1.33,))

    def project(directions):
        seen = directions @ data["KK"].T
        return seen[:, :2] / seen[:, 2:]

    def misses(angles):
        toward = np.array([np.tan(angles[0]), np.tan(angles[1]), 1.0])
        toward /= np.linalg.norm(toward)
        x = np.cross([0.0, 1.0, 0.0], toward)
        x /= np.linalg.norm(x)
        frame = np.array([x, np.cross(-toward, x), -toward])
        eye = np.array([0.0, 0.0, 1e-3])
        apparent = optics.apparent_points(tank, "TT", eye, corners @ frame.T + eye)
        assert apparent.valid[0].all()
        return (project(apparent.direction[0] @ frame) - pixels).ravel()

    def rms(values):
        return np.sqrt(np.mean(np.sum(values.reshape(-1, 2) ** 2, axis=1)))

    assert rms((project(corners) - pixels).ravel()) == pytest.approx(158.1, abs=0.5)
    fitted = optimize.least_squares(misses, (0.0, 0.0))
    assert rms(fitted.fun) <= 3.25
