# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the samples of a pixel lie, and how a view tells that its engine changed the picture."""

import bpy  # noqa: F401 - finds the module gpu, which paint imports
import numpy as np
import pytest

from glass_refraction.viewport import paint, views


def test_samples_lie_evenly_in_the_pixel():
    places = np.array([views._jitter(number) for number in range(views.SAMPLES)])
    assert places.mean(axis=0) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert np.abs(places).max() < 0.5
    # Edges along rows and columns are smoothed by each: no two lie side by side.
    for axis in range(2):
        assert np.diff(np.sort(places[:, axis])).min() > 0.09


class _Shown:
    """A frame buffer that can be read."""

    def __init__(self, pixels):
        self.pixels, self.read = pixels, 0

    def read_color(self, x, y, width, height, channels, slot, kind):
        assert (channels, slot, kind) == (4, 0, "FLOAT")
        self.read += width * height
        return self.pixels[y : y + height, x : x + width].copy()


@pytest.mark.parametrize("size", [(64, 48), (200, 690), (5, 9)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_glance_sees_what_is_longer_than_the_gaps_between_its_lines(size, axis):
    width, height = size
    direct = paint.Direct()
    shown = _Shown(np.zeros((height, width, 4), np.float32))
    assert direct.glance(shown, size)
    assert not direct.glance(shown, size)
    long, across = (height, width) if axis == 0 else (width, height)
    gap = int(np.ceil(long / min(long, paint.GLANCED)))
    for begin in range(long - gap + 1):
        there = (slice(begin, begin + gap), begin % across)
        shown.pixels[there if axis == 0 else there[::-1]] += 1.0
        assert direct.glance(shown, size)
    assert not direct.glance(shown, size)


def test_a_glance_reads_a_small_part():
    size = (1000, 700)
    shown = _Shown(np.zeros((700, 1000, 4), np.float32))
    paint.Direct().glance(shown, size)
    assert shown.read < 0.03 * 1000 * 700
