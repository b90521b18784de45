# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files from arrays, without a data-block in the user's file as Blender's writer needs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np


def write_png(path: Path | str, picture: np.ndarray) -> None:
    """Write a display-referred picture (H, W, 3) of [0, 1], bottom row first, as 8-bit PNG.

    Raises
    ------
    ValueError
        The picture has not three channels.
    """
    levels = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)[::-1]
    height, width, channels = levels.shape
    if channels != 3:
        raise ValueError(f"a picture of 3 channels is needed, not {channels}")
    # Each row begins with the number of its filter: 0, none.
    rows = np.concatenate((np.zeros((height, 1), np.uint8), levels.reshape(height, -1)), axis=1)
    chunks = (
        (b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)),
        (b"sRGB", b"\0"),
        (b"IDAT", zlib.compress(rows.tobytes(), 6)),
        (b"IEND", b""),
    )
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in chunks:
            file.write(struct.pack(">I", len(data)) + kind + data)
            file.write(struct.pack(">I", zlib.crc32(kind + data)))
