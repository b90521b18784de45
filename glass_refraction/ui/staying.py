# SPDX-License-Identifier: GPL-3.0-or-later
"""Classes and properties that Blender may still hold when the extension is disabled.

They stay registered until it holds them no more, and one timer takes them out then.

- While an engine reads a scene, Blender does not lay regions out anew. What it laid out before may
  be drawn once more when the engine is done, and that crashes where a button's property, operator
  or panel has gone (5.2.2). So all stays until no render goes on and all areas were drawn since.
- A panel stays until all areas were drawn in any case: what a render laid out of it may be left.
- Blender frees an operator with its class and keeps the window's handler without one until the next
  event. What is drawn meanwhile, the status bar for one, may crash on it. So the class stays until
  the operator has ended, which it does by itself.

Panels that stay show nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import bpy

LOOK_SECONDS = 0.1
"""Between two looks whether anything is held, and for all areas to be drawn once."""

_wanted: set[Hashable] = set()
"""Classes, and pairs of a type of Blender's and the name of a property hung on it."""
_hung: dict[tuple[type, str], bpy.types.Property] = {}
"""The properties that were hung."""
_leaving: dict[Hashable, Callable[[], None]] = {}
"""What stays for now, in the order in which it goes, and how."""
_is_drawn = False
"""Whether all areas were told to draw since anything was held."""


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


def classes(kinds: Sequence[type]) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that register classes of operators, panels, menus or settings and undo that."""

    def register() -> None:
        for kind in kinds:
            if _take_back(kind):
                bpy.utils.register_class(kind)

    def unregister() -> None:
        for kind in reversed(kinds):
            _let_go(kind, lambda kind=kind: _remove_class(kind), _is_held(kind))

    return register, unregister


def hang(owner: type, name: str, new: object) -> None:
    """Hang a property, as made by ``bpy.props``, on a type of Blender's."""
    if _take_back((owner, name)):
        setattr(owner, name, new)
        _hung[owner, name] = owner.bl_rna.properties[name]


def take_off(owner: type, name: str) -> None:
    """Undo :func:`hang`."""
    _let_go((owner, name), lambda: _remove_property(owner, name), _renders())


def _remove_class(kind: type) -> None:
    # A newer version of the extension, enabled meanwhile, has put its own in its place.
    if kind.is_registered:
        bpy.utils.unregister_class(kind)


def _remove_property(owner: type, name: str) -> None:
    # As above.
    if _hung.pop((owner, name)) == owner.bl_rna.properties.get(name):
        delattr(owner, name)


def _take_back(key: Hashable) -> bool:
    """Whether what is wanted is to be registered: it is not there any more."""
    _wanted.add(key)
    return _leaving.pop(key, None) is None


def _let_go(key: Hashable, remove: Callable[[], None], is_held: bool) -> None:
    """Take out what is wanted no more, now or once it is not held."""
    global _is_drawn
    _wanted.discard(key)
    if not is_held or bpy.app.background:
        remove()
        return
    _leaving[key], _is_drawn = remove, False
    if not bpy.app.timers.is_registered(_look):
        bpy.app.timers.register(_look, first_interval=LOOK_SECONDS, persistent=True)


def _look() -> float | None:
    """Timer: take out what stays once none of it is held and all areas were drawn since."""
    global _is_drawn
    windows = bpy.context.window_manager.windows
    if _renders() or any(map(_goes_on, _leaving)):
        _is_drawn = False
        return LOOK_SECONDS
    if not _is_drawn:
        for window in windows:
            for area in window.screen.areas:
                area.tag_redraw()
        _is_drawn = True
        return LOOK_SECONDS
    for remove in _leaving.values():
        remove()
    _leaving.clear()
    return None


def _is_held(kind: type) -> bool:
    """Whether Blender may hold a class. Panels it may have laid out long ago."""
    return _renders() or issubclass(kind, bpy.types.Panel) or _goes_on(kind)


def _goes_on(key: Hashable) -> bool:
    """Whether an operator of a class goes on in any window."""
    windows = bpy.context.window_manager.windows
    return any(getattr(key, "__name__", None) in names(window) for window in windows)


def _renders() -> bool:
    return bpy.app.is_job_running("RENDER")
