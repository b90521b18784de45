# SPDX-License-Identifier: GPL-3.0-or-later
"""The one door: whatever changed, ``update`` brings copies, masks and layers up to date.

Two steps, because Blender allows data-blocks to be made in some places only:

* :func:`prepare` makes own scenes, copies and nodes match the scene's glasses and sources. Called
  by operators, timers and before a render starts.
* :func:`update` solves and writes arrays. It makes no data-block and may run in a frame-change
  handler of a render.

Both compare with what stands and do only what differs; ``counters`` tells how much that was.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from .. import optics
from ..optics.axial import AxialGlass
from .bake.playback import bake_problems, is_held
from .borders import border_pixels_of, border_rect, border_zone, has_borders
from .build.compositing import (
    can_insert,
    has_group,
    insert_group,
    remove_group,
    remove_stray_nodes,
    write_cover,
    write_kernels,
    write_weights,
)
from .build.layers import (
    Layers,
    Pane,
    build_layers,
    find_layers,
    match_lights,
    match_settings,
    remove_layers,
    remove_leftovers,
    source_of,
)
from .build.texture_coordinates import coordinates, dress, dressed_coordinates, remove_unused
from .changes import generation
from .environment import (
    is_uniform,
    shows_objects,
    surroundings,
    write_curtain,
    write_ray_screen,
    write_screen,
)
from .memory import Memory, Status, Step, counters, forget, memory_of, status
from .names import RefractiveGlassError
from .ray_screen import SLOTS, RayScreen, Zone, build_ray_screens, met_pixels, widened
from .read.glasses import (
    Glass,
    as_body,
    banded_key,
    glass_modifier,
    glass_objects,
    read_glass,
    read_glasses,
    unbounded,
)
from .read.modifier_inputs import write_input
from .read.sources import (
    Snapshot,
    is_carried,
    pieces,
    reaches_into,
    seen_through,
    source_objects,
)
from .read.things import body_corners, may_hide, obstacle_of, within
from .read.visibility import rendered_layer
from .read.viewpoint import Viewpoint, read_viewpoint
from .screen import FINEST, build_screen
from .vertices.appearance import Appearance, Search, Solver, Source
from .vertices.chains import path_stamp
from .vertices.copies import write_copy, write_true_mesh
from .vertices.hull import faces_eye, first_face
from .vertices.motion_blur import frame_time, keep_moment
from .vertices.neighbours import among, chained_paths, glass_box
from .vertices.panes import kept_paths, open_paths, standing_panes, thin_paths
from .vertices.path_keys import Path, path_key
from .vertices.regions import Regions, path_regions, picture_rect
from .vertices.tessellation import Probe, region_probe

__all__ = [
    "Status",
    "Step",
    "counters",
    "effective_shading",
    "finished",
    "forget",
    "free_leftovers",
    "kept_paths",
    "memory_of",
    "prepare",
    "remove",
    "status",
    "update",
    "updating",
]

MAX_TOLERANCE_PX = 8.0
BEHIND_SCREENS, WIDE = 1.02, 1e3
"""Of the screens' depth: where the curtain hangs, and how wide it is in a perspective view."""
BEYOND_CURTAIN = 1.05
"""Of the screens' depth: from where rays run on that no glass bends."""
NEAREST = 1.1
"""Of the camera's clip start: how far before it stands what no object may be nearer than."""


def effective_shading(scene: bpy.types.Scene) -> str:
    """``TRUE`` or ``DISPLACED``: Workbench has no light to look up, so it draws copies only."""
    if scene.render.engine == "BLENDER_WORKBENCH":
        return "DISPLACED"
    return scene.refractive_glass.shading


