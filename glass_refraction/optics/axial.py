# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses whose interfaces are symmetric round the z axis and end somewhere: rays through them.

The way of a ray is decided by meeting the nearest interface, whichever that is; the events alone
("TTTT") do not tell it. A path here is an ordered list of (interface, event).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .glasses import Recolour
from .laws import fresnel, proper_rays
from .paths import LightPath, ParallelView, as_path
from .profiles import Profile
from .solver import in_blocks
from .surfaces import Cylinder, Floats, Plane, Rays, Shell, Side, Viewpoint

Steps = tuple[tuple[str, str], ...]
"""Interfaces met and what happened there, in order from the eye."""


@dataclass(frozen=True)
class Interface:
    """A named piece of surface between the media in front of it and behind it.

    `opaque`: a ray that meets it takes no path.
    """

    name: str
    surface: Cylinder | Plane | Side | Shell
    front: int
    back: int
    opaque: bool = False

    def beyond(self, medium: int) -> int:
        return self.front if medium == self.back else self.back


class BoundedGlass:
    """What glasses share whose interfaces all end somewhere; lengths of these in `scale`s."""

    @property
    def scale(self) -> float:
        """The unit of length of all interfaces, metres."""
        raise NotImplementedError

    @property
    def media(self) -> tuple[float, ...]:
        """The ior of every medium; 0 are the surroundings."""
        raise NotImplementedError

    @property
    def interfaces(self) -> tuple[Interface, ...]:
        """All interfaces, in units of `scale`."""
        raise NotImplementedError

    @property
    def endless(self) -> tuple[int, ...]:
        """The media in which rays that meet nothing further have left the glass."""
        return (0,)

    @property
    def ends(self) -> tuple[int, ...]:
        """Numbers of the interfaces that a thing may touch: what it stands on."""
        return ()

    @property
    def box(self) -> Floats:
        """The lower and the upper corner (2, 3) of a box round all of it, metres."""
        raise NotImplementedError

    def medium_at(self, points: Floats) -> NDArray[np.intp]:
        """Index of the medium that holds each point (..., 3)."""
        raise NotImplementedError

    def named(self, name: str) -> Interface:
        """The interface of this name; ValueError if there is none."""
        for interface in self.interfaces:
            if interface.name == name:
                return interface
        names = ", ".join(interface.name for interface in self.interfaces)
        raise ValueError(f"interfaces must be of {names}, not {name!r}")

    def around(self, medium: int) -> tuple[tuple[int, Interface], ...]:
        """The interfaces of a medium, numbered."""
        return self._around.get(medium, ())

    @cached_property
    def _around(self) -> dict[int, tuple[tuple[int, Interface], ...]]:
        found: dict[int, list[tuple[int, Interface]]] = {}
        for number, interface in enumerate(self.interfaces):
            for medium in {interface.front, interface.back}:
                found.setdefault(medium, []).append((number, interface))
        return {medium: tuple(some) for medium, some in found.items()}

    @cached_property
    def searched(self) -> dict[int, list[tuple[int, Interface]]]:
        """`around` every medium in the order in which a ray's next interface is looked for.

        All faces of a fence are one: they are numbered one behind another, and met at once.
        """
        # Many faces and profiles last: what lies behind another interface need not be looked for
        # there.
        return {
            medium: sorted(_met_at_once(some), key=lambda part: _costs(part[1]))
            for medium, some in self._around.items()
        }

    def beyond(self, medium: int) -> NDArray[np.int8]:
        """What is beyond each interface, for one who is in a medium."""
        front, back = self._sides
        return np.where(back == medium, front, back)

    @cached_property
    def _sides(self) -> NDArray[np.int8]:
        """The media (2, N) in front of all interfaces and behind them."""
        sides = [(interface.front, interface.back) for interface in self.interfaces]
        return np.array(sides, np.int8).reshape(-1, 2).T

    @cached_property
    def steady(self) -> Floats:
        """The unit normals (N, 3) of interfaces that have the same everywhere, NaN of others."""
        found = np.full((len(self.interfaces), 3), np.nan)
        for number, interface in enumerate(self.interfaces):
            if isinstance(interface.surface, (Plane, Side)):
                found[number] = interface.surface.normal(*np.zeros(3))
        return found


