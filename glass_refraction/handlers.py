# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes come in here and leave by the one door, ``scene.update``.

Blender reports a change in three ways: ``depsgraph_update_post`` (edits), ``frame_change_post``
(animation, and every frame of a render) and the settings' own ``update=`` callbacks. Data-blocks
may be made neither in the first two nor while a render runs in its own thread, so an edit only asks
for :func:`_prepare`, which a timer runs once changes have come to rest. In background mode no
timer runs; there a render prepares itself in ``render_init``, in the main thread.

Nothing here calls an operator or evaluates a depsgraph: inside a handler that recurses.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial, wraps

import bpy
from bpy.app.handlers import persistent

from .scene import changes, material_link
from .scene import update as door
from .scene.build.own_scenes import find_own_scenes, list_objects, user_scene_of
from .scene.names import REFERENCE, TAG, RefractiveGlassError, own, renew_groups
from .scene.progress import Stopped, ask_to_stop, go_on, tell
from .scene.rays import true
from .scene.read.visibility import any_depsgraph
from .scene.vertices import motion_blur
from .viewport.jobs import holds_data, is_rendering

REST_SECONDS = 0.3
"""Changes come in bursts (a dragged object, a slider): wait for the last one."""
LOADED_SECONDS = 0.05
"""After undo, redo and load nothing stands, and F12 would show the bare mesh: wait no longer than
for the next of keys held down."""

_asked: set[int] = set()
_withdrawn: set[int] = set()
"""Scenes that are to be prepared again once the file is saved."""
_rendering = False
"""Between a render's handlers, whichever thread it runs in."""
_registered = False
_working = threading.RLock()
"""Held by a handler that works in a render's thread."""
_layers: dict[int, str] = {}
"""By a window's address the view layer that it showed last of a scene of the user's."""
_own_rendered = False
"""Whether the render that goes on has come to an own scene."""
LEFT_OUT = (
    "A single view layer was rendered, without the cameras that show the rest of what is seen in "
    "the glass: render all of them (F12)"
)
STOPPED = "The render was ended before what is seen in the glass was computed: render again"


def request_update(scene: bpy.types.Scene | None, seconds: float = REST_SECONDS) -> None:
    """Ask for the scene to be prepared once changes have come to rest."""
    if scene is None or bpy.app.background or own(scene):
        return
    _asked.add(scene.original.session_uid)
    _serve_in(seconds)


def _serve_in(seconds: float) -> None:
    if bpy.app.background:
        return
    if bpy.app.timers.is_registered(_serve):
        bpy.app.timers.unregister(_serve)
    bpy.app.timers.register(_serve, first_interval=seconds)


def leave_own_scenes() -> None:
    """Show a scene of the user's in each window that Blender left with one of the extension's.

    It does when a scene is deleted: it goes on to the next in the list.
    """
    for window in _windows():
        if own(window.scene):
            window.scene = next(iter(_users_scenes()), None) or bpy.data.scenes.new("Scene")
            # As Blender does: the view layer of the same name, else the one for the 3D view.
            layers = window.scene.view_layers
            first = next((layer for layer in layers if not layer.use), layers[0])
            window.view_layer = layers.get(_layers.get(window.as_pointer(), ""), first)


def _windows() -> list[bpy.types.Window]:
    return [window for manager in bpy.data.window_managers for window in manager.windows]


def _users_scenes() -> list[bpy.types.Scene]:
    return [scene for scene in bpy.data.scenes if not own(scene)]


def _serve() -> float | None:
    """Timer: prepare the scenes that asked.

    Nothing is solved here: a render does that for its own frame, and until one starts nobody looks.
    """
    if _is_in_use():
        return REST_SECONDS
    leave_own_scenes()
    for scene in bpy.data.scenes:
        if scene.session_uid in _asked:
            _prepare(scene)
    _asked.clear()
    return None


def _is_in_use() -> bool:
    """Whether a render may hold what was prepared, or a comparison hides the glasses meanwhile."""
    return _renders() or any(own(scene, REFERENCE) for scene in bpy.data.scenes)


def _renders() -> bool:
    """Whether any render goes on. One that began before the extension was enabled counts too."""
    return _rendering or holds_data()


def _prepare(scene: bpy.types.Scene) -> None:
    """Prepare a scene; what is wrong with it ends in its status, for the panel."""
    if scene.library is not None:
        return
    depsgraph = any_depsgraph(scene)
    if depsgraph is None:
        # Nobody looks at it; an undone deletion may have brought it back with what stood for it.
        if not _renders():
            door.withdraw(scene)
        return
    if not _renders():
        # A scene that nobody looks at just now may still hold what was removed from the file.
        depsgraph.update()
    try:
        door.prepare(scene, depsgraph, rendering=_renders())
    except RefractiveGlassError as error:
        door.remove(scene, rendering=_renders())
        door.status(scene).problems = [str(error)]


