# SPDX-License-Identifier: GPL-3.0-or-later
"""The glasses of a scene as one array of floats, which the shader reads.

A shader needs what ``optics`` describes a bounded glass by: its interfaces (a surface, the media in
front of it and behind it) and its media. This module writes them down in the order that
:mod:`glsl` reads them in. It needs neither Blender nor a GPU.

Lengths are single precision there. Each glass is therefore written in its own frame and its own
unit (`BoundedGlass.scale`), and all share a frame near them, the *common frame*: its origin is the
middle of the glasses and its unit the largest of theirs, so that numbers stay near 1 wherever the
glasses stand in the world and however small they are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from ..optics.axial import SOLID, AxialGlass, BoundedGlass
from ..optics.bodies import Prism
from ..optics.profiles import Profile
from ..optics.surfaces import Cylinder, Lid, Outline, Plane, Shell, Side
from .trees import MeshBody, Tree

ROWS = 4096
"""Rows of four floats in the block: 64 KiB, the most that every driver takes."""

CYLINDER, PLANE, LID, SIDE, SHELL, PROFILE, MESH = range(7)

GLASS_ROWS = 12
INTERFACE_ROWS = 3
MEDIUM_ROWS = 2
THING_ROWS = 3
CHORD_ROWS = 2
CUBIC_ROWS = 2
BUNCH, SIDE_BUNCH = 8, 8
"""Chords of a profile that share a box, and sides of an outline that share a circle: rays are
tested against these first."""

BOX_MARGIN = 1e-3
"""By how much a glass's box is wider on each side, as part of its ball: rounding, and flat ones."""

LEAST_SLOPE = 1e-5
"""Rise of a chord by its length that stands for a level one's 0: the shader divides by it."""

ENDLESS, HOLLOW, HOLDS = 1, 2, 4
"""Flags of a medium: rays that meet nothing in it have left; things may stand in it; it holds where
glasses overlap (see `optics.placed.Media`)."""

UNKNOWN_BOXES = -1.0
"""Stands for the number of all things' boxes where things may be outside of them, too."""

DEEPEST = 4
"""Glasses that a ray may be in at once."""


class TooMuch(ValueError):
    """The glasses do not fit into the shader's block."""


@dataclass(frozen=True)
class Posed:
    """A glass where it stands.

    Attributes
    ----------
    body : the bounded glass, in its own frame, metres.
    to_world : (4, 4) float64, rigid.
    absorption : (red, green, blue) of every medium, per metre.
    things : (4, 4) each: from the world to a frame in which the box of a thing that may stand in
        the glass's hollow runs from -1 to 1.
    capture : number of the capture in which its rays look up what the view does not show, or -1.
    outer : the medium of the glass that the eye is in.
    priority : where glasses overlap, the one of the highest is there.
    """

    body: BoundedGlass
    to_world: np.ndarray
    absorption: tuple[tuple[float, float, float], ...] = ()
    things: tuple[np.ndarray, ...] = ()
    capture: int = -1
    outer: int = 0
    priority: int = 0

    def middle(self) -> np.ndarray:
        """(3,) world place of the middle of its box."""
        return self.to_world[:3, :3] @ self.body.box.mean(axis=0) + self.to_world[:3, 3]

    def corners(self) -> np.ndarray:
        """(8, 3) of its box, in the world."""
        low, high = self.body.box
        local = np.where(np.array(list(product((False, True), repeat=3))), high, low)
        return local @ self.to_world[:3, :3].T + self.to_world[:3, 3]

    def reach(self) -> float:
        """Radius in metres of a ball round :meth:`middle` that holds it all."""
        low, high = self.body.box
        return 0.5 * float(np.linalg.norm(high - low))


@dataclass(frozen=True)
class Frame:
    """The common frame: world = origin + unit · common. `reach`: a ball of it holds all glasses."""

    origin: np.ndarray
    unit: float
    reach: float

    def to_world(self) -> np.ndarray:
        """(4, 4) float64."""
        matrix = np.diag([self.unit, self.unit, self.unit, 1.0])
        matrix[:3, 3] = self.origin
        return matrix

    def place(self, world: np.ndarray) -> np.ndarray:
        """World places (..., 3) in the common frame."""
        return (np.asarray(world, float) - self.origin) / self.unit


