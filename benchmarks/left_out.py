# SPDX-License-Identifier: GPL-3.0-or-later
"""What "only what a scene needs" leaves out of each scene, and the error that it costs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest import mock

import bpy
import numpy as np

from glass_refraction import optics
from glass_refraction.reference.cycles import scene_depsgraph
from glass_refraction.reference.metrics import psnr, to_srgb
from glass_refraction.scene import update as door
from glass_refraction.scene.rays import frame
from glass_refraction.scene.rays.exits import Endings, ending
from glass_refraction.scene.read.glasses import read_glasses
from glass_refraction.scene.read.sources import pieces, source_objects, world_positions
from glass_refraction.scene.read.viewpoint import read_viewpoint
from glass_refraction.scene.vertices.kept_paths import bright_paths
from glass_refraction.scene.vertices.regions import (
    centre_weights,
    path_regions,
    picture_rect,
    region_masks,
)

from .measure import seconds
from .pictures import composite, computed, open_scene, timed
from .plots import Chart
from .settings import Settings
from .text import number, table

TITLE = "What is left out"

LISTED = 1e-3
"""Weight below which a path is not even listed."""


def run(settings: Settings) -> dict:
    """All figures of this part. The loaded file is replaced by each scene's."""
    lit = [path for path in settings.scenes if not path.stem.endswith("_unlit")]
    return {"scenes": [_scene(settings, path) for path in lit[: settings.pick(1, 1, 2)]]}


def _scene(settings: Settings, path: Path) -> dict:
    scene = open_scene(path, settings.pick((32, 24), (120, 90), (240, 180)))
    scene.cycles.samples = settings.pick(1, 4, 16)
    scene.refractive_glass.surface = "GLASS"
    rays = _true(settings, scene)
    scene.refractive_glass.shading = "DISPLACED"
    kept = _displaced(scene)
    counted = _counts(scene)
    fewer = []
    for name, values in _fuller(settings):
        with _settings(scene, values):
            fuller = _displaced(scene)
        fewer.append(
            {
                "name": name,
                "vertices": fuller["vertices"],
                "copies": fuller["copies"],
                "cpu_seconds": fuller["cpu_seconds"],
                "paths": fuller["paths"],
                "psnr_db": _finite(psnr(kept["picture"], fuller["picture"])),
                "psnr_inside_db": _finite(psnr(kept["picture"], fuller["picture"], kept["inside"])),
            }
        )
    del kept["picture"], kept["inside"]
    return {
        "scene": path.stem,
        "resolution": [scene.render.resolution_x, scene.render.resolution_y],
        "samples": scene.cycles.samples,
        "kept": kept,
        "fuller": fewer,
        "rays": rays,
        **counted,
    }


def _true(settings: Settings, scene: bpy.types.Scene) -> list[dict]:
    """True shading with more and with less than the default: what was followed and rendered."""
    scene.refractive_glass.shading = "TRUE"
    rows, pictures = [], []
    for name, values, changes in _rays(settings):
        with _settings(scene, values), ExitStack() as changed:
            for attribute, function in changes.items():
                changed.enter_context(mock.patch.object(frame, attribute, function))
            door.forget()
            picture, taken = timed(lambda: composite(scene))
        found = computed(scene)
        pictures.append(to_srgb(picture))
        captures = [view for view in found.views if view.name != "direct"]
        rows.append(
            {
                "name": name,
                **taken,
                "pixels": int(door.memory_of(scene).covered.sum()),
                "rays": found.rays,
                "ways": found.ways,
                "captures": len(captures),
                "samples": sum(view.samples for view in captures),
                "samples_of_all": len(captures) * scene.cycles.samples,
                "unseen": found.unseen,
                "psnr_inside_db": _finite(
                    psnr(pictures[-1], pictures[0], door.memory_of(scene).covered)
                ),
            }
        )
    return rows


def _many_rays(rays, beside, *others) -> Endings:
    """`ending`, as though all ways ended in each pixel of glass."""
    found = ending(rays, beside, *others)
    found.pixel[beside.pixel] = 1.0
    return replace(found, way=np.ones_like(found.way))


def _one_ray(*arguments) -> Endings:
    """`ending`, as though no way ended anywhere."""
    found = ending(*arguments)
    return Endings(*map(np.zeros_like, vars(found).values()))


