# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses in the world, and which medium holds where they overlap.

A ray knows the medium of every glass that it is in; the one of the glass with the highest priority
holds (nested dielectrics: C. Schmidt and B. Budge, Simple Nested Dielectrics in Ray Traced Images,
Journal of Graphics Tools 7, 2002).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axial import SOLID, BoundedGlass
from .boxes import apart
from .glasses import _positive
from .surfaces import Floats
from .vectors import dot, rotated

STAMPS = 1 << 12
"""More than the glasses of a scene: priorities, entries and the order of the list in one number."""

NOWHERE = np.iinfo(np.int64).min
"""Rank of a glass that a ray is not in."""


def _roughness(value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = -1.0
    if not 0.0 <= number <= 1.0:
        raise ValueError(f"roughness must be between 0 and 1, not {value!r}")
    return number


@dataclass(frozen=True, eq=False)
class PlacedGlass:
    """A glass of closed form in the world.

    Parameters
    ----------
    body : BoundedGlass
        Its description, see `body`; lengths in metres in its own frame.
    pose : (4, 4)
        Rigid: from the body's frame to the world, metres. A mirror image is rigid too.
    absorption : (len(body.media), 3), optional
        Absorption coefficients of each medium, per metre, red, green, blue. Medium 0 is not looked
        at: the surroundings are clear.
    priority : int
        Of the media that overlap, that of the highest priority holds; of equal ones, that which the
        ray entered first (what it starts in or enters at one place: the first in the list). A
        clear cavity of the surroundings' ior, as in a hollow ball, is outside the glass.
    roughness : float
        Of all its interfaces, 0 to 1, as a Glass BSDF has it (GGX). A ray is split at the first
        into `FACETS` rays.
    """

    body: BoundedGlass
    pose: ArrayLike
    absorption: ArrayLike | None = None
    priority: int = 0
    roughness: float = 0.0

    is_mesh: ClassVar[bool] = False

    def __post_init__(self) -> None:
        pose = np.array(self.pose, dtype=float)
        turn = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        if not np.allclose(turn @ turn.T, np.eye(3), atol=RIGID):
            raise ValueError(f"pose must be a rigid (4, 4) matrix, not {self.pose!r}")
        # Blender's matrices are of float32: the nearest one that is rigid to the last digit.
        left, _, right = np.linalg.svd(turn)
        pose[:3, :3] = left @ right
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "roughness", _roughness(self.roughness))

    @property
    def media(self) -> tuple[float, ...]:
        return self.body.media

    @cached_property
    def _ball(self) -> tuple[Floats, float]:
        """Middle and radius of a ball round the body in the world, metres."""
        low, high = self.body.box
        middle = self.pose[:3, :3] @ (0.5 * (low + high)) + self.pose[:3, 3]
        return middle, 0.5 * float(np.linalg.norm(high - low)) * (1.0 + ROUNDING)

    @property
    def absorptions(self) -> ArrayLike | None:
        """Of each of `media`, per metre."""
        return self.absorption

    def inward(self, place: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Places and directions (3, M) of the world in the body's frame and unit of length."""
        turn, origin = self.pose[:3, :3].T, self.pose[:3, 3]
        local = rotated(turn, place - origin[:, None])
        local /= self.body.scale
        return local, rotated(turn, direction)

    def near(self, place: Floats, direction: Floats) -> NDArray[np.bool_]:
        """Which rays of the world, (3, M) each, pass through a ball round the body."""
        middle, radius = self._ball
        away = place - middle[:, None]
        square = dot(away, away)
        along = dot(away, direction)
        # What rounding takes from the difference of squares is given back.
        least = radius * radius + ROUNDING * square
        return (square - along * along <= least) & ((along < 0.0) | (square <= least))


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """A glass that is a mesh. Where it is, the callback `meet` of `exit_rays` tells.

    The front of a face is outside: a ray that meets a front is behind it in the glass, one that
    meets a back was in the glass before, whatever it met before. So a mesh need not be closed, and
    is treated as Cycles treats it. A ray that starts in a mesh is known to be in it from the first
    of its faces that it meets.

    Parameters
    ----------
    ior : float
    absorption : (3,), optional
        Absorption coefficients per metre, red, green, blue.
    priority : int
        As of `PlacedGlass`.
    roughness : float
        As of `PlacedGlass`.
    box : (2, 3), optional
        Lower and upper corner of a box round it in the world, metres: other rays are not asked for.
    tints : (2, 3), optional
        Parts of the light, red, green, blue, that get through where it is refracted at a surface,
        and where it is reflected, beside Fresnel's law. None: all.
    is_painted : bool
        Roughness and tints differ from place to place, and `meet` tells them. `roughness` is 0 if
        it is smooth everywhere.
    """

    ior: float
    absorption: ArrayLike | None = None
    priority: int = 0
    roughness: float = 0.0
    box: ArrayLike | None = None
    tints: ArrayLike | None = None
    is_painted: bool = False

    is_mesh: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "ior", _positive("ior", self.ior))
        object.__setattr__(self, "roughness", _roughness(self.roughness))

    @property
    def media(self) -> tuple[float, ...]:
        """The ior of what is around it, where nothing else is, and its own."""
        return (1.0, self.ior)

    @property
    def absorptions(self) -> ArrayLike | None:
        """Of each of `media`, per metre."""
        return None if self.absorption is None else np.array([(0.0, 0.0, 0.0), self.absorption])