class AxialGlass(BoundedGlass):
    """What glasses of revolution share: dataclasses with an `ior` and a `liquid_ior`."""

    names_interfaces: ClassVar[bool] = True
    has_contents: ClassVar[bool] = True

    def recoloured(self, glass: Recolour, contents: Recolour) -> AxialGlass:
        """The same glass as light of another colour finds it."""
        return replace(self, ior=glass(self.ior), liquid_ior=contents(self.liquid_ior))

    @property
    def unbounded(self) -> AxialGlass:
        """The glass itself: nothing of it goes on without end."""
        return self

    def encloses(self, points: Floats, margin: float) -> NDArray[np.bool_]:
        """Which points (N, 3) lie in its hull; ``margin`` as of `FlatGlass.encloses`."""
        radius, low, high = (part * self.scale for part in self.hull)
        skin = margin * (high - low)
        inside = np.hypot(points[:, 0], points[:, 1]) < radius * (1 - margin)
        return inside & (points[:, 2] > low + skin) & (points[:, 2] < high - skin)

    @property
    def hull(self) -> tuple[float, float, float]:
        """Radius, lower and upper end of a cylinder round all of it, in units of `scale`."""
        raise NotImplementedError

    @property
    def box(self) -> Floats:
        radius, low, high = (part * self.scale for part in self.hull)
        return np.array([(-radius, -radius, low), (radius, radius, high)])

    def sure(self, medium: int, left: str | None, met: str | None) -> bool:
        """Whether a stretch between two interfaces can meet no other one before.

        `left`, `met`: names, None at the eye or after the last event.
        """
        return False

    def holds(self, medium: int, points: Floats) -> NDArray[np.bool_]:
        """Which points (N, 3) lie in a medium, its interfaces included."""
        raise NotImplementedError

    def outlines(self, longest: float) -> dict[str, tuple[Floats, Floats]]:
        """Sections of all interfaces: points (K, 2) of radius and height, metres, and normals.

        The front is on the right of the way along the points. Interfaces that meet share their
        ends bit by bit. `longest`: between two points, metres; a straight section across the axis
        has two.
        """
        found = {}
        ends: list[Floats] = []
        for interface in self.interfaces:
            points, normals = interface.surface.outline(longest / self.scale)
            if len(points) < 2:
                continue
            for end in (0, -1):
                known = next((e for e in ends if np.abs(e - points[end]).max() < MEETING), None)
                if known is None:
                    ends.append(points[end].copy())
                else:
                    points[end] = known
            found[interface.name] = (points * self.scale, normals)
        return found


SOLID = 1
"""The medium that the glass itself is: nothing stands in it."""

MEETING = 1e-7
"""Distance, in units of `scale`, within which the ends of two interfaces are one."""


def steps_of(path: LightPath) -> Steps:
    """(interface, event) of a path that names its interfaces."""
    return tuple(zip(path.interfaces, path.events, strict=True))


def path_of(steps: Steps) -> LightPath:
    return LightPath("".join(step[1] for step in steps), tuple(step[0] for step in steps))


def _events(steps: Steps) -> str:
    return "".join(event for _, event in steps)


class Wanted:
    """Which of some paths a list of steps begins or is; paths without interfaces match any."""

    def __init__(self, glass: AxialGlass, paths: Iterable[LightPath]) -> None:
        self.paths = tuple(paths)
        for path in self.paths:
            for name in path.interfaces or ():
                glass.named(name)
        self._begun: dict[Steps, bool] = {}
        for path in self.paths:
            for count in range(len(path) + 1) if path.interfaces is not None else ():
                self._begun[steps_of(path)[:count]] = True
        self._unnamed = tuple(path for path in self.paths if path.interfaces is None)
        self._by_steps: dict[tuple[Steps, bool], tuple[int, ...]] = {}
        for number, path in enumerate(self.paths):
            if path.interfaces is not None:
                key = steps_of(path), path.open
                self._by_steps[key] = (*self._by_steps.get(key, ()), number)

    def begun(self, steps: Steps) -> bool:
        """Whether any of the paths begins with these steps."""
        if steps not in self._begun:
            events = _events(steps)
            self._begun[steps] = any(path.events.startswith(events) for path in self._unnamed)
        return self._begun[steps]

    def complete(self, steps: Steps, is_open: bool = False) -> tuple[int, ...]:
        """Numbers of the paths that are these steps, and are open or are not."""
        named = self._by_steps.get((steps, is_open), ())
        if is_open or not self._unnamed:
            return named
        return named + tuple(
            number
            for number, path in enumerate(self.paths)
            if path.interfaces is None and path.events == _events(steps)
        )


