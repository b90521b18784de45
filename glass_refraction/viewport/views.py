# SPDX-License-Identifier: GPL-3.0-or-later
"""Which 3D views show the refracted picture, and when it is made anew.

A redraw follows one ray for each pixel of a glass, or for each few while that would take long. Once
nothing has changed for a moment a timer has the surroundings captured, as far as they are out of
date, and adds rays until edges are smooth; each of its steps is short. While no view asks, no draw
handler is registered. Views are known by pointer: nothing of Blender's is kept from one call to the
next.
"""

from __future__ import annotations

import math
import time
import traceback
from collections import Counter
from typing import TYPE_CHECKING

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..scene.changes import generation, is_echo
from ..scene.read.glasses import instanced_glasses
from ..scene.read.modifier_inputs import glass_modifier, has_input, read_input, write_input
from . import news, shaders
from .eye import overlay_nearer, view_eye
from .jobs import (
    amends_depths,
    draws_off_screen,
    holds_data,
    is_compiling,
    samples_of_engine,
)
from .lamps import Lamps
from .model import Model

if TYPE_CHECKING:
    from .contexts import Home
    from .displaced import Displaced

MOVING, FIRST, MORE = range(3)
"""Which picture is drawn: of what moves, or at rest its first sample or further ones at edges."""

MOVING_LAYER, LISTED_LAYER = 0, 3
"""Numbers of the painter's layers for what moves and for further samples of some pixels; those
between them are for views at rest."""
REST_SECONDS = 0.15
"""Since the last change: then a view counts as at rest."""
HOLD_SECONDS = 0.25
"""For which faces of captures may be drawn one after the other."""
SLICE_SECONDS = 0.05
"""Of work at rest, between which Blender sees to the user."""
EARLY_SECONDS = 0.15
"""The same while the engine refines what it shows: between two slices it draws, for longer."""
REDRAW_SECONDS = 0.02
"""Between looks whether a redraw that was asked for has come."""
QUIET = 3
"""Looks without a redraw between them, after which an engine has no sample left to show: it asks
for the next one as it shows one."""
PLAYING_SECONDS = 0.5
"""Between looks whether an animation still plays."""
ROUNDS = (3, 3)
"""Further samples of a pixel, at rest: of those at edges, then of those of them whose samples
differ. With two in the first round thin edges were missed. Where colours are followed each on its
own there is one round of as many, see `_rounds`."""
ROUGH_ROUNDS = (6, 15)
"""Where a glass is rough there are more: each sample meets other facets. Colours take turns."""
PLACES = np.array(((0, 0), (1, 3), (2, -1), (-3, -2), (-1, -3), (-2, 1), (3, 2))) / 7.0
"""Of a pixel's samples, from its middle, in pixels: no two share a row or a column. After each
round their mean is the middle, as that of two is with three between them."""
WAYS, WAYS_MORE, WAYS_MOVING = 5, 3, 4
"""Ways of a ray that are followed to their end: at rest in the first sample, in further ones, and
while something moves."""
SHARE_OF_REDRAW, SHARE_OF_ENGINE = 0.8, 0.2
"""A moving picture may take this part of the time that the view's redraw takes without it, in Solid
shading and where an engine draws for longer."""
MOVING_SECONDS = 0.1
"""That a moving picture may take at most: Blender's window stands still meanwhile."""
MOST_PIXELS, PIXELS_STEP = 8.0, 0.25
"""A side, of which a moving picture has one sample at least, and by how much that may change: for
each a picture of its own is made."""
LEAST_PIXELS = 700
"""Of a slice of a sample: fewer tell nothing of the speed."""
STRIP_PIXELS = 2000
"""Of a strip at most in the first sample; later ones are such that the slowest strip of the last
sample would have been quick: some take much longer than those before."""
MOST_GROWTH = 4.0
"""Of a strip over the one before."""
LEAST_SECONDS = 1e-5
QUICK_SECONDS = 0.012
"""A face of a capture that takes no longer is drawn while things move, too."""
SHARE_OF_FACE = 0.25
"""Of the time while an animation plays, which faces of captures take at most: after a redraw one is
drawn, in haste, once that share of the time since the last one is enough for it."""
MOST_AWAY = 20
"""Timers in a row that may find the context of another window."""
FAR_TARGET = 100.0
"""Reaches of a glass to where its close picture looks if nothing stands there."""
SETTLED = 2
"""Redraws in a row without a material being compiled, after which an engine shows no stand-ins.
What was compiled is taken up between redraws: the first one may still have shown some."""
EDGES = "Edges in Viewport"
BLIND = "By Cycles the glasses here show only what this view sees; Material Preview shows all"
LINE_SIZE, LINE_HEIGHT = 12.0, 24.0
"""Of the line of text: its size, and how high it stands in the middle, pixels. To the left of it is
Blender's panel of the last operation."""
UNREFINED = "Edges become smooth with the engine's last sample"

