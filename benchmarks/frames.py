# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a frame is this extension's: CPU time by stage, and how it grows."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from unittest import mock

import bpy
import numpy as np

from glass_refraction.reference.cycles import rendering_direct, scene_depsgraph
from glass_refraction.reference.picture import finished, render_picture
from glass_refraction.scene import update as door
from glass_refraction.scene.build.own_scenes import find_own_scenes
from glass_refraction.scene.memory import counters
from glass_refraction.scene.rays import frame, true
from glass_refraction.scene.rays.caster import Caster
from glass_refraction.scene.rays.follow import Follower
from glass_refraction.scene.rays.radiance import Lookups
from glass_refraction.scene.read.modifier_inputs import glass_modifier
from glass_refraction.scene.read.viewpoint import read_viewpoint, samples_setting

from .pictures import composite, computed, open_scene, timed
from .plots import Chart, Curve
from .settings import Settings
from .text import number, table

TITLE = "What of a frame is ours"

STAGES = {
    "reading": ((true, "_read"),),
    "exit rays": (
        (frame, "centre_rays"),
        (frame, "staged"),
        (Follower, "_whole"),
        (Follower, "_unhidden"),
        (Follower, "_end"),
    ),
    "casts": ((Caster, "aim"), (Caster, "cast")),
    "views": (
        (frame, "place_captures"),
        (frame, "place_skies"),
        (frame, "show"),
        (frame, "ending"),
        (frame, "off_edges"),
    ),
    "shares": ((Lookups, "of"), (frame, "_summed")),
    "writing": ((true, "_write"),),
}
"""Functions by the stage whose time theirs is, without that of others called within."""
COUNTED = ("exit_rays", "casts", "cast_rays")
MOVED = 1e-3
"""How far a thing or the eye moves, metres."""
AIMS = {"first": 2.5, "thing moved": 1.0}
"""CPU seconds wanted at most in EEVEE, beyond the direct picture and the captures."""
SIZES = ((640, 480), (1280, 960), (3264, 2448))
GLASSES = (1, 2, 4, 8, 12)
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by each scene's."""
    small = settings.pick((32, 24), (120, 90), (480, 360))
    tiny = settings.pick((32, 24), (120, 90), (240, 180))
    first = settings.scenes[0]
    renders = []
    for engine in settings.pick(("CYCLES",), ("CYCLES",), ("CYCLES", "BLENDER_EEVEE")):
        scene = open_scene(first, small)
        renders.append({"scene": first.stem, "engine": engine, **_renders(settings, scene, engine)})
    scenes = []
    lit = [path for path in settings.scenes if not path.stem.endswith("_unlit")]
    for path in lit if settings.size == "full" else lit[:1]:
        scene = open_scene(path, small)
        scenes.append({"scene": path.stem, **_moves(scene)})
    sizes = []
    for size in settings.pick(((32, 24),), SIZES[:1], SIZES):
        sizes.append({"size": list(size), **solved(open_scene(first, size), fresh=True)})
    glasses = []
    for count in settings.pick((1, 2), GLASSES[::2], GLASSES):
        glasses.append({"glasses": count, **_moves(_row_of_glasses(count, tiny))})
    meshes = []
    for count in settings.pick(TRIANGLES[:1], TRIANGLES[:2], TRIANGLES):
        scene, triangles = _mesh_glass(count, tiny)
        meshes.append({"triangles": triangles, **_moves(scene)})
    return {
        "resolution": list(small),
        "smaller": list(tiny),
        "renders": renders,
        "scenes": scenes,
        "sizes": sizes,
        "glasses": glasses,
        "meshes": meshes,
    }


# --- measuring -----------------------------------------------------------------------------------


class Stopwatch:
    """CPU seconds of stages, each without those of stages within it."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._within: list[float] = []

    def wrapped(self, stage: str, function):
        """A function whose time counts for a stage."""

        def call(*arguments, **named):
            began = time.process_time()
            self._within.append(0.0)
            try:
                return function(*arguments, **named)
            finally:
                taken = time.process_time() - began
                self.seconds[stage] += taken - self._within.pop()
                if self._within:
                    self._within[-1] += taken

        return call


@contextmanager
def watched() -> Iterator[Stopwatch]:
    """Take the time of all stages."""
    watch = Stopwatch()
    with ExitStack() as patches:
        for stage, places in STAGES.items():
            for owner, name in places:
                function = watch.wrapped(stage, getattr(owner, name))
                patches.enter_context(mock.patch.object(owner, name, function))
        whole = watch.wrapped("rest", true.update)
        patches.enter_context(mock.patch.object(true, "update", whole))
        yield watch


def solved(scene: bpy.types.Scene, *, fresh: bool = False) -> dict:
    """One frame's exit rays, hits and shares without any render: CPU seconds by stage, counts."""
    if fresh:
        door.forget()
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    depsgraph = scene_depsgraph(scene)
    before = Counter(counters)
    with watched() as watch:
        status = true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
    return {
        "stages": dict(watch.seconds),
        "cpu_seconds": sum(watch.seconds.values()),
        "counts": {name: counters[name] - before[name] for name in COUNTED},
        "covered": status.covered,
        "rays": status.rays,
        "ways": status.ways,
    }


