# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: Esc while the extension computes what a render shows in a glass.

Argument: output folder. Writes how the render ended and how long that took as the result.
"""

import subprocess
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from windowed import prepared, until, view_3d, walk

FOLDER = Path(sys.argv[-1])
PACKAGE = "bl_ext.user_default.refractive_glass.glass_refraction"
result = {}


def part(name):
    return sys.modules[f"{PACKAGE}.{name}"]


def render():
    """Steps: F12, until the glass is worked at in a render that every window knows of."""
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.render.render("INVOKE_DEFAULT")
    told = part("scene.progress").doing
    yield from until(lambda: "glass" in (told() or "") and len(watched()) > 1)
    yield from until(lambda: all(watched()), 5)


def running():
    return bpy.app.is_job_running("RENDER")


def watched():
    windows = bpy.context.window_manager.windows
    return [any("watch" in o.bl_idname for o in w.modal_operators) for w in windows]


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append("complete"))
    bpy.app.handlers.render_cancel.append(lambda *_: ended.append("cancelled"))
    scene.render.engine = "BLENDER_WORKBENCH"
    yield 0.2
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT", shape="CYLINDER", radius=2.0, wall_thickness=0.2, height=3.0
        )
        bpy.context.window_manager.refractive_glass_overlay = False
    # So large that the picture is not done before Esc is pressed.
    scene.render.resolution_x, scene.render.resolution_y = 1920, 1080
    yield from prepared(scene)
    yield from render()
    result["watched"] = watched()
    result["doing"] = part("scene.progress").doing()
    pressed = time.perf_counter()
    subprocess.run(["xdotool", "mousemove", "300", "450", "key", "Escape"], check=True)
    yield from until(lambda: not running())
    result["seconds"] = time.perf_counter() - pressed
    result["ended"] = list(ended)
    result["problems"] = list(part("scene.update").status(scene).problems)
    yield from until(lambda: not any(watched()), 5)
    result["watched_afterwards"] = watched()

    yield from render()
    result["closed"] = running()
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
        bpy.ops.wm.window_close()
    yield from until(lambda: not running())
    result["problems_closed"] = list(part("scene.update").status(scene).problems)
    yield from until(lambda: len(ended) == 2, 10)

    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    ended.clear()
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: ended and not running())
    result["ended_again"] = list(ended)
    result["problems_again"] = list(part("scene.update").status(scene).problems)
    result["covered"] = part("scene.update").status(scene).covered


walk(steps(), result, FOLDER)
