# SPDX-License-Identifier: GPL-3.0-or-later
"""A random walk through what users do, with the extension at work and without.

The walk is taken twice with the same seed: once as a *control*, in which the extension never makes
anything, and once with it. After each step all that is the user's must be the same in both, what
is the extension's must be marked, hidden and where a glass is, and in the end nothing of it left.

Inside a real Blender: arguments are the output folder, the number of steps and the seeds.
"""

import hashlib
import json
import random
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

import bpy
import numpy as np

TAG = "refractive_glass"
GLASS = "Refractive Glass"
PICTURES = {"Render Result", "Viewer Node"}
"""Images that a render writes into: the walks' pictures differ."""
PROFILE = "Glass Profile"
"""Begins the names of the curves that everyday glasses are turned from."""
OF_A_GLASS = {"glass", "shadow"}
"""Roles of what belongs to a glass and goes where it goes."""
MOST_OBJECTS, MOST_GLASSES, MOST_SCENES, MOST_RENDERS = 8, 3, 3, 2

KINDS = (
    "actions",
    "cameras",
    "collections",
    "curves",
    "images",
    "libraries",
    "lights",
    "materials",
    "meshes",
    "node_groups",
    "objects",
    "scenes",
    "texts",
    "worlds",
)


def module(name):
    """A module of the extension, by whatever name it was loaded."""
    end = f"glass_refraction.{name}"
    return next(m for n, m in sys.modules.items() if n == end or n.endswith(f".{end}"))


def own(block):
    """Whether the extension made the block."""
    return block is not None and TAG in block


# ---------------------------------------------------------------------------- what is the user's


_SKIPPED = {
    # Of the session, or worked out from what is compared by itself.
    *(
        "rna_type",
        "session_uid",
        "users",
        "is_evaluated",
        "tag",
        "original",
        "preview",
        "name_full",
    ),
    *("is_missing", "is_library_indirect", "runtime", "depsgraph", "is_updated", "is_updated_data"),
    *("bl_system_properties", "use_nodes", "wireframe_color_type", "matrix_world", "matrix_local"),
    "node_warnings",
    "id_data",
    *(
        "internal_links",
        "render_stats",
        "hash",
        "update_timestamp",
        "session_uid",
        "is_runtime_data",
    ),
    # Heavy, and stands in other properties.
    *("polygon_layers_float", "corner_normals", "vertex_normals", "polygon_normals", "children"),
    *("all_objects", "children_recursive", "loop_triangles", "loop_triangle_polygons", "loops"),
    *("edges", "polygons", "vertices", "pixels", "bound_box", "dimensions", "skin_vertices"),
    *("attributes", "color_attributes", "vertex_colors", "keying_sets_all", "sequence_editor"),
    *("tool_settings", "transform_orientation_slots", "cursor", "objects", "view_layers"),
    *("layer_collection", "active_layer_collection", "collection_children", "filepath"),
}
_WORKED_OUT = {"enabled", "is_unavailable", "is_icon_visible"}
"""Of sockets: whether a view layer has the pass, as of the last time Blender looked."""
_names_of = {}


def _properties(struct):
    kind = type(struct)
    if kind not in _names_of:
        _names_of[kind] = [
            (p.identifier, p.type, getattr(p, "is_array", False))
            for p in kind.bl_rna.properties
            if p.identifier not in _SKIPPED
        ]
    return _names_of[kind]


def _named(block):
    if own(block):
        return f"<{block[TAG]}>"
    return f"{type(block).__name__} {block.name_full}"


def _dump(struct, lines, path="", depth=0, deepest=4):
    """Every plain value in a piece of Blender data, one line each."""
    for name, kind, is_array in _properties(struct):
        if name == "cycles" and isinstance(struct, bpy.types.View3DShading):
            # To ask for it where there are several scenes spoils Blender 5.0's memory.
            continue
        if name in _WORKED_OUT and isinstance(struct, bpy.types.NodeSocket):
            continue
        if name == "name" and isinstance(struct, bpy.types.MaterialSlot):
            # The name of its material, which has a line of its own. The number behind the name of
            # a glass's material is not the user's.
            continue
        here = f"{path}.{name}"
        try:
            value = getattr(struct, name)
        except (AttributeError, ReferenceError):
            continue
        if value is None:
            lines.append(f"{here} None")
        elif kind == "POINTER":
            if isinstance(value, bpy.types.ID) and not isinstance(value, bpy.types.NodeTree):
                lines.append(f"{here} {_named(value)}")
            elif isinstance(value, bpy.types.NodeTree):
                if value.is_embedded_data:
                    _dump_tree(value, lines, here, deepest)
                else:
                    # A tree of the extension's own stands where the user has none.
                    lines.append(f"{here} {None if own(value) else _named(value)}")
            elif depth < deepest and type(struct).__name__ != "NodesModifier":
                _dump(value, lines, here, depth + 1, deepest)
        elif kind == "COLLECTION":
            for number, item in enumerate(value):
                if item is None or isinstance(item, bpy.types.ID):
                    lines.append(f"{here} {item and _named(item)}")
                elif depth < deepest:
                    _dump(item, lines, f"{here}[{number}]", depth + 1, deepest)
        elif is_array:
            flat = [list(v) if hasattr(v, "__len__") else v for v in value]
            lines.append(f"{here} {flat}")
        elif not callable(value):
            lines.append(f"{here} {sorted(value) if isinstance(value, set) else value!r}")


