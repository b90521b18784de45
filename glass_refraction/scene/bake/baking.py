# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake: a frame range is solved once, its files then render where the extension is not installed.

What is solved for a frame hangs on the scene as *renders* evaluate it (render levels, render
visibility). Python gets at that only inside a render; so each frame is rendered by an engine that
draws nothing and hands its depsgraph on.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import bpy

from .. import update as door
from ..build.own_scenes import find_own_scenes
from ..names import RefractiveGlassError
from ..read.viewpoint import render_size, shutter_times
from ..steps import Apart, Step
from .files import (
    Contents,
    GeometryWriter,
    ImageWriter,
    commit,
    discard,
    read_contents,
    remove,
)
from .playback import (
    attach,
    bakeable_images,
    bakeable_objects,
    baked,
    baked_scenes,
    composite_group,
    detach,
    under_way,
    used_layers,
)

RENDER_SECONDS = 0.1
"""A render writes for so long before windows are drawn again."""

Receiver = Callable[[bpy.types.Depsgraph, Callable], None]
"""Takes an evaluated depsgraph, and a function that evaluates it at another (frame, sub-frame)."""


class _DepsgraphEngine(bpy.types.RenderEngine):
    """Draws nothing; gives each depsgraph that a render evaluates to the receiver."""

    bl_idname = "REFRACTIVE_GLASS_BAKE"
    bl_label = "Refractive Glass Bake"

    receiver: Receiver | None = None
    error: Exception | None = None

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        cls = _DepsgraphEngine
        if cls.receiver is None or cls.error is not None:
            return
        try:
            cls.receiver(depsgraph, self.frame_set)
        except Exception as error:  # raised again outside: Blender would only print it
            cls.error = error


@contextmanager
def _engine() -> Iterator[None]:
    """The engine exists only while a bake uses it, lest the engine menu offer it."""
    bpy.utils.register_class(_DepsgraphEngine)
    try:
        yield
    finally:
        bpy.utils.unregister_class(_DepsgraphEngine)


def _evaluate(scene: bpy.types.Scene, receiver: Receiver, view_layer: str = "") -> None:
    """Call ``receiver`` with the depsgraph of each rendered view layer (or the one named).

    The scene's own engine is set again by then: much depends on it.
    """
    off = {
        "engine": _DepsgraphEngine.bl_idname,
        "use_compositing": False,
        "use_sequencer": False,
    }
    before = {name: getattr(scene.render, name) for name in off}

    def receive(depsgraph: bpy.types.Depsgraph, frame_set: Callable) -> None:
        scene.render.engine = before["engine"]
        receiver(depsgraph, frame_set)

    _DepsgraphEngine.receiver, _DepsgraphEngine.error = receive, None
    try:
        for name, value in off.items():
            setattr(scene.render, name, value)
        bpy.ops.render.render(scene=scene.name, layer=view_layer)
    finally:
        _DepsgraphEngine.receiver = None
        for name, value in before.items():
            setattr(scene.render, name, value)
    error, _DepsgraphEngine.error = _DepsgraphEngine.error, None
    if error is not None:
        raise error


@contextmanager
def _all_layers(own_scene: bpy.types.Scene) -> Iterator[None]:
    """Evaluate all view layers, also those that are empty in this frame."""
    unused = [layer for layer in own_scene.view_layers if not layer.use]
    for layer in unused:
        layer.use = True
    try:
        yield
    finally:
        for layer in unused:
            layer.use = False


