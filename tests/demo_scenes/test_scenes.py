# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo scenes hold what they promise, and the .blend files are what the scripts write."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view  # noqa: E402
from mathutils import Vector  # noqa: E402

FOLDER = Path(__file__).parents[2] / "demo_scenes"
sys.path.insert(0, str(FOLDER))

import common  # noqa: E402
import eraser  # noqa: E402
import panes  # noqa: E402

SCRIPTS = {"eraser": eraser, "panes": panes}


@pytest.fixture(params=SCRIPTS)
def script(request):
    return SCRIPTS[request.param]


def meshes(scene):
    return [obj for obj in scene.objects if obj.type == "MESH"]


def world_points(obj):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    data = obj.evaluated_get(depsgraph).data
    points = np.empty(3 * len(data.vertices), dtype=np.float32)
    data.attributes["position"].data.foreach_get("vector", points)
    matrix = np.array(obj.evaluated_get(depsgraph).matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def extension_is_there():
    try:
        common.register_extension()
    except (ImportError, AttributeError):
        return False
    # bpy.ops answers any name; only a registered operator has an RNA type.
    try:
        bpy.ops.object.refractive_glass_add.get_rna_type()
        bpy.ops.object.refractive_glass_modifier_add.get_rna_type()
    except KeyError:
        return False
    return True


# --- all scenes ----------------------------------------------------------------------------------


def test_picture_settings(script):
    scene = script.build(with_glass=False)
    render = scene.render
    assert (render.resolution_x, render.resolution_y, render.resolution_percentage) == (
        800,
        600,
        100,
    )
    assert render.engine == "CYCLES"
    assert scene.cycles.samples == 64
    assert not scene.cycles.use_denoising
    assert not scene.cycles.use_adaptive_sampling
    assert scene.view_settings.view_transform == "Standard"
    assert scene.camera.data.type == "PERSP"


def test_lit_scenes_have_one_sun_and_a_sky(script):
    scene = script.build(with_glass=False)
    lights = [obj.data for obj in scene.objects if obj.type == "LIGHT"]
    assert [light.type for light in lights] == ["SUN"]
    assert min(background(scene)) > 0.1


def test_unlit_scenes_emit_and_nothing_lights_them(script):
    scene = script.build(unlit=True, with_glass=False)
    assert not [obj for obj in scene.objects if obj.type == "LIGHT"]
    assert background(scene) == (0.0, 0.0, 0.0)
    for obj in meshes(scene):
        for material in obj.data.materials:
            assert [n.type for n in material.node_tree.nodes if n.type.startswith("BSDF")] == []
            assert [n.type for n in material.node_tree.nodes if n.type == "EMISSION"]


def background(scene):
    node = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    return tuple(node.inputs["Color"].default_value)[:3]


def test_both_variants_hold_the_same_meshes(script):
    lit = {obj.name: len(obj.data.vertices) for obj in meshes(script.build(with_glass=False))}
    unlit = script.build(unlit=True, with_glass=False)
    assert {obj.name: len(obj.data.vertices) for obj in meshes(unlit)} == lit


def test_textures_use_uv_coordinates_only(script):
    # Anything else would slide over a displaced copy.
    for obj in meshes(script.build(with_glass=False)):
        assert obj.data.uv_layers
        for material in obj.data.materials:
            for link in material.node_tree.links:
                if link.from_node.type == "TEX_COORD":
                    assert link.from_socket.name == "UV"
                if link.to_node.type.startswith("TEX_"):
                    assert link.to_socket.name == "Vector" or link.to_node.type == "TEX_COORD"
            for node in material.node_tree.nodes:
                if node.type.startswith("TEX_") and node.type != "TEX_COORD":
                    assert node.inputs["Vector"].is_linked


def test_pictures_are_packed(script):
    script.build(with_glass=False)
    for image in bpy.data.images:
        if image.type == "IMAGE":
            assert image.packed_file is not None


def test_everything_is_finite_and_all_but_backdrops_is_in_the_picture(script):
    scene = script.build(with_glass=False)
    for obj in meshes(scene):
        points = world_points(obj)
        assert np.isfinite(points).all()
        if len(points) > 100:
            seen = np.array([world_to_camera_view(scene, scene.camera, Vector(p)) for p in points])
            assert (seen[:, :2] > 0.0).all() and (seen[:, :2] < 1.0).all()
            assert (seen[:, 2] > scene.camera.data.clip_start).all()


def test_command_line_writes_a_compressed_file(script, tmp_path):
    name = next(key for key, value in SCRIPTS.items() if value is script)
    target = tmp_path / "out" / "scene.blend"
    assert common.run(name, script.build, ["-o", str(target), "--unlit", "--no-glass"]) == 0
    assert target.read_bytes()[:4] == b"\x28\xb5\x2f\xfd"  # zstd
    assert [path.name for path in target.parent.iterdir()] == ["scene.blend"]


@pytest.mark.parametrize("name", SCRIPTS)
def test_blend_file_matches_its_script(name):
    path = FOLDER / f"{name}.blend"
    assert path.stat().st_size < 1_000_000
    bpy.ops.wm.open_mainfile(filepath=str(path))
    stored = contents(bpy.context.scene)
    built = contents(SCRIPTS[name].build(with_glass=False))
    assert built.keys() <= stored.keys()
    for key, value in built.items():
        np.testing.assert_array_equal(stored[key], value, err_msg=key)


def contents(scene):
    """What a scene is made of, flat, without the glass."""
    result = {"frames": (scene.frame_start, scene.frame_end, scene.frame_current)}
    result["camera"] = [*np.ravel(scene.camera.matrix_world), scene.camera.data.lens]
    for obj in scene.objects:
        result[f"{obj.name} matrix"] = np.ravel(obj.matrix_world)
    for obj in meshes(scene):
        if obj.modifiers:
            continue
        for layer, kind, width in (("position", "vector", 3), ("UVMap", "vector", 2)):
            attribute = obj.data.attributes[layer]
            values = np.empty(width * len(attribute.data), dtype=np.float32)
            attribute.data.foreach_get(kind, values)
            result[f"{obj.name} {layer}"] = values
        result[f"{obj.name} materials"] = [m.name for m in obj.data.materials]
    return result


# --- eraser --------------------------------------------------------------------------------------


def test_eraser_is_two_closed_parts_of_some_ten_thousand_vertices():
    scene = eraser.build(with_glass=False)
    data = scene.objects["Eraser"].data
    assert 10_000 < len(data.vertices) < 100_000
    assert [m.name for m in data.materials] == ["Eraser rubber", "Eraser sleeve"]
    assert len(data.vertices) - len(data.edges) + len(data.polygons) == 2 + 0  # ball and ring
    loops = np.empty(len(data.loops), dtype=np.int32)
    data.loops.foreach_get("edge_index", loops)
    assert (np.bincount(loops) == 2).all()
    assert volume(data, 0) == pytest.approx(np.prod(eraser.ERASER_SIZE), rel=0.05)
    assert volume(data, 1) > 0.0


def volume(data, material):
    total = 0.0
    for face in data.polygons:
        if face.material_index == material:
            total += face.normal.dot(face.center) * face.area / 3.0
    return total


def test_eraser_stands_on_the_desk_behind_the_glass():
    scene = eraser.build(with_glass=False)
    for frame in (1, 12, 24):
        scene.frame_set(frame)
        points = world_points(scene.objects["Eraser"])
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        assert np.hypot(points[:, 0], points[:, 1]).min() > eraser.GLASS_RADIUS + 0.005
        assert points[:, 1].min() > 0.0
        assert points[:, 1].max() < eraser.WALL_DISTANCE


def share_behind(scene):
    """Which part of the eraser's vertices the glass covers, seen from above (it is higher)."""
    eye = scene.camera.matrix_world.translation
    points = world_points(scene.objects["Eraser"])
    to_axis = math.atan2(-eye.y, -eye.x)
    half = math.asin(eraser.GLASS_RADIUS / math.hypot(eye.x, eye.y))
    angle = np.arctan2(points[:, 1] - eye.y, points[:, 0] - eye.x)
    return float(np.mean(np.abs(angle - to_axis) < half))


@pytest.mark.parametrize(
    ("frame", "least", "most"), [(1, 0.05, 0.35), (12, 0.35, 0.65), (24, 0.65, 0.95)]
)
def test_eraser_is_partly_behind_and_partly_beside_the_glass(frame, least, most):
    scene = eraser.build(with_glass=False)
    scene.frame_set(frame)
    assert least < share_behind(scene) < most


def test_eraser_slides_evenly():
    scene = eraser.build(with_glass=False)
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1, 24, 12)
    x = []
    for frame in range(1, 25):
        scene.frame_set(frame)
        x.append(scene.objects["Eraser"].matrix_world.translation.x)
    steps = np.diff(x)
    assert (steps < 0).all()
    assert np.ptp(steps) < 1e-6


