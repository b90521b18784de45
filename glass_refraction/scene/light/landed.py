# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the light of a lamp lands that glasses turned aside, and how far it spreads there.

Rays leave each place of a lamp's lattice through a grid of pixels. A ray stands for a cell of four
dimensions, two of the pixel and two of the lamp. Rays through the same interfaces in the cells
beside tell how their places move with each: the cell's light lands as a bell whose axes these are.
So light is smooth where ways run apart and sharp where they meet, with few rays and no noise.
H. Igehy, Tracing Ray Differentials, 1999; L. Schjøth et al., Photon Differentials, 2007.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..progress import check
from ..rays.caster import Caster
from ..rays.columns import Columns, joined
from ..rays.exits import (
    MARGIN_PX,
    Neighbours,
    PictureRays,
    centre_rays,
    grid,
    neighbours,
    pixel_rect,
    together,
)
from ..rays.follow import Follower, Kept
from ..rays.hits import Scene, Ways
from ..read.viewpoint import Viewpoint
from .emitters import CELL, Emitter, Eye

STEPS = 0.7548776662466927, 0.5698402909980532
"""By which the grids of a lamp's places are shifted, one after another: of all sequences the one
that fills a square most evenly (M. Roberts, The Unreasonable Effectiveness of Quasirandom
Sequences, 2018)."""
MOST_SPREAD = 0.5
"""Of the glasses' size: what a cell's light spreads at most."""
ALONE = 3.0
"""Cells over which a way spreads that has none beside it: it comes through a part of a glass that
is narrower than a cell, and that the grid meets here and there."""
STRAIGHT = 0
"""The path of a way that meets no glass."""
LEAST_SINE = 1e-3
"""Of rays to a surface, below which they are taken not to meet it."""
LEAST_LENGTH = 1e-300
"""Metres: keeps a quotient finite."""
BLOCK = 16_384
"""Ways that are looked at together: their arrays stay in a core's cache."""


@dataclass(frozen=True, eq=False)
class Landed(Columns):
    """Light on surfaces, each row a bell.

    Attributes
    ----------
    point, normal : (K, 3) world; the unit normal is on the side that the light comes from.
    flux : (K, 3) W by colour, over the lamp's power; below 0 where it is taken away.
    major, minor : (K, 3) axes of the bell in the surface, one standard deviation long, metres.
    strength : (K,) its light where it lands over the lamp's among the glasses, about.
    """

    point: np.ndarray
    normal: np.ndarray
    flux: np.ndarray
    major: np.ndarray
    minor: np.ndarray
    strength: np.ndarray


@dataclass(frozen=True, eq=False)
class Grids:
    """The pixels of all places of a lamp that see a glass.

    Attributes
    ----------
    size : (width, height) of each. side : places along either side of the lattice.
    eyes : of each place, one or the faces of a cube. views : the same with their pixels.
    pixels : of each of these, numbers, rising.
    shifts : (S, 2) of each place, in pixels.
    """

    size: tuple[int, int]
    side: int
    eyes: list[list[Eye]]
    views: list[list[Viewpoint]]
    pixels: list[list[np.ndarray]]
    shifts: np.ndarray


def grids(emitter: Emitter, boxes: list[np.ndarray], rays: int, back: float) -> Grids:
    """The pixels through which a lamp's light is followed.

    Parameters
    ----------
    boxes : corners (8, 3) of each glass's box. rays : about how many in all.
    back : metres before the glasses that a sun's rays begin.
    """
    corners = np.concatenate(boxes)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    side = emitter.side(centre)
    places = emitter.places(emitter.lattice(side), centre)
    shifts = (np.arange(len(places))[:, None] * np.array(STEPS)) % 1.0 - 0.5
    eyes = emitter.eyes(places, corners, centre, back)
    wide, high = np.ptp(eyes[0][0].frame, axis=0)
    # Of the faces of a cube some see no glass.
    used = sum(any(sees(eye, box) for box in boxes) for eye in eyes[0])
    each = rays / (len(places) * max(used, 1))
    width = max(MARGIN_PX, int(np.sqrt(each * wide / high)))
    height = max(MARGIN_PX, int(each / width))
    # The margin that neighbours and shifts need lies round what the corners take.
    size = width + 2 * MARGIN_PX, height + 2 * MARGIN_PX
    around = 1.0 + 2.0 * MARGIN_PX / np.array((width, height))
    views, pixels = [], []
    for number, faces in enumerate(eyes):
        if len(faces) == 1:
            middle = faces[0].frame.mean(axis=0)
            faces[0] = replace(faces[0], frame=middle + (faces[0].frame - middle) * around)
        views.append([eye.seeing(size, shifts[number]) for eye in faces])
        rects = [[pixel_rect(view, box) for box in boxes] for view in views[-1]]
        pixels.append([grid(rect, size) for rect in rects])
    return Grids(size, side, eyes, views, pixels, shifts)


