# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: how far the pictures of a folder are from the live ones of the same frames.

Arguments: output folder, folder of the pictures.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

OUTPUT, FOLDER = Path(sys.argv[-2]), Path(sys.argv[-1])


def pixels(path):
    image = bpy.data.images.load(str(path))
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


found = {"extension": hasattr(bpy.types.Scene, "refractive_glass")}
for path in sorted(FOLDER.glob("farm_*.exr")):
    live = pixels(FOLDER / path.name.replace("farm_", "live_"))
    found[path.stem] = float(np.abs(pixels(path) - live).max())
found["moves"] = float(
    np.abs(pixels(FOLDER / "live_0001.exr") - pixels(FOLDER / "live_0002.exr")).max()
)
(OUTPUT / "result.json").write_text(json.dumps(found))
