# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: a 3D view as large as the last render is composited.

Argument: output folder. Writes by how much its pixels differ from those of the same view without.
"""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from windowed import view_3d, walk

FOLDER = Path(sys.argv[-1])
result = {}


def screenshot(region):
    """Red, green and blue (height, width, 3) of a region in the window."""
    path = FOLDER / "composited_view.png"
    subprocess.run(["import", "-window", "root", path], check=True)
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    window = bpy.context.window_manager.windows[0]
    x, y = window.x + region.x, window.y + region.y
    return pixels[y : y + region.height, x : x + region.width, :3]


def steps():
    scene = bpy.context.scene
    yield 0.2
    with bpy.context.temp_override(**view_3d()):
        bpy.ops.object.refractive_glass_add(
            shape="CYLINDER", radius=2.0, wall_thickness=0.2, height=3.0, location=(0, 0, -1.5)
        )
        bpy.context.window_manager.refractive_glass_overlay = False
        space, region = bpy.context.space_data, bpy.context.region
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = region.width, region.height
    scene.render.filepath = str(FOLDER / "composited_view_f12.png")
    bpy.ops.render.render(write_still=True)
    space.shading.type = "RENDERED"
    found = {}
    for kind in ("DISABLED", "ALWAYS"):
        space.shading.use_compositor = kind
        yield 1
        found[kind] = screenshot(region)
    off = np.abs(found["ALWAYS"] - found["DISABLED"]).max(axis=2)
    result["spread"] = float(found["DISABLED"].std())
    result["off"] = float((off > 0.05).mean())


walk(steps(), result, FOLDER)
