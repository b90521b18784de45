# SPDX-License-Identifier: GPL-3.0-or-later
"""The composited picture: one node group behind the user's Render Layers node.

Inside each glass's visible outline the picture is the sum over light paths of weight times layer.
In TRUE shading a path's layer is the direct picture, looked up where the copy's true place
projects; where the direct picture does not show that place, the copy as shaded where it is drawn.
"""

from __future__ import annotations

from itertools import groupby

import bpy
import numpy as np

from ... import optics
from ..bake.files import BAKE
from ..names import TAG, hidden_name, own
from ..ray_screen import RayScreen
from ..read.arrays import write_image
from ..read.glasses import Glass
from ..read.viewpoint import Viewpoint
from ..vertices.regions import Regions, tints
from .layers import DEPTH_LAYER, Layers, Pane

DEPTH_TOLERANCE = 0.004
"""Relative difference of depth above which a place counts as hidden in the direct picture."""

_VALUES = "refractive_glass_values"
_SCENE = "refractive_glass_scene"


def insert_group(
    scene: bpy.types.Scene,
    layers: Layers,
    panes: list[Pane],
    true_shading: bool,
    subdivision: int,
    around: str,
) -> None:
    """Put the extension's node group behind the scene's Render Layers node.

    The user's tree keeps every node and link; only what the Render Layers node's Image fed is now
    fed through the group. Where there is no tree, one is made, and removed with the group.
    """
    group = _Group(scene, layers, panes, true_shading, subdivision, around).tree
    node = group_node(scene)
    if node is not None and _is_copied(node, scene):
        remove_group(scene)
        node = None
    if node is None:
        node = _new_group_node(scene, group)
    else:
        # In place, and the former group stays for now: Blender 5.2 crashes where a render that has
        # begun finds a tree or a node freed.
        node.node_tree = group
        node[_SCENE] = scene.name
    _ask(node, scene, layers)


def _new_group_node(scene: bpy.types.Scene, group: bpy.types.NodeTree) -> bpy.types.Node:
    """A node of the group behind the Render Layers node."""
    tree = _users_tree(scene) or _plain_tree(scene)
    render_layers = _render_layers(scene, tree)
    node = _own_node(tree, scene, "CompositorNodeGroup", "group")
    node.node_tree = group
    node.label = "Refractive Glass"
    node.location = (render_layers.location.x + 280, render_layers.location.y)
    image = render_layers.outputs["Image"]
    fed = [link.to_socket for link in image.links]
    tree.links.new(image, node.inputs["Image"])
    tree.links.new(render_layers.outputs["Alpha"], node.inputs["Alpha"])
    for socket in fed:
        tree.links.new(node.outputs["Image"], socket)
    return node


def _ask(node: bpy.types.Node, scene: bpy.types.Scene, layers: Layers) -> None:
    """Have the own scenes rendered: Blender 5.0 does only if the tree itself asks, not a group."""
    tree, scenes = node.id_data, layers.rendered()
    asking = [n for n in nodes_of(scene) if n[TAG] == "asking"]
    for number in range(len(asking), len(scenes)):
        with _as_if_in(scenes[number]):
            made = _own_node(tree, scene, "CompositorNodeRLayers", "asking")
        made.hide = True
        made.location = (node.location.x, node.location.y - 220 - 50 * number)
        asking.append(made)
    for number, asks in enumerate(asking):
        # One too many asks once more.
        asks.scene = scenes[min(number, len(scenes) - 1)]
        asks.label = f"Refractive Glass: {asks.scene[TAG]}"
        asks[_SCENE] = scene.name


def _own_node(
    tree: bpy.types.NodeTree, scene: bpy.types.Scene, idname: str, role: str
) -> bpy.types.Node:
    """A node of the extension's in the user's tree: not selected, and no name taken."""
    active = tree.nodes.active
    node = tree.nodes.new(idname)
    node[TAG], node[_SCENE] = role, scene.name
    node.name = hidden_name(role)
    node.select = False
    tree.nodes.active = active
    return node


