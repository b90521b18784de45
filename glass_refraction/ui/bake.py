# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that bake and free, and what the panel shows of it."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene import update as door
from ..scene.bake.baking import Baking, free
from ..scene.bake.files import Contents, frame_ranges, geometry_bytes
from ..scene.bake.playback import baked
from ..scene.names import RefractiveGlassError, own
from ..viewport.jobs import holds_data
from . import staying
from .lines import draw_lines
from .stepwise import Steps, Stepwise


class SCENE_OT_refractive_glass_bake(Stepwise, bpy.types.Operator):
    """Store what is seen through the glasses in files, which render without the extension"""

    bl_idname = "scene.refractive_glass_bake"
    bl_label = "Bake Refractive Glass"
    # Not REGISTER: its panel would bake again whenever a value in it is touched.
    bl_options = {"UNDO"}

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where the files are written; empty for the one in the settings",
        subtype="DIR_PATH",
    )
    frame_start: bpy.props.IntProperty(
        name="Start", description="First frame; -1 takes the scene's", default=-1, min=-1
    )
    frame_end: bpy.props.IntProperty(
        name="End", description="Last frame; -1 takes the scene's", default=-1, min=-1
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.library is None and not own(context.scene)

    def _steps(self, context: bpy.types.Context) -> Steps:
        scene = context.scene
        baking = Baking(
            scene,
            context.evaluated_depsgraph_get(),
            self.directory,
            scene.frame_start if self.frame_start < 0 else self.frame_start,
            scene.frame_end if self.frame_end < 0 else self.frame_end,
        )
        try:
            yield from baking.steps()
            dropped = frame_ranges(baking.dropped)
        except BaseException:
            # Whatever it is: the scene must not be left as one that is being baked.
            baking.cancel()
            raise
        return baking, dropped, baking.finish()

    def _end(self, found: tuple[Baking, str, Contents]) -> set[str]:
        baking, dropped, contents = found
        for problem in baking.problems:
            self.report({"WARNING"}, problem)
        if dropped:
            self.report({"WARNING"}, f"Frames {dropped} no longer fit the scene and are gone")
        frames = frame_ranges(contents.frames)
        size = f"{1e-6 * geometry_bytes(baking.folder):,.1f} MB"
        self.report({"INFO"}, f"Baked frames {frames} in {baking.directory}, {size}: save the file")
        return {"FINISHED"}


class SCENE_OT_refractive_glass_bake_free(bpy.types.Operator):
    """Remove the baked files and compute again what is seen through the glasses"""

    bl_idname = "scene.refractive_glass_bake_free"
    bl_label = "Free Baked Refractive Glass"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if holds_data():
            cls.poll_message_set(_rpt("A render is going on: wait for its end"))
            return False
        return baked(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        try:
            left = free(scene)
            door.prepare(scene, context.evaluated_depsgraph_get())
        except (RefractiveGlassError, OSError) as error:
            # What stands in the way of computing is no reason to keep the bake.
            self.report({"WARNING"}, str(error))
            return {"FINISHED"}
        if left is not None:
            self.report({"INFO"}, f"{left} stays: it holds other files or another file's bake")
        return {"FINISHED"}


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The panel's piece: the folder, the two operators, what is baked."""
    scene = context.scene
    column = layout.column()
    bake = baked(scene)
    row = column.row()
    row.enabled = bake is None
    row.prop(scene.refractive_glass, "bake_directory")
    row = column.row(align=True)
    row.operator_context = "INVOKE_DEFAULT"
    row.operator(SCENE_OT_refractive_glass_bake.bl_idname, text="Bake")
    row.operator(SCENE_OT_refractive_glass_bake_free.bl_idname, text="Free")
    if bake is not None:
        text = f"Baked frames {bake.frames} in {bake.directory}"
        draw_lines(column, context, text, "FREEZE")
        draw_lines(column, context, "Changes are not seen until it is baked again or freed", "INFO")
        if not bake.first <= scene.frame_current <= bake.last:
            nearest = min(max(scene.frame_current, bake.first), bake.last)
            text = f"Frame {scene.frame_current} shows frame {nearest}: it is not baked"
            draw_lines(column, context, text, "ERROR")


register, unregister = staying.classes(
    (SCENE_OT_refractive_glass_bake, SCENE_OT_refractive_glass_bake_free)
)
