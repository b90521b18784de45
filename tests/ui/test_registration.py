# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators are described; the asset library comes and goes by its button; translations fit."""

import string
from pathlib import Path

import bpy
import pytest

import glass_refraction
from glass_refraction.scene.names import NODE_GROUPS
from glass_refraction.scene.read.modifier_inputs import glass_modifier
from glass_refraction.ui import asset_library, translations
from glass_refraction.ui.presets import PRESETS

OPERATORS = (
    bpy.ops.object.refractive_glass_add,
    bpy.ops.object.refractive_glass_everyday_add,
    bpy.ops.object.refractive_glass_modifier_add,
    bpy.ops.scene.refractive_glass_update,
    bpy.ops.scene.refractive_glass_compare,
    bpy.ops.scene.refractive_glass_bake,
    bpy.ops.scene.refractive_glass_bake_free,
    bpy.ops.scene.refractive_glass_starter,
    bpy.ops.preferences.refractive_glass_asset_library_add,
    bpy.ops.preferences.refractive_glass_asset_library_remove,
)
PLAIN = {"rna_type", "align", "location", "rotation"}


def test_every_operator_and_property_has_a_name_and_a_description():
    labels = set()
    for operator in OPERATORS:
        kind = operator.get_rna_type()
        assert kind.description, kind.identifier
        labels.add(kind.name)
        for prop in kind.properties:
            if prop.identifier not in PLAIN:
                assert prop.name and prop.description, (kind.identifier, prop.identifier)
    assert len(labels) == len(OPERATORS)


def test_lengths_have_units():
    for operator in (OPERATORS[0], OPERATORS[2]):
        properties = operator.get_rna_type().properties
        for name in ("radius", "wall_thickness", "height"):
            assert properties[name].unit == "LENGTH"


def test_settings_have_descriptions():
    kind = type(bpy.context.scene.refractive_glass).bl_rna
    for prop in kind.properties:
        if prop.identifier not in {"rna_type", "name"}:
            assert prop.description, prop.identifier


def _library_paths():
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return [Path(library.path) for library in libraries]


def test_the_asset_library_is_only_there_when_asked_for():
    before = _library_paths()
    assert NODE_GROUPS.parent not in before
    assert bpy.ops.preferences.refractive_glass_asset_library_add() == {"FINISHED"}
    assert {NODE_GROUPS.parent, asset_library.everyday_folder()} <= set(_library_paths())
    assert not bpy.ops.preferences.refractive_glass_asset_library_add.poll()
    assert bpy.ops.preferences.refractive_glass_asset_library_remove() == {"FINISHED"}
    assert _library_paths() == before
    assert not asset_library.everyday_folder().exists()
    assert not bpy.ops.preferences.refractive_glass_asset_library_remove.poll()


def test_the_asset_library_goes_with_the_extension():
    before = _library_paths()
    bpy.ops.preferences.refractive_glass_asset_library_add()
    glass_refraction.unregister()
    try:
        assert _library_paths() == before
    finally:
        glass_refraction.register()
    assert not asset_library.find_libraries()


def test_other_libraries_stay(tmp_path):
    libraries = bpy.context.preferences.filepaths.asset_libraries
    mine = libraries.new(name="Refractive Glass", directory=str(tmp_path))
    bpy.ops.preferences.refractive_glass_asset_library_add()
    bpy.ops.preferences.refractive_glass_asset_library_remove()
    assert tmp_path in _library_paths()
    libraries.remove(mine)


def test_the_library_holds_the_modifier():
    with bpy.data.libraries.load(str(NODE_GROUPS), assets_only=True) as (available, _):
        assert list(available.node_groups) == ["Refractive Glass"]


def test_everyday_glasses_are_assets_with_previews_and_the_file_is_as_it_was():
    objects = set(bpy.data.objects)
    bpy.ops.preferences.refractive_glass_asset_library_add()
    assert set(bpy.data.objects) == objects
    (path,) = asset_library.everyday_folder().glob("*.blend")
    with bpy.data.libraries.load(str(path), assets_only=True) as (found, wanted):
        names = {*found.objects, *found.collections}
        wanted.objects, wanted.collections = found.objects, found.collections
    assert names == {preset.label for preset in PRESETS}
    for asset in (*wanted.objects, *wanted.collections):
        assert asset.asset_data.license == "CC0"
        assert max(asset.preview.image_pixels_float) > 0.0
        glasses = [asset] if isinstance(asset, bpy.types.Object) else list(asset.all_objects)
        assert any(o.type == "MESH" and glass_modifier(o) is not None for o in glasses)
    bpy.ops.preferences.refractive_glass_asset_library_remove()


def test_a_library_that_cannot_be_written_is_told_and_none_is_listed(monkeypatch, tmp_path):
    (tmp_path / "taken").write_text("no folder")
    monkeypatch.setattr(asset_library, "everyday_folder", lambda: tmp_path / "taken" / "assets")
    with pytest.raises(RuntimeError, match="could not be written"):
        bpy.ops.preferences.refractive_glass_asset_library_add()
    assert not asset_library.find_libraries()


def test_translations_take_the_same_values():
    def fields(text):
        return [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]

    for messages in translations.MESSAGES.values():
        for (_, english), translated in messages.items():
            assert fields(english) == fields(translated), english


def test_translated_messages_are_in_use():
    package = Path(glass_refraction.__file__).parent
    source = "".join(p.read_text(encoding="utf-8") for p in (package / "ui").glob("*.py"))
    here = (package / "ui" / "translations.py").read_text(encoding="utf-8")
    sockets = {"Seen Through", "Priority"}  # of the node group
    for messages in translations.MESSAGES.values():
        for _, english in messages:
            written = english.replace('"', '\\"')
            elsewhere = source.count(english) + source.count(written)
            inside = here.count(english) + here.count(written)
            assert english in sockets or elsewhere > inside, english
