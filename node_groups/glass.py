# SPDX-License-Identifier: GPL-3.0-or-later
"""``Refractive Glass``: the modifier that makes the glass's mesh and is its one description.

Local frame as in the optics: cylinder, rod and tumbler stand on the origin (z from 0 to the
height), a sphere is centred, a slab's upper face is the object's own flat mesh and the glass lies
on the side away from its normal, a mesh is the object's own.
"""

from __future__ import annotations

import math

from . import shadow
from .tree_builder import TreeBuilder, enabled

NAME = "Refractive Glass"
VERSION = 3
"""Counts the changes of this group: older files get the newest one by it (``scene/names.py``)."""
SHAPES = ("Slab", "Cylinder", "Rod", "Sphere", "Tumbler", "Revolution", "Mesh")
CORNER_NORMAL = "rg_corner_normal"
"""Attribute of a mesh's loose points that renders leave out: the normal of a triangle's corner."""
CORNER_MARK = "rg_corner_mark"
"""Another: the place on the UV map, and the material slot."""
SHARP = 0.8
"""Radians between the normals on both sides of an edge that is a rim."""
MOST_SLOTS = 30
"""Material slots that a bit each can tell of: bits of a whole number that are no sign."""


def build():
    """Build the group and return it."""
    b = TreeBuilder(NAME, "glass")
    b.tree.is_modifier = True
    b.tree["refractive_glass_version"] = VERSION
    _interface(b)
    group = b.node("NodeGroupInput")
    radius, wall = group.outputs["Radius"], group.outputs["Wall Thickness"]
    height, segments = group.outputs["Height"], group.outputs["Segments"]

    inner = b.math("MAXIMUM", b.math("SUBTRACT", radius, wall), 0.0)
    slab = _slab(b, group.outputs["Geometry"], wall)
    tube = _lathe(
        b, segments, (radius, radius, inner, inner, radius), (0.0, height, height, 0.0, 0.0)
    )
    rod = _lathe(b, segments, (0.0, radius, radius, 0.0, 0.0), (0.0, 0.0, height, height, height))
    sphere = _sphere(b, radius, inner, wall, segments)
    tumbler = _tumbler(b, group, inner)
    turned = _turned(b, group.outputs["Profile"], segments)

    # While a viewport draws the refracted picture, a face would hide what that is looked up in.
    is_viewport = b.node("IsViewport")
    only_edges = b.node("FunctionNodeBooleanMath", operation="AND")
    b.link(is_viewport.outputs[0], only_edges.inputs[0])
    b.link(group.outputs["Edges in Viewport"], only_edges.inputs[1])
    sphere = b.switch("GEOMETRY", only_edges.outputs[0], sphere, _circles(b, radius, segments))

    menu = b.node("MenuSwitch", data_type="GEOMETRY")
    menu.enum_items.clear()
    for name in SHAPES:
        menu.enum_items.new(name)
    own = group.outputs["Geometry"]
    glass, opaque = _parted(b, own, group.outputs["Opaque Slots"])
    made_by_shape = (slab, tube, rod, sphere, tumbler, turned, glass)
    for name, made in zip(SHAPES, made_by_shape, strict=True):
        b.link(made, menu.inputs[name])
    b.link(group.outputs["Shape"], menu.inputs["Menu"])
    shape_socket = next(i for i in b.tree.interface.items_tree if i.name == "Shape")
    shape_socket.default_value = "Cylinder"

    material = b.node("SetMaterial")
    b.link(menu.outputs["Output"], material.inputs["Geometry"])
    b.link(group.outputs["Material"], material.inputs["Material"])
    is_mesh = menu.outputs["Mesh"]
    dressed = b.switch("GEOMETRY", is_mesh, material.outputs[0], own)

    unshown = b.switch(
        "GEOMETRY",
        group.outputs["Casts Shadow"],
        _nothing(b),
        shadow.cast(b, menu.outputs["Output"], group, _is_solid(b, menu, wall)),
    )
    unshown = _with_mirrored(b, unshown, group)
    # In a render the refracted picture stands in the glass's place, so the mesh keeps out of it.
    is_shown = b.switch("BOOLEAN", is_viewport.outputs[0], group.outputs["Show in Render"], True)
    is_whole = b.switch("BOOLEAN", only_edges.outputs[0], is_shown, False)
    left = b.switch("GEOMETRY", only_edges.outputs[0], unshown, _edges(b, menu.outputs["Output"]))
    left = _with_corners(b, left, is_mesh, glass, opaque, group.outputs["UV Map"])
    out = b.switch("GEOMETRY", is_whole, left, dressed)
    end = b.node("NodeGroupOutput")
    b.link(out, end.inputs[0])
    return b.tree


