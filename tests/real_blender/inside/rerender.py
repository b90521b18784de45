# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: render, change settings that rewire the compositor, render again, and so on.

Arguments: output folder. Writes how many renders it came through.
"""

import json
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])
CHANGES = (
    {},
    {"min_weight": 0.02},
    {"surface": "GLASS"},
    {"shading": "DISPLACED"},
    {"enabled": False},
    {"enabled": True},
)


def build():
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -0.5, 0.06), (1.55, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0, 0.15, 0.06))
    bpy.ops.object.refractive_glass_add(shape="CYLINDER")
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.cycles.samples = 1
    scene.refractive_glass.surface = "REFRACTION"
    scene.render.filepath = str(FOLDER / "picture.png")
    return scene


def main():
    scene = build()
    rendered = 0
    for change in CHANGES:
        for name, value in change.items():
            setattr(scene.refractive_glass, name, value)
        bpy.ops.render.render(write_still=True)
        rendered += 1
    (FOLDER / "result.json").write_text(json.dumps({"rendered": rendered}))


main()