def _moves(scene: bpy.types.Scene) -> dict:
    """The first frame, and those after a thing and after the eye moved a little."""
    found = {"first": solved(scene, fresh=True)}
    for name, obj in (("thing moved", thing_of(scene)), ("eye moved", scene.camera)):
        obj.delta_location.x += MOVED
        found[name] = solved(scene)
    return found


def thing_of(scene: bpy.types.Scene) -> bpy.types.Object:
    """What has the most vertices and is no glass."""
    things = [o for o in scene.objects if o.type == "MESH" and glass_modifier(o) is None]
    return max(things, key=lambda obj: len(obj.data.vertices))


def _renders(settings: Settings, scene: bpy.types.Scene, engine: str) -> dict:
    """Whole renders: what of their time is the direct picture's, the captures', and whose."""
    scene.render.engine = engine
    setattr(*samples_setting(scene), settings.pick(1, 4, 16))
    # Not counted: what is loaded, compiled and built once.
    composite(scene)
    rows = []
    door.forget()
    for name, obj in (
        ("first", None),
        ("thing moved", thing_of(scene)),
        ("eye moved", scene.camera),
    ):
        if obj is not None:
            obj.delta_location.x += MOVED
        with watched() as watch:
            _, whole = timed(lambda: composite(scene))
        computed(scene)
        views = [
            s for s in find_own_scenes(scene, (true.CAPTURE, true.SKY)) if s.view_layers[0].use
        ]
        captures = sum(timed(lambda v=view: render_picture(v))[1]["cpu_seconds"] for view in views)
        direct = timed(lambda: finished(rendering_direct(scene)))[1]["cpu_seconds"]
        ours = sum(watch.seconds.values())
        rows.append(
            {
                "name": name,
                "cpu_seconds": whole["cpu_seconds"],
                "direct": direct,
                "captures": captures,
                "views": len(views),
                "stages": dict(watch.seconds),
                "ours": ours,
                "compositor": whole["cpu_seconds"] - direct - captures - ours,
            }
        )
    return {"samples": getattr(*samples_setting(scene)), "rows": rows}


# --- scenes --------------------------------------------------------------------------------------