def _with_mirrored(b: TreeBuilder, unshown, group):
    """What renders have of the glass, and the object that stands for it in mirrors, instanced."""
    info = b.node("ObjectInfo", transform_space="ORIGINAL")
    b.link(group.outputs["In Mirrors"], info.inputs["Object"])
    info.inputs["As Instance"].default_value = True
    both = b.node("JoinGeometry")
    b.link(info.outputs["Geometry"], both.inputs[0])
    b.link(unshown, both.inputs[0])
    return both.outputs[0]


def _with_normals(b: TreeBuilder, mesh):
    """The node whose outputs are a mesh, its instances made real, and its corners' normals."""
    realised = b.node("RealizeInstances")
    b.link(mesh, realised.inputs["Geometry"])
    kept = b.node("CaptureAttribute", domain="CORNER")
    kept.capture_items.new("VECTOR", "Normal")
    b.link(realised.outputs[0], kept.inputs["Geometry"])
    b.link(b.node("InputNormal").outputs["Normal"], kept.inputs["Normal"])
    return kept


def _parted(b: TreeBuilder, own, slots):
    """A mesh's faces that are glass, and the others, all with the normals that they had.

    ``slots``: bit k says that faces of material slot k are no glass.
    """
    kept = _with_normals(b, own)
    slot = b.whole("MINIMUM", b.node("InputMaterialIndex").outputs[0], MOST_SLOTS)
    bit = b.whole("DIVIDE_FLOOR", slots, b.whole("POWER", 2, slot))
    parted = b.node("SeparateGeometry", domain="FACE")
    b.link(kept.outputs["Geometry"], parted.inputs["Geometry"])
    b.link(b.whole("MODULO", bit, 2), parted.inputs["Selection"])

    def as_it_was(part):
        normals = b.node("SetMeshNormal", mode="FREE", domain="CORNER")
        b.link(part, normals.inputs["Mesh"])
        b.link(kept.outputs["Normal"], enabled(normals.inputs, "Custom Normal"))
        return normals.outputs[0]

    glass = b.switch("GEOMETRY", slots, own, as_it_was(parted.outputs["Inverted"]))
    opaque = b.switch("GEOMETRY", slots, _nothing(b), as_it_was(parted.outputs["Selection"]))
    return glass, opaque


def _with_corners(b: TreeBuilder, left, is_mesh, glass, opaque, uv_map):
    """What is left of a glass, and of a mesh its opaque faces and its glass's corners, loose.

    No engine draws loose points of a mesh; the extension reads the glass from them. Three in a row
    are a triangle.
    """
    kept = _with_normals(b, glass)
    triangles = _triangulated(b, kept.outputs["Geometry"])
    size = b.node("AttributeDomainSize", component="MESH")
    b.link(triangles.outputs[0], size.inputs["Geometry"])
    row = b.node("MeshLine", mode="OFFSET")
    b.link(size.outputs["Face Corner Count"], row.inputs["Count"])
    loose = b.node("DeleteGeometry", domain="EDGE", mode="EDGE_FACE")
    b.link(row.outputs[0], loose.inputs["Geometry"])

    def of_corner(value):
        found = b.node("SampleIndex", data_type="FLOAT_VECTOR", domain="CORNER")
        b.link(triangles.outputs[0], found.inputs["Geometry"])
        b.link(value, found.inputs["Value"])
        b.link(b.node("InputIndex").outputs[0], found.inputs["Index"])
        return found.outputs[0]

    place = b.node("SetPosition")
    b.link(loose.outputs[0], place.inputs["Geometry"])
    b.link(of_corner(b.node("InputPosition").outputs[0]), place.inputs["Position"])
    uv = b.node("InputNamedAttribute", data_type="FLOAT_VECTOR")
    b.link(uv_map, uv.inputs["Name"])
    pair, mark = b.node("ShaderNodeSeparateXYZ"), b.node("ShaderNodeCombineXYZ")
    b.link(uv.outputs["Attribute"], pair.inputs[0])
    b.link(pair.outputs["X"], mark.inputs["X"])
    b.link(pair.outputs["Y"], mark.inputs["Y"])
    b.link(b.node("InputMaterialIndex").outputs[0], mark.inputs["Z"])
    stored = place.outputs[0]
    for name, value in ((CORNER_NORMAL, kept.outputs["Normal"]), (CORNER_MARK, mark.outputs[0])):
        store = b.node("StoreNamedAttribute", data_type="FLOAT_VECTOR", domain="POINT")
        b.link(stored, store.inputs["Geometry"])
        store.inputs["Name"].default_value = name
        b.link(of_corner(value), enabled(store.inputs, "Value"))
        stored = store.outputs[0]
    parts = b.node("JoinGeometry")
    for part in (stored, left, opaque):
        b.link(part, parts.inputs[0])
    return b.switch("GEOMETRY", is_mesh, left, parts.outputs[0])


