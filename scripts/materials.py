# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses whose materials have textures, and many drops, each beside the same real glass in Cycles.

    python scripts/materials.py out/materials
    python scripts/materials.py out/materials window drops

Prints for each case and engine the error inside the glass (PSNR of colours as the Standard view
shows them, against 400 samples) and the frame's CPU seconds over those of real glass at as many
samples. EEVEE's own lighting counts as error, too. Writes of each a strip of pictures: real glass,
Cycles, EEVEE, and Cycles' difference three times.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import glass_refraction
from glass_refraction.reference.metrics import to_srgb
from glass_refraction.reference.png import write_png
from glass_refraction.scene.update import status

SIZE = (320, 240)
SAMPLES, REAL_SAMPLES = 32, 400
WALL = 1.5
"""Metres behind the glass."""
PANE = (1.6, 0.1, 1.2)
BOX = (0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)
"""Corners of a box's faces, seen anticlockwise from outside; x counts first, then y, then z."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], default=[])
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    print("| case | Cycles, dB | EEVEE, dB | CPU over real glass, first / again |")
    print("| --- | ---: | ---: | ---: |")
    for name in options.cases or CASES:
        print(f"| {name} | {' | '.join(_measured(name, options.folder))} |", flush=True)


def _measured(name: str, folder: Path) -> list[str]:
    """The row of a case."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()
    glasses = CASES[name]()
    _surroundings()
    scene, folder = bpy.context.scene, folder / name
    real, _ = _rendered(scene, folder, REAL_SAMPLES)
    bare, real_seconds = _rendered(scene, folder, SAMPLES)
    # Where the glass is, real glass at few samples tells.
    for obj in glasses:
        obj.hide_render = True
    without, _ = _rendered(scene, folder, SAMPLES)
    inside = np.abs(without - bare).max(axis=2) > 0.05
    for obj in glasses:
        obj.hide_render = False
        bpy.context.view_layer.objects.active = obj
        if bpy.ops.object.refractive_glass_modifier_add(shape="MESH") != {"FINISHED"}:
            raise SystemExit(f"{obj.name} is no glass")
    ours, first = _rendered(scene, folder, SAMPLES)
    _, again = _rendered(scene, folder, SAMPLES)
    for line in status(scene).problems:
        print(f"{name}: {line}", file=sys.stderr)
    scene.render.engine = "BLENDER_EEVEE"
    eevee, _ = _rendered(scene, folder, SAMPLES)
    off = 3.0 * np.abs(real - ours)
    strip = np.concatenate((real, ours, eevee, np.clip(off, 0.0, 1.0)), axis=1)
    write_png(folder.with_suffix(".png"), strip)
    errors = [f"{_psnr(real, picture, inside):.1f}" for picture in (ours, eevee)]
    return [*errors, f"{first / real_seconds:.2f} / {again / real_seconds:.2f}"]


def _psnr(one: np.ndarray, other: np.ndarray, inside: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((one - other)[inside] ** 2)))


def _rendered(scene: bpy.types.Scene, path: Path, samples: int) -> tuple[np.ndarray, float]:
    """The frame as F12 makes it, (H, W, 3), and its CPU seconds."""
    scene.cycles.samples = samples
    image = scene.render.image_settings
    image.media_type, image.file_format, image.color_depth = "IMAGE", "OPEN_EXR", "32"
    scene.render.filepath = str(path.with_suffix(".exr"))
    began = time.process_time()
    bpy.ops.render.render(write_still=True)
    seconds = time.process_time() - began
    loaded = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(len(loaded.pixels), np.float32)
    loaded.pixels.foreach_get(pixels)
    bpy.data.images.remove(loaded)
    path.with_suffix(".exr").unlink()
    return to_srgb(pixels.reshape(SIZE[1], SIZE[0], -1)[..., :3]), seconds


# ---- what is seen -------------------------------------------------------------------------------


