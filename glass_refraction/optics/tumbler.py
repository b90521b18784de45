# SPDX-License-Identifier: GPL-3.0-or-later
"""A drinking glass with a bottom, and what is in it up to a level."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .axial import SOLID, AxialGlass, Interface
from .glasses import NEARLY, _positive, checked_level
from .surfaces import Cylinder, Plane

OUTSIDE, GLASS, LIQUID = 0, SOLID, 2

FAR = 1e12
"""Outer radii beyond which all points are equally far."""


@dataclass(frozen=True)
class Tumbler(AxialGlass):
    """A cylindrical cup that stands on its origin, its axis along z, open at the top.

    Media: 0 the surroundings (the air in the cup too), 1 the glass, 2 the liquid. Interfaces, as
    `LightPath.interfaces` names them:

    ========= ============================================================================
    outer     outer wall, glass against the surroundings
    dry       inner wall above the liquid, glass against air
    wet       inner wall below the level, glass against liquid
    surface   the liquid's surface
    floor     inner bottom, glass against the liquid (or air, where there is none)
    base      underside, glass against the surroundings
    rim       the ring at the top, glass against the surroundings
    ========= ============================================================================

    Parameters
    ----------
    radius : float
        Of the outer wall, metres.
    wall : float
        Thickness of the wall.
    height : float
        From the underside (z = 0) to the rim.
    bottom : float
        Thickness of the bottom.
    ior : float
        Of the glass.
    liquid_ior : float
    level : float, optional
        Height of the liquid above the inner bottom, 0 to ``height - bottom``. None or 0: empty.
    ior_outside : float
        The medium around and above the liquid.

    Raises
    ------
    ValueError
        Naming the field and its value.
    """

    radius: float
    wall: float
    height: float
    bottom: float
    ior: float = 1.5
    liquid_ior: float = 1.333
    level: float | None = None
    ior_outside: float = 1.0

    def __post_init__(self) -> None:
        for field in ("radius", "wall", "height", "bottom", "ior", "liquid_ior", "ior_outside"):
            object.__setattr__(self, field, _positive(field, getattr(self, field)))
        if self.wall >= self.radius:
            raise ValueError(f"wall must be thinner than radius {self.radius}, not {self.wall!r}")
        if self.bottom >= self.height:
            raise ValueError(
                f"bottom must be thinner than height {self.height}, not {self.bottom!r}"
            )
        if self.level is not None:
            level = checked_level(self.level, self.height - self.bottom)
            object.__setattr__(self, "level", level)

    @property
    def scale(self) -> float:
        return self.radius

    @property
    def media(self) -> tuple[float, ...]:
        filled = (self.liquid_ior,) if self.level else ()
        return (self.ior_outside, self.ior, *filled)

    @cached_property
    def _marks(self) -> tuple[float, float, float, float]:
        """Inner radius, and the heights of floor, liquid surface and rim, in outer radii."""
        scale = self.radius
        surface = self.bottom + (self.level or 0.0)
        full = self.level is not None and self.level >= self.height - self.bottom
        return (
            (self.radius - self.wall) / scale,
            self.bottom / scale,
            (self.height if full else surface) / scale,
            self.height / scale,
        )

    @cached_property
    def interfaces(self) -> tuple[Interface, ...]:
        inner, floor, level, rim = self._marks
        contents = LIQUID if self.level else OUTSIDE
        parts = [
            Interface("outer", Cylinder(1.0, 0.0, rim), OUTSIDE, GLASS),
            Interface("floor", Plane(floor, 0.0, inner), contents, GLASS),
            Interface("base", Plane(0.0, 0.0, 1.0), GLASS, OUTSIDE),
            Interface("rim", Plane(rim, inner, 1.0), OUTSIDE, GLASS),
        ]
        if self.level:
            parts.append(Interface("wet", Cylinder(inner, floor, level), GLASS, LIQUID))
            parts.append(Interface("surface", Plane(level, 0.0, inner), OUTSIDE, LIQUID))
        if level < rim:
            dry = Cylinder(inner, level, rim, open_below=bool(self.level))
            parts.append(Interface("dry", dry, GLASS, OUTSIDE))
        return tuple(parts)

    @property
    def hull(self) -> tuple[float, float, float]:
        return 1.0, 0.0, self._marks[3]

    def sure(self, medium: int, left: str | None, met: str | None) -> bool:
        if medium == LIQUID:
            return True
        if medium == OUTSIDE:
            # The outside of a cylinder: what leaves it never comes back, nor can what meets it
            # have met anything before.
            return bool({left, met} & {"outer", "base"})
        return {left, met} in ({"outer", "wet"}, {"outer", "dry"}, {"floor", "base"})

    def _place(self, points: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        # No point so far off needs more digits, and its square must not overflow.
        x, y, z = np.moveaxis(np.clip(points / self.radius, -FAR, FAR), -1, 0)
        return np.sqrt(x * x + y * y), z

    def medium_at(self, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Index of the medium that holds each point (..., 3)."""
        inner, floor, level, rim = self._marks
        radius, z = self._place(points)
        solid = (radius < 1.0) & (z > 0.0) & (z < rim)
        cup = (radius < inner) & (z >= floor)
        liquid = cup & (z < level) if self.level else False
        return np.where(liquid, LIQUID, np.where(solid & ~cup, GLASS, OUTSIDE))

    def holds(self, medium: int, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points (N, 3) lie in a medium, its interfaces included."""
        inner, floor, level, rim = self._marks
        radius, z = self._place(points)
        skin = NEARLY * (1.0 + rim)
        cup = (radius <= inner + skin) & (z >= floor - skin)
        if medium == LIQUID:
            return cup & (z <= level + skin)
        if medium == GLASS:
            inside_cup = (radius < inner - skin) & (z > floor + skin)
            solid = (radius <= 1.0 + skin) & (z >= -skin) & (z <= rim + skin)
            return solid & ~inside_cup
        within = (radius < 1.0 - skin) & (z > skin) & (z < rim - skin)
        return ~within | (cup & (z >= level - skin))
