# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender and its engines do, as far as it matters to a view's pictures."""

from __future__ import annotations

import bpy

DRAW_AT_ONCE = ("BLENDER_EEVEE", "BLENDER_WORKBENCH")
"""Blender's own engines: all others render in threads of theirs."""


def is_compiling() -> bool:
    """Whether Blender compiles materials: engines show stand-ins for them meanwhile."""
    return bpy.app.is_job_running("SHADER_COMPILATION")


def is_rendering() -> bool:
    """Whether a render or a bake goes on: data stay as they are until it ends."""
    return bpy.app.is_job_running("RENDER") or bpy.app.is_job_running("OBJECT_BAKE")


def holds_data() -> bool:
    """Whether a job uses data that must not be freed: a render, a bake, or the compositor.

    Where an Image Editor shows a render's picture and the compositor's tree has changed, Blender
    composites the picture once more, in a thread.
    """
    return is_rendering() or bpy.app.is_job_running("COMPOSITE")


def amends_depths(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> bool:
    """Whether EEVEE draws a view, whose depths are amended: see `glsl.AMENDED`."""
    kind = space.shading.type
    return kind == "MATERIAL" or (kind == "RENDERED" and "EEVEE" in scene.render.engine)


def draws_off_screen(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> bool:
    """Whether a view's engine draws a whole picture in one go: Cycles first shows a black one."""
    return space.shading.type != "RENDERED" or scene.render.engine in DRAW_AT_ONCE


def samples_of_engine(
    space: bpy.types.SpaceView3D, preferences: bpy.types.Preferences
) -> int | None:
    """Redraws in which an engine refines what a view shows; None: who knows.

    Solid shading's adds a sample with each. EEVEE does not keep to its number.
    """
    if space.shading.type != "SOLID":
        return None
    kind = preferences.system.viewport_aa
    return int(kind) if kind.isdigit() else 1
