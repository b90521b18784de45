# SPDX-License-Identifier: GPL-3.0-or-later
"""Own data stays apart from the user's: in trees, scenes, lists, files, undo steps; and goes."""

import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

import glass_refraction
from glass_refraction import handlers
from glass_refraction.scene import update as door
from glass_refraction.scene.build import own_scenes
from glass_refraction.scene.build.compositor import group_node, has_group, remove_stray_nodes
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.build.own_scenes import user_scene_of
from glass_refraction.scene.names import NODE_GROUPS, TAG, RefractiveGlassError, own
from glass_refraction.scene.read.glasses import instanced_glasses, merged_glasses
from glass_refraction.scene.read.modifier_inputs import glass_modifier, read_input, write_input

sys.path.insert(0, str(Path(__file__).parent.parent / "scene"))
import scenes


@pytest.fixture
def scene():
    scenes.camera()
    scenes.striped_wall(stripes=4)
    scenes.glass(shape="SPHERE", radius=0.05, wall_thickness=0.0)
    return scenes.settings(32, 24, samples=1, surface="REFRACTION", shading="DISPLACED")


def _prepare(scene):
    bpy.context.view_layer.update()
    handlers._prepare(scene)


def _own_blocks(*kinds):
    kinds = kinds or ("scenes", "collections", "objects", "meshes", "images", "node_groups")
    return [b.name for kind in kinds for b in getattr(bpy.data, kind) if own(b) and not _glass(b)]


def _glass(block):
    return block[TAG] == "glass"


def _shown(glass):
    return read_input(glass_modifier(glass), "Show in Render")


def _users_tree(scene, name="Mine"):
    tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    blur = tree.nodes.new("CompositorNodeBlur")
    end = tree.nodes.new("NodeGroupOutput")
    tree.links.new(layers.outputs["Image"], blur.inputs["Image"])
    tree.links.new(blur.outputs["Image"], end.inputs["Image"])
    scene.compositing_node_group = tree
    return tree


def _links(tree):
    return sorted(
        (x.from_node.name, x.from_socket.name, x.to_node.name, x.to_socket.name) for x in tree.links
    )


# ------------------------------------------------------------------------------------- materials


@pytest.mark.parametrize("way", ["deleted", "modifier removed", "worn by a mesh of the user's"])
def test_a_glass_leaves_no_material_however_often_its_file_was_saved(way, tmp_path):
    """Blender 5.2 counts users of what a modifier's inputs name once more with each save."""
    bpy.ops.object.refractive_glass_add(shape="SPHERE", radius=0.1, wall_thickness=0.0)
    glass, scene = bpy.context.object, bpy.context.scene
    material = read_input(glass_modifier(glass), "Material")
    for _ in range(3):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"), copy=True)
    _prepare(scene)
    assert material.name in bpy.data.materials
    if way == "deleted":
        bpy.data.objects.remove(glass)
    elif way == "modifier removed":
        glass.modifiers.remove(glass_modifier(glass))
    else:
        bpy.ops.mesh.primitive_cube_add()
        bpy.context.object.data.materials.append(material)
        bpy.data.objects.remove(glass)
    _prepare(scene)
    left = [m.name for m in bpy.data.materials if own(m)]
    assert left == ([material.name] if "worn" in way else [])


def test_a_scene_that_nobody_looks_at_holds_no_material_that_was_removed(scene):
    _prepare(scene)
    wall = scene.objects["Wall"]
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    bpy.data.materials.remove(wall.data.materials[0])
    handlers._prepare(scene)
    copies = [obj for obj in bpy.data.objects if own(obj, "copy")]
    worn = {slot.material for copy in copies for slot in copy.material_slots}
    assert len(worn) > 1
    assert worn <= {None, *bpy.data.materials}


@pytest.mark.parametrize(("shading", "surface"), [("TRUE", "GLASS"), ("DISPLACED", "REFRACTION")])
def test_what_a_script_that_clears_the_file_took_along_is_made_again(
    scene, shading, surface, tmp_path
):
    scene.refractive_glass.shading, scene.refractive_glass.surface = shading, surface
    glass = next(obj for obj in scene.objects if glass_modifier(obj) is not None)

    def picture(place):
        glass.location.x = place
        return scenes.picture(scene, tmp_path)

    places = (0.0, 0.02, 0.04)
    expected = [picture(place) for place in places]
    _prepare(scene)
    cleared = (("meshes", "cameras"), ("images",), ("scenes", "node_groups"))
    for kinds, place, right in zip(cleared, places, expected, strict=True):
        for blocks in (getattr(bpy.data, kind) for kind in kinds):
            for block in [b for b in blocks if own(b) and not _glass(b)]:
                # One may take others along.
                if block in blocks.values():
                    blocks.remove(block)
        assert np.array_equal(picture(place), right), kinds
        assert door.status(scene).problems == []