def common_frame(glasses: Sequence[Posed]) -> Frame:
    """The frame that all glasses share, from their boxes."""
    middles = np.array([glass.middle() for glass in glasses])
    unit = max(glass.body.scale for glass in glasses)
    low = np.min([m - g.reach() for m, g in zip(middles, glasses, strict=True)], axis=0)
    high = np.max([m + g.reach() for m, g in zip(middles, glasses, strict=True)], axis=0)
    origin = 0.5 * (low + high)
    away = [np.linalg.norm(m - origin) + g.reach() for m, g in zip(middles, glasses, strict=True)]
    return Frame(origin, unit, float(max(away)) / unit)


def pack(
    glasses: Sequence[Posed], frame: Frame, boxes: Sequence[np.ndarray] | None = None
) -> np.ndarray:
    """The block that describes glasses to the shader: (ROWS, 4) float32.

    Parameters
    ----------
    boxes : (4, 4) each: from the world to a frame in which the box of a thing runs from -1 to 1;
        outside of them nothing is. None: anything may be anywhere.

    Raises
    ------
    TooMuch
        They do not fit.
    """
    head = 1 + GLASS_ROWS * len(glasses)
    rows = [np.zeros((head, 4))]
    surroundings = {glass.body.media[0] for glass in glasses if not _is_mesh(glass.body)}
    around = min(surroundings, default=1.0)
    rows[0][0] = len(glasses), around, 0.0, UNKNOWN_BOXES
    starts = starts_of(trees_of(glasses))
    used = head
    for number, glass in enumerate(glasses):
        table = _mesh_table(glass.body, starts) if _is_mesh(glass.body) else _table(glass.body)
        interfaces = table.interfaces.copy()
        # What a record points to is counted from the table's own begin.
        for row, column in table.pointers:
            interfaces[row, column] += used
        media = _media(glass, around)
        things = [_thing(matrix, frame) for matrix in glass.things]
        total = used + len(interfaces) + len(media) + THING_ROWS * len(things)
        if total > ROWS:
            raise TooMuch(f"the first {number} glasses fill the shader's {ROWS} rows")
        rows += [interfaces, media, *things]
        record = rows[0][1 + GLASS_ROWS * number :][:GLASS_ROWS]
        first = used + len(interfaces)
        record[0] = used, table.count, first, len(things)
        low, high = glass.body.box / glass.body.scale
        record[1] = *(0.5 * (low + high)), 0.5 * np.linalg.norm(high - low)
        inward, outward = _poses(glass, frame)
        record[2:5], record[5:8] = inward, outward
        record[8] = glass.body.scale / frame.unit, glass.capture, glass.outer, first + len(media)
        reflected = glass.body.reflected if _is_mesh(glass.body) else (1.0, 1.0, 1.0)
        record[9] = glass.priority, *reflected
        record[10, :3] = 0.5 * (high - low) + BOX_MARGIN * record[1, 3]
        record[11, :3] = outward[:, :3] @ record[1, :3] + outward[:, 3]
        record[11, 3] = (record[8, 0] * np.linalg.norm(record[10, :3])) ** 2
        used = total
    if boxes is not None and used + THING_ROWS * len(boxes) <= ROWS:
        rows[0][0, 2:] = used, len(boxes)
        rows += [_thing(matrix, frame) for matrix in boxes]
        used += THING_ROWS * len(boxes)
    block = np.zeros((ROWS, 4), np.float32)
    block[:used] = np.concatenate(rows)
    return block


