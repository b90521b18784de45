# SPDX-License-Identifier: GPL-3.0-or-later
"""The refracted picture in the 3D views of a Blender with a window, against F12's."""

import shutil
from pathlib import Path

import numpy as np
import pytest

DEMO = Path(__file__).parents[2] / "demo_scenes" / "eraser.blend"
FRAMES = (1, 10, 20)
WINDOW = (600, 430)


@pytest.fixture(scope="module")
def flat(installed):
    return installed.folder / "flat.blend"


@pytest.fixture(scope="module")
def rendered(installed, flat):
    return installed.script("viewport_f12", shutil.copy(DEMO, installed.folder), flat)


@pytest.fixture(scope="module")
def found(installed, rendered, flat):
    return installed.script("viewport", flat, how="gui", size=WINDOW, seconds=1800)


def mask(picture):
    """The eraser: more green than anything else, at least half of it."""
    red, green, blue = (picture[..., k] for k in range(3))
    return green > np.maximum(0.5, np.maximum(red, blue) + 0.1)


def outline(picture, *, verge=True):
    """(K, 2) places between pixels of which one is the eraser's, x and y in pixels.

    At the verge of the glass, which is black here, the picture is squeezed without end: without
    ``verge`` what lies within three pixels of it is left out.
    """
    dark = (picture.sum(axis=2) < 0.5) & (not verge)
    dark[:, 3:] |= dark[:, :-3].copy()
    dark[:, :-3] |= dark[:, 3:].copy()
    shown = mask(picture)
    across = (shown[:, 1:] != shown[:, :-1]) & ~dark[:, 1:] & ~dark[:, :-1]
    along = (shown[1:] != shown[:-1]) & ~dark[1:] & ~dark[:-1]
    across = np.argwhere(across)[:, ::-1] + (1.0, 0.5)
    along = np.argwhere(along)[:, ::-1] + (0.5, 1.0)
    return np.concatenate((across, along))


def farthest(first, second):
    """How far the points (K, 2) of one outline lie from the other one, at most."""
    apart = np.linalg.norm(first[:, None] - second[None], axis=2)
    return apart.min(axis=1).max()


@pytest.mark.parametrize(
    ("kind", "frame"), [*(("SOLID", f) for f in FRAMES), ("MATERIAL", FRAMES[1])]
)
def test_the_erasers_outline_is_that_of_f12(found, rendered, kind, frame):
    seen = np.load(found["folder"] / f"{kind}_{frame}.npy")
    picture = np.load(rendered["folder"] / f"F12_{frame}.npy")
    x0, y0, x1, y1 = found["frame"]
    height, width = picture.shape[:2]
    scale = ((x1 - x0) / width, (y1 - y0) / height)
    expected, sure = (outline(picture, verge=v) * scale + (x0, y0) for v in (True, False))
    assert len(sure) > 100
    assert farthest(sure, outline(seen)) < 2.0
    # EEVEE's pixels are mixed over 1.5 pixels to each side of an edge, Workbench's over one: the
    # colours that are looked up there count as the eraser's or not by little.
    assert farthest(outline(seen, verge=False), expected) < {"SOLID": 2.0, "MATERIAL": 2.5}[kind]


@pytest.mark.parametrize("kind", ["SOLID", "MATERIAL"])
def test_colours_are_managed_once(found, kind):
    """The wall is one colour; through the glass it is the same."""
    seen = np.load(found["folder"] / f"{kind}_{FRAMES[1]}.npy")
    x0, y0, x1, y1 = found["frame"]
    # High on the wall, in the middle of the glass and right beside it.
    row = int(y0 + 0.62 * (y1 - y0))
    through, beside = (seen[row, int(x0 + part * (x1 - x0))] for part in (0.42, 0.8))
    assert through == pytest.approx(beside, abs=1.5 / 255)
    assert beside[2] > 0.5


@pytest.mark.parametrize("kind", ["SOLID", "MATERIAL"])
def test_captures_tell_how_far_things_are(found, kind):
    """EEVEE writes no depths while overlays are off, and where they draw lines others stand in."""
    assert found["capture_depths"][kind] < {"SOLID": 0.05, "MATERIAL": 0.25}[kind]


def test_a_view_by_cycles_has_captures_for_which_cycles_does_not_begin_anew(found):
    """Cycles itself draws black ones. EEVEE draws as a view that is hidden, and left as it was."""
    seen = found["cycles"]
    assert seen["captured"] > 0.05
    assert seen["depths"] < 0.25
    assert seen["begun"] == 1
    assert seen["as_before"]


def test_a_view_by_cycles_for_which_nothing_draws_captures_says_so(found):
    """They are drawn as soon as something can."""
    seen = found["cycles"]
    assert seen["in_vain"] == 0
    assert "only what this view sees" in seen["lines"][0]
    assert seen["lines"][1] == ""
    assert seen["in_time"] >= 6