def prepare(
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph,
    *,
    strict: bool = False,
    rendering: bool = False,
) -> None:
    """Make own scenes, copies and the compositor's node group match the scene.

    Parameters
    ----------
    strict : a scene without a glass is an error, not an order to clean up.
    rendering : a render has begun; what it may hold is not freed before the next time.

    Raises
    ------
    RefractiveGlassError
        No camera, a camera or a glass that cannot be computed; nothing is changed then.
    """
    if is_held(scene):
        status(scene).problems = bake_problems(scene, effective_shading(scene))
        return
    if scene.library is not None:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" is linked from a library: make it local (Object > Relations)'
        )
    settings = scene.refractive_glass
    for name in ("min_weight", "tolerance_px"):
        if not np.isfinite(getattr(settings, name)):
            label = settings.bl_rna.properties[name].name
            raise RefractiveGlassError(
                f'{label} of scene "{scene.name}" is no number: enter it anew (Render Properties)'
            )
    view_layer = rendered_layer(scene)
    glasses = glass_objects(view_layer)
    if scene.refractive_glass.shading == "TRUE":
        from .rays import true
        read_viewpoint(scene, depsgraph)
        true.prepare(scene)
        for obj in glasses:
            _show_mesh(scene, obj, False)
        return
    if strict and not glasses:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" has no refractive glass: add one (Add > Mesh > Refractive Glass)'
        )
    linked = [obj for obj in glasses if not obj.is_editable]
    if linked:
        raise RefractiveGlassError(
            f'Glass "{linked[0].name}" is linked from a library: make it local (Object > Relations)'
        )
    if not settings.enabled or not glasses:
        remove(scene, rendering=rendering)
        return
    view = read_viewpoint(scene, depsgraph)
    if not can_insert(scene):
        raise RefractiveGlassError(
            f'The compositor tree of scene "{scene.name}" has no Render Layers node of it: add one'
        )
    problems: list[str] = []
    sources = source_objects(view_layer, problems)
    nearness: list[tuple[float, list[Pane]]] = []
    read: list[tuple[bpy.types.Object, Glass, list]] = []
    around = surroundings(scene, effective_shading(scene))
    for obj in glasses:
        try:
            glass = read_glass(obj, depsgraph)
            # A cup's rays go past other glasses: through several, paths and their copies do.
            by_rays = shows_objects(around) and isinstance(glass.description, AxialGlass)
            if by_rays and _is_seen_alone(glass, view, depsgraph):
                read.append((obj, glass, []))
                continue
            kept = [(banded, kept_paths(scene, banded, view)) for banded in glass.bands()]
        except RefractiveGlassError as error:
            problems.append(str(error))
            continue
        read.append((obj, glass, kept))
    # Light of all colours takes the same paths, nearly; a cup that rays show has none.
    alone = {glass.name: kept[0][1] for _, glass, kept in read if kept}
    for obj, glass, kept in read:
        seen = tuple(seen_through(obj, sources))
        if not kept:
            slots = SLOTS[scene.refractive_glass.surface]
            panes = [Pane(obj, (), seen, band=banded.band, rays=slots) for banded in glass.bands()]
            nearness.append((_depth(glass, view), panes))
            continue
        contents = tuple(s for s in seen if reaches_into(glass, s, depsgraph))
        placed = among(glass, [other for _, other, _ in read], seen, depsgraph, problems)
        beyond = [s for s in seen if any(reaches_into(o, s, depsgraph) for o in placed.others)]
        bands: list[Pane] = []
        nearness.append((_depth(glass, view), bands))
        for (banded, paths), among_others in zip(kept, placed.bands(), strict=True):
            chains = chained_paths(scene, among_others, view, alone)
            bare: frozenset = frozenset()
            if isinstance(glass.description, AxialGlass):
                if shows_objects(around):
                    thin = thin_paths(scene, banded, view)
                    bare = frozenset((*thin, *(path for path in paths if "R" in path.events)))
                    paths += thin
                if contents:
                    paths += open_paths(scene, banded, view)
            traced = frozenset(p for p in chains if not _has_copies(banded, p, view))
            pane = Pane(
                obj,
                paths + chains,
                seen,
                contents,
                bare,
                banded.band,
                tuple(beyond),
                traced,
            )
            empty = (p for p in chains if around and not pane.carried(p, around))
            bands.append(replace(pane, bare=bare.union(empty)))
        if shows_objects(around) and has_borders(glass):
            slots = SLOTS[scene.refractive_glass.surface]
            rays = [pane.border_pane(around, slots) for pane in bands]
            bands[:] = [*(replace(pane, has_borders=True) for pane in bands), *rays]
    # Each glass goes over those behind it.
    nearness.sort(key=lambda pair: -pair[0])
    panes = [pane for _, bands in nearness for pane in bands]
    if not panes:
        raise RefractiveGlassError(" ".join(problems))
    if not any(pane.sources for pane in panes) and is_uniform(scene.world):
        raise RefractiveGlassError(
            f'Glass "{panes[0].glass.name}": nothing can be seen through it; add a mesh that is '
            "visible in renders (and in its Seen Through collection)"
        )
    computed = {pane.glass for pane in panes}
    for obj in glasses:
        _show_mesh(scene, obj, obj not in computed)
    shading, side = effective_shading(scene), int(settings.lookup_samples)
    layers, anew = build_layers(scene, panes, around)
    filled = [bool(pane.contents) + 2 * bool(pane.beyond) for pane in panes]
    wiring = f"{shading} {side} {around} {filled}"
    _dress_copies(layers, depsgraph)
    memory_of(scene).status.problems = problems
    covered = _covered(scene, panes, depsgraph, view)
    match_settings(scene, layers, covered, shading == "TRUE")
    match_lights(layers, depsgraph)
    if anew or not has_group(scene) or layers.lookup.get("refractive_glass_wiring") != wiring:
        counters["structures"] += 1
        insert_group(scene, layers, panes, shading == "TRUE", side, around)
        layers.lookup["refractive_glass_wiring"] = wiring
        memory = memory_of(scene)
        memory.regions.clear()
        memory.ray_screens.clear()
        memory.copies.clear()
    memory_of(scene).still = None
    write_kernels()
    if not rendering:
        free_leftovers()


