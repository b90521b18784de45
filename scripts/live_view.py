# SPDX-License-Identifier: GPL-3.0-or-later
"""What the refracted picture in a 3D view costs: measured in a Blender with a window.

    blender --factory-startup --python scripts/live_view.py -- FOLDER SHADING [PART,...] \
        SCENE.blend[:FRAME]...

PARTS are final, redraws, playback, memory and f12; all of them if none is named. For each scene, in
its camera's view: times of redraws with and without the picture (nothing moves, the eye moves, an
object moves), Python's part of them, from switching on and from the last motion to the final
picture, without the picture from the last motion to the engine's last sample, how long a piece of
work holds Blender up, and frames a second of playback.
Inside the glass the picture is held against F12's (Workbench's for SOLID, EEVEE's for MATERIAL) and
the one of what moves against that at rest, in dB. Of the last scene: how memory grows, with the
picture and without it. Solid's
light does not come along with the camera here: captures of renders would each be lit from where
they look, those of the view are not. Prints a line a scene and writes FOLDER/live_view.json and
pictures (ImageMagick's ``import``). Quits Blender at the end.
"""

from __future__ import annotations

import gc
import json
import statistics
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
FOLDER, SHADING, *SCENES = sys.argv[sys.argv.index("--") + 1 :]
FOLDER = Path(FOLDER)
ALL_PARTS = {"final", "redraws", "playback", "memory", "f12"}
PARTS = ALL_PARTS
if SCENES and set(SCENES[0].split(",")) <= ALL_PARTS:
    PARTS = set(SCENES.pop(0).split(","))
REDRAWS = 10
"""Of each kind; an even number leaves everything where it was."""
STEP = 0.002
"""By how much eye and objects move from redraw to redraw, metres."""
SETTLE_SECONDS = {"SOLID": 4.0, "MATERIAL": 30.0}
"""Until the engine has compiled and come to rest, before anything is measured."""
LIMIT_SECONDS = 180.0
QUIET_SECONDS = 3.0
"""Without a redraw, after which the engine has come to rest."""
PLAY_SECONDS = 5.0
MANY_REDRAWS = 1000
ENGINES = {"SOLID": "BLENDER_WORKBENCH", "MATERIAL": "BLENDER_EEVEE"}
COPIED = (
    "light",
    "studio_light",
    "color_type",
    "single_color",
    "show_shadows",
    "show_cavity",
    "use_world_space_lighting",
)
"""Settings of Solid shading that Workbench's renders have too."""

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


def camera_frame() -> np.ndarray:
    """The camera's frame in the view, pixels: x0, y0, x1, y1."""
    one, scene = area(), bpy.context.scene
    region = next(r for r in one.regions if r.type == "WINDOW")
    matrix = one.spaces.active.region_3d.perspective_matrix
    places = []
    for corner in scene.camera.data.view_frame(scene=scene):
        clip = matrix @ (scene.camera.matrix_world @ corner).to_4d()
        places.append(
            (
                0.5 * (clip.x / clip.w + 1.0) * region.width,
                0.5 * (clip.y / clip.w + 1.0) * region.height,
            )
        )
    return np.array([*np.min(places, axis=0), *np.max(places, axis=0)])


def fit_frame() -> None:
    """Zoom and shift the camera's frame so that it is whole pixels, those of a render."""
    view = area().spaces.active.region_3d
    for _ in range(3):
        for number, name in ((2, "view_camera_zoom"), (0, 0), (1, 1)):
            before = camera_frame()
            value = view.view_camera_zoom if number == 2 else view.view_camera_offset[name]
            step = 1.0 if number == 2 else 0.01

            def put(to, number=number, name=name):
                if number == 2:
                    view.view_camera_zoom = to
                else:
                    view.view_camera_offset[name] = to

            # The matrices are those of the last redraw.
            put(value + step)
            redraws_once()
            after = camera_frame()
            # Widths by fours: heights are whole too. And all of it is in the view.
            now, then = (f[2] - f[0] if number == 2 else f[number] for f in (before, after))
            region = next(r for r in area().regions if r.type == "WINDOW")
            fits = min(1.0, 0.96 * region.height / (before[3] - before[1]))
            wanted = 4.0 * np.floor(now * fits / 4.0) if number == 2 else np.round(now)
            put(value + (wanted - now) / (then - now) * step if then != now else value)
            redraws_once()


def shot() -> np.ndarray:
    """The view as it is on screen: (H, W, 3), 0 to 1, bottom row first."""
    screenshot("now")
    image = bpy.data.images.load(str(FOLDER / "now.png"))
    region = next(r for r in area().regions if r.type == "WINDOW")
    found = pixels_of(image)[region.y : region.y + region.height]
    return found[:, region.x : region.x + region.width]


def pixels_of(image) -> np.ndarray:
    width, height = image.size
    found = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(found)
    bpy.data.images.remove(image)
    return found.reshape(height, width, 4)[..., :3]


