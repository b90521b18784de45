# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: add the asset library, look into its file, remove it. Argument: output folder."""

import json
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])
result = {}


bpy.ops.preferences.refractive_glass_asset_library_add()
libraries = bpy.context.preferences.filepaths.asset_libraries
folder = Path(next(library.path for library in libraries if library.name == "Everyday Glasses"))
(path,) = folder.glob("*.blend")
with bpy.data.libraries.load(str(path), assets_only=True) as (found, _):
    result["assets"] = len(found.objects) + len(found.collections)
# Nothing may be written where the extension itself is installed.
result["inside_the_extension"] = (folder.parent / "blender_manifest.toml").exists()
bpy.ops.preferences.refractive_glass_asset_library_remove()
result["left"] = path.exists()
(FOLDER / "result.json").write_text(json.dumps(result))
