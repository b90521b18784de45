# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method in a 3D view: the things' triangles drawn where they appear.

For every glass that has one image of each point along its refracted path (see :mod:`bending`) the
things are drawn once more, by a vertex shader that moves each vertex to its image. The ray shader
then takes that picture for the rays that take this path, and follows all others, as Fresnel's
equations share the light out. So the regions of the paper are exact: a pixel shows what was drawn
for the path that its own ray takes.
"""

from __future__ import annotations

from collections import Counter

import bpy
import gpu
import numpy as np

from ..scene.read.viewpoint import Viewpoint
from . import glsl, vertex_glsl
from .bending import TUBE, Bending, ByRays, bending
from .description import Frame, Posed
from .paint import DESCRIPTIONS, _uniform, compiled
from .shaders import kept
from .things import Placed, Things
from .vertex_glsl import MOST_DRAWN

EXIT, HELD = 0, 1
"""What is drawn: what is seen behind a glass, and what a hollow one holds."""


class Displaced:
    """What one view keeps of the things that it draws displaced."""

    def __init__(self) -> None:
        self.things = Things()
        self.bendings: list[Bending] = []
        self._by_rays: list[str] = []
        self._frame: Frame | None = None
        self._view: Viewpoint | None = None
        self._captures: list[int] = []
        self._looks = 0
        self._drawn: tuple = ()
        self._picture = self._depth = None
        self._slots = 0
        self._courses = None
        self._blocks: list = []

    def arrange(
        self, layer: bpy.types.ViewLayer, space: bpy.types.SpaceView3D, glasses: list[Posed]
    ) -> None:
        """The scene changed: take over what stands where."""
        self.things.arrange(layer, space, [(glass.middle(), glass.reach()) for glass in glasses])

    def look_from(
        self, view: Viewpoint, frame: Frame, glasses: list[Posed], dispersing: list[bool]
    ) -> None:
        """Find what each glass does to vertices as seen from an eye."""
        self._frame, self._view = frame, view
        self._captures = [glass.capture for glass in glasses]
        self.bendings, self._by_rays = [], []
        self._looks += 1
        for number, glass in enumerate(glasses[:MOST_DRAWN]):
            try:
                self.bendings.append(bending(number, glass, view, dispersing[number]))
            except ByRays as reason:
                self._by_rays.append(str(reason))

    def status(self) -> list[str]:
        """Lines that say which way glasses are drawn, and why."""
        lines = []
        if self.bendings:
            count, vertices = len(self.bendings), self.things.vertices
            if self.things.is_ready:
                glasses = "1 glass" if count == 1 else f"{count} glasses"
                lines.append(f"{glasses}: {vertices:,} displaced vertices")
            else:
                lines.append("Meshes go to the graphics card; rays until then")
        for reason, count in Counter(self._by_rays).items():
            lines.append(f"{count} by rays: {reason}" if count > 1 else f"By rays: {reason}")
        return lines

    @property
    def can_draw(self) -> bool:
        """Whether there is a glass to draw for, and all that is seen through it."""
        return bool(self.bendings) and self.things.is_ready

    def draw(self, painter, jitter: tuple[float, float], captures: tuple) -> None:
        """Draw what each glass shows, for the sample that comes next, unless it is drawn.

        Parameters
        ----------
        painter : `paint.Painter`, for what the view shows and how fine its picture is.
        jitter, captures : as of its `sample`, see there.
        """
        size, divisor = painter.grid
        key = (self._looks, self.things.version, size, tuple(jitter), divisor)
        if key == self._drawn:
            return
        self._prepare(size)
        self._blocks = []
        raster = _raster(self._view.size, size, jitter, divisor)
        for slot, one in enumerate(self.bendings):
            # Made anew: views and timers draw in contexts of their own, which share textures only.
            target = gpu.types.GPUFrameBuffer(
                depth_slot=self._depth, color_slots=[{"texture": self._picture, "layer": slot}]
            )
            # Kept: a buffer that nobody holds is gone before it is read.
            block = _uniform(one.block(self._view, self._frame, raster))
            self._blocks.append(block)
            with target.bind():
                target.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
                gpu.state.viewport_set(0, 0, *size)
                gpu.state.blend_set("NONE")
                gpu.state.face_culling_set("NONE")
                gpu.state.depth_test_set("LESS_EQUAL")
                gpu.state.depth_mask_set(True)
                shader = things_shader(one.kind)
                shader.bind()
                shader.uniform_block("bend", block)
                self._bind_view(shader, painter, captures, self._captures[one.number])
                for part in (EXIT, HELD) if one.held else (EXIT,):
                    shader.uniform_int("held", part)
                    for thing in self.things.placed:
                        draw_thing(shader, thing, one, part)
                gpu.state.depth_test_set("NONE")
                gpu.state.depth_mask_set(False)
                # The vertices' time is not to be taken for that of the sample's pixels.
                target.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
        self._drawn = key

    @property
    def shader(self):
        """The ray shader that takes what was drawn."""
        return picture_shader()

    def bind(self, shader) -> None:
        """Give the ray shader what was drawn."""
        shader.uniform_sampler("drawn_tx", self._picture)
        shader.uniform_block("drawn", self._courses)

    def _bind_view(self, shader, painter, captures: tuple, capture: int) -> None:
        shader.uniform_block("view", painter.view_block)
        shader.uniform_sampler("direct_tx", painter.direct.colour)
        shader.uniform_sampler("depth_tx", painter.direct.depth)
        shader.uniform_sampler("capture_tx", captures[0])
        shader.uniform_sampler("reach_tx", captures[1])
        shader.uniform_int("has_depth", int(painter.direct.has_depth))
        shader.uniform_int("slot", capture)

    def _prepare(self, size: tuple[int, int]) -> None:
        """Make the textures and the table of courses for the glasses as they are."""
        count = len(self.bendings)
        known = self._picture
        if known is None or (known.width, known.height, self._slots) != (*size, count):
            self._picture = gpu.types.GPUTexture(size, layers=count, format="RGBA16F")
            self._depth = gpu.types.GPUTexture(size, format="DEPTH_COMPONENT32F")
            self._slots = count
        table = np.zeros((MOST_DRAWN, 4), np.int32)
        table[:, 2] = -1
        for slot, one in enumerate(self.bendings):
            table[one.number, :3] = one.course, one.held, slot
        self._courses = gpu.types.GPUUniformBuf(
            gpu.types.Buffer("INT", table.size, np.ascontiguousarray(table.ravel()))
        )


def draw_thing(shader, thing: Placed, one: Bending, part: int) -> None:
    """Draw a thing's triangles, unless none of it can be what is drawn."""
    mesh = thing.mesh
    place = one.from_world @ thing.to_world
    if part == HELD and not _may_be_held(place, mesh, one):
        return
    shader.uniform_float("place", place.T.ravel().tolist())
    shader.uniform_float("base", thing.colour)
    for batch, may_be_held in mesh.batches:
        if may_be_held or part == EXIT:
            batch.draw(shader)


