# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes for the tests of this folder."""

import bpy
import numpy as np
from mathutils import Vector

from glass_refraction.scene.read.modifier_inputs import data_path, glass_modifier, value_place

FRAMES = (1, 2, 3)
"""Of the keyframes."""


def emissive(name, rgb):
    """A material that emits one colour."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*rgb, 1.0)
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
    return material


def camera(location=(0.0, -0.5, 0.09), tilt=np.pi / 2 * 0.96, **settings):
    """The scene's camera, looking along +y."""
    data = bpy.data.cameras.new("Camera")
    for name, value in settings.items():
        setattr(data, name, value)
    obj = bpy.data.objects.new("Camera", data)
    obj.location, obj.rotation_euler = location, (tilt, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.scene.camera = obj
    return obj


def striped_wall(distance=0.3, stripes=24, size=1.0):
    """An upright wall of emissive vertical stripes; its colours tell where a ray went."""
    x = np.linspace(-size / 2, size / 2, stripes + 1)
    vertices = [(a, distance, z) for z in (-size / 2, size / 2) for a in x]
    faces = [(k, k + 1, k + stripes + 2, k + stripes + 1) for k in range(stripes)]
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata(vertices, [], faces)
    for k in range(3):
        rgb = np.eye(3)[k] * 0.7 + 0.1
        mesh.materials.append(emissive(f"stripe {k}", rgb))
    mesh.polygons.foreach_set("material_index", np.arange(stripes, dtype=np.int32) % 3)
    wall = bpy.data.objects.new("Wall", mesh)
    bpy.context.scene.collection.objects.link(wall)
    return wall


def settings(width=80, height=60, samples=4, **glass):
    """A small, plain, repeatable Cycles render of displaced copies."""
    scene = bpy.context.scene
    glass.setdefault("shading", "DISPLACED")
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.view_settings.view_transform = "Standard"
    for name, value in glass.items():
        setattr(scene.refractive_glass, name, value)
    return scene


def coarse_eevee(scene):
    """Let EEVEE be cheap by software, where the world's light probe and shadows cost most.

    Each of the two takes it seconds of each render, however small. The world is black.
    """
    scene.eevee.use_shadows = False
    scene.world = bpy.data.worlds.new("Black")
    scene.world.probe_resolution = "128"
    shader = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    shader.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)


def glass(**values):
    """Add a glass by its operator."""
    assert bpy.ops.object.refractive_glass_add(**values) == {"FINISHED"}
    return bpy.context.object


CUP = {
    "radius": 0.036,
    "wall_thickness": 0.0025,
    "height": 0.11,
    "bottom_thickness": 0.007,
    "liquid_level": 0.065,
    "contents_ior": 1.333,
}
LOW, HIGH = (0.02, -0.33, 0.05), (0.02, -0.24, 0.26)
"""Eyes that look at the cup from the side and from above."""


def cup(eye=LOW, **values):
    """A glass of water before a striped wall, seen by a camera that looks at its middle."""
    eyes = camera(location=eye, lens=60.0)
    towards = np.array((0.0, 0.0, 0.06)) - eye
    eyes.rotation_euler = Vector(towards).to_track_quat("-Z", "Y").to_euler()
    striped_wall(0.2)
    return glass(shape="TUMBLER", **{**CUP, **values})


def rod(location=(0.0, 0.0, 0.075), turn=0.3, colour=(0.9, 0.5, 0.1), depth=0.12):
    """A leaning rod; where it stands by default, across the surface of the liquid."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.004, depth=depth)
    found = bpy.context.object
    found.location, found.rotation_euler.y = location, turn
    found.data.materials.append(emissive("rod", colour))
    bpy.context.view_layer.update()
    return found


def depsgraph():
    """The evaluated scene."""
    return bpy.context.evaluated_depsgraph_get()


def picture(scene, folder, name="picture"):
    """Render the scene as F12 does; linear (H, W, 4), bottom row first."""
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    image.color_mode = "RGBA"
    scene.render.filepath = str(folder / f"{name}.exr")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    return load(scene.render.filepath)


def load(path):
    """The pixels of a picture file, linear (H, W, 4), bottom row first."""
    loaded = bpy.data.images.load(str(path))
    width, height = loaded.size
    pixels = np.empty(width * height * 4, np.float32)
    loaded.pixels.foreach_get(pixels)
    bpy.data.images.remove(loaded)
    return pixels.reshape(height, width, 4)


def animation(scene, folder, frames):
    """Render a range of frames as ``-a`` does; frame -> linear (H, W, 4)."""
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(folder / "frame_####.exr")
    scene.frame_start, scene.frame_end = frames[0], frames[-1]
    bpy.ops.render.render(animation=True, scene=scene.name)
    return {frame: load(folder / f"frame_{frame:04}.exr") for frame in frames}


def key(owner, path, values):
    """Keyframes of a property, held from one to the next."""
    target, name = owner, path
    if "." in path:
        before, name = path.rsplit(".", 1)
        target = owner.path_resolve(before)
    for frame, value in zip(FRAMES, values, strict=True):
        setattr(target, name, value)
        owner.keyframe_insert(path, frame=frame)
    _interpolate(owner, "CONSTANT")


def linear(owner):
    """Let all that is keyed go at an even pace from key to key."""
    _interpolate(owner, "LINEAR")


def key_input(obj, name, values):
    """The same of an input of the glass."""
    modifier = glass_modifier(obj)
    holder, prop = value_place(modifier, name)
    for frame, value in zip(FRAMES, values, strict=True):
        if prop.startswith("["):
            holder[prop[2:-2]] = value
        else:
            setattr(holder, prop, value)
        obj.keyframe_insert(data_path(modifier, name), frame=frame)
    _interpolate(obj, "CONSTANT")


def _interpolate(owner, how):
    for layer in owner.animation_data.action.layers:
        for bag in layer.strips[0].channelbags:
            for curve in bag.fcurves:
                for point in curve.keyframe_points:
                    point.interpolation = how
