# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's figures and files, from made-up pictures."""

import json
import math

import numpy as np
import pytest

from glass_refraction.reference.report import MAGNIFICATION, picture_figures, write_report


@pytest.fixture
def pictures():
    rng = np.random.default_rng(1)
    reference = rng.uniform(0.2, 0.8, (12, 16, 3))
    composite = reference.copy()
    composite[:6] += 0.1
    return composite, reference, reference + 0.01


@pytest.fixture
def report(pictures):
    lower = np.zeros((12, 16), bool)
    lower[:6] = True
    masks = {"picture": lower | True, "TTTT": lower, "TRT": lower, "outside": ~lower}
    figures = picture_figures(*pictures, {**masks, "none": lower & False})
    return {
        "scene": "Kitchen",
        "frame": 3,
        "resolution": [16, 12],
        **figures.pop("picture"),
        "outside": figures.pop("outside"),
        "regions": figures,
        "seconds_composite": 1.25,
        "seconds_reference": 10.0,
        "composite_samples": 64,
        "reference_samples": 64,
        "vertices": 99,
        "paths": ["TTTT", "TRT"],
        "problems": [],
        "engine": "CYCLES",
        "shading": "TRUE",
        "surface": "GLASS",
        "magnification": MAGNIFICATION,
        "blender_version": "5.0.1",
    }


def test_figures_over_each_mask(report):
    assert set(report["regions"]) == {"TTTT", "TRT"}
    inside = report["regions"]["TTTT"]
    assert inside["pixels"] == 96
    assert inside["psnr_db"] == pytest.approx(20)
    assert inside["psnr_other_seed_db"] == pytest.approx(-20 * math.log10(0.09))
    assert inside["reference_noise_psnr_db"] == pytest.approx(40)
    assert inside["max_abs_error"] == pytest.approx(0.1)
    assert report["psnr_db"] == pytest.approx(20 + 10 * math.log10(2))
    assert report["outside"]["psnr_db"] == math.inf
    assert 0 < report["flip_mean"] < inside["flip_mean"]


def test_files(report, pictures, tmp_path):
    folder = tmp_path / "new" / "report"
    write_report(folder, report, *pictures[:2])
    assert {f.name for f in folder.iterdir()} == {
        "report.json",
        "report.md",
        "composite.png",
        "reference.png",
        "difference.png",
        "comparison.png",
    }

    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    read = json.loads((folder / "report.json").read_text(), parse_constant=no_constant)
    assert read["psnr_db"] == pytest.approx(report["psnr_db"])
    assert read["outside"]["psnr_db"] is None
    text = (folder / "report.md").read_text()
    assert "| light path TTTT, TRT | 96 | 20.0 |" in text
    assert "| beside the glass | 96 | equal |" in text
    assert "difference x 8](comparison.png)" in text
    assert "Problems" not in text


def test_problems_are_told(report, pictures, tmp_path):
    report["problems"] = ['Glass "Cup" is sheared']
    write_report(tmp_path, report, *pictures[:2])
    assert '- Glass "Cup" is sheared' in (tmp_path / "report.md").read_text()