counters: Counter[str] = Counter()
"""Since start: ``draws`` of views that ask, ``traces`` of a sample, ``faces`` of captures,
``rests`` (final pictures), ``milliseconds`` of Python in redraws."""


class _View:
    """What is kept for one region."""

    def __init__(self) -> None:
        self.model = Model()
        self.lamps = Lamps()
        self.home: Home | None = None
        """The context in which timers work for it."""
        self.away = 0
        """Timers in a row that found another."""
        self.painter = None
        self.captures = None
        self.displaced: Displaced | None = None
        self.framebuffer = None
        self.space = 0
        self.failure = ""
        self.problems: list[str] = []
        self.stamp: tuple = ()
        self.eye = None
        self.backdrop = (0.0, 0.0, 0.0, 0.0)
        self.is_open = False
        """The engine leaves the background to the overlay."""
        self.turned = b""
        self.changed = 0.0
        self.quiet = 0
        """Looks of the timer since the last redraw."""
        self.began = 0.0
        self.is_early = False
        """A whole sample at rest was drawn of what the engine showed before it refined that."""
        self.final = self.waits = False
        """All samples are there; a redraw is due before more can be added."""
        self.is_read = self.is_due = False
        """The direct picture was read after the engine had refined it; the next redraw reads it."""
        self.refinements = 0
        """Redraws since something moved: each shows a sample more of the engine's."""
        self.is_blind = False
        """Nothing can draw captures."""
        self.is_threaded = False
        """The engine draws in threads of its own, for long."""
        self.is_own = False
        """The next redraw is only to show what was drawn."""
        self.settled = 0
        """Redraws since a change or a compiled material, see `SETTLED`."""
        self.stage = MOVING
        self.layer = 1
        self.round = 0
        """Number of the layer at rest that is drawn, and of the round of further samples."""
        self.gpu_seconds = 0.0
        self.spent = (0, 0.0)
        """Pixels and seconds of the sample that is being drawn."""
        self.strip_speed = 0.0
        self.slower, self.slowest = math.inf, [0.0, 0.0]
        """Least samples a second of a strip, of this sample and of the last whole one; of the
        latter for all pixels and for those at edges."""
        self.speed = 0.0
        """Rays a second, as measured; a sample may be of one for each colour."""
        self.plain_seconds = 0.1
        self.faced = 0.0
        """When the last face of a capture was drawn."""
        self.python_ms = 0.0

    def line(self) -> str:
        """What the view is working on; empty if on nothing."""
        if self.failure:
            return self.failure
        if self.model.meshes.waits:
            return self.model.meshes.line
        if self.captures is None or not self.model.is_shown:
            return ""
        if self.is_blind:
            return BLIND
        if self.final or time.perf_counter() < self.changed + REST_SECONDS:
            # Nothing is worked on while things move: a line would stand there all the time.
            return ""
        done, total = self.captures.total - self.captures.left, self.captures.total
        if done < total:
            return f"Surroundings of the glasses: {done} of {total}"
        return UNREFINED if self.is_threaded and self.is_early else ""

    @property
    def rounds(self) -> tuple[int, ...]:
        """Further samples of a pixel, at rest."""
        return _rounds(self.painter) + (ROUGH_ROUNDS if self.model.is_rough else ())


_shown: set[int] = set()
_views: dict[int, _View] = {}
_handles: list = []
_marked = False
"""Whether glasses leave their edges only."""


def is_shown(space: bpy.types.SpaceView3D) -> bool:
    """Whether the view shows the refracted picture."""
    return space.as_pointer() in _shown


def show(space: bpy.types.SpaceView3D, on: bool) -> None:
    """Switch the refracted picture of a view on or off. Without a window nothing happens."""
    if bpy.app.background or on == is_shown(space):
        return
    if on:
        _shown.add(space.as_pointer())
    else:
        _shown.discard(space.as_pointer())
        _drop_views()
    _match_handlers()
    mark_glasses()
    _redraw_all()


def status(space: bpy.types.SpaceView3D) -> list[str]:
    """What there is to say of the view: problems, or what it is doing."""
    lines = []
    for view in _views.values():
        if view.space != space.as_pointer():
            continue
        lines += view.problems
        if view.displaced is not None:
            lines += view.displaced.status()
        working = view.line()
        if working:
            lines.append(working)
    return lines


def at_rest() -> bool:
    """Whether every view that asks shows its final picture of the scene as it is."""
    asking = [
        (window, _views.get(region.as_pointer()))
        for window, space, region in _open_regions()
        if is_shown(space)
    ]
    return bool(asking) and all(
        view is not None
        and (view.failure or (view.final and view.model.key[1:2] == (generation(window.scene),)))
        for window, view in asking
    )


