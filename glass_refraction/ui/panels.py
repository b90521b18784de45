# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's settings and status in the render properties, the 3D view's sidebar."""

from __future__ import annotations

import bpy

from ..scene import update as door
from . import bake
from .operators import (
    OBJECT_OT_refractive_glass_modifier_add,
    SCENE_OT_refractive_glass_compare,
    SCENE_OT_refractive_glass_update,
)


class _Settings:
    """Draws the scene's settings and what the last update did."""

    bl_label = "Refractive Glass"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.refractive_glass, "enabled", text="")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.refractive_glass
        layout.active = settings.enabled
        for name in ("shading", "surface", "lookup_samples", "tolerance_px", "min_weight"):
            layout.prop(settings, name)
        found = door.status(context.scene)
        column = layout.column(align=True)
        for problem in found.problems:
            column.label(text=problem, icon="ERROR")
        if found.paths:
            column.label(text=f"Paths: {', '.join(found.paths)}")
            column.label(text=f"Vertices: {found.vertices:,}")
            column.label(text=f"Last update: {found.milliseconds:.0f} ms")
            column.label(text=f"Interpolation within {found.bound_px:.2f} px")
        row = layout.row(align=True)
        row.operator(SCENE_OT_refractive_glass_update.bl_idname, text="Update")
        row.operator(SCENE_OT_refractive_glass_compare.bl_idname, text="Compare")
        bake.draw(layout, context)


class RENDER_PT_refractive_glass(_Settings, bpy.types.Panel):
    """In the render properties"""

    bl_idname = "RENDER_PT_refractive_glass"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class VIEW3D_PT_refractive_glass(_Settings, bpy.types.Panel):
    """In the 3D view's sidebar"""

    bl_idname = "VIEW3D_PT_refractive_glass"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Glass"

    def draw(self, context: bpy.types.Context) -> None:
        super().draw(context)
        self.layout.operator(
            OBJECT_OT_refractive_glass_modifier_add.bl_idname, text="Make Active a Glass"
        )


CLASSES = (RENDER_PT_refractive_glass, VIEW3D_PT_refractive_glass)


def register() -> None:
    """Register the panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo :func:`register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
