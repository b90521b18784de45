# SPDX-License-Identifier: GPL-3.0-or-later
"""What the glass shows of the world, and of things that the direct picture does not show."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.environment import is_uniform, surroundings
from glass_refraction.scene.names import own
from glass_refraction.scene.read.glasses import glass_modifier, read_glasses, unbounded
from glass_refraction.scene.read.modifier_inputs import write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.screen import TOLERANCE_PX, build_screen
from glass_refraction.scene.vertices.regions import (
    PathRays,
    path_regions,
    picture_rect,
    region_masks,
)

WHITE = (1.0, 1.0, 1.0, 1.0)


def _world(scene, colour=None, strength=1.0):
    """A world of one colour, or one whose colour tells the direction: (d + 1) / 2."""
    world = bpy.data.worlds.new("World")
    scene.world = world
    tree = world.node_tree
    background = next(n for n in tree.nodes if n.type == "BACKGROUND")
    background.inputs["Strength"].default_value = strength
    if colour is not None:
        background.inputs["Color"].default_value = colour
        return world
    place = tree.nodes.new("ShaderNodeTexCoord")
    half = tree.nodes.new("ShaderNodeVectorMath")
    half.operation = "MULTIPLY_ADD"
    half.inputs[1].default_value = half.inputs[2].default_value = (0.5, 0.5, 0.5)
    tree.links.new(place.outputs["Generated"], half.inputs[0])
    tree.links.new(half.outputs[0], background.inputs["Color"])
    return world


def _speck(colour=(1.0, 1.0, 1.0)):
    """A thing far out of sight: a glass needs something to show."""
    bpy.ops.mesh.primitive_plane_add(size=1e-3, location=(0.0, 500.0, -500.0))
    bpy.context.object.data.materials.append(scenes.emissive("speck", colour))


def _expected(scene, events):
    """The world's colour along the last direction of each pixel's ray, and the path's pixels."""
    view = read_viewpoint(scene, scenes.depsgraph())
    glass = read_glasses(scenes.depsgraph())[0]
    inside = region_masks(scene, scenes.depsgraph())[events]
    rows, columns = np.nonzero(inside)
    origins, directions = view.rays(columns + 0.5, rows + 0.5)
    traced = optics.trace(
        glass.description, glass.to_local(origins), glass.direction_to_local(directions), events
    )
    assert traced.valid.all()
    return 0.5 * (traced.direction @ glass.to_world[:3, :3].T + 1.0), rows, columns


@pytest.mark.parametrize("shading", ["DISPLACED", "TRUE"])
@pytest.mark.parametrize("camera", [{}, {"type": "ORTHO", "ortho_scale": 0.16}])
@pytest.mark.parametrize(
    ("glass", "events"),
    [({"shape": "SPHERE", "wall_thickness": 0.0}, "TT"), ({"shape": "CYLINDER"}, "TTTT")],
)
def test_the_world_is_seen_in_the_last_rays_direction(tmp_path, shading, camera, glass, events):
    scenes.camera(location=(0.005, -0.5, 0.05), tilt=np.pi / 2, **camera)
    scene = scenes.settings(100, 75, samples=1, surface="REFRACTION", shading=shading)
    scene.cycles.filter_width = 0.01
    _world(scene)
    scenes.glass(**glass)
    _speck()
    found = scenes.picture(scene, tmp_path)
    expected, rows, columns = _expected(scene, events)
    assert len(rows) > 300
    off = np.abs(found[rows, columns, :3] - expected).max(axis=1)
    # Between traced rays directions are interpolated; close to the verge that is coarse.
    assert np.quantile(off, 0.9) < 3e-3
    assert np.median(off) < 6e-4


def test_mirrored_world_in_a_ball_is_the_mirrored_direction(tmp_path):
    scenes.camera(location=(0.0, -0.5, 0.0), tilt=np.pi / 2)
    scene = scenes.settings(100, 75, samples=1, surface="GLASS", shading="DISPLACED")
    scene.cycles.filter_width = 0.01
    _world(scene)
    obj = scenes.glass(shape="SPHERE", wall_thickness=0.0)
    # As good as a mirror: nearly all that the ball shows is reflected outside.
    write_input(glass_modifier(obj), "IOR", 400.0)
    _speck()
    found = scenes.picture(scene, tmp_path)
    expected, rows, columns = _expected(scene, "R")
    centre = np.hypot(rows - 37, columns - 50) < 15
    off = np.abs(found[rows, columns, :3] - expected).max(axis=1)[centre]
    assert centre.sum() > 300
    assert np.quantile(off, 0.95) < 0.02


