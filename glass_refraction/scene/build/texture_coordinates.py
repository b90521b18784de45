# SPDX-License-Identifier: GPL-3.0-or-later
"""What materials read of the place and the object that they are on, kept for displaced copies.

A copy's mesh lies where the source appears and its object stands at the origin. Materials that
read the place (Generated, Object, Position, ...) would see that. So the carrier holds the source's
coordinates as point attributes, and the copy wears *substitutes*: the extension's own duplicates
of the materials, in which Attribute nodes read those attributes, or the source's own properties
through the copy's custom property ``rg_source``.

:func:`substitute` and :func:`dress` make data-blocks; all else may run in a frame-change handler.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import cache

import bpy
import numpy as np

from ..names import TAG, hidden_name, own
from ..read.arrays import positions, write_attribute
from ..read.node_ends import trees
from ..read.sources import Piece, is_carried, pieces, world_positions
from .node_sums import NodeSums

GENERATED, OBJECT, POSITION = "rg_generated", "rg_object", "rg_position"
COORDINATES = frozenset({GENERATED, OBJECT, POSITION})
"""The point attributes that a carrier may hold; the copy's node group hands them on."""

ROLE = "substitute"

_ORIGINAL = "refractive_glass_original"
_FINGERPRINT = "refractive_glass_fingerprint"
_COORDINATES = "refractive_glass_coordinates"

# The source as materials reach it from the copy: Attribute nodes resolve paths through pointers.
_SOURCE = "rg_source"
# What no path leads to: the columns of the source's matrix (driven) and its random number.
_AXES = ("rg_axis_x", "rg_axis_y", "rg_axis_z", "rg_origin")
_RANDOM = "rg_random"

# How a socket's value hangs on the object, beside the three attributes.
_TARGET, _NORMAL, _LOCATION, _OF_SOURCE = "target", "normal", "location", "source"

_OUTPUTS = {
    "ShaderNodeTexCoord": {"Generated": GENERATED, "Object": OBJECT, "Normal": _NORMAL},
    "ShaderNodeNewGeometry": {"Position": POSITION},
    "ShaderNodeObjectInfo": {
        "Location": _LOCATION,
        "Color": _OF_SOURCE,
        "Alpha": _OF_SOURCE,
        "Object Index": _OF_SOURCE,
        "Random": _RANDOM,
    },
}
# What textures read where nothing is linked; Image and White Noise textures do not ask the object.
_UNLINKED = {
    f"ShaderNodeTex{name}": GENERATED
    for name in ("Brick", "Checker", "Gabor", "Gradient", "Magic", "Noise", "Voronoi", "Wave")
} | {"ShaderNodeTexEnvironment": POSITION}
_SOURCE_PATHS = {"Color": "color", "Alpha": "color", "Object Index": "pass_index"}

# Data of their own, in which a material's settings do not go on.
_NESTED = (bpy.types.ID, bpy.types.Node, bpy.types.NodeSocket)

_UINT = 0xFFFFFFFF

# Written by another version, substitutes are made anew.
_VERSION = "1"


def dressed_coordinates(copy: bpy.types.Object) -> frozenset[str]:
    """Which of :data:`COORDINATES` a copy's materials use, as of the last :func:`dress`."""
    return frozenset(copy.get(_COORDINATES, "").split())


def coordinates(parts: list[Piece], names: Collection[str]) -> dict[str, np.ndarray]:
    """The named coordinates, each (N, 3) float32, of all vertices in the carrier's order.

    Generated coordinates are those before modifiers where the evaluated mesh holds them, as it does
    in a render and in a viewport that shows materials; elsewhere Blender itself has only the
    deformed ones. They may thus differ between depsgraphs where the positions do not: compare them
    too before a carrier is left as it is.
    """
    return {
        name: np.concatenate(
            [_VALUES[name](part) for part in parts] or [np.empty((0, 3))], dtype=np.float32
        )
        for name in sorted(names)
    }


def write_coordinates(mesh: bpy.types.Mesh, values: dict[str, np.ndarray], slots: int = 1) -> None:
    """Store coordinates as the carrier's point attributes, repeated for each image slot."""
    for name, value in values.items():
        write_attribute(mesh, name, np.tile(value, (slots, 1)), "FLOAT_VECTOR")


