"""How much light reaches the eye along each path, and which paths matter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .glasses import CylinderGlass, FlatGlass, Glass, SphereGlass
from .paths import LightPath, ParallelView, as_eye, as_path
from .solver import in_blocks
from .tracing import Bundle, advance, meet, reflectance, start

Floats = NDArray[np.float64]


def path_weights(
    glass: Glass,
    eye: ArrayLike,
    directions: ArrayLike,
    paths: Iterable[LightPath | str],
) -> tuple[Floats, Floats]:
    """What part of the light that reaches the eye comes along each path.

    Parameters
    ----------
    glass
        In whose frame everything is given, metres.
    eye : (3,), or (M, 3) for rays that start apart (an orthographic camera)
    directions : (M, 3)
        Need not be unit.
    paths
        Light paths or their events.

    Returns
    -------
    weights : (len(paths), M)
        Product of Fresnel's unpolarised transmittances and reflectances, 0 where the ray does
        not take the path. "" weighs 1 where the ray misses the glass.
    rest : (M,)
        1 − the sum of the weights of the distinct paths given.
    """
    events = [as_path(path).events for path in paths]
    directions = np.atleast_2d(np.asarray(directions, dtype=float))
    total = len(directions)
    origins = np.broadcast_to(np.asarray(eye, dtype=float), (total, 3))
    row = {name: number for number, name in enumerate(dict.fromkeys(events))}
    found = np.zeros((len(row), total))

    def work(block: slice) -> None:
        rays, proper = start(glass, origins[block], directions[block])
        index = np.flatnonzero(proper)
        for name, which, weight in _follow(glass, rays.take(index), row):
            found[row[name], block.start + index[which]] = weight

    in_blocks(work, total)
    rest = np.clip(1.0 - found.sum(axis=0), 0.0, 1.0)
    return found[[row[name] for name in events]].reshape(len(events), total), rest


def _follow(glass: Glass, rays: Bundle, wanted: Iterable[str]):
    """Complete paths among `wanted`: (events, indices of rays, weights), prefixes shared."""
    wanted = frozenset(wanted)
    prefixes = {name[:end] for name in wanted for end in range(len(name) + 1)}
    stack = [("", rays, np.arange(len(rays.length)), np.ones(len(rays.length)))]
    while stack:
        events, rays, index, weight = stack.pop()
        meeting = meet(glass, rays)
        if events in wanted:
            ends = ~meeting.met if events else ~meeting.inside
            yield events, index[ends], weight[ends]
        onward = [event for event in "TR" if events + event in prefixes]
        if not onward or not meeting.inside.any():
            continue
        on = np.flatnonzero(meeting.inside)
        rays, meeting, index, weight = rays.take(on), meeting.take(on), index[on], weight[on]
        reflected = reflectance(glass, rays, meeting)
        for event in onward:
            after, possible = advance(glass, rays, meeting, event)
            part = weight * (reflected if event == "R" else 1.0 - reflected)
            stack.append(
                (events + event, after.take(possible), index[possible], part[possible])
            )


def light_paths(
    glass: Glass, eye: ArrayLike | ParallelView, *, min_weight: float = 0.01
) -> tuple[LightPath, ...]:
    """The light paths that matter from a viewpoint.

    Parameters
    ----------
    glass
        In whose frame everything is given, metres.
    eye : (3,) or ParallelView
    min_weight : float
        A path is kept if it carries more than this part of the light for some ray.

    Returns
    -------
    tuple of LightPath
        The largest mean weight over the rays that hit the glass first; without the direct view.
        The rays are a fixed sample, dense towards grazing incidence.
    """
    if not min_weight > 0.0:
        raise ValueError(f"min_weight must be positive, not {min_weight!r}")
    origins, directions, share = _sample(glass, as_eye(eye))
    rays, _ = start(glass, origins, directions)
    hits = np.flatnonzero(meet(glass, rays).inside)
    if not len(hits):
        return ()
    share = share / share[hits].sum()
    means: dict[str, float] = {}
    peaks: dict[str, float] = {}
    stack = [("", rays.take(hits), share[hits], np.ones(len(hits)))]
    while stack:
        events, rays, part, weight = stack.pop()
        meeting = meet(glass, rays)
        ends = ~meeting.met
        if events and ends.any():
            means[events] = float(np.sum(part[ends] * weight[ends]))
            peaks[events] = float(weight[ends].max())
        on = np.flatnonzero(meeting.inside)
        rays, meeting, part, weight = rays.take(on), meeting.take(on), part[on], weight[on]
        reflected = reflectance(glass, rays, meeting)
        for event in "TR":
            carried = weight * (reflected if event == "R" else 1.0 - reflected)
            # Weights only fall along a path: what is too weak now stays so.
            strong = np.flatnonzero(carried > min_weight)
            if not len(strong):
                continue
            after, possible = advance(
                glass, rays.take(strong), meeting.take(strong), event
            )
            stack.append(
                (
                    events + event,
                    after.take(possible),
                    part[strong][possible],
                    carried[strong][possible],
                )
            )
    kept = [name for name, peak in peaks.items() if peak > min_weight]
    kept.sort(key=lambda name: (-means[name], len(name), name))
    return tuple(LightPath(name) for name in kept)
