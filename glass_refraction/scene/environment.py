# SPDX-License-Identifier: GPL-3.0-or-later
"""What light paths end at: the world, and what lies where neither copies nor the direct picture go.

Where a path leaves the glass and in which direction is known for every pixel (``optics.trace``).
Both are written into images. A triangle before the camera, the *screen*, wears a material that
sends each of the engine's own rays on from there (a ray portal): so the world, whatever nodes it is
made of, is looked up in exact directions and filtered as the engine filters. With the user's
objects in the same scene, mirrored things that the direct picture does not show are seen too, lit
where they are.
"""

from __future__ import annotations

from itertools import product

import bpy
import numpy as np

from .. import optics
from .arrays import write_attribute, write_image
from .glasses import Glass, unbounded
from .names import TAG, hidden_name, own
from .regions import Regions
from .viewpoint import Viewpoint

RAYS_PER_PIXEL = 2
"""Rays a side that are traced in each pixel; between them Blender interpolates."""
WORLD_SAMPLES = 8
"""Of a world alone: it has no noise, only edges."""

_MARGIN = 3
"""Texels that a path's rays are carried on beyond its region: borders are interpolated."""
_SKIN = 1e-4
"""How far above its lower end, in heights, a glass's rays are let out at the lowest."""
_PLACE = "rg_screen"
_KEY = "refractive_glass_rays"
_IMAGES = ("origin", "direction")


def surroundings(scene: bpy.types.Scene, shading: str) -> str:
    """What the engine's rays look up where the copies do not show it.

    Returns
    -------
    ``MIRRORED`` : objects, lamps and the world; paths with a mirror have no copies.
    ``HIDDEN`` : the same, but every path has copies (their light is looked up in the direct
        picture, which does not show all).
    ``WORLD`` : the world alone.
    empty : nothing; the world is one colour, or the engine shows none.
    """
    if scene.render.engine == "BLENDER_WORKBENCH":
        return ""
    if scene.refractive_glass.mirrors == "RAYS" and scene.refractive_glass.surface == "GLASS":
        return "MIRRORED"
    if shading == "TRUE":
        return "HIDDEN"
    return "" if is_uniform(scene.world) else "WORLD"


def shows_objects(around: str) -> bool:
    """Whether the rays meet the user's objects (``around`` as :func:`surroundings` has it)."""
    return around in {"MIRRORED", "HIDDEN"}


def needs_copies(path: optics.LightPath, around: str) -> bool:
    """Whether displaced copies show what is seen along the path.

    Mirrors show what lies behind the camera, beside the picture or the back of things: next to
    nothing of it is in the direct picture, where the copies would look.
    """
    return around != "MIRRORED" or "R" not in path.events


def is_uniform(world: bpy.types.World | None) -> bool:
    """Whether the world has one colour for all directions."""
    if world is None or world.node_tree is None:
        return True
    end = world.node_tree.get_output_node("CYCLES")
    links = end.inputs["Surface"].links if end is not None else ()
    if not links:
        return True
    node = links[0].from_node
    return node.bl_idname == "ShaderNodeBackground" and not any(s.is_linked for s in node.inputs)


def ray_material(scene: bpy.types.Scene, glass_name: str, events: str) -> bpy.types.Material:
    """The material that sends a path's rays on; its images are filled by :func:`write_rays`."""
    key = f"{scene.name} {glass_name} {events}"
    for material in bpy.data.materials:
        if own(material, "rays") and material.get(_KEY) == key:
            return material
    material = bpy.data.materials.new(hidden_name("rays", key))
    material[TAG], material[_KEY] = "rays", key
    tree = material.node_tree
    tree.nodes.clear()
    place = tree.nodes.new("ShaderNodeAttribute")
    place.attribute_name = _PLACE
    portal = tree.nodes.new("ShaderNodeBsdfRayPortal")
    for role, socket in zip(_IMAGES, ("Position", "Direction"), strict=True):
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.name = role
        texture.image = _new_image(hidden_name("rays", key, role))
        texture.extension = "EXTEND"
        tree.links.new(place.outputs["Vector"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], portal.inputs[socket])
    # Rays that do not take the path are stopped: nobody looks at what they would show.
    takes = tree.nodes.new("ShaderNodeMath")
    takes.operation = "GREATER_THAN"
    takes.inputs[1].default_value = 0.0
    tree.links.new(tree.nodes[_IMAGES[0]].outputs["Alpha"], takes.inputs[0])
    tree.links.new(takes.outputs[0], portal.inputs["Color"])
    # A mirrored ray may come back to the camera; there it passes the screen.
    side = tree.nodes.new("ShaderNodeNewGeometry")
    passing = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(side.outputs["Backfacing"], passing.inputs[0])
    tree.links.new(portal.outputs[0], passing.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], passing.inputs[2])
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(passing.outputs[0], end.inputs["Surface"])
    return material


