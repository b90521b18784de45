# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through any number of glasses at once: where the light of a ray comes from.

All rays advance together, one interface a step. In each step every ray meets the nearest interface
of any glass, or a thing before it, or nothing more; at an interface it splits by Fresnel's
equations. What a ray ends with are its *exit rays*: each has an origin, a direction, a share of the
light and the distance to the thing that it sees.

Glasses may overlap: `Media` tells which medium holds. An interface that does not change the medium
that holds is passed straight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import nearest
from .boxes import TOUCHING, fewer, grain, near_boxes
from .facets import ENDLESS, bent, facet_shares, fold, visible_facets
from .laws import proper_rays, reflectance_and_cosine
from .placed import (
    NOWHERE,
    STAMPS,
    Media,
    Placed,
    PlacedGlass,
    shared_media,
    surface_rows,
    surfaces,
)
from .profiles import Profile
from .solver import in_blocks
from .surfaces import HORIZON, Floats, Rays
from .vectors import Columns, against, columns, dot, refracted, rotated, units

FAR_OFF = 100.0
"""Sizes of all meshes: surfaces touch no less closely however far they are from the origin."""

PLAIN = 6.0
"""Events of a way for which the least weight holds as it is."""

STRONG = 0.1
"""Part of a ray's light that is followed however long its way is: there are few such ways."""

KEPT = 32
"""Total reflections, one after another, from which on a way is taken never to leave its glass: of
light that began in it and met nothing else, or off interpolated normals. All other light is
reversible: what came in leaves at last."""

OWN = 1e-5
"""Of a unit vector: interpolated normals nearer to the face's are its own, as rounded."""

MOST_BOXES = 16
"""Boxes that a ray is tried with before it is cast: each takes time for every ray."""

MOST_STRAIGHT = 64
"""Interfaces that a ray may pass straight, beside the `most_events` at which it is turned."""


@dataclass(frozen=True)
class ExitRays:
    """Where the light of rays comes from, one exit ray a row; those of one ray are neighbours.

    Attributes
    ----------
    ray : (K,) int
        Number of the ray.
    weight : (K,)
        Share of the ray's light, absorption not counted.
    depth : (K, 3)
        Optical depth of all media and tinted surfaces passed, up to the thing seen:
        ``exp(-depth)`` gets through.
    origin : (K, 3)
        Last interface point in the world, metres; the ray's own origin if it met none.
    direction : (K, 3)
        Unit, from there on.
    distance : (K,)
        Metres from `origin` to the thing seen, inf for none.
    thing : (K,) int
        Number of the thing seen, as `cast` has it, -1 for none.
    events : (K,) int
        Interfaces at which the ray was refracted or reflected.
    rough : (K,) bool
        Whether it met a facet of a rough glass.
    path : (K,) int64
        The same for rays with the same sequence of (glass, interface, refracted or reflected), 0
        for none; comparable between calls with the same list of glasses. It is a hash: two
        sequences share one with a chance of 2⁻⁶³. Its last bit is 1 where any was a reflection.
    lost : (M,)
        Share of each ray's light that was not followed to its end. With the weights it adds up to
        1. All of it for a ray that is none (not finite, or without a direction).
    stuck : (M,)
        Of `lost`, what never leaves the glasses: see `KEPT`.
    steps : int
        Steps taken, each with at most one call of `cast` and of `meet`.
    passed_ray, passed : (S,) int32 and (S, 2, 3) float32
        Begin and end of each stretch of a ray up to an interface, in the world; none unless
        `stretches` are asked for. What a ray brings depends on things along these and its exit
        rays only.
    """

    ray: NDArray[np.intp]
    weight: Floats
    depth: Floats
    origin: Floats
    direction: Floats
    distance: Floats
    thing: NDArray[np.intp]
    events: NDArray[np.intp]
    rough: NDArray[np.bool_]
    path: NDArray[np.int64]
    lost: Floats
    stuck: Floats
    steps: int
    passed_ray: NDArray[np.int32]
    passed: NDArray[np.float32]


MIRRORED = np.uint64(1)
"""The bit of a path that tells of a reflection."""

Cast = Callable[[Floats, Floats], tuple[Floats, NDArray[np.intp]]]
"""(origins (L, 3), unit directions (L, 3)) -> (L,) metres to the nearest thing, inf for none, and
its number (L,), -1 for none."""

Meet = Callable[[Floats, Floats], tuple[NDArray, ...]]
"""(origins (L, 3), unit directions (L, 3)) -> of the next face of a mesh that is a glass: number of
the glass (L,) in the list of all, metres (L,) to it, inf for none, the face's normal (L, 3) and the
interpolated one, both towards its front, not necessarily unit. Where a glass is painted, also what
the surface is like there (L, 7), of whatever mesh: its roughness and the parts of the light, red,
green, blue, that get through where it is refracted, and where it is reflected.

Meshes that touch each other must be told apart: then each result has a first axis more, (H, L) and
(H, L, 3), with the next face of one group of meshes in each row.
"""


