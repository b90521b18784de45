# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: bake a wall that moves behind a glass, and write what is to be seen again.

Arguments: output folder, render engine, last frame. Leaves scene.blend, its bake, and live pictures
of its frames.
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np

FOLDER, ENGINE, LAST = Path(sys.argv[-3]), sys.argv[-2], int(sys.argv[-1])


def build():
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -0.5, 0.09), (math.pi / 2 * 0.96, 0, 0)
    camera.data.clip_start = 0.01
    for frame, x in ((1, 0.0), (8, 0.1)):
        # The glass's outline and its paths' weights change too.
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    x = np.linspace(-0.5, 0.5, 17)
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata(
        [(a, 0.3, z) for z in (-0.5, 0.5) for a in x],
        [],
        [(k, k + 1, k + 18, k + 17) for k in range(16)],
    )
    for number, colour in enumerate(((0.8, 0.1, 0.1), (0.1, 0.8, 0.2))):
        mesh.materials.append(light(f"Stripe {number}", colour))
    mesh.polygons.foreach_set("material_index", np.arange(16, dtype=np.int32) % 2)
    wall = bpy.data.objects.new("Wall", mesh)
    for frame, x in ((1, 0.0), (3, 0.05)):
        wall.location.x = x
        wall.keyframe_insert("location", frame=frame)
    for obj in (camera, wall):
        scene.collection.objects.link(obj)
    scene.camera = camera
    bpy.ops.object.refractive_glass_add(shape="CYLINDER")
    render = scene.render
    render.engine = ENGINE
    render.resolution_x, render.resolution_y = 80, 60
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.eevee.taa_render_samples = 1
    # By software the world's light probe and shadows take EEVEE seconds of each render.
    scene.eevee.use_shadows, scene.world = False, bpy.data.worlds.new("World")
    scene.world.probe_resolution = "128"
    image = render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.frame_start, scene.frame_end = 1, LAST
    scene.refractive_glass.surface = "REFRACTION"
    # True shading is not baked.
    scene.refractive_glass.shading = "DISPLACED"
    return scene


def light(name, colour):
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*colour, 1.0)
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
    return material


scene = build()
bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "scene.blend"))
# Some engines' very first picture of a session differs from all later ones.
scene.render.filepath = "//warm_"
bpy.ops.render.render(write_still=True)
scene.render.filepath = "//live_"
bpy.ops.render.render(animation=True)
baked = bpy.ops.scene.refractive_glass_bake()
bpy.ops.wm.save_mainfile()
(FOLDER / "result.json").write_text(json.dumps({"baked": list(baked)}))
