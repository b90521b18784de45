# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths through two glasses: what the rays that left one meet next, and where they end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ... import optics
from ..read.glasses import Glass, unbounded

_SKIN = 1e-4
"""Of its height: how far above its lower end a glass's rays are let out at the lowest."""


def other_glass(glass: Glass, path: optics.ChainedPath) -> Glass:
    """The second glass of a path."""
    return next(other for other in glass.others if other.name == path.behind)


def pair(glass: Glass, other: Glass) -> optics.Pair:
    """Two glasses without their outlines and extents: regions end where these end."""
    pose = np.eye(4)
    pose[:3, :3] = glass.to_world[:3, :3].T @ other.to_world[:3, :3]
    pose[:3, 3] = glass.to_local(other.to_world[:3, 3])
    return optics.Pair(unbounded(glass.description), unbounded(other.description), pose)


def path_stamp(glass: Glass, path) -> tuple:
    """What the images along a path depend on."""
    if isinstance(path, optics.ChainedPath):
        return (glass.stamp(), other_glass(glass, path).stamp())
    return glass.stamp()


@dataclass(frozen=True, eq=False)
class Onward:
    """Rays that left a glass and meet another one.

    Attributes
    ----------
    index : (K,) numbers of the rays. which : (K,) numbers of the glasses in ``glass.others``.
    origin, direction : (K, 3) where and how they left, in the world.
    """

    index: np.ndarray
    which: np.ndarray
    origin: np.ndarray
    direction: np.ndarray


def onward(glass: Glass, starts, rays: np.ndarray, path: optics.LightPath) -> Onward:
    """Which of the rays, in the glass's frame, meet another glass after a path of this one.

    Parameters
    ----------
    starts : (3,) or (M, 3). rays : (M, 3).
    """
    left = optics.trace(unbounded(glass.description), starts, rays, path)
    index = np.flatnonzero(left.valid)
    origin = glass.points_to_world(left.origin[index])
    direction = left.direction[index] @ glass.to_world[:3, :3].T
    found = met_next(glass, origin, direction)
    return replace(found, index=index[found.index])


def met_next(glass: Glass, origin: np.ndarray, direction: np.ndarray) -> Onward:
    """Which of the rays (M, 3), (M, 3), in the world, meet another glass, outside this one."""
    ways = np.stack(
        [
            optics.first_met(o.description, o.to_local(origin), o.direction_to_local(direction))
            for o in glass.others
        ]
    )
    which = ways.argmin(axis=0)
    way = ways.min(axis=0)
    meets = np.isfinite(way)
    for obstacle in glass.obstacles:
        some = np.flatnonzero(meets)
        meets[some] = ~obstacle.stops(origin[some], direction[some], way[some])
    return Onward(np.flatnonzero(meets), which[meets], origin[meets], direction[meets])


@dataclass(frozen=True, eq=False)
class Exits:
    """Where rays leave the last glass of a path, in the world; ``valid``: they take the path."""

    origin: np.ndarray
    direction: np.ndarray
    valid: np.ndarray


def exits(glass: Glass, starts, rays: np.ndarray, path) -> Exits:
    """The rays after a path's last event; ``starts`` and ``rays`` as for :func:`onward`.

    A ray that leaves a wall by its end is let out there: what the glass stands on stops it.
    """
    last = glass
    if isinstance(path, optics.ChainedPath):
        last = other_glass(glass, path)
        found = optics.trace_chain(pair(glass, last), starts, rays, path)
        origin = last.to_local(glass.points_to_world(found.origin))
    else:
        found = optics.trace(unbounded(glass.description), starts, rays, path)
        origin = found.origin.copy()
    extent = getattr(last.description, "extent", None)
    if extent is not None:
        skin = _SKIN * (extent[1] - extent[0])
        origin[:, 2] = np.clip(origin[:, 2], extent[0] + skin, extent[1] - skin)
    direction = found.direction @ glass.to_world[:3, :3].T
    return Exits(last.points_to_world(origin), direction, found.valid)
