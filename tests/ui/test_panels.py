# SPDX-License-Identifier: GPL-3.0-or-later
"""What panels and menus draw, recorded by a layout that draws nothing."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from glass_refraction.scene import update as door
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.ui import bake, menus, operators, panels, presets

sys.path.insert(0, str(Path(__file__).parent))
from drawing import Layout, labels_of


def _glass(**values):
    bpy.ops.object.refractive_glass_add(**values)
    return bpy.context.object


@pytest.mark.parametrize(
    ("shape", "there", "missing"),
    [
        ("SLAB", {"Wall", "Behind"}, {"Radius", "Height"}),
        ("CYLINDER", {"Radius", "Wall", "Height", "Contents"}, set()),
        ("ROD", {"Radius", "Height"}, {"Wall", "Contents"}),
        ("SPHERE", {"Radius", "Wall", "Contents"}, {"Height"}),
    ],
)
def test_a_glass_shows_what_its_shape_uses(shape, there, missing):
    _glass(shape=shape)
    assert panels.OBJECT_PT_refractive_glass.poll(bpy.context)
    drawn = set(labels_of(panels.OBJECT_PT_refractive_glass))
    assert there | {"Shape", "IOR", "Seen Through", "Material", "Segments"} <= drawn
    assert not missing & drawn


def test_every_input_of_the_modifier_is_drawn_for_some_shape():
    drawn = set()
    for shape in ("SLAB", "CYLINDER", "ROD", "SPHERE", "TUMBLER", "REVOLUTION"):
        obj = _glass(shape=shape)
        drawn |= set(labels_of(panels.OBJECT_PT_refractive_glass))
    for item in glass_modifier(obj).node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and not item.hide_in_modifier:
            assert (
                panels._SHORT.get(item.name, item.name) in drawn
                or item.socket_type == "NodeSocketGeometry"
            )


def test_an_empty_glass_says_that_it_holds_air():
    obj = _glass(shape="TUMBLER")
    for level, empty in ((0.0, True), (0.05, False)):
        write_input(glass_modifier(obj), "Liquid Level", level)
        drawn = labels_of(panels.OBJECT_PT_refractive_glass)
        assert ("Empty: it holds air" in drawn) == empty


def test_a_quality_stands_for_settings_and_settings_tell_the_quality():
    settings = bpy.context.scene.refractive_glass
    assert settings.quality == "GOOD"
    for quality in ("DRAFT", "FINAL", "GOOD"):
        settings.quality = quality
        assert settings.quality == quality
    settings.min_weight = 0.02
    assert settings.quality == "CUSTOM"
    settings.quality = "CUSTOM"
    assert settings.min_weight == pytest.approx(0.02)
    assert {"quality", "min_weight"} <= set(labels_of(panels.RENDER_PT_refractive_glass))


def test_no_glass_no_glass_panel():
    bpy.ops.mesh.primitive_cube_add()
    assert not panels.OBJECT_PT_refractive_glass.poll(bpy.context)
    assert "Make Active a Glass" in labels_of(panels.VIEW3D_PT_refractive_glass_object)


def test_problems_are_shown_where_they_belong():
    obj = _glass()
    obj.name = "My Cup"
    write_input(glass_modifier(obj), "IOR", -1.0)
    scene = bpy.context.scene
    line = 'Glass "My Cup": the ior must be positive'
    door.status(scene).problems = [line, "another"]
    assert line in " ".join(labels_of(panels.OBJECT_PT_refractive_glass))
    assert "another" not in labels_of(panels.OBJECT_PT_refractive_glass)
    assert {"another"} <= set(labels_of(panels.RENDER_PT_refractive_glass))


def test_a_modifier_that_is_off_is_told():
    glass_modifier(_glass()).show_render = False
    assert "off in renders" in " ".join(labels_of(panels.OBJECT_PT_refractive_glass))


def test_status_says_what_the_last_update_did():
    door.status(bpy.context.scene).paths = ("TTTT", "TRT")
    drawn = " ".join(labels_of(panels.RENDER_PT_refractive_glass_status))
    for word in (
        "Vertices",
        "Computed in",
        "px",
        "TTTT: refracted 4 times",
        "TRT",
        "mirrored 1 times",
    ):
        assert word in drawn


def test_own_scenes_show_no_panels():
    bpy.context.scene["refractive_glass"] = "lookup"
    assert not panels.RENDER_PT_refractive_glass.poll(bpy.context)
    assert not panels.VIEW3D_PT_refractive_glass_object.poll(bpy.context)
    del bpy.context.scene["refractive_glass"]


def test_the_menu_offers_shapes_and_presets():
    shown = Layout()
    menus.VIEW3D_MT_refractive_glass_add.draw(type("_", (), {"layout": shown})(), bpy.context)
    assert {preset.label for preset in presets.PRESETS} <= set(shown.drawn)
    shapes = Layout()
    menus.VIEW3D_MT_refractive_glass_shapes.draw(type("_", (), {"layout": shapes})(), bpy.context)
    assert {"Slab", "Cylinder", "Rod", "Sphere", "Tumbler"} <= set(shapes.drawn)
    assert "VIEW3D_MT_refractive_glass_shapes" in shown.drawn


DEVELOPERS = re.compile(
    r"closed form|exit ray|capture|radiance|fresnel|vertices|weight|tolerance|depsgraph|solver"
    r"|socket|interface|bound|path|px\b|\bms\b",
    re.I,
)
"""Words that only a developer knows."""


def test_words_of_developers_are_folded_away():
    scene = bpy.context.scene
    shapes = [item[0] for item in operators.SHAPES]
    said = set()
    for shading in ("TRUE", "DISPLACED"):
        scene.refractive_glass.shading = shading
        door.status(scene).covered = 7 if shading == "TRUE" else 0
        door.status(scene).paths = () if shading == "TRUE" else ("TTTT",)
        for shape in shapes:
            _glass(shape=shape)
            for panel in panels.CLASSES:
                if panel is not panels.RENDER_PT_refractive_glass_bake:
                    said.update(labels_of(panel, folded=True))
    menu = Layout()
    menus.VIEW3D_MT_refractive_glass_add.draw(type("_", (), {"layout": menu})(), bpy.context)
    said.update(label for label in menu.drawn if not label.startswith("VIEW3D"))
    assert [text for text in said if DEVELOPERS.search(text)] == []
    assert DEVELOPERS.search(" ".join(labels_of(panels.RENDER_PT_refractive_glass_status)))


def test_what_is_baked_is_told_in_lines_that_fit(monkeypatch):
    told = SimpleNamespace(frames="1-24", directory="//" + 9 * "long/", first=2, last=24)
    monkeypatch.setattr(bake, "baked", lambda _scene: told)
    shown = Layout()
    bake.draw(shown, bpy.context)
    assert "Frame 1 shows frame 2" in " ".join(shown.drawn)


def test_a_mesh_whose_faces_a_view_hides_is_checked_unless_modifiers_change_it():
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.data.flip_normals()
    bpy.ops.object.refractive_glass_modifier_add()
    write_input(glass_modifier(obj), "Edges in Viewport", True)
    wrong, unchecked = "Inside out", "Switch Refracted Picture off"
    said = " ".join(labels_of(panels.OBJECT_PT_refractive_glass))
    assert wrong in said and unchecked not in said
    obj.modifiers.new("Bevel", "BEVEL")
    said = " ".join(labels_of(panels.OBJECT_PT_refractive_glass))
    assert wrong not in said and unchecked in said


def test_what_is_opaque_of_a_hidden_mesh_is_named_and_taken_for_no_open_glass():
    """A label that a view shows without its glass was checked as though it were all."""
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    for name, kind in (("Clear", "ShaderNodeBsdfGlass"), ("Paper", "ShaderNodeBsdfDiffuse")):
        material = bpy.data.materials.new(name)
        tree = material.node_tree
        shader = tree.nodes.new(kind)
        tree.links.new(shader.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
        obj.data.materials.append(material)
    obj.data.polygons[0].material_index = 1
    bpy.ops.object.refractive_glass_modifier_add()
    bpy.context.view_layer.update()
    write_input(glass_modifier(obj), "Edges in Viewport", True)
    bpy.context.view_layer.update()
    said = " ".join(labels_of(panels.OBJECT_PT_refractive_glass))
    assert 'Faces of "Paper" are no glass' in said
    assert "Open" not in said and "Normals disagree" not in said
