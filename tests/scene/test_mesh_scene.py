# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses that are meshes, as renders show them: laws, and closed forms as the measure."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import handlers
from glass_refraction.reference.cycles import render_reference
from glass_refraction.scene import update as door
from glass_refraction.scene.memory import counters
from glass_refraction.scene.names import (
    MODIFIER,
    VERSION_KEY,
    RefractiveGlassError,
    load_group,
    own,
    renew_groups,
)
from glass_refraction.scene.rays import exits
from glass_refraction.scene.read.glasses import (
    instanced_glasses,
    named_glasses,
    read_glass,
    read_glasses,
)
from glass_refraction.scene.read.mesh_corners import triangles_of
from glass_refraction.scene.read.mesh_glasses import open_edges
from glass_refraction.scene.read.modifier_inputs import (
    data_path,
    glass_modifier,
    has_input,
    read_input,
    write_input,
)
from glass_refraction.scene.read.unread import unread

SIZE = {"width": 80, "height": 60, "samples": 4, "shading": "TRUE", "surface": "GLASS"}


def _own_mesh(obj=None, **values):
    """Make an object a glass of its own mesh."""
    if obj is not None:
        bpy.context.view_layer.objects.active = obj
    made = bpy.ops.object.refractive_glass_modifier_add(shape="MESH", **values)
    assert made == {"FINISHED"}
    return bpy.context.object


def _ball(radius=0.04, location=(0.0, 0.0, 0.08), segments=48, *, smooth=True):
    bpy.ops.mesh.primitive_uv_sphere_add(
        radius=radius, location=location, segments=segments, ring_count=segments // 2
    )
    if smooth:
        bpy.ops.object.shade_smooth()
    return bpy.context.object


