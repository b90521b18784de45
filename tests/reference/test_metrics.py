# SPDX-License-Identifier: GPL-3.0-or-later
"""The metrics against closed forms and against the FLIP authors' own program."""

import math

import numpy as np
import pytest

from glass_refraction.reference import metrics


@pytest.fixture
def pictures():
    rng = np.random.default_rng(5)
    blocks = np.kron(rng.random((9, 12, 3)), np.ones((8, 8, 1)))
    shifted = np.roll(blocks, 2, axis=1)
    noisy = np.clip(blocks + rng.normal(0, 0.03, blocks.shape), 0, 1)
    return {"blocks": blocks, "shifted": shifted, "noisy": noisy, "noise": rng.random(blocks.shape)}


@pytest.mark.parametrize("other", ["shifted", "noisy", "noise"])
def test_flip_agrees_with_its_authors_program(pictures, other):
    flip_evaluator = pytest.importorskip("flip_evaluator")
    a, b = pictures["blocks"], pictures[other]
    theirs, mean, _ = flip_evaluator.evaluate(
        a.astype(np.float32), b.astype(np.float32), "LDR", applyMagma=False
    )
    ours = metrics.flip(a, b)
    assert ours.mean() == pytest.approx(mean, abs=1e-5)
    assert ours == pytest.approx(np.squeeze(theirs), abs=1e-4)


def test_flip_is_zero_for_equal_and_one_at_most_for_opposite_pictures(pictures):
    assert metrics.flip(pictures["noise"], pictures["noise"]).max() == 0
    black = np.zeros((20, 30, 3))
    error = metrics.flip(black, 1 - black)
    assert error.shape == (20, 30)
    assert error.min() > 0.9 and error.max() <= 1


def test_psnr_of_a_known_error():
    a = np.full((4, 6, 3), 0.5)
    b = a + 0.1
    assert metrics.psnr(a, b) == pytest.approx(20)
    assert metrics.psnr(a, a) == math.inf
    mask = np.zeros((4, 6), bool)
    mask[1, 2] = True
    c = a.copy()
    c[1, 2, 0] += 0.3
    assert metrics.psnr(a, c, mask) == pytest.approx(-10 * math.log10(0.09 / 3))
    assert metrics.psnr(a, c, ~mask) == math.inf
    assert metrics.max_abs_error(a, c) == pytest.approx(0.3)
    assert metrics.max_abs_error(a, c, ~mask) == 0
    assert math.isnan(metrics.psnr(a, c, np.zeros((4, 6), bool)))


def test_masked_mean():
    values = np.arange(12.0).reshape(3, 4)
    assert metrics.masked_mean(values) == 5.5
    assert metrics.masked_mean(values, values > 9) == 10.5
    assert math.isnan(metrics.masked_mean(values, values > 99))


def test_srgb_is_the_standard_view():
    linear = np.array([-1.0, 0.0, 0.001, 0.18, 0.5, 1.0, 7.0])
    expected = [0, 0, 0.01292, 0.46135613, 0.73535698, 1, 1]
    picture = np.stack([linear] * 4, axis=-1)[None]
    shown = metrics.to_srgb(picture)
    assert shown.shape == (1, 7, 3)
    assert shown[0, :, 1] == pytest.approx(expected, abs=1e-7)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match=r"same shape \(H, W, 3\)"):
        metrics.psnr(np.zeros((2, 2, 3)), np.zeros((2, 3, 3)))
    with pytest.raises(ValueError, match=r"same shape \(H, W, 3\)"):
        metrics.flip(np.zeros((2, 2)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"bool of shape \(2, 2\), not float64"):
        metrics.psnr(np.zeros((2, 2, 3)), np.zeros((2, 2, 3)), np.zeros((2, 2)))
