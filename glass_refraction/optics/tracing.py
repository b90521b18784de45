# SPDX-License-Identifier: GPL-3.0-or-later
"""Forward tracing with plain vector refraction, one interface after the other.

This is the slow, obvious way: it knows nothing of ray invariants, so it decides every case the
solver returns. The weights are folded over the same walk.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import AxialGlass, trace_axial
from .glasses import CylinderGlass, FlatGlass, Glass
from .laws import fresnel, proper_rays, reflect, refract
from .outlines import in_polygon
from .paths import LightPath, as_path

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class TracedRays:
    """Rays after the last event of a path.

    Attributes
    ----------
    origin : (M, 3)
        The last point met, metres (the given origin for the path "").
    direction : (M, 3)
        Unit.
    length : (M,)
        Geometric length from the given origin to `origin`, metres.
    valid : (M,) bool
        The ray takes the whole path. Elsewhere the numbers are finite and mean nothing.
    """

    origin: Floats
    direction: Floats
    length: Floats
    valid: Flags


@dataclass(frozen=True)
class Bundle:
    """Rays on their way: `medium` they are in, `heading` deeper (+1) or back out (−1)."""

    origin: Floats
    direction: Floats
    length: Floats
    medium: NDArray[np.intp]
    heading: NDArray[np.intp]

    def take(self, which: NDArray) -> Bundle:
        return Bundle(*(part[which] for part in vars(self).values()))


@dataclass(frozen=True)
class Meeting:
    """Where the rays of a bundle meet their next interface.

    `interface`: its index, −1 where the ray meets none. `inside`: the place lies within the
    glass's outline or extent. `normal`: unit, on the side the ray comes from.
    """

    interface: NDArray[np.intp]
    point: Floats
    normal: Floats
    inside: Flags
    distance: Floats

    @property
    def met(self) -> Flags:
        return self.interface >= 0

    def take(self, which: NDArray) -> Meeting:
        return Meeting(*(part[which] for part in vars(self).values()))


def start(glass: Glass, origin: ArrayLike, direction: ArrayLike) -> tuple[Bundle, Flags]:
    """A bundle of rays, and which of them are proper (finite, with a direction)."""
    origin, direction, proper = proper_rays(origin, direction)
    medium = glass.medium_at(origin)
    if isinstance(glass, FlatGlass):
        deeper = direction[:, 2] < 0.0
        # A ray that starts on an interface and runs up starts above it, down: below it counts
        # as starting above and meeting it at once.
    else:
        axes = _transverse_axes(glass)
        deeper = np.sum(origin[:, :axes] * direction[:, :axes], axis=-1) < 0.0
    heading = np.where(deeper, 1, -1)
    return Bundle(origin, direction, np.zeros(len(direction)), medium, heading), proper


def _transverse_axes(glass: Glass) -> int:
    return 2 if isinstance(glass, CylinderGlass) else 3


def meet(glass: Glass, rays: Bundle) -> Meeting:
    """The next interface of every ray."""
    if isinstance(glass, FlatGlass):
        return _meet_flat(glass, rays)
    return _meet_coaxial(glass, rays)


def _meet_flat(glass: FlatGlass, rays: Bundle) -> Meeting:
    heights = glass.heights
    down = rays.direction[:, 2]
    interface = np.where(rays.heading > 0, rays.medium, rays.medium - 1)
    met = (interface >= 0) & (interface < len(heights)) & (down != 0.0)
    interface = np.where(met, interface, -1)
    height = heights[interface]
    distance = np.zeros(len(down))
    np.divide(height - rays.origin[:, 2], down, out=distance, where=met)
    # Almost horizontal rays overflow; they meet the plane nowhere that matters.
    met &= np.isfinite(distance) & (distance < 1e150)
    interface = np.where(met, interface, -1)
    distance = np.where(met, np.maximum(distance, 0.0), 0.0)
    point = rays.origin + distance[:, None] * rays.direction
    point[:, 2] = np.where(met, height, point[:, 2])
    normal = np.zeros_like(point)
    normal[:, 2] = rays.heading
    inside = met
    if glass.outline is not None:
        inside = met & in_polygon(glass.outline, point[:, 0], point[:, 1])
    return Meeting(interface, point, normal, inside, distance)


def _meet_coaxial(glass: Glass, rays: Bundle) -> Meeting:
    axes = _transverse_axes(glass)
    origin, direction = rays.origin[:, :axes], rays.direction[:, :axes]
    speed = np.sqrt(np.sum(direction * direction, axis=-1))
    moving = speed > 1e-150
    unit = direction / np.where(moving, speed, 1.0)[:, None]
    foot = -np.sum(origin * unit, axis=-1)  # transverse way to the point nearest the axis
    if axes == 2:
        nearest = np.abs(origin[:, 0] * unit[:, 1] - origin[:, 1] * unit[:, 0])
    else:
        nearest = np.sqrt(np.sum(np.cross(origin, unit) ** 2, axis=-1))
    distance_from_axis = np.sqrt(np.sum(origin * origin, axis=-1))

    radii = np.array((*glass.radius, 0.0))
    inner = radii[rays.medium]  # 0 in the core: nothing to meet
    hits_inner = (rays.heading > 0) & (nearest < inner) & moving
    outer = np.array((np.inf, *glass.radius))[rays.medium]
    hits_outer = ~hits_inner & (rays.medium > 0) & moving
    radius = np.where(hits_inner, inner, np.where(hits_outer, outer, 1.0))
    half = np.sqrt(np.maximum((radius - nearest) * (radius + nearest), 0.0))
    # Near root without cancellation: product of the two roots over the far one.
    product = (distance_from_axis - radius) * (distance_from_axis + radius)
    far = foot + half
    near = product / np.where(hits_inner & (far > 0.0), far, 1.0)
    way = np.where(hits_inner, near, np.where(foot >= 0.0, far, 0.0))
    outward = half - foot
    way = np.where(hits_outer & (foot < 0.0), -product / np.where(outward > 0.0, outward, 1.0), way)
    way = np.maximum(way, 0.0)
    met = hits_inner | hits_outer
    interface = np.where(hits_inner, rays.medium, np.where(hits_outer, rays.medium - 1, -1))
    distance = np.where(met, way / np.where(moving, speed, 1.0), 0.0)
    point = rays.origin + distance[:, None] * rays.direction
    across = point[:, :axes]
    reached = np.sqrt(np.sum(across * across, axis=-1))
    # Back onto the surface: rounding must not grow from interface to interface.
    across *= np.where(met, radius / np.where(reached > 0.0, reached, 1.0), 1.0)[:, None]
    normal = np.zeros_like(point)
    side = np.where(hits_inner, 1.0, -1.0) / radius
    normal[:, :axes] = across * np.where(met, side, 0.0)[:, None]
    inside = met
    if isinstance(glass, CylinderGlass) and glass.extent is not None:
        low, high = glass.extent
        inside = met & (point[:, 2] >= low) & (point[:, 2] <= high)
    return Meeting(interface, point, normal, inside, distance)


def advance(glass: Glass, rays: Bundle, meeting: Meeting, event: str) -> tuple[Bundle, Flags]:
    """Rays after `event` at their meeting, and which of them can take it.

    Every ray must have met an interface.
    """
    length = rays.length + meeting.distance
    inward = meeting.interface == rays.medium
    if event == "R":
        direction = reflect(rays.direction, meeting.normal)
        after = Bundle(meeting.point, direction, length, rays.medium, np.where(inward, -1, 1))
        return after, np.ones(len(length), dtype=bool)
    behind = np.where(inward, rays.medium + 1, rays.medium - 1)
    media = np.asarray(glass.media)
    direction, total = refract(rays.direction, meeting.normal, media[rays.medium] / media[behind])
    after = Bundle(meeting.point, direction, length, behind, np.where(inward, 1, -1))
    return after, ~total


def reflectance(glass: Glass, rays: Bundle, meeting: Meeting) -> Floats:
    """Fresnel's reflectance of every ray at its meeting."""
    media = np.asarray(glass.media)
    behind = np.where(meeting.interface == rays.medium, rays.medium + 1, rays.medium - 1)
    cos_incident = -np.sum(rays.direction * meeting.normal, axis=-1)
    return fresnel(cos_incident, media[rays.medium] / media[behind])


