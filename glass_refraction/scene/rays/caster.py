# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays against triangles by Geometry Nodes' Raycast: one evaluated modifier is one batch.

The rays and their target lie in a scene of the extension's own, which has a dependency graph of
its own: it can be evaluated within a render's frame-change handler, where the user's must not be.
The target's tree of bounding boxes stays until its triangles change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from ..build.own_scenes import new_object
from ..memory import counters
from ..names import TAG, hidden_name, own
from ..progress import check
from .things import Met, Triangles

FAR = 1e30
"""Stands for no hit, in units of the caster's scale; float32 holds it."""
MOST_PASSED = 32
"""Surfaces one behind another that a ray passes because they do not count."""
BEHIND = 1e-5
"""Part of the way to such a surface by which the ray is put behind it."""
_DIRECTION = "ray"
"""Attribute of the rays' points: their direction; the cast puts its answer there."""
_FACE = "face"
"""Attribute of the corners of the target's triangles: the triangle's number. The Raycast node looks
for values of corners; those of faces it would turn into such for all the target in each cast."""
THINGS = "things"
"""Name of the caster of rays against all that is no glass."""
MESHES = ("meshes 1", "meshes 2", "meshes 3")
"""Names of those against glasses that are meshes: meshes that overlap have each its own, as far as
they go."""


class Caster:
    """Casts batches of rays against one soup of triangles.

    Rays and triangles are handed to Blender as float32, from a centre and in a unit that suit the
    glasses: what lies far from the world's origin keeps its digits.
    """

    def __init__(self, scene: bpy.types.Scene, name: str) -> None:
        self._scene, self._name = scene, name
        self._target: Triangles | None = None
        self._centre, self._scale = np.zeros(3), 1.0

    def _object(self, role: str) -> bpy.types.Object:
        wanted = _role(self._name, role)
        return next(o for o in self._scene.collection.all_objects if own(o, wanted))

    def aim(self, triangles: Triangles, centre: np.ndarray, scale: float) -> None:
        """Take other triangles as the target, unless they are the same."""
        placed = np.array_equal(centre, self._centre) and scale == self._scale
        if placed and triangles.same(self._target):
            self._target = triangles
            return
        self._target, self._centre, self._scale = triangles, np.array(centre, float), float(scale)
        local = ((triangles.points - self._centre) / self._scale).astype(np.float32)
        target = self._object("target")
        _fill(target.data, local, triangles.triangles)
        target.update_tag()
        counters["targets"] += 1

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays first meet a triangle.

        Parameters
        ----------
        origins, directions : (M, 3), world; directions are unit vectors.

        Returns
        -------
        distances : (M,) metres, infinite where nothing is met.
        triangles : (M,) their numbers, −1 where nothing is met.

        Raises
        ------
        Stopped
            Esc was pressed.
        """
        check()
        total = len(origins)
        distances, triangles = np.full(total, np.inf), np.full(total, -1, np.intp)
        if not total or self._target is None or not len(self._target.triangles):
            return distances, triangles
        counters["casts"] += 1
        counters["cast_rays"] += total
        local = ((origins - self._centre) / self._scale).astype(np.float32)
        rays = self._object("rays")
        mesh = rays.data
        if len(mesh.vertices) != total:
            mesh.clear_geometry()
            mesh.vertices.add(total)
            mesh.attributes.new(_DIRECTION, "FLOAT_VECTOR", "POINT")
        mesh.attributes["position"].data.foreach_set("vector", local.ravel())
        ways = np.ascontiguousarray(directions, np.float32)
        mesh.attributes[_DIRECTION].data.foreach_set("vector", ways.ravel())
        mesh.update()
        rays.update_tag()
        layer = self._scene.view_layers[0]
        layer.update()
        found = rays.evaluated_get(layer.depsgraph).data.attributes[_DIRECTION]
        answer = np.empty((total, 3), np.float32)
        found.data.foreach_get("vector", answer.ravel())
        hit = answer[:, 0] < FAR
        distances[hit] = answer[hit, 0].astype(float) * self._scale
        triangles[hit] = answer[hit, 1].astype(np.intp)
        return distances, triangles


class Past:
    """A caster of what counts alone: rays pass all else.

    counts : tells (K,) of what rays would meet which they meet indeed.
    skin : metres by which a ray is put behind others at least.
    """

    def __init__(self, caster: Caster | Past, counts: Counts, skin: float) -> None:
        self._caster, self._counts, self._skin = caster, counts, skin

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Caster.cast`."""
        distance, triangle = self._caster.cast(origins, directions)
        met = Met(triangle, distance, origins, directions)
        left = self._passed(np.arange(len(triangle)), met)
        for _ in range(MOST_PASSED):
            if not len(left):
                return distance, triangle
            passed = distance[left] + np.maximum(self._skin, BEHIND * distance[left])
            begin = origins[left] + passed[:, None] * directions[left]
            further, triangle[left] = self._caster.cast(begin, directions[left])
            distance[left] = passed + further
            left = self._passed(left, met)
        distance[left], triangle[left] = np.inf, -1
        return distance, triangle

    def _passed(self, some: np.ndarray, met: Met) -> np.ndarray:
        """The numbers of those of some rays that meet what does not count."""
        some = some[met.triangle[some] >= 0]
        return some[~self._counts(met.take(some))]


