# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole pictures of True shading, in small: against closed forms, Cycles and themselves."""

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Vector

from glass_refraction.reference.cycles import render_reference, scene_depsgraph
from glass_refraction.scene import update as door
from glass_refraction.scene.build.own_scenes import find_own_scenes
from glass_refraction.scene.memory import counters
from glass_refraction.scene.names import TAG
from glass_refraction.scene.rays import true
from glass_refraction.scene.rays.looks import look_of
from glass_refraction.scene.rays.things import read_things
from glass_refraction.scene.read.glasses import glass_objects
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint

ENGINES = ("CYCLES", "BLENDER_EEVEE", "BLENDER_WORKBENCH")


def _scene(width=64, height=48, engine="CYCLES", samples=4, **glass):
    scene = scenes.settings(width, height, samples=samples, shading="TRUE", **glass)
    scene.render.engine = engine
    scene.eevee.taa_render_samples = samples
    if engine == "BLENDER_EEVEE":
        scenes.coarse_eevee(scene)
    scene.display.shading.light, scene.display.shading.color_type = "FLAT", "MATERIAL"
    scene.display.shading.show_object_outline = False
    return scene


def _wall(distance=0.2, **given):
    wall = scenes.striped_wall(distance, **given)
    for material in wall.data.materials:
        material.diffuse_color = material.node_tree.nodes["Emission"].inputs[0].default_value
    return wall


def _world(colour, strength=1.0):
    world = bpy.data.worlds.new("World")
    world.probe_resolution = "128"
    node = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    node.inputs["Color"].default_value = (*colour, 1.0)
    node.inputs["Strength"].default_value = strength
    bpy.context.scene.world = world
    return world


def _plain(scene, folder, name="plain"):
    """The same frame without its glasses."""
    glasses = glass_objects(scene.view_layers[0])
    for obj in glasses:
        obj.hide_render = True
    found = scenes.picture(scene, folder, name)
    for obj in glasses:
        obj.hide_render = False
    return found


def _covered(scene):
    return door.memory_of(scene).covered


def _psnr(one, other, where=None):
    off = (one - other)[..., :3] if where is None else (one - other)[where][:, :3]
    return -10.0 * np.log10(max(float((off.astype(float) ** 2).mean()), 1e-12))


def _reference(scene, samples=256, **given):
    return render_reference(scene, samples=samples, surface=scene.refractive_glass.surface, **given)


def _problems(scene):
    return door.status(scene).problems


# ---------------------------------------------------------------------------------- no glass at all


@pytest.mark.parametrize(
    ("engine", "shape"),
    [("CYCLES", "CYLINDER"), ("BLENDER_EEVEE", "CYLINDER"), ("BLENDER_WORKBENCH", "SPHERE")],
)
def test_glass_of_the_airs_own_ior_is_not_there_to_the_bit(tmp_path, engine, shape):
    scenes.camera()
    _wall()
    scene = _scene(engine=engine, samples=2)
    glass = scenes.glass(shape=shape)
    write_input(glass_modifier(glass), "IOR", 1.0)
    found = scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
    np.testing.assert_array_equal(found, _plain(scene, tmp_path))


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
def test_beside_the_glass_the_picture_is_the_plain_one_to_the_bit(tmp_path, engine):
    scenes.camera()
    _wall()
    scene = _scene(engine=engine)
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    covered = _covered(scene)
    # What covers less than half of a pixel counts as beside: one pixel round it.
    wide = covered.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            wide |= np.roll(covered, step, axis)
    plain = _plain(scene, tmp_path)
    assert 0.1 < wide.mean() < 0.6
    np.testing.assert_array_equal(found[~wide], plain[~wide])
    assert np.abs(found - plain)[covered].max() > 0.3


# ------------------------------------------------------------------------------------ closed forms


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
def test_a_slab_displaces_by_the_closed_form(tmp_path, engine):
    """An edge between two colours behind a tilted slab, seen by parallel rays."""
    angle, thickness, ior = 0.8, 0.03, 1.5
    scenes.camera(location=(0.0, -0.5, 0.0), tilt=np.pi / 2, type="ORTHO", ortho_scale=0.1)
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata(
        [(-1, 0.3, -1), (0, 0.3, -1), (1, 0.3, -1), (1, 0.3, 1), (0, 0.3, 1), (-1, 0.3, 1)],
        [], [(0, 1, 4, 5), (1, 2, 3, 4)],
    )  # fmt: skip
    for name, grey in (("dark", 0.05), ("light", 0.45)):
        material = scenes.emissive(name, (grey,) * 3)
        material.diffuse_color = (grey, grey, grey, 1.0)
        mesh.materials.append(material)
    mesh.polygons[1].material_index = 1
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Wall", mesh))
    scene = _scene(engine=engine, samples=16, surface="REFRACTION")
    slab = scenes.glass(shape="SLAB", radius=0.2, wall_thickness=thickness, ior=ior)
    # Its normal points to the camera, turned about the vertical.
    slab.rotation_euler = (np.pi / 2, 0.0, angle)
    found = scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
    assert _covered(scene).all()
    plain = _plain(scene, tmp_path)

    def edge(picture):
        row = picture[20:28, :, 0].mean(axis=0).astype(float)
        low, high = row[:5].mean(), row[-5:].mean()
        return len(row) - ((row - low) / (high - low)).sum()

    inner = np.arcsin(np.sin(angle) / ior)
    shift = thickness * np.sin(angle - inner) / np.cos(inner)
    pixel = 0.1 / 64
    assert abs(edge(found) - edge(plain)) * pixel == pytest.approx(shift, abs=0.15 * pixel)


WHITE = (
    {"shape": "CYLINDER", "radius": 0.04},
    {"shape": "SPHERE", "radius": 0.04, "wall_thickness": 0.0},
    {"shape": "SLAB", "radius": 0.04, "wall_thickness": 0.01},
    {"shape": "TUMBLER", **scenes.CUP},
)


@pytest.mark.parametrize(
    ("engine", "values"),
    [*(("CYCLES", values) for values in WHITE), ("BLENDER_EEVEE", WHITE[3])],
    ids=lambda v: v if isinstance(v, str) else v["shape"],
)
def test_all_white_is_white_through_any_glass(tmp_path, engine, values):
    """Energy: whatever ways light takes, all of it comes from something white."""
    scenes.camera(location=(0.0, -0.4, 0.1), tilt=np.pi / 2 * 0.9)
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0, 0, -0.02))
    bpy.context.object.data.materials.append(scenes.emissive("white", (1.0, 1.0, 1.0)))
    scene = _scene(engine=engine, samples=1)
    _world((1.0, 1.0, 1.0))
    glass = scenes.glass(**values)
    glass.location.z = 0.03
    found = scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
    assert _covered(scene).sum() > 50
    np.testing.assert_allclose(found[..., :3], 1.0, atol=0.005)


def test_the_films_exposure_counts_in_the_glass_as_beside_it(tmp_path):
    """A white world is known without a view, so that no picture brings the exposure along."""
    scenes.camera()
    scene = _scene(samples=1)
    scene.cycles.film_exposure = 2.5
    _world((1.0, 1.0, 1.0))
    scenes.glass(shape="SPHERE", radius=0.04, wall_thickness=0.0)
    found = scenes.picture(scene, tmp_path)
    assert _covered(scene).sum() > 50
    np.testing.assert_allclose(found[..., :3], 2.5, atol=0.0125)


# ---------------------------------------------------------------------------- whose engine it is


