# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences in panels: Blender cuts a label off where the panel ends, so they are wrapped."""

from __future__ import annotations

import textwrap

import bpy

_PIXELS_PER_LETTER = 7.0
"""At a scale of 1; a little more than the mean, so that nothing is cut off."""
_MARGIN = 60


def draw_lines(
    layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE"
) -> None:
    """Draw a sentence in as many lines as the region's width asks for; the icon on the first."""
    scale = context.preferences.system.ui_scale
    width = context.region.width / scale - _MARGIN if context.region is not None else 400
    column = layout.column(align=True)
    for line in textwrap.wrap(text, max(20, int(width / _PIXELS_PER_LETTER))):
        column.label(text=line, icon=icon, translate=False)
        icon = "BLANK1" if icon != "NONE" else icon