def doubt() -> None:
    """Data-blocks may have been replaced (undo, redo): everything is read anew."""
    news.forget()
    for view in _views.values():
        view.model.key = view.stamp = ()
        view.displaced = None
        view.failure = ""


def mark_glasses(on: bool | None = None) -> None:
    """Have every glass leave its edges only, or its faces back; not to be called while drawing.

    Views that show no refracted picture have but these: edges, only while another that does is on
    screen.
    """
    global _marked
    on = _is_any_on_screen() if on is None else on
    _marked = on
    for obj in bpy.data.objects:
        modifier = glass_modifier(obj) if obj.type == "MESH" and obj.is_editable else None
        if modifier is not None and has_input(modifier, EDGES):
            # One that stands in no scene is shown by instances. Without the extension scenes have
            # no settings.
            scenes = obj.users_scene or bpy.data.scenes
            on_here = on and any(scene.refractive_glass.enabled for scene in scenes)
            write_input(modifier, EDGES, on_here)


def _before_view() -> None:
    """PRE_VIEW: the bound framebuffer is the one that the engine is about to draw into."""
    import gpu

    context = bpy.context
    if is_capturing():
        return
    if _marked != _is_any_on_screen():
        _soon(_mark_shown)
    if context.space_data.as_pointer() in _shown:
        view = _views.setdefault(context.region.as_pointer(), _View())
        view.framebuffer = gpu.state.active_framebuffer_get()
        view.began = time.perf_counter()


def is_capturing() -> bool:
    """Whether the engine draws a capture just now: draw handlers are called for it too."""
    from .capture import is_drawing

    return is_drawing()


def _after_pixels() -> None:
    """POST_PIXEL: a line of text that says what the view is working on."""
    import blf

    context = bpy.context
    view = _views.get(context.region.as_pointer())
    if view is None or is_capturing() or context.space_data.as_pointer() not in _shown:
        return
    line = view.line()
    if line:
        scale = context.preferences.system.ui_scale
        blf.size(0, LINE_SIZE * scale)
        blf.color(0, 1.0, 1.0, 1.0, 0.8)
        left = 0.5 * (context.region.width - blf.dimensions(0, line)[0])
        blf.position(0, left, LINE_HEIGHT * scale, 0.0)
        blf.draw(0, line)


def _after_view() -> None:
    """POST_VIEW: the engine and the overlays have drawn; gizmos and text are still to come."""
    context = bpy.context
    if is_capturing():
        return
    view = _views.get(context.region.as_pointer())
    if view is None or view.framebuffer is None or context.space_data.as_pointer() not in _shown:
        return
    if view.failure:
        return
    counters["draws"] += 1
    try:
        _draw(view, context)
    except Exception as error:
        # Once, and not at every redraw: the status tells until the view is switched off and on.
        view.failure = f"{type(error).__name__}: {error}"
        traceback.print_exc()
    view.framebuffer = None


def _draw(view: _View, context: bpy.types.Context) -> None:
    from .capture import Captures
    from .paint import Painter

    space, region, scene = context.space_data, context.region, context.scene
    settings = scene.refractive_glass
    view.space = space.as_pointer()
    view.quiet, view.waits = 0, False
    layer = context.view_layer
    if layer.depsgraph is None or space.shading.type == "WIREFRAME":
        return
    if settings.enabled != view.model.enabled:
        view.model.enabled = settings.enabled
        _unmarked(layer, settings.enabled)
    if not settings.enabled:
        return
    if view.painter is None:
        view.painter, view.captures = Painter(), Captures()
    painter, captures, model = view.painter, view.captures, view.model
    python = -time.thread_time()
    matrices = region.data
    eye = view_eye(
        (region.width, region.height),
        matrices.view_matrix,
        matrices.window_matrix,
        matrices.is_perspective,
    )
    looks = _looks(space, scene.render.engine)
    told = news.news(scene)
    _read_glasses(view, context, told)
    # Much is evaluated anew of which nothing can be seen.
    seen = (told.seen, model.signature())
    _read_surroundings(view, context, told, (seen, looks))
    if model.meshes.waits:
        view.final = False
        _ask_for_rest()
    if not model.is_shown:
        return
    if painter.compile(model.glasses):
        # That took long enough for one redraw: the next one shows the glasses.
        view.waits, view.final = True, False
        _ask_for_rest()
        return
    turned = eye.to_camera[:3, :3].tobytes() if light_comes_along(space.shading) else b""
    if turned != view.turned:
        captures.outdate()
        view.turned = turned
    view.eye, view.backdrop = eye, _backdrop(context)
    view.is_open = space.shading.type == "SOLID"
    python += time.thread_time()
    drawn = (settings.surface, settings.min_weight, _displaced_version(view))
    stamp = (seen, looks, eye.stamp(), *drawn, captures.version)
    moved = stamp[:-1] != view.stamp[:-1]
    if context.screen.is_animation_playing and not captures.left:
        # No rest comes that would show what captures were drawn of it.
        moved = stamp != view.stamp
    view.refinements = 1 if moved or is_compiling() else view.refinements + 1
    samples = samples_of_engine(space, context.preferences) or math.inf
    nearer = overlay_nearer(matrices)
    # Engines with threads of their own begin with an empty picture.
    begins = view.is_threaded and view.stage == MOVING and not view.is_early
    changed = _read(view, moved or begins, samples, amends_depths(scene, space), nearer)
    view.plain_seconds = time.perf_counter() - view.began
    view.gpu_seconds = 0.0
    python -= time.thread_time()
    if changed or stamp != view.stamp:
        view.stamp = stamp
        view.final = False
        if moved:
            view.changed = time.perf_counter()
            # Solid shading's engine has soon refined what it shows.
            view.is_early = view.is_open
        if moved or begins:
            _draw_moving(view, settings)
        # Else the engine only refines what it shows: what is there stays until better is done. What
        # was whole is begun anew: no engine tells that it shows its last sample.
        if moved or view.is_early or view.stage == MORE:
            view.stage = MOVING
    if not view.final:
        _ask_for_rest()
    hosts = painter.direct.wires.hosts
    selected = any(obj.session_uid in hosts for obj in layer.objects.selected)
    painter.show(view.framebuffer, view.backdrop, lines=selected)
    python += time.thread_time() - view.gpu_seconds + painter.direct.python_seconds
    view.python_ms = 1e3 * python
    counters["milliseconds"] += view.python_ms


