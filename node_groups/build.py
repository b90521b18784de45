# SPDX-License-Identifier: GPL-3.0-or-later
"""Write ``refractive_glass.blend`` from the modules here: ``python -m node_groups.build``.

The file is made with the oldest Blender that the extension supports, so that newer ones convert it.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import zstandard

from . import baked, copy, glass, occluder

HARD = 22
"""The highest level of zstd."""
ASSETS = Path(__file__).with_name("refractive_glass.blend")


def build(path: Path = ASSETS) -> Path:
    """Build every group into ``path``; the modifier is marked as an asset. Returns the path."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    groups = {module.build() for module in (glass, copy, occluder, baked)}
    modifier = next(g for g in groups if g.name == glass.NAME)
    modifier.asset_mark()
    modifier.asset_data.description = "Shows what stands behind and in the glass, refracted"
    modifier.asset_data.license = "CC0"
    bpy.data.libraries.write(str(path), groups, fake_user=True)
    # As Blender compresses files, but harder than it does: a sixth less to download.
    packed = zstandard.ZstdCompressor(level=HARD).compress(path.read_bytes())
    path.write_bytes(packed)
    return path


if __name__ == "__main__":
    print(build())