def _poses(glass: Posed, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """(3, 4) each: from the common frame to the glass's and back."""
    rotation, scale = glass.to_world[:3, :3], glass.body.scale
    shift = (glass.to_world[:3, 3] - frame.origin) / frame.unit
    factor = scale / frame.unit
    inward = np.column_stack((rotation.T / factor, -rotation.T @ shift / factor))
    outward = np.column_stack((rotation * factor, shift))
    return inward, outward


def _thing(to_box: np.ndarray, frame: Frame) -> np.ndarray:
    """(3, 4): from the common frame to that of a thing's box."""
    return (to_box @ frame.to_world())[:3]


def _media(glass: Posed, around: float) -> np.ndarray:
    """Two rows a medium: ior and flags; absorption by the glass's unit of length.

    ``around``: the ior where no glass is.
    """
    body = glass.body
    rows = np.zeros((MEDIUM_ROWS * len(body.media), 4))
    hollow = _hollow(body)
    for number, ior in enumerate(body.media):
        taken = np.zeros(3)
        if number < len(glass.absorption):
            taken = np.array(glass.absorption[number]) * body.scale
        # A cavity of the surroundings' medium is outside its glass: what overlaps it fills it.
        holds = number == SOLID or (number > 0 and (ior != around or taken.any()))
        flags = ENDLESS * (number in body.endless) + HOLLOW * (number in hollow) + HOLDS * holds
        rows[2 * number] = ior, flags, 0.0, 0.0
        rows[2 * number + 1, :3] = taken
    return rows


def _hollow(body: BoundedGlass) -> set[int]:
    """The media that things may stand in: those around a glass, and what it contains."""
    outside = set(body.endless)
    if _is_mesh(body):
        # Water is a mesh as any.
        return {0, SOLID}
    if isinstance(body, Prism):
        return outside
    if isinstance(body, AxialGlass) and hasattr(body, "glass"):
        count = len(body.glass.radius)
        return outside | ({count} if count > 1 else set())
    return outside | {2}


@dataclass(frozen=True)
class _Table:
    """Interfaces of a body as rows; `pointers`: (row, column) of numbers that count rows."""

    interfaces: np.ndarray
    count: int
    pointers: tuple[tuple[int, int], ...]


def _is_mesh(body: BoundedGlass) -> bool:
    return isinstance(body, MeshBody)


def trees_of(glasses: Sequence[Posed]) -> tuple[Tree, ...]:
    """The trees of the glasses that are meshes, each once, in the order of their texels."""
    trees = (glass.body.tree for glass in glasses if _is_mesh(glass.body))
    return tuple({id(tree): tree for tree in trees}.values())


def starts_of(trees: Sequence[Tree]) -> dict[int, int]:
    """Where the texels of each tree begin, by its id, if one is written after the other."""
    ends = np.cumsum([0, *(len(tree.texels) for tree in trees)])
    return {id(tree): int(start) for tree, start in zip(trees, ends[:-1], strict=True)}


def _mesh_table(body: MeshBody, starts: dict[int, int]) -> _Table:
    """The surface of a mesh: where its tree is, and what gets through it."""
    rows = np.zeros((INTERFACE_ROWS, 4))
    start = starts[id(body.tree)]
    rows[0] = MESH, 0, SOLID, 0.0
    paint = start + body.tree.paint if body.tree.paint else 0
    rows[1] = start, body.tree.leaves, start + body.tree.triangles, paint
    rows[2] = *body.refracted, body.roughness
    return _Table(rows, 1, ())


@lru_cache(maxsize=64)
def _table(body: BoundedGlass) -> _Table:
    """The interfaces of a body as the shader reads them; kept, since profiles take time."""
    count = len(body.interfaces)
    head = np.zeros((INTERFACE_ROWS * count, 4))
    more: list[np.ndarray] = []
    pointers: list[tuple[int, int]] = []
    used = len(head)

    def add(row: int, column: int, rows: np.ndarray) -> None:
        nonlocal used
        head[row, column] = used
        pointers.append((row, column))
        more.append(rows)
        used += len(rows)

    for number, interface in enumerate(body.interfaces):
        surface, row = interface.surface, INTERFACE_ROWS * number
        kind = _KINDS[type(surface)]
        head[row] = kind, interface.front, interface.back, float(number in body.ends)
        one, two = row + 1, row + 2
        if kind == CYLINDER:
            head[one] = surface.radius, surface.low, surface.high, float(surface.open_below)
        elif kind == LID:
            head[one, 0] = surface.height
            sides = np.array(surface.outline.sides).reshape(-1, 4)
            head[one, 2:] = len(sides), _room_in(surface.outline, body) ** 2
            add(one, 1, sides)
        elif kind == PLANE:
            head[one, :3] = surface.height, surface.inner, surface.outer
        elif kind == SIDE:
            begin, end = np.array(surface.begin), np.array(surface.end)
            length = math.hypot(*(end - begin))
            head[one] = *begin, *((end - begin) / length)
            head[two, :3] = length, surface.fence.low, surface.fence.high
        elif kind == SHELL:
            head[one, 0] = surface.radius
        else:
            head[one] = _finite(surface.low), _finite(surface.high), surface.open_below, 0.0
            bunches, chords = _chords(surface)
            ends = surface.ends[0] + 2 * surface.ends[1]
            head[one, 3] = ends
            head[two, 1] = len(bunches)
            head[two, 3] = surface.count
            add(two, 0, bunches)
            first = used
            more.append(chords)
            used += len(chords)
            # Bunches point to their chords, from the table's begin as the rest does.
            bunches[0::2, 3] += first
            base = int(head[two, 0])
            pointers.extend((base + k, 3) for k in range(0, len(bunches), 2))
            head[two, 1] = len(bunches) // 2
            add(two, 2, _cubics(surface))
    _bunch_sides(head)
    return _Table(np.concatenate([head, *more]), count, tuple(pointers))


def _bunch_sides(head: np.ndarray) -> None:
    """Put down the circle round each `SIDE_BUNCH` sides, the last ones of a body's interfaces.

    It is that round the begin of the middle one of them; the square of its radius is with the first
    one. Sides beyond the last whole bunch have none.
    """
    rows = head.reshape(-1, INTERFACE_ROWS, 4)
    first = len(rows) - np.count_nonzero(rows[:, 0, 0] == SIDE)
    whole = (len(rows) - first) // SIDE_BUNCH * SIDE_BUNCH
    rows = rows[first : first + whole].reshape(-1, SIDE_BUNCH, INTERFACE_ROWS, 4)
    begin = rows[:, :, 1, :2]
    end = begin + rows[:, :, 2, :1] * rows[:, :, 1, 2:]
    middle = begin[:, SIDE_BUNCH // 2, None]
    radius = np.maximum(*(np.linalg.norm(p - middle, axis=2).max(axis=1) for p in (begin, end)))
    rows[:, 0, 2, 3] = (radius + BOX_MARGIN) ** 2


def _room_in(outline: Outline, body: BoundedGlass) -> float:
    """Radius of the circle round the middle of a body's box that lies within its outline; 0: none.

    In units of the body. Rays that stay in it meet no side.
    """
    middle = 0.5 * body.box.sum(axis=0)[:2] / body.scale
    if not outline.holds(*middle):
        return 0.0
    begin, end = np.swapaxes(np.array(outline.sides), 0, 1)
    along = end - begin
    part = np.einsum("nk,nk->n", middle - begin, along) / np.einsum("nk,nk->n", along, along)
    nearest = begin + np.clip(part, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(nearest - middle, axis=1).min())


_KINDS = {
    Cylinder: CYLINDER,
    Plane: PLANE,
    Lid: LID,
    Side: SIDE,
    Shell: SHELL,
    Profile: PROFILE,
}

FAR_HEIGHT = 1e6
"""Stands for an endless height, in units of the glass."""


def _finite(height: float) -> float:
    return float(np.clip(height, -FAR_HEIGHT, FAR_HEIGHT))


def _chords(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Bunches (2 rows each: heights, radius, first chord; how many) and chords (2 rows each)."""
    r0, z0, dr, dz, t0, dt = profile.chords
    length = np.hypot(dr, dz)
    along = dz / length
    along = np.where(np.abs(along) < LEAST_SLOPE, np.copysign(LEAST_SLOPE, along), along)
    chords = np.zeros((CHORD_ROWS * len(r0), 4))
    chords[0::2] = np.stack((r0, z0, dr / length, along), axis=-1)
    chords[1::2, :3] = np.stack((t0, dt, length), axis=-1)
    bunches = []
    for first in range(0, len(r0), BUNCH):
        part = slice(first, first + BUNCH)
        low = np.minimum(z0[part], z0[part] + dz[part]).min()
        high = np.maximum(z0[part], z0[part] + dz[part]).max()
        widest = np.maximum(r0[part], r0[part] + dr[part]).max()
        narrowest = np.minimum(r0[part], r0[part] + dr[part]).min()
        bunches.append((low, high, widest, CHORD_ROWS * first))
        bunches.append((len(r0[part]), narrowest, 0.0, 0.0))
    return np.array(bunches, float), chords


def _cubics(profile: Profile) -> np.ndarray:
    """Coefficients of every segment of the curve: a row of radius, a row of height."""
    rows = np.zeros((CUBIC_ROWS * profile.count, 4))
    rows[0::2], rows[1::2] = profile.curve.radius, profile.curve.height
    return rows
