# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark's parts that need no Blender: structure, counts and errors, never a time."""

import json
import sys

import numpy as np
import pytest

from benchmarks import (
    forward,
    live,
    measure,
    newton,
    paper,
    plots,
    runner,
    solver,
    stability,
    text,
)
from benchmarks.cases import BEHIND_HOLLOW, BEHIND_SLAB, HOLLOW, SLAB
from benchmarks.command import main
from benchmarks.settings import Settings
from glass_refraction import optics

TINY = Settings("tiny", seed=3)


def _off_px(case, positions, points):
    """Pixels between positions and the solver's finest answer."""
    true = optics.apparent_points(case.glass, case.path, case.eye, points)
    (slot,) = np.flatnonzero(true.valid.any(axis=1))
    towards = positions - np.asarray(case.eye)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    shown = true.valid[slot]
    return forward.angles_px(towards[shown], true.direction[slot, shown])


# --- the rivals ----------------------------------------------------------------------------------


def test_plain_newton_finds_the_same_images():
    points = BEHIND_SLAB.points(np.random.default_rng(0), 300)
    places = newton.slab_places(SLAB, BEHIND_SLAB.eye, points)
    assert _off_px(BEHIND_SLAB, places, points).max() < 1e-9
    points = BEHIND_HOLLOW.points(np.random.default_rng(0), 300)
    places = newton.cylinder_places(HOLLOW, BEHIND_HOLLOW.eye, points)
    assert _off_px(BEHIND_HOLLOW, places, points).max() < 1e-9
    true = optics.apparent_points(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points)
    np.testing.assert_allclose(places, true.position[-1], atol=1e-12)


@pytest.mark.parametrize("function", [newton.slab_places, newton.cylinder_places])
def test_each_plain_step_brings_the_answer_closer_and_keeps_the_width(function):
    case = BEHIND_SLAB if function is newton.slab_places else BEHIND_HOLLOW
    points = case.points(np.random.default_rng(1), 200)
    errors = [
        _off_px(case, function(case.glass, case.eye, points, k), points).max() for k in (0, 1)
    ]
    assert errors[1] < 0.3 * errors[0]
    narrow = function(case.glass, case.eye, points, 4, np.float32)
    assert narrow.dtype == np.float32
    assert _off_px(case, narrow, points).max() < 1e-3


def test_the_papers_slab_is_exact():
    """Equation (5), then (2): the moved vertex lies on the ray that sees the true one."""
    points = BEHIND_SLAB.points(np.random.default_rng(2), 300)
    points[0] = (0.0, 0.0, -0.4)  # normal incidence
    moved = paper.slab_places(SLAB, BEHIND_SLAB.eye, points)
    np.testing.assert_array_equal(moved[:, :2], points[:, :2])
    assert moved[0, 2] == pytest.approx(points[0, 2] + 0.01 * (1 - 1 / 1.5), abs=1e-15)
    assert _off_px(BEHIND_SLAB, moved, points).max() < 1e-9


