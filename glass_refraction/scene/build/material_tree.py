# SPDX-License-Identifier: GPL-3.0-or-later
"""Own geometry trees that evaluate textures of glassy materials in any places."""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from ..names import TAG, hidden_name, own
from ..read.material_fields import (
    FIELD,
    FIELDS,
    OF_MATERIAL,
    STRUCTURE,
    find_points,
    write_values,
)
from ..read.material_recipe import Recipe, by_identifier, recipes_of
from .own_scenes import new_object, remove_objects


def prepare_fields(
    collection: bpy.types.Collection, materials: Iterable[bpy.types.Material]
) -> None:
    """Have an own collection hold points to evaluate these materials in, and no others."""
    wanted = [(m.name_full, recipe) for m in materials for recipe in recipes_of(m)]
    kept = [obj for name, recipe in wanted for obj in find_points(collection.objects, name, recipe)]
    stale = [obj for obj in collection.objects if own(obj, FIELDS) and obj not in kept]
    trees = [obj.modifiers[0].node_group for obj in stale if obj.modifiers]
    remove_objects(stale)
    for tree in trees:
        if tree is not None and not tree.users:
            bpy.data.node_groups.remove(tree)
    for name, recipe in wanted:
        if not any(find_points(collection.objects, name, recipe)):
            points = new_object(FIELDS, bpy.data.meshes.new(hidden_name(FIELDS)), collection)
            points[OF_MATERIAL], points[STRUCTURE] = name, recipe.structure
            points.modifiers.new("Fields", "NODES").node_group = _tree(recipe)


def _tree(recipe: Recipe) -> bpy.types.NodeTree:
    """Stores what each stage of a recipe takes in attributes of the points."""
    tree = bpy.data.node_groups.new(hidden_name(FIELDS), "GeometryNodeTree")
    tree[TAG] = FIELDS
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    made = []
    for number, (kind, properties) in enumerate(recipe.nodes):
        node = tree.nodes.new(kind)
        node.name = str(number)
        for name, value in properties:
            setattr(node, name, value)
        made.append(node)
    write_values(tree, recipe)

    for first, output, second, name in recipe.links:
        source = by_identifier(made[first].outputs, output)
        tree.links.new(source, by_identifier(made[second].inputs, name))
    geometry = tree.nodes.new("NodeGroupInput").outputs["Geometry"]
    for stage, fields in enumerate(recipe.fields):
        for part, (node, output) in enumerate(fields):
            store = tree.nodes.new("GeometryNodeStoreNamedAttribute")
            store.data_type = "FLOAT_VECTOR"
            store.inputs["Name"].default_value = FIELD.format(stage, part)
            tree.links.new(geometry, store.inputs["Geometry"])
            tree.links.new(by_identifier(made[node].outputs, output), store.inputs["Value"])
            geometry = store.outputs["Geometry"]
    tree.links.new(geometry, tree.nodes.new("NodeGroupOutput").inputs["Geometry"])
    return tree
