# SPDX-License-Identifier: GPL-3.0-or-later
"""Slabs, cylinders and balls as bodies of faces: with sides, rims and open ends.

`FlatGlass` and `CylinderGlass` are computed as though their faces had no end, which gives closed
forms. Where rays meet an end they are followed through these bodies instead, face by face.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .axial import AxialGlass, BoundedGlass, Interface
from .glasses import CylinderGlass, FlatGlass, Glass, SphereGlass
from .outlines import Outline
from .surfaces import Cylinder, Fence, Lid, Plane, Shell, Side, anticlockwise


def body(glass: Glass | BoundedGlass) -> BoundedGlass | None:
    """The glass with all the faces that bound it.

    Returns
    -------
    BoundedGlass or None
        None for a glass without bounds and for one of the ior of what is around it. What lies
        below a slab of another medium than above has no sides: the slab is a tank's wall.

    Raises
    ------
    TypeError
        ``glass`` is none of these.
    """
    if isinstance(glass, BoundedGlass):
        return glass
    if not isinstance(glass, Glass):
        raise TypeError(f"no body for a glass of type {type(glass).__name__}")
    if isinstance(glass, FlatGlass):
        clear = not glass.ior or glass.ior_above in glass.ior
        return None if clear or glass.outline is None else Prism(glass)
    # The core may be of what is around it: then it is open.
    solid = glass.ior[:-1] if len(glass.ior) > 1 else glass.ior
    if glass.ior_outside in solid:
        return None
    if isinstance(glass, CylinderGlass):
        return None if glass.extent is None else Tube(glass)
    return Ball(glass)


@dataclass(frozen=True)
class Prism(BoundedGlass):
    """A slab with its side faces.

    Interfaces: ``interface 0`` … from the top down, ``side 0 3``: of layer 0, the outline's fourth.
    Medium 0 is around it, and below too if it is the same as above.
    """

    glass: FlatGlass

    @cached_property
    def scale(self) -> float:
        return float(np.ptp(np.asarray(self.glass.outline), axis=0).max())

    @property
    def _below(self) -> int:
        """The medium below the last layer."""
        same = self.glass.ior_below == self.glass.ior_above
        return 0 if same else len(self.glass.media) - 1

    @property
    def media(self) -> tuple[float, ...]:
        return self.glass.media[: max(len(self.glass.media) - 1, self._below + 1)]

    @property
    def endless(self) -> tuple[int, ...]:
        return (0, self._below)

    @property
    def ends(self) -> tuple[int, ...]:
        return tuple(range(len(self.interfaces)))

    @cached_property
    def _outline(self) -> Outline:
        """Anticlockwise, in units of `scale`."""
        corners = anticlockwise(np.asarray(self.glass.outline) / self.scale)
        differs = (corners != np.roll(corners, 1, axis=0)).any(axis=1)
        return Outline(tuple((float(x), float(y)) for x, y in corners[differs]))

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        heights = self.glass.heights / self.scale
        media = (*range(len(heights)), self._below)
        found = [
            Interface(f"interface {i}", Lid(z, outline=self._outline), *media[i : i + 2])
            for i, z in enumerate(heights)
        ]
        for layer, (high, low) in enumerate(pairwise(heights)):
            fence = Fence(self._outline, low, high)
            for number, (begin, end) in enumerate(self._outline.sides):
                face = Side(begin, end, fence)
                found.append(Interface(f"side {layer} {number}", face, 0, layer + 1))
        return tuple(found)

    @property
    def box(self) -> NDArray[np.float64]:
        corners, heights = np.asarray(self.glass.outline), self.glass.heights
        return np.array([(*corners.min(axis=0), heights[-1]), (*corners.max(axis=0), heights[0])])

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        x, y, _ = np.moveaxis(points / self.scale, -1, 0)
        medium = self.glass.medium_at(points)
        layers = len(self.glass.ior)
        within = np.where(self._outline.holds(x, y), medium, 0)
        return np.where(medium > layers, self._below, within)


@dataclass(frozen=True)
class _Round(AxialGlass):
    """What tubes and balls share: walls named ``wall 0`` … from the outside in."""

    glass: CylinderGlass | SphereGlass

    @property
    def scale(self) -> float:
        return self.glass.radius[0]

    @property
    def media(self) -> tuple[float, ...]:
        return self.glass.media

    def _walls(self) -> list[float]:
        return [radius / self.scale for radius in self.glass.radius]


@dataclass(frozen=True)
class Ball(_Round):
    """A ball, or balls within each other."""

    glass: SphereGlass

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        return tuple(
            Interface(f"wall {i}", Shell(radius), i, i + 1)
            for i, radius in enumerate(self._walls())
        )

    @property
    def hull(self) -> tuple[float, float, float]:
        return 1.0, -1.0, 1.0

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        return self.glass.medium_at(points)


@dataclass(frozen=True)
class Tube(_Round):
    """A cylinder with its rims, open where its core is of what is around it.

    Further interfaces: ``upper rim 0``, ``lower rim 0`` …, each layer's.
    """

    glass: CylinderGlass

    @cached_property
    def _media(self) -> tuple[int, ...]:
        """The medium here of every medium of the cylinder: an open core is what is around."""
        count = len(self.glass.media)
        is_open = self.glass.ior[-1] == self.glass.ior_outside
        return (*range(count - 1), 0 if is_open else count - 1)

    @property
    def media(self) -> tuple[float, ...]:
        return self.glass.media[: max(self._media) + 1]

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        low, high = (end / self.scale for end in self.glass.extent)
        radii = (*self._walls(), 0.0)
        found = []
        for i, (front, back) in enumerate(pairwise(self._media)):
            found.append(Interface(f"wall {i}", Cylinder(radii[i], low, high), front, back))
            if back:
                ring = radii[i + 1], radii[i]
                found.append(Interface(f"upper rim {i}", Plane(high, *ring), 0, back))
                found.append(Interface(f"lower rim {i}", Plane(low, *ring), back, 0))
        return tuple(found)

    @cached_property
    def ends(self) -> tuple[int, ...]:
        numbered = enumerate(self.interfaces)
        return tuple(n for n, part in numbered if isinstance(part.surface, Plane))

    @property
    def hull(self) -> tuple[float, float, float]:
        low, high = self.glass.extent
        return 1.0, low / self.scale, high / self.scale

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        low, high = self.glass.extent
        z = points[..., 2]
        medium = np.asarray(self._media)[self.glass.medium_at(points)]
        return np.where((z > low) & (z < high), medium, 0)