@dataclass
class Group:
    """Rays that met the same interfaces so far.

    `medium` they are in, `index`: their numbers, `weight`: part of the light, `trail`: medium and
    geometric lengths of every stretch so far, in units of `scale`. `open`: they go on.
    """

    steps: Steps
    medium: int
    rays: Rays
    index: NDArray[np.intp]
    weight: Floats
    trail: tuple[tuple[int, Floats], ...] = ()
    open: bool = False

    def take(self, which) -> Group:
        return Group(
            self.steps,
            self.medium,
            self.rays.take(which),
            self.index[which],
            self.weight[which],
            tuple((medium, way[which]) for medium, way in self.trail),
        )

    @property
    def length(self) -> Floats:
        """Geometric length of all stretches."""
        return sum((way for _, way in self.trail), np.zeros(len(self.index)))


def start(glass: BoundedGlass, origin: ArrayLike, direction: ArrayLike) -> list[Group]:
    """Groups of the proper rays (finite, with a direction), one a medium."""
    origin, direction, proper = proper_rays(origin, direction)
    index = np.flatnonzero(proper)
    origin, direction = origin[index], direction[index]
    medium = glass.medium_at(origin)
    groups = []
    for number in np.unique(medium):
        some = np.flatnonzero(medium == number)
        momentum = direction[some] * glass.media[number]
        rays = Rays(tuple(origin[some].T / glass.scale), tuple(momentum.T))
        count = len(some)
        groups.append(Group((), int(number), rays, index[some], np.ones(count)))
    return groups