@pytest.mark.parametrize("engine", ENGINES)
def test_views_take_the_users_engine_and_have_cycles_make_no_large_map_of_the_world(
    tmp_path, engine
):
    """Small captures have a smaller map, views of the world alone none; the user's world stays."""
    scenes.camera()
    _wall()
    scene = _scene(engine=engine, samples=1)
    world = _world((0.1, 0.2, 0.3))
    # Not known without a view, and for Cycles of one colour: its own map would take seconds here.
    nodes, links = world.node_tree.nodes, world.node_tree.links
    links.new(nodes.new("ShaderNodeRGB").outputs[0], nodes["Background"].inputs["Color"])
    scenes.glass(shape="CYLINDER")
    engines, maps = set(), {}

    def note(rendered, depsgraph):
        if depsgraph.mode == "RENDER":
            engines.add(rendered.render.engine)
            maps[rendered.get(TAG)] = depsgraph.scene_eval.world.cycles.sampling_method

    bpy.app.handlers.frame_change_post.append(note)
    try:
        found = scenes.picture(scene, tmp_path)
    finally:
        bpy.app.handlers.frame_change_post.remove(note)
    assert engines == {engine}
    assert {s.render.engine for s in find_own_scenes(scene, ("capture", "sky"))} == {engine}
    if engine == "CYCLES":
        assert maps == {None: "AUTOMATIC", "capture": "MANUAL", "sky": "NONE"}
    assert world.cycles.sampling_method == "AUTOMATIC"
    assert np.abs(found - _plain(scene, tmp_path)).max() > 0.3


# ---------------------------------------------------------------------------- against Cycles


def _against_cycles(scene, folder, least, samples=256):
    found = scenes.picture(scene, folder)
    problems = list(_problems(scene))
    covered = _covered(scene)
    assert covered.sum() > 100
    wanted = _reference(scene, samples)
    off = _psnr(found, wanted, covered)
    print(f"{off:.1f} dB inside, unseen {door.status(scene).unseen:.4f} {problems}")
    assert problems == []
    assert off > least, off
    return found, wanted


@pytest.mark.parametrize("surface", ["GLASS", "REFRACTION"])
def test_a_tube_is_as_cycles_shows_it(tmp_path, surface):
    scenes.camera(location=(0.0, -0.35, 0.1))
    _wall(stripes=12)
    scene = _scene(samples=32, surface=surface)
    _world((0.2, 0.3, 0.4))
    scenes.glass(shape="CYLINDER")
    _against_cycles(scene, tmp_path, 30.0 if surface == "GLASS" else 27.0)


def test_denoised_captures_run_the_denoiser_once_and_are_nearer_to_cycles(tmp_path):
    """Guides that hold no noise are not cleaned first; the user's own setting stays."""
    scenes.camera(location=(0.0, -0.35, 0.1))
    _wall(stripes=12)
    scene = _scene(samples=2)
    _world((0.2, 0.3, 0.4))
    scenes.glass(shape="CYLINDER")
    noisy = scenes.picture(scene, tmp_path, "noisy")
    scene.cycles.use_denoising, scene.cycles.denoising_prefilter = True, "ACCURATE"
    denoised = scenes.picture(scene, tmp_path, "denoised")
    captures = find_own_scenes(scene, ("capture",))
    assert {view.cycles.denoising_prefilter for view in captures} == {"FAST"}
    assert scene.cycles.denoising_prefilter == "ACCURATE"
    wanted, covered = _reference(scene), _covered(scene)
    assert _psnr(denoised, wanted, covered) > _psnr(noisy, wanted, covered)


def test_absorption_tints_as_in_cycles(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.0), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=32)
    _world((0.6, 0.6, 0.6))
    glass = scenes.glass(shape="SPHERE", radius=0.04, wall_thickness=0.0)
    write_input(glass_modifier(glass), "Absorption Color", (0.9, 0.5, 0.2, 1.0))
    write_input(glass_modifier(glass), "Absorption Distance", 0.05)
    clear, covered = scenes.picture(scene, tmp_path), _covered(scene)
    _, wanted = _against_cycles(scene, tmp_path, 30.0)
    mean = clear[covered][:, :3].mean(axis=0)
    np.testing.assert_allclose(mean, wanted[covered][:, :3].mean(axis=0), rtol=0.03)


def test_dispersion_is_as_in_cycles(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.0), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=32)
    glass = scenes.glass(shape="SPHERE", radius=0.04, wall_thickness=0.0, ior=1.7)
    plain = scenes.picture(scene, tmp_path, "plain glass")
    write_input(glass_modifier(glass), "Abbe Number", 12.0)
    found, _ = _against_cycles(scene, tmp_path, 26.0)
    assert np.abs(found - plain).max() > 0.1


def test_two_glasses_behind_one_another_are_as_in_cycles(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall(stripes=12)
    scene = _scene(samples=32)
    _world((0.3, 0.3, 0.3))
    scenes.glass(shape="CYLINDER", radius=0.03).location = (-0.015, 0.0, 0.0)
    scenes.glass(shape="SPHERE", radius=0.04, wall_thickness=0.0).location = (0.02, 0.1, 0.06)
    _against_cycles(scene, tmp_path, 27.0, samples=64)


def _colourful_world():
    world = _world((1, 1, 1))
    # Cycles makes a map of where it is bright, anew in each of a frame's scenes.
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 64
    tree = world.node_tree
    place, turn, background = (
        tree.nodes.new("ShaderNodeTexCoord"),
        tree.nodes.new("ShaderNodeMapping"),
        next(n for n in tree.nodes if n.type == "BACKGROUND"),
    )
    turn.inputs["Scale"].default_value = (0.5, 0.5, 0.5)
    turn.inputs["Location"].default_value = (0.5, 0.5, 0.5)
    tree.links.new(place.outputs["Generated"], turn.inputs["Vector"])
    tree.links.new(turn.outputs["Vector"], background.inputs["Color"])
    return world


@pytest.mark.parametrize("values", [WHITE[1], WHITE[0]], ids=lambda v: v["shape"])
def test_a_world_of_many_colours_is_as_in_cycles(tmp_path, values):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=16)
    _colourful_world()
    glass = scenes.glass(**values)
    glass.location.z = 0.05 if values["shape"] == "SPHERE" else 0.0
    _against_cycles(scene, tmp_path, 30.0)


def test_brushed_metal_is_seen_in_the_glass_as_from_where_light_leaves_it(tmp_path):
    """Of roughness 0.5: it sends other light to the glass than to the camera. Taken for matt it
    had 30.6 dB."""
    scenes.camera(location=(0.0, -0.4, 0.12), tilt=np.pi / 2 * 0.85)
    scene = _scene(samples=32)
    _colourful_world()
    bpy.ops.mesh.primitive_plane_add(size=2.0, location=(0.0, 0.0, -0.001))
    metal = bpy.data.materials.new("metal")
    shader = next(node for node in metal.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Metallic"].default_value, shader.inputs["Roughness"].default_value = 1.0, 0.5
    bpy.context.object.data.materials.append(metal)
    scenes.glass(shape="SPHERE", radius=0.06, contents_ior=1.5).location.z = 0.07
    _against_cycles(scene, tmp_path, 32.0)


def _lamp_before_a_pane(scene, kind):
    light = bpy.data.lights.new("Lamp", kind)
    light.energy = 4.0
    if kind == "AREA":
        light.size = 0.3
    elif kind == "POINT":
        light.shadow_soft_size = 0.15
    else:
        light.angle = 0.25
    lamp = bpy.data.objects.new("Lamp", light)
    scene.collection.objects.link(lamp)
    lamp.location = (0.1, -0.9, 0.1)
    towards = Vector((0.0, 0.0, 0.05)) - lamp.location
    lamp.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    slab = scenes.glass(shape="SLAB", radius=0.15, wall_thickness=0.01)
    slab.location, slab.rotation_euler = (0.0, 0.0, 0.05), (np.pi / 2, 0.0, 0.0)
    return lamp


@pytest.mark.parametrize("kind", ["AREA", "POINT", "SUN"])
def test_mirrored_lamps_of_a_size_are_as_in_cycles(tmp_path, kind):
    """A pane before the black mirrors a lamp behind the camera."""
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=32)
    _world((0.0, 0.0, 0.0))
    _lamp_before_a_pane(scene, kind)
    found = scenes.picture(scene, tmp_path)
    assert _problems(scene) == []
    wanted = _reference(scene)
    peak = wanted[..., 0].max()
    assert peak > 0.01
    assert _psnr(found / peak, wanted / peak, _covered(scene)) > 25.0
    sums = [picture[..., :3].sum() for picture in (found, wanted)]
    assert sums[0] == pytest.approx(sums[1], rel=0.05)


