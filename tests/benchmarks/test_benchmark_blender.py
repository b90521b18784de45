# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark's parts that need Blender, as small as they go: counts and errors, never a time."""

import json
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from benchmarks import (  # noqa: E402
    left_out,
    pictures,
    runner,
    scaling,
    tessellation,
)
from benchmarks.settings import Settings  # noqa: E402

sys.path.insert(0, str(Path(__file__).parent.parent / "scene"))
import scenes  # noqa: E402

TINY = Settings("tiny")


def _settings(tmp_path):
    """Settings with one small scene: a hollow glass before a striped wall."""
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    scenes.settings(64, 48, samples=1)
    path = tmp_path / "wall.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return Settings("tiny", scenes=(path,))


def test_subdivision_lowers_the_error_and_never_breaks_the_bound():
    found = tessellation.run(TINY)
    for wall in found["walls"]:
        for row in wall["even"]:
            assert row["judged"] > 0 and row["above_bound"] == 0
            assert row["measured_px"] <= row["bound_px"]
        errors = [row["measured_px"] for row in wall["even"]]
        assert errors == sorted(errors, reverse=True)
        assert [row["vertices"] for row in wall["even"]] == [9, 25, 81]
    assert "tessellation.png" in "\n".join(tessellation.describe(found))


def test_scaling_counts():
    found = scaling.run(TINY)
    assert [row["vertices"] for row in found["vertices"]] == [1_000, 10_000]
    assert [row["paths"] for row in found["paths"]] == list(range(1, 9))
    for row in found["vertices"]:
        # Directions, positions, distances, residuals, flags: eight numbers and a byte.
        assert row["exact"]["output_bytes_a_point"] == 65
    assert 0 < found["pixels"][0]["hit"] <= found["pixels"][0]["covered"]
    assert scaling.describe(found)


def test_pictures_come_from_a_scene_file(tmp_path):
    found = pictures.run(_settings(tmp_path))
    (scene,) = found["scenes"]
    assert scene["scene"] == "wall" and scene["inside_pixels"] > 0
    for cycles in scene["cycles"]:
        assert [row["samples"] for row in cycles["rows"]] == [1, 2]
    names = [variant["name"] for variant in scene["composited"]]
    assert names == [
        "True",
        "True, OIDN",
        "Displaced",
        "True, 1 capture",
        "True, 1 capture, OIDN",
    ]
    for variant in scene["composited"]:
        for row in variant["rows"]:
            copies = variant["name"] == "Displaced"
            assert (row["vertices"] > 0) == copies and (row["rays"] > 0) == (not copies)
            assert 0 < row["rmse_inside"] < 0.2
            assert row["cpu_seconds"] > 0.0
    page = "\n".join(pictures.describe(found))
    assert f"{pictures.charts(found)[0].name}.png" in page


def test_what_is_left_out_is_counted(tmp_path):
    found = left_out.run(_settings(tmp_path))
    (scene,) = found["scenes"]
    assert scene["sources"] == 1 and scene["source_vertices"] == 50
    (glass,) = scene["glasses"]
    assert set(glass["kept_paths"]) < set(glass["listed_paths"])
    assert 0.9 < glass["light_kept"] <= glass["light_listed"] <= 1.0 + 1e-6
    assert glass["hit_pixels"] <= glass["rect_pixels"] <= scene["picture_pixels"]
    copies = scene["kept"]["copies"], scene["kept"]["empty_copies"]
    assert copies[0] > 0 and sum(copies) <= len(glass["kept_paths"])
    more = scene["fuller"][0]
    assert set(more["paths"]) >= set(scene["kept"]["paths"])
    assert more["copies"] >= scene["kept"]["copies"]
    fullest, default, fewest, *captures = scene["rays"]
    assert fullest["ways"] >= default["ways"] >= fewest["ways"] >= fewest["rays"] > 0
    assert default["rays"] >= default["pixels"] > 0
    assert [len(row["views"]) for row in captures] == sorted(
        (len(row["views"]) for row in captures), reverse=True
    )
    assert captures[-1]["unseen"] >= default["unseen"] - 1e-9
    assert left_out.describe(found)


def test_a_scene_in_which_nothing_is_computed_is_no_figure(tmp_path):
    settings = _settings(tmp_path)
    bpy.data.objects["Wall"].location.y = -5.0
    bpy.ops.wm.save_as_mainfile(filepath=str(settings.scenes[0]))
    with pytest.raises(RuntimeError, match="not composited"):
        pictures.run(settings)


@pytest.mark.parametrize(
    ("error", "taken", "ratio", "at_least", "at_most"),
    [
        (0.1, 1.0, 4.0, None, None),  # on a point of the curve
        (0.05, 1.0, 16.0, None, None),  # halfway, on both logarithmic axes
        (0.01, 2.0, None, 32.0, None),  # better than Cycles was ever seen
        (0.9, 2.0, None, None, 0.5),  # worse
    ],
)
def test_times_at_equal_error(error, taken, ratio, at_least, at_most):
    curve = [
        {"rmse_inside": e, "cpu_seconds": s} for e, s in ((0.2, 1.0), (0.1, 4.0), (0.025, 64.0))
    ]
    found = pictures._against(curve, taken, error)
    assert found["ratio"] == pytest.approx(ratio) if ratio else found["ratio"] is None
    assert (found["at_least"], found["at_most"]) == (at_least, at_most)


def test_the_runner_takes_blenders_parts(tmp_path):
    runner.run(TINY, tmp_path, only=["scaling"], with_charts=False, progress=len)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["parts"]["scaling"]["machine"]["blender"] == bpy.app.version_string