def _tube(radius, inner, height, segments):
    """A closed tube whose walls have the normals of a cylinder."""
    angle = np.arange(segments) * 2 * np.pi / segments
    ring = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    corners = ((radius, 0.0), (radius, height), (inner, height), (inner, 0.0))
    points = [(*(r * ring[k]), z) for r, z in corners for k in range(segments)]
    faces = []
    for row in range(4):
        for k in range(segments):
            k2, row2 = (k + 1) % segments, (row + 1) % 4
            faces.append([row * segments + k, row * segments + k2])
            faces[-1] += [row2 * segments + k2, row2 * segments + k]
    mesh = bpy.data.meshes.new("Tube")
    mesh.from_pydata(points, [], faces)
    # Walls are smooth, rims flat; the edges between them are sharp.
    mesh.polygons.foreach_set(
        "use_smooth", [row % 2 == 0 for row in range(4) for _ in range(segments)]
    )
    mesh.edges.foreach_set("use_edge_sharp", np.zeros(len(mesh.edges), bool))
    ends = np.array([edge.vertices for edge in mesh.edges])
    same_ring = ends[:, 0] // segments == ends[:, 1] // segments
    mesh.edges.foreach_set("use_edge_sharp", same_ring)
    obj = bpy.data.objects.new("Tube", mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _differences(a, b):
    return np.abs(a[..., :3] - b[..., :3]).max(axis=2)


def test_a_finely_tessellated_cylinder_is_the_closed_form(tmp_path, monkeypatch):
    # Both of as many rays a pixel.
    monkeypatch.setattr(exits, "FINER_OF_MESHES", exits.FINER)
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    exact = scenes.glass(shape="CYLINDER", radius=0.04, wall_thickness=0.004, height=0.12)
    closed = scenes.picture(scene, tmp_path, "closed")
    covered = door.memory_of(scene).covered.copy()
    bpy.data.objects.remove(exact)
    _own_mesh(_tube(0.04, 0.036, 0.12, 1024))
    mesh = scenes.picture(scene, tmp_path, "mesh")
    assert door.status(scene).problems == []
    assert covered.sum() > 300
    off = _differences(closed, mesh)
    # Where light ends, facets end elsewhere by a hundredth of a pixel.
    assert np.quantile(off[covered], 0.95) < 0.02
    assert off[covered].mean() < 0.01


def test_a_mesh_of_the_airs_own_ior_is_not_there(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _own_mesh(_ball(), ior=1.0)
    found = scenes.picture(scene, tmp_path)
    scene.refractive_glass.enabled = False
    obj.hide_render = True
    plain = scenes.picture(scene, tmp_path, "plain")
    assert np.quantile(_differences(found, plain), 0.98) < 0.05


def test_renders_hide_the_mesh_and_a_disabled_extension_shows_it(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    obj = _own_mesh(_ball())
    scenes.picture(scene, tmp_path)
    assert not read_input(glass_modifier(obj), "Show in Render")
    assert door.memory_of(scene).covered.sum() > 200
    scene.refractive_glass.enabled = False
    scenes.picture(scene, tmp_path, "off")
    assert read_input(glass_modifier(obj), "Show in Render")


@pytest.mark.parametrize(
    ("kind", "engine"), [("shape key", "CYCLES"), ("armature", "BLENDER_EEVEE")]
)
def test_each_frame_of_a_moving_mesh_is_as_alone(tmp_path, kind, engine):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(60, 45, samples=2, shading="TRUE", surface="GLASS")
    scene.render.engine, scene.eevee.taa_render_samples = engine, 2
    if engine == "BLENDER_EEVEE":
        scenes.coarse_eevee(scene)
    obj = _ball(segments=16)
    if kind == "armature":
        _bend(scene, obj)
    else:
        obj.shape_key_add(name="Basis")
        key = obj.shape_key_add(name="Wide")
        for point in key.data:
            point.co.x *= 1.6
        for frame, value in ((1, 0.0), (3, 1.0)):
            key.value = value
            key.keyframe_insert("value", frame=frame)
    _own_mesh(obj)
    scene.frame_start, scene.frame_end = 1, 3
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True)
    frames = [scenes.load(tmp_path / f"frame_{frame:04d}.exr") for frame in (1, 2, 3)]
    assert _differences(frames[0], frames[2]).max() > 0.2
    for frame in (3, 2):
        door.forget()
        scene.frame_set(frame)
        alone = scenes.picture(scene, tmp_path, f"alone_{frame}")
        np.testing.assert_array_equal(alone, frames[frame - 1])


def _bend(scene, obj):
    """An armature of one bone that carries the mesh aside, from frame 1 to frame 3."""
    data = bpy.data.armatures.new("Armature")
    armature = bpy.data.objects.new("Armature", data)
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bone = data.edit_bones.new("Bone")
    bone.head, bone.tail = (0.0, 0.0, 0.0), (0.0, 0.0, 0.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    group = obj.vertex_groups.new(name="Bone")
    group.add(range(len(obj.data.vertices)), 1.0, "REPLACE")
    obj.modifiers.new("Armature", "ARMATURE").object = armature
    pose = armature.pose.bones["Bone"]
    for frame, x in ((1, 0.0), (3, 0.03)):
        pose.location = (x, 0.0, 0.0)
        pose.keyframe_insert("location", frame=frame)


def test_of_overlapping_meshes_the_higher_priority_holds(tmp_path):
    """A ball of water that runs into one of glass, against water cut to what the glass leaves.

    Both are flat: a cut would give smooth ones other normals round its edge.
    """
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    glass = _own_mesh(_ball(0.03, (-0.02, 0.0, 0.08), 24, smooth=False), ior=1.5)
    water = _own_mesh(_ball(0.03, (0.02, 0.0, 0.08), 24, smooth=False), ior=1.333)
    write_input(glass_modifier(glass), "Priority", 1)
    overlapping = scenes.picture(scene, tmp_path, "overlapping")
    # Priority the other way round is another thing.
    write_input(glass_modifier(glass), "Priority", -1)
    other = scenes.picture(scene, tmp_path, "other")
    write_input(glass_modifier(glass), "Priority", 1)
    cut = water.modifiers.new("Cut", "BOOLEAN")
    cut.object, cut.operation, cut.solver = _copy_of(glass), "DIFFERENCE", "EXACT"
    with bpy.context.temp_override(object=water):
        bpy.ops.object.modifier_move_to_index(modifier="Cut", index=0)
    apart = scenes.picture(scene, tmp_path, "apart")
    covered = door.memory_of(scene).covered
    assert door.status(scene).problems == []
    off, far_off = (_differences(overlapping, seen)[covered] for seen in (apart, other))
    # The cut's facets are those of both balls: what differs are pixels at borders.
    assert np.median(off) < 0.01
    assert off.mean() < 0.2 * far_off.mean()


def _copy_of(glass):
    """The same mesh as no glass and hidden, for a Boolean modifier."""
    tool = bpy.data.objects.new("Tool", glass.data)
    tool.matrix_world = glass.matrix_world
    bpy.context.scene.collection.objects.link(tool)
    tool.hide_render = True
    bpy.context.view_layer.update()
    return tool


@pytest.mark.parametrize("linked", ["nowhere", "excluded"])
@pytest.mark.parametrize("shape", ["MESH", "SPHERE"])
def test_instances_are_glasses_in_their_places(tmp_path, shape, linked):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    if shape == "MESH":
        obj = _own_mesh(_ball(0.03, (0.0, 0.0, 0.0)))
    else:
        obj = scenes.glass(shape="SPHERE", radius=0.03, wall_thickness=0.0)
    places = ((-0.05, 0.0, 0.08), (0.05, 0.02, 0.09))
    collection = bpy.data.collections.new("Glasses")
    for held in list(obj.users_collection):
        held.objects.unlink(obj)
    collection.objects.link(obj)
    if linked == "excluded":
        scene.collection.children.link(collection)
        bpy.context.view_layer.layer_collection.children[collection.name].exclude = True
    empties = []
    for place in places:
        empty = bpy.data.objects.new("Instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = place
        scene.collection.objects.link(empty)
        empties.append(empty)
    instanced = scenes.picture(scene, tmp_path, "instanced")
    assert door.status(scene).problems == []
    covered = door.memory_of(scene).covered.copy()
    assert covered.sum() > 200
    for empty, place in zip(empties, places, strict=True):
        bpy.data.objects.remove(empty)
        real = obj.copy()
        real.location = place
        scene.collection.objects.link(real)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(instanced, scenes.picture(scene, tmp_path, "real"), atol=2e-3)


def test_a_mirrored_sheared_mesh_keeps_its_outside():
    obj = _own_mesh(_ball())
    obj.scale = (-1.0, 2.0, 0.5)
    obj.rotation_euler = (0.3, 0.2, 0.9)
    bpy.context.view_layer.update()
    found = read_glass(obj, scenes.depsgraph()).description
    points = found.points
    flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    middle = points.mean(axis=(0, 1))
    assert np.all(np.einsum("nk,nk->n", flat, points.mean(axis=1) - middle) > 0.0)
    assert np.all(np.einsum("nk,nck->nc", flat, found.normals) > 0.0)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=2), 1.0)


def _material(kind, **values):
    material = bpy.data.materials.new(kind)
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(kind)
    for name, value in values.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], end.inputs["Surface"])
    return material


