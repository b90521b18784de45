# SPDX-License-Identifier: GPL-3.0-or-later
"""What one 3D view shows through its glasses, as arrays: regions, and where sources appear.

While the eye moves, the regions are found on a coarse grid and images only followed; once it rests
both are found as for a render. Each piece keeps the stamp of what it was found from, so a still
scene costs one comparison, and an object that moves behind a still glass no region.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from .. import optics
from ..optics.axial import AxialGlass
from ..scene.changes import generation
from ..scene.names import RefractiveGlassError
from ..scene.read.glasses import Glass, glass_objects, is_mesh_glass, read_glass
from ..scene.read.sources import pieces, seen_through, source_objects
from ..scene.read.viewpoint import Viewpoint
from ..scene.update import MAX_TOLERANCE_PX, kept_paths
from ..scene.vertices.appearance import Appearance, Search, Solver, Source
from ..scene.vertices.copies import seen_vertices, used_slots
from ..scene.vertices.hull import faces_eye, first_face
from ..scene.vertices.path_keys import path_key
from ..scene.vertices.regions import Regions, path_regions, picture_rect
from ..scene.vertices.tessellation import Probe, Triangles, region_probe, view_pixels

COARSE_STEP = 4
"""Pixels a side for each ray of the regions while the eye moves."""
LIVE_SOLVE_PX = 1.0
"""How exactly images are solved while something moves."""
LIVE_EDGE_PX = 32.0
LIVE_VERTICES = 6_000
"""What is seen for the first time while something moves is cut into triangles of about this size
in the direct view, but into no more vertices; where it then bends is left for when all rests."""
LIVE_SHARE = 0.1
"""Paths with less of the glass's light are left for then, too."""

counters: Counter[str] = Counter()
"""Operations since start: ``updates``, ``solves``, ``regions``, ``ray_pixels``."""


@dataclass(eq=False)
class Shape:
    """One source as it appears along one path.

    Attributes
    ----------
    outer : stamps of glass and eye, and the tolerance. version : grows with every change.
    found : what is drawn. base : its coarse form, from which a moving eye follows.
    colours : (N, 3) float32, linear: the surface's own, where the direct picture does not show it.
    """

    outer: tuple
    source: Source
    found: Appearance
    base: Appearance | None
    colours: np.ndarray
    version: int


@dataclass(eq=False)
class Pane:
    """One glass as the view shows it.

    Attributes
    ----------
    rect : (x0, y0, x1, y1) pixels that it can cover.
    followed : the paths that carry enough of the light to be found while something moves.
    regions : on a grid of ``step`` pixels. version : grows with every change of the regions.
    hull : (V, 3) world vertices of the face towards the eye, and its triangles (F, 3).
    shapes : (path key, source's session uid) -> shape.
    """

    glass: Glass
    stamp: tuple
    paths: tuple[optics.LightPath, ...]
    followed: tuple[optics.LightPath, ...]
    rect: tuple[int, int, int, int]
    regions: Regions
    step: int
    hull: tuple[np.ndarray, np.ndarray]
    version: int
    shapes: dict[tuple[str, int], Shape] = field(default_factory=dict)
    probes: dict[optics.LightPath, Probe] = field(default_factory=dict)

    def of_path(self, path: optics.LightPath) -> Iterable[tuple[tuple[str, int], Shape]]:
        """The shapes that can be seen along the path."""
        for key, shape in self.shapes.items():
            is_now = shape.outer[:2] == self.stamp[:2]
            if key[0] == path_key(path) and is_now and shape.found.images is not None:
                yield key, shape

    def distance(self, view: Viewpoint) -> float:
        """Depth of the glass's origin: which of two glasses is in front."""
        return float(view.clip(self.glass.to_world[None, :3, 3])[0, 3])