def _is_seen_alone(glass: Glass, view: Viewpoint, depsgraph) -> bool:
    """Whether no other glass that can be computed may cover a pixel that this one can cover."""
    rect = picture_rect(glass, view)
    for other in read_glasses(depsgraph, []):
        if other.name == glass.name:
            continue
        try:
            if _overlap(rect, picture_rect(other, view)):
                return False
        except RefractiveGlassError:
            # The eye is in its wall: it is left out, and said so where it is read.
            continue
    return True


def _overlap(one, other) -> bool:
    """Whether two pixel rectangles, half open, have a pixel in common."""
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    return bool((low < high).all())


def _has_copies(glass: Glass, path: optics.ChainedPath, view: Viewpoint) -> bool:
    """Whether displaced copies can show what is seen through two glasses."""
    description = unbounded(glass.description)
    return not view.is_parallel and optics.has_chained_images(description, path.first)


def remove(scene: bpy.types.Scene, *, rendering: bool = False) -> None:
    """Remove all that was made for the scene's glasses, and only that; renders show them.

    Parameters
    ----------
    rendering : a render has begun; what it may hold is not freed before the next time.
    """
    if scene.library is not None:
        return
    remove_group(scene)
    remove_layers(scene)
    forget(scene)
    if not rendering:
        free_leftovers()
    for obj in scene.objects:
        if obj.type == "MESH" and obj.is_editable and glass_modifier(obj) is not None:
            _show_mesh(scene, obj, True)


def free_leftovers() -> None:
    """Remove what nothing needs any more, in any scene. Not while a render goes on."""
    remove_stray_nodes()
    remove_leftovers()