# ------------------------------------------------------------------------------- compositor trees


def test_nodes_in_the_users_tree_are_not_in_the_way(scene):
    tree = _users_tree(scene)
    tree.nodes.active = tree.nodes["Blur"]
    before = _links(tree)
    _prepare(scene)
    made = [n for n in tree.nodes if TAG in n]
    assert made
    assert not any(n.select for n in made)
    assert all(n.name.startswith(".") for n in made)
    assert tree.nodes.active.name == "Blur"
    # The names that the user's next nodes would get are free.
    assert tree.nodes.new("CompositorNodeRLayers").name == "Render Layers.001"
    tree.nodes.remove(tree.nodes["Render Layers.001"])
    door.remove(scene)
    assert _links(tree) == before


def test_a_tree_without_the_scenes_layers_is_told_and_left_alone(scene):
    tree = _users_tree(scene, "No Layers")
    tree.nodes.remove(tree.nodes["Render Layers"])
    before = _links(tree)
    with pytest.raises(RefractiveGlassError, match=r"Scene.*Render Layers.*add one"):
        door.prepare(scene, scenes.depsgraph())
    assert _links(tree) == before
    assert _own_blocks() == []


def test_scenes_that_share_a_tree_keep_their_own_nodes(scene):
    tree = _users_tree(scene)
    other = bpy.data.scenes.new("Other")
    other.compositing_node_group = tree
    _prepare(scene)
    before = _links(tree)
    door.prepare(other, other.view_layers[0].depsgraph or scenes.depsgraph())
    door.remove(other)
    assert _links(tree) == before
    assert has_group(scene)
    assert not has_group(other)