def test_print_is_opaque_finite_and_says_something():
    pixels = eraser.sleeve_print()
    assert pixels.min() >= 0.0 and pixels.max() <= 1.0
    white = (np.abs(pixels - eraser.WHITE).max(axis=-1) < 0.01).mean()
    assert 0.03 < white < 0.3


# --- panes ---------------------------------------------------------------------------------------


def test_panes_are_inclined_against_the_line_of_sight_as_their_names_say():
    scene = panes.build(with_glass=False, subdivision=2)
    outlines = panes.pane_outlines(scene)
    bpy.context.view_layer.update()
    eye = scene.camera.matrix_world.translation
    for obj in outlines:
        centre = obj.matrix_world.translation
        normal = obj.matrix_world.to_3x3() @ obj.data.polygons[0].normal
        assert normal.angle(eye - centre) == pytest.approx(
            panes.PANES[obj.name].inclination, abs=1e-5
        )
        assert np.ptp([v.co.z for v in obj.data.vertices]) == 0.0
        assert tuple(obj.scale) == (1.0, 1.0, 1.0)


def test_panes_stand_clear_in_front_and_cut_spout_or_handle():
    scene = panes.build(with_glass=False, subdivision=6)
    outlines = panes.pane_outlines(scene)
    bpy.context.view_layer.update()
    boxes = []
    for obj in outlines:
        pane = panes.PANES[obj.name]
        pot = world_points(scene.objects[obj.name.replace("Pane", "Teapot")])
        # In the pane's frame the pot lies below the lower face.
        inverse = np.array(obj.matrix_world.inverted())
        local = pot @ inverse[:3, :3].T + inverse[:3, 3]
        assert local[:, 2].max() < -pane.thickness * panes.UNIT
        front = np.array(
            [world_to_camera_view(scene, scene.camera, v) for v in corners(obj, pane.thickness)]
        )[:, :2]
        assert (front > 0.0).all() and (front < 1.0).all()
        boxes.append((front.min(axis=0), front.max(axis=0)))
        seen = np.array([world_to_camera_view(scene, scene.camera, Vector(p)) for p in pot])
        # Spout and handle reach beyond the pane's left and right ends.
        assert seen[:, 0].min() < front[:, 0].min()
        assert seen[:, 0].max() > front[:, 0].max()
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:i]:
            assert (high < other_low).any() or (other_high < low).any()


