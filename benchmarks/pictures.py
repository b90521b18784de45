# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of whole pictures against their time: this extension, EEVEE's own refraction, real glass.

Times are of all threads of this process: two renders that keep different numbers of cores busy
compare, and other programs on the machine disturb little.
"""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from glass_refraction.reference.cycles import render_reference, scene_depsgraph
from glass_refraction.reference.metrics import to_srgb
from glass_refraction.reference.picture import render_picture
from glass_refraction.reference.png import write_png
from glass_refraction.scene import update as door
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.mesh_glasses import MeshGlass
from glass_refraction.scene.read.viewpoint import samples_setting

from .own_glass import show_own_glass
from .plots import Chart, Curve
from .settings import Settings
from .text import number, table

TITLE = "Pictures"

REAL, REAL_OIDN = "Cycles, real glass", "Cycles, real glass, OIDN"
RAYS, RAYS_OIDN = "rays in Cycles", "rays in Cycles, OIDN"
RAYS_1, RAYS_1_OIDN = "rays in Cycles, 1 capture", "rays in Cycles, 1 capture, OIDN"
DISPLACED = "displaced in Cycles"
EEVEE, EEVEE_OWN = "rays in EEVEE", "EEVEE's own refraction"
IN_EEVEE = (EEVEE, EEVEE_OWN)
ERRORS = (0.06, 0.04, 0.03, 0.02, 0.015, 0.01)
"""RMS errors for which the table of what to take asks."""
MARGIN_PX = 2
"""So near to glass a pixel counts neither as inside nor as beside."""


@dataclass(frozen=True)
class Kind:
    """One way to a picture, and the samples a pixel at which it is rendered."""

    name: str
    samples: tuple[int, ...]
    engine: str = "CYCLES"
    denoised: bool = False
    shading: str = "TRUE"
    captures: int = 3


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by each scene's.

    The first scene is measured with more samples than the others, for how curves go on.
    """
    paths = settings.scenes if settings.size == "full" else settings.scenes[:1]
    return {"scenes": [_scene(settings, path, whole=not n) for n, path in enumerate(paths)]}


def open_scene(path: Path, size: tuple[int, int]) -> bpy.types.Scene:
    """A scene file, set to True shading in Cycles at a small size without a border."""
    bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False)
    scene = bpy.context.scene
    scene.refractive_glass.shading = "TRUE"
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.view_settings.view_transform = "Standard"
    # EEVEE's own refraction needs it, and the light beside glass is nearer to Cycles' with it.
    scene.eevee.use_raytracing = True
    scene.eevee.ray_tracing_method = "SCREEN"
    scene.eevee.ray_tracing_options.resolution_scale = "1"
    return scene


def kinds(settings: Settings, whole: bool) -> Iterator[Kind]:
    """The pictures of a scene. EEVEE's own refraction comes last: it changes the scene."""
    few, pair = settings.pick((1,), (4,), (16,)), settings.pick((1,), (4, 16), (4, 16))
    some = settings.pick((1, 2), (1, 4, 16), (1, 4, 16))
    yield Kind(REAL, (*some, 64) if whole and settings.size == "full" else some)
    long = settings.pick(some, some, (*some, 64 if whole else 32))
    yield Kind(REAL_OIDN, long, denoised=True)
    yield Kind(RAYS, (*pair, 64) if whole and settings.size == "full" else pair)
    yield Kind(RAYS_OIDN, settings.pick((1,), some, some if whole else pair), denoised=True)
    yield Kind(RAYS_1, few, captures=1)
    yield Kind(RAYS_1_OIDN, settings.pick((1,), (4,), (4,)), denoised=True, captures=1)
    yield Kind(DISPLACED, pair if whole else (4,), shading="DISPLACED")
    if settings.size != "tiny":
        # Without a GPU the engine takes seconds to start.
        eevee = settings.pick((), (4,), (4, 16) if whole else (8,))
        yield Kind(EEVEE, eevee, engine="BLENDER_EEVEE")
        yield Kind(EEVEE_OWN, eevee, engine="BLENDER_EEVEE")