def _as_if_in(own_scene: bpy.types.Scene):
    """A context in which a new Render Layers node takes the own scene.

    Blender counts the scene that it is made in as used once more than it is, for ever.
    """
    return bpy.context.temp_override(scene=own_scene)


def can_insert(scene: bpy.types.Scene) -> bool:
    """Whether the scene's tree has a place for the group: a Render Layers node of the scene."""
    tree = _users_tree(scene)
    return tree is None or _render_layers(scene, tree) is not None


def remove_group(scene: bpy.types.Scene) -> None:
    """Take the extension's nodes out of the scene's tree and join again what they stood between.

    A tree that the extension made goes too, unless the user has built on it. It and the group are
    freed by :func:`layers.remove_leftovers`.
    """
    tree = scene.compositing_node_group
    if tree is None:
        return
    _take_out(nodes_of(scene))
    if own(tree, "compositor"):
        if _is_plain(tree):
            scene.compositing_node_group = None
        else:
            del tree[TAG]
            tree.name = "Compositing"


def remove_stray_nodes() -> None:
    """Take the extension's nodes out of trees that no scene shows any more.

    The user may have replaced a tree while they stood in it. Those of a bake stay: nothing could
    make them again.
    """
    shown = {scene.compositing_node_group for scene in bpy.data.scenes}
    for tree in bpy.data.node_groups:
        if tree.bl_idname == "CompositorNodeTree" and not (tree in shown or own(tree)):
            nodes = [n for n in tree.nodes if n.get(TAG)]
            groups = [n.node_tree for n in nodes if n[TAG] == "group"]
            if tree.is_editable and not any(g is not None and BAKE in g for g in groups):
                _take_out(nodes)


def _take_out(nodes: list[bpy.types.Node]) -> None:
    """Remove own nodes; what the group stood between is joined again."""
    for node in nodes:
        tree = node.id_data
        if node[TAG] == "group" and node.inputs["Image"].is_linked:
            source = node.inputs["Image"].links[0].from_socket
            for socket in [link.to_socket for link in node.outputs["Image"].links]:
                tree.links.new(source, socket)
        tree.nodes.remove(node)


def has_group(scene: bpy.types.Scene) -> bool:
    """Whether the scene's tree holds the extension's group for this scene."""
    node = group_node(scene)
    return node is not None and node.node_tree is not None and not _is_copied(node, scene)


def group_node(scene: bpy.types.Scene) -> bpy.types.Node | None:
    """The node of the extension's group in the scene's tree."""
    return next((n for n in nodes_of(scene) if n[TAG] == "group"), None)


def nodes_of(scene: bpy.types.Scene) -> list[bpy.types.Node]:
    """The extension's nodes in the scene's tree but those of other scenes that share it."""
    tree = scene.compositing_node_group
    if tree is None:
        return []
    sharing = {s.name for s in bpy.data.scenes if s.compositing_node_group == tree and s != scene}
    return [n for n in tree.nodes if n.get(TAG) and n.get(_SCENE) not in sharing]


def _is_copied(node: bpy.types.Node, scene: bpy.types.Scene) -> bool:
    """Whether the node came with a copy of another scene; a scene renamed keeps its node."""
    return node.get(_SCENE) != scene.name and node.get(_SCENE) in bpy.data.scenes


def _users_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The scene's tree; None if the extension made it, perhaps for the scene this is a copy of."""
    tree = scene.compositing_node_group
    if own(tree, "compositor") and _is_plain(tree):
        return None
    return tree


def _is_plain(tree: bpy.types.NodeTree) -> bool:
    """Whether an own tree is as it was made, the extension's nodes left out."""
    nodes = [n.bl_idname for n in tree.nodes if not n.get(TAG)]
    return sorted(nodes) == ["CompositorNodeRLayers", "NodeGroupOutput"]


