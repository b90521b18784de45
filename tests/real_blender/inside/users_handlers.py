# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: handlers of the user's that hide a thing at every event, beside a glass.

Argument: output folder. The handlers are added after the extension's, as a script's are.
"""

import json
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])
EVENTS = (
    *("depsgraph_update_pre", "depsgraph_update_post", "frame_change_pre", "frame_change_post"),
    *("render_init", "render_pre", "render_post", "render_write"),
)


def main():
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.filepath = str(FOLDER / "frame_")
    scene.frame_end = 2
    thing = bpy.data.objects["Cube"]
    bpy.ops.object.refractive_glass_add(shape="CYLINDER", radius=2, wall_thickness=0.2, height=3)
    bpy.ops.scene.refractive_glass_update()
    hidden = []

    def hide(*_):
        # Not for ever: that a handler changes something is an event as well.
        if len(hidden) < 100:
            thing.hide_render = not thing.hide_render
            hidden.append(event)

    for event in EVENTS:
        hidden.clear()
        handlers = getattr(bpy.app.handlers, event)
        handlers.append(hide)
        for frame in (2, 1):
            scene.frame_set(frame)
            thing.location.x = frame
            bpy.context.view_layer.update()
        bpy.ops.render.render(animation=True)
        handlers.remove(hide)
        assert hidden, event
    (FOLDER / "result.json").write_text(json.dumps({"events": len(EVENTS)}))


main()
