# SPDX-License-Identifier: GPL-3.0-or-later
"""What is drawn round, without faces, as the triangles that rays meet."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene.rays.things import read_things


def _fur(radius):
    bpy.ops.mesh.primitive_plane_add(location=(3.0, 2.0, 1.0))
    obj = bpy.context.object
    obj.modifiers.new("Fur", "PARTICLE_SYSTEM")
    obj.show_instancer_for_viewport = False
    settings = obj.particle_systems[0].settings
    settings.type, settings.count, settings.hair_length = "HAIR", 5, 0.5
    settings.root_radius = settings.tip_radius = 2.0
    settings.radius_scale = radius
    return obj, 5 * 0.5 * 2.0 * np.pi * radius


def _points(radius):
    obj = bpy.data.objects.new("Points", bpy.data.meshes.new("Points"))
    obj.data.vertices.add(3)
    obj.data.vertices.foreach_set("co", np.arange(9.0))
    tree = bpy.data.node_groups.new("Points", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    points = tree.nodes.new("GeometryNodeMeshToPoints")
    points.inputs["Radius"].default_value = radius
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], points.inputs["Mesh"])
    tree.links.new(points.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    obj.modifiers.new("Points", "NODES").node_group = tree
    return obj, 3 * 4.0 * np.pi * radius**2


def _curves(radius):
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([3, 4])
    place = [(0, 0, 0), (0, 0, 1), (0, 0, 2), (1, 0, 0), (2, 1, 0), (3, 2, 0), (5, 4, 0)]
    curves.points.foreach_set("position", np.array(place, float).ravel())
    radii = curves.attributes.new("radius", "FLOAT", "POINT")
    radii.data.foreach_set("value", np.full(len(place), radius))
    return bpy.data.objects.new("Hair", curves), (2.0 + 4.0 * 2.0**0.5) * 2.0 * np.pi * radius


@pytest.mark.parametrize("kind", [_points, _curves, _fur], ids=lambda f: f.__name__[1:])
def test_what_is_round_is_as_large_as_it_looks_from_all_sides(kind):
    # Of convex bodies of one surface the mean outline is the same (Cauchy).
    bpy.ops.wm.read_factory_settings(use_empty=True)
    obj, surface = kind(0.02)
    if not obj.users_collection:
        bpy.context.collection.objects.link(obj)
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "CYCLES", {})
    a, b, c = (things.points[things.triangles[:, k]] for k in range(3))
    found = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert found == pytest.approx(surface, rel=1e-5)
    assert set(things.owners) == {obj.name} and not things.unmet