def _may_be_held(place: np.ndarray, mesh, one: Bending) -> bool:
    """Whether a hollow glass may hold a part of a mesh."""
    middle = place[:3, :3] @ mesh.middle + place[:3, 3]
    axes = 2 if one.kind == TUBE else 3
    stretch = float(np.linalg.norm(place[:3, :3], ord=2))
    return float(np.linalg.norm(middle[:axes])) - stretch * mesh.radius < one.inner


def _raster(view: tuple[int, int], size: tuple[int, int], jitter, divisor: float) -> np.ndarray:
    """(4, 4) from the view's clip space to a picture's of which a sample is some pixels wide."""
    matrix = np.eye(4)
    for axis in range(2):
        part = view[axis] / (divisor * size[axis])
        matrix[axis, axis] = part
        matrix[axis, 3] = part - 1.0 - 2.0 * jitter[axis] / size[axis]
    return matrix


def picture_shader():
    """The ray shader that takes what was drawn displaced."""
    if "displaced" not in kept:
        known = DESCRIPTIONS["picture"] | {"fragment": vertex_glsl.PICTURE}
        kept["displaced"] = compiled(**known, drawn=vertex_glsl.BLOCKS)
    return kept["displaced"]


def things_shader(kind: int, vertex: str = vertex_glsl.VERTEX):
    """The shader of things behind a glass of a kind, by default drawn where they appear."""
    if (kind, vertex) not in kept:
        info = gpu.types.GPUShaderCreateInfo()
        face = gpu.types.GPUStageInterfaceInfo(f"displaced_{kind}")
        face.smooth("VEC3", "at")
        face.smooth("FLOAT", "miss")
        info.define("KIND", str(kind))
        info.push_constant("MAT4", "place")
        info.push_constant("VEC4", "base")
        info.push_constant("INT", "held")
        info.push_constant("INT", "slot")
        info.push_constant("INT", "has_depth")
        info.typedef_source(glsl.BLOCKS + vertex_glsl.BLOCKS)
        info.uniform_buf(0, "Bend", "bend")
        info.uniform_buf(1, "View", "view")
        for number, name in enumerate(("direct_tx", "depth_tx", "capture_tx", "reach_tx")):
            info.sampler(number, "FLOAT_2D", name)
        info.vertex_in(0, "VEC3", "pos")
        info.vertex_out(face)
        info.fragment_out(0, "VEC4", "frag")
        info.vertex_source(vertex)
        info.fragment_source(vertex_glsl.COLOUR)
        kept[kind, vertex] = gpu.shader.create_from_info(info)
    return kept[kind, vertex]