@dataclass
class _Live(Columns):
    """Rays on their way, in the world; the last axis counts them.

    `depth` has no rows where nothing dims light, `aside` none where no things are looked for.
    `medium`: of each row of `_Followed.media`, 0 outside its glasses. `entered`: the step in which
    one of these was entered.
    `facet`: the ray's number among those into which the first rough interface split it, else -1.
    `part`: of all facets, how many it stands for.
    `aside`: (3, L), from where a ray starts to where it looks for things from. `thing`: number of
    the thing that it met when it last looked, -1 for none. `kept`: how many of its last events
    were total reflections that may keep it, see `KEPT`.
    """

    ray: NDArray[np.intp]
    place: Floats
    direction: Floats
    weight: Floats
    depth: Floats
    events: NDArray[np.int32]
    path: NDArray[np.uint64]
    medium: NDArray[np.int8]
    entered: NDArray[np.int16]
    facet: NDArray[np.int8]
    part: Floats
    aside: Floats
    thing: NDArray[np.int32]
    kept: NDArray[np.int16]

    def __len__(self) -> int:
        return len(self.ray)

    @staticmethod
    def join(parts: Sequence[_Live]) -> _Live:
        rows = zip(*(vars(part).values() for part in parts), strict=True)
        return _Live(*(np.concatenate(same, axis=-1) for same in rows))


@dataclass
class _NextFace(Columns):
    """The next interface of every ray: way to it (inf: none), glass, interface, unit normal (3, L).

    `flat`: normals of a mesh's faces, where there are meshes, else (0, L); `normal` then is the
    interpolated one. `after`: as `_Live.medium`, behind it. `leaked`: the ray is in a glass of
    which it meets nothing, by rounding. `surface`: (7, L), see `surface_rows`, where a glass is
    painted, else (0, L).
    """

    way: Floats
    glass: NDArray[np.int16]
    interface: NDArray[np.int32]
    normal: Floats
    flat: Floats
    after: NDArray[np.int8]
    leaked: NDArray[np.bool_]
    surface: Floats