def _scene(settings: Settings, path: Path, *, whole: bool) -> dict:
    """The figures of one scene."""
    scene = open_scene(path, settings.pick((32, 24), (120, 90), (480, 360)))
    surface = scene.refractive_glass.surface
    halves = [
        to_srgb(render_reference(scene, samples=count, seed=seed, surface=surface))
        for count, seed in zip(
            (settings.pick(2, 16, 48 if whole else 32),) * 2, (101, 102), strict=True
        )
    ]
    composite(scene)
    computed(scene)
    inside = door.memory_of(scene).covered
    beside = ~grown(inside, MARGIN_PX)
    if not inside.any():
        raise RuntimeError(f"{path.name}: no pixel lies in a glass at this size")
    # Copies leave glasses that are meshes out, and with a stemmed glass beside them take an hour.
    closed = not any(
        isinstance(glass.description, MeshGlass) for glass in read_glasses(scene_depsgraph(scene))
    )
    found, last = [], {}
    for kind in kinds(settings, whole):
        if kind.name == DISPLACED and not closed:
            continue
        rows = []
        for picture, row in _pictures(scene, kind, surface):
            shown = last[kind.name] = to_srgb(picture)
            row["rmse_inside"] = error(shown, halves, inside)
            row["rmse_beside"] = error(shown, halves, beside) if beside.any() else None
            rows.append(row)
        found.append({"name": kind.name, "denoised": kind.denoised, "rows": rows})
    if settings.folder is not None and EEVEE_OWN in last:
        strip = (last[EEVEE_OWN], last[EEVEE], last[RAYS_OIDN], 0.5 * (halves[0] + halves[1]))
        write_png(settings.folder / f"strip_{path.stem}.png", np.concatenate(strip, axis=1))
    return {
        "scene": path.stem,
        "frame": scene.frame_current,
        "surface": surface,
        "resolution": [scene.render.resolution_x, scene.render.resolution_y],
        "inside_pixels": int(inside.sum()),
        # Of the mean of two pictures the noise is half their difference.
        "reference_noise": 0.5 * rms(halves[0] - halves[1], inside),
        "strip": EEVEE_OWN in last,
        "kinds": found,
    }


def _pictures(scene, kind: Kind, surface: str) -> Iterator[tuple[np.ndarray, dict]]:
    """Each picture of a kind, and what it took; what is compiled and loaded once does not count."""
    if kind.name in (REAL, REAL_OIDN):
        for samples in kind.samples:
            picture, timing = timed(
                lambda s=samples: render_reference(
                    scene, samples=s, seed=1, surface=surface, denoised=kind.denoised
                )
            )
            yield picture, {"samples": samples, **timing}
        return
    scene.render.engine = kind.engine
    scene.cycles.use_denoising = kind.denoised
    scene.refractive_glass.shading = kind.shading
    scene.refractive_glass.captures = kind.captures
    scene.cycles.seed = 1
    own = kind.name == EEVEE_OWN
    if own:
        show_own_glass(scene)
    render = render_picture if own else composite
    settings, name = samples_setting(scene)
    if kind.name in IN_EEVEE:
        setattr(settings, name, 1)
        render(scene)
    for samples in kind.samples:
        setattr(settings, name, samples)
        # As the first frame of a render: nothing is known.
        door.forget()
        picture, timing = timed(lambda: render(scene))
        row = {"samples": samples, **timing}
        if not own:
            status = computed(scene)
            row |= {
                "vertices": status.vertices,
                "rays": status.rays,
                "views": len(status.views),
                "unseen": status.unseen,
            }
        yield picture, row
    scene.render.engine, scene.cycles.use_denoising = "CYCLES", False


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


def timed(function) -> tuple[object, dict[str, float]]:
    """A result, and the seconds that it took: of all threads, and on the clock."""
    started, busy = time.perf_counter(), time.process_time()
    result = function()
    taken = {"cpu_seconds": time.process_time() - busy, "seconds": time.perf_counter() - started}
    return result, taken