def _dump_tree(tree, lines, path="", deepest=4):
    """Nodes and links as they are without the extension's."""
    whole = deepest > 1
    for node in tree.nodes:
        if own(node):
            continue
        lines.append(f"{path}.{node.name} {node.bl_idname} {node.mute} {list(node.location)}")
        if not whole:
            continue
        kept = []
        _dump(node, kept, f"{path}.{node.name}", depth=2)
        # Where the scene is gone Blender makes the outputs anew whenever it next looks.
        gone = node.bl_idname == "CompositorNodeRLayers" and node.scene is None
        left_out = (".is_linked", ".outputs[") if gone else (".is_linked",)
        lines += [line for line in kept if not any(part in line for part in left_out)]
        for socket in (*node.inputs, *([] if gone else node.outputs)):
            value = getattr(socket, "default_value", None)
            if isinstance(value, bpy.types.ID):
                value = _named(value)
            lines.append(f"{path}.{node.name}.{socket.identifier} {_plain(value)}")
    feeds = {}
    for link in tree.links:
        if own(link.to_node) and link.to_node[TAG] == "group" and link.to_socket.name == "Image":
            feeds[link.to_node.name] = (link.from_node.name, link.from_socket.identifier)
    links = []
    for link in tree.links:
        if own(link.to_node):
            continue
        start = (link.from_node.name, link.from_socket.identifier)
        if own(link.from_node):
            start = feeds[link.from_node.name]
        end = (link.to_node.name, link.to_socket.identifier)
        links.append(f"{path} {start} -> {end} {link.is_muted}")
    lines += sorted(links)
    active = tree.nodes.active
    lines.append(f"{path} active {active.name if active is not None else None}")


def _plain(value):
    return list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value


def _dump_block(block, whole):
    lines = []
    deepest = 4 if whole else 1 if isinstance(block, bpy.types.Object) else 0
    if isinstance(block, bpy.types.NodeTree):
        _dump_tree(block, lines, deepest=deepest)
        lines.append(f"fake {block.use_fake_user}")
        return lines
    _dump(block, lines, deepest=deepest)
    if isinstance(block, bpy.types.Collection):
        lines += sorted(f"object {_named(o)}" for o in block.objects)
    if isinstance(block, bpy.types.Mesh):
        places = np.empty(3 * len(block.vertices), np.float32)
        block.vertices.foreach_get("co", places)
        corners = np.empty(len(block.loops), np.int32)
        block.loops.foreach_get("vertex_index", corners)
        sizes = np.empty(len(block.polygons), np.int32)
        block.polygons.foreach_get("loop_total", sizes)
        lines += [hashlib.blake2b(part.tobytes()).hexdigest() for part in (places, corners, sizes)]
    if isinstance(block, bpy.types.Object):
        lines += [
            str([list(row) for row in block.matrix_basis]),
            str((block.hide_get(), block.select_get())),
        ]
        for modifier in block.modifiers:
            if modifier.type == "NODES" and own(modifier.node_group):
                lines += _dump_inputs(modifier)
    if isinstance(block, bpy.types.Scene):
        for layer in block.view_layers:
            _dump_layer_collection(layer.layer_collection, lines, layer.name)
            active = layer.objects.active
            lines.append(f"{layer.name} {layer.use} active {_named(active) if active else None}")
            lines += sorted(f"{layer.name} {_named(o)}" for o in layer.objects)
    return lines


def _dump_inputs(modifier):
    place = module("scene.read.modifier_inputs")
    lines = []
    for item in modifier.node_group.interface.items_tree:
        if item.item_type != "SOCKET" or item.in_out != "INPUT" or item.hide_in_modifier:
            continue
        if item.socket_type == "NodeSocketGeometry":
            continue
        value = place.read_input(modifier, item.name)
        value = _named(value) if isinstance(value, bpy.types.ID) else value
        lines.append(f"{modifier.name} {item.name} {value}")
    return lines