@dataclass
class _Followed:
    """One call of `exit_rays`.

    `row`: of each glass, its row in `media`, see `shared_media`.
    """

    glasses: Sequence[Placed]
    min_weight: float
    most_events: int
    cast: Cast | None
    ask: Meet | None
    fresnel: bool
    things: Floats | None
    pixel: NDArray[np.int64]
    sample: NDArray[np.int64]
    between: Callable[[], None]
    stretches: bool
    row: NDArray[np.intp] = field(init=False)
    media: Media = field(init=False)
    meshes: list[int] = field(init=False)
    mesh_rows: NDArray[np.intp] = field(init=False)
    surfaces: Floats = field(init=False)
    rows: list[tuple[_Live, Floats]] = field(default_factory=list)
    passed: list[tuple[NDArray, NDArray]] = field(default_factory=list)
    steps: int = 0

    def __post_init__(self) -> None:
        self.row, shared = shared_media(self.glasses)
        self.media = Media(shared)
        self.meshes = [n for n, glass in enumerate(self.glasses) if glass.is_mesh]
        self.mesh_rows = np.unique(self.row[self.meshes])
        self.surfaces = surfaces(self.glasses)
        self.painted = any(self.glasses[number].is_painted for number in self.meshes)
        self.rough = bool(self.surfaces[0].any())
        self.tinted = self.painted or bool(self.surfaces[1:].any())
        # Rays that are lost in a mesh's interpolated normals end black too.
        dark = bool(self.meshes) or not self.fresnel
        self.dims = not self.media.clear or self.tinted or dark
        boxes = [self.glasses[number].box for number in self.meshes]
        self.mesh_boxes, self.farthest = None, np.inf
        if boxes and not any(box is None for box in boxes):
            self.mesh_boxes = np.asarray(boxes, dtype=float)
            size = np.linalg.norm(np.ptp(self.mesh_boxes, axis=(0, 1)))
            self.farthest = FAR_OFF * float(size)
        self.grain = grain(self.mesh_boxes)
        self.accuracy = grain(self.things)
        if self.mesh_boxes is not None:
            self.mesh_boxes = fewer(self.mesh_boxes, MOST_BOXES)
        if self.things is not None:
            self.things = fewer(self.things, MOST_BOXES)
        if self.meshes and self.ask is None:
            raise ValueError("meet must tell where the glasses are that are meshes, not None")

    # ---- the start ----------------------------------------------------------------------

    def start(self, origin: Floats, direction: Floats, proper: NDArray[np.intp]) -> _Live:
        """The proper rays of unit directions (M, 3)."""
        count, rows = len(proper), len(self.media.rank)
        single = origin.ndim == 1
        medium = np.zeros((rows, count), dtype=np.int8)
        places = origin[None] if single else origin[proper]
        for number, glass in enumerate(self.glasses):
            if number in self.meshes:
                continue
            turn, middle = glass.pose[:3, :3], glass.pose[:3, 3]
            medium[self.row[number]] = glass.body.medium_at(rotated(turn.T, (places - middle).T).T)
        return _Live(
            ray=proper,
            place=np.array(np.broadcast_to(places.T, (3, count))),
            direction=np.ascontiguousarray(direction[proper].T),
            weight=np.ones(count),
            depth=np.zeros((3 if self.dims else 0, count)),
            events=np.zeros(count, dtype=np.int32),
            path=np.zeros(count, dtype=np.uint64),
            medium=medium,
            entered=np.zeros((rows, count), dtype=np.int16),
            facet=np.full(count, -1, dtype=np.int8),
            part=np.ones(count),
            aside=np.zeros((3 if self.cast is not None else 0, count)),
            thing=np.full(count, -1, dtype=np.int32),
            kept=np.zeros(count, dtype=np.int16),
        )

    # ---- one step -----------------------------------------------------------------------

    def step(self, live: _Live, lost: Floats, stuck: Floats) -> _Live:
        """The rays behind their next interface; those that end are kept in `rows`.

        ``lost``, ``stuck``: of all rays, as `ExitRays` has them; what is lost now is added.
        """
        self.between()
        self.steps += 1
        met = self.meet(live)
        finite = np.isfinite(met.way)
        if self.stretches:
            self._note(live, met)
        near = self.touching(live.place, np.where(finite, met.way, 0.0))
        contact = near + 2.0 * self.accuracy
        free = self.look(live, met.way + contact)
        seen = free < np.where(finite, met.way - contact, np.inf)
        leaked = met.leaked & ~seen
        ends = (seen | ~finite) & ~leaked
        if not self.media.clear:
            length = np.where(ends, free, met.way)
            glass, medium = self.media.holding(live.medium, live.entered)
            # What is seen at infinity through a medium without end is not dimmed.
            way = np.where(np.isfinite(length), length, 0.0)
            live.depth += self.media.absorption[glass, medium].T * way
        which = np.flatnonzero(ends)
        self.rows.append((live.take(which), free[which]))
        lost += np.bincount(live.ray[leaked], live.weight[leaked], len(lost))
        on = np.flatnonzero(~ends & ~leaked)
        touched = free[on] <= met.way[on] + contact[on]
        lift = np.where(touched, CLEARANCE * contact[on], 0.0)
        if len(on) < len(live):
            live, met, near = live.take(on), met.take(on), near[on]
        if not len(live):
            return live
        return self.split(live, met, near, lift, lost, stuck)

    def _note(self, live: _Live, met: _NextFace) -> None:
        """Note the stretches of rays up to their next interface."""
        # A ray that is lost by rounding sees what may come to be there, however far.
        some = np.flatnonzero(np.isfinite(met.way) | met.leaked)
        way = np.minimum(met.way[some], HORIZON)
        stretch = np.empty((len(some), 2, 3), np.float32)
        for axis in range(3):
            place = live.place[axis].take(some)
            stretch[:, 0, axis] = place
            stretch[:, 1, axis] = place + way * live.direction[axis].take(some)
        self.passed.append((live.ray[some].astype(np.int32), stretch))

    def touching(self, place: Floats, way: Floats) -> Floats:
        """Metres (L,) along rays within which interfaces touch that are met after a way."""
        largest = np.minimum(np.abs(place).max(axis=0), self.farthest)
        return TOUCHING * np.maximum(largest, way) + self.grain

    def meet(self, live: _Live) -> _NextFace:
        """The next interface of every ray, of all glasses."""
        count = len(live)
        met = _NextFace(
            way=np.full(count, np.inf),
            glass=np.full(count, -1, dtype=np.int16),
            interface=np.zeros(count, dtype=np.int32),
            normal=np.zeros((3, count)),
            flat=np.zeros((3 if self.meshes else 0, count)),
            after=live.medium.copy(),
            leaked=np.zeros(count, dtype=bool),
            surface=np.zeros((7 if self.painted else 0, count)),
        )
        sheets = self.meet_meshes(live) if self.meshes else []

        def work(block: slice) -> None:
            self.between()
            found: list[_Meeting | _Faces] = [sheet.within(block) for sheet in sheets]
            for number, glass in enumerate(self.glasses):
                if not glass.is_mesh:
                    medium = live.medium[self.row[number], block]
                    found += _meetings(number, glass, live, medium, block, met)
            way = met.way[block]
            for meeting in found:
                way[meeting.index] = np.minimum(way[meeting.index], meeting.way)
            near = None
            if len(found) > 1:
                near = self.touching(live.place[:, block], np.where(np.isfinite(way), way, 0.0))
            telling = np.full(len(way), NOWHERE)
            for meeting in found:
                if near is not None:
                    last = (way + near)[meeting.index]
                    meeting = meeting.take(np.flatnonzero(meeting.way <= last))
                if not len(meeting.index):
                    continue
                index = meeting.index + block.start
                row = self.row[meeting.number]
                met.after[row, index] = meeting.beyond
                if isinstance(meeting, _Faces):
                    live.medium[row, index] = 1 - meeting.beyond
                # Of interfaces that touch, that of the highest priority tells what happens.
                rank = np.broadcast_to(self.media.rank[row], len(index))
                first = np.flatnonzero(rank > telling[meeting.index])
                meeting, index = meeting.take(first), index[first]
                telling[meeting.index] = rank[first]
                met.glass[index] = meeting.number
                met.interface[index] = meeting.interface
                for axis, (normal, flat) in enumerate(zip(*meeting.normals(), strict=True)):
                    met.normal[axis][index] = normal
                    if self.meshes:
                        met.flat[axis][index] = flat
                if self.painted and isinstance(meeting, _Faces):
                    met.surface[:, index] = meeting.surface
                elif self.painted:
                    met.surface[:, index] = self.surfaces[:, [meeting.number]]

        in_blocks(work, count)
        return met

    def meet_meshes(self, live: _Live) -> list[_Faces]:
        """The next faces of meshes, for those rays that can meet one."""
        some = np.arange(len(live))
        if self.mesh_boxes is not None:
            inside = (live.medium[self.mesh_rows] > 0).any(axis=0)
            endless = np.full(len(live), np.inf)
            inside |= near_boxes(self.mesh_boxes, live.place, live.direction, endless)
            some = np.flatnonzero(inside)
        if not len(some):
            return []
        along = columns(live.direction, some)
        origins = np.ascontiguousarray(columns(live.place, some).T)
        glass, way, flat, smooth, *finish = self.ask(origins, np.ascontiguousarray(along.T))
        if self.painted and not finish:
            raise ValueError("meet must tell what the surfaces of painted glasses are like")
        found = []
        rows = (np.asarray(part).reshape(-1, *part.shape[-1:]) for part in (glass, way))
        groups = np.size(way) // len(some)
        (finish,) = finish if self.painted else (np.zeros((groups, len(some), 0)),)
        vectors = (
            np.asarray(part, dtype=float).reshape(groups, len(some), -1)
            for part in (flat, smooth, finish)
        )
        for numbers, ways, flats, smooths, finishes in zip(*rows, *vectors, strict=True):
            on = np.flatnonzero(np.isfinite(ways))
            on = on[np.abs(flats[on]).max(axis=1, initial=0.0) > 0.0]
            flats, smooths = units(flats[on].T), units(smooths[on].T)
            lost = ~smooths.any(axis=0)
            smooths[:, lost] = flats[:, lost]
            beyond = (dot(flats, along[:, on]) < 0.0).astype(np.int8)
            surface = surface_rows(finishes[on]) if self.painted else np.zeros((0, len(on)))
            numbers = numbers[on].astype(np.intp)
            found.append(_Faces(some[on], ways[on], numbers, beyond, flats, smooths, surface))
        return found

    def look(self, live: _Live, far: Floats) -> Floats:
        """Metres (L,) to the nearest thing, looked for where one can be; the rays note which.

        `far`: as far as things may touch the next interface, whatever the ray starts from.
        """
        free = np.full(len(live), np.inf)
        live.thing = np.full(len(live), -1, dtype=np.int32)
        if self.cast is None or not len(live):
            return free
        some = slice(None)
        if self.things is not None:
            some = np.flatnonzero(near_boxes(self.things, live.place, live.direction, far))
            if not len(some):
                return free
        aside, along = columns(live.aside, some), columns(live.direction, some)
        origins = np.ascontiguousarray((columns(live.place, some) + aside).T)
        way, live.thing[some] = self.cast(origins, np.ascontiguousarray(along.T))
        free[some] = way + dot(aside, along)
        return np.maximum(free, 0.0)

    def split(self, live: _Live, met: _NextFace, near, lift, lost: Floats, stuck: Floats) -> _Live:
        """The rays behind the interfaces that they met.

        `near`: how near interfaces count as touching, `lift`: how far off the interface rays look
        for things from that are reflected where one touches it; 0 where none does. Between thing
        and interface is a film of the medium behind it: what gets through sees the thing.
        """
        children: dict[int, tuple] = {}

        def work(block: slice) -> None:
            self.between()
            children[block.start] = self._split(
                live.take(block), met.take(block), near[block], lift[block]
            )

        in_blocks(work, len(live))
        # One kind after another: the order of a ray's parts does not depend on the blocks.
        blocks = (children[first] for first in sorted(children))
        (*parts, stopped, turned_back) = zip(*blocks, strict=True)
        seen, dark, through, off = map(_Live.join, parts)
        self.rows += [(seen, np.zeros(len(seen))), (dark, np.full(len(dark), np.inf))]
        for dropped in (stopped, turned_back):
            rays, weights, stays = (np.concatenate(part) for part in zip(*dropped, strict=True))
            lost += np.bincount(rays, weights, len(lost))
            stuck += np.bincount(rays, weights * stays, len(lost))
        if self.rough:
            through, off = self._fewer(through), self._fewer(off)
        return _Live.join((through, off))

    def _fewer(self, live: _Live) -> _Live:
        """The rays of facets, fewer of those of one ray and path that bring little of its light.

        Noise asks for as many as the light's root. Those that stay share the light of all: they are
        drawn in proportion to it, at even steps from a place that pixel, sample and event choose
        (systematic sampling), so the mean is right.
        """
        rows = np.flatnonzero(live.facet >= 0)
        if not len(rows):
            return live
        # One path's rays lie side by side: what is split or ends keeps its order.
        ray, path = live.ray[rows], live.path[rows]
        begins = np.concatenate(([True], (ray[1:] != ray[:-1]) | (path[1:] != path[:-1])))
        begin = np.flatnonzero(begins)
        count = np.diff(begin, append=len(rows))
        many = np.ceil(FACETS * np.sqrt(np.add.reduceat(live.weight[rows], begin)))
        less = many < count
        few = np.flatnonzero(less)
        if not len(few):
            return live
        many, first = many[few, None], rows[begin[few]]
        rows = rows[np.repeat(less, count)]
        group, facet = np.repeat(np.arange(len(few)), count[few]), live.facet[rows]
        weight, part = np.zeros((2, len(few), FACETS))
        weight[group, facet], part[group, facet] = live.weight[rows], live.part[rows]
        weight, part = weight.cumsum(axis=1), part.cumsum(axis=1)
        ray = live.ray[first]
        start, _ = facet_shares(self.pixel[ray], self.sample[ray], live.events[first])
        steps = np.minimum(np.floor(weight / weight[:, -1:] * many + start[:, None]), many)
        share = np.diff(steps, axis=1, prepend=0.0) / many
        live.weight[rows] = (share * weight[:, -1:])[group, facet]
        live.part[rows] = (share * part[:, -1:])[group, facet]
        gone = rows[share[group, facet] == 0.0]
        return live.take(np.delete(np.arange(len(live)), gone))

    def _split(self, live: _Live, met: _NextFace, near, lift) -> tuple:
        """Rays that see what touches, that end black, that went through and that were reflected;
        and (ray, weight, whether it is stuck) of what is dropped of either of the last."""
        live.place += met.way * live.direction
        crossing = self._crossing(live, met)
        if self.rough:
            live, met, crossing, rows = self._roughened(live, met, crossing)
            near, lift = near[rows], lift[rows]
        straight, eta, flat = crossing.straight, crossing.eta, crossing.flat
        direction, normal = live.direction, crossing.normal
        cosine = np.minimum(np.maximum(-dot(normal, direction), 0.0), 1.0)
        reflectance, behind = reflectance_and_cosine(cosine, eta)
        if not self.fresnel:
            reflectance = np.where(behind > 0.0, 0.0, 1.0)
        reflectance[straight] = 0.0

        events = live.events + ~straight
        least = self._least(live, events, straight)
        weights = live.weight * (1.0 - reflectance), live.weight * reflectance
        kept = self._kept(live, reflectance, crossing)
        enough = [(weight > least) & (events <= self.most_events) for weight in weights]
        rest = [np.flatnonzero(~e & (w > 0.0)) for e, w in zip(enough, weights, strict=True)]
        dropped = [
            (live.ray[some], w[some], (events[some] > self.most_events) & (kept[some] >= KEPT))
            for some, w in zip(rest, weights, strict=True)
        ]
        on, back = (np.flatnonzero(part) for part in enough)
        turned = refracted(direction, normal, cosine, behind, eta)
        turned = np.where(straight, direction, turned)
        sunk = self._sunk(turned, flat, straight)
        live.events, live.kept = events, kept
        beyond = {"medium": met.after, "entered": crossing.entered}
        through = self._child(live, on, direction=turned, weight=weights[0], **beyond)
        off = self._child(live, back, weight=weights[1])
        # Few are followed on.
        off.direction = units(off.direction + (2.0 * cosine[back]) * columns(normal, back))
        if self.tinted:
            depths = self.surface(met)[1:]
            through.depth += np.where(straight, 0.0, depths[:3])[:, on]
            off.depth += depths[3:, back]
        if self.meshes:
            # Off all faces met here, which float32 puts a little before the place or behind it.
            through.place -= CLEARANCE * near[on] * columns(flat, on)
            off.place += CLEARANCE * near[back] * columns(flat, back)
        if self.cast is not None:
            # A thing that touches is on the other side, whatever the rounding of its distance.
            off.aside = lift[back] * columns(flat, back)
        code = _interface_code(met.glass, met.interface)
        through.path = np.where(straight[on], through.path, _path_on(through.path, code[on]))
        off.path = _path_on(off.path, code[back] + 1) | MIRRORED
        touches = (lift[on] > 0.0) & sunk[on]
        ends = ~sunk[on]
        seen, dark = (through.take(np.flatnonzero(which)) for which in (touches, ends))
        if len(seen) or len(dark):
            through = through.take(np.flatnonzero(~(touches | ends)))
        if not self.fresnel:
            # A surface that only refracts is black where it would reflect totally, as in Cycles.
            dark, off = _Live.join([dark, off]), off.take(slice(0, 0))
        dark.depth = np.full_like(dark.depth, np.inf)
        return seen, dark, through, off, *dropped

    def surface(self, met: _NextFace) -> Floats:
        """(7, L) what is met does to light, see `surface_rows`."""
        return met.surface if self.painted else self.surfaces[:, met.glass]

    def _kept(self, live: _Live, reflectance: Floats, crossing: _Crossing) -> NDArray[np.int16]:
        """`_Live.kept` behind the interfaces."""
        stays = live.kept == live.events
        if self.meshes:
            stays |= np.abs(crossing.normal - crossing.flat).max(axis=0) > OWN
        stays &= reflectance == 1.0
        straight = crossing.straight
        return np.where(straight | stays, live.kept + ~straight, 0).astype(np.int16)

    def _sunk(self, turned: Floats, flat: Floats, straight) -> NDArray[np.bool_]:
        """Which refracted rays (3, L) are behind the face; others end black, as in Cycles.

        Behind a normal that is interpolated over a sharp edge they may be before it.
        """
        if not self.meshes:
            return np.ones(len(straight), dtype=bool)
        return straight | (dot(turned, flat) < 0.0)

    @staticmethod
    def _child(live: _Live, which, **parts) -> _Live:
        """Some of the rays, of which parts are others."""
        child = replace(live, aside=live.aside[:0], **parts).take(which)
        child.aside = np.zeros((len(live.aside), len(which)))
        return child

    def _least(self, live: _Live, events, straight) -> Floats:
        """The weight that a ray must have more than to be followed."""
        if not self.fresnel:
            return np.zeros(len(live))
        # Long ways, round in a wall, must carry more.
        least = self.min_weight * np.maximum(1.0, events / PLAIN)
        least = np.minimum(least, max(self.min_weight, STRONG))
        least = least * live.part
        least[straight] = 0.0
        return least

    def _crossing(self, live: _Live, met: _NextFace) -> _Crossing:
        """What rays at their interfaces cross."""
        direction = live.direction
        glass, medium = self.media.holding(live.medium, live.entered)
        entered = np.where((met.after > 0) & (live.medium == 0), self.steps, live.entered)
        entered = entered.astype(np.int16)
        glass_after, medium_after = self.media.holding(met.after, entered)
        straight = (glass == glass_after) & (medium == medium_after)
        eta = self.media.ior[glass, medium] / self.media.ior[glass_after, medium_after]
        if not self.meshes:
            normal = met.normal * against(met.normal, direction)
            return _Crossing(straight, eta, entered, normal, normal)
        # The interpolated normal is on the side that the face's is on.
        side = against(met.flat, direction)
        flat = met.flat * side
        normal = bent(met.normal * side, flat, direction)
        return _Crossing(straight, eta, entered, flat, normal)

    def _roughened(self, live: _Live, met: _NextFace, crossing: _Crossing) -> tuple:
        """The same with normals of facets where a glass is rough, and the rows they are of.

        At the first rough interface a ray becomes `FACETS` rays, one a facet. From there on each
        keeps its number, and meets one facet at each rough interface.
        """
        alpha = self.surface(met)[0]
        rough = (alpha > 0.0) & ~crossing.straight
        fresh = rough & (live.facet < 0)
        rows = np.repeat(np.arange(len(live)), np.where(fresh, FACETS, 1))
        if fresh.any():
            live, met, crossing = live.take(rows), met.take(rows), crossing.take(rows)
            fresh = fresh[rows]
            # A ray's copies are neighbours: they are counted from the first.
            first = np.searchsorted(rows, rows[fresh])
            live.facet[fresh] = np.flatnonzero(fresh) - first
            live.weight[fresh] /= FACETS
            live.part[fresh] /= FACETS
        some = np.flatnonzero(rough[rows])
        normal, flat = columns(crossing.normal, some), columns(crossing.flat, some)
        ray = live.ray[some]
        number = self.sample[ray] * FACETS + live.facet[some]
        places = facet_shares(self.pixel[ray], number, live.events[some])
        facet = visible_facets(normal, live.direction[:, some], alpha[rows[some]], *places)
        facet = bent(facet, flat, live.direction[:, some])
        crossing.normal = crossing.normal.copy()
        crossing.normal[:, some] = facet
        return live, met, crossing, rows


