# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes, each rendered with this extension and with real glass in Cycles.

    python scripts/random_scenes.py out/random --first 0 --count 50

One to three glasses of all shapes, some tilted, scaled or tinted, before, round and behind random
things under random lamps. A seed is a scene. For each there is a line in ``scenes.jsonl`` (what is
in it, errors, light that no view shows, lines of the status) and a picture: ours, Cycles, and the
difference three times. At the end the scenes are listed in which the glass is worst over what lies
beside it: their pictures are worth a look.

Errors are of colours as the Standard view shows them, each the mean of 7 x 7 pixels, so that noise
counts little; against two references of other seeds, so that theirs does not count at all.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import glass_refraction
from benchmarks.pictures import composite, computed
from glass_refraction.reference.cycles import render_reference
from glass_refraction.reference.metrics import to_srgb
from glass_refraction.reference.png import write_png
from glass_refraction.scene.names import RefractiveGlassError
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.update import memory_of

SIZE = (200, 150)
SAMPLES, REFERENCE_SAMPLES = 32, 48
AROUND = 3
"""Pixels on each side over which differences are averaged."""
WORST = 20
"""One in so many pixels counts for the worst ones."""
FEWEST = 300
"""Pixels of glass in a scene that counts."""
NOISE = 0.004
"""What an error beside the glass is taken to be at least, where scenes are put in order."""
SHAPES = ("CYLINDER", "SPHERE", "SLAB", "TUMBLER", "REVOLUTION")
FORMS = ("WINE", "BOTTLE", "VASE", "BOWL", "LENS")
EVERYDAY = ("TUMBLER", "GLASS_OF_WATER", "WINE_GLASS", "MUG", "BOTTLE", "VASE", "CRYSTAL_BALL")
EVERYDAY_SIZE = 0.12
MESHES = ("ico_sphere", "cube", "torus", "monkey", "cylinder", "bevel", "solidify")
APART = 0.19
"""Metres from one glass to the next: cutting those that overlap takes the reference long."""
PLACES = {
    "behind": ((-0.15, 0.15), (0.08, 0.3), (0.0, 0.15)),
    "before": ((-0.1, 0.1), (-0.2, -0.1), (0.0, 0.05)),
    "inside": ((-0.02, 0.02), (-0.02, 0.02), (0.02, 0.1)),
    "above": ((-0.1, 0.1), (-0.1, 0.1), (0.18, 0.3)),
}
LAMPS = {"SUN": (0.5, 4.0), "POINT": (1.0, 10.0), "AREA": (1.0, 10.0), "SPOT": (2.0, 20.0)}
"""Watts, or W/m² of a sun."""