@pytest.mark.parametrize("shading", ["TRUE", "DISPLACED"])
@pytest.mark.parametrize("kind", ["LINK_COPY", "FULL_COPY"])
def test_a_copied_scene_gets_nodes_of_its_own(scene, kind, shading):
    scene.refractive_glass.shading = shading
    _prepare(scene)
    scene.name = "Renamed"
    bpy.ops.scene.new(type=kind)
    copied = bpy.context.scene
    assert copied != scene
    _prepare(copied)
    assert door.status(copied).problems == []
    tree = copied.compositing_node_group
    assert tree != scene.compositing_node_group
    asked = {n.scene for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers"}
    assert {user_scene_of(s) for s in asked - {copied}} == {copied}
    assert group_node(copied).node_tree != group_node(scene).node_tree
    door.remove(copied)
    assert own_scenes.find_own_scenes(scene)
    assert has_group(scene)


def test_a_tree_that_the_user_built_on_stays(scene):
    _prepare(scene)
    tree = scene.compositing_node_group
    tree.nodes.new("CompositorNodeBlur")
    door.remove(scene)
    assert scene.compositing_node_group == tree
    assert not own(tree)
    assert not tree.name.startswith(".")
    assert {n.bl_idname for n in tree.nodes} == {
        "CompositorNodeRLayers",
        "CompositorNodeBlur",
        "NodeGroupOutput",
    }


def test_a_tree_that_was_replaced_is_left_without_nodes(scene):
    tree = _users_tree(scene)
    before = _links(tree)
    _prepare(scene)
    _users_tree(scene, "Another")
    _prepare(scene)
    assert not any(TAG in n for n in tree.nodes)
    assert _links(tree) == before
    assert has_group(scene)


def test_an_own_tree_that_was_unlinked_is_left_without_nodes(scene):
    """It is not written to a file, but what stands in it would be."""
    _prepare(scene)
    tree = scene.compositing_node_group
    assert own(tree)
    scene.compositing_node_group = None
    remove_stray_nodes()
    assert own(tree)
    assert not any(TAG in n for n in tree.nodes)
    scene.compositing_node_group = tree
    _prepare(scene)
    tree = scene.compositing_node_group
    tree.nodes.new("CompositorNodeBlur")
    scene.compositing_node_group = None
    remove_stray_nodes()
    assert not own(tree)
    assert not tree.name.startswith(".")
    assert not any(TAG in n for n in tree.nodes)


def test_nodes_count_no_scene_as_used_that_they_do_not_use(scene):
    _users_tree(scene)
    _prepare(scene)
    door.remove(scene)
    counted = scene.users
    # Blender counts anew whenever it has loaded something.
    with bpy.data.libraries.load(str(NODE_GROUPS)):
        pass
    assert scene.users == counted


# ------------------------------------------------------------------------------------------ scenes


def test_a_renamed_scene_keeps_what_was_made_for_it(scene):
    _prepare(scene)
    before = find_layers(scene)
    scene.name = "Another Name"
    _prepare(scene)
    assert find_layers(scene) == before
    assert has_group(scene)
    assert door.counters["structures"]


def test_a_deleted_scene_takes_along_what_was_made_for_it(scene):
    other = bpy.data.scenes.new("Other")
    _prepare(scene)
    assert _own_blocks("scenes")
    bpy.data.scenes.remove(scene)
    _prepare(other)
    door.prepare(other, scenes.depsgraph())
    assert _own_blocks() == []


def test_a_window_left_on_an_own_scene_shows_the_users_again(scene):
    _prepare(scene)
    window = bpy.context.window_manager.windows[0]
    window.scene = find_layers(scene).mask
    handlers.leave_own_scenes()
    assert window.scene == scene


def test_a_window_left_on_an_own_scene_keeps_its_view_layer(scene):
    """As when Blender goes from one scene of the user's to another."""
    window = bpy.context.window_manager.windows[0]
    window.view_layer = scene.view_layers.new("Another")
    _prepare(scene)
    window.scene = find_layers(scene).mask
    handlers.leave_own_scenes()
    assert (window.scene, window.view_layer.name) == (scene, "Another")


def test_an_own_scene_of_another_session_belongs_by_its_name(scene):
    _prepare(scene)
    other = bpy.data.scenes.new("Other")
    mask = find_layers(scene).mask
    # In the next session another scene may have the number.
    mask[own_scenes._OWNER] = f"another session {other.session_uid}"
    assert user_scene_of(mask) == scene


def test_a_linked_scene_is_refused(scene, tmp_path):
    library = tmp_path / "library.blend"
    scene.name = "Borrowed"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.scenes = ["Borrowed"]
    with pytest.raises(RefractiveGlassError, match=r"Borrowed.*make it local"):
        door.prepare(wanted.scenes[0], scenes.depsgraph())
    door.remove(wanted.scenes[0])
    assert _own_blocks() == []


# ----------------------------------------------------------------------------------------- objects


def test_a_glass_that_is_not_computed_is_shown_as_it_is(scene):
    good = bpy.context.object
    bad = scenes.glass(shape="SPHERE", radius=0.02, wall_thickness=0.0, location=(0.1, 0, 0))
    bad.scale = (1, 1, 2)
    _prepare(scene)
    assert (_shown(good), _shown(bad)) == (False, True)
    scene.camera = None
    _prepare(scene)
    assert (_shown(good), _shown(bad)) == (True, True)


def test_a_glass_in_two_scenes_stays_hidden_while_one_computes_it(scene):
    glass = bpy.context.object
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(glass)
    _prepare(scene)
    door.remove(other)
    assert not _shown(glass)
    door.remove(scene)
    assert _shown(glass)


def test_a_deleted_object_does_not_live_on_in_hiding(scene):
    cube = bpy.data.objects.new("Cube", bpy.data.objects["Wall"].data.copy())
    scene.collection.objects.link(cube)
    _prepare(scene)
    cube.select_set(True)
    bpy.context.view_layer.objects.active = cube
    with bpy.context.temp_override(selected_objects=[cube], active_object=cube):
        bpy.ops.object.delete()
    _prepare(scene)
    assert "Cube" not in bpy.data.objects


def test_own_node_groups_are_in_no_menu(scene):
    _prepare(scene)
    groups = _own_blocks("node_groups")
    assert len(groups) >= 3
    assert all(name.startswith(".") for name in groups)


def test_what_is_hidden_in_viewports_can_be_seen_through_a_glass(scene):
    """Blender evaluates no geometry for it then, and says so by an error."""
    wall = bpy.data.objects["Wall"]
    wall.hide_viewport = True
    _prepare(scene)
    assert door.status(scene).problems == []
    assert find_layers(scene).copies()


def test_a_copy_may_have_more_slots_than_its_mesh(scene):
    wall = bpy.data.objects["Wall"]
    _prepare(scene)
    while len(wall.data.materials) > 1:
        wall.data.materials.pop()
    wall.data.materials[0] = scenes.emissive("Other", (1, 1, 1))
    _prepare(scene)
    for copy in find_layers(scene).copies().values():
        worn = [slot.material for slot in copy.material_slots]
        assert worn[0] == wall.data.materials[0]
        assert not any(worn[1:])


def test_a_glass_beside_the_picture_is_no_error(scene):
    bpy.context.object.location = (50, 0, 0)
    _prepare(scene)
    door.update(scene, scenes.depsgraph())
    assert door.status(scene).problems == []


# ----------------------------------------------------------------------------------- undo and files


def test_undo_and_redo_find_only_what_they_know(scene):
    """Undo crashed where a preparation had made the user's tree point to something newer."""
    tree = _users_tree(scene)
    before = _links(tree)
    bpy.ops.ed.undo_push(message="Tree")
    wall = bpy.data.objects["Wall"]
    for step in range(3):
        _prepare(scene)
        wall.location.x += 0.01
        bpy.ops.ed.undo_push(message=f"Move {step}")
        scene.refractive_glass.min_weight = 0.01 + 0.01 * step
    for _ in range(3):
        assert bpy.ops.ed.undo() == {"FINISHED"}
    _prepare(bpy.context.scene)
    assert bpy.ops.ed.redo() == {"FINISHED"}
    scene = bpy.context.scene
    assert bpy.data.objects["Wall"].location.x == pytest.approx(0.01)
    _prepare(scene)
    assert has_group(scene)
    door.remove(scene)
    assert _links(scene.compositing_node_group) == before
    assert _own_blocks() == []


def test_a_file_holds_nothing_that_can_be_made_again(scene, tmp_path):
    glass, users = bpy.context.object, scene.users
    _prepare(scene)
    made = sorted(_own_blocks("scenes"))
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    # Here all is as it was. Blender shows the number of users beside the scene's name.
    assert scene.users == users
    assert sorted(_own_blocks("scenes")) == made
    assert not _shown(glass)
    # Blender lists no file that is open.
    with bpy.data.libraries.load(str(shutil.copy(path, tmp_path / "copy.blend"))) as (held, _):
        for kind in ("scenes", "collections", "objects", "meshes", "images", "node_groups"):
            assert [n for n in getattr(held, kind) if n.startswith(".")] == []
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    assert _shown(bpy.data.objects["Refractive Glass"])
    _prepare(scene)
    assert find_layers(scene) is not None


_WITHOUT = """
import sys
import bpy
import numpy as np
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene = bpy.context.scene
assert not hasattr(bpy.types.Scene, "refractive_glass")
glass = bpy.data.objects["Refractive Glass"]
depsgraph = bpy.context.evaluated_depsgraph_get()
assert len(glass.evaluated_get(depsgraph).data.polygons) > 6
bpy.data.objects["Wall"].location.x = 0.25
bpy.data.objects["Wall"].name = "Renamed"
for name, hidden in (("shown", False), ("hidden", True)):
    glass.hide_render = hidden
    scene.render.filepath = f"{sys.argv[2]}/{name}.png"
    bpy.ops.render.render(write_still=True)
glass.hide_render = False
bpy.ops.wm.save_mainfile()
"""


def test_a_blender_without_the_extension_opens_renders_and_saves(scene, tmp_path):
    scene.render.image_settings.file_format = "PNG"
    _prepare(scene)
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT, str(path), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    # The glass's own mesh is there, not a hole.
    shown, hidden = (scenes.load(tmp_path / f"{name}.png") for name in ("shown", "hidden"))
    assert abs(shown - hidden).max() > 0.2
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    _prepare(scene)
    assert door.status(scene).problems == []
    sources = {own_scenes.source_of(c).name for c in find_layers(scene).copies().values()}
    assert sources == {"Renamed"}


def test_disabled_it_leaves_nothing_and_enabled_it_starts_again(scene):
    glass = bpy.context.object
    _prepare(scene)
    glass_refraction.unregister()
    try:
        assert _own_blocks() == []
        assert _shown(glass)
        assert scene.compositing_node_group is None
    finally:
        glass_refraction.register()
    _prepare(scene)
    assert find_layers(scene) is not None


@pytest.mark.parametrize("event", ["render_init", "frame_change_pre", "render_pre", "render_post"])
def test_disabled_in_a_renders_handler_it_leaves_nothing_when_that_has_ended(scene, event):
    """Blender 5.2 crashed: own scenes went that the render was reading."""
    scene.refractive_glass.shading = "TRUE"
    left = []

    def disable(*_):
        if not left:
            left.append(_own_blocks("scenes"))
            glass_refraction.unregister()
            left.append(_own_blocks("scenes"))

    handlers_of_event = getattr(bpy.app.handlers, event)
    handlers_of_event.append(disable)
    try:
        bpy.ops.render.render()
    finally:
        handlers_of_event.remove(disable)
    assert left[0] == left[1] != []
    assert _own_blocks() == []
    glass_refraction.register()
    scene.refractive_glass.shading = "TRUE"
    _prepare(scene)
    assert _own_blocks("scenes") != []


def test_appended_and_linked_glasses_bring_no_own_data(scene, tmp_path):
    library = tmp_path / "library.blend"
    _prepare(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    for link in (False, True):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        with bpy.data.libraries.load(str(library), link=link) as (_, wanted):
            wanted.objects = ["Refractive Glass"]
        (glass,) = wanted.objects
        assert _own_blocks() == []
        assert _shown(glass)
        # In a scene with a camera and a wall the appended one works, the linked one is refused.
        here = bpy.context.scene
        here.collection.objects.link(glass)
        scenes.camera()
        scenes.striped_wall(stripes=4)
        here.refractive_glass.shading = "DISPLACED"
        _prepare(here)
        problems = door.status(here).problems
        assert (find_layers(here) is None) == link
        assert ("make it local" in " ".join(problems)) == link


def test_a_scene_that_undo_brought_back_unseen_holds_nothing(scene):
    """What stood for it would keep alive what is deleted, and nothing would look after it."""
    _prepare(scene)
    name = scene.name
    bpy.context.window_manager.windows[0].scene = bpy.data.scenes.new("Other")
    bpy.ops.ed.undo_push(message="Other")
    bpy.data.scenes.remove(scene)
    bpy.ops.ed.undo_push(message="Removed")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    scene = bpy.data.scenes[name]
    assert bpy.context.scene != scene
    assert scene.view_layers[0].depsgraph is None
    assert _own_blocks("scenes")
    _prepare(scene)
    assert _own_blocks() == []


def test_the_denoiser_is_copied_without_being_read(scene):
    """A Blender that lacks the stored denoiser warns of each reading, several times a frame."""

    class Unread:
        """The scene's Cycles settings; the denoiser can not be read."""

        def __init__(self, group):
            self.group = group

        def __getattr__(self, name):
            assert name != "denoiser"
            return getattr(self.group, name)

    stored, other = 7, bpy.data.scenes.new("Other")
    scene.cycles.bl_system_properties_get(do_create=True)["denoiser"] = stored
    own_scenes._copy_properties(Unread(scene.cycles), Unread(other.cycles), {})
    assert other.cycles.bl_system_properties_get()["denoiser"] == stored
    del scene.cycles.bl_system_properties_get()["denoiser"]
    own_scenes._copy_properties(Unread(scene.cycles), Unread(other.cycles), {})
    assert other.cycles.bl_system_properties_get().get("denoiser") is None


def test_instances_are_not_listed_where_nodes_take_no_glass(scene):
    """Of a scene that nobody has evaluated since objects were deleted, listing them crashed."""

    class Stale:
        @property
        def object_instances(self):
            raise AssertionError("listed")

    assert merged_glasses(scene, Stale()) == []


def test_instanced_glasses_are_found_without_the_dependency_graph(scene):
    """By collections in one another, particles, and what nodes or their modifier name."""
    glasses = []
    for name in ("In Empty", "In Particles", "In Node", "In Modifier", "In None"):
        scenes.glass(shape="CYLINDER")
        obj = bpy.context.object
        obj.name = name
        scene.collection.objects.unlink(obj)
        obj.use_fake_user = True
        glasses.append(obj)
    inner, outer = (bpy.data.collections.new(name) for name in ("Inner", "Outer"))
    inner.objects.link(glasses[0])
    empty, further = (bpy.data.objects.new(name, None) for name in ("Empty", "Further"))
    further.instance_collection = inner
    outer.objects.link(further)
    empty.instance_collection = outer
    scene.collection.objects.link(empty)
    host = bpy.data.objects.new("Host", bpy.data.meshes.new("Host"))
    scene.collection.objects.link(host)
    host.modifiers.new("Particles", "PARTICLE_SYSTEM")
    host.particle_systems[0].settings.instance_object = glasses[1]
    tree = bpy.data.node_groups.new("Tree", "GeometryNodeTree")
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = glasses[2]
    tree.interface.new_socket("Shown", socket_type="NodeSocketObject")
    modifier = host.modifiers.new("Nodes", "NODES")
    modifier.node_group = tree
    write_input(modifier, "Shown", glasses[3])
    assert set(instanced_glasses(scene.view_layers[0])) == set(glasses[:4])
