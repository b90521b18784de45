# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of whole pictures against their time: composited, and Cycles with real glass."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ...scene import update as door
from ...scene.vertices.regions import region_masks
from ..cycles import render_reference, samples_setting, scene_depsgraph
from ..metrics import flip, masked_mean, to_srgb
from ..picture import render_picture
from .measure import seconds
from .plots import Chart, Curve
from .settings import Settings
from .text import number, table

TITLE = "Pictures"


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by each scene's.

    The first scene is measured with both surfaces and every setting; the others, of a full run,
    as their file has them, for how far the first one's figures carry.
    """
    first, *others = settings.scenes
    surfaces = settings.pick(("REFRACTION",), ("REFRACTION",), ("REFRACTION", "GLASS"))
    scenes = [_scene(settings, first, surface) for surface in surfaces]
    if settings.size == "full":
        scenes += [_scene(settings, path) for path in others]
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


def _scene(settings: Settings, path: Path, surface: str | None = None) -> dict:
    """The figures of one scene: all of them with a surface, few with that of its file."""
    scene = open_scene(path, settings.pick((32, 24), (120, 90), (160, 120)))
    whole = surface is not None
    if surface is None:
        surface = scene.refractive_glass.surface
    scene.refractive_glass.surface = surface
    truth, noise = _converged(scene, surface, settings.pick(2, 48, 256))
    inside = ~region_masks(scene, scene_depsgraph(scene))[""]
    if not inside.any():
        raise RuntimeError(f"{path.name}: no pixel lies in a glass at this size")

    def judged(picture: np.ndarray) -> dict[str, float]:
        shown = to_srgb(picture)
        return {
            "rmse_inside": rmse(shown, truth, inside),
            "rmse": rmse(shown, truth),
            "flip_inside": masked_mean(flip(truth, shown), inside),
        }

    cycles = []
    for samples in settings.pick((1, 2), (1, 4, 16), (1, 4, 16, 64, 256)):
        picture, taken = timed(
            lambda s=samples: render_reference(scene, samples=s, seed=1, surface=surface)
        )
        cycles.append({"samples": samples, "seconds": taken, **judged(picture)})
    composited = []
    for name, changed, every in _variants(settings, surface, whole):
        rows = []
        for samples in every:
            _set(scene, changed)
            setattr(*samples_setting(scene), samples)
            scene.cycles.seed = 1
            # As the first frame of a render: neither copies nor masks are known.
            door.forget()
            picture, taken = timed(lambda: composite(scene))
            again = seconds(lambda: composite(scene))
            found = computed(scene)
            rows.append(
                {
                    "samples": samples,
                    "seconds": taken,
                    "again_seconds": again,
                    "vertices": found.vertices,
                    "paths": list(found.paths),
                    **judged(picture),
                    **_against(cycles, taken, judged(picture)["rmse_inside"]),
                }
            )
        composited.append({"name": name, "rows": rows})
        _set(scene, DEFAULTS)
    return {
        "scene": path.stem,
        "surface": surface,
        "resolution": [scene.render.resolution_x, scene.render.resolution_y],
        "inside_pixels": int(inside.sum()),
        "reference_noise": noise(inside),
        "cycles": cycles,
        "composited": composited,
    }


DEFAULTS = {"shading": "TRUE", "min_weight": 0.01}


def _variants(
    settings: Settings, surface: str, whole: bool
) -> Iterator[tuple[str, dict, tuple[int, ...]]]:
    """Settings of the composited picture: name, what differs from the defaults, samples."""
    yield "true shading", {}, settings.pick((1,), (4, 16), (1, 4, 16, 64) if whole else (4, 64))
    yield (
        "displaced shading",
        {"shading": "DISPLACED"},
        settings.pick((1,), (16,), (1, 4, 16, 64) if whole else (16,)),
    )
    if settings.size != "full" or not whole:
        return
    if surface == "GLASS":
        yield "true, paths over 5 %", {"min_weight": 0.05}, (16,)
        yield "true, paths over 0.3 %", {"min_weight": 0.003}, (16,)


def _set(scene: bpy.types.Scene, values: dict) -> None:
    for name, value in values.items():
        setattr(scene.refractive_glass, name, value)


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
    if not found.vertices:
        problems = " ".join(found.problems) or "nothing is seen through its glasses"
        raise RuntimeError(f'scene "{scene.name}" was not composited: {problems}')
    return found


def timed(function) -> tuple[np.ndarray, float]:
    """A picture and its seconds."""
    results = []
    taken = seconds(lambda: results.append(function()))
    return results[0], taken


def rmse(one: np.ndarray, other: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Root of the mean squared difference of two pictures, over a mask."""
    return math.sqrt(masked_mean((one - other) ** 2, mask))


