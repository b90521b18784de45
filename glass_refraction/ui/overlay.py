# SPDX-License-Identifier: GPL-3.0-or-later
"""The toggle of the refracted picture, beside the other overlays of a 3D view."""

from __future__ import annotations

import bpy

from ..viewport import views


def _space(context: bpy.types.Context) -> bpy.types.SpaceView3D | None:
    space = context.space_data
    return space if isinstance(space, bpy.types.SpaceView3D) else None


def _is_on(_manager) -> bool:
    space = _space(bpy.context)
    return space is not None and views.is_shown(space)


def _set(_manager, on: bool) -> None:
    space = _space(bpy.context)
    if space is not None:
        views.show(space, on)


class VIEW3D_PT_overlay_refractive_glass(bpy.types.Panel):
    """Of the Overlays popover"""

    bl_idname = "VIEW3D_PT_overlay_refractive_glass"
    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"
    bl_parent_id = "VIEW3D_PT_overlay"
    bl_label = "Refractive Glass"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.prop(context.window_manager, "refractive_glass_overlay")
        if views.is_shown(context.space_data):
            column = layout.column(align=True)
            column.active = False
            for line in views.status(context.space_data):
                column.label(text=line)


def register() -> None:
    """Register the toggle and its panel."""
    bpy.types.WindowManager.refractive_glass_overlay = bpy.props.BoolProperty(
        name="Refracted Picture",
        description="Show in this view what is seen through the refractive glasses",
        get=_is_on,
        set=_set,
        options={"SKIP_SAVE"},
    )
    bpy.utils.register_class(VIEW3D_PT_overlay_refractive_glass)
    views.register()


def unregister() -> None:
    """Undo :func:`register`."""
    views.unregister()
    bpy.utils.unregister_class(VIEW3D_PT_overlay_refractive_glass)
    del bpy.types.WindowManager.refractive_glass_overlay