def withdraw(scene: bpy.types.Scene) -> bool:
    """Take out of the file what :func:`prepare` can make again, and tell whether there was any.

    Without the extension it would be a burden: stale layers, and a hole where the glass is. What
    is baked stays.
    """
    if is_held(scene) or scene.library is not None:
        return False
    stood = find_layers(scene) is not None
    known = memory_of(scene)
    remove(scene)
    memory = memory_of(scene)
    memory.paths, memory.chains = known.paths, known.chains
    memory.status = known.status
    return stood


def _show_mesh(scene: bpy.types.Scene, glass: bpy.types.Object, shown: bool) -> None:
    """Let renders show the glass's own mesh, unless another scene computes the same glass."""
    others = (s for s in bpy.data.scenes if s != scene and glass.name in s.objects)
    if not shown or not any(find_layers(s) is not None for s in others):
        write_input(glass_modifier(glass), "Show in Render", shown)


def update(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, *, exact: bool | None = None
) -> Status:
    """Solve what changed and write it into what :func:`prepare` made.

    Parameters
    ----------
    scene : the user's (original) scene.
    depsgraph : evaluated; of a render or of the viewport.
    exact : look at every edge and start from nothing, so that the answer depends on this moment
        alone; else follow from the last answer. By default a render is exact.
    """
    return finished(updating(scene, depsgraph, exact=exact))


def finished(steps: Generator[Step, None, Status]) -> Status:
    """What an update ends with that is not asked to stop between."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def updating(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, *, exact: bool | None = None
) -> Generator[Step, None, Status]:
    """:func:`update` in steps, one a copy: each may be the last, what stands is then what it was.

    Yields before every copy; returns the status.
    """
    if scene.refractive_glass.shading == "TRUE":
        from .rays import true
        if depsgraph.mode == "RENDER":
            return true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
        return memory_of(scene).status
    layers = find_layers(scene)
    memory = memory_of(scene)
    if layers is None or not scene.refractive_glass.enabled or is_held(scene):
        return memory.status
    started = time.perf_counter()
    is_render = depsgraph.mode == "RENDER"
    exact = is_render if exact is None else exact
    view = read_viewpoint(scene, depsgraph)
    blurred = is_render and scene.render.use_motion_blur
    if blurred and memory.centre not in (None, frame_time(scene)):
        keep_moment(scene, memory, layers, view, depsgraph)
        return memory.status
    # A render evaluates by itself, and nobody tells of what.
    still = None if is_render else (generation(scene), view.stamp(), _settings_stamp(scene), exact)
    if still is not None and memory.still == still:
        return memory.status
    problems: list[str] = []
    panes = standing_panes(scene, layers, depsgraph, problems)
    copies = layers.copies()
    rects = []
    done = 0
    depths = _screen_depths(scene, panes, view)
    for pane, glass in panes:
        if pane.rays:
            # Of use to renders alone; 3D views show cups and borders in their own way.
            if exact:
                yield Step(done / max(1, len(copies)), f"Rays of {pane.key}")
                screen = _update_rays(
                    scene, memory, pane, glass, view, layers, depsgraph, depths[glass.name]
                )
                if screen is not None:
                    rects.append(screen.rect)
            continue
        try:
            regions = _update_regions(scene, memory, pane, glass, view, layers, depths[glass.name])
        except RefractiveGlassError as error:
            problems.append(str(error))
            continue
        rects.append(regions.rect)
        for path in pane.paths:
            task = _Task(scene, memory, pane, glass, path, view, regions, depsgraph, exact)
            for label in task.updating(copies):
                yield Step(done / max(1, len(copies)), label)
                done += 1
    _update_occluders(layers, memory, depsgraph)
    if is_render:
        true_shading = effective_shading(scene) == "TRUE"
        match_settings(scene, layers, _union(rects), true_shading)
        match_lights(layers, depsgraph)
    by_copies = (path_key(p) for pane, _ in panes for p in pane.paths)
    by_rays = (
        path_key(path)
        for pane, _ in panes
        if pane.rays and not pane.borders and pane.key in memory.ray_screens
        for path in memory.ray_screens[pane.key][1].paths
    )
    shapes = [shape for key, (_, _, shape) in memory.copies.items() if key in copies]
    memory.status = Status(
        vertices=sum(shape.vertices for shape in shapes),
        paths=tuple(dict.fromkeys((*by_copies, *by_rays))),
        milliseconds=1e3 * (time.perf_counter() - started),
        bound_px=max((shape.bound_px for shape in shapes), default=0.0),
        problems=problems or memory.status.problems,
    )
    memory.still = still
    if blurred:
        memory.centre = frame_time(scene)
        memory.moments[memory.centre] = {
            key: shape.images.position
            for key, (_, _, shape) in memory.copies.items()
            if shape.images is not None
        }
    return memory.status


def _settings_stamp(scene: bpy.types.Scene) -> tuple:
    settings = scene.refractive_glass
    return (
        settings.surface,
        settings.tolerance_px,
        settings.lookup_samples,
        effective_shading(scene),
        scene.camera.name,
    )


def _dress_copies(layers: Layers, depsgraph) -> None:
    """Materials that read the place get the copies' true one."""
    of_source: dict[bpy.types.Object, list[bpy.types.Object]] = {}
    for copy in layers.copies().values():
        of_source.setdefault(source_of(copy), []).append(copy)
    for source, copies in of_source.items():
        dress(copies, source, depsgraph)
    remove_unused()


