# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of glasses that are meshes, in small triangles: with the normals of bumps, and paint.

A bump moves no surface: points stay on the faces, and normals tilt. Heights are evaluated round
each point (`material_fields`).
"""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np

from ..memory import counters
from .arrays import unit
from .glassy_materials import glassy_materials, material_interface
from .material_fields import Fields, NotReady, frame_of, is_ready, maps_of, painted
from .material_recipe import GENERATED, OBJECT, UV, WORLD, Recipe, Stage, bumps_of, recipes_of
from .mesh_corners import Corners, corners_of
from .paint import FINISH, Paint, paint_on, plain_finish
from .triangles import Triangles

STEP = 1e-4
"""Part of a mesh's size by which places lie apart whose heights tell a slope: single precision
gives a slope to a thousandth of that of bumps as wide as the mesh."""
FLAT = 1e-6
"""Radians: of less than this no bumps are."""
COLOUR_TOLERANCE = 0.02
"""By how much roughness and parts of light there may miss those between an edge's ends."""
COARSE = 1.0 / 48.0
"""Of a mesh's size: longer edges are split whatever lies at their middles."""
TOLERANCE = 0.006
"""Radians by which the normal at the middle of an edge may miss that between its ends. Glass of ior
1.5 turns rays by half of it."""
MOST_TRIANGLES = 160_000
"""Of a bumped or painted mesh."""
TOLD = 0.05
"""Radians: edges of a mesh of so many at which normals miss by more are told of ..."""
FEW = 0.1
"""... if they are more than this part of all: steps of heights are never met."""
MOST_ROUNDS = 24
BLOCK = 40_000
"""Places whose normals are found between two events of a window: a tenth of a second."""
MOST_KEPT = 6 * MOST_TRIANGLES
"""Triangles of such meshes that are kept for the next time: many small ones, or a few large."""


_kept: OrderedDict[bytes, Corners] = OrderedDict()


