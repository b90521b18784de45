# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes that displaced vertices draw: on the GPU once, and again only when they change.

A mesh of a million vertices takes longer to hand over than a redraw may last. It is handed over in
slices, from a timer; what a view shows until then is up to rays.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

import bpy
import gpu
import numpy as np

from ..scene.read.arrays import mesh_triangles, positions
from ..scene.read.sources import Piece, is_carried, pieces, source_objects
from .refine import is_far, is_large, refined

CHUNK = 200_000
"""Triangles that are handed over at a time."""
QUICK = 20_000
"""Vertices of changed meshes that a redraw takes over itself, so that deforming things do not
flicker between both ways of drawing."""
MOVED = 0.25
"""Of a glass's reach: moved by more, large triangles are divided anew for where it is."""

_END = object()
_reshaped: Counter[int] = Counter()
"""By session uid of objects and meshes: grows when their geometry changes."""


def note_changes(depsgraph: bpy.types.Depsgraph) -> None:
    """Remember whose geometry was evaluated anew."""
    for update in depsgraph.updates:
        if update.is_updated_geometry:
            _reshaped[update.id.original.session_uid] += 1


@dataclass
class _Mesh:
    """One mesh on the GPU.

    Attributes
    ----------
    stamp : of the geometry that the batches show; () before any do.
    wanted : of the geometry as it is now. given_up : of one that was gone before it was read.
    glasses : (middle, reach) of the glasses, in the mesh's frame, as they are now; divided_for:
        those for which large triangles were divided, None if there are none.
    batches : with each whether a glass may hold something of it.
    middle, radius : of a ball that holds all vertices, in the mesh's frame.
    """

    stamp: tuple = ()
    wanted: tuple = ()
    given_up: tuple = ()
    glasses: list[tuple[np.ndarray, float]] = field(default_factory=list)
    divided_for: list[tuple[np.ndarray, float]] | None = None
    batches: list = field(default_factory=list)
    vertices: int = 0
    middle: np.ndarray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0

    @property
    def is_stale(self) -> bool:
        if self.stamp != self.wanted:
            return self.given_up != self.wanted
        known = self.divided_for
        return known is not None and (
            len(known) != len(self.glasses)
            or any(
                np.linalg.norm(a - b) > MOVED * reach or reach != other
                for (a, reach), (b, other) in zip(known, self.glasses, strict=True)
            )
        )


@dataclass(frozen=True)
class Placed:
    """A mesh where it stands: `to_world` (4, 4) float64, `colour` as Solid shading has it."""

    mesh: _Mesh
    to_world: np.ndarray
    colour: tuple[float, float, float, float]


