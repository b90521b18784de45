# SPDX-License-Identifier: GPL-3.0-or-later
"""What textures of a glassy material are in places on its mesh: evaluated by own geometry trees.

The trees (`build.material_tree`) stand in a scene of the extension's own. So this works within a
render's frame-change handler, as casts of rays do.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence

import bpy
import numpy as np

from ..memory import counters
from ..names import own
from .arrays import mesh_triangles, positions, read_attribute, unit, write_attribute
from .glassy_materials import glassy_materials
from .material_recipe import (
    GENERATED,
    NORMAL,
    OBJECT,
    UV,
    WORLD,
    Recipe,
    attribute_of,
    by_identifier,
    recipes_of,
)
from .mesh_corners import Corners
from .modifier_inputs import glass_modifier, has_input, read_input

FIELDS = "fields"
"""Role of the own points that a material's textures are evaluated in, and of their tree."""
OF_MATERIAL, STRUCTURE = "refractive_glass_material", "refractive_glass_structure"
"""Custom properties of these points: the material's name, and what their tree was made of."""
FIELD = "rg_field_{}_{}"
"""Attribute that the tree stores: of a stage, and of the stage's fields."""
MOST_PIXELS = 2048 * 2048
"""Of an image whose pixels are compared with those of the last time: a tenth of a second."""
ROUNDED = 5
"""Digits of an object's scale that count: a turn changes the last ones of single precision."""


class NotReady(Exception):
    """Nothing is prepared for a material as it is."""


def find_points(
    objects: Iterable[bpy.types.Object], name: str, recipe: Recipe
) -> Iterator[bpy.types.Object]:
    """The own points that a recipe of a material is evaluated in: each scene has its own."""
    made = name, recipe.structure
    return (o for o in objects if own(o, FIELDS) and (o[OF_MATERIAL], o[STRUCTURE]) == made)


def is_ready(name: str, recipe: Recipe) -> bool:
    """Whether there are points to evaluate a material's recipe in."""
    return _ready_points(name, recipe) is not None


def _ready_points(name: str, recipe: Recipe) -> bpy.types.Object | None:
    return next((o for o in find_points(bpy.data.objects, name, recipe) if o.users_scene), None)


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


def painted(recipe: Recipe, known: dict[tuple, int]) -> int:
    """Equal for equal pixels of the images that a recipe looks up, but of very large ones.

    ``known``: what was found for images before; kept.
    """
    images = tuple(recipe.images)
    if images not in known:
        known[images] = _sum_of_pixels({uid for uid, *_ in images})
    return known[images]


def _sum_of_pixels(uids: set[int]) -> int:
    found = 0
    for image in bpy.data.images if uids else ():
        if image.session_uid in uids and 0 < np.prod(image.size) <= MOST_PIXELS:
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
            found = zlib.crc32(pixels, found)
    return found


def frame_of(recipe: Recipe, to_world: np.ndarray) -> np.ndarray:
    """(4, 4) what of an object's place a recipe depends on.

    If it does not depend on where and how turned a glass stands, that is how it is stretched: so a
    glass that turns stays the same.
    """
    if recipe.is_of_world:
        return to_world
    linear = to_world[:3, :3]
    squares, axes = np.linalg.eigh(linear.T @ linear)
    stretch = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    found = np.eye(4)
    digits = ROUNDED - int(np.ceil(np.log10(max(np.abs(stretch).max(), 1e-30))))
    # No negative zeros: bytes are compared.
    found[:3, :3] = np.round(stretch, digits) + 0.0
    return found


def maps_of(obj: bpy.types.Object, corners: Corners, names: Iterable[str]) -> dict:
    """The UV maps (T, 3, 2) of an evaluated mesh that are among the names of coordinates."""
    wanted = {name: name[len(UV) :] for name in names if name.startswith(UV)}
    told = read_map(glass_modifier(obj)) if wanted else ""
    found = {}
    for name, layer in wanted.items():
        is_left = corners.uv is not None and told == (layer or rendered_map(obj.original.data))
        found[name] = corners.uv if is_left else _map(obj, corners.points, layer)
    return found