def test_the_border_of_a_mirrored_lamp_is_smooth(tmp_path):
    """Both faces mirror it, each by a twentieth of the light: that much was followed for no more
    than one ray a pixel."""
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=1)
    _world((0.0, 0.0, 0.0))
    _lamp_before_a_pane(scene, "AREA").rotation_euler.rotate_axis("Z", 0.3)
    light = scenes.picture(scene, tmp_path)[..., 0]
    assert len(np.unique((10.0 * light / light.max()).round())) > 7


@pytest.mark.parametrize("kind", ["AREA", "POINT", "SUN"])
def test_workbench_has_no_lamps_so_glass_mirrors_none(tmp_path, kind):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    lamp = _lamp_before_a_pane(scene, kind)
    found = scenes.picture(scene, tmp_path)
    assert _covered(scene).mean() > 0.3
    lamp.hide_render = True
    np.testing.assert_array_equal(found, scenes.picture(scene, tmp_path, "without"))


# ---------------------------------------------------------------------------------- film and border


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
def test_a_transparent_film_is_as_transparent_as_in_cycles(tmp_path, engine):
    scenes.camera(tilt=np.pi / 2)
    wall = _wall()
    wall.location.z = 0.56
    scene = _scene(samples=32, engine=engine, surface="REFRACTION")
    scene.render.film_transparent = True
    scene.cycles.film_transparent_glass = True
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    covered = _covered(scene)
    wanted = _reference(scene, 64)
    off = np.abs(found - wanted)[covered][:, 3]
    # At the verge light is reflected totally: black there, and opaque in Cycles alone.
    assert np.quantile(off, 0.75) < 0.05
    assert off.mean() < 0.15
    assert 0.2 < found[covered][:, 3].mean() < 0.8


@pytest.mark.parametrize("world", ["plain", "many colours"])
def test_glass_before_a_transparent_film_mirrors_the_world_as_in_cycles(tmp_path, world):
    """The hole is seen through the glass; what its surfaces mirror covers."""
    scenes.camera(tilt=np.pi / 2)
    _wall().location.z = 0.56
    scene = _scene(samples=32, surface="GLASS")
    if world == "plain":
        _world((0.3, 0.5, 0.9))
    else:
        _colourful_world()
    scene.render.film_transparent = True
    scenes.glass(shape="SLAB", radius=0.1, wall_thickness=0.01).rotation_euler.z = 0.9
    found = scenes.picture(scene, tmp_path)
    covered = _covered(scene)
    wanted = _reference(scene, 256)
    alpha = found[covered][:, 3].mean()
    assert alpha == pytest.approx(wanted[covered][:, 3].mean(), abs=0.02)
    assert 0.3 < alpha < 0.8
    off = (found - wanted)[covered][:, :3].mean(axis=0)
    np.testing.assert_allclose(off, 0.0, atol=0.02)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_WORKBENCH"])
@pytest.mark.parametrize("crop", [False, True])
def test_a_border_shows_its_part_of_the_whole_picture(tmp_path, engine, crop):
    scenes.camera(lens=60.0)
    _wall()
    scene = _scene(80, 60, samples=1, engine=engine)
    _world((0.3, 0.4, 0.5))
    scene.cycles.filter_width = 0.01
    scenes.glass(shape="CYLINDER")
    whole = scenes.picture(scene, tmp_path, "whole")
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x = 0.3, 0.7
    render.border_min_y, render.border_max_y = 0.2, 0.8
    part = scenes.picture(scene, tmp_path, "part")
    assert part.shape[:2] == ((36, 32) if crop else (60, 80))
    if not crop:
        part = part[12:48, 24:56]
    off = np.abs(part - whole[12:48, 24:56]).max(axis=2)
    print(off.max(), np.quantile(off, 0.9), off.mean())
    # What the picture shows no more comes from captures, which are not as fine.
    assert np.quantile(off, 0.5) < 0.02
    assert off.mean() < 0.05


def test_an_orthographic_camera(tmp_path):
    scenes.camera(tilt=np.pi / 2, type="ORTHO", ortho_scale=0.12, location=(0, -0.5, 0.06))
    _wall()
    scene = _scene(samples=32)
    _world((0.2, 0.3, 0.4))
    scenes.glass(shape="CYLINDER")
    _against_cycles(scene, tmp_path, 27.0, samples=64)


# ----------------------------------------------------------------------------- where the camera is


def test_an_eye_in_the_cavity(tmp_path):
    scenes.camera(location=(0.0, -0.02, 0.06), tilt=np.pi / 2, clip_start=0.001)
    _wall(stripes=6)
    scene = _scene(samples=32)
    _world((0.3, 0.3, 0.3))
    scenes.glass(shape="CYLINDER")
    _against_cycles(scene, tmp_path, 27.0, samples=64)


def test_an_eye_in_the_glass_itself(tmp_path):
    """Right, or told of."""
    scenes.camera(location=(0.0, -0.01, 0.0), tilt=np.pi / 2, clip_start=0.001)
    _wall(stripes=6)
    scene = _scene(samples=32)
    _world((0.3, 0.3, 0.3))
    scenes.glass(shape="SPHERE", radius=0.04, wall_thickness=0.0)
    found = scenes.picture(scene, tmp_path)
    assert np.isfinite(found).all()
    if not _problems(scene):
        covered = _covered(scene)
        assert _psnr(found, _reference(scene), covered) > 25.0


@pytest.mark.parametrize(
    ("shape", "kind"),
    [("SPHERE", "ORTHO"), ("CYLINDER", "PERSP"), ("MESH", "PERSP"), ("MESH", "ORTHO")],
)
def test_what_lies_before_the_cameras_clip_start_is_not_there(tmp_path, shape, kind):
    """The camera sees from there on: glass is cut open, and things before it hide nothing."""
    scenes.camera(
        tilt=np.pi / 2, type=kind, lens=100, ortho_scale=0.1, location=(0, -0.5, 0.03),
        clip_start=0.5 if shape == "CYLINDER" else 0.485,
    )  # fmt: skip
    _wall(stripes=6)
    scene = _scene(samples=32)
    _world((0.3, 0.3, 0.3))
    if shape == "MESH":
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.03, location=(0, 0, 0.03))
        bpy.ops.object.shade_smooth()
        bpy.ops.object.refractive_glass_modifier_add(shape="MESH")
    else:
        glass = scenes.glass(shape=shape, radius=0.03, wall_thickness=0.004 * (shape != "SPHERE"))
        glass.location.z = 0.03 * (shape == "SPHERE")
    bpy.ops.mesh.primitive_plane_add(size=0.2, location=(0, -0.3, 0.03), rotation=(1.5, 0, 0))
    _against_cycles(scene, tmp_path, 27.0, samples=64)


