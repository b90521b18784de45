# SPDX-License-Identifier: GPL-3.0-or-later
"""The glass's meshes: closed round every medium, oriented, with the true surface's normals."""

from collections import Counter

import numpy as np
import pytest

from glass_refraction.optics import (
    CylinderGlass,
    FlatGlass,
    RevolutionGlass,
    SphereGlass,
    Tumbler,
)
from glass_refraction.scene.build.glass_mesh import glass_surfaces

ANGLE = np.arange(10) * np.pi / 5
STAR = (
    np.column_stack((np.cos(ANGLE), np.sin(ANGLE)))
    * np.where(np.arange(10) % 2, 0.05, 0.12)[:, None]
)
PANE = [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)]

TUBE = CylinderGlass((0.040, 0.037), (1.5, 1.0), extent=(0.0, 0.12))
FILLED = CylinderGlass((0.040, 0.037), (1.5, 1.333), extent=(0.0, 0.12))
NESTED = CylinderGlass((0.040, 0.037, 0.01), (1.5, 1.333, 1.6), extent=(-0.05, 0.07))
ROD = CylinderGlass((0.02,), (1.5,), extent=(0.0, 0.1))
BOWL = SphereGlass((0.15, 0.147), (1.5, 1.333))
SLAB = FlatGlass((0.01,), (1.5,), outline=PANE)
STAR_SLAB = FlatGlass((0.2,), (1.5,), outline=STAR)
LAMINATE = FlatGlass((0.01, 0.002), (1.5, 1.7), outline=STAR[::-1])
CUP = Tumbler(0.036, 0.0025, 0.11, 0.007, 1.5, 1.333, level=0.065)
FULL_CUP = Tumbler(0.036, 0.0025, 0.11, 0.007, 1.5, 1.333, level=0.103)
EMPTY_CUP = Tumbler(0.036, 0.0025, 0.11, 0.007, 1.5)
GOBLET = RevolutionGlass(
    [(0, 0), (0.02, 0.004), (0.033, 0.03), (0.036, 0.07), (0.035, 0.11)],
    [(0, 0.008), (0.018, 0.012), (0.030, 0.034), (0.033, 0.07), (0.033, 0.11)],
    level=0.04,
)


def area(outline):
    x, y = np.asarray(outline).T
    return abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def faces(surface):
    return np.split(surface.corners, np.cumsum(surface.sizes)[:-1])


def boundary(glass, ior, **options):
    """Faces round the medium of that ior as vertex numbers, oriented out of it, and positions."""
    surfaces = [s for s in glass_surfaces(glass, **options) if ior in (s.ior_inside, s.ior_outside)]
    outward = [s if s.ior_inside == ior else s.flipped() for s in surfaces]
    positions = np.concatenate([s.vertices for s in outward])
    # Borders must agree bit by bit.
    unique, index = np.unique(positions, axis=0, return_inverse=True)
    index = index.ravel()
    joined, start = [], 0
    for s in outward:
        joined += [index[face + start] for face in faces(s)]
        start += len(s.vertices)
    return joined, unique


def volume(joined, positions):
    """Signed volume; a fan from the first corner is right for plane concave faces as well."""
    total = 0.0
    for face in joined:
        p = positions[face]
        total += np.sum(p[0] * np.cross(p[1:-1], p[2:])) / 6
    return total


def polygon(segments):
    """Area of the regular polygon in the unit circle."""
    return segments * np.sin(2 * np.pi / segments) / 2


WALL = 0.040**2 - 0.037**2
BODIES = [
    (TUBE, 1.5, WALL * 0.12 * polygon(64)),
    (FILLED, 1.5, WALL * 0.12 * polygon(64)),
    (FILLED, 1.333, 0.037**2 * 0.12 * polygon(64)),
    (NESTED, 1.333, (0.037**2 - 0.01**2) * 0.12 * polygon(64)),
    (NESTED, 1.6, 0.01**2 * 0.12 * polygon(64)),
    (ROD, 1.5, 0.02**2 * 0.1 * polygon(64)),
    (SLAB, 1.5, area(PANE) * 0.01),
    (STAR_SLAB, 1.5, area(STAR) * 0.2),
    (CUP, 1.5, (0.036**2 * 0.11 - 0.0335**2 * 0.103) * polygon(64)),
    (CUP, 1.333, 0.0335**2 * 0.065 * polygon(64)),
    (FULL_CUP, 1.5, (0.036**2 * 0.11 - 0.0335**2 * 0.103) * polygon(64)),
    (FULL_CUP, 1.333, 0.0335**2 * 0.103 * polygon(64)),
    (EMPTY_CUP, 1.5, (0.036**2 * 0.11 - 0.0335**2 * 0.103) * polygon(64)),
    (LAMINATE, 1.5, area(STAR) * 0.01),
    (LAMINATE, 1.7, area(STAR) * 0.002),
    (BOWL, 1.5, None),
    (BOWL, 1.333, None),
]


@pytest.mark.parametrize(("glass", "ior", "expected"), BODIES)
def test_every_medium_is_enclosed_and_faces_look_out_of_it(glass, ior, expected):
    joined, positions = boundary(glass, ior, segments=64)
    edges = Counter(
        (a, b) for f in joined for a, b in zip(f.tolist(), np.roll(f, -1).tolist(), strict=True)
    )
    assert max(edges.values()) == 1
    assert all((b, a) in edges for a, b in edges)
    measured = volume(joined, positions)
    if expected is None:
        bounds = (*BOWL.radius, 0.0)
        i = BOWL.ior.index(ior)
        expected = 4 / 3 * np.pi * (bounds[i] ** 3 - bounds[i + 1] ** 3)
        assert measured == pytest.approx(expected, rel=0.01)
    else:
        assert measured == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ior", [1.5, 1.333])
