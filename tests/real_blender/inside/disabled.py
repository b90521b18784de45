# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: the extension is disabled while it is at work.

Argument: output folder. Each part tells what it was disabled at and what was left a while later.
"""

import shutil
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from windowed import prepared, until, view_3d, walk

FOLDER = Path(sys.argv[-1])
MODULE = "bl_ext.user_default.refractive_glass"
KINDS = ("scenes", "objects", "meshes", "cameras", "collections", "materials", "images")
OF_A_GLASS = {"glass", "shadow"}
result = {}


def part(name):
    return sys.modules[f"{MODULE}.glass_refraction.{name}"]


def running():
    return bpy.app.is_job_running("RENDER")


def disable():
    bpy.ops.preferences.addon_disable(module=MODULE)


def enable():
    bpy.ops.preferences.addon_enable(module=MODULE)


def left():
    """What of the extension's is in the file beside the glasses, and what it left otherwise."""
    found = [
        f"{kind}: {block.name}"
        for kind in KINDS
        for block in getattr(bpy.data, kind)
        if "refractive_glass" in block and block["refractive_glass"] not in OF_A_GLASS
    ]
    inputs = part("scene.read.modifier_inputs")
    for name, wanted in (("Show in Render", True), ("Edges in Viewport", False)):
        value = inputs.read_input(bpy.data.objects["Glass"].modifiers[0], name)
        if value != wanted:
            found.append(f"{name}: {value}")
    display = bpy.context.preferences.view.render_display_type
    if display != "NONE":
        found.append(f"renders show in: {display}")
    return found


def fresh(engine="BLENDER_WORKBENCH", shading="TRUE", size=(160, 120)):
    """A scene with a cube in a glass, in Blender's window."""
    bpy.ops.wm.read_homefile(use_factory_startup=False, use_empty=False, load_ui=False)
    scene = bpy.context.scene
    render = scene.render
    render.engine, render.resolution_percentage = engine, 100
    render.resolution_x, render.resolution_y = size
    scene.cycles.samples, scene.cycles.use_denoising = 32, False
    scene.refractive_glass.shading = shading
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT", shape="CYLINDER", radius=2.0, wall_thickness=0.2, height=3.0
        )
        bpy.context.window_manager.refractive_glass_overlay = False
    bpy.context.view_layer.objects.active.name = "Glass"
    return scene


def invoke(operator, **properties):
    with bpy.context.temp_override(**view_3d()):
        operator("INVOKE_DEFAULT", **properties)


def doing(beginning):
    """Steps: until the render's thread says that it does something like this."""
    told = part("scene.progress").doing
    while running() and not (told() or "").startswith(beginning):
        yield 0.01


def rest(name):
    """Steps: until nothing is left of what was disabled, but no longer than needed for that."""
    yield from ended()
    yield from until(lambda: not left(), 5)
    result[name]["left"] = left()
    enable()
    yield 0.2


def rendered_while_computed():
    """In the render's thread the extension reads the scene's settings, which go."""
    yield from prepared(fresh(size=(1280, 720)))
    invoke(bpy.ops.render.render)
    yield from doing("following light")
    yield 0.3
    result["computed"] = {"at": part("scene.progress").doing()}
    disable()
    result["computed"]["after"] = part("scene.progress").doing()
    yield from rest("computed")


def rendered_while_drawn():
    """The engine draws an own scene: it crashed where that was freed."""
    yield from prepared(fresh("CYCLES"))
    invoke(bpy.ops.render.render)
    yield from doing("rendering what else")
    result["drawn"] = {"at": part("scene.progress").doing(), "running": running()}
    disable()
    yield from rest("drawn")


def enabled_again():
    """Blender lists None in place of the operators that watch for Esc."""
    yield from prepared(fresh(size=(1280, 720)))
    invoke(bpy.ops.render.render)
    yield from doing("following light")
    yield 0.5
    disable()
    enable()
    result["again"] = {"running": running()}
    yield from ended()
    scene = bpy.context.scene
    yield from prepared(scene)
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    completed = []
    bpy.app.handlers.render_complete.append(lambda *_: completed.append("complete"))
    invoke(bpy.ops.render.render)
    yield from ended()
    result["again"]["ended"] = completed
    result["again"]["problems"] = list(part("scene.update").status(scene).problems)
    result["again"]["covered"] = part("scene.update").status(scene).covered
    disable()
    yield from rest("again")


def ended():
    """Steps: until no render goes on, and what waits for that had its turn."""
    yield from until(lambda: not running())
    yield 0.4