class Things:
    """All meshes of a view that may be seen through its glasses.

    Attributes
    ----------
    placed : those that are there, as they stand now. version : grows when their triangles change.
    """

    def __init__(self) -> None:
        self.placed: list[Placed] = []
        self.version = 0
        self._meshes: dict[tuple[int, int], _Mesh] = {}
        self._layer: bpy.types.ViewLayer | None = None
        self._running: tuple[tuple[int, int], Iterator[None]] | None = None

    @property
    def is_ready(self) -> bool:
        """Whether every mesh is there as it is now, however its large triangles are divided."""
        return all(mesh.stamp == mesh.wanted for mesh in self._meshes.values())

    @property
    def has_work(self) -> bool:
        """Whether `work` has something to do."""
        return any(mesh.is_stale for mesh in self._meshes.values())

    @property
    def vertices(self) -> int:
        """Of all meshes that stand in the view, parts of large triangles included."""
        return sum(thing.mesh.vertices for thing in self.placed)

    def arrange(
        self,
        layer: bpy.types.ViewLayer,
        space: bpy.types.SpaceView3D,
        glasses: list[tuple[np.ndarray, float]],
    ) -> None:
        """Take over what stands where.

        Parameters
        ----------
        glasses : middle (3,) and reach in metres of each glass, in the world.
        """
        depsgraph = layer.depsgraph
        self.placed, seen = [], set()
        for obj in source_objects(layer):
            if not obj.visible_get(view_layer=layer, viewport=space):
                continue
            colour = _colour(obj)
            with pieces(obj, depsgraph) as parts:
                for number, part in enumerate(parts):
                    key = (obj.session_uid, number)
                    mesh = self._meshes.setdefault(key, _Mesh())
                    mesh.wanted, mesh.given_up = _stamp(obj, part), ()
                    mesh.glasses = _brought(glasses, part.to_world)
                    seen.add(key)
                    self.placed.append(Placed(mesh, part.to_world, colour))
        for key in self._meshes.keys() - seen:
            del self._meshes[key]
        if self._running is not None and self._running[0] not in seen:
            self._running = None
        changed = [mesh for mesh in self._meshes.values() if mesh.stamp != mesh.wanted]
        if changed and sum(mesh.wanted[-1] for mesh in changed) <= QUICK:
            self.work(layer, np.inf)

    def work(self, layer: bpy.types.ViewLayer, seconds: float) -> None:
        """Hand over for about so long."""
        until = time.perf_counter() + seconds
        # Lent for as long as this call lasts: nothing of Blender's is kept from one to the next.
        self._layer = layer
        try:
            while self.has_work and time.perf_counter() < until:
                if self._running is None:
                    key = next(k for k, mesh in self._meshes.items() if mesh.is_stale)
                    self._running = key, self._handing_over(key)
                if next(self._running[1], _END) is _END:
                    self._running = None
                    self.version += 1
        finally:
            self._layer = None

    def _handing_over(self, key: tuple[int, int]) -> Iterator[None]:
        """Slice by slice."""
        mesh = self._meshes[key]
        wanted, glasses = mesh.wanted, mesh.glasses
        read = []
        # Blender takes its time for the triangles of a large mesh: they have a slice of their own.
        for step in (positions, _find_triangles, mesh_triangles):
            with _part(key, self._layer, wanted) as part:
                if part is None:
                    mesh.given_up = wanted
                    return
                read.append(step(part.mesh))
            yield
        points, _, triangles = read
        large, last_near = np.zeros(len(triangles), bool), len(triangles)
        for start in range(0, len(triangles), CHUNK):
            part = slice(start, start + CHUNK)
            large[part] = is_large(points, triangles[part], glasses)
            yield
        if large.any():
            # Divided where they lie; the small ones keep their vertices.
            used, index = np.unique(triangles[large], return_inverse=True)
            more, parts = refined(
                points[used].astype(float), index.reshape(-1, 3).astype(np.int32), glasses
            )
            # Parts that are far from all glasses come last: no glass holds them.
            far = is_far(more, parts, glasses)
            parts = np.concatenate((parts[~far], parts[far])) + np.int32(len(points))
            triangles = np.concatenate((triangles[~large], parts))
            points = np.concatenate((points, more.astype(np.float32)))
            last_near = len(triangles) - int(far.sum())
            yield
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
        vertices = gpu.types.GPUVertBuf(layout, max(len(points), 1))
        if len(points):
            vertices.attr_fill("pos", points)
        yield
        batches = []
        starts = [*range(0, last_near, CHUNK), *range(last_near, len(triangles), CHUNK)]
        for start, end in pairwise([*starts, len(triangles)]):
            chunk = np.ascontiguousarray(triangles[start:end], np.uint32)
            indices = gpu.types.GPUIndexBuf(type="TRIS", seq=chunk)
            batch = gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=indices)
            batches.append((batch, start < last_near))
            yield
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3),) * 2
        mesh.batches, mesh.stamp, mesh.vertices = batches, wanted, len(points)
        mesh.middle = 0.5 * (low + high).astype(float)
        mesh.radius = 0.5 * float(np.linalg.norm(high - low))
        mesh.divided_for = glasses if large.any() else None


@contextmanager
def _part(
    key: tuple[int, int], layer: bpy.types.ViewLayer, wanted: tuple
) -> Iterator[Piece | None]:
    """A piece of an object; None if it is not as wanted any more: the next redraw tells."""
    uid, number = key
    obj = next((o for o in layer.objects if o.session_uid == uid), None)
    if obj is None:
        yield None
        return
    with pieces(obj, layer.depsgraph) as parts:
        is_there = number < len(parts) and _stamp(obj, parts[number]) == wanted
        yield parts[number] if is_there else None


def _find_triangles(mesh: bpy.types.Mesh) -> None:
    mesh.calc_loop_triangles()


def _stamp(obj: bpy.types.Object, part: Piece) -> tuple:
    """What tells whether a mesh is another one; its vertices come last."""
    data, mesh = obj.data, part.mesh
    uids = {obj.session_uid}
    if is_carried(obj):
        uids.add(mesh.original.session_uid)
    if data is not None:
        uids.add(data.session_uid)
    counts = len(mesh.polygons), len(mesh.loops), len(mesh.vertices)
    return (tuple(sorted((uid, _reshaped[uid]) for uid in uids)), *counts)


def _brought(glasses, to_world: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Middles and reaches in the frame of a mesh; of one without a volume as in the world."""
    linear = to_world[:3, :3]
    size = float(np.cbrt(abs(np.linalg.det(linear))))
    if not size > 0.0:
        return [(middle - to_world[:3, 3], reach) for middle, reach in glasses]
    inverse = np.linalg.inv(to_world)
    return [(inverse[:3, :3] @ m + inverse[:3, 3], reach / size) for m, reach in glasses]


def _colour(obj: bpy.types.Object) -> tuple[float, float, float, float]:
    """Of a surface as Solid shading draws it."""
    material = obj.active_material
    return tuple(obj.color if material is None else material.diffuse_color)
