# SPDX-License-Identifier: GPL-3.0-or-later
"""How far apart two pictures are: PSNR, largest error and FLIP.

FLIP is the published metric for rendered pictures that are flipped between on a screen (Andersson
et al., "FLIP: A Difference Evaluator for Alternating Images", 2020), for pictures of [0, 1].
"""

from __future__ import annotations

import math

import numpy as np

# A 0.7 m wide screen of 3840 pixels seen from 0.7 m: FLIP's usual viewing conditions.
PIXELS_PER_DEGREE = 0.7 * (3840 / 0.7) * math.pi / 180

_XYZ_FROM_RGB = np.array(
    [
        (10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794),
        (2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897),
        (1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382),
    ]
)
_RGB_FROM_XYZ = np.linalg.inv(_XYZ_FROM_RGB)
_WHITE = _XYZ_FROM_RGB.sum(axis=1)

# Contrast sensitivity of the eye, one entry a channel of the opponent space: sums of Gaussians
# (amplitude, squared width in degrees).
_SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
_FEATURE_WIDTH = 0.082  # degrees
_FEATURE_EXPONENT = 0.5
_COLOUR_EXPONENT = 0.7
# Colour errors up to this part of the largest take this part of the scale.
_SMALL_COLOUR, _SMALL_SCALE = 0.4, 0.95


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear scene-referred colours (..., 3 or more) as displayed by the "Standard" view.

    Returns
    -------
    (..., 3) float64 in [0, 1]; further channels (alpha) are dropped.
    """
    linear = np.clip(np.asarray(linear, float)[..., :3], 0.0, 1.0)
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )


def masked_mean(values: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Mean of values (H, W, ...) over the pixels of a mask (H, W) bool, NaN where that is empty."""
    if mask is not None:
        values = values[_checked_mask(mask, values)]
    return float(np.mean(values)) if values.size else math.nan


def psnr(a: np.ndarray, b: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio of two pictures (H, W, 3) of [0, 1], in dB; the peak is 1.

    Infinite for equal pictures, NaN over an empty mask (H, W) bool.
    """
    _check_pair(a, b)
    error = masked_mean((np.asarray(a, float) - b) ** 2, mask)
    return math.inf if error == 0 else -10 * math.log10(error)


def max_abs_error(a: np.ndarray, b: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Largest difference of two pictures (H, W, 3) in any channel, NaN over an empty mask."""
    _check_pair(a, b)
    difference = np.abs(np.asarray(a, float) - b)
    if mask is not None:
        difference = difference[_checked_mask(mask, difference)]
    return float(difference.max()) if difference.size else math.nan


def flip(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """FLIP error of each pixel (H, W) in [0, 1] between two sRGB pictures (H, W, 3) of [0, 1]."""
    _check_pair(reference, test)
    pictures = [_opponent(_linear(np.asarray(p, float))) for p in (reference, test)]

    seen = [_perceived_lab(p) for p in pictures]
    colour = _colour_error(_hyab(*seen))

    # The features are those of the luminance, from 0 to 1.
    features = [_features((p[..., 0] + 16) / 116) for p in pictures]
    feature = np.maximum(*(np.abs(a - b) for a, b in zip(*features, strict=True)))
    feature = np.clip((feature / math.sqrt(2)) ** _FEATURE_EXPONENT, 0, 1)
    return colour ** (1 - feature)


def _check_pair(a: np.ndarray, b: np.ndarray) -> None:
    if np.shape(a) != np.shape(b) or np.ndim(a) != 3 or np.shape(a)[2] != 3:
        raise ValueError(
            f"two pictures of the same shape (H, W, 3) are needed, not {np.shape(a)} and "
            f"{np.shape(b)}"
        )


def _checked_mask(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    mask = np.asarray(mask)
    if mask.dtype != bool or mask.shape != values.shape[:2]:
        raise ValueError(
            f"a mask must be bool of shape {values.shape[:2]}, not {mask.dtype} of {mask.shape}"
        )
    return mask


def _linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _opponent(rgb: np.ndarray) -> np.ndarray:
    """Linear RGB as luminance, red-green and blue-yellow, all three linear in the light (YCxCz)."""
    x, y, z = np.moveaxis(rgb @ _XYZ_FROM_RGB.T / _WHITE, -1, 0)
    return np.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)), axis=-1)