def _read_glasses(view: _View, context: bpy.types.Context, told: news.News) -> None:
    """Have the view's model be of the scene as it is evaluated now."""
    from .displaced import Displaced

    space, scene, layer = context.space_data, context.scene, context.view_layer
    model = view.model
    displaces = scene.refractive_glass.shading == "DISPLACED"
    if (view.displaced is not None) != displaces:
        view.displaced = Displaced() if displaces else None
        model.key = ()
    key = (scene.session_uid, generation(scene), space.local_view is not None)
    is_new = model.key != key
    if is_compiling() or (is_new and not context.screen.is_animation_playing):
        view.settled = 0
    else:
        view.settled += 1
    if not is_new:
        return
    if model.read(layer, space, told, anew=model.key[::2] != key[::2]):
        view.problems = model.problems + _unmarked(layer, True)
        view.painter.direct.wires.read(model.lines, layer.depsgraph, told)
    if displaces:
        view.displaced.arrange(layer, space, model.glasses)
    model.key = key
    # What is evaluated anew has the engine begin anew, though nothing that is seen moved.
    view.refinements = 0


def _read_surroundings(
    view: _View, context: bpy.types.Context, told: news.News, seen: tuple
) -> None:
    """Say what captures are to show, and read lamps, unless they are of what is ``seen``."""
    from .capture import drawn_as

    space, scene, model = context.space_data, context.scene, view.model
    view.is_threaded = not draws_off_screen(scene, space)
    is_blind = drawn_as(scene, space) is None
    if view.is_blind and not is_blind:
        view.stamp = ()
    view.is_blind = is_blind
    if view.stamp[:2] != seen and model.is_shown:
        view.captures.arrange(model.glasses, seen[1], model.boxes, told.everything)
        names = {place.obj.name for place in model.lines}
        view.lamps.read(context.view_layer, space, model.lamps, names)


def _draw_moving(view: _View, settings) -> None:
    """Draw what moves anew, as finely as there is time for."""
    painter = view.painter
    _describe(view, view.eye)
    divisor = _divisor(view, 1)
    painter.begin(divisor, MOVING_LAYER)
    view.spent, view.slower = (0, 0.0), math.inf
    # Where colours part pixels differ most: first there must be a sample for each.
    each_colour = divisor == _divisor(view, painter.colours) == 1.0
    _sample(view, settings, WAYS_MOVING, each_colour=each_colour)
    painter.use(MOVING_LAYER)


def _read(view: _View, moved: bool, samples: float, amended: bool, nearer: float) -> bool:
    """Read the direct picture if need be; whether it changed, or is still to be read at rest.

    An engine refines what it shows from redraw to redraw. Meanwhile a glance tells whether anything
    changed; all of it is read of what moves, and at rest, which is at once where the engine has
    drawn the last of its ``samples``.
    """
    direct, eye = view.painter.direct, view.eye
    differs = direct.glance(view.framebuffer, eye.size)
    changed = False
    if (
        moved
        or view.refinements == samples
        or view.is_due
        or (view.is_read and (differs or not (view.is_own or direct.is_same(view.framebuffer))))
    ):
        changed = direct.read(view.framebuffer, eye, view.model.frame, amended, nearer)
        # The depths of what an engine refines differ too, where a glance may not see it.
        refined = moved or differs or (changed and not view.is_due)
        # A redraw may have come that the engine did not count: what differs then is its last one.
        view.is_read, view.is_due = view.refinements >= samples or not refined, False
    else:
        direct.python_seconds = 0.0
    view.is_own = False
    return changed or not view.is_read


