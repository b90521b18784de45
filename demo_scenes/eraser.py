# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `eraser`: an eraser seen partly through a hollow glass cylinder.

After figure 1 of Mukai, Makino and Chang (MODSIM 2013): a plastic eraser stands on a desk behind
an empty glass, partly behind it and partly beside it, and slides further behind it.

    python demo_scenes/eraser.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

# The glass, standing at the origin of the desk. Metres.
GLASS_RADIUS = 0.040
GLASS_WALL = 0.003
GLASS_HEIGHT = 0.120
GLASS_IOR = 1.5

# The eraser: length, depth and height as it stands on its long narrow side, metres.
ERASER_SIZE = (0.086, 0.018, 0.040)
ERASER_BEVEL = 0.0025
SLEEVE_START, SLEEVE_LENGTH = 0.024, 0.054  # from the left end
SLEEVE_GAP = 0.00015
SLEEVE_PAPER = 0.00035
GRID = 0.0007  # longest edge of the printed paper's mesh; plain rubber needs only half as fine
ERASER_TURN = math.radians(-9.0)

FRAMES = (1, 24)
PICTURE_FRAME = 12  # the frame that the file opens with: half behind the glass, half beside it
PATH_START = (0.069, 0.072)
PATH_END = (0.016, 0.072)
WALL_DISTANCE = 0.150
DESK_EDGE = -0.250


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: every material emits its texture, with no light and a black world.
    ``with_glass``: add the glass by the extension's operator; without it the direct view remains.
    """
    scene = common.empty_scene("eraser")
    scene.frame_start, scene.frame_end = FRAMES

    # The sides are chosen so that the grain (along U) runs away from the camera.
    # The desk ends below the picture but before the camera: nothing lies behind the eye.
    depth = WALL_DISTANCE - DESK_EDGE
    desk = common.quad("Desk", (0.5, DESK_EDGE, 0.0), (0.0, depth, 0.0), (-1.0, 0.0, 0.0))
    grain = common.wood((0.50, 0.31, 0.16), (0.36, 0.20, 0.09))
    desk.materials.append(common.material("Desk wood", grain, unlit=unlit))
    common.link(scene, "Desk", desk)

    wall = common.quad("Wall", (-0.5, WALL_DISTANCE, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    pattern = common.tiles(
        0.025, 0.025, 0.0018, ((0.36, 0.52, 0.50), (0.50, 0.64, 0.60)), (0.78, 0.77, 0.72)
    )
    wall.materials.append(common.material("Wall tiles", pattern, unlit=unlit))
    common.link(scene, "Wall", wall)

    rubber = common.material("Eraser rubber", (0.80, 0.79, 0.76), unlit=unlit)
    print_ = common.image_texture(common.picture("Eraser sleeve", sleeve_print()))
    sleeve = common.material("Eraser sleeve", print_, unlit=unlit)
    eraser = common.link(scene, "Eraser", eraser_mesh(rubber, sleeve))
    eraser.rotation_euler.z = ERASER_TURN
    common.keyframe_location(eraser, {FRAMES[0]: (*PATH_START, 0.0), FRAMES[1]: (*PATH_END, 0.0)})

    common.light_up(scene, unlit=unlit, sun_direction=(-0.80, 0.42, -0.52))
    common.camera(scene, (0.014, -0.330, 0.092), (0.014, 0.0, 0.054), 0.050)
    if with_glass:
        add_glass()
    common.settle(scene, PICTURE_FRAME)
    return scene


def add_glass() -> bpy.types.Object:
    """Stand the hollow glass on the desk and return it."""
    common.register_extension()
    bpy.ops.object.refractive_glass_add(
        shape="CYLINDER",
        radius=GLASS_RADIUS,
        wall_thickness=GLASS_WALL,
        height=GLASS_HEIGHT,
        ior=GLASS_IOR,
        contents_ior=1.0,
    )
    glass = bpy.context.active_object
    glass.name = "Glass"
    glass.location = (0.0, 0.0, 0.0)
    return glass


# --- the eraser ----------------------------------------------------------------------------------


def eraser_mesh(rubber: bpy.types.Material, sleeve: bpy.types.Material) -> bpy.types.Mesh:
    """Return the eraser standing on z = 0, centred in x and y: a block and the sleeve round it.

    The long side runs along x, the printed broad sides face -y and +y. Both parts are closed.
    """
    size = np.array(ERASER_SIZE)
    block, block_faces = rounded_box(size / 2, ERASER_BEVEL, 2 * GRID)
    tube, tube_faces, tube_uv = sleeve_shell(
        (SLEEVE_START - size[0] / 2, SLEEVE_START + SLEEVE_LENGTH - size[0] / 2),
        size[1:] / 2,
        ERASER_BEVEL,
        GRID,
    )
    # Plain rubber needs no UVs; a corner for every one all the same.
    block_uv = np.zeros((4 * len(block_faces), 2))
    positions = np.vstack((block, tube))
    # The sleeve is a little larger than the block: it is what stands on the desk.
    positions[:, 2] += size[2] / 2 + SLEEVE_GAP + SLEEVE_PAPER
    return common.mesh(
        "Eraser",
        positions,
        [*block_faces.tolist(), *(tube_faces + len(block)).tolist()],
        uv=np.vstack((block_uv, tube_uv)),
        materials=(rubber, sleeve),
        material_index=np.repeat((0, 1), (len(block_faces), len(tube_faces))),
        smooth=True,
    )


def rounded_box(half: np.ndarray, radius: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a box with rounded edges, one closed sheet of quads no longer than ``step``.

    ``half``: half sizes (3,), ``radius`` of the rounding, all metres. The faces of a cube carry
    the grid; what lies in the border strip is pulled onto the rounding.
    """
    half = np.asarray(half, dtype=np.float64)
    flat = half - radius
    # Places along each axis: equal angles on the rounding (up to 45 deg from either face).
    arcs = max(2, math.ceil(radius * math.pi / 4 / step))
    strip = radius * np.tan(np.linspace(0.0, math.pi / 4, arcs + 1))
    ticks = [
        np.concatenate(
            (-f - strip[:0:-1], np.linspace(-f, f, math.ceil(2 * f / step) + 1), f + strip[1:])
        )
        for f in flat
    ]
    points, faces = [], []
    count = 0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            grid = np.empty((len(ticks[a]), len(ticks[b]), 3))
            grid[..., axis] = side * half[axis]
            grid[..., a], grid[..., b] = np.meshgrid(ticks[a], ticks[b], indexing="ij")
            faces.append(common.grid_faces(*grid.shape[:2], flip=side < 0) + count)
            points.append(grid.reshape(-1, 3))
            count += grid.shape[0] * grid.shape[1]
    points, faces = np.vstack(points), np.vstack(faces)
    core = np.clip(points, -flat, flat)
    out = points - core
    points = core + radius * out / np.linalg.norm(out, axis=1, keepdims=True)
    return common.weld(points, faces)