def _dump_layer_collection(layer_collection, lines, path):
    flags = ("exclude", "holdout", "indirect_only", "hide_viewport")
    path = f"{path}/{layer_collection.name}"
    lines.append(f"{path} {[getattr(layer_collection, flag) for flag in flags]}")
    for child in layer_collection.children:
        _dump_layer_collection(child, lines, path)


def users_data(whole, full=False):
    """Name of each block of the user -> digest of its values (or the lines themselves).

    ``whole`` goes into all settings and nodes, which takes its time.
    """
    bpy.context.view_layer.update()
    found, profiles = {}, [o for o in bpy.data.objects if o.name.startswith(PROFILE)]
    # Of a profile whose glass is gone Blender 5.2 counts users that there are none of, once more
    # with each save: whether it is purged is chance.
    users = bpy.data.user_map(subset=profiles) if profiles else {}
    for kind in KINDS:
        for block in getattr(bpy.data, kind):
            if own(block) or kind == "libraries" or block.name in PICTURES:
                continue
            if block in users and not users[block]:
                continue
            lines = _dump_block(block, whole)
            found[f"{kind} {block.name_full}"] = (
                lines if full else hashlib.blake2b("\n".join(lines).encode()).hexdigest()
            )
    window = bpy.context.window_manager.windows[0]
    found["window"] = f"{window.scene.name} {window.view_layer.name}"
    return found


# ------------------------------------------------------------------------ what is the extension's


def is_glass(obj):
    """Whether the object is a glass."""
    return obj.type == "MESH" and any(
        m.type == "NODES" and own(m.node_group) and m.node_group[TAG] == "glass"
        for m in obj.modifiers
    )


def own_blocks():
    """All that the extension made, by name."""
    return {
        f"{kind} {block.name_full}": block
        for kind in KINDS
        for block in getattr(bpy.data, kind)
        if own(block) and block.library is None
    }


def check_apart():
    """Nothing of the extension's is where the user looks, be it prepared or not."""
    users_scenes = [s for s in bpy.data.scenes if not own(s)]
    for scene in users_scenes:
        for layer in scene.view_layers:
            assert not any(own(o) for o in layer.objects), scene.name
        assert not any(own(c) for c in scene.collection.children_recursive), scene.name
        tree = scene.compositing_node_group
        selected = [n.name for n in tree.nodes if own(n) and n.select] if tree else []
        assert selected == [], f"{tree.name}: {selected} are selected"
    window = bpy.context.window_manager.windows[0]
    assert not own(window.scene), window.scene.name


def check_file(path):
    """A file holds nothing that only the extension could make sense of, but what is the glass."""
    # Blender lists no file that is open.
    with bpy.data.libraries.load(shutil.copy(path, f"{path}.copy.blend")) as (held, _):
        found = [f"{kind} {n}" for kind in KINDS for n in getattr(held, kind, ()) if n[0] == "."]
    # The shadow's material belongs to the glass.
    found = [name for name in found if not name.startswith("materials .Refractive Glass Shadow")]
    assert found == [], found


def check_own():
    """The extension's data is hidden, held by what needs it, and only where a glass is.

    Returns whether there is any beside the glasses.
    """
    blocks = own_blocks()
    for name, block in blocks.items():
        # The modifier's group and the glass's material are the user's to see.
        assert block.name.startswith(".") or block[TAG] in {"glass"}, name
        assert block.asset_data is None, name
        assert block.users > 0, f"orphan: {name}"
        assert not block.use_fake_user, name
    glasses = {s.name: [o for o in s.objects if is_glass(o)] for s in bpy.data.scenes if not own(s)}
    for name, block in blocks.items():
        if isinstance(block, bpy.types.Scene):
            owner = module("scene.build.own_scenes").user_scene_of(block)
            assert owner is not None and glasses[owner.name], f"{name}: no glass in its scene"
    if not any(is_glass(o) for o in bpy.data.objects):
        left = [n for n, b in blocks.items() if b[TAG] not in OF_A_GLASS]
        assert left == [], left
    return any(isinstance(block, bpy.types.Scene) for block in blocks.values())


# --------------------------------------------------------------------------------------- steps


class Walk:
    """One walk: its own random numbers, so that what the extension does cannot change them."""

    def __init__(self, seed, folder, at_work, did):
        self.random = random.Random(seed)
        self.folder = Path(folder)
        self.at_work, self.did = at_work, did
        self.renders = 0
        self.library, self.libraries = None, 0

    def rest(self):
        """As the timer does once changes have come to rest."""
        for scene in [s for s in bpy.data.scenes if self.at_work and not own(s)]:
            bpy.context.view_layer.update()
            module("handlers")._prepare(scene)

    def chosen(self, blocks):
        """One of the user's blocks, or None; the same in both walks."""
        blocks = sorted((b for b in blocks if not own(b)), key=lambda b: b.name_full)
        return self.random.choice(blocks) if blocks else None

    def object(self):
        return self.chosen(bpy.context.scene.objects)

    def activate(self, obj):
        """Make the object the one that operators work on; whether that can be."""
        layer = bpy.context.view_layer
        if obj is None or obj.name not in layer.objects or obj.hide_get():
            return False
        for other in layer.objects:
            other.select_set(False)
        obj.select_set(True)
        layer.objects.active = obj
        return True