# ---------------------------------------------------------------------------- kinds of things seen


def _curve(scene):
    bpy.ops.curve.primitive_bezier_circle_add(radius=0.02, location=(0, 0.1, 0.06))
    obj = bpy.context.object
    obj.rotation_euler.x = np.pi / 2
    obj.data.bevel_depth = 0.006
    return obj


def _text(scene):
    bpy.ops.object.text_add(location=(-0.02, 0.1, 0.045), rotation=(np.pi / 2, 0, 0))
    obj = bpy.context.object
    obj.data.body, obj.data.size, obj.data.extrude = "HO", 0.05, 0.002
    return obj


def _metaball(scene):
    bpy.ops.object.metaball_add(radius=0.04, location=(0, 0.1, 0.06))
    return bpy.context.object


def _collection_instance(scene):
    collection = bpy.data.collections.new("Many")
    bpy.ops.mesh.primitive_cube_add(size=0.03)
    cube = bpy.context.object
    scene.collection.objects.unlink(cube)
    collection.objects.link(cube)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location = (0.0, 0.1, 0.06)
    scene.collection.objects.link(empty)
    return cube


def _node_instances(scene):
    bpy.ops.mesh.primitive_cube_add(size=0.03)
    cube = bpy.context.object
    cube.hide_render = True
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=1, y_subdivisions=1, size=0.05, location=(0, 0.1, 0.06)
    )
    grid = bpy.context.object
    grid.rotation_euler.x = np.pi / 2
    tree = bpy.data.node_groups.new("Instances", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    new, link = tree.nodes.new, tree.links.new
    info, spread = new("GeometryNodeObjectInfo"), new("GeometryNodeInstanceOnPoints")
    info.inputs["Object"].default_value = cube
    info.inputs["As Instance"].default_value = True
    link(new("NodeGroupInput").outputs[0], spread.inputs["Points"])
    link(info.outputs["Geometry"], spread.inputs["Instance"])
    link(spread.outputs[0], new("NodeGroupOutput").inputs[0])
    grid.modifiers.new("Instances", "NODES").node_group = tree
    return cube


def _red(obj, rgb=(0.9, 0.05, 0.05)):
    material = scenes.emissive("red", rgb)
    material.diffuse_color = (*rgb, 1.0)
    obj.data.materials.clear()
    obj.data.materials.append(material)


def _is_red(picture):
    return (picture[..., 0] > 0.4) & (picture[..., 1] < 0.35) & (picture[..., 2] < 0.35)


@pytest.mark.parametrize(
    "make",
    [_curve, _text, _metaball, _collection_instance, _node_instances],
    ids=lambda f: f.__name__[1:],
)
def test_all_kinds_of_things_are_seen_through_the_glass(tmp_path, make):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=16)
    _world((0.2, 0.3, 0.4))
    _red(make(scene))
    scenes.glass(shape="CYLINDER")
    found, wanted = _against_cycles(scene, tmp_path, 24.0)
    covered = _covered(scene)
    assert _is_red(wanted)[covered].sum() > 15
    light = [picture[covered][:, 0].sum() for picture in (found, wanted)]
    assert light[0] == pytest.approx(light[1], rel=0.06)


@pytest.mark.parametrize("make", [_curve, _text, _metaball], ids=lambda f: f.__name__[1:])
def test_what_blender_makes_a_mesh_of_is_read_once(make):
    scene = _scene()
    obj = make(scene)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = obj.evaluated_get(depsgraph).to_mesh()
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    obj.evaluated_get(depsgraph).to_mesh_clear()
    things = read_things(depsgraph, frozenset(), frozenset(), "CYCLES", {})
    assert len(things.triangles) == count > 0


def test_metaballs_are_seen_where_the_picture_hides_them(tmp_path):
    """Captures show none: Blender leaves those of a background set out."""
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=16)
    _world((0.2, 0.3, 0.4))
    for place in (-0.03, 0.03):
        bpy.ops.object.metaball_add(radius=0.06, location=(place, 0.15, 0.06 + place / 3))
        _red(bpy.context.object)
    # A lens turns them upside down; much of it shows what lies beside the picture's way.
    scenes.glass(shape="ROD", radius=0.05, height=0.14)
    found, wanted = _against_cycles(scene, tmp_path, 24.0)
    covered = _covered(scene)
    assert _is_red(wanted)[covered].sum() > 100
    assert _is_red(found)[covered].sum() == pytest.approx(_is_red(wanted)[covered].sum(), rel=0.05)


def _hide_render(obj, scene):
    obj.hide_render = True


def _exclude_collection(obj, scene):
    collection = bpy.data.collections.new("Left out")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    layer = scene.view_layers[0].layer_collection.children[collection.name]
    layer.exclude = True


@pytest.mark.parametrize("hide", [_hide_render, _exclude_collection], ids=lambda f: f.__name__[1:])
def test_what_the_picture_does_not_show_is_not_seen_through_the_glass(tmp_path, hide):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH" if hide is _hide_render else "CYCLES")
    bpy.ops.mesh.primitive_cube_add(size=0.04, location=(0, 0.1, 0.06))
    cube = bpy.context.object
    _red(cube, (1.0, 0.0, 1.0))
    scenes.glass(shape="CYLINDER")
    covered_by = scenes.picture(scene, tmp_path, "seen")
    hide(cube, scene)
    found = scenes.picture(scene, tmp_path, "hidden")
    assert np.abs(found - covered_by).max() > 0.3
    bpy.data.objects.remove(cube)
    without = scenes.picture(scene, tmp_path, "without")
    np.testing.assert_allclose(found, without, atol=1e-4)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_a_material_override_holds_in_the_glass(tmp_path, engine):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall()
    scene = _scene(samples=1, engine=engine, surface="REFRACTION")
    scene.view_layers[0].material_override = scenes.emissive("override", (0.25, 0.5, 0.75))
    scene.view_layers[0].material_override.diffuse_color = (0.25, 0.5, 0.75, 1.0)
    scenes.glass(shape="CYLINDER")
    plain = _plain(scene, tmp_path)
    found = scenes.picture(scene, tmp_path)
    middle = found[18:24, 28:36, :3]
    np.testing.assert_allclose(middle, plain[18:24, 28:36, :3], atol=0.01)


def test_things_of_a_background_set_are_seen_through_the_glass(tmp_path):
    scene = _scene(samples=16)
    behind = bpy.data.scenes.new("Set")
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    wall = _wall(stripes=6)
    scene.collection.objects.unlink(wall)
    behind.collection.objects.link(wall)
    scene.background_set = behind
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    covered = _covered(scene)
    assert _problems(scene) == []
    assert _psnr(found, _reference(scene), covered) > 24.0


@pytest.mark.parametrize("strength", [1000.0, 30.0])
def test_what_shines_behind_the_glass_leaves_no_ring_where_it_stands(tmp_path, strength):
    """Splines swing beside an edge: a lamp of 1000 had a ring of −30 round its own place."""
    scenes.camera(location=(0.0, -0.5, 0.06), tilt=np.pi / 2)
    scene = _scene(width=120, height=90, samples=8)
    bpy.ops.mesh.primitive_plane_add(size=2.0, location=(0, 0.5, 0), rotation=(np.pi / 2, 0, 0))
    bpy.context.object.data.materials.append(scenes.emissive("Wall", (0.2, 0.3, 0.2)))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.012, location=(0.02, 0.2, 0.07))
    light = tuple(strength * part for part in (1.0, 0.9, 0.8))
    bpy.context.object.data.materials.append(scenes.emissive("Lamp", light))
    scenes.glass(shape="CYLINDER", radius=0.06, contents_ior=1.333)
    found = scenes.picture(scene, tmp_path)
    inside = _covered(scene)
    assert found[inside].min() > 0.1
    wanted = _reference(scene, samples=64)
    off = _psnr(np.clip(found, 0.0, 1.0), np.clip(wanted, 0.0, 1.0), inside)
    assert off > 27.0, off


