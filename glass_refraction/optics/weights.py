# SPDX-License-Identifier: GPL-3.0-or-later
"""How much light reaches the eye along each path, and which paths matter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import AxialGlass, light_paths_axial, strong, strongest, weights_axial
from .glasses import CylinderGlass, FlatGlass, Glass
from .paths import LightPath, ParallelView, as_eye, as_path
from .radial import RadialWeights
from .solver import in_blocks
from .tracing import Bundle, advance, meet, reflectance, start
from .vectors import perpendiculars

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

Onward = Callable[[str, Floats], Flags | None]
"""Tells, of the light that arrives after some events, which rays to follow on (None: no)."""


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

    Raises
    ------
    ValueError
        For directions that are not (M, 3), an eye that is neither (3,) nor (M, 3), and events that
        are not in a list.
    """
    if isinstance(paths, str):
        raise ValueError(f"paths must be several, such as [{paths!r}], not {paths!r}")
    paths = [as_path(path) for path in paths]
    events = [path.events for path in paths]
    directions = np.atleast_2d(np.asarray(directions, dtype=float))
    if directions.ndim != 2 or directions.shape[1] != 3:
        raise ValueError(f"directions must be (M, 3), not {directions.shape}")
    if np.shape(eye) not in {(3,), directions.shape}:
        raise ValueError(f"eye must be (3,) or {directions.shape}, not {np.shape(eye)}")
    if isinstance(glass, AxialGlass):
        return weights_axial(glass, np.asarray(eye, dtype=float), directions, paths)
    total = len(directions)
    origins = np.broadcast_to(np.asarray(eye, dtype=float), (total, 3))
    row = {name: number for number, name in enumerate(dict.fromkeys(events))}
    found = np.zeros((len(row), total))
    radial = radial_weights(glass, np.asarray(eye, dtype=float), row)
    onward = _towards(row)

    def work(block: slice) -> None:
        if radial is not None:
            here = origins[0] if np.ndim(eye) == 1 else origins[block]
            parts = radial.weights(here, directions[block])
            if parts is not None:
                for name, which, weight in parts:
                    found[row[name], block][which] = weight
                return
        rays, proper = start(glass, origins[block], directions[block])
        index = np.flatnonzero(proper)
        for name, which, weight in _follow(glass, rays.take(index), onward):
            if name in row:
                found[row[name], block.start + index[which]] = weight

    in_blocks(work, total)
    rest = np.clip(1.0 - found.sum(axis=0), 0.0, 1.0)
    return found[[row[name] for name in events]].reshape(len(events), total), rest


def radial_weights(glass: Glass, eye: Floats, wanted: Iterable[str]) -> RadialWeights | None:
    """The closed form, for coaxial glasses and rays that all start in one medium."""
    if isinstance(glass, FlatGlass) or not eye.size or not np.isfinite(eye).all():
        return None
    media = np.unique(glass.medium_at(eye))
    return RadialWeights(glass, int(media[0]), wanted) if len(media) == 1 else None


def _towards(wanted: Iterable[str]) -> Onward:
    """What has `_follow` come to these paths."""
    prefixes = {name[:end] for name in wanted for end in range(len(name) + 1)}
    return lambda events, weight: np.ones(len(weight), bool) if events in prefixes else None


def _follow(glass: Glass, rays: Bundle, onward: Onward):
    """Complete paths: (events, indices of rays, weights), prefixes shared."""
    stack = [("", rays, np.arange(len(rays.length)), np.ones(len(rays.length)))]
    while stack:
        events, rays, index, weight = stack.pop()
        meeting = meet(glass, rays)
        ends = ~meeting.met if events else ~meeting.inside
        yield events, index[ends], weight[ends]
        on = np.flatnonzero(meeting.inside)
        if not len(on):
            continue
        rays, meeting, index, weight = rays.take(on), meeting.take(on), index[on], weight[on]
        reflected = reflectance(glass, rays, meeting)
        for event in "TR":
            part = weight * (reflected if event == "R" else 1.0 - reflected)
            keep = onward(events + event, part)
            if keep is None:
                continue
            going = np.flatnonzero(keep)
            after, possible = advance(glass, rays.take(going), meeting.take(going), event)
            going = going[possible]
            stack.append((events + event, after.take(possible), index[going], part[going]))


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
    if isinstance(glass, AxialGlass):
        return light_paths_axial(glass, as_eye(eye), min_weight)
    origins, directions, share = _sample(glass, as_eye(eye))
    rays, _ = start(glass, origins, directions)
    hits = meet(glass, rays).inside
    if not hits.any():
        return ()
    share = share / share[hits].sum()
    hits = np.flatnonzero(hits & ~_trapped(glass, rays))
    longest = _longest(glass, min_weight)

    def onward(events: str, weight: Floats) -> Flags | None:
        return None if len(events) > longest else strong(weight, min_weight)

    ends = _follow(glass, rays.take(hits), onward)
    ends = ((name, weight, share[hits[which]]) for name, which, weight in ends)
    return tuple(LightPath(name) for name in strongest(ends, min_weight))


