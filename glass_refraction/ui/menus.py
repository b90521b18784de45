# SPDX-License-Identifier: GPL-3.0-or-later
"""Add > Mesh > Refractive Glass, Add Modifier > Refractive Glass."""

from __future__ import annotations

import bpy

from . import staying
from .everyday import OBJECT_OT_refractive_glass_everyday_add
from .icons import icon_of
from .operators import (
    SHAPES,
    OBJECT_OT_refractive_glass_add,
    OBJECT_OT_refractive_glass_modifier_add,
)
from .presets import PRESETS
from .starter import SCENE_OT_refractive_glass_starter

_SHAPE_ICONS = {
    "SLAB": "MESH_PLANE",
    "CYLINDER": "MESH_CYLINDER",
    "ROD": "MESH_CYLINDER",
    "SPHERE": "MESH_UVSPHERE",
    "TUMBLER": "MESH_CYLINDER",
    "REVOLUTION": "CURVE_DATA",
}


class VIEW3D_MT_refractive_glass_add(bpy.types.Menu):
    """Everyday glasses, and below them the shapes"""

    bl_idname = "VIEW3D_MT_refractive_glass_add"
    bl_label = "Refractive Glass"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_REGION_WIN"
        everyday = OBJECT_OT_refractive_glass_everyday_add.bl_idname
        for preset in PRESETS:
            number = icon_of(preset)
            shown = {"icon_value": number} if number else {"icon": preset.icon}
            operator = layout.operator(everyday, text=preset.label, **shown)
            operator.kind = preset.identifier
        layout.separator()
        layout.menu(VIEW3D_MT_refractive_glass_shapes.bl_idname)
        layout.operator(SCENE_OT_refractive_glass_starter.bl_idname, icon="SCENE_DATA")


class VIEW3D_MT_refractive_glass_shapes(bpy.types.Menu):
    """The plain shapes, for glasses of one's own sizes"""

    bl_idname = "VIEW3D_MT_refractive_glass_shapes"
    bl_label = "Shapes"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_REGION_WIN"
        add = OBJECT_OT_refractive_glass_add.bl_idname
        for shape, label, _ in SHAPES:
            layout.operator(add, text=label, icon=_SHAPE_ICONS[shape]).shape = shape


def _draw_add(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.separator()
    menu.layout.menu(VIEW3D_MT_refractive_glass_add.bl_idname, icon="MESH_CYLINDER")


def _draw_add_modifier(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    if context.object is None or context.object.type != "MESH":
        return
    menu.layout.separator()
    menu.layout.operator_context = "INVOKE_REGION_WIN"
    menu.layout.operator(
        OBJECT_OT_refractive_glass_modifier_add.bl_idname,
        text="Refractive Glass",
        icon="MESH_CYLINDER",
    )


_register, _unregister = staying.classes(
    (VIEW3D_MT_refractive_glass_shapes, VIEW3D_MT_refractive_glass_add)
)


def register() -> None:
    """Register the menu and hang the entries into Blender's."""
    _register()
    bpy.types.VIEW3D_MT_mesh_add.append(_draw_add)
    bpy.types.OBJECT_MT_modifier_add.append(_draw_add_modifier)


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.types.OBJECT_MT_modifier_add.remove(_draw_add_modifier)
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw_add)
    _unregister()
