# SPDX-License-Identifier: GPL-3.0-or-later
"""The ior of red, green and blue light."""

import math

import numpy as np
import pytest

from glass_refraction.optics import LINES, CylinderGlass, LightPath, dispersed_ior, trace


@pytest.mark.parametrize("ior", [1.333, 1.5168, 2.417])
@pytest.mark.parametrize("abbe", [20.4, 55.7, 64.2])
def test_the_abbe_number_is_what_it_is_defined_as(ior, abbe):
    c, d, f = (dispersed_ior(ior, abbe, length) for length in LINES.values())
    assert d == pytest.approx(ior, abs=1e-14)
    assert (d - 1) / (f - c) == pytest.approx(abbe, rel=1e-9)
    assert c < d < f


def test_cauchys_equation_is_linear_in_the_inverse_square_of_the_wavelength():
    lengths = np.array([400e-9, 500e-9, 700e-9])
    n = [dispersed_ior(1.5168, 64.2, length) for length in lengths]
    x = lengths**-2.0
    assert (n[1] - n[0]) / (x[1] - x[0]) == pytest.approx((n[2] - n[1]) / (x[2] - x[1]), rel=1e-6)


def test_crown_glass_as_its_catalogue_has_it():
    # N-BK7: 1.51432 at C, 1.52238 at F; Cauchy's two terms are good to four digits.
    assert dispersed_ior(1.5168, 64.17, LINES["red"]) == pytest.approx(1.51432, abs=3e-4)
    assert dispersed_ior(1.5168, 64.17, LINES["blue"]) == pytest.approx(1.52238, abs=3e-4)


@pytest.mark.parametrize("abbe", [0.0, math.inf])
def test_without_an_abbe_number_all_light_goes_one_way(abbe):
    assert dispersed_ior(1.5, abbe, LINES["blue"]) == 1.5


@pytest.mark.parametrize(
    ("ior", "abbe", "length", "named"),
    [
        (1.5, -1.0, 5e-7, "abbe_number"),
        (1.5, math.nan, 5e-7, "abbe_number"),
        (1.5, 30.0, 0.0, "wavelength"),
        (3.0, 0.2, 1e-6, "abbe_number"),
    ],
)
def test_bad_numbers_are_named(ior, abbe, length, named):
    with pytest.raises(ValueError, match=named):
        dispersed_ior(ior, abbe, length)


def test_blue_light_is_turned_most():
    turned = []
    for length in LINES.values():
        rod = CylinderGlass((0.02,), (dispersed_ior(1.6, 30.0, length),))
        ray = trace(rod, np.array([0.01, -1.0, 0.0]), np.array([[0.0, 1.0, 0.0]]), LightPath("TT"))
        turned.append(-ray.direction[0, 0])
    assert 0 < turned[0] < turned[1] < turned[2]
