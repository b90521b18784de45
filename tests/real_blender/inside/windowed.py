# SPDX-License-Identifier: GPL-3.0-or-later
"""What scripts inside Blender with a window share."""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy


def walk(steps, result, folder, first=0.5):
    """Run steps, each ``yield`` of which gives Blender that many seconds to draw.

    At their end ``result`` is written where the test looks for it, and Blender quits; it quits
    without where they fail.
    """
    name = Path(sys.argv[sys.argv.index("--python") + 1]).stem

    def advance():
        try:
            print(f"{name}: line {steps.gi_frame.f_lineno}", flush=True)
            return next(steps)
        except StopIteration:
            (folder / "result.json").write_text(json.dumps(result))
        except Exception:
            traceback.print_exc()
        bpy.ops.wm.quit_blender()
        return None

    bpy.app.timers.register(advance, first_interval=first, persistent=True)


def until(condition, seconds=240):
    """Steps: until a condition holds, at most so many seconds; whether it does."""
    end = time.perf_counter() + seconds
    while not condition() and time.perf_counter() < end:
        yield 0.05
    return condition()


def prepared(scene):
    """Steps: until a render of the scene would show its glass."""
    package = "bl_ext.user_default.refractive_glass.glass_refraction"
    own_scenes = sys.modules[f"{package}.scene.build.own_scenes"]
    yield from until(lambda: own_scenes.find_own_scenes(scene))
    yield 0.2


def view_3d():
    """Where operators of the first window's 3D view run."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    return {"window": window, "area": area, "region": region}