def test_a_holdout_is_a_hole_in_the_glass_too(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=16)
    scene.render.film_transparent = True
    bpy.ops.mesh.primitive_cube_add(size=0.05, location=(0, 0.1, 0.06))
    bpy.context.object.is_holdout = True
    scenes.glass(shape="CYLINDER", radius=0.06, contents_ior=1.333)
    found = scenes.picture(scene, tmp_path)
    inner = _inner(_covered(scene))
    plain = _plain(scene, tmp_path)
    hole = plain[22:26, 30:34, 3].mean()
    assert hole == pytest.approx(0.0, abs=1e-3)
    # The glass's own reflections are all that is left there.
    assert found[22:26, 30:34, 3].mean() < 0.35
    wanted = _reference(scene)
    assert np.abs(found - wanted)[inner][:, 3].mean() < 0.03


@pytest.mark.parametrize("inside", [False, True])
def test_what_is_hidden_from_transmission_is_not_seen_through_the_glass(tmp_path, inside):
    """In Cycles, as *Ray Visibility* says; beside the glass it is seen."""
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=16)
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0, 0.0 if inside else 0.1, 0.06))
    _red(bpy.context.object, (1.0, 0.0, 1.0))
    scenes.glass(shape="CYLINDER")
    shown = scenes.picture(scene, tmp_path, "shown")
    cube = bpy.data.objects["Cube"]
    cube.visible_transmission = False
    found = scenes.picture(scene, tmp_path, "hidden")
    inner = _inner(_covered(scene))
    wanted = _reference(scene)
    assert np.abs(shown - wanted)[inner].max() > 0.3
    assert _psnr(found, wanted, inner) > 25.0


@pytest.mark.parametrize("inside", [False, True])
def test_only_what_its_collection_holds_is_seen_through_a_glass(tmp_path, inside):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    wall = _wall(stripes=6)
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH", surface="REFRACTION")
    # In the cavity, or behind the glass; and one before it, which hides it as ever.
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0, 0.0 if inside else 0.1, 0.06))
    left_out = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=0.01, location=(0.01, -0.2, 0.06))
    before = bpy.context.object
    for obj in (left_out, before):
        _red(obj, (1.0, 0.0, 1.0))
    glass = scenes.glass(shape="CYLINDER")
    collection = bpy.data.collections.new("Seen")
    scene.collection.children.link(collection)
    collection.objects.link(wall)
    write_input(glass_modifier(glass), "Seen Through", collection)
    found = scenes.picture(scene, tmp_path, "filtered")
    assert _problems(scene) == []
    inner = _covered(scene)
    write_input(glass_modifier(glass), "Seen Through", None)
    everything = scenes.picture(scene, tmp_path, "all")
    bpy.data.objects.remove(left_out)
    wanted = scenes.picture(scene, tmp_path, "without")
    assert np.abs(everything - wanted)[inner].max() > 0.3
    assert _psnr(found, wanted, inner) > 25.0


def test_glasses_of_different_collections_are_told_of(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    one, _ = scenes.glass(shape="CYLINDER"), scenes.glass(shape="ROD")
    collection = bpy.data.collections.new("Seen")
    write_input(glass_modifier(one), "Seen Through", collection)
    scenes.picture(scene, tmp_path)
    (problem,) = _problems(scene)
    assert "different Seen Through" in problem


# ------------------------------------------------------------------------------------- view layers


def test_the_first_layer_that_is_rendered_counts(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall()
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    scenes.glass(shape="CYLINDER")
    wanted = scenes.picture(scene, tmp_path, "one layer")
    door.remove(scene)
    second, third = scene.view_layers.new("Second"), scene.view_layers.new("Third")
    scene.view_layers[0].use = False
    third.use = False
    found = scenes.picture(scene, tmp_path, "second layer")
    assert _problems(scene) == []
    np.testing.assert_array_equal(found, wanted)
    second.use, third.use = True, True
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path, "two layers"), wanted)


# ------------------------------------------------------------------------- what it cannot show well


def _blurred_pane(engine):
    """A dark pane before a bright wall that the camera sees sharply; the pane's right edge is in
    the picture's middle. Also its blur's radius, pixels.
    """
    eyes = scenes.camera(location=(0.0, -0.5, 0.0), tilt=np.pi / 2, clip_start=0.01)
    bpy.ops.mesh.primitive_plane_add(location=(0.0, 0.5, 0.0), rotation=(np.pi / 2, 0.0, 0.0))
    bpy.context.object.data.materials.append(scenes.emissive("bright", (0.5, 0.5, 0.5)))
    scene = _scene(engine=engine, samples=16, surface="REFRACTION")
    pane = scenes.glass(shape="SLAB", radius=0.2, wall_thickness=0.001, ior=1.01)
    pane.location, pane.rotation_euler = (-0.2, -0.2, 0.0), (np.pi / 2, 0.0, 0.0)
    write_input(glass_modifier(pane), "Absorption Color", (1e-6, 1e-6, 1e-6, 1.0))
    write_input(glass_modifier(pane), "Absorption Distance", 1e-4)
    dof = eyes.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 1.0, 0.8
    return scene, 64 * 50 / 36 * 0.025 / 0.8 * (1 / 0.3 - 1.0)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_a_glass_out_of_focus_ends_as_a_disc_of_the_lens_does(tmp_path, engine):
    scene, radius = _blurred_pane(engine)
    found = scenes.picture(scene, tmp_path)[12:36, :, 0].mean(axis=0) / 0.5
    assert _problems(scene) == []
    place = np.clip((np.arange(64) - 31.5) / radius, -1.0, 1.0)
    wanted = 1.0 - (np.arccos(place) - place * np.sqrt(1.0 - place**2)) / np.pi
    assert radius > 6.0
    np.testing.assert_allclose(found, wanted, atol=0.05)


def test_depth_of_field_that_is_not_followed_is_told_of(tmp_path):
    scene, _ = _blurred_pane("CYCLES")
    scene.refractive_glass.captures = 1
    scenes.picture(scene, tmp_path)
    assert "has depth of field" in " ".join(_problems(scene))


def test_light_that_comes_along_with_each_camera_is_told_of(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    # Beside the picture and behind the camera: what the glass shows of it only captures see.
    _wall()
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(0.0, 0.0, 0.0))
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    shading, told = scene.display.shading, {}
    for light, world in (("FLAT", False), ("STUDIO", False), ("STUDIO", True), ("MATCAP", False)):
        shading.light, shading.use_world_space_lighting = light, world
        scenes.picture(scene, tmp_path)
        told[light, world] = [p for p in _problems(scene) if "lit from elsewhere" in p]
    assert [key for key, lines in told.items() if lines] == [("STUDIO", False), ("MATCAP", False)]
    assert "switch World Space Lighting on" in told["STUDIO", False][0]


