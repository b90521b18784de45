# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays through any number of glasses at once: where the light of a ray comes from.

All rays advance together, one interface a step. In each step every ray meets the nearest interface
of any glass, or a thing before it, or nothing more; at an interface it splits by Fresnel's
equations. What a ray ends with are its *exit rays*: each has an origin, a direction, a share of the
light and the distance to the thing that it sees.

Glasses may overlap. A ray knows the medium of every glass that it is in; the one of the glass with
the highest priority holds (nested dielectrics: C. Schmidt and B. Budge, Simple Nested Dielectrics
in Ray Traced Images, Journal of Graphics Tools 7, 2002). An interface that does not change the
medium that holds is passed straight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import ENDLESS, PLAIN, BoundedGlass, nearest_marked
from .glasses import _positive
from .laws import reflectance_and_cosine
from .profiles import Profile
from .solver import in_blocks
from .surfaces import Floats, Rays

TOUCHING = 2.0**-21
"""Relative distance within which two surfaces touch: of the largest coordinate of the place where a
ray starts, or of the way to where it meets them. It is four roundings of the float32 numbers in
which Blender keeps places."""

MOST_STRAIGHT = 64
"""Interfaces that a ray may pass straight, beside the `most_events` at which it is turned."""

STAMPS = 1 << 12
"""More than the glasses of a scene: priorities, entries and the order of the list in one number."""

NOWHERE = np.iinfo(np.int64).min
"""Rank of a glass that a ray is not in."""


def _roughness(value: object) -> float:
    if not (isinstance(value, (int, float)) and 0.0 <= value <= 1.0):
        raise ValueError(f"roughness must be between 0 and 1, not {value!r}")
    return float(value)


@dataclass(frozen=True, eq=False)
class PlacedGlass:
    """A glass of closed form in the world.

    Parameters
    ----------
    body : BoundedGlass
        Its description, see `body`; lengths in metres in its own frame.
    pose : (4, 4)
        Rigid: from the body's frame to the world, metres. A mirror image is rigid too.
    absorption : (len(body.media), 3), optional
        Absorption coefficients of each medium, per metre, red, green, blue. Medium 0 is not looked
        at: the surroundings are clear.
    priority : int
        Of the media that overlap, that of the highest priority holds; of equal ones, that which the
        ray entered first (what it starts in or enters at one place: the first in the list).
    roughness : float
        Of all its interfaces, 0 to 1, as a Glass BSDF has it (GGX). A ray is split at the first
        into `FACETS` rays.
    """

    body: BoundedGlass
    pose: ArrayLike
    absorption: ArrayLike | None = None
    priority: int = 0
    roughness: float = 0.0

    def __post_init__(self) -> None:
        pose = np.array(self.pose, dtype=float)
        turn = pose[:3, :3] if pose.shape == (4, 4) else None
        if turn is None or not np.allclose(turn @ turn.T, np.eye(3), atol=RIGID):
            raise ValueError(f"pose must be a rigid (4, 4) matrix, not {self.pose!r}")
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "roughness", _roughness(self.roughness))

    @property
    def media(self) -> tuple[float, ...]:
        return self.body.media

    @cached_property
    def _ball(self) -> tuple[Floats, float]:
        """Middle and radius of a ball round the body in the world, metres."""
        low, high = self.body.box
        middle = self.pose[:3, :3] @ (0.5 * (low + high)) + self.pose[:3, 3]
        return middle, 0.5 * float(np.linalg.norm(high - low)) * (1.0 + ROUNDING)

    @property
    def absorptions(self) -> ArrayLike | None:
        """Of each of `media`, per metre."""
        return self.absorption

    def inward(self, place: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Places and directions (3, M) of the world in the body's frame and unit of length."""
        turn, origin = self.pose[:3, :3].T, self.pose[:3, 3]
        local = _turned(turn, place - origin[:, None])
        local /= self.body.scale
        return local, _turned(turn, direction)

    def near(self, place: Floats, direction: Floats) -> NDArray[np.bool_]:
        """Which rays of the world, (3, M) each, pass through a ball round the body."""
        middle, radius = self._ball
        away = place - middle[:, None]
        square = _dot(away, away)
        along = _dot(away, direction)
        # What rounding takes from the difference of squares is given back.
        least = radius * radius + ROUNDING * square
        return (square - along * along <= least) & ((along < 0.0) | (square <= least))


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """A glass that is a mesh. Where it is, the callback `meet` of `exit_rays` tells.

    The front of a face is outside: a ray that meets a front is behind it in the glass, one that
    meets a back was in the glass before, whatever it met before. So a mesh need not be closed, and
    is treated as Cycles treats it. A ray that starts in a mesh is known to be in it from the first
    of its faces that it meets.

    Parameters
    ----------
    ior : float
    absorption : (3,), optional
        Absorption coefficients per metre, red, green, blue.
    priority : int
        As of `PlacedGlass`.
    roughness : float
        As of `PlacedGlass`.
    box : (2, 3), optional
        Lower and upper corner of a box round it in the world, metres: other rays are not asked for.
    """

    ior: float
    absorption: ArrayLike | None = None
    priority: int = 0
    roughness: float = 0.0
    box: ArrayLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "ior", _positive("ior", self.ior))
        object.__setattr__(self, "roughness", _roughness(self.roughness))

    @property
    def media(self) -> tuple[float, ...]:
        """The ior of what is around it, where nothing else is, and its own."""
        return (1.0, self.ior)

    @property
    def absorptions(self) -> ArrayLike | None:
        """Of each of `media`, per metre."""
        return None if self.absorption is None else np.array([(0.0, 0.0, 0.0), self.absorption])


