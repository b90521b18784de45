# SPDX-License-Identifier: GPL-3.0-or-later
"""The adding operators: sizes taken, presets, media, and bad values that change nothing."""

import math

import bpy
import numpy as np
import pytest

from glass_refraction.optics import MEDIA
from glass_refraction.scene.read.glasses import read_glass
from glass_refraction.scene.read.mesh_glasses import open_edges
from glass_refraction.scene.read.modifier_inputs import glass_modifier, read_input, write_input
from glass_refraction.scene.read.orientation import orientation_of
from glass_refraction.ui import icons, media
from glass_refraction.ui.everyday import fitting_size
from glass_refraction.ui.presets import PRESETS


def _inputs(obj, *names):
    return [read_input(glass_modifier(obj), name) for name in names]


def _extent(objects):
    """Lowest and highest place (2, 3) of the objects' evaluated meshes, in the world."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    places = [
        obj.matrix_world @ vertex.co
        for obj in objects
        for vertex in obj.evaluated_get(depsgraph).data.vertices
    ]
    return np.array((np.min(places, axis=0), np.max(places, axis=0)))


@pytest.mark.parametrize("size", [0.0, 2.0])
@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.label)
def test_each_preset_is_a_glass_of_its_size_that_stands_where_it_was_put(preset, size):
    place = (1.0, 2.0, 3.0)
    ended = bpy.ops.object.refractive_glass_everyday_add(
        kind=preset.identifier, size=size, location=place
    )
    assert ended == {"FINISHED"}
    glasses = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    assert len(glasses) == len(preset.parts)
    assert bpy.context.object.name == preset.label
    assert [obj for obj in glasses if obj.select_get()] == [bpy.context.object]
    low, high = _extent(glasses)
    assert np.max(high - low) == pytest.approx(size or preset.size, rel=2e-3)
    assert low[2] == pytest.approx(place[2], abs=1e-3 * (size or preset.size))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for obj, part in zip(sorted(glasses, key=lambda o: o.name), preset.parts, strict=True):
        found = read_glass(obj, depsgraph).description
        assert np.ravel(found.ior)[0] == pytest.approx(part.values["ior"])
        if part.vertices is not None:
            mesh = obj.evaluated_get(depsgraph).data
            assert open_edges(mesh) == (0, 0)
            assert orientation_of(mesh).is_right
        elif part.values["shape"] in {"TUMBLER", "REVOLUTION"}:
            level = (size or preset.size) / preset.size * part.values["liquid_level"]
            assert (found.level or 0.0) == pytest.approx(level, rel=1e-5)


def test_each_glass_is_in_the_menu_once():
    labels = [preset.label for preset in PRESETS]
    assert len(set(labels)) == len(labels)
    everyday = "Tumbler, Glass of Water, Wine Glass, Mug, Bottle, Vase, Fish Bowl, Window Pane"
    everyday += ", Double Glazing, Lens, Crystal Ball, Aquarium"
    assert set(everyday.split(", ")) <= set(labels)


def test_a_glass_keeps_its_real_size_in_a_room_and_fits_what_is_selected_elsewhere():
    def size(of, real):
        bpy.ops.mesh.primitive_cube_add(size=of)
        return fitting_size(bpy.context, real)

    assert size(0.3, 0.1) == 0.1
    assert size(0.05, 0.1) == 0.1
    # As large as what is selected, or up to two and a half times smaller.
    for of in (2.0, 30.0, 0.01):
        assert of / 2.5 <= size(of, 0.1) <= of
    bpy.ops.object.select_all(action="DESELECT")
    assert fitting_size(bpy.context, 0.1) == 0.1


def test_a_size_that_is_no_length_adds_nothing():
    before = _everything()
    with pytest.raises(RuntimeError, match="give a length"):
        bpy.ops.object.refractive_glass_everyday_add(size=1e9)
    assert _everything() == before


def test_a_glass_takes_the_size_of_its_mesh():
    bpy.ops.mesh.primitive_cylinder_add(radius=0.3, depth=0.5)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="CYLINDER") == {"FINISHED"}
    radius, height = _inputs(bpy.context.object, "Radius", "Height")
    assert (radius, height) == pytest.approx((0.3, 0.5), rel=1e-3)


def test_values_that_are_given_are_kept():
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3)
    bpy.ops.object.refractive_glass_modifier_add(shape="SPHERE", radius=0.1)
    radius, wall = _inputs(bpy.context.object, "Radius", "Wall Thickness")
    assert radius == pytest.approx(0.1)
    assert 0 < wall < 0.1


def test_a_tiny_mesh_gets_a_wall_that_fits():
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.002)
    bpy.ops.object.refractive_glass_modifier_add(shape="SPHERE")
    read_glass(bpy.context.object, bpy.context.evaluated_depsgraph_get())


@pytest.mark.parametrize("name", MEDIA)
def test_a_medium_sets_the_number_and_the_number_names_the_medium(name):
    bpy.ops.object.refractive_glass_add(shape="CYLINDER", ior=1.2345)
    obj = bpy.context.object
    assert obj.refractive_glass_medium == media.CUSTOM
    obj.refractive_glass_medium = obj.refractive_glass_contents = media.medium_identifier(name)
    assert _inputs(obj, "IOR", "Contents IOR") == pytest.approx([MEDIA[name]] * 2)
    assert obj.refractive_glass_medium == media.medium_identifier(name)
    write_input(glass_modifier(obj), "IOR", 1.2345)
    assert obj.refractive_glass_medium == media.CUSTOM
    obj.refractive_glass_contents = media.CUSTOM
    assert _inputs(obj, "Contents IOR") == pytest.approx([MEDIA[name]])


def test_the_operator_takes_a_medium_by_name():
    bpy.ops.object.refractive_glass_add(medium="DIAMOND", contents="WATER", ior=1.1)
    found = _inputs(bpy.context.object, "IOR", "Contents IOR")
    assert found == pytest.approx([MEDIA["Diamond"], MEDIA["Water"]])


def test_media_have_names_of_their_own():
    assert len({item[0] for item in media.MEDIUM_ITEMS}) == len(MEDIA) + 1


BAD = [
    {"radius": 0.0},
    {"radius": -1.0},
    {"radius": math.nan},
    {"radius": math.inf},
    {"radius": 1e-9, "wall_thickness": 1e-10},
    {"wall_thickness": 0.0},
    {"radius": 0.04, "wall_thickness": 0.04},
    {"wall_thickness": math.nan},
    {"height": -1.0},
    {"height": math.nan},
    {"ior": 0.0},
    {"ior": -1.5},
    {"ior": math.nan},
    {"ior": math.inf},
    {"contents_ior": 0.0},
    {"contents_ior": math.nan},
    {"shape": "SLAB", "radius": math.nan},
    {"shape": "SLAB", "radius": 0.0},
    {"shape": "SLAB", "wall_thickness": 0.0},
    {"shape": "SPHERE", "wall_thickness": -1.0},
    {"shape": "ROD", "height": math.inf},
]


def _everything():
    kinds = (p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION")
    return {kind: sorted(b.name for b in getattr(bpy.data, kind)) for kind in kinds}


@pytest.mark.parametrize("values", BAD, ids=str)
def test_bad_values_add_nothing_and_say_one_line(values):
    before = _everything()
    with pytest.raises(RuntimeError) as error:
        bpy.ops.object.refractive_glass_add(**values)
    assert len(str(error.value).strip().splitlines()) == 1
    assert _everything() == before


def test_the_least_length_that_is_told_is_taken():
    before = len(bpy.data.objects)
    bpy.ops.object.refractive_glass_add(shape="CYLINDER", wall_thickness=1e-6)
    assert len(bpy.data.objects) == before + 1


OF_A_MESH = [v for v in BAD if v.get("shape") != "SLAB" or "radius" not in v]
"""A slab's outline is its mesh, whatever the radius."""


