# SPDX-License-Identifier: GPL-3.0-or-later
"""The one door: what a change costs, what stands afterwards, what of the user's stays."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.build.layers import ROLES, find_layers
from glass_refraction.scene.build.own_scenes import source_of
from glass_refraction.scene.names import TAG, RefractiveGlassError, own
from glass_refraction.scene.read.modifier_inputs import glass_modifier, read_input


def _scene(**settings):
    scenes.camera()
    wall = scenes.striped_wall()
    glass = scenes.glass(shape="CYLINDER")
    settings.setdefault("surface", "REFRACTION")
    return scenes.settings(**settings), wall, glass


def _update():
    assert bpy.ops.scene.refractive_glass_update() == {"FINISHED"}


def _counted(action):
    before = door.counters.copy()
    action()
    after = door.counters.copy()
    after.subtract(before)
    return after


def _data():
    """Names and user counts of every data-block, and what a user would see changed."""
    kinds = ("scenes", "objects", "meshes", "materials", "node_groups", "images", "collections")
    # Making a Render Layers node leaves Blender's user count of the scene one too high.
    return {
        (kind, b.name, b.users if kind != "scenes" else None)
        for kind in kinds
        for b in getattr(bpy.data, kind)
    }


def test_nothing_changed_solves_nothing():
    _scene()
    _update()
    found = _counted(_update)
    assert not any(found[key] for key in ("solves", "masks", "mask_pixels", "copies", "structures"))


def test_a_moved_object_costs_its_own_solve_and_no_mask():
    _scene()
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.02, location=(0, 0.15, 0.06))
    ball = bpy.context.object
    _update()

    def move():
        ball.location.x += 0.01
        bpy.context.view_layer.update()
        _update()

    found = _counted(move)
    assert found["solves"] == 1
    assert found["mask_pixels"] == 0


def test_a_moved_camera_costs_everything():
    scene, _, _ = _scene()
    _update()

    def move():
        scene.camera.location.x += 0.01
        bpy.context.view_layer.update()
        _update()

    found = _counted(move)
    assert found["solves"] == 1
    assert found["masks"] == 1


def test_a_render_after_an_update_solves_nothing(tmp_path):
    scene, _, _ = _scene(shading="DISPLACED")
    scenes.picture(scene, tmp_path)
    found = _counted(lambda: scenes.picture(scene, tmp_path))
    assert not found["solves"]
    assert not found["mask_pixels"]


@pytest.mark.parametrize("way", ["delete", "disable", "modifier"])
def test_what_was_made_goes_with_the_glass(way):
    scene, wall, glass = _scene()
    before = _data()
    _update()
    assert find_layers(scene) is not None
    if way == "delete":
        bpy.data.objects.remove(glass)
    elif way == "disable":
        scene.refractive_glass.enabled = False
    else:
        glass.modifiers.remove(glass.modifiers[0])
    door.prepare(scene, scenes.depsgraph())
    assert find_layers(scene) is None
    assert scene.compositing_node_group is None
    if way == "disable":
        assert _data() == before
    left = [
        b
        for kind in ("scenes", "objects", "collections", "images")
        for b in getattr(bpy.data, kind)
        if own(b)
    ]
    assert not left
    assert wall.name in scene.objects


def test_the_users_compositor_tree_keeps_every_node_and_link():
    scene, _, glass = _scene()
    tree = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    start = tree.nodes.new("CompositorNodeRLayers")
    blur = tree.nodes.new("CompositorNodeBlur")
    other = tree.nodes.new("CompositorNodeInvert")
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(start.outputs["Image"], blur.inputs["Image"])
    tree.links.new(start.outputs["Image"], other.inputs["Color"])
    tree.links.new(blur.outputs[0], end.inputs[0])
    scene.compositing_node_group = tree

    def wiring():
        return sorted(
            (link.from_node.name, link.from_socket.name, link.to_node.name, link.to_socket.name)
            for link in tree.links
        )

    nodes, links = sorted(n.name for n in tree.nodes), wiring()
    _update()
    assert scene.compositing_node_group == tree
    assert set(nodes) < {n.name for n in tree.nodes}
    ours = [n for n in tree.nodes if n.get("refractive_glass") == "group"]
    assert len(ours) == 1
    fed = {link.to_node.name for link in ours[0].outputs["Image"].links}
    assert fed == {blur.name, other.name}
    bpy.data.objects.remove(glass)
    door.prepare(scene, scenes.depsgraph())
    assert sorted(n.name for n in tree.nodes) == nodes
    assert wiring() == links
    assert scene.compositing_node_group == tree


def test_the_users_scene_gets_no_layer_collection_or_object():
    scene, _, _ = _scene()
    layers = [v.name for v in scene.view_layers]
    objects = {o.name for o in scene.objects}
    collections = {c.name for c in scene.collection.children_recursive}
    _update()
    assert [v.name for v in scene.view_layers] == layers
    assert {o.name for o in scene.objects} == objects
    assert {c.name for c in scene.collection.children_recursive} == collections


def _sources(scene):
    """Names of the objects that have copies."""
    return {source_of(copy).name for copy in find_layers(scene).copies().values()}


def test_sources_come_and_go():
    scene, _, _ = _scene()
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0, 0.2, 0.05))
    cube = bpy.context.object
    _update()
    assert _sources(scene) == {"Wall", "Cube"}
    bpy.data.objects.remove(cube)
    _update()
    assert _sources(scene) == {"Wall"}
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0, 0.2, 0.05))
    _update()
    assert _sources(scene) == {"Wall", "Cube"}


def test_renamed_things_stay_together():
    scene, wall, glass = _scene()
    _update()
    glass.name, wall.name, scene.name = "Cup", "Backdrop", "Still Life"
    _update()
    assert len([s for s in bpy.data.scenes if own(s)]) == len(ROLES)
    assert _sources(scene) == {"Backdrop"}


def _no_camera(scene, glass, wall):
    scene.camera = None


def _panorama(scene, glass, wall):
    scene.camera.data.type = "PANO"


def _nothing_to_see(scene, glass, wall):
    wall.hide_render = True


def _sheared(scene, glass, wall):
    glass.scale.z = 2.0


def _no_glass(scene, glass, wall):
    bpy.data.objects.remove(glass)


@pytest.mark.parametrize(
    "spoil", [_no_camera, _panorama, _nothing_to_see, _sheared, _no_glass], ids=lambda f: f.__name__
)
def test_bad_input_is_one_line_and_changes_nothing(spoil):
    scene, wall, glass = _scene()
    spoil(scene, glass, wall)
    bpy.context.view_layer.update()
    before = _data()
    with pytest.raises(RefractiveGlassError) as error:
        door.prepare(scene, scenes.depsgraph(), strict=True)
    assert "\n" not in str(error.value)
    assert _data() == before
    with pytest.raises(RuntimeError, match=str(error.value)[:30].replace("(", r"\(")):
        bpy.ops.scene.refractive_glass_update()


@pytest.mark.parametrize(
    "values",
    [{"ior": 0.0}, {"ior": -1.0}, {"radius": 0.0}, {"wall_thickness": 0.04}, {"height": -1.0}],
    ids=str,
)
def test_the_operator_refuses_impossible_values(values):
    before = _data()
    with pytest.raises(RuntimeError, match=r"must be|give"):
        bpy.ops.object.refractive_glass_add(shape="CYLINDER", **values)
    assert _data() == before


def test_two_scenes_do_not_mix():
    scene, _, _ = _scene()
    _update()
    first = find_layers(scene)
    other = bpy.data.scenes.new("Other")
    bpy.context.window.scene = other
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="ROD")
    scenes.settings()
    _update()
    assert find_layers(scene).mask == first.mask
    assert find_layers(other).mask != first.mask


def test_image_of_a_still_scene_is_the_same_after_reload(tmp_path):
    scene, _, _ = _scene(shading="DISPLACED", samples=1)
    first = scenes.picture(scene, tmp_path, "first")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    second = scenes.picture(bpy.context.scene, tmp_path, "second")
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE"])
def test_own_scenes_settings_are_written_where_they_differ_only(engine):
    """A write tells all open views; in a render's thread that has crashed Blender."""
    scene, *_ = _scene(shading="DISPLACED", surface="GLASS")
    scene.render.engine = engine
    scene.render.use_border = False
    scene.render.resolution_x = 90
    _update()
    door.prepare(scene, scenes.depsgraph())
    assert _counted(lambda: door.prepare(scene, scenes.depsgraph()))["settings"] == 0
    scene.render.resolution_x = 100
    assert _counted(lambda: door.prepare(scene, scenes.depsgraph()))["settings"] > 0
    assert {s.render.resolution_x for s in find_layers(scene).all()} == {100}