def _surroundings() -> None:
    """A checkered wall behind, a floor, a ball, a lamp and a camera."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.view_settings.view_transform = "Standard"
    scene.refractive_glass.shading, scene.refractive_glass.surface = "TRUE", "GLASS"
    wall = _plane((0.0, WALL, 0.0), (np.pi / 2, 0.0, 0.0))
    wall.data.materials.append(_checkered((0.9, 0.85, 0.7), (0.25, 0.35, 0.6)))
    floor = _plane((0.0, 0.0, -0.62), (0.0, 0.0, 0.0))
    floor.data.materials.append(_checkered((0.7, 0.7, 0.7), (0.4, 0.3, 0.25)))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.25, location=(0.35, 0.9, -0.3))
    bpy.ops.object.shade_smooth()
    ball = bpy.data.materials.new("Ball")
    ball.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.1, 0.1, 1)
    bpy.context.object.data.materials.append(ball)
    bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.3, 0.0))
    bpy.context.object.data.energy = 2.5
    bpy.context.object.data.use_shadow = False
    world = bpy.data.worlds.new("Grey")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.4, 0.45, 0.5, 1.0)
    scene.world = world
    bpy.ops.object.camera_add(location=(0.1, -3.0, 0.15), rotation=(np.pi / 2 - 0.05, 0.0, 0.03))
    scene.camera = bpy.context.object


def _plane(location: tuple, rotation: tuple) -> bpy.types.Object:
    bpy.ops.mesh.primitive_plane_add(size=8.0, location=location, rotation=rotation)
    return bpy.context.object


def _checkered(*colours: tuple) -> bpy.types.Material:
    material = bpy.data.materials.new("Checkered")
    tree = material.node_tree
    checker = tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 40.0
    for name, colour in zip(("Color1", "Color2"), colours, strict=True):
        checker.inputs[name].default_value = (*colour, 1.0)
    tree.links.new(checker.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return material


# ---- glasses ------------------------------------------------------------------------------------


def _glass(colour: tuple = (1.0, 1.0, 1.0), roughness: float = 0.0, ior: float = 1.5):
    """A material of glass, its node tree, and its shader."""
    material = bpy.data.materials.new("Glass")
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Transmission Weight"].default_value = 1.0
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["IOR"].default_value = ior
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    return material, tree, shader


def _noise(tree: bpy.types.NodeTree, scale: float, detail: float = 0.0) -> bpy.types.Node:
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = scale, detail
    place = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(place.outputs["Object"], noise.inputs["Vector"])
    return noise


def _picture(pixels: np.ndarray) -> bpy.types.Image:
    """An image of colours (H, W, 3)."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("Picture", width, height)
    image.pixels.foreach_set(np.dstack((pixels, np.ones((height, width)))).astype("f4").ravel())
    image.pack()
    return image


def _box(material: bpy.types.Material, size: tuple = PANE) -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=1.0, scale=size)
    bpy.ops.object.transform_apply(scale=True)
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def _coloured() -> list[bpy.types.Object]:
    """Colours of a noise."""
    material, tree, shader = _glass()
    tree.links.new(_noise(tree, 3.0, 2.0).outputs["Color"], shader.inputs["Base Color"])
    return [_box(material)]


def _image() -> list[bpy.types.Object]:
    """A picture of small panes, by UV, on a mesh that is subdivided."""
    rng = np.random.default_rng(3)
    # Large enough that its pixels do not show: Cycles mixes those of eight bits as they are stored.
    cells = np.kron(rng.uniform(0.2, 1.0, (8, 8, 3)), np.ones((128, 128, 1)))
    for first in range(12):
        cells[first::128] = cells[:, first::128] = 0.02
    material, tree, shader = _glass()
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = _picture(cells)
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    pane = _box(material)
    divided = pane.modifiers.new("Fine", "SUBSURF")
    divided.subdivision_type, divided.levels, divided.render_levels = "SIMPLE", 2, 2
    return [pane]