@pytest.mark.parametrize(
    ("kind", "values", "refracted", "reflected"),
    [
        ("ShaderNodeBsdfGlass", {"Color": (0.5, 1, 1, 1)}, (0.5, 1, 1), (0.5, 1, 1)),
        ("ShaderNodeBsdfRefraction", {"Color": (0.5, 1, 1, 1)}, (0.5, 1, 1), (0.5, 1, 1)),
        (
            "ShaderNodeBsdfPrincipled",
            {"Base_Color": (0.25, 1, 1, 1), "Transmission_Weight": 1.0},
            (0.5, 1, 1),
            (1, 1, 1),
        ),
    ],
)
def test_the_meshs_own_material_is_read(kind, values, refracted, reflected):
    obj = _ball()
    obj.data.materials.append(_material(kind, IOR=1.7, Roughness=0.2, **values))
    _own_mesh(obj)
    found = read_glass(obj, scenes.depsgraph()).description
    assert (found.ior, found.roughness) == pytest.approx((1.7, 0.2))
    assert found.refracted == pytest.approx(refracted)
    assert found.reflected == pytest.approx(reflected)
    assert read_input(glass_modifier(obj), "IOR") == pytest.approx(1.7)


def test_without_a_glassy_material_the_modifiers_ior_holds():
    obj = _ball()
    obj.data.materials.append(_material("ShaderNodeBsdfDiffuse"))
    _own_mesh(obj, ior=1.6)
    write_input(glass_modifier(obj), "IOR", 1.4)
    bpy.context.view_layer.update()
    assert read_glass(obj, scenes.depsgraph()).description.ior == pytest.approx(1.4)


