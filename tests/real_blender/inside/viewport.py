# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: the refracted picture in 3D views.

Arguments: output folder, the scene that ``viewport_f12`` made. Writes screenshots as arrays and the
rest as the result.
"""

import gc
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import bpy
import gpu
import numpy as np
from mathutils import Quaternion, Vector

sys.path.insert(0, str(Path(__file__).parent))
from windowed import walk

FOLDER, SCENE = Path(sys.argv[-2]), Path(sys.argv[-1])
NAME = "bl_ext.user_default.refractive_glass.glass_refraction"
FRAMES = (1, 10, 20)
REST_SECONDS = 300
MANY = 40
"""Quarters of a second in which what takes a few of them is to happen on a busy machine too."""
SLOW_FACE = 0.5
"""Seconds of a face of a capture; on a busy machine one may take longer than a redraw."""
REDRAWS = 10
"""Of each kind of motion; an even number leaves everything where it was."""
UNDOS = 4
"""Steps back, and as many forth."""
ZOOM = 20.0
"""Of the camera's view: its frame is 430 pixels wide, most of the view."""
STEP = (0.002, -0.002)
"""Metres by which eye or eraser move from redraw to redraw."""
SEEN_STEP = 0.1
"""A difference of colours that is a line's."""
FAR_OFF = 1e6
"""Metres: nothing of the scene is as far off."""

result = {"seconds": {}}


def module():
    return sys.modules[f"{NAME}.viewport.views"]


def areas(kind="VIEW_3D"):
    window = bpy.context.window_manager.windows[0]
    return [a for a in window.screen.areas if a.type == kind]


def override(area):
    region = next(r for r in area.regions if r.type == "WINDOW")
    window = bpy.context.window_manager.windows[0]
    return bpy.context.temp_override(window=window, area=area, region=region)


def switch(area, on):
    with override(area):
        bpy.context.window_manager.refractive_glass_overlay = on
        result["switched"] = bpy.context.window_manager.refractive_glass_overlay == on


def screenshot(name, area):
    """The area's 3D view as it is on screen: (H, W, 3) float, bottom row first."""
    path = FOLDER / f"{name}.png"
    subprocess.run(["import", "-window", "root", path], check=True)
    image = bpy.data.images.load(str(path))
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    region = next(r for r in area.regions if r.type == "WINDOW")
    pixels = pixels.reshape(height, width, 4)[..., :3]
    return pixels[region.y : region.y + region.height, region.x : region.x + region.width]


def settled(name, area):
    """`screenshot`, once three in a row are the same: a busy machine may draw none between two."""
    found, same = None, 0
    for _ in range(24):
        yield 0.2
        redraw(area)
        found, before = screenshot(name, area), found
        same = same + 1 if before is not None and np.array_equal(found, before) else 0
        if same == 2:
            break
    return found


def redraw(area):
    """Draw the window, and show it, before anything else happens."""
    with override(area):
        area.tag_redraw()
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def camera_frame(area):
    """The camera's frame in the view, pixels: (x0, y0, x1, y1), floats."""
    region = next(r for r in area.regions if r.type == "WINDOW")
    matrices = area.spaces.active.region_3d
    camera = bpy.context.scene.camera
    corners = camera.data.view_frame(scene=bpy.context.scene)
    places = []
    for corner in corners:
        clip = matrices.perspective_matrix @ (camera.matrix_world @ corner).to_4d()
        place = Vector((clip.x / clip.w, clip.y / clip.w))
        places.append((0.5 * (place.x + 1) * region.width, 0.5 * (place.y + 1) * region.height))
    places = np.array(places)
    return [*places.min(axis=0), *places.max(axis=0)]


def flat_view(area, kind):
    # A selected glass shows its lines.
    bpy.ops.object.select_all(action="DESELECT")
    space = area.spaces.active
    space.region_3d.view_perspective, space.region_3d.view_camera_zoom = "CAMERA", ZOOM
    # Without overlays EEVEE writes no depths; what they show lies beside the eraser.
    overlay = space.overlay
    overlay.show_overlays = kind != "SOLID"
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = overlay.show_cursor = False
    overlay.show_extras = overlay.show_object_origins = overlay.show_outline_selected = False
    overlay.show_text = False
    space.show_gizmo = False
    space.show_region_ui = space.show_region_toolbar = space.show_region_header = False
    shading = space.shading
    shading.type, shading.light, shading.color_type = kind, "FLAT", "MATERIAL"
    shading.show_object_outline = shading.show_cavity = False


