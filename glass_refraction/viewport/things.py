# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes that displaced vertices draw: on the GPU once, and again only when they change.

A mesh of a million vertices takes longer to hand over than a redraw may last. It is handed over in
slices, from a timer; what a view shows until then is up to rays.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import bpy
import gpu
import numpy as np

from ..scene.read.arrays import positions
from ..scene.read.mesh_arrays import read_triangles
from ..scene.read.sources import Piece, pieces, source_objects
from .refine import is_large, refined

CHUNK = 200_000
"""Triangles that are handed over at a time."""
QUICK = 20_000
"""Vertices of changed meshes that a redraw takes over itself, so that deforming things do not
flicker between both ways of drawing."""
MOVED = 0.25
"""Of a glass's reach: moved by more, large triangles are divided anew for where it is."""

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
    wanted : of the geometry as it is now.
    glasses : (middle, reach) of the glasses, in the mesh's frame, as they are now; divided_for:
        those for which large triangles were divided, None if there are none.
    middle, radius : of a ball that holds all vertices, in the mesh's frame.
    """

    stamp: tuple = ()
    wanted: tuple = ()
    glasses: list[tuple[np.ndarray, float]] = field(default_factory=list)
    divided_for: list[tuple[np.ndarray, float]] | None = None
    batches: list = field(default_factory=list)
    vertices: int = 0
    middle: np.ndarray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0

    @property
    def is_stale(self) -> bool:
        if self.stamp != self.wanted:
            return True
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
                    mesh.wanted = _stamp(obj, part)
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
        """Hand over for about so long; one slice at least."""
        until = time.perf_counter() + seconds
        while self.has_work:
            if self._running is None:
                key = next(k for k, mesh in self._meshes.items() if mesh.is_stale)
                self._running = key, self._handing_over(key, layer)
            try:
                next(self._running[1])
            except StopIteration:
                self._running = None
                self.version += 1
            if time.perf_counter() > until:
                return

    def _handing_over(self, key: tuple[int, int], layer: bpy.types.ViewLayer) -> Iterator[None]:
        """Slice by slice; nothing of Blender's is kept from one to the next."""
        mesh = self._meshes[key]
        wanted, glasses = mesh.wanted, mesh.glasses
        points, triangles = _read(key, layer)
        del layer
        yield
        large = is_large(points, triangles, glasses) if len(triangles) else np.zeros(0, bool)
        if large.any():
            yield
            # Divided where they lie; the small ones keep their vertices.
            used, index = np.unique(triangles[large], return_inverse=True)
            more, parts = refined(
                points[used].astype(float), index.reshape(-1, 3).astype(np.int32), glasses
            )
            triangles = np.concatenate((triangles[~large], parts + np.int32(len(points))))
            points = np.concatenate((points, more.astype(np.float32)))
            yield
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
        vertices = gpu.types.GPUVertBuf(layout, max(len(points), 1))
        if len(points):
            vertices.attr_fill("pos", points)
        yield
        batches = []
        for start in range(0, len(triangles), CHUNK):
            chunk = np.ascontiguousarray(triangles[start : start + CHUNK], np.uint32)
            indices = gpu.types.GPUIndexBuf(type="TRIS", seq=chunk)
            batches.append(gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=indices))
            yield
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3),) * 2
        mesh.batches, mesh.stamp, mesh.vertices = batches, wanted, len(points)
        mesh.middle = 0.5 * (low + high).astype(float)
        mesh.radius = 0.5 * float(np.linalg.norm(high - low))
        mesh.divided_for = glasses if large.any() else None


def _read(key: tuple[int, int], layer: bpy.types.ViewLayer) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float32, in the mesh's frame, and triangles (T, 3) of a piece of an object.

    Empty if it is not there any more: the next redraw tells.
    """
    uid, number = key
    obj = next((o for o in layer.objects if o.session_uid == uid), None)
    if obj is not None:
        with pieces(obj, layer.depsgraph) as parts:
            if number < len(parts):
                return positions(parts[number].mesh), read_triangles([parts[number]])
    return np.empty((0, 3), np.float32), np.empty((0, 3), np.int32)


def _stamp(obj: bpy.types.Object, part: Piece) -> tuple:
    """What tells whether a mesh is another one; its vertices come last."""
    data, mesh = obj.data, part.mesh
    uids = {obj.session_uid, mesh.original.session_uid}
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
