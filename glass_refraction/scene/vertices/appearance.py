# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a source appears along one light path of one glass: solved and refined.

Every edge that could miss is looked at, and the answer depends on nothing that came before: a frame
looks the same in whichever order frames are made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ... import optics
from ..progress import check
from ..read.arrays import affine
from ..read.glasses import Glass
from ..read.mesh_arrays import read_triangles
from ..read.sources import Piece, Snapshot
from ..read.viewpoint import Viewpoint
from .tessellation import (
    EdgeImages,
    Images,
    Probe,
    Triangles,
    may_hide_more,
    refine,
)

FAINT = 0.5
"""Paths with less of the light than this show an object only where a probe's ray comes near it."""


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
        return self.of_local(self.glass.to_local(points), guess)

    def of_local(self, points: np.ndarray, guess=None) -> optics.ApparentPoints:
        """The same of points in the glass's frame."""
        check()
        view, eye = self.view, self.view.eye_for(self.glass)
        tolerance = 1e-9 if view.is_parallel else self.tolerance_px / view.focal_px
        return optics.apparent_points(
            self.glass.description.unbounded,
            self.path,
            eye,
            points,
            tolerance=tolerance,
            guess=guess,
            # What an open path shows on earlier stretches is another open path's to show.
            last=self.path.open,
        )

    def images(self, points: np.ndarray) -> Images:
        """The same in the world."""
        return self.in_world(self(points))

    def in_world(self, found: optics.ApparentPoints) -> Images:
        """A result taken from the glass's frame to the world."""
        position = np.empty(found.position.shape)
        for slot, local in enumerate(found.position):
            affine(local, self.glass.to_world[:3], position[slot])
        return Images(position, found.valid, found.stretch)


@dataclass(frozen=True, eq=False)
class Source:
    """A source as it was read.

    Attributes
    ----------
    corners : (T, 3) the triangles' vertices.
    carried : Geometry Nodes can take the source's mesh; else the carrier must hold it.
    extra : coordinates of the true place, name -> (N, 3), that materials need.
    normals : what the mesh's normals differ by: CORNER, POINT or FACE.
    """

    snapshot: Snapshot
    corners: np.ndarray
    carried: bool
    extra: dict[str, np.ndarray]
    normals: str

    @classmethod
    def of(cls, parts: list[Piece], snapshot: Snapshot, carried: bool, extra: dict) -> Source:
        """The source whose pieces these are, and of which the snapshot was taken."""
        domains = {part.mesh.normals_domain for part in parts}
        normals = domains.pop() if len(domains) == 1 else "CORNER"
        return cls(snapshot, read_triangles(parts), carried, extra, normals)

    def is_as(self, snapshot: Snapshot, extra: dict[str, np.ndarray]) -> bool:
        """Whether all that images and carriers depend on is as it was."""
        return (
            snapshot.same(self.snapshot)
            and extra.keys() == self.extra.keys()
            and all(np.array_equal(extra[name], self.extra[name]) for name in extra)
        )


@dataclass(frozen=True, eq=False)
class Appearance:
    """Where a source appears.

    Attributes
    ----------
    triangles : what is drawn, at its true place: the source's own triangles, or parts of them.
    of_source : (T, 3) the source's own triangles' vertices, of which refined ones are parts.
    refined : they are parts.
    found : where the triangles' points appear, in the glass's frame; None if that was not asked.
    images : the same in the world; None if nothing can be seen in the region.
    bound_px : the largest gap between a straight image edge and the true image.
    topology : of the source, as ``Snapshot`` says.
    """

    triangles: Triangles
    of_source: np.ndarray
    refined: bool
    found: optics.ApparentPoints | None
    images: Images | None
    bound_px: float
    topology: tuple

    @property
    def vertices(self) -> int:
        """How many there are to draw."""
        return 0 if self.images is None else self.images.valid.shape[1]