def _all_samples(*_) -> float:
    """`_worth` of views that need as many samples as the direct picture."""
    return 1.0


def _rays(settings: Settings) -> Iterator[tuple[str, dict, dict]]:
    """Names, settings, and what of `frame` is changed. The fullest first: it judges the others."""
    weight = settings.pick(5e-3, 2e-3, 2e-3)
    fine = {"min_weight": weight}
    many, every = {"ending": _many_rays}, {"_worth": _all_samples}
    yield "all that follows", fine, many | every
    yield "default", {}, {}
    yield "many rays in every pixel", {}, many
    yield "one ray a pixel", {}, {"ending": _one_ray}
    yield "all samples in captures", {}, every
    yield f"ways of {100 * weight:g} % and more", fine, {}
    yield "ways of 5 % and more", {"min_weight": 0.05}, {}
    for captures in (2, 1, 0):
        yield f"captures: {captures}", {"captures": captures}, {}


def _fuller(settings: Settings) -> Iterator[tuple[str, dict]]:
    """What is kept in place of left out, one thing at a time."""
    weight = settings.pick(5e-3, 2e-3, 2e-3)
    yield f"paths of {100 * weight:g} % and more", {"min_weight": weight}
    tolerance = settings.pick(0.25, 0.1, 0.05)
    yield f"subdivided to {tolerance:g} px", {"tolerance_px": tolerance}


@contextmanager
def _settings(scene: bpy.types.Scene, values: dict) -> Iterator[None]:
    """Other settings for a while."""
    kept = {name: getattr(scene.refractive_glass, name) for name in values}
    for name, value in values.items():
        setattr(scene.refractive_glass, name, value)
    try:
        yield
    finally:
        for name, value in kept.items():
            setattr(scene.refractive_glass, name, value)


def _displaced(scene: bpy.types.Scene) -> dict:
    """The displaced picture of the scene as it is set, and what it took."""
    door.forget()
    picture, taken = timed(lambda: composite(scene))
    found = computed(scene)
    shapes = [shape for _, _, shape in door.memory_of(scene).copies.values()]
    inside = ~region_masks(scene, scene_depsgraph(scene))[""]
    return {
        "picture": to_srgb(picture),
        "inside": inside,
        **taken,
        "vertices": found.vertices,
        "paths": list(found.paths),
        "copies": sum(shape.vertices > 0 for shape in shapes),
        "empty_copies": sum(shape.vertices == 0 for shape in shapes),
        "bound_px": found.bound_px,
    }


def _finite(decibel: float) -> float | None:
    """None for equal pictures."""
    return None if np.isinf(decibel) else decibel