@dataclass
class _Crossing(Columns):
    """What rays cross at an interface; normals (3, L) are unit and against the rays.

    `straight`: the medium that holds stays the same. `eta`: ior before over ior behind. `entered`:
    as `_Live`'s, behind. `flat`: normal of the surface, `normal`: the one for refraction.
    """

    straight: NDArray[np.bool_]
    eta: Floats
    entered: NDArray[np.int16]
    flat: Floats
    normal: Floats


FACETS = 6
"""Facets of a rough interface that stand for all of them."""

CLEARANCE = 2.0
"""Distance, in those within which surfaces touch, that rays are put off an interface where rounding
must not let them meet it again (C. Wächter and N. Binder, A Fast and Robust Method for Avoiding
Self-Intersection, Ray Tracing Gems, 2019). Closed forms need none: their sides tell."""


@dataclass
class _Meeting:
    """Rays of a block, by `index`, that meet an interface of a glass in one medium of it."""

    number: int
    glass: PlacedGlass
    index: NDArray[np.intp]
    way: Floats
    interface: NDArray[np.intp]
    mark: Floats
    beyond: NDArray[np.int8]
    rays: Rays
    """In the glass's frame and unit of length."""

    def take(self, which) -> _Meeting:
        if len(which) == len(self.index):
            return self
        index, way, interface, mark, beyond = (
            part[which] for part in (self.index, self.way, self.interface, self.mark, self.beyond)
        )
        rays = self.rays.take(which)
        return _Meeting(self.number, self.glass, index, way, interface, mark, beyond, rays)

    def normals(self) -> tuple[Floats, Floats]:
        """Unit normals (3, n) in the world, for shading and of the surface: the same."""
        body = self.glass.body
        found = columns(body.steady.T, self.interface)
        for number in np.unique(self.interface[np.isnan(found[0])]):
            some = np.flatnonzero(self.interface == number)
            surface = body.interfaces[number].surface
            place = self.rays.take(some).at(self.way[some] / body.scale)
            marks = (self.mark[some],) if isinstance(surface, Profile) else ()
            for axis, part in enumerate(surface.normal(*place, *marks)):
                found[axis][some] = part
        found = rotated(self.glass.pose[:3, :3], found)
        return found, found