def write_weights(
    scene: bpy.types.Scene, pane: Pane, glass: Glass, regions: Regions, view: Viewpoint
) -> None:
    """Write a glass's path weights into the images that the node group reads."""
    x0, y0, x1, y1 = view.window
    image = _find_image(_rest_name(scene, pane), "weights")
    if image is not None:
        rest = np.ones((y1 - y0, x1 - x0, 4), np.float32)
        left_out = regions.left_out()
        if scene.refractive_glass.surface != "GLASS":
            # What is reflected there is lost.
            left_out[:] = 0.0
        rest[..., :3] = regions.full(left_out, view.size)[y0:y1, x0:x1, None]
        write_image(image, rest)
    for number, shares in enumerate(regions.shares):
        image = _find_image(_weight_name(scene, pane, number), "weights")
        if image is None:
            # The path's rays carry its weight with them.
            continue
        pixels = np.ones((y1 - y0, x1 - x0, 4), np.float32)
        pixels[..., :3] = regions.full(shares, view.size)[y0:y1, x0:x1, None]
        if glass.tints(regions.paths[number]):
            tint = np.moveaxis(tints(glass, view, regions, regions.paths[number]), 2, 0)
            pixels[..., :3] *= np.moveaxis(regions.full(tint, view.size), 0, 2)[y0:y1, x0:x1]
        write_image(image, pixels)


def write_cover(scene: bpy.types.Scene, pane: Pane, screen: RayScreen, view: Viewpoint) -> None:
    """Write which pixels rays show into the image that the node group reads."""
    image = _find_image(_cover_name(scene, pane), "weights")
    if image is None:
        # Of the colours of a glass that disperses one tells.
        return
    x0, y0, x1, y1 = view.window
    low_x, low_y, high_x, high_y = screen.rect
    cover = np.zeros((view.size[1], view.size[0], 4), np.float32)
    cover[..., 3] = 1.0
    cover[low_y:high_y, low_x:high_x, :3] = screen.cover[..., None]
    write_image(image, cover[y0:y1, x0:x1])


def write_kernels() -> None:
    """Write the kernels' pixels, which a file does not keep."""
    for image in bpy.data.images:
        if not own(image, "kernel"):
            continue
        values = np.array(image[_VALUES])
        kernel = np.outer(values, values)
        pixels = np.ones((*kernel.shape, 4), np.float32)
        pixels[..., :3] = (kernel / kernel.sum())[..., None]
        write_image(image, pixels)


def _weight_name(scene: bpy.types.Scene, pane: Pane, number: int) -> str:
    return hidden_name("weights", scene.name, pane.key, str(number))


def _cover_name(scene: bpy.types.Scene, pane: Pane) -> str:
    return hidden_name("weights", scene.name, pane.key, "cover")


def _rest_name(scene: bpy.types.Scene, pane: Pane) -> str:
    return hidden_name("weights", scene.name, pane.key, "rest")


def _find_image(name: str, role: str) -> bpy.types.Image | None:
    for image in bpy.data.images:
        if own(image, role) and image.name == name and image.library is None:
            return image
    return None


def _own_image(name: str, role: str) -> bpy.types.Image:
    image = _find_image(name, role)
    if image is None:
        image = bpy.data.images.new(name, 4, 4, float_buffer=True, is_data=True)
        image[TAG] = role
        image.alpha_mode = "CHANNEL_PACKED"
    return image


def _plain_tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new(hidden_name("compositor", scene.name), "CompositorNodeTree")
    tree[TAG] = "compositor"
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    with _as_if_in(scene):
        render_layers = tree.nodes.new("CompositorNodeRLayers")
    render_layers.scene = scene
    end = tree.nodes.new("NodeGroupOutput")
    end.location = (600, 0)
    tree.links.new(render_layers.outputs["Image"], end.inputs["Image"])
    scene.compositing_node_group = tree
    return tree


def _render_layers(scene: bpy.types.Scene, tree: bpy.types.NodeTree):
    """The tree's Render Layers node of the scene's first rendered view layer."""
    nodes = [
        n
        for n in tree.nodes
        if n.bl_idname == "CompositorNodeRLayers" and n.scene == scene and not n.get(TAG)
    ]
    first = next((layer.name for layer in scene.view_layers if layer.use), None)
    return next((n for n in nodes if n.layer == first), nodes[0] if nodes else None)