def test_a_view_by_cycles_shows_its_glass_before_its_captures_are_there(found):
    """Cycles begins with an empty picture, and the glass of that was shown: a dark block."""
    assert found["cycles"]["traces"] > 2


def test_a_camera_that_moves_has_no_capture_drawn_anew(found):
    assert found["moved_camera"]["faces"] == 0


def test_a_whole_sample_does_not_wait_for_eevee_to_refine(found):
    assert found["moved_camera"]["early"]


def test_a_picture_is_read_as_it_moves_and_as_its_engine_comes_to_rest(found):
    """Between both it is refined: what was begun before the last sample was begun in vain."""
    moving, at_rest, samples = found["reads"]
    assert moving == 2
    assert at_rest == 1 < int(samples)


def test_a_view_comes_to_rest_though_a_redraw_or_its_timer_got_lost(found):
    """Else the line that tells what it works on stayed until something moved."""
    assert found["lost"] == {"redraw": True, "timer": True}


@pytest.mark.parametrize("kind", ["SOLID", "MATERIAL"])
def test_captures_are_drawn_anew_while_an_animation_plays(found, kind):
    """What moves would be seen where it was, lit as it was. One face in Material Preview that had
    taken longer than a redraw kept all others from being drawn.
    """
    assert found["played_faces"][kind][0] > 0


def test_faces_that_were_drawn_in_haste_are_drawn_again_at_rest(found):
    assert found["played_faces"]["MATERIAL"][1] >= 6


def test_a_sample_that_an_engine_shows_late_is_looked_at_anew(found):
    """On a busy machine one came after the final picture, which went on to an eighth sample."""
    assert found["late"] == [False, True, ""]


@pytest.mark.parametrize("kind", ["SOLID", "MATERIAL"])
def test_pixels_have_more_samples_where_samples_differ(found, kind):
    counts = {int(float(number)): pixels for number, pixels in found["samples"][kind].items()}
    most = list(np.cumsum((1, *found["rounds"])))
    assert sorted(counts) == most
    # Every round is of some pixels of the one before, and most pixels need none.
    assert counts[most[0]] > sum(counts[number] for number in most[1:])


def test_eevee_draws_few_samples_of_captures_and_the_users_setting_stays(found):
    samples = found["moved_camera"]["samples"]
    assert samples == [8, 8]
    assert 0 < found["face_samples"] < samples[0]


def test_lines_of_glasses_that_are_not_selected_are_not_seen(found):
    """Of rings of some hundred pixels each a few may be left."""
    assert found["lines"] < 40
    assert found["parallel_lines"] < 40


def test_a_glass_on_a_desk_is_not_seen_from_below(found):
    """Its foot lies in the plane of the desk, and was a dark disc."""
    assert found["below"] < 20


def test_a_glass_of_ior_1_is_not_seen(found):
    """Nor are the lines that it is drawn by, but for a few pixels where these end."""
    assert found["clear"] < 20


def test_an_instance_of_a_glass_is_seen_as_the_glass(found):
    """In its place, and once it moved. The verge alone is two thousand pixels; a side of the eraser
    that runs between two columns of them may fall on the other one.
    """
    assert max(found["instances"]) < 100
    assert found["instance_beside"] < 100


def test_nothing_happens_on_a_still_scene(found):
    assert found["still"]


def test_nothing_fails(found):
    assert found["failures"] == []


def test_undo_and_redo_keep_the_picture(found):
    assert found["moved"] == pytest.approx(0.01, abs=1e-6)
    assert found["edges_after_undo"] == 0


def test_two_views(found):
    assert found["views"] == 2
    # Three draw handlers serve all views.
    assert found["one_left"] == [True, 3]


def test_quad_view(found):
    assert found["quad"] == [4, 4]


def test_two_windows_show_two_scenes(found):
    assert found["scenes"] == [1, True, True]


@pytest.mark.parametrize(("motion", "most"), [("still", 1), ("eye", 8), ("object", 8)])
def test_redraws_leave_nothing_behind(found, motion, most):
    """A still redraw reads no texture anew; what moves, is described and captured anew too."""
    drawn, made, held = found["memory"][motion]
    assert drawn >= 10
    assert made <= most * drawn
    assert made > 0 or motion == "still"
    # The last ones are what is shown.
    assert held <= 8


def test_files_hold_the_glass_whole(found):
    assert found["faces_while_shown"] == 0
    assert not found["marked_in_file"]


def test_switched_off_nothing_is_left(found):
    handles, views, faces = found["off"]
    assert (found["handles_before"], handles, views) == (0, 0, 0)
    assert faces > 100
    assert found["after_load"] == [0, 0]