def _new_image(name: str) -> bpy.types.Image:
    image = bpy.data.images.new(name, 4, 4, float_buffer=True, is_data=True)
    image[TAG] = "rays"
    image.alpha_mode = "CHANNEL_PACKED"
    # Directions in half floats would be off by half a pixel.
    image.use_half_precision = False
    return image


def remove_unused_rays() -> None:
    """Remove the ray materials that nothing wears any more, and their images."""
    for material in [m for m in bpy.data.materials if own(m, "rays") and m.users == 0]:
        bpy.data.materials.remove(material)
    for image in [i for i in bpy.data.images if own(i, "rays") and i.users == 0]:
        bpy.data.images.remove(image)


def write_screen(mesh: bpy.types.Mesh, view: Viewpoint, regions: Regions, depth: float) -> None:
    """Make the mesh one triangle before the camera that covers the regions' rectangle.

    Parameters
    ----------
    depth : along the view direction, metres; less than that of anything to be seen.
    """
    x0, y0, x1, y1 = regions.rect
    place = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)])
    origins, directions = view.rays(x0 + place[:, 0] * (x1 - x0), y0 + place[:, 1] * (y1 - y0))
    corners = origins + directions * (depth / (directions @ view.forward))[:, None]
    mesh.clear_geometry()
    mesh.from_pydata(corners.tolist(), [], [(0, 1, 2)])
    write_attribute(mesh, _PLACE, place, "FLOAT_VECTOR")
    mesh.update()


def write_rays(
    material: bpy.types.Material,
    glass: Glass,
    view: Viewpoint,
    path: optics.LightPath,
    regions: Regions,
) -> None:
    """Write where the path's rays leave the glass and in which direction."""
    origin, direction, known = last_rays(glass, view, path, regions)
    for role, values in zip(_IMAGES, (origin, direction), strict=True):
        pixels = np.concatenate((values, known[..., None]), axis=2)
        write_image(material.node_tree.nodes[role].image, pixels)


def last_rays(
    glass: Glass, view: Viewpoint, path: optics.LightPath, regions: Regions
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rays of a path after its last event, over the regions' rectangle.

    Returns
    -------
    origin, direction : (k h, k w, 3) in the world; k = ``RAYS_PER_PIXEL``.
    known : (k h, k w) bool; elsewhere the rays do not take the path and the numbers are 0. A few
        texels beyond the region the nearest rays are repeated.
    """
    k = RAYS_PER_PIXEL
    near = np.kron(regions.weights[regions.paths.index(path)] > 0, np.ones((k, k), bool))
    rows, columns = np.nonzero(near)
    x0, y0 = regions.rect[:2]
    origins, directions = view.rays(x0 + (columns + 0.5) / k, y0 + (rows + 0.5) / k)
    eye = glass.to_local(origins if view.is_parallel else view.eye)
    found = optics.trace(
        unbounded(glass.description), eye, glass.direction_to_local(directions), path
    )
    values = np.zeros((*near.shape, 6))
    extent = getattr(glass.description, "extent", None)
    if extent is not None:
        # A ray that left the wall by its end is let out there: what the glass stands on stops it.
        skin = _SKIN * (extent[1] - extent[0])
        found.origin[:, 2] = np.clip(found.origin[:, 2], extent[0] + skin, extent[1] - skin)
    values[rows, columns, :3] = glass.points_to_world(found.origin)
    values[rows, columns, 3:] = found.direction @ glass.to_world[:3, :3].T
    known = np.zeros(near.shape, bool)
    known[rows, columns] = found.valid
    values[~known] = 0.0
    for _ in range(_MARGIN):
        _grow(values, known)
    return values[..., :3], values[..., 3:], known


def _grow(values: np.ndarray, known: np.ndarray) -> None:
    """Give the texels (h, w, C) next to known ones the mean of those, in place."""
    padded = np.pad(known, 1)
    height, width = known.shape
    around = [s for s in product((0, 1, 2), repeat=2) if s != (1, 1)]
    touched = np.zeros_like(known)
    for dy, dx in around:
        touched |= padded[dy : dy + height, dx : dx + width]
    rows, columns = np.nonzero(touched & ~known)
    total, count = np.zeros((len(rows), values.shape[2])), np.zeros(len(rows))
    for dy, dx in around:
        there = padded[rows + dy, columns + dx]
        y, x = rows[there] + dy - 1, columns[there] + dx - 1
        total[there] += values[y, x]
        count += there
    values[rows, columns] = total / count[:, None]
    known[rows, columns] = True
