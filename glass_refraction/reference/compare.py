# SPDX-License-Identifier: GPL-3.0-or-later
"""The composited picture held against the same frame with real glass in Cycles."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np

from ..scene.build.own_scenes import find_own_scenes
from ..scene.names import RefractiveGlassError
from ..scene.read.glasses import read_glasses
from ..scene.read.viewpoint import border_window, read_viewpoint, samples_setting
from ..scene.update import Status, memory_of, status
from ..scene.vertices.kept_paths import bright_paths
from ..scene.vertices.path_keys import path_key, path_of
from ..scene.vertices.regions import left_out_pixels, region_masks
from .cycles import rendering_direct, rendering_reference, scene_depsgraph
from .metrics import to_srgb
from .picture import Request, finished, rendering_picture
from .report import MAGNIFICATION, picture_figures, write_report


def compare(
    scene: bpy.types.Scene,
    folder: Path | str,
    *,
    samples: int | None = None,
    surface: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> dict:
    """Render the current frame as F12 would and with real glass in Cycles, and write a report.

    Parameters
    ----------
    folder : for ``report.json``, ``report.md`` and the pictures; made if need be.
    samples : per pixel, of both pictures; by default the scene's own number.
    surface : of the real glass, as in the scene's setting *Surface*, which is the default:
        ``"GLASS"`` tells what *Refraction* leaves out.
    progress : called with the part done, from 0 to 1, and what comes next, in words.

    Returns
    -------
    dict : what ``report.json`` holds; a PSNR is infinite there for equal pictures.

    Raises
    ------
    RefractiveGlassError
        No camera, no glass, one that cannot be computed, or the extension is switched off.
    RuntimeError
        A render was cancelled.
    OSError
        The folder cannot be written.
    """
    steps = comparing(scene, folder, samples=samples, surface=surface, progress=progress)
    return finished(steps)


def comparing(
    scene: bpy.types.Scene,
    folder: Path | str,
    *,
    samples: int | None = None,
    surface: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Generator[Request, object, dict]:
    """:func:`compare` in steps, for who lets Blender's window go on meanwhile.

    Closed before its end it leaves the scene as it was.
    """
    report_progress = progress or (lambda share, label: None)
    surface = surface or scene.refractive_glass.surface
    check_comparable(scene)
    Path(folder).mkdir(parents=True, exist_ok=True)

    report_progress(0.0, "this extension's picture")
    with _samples(scene, samples):
        composite_samples = getattr(*samples_setting(scene))
        composite, composing = yield from _timed(rendering_picture(scene))
        found = status(scene)
        if not (found.paths or found.covered):
            problems = " ".join(found.problems) or "no glass covers a pixel"
            raise RefractiveGlassError(f'Scene "{scene.name}" was not composited: {problems}')
        engines = _engines(scene)
        # The render may have evaluated the scene anew.
        masks = _masks(scene, scene_depsgraph(scene), surface, composite.shape[:2])
        left_out = None
        if found.paths:
            paths = tuple(path_of(key) for key in found.paths)
            left_out = left_out_pixels(scene, scene_depsgraph(scene), paths)
        path_names = yield _path_names(scene, found)
        report_progress(1 / 4, "the picture without glass")
        _, direct = yield from _timed(rendering_direct(scene))
    references = []
    times = []
    # The scene's own seed, so that noise common to both pictures cancels, and another one.
    for label, seed in (
        ("real glass in Cycles", scene.cycles.seed),
        ("real glass again, to know its noise", scene.cycles.seed + 1),
    ):
        report_progress((2 + len(references)) / 4, label)
        picture, duration = yield from _timed(
            rendering_reference(scene, samples=composite_samples, seed=seed, surface=surface)
        )
        references.append(to_srgb(picture))
        times.append(duration)
    report_progress(1.0, "the differences")

    composite = to_srgb(composite)
    figures = yield lambda: picture_figures(composite, *references, masks)
    report = {
        "scene": scene.name,
        "frame": scene.frame_current,
        "resolution": [composite.shape[1], composite.shape[0]],
        **figures.pop("picture"),
        "inside": figures.pop("inside", None),
        "outside": figures.pop("outside", None),
        "regions": {name.removeprefix("path "): values for name, values in figures.items()},
        "seconds_composite": composing.wall,
        "seconds_reference": times[0].wall,
        "cpu_seconds_direct": direct.cpu,
        "cpu_seconds_composite": composing.cpu,
        "cpu_seconds_reference": times[0].cpu,
        "composite_samples": composite_samples,
        "reference_samples": composite_samples,
        "vertices": found.vertices,
        "paths": path_names,
        "views": [asdict(view) for view in found.views],
        "light_unseen": found.unseen,
        "engines": engines,
        "problems": list(found.problems),
        "engine": scene.render.engine,
        "shading": scene.refractive_glass.shading,
        "surface": surface,
        "magnification": MAGNIFICATION,
        "blender_version": bpy.app.version_string,
    }
    if left_out is not None:
        report["pixels_left_out"] = left_out
    yield lambda: write_report(folder, report, composite, references[0])
    return report


def check_comparable(scene: bpy.types.Scene) -> None:
    """Raise RefractiveGlassError where there is nothing to compare."""
    depsgraph = scene_depsgraph(scene)
    read_viewpoint(scene, depsgraph)
    if not read_glasses(depsgraph):
        raise RefractiveGlassError(
            f'Scene "{scene.name}" has no refractive glass: add one (Add > Mesh > Refractive Glass)'
        )
    if not scene.refractive_glass.enabled:
        raise RefractiveGlassError(
            f'Refractive Glass is switched off in scene "{scene.name}": switch it on to compare'
        )


@dataclass(frozen=True)
class _Time:
    """Seconds that something took: on the clock, and of this process's cores."""

    wall: float
    cpu: float


