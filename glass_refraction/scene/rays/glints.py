# SPDX-License-Identifier: GPL-3.0-or-later
"""Evens out lamps' small images, which some of a pixel's rays meet by chance."""

from __future__ import annotations

from itertools import product

import numpy as np

NOISE = 0.05
"""Standard deviation of a pixel's light, over it and over white: less of it nobody sees."""
ALIKE = 1.4
"""Standard deviations by which the light of two pixels differs that may be the same."""
LEAST = 1e-12
"""Keeps a quotient finite."""
STEPS = tuple(product((-1, 0, 1), repeat=2))
"""To a pixel and those beside it."""


def evened(pixel: np.ndarray, light: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Light of lamps in pixels, evened out with that of the pixels beside where it is noise.

    Only pixels of several rays take part. They count the more the less they differ beyond what
    chance does, so edges of large images stay (Rousselle, Knaus and Zwicker, "Adaptive rendering
    with non-local means filtering", 2012).

    Parameters
    ----------
    pixel : (K,) numbers of pixels. light : (K, 3) over white that ways bring there.
    rays : (height, width) of each pixel.

    Returns
    -------
    numbers (P,) of the pixels with light, and that (P, 3).
    """
    if not len(pixel):
        return pixel, light
    width = rays.shape[1]
    places = np.stack(np.divmod(pixel, width))
    # The pixels with light and two more on each side, of which the outer ones take no part.
    low, high = places.min(axis=1) - 2, places.max(axis=1) + 3
    rays = np.pad(rays, 2, constant_values=1)[low[0] + 2 : high[0] + 2, low[1] + 2 : high[1] + 2]
    rows, columns = places - low[:, None]
    at, count = rows * rays.shape[1] + columns, rays.size
    total = np.stack([np.bincount(at, part, count) for part in light.T], axis=-1)
    total = total.reshape(*rays.shape, 3)
    bright = total.mean(axis=2)
    several = rays > 1
    # What rays bring tells how much the mean of so many varies.
    squares = np.bincount(at, light.mean(axis=1) ** 2, count).reshape(rays.shape)
    noise = several * np.maximum(squares - bright**2 / rays, 0.0)
    # Where no ray meets a lamp, those of the pixels beside tell it.
    near = sum(_beside(several.astype(float), step) for step in STEPS)
    told = sum(_beside(noise, step) for step in STEPS) / np.maximum(near, 1.0)
    noise = several * np.maximum(noise, told)
    out, weights = np.zeros_like(total), np.zeros_like(bright)
    for step in STEPS:
        chance = noise + _beside(noise, step)
        apart = np.maximum((bright - _beside(bright, step)) ** 2 - chance, 0.0)
        weight = np.exp(-0.5 * np.dot(step, step) - apart / (ALIKE**2 * chance + LEAST))
        weight *= _beside(several, step)
        out += weight[..., None] * _beside(total, step)
        weights += weight
    noisy = several & (np.sqrt(noise) > NOISE * np.maximum(bright, 1.0))
    total[noisy] = out[noisy] / weights[noisy][:, None]
    rows, columns = np.nonzero(total.any(axis=2))
    return (rows + low[0]) * width + columns + low[1], total[rows, columns]


def _beside(values: np.ndarray, step: tuple[int, int]) -> np.ndarray:
    """The values of the pixels one step further."""
    return np.roll(values, step, (0, 1))