def _etched() -> list[bpy.types.Object]:
    """Clear and frosted squares."""
    material, tree, shader = _glass((0.9, 1.0, 0.95))
    checker = tree.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 5.0
    place = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(place.outputs["Object"], checker.inputs["Vector"])
    part = tree.nodes.new("ShaderNodeMath")
    part.operation, part.inputs[1].default_value = "MULTIPLY", 0.25
    tree.links.new(checker.outputs["Fac"], part.inputs[0])
    tree.links.new(part.outputs[0], shader.inputs["Roughness"])
    return [_box(material)]


def _window() -> list[bpy.types.Object]:
    """Panes of glassy materials and bars of lead, all one mesh."""
    rng, count, step, bar = np.random.default_rng(5), 6, 0.2, 0.012
    colours = (
        *((0.8, 0.1, 0.05), (0.05, 0.3, 0.8), (0.9, 0.7, 0.1)),
        *((0.1, 0.6, 0.2), (0.95, 0.95, 0.95), (0.5, 0.1, 0.6)),
    )
    lead = bpy.data.materials.new("Lead")
    lead.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.03,) * 3 + (1,)
    materials = [_glass(c, 0.2 if min(c) > 0.9 else 0.0)[0] for c in colours] + [lead]
    points, faces, slots = [], [], []

    def box(low: tuple, high: tuple, material: int) -> None:
        first = len(points)
        x, y, z = zip(low, high, strict=True)
        points.extend((a, b, c) for c in z for b in y for a in x)
        faces.extend([first + corner for corner in face] for face in BOX)
        slots.extend([material] * len(BOX))

    ends = [-0.6 + number * step for number in range(count + 1)]
    for x in ends[:-1]:
        for z in ends[:-1]:
            low, high = (x + bar, -0.01, z + bar), (x + step - bar, 0.01, z + step - bar)
            box(low, high, int(rng.integers(len(colours))))
    for at in ends:
        box((at - bar, -0.02, -0.6), (at + bar, 0.02, 0.6), len(colours))
        box((-0.6, -0.019, at - bar), (0.6, 0.019, at + bar), len(colours))
    mesh = bpy.data.meshes.new("Window")
    mesh.from_pydata(points, [], faces)
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", slots)
    window = bpy.data.objects.new("Window", mesh)
    bpy.context.collection.objects.link(window)
    return [window]


def _bumped() -> list[bpy.types.Object]:
    """A pane with bumps of a noise."""
    material, tree, shader = _glass()
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = 0.05
    tree.links.new(_noise(tree, 3.0).outputs[0], bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return [_box(material)]


def _drops() -> list[bpy.types.Object]:
    """Two hundred drops of one mesh, by Geometry Nodes."""
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=24, ring_count=16, radius=0.03, location=(0, 9, 0)
    )
    bpy.ops.object.shade_smooth()
    drop = bpy.context.object
    drop.data.materials.append(_glass(ior=1.333)[0])
    rng = np.random.default_rng(1)
    mesh = bpy.data.meshes.new("Places")
    mesh.from_pydata(rng.uniform((-0.7, -0.05, -0.5), (0.7, 0.05, 0.5), (200, 3)), [], [])
    host = bpy.data.objects.new("Drops", mesh)
    bpy.context.collection.objects.link(host)
    tree = bpy.data.node_groups.new("Drops", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    placed, info = (tree.nodes.new(f"GeometryNode{k}") for k in ("InstanceOnPoints", "ObjectInfo"))
    size = tree.nodes.new("FunctionNodeRandomValue")
    size.inputs[2].default_value, size.inputs[3].default_value = 0.4, 1.2
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = drop, True
    tree.links.new(begin.outputs[0], placed.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], placed.inputs["Instance"])
    tree.links.new(size.outputs[1], placed.inputs["Scale"])
    tree.links.new(placed.outputs[0], end.inputs[0])
    host.modifiers.new("Drops", "NODES").node_group = tree
    return [drop]


CASES: dict[str, Callable[[], list[bpy.types.Object]]] = {
    "coloured": _coloured,
    "image": _image,
    "etched": _etched,
    "window": _window,
    "bumped": _bumped,
    "drops": _drops,
}

if __name__ == "__main__":
    main()
