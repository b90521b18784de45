# SPDX-License-Identifier: GPL-3.0-or-later
"""Glass objects as optics descriptions: shape and media from the modifier, pose from the object."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import bpy
import numpy as np

from ... import optics
from ...optics.axial import AxialGlass
from ...optics.revolution import nested
from ..names import RefractiveGlassError, own
from .animation import may_change
from .bumps import Surfaces
from .glassy_materials import interface_of, opaque_bits, volume_absorption
from .mesh_corners import corners_of
from .mesh_glasses import MeshGlass, placed_corners, placed_opaque
from .modifier_inputs import data_path, glass_modifier, has_input, read_input
from .node_ends import trees
from .visibility import layer_objects, rendered_objects

# Blender's transforms are float32: differences up to this are rounding, not shear.
_RIGID_TOLERANCE = 1e-4
# What goes less deep into a glass than this, relative to its size, stands against it.
_TOUCHING = 1e-3
NAMED_SHAPES = ("Tumbler", "Revolution")
"""Shapes whose light paths name their interfaces (`AxialGlass`)."""
_ON_AXIS = 1e-3
"""Part of a profile's size within which its end counts as on the axis."""
# A liquid less deep than this, relative to its glass's radius, is none.
_SHALLOW = 1e-5
# Limits of absorption: the darkest colour and the shortest distance, metres.
_DARKEST = 1e-6
_SHORTEST = 1e-6
LEAST_LENGTH = float(np.float32(1e-6))
"""Metres, as Blender holds them: rays meet no cylinder or rod that is lower."""


@dataclass(frozen=True, eq=False)
class Glass:
    """A glass of the scene.

    Attributes
    ----------
    name : the object's name.
    description : the optics description, in metres of world scale, in its own frame; of a mesh its
        triangles in the world.
    to_world : (4, 4) float64, rigid: from the description's frame to the world.
    absorption : one (red, green, blue) for each of the description's media: absorption
        coefficients a, per metre; exp(-a length) of the light remains (Beer and Lambert).
    abbe : Abbe numbers of the glass and of its contents; 0: no dispersion.
    band : "red", "green" or "blue" if this is the glass as such light finds it; else empty.
    priority : where glasses overlap, the one of the highest is there.
    """

    name: str
    description: (
        optics.FlatGlass | optics.CylinderGlass | optics.SphereGlass | AxialGlass | MeshGlass
    )
    to_world: np.ndarray
    absorption: tuple[tuple[float, float, float], ...] = ()
    abbe: tuple[float, float] = (0.0, 0.0)
    band: str = ""
    priority: int = 0

    def __post_init__(self) -> None:
        self.to_world.flags.writeable = False

    def stamp(self) -> tuple:
        """What the optics depend on; equal stamps give equal pictures."""
        return (
            self.key,
            self.description,
            self.to_world.tobytes(),
            self.absorption,
            self.abbe,
            self.priority,
        )

    @property
    def key(self) -> str:
        """The glass's name, and that of the light it is computed for."""
        return f"{self.name} \u00b7 {self.band}" if self.band else self.name

    @property
    def disperses(self) -> bool:
        """Whether red, green and blue light go different ways."""
        return any(self.abbe)

    def bands(self) -> tuple[Glass, ...]:
        """The glass as red, green and blue light find it; without dispersion itself alone."""
        if not self.disperses or self.band:
            return (self,)
        return tuple(self.in_light(band) for band in optics.LINES)

    def in_light(self, band: str) -> Glass:
        """The glass as red, green or blue light finds it.

        Raises
        ------
        ValueError
            The Abbe number is too small.
        """
        wavelength, description = optics.LINES[band], self.description

        def ior(medium: float, abbe: float) -> float:
            return optics.dispersed_ior(medium, abbe, wavelength)

        glass, contents = self.abbe
        seen = description.recoloured(
            lambda medium: ior(medium, glass), lambda medium: ior(medium, contents)
        )
        return replace(self, description=seen, band=band)

    def from_world(self) -> np.ndarray:
        """(3, 4) float64: world points into the glass's frame."""
        rotation = self.to_world[:3, :3].T
        return np.column_stack((rotation, -rotation @ self.to_world[:3, 3]))

    def to_local(self, points: np.ndarray) -> np.ndarray:
        """World points (..., 3) in the glass's frame."""
        return (np.asarray(points, float) - self.to_world[:3, 3]) @ self.to_world[:3, :3]

    def direction_to_local(self, directions: np.ndarray) -> np.ndarray:
        """World directions (..., 3) in the glass's frame."""
        return np.asarray(directions, float) @ self.to_world[:3, :3]

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(N,) which world points lie within the outer surface; what only touches it does not."""
        return self.description.encloses(self.to_local(points), _TOUCHING)

    @property
    def is_mesh(self) -> bool:
        """Whether it is a mesh, and no closed form with light paths."""
        return isinstance(self.description, MeshGlass)

    @property
    def is_tinted(self) -> bool:
        """Whether any medium takes light away."""
        return any(any(coefficients) for coefficients in self.absorption)

    def transmittance(self, eye, directions: np.ndarray, path: optics.LightPath) -> np.ndarray:
        """(M, 3) what the media let through along a path; 1 where the ray does not take it.

        Parameters
        ----------
        eye : (3,) or (M, 3); directions : (M, 3); both in the glass's frame.
        """
        lengths, media = optics.path_lengths(self.description.unbounded, eye, directions, path)
        depth = np.einsum("smc,sm->mc", np.asarray(self.absorption)[media], lengths)
        return np.exp(-depth)

    def points_to_world(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the glass's frame in the world."""
        return points @ self.to_world[:3, :3].T + self.to_world[:3, 3]


