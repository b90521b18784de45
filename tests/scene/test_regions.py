# SPDX-License-Identifier: GPL-3.0-or-later
"""Which light path each pixel's ray takes, against the glass's own mesh and a dense scan."""

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from glass_refraction import optics
from glass_refraction.scene import progress
from glass_refraction.scene.build.glass_mesh import glass_surfaces
from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.vertices import regions
from glass_refraction.scene.vertices.hull import faces_eye, first_face
from glass_refraction.scene.vertices.region_map import write_region_map
from glass_refraction.scene.vertices.regions import (
    FILTER_WIDTH,
    PATH_SEARCH_RAYS,
    SUPPORT,
    PathRays,
    blackman_harris,
    crossing_counts,
    mean_weights,
    path_regions,
    picture_rect,
    region_masks,
)


def _case(size=(96, 72), **values):
    scene = scenes.settings(*size)
    obj = scenes.glass(**values)
    bpy.context.view_layer.update()
    return scene, obj


def _read(scene):
    return read_glasses(scenes.depsgraph())[0], read_viewpoint(scene, scenes.depsgraph())


def _peeled(glass, view):
    """How many faces of the glass's mesh each pixel's straight ray crosses (depth peeling)."""
    trees = []
    for surface in glass_surfaces(glass.description):
        ends = np.cumsum(surface.sizes)
        faces = [
            surface.corners[e - n : e].tolist() for e, n in zip(ends, surface.sizes, strict=True)
        ]
        trees.append(BVHTree.FromPolygons(surface.vertices.tolist(), faces))
    width, height = view.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    origins, directions = view.rays(x.ravel(), y.ravel())
    counts = np.zeros(width * height, int)
    origins, directions = glass.to_local(origins), glass.direction_to_local(directions)
    for number, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        for tree in trees:
            start = Vector(origin)
            for _ in range(8):
                place, _, _, _ = tree.ray_cast(start, Vector(direction))
                if place is None:
                    break
                counts[number] += 1
                start = place + Vector(direction) * 1e-6
    return counts.reshape(height, width)


def _near_border(labels):
    """Pixels within one of another label, or of the picture's edge, beyond which one may lie."""
    near = np.ones(labels.shape, bool)
    near[1:-1, 1:-1] = False
    padded = np.pad(labels, 1, mode="edge")
    for dy in range(3):
        for dx in range(3):
            near |= padded[dy : dy + labels.shape[0], dx : dx + labels.shape[1]] != labels
    return near


@pytest.mark.parametrize("camera", [{}, {"type": "ORTHO", "ortho_scale": 0.12}])
def test_regions_of_an_empty_glass_are_the_counts_of_depth_peeling(camera):
    # The walls reach beyond the picture: rims are another matter.
    scenes.camera(location=(0.01, -0.5, 0.5), tilt=np.pi / 2, **camera)
    scene, obj = _case(shape="CYLINDER", radius=0.05, wall_thickness=0.006, height=1.0)
    obj.rotation_euler = (0.0, 0.3, 0.0)
    obj.location.x -= 0.15
    bpy.context.view_layer.update()
    glass, view = _read(scene)
    expected = _peeled(glass, view)
    assert {0, 2, 4} <= set(np.unique(expected))
    found = crossing_counts(scene, scenes.depsgraph())
    inside = ~_near_border(expected)
    np.testing.assert_array_equal(found[inside], expected[inside])


def test_weights_sum_to_one_with_rest_and_are_one_where_a_surface_only_refracts():
    scenes.camera()
    scene, _ = _case(shape="CYLINDER", contents_ior=1.333)
    glass, view = _read(scene)
    paths = optics.light_paths(glass.description, view.eye_for(glass), min_weight=0.001)
    found = path_regions(glass, view, paths)
    total = found.weights.sum(axis=0)[found.hit]
    assert total.max() <= 1 + 1e-6
    assert np.median(total) > 0.97
    plain = path_regions(glass, view, paths, fresnel=False)
    number = [p.events for p in paths].index("TTTT")
    whole = PathRays(glass, view, paths, False).whole_pixels()[number]
    assert whole.any()
    np.testing.assert_allclose(plain.weights[number][whole], 1.0)


