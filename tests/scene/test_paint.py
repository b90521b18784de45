# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours and roughness of glasses that are meshes, from place to place: laws, and Cycles."""

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
from glass_refraction.scene.memory import counters
from glass_refraction.scene.read import bumps
from glass_refraction.scene.read.bumps import bumping, surface_stamp
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.material_fields import UV_MAP
from glass_refraction.scene.read.mesh_corners import corners_of
from glass_refraction.scene.read.modifier_inputs import glass_modifier
from glass_refraction.scene.read.paint import paint_on
from glass_refraction.scene.read.unread import unread

MIDDLE = np.full(3, 1.0 / 3.0)
EXACT = 1e-5
"""Of colours: single precision."""


@pytest.fixture(autouse=True)
def nothing_kept():
    bumps._kept.clear()


def middles(mesh):
    """Of each triangle the middle, and what the paint is there."""
    count = len(mesh.points)
    finish = mesh.paint.at(np.arange(count), np.tile(MIDDLE, (count, 1)))
    return mesh.points.mean(axis=1), finish


def by_place(made, name, coordinate="Object"):
    """Have a colour be a place."""
    link(made, node(made, "TexCoord").outputs[coordinate], glass_of(made).inputs[name])


def test_a_plain_material_has_no_paint():
    made = material()
    cube(made)
    assert seen().paint is None
    # What leads nowhere, and what is muted, is plain too.
    by_place(made, "Color")
    next(k for k in made.node_tree.links if k.to_socket.name == "Color").is_muted = True
    prepared()
    assert seen().paint is None


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -0.8, 1.9)])
def test_a_colour_that_is_a_place_is_that_place(turn):
    made = material()
    by_place(made, "Color")
    obj = cube(made, scale=(2.0, 1.0, 0.5), turn=turn)
    places, finish = middles(seen())
    inward = np.linalg.inv(np.array(obj.matrix_world))
    local = np.clip(places @ inward[:3, :3].T + inward[:3, 3], 0.0, 1.0)
    assert np.abs(finish[:, 1:4] - local).max() < EXACT
    assert np.array_equal(finish[:, 1:4], finish[:, 4:])
    assert (finish[:, 0] == 0.0).all() and seen().roughness == 0.0