def _generated(part: Piece) -> np.ndarray:
    """As renderers make them: 0 to 1 over the texture space."""
    undeformed = np.empty((len(part.mesh.vertices), 3), np.float32)
    part.mesh.vertices.foreach_get("undeformed_co", undeformed.ravel())
    space = part.mesh.texture_mesh or part.mesh
    size = 2.0 * np.array(space.texspace_size)
    scale = np.divide(1.0, size, out=np.zeros(3), where=size != 0)
    return (undeformed - np.array(space.texspace_location)) * scale + 0.5


_VALUES: dict[str, Callable[[Piece], np.ndarray]] = {
    GENERATED: _generated,
    OBJECT: lambda part: positions(part.mesh),
    POSITION: lambda part: world_positions([part]),
}


def slot_materials(
    source: bpy.types.Object, depsgraph: bpy.types.Depsgraph
) -> list[bpy.types.Material | None]:
    """The (original) materials by the slots of the geometry that a copy takes from the source.

    Modifiers may bring slots that the object does not have, and Realize Instances merges the slots
    of instances: one a material, in the order of their first use.
    """
    evaluated = source.evaluated_get(depsgraph)
    with pieces(source, depsgraph) as parts:
        lists = [list(part.mesh.materials) for part in parts]
        alone = len(parts) == 1 and (not is_carried(source) or parts[0].mesh == evaluated.data)
    if not alone:
        return [_original(m) for m in dict.fromkeys(m for found in lists for m in found)]
    found = lists[0]
    # Renderers let slots that are linked to the object win; Object Info does not know of them.
    for index, slot in enumerate(evaluated.material_slots):
        if slot.link == "OBJECT":
            found += [None] * (index + 1 - len(found))
            found[index] = slot.material
    return [_original(m) for m in found]


def _original(material: bpy.types.Material | None) -> bpy.types.Material | None:
    return None if material is None else material.original


def _reads(material: bpy.types.Material | None) -> frozenset[str]:
    """In which ways the material hangs on the object that it is on."""
    if material is None or material.node_tree is None or own(material):
        return frozenset()
    return frozenset(kind for tree in trees(material.node_tree) for kind, _ in _bound_sockets(tree))


def _attributes(reads: Iterable[str]) -> frozenset[str]:
    reads = set(reads)
    return frozenset(reads & COORDINATES | ({POSITION} if _TARGET in reads else set()))


def _bound_sockets(tree: bpy.types.NodeTree) -> Iterator[tuple[str, bpy.types.NodeSocket]]:
    """Outputs, and inputs that nothing feeds, whose values hang on the object; and how."""
    for node in tree.nodes:
        if node.mute:
            continue
        if getattr(node, "attribute_type", None) in {"OBJECT", "INSTANCER"}:
            yield from ((_OF_SOURCE, s) for s in node.outputs if s.is_linked)
        for name, kind in _OUTPUTS.get(node.bl_idname, {}).items():
            if not node.outputs[name].is_linked:
                continue
            if kind == OBJECT and node.object is not None:
                kind = _TARGET
            if not (kind == GENERATED and node.from_instancer):
                yield kind, node.outputs[name]
        kind = _UNLINKED.get(node.bl_idname)
        if kind and node.inputs["Vector"].enabled and not _is_fed(node.inputs["Vector"]):
            yield kind, node.inputs["Vector"]


def _is_fed(socket: bpy.types.NodeSocket) -> bool:
    """Whether a node gives the input its value; links from nowhere count as no link."""
    for link in socket.links:
        if link.is_muted:
            continue
        node = link.from_node
        if node.bl_idname == "NodeReroute":
            return _is_fed(node.inputs[0])
        if node.mute:
            through = [i for i in node.internal_links if i.to_socket == link.from_socket]
            return any(_is_fed(i.from_socket) for i in through)
        return True
    return False