def put_last(obj: bpy.types.Object) -> None:
    """Have a glass's modifier stand behind all others: what they make of the mesh is the glass.

    Blender puts new modifiers at the end, and those of *Shade Auto Smooth* even behind that: it
    pins them there.
    """
    modifier, last = glass_modifier(obj), len(obj.modifiers) - 1
    if not modifier.use_pin_to_last:
        modifier.use_pin_to_last = True
    if obj.modifiers[last] != modifier:
        obj.modifiers.move(obj.modifiers.find(modifier.name), last)


def glass_objects(view_layer: bpy.types.ViewLayer, *, ever: bool = False) -> list[bpy.types.Object]:
    """The objects of the view layer that are a glass and take part in renders.

    ``ever``: those too that are hidden now and that another frame may show.
    """
    found = []
    for obj in rendered_objects(view_layer, ever=ever):
        modifier = glass_modifier(obj) if obj.type == "MESH" else None
        if modifier is None:
            continue
        switch = f'modifiers["{modifier.name}"].show_render'
        if modifier.show_render or (ever and may_change(obj, switch)):
            found.append(obj)
    return found


_NAMING_SOCKETS = ("NodeSocketObject", "NodeSocketCollection")


def instanced_glasses(view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """Glass objects that renders do not show in their own places, but perhaps by instances.

    Many people keep what they instance in a collection that the view layer excludes, or out of
    renders.
    """
    shown = glass_objects(view_layer, ever=True)
    return [obj for obj in named_glasses(view_layer) if obj not in shown]


def named_glasses(view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """Glass objects of which the view layer's objects may show instances, wherever they stand.

    They are found by what empties, particles and nodes name. The dependency graph would tell what
    is shown; but to list its instances crashes Blender where objects were deleted since.
    """
    meshes = (obj for obj in bpy.data.objects if obj.type == "MESH")
    glasses = [obj for obj in meshes if glass_modifier(obj) is not None]
    if not glasses:
        return []
    named: set[bpy.types.Object] = set()
    left = list(layer_objects(view_layer))
    while left:
        new = set(_named_objects(left.pop())) - named
        named |= new
        left += new
    return [obj for obj in glasses if obj in named]


def all_glasses(view_layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """The glasses that renders of the view layer show, in their own places or by instances."""
    return glass_objects(view_layer) + instanced_glasses(view_layer)


def instances(
    depsgraph: bpy.types.Depsgraph,
) -> Iterator[tuple[bpy.types.Object, bpy.types.DepsgraphObjectInstance]]:
    """Objects that the depsgraph shows by instances, with each instance, which the next replaces.

    Not to be called where nobody has evaluated the scene since objects were deleted.
    """
    for instance in depsgraph.object_instances:
        if instance.is_instance and instance.show_self:
            yield instance.object.original, instance


def _named_objects(host: bpy.types.Object) -> list[bpy.types.Object]:
    """The objects that an object may show instances of.

    Of a collection what is out of renders shows none; an object by itself always does.
    """
    named = [host.instance_collection]
    for particles in host.particle_systems:
        named += [particles.settings.instance_object, particles.settings.instance_collection]
    for modifier in _users_nodes(host):
        nodes = (node for tree in trees(modifier.node_group) for node in tree.nodes)
        named += [getattr(i, "default_value", None) for node in nodes for i in node.inputs]
        for item in modifier.node_group.interface.items_tree:
            socket = getattr(item, "socket_type", "")
            if socket in _NAMING_SOCKETS and has_input(modifier, item.name):
                named.append(read_input(modifier, item.name))
    found = []
    for block in named:
        if isinstance(block, bpy.types.Collection):
            found += [obj for obj in block.all_objects if not obj.hide_render]
        elif isinstance(block, bpy.types.Object):
            found.append(block)
    return found


def _users_nodes(host: bpy.types.Object) -> list[bpy.types.NodesModifier]:
    """The object's Geometry Nodes that are not the extension's."""
    nodes = [m for m in host.modifiers if m.type == "NODES" and m.node_group is not None]
    return [modifier for modifier in nodes if not own(modifier.node_group)]


def merged_glasses(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph
) -> list[tuple[bpy.types.Object, bpy.types.Object]]:
    """Pairs of an object and a glass whose geometry its Geometry Nodes take, but no instance of it.

    What comes of that is no object of its own: no glass, and in renders nothing.
    """
    taken = []
    for host in scene.objects:
        objects = [g for modifier in _users_nodes(host) for g in _taken_objects(modifier)]
        for glass in dict.fromkeys(objects):
            is_glass = glass.type == "MESH" and glass_modifier(glass) is not None
            if is_glass:
                taken.append((host, glass))
    if not taken:
        # Nobody may have evaluated the scene since objects were deleted: to list instances then
        # can crash Blender.
        return []
    instanced = {
        (instance.parent.name, obj.name)
        for obj, instance in instances(depsgraph)
        if instance.parent is not None
    }
    return [(host, glass) for host, glass in taken if (host.name, glass.name) not in instanced]


def _taken_objects(modifier: bpy.types.NodesModifier) -> list[bpy.types.Object]:
    """The objects whose geometry a modifier's node tree takes by Object Info."""
    found = []
    for node in (node for tree in trees(modifier.node_group) for node in tree.nodes):
        if node.type != "OBJECT_INFO" or not node.outputs["Geometry"].is_linked:
            continue
        socket = node.inputs["Object"]
        source = socket.links[0].from_socket if socket.is_linked else None
        if source is None:
            taken = socket.default_value
        elif source.node.type == "GROUP_INPUT" and has_input(modifier, source.name):
            taken = read_input(modifier, source.name)
        else:
            continue
        if isinstance(taken, bpy.types.Object):
            found.append(taken.original)
    return found


def is_shown(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether a render shows the object at the moment of the depsgraph, a glass as a glass."""
    evaluated = obj.evaluated_get(depsgraph)
    modifier = glass_modifier(evaluated) if evaluated.type == "MESH" else None
    return not evaluated.hide_render and (modifier is None or modifier.show_render)


def may_disperse(obj: bpy.types.Object) -> bool:
    """Whether a glass disperses light, or animation may make it."""
    modifier = glass_modifier(obj)
    names = [n for n in ("Abbe Number", "Contents Abbe Number") if has_input(modifier, n)]
    if any(read_input(modifier, name) for name in names):
        return True
    return may_change(obj, *(data_path(modifier, name) for name in names))


def read_glasses(depsgraph: bpy.types.Depsgraph, problems: list[str] | None = None) -> list[Glass]:
    """All glasses of the depsgraph's view layer as they are evaluated there.

    Parameters
    ----------
    problems : takes one line for each glass that cannot be computed, which is then left out.
        Without it the first such glass raises.

    Raises
    ------
    RefractiveGlassError
    """
    glasses, wrong, surfaces = [], [], Surfaces()

    def read(obj: bpy.types.Object, *place) -> None:
        try:
            glasses.append(read_glass(obj, depsgraph, *place, surfaces=surfaces))
        except RefractiveGlassError as error:
            if problems is None:
                raise
            wrong.append(str(error))

    for obj in glass_objects(depsgraph.view_layer, ever=True):
        if is_shown(obj, depsgraph):
            read(obj)
    for obj, instance in instances(depsgraph):
        if obj.type == "MESH" and glass_modifier(obj) is not None:
            read(obj, np.array(instance.matrix_world, float))
    if problems is not None:
        # Of each instance the same.
        problems.extend(dict.fromkeys(wrong + surfaces.problems))
    return glasses


def read_glass(
    obj: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    to_world: np.ndarray | None = None,
    *,
    surfaces: Surfaces | None = None,
) -> Glass:
    """One glass object as it is evaluated in the depsgraph.

    Parameters
    ----------
    to_world : (4, 4) of an instance of it; by default the object's own.
    surfaces : what is known of those of meshes; None: bumps and paint are left out.

    Raises
    ------
    RefractiveGlassError
        Sheared or unevenly scaled object (a mesh may be), mirrored slab, impossible sizes or ior,
        no flat outline; a mesh without faces or of points that are no numbers.
    """
    evaluated = obj.evaluated_get(depsgraph)
    modifier = glass_modifier(evaluated)
    if to_world is None:
        to_world = np.array(evaluated.matrix_world, float)
    shape = read_input(modifier, "Shape")
    if shape == "Mesh":
        bits = opaque_bits(modifier)

        def shape_of_mesh() -> tuple[np.ndarray, ...]:
            if surfaces is None:
                corners, paint = corners_of(evaluated.data, bits), None
            else:
                corners, paint = surfaces.of(evaluated, depsgraph, bits, to_world)
            placed = placed_corners(corners, to_world, paint)
            return *placed, placed_opaque(evaluated, to_world, bits)

        return _read_mesh(evaluated, depsgraph, to_world, shape_of_mesh)
    _check_place(to_world, obj.name)
    if shape != "Slab" and np.linalg.det(to_world[:3, :3]) < 0.0:
        # What is turned round an axis is its own mirror image.
        to_world = to_world * (-1.0, 1.0, 1.0, 1.0)
    pose, scale = rigid_pose(to_world, obj.name)
    size = {
        key: float(read_input(modifier, name)) * scale
        for key, name in (("radius", "Radius"), ("wall", "Wall Thickness"), ("height", "Height"))
    }
    ior = float(read_input(modifier, "IOR"))
    contents = float(read_input(modifier, "Contents IOR"))
    try:
        if shape == "Slab":
            outline, frame = _flat_outline(obj, scale)
            description = optics.FlatGlass(
                (size["wall"],), (ior,), ior_below=contents, outline=outline
            )
            pose = pose @ frame
        elif shape == "Tumbler":
            bottom, level = (
                float(read_input(modifier, name)) * scale
                for name in ("Bottom Thickness", "Liquid Level")
            )
            description = _tumbler(size, bottom, level, ior, contents)
        elif shape == "Revolution":
            level = float(read_input(modifier, "Liquid Level")) * scale
            profile = read_input(modifier, "Profile")
            description = _revolution(profile, depsgraph, scale, ior, contents, level)
        else:
            description = _coaxial(shape, size, ior, contents)
    except ValueError as error:
        raise RefractiveGlassError(f'Glass "{obj.name}": {error}') from error
    abbe = tuple(
        float(read_input(modifier, name)) if has_input(modifier, name) else 0.0
        for name in ("Abbe Number", "Contents Abbe Number")
    )
    absorption = _absorption(modifier, description, scale)
    glass = Glass(obj.name, description, pose, absorption, abbe, priority=_priority(modifier))
    try:
        glass.bands()
    except ValueError as error:
        raise RefractiveGlassError(f'Glass "{obj.name}": {error}') from error
    return glass


def read_mesh_interface(
    evaluated: bpy.types.Object, depsgraph: bpy.types.Depsgraph, to_world: np.ndarray
) -> Glass:
    """An (evaluated) glass that is a mesh, without its triangles, in a place (4, 4).

    Raises
    ------
    RefractiveGlassError
    """
    nothing = np.zeros((0, 3, 3))
    shape = nothing, nothing, None, None, nothing
    return _read_mesh(evaluated, depsgraph, to_world, lambda: shape)


def _read_mesh(
    evaluated: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    to_world: np.ndarray,
    shape: Callable[[], tuple],
) -> Glass:
    """A glass that is a mesh; ``shape`` gives its points, its normals, those from within, its paint
    and its opaque triangles."""
    name, modifier = evaluated.name, glass_modifier(evaluated)
    _check_place(to_world, name)
    try:
        interface = interface_of(evaluated, depsgraph, float(read_input(modifier, "IOR")))
        points, normals, within, paint, opaque = shape()
        if paint is not None:
            interface = replace(interface, roughness=paint.roughness)
        description = MeshGlass(
            points, normals, opaque=opaque, within=within, paint=paint, **vars(interface)
        )
        # Lengths are counted in units of the object, as those of other shapes.
        scale = float(np.cbrt(abs(np.linalg.det(to_world[:3, :3]))))
        clear, inside = _absorption(modifier, description, scale)
        inside = np.array(inside) + volume_absorption(evaluated, depsgraph)
        absorption = (clear, tuple(map(float, inside)))
        abbe = (float(read_input(modifier, "Abbe Number")), 0.0)
        glass = Glass(name, description, np.eye(4), absorption, abbe, priority=_priority(modifier))
        glass.bands()
    except ValueError as error:
        raise RefractiveGlassError(f'Glass "{name}": {error}') from error
    return glass


def _priority(modifier) -> int:
    return int(read_input(modifier, "Priority")) if has_input(modifier, "Priority") else 0


def is_mesh_glass(obj: bpy.types.Object) -> bool:
    """Whether the object's own mesh is the glass, no closed form."""
    modifier = glass_modifier(obj) if obj.type == "MESH" else None
    return modifier is not None and read_input(modifier, "Shape") == "Mesh"


def _absorption(modifier, description, scale: float) -> tuple[tuple[float, float, float], ...]:
    """Coefficients of every medium; what lies around a glass takes no light."""
    clear = (0.0, 0.0, 0.0)
    found = []
    for medium in ("", "Contents "):
        if not has_input(modifier, f"{medium}Absorption Color"):
            found.append(clear)
            continue
        colour = np.array(read_input(modifier, f"{medium}Absorption Color"), float)[:3]
        distance = float(read_input(modifier, f"{medium}Absorption Distance")) * scale
        # Black at no distance would be infinitely dense: as good as.
        depth = -np.log(np.clip(colour, _DARKEST, 1.0)) / max(distance, _SHORTEST)
        found.append(tuple(float(a) for a in depth + 0.0))
    glass, contents = found
    if not description.has_contents:
        # The length behind a slab is not the glass's: it ends wherever something is.
        contents = clear
    return (clear, glass, contents)[: len(description.media)]


def _coaxial(shape: str, size: dict[str, float], ior: float, contents: float):
    """The description of a cylinder, rod or sphere from its sizes in metres."""
    radius, wall = size["radius"], size["wall"]
    hollow = shape == "Cylinder" or (shape == "Sphere" and wall > 0)
    if hollow and not 0 < wall < radius:
        raise ValueError(f"wall thickness {wall:g} m must be between 0 and the radius {radius:g} m")
    radii, media = ((radius, radius - wall), (ior, contents)) if hollow else ((radius,), (ior,))
    if shape == "Sphere":
        return optics.SphereGlass(radii, media)
    if not (math.isfinite(size["height"]) and size["height"] >= LEAST_LENGTH):
        raise ValueError(f"height {size['height']:g} m must be {LEAST_LENGTH:g} m or more")
    return optics.CylinderGlass(radii, media, extent=(0.0, size["height"]))


def _tumbler(size: dict[str, float], bottom: float, level: float, ior: float, contents: float):
    """The description of a tumbler from its sizes in metres; more than full is full."""
    radius, wall, height = size["radius"], size["wall"], size["height"]
    for name, value, limit in (("wall", wall, radius), ("bottom", bottom, height)):
        if not 0 < value < limit:
            of = "radius" if name == "wall" else "height"
            raise ValueError(
                f"{name} thickness {value:g} m must be between 0 and the {of} {limit:g} m"
            )
    level = min(max(level, 0.0), height - bottom)
    if level < _SHALLOW * radius:
        level = 0.0
    return optics.Tumbler(radius, wall, height, bottom, ior, contents, level)


def _revolution(profile, depsgraph, scale: float, ior: float, contents: float, level: float):
    """The description of a glass whose profile is a curve object; more than full is full."""
    if profile is None or profile.type != "CURVE":
        raise ValueError("choose a curve object as its profile")
    splines = profile.evaluated_get(depsgraph).data.splines
    if not 1 <= len(splines) <= 2:
        raise ValueError(
            f'profile "{profile.name}" must have one spline or two, the outside and the inside, '
            f"not {len(splines)}"
        )
    sides = [_profile_points(spline) * scale for spline in splines]
    inner = None
    if len(sides) == 2:
        inner = sides[1]
        nodes = inner[:, 1] if inner.ndim == 3 else inner
        level = min(max(level, 0.0), float(nodes[-1, 1] - nodes[0, 1]))
    if inner is None or level < _SHALLOW * scale * np.abs(sides[0]).max():
        level = None
    outer, inner = (None if side is None else nested(side) for side in (sides[0], inner))
    return _kept_revolution(outer, inner, ior, contents, level)


@lru_cache(maxsize=32)
def _kept_revolution(outer, inner, ior: float, contents: float, level: float | None):
    """One description for equal profiles: it keeps tables that take time to make."""
    return optics.RevolutionGlass(outer, inner, ior, contents, level)


def _profile_points(spline) -> np.ndarray:
    """Radius and height of a spline's points: (K, 3, 2) with handles, or (K, 2)."""
    if spline.type == "BEZIER":
        points = np.array(
            [(p.handle_left, p.co, p.handle_right) for p in spline.bezier_points], float
        )
        nodes = points[:, 1]
    else:
        points = np.array([p.co[:3] for p in spline.points], float)
        nodes = points
    if len(nodes) < 2:
        raise ValueError("each spline of the profile must have two or more points")
    # Rounded to the axis: a curve drawn by hand ends there nearly.
    found = points[..., (0, 2)]
    ends = found[[0, -1], 1] if found.ndim == 3 else found[[0, -1]]
    reach = np.abs(found).max()
    for number, end in zip((0, -1), ends, strict=True):
        if abs(end[0]) < _ON_AXIS * reach:
            if found.ndim == 3:
                found[number, 1, 0] = 0.0
            else:
                found[number, 0] = 0.0
    return found


def as_body(glass: Glass) -> Glass | None:
    """The glass with all the faces that bound it; None if that is nothing that rays can meet."""
    if glass.is_mesh:
        return glass
    body = optics.body(glass.description)
    return None if body is None else replace(glass, description=body)


def as_bodies(glasses: Iterable[Glass]) -> list[Glass]:
    """`as_body` of all glasses that are one."""
    return [body for body in map(as_body, glasses) if body is not None]


def rigid_pose(matrix: np.ndarray, name: str) -> tuple[np.ndarray, float]:
    """Split a finite world matrix (4, 4) with an inverse into a rigid one and a uniform scale.

    Raises
    ------
    RefractiveGlassError
        The matrix shears, mirrors or scales unevenly.
    """
    linear = matrix[:3, :3]
    determinant = np.linalg.det(linear)
    scale = float(np.cbrt(determinant))
    rotation = linear / scale
    if scale < 0 or np.abs(rotation.T @ rotation - np.eye(3)).max() > _RIGID_TOLERANCE:
        raise RefractiveGlassError(
            f'Glass "{name}" is sheared, mirrored or scaled unevenly: apply its scale (Ctrl A) or '
            "clear it, also on its parents"
        )
    # The nearest rotation: float32 matrices are orthogonal to seven digits only.
    u, _, vt = np.linalg.svd(rotation)
    pose = np.eye(4)
    pose[:3, :3] = u @ vt
    pose[:3, 3] = matrix[:3, 3]
    return pose, scale


def _check_place(matrix: np.ndarray, name: str) -> None:
    """Raise where a glass's world matrix (4, 4) is not finite or has no inverse."""
    if not np.all(np.isfinite(matrix)):
        raise RefractiveGlassError(
            f'Glass "{name}" has a place that is no number: enter its location, rotation and scale '
            "anew"
        )
    if np.linalg.det(matrix[:3, :3]) == 0:
        raise RefractiveGlassError(f'Glass "{name}" has no size: its scale must not be zero')


def _flat_outline(obj: bpy.types.Object, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """The boundary polygon (K, 2), in metres, of a flat mesh and the frame (4, 4) of its plane.

    The frame's z is the mesh's normal; its origin lies in the plane (in metres of world scale).
    """
    mesh = obj.data
    if not len(mesh.polygons):
        raise ValueError("a slab's mesh must have a face: it is the slab's outline")
    loop = _boundary_loop(mesh)
    corners = np.array([mesh.vertices[i].co for i in loop], float) * scale
    origin = corners.mean(axis=0)
    area = sum((np.array(p.normal) * p.area for p in mesh.polygons), np.zeros(3))
    length = np.linalg.norm(area)
    if length == 0:
        raise ValueError("a slab's mesh must have an area")
    normal = area / length
    extent = np.ptp(corners, axis=0).max()
    if np.abs((corners - origin) @ normal).max() > 1e-4 * extent:
        raise ValueError("a slab's mesh must be flat")
    frame = np.eye(4)
    # The helper axis is the one least along the normal, so an upright pane keeps x and y.
    helper = np.eye(3)[int(np.argmin(np.abs(normal[:2])))] if abs(normal[2]) < 0.9 else np.eye(3)[0]
    x = helper - normal * (helper @ normal)
    x /= np.linalg.norm(x)
    frame[:3, :3] = np.column_stack((x, np.cross(normal, x), normal))
    frame[:3, 3] = origin
    return (corners - origin) @ frame[:3, :2], frame


def _boundary_loop(mesh: bpy.types.Mesh) -> list[int]:
    """The vertices round the mesh's one boundary, in order."""
    neighbours: dict[int, list[int]] = {}
    uses: dict[tuple[int, int], int] = {}
    for polygon in mesh.polygons:
        for key in polygon.edge_keys:
            uses[key] = uses.get(key, 0) + 1
    for (a, b), count in uses.items():
        if count == 1:
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
    if not neighbours or any(len(n) != 2 for n in neighbours.values()):
        raise ValueError("a slab's mesh must have one simple boundary")
    start = min(neighbours)
    loop, previous = [start], None
    while True:
        following = next((n for n in neighbours[loop[-1]] if n != previous), start)
        if following == start:
            break
        previous = loop[-1]
        loop.append(following)
    if len(loop) != len(neighbours):
        raise ValueError("a slab's mesh must have one boundary without holes")
    return loop
