# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: where the vertex shader finds points, beside ``apparent_points``.

Argument: output folder. For each shape the differences are the result; tests judge them.
"""

import importlib
import json
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from vertex_points import apparent_points

FOLDER = Path(sys.argv[-1])
NAME = "bl_ext.user_default.refractive_glass.glass_refraction"
POINTS = 20_000
EYES = 5
SIZE = (800, 600)
SQUARE = [(-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)]
NEAR, FAR = 0.01, 100.0


def shapes(optics):
    """Name: glass."""
    flat, tube, ball = optics.FlatGlass, optics.CylinderGlass, optics.SphereGlass
    stack = ((0.02, 0.01, 0.03), (1.5, 1.7, 1.33))
    return {
        "slab": flat((0.02,), (1.5,), outline=SQUARE),
        "stack": flat(*stack, outline=SQUARE),
        "tank": flat((0.01,), (1.5,), ior_below=1.333, outline=SQUARE),
        "surface": flat((0.01,), (1.5,), ior_above=1.333, outline=SQUARE),
        "tube": tube((0.040, 0.037), (1.5, 1.0), extent=(-0.5, 0.5)),
        "thick": tube((0.040, 0.020), (1.8, 1.0), extent=(-0.5, 0.5)),
        "thin": tube((0.040, 0.0396), (1.33, 1.0), extent=(-0.5, 0.5)),
        "ball": ball((0.05, 0.045), (1.5, 1.0)),
        "bubble": ball((0.05, 0.03), (1.6, 1.2), ior_outside=1.2),
    }


def eyes(body, random):
    """Places round a glass."""
    high = body.box[1]
    if body.endless != (0,):
        up = random.uniform(0.2, 2.0, EYES)
        across = random.uniform(-0.4, 0.4, (2, EYES))
        below = (-1.0) ** np.arange(EYES) if set(body.endless) == {0} else 1.0
        return np.stack((*across, (up + high[2]) * below), axis=-1)
    turn, height = random.uniform(0.0, 2.0 * np.pi, EYES), random.uniform(-0.3, 0.3, EYES)
    away = np.geomspace(0.08, 4.0, EYES)
    return np.stack((away * np.cos(turn), away * np.sin(turn), height), axis=-1)


def points_of(kind, body, eye, random, held):
    """Places behind a glass as seen from an eye, or in it."""
    low, high = body.box
    spread = random.normal(0.0, 1.0, (POINTS, 3))
    if kind == 0:
        side = np.sign(eye[2])
        deep = random.uniform(1e-3, 1.0, POINTS)
        spread[:, :2] *= 0.5
        spread[:, 2] = np.where(side > 0.0, low[2] - deep, high[2] + deep)
        return spread
    if held:
        inner = body.glass.radius[1]
        axes = 2 if kind == 1 else 3
        along = spread[:, :axes] / np.linalg.norm(spread[:, :axes], axis=1, keepdims=True)
        part = random.uniform(0.0, 1.0, (POINTS, 1)) ** (1.0 / axes)
        spread[:, :axes] = 0.999 * inner * part * along
        spread[:, 2] *= 0.1 if kind == 1 else 1.0
        return spread
    size = body.scale
    axis = eye.copy()
    if kind == 1:
        axis[2] = 0.0
    axis /= np.linalg.norm(axis)
    # Twice as wide as what the glass can show, so that its limits are met.
    spread *= 1.5 * size
    deep = size * random.uniform(1.05, 30.0, POINTS)
    return spread * np.sqrt(deep / size)[:, None] - deep[:, None] * axis


def looking(viewpoint, body, eye, kind):
    """A view of the whole glass from an eye."""
    target = np.zeros(3) if kind else np.array((0.0, 0.0, body.box[1, 2]))
    back = eye - target
    away = np.linalg.norm(back)
    back /= away
    side = np.cross((0.31, 0.2, 0.93), back)
    side /= np.linalg.norm(side)
    turn = np.stack((side, np.cross(back, side), back))
    to_camera = np.eye(4)
    to_camera[:3, :3], to_camera[:3, 3] = turn, -turn @ eye
    reach = body.scale if kind else 0.4
    wide = away / reach if kind == 0 else np.sqrt(max(away**2 - reach**2, 1e-3)) / reach
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = wide, wide * SIZE[0] / SIZE[1]
    projection[2, 2] = (NEAR + FAR) / (NEAR - FAR)
    projection[2, 3], projection[3, 2] = 2.0 * NEAR * FAR / (NEAR - FAR), -1.0
    return viewpoint(eye, to_camera, projection, SIZE, (0, 0, *SIZE), False)


def compare(modules, glass, seed):
    """Largest difference in pixels over eyes, and how often both disagree whether there is one."""
    optics, description, bending, viewpoint = modules
    random = np.random.default_rng(seed)
    body = optics.body(glass)
    # Anywhere in the world, as far off and as turned as scenes have it.
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    to_world = np.eye(4)
    to_world[:3, :3] = turn * np.sign(np.linalg.det(turn))
    to_world[:3, 3] = 3.0, -2.0, 1.0
    posed = description.Posed(body, to_world)
    found = {"points": 0, "error": 0.0, "way": 0.0, "infinite": 0, "missed": 0, "wrong": 0}
    for place in eyes(body, random):
        kind = 0 if isinstance(glass, optics.FlatGlass) else 1
        kind += isinstance(glass, optics.SphereGlass)
        view = looking(viewpoint, body, place, kind)
        turned = np.eye(4)
        turned[:3, :3], turned[:3, 3] = to_world[:3, :3].T, -to_world[:3, :3].T @ to_world[:3, 3]
        view = viewpoint(
            to_world[:3, :3] @ place + to_world[:3, 3],
            view.to_camera @ turned,
            view.projection,
            SIZE,
            view.window,
            False,
        )
        one = bending.bending(0, posed, view)
        block = one.block(view, description.common_frame([posed]), np.eye(4))
        unbounded = glass
        path = "TTTT"
        if kind == 0:
            unbounded = optics.FlatGlass(
                glass.thickness, glass.ior, glass.ior_above, glass.ior_below
            )
            path = "T" * (len(glass.ior) + 1)
        elif kind == 1:
            unbounded = optics.CylinderGlass(glass.radius, glass.ior, glass.ior_outside)
        for held in (False, True) if kind else (False,):
            local = points_of(kind, body, place, random, held)
            # As the mesh of an object holds them: single precision, in a frame of their own.
            local = np.float32(local).astype(float)
            world = local @ to_world[:3, :3].T + to_world[:3, 3]
            true = optics.apparent_points(unbounded, path, place, local)
            slots = np.flatnonzero(true.stretch == (2 if held else len(path)))
            valid = true.valid[slots]
            assert valid.sum(axis=0).max() <= 1
            slot, rows = slots[valid.argmax(axis=0)], np.arange(len(local))
            there = valid.any(axis=0)
            apparent = true.position[slot, rows] @ to_world[:3, :3].T + to_world[:3, 3]
            clip = np.column_stack((apparent, np.ones(len(world))))
            clip = clip @ (view.projection @ view.to_camera).T
            expected = clip[:, :2] / clip[:, 3:]
            shown = there & (np.abs(expected).max(axis=1) < 1.0) & (clip[:, 3] > 0.0)
            places, ways, misses = apparent_points(NAME, one, block, local, held, to_world)
            error = np.linalg.norm(0.5 * (places - expected) * SIZE, axis=1)
            length = true.distance[slot, rows] / body.scale
            finite = np.isfinite(ways) & np.isfinite(misses)
            found["infinite"] += int((~finite).sum())
            found["points"] += int(shown.sum())
            found["error"] = max(found["error"], float(error[shown].max()))
            found["way"] = max(found["way"], float(np.abs(ways / length - 1.0)[shown].max()))
            near = misses < 1e-2
            if kind and not held:
                # What lies within the glass is not behind it: fragments are cut there.
                near &= np.linalg.norm(local[:, : kind + 1], axis=1) > 1.001 * body.scale
            found["missed"] += int((shown & (misses >= 1e-2)).sum())
            found["wrong"] += int((~there & near & (misses < 1e-3)).sum())
    return found


def run():
    result = {}
    try:
        root = importlib.import_module(NAME)
        part = lambda name: importlib.import_module(f"{root.__name__}.{name}")  # noqa: E731
        modules = (
            part("optics"),
            part("viewport.description"),
            part("viewport.bending"),
            part("scene.read.viewpoint").Viewpoint,
        )
        for seed, (name, glass) in enumerate(shapes(modules[0]).items()):
            result[name] = compare(modules, glass, seed)
            print("apparent:", name, json.dumps(result[name]), flush=True)
        (FOLDER / "result.json").write_text(json.dumps(result))
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()


bpy.app.timers.register(run, first_interval=1.0, persistent=True)
