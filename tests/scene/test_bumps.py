# SPDX-License-Identifier: GPL-3.0-or-later
"""Bumps of glasses that are meshes: laws, closed forms, and Cycles."""

import bpy
import numpy as np
import pytest
import scenes
from glassy import (
    cube,
    glass_of,
    link,
    material,
    node,
    paint,
    painted,
    pane_beside_cycles,
    prepared,
    seen,
)

from glass_refraction.scene import update as door
from glass_refraction.scene.build.own_scenes import own_blocks
from glass_refraction.scene.memory import counters
from glass_refraction.scene.names import own
from glass_refraction.scene.read import bumps
from glass_refraction.scene.read.bumps import COARSE, MOST_TRIANGLES, TOLERANCE
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.material_fields import FIELDS
from glass_refraction.scene.read.unread import unread

FINE = 3e-3
"""Radians: single precision, and steps of a ten thousandth of the mesh."""


@pytest.fixture(autouse=True)
def nothing_kept():
    bumps._kept.clear()


def bump(made, height, **inputs):
    found = node(made, "Bump", **inputs)
    link(made, height, found.inputs["Height"])
    link(made, found.outputs[0], glass_of(made).inputs["Normal"])
    return found


def ramp(made, axis="X", coordinate="Object"):
    """A height that is a coordinate."""
    place = node(made, "TexCoord")
    parts = node(made, "SeparateXYZ")
    link(made, place.outputs[coordinate], parts.inputs[0])
    return parts.outputs[axis]


def sine(made, waves=9.0):
    """A height that is a sine of x."""
    height = node(made, "Math")
    height.operation = "SINE"
    factor = node(made, "Math")
    factor.operation = "MULTIPLY"
    factor.inputs[1].default_value = waves
    link(made, ramp(made), factor.inputs[0])
    link(made, factor.outputs[0], height.inputs[0])
    return height.outputs[0]


def noise(made, scale=4.0, coordinate="Object"):
    found = node(made, "TexNoise", Scale=scale, Detail=0.0)
    found.noise_dimensions = "4D"
    place = node(made, "TexCoord")
    link(made, place.outputs[coordinate], found.inputs["Vector"])
    return found


def flat(mesh):
    found = np.cross(mesh.points[:, 1] - mesh.points[:, 0], mesh.points[:, 2] - mesh.points[:, 0])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_bumps_of_no_strength_change_nothing():
    made = material()
    found = bump(made, noise(made).outputs[0], Strength=0.0, Distance=0.1)
    obj = cube(made)
    without = seen()
    assert without.within is None
    made.node_tree.nodes.remove(found)
    obj.data.update_tag()
    prepared()
    assert seen() == without


@pytest.mark.parametrize(
    ("scale", "turn"),
    [
        ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
        ((2.0, 0.5, 1.0), (0.3, 0.5, 0.7)),
        ((-1.0, 1.0, 1.0), (0.0, 0.4, 0.0)),
    ],
)
def test_a_ramp_of_heights_tilts_faces_as_a_wedge(scale, turn):
    made = material()
    bump(made, ramp(made), Distance=0.2)
    obj = cube(made, scale=scale, turn=turn)
    mesh = seen()
    normal = flat(mesh)[:, None]
    # The height is a coordinate of the object's frame: its gradient is a row of the inverse.
    slope = np.linalg.inv(np.array(obj.matrix_world)[:3, :3])[0]
    along = slope - (normal @ slope)[..., None] * normal
    for normals, sign in ((mesh.normals, -1.0), (mesh.within, 1.0)):
        wanted = normal + sign * 0.2 * along
        wanted /= np.linalg.norm(wanted, axis=2, keepdims=True)
        assert np.abs(normals - wanted).max() < FINE


