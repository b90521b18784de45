# SPDX-License-Identifier: GPL-3.0-or-later
"""Classes of operators that may still go on in a window when the extension is disabled.

Blender frees an operator with its class and keeps the window's handler without one until the next
event. What is drawn meanwhile, the status bar for one, may crash on it. So the class stays until
the operator has ended, which it does by itself.
"""

from __future__ import annotations

from functools import partial

import bpy

LOOK_SECONDS = 0.1
"""Between two looks whether an operator has ended."""

_wanted: set[type[bpy.types.Operator]] = set()


def names(window: bpy.types.Window) -> set[str]:
    """Class names of the operators that go on in a window."""
    # None stands for one whose class was unregistered, of another extension's for one.
    return {o.bl_idname for o in window.modal_operators if o is not None}


def register_class(kind: type[bpy.types.Operator]) -> None:
    """Register an operator's class, if it is not registered still."""
    _wanted.add(kind)
    if not kind.is_registered:
        bpy.utils.register_class(kind)


def unregister_class(kind: type[bpy.types.Operator]) -> None:
    """Unregister an operator's class: now, or once it has ended in all windows."""
    _wanted.discard(kind)
    wait = _retire(kind)
    if wait is not None:
        bpy.app.timers.register(partial(_retire, kind), first_interval=wait, persistent=True)


def _retire(kind: type[bpy.types.Operator]) -> float | None:
    """Timer: see :func:`unregister_class`."""
    if kind in _wanted or not kind.is_registered:
        return None
    if any(kind.__name__ in names(window) for window in bpy.context.window_manager.windows):
        return LOOK_SECONDS
    bpy.utils.unregister_class(kind)
    return None