RIGID = 1e-6
"""How far the columns of a pose may be from perpendicular unit vectors."""

ROUNDING = 1e-12
"""Relative margin of the balls round glasses."""


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
        Optical depth of all media passed, up to the thing seen: ``exp(-depth)`` gets through.
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
    path : (K,) int64
        The same for rays with the same sequence of (glass, interface, refracted or reflected), 0
        for none; comparable between calls with the same list of glasses. It is a hash: two
        sequences share one with a chance of 2⁻⁶⁴.
    lost : (M,)
        Share of each ray's light that was not followed to its end. With the weights it adds up to
        1. All of it for a ray that is none (not finite, or without a direction).
    steps : int
        Steps taken, each with at most one call of `cast` and of `meet`.
    """

    ray: NDArray[np.intp]
    weight: Floats
    depth: Floats
    origin: Floats
    direction: Floats
    distance: Floats
    thing: NDArray[np.intp]
    events: NDArray[np.intp]
    path: NDArray[np.int64]
    lost: Floats
    steps: int


Placed = PlacedGlass | PlacedMesh

Cast = Callable[[Floats, Floats], tuple[Floats, NDArray[np.intp]]]
"""(origins (L, 3), unit directions (L, 3)) -> (L,) metres to the nearest thing, inf for none, and
its number (L,), -1 for none."""

Meet = Callable[[Floats, Floats], tuple[NDArray[np.intp], Floats, Floats, Floats]]
"""(origins (L, 3), unit directions (L, 3)) -> of the next face of a mesh that is a glass: number of
the glass (L,) in the list of all, metres (L,) to it, inf for none, the face's normal (L, 3) and the
interpolated one, both towards its front, not necessarily unit.

Meshes that touch each other must be told apart: then each result has a first axis more, (H, L) and
(H, L, 3), with the next face of one group of meshes in each row.
"""


@dataclass
class _Live:
    """Rays on their way, in the world; the last axis counts them.

    `medium`: of each glass, 0 outside it. `entered`: the step in which each glass was entered.
    `facet`: the ray's number among those into which the first rough interface split it, else -1.
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

    def __len__(self) -> int:
        return len(self.ray)

    def take(self, which) -> _Live:
        return _Live(*(getattr(self, part.name)[..., which] for part in fields(self)))

    @staticmethod
    def join(parts: Sequence[_Live]) -> _Live:
        names = [part.name for part in fields(_Live)]
        return _Live(
            *(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names)
        )


@dataclass
class _Met:
    """The next interface of every ray: way to it (inf: none), glass, interface, unit normal (3, L).

    `flat`: normals of a mesh's faces, where there are meshes, else (0, L); `normal` then is the
    interpolated one. `after`: medium of every glass behind it. `leaked`: the ray is in a glass of
    which it meets nothing, by rounding.
    """

    way: Floats
    glass: NDArray[np.int16]
    interface: NDArray[np.int32]
    normal: Floats
    flat: Floats
    after: NDArray[np.int8]
    leaked: NDArray[np.bool_]

    def take(self, which) -> _Met:
        return _Met(*(getattr(self, part.name)[..., which] for part in fields(self)))


