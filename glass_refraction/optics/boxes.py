# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes along the axes, each its lower and its upper corner (2, 3): which overlap, and which rays
meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .solver import in_blocks
from .surfaces import Floats
from .vectors import LEAST

TOUCHING = 2.0**-21
"""Relative distance within which two surfaces touch: of the largest coordinate of the place where a
ray starts, or of the way to where it meets them. It is four roundings of the float32 numbers in
which Blender keeps places."""


def apart(boxes: ArrayLike, most: int | None = None) -> NDArray[np.intp]:
    """(B,) groups of boxes (B, 2, 3), numbered as they first occur: of a group no two overlap.

    ``most``: groups at most; in the last of so many they may. Boxes so near that the tracer takes
    what is in them for touching count as overlapping.
    """
    boxes = np.asarray(boxes, float).reshape(-1, 2, 3)
    near = TOUCHING * float(np.abs(boxes).max(initial=0.0))
    group = np.zeros(len(boxes), dtype=np.intp)
    for number, (low, high) in enumerate(boxes):
        lows, highs = boxes[:number, 0] - near, boxes[:number, 1] + near
        taken = np.unique(group[:number][((low <= highs) & (high >= lows)).all(axis=1)])
        # The first that is not taken: taken ones are in order.
        free = int((taken == np.arange(len(taken))).cumprod().sum())
        group[number] = free if most is None else min(free, most - 1)
    return group


def fewer(boxes: Floats, most: int) -> Floats:
    """(B, 2, 3) boxes round boxes that lie near each other, ``most`` at most."""
    found: list[Floats] = [boxes] if len(boxes) else []
    while len(found) < most:
        largest = max(found, key=len, default=boxes)
        if len(largest) < 2:
            break
        middle = largest.sum(axis=1)
        order = np.argsort(middle[:, np.argmax(np.ptp(middle, axis=0))], kind="stable")
        found = [part for part in found if part is not largest]
        found += [largest[half] for half in np.array_split(order, 2)]
    return np.array([(part[:, 0].min(axis=0), part[:, 1].max(axis=0)) for part in found]).reshape(
        -1, 2, 3
    )


def grain(boxes: Floats | None) -> float:
    """Metres by which float32 may be off the faces of things in boxes (B, 2, 3)."""
    return 0.0 if boxes is None or not len(boxes) else GRAIN * float(np.ptp(boxes, axis=1).max())


GRAIN = 2.0**-22
"""Of the length of a triangle's edges: what Blender's ray caster may be off, as measured (at most
2.0e-7 over edges of 0.3 to 3,000 m)."""


def near_boxes(boxes: Floats, places: Floats, directions: Floats, way: Floats) -> NDArray[np.bool_]:
    """`meets_boxes` of boxes that are larger by what rounding may do to what is in them."""
    margin = TOUCHING * np.abs(boxes).max(axis=(1, 2)) + grain(boxes)
    return meets_boxes(boxes, margin, places, directions, way)


def meets_boxes(
    boxes: Floats, margin: ArrayLike, places: Floats, directions: Floats, way: Floats
) -> NDArray[np.bool_]:
    """Which rays (3, L) come into one of the boxes (B, 2, 3) within a way (L,).

    `margin`: metres by which boxes are larger, one or (B,). The way counts in directions.
    """
    found = np.zeros(len(way), dtype=bool)
    margin = np.broadcast_to(margin, len(boxes))[:, None]
    lows, highs = boxes[:, 0] - margin, boxes[:, 1] + margin

    def work(block: slice) -> None:
        place, along, least = places[:, block], directions[:, block], way[block]
        # A direction of 0 is taken as one too small to matter.
        inverse = 1.0 / np.where(np.abs(along) < LEAST, LEAST, along)
        for low, high in zip(lows, highs, strict=True):
            begin, end = ((side[:, None] - place) * inverse for side in (low, high))
            near, far = np.minimum(begin, end), np.maximum(begin, end)
            enters = np.maximum(np.maximum(near[0], near[1]), near[2])
            leaves = np.minimum(np.minimum(far[0], far[1]), far[2])
            found[block] |= (enters <= np.minimum(leaves, least)) & (leaves >= 0.0)

    in_blocks(work, len(way))
    return found
