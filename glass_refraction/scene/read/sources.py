# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be seen through a glass: the scene's evaluated meshes as arrays of world positions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from ..names import own
from .animation import may_change
from .arrays import affine, positions
from .glasses import Glass
from .modifier_inputs import glass_modifier, read_input
from .visibility import rendered_objects

# Object Info hands these on as meshes; the others are converted to meshes first.
_MESH_TYPES = {"MESH", "EMPTY"}
_CONVERTED_TYPES = {"CURVE", "SURFACE", "FONT", "META"}


@dataclass(frozen=True, eq=False)
class Piece:
    """One mesh of a source (an instance has one a copy) and where it stands."""

    mesh: bpy.types.Mesh
    to_world: np.ndarray


def source_objects(
    view_layer: bpy.types.ViewLayer,
    problems: list[str] | None = None,
    *,
    ever: bool = False,
) -> list[bpy.types.Object]:
    """The view layer's objects that may be seen through a glass, as renders show them.

    Parameters
    ----------
    problems : takes a line for each object that cannot be read now.
    ever : those too that are hidden now and that another frame may show.
    """
    found = []
    for obj in rendered_objects(view_layer, ever=ever):
        if own(obj) or not _may_be_seen(obj):
            continue
        if not (obj.visible_camera or (ever and may_change(obj, "visible_camera"))):
            continue
        if obj.mode == "EDIT":
            if problems is not None:
                problems.append(
                    f'"{obj.name}" is in Edit Mode and left out of the glass: leave Edit Mode'
                )
            continue
        found.append(obj)
    return found


def _may_be_seen(obj: bpy.types.Object) -> bool:
    """Whether an object has, or shows instances of, anything that is no glass."""
    if obj.type == "EMPTY":
        shown = obj.instance_collection
        return shown is not None and any(map(_may_be_seen, shown.all_objects))
    if obj.type == "MESH" and glass_modifier(obj) is not None:
        return False
    return obj.type in _MESH_TYPES | _CONVERTED_TYPES


def seen_through(
    glass: bpy.types.Object, sources: list[bpy.types.Object]
) -> list[bpy.types.Object]:
    """The sources that the glass's collection lets be seen through it; all without a collection."""
    collection = read_input(glass_modifier(glass), "Seen Through")
    if collection is None:
        return sources
    members = {obj.session_uid for obj in collection.all_objects}
    return [obj for obj in sources if obj.session_uid in members]


def reaches_into(glass: Glass, source: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether any vertex of the source lies within the glass's outer surface."""
    with pieces(source, depsgraph) as parts:
        points = world_positions(parts)
    return len(points) > 0 and bool(glass.holds(points).any())


def is_carried(source: bpy.types.Object) -> bool:
    """Whether Geometry Nodes can carry the source's mesh; else the copy holds a mesh of its own."""
    return source.type in _MESH_TYPES


@contextmanager
def pieces(source: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[list[Piece]]:
    """The evaluated meshes of a source, in the order in which Realize Instances joins them.

    They are Blender's own and live only inside the ``with`` block.
    """
    evaluated = source.evaluated_get(depsgraph)
    if not is_carried(source):
        mesh = evaluated.to_mesh()
        try:
            found = [] if mesh is None else [Piece(mesh, _matrix(evaluated.matrix_world))]
            yield found
        finally:
            evaluated.to_mesh_clear()
        return
    found = []
    if source.type == "MESH" and len(evaluated.data.vertices):
        found.append(Piece(evaluated.data, _matrix(evaluated.matrix_world)))
    if _has_instances(evaluated):
        for instance in depsgraph.object_instances:
            if not instance.is_instance or instance.parent != evaluated:
                continue
            if instance.object.type == "MESH":
                found.append(Piece(instance.object.data, _matrix(instance.matrix_world)))
    yield found


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The vertices of a source as they were read: what its images depend on.

    Attributes
    ----------
    local : (n, 3) float32 arrays, one a piece, in the piece's own frame.
    to_world : the pieces' (4, 4) poses.
    topology : vertices, corners and faces of each piece: another mesh has other ones.
    """

    local: tuple[np.ndarray, ...]
    to_world: tuple[np.ndarray, ...]
    topology: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, parts: list[Piece]) -> Snapshot:
        """Read the pieces."""
        return cls(
            tuple(positions(part.mesh) for part in parts),
            tuple(part.to_world for part in parts),
            tuple((len(p.mesh.vertices), len(p.mesh.loops), len(p.mesh.polygons)) for p in parts),
        )

    def __len__(self) -> int:
        return sum(len(points) for points in self.local)

    def same(self, other: Snapshot) -> bool:
        """Whether every vertex is where it is in the other."""
        return (
            self.topology == other.topology
            and all(map(np.array_equal, self.to_world, other.to_world))
            and all(map(np.array_equal, self.local, other.local))
        )

    def placed(self, matrix: np.ndarray) -> np.ndarray:
        """All vertices, one after another, times an affine (k, 4) matrix: (N, k) float64."""
        out = np.empty((len(self), len(matrix)))
        start = 0
        for points, pose in zip(self.local, self.to_world, strict=True):
            affine(points, matrix @ pose, out[start : start + len(points)])
            start += len(points)
        return out

    def world(self) -> np.ndarray:
        """All vertices (N, 3) float64, one after another, in the world."""
        return self.placed(np.eye(4)[:3])


def world_positions(parts: list[Piece]) -> np.ndarray:
    """All vertices (N, 3) float64 of the pieces, one after another, in the world."""
    return Snapshot.of(parts).world()


def _matrix(matrix) -> np.ndarray:
    return np.array(matrix, float)


def _has_instances(evaluated: bpy.types.Object) -> bool:
    if evaluated.instance_collection is not None:
        return True
    try:
        geometry = evaluated.evaluated_geometry()
    except TypeError:
        # Hidden in viewports, or in a scene that is not shown: only a render will evaluate it.
        return False
    return geometry is not None and geometry.instances_pointcloud() is not None