def test_the_papers_cylinder_comes_to_rest_at_the_same_images():
    """One interface undone at a time ends where all equations at once do, away from the verge."""
    random = np.random.default_rng(3)
    points = random.uniform(-1, 1, (200, 3)) * (0.02, 0.012, 0.04) + (-0.09, 0.0, 0.02)
    errors = [
        _off_px(
            BEHIND_HOLLOW, paper.cylinder_places(HOLLOW, BEHIND_HOLLOW.eye, points, k), points
        ).max()
        for k in (5, 20, 60)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-6


# --- measuring -----------------------------------------------------------------------------------


def test_rivals_take_turns():
    order = []
    found = measure.timings({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 4
    assert len(found["a"]["samples"]) == 3
    assert found["a"]["low"] <= found["a"]["median"] <= found["a"]["high"]


def test_a_forward_trace_catches_a_false_image():
    points = BEHIND_HOLLOW.points(np.random.default_rng(4), 50)
    good = optics.apparent_points(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points)
    checked = forward.check(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points, good)
    assert checked.held == checked.images == 50
    assert checked.worst_px < 1e-6
    good.direction[:, :10] = good.direction[:, :1]
    good.distance[:, 10:20] *= 1.01
    bad = forward.check(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points, good)
    assert bad.held == 31
    assert bad.worst_px > 1.0


def test_images_that_one_result_lacks_are_counted():
    points = BEHIND_HOLLOW.points(np.random.default_rng(5), 20)
    whole = optics.apparent_points(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points)
    part = optics.apparent_points(HOLLOW, "TTTT", BEHIND_HOLLOW.eye, points)
    part.valid[:, :3] = False
    errors, different = forward.direction_errors(part, whole)
    assert (len(errors), different) == (17, 3)
    assert forward.direction_errors(whole, part)[1] == 3


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (None, "-"),
        (float("nan"), "-"),
        (1234567, "1,234,567"),
        (0.012345, "0.0123"),
        (1.23e-7, "1.2e-7"),
        (2.5e7, "2.5e7"),
        (1234.5, "1,234"),
    ],
)
def test_numbers_as_text(value, shown):
    assert text.number(value) == shown


# --- parts ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benchmark")
    lines = []
    only = ("stability", "solver")
    runner.run(TINY, folder, only=only, with_charts=False, progress=lines.append)
    assert [line.split(" ")[0] for line in lines] == ["[1/2]", "[1/2]", "[2/2]", "[2/2]"]
    return folder


@pytest.fixture(scope="module")
def report(folder):
    return json.loads((folder / "report.json").read_text())


def test_every_tolerance_is_kept_and_every_image_is_true(report):
    cases = report["parts"]["solver"]["found"]["cases"]
    assert len(cases) == 14
    for case in cases:
        assert case["held"] == case["images"] > 0
        assert case["forward_px"] <= 1e-6
        for row in case["rows"]:
            for start in ("cold", "warm"):
                found = row[start]
                assert found["max_px"] <= max(row["tolerance_px"], 1e-5), case["name"]
                assert found["mean_px"] <= found["p999_px"] <= found["max_px"]
                assert found["different_images"] <= 0.01 * case["images"]


def test_all_rivals_and_all_the_papers_rows_are_there(report):
    found = report["parts"]["solver"]["found"]
    for rivals in found["rivals"].values():
        names = {row["name"].split(",")[0] for row in rivals}
        assert names == {"plain Newton", "the paper's method", "ours", "ours from the last frame"}
    assert [tuple(row["resolution"]) for row in found["table_3"]] == list(solver.TABLE_3)
    assert list(solver.TABLE_1) == list(solver.TABLE_2) == list(range(100_000, 900_000, 100_000))
    for row in found["table_2"]:
        assert row["worst"] <= row["average"] <= row["best"]


def test_the_hard_cases_hold(report):
    found = report["parts"]["stability"]["found"]
    assert len(found["rows"]) == 21
    for row in found["rows"]:
        assert row["held"] == row["images"] == row["traced"], row["name"]
        assert row["worst_px"] <= stability.ASKED_PX, row["name"]
        assert row["warnings_and_nonfinite"] == 0, row["name"]
    compared = {row["name"]: row["compared_px"] for row in found["rows"]}
    assert compared["ior equal on both sides"] < 1e-9
    assert compared["NaN and infinite points among good ones"] == 0
    assert [v for name, v in compared.items() if "caustic" in name] == [0, 0, 0, 0]
    assert found["random"]["over"] == 0
    assert found["random"]["held"] == found["random"]["images"] > 0


def test_the_same_seed_gives_the_same_figures():
    first, second = (stability._random_cases(TINY) for _ in range(2))
    assert first == second
    assert stability._random_cases(Settings("tiny", seed=4)) != first


def test_the_report_states_where_it_comes_from(folder, report):
    page = (folder / "report.md").read_text()
    for part in report["parts"].values():
        assert part["seed"] == 3 and part["size"] == "tiny"
        for key in ("processor", "cores", "python", "numpy", "blender"):
            assert str(part["machine"][key]) in page
    assert page.index("## Solver") < page.index("## Stability")
    assert "NVIDIA GeForce GTX 570" in page and "without drawing" in page


def test_parts_that_are_not_run_again_are_kept(monkeypatch, tmp_path, folder, report):
    found = report["parts"]["stability"]["found"]
    monkeypatch.setattr(stability, "run", lambda settings: found)
    (tmp_path / "report.json").write_text((folder / "report.json").read_text())
    settings = Settings("tiny", seed=9)
    runner.run(settings, tmp_path, only=["stability"], with_charts=False, progress=len)
    parts = json.loads((tmp_path / "report.json").read_text())["parts"]
    assert {name: part["seed"] for name, part in parts.items()} == {"solver": 3, "stability": 9}


def test_scenes_that_are_not_rendered_again_are_kept():
    before = {"scenes": [{"scene": "a", "run": 1}, {"scene": "b", "run": 1}]}
    now = {"scenes": [{"scene": "b", "run": 2}]}
    runner._keep_scenes(now, before)
    assert now["scenes"] == [{"scene": "a", "run": 1}, {"scene": "b", "run": 2}]


def test_the_documentation_is_the_report_with_its_pictures(tmp_path, folder, report):
    pytest.importorskip("matplotlib")
    docs, made = tmp_path / "docs", tmp_path / "made"
    made.mkdir()
    runner.write(report, made)
    runner.write_docs(report, made, docs)
    page = (docs / "benchmark.md").read_text()
    shown = sorted(link.split(")")[0] for link in page.split("](")[1:])
    assert "pictures/benchmark/solver_slab.png" in shown
    assert [docs / link for link in shown] == sorted((docs / "pictures/benchmark").iterdir())
    plain = page.replace("pictures/benchmark/", "")
    assert plain == (made / "report.md").read_text()


def test_without_a_window_the_live_view_is_left_out_and_says_so(monkeypatch):
    monkeypatch.delenv(live.PROGRAM, raising=False)
    (line, _) = live.describe(live.run(TINY))
    assert line.startswith("Left out") and live.PROGRAM in line


def test_charts_are_drawn(tmp_path, report):
    pytest.importorskip("matplotlib")
    charts = solver.charts(report["parts"]["solver"]["found"])
    assert [chart.name for chart in charts] == ["solver_cases", "solver_slab", "solver_cylinder"]
    page = "\n".join(solver.describe(report["parts"]["solver"]["found"]))
    for chart in charts:
        assert f"({chart.name}.png)" in page
        assert chart.x_label.endswith(("ms", "µs")) and chart.y_label.endswith("px")
        plots.draw(chart, tmp_path)
        assert (tmp_path / f"{chart.name}.png").read_bytes().startswith(b"\x89PNG")


# --- bad requests --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("only", "word"), [(["speed"], "no part 'speed'"), (["pictures"], "--scenes")]
)
def test_a_part_that_cannot_be_run(only, word):
    if only == ["pictures"]:
        pytest.importorskip("bpy")
    with pytest.raises(ValueError, match=word):
        runner.chosen(only, TINY)


