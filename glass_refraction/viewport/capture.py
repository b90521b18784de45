# SPDX-License-Identifier: GPL-3.0-or-later
"""What a view does not show and rays from a glass may meet: the scene all round it, captured.

A capture is a cube: six square pictures, seen from a place in the glass, each with the distances of
what it shows. The view's own engine draws them off-screen, from a timer and never while a view is
drawn, one face at a time: that holds Blender up for as long as such a small picture takes. They
are drawn again when the scene changes, and stay as they are when only the eye moves.
"""

from __future__ import annotations

import time
from itertools import product

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from .description import Frame, Posed
from .eye import CAPTURES
from .paint import _quad, _shader

FACES = 6
SIDES = {"SOLID": 256, "MATERIAL": 128, "RENDERED": 128}
"""Pixels a side of a face, by the view's shading. One size each: engines compile for it."""
NEAR = 0.02
"""Of the glass's reach: what is nearer to the capture's centre is not drawn."""
FAR = 100.0
"""Least distance drawn, in reaches of the glass."""
PLACES = (0.5, 0.25, 0.75)
"""Parts of a glass's box at which a capture's centre may lie: the middle first."""

_drawing = False


def is_drawing() -> bool:
    """Whether a capture is being drawn: draw handlers are called for it too."""
    return _drawing


class Captures:
    """The captures of a view's glasses, side by side in one texture."""

    def __init__(self) -> None:
        self.centres: list[np.ndarray] = []
        self.side = 0
        self.version = 0
        self.seconds = 0.0
        self._stale: set[tuple[int, int]] = set()
        self._drawn: set[tuple[int, int]] = set()
        self._atlas = None
        self._face = None
        self._key: tuple = ()

    @property
    def texture(self):
        """The atlas; a single black pixel while there is none."""
        if self._atlas is None:
            self._atlas = gpu.types.GPUOffScreen(1, 1, format="RGBA32F")
        return self._atlas.texture_color

    @property
    def left(self) -> int:
        """Faces that are still to be drawn."""
        return len(self._stale)

    @property
    def total(self) -> int:
        return FACES * len(self.centres)

    def listed(self) -> list[tuple[np.ndarray, int]]:
        """Centre and side of each, for `eye.pack_view`; side 0 until all its faces are drawn."""
        return [
            (centre, self.side if all((k, f) in self._drawn for f in range(FACES)) else 0)
            for k, centre in enumerate(self.centres)
        ]

    def arrange(self, glasses: list[Posed], shading: tuple, boxes: list[np.ndarray]) -> None:
        """See that every glass has a capture; what has changed is drawn anew later."""
        side = SIDES.get(shading[0], SIDES["SOLID"])
        glasses = glasses[:CAPTURES]
        key = (side, len(glasses))
        if key != self._key:
            self._key, self.side = key, side
            self._drawn.clear()
            self._atlas = self._face = None
        self.centres = [centre_of(glass, boxes) for glass in glasses]

    def outdate(self) -> None:
        """The scene or its looks changed."""
        self._stale = set(product(range(len(self.centres)), range(FACES)))

    def draw(self, frame: Frame, glasses: list[Posed], view_3d: tuple) -> None:
        """Draw the next face. `view_3d`: scene, view layer, space and region that it is drawn as.

        From a timer only.
        """
        global _drawing
        number, face = min(self._stale)
        self._stale.discard((number, face))
        side, centre = self.side, self.centres[number]
        if self._face is None:
            self._face = gpu.types.GPUOffScreen(side, side, format="RGBA16F")
            self._atlas = gpu.types.GPUOffScreen(
                FACES * side, len(self.centres) * side, format="RGBA32F"
            )
        scene, layer, space, region = view_3d
        reach = glasses[number].reach()
        near, far = NEAR * reach, max(FAR * reach, space.clip_end)
        began = time.perf_counter()
        _drawing = True
        try:
            self._face.draw_view3d(
                scene,
                layer,
                space,
                region,
                Matrix(face_view(face, centre)),
                Matrix(face_projection(near, far)),
                do_color_management=False,
                draw_background=False,
            )
        finally:
            _drawing = False
        depth = gpu.types.Buffer("FLOAT", (side, side))
        with self._face.bind():
            gpu.state.active_framebuffer_get().read_depth(0, 0, side, side, data=depth)
        self._keep(number, face, depth, near / frame.unit, far / frame.unit)
        self.seconds = time.perf_counter() - began
        self._drawn.add((number, face))
        self.version += 1

    def _keep(self, number: int, face: int, depth, near: float, far: float) -> None:
        side = self.side
        shader = _shader("face")
        texture = gpu.types.GPUTexture((side, side), format="R32F", data=depth)
        width, height = FACES * side, len(self.centres) * side
        x, y = face * side, number * side
        low = 2.0 * x / width - 1.0, 2.0 * y / height - 1.0
        high = 2.0 * (x + side) / width - 1.0, 2.0 * (y + side) / height - 1.0
        with self._atlas.bind():
            gpu.state.viewport_set(0, 0, width, height)
            gpu.state.depth_test_set("NONE")
            gpu.state.blend_set("NONE")
            shader.bind()
            shader.uniform_sampler("face_tx", self._face.texture_color)
            shader.uniform_sampler("depth_tx", texture)
            shader.uniform_float("range", (near, far))
            shader.uniform_int("origin", (x, y))
            shader.uniform_int("side", side)
            shader.uniform_float("box", (*low, *high))
            _quad(shader).draw(shader)


