# SPDX-License-Identifier: GPL-3.0-or-later
"""The guide's screenshots: a slab before the default cube, in a Blender with a window.

    blender --factory-startup --python scripts/screenshots.py -- FOLDER

The extension must be installed and enabled. ``xdotool`` and ImageMagick's ``import`` act on the
screen: Blender's own screenshots leave menus out. Quits Blender when it is done.
"""

from __future__ import annotations

import subprocess
import sys
import traceback
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])


def screenshot(name: str) -> None:
    """The whole screen as NAME.png."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    subprocess.run(["import", "-window", "root", str(FOLDER / f"{name}.png")], check=True)


def click(x: float, y: float) -> None:
    """Press the left mouse button at a place of the screen, pixels from its upper left corner."""
    subprocess.run(["xdotool", "mousemove", str(int(x)), str(int(y)), "click", "1"], check=True)


def view_3d() -> dict:
    """Where the operators of a 3D view find it."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    return {"window": window, "area": area, "region": region}


def properties(tab: str) -> None:
    """Show a tab in the Properties editor."""
    area = next(a for a in bpy.context.screen.areas if a.type == "PROPERTIES")
    area.spaces.active.context = tab


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.render.resolution_percentage = 40
    yield 2
    subprocess.run(["xdotool", "mousemove", "300", "450", "key", "Escape"], check=True)
    yield 1
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.wm.call_menu(name="VIEW3D_MT_refractive_glass_add")
    yield 1
    screenshot("add_menu")
    subprocess.run(["xdotool", "key", "Escape"], check=True)
    yield 1
    with bpy.context.temp_override(**view_3d()):
        area = bpy.context.area
        bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT",
            shape="SLAB",
            radius=0.8,
            wall_thickness=0.6,
            location=(2, -2.5, 1.6),
            rotation=(1.5708, 0, 0),
        )
        bpy.ops.ed.undo_push(message="Add Refractive Glass")
        area.spaces.active.show_region_ui = True
        bpy.ops.view3d.view_camera()
        bpy.ops.view3d.view_center_camera()
    yield 2
    # Scripts cannot choose a sidebar's tab. Ours is the fifth: Item, Tool, View, Animation, Glass.
    sidebar = next(r for r in area.regions if r.type == "UI")
    window = bpy.context.window_manager.windows[0]
    click(sidebar.x + sidebar.width - 10, window.height - sidebar.y - sidebar.height + 240)
    properties("OBJECT")
    yield 3
    screenshot("glass_added")
    with bpy.context.temp_override(**view_3d()):
        bpy.context.space_data.shading.type = "MATERIAL"
        bpy.context.window_manager.refractive_glass_overlay = True
    # EEVEE compiles its shaders first.
    yield 15
    screenshot("refracted_picture")
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.wm.call_panel(name="VIEW3D_PT_overlay", keep_open=True)
    yield 2
    screenshot("overlays")
    subprocess.run(["xdotool", "mousemove", "300", "450", "key", "Escape"], check=True)
    yield 1
    properties("RENDER")
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.render.render("INVOKE_DEFAULT")
    while not done:
        yield 1
    yield 3
    screenshot("rendered")


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
