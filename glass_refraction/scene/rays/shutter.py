# SPDX-License-Identifier: GPL-3.0-or-later
"""Where all stands while the shutter is open: what motion blurs in the glass.

A render goes through some moments round the frame's own, with everything evaluated. Between these
all moves as engines take it to: along straight lines, and turned evenly.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..read.arrays import unit
from ..read.glasses import Glass
from ..read.viewpoint import Viewpoint
from .hits import Ways
from .things import Met, Things

SMALLEST_TURN = 1e-12
"""Sine of an angle that is none."""


@dataclass(frozen=True, eq=False)
class Moment:
    """Where all stands at a time.

    Attributes
    ----------
    time : frames. view : the camera. glasses, things : as `stage.FrameInput` has them.
    """

    time: float
    view: Viewpoint
    glasses: tuple[Glass, ...]
    things: Things


@dataclass(frozen=True, eq=False)
class Shutter:
    """How long it is open, and what is known of that time.

    Attributes
    ----------
    opens, closes : frames.
    moments : one at least, in the order of time. own : the frame's, one of these.
    """

    opens: float
    closes: float
    own: Moment
    moments: tuple[Moment, ...]

    def with_moments(self, found: Iterable[Moment]) -> Shutter:
        """The same with more moments. Of things and glasses that came, went or are other meshes
        then, the frame's own stay."""
        moments = [self.own, *(_alike(moment, self.own) for moment in found)]
        return replace(self, moments=tuple(sorted(moments, key=lambda moment: moment.time)))

    @property
    def moves_camera_alone(self) -> bool:
        """Whether glasses and things stand still."""
        return all(
            moment.things.same(self.own.things)
            and [g.stamp() for g in moment.glasses] == [g.stamp() for g in self.own.glasses]
            for moment in self.moments
        )

    @property
    def is_still(self) -> bool:
        """Whether nothing moves at all."""
        stands = (moment.view.stamp() == self.own.view.stamp() for moment in self.moments)
        return self.moves_camera_alone and all(stands)

    def at(self, part: float) -> Moment:
        """Where all stands when a part of the time that the shutter is open has gone by."""
        time = self.opens + part * (self.closes - self.opens)
        times = [moment.time for moment in self.moments]
        after = int(np.searchsorted(times, time))
        if after in (0, len(times)):
            return self.moments[min(after, len(times) - 1)]
        first, second = self.moments[after - 1 : after + 1]
        return _between(first, second, (time - first.time) / (second.time - first.time), time)


def _alike(moment: Moment, own: Moment) -> Moment:
    """A moment with the same glasses and the same triangles as the frame's own."""
    glasses, things = moment.glasses, moment.things
    same = [(g.name, _size(g)) for g in glasses] == [(g.name, _size(g)) for g in own.glasses]
    if not (
        np.array_equal(things.triangles, own.things.triangles)
        and np.array_equal(things.surface, own.things.surface)
    ):
        things = own.things
    # What it looks like is the frame's.
    things = replace(own.things, points=things.points)
    return replace(moment, glasses=glasses if same else own.glasses, things=things)


def _size(glass: Glass) -> tuple:
    """Equal for glasses between which one may be put."""
    return type(glass.description), len(glass.description.points) if glass.is_mesh else 0


def _between(first: Moment, second: Moment, part: float, time: float) -> Moment:
    """Where all stands between two moments."""
    a, b = first.view, second.view
    rotation = _turned(a.to_camera[:3, :3], b.to_camera[:3, :3], part)
    eye = _mixed(a.eye, b.eye, part)
    to_camera = np.eye(4)
    to_camera[:3, :3], to_camera[:3, 3] = rotation, -rotation @ eye
    view = replace(
        a, eye=eye, to_camera=to_camera, projection=_mixed(a.projection, b.projection, part)
    )
    glasses = tuple(
        _between_glasses(one, other, part)
        for one, other in zip(first.glasses, second.glasses, strict=True)
    )
    points = _mixed(first.things.points, second.things.points, part)
    return Moment(time, view, glasses, replace(first.things, points=points))


def _between_glasses(first: Glass, second: Glass, part: float) -> Glass:
    a, b = first.description, second.description
    if first.is_mesh:
        normals = _mixed_normals(a.normals, b.normals, part)
        bumps = a.within is not None and b.within is not None
        within = _mixed_normals(a.within, b.within, part) if bumps else None
        points = _mixed(a.points, b.points, part)
        mesh = replace(a, points=points, normals=normals, within=within)
        return replace(first, description=mesh)
    pose = _mixed(first.to_world, second.to_world, part)
    pose[:3, :3] = _turned(first.to_world[:3, :3], second.to_world[:3, :3], part)
    return replace(first, to_world=pose)


def _mixed_normals(first: np.ndarray, second: np.ndarray, part: float) -> np.ndarray:
    return unit(_mixed(first, second, part))


def _mixed(first: np.ndarray, second: np.ndarray, part: float) -> np.ndarray:
    return first + part * (second - first)


def _turned(first: np.ndarray, second: np.ndarray, part: float) -> np.ndarray:
    """The rotation (3, 3) between two, turned about one axis (Rodrigues)."""
    turn = second @ first.T
    axis = 0.5 * (turn - turn.T)
    sine = np.sqrt(0.5 * np.sum(axis**2))
    if sine < SMALLEST_TURN:
        return first.copy()
    angle = part * np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0))
    axis /= sine
    return (np.eye(3) + np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis) @ first


def spots(ways: Ways, then: Things, now: Things) -> np.ndarray:
    """(K, 3) where the spots of triangles are ``now`` that ways, none to the sky, meet ``then``."""
    met = Met(ways.triangle, ways.distance, ways.origin, ways.direction)
    corners = now.points[now.triangles[ways.triangle]]
    return np.einsum("nk,nkd->nd", then.shares(met), corners)


def put_back(ways: Ways, then: Things, now: Things) -> Ways:
    """Ways to what they met ``then``, put where the same spots of the same triangles are ``now``.

    Radiance views show what stands where it does in the frame.
    """
    if then.same(now):
        return ways
    some = np.flatnonzero(~ways.is_sky)
    met = ways.take(some)
    origin = ways.origin.copy()
    origin[some] = spots(met, then, now) - met.distance[:, None] * met.direction
    return replace(ways, origin=origin)