def substitute(material: bpy.types.Material) -> bpy.types.Material:
    """The material for copies: the original itself where it does not hang on the object.

    The original is never changed. Its substitute is made once and again after each change of the
    original; users of the former substitute then use the new one.
    """
    if not _reads(material):
        return material
    fingerprint = _fingerprint(material)
    former = next((m for m in bpy.data.materials if _stands_for(m, material)), None)
    if former is not None and former.get(_FINGERPRINT) == fingerprint:
        return former
    made = material.copy()
    made.use_fake_user = False
    made[TAG] = ROLE
    made[_ORIGINAL] = material.name_full
    made[_FINGERPRINT] = fingerprint
    _rewrite(made.node_tree, {})
    if former is not None:
        former.user_remap(made)
        bpy.data.materials.remove(former)
        _remove_unused_groups()
    made.name = hidden_name(ROLE, material.name)
    return made


def _stands_for(candidate: bpy.types.Material, material: bpy.types.Material) -> bool:
    is_for = own(candidate, ROLE) and candidate.get(_ORIGINAL) == material.name_full
    return is_for and candidate.library is None


def dress(
    copies: Iterable[bpy.types.Object],
    source: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    override: bpy.types.Material | None = None,
) -> None:
    """Give a source's copies its materials or their substitutes, and what these read of it.

    ``override``: the material that all objects of the view layer wear in place of their own.

    The materials sit in slots that are linked to the copy object: those win over the slots of the
    geometry, whether it comes from the source or is the carrier's own.
    """
    materials = slot_materials(source, depsgraph)
    if override is not None:
        materials = [override] * max(1, len(materials))
    reads = set().union(*(_reads(m) for m in materials))
    substitutes = {m: substitute(m) for m in set(materials) - {None}}
    for copy in copies:
        _fill_slots(copy, [substitutes.get(m) for m in materials])
        _set(copy, _COORDINATES, " ".join(sorted(_attributes(reads))))
        if _OF_SOURCE in reads:
            _set(copy, _SOURCE, source)
        if _RANDOM in reads:
            _set(copy, _RANDOM, _random(source))
        if reads & {_NORMAL, _LOCATION} and _AXES[0] not in copy:
            for column, name in enumerate(_AXES):
                copy[name] = (0.0, 0.0, 0.0)
                for row in range(3):
                    _drive(copy, f'["{name}"]', row, source, column, row)


def _fill_slots(copy: bpy.types.Object, wanted: list[bpy.types.Material | None]) -> None:
    slots = copy.data.materials
    while len(slots) > len(wanted):
        slots.pop()
    while len(slots) < len(wanted):
        slots.append(None)
    # Blender may leave the object more slots than its mesh has.
    surplus = [None] * (len(copy.material_slots) - len(wanted))
    for slot, material in zip(copy.material_slots, [*wanted, *surplus], strict=True):
        if slot.link != "OBJECT":
            slot.link = "OBJECT"
        if slot.material != material:
            slot.material = material


def remove_unused() -> None:
    """Remove the substitutes and their groups that nobody uses."""
    for material in [m for m in bpy.data.materials if own(m, ROLE) and m.users == 0]:
        bpy.data.materials.remove(material)
    _remove_unused_groups()


def _remove_unused_groups() -> None:
    # A removed group may have been the last user of another.
    while unused := [g for g in bpy.data.node_groups if own(g, ROLE) and g.users == 0]:
        for group in unused:
            bpy.data.node_groups.remove(group)


def _set(copy: bpy.types.Object, name: str, value) -> None:
    """Set a custom property only if it differs: a write tags the object for evaluation."""
    if copy.get(name) != value:
        copy[name] = value


def _random(source: bpy.types.Object) -> float:
    """Object Info's Random, which both engines hash from the object's name (Jenkins' lookup3)."""
    name = 0
    for byte in source.name.encode():
        name = (37 * name + byte) & _UINT
    start = 0xDEADBEEF + (2 << 2) + 13
    a, b, c = (start + name) & _UINT, start, start
    for bits in (14, 11, 25, 16, 4, 14, 24):
        mixed = (c ^ b) - (b << bits | b >> (32 - bits)) & _UINT
        # The three change in turn, each by the one just made: ``c``, ``a``, ``b``, ``c``, ...
        a, b, c = b, mixed, a
    return b / _UINT


def _drive(owner, path: str, index: int, target: bpy.types.Object, column: int, row: int) -> None:
    """Let a number follow one of the target's world matrix."""
    driver = owner.driver_add(path, index).driver
    # A sum of one: needs no Python, which users may have forbidden.
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.targets[0].id = target
    # Paths count a matrix's columns first.
    variable.targets[0].data_path = f"matrix_world[{column}][{row}]"