GLASSES = {
    "cylinder": {"shape": "CYLINDER"},
    "cup of water": {"shape": "CYLINDER", "contents_ior": 1.333},
    "rod": {"shape": "ROD"},
    "ball of diamond": {"shape": "SPHERE", "wall_thickness": 0.0, "ior": 2.417},
    "slab": {"shape": "SLAB", "radius": 0.05, "wall_thickness": 0.02},
}


@pytest.mark.parametrize("shading", ["DISPLACED", "TRUE"])
@pytest.mark.parametrize("turn", [0.0, 1.1])
@pytest.mark.parametrize("kind", GLASSES)
def test_in_a_white_world_every_glass_is_white(tmp_path, kind, turn, shading):
    scenes.camera(location=(0.0, -0.5, 0.05), tilt=np.pi / 2)
    scene = scenes.settings(64, 48, samples=32, surface="GLASS", shading=shading)
    _world(scene, WHITE)
    obj = scenes.glass(**GLASSES[kind])
    obj.rotation_euler = (turn, 0.3, 0.0)
    obj.location.z = 0.02 if kind == "slab" else 0.0
    _speck()
    found = scenes.picture(scene, tmp_path)
    assert find_layers(scene) is not None
    off = np.abs(found[..., :3] - 1.0).max(axis=2)
    # Where regions end, weights of copies and of rays are sampled each for themselves.
    assert off.mean() < 1.5e-3
    assert np.quantile(off, 0.9) < 5e-3
    inside = ~region_masks(scene, scenes.depsgraph())[""]
    assert np.sqrt((off[inside] ** 2).mean()) < 0.012


def test_a_mirrored_thing_behind_the_camera_is_seen_lit_where_it_is(tmp_path):
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2)
    scene = scenes.settings(100, 75, samples=16, surface="GLASS", shading="TRUE")
    _world(scene, (0.0, 0.0, 0.0, 1.0))
    scenes.glass(shape="CYLINDER", ior=2.4)
    # A wall of light behind the camera: its mirror image is the only light in the picture.
    bpy.ops.mesh.primitive_plane_add(size=20.0, location=(0.0, -2.0, 0.0))
    bpy.context.object.rotation_euler = (-np.pi / 2, 0.0, 0.0)
    bpy.context.object.data.materials.append(scenes.emissive("wall", (1.0, 1.0, 1.0)))
    found = scenes.picture(scene, tmp_path)
    view = read_viewpoint(scene, scenes.depsgraph())
    glass = read_glasses(scenes.depsgraph())[0]
    x, y = np.array([50.5]), np.array([37.5])
    _, directions = view.rays(x, y)
    # Head on, light comes back from all four surfaces.
    paths = ("R", "TRT", "TTRTT", "TTTRTTT")
    weights, _ = optics.path_weights(
        glass.description, glass.to_local(view.eye), glass.direction_to_local(directions), paths
    )
    # One pixel's samples pick too few of the paths.
    np.testing.assert_allclose(found[33:42, 45:56, :3].mean(axis=(0, 1)), weights.sum(), rtol=0.1)


