# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene to start from: a straw in a glass of water on a table. What it makes is CC0."""

from __future__ import annotations

import math

import bpy
from mathutils import Vector

from . import staying
from .operators import can_edit

NAME = "Glass of Water"
# Metres, and colours in linear light.
TABLE, WALL, WALL_TILES = 1.2, 0.35, 0.04
STRAW_RADIUS, STRAW_LENGTH, STRAW_TILT = 0.003, 0.16, math.radians(15.0)
STRAW_SIDES = 24
STRAW_AT = (0.003, 0.0, 0.086)
EYE, TARGET, LENS = (0.08, -0.46, 0.115), (0.005, 0.0, 0.076), 60.0
LAMP_AT, LAMP_SIZE, LAMP_WATTS = (-0.45, -0.35, 0.75), 0.35, 9.0
WOOD, TILE, JOINT = (0.40, 0.24, 0.13, 1.0), (0.62, 0.60, 0.52, 1.0), (0.33, 0.42, 0.50, 1.0)
RED, DAYLIGHT = (0.70, 0.03, 0.03, 1.0), (0.75, 0.82, 0.90, 1.0)


class SCENE_OT_refractive_glass_starter(bpy.types.Operator):
    """Add a scene with a straw in a glass of water on a table, and go to it"""

    bl_idname = "scene.refractive_glass_starter"
    bl_label = "Starter Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.window is not None and can_edit(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = bpy.data.scenes.new(NAME)
        _furnish(scene)
        context.window.scene = scene
        ended = bpy.ops.object.refractive_glass_everyday_add(kind="GLASS_OF_WATER")
        space = context.space_data
        if isinstance(space, bpy.types.SpaceView3D):
            space.region_3d.view_perspective = "CAMERA"
        return ended


def _furnish(scene: bpy.types.Scene) -> None:
    """Table, wall, straw, lamp, world and camera."""
    half = 0.5 * TABLE
    _plane(scene, "Table", [(-half, -half), (half, -half), (half, WALL), (-half, WALL)], WOOD)
    wall = _mesh(
        scene,
        "Wall",
        [(-half, WALL, 0), (half, WALL, 0), (half, WALL, half), (-half, WALL, half)],
        [(0, 1, 2, 3)],
    )
    wall.data.materials.append(_checked("Wall"))
    straw = _tube(scene)
    straw.location, straw.rotation_euler = STRAW_AT, (0.0, STRAW_TILT, 0.0)
    data = bpy.data.lights.new("Lamp", "AREA")
    data.size, data.energy = LAMP_SIZE, LAMP_WATTS
    _look(_link(scene, "Lamp", data), LAMP_AT)
    world = bpy.data.worlds.new(NAME)
    ground = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    ground.inputs["Color"].default_value = DAYLIGHT
    ground.inputs["Strength"].default_value = 0.5
    scene.world = world
    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_start = LENS, 0.01
    scene.camera = _link(scene, "Camera", data)
    _look(scene.camera, EYE)
    scene.render.resolution_x, scene.render.resolution_y = 960, 720
    # EEVEE takes things for 0.25 m thick otherwise, and darkens the wall round the straw.
    scene.eevee.fast_gi_thickness_near = STRAW_RADIUS


def _link(scene: bpy.types.Scene, name: str, data: bpy.types.ID) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, data)
    scene.collection.objects.link(obj)
    return obj


def _look(obj: bpy.types.Object, place: tuple[float, float, float]) -> None:
    """Put a camera or a lamp in its place and turn it to what is looked at."""
    obj.location = place
    towards = Vector(TARGET) - Vector(place)
    obj.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()


def _mesh(scene: bpy.types.Scene, name: str, vertices, faces) -> bpy.types.Object:
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    return _link(scene, name, data)


def _plane(scene: bpy.types.Scene, name: str, corners, colour) -> None:
    obj = _mesh(scene, name, [(x, y, 0.0) for x, y in corners], [(0, 1, 2, 3)])
    obj.data.materials.append(_plain(name, colour))


def _tube(scene: bpy.types.Scene) -> bpy.types.Object:
    """A closed cylinder along z, its middle in the origin."""
    angles = [2.0 * math.pi * k / STRAW_SIDES for k in range(STRAW_SIDES)]
    ring = [(STRAW_RADIUS * math.cos(a), STRAW_RADIUS * math.sin(a)) for a in angles]
    vertices = [(x, y, side * 0.5 * STRAW_LENGTH) for side in (-1, 1) for x, y in ring]
    count = STRAW_SIDES
    sides = [(k, (k + 1) % count, count + (k + 1) % count, count + k) for k in range(count)]
    ends = [tuple(range(count))[::-1], tuple(range(count, 2 * count))]
    straw = _mesh(scene, "Straw", vertices, [*sides, *ends])
    straw.data.polygons.foreach_set("use_smooth", [True] * count + [False] * 2)
    straw.data.materials.append(_plain("Straw", RED))
    return straw


def _plain(name: str, colour: tuple[float, ...]) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    shader = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = colour
    shader.inputs["Roughness"].default_value = 0.6
    material.diffuse_color = colour
    return material


def _checked(name: str) -> bpy.types.Material:
    """Tiles by the place in the world, so that no UV map is needed."""
    material = _plain(name, TILE)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    checker = nodes.new("ShaderNodeTexChecker")
    checker.inputs["Color1"].default_value = TILE
    checker.inputs["Color2"].default_value = JOINT
    checker.inputs["Scale"].default_value = 1.0 / WALL_TILES
    places = nodes.new("ShaderNodeTexCoord")
    links.new(places.outputs["Object"], checker.inputs["Vector"])
    shader = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
    links.new(checker.outputs["Color"], shader.inputs["Base Color"])
    return material


register, unregister = staying.classes((SCENE_OT_refractive_glass_starter,))