def _describe(view: _View, eye) -> None:
    model = view.model
    model.look_from(eye)
    if view.displaced is not None:
        view.displaced.look_from(eye, model.frame, model.glasses, model.dispersing())
    view.painter.describe(
        [model.block, *model.bands],
        eye,
        model.frame,
        model.glasses,
        model.clear,
        view.captures.listed(),
        view.captures.glasses,
        model.scene_reach(),
        view.lamps,
    )


def _displaced_version(view: _View) -> int:
    """Grows as displaced things change; -1 where none are drawn."""
    return -1 if view.displaced is None else view.displaced.things.version


def _divisor(view: _View, colours: int) -> float:
    """Pixels a side of the view for one sample of a moving picture, each of so many rays."""
    if view.speed == 0.0:
        return MOST_PIXELS
    share = SHARE_OF_REDRAW if view.is_open else SHARE_OF_ENGINE
    affordable = max(1.0, min(share * view.plain_seconds, MOVING_SECONDS) * view.speed)
    steps = math.ceil(math.sqrt(colours * view.painter.pixels / affordable) / PIXELS_STEP)
    return min(max(PIXELS_STEP * steps, 1.0), MOST_PIXELS)


def _sample(
    view: _View,
    settings,
    ways: int,
    seconds: float | None = None,
    *,
    edges: bool = False,
    each_colour: bool = True,
) -> None:
    """One more sample a pixel, or as much of it as these seconds allow; how fast is measured."""
    from .paint import Way

    painter = view.painter
    way = Way(settings.min_weight, ways, settings.surface == "GLASS", view.backdrop, view.is_open)
    before = 1 + sum(view.rounds[: view.round]) if edges else 0
    number = before + painter.samples
    jitter = _jitter(number)
    pixels = None
    if seconds is not None:
        most = seconds * view.slowest[edges] or STRIP_PIXELS
        pixels = int(max(LEAST_PIXELS, min(seconds * view.strip_speed, most)))
    displaced = _draw_displaced(view, jitter)
    began, mine = time.perf_counter(), time.thread_time()
    drawn = painter.sample(
        number,
        jitter,
        way,
        view.captures.textures,
        pixels,
        each_colour=each_colour,
        displaced=displaced,
    )
    painter.wait()
    spent = max(time.perf_counter() - began, LEAST_SECONDS)
    view.gpu_seconds += time.thread_time() - mine
    view.strip_speed = min(drawn / spent, MOST_GROWTH * view.strip_speed)
    view.slower = min(view.slower, drawn / spent)
    view.spent = (view.spent[0] + drawn, view.spent[1] + spent)
    if painter.is_whole:
        counters["traces"] += 1
        drawn, spent = view.spent
        view.spent = (0, 0.0)
        view.slowest[edges], view.slower = view.slower, math.inf
        # Of a whole sample: strips differ, and samples of edges alone tell nothing.
        if not edges:
            view.speed = drawn / spent * (painter.colours if each_colour else 1)


def _draw_displaced(view: _View, jitter: tuple[float, float]) -> Displaced | None:
    """Draw displaced things for a sample; None where there are none, or not yet."""
    displaced = view.displaced
    # Beside a glass that is a mesh rays show all glasses.
    if displaced is None or not displaced.can_draw or view.painter.has_meshes:
        return None
    mine = time.thread_time()
    displaced.draw(view.painter, jitter, view.captures.textures)
    view.gpu_seconds += time.thread_time() - mine
    return displaced


def _rounds(painter) -> tuple[int, ...]:
    """Further samples of each round. Of one for a colour the others' tell nothing: all come at
    once, two for each colour, whose mean is the pixel's middle, too.
    """
    return ROUNDS if painter.colours == 1 else (sum(ROUNDS),)


def _jitter(number: int) -> tuple[float, float]:
    """Place of a sample from the pixel's middle, pixels."""
    x, y = PLACES[number % len(PLACES)]
    return (float(x), float(y))


def light_comes_along(shading: bpy.types.View3DShading) -> bool:
    """Whether things are lit from where the eye is, so that its turn changes their colours."""
    if shading.type != "SOLID" or shading.light == "FLAT":
        return False
    return shading.light == "MATCAP" or not shading.use_world_space_lighting


_LOOKS = (
    "type",
    "light",
    "color_type",
    "single_color",
    "studio_light",
    "studiolight_intensity",
    "studiolight_rotate_z",
    "studiolight_background_alpha",
    "use_world_space_lighting",
    "use_scene_lights",
    "use_scene_world",
    "use_scene_lights_render",
    "use_scene_world_render",
    "show_shadows",
    "show_cavity",
    "show_object_outline",
    "show_specular_highlight",
    "show_backface_culling",
    "show_xray",
    "background_type",
    "background_color",
)


