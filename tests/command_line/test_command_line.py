# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m glass_refraction``: results, and one line with exit status 2 on bad input."""

import sys
from pathlib import Path

import bpy
import pytest

from glass_refraction.cli import main
from glass_refraction.scene.bake_playback import baked

sys.path.insert(0, str(Path(__file__).parent.parent / "scene"))
import scenes


@pytest.fixture
def still_life(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    scenes.settings(64, 48, samples=1, surface="REFRACTION", shading="DISPLACED")
    return tmp_path / "still life.blend"


def _save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return str(path)


def test_render_writes_the_picture(still_life, tmp_path):
    out = tmp_path / "deeper" / "out.png"
    assert main(["render", _save(still_life), "-o", str(out)]) == 0
    assert tuple(bpy.data.images.load(str(out)).size) == (64, 48)


def test_render_a_range_of_frames(still_life, tmp_path):
    assert (
        main(["render", _save(still_life), "-o", str(tmp_path / "f.png"), "--frames", "3-4"]) == 0
    )
    assert {p.name for p in tmp_path.glob("f*.png")} == {"f0003.png", "f0004.png"}


def test_regions(still_life, tmp_path):
    out = tmp_path / "map.png"
    assert main(["render", _save(still_life), "-o", str(out), "--regions"]) == 0
    assert out.is_file()


def test_bake_writes_a_file_that_plays_its_frames_back(still_life, tmp_path, capsys):
    out = tmp_path / "farm" / "baked.blend"
    arguments = ["bake", _save(still_life), "-o", str(out), "--frames", "2-3"]
    assert main([*arguments, "--folder", str(tmp_path / "farm" / "frames")]) == 0
    assert "frames 2-3" in capsys.readouterr().out
    bpy.ops.wm.open_mainfile(filepath=str(out))
    found = baked(bpy.context.scene)
    assert (found.frames, found.directory) == ("2-3", "//frames")
    assert len(list((tmp_path / "farm" / "frames").glob("geometry/*/meta/*.json"))) >= 4
    # The scene itself was left alone.
    bpy.ops.wm.open_mainfile(filepath=str(still_life))
    assert baked(bpy.context.scene) is None


def test_bake_writes_blend_files_only(still_life, tmp_path, capsys):
    assert main(["bake", _save(still_life), "-o", str(tmp_path / "baked.exr")]) == 2
    assert "must end in .blend" in capsys.readouterr().err


def _without_camera(scene):
    scene.camera = None


def _without_glass(scene):
    bpy.data.objects.remove(bpy.data.objects["Refractive Glass"])


def _panoramic(scene):
    scene.camera.data.type = "PANO"


def _nothing_behind(scene):
    bpy.data.objects.remove(bpy.data.objects["Wall"])


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (_without_camera, "camera"),
        (_without_glass, "glass"),
        (_panoramic, "lens type"),
        (_nothing_behind, "nothing can be seen"),
    ],
)
def test_bad_scenes(still_life, tmp_path, capfd, spoil, word):
    spoil(bpy.context.scene)
    out = tmp_path / "out.png"
    assert main(["render", _save(still_life), "-o", str(out)]) == 2
    lines = [x for x in capfd.readouterr().err.splitlines() if x.startswith("refractive_glass:")]
    assert len(lines) == 1
    assert word in lines[0]
    assert not out.exists()


def test_missing_and_unreadable_files(tmp_path, capfd):
    assert main(["render", str(tmp_path / "none.blend"), "-o", str(tmp_path / "o.png")]) == 2
    assert "no such file" in capfd.readouterr().err
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"no blend file at all")
    assert main(["compare", str(broken), "-o", str(tmp_path / "out")]) == 2
    assert "not a readable" in capfd.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["render"],
        ["render", "x.blend", "-o", "x.png", "--frames", "9-3"],
        ["render", "x.blend", "-o", "x.png", "--frames", "a"],
        ["melt", "x.blend"],
    ],
)
def test_bad_arguments(arguments):
    assert main(arguments) == 2


def test_a_picture_format_that_does_not_exist(still_life, tmp_path, capfd):
    assert main(["render", _save(still_life), "-o", str(tmp_path / "out.docx")]) == 2
    assert ".png" in capfd.readouterr().err