def _triangulated(b: TreeBuilder, mesh):
    """The node whose output has a mesh's faces as the triangles that engines draw.

    Normals are interpolated within each, so what a smooth surface refracts depends on how its faces
    are split: quads from their first to their third corner, or else, where the others lie on one
    side of that line, from the second to the fourth; all others by their ears.
    """

    def corner(number):
        corners = b.node("CornersOfFace")
        corners.inputs["Sort Index"].default_value = number
        vertex = b.node("VertexOfCorner")
        b.link(corners.outputs["Corner Index"], vertex.inputs["Corner Index"])
        place = b.node("FieldAtIndex", data_type="FLOAT_VECTOR", domain="POINT")
        b.link(vertex.outputs["Vertex Index"], place.inputs["Index"])
        b.link(b.node("InputPosition").outputs[0], place.inputs["Value"])
        return place.outputs[0]

    def vector(operation, first, second):
        node = b.node("ShaderNodeVectorMath", operation=operation)
        b.link(first, node.inputs[0])
        b.link(second, node.inputs[1])
        return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    first = corner(0)
    second, third, fourth = (vector("SUBTRACT", corner(k), first) for k in (1, 2, 3))
    sides = vector("CROSS_PRODUCT", second, third), vector("CROSS_PRODUCT", fourth, third)
    same_side = b.node("FunctionNodeCompare", data_type="FLOAT", operation="GREATER_THAN")
    b.link(vector("DOT_PRODUCT", *sides), enabled(same_side.inputs, "A"))
    enabled(same_side.inputs, "B").default_value = 0.0
    for method, wanted in (("Fixed Alternate", same_side.outputs[0]), ("Fixed", True)):
        split = b.node("Triangulate")
        split.inputs["Quad Method"].default_value = method
        split.inputs["N-gon Method"].default_value = "Clip"
        b.link(mesh, split.inputs["Mesh"])
        b.link(wanted, split.inputs["Selection"])
        mesh = split.outputs[0]
    return split


def _is_solid(b: TreeBuilder, menu, wall):
    """Whether light runs through the whole glass from side to side, not through walls."""
    thin = b.node("FunctionNodeCompare", data_type="FLOAT", operation="LESS_EQUAL")
    b.link(wall, enabled(thin.inputs, "A"))
    enabled(thin.inputs, "B").default_value = 0.0
    ball = b.node("FunctionNodeBooleanMath", operation="AND")
    b.link(menu.outputs["Sphere"], ball.inputs[0])
    b.link(thin.outputs[0], ball.inputs[1])
    either = b.node("FunctionNodeBooleanMath", operation="OR")
    b.link(menu.outputs["Rod"], either.inputs[0])
    b.link(ball.outputs[0], either.inputs[1])
    return either.outputs[0]