class _Media:
    """What holds where: tables of all media of all glasses."""

    def __init__(self, glasses: Sequence[Placed]) -> None:
        around = {glass.media[0] for glass in glasses if isinstance(glass, PlacedGlass)}
        if len(around) > 1:
            raise ValueError(f"glasses must have the same surroundings, not ior {sorted(around)}")
        if len(glasses) >= STAMPS:
            raise ValueError(f"glasses must be fewer than {STAMPS}, not {len(glasses)}")
        widest = max((len(glass.media) for glass in glasses), default=1)
        # The last row, which -1 finds, are the surroundings.
        self.ior = np.full((len(glasses) + 1, widest), around.pop() if around else 1.0)
        self.absorption = np.zeros((len(glasses) + 1, widest, 3))
        for number, glass in enumerate(glasses):
            count = len(glass.media)
            self.ior[number, 1:count] = glass.media[1:]
            if glass.absorptions is None:
                continue
            table = np.asarray(glass.absorptions, dtype=float)
            if table.shape != (count, 3):
                raise ValueError(f"absorption must be ({count}, 3), not of shape {table.shape}")
            self.absorption[number, 1:count] = table[1:]
        self.clear = not self.absorption.any()
        ranks = {value: n for n, value in enumerate(sorted({g.priority for g in glasses}))}
        # Priority first, then what was entered before, then the order of the list.
        self.rank = np.array(
            [ranks[g.priority] * STAMPS**3 - number for number, g in enumerate(glasses)],
            dtype=np.int64,
        )

    def holding(self, medium, entered) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Glass (-1: none) and its medium (0: none) that hold, of media (G, L) of every glass."""
        count = medium.shape[1]
        if not len(medium):
            return np.full(count, -1), np.zeros(count, dtype=np.intp)
        if len(medium) == 1:
            return np.where(medium[0] > 0, 0, -1), medium[0].astype(np.intp)
        rank = self.rank[:, None] - entered.astype(np.int64) * STAMPS
        rank[medium == 0] = NOWHERE
        first = np.argmax(rank, axis=0)
        held = medium[first, np.arange(count)].astype(np.intp)
        return np.where(held > 0, first, -1), held


@dataclass
class _Followed:
    """One call of `exit_rays`."""

    glasses: Sequence[Placed]
    min_weight: float
    most_events: int
    cast: Cast | None
    ask: Meet | None
    fresnel: bool
    things: Floats | None
    pixel: NDArray[np.int64]
    media: _Media = field(init=False)
    meshes: list[int] = field(init=False)
    alpha: Floats = field(init=False)
    rows: list[tuple[_Live, Floats, NDArray[np.intp]]] = field(default_factory=list)
    steps: int = 0

    def __post_init__(self) -> None:
        self.media = _Media(self.glasses)
        self.meshes = [n for n, glass in enumerate(self.glasses) if isinstance(glass, PlacedMesh)]
        self.alpha = np.array([glass.roughness**2 for glass in self.glasses])
        self.rough = bool(self.alpha.any())
        if self.meshes and self.ask is None:
            raise ValueError("meet must tell where the glasses are that are meshes, not None")

    # ---- the start ----------------------------------------------------------------------

    def start(self, origin: Floats, direction: Floats, proper: NDArray[np.intp]) -> _Live:
        """The proper rays of unit directions (M, 3)."""
        count, glasses = len(proper), len(self.glasses)
        single = origin.ndim == 1
        medium = np.zeros((glasses, count), dtype=np.int8)
        places = origin[None] if single else origin[proper]
        for number, glass in enumerate(self.glasses):
            if number in self.meshes:
                continue
            turn, middle = glass.pose[:3, :3], glass.pose[:3, 3]
            medium[number] = glass.body.medium_at((places - middle) @ turn)
        return _Live(
            ray=proper,
            place=np.array(np.broadcast_to(places.T, (3, count))),
            direction=np.ascontiguousarray(direction[proper].T),
            weight=np.ones(count),
            depth=np.zeros((3, count)),
            events=np.zeros(count, dtype=np.int32),
            path=np.zeros(count, dtype=np.uint64),
            medium=medium,
            entered=np.zeros((glasses, count), dtype=np.int16),
            facet=np.full(count, -1, dtype=np.int8),
        )

    # ---- one step -----------------------------------------------------------------------

    def step(self, live: _Live, lost: Floats) -> _Live:
        """The rays behind their next interface; those that end are kept in `rows`."""
        self.steps += 1
        met = self.meet(live)
        free, thing = self.look(live, met)
        reach = np.abs(live.place).max(axis=0)
        finite = np.isfinite(met.way)
        near = TOUCHING * np.where(finite, np.maximum(reach, met.way), reach)
        seen = free < np.where(finite, met.way - near, np.inf)
        leaked = met.leaked & ~seen
        ends = (seen | ~finite) & ~leaked
        if not self.media.clear:
            length = np.where(ends, free, met.way)
            glass, medium = self.media.holding(live.medium, live.entered)
            # What is seen at infinity through a medium without end is not dimmed.
            way = np.where(np.isfinite(length), length, 0.0)
            live.depth += self.media.absorption[glass, medium].T * way
        which = np.flatnonzero(ends)
        self.rows.append((live.take(which), free[which], thing[which]))
        lost += np.bincount(live.ray[leaked], live.weight[leaked], len(lost))
        on = np.flatnonzero(~ends & ~leaked)
        touched = free[on] <= met.way[on] + near[on]
        return self.split(live.take(on), met.take(on), touched, thing[on], near[on], lost)

    def meet(self, live: _Live) -> _Met:
        """The next interface of every ray, of all glasses."""
        count = len(live)
        met = _Met(
            way=np.full(count, np.inf),
            glass=np.full(count, -1, dtype=np.int16),
            interface=np.zeros(count, dtype=np.int32),
            normal=np.zeros((3, count)),
            flat=np.zeros((3 if self.meshes else 0, count)),
            after=live.medium.copy(),
            leaked=np.zeros(count, dtype=bool),
        )
        sheets = self.meet_meshes(live) if self.meshes else []

        def work(block: slice) -> None:
            found: list[_Meeting | _Faces] = [sheet.within(block) for sheet in sheets]
            for number, glass in enumerate(self.glasses):
                if isinstance(glass, PlacedGlass):
                    found += _meetings(number, glass, live, block, met)
            way = met.way[block]
            for meeting in found:
                way[meeting.index] = np.minimum(way[meeting.index], meeting.way)
            reach = np.abs(live.place[:, block]).max(axis=0) if len(found) > 1 else None
            telling = np.full(len(way), NOWHERE)
            for meeting in found:
                if reach is not None:
                    nearest = way[meeting.index]
                    near = TOUCHING * np.maximum(reach[meeting.index], nearest)
                    meeting = meeting.take(np.flatnonzero(meeting.way <= nearest + near))
                if not len(meeting.index):
                    continue
                index = meeting.index + block.start
                met.after[meeting.number, index] = meeting.beyond
                if isinstance(meeting, _Faces):
                    live.medium[meeting.number, index] = 1 - meeting.beyond
                # Of interfaces that touch, that of the highest priority tells what happens.
                rank = self.media.rank[meeting.number]
                first = np.flatnonzero(rank > telling[meeting.index])
                meeting, index = meeting.take(first), index[first]
                telling[meeting.index] = self.media.rank[meeting.number]
                met.glass[index] = meeting.number
                met.interface[index] = meeting.interface
                met.normal[:, index], flat = meeting.normals()
                if self.meshes:
                    met.flat[:, index] = flat

        in_blocks(work, count)
        return met

    def meet_meshes(self, live: _Live) -> list[_Faces]:
        """The next faces of meshes, for those rays that can meet one."""
        boxes = [self.glasses[number].box for number in self.meshes]
        some = np.arange(len(live))
        if not any(box is None for box in boxes):
            inside = (live.medium[self.meshes] > 0).any(axis=0)
            inside |= _meets_boxes(np.asarray(boxes, dtype=float), live, np.full(len(live), np.inf))
            some = np.flatnonzero(inside)
        if not len(some):
            return []
        along = live.direction[:, some]
        origins = np.ascontiguousarray(live.place[:, some].T)
        glass, way, flat, smooth = self.ask(origins, np.ascontiguousarray(along.T))
        found = []
        rows = (np.asarray(part).reshape(-1, *part.shape[-1:]) for part in (glass, way))
        vectors = (
            np.asarray(part, dtype=float).reshape(-1, len(some), 3) for part in (flat, smooth)
        )
        for numbers, ways, flats, smooths in zip(*rows, *vectors, strict=True):
            on = np.flatnonzero(np.isfinite(ways))
            on = on[np.abs(flats[on]).max(axis=1, initial=0.0) > 0.0]
            flats, smooths = _units(flats[on].T), _units(smooths[on].T)
            lost = ~smooths.any(axis=0)
            smooths[:, lost] = flats[:, lost]
            beyond = (_dot(flats, along[:, on]) < 0.0).astype(np.int8)
            found.append(
                _Faces(some[on], ways[on], numbers[on].astype(np.intp), beyond, flats, smooths)
            )
        return found

    def look(self, live: _Live, met: _Met) -> tuple[Floats, NDArray[np.intp]]:
        """Metres (L,) to the nearest thing, looked for where one can be, and its number."""
        free, thing = np.full(len(live), np.inf), np.full(len(live), -1, dtype=np.intp)
        if self.cast is None or not len(live):
            return free, thing
        some = slice(None)
        if self.things is not None:
            some = np.flatnonzero(_meets_boxes(self.things, live, met.way))
            if not len(some):
                return free, thing
        origins = np.ascontiguousarray(live.place[:, some].T)
        along = np.ascontiguousarray(live.direction[:, some].T)
        free[some], thing[some] = self.cast(origins, along)
        return free, thing

    def split(self, live: _Live, met: _Met, touched, thing, near, lost: Floats) -> _Live:
        """The rays behind the interfaces that they met.

        `touched`: a thing touches the interface within `near`. Between the two is a film of the
        medium behind the interface: what gets through the interface sees the thing.
        """
        children: dict[int, tuple[tuple, _Live, tuple]] = {}

        def work(block: slice) -> None:
            children[block.start] = self._split(
                live.take(block), met.take(block), touched[block], thing[block], near[block]
            )

        in_blocks(work, len(live))
        further = []
        for _, (seen, followed, dropped) in sorted(children.items()):
            if len(seen[1]):
                self.rows.append((seen[0], np.zeros(len(seen[1])), seen[1]))
            further.append(followed)
            lost += np.bincount(*dropped, len(lost))
        return _Live.join(further) if further else live

    def _split(self, live: _Live, met: _Met, touched, thing, near) -> tuple[tuple, _Live, tuple]:
        """Rays that see what touches and what that is, rays to follow, and (ray, weight) of what is
        dropped."""
        live.place += met.way * live.direction
        crossing = self._crossing(live, met)
        if self.rough:
            live, met, crossing, rows = self._roughened(live, met, crossing)
            touched, thing, near = touched[rows], thing[rows], near[rows]
        straight, eta, flat = crossing.straight, crossing.eta, crossing.flat
        direction, normal = live.direction, crossing.normal
        cosine = np.minimum(np.maximum(-_dot(normal, direction), 0.0), 1.0)
        reflectance, behind = reflectance_and_cosine(cosine, eta)
        if not self.fresnel:
            reflectance = np.where(behind > 0.0, 0.0, 1.0)
        reflectance[straight] = 0.0

        events = live.events + ~straight
        enough, dropped = [], [(live.ray[:0], live.weight[:0])]
        shares = live.weight * (1.0 - reflectance), live.weight * reflectance
        for weight in shares:
            keep = weight > self._least(live, events, straight)
            keep &= events <= self.most_events
            rest = np.flatnonzero(~keep & (weight > 0.0))
            dropped.append((live.ray[rest], weight[rest]))
            enough.append(keep)
        passed, on, back = enough[0], *(np.flatnonzero(keep) for keep in enough)

        through = live.take(on)
        turned = _refracted(direction, normal, cosine, behind, eta)
        through.direction = np.where(straight, direction, turned)[:, on]
        through.weight, through.events = shares[0][on], events[on]
        through.medium, through.entered = met.after[:, on], crossing.entered[:, on]
        code = _interface_code(met.glass, met.interface)
        folded = _fold(through.path, code[on])
        through.path = np.where(straight[on], through.path, folded)
        if self.meshes:
            # Off all faces that were passed here, which float32 puts a little before or behind.
            through.place -= CLEARANCE * near[on] * flat[:, on]

        off = live.take(back)
        mirrored = direction + (2.0 * cosine) * normal
        off.direction = _units(mirrored[:, back])
        off.weight, off.events = shares[1][back], events[back]
        off.path = _fold(off.path, code[back] + 1)
        # A thing that touches is on the other side, whatever the rounding of its distance.
        aside = near[back] if self.meshes else np.where(touched[back], near[back], 0.0)
        off.place += CLEARANCE * aside * flat[:, back]

        meets = (touched & passed)[on]
        seen = through.take(np.flatnonzero(meets)), thing[on][meets]
        through = through.take(np.flatnonzero(~meets))
        ray, weight = (np.concatenate(column) for column in zip(*dropped, strict=True))
        return seen, _Live.join([through, off]), (ray, weight)

    def _least(self, live: _Live, events, straight) -> Floats:
        """The weight that a ray must have more than to be followed."""
        if not self.fresnel:
            return np.zeros(len(live))
        # Long ways, round in a wall, must carry more.
        least = self.min_weight * np.maximum(1.0, events / PLAIN)
        if self.rough:
            least = np.where(live.facet < 0, least, least / FACETS)
        least[straight] = 0.0
        return least

    def _crossing(self, live: _Live, met: _Met) -> _Crossing:
        """What rays at their interfaces cross."""
        direction = live.direction
        glass, medium = self.media.holding(live.medium, live.entered)
        entered = np.where((met.after > 0) & (live.medium == 0), self.steps, live.entered)
        entered = entered.astype(np.int16)
        glass_after, medium_after = self.media.holding(met.after, entered)
        straight = (glass == glass_after) & (medium == medium_after)
        eta = self.media.ior[glass, medium] / self.media.ior[glass_after, medium_after]
        if not self.meshes:
            normal = met.normal * _against(met.normal, direction)
            return _Crossing(straight, eta, entered, normal, normal)
        # The interpolated normal is on the side that the face's is on.
        side = _against(met.flat, direction)
        flat = met.flat * side
        normal = _bent(met.normal * side, flat, direction, eta)
        return _Crossing(straight, eta, entered, flat, normal)

    def _roughened(self, live: _Live, met: _Met, crossing: _Crossing) -> tuple:
        """The same with normals of facets where a glass is rough, and the rows they are of.

        At the first rough interface a ray becomes `FACETS` rays, one a facet. From there on each
        keeps its number, and meets one facet at each rough interface.
        """
        alpha = self.alpha[met.glass]
        rough = (alpha > 0.0) & ~crossing.straight
        rows = np.repeat(np.arange(len(live)), np.where(rough & (live.facet < 0), FACETS, 1))
        fresh = (rough & (live.facet < 0))[rows]
        live, met, crossing = live.take(rows), met.take(rows), crossing.take(rows)
        # A ray's copies are neighbours: they are counted from the first.
        first = np.searchsorted(rows, rows[fresh])
        live.facet[fresh] = np.flatnonzero(fresh) - first
        live.weight[fresh] /= FACETS
        some = np.flatnonzero(rough[rows])
        normal, flat = crossing.normal[:, some], crossing.flat[:, some]
        shares = _shares(self.pixel[live.ray[some]], live.facet[some], live.events[some])
        facet = _facets(normal, live.direction[:, some], alpha[rows[some]], *shares)
        facet = _bent(facet, flat, live.direction[:, some], crossing.eta[some])
        crossing.normal = crossing.normal.copy()
        crossing.normal[:, some] = facet
        return live, met, crossing, rows


@dataclass
class _Crossing:
    """What rays cross at an interface; normals (3, L) are unit and against the rays.

    `straight`: the medium that holds stays the same. `eta`: ior before over ior behind. `entered`:
    as `_Live`'s, behind. `flat`: normal of the surface, `normal`: the one for refraction.
    """

    straight: NDArray[np.bool_]
    eta: Floats
    entered: NDArray[np.int16]
    flat: Floats
    normal: Floats

    def take(self, which) -> _Crossing:
        return _Crossing(*(getattr(self, part.name)[..., which] for part in fields(self)))


FACETS = 6
"""Facets of a rough interface that stand for all of them."""

CLEARANCE = 2.0
"""Distance, in those within which surfaces touch, that rays are put off an interface where rounding
must not let them meet it again (C. Wächter and N. Binder, A Fast and Robust Method for Avoiding
Self-Intersection, Ray Tracing Gems, 2019). Closed forms need none: their sides tell."""

LEAST = 1e-300
"""Stands for a square of 0."""


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
        found = np.zeros((3, len(self.index)))
        place = self.rays.at(self.way / body.scale)
        for number in np.unique(self.interface):
            some = np.flatnonzero(self.interface == number)
            surface = body.interfaces[number].surface
            here = tuple(part[some] for part in place)
            marks = (self.mark[some],) if isinstance(surface, Profile) else ()
            for axis, part in enumerate(surface.normal(*here, *marks)):
                found[axis, some] = part
        found = _turned(self.glass.pose[:3, :3], found)
        return found, found


@dataclass
class _Faces:
    """Rays, by `index`, that meet faces of meshes; glass by `number`, unit normals (3, n)."""

    index: NDArray[np.intp]
    way: Floats
    number: NDArray[np.intp]
    beyond: NDArray[np.int8]
    flat: Floats
    smooth: Floats
    interface: int = 0

    def take(self, which) -> _Faces:
        parts = self.index, self.way, self.number, self.beyond
        return _Faces(*(part[which] for part in parts), self.flat[:, which], self.smooth[:, which])

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
    number: int, glass: PlacedGlass, live: _Live, block: slice, met: _Met
) -> list[_Meeting]:
    """The meetings of a block's rays with a glass, one for each medium of it that they are in."""
    place, direction, media = live.place[:, block], live.direction[:, block], live.medium[number]
    media = media[block]
    candidates = np.flatnonzero((media > 0) | glass.near(place, direction))
    place, direction = glass.inward(place[:, candidates], direction[:, candidates])
    media = media[candidates]
    body = glass.body
    found = []
    for medium in np.flatnonzero(np.bincount(media, minlength=1)):
        some = np.flatnonzero(media == medium)
        rays = Rays(tuple(place[:, some]), tuple(direction[:, some]))
        interface, way, mark = nearest_marked(body, int(medium), rays)
        on = np.flatnonzero(interface >= 0)
        index = candidates[some]
        if medium not in body.endless:
            met.leaked[block][index[interface < 0]] = True
        if not len(on):
            continue
        interface = interface[on]
        beyond = np.array([part.beyond(int(medium)) for part in body.interfaces], dtype=np.int8)
        found.append(
            _Meeting(
                number,
                glass,
                index[on],
                way[on] * body.scale,
                interface,
                mark[on],
                beyond[interface],
                rays.take(on),
            )
        )
    return found


