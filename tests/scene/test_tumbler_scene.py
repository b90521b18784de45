# SPDX-License-Identifier: GPL-3.0-or-later
"""A tumbler in Blender: description, outline, regions, copies and picture, by whole light paths."""

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from glass_refraction import optics
from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.build.own_scenes import source_of
from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.update import memory_of, prepare, update
from glass_refraction.scene.vertices.hull import faces_eye, first_face
from glass_refraction.scene.vertices.path_keys import path_key, path_of
from glass_refraction.scene.vertices.regions import (
    centre_weights,
    in_picture,
    left_out_pixels,
    picture_rect,
)


def _glass_and_view(scene):
    depsgraph = scenes.depsgraph()
    return read_glasses(depsgraph)[0], read_viewpoint(scene, depsgraph)


def test_the_modifier_describes_the_tumbler():
    obj = scenes.cup()
    obj.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    found = read_glasses(scenes.depsgraph())[0].description
    assert isinstance(found, optics.Tumbler)
    np.testing.assert_allclose(
        [found.radius, found.wall, found.height, found.bottom, found.level, found.liquid_ior],
        [0.072, 0.005, 0.22, 0.014, 0.13, 1.333],
        rtol=1e-6,
    )


@pytest.mark.parametrize(("level", "expected"), [(0.0, 0.0), (0.05, 0.05), (1.0, 0.103)])
def test_more_than_full_is_full(level, expected):
    scenes.cup(liquid_level=level)
    found = read_glasses(scenes.depsgraph())[0].description
    assert found.level == pytest.approx(expected, abs=1e-7)


def test_impossible_sizes_are_named():
    obj = scenes.cup()
    write_input(glass_modifier(obj), "Bottom Thickness", 0.2)
    bpy.context.view_layer.update()
    with pytest.raises(RefractiveGlassError, match="bottom thickness"):
        read_glasses(scenes.depsgraph())


@pytest.mark.parametrize("path", ["TT", "", "TRT"])
def test_keys_of_plain_paths_are_their_events(path):
    assert path_key(optics.LightPath(path)) == path
    assert path_of(path) == optics.LightPath(path)


def test_keys_tell_paths_apart_and_back():
    glass = optics.Tumbler(0.036, 0.0025, 0.11, 0.007, level=0.065)
    paths = list(optics.light_paths(glass, (0.0, -0.3, 0.1), min_weight=0.1))
    assert [path_of(path_key(path)) for path in paths] == paths


@pytest.mark.parametrize("eye", [scenes.LOW, scenes.HIGH, (0.0, 0.0, 0.4)])
def test_the_outline_is_what_rays_meet(eye):
    """Rays meet the mesh's front just where the optics say that they meet the glass."""
    scenes.cup(eye)
    glass, view = _glass_and_view(scenes.settings())
    local = view.eye_for(glass)
    vertices, faces = first_face(glass, local)
    faces = faces[faces_eye(vertices, faces, local)]
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    rng = np.random.default_rng(3)
    aim = rng.uniform((-0.05, -0.05, -0.02), (0.05, 0.05, 0.13), (2000, 3))
    directions = aim - local
    missed, _ = optics.path_weights(glass.description, local, directions, [optics.LightPath("")])
    met = [tree.ray_cast(Vector(local), Vector(d))[0] is not None for d in directions]
    # The mesh's facets leave out a sliver at the verge.
    assert (np.array(met) == (missed[0] < 0.5)).mean() > 0.995


@pytest.mark.parametrize(("eye", "most"), [(scenes.LOW, 0.02), (scenes.HIGH, 0.02)])
def test_little_of_the_light_is_left_out(eye, most):
    """From above some rays are caught in the wall under the rim for good."""
    scenes.cup(eye)
    scene = scenes.settings(60, 45)
    assert left_out_pixels(scene, scenes.depsgraph(), ()) < most
    scene.refractive_glass.surface = "REFRACTION"
    assert left_out_pixels(scene, scenes.depsgraph(), ()) == 0.0


def test_copies_trace_back_to_the_points():
    scenes.cup()
    rod = scenes.rod()
    scene = scenes.settings(surface="REFRACTION", shading="DISPLACED")
    prepare(scene, scenes.depsgraph())
    update(scene, scenes.depsgraph())
    glass, view = _glass_and_view(scene)
    layers = find_layers(scene)
    checked = 0
    for key, (_, _, shape) in memory_of(scene).copies.items():
        path = memory_of(scene).shown[key[0]][1][key[1]]
        if not path.open or shape.images is None or source_of(layers.copies()[key]) != rod:
            continue
        points = glass.to_local(shape.triangles.points)
        for position, valid in zip(shape.images.position, shape.images.valid, strict=True):
            eye = view.eye_for(glass)
            ray = optics.trace(glass.description, eye, glass.to_local(position[valid]) - eye, path)
            assert ray.valid.mean() > 0.99
            away = points[valid] - ray.origin
            ahead = np.sum(away * ray.direction, axis=1)
            off = np.linalg.norm(away - ahead[:, None] * ray.direction, axis=1)[ray.valid]
            # A tenth of the tolerance, in metres at the rod.
            assert (off < 0.1 * 0.25 / view.focal_px * 0.5).mean() > 0.99
            checked += int(valid.sum())
    assert checked > 50


def test_the_picture_is_that_of_real_glass(tmp_path):
    scenes.cup(scenes.HIGH)
    scenes.rod()
    scene = scenes.settings(80, 80, samples=16, surface="REFRACTION", shading="DISPLACED")
    found = scenes.picture(scene, tmp_path)
    reference = render_reference(scene, surface="REFRACTION")
    glass, view = _glass_and_view(scene)
    _, hit = centre_weights(glass, view, (optics.LightPath(""),))
    inside = in_picture(hit, picture_rect(glass, view), view.size)
    gap = np.clip(found, 0, 1)[inside, :3] - np.clip(reference, 0, 1)[inside, :3]
    # Large pixels, few samples, and no paths through rim and verge that bring little each.
    assert -10 * np.log10(np.mean(gap**2)) > 24.0
