# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow: Light against a light tracer, outside the glass where light changes.

    python scripts/light_tracer.py SCENE.blend FOLDER [--frame N] [--minutes M] [--engine NAME]
        [--without NAME ...]

Needs Mitsuba 3 beside bpy (`pip install mitsuba`): development only. Its light tracer follows rays
from the scene's sun through the meshes that `Compare` shows Cycles. Both engines see matte things
without a world: the largest is grey, the others are black, so that nothing lights anything else.
Mitsuba's is nearly black too, and its picture brighter by as much: what it adds by itself, light
that things throw back on the glass, is no lamp's light.

Prints the decibels of the picture with Light, with Straight, and of both halves of the reference
against each other. Writes both pictures and their difference, eight times, as a PNG.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import glass_refraction
from glass_refraction.reference.interfaces import interfaces
from glass_refraction.reference.metrics import psnr, to_srgb
from glass_refraction.reference.png import write_png
from glass_refraction.scene.rays import frame as frames
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier

WIDTH, HEIGHT = 320, 240
GREY, DARK = 0.5, 0.05
"""Reflectance of what is lit, in the picture and in Mitsuba."""
FILTER_PX = 0.417
"""Standard deviation of the engines' pixel filter."""
CHANGED = 0.02
"""Of the sun's irradiance: where light counts as changed."""
RAYS = 50
"""A pass and pixel."""
DEPTH = 24
STEPS = 0.7548776662466927, 0.5698402909980532
"""Of the places on the sun, one a pass."""
AROUND = 1.5
"""Of the glasses' size: so far from their middle things are followed; the sun lights all there is.
"""
MARGIN_PX = 2
MAGNIFIED = 8.0


def main() -> None:
    """Render, trace and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frame", type=int)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--engine", default="BLENDER_EEVEE")
    parser.add_argument("--without", nargs="*", default=[])
    args = parser.parse_args()
    try:
        import mitsuba
    except ImportError:
        sys.exit("light_tracer: Mitsuba is missing (pip install mitsuba)")
    args.folder.mkdir(parents=True, exist_ok=True)
    glass_refraction.register()
    scene, sun, things = _scene(args)
    lit, straight, added = _pictures(scene, args)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mitsuba.set_variant("scalar_rgb")
    halves = _traced(mitsuba, scene, sun, things, depsgraph, 60.0 * args.minutes)
    reference = np.mean(halves, axis=0)
    irradiance = sun.data.energy / np.pi
    behind = _grown(reference.max(axis=2) <= 0.0)
    counts = (np.abs(added).max(axis=2) > CHANGED * irradiance) & ~behind
    shown = [np.clip(to_srgb(part), 0.0, 1.0) for part in (lit, straight, reference, *halves)]
    print(f"{counts.sum()} pixels; with Light {psnr(shown[0], shown[2], counts):.1f} dB")
    print(f"with Straight {psnr(shown[1], shown[2], counts):.1f} dB")
    print(f"halves of the reference {psnr(shown[3], shown[4], counts):.1f} dB")
    error = np.clip(MAGNIFIED * np.abs(shown[0] - shown[2]), 0.0, 1.0) * counts[..., None]
    strip = np.concatenate((shown[0], shown[2], error), axis=1)
    write_png(args.folder / "light_tracer.png", strip[::-1])


def _scene(args):
    """The file's scene with one sun and matte things, and these."""
    bpy.ops.wm.open_mainfile(filepath=str(args.scene.resolve()))
    scene = bpy.context.scene
    scene.frame_set(scene.frame_current if args.frame is None else args.frame)
    for name in args.without:
        bpy.data.objects.remove(bpy.data.objects[name])
    scene.world = None
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    (sun,) = (obj for obj in scene.objects if obj.type == "LIGHT")
    sun.data.color = (1.0, 1.0, 1.0)
    meshes = [obj for obj in scene.objects if obj.type == "MESH" and not glass_modifier(obj)]
    things = sorted(meshes, key=lambda obj: max(obj.dimensions), reverse=True)
    for obj, reflectance in zip(things, (GREY, *(0.0,) * len(things)), strict=False):
        obj.data.materials.clear()
        obj.data.materials.append(_matte(reflectance))
    return scene, sun, things


def _matte(reflectance: float) -> bpy.types.Material:
    material = bpy.data.materials.new("Matte")
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*(reflectance,) * 3, 1.0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


def _pictures(scene: bpy.types.Scene, args) -> list[np.ndarray]:
    """Linear (H, W, 3), top row first: with Light, with Straight, and what Light adds to white."""
    scene.render.engine = args.engine
    scene.cycles.samples, scene.cycles.max_bounces = 32, 0
    scene.cycles.use_denoising = False
    scene.eevee.taa_render_samples = 16
    settings = scene.refractive_glass
    settings.shading, settings.quality = "TRUE", "GOOD"
    image = scene.render.image_settings
    image.media_type, image.file_format, image.color_depth = "IMAGE", "OPEN_EXR", "32"
    added: list[np.ndarray] = []
    computed = frames.light_maps

    def keep(*given):
        found = computed(*given)
        added[:] = [found[0][::-1]]
        return found

    frames.light_maps = keep
    pictures = []
    for shadow in ("LIGHT", "STRAIGHT"):
        settings.shadow = shadow
        scene.render.filepath = str(args.folder / f"{shadow}.exr")
        bpy.ops.render.render(write_still=True)
        loaded = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(WIDTH * HEIGHT * 4, np.float32)
        loaded.pixels.foreach_get(pixels)
        pictures.append(pixels.reshape(HEIGHT, WIDTH, 4)[::-1, :, :3].astype(float))
    return [*pictures, *added]


