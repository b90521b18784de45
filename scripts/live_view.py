# SPDX-License-Identifier: GPL-3.0-or-later
"""What the refracted picture in a 3D view costs: measured in a Blender with a window.

    blender --factory-startup --python scripts/live_view.py -- FOLDER SHADING SCENE.blend...

For each scene, in its camera's view: times of redraws with and without the picture (nothing moves,
the eye moves, an object moves), Python's part of them, from switching on and from the last motion
to the final picture, and how long a piece of work holds Blender up. Prints a line a scene and
writes FOLDER/live_view.json and screenshots (ImageMagick's ``import``). Quits Blender at the end.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
FOLDER, SHADING, *SCENES = sys.argv[sys.argv.index("--") + 1 :]
FOLDER = Path(FOLDER)
REDRAWS = 9
STEP = 0.002
"""By how much eye and objects move from redraw to redraw, metres."""
SETTLE_SECONDS = {"SOLID": 4.0, "MATERIAL": 30.0}
"""Until the engine has compiled and come to rest, before anything is measured."""
LIMIT_SECONDS = 180.0

found: dict[str, dict] = {}
held: dict[str, float] = {"work": 0.0, "face": 0.0}


def area() -> bpy.types.Area:
    window = bpy.context.window_manager.windows[0]
    return next(a for a in window.screen.areas if a.type == "VIEW_3D")


def override():
    window, one = bpy.context.window_manager.windows[0], area()
    region = next(r for r in one.regions if r.type == "WINDOW")
    return bpy.context.temp_override(window=window, area=one, region=region)


def screenshot(name: str) -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    subprocess.run(["import", "-window", "root", str(FOLDER / f"{name}.png")], check=True)


def watch(views, capture) -> None:
    """Note how long pieces of work take."""
    work, draw = views._work, capture.Captures.draw

    def timed_work(*arguments):
        before, began = held["faces"], time.perf_counter()
        work(*arguments)
        spent = time.perf_counter() - began - (held["faces"] - before)
        held["work"] = max(held["work"], spent)

    def timed_draw(self, *arguments):
        began = time.perf_counter()
        draw(self, *arguments)
        spent = time.perf_counter() - began
        held["faces"] += spent
        held["face"] = max(held["face"], spent)

    held["faces"] = 0.0
    views._work, capture.Captures.draw = timed_work, timed_draw


def redraws(move=lambda k: None) -> tuple[float, float, float]:
    """Medians of a redraw: seconds, CPU seconds, milliseconds of Python where it shows glass."""
    from glass_refraction.viewport import views

    seconds, cpu, python = [], [], []
    for k in range(REDRAWS):
        move(k)
        began, busy = time.perf_counter(), time.process_time()
        with override():
            bpy.context.region.tag_redraw()
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        seconds.append(time.perf_counter() - began)
        cpu.append(time.process_time() - busy)
        python += [view.python_ms for view in views._views.values()]
    return tuple(statistics.median(v) if v else 0.0 for v in (seconds, cpu, python))


def move_eye(k: int) -> None:
    bpy.context.scene.camera.location.x += STEP * (-1) ** k


def mover():
    """A function that moves the object with the most vertices that is no glass."""
    from glass_refraction.scene.read.glasses import glass_modifier

    things = [o for o in bpy.context.scene.objects if o.type == "MESH" and not glass_modifier(o)]
    thing = max(things, key=lambda o: len(o.data.vertices))

    def move(k: int) -> None:
        thing.location.x += STEP * (-1) ** k

    return move


def final():
    """Wait for the final picture; gives the seconds, and the CPU seconds, as the last value."""
    from glass_refraction.viewport import views

    began, busy = time.perf_counter(), time.process_time()
    while time.perf_counter() - began < LIMIT_SECONDS:
        yield 0.02
        if views.at_rest():
            break
    return time.perf_counter() - began, time.process_time() - busy


def switch(on: bool) -> None:
    with override():
        bpy.context.window_manager.refractive_glass_overlay = on


def measure(path: str):
    from glass_refraction.viewport import views

    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    space = area().spaces.active
    space.show_region_ui = space.show_region_toolbar = space.show_gizmo = False
    space.shading.type = SHADING
    space.region_3d.view_perspective = "CAMERA"
    with override():
        bpy.ops.view3d.view_center_camera()
    yield SETTLE_SECONDS[SHADING]
    name, result = Path(path).stem, {}
    motions = {"still": lambda k: None, "eye": move_eye, "object": mover()}
    plain = {motion: redraws(move) for motion, move in motions.items()}
    yield SETTLE_SECONDS[SHADING] / 2
    held.update(work=0.0, face=0.0)
    switch(True)
    result["first_s"], result["first_cpu_s"] = yield from final()
    yield 0.5
    screenshot(f"{name}_{SHADING.lower()}")
    held.update(work=0.0, face=0.0)
    for motion, move in motions.items():
        seconds, cpu, python = redraws(move)
        plain_seconds, plain_cpu, _ = plain[motion]
        result[motion] = {
            "plain_ms": 1e3 * plain_seconds,
            "ms": 1e3 * seconds,
            "ratio": seconds / plain_seconds,
            "cpu_ratio": cpu / plain_cpu,
            "python_ms": python,
        }
    result["final_s"], result["final_cpu_s"] = yield from final()
    result["longest_work_s"], result["longest_face_s"] = held["work"], held["face"]
    result["failures"] = [view.failure for view in views._views.values() if view.failure]
    result["pixels"] = [view.painter.pixels for view in views._views.values() if view.painter]
    found[name] = result
    print(f"live_view: {name} {json.dumps(result)}", flush=True)
    switch(False)
    yield 0.5


def steps():
    import glass_refraction

    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()
    from glass_refraction.viewport import capture, views

    watch(views, capture)
    yield 1.0
    for path in SCENES:
        yield from measure(path)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "live_view.json").write_text(json.dumps(found, indent=1))


def _run() -> float | None:
    try:
        return next(_walk)
    except StopIteration:
        pass
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()
    return None


_walk = steps()
bpy.app.timers.register(_run, first_interval=1.0, persistent=True)
