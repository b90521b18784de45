# SPDX-License-Identifier: GPL-3.0-or-later
"""Add > Mesh > Refractive Glass."""

from __future__ import annotations

import bpy

from .operators import SHAPES, OBJECT_OT_refractive_glass_add


class VIEW3D_MT_refractive_glass_add(bpy.types.Menu):
    """The shapes of glass"""

    bl_idname = "VIEW3D_MT_refractive_glass_add"
    bl_label = "Refractive Glass"

    def draw(self, _context: bpy.types.Context) -> None:
        for shape, label, _ in SHAPES:
            operator = self.layout.operator(OBJECT_OT_refractive_glass_add.bl_idname, text=label)
            operator.shape = shape


def _draw_add(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.separator()
    menu.layout.menu(VIEW3D_MT_refractive_glass_add.bl_idname, icon="MESH_CYLINDER")


def register() -> None:
    """Register the menu and hang it into Add > Mesh."""
    bpy.utils.register_class(VIEW3D_MT_refractive_glass_add)
    bpy.types.VIEW3D_MT_mesh_add.append(_draw_add)


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.types.VIEW3D_MT_mesh_add.remove(_draw_add)
    bpy.utils.unregister_class(VIEW3D_MT_refractive_glass_add)
