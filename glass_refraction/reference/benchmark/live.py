# SPDX-License-Identifier: GPL-3.0-or-later
"""What an update costs inside Blender: from a changed source to its evaluated copy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np

from ... import optics
from ...scene import update as door
from ...scene.build.layers import Layers, find_layers
from ...scene.read.arrays import positions
from ...scene.read.glasses import read_glasses, unbounded
from ...scene.read.viewpoint import read_viewpoint
from ...scene.vertices.regions import path_regions
from . import newton
from .cases import BEHIND_HOLLOW, HOLLOW
from .forward import angles_px
from .measure import ratio, resident_bytes, seconds, spread, timings
from .plots import Chart, Curve
from .settings import Settings
from .text import milliseconds, number, quotient, table

TITLE = "Live"

SIZE = (1600, 1200)
ERROR_PX = 0.05
STEP = 1e-3
"""How far a source moves from frame to frame, metres."""
COARSE = 4
"""Pixels a side for each ray of the coarse masks."""
PLAIN_POINTS = 100_000
PLAIN_SECONDS = 0.080
"""What four plain steps of so many points take on the machine for which the aims were written."""
AIMS = {100_000: 60.0, 1_000_000: 7.0}
"""Updates a second there."""


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by an empty one."""
    counts = settings.pick((400,), (100_000,), (100_000, 1_000_000))
    return {
        "moving": [_moving(settings, count) for count in counts],
        "masks": _masks(settings),
        "memory": _memory(settings),
    }


# --- the scene -----------------------------------------------------------------------------------