def test_things_that_eevee_takes_for_thicker_than_the_glass_are_told_of():
    scenes.camera()
    scene = _scene(samples=1)
    scenes.glass(shape="CYLINDER", radius=0.04, height=0.12)
    eevee, told = scene.eevee, {}
    for engine, traced, near in (
        ("CYCLES", True, 0.25),
        ("BLENDER_EEVEE", False, 0.25),
        ("BLENDER_EEVEE", True, 0.25),
        ("BLENDER_EEVEE", True, 0.01),
    ):
        scene.render.engine, eevee.use_raytracing, eevee.fast_gi_thickness_near = (
            engine,
            traced,
            near,
        )
        door.prepare(scene, scene_depsgraph(scene), strict=True)
        depsgraph = scene_depsgraph(scene)
        problems = true.update(scene, depsgraph, read_viewpoint(scene, depsgraph)).problems
        told[engine, traced, near] = [p for p in problems if "Thickness Near" in p]
    assert [key for key, lines in told.items() if lines] == [("BLENDER_EEVEE", True, 0.25)]
    assert (
        "takes things for 0.25 m thick, and the largest glass is 0.16 m"
        in told["BLENDER_EEVEE", True, 0.25][0]
    )


def test_what_the_picture_shows_is_not_taken_from_a_capture_that_is_lit_from_elsewhere(tmp_path):
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    # Through the water's surface much of the table is seen at second hand, more finely by captures.
    scenes.cup(scenes.HIGH)
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    bpy.ops.mesh.primitive_plane_add(size=0.6)
    scene.display.shading.light, shares = "STUDIO", {}
    for everywhere in (True, False):
        scene.display.shading.use_world_space_lighting = everywhere
        scenes.picture(scene, tmp_path)
        shares[everywhere] = door.memory_of(scene).status.views[0].share
    assert shares[False] > shares[True] + 0.03


# ------------------------------------------------------------------------------ the user's tree


def test_the_users_nodes_before_and_behind_stay_and_work(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall()
    scene = _scene(samples=1, engine="BLENDER_WORKBENCH")
    scenes.glass(shape="CYLINDER")
    plain = scenes.picture(scene, tmp_path, "plain tree")
    door.remove(scene)
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, end = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    layers.scene = scene
    half = tree.nodes.new("ShaderNodeVectorMath")
    half.operation = "SCALE"
    half.inputs["Scale"].default_value = 0.5
    tree.links.new(layers.outputs["Image"], half.inputs[0])
    tree.links.new(half.outputs[0], end.inputs[0])
    scene.compositing_node_group = tree
    found = scenes.picture(scene, tmp_path, "my tree")
    np.testing.assert_allclose(found[..., :3], 0.5 * plain[..., :3], atol=1e-4)
    door.remove(scene)
    links = {(x.from_node.name, x.to_node.name) for x in tree.links}
    assert links == {(layers.name, half.name), (half.name, end.name)}


# --------------------------------------------------------------------------------- what it takes


def test_a_frame_takes_few_rays_and_few_casts(tmp_path):
    """Counts of operations, which guard the time of a frame whatever else the machine does."""
    scenes.camera()
    _wall()
    scene = _scene(160, 120, samples=1)
    scenes.glass(shape="CYLINDER", radius=0.04)
    before = dict(door.counters)
    scenes.picture(scene, tmp_path, "first")
    status = door.memory_of(scene).status

    def since(name):
        return door.counters[name] - before.get(name, 0)

    assert status.covered > 2000
    # One a pixel where ways are smooth, and of what glasses may cover a part is beside them.
    assert status.rays < 5 * status.covered
    assert status.ways < 14 * status.covered
    # Five a place for captures, and a few for the hits of centres and of further rays.
    assert since("casts") < 60
    assert since("cast_rays") < 40 * status.covered
    traced = door.counters["exit_rays"]
    scenes.picture(scene, tmp_path, "again")
    assert door.counters["exit_rays"] == traced


def test_a_view_that_was_drawn_smaller_and_is_needed_no_more_leaves_no_trace(tmp_path):
    """Blender reads past the end of the picture that it has kept of such a view."""
    scenes.camera()
    _wall()
    _wall(-0.8).rotation_euler.z = np.pi
    scene = _scene(24, 18, samples=1)
    scenes.glass(shape="SPHERE", radius=0.05, contents_ior=1.333)
    scenes.picture(scene, tmp_path, "small")
    assert len(door.status(scene).views) > 1
    scene.render.resolution_x, scene.render.resolution_y = 240, 180
    scene.refractive_glass.captures = 0
    found = scenes.picture(scene, tmp_path, "large")
    assert len(door.status(scene).views) == 1
    assert np.isfinite(found).all() and found[..., :3].max() < 2.0
    again = scenes.picture(scene, tmp_path, "again")
    np.testing.assert_array_equal(again, found)


def test_a_picture_cropped_through_the_glass_is_that_part_of_the_whole(tmp_path):
    """Ways end in the pixels beyond its border too, which it does not hold."""
    scenes.camera()
    _wall()
    scene = _scene(64, 48)
    scenes.glass(shape="CYLINDER")
    whole = scenes.picture(scene, tmp_path)
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 0.25, 0.5
    render.border_min_y, render.border_max_y = 0.25, 0.5
    part = scenes.picture(scene, tmp_path)
    assert part.shape == (12, 16, 4)
    assert _problems(scene) == []
    off = np.abs(part - whole[12:24, 16:32])[..., :3]
    assert np.median(off) < 1e-3
    # Next to the border views have other captures.
    assert off.mean() < 0.02


def _beside_a_lamp(scene, place, turn, **values):
    """An area lamp at a place, turned from −z about x, with a white world and a striped wall."""
    light = bpy.data.lights.new("Lamp", "AREA")
    light.energy, light.size = 0.02, 0.06
    for name, value in values.items():
        setattr(light, name, value)
    lamp = bpy.data.objects.new("Lamp", light)
    scene.collection.objects.link(lamp)
    lamp.location, lamp.rotation_euler.x = place, turn
    _world((0.5, 0.5, 0.5))
    _wall(0.3)


@pytest.mark.parametrize(
    ("place", "turn", "values"),
    [
        ((0.0, 0.12, 0.06), np.pi / 2, {}),
        ((0.0, 0.12, 0.06), -np.pi / 4, {"spread": 0.5}),
        ((0.0, -0.2, 0.06), np.pi / 2, {}),
    ],
    ids=("behind, from its back", "beside its beam", "before"),
)
def test_lamps_are_not_there_where_they_are_dark_and_for_cameras(tmp_path, place, turn, values):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=32)
    _beside_a_lamp(scene, place, turn, **values)
    scenes.glass(shape="CYLINDER")
    _against_cycles(scene, tmp_path, 28.0)


def test_a_lamp_without_power_is_not_there(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene()
    _beside_a_lamp(scene, (0.0, 0.12, 0.06), -np.pi / 2, energy=0.0)
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    np.testing.assert_allclose(found, scenes.picture(scene, tmp_path), atol=1e-5)


@pytest.mark.parametrize("engine", ENGINES[:2])
def test_a_world_that_is_for_cameras_alone_is_not_seen_in_the_glass(tmp_path, engine):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(engine=engine, surface="REFRACTION")
    tree = _world((0.1, 0.2, 0.9)).node_tree
    plain = next(n for n in tree.nodes if n.type == "BACKGROUND")
    end = next(n for n in tree.nodes if n.type == "OUTPUT_WORLD")
    of_cameras, mix, path = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("Background", "MixShader", "LightPath")
    )
    of_cameras.inputs["Color"].default_value = (0.9, 0.1, 0.1, 1.0)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(plain.outputs[0], mix.inputs[1])
    tree.links.new(of_cameras.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end.inputs["Surface"])
    scene.view_layers[0].material_override = scenes.emissive("override", (0.0, 1.0, 0.0))
    scenes.glass(shape="SPHERE", wall_thickness=0.0).location.z = 0.05
    found = scenes.picture(scene, tmp_path)
    inner = _inner(_covered(scene))
    np.testing.assert_allclose(found[inner][:, :3].mean(axis=0), (0.1, 0.2, 0.9), rtol=0.02)
    assert found[inner][:, 0].max() < 0.15
    np.testing.assert_allclose(found[0, 0, :3], (0.9, 0.1, 0.1), rtol=0.01)


