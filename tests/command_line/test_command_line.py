# SPDX-License-Identifier: GPL-3.0-or-later
"""``python -m glass_refraction``: results, and one line with exit status 2 on bad input."""

import math
import sys
from pathlib import Path

import bpy
import pytest

from glass_refraction.cli import main
from glass_refraction.scene.bake.playback import baked
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input

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
        ["render", "x.blend", "-o", "x.png", "--frames", "99999999999999"],
        ["render", "x.blend", "-o", "x.png", "--frames", "1-2000000"],
        ["bake", "x.blend", "-o", "x.blend", "--frames", "1-99999999999999"],
        ["compare", "x.blend", "-o", "x", "--frame", "99999999999999"],
        ["compare", "x.blend", "-o", "x", "--samples", "99999999999999"],
        ["compare", "x.blend", "-o", "x", "--samples", "0"],
        ["compare", "x.blend", "-o", "x", "--samples", "few"],
        ["melt", "x.blend"],
        ["benchmark", "-o", "x"],
    ],
    ids=" ".join,
)
def test_bad_arguments(arguments, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("refractive_glass")
    assert list(tmp_path.iterdir()) == []


NAN, INF = math.nan, math.inf


def _place(name):
    def spoil(scene):
        bpy.data.objects[name].location.x = NAN

    return spoil


def _rotation(scene):
    bpy.data.objects["Refractive Glass"].rotation_euler.x = NAN


def _lens(scene):
    scene.camera.data.lens = NAN


def _ortho(scene):
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", NAN


def _clip(scene):
    scene.camera.data.clip_start = NAN


def _no_pixels(scene):
    scene.render.resolution_percentage = 1


def _no_region(scene):
    scene.render.use_border = scene.render.use_crop_to_border = True
    scene.render.border_min_x = scene.render.border_max_x = 0.5


def _setting(name):
    def spoil(scene):
        setattr(scene.refractive_glass, name, NAN)

    return spoil


def _size(name, value):
    def spoil(scene):
        write_input(glass_modifier(bpy.data.objects["Refractive Glass"]), name, value)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (_place("Camera"), 'Camera "Camera"'),
        (_place("Refractive Glass"), 'Glass "Refractive Glass"'),
        (_rotation, 'Glass "Refractive Glass"'),
        (_lens, 'Camera "Camera"'),
        (_ortho, 'Camera "Camera"'),
        (_clip, 'Camera "Camera"'),
        (_no_pixels, 'scene "Scene"'),
        (_no_region, 'scene "Scene"'),
        (_setting("min_weight"), 'scene "Scene"'),
        (_setting("tolerance_px"), 'scene "Scene"'),
        *(
            (_size(name, value), 'Glass "Refractive Glass"')
            for name in ("Radius", "Wall Thickness", "Height", "IOR", "Contents IOR")
            for value in (NAN, INF, -1.0, 0.0)
        ),
        (_size("Height", 1e-30), 'Glass "Refractive Glass"'),
    ],
)
def test_impossible_numbers_are_told_by_name(tmp_path, capfd, spoil, named):
    scenes.camera()
    scenes.striped_wall(stripes=4)
    scenes.glass(shape="CYLINDER")
    scene = scenes.settings(16, 12, samples=1, surface="REFRACTION", shading="DISPLACED")
    spoil(scene)
    out = tmp_path / "out.png"
    assert main(["render", _save(tmp_path / "scene.blend"), "-o", str(out)]) == 2
    lines = [x for x in capfd.readouterr().err.splitlines() if x.startswith("refractive_glass:")]
    assert len(lines) == 1
    assert named in lines[0]
    assert not out.exists()


def test_vertices_that_are_no_numbers_disturb_no_other(still_life, tmp_path):
    mesh = bpy.data.objects["Wall"].data
    mesh.vertices[0].co = (NAN, INF, 0.0)
    out = tmp_path / "out.png"
    assert main(["render", _save(still_life), "-o", str(out)]) == 0
    assert out.is_file()


def test_files_and_folders_that_cannot_be_written(still_life, tmp_path, capfd):
    scene = _save(still_life)
    before = still_life.read_bytes()
    a_file, a_folder = tmp_path / "file", tmp_path / "folder"
    a_file.write_text("mine")
    for name in ("x.png", "x.blend"):
        (a_folder / name).mkdir(parents=True)
    for arguments in (
        ["render", scene, "-o", str(a_file / "x.png")],
        ["render", scene, "-o", str(a_folder / "x.png")],
        ["render", scene, "-o", ""],
        ["render", str(a_folder), "-o", str(tmp_path / "x.png")],
        ["compare", scene, "-o", str(a_file)],
        ["compare", scene, "-o", ""],
        ["bake", scene, "-o", str(a_folder / "x.blend"), "--frames", "1"],
        ["bake", scene, "-o", str(a_file / "x.blend"), "--frames", "1"],
        ["bake", scene, "-o", scene, "--frames", "1"],
        ["bake", scene, "-o", str(tmp_path / "b.blend"), "--frames", "1", "--folder", str(a_file)],
    ):
        capfd.readouterr()
        assert main(arguments) == 2, arguments
        (line,) = [x for x in capfd.readouterr().err.splitlines() if x.startswith("refractive_g")]
        assert "Errno" not in line
        assert "Traceback" not in line
    assert still_life.read_bytes() == before
    assert a_file.read_text() == "mine"


def test_a_picture_format_that_does_not_exist(still_life, tmp_path, capfd):
    assert main(["render", _save(still_life), "-o", str(tmp_path / "out.docx")]) == 2
    assert ".png" in capfd.readouterr().err
