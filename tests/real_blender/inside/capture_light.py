# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: a tube on a wide table in Solid shading, what its capture shows.

Argument: output folder. Writes of each face how much shows the table and in which colour, and what
became of the preferences.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from windowed import until, view_3d, walk

FOLDER = Path(sys.argv[-1])
MODULE = "bl_ext.user_default.refractive_glass"
FACES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")

result = {}


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    preferences = bpy.context.preferences
    unsaved, smoothed = preferences.is_dirty, preferences.system.viewport_aa
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    with bpy.context.temp_override(**view_3d()):
        bpy.context.space_data.shading.use_world_space_lighting = False
        bpy.ops.mesh.primitive_plane_add(size=1000)
        bpy.ops.object.refractive_glass_add(
            "INVOKE_DEFAULT", shape="CYLINDER", radius=0.04, wall_thickness=0.003, height=0.1
        )
    views = sys.modules[f"{MODULE}.glass_refraction.viewport.views"]
    yield 0.2
    yield from until(views.at_rest)
    (view,) = views._views.values()
    colour, _ = (
        np.array(texture.read().to_list(), np.float32) for texture in view.captures.textures
    )
    side = view.captures.side
    for number, face in enumerate(FACES):
        shown = colour[:side, number * side : (number + 1) * side, :3]
        table = shown.max(axis=2) > 0.0
        result[face] = {"part": float(table.mean()), "colour": float(shown[table].mean())}
    result["unsaved"] = [unsaved, preferences.is_dirty]
    result["smoothed"] = [smoothed, preferences.system.viewport_aa]
    result["faces"] = views.counters["faces"]


walk(steps(), result, FOLDER)