class Baking:
    """A bake under way: :meth:`steps` to their end, then :meth:`finish`, or :meth:`cancel`.

    Frames that were baked before and lie outside the range stay. Nothing of the folder changes
    before :meth:`finish`.

    Parameters
    ----------
    depsgraph : of the scene's first view layer.
    directory : the folder, as Blender writes paths; empty for the one the scene is baked in, or
        else one beside the file.
    first, last : frames, both included.

    Raises
    ------
    RefractiveGlassError
        A bad range or folder, or a scene that cannot be prepared; nothing is changed then.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        depsgraph: bpy.types.Depsgraph,
        directory: str,
        first: int,
        last: int,
    ) -> None:
        if not 0 <= first <= last:
            raise RefractiveGlassError(f"Frames {first} to {last}: no range from 0 on")
        if not scene.refractive_glass.enabled:
            raise RefractiveGlassError(
                f'Refractive Glass is off in scene "{scene.name}": switch it on to bake'
            )
        if scene.refractive_glass.shading == "TRUE":
            raise RefractiveGlassError(
                f'True shading of scene "{scene.name}" cannot be baked: choose Displaced as its '
                "Shading"
            )
        self.scene = scene
        self.frames = range(first, last + 1)
        self.problems: list[str] = []
        self._position = self._reached = 0
        self._coming: Step | None = None
        self._was = scene.frame_current, scene.frame_subframe
        self._before = baked(scene)
        self.directory = _directory(scene, directory)
        self.folder = Path(bpy.path.abspath(self.directory))
        if self._before is not None and self.folder != self._before.folder:
            raise RefractiveGlassError(
                f"The scene is baked in {self._before.directory}: free that bake first"
            )
        self._old = self._known_contents()
        try:
            self._own_scenes = self._prepare(depsgraph)
        except RefractiveGlassError:
            self._leave()
            raise
        _make_folder(self.folder)
        discard(self.folder)
        self._border = (1.0, 1.0, 0.0, 0.0)
        self._shapes: dict[str, tuple[int, int]] = {}
        session = secrets.token_hex(4)
        self._objects = {
            name: GeometryWriter(self.folder, name, session)
            for name in bakeable_objects(self._own_scenes)
        }
        self._images = {
            name: ImageWriter(self.folder, name)
            for name in bakeable_images(scene, self._own_scenes)
        }
        self._used: set[str] = set()
        self._moments: dict[int, list[float]] = {}
        self._fits = self._old_fits()
        under_way.add(scene.session_uid)

    @property
    def dropped(self) -> list[int]:
        """Frames that were baked before and go, because they no longer fit the scene."""
        old = self._old.frames if self._old is not None and not self._fits else []
        return [frame for frame in old if frame not in self.frames]

    @property
    def frame(self) -> int | None:
        """The frame that :meth:`steps` is at; None when all are baked."""
        return self.frames[self._position] if self._position < len(self.frames) else None

    def steps(self) -> Iterator[Step]:
        """Solve and write frame after frame; yields where windows may be drawn, and it may end."""
        while self.frame is not None:
            yield self._step(0.0, "")
            problems = door.status(self.scene).problems
            yield from self._solving()
            self._write(problems)

    def _step(self, share: float, label: str) -> Step:
        frames = f"{self.frame} / {self.frames[-1]}"
        total = (self._position + share) / len(self.frames)
        return Step(total, f"{frames}: {label}" if label else frames)

    def _solving(self) -> Iterator[Step]:
        """Solve the frame, in several renders where one would hold the windows for long.

        Each goes on where the last one ended: what was solved is not solved again.
        """
        scene, self._reached = self.scene, 0
        layer = next((v for v in scene.view_layers if v.use), scene.view_layers[0])
        with closing(Apart()) as apart:
            while True:
                scene.frame_set(self.frame)
                self._coming = None
                with _engine():
                    _evaluate(scene, partial(self._solve, apart), layer.name)
                if self._coming is None:
                    return
                yield (step := self._step(self._coming.share, self._coming.label))
                while apart.goes_on():
                    yield step

    def _write(self, problems: list[str]) -> None:
        """Write the frame; ``problems`` were known before."""
        frame, scene, own_scenes = self.frame, self.scene, self._own_scenes
        times = _moments(scene, frame)
        with _engine():
            self._evaluate_own(frame, self._write_geometry)
        if times:
            self._moments[frame] = times
        for problem in door.status(scene).problems:
            if problem not in problems:
                self.problems.append(f"From frame {frame}: {problem}")
        for name, image in bakeable_images(scene, own_scenes).items():
            self._images[name].write(frame, image)
        self._used |= used_layers(own_scenes)
        # All own scenes have the same.
        render = own_scenes[0].render
        low = (render.border_min_x, render.border_min_y)
        high = (render.border_max_x, render.border_max_y)
        self._border = _union(self._border, (*low, *high))
        self._position += 1

    def finish(self) -> Contents:
        """Put the new frames in place and let the scene play them back.

        Raises
        ------
        RefractiveGlassError
            Blender does not read the files as they were written; the bake is undone then.
        """
        try:
            return self._finish()
        finally:
            self._leave()

    def _finish(self) -> Contents:
        scene, own_scenes = self.scene, self._own_scenes
        old = self._old if self._fits else None
        contents = Contents(
            scene=scene.name,
            file=_file(),
            frames=sorted({*(old.frames if old is not None else ()), *self.frames}),
            prepared=self._prepared,
            size=render_size(scene),
            shading=scene.refractive_glass.shading,
            border=_union(old.border, self._border) if old is not None else self._border,
            layers=sorted({*(old.layers if old is not None else ()), *self._used}),
            moments={
                f: times
                for f, times in (old.moments if old is not None else {}).items()
                if f not in self.frames
            }
            | self._moments,
            objects=sorted(self._objects),
            images=sorted(self._images),
        )
        commit(self.folder, contents, replaced=None if self._fits else self._old)
        attach(scene, own_scenes, self.directory, contents)
        # The carriers do not hold any more what is remembered of them.
        door.forget()
        wrong = self._misread()
        if wrong:
            free(scene)
            raise RefractiveGlassError(
                f"Blender {bpy.app.version_string} does not read baked geometry back ({wrong[0]})"
            )
        return contents

    def cancel(self) -> None:
        """Leave the folder as it was, and the scene, if its former bake still fits it."""
        discard(self.folder)
        if self._before is not None and self._fits:
            attach(self.scene, self._own_scenes, self.directory, self._old)
        self._leave()

    def _known_contents(self) -> Contents | None:
        """What the folder holds of this scene."""
        known = read_contents(self.folder)
        if known is None:
            return None
        if (known.scene, known.file) != (self.scene.name, _file()) and known.file:
            raise RefractiveGlassError(
                f'{self.directory} holds the bake of scene "{known.scene}" of {known.file}: '
                "free it or choose another folder"
            )
        return known

    def _prepare(self, depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Scene]:
        """Own scenes with the paths of the frame that the standing frames were prepared at."""
        scene = self.scene
        if self._old is not None and self._before is not None:
            self._prepared = self._old.prepared
        else:
            current = scene.frame_current
            self._prepared = current if current in self.frames else self.frames[0]
        if scene.frame_current != self._prepared:
            scene.frame_set(self._prepared)
        standing = baked_scenes(scene)
        if standing:
            detach(scene, standing)
        door.forget()
        try:
            door.prepare(scene, depsgraph, strict=True)
        except RefractiveGlassError:
            if standing and self._old is not None:
                attach(scene, standing, self.directory, self._old)
            raise
        if composite_group(scene) is None:
            raise RefractiveGlassError(
                f'The compositor tree of scene "{scene.name}" has no Render Layers node of it: '
                "add one"
            )
        return find_own_scenes(scene)

    def _old_fits(self) -> bool:
        """Whether the frames that are there can stand beside new ones."""
        old = self._old
        return (
            old is not None
            and self._before is not None
            and (old.objects, old.images) == (sorted(self._objects), sorted(self._images))
            and old.size == render_size(self.scene)
            and old.shading == self.scene.refractive_glass.shading
        )

    def _solve(self, apart: Apart, depsgraph: bpy.types.Depsgraph, frame_set: Callable) -> None:
        """Solve more of the frame, and at its end where its copies are at the moments round it."""
        scene, frame = self.scene, self.frame
        under_way.discard(scene.session_uid)
        try:
            until = time.perf_counter() + RENDER_SECONDS
            number, last = 0, None
            for step in door.updating(scene, depsgraph, apart):
                number += step is not last
                # Each render comes further than the one before, however long that takes; a step
                # that comes again waits for a thread, which goes on until the next render.
                is_further = number > self._reached or step is last
                if is_further and time.perf_counter() > until:
                    self._reached, self._coming = number, step
                    return
                last = step
            for moment in _moments(scene, frame):
                # The handler of frame changes hands it on.
                frame_set(int(moment // 1), moment % 1)
        finally:
            under_way.add(scene.session_uid)

    def _evaluate_own(
        self, frame: int, receiver: Callable[[float, str, bpy.types.Mesh], None]
    ) -> None:
        """Evaluate the own scenes at the frame and, where motion is blurred, at its moments.

        ``receiver(time, name, evaluated mesh)`` gets each object that is baked, once a time.
        """
        names = {obj.session_uid: name for name, obj in bakeable_objects(self._own_scenes).items()}
        seen: set[tuple[float, str]] = set()

        def receive(depsgraph: bpy.types.Depsgraph, frame_set: Callable) -> None:
            scene = depsgraph.scene
            blurred = scene.render.use_motion_blur
            # The frame itself comes last, so that all stands there afterwards.
            for moment in (*_moments(self.scene, frame), frame) if blurred else (frame,):
                if moment != frame:
                    frame_set(int(moment // 1), moment % 1)
                elif blurred:
                    frame_set(frame, 0.0)
                for evaluated in depsgraph.objects:
                    name = names.get(evaluated.original.session_uid)
                    if name is not None and (moment, name) not in seen:
                        seen.add((moment, name))
                        receiver(moment, name, evaluated.data)

        for own_scene in self._own_scenes:
            own_scene.frame_current = frame
            with _all_layers(own_scene):
                _evaluate(own_scene, receive)

    def _write_geometry(self, time: float, name: str, mesh: bpy.types.Mesh) -> None:
        self._objects[name].write(time, mesh)
        self._shapes[name] = _shape(mesh)

    def _misread(self) -> list[str]:
        """Objects whose last frame comes back from the files other than it was written."""
        wrong: list[str] = []

        def check(_time: float, name: str, mesh: bpy.types.Mesh) -> None:
            if _shape(mesh) != self._shapes[name]:
                wrong.append(name)

        with _engine():
            self._evaluate_own(self.frames[-1], check)
        return wrong

    def _leave(self) -> None:
        """Go back to the user's frame and let others prepare the scene again."""
        under_way.discard(self.scene.session_uid)
        door.forget()
        if (self.scene.frame_current, self.scene.frame_subframe) != self._was:
            self.scene.frame_set(self._was[0], subframe=self._was[1])


