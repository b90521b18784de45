# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a material cuts its surface out: leaves and fences by an image, walls by their side.

Understood is an image on a UV map that leads to *Alpha* of a Principled BSDF, or mixes another
shader with a white Transparent BSDF, straight or by way of Math nodes with constants. What is
partly there counts as there: views show it with what is behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import blake2b

import bpy
import numpy as np

MOST_ALPHA = 0.02
"""Below it nothing of a surface is there."""
MOST_PIXELS = 2**24
"""Of images that are read, 16 bytes each meanwhile."""
_MATH: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "MULTIPLY": np.multiply,
    "MINIMUM": np.minimum,
    "MAXIMUM": np.maximum,
    "GREATER_THAN": np.greater,
    "LESS_THAN": np.less,
    "ROUND": lambda a, _: np.floor(a + 0.5),
}
"""Of Math nodes, as far as they are understood."""
LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)


@dataclass(frozen=True, eq=False)
class Mask:
    """Where an image cuts a surface out.

    Attributes
    ----------
    clear : (H, W) bool, rows from the bottom: nothing is there. digest : of these.
    """

    clear: np.ndarray
    digest: bytes

    @staticmethod
    def of(clear: np.ndarray) -> Mask:
        """That of an array."""
        seed = repr(clear.shape).encode()
        return Mask(clear, blake2b(np.packbits(clear).tobytes(), key=seed, digest_size=8).digest())


Masks = dict[tuple, Mask | None]
"""What was read of images, by what it was read for; None: they cut out nothing."""


@dataclass(frozen=True, eq=False)
class Cutout:
    """Where a surface is not there.

    Attributes
    ----------
    uv_map : name of the map; empty: the one that renders use.
    mask : by the image. extension : what is beside it, as the Image Texture node calls it.
    to_image : (2, 3) affine, from the map to the image.
    is_smooth : between pixels alpha is interpolated.
    """

    uv_map: str
    mask: Mask
    extension: str
    to_image: np.ndarray
    is_smooth: bool

    @property
    def stamp(self) -> tuple:
        """Equal for cutouts that cut alike."""
        mapped = self.uv_map, self.mask.digest, self.extension, self.is_smooth
        return *mapped, self.to_image.tobytes()

    def clears(self, uv: np.ndarray) -> np.ndarray:
        """(K,) whether nothing is there, at places (K, 2) of the UV map."""
        height, width = self.mask.clear.shape
        mapped = uv @ self.to_image[:, :2].T + self.to_image[:, 2]
        place = mapped * (width, height) - (0.5 if self.is_smooth else 0.0)
        found = np.ones(len(uv), bool)
        for step in ((0, 0), (1, 0), (0, 1), (1, 1)) if self.is_smooth else ((0, 0),):
            column, row = (np.floor(place) + step).T
            x, is_beside_x = _extended(column, width, self.extension)
            y, is_beside_y = _extended(row, height, self.extension)
            found &= self.mask.clear[y, x] | is_beside_x | is_beside_y
        return found


def _extended(place: np.ndarray, size: int, extension: str) -> tuple[np.ndarray, np.ndarray]:
    """Pixels' whole numbers (K,) along an axis, and whether nothing is there, beside the image."""
    place = np.where(np.isfinite(place), place, 0.0)
    beside = (place < 0.0) | (place >= size)
    if extension == "REPEAT":
        place = place % size
    elif extension == "MIRROR":
        place = place % (2 * size)
        place = np.where(place >= size, 2 * size - 1 - place, place)
    place = place.clip(0, size - 1).astype(np.intp)
    return place, beside if extension == "CLIP" else np.zeros(len(place), bool)


def cutout_of(material: bpy.types.Material | None, masks: Masks) -> Cutout | None:
    """Where a material cuts its surface out; None where it does not, or in other ways.

    ``masks`` holds what was read of images before.
    """
    end = _end(material)
    found = None if end is None else _alpha(_linked(end.inputs["Surface"])[0])
    return None if found is None else _cutout(*found, masks)


def faces_of(material: bpy.types.Material | None, engine: str) -> int:
    """On which side a material's surface is there: 1 that of its normals, −1 the other, 0 both.

    It goes by *Backfacing*, in EEVEE by *Backface Culling* too.
    """
    if material is not None and engine == "BLENDER_EEVEE" and material.use_backface_culling:
        return 1
    end = _end(material)
    found = None if end is None else _alpha(_linked(end.inputs["Surface"])[0])
    node, output, steps = (None, None, None) if found is None else _source(*found)
    if node is None or node.type != "NEW_GEOMETRY" or output.name != "Backfacing":
        return 0
    front, back = _stepped(np.array((0.0, 1.0)), steps) <= MOST_ALPHA
    return int(back) - int(front)


def is_invisible(material: bpy.types.Material | None) -> bool:
    """Whether a material has no surface at all: it is fully transparent, or a volume's."""
    end = _end(material)
    if end is None:
        return False
    shader = _linked(end.inputs["Surface"])[0]
    if shader is None:
        return _linked(end.inputs["Volume"])[0] is not None
    if _is_clear(shader):
        return True
    found = _alpha(shader)
    if found is None or found[0].is_linked:
        return False
    value = float(found[0].default_value)
    return (1.0 - value if found[1] else value) <= MOST_ALPHA


def _end(material: bpy.types.Material | None) -> bpy.types.ShaderNode | None:
    """The output node of a material."""
    tree = None if material is None else material.node_tree
    return None if tree is None else tree.get_output_node("ALL")