def covered() -> np.ndarray:
    """(H, W) which pixels of the view are wholly glass."""
    from glass_refraction.viewport import views

    (view,) = views._views.values()
    layer = view.painter._used
    with layer.target.bind():
        read = layer.target.read_color(0, 0, *layer.size, 4, 1, "FLOAT")
    cover = np.asarray(read).reshape(layer.size[1], layer.size[0], 4)
    return cover[..., 0] > 0.99 * np.maximum(cover[..., 1], 1.0)


def decibels(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((one[where] - other[where]) ** 2)))


F12 = """
import sys, json, bpy
sys.path.insert(0, ROOT)
import glass_refraction
if not hasattr(bpy.types.Scene, "refractive_glass"):
    glass_refraction.register()
# Files get the newest node group of glasses as they are opened.
bpy.ops.wm.open_mainfile(filepath=SCENE)
scene = bpy.context.scene
scene.frame_set(FRAME)
scene.render.engine = ENGINE
scene.render.resolution_x, scene.render.resolution_y = SIZE
scene.render.resolution_percentage = 100
scene.render.image_settings.file_format = "PNG"
for name, value in SHADING.items():
    # Solid shading is shown so, whatever the scene's view transform.
    scene.view_settings.view_transform = "Standard"
    setattr(scene.display.shading, name, value)
scene.render.filepath = PATH
bpy.ops.render.render(write_still=True)
"""
"""A render in a Blender of its own: nothing of it is left here."""


def rendered(scene_path: str, frame: int, size: tuple[int, int], path: Path) -> np.ndarray:
    """F12's picture by the engine that the view's is like."""
    shading = area().spaces.active.shading
    copied = {}
    if SHADING == "SOLID":
        copied = {setting: getattr(shading, setting) for setting in COPIED}
        copied["single_color"] = tuple(copied["single_color"])
    values = {
        "ROOT": str(ROOT),
        "SCENE": str(Path(scene_path).resolve()),
        "FRAME": frame,
        "ENGINE": ENGINES[SHADING],
        "SIZE": size,
        "SHADING": copied,
        "PATH": str(path),
    }
    code = "\n".join(f"{name} = {value!r}" for name, value in values.items()) + F12
    subprocess.run(
        [bpy.app.binary_path, "-b", "--factory-startup", "--python-expr", code],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return pixels_of(bpy.data.images.load(str(path)))


def save(name: str, pixels: np.ndarray) -> None:
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height)
    filled = np.ones((height, width, 4), np.float32)
    filled[..., :3] = pixels
    image.pixels.foreach_set(filled.ravel())
    image.filepath_raw, image.file_format = str(FOLDER / f"{name}.png"), "PNG"
    image.save()
    bpy.data.images.remove(image)


def plain_view() -> None:
    """Nothing in the view that a render does not show."""
    space = area().spaces.active
    overlay = space.overlay
    for name in ("floor", "axis_x", "axis_y", "cursor", "extras", "object_origins"):
        setattr(overlay, f"show_{name}", False)
    overlay.show_outline_selected = overlay.show_text = overlay.show_relationship_lines = False
    for obj in bpy.context.view_layer.objects:
        obj.select_set(False)
    space.region_3d.view_camera_offset = (0.0, 0.0)
    space.shading.background_type = "WORLD"
    space.shading.show_object_outline = False
    bpy.context.scene.camera.data.show_passepartout = False


def played() -> float:
    """Frames a second of playback."""
    frames = []
    # Blender counts a timer's seconds from when it was called, which may be long ago.
    yield 0.5
    bpy.app.handlers.frame_change_post.append(lambda *_: frames.append(time.perf_counter()))
    with override():
        bpy.ops.screen.animation_play()
    yield PLAY_SECONDS
    with override():
        bpy.ops.screen.animation_cancel(restore_frame=True)
    bpy.app.handlers.frame_change_post.pop()
    spans = len(frames) - 1
    return spans / (frames[-1] - frames[0]) if spans > 0 else 0.0