@dataclass(frozen=True, eq=False)
class Search:
    """What appearances along one path of one glass are found with.

    Attributes
    ----------
    probe : rays of the path's region.
    rect : pixels that the glass covers; what appears beside them is left out.
    max_gap_px : triangles whose edges miss the true image by more are split.
    importance : the path's part of the light, which limits how many vertices it is worth.
    """

    solver: Solver
    probe: Probe
    rect: tuple[int, int, int, int]
    max_gap_px: float
    importance: float

    def find(
        self, source: Source, before: Appearance | None = None, start: Appearance | None = None
    ) -> Appearance:
        """Where the source appears.

        Parameters
        ----------
        before : what was found before; only saves sorting the same edges again.
        start : what was found of the same moment in light of another colour; saves steps.
        """
        points, corners = source.snapshot.world(), source.corners
        triangles = Triangles.whole(points, corners)
        if before is not None and np.array_equal(corners, before.triangles.corners):
            triangles = before.triangles.moved(points)
        if self._passes_by(points):
            return self._unseen(source, triangles, corners, None)
        guess = None
        if start is not None and not start.refined and start.topology == source.snapshot.topology:
            guess = start.found
        found = self.solver.of_local(self._local(source), guess)
        images = self.solver.in_world(found)
        edges, near = self._edges(triangles, images)
        wrong = edges.wrong(near, self.max_gap_px).any() or not source.carried
        if (near.any() and wrong) or may_hide_more(images):
            refined = refine(
                triangles,
                self.solver.images,
                self.probe,
                self.solver.view,
                self.rect,
                self.max_gap_px,
                self.importance,
            )
            if not refined.visible:
                return self._unseen(source, triangles, corners, found)
            shown = self.solver(refined.triangles.points)
            images = self.solver.in_world(shown)
            # Of a refinement that stopped early, no more than middles of edges may be seen.
            if not images.valid.any():
                return self._unseen(source, triangles, corners, found)
            triangles, bound, found = refined.triangles, refined.bound_px, shown
            is_refined = True
        elif not near.any():
            return self._unseen(source, triangles, corners, found)
        else:
            bound, is_refined = edges.bound(near), False
        return Appearance(
            triangles,
            corners,
            is_refined,
            found,
            images,
            bound,
            source.snapshot.topology,
        )

    def _local(self, source: Source) -> np.ndarray:
        """The source's vertices in the glass's frame, without a detour by the world."""
        return source.snapshot.placed(self.solver.glass.from_world())

    def _passes_by(self, points: np.ndarray) -> bool:
        """A faint path is not searched for objects that its rays pass by."""
        if not len(points):
            return True
        return self.importance < FAINT and not self.probe.meets_box(points)

    def _unseen(self, source: Source, triangles, of_source, found) -> Appearance:
        topology = source.snapshot.topology
        return Appearance(triangles, of_source, False, found, None, 0.0, topology)

    def _edges(self, triangles: Triangles, images: Images) -> tuple[EdgeImages, np.ndarray]:
        """All edges, measured where they could miss, and which of them (E,) may be seen."""
        edges, triangle_edges = triangles.edges()
        view = self.solver.view
        found = EdgeImages(triangles.points, edges, images, view)
        near = found.near(triangle_edges, self.rect)
        asked = np.nonzero(found.doubtful(near, self.max_gap_px, may_hide_more(images)))[0]
        if len(asked):
            middles = triangles.points[edges[asked]].mean(axis=1)
            found.measure(asked, self.solver.images(middles))
            near = found.near(triangle_edges, self.rect)
        return found, near


def moment_of(solver: Solver, now: Snapshot, shape: Appearance) -> np.ndarray | None:
    """Where the vertices of ``shape`` are at another moment: (B, N, 3), slot for slot.

    For motion blur: the triangles stay. None where that cannot be: nothing is drawn, or the
    source has other vertices now.
    """
    if shape.images is None or shape.topology != now.topology:
        return None
    points = now.world()
    if shape.refined:
        points = shape.triangles.followed(points, shape.of_source).points
    found = solver(points, shape.found)
    images = solver.in_world(found)
    position = shape.images.position.copy()
    for slot, sheet in enumerate(shape.found.sheet):
        if sheet in found.sheet:
            position[slot] = images.position[found.sheet.index(sheet)]
    return position