DARKEST = 1e-6
"""Part of the light that a black surface lets through: its logarithm is finite."""


def surfaces(glasses: Sequence[Placed]) -> Floats:
    """(7, G) what the surface of each glass does to light, see `surface_rows`."""
    finish = np.ones((len(glasses), 7))
    for number, glass in enumerate(glasses):
        finish[number, 0] = glass.roughness
        if isinstance(glass, PlacedMesh) and glass.tints is not None:
            finish[number, 1:] = np.ravel(glass.tints)
    return surface_rows(finish)


def surface_rows(finish: ArrayLike) -> Floats:
    """(7, N) what surfaces do to light: the width of their facets' distribution, the square of
    their roughness; and the optical depths, red, green, blue, of refraction and of reflection.

    ``finish``: (N, 7) roughness and the parts of the light that get through.
    """
    rows = np.array(np.transpose(finish), dtype=float)
    rows[0] **= 2
    rows[1:] = -np.log(np.clip(rows[1:], DARKEST, 1.0))
    return rows


RIGID = 1e-5
"""How far the columns of a pose may be from perpendicular unit vectors."""

ROUNDING = 1e-12
"""Relative margin of the balls round glasses."""


Placed = PlacedGlass | PlacedMesh


def shared_media(glasses: Sequence[Placed]) -> tuple[NDArray[np.intp], list[Placed]]:
    """Rows for the media of glasses: of each glass its row (G,), of each row its first glass.

    Meshes of the same medium that lie apart share a row: a ray is in one of them at most. So what
    is known of a ray does not grow with the number of drops on a pane.
    """
    of_medium: dict[tuple, list[int]] = {}
    for number, glass in enumerate(glasses):
        key: tuple = (number,)
        if isinstance(glass, PlacedMesh) and glass.box is not None:
            absorption = None if glass.absorption is None else tuple(np.ravel(glass.absorption))
            key = (glass.ior, absorption, glass.priority)
        of_medium.setdefault(key, []).append(number)
    first = np.arange(len(glasses))
    for members in of_medium.values():
        if len(members) > 1:
            group = apart([glasses[number].box for number in members])
            _, begins = np.unique(group, return_index=True)
            first[members] = np.array(members)[begins][group]
    rows, row = np.unique(first, return_inverse=True)
    return row, [glasses[number] for number in rows]


class Media:
    """What holds where: tables of all media of all glasses."""

    def __init__(self, glasses: Sequence[Placed]) -> None:
        around = {glass.media[0] for glass in glasses if isinstance(glass, PlacedGlass)}
        if len(around) > 1:
            raise ValueError(f"glasses must have the same surroundings, not ior {sorted(around)}")
        if len(glasses) >= STAMPS:
            raise ValueError(f"glasses must be fewer than {STAMPS}, not {len(glasses)}")
        widest = max((len(glass.media) for glass in glasses), default=1)
        # The last row, which -1 finds, are the surroundings.
        self.ior = np.full((len(glasses) + 1, widest), around.pop() if around else 1.0)
        self.absorption = np.zeros((len(glasses) + 1, widest, 3))
        for number, glass in enumerate(glasses):
            count = len(glass.media)
            self.ior[number, 1:count] = glass.media[1:]
            if glass.absorptions is None:
                continue
            table = np.asarray(glass.absorptions, dtype=float)
            if table.shape != (count, 3):
                raise ValueError(f"absorption must be ({count}, 3), not of shape {table.shape}")
            self.absorption[number, 1:count] = table[1:]
        self.clear = not self.absorption.any()
        # A cavity of the surroundings' medium is outside its glass: what overlaps it fills it. The
        # glass itself holds, whatever its ior: it may be a bubble.
        self.holds = (self.ior != self.ior[-1, 0]) | self.absorption.any(axis=-1)
        self.holds[:, 0], self.holds[:-1, SOLID : SOLID + 1] = False, True
        ranks = {value: n for n, value in enumerate(sorted({g.priority for g in glasses}))}
        # Priority first, then what was entered before, then the order of the list.
        self.rank = np.array(
            [ranks[g.priority] * STAMPS**3 - number for number, g in enumerate(glasses)],
            dtype=np.int64,
        )

    def holding(self, medium, entered) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Glass (-1: none) and its medium (0: none) that hold, of media (G, L) of every glass."""
        count = medium.shape[1]
        if not len(medium):
            return np.full(count, -1), np.zeros(count, dtype=np.intp)
        if len(medium) == 1:
            held = np.where(self.holds[0][medium[0]], medium[0], 0).astype(np.intp)
            return np.where(held > 0, 0, -1), held
        rank = self.rank[:, None] - entered.astype(np.int64) * STAMPS
        for row, (holds, own) in enumerate(zip(self.holds, medium, strict=False)):
            rank[row, ~holds[own]] = NOWHERE
        first, rays = np.argmax(rank, axis=0), np.arange(count)
        found = rank[first, rays] != NOWHERE
        return np.where(found, first, -1), np.where(found, medium[first, rays], 0).astype(np.intp)