@persistent
def _on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if own(scene):
        if any(own(window.scene) for window in _windows()):
            _serve_in(REST_SECONDS)
        return
    shown = [window for window in _windows() if not own(window.scene)]
    _layers.update((window.as_pointer(), window.view_layer.name) for window in shown)
    changes.note(scene, depsgraph)
    if _rendering or changes.is_echo(scene):
        return
    material_link.follow(depsgraph)
    if _is_echo(depsgraph):
        return
    # Only what the optics can depend on: an own data-block's change is no news.
    if any(isinstance(u.id, _RELEVANT) and not u.id.get(TAG) for u in depsgraph.updates):
        request_update(scene)


def _is_echo(depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether this is what a preparation wrote: an own scene's settings, and nothing has moved.

    All that the own scene shares with the user's is listed too. Answering would go on for ever.
    """
    updates = list(depsgraph.updates)
    return any(own(u.id) for u in updates) and not any(
        (u.is_updated_geometry or u.is_updated_transform) and not own(u.id) for u in updates
    )


_RELEVANT = (
    bpy.types.Object,
    bpy.types.Mesh,
    bpy.types.Curve,
    bpy.types.Camera,
    bpy.types.Collection,
    bpy.types.Scene,
)


def _show_own(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """What a render draws of an own scene. Raises :class:`Stopped`."""
    tell("rendering what else is seen in the glass")
    user = user_scene_of(scene)
    if own(scene, true.CAPTURE) or own(scene, true.SKY):
        _computed(user, door.finish)
        true.ease_world(depsgraph)
    if own(scene, "displaced") and scene.render.use_motion_blur and user is not None:
        motion_blur.show_moment(user, motion_blur.frame_time(scene))


@persistent
def _on_frame_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    global _own_rendered
    if own(scene):
        _own_rendered = True
        if depsgraph.mode == "RENDER":
            # Blender knows of Esc as well and ends the render.
            with suppress(Stopped):
                _show_own(scene, depsgraph)
        return
    changes.note(scene, depsgraph)
    if depsgraph.mode != "RENDER":
        request_update(scene)
        return
    _computed(scene.original, partial(door.update, depsgraph=depsgraph))


def _computed(scene: bpy.types.Scene | None, compute: Callable) -> None:
    """Compute something for a scene of the user's; what goes wrong ends in its status."""
    if scene is None:
        return
    try:
        compute(scene)
    except Stopped:
        # Blender knows of Esc as well and ends the render.
        door.status(scene).problems = [STOPPED]
    except RefractiveGlassError as error:
        door.status(scene).problems = [str(error)]


@persistent
def _on_render_init(scene: bpy.types.Scene, *_) -> None:
    global _rendering, _own_rendered
    if not own(scene):
        _own_rendered = False
    _rendering = True
    if not own(scene):
        go_on()
        memory = door.memory_of(scene)
        memory.last = []
        memory.masks.clear()
    if threading.current_thread() is not threading.main_thread() or own(scene):
        return
    _prepare(scene)
    for problem in door.status(scene).problems:
        print(f"Refractive Glass: {problem}")


@persistent
def _list_all(*_) -> None:
    """The last handler of an event: any before it may have put the lists out of date."""
    list_objects(bpy.data.scenes)


@persistent
def _list_last(*_) -> None:
    """Put :func:`_list_all` behind handlers that were added since it was."""
    for event in _LISTED:
        handlers = getattr(bpy.app.handlers, event)
        if _LIST_ALL in handlers and handlers[-1] is not _LIST_ALL:
            # In this order: another thread may do the same.
            handlers.append(_LIST_ALL)
            handlers.remove(_LIST_ALL)


@persistent
def _on_render_frame(scene: bpy.types.Scene, *_) -> None:
    motion_blur.begin_frame(scene)


@persistent
def _on_render_complete(scene: bpy.types.Scene, *_) -> None:
    if not own(scene):
        wants_own = scene.render.use_compositing and _asks_for_own(scene)
        # Blender completes a render that was ended by closing its window.
        stopped = STOPPED in door.status(scene).problems
        if wants_own and not _own_rendered and not stopped:
            door.status(scene).problems.append(LEFT_OUT)
            print(f"Refractive Glass: {LEFT_OUT}")
        door.memory_of(scene).last = list(door.status(scene).problems)
    _on_render_end(scene)


@persistent
def _on_render_end(scene: bpy.types.Scene, *_) -> None:
    global _rendering
    _rendering = False
    tell(None)
    if own(scene):
        return
    go_on()
    if threading.current_thread() is threading.main_thread():
        door.free_leftovers()
    else:
        request_update(scene)


def _asks_for_own(scene: bpy.types.Scene) -> bool:
    """Whether the scene's compositor has any own scene drawn in this frame."""
    own_scenes = [s for s in find_own_scenes(scene) if not own(s, true.CAST)]
    return any(layer.use for own_scene in own_scenes for layer in own_scene.view_layers)


@persistent
def _on_data_replaced(*_) -> None:
    door.forget()
    _layers.clear()
    _request_all()


@persistent
def _on_load(*_) -> None:
    renew_groups()
    material_link.remember()
    _on_data_replaced()


@persistent
def _before_load(*_) -> None:
    """Blender ends a render before it reads a file, and waits for it."""
    if _renders():
        ask_to_stop()


def _request_all() -> None:
    """Ask for all scenes: files do not hold what is made again, and nothing in them has changed."""
    for scene in bpy.data.scenes:
        request_update(scene, LOADED_SECONDS)


def _on_enabled() -> None:
    """Timer: a file that is open was perhaps made by another version."""
    renew_groups()
    _request_all()


@persistent
def _before_data_replaced(*_) -> None:
    """Undo takes for granted that nothing has changed since its last step.

    A data-block that was the same in two steps it leaves as it is; if a preparation has made that
    point to something newer, it points to nothing afterwards, and Blender crashes.
    """
    if not _renders():
        for scene in _users_scenes():
            door.withdraw(scene)


@persistent
def _on_save(*_) -> None:
    _withdrawn.clear()
    if not (_rendering or is_rendering()):
        made = [scene for scene in _users_scenes() if find_own_scenes(scene)]
        _withdrawn.update(scene.session_uid for scene in made)
        for scene in sorted(made, key=lambda s: s.refractive_glass.shading == "TRUE"):
            door.set_aside(scene, rendering=_renders())
        door.set_aside_strays()


@persistent
def _on_saved(*_) -> None:
    door.put_back()
    for scene in _users_scenes():
        if scene.session_uid in _withdrawn:
            _prepare(scene)
    _withdrawn.clear()


def _guarded(function: Callable) -> Callable:
    """The handler; in a render's thread one that :func:`unregister` waits for."""

    @wraps(function)
    def handler(*arguments) -> None:
        if threading.current_thread() is threading.main_thread():
            function(*arguments)
            return
        with _working:
            # Blender may have read the list of handlers before this one was taken out.
            if _registered:
                function(*arguments)

    return handler


_LISTED = (
    *("depsgraph_update_pre", "depsgraph_update_post", "frame_change_pre", "frame_change_post"),
    *("render_init", "render_pre", "render_post", "render_write"),
)
"""Events after which Blender copies scenes, whatever handlers of the user's have changed."""
_ENDS = ("render_complete", "render_cancel")
_LIST_ALL = _guarded(_list_all)
_TABLE = (
    *((event, _guarded(_list_last)) for event in _LISTED),
    *(
        (event, _guarded(function))
        for event, function in (
            ("depsgraph_update_post", _on_depsgraph_update),
            ("frame_change_post", _on_frame_change),
            ("render_init", _on_render_init),
            ("render_pre", _on_render_frame),
            ("render_complete", _on_render_complete),
            ("render_cancel", _on_render_end),
            ("undo_pre", _before_data_replaced),
            ("redo_pre", _before_data_replaced),
            ("undo_post", _on_data_replaced),
            ("redo_post", _on_data_replaced),
            ("load_pre", _before_load),
            ("load_post", _on_load),
            ("save_pre", _on_save),
            ("save_post", _on_saved),
            ("save_post_fail", _on_saved),
        )
    ),
    *((event, _LIST_ALL) for event in _LISTED),
)


def register() -> None:
    """Append every handler; a file that is open is prepared once Blender lets data be seen."""
    global _registered, _own_rendered
    _registered = True
    # Of a render that goes on it is not known.
    _own_rendered = True
    for name, function in _TABLE:
        getattr(bpy.app.handlers, name).append(function)
    if not bpy.app.background:
        bpy.app.timers.register(_on_enabled, first_interval=0.0)
    elif hasattr(bpy.data, "node_groups"):
        # As Blender starts no data can be seen, and no file is open yet.
        renew_groups()


def unregister() -> None:
    """Take every handler and the timer out again, and out of the file what nobody would look after.

    What is baked stays: it needs nobody. What a render holds stays until it has ended.
    """
    global _registered, _rendering
    for name, function in _TABLE:
        handlers = getattr(bpy.app.handlers, name)
        if function in handlers:
            handlers.remove(function)
    for timer in (_serve, _on_enabled):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    # The scenes' settings go next, and a render's thread may be reading them.
    ask_to_stop()
    with _working:
        _registered = False
        # In its own handlers a render that blocks is known by nothing else.
        _rendering = _rendering and not is_rendering()
    go_on()
    if _rendering:
        for name in _ENDS:
            getattr(bpy.app.handlers, name).append(_on_last_render_end)
    else:
        wait = _leave()
        if wait is not None:
            bpy.app.timers.register(_leave, first_interval=wait)
    _asked.clear()
    door.forget()


@persistent
def _on_last_render_end(*_) -> None:
    """The end of a render in whose handlers the extension was disabled."""
    global _rendering
    for name in _ENDS:
        getattr(bpy.app.handlers, name).remove(_on_last_render_end)
    _rendering = False
    _leave()


def _leave() -> float | None:
    """Timer: take out of the file what nobody looks after any more, once no render holds it."""
    if _registered:
        return None
    if _is_in_use():
        return REST_SECONDS
    for scene in _users_scenes():
        door.withdraw(scene)
    return None
