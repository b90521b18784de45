# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: what a newcomer does, one step after the other, between redraws.

Argument: output folder. Takes screenshots, writes what it found as the result, quits.
"""

import subprocess
import sys
from pathlib import Path

import addon_utils
import bpy

sys.path.insert(0, str(Path(__file__).parent))
from windowed import prepared, until, view_3d, walk

FOLDER = Path(sys.argv[-1])
MODULE = "bl_ext.user_default.refractive_glass"

result = {}


def screenshot(name):
    subprocess.run(["import", "-window", "root", FOLDER / f"{name}.png"], check=True)


def own_blocks():
    kinds = ("objects", "meshes", "scenes", "collections", "node_groups", "images", "materials")
    return [
        f"{kind}: {block.name}"
        for kind in kinds
        for block in getattr(bpy.data, kind)
        # What nobody uses is dropped when the file is saved, the deleted glass's material too.
        if "refractive_glass" in block and block.users > 0
    ]


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    scene = bpy.context.scene
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 160, 120, 100
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 2, False
    # Without the mirror images, whose many vertices would make this a test of patience.
    scene.refractive_glass.surface = "REFRACTION"
    yield 0.5
    with bpy.context.temp_override(**view_3d()):
        area = bpy.context.area
        area.spaces.active.show_region_ui = True
        # Operators called by a script leave no undo step of their own.
        bpy.ops.ed.undo_push(message="Start")
        # Round the default cube: its edges are seen bent near the verge.
        added = bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT",
            shape="CYLINDER",
            radius=2.0,
            wall_thickness=0.2,
            height=3.0,
            location=(0, 0, -1.5),
        )
        bpy.ops.ed.undo_push(message="Add glass")
    result["added"] = list(added)
    result["active"] = bpy.context.view_layer.objects.active.name
    views = sys.modules[f"{MODULE}.glass_refraction.viewport.views"]
    yield from until(views.at_rest)
    glass = bpy.context.object.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    result["evaluated_edges"] = len(glass.edges)
    with bpy.context.temp_override(**view_3d()):
        result["overlay"] = bpy.context.window_manager.refractive_glass_overlay
    result["problems_after_adding"] = problems(scene)
    screenshot("window_glass_added")

    ended = []
    bpy.app.handlers.render_complete.append(lambda *_: ended.append("complete"))
    bpy.app.handlers.render_cancel.append(lambda *_: ended.append("cancelled"))
    with bpy.context.temp_override(**view_3d()):
        # EEVEE in the view: a render's thread that told it to let go has crashed Blender.
        bpy.context.space_data.shading.type = "MATERIAL"
    draws = views.counters["draws"]
    yield from until(lambda: views.counters["draws"] > draws)
    yield from prepared(scene)
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: ended and not bpy.app.is_job_running("RENDER"))
    yield 0.5
    result["render"] = ended
    result["problems_after_rendering"] = problems(scene)
    screenshot("window_rendered")
    # The render's own window was drawn last: its GPU context is no good for the 3D view's captures.
    faces = views.counters["faces"]
    result["windows_after_render"] = len(bpy.context.window_manager.windows)
    bpy.data.objects["Cube"].location.x += 0.1
    yield 0.2
    result["rest_beside_render"] = yield from until(views.at_rest)
    result["faces_beside_render"] = views.counters["faces"] - faces
    result["failures"] = [view.failure for view in views._views.values()]
    bpy.data.images["Render Result"].save_render(str(FOLDER / "window_picture.png"))
    for window in list(bpy.context.window_manager.windows)[1:]:
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()
    (view,) = views._views.values()
    view.home = None
    result["at_home_beside_none"] = views._is_at_home(view, view_3d()["region"])
    with bpy.context.temp_override(**view_3d()):
        bpy.context.space_data.shading.type = "SOLID"
    yield 0.2

    with bpy.context.temp_override(**view_3d()):
        bpy.ops.ed.undo()
    yield 0.2
    result["objects_after_undo"] = sorted(o.name for o in bpy.context.scene.objects)
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.ed.redo()
    yield 0.2
    result["objects_after_redo"] = sorted(o.name for o in bpy.context.scene.objects)

    modifier = bpy.context.scene.objects["Refractive Glass"].modifiers[0]
    read = sys.modules[f"{MODULE}.glass_refraction.scene.read.modifier_inputs"].read_input
    for workspace, on in (("Modeling", False), ("Layout", True)):
        view_3d()["window"].workspace = bpy.data.workspaces[workspace]
        yield from until(lambda on=on: read(modifier, "Edges in Viewport") == on, 10)
        result[f"edges_in_{workspace}"] = read(modifier, "Edges in Viewport")

    addon_utils.disable(MODULE)
    yield 0.2
    result["disabled"] = not hasattr(bpy.types.Scene, "refractive_glass")
    addon_utils.enable(MODULE)
    yield 0.2
    result["enabled"] = hasattr(bpy.types.Scene, "refractive_glass")

    with bpy.context.temp_override(**view_3d()):
        for obj in [o for o in bpy.context.scene.objects if o.name.startswith("Refractive")]:
            bpy.data.objects.remove(obj)
    yield from until(lambda: not own_blocks(), 10)
    result["left_after_removal"] = own_blocks()


def problems(scene):
    module = sys.modules[f"{MODULE}.glass_refraction.scene.update"]
    return list(module.status(scene).problems)


walk(steps(), result, FOLDER)
