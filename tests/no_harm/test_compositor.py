# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's compositor tree is the same, link by link, after the group was in it and went."""

import sys
from pathlib import Path

import bpy
import pytest

from glass_refraction.scene import update as door
from glass_refraction.scene.build.compositor import group_node

sys.path.insert(0, str(Path(__file__).parent.parent / "scene"))
import scenes


def _links(tree):
    return sorted(
        (k.from_node.name, k.from_socket.identifier, k.to_node.name, k.to_socket.identifier, m)
        for k, m in ((link, link.is_muted) for link in tree.links)
    )


def _tree(scene, kind):
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    nodes, links = tree.nodes, tree.links
    first = nodes.new("CompositorNodeRLayers")
    first.scene = scene
    end, invert = nodes.new("NodeGroupOutput"), nodes.new("CompositorNodeInvert")
    source = first.outputs["Image"]
    if kind == "reroute":
        reroute = nodes.new("NodeReroute")
        links.new(source, reroute.inputs[0])
        source = reroute.outputs[0]
    if kind == "several":
        second = nodes.new("CompositorNodeRLayers")
        second.scene = scene
        links.new(second.outputs["Image"], invert.inputs["Color"])
    else:
        links.new(source, invert.inputs["Color"]).is_muted = kind == "muted"
    links.new(source, end.inputs["Image"])
    scene.compositing_node_group = tree
    return tree


@pytest.mark.parametrize("kind", ["plain", "muted", "reroute", "several"])
def test_links_come_back_as_they_were(kind):
    scenes.camera()
    scenes.striped_wall(stripes=4)
    scenes.glass(shape="ROD")
    scene = scenes.settings(32, 24, surface="REFRACTION")
    tree = _tree(scene, kind)
    before = _links(tree)
    door.prepare(scene, scenes.depsgraph())
    node = group_node(scene)
    fed = {link.from_node for link in tree.links if not link.from_node.get("refractive_glass")}
    # Nothing of the user's sees the unrefracted picture but the group itself and a reroute to it.
    layers = [n for n in fed if n.bl_idname == "CompositorNodeRLayers"]
    assert {k.to_node for n in layers for k in n.outputs["Image"].links} == {node}
    door.remove(scene)
    assert _links(tree) == before