def _scene(vertices: int) -> tuple[bpy.types.Scene, bpy.types.Object]:
    """A wavy sheet behind a hollow glass, one light path; returns the scene and the sheet."""
    bpy.ops.wm.read_homefile(use_empty=True, load_ui=False)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.refractive_glass.surface = "REFRACTION"
    scene.refractive_glass.shading = "DISPLACED"
    # The solver is asked for a tenth of the tolerance.
    scene.refractive_glass.tolerance_px = 10.0 * ERROR_PX
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -0.5, 0.09), (0.48 * np.pi, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    sheet = bpy.data.objects.new("Sheet", _sheet(vertices))
    sheet.location = (0.0, 0.1, 0.05)
    scene.collection.objects.link(sheet)
    bpy.ops.object.refractive_glass_add(
        shape="CYLINDER", radius=0.04, wall_thickness=0.003, height=0.12, ior=1.5
    )
    return scene, sheet


def _sheet(vertices: int) -> bpy.types.Mesh:
    """A wavy square sheet of about so many vertices, 44 mm wide, faces towards −y."""
    side = round(vertices**0.5)
    u, v = np.meshgrid(np.linspace(-0.022, 0.022, side), np.linspace(-0.022, 0.022, side))
    y = 0.004 * np.sin(300.0 * u) * np.cos(300.0 * v)
    points = np.stack((u, y, v), axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.stack((first, first + 1, first + side + 1, first + side), axis=1).astype(np.int32)
    mesh = bpy.data.meshes.new("Sheet")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    return mesh


class _Playback:
    """Frames of a source that moves: what is timed, in its three pieces."""

    def __init__(self, scene: bpy.types.Scene, move: Callable[[int], None]) -> None:
        self.scene, self.move = scene, move
        self.frame = 0
        self.pieces: dict[str, list[float]] = {"source": [], "update": [], "copy": []}
        view_layer = scene.view_layers[0]
        view_layer.update()
        door.prepare(scene, view_layer.depsgraph, strict=True)
        self.layers: Layers = find_layers(scene)
        self.copy = next(c for (_, slot, _), c in self.layers.copies().items() if slot == 0)
        self.shown_in = next(
            layer for layer in self.layers.displaced.view_layers if self.copy.name in layer.objects
        )

    def step(self) -> None:
        """Change the source, update, and evaluate the copy."""
        self.frame += 1
        view_layer = self.scene.view_layers[0]

        def change():
            self.move(self.frame)
            view_layer.update()

        self.pieces["source"].append(seconds(change))
        self.pieces["update"].append(seconds(lambda: door.update(self.scene, view_layer.depsgraph)))
        self.pieces["copy"].append(seconds(self.evaluate))

    def evaluate(self) -> None:
        """Bring the copy up to date where it is shown, and read that it is there."""
        self.shown_in.update()
        evaluated = self.copy.evaluated_get(self.shown_in.depsgraph)
        if not len(evaluated.data.vertices):
            raise RuntimeError("the copy came out empty: the benchmark's own scene is wrong")

    def play(
        self, frames: int, plain: Callable[[], object]
    ) -> tuple[dict[str, dict], Counter[str]]:
        """Times of some frames and, in turns with them, of the plain baseline; operations of all.

        Two frames before them are not counted: the first ones look at everything.
        """
        for _ in range(2):
            self.step()
        for taken in self.pieces.values():
            taken.clear()
        before = door.counters.copy()
        taken: dict[str, list[float]] = {"frame": [], "plain": []}
        for _ in range(frames):
            taken["frame"].append(seconds(self.step))
            taken["plain"].append(seconds(plain))
        done = door.counters - before
        return {name: spread(found) for name, found in taken.items()}, done


def _swing(frame: int) -> float:
    """Back and forth, a step a frame, never far from the middle."""
    return STEP * (abs(frame % 20 - 10) - 5)


# --- what is measured ----------------------------------------------------------------------------


def _moving(settings: Settings, count: int) -> dict:
    """A moved and a deformed source of so many vertices, beside the plain baseline."""
    frames = settings.pick(2, 12, 40 if count <= 100_000 else 12)
    points = BEHIND_HOLLOW.points(
        settings.random(11), settings.pick(400, PLAIN_POINTS, PLAIN_POINTS)
    )

    def plain():
        return newton.cylinder_places(HOLLOW, BEHIND_HOLLOW.eye, points)

    rows = []
    for name in ("moved", "deformed"):
        scene, sheet = _scene(count)
        rest = positions(sheet.data).astype(np.float32)

        def move(frame, sheet=sheet):
            sheet.location.x = _swing(frame)

        def deform(frame, sheet=sheet, rest=rest):
            bent = rest + np.array((_swing(frame), 0.0, 0.0), np.float32)
            sheet.data.attributes["position"].data.foreach_set("vector", bent.ravel())
            sheet.data.update_tag()

        playback = _Playback(scene, move if name == "moved" else deform)
        taken, done = playback.play(frames, plain)
        rows.append(
            {
                "change": name,
                "vertices": len(sheet.data.vertices),
                "frames": frames,
                "frame": taken["frame"],
                "plain": taken["plain"],
                "of_plain": ratio(taken["frame"], taken["plain"]),
                "pieces": {part: spread(found) for part, found in playback.pieces.items()},
                "solves": done["solves"],
                "mask_pixels": done["mask_pixels"],
                "error_px": _error(playback, sheet),
            }
        )
    still = _nothing_changed(settings, playback)
    return {
        "vertices": rows[0]["vertices"],
        "rows": rows,
        "still": still,
        "aim": AIMS.get(count),
    }


def _nothing_changed(settings: Settings, playback: _Playback) -> dict:
    scene, view_layer = playback.scene, playback.scene.view_layers[0]
    before = door.counters.copy()
    taken = [
        seconds(lambda: door.update(scene, view_layer.depsgraph))
        for _ in range(settings.pick(2, 50, 200))
    ]
    return {"seconds": spread(taken), "operations": sum((door.counters - before).values())}


def _error(playback: _Playback, sheet: bpy.types.Object) -> dict:
    """Pixels between where the copy's vertices are drawn and where they should be."""
    scene, depsgraph = playback.scene, playback.scene.view_layers[0].depsgraph
    (glass,) = read_glasses(depsgraph)
    view = read_viewpoint(scene, depsgraph)
    matrix = np.array(sheet.evaluated_get(depsgraph).matrix_world, float)
    points = positions(sheet.data) @ matrix[:3, :3].T + matrix[:3, 3]
    eye = view.eye_for(glass)
    true = optics.apparent_points(
        unbounded(glass.description), "TTTT", eye, glass.to_local(points), tolerance=1e-9
    )
    drawn = positions(playback.copy.data)
    if len(drawn) != len(points):
        return {"max": None, "mean": None}
    towards = glass.to_local(drawn) - eye
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    (slot,) = np.flatnonzero(true.valid.any(axis=1))
    shown = true.valid[slot]
    errors = angles_px(towards[shown], true.direction[slot, shown]) * view.focal_px / 2400.0
    return {"max": float(errors.max()), "mean": float(errors.mean())}


def _masks(settings: Settings) -> dict:
    """Weights of all paths of a picture of 1600 x 1200, and the coarse ones of a moving view."""
    scene, _ = _scene(400)
    scene.refractive_glass.surface = "GLASS"
    view_layer = scene.view_layers[0]
    view_layer.update()
    (glass,) = read_glasses(view_layer.depsgraph)
    size = settings.pick((160, 120), SIZE, SIZE)
    scene.render.resolution_x, scene.render.resolution_y = size
    view = read_viewpoint(scene, view_layer.depsgraph)
    paths = door.kept_paths(scene, glass, view)
    small = tuple(n // COARSE for n in view.size)
    coarse = replace(view, size=small, window=(0, 0, *small))
    candidates = {
        "whole": lambda: path_regions(glass, view, paths),
        "coarse": lambda: path_regions(glass, coarse, paths, smooth=False),
    }
    times = timings(candidates, settings.repeats)
    return {
        "resolution": list(view.size),
        "coarse": list(small),
        "paths": [path.events for path in paths],
        "pixels": int(path_regions(glass, view, paths, smooth=False).hit.size),
        "times": times,
        "coarse_of_whole": ratio(times["coarse"], times["whole"]),
    }


def _memory(settings: Settings) -> dict:
    """Memory in use while a source of 10,000 vertices moves for a thousand frames."""
    scene, sheet = _scene(settings.pick(400, 10_000, 10_000))

    def move(frame):
        sheet.location.x = _swing(frame)

    playback = _Playback(scene, move)
    frames = settings.pick(10, 200, 1000)
    blocks = {"meshes": len(bpy.data.meshes), "objects": len(bpy.data.objects)}
    marks = []
    for frame in range(frames + 1):
        playback.step()
        if frame % (frames // 10) == 0:
            marks.append({"frame": frame, "bytes": resident_bytes()})
    return {
        "vertices": len(sheet.data.vertices),
        "frames": frames,
        "marks": marks,
        "new_data_blocks": sum(len(getattr(bpy.data, k)) - n for k, n in blocks.items()),
    }


# --- words ---------------------------------------------------------------------------------------


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "A wavy sheet behind a hollow glass, one light path, a picture of 1600 x 1200; every frame "
        "moves all its vertices by a millimetre. *Frame*: the source changed and evaluated, the "
        "update, and the copy evaluated where it is shown; nothing is drawn. *Error*: between the "
        "copy's vertices as they were written and the solution at 1e-9 rad. *Of plain*: a frame's "
        f"time over that of four plain float64 Newton steps of {number(PLAIN_POINTS)} points, "
        "taken in turns with the frames. *Scaled*: updates a second where those steps take "
        f"{1e3 * PLAIN_SECONDS:g} ms, for which the aims were set.",
        "",
    ]
    rows = []
    for group in found["moving"]:
        for row in group["rows"]:
            rows.append(
                (
                    row["vertices"],
                    row["change"],
                    milliseconds(row["frame"]),
                    *(1e3 * row["pieces"][part]["median"] for part in ("source", "update", "copy")),
                    row["error_px"]["max"],
                    1.0 / row["frame"]["median"],
                    quotient(row["of_plain"]),
                    1.0 / row["of_plain"]["median"] / PLAIN_SECONDS,
                    group["aim"],
                )
            )
    lines += table(
        (
            "vertices",
            "change",
            "frame, ms",
            "source, ms",
            "update, ms",
            "copy, ms",
            "max error, px",
            "updates a second",
            "of plain",
            "scaled",
            "aim",
        ),
        rows,
    )
    rows = [
        (
            group["vertices"],
            milliseconds(group["still"]["seconds"]),
            group["still"]["operations"],
            sum(row["solves"] for row in group["rows"]),
            sum(row["frames"] for row in group["rows"]),
            sum(row["mask_pixels"] for row in group["rows"]),
        )
        for group in found["moving"]
    ]
    lines += table(
        (
            "vertices",
            "nothing changed, ms",
            "its operations",
            "solves",
            "in frames",
            "mask pixels in them",
        ),
        rows,
    )
    masks = found["masks"]
    lines += [
        f"Weights of {', '.join(masks['paths'])} over {number(masks['pixels'])} pixels of a "
        "{} x {} picture, everything new: ".format(*masks["resolution"])
        + f"{milliseconds(masks['times']['whole'])} ms; coarse, one ray for {COARSE} x {COARSE} "
        f"pixels: {milliseconds(masks['times']['coarse'])} ms "
        f"({quotient(masks['coarse_of_whole'])} of that).",
        "",
    ]
    memory = found["memory"]
    known = all(mark["bytes"] is not None for mark in memory["marks"])
    grown = ""
    if known:
        second, last = memory["marks"][1]["bytes"], memory["marks"][-1]["bytes"]
        grown = f"; grown by {(last - second) / 1e6:.2f} MB since the second mark"
    lines += [
        f"Memory over {number(memory['frames'])} frames of {number(memory['vertices'])} moving "
        f"vertices; data-blocks made meanwhile: {memory['new_data_blocks']}{grown}.",
        "",
    ]
    if known:
        lines += ["![](live_memory.png)", ""]
        lines += table(
            ("frame", *(number(mark["frame"]) for mark in memory["marks"])),
            [("in use, MB", *(f"{mark['bytes'] / 1e6:.1f}" for mark in memory["marks"]))],
        )
    return lines


def charts(found: dict) -> list[Chart]:
    """Memory over the frames, where the system tells it."""
    marks = found["memory"]["marks"]
    if any(mark["bytes"] is None for mark in marks):
        return []
    return [
        Chart(
            "live_memory",
            "Memory in use while a source moves",
            "frame",
            "in use, MB",
            [
                Curve(
                    f"{number(found['memory']['vertices'])} vertices",
                    [mark["frame"] for mark in marks],
                    [mark["bytes"] / 1e6 for mark in marks],
                )
            ],
            log_x=False,
            log_y=False,
        )
    ]
