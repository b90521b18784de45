# SPDX-License-Identifier: GPL-3.0-or-later
"""Snell, the mirror and Fresnel at one interface."""

import numpy as np
import pytest

from glass_refraction import optics


@pytest.fixture
def interface():
    rng = np.random.default_rng(11)
    normal = rng.normal(size=(5000, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    direction = rng.normal(size=(5000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction *= -np.sign(np.sum(direction * normal, axis=1))[:, None]
    return direction, normal, rng.uniform(0.4, 2.5, 5000)


def test_refraction_obeys_snell_and_stays_in_the_plane(interface):
    direction, normal, eta = interface
    refracted, total = optics.refract(direction, normal, eta)
    through = ~total
    before, after = np.cross(normal, direction), np.cross(normal, refracted)
    np.testing.assert_allclose(after[through], (eta[:, None] * before)[through], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(refracted[through], axis=1), 1.0, atol=1e-14)
    assert (np.sum(refracted * normal, axis=1)[through] <= 0.0).all()
    assert total.any() and (refracted[total] == 0.0).all()
    assert (eta * np.linalg.norm(before, axis=1) > 1.0 - 1e-12)[total].all()


def test_refraction_is_reversible(interface):
    direction, normal, eta = interface
    refracted, total = optics.refract(direction, normal, eta)
    back, lost = optics.refract(-refracted[~total], -normal[~total], 1.0 / eta[~total])
    assert not lost.any()
    steep = -np.sum(refracted * normal, axis=1)[~total] > 1e-3
    np.testing.assert_allclose(back[steep], -direction[~total][steep], atol=1e-12)


def test_reflection(interface):
    direction, normal, _ = interface
    mirrored = optics.reflect(direction, normal)
    np.testing.assert_allclose(np.cross(normal, mirrored), np.cross(normal, direction), atol=1e-14)
    np.testing.assert_allclose(
        np.sum(normal * mirrored, axis=1), -np.sum(normal * direction, axis=1), atol=1e-14
    )


def test_equal_media_change_nothing(interface):
    direction, normal, _ = interface
    refracted, total = optics.refract(direction, normal, 1.0)
    assert not total.any()
    np.testing.assert_allclose(refracted, direction, atol=1e-15)
    assert (optics.fresnel(np.linspace(0.01, 1.0, 50), 1.0) == 0.0).all()


def test_fresnel_known_values():
    assert optics.fresnel(1.0, 1.0 / 1.5) == pytest.approx(0.04, abs=1e-15)
    assert optics.fresnel(0.0, 1.0 / 1.5) == 1.0
    assert optics.fresnel(0.5, 1.5) == 1.0  # beyond the critical angle
    # At Brewster's angle half of what is left is reflected: only one polarisation.
    brewster = np.cos(np.arctan(1.5))
    ratio = (1.5**2 - 1.0) / (1.5**2 + 1.0)
    assert optics.fresnel(brewster, 1.0 / 1.5) == pytest.approx(0.5 * ratio**2, abs=1e-15)


def test_fresnel_is_the_same_from_both_sides(interface):
    direction, normal, eta = interface
    refracted, total = optics.refract(direction, normal, eta)
    ahead = optics.fresnel(-np.sum(direction * normal, axis=1), eta)
    back = optics.fresnel(-np.sum(refracted * normal, axis=1), 1.0 / eta)
    np.testing.assert_allclose(ahead[~total], back[~total], atol=1e-10)
    assert (ahead[total] == 1.0).all()
    assert ((ahead >= 0.0) & (ahead <= 1.0)).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_both_sides_of_the_critical_angle(side):
    sine = (1.0 / 1.5) * (1.0 + side * 1e-12)
    direction = np.array([[sine, 0.0, -np.sqrt(1.0 - sine * sine)]])
    refracted, total = optics.refract(direction, [[0.0, 0.0, 1.0]], 1.5)
    assert total[0] == (side > 0.0)
    assert np.isfinite(refracted).all()
    assert optics.fresnel(-direction[0, 2], 1.5) <= 1.0


def test_media():
    assert len(optics.MEDIA) == 18
    assert optics.MEDIA["Water"] == 1.33333 and optics.MEDIA["Diamond"] == 2.417
    assert all(1.0 <= ior < 2.5 for ior in optics.MEDIA.values())


@pytest.mark.parametrize("path", ["TTTT", "TRT", "TTRTT"])
def test_stretches_are_the_parts_of_a_traced_ray(path):
    """Each begins where the one before meets the next surface, and Snell's law holds between."""
    rng = np.random.default_rng(8)
    glass = optics.CylinderGlass((0.04, 0.037), (1.5, 1.333), extent=(-0.1, 0.1))
    eye = np.array((0.02, -0.4, 0.03))
    directions = rng.uniform((-0.05, -0.04, -0.1), (0.05, 0.04, 0.1), (2000, 3)) - eye
    whole = optics.trace(glass, eye, directions, path)
    takes = np.flatnonzero(whole.valid)
    assert len(takes) > 100
    origin, direction, length = optics.stretches(glass, eye, directions, optics.LightPath(path))
    places = [np.broadcast_to(eye, (len(takes), 3)), *origin.reshape(len(path), -1, 3)]
    along, length = direction.reshape(len(path), -1, 3), length.reshape(len(path), -1)
    np.testing.assert_array_equal(places[-1], whole.origin[takes])
    np.testing.assert_array_equal(along[-1], whole.direction[takes])
    for here, there, way, far in zip(places[1:], places[2:], along, length, strict=False):
        np.testing.assert_allclose(there, here + far[:, None] * way, atol=1e-9)
    assert np.isinf(length[-1]).all()
    radius = np.hypot(*np.moveaxis(np.array(places[1:])[..., :2], -1, 0))
    np.testing.assert_allclose(
        np.min(np.abs(radius[..., None] - glass.radius), axis=-1), 0, atol=1e-12
    )
