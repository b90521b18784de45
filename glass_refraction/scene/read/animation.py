# SPDX-License-Identifier: GPL-3.0-or-later
"""Which properties another frame may have changed."""

from __future__ import annotations

import bpy


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
