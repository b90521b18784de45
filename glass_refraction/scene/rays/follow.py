# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows a picture's rays through all glasses, up to the things that they meet at last.

Where no thing reaches among the glasses, what rays do in these does not depend on things: it is
found without looking for any, and kept for the next frame while eye and glasses stay. Each ray's
ways are the same to the bit whether they were kept or not, and whichever rays go with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ... import optics
from ..memory import counters
from ..progress import check
from ..read.viewpoint import Viewpoint
from .caster import Caster, cast_past
from .hits import Ways
from .meshes import GlassMeshes

Band = tuple[tuple[float, float, float], list[optics.Placed]]
"""What light of a band brings to the colours, and the glasses as it finds them."""

CONTACT = 1e-5
"""Of the glasses' size: what reaches no deeper among them only touches them."""
FINE = 5.0
"""Where a pixel has many rays, ways must carry so much more of a ray's light: it is a part of the
pixel's."""
TOGETHER = 100_000
"""Rays that are followed together. While they are, each takes a kilobyte and more; fewer would cost
time, for each step is a batch of casts."""
MOST_KEPT = 1_000_000
"""Ways that are kept for the next frame, 0.12 kilobytes each."""


@dataclass
class Kept:
    """What was followed without looking for things, by the places of its rays in a pixel.

    Attributes
    ----------
    stamp : of eye and glasses.
    parts : least weight and places -> pixels (N,), rising, and the ways of their rays, pixel by
        pixel; light lost.
    """

    stamp: tuple = ()
    parts: dict[tuple[float, bytes], tuple[np.ndarray, Ways, np.ndarray]] = field(
        default_factory=dict
    )

    def match(self, stamp: tuple) -> None:
        """Forget what was found for another eye or other glasses."""
        if stamp != self.stamp:
            self.stamp = stamp
            self.parts.clear()

    @property
    def ways(self) -> int:
        """How many ways are kept."""
        return sum(len(ways) for _, ways, _ in self.parts.values())