def add_glass(walk):
    values = [
        {"shape": "CYLINDER", "radius": 1.0, "wall_thickness": 0.1, "height": 2.0},
        {"shape": "SLAB", "radius": 1.0, "wall_thickness": 0.1},
        {"shape": "SPHERE", "radius": 1.0, "wall_thickness": 0.1},
        {"shape": "ROD", "radius": 0.5, "height": 1.0, "ior": 1.4},
    ]
    chosen, place = walk.random.choice(values), [walk.random.uniform(-2, 2) for _ in range(3)]
    if sum(map(is_glass, bpy.data.objects)) < MOST_GLASSES:
        bpy.ops.object.refractive_glass_add(**chosen, location=place)


def add_everyday(walk):
    kinds = [p.identifier for p in module("ui.presets").PRESETS if len(p.parts) == 1]
    chosen, size = walk.random.choice(kinds), walk.random.choice([0.0, 2.0])
    if sum(map(is_glass, bpy.data.objects)) < MOST_GLASSES:
        bpy.ops.object.refractive_glass_everyday_add(kind=chosen, size=size)


def make_glass(walk):
    obj = walk.object()
    if sum(map(is_glass, bpy.data.objects)) < MOST_GLASSES and walk.activate(obj):
        try:
            bpy.ops.object.refractive_glass_modifier_add(shape="CYLINDER", radius=1.0)
        except RuntimeError as error:
            assert "Error" in str(error) or "poll" in str(error)


def add_object(walk):
    kind = walk.random.choice(["cube_add", "grid_add", "plane_add"])
    place = [walk.random.uniform(-3, 3) for _ in range(3)]
    if len(bpy.context.scene.objects) >= MOST_OBJECTS:
        return
    getattr(bpy.ops.mesh, f"primitive_{kind}")(location=place)


def add_other(walk):
    kind = walk.random.choice(["light", "empty", "curve", "camera"])
    if len(bpy.context.scene.objects) >= MOST_OBJECTS:
        return
    if kind == "light":
        bpy.ops.object.light_add(type="POINT")
    elif kind == "empty":
        bpy.ops.object.empty_add()
    elif kind == "curve":
        bpy.ops.curve.primitive_bezier_circle_add()
    else:
        bpy.ops.object.camera_add(location=(0, -8, 1), rotation=(1.5, 0, 0))
        bpy.context.scene.camera = bpy.context.object


def duplicate(walk):
    linked = walk.random.random() < 0.5
    if len(bpy.context.scene.objects) < MOST_OBJECTS and walk.activate(walk.object()):
        bpy.ops.object.duplicate(linked=linked)


def rename(walk):
    block = walk.chosen([*bpy.data.objects, *bpy.data.scenes, *bpy.data.collections])
    number = walk.random.randrange(1000)
    if block is not None and block.library is None:
        block.name = f"Name {number}"


def delete(walk):
    if walk.activate(walk.object()):
        bpy.ops.object.delete()


def delete_by_script(walk):
    obj = walk.object()
    if obj is not None:
        bpy.data.objects.remove(obj)


def delete_mesh(walk):
    mesh = walk.chosen(bpy.data.meshes)
    if mesh is not None and walk.random.random() < 0.3:
        bpy.data.meshes.remove(mesh)


def parent(walk):
    child, holder = walk.object(), walk.object()
    if child is None or holder is child or child in getattr(holder, "children_recursive", ()):
        return
    if holder.parent is None or child not in (holder.parent,):
        child.parent = None if walk.random.random() < 0.3 else holder


def hide(walk):
    obj, way = walk.object(), walk.random.randrange(4)
    if obj is None:
        return
    if way == 0 and obj.name in bpy.context.view_layer.objects:
        obj.hide_set(not obj.hide_get())
    elif way == 1:
        obj.hide_render = not obj.hide_render
    elif way == 2:
        obj.hide_viewport = not obj.hide_viewport
    else:
        obj.visible_camera = not obj.visible_camera


def move(walk):
    obj, way = walk.object(), walk.random.random()
    place = [walk.random.uniform(-3, 3) for _ in range(3)]
    if obj is not None and obj.library is None:
        obj.location = place
        # Scaled unevenly a glass cannot be computed, until it is scaled back.
        obj.scale = (1, 1, 2) if way < 0.1 else (1, 1, 1)