def _rgb_from_opponent(opponent: np.ndarray) -> np.ndarray:
    luminance, red_green, blue_yellow = np.moveaxis(opponent, -1, 0)
    y = (luminance + 16) / 116
    xyz = np.stack((y + red_green / 500, y, y - blue_yellow / 200), axis=-1) * _WHITE
    return xyz @ _RGB_FROM_XYZ.T


def _hunt_lab(rgb: np.ndarray) -> np.ndarray:
    """Linear RGB in CIELAB, colourfulness adjusted to the luminance (Hunt)."""
    ratio = rgb @ _XYZ_FROM_RGB.T / _WHITE
    edge = 6 / 29
    root = np.where(ratio > edge**3, np.cbrt(np.maximum(ratio, 0)), ratio / (3 * edge**2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    lightness = 116 * y - 16
    return np.stack((lightness, 5 * lightness * (x - y), 2 * lightness * (y - z)), axis=-1)


def _perceived_lab(opponent: np.ndarray) -> np.ndarray:
    """What the eye resolves of the picture: filtered by its contrast sensitivity, in Hunt's Lab."""
    widest = max(width for terms in _SENSITIVITY for _, width in terms)
    radius = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * PIXELS_PER_DEGREE)
    degrees = np.arange(-radius, radius + 1) / PIXELS_PER_DEGREE
    filtered = np.empty_like(opponent)
    for channel, terms in enumerate(_SENSITIVITY):
        total = 0.0
        picture = 0.0
        for amplitude, width in terms:
            kernel = np.exp(-(math.pi**2) * degrees**2 / width)
            weight = amplitude * math.sqrt(math.pi / width)
            total += weight * kernel.sum() ** 2
            picture = picture + weight * _filtered(opponent[..., channel], kernel, kernel)
        filtered[..., channel] = picture / total
    return _hunt_lab(np.clip(_rgb_from_opponent(filtered), 0, 1))


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """City-block distance in lightness, Euclidean in colour."""
    difference = a - b
    return np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2])


def _colour_error(distance: np.ndarray) -> np.ndarray:
    """The Lab distance mapped to [0, 1]: most of the scale for the small differences."""
    green, blue = _hunt_lab(np.array([(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]))
    largest = _hyab(green, blue) ** _COLOUR_EXPONENT
    small = _SMALL_COLOUR * largest
    error = distance**_COLOUR_EXPONENT
    return np.where(
        error < small,
        _SMALL_SCALE / small * error,
        _SMALL_SCALE + (error - small) / (largest - small) * (1 - _SMALL_SCALE),
    )


def _features(luminance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Strength of edges and of points (H, W) in a picture of luminance [0, 1]."""
    deviation = 0.5 * _FEATURE_WIDTH * PIXELS_PER_DEGREE
    radius = math.ceil(3 * deviation)
    offset = np.arange(-radius, radius + 1)
    bell = np.exp(-(offset**2) / (2 * deviation**2))
    smooth = bell / bell.sum()
    strengths = []
    for kernel in (-offset * bell, (offset**2 / deviation**2 - 1) * bell):
        # The positive and the negative part each sum to one.
        kernel = np.where(
            kernel > 0, kernel / kernel[kernel > 0].sum(), kernel / -kernel[kernel < 0].sum()
        )
        strengths.append(
            np.hypot(_filtered(luminance, smooth, kernel), _filtered(luminance, kernel, smooth))
        )
    return strengths[0], strengths[1]


def _filtered(picture: np.ndarray, vertical: np.ndarray, horizontal: np.ndarray) -> np.ndarray:
    """Correlate a picture (H, W) with a separable kernel of odd length, its border continued."""
    for axis, kernel in ((0, vertical), (1, horizontal)):
        radius = len(kernel) // 2
        margin = [(0, 0), (0, 0)]
        margin[axis] = (radius, radius)
        padded = np.moveaxis(np.pad(picture, margin, mode="edge"), axis, 0)
        length = picture.shape[axis]
        result = sum(weight * padded[i : i + length] for i, weight in enumerate(kernel))
        picture = np.moveaxis(result, 0, axis)
    return picture