Counts = Callable[[Met], np.ndarray]


def _fill(mesh: bpy.types.Mesh, points: np.ndarray, triangles: np.ndarray) -> None:
    """Make the mesh these triangles, each with its number."""
    mesh.clear_geometry()
    count = len(triangles)
    mesh.vertices.add(len(points))
    mesh.loops.add(3 * count)
    mesh.polygons.add(count)
    # Attributes are copied whole: "co" and "vertex_index" take a hundred times as long.
    places, corners = mesh.attributes["position"].data, mesh.attributes[".corner_vert"].data
    places.foreach_set("vector", np.ascontiguousarray(points).ravel())
    corners.foreach_set("value", np.ascontiguousarray(triangles, np.int32).ravel())
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    numbers = mesh.attributes.new(_FACE, "INT", "CORNER")
    numbers.data.foreach_set("value", np.repeat(np.arange(count, dtype=np.int32), 3))
    mesh.update(calc_edges=False)


@dataclass(frozen=True, eq=False)
class Casters:
    """The casters of one scene of the user's.

    Attributes
    ----------
    scene : own scene that they work in. things, meshes : see `THINGS` and `MESHES`.
    """

    scene: bpy.types.Scene
    things: Caster
    meshes: tuple[Caster, ...]

    @staticmethod
    def of(scene: bpy.types.Scene) -> Casters:
        """Those of an own scene that `fill_cast_collection` has filled."""
        return Casters(scene, Caster(scene, THINGS), tuple(Caster(scene, n) for n in MESHES))


def fill_cast_collection(collection: bpy.types.Collection) -> None:
    """Put each caster's target, rays and node tree that casts them into an own collection."""
    for name in (THINGS, *MESHES):
        target, rays = (
            new_object(role, bpy.data.meshes.new(hidden_name(role)), collection)
            for role in (_role(name, "target"), _role(name, "rays"))
        )
        modifier = rays.modifiers.new("Raycast", "NODES")
        modifier.node_group = _cast_tree(target)


def _role(name: str, part: str) -> str:
    return f"{part} of {name}"


def _cast_tree(target: bpy.types.Object) -> bpy.types.NodeTree:
    """Writes distance and number of the triangle first met into each point's attribute.

    One vector holds both: each attribute that is stored would cast the rays again.
    """
    tree = bpy.data.node_groups.new(hidden_name("cast"), "GeometryNodeTree")
    tree[TAG] = "cast"
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    new, link = tree.nodes.new, tree.links.new
    info = new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = target
    # The original mesh keeps its tree of boxes from one cast to the next.
    info.transform_space = "ORIGINAL"
    direction, number = (
        new("GeometryNodeInputNamedAttribute"),
        new("GeometryNodeInputNamedAttribute"),
    )
    direction.data_type, direction.inputs["Name"].default_value = "FLOAT_VECTOR", _DIRECTION
    number.data_type, number.inputs["Name"].default_value = "INT", _FACE
    ray = new("GeometryNodeRaycast")
    ray.data_type = "INT"
    ray.inputs["Interpolation"].default_value = "Nearest"
    ray.inputs["Ray Length"].default_value = FAR
    link(info.outputs["Geometry"], ray.inputs["Target Geometry"])
    link(number.outputs["Attribute"], ray.inputs["Attribute"])
    link(new("GeometryNodeInputPosition").outputs["Position"], ray.inputs["Source Position"])
    link(direction.outputs["Attribute"], ray.inputs["Ray Direction"])
    choose = new("GeometryNodeSwitch")
    choose.input_type = "FLOAT"
    choose.inputs["False"].default_value = 2.0 * FAR
    link(ray.outputs["Is Hit"], choose.inputs["Switch"])
    link(ray.outputs["Hit Distance"], choose.inputs["True"])
    both = new("ShaderNodeCombineXYZ")
    link(choose.outputs["Output"], both.inputs["X"])
    link(ray.outputs["Attribute"], both.inputs["Y"])
    store = new("GeometryNodeStoreNamedAttribute")
    store.data_type, store.inputs["Name"].default_value = "FLOAT_VECTOR", _DIRECTION
    link(new("NodeGroupInput").outputs["Geometry"], store.inputs["Geometry"])
    link(both.outputs["Vector"], store.inputs["Value"])
    link(store.outputs["Geometry"], new("NodeGroupOutput").inputs["Geometry"])
    return tree