def _meets_boxes(boxes: Floats, live: _Live, way: Floats) -> NDArray[np.bool_]:
    """Which rays come, before their next interface or as near to it as things touch, into one of
    the boxes (B, 2, 3)."""
    found = np.zeros(len(way), dtype=bool)
    # A direction of 0 is taken as one too small to matter.
    along = np.where(np.abs(live.direction) < LEAST, LEAST, live.direction)
    inverse = 1.0 / along
    reach = np.abs(live.place).max(axis=0)
    for low, high in boxes:
        margin = TOUCHING * max(np.abs(low).max(), np.abs(high).max())
        begin = ((low - margin)[:, None] - live.place) * inverse
        end = ((high + margin)[:, None] - live.place) * inverse
        enters = np.minimum(begin, end).max(axis=0)
        leaves = np.maximum(begin, end).min(axis=0)
        last = way + 2.0 * TOUCHING * np.maximum(reach, np.where(np.isfinite(way), way, 0.0))
        found |= (enters <= np.minimum(leaves, last)) & (leaves >= 0.0)
    return found


def _facets(normal: Floats, direction: Floats, alpha: Floats, first, second) -> Floats:
    """Normals (3, L) of facets of a rough surface as a ray sees them.

    GGX, visible normals, by two shares (L,) between 0 and 1 (J. Dupuy and A. Benyoub, Sampling
    Visible GGX Normals with Spherical Caps, 2023). `alpha`: roughness squared.
    """
    # A frame round the normal (T. Duff and others, Building an Orthonormal Basis, Revisited, 2017)
    x, y, z = normal
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    one = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    other = np.stack([b, sign + y * y * a, -y])
    view = _units(
        np.stack(
            [
                -alpha * _dot(one, direction),
                -alpha * _dot(other, direction),
                -_dot(normal, direction),
            ]
        )
    )
    azimuth = 2.0 * np.pi * first
    height = (1.0 - second) * (1.0 + view[2]) - view[2]
    radius = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    x, y, z = (
        radius * np.cos(azimuth) + view[0],
        radius * np.sin(azimuth) + view[1],
        height + view[2],
    )
    return _units(alpha * x * one + alpha * y * other + np.maximum(z, 0.0) * normal)


