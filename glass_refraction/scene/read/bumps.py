# SPDX-License-Identifier: GPL-3.0-or-later
"""Bumps of glasses that are meshes: their triangles in small ones, with the normals of the bumps.

A bump moves no surface: points stay on the faces, and normals tilt. The heights are evaluated by an
own geometry tree (`build.bump_tree`) in a scene of the extension's own, round each point; so this
works within a render's frame-change handler, as casts of rays do.
"""

from __future__ import annotations

import hashlib
import time
import zlib
from collections import OrderedDict
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..memory import counters
from ..names import own
from .arrays import mesh_triangles, positions, read_attribute, unit, write_attribute
from .bump_recipe import (
    GENERATED,
    NORMAL,
    OBJECT,
    UV,
    WORLD,
    Recipe,
    Untranslatable,
    attribute_of,
    by_identifier,
    recipe_of,
)
from .mesh_glasses import Corners, glassy_materials, interface_node, triangles_of
from .triangles import Triangles

BUMPS = "bumps"
"""Role of the own points that a material's bumps are evaluated in, and of their tree."""
OF_MATERIAL, STRUCTURE = "refractive_glass_material", "refractive_glass_structure"
"""Custom properties of these points: the material's name, and what its tree was made of."""
FIELD = "rg_field_{}_{}"
"""Attribute that the tree stores: of a stage, and of the stage's fields."""
STEP = 1e-4
"""Part of a mesh's size by which places lie apart whose heights tell a slope: single precision
gives a slope to a thousandth of that of bumps as wide as the mesh."""
FLAT = 1e-6
"""Radians: of less than this no bumps are."""
COARSE = 1.0 / 48.0
"""Of a mesh's size: longer edges are split whatever lies at their middles."""
TOLERANCE = 0.006
"""Radians by which the normal at the middle of an edge may miss that between its ends. Glass of ior
1.5 turns rays by half of it."""
MOST_TRIANGLES = 160_000
"""Of a bumped mesh."""
TOLD = 0.05
"""Radians: edges of a mesh of so many at which normals miss by more are told of ..."""
FEW = 0.1
"""... if they are more than this part of all: steps of heights are never met."""
MOST_ROUNDS = 24
BLOCK = 40_000
"""Places whose normals are found between two events of a window: a tenth of a second."""
ROUNDED = 5
"""Digits of an object's scale that count: a turn changes the last ones of single precision."""
MOST_KEPT = 6 * MOST_TRIANGLES
"""Triangles of bumped meshes that are kept for the next time: many small ones, or a few large."""
MOST_PIXELS = 2048 * 2048
"""Of an image whose pixels are compared with those of the last time: a tenth of a second."""


def bumps_of(material: bpy.types.Material | None) -> Recipe | str | None:
    """How the bumps of a glassy material are made; None: it has none. A name: by what is not
    known."""
    node = interface_node(material)
    if node is None:
        return None
    try:
        return recipe_of(material, node)
    except Untranslatable as error:
        return str(error)


def lost_bumps(obj: bpy.types.Object) -> list[str]:
    """A line if the bumps of an object's first glassy material cannot be evaluated."""
    material = next(iter(glassy_materials(obj)), None)
    unknown = bumps_of(material)
    if not isinstance(unknown, str):
        return []
    return [
        f'Glass "{obj.name}" is seen without the bumps of its material "{material.name}": '
        f"{unknown} is not known where rays go (a Displace modifier works)"
    ]


def find_points(
    objects: Iterable[bpy.types.Object], name: str, recipe: Recipe
) -> Iterator[bpy.types.Object]:
    """The own points that a material's bumps are evaluated in: each scene has its own."""
    made = name, recipe.structure
    return (o for o in objects if own(o, BUMPS) and (o[OF_MATERIAL], o[STRUCTURE]) == made)


def write_values(tree: bpy.types.NodeTree, recipe: Recipe) -> None:
    """Have the nodes of a tree hold the recipe's values."""
    for number, name, value in recipe.values:
        node = tree.nodes[str(number)]
        if name == "ramp":
            _write_ramp(node.color_ramp, value)
        elif name == "colour":
            _write(node, "value", value)
        elif name == "image":
            uids = {image.session_uid: image for image in bpy.data.images}
            _write(node.inputs["Image"], "default_value", uids.get(value))
        elif name == "output":
            _write(node.outputs[0], "default_value", value)
        else:
            socket = by_identifier(node.inputs, name)
            _write(socket, "default_value", _fitted(value, socket.default_value))


def _fitted(value, like):
    """A number or numbers as a socket takes them that has so many."""
    wanted = np.size(like)
    if isinstance(value, str) or np.size(value) == wanted:
        return value
    return tuple(np.resize(value, wanted).tolist()) if wanted > 1 else float(np.mean(value[:3]))


