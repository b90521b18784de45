# SPDX-License-Identifier: GPL-3.0-or-later
"""What single passes of the live view's drawing give for arrays; needs a GPU context.

``paint`` is the installed extension's module.
"""

from importlib import import_module

import gpu
import numpy as np


def _constant(paint, module: str, name: str):
    return getattr(import_module(f".{module}", paint.__package__), name)


def tiles_of(paint, depths: np.ndarray) -> np.ndarray:
    """Nearest and farthest depths (rows, columns, 2) of tiles.

    ``depths``: (height, width) of pixels.
    """
    height, width = depths.shape
    rows, columns = -(-height // paint.TILE), -(-width // paint.TILE)
    direct = paint.Direct()
    direct._plain = paint._texture(np.ascontiguousarray(depths, np.float32), "R32F")
    _, target = paint._target((columns, rows), "RGBA32F")
    direct._fill(target, "tiles", (columns, rows))
    with target.bind():
        read = target.read_color(0, 0, columns, rows, 4, 0, "FLOAT")
    return np.asarray(read).reshape(rows, columns, 4)[..., :2]


def plain_values(paint, values: np.ndarray) -> np.ndarray:
    """Values (height, width) of a depth buffer without what EEVEE adds to them."""
    height, width = values.shape
    direct = paint.Direct()
    direct.raw = paint._texture(np.ascontiguousarray(values, np.float32), "R32F")
    direct.wire_depth = paint._texture(
        np.full((height, width), _constant(paint, "wires", "NOTHING"), np.float32), "R32F"
    )
    direct.line = (0.0, 1.0, 1.0, 0.0)
    _, target = paint._target((width, height), "RGBA32F")
    direct._fill(target, "depth", (width, height), amended=True)
    with target.bind():
        read = target.read_color(0, 0, width, height, 4, 0, "FLOAT")
    return np.asarray(read).reshape(height, width, 4)[..., 0]


def depths_between(
    paint, values: np.ndarray, width: float, parts: int, *, parallel: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Depths that count at ``parts``² places in each pixel.

    Parameters
    ----------
    values : (height, width) depths of pixels. width : of a pixel, in the depths' unit.
    parallel : what kind of view they are depths of.

    Returns
    -------
    (rows, columns) each: the depths, those of a round thing's edge to the left of each place, those
    of a surface that goes on from pixel to pixel, and those that count where the values are a
    capture's, of which a face is a square.
    """
    height, columns = values.shape
    direct = paint.Direct()
    direct.size = (columns, height)
    direct.depth = direct._plain = paint._texture(np.ascontiguousarray(values, np.float32), "R32F")
    direct._stepped, direct._to_stepped = paint._target(direct.size, "RG32F")
    direct._mark_steps((width, 0.0))
    block = np.zeros((_constant(paint, "eye", "VIEW_ROWS"), 4), np.float32)
    block[5, 0], block[10, :2] = width, direct.size
    block[9, 3] = not parallel
    block[12, 3] = min(direct.size)
    size = (parts * columns, parts * height)
    _, target = paint._target(size, "RGBA32F")
    shader = paint._shader("between")
    # Held until they were drawn with.
    glasses, view = (
        paint._uniform(np.zeros((_constant(paint, "description", "ROWS"), 4))),
        paint._uniform(block),
    )
    none = paint._texture(np.zeros((3, 3, 4), np.float32), "RGBA32F")
    with target.bind():
        gpu.state.viewport_set(0, 0, *size)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")
        shader.bind()
        shader.uniform_block("glasses", glasses)
        shader.uniform_block("view", view)
        for name in paint.DESCRIPTIONS["between"]["samplers"]:
            textures = {"depth_tx": direct.depth, "reach_tx": direct._plain}
            shader.uniform_sampler(name, textures.get(name, none))
        shader.uniform_float("parts", float(parts))
        shader.uniform_float("box", paint.WHOLE)
        paint._quad().draw(shader)
        read = np.asarray(target.read_color(0, 0, *size, 4, 0, "FLOAT"))
    read = read.reshape(size[1], size[0], 4)
    return tuple(np.moveaxis(read, 2, 0))