def _shares(pixel, facet, events) -> tuple[Floats, Floats]:
    """Two numbers between 0 and 1 for a pixel's facet at an event: always the same ones.

    The facets of a pixel are spread evenly (M. Roberts, The Unreasonable Effectiveness of
    Quasirandom Sequences, 2018), from a place that pixel and event choose.
    """
    found = []
    for axis, step in enumerate((0.7548776662466927, 0.5698402909980532)):
        start = _fold(pixel.astype(np.uint64), events.astype(np.int64) * 2 + axis + 1)
        start = _fold(start, np.int64(1))
        begin = (start >> np.uint64(11)).astype(float) * 2.0**-53
        found.append((begin + (facet + 0.5) * step) % 1.0)
    return found[0], found[1]


# Sums of products are written out: BLAS and einsum round the last columns of an array otherwise
# than the first, so that a ray's way would depend on its neighbours.


def _dot(a: Floats, b: Floats) -> Floats:
    """Inner products (L,) of vectors (3, L)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _turned(matrix: Floats, vectors: Floats) -> Floats:
    """The product of a matrix (3, 3) with vectors (3, L)."""
    found = np.empty(vectors.shape)
    for row, (a, b, c) in enumerate(matrix):
        found[row] = a * vectors[0] + b * vectors[1] + c * vectors[2]
    return found


def _units(vectors: Floats) -> Floats:
    """Vectors (3, L) made unit; 0 stays 0."""
    return vectors / np.sqrt(np.maximum(_dot(vectors, vectors), LEAST))


def _against(normal: Floats, direction: Floats) -> Floats:
    """The sign (L,) that turns normals (3, L) to the side that rays come from."""
    return np.where(_dot(normal, direction) > 0.0, -1.0, 1.0)


def _refracted(direction, normal, cosine, behind, eta) -> Floats:
    """Unit directions (3, L) behind a surface, the normal against `direction`."""
    return _units(eta * direction + (eta * cosine - behind) * normal)


def _bent(normal: Floats, flat: Floats, direction: Floats, eta: Floats) -> Floats:
    """Interpolated normals turned towards the face's as little as is needed.

    Behind them neither the reflected nor the refracted ray is on the wrong side of the face. (For
    reflected rays that is what Cycles' ``ensure_valid_specular_reflection`` does, with the same
    least angle to the face.)
    """
    grazing = np.minimum(-SHARE * _dot(flat, direction), CLEAR)
    _, below = reflectance_and_cosine(np.clip(-_dot(flat, direction), 0.0, 1.0), eta)
    sunk = np.minimum(SHARE * below, CLEAR)

    def right(part, which) -> NDArray[np.bool_]:
        d, f = direction[:, which], flat[:, which]
        cosine = -_dot(part, d)
        up = _dot(d, f) + 2.0 * cosine * _dot(part, f)
        _, behind = reflectance_and_cosine(np.clip(cosine, 0.0, 1.0), eta[which])
        down = -_dot(_refracted(d, part, cosine, behind, eta[which]), f)
        total = behind == 0.0
        return (cosine > 0.0) & (up >= grazing[which]) & (total | (down >= sunk[which]))

    wrong = np.flatnonzero(~right(normal, slice(None)) & (normal != flat).any(axis=0))
    if not len(wrong):
        return normal
    one, other = normal[:, wrong], flat[:, wrong]
    low, high = np.zeros(len(wrong)), np.ones(len(wrong))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = right(_units(one + middle * (other - one)), wrong)
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    bent = normal.copy()
    bent[:, wrong] = _units(one + high * (other - one))
    return bent


SHARE, CLEAR = 0.9, 0.01
"""Least cosine between a ray that leaves a face and the face's normal: this share of that of the
ray it comes from, or this, as in Cycles."""

HALVINGS = 12
"""By which the least turn of a normal is found: to 1/4096 of the whole."""


def _interface_code(glass, interface) -> NDArray[np.int64]:
    """Odd numbers for refraction at an interface; reflection is one more."""
    return (glass.astype(np.int64) * STAMPS + interface) * 2 + 1


def _fold(path: NDArray[np.uint64], code: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The hash of a sequence that goes on with a code (a multiplicative hash, xor-shifted)."""
    mixed = (path ^ code.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
    return mixed ^ (mixed >> np.uint64(32))


def _pixels(pixel: ArrayLike | None, total: int) -> NDArray[np.int64]:
    if pixel is None:
        return np.arange(total)
    pixels = np.asarray(pixel)
    if pixels.shape != (total,) or pixels.dtype.kind not in "iu":
        raise ValueError(f"pixel must be {total} integers, not {pixels.dtype} {pixels.shape}")
    return pixels.astype(np.int64)


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
        than `PLAIN` events, must carry more: in proportion to their events.
    most_events
        Light that would be refracted or reflected more often is lost.
    cast
        Tells how far things are that are no glass; called once a step for all rays together. A
        thing is seen where a ray meets it before the next interface. A thing that touches an
        interface (`TOUCHING`) is seen behind it, through a film of what is there.
    things : (B, 2, 3), optional
        Boxes (lower, upper corner) round all things: rays that do not come into one before their
        next interface are not cast. None: all are.
    meet
        Tells the next faces of the glasses that are meshes; called once a step for all rays that
        can meet one.
    fresnel
        False: interfaces only refract and take no light in doing so. What is totally reflected is
        followed all the same.
    pixel : (M,) int, optional
        What chooses the facets of rough glasses: the same numbers, the same facets, whatever moves.
        None: the rays' own numbers.

    Raises
    ------
    ValueError
        Where the glasses' surroundings differ, an absorption has the wrong shape, or there are
        meshes and no `meet`.
    """
    directions = np.atleast_2d(np.asarray(direction, dtype=float))
    origins = np.asarray(origin, dtype=float)
    total = len(directions)
    largest = np.abs(directions).max(axis=-1, initial=0.0)
    fit = np.isfinite(largest) & (largest > 0.0) & np.isfinite(origins).all(axis=-1)
    proper = np.flatnonzero(fit)
    unit = np.zeros_like(directions)
    unit[proper] = directions[proper] / largest[proper, None]
    unit[proper] /= np.sqrt(np.sum(unit[proper] ** 2, axis=-1, keepdims=True))
    boxes = None if things is None else np.asarray(things, dtype=float).reshape(-1, 2, 3)
    followed = _Followed(
        glasses, min_weight, most_events, cast, meet, fresnel, boxes, _pixels(pixel, total)
    )
    lost = np.where(fit, 0.0, 1.0)
    live = followed.start(origins, unit, proper)
    while len(live) and followed.steps < most_events + MOST_STRAIGHT:
        live = followed.step(live, lost)
    lost += np.bincount(live.ray, live.weight, total)
    nothing = live.take(slice(0, 0)), np.zeros(0), np.zeros(0, dtype=np.intp)
    rows = [*followed.rows, nothing]
    ends = _Live.join([row[0] for row in rows])
    distance, thing = (np.concatenate([row[k] for row in rows]) for k in (1, 2))
    order = np.argsort(ends.ray, kind="stable")
    ends = ends.take(order)
    return ExitRays(
        ray=ends.ray,
        weight=ends.weight,
        depth=np.ascontiguousarray(ends.depth.T),
        origin=np.ascontiguousarray(ends.place.T),
        direction=np.ascontiguousarray(ends.direction.T),
        distance=distance[order],
        thing=thing[order],
        events=ends.events.astype(np.intp),
        path=ends.path.view(np.int64),
        lost=lost,
        steps=followed.steps,
    )
