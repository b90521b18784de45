# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the live picture into a 3D view: the one place that uses ``gpu``.

The view's engine has drawn the direct picture; its colours (linear, before colour management) and
depths are read back and are what the displaced copies look their colour up in. The sum over light
paths goes back into the same colour buffer, so Blender's own colour management, overlays and gizmos
come on top of it as ever.
"""

from __future__ import annotations

import gpu
import numpy as np

from ..scene.read.viewpoint import Viewpoint
from . import glsl
from .eye import depth_line
from .picture import Pane, Picture, affine4, drawn, rect_matrix, weight_planes

SIDE = 2
"""Samples a side of each pixel at rest."""
HULL_SIDE = 4
HULL_LIVE_SIDE = 2
MAX_SAMPLES = 8_000_000
"""Of one glass; larger ones get one sample a pixel."""
LOOKUP_PX = 8.0
"""How far, in pixels' worth of depth, a place may lie from what the direct picture shows."""
_GRAIN = 64
"""Off-screen sizes are multiples of it, so that few are made while the eye moves."""

_shaders: dict[str, object] = {}


class Painter:
    """What one view keeps on the GPU. Only to be used, and let go, while a GPU context is there."""

    def __init__(self) -> None:
        self._direct = self._depth = None
        self._size: tuple[int, int] = (0, 0)
        self._buffers: tuple = ()
        self._offscreens: dict[str, object] = {}
        self._batches: dict[tuple, tuple] = {}
        self._weights: dict[str, tuple] = {}

    def paint(self, picture: Picture, framebuffer, overlay_backdrop) -> None:
        """Put the picture into the view.

        Parameters
        ----------
        framebuffer : the view's own: scene colours and depth. The bound one is the overlay's.
        overlay_backdrop : (4,) what the view shows where nothing is, linear; it lies in the
            overlay, is added to the scene and so has no alpha.
        """
        view = picture.view
        panes = sorted(picture.panes.values(), key=lambda p: -p.distance(view))
        panes = [p for p in panes if p.rect[0] < p.rect[2] and p.rect[1] < p.rect[3]]
        if not panes:
            return
        beyond = self._read_direct(framebuffer, view)
        if not picture.exact:
            # Faint paths are not looked at now; a guess is better than a hole.
            beyond = None
        self._drop_unused(panes)
        for pane in panes:
            self._pane(pane, view, framebuffer, beyond, overlay_backdrop, picture.exact)
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")

    def _read_direct(self, framebuffer, view: Viewpoint) -> tuple[float, ...] | None:
        """Take the direct picture over; returns what it shows where nothing is, if known."""
        width, height = view.size
        if self._size != view.size:
            self._size = view.size
            self._buffers = (
                gpu.types.Buffer("FLOAT", (height, width, 4)),
                gpu.types.Buffer("FLOAT", (height, width)),
            )
        colour, depth = self._buffers
        framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT", data=colour)
        framebuffer.read_depth(0, 0, width, height, data=depth)
        self._direct = gpu.types.GPUTexture(view.size, format="RGBA16F", data=colour)
        self._depth = gpu.types.GPUTexture(view.size, format="R32F", data=depth)
        depths = np.asarray(depth)[::8, ::8]
        # EEVEE writes none while overlays are off: what is hidden can then not be told.
        self._has_depth = bool(depths.min() < depths.max())
        far = depths >= 1.0
        if not far.any() or not self._has_depth:
            return None
        return tuple(np.asarray(colour)[::8, ::8][far].mean(axis=0).tolist())

    def _pane(self, pane: Pane, view, framebuffer, beyond, backdrop, is_sharp: bool) -> None:
        x0, y0, x1, y1 = pane.rect
        width, height = x1 - x0, y1 - y0
        side = SIDE if is_sharp and width * height * SIDE**2 <= MAX_SAMPLES else 1
        edge = HULL_SIDE if is_sharp else HULL_LIVE_SIDE
        hull = self._offscreen("hull", edge * width, edge * height, "RGBA8")
        with hull.bind():
            self._begin(edge * width, edge * height)
            self._draw_hull(pane, view, edge)
        total = self._offscreen("sum", width, height, "RGBA16F")
        with total.bind():
            self._begin(width, height)
        layer = self._offscreen("layer", side * width, side * height, "RGBA16F")
        planes = self._weight_planes(pane)
        for path, plane in zip(pane.paths, planes, strict=False):
            with layer.bind():
                self._begin(side * width, side * height)
                self._draw_copies(pane, path, view)
            with total.bind():
                gpu.state.viewport_set(0, 0, width, height)
                self._add(pane, layer.texture_color, side, plane, beyond)
        with total.bind():
            gpu.state.viewport_set(0, 0, width, height)
            rest, dark = planes[len(pane.paths) :]
            self._add(pane, layer.texture_color, 0, rest, beyond)
            self._add(pane, layer.texture_color, 0, dark, (0.0, 0.0, 0.0, 1.0))
        with framebuffer.bind():
            self._result(pane, view, hull, total, edge, 0)
            self._result(pane, view, hull, total, edge, 1)
        self._result(pane, view, hull, total, edge, 2)
        self._result(pane, view, hull, total, edge, 3, backdrop)

    @staticmethod
    def _begin(width: int, height: int) -> None:
        gpu.state.active_framebuffer_get().clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
        gpu.state.viewport_set(0, 0, width, height)
        gpu.state.blend_set("NONE")

    def _draw_hull(self, pane: Pane, view: Viewpoint, side: int) -> None:
        vertices, faces = pane.hull
        matrix = rect_matrix(view, pane.rect)
        batch = self._batch(
            ("hull", pane.glass.name),
            (pane.version, view.stamp()),
            lambda: (
                {
                    "clip": affine4(vertices, matrix),
                    "depth": view.clip(vertices)[:, 3:].astype(np.float32),
                },
                np.ascontiguousarray(faces, np.int32),
            ),
        )
        shader = _shader("hull")
        gpu.state.depth_test_set("NONE")
        shader.bind()
        self._lookup_uniforms(shader, view)
        shader.uniform_int("origin", pane.rect[:2])
        shader.uniform_int("side", [side])
        batch.draw(shader)

    def _draw_copies(self, pane: Pane, path, view: Viewpoint) -> None:
        shader = _shader("copy")
        shader.bind()
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        self._lookup_uniforms(shader, view)
        shader.uniform_sampler("direct_tx", self._direct)
        for key, shape in pane.of_path(path):

            def made(shape=shape):
                arrays = drawn(shape, view, pane.rect)
                attributes = {
                    "clip": arrays.clip,
                    "place": arrays.place,
                    "colour": arrays.colours,
                }
                return attributes, arrays.corners

            batch = self._batch(
                (pane.glass.name, *key), (shape.version, view.stamp(), pane.rect), made
            )
            if batch is not None:
                batch.draw(shader)
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)

    def _lookup_uniforms(self, shader, view: Viewpoint) -> None:
        shader.uniform_sampler("depth_tx", self._depth)
        shader.uniform_float("depth_line", depth_line(view))
        near = LOOKUP_PX / view.focal_px
        shader.uniform_float("tolerance", (0.0, near) if view.is_parallel else (near, 0.0))
        shader.uniform_int("has_depth", [int(self._has_depth)])

    def _add(self, pane: Pane, layer, side: int, plane, beyond) -> None:
        shader = _shader("sum")
        shader.bind()
        gpu.state.blend_set("ADDITIVE_PREMULT")
        shader.uniform_sampler("layer_tx", layer)
        shader.uniform_sampler("weight_tx", plane)
        shader.uniform_int("origin", pane.rect[:2])
        shader.uniform_int("side", [side])
        shader.uniform_int("grid", (*pane.regions.rect[:2], pane.step))
        shader.uniform_sampler("direct_tx", self._direct)
        shader.uniform_float("beyond", beyond or (0.0, 0.0, 0.0, 0.0))
        shader.uniform_int("is_unknown", [int(beyond is None)])
        shader.uniform_float("box", (-1.0, -1.0, 1.0, 1.0))
        self._quad().draw(shader)
        gpu.state.blend_set("NONE")

    def _result(self, pane: Pane, view, hull, total, side: int, part: int, backdrop=None) -> None:
        shader = _shader("result")
        shader.bind()
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("ADDITIVE_PREMULT" if part % 2 else "MULTIPLY")
        shader.uniform_sampler("hull_tx", hull.texture_color)
        shader.uniform_sampler("sum_tx", total.texture_color)
        shader.uniform_sampler("direct_tx", self._direct)
        shader.uniform_int("origin", pane.rect[:2])
        shader.uniform_int("side", [side])
        shader.uniform_int("part", [part])
        shader.uniform_float("backdrop", backdrop or (0.0, 0.0, 0.0, 0.0))
        size = (*view.size, *view.size)
        shader.uniform_float(
            "box", [2.0 * a / n - 1.0 for a, n in zip(pane.rect, size, strict=True)]
        )
        self._quad().draw(shader)
        gpu.state.blend_set("NONE")

    def _weight_planes(self, pane: Pane) -> list:
        """A texture a path, one of what no path brings, one of what is dark: (weight, known)."""
        known = self._weights.get(pane.glass.name)
        if known is not None and known[0] == pane.version:
            return known[1]
        textures = []
        for plane in weight_planes(pane):
            height, width, _ = plane.shape
            buffer = gpu.types.Buffer("FLOAT", plane.shape, plane)
            textures.append(gpu.types.GPUTexture((width, height), format="RG32F", data=buffer))
        self._weights[pane.glass.name] = (pane.version, textures)
        return textures

    def _offscreen(self, name: str, width: int, height: int, kind: str):
        width, height = (-(-n // _GRAIN) * _GRAIN for n in (width, height))
        found = self._offscreens.get(name)
        if found is None or (found.width, found.height) != (width, height):
            found = self._offscreens[name] = gpu.types.GPUOffScreen(width, height, format=kind)
        return found

    def _batch(self, key: tuple, stamp: tuple, made):
        """The batch of that name; from ``made()`` where the stamp differs, None if it is empty."""
        known = self._batches.get(key)
        if known is None or known[0] != stamp:
            attributes, corners = made()
            known = self._batches[key] = (stamp, _triangles(attributes, corners))
        return known[1]

    def _quad(self):
        corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
        faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
        return self._batch(("quad",), (), lambda: ({"corner": corners}, faces))

    def _drop_unused(self, panes: list[Pane]) -> None:
        wanted = {("quad",)}
        for pane in panes:
            wanted.add(("hull", pane.glass.name))
            wanted |= {(pane.glass.name, *key) for key in pane.shapes}
        self._batches = {key: value for key, value in self._batches.items() if key in wanted}
        names = {pane.glass.name for pane in panes}
        self._weights = {key: value for key, value in self._weights.items() if key in names}


def _triangles(attributes: dict[str, np.ndarray], corners: np.ndarray):
    if not len(corners):
        return None
    layout = gpu.types.GPUVertFormat()
    for name, values in attributes.items():
        layout.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
    count = len(next(iter(attributes.values())))
    vertices = gpu.types.GPUVertBuf(layout, count)
    for name, values in attributes.items():
        vertices.attr_fill(name, np.ascontiguousarray(values))
    indices = gpu.types.GPUIndexBuf(type="TRIS", seq=corners)
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=indices)


def _shader(name: str):
    """The compiled shader of that name."""
    if name not in _shaders:
        _shaders[name] = _compiled(*_DESCRIPTIONS[name])
    return _shaders[name]


_LOOKUP = [("VEC4", "depth_line"), ("VEC2", "tolerance"), ("INT", "has_depth")]
# Inputs, varyings, constants, samplers, vertex and fragment text.
_DESCRIPTIONS = {
    "copy": (
        [("VEC4", "clip"), ("VEC4", "place"), ("VEC3", "colour")],
        [("VEC4", "place_at"), ("VEC3", "own_colour")],
        _LOOKUP,
        ["direct_tx", "depth_tx"],
        glsl.COPY_VERTEX,
        glsl.COPY_FRAGMENT,
    ),
    "hull": (
        [("VEC4", "clip"), ("FLOAT", "depth")],
        [("FLOAT", "own_depth")],
        [*_LOOKUP, ("IVEC2", "origin"), ("INT", "side")],
        ["depth_tx"],
        glsl.HULL_VERTEX,
        glsl.HULL_FRAGMENT,
    ),
    "sum": (
        [("VEC2", "corner")],
        [],
        [
            ("VEC4", "box"),
            ("VEC4", "beyond"),
            ("IVEC3", "grid"),
            ("IVEC2", "origin"),
            ("INT", "side"),
            ("INT", "is_unknown"),
        ],
        ["layer_tx", "weight_tx", "direct_tx"],
        glsl.QUAD_VERTEX,
        glsl.SUM_FRAGMENT,
    ),
    "result": (
        [("VEC2", "corner")],
        [],
        [
            ("VEC4", "box"),
            ("VEC4", "backdrop"),
            ("IVEC2", "origin"),
            ("INT", "side"),
            ("INT", "part"),
        ],
        ["hull_tx", "sum_tx", "direct_tx"],
        glsl.QUAD_VERTEX,
        glsl.RESULT_FRAGMENT,
    ),
}


def _compiled(inputs, varyings, constants, samplers, vertex: str, fragment: str):
    info = gpu.types.GPUShaderCreateInfo()
    for slot, (kind, name) in enumerate(inputs):
        info.vertex_in(slot, kind, name)
    if varyings:
        stage = gpu.types.GPUStageInterfaceInfo("refractive_glass_stage")
        for kind, name in varyings:
            stage.smooth(kind, name)
        info.vertex_out(stage)
    for kind, name in constants:
        info.push_constant(kind, name)
    for slot, name in enumerate(samplers):
        info.sampler(slot, "FLOAT_2D", name)
    info.fragment_out(0, "VEC4", "frag_colour")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)
