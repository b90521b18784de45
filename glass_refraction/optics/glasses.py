# SPDX-License-Identifier: GPL-3.0-or-later
"""The glasses: frozen descriptions, each in its own frame, in metres.

Media are counted in the order of their interfaces: medium 0 lies above (or outside) the first
interface, medium i + 1 just behind interface i. "Deeper" means towards a higher medium.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Recolour = Callable[[float], float]
"""The ior that light of another colour finds, from a medium's own."""


def _positive(field: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ValueError(f"{field} must be a number, not {value!r}") from None
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{field} must be finite and positive, not {value!r}")
    return number


def checked_level(level: object, depth: float) -> float:
    """A liquid's level as a float, from 0 to the cup's depth."""
    try:
        level = float(level)
    except (TypeError, ValueError):
        raise ValueError(f"level must be a number or None, not {level!r}") from None
    # Rounding of the caller's own sums is no fault of theirs.
    if not (math.isfinite(level) and 0.0 <= level <= depth * (1.0 + NEARLY)):
        raise ValueError(f"level must be between 0 and {depth}, not {level!r}")
    return min(level, depth)


def _positives(field: str, values: object) -> tuple[float, ...]:
    if isinstance(values, str) or not hasattr(values, "__iter__"):
        values = (values,)
    return tuple(_positive(field, value) for value in values)  # type: ignore[union-attr]


def _same_length(first: str, second: str, one: Sequence, two: Sequence) -> None:
    if len(one) != len(two):
        raise ValueError(
            f"{first} and {second} must have the same length, not {tuple(one)!r} and {tuple(two)!r}"
        )


def _outline(value: object) -> tuple[tuple[float, float], ...] | None:
    if value is None:
        return None
    try:
        corners = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"outline must be a (K, 2) polygon, not {value!r}") from None
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"outline must be a (K, 2) polygon of three or more, not {value!r}")
    if not np.isfinite(corners).all():
        raise ValueError(f"outline must be finite, not {value!r}")
    return tuple((float(x), float(y)) for x, y in corners)