def _alpha(
    shader: bpy.types.ShaderNode | None,
) -> tuple[bpy.types.NodeSocket, tuple[Step, ...]] | None:
    """The socket that takes a shader's alpha, and what is done to that."""
    if shader is not None and shader.type == "BSDF_PRINCIPLED":
        return shader.inputs["Alpha"], ()
    if shader is not None and shader.type == "MIX_SHADER":
        clear = [_is_clear(_linked(socket)[0]) for socket in shader.inputs[1:3]]
        if clear == [True, False]:
            return shader.inputs[0], ()
        if clear == [False, True]:
            return shader.inputs[0], (("SUBTRACT", 0, 1.0),)
    return None


def _is_clear(node: bpy.types.ShaderNode | None) -> bool:
    if node is None or node.type != "BSDF_TRANSPARENT" or node.inputs["Color"].is_linked:
        return False
    return min(node.inputs["Color"].default_value[:3]) >= 1.0


def _linked(
    socket: bpy.types.NodeSocket,
) -> tuple[bpy.types.ShaderNode | None, bpy.types.NodeSocket | None]:
    """The node that leads to a socket, past reroutes, and its output; None: none or a muted one."""
    while socket.is_linked and not socket.links[0].is_muted:
        node, output = socket.links[0].from_node, socket.links[0].from_socket
        if node.type != "REROUTE":
            return (None, None) if node.mute else (node, output)
        socket = node.inputs[0]
    return None, None


Step = tuple[str, int, float]
"""A Math node: its operation, the place of its constant, and that."""


def _cutout(socket: bpy.types.NodeSocket, steps: tuple[Step, ...], masks: Masks) -> Cutout | None:
    """That of the alpha that leads to a socket; ``steps``: what is done to it after that."""
    node, output, steps = _source(socket, steps)
    if node is None or node.type != "TEX_IMAGE" or node.projection != "FLAT":
        return None
    mapped, mask = _map_of(node.inputs["Vector"]), _mask(node.image, output.name, steps, masks)
    if mapped is None or mask is None:
        return None
    return Cutout(mapped[0], mask, node.extension, mapped[1], node.interpolation != "Closest")


def _source(
    socket: bpy.types.NodeSocket, steps: tuple[Step, ...]
) -> tuple[bpy.types.ShaderNode | None, bpy.types.NodeSocket | None, tuple[Step, ...]]:
    """The node that leads to a socket past Math nodes, its output, and all that is done to that."""
    node, output = _linked(socket)
    while node is not None and node.type == "MATH":
        linked = [n for n, value in enumerate(node.inputs) if value.enabled and value.is_linked]
        if len(linked) != 1 or linked[0] > 1 or node.operation not in _MATH:
            return None, None, ()
        constant = float(node.inputs[1 - linked[0]].default_value)
        clamp = (("MAXIMUM", 1, 0.0), ("MINIMUM", 1, 1.0)) if node.use_clamp else ()
        steps = ((node.operation, 1 - linked[0], constant), *clamp, *steps)
        node, output = _linked(node.inputs[linked[0]])
    return node, output, steps


def _stepped(value: np.ndarray, steps: tuple[Step, ...]) -> np.ndarray:
    """What Math nodes make of values."""
    for operation, place, constant in steps:
        pair = (constant, value) if place == 0 else (value, constant)
        value = _MATH[operation](*pair).astype(np.float32)
    return value


def _map_of(socket: bpy.types.NodeSocket) -> tuple[str, np.ndarray] | None:
    """The UV map that leads to an image's vector, and the affine way between them."""
    affine = np.eye(2, 3)
    if not socket.is_linked:
        return "", affine
    node, output = _linked(socket)
    if node is not None and node.type == "MAPPING":
        if node.vector_type != "POINT" or any(i.is_linked for i in node.inputs[1:]):
            return None
        moved, turned, scaled = (np.array(i.default_value) for i in node.inputs[1:4])
        if turned[:2].any():
            return None
        turn = np.array(
            ((np.cos(turned[2]), -np.sin(turned[2])), (np.sin(turned[2]), np.cos(turned[2])))
        )
        affine = np.column_stack((turn * scaled[:2], moved[:2]))
        if not node.inputs[0].is_linked:
            return None
        node, output = _linked(node.inputs[0])
    if node is None or getattr(node, "from_instancer", False):
        return None
    if node.type == "UVMAP":
        return node.uv_map, affine
    return ("", affine) if (node.type, output.name) == ("TEX_COORD", "UV") else None


def _mask(
    image: bpy.types.Image | None, output: str, steps: tuple[Step, ...], masks: Masks
) -> Mask | None:
    """Where the value is nil that an image's output and steps after it make; None: nowhere."""
    if image is None or image.source not in {"FILE", "GENERATED"}:
        return None
    width, height = image.size
    if not 0 < width * height <= MOST_PIXELS or (output == "Alpha" and image.alpha_mode == "NONE"):
        return None
    key = (image.original.session_uid, width, height, image.filepath, output, steps)
    if key not in masks:
        clear = _stepped(_values(image, output), steps) <= MOST_ALPHA
        masks[key] = Mask.of(clear) if clear.any() else None
    return masks[key]


def _values(image: bpy.types.Image, output: str) -> np.ndarray:
    """(H, W) of an image's output: its alpha, or how light its colour is."""
    width, height = image.size
    pixels = np.empty((height, width, 4), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    if output == "Alpha":
        return pixels[..., 3]
    grey = pixels[..., :3] @ LUMINANCE
    if image.is_float or image.colorspace_settings.name != "sRGB":
        return grey
    return np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)
