# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a comparison: figures as JSON and Markdown, pictures as PNG."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from .metrics import flip, masked_mean, max_abs_error, psnr
from .png import write_png

MAGNIFICATION = 8.0
"""Factor of the difference picture."""

_GAP = 8  # pixels between the pictures of comparison.png


def picture_figures(
    composite: np.ndarray,
    reference: np.ndarray,
    other_reference: np.ndarray,
    masks: dict[str, np.ndarray],
) -> dict[str, dict[str, float]]:
    """How far a picture is from its reference, over each of several masks.

    Parameters
    ----------
    composite, reference : display-referred pictures (H, W, 3) of [0, 1].
    other_reference : the reference with another seed.
    masks : name -> (H, W) bool; those without a pixel are left out of the result.

    Returns
    -------
    dict : name -> figures: ``pixels``, ``psnr_db``, ``psnr_other_seed_db``, ``flip_mean``,
        ``max_abs_error`` and ``reference_noise_psnr_db`` (the two references held together).
    """
    error = flip(reference, composite)
    return {
        name: {
            "pixels": int(mask.sum()),
            "psnr_db": psnr(composite, reference, mask),
            "psnr_other_seed_db": psnr(composite, other_reference, mask),
            "flip_mean": masked_mean(error, mask),
            "max_abs_error": max_abs_error(composite, reference, mask),
            "reference_noise_psnr_db": psnr(reference, other_reference, mask),
        }
        for name, mask in masks.items()
        if mask.any()
    }


def write_report(
    folder: Path | str,
    report: dict,
    composite: np.ndarray,
    reference: np.ndarray,
) -> None:
    """Write ``report.json``, ``report.md`` and the pictures into a folder, made if need be.

    Parameters
    ----------
    report : as ``compare`` returns it. A PSNR without end (equal pictures) becomes ``null``.
    composite, reference : display-referred pictures (H, W, 3) of [0, 1], bottom row first.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    difference = np.clip(np.abs(composite - reference) * report["magnification"], 0, 1)
    pictures = {"composite": composite, "reference": reference, "difference": difference}
    for name, picture in pictures.items():
        write_png(folder / f"{name}.png", picture)
    gap = np.ones((composite.shape[0], _GAP, 3))
    write_png(
        folder / "comparison.png",
        np.concatenate((composite, gap, reference, gap, difference), axis=1),
    )
    text = json.dumps(_finite(report), indent=2, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.md").write_text(markdown(report), encoding="utf-8")


def markdown(report: dict) -> str:
    """The report as a page of Markdown that shows the comparison's pictures."""
    width, height = report["resolution"]
    places = {"whole picture": report, "inside the glass's outline": report.get("inside")}
    # Rays that split at the glass take several paths: those of one region share a row.
    shared: dict[tuple, list[str]] = {}
    for events, found in report["regions"].items():
        shared.setdefault(tuple(found.values()), []).append(events)
    places |= {
        f"light path {', '.join(events)}": report["regions"][events[0]]
        for events in shared.values()
    }
    places["beside the glass"] = report.get("outside")
    rows = [
        f"| {place} | {found['pixels']} | {_decibel(found['psnr_db'])} | "
        f"{_decibel(found['psnr_other_seed_db'])} | "
        f"{_decibel(found['reference_noise_psnr_db'])} | {found['flip_mean']:.4f} | "
        f"{found['max_abs_error']:.3f} |"
        for place, found in places.items()
        if found is not None
    ]
    lines = [
        f"# {report['scene']}, frame {report['frame']}",
        "",
        f"![composited picture, reference, difference x {report['magnification']:g}]"
        "(comparison.png)",
        "",
        "From left to right: the composited picture, the same frame with real glass in Cycles, "
        f"their difference magnified {report['magnification']:g} times.",
        "",
        "| where | pixels | PSNR, dB | PSNR, other seed | reference's noise, dB | FLIP, mean "
        "| largest error |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "",
        "Colours as the Standard view shows them, from 0 to 1. The reference takes the scene's own "
        "seed, so noise that both pictures share cancels; beside it stands a reference of another "
        "seed. The reference's noise is the PSNR between the two: a difference below it means "
        "nothing. A light path's row holds the pixels that lie in its region wholly.",
        "",
        "| | composited | reference |",
        "|---|---|---|",
        f"| engine | {report['engine']} | Cycles, {report['surface'].title()} BSDF |",
        f"| samples | {report['composite_samples']} | {report['reference_samples']} |",
        f"| time, s | {report['seconds_composite']:.2f} | {report['seconds_reference']:.2f} |",
        "",
        f"{width} x {height} pixels, {report['vertices']} vertices, light paths "
        f"{', '.join(report['paths']) or 'none'}, shading {report['shading']}, "
        f"Blender {report['blender_version']}.",
    ]
    if "pixels_left_out" in report:
        lines += [
            "",
            f"In {report['pixels_left_out']:.2%} of the glass's pixels the paths bring less than "
            "half of the light; nearest paths or the scene straight behind stand in.",
        ]
    if report["problems"]:
        lines += ["", "Problems:", "", *(f"- {problem}" for problem in report["problems"])]
    return "\n".join(lines) + "\n"


def _decibel(value: float) -> str:
    return "equal" if math.isinf(value) else f"{value:.1f}"


def _finite(value: object) -> object:
    """The same with ``None`` for numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