@pytest.mark.parametrize("shift", [0.0, 0.3365])
def test_few_rays_tell_which_paths_are_bright_however_little_of_a_glass_is_seen(shift, monkeypatch):
    scenes.camera()
    scene, obj = _case((960, 720), shape="CYLINDER", height=10.0)
    obj.location = (shift, 0.0, -5.0)
    bpy.context.view_layer.update()
    glass, view = _read(scene)
    x0, _, x1, _ = picture_rect(glass, view, margin=0)
    assert (0 < x1 - x0 < 4) == (shift > 0.0)
    rays, solve = [], optics.path_weights

    def counted(glass, eye, directions, paths):
        rays.append(len(directions))
        return solve(glass, eye, directions, paths)

    monkeypatch.setattr(optics, "path_weights", counted)
    mean_weights(glass, view, (optics.LightPath("R"),), fresnel=True)
    # Each is asked twice: whether it meets the glass, and along which paths.
    assert sum(rays) < 4 * PATH_SEARCH_RAYS


def test_esc_is_heeded_between_blocks_of_rays_and_these_do_not_show(monkeypatch):
    """A large picture's weights took 16 s in one go."""
    scenes.camera()
    scene, _ = _case(shape="CYLINDER", contents_ior=1.333)
    glass, view = _read(scene)
    paths = optics.light_paths(glass.description, view.eye_for(glass))
    at_once = path_regions(glass, view, paths)
    monkeypatch.setattr(regions, "BLOCK", 1000)
    found = path_regions(glass, view, paths)
    np.testing.assert_array_equal(found.weights, at_once.weights)
    np.testing.assert_array_equal(found.hit, at_once.hit)
    solve = optics.path_weights

    def pressed(*args):
        progress.ask_to_stop()
        return solve(*args)

    monkeypatch.setattr(optics, "path_weights", pressed)
    try:
        with pytest.raises(progress.Stopped):
            path_regions(glass, view, paths)
    finally:
        progress.go_on()


def test_border_pixels_hold_the_covered_part():
    """The share of a border pixel, against 64 x 64 rays under the same filter."""
    scenes.camera()
    scene, _ = _case((48, 36), shape="CYLINDER", wall_thickness=0.01)
    glass, view = _read(scene)
    paths = (optics.LightPath("TTTT"),)
    found = path_regions(glass, view, paths, fresnel=False)
    x0, y0, _, _ = found.rect
    partial = (found.weights[0] > 0.02) & (found.weights[0] < 0.98)
    assert partial.sum() > 10
    offsets = (np.arange(64) + 0.5) / 64 - 0.5
    angle = 2 * np.pi * offsets
    window = (
        0.35875
        + 0.48829 * np.cos(angle)
        + 0.14128 * np.cos(2 * angle)
        + 0.01168 * np.cos(3 * angle)
    )
    weight = np.outer(window, window).ravel()
    dx, dy = (o.ravel() * SUPPORT for o in np.meshgrid(offsets, offsets))
    for row, column in list(zip(*np.nonzero(partial), strict=True))[::7]:
        _, directions = view.rays(x0 + column + 0.5 + dx, y0 + row + 0.5 + dy)
        eye, local = glass.to_local(view.eye), glass.direction_to_local(directions)
        traced = optics.trace(glass.description, eye, local, "TTTT").valid
        missed = optics.path_weights(glass.description, eye, local, ("",))[0][0] > 0.5
        cover = weight[~missed].sum()
        # Rays that leave by the open ends count as the path that they would take.
        if cover < 1e-3 or (weight[~missed & ~traced].sum() / cover > 0.9):
            continue
        assert found.weights[0][row, column] == pytest.approx(
            weight[traced].sum() / cover, abs=0.06
        )


