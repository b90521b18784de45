# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method: displaced copies of the objects, drawn by the user's own engine.

Every object has a copy for each glass and slot of a light path. Its vertices are moved to where
they appear. :func:`prepare` makes copies, view layers and nodes; :func:`updating` gives a frame's
paths to the slots and writes positions and weights, but makes no data-block, so it may run in a
frame-change handler of a render.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np

from ... import optics
from ..build.compositor import has_group, insert_group, remove_group
from ..build.copies_group import (
    build_group,
    images_of,
    write_beyond,
    write_rest,
    write_slot,
)
from ..build.layers import (
    ROLES,
    Layers,
    build_layers,
    find_layers,
    use_layers,
    write_settings,
)
from ..build.own_scenes import remove_own_scenes, source_of
from ..build.texture_coordinates import coordinates, dress, dressed_coordinates, remove_unused
from ..memory import Status, counters, forget, memory_of
from ..names import RefractiveGlassError
from ..plan import GlassPlan, Pane, Plan
from ..read.glasses import NAMED_SHAPES, Glass, is_shown, may_disperse, read_glass
from ..read.mesh_arrays import read_source_mesh
from ..read.modifier_inputs import glass_modifier, read_input
from ..read.sources import (
    Snapshot,
    is_carried,
    pieces,
    reaches_into,
    seen_through,
    source_objects,
)
from ..read.viewpoint import Viewpoint
from ..read.visibility import rendered_layer
from ..read.world import BLACK, film_exposure, uniform_radiance
from ..steps import Do, Step, Work, wait_for
from .appearance import Appearance, Search, Solver, Source
from .copies import empty_copy, write_copy, write_true_mesh
from .hull import faces_eye, first_face
from .kept_paths import OPEN_SLOTS, kept_paths, open_paths, slot_count
from .motion_blur import SOLVED, frame_time, keep_moment
from .path_keys import path_key
from .regions import Regions, in_picture, path_regions, tints
from .tessellation import Probe, region_probe

MAX_TOLERANCE_PX = 8.0


def prepare(
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph,
    glasses: list[bpy.types.Object],
    problems: list[str],
) -> None:
    """Make own scenes, copies and the compositor's node group.

    Raises
    ------
    RefractiveGlassError
        Nothing can be computed; nothing is changed then.
    """
    view_layer = rendered_layer(scene)
    sources = source_objects(view_layer, problems, ever=True)
    plan = _plan(scene, glasses, sources)
    _check(scene, depsgraph, glasses, plan, problems)
    memory = memory_of(scene)
    anew = (
        find_layers(scene) is None
        or memory.plan is None
        or memory.plan.structure != plan.structure
        or not has_group(scene)
    )
    if anew:
        counters["structures"] += 1
        forget(scene)
        memory = memory_of(scene)
    layers = build_layers(scene, plan, {s.session_uid: s for s in sources}, anew=anew)
    _dress_copies(layers, view_layer, depsgraph)
    if anew:
        insert_group(scene, build_group(scene, layers, plan), layers.all())
    memory.plan, memory.still, memory.standing = plan, None, list(problems)
    write_settings(scene, layers, (0, 0, 1, 1))


def remove(scene: bpy.types.Scene) -> None:
    """Remove what :func:`prepare` made for the scene, and only that."""
    if find_layers(scene) is not None:
        remove_group(scene)
        remove_own_scenes(scene, ROLES)
    forget(scene)


def _plan(scene: bpy.types.Scene, glasses, sources) -> Plan:
    """What the scene's glasses and sources ask for, whatever one frame shows of them."""
    planned, count = [], 0
    for number, obj in enumerate(glasses):
        named = read_input(glass_modifier(obj), "Shape") in NAMED_SHAPES
        open_slots = OPEN_SLOTS if named else 0
        slots = slot_count(scene, named=named) + open_slots
        bands = tuple(optics.LINES) if may_disperse(obj) else ("",)
        panes = tuple(Pane(count + k, band, slots, open_slots) for k, band in enumerate(bands))
        count += len(panes)
        seen = tuple(source.session_uid for source in seen_through(obj, sources))
        planned.append(GlassPlan(number, obj.session_uid, obj.name, panes, seen))
    beyond = "WORLD" if _is_uniform(scene) else "DIRECT"
    if scene.render.film_transparent:
        beyond = "NOTHING"
    return Plan(tuple(planned), beyond)


