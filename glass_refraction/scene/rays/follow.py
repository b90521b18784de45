# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows a picture's rays through all glasses, up to the things that they meet at last.

Where no thing reaches among the glasses, what rays do in these does not depend on things: it is
found without looking for any, and kept for the next frame while eye and glasses stay. Each ray's
ways are the same to the bit whether they were kept or not, and whichever rays go with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ... import optics
from ..memory import counters
from ..progress import check
from ..read.viewpoint import Viewpoint
from .caster import Caster, cast_past
from .columns import joined
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


class Block(NamedTuple):
    """Pixels (N,), numbers rising, the ways of as many rays in each, pixel by pixel, and of each
    ray the part of its light that is not in them."""

    pixels: np.ndarray
    ways: Ways
    lost: np.ndarray


@dataclass
class Kept:
    """What was followed without looking for things, by the places of its rays in a pixel.

    Attributes
    ----------
    eye : stamp of where rays begin. glasses : stamps of these and of how they are followed.
    parts : least weight and places -> blocks one behind another in the picture.
    """

    eye: tuple = ()
    glasses: tuple = ()
    parts: dict[tuple[float, bytes], list[Block]] = field(default_factory=dict)

    def match(self, eye: tuple, glasses: tuple) -> None:
        """Forget what was found for another eye or other glasses."""
        if (eye, glasses) != (self.eye, self.glasses):
            self.eye, self.glasses = eye, glasses
            self.parts.clear()

    @property
    def ways(self) -> int:
        """How many ways are kept."""
        return sum(len(block.ways) for blocks in self.parts.values() for block in blocks)


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

    def blocks(
        self, pixels: np.ndarray, places: np.ndarray, settled: np.ndarray | None = None
    ) -> Iterator[Block]:
        """Ways of rays through places (P, 2) of each pixel (N,), numbers rising, from its centre.

        Rays that meet no glass first have no way.

        Parameters
        ----------
        settled : sorted `way_codes` of ways that are known and left out here; ways that carry less
            than `fine_weight` are not followed then. None: all are followed.

        Yields
        ------
        At least one block, each of a part of the pixels.
        """
        least = self.min_weight if settled is None else self.fine_weight
        key = (least, places.tobytes())
        known = self.kept.parts.pop(key, [])
        room, kept = MOST_KEPT - self.kept.ways, []
        for part, old in _divided(pixels, known, max(1, TOGETHER // len(places))):
            if self._apart:
                whole = self._whole(part, places, least, old)
                room -= len(whole.ways)
                kept = [*kept, whole] if len(whole.pixels) and room >= 0 else []
                ways, lost = self._of_kept(whole, part, places)
            else:
                ways, lost = self._traced(part, places, least, things=True)
            ways, lost = unsettled(ways, lost, part, len(places), settled)
            yield Block(part, self._ended(ways) if self._apart else ways, lost)
        if kept:
            self.kept.parts[key] = kept

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
                    ends.ray[met].astype(np.int32),
                    ends.path[met] ^ np.int64(number << 1),
                    weight * share,
                    weight[:, None] * np.exp(-ends.depth[met]) * colour,
                    ends.origin[met],
                    ends.direction[met],
                    ends.distance[met],
                    ends.thing[met].astype(np.int32),
                    ends.events[met].astype(np.int16),
                    ends.rough[met],
                )
            )
        return joined(Ways, parts), lost

    def _whole(
        self, pixels: np.ndarray, places: np.ndarray, least: float, old: Block | None
    ) -> Block:
        """An old block and the ways, without things, of those pixels that it has not."""
        if old is None:
            return Block(pixels, *self._traced(pixels, places, least, things=False))
        new = np.setdiff1d(pixels, old.pixels, assume_unique=True)
        if not len(new):
            return old
        traced = self._traced(new, places, least, things=False)
        return _merged(old, Block(new, *traced), len(places))

    def _of_kept(
        self, kept: Block, pixels: np.ndarray, places: np.ndarray
    ) -> tuple[Ways, np.ndarray]:
        """The ways of some pixels of a block that no thing hides from the eye, and lost light."""
        count, ways, lost = len(places), kept.ways, kept.lost
        if len(kept.pixels) > len(pixels):
            chosen = np.searchsorted(kept.pixels, pixels)
            number = np.full(len(kept.pixels), -1, np.int32)
            number[chosen] = np.arange(len(pixels))
            pixel, ray = np.divmod(ways.ray, count)
            rows = np.flatnonzero(number[pixel] >= 0)
            ways = replace(ways.take(rows), ray=number[pixel[rows]] * count + ray[rows])
            lost = lost.reshape(-1, count)[chosen].ravel()
        seen = self._unhidden(ways, pixels, places)
        return ways.take(np.flatnonzero(seen[ways.ray])), lost * seen

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
        return replace(ways, distance=distance, triangle=triangle.astype(np.int32))

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


def _divided(
    pixels: np.ndarray, known: list[Block], most: int
) -> Iterator[tuple[np.ndarray, Block | None]]:
    """Pixels in parts, each with the known block that lies where it does.

    Where there is none, or far more pixels than it has, there are at most so many in each part.
    """
    firsts = [block.pixels[0] for block in known[1:]]
    parts = np.split(pixels, np.searchsorted(pixels, firsts))
    for part, old in zip(parts, known or [None], strict=True):
        if old is not None and len(part) <= 2 * most:
            yield part, old
            continue
        for first in range(0, max(1, len(part)), most):
            yield part[first : first + most], None


def _merged(old: Block, new: Block, count: int) -> Block:
    """Two blocks of ``count`` rays in each pixel as one, pixel by pixel."""
    pixels = np.concatenate((old.pixels, new.pixels))
    order = np.argsort(pixels, kind="stable")
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    start = np.repeat((0, len(old.pixels)), (len(old.ways), len(new.ways)))
    ways = joined(Ways, [old.ways, new.ways])
    pixel, ray = np.divmod(ways.ray, count)
    ways = replace(ways, ray=place[pixel + start] * count + ray)
    lost = np.concatenate((old.lost, new.lost)).reshape(-1, count)[order]
    # Rows of one ray stay side by side, in their order.
    return Block(pixels[order], ways.take(np.argsort(ways.ray, kind="stable")), lost.ravel())