def rest():
    """Wait until every view that asks has its final picture, and shows it."""
    views = module()
    started = time.perf_counter()
    yield 0.2
    while time.perf_counter() - started < REST_SECONDS:
        if views.at_rest():
            break
        yield 0.05
    else:
        raise RuntimeError("the views did not come to rest")
    # The last redraws: of the final picture, and of the engine's anti-aliasing.
    for _ in range(20):
        draws = views.counters["draws"]
        yield 0.2
        if views.counters["draws"] == draws:
            break


def failures():
    views = module()
    return [v.failure for v in views._views.values() if v.failure]


def timed(name, steps):
    started = time.perf_counter()
    yield from steps
    result["seconds"][name] = time.perf_counter() - started


def frames_like_f12():
    """The eraser's outline in the viewport and in F12, frame by frame."""
    scene = bpy.context.scene
    (area,) = areas()
    capture = sys.modules[f"{NAME}.viewport.capture"]
    plainly = capture._plainly

    def watched(space, preferences):
        # EEVEE draws next.
        if space.shading.type == "MATERIAL":
            evaluated = bpy.context.view_layer.depsgraph.scene_eval
            result["face_samples"] = evaluated.eevee.taa_samples
        return plainly(space, preferences)

    capture._plainly = watched
    for kind in ("SOLID", "MATERIAL"):
        flat_view(area, kind)
        for frame in FRAMES if kind == "SOLID" else FRAMES[1:2]:
            scene.frame_set(frame)
            yield from rest()
            picture = screenshot(f"viewport_{kind.lower()}_{frame}", area)
            for _ in range(REST_SECONDS):
                # EEVEE compiles its shaders first; until then the desk beside the glass is grey.
                desk = picture[picture.shape[0] // 5, picture.shape[1] // 8]
                if desk[0] > desk[2] + 0.1:
                    break
                yield 1.0
                picture = screenshot(f"viewport_{kind.lower()}_{frame}", area)
            np.save(FOLDER / f"{kind}_{frame}.npy", picture)
        result.setdefault("capture_depths", {})[kind] = capture_depths()
        result.setdefault("samples", {})[kind] = samples_of_pixels()
    capture._plainly = plainly
    result["rounds"] = module().ROUNDS
    result["frame"] = camera_frame(area)


def moved_camera():
    """What is drawn once the camera has moved in Material Preview, until the picture is final."""
    (area,) = areas()
    flat_view(area, "MATERIAL")
    yield from rest()
    views, scene = module(), bpy.context.scene
    faces, early = views.counters["faces"], False
    scene.camera.location.x += STEP[0]
    yield 0.1
    started = time.perf_counter()
    while not views.at_rest() and time.perf_counter() - started < REST_SECONDS:
        for view in views._views.values():
            early = early or (view.painter.divisor == 1 and not view.is_read)
        yield 0.02
    evaluated = bpy.context.view_layer.depsgraph.scene_eval
    result["moved_camera"] = {
        "faces": views.counters["faces"] - faces,
        "early": early,
        "samples": [evaluated.eevee.taa_samples, scene.eevee.taa_samples],
    }
    scene.camera.location.x += STEP[1]


def reads():
    """How often the direct picture is read in Solid: as the camera moves twice, and after that."""
    (area,) = areas()
    flat_view(area, "SOLID")
    yield from rest()
    direct = sys.modules[f"{NAME}.viewport.paint"].Direct
    read, count = direct.read, 0

    def counted(*arguments):
        nonlocal count
        count += 1
        return read(*arguments)

    direct.read = counted
    for step in STEP:
        bpy.context.scene.camera.location.x += step
        redraw(area)
    moving, count = count, 0
    yield from rest()
    direct.read = read
    result["reads"] = [moving, count, bpy.context.preferences.system.viewport_aa]


def lost_redraw():
    """Whether a view comes to rest that waits for a redraw which does not come, or has no timer."""
    (area,) = areas()
    flat_view(area, "SOLID")
    yield from rest()
    views = module()
    (view,) = views._views.values()
    for name, lose in (("redraw", views._ask_for_rest), ("timer", area.tag_redraw)):
        view.stage, view.final, view.waits = views.MOVING, False, name == "redraw"
        lose()
        for _ in range(MANY):
            yield 0.25
            if views.at_rest():
                break
        result.setdefault("lost", {})[name] = views.at_rest()


def playing():
    """Faces of captures that are drawn while the eraser moves in an animation, and afterwards."""
    (area,) = areas()
    frame = bpy.context.scene.frame_current
    for kind in ("MATERIAL", "SOLID"):
        flat_view(area, kind)
        yield from rest()
        faces = [module().counters["faces"]]
        if kind == "MATERIAL":
            (view,) = module()._views.values()
            view.captures.seconds = SLOW_FACE * view.captures._samples
        with override(area):
            bpy.ops.screen.animation_play()
        for _ in range(MANY):
            yield 0.25
            if module().counters["faces"] > faces[0]:
                break
        faces.append(module().counters["faces"])
        with override(area):
            bpy.ops.screen.animation_cancel(restore_frame=False)
        yield from rest()
        faces.append(module().counters["faces"])
        result.setdefault("played_faces", {})[kind] = np.diff(faces).tolist()
        if kind == "MATERIAL":
            # The engine shows a sample that nobody waited for any more.
            view.painter.direct.lines += 1.0
            redraw(area)
            result["late"] = [view.final]
            yield from rest()
            result["late"] += [view.final, view.failure]
    bpy.context.scene.frame_set(frame)
    yield from rest()


def rendered_by_cycles():
    """Captures of a view that Cycles draws: their colours and depths, and what it costs Cycles."""
    import cycles

    (area,) = areas()
    scene, engine = bpy.context.scene, bpy.context.scene.render.engine
    capture = sys.modules[f"{NAME}.viewport.capture"]
    scene.render.engine, scene.cycles.preview_samples = "CYCLES", 1
    # Whichever scene's engine changes, all views begin anew, and own scenes follow the user's.
    for _ in range(MANY):
        yield 0.25
        if any(s.render.engine == "CYCLES" for s in bpy.data.scenes if s != scene):
            break
    create, begun = cycles.engine.create, []
    cycles.engine.create = lambda *given, **named: (begun.append(1), create(*given, **named))[1]
    flat_view(area, "RENDERED")
    before, traces = settings_of_views(), module().counters["traces"]
    (view,) = [v for v in module()._views.values() if v.captures]
    for _ in range(REST_SECONDS):
        yield 0.1
        if view.is_threaded and not view.captures.left:
            break
    traces = module().counters["traces"] - traces
    yield from rest()
    captures = view.captures
    target = gpu.types.GPUFrameBuffer(color_slots=[captures.textures[0]])
    with target.bind():
        size = capture.FACES * captures.side, captures.side
        colours = np.asarray(target.read_color(0, 0, *size, 3, 0, "FLOAT"))
    result["cycles"] = {
        "captured": float(colours.mean()),
        "depths": capture_depths(),
        "begun": len(begun),
        "traces": traces,
        "as_before": settings_of_views() == before,
    }
    # Nothing can be drawn where no view is hidden.
    hidden, capture._hidden_space = capture._hidden_space, lambda: None
    captures.outdate()
    faces, view.stamp = module().counters["faces"], ()
    area.tag_redraw()
    yield from rest()
    result["cycles"]["in_vain"] = module().counters["faces"] - faces
    result["cycles"]["lines"] = [view.line()]
    capture._hidden_space = hidden
    area.tag_redraw()
    yield from rest()
    result["cycles"]["lines"].append(view.line())
    result["cycles"]["in_time"] = module().counters["faces"] - faces
    cycles.engine.create, scene.render.engine = create, engine
    flat_view(area, "SOLID")
    yield from rest()


def settings_of_views():
    """Shading and overlays of every 3D view that the file has, shown or not."""
    return [
        [repr(getattr(part, name)) for name in dir(part) if name.startswith(("show_", "type"))]
        for screen in bpy.data.screens
        for area in screen.areas
        for space in area.spaces
        if space.type == "VIEW_3D"
        for part in (space, space.shading, space.overlay)
    ]


def samples_of_pixels():
    """How many pixels of the final picture have how many samples, of those that have any."""
    (view,) = [v for v in module()._views.values() if v.painter]
    layer = view.painter._used
    width, height = layer.size
    with layer.target.bind():
        read = layer.target.read_color(0, 0, width, height, 4, 1, "FLOAT")
    counts = np.asarray(read).reshape(-1, 4)[:, 1]
    numbers, pixels = np.unique(counts[counts > 0.0], return_counts=True)
    return dict(zip(numbers.tolist(), pixels.tolist(), strict=True))


def capture_depths():
    """Part of directions in which a capture is not as far as a ray cast tells, within 3 %."""
    capture = sys.modules[f"{NAME}.viewport.capture"]
    (view,) = [v for v in module()._views.values() if v.captures]
    captures, frame = view.captures, view.model.frame
    side, texture = captures.side, captures.textures[1]
    target = gpu.types.GPUFrameBuffer(color_slots=[texture])
    with target.bind():
        size = texture.width, texture.height
        read = np.asarray(target.read_color(0, 0, *size, 1, 0, "FLOAT")).reshape(size[::-1])
    wrong = []
    depsgraph = bpy.context.view_layer.depsgraph
    for face in range(capture.FACES):
        right, up, forward = capture.axes(face)
        for x, y in np.ndindex(7, 7):
            # Off the middle of the face, and off lines that scenes like to have there.
            x, y = (int((n + 0.6) / 7 * side) for n in (x, y))
            along = forward + (2 * (x + 0.5) / side - 1) * right + (2 * (y + 0.5) / side - 1) * up
            hit, place, *_ = bpy.context.scene.ray_cast(depsgraph, captures.centres[0], along)
            shown = abs(read[y, face * side + x]) * frame.unit
            if hit:
                expected = (np.array(place) - captures.centres[0]) @ forward
                wrong.append(abs(shown - expected) > 0.03 * expected)
            else:
                wrong.append(shown < FAR_OFF)
    return float(np.mean(wrong))


@contextmanager
def unsmoothed():
    """No anti-aliasing, for pictures that are compared pixel by pixel.

    Each screenshot is read as an image, and Blender then begins with its first sample again. On a
    busy machine the next screenshot comes before the last sample.
    """
    preferences = bpy.context.preferences
    preferences.use_preferences_save = False
    before = preferences.system.viewport_aa
    preferences.system.viewport_aa = "OFF"
    yield
    preferences.system.viewport_aa = before


def lines():
    """How many pixels show more in the view if overlays are on: nothing is selected."""
    (area,) = areas()
    space = area.spaces.active
    flat_view(area, "SOLID")
    result["lines"] = yield from pixels_of_overlays(area, "viewport_lines")
    matrices, clip_end = space.region_3d, space.clip_end
    # Overlays draw lines nearer by a part of the depth that a parallel view has room for.
    space.clip_end = 20_000.0
    matrices.view_perspective = "ORTHO"
    matrices.view_location, matrices.view_distance = (0.0, 0.0, 0.05), 0.5
    matrices.view_rotation = Quaternion((1, 0, 0), 1.3)
    result["parallel_lines"] = yield from pixels_of_overlays(area, "viewport_parallel_lines")
    space.clip_end = clip_end
    flat_view(area, "SOLID")


def pixels_of_overlays(area, name):
    """How many pixels differ, within the camera's frame, with overlays and without."""
    pictures = []
    with unsmoothed():
        for on in (False, True):
            area.spaces.active.overlay.show_overlays = on
            yield from rest()
            pictures.append(screenshot(f"{name}_{on}", area))
    off = np.abs(pictures[0] - pictures[1]).max(axis=2) > SEEN_STEP
    x0, y0, x1, y1 = (int(v) for v in result["frame"])
    return int(off[y0 + 2 : y1 - 2, x0 + 2 : x1 - 2].sum())


def clear():
    """How many pixels of a view differ with a glass of ior 1 from those without any glass."""
    (area,) = areas()
    flat_view(area, "SOLID")
    area.spaces.active.overlay.show_overlays = True
    inputs = sys.modules[f"{NAME}.scene.read.modifier_inputs"]
    glass = bpy.data.objects["Glass"]
    before = inputs.read_input(glass.modifiers[0], "IOR")
    inputs.write_input(glass.modifiers[0], "IOR", 1.0)
    result["clear"] = yield from pixels_of_glass(area, "viewport_clear")
    inputs.write_input(glass.modifiers[0], "IOR", before)
    flat_view(area, "SOLID")


def from_below():
    """How many pixels show a glass that stands on a desk, from below the desk."""
    (area,) = areas()
    flat_view(area, "SOLID")
    matrices = area.spaces.active.region_3d
    matrices.view_perspective = "PERSP"
    matrices.view_location = bpy.data.objects["Glass"].location
    matrices.view_distance = 0.3
    matrices.view_rotation = Quaternion((1, 0, 0), 2.2)
    result["below"] = yield from pixels_of_glass(area, "viewport_below")
    flat_view(area, "SOLID")


def pixels_of_glass(area, name):
    """How many pixels of a view differ with the glass and without."""
    glass = bpy.data.objects["Glass"]
    with unsmoothed():
        yield from rest()
        shown = yield from settled(name, area)
        glass.hide_set(True)
        hidden = yield from settled(f"{name}_no_glass", area)
    glass.hide_set(False)
    return int((np.abs(shown - hidden).max(axis=2) > SEEN_STEP).sum())


def instances():
    """How many pixels differ where an instance of the glass stands for it, also once it moved.

    The glass is in a collection that the view layer excludes, as what is instanced often is; at
    last it stands elsewhere in the view layer.
    """
    (area,) = areas()
    flat_view(area, "SOLID")
    area.spaces.active.overlay.show_overlays = True
    scene, layer = bpy.context.scene, bpy.context.view_layer
    glass, by = bpy.data.objects["Glass"], Vector((0.02, 0.0, 0.0))
    homes = list(glass.users_collection)
    away, empty = bpy.data.collections.new("Away"), bpy.data.objects.new("Instance", None)
    pictures = []
    with unsmoothed():
        for number in range(2):
            glass.delta_location = number * by
            yield from rest()
            pictures.append((yield from settled(f"viewport_itself_{number}", area)))
        glass.delta_location = (0.0, 0.0, 0.0)
        for home in homes:
            home.objects.unlink(glass)
        away.objects.link(glass)
        scene.collection.children.link(away)
        layer.layer_collection.children[away.name].exclude = True
        empty.instance_type, empty.instance_collection = "COLLECTION", away
        empty.empty_display_size = 0.0
        scene.collection.objects.link(empty)
        for number, picture in enumerate(pictures):
            empty.location = number * by
            yield from rest()
            shown = yield from settled(f"viewport_instance_{number}", area)
            off = np.abs(shown - picture).max(axis=2) > SEEN_STEP
            result.setdefault("instances", []).append(int(off.sum()))
        # The glass itself stands in the view layer too, behind the eye.
        layer.layer_collection.children[away.name].exclude = False
        glass.delta_location, empty.location = (0.0, -2.0, 0.0), (0.0, 2.0, 0.0)
        yield from rest()
        shown = yield from settled("viewport_instance_beside", area)
        off = np.abs(shown - pictures[0]).max(axis=2) > SEEN_STEP
        result["instance_beside"] = int(off.sum())
        glass.delta_location = (0.0, 0.0, 0.0)
    bpy.data.objects.remove(empty)
    for home in homes:
        home.objects.link(glass)
    bpy.data.collections.remove(away)
    flat_view(area, "SOLID")
    yield from rest()


def stillness():
    """Whether draws and operations come to an end while nothing happens."""
    views = module()
    result["still"] = False
    for _ in range(20):
        before = dict(views.counters)
        yield 1.5
        if before == dict(views.counters):
            result["still"] = True
            break


def orbit():
    (area,) = areas()
    matrices = area.spaces.active.region_3d
    matrices.view_perspective = "PERSP"
    matrices.view_location, matrices.view_distance = (0.0, 0.0, 0.05), 0.5
    for step in range(6):
        turn = Quaternion((0, 0, 1), 0.2 * step) @ Quaternion((1, 0, 0), 1.3)
        matrices.view_rotation = turn
        area.tag_redraw()
        yield 0.15
    screenshot("viewport_orbit", area)
    matrices.view_perspective = "ORTHO"
    yield from rest()
    screenshot("viewport_ortho", area)
    area.spaces.active.region_3d.view_perspective = "CAMERA"


def undo_and_redo():
    (area,) = areas()
    with override(area):
        bpy.ops.ed.undo_push(message="start")
        for step in range(UNDOS):
            bpy.data.objects["Eraser"].delta_location.x += 0.01 / UNDOS
            bpy.ops.ed.undo_push(message=f"step {step}")
    for operator in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        for _ in range(UNDOS):
            with override(area):
                operator()
            yield 0.05
    result["moved"] = bpy.data.objects["Eraser"].delta_location.x
    yield from rest()
    result["edges_after_undo"] = faces_of_glass()


def faces_of_glass():
    glass = bpy.data.objects["Glass"]
    return len(glass.evaluated_get(bpy.context.view_layer.depsgraph).data.polygons)


def two_views():
    (area,) = areas()
    views = module()
    with override(area):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    yield 1.0
    first, second = areas()
    shown = [views.is_shown(a.spaces.active) for a in (first, second)]
    result["after_split"] = sorted(shown)
    for one in (first, second):
        if not views.is_shown(one.spaces.active):
            switch(one, True)
        flat_view(one, "SOLID")
    second.spaces.active.region_3d.view_perspective = "PERSP"
    yield from rest()
    result["views"] = len([v for v in views._views.values() if v.final])
    screenshot("viewport_two", first)
    other = first.spaces.active
    switch(second, False)
    yield 0.5
    result["one_left"] = [views.is_shown(other), len(views._handles)]
    with override(second):
        bpy.ops.screen.area_close()
    yield 0.5


def quad_view():
    """Four regions of one area, three of them along the axes and without perspective."""
    (area,) = areas()
    views = module()
    with override(area):
        bpy.ops.screen.region_quadview()
    yield 1.0
    yield from rest()
    regions = [r.as_pointer() for r in area.regions if r.type == "WINDOW"]
    shown = [views._views.get(pointer) for pointer in regions]
    result["quad"] = [
        len(regions),
        sum(v is not None and v.final and v.painter.pixels > 0 for v in shown),
    ]
    subprocess.run(["import", "-window", "root", FOLDER / "viewport_quad.png"], check=True)
    with override(area):
        bpy.ops.screen.region_quadview()
    yield from rest()


def two_windows():
    """A second window, which shows another scene through a glass of its own."""
    (area,) = areas()
    views, manager = module(), bpy.context.window_manager
    first = manager.windows[0].scene
    with override(area):
        bpy.ops.scene.new(type="FULL_COPY")
        other = manager.windows[0].scene
        manager.windows[0].scene = first
        # A main window: one that is another's child shows that one's scene.
        bpy.ops.wm.window_new_main()
    second = manager.windows[-1]
    second.scene = other
    moved = next(o for o in other.objects if o.name.startswith("Glass"))
    moved.location.x += 0.01
    yield 1.0
    found = [a for a in second.screen.areas if a.type == "VIEW_3D"]
    for one in found:
        region = next(r for r in one.regions if r.type == "WINDOW")
        one.spaces.active.region_3d.view_perspective = "CAMERA"
        with bpy.context.temp_override(window=second, area=one, region=region):
            manager.refractive_glass_overlay = True
    yield from rest()
    seen = {v.model.key[0]: v.final and v.painter.pixels > 0 for v in views._views.values()}
    result["scenes"] = [len(found), seen.get(first.session_uid), seen.get(other.session_uid)]
    subprocess.run(["import", "-window", "root", FOLDER / "viewport_windows.png"], check=True)
    # Its screen outlives the window, and so would what was switched on in it.
    for one in found:
        views.show(one.spaces.active, False)
    with bpy.context.temp_override(window=second):
        bpy.ops.wm.window_close()
    yield 0.5
    bpy.data.scenes.remove(other)
    yield from rest()


def memory():
    """GPU objects that redraws make, and how many of them are still held at rest, by motion."""
    (area,) = areas()
    scene, views = bpy.context.scene, module()
    made = []
    kinds = {n: getattr(gpu.types, n) for n in ("GPUTexture", "GPUFrameBuffer", "GPUUniformBuf")}

    def counted(kind):
        def make(*arguments, **named):
            made.append(kind(*arguments, **named))
            return made[-1]

        return make

    def references(things):
        return [sys.getrefcount(thing) for thing in things]

    (own,) = references([object()])
    camera, eraser = scene.camera, bpy.data.objects["Eraser"]
    motions = {"still": None, "eye": (camera, "location"), "object": (eraser, "delta_location")}
    for name, moved in motions.items():
        yield from rest()
        made.clear()
        for kind, value in kinds.items():
            setattr(gpu.types, kind, counted(value))
        draws = views.counters["draws"]
        for k in range(REDRAWS):
            if moved is not None:
                getattr(*moved).x += STEP[k % 2]
            redraw(area)
        drawn = views.counters["draws"] - draws
        for kind, value in kinds.items():
            setattr(gpu.types, kind, value)
        yield from rest()
        gc.collect()
        held = sum(count > own for count in references(made))
        result.setdefault("memory", {})[name] = [drawn, len(made), held]
    made.clear()


def saved_file():
    """A file holds the glass whole, whatever a view shows."""
    path = FOLDER / "saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    result["faces_while_shown"] = faces_of_glass()
    with bpy.data.libraries.load(str(path)) as (available, wanted):
        wanted.objects = [n for n in available.objects if n == "Glass"]
    loaded = wanted.objects[0]
    inputs = sys.modules[f"{NAME}.scene.read.modifier_inputs"]
    result["marked_in_file"] = inputs.read_input(loaded.modifiers[0], "Edges in Viewport")
    bpy.data.objects.remove(loaded)


def off():
    views = module()
    for area in areas():
        if views.is_shown(area.spaces.active):
            switch(area, False)
    yield 1.0
    result["off"] = [len(views._handles), len(views._views), faces_of_glass()]


def other_files():
    views = module()
    for _ in range(2):
        bpy.ops.wm.open_mainfile(filepath=str(SCENE))
        yield 1.0
        result.setdefault("after_load", []).append(len(views._handles))
        (area,) = areas()
        area.spaces.active.shading.type = "SOLID"
        switch(area, True)
        yield 1.5
        bpy.ops.wm.read_homefile(use_empty=False)
        yield 1.0
    (area,) = areas()
    switch(area, True)
    yield 1.0
    switch(area, False)


def steps():
    """Each ``yield`` gives Blender that many seconds to draw and to run its timers."""
    yield 1.0
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    yield 1.0
    views = module()
    result["handles_before"] = len(views._handles)
    (area,) = areas()
    flat_view(area, "SOLID")
    switch(area, True)
    parts = (
        # In Material Preview at one go: each change of shading costs EEVEE's samples.
        frames_like_f12,
        moved_camera,
        playing,
        reads,
        lost_redraw,
        rendered_by_cycles,
        lines,
        clear,
        from_below,
        instances,
        stillness,
        memory,
        orbit,
        undo_and_redo,
        two_views,
        quad_view,
        two_windows,
    )
    for part in parts:
        yield from timed(part.__name__, part())
        result.setdefault("failures", []).extend(failures())
    saved_file()
    yield from timed("off", off())
    yield from timed("other_files", other_files())


walk(steps(), result, FOLDER, first=1.0)