def test_media_of_a_turned_profile_are_enclosed(ior):
    joined, positions = boundary(GOBLET, ior, segments=64)
    edges = Counter(
        (a, b) for f in joined for a, b in zip(f.tolist(), np.roll(f, -1).tolist(), strict=True)
    )
    assert max(edges.values()) == 1
    assert all((b, a) in edges for a, b in edges)
    assert volume(joined, positions) > 0


@pytest.mark.parametrize("glass", [CUP, FULL_CUP, GOBLET])
def test_interfaces_know_their_media_and_normals_look_to_the_front(glass):
    for s, interface in zip(glass_surfaces(glass, segments=64), glass.interfaces, strict=True):
        assert (s.name, s.media) == (interface.name, (interface.front, interface.back))
        assert (s.ior_outside, s.ior_inside) == tuple(glass.media[m] for m in s.media)
        assert np.linalg.norm(s.normals, axis=1) == pytest.approx(1, abs=1e-12)
        starts = np.cumsum(s.sizes) - s.sizes
        for start, face in zip(starts, faces(s), strict=True):
            p = s.vertices[face]
            winding = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
            assert winding @ s.normals[start] > 0


@pytest.mark.parametrize("glass", [TUBE, FILLED, NESTED, ROD, BOWL, SLAB, STAR_SLAB, LAMINATE])
def test_normals_are_those_of_the_true_surface(glass):
    for s in glass_surfaces(glass, segments=64):
        assert np.linalg.norm(s.normals, axis=1) == pytest.approx(1, abs=1e-12)
        points = s.vertices[s.corners]
        kind = s.name.split()[0]
        inward = -1 if s.name.split()[-1] != "0" and kind in ("wall", "shell") else 1
        if kind == "shell":
            expected = inward * points / np.linalg.norm(points, axis=1, keepdims=True)
        elif kind == "wall":
            radial = points * (1, 1, 0)
            expected = inward * radial / np.linalg.norm(radial, axis=1, keepdims=True)
        else:
            # Plane faces: the face's own normal, from its corners (Newell).
            normal = [
                np.cross(s.vertices[f], np.roll(s.vertices[f], -1, axis=0)).sum(axis=0)
                for f in faces(s)
            ]
            normal = np.array(normal) / np.linalg.norm(normal, axis=1, keepdims=True)
            expected = np.repeat(normal, s.sizes, axis=0)
        assert s.normals == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("glass", [TUBE, FILLED, NESTED, ROD, BOWL, SLAB, STAR_SLAB, LAMINATE, CUP])
def test_every_vertex_has_one_normal(glass):
    """Cycles takes one of several and bends light at the others' faces by it."""
    for surface in glass_surfaces(glass, segments=16):
        known = {}
        for vertex, normal in zip(surface.corners, surface.normals, strict=True):
            np.testing.assert_array_equal(known.setdefault(int(vertex), normal), normal)


def test_every_face_winds_round_its_normals():
    for glass in (TUBE, FILLED, ROD, BOWL, STAR_SLAB):
        for s in glass_surfaces(glass, segments=32):
            starts = np.cumsum(s.sizes) - s.sizes
            for start, face in zip(starts, faces(s), strict=True):
                p = s.vertices[face]
                winding = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
                assert winding @ s.normals[start] > 0


def test_each_interface_carries_its_two_media():
    media = {s.name: (s.ior_inside, s.ior_outside) for s in glass_surfaces(FILLED, segments=8)}
    assert media == {
        "wall 0": (1.5, 1.0),
        "wall 1": (1.5, 1.333),
        "upper rim 0": (1.5, 1.0),
        "lower rim 0": (1.5, 1.0),
        "upper rim 1": (1.333, 1.0),
        "lower rim 1": (1.333, 1.0),
    }
    # A hollow glass has no lid over its cavity.
    assert {s.name for s in glass_surfaces(TUBE, segments=8)} == set(media) - {
        "upper rim 1",
        "lower rim 1",
    }
    tank = glass_surfaces(FlatGlass((0.01,), (1.5,), ior_below=1.333))
    assert [(s.ior_inside, s.ior_outside) for s in tank] == [(1.5, 1.0), (1.5, 1.333)]
    (water,) = glass_surfaces(FlatGlass((), (), ior_below=1.333))
    assert (water.ior_inside, water.ior_outside) == (1.333, 1.0)


def test_vertices_lie_on_the_true_surfaces():
    for s, radius in zip(glass_surfaces(BOWL), BOWL.radius, strict=True):
        assert np.linalg.norm(s.vertices, axis=1) == pytest.approx(radius, rel=1e-12)
    outer, inner = (s for s in glass_surfaces(TUBE) if s.name.startswith("wall"))
    assert np.hypot(*outer.vertices.T[:2]) == pytest.approx(0.040, rel=1e-12)
    assert np.hypot(*inner.vertices.T[:2]) == pytest.approx(0.037, rel=1e-12)


def test_an_unbounded_glass_is_cut_off_at_its_reach():
    for glass in (FlatGlass((0.01,), (1.5,)), CylinderGlass((0.04, 0.03), (1.5, 1.0))):
        surfaces = glass_surfaces(glass, segments=16, reach=7.0)
        assert len(surfaces) == 2
        assert max(np.abs(s.vertices).max() for s in surfaces) == 7.0


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="segments must be at least 4, not 3"):
        glass_surfaces(ROD, segments=3)
    with pytest.raises(ValueError, match="reach must be positive, not 0"):
        glass_surfaces(ROD, reach=0)
    with pytest.raises(TypeError, match="no mesh for a glass of type str"):
        glass_surfaces("rod")
