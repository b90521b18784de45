# SPDX-License-Identifier: GPL-3.0-or-later
"""The node tree that sums samples: the same for every frame, which write its pictures only."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..build.node_sums import NodeSums
from ..names import TAG, hidden_name, own
from ..read.arrays import write_image
from ..read.visibility import rendered_layer
from .samples import EARLY, LEVELS, Packed

SHARPENINGS = 3
"""Steps that undo a spline's blur: of lines, be they fine or coarse, 1 % of it is left."""
TENT_PX = 4.0 / 3.0
"""Reach of the tent whose weights at a pixel and those beside it are those of a B-spline, 4 : 1."""
LEAST_LIGHT = 1e-12
"""Keeps a quotient finite."""
LEAST_LEFT = 1.0 / 3.0
"""What a cubic B-spline leaves of the finest lines. Of a chequerboard it leaves 1/9, which
only noise asks back."""


def sharpening_factors() -> np.ndarray:
    """Factors f (`SHARPENINGS`,) of steps x + f (y − Bx), from x = y, that solve Bx = y.

    B is what a B-spline finds at the pixels' centres. Looked up by it, the solution is
    interpolated: at its pixels' centres it has the values y (Unser, "Splines", 1999). The start is
    a step from 0 with the factor 1, so what is even stays exactly as it is. The inverses of all
    factors are the zeros of a Chebyshev polynomial, which is small from `LEAST_LEFT` to 1.
    """
    count = SHARPENINGS + 1
    zeros = np.cos((np.arange(count) + 0.5) * np.pi / count)
    half = (1.0 - LEAST_LEFT) / (1.0 + zeros[0])
    return 1.0 / (LEAST_LEFT + half * (1.0 + zeros[1:]))


@dataclass(frozen=True)
class Outputs:
    """Sockets of one view: its picture and its alpha."""

    image: bpy.types.NodeSocket
    alpha: bpy.types.NodeSocket


def image_name(scene: bpy.types.Scene, *parts: object) -> str:
    """Name of one of the pictures that a scene's frames write."""
    return hidden_name("picture", str(scene.session_uid), *map(str, parts))


class Pictures:
    """The pictures that a scene's frames write, by what they are for."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        start = image_name(scene)
        self._found = {
            image.name[len(start) :].strip(): image
            for image in bpy.data.images
            if own(image, "picture") and image.library is None and image.name.startswith(start)
        }

    def write(self, pixels: np.ndarray, *parts: object) -> None:
        """Set the pixels (height, width, 4) of one picture; of none if the tree has no such."""
        image = self._found.get(" ".join(map(str, parts)))
        if image is not None:
            write_image(image, pixels)

    def write_view(self, number: int, packed: Packed, weight: np.ndarray) -> None:
        """Set the pictures of one view's samples, of weights (K,) without tints.

        Those of pairs are forgotten one by one, so that Blender's copies take their room.
        """
        self.write(packed.where, number, "where")
        self.write(packed.colour, number, "colour")
        if f"{number} alpha" in self._found:
            self.write(packed.alpha(weight), number, "alpha")
        for level in range(len(packed.pairs)):
            first, second = packed.pairs.pop(0)
            self.write(first, number, "first", level)
            self.write(second, number, "second", level)
        for place, into in enumerate(packed.into):
            self.write(into, number, "into", place)


def new_image(name: str, role: str) -> bpy.types.Image:
    """A float picture of the extension's own, of no particular size yet."""
    image = bpy.data.images.new(name, 4, 4, float_buffer=True, is_data=True)
    image[TAG] = role
    image.alpha_mode = "CHANNEL_PACKED"
    return image


class _Lookups(NodeSums):
    """Builds a compositor tree that reads a scene's pictures and looks others up by them."""

    def __init__(
        self, scene: bpy.types.Scene, known: dict[str, bpy.types.Image], role: str, *name: str
    ) -> None:
        self._scene, self._known = scene, known
        self.tree = bpy.data.node_groups.new(hidden_name(role, *name), "CompositorNodeTree")
        self.tree[TAG] = role

    def _image(self, *parts: object) -> bpy.types.Image:
        name = image_name(self._scene, *parts)
        if name not in self._known:
            self._known[name] = new_image(name, "picture")
        return self._known[name]

    def _picture(self, *parts: object, output: str = "Image"):
        node = self._node("CompositorNodeImage")
        node.image = self._image(*parts)
        return node.outputs[output]

    def _at(self, image, where, method: str = "Nearest"):
        node = self._node("CompositorNodeMapUV")
        node.inputs["Interpolation"].default_value = method
        for axis in "XY":
            node.inputs[f"Extension {axis}"].default_value = "Extend"
        self._link(image, node.inputs["Image"])
        self._link(where, node.inputs["UV"])
        return node.outputs["Image"]

    def _split(self, colour):
        node = self._node("ShaderNodeSeparateXYZ")
        self._link(colour, node.inputs[0])
        return node.outputs[0]