def _is_uniform(scene: bpy.types.Scene) -> bool:
    return uniform_radiance(scene.world, scene.render.engine) is not None


def _sky_colour(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """(3,) linear colour of a uniform world in the scene's picture; of another it is not asked."""
    world = scene.world and scene.world.evaluated_get(depsgraph)
    radiance = uniform_radiance(world, scene.render.engine) or BLACK
    return film_exposure(scene) * np.array(radiance)


def _check(scene, depsgraph, glasses, plan: Plan, problems: list[str]) -> None:
    """Raise where no glass can be read now; what only some lack is a frame's own problem."""
    if not plan.sources and _is_uniform(scene):
        raise RefractiveGlassError(
            f'Glass "{plan.glasses[0].name}": nothing can be seen through it; add a mesh that is '
            "visible in renders (and in its Seen Through collection)"
        )
    wrong = []
    for obj in glasses:
        if not is_shown(obj, depsgraph):
            continue
        try:
            read_glass(obj, depsgraph)
        except RefractiveGlassError as error:
            wrong.append(str(error))
        else:
            return
    if wrong:
        raise RefractiveGlassError(" ".join((*problems, *wrong)))


def _dress_copies(layers: Layers, view_layer: bpy.types.ViewLayer, depsgraph) -> None:
    """Materials that read the place get the copies' true one."""
    of_source: dict[bpy.types.Object, list[bpy.types.Object]] = {}
    for copy in layers.copies().values():
        of_source.setdefault(source_of(copy), []).append(copy)
    for source, copies in of_source.items():
        dress(copies, source, depsgraph, view_layer.material_override)
    remove_unused()


def updating(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, view: Viewpoint, do: Do
) -> Generator[Step, None, Status]:
    """Solve what changed and write it into what :func:`prepare` made.

    In steps, one a copy: each may be the last, what stands is then what it was. ``do`` does what
    takes long and touches nothing of Blender's; a step comes again while that goes on.
    """
    layers, memory = find_layers(scene), memory_of(scene)
    if layers is None or memory.plan is None:
        return memory.status
    started = time.perf_counter()
    is_render = depsgraph.mode == "RENDER"
    blurred = is_render and scene.render.use_motion_blur
    if blurred and memory.centre not in (None, frame_time(scene)):
        keep_moment(scene, memory, layers, view, depsgraph)
        return memory.status
    frame = _Frame(scene, depsgraph, view, layers, memory, do)
    yield from frame.updating()
    if is_render:
        frame.write_layers()
    shapes = [shape for _, _, shape in memory.copies.values()]
    memory.status = Status(
        vertices=sum(shape.vertices for shape in shapes),
        paths=tuple(
            dict.fromkeys(
                path_key(p) for _, ps in memory.shown.values() for p in ps.values() if not p.open
            )
        ),
        milliseconds=1e3 * (time.perf_counter() - started),
        bound_px=max((shape.bound_px for shape in shapes), default=0.0),
        problems=[*memory.standing, *frame.problems],
    )
    if blurred:
        memory.centre = frame_time(scene)
        memory.moments[memory.centre] = {
            key: shape.images.position
            for key, (_, _, shape) in memory.copies.items()
            if shape.images is not None
        }
    return memory.status


class _Frame:
    """One moment of a scene, to be written into its copies, images and outlines."""

    def __init__(self, scene, depsgraph, view: Viewpoint, layers: Layers, memory, do: Do) -> None:
        self.scene, self.depsgraph, self.view = scene, depsgraph, view
        self.layers, self.memory, self._do = layers, memory, do
        self.problems: list[str] = []
        self._images = images_of(scene)
        self._copies = layers.copies()
        self._objects = {obj.session_uid: obj for obj in scene.objects}
        self._rects: list[tuple[int, int, int, int]] = []
        self._done = 0
        self._coming = Step(0.0, "light paths")

    def apart(self, subject: Hashable, what: str, work: Work) -> Generator[Step, None, object]:
        """Do work that takes long; yields the step that is at hand again while it goes on."""
        going = self._do(subject, what, work)
        while not going.done():
            wait_for(going)
            yield self._coming
        return going.result()

    def updating(self) -> Iterator[Step]:
        """Bring all up to date; yields before each copy."""
        for planned in self.memory.plan.glasses:
            yield from self._glass(planned)
        self._occluders()
        write_beyond(self._images, _sky_colour(self.scene, self.depsgraph))

    def write_layers(self) -> None:
        """Give the own scenes the frame's settings, and have rendered what is not empty."""
        write_settings(self.scene, self.layers, _union(self._rects))
        used = {
            pane.layer(slot)
            for pane in self.memory.plan.panes
            for slot in self.memory.shown[pane.number][1]
        }
        use_layers(self.layers.displaced, used)
        use_layers(
            self.layers.mask,
            {g.mask_layer for g in self.memory.plan.glasses if self.memory.hulls.get(g.number)},
        )

    def _glass(self, planned: GlassPlan) -> Iterator[Step]:
        glass = self._read(planned)
        self._hull(planned, glass)
        for pane in planned.panes:
            if glass is None:
                self._blank(pane)
                continue
            yield from self._pane(planned, pane, glass.in_light(pane.band) if pane.band else glass)

    def _read(self, planned: GlassPlan) -> Glass | None:
        """The glass as it is now; None if it is not there, cannot be computed or bends no light."""
        obj = self._objects.get(planned.uid)
        if obj is None or not is_shown(obj, self.depsgraph):
            return None
        try:
            glass = read_glass(obj, self.depsgraph)
            if len(set(glass.description.media)) == 1 and not glass.is_tinted:
                return None
            first_face(glass, self.view.eye_for(glass))
        except RefractiveGlassError as error:
            self.problems.append(str(error))
            return None
        return glass

    def _hull(self, planned: GlassPlan, glass: Glass | None) -> None:
        """Write the part of the glass's first face that shows the eye its front."""
        stamp = None if glass is None else (glass.stamp(), self.view.stamp())
        if planned.number in self.memory.hulls and self.memory.hulls[planned.number] == stamp:
            return
        self.memory.hulls[planned.number] = stamp
        mesh = self.layers.hull(planned.number)
        mesh.clear_geometry()
        if glass is not None:
            eye = self.view.eye_for(glass)
            vertices, faces = first_face(glass, eye)
            faces = faces[faces_eye(vertices, faces, eye)]
            mesh.from_pydata(glass.points_to_world(vertices).tolist(), [], faces.tolist())
        mesh.update()

    def _pane(self, planned: GlassPlan, pane: Pane, glass: Glass) -> Iterator[Step]:
        shown = yield from self._paths(planned, pane, glass)
        self.memory.shown[pane.number] = (glass, shown)
        regions = yield from self._regions(pane, glass, shown)
        self._rects.append(regions.rect)
        total, shown_now = max(1, len(self._copies)), set()
        for slot, path in shown.items():
            task = _Task(self, pane, slot, glass, path, regions)
            for uid in planned.sources if not path.open else self._held(planned, glass):
                copy = self._copies.get((pane.number, slot, uid))
                if copy is None or not self._is_seen(uid):
                    continue
                source = source_of(copy)
                self._coming = Step(self._done / total, f"{source.name} along {path}")
                yield self._coming
                self._done += 1
                yield from task.updating(copy, source)
                shown_now.add((pane.number, slot, uid))
        self._blank_slots(pane, set(range(pane.slots)) - shown.keys())
        self._empty_others(pane, shown_now)

    def _paths(
        self, planned: GlassPlan, pane: Pane, glass: Glass
    ) -> Generator[Step, None, dict[int, optics.LightPath]]:
        """Slot -> the path that is shown in it."""
        paths = yield from kept_paths(self.scene, glass, self.view, self.apart)
        if len(paths) > pane.whole_slots:
            self.problems.append(
                f'Glass "{planned.name}": {len(paths) - pane.whole_slots} of {len(paths)} light '
                "paths are left out; raise Minimum Weight"
            )
        shown = dict(enumerate(paths[: pane.whole_slots]))
        if pane.open_slots and self._held(planned, glass):
            begins = yield from open_paths(self.scene, glass, self.view, self.apart)
            shown |= dict(enumerate(begins, pane.whole_slots))
        return shown

    def _held(self, planned: GlassPlan, glass: Glass) -> list[int]:
        """Session uids of the shown objects that reach into a glass."""
        return [
            uid
            for uid in planned.sources
            if self._is_seen(uid) and reaches_into(glass, self._objects[uid], self.depsgraph)
        ]

    def _is_seen(self, uid: int) -> bool:
        """Whether a source is there now, and rays of the camera see it."""
        source = self._objects.get(uid)
        return source is not None and source.visible_camera and is_shown(source, self.depsgraph)

    def _blank(self, pane: Pane) -> None:
        """Show nothing through a glass: what is behind it then is the direct picture."""
        self.memory.shown[pane.number] = (None, {})
        self.memory.regions.pop(pane.number, None)
        write_rest(self._images, pane, None)
        self._blank_slots(pane, range(pane.slots))
        self._empty_others(pane, set())

    def _blank_slots(self, pane: Pane, slots: Iterable[int]) -> None:
        for slot in slots:
            write_slot(self._images[pane.number, slot], None)
            self.memory.weights.pop((pane.number, slot), None)

    def _empty_others(self, pane: Pane, shown: set) -> None:
        """Empty the copies of a pane but for those that are shown."""
        for key in [k for k in self.memory.copies if k[0] == pane.number and k not in shown]:
            self._empty(key)

    def _empty(self, key) -> None:
        if self.memory.copies.pop(key, None) is not None and key in self._copies:
            empty_copy(self._copies[key])

    def _regions(self, pane: Pane, glass: Glass, shown) -> Generator[Step, None, Regions]:
        paths = tuple(shown.values())
        fresnel = self.scene.refractive_glass.surface == "GLASS"
        stamp = (glass.stamp(), self.view.stamp(), paths, fresnel)
        known = self.memory.regions.get(pane.number)
        if known is None or known[0] != stamp:
            find = partial(path_regions, glass, self.view, paths, fresnel=fresnel)
            regions = yield from self.apart(pane.number, "regions", find)
            counters["masks"] += 1
            counters["mask_pixels"] += regions.hit.size
            known = self.memory.regions[pane.number] = (stamp, regions)
            rest = regions.left_out()
            # Where surfaces only refract, what is reflected there is lost.
            passes = fresnel and bool(rest.any())
            rest = self._window(regions, rest[..., None]) if passes else None
            write_rest(self._images, pane, rest)
        yield from self._write_weights(pane, glass, *known, tuple(shown))
        return known[1]

    def _write_weights(
        self, pane: Pane, glass: Glass, stamp, regions: Regions, slots
    ) -> Iterator[Step]:
        for number, slot in enumerate(slots):
            key = (pane.number, slot)
            if self.memory.weights.get(key) != stamp:
                find = partial(self._weights, glass, regions, number)
                weights = yield from self.apart(key, "weights", find)
                write_slot(self._images[key], weights)
                self.memory.weights[key] = stamp

    def _weights(self, glass: Glass, regions: Regions, number: int) -> np.ndarray:
        """(H, W, 4) what the light of one of the regions' paths is weighed by."""
        path, weights = regions.paths[number], regions.shares[number, ..., None]
        if path.open:
            # The paths that carry the light on show what is held too.
            on = [path.begins(other) and not other.open for other in regions.paths]
            weights = np.maximum(weights - regions.shares[on].sum(axis=0)[..., None], 0.0)
        if glass.is_tinted:
            weights = weights * tints(glass, self.view, path)
        return self._window(regions, weights)

    def _window(self, regions: Regions, values: np.ndarray) -> np.ndarray:
        """Values (h, w, 1 or 3) of the regions' rectangle, as pixels of the rendered picture."""
        x0, y0, x1, y1 = self.view.window
        placed = in_picture(np.moveaxis(values, 2, 0), regions.rect, self.view.size)
        pixels = np.ones((y1 - y0, x1 - x0, 4), np.float32)
        pixels[..., :3] = np.moveaxis(placed, 0, 2)[y0:y1, x0:x1]
        return pixels

    def _occluders(self) -> None:
        """Objects that stand before glasses: hidden ones do not, and some need meshes."""
        for uid, occluder in self.layers.occluders().items():
            source = source_of(occluder)
            hidden = not self._is_seen(uid)
            if occluder.hide_render != hidden:
                occluder.hide_render = hidden
            if hidden or is_carried(source):
                continue
            with pieces(source, self.depsgraph) as parts:
                snapshot = Snapshot.of(parts)
                known = self.memory.occluders.get(uid)
                if known is None or not snapshot.same(known):
                    write_true_mesh(occluder, parts)
                    self.memory.occluders[uid] = snapshot


@dataclass(eq=False)
class _Task:
    """The copies in one slot of one pane, to be brought up to date."""

    frame: _Frame
    pane: Pane
    slot: int
    glass: Glass
    path: optics.LightPath
    regions: Regions

    def __post_init__(self) -> None:
        settings, view = self.frame.scene.refractive_glass, self.frame.view
        self.importance = max(self.regions.importance(self.path), 1e-3)
        # Read here, for the search is made in a thread, which reads nothing of Blender's.
        self._solved = SOLVED * settings.tolerance_px
        # What carries little light may lie less exactly: the error in the picture is the product.
        self.tolerance = min(settings.tolerance_px / self.importance, MAX_TOLERANCE_PX)
        self.stamp = (
            self.path,
            self.glass.stamp(),
            view.stamp(),
            self.tolerance,
            self.regions.rect,
        )
        self._search: Search | None = None

    def updating(self, copy: bpy.types.Object, original: bpy.types.Object) -> Iterator[Step]:
        """Find where an object appears, unless nothing changed, and write it into its copy."""
        memory, depsgraph = self.frame.memory, self.frame.depsgraph
        key = (self.pane.number, self.slot, original.session_uid)
        stamp, known, before = memory.copies.get(key, (None, None, None))
        with pieces(original, depsgraph) as parts:
            snapshot = Snapshot.of(parts)
            extra = coordinates(parts, dressed_coordinates(copy))
            if stamp == self.stamp and known.is_as(snapshot, extra):
                return
            source = Source.of(parts, snapshot, is_carried(original), extra)
        find = partial(self._find, source, before, self._of_last_band(key))
        shape = yield from self.frame.apart(key, "images", find)
        mesh = None
        if shape.refined and shape.images is not None:
            # Read only now: few are, and Blender's own mesh may be another one while windows go on.
            with pieces(original, depsgraph) as parts:
                if Snapshot.of(parts).topology != snapshot.topology:
                    raise RefractiveGlassError(f'"{original.name}" has changed: update again')
                whole = read_source_mesh(parts, extra)
            mesh = yield from self.frame.apart(key, "parts", partial(whole.parted, shape.triangles))
        write_copy(copy, source, shape, self.frame.view, mesh=mesh, before=before)
        counters["solves"] += 1
        counters["copies"] += 1
        memory.copies[key] = (self.stamp, source, shape)

    def _find(self, source: Source, before, start) -> Appearance:
        return self.search.find(source, before, start)

    @property
    def search(self) -> Search:
        """What appearances along the path are found with."""
        if self._search is None:
            solver = Solver(self.glass, self.path, self.frame.view, self._solved)
            self._search = Search(
                solver, self._probe(), self.regions.rect, self.tolerance, self.importance
            )
        return self._search

    def _of_last_band(self, key) -> Appearance | None:
        """Where the same appears in light of the last colour, a start for this one."""
        bands = list(optics.LINES)
        if self.pane.band not in bands[1:]:
            return None
        # The panes of a glass have numbers one after another.
        number, slot, uid = key
        shown = self.frame.memory.shown.get(number - 1, (None, {}))[1]
        if shown.get(slot) != self.path:
            return None
        known = self.frame.memory.copies.get((number - 1, slot, uid))
        return None if known is None else known[2]

    def _probe(self) -> Probe:
        """The path's rays; they stay while glass and eye do."""
        probes, view = self.frame.memory.probes, self.frame.view
        stamp = (self.glass.stamp(), view.stamp(), self.regions.rect)
        known = probes.get((self.pane.number, self.path))
        if known is None or known[0] != stamp:
            found = region_probe(self.glass, view, self.path, self.regions.rect)
            known = probes[self.pane.number, self.path] = (stamp, found)
        return known[1]


def _union(rects) -> tuple[int, int, int, int]:
    rects = [r for r in rects if r[0] < r[2] and r[1] < r[3]]
    if not rects:
        return (0, 0, 1, 1)
    low = np.min([r[:2] for r in rects], axis=0)
    high = np.max([r[2:] for r in rects], axis=0)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
