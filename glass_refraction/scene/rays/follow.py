# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows a picture's rays through all glasses, up to the things that they meet at last.

What rays do is kept for the next frame while eye and glasses stay. Where no thing reaches among
the glasses, it is found without looking for any. Else those pixels are followed anew of which a ray
passes where a thing moved. Each ray's ways are the same to the bit whether they were kept or not,
and whichever rays go with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ... import optics
from ...optics.boxes import TOUCHING, grain, near_boxes
from ...optics.vectors import dot
from ..memory import counters
from ..progress import check
from .caster import Caster, Past
from .columns import Columns, joined
from .hits import Ways
from .meshes import GlassMeshes
from .moved import Boxes, Known
from .sketches import Sketches
from .things import Things
from .views import RadianceView

Band = tuple[tuple[float, float, float], list[optics.Placed]]
"""What light of a band brings to the colours, and the glasses as it finds them."""

CONTACT = 1e-5
"""Of the glasses' size: what reaches no deeper among them only touches them."""
FINE = 5.0
"""Where a pixel has many rays, ways must carry so much more of a ray's light: it is a part of the
pixel's. The less so the brighter lamps shine."""
ENOUGH = 0.25
"""Part of the light of a pixel that must be followed to stand for all of it. Where less is, it
stands for four times as much, and the rest is dark."""
TOGETHER, MOST_TOGETHER = 100_000, 1.6
"""About how many rays are followed together, and times that at most. While they are, each takes a
kilobyte and more; fewer would cost time, for each step is a batch of casts."""
ONWARD = 0.1
"""Part of the light of a ray from a thing that its ways must carry: it is a part of the pixel's."""
NEAR = 8.0 * TOUCHING
"""Of the largest coordinate: where float32 keeps places, things so near to a ray may matter."""
MOST_LAMPS = 4
"""One behind the other along a way, of which the light is added."""
SPREAD = np.array((0.7548776662466927, 0.5698402909980532))
"""Steps that fill a square evenly (Roberts, "The unreasonable effectiveness of quasirandom
sequences", 2018): powers of the number whose cube is it and 1, turned over."""
MOST_KEPT = 1_000_000
"""Ways that are kept for the next frame, 0.12 kilobytes each."""


@dataclass(frozen=True, eq=False)
class Passed(Columns):
    """Stretches of rays up to interfaces: (S,) number of the ray, begin and end (S, 2, 3)."""

    ray: np.ndarray
    ends: np.ndarray


class Part(NamedTuple):
    """Pixels (N,), places (P, 2 or 5) of rays in each, the ways of these, and parts (N · P,) of
    their light: what was not followed, and what stays in the glasses."""

    pixels: np.ndarray
    places: np.ndarray
    ways: Ways
    lost: np.ndarray
    dark: np.ndarray