def trace(
    glass: Glass, origin: ArrayLike, direction: ArrayLike, path: LightPath | str
) -> TracedRays:
    """Follow rays through all events of a path.

    Parameters
    ----------
    glass
        In whose frame everything is given.
    origin : (3,) or (M, 3)
        Where the rays start, metres.
    direction : (M, 3)
        Need not be unit.
    path
        A `LightPath` or its events.

    Returns
    -------
    TracedRays
        `valid` where the ray takes the whole path and meets no further interface. A ray that
        would meet a face outside its outline or extent does not take the path; one whose first
        meeting is outside misses the glass, which is the path "".
    """
    if isinstance(glass, AxialGlass):
        return TracedRays(*trace_axial(glass, origin, direction, path))
    events = as_path(path).events
    rays, proper = start(glass, origin, direction)
    origins, directions, lengths = (
        rays.origin.copy(),
        rays.direction.copy(),
        rays.length.copy(),
    )
    valid = np.zeros(len(proper), dtype=bool)
    *_, (index, last) = along(glass, rays.take(np.flatnonzero(proper)), events)
    index = np.flatnonzero(proper)[index]
    meeting = meet(glass, last)
    ends = ~meeting.met if events else ~meeting.inside
    index, last = index[ends], last.take(ends)
    origins[index], directions[index], lengths[index] = last.origin, last.direction, last.length
    valid[index] = True
    return TracedRays(origins, directions, lengths, valid)


