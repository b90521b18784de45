# SPDX-License-Identifier: GPL-3.0-or-later
"""The everyday glasses as assets, in a file that is written when they are asked for.

A Blender of its own writes it, so that nothing of the user's file is touched.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy

from .icons import FOLDER
from .presets import PRESETS

PREVIEW_PIXELS = 128
"""Side of a preview; the icons that it is made from are smaller."""
_PACKAGE_FOLDER = Path(__file__).resolve().parents[2]
_SCRIPT = """
import sys
from pathlib import Path
sys.path.insert(0, {!r})
from glass_refraction.ui.everyday_assets import write
write(Path({!r}))
"""


def writing(path: Path) -> subprocess.Popen:
    """Start to write the assets to a file; the process ends with status 0 when they are there."""
    # Without a binary, Blender is a module of Python.
    blender = [bpy.app.binary_path, "--background", "--factory-startup", "--python-exit-code", "1"]
    program = [*blender, "--python-expr"] if bpy.app.binary_path else [sys.executable, "-c"]
    return subprocess.Popen(
        [*program, _SCRIPT.format(str(_PACKAGE_FOLDER), str(path))],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # Windows would open a console.
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def write(path: Path) -> None:
    """Make every everyday glass in an empty file, mark it as an asset and write the file.

    The extension is imported as a package then, and not registered yet.
    """
    from ..registration import register

    bpy.ops.wm.read_factory_settings(use_empty=True)
    register()
    for preset in PRESETS:
        before = set(bpy.data.objects)
        bpy.ops.object.refractive_glass_everyday_add(kind=preset.identifier)
        parts = [obj for obj in bpy.data.objects if obj not in before]
        asset = parts[0]
        if len(parts) > 1:
            # Of an object its children would stay behind.
            asset = bpy.data.collections.new(preset.label)
            for part in parts:
                asset.objects.link(part)
        asset.asset_mark()
        asset.asset_data.description = preset.description
        asset.asset_data.license = "CC0"
        asset.asset_data.tags.new("glass")
        _show(asset, preset.identifier)
    path.parent.mkdir(parents=True, exist_ok=True)
    # `libraries.write` loses the previews of collections.
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)


def _show(asset: bpy.types.ID, identifier: str) -> None:
    """Make the icon of the Add menu the asset's preview."""
    image = bpy.data.images.load(str(FOLDER / f"{identifier.lower()}.png"))
    image.scale(PREVIEW_PIXELS, PREVIEW_PIXELS)
    preview = asset.preview_ensure()
    preview.image_size = image.size
    preview.image_pixels_float = image.pixels[:]
    bpy.data.images.remove(image)