@pytest.mark.parametrize("values", OF_A_MESH, ids=str)
def test_bad_values_leave_the_object_as_it_is(values):
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.name = "My Pane"
    before = _everything()
    with pytest.raises(RuntimeError, match="My Pane"):
        bpy.ops.object.refractive_glass_modifier_add(**{"shape": "CYLINDER", **values})
    assert _everything() == before
    assert len(bpy.context.object.modifiers) == 0


def test_random_values_are_a_glass_or_one_line():
    random = np.random.default_rng(8)
    extremes = [0.0, -0.0, 1e-30, 1e-6, 1e-3, 1.0, 1.5, 1e3, 1e6, 1e30, -1.0, math.nan, math.inf]
    fields = ("radius", "wall_thickness", "height", "ior", "contents_ior")
    made = 0
    for _ in range(150):
        shape = str(random.choice(["SLAB", "CYLINDER", "ROD", "SPHERE"]))
        values = {name: float(random.choice(extremes)) for name in fields}
        count = len(bpy.data.objects)
        try:
            bpy.ops.object.refractive_glass_add(shape=shape, **values)
        except RuntimeError as error:
            assert len(str(error).strip().splitlines()) == 1
            assert len(bpy.data.objects) == count
            continue
        made += 1
        read_glass(bpy.context.object, bpy.context.evaluated_depsgraph_get())
    assert made > 3


