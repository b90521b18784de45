# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles split where straight images miss the true ones: no cracks, nothing lost, the bound."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.scene.read.arrays import corner_normals, read_attribute
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.mesh_arrays import read_source_mesh, write_mesh
from glass_refraction.scene.read.sources import pieces
from glass_refraction.scene.read.triangles import Triangles
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.vertices.appearance import Solver
from glass_refraction.scene.vertices.regions import picture_rect
from glass_refraction.scene.vertices.tessellation import (
    PER_PIXEL,
    Images,
    refine,
    region_probe,
)


def _grid(n=4):
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    points = np.column_stack((x.ravel(), y.ravel(), np.zeros(n * n)))
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    corners = np.concatenate(
        (np.stack((k, k + 1, k + n), axis=1), np.stack((k + 1, k + n + 1, k + n), axis=1))
    )
    return Triangles.whole(points, corners)


def _areas(triangles):
    a, b, c = (triangles.points[triangles.corners[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)[:, 2]


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_splits_keep_area_orientation_and_leave_no_crack(share):
    triangles = whole = _grid()
    rng = np.random.default_rng(5)
    for _ in range(4):
        edges, triangle_edges = triangles.edges()
        triangles = triangles.split(edges, triangle_edges, rng.random(len(edges)) < share)
    areas = _areas(triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(1.0, abs=1e-12)
    # Each edge inside belongs to two triangles, each on the border to one: no T-junction.
    edges, triangle_edges = triangles.edges()
    uses = np.bincount(triangle_edges.ravel(), minlength=len(edges))
    middle = triangles.points[edges].mean(axis=1)[:, :2]
    border = np.any((middle == 0) | (middle == 1), axis=1)
    np.testing.assert_array_equal(uses, np.where(border, 1, 2))
    # The barycentric coordinates say where in the source triangle each corner is.
    source = whole.points[whole.corners[triangles.origin]]
    placed = np.einsum("tij,tjk->tik", triangles.weights, source)
    np.testing.assert_allclose(placed, triangles.points[triangles.corners], atol=1e-12)


def _case(shape, **values):
    scenes.camera()
    scene = scenes.settings(200, 150)
    scenes.glass(shape=shape, **values)
    view = read_viewpoint(scene, scenes.depsgraph())
    glass = read_glasses(scenes.depsgraph())[0]
    return glass, view


def test_a_straw_through_a_tube_is_seen_though_it_has_no_vertex_in_it():
    glass, view = _case("CYLINDER", wall_thickness=0.003)
    path = optics.LightPath("TTTT")
    solver = Solver(glass, path, view, 0.01)
    points = np.array([(0.0, 0, -0.1), (0.005, 0, -0.1), (0.01, 0, 0.3), (0.005, 0, 0.3)])
    straw = Triangles.whole(points, np.array([(0, 1, 2), (0, 2, 3)]))
    rect = picture_rect(glass, view)
    found = refine(straw, solver.images, region_probe(glass, view, path, rect), view, rect, 0.25)
    assert found.visible
    images = solver.images(found.triangles.points)
    z = found.triangles.points[images.valid.any(axis=0), 2]
    # All of it that stands in the tube, whose wall hides a little at either end.
    assert z.min() < 0.02 and z.max() > 0.1


def test_an_image_that_never_comes_to_rest_costs_no_more_than_its_pixels_are_worth():
    glass, view = _case("CYLINDER", wall_thickness=0.003)
    rect = (90, 65, 110, 80)
    solved = []

    def jumping(points):
        # Neighbours appear pixels apart, however near to each other they are.
        solved.append(len(points))
        places = points[None] + 0.02 * np.sin(1e7 * points[None])
        return Images(places, np.ones((1, len(points)), bool), np.zeros(1, int))

    points = np.array([(-0.1, 0, -0.1), (0.1, 0, -0.1), (0.1, 0, 0.2), (-0.1, 0, 0.2)])
    wall = Triangles.whole(points, np.array([(0, 1, 2), (0, 2, 3)]))
    probe = region_probe(glass, view, optics.LightPath("TTTT"), picture_rect(glass, view))
    found = refine(wall, jumping, probe, view, rect, 0.25)
    allowed = PER_PIXEL * 20 * 15
    assert allowed / 8 < len(found.triangles.points) <= len(points) + allowed
    # Each vertex has six edges, and each edge has one middle and two vertices.
    assert sum(solved) <= 4 * (len(points) + allowed)


@pytest.mark.parametrize(
    ("shape", "events", "pose"),
    [("CYLINDER", "TTTT", None), ("SLAB", "TT", (1.3, 0.2, 0.0))],
)
def test_one_large_quad_is_refined_to_the_tolerance_where_it_is_seen(shape, events, pose):
    glass, view = _case(shape, wall_thickness=0.003 if shape == "CYLINDER" else 0.05)
    if pose:
        bpy.context.object.rotation_euler = pose
        bpy.context.object.location = (0, 0, 0.06)
        bpy.context.view_layer.update()
        glass = read_glasses(scenes.depsgraph())[0]
    path = optics.LightPath(events)
    solver = Solver(glass, path, view, 0.01)
    points = np.array([(-2, 0.3, -2), (2, 0.3, -2), (2, 0.3, 2), (-2, 0.3, 2)], float)
    wall = Triangles.whole(points, np.array([(0, 1, 2), (0, 2, 3)]))
    rect = picture_rect(glass, view)
    tolerance = 0.25
    probe = region_probe(glass, view, path, rect)
    assert len(probe.origin) > 100
    found = refine(wall, solver.images, probe, view, rect, tolerance)
    assert found.visible
    assert found.bound_px <= tolerance
    assert _areas_3d(found.triangles).sum() == pytest.approx(16.0)

    # What the rays of the region meet must be drawn within the tolerance: trace a ray through a
    # pixel to the wall, interpolate the images of the triangle's vertices there, project.
    # A probe has the rays of each stretch behind the first surface; only the last have no end.
    behind = np.isinf(probe.length)
    assert behind.sum() == len(behind) // len(events)
    origin, direction = probe.origin[behind], probe.direction[behind]
    distance = (0.3 - origin[:, 1]) / direction[:, 1]
    met = origin + distance[:, None] * direction
    images = solver.images(found.triangles.points)
    exact = solver.images(met)
    last = len(events)
    (slot,), (exact_slot,) = ((i.stretch == last).nonzero()[0] for i in (images, exact))
    pixels = view.pixels(exact.position[exact_slot])
    corners = found.triangles.corners
    checked = 0
    for point, pixel in zip(met, pixels, strict=True):
        weights = _barycentric(point, found.triangles.points[corners])
        which = np.nonzero(weights.min(axis=1) > -1e-9)[0]
        assert len(which)
        if not images.valid[slot][corners[which[0]]].all():
            continue
        mixed = weights[which[0]] @ images.position[slot][corners[which[0]]]
        assert np.linalg.norm(view.pixels(mixed[None])[0] - pixel) < 1.5 * tolerance
        checked += 1
    assert checked > 0.8 * len(met)


def _areas_3d(triangles):
    a, b, c = (triangles.points[triangles.corners[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _barycentric(point, corners):
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    size = np.einsum("tk,tk->t", normal, normal)
    u = np.einsum("tk,tk->t", np.cross(c - b, point - b), normal) / size
    v = np.einsum("tk,tk->t", np.cross(a - c, point - c), normal) / size
    return np.stack((u, v, 1 - u - v), axis=1)


def test_attributes_and_normals_survive_refinement():
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8, rotation=(0.4, 0.1, 0.7))
    source = bpy.context.object
    bpy.ops.object.shade_smooth()
    for name in ("one", "two"):
        source.data.materials.append(scenes.emissive(name, (1, 1, 1)))
    half = np.arange(len(source.data.polygons), dtype=np.int32) % 2
    source.data.polygons.foreach_set("material_index", half)
    weight = source.data.attributes.new("weight", "FLOAT", "POINT")
    weight.data.foreach_set("value", np.array([v.co.x for v in source.data.vertices], np.float32))
    with pieces(source, scenes.depsgraph()) as parts:
        arrays = read_source_mesh(parts)
        triangles = Triangles.whole(arrays.points, arrays.corners)
        for _ in range(2):
            edges, triangle_edges = triangles.edges()
            triangles = triangles.split(edges, triangle_edges, np.ones(len(edges), bool))
        made = bpy.data.meshes.new("made")
        write_mesh(made, arrays.parted(triangles))
        original = corner_normals(parts[0].mesh)
    assert not made.validate()
    assert len(made.polygons) == 16 * len(arrays.corners)
    index = read_attribute(made.attributes["material_index"])[:, 0]
    np.testing.assert_array_equal(index, np.repeat(_material(arrays), 1)[triangles.origin])
    # Linear in position on each flat source triangle: so is what was interpolated on it.
    local = (triangles.points - np.array(source.matrix_world.translation)) @ np.array(
        source.matrix_world.to_3x3()
    )
    value = read_attribute(made.attributes["weight"])[:, 0]
    np.testing.assert_allclose(value, local[triangles.corners.ravel(), 0], atol=1e-5)
    assert "UVMap" in made.attributes
    normals = read_attribute(made.attributes["rg_normal"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    turned = original @ np.array(source.matrix_world.to_3x3()).T
    first = normals.reshape(-1, 3)
    nearest = np.linalg.norm(first[:200, None] - turned[None], axis=2).min(axis=1)
    assert np.median(nearest) < 0.3


def _material(arrays):
    return arrays.of_face["material_index"][1][:, 0]