def memory() -> float:
    """MiB that the process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def grown(move):
    """MiB and Python's blocks of memory, before many redraws and after each quarter of them.

    Given as the last value. Blender sees to events in between, so that captures and pictures at
    rest are made too.
    """
    found = []
    for k in range(MANY_REDRAWS + 1):
        if k % (MANY_REDRAWS // 4) == 0:
            gc.collect()
            found.append((memory(), sys.getallocatedblocks()))
        move(k)
        redraws_once()
        if k % REDRAWS == 0:
            yield 0.3
    return found


def growths(motions: dict):
    """`grown` for each motion, as the last value."""
    found = {}
    for name, move in motions.items():
        found[name] = yield from grown(move)
    return found


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


def redraws_once() -> None:
    with override():
        bpy.context.region.tag_redraw()
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def redraws(move=lambda k: None) -> tuple[float, float, float]:
    """Medians of a redraw: seconds, CPU seconds, milliseconds of Python where it shows glass."""
    from glass_refraction.viewport import views

    seconds, cpu, python = [], [], []
    for k in range(REDRAWS):
        move(k)
        began, busy = time.perf_counter(), time.process_time()
        redraws_once()
        seconds.append(time.perf_counter() - began)
        cpu.append(time.process_time() - busy)
        python += [view.python_ms for view in views._views.values()]
    return tuple(statistics.median(v) if v else 0.0 for v in (seconds, cpu, python))


def move_eye(k: int) -> None:
    bpy.context.scene.camera.location.x += STEP * (-1) ** k


def mover():
    """A function that moves the object with the most vertices that is no glass."""
    from glass_refraction.scene.read.modifier_inputs import glass_modifier

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


def engine_at_rest():
    """Wait until the engine has refined what it shows; gives seconds and CPU seconds, as the last
    value.
    """
    drawn = []
    kind = bpy.types.SpaceView3D
    handle = kind.draw_handler_add(lambda: drawn.append(0), (), "WINDOW", "POST_PIXEL")
    began = last = time.perf_counter()
    busy = spent = time.process_time()
    while time.perf_counter() - last < QUIET_SECONDS:
        yield 0.02
        if drawn:
            # Drawn by now, and swapped.
            last, spent = time.perf_counter(), time.process_time()
            drawn.clear()
    kind.draw_handler_remove(handle, "WINDOW")
    return last - began, spent - busy


def switch(on: bool) -> None:
    with override():
        bpy.context.window_manager.refractive_glass_overlay = on


def measure(scene_path: str):
    path, _, wanted = scene_path.partition(":")
    bpy.ops.wm.open_mainfile(filepath=path)
    yield 1.0
    if wanted:
        bpy.context.scene.frame_set(int(wanted))
    space = area().spaces.active
    space.show_region_ui = space.show_region_toolbar = space.show_gizmo = False
    space.show_region_header = space.show_region_tool_header = False
    space.shading.type = SHADING
    space.shading.use_world_space_lighting = True
    space.region_3d.view_perspective = "CAMERA"
    with override():
        bpy.ops.view3d.view_center_camera()
    plain_view()
    space.shading.use_scene_lights = space.shading.use_scene_world = True
    # Regions get their new sizes first.
    yield 1.0
    redraws_once()
    fit_frame()
    yield SETTLE_SECONDS[SHADING]
    yield from engine_at_rest()
    name, result = f"{Path(path).stem}{wanted}_{SHADING.lower()}", {}
    frame = bpy.context.scene.frame_current
    motions = {"still": lambda k: None, "eye": move_eye, "object": mover()}
    plain, plain_rate = {}, 0.0
    if "redraws" in PARTS:
        plain = {motion: redraws(move) for motion, move in motions.items()}
        yield SETTLE_SECONDS[SHADING] / 2
    if "playback" in PARTS:
        plain_rate = yield from played()
        yield 0.5
    held.update(work=0.0, face=0.0)
    if "final" in PARTS:
        for k in range(2):
            move_eye(k)
            redraws_once()
        result["engine_s"], result["engine_cpu_s"] = yield from engine_at_rest()
        # Shaders are compiled first.
        switch(True)
        yield from final()
        switch(False)
        yield SETTLE_SECONDS[SHADING] / 2
    switch(True)
    result["first_s"], result["first_cpu_s"] = yield from final()
    yield 0.5
    screenshot(name)
    rest, glass = shot(), covered()
    x0, y0, x1, y1 = np.round(camera_frame()).astype(int)
    # There and back: what moves is drawn, from where the picture at rest was seen.
    for k in range(2):
        move_eye(k)
        redraws_once()
    moving = shot()
    result["moving_db"] = decibels(moving, rest, glass)
    result["final_s"], result["final_cpu_s"] = yield from final()
    if "redraws" in PARTS:
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
    if "playback" in PARTS:
        rate = yield from played()
        result["playback"] = [plain_rate, rate, rate / plain_rate if plain_rate else 0.0]
    result["longest_work_s"], result["longest_face_s"] = held["work"], held["face"]
    result["failures"] = [view.failure for view in views_of() if view.failure]
    result["pixels"] = [view.painter.pixels for view in views_of() if view.painter]
    if scene_path == SCENES[-1] and "memory" in PARTS:
        result["memory"] = yield from growths(motions)
    switch(False)
    if scene_path == SCENES[-1] and "memory" in PARTS:
        yield 0.5
        result["plain_memory"] = yield from growths(motions)
    if "f12" in PARTS:
        picture = rendered(path, frame, (int(x1 - x0), int(y1 - y0)), FOLDER / f"{name}_f12.png")
        rest, glass = rest[y0:y1, x0:x1], glass[y0:y1, x0:x1]
        result["f12_db"] = decibels(rest, picture, glass)
        result["beside_db"] = decibels(rest, picture, ~glass)
        save(f"{name}_view", rest)
        apart = np.abs(rest - picture) * (0.3 + 0.7 * glass[..., None])
        save(f"{name}_apart", np.clip(4.0 * apart, 0.0, 1.0))
    found[name] = result
    print(f"live_view: {name} {json.dumps(result)}", flush=True)
    yield 0.5


def views_of() -> list:
    """What is kept for each view that shows glass."""
    from glass_refraction.viewport import views

    return list(views._views.values())


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