def test_normals_between_corners_run_as_the_heights_do():
    made = material()
    bump(made, sine(made), Distance=0.02)
    cube(made)
    mesh = seen()
    assert len(mesh.points) < MOST_TRIANGLES
    middle = 0.5 * (mesh.points[:, 0] + mesh.points[:, 1])
    between = 0.5 * (mesh.normals[:, 0] + mesh.normals[:, 1])
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    normal = flat(mesh)
    slope = np.zeros_like(middle)
    slope[:, 0] = 0.02 * 9.0 * np.cos(9.0 * (middle[:, 0] - 0.1))
    slope -= (slope * normal).sum(axis=1, keepdims=True) * normal
    wanted = normal - slope
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert np.linalg.norm(between - wanted, axis=1).max() < TOLERANCE + FINE
    # No point left its face, and none is without neighbours: the parts have the whole's area.
    sides = np.cross(mesh.points[:, 1] - mesh.points[:, 0], mesh.points[:, 2] - mesh.points[:, 0])
    assert 0.5 * np.linalg.norm(sides, axis=1).sum() == pytest.approx(6.0, rel=1e-6)
    edges = np.linalg.norm(mesh.points - np.roll(mesh.points, 1, axis=1), axis=2)
    assert edges.max() <= 1.001 * COARSE * 3.0**0.5


@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_displacement_that_is_shown_as_bumps_is_a_bump_of_its_scale(space):
    found = {}
    for kind in ("bump", "displacement"):
        made = material(kind)
        if kind == "bump":
            bump(made, sine(made), Distance=0.03)
        else:
            moved = node(made, "Displacement", Scale=0.03, Midlevel=0.7)
            moved.space = space
            link(made, sine(made), moved.inputs["Height"])
            end = made.node_tree.get_output_node("ALL")
            link(made, moved.outputs[0], end.inputs["Displacement"])
            made.displacement_method = "BUMP"
        obj = cube(made)
        found[kind] = seen()
        bpy.data.objects.remove(obj)
    assert found["bump"].points.shape == found["displacement"].points.shape
    assert np.abs(found["bump"].normals - found["displacement"].normals).max() < FINE


def test_a_flat_normal_map_changes_nothing_and_a_tilted_one_tilts_along_the_map():
    made = material()
    mapped = node(made, "NormalMap")
    colour = node(made, "RGB")
    link(made, colour.outputs[0], mapped.inputs["Color"])
    link(made, mapped.outputs[0], glass_of(made).inputs["Normal"])
    colour.outputs[0].default_value = (0.5, 0.5, 1.0, 1.0)
    cube(made)
    assert seen().within is None
    colour.outputs[0].default_value = (0.8, 0.5, 0.9, 1.0)
    made.node_tree.update_tag()
    mesh = seen()
    normal = flat(mesh)[:, None]
    assert (mesh.normals * normal).sum(axis=2) == pytest.approx(0.8, abs=FINE)
    assert np.array_equal(mesh.within, mesh.normals)
    # On the upper face of Blender's cube u grows towards −x or so: along one axis, in any case.
    above = normal[:, 0, 2] > 0.9
    tilt = mesh.normals[above].reshape(-1, 3)
    assert np.abs(tilt - tilt[0]).max() < FINE
    assert np.sort(np.abs(tilt[0])) == pytest.approx((0.0, 0.6, 0.8), abs=FINE)


RISE = (np.arange(64) + 0.5) / 64


def test_heights_of_an_image_are_those_of_its_map():
    """Renders leave no map of a mesh: it is read of the mesh before."""
    made = material()
    picture = painted(made, RISE)
    bump(made, picture.outputs["Color"], Distance=0.05)
    bpy.ops.mesh.primitive_plane_add(size=1.0)
    obj = bpy.context.object
    obj.data.materials.append(made)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    scenes.camera()
    prepared()
    mesh = seen()
    inner = np.abs(mesh.points[..., 0]) < 0.4
    wanted = np.array((-0.05, 0.0, 1.0)) / np.hypot(0.05, 1.0)
    assert np.abs(mesh.normals[inner] - wanted).max() < 2 * FINE


def test_an_image_that_is_painted_or_read_otherwise_is_looked_up_anew():
    """It stayed as it was when it was first rendered."""
    made = material()
    picture = painted(made, RISE)
    bump(made, picture.outputs["Color"], Distance=0.05)
    cube(made)
    first = seen()
    paint(picture.image, RISE**2)
    second = seen()
    assert second != first
    picture.image.colorspace_settings.name = "sRGB"
    assert seen() not in (first, second)