def _timed(
    steps: Generator[Request, object, np.ndarray],
) -> Generator[Request, object, tuple[np.ndarray, _Time]]:
    """The result of steps and what they took."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = yield from steps
    return result, _Time(time.perf_counter() - wall, time.process_time() - cpu)


def _engines(scene: bpy.types.Scene) -> list[str]:
    """Engines of the scenes of which the last render drew a view layer."""
    drawn = [s for s in find_own_scenes(scene) if any(layer.use for layer in s.view_layers)]
    return sorted({s.render.engine for s in (scene, *drawn)})


def _path_names(scene: bpy.types.Scene, found: Status) -> Callable[[], list[str]]:
    """Lists the picture's light paths; in True shading those of closed forms that carry enough."""
    if found.paths:
        return lambda: list(found.paths)
    depsgraph = scene_depsgraph(scene)
    view = read_viewpoint(scene, depsgraph)
    glasses = [g for g in read_glasses(depsgraph, []) if not g.is_mesh]
    settings = scene.refractive_glass
    least, fresnel = settings.min_weight, settings.surface == "GLASS"

    def names() -> list[str]:
        found = (bright_paths(glass, view, least, fresnel) for glass in glasses)
        return list(dict.fromkeys(path_key(path) for paths in found for path in paths))

    return names


@contextmanager
def _samples(scene: bpy.types.Scene, samples: int | None) -> Iterator[None]:
    """Let the scene render with so many samples a pixel; None: with its own number."""
    settings, name = samples_setting(scene)
    kept = getattr(settings, name)
    try:
        if samples is not None:
            setattr(settings, name, samples)
        yield
    finally:
        setattr(settings, name, kept)


def _masks(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, surface: str, shape: tuple[int, int]
) -> dict[str, np.ndarray]:
    """Masks (H, W) of the picture's parts, cut to the render border.

    ``picture`` is all of it, ``inside`` what any glass covers, ``outside`` the rest, and
    ``path TTTT`` (and so on) a light path's region; rays that split take several paths.
    """
    covered = memory_of(scene).covered
    if covered is not None:
        # True shading tells pixels, in the picture as it is rendered.
        return {"picture": np.ones_like(covered), "inside": covered, "outside": ~covered}
    regions = region_masks(scene, depsgraph)
    outside = regions.pop("")
    if surface == "REFRACTION":
        regions = {events: mask for events, mask in regions.items() if "R" not in events}
    masks = {"picture": np.ones_like(outside), "inside": ~outside, "outside": outside}
    masks |= {f"path {events}": mask for events, mask in regions.items()}
    render = scene.render
    if render.use_border:
        x0, y0, x1, y1 = border_window(scene)
        rows, columns = slice(y0, y1), slice(x0, x1)
        rendered = np.zeros_like(outside)
        rendered[rows, columns] = True
        masks = {name: mask & rendered for name, mask in masks.items()}
        if render.use_crop_to_border:
            masks = {name: mask[rows, columns] for name, mask in masks.items()}
    if masks["picture"].shape != shape:
        raise RuntimeError(f"the render is of {shape} pixels, not {masks['picture'].shape}")
    return masks
