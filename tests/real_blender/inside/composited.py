# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender: a scene with a glass, whose compositor names another scene of the user's.

Argument: output folder. Nothing is done between what makes the glass and the render.
"""

import json
import sys
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[-1])


def compose(scene, other):
    """Have the scene's compositor show the other scene."""
    tree = bpy.data.node_groups.new("Both", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
    for shown in (scene, other):
        layers = tree.nodes.new("CompositorNodeRLayers")
        layers.scene = shown
        tree.links.new(layers.outputs[0], output.inputs[0])
    scene.compositing_node_group = tree


def main():
    scene = bpy.context.scene
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(bpy.data.objects.new("Thing", bpy.data.meshes.new("Thing")))
    other.camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    other.collection.objects.link(other.camera)
    other.world = bpy.data.worlds.new("Blue")
    other.world.color = 0, 0, 1
    for each in (scene, other):
        each.render.engine = "BLENDER_WORKBENCH"
        each.render.resolution_x = each.render.resolution_y = 32
    other.display.shading.background_type = "WORLD"
    scene.view_settings.view_transform = "Raw"
    compose(scene, other)
    bpy.ops.object.refractive_glass_add(shape="CYLINDER", radius=2, wall_thickness=0.2, height=3)
    scene.render.filepath = str(FOLDER / "composited.png")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    (FOLDER / "result.json").write_text(json.dumps({"color": list(picture.pixels[:3])}))


main()