def test_what_is_not_read_of_materials_is_told():
    """Something was left out, and nothing said so."""
    obj = _ball()
    glass = _material("ShaderNodeBsdfGlass")
    obj.data.materials.append(glass)
    assert unread(_own_mesh(obj), 0) == []
    tree = glass.node_tree
    shader = next(n for n in tree.nodes if n.type == "BSDF_GLASS")
    tree.links.new(tree.nodes.new("ShaderNodeFresnel").outputs[0], shader.inputs["Roughness"])
    (without,) = unread(obj, 0)
    assert "as Roughness:" in without and "Fresnel" in without
    scenes.camera()
    door.prepare(scenes.settings(shading="TRUE"), scenes.depsgraph())
    assert without in door.status(bpy.context.scene).problems


def test_a_mesh_of_no_faces_or_no_numbers_is_one_line():
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [], [])
    obj = bpy.data.objects.new("My Points", mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    with pytest.raises(RuntimeError, match='"My Points": its mesh has no faces') as error:
        bpy.ops.object.refractive_glass_modifier_add(shape="MESH")
    assert len(str(error.value).strip().splitlines()) == 1
    assert not obj.modifiers
    ball = _own_mesh(_ball())
    ball.data.vertices[0].co.x = np.nan
    bpy.context.view_layer.update()
    with pytest.raises(RefractiveGlassError, match="no number"):
        read_glass(ball, scenes.depsgraph())


def test_a_mesh_that_cannot_be_read_is_said_and_shown_as_it_is(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(**SIZE)
    ball = _own_mesh(_ball())
    ball.data.clear_geometry()
    scenes.picture(scene, tmp_path)
    (problem,) = door.status(scene).problems
    assert f'"{ball.name}"' in problem
    assert read_input(glass_modifier(ball), "Show in Render")


def test_displaced_shading_says_that_it_knows_no_meshes(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(60, 45, samples=1, shading="DISPLACED")
    ball = _own_mesh(_ball())
    scenes.glass(shape="CYLINDER", radius=0.02)
    scenes.picture(scene, tmp_path)
    assert [p for p in door.status(scene).problems if f'"{ball.name}"' in p and "Displaced" in p]
    assert read_input(glass_modifier(ball), "Show in Render")


def _crooked():
    """Suzanne, and beside her a crooked quad, a concave one either way, and a concave star."""
    bpy.ops.mesh.primitive_monkey_add(size=0.1)
    bpy.ops.object.shade_smooth()
    obj = bpy.context.object
    points = [tuple(v.co) for v in obj.data.vertices]
    faces = [tuple(face.vertices) for face in obj.data.polygons]
    angle = np.linspace(0.0, 2.0 * np.pi, 10, endpoint=False)
    radius = np.where(np.arange(10) % 2, 0.4, 1.0)
    star = np.stack((radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle), axis=1)
    arrow = np.array([(0, 0, 0), (1, -1, 0), (0, 1, 0), (-1, -1, 0.1)])
    crooked = np.array([(0, 0, 0), (1, 0, 0.5), (1, 1, 0), (0, 1, 0.5)])
    for k, face in enumerate((star, arrow, np.roll(arrow, 1, axis=0), crooked)):
        faces.append(tuple(range(len(points), len(points) + len(face))))
        points += (0.02 * face + (0.2 + 0.1 * k, 0.0, 0.0)).tolist()
    mesh = bpy.data.meshes.new("Crooked")
    mesh.from_pydata(points, [], faces)
    mesh.shade_smooth()
    obj.data = mesh
    return obj


def test_the_triangles_of_a_mesh_are_those_that_engines_draw(tmp_path):
    scenes.camera()
    scene = scenes.settings(24, 18, samples=1, shading="TRUE", surface="GLASS")
    obj = _crooked()
    # What each corner of a triangle has tells that triangle from all others.
    wanted = np.concatenate(triangles_of(obj.data), axis=2).reshape(-1, 18)
    _own_mesh(obj)
    glass = _rendered_mesh(scene, tmp_path)
    found = np.concatenate((glass.points, glass.normals), axis=2).reshape(-1, 18)
    # A triangle may begin at any of its corners.
    turned = np.concatenate([np.roll(found, 6 * k, axis=1) for k in range(3)])
    apart = np.abs(turned[:, None] - wanted[None]).max(axis=2).min(axis=0)
    assert len(found) == len(wanted)
    assert apart.max() < 1e-5


def test_open_meshes_are_recognised():
    ball = _ball(segments=8)
    assert open_edges(ball.data) == (0, 0)
    bpy.ops.mesh.primitive_plane_add()
    assert open_edges(bpy.context.object.data) == (4, 0)


def test_subdivision_is_taken_as_renders_have_it():
    bpy.ops.mesh.primitive_cube_add(size=0.1)
    obj = bpy.context.object
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 2
    _own_mesh(obj)
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(40, 30, samples=1, shading="TRUE", surface="GLASS")
    sizes = []

    def count(user_scene, depsgraph):
        if user_scene == scene and depsgraph.mode == "RENDER":
            sizes.append(len(read_glasses(depsgraph)[0].description.points))

    bpy.app.handlers.frame_change_post.append(count)
    try:
        bpy.ops.render.render(scene=scene.name)
    finally:
        bpy.app.handlers.frame_change_post.remove(count)
    assert set(sizes) == {2 * 6 * 4**2}


def _points_host(name, node, *, as_instance=True, realise=False):
    """An object of three points 0.1 m apart at which what a node gives is instanced."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    line = tree.nodes.new("GeometryNodeMeshLine")
    line.inputs["Count"].default_value = 3
    line.inputs["Offset"].default_value = (0.1, 0.0, 0.0)
    place = tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(line.outputs[0], place.inputs["Points"])
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = node
    info.inputs["As Instance"].default_value = as_instance
    tree.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    last = place.outputs[0]
    if realise:
        last = tree.nodes.new("GeometryNodeRealizeInstances").outputs[0]
        tree.links.new(place.outputs[0], last.node.inputs[0])
    tree.links.new(last, tree.nodes.new("NodeGroupOutput").inputs[0])
    host = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    host.modifiers.new("Nodes", "NODES").node_group = tree
    return host


def _out_of_the_scene(obj):
    for collection in obj.users_collection:
        collection.objects.unlink(obj)
    return obj


def test_glasses_that_instances_of_instances_show_are_seen():
    scenes.settings(shading="TRUE", surface="GLASS")
    glass = _out_of_the_scene(_own_mesh(_ball(location=(0, 0, 0))))
    inner = _points_host("Inner", glass)
    outer = _points_host("Outer", inner)
    bpy.context.scene.collection.objects.link(outer)
    bpy.context.view_layer.update()
    found = read_glasses(scenes.depsgraph())
    places = sorted(round(float(g.description.box.mean(axis=0)[0]), 3) for g in found)
    assert places == [0.0, 0.1, 0.1, 0.2, 0.2, 0.2, 0.3, 0.3, 0.4]


@pytest.mark.parametrize("hidden", [True, False])
def test_instances_of_a_glass_are_seen_whether_renders_show_itself_or_not(tmp_path, hidden):
    """Blender shows what nodes instance, also of an object that is out of renders."""
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(40, 30, samples=1, shading="TRUE", surface="GLASS")
    glass = _own_mesh(_ball(0.03, (0.0, 0.0, 0.0)))
    # Behind the camera.
    glass.location, glass.hide_render = (0.0, -5.0, 0.0), hidden
    host = _points_host("Host", glass)
    host.location = (-0.1, 0.0, 0.08)
    scene.collection.objects.link(host)
    scenes.picture(scene, tmp_path)
    assert door.status(scene).problems == []
    assert instanced_glasses(scene.view_layers[0]) == [glass] * hidden
    assert named_glasses(scene.view_layers[0]) == [glass]
    assert door.memory_of(scene).covered.sum() > 100
    # Of a collection what is out of renders shows none.
    bpy.data.objects.remove(host)
    collection, empty = bpy.data.collections.new("Held"), bpy.data.objects.new("Empty", None)
    collection.objects.link(glass)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    assert named_glasses(scene.view_layers[0]) == [glass] * (not hidden)


@pytest.mark.parametrize("way", [{"as_instance": False}, {"realise": True}])
def test_a_glass_that_is_merged_into_another_mesh_is_told(tmp_path, way):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(16, 12, samples=1, shading="TRUE", surface="GLASS")
    glass = _out_of_the_scene(_own_mesh(_ball(location=(0, 0, 0))))
    scene.collection.objects.link(_points_host("Merged", glass, **way))
    scenes.picture(scene, tmp_path)
    said = [p for p in door.status(scene).problems if '"Merged"' in p and f'"{glass.name}"' in p]
    assert len(said) == 1


def test_a_linked_glass_does_not_stop_a_local_one(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(24, 18, samples=1, shading="TRUE", surface="GLASS")
    library = str(tmp_path / "library.blend")
    other = _own_mesh(_ball(location=(0.1, 0.0, 0.08)))
    other.name = "Linked"
    bpy.data.libraries.write(library, {other})
    bpy.data.objects.remove(other)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.objects = ["Linked"]
    scene.collection.objects.link(wanted.objects[0])
    _own_mesh(_ball())
    scenes.picture(scene, tmp_path)
    assert door.memory_of(scene).covered.sum() > 20
    assert [p for p in door.status(scene).problems if '"Linked"' in p]


def test_renders_know_the_roughness_of_the_meshs_own_material(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(24, 18, samples=1, shading="TRUE", surface="GLASS")
    obj = _ball()
    obj.data.materials.append(_material("ShaderNodeBsdfGlass", IOR=1.7, Roughness=0.2))
    _own_mesh(obj)
    mesh = _rendered_mesh(scene, tmp_path)
    assert (mesh.ior, mesh.roughness) == pytest.approx((1.7, 0.2))


def _rendered_mesh(scene, folder):
    """The one glass of a scene as a render knows it."""
    seen = []

    def read(user_scene, depsgraph):
        if user_scene == scene and depsgraph.mode == "RENDER":
            seen.append(read_glasses(depsgraph)[0].description)

    bpy.app.handlers.frame_change_post.append(read)
    try:
        scenes.picture(scene, folder)
    finally:
        bpy.app.handlers.frame_change_post.remove(read)
    return seen[0]


def _auto_smooth(obj):
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.shade_auto_smooth()


def _bevel(obj):
    obj.modifiers.new("Bevel", "BEVEL").width = 0.005


@pytest.mark.parametrize(
    ("before", "after"),
    [([_auto_smooth], []), ([], [_auto_smooth]), ([_auto_smooth], [_bevel]), ([], [_bevel])],
    ids=("smoothed", "smoothed afterwards", "smoothed, then bevelled", "bevelled afterwards"),
)
def test_all_modifiers_shape_the_glass_whenever_they_are_added(tmp_path, before, after):
    scenes.camera()
    scene = scenes.settings(24, 18, samples=1, shading="TRUE", surface="GLASS")
    bpy.ops.mesh.primitive_cylinder_add(radius=0.04, depth=0.1, location=(0.0, 0.0, 0.06))
    obj = bpy.context.object
    for add in before:
        add(obj)
    _own_mesh(obj)
    for add in after:
        add(obj)
    found = _rendered_mesh(scene, tmp_path)
    plain = obj.copy()
    scene.collection.objects.link(plain)
    plain.modifiers.remove(glass_modifier(plain))
    evaluated = plain.evaluated_get(scenes.depsgraph())
    points, normals = triangles_of(evaluated.data)
    # The same corners, in whichever triangles.
    one, other = (
        np.unique(np.concatenate((p, n), axis=2).reshape(-1, 6).round(3) + 0.0, axis=0)
        for p, n in ((found.points, found.normals), (points + np.array(obj.location), normals))
    )
    apart = np.abs(one[:, None] - other).max(axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 2e-3


def _coarser(picture, step):
    """Means (H / step, W / step, C) of a picture's squares."""
    height, width, channels = picture.shape
    blocks = picture.reshape(height // step, step, width // step, step, channels)
    return blocks.mean(axis=(1, 3), dtype=float)


def test_a_rough_pane_is_cycles_own(tmp_path):
    """Also in the reference: of hardly any roughness it is the sharp one."""
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(64, 48, samples=16, shading="TRUE", surface="GLASS")
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.0, 0.0, 0.08), scale=(0.16, 0.02, 0.1))
    pane = bpy.context.object
    pane.rotation_euler = (0.0, 0.0, 0.5)
    material = _material("ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.02)
    pane.data.materials.append(material)
    _own_mesh(pane)
    node = next(n for n in material.node_tree.nodes if n.type == "BSDF_GLASS")
    nearly_sharp = render_reference(scene, samples=64)
    node.inputs["Roughness"].default_value = 0.0
    sharp = render_reference(scene, samples=64)
    node.inputs["Roughness"].default_value = 0.3
    rough = render_reference(scene, samples=256)
    found = scenes.picture(scene, tmp_path)
    inside = door.memory_of(scene).covered

    def psnr(one, other, where=inside):
        return -10 * np.log10(((one - other)[where][:, :3] ** 2).mean())

    assert psnr(nearly_sharp, sharp) > 35
    assert psnr(rough, sharp) < 20
    # Few facets a pixel leave noise: places of 4 x 4 pixels have little of it.
    whole = _coarser(inside[..., None], 4)[..., 0] == 1
    assert psnr(_coarser(found, 4), _coarser(rough, 4), whole) > 33


def _three_in_a_row():
    for k in range(3):
        _own_mesh(_ball(0.03, (0.01 * k, 0.08 * k, 0.08)), ior=1.5)


def _one_in_another():
    """A ball of glass, of closed form, in a mesh of water, and a bubble in that ball."""
    bpy.ops.mesh.primitive_cube_add(size=0.1, location=(0.0, 0.0, 0.08), rotation=(0.0, 0.0, 0.4))
    _own_mesh(ior=1.333)
    ball = scenes.glass(shape="SPHERE", radius=0.035, wall_thickness=0.0, ior=1.7)
    ball.location = (0.0, 0.0, 0.08)
    _own_mesh(_ball(0.012, (0.004, 0.0, 0.085)), ior=1.0)


def _overlapping():
    """Water that runs into a ball of glass of a higher priority."""
    glass = _own_mesh(_ball(0.03, (-0.02, 0.0, 0.08)), ior=1.5)
    _own_mesh(_ball(0.03, (0.02, 0.0, 0.08)), ior=1.333)
    write_input(glass_modifier(glass), "Priority", 1)


def _twelve_instances():
    glass = _out_of_the_scene(_own_mesh(_ball(0.014, (0.0, 0.0, 0.0), 24), ior=1.5))
    collection = bpy.data.collections.new("Glasses")
    collection.objects.link(glass)
    for k in range(12):
        empty = bpy.data.objects.new("Instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = (0.035 * (k % 4 - 1.5), 0.02 * (k % 3), 0.05 + 0.035 * (k // 4))
        bpy.context.scene.collection.objects.link(empty)


@pytest.mark.parametrize(
    "build", [_three_in_a_row, _one_in_another, _overlapping, _twelve_instances]
)
def test_several_glasses_are_cycles_own(tmp_path, build):
    """Within 3 dB of what two of its pictures of different noise differ by."""
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(96, 72, samples=32, shading="TRUE", surface="GLASS")
    build()
    bpy.context.view_layer.update()
    found = scenes.picture(scene, tmp_path)
    inside = door.memory_of(scene).covered
    assert door.status(scene).problems == []
    assert inside.sum() > 200
    one, other = (render_reference(scene, samples=32, seed=seed) for seed in (1, 2))

    def psnr(first, second):
        return -10 * np.log10(((first - second)[inside][:, :3] ** 2).mean())

    assert min(psnr(found, one), psnr(found, other)) > psnr(one, other) - 3.0


def test_the_cost_of_instances_is_that_of_their_pixels(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scene = scenes.settings(96, 72, samples=1, shading="TRUE", surface="GLASS")
    _twelve_instances()
    empties = [obj for obj in scene.objects if obj.instance_type == "COLLECTION"]
    costs = []
    for count in (12, 4):
        for empty in empties[count:]:
            empty.hide_render = True
        before = counters["cast_rays"]
        scenes.picture(scene, tmp_path)
        covered = int(door.memory_of(scene).covered.sum())
        costs.append(((counters["cast_rays"] - before) / covered, covered))
    (twelve, all_pixels), (four, few_pixels) = costs
    assert all_pixels > 2.5 * few_pixels
    assert twelve < 1.3 * four


def test_a_file_of_an_older_version_gets_the_modifier_anew():
    group = load_group(MODIFIER)
    group[VERSION_KEY] = 0
    obj = _own_mesh(_ball())
    assert glass_modifier(obj).node_group != group
    assert read_input(glass_modifier(obj), "Shape") == "Mesh"


def test_glasses_of_an_older_version_are_renewed_with_all_they_have():
    """Smooth meshes were black in the 3D view: the older group shows all their points."""
    obj = _own_mesh(_ball())
    modifier = glass_modifier(obj)
    write_input(modifier, "IOR", 1.7)
    obj.driver_add(data_path(modifier, "Abbe Number")).driver.expression = "42.0"
    old = modifier.node_group
    old.interface.remove(old.interface.items_tree["In Mirrors"])
    del old[VERSION_KEY]
    renew_groups()
    assert read_input(modifier, "In Mirrors") is None
    assert [g.name for g in bpy.data.node_groups if own(g, "glass")] == [MODIFIER]
    bpy.context.view_layer.update()
    assert read_input(modifier, "IOR") == pytest.approx(1.7)
    found = glass_modifier(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    assert read_input(found, "Abbe Number") == 42.0
    renewed = modifier.node_group
    renewed[VERSION_KEY] += 1  # By a newer version: it is not taken back.
    renew_groups()
    assert modifier.node_group == renewed


def test_an_open_file_of_an_older_version_is_renewed_as_the_extension_is_enabled():
    obj = _own_mesh(_ball())
    old = glass_modifier(obj).node_group
    old.interface.remove(old.interface.items_tree["In Mirrors"])
    del old[VERSION_KEY]
    handlers.unregister()
    handlers.register()
    assert has_input(glass_modifier(obj), "In Mirrors")


def test_the_volume_absorption_of_the_meshs_own_material_is_cycles_own(tmp_path):
    scenes.camera(location=(0.0, -0.3, 0.08), tilt=np.pi / 2)
    scene = scenes.settings(48, 36, samples=16, shading="TRUE", surface="GLASS")
    world = bpy.data.worlds.new("World")
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    scene.world = world
    obj = _ball()
    obj.scale = (1.0, 1.0, 0.7)
    material = _material("ShaderNodeBsdfGlass", IOR=1.5, Roughness=0.0)
    tree = material.node_tree
    volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
    volume.inputs["Color"].default_value = (0.2, 0.6, 0.9, 1.0)
    volume.inputs["Density"].default_value = 30.0
    tree.links.new(volume.outputs[0], tree.get_output_node("ALL").inputs["Volume"])
    obj.data.materials.append(material)
    _own_mesh(obj)
    found = scenes.picture(scene, tmp_path)
    assert found[18, 24, 0] < 0.5 * found[18, 24, 2]
    scene.refractive_glass.enabled = False
    scene.cycles.samples = 64
    wanted = scenes.picture(scene, tmp_path, "own")
    assert np.sqrt(((found - wanted)[..., :3] ** 2).mean()) < 0.02
