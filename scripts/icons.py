# SPDX-License-Identifier: GPL-3.0-or-later
"""The Add menu's icons: each everyday glass by its outlines, drawn by Cycles.

    ./run python scripts/icons.py

Writes ``glass_refraction/ui/icons/NAME.png`` for every preset.
"""

from __future__ import annotations

import math
import struct
import sys
import zlib
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import glass_refraction
from glass_refraction.scene.read.modifier_inputs import glass_modifier
from glass_refraction.ui.icons import FOLDER
from glass_refraction.ui.presets import PRESETS, Preset

PIXELS, SAMPLES = 32, 256
GREY = 0.85
"""As Blender's own icons."""
FLAT = 60
"""Faces below which a mesh's edges are its outlines."""
EDGE, FAINT = 0.03, 0.12
"""Thickness of such edges in parts of the size; least light of a surface."""
ELEVATION, AZIMUTH = math.radians(12.0), math.radians(-25.0)
MARGIN = 1.06


def outlines() -> bpy.types.Material:
    """A material that gives the more light, the more a surface is seen at a slant."""
    material = bpy.data.materials.new("Outlines")
    tree = material.node_tree
    tree.nodes.clear()
    slant = tree.nodes.new("ShaderNodeLayerWeight")
    slant.inputs["Blend"].default_value = 0.35
    most = tree.nodes.new("ShaderNodeMath")
    most.operation = "MAXIMUM"
    most.inputs[1].default_value = FAINT
    tree.links.new(slant.outputs["Facing"], most.inputs[0])
    light = tree.nodes.new("ShaderNodeEmission")
    light.inputs["Color"].default_value = (GREY, GREY, GREY, 1.0)
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(most.outputs[0], mix.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    tree.links.new(light.outputs[0], mix.inputs[2])
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], end.inputs["Surface"])
    return material


def draw(preset: Preset) -> Path:
    """Render a preset's icon; returns the file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()
    scene = bpy.context.scene
    bpy.ops.object.refractive_glass_everyday_add(kind=preset.identifier)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    corners = []
    for glass in [o for o in scene.objects if o.type == "MESH"]:
        mesh = bpy.data.meshes.new_from_object(glass.evaluated_get(depsgraph))
        mesh.materials.clear()
        mesh.materials.append(outlines())
        drawn = bpy.data.objects.new("Drawn", mesh)
        drawn.matrix_world = glass.matrix_world.copy()
        scene.collection.objects.link(drawn)
        if len(mesh.polygons) < FLAT:
            edges = bpy.data.objects.new("Edges", mesh)
            edges.matrix_world = glass.matrix_world.copy()
            scene.collection.objects.link(edges)
            wire = edges.modifiers.new("Edges", "WIREFRAME")
            wire.thickness, wire.use_even_offset = EDGE * preset.size, False
        corners += [drawn.matrix_world @ v.co for v in mesh.vertices]
        glass.modifiers.remove(glass_modifier(glass))
        glass.hide_render = True
    data = bpy.data.cameras.new("Camera")
    data.type = "ORTHO"
    camera = bpy.data.objects.new("Camera", data)
    camera.rotation_euler = (math.pi / 2 - ELEVATION, 0.0, -AZIMUTH)
    scene.collection.objects.link(camera)
    scene.camera = camera
    turn = camera.rotation_euler.to_matrix()
    seen = [turn.inverted() @ corner for corner in corners]
    low = Vector(min(p[k] for p in seen) for k in range(3))
    high = Vector(max(p[k] for p in seen) for k in range(3))
    data.ortho_scale = MARGIN * max(high.x - low.x, high.y - low.y)
    middle = 0.5 * (low + high)
    camera.location = turn @ Vector((middle.x, middle.y, high.z + preset.size))
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, False
    scene.cycles.transparent_max_bounces = 64
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.view_settings.view_transform = "Standard"
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.compression = "PNG", "RGBA", 100
    scene.render.use_stamp = False
    scene.render.filepath = str(FOLDER / f"{preset.identifier.lower()}.png")
    bpy.ops.render.render(write_still=True)
    return Path(scene.render.filepath)


def repack(path: Path) -> None:
    """Write a grey picture with alpha as such: half as large as with three equal colours."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    width, height = image.size
    pixels = np.array(image.pixels[:]).reshape(height, width, 4)[::-1]
    bpy.data.images.remove(image)
    levels = np.rint(255 * pixels[..., [0, 3]]).astype(np.uint8)
    # Where nothing is drawn any grey will do.
    levels[levels[..., 1] == 0] = 0
    # Each row begins with the number of its filter: 0, none.
    rows = np.concatenate((np.zeros((height, 1), np.uint8), levels.reshape(height, -1)), axis=1)
    chunks = (
        (b"IHDR", struct.pack(">2I5B", width, height, 8, 4, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    )
    packed = b"\x89PNG\r\n\x1a\n"
    for kind, data in chunks:
        packed += struct.pack(">I", len(data)) + kind + data
        packed += struct.pack(">I", zlib.crc32(kind + data))
    path.write_bytes(packed)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for wanted in PRESETS:
        path = draw(wanted)
        repack(path)
        print(path.name)
