# SPDX-License-Identifier: GPL-3.0-or-later
"""Which 3D views show the refracted picture, and when it is found anew.

A view is drawn with what can be found at once; 0.2 s after the last change a timer finds the rest,
as exactly as a render, and has the view drawn once more. While no view asks, no draw handler is
registered. Views are known by pointer: nothing of Blender's is kept from one call to the next.
"""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..scene.read.glasses import glass_modifier
from ..scene.read.modifier_inputs import has_input, read_input, write_input
from .eye import view_eye
from .picture import Picture

REST_SECONDS = 0.2
SLICE_SECONDS = 0.05
"""Of work at rest, between which Blender sees to the user."""
EDGES = "Edges in Viewport"

counters: Counter[str] = Counter()
"""Since start: ``draws`` of views that ask, ``rests`` (exact updates by the timer)."""


class _View:
    """What is kept for one region."""

    def __init__(self) -> None:
        self.picture = Picture()
        self.painter = None
        self.framebuffer = None
        self.space = 0
        self.failure = ""
        self._steps: Iterator[None] | None = None

    def refine(self, window: bpy.types.Window, space: bpy.types.SpaceView3D) -> None:
        """One step towards the exact picture."""
        if self._steps is None:
            layer = window.view_layer
            self._steps = self.picture.steps(
                window.scene, layer, layer.depsgraph, self.picture.view, exact=True, space=space
            )
        if next(self._steps, self) is self:
            self._steps = None

    def stop(self) -> None:
        """Something changed: what was being refined is of no use."""
        self._steps = None


_shown: set[int] = set()
_views: dict[int, _View] = {}
_handles: list = []


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
    """What there is to say of the view: problems, or how long the last update took."""
    lines = []
    for view in _views.values():
        if view.space != space.as_pointer():
            continue
        if view.failure:
            lines.append(view.failure)
        lines += view.picture.problems
        if view.picture.panes:
            how = "exact" if view.picture.exact else "following"
            lines.append(f"Last update: {view.picture.milliseconds:.0f} ms, {how}")
    return lines


def doubt() -> None:
    """Data-blocks may have been replaced (undo, redo): what was found is to be compared anew.

    It is arrays alone, under keys that undo keeps, so it may stay.
    """
    for view in _views.values():
        view.picture.doubt()
        view.failure = ""
        view.stop()


def mark_glasses(on: bool | None = None) -> None:
    """Have every glass leave its edges only, or its faces back; not to be called while drawing."""
    on = bool(_shown) if on is None else on
    for obj in bpy.data.objects:
        modifier = glass_modifier(obj) if obj.type == "MESH" and obj.is_editable else None
        if modifier is not None and has_input(modifier, EDGES):
            computed = any(scene.refractive_glass.enabled for scene in obj.users_scene)
            write_input(modifier, EDGES, on and computed)


def _before_view() -> None:
    """PRE_VIEW: the bound framebuffer is the one that the engine is about to draw into."""
    import gpu

    context = bpy.context
    if context.space_data.as_pointer() in _shown:
        view = _views.setdefault(context.region.as_pointer(), _View())
        view.framebuffer = gpu.state.active_framebuffer_get()


def _after_view() -> None:
    """POST_VIEW: the engine and the overlays have drawn; gizmos and text are still to come."""
    context = bpy.context
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
    from .paint import Painter

    space, region, scene = context.space_data, context.region, context.scene
    view.space = space.as_pointer()
    layer = context.view_layer
    if layer.depsgraph is None or space.shading.type == "WIREFRAME":
        return
    if not scene.refractive_glass.enabled:
        view.stop()
        view.picture = Picture()
        _unmarked(layer, False)
        return
    matrices = region.data
    eye = view_eye(
        (region.width, region.height),
        matrices.view_matrix,
        matrices.window_matrix,
        matrices.is_perspective,
    )
    picture = view.picture
    if not picture.matches(scene, eye):
        view.stop()
        picture.update(scene, layer, layer.depsgraph, eye, exact=False, space=space)
        picture.problems += _unmarked(layer, True)
    if not picture.exact:
        _ask_for_rest()
    if view.painter is None:
        view.painter = Painter()
    view.painter.paint(picture, view.framebuffer, _backdrop(context))


def _unmarked(layer: bpy.types.ViewLayer, wanted: bool) -> list[str]:
    """Have glasses marked that are not as wanted, newly added ones; lines for those that cannot."""
    problems = []
    for obj in layer.objects:
        modifier = glass_modifier(obj) if obj.type == "MESH" else None
        if modifier is None:
            continue
        if not has_input(modifier, EDGES) or not obj.is_editable:
            reason = "it is linked, or of an old file"
            problems.append(f'Glass "{obj.name}" hides what is behind it: {reason}')
        elif read_input(modifier, EDGES) != wanted:
            _soon(_mark_shown)
    return problems


def _mark_shown() -> None:
    mark_glasses()


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
    if bpy.app.timers.is_registered(_rest):
        bpy.app.timers.unregister(_rest)
    bpy.app.timers.register(_rest, first_interval=REST_SECONDS)


def _rest() -> float | None:
    """Timer: nothing moved for a while; find what the views show as exactly as a render.

    A slice at a time: whatever the user does comes between, and ends it if it changes something.
    """
    until = time.perf_counter() + SLICE_SECONDS
    for window, space, region in _open_regions():
        view = _views.get(region.as_pointer())
        if view is None or view.picture.view is None or view.picture.exact or view.failure:
            continue
        if window.screen.is_animation_playing:
            return REST_SECONDS
        if not view.picture.matches(window.scene, view.picture.view):
            # Once it is drawn anew, it asks again.
            region.tag_redraw()
            continue
        try:
            while time.perf_counter() < until and not view.picture.exact:
                view.refine(window, space)
        except Exception as error:
            view.failure = f"{type(error).__name__}: {error}"
            traceback.print_exc()
        if view.picture.exact or view.failure:
            counters["rests"] += 1
            region.tag_redraw()
        if time.perf_counter() >= until:
            return SLICE_SECONDS / 10
    return None


def _open_regions():
    """(window, space, region) of every 3D view on screen."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        yield window, area.spaces.active, region


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
    """Switch every view off and take all handlers and timers out."""
    if _shown:
        _shown.clear()
        mark_glasses()
    _views.clear()
    _match_handlers()
    _set_handlers(_ALWAYS, False)
    for timer in (_rest, _mark_shown):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