def along(glass: Glass, rays: Bundle, events: str) -> Iterator[tuple[NDArray, Bundle]]:
    """Rays before and after each event: numbers of those that take all so far, and these."""
    index = np.arange(len(rays.medium))
    yield index, rays
    for event in events:
        meeting = meet(glass, rays)
        on = np.flatnonzero(meeting.inside)
        rays, possible = advance(glass, rays.take(on), meeting.take(on), event)
        index, rays = index[on][possible], rays.take(possible)
        yield index, rays


def stretches(
    glass: Glass, origin: ArrayLike, direction: ArrayLike, path: LightPath
) -> tuple[Floats, Floats, Floats]:
    """Where a path's rays run behind the first surface that they meet.

    Parameters as in :func:`trace`.

    Returns
    -------
    origin, direction : (K, 3)
        Beginnings and unit directions of the stretches of rays that take the whole path: number 1
        of each ray, then number 2 of each, and so on. Of a glass whose interfaces have names that
        the path leaves out, the last ones only.
    length : (K,)
        Of each stretch, metres; infinite behind the last event.
    """
    whole = trace(glass, origin, direction, path)
    takes = np.flatnonzero(whole.valid)
    origins = np.broadcast_to(np.asarray(origin, dtype=float), whole.origin.shape)[takes]
    directions = np.atleast_2d(np.asarray(direction, dtype=float))[takes]
    found = []
    if isinstance(glass, AxialGlass):
        named = path.interfaces is not None and not path.open
        for count in range(1, len(path.events)) if named else ():
            part = LightPath(path.events[:count], path.interfaces[:count], open=True)
            traced = trace(glass, origins, directions, part)
            found.append((traced.origin, traced.direction))
    elif path.events:
        _, *on_the_way, _ = along(glass, start(glass, origins, directions)[0], path.events)
        found += [(rays.origin, rays.direction) for _, rays in on_the_way]
    found.append((whole.origin[takes], whole.direction[takes]))
    places = [place for place, _ in found]
    lengths = [np.linalg.norm(b - a, axis=1) for a, b in pairwise(places)]
    lengths.append(np.full(len(takes), np.inf))
    return np.concatenate(places), np.concatenate([d for _, d in found]), np.concatenate(lengths)