def _looks(space: bpy.types.SpaceView3D, engine: str) -> tuple:
    """The settings of a view that its captures depend on; the first is the shading's type, the last
    the engine of Rendered shading.
    """
    found = [getattr(space.shading, name, None) for name in _LOOKS]
    found.append(engine if space.shading.type == "RENDERED" else None)
    return tuple(v if isinstance(v, str | int | float | None) else tuple(v) for v in found)


def _unmarked(layer: bpy.types.ViewLayer, wanted: bool) -> list[str]:
    """Have glasses marked that are not as wanted, newly added ones; lines for those that cannot."""
    problems = []
    for obj in dict.fromkeys((*layer.objects, *instanced_glasses(layer))):
        modifier = glass_modifier(obj) if obj.type == "MESH" else None
        if modifier is None:
            continue
        if not has_input(modifier, EDGES) or not obj.is_editable:
            reason = "it is linked, or of an old file"
            problems.append(f'Glass "{obj.name}" hides what is behind it: {reason}')
        elif read_input(modifier, EDGES) != wanted:
            _soon(_mark_shown)
    return problems


def _mark_shown() -> float | None:
    """Timer; nothing is written while a render runs."""
    if holds_data():
        return PLAYING_SECONDS
    mark_glasses()
    return None


def _backdrop(context: bpy.types.Context) -> tuple[float, float, float, float]:
    """The colour behind everything, linear, where one colour tells: in Solid shading."""
    shading = context.space_data.shading
    if shading.background_type == "VIEWPORT":
        colour = shading.background_color
    elif shading.background_type == "WORLD" and context.scene.world is not None:
        colour = context.scene.world.color
    else:
        theme = context.preferences.themes[0].view_3d.space.gradients.high_gradient
        colour = [c / 12.92 if c < 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in theme]
    return (*colour, 0.0)


def _ask_for_rest() -> None:
    if not bpy.app.timers.is_registered(_rest):
        bpy.app.timers.register(_rest, first_interval=REST_SECONDS)


def _rest() -> float | None:
    """Timer: the next piece of work for a view that is at rest; then Blender sees to the user."""
    if holds_data():
        for view in _views.values():
            view.settled = 0
        return PLAYING_SECONDS
    wait = None
    for window, space, region in _open_regions():
        view = _views.get(region.as_pointer())
        if view is None or view.painter is None or view.final or view.failure:
            continue
        waits = view.model.meshes.waits
        if not (view.model.is_shown or waits) or space.as_pointer() not in _shown:
            continue
        if space.shading.type == "WIREFRAME":
            # The next redraw in another shading asks again.
            continue
        quick = view.captures.left and 0.0 < view.captures.seconds < QUICK_SECONDS
        hold = HOLD_SECONDS
        if window.screen.is_animation_playing and not quick:
            affordable = SHARE_OF_FACE * (time.perf_counter() - view.faced)
            has_time = view.captures.left and 0.0 < view.captures.least_seconds < affordable
            if not has_time or view.quiet:
                look = REDRAW_SECONDS if has_time else PLAYING_SECONDS
                wait = look if wait is None else min(wait, look)
                continue
            quick, hold = True, 0.0
        view.quiet += 1
        left = view.changed + REST_SECONDS - time.perf_counter()
        # Captures do not wait for the engine to refine what it shows, nor does a first sample.
        at_once = view.captures.left or waits or not view.is_early or view.is_read
        if not at_once and view.quiet < QUIET:
            left = max(left, REDRAW_SECONDS)
        if left > 0.0 and not quick:
            wait = left if wait is None else min(wait, left)
            continue
        try:
            _work(view, window, space, region, hold)
        except Exception as error:
            view.failure = f"{type(error).__name__}: {error}"
            traceback.print_exc()
            region.tag_redraw()
        if not (view.final or view.failure):
            wait = REDRAW_SECONDS if view.waits or is_compiling() else 0.0
    return wait


def _is_at_home(view: _View, region) -> bool:
    """Whether the context is at hand in which timers began to work for a view.

    If not, another window was drawn last: once the view's own is, its context is at hand again.
    Blender 5.2 crashes where an engine goes on in another.
    """
    from . import contexts

    if not contexts.is_any():
        return False
    view.home = view.home or contexts.Home()
    if view.home.is_current():
        view.away = 0
        return True
    view.away += 1
    if view.away > MOST_AWAY:
        # It was the context of a window that is closed. All begins anew.
        _views.pop(region.as_pointer())
    return False


