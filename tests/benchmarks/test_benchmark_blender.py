# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark's parts that need Blender, as small as they go: counts and errors, never a time."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from benchmarks import frames, left_out, pictures, rays, runner  # noqa: E402
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


@pytest.fixture(scope="module")
def rays_part(tmp_path_factory):
    """The report's part on exit rays, as the runner takes it from Blender."""
    folder = tmp_path_factory.mktemp("rays")
    runner.run(TINY, folder, only=["rays"], with_charts=False, progress=len)
    return json.loads((folder / "report.json").read_text())["parts"]["rays"]


def test_exit_rays_keep_all_light_and_ask_the_caster_once_a_step(rays_part):
    found = rays_part["found"]
    assert [row["name"] for row in found["shapes"]] == list(rays.SHAPES)
    for row in found["shapes"]:
        assert row["imbalance"] < 1e-12 and 0.0 <= row["lost"] < 0.1
        assert 0 < row["met"] <= row["rays"] <= row["ways"]
        assert row["casts"] <= row["steps"]
        assert row["rays"] <= row["rays_cast"] <= row["steps"] * row["ways"]
    closed, *meshes = found["meshes"]
    assert [row["triangles"] > 0 for row in (closed, *meshes)] == [False] + [True] * len(meshes)
    assert all(row["ways"] == pytest.approx(closed["ways"], rel=0.1) for row in meshes)
    assert rays.describe(found)


def test_hard_cases_are_what_they_must_equal(rays_part):
    for row in rays_part["found"]["hard"]:
        name = row["name"], row["kind"]
        assert row["imbalance"] < 1e-12 and row["nonfinite"] == 0, name
        if row["compared"] is None or "from the origin" in row["name"]:
            continue
        assert row["compared"] > 0.98, name
        assert row["turned"] < (1e-8 if row["kind"] == "closed form" else 1e-5), name
        # A mesh is met in float32; a chain of total reflections adds up.
        assert row["moved"] < (1e-8 if row["kind"] == "closed form" else 1e-4), name


def test_stages_add_up_and_what_was_known_is_not_followed_again(tmp_path):
    found = frames.run(_settings(tmp_path))
    for row in (*found["scenes"], *found["glasses"], *found["meshes"]):
        for name in ("first", "thing moved", "eye moved"):
            assert row[name]["cpu_seconds"] == pytest.approx(sum(row[name]["stages"].values()))
            assert set(row[name]["stages"]) == {*frames.STAGES, "rest"}
        assert row["first"]["counts"]["exit_rays"] >= row["first"]["covered"] > 0
        # Nothing stands among these glasses: things may move without.
        assert row["thing moved"]["counts"]["exit_rays"] == 0
        assert row["eye moved"]["counts"]["exit_rays"] > 0
    one, two = (row["first"]["covered"] for row in found["glasses"])
    assert two > one
    assert [row["name"] for row in found["renders"][0]["rows"]] == [
        "first",
        "thing moved",
        "eye moved",
    ]
    assert "frames_sizes.png" in "\n".join(frames.describe(found))


def test_pictures_come_from_a_scene_file(tmp_path):
    found = pictures.run(_settings(tmp_path))
    (scene,) = found["scenes"]
    assert scene["scene"] == "wall" and scene["inside_pixels"] > 0
    rows = {kind["name"]: kind["rows"] for kind in scene["kinds"]}
    assert list(rows) == [
        pictures.REAL,
        pictures.REAL_OIDN,
        pictures.RAYS,
        pictures.RAYS_OIDN,
        pictures.RAYS_1,
        pictures.RAYS_1_OIDN,
        pictures.DISPLACED,
    ]
    assert [row["samples"] for row in rows[pictures.REAL]] == [1, 2]
    for name, kind in rows.items():
        for row in kind:
            assert (row.get("vertices", 0) > 0) == (name == pictures.DISPLACED)
            assert (row.get("rays", 0) > 0) == name.startswith("rays")
            assert 0 < row["rmse_inside"] < 0.3
            assert row["cpu_seconds"] > 0.0
    page = "\n".join(pictures.describe(found))
    assert f"{pictures.charts(found)[0].name}.png" in page


def test_an_error_holds_nothing_of_its_references_noise():
    random = np.random.default_rng(0)
    truth = np.full((200, 200, 3), 0.5)
    halves = [truth + random.normal(0.0, 0.1, truth.shape) for _ in range(2)]
    mask = np.ones((200, 200), bool)
    assert pictures.error(truth, halves, mask) < 0.01
    assert pictures.error(truth + 0.05, halves, mask) == pytest.approx(0.05, rel=0.05)
    with pytest.raises(RuntimeError, match="no numbers"):
        pictures.error(np.full_like(truth, np.nan), halves, mask)


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
    row = {row["name"]: row for row in scene["rays"]}
    default, many, one = (
        row[name] for name in ("default", "many rays in every pixel", "one ray a pixel")
    )
    assert many["rays"] > default["rays"] > one["rays"] == one["pixels"] > 0
    assert row["all samples in captures"]["samples"] >= default["samples"]
    captures = [row[f"captures: {count}"] for count in (2, 1, 0)]
    assert [each["captures"] for each in captures] == sorted(
        (each["captures"] for each in captures), reverse=True
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
    curve = [(0.2, 1.0), (0.1, 4.0), (0.025, 64.0)]
    found = pictures.against(curve, taken, error)
    assert found["ratio"] == pytest.approx(ratio) if ratio else found["ratio"] is None
    assert (found["at_least"], found["at_most"]) == (at_least, at_most)


def test_where_curves_cross():
    """Two straight lines on logarithmic axes, through (0.1, 10) each."""
    one = [(0.2, 5.0), (0.05, 20.0)]
    other = [(0.2, 2.5), (0.05, 40.0)]
    ((error, seconds),) = pictures.crossings(one, other)
    assert (error, seconds) == pytest.approx((0.1, 10.0))
    assert pictures.crossings(one, [(e, 2.0 * s) for e, s in one]) == []
    rows = [{"rmse_inside": e, "cpu_seconds": s} for e, s in ((0.1, 1), (0.2, 2), (0.05, 3))]
    assert pictures.front({"rows": rows}) == [(0.1, 1), (0.05, 3)]


def test_the_runner_takes_blenders_parts(rays_part):
    assert rays_part["machine"]["blender"] == bpy.app.version_string