def _area_lamp(scene):
    """A square lamp behind the camera, a metre wide, that faces the glass; its radiance is 1."""
    data = bpy.data.lights.new("Lamp", "AREA")
    data.size, data.energy = 1.0, np.pi
    lamp = bpy.data.objects.new("Lamp", data)
    lamp.location, lamp.rotation_euler = (0.0, -1.0, 0.0), (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(lamp)
    return lamp


def _slab_before_lamp(width, height, samples):
    """A slab across the view that mirrors a lamp in a black world."""
    scenes.camera(location=(0.0, -0.5, 0.0), tilt=np.pi / 2)
    scene = scenes.settings(width, height, samples=samples, surface="GLASS", shading="TRUE")
    _world(scene, (0.0, 0.0, 0.0, 1.0))
    slab = scenes.glass(shape="SLAB", radius=0.05, wall_thickness=0.004)
    slab.rotation_euler.x = np.pi / 2
    return scene, _area_lamp(scene)


@pytest.mark.parametrize("seen", [True, False])
def test_lamps_of_a_size_are_mirrored_as_bright_as_they_are(tmp_path, seen):
    scene, lamp = _slab_before_lamp(40, 30, samples=64)
    lamp.visible_glossy = seen
    _speck()
    found = scenes.picture(scene, tmp_path)
    # Both faces of the slab reflect, to and fro between them.
    face = 0.2**2
    np.testing.assert_allclose(
        found[14:16, 19:21, :3].mean(axis=(0, 1)), 2 * face / (1 + face) * seen, rtol=0.05
    )
    assert not lamp.visible_camera


def test_stand_ins_of_lamps_follow_them_and_go_with_them():
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(surface="GLASS")
    scenes.glass(shape="CYLINDER")
    lamp = _area_lamp(scene)
    bpy.ops.scene.refractive_glass_update()
    around = find_layers(scene).around

    def stand_ins():
        return [o for o in around.objects if o.type == "LIGHT"]

    (made,) = stand_ins()
    assert made != lamp and made.data.energy == lamp.data.energy
    # Else Make Single User would give the user's lamp a copy of its own light.
    assert lamp.data.users == 1
    lamp.data.energy, lamp.data.shape = 2.0, "DISK"
    lamp.location.x = 0.7
    layer = around.view_layers[0]
    layer.update()
    np.testing.assert_allclose(made.evaluated_get(layer.depsgraph).matrix_world[0][3], 0.7)
    bpy.ops.scene.refractive_glass_update()
    assert stand_ins() == [made] and (made.data.energy, made.data.shape) == (2.0, "DISK")
    lamp.data.type = "SPOT"
    bpy.ops.scene.refractive_glass_update()
    (made,) = stand_ins()
    assert made.data.type == "SPOT"
    lamp.data.use_nodes = True
    bpy.ops.scene.refractive_glass_update()
    (made,) = stand_ins()
    assert made.data == lamp.data
    bpy.data.objects.remove(lamp)
    bpy.ops.scene.refractive_glass_update()
    assert stand_ins() == []
    assert [light for light in bpy.data.lights if own(light)] == []


def test_a_lamp_that_is_animated_shines_as_it_does_in_each_frame(tmp_path):
    scene, lamp = _slab_before_lamp(24, 18, samples=16)
    for frame, energy in ((1, np.pi), (2, 3.0 * np.pi)):
        lamp.data.energy = energy
        lamp.data.keyframe_insert("energy", frame=frame)
    _speck()
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.filepath = str(tmp_path / "frame_")
    scene.render.image_settings.file_format = "OPEN_EXR"
    bpy.ops.render.render(animation=True)
    one, two = (
        scenes.load(tmp_path / f"frame_{n:04d}.exr")[8:10, 11:13, :3].mean() for n in (1, 2)
    )
    np.testing.assert_allclose(two, 3.0 * one, rtol=0.02)


@pytest.mark.parametrize("glass", GLASSES)
def test_between_the_screens_vertices_rays_are_near_enough(glass):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(160, 120, surface="GLASS")
    scenes.glass(**GLASSES[glass])
    view = read_viewpoint(scene, scenes.depsgraph())
    found = read_glasses(scenes.depsgraph())[0]
    paths = optics.light_paths(found.description, view.eye_for(found), min_weight=0.02)
    regions = path_regions(found, view, paths)
    screen = build_screen(
        found, view, regions, fresnel=True, numbers=tuple(range(len(regions.paths)))
    )
    assert np.isfinite(screen.directions).all() and np.isfinite(screen.origins).all()
    # The cells cover the rectangle once.
    corner = screen.pixels[screen.cells]
    size = corner[:, 2, 0] - corner[:, 0, 0]
    x0, y0, x1, y1 = regions.rect
    low, high = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
    assert (low <= (x0, y0)).all() and (high >= (x1, y1)).all()
    assert (size**2).sum() == pytest.approx(np.prod(high - low))
    # In the middle of a cell the interpolated ray is the traced one, where the path goes on.
    middle = corner.mean(axis=1)
    description = unbounded(found.description)
    _, rays = view.rays(*middle.T)
    local = found.direction_to_local(rays)
    rays_of = PathRays(found, view, paths, True)
    _, hit, _ = rays_of.weights(*screen.pixels.T)
    meets = hit[screen.cells].all(axis=1)
    off = []
    for number, path in enumerate(paths):
        weights = screen.weights[number][screen.cells]
        traced = optics.trace(description, found.to_local(view.eye), local, path)
        on = traced.valid & (weights > 0).all(axis=1) & meets
        mean = screen.directions[number][screen.cells].mean(axis=1)
        world = traced.direction @ found.to_world[:3, :3].T
        gap = np.linalg.norm(mean - world, axis=1) * view.focal_px * weights.mean(axis=1)
        off += gap[on].tolist()
    assert len(off) > 100
    # Cells are not split any further at the verge itself.
    assert np.quantile(off, 0.95) < 2 * TOLERANCE_PX
    # The parts of the light are one where rays meet the glass.
    np.testing.assert_allclose(screen.weights[:, hit].sum(axis=0), 1.0, atol=1e-9)


def test_a_screen_is_fine_only_where_rays_need_it():
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    paths = tuple(optics.LightPath(e) for e in ("TTTT", "R"))
    cells = []
    for width in (200, 800):
        scenes.settings(width, width * 3 // 4)
        view = read_viewpoint(bpy.context.scene, scenes.depsgraph())
        glass = read_glasses(scenes.depsgraph())[0]
        regions = path_regions(glass, view, paths)
        numbers = tuple(range(len(regions.paths)))
        screen = build_screen(glass, view, regions, fresnel=True, numbers=numbers)
        cells.append(len(screen.cells))
    # Sixteen times the pixels, but regions' borders are only four times as long.
    assert cells[1] < 8 * cells[0]


def test_only_a_world_with_a_texture_needs_to_be_looked_up():
    scenes.camera()
    scene = scenes.settings(surface="REFRACTION")
    assert is_uniform(None)
    _world(scene, WHITE)
    assert surroundings(scene, "DISPLACED") == ""
    assert surroundings(scene, "TRUE") == "HIDDEN"
    _world(scene)
    assert surroundings(scene, "DISPLACED") == "WORLD"
    scene.refractive_glass.surface = "GLASS"
    assert surroundings(scene, "DISPLACED") == "MIRRORED"
    scene.refractive_glass.mirrors = "COPIES"
    assert surroundings(scene, "DISPLACED") == "WORLD"
    scene.render.engine = "BLENDER_WORKBENCH"
    assert surroundings(scene, "TRUE") == ""


def test_the_users_objects_leave_the_own_scenes_unharmed():
    scenes.camera()
    wall = scenes.striped_wall()
    scene = scenes.settings(shading="TRUE")
    scenes.glass(shape="CYLINDER")
    bpy.ops.scene.refractive_glass_update()
    assert wall in find_layers(scene).around.objects[:]
    scene.refractive_glass.shading = "DISPLACED"
    scene.refractive_glass.mirrors = "COPIES"
    bpy.ops.scene.refractive_glass_update()
    assert wall not in find_layers(scene).around.objects[:]
    scene.refractive_glass.enabled = False
    bpy.ops.scene.refractive_glass_update()
    assert wall.name in scene.objects
    assert not [m for m in bpy.data.materials if m.get("refractive_glass") == "rays"]


def test_what_a_glass_holds_is_seen_where_the_direct_picture_hides_it(tmp_path):
    # In water a ball in the glass is seen beside a post before it that hides it without water.
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2, lens=150.0)
    scenes.striped_wall()
    scene = scenes.settings(160, 120, samples=16, surface="REFRACTION", shading="TRUE")
    scenes.glass(shape="CYLINDER", contents_ior=1.333)
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=32, ring_count=16, radius=0.012, location=(0.0, 0.0, 0.06)
    )
    bpy.context.object.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.0, -0.1, 0.06))
    bpy.context.object.scale = (0.021, 0.001, 0.2)
    bpy.context.object.data.materials.append(scenes.emissive("black", (0.0, 0.0, 0.0)))
    found = scenes.picture(scene, tmp_path)
    row = found[60, :, :3]
    white = np.all(row > 0.9, axis=1)
    # The water widens the ball by about its ior, the post stands before the glass.
    assert white.sum() >= 4


