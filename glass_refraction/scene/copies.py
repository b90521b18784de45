# SPDX-License-Identifier: GPL-3.0-or-later
"""Displaced copies: positions in, one carrier mesh a (glass, light path, source) out."""

from __future__ import annotations

from dataclasses import dataclass

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from .. import optics
from .arrays import edges, positions, write_attribute, write_positions
from .glasses import Glass, unbounded
from .modifier_inputs import write_input
from .sources import Piece, world_positions
from .tessellation import (
    Images,
    interpolation_gaps,
    overlaps,
    refine,
    region_probe,
)
from .viewpoint import Viewpoint


@dataclass(frozen=True, eq=False)
class Solver:
    """Where world points appear along one path of one glass."""

    glass: Glass
    path: optics.LightPath
    view: Viewpoint
    tolerance_px: float

    def __call__(self, points: np.ndarray, guess=None) -> optics.ApparentPoints:
        """Apparent points of (N, 3) world points, in the glass's frame.

        The solve takes the glass as unbounded: its region, not the copy, ends where it ends, and a
        face that crosses the border then needs no vertex on it.
        """
        view = self.view
        tolerance = self.tolerance_px / view.focal_px
        if view.is_parallel:
            tolerance = 1e-9
        return optics.apparent_points(
            unbounded(self.glass.description),
            self.path,
            view.eye_for(self.glass),
            self.glass.to_local(points),
            tolerance=tolerance,
            guess=guess,
        )

    def images(self, points: np.ndarray) -> Images:
        """The same in the world."""
        found = self(points)
        return Images(self.glass.points_to_world(found.position), found.valid)


@dataclass
class Written:
    """What a copy holds.

    Attributes
    ----------
    vertices : of the source (refined if it was), 0 if it cannot be seen in the region.
    bound_px : the largest gap between a straight image edge and the true image.
    refined : the carrier holds the mesh itself.
    """

    vertices: int
    bound_px: float
    refined: bool
    found: optics.ApparentPoints | None


def write_copy(
    copy: bpy.types.Object,
    parts: list[Piece],
    carried: bool,
    solver: Solver,
    rect: tuple[int, int, int, int],
    max_gap_px: float,
    guess: optics.ApparentPoints | None = None,
) -> Written:
    """Solve a source and write where it appears into the copy's carrier mesh.

    Parameters
    ----------
    carried : Geometry Nodes can take the source's mesh; else the carrier must hold it.
    rect : pixels that the glass covers; what appears beside them is left out.
    max_gap_px : edges that miss the true image by more are subdivided.
    guess : the last result for the same vertices.
    """
    view = solver.view
    points = world_positions(parts)
    mesh = copy.data
    if not len(points):
        _write_carrier(mesh, np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        return Written(0, 0.0, False, None)
    if guess is not None and guess.valid.shape[1] != len(points):
        guess = None
    found = solver(points, guess)
    images = Images(solver.glass.points_to_world(found.position), found.valid)
    pairs = _edge_pairs(parts)
    gap, _, box = interpolation_gaps(points, pairs, images, solver.images, view)
    near = overlaps(box, rect)
    bound = float(gap[near].max(initial=0.0))
    could_hide_more = len(points) < 10_000 and not images.valid.all()
    seen = near.any() or (images.valid.any() and not len(pairs))
    if (seen and (bound > max_gap_px or not carried)) or could_hide_more:
        probe = region_probe(solver.glass, view, solver.path, rect)
        bound = refine(parts, mesh, solver.images, probe, view, rect, max_gap_px)
        points = positions(mesh).astype(float)
        found = solver(points)
        images = Images(solver.glass.points_to_world(found.position), found.valid)
        if images.valid.any():
            _repeat_slots(mesh, _used_slots(images.valid))
            _write_slots(copy, points, images, view, keep_mesh=True)
            return Written(len(points), bound, True, None)
        seen = False
    if not seen:
        _write_carrier(mesh, np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        return Written(0, 0.0, False, found)
    _write_slots(copy, points, images, view, keep_mesh=False)
    return Written(len(points), bound, False, found)


def write_true_mesh(obj: bpy.types.Object, parts: list[Piece]) -> None:
    """Write the pieces, where they are, into the object's own mesh (for sources not carried)."""
    joined = bmesh.new()
    try:
        for part in parts:
            joined.from_mesh(part.mesh)
            joined.verts.ensure_lookup_table()
            new = joined.verts[-len(part.mesh.vertices) :]
            bmesh.ops.transform(joined, matrix=Matrix(part.to_world.tolist()), verts=new)
        joined.to_mesh(obj.data)
    finally:
        joined.free()
    obj.data.update()


def _edge_pairs(parts: list[Piece]) -> np.ndarray:
    start, found = 0, []
    for part in parts:
        found.append(edges(part.mesh) + start)
        start += len(part.mesh.vertices)
    return np.concatenate(found)


def _used_slots(valid: np.ndarray) -> int:
    used = np.nonzero(valid.any(axis=1))[0]
    return int(used[-1]) + 1 if len(used) else 0


def _repeat_slots(mesh: bpy.types.Mesh, slots: int) -> None:
    """Repeat the mesh itself once an image slot."""
    if slots < 2:
        return
    joined = bmesh.new()
    try:
        for _ in range(slots):
            joined.from_mesh(mesh)
        joined.to_mesh(mesh)
    finally:
        joined.free()


def _write_slots(
    copy: bpy.types.Object, points: np.ndarray, images: Images, view: Viewpoint, keep_mesh: bool
) -> None:
    slots = _used_slots(images.valid)
    lookup = np.tile(view.clip(points), (slots, 1))
    where = images.position[:slots].reshape(-1, 3)
    # A source that reaches through an interface has its parts in different slots; what a slot
    # says beyond the interface means nothing, so no face may hang on it.
    beyond = -1e3 if images.valid.any(axis=1).sum() > 1 else 0.0
    seen = np.where(images.valid[:slots].reshape(-1), 1.0, beyond)
    _write_carrier(copy.data, where, seen, lookup, keep_mesh=keep_mesh)
    write_input(copy.modifiers[0], "Slots", max(1, slots))


def _write_carrier(mesh, where, seen, lookup, *, keep_mesh: bool = False) -> None:
    if not keep_mesh and (len(mesh.vertices) != len(where) or len(mesh.edges)):
        mesh.clear_geometry()
        mesh.vertices.add(len(where))
    write_positions(mesh, where)
    write_attribute(mesh, "rg_seen", seen, "FLOAT")
    write_attribute(mesh, "rg_lookup", lookup, "FLOAT_COLOR")
    mesh.update()
    mesh.update_tag()