class _ViewTree(_Lookups):
    """Builds trees of one view's sums, of the packed pixels: from its picture, Image to Image.

    Blender goes through all of a tree whenever a node or a link is added: one tree of all views
    took a second to build. So the first view's is built, and the others are copies of it.
    """

    def __init__(
        self, scene: bpy.types.Scene, known: dict[str, bpy.types.Image], kind: str
    ) -> None:
        self._name = "view sum", str(scene.session_uid), kind
        self._pictures: dict[str, tuple] = {}
        super().__init__(scene, known, *self._name)
        for way in ("INPUT", "OUTPUT"):
            self.tree.interface.new_socket("Image", in_out=way, socket_type="NodeSocketColor")
        image = self._node("NodeGroupInput").outputs["Image"]
        where = self._of_view("where")
        if kind == "colour":
            looked_up = self._interpolated(image, where)
        else:
            looked_up = self._at(image, where, "Bilinear")
        # Alpha is what the samples' weights show; a tint takes none of it.
        colour, most = (self._of_view(kind, output=part) for part in ("Image", "Alpha"))
        found = self._vector("MULTIPLY", looked_up, colour)
        if kind == "colour":
            found = self._limited(found, most)
        done = None
        for level in range(LEVELS):
            if level == EARLY:
                done = self._at(found, self._of_view("into", 0))
            first = self._at(found, self._of_view("first", level))
            second = self._at(found, self._of_view("second", level))
            found = self._vector("ADD", first, second)
        rest = self._at(found, self._of_view("into", 1))
        found = self._vector("ADD", done, rest)
        self._link(found, self._node("NodeGroupOutput").inputs["Image"])

    def of(self, number: int) -> bpy.types.NodeTree:
        """The tree of the view of that number."""
        if not number:
            return self.tree
        tree = self.tree.copy()
        tree.name = hidden_name(*self._name, str(number))
        for name, parts in self._pictures.items():
            tree.nodes[name].image = self._image(number, *parts)
        return tree

    def _of_view(self, *parts: object, output: str = "Image"):
        """A picture that each view has its own of."""
        found = self._picture(0, *parts, output=output)
        self._pictures[found.node.name] = parts
        return found

    def _limited(self, light, most):
        """Light whose mean of red, green and blue is above a limit, scaled down to it."""
        mean = self._vector("DOT_PRODUCT", light, (1.0 / 3.0,) * 3)
        part = self._math("DIVIDE", most, self._math("MAXIMUM", mean, LEAST_LIGHT))
        return self._scaled(light, self._math("MINIMUM", part, 1.0))

    def _interpolated(self, image, where):
        """A view's colours at places: by splines up to white, straight what is brighter.

        Splines swing beside an edge, by a tenth of it: beside a lamp that is darker than black.
        """
        shown = self._vector("MINIMUM", image, self._picture("white"))
        glare = self._at(self._vector("SUBTRACT", image, shown), where, "Bilinear")
        sharp = self._at(self._sharpened(shown), where, "Bicubic")
        return self._vector("ADD", sharp, glare)

    def _sharpened(self, image):
        """A view such that a B-spline of it goes through its pixels, see `sharpening_factors`."""
        sharp = image
        for factor in sharpening_factors():
            lacking = self._vector("SUBTRACT", image, self._blurred(sharp))
            sharp = self._vector("ADD", sharp, self._scaled(lacking, factor))
        return sharp

    def _blurred(self, image):
        """What a B-spline of a view finds at its pixels' centres, the border continued.

        Looked up there it would take three times as long.
        """
        node = self._node("CompositorNodeBlur")
        for name, value in (("Type", "Tent"), ("Size", (TENT_PX, TENT_PX)), ("Separable", True)):
            node.inputs[name].default_value = value
        self._link(image, node.inputs["Image"])
        return node.outputs["Image"]