def nearest(
    glass: BoundedGlass, medium: int, rays: Rays
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Number of the interface that each ray meets next, −1 for none, and the way to it.

    Third, where on a `Profile` the meeting is, which is costly to find again.
    """
    met = np.full(len(rays.place[0]), -1, dtype=np.intp)
    least = np.full(len(met), np.inf)
    marks = np.zeros(len(met))
    for number, interface in glass.searched.get(medium, ()):
        surface, back, spot = interface.surface, interface.back == medium, None
        if isinstance(surface, Side):
            at, face, way = surface.fence.meet(rays, back, least)
            met[at], least[at] = number + face, way
            continue
        if isinstance(surface, Profile):
            way, ahead, (_, spot) = surface.meet_at(rays, back, limit=least)
        else:
            way, ahead = surface.meet(rays, back)
        closer = np.flatnonzero(ahead & (way < least))
        if not len(closer):
            continue
        some = rays.take(closer)
        inside = interface.surface.within(*some.at(way[closer]))
        closer = closer[inside]
        met[closer], least[closer] = number, way[closer]
        if spot is not None:
            marks[closer] = spot[closer]
    return met, np.where(met >= 0, np.maximum(least, 0.0), 0.0), marks


def _met_at_once(
    interfaces: Iterable[tuple[int, Interface]],
) -> Iterator[tuple[int, Interface]]:
    """Numbered interfaces, of the faces of each fence the first alone."""
    fence = None
    for number, interface in interfaces:
        if not isinstance(interface.surface, Side):
            yield number, interface
        elif interface.surface.fence is not fence:
            fence = interface.surface.fence
            yield number, interface


def _costs(interface: Interface) -> int:
    """How much there is to look through for a meeting."""
    surface = interface.surface
    if isinstance(surface, Profile):
        return surface.chords.shape[1]
    return int(isinstance(surface, Side))


def follow(
    glass: BoundedGlass,
    groups: list[Group],
    onward: Callable[[Steps, Floats], NDArray[np.bool_] | None],
    watch: Callable[[Steps], bool] = lambda steps: False,
) -> Iterator[Group]:
    """Every way of the rays through the glass, as groups of rays that meet nothing further.

    `onward` tells, of the light that arrives after some steps, which rays to follow on (None: no);
    `watch`, after which steps to tell of rays that go on: as open groups.
    """
    stack = list(groups)
    while stack:
        group = stack.pop()
        if watch(group.steps):
            yield replace(group, open=True)
        met, way, marks = nearest(glass, group.medium, group.rays)
        ior = glass.media[group.medium]
        if group.medium in glass.endless:
            ends = np.flatnonzero(met < 0)
            if len(ends):
                yield group.take(ends)
        for number, interface in glass.around(group.medium):
            here = np.flatnonzero(met == number)
            if interface.opaque or not len(here):
                continue
            beyond = interface.beyond(group.medium)
            part, ways = group.take(here), way[here]
            rays = part.rays
            trail = (*part.trail, (group.medium, ways * ior))
            spot = marks[here] if isinstance(interface.surface, Profile) else None
            reflected = _reflectance(interface.surface, rays, ways, ior, glass.media[beyond], spot)
            for event in "TR":
                steps = (*group.steps, (interface.name, event))
                weight = part.weight * (reflected if event == "R" else 1.0 - reflected)
                keep = onward(steps, weight)
                if keep is None:
                    continue
                gain = None if event == "R" else glass.media[beyond] ** 2 - ior**2
                after, possible = interface.surface.pass_by(rays, ways, gain, spot)
                keep = np.flatnonzero(keep & possible)
                if len(keep):
                    medium = group.medium if event == "R" else beyond
                    behind = Group(steps, medium, after, part.index, weight, trail)
                    stack.append(behind.take(keep))


def _reflectance(surface, rays: Rays, way, ior: float, beyond: float, spot) -> Floats:
    place = rays.at(way)
    normal = surface.normal(*place) if spot is None else surface.normal(*place, spot)
    towards = sum(p * n for p, n in zip(rays.momentum, normal, strict=True))
    return fresnel(towards / ior, ior / beyond)


def follow_paths(glass: AxialGlass, groups: list[Group], paths: Iterable[LightPath]):
    """The complete ways that are among some paths: (numbers of the paths, group)."""
    wanted = Wanted(glass, paths)

    def onward(steps, weight):
        return np.ones(len(weight), dtype=bool) if wanted.begun(steps) else None

    def watch(steps):
        return bool(wanted.complete(steps, True))

    for group in follow(glass, groups, onward, watch):
        numbers = wanted.complete(group.steps, group.open)
        if numbers:
            yield numbers, group


def trace_axial(glass: AxialGlass, origin: ArrayLike, direction: ArrayLike, path) -> tuple:
    """`origin`, `direction`, `length` and `valid` of `TracedRays`."""
    origins, directions, _ = proper_rays(origin, direction)
    lengths, valid = np.zeros(len(directions)), np.zeros(len(directions), dtype=bool)
    path = as_path(path)
    for _, group in follow_paths(glass, start(glass, origin, direction), (path,)):
        if path.events:
            origins[group.index] = np.stack(group.rays.place, axis=-1) * glass.scale
            momentum = np.stack(group.rays.momentum, axis=-1)
            size = np.sqrt(np.sum(momentum * momentum, axis=-1, keepdims=True))
            directions[group.index] = momentum / size
            lengths[group.index] = group.length * glass.scale
        valid[group.index] = True
    return origins, directions, lengths, valid


def weights_axial(glass: AxialGlass, eye: Floats, directions: Floats, paths) -> tuple:
    """Weights (len(paths), M) of paths, and the part of the light (M,) that takes none."""
    paths, total = tuple(paths), len(directions)
    origins = np.broadcast_to(eye, (total, 3))
    found, rest = np.zeros((len(paths), total)), np.ones(total)

    def work(block: slice) -> None:
        groups = start(glass, origins[block], directions[block])
        for numbers, group in follow_paths(glass, groups, paths):
            index = group.index + block.start
            if not group.open:
                rest[index] -= group.weight
            for number in numbers:
                found[number, index] += group.weight

    in_blocks(work, total)
    return found, np.clip(rest, 0.0, 1.0)


def lengths_axial(glass: AxialGlass, origins: Floats, directions: Floats, path: LightPath):
    """Indices of rays that take a path, and lengths and media of their stretches, part by part."""
    for _, group in follow_paths(glass, start(glass, origins, directions), (path,)):
        media, ways = zip(*group.trail[1:], strict=True)
        yield group.index, np.stack(ways) * glass.scale, np.array(media)[:, None]


LONGEST = 16
"""Events of the longest path looked at."""


def viewpoint(glass: AxialGlass, eye: Floats | ParallelView) -> Viewpoint:
    """An eye in units of `scale`."""
    if isinstance(eye, ParallelView):
        return Viewpoint(None, eye.direction, 0)
    return Viewpoint(
        tuple(float(part) for part in eye / glass.scale), None, int(glass.medium_at(eye))
    )


def first_rays(glass: AxialGlass, view: Viewpoint, places: tuple) -> tuple[Rays, Floats]:
    """Rays from a viewpoint to places, (M,) each, and the ways to these."""
    ior = glass.media[view.medium]
    if view.parallel:
        # They start on a plane in front of everything.
        dx, dy, dz = view.direction
        radius, low, high = glass.hull
        ahead = places[0] * dx + places[1] * dy + places[2] * dz
        away = ahead + radius + abs(low) + abs(high) + 1.0
        begin = tuple(q - away * d for q, d in zip(places, view.direction, strict=True))
        same = np.ones_like(ahead)
        return Rays(begin, (ior * dx * same, ior * dy * same, ior * dz * same)), away / ior
    towards = tuple(q - e for q, e in zip(places, view.eye, strict=True))
    distance = np.sqrt(sum(part * part for part in towards))
    safe = np.where(distance > 0.0, distance, 1.0)
    same = np.ones_like(distance)
    momentum = tuple(np.where(distance > 0.0, part / safe, 0.6) * ior for part in towards)
    return Rays(tuple(e * same for e in view.eye), momentum), distance / ior


def sample_rays(glass: AxialGlass, view: Viewpoint, rows: int, columns: int) -> tuple[Rays, Floats]:
    """Rays that cover all that a viewpoint sees of the glass, and their shares of the picture."""
    parts, shares = [], []
    for number, interface in glass.around(view.medium):
        patch = interface.surface.sample(view, interface.back == view.medium)
        if patch is None or interface.opaque:
            continue
        grid = np.stack(
            np.meshgrid(
                *((np.arange(count) + 0.5) / count for count in (rows, columns)), indexing="ij"
            ),
            axis=-1,
        ).reshape(-1, 2)
        places = patch.places(grid)[:3]
        rays, way = first_rays(glass, view, places)
        met, *_ = nearest(glass, view.medium, rays)
        seen = np.flatnonzero(met == number)
        # The patch's own area, as the parallelogram of small steps.
        small = 1e-3
        one, other = (
            [(a - b) / small for a, b in zip(patch.places(grid + step)[:3], places, strict=True)]
            for step in ((small, 0.0), (0.0, small))
        )
        across = np.cross(np.stack(one, axis=-1), np.stack(other, axis=-1))
        facing = np.abs(np.sum(across * np.stack(rays.momentum, axis=-1), axis=-1))
        share = facing if view.parallel else facing / np.maximum(way, LEAST_WAY) ** 2
        parts.append(rays.take(seen))
        shares.append(share[seen] / (rows * columns))
    if not parts:
        return Rays(*((np.zeros(0),) * 3 for _ in range(2))), np.zeros(0)
    joined = (
        tuple(np.concatenate([getattr(part, name)[axis] for part in parts]) for axis in range(3))
        for name in ("place", "momentum")
    )
    return Rays(*joined), np.concatenate(shares)


LEAST_WAY = 1e-6
"""Distance, in units of `scale`, below which an eye on the glass counts as this far from it."""


def _sample_group(glass: AxialGlass, view: Viewpoint, size: int) -> tuple[Group, Floats]:
    rays, share = sample_rays(glass, view, size, size)
    count = len(share)
    group = Group((), view.medium, rays, np.arange(count), np.ones(count))
    return group, share


def light_paths_axial(glass: AxialGlass, eye, min_weight: float) -> tuple[LightPath, ...]:
    """The paths that carry more than `min_weight`, the largest mean weight first."""
    view = viewpoint(glass, eye)
    group, share = _sample_group(glass, view, SAMPLES)

    def onward(steps, weight):
        return None if len(steps) > LONGEST else strong(weight, min_weight)

    ends = follow(glass, [group], onward)
    ends = ((end.steps, end.weight, share[end.index]) for end in ends)
    return tuple(path_of(steps) for steps in strongest(ends, min_weight))


def strong(weight: Floats, least: float) -> NDArray[np.bool_] | None:
    """Which rays to follow on where paths count that carry more than `least`; None: no.

    Weights only fall along a path: what is too weak everywhere now stays so. Rays far below the
    bound no longer count for the mean.
    """
    return weight > 0.1 * least if (weight > least).any() else None


def strongest(ends: Iterable[tuple], least: float) -> list:
    """The paths that carry more than `least` for some ray, the largest mean weight first.

    `ends`: (steps, weights of the rays that take them and no more, their shares of the picture).
    """
    means, peaks = {}, {}
    for steps, weight, share in ends:
        if steps and len(weight):
            means[steps] = float(np.sum(share * weight))
            peaks[steps] = float(weight.max())
    kept = [steps for steps, peak in peaks.items() if peak > least]
    return sorted(kept, key=lambda steps: (-means[steps], len(steps), steps))


SAMPLES = 80
"""Rows and columns of rays on every interface that the eye sees."""


@lru_cache(maxsize=64)
def realisations(glass: AxialGlass, eye: tuple | ParallelView, events: str) -> tuple[Steps, ...]:
    """The lists of interfaces that rays from an eye meet with these events."""
    view = viewpoint(glass, eye if isinstance(eye, ParallelView) else np.array(eye))
    group, _ = _sample_group(glass, view, SAMPLES)
    found = {end.steps for _, end in follow_paths(glass, [group], (LightPath(events),))}
    return tuple(sorted(found))
