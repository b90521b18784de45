# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes: read from the scene, and made ready for the shader a little at a time.

Views share what they make of a mesh: several may show the same scene.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from weakref import WeakValueDictionary

import bpy
import numpy as np

from ..optics import LINES
from ..scene.names import RefractiveGlassError
from ..scene.read.glasses import read_mesh_interface
from ..scene.read.mesh_glasses import triangles_of
from .description import Posed
from .news import News
from .trees import MOST_TRIANGLES, MeshBody, Shaped, Tree, grow, polar, shaped

ROUNDED = 6
"""Digits of a stretch that count: a turn changes the last ones of single precision."""
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
        self._known: dict[int, tuple[tuple, _Grown]] = {}
        self._growing: dict[int, tuple[tuple, Iterator[_Grown | None]]] = {}
        self._names: dict[int, str] = {}

    @property
    def waits(self) -> bool:
        """Whether there is a mesh to be made ready."""
        return bool(self._growing)

    def keep(self, uids: set[int]) -> None:
        """Let go of all others."""
        for known in (self._known, self._growing):
            for uid in known.keys() - uids:
                del known[uid]

    def read(
        self, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, news: News
    ) -> tuple[Posed, list[MeshBody]] | None:
        """A glass that is a mesh, and how red, green and blue light find it; None: not ready yet.

        Raises
        ------
        RefractiveGlassError
            It cannot be a glass, or it has too many triangles.
        """
        evaluated = obj.evaluated_get(depsgraph)
        glass, matrix = read_mesh_interface(evaluated, depsgraph)
        turn, stretch = polar(matrix[:3, :3])
        uid = obj.session_uid
        size = np.abs(stretch).max()
        key = (
            uid,
            news.shape_of(obj),
            *np.round(stretch / size, ROUNDED).ravel(),
            float(f"{size:.6g}"),
        )
        if uid not in self._known or self._known[uid][0] != key:
            self._find(uid, key, obj.name, evaluated, stretch)
        if uid not in self._known:
            return None
        form, tree = self._known[uid][1].form, self._known[uid][1].tree
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, matrix[:3, 3] + turn @ form.middle
        bodies = [
            MeshBody(
                tree,
                seen.description.ior,
                form.scale,
                form.half,
                seen.description.refracted,
                seen.description.reflected,
            )
            for seen in (glass, *glass.bands())
        ]
        posed = Posed(bodies[0], pose, glass.absorption, priority=glass.priority)
        bands = bodies[1:]
        # Without dispersion all are one.
        return posed, bands if len(bands) > 1 else [bodies[0]] * len(LINES)

    def _find(self, uid: int, key: tuple, name: str, evaluated, stretch: np.ndarray) -> None:
        """Know a mesh as it is now, or begin to make it ready."""
        if key in _grown:
            self._known[uid] = key, _grown[key]
            self._growing.pop(uid, None)
            return
        if uid in self._growing and self._growing[uid][0] == key:
            return
        try:
            points, normals = triangles_of(evaluated.data)
            if len(points) > MOST_TRIANGLES:
                raise ValueError(
                    f"{len(points)} triangles are too many for the live view, which takes "
                    f"{MOST_TRIANGLES}: fewer in the viewport make it shown"
                )
            form = shaped(points, normals, stretch)
        except ValueError as error:
            raise RefractiveGlassError(f'Glass "{name}": {error}') from error
        before = self._known.get(uid)
        if before is not None and len(before[1].tree.order) == len(points) <= QUICK_TRIANGLES:
            # The same mesh, deformed: its order is as good as any.
            self._growing.pop(uid, None)
            self._known[uid] = key, _Grown(form, before[1].tree.refitted(form.points, form.normals))
            _grown[key] = self._known[uid][1]
            return
        self._names[uid] = name
        self._growing[uid] = key, _growing(form)

    def grow(self, seconds: float) -> bool:
        """Go on for a while; whether a mesh became ready, so that glasses are to be read anew."""
        until = time.perf_counter() + seconds
        while self._growing and time.perf_counter() < until:
            uid, (key, steps) = next(iter(self._growing.items()))
            self.line = f'Mesh of glass "{self._names[uid]}" is made ready'
            found = next(steps)
            if found is not None:
                self._known[uid] = key, found
                _grown[key] = found
                del self._growing[uid]
                self.line = ""
                return True
        return False


def _growing(form: Shaped) -> Iterator[_Grown | None]:
    for tree in grow(form.points, form.normals):
        yield None if tree is None else _Grown(form, tree)
