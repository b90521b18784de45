# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses of revolution from profile curves: a wine glass, a carafe, a bowl, a lens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import AxialGlass, Interface
from .glasses import _positive, checked_level
from .profiles import Curve, Profile, as_curve
from .surfaces import Plane

OUTSIDE, GLASS, LIQUID = 0, 1, 2

CLOSE = 1e-3
"""Distance from an interface, in units of `scale`, within which a point counts for both media;
where rays really run decides."""


@dataclass(frozen=True)
class RevolutionGlass(AxialGlass):
    """A body of glass whose outside, and the cup in it, are curves turned round the z axis.

    Media: 0 the surroundings (the air in the cup too), 1 the glass, 2 the liquid. Interfaces, as
    `LightPath.interfaces` names them: outer, dry (inside above the liquid), wet (inside below the
    level), surface (of the liquid), rim (from the end of `outer` to that of `inner`).

    Parameters
    ----------
    outer : array_like, (K, 2) or (K, 3, 2)
        (radius, height) in metres, from the axis below up to the rim; without `inner`, up to the
        axis again. Points are joined by a cubic spline; (K, 3, 2) are Bézier points as Blender's
        curves have them: left handle, point, right handle. A spline is level on the axis.
    inner : array_like, optional
        The same for the inside of the cup, from the axis up to the rim.
    ior, liquid_ior, ior_outside : float
    level : float, optional
        Height of the liquid's surface above the cup's lowest point, metres. None or 0: empty.

    Raises
    ------
    ValueError
        Naming the field and its value.
    """

    outer: tuple
    inner: tuple | None = None
    ior: float = 1.5
    liquid_ior: float = 1.333
    level: float | None = None
    ior_outside: float = 1.0

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        for field in ("ior", "liquid_ior", "ior_outside"):
            set_field(self, field, _positive(field, getattr(self, field)))
        outer = as_curve("outer", self.outer)
        set_field(self, "outer", nested(self.outer))
        set_field(self, "_outer", outer)
        _from_axis("outer", self.outer)
        if self.inner is None:
            if _nodes(self.outer)[-1][0] != 0.0:
                raise ValueError(f"outer must end on the axis without inner: {self.outer!r}")
            if self.level:
                raise ValueError(f"level must be None without inner, not {self.level!r}")
            return
        inner = as_curve("inner", self.inner)
        set_field(self, "inner", nested(self.inner))
        set_field(self, "_inner", inner)
        _from_axis("inner", self.inner)
        if self.level is not None:
            nodes = _nodes(self.inner)
            set_field(self, "level", checked_level(self.level, nodes[-1][1] - nodes[0][1]))

    @cached_property
    def scale(self) -> float:
        """The largest radius of the outside, metres."""
        return float(_outline(self._outer)[:, 0].max())

    @property
    def media(self) -> tuple[float, ...]:
        filled = (self.liquid_ior,) if self.level else ()
        return (self.ior_outside, self.ior, *filled)

    @cached_property
    def _surface_height(self) -> float:
        return (_nodes(self.inner)[0][1] + self.level) / self.scale

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        outer = self._outer.scaled(1.0 / self.scale)
        parts = [Interface("outer", Profile(outer), OUTSIDE, GLASS)]
        if self.inner is None:
            return tuple(parts)
        inner = self._inner.scaled(1.0 / self.scale)
        ends = [np.array(_nodes(side)[-1]) / self.scale for side in (self.outer, self.inner)]
        if np.abs(ends[0] - ends[1]).max() > 1e-9:
            rim = Curve.through(np.stack(ends))
            parts.append(Interface("rim", Profile(rim), OUTSIDE, GLASS))
        if not self.level:
            return (*parts, Interface("dry", Profile(inner), GLASS, OUTSIDE))
        height = self._surface_height
        wet, dry = Profile(inner, high=height), Profile(inner, low=height, open_below=True)
        outline = _outline(inner)
        crossing = np.flatnonzero((outline[:-1, 1] <= height) & (outline[1:, 1] > height))
        last = crossing[0] if len(crossing) else len(outline) - 2
        radius = _radius_at(wet, outline[last : last + 2].mean(axis=0)[0], height)
        parts.append(Interface("wet", wet, GLASS, LIQUID))
        parts.append(Interface("surface", Plane(height, 0.0, radius), OUTSIDE, LIQUID))
        if height < outline[-1, 1] - 1e-12:
            parts.append(Interface("dry", dry, GLASS, OUTSIDE))
        return tuple(parts)

    @cached_property
    def hull(self) -> tuple[float, float, float]:
        outline = _outline(self._outer) / self.scale
        if self.inner is not None:
            outline = np.concatenate([outline, _outline(self._inner) / self.scale])
        return float(outline[:, 0].max()), float(outline[:, 1].min()), float(outline[:, 1].max())

    @cached_property
    def _maps(self) -> tuple:
        """Rasters that tell which media lie in or near a place (r, z): origin, step, (3, R, Z)."""
        radius, low, high = self.hull
        step = max(radius, high - low) / 300.0
        r = (np.arange(int(radius / step) + 4) + 0.5) * step
        z = low - 2.0 * step + (np.arange(int((high - low) / step) + 5) + 0.5) * step
        grid = np.stack(np.meshgrid(r, z, indexing="ij"), axis=-1).reshape(-1, 2)
        medium = self._medium_exactly(grid).reshape(len(r), len(z))
        near = []
        for number in range(len(self.media)):
            padded = np.pad(medium == number, 2, mode="edge")
            part = np.zeros(medium.shape, dtype=bool)
            for row in range(5):
                for column in range(5):
                    part |= padded[row : row + len(r), column : column + len(z)]
            near.append(part)
        return float(z[0] - 0.5 * step), step, np.stack(near)

    def _medium_exactly(self, places: NDArray[np.float64]) -> NDArray[np.intp]:
        """Medium of places (M, 2) in units of `scale`: how often the way in crosses an outline."""
        inside = [_encloses(_outline(self._outer) / self.scale, places)]
        if self.inner is None:
            return np.where(inside[0], GLASS, OUTSIDE)
        outer, inner = (_outline(side) / self.scale for side in (self._outer, self._inner))
        # The body ends at the rim; the cup is what the inner curve and the rim's height enclose.
        inside[0] = _encloses(np.concatenate([outer, inner[-1:] * (0, 1)]), places)
        cup = _encloses(np.concatenate([inner, inner[-1:] * (0, 1)]), places)
        medium = np.where(inside[0] & ~cup, GLASS, OUTSIDE)
        if self.level:
            medium[cup & (places[:, 1] < self._surface_height)] = LIQUID
        return medium

    def _places(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        clipped = np.clip(points / self.scale, -1e12, 1e12)
        x, y, z = np.moveaxis(clipped, -1, 0)
        return np.stack([np.sqrt(x * x + y * y), z], axis=-1)

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Index of the medium that holds each point (..., 3)."""
        places = self._places(np.asarray(points, dtype=float))
        flat = places.reshape(-1, 2)
        medium = np.zeros(len(flat), dtype=np.intp)
        radius, low, high = self.hull
        near = (flat[:, 0] <= radius) & (flat[:, 1] >= low) & (flat[:, 1] <= high)
        if near.any():
            medium[near] = self._medium_exactly(flat[near])
        return medium.reshape(places.shape[:-1])

    def holds(self, medium: int, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points (N, 3) lie in a medium or within a hundredth of it."""
        low, step, near = self._maps
        places = self._places(points)
        row, column = np.floor(places[:, 0] / step), np.floor((places[:, 1] - low) / step)
        inside = (row < near.shape[1]) & (column >= 0) & (column < near.shape[2])
        row, column = (np.where(inside, part, 0).astype(np.intp) for part in (row, column))
        return np.where(inside, near[medium][row, column], medium == OUTSIDE)


def nested(value: ArrayLike) -> tuple:
    """Nested tuples of floats, which can be hashed."""
    array = np.asarray(value, dtype=float)

    def deep(part):
        return tuple(deep(one) for one in part) if part.ndim else float(part)

    return deep(array)


def _nodes(value: tuple) -> tuple:
    """The points that a curve passes."""
    return tuple(point[1] if isinstance(point[0], tuple) else point for point in value)


def _from_axis(name: str, value: tuple) -> None:
    if _nodes(value)[0][0] != 0.0:
        raise ValueError(f"{name} must begin on the axis (radius 0), not {value[0]!r}")


def _outline(curve: Curve) -> NDArray[np.float64]:
    """Points (M, 2) close to each other along a curve."""
    t = np.linspace(0.0, len(curve.radius), 40 * len(curve.radius) + 1)
    k = np.minimum(t.astype(int), len(curve.radius) - 1)
    powers = (t - k)[:, None] ** np.arange(4)
    sides = (np.array(rows)[k] for rows in (curve.radius, curve.height))
    return np.stack([np.sum(side * powers, axis=1) for side in sides], axis=-1)


def _radius_at(profile: Profile, radius: float, height: float) -> float:
    """Radius of a profile at a height, near a radius."""
    t = float(profile.nearest(np.array([radius]), np.array([height]))[0])
    for _ in range(30):
        _, z, _, slope, _, _ = profile.on_curve(np.array([t]))
        if slope[0] == 0.0:
            break
        t = min(max(t - float((z[0] - height) / slope[0]), 0.0), float(profile.count))
    return float(profile.on_curve(np.array([t]))[0][0])


def _encloses(outline: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which places (M, 2) lie between an outline and the axis, by the even-odd rule."""
    # By height, a piece of the outline spans places that follow one another.
    order = np.argsort(places[:, 1], kind="stable")
    r, z = places[order].T
    ends = np.searchsorted(z, outline[:, 1])
    inside = np.zeros(len(places), dtype=bool)
    for ((r0, z0), (r1, z1)), some in zip(pairwise(outline), pairwise(ends), strict=True):
        spans = slice(min(some), max(some))
        if spans.start < spans.stop:
            inside[spans] ^= r[spans] < r0 + (z[spans] - z0) * ((r1 - r0) / (z1 - z0))
    found = np.empty_like(inside)
    found[order] = inside
    return found