def test_glasses_of_another_scene_that_the_compositor_shows_are_told_of(tmp_path):
    behind, _, _ = _scene(samples=1)
    front = bpy.data.scenes.new("Front")
    front.camera = behind.camera
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    front.compositing_node_group = tree
    layers, end = (tree.nodes.new(n) for n in ("CompositorNodeRLayers", "NodeGroupOutput"))
    tree.links.new(layers.outputs["Image"], end.inputs[0])
    for shown, told in ((front, False), (behind, True)):
        layers.scene = shown
        bpy.context.window.scene = front
        scenes.settings(8, 6, samples=1)
        scenes.picture(front, tmp_path)
        assert any(f'"{behind.name}"' in p for p in door.status(front).problems) is told


def test_glasses_of_a_background_set_are_told_of_until_they_are_the_scenes_too():
    behind, _, glass = _scene(samples=1)
    front = bpy.data.scenes.new("Front")
    front.camera, front.background_set = behind.camera, behind
    bpy.context.window.scene = front
    scenes.settings(8, 6, samples=1, shading="TRUE")
    door.prepare(front, scenes.depsgraph())
    assert any(f'"{glass.name}"' in problem for problem in door.status(front).problems)
    front.collection.objects.link(glass)
    door.prepare(front, scenes.depsgraph())
    assert door.status(front).problems == []


