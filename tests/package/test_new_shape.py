# SPDX-License-Identifier: GPL-3.0-or-later
"""CONTRIBUTING's *How to add a shape*, followed once: one class, and everything takes it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from glass_refraction import optics
from glass_refraction.optics.axial import SOLID, AxialGlass, Interface
from glass_refraction.optics.surfaces import Cylinder, Plane
from glass_refraction.scene.build.glass_mesh import glass_surfaces
from glass_refraction.scene.read.glasses import Glass
from glass_refraction.scene.vertices.hull import first_face

EYE = np.array((0.02, -0.4, 0.035))


@dataclass(frozen=True)
class Puck(AxialGlass):
    """A solid disc that stands on its origin: a paperweight. Lengths in metres."""

    radius: float
    height: float
    ior: float = 1.5
    liquid_ior: float = 1.0

    @property
    def scale(self):
        return self.radius

    @property
    def media(self):
        return (1.0, self.ior)

    @property
    def interfaces(self):
        top = self.height / self.radius
        return (
            Interface("outer", Cylinder(1.0, 0.0, top), 0, SOLID),
            Interface("base", Plane(0.0, 0.0, 1.0), SOLID, 0),
            Interface("top", Plane(top, 0.0, 1.0), 0, SOLID),
        )

    @property
    def hull(self):
        return 1.0, 0.0, self.height / self.radius

    def medium_at(self, points):
        within = np.hypot(points[..., 0], points[..., 1]) < self.radius
        inside = within & (points[..., 2] > 0.0) & (points[..., 2] < self.height)
        return np.where(inside, SOLID, 0)

    def holds(self, medium, points):
        inside = self.medium_at(points) == SOLID
        return inside if medium == SOLID else ~inside


@pytest.fixture
def puck():
    return Puck(0.05, 0.03)


@pytest.fixture
def directions(puck):
    random = np.random.default_rng(4)
    angle = random.uniform(0.0, 2.0 * np.pi, 400)
    reach = puck.radius * np.sqrt(random.uniform(0.0, 1.0, 400))
    height = random.uniform(0.0, puck.height, 400)
    towards = np.column_stack((reach * np.cos(angle), reach * np.sin(angle), height)) - EYE
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def test_rays_bring_all_the_light(puck, directions):
    ends = optics.exit_rays([optics.PlacedGlass(puck, np.eye(4))], EYE, directions)
    total = np.bincount(ends.ray, ends.weight, len(directions)) + ends.lost
    assert total == pytest.approx(np.ones(len(directions)), abs=1e-9)
    assert len(ends.weight) > len(directions)


def test_paths_weigh_no_more_than_all_the_light(puck, directions):
    paths = optics.light_paths(puck, EYE)
    assert any(path.events == "TT" for path in paths)
    weights, rest = optics.path_weights(puck, EYE, directions, paths)
    assert weights.sum(axis=0) + rest == pytest.approx(np.ones(len(directions)), abs=1e-9)
    assert rest.mean() < 0.2


def test_points_appear_where_rays_go_to_them(puck):
    points = np.random.default_rng(5).uniform((-0.03, 0.1, 0.0), (0.03, 0.2, 0.03), (50, 3))
    path = optics.LightPath("TT", ("outer", "outer"))
    found = optics.apparent_points(puck, path, EYE, points)
    slot, point = np.nonzero(found.valid)
    assert len(point)
    rays = optics.trace(puck, EYE, found.direction[slot, point], path)
    assert rays.valid.all()
    way = points[point] - rays.origin
    off = np.linalg.norm(np.cross(way, rays.direction), axis=1)
    assert off.max() < 1e-8


def test_it_has_an_outline_and_a_reference(puck):
    glass = Glass("Puck", puck, np.eye(4))
    vertices, faces = first_face(glass, EYE)
    assert np.hypot(*vertices[:, :2].T).max() == pytest.approx(puck.radius)
    assert faces.max() < len(vertices)
    surfaces = glass_surfaces(puck)
    assert {surface.name for surface in surfaces} == {"outer", "base", "top"}
    assert {(s.ior_inside, s.ior_outside) for s in surfaces} <= {(1.5, 1.0), (1.0, 1.5)}


def test_colours_find_it_by_their_own_ior(puck):
    assert Glass("Puck", puck, np.eye(4), abbe=(30.0, 0.0)).in_light("blue").description.ior > 1.5


def test_the_recipe_is_ten_lines_long():
    text = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    recipe = text.split("## How to add a shape")[1].split("## ")[0].strip()
    steps = recipe[recipe.index("1.") :].splitlines()
    assert len(steps) <= 10