def _recipe(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[str, Recipe | None]:
    """The name of a glass's material, and how its bumps are made; None: it has none."""
    material = next(iter(glassy_materials(obj)), None)
    if material is None:
        return "", None
    found = bumps_of(material.evaluated_get(depsgraph))
    return material.name_full, found if isinstance(found, Recipe) else None


def bumping(
    obj: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    corners: Corners,
    to_world: np.ndarray,
    pixels: dict[tuple, int],
    paint: Paint | None = None,
    patience: float = 0.0,
) -> Generator[None, None, Corners] | None:
    """The triangles of an evaluated glass with the bumps of its material, a little at a time.

    What is Blender's is read before the first step.

    Parameters
    ----------
    corners : of its mesh.
    to_world : (4, 4).
    pixels : sums of images' pixels that are known already.
    paint : of these triangles, if it is to be known at the corners.
    patience : seconds to wait for what is not prepared yet; then they are as they were.

    Returns
    -------
    None where there are no bumps, or unknown ones, and no paint.
    """
    name, recipe = _recipe(obj, depsgraph)
    if recipe is None and paint is None:
        return None
    recipe = recipe or Recipe()
    maps, place = maps_of(obj, corners, sorted(recipe.coordinates)), frame_of(recipe, to_world)
    digest = hashlib.blake2b(repr(recipe.stamp()).encode())
    for array in (corners.points, corners.normals, place, *maps.values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr((painted(recipe, pixels), paint and paint.stamp)).encode())
    key = digest.digest()
    if key in _kept:
        _kept.move_to_end(key)
        return _at_once(_kept[key])
    fields = Fields(name, recipe, obj.original.data, place, list(maps))
    return _remembered(key, _Field(fields, paint, place[:3, :3], corners, maps), patience)


def _at_once(corners: Corners) -> Generator[None, None, Corners]:
    return corners
    yield


def _remembered(key: bytes, field: _Field, patience: float) -> Generator[None, None, Corners]:
    """Triangles with bumps, to be kept; where nothing is prepared, as they were."""
    until = time.perf_counter() + patience
    while not field.is_ready and time.perf_counter() < until:
        yield
    try:
        found = yield from field.refining()
    except NotReady:
        return field.corners
    _kept[key] = found
    while sum(len(corners.points) for corners in _kept.values()) > MOST_KEPT:
        _kept.popitem(last=False)
    return found


def surface_stamp(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, to_world: np.ndarray
) -> tuple:
    """Equal stamps, equal bumps and paint of an evaluated glass that only turns or moves."""
    found, materials = [], glassy_materials(obj)
    for material in materials:
        seen = material.evaluated_get(depsgraph)
        if len(materials) > 1:
            # Each face has what its own says.
            found.append(plain_finish(material_interface(seen)))
        for recipe in recipes_of(seen):
            ready = is_ready(material.name_full, recipe)
            found += [*recipe.stamp(), ready, frame_of(recipe, to_world).tobytes()]
    return tuple(found)


class Surfaces:
    """The surfaces of glasses that are read together: instances share what was read of a mesh."""

    def __init__(self) -> None:
        self._known: dict[int, Corners] = {}
        self._pixels: dict[tuple, int] = {}
        self.problems: list[str] = []

    def of(
        self,
        evaluated: bpy.types.Object,
        depsgraph: bpy.types.Depsgraph,
        opaque: int,
        to_world: np.ndarray,
    ) -> tuple[Corners, Paint | None]:
        """The triangles of an evaluated glass in a place with its bumps, see `corners_of`, and its
        paint."""
        key = evaluated.data.as_pointer()
        if key not in self._known:
            self._known[key] = corners_of(evaluated.data, opaque)
        place = self._known[key], to_world, self._pixels
        paint = paint_on(evaluated, depsgraph, *place)
        if paint is not None and not paint.is_ready:
            paint = None
        steps, found = bumping(evaluated, depsgraph, *place), None
        if steps is None:
            return self._known[key], paint
        while found is None:
            try:
                next(steps)
            except StopIteration as end:
                found = end.value
        if found.missed > FEW:
            self.problems.append(
                f'Glass "{evaluated.name}" has finer bumps than {MOST_TRIANGLES} triangles show'
            )
        if paint is not None and found.source is not None:
            paint = paint.in_parts(found.source)
        return found, paint


@dataclass(eq=False)
class _Places:
    """Points (N, …) on triangles: place, normal, maps; and the number of a triangle there."""

    points: np.ndarray
    normals: np.ndarray
    maps: np.ndarray
    triangle: np.ndarray

    def take(self, some: slice) -> _Places:
        """Some of them."""
        return _Places(*(a[some] for a in vars(self).values()))

    def between(self, pairs: np.ndarray, triangle: np.ndarray) -> _Places:
        """The middles of pairs (K, 2)."""
        parts = (a[pairs].mean(axis=1) for a in (self.points, self.normals, self.maps))
        return _Places(*parts, triangle)


class _Field:
    """The bumps of a material on a mesh, and its paint where that is asked for.

    What it finds in a place are six numbers or more: unit normals in the world, as rays from
    outside and from within meet them; and where there is paint what `Paint.at` has.
    """

    def __init__(
        self,
        fields: Fields,
        paint: Paint | None,
        linear: np.ndarray,
        corners: Corners,
        maps: dict[str, np.ndarray],
    ) -> None:
        self.corners = corners
        self._fields, self._paint, self._linear, self._maps = fields, paint, linear, maps
        counters["bumps"] += 1

    @property
    def is_ready(self) -> bool:
        """Whether there are points to evaluate in."""
        has_bumps = bool(self._fields.recipe.stages)
        fields = not has_bumps or self._fields.is_ready
        return fields and (self._paint is None or self._paint.is_ready)

    def refining(self) -> Generator[None, None, Corners]:
        """The triangles in parts in which all runs as it does in truth, a round at a time."""
        points, normals = self.corners.points, self.corners.normals
        self._size = float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))
        self._names = list(self._maps)
        # Behind the maps of bumps those of the paint.
        none = np.zeros((len(points), 3, 0))
        painted = none if self._paint is None else self._paint.rows[..., 6:]
        corner_maps = np.concatenate([*self._maps.values(), painted], axis=2)
        self._frame(points, corner_maps)
        rows = np.concatenate((points, normals, corner_maps), axis=2)
        rows = rows.reshape(-1, rows.shape[2])
        # Faces of two materials share no corner.
        kind = np.zeros(len(points)) if self._paint is None else self._paint.kind
        apart = np.column_stack((rows, np.repeat(kind, 3)))
        _, first, number = np.unique(apart, axis=0, return_index=True, return_inverse=True)
        places = _Places(
            rows[first, :3],
            rows[first, 3:6],
            rows[first, 6:],
            first // 3,
        )
        self._grows = self._tangents()
        triangles = Triangles.whole(places.points, number.reshape(-1, 3))
        looks = yield from self._looks(places)
        settled, missed = np.zeros(0, np.int64), 0.0
        for _ in range(MOST_ROUNDS):
            yield
            edges, of_triangle = triangles.edges()
            keys = edges[:, 0].astype(np.int64) << 32 | edges[:, 1]
            asked = np.flatnonzero(~np.isin(keys, settled))
            source = np.zeros(len(edges), int)
            source[of_triangle.ravel()] = np.repeat(triangles.origin, 3)
            middles = places.between(edges[asked], source[asked])
            found = yield from self._looks(middles)
            straight = looks[edges[asked]].mean(axis=1)
            gap = np.linalg.norm(found[:, :3] - unit(straight[:, :3]), axis=1)
            length = np.linalg.norm(np.diff(places.points[edges], axis=1)[:, 0], axis=1)
            long = length[asked] > COARSE * self._size
            missed = float((gap > TOLD).sum()) / len(edges)
            if self._paint is not None:
                off = np.abs(found[:, 6:] - straight[:, 6:]).max(axis=1)
                gap = np.maximum(gap, TOLERANCE / COLOUR_TOLERANCE * off)
            gap[long] = np.inf
            room = (MOST_TRIANGLES - len(triangles.corners)) // 3
            if room <= 0:
                break
            least = TOLERANCE
            if (gap > least).sum() > room:
                least = max(least, np.partition(gap, len(gap) - room)[len(gap) - room])
            chosen = np.zeros(len(edges), bool)
            chosen[asked[gap > least]] = True
            if not chosen.any():
                break
            # With its longest edge whole, a triangle that is split again becomes a sliver.
            longest = of_triangle[np.arange(len(of_triangle)), length[of_triangle].argmax(axis=1)]
            chosen[longest[chosen[of_triangle].any(axis=1)]] = True
            missing = np.setdiff1d(np.flatnonzero(chosen), asked)
            settled = np.concatenate((settled, keys[asked[gap <= TOLERANCE]]))
            new = np.flatnonzero(chosen)
            added = places.between(edges[new], source[new])
            of_edges = np.empty((len(edges), looks.shape[1]))
            of_edges[asked] = found
            if len(missing):
                of_edges[missing] = yield from self._looks(
                    places.between(edges[missing], source[missing])
                )
            yield
            places = _Places(
                *(
                    np.concatenate((getattr(places, name), getattr(added, name)))
                    for name in ("points", "normals", "maps", "triangle")
                )
            )
            looks = np.concatenate((looks, of_edges[new]))
            triangles = triangles.split(edges, of_triangle, chosen)
        smooth = unit(places.normals @ np.linalg.inv(self._linear))
        has_bumps = np.abs(looks[:, :3] - smooth).max() >= FLAT
        if self._paint is None and not has_bumps:
            return self.corners
        # Normals of the mesh's own frame: places in the world turn them by the inverse.
        corners = triangles.corners
        return Corners(
            triangles.points[corners],
            (looks[:, :3] @ self._linear)[corners],
            self.corners.slots[triangles.origin],
            within=(looks[:, 3:6] @ self._linear)[corners] if has_bumps else None,
            missed=missed,
            source=(triangles.origin, triangles.weights),
            finish=None if self._paint is None else looks[corners, 6:],
        )

    def _frame(self, points: np.ndarray, maps: np.ndarray) -> None:
        """Two directions in each triangle, and how its maps grow along them."""
        first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
        along = unit(first)
        across = unit(second - (second * along).sum(axis=1, keepdims=True) * along)
        self._along, self._across = along, across
        # A map is affine in a triangle: its slopes by the two edges from the first corner.
        a = (first * along).sum(axis=1)
        b, c = (second * along).sum(axis=1), (second * across).sum(axis=1)
        one, two = maps[:, 1] - maps[:, 0], maps[:, 2] - maps[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            by_along = one / a[:, None]
            by_across = (two - b[:, None] * by_along) / c[:, None]
        self._slopes = np.nan_to_num(
            np.stack((by_along, by_across), axis=1), posinf=0.0, neginf=0.0
        )

    def _tangents(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of each map the direction in which u grows in each triangle (T, 3), and its hand (T,)."""
        found = {}
        for number, name in enumerate(self._names):
            du, dv = np.moveaxis(self._slopes[:, :, 2 * number : 2 * number + 2], 2, 0)
            hand = np.sign(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
            grows = hand[:, None] * (dv[:, 1:] * self._along - dv[:, :1] * self._across)
            found[name] = unit(grows), hand
        return found

    def _looks(self, places: _Places) -> Generator[None, None, np.ndarray]:
        """(N, L) what is found in places, a part of them at a time."""
        finish = 0 if self._paint is None else FINISH
        found = np.empty((len(places.points), 6 + finish))
        for start in range(0, len(places.points), BLOCK):
            some = slice(start, start + BLOCK)
            part = places.take(some)
            found[some, :3], found[some, 3:6] = self._tilted(part)
            if self._paint is not None:
                maps = part.maps[:, 2 * len(self._names) :]
                rows = np.concatenate((part.points, part.normals, maps), axis=1)
                found[some, 6:] = self._paint.on(self._paint.kind[part.triangle], rows)
            yield
        return found

    def _tilted(self, places: _Places) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) unit normals in the world with all bumps, as rays from outside and from within
        meet them."""
        recipe, count = self._fields.recipe, len(places.points)
        base = unit(places.normals @ np.linalg.inv(self._linear))
        if not recipe.stages:
            return base, base
        along, across = self._along[places.triangle], self._across[places.triangle]
        step = STEP * self._size
        offsets, outside, behind = _offsets(recipe)
        parts = [
            (
                places.points + step * (x * along + y * across),
                places.points + step * hand * (x * along + y * across),
                places.maps + step * hand * (np.array((x, y)) @ self._slopes[places.triangle]),
            )
            for x, y, hand in offsets
        ]
        where = [np.concatenate(part) for part in zip(*parts, strict=True)]
        fields = self._fields.evaluated(*where, np.tile(places.normals, (len(offsets), 1)))
        # The directions' lengths count: objects may be scaled.
        dx, dy = along @ self._linear.T, across @ self._linear.T
        outer, inner = base, base
        for stage, values in zip(recipe.stages, fields, strict=True):
            values = [v.reshape(len(offsets), count, 3) for v in values]
            if stage.is_map:
                outer = self._mapped(stage, values, places, base)
                inner = outer
                continue
            height, strength, distance = np.moveaxis(values[0], 2, 0)
            strength, distance = np.maximum(strength[0], 0.0)[:, None], distance[0]
            if stage.kind != "BUMP":
                middle, scale = np.moveaxis(values[0], 2, 0)[1:]
                height, strength, distance = (height - middle) * scale, 1.0, 1.0
            if stage.kind.endswith("OBJECT"):
                distance = np.linalg.norm(unit(places.normals) @ self._linear.T, axis=1)
            distance = -distance if stage.inverts else distance
            grown, within = (
                distance / (2.0 * step) * (height[up] - height[down])
                for up, down in (outside, behind)
            )
            outer = _bump(outer, dx, dy, grown, strength)
            # Cycles does not turn bumps round for what comes from within.
            inner = _bump(inner, dx, dy, -within, strength)
        return outer, inner

    def _mapped(self, stage: Stage, values: list[np.ndarray], places: _Places, base) -> np.ndarray:
        """Normals by a normal map."""
        colour, strength = 2.0 * values[0][0] - 1.0, values[1][0][:, :1]
        if stage.kind == "TANGENT":
            grows, hand = (part[places.triangle] for part in self._grows[UV + stage.uv])
            normal = unit(places.normals)
            tangent = unit(grows - (grows * normal).sum(axis=1, keepdims=True) * normal)
            side = hand[:, None] * np.cross(normal, tangent)
            x, y, z = np.moveaxis(colour[..., None], 1, 0)
            z = 1.0 + np.clip(strength, 0.0, 1.0) * (z - 1.0)
            mapped = strength * (x * tangent + y * side) + z * normal
            mapped = unit(mapped @ np.linalg.inv(self._linear))
        else:
            if stage.kind.startswith("BLENDER"):
                colour = colour * (1.0, -1.0, -1.0)
            mapped = colour
            if stage.kind.endswith("OBJECT"):
                mapped = mapped @ np.linalg.inv(self._linear)
            mapped = unit(base + np.maximum(strength, 0.0) * (unit(mapped) - base))
        lost = ~mapped.any(axis=1)
        mapped[lost] = base[lost]
        return mapped


def _offsets(recipe: Recipe) -> tuple[list, tuple, tuple]:
    """Where heights are evaluated round a point, and which rows are their differences for rays from
    outside, and for those from within.

    A place is two steps, and 1 or −1 by which attributes are beside it: for a ray from within
    Cycles turns the derivatives of attributes round, but not those of positions.
    """
    if not recipe.has_heights:
        return [(0, 0, 1)], ((), ()), ((), ())
    around = (1, 0), (-1, 0), (0, 1), (0, -1)
    offsets = [(0, 0, 1), *((x, y, 1) for x, y in around)]
    up, down = [1, 3], [2, 4]
    is_mapped = any(name == GENERATED or name.startswith(UV) for name in recipe.coordinates)
    if not is_mapped:
        return offsets, (up, down), (up, down)
    if recipe.coordinates.isdisjoint((OBJECT, WORLD)):
        return offsets, (up, down), (down, up)
    return [*offsets, *((x, y, -1) for x, y in around)], (up, down), ([5, 7], [6, 8])


def _bump(
    normal: np.ndarray, dx: np.ndarray, dy: np.ndarray, grown: np.ndarray, strength: np.ndarray
) -> np.ndarray:
    """Normals (N, 3) tilted by how much heights grow (2, N) along two directions (N, 3) in the
    surface (M. Mikkelsen, Bump Mapping Unparametrized Surfaces on the GPU, 2010)."""
    by_x, by_y = np.cross(dy, normal), np.cross(normal, dx)
    det = (dx * by_x).sum(axis=1, keepdims=True)
    slope = grown[0][:, None] * by_x + grown[1][:, None] * by_y
    tilted = unit(np.abs(det) * normal - np.sign(det) * slope)
    return unit(strength * tilted + (1.0 - strength) * normal)
