# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: the demo scene `eraser` in flat colours, and F12's pictures of it.

Arguments: output folder, the demo scene, the flat scene's new path. Everything has one flat colour,
the eraser is green: its outline can be read off a picture.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

FOLDER, SCENE, FLAT = (Path(a) for a in sys.argv[-3:])
FRAMES = (1, 10, 20)
COLOURS = {"Eraser": (0.0, 1.0, 0.0), "Desk": (0.25, 0.02, 0.02), "Wall": (0.05, 0.1, 0.6)}


def flat_material(name, colour):
    material = bpy.data.materials.new(name)
    material.diffuse_color = (*colour, 1.0)
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*colour, 1.0)
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
    return material


bpy.ops.wm.open_mainfile(filepath=str(SCENE))
scene = bpy.context.scene
# Surfaces that only refract show a flat colour as it is, and along few paths.
scene.refractive_glass.surface = "REFRACTION"
scene.view_settings.view_transform = "AgX"
for name, colour in COLOURS.items():
    material = flat_material(name, colour)
    mesh = bpy.data.objects[name].data
    for slot in range(len(mesh.materials)):
        mesh.materials[slot] = material
scene.render.engine = "BLENDER_EEVEE"
# Each takes a second without a graphics card, most of it for light that no flat colour shows.
scene.eevee.taa_samples = 8
scene.eevee.use_shadows = False
scene.world.probe_resolution = "128"
bpy.ops.wm.save_as_mainfile(filepath=str(FLAT), copy=True)

render = scene.render
render.engine = "BLENDER_WORKBENCH"
render.resolution_x, render.resolution_y = 640, 480
render.image_settings.file_format = "PNG"
scene.view_settings.view_transform = "Standard"
shading = scene.display.shading
shading.light, shading.color_type, shading.show_object_outline = "FLAT", "MATERIAL", False
for frame in FRAMES:
    scene.frame_set(frame)
    render.filepath = str(FOLDER / f"viewport_f12_{frame}.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    np.save(FOLDER / f"F12_{frame}.npy", pixels.reshape(height, width, 4)[..., :3])
(FOLDER / "result.json").write_text(json.dumps({}))