def _empty_scene(size: tuple[int, int], eye, target) -> bpy.types.Scene:
    """A wall, a floor and a camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    for name, corner, side, other in (
        ("Floor", (-2.0, -2.0, 0.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0)),
        ("Wall", (-2.0, 1.0, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, 2.0)),
    ):
        corner, side, other = (np.array(vector) for vector in (corner, side, other))
        mesh = bpy.data.meshes.new(name)
        points = (corner, corner + side, corner + side + other, corner + other)
        mesh.from_pydata([point.tolist() for point in points], [], [(0, 1, 2, 3)])
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = eye
    towards = camera.location - type(camera.location)(target)
    camera.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def _row_of_glasses(count: int, size: tuple[int, int]) -> bpy.types.Scene:
    """Hollow glasses on a table, in three rows of four at most."""
    scene = _empty_scene(size, (0.0, -1.0, 0.45), (0.0, 0.1, 0.05))
    for k in range(count):
        bpy.ops.object.refractive_glass_add(
            shape="CYLINDER", radius=0.04, wall_thickness=0.003, height=0.12
        )
        row, column = divmod(k, 4)
        bpy.context.active_object.location = (0.12 * (column - 1.5), 0.15 * row, 0.0)
    return scene


def _mesh_glass(count: int, size: tuple[int, int]) -> tuple[bpy.types.Scene, int]:
    """A ball that is a mesh of about so many triangles, and how many it has."""
    scene = _empty_scene(size, (0.0, -0.5, 0.2), (0.0, 0.0, 0.08))
    rings = round((count / 4.0) ** 0.5)
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=2 * rings, ring_count=rings + 1, radius=0.08, location=(0.0, 0.0, 0.09)
    )
    bpy.ops.object.shade_smooth()
    bpy.ops.object.refractive_glass_modifier_add(shape="MESH")
    mesh = bpy.context.active_object.data
    mesh.calc_loop_triangles()
    return scene, len(mesh.loop_triangles)


# --- words ---------------------------------------------------------------------------------------


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    width, height = found["resolution"]
    lines = [
        f"CPU seconds of all threads, {width} x {height} unless said. *Reading* the scene; *exit "
        "rays* through all glasses; *casts* of rays against things and meshes, with their trees of "
        "boxes; *views*: placing captures, and which view shows each hit; *shares* of the light "
        "for the compositor; *writing* pictures, cameras and samples. *First*: nothing known. A "
        f"thing and the eye move by {1e3 * MOVED:g} mm.",
        "",
        "Whole renders. *Direct* is the picture without glass, *captures* the further views, each "
        "rendered again alone; *compositor*: what is left of the whole, so it holds the errors of "
        "the others.",
        "",
    ]
    rows = []
    for render in found["renders"]:
        for row in render["rows"]:
            name = f"{render['scene']}, {ENGINES[render['engine']]}, {row['name']}"
            stages = [row["stages"].get(stage, 0.0) for stage in (*STAGES, "rest")]
            rows.append(
                (
                    name,
                    row["cpu_seconds"],
                    row["direct"],
                    row["captures"],
                    *stages,
                    row["compositor"],
                )
            )
    lines += table(
        ("frame", "whole", "direct", "captures", *STAGES, "rest", "compositor"),
        rows,
    )
    for render in found["renders"]:
        if render["engine"] == "BLENDER_EEVEE":
            told = [
                f"{row['name']} {number(row['ours'] + row['compositor'])} s"
                + (f" (aim: {AIMS[row['name']]:g})" if row["name"] in AIMS else "")
                for row in render["rows"]
            ]
            lines += [
                f"In EEVEE ours beyond the direct picture and the captures: {', '.join(told)}.",
                "",
            ]
    lines += ["Without rendering, by scene:", ""]
    lines += _table("scene", "scene", found["scenes"])
    lines += ["By the picture's size:", "", "![](frames_sizes.png)", ""]
    lines += table(
        ("size", "megapixels", "pixels on glass", "rays", *STAGES, "all", "µs a pixel on glass"),
        [
            (
                "{} x {}".format(*row["size"]),
                row["size"][0] * row["size"][1] / 1e6,
                row["covered"],
                row["rays"],
                *(row["stages"].get(stage, 0.0) for stage in STAGES),
                row["cpu_seconds"],
                1e6 * row["cpu_seconds"] / max(1, row["covered"]),
            )
            for row in found["sizes"]
        ],
    )
    lines += [
        "By the number of glasses (hollow, three rows of four), {} x {}:".format(*found["smaller"]),
        "",
    ]
    lines += _table("glasses", "glasses", found["glasses"])
    lines += ["By the triangles of a ball that is a mesh, {} x {}:".format(*found["smaller"]), ""]
    lines += _table("triangles", "triangles", found["meshes"])
    return lines


ENGINES = {"CYCLES": "Cycles", "BLENDER_EEVEE": "EEVEE"}


def _table(header: str, key: str, rows: list[dict]) -> list[str]:
    """First frames by stage, and what frames after them take."""
    return table(
        (
            header,
            "pixels on glass",
            "rays",
            "ways",
            "casts",
            "rays cast",
            *STAGES,
            "first",
            "thing moved",
            "eye moved",
        ),
        [
            (
                row[key],
                row["first"]["covered"],
                row["first"]["rays"],
                row["first"]["ways"],
                row["first"]["counts"]["casts"],
                row["first"]["counts"]["cast_rays"],
                *(row["first"]["stages"].get(stage, 0.0) for stage in STAGES),
                *(row[name]["cpu_seconds"] for name in ("first", "thing moved", "eye moved")),
            )
            for row in rows
        ],
    )


def charts(found: dict) -> list[Chart]:
    """Time against size."""
    sizes = found["sizes"]
    return [
        Chart(
            "frames_sizes",
            "CPU time of a first frame, without rendering",
            "megapixels",
            "CPU time, s",
            [
                Curve(
                    stage,
                    [row["size"][0] * row["size"][1] / 1e6 for row in sizes],
                    [row["stages"].get(stage, 0.0) for row in sizes],
                )
                for stage in STAGES
            ],
        )
    ]