UV_MAP = "UV Map"
"""Input of the glass's modifier: the map whose places renders leave, see `mesh_corners`."""


def read_map(modifier: bpy.types.NodesModifier | None) -> str:
    """The name of the UV map that a glass's modifier is told of; an older one, or None, of none."""
    knows = modifier is not None and has_input(modifier, UV_MAP)
    return read_input(modifier, UV_MAP) if knows else ""


def wanted_map(obj: bpy.types.Object) -> str:
    """The name of the UV map that an object's glassy materials look up, the first of several."""
    recipes = [recipe for material in glassy_materials(obj) for recipe in recipes_of(material)]
    names = sorted(name for recipe in recipes for name in recipe.coordinates)
    maps = [name[len(UV) :] for name in names if name.startswith(UV)]
    return (maps[0] or rendered_map(obj.data)) if maps else ""


def rendered_map(mesh: bpy.types.Mesh) -> str:
    """The name of the UV map that renders use where none is named."""
    return next((layer.name for layer in mesh.uv_layers if layer.active_render), "")


def _map(obj: bpy.types.Object, points: np.ndarray, name: str) -> np.ndarray:
    """(T, 3, 2) a UV map at the corners of triangles (T, 3, 3) of an evaluated mesh.

    What renders leave of a mesh has no maps. Then they are those of the mesh before its modifiers,
    whose triangles are known by their places; 0 where there is none.
    """
    for mesh in (obj.data, obj.original.data):
        layer = mesh.attributes.get(name or rendered_map(mesh))
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


class Fields:
    """What a recipe of a material gives in places on a mesh.

    Parameters
    ----------
    to_world : (4, 4), see `frame_of`. names : of the UV maps, in the order in which they are given.
    """

    def __init__(
        self,
        material: str,
        recipe: Recipe,
        mesh: bpy.types.Mesh,
        to_world: np.ndarray,
        names: Sequence[str],
    ) -> None:
        self.recipe = recipe
        self._material, self._names = material, list(names)
        self._space = np.array((mesh.texspace_location, mesh.texspace_size))
        self._to_world = to_world

    @property
    def is_ready(self) -> bool:
        """Whether there are points to evaluate in."""
        return is_ready(self._material, self.recipe)

    def evaluated(
        self, points: np.ndarray, mapped: np.ndarray, maps: np.ndarray, normals: np.ndarray
    ) -> list[list[np.ndarray]]:
        """Of each stage its fields (N, 3).

        Parameters
        ----------
        points, mapped : (N, 3) places in the object's frame, of coordinates that are positions, and
            of those that are attributes.
        maps : (N, 2 · names). normals : (N, 3), in the object's frame.

        Raises
        ------
        NotReady
        """
        known = {
            OBJECT: lambda: points,
            WORLD: lambda: points @ self._to_world[:3, :3].T + self._to_world[:3, 3],
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
        for name in sorted(self.recipe.coordinates):
            write_attribute(mesh, attribute_of(name), known[name](), "FLOAT_VECTOR")
        mesh.update()
        cloud.update_tag()
        layer = cloud.users_scene[0].view_layers[0]
        layer.update()
        found = cloud.evaluated_get(layer.depsgraph).data.attributes
        counters["field_points"] += len(points)
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
            for stage, fields in enumerate(self.recipe.fields)
        ]

    def _cloud(self) -> bpy.types.Object:
        """The points to evaluate in, with this moment's values: others may have used them."""
        found = _ready_points(self._material, self.recipe)
        if found is None:
            raise NotReady
        write_values(found.modifiers[0].node_group, self.recipe)
        return found

    def _generated(self, points: np.ndarray) -> np.ndarray:
        middle, size = self._space[0], 2.0 * self._space[1]
        return (points - middle) * np.divide(1.0, size, out=np.zeros(3), where=size != 0) + 0.5