def _traced(mitsuba, scene, sun, things, depsgraph, seconds: float) -> list[np.ndarray]:
    """Two independent pictures (H, W, 3) by rays from the sun, as bright as with `GREY`."""
    camera = scene.camera.evaluated_get(depsgraph)
    # Mitsuba's camera looks along +z, its x to the left.
    to_world = np.array(camera.matrix_world) @ np.diag((-1.0, 1.0, -1.0, 1.0))
    described = {
        "type": "scene",
        "integrator": {"type": "ptracer", "max_depth": DEPTH, "rr_depth": 1000},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(camera.data.angle_x)),
            "fov_axis": "x",
            "to_world": mitsuba.ScalarTransform4f(to_world),
            "film": {
                "type": "hdrfilm",
                "width": WIDTH,
                "height": HEIGHT,
                "component_format": "float32",
                "rfilter": {"type": "gaussian", "stddev": FILTER_PX},
            },
        },
        "sun": {
            "type": "directional",
            "irradiance": {"type": "rgb", "value": float(sun.data.energy)},
        },
    }
    found = interfaces(read_glasses(depsgraph))
    corners = np.array((found.points.min(axis=(0, 1)), found.points.max(axis=(0, 1))))
    reach = AROUND * np.linalg.norm(corners[1] - corners[0])
    limits = corners.mean(axis=0) - reach, corners.mean(axis=0) + reach
    for number, obj in enumerate(things):
        evaluated = obj.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        points = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices])
        faces = np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])
        colour = {"type": "rgb", "value": 0.0 if number else DARK}
        matte = {"type": "twosided", "side": {"type": "diffuse", "reflectance": colour}}
        described[f"thing{number}"] = _mesh(mitsuba, np.clip(points, *limits), faces, matte)
    for number, ior in enumerate(np.unique(found.ior)):
        some = found.ior == ior
        points, normals = (
            part[some].reshape(-1, 3).astype(float) for part in (found.points, found.normals)
        )
        faces = np.arange(len(points)).reshape(-1, 3)
        clear = {"type": "dielectric", "int_ior": float(ior), "ext_ior": 1.0}
        described[f"glass{number}"] = _mesh(mitsuba, points, faces, clear, normals)
    traced = mitsuba.load_dict(described)
    parameters = mitsuba.traverse(traced)
    axes = np.array(sun.matrix_world)[:3, :3]
    widest = np.tan(0.5 * sun.data.angle)
    sums, passes = np.zeros((2, HEIGHT, WIDTH, 3)), np.zeros(2)
    begun = time.monotonic()
    while time.monotonic() - begun < seconds or passes.min() == 0:
        number = int(passes.sum())
        radius, turn = ((0.5 + number * step) % 1.0 for step in STEPS)
        aside = widest * np.sqrt(radius)
        local = aside * np.cos(2 * np.pi * turn), aside * np.sin(2 * np.pi * turn), -1.0
        parameters["sun.to_world"] = mitsuba.ScalarTransform4f().look_at(
            origin=[0.0] * 3, target=list(map(float, axes @ local)), up=list(map(float, axes[:, 0]))
        )
        parameters.update()
        sums[number % 2] += np.array(mitsuba.render(traced, spp=RAYS, seed=number))[..., :3]
        passes[number % 2] += 1
    print(f"{passes.sum() * RAYS * WIDTH * HEIGHT / 1e6:.0f} million rays")
    return list(sums * (GREY / DARK) / passes[:, None, None, None])


def _mesh(mitsuba, points, faces, material: dict, normals=None):
    properties = mitsuba.Properties()
    properties["material"] = mitsuba.load_dict(material)
    mesh = mitsuba.Mesh(
        "mesh", len(points), len(faces), has_vertex_normals=normals is not None, props=properties
    )
    values = mitsuba.traverse(mesh)
    values["vertex_positions"] = points.astype(np.float32).ravel()
    values["faces"] = faces.astype(np.uint32).ravel()
    if normals is not None:
        values["vertex_normals"] = normals.astype(np.float32).ravel()
    values.update()
    return mesh


def _grown(mask: np.ndarray) -> np.ndarray:
    steps = range(-MARGIN_PX, MARGIN_PX + 1)
    return np.any([np.roll(mask, (y, x), (0, 1)) for y in steps for x in steps], axis=0)


if __name__ == "__main__":
    main()
    # Mitsuba's and Blender's libraries do not end well together.
    sys.stdout.flush()
    os._exit(0)
