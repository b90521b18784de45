# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of README and guide: their first glass, step by step, and its comparison.

    blender --factory-startup --python scripts/screenshots.py -- FOLDER [LAST]

LAST names the last picture that is wanted: add_menu, first_glass or compare, which is all. The
extension must be installed and enabled. ``xdotool`` and ImageMagick's ``import`` act on the screen:
Blender's own screenshots leave menus out. Quits Blender when it is done.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from first_glass import build

FOLDER, LAST = (*sys.argv[sys.argv.index("--") + 1 :], "compare")[:2]
FOLDER = Path(FOLDER)
PATIENCE = 300
"""Seconds for the view's final picture, in a software renderer on a busy machine."""
VIEWS = "bl_ext.user_default.refractive_glass.glass_refraction.viewport.views"


def screenshot(name: str) -> None:
    """The whole screen as NAME.png."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    subprocess.run(["import", "-window", "root", str(FOLDER / f"{name}.png")], check=True)


def view_3d() -> dict:
    """Where the operators of a 3D view find it."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    return {"window": window, "area": area, "region": region}


def comparing() -> bool:
    """Whether a comparison goes on."""
    window = bpy.context.window_manager.windows[0]
    kinds = {operator.bl_idname for operator in window.modal_operators}
    return "SCENE_OT_refractive_glass_compare" in kinds


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    yield 2
    subprocess.run(["xdotool", "mousemove", "300", "450", "key", "Escape"], check=True)
    yield 1
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.wm.call_menu(name="VIEW3D_MT_refractive_glass_add")
    # Blender reads the icons in the background.
    yield 8
    screenshot("add_menu")
    if LAST == "add_menu":
        return
    subprocess.run(["xdotool", "key", "Escape"], check=True)
    yield 1
    with bpy.context.temp_override(**view_3d()):
        area = bpy.context.area
        glass = build()
        view = area.spaces.active.region_3d
        view.view_location, view.view_distance = (0.0, 0.0, 1.3), 7.0
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = glass
        area.spaces.active.show_region_ui = True
    yield 2
    sidebar = next(r for r in area.regions if r.type == "UI")
    sidebar.active_panel_category = "Glass"
    for _ in range(PATIENCE):
        yield 1
        if sys.modules[VIEWS].at_rest():
            break
    yield 2
    screenshot("first_glass")
    if LAST == "first_glass":
        return
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 32, False
    scene.render.resolution_percentage = 25
    with bpy.context.temp_override(**view_3d()):
        # The view rests while the machine renders.
        bpy.context.window_manager.refractive_glass_overlay = False
        bpy.ops.scene.refractive_glass_compare("INVOKE_DEFAULT", directory=str(FOLDER / "compare"))
    yield 1
    while comparing():
        yield 1
    yield 3
    shutil.copy(FOLDER / "compare" / "comparison.png", FOLDER / "compare.png")


def _run() -> float | None:
    try:
        return next(_walk)
    except StopIteration:
        pass
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()
    return None


_walk = steps()
bpy.app.timers.register(_run, first_interval=3)