class SumTree(_Lookups):
    """Builds the compositor tree of True shading.

    Inputs Image and Alpha are the direct picture's, the output Image is the picture with all
    glasses in it. ``captures`` are scenes whose pictures the samples look up too. ``light``: what
    glasses change in the light of lamps is added to every view.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        captures: list[bpy.types.Scene],
        *,
        alpha: bool,
        light: bool = False,
    ) -> None:
        known = {i.name: i for i in bpy.data.images if own(i, "picture") and i.library is None}
        super().__init__(scene, known, "composite", scene.name)
        for name, kind in (("Image", "NodeSocketColor"), ("Alpha", "NodeSocketFloat")):
            self.tree.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        self.tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        start = self._node("NodeGroupInput")
        direct = Outputs(start.outputs["Image"], start.outputs["Alpha"])
        nodes = [self._layers(capture) for capture in captures]
        views = [direct, *(Outputs(n.outputs["Image"], n.outputs["Alpha"]) for n in nodes)]
        if light:
            layers = [self._layers(scene, rendered_layer(scene).name), *nodes]
            views = [self._lit(*part) for part in enumerate(zip(views, layers, strict=True))]
            direct = views[0]
        beside = self._picture("spread", output="Alpha")
        whole = self._vector("ADD", self._scaled(direct.image, beside), self._summed(views))
        through = self._math("MULTIPLY", direct.alpha, beside)
        if alpha:
            shown = self._split(self._summed([self._alpha(view) for view in views], "alpha"))
            through = self._math("ADD", through, shown)
        else:
            # An opaque film: what a glass covers is opaque as well.
            through = self._math("ADD", through, self._math("SUBTRACT", 1.0, beside))
        fits = self._is_of_frame(direct.image, [node.outputs["Image"] for node in nodes])
        colour = self._switched(fits, whole, start.outputs["Image"])
        alpha_shown = self._split(self._switched(fits, through, direct.alpha))
        # Blender takes what a Switch gives for one value, and tells the user's next nodes so,
        # unless a picture that is none takes part: here alpha's upper limit.
        most = self._math("MAXIMUM", start.outputs["Alpha"], 1.0)
        shown = self._with_alpha(colour, self._math("MINIMUM", alpha_shown, most))
        self._link(shown, self._node("NodeGroupOutput").inputs["Image"])

    def _switched(self, wanted, on, off):
        """One of two pictures."""
        switch = self._node("CompositorNodeSwitch")
        for name, socket in (("Switch", wanted), ("On", on), ("Off", off)):
            self._link(socket, switch.inputs[name])
        return switch.outputs["Image"]

    def _is_of_frame(self, image, captures):
        """Whether pictures are those that the last frame was written for.

        A 3D view that is composited has another size, or by chance the same, and no captures are
        drawn for it: it passes as it is.
        """
        size, wanted = self._size(self._picture("spread")), self._size(self._picture("rendered"))
        is_as_large = self._math(
            "LESS_THAN", self._vector("DISTANCE", self._size(image), size), 0.5
        )
        if not captures:
            return is_as_large
        # Of what is not drawn the size is 0.
        drawn = self._size(captures[0])
        for capture in captures[1:]:
            drawn = self._vector("MAXIMUM", drawn, self._size(capture))
        is_drawn = self._math(
            "GREATER_THAN", self._split(drawn), self._math("SUBTRACT", self._split(wanted), 1.5)
        )
        return self._math("MULTIPLY", is_as_large, is_drawn)

    def _size(self, image):
        info = self._node("CompositorNodeImageInfo")
        self._link(image, info.inputs["Image"])
        return info.outputs["Dimensions"]

    def _layers(self, scene: bpy.types.Scene, layer: str | None = None):
        # In its own context: Blender would count the present scene as used once more, for ever.
        with bpy.context.temp_override(scene=scene):
            node = self._node("CompositorNodeRLayers")
        node.scene = scene
        if layer is not None:
            node.layer = layer
        return node

    def _lit(self, number: int, view_and_layers) -> Outputs:
        """A view with what its surfaces show more by the light that glasses turn to them."""
        view, layers = view_and_layers
        if own(layers.scene, "sky"):
            return view
        colours = layers.outputs["Diffuse Color"]
        more = self._vector("MULTIPLY", colours, self._picture(number, "light"))
        lit = self._vector("ADD", view.image, more)
        # Noise of the picture, and what other things keep off in half shadow.
        return Outputs(self._vector("MAXIMUM", lit, (0.0, 0.0, 0.0)), view.alpha)

    def _alpha(self, view: Outputs) -> Outputs:
        """A view's alpha as a picture."""
        node = self._node("CompositorNodeCombineColor")
        for channel in range(3):
            self._link(view.alpha, node.inputs[channel])
        return Outputs(node.outputs[0], view.alpha)

    def _summed(self, views: list[Outputs], kind: str = "colour"):
        """The picture of all samples' sums, at the pixels' places."""
        known = self._picture("known" if kind == "colour" else "known alpha")
        trees = _ViewTree(self._scene, self._known, kind)
        nodes = []
        for number, view in enumerate(views):
            nodes.append(self._node("CompositorNodeGroup"))
            nodes[-1].node_tree = trees.of(number)
            self._link(view.image, nodes[-1].inputs["Image"])
        total = known
        for node in nodes:
            total = self._vector("ADD", total, node.outputs["Image"])
        return self._at(total, self._picture("spread"))