def _work(view: _View, window, space, region, hold: float) -> None:
    """Faces of captures for ``hold`` seconds, one at least, or a slice of samples."""
    scene, captures = window.scene, view.captures
    if view.waits:
        # Again: a redraw that was asked for may have got lost.
        region.tag_redraw()
        return
    if not _is_at_home(view, region):
        region.tag_redraw()
        view.waits = True
        return
    if view.displaced is not None and view.displaced.things.has_work:
        view.displaced.things.work(window.view_layer, SLICE_SECONDS)
        if not view.displaced.things.has_work:
            view.waits = True
            region.tag_redraw()
        return
    if view.model.meshes.waits:
        if view.model.meshes.grow(SLICE_SECONDS):
            # A redraw reads the glasses anew.
            view.model.key = ()
            view.waits = True
        region.tag_redraw()
        return
    is_playing = window.screen.is_animation_playing
    if not is_playing:
        captures.smooth()
    if not captures.left and view.stage == MOVING:
        # Solid shading's faces are fine enough, and cost less than one of an engine's.
        captures.aim({} if space.shading.type == "SOLID" else _targets(view))
    if captures.left:
        is_late = view.model.key[:2] != (scene.session_uid, generation(scene))
        if is_late and not is_playing:
            # Drawn anew, the view asks again. An animation is always a frame ahead.
            region.tag_redraw()
            view.waits, view.changed = True, time.perf_counter()
            return
        if space.shading.type != "SOLID" and view.settled < SETTLED:
            # What an engine shows yet may be stand-ins, which are no picture to keep.
            region.tag_redraw()
            view.waits = True
            return
        _capture(view, window, space, region, hold)
        if not captures.left:
            # What is shown first is of what the engine shows by now.
            view.is_due, view.waits = not (view.is_read or view.is_early), True
            region.tag_redraw()
        return
    # Threads of an engine's own may take longer than that to show a sample.
    is_quiet = view.quiet >= QUIET and not view.is_threaded
    if not view.is_read and (view.is_early or is_quiet):
        # Of what the engine came to rest at. A sample of what it showed before need not be whole.
        view.is_due = view.waits = view.is_early = True
        region.tag_redraw()
        return
    _add_samples(view, region, scene.refractive_glass)


def _add_samples(view: _View, region, settings) -> None:
    """A slice of samples at rest."""
    painter = view.painter
    painter.direct.find_steps(view.eye, view.model.frame)
    until = time.perf_counter() + (SLICE_SECONDS if view.is_early else EARLY_SECONDS)
    while time.perf_counter() < until and not view.final:
        if view.stage == MOVING:
            _describe(view, view.eye)
            # Into the layer that is not shown.
            view.layer = 3 - view.layer
            painter.begin(1.0, view.layer)
            view.strip_speed = view.speed / painter.colours / MOST_GROWTH
            view.stage = FIRST
        elif view.stage == FIRST:
            _sample(view, settings, WAYS, SLICE_SECONDS)
            if painter.is_whole:
                painter.use(view.layer)
                if not (view.is_early or view.is_read):
                    # To be drawn again of what the engine comes to rest at.
                    view.is_early, view.stage = True, MOVING
                    _show_own(view, region)
                    return
                view.round = 0
                some = painter.begin_edges(LISTED_LAYER, view.layer)
                view.stage, view.final = MORE, not some
                if view.rounds[0] * some > view.plain_seconds * view.slowest[True]:
                    # It takes longer than a redraw until there is more.
                    _show_own(view, region)
        else:
            _sample(view, settings, WAYS_MORE, SLICE_SECONDS, edges=True)
            if painter.is_whole and painter.samples >= view.rounds[view.round]:
                painter.add(LISTED_LAYER)
                view.round += 1
                is_last = view.round == len(view.rounds)
                view.final = is_last or not painter.begin_spread(LISTED_LAYER)
                if not view.final and view.round >= len(_rounds(painter)):
                    # Grain takes long: what there is of it is shown.
                    _show_own(view, region)
    if view.final:
        counters["rests"] += 1
        _show_own(view, region)


def _capture(view: _View, window, space, region, hold: float) -> None:
    """Faces of captures for ``hold`` seconds, one at least."""
    from .capture import drawable

    scene, captures, wires = window.scene, view.captures, view.painter.direct.wires
    turned = view.eye.to_camera[:3, :3] if light_comes_along(space.shading) else None
    is_playing = window.screen.is_animation_playing
    until = time.perf_counter() + hold
    with drawable(scene, space) as drawn_as:
        if drawn_as is None:
            captures.leave()
        view_3d = scene, window.view_layer, drawn_as, region
        while captures.left and not is_compiling():
            captures.draw(view.model.frame, view.model.glasses, view_3d, wires, turned, is_playing)
            counters["faces"] += 1
            view.faced = time.perf_counter()
            # Blender draws all views after it, of which this one's engine shows nothing new.
            view.is_own = True
            if is_compiling():
                view.settled = 0
            if time.perf_counter() + captures.seconds > until:
                break


