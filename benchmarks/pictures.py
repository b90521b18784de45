# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of whole pictures against their time: True and Displaced shading, Cycles with real glass.

Times are of all threads of this process: two renders that keep different numbers of cores busy
compare, and other programs on the machine disturb little.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from glass_refraction.reference.cycles import render_reference, scene_depsgraph
from glass_refraction.reference.metrics import flip, masked_mean, to_srgb
from glass_refraction.reference.picture import render_picture
from glass_refraction.scene import update as door
from glass_refraction.scene.read.viewpoint import samples_setting
from glass_refraction.scene.vertices.regions import region_masks

from .measure import cpu_seconds
from .plots import Chart, Curve
from .settings import Settings
from .text import number, table

TITLE = "Pictures"


@dataclass(frozen=True)
class Variant:
    """Settings of a composited picture, by what differs from the scene's."""

    name: str
    samples: tuple[int, ...]
    engine: str = "CYCLES"
    denoised: bool = False
    shading: str = "TRUE"
    captures: int = 3


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by each scene's.

    The first scene is measured with every setting; the others, of a full run, with few, for how
    far the first one's figures carry.
    """
    first, *others = settings.scenes
    scenes = [_scene(settings, first, whole=True)]
    if settings.size == "full":
        scenes += [_scene(settings, path, whole=False) for path in others]
    return {"scenes": scenes}


def open_scene(path: Path, size: tuple[int, int]) -> bpy.types.Scene:
    """A scene file, set to render in Cycles at a small size without a border."""
    bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.view_settings.view_transform = "Standard"
    return scene


def _scene(settings: Settings, path: Path, *, whole: bool) -> dict:
    """The figures of one scene: of every variant, or of few."""
    scene = open_scene(path, settings.pick((32, 24), (120, 90), (240, 180)))
    surface = scene.refractive_glass.surface
    truth, noise = _converged(scene, surface, settings.pick(2, 48, 256))
    inside = ~region_masks(scene, scene_depsgraph(scene))[""]
    if not inside.any():
        raise RuntimeError(f"{path.name}: no pixel lies in a glass at this size")

    def judged(picture: np.ndarray) -> dict[str, float]:
        shown = to_srgb(picture)
        return {
            "rmse_inside": rmse(shown, truth, inside),
            "rmse_outside": rmse(shown, truth, ~inside) if not inside.all() else 0.0,
            "flip_inside": masked_mean(flip(truth, shown), inside),
        }

    cycles = {
        denoised: [
            _real_glass(scene, surface, samples, denoised, judged)
            for samples in settings.pick((1, 2), (1, 4, 16), (1, 4, 16, 64))
        ]
        for denoised in (False, True)
    }
    # Not counted: what is loaded and built once.
    _composited(scene, Variant("first", (1,)), 1, judged)
    composited = []
    for variant in _variants(settings, whole):
        rows = [_composited(scene, variant, samples, judged) for samples in variant.samples]
        for row in rows:
            row |= _against(cycles[variant.denoised], row["cpu_seconds"], row["rmse_inside"])
        composited.append({"name": variant.name, "denoised": variant.denoised, "rows": rows})
    return {
        "scene": path.stem,
        "surface": surface,
        "resolution": [scene.render.resolution_x, scene.render.resolution_y],
        "inside_pixels": int(inside.sum()),
        "reference_noise": noise(inside),
        "cycles": [
            {"name": _cycles_name(denoised), "denoised": denoised, "rows": rows}
            for denoised, rows in cycles.items()
        ],
        "composited": composited,
    }


def _cycles_name(denoised: bool) -> str:
    return "Cycles, real glass, OIDN" if denoised else "Cycles, real glass"


def _variants(settings: Settings, whole: bool) -> Iterator[Variant]:
    """The composited pictures of a scene."""
    many = settings.pick((1,), (4, 16), (1, 4, 16, 64))
    few = settings.pick((1,), (16,), (4, 16))
    yield Variant("True", many if whole else few)
    yield Variant("True, OIDN", few, denoised=True)
    yield Variant("Displaced", few, shading="DISPLACED")
    if whole:
        yield Variant("True, 1 capture", few, captures=1)
        yield Variant("True, 1 capture, OIDN", few, denoised=True, captures=1)
    if whole and settings.size == "full":
        yield Variant("True in EEVEE", few, engine="BLENDER_EEVEE")


def _real_glass(scene, surface: str, samples: int, denoised: bool, judged) -> dict:
    picture, timing = timed(
        lambda: render_reference(scene, samples=samples, seed=1, surface=surface, denoised=denoised)
    )
    return {"samples": samples, **timing, **judged(picture)}


def _composited(scene: bpy.types.Scene, variant: Variant, samples: int, judged) -> dict:
    """One picture of a variant, and what it took: the first frame, and the same once more."""
    scene.render.engine = variant.engine
    scene.cycles.use_denoising = variant.denoised
    scene.refractive_glass.shading = variant.shading
    scene.refractive_glass.captures = variant.captures
    setattr(*samples_setting(scene), samples)
    scene.cycles.seed = 1
    try:
        # As the first frame of a render: nothing is known.
        door.forget()
        picture, timing = timed(lambda: composite(scene))
        again = cpu_seconds(lambda: composite(scene))
        found = computed(scene)
    finally:
        scene.render.engine, scene.cycles.use_denoising = "CYCLES", False
    return {
        "samples": samples,
        **timing,
        "cpu_again_seconds": again,
        "vertices": found.vertices,
        "rays": found.rays,
        "views": len(found.views),
        "unseen": found.unseen,
        **judged(picture),
    }


def _converged(scene, surface: str, samples: int):
    """The mean of two references, and a function that tells its own RMS noise in a mask."""
    halves = [
        render_reference(scene, samples=samples, seed=seed, surface=surface) for seed in (101, 102)
    ]
    shown = [to_srgb(half) for half in halves]

    def noise(mask: np.ndarray) -> float:
        # Of the mean of two pictures the noise is half their difference.
        return 0.5 * rmse(*shown, mask)

    return to_srgb(0.5 * (halves[0] + halves[1])), noise


def composite(scene: bpy.types.Scene) -> np.ndarray:
    """The scene's composited picture, brought up to date and rendered.

    Blender 5.2 crashes where a render that a script starts finds its compositor tree changed by
    its own beginning: so the scene is prepared before.
    """
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    return render_picture(scene)


def computed(scene: bpy.types.Scene) -> door.Status:
    """The scene's status; RuntimeError where the last render computed nothing."""
    found = door.status(scene)
    if not (found.vertices or found.rays):
        problems = " ".join(found.problems) or "nothing is seen through its glasses"
        raise RuntimeError(f'scene "{scene.name}" was not composited: {problems}')
    return found


