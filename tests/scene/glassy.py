# SPDX-License-Identifier: GPL-3.0-or-later
"""Glassy materials with textures, and cubes of them that are glasses."""

import bpy
import numpy as np
import scenes

from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene import update as door
from glass_refraction.scene.read.glasses import read_glasses


def material(name="Bumpy"):
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.clear()
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    glass = tree.nodes.new("ShaderNodeBsdfGlass")
    glass.inputs["Roughness"].default_value = 0.0
    tree.links.new(glass.outputs[0], end.inputs["Surface"])
    return made


def node(made, kind, **inputs):
    found = made.node_tree.nodes.new(f"ShaderNode{kind}")
    for name, value in inputs.items():
        found.inputs[name].default_value = value
    return found


def link(made, source, target):
    made.node_tree.links.new(source, target)


def glass_of(made):
    return next(n for n in made.node_tree.nodes if n.type == "BSDF_GLASS")


def painted(made, heights, space="Non-Color"):
    """A picture in a material, of these heights (64,) along u."""
    image = bpy.data.images.new("Ramp", 64, 4, float_buffer=True)
    image.colorspace_settings.name = space
    paint(image, heights)
    picture = node(made, "TexImage")
    picture.image = image
    return picture


def paint(image, heights):
    pixels = np.ones((4, 64, 4), np.float32)
    pixels[..., :3] = np.asarray(heights)[:, None]
    image.pixels.foreach_set(pixels.ravel())


def cube(made, *, scale=(1.0, 1.0, 1.0), turn=(0.0, 0.0, 0.0)):
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.1, 0.2, 0.3), rotation=turn, scale=scale)
    obj = bpy.context.object
    obj.data.materials.append(made)
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    if bpy.context.scene.camera is None:
        scenes.camera()
    prepared()
    return obj


def prepared():
    door.prepare(scenes.settings(shading="TRUE"), scenes.depsgraph())


def seen():
    """The first glass's description as renders read it."""
    return read_glasses(scenes.depsgraph())[0].description


def pane_beside_cycles(made, tmp_path):
    """How near a pane before a striped wall and its real glass in *Compare* are to real glass: the
    mean square of what differs inside, of each."""
    bpy.ops.mesh.primitive_cube_add(size=1.0, scale=(1.6, 0.1, 1.2))
    bpy.ops.object.transform_apply(scale=True)
    pane = bpy.context.object
    pane.data.materials.append(made)
    scenes.striped_wall(distance=1.5, stripes=24, size=6.0)
    scenes.camera(location=(0.0, -3.0, 0.0), tilt=np.pi / 2)
    scene = scenes.settings(width=96, height=72, samples=64, shading="TRUE", surface="GLASS")
    real = scenes.picture(scene, tmp_path, "real")
    bpy.context.view_layer.objects.active = pane
    assert bpy.ops.object.refractive_glass_modifier_add(shape="MESH") == {"FINISHED"}
    ours = scenes.picture(scene, tmp_path, "ours")
    assert door.status(scene).problems == []
    materials = list(bpy.data.materials)
    reference = render_reference(scene, samples=64)
    assert list(bpy.data.materials) == materials
    assert pane.material_slots[0].material == made
    inside = np.s_[20:52, 26:70, :3]
    return [np.mean((real[inside] - picture[inside]) ** 2) for picture in (ours, reference)]
