# SPDX-License-Identifier: GPL-3.0-or-later
"""A copy shows, in Cycles, the very colours of its source, though its mesh lies elsewhere.

It is moved as a whole, and so is the camera that looks at it: the two pictures must be the same.
"""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
import bmesh  # noqa: E402
from mathutils import Vector  # noqa: E402

from glass_refraction.reference.picture import render_picture  # noqa: E402
from glass_refraction.scene import names  # noqa: E402
from glass_refraction.scene.build import texture_coordinates  # noqa: E402
from glass_refraction.scene.build.texture_coordinates import (  # noqa: E402
    coordinates,
    dress,
    dressed_coordinates,
    remove_unused,
    substitute,
    write_coordinates,
)
from glass_refraction.scene.read.arrays import write_attribute  # noqa: E402
from glass_refraction.scene.read.mesh_arrays import read_source_mesh, write_mesh  # noqa: E402
from glass_refraction.scene.read.modifier_inputs import write_input  # noqa: E402
from glass_refraction.scene.read.sources import pieces, world_positions  # noqa: E402
from glass_refraction.scene.read.triangles import Triangles  # noqa: E402

SIZE = 32
MOVED = (3, -2, 1)


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    set_up(scene)
    # Copies are in a scene of their own, as the extension has it.
    own_scene = bpy.data.scenes.new("Own")
    set_up(own_scene)
    own_scene.camera.location += Vector(MOVED)
    before = list(bpy.app.handlers.frame_change_post)
    yield scene
    bpy.app.handlers.frame_change_post[:] = before


def set_up(scene):
    """One sample exactly in the middle of each pixel."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, -6, 0)
    camera.rotation_euler = (np.pi / 2, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = SIZE
    render.film_transparent = True
    scene.cycles.samples = 1
    scene.cycles.filter_width = 0.01
    scene.cycles.use_denoising = False


def new_source(name="Source", segments=12):
    """A ball, turned, scaled by different factors and moved."""
    mesh = bpy.data.meshes.new(name)
    ball = bmesh.new()
    bmesh.ops.create_uvsphere(ball, u_segments=segments, v_segments=8, radius=1)
    ball.to_mesh(mesh)
    ball.free()
    source = bpy.data.objects.new(name, mesh)
    source.location, source.rotation_euler, source.scale = (
        (0.2, 0.3, -0.1),
        (0.4, 0.5, 0.6),
        (1.4, 1, 0.8),
    )
    source.color = (0.2, 0.7, 0.4, 0.5)
    source.pass_index = 3
    source["own"] = (0.3, 0.6, 0.9)
    bpy.context.scene.collection.objects.link(source)
    return source


def new_material(name="Material"):
    """An emissive material, its tree and the socket for the colour; 1 + value / 4 is emitted."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    scaled = tree.nodes.new("ShaderNodeVectorMath")
    scaled.operation = "MULTIPLY_ADD"
    scaled.inputs[1].default_value = (0.25, 0.25, 0.25)
    scaled.inputs[2].default_value = (1, 1, 1)
    light = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(scaled.outputs[0], light.inputs["Color"])
    tree.links.new(light.outputs[0], output.inputs["Surface"])
    return material, tree, scaled.inputs[0]


def read(output, node="ShaderNodeTexCoord", **settings):
    """A material that emits one output of a node."""

    def build():
        material, tree, colour = new_material()
        made = tree.nodes.new(node)
        for name, value in settings.items():
            setattr(made, name, value)
        tree.links.new(made.outputs[output], colour)
        return material

    return build


def texture(kind, link=None):
    """A texture with nothing linked to its Vector; or with a link that gives it nothing."""

    def build():
        material, tree, colour = new_material()
        node = tree.nodes.new(f"ShaderNodeTex{kind}")
        if kind == "Environment":
            node.image = bpy.data.images.new("Grid", 64, 64)
            node.image.generated_type = "COLOR_GRID"
        if link is not None:
            through = tree.nodes.new(link)
            through.mute = link != "NodeReroute"
            tree.links.new(through.outputs[0], node.inputs["Vector"])
        tree.links.new(node.outputs[0], colour)
        return material

    return build


