# SPDX-License-Identifier: GPL-3.0-or-later
"""Write ``refractive_glass.blend`` from the modules here: ``python -m node_groups.build``.

The file is made with the oldest Blender that the extension supports, so that newer ones convert it.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from . import baked, copy, glass, occluder

ASSETS = Path(__file__).with_name("refractive_glass.blend")


def build(path: Path = ASSETS) -> Path:
    """Build every group into ``path``; the modifier is marked as an asset. Returns the path."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    groups = {module.build() for module in (glass, copy, occluder, baked)}
    modifier = next(g for g in groups if g.name == glass.NAME)
    modifier.asset_mark()
    modifier.asset_data.description = "Shows what stands behind and in the glass, refracted"
    modifier.asset_data.license = "CC0"
    bpy.data.libraries.write(str(path), groups, fake_user=True, compress=True)
    return path


if __name__ == "__main__":
    print(build())