def test_a_world_that_cameras_do_not_see_is_seen_in_the_glass(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=16)
    _colourful_world().cycles_visibility.camera = False
    scenes.glass(shape="SPHERE", wall_thickness=0.0).location.z = 0.05
    _against_cycles(scene, tmp_path, 30.0)


def _inner(covered):
    """Pixels all of whose neighbours are covered too."""
    around = [np.roll(covered, (x, y), (0, 1)) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    return np.logical_and.reduce(around)


def test_between_two_frames_all_is_seen_where_it_is_then(tmp_path):
    """A script may render at a part of a frame; captures show the same moment."""
    scenes.cup()
    scene = _scene()
    thing = scenes.rod((0.05, 0.0, 0.075))
    wanted = scenes.picture(scene, tmp_path, "still")
    for frame, x in ((1, 0.0), (2, 0.1)):
        thing.location.x = x
        thing.keyframe_insert("location", frame=frame)
    for curve in thing.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(1, subframe=0.5)
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path), wanted)


def test_a_softbox_that_cameras_do_not_see_is_mirrored(tmp_path):
    """So is a matte face of the same mesh beside it: captures see it behind a pane."""
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    _wall(stripes=6)
    scene = _scene(samples=16)
    _world((0.1, 0.1, 0.1))
    bpy.ops.mesh.primitive_grid_add(
        x_subdivisions=2, y_subdivisions=1, size=0.3, location=(0.0, -0.5, 0.06)
    )
    softbox = bpy.context.object
    softbox.rotation_euler.x = -np.pi / 2
    softbox.visible_camera = False
    softbox.data.materials.append(scenes.emissive("softbox", (5.0, 4.0, 3.0)))
    softbox.data.materials.append(bpy.data.materials.new("matte"))
    softbox.data.polygons[1].material_index = 1
    scenes.glass(shape="CYLINDER")
    found, _ = _against_cycles(scene, tmp_path, 25.0)
    softbox.visible_glossy = False
    without = scenes.picture(scene, tmp_path, "without")
    assert (found - without).max() > 0.1
    # Nor is one that lights other things only.
    softbox.visible_glossy = True
    others = softbox.light_linking.receiver_collection = bpy.data.collections.new("Others")
    others.objects.link(bpy.data.objects["Wall"])
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path, "linked"), without)
    _against_cycles(scene, tmp_path, 25.0)


@pytest.mark.parametrize("kind", ["LayerWeight", "Fresnel", "BsdfGlossy", "BsdfGlass"])
def test_what_depends_on_the_direction_is_asked_for_in_groups_too(kind):
    material, group = bpy.data.materials.new("Rim"), bpy.data.node_groups.new("G", "ShaderNodeTree")
    material.node_tree.nodes.clear()
    material.node_tree.nodes.new("ShaderNodeGroup").node_tree = group
    group.nodes.new("ShaderNodeBsdfDiffuse")
    assert not look_of(material).is_glossy
    node = group.nodes.new(f"ShaderNode{kind}")
    assert look_of(material).is_glossy
    node.mute = True
    assert not look_of(material).is_glossy


def test_what_a_principled_shader_emits_shines_as_an_emission_node_does():
    emission, principled = bpy.data.materials.new("E"), bpy.data.materials.new("P")
    emission.node_tree.nodes.clear()
    inputs = emission.node_tree.nodes.new("ShaderNodeEmission").inputs
    inputs["Color"].default_value, inputs["Strength"].default_value = (1.0, 0.5, 0.2, 1.0), 40.0
    node = principled.node_tree.nodes["Principled BSDF"]
    for name in ("Color", "Strength"):
        node.inputs[f"Emission {name}"].default_value = inputs[name].default_value
    assert look_of(principled).radiance == look_of(emission).radiance != (0.0, 0.0, 0.0)


def test_a_collection_that_is_indirect_only_is_hidden_from_cameras_alone():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    collection = bpy.data.collections.new("Indirect")
    bpy.context.scene.collection.children.link(collection)
    for _ in range(2):
        bpy.ops.mesh.primitive_cube_add()
    bpy.data.objects["Cube"].visible_camera = False
    collection.objects.link(bpy.data.objects["Cube.001"])
    bpy.context.collection.objects.unlink(bpy.data.objects["Cube.001"])
    bpy.context.view_layer.layer_collection.children["Indirect"].indirect_only = True
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "CYCLES", {})
    assert things.looks[0] == things.looks[1]
    assert things.looks[0].is_hidden


def test_a_world_that_the_view_layer_leaves_out_is_not_in_the_glass(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene()
    _world((0.4, 0.5, 0.6))
    scene.view_layers[0].use_sky = False
    scenes.glass(shape="SPHERE", wall_thickness=0.0).location.z = 0.05
    assert np.abs(scenes.picture(scene, tmp_path)[..., :3]).max() < 1e-4


def test_a_scene_of_a_tenth_of_a_millimetre_looks_as_it_does_large(tmp_path):
    """Also what captures show: a thing that the glass magnifies."""
    scenes.cup(scenes.HIGH)
    scene = _scene(samples=8)
    bpy.ops.mesh.primitive_cube_add(size=0.05, location=(0.0, 0.09, 0.03))
    _red(bpy.context.object)
    scene.camera.data.clip_start = 1e-5
    large = scenes.picture(scene, tmp_path, "large")
    for obj in scene.objects:
        obj.location *= 1e-3
        if obj.type != "CAMERA":
            obj.scale *= 1e-3
    small = scenes.picture(scene, tmp_path, "small")
    assert np.abs(small - large)[_covered(scene)].mean() < 0.01


@pytest.mark.parametrize("kind", ["AREA", "SUN"])
@pytest.mark.parametrize("state", ["INCLUDE", "EXCLUDE"])
def test_a_lamp_is_mirrored_by_glasses_that_its_light_linking_names(tmp_path, kind, state):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2)
    scene = _scene(samples=1)
    _world((0.0, 0.0, 0.0))
    lamp = _lamp_before_a_pane(scene, kind)
    mirrored = scenes.picture(scene, tmp_path)
    pane = bpy.data.collections.new("Pane")
    pane.objects.link(bpy.data.objects["Refractive Glass"])
    pane.collection_objects[0].light_linking.link_state = state
    lamp.light_linking.receiver_collection = pane
    found = scenes.picture(scene, tmp_path, "linked")
    assert mirrored[..., :3].max() > 0.01
    wanted = mirrored[..., :3] * (state == "INCLUDE")
    np.testing.assert_allclose(found[..., :3], wanted, atol=1e-5)
    reference = _reference(scene, 1)[..., :3]
    assert (reference.max() > 0.01) == (state == "INCLUDE")


def test_what_the_camera_clips_is_seen_in_the_glass(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.05), tilt=np.pi / 2, clip_end=0.45)
    scene = _scene(samples=8, surface="REFRACTION")
    _world((0.0, 0.0, 0.0))
    _wall(0.2, size=3.0)
    scenes.glass(shape="SLAB", radius=0.03, wall_thickness=0.01).rotation_euler.x = np.pi / 2
    found, _ = _against_cycles(scene, tmp_path, 25.0, samples=64)
    assert found[0, 0, :3].max() == 0.0


def _polished(obj, metallic=1.0, roughness=0.1):
    material = bpy.data.materials.new("Polished")
    node = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    node.inputs["Metallic"].default_value = metallic
    node.inputs["Roughness"].default_value = roughness
    obj.data.materials.append(material)