def _interface(b: TreeBuilder) -> None:
    b.socket("Geometry", "Geometry", output=True)
    b.socket("Geometry", "Geometry")
    b.socket("Shape", "Menu", description="What the glass is")
    b.socket(
        "Radius",
        "Float",
        default=0.04,
        minimum=0.0,
        subtype="DISTANCE",
        description="Outer radius of a cylinder, rod, sphere or tumbler",
    )
    b.socket(
        "Wall Thickness",
        "Float",
        default=0.003,
        minimum=0.0,
        subtype="DISTANCE",
        description="Of a wall, or of the slab; a sphere with 0 is a solid ball",
    )
    b.socket(
        "Height",
        "Float",
        default=0.12,
        minimum=0.0,
        subtype="DISTANCE",
        description="Height of a cylinder, rod or tumbler",
    )
    b.socket(
        "Bottom Thickness",
        "Float",
        default=0.006,
        minimum=0.0,
        subtype="DISTANCE",
        description="Of a tumbler's bottom",
    )
    b.socket(
        "Liquid Level",
        "Float",
        default=0.0,
        minimum=0.0,
        subtype="DISTANCE",
        description="Height of the liquid above the lowest point inside a tumbler or glass of "
        "revolution; 0: empty",
    )
    b.socket(
        "Profile",
        "Object",
        description="Curve of a glass of revolution: x is the radius, z the height; its first "
        "spline is the outside, from the axis below up to the rim, its second the inside",
    )
    b.socket("IOR", "Float", default=1.5, description="Index of refraction of the glass")
    b.socket(
        "Contents IOR",
        "Float",
        default=1.0,
        description="Index of refraction of the contents: 1 for air, 1.333 for water",
    )
    for medium, of in (("", "the glass"), ("Contents ", "the contents")):
        b.socket(
            f"{medium}Abbe Number",
            "Float",
            default=0.0,
            minimum=0.0,
            description=f"How little {of} spreads colours: 64 for crown glass, 30 for flint, 56 "
            "for water; 0: not at all. Colours take three times as long",
        )
        b.socket(
            f"{medium}Absorption Color",
            "Color",
            default=(1.0, 1.0, 1.0, 1.0),
            description=f"What white light becomes that runs the distance below through {of}",
        )
        b.socket(
            f"{medium}Absorption Distance",
            "Float",
            default=0.01,
            minimum=0.0,
            subtype="DISTANCE",
            description=f"How far light runs through {of} until it has the colour above",
        )
    b.socket(
        "Priority",
        "Int",
        default=0,
        description="Where glasses overlap, the one of the highest priority is there; of equal "
        "ones the one that light enters first",
    )
    b.socket(
        "Casts Shadow",
        "Bool",
        default=False,
        description="Light on its way through is weakened and tinted; it is not bent, so there are "
        "no caustics, and contents do not count",
    )
    b.socket(
        "Seen Through",
        "Collection",
        description="Only objects of this collection are seen through the glass; empty: everything",
    )
    b.socket(
        "Material",
        "Material",
        description="Of what is shown as a mesh; a glass that is a mesh has materials of its own",
    )
    b.socket(
        "Segments",
        "Int",
        default=128,
        minimum=8,
        maximum=1024,
        description="Of the mesh, round the axis",
    )
    b.socket(
        "Show in Render",
        "Bool",
        default=False,
        hidden=True,
        description="Set by the extension: rendered as a mesh only while the refraction is off",
    )
    b.socket(
        "Edges in Viewport",
        "Bool",
        default=False,
        hidden=True,
        description="Set by the extension while a viewport draws what is seen through the glass",
    )
    # The last: files know inputs by the order in which they were made.
    b.socket(
        "In Mirrors",
        "Object",
        hidden=True,
        description="Set by the extension: what mirrors and windows show of the glass in Cycles",
    )
    b.socket(
        "Opaque Slots",
        "Int",
        default=0,
        hidden=True,
        description="Set by the extension: the material slots whose faces are no glass, a bit each",
    )
    b.socket(
        "UV Map",
        "String",
        hidden=True,
        description="Set by the extension: the UV map that textures of the glass's material use",
    )


def _nothing(b: TreeBuilder):
    return b.node("JoinGeometry").outputs[0]


def _edges(b: TreeBuilder, mesh):
    """The mesh's sharp edges and those that are lines already, as lines; of none its box."""
    angle = b.node("InputMeshEdgeAngle")
    soft = b.node("FunctionNodeCompare", data_type="FLOAT", operation="LESS_EQUAL")
    b.link(angle.outputs["Unsigned Angle"], enabled(soft.inputs, "A"))
    enabled(soft.inputs, "B").default_value = SHARP
    neighbours = b.node("InputMeshEdgeNeighbors")
    inner = b.node("FunctionNodeBooleanMath", operation="AND")
    b.link(soft.outputs[0], inner.inputs[0])
    b.link(neighbours.outputs[0], inner.inputs[1])
    sharp = b.node("DeleteGeometry", domain="EDGE", mode="EDGE_FACE")
    b.link(mesh, sharp.inputs["Geometry"])
    b.link(inner.outputs[0], sharp.inputs["Selection"])
    # Faces between sharp edges alone are left.
    lines = b.node("DeleteGeometry", domain="FACE", mode="ONLY_FACE")
    b.link(sharp.outputs[0], lines.inputs["Geometry"])
    # Without any line a view would show all corners as points, which may cover the glass.
    box = b.node("BoundBox")
    b.link(mesh, box.inputs["Geometry"])
    frame = b.node("DeleteGeometry", domain="FACE", mode="ONLY_FACE")
    b.link(box.outputs["Bounding Box"], frame.inputs["Geometry"])
    size = b.node("AttributeDomainSize", component="MESH")
    b.link(lines.outputs[0], size.inputs["Geometry"])
    has_lines = b.node("FunctionNodeCompare", data_type="INT", operation="GREATER_THAN")
    b.link(size.outputs["Edge Count"], enabled(has_lines.inputs, "A"))
    enabled(has_lines.inputs, "B").default_value = 0
    return b.switch("GEOMETRY", has_lines.outputs[0], frame.outputs[0], lines.outputs[0])


