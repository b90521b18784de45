# SPDX-License-Identifier: GPL-3.0-or-later
"""The switch of the refracted picture: first in the Overlays popover and in the sidebar's tab."""

from __future__ import annotations

import bpy

from ..scene.read.glasses import glass_objects
from ..viewport import views
from . import staying
from .asset_library import shows_first_glass
from .lines import draw_lines


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


def show_first_glass(context: bpy.types.Context) -> None:
    """Switch the picture on in the view where a glass was added, if it is the scene's only one.

    The preferences may say not to.
    """
    space = _space(context)
    if space is None or not shows_first_glass(context):
        return
    if len(glass_objects(context.view_layer)) == 1:
        views.show(space, True)


def draw_switch(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The switch and, while it is on, what there is to say of the view."""
    layout.prop(context.window_manager, "refractive_glass_overlay")
    if _is_on(context.window_manager):
        column = layout.column(align=True)
        column.active = False
        for line in views.status(context.space_data):
            draw_lines(column, context, line)


def _draw_overlay(popover: bpy.types.Panel, context: bpy.types.Context) -> None:
    draw_switch(popover.layout, context)


class VIEW3D_PT_refractive_glass_view(staying.StayingPanel, bpy.types.Panel):
    """In the 3D view's sidebar, above all else of the tab"""

    bl_idname = "VIEW3D_PT_refractive_glass_view"
    bl_label = "Refracted Picture"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Glass"
    bl_options = {"HIDE_HEADER"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_switch(self.layout, context)


_register, _unregister = staying.classes((VIEW3D_PT_refractive_glass_view,))


def register() -> None:
    """Register the switch and show it."""
    new = bpy.props.BoolProperty(
        name="Refracted Picture",
        description="Show in this view what is seen through the refractive glasses",
        get=_is_on,
        set=_set,
        options={"SKIP_SAVE"},
    )
    staying.hang(bpy.types.WindowManager, "refractive_glass_overlay", new)
    _register()
    bpy.types.VIEW3D_PT_overlay.prepend(_draw_overlay)
    views.register()


def unregister() -> None:
    """Undo :func:`register`."""
    views.unregister()
    bpy.types.VIEW3D_PT_overlay.remove(_draw_overlay)
    _unregister()
    staying.take_off(bpy.types.WindowManager, "refractive_glass_overlay")