def _curve():
    bpy.ops.curve.primitive_bezier_circle_add()


def _in_edit_mode():
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")


def _already_a_glass():
    bpy.ops.object.refractive_glass_add()


def _nothing():
    bpy.context.view_layer.objects.active = None


def _no_face():
    mesh = bpy.data.meshes.new("Empty")
    obj = bpy.data.objects.new("Empty", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj


def _bent():
    bpy.ops.mesh.primitive_cube_add()


@pytest.mark.parametrize(
    ("make", "shape", "words"),
    [
        (_curve, "CYLINDER", "mesh object"),
        (_nothing, "CYLINDER", "mesh object"),
        (_in_edit_mode, "CYLINDER", "Object Mode"),
        (_already_a_glass, "CYLINDER", "already"),
        (_no_face, "SLAB", "not flat"),
        (_bent, "SLAB", "not flat"),
    ],
)
def test_wrong_objects_and_modes_are_told(make, shape, words):
    make()
    before = _everything()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.object.refractive_glass_modifier_add(shape=shape)
    assert _everything() == before
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_linked_objects_stay_as_they_are(tmp_path):
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.name = "Borrowed"
    library = tmp_path / "library.blend"
    bpy.data.libraries.write(str(library), {bpy.context.object})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Borrowed"]
    bpy.context.collection.objects.link(wanted.objects[0])
    bpy.context.view_layer.objects.active = wanted.objects[0]
    with pytest.raises(RuntimeError, match=r"Borrowed.*make it local"):
        bpy.ops.object.refractive_glass_modifier_add(shape="SLAB")


def test_a_linked_collection_takes_no_glass(tmp_path):
    borrowed = bpy.data.collections.new("Borrowed")
    library = tmp_path / "library.blend"
    bpy.data.libraries.write(str(library), {borrowed})
    bpy.data.collections.remove(borrowed)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.collections = ["Borrowed"]
    bpy.context.scene.collection.children.link(wanted.collections[0])
    layer = bpy.context.view_layer
    layer.active_layer_collection = layer.layer_collection.children["Borrowed"]
    before = _everything()
    with pytest.raises(RuntimeError, match=r"Borrowed.*linked"):
        bpy.ops.object.refractive_glass_add()
    assert _everything() == before


def test_a_glass_in_edit_mode_can_be_read():
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.refractive_glass_modifier_add(shape="MESH")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    before = read_glass(bpy.context.object, depsgraph).description.box
    bpy.ops.object.mode_set(mode="EDIT")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert np.array_equal(read_glass(bpy.context.object, depsgraph).description.box, before)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_each_glass_has_an_icon_and_no_icon_is_left_over():
    files = {path.stem.upper() for path in icons.FOLDER.glob("*.png")}
    assert files == {preset.identifier for preset in PRESETS}
    assert set(icons._kept["glasses"]) == files


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.label)
def test_each_preset_is_shown_by_few_lines_where_a_view_shows_what_is_seen_through_it(preset):
    """Blender draws all points of a mesh without lines: smooth bottles and vases were black."""
    bpy.ops.object.refractive_glass_everyday_add(kind=preset.identifier)
    glasses = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    for obj in glasses:
        write_input(glass_modifier(obj), "Edges in Viewport", True)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for obj in glasses:
        mesh = obj.evaluated_get(depsgraph).data
        assert 0 < len(mesh.edges) < 2000
        assert not mesh.polygons