def timed(function) -> tuple[np.ndarray, dict[str, float]]:
    """A picture, and the seconds that it took: of all threads, and on the clock."""
    started, busy = time.perf_counter(), time.process_time()
    picture = function()
    taken = {"cpu_seconds": time.process_time() - busy, "seconds": time.perf_counter() - started}
    return picture, taken


def rmse(one: np.ndarray, other: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Root of the mean squared difference of two pictures, over a mask."""
    return math.sqrt(masked_mean((one - other) ** 2, mask))


def _against(cycles: list[dict], taken: float, error: float) -> dict:
    """How many times as long Cycles takes for the same error, on its own measured curve.

    ``ratio`` is None where the error lies beyond the curve; ``at_least`` or ``at_most`` then tells
    what the curve's end proves.
    """
    curve = [(row["rmse_inside"], row["cpu_seconds"]) for row in cycles]
    worst, best = curve[0], curve[-1]
    if error <= best[0]:
        return {"ratio": None, "at_least": best[1] / taken, "at_most": None}
    if error >= worst[0]:
        return {"ratio": None, "at_least": None, "at_most": worst[1] / taken}
    for (e0, t0), (e1, t1) in itertools.pairwise(curve):
        if e1 <= error <= e0:
            part = 0.0 if e0 == e1 else math.log(e0 / error) / math.log(e0 / e1)
            same = math.exp((1 - part) * math.log(t0) + part * math.log(t1))
            return {"ratio": same / taken, "at_least": None, "at_most": None}
    return {"ratio": None, "at_least": None, "at_most": None}


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "RMS error over the pixels that a glass covers, and *beside* it, colours as the Standard "
        "view shows them (0 to 1), against the mean of two converged Cycles renders with real "
        "glass and other seeds. Beside the glass there is the engine's own noise and, in EEVEE, "
        "its own lighting. *CPU*: seconds of all threads of the process for a whole render as F12 "
        "does it, nothing known before; *again*: the same frame once more. *Cycles for the same "
        "error*: CPU time of Cycles with real glass (denoised where the picture is), from its "
        "measured curve, over that of the picture; above 1 the picture is faster. *Unseen*: part "
        "of the light whose hits no view shows.",
        "",
    ]
    for scene in found["scenes"]:
        width, height = scene["resolution"]
        lines += [
            f"### {scene['scene']}",
            "",
            f"{width} x {height}, surface {scene['surface'].title()}, "
            f"{number(scene['inside_pixels'])} pixels inside; noise of the converged reference "
            f"{number(scene['reference_noise'])}.",
            "",
            f"![](pictures_{scene['scene']}.png)",
            "",
        ]
        lines += table(
            (
                "picture",
                "samples",
                "CPU, s",
                "again, s",
                "wall, s",
                "RMS inside",
                "FLIP inside",
                "RMS beside",
                "vertices",
                "rays",
                "views",
                "unseen, %",
                "Cycles for the same error",
            ),
            [_row(kind, row) for kind in scene["cycles"] for row in kind["rows"]]
            + [_row(kind, row) for kind in scene["composited"] for row in kind["rows"]],
        )
        lines += [_verdict(scene), ""]
    return lines


def _row(kind: dict, row: dict) -> tuple:
    true = row.get("rays", 0) > 0
    return (
        kind["name"],
        row["samples"],
        row["cpu_seconds"],
        row.get("cpu_again_seconds"),
        row["seconds"],
        row["rmse_inside"],
        row["flip_inside"],
        row["rmse_outside"],
        row.get("vertices") or None,
        row["rays"] if true else None,
        row["views"] if true else None,
        100.0 * row["unseen"] if true else None,
        _quotient(row) if "ratio" in row else "-",
    )


def _quotient(row: dict) -> str:
    if row["ratio"] is not None:
        return f"{row['ratio']:.2f}"
    if row["at_least"] is not None:
        return f"> {row['at_least']:.2f}"
    if row["at_most"] is not None:
        return f"< {row['at_most']:.2f}"
    return "-"


def _verdict(scene: dict) -> str:
    """Where composited pictures are faster than Cycles, in a sentence."""
    faster = [
        (row["rmse_inside"], variant["name"])
        for variant in scene["composited"]
        for row in variant["rows"]
        if (row["ratio"] or row["at_least"] or 0.0) > 1.0
    ]
    if not faster:
        return "At no error reached here is a composited picture faster than Cycles."
    low, high = min(faster), max(faster)
    return (
        f"Composited pictures are faster at RMS errors from {number(low[0])} ({low[1]}) to "
        f"{number(high[0])} ({high[1]})."
    )


def charts(found: dict) -> list[Chart]:
    """Error against time, one chart a scene."""
    made = []
    for scene in found["scenes"]:
        kinds = [*scene["cycles"], *scene["composited"]]
        made.append(
            Chart(
                f"pictures_{scene['scene']}",
                f"{scene['scene']}: error against time (numbers: samples a pixel)",
                "CPU time of the whole render, s",
                "RMS error inside the glass",
                [
                    Curve(
                        kind["name"],
                        [row["cpu_seconds"] for row in kind["rows"]],
                        [row["rmse_inside"] for row in kind["rows"]],
                        dashed=kind["denoised"],
                        labels=[str(row["samples"]) for row in kind["rows"]],
                    )
                    for kind in kinds
                ],
                level=(scene["reference_noise"], "noise of the reference"),
            )
        )
    return made