def test_the_pixel_filter_is_the_one_that_cycles_has(tmp_path):
    # A half plane of light, its border at pixel 10.3: the picture is the filter's integral.
    data = {"type": "ORTHO", "ortho_scale": 20.0}
    scenes.camera(location=(0.0, 0.0, 5.0), tilt=0.0, **data)
    scene = scenes.settings(20, 4, samples=1024)
    scene.cycles.filter_width = FILTER_WIDTH
    bpy.ops.mesh.primitive_plane_add(size=200.0, location=(100.3, 0.0, 0.0))
    bpy.context.object.data.materials.append(scenes.emissive("light", (1.0, 1.0, 1.0)))
    found = scenes.picture(scene, tmp_path)[2, :, 0]
    offsets = (np.arange(4000) + 0.5) / 4000 - 0.5
    window = blackman_harris(offsets)
    places = np.arange(20)[:, None] + 0.5 + SUPPORT * offsets
    expected = ((places > 10.3) * window).sum(axis=1) / window.sum()
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_all_that_the_glass_covers_lies_in_its_rectangle():
    scenes.camera()
    scene, obj = _case(shape="SPHERE", radius=0.06)
    obj.location = (0.1, 0.0, 0.1)
    bpy.context.view_layer.update()
    glass, view = _read(scene)
    x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(72) + 0.5)
    _, directions = view.rays(x.ravel(), y.ravel())
    eye, local = glass.to_local(view.eye), glass.direction_to_local(directions)
    hit = (optics.path_weights(glass.description, eye, local, ("",))[0][0] < 0.5).reshape(72, 96)
    x0, y0, x1, y1 = picture_rect(glass, view)
    assert hit.any()
    outside = hit.copy()
    outside[y0:y1, x0:x1] = False
    assert not outside.any()


@pytest.mark.parametrize("projection", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("shape", ["CYLINDER", "SPHERE", "SLAB"])
def test_the_first_face_looks_at_the_eye(shape, projection):
    scenes.camera(type=projection)
    scene, _ = _case(shape=shape)
    glass, view = _read(scene)
    eye = view.eye_for(glass)
    vertices, faces = first_face(glass, eye)
    towards = faces_eye(vertices, faces, eye)
    share = {"CYLINDER": 0.45, "SPHERE": 0.4, "SLAB": 1.0}[shape]
    assert share <= towards.mean() <= (1.0 if shape == "SLAB" else 0.5)


def test_eye_in_the_wall_is_said():
    scenes.camera(location=(0.0, -0.0385, 0.06))
    scene, obj = _case(shape="CYLINDER")
    glass, view = _read(scene)
    with pytest.raises(RefractiveGlassError, match=obj.name):
        first_face(glass, view.eye_for(glass))


def test_the_map_is_a_picture_of_the_counts(tmp_path):
    scenes.camera()
    scene, _ = _case(shape="CYLINDER")
    write_region_map(scene, scenes.depsgraph(), tmp_path / "map.png")
    image = bpy.data.images.load(str(tmp_path / "map.png"))
    pixels = np.array(image.pixels[:]).reshape(72, 96, 4)[..., :3]
    counts = crossing_counts(scene, scenes.depsgraph())
    for count in np.unique(counts):
        colours = np.unique(np.round(pixels[counts == count], 3), axis=0)
        assert len(colours) == 1


def test_rays_that_pass_a_notch_of_the_outline_do_not_count_as_inside():
    """A thick, concave pane: entering and leaving by its faces is not enough."""
    scenes.camera(location=(0.0, -0.5, 0.25), tilt=1.15)
    scene = scenes.settings(160, 120)
    outline = [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (0.02, 0.1), (0.0, -0.06), (-0.02, 0.1)]
    outline.append((-0.1, 0.1))
    mesh = bpy.data.meshes.new("Notched")
    mesh.from_pydata([(x, y, 0.0) for x, y in outline], [], [tuple(range(len(outline)))])
    pane = bpy.data.objects.new("Notched", mesh)
    scene.collection.objects.link(pane)
    bpy.context.view_layer.objects.active = pane
    bpy.ops.object.refractive_glass_modifier_add(shape="SLAB", wall_thickness=0.06, ior=1.5)
    pane.rotation_euler = (0.3, 0.0, 0.5)
    bpy.context.view_layer.update()
    glass, view = _read(scene)
    inside = region_masks(scene, scenes.depsgraph())["TT"]
    rows, columns = np.nonzero(inside)
    assert len(rows) > 500
    rows, columns = rows[::11], columns[::11]
    _, directions = view.rays(columns + 0.5, rows + 0.5)
    eye, local = glass.to_local(view.eye), glass.direction_to_local(directions)
    leave = optics.trace(glass.description, eye, local, "TT").origin
    enter = eye - eye[2] / local[:, 2:] * local
    # Every place of the straight way through the glass has glass round it.
    for share in np.linspace(0, 1, 21):
        place = enter + share * (leave - enter)
        beside = np.array([_beside(p, glass.description.outline) for p in place[:, :2]])
        assert not beside.any()


def _beside(point, outline):
    """Whether a point lies outside a polygon (crossing number)."""
    x, y = point
    crossings = 0
    for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            crossings += 1
    return crossings % 2 == 0