def free(scene: bpy.types.Scene) -> Path | None:
    """Let the scene be computed again and remove its baked files, and only those.

    Returns the folder where it had to stay: something else is in it, or it is another file's.
    """
    bake = baked(scene)
    if bake is None:
        raise RefractiveGlassError(f'Scene "{scene.name}" is not baked')
    contents = read_contents(bake.folder)
    if contents is not None and contents.file in {"", _file()}:
        remove(bake.folder, contents)
    own_scenes = baked_scenes(scene)
    if own_scenes:
        detach(scene, own_scenes)
    door.remove(scene)
    return bake.folder if bake.folder.is_dir() else None


def _file() -> str:
    return bpy.path.basename(bpy.data.filepath)


def _moments(scene: bpy.types.Scene, frame: int) -> list[float]:
    """The times beside the frame at which renderers look when they blur its motion."""
    render = scene.render
    if not render.use_motion_blur:
        return []
    opens, closes = shutter_times(scene, frame)
    times = {opens + part * (closes - opens) for part in (0.0, 0.5, 1.0)}
    return sorted(time for time in times if time >= 0 and time != frame)


def _directory(scene: bpy.types.Scene, directory: str) -> str:
    """The folder as Blender writes paths: relative to the file where that can be."""
    bake = baked(scene)
    if not directory:
        directory = bake.directory if bake is not None else scene.refractive_glass.bake_directory
    if not directory:
        stem = Path(bpy.data.filepath).stem
        directory = f"//{stem}_bake_{bpy.path.clean_name(scene.name)}"
    if not bpy.data.filepath:
        if directory.startswith("//"):
            raise RefractiveGlassError(
                "The file has not been saved: save it first, or give a folder that is not relative"
            )
        return directory
    try:
        directory = bpy.path.relpath(bpy.path.abspath(directory))
    except ValueError:
        # On another drive than the file.
        return directory
    return directory.replace("\\", "/")


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RefractiveGlassError(f"{folder} cannot be made: {error.strerror}") from error


def _shape(mesh: bpy.types.Mesh) -> tuple[int, int]:
    """What is stored of a mesh without faces is nothing."""
    return (len(mesh.vertices), len(mesh.polygons)) if len(mesh.polygons) else (0, 0)


def _union(a, b) -> tuple[float, float, float, float]:
    return (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
