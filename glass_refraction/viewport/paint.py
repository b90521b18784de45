# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the live picture into a 3D view.

The view's engine has drawn the direct picture, without the glasses; its colours (linear, before
colour management) and depths are read back and are what rays that leave a glass are looked up in.
The picture goes into the same colour buffer, so Blender's own colour management, overlays and
gizmos come on top of it as ever.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import gpu
import numpy as np

from ..scene.read.viewpoint import Viewpoint
from . import glsl
from .description import Frame, Posed, trees_of
from .eye import common_line, least_depth, pack_view, pixel_width
from .lamps import Lamps
from .shaders import kept
from .trees import ROW_BITS, Tree
from .wires import Wires

TILE = 8
"""Pixels a side of the tiles whose nearest and farthest depths rays are held against first."""

GLANCED = 11
"""Rows of a view, and columns, by which is told whether its picture changed."""

WHOLE = (-1.0, -1.0, 1.0, 1.0)
"""The box of a target that is filled from corner to corner."""


@dataclass(frozen=True)
class Way:
    """How rays are followed: the least part of the light, the most ways, whether they split.

    backdrop : what is seen where nothing is, see `Painter.show`. is_open : the engine leaves
        that to the overlay, so that it is known in every direction.
    """

    least: float
    most: int
    splits: bool
    backdrop: tuple[float, float, float, float]
    is_open: bool