def sleeve_shell(
    span: tuple[float, float], half: np.ndarray, bevel: float, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the paper sleeve: a closed shell round the block's section.

    ``span`` (x0, x1), ``half`` sizes (y, z) and ``bevel`` of the block, ``step``: longest edge; all
    metres. Returns positions, quads and one UV a corner: U along x, V twice 0..1 round the
    section, so that both broad sides carry the same print.
    """
    columns = math.ceil((span[1] - span[0]) / step) + 1
    x = np.linspace(*span, columns)
    outer, turn = section(half, bevel, SLEEVE_GAP + SLEEVE_PAPER, step)
    inner, _ = section(half, bevel, SLEEVE_GAP, step)
    # One closed ring of rows: outer side from x0 to x1, then the inner side back.
    # Nobody sees the inner side: its two ends will do.
    rows = [(t, outer) for t in x] + [(x[-1], inner), (x[0], inner)]
    around = len(outer)
    positions = np.empty((len(rows), around, 3))
    for row, (t, loop) in enumerate(rows):
        positions[row, :, 0] = t
        positions[row, :, 1:] = loop
    row, place = np.meshgrid(np.arange(len(rows)), np.arange(around), indexing="ij")
    row_next, place_next = (row + 1) % len(rows), (place + 1) % around
    faces = np.stack(
        (
            row * around + place,
            row_next * around + place,
            row_next * around + place_next,
            row * around + place_next,
        ),
        axis=-1,
    ).reshape(-1, 4)
    u = np.append(np.linspace(0, 1, columns), (1, 0))
    v = np.append(2.0 * turn, 2.0)
    uv = np.stack(
        (
            np.stack((u[row], u[row_next], u[row_next], u[row]), axis=-1),
            np.stack((v[place], v[place], v[place + 1], v[place + 1]), axis=-1),
        ),
        axis=-1,
    ).reshape(-1, 2)
    return positions.reshape(-1, 3), faces, uv


def section(
    half: np.ndarray, bevel: float, offset: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a rounded rectangle in y, z as a counter-clockwise loop, and how far round it is.

    It starts at the lower edge of the side that faces -y and climbs that side first, so that the
    print (see :func:`sleeve_print`) begins there. Lengths in metres, the second result in 0..1.
    """
    flat = np.asarray(half) - bevel
    radius = bevel + offset
    arc = max(3, math.ceil(bevel * math.pi / 2 / step))
    loop = []
    # Clockwise seen from +x, which is counter-clockwise from -x: up the front, back over the top.
    for (cy, cz), start in (((-1, -1), 270), ((-1, 1), 180), ((1, 1), 90), ((1, -1), 0)):
        angle = np.radians(np.linspace(start, start - 90, arc + 1))
        loop.append(
            np.stack(
                (cy * flat[0] + radius * np.cos(angle), cz * flat[1] + radius * np.sin(angle)),
                axis=-1,
            )
        )
    dense = []
    for here, after in zip(loop, [*loop[1:], loop[0]], strict=True):
        pieces = math.ceil(np.linalg.norm(after[0] - here[-1]) / step)
        between = np.linspace(here[-1], after[0], pieces + 1)[1:-1]
        dense += [here, between]
    points = np.vstack(dense)
    lengths = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    return points, np.concatenate(((0.0,), np.cumsum(lengths)[:-1])) / lengths.sum()


# --- the print -----------------------------------------------------------------------------------

BLUE, ORANGE, WHITE = (0.07, 0.20, 0.48), (0.93, 0.45, 0.10), (0.95, 0.95, 0.92)

LETTERS = {  # strokes in a box 0.6 wide and 1 high
    "N": [[(0, 0), (0, 1), (0.6, 0), (0.6, 1)]],
    "E": [[(0.55, 0), (0, 0), (0, 1), (0.55, 1)], [(0, 0.5), (0.45, 0.5)]],
    "L": [[(0, 1), (0, 0), (0.5, 0)]],
    "S": [
        [
            (0.3 + 0.28 * math.cos(a), 0.75 + 0.25 * math.sin(a))
            for a in np.radians(np.arange(30, 271, 15))
        ]
        + [
            (0.3 + 0.28 * math.cos(a), 0.25 + 0.25 * math.sin(a))
            for a in np.radians(np.arange(75, -151, -15))
        ]
    ],
}


def sleeve_print(pixels_per_metre: float = 10_000.0) -> np.ndarray:
    """Return the print of half the sleeve's way round: (height, width, 3), sRGB, top row first.

    From the bottom upwards: the lower bevel, the broad side with the name on it, the upper bevel
    and the narrow side.
    """
    bevel = math.pi / 2 * (ERASER_BEVEL + SLEEVE_GAP + SLEEVE_PAPER)
    broad = ERASER_SIZE[2] - 2 * ERASER_BEVEL
    total = 2 * bevel + broad + ERASER_SIZE[1] - 2 * ERASER_BEVEL
    width, height = (round(length * pixels_per_metre) for length in (SLEEVE_LENGTH, total))
    x = (np.arange(width) + 0.5) / width * SLEEVE_LENGTH
    y = (1.0 - (np.arange(height) + 0.5) / height) * total
    x, y = np.meshgrid(x, y)
    pixel = 1.0 / pixels_per_metre

    result = np.empty((height, width, 3))
    result[:] = BLUE

    def paint(distance: np.ndarray, colour: common.Colour) -> None:
        # ``distance`` from the shape's border in metres, negative inside: one pixel of smoothing.
        cover = np.clip(0.5 - distance / pixel, 0.0, 1.0)[..., None]
        result[:] = cover * np.asarray(colour) + (1.0 - cover) * result

    def band(start: float, stop: float, colour: common.Colour) -> None:
        paint(np.maximum(start - x, x - stop), colour)

    for left, right, colour in (
        (0.0, 0.0035, ORANGE),
        (0.0035, 0.0045, WHITE),
        (SLEEVE_LENGTH - 0.0045, SLEEVE_LENGTH - 0.0035, WHITE),
        (SLEEVE_LENGTH - 0.0035, SLEEVE_LENGTH, ORANGE),
    ):
        band(left, right, colour)

    size = 0.0125  # height of the letters
    advance = 0.66 * size
    origin = np.array(
        (0.5 * (SLEEVE_LENGTH - 5 * advance) + 0.03 * size, bevel + 0.56 * broad - 0.5 * size)
    )
    for place, letter in enumerate("SNELL"):
        for stroke in LETTERS[letter]:
            points = np.asarray(stroke) * (0.82 * size, size) + origin + (place * advance, 0.0)
            paint(stroke_distance(x, y, points) - 0.0011, WHITE)
    rule = np.array(
        (
            (0.5 * SLEEVE_LENGTH - 0.019, bevel + 0.17 * broad),
            (0.5 * SLEEVE_LENGTH + 0.019, bevel + 0.17 * broad),
        )
    )
    paint(stroke_distance(x, y, rule) - 0.0006, ORANGE)
    return result


def stroke_distance(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how far each place (x, y) is from a line through ``points`` (K, 2)."""
    result = np.full(x.shape, np.inf)
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        dx, dy = x1 - x0, y1 - y0
        t = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        result = np.minimum(result, np.hypot(x - x0 - t * dx, y - y0 - t * dy))
    return result


if __name__ == "__main__":
    sys.exit(common.run("eraser", build))
