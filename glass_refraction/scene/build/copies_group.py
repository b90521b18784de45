# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group that sums displaced copies, and the images of weights that it reads.

Where a glass is seen the picture is the sum over its slots of weight times layer. What the copies
leave uncovered of a slot's region shows what is *beyond*: the world, or the direct picture.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..names import TAG, hidden_name, own
from ..plan import GlassPlan, Pane, Plan
from ..read.arrays import write_image
from .compositor import as_if_in
from .layers import Layers
from .node_sums import NodeSums
from .own_scenes import owner_of

_OWNER = "refractive_glass_owner"
_PANE = "refractive_glass_pane"
_SLOT = "refractive_glass_slot"
_REST, _BEYOND = -1, -2
"""In place of a slot's number: what passes straight through, and the world's colour."""
_BLANK = 4
"""Pixels a side of an image that says the same of every pixel."""
_FULL = 1.003
"""The mask times this is clipped at 1: Workbench's samples of a white pixel add up to 0.998."""


def images_of(scene: bpy.types.Scene) -> dict[tuple[int, int], bpy.types.Image]:
    """(pane, slot) -> the image of weights; see also ``_REST`` and ``_BEYOND``."""
    owner = owner_of(scene)
    return {
        (image[_PANE], image[_SLOT]): image
        for image in bpy.data.images
        if own(image, "weights") and image.get(_OWNER) == owner and image.library is None
    }


def write_slot(image: bpy.types.Image, weights: np.ndarray | None) -> None:
    """Write the weights, pixels (H, W, 4), of one slot; None: nothing is seen along it."""
    if weights is None:
        if tuple(image.size) != (_BLANK, _BLANK) or image.pixels[0] != 0.0:
            _write_plain(image, (0.0, 0.0, 0.0))
        return
    write_image(image, weights)


def write_rest(images, pane: Pane, rest: np.ndarray | None) -> None:
    """Write which part of the light, pixels (H, W, 4), passes a pane straight through."""
    write_slot(images[pane.number, _REST], rest)


def write_beyond(images, colour: tuple[float, float, float]) -> None:
    """Write the colour of what is beyond, if it has one; an image, for a render reads those."""
    image = images.get((0, _BEYOND))
    if image is not None and not np.allclose(image.pixels[:3], colour, rtol=1e-6, atol=1e-12):
        _write_plain(image, colour)


def _write_plain(image: bpy.types.Image, colour) -> None:
    pixels = np.ones((_BLANK, _BLANK, 4), np.float32)
    pixels[..., :3] = colour
    write_image(image, pixels)


def build_group(scene: bpy.types.Scene, layers: Layers, plan: Plan) -> bpy.types.NodeTree:
    """The node group of a scene: inputs Image and Alpha, output Image."""
    return _Group(scene, layers, plan).tree