def axes(face: int) -> np.ndarray:
    """(3, 3) rows: right, up and forward of a face's picture; the shader's ``face_of`` agrees."""
    axis, turn = face // 2, 1.0 - 2.0 * (face % 2)
    unit = np.eye(3)
    return np.stack((unit[(axis + 1) % 3], -turn * unit[(axis + 2) % 3], turn * unit[axis]))


def face_view(face: int, centre: np.ndarray) -> np.ndarray:
    """(4, 4): world to the camera of a face."""
    matrix = np.eye(4)
    matrix[:3, :3] = axes(face) * ((1.0,), (1.0,), (-1.0,))
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def face_projection(near: float, far: float) -> np.ndarray:
    """(4, 4): a square picture of 90 degrees."""
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = 1.0
    matrix[2, 2], matrix[2, 3] = (near + far) / (near - far), 2.0 * near * far / (near - far)
    matrix[3, 2] = -1.0
    return matrix


def centre_of(glass: Posed, boxes: list[np.ndarray]) -> np.ndarray:
    """(3,) the place in a glass that is farthest from all things; its middle, if that is free.

    Parameters
    ----------
    boxes : (4, 4) each: from the world to a frame in which a thing's box is the unit cube.
    """
    low, high = glass.body.box
    best, room = None, -np.inf
    for x, y, z in product(PLACES, repeat=3):
        local = low + (high - low) * (x, y, z)
        place = glass.to_world[:3, :3] @ local + glass.to_world[:3, 3]
        free = np.inf
        for box in boxes:
            inside = box[:3, :3] @ place + box[:3, 3]
            free = min(free, float(np.abs(inside - 0.5).max()) - 0.5)
        if free > 0.0 and best is None:
            return place
        if free > room:
            best, room = place, free
    return best


def unit_boxes(objects: list[bpy.types.Object], depsgraph) -> list[np.ndarray]:
    """(4, 4) each: from the world to a frame in which an object's bounding box is the unit cube."""
    found = []
    for obj in objects:
        evaluated = obj.evaluated_get(depsgraph)
        corners = np.array(evaluated.bound_box, float)
        low, high = corners.min(axis=0), corners.max(axis=0)
        size = np.maximum(high - low, 1e-9)
        to_unit = np.diag([*(1.0 / size), 1.0])
        to_unit[:3, 3] = -low / size
        matrix = np.array(evaluated.matrix_world, float)
        if np.linalg.det(matrix[:3, :3]) != 0.0:
            found.append(to_unit @ np.linalg.inv(matrix))
    return found