def material(walk):
    obj, way = walk.object(), walk.random.randrange(4)
    if obj is None or obj.type != "MESH" or obj.library is not None or obj.data.library is not None:
        return
    if way == 0:
        obj.data.materials.append(bpy.data.materials.new("Mine"))
    elif way == 1:
        block = walk.chosen(bpy.data.materials)
        if block is not None and block.library is None:
            # Reads the place: what is seen through a glass wears a substitute of it.
            block.node_tree.nodes.new("ShaderNodeTexNoise")
            nodes = block.node_tree.nodes
            end = next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)
            if end is not None:
                block.node_tree.links.new(nodes[-1].outputs[0], end.inputs["Base Color"])
    elif way == 2:
        block = walk.chosen(bpy.data.materials)
        if block is not None:
            block.use_fake_user = not block.use_fake_user
    else:
        obj.data.materials.clear()


def collection(walk):
    way, scene = walk.random.randrange(6), bpy.context.scene
    found = walk.chosen(scene.collection.children_recursive)
    obj = walk.object()
    if way == 0 and sum(not own(c) for c in bpy.data.collections) < 8:
        scene.collection.children.link(bpy.data.collections.new("Shelf"))
    elif found is None:
        return
    elif way == 1 and obj is not None and obj.name not in found.objects:
        found.objects.link(obj)
    elif way == 2 and obj is not None and obj.name in found.objects:
        if sum(not own(c) for c in obj.users_collection) > 1:
            found.objects.unlink(obj)
    elif way == 3:
        # As the outliner does it: what it held goes to the scene.
        for held in [o for o in found.objects if o.name not in scene.collection.objects]:
            scene.collection.objects.link(held)
            select_new(held, False)
        for inner in [c for c in found.children if c.name not in scene.collection.children]:
            scene.collection.children.link(inner)
        bpy.data.collections.remove(found)
    elif way == 4:
        found.hide_render = not found.hide_render
    else:
        glass = next((o for o in sorted(scene.objects, key=lambda o: o.name) if is_glass(o)), None)
        # One that holds a glass makes Blender's own evaluation go round in circles.
        if any(map(is_glass, found.all_objects)):
            return
        if glass is not None and glass.library is None:
            place = module("scene.read.modifier_inputs")
            modifier = next(m for m in glass.modifiers if m.type == "NODES")
            place.write_input(modifier, "Seen Through", found)


def layer_collection(walk):
    children = bpy.context.view_layer.layer_collection.children
    flag = walk.random.choice(["exclude", "holdout", "indirect_only", "hide_viewport"])
    if children:
        child = walk.random.choice(sorted(children, key=lambda c: c.name))
        setattr(child, flag, not getattr(child, flag))


def view_layer(walk):
    scene, way = bpy.context.scene, walk.random.randrange(4)
    layers = scene.view_layers
    if way == 0 and len(layers) < 3:
        layers.new(f"Layer {walk.random.randrange(99)}")
    elif way == 1 and len(layers) > 1:
        layers.remove(layers[-1])
    elif way == 2:
        layers[0].name = f"First {walk.random.randrange(99)}"
    else:
        layers[-1].use = not layers[-1].use


def new_scene(walk):
    kind = walk.random.choice(["NEW", "EMPTY", "LINK_COPY", "FULL_COPY"])
    if sum(not own(s) for s in bpy.data.scenes) < MOST_SCENES:
        bpy.ops.scene.new(type=kind)


def change_scene(walk):
    scene = walk.chosen(bpy.data.scenes)
    bpy.context.window_manager.windows[0].scene = scene


def delete_scene(walk):
    # The last one cannot be deleted where nothing else makes scenes.
    if sum(not own(s) for s in bpy.data.scenes) > 1:
        bpy.ops.scene.delete()
        module("handlers").leave_own_scenes()