def _extent(value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        low, high = (float(end) for end in value)  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise ValueError(f"extent must be (z0, z1), not {value!r}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"extent must be finite with z0 < z1, not {value!r}")
    return low, high


@dataclass(frozen=True)
class FlatGlass:
    """A stack of flat layers: a pane, a tank wall, a water surface.

    The first interface is the plane z = 0, the layers follow towards −z.

    Parameters
    ----------
    thickness, ior : tuple of float
        One entry a layer, top layer first, thickness in metres. Both empty: one interface only.
    ior_above, ior_below : float
        Media above the first and below the last interface.
    outline : (K, 2) array_like, optional
        Polygon in x, y that bounds every face, in metres; may be concave. None: unbounded.

    Raises
    ------
    ValueError
        Naming the field and its value.
    """

    thickness: tuple[float, ...]
    ior: tuple[float, ...]
    ior_above: float = 1.0
    ior_below: float = 1.0
    outline: tuple[tuple[float, float], ...] | None = None

    names_interfaces: ClassVar[bool] = False
    has_contents: ClassVar[bool] = False

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "thickness", _positives("thickness", self.thickness))
        set_field(self, "ior", _positives("ior", self.ior))
        _same_length("thickness", "ior", self.thickness, self.ior)
        set_field(self, "ior_above", _positive("ior_above", self.ior_above))
        set_field(self, "ior_below", _positive("ior_below", self.ior_below))
        set_field(self, "outline", _outline(self.outline))

    @property
    def media(self) -> tuple[float, ...]:
        """The ior of every medium, top to bottom."""
        return (self.ior_above, *self.ior, self.ior_below)

    def recoloured(self, glass: Recolour, contents: Recolour) -> FlatGlass:
        """The same glass as light of another colour finds it."""
        layers = tuple(map(glass, self.ior))
        return replace(self, ior=layers, ior_below=contents(self.ior_below))

    @property
    def unbounded(self) -> FlatGlass:
        """The same without its outline."""
        return replace(self, outline=None)

    def encloses(self, points: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
        """Which points (N, 3) lie within the outline and all layers.

        ``margin`` : how far inside they must be at the least, in parts of the glass's size.
        """
        z, thickness = points[:, 2], sum(self.thickness)
        low, high = np.min(self.outline, axis=0), np.max(self.outline, axis=0)
        within = np.all((points[:, :2] > low) & (points[:, :2] < high), axis=1)
        skin = margin * thickness
        return within & (z < -skin) & (z > skin - thickness)

    @property
    def heights(self) -> NDArray[np.float64]:
        """z of every interface in metres, (number of layers + 1,)."""
        return np.concatenate(([0.0], -np.cumsum(self.thickness)))

    def places(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The coordinate of each point (N, 3) that decides its medium, for `holds`."""
        return points[:, 2]

    def holds(self, medium: int, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which places lie in a medium, its interfaces included."""
        edges = (np.inf, *self.heights, -np.inf)
        return (places <= edges[medium]) & (places >= edges[medium + 1])

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Index of the medium that holds each point (..., 3); an interface counts as above."""
        return np.sum(points[..., 2, None] < self.heights, axis=-1)


NEARLY = 1e-12
"""Relative width within which a point counts as on an interface."""


class _Coaxial:
    """What cylinders and spheres share: nested radii and the media between them."""

    radius: tuple[float, ...]
    ior: tuple[float, ...]
    ior_outside: float

    names_interfaces: ClassVar[bool] = False
    has_contents: ClassVar[bool] = True

    def _check(self) -> None:
        set_field = object.__setattr__
        set_field(self, "radius", _positives("radius", self.radius))
        set_field(self, "ior", _positives("ior", self.ior))
        if not self.radius:
            raise ValueError(f"radius must hold at least one entry, not {self.radius!r}")
        _same_length("radius", "ior", self.radius, self.ior)
        if any(outer <= inner for outer, inner in zip(self.radius, self.radius[1:], strict=False)):
            raise ValueError(f"radius must be strictly decreasing, not {self.radius!r}")
        set_field(self, "ior_outside", _positive("ior_outside", self.ior_outside))

    @property
    def media(self) -> tuple[float, ...]:
        """The ior of every medium, outside to core."""
        return (self.ior_outside, *self.ior)

    def recoloured(self, glass: Recolour, contents: Recolour) -> Glass:
        """The same glass as light of another colour finds it."""
        first, *others = self.ior
        return replace(self, ior=(glass(first), *map(contents, others)))

    @property
    def unbounded(self) -> Glass:
        """The same without ends."""
        return self

    def encloses(self, points: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
        """Which points (N, 3) lie within the outer surface; ``margin`` as of `FlatGlass`."""
        return self.distance_from_axis(points) < self.radius[0] * (1 - margin)

    def distance_from_axis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of each point (..., 3) from the axis or centre, in metres."""
        raise NotImplementedError

    def places(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The coordinate of each point (N, 3) that decides its medium, for `holds`."""
        return self.distance_from_axis(points)

    def holds(self, medium: int, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which places lie in a medium, its interfaces included (with what rounding adds)."""
        edges = (np.inf, *self.radius, 0.0)
        inside = places >= edges[medium + 1] * (1.0 - NEARLY)
        return inside if medium == 0 else inside & (places <= edges[medium] * (1.0 + NEARLY))

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Index of the medium that holds each point (..., 3); an interface counts as outside."""
        return np.sum(self.distance_from_axis(points)[..., None] < self.radius, axis=-1)


@dataclass(frozen=True)
class CylinderGlass(_Coaxial):
    """Coaxial cylinders round the z axis: a drinking glass, a rod, a tube.

    Parameters
    ----------
    radius : tuple of float
        Radii in metres, outermost first, strictly decreasing.
    ior : tuple of float
        ``ior[i]`` is the medium just inside ``radius[i]``.
    ior_outside : float
        The medium around.
    extent : (float, float), optional
        z of the lower and upper end of the walls in metres. None: unbounded.

    Raises
    ------
    ValueError
        Naming the field and its value.
    """

    radius: tuple[float, ...]
    ior: tuple[float, ...]
    ior_outside: float = 1.0
    extent: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self._check()
        object.__setattr__(self, "extent", _extent(self.extent))

    @property
    def unbounded(self) -> CylinderGlass:
        return replace(self, extent=None)

    def encloses(self, points: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
        low, high = self.extent
        skin = margin * (high - low)
        within = (points[:, 2] > low + skin) & (points[:, 2] < high - skin)
        return super().encloses(points, margin) & within

    def distance_from_axis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = points[..., 0], points[..., 1]
        return np.sqrt(x * x + y * y)


@dataclass(frozen=True)
class SphereGlass(_Coaxial):
    """Concentric spheres round the origin: a ball, a fish bowl.

    Parameters
    ----------
    radius, ior, ior_outside
        As for `CylinderGlass`.

    Raises
    ------
    ValueError
        Naming the field and its value.
    """

    radius: tuple[float, ...]
    ior: tuple[float, ...]
    ior_outside: float = 1.0

    def __post_init__(self) -> None:
        self._check()

    def distance_from_axis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(np.sum(points * points, axis=-1))


Glass = FlatGlass | CylinderGlass | SphereGlass
