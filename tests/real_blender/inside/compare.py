# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: Compare, cancelled by Esc and then to its end.

Argument: output folder. Writes what it found as the result, quits.
"""

import subprocess
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from windowed import prepared, until, view_3d, walk

FOLDER = Path(sys.argv[-1])
OPERATOR = "SCENE_OT_refractive_glass_compare"
MANY_SAMPLES = 4096
"""So many that the picture is not done before Esc is pressed."""

result = {}


def comparing():
    return any(o.bl_idname == OPERATOR for o in view_3d()["window"].modal_operators)


def state():
    scene = bpy.context.scene
    return [
        sorted(s.name for s in bpy.data.scenes),
        sorted(o.name for o in bpy.data.objects if o.hide_render),
        scene.render.filepath,
        scene.render.image_settings.file_format,
        bpy.context.preferences.view.render_display_type,
    ]


def start(folder):
    with bpy.context.temp_override(**view_3d()):
        return list(
            bpy.ops.scene.refractive_glass_compare("INVOKE_DEFAULT", directory=str(FOLDER / folder))
        )


def shown():
    return [
        area.spaces.active.image.name
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
        if area.type == "IMAGE_EDITOR" and area.spaces.active.image is not None
    ]


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    yield 0.2
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT", shape="CYLINDER", radius=2.0, wall_thickness=0.2, height=3.0
        )
        bpy.context.window_manager.refractive_glass_overlay = False
    yield from prepared(scene)
    before = state()
    scene.cycles.samples = MANY_SAMPLES
    result["started"] = start("cancelled")
    yield from until(lambda: bpy.app.is_job_running("RENDER"))
    yield 0.5
    result["running"] = comparing()
    subprocess.run(["xdotool", "mousemove", "300", "450", "key", "Escape"], check=True)
    result["cancelled"] = yield from until(lambda: not comparing())
    result["same_after_cancel"] = state() == before
    result["files_after_cancel"] = [p.name for p in (FOLDER / "cancelled").iterdir()]

    scene.cycles.samples = 2
    start("whole")
    yield from until(lambda: not comparing())
    yield from until(shown, 10)
    yield 0.5
    result["same_at_the_end"] = state() == before
    result["files"] = sorted(p.name for p in (FOLDER / "whole").iterdir())
    result["shown"] = shown()
    subprocess.run(["import", "-window", "root", FOLDER / "compare.png"], check=True)


walk(steps(), result, FOLDER)