class Direct:
    """What a view shows without the glasses, on the GPU.

    Attributes
    ----------
    colour, tiles : textures; wire_depth : see `wires.Wires.draw`. raw, depth : of the depth
        buffer's values, and of what they mean in units of the common frame, see `glsl.DEPTH` and
        `glsl.STEPS`; line : the numbers (a, b, c, d) between both. least : see `eye.least_depth`.
    has_depth : EEVEE writes none while overlays are off.
    stamp : a part of the pixels, to tell whether anything changed. lines : those that were glanced
        at last. python_seconds : of the last reading, what was Python's and NumPy's part.
    """

    def __init__(self) -> None:
        self.size = (0, 0)
        self.wires, self.wire_depth = Wires(), None
        self.colour = self.raw = self.depth = self.tiles = None
        self.line, self.least = (0.0, 1.0, 1.0, 0.0), 1.0
        self.has_depth = False
        self.stamp: np.ndarray | None = None
        self.lines: np.ndarray | None = None
        self.python_seconds = 0.0
        self._buffers: tuple = ()
        self._plain = self._to_depth = self._to_tiles = None
        self._stepped = self._to_stepped = None
        self._depths: np.ndarray | None = None

    def read(
        self, framebuffer, view: Viewpoint, frame: Frame, amended: bool, nearer: float
    ) -> bool:
        """Take the view's picture over; whether it differs from the last one.

        ``amended``: its depths are as EEVEE writes them, see `glsl.AMENDED`. ``nearer``: see
        `eye.overlay_nearer`.
        """
        width, height = view.size
        if self.size != view.size:
            self.size = view.size
            self._buffers = (
                gpu.types.Buffer("FLOAT", (height, width, 4)),
                gpu.types.Buffer("FLOAT", (height, width)),
            )
            self._plain, self._to_depth = _target(view.size, "RG32F")
            self._stepped, self._to_stepped = _target(view.size, "RG32F")
            self._depths = None
            # Four channels: two of them cannot be read back everywhere.
            self.tiles, self._to_tiles = _target(tuple(-(-n // TILE) for n in view.size), "RGBA32F")
        colour, depth = self._buffers
        framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT", data=colour)
        framebuffer.read_depth(0, 0, width, height, data=depth)
        # As wide as it was read: to convert it to half floats takes longer than all the rest.
        self.colour = gpu.types.GPUTexture(view.size, format="RGBA32F", data=colour)
        self.raw = gpu.types.GPUTexture(view.size, format="R32F", data=depth)
        self.line, self.least = common_line(view, frame), least_depth(view, frame)
        self.wire_depth = self.wires.draw(view.projection @ view.to_camera, view.size, nearer)
        self._take_depths(self._to_depth, amended)
        columns, rows = self.tiles.width, self.tiles.height
        self._take_tiles(self._to_tiles, (columns, rows))
        with self._to_tiles.bind():
            read = self._to_tiles.read_color(0, 0, columns, rows, 4, 0, "FLOAT")
        began = time.thread_time()
        tiles = np.asarray(read).reshape(rows, columns, 4)
        self.has_depth = bool(tiles[..., 0].min() < tiles[..., 1].max())
        if self._depths is None or not np.array_equal(tiles[..., :2], self._depths):
            self._depths, self.depth = tiles[..., :2].copy(), self._plain
        stamp = np.concatenate((np.asarray(colour)[::TILE, ::TILE].ravel(), tiles[..., 0].ravel()))
        same = self.stamp is not None and np.array_equal(stamp, self.stamp)
        self.stamp = stamp
        self.python_seconds = time.thread_time() - began
        return not same

    def glance(self, framebuffer, size: tuple[int, int]) -> bool:
        """Whether some rows and columns of the view's picture differ from those glanced at last.

        Much quicker than to read it all: enough while an engine only refines what it shows.
        """
        width, height = size
        strips = [(0, y, width, 1) for y in _between(height)]
        strips += [(x, 0, 1, height) for x in _between(width)]
        read = [framebuffer.read_color(*strip, 4, 0, "FLOAT") for strip in strips]
        lines = np.concatenate([np.asarray(one).ravel() for one in read])
        same = self.lines is not None and np.array_equal(lines, self.lines)
        self.lines = lines
        return not same

    def is_same(self, framebuffer) -> bool:
        """Whether the view's picture is as it was read last: some rows of colours and all depths.

        Much quicker than to read it all, of a still scene that is drawn for another reason. Lines
        of overlays change depths alone.
        """
        colour, depth = (np.asarray(buffer) for buffer in self._buffers)
        width, height = self.size
        read = framebuffer.read_depth(0, 0, width, height)
        return np.array_equal(np.asarray(read).reshape(height, width), depth) and all(
            np.array_equal(
                np.asarray(framebuffer.read_color(0, y, width, 1, 4, 0, "FLOAT")).ravel(),
                colour[y].ravel(),
            )
            for y in range(0, height, TILE)
        )

    def find_steps(self, view: Viewpoint, frame: Frame) -> None:
        """See that the depths tell where things end in front of others: edges get smooth by it."""
        if self.depth is not self._stepped:
            self._mark_steps(pixel_width(view, frame))

    def _mark_steps(self, width: tuple[float, float]) -> None:
        with filling(self._to_stepped, self.size, _shader("steps")) as shader:
            shader.uniform_sampler("depth_tx", self._plain)
            shader.uniform_float("width", width)
        self.depth = self._stepped

    def _take_depths(self, target, amended: bool) -> None:
        """Fill a texture by what the depth buffer's values mean."""
        with filling(target, self.size, _shader("depth")) as shader:
            shader.uniform_sampler("raw_tx", self.raw)
            shader.uniform_sampler("wire_tx", self.wire_depth)
            shader.uniform_float("line", self.line)
            shader.uniform_float("least", self.least)
            shader.uniform_int("amended", int(amended))

    def _take_tiles(self, target, size: tuple[int, int]) -> None:
        """Fill a texture by the depths of tiles."""
        with filling(target, size, _shader("tiles")) as shader:
            shader.uniform_sampler("depth_tx", self._plain)


@contextmanager
def filling(
    target, size: tuple[int, int], shader, boxes: Sequence[tuple] = (WHOLE,), blend: str = "NONE"
) -> Iterator:
    """Have a shader, which is to be given its other uniforms, draw boxes into a target."""
    with target.bind():
        gpu.state.viewport_set(0, 0, *size)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set(blend)
        shader.bind()
        yield shader
        for box in boxes:
            shader.uniform_float("box", box)
            _quad().draw(shader)
        gpu.state.blend_set("NONE")


def _between(size: int) -> list[int]:
    """Places evenly between 0 and ``size``."""
    count = min(GLANCED, size)
    return [(2 * k + 1) * size // (2 * count) for k in range(count)]


def _target(size: tuple[int, int], *formats: str) -> tuple:
    """Textures of a size, and a framebuffer that draws into them."""
    textures = [gpu.types.GPUTexture(size, format=kind) for kind in formats]
    return (*textures, gpu.types.GPUFrameBuffer(color_slots=textures))


def odd_size(size: int) -> int:
    """A size not smaller and no power of two: some drivers compile shaders for each kind anew."""
    size = max(size, 3)
    return size + (size & (size - 1) == 0)


def _texture(values: np.ndarray, kind: str):
    """A texture of (height, width) or (height, width, channels) float32 values."""
    height, width = values.shape[:2]
    data = gpu.types.Buffer("FLOAT", values.shape, values)
    return gpu.types.GPUTexture((width, height), format=kind, data=data)


class _Layer:
    """Samples of a picture, added up, and how many each pixel has.

    Of a layer that has some pixels only, side by side, `listed` tells which pixel each is, and
    `places` where each of the view's pixels is (-1: not here); else both are None.
    """

    def __init__(self) -> None:
        self.listed = self.places = None
        self.size = (0, 0)
        self.divisor = 1.0
        self.samples = 0
        self.colour = self.cover = self.target = None

    def clear(self, size: tuple[int, int], divisor: float) -> None:
        if self.size != size:
            self.size = size
            self.colour, self.cover, self.target = _target(size, "RGBA16F", "RGBA16F")
        self.divisor, self.samples = divisor, 0
        self.listed = self.places = None
        with self.target.bind():
            self.target.clear(color=(0.0, 0.0, 0.0, 0.0))


BLOCK, LISTED = 4, 1000
"""Pixels a side of blocks, and width of a layer, of listed pixels: they are drawn side by side, so
that none is drawn in vain."""
ENOUGH = 0.7
"""Of a strip's pixels: if that many are wanted it is drawn whole."""
LAYERS = 4
"""That a view has: one of what moves; two of pictures at rest, of which one is shown while the
other is drawn; and one of some pixels' further samples."""
SPREAD = 0.05
"""Of samples from their pixel's mean, see `glsl.MAIN`: those that lie farther off need more."""


class Painter:
    """What one view keeps on the GPU. Only to be used, and let go, while a GPU context is there."""

    def __init__(self) -> None:
        self.direct = Direct()
        self._layers = [_Layer() for _ in range(LAYERS)]
        self._listed = np.zeros((2, 0), np.intp)
        self._of = self._layers[0]
        """The layer to which further samples are added, and its pixels (x, y) that get them."""
        self._marks: tuple | None = None
        # Of the kinds that they stand for: some drivers compile a shader for each kind anew.
        self._no_list = _texture(np.zeros((3, 3, 4), np.float32), "RGBA32F")
        self._no_layer = _texture(np.zeros((3, 3, 4), np.float32), "RGBA16F")
        self._used: _Layer | None = None
        self._drawn = self._layers[0]
        self._blocks: list[tuple] = []
        self._mesh = None
        self._trees: tuple[Tree, ...] = ()
        self.view_block = None
        self._view: Viewpoint | None = None
        self._rects: list[tuple[float, float, float, float]] = []
        self._strips: list[tuple[float, float, float, float]] = []

    def describe(
        self,
        blocks: list[np.ndarray],
        view: Viewpoint,
        frame: Frame,
        glasses: list[Posed],
        clear: list[np.ndarray],
        captures: list[tuple[np.ndarray, int, np.ndarray | None]],
        seconds: int,
        scene_reach: float,
        lamps: Lamps,
    ) -> None:
        """Hand the glasses' block (see :mod:`description`) and the view to the shader.

        Parameters
        ----------
        blocks : one, and if a glass disperses one each for red, green and blue light.
        clear : (8, 3) corners of each box in which only lines are to be hidden.
        captures, seconds, scene_reach, lamps : see `eye.pack_view`.
        """
        same = len(blocks) == len(self._blocks) and all(
            known[0] is block for known, block in zip(self._blocks, blocks, strict=True)
        )
        if not same:
            self._blocks = [(block, _uniform(block)) for block in blocks]
        trees = trees_of(glasses)
        if trees != self._trees:
            self._trees = trees
            self._mesh = mesh_texture(trees) if trees else None
        self.view_block = _uniform(
            pack_view(
                view, frame, captures, seconds, scene_reach, lamps.packed(frame), lamps.limits
            )
        )
        self._view = view
        self._rects = merged(
            [screen_rect(corners, view) for corners in (*(g.corners() for g in glasses), *clear)]
        )

    @staticmethod
    def compile(glasses: list[Posed]) -> bool:
        """Compile the shader that shows glasses, if it is not yet there; whether it was not."""
        name = _picture(bool(trees_of(glasses)))
        is_new = name not in kept
        _shader(name)
        return is_new

    @property
    def pixels(self) -> int:
        """Of the view, that can show a glass."""
        width, height = self._view.size
        area = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in self._rects)
        return int(0.25 * area * width * height)

    @property
    def colours(self) -> int:
        """Of light that are followed each on its own."""
        return max(1, len(self._blocks) - 1)

    @property
    def is_whole(self) -> bool:
        """Whether no sample is half drawn."""
        return not self._strips

    def begin(self, divisor: float, number: int) -> None:
        """Start a layer anew, with a sample for ``divisor``² pixels of the view.

        What is shown stays what it was until `use` says so.
        """
        layer = self._layers[number]
        width, height = (math.ceil(pixels / divisor) for pixels in self._view.size)
        layer.clear(
            (width, height) if divisor == 1.0 else (odd_size(width), odd_size(height)), divisor
        )
        self._drawn, self._strips = layer, []

    def begin_edges(self, number: int, of: int) -> int:
        """Start a layer anew that has the pixels at edges of another one, a whole first sample.

        Returns
        -------
        int
            How many they are.
        """
        self._of = first = self._layers[of]
        width, height = first.size
        if self._marks is None or (self._marks[0].width, self._marks[0].height) != first.size:
            self._marks = _target(first.size, "R32F")
        target = self._marks[1]
        with filling(target, first.size, _shader("edges"), self._rects) as shader:
            target.clear(color=(0.0, 0.0, 0.0, 0.0))
            shader.uniform_sampler("first_tx", first.colour)
        with target.bind():
            marks = np.asarray(target.read_color(0, 0, width, height, 1, 0, "FLOAT"))
        y, x = np.nonzero(marks.reshape(height, width) > 0.0)
        # Neighbours stay neighbours: drivers draw blocks of pixels at once.
        order = np.argsort((y // BLOCK * width + x // BLOCK) * BLOCK**2, kind="stable")
        return self._list(number, x[order], y[order])

    def begin_spread(self, number: int) -> int:
        """Start a layer of some pixels anew, with those whose samples differ too much.

        Returns
        -------
        int
            How many they are.
        """
        layer = self._layers[number]
        width, height = layer.size
        with layer.target.bind():
            cover = np.asarray(layer.target.read_color(0, 0, width, height, 4, 1, "FLOAT"))
        column, row = _in_list(self._listed.shape[1])
        cover = cover.reshape(height, width, 4)[row, column]
        spread = cover[:, 2] > SPREAD**2 * cover[:, 1]
        return self._list(number, *self._listed[:, spread])

    def _list(self, number: int, x: np.ndarray, y: np.ndarray) -> int:
        """Start a layer anew that has some pixels only."""
        layer = self._layers[number]
        width, height = self._of.size
        column, row = _in_list(len(x))
        rows = odd_size(int(row.max(initial=0)) + 1)
        layer.clear((LISTED, rows), 1.0)
        listed = np.full((rows, LISTED, 4), -1.0, np.float32)
        listed[row, column, 0], listed[row, column, 1] = x, y
        places = np.full((height, width), -1.0, np.float32)
        places[y, x] = row * LISTED + column
        layer.listed = _texture(listed, "RGBA32F")
        layer.places = _texture(places, "R32F")
        self._listed = np.stack((x, y))
        self._drawn, self._strips = layer, []
        return len(x)

    def use(self, number: int) -> None:
        """Show a layer from now on."""
        self._used = self._layers[number]

    def add(self, number: int) -> None:
        """Add the samples of a layer that has some pixels only to the one that it was made of."""
        other, one = self._layers[number], self._of
        drawing = filling(one.target, one.size, _shader("sum"), self._rects, "ADDITIVE_PREMULT")
        with drawing as shader:
            shader.uniform_sampler("more_color_tx", other.colour)
            shader.uniform_sampler("more_cover_tx", other.cover)
            shader.uniform_sampler("place_tx", other.places)

    @property
    def divisor(self) -> float:
        """Pixels a side for a sample of what is shown; 0 before there is any."""
        return self._used.divisor if self._used else 0.0

    @property
    def has_meshes(self) -> bool:
        """Whether a glass is a mesh."""
        return self._mesh is not None

    @property
    def grid(self) -> tuple[tuple[int, int], float]:
        """Size in samples of the picture that is drawn now, or of which some pixels are, and pixels
        a side for each.
        """
        drawn = self._drawn if self._drawn.listed is None else self._of
        return drawn.size, drawn.divisor

    @property
    def samples(self) -> int:
        """Samples that the layer has which is drawn now."""
        return self._drawn.samples

    def sample(
        self,
        number: int,
        jitter: tuple[float, float],
        way: Way,
        captures: tuple,
        pixels: int | None = None,
        each_colour: bool = True,
        displaced=None,
    ) -> int:
        """Draw one sample a pixel, ``jitter`` pixels (of the sample's size) off its middle.

        Parameters
        ----------
        number : of the sample, among those of a pixel.
        captures : the textures of all captures, see `capture.Captures.textures`.
        pixels : about how many to draw now; the next call goes on. None: all.
        each_colour : follow red, green and blue light each on its own, if that differs.
        displaced : `displaced.Displaced`, if it drew what is refracted only.

        Returns
        -------
        int
            About how many were drawn.
        """
        if not self._strips:
            is_listed = self._drawn.listed is not None
            self._strips = [WHOLE] if is_listed else [self._in_layer(r) for r in self._rects]
        if pixels is None:
            strips, self._strips = self._strips, []
        else:
            strips = [self._take(pixels)]
        layer = self._drawn
        if displaced is not None:
            shader = displaced.shader
        else:
            shader = _shader(_picture(self.has_meshes))
        with layer.target.bind():
            gpu.state.viewport_set(0, 0, *layer.size)
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
            gpu.state.blend_set("ADDITIVE_PREMULT")
            shader.bind()
            shader.uniform_block("view", self.view_block)
            if self.has_meshes:
                shader.uniform_sampler("mesh_tx", self._mesh)
            shader.uniform_sampler("direct_tx", self.direct.colour)
            shader.uniform_sampler("depth_tx", self.direct.depth)
            shader.uniform_sampler("tile_tx", self.direct.tiles)
            shader.uniform_sampler("capture_tx", captures[0])
            shader.uniform_sampler("reach_tx", captures[1])
            shader.uniform_float("jitter", (*jitter, layer.divisor, float(number)))
            is_listed = layer.listed is not None
            shader.uniform_sampler("list_tx", layer.listed if is_listed else self._no_list)
            shader.uniform_sampler("known_tx", self._of.colour if is_listed else self._no_layer)
            shader.uniform_sampler("counted_tx", self._of.cover if is_listed else self._no_layer)
            shader.uniform_int("is_listed", int(is_listed))
            shader.uniform_float("least", way.least)
            shader.uniform_int("most", way.most)
            shader.uniform_float("backdrop", (*way.backdrop[:3], float(way.is_open)))
            shader.uniform_int("splits", int(way.splits))
            shader.uniform_int("has_depth", int(self.direct.has_depth))
            if displaced is not None:
                displaced.bind(shader)
            for uniform, band in self._passes(each_colour):
                shader.uniform_block("glasses", uniform)
                shader.uniform_float("band", band)
                for rect in strips:
                    shader.uniform_float("box", rect)
                    _quad().draw(shader)
            gpu.state.blend_set("NONE")
        if not self._strips:
            layer.samples += 1
        return int(sum(self._area(rect) for rect in strips))

    def _passes(self, each_colour: bool) -> list[tuple]:
        """Glasses' blocks, and which colours and which part of a sample is drawn with each."""
        if not each_colour or self.colours == 1:
            return [(self._blocks[0][1], (1.0, 1.0, 1.0, 1.0))]
        uniforms = [uniform for _, uniform in self._blocks[1:]]
        share = 1.0 / len(uniforms)
        bands = zip(uniforms, np.eye(3).tolist(), strict=True)
        passes = [(uniform, (*row, share)) for uniform, row in bands]
        # A further sample of some pixels is of one colour, in turn.
        return passes if self._drawn.listed is None else [passes[self._drawn.samples % len(passes)]]

    def _in_layer(self, rect) -> tuple[float, float, float, float]:
        """A part of the view as one of the layer that is drawn, whose samples may reach farther."""
        if self._drawn.divisor == 1.0:
            return rect
        # And a sample more on each side, to smooth over.
        sample = 2.0 / np.array(self._drawn.size)
        part = 0.5 * sample * self._view.size / self._drawn.divisor
        low = (np.array(rect[:2]) + 1.0) * part - 1.0 - sample
        high = (np.array(rect[2:]) + 1.0) * part - 1.0 + sample
        return (*np.maximum(low, -1.0).tolist(), *np.minimum(high, 1.0).tolist())

    def _area(self, rect) -> float:
        """Samples of a rectangle."""
        x0, y0, x1, y1 = rect
        return 0.25 * (x1 - x0) * (y1 - y0) * self._drawn.size[0] * self._drawn.size[1]

    def _take(self, pixels: int) -> tuple[float, float, float, float]:
        """The next strip of about so many pixels of what is still to be drawn.

        It ends between two blocks: drivers take as long for a part of one as for all of it.
        """
        rect = self._strips.pop(0)
        for axis in (1, 0):
            share = pixels / max(self._area(rect), 1.0)
            if share > ENOUGH:
                break
            size = self._drawn.size[axis]
            begin, end = (0.5 * (rect[axis + side] + 1.0) * size / BLOCK for side in (0, 2))
            blocks = max(round(begin + share * (end - begin)), math.floor(begin + 0.5) + 1)
            if blocks < end:
                # Each sample is drawn once.
                middle = 2.0 * blocks * BLOCK / size - 1.0
                self._strips.insert(0, (*rect[:axis], middle, *rect[axis + 1 :]))
                rect = (*rect[: axis + 2], middle, *rect[axis + 3 :])
        return rect

    def wait(self) -> float:
        """Seconds until the GPU has done what was asked of it."""
        began = time.perf_counter()
        with self._drawn.target.bind():
            self._drawn.target.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
        return time.perf_counter() - began

    def show(
        self, framebuffer, backdrop: tuple[float, float, float, float], lines: bool = True
    ) -> None:
        """Put the picture into the view.

        Parameters
        ----------
        framebuffer : the view's own: scene colours and depth. The bound one is the overlay's.
        backdrop : what the view shows where nothing is, linear, without an alpha. The engine leaves
            it to the overlay, which is added to the scene.
        lines : leave the lines in the overlay that the glasses' meshes are drawn by.
        """
        lines = lines or not self.direct.has_depth
        with framebuffer.bind():
            self._result(0, backdrop, lines)
            self._result(1, backdrop, lines)
        self._result(2, backdrop, lines)
        self._result(3, backdrop, lines)
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.blend_set("NONE")

    def _result(self, part: int, backdrop, lines: bool) -> None:
        shader = _shader("result")
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("ADDITIVE_PREMULT" if part % 2 else "MULTIPLY")
        shader.bind()
        shader.uniform_sampler("color_tx", self._used.colour)
        shader.uniform_sampler("cover_tx", self._used.cover)
        shader.uniform_sampler("direct_tx", self.direct.colour)
        shader.uniform_sampler("raw_tx", self.direct.raw)
        shader.uniform_sampler("wire_tx", self.direct.wire_depth)
        shader.uniform_float("line", self.direct.line)
        shader.uniform_float("least", self.direct.least)
        shader.uniform_int("lines", int(lines))
        shader.uniform_int("part", part)
        shader.uniform_float("backdrop", backdrop)
        shader.uniform_float("divisor", self.divisor)
        for rect in self._rects:
            shader.uniform_float("box", rect)
            _quad().draw(shader)
        gpu.state.blend_set("NONE")


def _in_list(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (count,) of the first pixels of a layer of listed ones, block by block."""
    block, within = np.divmod(np.arange(count), BLOCK**2)
    by_row = LISTED // BLOCK
    column = block % by_row * BLOCK + within % BLOCK
    return column, block // by_row * BLOCK + within // BLOCK


def screen_rect(corners: np.ndarray, view: Viewpoint) -> tuple[float, float, float, float] | None:
    """The part of the view, -1 to 1 in x and y, that can show a glass; None if there is none.

    ``corners``: (8, 3) of the glass's box, in the world.
    """
    clip = np.column_stack((corners, np.ones(8))) @ (view.projection @ view.to_camera).T
    if not view.is_parallel:
        ahead = clip[:, 3] > 0.0
        if not ahead.any():
            return None
        if not ahead.all():
            return (-1.0, -1.0, 1.0, 1.0)
    places = clip[:, :2] / clip[:, 3:]
    # A pixel more on each side: where samples are shifted, edges are smoothed.
    pixel = 4.0 / np.array(view.size)
    x0, y0 = np.clip(places.min(axis=0) - pixel, -1.0, 1.0)
    x1, y1 = np.clip(places.max(axis=0) + pixel, -1.0, 1.0)
    return (float(x0), float(y0), float(x1), float(y1)) if x0 < x1 and y0 < y1 else None


def merged(rects: list) -> list[tuple[float, float, float, float]]:
    """Rectangles (x0, y0, x1, y1) that cover the same and more, of which no two overlap."""
    found: list[tuple[float, float, float, float]] = []
    for rect in rects:
        if rect is None:
            continue
        while True:
            meets = [r for r in found if _overlap(r, rect)]
            if not meets:
                break
            found = [r for r in found if r not in meets]
            sides = np.array([rect, *meets])
            rect = (*sides[:, :2].min(axis=0).tolist(), *sides[:, 2:].max(axis=0).tolist())
        found.append(rect)
    return found


def _overlap(a, b) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def mesh_texture(trees: Sequence[Tree]):
    """The texels of trees, one after the other, as a texture."""
    width = 1 << ROW_BITS
    count = sum(len(tree.texels) for tree in trees)
    rows = odd_size(-(-count // width))
    filled = np.zeros((rows * width, 4), np.float32)
    np.concatenate([tree.texels for tree in trees], out=filled[:count])
    return _texture(filled.reshape(rows, width, 4), "RGBA32F")


def _uniform(block: np.ndarray):
    block = np.ascontiguousarray(block, np.float32).ravel()
    return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", len(block), block))


def _quad():
    if "quad" not in kept:
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id="corner", comp_type="F32", len=2, fetch_mode="FLOAT")
        corners = gpu.types.GPUVertBuf(layout, 4)
        corners.attr_fill("corner", np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32))
        kept["quad"] = gpu.types.GPUBatch(type="TRI_STRIP", buf=corners)
    return kept["quad"]


def _shader(name: str):
    """The compiled shader of that name."""
    if name not in kept:
        plain = name.removesuffix(OF_MESHES)
        kept[name] = compiled(**DESCRIPTIONS[plain], meshes=plain != name)
    return kept[name]


def _picture(meshes: bool) -> str:
    """Name of the shader that follows rays, of glasses of which some are meshes or none is."""
    return "picture" + OF_MESHES * meshes


OF_MESHES = "_of_meshes"
"""Ends the name of a shader that knows glasses that are meshes: others are quicker without."""

DESCRIPTIONS = {
    "picture": {
        "constants": [
            ("VEC4", "jitter"),
            ("VEC4", "band"),
            ("VEC4", "box"),
            ("VEC4", "backdrop"),
            ("FLOAT", "least"),
            ("INT", "most"),
            ("INT", "splits"),
            ("INT", "has_depth"),
            ("INT", "is_listed"),
        ],
        "samplers": [
            *("direct_tx", "depth_tx", "tile_tx", "capture_tx", "reach_tx"),
            *("list_tx", "known_tx", "counted_tx"),
        ],
        "glasses": True,
        "view": True,
        "outputs": ["color", "cover"],
        "fragment": glsl.PICTURE,
    },
    "between": {
        "constants": [
            ("VEC4", "box"),
            ("VEC4", "backdrop"),
            ("FLOAT", "parts"),
            ("INT", "has_depth"),
        ],
        "samplers": ["direct_tx", "depth_tx", "tile_tx", "capture_tx", "reach_tx"],
        "glasses": True,
        "view": True,
        "outputs": ["frag"],
        "fragment": glsl.BETWEEN,
    },
    "result": {
        "constants": [
            ("VEC4", "box"),
            ("VEC4", "backdrop"),
            ("INT", "part"),
            ("VEC4", "line"),
            ("FLOAT", "least"),
            ("INT", "lines"),
            ("FLOAT", "divisor"),
        ],
        "samplers": ["color_tx", "cover_tx", "direct_tx", "raw_tx", "wire_tx"],
        "outputs": ["frag"],
        "fragment": glsl.RESULT,
    },
    "sum": {
        "constants": [("VEC4", "box")],
        "samplers": ["more_color_tx", "more_cover_tx", "place_tx"],
        "outputs": ["color", "cover"],
        "fragment": glsl.SUM,
    },
    "edges": {
        "constants": [("VEC4", "box")],
        "samplers": ["first_tx"],
        "outputs": ["frag"],
        "fragment": glsl.EDGES,
    },
    "depth": {
        "constants": [("VEC4", "box"), ("VEC4", "line"), ("FLOAT", "least"), ("INT", "amended")],
        "samplers": ["raw_tx", "wire_tx"],
        "outputs": ["frag"],
        "fragment": glsl.DEPTH,
    },
    "steps": {
        "constants": [("VEC4", "box"), ("VEC2", "width")],
        "samplers": ["depth_tx"],
        "outputs": ["frag"],
        "fragment": glsl.STEPS,
    },
    "tiles": {
        "constants": [("VEC4", "box")],
        "samplers": ["depth_tx"],
        "outputs": ["frag"],
        "fragment": glsl.TILES,
    },
    "face": {
        "constants": [
            ("VEC4", "box"),
            ("VEC4", "line"),
            ("FLOAT", "least"),
            ("IVEC2", "origin"),
            ("INT", "amended"),
        ],
        "samplers": ["face_tx", "depth_tx", "wire_tx"],
        "outputs": ["color", "reach"],
        "fragment": glsl.FACE,
    },
}


def compiled(
    *,
    constants,
    samplers,
    outputs,
    fragment: str,
    glasses=False,
    view=False,
    meshes=False,
    drawn="",
):
    """A shader that draws quads: ``box`` is (x0, y0, x1, y1) of what it covers, -1 to 1.

    ``drawn``: the text of a block ``Drawn``, where it takes what was drawn displaced.
    """
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "corner")
    for kind, name in constants:
        info.push_constant(kind, name)
    if glasses or view:
        info.typedef_source(glsl.BLOCKS + drawn)
    if glasses:
        info.uniform_buf(0, "Glasses", "glasses")
    if view:
        info.uniform_buf(1, "View", "view")
    if meshes:
        samplers = [*samplers, "mesh_tx"]
        fragment = f"#define MESHES\n{fragment}"
    for slot, name in enumerate(samplers):
        info.sampler(slot, "FLOAT_2D", name)
    if drawn:
        info.uniform_buf(2, "Drawn", "drawn")
        info.sampler(len(samplers), "FLOAT_2D_ARRAY", "drawn_tx")
    for slot, name in enumerate(outputs):
        info.fragment_out(slot, "VEC4", name)
    info.vertex_source(glsl.QUAD_VERTEX)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)