@pytest.mark.parametrize(
    ("metallic", "turn", "told"), [(1.0, 0.0, True), (0.0, 0.0, False), (1.0, 0.6, False)]
)
def test_a_mirror_of_a_glass_is_told_of(tmp_path, metallic, turn, told):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=1, engine="BLENDER_EEVEE")
    scene.eevee.use_raytracing, scene.eevee.use_fast_gi = True, False
    # Behind the glass; turned away it mirrors what is beside.
    bpy.ops.mesh.primitive_plane_add(size=0.16, location=(0.0, 0.2, 0.06))
    mirror = bpy.context.object
    mirror.rotation_euler = (np.pi / 2, 0.0, turn)
    _polished(mirror, metallic)
    scenes.glass(shape="CYLINDER")
    scenes.picture(scene, tmp_path)
    assert any('"Plane" mirrors a glass' in line for line in _problems(scene)) == told


def _tinted_water():
    glass = scenes.glass(shape="TUMBLER", liquid_level=0.06, contents_ior=1.333)
    for name, colour in (("", (0.5, 0.9, 0.7, 1.0)), ("Contents ", (0.9, 0.3, 0.2, 1.0))):
        write_input(glass_modifier(glass), f"{name}Absorption Color", colour)


def _mirrored_mesh():
    """A solid of uneven and mirrored scale, turned."""
    bpy.ops.mesh.primitive_cylinder_add(radius=0.02, depth=0.05, vertices=24)
    obj = bpy.context.object
    bpy.ops.object.refractive_glass_modifier_add()
    obj.location, obj.scale, obj.rotation_euler = (0.0, 0.0, 0.05), (-2.0, 1.5, 1.6), (0.3, 0.2, 0)


@pytest.mark.parametrize(("metallic", "least"), [(1.0, 28.5), (0.0, 31.1)])
def test_a_mirror_shows_a_glass_what_it_mirrors_to_it(tmp_path, metallic, least):
    """Not what it mirrors to the view that shows it: that had 27.2 dB. What mirrors more is less
    bright by itself."""
    scenes.camera(location=(0.0, -0.4, 0.12), tilt=np.pi / 2 * 0.85)
    scene = _scene(samples=32)
    _wall(stripes=12)
    _world((0.2, 0.3, 0.4))
    bpy.ops.mesh.primitive_plane_add(size=2.0, location=(0.0, 0.0, -0.001))
    _polished(bpy.context.object, metallic)
    scenes.glass(shape="SPHERE", radius=0.06, contents_ior=1.5).location.z = 0.07
    _against_cycles(scene, tmp_path, least)


@pytest.mark.parametrize("make", [_tinted_water, _mirrored_mesh])
def test_mirrors_show_glasses_as_in_cycles(tmp_path, make):
    """A polished floor before a glass, which is beside the glass's own picture."""
    scenes.camera(location=(0.0, -0.35, 0.16), tilt=np.pi / 2 * 0.68)
    scene = _scene(samples=48)
    _wall(stripes=12)
    _world((0.2, 0.3, 0.4))
    bpy.ops.mesh.primitive_plane_add(size=0.5, location=(0.0, 0.0, -0.001))
    floor = bpy.context.object
    _polished(floor)
    make()
    found = scenes.picture(scene, tmp_path)
    assert not _problems(scene)
    beside = ~_covered(scene)
    wanted = _reference(scene, 64)
    off = _psnr(found, wanted, beside)
    print(f"{off:.1f} dB beside")
    assert off > 34.0
    counted = counters["mirrored"]
    scenes.picture(scene, tmp_path, "again")
    assert counters["mirrored"] == counted
    # Nothing that mirrors, so nothing to show.
    floor.hide_render = True
    scenes.picture(scene, tmp_path, "matte")
    held = [o for o in bpy.data.objects if o.get("refractive_glass") == "mirrored"]
    assert [len(o.data.vertices) for o in held] == [0]
    scene.refractive_glass.enabled = False
    scenes.picture(scene, tmp_path, "off")
    assert not [o for o in bpy.data.objects if o.get("refractive_glass") == "mirrored"]


def _asking(kind, output):
    """A cube behind the glass as bright as an output of a node says."""
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.0, 0.15, 0.06))
    _red(bpy.context.object)
    tree = bpy.context.object.active_material.node_tree
    asked = tree.nodes.new(kind)
    tree.links.new(asked.outputs[output], tree.nodes["Emission"].inputs["Strength"])


def test_what_depends_on_the_cameras_distance_is_looked_up_in_the_picture(tmp_path):
    scenes.camera(location=(0.05, -0.5, 0.2), tilt=1.26)
    scene = _scene(samples=16)
    # Captures stand nearer.
    _asking("ShaderNodeCameraData", "View Distance")
    scenes.glass(shape="ROD", radius=0.05, height=0.14)
    _against_cycles(scene, tmp_path, 24.0)
    assert _problems(scene) == []


def _pencil(obj):
    bpy.ops.object.grease_pencil_add(type="STROKE", location=(0.0, 0.1, 0.05))
    bpy.context.object.name = "Strokes"
    bpy.data.objects.remove(obj)


@pytest.mark.parametrize(("change", "name"), [(_pencil, "Strokes"), (None, "")])
def test_what_rays_do_not_meet_is_told_of(tmp_path, change, name):
    scenes.camera()
    scene = _scene(samples=1)
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0.0, 0.1, 0.05))
    bpy.context.object.name = "Thing"
    if change:
        change(bpy.context.object)
    scenes.glass(shape="CYLINDER")
    scenes.picture(scene, tmp_path)
    told = [line for line in _problems(scene) if line.startswith("Rays do not meet")]
    assert len(told) == bool(change)
    assert all(f'"{name}"' in line for line in told)


def test_what_looks_otherwise_to_camera_rays_looks_in_the_glass_as_it_does_to_others(tmp_path):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=4)
    _asking("ShaderNodeLightPath", "Is Transmission Ray")
    scenes.glass(shape="CYLINDER")
    _against_cycles(scene, tmp_path, 24.0, samples=16)


def _window(depth, **inputs):
    bpy.ops.mesh.primitive_cube_add(location=(0.0, depth, 0.06))
    bpy.context.object.scale = (0.03, 0.004, 0.05)
    material = bpy.data.materials.new("Window")
    node = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    bpy.context.object.data.materials.append(material)


@pytest.mark.parametrize(("depth", "told"), [(-0.2, True), (0.2, False)])
def test_what_is_seen_through_before_a_glass_is_told_of(tmp_path, depth, told):
    scenes.camera(location=(0.0, -0.4, 0.06), tilt=np.pi / 2)
    scene = _scene(samples=1)
    _window(depth, Alpha=0.5)
    scenes.glass(shape="CYLINDER")
    scenes.picture(scene, tmp_path)
    assert any('"Cube" is before a glass' in line for line in _problems(scene)) == told


def test_windows_of_cycles_own_glass_show_glasses_as_in_cycles(tmp_path):
    scenes.camera(location=(0.0, -0.35, 0.1))
    scene = _scene(samples=48)
    _wall(stripes=12)
    _world((0.2, 0.3, 0.4))
    _window(-0.1, Transmission_Weight=1.0, Roughness=0.0)
    scenes.glass(shape="CYLINDER")
    found = scenes.picture(scene, tmp_path)
    assert not _problems(scene)
    beside = ~_covered(scene)
    off = _psnr(found, _reference(scene, 64), beside)
    print(f"{off:.1f} dB beside")
    assert off > 30.0