def _longest(glass: Glass, min_weight: float) -> int:
    """Events after which no path carries more than `min_weight`, for an eye outside the glass.

    A ray that enters and leaves with a transmittance t, and is reflected k times between, carries
    t² (1 − t)^k at most: no more than 4 / (e k)². Between two reflections that let light out it
    goes in and back out through all other interfaces. An eye in the glass sees longer chains, in
    bands ever narrower: they are cut here too.
    """
    reflections = math.ceil(2.0 / (math.e * math.sqrt(min_weight)))
    interfaces = len(glass.media) - 1
    return (2 * interfaces - 1) * (reflections + 1) + 2


COUNT = 128
"""Angles sampled across the glass."""


def _trapped(glass: Glass, rays: Bundle) -> NDArray[np.bool_]:
    """Which rays are totally reflected for ever: their invariants allow no way out."""
    momentum = np.asarray(glass.media)[rays.medium][:, None] * rays.direction
    if isinstance(glass, FlatGlass):
        across = np.hypot(momentum[:, 0], momentum[:, 1])
        return across >= max(glass.ior_above, glass.ior_below)
    turning = np.cross(rays.origin, momentum)
    if isinstance(glass, CylinderGlass):
        ell, zeta = np.abs(turning[:, 2]), momentum[:, 2]
    else:
        ell, zeta = np.sqrt(np.sum(turning * turning, axis=-1)), 0.0
    room = glass.ior_outside**2 - zeta * zeta
    return ell >= glass.radius[0] * np.sqrt(np.maximum(room, 0.0))


def _towards_grazing(count: int) -> tuple[Floats, Floats]:
    """Angles of incidence in (0, π/2), dense towards π/2, and their shares of that range."""
    edges = 0.5 * np.pi * (1.0 - np.linspace(1.0, 0.0, count + 1) ** 2)
    return 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)


def _midpoints(low: ArrayLike, high: ArrayLike, count: int) -> Floats:
    """`count` equally spaced points between each pair of ends, on a new last axis."""
    parts = (np.arange(count) + 0.5) / count
    low, high = np.asarray(low, dtype=float)[..., None], np.asarray(high, dtype=float)[..., None]
    return low + (high - low) * parts


