# SPDX-License-Identifier: GPL-3.0-or-later
"""The material that a glass's own mesh wears in the viewport, and in renders without refraction."""

from __future__ import annotations

import bpy

from ..names import TAG


def glass_material(ior: float) -> bpy.types.Material:
    """A Glass BSDF of that ior, shared by the glasses that have it."""
    name = f"Refractive Glass {ior:.4g}"
    for material in bpy.data.materials:
        if material.get(TAG) == "glass" and material.name == name and material.library is None:
            return material
    material = bpy.data.materials.new(name)
    material[TAG] = "glass"
    tree = material.node_tree
    tree.nodes.clear()
    surface = tree.nodes.new("ShaderNodeBsdfGlass")
    surface.inputs["IOR"].default_value = ior
    surface.inputs["Roughness"].default_value = 0.0
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    end.location = (240, 0)
    tree.links.new(surface.outputs[0], end.inputs["Surface"])
    # See-through in Solid shading, so that what stands behind can be selected by sight.
    material.diffuse_color = (0.75, 0.9, 1.0, 0.25)
    material.use_transparency_overlap = False
    return material
