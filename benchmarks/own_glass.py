# SPDX-License-Identifier: GPL-3.0-or-later
"""EEVEE's own refraction: the scene's glasses as meshes whose material refracts on the screen."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from glass_refraction.reference.cycles import scene_depsgraph
from glass_refraction.scene.build.glass_mesh import glass_surfaces
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.mesh_glasses import MeshGlass


def show_own_glass(scene: bpy.types.Scene) -> None:
    """Switch the extension off and put meshes in its glasses' places. The scene stays so."""
    glasses = read_glasses(scene_depsgraph(scene))
    scene.refractive_glass.enabled = False
    for glass in glasses:
        if glass.name in scene.objects:
            scene.objects[glass.name].hide_render = True
        description = glass.description
        if isinstance(description, MeshGlass):
            corners = np.arange(3 * len(description.points))
            points = description.points.reshape(-1, 3)
            normals = description.normals.reshape(-1, 3)
            _add(scene, points, corners.reshape(-1, 3), normals, description.ior, np.eye(4))
            continue
        for surface in glass_surfaces(description):
            faces = np.split(surface.corners, np.cumsum(surface.sizes)[:-1])
            ior = surface.ior_inside / surface.ior_outside
            _add(scene, surface.vertices, faces, surface.normals, ior, glass.to_world)


def _add(scene, points, faces, normals, ior: float, to_world: np.ndarray) -> None:
    """An object of faces with one normal (3,) a corner."""
    mesh = bpy.data.meshes.new("Own glass")
    mesh.from_pydata(points.tolist(), [], [list(map(int, face)) for face in faces])
    mesh.normals_split_custom_set(normals.tolist())
    mesh.materials.append(_refracting(ior))
    obj = bpy.data.objects.new("Own glass", mesh)
    obj.matrix_world = Matrix(to_world.tolist())
    obj.visible_shadow = False
    scene.collection.objects.link(obj)


def _refracting(ior: float) -> bpy.types.Material:
    """A clear material that EEVEE refracts by tracing rays on the screen."""
    material = bpy.data.materials.new(f"Own glass {ior:g}")
    material.use_raytrace_refraction = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfGlass")
    shader.inputs["Roughness"].default_value = 0.0
    shader.inputs["IOR"].default_value = ior
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs["BSDF"], end.inputs["Surface"])
    return material
