# SPDX-License-Identifier: GPL-3.0-or-later
"""What nodes make a glassy material's bumps, colours and roughness, as plain values: what the
extension builds its own trees of.

Shader nodes cannot be evaluated in places of one's choice. Most textures and maths are nodes of
geometry trees too, by the same code; the others are told by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import bpy

from ..changes import shape_generation
from .glassy_materials import PAINTED, interface_node

GENERATED, OBJECT, WORLD, NORMAL, UV = "generated", "object", "world", "normal", "uv "
"""Coordinates that the points of a tree carry as attributes; that of a UV map ends in its name."""


class Untranslatable(Exception):
    """What cannot be evaluated, for the user."""


Out = tuple[int, str]
"""An output: the number of its node, and its identifier."""


@dataclass(frozen=True)
class Stage:
    """A node that tilts normals, and the next one tilts what it gives; or a shader.

    Attributes
    ----------
    kind : "BUMP", "DISPLACEMENT" with its space, the space of a normal map, or a shader's type.
    inverts : heights are depths.
    uv : the UV map of a normal map in tangent space; empty: the one that renders use.
    """

    kind: str
    inverts: bool = False
    uv: str = ""

    @property
    def is_map(self) -> bool:
        """Whether the normal itself is given, no height."""
        return not self.kind.startswith(("BUMP", "DISPLACEMENT"))


@dataclass
class Recipe:
    """Nodes of a geometry tree, and what they compute.

    Attributes
    ----------
    nodes : (idname, properties) of each. links : (node, output, node, input), by identifiers.
    values : (node, socket or part, value) of what may be animated.
    stages : what tilts the normals, in order; or the shader. fields : of each stage the vectors it
        takes: height, strength and distance; height, middle and scale; colour and, by another node,
        strength; or the inputs of `PAINTED`.
    coordinates : attributes that are read.
    images : what is looked up: of each the session uid, and what is equal as long as it is.
    """

    nodes: list[tuple[str, tuple]] = field(default_factory=list)
    links: list[tuple[int, str, int, str]] = field(default_factory=list)
    values: list[tuple[int, str, object]] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    fields: list[tuple[Out, ...]] = field(default_factory=list)
    coordinates: set[str] = field(default_factory=set)
    images: list[tuple] = field(default_factory=list)

    @property
    def structure(self) -> str:
        """What is the same as long as only values change."""
        parts = [(node, name, _size(value)) for node, name, value in self.values]
        return repr((self.nodes, self.links, self.stages, self.fields, parts))

    def stamp(self) -> tuple:
        """Equal stamps give equal fields in equal places."""
        return self.structure, repr(self.values), repr(self.images)

    @property
    def is_of_world(self) -> bool:
        """Whether it matters where and how turned a glass stands."""
        return WORLD in self.coordinates or any(
            s.is_map and s.kind.endswith("WORLD") for s in self.stages
        )

    @property
    def has_heights(self) -> bool:
        """Whether slopes are asked for."""
        return not all(stage.is_map for stage in self.stages)


def _size(value) -> int:
    return len(value) if isinstance(value, tuple) else 0


def bumps_of(material: bpy.types.Material | None) -> Recipe | str | None:
    """How a glassy material tilts the normals of its shader; None: not at all. A name: by what is
    not known."""
    shader = interface_node(material)
    if shader is None:
        return None
    reader = _Reader(Recipe())
    end = material.node_tree.get_output_node("ALL")
    try:
        if end is not None and material.displacement_method == "BUMP":
            reader.displacement(end.inputs["Displacement"])
        reader.normal(shader.inputs["Normal"], ())
    except Untranslatable as error:
        return str(error)
    return reader.recipe if reader.recipe.stages else None


def paint_of(material: bpy.types.Material | None) -> tuple[Recipe | None, dict[str, str]]:
    """How nodes make the colours and the roughness of a glassy material; None: they are plain.

    The second are its inputs that count by their own value, each with the name of what is not known
    behind it.
    """
    shader = interface_node(material)
    if shader is None:
        return None, {}
    inputs = [shader.inputs[name] for name in PAINTED[shader.type]]
    linked, unknown = set(), {}
    for socket in inputs:
        reader = _Reader(Recipe())
        if reader.is_linked(socket):
            linked.add(socket.name)
            try:
                reader.taken(socket)
            except Untranslatable as error:
                unknown[socket.name] = str(error)
    if linked <= unknown.keys():
        return None, unknown
    reader = _Reader(Recipe())
    fields = [reader.taken(socket, socket.name in unknown) for socket in inputs]
    reader.stage(Stage(shader.type), *fields)
    return reader.recipe, unknown


def recipes_of(material: bpy.types.Material) -> list[Recipe]:
    """All that is evaluated of a material."""
    found = bumps_of(material), paint_of(material)[0]
    return [recipe for recipe in found if isinstance(recipe, Recipe)]


_SAME = {
    f"ShaderNode{name}"
    for name in (
        *("Clamp", "CombineXYZ", "Gamma", "MapRange", "Math", "Mix", "MixRGB"),
        *("RadialTiling", "SeparateXYZ", "TexBrick", "TexChecker", "TexGabor"),
        *("TexGradient", "TexMagic", "TexNoise", "TexVoronoi", "TexWave", "TexWhiteNoise"),
        *("ValToRGB", "VectorMath", "VectorRotate"),
    )
}
_OTHER_NAMES = {
    "ShaderNodeTexImage": "GeometryNodeImageTexture",
    "ShaderNodeSeparateColor": "FunctionNodeSeparateColor",
    "ShaderNodeCombineColor": "FunctionNodeCombineColor",
}
_BY_POSITION = ("Gradient", "Magic", "Noise", "Voronoi", "Wave", "Brick", "Checker", "Gabor")
_PLACED = {f"ShaderNodeTex{name}" for name in _BY_POSITION}
"""Textures that lie by generated coordinates where nothing is linked."""
_GENERAL = {p.identifier for p in bpy.types.Node.bl_rna.properties}
Groups = tuple[bpy.types.ShaderNode, ...]
"""The group nodes that one is in, the innermost last."""


class _Reader:
    """Goes through a material's nodes, from what they lead to backwards."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self._known: dict[tuple, Out] = {}

    def displacement(self, socket: bpy.types.NodeSocket) -> None:
        """What is to be displaced and is shown as bumps."""
        node, _, groups = self._origin(socket, ())
        if node is not None and node.type != "DISPLACEMENT":
            raise Untranslatable(node.bl_label)
        if node is not None:
            stage = Stage(f"DISPLACEMENT {node.space}")
            self._heights(stage, node, ("Height", "Midlevel", "Scale"), groups)

    def is_linked(self, socket: bpy.types.NodeSocket) -> bool:
        """Whether a node leads to an input of a shader."""
        return self._is_linked(socket, ())

    def taken(self, socket: bpy.types.NodeSocket, plainly: bool = False) -> Out:
        """A shader's input as a vector. ``plainly``: whatever leads to it, by its own value."""
        is_number = socket.type == "VALUE"
        vector = (
            self._node("ShaderNodeCombineXYZ")
            if is_number
            else self._node("ShaderNodeVectorMath", operation="ADD")
        )
        name = "X" if is_number else "Vector"
        if plainly:
            self.recipe.values.append((vector, name, _plain(socket.default_value)))
        else:
            self._feed(socket, vector, name, ())
        return vector, "Vector"

    def _heights(self, stage: Stage, node, names: tuple[str, ...], groups: Groups) -> None:
        """A stage that takes three numbers."""
        both = self._node("ShaderNodeCombineXYZ")
        for source, name in zip(names, "XYZ", strict=True):
            self._feed(node.inputs[source], both, name, groups)
        self.stage(stage, (both, "Vector"))

    def normal(self, socket: bpy.types.NodeSocket, groups: Groups) -> None:
        """What a shader takes as its normal."""
        node, _, groups = self._origin(socket, groups)
        if node is None:
            return
        if node.type == "BUMP":
            self.normal(node.inputs["Normal"], groups)
            # Else it is as high everywhere.
            if self._is_linked(node.inputs["Height"], groups):
                names = "Height", "Strength", "Distance"
                self._heights(Stage("BUMP", node.invert), node, names, groups)
        elif node.type == "NORMAL_MAP":
            colour, strength = (self._node("ShaderNodeVectorMath", operation="ADD") for _ in "12")
            self._feed(node.inputs["Color"], colour, "Vector", groups)
            self._feed(node.inputs["Strength"], strength, "Vector", groups)
            if node.space == "TANGENT":
                self.recipe.coordinates.add(UV + node.uv_map)
            # It starts from the mesh's own normal.
            del self.recipe.stages[:], self.recipe.fields[:]
            kind = Stage(node.space, uv=node.uv_map)
            self.stage(kind, (colour, "Vector"), (strength, "Vector"))
        else:
            raise Untranslatable(node.bl_label)

    def stage(self, stage: Stage, *fields: Out) -> None:
        """Have a stage take fields."""
        self.recipe.stages.append(stage)
        self.recipe.fields.append(fields)

    def _is_linked(self, socket: bpy.types.NodeSocket, groups: Groups) -> bool:
        return self._origin(socket, groups)[0] is not None

    def _origin(self, socket: bpy.types.NodeSocket, groups: Groups) -> tuple:
        """The node and output that lead to an input, past groups and what does nothing; and in
        which groups. Without a link None, and the input that has the value."""
        while True:
            links = [link for link in socket.links if not link.is_muted and link.is_valid]
            if not links:
                return None, socket, groups
            node, output = links[0].from_node, links[0].from_socket
            to_number = node.type == "RGBTOBW" and socket.type == "VALUE"
            if node.type == "REROUTE" or to_number:
                # A colour that is linked to a number becomes grey anyhow.
                socket = node.inputs[0]
            elif node.mute:
                through = [k.from_socket for k in node.internal_links if k.to_socket == output]
                if not through:
                    return None, socket, groups
                socket = through[0]
            elif node.type == "GROUP_INPUT":
                socket = by_identifier(groups[-1].inputs, output.identifier)
                groups = groups[:-1]
            elif node.type == "GROUP" and node.node_tree is not None:
                inner = (n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT")
                end = next((n for n in inner if n.is_active_output), None)
                if end is None:
                    return None, socket, groups
                groups = (*groups, node)
                socket = by_identifier(end.inputs, output.identifier)
            else:
                return node, output, groups

    def _node(self, kind: str, **properties) -> int:
        self.recipe.nodes.append((kind, tuple(properties.items())))
        return len(self.recipe.nodes) - 1

    def _link(self, output: Out, node: int, name: str) -> None:
        self.recipe.links.append((*output, node, name))

    def _feed(self, socket, node: int, name: str, groups: Groups) -> None:
        """Have an input of an own node be what an input of the material is."""
        source, found, inner = self._origin(socket, groups)
        if source is not None:
            self._link(self._output(source, found, inner), node, name)
        elif hasattr(found, "default_value"):
            self.recipe.values.append((node, name, _plain(found.default_value)))

    def _output(self, node, output, groups: Groups) -> Out:
        """An own node's output that is what a material node's is."""
        key = node.as_pointer(), tuple(g.as_pointer() for g in groups), output.identifier
        if key not in self._known:
            self._known[key] = self._made(node, output, groups)
        return self._known[key]

    def _made(self, node, output, groups: Groups) -> Out:
        special = _SPECIAL.get(node.bl_idname)
        if special is not None:
            return special(self, node, output, groups)
        kind = node.bl_idname if node.bl_idname in _SAME else _OTHER_NAMES.get(node.bl_idname)
        if kind is None:
            raise Untranslatable(node.bl_label)
        outputs = {name: name for name in (s.identifier for s in node.outputs)}
        whole = node.as_pointer(), tuple(g.as_pointer() for g in groups)
        if whole not in self._known:
            number = self._node(kind, **_properties(node))
            self._known[whole] = number, ""
            if kind == "GeometryNodeImageTexture":
                self._image(node, number)
            for part, value in _parts(node):
                self.recipe.values.append((number, part, value))
            for socket in node.inputs:
                if not socket.enabled and not socket.is_linked:
                    continue
                if socket.identifier != "Vector" or self._is_linked(socket, groups):
                    self._feed(socket, number, socket.identifier, groups)
                elif node.bl_idname in _PLACED:
                    self._link(self._coordinate(GENERATED), number, "Vector")
                elif kind == "GeometryNodeImageTexture":
                    self._link(self._coordinate(UV), number, "Vector")
                else:
                    self._feed(socket, number, socket.identifier, groups)
        return self._known[whole][0], outputs[output.identifier]

    def _image(self, node, number: int) -> None:
        image = node.image
        if image is None:
            raise Untranslatable(f"{node.bl_label} without an image")
        if image.source not in {"FILE", "GENERATED"} or node.projection != "FLAT":
            raise Untranslatable(f"{node.bl_label} of a movie, of tiles or by a projection")
        if not all(image.size):
            raise Untranslatable(f"{node.bl_label} whose file is missing")
        image = image.original
        reading = image.colorspace_settings.name, image.alpha_mode, image.source
        # Where it is painted on, Blender tells of a change.
        seen = image.filepath, *image.size, *reading, shape_generation(image)
        self.recipe.images.append((image.session_uid, *seen))
        smooth = {"Linear": "Linear", "Closest": "Closest"}.get(node.interpolation, "Cubic")
        kind, _ = self.recipe.nodes[number]
        properties = (("interpolation", smooth), ("extension", node.extension))
        self.recipe.nodes[number] = kind, properties
        self.recipe.values.append((number, "image", image.session_uid))

    def _coordinate(self, name: str) -> Out:
        """The attribute that holds a coordinate."""
        self.recipe.coordinates.add(name)
        key = "coordinate", name
        if key not in self._known:
            number = self._node("GeometryNodeInputNamedAttribute", data_type="FLOAT_VECTOR")
            self.recipe.values.append((number, "Name", attribute_of(name)))
            self._known[key] = number, "Attribute"
        return self._known[key]

    def _coordinates(self, node, output, _groups) -> Out:
        found = _COORDINATES.get((node.bl_idname, output.name))
        if found is None or getattr(node, "object", None) or getattr(node, "from_instancer", False):
            raise Untranslatable(f"{output.name} of {node.bl_label}")
        return self._coordinate(found + (node.uv_map if node.bl_idname.endswith("UVMap") else ""))

    def _constant(self, node, output, _groups) -> Out:
        is_value = node.bl_idname == "ShaderNodeValue"
        number = self._node("ShaderNodeValue" if is_value else "FunctionNodeInputColor")
        value = _plain(output.default_value)
        self.recipe.values.append((number, "output" if is_value else "colour", value))
        return number, "Value" if is_value else "Color"

    def _inverted(self, node, _output, groups) -> Out:
        away = self._node("ShaderNodeVectorMath", operation="SUBTRACT")
        self.recipe.values.append((away, "Vector", (1.0, 1.0, 1.0)))
        self._feed(node.inputs["Color"], away, "Vector_001", groups)
        mix = self._node("ShaderNodeMix", data_type="VECTOR", clamp_factor=False)
        self._feed(node.inputs["Fac"], mix, "Factor_Float", groups)
        self._feed(node.inputs["Color"], mix, "A_Vector", groups)
        self._link((away, "Vector"), mix, "B_Vector")
        return mix, "Result_Vector"

    def _mapped(self, node, _output, groups) -> Out:
        """A Mapping node as vector maths."""
        kind = node.vector_type
        if not self._is_linked(node.inputs["Vector"], groups):
            raise Untranslatable(f"{node.bl_label} of nothing")

        def step(operation: str, last: Out | None, name: str) -> Out:
            number = self._node("ShaderNodeVectorMath", operation=operation)
            if last is None:
                self._feed(node.inputs["Vector"], number, "Vector", groups)
            else:
                self._link(last, number, "Vector")
            self._feed(node.inputs[name], number, "Vector_001", groups)
            return number, "Vector"

        def turned(last: Out) -> Out:
            number = self._node(
                "ShaderNodeVectorRotate", rotation_type="EULER_XYZ", invert=kind == "TEXTURE"
            )
            self._link(last, number, "Vector")
            self._feed(node.inputs["Rotation"], number, "Rotation", groups)
            return number, "Vector"

        if kind == "TEXTURE":
            return step("DIVIDE", turned(step("SUBTRACT", None, "Location")), "Scale")
        if kind == "NORMAL":
            number = self._node("ShaderNodeVectorMath", operation="NORMALIZE")
            self._link(turned(step("DIVIDE", None, "Scale")), number, "Vector")
            return number, "Vector"
        found = turned(step("MULTIPLY", None, "Scale"))
        return step("ADD", found, "Location") if kind == "POINT" else found


_COORDINATES = {
    ("ShaderNodeTexCoord", "Generated"): GENERATED,
    ("ShaderNodeTexCoord", "Object"): OBJECT,
    ("ShaderNodeTexCoord", "Normal"): NORMAL,
    ("ShaderNodeTexCoord", "UV"): UV,
    ("ShaderNodeUVMap", "UV"): UV,
    ("ShaderNodeNewGeometry", "Position"): WORLD,
}
_SPECIAL: dict[str, Callable[..., Out]] = {
    "ShaderNodeTexCoord": _Reader._coordinates,
    "ShaderNodeUVMap": _Reader._coordinates,
    "ShaderNodeNewGeometry": _Reader._coordinates,
    "ShaderNodeValue": _Reader._constant,
    "ShaderNodeRGB": _Reader._constant,
    "ShaderNodeInvert": _Reader._inverted,
    "ShaderNodeMapping": _Reader._mapped,
}


def attribute_of(coordinate: str) -> str:
    """The attribute of points that holds a coordinate."""
    return f"rg_{coordinate}"


def by_identifier(sockets, identifier: str) -> bpy.types.NodeSocket:
    """The socket of that identifier: names may be those of several."""
    return next(s for s in sockets if s.identifier == identifier)


def _plain(value):
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _properties(node) -> dict:
    """What a node does, beside its sockets."""
    names = (p for p in node.bl_rna.properties if not p.is_readonly and p.type != "POINTER")
    return {
        p.identifier: getattr(node, p.identifier) for p in names if p.identifier not in _GENERAL
    }


def _parts(node) -> list[tuple[str, object]]:
    """The values of a node that are no sockets: of a colour ramp."""
    ramp = getattr(node, "color_ramp", None)
    if ramp is None:
        return []
    ends = tuple((e.position, *e.color) for e in ramp.elements)
    return [("ramp", (ramp.color_mode, ramp.interpolation, ramp.hue_interpolation, ends))]