def test_heights_that_are_no_numbers_leave_unit_normals():
    """Rays met normals that were no numbers."""
    made = material()
    picture = painted(made, np.where(np.arange(64) % 3, RISE, np.nan))
    height = node(made, "Math")
    height.operation = "EXPONENT"
    factor = node(made, "Math")
    factor.operation = "MULTIPLY"
    factor.inputs[1].default_value = 1e4
    link(made, ramp(made), factor.inputs[0])
    link(made, factor.outputs[0], height.inputs[0])
    first = bump(made, height.outputs[0], Distance=0.2)
    bump(made, picture.outputs["Color"], Distance=0.2)
    link(made, first.outputs[0], made.node_tree.nodes[-1].inputs["Normal"])
    cube(made)
    mesh = seen()
    for normals in (mesh.normals, mesh.within):
        assert np.linalg.norm(normals, axis=2) == pytest.approx(1.0)


def test_scenes_that_share_a_material_have_its_bumps_whichever_is_ready():
    """The points of the scene that was not ready were found first: the glass was smooth."""
    made = material()
    waves = noise(made)
    bump(made, waves.outputs[0], Distance=0.03)
    obj = cube(made)
    one = bpy.context.scene
    two = bpy.data.scenes.new("Two")
    for shared in (obj, one.camera):
        two.collection.objects.link(shared)
    two.camera = one.camera
    two.refractive_glass.shading = "TRUE"
    for number, scene in enumerate((two, one, two)):
        waves.noise_dimensions = ("3D", "2D", "4D")[number]
        bpy.context.window.scene = scene
        depsgraph = scenes.depsgraph()
        door.prepare(scene, depsgraph)
        assert read_glasses(depsgraph)[0].description.within is not None


def test_many_small_bumped_meshes_are_kept_and_large_ones_are_let_go(monkeypatch):
    """A frame of more than six glasses of a material found the bumps of each anew."""
    made = material()
    bump(made, ramp(made), Distance=0.03)
    obj = cube(made)
    for number in range(1, 8):
        other = obj.copy()
        other.scale = (1.0 + number,) * 3
        bpy.context.scene.collection.objects.link(other)
    prepared()
    first, before = read_glasses(scenes.depsgraph()), counters["bumps"]
    assert [g.description for g in read_glasses(scenes.depsgraph())] == [
        g.description for g in first
    ]
    assert counters["bumps"] == before
    bumps._kept.clear()
    monkeypatch.setattr(bumps, "MOST_KEPT", 1)
    read_glasses(scenes.depsgraph())
    assert not bumps._kept


def test_what_is_kept_is_what_is_found_anew():
    made = material()
    found = noise(made)
    bump(made, found.outputs[0], Distance=0.03)
    obj = cube(made)
    first, before = seen(), counters["bumps"]
    place = obj.location.copy()
    obj.location.x += 1.0
    obj.rotation_euler = (0.1, 0.2, 0.3)
    moved = seen()
    assert counters["bumps"] == before
    bumps._kept.clear()
    assert seen() == moved
    assert counters["bumps"] == before + 1
    found.inputs["W"].default_value = 1.0
    assert seen() != moved
    found.inputs["W"].default_value = 0.0
    obj.location, obj.rotation_euler = place, (0.0, 0.0, 0.0)
    assert seen() == first


