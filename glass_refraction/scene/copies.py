# SPDX-License-Identifier: GPL-3.0-or-later
"""Displaced copies: positions in, one carrier mesh a (glass, light path, source) out."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .. import optics
from .arrays import write_attribute
from .glasses import Glass, unbounded
from .mesh_arrays import SourceMesh, read_source_mesh, write_mesh
from .modifier_inputs import write_input
from .sources import Piece, world_positions
from .tessellation import (
    Images,
    Probe,
    Triangles,
    edge_images,
    refine,
    view_pixels,
)
from .texture_coordinates import write_coordinates
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
        return self.in_world(self(points))

    def in_world(self, found: optics.ApparentPoints) -> Images:
        """A result taken from the glass's frame to the world."""
        return Images(self.glass.points_to_world(found.position), found.valid, found.stretch)


FAINT = 0.5
"""Paths with less of the light than this show an object only where a probe's ray comes near it."""


@dataclass
class Written:
    """What a copy holds.

    Attributes
    ----------
    vertices : of the source (refined if it was), 0 if it cannot be seen in the region.
    bound_px : the largest gap between a straight image edge and the true image.
    refined : the carrier holds the mesh itself.
    found : where the source's own vertices appear, the next solve's first guess.
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
    probe: Probe,
    rect: tuple[int, int, int, int],
    max_gap_px: float,
    extra: dict[str, np.ndarray],
    importance: float = 1.0,
    guess: optics.ApparentPoints | None = None,
) -> Written:
    """Solve a source and write where it appears into the copy's carrier mesh.

    Parameters
    ----------
    carried : Geometry Nodes can take the source's mesh; else the carrier must hold it.
    probe : rays of the path's region.
    rect : pixels that the glass covers; what appears beside them is left out.
    max_gap_px : triangles whose edges miss the true image by more are split.
    extra : texture coordinates of the true place, name -> (N, 3), for materials that need them.
    importance : the path's part of the light, which limits how many vertices it is worth.
    guess : the last result for the same vertices.
    """
    view = solver.view
    points = world_positions(parts)
    # A faint path is not searched for objects that its rays pass by.
    passed_by = importance < FAINT and not (len(points) and probe.meets_box(points))
    if not len(points) or passed_by:
        _write_carrier(copy.data, np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        return Written(0, 0.0, False, None)
    if guess is not None and guess.valid.shape[1] != len(points):
        guess = None
    found = solver(points, guess)
    source = read_source_mesh(parts, extra)
    triangles = Triangles.whole(source.points, source.corners)
    images = solver.in_world(found)
    visible, wrong, bound = _check(triangles, images, solver, rect, max_gap_px)
    if (visible and (wrong or not carried)) or _may_hide_more(triangles, images):
        refined = refine(triangles, solver.images, probe, view, rect, max_gap_px, importance)
        if refined.visible:
            points = refined.triangles.points
            images = solver.images(points)
            _write_refined(copy, source, refined.triangles, images, view)
            return Written(len(points), refined.bound_px, True, None)
        visible = False
    if not visible:
        _write_carrier(copy.data, np.empty((0, 3)), np.empty(0), np.empty((0, 4)))
        return Written(0, 0.0, False, found)
    slots = _used_slots(images.valid)
    _write_carrier(copy.data, *_slot_values(points, images, slots, triangles, view))
    write_coordinates(copy.data, extra, len(slots))
    write_input(copy.modifiers[0], "Slots", max(1, len(slots)))
    return Written(len(points), bound, False, found)


def write_true_mesh(obj: bpy.types.Object, parts: list[Piece]) -> None:
    """Write the pieces, where they are, into the object's own mesh (for sources not carried)."""
    source = read_source_mesh(parts)
    write_mesh(obj.data, source, Triangles.whole(source.points, source.corners))
    obj.data.update_tag()


def _check(triangles: Triangles, images: Images, solver: Solver, rect, max_gap_px: float):
    """Whether any of it appears in the rectangle, needs a split there, and the gaps' bound."""
    if not images.valid.any():
        return False, False, 0.0
    edges, triangle_edges = triangles.edges()
    middles = solver.images(triangles.points[edges].mean(axis=1))
    found = edge_images(triangles.points, edges, images, middles, solver.view)
    near = found.near(triangle_edges, rect)
    return bool(near.any()), bool(found.wrong(near, max_gap_px).any()), found.bound(near)


def _may_hide_more(triangles: Triangles, images: Images) -> bool:
    """Whether large faces may be seen although none of their vertices is."""
    return len(triangles.points) < 10_000 and not images.valid.any(axis=0).all()


def _used_slots(valid: np.ndarray) -> np.ndarray:
    return np.nonzero(valid.any(axis=1))[0]


def _slot_values(points, images: Images, slots, triangles: Triangles, view: Viewpoint):
    """Places (S N, 3), seen flags (S N,) and lookups (S N, 4) of the used slots, one by one."""
    where = images.position[slots].reshape(-1, 3)
    seen = np.stack([_seen(images, slot, triangles, view) for slot in slots])
    return where, seen.reshape(-1), np.tile(view.lookup(points), (len(slots), 1))


def _seen(images: Images, slot: int, triangles: Triangles, view: Viewpoint) -> np.ndarray:
    """1 for vertices with an image, 0 for those placed on the fold near such a one.

    A vertex without an image that lies far from the images of its neighbours says nothing about
    where the surface ends: no face may hang on it.
    """
    valid = images.valid[slot]
    seen = valid.astype(np.float64)
    corners = triangles.corners
    mixed = valid[corners].any(axis=1) & ~valid[corners].all(axis=1)
    if mixed.any():
        part = corners[mixed]
        places = view_pixels(view, images.position[slot])[part]
        good = valid[part][..., None]
        low = np.where(good, places, np.inf).min(axis=1, keepdims=True)
        high = np.where(good, places, -np.inf).max(axis=1, keepdims=True)
        away = np.maximum(low - places, places - high).max(axis=2)
        far = (away > MAX_REACH_PX) & ~valid[part]
        seen[part[far]] = -1e3
    return seen


MAX_REACH_PX = 8.0
"""How far a face may reach beyond its vertices that have an image."""


def _write_refined(
    copy, source: SourceMesh, triangles: Triangles, images: Images, view: Viewpoint
) -> None:
    """Write the refined mesh, once an image slot, into the carrier."""
    slots = _used_slots(images.valid)
    count, number = len(triangles.points), len(slots)
    repeated = Triangles(
        np.tile(triangles.points, (number, 1)),
        np.concatenate([triangles.corners + k * count for k in range(number)]),
        np.tile(triangles.origin, number),
        np.tile(triangles.weights, (number, 1, 1)),
    )
    write_mesh(copy.data, source, repeated)
    values = _slot_values(triangles.points, images, slots, triangles, view)
    _write_carrier(copy.data, *values, keep_mesh=True)


def _write_carrier(mesh, where, seen, lookup, *, keep_mesh: bool = False) -> None:
    if not keep_mesh and (len(mesh.vertices) != len(where) or len(mesh.edges)):
        mesh.clear_geometry()
        mesh.vertices.add(len(where))
    if len(where):
        write_attribute(mesh, "position", where, "FLOAT_VECTOR")
    write_attribute(mesh, "rg_seen", seen, "FLOAT")
    write_attribute(mesh, "rg_lookup", lookup, "FLOAT_COLOR")
    mesh.update()
    mesh.update_tag()