class Block(NamedTuple):
    """Pixels (N,), numbers rising, the ways of as many rays in each, pixel by pixel, and what these
    passed if things matter there.

    ``lost``: (R, 2) parts of each ray's light that are in no way: all, and what of it total
    reflection keeps in the glasses."""

    pixels: np.ndarray
    ways: Ways
    lost: np.ndarray
    passed: Passed

    @property
    def size(self) -> int:
        """How much it holds, in ways; four stretches take as much as one."""
        return len(self.ways) + len(self.passed) // 4

    def rows_of(self, ray: np.ndarray, pixels: np.ndarray, count: int) -> tuple:
        """Which of its rows, of which rays (K,), are of some of its pixels; their rays among these.

        It has ``count`` rays in each pixel.
        """
        if len(pixels) == len(self.pixels):
            return np.arange(len(ray)), ray
        number = np.full(len(self.pixels), -1, np.int32)
        number[np.searchsorted(self.pixels, pixels)] = np.arange(len(pixels))
        pixel, ray = np.divmod(ray, count)
        rows = np.flatnonzero(number[pixel] >= 0)
        return rows, number[pixel[rows]] * count + ray[rows]

    def lost_of(self, pixels: np.ndarray, count: int) -> np.ndarray:
        """The light that is lost of each ray in some of its pixels, as ``lost`` has it."""
        lost = self.lost.reshape(-1, count, 2)
        return lost[np.searchsorted(self.pixels, pixels)].reshape(-1, 2)

    def still(self, boxes: Boxes, number: np.ndarray, margin: float, apart: bool) -> Block:
        """What it has that no thing changed which moved in boxes.

        Where things stay apart from the glasses, ways must be looked at again that pass there; else
        whole pixels must, as soon as one of their rays passes there.

        Parameters
        ----------
        number : (T,) of what rays met before, as it is now.
        margin : metres within which things matter, beside rounding.
        """
        count, passed = len(self.lost) // len(self.pixels), self.passed
        ways = replace(
            self.ways, distance=self.ways.distance.copy(), triangle=self.ways.triangle.copy()
        )
        met = np.flatnonzero(ways.triangle >= 0)
        ways.triangle[met] = number[ways.triangle[met]]
        block = self._replace(ways=ways)
        if not (len(boxes) and len(ways)):
            return block
        largest = np.abs(ways.origin).max()
        margin += NEAR * largest
        # What ends nowhere ends beyond all boxes.
        beyond = 2.0 * (largest + np.abs(boxes.corners()).max())
        way = np.minimum(ways.distance, beyond)
        end = ways.origin + way[:, None] * ways.direction
        again = boxes.touched(margin, ways.origin, end)
        if apart:
            ways.distance[again] = np.nan
            return block
        margin += NEAR * np.abs(passed.ends[:, 0]).max(initial=0.0)
        also = boxes.touched(margin, passed.ends[:, 0], passed.ends[:, 1])
        stale = np.unique(np.concatenate((ways.ray[again], passed.ray[also])) // count)
        pixels = np.delete(self.pixels, stale)
        parts = []
        for part in (ways, passed):
            rows, ray = self.rows_of(part.ray, pixels, count)
            parts.append(replace(part.take(rows), ray=ray))
        return Block(pixels, parts[0], self.lost_of(pixels, count), parts[1])


class _Piece(NamedTuple):
    """Pixels and places of their rays, a block of some of these pixels, None: of none, and all
    others."""

    pixels: np.ndarray
    places: np.ndarray
    old: Block | None
    new: np.ndarray

    @property
    def samples(self) -> np.ndarray:
        """Numbers of a pixel's rays; its centre, alone, is the first of its samples."""
        return np.arange(len(self.places)) + (len(self.places) > 1)


@dataclass
class Kept:
    """What was followed, by the places of its rays in a pixel.

    Attributes
    ----------
    eye : stamp of where rays begin. glasses : stamps of these and of how they are followed.
    known : what rays met.
    parts : least weight and places -> blocks one behind another in the picture.
    sketches : what views showed.
    """

    eye: tuple = ()
    glasses: tuple = ()
    known: Known | None = None
    parts: dict[tuple[float, bytes], list[Block]] = field(default_factory=dict)
    sketches: Sketches = field(default_factory=Sketches)

    def match(self, eye: tuple, glasses: tuple, known: Known, margin: float, apart: bool) -> None:
        """Forget what was found for another eye, other glasses and where things moved.

        Parameters
        ----------
        margin : metres within which a thing matters to a ray.
        apart : whether things stay apart from the glasses.
        """
        old, self.known = self.known, known
        glasses = (*glasses, apart)
        if eye != self.eye:
            # All views are others then.
            self.sketches.now.clear()
        if (eye, glasses) != (self.eye, self.glasses):
            self.eye, self.glasses = eye, glasses
            self.parts.clear()
        if not (self.parts or self.sketches.now):
            self.sketches.last.clear()
            return
        boxes, number = old.moved_to(known)
        self.sketches.next_frame(boxes, number, margin)
        for key, blocks in self.parts.items():
            left = (block.still(boxes, number, margin, apart) for block in blocks)
            self.parts[key] = [block for block in left if len(block.pixels)]

    @property
    def size(self) -> int:
        """How much is kept, in ways."""
        return sum(block.size for blocks in self.parts.values() for block in blocks)


@dataclass
class Follower:
    """Follows rays of one frame.

    Attributes
    ----------
    view : the direct one, or a lamp's `Grids`. bands : glasses in light of each band.
    caster : of what light meets that leaves the glasses. eyes : of what rays from the eye meet.
    things : all these. boxes : (B, 2, 3) round them.
    hull : (2, 3) a box round all glasses. stamp : of the glasses and of how they are followed.
    meshes : the glasses that are meshes.
    min_weight, fresnel : see :class:`stage.FrameInput`. kept : what earlier frames found.
    brightest : light of what shines most, over that of a white pixel; 1 at least.
    through : (T,) bool, which triangles are seen through the glasses; None: all.
    shots : where a moving camera is while the shutter is open, at even intervals; none: it rests.
    """

    view: RadianceView
    bands: Sequence[Band]
    caster: Caster | Past
    eyes: Caster | Past
    meshes: GlassMeshes
    things: Things
    boxes: np.ndarray
    hull: np.ndarray
    stamp: tuple
    min_weight: float
    fresnel: bool
    kept: Kept
    brightest: float = 1.0
    through: np.ndarray | None = None
    shots: tuple[RadianceView, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.hull
        self._skin = CONTACT * float(np.linalg.norm(high - low))
        inside = (self.boxes[:, 0] < high - self._skin) & (self.boxes[:, 1] > low + self._skin)
        self._apart = not inside.all(axis=1).any()
        # Where things reach among the glasses, rays depend on how exactly they are met.
        accuracy = 0.0 if self._apart else grain(self.boxes)
        self.kept.match(
            self.view.stamp,
            (*self.stamp, accuracy),
            Known(self.things, self.through),
            2.0 * self._skin + 4.0 * accuracy,
            self._apart,
        )
        through = self.through
        self._beyond = (
            self.caster
            if through is None
            else Past(self.caster, lambda met: through[met.triangle], self._skin)
        )
        self._is_lamp = np.array([look.is_lamp for look in self.things.looks], bool)
        placed = [glass for _, glasses in self.bands for glass in glasses]
        self.rough = any(glass.roughness for glass in placed)
        self.only_meshes = all(glass.is_mesh for glass in placed)

    @property
    def fine_weight(self) -> float:
        """Part of a ray's light that its ways must carry where a pixel has many rays."""
        # The facets of rough glasses share out the light: of each way there are many.
        return self.min_weight * (1.0 if self.rough else max(1.0, FINE / self.brightest))

    def blocks(
        self, sets: Sequence[tuple[np.ndarray, np.ndarray]], settled: np.ndarray | None = None
    ) -> Iterator[Part]:
        """Ways of rays through places (P, 2), from its centre, of each pixel (N,), numbers rising.

        Places (P, 5) tell where in the lens as well, in a square of 1, and when while the shutter
        is open, from 0 to 1. Both are shifted from pixel to pixel: what few rays miss is noise
        then, finer than any pattern.

        Rays that meet no glass first have no way. All sets are followed together: rays end after
        many steps, and a step of few rays takes hardly less time than one of some more.

        Parameters
        ----------
        sets : pixels and their places, other places in each; of each at least one part is yielded.
        settled : sorted `way_codes` of ways that are known and left out here; ways that carry less
            than `fine_weight` are not followed then. None: all are followed.
        """
        least = self.min_weight if settled is None else self.fine_weight
        kept: dict[tuple[float, bytes], list[Block]] = {}
        pieces: list[_Piece] = []
        for pixels, places in sets:
            known = self.kept.parts.pop((least, places.tobytes()), [])
            pieces += _pieces(pixels, places, known)
        room = MOST_KEPT - self.kept.size
        for some in _gathered(pieces):
            for piece, whole in zip(some, self._whole(some, least, room > 0), strict=True):
                room -= whole.size
                if len(whole.pixels) and room >= 0:
                    kept.setdefault((least, piece.places.tobytes()), []).append(whole)
                yield self._part(piece, whole, settled)
        self.kept.parts.update(kept)

    def _part(self, piece: _Piece, whole: Block, settled: np.ndarray | None) -> Part:
        """What a piece's rays bring, of a block that has them all."""
        pixels, places = piece.pixels, piece.places
        rows, ray = whole.rows_of(whole.ways.ray, pixels, len(places))
        lost = whole.lost_of(pixels, len(places))
        if self._apart:
            met = lost[:, 0] > 0.0
            met[ray] = True
            seen = self._unhidden(met, pixels, places)
            rows, ray, lost = rows[seen[ray]], ray[seen[ray]], lost * seen[:, None]
        lost, dark = lost[:, 0] - lost[:, 1], lost[:, 1]
        some = unsettled(whole.ways, rows, ray, lost, pixels, settled)
        if self._apart:
            self._end(whole.ways, rows[some])
        ways = replace(whole.ways.take(rows[some]), ray=ray[some])
        return Part(pixels, places, self._past_lamps(ways), lost, dark)

    def _rays(self, pixels: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = self.view.size[0]
        pixel = np.repeat(pixels, len(places))
        offset = np.tile(places, (len(pixels), 1))
        x, y = pixel % width, pixel // width
        place = np.stack((x, y), axis=1) + 0.5 + offset[:, :2]
        if places.shape[1] == 2:
            origins, directions = self.view.rays(place)
            return origins, np.array(directions)
        shift = x[:, None] * SPREAD + y[:, None] * SPREAD[::-1]
        unit, shots = (offset[:, 2:4] + shift) % 1.0, self.shots or (self.view,)
        time = offset[:, 4] + (shift.sum(axis=1) % 1.0 - 0.5) / len(places)
        shot = np.clip((time * len(shots)).astype(int), 0, len(shots) - 1)
        origins, directions = np.empty((2, len(place), 3))
        for number in np.unique(shot):
            rows = np.flatnonzero(shot == number)
            origins[rows], directions[rows] = shots[number].lens_rays(place[rows], unit[rows])
        return origins, directions

    def _traced(self, pieces: Sequence[_Piece], least: float, keep: bool) -> list[Block]:
        """What the new rays of pieces do, up to the things that they meet if these reach among the
        glasses."""
        things = not self._apart
        rays = [self._rays(piece.new, piece.places) for piece in pieces]
        origins, directions = map(np.concatenate, zip(*rays, strict=True))
        counters["exit_rays"] += len(origins)
        parts, passed, lost = [], [], np.zeros((len(origins), 2))
        pixel = [np.repeat(piece.new, len(piece.places)) for piece in pieces]
        sample = [np.tile(piece.samples, len(piece.new)) for piece in pieces]
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
                pixel=np.concatenate(pixel),
                sample=np.concatenate(sample),
                between=check,
                stretches=keep and things,
            )
            check()
            passed.append(Passed(ends.passed_ray, ends.passed))
            met = np.flatnonzero(ends.events > 0)
            # Apart from the glasses, things are looked for where it is needed.
            distance = ends.distance[met] if things else np.full(len(met), np.nan)
            lost += np.stack((ends.lost, ends.stuck), axis=1) * np.mean(colour)
            parts.append(_exit_ways(ends, met, distance, number, colour))
        # What there is of one band only is large enough not to be copied.
        ways, passed = (
            some[0] if len(some) == 1 else joined(kind, some)
            for kind, some in ((Ways, parts), (Passed, passed))
        )
        if len(pieces) == 1:
            return [Block(pieces[0].new, ways, lost, passed)]
        ends = np.cumsum([len(part) for part in pixel])
        ways, passed = (_shared_out(part, ends) for part in (ways, passed))
        new = (piece.new for piece in pieces)
        return list(map(Block, new, ways, np.split(lost, ends[:-1]), passed))

    def onward(self, origins: np.ndarray, directions: np.ndarray) -> Ways:
        """Ways of rays (M, 3) from a thing to what they meet, through glasses or beside them.

        Only ways with much of a ray's light are followed; they stand for the others.
        """
        # A rough glass's facets are those of the place, whichever rays go along.
        places = np.ascontiguousarray(origins[:, 0]).view(np.int64)
        parts = []
        for number, (colour, placed) in enumerate(self.bands):
            ends = optics.exit_rays(
                placed,
                origins,
                directions,
                min_weight=ONWARD,
                cast=self._beyond.cast,
                things=self.boxes,
                meet=self.meshes.meet if self.meshes else None,
                fresnel=self.fresnel,
                pixel=places,
                between=check,
            )
            ways = _exit_ways(ends, np.arange(len(ends.ray)), ends.distance, number, colour)
            parts.append(ways.scaled(1.0 / np.maximum(1.0 - ends.lost, ENOUGH)[ways.ray]))
        return joined(Ways, parts)

    def _whole(self, pieces: Sequence[_Piece], least: float, keep: bool) -> list[Block]:
        """Of each piece an old block and what rays do in those pixels that it has not.

        ``keep``: the next frame may need it.
        """
        lacking = [piece for piece in pieces if piece.old is None or len(piece.new)]
        found = iter(self._traced(lacking, least, keep) if lacking else ())
        blocks = []
        for piece in pieces:
            if piece.old is None:
                blocks.append(next(found))
            elif len(piece.new):
                blocks.append(_merged(piece.old, next(found), len(piece.places)))
            else:
                blocks.append(piece.old)
        return blocks

    def _unhidden(self, met: np.ndarray, pixels: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(N · P,) which rays, of those that have met a glass, meet no thing before it."""
        seen = met.copy()
        rays = np.flatnonzero(met)
        if len(rays):
            # They come column by column.
            begin = self._rays(pixels, places)
            origins, directions = (part.T.take(rays, axis=1).T for part in begin)
            directions = _unit(directions)
            entry, _ = self._within(origins, directions)
            distance, _ = self._met_first(origins, directions, entry)
            seen[rays] = distance >= entry
        return seen

    def _met_first(
        self, origins: np.ndarray, directions: np.ndarray, way: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Metres (M,) to the things that rays from the eye meet, and their triangles; infinite and
        -1 where there is not even a thing's box within a way (M,)."""
        distance, triangle = np.full(len(way), np.inf), np.full(len(way), -1, np.intp)
        near = np.flatnonzero(near_boxes(self.boxes, origins.T, directions.T, way))
        distance[near], triangle[near] = self.eyes.cast(origins[near], directions[near])
        return distance, triangle

    def before(self, pixels: np.ndarray, places: np.ndarray, rays: np.ndarray) -> Ways:
        """Ways to the things that some rays, of those of `blocks`, meet before a glass.

        Parameters
        ----------
        rays : numbers of rays without light from a glass: a thing is before it, or none is there.
        """
        origins, directions = (part[rays] for part in self._rays(pixels, places))
        directions = _unit(directions)
        _, leave = self._within(origins, directions)
        distance, triangle = self._met_first(origins, directions, leave)
        rows = np.flatnonzero(distance < leave)
        distance, triangle = distance[rows], triangle[rows]
        origins, directions = origins[rows], directions[rows]
        ends = optics.exit_rays(
            self.bands[0][1],
            origins,
            directions,
            most_events=0,
            meet=self.meshes.meet if self.meshes else None,
            between=check,
        )
        found = np.flatnonzero(ends.lost)
        begin = origins[found], directions[found]
        return _straight_ways(rays[rows[found]], *begin, distance[found], triangle[found])

    def beside(self, pixels: np.ndarray, places: np.ndarray, rays: np.ndarray) -> Ways:
        """Ways of some rays that meet no glass first, of those of `blocks`, to what they meet."""
        origins, directions = (part[rays] for part in self._rays(pixels, places))
        directions = _unit(directions)
        met = self._met_first(origins, directions, np.full(len(rays), np.inf))
        return _straight_ways(rays, origins, directions, *met)

    def _past_lamps(self, ways: Ways) -> Ways:
        """The same, and one more way behind each lamp outside the glasses: lamps hide nothing.

        Their light is added to what is behind them, as in Cycles.
        """
        low, high = self.hull
        found, last = [ways], ways
        for number in range(MOST_LAMPS):
            rows = np.flatnonzero(~last.is_sky)
            rows = rows[self._is_lamp[self.things.surface[last.triangle[rows]]]]
            last = last.take(rows)
            outside = ((last.point < low) | (last.point > high)).any(axis=1)
            rows, last = rows[outside], last.take(np.flatnonzero(outside))
            if not len(rows):
                break
            begin = last.point + self._skin * last.direction
            distance, triangle = self._beyond.cast(begin, last.direction)
            path = way_codes(np.full(len(rows), 1 + number), last.path) & ~1 | last.path & 1
            last = replace(
                last,
                path=path,
                origin=begin,
                distance=np.where(triangle < 0, np.inf, distance),
                triangle=triangle.astype(np.int32),
            )
            found.append(last)
        return ways if len(found) == 1 else joined(Ways, found)

    def _end(self, ways: Ways, rows: np.ndarray) -> None:
        """Let some ways end at the things that they meet, if that is not known yet."""
        rows = rows[np.isnan(ways.distance[rows])]
        if len(rows):
            direction = ways.direction.take(rows, axis=0)
            # From a little before: what touches the glass there is seen through a film of air.
            begin = ways.origin.take(rows, axis=0) - self._skin * direction
            distance, triangle = self._beyond.cast(begin, direction)
            ways.distance[rows] = np.maximum(distance - self._skin, 0.0)
            ways.triangle[rows] = triangle

    def _cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What rays meet; those that come from the eye have passed no glass."""
        if self.eyes is self._beyond:
            return self.eyes.cast(origins, directions)
        ahead = dot((origins - self.view.eye).T, self.view.forward) - self.view.near
        first = np.abs(ahead) <= self._skin
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1, np.intp)
        for rows, caster in ((first, self.eyes), (~first, self._beyond)):
            rows = np.flatnonzero(rows)
            if len(rows):
                distance[rows], triangle[rows] = caster.cast(origins[rows], directions[rows])
        return distance, triangle

    def _within(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Metres (M,) at which rays come into the box round all glasses, 0 from within, and leave
        it."""
        along = np.where(np.abs(directions) < 1e-300, 1e-300, directions)
        low, high = self.hull
        begin = (low + self._skin - origins) / along
        end = (high - self._skin - origins) / along
        near, far = np.minimum(begin, end), np.maximum(begin, end)
        return np.maximum(near.max(axis=1), 0.0), far.min(axis=1)


def _straight_ways(
    ray: np.ndarray,
    origin: np.ndarray,
    direction: np.ndarray,
    distance: np.ndarray,
    triangle: np.ndarray,
) -> Ways:
    """Ways of rays (K,) past all glasses, to what they meet: metres (K,) to it, and triangles."""
    count = len(ray)
    return Ways(
        ray.astype(np.int32),
        np.zeros(count, np.int64),
        np.ones(count),
        np.ones((count, 3)),
        origin,
        direction,
        distance,
        triangle.astype(np.int32),
        np.zeros(count, np.int16),
        np.zeros(count, bool),
    )


def _exit_ways(
    ends: optics.ExitRays,
    rows: np.ndarray,
    distance: np.ndarray,
    number: int,
    colour: tuple[float, float, float],
) -> Ways:
    """Some exit rays, by their rows (K,), as ways.

    Parameters
    ----------
    distance : (K,) metres to what they meet. number, colour : of the band of light.
    """
    weight = ends.weight[rows]
    return Ways(
        ends.ray[rows].astype(np.int32),
        ends.path[rows] ^ np.int64(number << 1),
        weight * float(np.mean(colour)),
        weight[:, None] * np.exp(-ends.depth[rows]) * colour,
        ends.origin[rows],
        ends.direction[rows],
        distance,
        ends.thing[rows].astype(np.int32),
        ends.events[rows].astype(np.int16),
        ends.rough[rows],
    )


def way_codes(pixel: np.ndarray, path: np.ndarray) -> np.ndarray:
    """(K,) int64, the same for ways of a pixel through the same interfaces (a hash)."""
    return path ^ (pixel.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)).view(np.int64)


def unsettled(
    ways: Ways,
    rows: np.ndarray,
    ray: np.ndarray,
    lost: np.ndarray,
    pixels: np.ndarray,
    settled: np.ndarray | None,
) -> np.ndarray:
    """Numbers of those ways, of some rows (K,), that are not settled; the others' light is lost.

    Parameters
    ----------
    ray : (K,) their rays, of which there are as many in each pixel (N,).
    lost : of these rays; it is changed. settled : sorted `way_codes`, or None.
    """
    check()
    if settled is None or not len(settled):
        return np.arange(len(rows))
    codes = way_codes(pixels[ray // (len(lost) // max(1, len(pixels)))], ways.path[rows])
    at = np.minimum(np.searchsorted(settled, codes), len(settled) - 1)
    known = settled[at] == codes
    lost += np.bincount(ray[known], ways.weight[rows[known]], len(lost))
    return np.flatnonzero(~known)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _pieces(pixels: np.ndarray, places: np.ndarray, known: list[Block]) -> Iterator[_Piece]:
    """Pixels in pieces, each with the known block that lies where it does.

    Where there is none, or far more pixels than it has, each has about `TOGETHER` rays.
    """
    most = max(1, TOGETHER // len(places))
    firsts = [block.pixels[0] for block in known[1:]]
    parts = np.split(pixels, np.searchsorted(pixels, firsts))
    for part, old in zip(parts, known or [None], strict=True):
        if old is not None and len(part) <= 2 * most:
            yield _Piece(part, places, old, np.setdiff1d(part, old.pixels, assume_unique=True))
            continue
        for some in np.array_split(part, max(1, round(len(part) / most))):
            yield _Piece(some, places, None, some)


def _gathered(pieces: list[_Piece]) -> Iterator[list[_Piece]]:
    """Pieces in groups that are followed together."""
    group, rays = [], 0
    for piece in pieces:
        count = len(piece.new) * len(piece.places)
        if group and rays + count > MOST_TOGETHER * TOGETHER:
            yield group
            group, rays = [], 0
        group.append(piece)
        rays += count
    yield group


def _shared_out(part, ends: np.ndarray) -> list:
    """Rows, the rays' numbers rising, by pieces that end before some rays; each counts its own."""
    begin, first, found = 0, 0, []
    order = np.argsort(part.ray, kind="stable")
    for last, end in zip(np.searchsorted(part.ray, ends, sorter=order), ends, strict=True):
        some = part.take(order[first:last])
        found.append(replace(some, ray=some.ray - np.int32(begin)))
        begin, first = end, last
    return found


def _merged(old: Block, new: Block, count: int) -> Block:
    """Two blocks of ``count`` rays in each pixel as one, pixel by pixel."""
    pixels = np.concatenate((old.pixels, new.pixels))
    order = np.argsort(pixels, kind="stable")
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))

    def merged(kind, first, second):
        start = np.repeat((0, len(old.pixels)), (len(first), len(second)))
        both = joined(kind, [first, second])
        pixel, ray = np.divmod(both.ray, count)
        return replace(both, ray=place[pixel + start] * count + ray)

    ways = merged(Ways, old.ways, new.ways)
    # Rows of one ray stay side by side, in their order.
    ways = ways.take(np.argsort(ways.ray, kind="stable"))
    lost = np.concatenate((old.lost, new.lost)).reshape(-1, count, 2)[order]
    return Block(pixels[order], ways, lost.reshape(-1, 2), merged(Passed, old.passed, new.passed))