def corners(obj, thickness):
    for vertex in obj.data.vertices:
        for depth in (0.0, -thickness * panes.UNIT):
            yield obj.matrix_world @ (vertex.co + Vector((0.0, 0.0, depth)))


def test_star_and_circle_are_counter_clockwise_with_their_radius():
    for polygon in (panes.circle(2.0), panes.star(2.0)):
        assert np.linalg.norm(polygon, axis=-1).max() == pytest.approx(2.0)
        x, y = polygon.T
        assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0.0


def test_teapots_share_one_mesh_of_some_thousand_vertices():
    scene = panes.build(with_glass=False)
    pots = [obj for obj in scene.objects if obj.name.startswith("Teapot")]
    assert len(pots) == 4
    assert len({obj.data.name for obj in pots}) == 1
    assert 5_000 < len(pots[0].data.vertices) < 50_000


# --- with the extension --------------------------------------------------------------------------


def test_glass_of_the_eraser():
    if not extension_is_there():
        pytest.skip("the extension's operators are not there")
    scene = eraser.build()
    glass = scene.objects["Glass"]
    assert "Refractive Glass" in glass.modifiers
    points = world_points(glass)
    assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert points[:, 2].max() == pytest.approx(eraser.GLASS_HEIGHT, abs=1e-6)
    radius = np.hypot(points[:, 0], points[:, 1])
    assert radius.max() == pytest.approx(eraser.GLASS_RADIUS, rel=1e-3)


def test_glass_of_the_panes():
    if not extension_is_there():
        pytest.skip("the extension's operators are not there")
    scene = panes.build(subdivision=2)
    for name, pane in panes.PANES.items():
        obj = scene.objects[name]
        assert "Refractive Glass" in obj.modifiers
        inverse = np.array(obj.matrix_world.inverted())
        z = (world_points(obj) @ inverse[:3, :3].T + inverse[:3, 3])[:, 2]
        assert z.max() == pytest.approx(0.0, abs=1e-6)
        assert z.min() == pytest.approx(-pane.thickness * panes.UNIT, abs=1e-6)