@dataclass
class _Faces(Columns):
    """Rays, by `index`, that meet faces of meshes; glass by `number`, unit normals (3, n), and
    `surface` as of `_NextFace`."""

    interface = 0
    index: NDArray[np.intp]
    way: Floats
    number: NDArray[np.intp]
    beyond: NDArray[np.int8]
    flat: Floats
    smooth: Floats
    surface: Floats

    def within(self, block: slice) -> _Faces:
        """Those of a block of rays, counted from its first."""
        first, last = np.searchsorted(self.index, (block.start, block.stop))
        found = self.take(slice(first, last))
        found.index = found.index - block.start
        return found

    def normals(self) -> tuple[Floats, Floats]:
        """Unit normals (3, n) in the world, for shading and of the surface."""
        return self.smooth, self.flat


def _meetings(
    number: int, glass: PlacedGlass, live: _Live, media: NDArray, block: slice, met: _NextFace
) -> list[_Meeting]:
    """The meetings of a block's rays with a glass, one for each medium of it that they are in."""
    place, direction = live.place[:, block], live.direction[:, block]
    candidates = np.flatnonzero((media > 0) | glass.near(place, direction))
    if not len(candidates):
        return []
    place, direction = glass.inward(columns(place, candidates), columns(direction, candidates))
    media = media[candidates]
    body = glass.body
    found = []
    for medium in np.flatnonzero(np.bincount(media, minlength=1)):
        some = np.flatnonzero(media == medium)
        rays = Rays(tuple(columns(place, some)), tuple(columns(direction, some)))
        interface, way, mark = nearest(body, int(medium), rays)
        on = np.flatnonzero(interface >= 0)
        index = candidates[some]
        if medium not in body.endless:
            met.leaked[block][index[interface < 0]] = True
        if not len(on):
            continue
        interface = interface[on]
        found.append(
            _Meeting(
                number,
                glass,
                index[on],
                way[on] * body.scale,
                interface,
                mark[on],
                body.beyond(int(medium))[interface],
                rays.take(on),
            )
        )
    return found