@dataclass
class Follower:
    """Follows rays of one frame.

    Attributes
    ----------
    view : the camera. bands : glasses in light of each band.
    caster : of things. boxes : (B, 2, 3) round these. hull : (2, 3) a box round all glasses.
    meshes : the glasses that are meshes.
    min_weight, fresnel : see :class:`frame.FrameInput`. kept : what earlier frames found.
    through : (T,) bool, which triangles are seen through the glasses; None: all.
    """

    view: Viewpoint
    bands: Sequence[Band]
    caster: Caster
    meshes: GlassMeshes
    boxes: np.ndarray
    hull: np.ndarray
    min_weight: float
    fresnel: bool
    kept: Kept
    through: np.ndarray | None = None

    def __post_init__(self) -> None:
        low, high = self.hull
        self._skin = CONTACT * float(np.linalg.norm(high - low))
        inside = (self.boxes[:, 0] < high - self._skin) & (self.boxes[:, 1] > low + self._skin)
        self._apart = not inside.all(axis=1).any()
        placed = [glass for _, glasses in self.bands for glass in glasses]
        self.rough = any(glass.roughness for glass in placed)
        self.only_meshes = all(glass.is_mesh for glass in placed)

    @property
    def fine_weight(self) -> float:
        """Part of a ray's light that its ways must carry where a pixel has many rays."""
        # The facets of rough glasses share out the light: of each way there are many.
        return self.min_weight * (1.0 if self.rough else FINE)

    def ways(
        self, pixels: np.ndarray, places: np.ndarray, settled: np.ndarray | None = None
    ) -> tuple[Ways, np.ndarray]:
        """Ways of rays through places (P, 2) of each pixel (N,), numbers rising, from its centre.

        Rays are numbered pixel by pixel. Those that meet no glass first have no way.

        Parameters
        ----------
        settled : sorted `way_codes` of ways that are known and left out here; ways that carry less
            than `fine_weight` are not followed then. None: all are followed.

        Returns
        -------
        ways : of all rays.
        lost : (N · P,) the part of each ray's light that is not in them.
        """
        least = self.min_weight if settled is None else self.fine_weight
        if not self._apart:
            ways, lost = self._traced(pixels, places, least, things=True)
            return unsettled(ways, lost, pixels, len(places), settled)
        ways, lost = self._kept(pixels, places, least)
        seen = self._unhidden(ways, pixels, places)
        ways = ways.take(np.flatnonzero(seen[ways.ray]))
        ways, lost = unsettled(ways, lost * seen, pixels, len(places), settled)
        return self._ended(ways), lost

    def _rays(self, pixels: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = self.view.size[0]
        pixel = np.repeat(pixels, len(places))
        offset = np.tile(places, (len(pixels), 1))
        x = pixel % width + 0.5 + offset[:, 0]
        y = pixel // width + 0.5 + offset[:, 1]
        origins, directions = self.view.rays(x, y)
        return np.array(origins), np.array(directions)

    def _traced(
        self, pixels: np.ndarray, places: np.ndarray, least: float, *, things: bool
    ) -> tuple[Ways, np.ndarray]:
        """The ways of rays through places of each pixel, a block of pixels after the other."""
        step = max(1, TOGETHER // len(places))
        parts, lost = [], []
        for first in range(0, max(1, len(pixels)), step):
            block = pixels[first : first + step]
            ways, left = self._traced_together(block, places, least, things=things)
            parts.append(replace(ways, ray=ways.ray + first * len(places)))
            lost.append(left)
        return Ways.joined(parts), np.concatenate(lost)

    def _traced_together(
        self, pixels: np.ndarray, places: np.ndarray, least: float, *, things: bool
    ) -> tuple[Ways, np.ndarray]:
        origins, directions = self._rays(pixels, places)
        counters["exit_rays"] += len(origins)
        parts, lost = [], np.zeros(len(origins))
        for number, (colour, placed) in enumerate(self.bands):
            ends = optics.exit_rays(
                placed,
                origins,
                directions,
                min_weight=least,
                cast=self._cast if things else None,
                things=self.boxes if things else None,
                meet=self.meshes.meet if self.meshes else None,
                fresnel=self.fresnel,
                pixel=np.repeat(pixels, len(places)),
                sample=np.tile(np.arange(len(places)), len(pixels)),
                between=check,
            )
            check()
            share = float(np.mean(colour))
            met = np.flatnonzero(ends.events > 0)
            weight = ends.weight[met]
            lost += ends.lost * share
            parts.append(
                Ways(
                    ends.ray[met],
                    ends.path[met] ^ np.int64(number << 1),
                    weight * share,
                    weight[:, None] * np.exp(-ends.depth[met]) * colour,
                    ends.origin[met],
                    ends.direction[met],
                    ends.distance[met],
                    ends.thing[met],
                    ends.events[met],
                    ends.rough[met],
                )
            )
        return Ways.joined(parts), lost

    def _kept(
        self, pixels: np.ndarray, places: np.ndarray, least: float
    ) -> tuple[Ways, np.ndarray]:
        """Ways without things, of which those that are not known are followed."""
        count, key = len(places), (least, places.tobytes())
        known, ways, lost = self.kept.parts.get(key, (np.zeros(0, np.intp), None, np.zeros(0)))
        new = np.setdiff1d(pixels, known, assume_unique=True)
        if ways is None or len(new):
            more, more_lost = self._traced(new, places, least, things=False)
            known, ways, lost = _merged(known, ways, lost, new, more, more_lost, count)
            if self.kept.ways + len(ways) <= MOST_KEPT:
                self.kept.parts[key] = known, ways, lost
        if len(known) == len(pixels):
            return ways, lost
        chosen = np.searchsorted(known, pixels)
        number = np.full(len(known), -1, np.intp)
        number[chosen] = np.arange(len(pixels))
        pixel, ray = np.divmod(ways.ray, count)
        rows = np.flatnonzero(number[pixel] >= 0)
        some = ways.take(rows)
        some.ray[:] = number[pixel[rows]] * count + ray[rows]
        return some, lost.reshape(-1, count)[chosen].ravel()

    def _unhidden(self, ways: Ways, pixels: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(N · P,) which rays that have ways meet no thing before the glasses."""
        seen = np.zeros(len(pixels) * len(places), bool)
        seen[ways.ray] = True
        rays = np.flatnonzero(seen)
        if len(rays):
            origins, directions = self._rays(pixels, places)
            origins, directions = origins[rays], _unit(directions[rays])
            distance, _ = self.caster.cast(origins, directions)
            seen[rays] = distance >= self._entry(origins, directions)
        return seen

    def _ended(self, ways: Ways) -> Ways:
        """The ways up to the things that they meet."""
        if not len(ways):
            return ways
        # From a little before: a thing that touches the glass there is seen through a film of air.
        begin = ways.origin - self._skin * ways.direction
        distance, triangle = self._cast_through(begin, ways.direction)
        distance = np.maximum(distance - self._skin, 0.0)
        return replace(ways, distance=distance, triangle=triangle)

    def _cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What rays meet; those that come from the eye have passed no glass and meet all things."""
        if self.through is None:
            return self.caster.cast(origins, directions)
        ahead = np.abs((origins - self.view.eye) @ self.view.forward)
        if self.view.is_parallel:
            first = ahead <= self._skin
        else:
            first = np.all(origins == self.view.eye, axis=1)
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1, np.intp)
        for rows, cast in ((first, self.caster.cast), (~first, self._cast_through)):
            rows = np.flatnonzero(rows)
            if len(rows):
                distance[rows], triangle[rows] = cast(origins[rows], directions[rows])
        return distance, triangle

    def _cast_through(
        self, origins: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """What rays meet of what is seen through the glasses."""
        if self.through is None:
            return self.caster.cast(origins, directions)
        return cast_past(self.caster, self.through, self._skin, origins, directions)

    def _entry(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Metres (M,) at which rays come into the box round all glasses; 0 from within."""
        along = np.where(np.abs(directions) < 1e-300, 1e-300, directions)
        low, high = self.hull
        begin = (low + self._skin - origins) / along
        end = (high - self._skin - origins) / along
        return np.maximum(np.minimum(begin, end).max(axis=1), 0.0)


def way_codes(pixel: np.ndarray, path: np.ndarray) -> np.ndarray:
    """(K,) int64, the same for ways of a pixel through the same interfaces (a hash)."""
    return path ^ (pixel.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)).view(np.int64)


def unsettled(
    ways: Ways, lost: np.ndarray, pixels: np.ndarray, count: int, settled: np.ndarray | None
) -> tuple[Ways, np.ndarray]:
    """The ways that are not settled; the light of the others counts as lost.

    Parameters
    ----------
    ways, lost : of ``count`` rays in each pixel (N,). settled : sorted `way_codes`, or None.
    """
    check()
    if settled is None or not len(settled):
        return ways, lost
    codes = way_codes(pixels[ways.ray // count], ways.path)
    at = np.minimum(np.searchsorted(settled, codes), len(settled) - 1)
    known = settled[at] == codes
    lost = lost + np.bincount(ways.ray[known], ways.weight[known], len(lost))
    return ways.take(np.flatnonzero(~known)), lost


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _merged(known, ways, lost, new, more, more_lost, count: int):
    """Two sets of pixels and the ways of their rays as one, pixel by pixel."""
    if ways is None:
        return new, more, more_lost
    pixels = np.concatenate((known, new))
    order = np.argsort(pixels, kind="stable")
    place = np.empty(len(order), np.intp)
    place[order] = np.arange(len(order))
    joined = Ways.joined([ways, more])
    start = np.concatenate((np.zeros(len(ways), np.intp), np.full(len(more), len(known))))
    pixel, ray = np.divmod(joined.ray, count)
    joined.ray[:] = place[pixel + start] * count + ray
    # Rows of one ray stay side by side, in their order.
    joined = joined.take(np.argsort(joined.ray, kind="stable"))
    both = np.concatenate((lost.reshape(-1, count), more_lost.reshape(-1, count)))
    return pixels[order], joined, both[order].ravel()
