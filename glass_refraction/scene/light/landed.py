# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the light of a lamp lands that glasses turned aside, and how far it spreads there.

Rays leave each place of a lamp's lattice through a grid of pixels. A ray stands for a cell of four
dimensions, two of the pixel and two of the lamp. Rays through the same interfaces in the cells
beside tell how their places move with each: the cell's light lands as a bell whose axes these are.
So light is smooth where ways run apart and sharp where they meet, with few rays and no noise.
H. Igehy, Tracing Ray Differentials, 1999; L. Schjøth et al., Photon Differentials, 2007.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...optics.vectors import dot, perpendiculars
from ..progress import check
from ..rays.caster import Past
from ..rays.columns import Columns, joined
from ..rays.exits import (
    MARGIN_PX,
    Neighbours,
    PictureRays,
    centre_rays,
    grid,
    neighbours,
)
from ..rays.follow import Follower
from ..rays.hits import Scene, Ways
from ..read.viewpoint import Viewpoint
from .emitters import CELL, Emitter

MOST_SPREAD = 0.5
"""Of the glasses' size: what a cell's light spreads at most."""
ALONE = 3.0
"""Cells over which a way spreads that has none beside it: it comes through a part of a glass that
is narrower than a cell, and that the grid meets here and there."""
STRAIGHT = 0
"""The path of a way that meets no glass."""
BETWEEN = 0.75
"""Of `CELL`: as wide is the bell of a grid's cell where several grids, shifted against each other,
fill each other's gaps. Even light then ripples by 0.5 %, and outlines are sharper by as much."""
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
    """The grids of all places of a lamp side by side: one picture, a `Follower`'s view.

    The lamp's x runs along the picture's y, and its y along x. The faces of a cube follow along y.
    An empty row and column keep grids apart.

    Attributes
    ----------
    each : (width, height) of a grid. side : places along either side of the lattice.
    views : of all grids, row by row. depth : (E,) metres before each where it sees the glasses;
        of a cube's and of a sun's 1. shifts : (S, 2) of each place, in pixels.
    pixels : numbers, rising, of those that may see a glass.
    """

    each: tuple[int, int]
    side: int
    views: list[Viewpoint]
    depth: np.ndarray
    shifts: np.ndarray
    pixels: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture."""
        return self.side * (self.each[0] + 1), len(self.views) // self.side * (self.each[1] + 1)

    @property
    def stamp(self) -> tuple:
        """What its rays depend on."""
        return self.side, *(view.stamp() for view in self.views)

    def places(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of places in the picture (N,): the numbers of their views, and places in these' grids."""
        (column, x), (row, y) = (
            np.divmod(part, size + 1) for part, size in zip((x, y), self.each, strict=True)
        )
        return (row * self.side + column).astype(np.intp), x, y

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World origins and unit directions (N, 3) of the rays through places (N, 2)."""
        number, x, y = self.places(*pixels.T)
        matrix = np.array([view.ray_matrix() for view in self.views]).take(number, axis=0)
        found = matrix[..., 3] + x[:, None] * matrix[..., 0] + y[:, None] * matrix[..., 1]
        if self.views[0].is_parallel:
            return found, np.array([view.forward for view in self.views]).take(number, axis=0)
        found /= np.sqrt(np.einsum("nk,nk->n", found, found))[:, None]
        return np.array([view.eye for view in self.views]).take(number, axis=0), found

    def cells(self) -> np.ndarray:
        """(E, 2, 3): the sides of each grid's pixels, among the glasses, metres."""
        sides = np.array([view.ray_matrix()[:, :2].T for view in self.views])
        return sides * self.depth[:, None, None]

    def by_place(self) -> tuple[np.ndarray, tuple[int, int]]:
        """Numbers (N,) of the pixels, and the size, of a picture where beside each lies the same
        pixel of the next place."""
        width, height = self.each
        y, x = np.divmod(self.pixels, self.size[0])
        eye, x, y = self.places(x, y)
        row, column = np.divmod(eye, self.side)
        face, row = np.divmod(row, self.side)
        faces = len(self.views) // self.side**2
        side = self.side + 1
        number = ((face * height + y) * side + row) * width * side + x * side + column
        return number, (width * side, faces * height * side)


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
    # By parts of a pixel, along x by the place along the lamp's y: together the grids are as fine
    # as one of so many pixels, also where the places move what they light: along x by x.
    steps = (2.0 * np.arange(side) + 1.0) / (2.0 * side) - 0.5
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    faces = list(zip(*emitter.eyes(places, corners, centre, back), strict=True))
    across = faces[0][0].projection
    # Of the faces of a cube some see no glass.
    seen = [[face[0].covered(box, MARGIN_PX) for box in boxes] for face in faces]
    used = sum(any(x1 > x0 and y1 > y0 for x0, y0, x1, y1 in rects) for rects in seen)
    each = rays / (len(places) * max(used, 1))
    width = max(MARGIN_PX, int(np.sqrt(each * across[1, 1] / across[0, 0])))
    height = max(MARGIN_PX, int(each / width))
    # The margin that neighbours and shifts need lies round what the corners take.
    size = np.array((width, height)) + 2 * MARGIN_PX
    around = np.ones(2) if len(faces) > 1 else size / (width, height)
    size = tuple(size.tolist())
    views, rects = [], []
    for number, view in enumerate(view for face in faces for view in face):
        projection, moved = view.projection.copy(), 2.0 * shifts[number % len(places)] / size
        projection[:2] = projection[:2] / around[:, None] - np.outer(moved, projection[3])
        views.append(replace(view, projection=projection, size=size, window=(0, 0, *size)))
        begin = np.array(divmod(number, side))[::-1] * np.add(size, 1)
        rects += [np.tile(begin, 2) + views[-1].covered(box, MARGIN_PX) for box in boxes]
    depth = np.array([np.linalg.norm(centre - view.eye) for view in views])
    if views[0].is_parallel or len(faces) > 1:
        depth = np.ones(len(views))
    found = Grids(views[0].size, side, views, depth, shifts, np.zeros(0, np.intp))
    return replace(found, pixels=grid(rects, found.size))