def test_bad_settings():
    with pytest.raises(ValueError, match="size"):
        Settings("huge")


def test_figures_stand_on_the_right():
    lines = text.table(("name", "value"), [("2 cells", "1.5 (1 to 2)"), ("a", "> 3"), ("b", None)])
    assert lines[1] == "| --- | ---: |"


def _one_line(capfd, *arguments):
    assert main(list(arguments)) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("benchmark:")
    return line


def test_without_matplotlib_it_says_what_to_install(monkeypatch, tmp_path, capfd):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    line = _one_line(capfd, "-o", str(tmp_path / "out"), "--only", "stability")
    assert "pip install matplotlib" in line and "--no-plots" in line
    assert not (tmp_path / "out").exists()


def test_bad_arguments(tmp_path, capfd):
    out, a_file = str(tmp_path / "out"), tmp_path / "file"
    a_file.write_text("mine")
    assert "-o" in _one_line(capfd)
    assert "no part 'speed'" in _one_line(capfd, "-o", out, "--only", "speed")
    assert "--seed" in _one_line(capfd, "-o", out, "--seed", "-1")
    assert "no such .blend file" in _one_line(
        capfd, "-o", out, "--scenes", str(tmp_path / "no.blend")
    )
    assert "no such .blend file" in _one_line(capfd, "-o", out, "--scenes", str(a_file))
    for place in ("", str(a_file), str(a_file / "x")):
        line = _one_line(capfd, "-o", place, "--only", "stability", "--quick", "--no-plots")
        assert "give" in line and "Errno" not in line
    assert a_file.read_text() == "mine"