def _counts(scene: bpy.types.Scene) -> dict:
    """Sources, paths, light and pixels, kept and left out."""
    depsgraph = scene_depsgraph(scene)
    view = read_viewpoint(scene, depsgraph)
    width, height = view.size
    sources = source_objects(depsgraph.view_layer)
    vertices = 0
    for source in sources:
        with pieces(source, depsgraph) as parts:
            vertices += len(world_positions(parts))
    glasses = []
    for glass in read_glasses(depsgraph):
        settings = scene.refractive_glass
        kept = bright_paths(glass, view, settings.min_weight, settings.surface == "GLASS")
        listed = optics.light_paths(glass.description, view.eye_for(glass), min_weight=LISTED)
        weights, hit = centre_weights(glass, view, listed)
        mean = weights[:, hit].sum(axis=1) / max(1, hit.sum())
        carried = dict(zip((path.events for path in listed), mean.tolist(), strict=True))
        rect = picture_rect(glass, view)
        smooth = seconds(lambda g=glass, k=kept: path_regions(g, view, k))
        plain = seconds(lambda g=glass, k=kept: centre_weights(g, view, k))
        glasses.append(
            {
                "glass": glass.name,
                "kept_paths": [path.events for path in kept],
                "listed_paths": [path.events for path in listed],
                "light_kept": sum(carried.get(path.events, 0.0) for path in kept),
                "light_listed": sum(carried.values()),
                "rect_pixels": max(0, rect[2] - rect[0]) * max(0, rect[3] - rect[1]),
                "hit_pixels": int(hit.sum()),
                "mask_seconds": smooth,
                "mask_centres_seconds": plain,
            }
        )
    return {
        "sources": len(sources),
        "source_vertices": vertices,
        "picture_pixels": width * height,
        "glasses": glasses,
    }


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "Surface *Glass*. *True shading*: rays that were followed, the ways that they split into, "
        "captures, and their samples in parts of those that they would have with as many as the "
        "direct picture; *unseen*: part of the light whose hits no view shows; *PSNR*: inside the "
        "glass, against the row that keeps most, same seed: what leaving out costs. Many rays are "
        "12 a pixel. *Displaced shading*: a copy is one source along one path of one glass, solved "
        "vertex by vertex; sources that do not appear in the path's region get none. The light of "
        "a path is its mean weight over the pixels of the glass. *PSNR*: default settings against "
        "one that keeps more, same seed, over the picture and inside the glass.",
        "",
    ]
    for scene in found["scenes"]:
        kept, rays = scene["kept"], scene["rays"]
        width, height = scene["resolution"]
        possible = scene["sources"] * sum(len(glass["kept_paths"]) for glass in scene["glasses"])
        lines += [
            f"### {scene['scene']}",
            "",
            f"{width} x {height}, {scene['samples']} samples.",
            "",
        ]
        lines += table(
            (
                "True shading",
                "rays a pixel of glass",
                "ways a ray",
                "captures",
                "their samples, %",
                "unseen, %",
                "CPU, s",
                "PSNR inside, dB",
            ),
            [
                (
                    row["name"],
                    row["rays"] / max(1, row["pixels"]),
                    row["ways"] / max(1, row["rays"]),
                    row["captures"],
                    100.0 * row["samples"] / max(1, row["samples_of_all"]),
                    100.0 * row["unseen"],
                    row["cpu_seconds"],
                    "-" if row is rays[0] else _decibel(row["psnr_inside_db"]),
                )
                for row in rays
            ],
        )
        lines += [_saved(rays), ""]
        lines += [
            f"Displaced shading: {scene['sources']} sources of "
            f"{number(scene['source_vertices'])} vertices; {kept['copies']} copies where every "
            f"source along every kept path would be {possible}; {kept['empty_copies']} do not "
            "appear in their region; bound on the gap "
            f"{number(kept['bound_px'])} px.",
            "",
        ]
        lines += table(
            (
                "glass",
                "paths kept",
                "paths listed",
                "light kept, %",
                "light listed, %",
                "picture's pixels",
                "in the glass's rectangle",
                "on the glass",
            ),
            [
                (
                    glass["glass"],
                    f"{len(glass['kept_paths'])}: {', '.join(glass['kept_paths'])}",
                    len(glass["listed_paths"]),
                    100 * glass["light_kept"],
                    100 * glass["light_listed"],
                    scene["picture_pixels"],
                    glass["rect_pixels"],
                    glass["hit_pixels"],
                )
                for glass in scene["glasses"]
            ],
        )
        rows = [("default", kept["copies"], kept["vertices"], kept["cpu_seconds"], None, None)]
        rows += [
            (
                row["name"],
                row["copies"],
                row["vertices"],
                row["cpu_seconds"],
                _decibel(row["psnr_db"]),
                _decibel(row["psnr_inside_db"]),
            )
            for row in scene["fuller"]
        ]
        lines += table(
            ("Displaced shading", "copies", "vertices", "CPU, s", "PSNR, dB", "PSNR inside, dB"),
            rows,
        )
    return lines


def _saved(rays: list[dict]) -> str:
    """What adaptivity saves and costs, in a sentence."""
    row = {row["name"]: row for row in rays}
    default, full = row["default"], rays[0]
    decibels = [_decibel(r["psnr_inside_db"]) for r in (default, row["many rays in every pixel"])]
    return (
        f"Default settings follow {100.0 * default['rays'] / full['rays']:.0f} % of the rays and "
        f"{100.0 * default['ways'] / full['ways']:.0f} % of the ways of the row that keeps most, "
        f"and take {100.0 * default['samples'] / max(1, default['samples_of_all']):.0f} % of the "
        f"captures' samples, in {100.0 * default['cpu_seconds'] / full['cpu_seconds']:.0f} % of "
        f"its CPU time; {decibels[0]} dB remain to it, {decibels[1]} with many rays everywhere."
    )


def _decibel(value: float | None) -> str:
    return "equal" if value is None else f"{value:.1f}"


def charts(found: dict) -> list[Chart]:
    """None: what is left out is counted."""
    return []