# --- errors --------------------------------------------------------------------------------------


def rms(values: np.ndarray, mask: np.ndarray) -> float:
    """Root of the mean square of colours (H, W, 3) over a mask (H, W)."""
    return math.sqrt(float(np.mean(values[mask].astype(float) ** 2)))


def error(picture: np.ndarray, halves: Sequence[np.ndarray], mask: np.ndarray) -> float:
    """RMS error over a mask against the truth that two independent references scatter round.

    The mean product of the differences from both has no part of the references' own noise, for
    that of one knows nothing of that of the other.

    Raises
    ------
    RuntimeError
        The picture holds values that are no numbers.
    """
    if not np.isfinite(picture).all():
        raise RuntimeError("a picture holds values that are no numbers")
    one, other = (picture[mask].astype(float) - half[mask] for half in halves)
    return math.sqrt(max(0.0, float(np.mean(one * other))))


def grown(mask: np.ndarray, by: int) -> np.ndarray:
    """A mask and all pixels so near to it, along rows, columns and diagonals."""
    height, width = mask.shape
    padded = np.pad(mask, by)
    shifts = itertools.product(range(2 * by + 1), repeat=2)
    return np.any([padded[y : y + height, x : x + width] for y, x in shifts], axis=0)


# --- curves --------------------------------------------------------------------------------------

Front = list[tuple[float, float]]
"""(error, CPU seconds), errors falling and seconds rising: what is worth its time."""


def front(*kinds_found: dict) -> Front:
    """The best of some kinds' rows."""
    points = sorted((r["cpu_seconds"], r["rmse_inside"]) for k in kinds_found for r in k["rows"])
    best: Front = []
    for seconds, off in points:
        if not best or off < best[-1][0]:
            best.append((off, seconds))
    return best


def seconds_at(curve: Front, off: float) -> float | None:
    """Time at an error on both logarithmic axes; None beyond the curve's ends."""
    if not curve or not curve[-1][0] <= off <= curve[0][0]:
        return None
    for (e0, t0), (e1, t1) in itertools.pairwise(curve):
        if e1 <= off <= e0:
            part = math.log(e0 / off) / math.log(e0 / e1)
            return math.exp((1 - part) * math.log(t0) + part * math.log(t1))
    return curve[0][1]


def against(curve: Front, seconds: float, off: float) -> dict:
    """How many times as long a curve takes for the same error.

    ``ratio`` is None where the error lies beyond the curve; ``at_least`` or ``at_most`` then tells
    what the curve's end proves.
    """
    same = seconds_at(curve, off)
    found = {"ratio": None, "at_least": None, "at_most": None}
    if same is not None:
        found["ratio"] = same / seconds
    elif curve and off < curve[-1][0]:
        found["at_least"] = curve[-1][1] / seconds
    elif curve:
        found["at_most"] = curve[0][1] / seconds
    return found


def crossings(one: Front, other: Front) -> list[tuple[float, float]]:
    """(error, seconds) where two curves take the same time, errors falling."""
    errors = sorted({off for curve in (one, other) for off, _ in curve}, reverse=True)
    both = [(off, seconds_at(one, off), seconds_at(other, off)) for off in errors]
    both = [(off, math.log(a / b), a) for off, a, b in both if a is not None and b is not None]
    found = []
    for (e0, d0, t0), (e1, d1, t1) in itertools.pairwise(both):
        if d0 * d1 < 0.0:
            part = d0 / (d0 - d1)
            found.append((e0 ** (1 - part) * e1**part, t0 ** (1 - part) * t1**part))
    return found


def cheapest(scene: dict, off: float) -> tuple[str, float] | None:
    """The kind that reaches an error in the least time, and that time."""
    reached = []
    for kind in scene["kinds"]:
        curve = front(kind)
        seconds = curve[0][1] if curve and curve[0][0] <= off else seconds_at(curve, off)
        if seconds is not None:
            reached.append((seconds, kind["name"]))
    return min(reached)[::-1] if reached else None