def _screen_depths(scene, panes, view: Viewpoint) -> dict[str, float]:
    """Metres before the camera to the screens of each glass: those of the nearest come first.

    Rays of all glasses share view layers: a nearer glass hides what is behind it there too.
    """
    nearest = NEAREST * scene.camera.data.clip_start
    begins = {
        glass.name: float(((glass_box(glass) - view.eye) @ view.forward).min())
        for _, glass in panes
    }
    order = sorted(begins, key=begins.get)
    step = (BEHIND_SCREENS - 1.0) / (len(order) + 1)
    return {name: nearest * (1.0 + rank * step) for rank, name in enumerate(order)}


def _update_regions(
    scene, memory, pane: Pane, glass: Glass, view, layers: Layers, depth: float
) -> Regions:
    fresnel = scene.refractive_glass.surface == "GLASS"
    around = surroundings(scene, effective_shading(scene))
    stamp = (glass.seen_stamp(), view.stamp(), pane.paths, fresnel, around, depth)
    known = memory.regions.get(pane.key)
    if known is not None and known[0] == stamp:
        return known[1]
    dozens = frozenset(path for path in pane.bare if path.interfaces is not None)
    smooth = not pane.has_borders
    regions = path_regions(glass, view, pane.paths, fresnel=fresnel, smooth=smooth, bare=dozens)
    counters["masks"] += 1
    counters["mask_pixels"] += regions.hit.size
    write_weights(scene, pane, glass, regions, view)
    _write_hull(layers.hull(pane.key), glass, view)
    if around and pane.screened:
        finest = 1.0 if pane.has_borders else 1.0 / FINEST
        screen = build_screen(
            glass, view, regions, fresnel=fresnel, numbers=pane.screened, finest=finest
        )
        mesh = layers.screen(pane.key, False if pane.has_borders else None)
        write_screen(mesh, view, screen, depth)
        _write_curtain(scene, layers, view)
    memory.regions[pane.key] = (stamp, regions)
    return regions


