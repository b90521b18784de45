# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture's regions by number of refractions, one colour a count (the paper's figure 8)."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ..names import hidden_name
from ..read.arrays import write_image
from .regions import crossing_counts

# A colour-blind-safe scale (Okabe and Ito): none, 1, 2, 3, 4, more.
COLOURS = np.array(
    [
        (0.0, 0.0, 0.0),
        (0.80, 0.47, 0.65),
        (0.90, 0.62, 0.0),
        (0.0, 0.62, 0.45),
        (0.34, 0.71, 0.91),
        (1.0, 1.0, 1.0),
    ]
)


def write_region_map(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, path: Path) -> None:
    """Write the map of :func:`regions.crossing_counts` as a picture (display colours)."""
    counts = crossing_counts(scene, depsgraph)
    pixels = np.ones((*counts.shape, 4), np.float32)
    pixels[..., :3] = COLOURS[np.minimum(counts, len(COLOURS) - 1)]
    image = bpy.data.images.new(hidden_name("regions"), counts.shape[1], counts.shape[0])
    try:
        write_image(image, pixels)
        image.file_format = "PNG"
        image.save(filepath=str(path))
    finally:
        bpy.data.images.remove(image)