def sees(eye: Eye, corners: np.ndarray) -> bool:
    """Whether a box with these corners may be in an eye's frame."""
    x0, y0, x1, y1 = pixel_rect(eye.seeing((1, 1), np.zeros(2)), corners)
    return x1 > x0 and y1 > y0


def follow_light(
    emitter: Emitter,
    grids: Grids,
    scene: Scene,
    follower_of: Callable[[Viewpoint, Kept], Follower],
    kept: dict[int, Kept],
    softness: float,
    reach: float,
) -> Landed:
    """Where a lamp's light lands by glasses, and where it would without: that is taken away.

    Parameters
    ----------
    follower_of : follows rays of a view. kept : what earlier frames found, by view.
    softness : by what all bells are wider. reach : the glasses' size, metres.
    """
    width, height = grids.size
    side, faces = grids.side, len(grids.views[0])
    parts, shares, by_pixel, by_place, cells = [], [], [], [], []
    for place, views in enumerate(grids.views):
        a, b = divmod(place, side)
        for face, view in enumerate(views):
            known = kept.setdefault(place * faces + face, Kept())
            follower = follower_of(view, known)
            rays = centre_rays(grids.pixels[place][face], follower)
            v, u = np.divmod(rays.pixel, width)
            origins, directions = map(np.array, view.rays(u + 0.5, v + 0.5))
            parts.append(_with_straight(rays, origins, directions, follower.caster))
            eye = grids.eyes[place][face]
            share = eye.share(grids.size, directions) / len(grids.views)
            shares.append(share * emitter.sent(directions))
            cells.append(eye.cell(grids.size))
            # Beside a pixel lies the next one of the same place, or the same one of the next place;
            # an empty row and column keep others apart.
            row, column = (face * side + b) * (height + 1) + v, a * (width + 1) + u
            by_pixel.append(row * side * (width + 1) + column)
            row, column = (face * height + v) * (side + 1) + b, u * (side + 1) + a
            by_place.append(row * width * (side + 1) + column)
    rays = together(parts)
    number = np.repeat(np.arange(len(parts)), [len(part.pixel) for part in parts])
    sizes = (
        (side * (width + 1), faces * side * (height + 1)),
        (width * (side + 1), faces * height * (side + 1)),
    )
    sides = [
        neighbours(replace(rays, pixel=np.concatenate(pixel)), size)
        for pixel, size in zip((by_pixel, by_place), sizes, strict=True)
    ]
    ways = rays.ways
    flux = np.concatenate(shares)[ways.ray]
    number = number[ways.ray]
    shift = grids.shifts[number // faces]
    on = np.flatnonzero(~ways.is_sky & (flux > 0.0))
    origin, direction = map(np.ascontiguousarray, (ways.origin.T, ways.direction.T))
    parts = []
    for some in np.array_split(on, -(-len(on) // BLOCK) or 1):
        check()
        ground = _Ground(ways, origin, direction, some, scene, shift, MOST_SPREAD * reach)
        cell = np.array(cells).transpose(1, 2, 0)[..., number[some]]
        bell = _axes(CELL * softness * ground.moves(sides, cell), ground.normal)
        spread, area = (
            np.sqrt(_dot(first, first) * _dot(second, second)) for first, second in (bell, cell)
        )
        strength = np.abs(ways.weight[some]) * area * (CELL * softness) ** 2
        strength /= np.maximum(spread, LEAST_LENGTH)
        colour = flux[some] * ways.colour[some].T
        parts.append(Landed(*(a.T for a in (ground.point, ground.normal, colour, *bell)), strength))
    return joined(Landed, parts)


def _with_straight(rays: PictureRays, origins, directions, caster: Caster) -> PictureRays:
    """The rays with one more way each that meets a glass: straight on, and its light taken out."""
    ray = np.unique(rays.ways.ray)
    distance, triangle = caster.cast(origins[ray], directions[ray])
    none = np.zeros(len(ray), np.int16)
    straight = Ways(
        ray.astype(np.int32),
        np.full(len(ray), STRAIGHT, np.int64),
        -np.ones(len(ray)),
        -np.ones((len(ray), 3)),
        origins[ray],
        directions[ray],
        distance,
        triangle.astype(np.int32),
        none,
        none > 0,
    )
    return replace(rays, ways=joined(Ways, (rays.ways, straight)))


class _Ground:
    """Where some ways land, and where those beside them would land in the same plane.

    Components come first here: NumPy is slow on rows of three.

    Parameters
    ----------
    ways : all. origin, direction : (3, W) theirs. on : (K,) numbers of some ways that land.
    shift : (W, 2) of each way's grid, pixels. most : metres.
    """

    def __init__(self, ways: Ways, origin, direction, on, scene: Scene, shift, most: float) -> None:
        self._origin, self._direction = origin, direction
        self._on, self._shift, self._most = on, shift, most
        hits = scene.hits(ways.take(on))
        self.point = np.ascontiguousarray(hits.point.T)
        self.normal = np.ascontiguousarray(-hits.normal.T * hits.side)

    def moves(self, sides: Sequence[Neighbours], cell: np.ndarray) -> np.ndarray:
        """(4, 3, K) how far places move along the sides of their cells of four dimensions.

        Parameters
        ----------
        sides : the ways beside along a grid, and along the lamp. cell : (2, 3, K) sides of pixels.
        """
        by_pixel, by_place = sides
        partners = (*by_pixel.ahead, *by_pixel.behind)
        alone = np.all([partner[self._on] < 0 for partner in partners], axis=0)
        # A way that has none beside it spreads as though nothing turned its rays.
        plain = [self._shadow(np.where(alone, ALONE, 1.0) * vectors) for vectors in cell]
        found = [self._moved(by_pixel, axis, plain[axis]) for axis in (0, 1)]
        none = np.zeros_like(self.point)
        return np.array([*found, *(self._moved(by_place, axis, none, found) for axis in (0, 1))])

    def _shadow(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (3, K) as the ways cast them on their planes."""
        direction = self._direction[:, self._on]
        along, across = _dot(direction, self.normal), _dot(vectors, self.normal)
        return self._limited(vectors - direction * (across / np.minimum(along, -LEAST_SINE)))

    def _moved(self, sides: Neighbours, axis: int, other: np.ndarray, cells=None) -> np.ndarray:
        """(3, K) how far places move from a cell to the next; ``other`` where there is none.

        ``cells``: the same for both axes of a grid, where the cells beside are of other grids.
        """
        total, count = np.zeros_like(self.point), np.zeros(len(self._on))
        for sign, partners in ((1.0, sides.ahead[axis]), (-1.0, sides.behind[axis])):
            partner = partners[self._on]
            there = partner >= 0
            partner = np.where(there, partner, self._on)
            origin, direction = self._origin[:, partner], self._direction[:, partner]
            along, above = _dot(direction, self.normal), _dot(origin - self.point, self.normal)
            meets = there & (along < -LEAST_SINE) & (above > 0.0)
            way = above / np.where(meets, -along, 1.0)
            apart = origin + way * direction - self.point
            if cells is not None:
                shift = self._shift[partner] - self._shift[self._on]
                for move, part in zip(cells, shift.T, strict=True):
                    apart -= part * move
            total += np.where(meets, sign, 0.0) * apart
            count += meets
        return self._limited(np.where(count > 0.0, total / np.maximum(count, 1.0), other))

    def _limited(self, vectors: np.ndarray) -> np.ndarray:
        length = np.sqrt(_dot(vectors, vectors))
        return vectors * np.minimum(1.0, self._most / np.maximum(length, LEAST_LENGTH))


def _axes(moves: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, K) of the bells that cells with these sides (4, 3, K) make together."""
    first = np.cross(normal.T, np.eye(3)[np.abs(normal).argmin(axis=0)]).T
    first /= np.maximum(np.sqrt(_dot(first, first)), LEAST_LENGTH)
    second = np.cross(normal.T, first.T).T
    x, y = (np.stack([_dot(move, axis) for move in moves]) for axis in (first, second))
    (long, short), turn = ellipse((x * x).sum(axis=0), (x * y).sum(axis=0), (y * y).sum(axis=0))
    cosine, sine = np.cos(turn), np.sin(turn)
    return long * (cosine * first + sine * second), short * (cosine * second - sine * first)


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def ellipse(xx, xy, yy):
    """Half axes and the longer one's angle (K,) of the ellipse of a covariance."""
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    longer = np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0))
    return longer, 0.5 * np.arctan2(2.0 * xy, xx - yy)