def compositor(walk):
    scene, way = bpy.context.scene, walk.random.randrange(7)
    tree = scene.compositing_node_group
    tree = None if own(tree) else tree
    if way == 0 or tree is None:
        if way > 3:
            return
        tree = bpy.data.node_groups.new("My Compositing", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        layers = tree.nodes.new("CompositorNodeRLayers")
        blur = tree.nodes.new("CompositorNodeBlur")
        viewer = tree.nodes.new("CompositorNodeViewer")
        end = tree.nodes.new("NodeGroupOutput")
        tree.links.new(layers.outputs["Image"], blur.inputs["Image"])
        tree.links.new(layers.outputs["Image"], viewer.inputs["Image"])
        tree.links.new(blur.outputs["Image"], end.inputs["Image"])
        scene.compositing_node_group = tree
    elif way == 1:
        scene.compositing_node_group = None
    elif way == 2:
        bpy.data.node_groups.remove(tree)
    elif way == 3:
        node = tree.nodes.new("CompositorNodeInvert")
        end = next((n for n in tree.nodes if n.type == "GROUP_OUTPUT"), None)
        if end is not None and end.inputs[0].is_linked:
            tree.links.new(end.inputs[0].links[0].from_socket, node.inputs["Color"])
            tree.links.new(node.outputs[0], end.inputs[0])
    elif way == 4:
        node = walk.chosen_node(tree)
        if node is not None:
            node.mute = not node.mute
    elif way == 5:
        node = walk.chosen_node(tree)
        if node is not None and node.type in {"VIEWER", "BLUR"}:
            tree.nodes.remove(node)
    else:
        other = walk.chosen(s for s in bpy.data.scenes if s != scene)
        if other is not None:
            other.compositing_node_group = tree


def chosen_node(self, tree):
    """One of the user's nodes of the tree."""
    nodes = sorted((n for n in tree.nodes if not own(n)), key=lambda n: n.name)
    return self.random.choice(nodes) if nodes else None


Walk.chosen_node = chosen_node


def settings(walk):
    settings, way = bpy.context.scene.refractive_glass, walk.random.randrange(4)
    if way == 0:
        settings.enabled = not settings.enabled
    elif way == 1:
        settings.shading = "TRUE" if settings.shading == "DISPLACED" else "DISPLACED"
    elif way == 2:
        settings.quality = walk.random.choice(["DRAFT", "GOOD", "FINAL"])
    else:
        settings.min_weight = walk.random.choice([0.01, 0.02, 0.05])


def engine(walk):
    render = bpy.context.scene.render
    render.engine = walk.random.choice(["CYCLES", "BLENDER_WORKBENCH"])
    render.use_border = walk.random.random() < 0.3
    bpy.context.scene.frame_set(walk.random.randrange(1, 9))


def camera(walk):
    scene, way = bpy.context.scene, walk.random.randrange(4)
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    found = walk.chosen(cameras)
    if way == 0:
        scene.camera = None
    elif found is not None:
        scene.camera = found
        if found.library is None and found.data.library is None:
            found.data.type = "PANO" if way == 1 else "PERSP"


def mend(walk):
    """What a user does who wants to see something through a glass."""
    scene = bpy.context.scene
    objects = sorted((o for o in scene.objects if o.library is None), key=lambda o: o.name_full)
    cameras = [o for o in objects if o.type == "CAMERA" and o.data.library is None]
    if not cameras:
        bpy.ops.object.camera_add()
        cameras = [bpy.context.object]
    scene.camera, cameras[0].parent, cameras[0].data.type = cameras[0], None, "PERSP"
    cameras[0].location, cameras[0].rotation_euler = (0, -9, 1), (1.5, 0, 0)
    scene.refractive_glass.enabled = True
    glasses = [o for o in objects if is_glass(o)]
    if not glasses:
        bpy.ops.object.refractive_glass_add(shape="SPHERE", radius=1.0, wall_thickness=0.1)
        glasses = [bpy.context.object]
    for obj in glasses:
        obj.scale, obj.rotation_euler, obj.parent = (1, 1, 1), (0, 0, 0), None
        obj.hide_render = False
    if not any(o.type == "MESH" and not o.hide_render and not is_glass(o) for o in objects):
        bpy.ops.mesh.primitive_cube_add(location=(0, 3, 0))


def world(walk):
    scene = bpy.context.scene
    if walk.random.random() < 0.5:
        scene.world = None
        return
    scene.world = bpy.data.worlds.new("Sky")
    sky = scene.world.node_tree.nodes.new("ShaderNodeTexSky")
    ground = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    scene.world.node_tree.links.new(sky.outputs[0], ground.inputs[0])


def single_user(walk):
    if walk.activate(walk.object()):
        bpy.ops.object.make_single_user(type="SELECTED_OBJECTS", obdata=True)


def apply_modifier(walk):
    obj = walk.object()
    if obj is None or obj.library is not None or obj.data is None or obj.data.users > 1:
        return
    if is_glass(obj) and walk.random.random() < 0.3 and walk.activate(obj):
        bpy.ops.object.modifier_apply(modifier=obj.modifiers[0].name)


def remove_modifier(walk):
    obj = walk.object()
    if obj is not None and obj.library is None and is_glass(obj):
        obj.modifiers.remove(obj.modifiers[0])


def purge(walk):
    # What is deleted is freed with the next preparation: users are not as fast as that.
    walk.rest()
    bpy.ops.outliner.orphans_purge(do_recursive=True)


def undo(walk):
    try:
        walk.did["undo"] += bpy.ops.ed.undo() == {"FINISHED"}
    except RuntimeError as error:
        assert "poll" in str(error) or "undo" in str(error).lower(), error


def redo(walk):
    try:
        walk.did["redo"] += bpy.ops.ed.redo() == {"FINISHED"}
    except RuntimeError as error:
        assert "poll" in str(error) or "redo" in str(error).lower(), error


def save_and_open(walk):
    path = str(walk.folder / "walk.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    check_file(path)
    if walk.random.random() < 0.6:
        bpy.ops.wm.open_mainfile(filepath=path)


def keep_as_library(walk):
    """What a later step appends from or links to: the file as it is now."""
    walk.libraries += 1
    walk.library = str(walk.folder / f"library_{walk.libraries}.blend")
    bpy.ops.wm.save_as_mainfile(filepath=walk.library, copy=True)
    check_file(walk.library)


def select_new(obj, selected):
    """Select an object that is new in the view layer, or not.

    Blender takes that from the last evaluation that there was of it, and those differ between the
    walks. What has not been evaluated there cannot be selected.
    """
    bpy.context.view_layer.update()
    if obj.name in bpy.context.view_layer.objects:
        obj.select_set(selected)


def append(walk):
    link, whole = walk.random.random() < 0.4, walk.random.random() < 0.3
    # A linked scene cannot be changed, and most steps change the scene that they are in.
    link = link and not whole
    number = walk.random.randrange(1000)
    if walk.library is None or len(bpy.context.scene.objects) >= MOST_OBJECTS:
        return
    if whole and sum(not own(s) for s in bpy.data.scenes) >= MOST_SCENES:
        return
    with bpy.data.libraries.load(walk.library, link=link) as (available, wanted):
        # The user picks from what is not hidden.
        names = sorted(n for n in (available.scenes if whole else available.objects) if n[0] != ".")
        if names:
            setattr(wanted, "scenes" if whole else "objects", [names[number % len(names)]])
    there = bpy.context.scene.collection.objects
    for obj in wanted.objects:
        # What was linked before is the same object again.
        if obj not in there.values():
            there.link(obj)
            select_new(obj, True)


def make_local(walk):
    bpy.ops.object.make_local(type="ALL")
    # It deselects without a word to the evaluation, which selects again what it evaluates next.
    for obj in bpy.context.view_layer.objects:
        obj.select_set(False)


def off_and_on(walk):
    """Disable the extension and enable it again."""
    registration = module("registration")
    registration.unregister()
    if walk.at_work:
        # What was made is gone with the extension, not left behind in the file.
        scenes = [b for b in own_blocks().values() if isinstance(b, bpy.types.Scene)]
        assert scenes == [], [s.name for s in scenes]
    registration.register()


def render(walk):
    scene = bpy.context.scene
    walk.renders += 1
    if walk.renders > MOST_RENDERS or scene.camera is None or scene.camera.library is not None:
        return
    scene.render.engine = "BLENDER_WORKBENCH"
    bpy.ops.render.render(scene=scene.name)
    walk.did["render"] += 1


def update(walk):
    try:
        bpy.ops.scene.refractive_glass_update()
    except RuntimeError as error:
        assert len(str(error).strip().splitlines()) == 1, error


STEPS = (
    *(add_glass,) * 4,
    add_everyday,
    *(mend,) * 8,
    *(add_object,) * 3,
    *(move,) * 3,
    *(add_other, duplicate, rename, delete, undo, redo, camera, compositor) * 2,
    *(delete_by_script, delete_mesh, parent, hide, make_glass, material, collection),
    *(layer_collection, view_layer, new_scene, change_scene, delete_scene, settings, engine),
    *(world, single_user, apply_modifier, remove_modifier, purge, save_and_open),
    *(keep_as_library, append, make_local, off_and_on, update, render),
)
NAMING = {
    add_glass,
    add_everyday,
    mend,
    add_object,
    add_other,
    duplicate,
    rename,
    append,
    make_local,
}


# ---------------------------------------------------------------------------------------- walks


class Stand:
    """What stands for costly parts that touch no data, and in the control for all that does."""

    def __init__(self, at_work):
        door, displaced = module("scene.update"), module("scene.vertices.displaced")
        self.path = module("optics").LightPath
        self.stand_ins = {
            (displaced, "kept_paths"): self._paths,
            (displaced, "open_paths"): self._no_paths,
        }
        if not at_work:
            for name in ("prepare", "update", "remove", "withdraw"):
                self.stand_ins[door, name] = lambda *_, **__: None

    def __enter__(self):
        self.kept = {place: getattr(*place) for place in self.stand_ins}
        for place, function in self.stand_ins.items():
            setattr(*place, function)

    def __exit__(self, *_):
        for place, function in self.kept.items():
            setattr(*place, function)

    def _no_paths(self, *_):
        yield from ()
        return ()

    def _paths(self, _scene, glass, *_):
        """Two paths of the shape; of one that names its interfaces none, for these are slow."""
        if glass.description.names_interfaces:
            return (yield from self._no_paths())
        layers = len(getattr(glass.description, "radius", (0.0,)))
        return tuple(map(self.path, ("TT" if layers == 1 else "TTTT", "R")))


def start():
    """The scene in which every walk begins: what Blender opens with, rendered small."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 16, 12
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    bpy.ops.ed.undo_push(message="Start")


def take_walk(seed, steps, folder, fresh, *, at_work, until=None, full=False, did=None):
    """Take a walk; yields after each step its number, its name and the user's data.

    ``fresh`` opens the file that the walk begins with; ``did`` counts what was done.
    """
    fresh()
    did = Counter() if did is None else did
    walk = Walk(seed, folder, at_work, did)
    with Stand(at_work):
        start()
        for number in range(steps):
            step = walk.random.choice(STEPS)
            if step in NAMING:
                # What is deleted keeps its name up to the next preparation: users are not as fast.
                walk.rest()
            step(walk)
            if step not in (undo, redo):
                bpy.ops.ed.undo_push(message=step.__name__)
            # One in three comes too late.
            prepared = walk.random.random() < 0.7
            last = number == (steps - 1 if until is None else until)
            if at_work:
                check_apart()
            if at_work and prepared:
                walk.rest()
                did["stood"] += check_own()
            if prepared or last:
                yield number, step.__name__, users_data(last or number % 10 == 0, full and last)
            if number == until:
                return
        # In the end every glass goes, and with them all that was made.
        for obj in [o for o in bpy.data.objects if is_glass(o)]:
            bpy.data.objects.remove(obj)
        if at_work:
            walk.rest()
            left = own_blocks()
            users = bpy.data.user_map(subset=left.values())
            # What a user made of a glass by applying its modifier wears the glass's material.
            left = [n for n, b in left.items() if not users[b] or any(map(own, users[b]))]
            assert left == [], left


def compare(seed, steps, folder, fresh):
    """Take the walk twice; returns how often what was done: ``compared``, ``undo``, ``stood``, ...

    Raises AssertionError with the step and what differs.
    """
    control = list(take_walk(seed, steps, folder, fresh, at_work=False))
    did = Counter()
    number, name = -1, "start"
    walk = take_walk(seed, steps, folder, fresh, at_work=True, did=did)
    try:
        for expected in control:
            number, name, found = next(walk)
            assert (number, name) == expected[:2]
            if found != expected[2]:
                names = {n for n in {*found, *expected[2]} if found.get(n) != expected[2].get(n)}
                raise AssertionError(explain(seed, number, folder, fresh, names))
            did["compared"] += 1
        assert next(walk, None) is None
    except Exception as error:
        raise AssertionError(f"seed {seed}, after step {number} ({name}): {error}") from error
    return did


def explain(seed, until, folder, fresh, names):
    """What differs in these blocks after a step: the lines of both walks."""
    dumps = []
    for at_work in (False, True):
        *_, (_, _, found) = take_walk(
            seed, until + 1, folder, fresh, at_work=at_work, until=until, full=True
        )
        dumps.append(found)
    lines = []
    for name in sorted(names):
        without, with_it = (dump.get(name) for dump in dumps)
        if without is None or with_it is None or isinstance(without, str):
            # A block that is there in one of the walks only, or the window.
            told = (x if x is None or isinstance(x, str) else "there" for x in (without, with_it))
            lines.append(f"{name}: without it {next(told)}, with it {next(told)}")
            continue
        lines += [f"{name}: without it {x}" for x in without if x not in with_it][:8]
        lines += [f"{name}: with it {x}" for x in with_it if x not in without][:8]
    return "\n".join(lines)


def main():
    """Inside Blender: walk, and write what was found."""
    folder, steps, *seeds = sys.argv[sys.argv.index("--") + 1 :]
    result = {"did": {}, "failures": []}

    def fresh():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=False, load_ui=False)

    for seed in map(int, seeds):
        with tempfile.TemporaryDirectory() as place:
            try:
                result["did"][seed] = compare(seed, int(steps), place, fresh)
            except AssertionError as error:
                traceback.print_exception(error.__cause__ or error, file=sys.stdout)
                result["failures"].append(str(error))
    (Path(folder) / "result.json").write_text(json.dumps(result))


if __name__ == "__main__":
    main()
