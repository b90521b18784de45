# SPDX-License-Identifier: GPL-3.0-or-later
"""A glass before a checkered wall, and a camera that goes round it: headless, from nothing.

With the Python module:      ./run python examples/turntable.py OUT_FOLDER
With an installed extension: blender -b --python examples/turntable.py -- OUT_FOLDER
"""

import math
import sys
from pathlib import Path

import bpy

FRAMES = 8


def checkered(name):
    """An unlit material of black and white squares by UV."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    place = tree.nodes.new("ShaderNodeUVMap")
    pattern = tree.nodes.new("ShaderNodeTexChecker")
    light = tree.nodes.new("ShaderNodeEmission")
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    pattern.inputs["Scale"].default_value = 16
    tree.links.new(place.outputs["UV"], pattern.inputs["Vector"])
    tree.links.new(pattern.outputs["Color"], light.inputs["Color"])
    tree.links.new(light.outputs["Emission"], end.inputs["Surface"])
    return material


def build():
    """The scene: a wall, a glass on its own, a camera on an arm that turns."""
    bpy.ops.wm.read_homefile(use_empty=True)
    if not hasattr(bpy.types.Scene, "refractive_glass"):
        sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
        import glass_refraction

        glass_refraction.register()
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(
        size=0.6, location=(0, 0.25, 0.1), rotation=(math.pi / 2, 0, 0)
    )
    bpy.context.object.data.materials.append(checkered("Checkered"))
    bpy.ops.object.refractive_glass_add(
        shape="CYLINDER", radius=0.04, wall_thickness=0.003, height=0.12, ior=1.5
    )
    arm = bpy.data.objects.new("Arm", None)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -0.5, 0.1), (math.radians(86), 0, 0)
    camera.parent = arm
    for obj in (arm, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    for frame, angle in ((1, -0.3), (FRAMES, 0.3)):
        arm.rotation_euler.z = angle
        arm.keyframe_insert("rotation_euler", frame=frame)
    scene.frame_start, scene.frame_end = 1, FRAMES
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    # The wall is its own light: what is drawn displaced needs no other.
    scene.refractive_glass.shading = "DISPLACED"
    scene.refractive_glass.surface = "REFRACTION"
    return scene


def main():
    """Render every frame into the folder that the last argument names."""
    folder = Path(sys.argv[-1]).resolve()
    scene = build()
    scene.render.filepath = str(folder / "turn_")
    bpy.ops.render.render(animation=True)


if __name__ == "__main__":
    main()