def test_a_frame_of_animated_bumps_is_the_frame_alone():
    made = material()
    found = noise(made)
    bump(made, found.outputs[0], Distance=0.03)
    cube(made)
    socket = found.inputs["W"]
    for frame, value in ((1, 0.0), (11, 5.0)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    scene = bpy.context.scene
    pictures = []
    for frame in (1, 5, 11, 5):
        scene.frame_set(frame)
        pictures.append(seen())
    assert pictures[1] == pictures[3]
    assert pictures[1] != pictures[0]
    bumps._kept.clear()
    assert seen() == pictures[1]


def test_instances_have_the_bumps_of_their_place():
    made = material()
    bump(made, noise(made).outputs[0], Distance=0.03)
    obj = cube(made)
    group = bpy.data.collections.new("Group")
    group.objects.link(obj)
    for collection in obj.users_collection:
        if collection != group:
            collection.objects.unlink(obj)
    for place in (0.0, 3.0):
        empty = bpy.data.objects.new("Place", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", group
        empty.location.x = place
        bpy.context.scene.collection.objects.link(empty)
    prepared()
    before = counters["bumps"]
    one, other = (glass.description for glass in read_glasses(scenes.depsgraph()))
    assert counters["bumps"] == before + 1
    assert one.within is not None
    assert np.array_equal(one.normals, other.normals)


def test_what_cannot_be_evaluated_is_told_by_name():
    made = material()
    bump(made, node(made, "Bevel").outputs[0])
    cube(made)
    told = door.status(bpy.context.scene).problems
    assert any('"Bumpy"' in line and "Bevel" in line for line in told)
    assert seen().within is None


def test_groups_reroutes_and_muted_nodes_lead_to_the_same_heights():
    plain = material("plain")
    bump(plain, noise(plain).outputs[0], Distance=0.03)
    obj = cube(plain)
    wanted = seen()
    bpy.data.objects.remove(obj)
    made = material("grouped")
    group = bpy.data.node_groups.new("Waves", "ShaderNodeTree")
    group.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Height", in_out="OUTPUT", socket_type="NodeSocketFloat")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    place, texture = (group.nodes.new(f"ShaderNode{n}") for n in ("TexCoord", "TexNoise"))
    texture.noise_dimensions = "4D"
    texture.inputs["Detail"].default_value = 0.0
    muted = group.nodes.new("ShaderNodeMath")
    muted.mute = True
    group.links.new(place.outputs["Object"], texture.inputs["Vector"])
    group.links.new(start.outputs["Scale"], texture.inputs["Scale"])
    group.links.new(texture.outputs[0], muted.inputs[0])
    group.links.new(muted.outputs[0], end.inputs["Height"])
    user = made.node_tree.nodes.new("ShaderNodeGroup")
    user.node_tree = group
    user.inputs["Scale"].default_value = 4.0
    dot = made.node_tree.nodes.new("NodeReroute")
    link(made, user.outputs[0], dot.inputs[0])
    bump(made, dot.outputs[0], Distance=0.03)
    cube(made)
    assert seen() == wanted


TEXTURES = ("Brick", "Checker", "Gradient", "Magic", "Noise", "Voronoi", "Wave", "WhiteNoise")


@pytest.mark.parametrize("kind", [*TEXTURES, "Gabor"])
def test_every_texture_can_be_evaluated(kind):
    made = material()
    texture = node(made, f"Tex{kind}")
    steps = node(made, "ValToRGB")
    mapped = node(made, "Mapping", Rotation=(0.1, 0.2, 0.3), Scale=(1.0, 2.0, 3.0))
    place = node(made, "TexCoord")
    link(made, place.outputs["Generated"], mapped.inputs["Vector"])
    link(made, mapped.outputs[0], texture.inputs["Vector"])
    link(made, texture.outputs[0], steps.inputs[0])
    bump(made, steps.outputs[0], Distance=0.01)
    obj = cube(made)
    assert unread(obj, 0) == []
    assert np.isfinite(seen().normals).all()


def test_what_bumps_need_is_hidden_freed_and_in_no_file(tmp_path):
    made = material()
    bump(made, noise(made).outputs[0])
    obj = cube(made)

    def mine():
        return [block for block in own_blocks() if own(block, FIELDS)]

    stood = mine()
    assert {block.id_type for block in stood} == {"OBJECT", "MESH", "NODETREE"}
    assert all(block.name.startswith(".") for block in stood)
    seen()
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    with bpy.data.libraries.load(path) as (inside, _):
        assert not [n for n in (*inside.objects, *inside.meshes) if FIELDS in n]
        assert not [n for n in inside.node_groups if FIELDS in n]
    # Another height asks for another tree; the old one goes.
    bump(made, sine(made))
    prepared()
    assert len(mine()) == len(stood)
    made.node_tree.nodes.remove(next(n for n in made.node_tree.nodes if n.type == "BSDF_GLASS"))
    prepared()
    assert mine() == []
    bpy.data.objects.remove(obj)
    prepared()
    assert own_blocks() == []


@pytest.mark.parametrize("coordinates", [("Object",), ("Generated",), ("Generated", "Object")])
def test_a_bumped_pane_shows_what_it_shows_in_cycles(tmp_path, coordinates):
    """It was smooth: 14 dB. By attributes it was turned round for rays from within."""
    made = material()
    heights = [noise(made, 3.0, name).outputs[0] for name in coordinates]
    both = node(made, "Math")
    for number, height in enumerate(heights):
        link(made, height, both.inputs[number])
    bump(made, both.outputs[0], Distance=0.05)
    for error in pane_beside_cycles(made, tmp_path):
        assert -10.0 * np.log10(error) > 26.0
