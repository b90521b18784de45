# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against the glasses that are meshes: which face they meet next, its normals, its paint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...optics.boxes import apart
from ..read.glasses import Glass
from ..read.mesh_glasses import MeshGlass
from ..read.paint import FINISH, plain_finish
from .caster import Caster
from .things import Triangles

NO_TRIANGLES = Triangles(np.zeros((0, 3)), np.zeros((0, 3), np.int32))


@dataclass(frozen=True, eq=False)
class _Group:
    """Meshes of which no two overlap.

    `glass`: (T,) number of each triangle's glass. `points`, `normals`: (T, 3, 3), `flat`: (T, 3).
    `is_smooth`: (T,) whether not all normals of the triangle are one. `slopes`: see `_slopes`.
    `within`: (T, 3, 3) the normals for rays that come from within; None: the same. `meshes`: all of
    them, if any glass is painted, and `begins` their first triangles.
    """

    caster: Caster
    glass: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    flat: np.ndarray
    is_smooth: np.ndarray
    slopes: np.ndarray
    within: np.ndarray | None
    meshes: list[MeshGlass]
    begins: np.ndarray

    def meet(self, origins: np.ndarray, directions: np.ndarray) -> tuple:
        """Number of the glass (L,), metres (L,), true and interpolated normal (L, 3), and what the
        surface is like (L, `FINISH`), if any is painted."""
        way, triangle = self.caster.cast(origins, directions)
        count = len(origins)
        glass = np.full(count, -1, np.intp)
        flat, smooth = np.zeros((2, count, 3))
        hit = np.flatnonzero(triangle >= 0)
        number = triangle[hit]
        glass[hit], flat[hit] = self.glass[number], self.flat[number]
        smooth[hit] = self.normals[number, 0]
        some = np.flatnonzero(self.is_smooth[number])
        hit, number = hit[some], number[some]
        places = origins[hit] + way[hit, None] * directions[hit]
        shares = _shares(self.points[number, 0], self.slopes[number], places)
        normals = self.normals[number]
        if self.within is not None:
            leaves = (directions[hit] * self.flat[number]).sum(axis=1) > 0.0
            normals[leaves] = self.within[number[leaves]]
        smooth[hit] = np.einsum("nk,nkd->nd", shares, normals)
        return glass, way, flat, smooth, self._finish(triangle, origins, way, directions)

    def _finish(self, triangle: np.ndarray, origins, way, directions) -> np.ndarray:
        """(L, `FINISH`) what the surface is like where rays meet triangles, if any is painted."""
        found = np.ones((len(triangle), FINISH if self.meshes else 0))
        if not self.meshes:
            return found
        member = np.searchsorted(self.begins, triangle, side="right") - 1
        for number, mesh in enumerate(self.meshes):
            on = np.flatnonzero((member == number) & (triangle >= 0))
            if mesh.paint is None:
                found[on] = plain_finish(mesh)
                continue
            own = triangle[on]
            places = origins[on] + way[on, None] * directions[on]
            shares = _shares(self.points[own, 0], self.slopes[own], places)
            found[on] = mesh.paint.at(own - self.begins[number], shares)
        return found


class GlassMeshes:
    """The glasses that are meshes, ready to be met: the callback `meet` of `optics.exit_rays`.

    Rays that start on one of two surfaces that touch would not meet the other, were both in one
    target. So meshes whose boxes overlap have targets of their own, as far as there are casters.

    Parameters
    ----------
    glasses : all glasses, in the order that the tracer knows them by.
    centre, scale : see `Caster.aim`.
    """

    def __init__(
        self, casters: Sequence[Caster], glasses: Sequence[Glass], centre: np.ndarray, scale: float
    ) -> None:
        numbers = [n for n, glass in enumerate(glasses) if glass.is_mesh]
        grouped = apart([glasses[n].description.box for n in numbers], len(casters))
        self._groups = []
        is_painted = any(glasses[n].description.paint is not None for n in numbers)
        for group, caster in enumerate(casters):
            members = [n for n, own in zip(numbers, grouped, strict=True) if own == group]
            if not members:
                caster.aim(NO_TRIANGLES, centre, scale)
                continue
            chosen = [glasses[member].description for member in members]
            sizes = [len(mesh.points) for mesh in chosen]
            points = np.concatenate([mesh.points for mesh in chosen])
            flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            normals = np.concatenate([mesh.normals for mesh in chosen])
            within, first = _within(chosen), normals[:, :1]
            is_smooth = (normals != first).any(axis=(1, 2))
            if within is not None:
                is_smooth |= (within != first).any(axis=(1, 2))
            corners = np.arange(3 * len(points), dtype=np.int32).reshape(-1, 3)
            caster.aim(Triangles(points.reshape(-1, 3), corners), centre, scale)
            self._groups.append(
                _Group(
                    caster,
                    np.repeat(members, sizes),
                    points,
                    normals,
                    flat,
                    is_smooth,
                    _slopes(points),
                    within,
                    chosen if is_painted else [],
                    np.cumsum([0, *sizes])[:-1],
                )
            )

    def __bool__(self) -> bool:
        return bool(self._groups)

    def meet(self, origins: np.ndarray, directions: np.ndarray) -> tuple:
        """The next face of each group of meshes: (H, L) and (H, L, 3), see `optics.exit_rays`."""
        found = (group.meet(origins, directions) for group in self._groups)
        return tuple(np.stack(part) for part in zip(*found, strict=True))


def _within(meshes: Sequence[MeshGlass]) -> np.ndarray | None:
    """The meshes' normals for rays that come from within, if they are others."""
    if all(mesh.within is None for mesh in meshes):
        return None
    return np.concatenate([m.normals if m.within is None else m.within for m in meshes])


def _slopes(corners: np.ndarray) -> np.ndarray:
    """(T, 2, 3) how the shares of the second and third corner grow over triangles (T, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, ab, bb = (
        np.einsum("nk,nk->n", u, v) for u, v in ((first, first), (first, second), (second, second))
    )
    area = aa * bb - ab * ab
    first, second = (
        (own[:, None] * one - ab[:, None] * other)
        for own, one, other in ((bb, first, second), (aa, second, first))
    )
    return np.stack((first, second), axis=1) / np.where(area > 0.0, area, 1.0)[:, None, None]


def _shares(corner: np.ndarray, slopes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Shares (N, 3) of the corners of triangles in places (N, 3) on them, 0 to 1 and 1 together.

    ``corner``: (N, 3) the first one. ``slopes``: (N, 2, 3) of `_slopes`.
    """
    v, w = np.einsum("nsk,nk->ns", slopes, places - corner).T
    shares = np.clip(np.stack((1.0 - v - w, v, w), axis=1), 0.0, 1.0)
    return shares / shares.sum(axis=1, keepdims=True)
