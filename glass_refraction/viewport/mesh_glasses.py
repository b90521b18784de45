# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes: read from the scene, and made ready for the shader a little at a time.

Views share what they make of a mesh: several may show the same scene.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from weakref import WeakValueDictionary

import bpy
import numpy as np

from ..optics import LINES
from ..scene.names import RefractiveGlassError
from ..scene.read.bumps import bumping, surface_stamp
from ..scene.read.glasses import read_mesh_interface
from ..scene.read.glassy_materials import opaque_bits
from ..scene.read.mesh_corners import Corners, corners_of
from ..scene.read.modifier_inputs import glass_modifier
from ..scene.read.paint import paint_on
from .description import Posed
from .news import News
from .places import Key, Place
from .trees import MOST_TRIANGLES, MeshBody, Shaped, Tree, grow, polar, shaped

ROUNDED = 6
"""Digits of a stretch that count: a turn changes the last ones of single precision."""
PATIENCE = 5.0
"""Seconds to wait for what evaluates bumps: a timer makes it after a change."""
QUICK_TRIANGLES = 20_000
"""So many are put where they are now while a view is drawn: it takes a few milliseconds."""


class _Grown:
    """A mesh as the shader reads it, and the frame that it is in."""

    def __init__(self, form: Shaped, tree: Tree) -> None:
        self.form, self.tree = form, tree


_grown: WeakValueDictionary[tuple, _Grown] = WeakValueDictionary()


class MeshGlasses:
    """What a view knows of the glasses that are meshes.

    Attributes
    ----------
    line : what is being made ready; empty if nothing.
    """

    def __init__(self) -> None:
        self.line = ""
        self._known: dict[Key, tuple[tuple, _Grown]] = {}
        self._wanted: dict[Key, tuple] = {}
        """What places wait for; instances for the same."""
        self._growing: dict[tuple, tuple[str, Iterator[_Grown | None]]] = {}
        # Of large images they take a tenth of a second: too long for each step of a slider.
        self._pixels: dict[tuple, int] = {}

    @property
    def waits(self) -> bool:
        """Whether there is a mesh to be made ready."""
        return bool(self._growing)

    def keep(self, places: list[Place]) -> None:
        """Let go of all others."""
        keys = {place.key for place in places}
        for known in (self._known, self._wanted):
            for key in known.keys() - keys:
                del known[key]
        for key in self._growing.keys() - set(self._wanted.values()):
            del self._growing[key]

    def read(
        self, place: Place, depsgraph: bpy.types.Depsgraph, news: News
    ) -> tuple[Posed, list[MeshBody]] | None:
        """A glass that is a mesh, and how red, green and blue light find it; None: not ready yet.

        Raises
        ------
        RefractiveGlassError
            It cannot be a glass, or it has too many triangles.
        """
        obj, matrix = place.obj, place.to_world
        evaluated = obj.evaluated_get(depsgraph)
        glass = read_mesh_interface(evaluated, depsgraph, matrix)
        turn, stretch = polar(matrix[:3, :3])
        # Whatever their size, instances share what is made of the mesh.
        size = np.abs(stretch).max()
        stretch = stretch / size
        key = (
            obj.session_uid,
            news.shape_of(obj),
            *np.round(stretch, ROUNDED).ravel(),
            *surface_stamp(evaluated, depsgraph, matrix),
        )
        if place.key not in self._known or self._known[place.key][0] != key:
            self._find(place, key, evaluated, depsgraph, stretch)
        if place.key not in self._known:
            return None
        grown = self._known[place.key][1]
        form, tree = grown.form, grown.tree
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, matrix[:3, 3] + size * turn @ form.middle
        bodies = [
            MeshBody(
                tree,
                seen.description.ior,
                size * form.scale,
                tuple(size * half for half in form.half),
                seen.description.refracted,
                seen.description.reflected,
                tree.roughness if tree.paint else seen.description.roughness,
            )
            for seen in (glass, *glass.bands())
        ]
        posed = Posed(bodies[0], pose, glass.absorption, priority=glass.priority)
        bands = bodies[1:]
        # Without dispersion all are one.
        return posed, bands if len(bands) > 1 else [bodies[0]] * len(LINES)

    def _find(self, place: Place, key: tuple, evaluated, depsgraph, stretch: np.ndarray) -> None:
        """Know a mesh as it is now, or begin to make it ready."""
        where, name = place.key, place.obj.name
        if key in _grown:
            self._known[where] = key, _grown[key]
            self._wanted.pop(where, None)
            return
        if key in self._growing:
            self._wanted[where] = key
            return
        try:
            corners = corners_of(evaluated.data, opaque_bits(glass_modifier(evaluated)))
            count = len(corners.points)
            if count > MOST_TRIANGLES:
                raise ValueError(
                    f"{count} triangles are too many for the live view, which takes "
                    f"{MOST_TRIANGLES}: fewer in the viewport make it shown"
                )
            form = shaped(corners.points, corners.normals, stretch)
            read = evaluated, depsgraph, corners, place.to_world, self._pixels
            bumps = bumping(*read, paint_on(*read), PATIENCE)
        except ValueError as error:
            raise RefractiveGlassError(f'Glass "{name}": {error}') from error
        before = self._known.get(where) if bumps is None else None
        if before is not None and before[1].tree.count == count <= QUICK_TRIANGLES:
            # The same mesh, deformed: its order is as good as any.
            self._wanted.pop(where, None)
            self._known[where] = (
                key,
                _Grown(form, before[1].tree.refitted(form.points, form.normals)),
            )
            _grown[key] = self._known[where][1]
            return
        self._wanted[where] = key
        self._growing[key] = name, _growing(form) if bumps is None else _bumped(bumps, stretch)

    def grow(self, seconds: float) -> bool:
        """Go on for a while; whether a mesh became ready, so that glasses are to be read anew."""
        until = time.perf_counter() + seconds
        while self._growing and time.perf_counter() < until:
            key, (name, steps) = next(iter(self._growing.items()))
            self.line = f'Mesh of glass "{name}" is made ready'
            found = next(steps)
            if found is not None:
                for where in [where for where, wanted in self._wanted.items() if wanted == key]:
                    self._known[where] = key, found
                    del self._wanted[where]
                _grown[key] = found
                del self._growing[key]
                self.line = ""
                return True
        return False


def _growing(form: Shaped) -> Iterator[_Grown | None]:
    for tree in grow(form.points, form.normals, form.within, form.finish):
        yield None if tree is None else _Grown(form, tree)


def _bumped(steps: Generator[None, None, Corners], stretch: np.ndarray) -> Iterator[_Grown | None]:
    """A mesh made ready with its bumps and its paint, which nobody but a render evaluates while one
    goes on."""
    while True:
        if not bpy.app.is_job_running("RENDER"):
            try:
                next(steps)
            except StopIteration as end:
                corners = end.value
                break
        yield None
    parts = corners.points, corners.normals, stretch, corners.within, corners.finish
    yield from _growing(shaped(*parts))