def standing(scene: dict) -> str:
    """How rays in Cycles with OIDN stand to real glass with OIDN, in one word."""
    ours, theirs = (_front_of(scene, name) for name in (RAYS_OIDN, REAL_OIDN))
    ratios = [against(theirs, seconds, off) for off, seconds in ours]
    sure = [r["ratio"] or r["at_least"] or 0.0 for r in ratios]
    if all(value >= 1.0 for value in sure):
        return "at every error"
    return "at some errors" if any(value >= 1.0 for value in sure) else "at none"


def _front_of(scene: dict, *names: str) -> Front:
    return front(*(kind for kind in scene["kinds"] if kind["name"] in names))


# --- words ---------------------------------------------------------------------------------------


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    scenes = found["scenes"]
    lines = [
        "RMS error over the pixels that glass covers, and *beside* it, colours as the Standard "
        "view shows them (0 to 1; 0.01 is 40 dB), against Cycles with real glass. The reference is "
        "two renders of other seeds: the error is the root of the mean product of a picture's "
        "differences from both, which holds none of their own noise. *CPU*: seconds of all threads "
        "of the process for a whole render as F12 does it, nothing known before, shaders compiled. "
        "*Of plain*, *of OIDN*: CPU time of Cycles with real glass for the same error, without and "
        "with its denoiser, from its measured curve, over that of the picture; above 1 the picture "
        "is faster; `>` and `<` say what the end of the curve proves. *Unseen*: part of the light "
        "whose hits no view shows. Beside the glass there is the engine's own noise and, in EEVEE, "
        "its own lighting.",
        "",
        *_which(scenes),
        *_oidn(scenes),
        *_lighting(scenes),
    ]
    for scene in scenes:
        width, height = scene["resolution"]
        lines += [
            f"### {scene['scene']}",
            "",
            f"Frame {scene['frame']}, {width} x {height}, surface {scene['surface'].title()}, "
            f"{number(scene['inside_pixels'])} pixels inside; noise of the mean of both "
            f"references {number(scene['reference_noise'])}.",
            "",
            f"![Error against time](pictures_{scene['scene']}.png)",
            "",
        ]
        if scene["strip"]:
            lines += [
                "EEVEE's own refraction, rays in EEVEE, rays in Cycles with OIDN, Cycles with real "
                "glass:",
                "",
                f"![](strip_{scene['scene']}.png)",
                "",
            ]
        curves = {name: _front_of(scene, name) for name in (REAL, REAL_OIDN)}
        lines += table(
            (
                "picture",
                "samples",
                "CPU, s",
                "wall, s",
                "RMS inside",
                "RMS beside",
                "of plain",
                "of OIDN",
                "vertices",
                "rays",
                "views",
                "unseen, %",
            ),
            [_row(kind, row, curves) for kind in scene["kinds"] for row in kind["rows"]],
        )
    return lines


def _which(scenes: list[dict]) -> list[str]:
    """What to take when, from the figures."""
    lines = [
        "### Which to take when",
        "",
        "The picture that reaches an error in the least CPU time, by scene (seconds in brackets; "
        "`-`: none reached it):",
        "",
    ]
    rows, won = [], {}
    for off in ERRORS:
        best = {scene["scene"]: cheapest(scene, off) for scene in scenes}
        won[off] = Counter(name for name, _ in filter(None, best.values()))
        told = [f"{b[0]} ({number(b[1])})" if b else "-" for b in best.values()]
        rows.append((f"RMS {off:g}", *told))
    lines += table(("error", *(scene["scene"] for scene in scenes)), rows)
    told = []
    for off in ERRORS:
        names = ", ".join(f"{name} in {count}" for name, count in won[off].most_common())
        told.append(f"at RMS {off:g}: {names or 'nothing'}")
    reach = []
    for name in (EEVEE_OWN, EEVEE, DISPLACED, RAYS, RAYS_OIDN, REAL_OIDN):
        least = [curve[-1][0] for scene in scenes if (curve := _front_of(scene, name))]
        if least:
            reach.append(f"{name} {number(min(least))} to {number(max(least))}")
    lines += [
        f"Ways that take the least time, by the number of scenes: {'; '.join(told)}. The least "
        f"error that each reaches here, by scene: {'; '.join(reach)}. Take the way that the table "
        "names for the error that you want; where it names none, take real glass in Cycles with "
        "more samples. In EEVEE compare the two rows in EEVEE: what is left of the rays' error is "
        "the engine's own lighting, as beside the glass.",
        "",
    ]
    return lines


