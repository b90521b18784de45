# SPDX-License-Identifier: GPL-3.0-or-later
"""Descriptions of glasses: good ones are kept, bad ones named."""

import numpy as np
import pytest

from glass_refraction import optics

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: optics.CylinderGlass((0.04, 0.037), (1.5, NAN)), "ior", "nan"),
        (lambda: optics.CylinderGlass((0.04, 0.037), (1.5, 0.0)), "ior", "0.0"),
        (lambda: optics.CylinderGlass((0.04, INF), (1.5, 1.0)), "radius", "inf"),
        (lambda: optics.CylinderGlass((0.04, -0.037), (1.5, 1.0)), "radius", "-0.037"),
        (lambda: optics.CylinderGlass((0.037, 0.04), (1.5, 1.0)), "radius", "0.04"),
        (lambda: optics.CylinderGlass((0.04, 0.04), (1.5, 1.0)), "radius", "0.04"),
        (lambda: optics.CylinderGlass((0.04,), (1.5, 1.0)), "radius", "1.5"),
        (lambda: optics.CylinderGlass((), ()), "radius", "()"),
        (lambda: optics.CylinderGlass((0.04,), (1.5,), ior_outside=-1.0), "ior_outside", "-1.0"),
        (lambda: optics.CylinderGlass((0.04,), (1.5,), extent=(1.0, 0.0)), "extent", "(1.0, 0.0)"),
        (lambda: optics.SphereGlass((0.1, 0.2), (1.5, 1.0)), "radius", "0.2"),
        (lambda: optics.SphereGlass(("a",), (1.5,)), "radius", "'a'"),
        (lambda: optics.FlatGlass((0.01,), ()), "thickness", "0.01"),
        (lambda: optics.FlatGlass((0.0,), (1.5,)), "thickness", "0.0"),
        (lambda: optics.FlatGlass((0.01,), (INF,)), "ior", "inf"),
        (lambda: optics.FlatGlass((), (), ior_below=0.0), "ior_below", "0.0"),
        (lambda: optics.FlatGlass((), (), outline=[(0, 0), (1, 1)]), "outline", "(1, 1)"),
        (lambda: optics.LightPath("TX"), "events", "TX"),
        (lambda: optics.ParallelView((0.0, 0.0, 0.0)), "direction", "0.0"),
        (lambda: optics.ParallelView((0.0, NAN, 0.0)), "direction", "nan"),
    ],
)
def test_bad_input_names_field_and_value(make, field, value):
    with pytest.raises(ValueError) as caught:
        make()
    assert field in str(caught.value) and value in str(caught.value)


def test_bad_calls():
    glass = optics.CylinderGlass((0.04,), (1.5,))
    eye, points = (1.0, 0.0, 0.0), np.zeros((3, 3))
    result = optics.apparent_points(glass, "TT", eye, points)
    with pytest.raises(ValueError, match="guess"):
        optics.apparent_points(glass, "TT", eye, points[:2], guess=result)
    with pytest.raises(ValueError, match="points"):
        optics.apparent_points(glass, "TT", eye, np.zeros((3, 2)))
    with pytest.raises(ValueError, match="eye"):
        optics.apparent_points(glass, "TT", (NAN, 0.0, 0.0), points)
    with pytest.raises(ValueError, match="events"):
        optics.trace(glass, eye, [(-1.0, 0.0, 0.0)], "tt")


def test_frozen_comparable_hashable():
    one = optics.FlatGlass([0.01], np.array([1.5]), outline=np.eye(3)[:, :2])
    two = optics.FlatGlass((0.01,), (1.5,), outline=((1, 0), (0, 1), (0, 0)))
    assert one == two and hash(one) == hash(two)
    with pytest.raises(AttributeError):
        one.ior = (1.4,)
    assert optics.LightPath("TT") == optics.LightPath("TT")
    assert optics.ParallelView((0, 0, -2)).direction == (0.0, 0.0, -1.0)
