# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: a wall whose colour is its place, seen past and through a tilted pane of glass.

Arguments: output folder, render engine. Writes both pictures as NPY (float, linear) and the result.
"""

import json
import math
import sys
from pathlib import Path

import bpy
import numpy as np

FOLDER, ENGINE = Path(sys.argv[-2]), sys.argv[-1]
WIDTH, HEIGHT = 96, 48
VIEW = 0.2  # metres across the picture
THICKNESS, IOR, TILT = 0.03, 1.5, math.radians(40)


def build():
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_start = "ORTHO", VIEW, 0.01
    camera.location, camera.rotation_euler = (0, -0.5, 0), (math.pi / 2, 0, 0)
    mesh = bpy.data.meshes.new("Wall")
    half = VIEW
    corners = [(-half, 0.2, -half), (half, 0.2, -half), (half, 0.2, half), (-half, 0.2, half)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    mesh.materials.append(place_material())
    for obj in (camera, bpy.data.objects.new("Wall", mesh)):
        scene.collection.objects.link(obj)
    scene.camera = camera
    render = scene.render
    render.engine = ENGINE
    render.resolution_x, render.resolution_y = WIDTH, HEIGHT
    # One sample in the middle of each pixel.
    if ENGINE == "CYCLES":
        scene.cycles.samples, scene.cycles.filter_width = 1, 0.01
        scene.cycles.use_denoising = False
    else:
        scene.eevee.taa_render_samples, render.filter_size = 1, 0.0
    # By software the world's light probe and shadows take EEVEE seconds of each render.
    scene.eevee.use_shadows, scene.world = False, bpy.data.worlds.new("World")
    scene.world.probe_resolution = "128"
    scene.refractive_glass.surface = "REFRACTION"
    return scene


def place_material():
    material = bpy.data.materials.new("Place")
    tree = material.node_tree
    tree.nodes.clear()
    uv = tree.nodes.new("ShaderNodeUVMap")
    light = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(uv.outputs["UV"], light.inputs["Color"])
    tree.links.new(light.outputs["Emission"], output.inputs["Surface"])
    return material


def picture(scene, name):
    image = scene.render.image_settings
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(FOLDER / f"{name}.exr")
    bpy.ops.render.render(write_still=True)
    loaded = bpy.data.images.load(scene.render.filepath)
    values = np.empty(WIDTH * HEIGHT * 4, dtype=np.float32)
    loaded.pixels.foreach_get(values)
    np.save(FOLDER / f"{name}.npy", values.reshape(HEIGHT, WIDTH, 4))
    bpy.data.images.remove(loaded)


def names():
    kinds = ("objects", "meshes", "scenes", "collections", "node_groups")
    return {kind: sorted(block.name for block in getattr(bpy.data, kind)) for kind in kinds}


scene = build()
picture(scene, "direct")
before = names()
added = bpy.ops.object.refractive_glass_add(
    shape="SLAB",
    radius=0.04,
    wall_thickness=THICKNESS,
    ior=IOR,
    rotation=(math.pi / 2, 0, TILT),
)
picture(scene, "glass")
bpy.data.objects.remove(bpy.context.object)
picture(scene, "again")

sine = math.sin(TILT)
shift = THICKNESS * sine * (1 - math.cos(TILT) / math.sqrt(IOR**2 - sine**2))
result = {
    "added": list(added),
    "shift": -shift / (2 * VIEW),  # towards -x, in widths of the wall
    "view": VIEW,
    "blender": bpy.app.version_string,
    "before": before,
    "after": names(),
}
(FOLDER / "result.json").write_text(json.dumps(result))