def _circles(b: TreeBuilder, radius, segments):
    """Three circles round a sphere, which has no sharp edge."""
    join = b.node("JoinGeometry")
    for turn in ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0)):
        circle = b.node("MeshCircle")
        b.link(segments, circle.inputs["Vertices"])
        b.link(radius, circle.inputs["Radius"])
        placed = b.node("Transform")
        b.link(circle.outputs["Mesh"], placed.inputs["Geometry"])
        placed.inputs["Rotation"].default_value = [math.pi * part for part in turn]
        b.link(placed.outputs[0], join.inputs[0])
    return join.outputs[0]


def _slab(b: TreeBuilder, outline, thickness):
    extrude = b.node("ExtrudeMesh", mode="FACES")
    b.link(outline, extrude.inputs["Mesh"])
    b.link(b.math("MULTIPLY", thickness, -1.0), extrude.inputs["Offset Scale"])
    extrude.inputs["Individual"].default_value = False
    # Extruded against the normal, sides and far face come out turned inside out.
    flip = b.node("FlipFaces")
    b.link(extrude.outputs["Mesh"], flip.inputs["Mesh"])
    join = b.node("JoinGeometry")
    b.link(outline, join.inputs[0])
    b.link(flip.outputs[0], join.inputs[0])
    merge = b.node("MergeByDistance")
    b.link(join.outputs[0], merge.inputs["Geometry"])
    merge.inputs["Distance"].default_value = 1e-7
    smooth = b.node("SetShadeSmooth")
    b.link(merge.outputs[0], smooth.inputs[0])
    smooth.inputs["Shade Smooth"].default_value = False
    return smooth.outputs[0]


def _lathe(b: TreeBuilder, segments, radii, heights):
    """A closed surface: a profile of points (radius, z), turned about z."""
    count = len(radii)
    columns = b.math("ADD", segments, 1.0)
    grid = b.node("MeshGrid")
    b.link(columns, grid.inputs["Vertices X"])
    grid.inputs["Vertices Y"].default_value = count
    index = b.node("InputIndex").outputs[0]
    row = b.math("MODULO", index, float(count))
    column = b.math("FLOOR", b.math("DIVIDE", b.math("ADD", index, 0.5), float(count)))
    angle = b.math("MULTIPLY", b.math("DIVIDE", column, segments), 6.283185307179586)

    r = b.choice("FLOAT", row, radii)
    z = b.choice("FLOAT", row, heights)
    placed = _placed(b, grid.outputs["Mesh"], r, z, angle)
    merge = b.node("MergeByDistance")
    b.link(placed, merge.inputs["Geometry"])
    b.link(b.math("MULTIPLY", radii[1], 1e-6), merge.inputs["Distance"])
    return _smooth_but_rims(b, merge.outputs[0])


def _tumbler(b: TreeBuilder, group, inner):
    """A cup with a bottom, and its liquid's surface; the liquid's sides are the cup's."""
    radius, height = group.outputs["Radius"], group.outputs["Height"]
    bottom, level = group.outputs["Bottom Thickness"], group.outputs["Liquid Level"]
    segments = group.outputs["Segments"]
    bottom = b.math("MINIMUM", bottom, height)
    cup = _lathe(
        b,
        segments,
        (0.0, radius, radius, inner, inner, 0.0),
        (0.0, 0.0, height, height, bottom, bottom),
    )
    surface = b.node("MeshCircle", fill_type="TRIANGLE_FAN")
    b.link(segments, surface.inputs["Vertices"])
    b.link(inner, surface.inputs["Radius"])
    place = b.node("ShaderNodeCombineXYZ")
    b.link(b.math("MINIMUM", b.math("ADD", bottom, level), height), place.inputs[2])
    placed = b.node("Transform")
    b.link(surface.outputs["Mesh"], placed.inputs["Geometry"])
    b.link(place.outputs[0], placed.inputs["Translation"])
    filled = b.node("FunctionNodeCompare", data_type="FLOAT", operation="GREATER_THAN")
    b.link(level, enabled(filled.inputs, "A"))
    enabled(filled.inputs, "B").default_value = 0.0
    join = b.node("JoinGeometry")
    b.link(cup, join.inputs[0])
    b.link(b.switch("GEOMETRY", filled.outputs[0], _nothing(b), placed.outputs[0]), join.inputs[0])
    return join.outputs[0]