def test_a_principled_colour_passes_a_surface_by_its_root():
    made = material()
    tree = made.node_tree
    shader = node(made, "BsdfPrincipled", Roughness=0.0)
    shader.inputs["Transmission Weight"].default_value = 1.0
    tree.links.new(shader.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
    tree.nodes.remove(glass_of(made))
    link(made, node(made, "TexCoord").outputs["Generated"], shader.inputs["Base Color"])
    shader.inputs["Specular Tint"].default_value = (0.9, 0.6, 0.3, 1.0)
    cube(made)
    mesh = seen()
    places, finish = middles(mesh)
    low, high = mesh.points.min(axis=(0, 1)), mesh.points.max(axis=(0, 1))
    generated = (places - low) / (high - low)
    assert np.abs(finish[:, 1:4] ** 2 - generated).max() < EXACT
    assert np.abs(finish[:, 4:] - (0.9, 0.6, 0.3)).max() < EXACT


def test_textured_roughness_is_the_texture():
    made = material()
    by_place(made, "Roughness", "Generated")
    glass_of(made).inputs["Color"].default_value = (0.2, 0.4, 0.6, 1.0)
    cube(made)
    mesh = seen()
    places, finish = middles(mesh)
    low, high = mesh.points.min(axis=(0, 1)), mesh.points.max(axis=(0, 1))
    # A vector counts as a number by its mean.
    assert np.abs(finish[:, 0] - ((places - low) / (high - low)).mean(axis=1)).max() < EXACT
    assert np.abs(finish[:, 1:4] - (0.2, 0.4, 0.6)).max() < EXACT
    assert mesh.roughness > 0.0


def test_nodes_that_are_the_same_everywhere_are_evaluated_once():
    made = material()
    colour = node(made, "RGB")
    colour.outputs[0].default_value = (0.3, 0.6, 0.9, 1.0)
    link(made, colour.outputs[0], glass_of(made).inputs["Color"])
    cube(made)
    mesh = seen()
    before = counters["field_points"]
    _, finish = middles(mesh)
    assert counters["field_points"] == before
    assert np.abs(finish[:, 1:4] - (0.3, 0.6, 0.9)).max() < EXACT
    colour.outputs[0].default_value = (0.1, 0.6, 0.9, 1.0)
    made.node_tree.update_tag()
    assert seen() != mesh


def test_an_image_is_looked_up_on_the_map_that_modifiers_leave():
    """Renders leave no map of a mesh: it was lost where a modifier changed the mesh."""
    made = material()
    picture = painted(made, np.linspace(0.0, 1.0, 64))
    link(made, picture.outputs["Color"], glass_of(made).inputs["Color"])
    bpy.ops.mesh.primitive_plane_add(size=2.0)
    obj = bpy.context.object
    obj.data.materials.append(made)
    divided = obj.modifiers.new("Fine", "SUBSURF")
    divided.subdivision_type = "SIMPLE"
    divided.levels = divided.render_levels = 2
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    scenes.camera()
    prepared()
    mesh = seen()
    assert len(mesh.points) == 32
    places, finish = middles(mesh)
    wanted = 0.5 * (places[:, 0] + 1.0)
    assert np.abs(finish[:, 1] - wanted).max() < 1.0 / 64.0
    first = seen()
    paint(picture.image, np.linspace(1.0, 0.0, 64))
    assert seen() != first


def two_colours(made):
    """A cube of two glassy materials, the second on its upper face."""
    other = material("Red")
    glass_of(other).inputs["Color"].default_value = (1.0, 0.2, 0.1, 1.0)
    obj = cube(made)
    obj.data.materials.append(other)
    above = max(obj.data.polygons, key=lambda face: face.center.z)
    above.material_index = 1
    obj.data.update()
    prepared()
    return obj, other


def test_each_face_has_the_colours_of_its_own_material():
    """All faces had those of the first."""
    made = material()
    obj, other = two_colours(made)
    places, finish = middles(seen())
    above = places[:, 2] > places[:, 2].max() - 1e-6
    assert above.sum() == 2
    assert np.abs(finish[above, 1:4] - (1.0, 0.2, 0.1)).max() < EXACT
    assert (finish[~above, 1:4] == 1.0).all()
    assert unread(obj, 0) == []
    # Of a plain colour that is changed the 3D view asks anew.
    place = np.array(obj.matrix_world)
    before = surface_stamp(obj, scenes.depsgraph(), place)
    assert before == surface_stamp(obj, scenes.depsgraph(), place)
    glass_of(other).inputs["Color"].default_value = (0.1, 0.2, 1.0, 1.0)
    assert before != surface_stamp(obj, scenes.depsgraph(), place)
    # A mesh has one ior.
    glass_of(other).inputs["IOR"].default_value = 1.7
    assert any("P > By Material" in line for line in unread(obj, 0))


def test_corners_of_small_triangles_have_what_is_there():
    """What the 3D view draws: colours interpolated between corners."""
    made = material()
    texture = node(made, "TexNoise", Scale=2.0, Detail=0.0)
    link(made, node(made, "TexCoord").outputs["Object"], texture.inputs["Vector"])
    link(made, texture.outputs["Color"], glass_of(made).inputs["Color"])
    obj, _ = two_colours(made)
    depsgraph = scenes.depsgraph()
    evaluated, corners = obj.evaluated_get(depsgraph), corners_of(obj.data)
    place = np.array(obj.matrix_world)
    found = paint_on(evaluated, depsgraph, corners, place, {})
    steps = bumping(evaluated, depsgraph, corners, place, {}, found)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            small = end.value
            break
    assert len(small.points) > 1000 and small.within is None
    parts = found.in_parts(small.source)
    count = len(small.points)
    for number in range(3):
        exact = parts.at(np.arange(count), np.tile(np.eye(3)[number], (count, 1)))
        assert np.abs(exact - small.finish[:, number]).max() < 1e-4
    exact = parts.at(np.arange(count), np.tile(MIDDLE, (count, 1)))
    assert np.quantile(np.abs(exact - small.finish.mean(axis=1)), 0.99) < 0.03
    # A face of another colour keeps it to its edge.
    red = small.slots == 1
    assert np.abs(small.finish[red, :, 1:4] - (1.0, 0.2, 0.1)).max() < EXACT


def test_a_frame_of_animated_paint_is_the_frame_alone(tmp_path):
    made = material()
    texture = node(made, "TexNoise", Detail=0.0)
    link(made, node(made, "TexCoord").outputs["Object"], texture.inputs["Vector"])
    link(made, texture.outputs["Color"], glass_of(made).inputs["Color"])
    texture.inputs["Scale"].default_value = 1.0
    texture.inputs["Scale"].keyframe_insert("default_value", frame=1)
    texture.inputs["Scale"].default_value = 6.0
    texture.inputs["Scale"].keyframe_insert("default_value", frame=3)
    cube(made)
    scenes.striped_wall(distance=2.0, size=6.0)
    scene = scenes.settings(width=32, height=24, samples=2, shading="TRUE", surface="GLASS")
    scene.frame_set(1)
    first = scenes.picture(scene, tmp_path, "first")
    scene.frame_set(3)
    after = scenes.picture(scene, tmp_path, "after")
    door.forget(scene)
    alone = scenes.picture(scene, tmp_path, "alone")
    assert np.array_equal(after, alone)
    assert np.abs(after - first).max() > 0.01


@pytest.mark.parametrize("rough", [False, True])
def test_a_painted_pane_shows_what_it_shows_in_cycles(tmp_path, rough):
    """It was clear, or of one colour: 12 dB."""
    made = material()
    texture = node(made, "TexNoise", Scale=3.0, Detail=1.0)
    link(made, node(made, "TexCoord").outputs["Object"], texture.inputs["Vector"])
    link(made, texture.outputs["Color"], glass_of(made).inputs["Color"])
    if rough:
        steps = node(made, "MapRange")
        steps.inputs["From Min"].default_value, steps.inputs["From Max"].default_value = 0.45, 0.55
        steps.inputs["To Max"].default_value = 0.3
        link(made, texture.outputs[0], steps.inputs[0])
        link(made, steps.outputs[0], glass_of(made).inputs["Roughness"])
    for error in pane_beside_cycles(made, tmp_path):
        assert -10.0 * np.log10(error) > 30.0


def test_what_is_behind_colours_and_unknown_is_told_by_name():
    made = material()
    link(made, node(made, "Wireframe").outputs[0], glass_of(made).inputs["Color"])
    link(made, node(made, "TexNoise").outputs[0], glass_of(made).inputs["Roughness"])
    obj = cube(made)
    told = door.status(bpy.context.scene).problems
    assert any('"Bumpy"' in line and "as Color: Wireframe" in line for line in told)
    # What is known counts all the same.
    assert seen().paint is not None
    assert not any("Roughness" in line for line in unread(obj, 0))


def test_an_image_whose_file_is_missing_is_told():
    """It was black, and nothing said why."""
    made = material()
    picture = painted(made, np.ones(64))
    picture.image.source, picture.image.filepath = "FILE", "//nowhere.png"
    picture.image.reload()
    link(made, picture.outputs["Color"], glass_of(made).inputs["Color"])
    obj = cube(made)
    (line,) = unread(obj, 0)
    assert "as Color: Image Texture whose file is missing" in line
    assert seen().paint is None


@pytest.mark.parametrize("kind", ["MixShader", "AddShader"])
def test_a_shader_that_is_mixed_with_another_is_told(kind):
    """Of two glasses that a texture mixes the first was all that was seen, without a word."""
    made = material()
    mix, other = node(made, kind), node(made, "BsdfGlass")
    link(made, glass_of(made).outputs[0], mix.inputs[-2])
    link(made, other.outputs[0], mix.inputs[-1])
    link(made, mix.outputs[0], made.node_tree.get_output_node("ALL").inputs["Surface"])
    obj = cube(made)
    (line,) = unread(obj, 0)
    assert f'all "{glass_of(made).name}": {mix.bl_label} does not count' in line
    # Light that lamps send let through, as many do.
    node(made, "LightPath")
    assert unread(obj, 0) == []


def test_a_modifier_of_an_older_version_is_told_where_it_matters():
    """As one that is linked, which stays as its file has it: the corners it hides have no places
    on UV maps."""
    made = material()
    obj = cube(made)
    group = glass_modifier(obj).node_group
    group.interface.remove(group.interface.items_tree[UV_MAP])
    assert unread(obj, 0) == []
    by_place(made, "Color", "UV")
    (line,) = unread(obj, 0)
    assert "older version" in line


def test_instances_have_paint_of_their_own_place():
    """By the world's coordinates it is another one in each place."""
    made = material()
    place = node(made, "NewGeometry")
    link(made, place.outputs["Position"], glass_of(made).inputs["Color"])
    obj = cube(made)
    empty = bpy.data.objects.new("Instances", None)
    bpy.context.scene.collection.objects.link(empty)
    collection = bpy.data.collections.new("Instanced")
    collection.objects.link(obj)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location = (0.3, 0.2, 0.1)
    prepared()
    glasses = read_glasses(scenes.depsgraph())
    assert len(glasses) == 2
    for glass in glasses:
        places, finish = middles(glass.description)
        assert np.abs(finish[:, 1:4] - np.clip(places, 0.0, 1.0)).max() < EXACT
