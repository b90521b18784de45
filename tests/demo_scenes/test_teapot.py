# SPDX-License-Identifier: GPL-3.0-or-later
"""The Utah teapot: Newell's points, welded where they meet, open only where he left it open."""

import itertools
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demo_scenes"))

import teapot as pot

SUBDIVISION = 6


@pytest.fixture(scope="module")
def mesh():
    return pot.teapot(SUBDIVISION)


def edges(faces):
    return Counter((a, b) for face in faces for a, b in itertools.pairwise((*face, face[0])))


def test_there_are_32_patches_of_290_points():
    points = pot.control_points()
    assert points.shape == (32, 4, 4, 3)
    distinct = np.unique(points.reshape(-1, 3) + 0.0, axis=0)
    assert len(distinct) == 290
    assert distinct.min(axis=0) == pytest.approx((-3.0, -2.0, 0.0))
    assert distinct.max(axis=0) == pytest.approx((3.525, 2.0, 3.15))


@pytest.mark.parametrize(
    "point",
    [
        (1.4, -0.784, 2.4),  # rim
        (-1.12, 2.0, 0.45),  # body
        (0.45, -0.8, 3.15),  # knob: not 0.8 * 0.56, the table says 0.45
        (-2.65, 0.3, 0.9375),  # handle
        (3.525, -0.25, 2.49375),  # spout
        (0.0, -1.425, 0.0),  # bottom
    ],
)
def test_points_of_the_published_table_are_there(point):
    assert np.linalg.norm(pot.control_points() - point, axis=-1).min() == 0.0


def test_patch_corners_lie_on_the_mesh(mesh):
    corners = pot.control_points()[:, ::3, ::3].reshape(-1, 3)
    distance = np.linalg.norm(mesh.positions[:, None] - corners, axis=-1).min(axis=0)
    assert distance.max() < 1e-12


def test_every_vertex_lies_on_a_patch(mesh):
    # On a patch's own grid; a vertex elsewhere would be a welding mistake.
    t = np.linspace(0.0, 1.0, SUBDIVISION + 1)
    grid = pot.evaluate(pot.control_points(), t, t).reshape(-1, 3)
    distance = [np.linalg.norm(grid - p, axis=-1).min() for p in mesh.positions]
    assert max(distance) < 1e-12


def test_no_vertex_is_double(mesh):
    # But for the one where the handle's lower end touches the pot's wall.
    values, count = np.unique(np.round(mesh.positions, 9), axis=0, return_counts=True)
    assert values[count > 1].tolist() == [[-2.0, 0.0, 0.9]]
    assert count.max() == 2


def test_faces_agree_on_their_orientation_and_open_only_at_the_six_mouths(mesh):
    directed = edges(mesh.faces)
    assert max(directed.values()) == 1
    border = [(a, b) for a, b in directed if (b, a) not in directed]
    after = dict(border)
    assert len(after) == len(border)
    loops = []
    while after:
        start, here = after.popitem()
        loop = [start]
        while here != start:
            loop.append(here)
            here = after.pop(here)
        loops.append(loop)
    # The pot's mouth and the lid's edge go round four patches, the tubes' ends round two.
    assert sorted(len(loop) // SUBDIVISION for loop in loops) == [2, 2, 2, 2, 4, 4]
    heights = {
        round(float(np.ptp(mesh.positions[loop, 2])), 6)
        for loop in loops
        if len(loop) == 4 * SUBDIVISION
    }
    assert heights == {0.0}


def test_faces_have_corners_of_their_own_and_area(mesh):
    for face in mesh.faces:
        assert len(face) in (3, 4)
        assert len(set(face)) == len(face)
    assert sum(len(face) == 3 for face in mesh.faces) == 2 * 4 * SUBDIVISION  # two poles


def test_normals_point_outwards_and_agree_with_the_faces(mesh):
    assert np.linalg.norm(mesh.normals, axis=-1) == pytest.approx(1.0, abs=1e-12)
    for face in mesh.faces:
        p = mesh.positions[list(face)]
        normal = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
        assert ((mesh.normals[list(face)] @ normal) > 0).all()
    # Outwards: the volume of wall and lid, the mouth closed by the plane z = 2.4, is positive.
    volume = 0.0
    for face, part in zip(mesh.faces, mesh.part, strict=True):
        if pot.PARTS[part] in ("rim", "body", "bottom", "lid"):
            p = mesh.positions[list(face)] - (0.0, 0.0, 2.4)
            for i in range(1, len(p) - 1):
                volume += np.linalg.det((p[0], p[i], p[i + 1])) / 6.0
    assert 20.0 < volume < 40.0


def test_spout_points_along_x(mesh):
    assert mesh.positions[mesh.positions[:, 0].argmax()] == pytest.approx((3.43, 0, 2.5), abs=0.05)


def test_finer_meshes_stay_on_the_surface():
    coarse, fine = pot.teapot(2), pot.teapot(8)
    distance = [np.linalg.norm(fine.positions - p, axis=-1).min() for p in coarse.positions]
    assert max(distance) < 1e-12
