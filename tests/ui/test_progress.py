# SPDX-License-Identifier: GPL-3.0-or-later
"""What users are told while a picture is computed, and what is wrong with it afterwards."""

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from glass_refraction import handlers
from glass_refraction.reference.picture import render_picture
from glass_refraction.scene import progress
from glass_refraction.scene import update as door
from glass_refraction.scene.rays.caster import Caster
from glass_refraction.ui.progress import line

sys.path.insert(0, str(Path(__file__).parent.parent / "scene"))
import scenes


@pytest.fixture
def scene():
    scenes.camera()
    scenes.striped_wall(stripes=4)
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    scene = scenes.settings(32, 24, samples=1, shading="TRUE")
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.use_world_space_lighting = True
    return scene


def test_a_render_tells_what_it_is_at_and_ends_with_nothing(scene, monkeypatch):
    told = []
    for module in (door, handlers, sys.modules["glass_refraction.scene.rays.frame"]):
        monkeypatch.setattr(
            module, "tell", lambda doing: (told.append(doing), progress.tell(doing))
        )
    bpy.ops.render.render()
    told = [doing for doing in told if doing is not None]
    assert told[0].startswith("following light")
    assert any("placing cameras" in doing for doing in told)
    assert told[-1].startswith("rendering what else is seen")
    assert progress.doing() is None


def test_a_render_that_fails_tells_nothing_afterwards(scene, monkeypatch):
    def failing(*_):
        progress.tell("half done")
        raise door.RefractiveGlassError("no")

    monkeypatch.setattr(door.true, "update", failing)
    bpy.ops.render.render()
    assert progress.doing() is None


def test_esc_stops_the_next_cast_and_the_next_picture_is_the_same(scene, monkeypatch):
    whole = render_picture(scene)
    casts = []

    def pressed(self, origins, directions, cast=Caster.cast):
        casts.append(len(origins))
        progress.ask_to_stop()
        return cast(self, origins, directions)

    door.memory_of(scene).kept = None
    with monkeypatch.context() as patched:
        patched.setattr(Caster, "cast", pressed)
        bpy.ops.render.render()
    assert len(casts) == 1
    # Esc ends the render where there is a window; no picture without its glass is left unnamed.
    assert door.memory_of(scene).last == [handlers.STOPPED]
    assert np.array_equal(render_picture(scene), whole)
    assert door.memory_of(scene).last == []


def test_esc_while_the_engine_draws_prints_no_error(scene, capfd):
    def pressed(drawn, *_):
        if "refractive_glass" in drawn:
            progress.ask_to_stop()
            seen.append(drawn.name)

    seen, listed = [], bpy.app.handlers.frame_change_post
    listed.insert(0, pressed)
    bpy.ops.render.render()
    listed.remove(pressed)
    assert seen
    assert "Traceback" not in "".join(capfd.readouterr())


def test_esc_counts_for_its_own_render_only(scene):
    progress.ask_to_stop()
    bpy.ops.render.render()
    assert door.memory_of(scene).last == []
    progress.ask_to_stop()
    for function in bpy.app.handlers.render_cancel:
        function(scene)
    progress.check()


def test_the_line_counts_seconds_once_there_is_one():
    assert line(None, 5.0) is None
    assert line("waiting", 0.4) == "Refractive Glass: waiting"
    assert line("waiting", 3.2) == "Refractive Glass: waiting (3 s)"


def test_a_single_layer_without_its_captures_is_told_until_the_next_picture(scene):
    bpy.ops.render.render(layer=scene.view_layers[0].name)
    assert door.memory_of(scene).last == [handlers.LEFT_OUT]
    # A window prepares the scene anew once the render has ended.
    handlers._prepare(scene)
    assert door.memory_of(scene).last == [handlers.LEFT_OUT]
    bpy.ops.render.render()
    assert door.memory_of(scene).last == []


def test_a_single_layer_that_needs_no_capture_is_right_and_nothing_is_told(scene):
    # Workbench would have the world's picture rendered.
    scene.render.engine = "CYCLES"
    scene.refractive_glass.captures = 0
    bpy.ops.render.render(layer=scene.view_layers[0].name)
    assert door.memory_of(scene).last == []


def test_a_cancelled_render_is_not_taken_for_a_single_layer(scene):
    bpy.ops.render.render()
    handlers._on_render_init(scene)
    for function in bpy.app.handlers.render_cancel:
        function(scene)
    assert handlers.LEFT_OUT not in door.status(scene).problems
    assert door.memory_of(scene).last == []


def test_two_eyes_are_told(scene):
    scene.render.use_multiview = True
    bpy.ops.render.render()
    assert "renders two eyes" in door.memory_of(scene).last[0]


def test_reading_a_file_stops_a_render_and_nothing_else(scene, monkeypatch):
    for rendering in (False, True):
        monkeypatch.setattr(handlers, "_rendering", rendering)
        handlers._before_load()
        if rendering:
            with pytest.raises(progress.Stopped):
                progress.check()
        else:
            progress.check()
    progress.go_on()