def test_what_lies_beside_the_glass_is_not_drawn_again(tmp_path):
    """A compositor heeds no border of other scenes: the camera must see nothing there."""
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    scene = scenes.settings(160, 120, samples=1, surface="GLASS", shading="TRUE")
    _world(scene, (1.0, 1.0, 1.0, 1.0))
    door.prepare(scene, scenes.depsgraph())
    door.update(scene, scenes.depsgraph(), exact=True)
    around = find_layers(scene).around
    around.render.use_border = False
    found = scenes.picture(around, tmp_path)
    hit = np.zeros((120, 160), bool)
    view = read_viewpoint(scene, scenes.depsgraph())
    x0, y0, x1, y1 = picture_rect(read_glasses(scenes.depsgraph())[0], view, margin=20)
    # The screen reaches some pixels beyond the glass, for the pixel filter.
    hit[y0:y1, x0:x1] = True
    assert found[~hit, :3].max() == 0.0
    assert found[hit, :3].mean() > 0.02


def test_with_more_samples_mirrors_may_be_less_noisy():
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(40, 30)
    scenes.glass(shape="CYLINDER")
    allowed = []
    for samples in (16, 64):
        scene.cycles.samples = samples
        door.prepare(scene, scenes.depsgraph())
        cycles = find_layers(scene).around.cycles
        assert cycles.use_adaptive_sampling and cycles.samples == samples
        allowed.append(cycles.adaptive_threshold)
    assert allowed[0] == pytest.approx(2.0 * allowed[1])
