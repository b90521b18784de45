# SPDX-License-Identifier: GPL-3.0-or-later
"""Classes that Blender may still hold when the extension is disabled, and that stay till then.

Blender frees an operator with its class and keeps the window's handler without one until the next
event. What is drawn meanwhile, the status bar for one, may crash on it. So the class stays until
the operator has ended, which it does by itself.

While an engine reads a scene, Blender lays panels out but does not draw them. The buttons that it
laid out wait for the next time, which may come long after the render, and that crashes where the
panel's class has gone (5.2.2). So panels stay until no render goes on and all areas were drawn
since, and show nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

LOOK_SECONDS = 0.1
"""Between two looks whether a class is held, and for all areas to be drawn once."""

_wanted: set[type] = set()


class StayingPanel:
    """Panels: they are shown where they suit, but not once the extension was disabled."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls in _wanted and cls.suits(context)

    @classmethod
    def suits(cls, context: bpy.types.Context) -> bool:
        """Whether there is something to show."""
        return True


def names(window: bpy.types.Window) -> set[str]:
    """Class names of the operators that go on in a window."""
    # None stands for one whose class was unregistered, of another extension's for one.
    return {o.bl_idname for o in window.modal_operators if o is not None}


def register_class(kind: type) -> None:
    """Register the class of an operator or a panel, if it is not registered still."""
    _wanted.add(kind)
    if not kind.is_registered:
        bpy.utils.register_class(kind)


def unregister_class(kind: type) -> None:
    """Unregister the class: now, or once Blender does not hold it any more."""
    _wanted.discard(kind)
    may_be_laid_out = issubclass(kind, bpy.types.Panel) and not bpy.app.background
    if not may_be_laid_out and not _is_held(kind):
        bpy.utils.unregister_class(kind)
        return
    bpy.app.timers.register(_retiring(kind), first_interval=LOOK_SECONDS, persistent=True)


def _retiring(kind: type) -> Callable[[], float | None]:
    """A timer that unregisters a class once it is not held and all areas were drawn since."""
    is_drawn = False

    def look() -> float | None:
        nonlocal is_drawn
        if kind in _wanted or not kind.is_registered:
            return None
        if _is_held(kind):
            is_drawn = False
            return LOOK_SECONDS
        if is_drawn:
            # Nothing that was laid out of the class is left.
            bpy.utils.unregister_class(kind)
            return None
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                area.tag_redraw()
        is_drawn = True
        return LOOK_SECONDS

    return look


def _is_held(kind: type) -> bool:
    if issubclass(kind, bpy.types.Panel):
        return bpy.app.is_job_running("RENDER")
    windows = bpy.context.window_manager.windows
    return any(kind.__name__ in names(window) for window in windows)