def _rewrite(tree: bpy.types.NodeTree, groups: dict) -> None:
    """Feed all that hangs on the object from attributes; groups become own duplicates."""
    builder = _Builder(tree)
    # Nodes are added on the way: list first.
    for kind, socket in list(_bound_sockets(tree)):
        value = builder.replacement(kind, socket)
        if not socket.is_output:
            tree.links.new(value, socket)
            continue
        for link in list(socket.links):
            muted, target = link.is_muted, link.to_socket
            tree.links.new(value, target).is_muted = muted
    for node in tree.nodes:
        if node.type == "GROUP" and node.node_tree is not None:
            node.node_tree = _own_group(node.node_tree, groups)


def _own_group(group: bpy.types.NodeTree, groups: dict) -> bpy.types.NodeTree:
    if group not in groups:
        groups[group] = group
        if any(True for tree in trees(group) for _ in _bound_sockets(tree)):
            made = groups[group] = group.copy()
            made.use_fake_user = False
            made[TAG] = ROLE
            made.name = hidden_name(ROLE, group.name)
            _rewrite(made, groups)
    return groups[group]


class _Builder(NodeSums):
    """Adds the nodes that stand for what hangs on the object to one tree, each once."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self._attributes: dict[tuple[str, str], bpy.types.Node] = {}

    def replacement(self, kind: str, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The output to read instead of the socket (or to link to it, if it is an input)."""
        node = socket.node
        if kind in COORDINATES:
            return self._attribute("GEOMETRY", kind).outputs["Vector"]
        if kind == _TARGET:
            return self._in_frame_of(node.object)
        if kind == _NORMAL:
            return self._object_normal()
        if kind == _LOCATION:
            return self._attribute("OBJECT", _AXES[3]).outputs["Vector"]
        if kind == _RANDOM:
            return self._attribute("OBJECT", _RANDOM).outputs["Fac"]
        if node.bl_idname == "ShaderNodeAttribute":
            return self._of_source(node.attribute_name).outputs[socket.name]
        name = "Fac" if socket.name == "Object Index" else socket.name
        return self._of_source(_SOURCE_PATHS[socket.name]).outputs[name]

    def _attribute(self, kind: str, name: str) -> bpy.types.Node:
        if (kind, name) not in self._attributes:
            self._attributes[kind, name] = self._node(
                "ShaderNodeAttribute", attribute_type=kind, attribute_name=name
            )
        return self._attributes[kind, name]

    def _of_source(self, name: str) -> bpy.types.Node:
        """A property of the source by its RNA path or, first, the name of a custom property."""
        if not name.startswith("["):
            first = name.split(".")[0].split("[")[0]
            name = f".{name}" if first in bpy.types.Object.bl_rna.properties else f'["{name}"]'
        return self._attribute("OBJECT", f'["{_SOURCE}"]{name}')

    def _object_normal(self) -> bpy.types.NodeSocket:
        """The normal in the source's frame: the copy's own is the source's in the world."""
        normal = self._node("ShaderNodeNewGeometry").outputs["Normal"]
        axes = [self._attribute("OBJECT", name).outputs["Vector"] for name in _AXES[:3]]
        return self._vector(
            "NORMALIZE", self._joined([self._vector("DOT_PRODUCT", a, normal) for a in axes])
        )

    def _in_frame_of(self, target: bpy.types.Object) -> bpy.types.NodeSocket:
        """The true place in the frame of another object, which may move (Cramer's rule)."""
        place = self._attribute("GEOMETRY", POSITION).outputs["Vector"]
        columns = []
        for column in range(4):
            node = self._node("ShaderNodeCombineXYZ")
            for row in range(3):
                _drive(node.inputs[row], "default_value", -1, target, column, row)
            columns.append(node.outputs[0])
        x, y, z, origin = columns
        place = self._vector("SUBTRACT", place, origin)
        duals = [self._vector("CROSS_PRODUCT", *pair) for pair in ((y, z), (z, x), (x, y))]
        volume = self._vector("DOT_PRODUCT", x, duals[0])
        scaled = self._joined([self._vector("DOT_PRODUCT", place, dual) for dual in duals])
        return self._vector("DIVIDE", scaled, volume)

    def _joined(self, values: list[bpy.types.NodeSocket]) -> bpy.types.NodeSocket:
        node = self._node("ShaderNodeCombineXYZ")
        for value, socket in zip(values, node.inputs, strict=True):
            self._link(value, socket)
        return node.outputs[0]