class Maker:
    """Puts a scene together; `notes` says what is in it."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.notes: list[str] = []

    def among(self, choices) -> str:
        """One of some names."""
        return str(self.random.choice(list(choices)))

    def chance(self, part: float) -> bool:
        """True in a part of all cases."""
        return bool(self.random.random() < part)

    def number(self, low: float, high: float) -> float:
        """Any number between two."""
        return float(self.random.uniform(low, high))

    def numbers(self, low: float, high: float) -> tuple[float, float, float]:
        """Three of them."""
        return tuple(self.random.uniform(low, high, 3).tolist())

    def scene(self) -> bpy.types.Scene:
        """Make the scene anew."""
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.render.resolution_x, scene.render.resolution_y = SIZE
        scene.view_settings.view_transform = "Standard"
        scene.cycles.use_denoising, scene.cycles.samples = False, SAMPLES
        self._world(scene)
        count = int(self.random.choice((1, 1, 1, 2, 2, 3)))
        turn = self.number(0.0, 2.0 * np.pi)
        for number in range(count):
            way = turn + np.pi * number
            place = Vector((np.cos(way), np.sin(way), 0.0)) * (APART * bool(number))
            self._glass(place)
        self._room()
        for number in range(int(self.random.integers(0, 4))):
            self._thing(number)
        for number in range(int(self.random.integers(1, 3))):
            self._lamp(scene, number)
        self._camera(scene)
        if self.chance(0.2):
            self._motion(scene)
        return scene

    def _world(self, scene: bpy.types.Scene) -> None:
        scene.world = bpy.data.worlds.new("World")
        tree = scene.world.node_tree
        background = next(node for node in tree.nodes if node.type == "BACKGROUND")
        background.inputs["Color"].default_value = (*self.numbers(0.2, 1.0), 1.0)
        background.inputs["Strength"].default_value = self.number(0.1, 1.0)
        if self.chance(0.3):
            places = tree.nodes.new("ShaderNodeTexCoord")
            gradient = tree.nodes.new("ShaderNodeTexGradient")
            tree.links.new(places.outputs["Generated"], gradient.inputs["Vector"])
            tree.links.new(gradient.outputs["Color"], background.inputs["Color"])
            self.notes.append("gradient world")

    def _glass(self, place: Vector) -> None:
        kind = self.among(("shape",) * 5 + ("everyday",) * 2 + ("mesh",) * 3)
        ior = float(self.random.choice((1.1, 1.33, 1.5, 2.0, 2.4, self.number(1.05, 2.2))))
        getattr(self, f"_{kind}")(ior)
        obj = bpy.context.active_object
        if kind != "everyday":
            if self.chance(0.5):
                obj.rotation_euler = self.numbers(-0.4, 0.4)
            elif self.chance(0.4):
                obj.rotation_euler = self.numbers(0.0, 2.0 * np.pi)
            if self.chance(0.25):
                even = (self.number(0.5, 1.5),) * 3
                obj.scale = self.numbers(0.7, 1.4) if kind == "mesh" else even
        obj.location = place
        bpy.context.view_layer.update()
        # On the floor, not through it.
        obj.location.z -= min((obj.matrix_world @ Vector(corner)).z for corner in obj.bound_box)
        modifier = glass_modifier(obj)
        if self.chance(0.4):
            write_input(modifier, "Absorption Color", (*self.numbers(0.2, 1.0), 1.0))
            write_input(modifier, "Absorption Distance", self.number(0.005, 0.05))
            self.notes.append("tinted")

    def _shape(self, ior: float) -> None:
        shape = self.among(SHAPES)
        values = {
            "shape": shape,
            "radius": self.number(0.03, 0.07),
            "wall_thickness": float(self.random.choice((5e-4, 0.002, 0.005, 0.01))),
            "height": self.number(0.06, 0.16),
            "ior": ior,
            "contents_ior": float(self.random.choice((1.0, 1.333, 1.5, self.number(1.0, 1.8)))),
        }
        if shape == "SLAB":
            # What lies beneath one has no end, and the reference knows of no such medium.
            values |= {"wall_thickness": self.number(0.003, 0.04), "contents_ior": 1.0}
        if shape in {"TUMBLER", "REVOLUTION"}:
            values["liquid_level"] = float(self.random.choice((0.0, self.number(0.01, 0.06))))
        if shape == "REVOLUTION":
            values["form"] = self.among(FORMS)
        bpy.ops.object.refractive_glass_add(**values)
        self.notes.append(", ".join(f"{k} {v}" for k, v in values.items()))

    def _everyday(self, _ior: float) -> None:
        kind = self.among(EVERYDAY)
        bpy.ops.object.refractive_glass_everyday_add(kind=kind, size=EVERYDAY_SIZE)
        self.notes.append(kind)

    def _mesh(self, ior: float) -> None:
        kind = self.among(MESHES)
        base = {"bevel": "cube", "solidify": "uv_sphere"}.get(kind, kind)
        getattr(bpy.ops.mesh, f"primitive_{base}_add")()
        obj = bpy.context.active_object
        obj.data.transform(obj.matrix_world.Diagonal((0.05, 0.05, 0.05, 1.0)))
        if kind == "bevel":
            modifier = obj.modifiers.new("Bevel", "BEVEL")
            modifier.width, modifier.segments = 0.01, 4
        if kind == "solidify":
            obj.modifiers.new("Solidify", "SOLIDIFY").thickness = 0.004
        if self.chance(0.6):
            bpy.ops.object.shade_smooth()
        bpy.ops.object.refractive_glass_modifier_add(ior=ior)
        self.notes.append(f"mesh {kind}, ior {ior:.2f}")

    def _room(self) -> None:
        if self.chance(0.85):
            size = float(self.random.choice((0.6, 2.0, 8.0)))
            bpy.ops.mesh.primitive_plane_add(size=size, location=(0.0, 0.0, -0.001))
            self._paint("floor")
        if self.chance(0.75):
            bpy.ops.mesh.primitive_plane_add(
                size=float(self.random.choice((0.5, 1.5))),
                location=(0.0, self.number(0.12, 0.5), 0.1),
                rotation=(0.5 * np.pi, 0.0, 0.0),
            )
            self._paint("wall")

    def _thing(self, number: int) -> None:
        where = self.among(PLACES)
        size = self.number(0.01, 0.03) if where in {"inside", "before"} else self.number(0.03, 0.12)
        kind = self.among(("cube", "uv_sphere", "cylinder", "monkey", "cone", "torus"))
        getattr(bpy.ops.mesh, f"primitive_{kind}_add")(
            location=[self.number(*sides) for sides in PLACES[where]],
            rotation=self.numbers(0.0, 2.0 * np.pi),
        )
        obj = bpy.context.active_object
        obj.name, obj.scale = f"Thing {number}", (0.5 * size,) * 3
        self._paint(f"{where}: {kind}")

    def _paint(self, what: str) -> None:
        """Give the active object a material."""
        kind = self.among(("plain", "plain", "checker", "checker", "emission", "satin"))
        material = bpy.data.materials.new(what)
        tree = material.node_tree
        shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        colour = (*self.numbers(0.05, 0.9), 1.0)
        shader.inputs["Base Color"].default_value = colour
        shader.inputs["Roughness"].default_value = 1.0
        shader.inputs["Specular IOR Level"].default_value = 0.0
        if kind == "checker":
            checker = tree.nodes.new("ShaderNodeTexChecker")
            checker.inputs["Scale"].default_value = self.number(3.0, 12.0)
            checker.inputs["Color1"].default_value = colour
            checker.inputs["Color2"].default_value = (*self.numbers(0.05, 0.9), 1.0)
            places = tree.nodes.new("ShaderNodeTexCoord")
            tree.links.new(places.outputs["Generated"], checker.inputs["Vector"])
            tree.links.new(checker.outputs["Color"], shader.inputs["Base Color"])
        elif kind == "emission":
            shader.inputs["Emission Color"].default_value = colour
            shader.inputs["Emission Strength"].default_value = self.number(0.3, 2.0)
        elif kind == "satin":
            shader.inputs["Specular IOR Level"].default_value = 0.5
            shader.inputs["Roughness"].default_value = self.number(0.3, 0.7)
        bpy.context.active_object.data.materials.append(material)
        self.notes.append(f"{what}, {kind}")

    def _lamp(self, scene: bpy.types.Scene, number: int) -> None:
        kind = self.among(LAMPS)
        lamp = bpy.data.lights.new(kind, kind)
        lamp.energy = self.number(*LAMPS[kind])
        obj = bpy.data.objects.new(f"Lamp {number}", lamp)
        away = Vector((self.number(-1, 1), self.number(-1, 1), self.number(0.3, 1.0))).normalized()
        obj.location = away * self.number(0.5, 1.0)
        obj.rotation_euler = away.to_track_quat("Z", "Y").to_euler()
        if kind == "SUN":
            lamp.angle = float(self.random.choice((0.009, 0.1)))
        elif kind == "AREA":
            lamp.size = self.number(0.05, 0.5)
        else:
            lamp.shadow_soft_size = float(self.random.choice((0.0, 0.05, 0.1)))
        scene.collection.objects.link(obj)
        self.notes.append(kind.lower())

    def _camera(self, scene: bpy.types.Scene) -> None:
        data = bpy.data.cameras.new("Camera")
        # What is nearer is cut off in Cycles, the glass included.
        data.lens, data.clip_start = self.number(30.0, 70.0), 0.001
        scene.camera = bpy.data.objects.new("Camera", data)
        scene.collection.objects.link(scene.camera)
        azimuth = self.number(-0.6, 0.6)
        elevation = self.number(*((0.0, 0.3), (0.3, 1.2), (-0.1, 0.05))[self.random.integers(3)])
        level = np.cos(elevation)
        way = Vector((np.sin(azimuth) * level, -np.cos(azimuth) * level, np.sin(elevation)))
        target = Vector((self.number(-0.03, 0.03), 0.0, self.number(0.03, 0.08)))
        scene.camera.location = way * self.number(0.3, 0.7) + Vector((0.0, 0.0, 0.05))
        towards = scene.camera.location - target
        scene.camera.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
        if self.chance(0.1):
            data.type, data.ortho_scale = "ORTHO", 0.3
            self.notes.append("orthographic")
        if self.chance(0.2):
            dof = data.dof
            dof.use_dof, dof.focus_distance = True, towards.length * self.number(0.5, 1.5)
            dof.aperture_fstop, dof.aperture_blades = self.number(0.8, 4.0), self.random.integers(8)
            self.notes.append("depth of field")

    def _motion(self, scene: bpy.types.Scene) -> None:
        """Let some of all that there is pass at an even pace, and turn."""
        scene.render.use_motion_blur = True
        for obj in [o for o in scene.objects if o.type in {"MESH", "CAMERA"}]:
            if not self.chance(0.4):
                continue
            reach = 0.01 if obj.type == "CAMERA" else 0.04
            for path, most in (("location", reach), ("rotation_euler", 2.0 * reach)):
                middle, way = np.array(getattr(obj, path)), np.array(self.numbers(-most, most))
                for frame in (0, 2):
                    setattr(obj, path, middle + (frame - 1) * way)
                    obj.keyframe_insert(path, frame=frame)
            curves = obj.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
            for key in (key for curve in curves for key in curve.keyframe_points):
                key.interpolation = "LINEAR"
            self.notes.append(f"{obj.name} moves")
        scene.frame_set(1)


def blurred(picture: np.ndarray) -> np.ndarray:
    """Means (H, W, 3) round each pixel."""
    side = 2 * AROUND + 1
    padded = np.pad(picture, ((AROUND, AROUND), (AROUND, AROUND), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side), axis=(0, 1))
    return windows.mean(axis=(-2, -1))


def root_mean(squares: np.ndarray) -> float:
    """Root of the mean; products of two differences may have a mean below 0."""
    return float(np.sqrt(max(0.0, squares.mean()))) if squares.size else 0.0


def held_against_cycles(seed: int, engine: str, folder: Path) -> dict:
    """Render one scene both ways, ours by an engine, write its picture, and return its row."""
    began = time.process_time()
    maker = Maker(seed)
    scene = maker.scene()
    row = {"seed": seed, "notes": maker.notes}
    scene.render.engine = engine
    eevee = scene.eevee
    eevee.taa_render_samples, eevee.use_raytracing = SAMPLES, True
    # Metres: its own thickness is more than the things are large.
    eevee.fast_gi_thickness_near = 0.01
    try:
        ours = to_srgb(composite(scene))[..., :3]
        computed(scene)
    except (RefractiveGlassError, RuntimeError) as error:
        return row | {"problem": str(error)}
    status, inside = memory_of(scene).status, memory_of(scene).covered
    references = [
        to_srgb(render_reference(scene, samples=REFERENCE_SAMPLES, seed=seed))[..., :3]
        for seed in (1, 2)
    ]
    mean = 0.5 * (references[0] + references[1])
    first, second = (blurred(ours - reference) for reference in references)
    squares = (first * second).mean(axis=-1)
    worst = np.sort(squares[inside])[-(inside.sum() // WORST) :]
    difference = np.clip(0.5 + 3.0 * (ours - mean), 0.0, 1.0)
    write_png(folder / f"{seed}.png", np.concatenate((ours, mean, difference), axis=1))
    return row | {
        "pixels": int(inside.sum()),
        "inside": root_mean(squares[inside]),
        "worst": root_mean(worst),
        "beside": root_mean(squares[~inside]),
        "unseen": float(status.unseen),
        "status": list(status.problems),
        "cpu_seconds": time.process_time() - began,
    }


def main() -> None:
    """Make scenes, render them, list the worst."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engine", default="CYCLES", choices=("CYCLES", "BLENDER_EEVEE"))
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--count", type=int, default=20, help="how many scenes")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    glass_refraction.register()
    rows = []
    with open(asked.folder / "scenes.jsonl", "a") as lines:
        for seed in range(asked.first, asked.first + asked.count):
            row = held_against_cycles(seed, asked.engine, asked.folder)
            lines.write(json.dumps(row) + "\n")
            lines.flush()
            print(row, flush=True)
            if row.get("pixels", 0) >= FEWEST:
                rows.append(row)
    rows.sort(key=lambda row: -row["inside"] / (NOISE + row["beside"]))
    for row in rows[:10]:
        print("{seed}: inside {inside:.4f}, worst {worst:.4f}, beside {beside:.4f}".format(**row))


if __name__ == "__main__":
    main()
