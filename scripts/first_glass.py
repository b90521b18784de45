# SPDX-License-Identifier: GPL-3.0-or-later
"""The first glass of README and guide: what its steps add to Blender's first scene."""

from __future__ import annotations

import math

import bpy


def build(**size: float) -> bpy.types.Object:
    """Add the glass of water, the table and the straw. Returns the glass.

    ``size`` : of the glass, metres, where no window tells what fits.
    """
    bpy.ops.object.refractive_glass_everyday_add("INVOKE_DEFAULT", kind="GLASS_OF_WATER", **size)
    glass = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=10)
    bpy.ops.mesh.primitive_cylinder_add(
        radius=0.06, depth=3.2, location=(0, 0, 1.7), rotation=(0, math.radians(20), 0)
    )
    return glass
