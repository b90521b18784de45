# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: exit rays of the live view's shader beside those of ``optics``.

Argument: output folder. For each shape the differences are the result; tests judge them.
"""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

FOLDER = Path(sys.argv[-1])
NAME = "bl_ext.user_default.refractive_glass.glass_refraction"
ROWS, COLUMNS = 250, 400
LEAST = 0.01
WAYS = 24

CHAOTIC = 8
"""Events from which on rounding grows beyond what single precision can tell."""

STAR = np.array(
    [
        (np.cos(0.2 * np.pi * k) / (1 + k % 2), np.sin(0.2 * np.pi * k) / (1 + k % 2))
        for k in range(10)
    ]
)


def shapes(optics):
    """Name: glass."""
    bowl = [(0.0, 0.0), (0.03, 0.004), (0.042, 0.05), (0.035, 0.09)]
    inside = [(0.0, 0.006), (0.026, 0.01), (0.038, 0.05), (0.033, 0.09)]
    return {
        "slab": optics.FlatGlass((0.01,), (1.5,), outline=[(-0.1, -0.1), (0.1, -0.1), (0, 0.15)]),
        "star": optics.FlatGlass((0.02, 0.01), (1.5, 1.7), outline=STAR * 0.1),
        "tank": optics.FlatGlass(
            (0.01,), (1.5,), ior_below=1.333, outline=[(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1)]
        ),
        "cylinder": optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.0, 0.12)),
        "filled": optics.CylinderGlass((0.04, 0.03), (1.5, 1.333), extent=(0.0, 0.12)),
        "rod": optics.CylinderGlass((0.02,), (1.5,), extent=(0.0, 0.1)),
        "sphere": optics.SphereGlass((0.05,), (1.5,)),
        "bowl": optics.SphereGlass((0.15, 0.147), (1.5, 1.333)),
        "tumbler": optics.Tumbler(0.04, 0.003, 0.1, 0.008, 1.5, 1.333, 0.06),
        "empty": optics.Tumbler(0.04, 0.003, 0.1, 0.008),
        "revolution": optics.RevolutionGlass(bowl, inside, 1.5, 1.333, 0.05),
        "lens": optics.RevolutionGlass([(0.0, 0.0), (0.03, 0.006), (0.0, 0.012)], None, 1.6),
    }


def random_rays(body, count, seed):
    """Rays from all round a glass to places in its box: origins and unit directions (N, 3)."""
    random = np.random.default_rng(seed)
    low, high = body.box
    reach = np.linalg.norm(high - low)
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # In a tank nobody stands on the water's side.
    if body.endless != (0, 0) and 0 not in body.endless[1:]:
        away[:, 2] = np.abs(away[:, 2])
    origins = 0.5 * (low + high) + reach * random.uniform(0.8, 3.0, (count, 1)) * away
    targets = low + (high - low) * random.uniform(size=(count, 3))
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def compare(optics, description, paint, glass, seed):
    """Shares of all light in ways that agree, and how exactly."""
    body = optics.body(glass)
    posed = description.Posed(body, np.eye(4))
    frame = description.common_frame([posed])
    block = description.pack([posed], frame)
    origins, directions = random_rays(body, ROWS * COLUMNS, seed)
    outside = body.medium_at(origins) == 0
    shape = (ROWS, COLUMNS, 3)
    began = time.perf_counter()
    places, alongs = paint.exit_rays(
        block, frame.place(origins).reshape(shape), directions.reshape(shape), LEAST, WAYS
    )
    seconds = time.perf_counter() - began
    places, alongs = (v.reshape(WAYS, -1, 4).astype(float) for v in (places, alongs))
    placed = optics.PlacedGlass(body, np.eye(4))
    ends = optics.exit_rays([placed], origins, directions, min_weight=LEAST)
    met = (ends.events > 0) & outside[ends.ray]
    ray, weight, events = ends.ray[met], ends.weight[met], ends.events[met]
    origin, direction = ends.origin[met], ends.direction[met]
    # The way of the shader that is nearest: in direction, and in weight where directions agree.
    off = np.linalg.norm(alongs[:, ray, :3] - direction, axis=2)
    change = np.abs(places[:, ray, 3] - weight)
    missing = places[:, ray, 3] == 0.0
    apart = np.where(missing, 9.0, off + change)
    best = apart.argmin(axis=0)
    rows = np.arange(len(ray))
    angle = np.where(apart[best, rows] < 9.0, off[best, rows], 9.0)
    shift = origin - (frame.origin + frame.unit * places[best, ray, :3])
    across = np.linalg.norm(np.cross(shift, direction), axis=1) / body.scale
    return {
        "rays": len(np.unique(ray)),
        "ways": len(ray),
        "ways_of_shader": int((places[:, outside, 3] > 0.0).sum()),
        "off": float((angle > 1e-4).mean()),
        "off_short": float((angle > 1e-4)[events < CHAOTIC].mean()),
        "light_off": float(weight[angle > 1e-4].sum() / weight.sum()),
        "median": float(np.median(angle)),
        "weight_off": float((change[best, rows] > 1e-3)[angle <= 1e-4].mean()),
        "shift_off": float((across > 1e-4)[angle <= 1e-4].mean()),
        "seconds": seconds,
    }


def run():
    result = {}
    try:
        root = __import__("importlib").import_module(NAME)
        optics = __import__("importlib").import_module(f"{root.__name__}.optics")
        description = __import__("importlib").import_module(f"{root.__name__}.viewport.description")
        paint = __import__("importlib").import_module(f"{root.__name__}.viewport.paint")
        for seed, (name, glass) in enumerate(shapes(optics).items()):
            result[name] = compare(optics, description, paint, glass, seed)
            print("exit_rays:", name, json.dumps(result[name]), flush=True)
        (FOLDER / "result.json").write_text(json.dumps(result))
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()


bpy.app.timers.register(run, first_interval=1.0, persistent=True)