def in_group():
    """Generated coordinates two groups deep, a texture between."""
    material, tree, colour = new_material()
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    for group in (inner, outer):
        group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketVector")
        group.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    scale, end = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    noise = inner.nodes.new("ShaderNodeTexNoise")
    inner.links.new(scale.outputs[0], noise.inputs["Scale"])
    inner.links.new(noise.outputs["Color"], end.inputs[0])
    end, node = outer.nodes.new("NodeGroupOutput"), outer.nodes.new("ShaderNodeGroup")
    node.node_tree = inner
    node.inputs["Scale"].default_value = 3
    outer.links.new(node.outputs[0], end.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = outer
    tree.links.new(node.outputs[0], colour)
    return material


def target_object():
    """Coordinates of another object: turned, mirrored, sheared by its parent, and animated."""
    material = read("Object")()
    parent, target = (bpy.data.objects.new(n, None) for n in ("Parent", "Target"))
    parent.scale = (1, 2, 1)
    target.parent = parent
    target.location, target.rotation_euler, target.scale = (
        (0.3, 0.1, 0.2),
        (1, 2, 3),
        (1, -1.5, 0.7),
    )
    for frame, turn in ((1, 1), (11, 4)):
        target.rotation_euler.x = turn
        target.keyframe_insert("rotation_euler", frame=frame)
    for obj in (parent, target):
        bpy.context.scene.collection.objects.link(obj)
    node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeTexCoord")
    node.object = target
    bpy.context.scene.frame_set(5)
    return material


def new_copy(source):
    """An object with the copy's node group, which hands the three coordinates on."""
    mesh = bpy.data.meshes.new("Carrier")
    copy = bpy.data.objects.new("Copy", mesh)
    bpy.data.scenes["Own"].collection.objects.link(copy)
    modifier = copy.modifiers.new("Copy", "NODES")
    modifier.node_group = names.load_group(names.COPY_GROUP)
    hand_on(modifier.node_group)
    write_input(modifier, "Source", source)
    return copy


def hand_on(group):
    """Let the group sample the coordinates from the carrier, where it does not do so itself."""
    nodes, links = group.nodes, group.links
    stored = {n.inputs["Name"].default_value for n in nodes if "StoreNamed" in n.bl_idname}
    carrier = next(n for n in nodes if n.bl_idname == "NodeGroupInput").outputs["Geometry"]
    move = next(n for n in nodes if n.bl_idname == "GeometryNodeSetPosition")
    for name in sorted(texture_coordinates.COORDINATES - stored):
        named = nodes.new("GeometryNodeInputNamedAttribute")
        sample, store = (
            nodes.new("GeometryNodeSampleIndex"),
            nodes.new("GeometryNodeStoreNamedAttribute"),
        )
        for node in (named, sample, store):
            node.data_type = "FLOAT_VECTOR"
        named.inputs["Name"].default_value = store.inputs["Name"].default_value = name
        links.new(carrier, sample.inputs["Geometry"])
        links.new(named.outputs["Attribute"], sample.inputs["Value"])
        links.new(nodes.new("GeometryNodeInputIndex").outputs[0], sample.inputs["Index"])
        links.new(sample.outputs["Value"], store.inputs["Value"])
        links.new(move.inputs["Geometry"].links[0].from_socket, store.inputs["Geometry"])
        links.new(store.outputs[0], move.inputs["Geometry"])


def write_carrier(copy, source, depsgraph):
    """As an update does in a render."""
    mesh = copy.data
    with pieces(source, depsgraph) as parts:
        points = world_positions(parts)
        mesh.clear_geometry()
        mesh.vertices.add(len(points))
        write_attribute(mesh, "position", points + MOVED, "FLOAT_VECTOR")
        write_attribute(mesh, "rg_seen", np.ones(len(points)), "FLOAT")
        write_coordinates(mesh, coordinates(parts, dressed_coordinates(copy)))
    mesh.update()
    mesh.update_tag()


def write_refined(copy, source, depsgraph):
    """As an update does for long edges: the carrier holds the mesh itself, subdivided."""
    with pieces(source, depsgraph) as parts:
        arrays = read_source_mesh(parts, coordinates(parts, dressed_coordinates(copy)))
        triangles = Triangles.whole(arrays.points, arrays.corners)
        edges, triangle_edges = triangles.edges()
        triangles = triangles.split(edges, triangle_edges, np.ones(len(edges), bool))
        moved = replace(triangles, points=triangles.points + MOVED)
        write_mesh(copy.data, arrays.parted(moved))
    write_attribute(copy.data, "rg_seen", np.ones(len(moved.points)), "FLOAT")


def compare(scene, source, *, write=write_carrier, copy=None):
    """Render the source and its copy, which is made and dressed here; returns both pictures."""
    if copy is None:
        copy = new_copy(source)
        dress([copy], source, bpy.context.evaluated_depsgraph_get())

    def follow(rendered, depsgraph):
        if rendered == scene and depsgraph.mode == "RENDER":
            write(copy, source, depsgraph)

    bpy.app.handlers.frame_change_post.append(follow)
    direct = render_picture(scene)
    bpy.app.handlers.frame_change_post.remove(follow)
    own_scene = bpy.data.scenes["Own"]
    own_scene.frame_set(scene.frame_current)
    copied = render_picture(own_scene)
    both = (direct[..., 3] == 1) & (copied[..., 3] == 1)
    # Where an edge passes a pixel's centre, rounding decides.
    assert both.sum() > 100 and (direct[..., 3] != copied[..., 3]).sum() < 4
    off = np.abs(direct - copied).max(axis=-1)[both]
    assert np.sort(off)[-3] < 1e-3
    return direct, copied


CASES = {
    "generated": (read("Generated"), {"rg_generated"}),
    "object": (read("Object"), {"rg_object"}),
    "position": (read("Position", "ShaderNodeNewGeometry"), {"rg_position"}),
    "normal": (read("Normal"), set()),
    "target": (target_object, {"rg_position"}),
    "group": (in_group, {"rg_generated"}),
    "environment": (texture("Environment"), {"rg_position"}),
    "reroute": (texture("Noise", "NodeReroute"), {"rg_generated"}),
    "muted": (texture("Noise", "ShaderNodeMapping"), {"rg_generated"}),
    "colour": (read("Color", "ShaderNodeObjectInfo"), set()),
    "location": (read("Location", "ShaderNodeObjectInfo"), set()),
    "index": (read("Object Index", "ShaderNodeObjectInfo"), set()),
    "random": (read("Random", "ShaderNodeObjectInfo"), set()),
    "property": (
        read("Color", "ShaderNodeAttribute", attribute_type="OBJECT", attribute_name="own"),
        set(),
    ),
    "path": (
        read("Color", "ShaderNodeAttribute", attribute_type="OBJECT", attribute_name="color"),
        set(),
    ),
} | {
    kind.lower(): (texture(kind), {"rg_generated"})
    for kind in ("Brick", "Checker", "Gabor", "Gradient", "Magic", "Noise", "Voronoi", "Wave")
}


@pytest.mark.parametrize("case", CASES)
def test_a_copy_looks_like_its_source(scene, case):
    build, needed = CASES[case]
    source = new_source()
    source.data.materials.append(build())
    copy = new_copy(source)
    dress([copy], source, bpy.context.evaluated_depsgraph_get())
    assert dressed_coordinates(copy) == needed
    # A hard step of a pattern may fall on a pixel's centre.
    compare(scene, source, copy=copy)


def subdivided(source):
    modifier = source.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 2


def bent(source):
    """Deformed after a subdivision: the coordinates stay those of the ball."""
    subdivided(source)
    modifier = source.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.angle = "BEND", 1.0


def armature_and_displace(source):
    subdivided(source)
    modifier = source.modifiers.new("Displace", "DISPLACE")
    modifier.strength = 0.3
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["Bone"].rotation_euler = (0.5, 0.2, 0.1)
    rig.pose.bones["Bone"].rotation_mode = "XYZ"
    source.vertex_groups.new(name="Bone").add(range(40), 1.0, "REPLACE")
    source.modifiers.new("Armature", "ARMATURE").object = rig


def own_texture_space(source):
    bent(source)
    source.data.use_auto_texspace = False
    source.data.texspace_location = (0.3, 0.1, -0.2)
    source.data.texspace_size = (1.5, 0.7, 2)


def texture_mesh(source):
    subdivided(source)
    other = source.data.copy()
    other.transform(source.matrix_basis)
    source.data.texture_mesh = other


def shape_key(source):
    source.shape_key_add(name="Basis")
    key = source.shape_key_add(name="Key")
    key.value = 0.7
    for point in key.data[:40]:
        point.co.x *= 1.5


@pytest.mark.parametrize(
    ("change", "write"),
    [
        (bent, write_carrier),
        (armature_and_displace, write_carrier),
        (own_texture_space, write_carrier),
        (texture_mesh, write_carrier),
        (shape_key, write_carrier),
        (own_texture_space, write_refined),
    ],
)
def test_modifiers_and_texture_spaces(scene, change, write):
    source = new_source()
    material, tree, colour = new_material()
    place = tree.nodes.new("ShaderNodeTexCoord")
    both = tree.nodes.new("ShaderNodeVectorMath")
    both.operation = "MULTIPLY_ADD"
    both.inputs[1].default_value = (0.3, 0.3, 0.3)
    tree.links.new(place.outputs["Object"], both.inputs[0])
    tree.links.new(place.outputs["Generated"], both.inputs[2])
    tree.links.new(both.outputs[0], colour)
    source.data.materials.append(material)
    change(source)
    compare(scene, source, write=write)


def test_instances_and_their_materials(scene):
    """Two instances of an object whose mesh has a slot twice; each has its own coordinates."""
    ball = new_source("Ball")
    for material in (read("Generated")(), read("Object")()):
        for _ in range(2):
            ball.data.materials.append(material)
    for polygon in ball.data.polygons:
        polygon.material_index = polygon.index % 4
    members = bpy.data.collections.new("Members")
    for source, place in ((ball, (-1, 0, 0)), (ball.copy(), (1.2, 0.5, 0.5))):
        source.location = place
        source.scale = (0.8, 0.7, 0.6)
        members.objects.link(source)
    bpy.context.scene.collection.objects.unlink(ball)
    source = bpy.data.objects.new("Instances", None)
    source.instance_type, source.instance_collection = "COLLECTION", members
    source.rotation_euler = (0.1, 0.2, 0.3)
    bpy.context.scene.collection.objects.link(source)
    compare(scene, source)


def test_slots_that_the_object_does_not_have(scene):
    source = new_source()
    source.data.materials.append(read("Generated")())
    group = bpy.data.node_groups.new("Set", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    begin, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    assign, index = (group.nodes.new(f"GeometryNode{n}") for n in ("SetMaterial", "InputIndex"))
    odd = group.nodes.new("ShaderNodeMath")
    odd.operation = "PINGPONG"
    odd.inputs[1].default_value = 1
    assign.inputs["Material"].default_value = read("Object")()
    group.links.new(index.outputs[0], odd.inputs[0])
    group.links.new(odd.outputs[0], assign.inputs["Selection"])
    group.links.new(begin.outputs[0], assign.inputs["Geometry"])
    group.links.new(assign.outputs[0], end.inputs[0])
    source.modifiers.new("Set", "NODES").node_group = group
    copy = new_copy(source)
    dress([copy], source, bpy.context.evaluated_depsgraph_get())
    assert dressed_coordinates(copy) == {"rg_generated", "rg_object"}
    compare(scene, source, copy=copy)


def test_slots_linked_to_the_object(scene):
    source = new_source()
    source.data.materials.append(read("Generated")())
    source.data.materials.append(None)
    for polygon in source.data.polygons:
        polygon.material_index = polygon.index % 2
    for slot, output in zip(source.material_slots, ("Object", "Normal"), strict=True):
        slot.link = "OBJECT"
        slot.material = read(output)()
    compare(scene, source)


def test_text(scene):
    """Its mesh is the carrier's own."""
    text = bpy.data.curves.new("Text", "FONT")
    text.body, text.size, text.extrude = "RG", 2.5, 0.3
    text.materials.append(read("Generated")())
    source = bpy.data.objects.new("Text", text)
    source.location, source.rotation_euler = (-1.8, 0, -1), (np.pi / 2 - 0.2, 0, 0.2)
    bpy.context.scene.collection.objects.link(source)
    compare(scene, source, write=write_refined)


def state(data_block):
    """What can be read of a material or group: its own values, nodes, values, links and drivers."""
    tree = getattr(data_block, "node_tree", data_block)
    found = [plain(data_block, {"use_nodes", "users"})]
    found += [plain(node, set()) for node in tree.nodes]
    found += [plain(s, set()) for node in tree.nodes for s in (*node.inputs, *node.outputs)]
    found += [repr((link.from_socket, link.to_socket, link.is_muted)) for link in tree.links]
    return repr([*found, tree.animation_data])


def plain(struct, skipped):
    values = {}
    for prop in struct.bl_rna.properties:
        if prop.identifier not in skipped:
            value = getattr(struct, prop.identifier)
            values[prop.identifier] = list(value) if getattr(prop, "is_array", False) else value
    return values


@pytest.mark.parametrize("build", [in_group, target_object, texture("Wave"), read("Normal")])
def test_originals_are_left_as_they_are(scene, build):
    material = build()
    material.use_fake_user = True
    material.asset_mark()
    groups = [group for group in bpy.data.node_groups]
    before = [state(block) for block in (material, *groups)], material.users
    made = substitute(material)
    assert made != material and made.name.startswith(".")
    assert names.own(made, "substitute") and not made.use_fake_user and made.asset_data is None
    assert ([state(block) for block in (material, *groups)], material.users) == before
    bpy.data.materials.remove(made)
    remove_unused()
    assert [group for group in bpy.data.node_groups] == groups


def test_what_does_not_hang_on_the_object_needs_no_substitute(scene):
    plain_colour, *_ = new_material()
    image, tree, colour = new_material()
    tree.links.new(tree.nodes.new("ShaderNodeTexImage").outputs[0], colour)
    tree.links.new(
        tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], tree.nodes["Image Texture"].inputs[0]
    )
    tree.nodes.new("ShaderNodeTexCoord")
    linked, tree, colour = new_material()
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(tree.nodes.new("ShaderNodeUVMap").outputs[0], noise.inputs["Vector"])
    for material in (plain_colour, image, linked):
        assert substitute(material) == material
    assert len(bpy.data.materials) == 3


def blocks():
    return {
        (kind, block.session_uid)
        for kind in ("materials", "node_groups", "objects", "meshes", "images", "actions")
        for block in getattr(bpy.data, kind)
    }


def test_nothing_is_made_twice(scene):
    source = new_source()
    for build in (in_group, target_object, read("Normal"), new_material):
        built = build()
        source.data.materials.append(built if build is not new_material else built[0])
    copy = new_copy(source)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    dress([copy], source, depsgraph)
    before, drivers = blocks(), len(copy.animation_data.drivers)
    # Selecting, moving nodes, animation and another frame change nothing.
    for node in source.data.materials[0].node_tree.nodes:
        node.select, node.location.x = not node.select, 50
    scene.frame_set(8)
    dress([copy], source, bpy.context.evaluated_depsgraph_get())
    assert blocks() == before and len(copy.animation_data.drivers) == drivers
    assert [slot.material.get(names.TAG) for slot in copy.material_slots] == 3 * ["substitute"] + [
        None
    ]


def first(tree, kind):
    return next(node for node in tree.nodes if node.bl_idname == f"ShaderNode{kind}")


def test_edits_are_followed(scene):
    material = in_group()
    source = new_source()
    source.data.materials.append(material)
    copy = new_copy(source)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    tree, inner = material.node_tree, bpy.data.node_groups["Inner"]

    def worn():
        dress([copy], source, depsgraph)
        return copy.material_slots[0].material

    def check(edit):
        before, count = worn(), len(blocks())
        former = before.session_uid
        edit()
        after = worn()
        assert after.session_uid != former and worn() == after and len(blocks()) == count
        return after.node_tree

    made = check(lambda: setattr(first(tree, "VectorMath").inputs[1], "default_value", (1, 1, 1)))
    assert first(made, "VectorMath").inputs[1].default_value[:] == (1, 1, 1)
    noise = first(inner, "TexNoise")
    made = check(lambda: setattr(noise, "noise_dimensions", "4D"))
    group = first(first(made, "Group").node_tree, "Group").node_tree
    assert group != inner and first(group, "TexNoise").noise_dimensions == "4D"
    assert first(group, "TexNoise").inputs["Scale"].is_linked
    made = check(lambda: setattr(material, "displacement_method", "BOTH"))
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    made = check(lambda: tree.links.new(ramp.outputs[0], first(tree, "VectorMath").inputs[2]))
    made = check(lambda: setattr(ramp.color_ramp.elements[0], "position", 0.5))
    assert first(made, "ValToRGB").color_ramp.elements[0].position == 0.5
    # In the end nothing hangs on the object any more.
    tree.nodes.remove(first(tree, "Group"))
    assert worn() == material
    remove_unused()
    assert not [
        b for b in (*bpy.data.materials, *bpy.data.node_groups) if names.own(b, "substitute")
    ]


def test_renamed_and_removed_originals(scene):
    material, other = read("Generated")(), read("Object")()
    source = new_source()
    source.data.materials.append(material)
    copy = new_copy(source)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    dress([copy], source, depsgraph)
    material.name, other.name = "Renamed", "Material"
    dress([copy], source, depsgraph)
    worn = copy.material_slots[0].material
    assert first(worn.node_tree, "Attribute").attribute_name == "rg_generated"
    assert worn != substitute(other)
    bpy.data.materials.remove(material)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    dress([copy], source, depsgraph)
    assert copy.material_slots[0].material is None and dressed_coordinates(copy) == set()
    bpy.data.materials.remove(other)
    remove_unused()
    assert not len(bpy.data.materials)


def test_linked_materials_get_local_substitutes(scene, tmp_path):
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {in_group()})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (available, wanted):
        wanted.materials = available.materials
    material = wanted.materials[0]
    made = substitute(material)
    assert made.library is None and substitute(material) == made
    outer = first(made.node_tree, "Group").node_tree
    inner = first(outer, "Group").node_tree
    assert outer.library is None and inner.library is None
    assert first(inner, "Attribute").attribute_name == "rg_generated"
    assert material.library is not None and bpy.data.node_groups["Inner"].library is not None


def test_another_frame_needs_nothing_new(scene):
    """Targets and the source's own frame follow by drivers."""
    source = new_source()
    material, tree, colour = new_material()
    place = tree.nodes.new("ShaderNodeTexCoord")
    place.object = first(target_object().node_tree, "TexCoord").object
    both = tree.nodes.new("ShaderNodeVectorMath")
    tree.links.new(place.outputs["Object"], both.inputs[0])
    tree.links.new(place.outputs["Normal"], both.inputs[1])
    tree.links.new(both.outputs[0], colour)
    source.data.materials.append(material)
    for frame, turn in ((1, 0.5), (11, 2)):
        source.rotation_euler.x = turn
        source.keyframe_insert("rotation_euler", frame=frame)
    dressed_at_five, _ = compare(scene, source)
    scene.frame_set(9)
    later, _ = compare(scene, source, copy=bpy.data.objects["Copy"])
    assert np.abs(later - dressed_at_five).max() > 0.1
