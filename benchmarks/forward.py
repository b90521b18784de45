# SPDX-License-Identifier: GPL-3.0-or-later
"""Answers held against plain vector refraction, which knows nothing of how they were found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glass_refraction import optics
from glass_refraction.optics import tracing
from glass_refraction.optics.axial import AxialGlass
from glass_refraction.optics.glasses import Glass
from glass_refraction.optics.paths import as_path

FOCAL_PX = 2400.0
"""Pixels a radian at the picture's centre: 1600 pixels across 37 degrees."""


@dataclass(frozen=True)
class Checked:
    """What a trace says of a result.

    Attributes
    ----------
    images : valid images in the result.
    held : images whose ray takes the path and meets its point on its stretch, at its distance.
    errors_px : (images traced,) angle at the eye between the image and where its ray passes.
    """

    images: int
    held: int
    errors_px: np.ndarray

    @property
    def worst_px(self) -> float:
        return float(self.errors_px.max(initial=0.0))


def check(
    glass: Glass,
    path: optics.LightPath | str,
    eye: np.ndarray,
    points: np.ndarray,
    apparent: optics.ApparentPoints,
) -> Checked:
    """Trace every valid image from the eye to its point.

    Of a tumbler or a glass of revolution the last stretch alone (``last=True``).
    """
    images, held, errors = 0, 0, []
    for slot, stretch in enumerate(apparent.stretch):
        shown = np.flatnonzero(apparent.valid[slot])
        images += len(shown)
        if not len(shown):
            continue
        directions = apparent.direction[slot, shown]
        traced = optics.trace(glass, eye, directions, path)
        whole = traced.valid
        shown, directions = shown[whole], directions[whole]
        if isinstance(glass, AxialGlass):
            origin, along_ray, length = (
                part[whole] for part in (traced.origin, traced.direction, traced.length)
            )
            reach = np.inf
        else:
            rays = tracing.start(glass, eye, directions)[0]
            for event in as_path(path).events[:stretch]:
                rays, _ = tracing.advance(glass, rays, tracing.meet(glass, rays), event)
            meeting = tracing.meet(glass, rays)
            origin, along_ray, length = rays.origin, rays.direction, rays.length
            reach = np.where(meeting.met, meeting.distance, np.inf)
        towards = points[shown] - origin
        along = np.einsum("nk,nk->n", towards, along_ray)
        beside = towards - along[:, None] * along_ray
        distance = apparent.distance[slot, shown]
        safe = np.maximum(distance, 1e-300)
        errors.append(FOCAL_PX * np.sqrt(np.einsum("nk,nk->n", beside, beside)) / safe)
        slack = 1e-8 * distance + 1e-12
        there = (along >= -slack) & (along <= reach + slack)
        there &= np.abs(length + along - distance) <= slack
        held += int(there.sum())
    return Checked(images, held, np.concatenate(errors) if errors else np.zeros(0))


def direction_errors(
    found: optics.ApparentPoints, reference: optics.ApparentPoints
) -> tuple[np.ndarray, int]:
    """Angles in pixels between images of two results, sheet by sheet.

    Returns
    -------
    errors_px : (images in both,)
    different : images that only one of them has.
    """
    errors, different = [], 0
    for slot, sheet in enumerate(reference.sheet):
        true = reference.valid[slot]
        if sheet not in found.sheet:
            different += int(true.sum())
            continue
        other = found.sheet.index(sheet)
        both = true & found.valid[other]
        different += int((true != found.valid[other]).sum())
        errors.append(angles_px(found.direction[other, both], reference.direction[slot, both]))
    for other, sheet in enumerate(found.sheet):
        if sheet not in reference.sheet:
            different += int(found.valid[other].sum())
    return (np.concatenate(errors) if errors else np.zeros(0)), different


def angles_px(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles between unit vectors (N, 3) in pixels."""
    chord = np.sqrt(np.einsum("nk,nk->n", one - other, one - other))
    return FOCAL_PX * 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def summary(errors_px: np.ndarray) -> dict[str, float]:
    """Largest, 99.9 % and mean error."""
    if not len(errors_px):
        return {"max_px": 0.0, "p999_px": 0.0, "mean_px": 0.0}
    return {
        "max_px": float(errors_px.max()),
        "p999_px": float(np.quantile(errors_px, 0.999)),
        "mean_px": float(errors_px.mean()),
    }
