# SPDX-License-Identifier: GPL-3.0-or-later
"""The Add menu's icons, made by ``scripts/icons.py``: read once, kept by Blender."""

from __future__ import annotations

from pathlib import Path

import bpy.utils.previews

from .presets import Preset

FOLDER = Path(__file__).with_name("icons")

_kept: dict[str, bpy.utils.previews.ImagePreviewCollection] = {}
"""One collection while the extension is enabled."""


def icon_of(preset: Preset) -> int:
    """Blender's number of a preset's icon; 0 where there is none."""
    icons = _kept.get("glasses")
    found = None if icons is None else icons.get(preset.identifier)
    return 0 if found is None else found.icon_id


def register() -> None:
    """Read the icons."""
    icons = _kept["glasses"] = bpy.utils.previews.new()
    for path in sorted(FOLDER.glob("*.png")):
        icons.load(path.stem.upper(), str(path), "IMAGE")


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.utils.previews.remove(_kept.pop("glasses"))