def _lookup_inverse(side: int, half: int = 8) -> np.ndarray:
    """What undoes, at the pixels' centres, the lookup's blur: (2 half + 1,) of a separable kernel.

    A cubic B-spline blurs (Unser, "Splines", 1999), and ``side`` places of it a pixel are averaged.
    With both undone, what is looked up one to one is as sharp as the direct picture: the engine's
    filter has acted on it once, and nothing has again.
    """
    apart = np.abs(np.arange(-half, half + 1)[:, None] + (np.arange(side) + 0.5) / side - 0.5)
    inner, outer = 2 / 3 - apart**2 + apart**3 / 2, np.clip(2 - apart, 0, None) ** 3 / 6
    blur = np.where(apart < 1, inner, outer).mean(axis=1)
    # Even, so its spectrum is real; and above zero.
    spectrum = np.fft.fft(np.fft.ifftshift(blur)).real
    return np.fft.fftshift(np.fft.ifft(1.0 / spectrum).real)


class _Group:
    """Builds the node group: one method a part of the sum."""

    def __init__(
        self, scene, layers: Layers, panes, true_shading: bool, subdivision: int, around: str
    ) -> None:
        self.scene, self.layers, self.around = scene, layers, around
        self.true_shading, self.subdivision = true_shading, subdivision
        self.direct_depth = None
        self.tree, start = self._new_tree("Image", "Alpha")
        self.direct = start.outputs["Image"]
        colour, alpha = self.direct, start.outputs["Alpha"]
        if true_shading and not all(pane.rays for pane in panes):
            self.direct_depth = self._layer(layers.lookup, DEPTH_LAYER).outputs["Image"]
            # Map UV's bicubic is a B-spline, and places of it are averaged: both blur.
            kernel = self._kernel(f"lookup {subdivision}", _lookup_inverse(subdivision))
            # Beyond the picture's border the convolution finds nothing.
            one = self._math("ADD", self._math("MULTIPLY", alpha, 0.0), 1.0)
            there = self._math("DIVIDE", 1.0, self._convolved(one, kernel))
            self.direct = self._scaled(self._convolved(self.direct, kernel), there)
        for _, bands in groupby(panes, key=lambda pane: (pane.glass, pane.borders)):
            colour, alpha = self._apart(list(bands), colour, alpha)
        end = self._node("NodeGroupOutput")
        self._link(self._with_alpha(colour, alpha), end.inputs["Image"])

    def _new_tree(self, *inputs: str):
        """An own tree with these inputs (all but Alpha are pictures) and an output Image."""
        tree = bpy.data.node_groups.new(
            hidden_name("composite", self.scene.name), "CompositorNodeTree"
        )
        tree[TAG] = "composite"
        for name in inputs:
            kind = "NodeSocketFloat" if name == "Alpha" else "NodeSocketColor"
            tree.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        return tree, tree.nodes.new("NodeGroupInput")

    def _apart(self, bands: list[Pane], colour, alpha):
        """:meth:`_through` in a tree of its own.

        With each link Blender looks through the whole tree: of eighteen glasses in one, building
        it took longer than solving them.
        """
        outer, direct, depth = self.tree, self.direct, self.direct_depth
        self.tree, start = self._new_tree("Image", "Alpha", "Direct", "Depth")
        self.tree.interface.new_socket("Alpha", in_out="OUTPUT", socket_type="NodeSocketFloat")
        self.direct, self.direct_depth = start.outputs["Direct"], start.outputs["Depth"]
        results = self._through(bands, start.outputs["Image"], start.outputs["Alpha"])
        end = self._node("NodeGroupOutput")
        for result, name in zip(results, ("Image", "Alpha"), strict=True):
            self._feed(result, end.inputs[name])
        inner, self.tree = self.tree, outer
        self.direct, self.direct_depth = direct, depth
        node = self._node("CompositorNodeGroup")
        node.node_tree = inner
        given = {"Image": colour, "Alpha": alpha, "Direct": direct, "Depth": depth}
        for name, value in given.items():
            if value is not None:
                self._link(value, node.inputs[name])
        return node.outputs["Image"], node.outputs["Alpha"]

    def _through(self, bands: list[Pane], colour, alpha):
        """The picture with one more glass in it; ``bands``: it in light of each colour."""
        one = len(bands) == 1
        straight = colour, alpha
        seen_colour, seen_alpha = (
            self._seen(bands[0], *straight) if one else self._joined(bands, *straight)
        )
        if bands[0].rays:
            return self._by_rays(bands[0], (colour, alpha), (seen_colour, seen_alpha))
        cover = self._mask(bands[0])
        beside = self._math("SUBTRACT", 1.0, cover)
        colour = self._vector("ADD", self._scaled(colour, beside), self._scaled(seen_colour, cover))
        alpha = self._math(
            "ADD", self._math("MULTIPLY", alpha, beside), self._math("MULTIPLY", seen_alpha, cover)
        )
        return colour, alpha

    def _by_rays(self, pane: Pane, behind, seen):
        """The picture with what rays show in its place: a cup, edge and all, or paths' borders."""
        image = self._node("CompositorNodeImage")
        image.image = _own_image(_cover_name(self.scene, pane), "weights")
        split = self._node("ShaderNodeSeparateXYZ")
        self._link(image.outputs["Image"], split.inputs[0])
        cover = split.outputs[0]
        beside = self._math("SUBTRACT", 1.0, cover)
        colour = self._vector("ADD", self._scaled(behind[0], beside), self._scaled(seen[0], cover))
        parts = (self._math("MULTIPLY", a, b) for a, b in ((behind[1], beside), (seen[1], cover)))
        return colour, self._math("ADD", *parts)

    def _joined(self, bands: list[Pane], straight, straight_alpha):
        """Red of what red light shows, and so on; alpha is their mean."""
        colour, alpha = (0.0, 0.0, 0.0), 0.0
        for channel, pane in enumerate(bands):
            seen, seen_alpha = self._seen(pane, straight, straight_alpha)
            part = self._vector("MULTIPLY", seen, tuple(float(k == channel) for k in range(3)))
            colour = self._vector("ADD", colour, part)
            alpha = self._math("ADD", alpha, self._math("DIVIDE", seen_alpha, float(len(bands))))
        return colour, alpha

    def _seen(self, pane: Pane, straight, straight_alpha):
        """Colour and alpha of what is seen through a glass; ``straight``: as though it was not."""
        if pane.rays:
            (name,) = pane.mirror_layers(self.around)
            rays = self._layer(self.layers.around, name)
            return rays.outputs["Image"], rays.outputs["Alpha"]
        # What no path brings is dark, not transparent: alpha lacks only what passes the scene.
        seen_colour, passing = (0.0, 0.0, 0.0), 0.0
        if any(path.interfaces is not None for path in pane.paths):
            # Rays of which hardly any path was kept pass straight through.
            image = self._node("CompositorNodeImage")
            image.image = _own_image(_rest_name(self.scene, pane), "weights")
            rest = image.outputs["Image"]
            seen_colour = self._vector("MULTIPLY", straight, rest)
            passing = self._math("MULTIPLY", self._math("SUBTRACT", 1.0, straight_alpha), rest)
        uncovered: dict[optics.LightPath, bpy.types.NodeSocket] = {}
        # What the open paths show is needed first: it stands before what others show.
        inner = {path: self._inside(pane, path) for path in pane.paths if path.open}
        for path, (_, path_alpha) in inner.items():
            uncovered[path] = self._math("SUBTRACT", 1.0, path_alpha)

        def behind(path, part):
            for begin in pane.before(path):
                part = self._scaled(part, uncovered[begin])
            return part

        def alpha_behind(path, part):
            for begin in pane.before(path):
                part = self._math("MULTIPLY", part, uncovered[begin])
            return part

        mirrored = set(pane.without_copies(self.around))
        for name, numbers in pane.mirror_layers(self.around).items():
            rays = self._layer(self.layers.around, name)
            first = pane.paths[numbers[0]]
            part = behind(first, rays.outputs["Image"])
            seen_colour = self._vector("ADD", seen_colour, part)
            through = self._math("SUBTRACT", 1.0, rays.outputs["Alpha"])
            passing = self._math("ADD", passing, alpha_behind(first, through))
        for number, path in enumerate(pane.paths):
            if number in mirrored:
                continue
            image = self._node("CompositorNodeImage")
            image.image = _own_image(_weight_name(self.scene, pane, number), "weights")
            weight = image.outputs["Image"]
            path_colour, path_alpha = inner[path] if path.open else self._path(pane, path)
            part = behind(path, self._vector("MULTIPLY", path_colour, weight))
            seen_colour = self._vector("ADD", seen_colour, part)
            if path.open:
                continue
            through = self._math("MULTIPLY", self._math("SUBTRACT", 1.0, path_alpha), weight)
            passing = self._math("ADD", passing, alpha_behind(path, through))
        return seen_colour, self._math("SUBTRACT", 1.0, passing)

    def _mask(self, pane: Pane):
        """How much of each pixel shows the glass: its outline, less what stands before it."""
        return self._layer(self.layers.mask, pane.mask_layer).outputs["Alpha"]

    def _path(self, pane: Pane, path):
        """Colour and alpha of what is seen along one light path."""
        if not self.true_shading:
            return self._drawn(pane, path)
        where = self._layer(self.layers.lookup, pane.layer(path))
        split = self._node("CompositorNodeSeparateColor")
        self._link(self._subdivided(where.outputs["Image"]), split.inputs[0])
        # Map UV multiplies by the third component.
        place = self._node("ShaderNodeCombineXYZ")
        self._link(split.outputs[0], place.inputs[0])
        self._link(split.outputs[1], place.inputs[1])
        place.inputs[2].default_value = 1.0
        looked_up = self._map(self.direct, place.outputs[0], "Bicubic")
        shown = self._shown_in_direct(
            place.outputs[0], split.outputs[2], self._subdivided(where.outputs["Alpha"])
        )
        found = self._brought_down(self._scaled(looked_up, shown))
        share = self._brought_down(shown)
        missing = self._math("SUBTRACT", 1.0, share)
        if path.open:
            drawn = self._layer(self.layers.displaced, pane.layer(path))
            else_colour, else_alpha = drawn.outputs["Image"], drawn.outputs["Alpha"]
        elif pane.held_along(path) and path.interfaces is None:
            else_colour, else_alpha = self._drawn(pane, path)
        else:
            around = self._layer(self.layers.around, pane.ray_layer(path))
            else_colour, else_alpha = around.outputs["Image"], around.outputs["Alpha"]
        colour = self._vector("ADD", found, self._scaled(else_colour, missing))
        alpha = self._math("ADD", share, self._math("MULTIPLY", else_alpha, missing))
        return colour, alpha

    def _inside(self, pane: Pane, path):
        """Colour (times alpha) and alpha of what a glass holds, seen along an open path."""
        if self.true_shading:
            return self._path(pane, path)
        drawn = self._layer(self.layers.displaced, pane.layer(path))
        return drawn.outputs["Image"], drawn.outputs["Alpha"]

    def _drawn(self, pane: Pane, path):
        """The copies as shaded where they are drawn, and what they leave uncovered."""
        drawn = self._layer(self.layers.displaced, pane.layer(path))
        colour, alpha = drawn.outputs["Image"], drawn.outputs["Alpha"]
        if not self.around:
            return colour, alpha
        around = self._layer(self.layers.around, pane.ray_layer(path))
        uncovered = self._math("SUBTRACT", 1.0, alpha)
        colour = self._vector("ADD", colour, self._scaled(around.outputs["Image"], uncovered))
        behind = self._math("MULTIPLY", around.outputs["Alpha"], uncovered)
        return colour, self._math("ADD", alpha, behind)

    def _shown_in_direct(self, place, inverse_depth, alpha):
        """1 where the direct picture shows the place itself, not something before it."""
        split = self._node("CompositorNodeSeparateColor")
        self._link(self._map(self.direct_depth, place, "Bilinear"), split.inputs[0])
        off = self._math("ABSOLUTE", self._math("SUBTRACT", split.outputs[0], inverse_depth))
        near = self._math("LESS_THAN", off, self._math("MULTIPLY", inverse_depth, DEPTH_TOLERANCE))
        # Between a surface and nothing there is no place to interpolate.
        return self._math("MULTIPLY", near, self._math("GREATER_THAN", alpha, 0.999))

    def _map(self, image, where, interpolation: str):
        node = self._node("CompositorNodeMapUV")
        node.inputs["Interpolation"].default_value = interpolation
        # The spline of a place within the border reaches beyond it; places beyond have no depth.
        extension = "Extend" if interpolation == "Bicubic" else "Clip"
        for axis in "XY":
            node.inputs[f"Extension {axis}"].default_value = extension
        self._link(image, node.inputs["Image"])
        self._link(where, node.inputs["UV"])
        return node.outputs["Image"]

    def _subdivided(self, image):
        """Places between those of the pixels' centres, linearly interpolated.

        Across an outline they mean nothing; the depth there tells.
        """
        scale = self._node("CompositorNodeScale")
        scale.inputs["Interpolation"].default_value = "Bilinear"
        for axis in "XY":
            scale.inputs[axis].default_value = self.subdivision
        self._link(image, scale.inputs["Image"])
        return scale.outputs["Image"]

    def _brought_down(self, image):
        """The mean over each pixel of what was looked up in its parts.

        It was filtered when the direct picture was rendered; it needs no more than the mean.
        """
        mean = self._node("CompositorNodeBlur")
        mean.inputs["Type"].default_value = "Flat"
        mean.inputs["Size"].default_value = (self.subdivision // 2,) * 2
        self._link(image, mean.inputs["Image"])
        scale = self._node("CompositorNodeScale")
        scale.inputs["Type"].default_value = "Render Size"
        scale.inputs["Interpolation"].default_value = "Nearest"
        self._link(mean.outputs["Image"], scale.inputs["Image"])
        return scale.outputs["Image"]

    def _convolved(self, image, kernel):
        convolve = self._node("CompositorNodeConvolve")
        self._link(image, convolve.inputs["Image"])
        kernel_input = next(s for s in convolve.inputs if s.name == "Kernel" and s.type == "VALUE")
        self._link(kernel, kernel_input)
        return convolve.outputs["Image"]

    def _kernel(self, name: str, values: np.ndarray):
        """A separable kernel (K,), K odd; :func:`write_kernels` makes the picture of it."""
        node = self._node("CompositorNodeImage")
        node.image = _own_image(hidden_name(name, str(len(values))), "kernel")
        node.image[_VALUES] = values.tolist()
        return node.outputs["Image"]

    def _layer(self, own_scene: bpy.types.Scene, name: str):
        with _as_if_in(own_scene):
            node = self._node("CompositorNodeRLayers")
        node.scene = own_scene
        node.layer = name
        return node

    def _with_alpha(self, colour, alpha):
        split = self._node("ShaderNodeSeparateXYZ")
        self._link(colour, split.inputs[0])
        join = self._node("CompositorNodeCombineColor")
        for slot in range(3):
            self._link(split.outputs[slot], join.inputs[slot])
        self._link(alpha, join.inputs["Alpha"])
        return join.outputs[0]

    def _scaled(self, colour, factor):
        node = self._node("ShaderNodeVectorMath", operation="SCALE")
        self._feed(colour, node.inputs[0])
        self._feed(factor, node.inputs["Scale"])
        return node.outputs[0]

    def _vector(self, operation: str, first, second):
        node = self._node("ShaderNodeVectorMath", operation=operation)
        for slot, value in enumerate((first, second)):
            self._feed(value, node.inputs[slot])
        return node.outputs[0]

    def _math(self, operation: str, first, second=None):
        node = self._node("ShaderNodeMath", operation=operation)
        for slot, value in enumerate((first, second)):
            if value is not None:
                self._feed(value, node.inputs[slot])
        return node.outputs[0]

    def _feed(self, value, target) -> None:
        """Link an output to an input, or set the input to a constant."""
        if isinstance(value, bpy.types.NodeSocket):
            self._link(value, target)
        else:
            target.default_value = value

    def _node(self, idname: str, **properties):
        node = self.tree.nodes.new(idname)
        count = len(self.tree.nodes)
        node.location = (190 * (count // 8), -190 * (count % 8))
        for key, value in properties.items():
            setattr(node, key, value)
        return node

    def _link(self, source, target) -> None:
        self.tree.links.new(source, target)