def _turned(b: TreeBuilder, profile, segments):
    """The splines of a curve object, turned about z."""
    info = b.node("ObjectInfo", transform_space="ORIGINAL")
    b.link(profile, info.inputs["Object"])
    place = b.node("ShaderNodeSeparateXYZ")
    b.link(b.node("InputPosition").outputs[0], place.inputs[0])

    def captured(geometry, value):
        node = b.node("CaptureAttribute", domain="POINT")
        node.capture_items.new("FLOAT", "Value")
        b.link(geometry, node.inputs["Geometry"])
        b.link(value, node.inputs["Value"])
        return node.outputs["Geometry"], node.outputs["Value"]

    # What a point of the profile is, and where round the axis: the sweep carries both along.
    curve, radius = captured(info.outputs["Geometry"], place.outputs[0])
    curve, height = captured(curve, place.outputs[2])
    circle = b.node("CurvePrimitiveCircle")
    b.link(segments, circle.inputs["Resolution"])
    turn = b.math("DIVIDE", b.node("InputIndex").outputs[0], segments)
    ring, angle = captured(circle.outputs["Curve"], b.math("MULTIPLY", turn, math.tau))
    sweep = b.node("CurveToMesh")
    b.link(ring, sweep.inputs["Curve"])
    b.link(curve, sweep.inputs["Profile Curve"])
    placed = _placed(b, sweep.outputs["Mesh"], radius, height, angle)
    merge = b.node("MergeByDistance")
    b.link(placed, merge.inputs["Geometry"])
    merge.inputs["Distance"].default_value = 1e-6
    return _smooth_but_rims(b, merge.outputs[0])


def _placed(b: TreeBuilder, mesh, radius, height, angle):
    """The mesh with its points at cylinder coordinates round z."""
    place = b.node("ShaderNodeCombineXYZ")
    b.link(b.math("MULTIPLY", radius, b.math("COSINE", angle)), place.inputs[0])
    b.link(b.math("MULTIPLY", radius, b.math("SINE", angle)), place.inputs[1])
    b.link(height, place.inputs[2])
    move = b.node("SetPosition")
    b.link(mesh, move.inputs["Geometry"])
    b.link(place.outputs[0], move.inputs["Position"])
    return move.outputs[0]


def _smooth_but_rims(b: TreeBuilder, mesh):
    edge = b.node("InputMeshEdgeAngle")
    sharp = b.node("FunctionNodeCompare", data_type="FLOAT", operation="GREATER_THAN")
    b.link(edge.outputs["Unsigned Angle"], enabled(sharp.inputs, "A"))
    enabled(sharp.inputs, "B").default_value = SHARP
    normals = b.node("SetMeshNormal", mode="SHARPNESS")
    b.link(mesh, normals.inputs["Mesh"])
    b.link(sharp.outputs[0], normals.inputs["Edge Sharpness"])
    return normals.outputs[0]


def _sphere(b: TreeBuilder, radius, inner, wall, segments):
    def shell(r):
        node = b.node("MeshUVSphere")
        b.link(segments, node.inputs["Segments"])
        b.link(b.math("DIVIDE", segments, 2.0), node.inputs["Rings"])
        b.link(r, node.inputs["Radius"])
        return node.outputs["Mesh"]

    flip = b.node("FlipFaces")
    b.link(shell(inner), flip.inputs["Mesh"])
    hollow = b.node("JoinGeometry")
    b.link(shell(radius), hollow.inputs[0])
    b.link(flip.outputs[0], hollow.inputs[0])
    thick = b.node("FunctionNodeCompare", data_type="FLOAT", operation="GREATER_THAN")
    b.link(wall, enabled(thick.inputs, "A"))
    enabled(thick.inputs, "B").default_value = 0.0
    chosen = b.switch("GEOMETRY", thick.outputs[0], shell(radius), hollow.outputs[0])
    smooth = b.node("SetShadeSmooth")
    b.link(chosen, smooth.inputs[0])
    return smooth.outputs[0]
