# SPDX-License-Identifier: GPL-3.0-or-later
"""What the extension is at while a render goes on, in the render's view and in the status bar; Esc.

Blender's own progress knows of its engines only: until these begin it stays at 0 %. Esc ends a
render once the handlers in its thread have ended, of which Blender has no way to tell them.
"""

from __future__ import annotations

import textwrap
import time

import blf
import bpy
from bpy.app.handlers import persistent
from bpy.app.translations import pgettext_iface as _iface

from ..scene import progress
from ..scene import update as door
from . import staying

LOOK_SECONDS = 0.25
"""Between two looks at what the render's thread is at."""
_PLACE = (20.0, 20.0)
_SIZE = 13.0
"""Pixels from the lower left corner of an Image Editor, and height of letters, at a scale of 1."""
_LINE, _LETTER = 1.5, 0.6
"""Height of a line and mean width of a letter, in heights of letters."""
_LEAST_LETTERS = 20
_WATCH, _RENDER = "WM_OT_refractive_glass_watch", "RENDER_OT_render"


class _Shown:
    """What is on the screen.

    Attributes
    ----------
    line : the text. doing : what it says goes on. since : when that began.
    handle : of the drawing in Image Editors. is_over : nobody is to watch any more.
    """

    line: str | None = None
    doing: str | None = None
    since: float = 0.0
    handle = None
    is_over: bool = False


_shown = _Shown()


def line(doing: str | None, seconds: float) -> str | None:
    """What users read, after so many seconds of the same."""
    if doing is None:
        return None
    text = _iface("Refractive Glass: {}").format(_iface(doing))
    return text if seconds < 1.0 else f"{text} ({seconds:.0f} s)"


def _look() -> float | None:
    """Timer: show what goes on, until no render does."""
    progress.run_errands()
    doing = progress.doing()
    if doing != _shown.doing:
        _shown.doing, _shown.since = doing, time.monotonic()
    said = line(doing, time.monotonic() - _shown.since)
    if said != _shown.line:
        _show(said)
    if bpy.app.is_job_running("RENDER"):
        _watch_windows()
        return LOOK_SECONDS
    if _shown.line is not None:
        _show(None)
    return None


class WM_OT_refractive_glass_watch(bpy.types.Operator):
    """Have Esc stop what is computed for the picture"""

    bl_idname = "wm.refractive_glass_watch"
    bl_label = "Watch for Esc"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return bpy.app.is_job_running("RENDER")

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        manager = context.window_manager
        self._timer = manager.event_timer_add(LOOK_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # Blender takes Esc for its own renders alike: in any window, with no other key.
        others = event.shift or event.ctrl or event.alt or event.oskey
        if event.type == "ESC" and event.value == "PRESS" and not others:
            progress.ask_to_stop()
        if bpy.app.is_job_running("RENDER") and not _shown.is_over:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return {"FINISHED", "PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        # Blender closes the window. With the render's own it ends the render, and waits for it.
        if _RENDER in staying.names(context.window):
            progress.ask_to_stop()
        context.window_manager.event_timer_remove(self._timer)


def _watch_windows() -> None:
    """Have Esc noticed in every window; a render may have opened one."""
    for window in bpy.context.window_manager.windows:
        if _WATCH not in staying.names(window):
            with bpy.context.temp_override(window=window):
                bpy.ops.wm.refractive_glass_watch("INVOKE_DEFAULT")


def _show(text: str | None) -> None:
    _shown.line = text
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR":
                area.tag_redraw()
        # Child windows, such as the render's, have no status bar.
        if window.parent is None:
            with bpy.context.temp_override(window=window):
                window.workspace.status_text_set(text)


def _draw() -> None:
    """Draw over the render what goes on, or what is wrong with the picture."""
    context = bpy.context
    image = context.space_data.image
    if image is None or image.type != "RENDER_RESULT":
        return
    scale = context.preferences.system.ui_scale
    texts = [_shown.line] if _shown.line else door.memory_of(context.scene).last
    letters = max(_LEAST_LETTERS, int(context.region.width / (scale * _SIZE * _LETTER)))
    lines = [part for text in texts for part in textwrap.wrap(text, letters)]
    blf.size(0, _SIZE * scale)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 1.0)
    for number, text in enumerate(reversed(lines)):
        height = _PLACE[1] + number * _SIZE * _LINE
        blf.position(0, _PLACE[0] * scale, height * scale, 0.0)
        blf.draw(0, text)
    blf.disable(0, blf.SHADOW)


@persistent
def _on_render_init(*_) -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=LOOK_SECONDS, persistent=True)


_register, _unregister = staying.classes((WM_OT_refractive_glass_watch,))


def register() -> None:
    """Have renders tell what the extension is at, heed Esc, and their view tell what is wrong."""
    _shown.is_over = False
    _register()
    bpy.app.handlers.render_init.append(_on_render_init)
    if not bpy.app.background:
        kind = bpy.types.SpaceImageEditor
        _shown.handle = kind.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.app.handlers.render_init.remove(_on_render_init)
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    if _shown.line is not None:
        _show(None)
    if _shown.handle is not None:
        bpy.types.SpaceImageEditor.draw_handler_remove(_shown.handle, "WINDOW")
        _shown.handle = None
    _shown.is_over = True
    _unregister()
