# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender is busy with, as far as it keeps a view's pictures from being made."""

from __future__ import annotations

import bpy


def is_compiling() -> bool:
    """Whether Blender compiles materials: engines show stand-ins for them meanwhile."""
    return bpy.app.is_job_running("SHADER_COMPILATION")


def is_rendering() -> bool:
    """Whether a render or a bake goes on: data stay as they are until it ends."""
    return bpy.app.is_job_running("RENDER") or bpy.app.is_job_running("OBJECT_BAKE")