def test_a_file_that_is_written_shows_all_glasses_as_meshes(tmp_path):
    """Glasses of two scenes, and those that only instances show, stayed hidden in the file."""
    scene, _, shared = _scene(shading="TRUE")
    instanced = scenes.glass(shape="SPHERE", radius=0.02, wall_thickness=0.0)
    collection = bpy.data.collections.new("Instanced")
    collection.objects.link(instanced)
    scene.collection.objects.unlink(instanced)
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(empty)
    other = bpy.data.scenes.new("Other")
    other.refractive_glass.shading, other.camera = "TRUE", scene.camera
    for obj in (shared, scene.camera):
        other.collection.objects.link(obj)
    for one in (scene, other):
        layer = one.view_layers[0]
        layer.update()
        door.prepare(one, layer.depsgraph, strict=True)

    def shown():
        return [read_input(glass_modifier(g), "Show in Render") for g in (shared, instanced)]

    assert shown() == [False, False]
    path = str(tmp_path / "file.blend")
    for one in (scene, other):
        door.set_aside(one)
    assert shown() == [True, True]
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    door.put_back()
    with bpy.data.libraries.load(path) as (saved, _):
        assert sorted(saved.scenes) == sorted((scene.name, other.name))
        assert not [name for name in saved.images if name.startswith(".")]


@pytest.mark.parametrize(
    "way", ["nodes deleted", "tree replaced", "tree unlinked", "scene deleted"]
)
def test_a_file_that_is_written_holds_nothing_of_a_tree_that_was_taken_out(tmp_path, way):
    """The pictures in it have a user, though the tree itself is not written."""
    scene, *_ = _scene(shading="TRUE")
    door.prepare(scene, scenes.depsgraph(), strict=True)
    if way == "nodes deleted":
        scene.compositing_node_group.nodes.clear()
        left = [t for t in bpy.data.node_groups if own(t, "composite")]
        assert [tree.users for tree in left] == [0]
    elif way == "scene deleted":
        bpy.context.window.scene = bpy.data.scenes.new("Other")
        bpy.data.scenes.remove(scene)
    elif way == "tree unlinked":
        scene.compositing_node_group = None
    else:
        tree = scene.compositing_node_group
        tree.name, tree.use_fake_user = "Mine", True
        del tree[TAG]
        scene.compositing_node_group = None
    if way != "scene deleted":
        door.set_aside(scene)
    door.set_aside_strays()
    path = str(tmp_path / "file.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    door.put_back()
    with bpy.data.libraries.load(path) as (saved, _):
        kept = (saved.images, saved.node_groups, saved.scenes, saved.objects, saved.cameras)
        assert not [n for names in kept for n in names if n.startswith(".")]