def follow_light(
    emitter: Emitter, grids: Grids, scene: Scene, follower: Follower, softness: float, reach: float
) -> Landed:
    """Where a lamp's light lands by glasses, and where it would without: that is taken away.

    Parameters
    ----------
    follower : of the grids' rays. softness : by what all bells are wider.
    reach : the glasses' size, metres.
    """
    rays = centre_rays(grids.pixels, follower)
    y, x = np.divmod(grids.pixels, grids.size[0])
    origins, directions = grids.rays(np.stack((x, y), axis=1) + 0.5)
    rays = _with_straight(rays, origins, directions, follower.caster)
    beside = replace(rays, pixel=grids.by_place()[0])
    sides = neighbours(rays, grids.size), neighbours(beside, grids.by_place()[1])
    number, _, _ = grids.places(x, y)
    cells = grids.cells()
    share = np.linalg.norm(np.cross(cells[:, 0], cells[:, 1]), axis=1)[number]
    if not grids.views[0].is_parallel:
        # Steradians of a pixel: farther aside it is smaller.
        ahead = np.array([view.forward for view in grids.views]).take(number, axis=0)
        share *= np.einsum("nk,nk->n", directions, ahead) ** 3 / grids.depth[number] ** 2
    share *= emitter.sent(directions) / grids.side**2
    ways = rays.ways
    flux = share[ways.ray]
    number = number[ways.ray]
    shift = grids.shifts.take(number % grids.side**2, axis=0)
    cells = cells.transpose(1, 2, 0)
    # Grids that are shifted against each other fill each other's gaps.
    narrow = 1.0 if grids.side == 1 else BETWEEN
    on = np.flatnonzero(~ways.is_sky & (flux > 0.0))
    origin, direction = map(np.ascontiguousarray, (ways.origin.T, ways.direction.T))
    parts = []
    for some in np.array_split(on, -(-len(on) // BLOCK) or 1):
        check()
        ground = _Ground(ways, origin, direction, some, scene, shift, MOST_SPREAD * reach)
        cell = cells.take(number[some], axis=2)
        moves = ground.moves(sides, cell)
        moves[:2] *= narrow
        bell = _axes(CELL * softness * moves, ground.normal)
        spread, area = (
            np.sqrt(dot(first, first) * dot(second, second)) for first, second in (bell, cell)
        )
        strength = np.abs(ways.weight[some]) * area * (CELL * softness) ** 2
        strength /= np.maximum(spread, LEAST_LENGTH)
        colour = flux[some] * ways.colour.take(some, axis=0).T
        parts.append(Landed(*(a.T for a in (ground.point, ground.normal, colour, *bell)), strength))
    return joined(Landed, parts)


def _with_straight(rays: PictureRays, origins, directions, caster: Past) -> PictureRays:
    """The rays with one more way each that meets a glass: straight on, and its light taken out."""
    ray = np.unique(rays.ways.ray)
    origins, directions = origins.take(ray, axis=0), directions.take(ray, axis=0)
    distance, triangle = caster.cast(origins, directions)
    none = np.zeros(len(ray), np.int16)
    straight = Ways(
        ray.astype(np.int32),
        np.full(len(ray), STRAIGHT, np.int64),
        -np.ones(len(ray)),
        -np.ones((len(ray), 3)),
        origins,
        directions,
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
        hits = scene.hits(ways, on)
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
        direction = self._direction.take(self._on, axis=1)
        along, across = dot(direction, self.normal), dot(vectors, self.normal)
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
            origin, direction = (
                part.take(partner, axis=1) for part in (self._origin, self._direction)
            )
            along, above = dot(direction, self.normal), dot(origin - self.point, self.normal)
            meets = there & (along < -LEAST_SINE) & (above > 0.0)
            way = above / np.where(meets, -along, 1.0)
            apart = origin + way * direction - self.point
            if cells is not None:
                shift = self._shift.take(partner, axis=0) - self._shift.take(self._on, axis=0)
                for move, part in zip(cells, shift.T, strict=True):
                    apart -= part * move
            total += np.where(meets, sign, 0.0) * apart
            count += meets
        return self._limited(np.where(count > 0.0, total / np.maximum(count, 1.0), other))

    def _limited(self, vectors: np.ndarray) -> np.ndarray:
        length = np.sqrt(dot(vectors, vectors))
        return vectors * np.minimum(1.0, self._most / np.maximum(length, LEAST_LENGTH))


def _axes(moves: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (3, K) of the bells that cells with these sides (4, 3, K) make together."""
    first, second = perpendiculars(normal)
    x, y = (np.stack([dot(move, axis) for move in moves]) for axis in (first, second))
    (long, short), turn = ellipse((x * x).sum(axis=0), (x * y).sum(axis=0), (y * y).sum(axis=0))
    cosine, sine = np.cos(turn), np.sin(turn)
    return long * (cosine * first + sine * second), short * (cosine * second - sine * first)


def ellipse(xx, xy, yy):
    """Half axes and the longer one's angle (K,) of the ellipse of a covariance."""
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    longer = np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0))
    return longer, 0.5 * np.arctan2(2.0 * xy, xx - yy)
