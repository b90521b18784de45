# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways to make random cases and to check answers by plain forward tracing."""

import numpy as np

from glass_refraction import optics
from glass_refraction.optics import tracing


def segments(glass, origin, direction, events):
    """Rays that take the whole path: their indices, and for each stretch its beginnings,
    directions, lengths so far, and lengths of its own (inf for the last)."""
    taken = np.flatnonzero(optics.trace(glass, origin, direction, events).valid)
    rays = tracing.start(glass, origin, direction)[0].take(taken)
    pieces = []
    for event in events:
        meeting = tracing.meet(glass, rays)
        pieces.append((rays.origin, rays.direction, rays.length, meeting.distance))
        rays, _ = tracing.advance(glass, rays, meeting, event)
    pieces.append((rays.origin, rays.direction, rays.length, np.full(len(taken), np.inf)))
    return taken, pieces


def seen_points(rng, glass, eye, directions, events, stretch):
    """Points that are seen for certain: rays are followed, points picked on a stretch."""
    taken, pieces = segments(glass, eye, directions, events)
    origin, direction, _, length = pieces[stretch]
    reach = np.where(np.isfinite(length), length, 10.0 ** rng.uniform(-1.5, 1.0, len(length)))
    part = rng.uniform(0.0, 1.0, len(length))
    return origin + (part * reach)[:, None] * direction, directions[taken]


def aimed(rng, glass, eye, count):
    """Directions from an eye, most of them at the glass."""
    coaxial = not isinstance(glass, optics.FlatGlass)
    if coaxial and glass.medium_at(eye) == 0:
        targets = rng.uniform(-1.0, 1.0, (count, 3)) * glass.radius[0]
        if isinstance(glass, optics.CylinderGlass):
            targets[:, 2] = eye[2] + np.clip(rng.standard_cauchy(count), -30, 30) * np.hypot(
                *eye[:2]
            )
        directions = targets - eye
    else:
        directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def random_glass(rng, kind):
    """A glass of outer size 1 with indices from 1.05 to 2.42, and an eye from 1.05 R to 100 R."""

    def ior():
        return rng.uniform(1.05, 2.42)

    if kind == "flat":
        layers = rng.integers(0, 4)
        glass = optics.FlatGlass(
            tuple(rng.uniform(0.001, 0.3, layers)),
            tuple(ior() for _ in range(layers)),
            1.0 if rng.random() < 0.7 else ior(),
            1.0 if rng.random() < 0.5 else ior(),
        )
        return glass, np.array([*rng.normal(size=2), rng.uniform(-1.5, 1.5)])
    walls = rng.integers(1, 3)
    inner = rng.uniform(0.8, 0.97, walls - 1)
    media = [ior() for _ in range(walls)]
    if walls > 1:
        media[-1] = rng.choice([1.0, 1.333])
    shape = optics.CylinderGlass if kind == "cylinder" else optics.SphereGlass
    glass = shape((1.0, *inner), tuple(media))
    away = rng.normal(size=3) * ((1.0, 1.0, 0.0) if kind == "cylinder" else 1.0)
    away /= np.linalg.norm(away)
    far = 10.0 ** rng.uniform(np.log10(1.05), 2.0) if rng.random() < 0.8 else rng.uniform(0.0, 0.98)
    eye = away * far
    if kind == "cylinder":
        eye[2] = rng.normal()
    return glass, eye


def false_images(glass, path, eye, points, apparent):
    """Number of valid images whose forward-traced ray does not pass its point on its stretch at
    the distance given, and the greatest miss as an angle at the eye (miss over distance)."""
    false, worst = 0, 0.0
    for slot, stretch in enumerate(apparent.stretch):
        shown = np.flatnonzero(apparent.valid[slot])
        if not len(shown):
            continue
        taken, pieces = segments(glass, eye, apparent.direction[slot, shown], path)
        false += len(shown) - len(taken)
        origin, direction, length, reach = pieces[stretch]
        towards = points[shown[taken]] - origin
        along = np.sum(towards * direction, axis=1)
        miss = np.linalg.norm(towards - along[:, None] * direction, axis=1)
        distance = apparent.distance[slot, shown[taken]]
        worst = max(worst, float((miss / distance).max(initial=0.0)))
        outside = (along < -1e-9) | (along > reach * (1.0 + 1e-9) + 1e-9)
        wrong = np.abs(length + along - distance) > 1e-8 * distance
        false += int(np.sum(outside | wrong))
    return false, worst


def missing_images(directions, stretch, apparent):
    """Number of known images (N, 3) that a result does not hold."""
    off = np.linalg.norm(apparent.direction - directions[None], axis=2)
    off = np.where(apparent.valid & (apparent.stretch == stretch)[:, None], off, np.inf)
    return int(np.sum(off.min(axis=0) > 1e-7))
