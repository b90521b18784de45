# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be seen through a glass, and where its vertices are."""

import bpy
import numpy as np
import scenes

from glass_refraction.scene.names import COPY_GROUP, load_group
from glass_refraction.scene.read.arrays import read_attribute
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.sources import (
    pieces,
    seen_through,
    source_objects,
    world_positions,
)


def _names(problems=None):
    return {o.name for o in source_objects(bpy.context.view_layer, problems)}


def test_only_what_renders_show():
    for name in ("shown", "not rendered", "not for the camera", "in a hidden collection"):
        bpy.ops.mesh.primitive_cube_add()
        bpy.context.object.name = name
    bpy.data.objects["not rendered"].hide_render = True
    bpy.data.objects["not for the camera"].visible_camera = False
    hidden = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(hidden)
    hidden.hide_render = True
    obj = bpy.data.objects["in a hidden collection"]
    hidden.objects.link(obj)
    bpy.context.scene.collection.objects.unlink(obj)
    scenes.glass()
    scenes.camera()
    assert _names() == {"shown"}


def test_edit_mode_is_said_and_left_out():
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = "Eraser"
    bpy.ops.object.mode_set(mode="EDIT")
    problems = []
    assert _names(problems) == set()
    assert len(problems) == 1
    assert "Eraser" in problems[0]


def test_a_collection_limits_what_is_seen():
    for name in ("a", "b"):
        bpy.ops.mesh.primitive_cube_add()
        bpy.context.object.name = name
    group = bpy.data.collections.new("some")
    group.objects.link(bpy.data.objects["b"])
    obj = scenes.glass()
    sources = source_objects(bpy.context.view_layer)
    assert {o.name for o in seen_through(obj, sources)} == {"a", "b"}
    write_input(glass_modifier(obj), "Seen Through", group)
    assert {o.name for o in seen_through(obj, sources)} == {"b"}


def _through_geometry_nodes(source):
    """The source's vertices as the copy's node group gets them."""
    mesh = bpy.data.meshes.new("probe")
    probe = bpy.data.objects.new("probe", mesh)
    bpy.context.scene.collection.objects.link(probe)
    tree = bpy.data.node_groups.new("probe", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.transform_space = "RELATIVE"
    info.inputs["Object"].default_value = source
    realize = tree.nodes.new("GeometryNodeRealizeInstances")
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(info.outputs["Geometry"], realize.inputs[0])
    tree.links.new(realize.outputs[0], end.inputs[0])
    modifier = probe.modifiers.new("probe", "NODES")
    modifier.node_group = tree
    evaluated = probe.evaluated_get(scenes.depsgraph())
    return read_attribute(evaluated.data.attributes["position"])


def _agree(source):
    with pieces(source, scenes.depsgraph()) as parts:
        mine = world_positions(parts)
    theirs = _through_geometry_nodes(source)
    assert len(mine) == len(theirs) > 0
    np.testing.assert_allclose(mine, theirs, atol=1e-5)


def test_modifiers_and_pose():
    bpy.ops.mesh.primitive_monkey_add(location=(1, 2, 3), rotation=(0.1, 0.2, 0.3), scale=(1, 2, 3))
    source = bpy.context.object
    source.modifiers.new("subdivide", "SUBSURF").levels = 2
    _agree(source)


def test_instances_of_a_node_tree_come_in_order():
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=3, y_subdivisions=2, rotation=(0.3, 0, 0))
    source = bpy.context.object
    tree = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    cone = tree.nodes.new("GeometryNodeMeshCone")
    place = tree.nodes.new("GeometryNodeInstanceOnPoints")
    join = tree.nodes.new("GeometryNodeJoinGeometry")
    tree.links.new(start.outputs[0], place.inputs["Points"])
    tree.links.new(cone.outputs["Mesh"], place.inputs["Instance"])
    tree.links.new(place.outputs[0], join.inputs[0])
    tree.links.new(start.outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], end.inputs[0])
    source.modifiers.new("scatter", "NODES").node_group = tree
    _agree(source)


def test_an_instanced_collection_comes_in_order():
    group = bpy.data.collections.new("group")
    for k in range(3):
        bpy.ops.mesh.primitive_cone_add(vertices=5 + k, location=(k, 0, 0), rotation=(k, 0, 0))
        group.objects.link(bpy.context.object)
        bpy.context.scene.collection.objects.unlink(bpy.context.object)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.location, empty.rotation_euler = (1, 2, 3), (0.5, 0.2, 0.1)
    bpy.context.scene.collection.objects.link(empty)
    _agree(empty)


def test_text_and_curves_become_meshes():
    bpy.ops.object.text_add()
    with pieces(bpy.context.object, scenes.depsgraph()) as parts:
        assert len(world_positions(parts)) > 0


def test_the_group_is_loaded_once_and_not_as_an_asset():
    assert load_group(COPY_GROUP) == load_group(COPY_GROUP)
    assert load_group(COPY_GROUP).asset_data is None