def _oidn(scenes: list[dict]) -> list[str]:
    """Where the curves of rays and of real glass cross, both denoised and both not."""
    lines = ["### Rays against real glass in Cycles", ""]
    rows = []
    for scene in scenes:
        ours, theirs = _front_of(scene, RAYS_OIDN), _front_of(scene, REAL_OIDN)
        plain = crossings(_front_of(scene, RAYS), _front_of(scene, REAL))
        rows.append(
            (
                scene["scene"],
                standing(scene),
                " / ".join(_quotient(against(theirs, s, off)) for off, s in ours),
                _places(crossings(ours, theirs)),
                _places(plain),
            )
        )
    lines += table(
        (
            "scene",
            "denoised rays are not slower",
            "by their rows worth their time",
            "denoised curves cross at RMS (CPU s)",
            "plain ones",
        ),
        rows,
    )
    lit = [scene for scene in scenes if not scene["scene"].endswith("_unlit")]
    good = [scene for scene in lit if standing(scene) == "at every error"]
    some = [scene for scene in lit if standing(scene) == "at some errors"]
    lines += [
        f"Of {len(lit)} lit scenes denoised rays are not slower than denoised real glass at any "
        f"error that their own rows reach in {len(good)}, at some in {len(some)} more. The aim is "
        "4 of 6.",
        "",
    ]
    return lines


def _lighting(scenes: list[dict]) -> list[str]:
    """EEVEE's own lighting, apart from what is seen through glass."""
    rows = []
    for scene in scenes:
        best = {k["name"]: k["rows"][-1] for k in scene["kinds"] if k["name"] in IN_EEVEE}
        if len(best) == len(IN_EEVEE) and best[EEVEE]["rmse_beside"] is not None:
            values = [
                best[name][where] for where in ("rmse_inside", "rmse_beside") for name in best
            ]
            rows.append((scene["scene"], *values))
    if not rows:
        return []
    return [
        "### EEVEE",
        "",
        "Beside the glass EEVEE's lighting is all the difference to Cycles: no picture by EEVEE "
        "can be told to be nearer than that inside. Both trace rays on the screen at full "
        "resolution, EEVEE's own refraction for the glass, both for light.",
        "",
        *table(
            ("scene", "rays, inside", "own refraction, inside", "rays, beside", "own, beside"),
            rows,
        ),
    ]


def _places(found: list[tuple[float, float]]) -> str:
    return ", ".join(f"{number(off)} ({number(seconds)})" for off, seconds in found) or "-"


def _row(kind: dict, row: dict, curves: dict[str, Front]) -> tuple:
    rays = row.get("rays", 0) > 0
    ratios = [
        "-"
        if kind["name"] in curves
        else _quotient(against(curve, row["cpu_seconds"], row["rmse_inside"]))
        for curve in curves.values()
    ]
    return (
        kind["name"],
        row["samples"],
        row["cpu_seconds"],
        row["seconds"],
        row["rmse_inside"],
        row["rmse_beside"],
        *ratios,
        row.get("vertices") or None,
        row["rays"] if rays else None,
        row["views"] if rays else None,
        100.0 * row["unseen"] if rays else None,
    )


def _quotient(row: dict) -> str:
    if row["ratio"] is not None:
        return f"{row['ratio']:.2f}"
    if row["at_least"] is not None:
        return f"> {row['at_least']:.2f}"
    return "-" if row["at_most"] is None else f"< {row['at_most']:.2f}"


def charts(found: dict) -> list[Chart]:
    """Error against time, one chart a scene."""
    return [
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
                for kind in scene["kinds"]
            ],
        )
        for scene in found["scenes"]
    ]