def animated():
    """Blender draws what it laid out before an engine read the scene, once that is over."""
    scene = fresh("CYCLES")
    # Longer than what follows takes, by far: after it the rest is waited for.
    scene.frame_start, scene.frame_end = 1, 6
    scene.render.filepath = str(FOLDER / "frame_")
    yield from prepared(scene)
    invoke(bpy.ops.render.render, animation=True)
    yield from doing("rendering what else")
    panel = bpy.types.OBJECT_PT_refractive_glass
    disable()
    result["animated"] = {
        "running": running(),
        "stays": registered(),
        "shown": panel.poll(bpy.context),
    }
    # Again and again: what is enabled meanwhile takes the same panels back.
    for _ in range(4):
        yield 0.1
        enable()
        yield 0.1
        disable()
    yield from ended()
    yield from until(lambda: not any(registered().values()), 5)
    result["animated"]["ends"] = registered()
    yield from rest("animated")
    result["animated"]["back"] = panel.is_registered and panel.poll(bpy.context)


def registered():
    """What buttons that were laid out hold, and whether it is there: a panel and properties."""
    return {
        "panel": hasattr(bpy.types, "OBJECT_PT_refractive_glass"),
        "operator": hasattr(bpy.types, "OBJECT_OT_refractive_glass_add"),
        "settings": hasattr(bpy.types.Scene, "refractive_glass"),
        "medium": hasattr(bpy.types.Object, "refractive_glass_medium"),
    }


def compared():
    """A comparison hides the glass, changes settings and has a scene of its own rendered."""
    yield from prepared(fresh("CYCLES"))
    invoke(bpy.ops.scene.refractive_glass_compare, directory=str(FOLDER / "compare"), samples=16)
    yield from until(lambda: any(s.get("refractive_glass") == "reference" for s in bpy.data.scenes))
    yield from until(running)
    result["compared"] = {"running": running()}
    disable()
    yield from rest("compared")


def save():
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "saved.blend"))


def shown_picture(name):
    """What the Image Editor shows of the render, as a file would have it (N,)."""
    path = str(FOLDER / f"{name}.png")
    bpy.data.images["Render Result"].save_render(path)
    loaded = bpy.data.images.load(path)
    pixels = np.array(loaded.pixels[:])
    bpy.data.images.remove(loaded)
    return pixels


def composited():
    """Blender's compositor works on a render's picture once more, from what the extension made."""
    scene = fresh(size=(480, 270))
    yield from prepared(scene)
    invoke(bpy.ops.render.render)
    yield from ended()
    area = next(a for a in bpy.context.window.screen.areas if a.type == "OUTLINER")
    area.ui_type = "IMAGE_EDITOR"
    area.spaces.active.image = bpy.data.images["Render Result"]
    yield 0.2
    result["composited"] = {"running": []}
    before = shown_picture("before")
    for leave in (save, disable):
        # What a saved file does not hold is made anew: the tree has changed.
        save()
        yield from until(lambda: bpy.app.is_job_running("COMPOSITE"), 20)
        result["composited"]["running"].append(bpy.app.is_job_running("COMPOSITE"))
        leave()
        yield from until(lambda: not bpy.app.is_job_running("COMPOSITE"), 60)
        if leave is save:
            yield 0.5
            # Blender looks into no file that is open.
            copy = shutil.copy(FOLDER / "saved.blend", FOLDER / "copy.blend")
            with bpy.data.libraries.load(str(copy)) as (saved, _):
                result["composited"]["saved"] = list(saved.scenes)
            # The compositor takes half as many digits then.
            changed = np.abs(shown_picture("after") - before).mean()
            result["composited"]["changed"] = float(changed)
    yield from rest("composited")
    area.ui_type = "OUTLINER"


def baked():
    scene = fresh(shading="DISPLACED")
    scene.frame_start, scene.frame_end = 1, 40
    yield from prepared(scene)
    invoke(bpy.ops.scene.refractive_glass_bake, directory=str(FOLDER / "bake"))
    yield 0.3
    result["baked"] = {"under_way": len(part("scene.bake.playback").under_way)}
    disable()
    result["baked"]["after"] = len(part("scene.bake.playback").under_way)
    result["baked"]["files"] = [p.name for p in (FOLDER / "bake").rglob("*") if p.is_file()]
    yield from rest("baked")


def shown():
    """The refracted picture of a view, while something moves in it."""
    fresh()
    yield 0.2
    with bpy.context.temp_override(**view_3d()):
        bpy.context.window_manager.refractive_glass_overlay = True
    yield from until(part("viewport.views").at_rest)
    invoke(bpy.ops.screen.animation_play)
    yield 0.5
    result["shown"] = {"handles": len(part("viewport.views")._handles)}
    disable()
    result["shown"]["after"] = len(part("viewport.views")._handles)
    yield 0.5
    invoke(bpy.ops.screen.animation_play)
    yield from rest("shown")


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    # Other scripts open Blender with the same preferences.
    bpy.context.preferences.use_preferences_save = False
    bpy.context.preferences.view.render_display_type = "NONE"
    yield 0.2
    yield from rendered_while_computed()
    yield from rendered_while_drawn()
    yield from enabled_again()
    yield from animated()
    yield from compared()
    yield from composited()
    yield from baked()
    yield from shown()


walk(steps(), result, FOLDER)
