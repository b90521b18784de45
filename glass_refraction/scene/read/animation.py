# SPDX-License-Identifier: GPL-3.0-or-later
"""Which properties another frame may have changed, and which objects another time moves."""

from __future__ import annotations

import bpy

_PLACING = ("location", "scale", "rotation_euler", "rotation_quaternion", "rotation_axis_angle")
_PLACING += tuple(f"delta_{name}" for name in _PLACING[:-1])
"""RNA paths of what places an object."""
_MOVING = {"ARMATURE", "BUILD", "CLOTH", "EXPLODE", "FLUID", "HOOK", "LATTICE", "MESH_CACHE"}
_MOVING |= {"MESH_DEFORM", "MESH_SEQUENCE_CACHE", "OCEAN", "PARTICLE_SYSTEM", "SOFT_BODY", "WAVE"}
"""Types of the modifiers that mostly show another shape at another time."""


def may_move(obj: bpy.types.Object) -> bool:
    """Whether the object may stand elsewhere, or have another shape, at another time."""
    if obj.constraints or obj.rigid_body is not None or may_change(obj, *_PLACING):
        return True
    # Bones are animated by many paths.
    if obj.type == "ARMATURE" and obj.animation_data is not None:
        return True
    if any(modifier.type in _MOVING for modifier in obj.modifiers):
        return True
    keys = getattr(obj.data, "shape_keys", None)
    if keys is not None and keys.animation_data is not None:
        return True
    return obj.parent is not None and may_move(obj.parent)


def may_change(data_block: bpy.types.ID, *paths: str) -> bool:
    """Whether any of the properties (RNA paths from the data-block) is animated or driven.

    Strips of the Nonlinear Animation editor are taken to move anything.
    """
    animation = data_block.animation_data
    if animation is None:
        return False
    if animation.nla_tracks or any(curve.data_path in paths for curve in animation.drivers):
        return True
    return any(
        curve.data_path in paths
        for layer in (animation.action.layers if animation.action else ())
        for strip in layer.strips
        for bag in strip.channelbags
        for curve in bag.fcurves
    )