class Picture:
    """What one view shows; :meth:`update` brings it up to date.

    Attributes
    ----------
    view : the eye that it was found for, None before the first.
    panes : glass name -> pane. exact : found as for a render.
    problems : one line for each glass or source that is left out.
    milliseconds : the last update took.
    """

    def __init__(self) -> None:
        self.view: Viewpoint | None = None
        self.panes: dict[str, Pane] = {}
        self.exact = False
        self.problems: list[str] = []
        self.milliseconds = 0.0
        self._stamp: tuple | None = None
        self._versions = 0

    def doubt(self) -> None:
        """Data-blocks may have been replaced (undo): the next update compares every vertex."""
        self._stamp = None

    def matches(self, scene: bpy.types.Scene, view: Viewpoint) -> bool:
        """Whether nothing changed since the last update."""
        return self._stamp == _stamp(scene, view)

    def update(
        self,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        depsgraph: bpy.types.Depsgraph,
        view: Viewpoint,
        *,
        exact: bool,
        space: bpy.types.SpaceView3D | None = None,
    ) -> None:
        """Find what changed since the last update; all of it, see :meth:`steps`."""
        for _ in self.steps(scene, view_layer, depsgraph, view, exact=exact, space=space):
            continue

    def steps(
        self,
        scene: bpy.types.Scene,
        view_layer: bpy.types.ViewLayer,
        depsgraph: bpy.types.Depsgraph,
        view: Viewpoint,
        *,
        exact: bool,
        space: bpy.types.SpaceView3D | None = None,
    ) -> Iterator[None]:
        """Find what changed since the last update, a piece a step.

        What is found is there at once; :attr:`exact` is set at the end. May be left off, and must
        be once :meth:`matches` says that something changed.

        Parameters
        ----------
        scene, view_layer : the user's (original) ones. depsgraph : evaluated.
        exact : as a render does; else fast, following the last answer.
        space : the view; objects hidden in it are neither glass nor source.
        """
        stamp = _stamp(scene, view)
        if stamp == self._stamp and (self.exact or not exact):
            return
        counters["updates"] += 1
        seconds = -time.perf_counter()
        problems: list[str] = []

        def visible(obj: bpy.types.Object) -> bool:
            return obj.visible_get(view_layer=view_layer, viewport=space)

        sources = [o for o in source_objects(view_layer, problems) if visible(o)]
        version = self._versions
        tasks = []
        panes = {}
        for obj in [o for o in glass_objects(view_layer) if visible(o) and not is_mesh_glass(o)]:
            try:
                glass = read_glass(obj, depsgraph)
                pane = self._pane(scene, glass, view, exact)
            except RefractiveGlassError as error:
                problems.append(str(error))
                continue
            panes[glass.name] = pane
            tasks.append((pane, seen_through(obj, sources)))
        # An evaluation that moved nothing leaves the picture as it is, and what refines it.
        kept = self.exact and not exact and self.panes.keys() == panes.keys()
        self.panes = panes
        self.view, self.exact, self._stamp = view, False, stamp
        self.problems = problems
        for pane, seen in tasks:
            for path in pane.paths if exact else pane.followed:
                search = self._search(scene, pane, path, view, exact)
                for obj in seen:
                    self._find_shape(depsgraph, pane, search, obj, exact)
                    self.milliseconds = 1e3 * (seconds + time.perf_counter())
                    if exact:
                        # The time that passes outside is not the search's.
                        seconds += time.perf_counter()
                        yield
                        seconds -= time.perf_counter()
            wanted = {obj.session_uid for obj in seen}
            for key in [key for key in pane.shapes if key[1] not in wanted]:
                del pane.shapes[key]
                self._versions += 1
        self.exact = exact or (kept and self._versions == version)
        self.milliseconds = 1e3 * (seconds + time.perf_counter())

    def _pane(self, scene, glass: Glass, view: Viewpoint, exact: bool) -> Pane:
        """The glass's pane with its regions up to date."""
        settings = scene.refractive_glass
        fresnel = settings.surface == "GLASS"
        stamp = (glass.stamp(), view.stamp(), fresnel, settings.min_weight)
        known = self.panes.get(glass.name)
        if known is not None and known.stamp == stamp and (known.step == 1 or not exact):
            known.glass = glass
            return known
        hull = _hull(glass, view)
        if exact or known is None or known.stamp[2:] != stamp[2:]:
            paths = kept_paths(scene, glass, view)
            if isinstance(glass.description, AxialGlass):
                # A cup's mirrors take long to search, for faint images: what they lack others give.
                paths = tuple(p for p in paths if "R" not in p.events) or paths
        else:
            paths = known.paths
        step = 1 if exact else COARSE_STEP
        grid = view
        if step > 1:
            size = tuple(max(1, n // step) for n in view.size)
            grid = replace(view, size=size, window=(0, 0, *size))
        regions = path_regions(glass, grid, paths, fresnel=fresnel, smooth=exact)
        counters["regions"] += 1
        counters["ray_pixels"] += regions.hit.size
        self._versions += 1
        mean = regions.weights[:, regions.hit].sum(axis=1) / max(1, regions.hit.sum())
        pane = Pane(
            glass,
            stamp,
            paths,
            tuple(p for p, m in zip(paths, mean, strict=True) if m >= min(LIVE_SHARE, mean.max())),
            picture_rect(glass, view),
            regions,
            step,
            hull,
            self._versions,
        )
        if known is not None:
            pane.shapes = known.shapes
            pane.probes = known.probes if known.stamp == stamp else {}
        return pane

    def _find_shape(self, depsgraph, pane: Pane, search: Search, obj, exact: bool) -> None:
        """Where a source appears along a path, unless that is known."""
        key = (path_key(search.solver.path), obj.session_uid)
        known = pane.shapes.get(key)
        outer = (*pane.stamp[:2], search.max_gap_px)
        still = known is not None and known.outer[:2] == outer[:2]
        usable = still and (not exact or (known.outer == outer and known.found.exact))
        with pieces(obj, depsgraph) as parts:
            source = Source(parts, True, {})
            if not (usable and source.unchanged(known.source)):
                base = known.base if known is not None else None
                if exact:
                    found = search.exactly(source, known.found if known is not None else None)
                else:
                    found = follow(search, source, known.found if still else base)
                    base = base if still else found
                counters["solves"] += 1
                colours = _colours(parts, known, found, search.solver.view)
                self._versions += 1
                pane.shapes[key] = Shape(outer, source, found, base, colours, self._versions)
            source.close()

    def _search(self, scene, pane: Pane, path, view: Viewpoint, exact: bool) -> Search:
        """What images along the path are found with; its probe stays while eye and glass do."""
        tolerance = scene.refractive_glass.tolerance_px
        importance = max(pane.regions.importance(path), 1e-3)
        probe = pane.probes.get(path)
        if probe is None:
            probe = pane.probes[path] = region_probe(pane.glass, view, path, pane.rect)
        return Search(
            Solver(pane.glass, path, view, 0.1 * tolerance if exact else LIVE_SOLVE_PX),
            probe,
            pane.rect,
            min(tolerance / importance, MAX_TOLERANCE_PX) if exact else 0.0,
            importance,
        )


def follow(search: Search, source: Source, before: Appearance | None) -> Appearance:
    """Where the source appears now, of the triangles found ``before`` the eye or it moved.

    One solve and no search for what else there is to see: for that, nothing must move.
    """
    solver = search.solver
    points = source.snapshot.world()
    topology = source.snapshot.topology
    guess = None
    if before is not None and before.topology == topology and before.images is not None:
        triangles, corners, refined = before.triangles, before.of_source, before.refined
        triangles = triangles.followed(points, corners) if refined else triangles.moved(points)
        guess = before.found
    else:
        corners = source.corners()
        triangles = Triangles.whole(points, corners)
        refined = False
        if len(points) and search.probe.meets_box(points):
            triangles = cut(triangles, solver.view)
            refined = len(triangles.points) > len(points)
    found = images = None
    if len(triangles.points) and (guess is not None or search.probe.meets_box(points)):
        found = solver(triangles.points, guess)
        images = solver.in_world(found) if found.valid.any() else None
    return Appearance(
        triangles, corners, refined, found, images, 0.0, np.empty((0, 2), int), topology, False
    )


def cut(triangles: Triangles, view: Viewpoint) -> Triangles:
    """Triangles cut until those in the picture have short edges there; nothing is solved."""
    size = np.array(view.size, float)
    for _ in range(24):
        edges, triangle_edges = triangles.edges()
        # Edges that pass the eye have no length: their parts do.
        places = np.clip(view_pixels(view, triangles.points), -size, 2 * size)
        ends = places[edges]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        long = length > LIVE_EDGE_PX
        inside = (ends.max(axis=1) > -0.1 * size) & (ends.min(axis=1) < 1.1 * size)
        inside = inside.all(axis=1)[triangle_edges].any(axis=1)
        chosen = np.zeros(len(edges), bool)
        # The longest edge alone: halves stay well shaped.
        longest = length[triangle_edges].argmax(axis=1)
        longest = triangle_edges[np.arange(len(triangle_edges)), longest]
        chosen[longest[inside & long[longest]]] = True
        if not chosen.any() or len(triangles.points) + chosen.sum() > LIVE_VERTICES:
            break
        triangles = triangles.split(edges, triangle_edges, chosen)
    return triangles


def _stamp(scene: bpy.types.Scene, view: Viewpoint) -> tuple:
    settings = scene.refractive_glass
    return (
        scene.session_uid,
        generation(scene),
        view.stamp(),
        settings.surface,
        settings.min_weight,
        settings.tolerance_px,
    )


def _hull(glass: Glass, view: Viewpoint) -> tuple[np.ndarray, np.ndarray]:
    eye = view.eye_for(glass)
    vertices, faces = first_face(glass, eye)
    faces = faces[faces_eye(vertices, faces, eye)]
    if faces.shape[1] == 4:
        faces = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return glass.points_to_world(vertices), faces


def _colours(parts, known: Shape | None, found: Appearance, view: Viewpoint) -> np.ndarray:
    """(N, 3) the material's viewport colour at each vertex, as a lamp at the eye shows it."""
    points, corners = found.triangles.points, found.triangles.corners
    if known is not None and known.found.triangles.corners is corners:
        return known.colours
    if not len(corners) or found.images is None:
        return np.full((len(points), 3), 0.8, np.float32)
    of_triangle = np.concatenate([_material_colours(part.mesh) for part in parts])
    base = np.full((len(points), 3), 0.8)
    base[corners.ravel()] = np.repeat(of_triangle[found.triangles.origin], 3, axis=0)
    a, b, c = (points[corners[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normal = np.stack(
        [np.bincount(corners.ravel(), np.repeat(across[:, k], 3), len(points)) for k in range(3)],
        axis=1,
    )
    length = np.linalg.norm(normal, axis=1)
    facing = np.abs(normal @ view.forward) / np.where(length > 0, length, 1.0)
    return (base * (0.3 + 0.7 * facing[:, None])).astype(np.float32)


def _material_colours(mesh: bpy.types.Mesh) -> np.ndarray:
    """(T, 3) viewport colours of the mesh's triangles."""
    mesh.calc_loop_triangles()
    index = np.zeros(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("material_index", index)
    slots = [(0.8, 0.8, 0.8) if m is None else m.diffuse_color[:3] for m in mesh.materials]
    table = np.array(slots or [(0.8, 0.8, 0.8)])
    return table[np.clip(index, 0, len(table) - 1)]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A shape as the GPU takes it.

    Attributes
    ----------
    clip : (M, 4) float32 homogeneous coordinates of where the vertices appear, over the rectangle.
    place : (M, 4) float32 x, y, w, depth of where they are (see ``Viewpoint.clip``).
    colours : (M, 3) float32. corners : (K, 3) int32.
    """

    clip: np.ndarray
    place: np.ndarray
    colours: np.ndarray
    corners: np.ndarray


def drawn(shape: Shape, view: Viewpoint, rect: tuple[int, int, int, int]) -> Drawn:
    """The triangles to draw, one image slot after another."""
    found = shape.found
    count = len(found.triangles.points)
    slots = used_slots(found.images.valid)
    matrix = rect_matrix(view, rect)
    clip, corners = [], []
    for number, slot in enumerate(slots):
        clip.append(affine4(found.images.position[slot], matrix))
        seen = seen_vertices(found, slot, view)
        kept = found.triangles.corners
        if (seen < 1).any():
            # A face stays while any of its corners has an image: the others lie on the fold.
            kept = kept[seen[kept].sum(axis=1) > 0]
        corners.append(kept + number * count)
    return Drawn(
        np.concatenate(clip),
        np.tile(view.clip(found.triangles.points).astype(np.float32), (len(slots), 1)),
        np.tile(shape.colours, (len(slots), 1)),
        np.ascontiguousarray(np.concatenate(corners), np.int32),
    )


def rect_matrix(view: Viewpoint, rect: tuple[int, int, int, int]) -> np.ndarray:
    """(4, 4) from the world to clip coordinates over a pixel rectangle of the view."""
    matrix = view.projection @ view.to_camera
    w = matrix[3].copy()
    for axis in range(2):
        low, high = rect[axis], rect[axis + 2]
        size = view.size[axis]
        matrix[axis] = (size * (matrix[axis] + w) - (low + high) * w) / (high - low)
    return matrix


def affine4(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (N, 3) times a (4, 4) matrix: (N, 4) float32."""
    return (points @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32)


def weight_planes(pane: Pane) -> list[np.ndarray]:
    """(h, w, 2) float32 planes over the regions' grid: a weight times how far it is known.

    One a path; then what is left over and shows the surroundings; then what stays dark. On a coarse
    grid the weights are carried a little beyond the outline, which is finer than the grid.
    """
    weights = pane.regions.weights
    left = np.clip(1.0 - weights.sum(axis=0), 0.0, 1.0)[None]
    nothing = np.zeros_like(left)
    is_fresnel = pane.stamp[2]
    planes = np.concatenate((weights, left, nothing) if is_fresnel else (weights, nothing, left))
    known = np.ones(planes.shape[1:], np.float32)
    if pane.step > 1:
        known = pane.regions.hit.astype(np.float32)
        planes = planes * known
        for _ in range(2):
            beyond = known == 0
            planes = np.where(beyond, _around(planes), planes)
            known = np.where(beyond, _around(known[None])[0], known)
    return [np.stack((plane, known), axis=-1).astype(np.float32) for plane in planes]


def _around(values: np.ndarray) -> np.ndarray:
    """The sum over each pixel and its eight neighbours; (P, h, w)."""
    padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
    height, width = values.shape[1:]
    return sum(padded[:, j : j + height, i : i + width] for j in range(3) for i in range(3))
