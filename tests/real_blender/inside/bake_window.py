# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: bake from the panel's operator, render with F12, cancel with Esc.

Argument: output folder. Takes screenshots, writes what it found as the result, quits.
"""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from windowed import until, view_3d, walk

FOLDER = Path(sys.argv[-1])
MODULE = "bl_ext.user_default.refractive_glass.glass_refraction"

result = {}


def screenshot(name):
    subprocess.run(["import", "-window", "root", FOLDER / f"{name}.png"], check=True)


def baked(scene):
    found = sys.modules[f"{MODULE}.scene.bake.playback"].baked(scene)
    return None if found is None else found.frames


def counters():
    return dict(sys.modules[f"{MODULE}.scene.update"].counters)


def invoke(**given):
    with bpy.context.temp_override(**view_3d()):
        return list(bpy.ops.scene.refractive_glass_bake("INVOKE_DEFAULT", **given))


def rendered(scene, name):
    """F12, in its own thread; the picture as it was saved."""
    ended = []
    lists = (bpy.app.handlers.render_complete, bpy.app.handlers.render_cancel)
    notes = [lambda *_: ended.append("complete"), lambda *_: ended.append("cancelled")]
    for handlers, note in zip(lists, notes, strict=True):
        handlers.append(note)
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    for handlers, note in zip(lists, notes, strict=True):
        handlers.remove(note)
    path = FOLDER / f"{name}.exr"
    bpy.data.images["Render Result"].save_render(str(path), scene=scene)
    for window in list(bpy.context.window_manager.windows)[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    image = bpy.data.images.load(str(path))
    result[f"{name}_ended"] = ended
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    yield 0.2
    return values


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 160, 120, 100
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 2, False
    image = render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.refractive_glass.surface = "REFRACTION"
    # True shading is not baked.
    scene.refractive_glass.shading = "DISPLACED"
    scene.frame_start, scene.frame_end = 1, 40
    cube = bpy.data.objects["Cube"]
    for frame, x in ((1, 0.0), (40, 1.0)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    with bpy.context.temp_override(**view_3d()):
        bpy.context.area.spaces.active.show_region_ui = True
        bpy.ops.object.refractive_glass_add(
            shape="CYLINDER", radius=2.0, wall_thickness=0.2, height=3.0, location=(0, 0, -1.5)
        )
    yield 0.2
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "window.blend"))
    scene.frame_set(3)
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.scene.refractive_glass_update()
    yield 0.2
    live = yield from rendered(scene, "live")

    result["invoked"] = invoke(frame_start=2, frame_end=5)
    yield from until(lambda: baked(scene))
    result["baked"] = baked(scene)
    result["frame_after_baking"] = scene.frame_current
    under_way = sys.modules[f"{MODULE}.scene.bake.playback"].under_way
    # What is still under way belongs to the bake, not to the render.
    yield from until(lambda: not under_way)
    yield 0.5
    screenshot("bake_done")
    before = counters()
    again = yield from rendered(scene, "again")
    result["difference"] = float(np.abs(again - live).max())
    result["solved"] = counters() != before
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.scene.refractive_glass_bake_free()
    result["folder_after_freeing"] = any(FOLDER.glob("window_bake*"))

    result["invoked_again"] = invoke()
    yield from until(lambda: scene.frame_current in range(4, 40))
    screenshot("bake_under_way")
    result["under_way"] = len(under_way)
    result["frame_under_way"] = scene.frame_current
    # The pointer must be over the window for it to get the key.
    subprocess.run(["xdotool", "mousemove", "300", "600", "key", "Escape"], check=True)
    yield from until(lambda: not under_way)
    result["baked_after_escape"] = baked(scene)
    result["folder_after_escape"] = any(FOLDER.glob("window_bake*"))
    result["frame_after_escape"] = scene.frame_current


walk(steps(), result, FOLDER)