def _fingerprint(material: bpy.types.Material) -> str:
    """A digest of all that a substitute takes from the material, groups included.

    Values that are animated or driven are left out: they follow in the substitute by themselves.
    """
    digest = hashlib.blake2b(_VERSION.encode(), digest_size=16)
    # Reading ``use_nodes``, which is always True by now, warns.
    skipped = {*bpy.types.ID.bl_rna.properties.keys(), "use_nodes"}
    for line in _state(material, "", skipped, _moving(material)):
        digest.update(line.encode())
    for tree in trees(material.node_tree):
        for line in _tree_state(tree):
            digest.update(line.encode())
    return digest.hexdigest()


def _tree_state(tree: bpy.types.NodeTree) -> Iterator[str]:
    moving = _moving(tree)
    yield from (f"{path} {driver}" for path, driver in sorted(moving.items()))
    # What all nodes have is layout and selection.
    skipped = set(bpy.types.Node.bl_rna.properties.keys())
    for node in tree.nodes:
        path = f'nodes["{bpy.utils.escape_identifier(node.name)}"]'
        yield f"{path} {node.bl_idname} {node.mute}"
        yield from _state(node, f"{path}.", skipped, moving)
        for side in ("inputs", "outputs"):
            for index, socket in enumerate(getattr(node, side)):
                value_path = f"{path}.{side}[{index}].default_value"
                if value_path not in moving:
                    yield f"{value_path} {_plain(getattr(socket, 'default_value', None))}"
    for link in tree.links:
        ends = (link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        yield f"{link.from_node.name} {ends} {link.is_muted}"


def _state(struct, path: str, skipped: set[str], moving: Collection[str]) -> Iterator[str]:
    """The settings of a piece of Blender data, with those of the pieces in it."""
    for name, kind, is_readonly in _properties(type(struct)):
        if name in skipped:
            continue
        # An add-on may have taken its property away meanwhile.
        value = getattr(struct, name, None)
        inner = ()
        if kind == "COLLECTION":
            inner = [(f"{path}{name}[{i}].", item) for i, item in enumerate(value or ())]
        elif kind == "POINTER" and value is not None and not isinstance(value, _NESTED):
            inner = [(f"{path}{name}.", value)]
        elif not is_readonly and path + name not in moving:
            yield f"{path}{name} {_plain(value)}"
        for inner_path, item in inner:
            if not isinstance(item, _NESTED):
                # ``frame_current`` of a film follows the scene.
                yield from _state(item, inner_path, {"rna_type", "frame_current"}, moving)


@cache
def _properties(kind: type) -> list[tuple[str, str, bool]]:
    """Name, type and whether it is read-only of each property: slow to ask of every node."""
    return [(p.identifier, p.type, p.is_readonly) for p in kind.bl_rna.properties]


def _plain(value) -> str:
    """The value as text that is the same in every session."""
    if isinstance(value, bpy.types.ID):
        return f"{value.rna_type.identifier} {value.name_full}"
    if isinstance(value, _NESTED):
        return value.name
    if isinstance(value, (str, int, float, set)) or value is None:
        return repr(sorted(value) if isinstance(value, set) else value)
    return repr(list(value))


def _moving(data_block: bpy.types.ID) -> dict[str, str]:
    """RNA paths of what is animated or driven, with what tells one driver from another."""
    animation = data_block.animation_data
    if animation is None:
        return {}
    found = {}
    for layer in animation.action.layers if animation.action else ():
        bags = [bag for strip in layer.strips for bag in strip.channelbags]
        found |= {curve.data_path: "" for bag in bags for curve in bag.fcurves}
    for curve in animation.drivers:
        targets = [
            (v.name, v.type, _plain(t.id), t.data_path)
            for v in curve.driver.variables
            for t in v.targets
        ]
        state = f"{curve.array_index} {curve.driver.type} {curve.driver.expression} {targets} "
        found[curve.data_path] = found.get(curve.data_path, "") + state
    return found