def _update_rays(
    scene,
    memory,
    pane: Pane,
    glass: Glass,
    view: Viewpoint,
    layers: Layers,
    depsgraph,
    depth: float,
) -> RayScreen | None:
    """The screen of a cup or of borders, unless nothing changed that its rays could meet.

    None for borders of a glass that cannot be computed.
    """
    settings = scene.refractive_glass
    fresnel = settings.surface == "GLASS"
    if pane.borders:
        parts = _find_borders(memory, glass, view, fresnel)
        if not parts:
            return None
        zone = border_zone(glass, view, parts, memory.regions[glass.key][1].paths, pane.paths)
        glass, rect, asked = as_body(glass), zone.rect, zone.stamp()
    else:
        rect = picture_rect(glass, view)
        zone = asked = None
    sources = source_objects(scene.view_layers[0])
    seen = set(seen_through(pane.glass, sources))
    ends = float(view.clip(body_corners(glass))[:, 3].max())
    front, held = [], []
    for source in sources:
        thing = obstacle_of(source, depsgraph)
        if thing is not None and may_hide(thing, view, rect, ends):
            front.append(thing)
        if thing is not None and source in seen and within(thing, glass):
            held.append(thing)
    stamps = [[thing.stamp for thing in things] for things in (front, held)]
    least = settings.min_weight
    stamp = (glass.seen_stamp(), view.stamp(), fresnel, least, stamps, pane.rays, asked, depth)
    known = memory.ray_screens.get(pane.key)
    if known is not None and known[0] == stamp:
        return known[1]
    if zone is None:
        cover = widened(met_pixels(glass, view, rect))
        zone = Zone(rect, cover, np.zeros_like(cover))
    screen, mirrors = build_ray_screens(
        glass,
        view,
        zone,
        front,
        held,
        fresnel=fresnel,
        min_weight=least,
        depth=BEYOND_CURTAIN * NEAREST * scene.camera.data.clip_start,
        slots=pane.rays,
    )
    counters["masks"] += 1
    counters["mask_pixels"] += screen.cover.size
    write_cover(scene, pane, screen, view)
    write_ray_screen(layers.screen(pane.key), view, screen, depth)
    if mirrors is not None:
        mesh = layers.screen(banded_key(pane.glass.name, pane.band), True)
        write_ray_screen(mesh, view, mirrors, depth)
    _write_curtain(scene, layers, view)
    # The mesh has the rays now; kept here as well they would take hundreds of megabytes.
    screen = screen.without_rays()
    memory.ray_screens[pane.key] = (stamp, screen)
    return screen


def _find_borders(memory: Memory, glass: Glass, view: Viewpoint, fresnel: bool):
    """What :func:`borders.border_pixels_of` finds in light of each colour that was looked at."""
    found = []
    for key in {glass.key, *(banded_key(glass.name, band) for band in optics.LINES)}:
        if key not in memory.regions:
            continue
        stamp, regions = memory.regions[key]
        known = memory.borders.get(key)
        if known is None or known[0] != stamp:
            known = (stamp, border_pixels_of(glass, view, regions, fresnel=fresnel))
            memory.borders[key] = known
        found.append(known[1])
    return found


def _write_curtain(scene, layers: Layers, view: Viewpoint) -> None:
    depth = NEAREST * scene.camera.data.clip_start
    wide = 2.0 * scene.camera.data.ortho_scale if view.is_parallel else WIDE * depth
    write_curtain(layers.curtain().data, BEHIND_SCREENS * depth, wide)


def _write_hull(hull: bpy.types.Object, glass: Glass, view: Viewpoint) -> None:
    eye = view.eye_for(glass)
    vertices, faces = first_face(glass, eye)
    faces = faces[faces_eye(vertices, faces, eye)]
    mesh = hull.data
    mesh.clear_geometry()
    mesh.from_pydata(glass.points_to_world(vertices).tolist(), [], faces.tolist())
    mesh.update()