class _Group(NodeSums):
    """Builds the node group: one method a part of the sum."""

    def __init__(self, scene: bpy.types.Scene, layers: Layers, plan: Plan) -> None:
        self.scene, self.layers, self.plan = scene, layers, plan
        self.images = images_of(scene)
        self.tree, start = self._new_tree({"Image": "Color", "Alpha": "Float"}, {"Image": "Color"})
        direct, alpha = start.outputs["Image"], start.outputs["Alpha"]
        behind = self._behind(direct, alpha)
        # Of the direct picture's size, whatever the sizes of what is added.
        total = self._scaled(direct, 0.0), self._math("MULTIPLY", alpha, 0.0)
        cover = total[1]
        for glass in plan.glasses:
            total, cover = self._apart(glass, total, cover, (direct, alpha), behind)
        beside = self._math("SUBTRACT", 1.0, cover, clamp=True)
        colour = self._vector("ADD", total[0], self._scaled(direct, beside))
        opacity = self._math("ADD", total[1], self._math("MULTIPLY", alpha, beside))
        end = self._node("NodeGroupOutput")
        self._link(self._with_alpha(colour, opacity), end.inputs["Image"])

    def _behind(self, direct, alpha):
        """Colour and alpha of what is seen where no copy covers a region."""
        if self.plan.beyond == "DIRECT":
            return direct, alpha
        scale = self._node("CompositorNodeScale")
        scale.inputs["Type"].default_value = "Render Size"
        scale.inputs["Interpolation"].default_value = "Nearest"
        self._link(self._image(0, _BEYOND), scale.inputs["Image"])
        opacity = 1.0 if self.plan.beyond == "WORLD" else 0.0
        one = self._math("ADD", self._math("MULTIPLY", alpha, 0.0), opacity)
        return scale.outputs["Image"], one

    def _apart(self, glass: GlassPlan, total, cover, direct, behind):
        """The sum with one more glass in it, in a tree of its own.

        With each link Blender looks through the whole tree: of eighteen glasses in one, building
        it took longer than solving them.
        """
        outer = self.tree
        given = {
            "Image": total[0],
            "Alpha": total[1],
            "Cover": cover,
            "Direct": direct[0],
            "Direct Alpha": direct[1],
            "Behind": behind[0],
            "Behind Alpha": behind[1],
        }
        colours = {"Image", "Direct", "Behind"}
        kinds = {name: "Color" if name in colours else "Float" for name in given}
        results = {name: kinds[name] for name in ("Image", "Alpha", "Cover")}
        self.tree, start = self._new_tree(kinds, results)
        inner = start.outputs
        seen, opacity = self._seen(
            glass,
            (inner["Direct"], inner["Direct Alpha"]),
            (inner["Behind"], inner["Behind Alpha"]),
        )
        shown = self._mask(glass)
        summed = {
            "Image": self._vector("ADD", inner["Image"], self._scaled(seen, shown)),
            "Alpha": self._math("ADD", inner["Alpha"], self._math("MULTIPLY", opacity, shown)),
            "Cover": self._math("ADD", inner["Cover"], shown),
        }
        end = self._node("NodeGroupOutput")
        for name, value in summed.items():
            self._link(value, end.inputs[name])
        made, self.tree = self.tree, outer
        node = self._node("CompositorNodeGroup")
        node.node_tree = made
        for name, value in given.items():
            self._link(value, node.inputs[name])
        return (node.outputs["Image"], node.outputs["Alpha"]), node.outputs["Cover"]

    def _seen(self, glass: GlassPlan, direct, behind):
        """Colour and alpha of what is seen through a glass: red of what red light shows, etc."""
        if len(glass.panes) == 1:
            return self._along_paths(glass.panes[0], direct, behind)
        colour, alpha = self._scaled(direct[0], 0.0), self._math("MULTIPLY", direct[1], 0.0)
        for channel, pane in enumerate(glass.panes):
            seen, opacity = self._along_paths(pane, direct, behind)
            part = self._vector("MULTIPLY", seen, tuple(float(k == channel) for k in range(3)))
            colour = self._vector("ADD", colour, part)
            share = self._math("DIVIDE", opacity, float(len(glass.panes)))
            alpha = self._math("ADD", alpha, share)
        return colour, alpha

    def _along_paths(self, pane: Pane, direct, behind):
        """Colour and alpha of what is seen through a glass in light of one colour."""
        # Rays of which hardly any path was kept pass straight through.
        rest = self._image(pane.number, _REST)
        colour = self._vector("MULTIPLY", direct[0], rest)
        # What no path brings is dark, not transparent: alpha lacks only what passes the scene.
        passing = self._math("MULTIPLY", self._math("SUBTRACT", 1.0, direct[1]), rest)
        uncovered = self._scaled(direct[0], 0.0)
        for slot in range(pane.slots):
            weight = self._image(pane.number, slot)
            copies = self._layer(self.layers.displaced, pane.layer(slot))
            part = self._vector("MULTIPLY", copies.outputs["Image"], weight)
            colour = self._vector("ADD", colour, part)
            if slot >= pane.whole_slots:
                # Behind what a glass holds the whole paths show what they show.
                continue
            left = self._math("SUBTRACT", 1.0, copies.outputs["Alpha"])
            uncovered = self._vector("ADD", uncovered, self._scaled(weight, left))
        colour = self._vector("ADD", colour, self._vector("MULTIPLY", behind[0], uncovered))
        clear = self._math("SUBTRACT", 1.0, behind[1])
        passing = self._math("ADD", passing, self._math("MULTIPLY", clear, uncovered))
        return colour, self._math("SUBTRACT", 1.0, passing)

    def _mask(self, glass: GlassPlan):
        """How much of each pixel shows the glass: its outline, less what stands before it."""
        split = self._node("ShaderNodeSeparateXYZ")
        self._link(
            self._layer(self.layers.mask, glass.mask_layer).outputs["Image"], split.inputs[0]
        )
        return self._math("MULTIPLY", split.outputs[0], _FULL, clamp=True)

    def _new_tree(self, inputs: dict[str, str], outputs: dict[str, str]):
        """An own tree with these sockets, and the node of its inputs."""
        name = hidden_name("composite", self.scene.name)
        tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
        tree[TAG] = "composite"
        for sockets, in_out in ((inputs, "INPUT"), (outputs, "OUTPUT")):
            for socket, kind in sockets.items():
                tree.interface.new_socket(socket, in_out=in_out, socket_type=f"NodeSocket{kind}")
        return tree, tree.nodes.new("NodeGroupInput")

    def _image(self, pane: int, slot: int):
        """The picture of an own image, which is made if it is not there yet."""
        image = self.images.get((pane, slot))
        if image is None:
            name = hidden_name("weights", str(pane), str(slot), self.scene.name)
            image = bpy.data.images.new(name, _BLANK, _BLANK, float_buffer=True, is_data=True)
            image[TAG], image[_OWNER] = "weights", owner_of(self.scene)
            image[_PANE], image[_SLOT] = pane, slot
            image.alpha_mode = "CHANNEL_PACKED"
            self.images[pane, slot] = image
        node = self._node("CompositorNodeImage")
        node.image = image
        return node.outputs["Image"]

    def _layer(self, own_scene: bpy.types.Scene, name: str):
        with as_if_in(own_scene):
            node = self._node("CompositorNodeRLayers")
        node.scene = own_scene
        node.layer = name
        return node