def _write(target, name: str, value) -> None:
    """Set what differs."""
    present = getattr(target, name)
    same = (
        np.allclose(np.array(present), np.array(value), rtol=1e-7, atol=0.0)
        if isinstance(value, (tuple, float))
        else present == value
    )
    if not same:
        setattr(target, name, value)


def _write_ramp(ramp: bpy.types.ColorRamp, value: tuple) -> None:
    mode, interpolation, hue, ends = value
    for name, setting in (
        ("color_mode", mode),
        ("interpolation", interpolation),
        ("hue_interpolation", hue),
    ):
        _write(ramp, name, setting)
    while len(ramp.elements) < len(ends):
        ramp.elements.new(1.0)
    while len(ramp.elements) > len(ends):
        ramp.elements.remove(ramp.elements[-1])
    for element, (position, *colour) in zip(ramp.elements, ends, strict=True):
        _write(element, "position", position)
        _write(element, "color", tuple(colour))


_kept: OrderedDict[bytes, Corners] = OrderedDict()


def _recipe(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[str, Recipe | None]:
    """The name of a glass's material, and how its bumps are made; None: it has none."""
    material = next(iter(glassy_materials(obj)), None)
    if material is None:
        return "", None
    found = bumps_of(material.evaluated_get(depsgraph))
    return material.name_full, found if isinstance(found, Recipe) else None


def _ready_points(name: str, recipe: Recipe) -> bpy.types.Object | None:
    """The points to evaluate a material's bumps in, if they are made for these."""
    return next((o for o in find_points(bpy.data.objects, name, recipe) if o.users_scene), None)


def bumping(
    obj: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    points: np.ndarray,
    normals: np.ndarray,
    to_world: np.ndarray,
    painted: dict[tuple, int],
    patience: float = 0.0,
) -> Generator[None, None, Corners] | None:
    """The triangles of an evaluated glass with the bumps of its material, a little at a time.

    What is Blender's is read before the first step.

    Parameters
    ----------
    points, normals : (T, 3, 3), in its own frame.
    to_world : (4, 4).
    painted : sums of images' pixels that are known already.
    patience : seconds to wait for what is not prepared yet; then they are as they were.

    Returns
    -------
    None where there are no bumps, or unknown ones.
    """
    name, recipe = _recipe(obj, depsgraph)
    if recipe is None:
        return None
    maps = {name: _uv(obj, points, name[len(UV) :]) for name in recipe.coordinates if UV in name}
    place = to_world if recipe.is_of_world else _stretch(to_world[:3, :3])
    digest = hashlib.blake2b(repr(recipe.stamp()).encode())
    for array in (points, normals, place, *maps.values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    images = tuple(recipe.images)
    if images not in painted:
        painted[images] = _painted(recipe)
    digest.update(repr(painted[images]).encode())
    key = digest.digest()
    if key in _kept:
        _kept.move_to_end(key)
        return _at_once(_kept[key])
    field = _Field(name, recipe, obj.original.data, place)
    return _remembered(key, field, (points, normals, maps), patience)


def _at_once(corners: Corners) -> Generator[None, None, Corners]:
    return corners
    yield


def _remembered(
    key: bytes, field: _Field, triangles: tuple, patience: float
) -> Generator[None, None, Corners]:
    """Triangles with bumps, to be kept; where nothing is prepared, as they were."""
    until = time.perf_counter() + patience
    while not field.is_ready() and time.perf_counter() < until:
        yield
    try:
        found = yield from field.refining(*triangles)
    except _NotReady:
        return Corners(*triangles[:2])
    _kept[key] = found
    while sum(len(corners.points) for corners in _kept.values()) > MOST_KEPT:
        _kept.popitem(last=False)
    return found


def _painted(recipe: Recipe) -> int:
    """Equal for equal pixels of the images that a recipe looks up, but of very large ones."""
    uids, found = {uid for uid, *_ in recipe.images}, 0
    for image in bpy.data.images if uids else ():
        if image.session_uid in uids and 0 < np.prod(image.size) <= MOST_PIXELS:
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            found = zlib.crc32(pixels, found)
    return found


class _NotReady(Exception):
    """Nothing is prepared for a material as it is."""


def bump_stamp(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, to_world: np.ndarray
) -> tuple:
    """Equal stamps, equal bumps of an evaluated glass that only turns or moves; () without any."""
    name, recipe = _recipe(obj, depsgraph)
    if recipe is None:
        return ()
    is_ready = _ready_points(name, recipe) is not None
    place = to_world if recipe.is_of_world else _stretch(to_world[:3, :3])
    return (*recipe.stamp(), is_ready, place.tobytes())


class Bumps:
    """The bumps of glasses that are read together: instances share what was read of a mesh."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._painted: dict[tuple, int] = {}
        self.problems: list[str] = []

    def of(
        self,
        evaluated: bpy.types.Object,
        depsgraph: bpy.types.Depsgraph,
        opaque: int,
        to_world: np.ndarray,
    ) -> Corners:
        """The triangles of an evaluated glass in a place, see `triangles_of`."""
        key = evaluated.data.as_pointer()
        if key not in self._known:
            self._known[key] = triangles_of(evaluated.data, opaque)
        found = None
        steps = bumping(evaluated, depsgraph, *self._known[key], to_world, self._painted)
        if steps is None:
            return Corners(*self._known[key])
        while found is None:
            try:
                next(steps)
            except StopIteration as end:
                found = end.value
        if found.missed > FEW:
            self.problems.append(
                f'Glass "{evaluated.name}" has finer bumps than {MOST_TRIANGLES} triangles show'
            )
        return found


def _stretch(linear: np.ndarray) -> np.ndarray:
    """(4, 4) a linear map (3, 3) but for what it turns: so a glass that turns stays the same."""
    squares, axes = np.linalg.eigh(linear.T @ linear)
    stretch = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    found = np.eye(4)
    digits = ROUNDED - int(np.ceil(np.log10(max(np.abs(stretch).max(), 1e-30))))
    # No negative zeros: bytes are compared.
    found[:3, :3] = np.round(stretch, digits) + 0.0
    return found


def _uv(obj: bpy.types.Object, points: np.ndarray, name: str) -> np.ndarray:
    """(T, 3, 2) a UV map at the corners of triangles (T, 3, 3) of an evaluated mesh.

    What renders leave of a mesh has no maps. Then they are those of the mesh before its modifiers,
    whose triangles are known by their places; 0 where there is none.
    """
    for mesh in (obj.data, obj.original.data):
        used = (layer.name for layer in mesh.uv_layers if layer.active_render)
        layer = mesh.attributes.get(name or next(used, ""))
        if layer is None or (layer.data_type, layer.domain) != ("FLOAT2", "CORNER"):
            continue
        loops, vertices = mesh_triangles(mesh, "loops"), mesh_triangles(mesh)
        theirs, mine = positions(mesh)[vertices], points.astype(np.float32)
        where, order = _same_triangles(mine, theirs)
        if (where >= 0).all():
            uv = read_attribute(layer)[loops][where]
            return np.take_along_axis(uv, order[..., None], axis=1).astype(float)
    return np.zeros((len(points), 3, 2))


def _same_triangles(mine: np.ndarray, theirs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T,) which of other triangles (S, 3, 3) has the corners of each of these (T, 3, 3), −1: none;
    and (T, 3) which of its corners is each of these."""
    both = np.concatenate((mine, theirs))
    places = np.unique(both.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    turn = np.argsort(places, axis=1, kind="stable")
    names = np.unique(np.sort(places, axis=1), axis=0, return_inverse=True)[1].ravel()
    count = len(mine)
    known = np.full(names.max(initial=-1) + 1, -1)
    known[names[count:]] = np.arange(len(theirs))
    where = known[names[:count]]
    order = np.empty((count, 3), int)
    np.put_along_axis(order, turn[:count], turn[count:][where] if len(theirs) else 0, axis=1)
    return where, order


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
    """The bumps of a material on a mesh."""

    def __init__(
        self, material: str, recipe: Recipe, mesh: bpy.types.Mesh, to_world: np.ndarray
    ) -> None:
        self._material, self._recipe = material, recipe
        self._space = np.array((mesh.texspace_location, mesh.texspace_size))
        self._to_world, self._linear = to_world, to_world[:3, :3]
        counters["bumps"] += 1

    def is_ready(self) -> bool:
        """Whether there are points to evaluate in."""
        return _ready_points(self._material, self._recipe) is not None

    def _cloud(self) -> bpy.types.Object:
        """The points to evaluate in, with this moment's values: others may have used them."""
        found = _ready_points(self._material, self._recipe)
        if found is None:
            raise _NotReady
        write_values(found.modifiers[0].node_group, self._recipe)
        return found

    def refining(
        self, points: np.ndarray, normals: np.ndarray, maps: dict
    ) -> Generator[None, None, Corners]:
        """Triangles (T, 3, 3) in parts whose normals run as the bumps' do, a round at a time."""
        self._size = float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))
        self._names = list(maps)
        corner_maps = np.concatenate([*maps.values(), np.zeros((len(points), 3, 0))], axis=2)
        self._frame(points, corner_maps)
        rows = np.concatenate((points, normals, corner_maps), axis=2)
        rows = rows.reshape(-1, rows.shape[2])
        _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        places = _Places(
            rows[first, :3],
            rows[first, 3:6],
            rows[first, 6:],
            first // 3,
        )
        self._grows = self._tangents()
        triangles = Triangles.whole(places.points, number.reshape(-1, 3))
        tilted, within = yield from self._tilted(places)
        settled, missed = np.zeros(0, np.int64), 0.0
        for _ in range(MOST_ROUNDS):
            yield
            edges, of_triangle = triangles.edges()
            keys = edges[:, 0].astype(np.int64) << 32 | edges[:, 1]
            asked = np.flatnonzero(~np.isin(keys, settled))
            source = np.zeros(len(edges), int)
            source[of_triangle.ravel()] = np.repeat(triangles.origin, 3)
            middles = places.between(edges[asked], source[asked])
            outer, inner = yield from self._tilted(middles)
            straight = unit(tilted[edges[asked]].mean(axis=1))
            gap = np.linalg.norm(outer - straight, axis=1)
            length = np.linalg.norm(np.diff(places.points[edges], axis=1)[:, 0], axis=1)
            long = length[asked] > COARSE * self._size
            missed = float((gap > TOLD).sum()) / len(edges)
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
            normal, behind = np.empty((2, len(edges), 3))
            normal[asked], behind[asked] = outer, inner
            if len(missing):
                normal[missing], behind[missing] = yield from self._tilted(
                    places.between(edges[missing], source[missing])
                )
            yield
            places = _Places(
                *(
                    np.concatenate((getattr(places, name), getattr(added, name)))
                    for name in ("points", "normals", "maps", "triangle")
                )
            )
            tilted = np.concatenate((tilted, normal[new]))
            within = np.concatenate((within, behind[new]))
            triangles = triangles.split(edges, of_triangle, chosen)
        if np.abs(tilted - unit(places.normals @ np.linalg.inv(self._linear))).max() < FLAT:
            return Corners(points, normals)
        # Normals of the mesh's own frame: places in the world turn them by the inverse.
        corners = triangles.corners
        return Corners(
            triangles.points[corners],
            (tilted @ self._linear)[corners],
            (within @ self._linear)[corners],
            missed,
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

    def _tilted(self, places: _Places) -> Generator[None, None, np.ndarray]:
        """(2, N, 3) normals in places, see `_tilted_now`, a part of the places at a time."""
        found = np.empty((2, len(places.points), 3))
        for start in range(0, len(places.points), BLOCK):
            some = slice(start, start + BLOCK)
            found[:, some] = self._tilted_now(places.take(some))
            yield
        return found

    def _tilted_now(self, places: _Places) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) unit normals in the world with all bumps, as rays from outside and from within
        meet them."""
        recipe, count = self._recipe, len(places.points)
        inverse = np.linalg.inv(self._linear)
        base = unit(places.normals @ inverse)
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
        fields = self._evaluated(*where, np.tile(places.normals, (len(offsets), 1)))
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

    def _mapped(self, stage, values: list[np.ndarray], places: _Places, base) -> np.ndarray:
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

    def _evaluated(
        self, points: np.ndarray, mapped: np.ndarray, maps: np.ndarray, normals: np.ndarray
    ) -> list:
        """Of each stage its fields (N, 3), by places in the object's frame: those of coordinates
        that are positions, and of those that are attributes."""
        known = {
            OBJECT: lambda: points,
            WORLD: lambda: points @ self._linear.T + self._to_world[:3, 3],
            NORMAL: lambda: unit(normals),
            GENERATED: lambda: self._generated(mapped),
        }
        for number, name in enumerate(self._names):
            pair = maps[:, 2 * number : 2 * number + 2]
            known[name] = lambda pair=pair: np.column_stack((pair, np.zeros(len(pair))))
        cloud = self._cloud()
        mesh = cloud.data
        mesh.clear_geometry()
        mesh.vertices.add(len(points))
        for name in sorted(self._recipe.coordinates):
            write_attribute(mesh, attribute_of(name), known[name](), "FLOAT_VECTOR")
        mesh.update()
        cloud.update_tag()
        layer = cloud.users_scene[0].view_layers[0]
        layer.update()
        found = cloud.evaluated_get(layer.depsgraph).data.attributes
        counters["bump_points"] += len(points)
        # Maths may give what is no number, and images may hold it. Differences of these are to be
        # numbers.
        most = float(np.finfo(np.float32).max)
        return [
            [
                np.nan_to_num(
                    read_attribute(found[FIELD.format(stage, part)]).astype(float),
                    posinf=most,
                    neginf=-most,
                )
                for part in range(len(fields))
            ]
            for stage, fields in enumerate(self._recipe.fields)
        ]

    def _generated(self, points: np.ndarray) -> np.ndarray:
        middle, size = self._space[0], 2.0 * self._space[1]
        return (points - middle) * np.divide(1.0, size, out=np.zeros(3), where=size != 0) + 0.5


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