def _sample(glass: Glass, eye: Floats | ParallelView) -> tuple[Floats, Floats, Floats]:
    """Rays from a viewpoint that cover the glass: origins, directions, shares of the picture."""
    if isinstance(glass, FlatGlass):
        return _sample_flat(glass, eye)
    parallel = isinstance(eye, ParallelView)
    if not parallel and int(glass.medium_at(eye)) > 0:
        return _sample_around(eye)
    towards = -np.asarray(eye.direction) if parallel else eye
    cylinder = isinstance(glass, CylinderGlass)
    flat_part = towards * (1.0, 1.0, 0.0) if cylinder else towards
    away = float(np.sqrt(flat_part @ flat_part))
    if away < 1e-12 * np.sqrt(towards @ towards):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)  # along the axis: no wall is met
    axis = flat_part / away
    if cylinder:
        side = np.array([-axis[1], axis[0], 0.0])
    else:
        side, _ = perpendiculars(axis)
    radius = glass.radius[0]
    incidence, share = _towards_grazing(COUNT)
    impact = np.sin(incidence)
    low, high = (-1.0, 1.0) if not cylinder or glass.extent is None else glass.extent
    if parallel:
        share = share * np.cos(incidence) * (1.0 if cylinder else impact)
        origins = radius * (impact[:, None] * side + 2.0 * axis)
        directions = np.broadcast_to(eye.direction, origins.shape)
        if not cylinder:
            return origins, directions, share
        # The height of the first meeting, spread over the extent.
        way = radius * (2.0 - np.cos(incidence)) * (-towards[2] / away)
        heights = _midpoints(np.full(COUNT, low), np.full(COUNT, high), 9) - way[:, None]
        origins = np.repeat(origins[:, None], 9, axis=1)
        origins[..., 2] = heights
        directions = np.broadcast_to(eye.direction, origins.shape)
        return origins.reshape(-1, 3), directions.reshape(-1, 3), np.repeat(share, 9)
    sine = impact * (radius / away)
    cosine = np.sqrt(1.0 - sine * sine)
    share = share * np.cos(incidence) / cosine
    across = sine[:, None] * side - cosine[:, None] * axis
    if not cylinder:
        return np.broadcast_to(eye, across.shape), across, share * sine
    ways = away * cosine - radius * np.cos(incidence)
    if glass.extent is None:
        low, high = np.zeros(COUNT), np.full(COUNT, 0.5 * np.pi)
    else:
        low, high = np.arctan2(low - eye[2], ways), np.arctan2(high - eye[2], ways)
    rise = _midpoints(low, high, 24)
    share = share[:, None] * (high - low)[:, None] * np.cos(rise)
    directions = np.cos(rise)[..., None] * across[:, None]
    directions[..., 2] = np.sin(rise)
    directions = directions.reshape(-1, 3)
    return np.broadcast_to(eye, directions.shape), directions, share.ravel()


def _sample_around(eye: Floats) -> tuple[Floats, Floats, Floats]:
    """Directions all round, of equal share."""
    azimuth = _midpoints(-np.pi, np.pi, COUNT)
    height = _midpoints(-1.0, 1.0, COUNT // 2)
    flat = np.sqrt(1.0 - height * height)
    directions = np.stack(
        [
            np.outer(flat, np.cos(azimuth)),
            np.outer(flat, np.sin(azimuth)),
            np.repeat(height[:, None], COUNT, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    return np.broadcast_to(eye, directions.shape), directions, np.ones(len(directions))


def _sample_flat(glass: FlatGlass, eye: Floats | ParallelView) -> tuple[Floats, Floats, Floats]:
    parallel = isinstance(eye, ParallelView)
    heights = glass.heights
    if parallel:
        faces = [heights[0] if eye.direction[2] < 0.0 else heights[-1]]
    else:
        medium = int(glass.medium_at(eye))
        faces = [heights[k] for k in (medium - 1, medium) if 0 <= k < len(heights)]
    if glass.outline is None:
        if parallel:
            direction = np.asarray(eye.direction)[None]
            origin = np.array([[0.0, 0.0, faces[0]]]) - direction * (glass.heights[0] + 1.0)
            return origin, direction, np.ones(1)
        incidence, share = _towards_grazing(512)
        share = share * np.sin(incidence)
        directions = [
            np.stack(
                [
                    np.sin(incidence),
                    np.zeros(512),
                    np.cos(incidence) * (1.0 if face > eye[2] else -1.0),
                ],
                axis=-1,
            )
            for face in faces
        ]
        directions = np.concatenate(directions)
        return np.broadcast_to(eye, directions.shape), directions, np.tile(share, len(faces))
    corners = np.asarray(glass.outline)
    grid = np.stack(
        np.meshgrid(
            *(_midpoints(corners[:, k].min(), corners[:, k].max(), 96) for k in (0, 1)),
            indexing="ij",
        ),
        axis=-1,
    ).reshape(-1, 2)
    places = np.concatenate([np.column_stack([grid, np.full(len(grid), face)]) for face in faces])
    if parallel:
        directions = np.broadcast_to(eye.direction, places.shape)
        return places - directions, directions, np.ones(len(places))
    directions = places - eye
    away = np.sqrt(np.sum(directions * directions, axis=-1))
    reached = away > 0.0
    share = np.abs(directions[:, 2])[reached] / away[reached] ** 3
    directions = directions[reached]
    return np.broadcast_to(eye, directions.shape), directions, share