def _path_on(path: NDArray[np.uint64], code: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The hash of a path that goes on with a code; whether it was mirrored before stays."""
    return (fold(path, code) & ~MIRRORED) | (path & MIRRORED)


def _interface_code(glass, interface) -> NDArray[np.int64]:
    """Odd numbers for refraction at an interface; reflection is one more."""
    return (glass.astype(np.int64) * STAMPS + interface) * 2 + 1


def _go_on() -> None:
    """Nobody wants to end the call."""


def _integers(name: str, value: ArrayLike, total: int) -> NDArray[np.int64]:
    numbers = np.asarray(value)
    if numbers.shape != (total,) or numbers.dtype.kind not in "iu":
        raise ValueError(f"{name} must be {total} integers, not {numbers.dtype} {numbers.shape}")
    return numbers.astype(np.int64)


def exit_rays(
    glasses: Sequence[Placed],
    origin: ArrayLike,
    direction: ArrayLike,
    *,
    min_weight: float = 0.005,
    most_events: int = ENDLESS,
    cast: Cast | None = None,
    things: ArrayLike | None = None,
    meet: Meet | None = None,
    fresnel: bool = True,
    pixel: ArrayLike | None = None,
    sample: ArrayLike | None = None,
    between: Callable[[], None] | None = None,
    stretches: bool = False,
) -> ExitRays:
    """Follow rays through glasses along all ways that carry enough of the light.

    Parameters
    ----------
    glasses
        The glasses in the world; none at all is allowed.
    origin : (3,) or (M, 3)
        World, metres.
    direction : (M, 3)
        Need not be unit.
    min_weight
        Light below this part of a ray's is not followed on but counted as lost. Long ways, of more
        than `PLAIN` events, must carry more: in proportion to their events, up to `STRONG`.
    most_events
        Light that would be refracted or reflected more often is lost.
    cast
        Tells how far things are that are no glass; called once a step for all rays together. A
        thing is seen where a ray meets it before the next interface. A thing that touches an
        interface (`TOUCHING`) is seen behind it, through a film of what is there.
    things : (B, 2, 3), optional
        Boxes (lower, upper corner) round all things: rays that do not come into one before their
        next interface are not cast, and distances may be off by their `grain`. None: all are cast.
    meet
        Tells the next faces of the glasses that are meshes; called once a step for all rays that
        can meet one.
    fresnel
        False: interfaces only refract and take no light in doing so. What is totally reflected is
        followed all the same.
    pixel, sample : (M,) int, optional
        Choose the facets of rough glasses: the same numbers, the same facets, whatever moves. The
        rays of one pixel, numbered by `sample`, have facets that are spread evenly. None: every ray
        is a pixel of its own.
    between
        Called before each step and each block of rays, perhaps in other threads; what it raises
        ends the call.
    stretches
        Whether the stretches of rays up to interfaces are told.

    Raises
    ------
    ValueError
        Where the glasses' surroundings differ, an absorption has the wrong shape, or there are
        meshes and no `meet`, or painted ones of which it does not tell the surface.
    """
    directions = np.atleast_2d(np.asarray(direction, dtype=float))
    origins = np.asarray(origin, dtype=float)
    total = len(directions)
    _, unit, fit = proper_rays(origins, directions)
    boxes = None if things is None else np.asarray(things, dtype=float).reshape(-1, 2, 3)
    followed = _Followed(
        glasses,
        min_weight,
        most_events,
        cast,
        meet,
        fresnel,
        boxes,
        _integers("pixel", np.arange(total) if pixel is None else pixel, total),
        _integers("sample", np.zeros(total, int) if sample is None else sample, total),
        between or _go_on,
        stretches,
    )
    lost, stuck = np.where(fit, 0.0, 1.0), np.zeros(total)
    live = followed.start(origins, unit, np.flatnonzero(fit))
    while len(live) and followed.steps < most_events + MOST_STRAIGHT:
        live = followed.step(live, lost, stuck)
    lost += np.bincount(live.ray, live.weight, total)
    rows = [*followed.rows, (live.take(slice(0, 0)), np.zeros(0))]
    ends = _Live.join([row[0] for row in rows])
    distance = np.concatenate([row[1] for row in rows])
    order = np.argsort(ends.ray, kind="stable")
    ends, distance = ends.take(order), distance[order]
    # For one that ends black a thing behind the interface was looked for.
    thing = np.where(np.isfinite(distance), ends.thing, -1)
    passed = [
        (np.zeros(0, np.int32), np.zeros((0, 2, 3), np.float32)),
        *followed.passed,
    ]
    passed_ray, passed = (np.concatenate(part) for part in zip(*passed, strict=True))
    depth = ends.depth if followed.dims else np.zeros((3, len(ends)))
    return ExitRays(
        ray=ends.ray,
        weight=ends.weight,
        depth=np.ascontiguousarray(depth.T),
        origin=np.ascontiguousarray(ends.place.T),
        direction=np.ascontiguousarray(ends.direction.T),
        distance=distance,
        thing=thing.astype(np.intp),
        events=ends.events.astype(np.intp),
        rough=ends.facet >= 0,
        path=ends.path.view(np.int64),
        lost=lost,
        stuck=stuck,
        steps=followed.steps,
        passed_ray=passed_ray,
        passed=passed,
    )