def _show_own(view: _View, region) -> None:
    """Have a view drawn though its engine has nothing new to show."""
    view.is_own = True
    region.tag_redraw()


def _targets(view: _View) -> dict[int, np.ndarray]:
    """Where close pictures are to look, see `Captures.aim`: ahead of the eye, behind each glass."""
    from .capture import LEAST_SHARE
    from .paint import screen_rect

    found = {}
    for number, glass in enumerate(view.model.glasses[: view.captures.glasses]):
        rect = screen_rect(glass.corners(), view.eye)
        if rect is None or 0.25 * (rect[2] - rect[0]) * (rect[3] - rect[1]) < LEAST_SHARE:
            continue
        middle, reach = glass.middle(), glass.reach()
        along = view.eye.forward if view.eye.is_parallel else middle - view.eye.eye
        along = along / np.linalg.norm(along)
        start = middle + reach * along
        ways = [box.way_from(start, along) for box in view.model.boxes]
        far = max(view.model.scene_reach(), FAR_TARGET * reach)
        found[number] = start + min([*ways, far]) * along
    return found


def _open_regions():
    """(window, space, region) of every 3D view on screen."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield window, area.spaces.active, region


def _is_any_on_screen() -> bool:
    """Whether a view that asks is on screen, not in another workspace alone."""
    return any(is_shown(space) for _, space, _ in _open_regions())


def _drop_views() -> None:
    """Let go of what belongs to views that are closed or no longer ask."""
    open_spaces = {
        space.as_pointer()
        for screen in bpy.data.screens
        for area in screen.areas
        for space in area.spaces
        if space.type == "VIEW_3D"
    }
    _shown.intersection_update(open_spaces)
    for key in [k for k, v in _views.items() if v.space not in _shown]:
        del _views[key]


def _redraw_all() -> None:
    for _, _, region in _open_regions():
        region.tag_redraw()


def _soon(function) -> None:
    """Call from a timer: data may be written neither while drawing nor in undo's handlers."""
    if not bpy.app.timers.is_registered(function):
        bpy.app.timers.register(function, first_interval=0.0)


def _note(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, new_frame: bool) -> None:
    from .things import note_changes

    note_changes(depsgraph)
    news.note(scene, depsgraph, new_frame=new_frame)


@persistent
def _on_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if not is_echo(scene):
        _note(scene, depsgraph, new_frame=False)


@persistent
def _on_frame(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    _note(scene, depsgraph, new_frame=True)


@persistent
def _on_undo(*_) -> None:
    doubt()
    if not bpy.app.background:
        _soon(_mark_shown)


@persistent
def _on_load(*_) -> None:
    """Another file: its views are others, and its glasses may have been saved half hidden."""
    _shown.clear()
    _views.clear()
    _match_handlers()
    mark_glasses()


@persistent
def _on_save_pre(*_) -> None:
    """A file holds the glasses as they are without this view."""
    mark_glasses(False)


@persistent
def _on_save_post(*_) -> None:
    mark_glasses()


_ALWAYS = (("undo_post", _on_undo), ("redo_post", _on_undo), ("load_post", _on_load))
_WHILE_SHOWN = (
    ("depsgraph_update_post", _on_update),
    ("frame_change_post", _on_frame),
    ("save_pre", _on_save_pre),
    ("save_post", _on_save_post),
    ("save_post_fail", _on_save_post),
)


def _match_handlers() -> None:
    """Draw handlers exist while a view asks, and only then."""
    if bool(_shown) == bool(_handles):
        return
    if _shown:
        kind = bpy.types.SpaceView3D
        _handles.append(kind.draw_handler_add(_before_view, (), "WINDOW", "PRE_VIEW"))
        _handles.append(kind.draw_handler_add(_after_view, (), "WINDOW", "POST_VIEW"))
        _handles.append(kind.draw_handler_add(_after_pixels, (), "WINDOW", "POST_PIXEL"))
    else:
        while _handles:
            bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _set_handlers(_WHILE_SHOWN, bool(_shown))


def _set_handlers(table, on: bool) -> None:
    for name, function in table:
        handlers = getattr(bpy.app.handlers, name)
        if on and function not in handlers:
            handlers.append(function)
        elif not on and function in handlers:
            handlers.remove(function)


def register() -> None:
    """Follow undo and file load."""
    _set_handlers(_ALWAYS, True)


def unregister() -> None:
    """Switch every view off, take all handlers and timers out and let go of what is on the GPU."""
    if _shown:
        _shown.clear()
        if holds_data():
            # Works without the extension, too.
            _soon(_mark_shown)
        else:
            mark_glasses()
    _views.clear()
    shaders.kept.clear()
    _match_handlers()
    _set_handlers(_ALWAYS, False)
    if bpy.app.timers.is_registered(_rest):
        bpy.app.timers.unregister(_rest)