@dataclass(eq=False)
class _Task:
    """The copies of one light path of one glass, to be brought up to date."""

    scene: bpy.types.Scene
    memory: Memory
    pane: Pane
    glass: Glass
    path: Path
    view: Viewpoint
    regions: Regions
    depsgraph: bpy.types.Depsgraph
    exact: bool

    def updating(self, copies) -> Iterator[str]:
        """Find where each source appears, unless nothing changed, and write it.

        Yields before each of them what it is.
        """
        importance = max(self.regions.importance(self.path), 1e-3)
        # What carries little light may lie less exactly: the error in the picture is the product.
        tolerance = min(self.scene.refractive_glass.tolerance_px / importance, MAX_TOLERANCE_PX)
        looked_up = effective_shading(self.scene) == "TRUE"
        rect = self.regions.rect
        outer = (
            path_stamp(self.glass, self.path),
            self.view.stamp(),
            tolerance,
            rect,
            looked_up,
        )
        search = None
        for key, copy in copies.items():
            if key[:2] != (self.pane.key, path_key(self.path)):
                continue
            original = source_of(copy)
            yield f"{original.name} along {self.path}"
            with pieces(original, self.depsgraph) as parts:
                extra = coordinates(parts, dressed_coordinates(copy))
                source = Source(parts, is_carried(original), extra)
                stamp, known, before = self.memory.copies.get(key, (None, None, None))
                usable = stamp == outer and (before.exact or not self.exact)
                if not (usable and source.unchanged(known)):
                    search = search or Search(
                        self._solver(), self._probe(), rect, tolerance, importance
                    )
                    if self.exact:
                        shape = search.exactly(source, before, self._of_last_band(key))
                    else:
                        shape = search.live(source, before)
                    write_copy(
                        copy,
                        source,
                        shape,
                        self.view,
                        looked_up=looked_up,
                        held=self.path.open,
                        before=before,
                    )
                    counters["solves"] += 1
                    counters["copies"] += 1
                    self.memory.copies[key] = (outer, source, shape)
                source.close()

    def _of_last_band(self, key: tuple[str, str, int]) -> Appearance | None:
        """Where the same appears in light of the last colour, a start for this one."""
        bands = list(optics.LINES)
        if self.glass.band not in bands[1:]:
            return None
        last = bands[bands.index(self.glass.band) - 1]
        known = self.memory.copies.get((banded_key(self.glass.name, last), *key[1:]))
        return None if known is None else known[2]

    def _solver(self) -> Solver:
        settings = self.scene.refractive_glass
        return Solver(self.glass, self.path, self.view, 0.1 * settings.tolerance_px, last=True)

    def _probe(self) -> Probe:
        """The path's rays; they stay while glass and eye do."""
        stamp = (path_stamp(self.glass, self.path), self.view.stamp(), self.regions.rect)
        known = self.memory.probes.get((self.pane.key, self.path))
        if known is None or known[0] != stamp:
            found = region_probe(self.glass, self.view, self.path, self.regions.rect)
            known = self.memory.probes[self.pane.key, self.path] = (stamp, found)
        return known[1]


def _update_occluders(layers: Layers, memory: Memory, depsgraph) -> None:
    """Sources that Geometry Nodes cannot take stand at their true places as meshes of their own."""
    for uid, occluder in layers.occluders().items():
        source = source_of(occluder)
        if is_carried(source):
            continue
        with pieces(source, depsgraph) as parts:
            snapshot = Snapshot.of(parts)
            known = memory.occluders.get(uid)
            if known is None or not snapshot.same(known):
                write_true_mesh(occluder, parts)
                memory.occluders[uid] = snapshot


def _depth(glass: Glass, view: Viewpoint) -> float:
    """How far before the camera a glass begins, metres."""
    vertices, _ = first_face(glass, view.eye_for(glass))
    return float(((glass.points_to_world(vertices) - view.eye) @ view.forward).min())


def _covered(scene, panes: list[Pane], depsgraph, view: Viewpoint) -> tuple[int, int, int, int]:
    rects = []
    for pane in panes:
        glass = read_glass(pane.glass, depsgraph)
        rects.append(border_rect(glass, view) if pane.borders else picture_rect(glass, view))
    return _union(rects)


def _union(rects) -> tuple[int, int, int, int]:
    rects = [r for r in rects if r[0] < r[2] and r[1] < r[3]]
    if not rects:
        return (0, 0, 1, 1)
    low = np.min([r[:2] for r in rects], axis=0)
    high = np.max([r[2:] for r in rects], axis=0)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
