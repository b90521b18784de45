# SPDX-License-Identifier: GPL-3.0-or-later
"""EEVEE's own refraction, this extension in EEVEE, and Cycles with real glass: one strip a scene.

    ./run python scripts/eevee.py -o FOLDER demo_scenes/eraser.blend [...]

Writes NAME.png (EEVEE's own, the extension in EEVEE, Cycles) and prints how far the first two are
from the third inside the glass's outline and outside of it. The real glass is one mesh in EEVEE
and in Cycles; EEVEE traces rays on the screen at full resolution, with and without the extension.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import glass_refraction
from glass_refraction.reference.cycles import render_reference, scene_depsgraph
from glass_refraction.reference.glass_mesh import glass_surfaces
from glass_refraction.reference.metrics import psnr, to_srgb
from glass_refraction.reference.picture import render_picture
from glass_refraction.reference.png import write_png
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.vertices.regions import region_masks

SAMPLES = 16


def main() -> None:
    """Compare every scene that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE.blend")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--size", type=int, default=320, help="of a picture, pixels across")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    glass_refraction.register()
    for path in options.scenes:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()))
        pictures, inside = render_all(bpy.context.scene, options.size)
        own, ours, cycles = (to_srgb(picture) for picture in pictures)
        write_png(options.output / f"{path.stem}.png", np.concatenate((own, ours, cycles), axis=1))
        for name, picture in (("EEVEE's own", own), ("the extension in EEVEE", ours)):
            print(
                f"{path.stem}: {name}: {psnr(picture, cycles, inside):.1f} dB in the glass, "
                f"{psnr(picture, cycles, ~inside):.1f} dB beside it"
            )


def render_all(scene: bpy.types.Scene, width: int) -> tuple[list[np.ndarray], np.ndarray]:
    """The three pictures (H, W, 4), and the pixels (H, W) that glass covers."""
    render = scene.render
    render.resolution_y = round(width * render.resolution_y / render.resolution_x)
    render.resolution_x = width
    scene.cycles.samples = 2 * SAMPLES
    scene.eevee.taa_render_samples = SAMPLES
    scene.eevee.use_raytracing = True
    scene.eevee.ray_tracing_method = "SCREEN"
    scene.eevee.ray_tracing_options.resolution_scale = "1"
    cycles = render_reference(scene, surface="GLASS")
    render.engine = "BLENDER_EEVEE"
    inside = ~region_masks(scene, scene_depsgraph(scene))[""]
    ours = render_picture(scene)
    scene.refractive_glass.enabled = False
    with real_glass(scene):
        own = render_picture(scene)
    return [own, ours, cycles], inside


@contextmanager
def real_glass(scene: bpy.types.Scene):
    """The scene's glasses as meshes with EEVEE's own refraction."""
    for glass in read_glasses(scene_depsgraph(scene)):
        scene.objects[glass.name].hide_render = True
        for surface in glass_surfaces(glass.description):
            mesh = bpy.data.meshes.new(surface.name)
            ends = np.cumsum(surface.sizes)
            faces = np.split(surface.corners, ends[:-1])
            mesh.from_pydata(surface.vertices.tolist(), [], [face.tolist() for face in faces])
            mesh.normals_split_custom_set(surface.normals.tolist())
            mesh.materials.append(refracting(surface.ior_inside / surface.ior_outside))
            obj = bpy.data.objects.new(surface.name, mesh)
            obj.matrix_world = Matrix(glass.to_world.tolist())
            obj.visible_shadow = False
            scene.collection.objects.link(obj)
    yield


def refracting(ior: float) -> bpy.types.Material:
    """A clear material that EEVEE refracts by tracing rays on the screen."""
    material = bpy.data.materials.new(f"Glass {ior:g}")
    material.use_raytrace_refraction = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfGlass")
    shader.inputs["Roughness"].default_value = 0.0
    shader.inputs["IOR"].default_value = ior
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs["BSDF"], end.inputs["Surface"])
    return material


if __name__ == "__main__":
    main()