def _against(cycles: list[dict], taken: float, error: float) -> dict:
    """How many times as long Cycles takes for the same error, on its own measured curve.

    ``ratio`` is None where the error lies beyond the curve; ``bound`` then tells the least (or the
    greatest) ratio that the curve's end proves.
    """
    curve = [(row["rmse_inside"], row["seconds"]) for row in cycles]
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
        "RMS error over the pixels that a glass covers, colours as the Standard view shows them "
        "(0 to 1), against the mean of two converged Cycles renders with real glass and other "
        "seeds. Composited times are of a whole render as F12 does it, nothing known before; "
        "*again*: the same frame once more, its copies and masks known. *Cycles for the same "
        "error*: time that Cycles takes for it, from its measured curve, over the composited "
        "time; above 1 the composited picture is faster. Cycles' noise falls with its samples; a "
        "composited picture's falls until what it does not compute is left.",
        "",
    ]
    for scene in found["scenes"]:
        width, height = scene["resolution"]
        lines += [
            f"### {scene['scene']}, {scene['surface'].title()}",
            "",
            f"{width} x {height}, {number(scene['inside_pixels'])} pixels inside; noise of the "
            f"converged reference {number(scene['reference_noise'])}.",
            "",
            f"![](pictures_{scene['scene']}_{scene['surface'].lower()}.png)",
            "",
        ]
        rows = [
            (
                "Cycles",
                row["samples"],
                row["seconds"],
                None,
                row["rmse_inside"],
                row["flip_inside"],
                row["rmse"],
                None,
                None,
            )
            for row in scene["cycles"]
        ]
        for variant in scene["composited"]:
            rows += [
                (
                    variant["name"],
                    row["samples"],
                    row["seconds"],
                    row["again_seconds"],
                    row["rmse_inside"],
                    row["flip_inside"],
                    row["rmse"],
                    row["vertices"],
                    _quotient(row),
                )
                for row in variant["rows"]
            ]
        lines += table(
            (
                "picture",
                "samples",
                "time, s",
                "again, s",
                "RMS inside",
                "FLIP inside",
                "RMS",
                "vertices",
                "Cycles for the same error",
            ),
            rows,
        )
        lines += [_verdict(scene), ""]
    return lines


def _quotient(row: dict) -> str:
    if row["ratio"] is not None:
        return f"{row['ratio']:.2f}"
    if row["at_least"] is not None:
        return f"> {row['at_least']:.2f}"
    if row["at_most"] is not None:
        return f"< {row['at_most']:.2f}"
    return "-"


def _verdict(scene: dict) -> str:
    """Where the curves cross, in a sentence."""
    faster = [
        (row["rmse_inside"], variant["name"])
        for variant in scene["composited"]
        for row in variant["rows"]
        if (row["ratio"] or row["at_least"] or 0.0) > 1.0
    ]
    if not faster:
        return "At no error reached here is the composited picture faster than Cycles."
    low, high = min(faster), max(faster)
    return (
        f"Composited is faster at RMS errors from {number(low[0])} ({low[1]}) to "
        f"{number(high[0])} ({high[1]})."
    )


def charts(found: dict) -> list[Chart]:
    """Error against time, one chart a scene and surface."""
    made = []
    for scene in found["scenes"]:
        curves = [
            Curve(
                "Cycles, real glass",
                [row["seconds"] for row in scene["cycles"]],
                [row["rmse_inside"] for row in scene["cycles"]],
                number=6,
                labels=[str(row["samples"]) for row in scene["cycles"]],
            )
        ]
        curves += [
            Curve(
                variant["name"],
                [row["seconds"] for row in variant["rows"]],
                [row["rmse_inside"] for row in variant["rows"]],
                number=place,
                labels=[str(row["samples"]) for row in variant["rows"]],
            )
            for place, variant in enumerate(scene["composited"])
        ]
        made.append(
            Chart(
                f"pictures_{scene['scene']}_{scene['surface'].lower()}",
                f"{scene['scene']}, {scene['surface'].title()}: error against time "
                "(numbers: samples a pixel)",
                "time of the whole render, s",
                "RMS error inside the glass",
                curves,
                level=(scene["reference_noise"], "noise of the reference"),
            )
        )
    return made
