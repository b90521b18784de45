# SPDX-License-Identifier: GPL-3.0-or-later
"""Profile curves of glasses of revolution."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np

from .lathe import Lathe

# Radius and height of a wine glass, metres: foot, stem, bowl; and the bowl's inside.
WINE_OUTSIDE = (
    (0.0, 0.0), (0.020, 0.0004), (0.0325, 0.0012), (0.0335, 0.0022), (0.030, 0.0034),
    (0.015, 0.0060), (0.0055, 0.0120), (0.0038, 0.0300), (0.0038, 0.0650), (0.0060, 0.0780),
    (0.0200, 0.0900), (0.0335, 0.1120), (0.0370, 0.1350), (0.0345, 0.1600), (0.0305, 0.1850),
)  # fmt: skip
WINE_INSIDE = (
    (0.0, 0.0845), (0.0110, 0.0866), (0.0190, 0.0915), (0.0320, 0.1130), (0.0354, 0.1350),
    (0.0330, 0.1600), (0.0291, 0.1850),
)  # fmt: skip


# The same of a bottle and of a vase. Points stand close where a straight side ends.
BOTTLE = (
    ((0.0, 0.0), (0.0300, 0.0), (0.0355, 0.0040), (0.0370, 0.0120), (0.0370, 0.0200),
     (0.0370, 0.1700), (0.0370, 0.1800), (0.0340, 0.2000), (0.0220, 0.2250), (0.0155, 0.2450),
     (0.0140, 0.2600), (0.0140, 0.3000)),
    ((0.0, 0.0060), (0.0270, 0.0060), (0.0328, 0.0096), (0.0345, 0.0160), (0.0345, 0.0220),
     (0.0345, 0.1700), (0.0345, 0.1795), (0.0316, 0.1985), (0.0196, 0.2235), (0.0130, 0.2445),
     (0.0115, 0.2600), (0.0115, 0.3000)),
)  # fmt: skip
VASE = (
    ((0.0, 0.0), (0.0350, 0.0), (0.0400, 0.0045), (0.0500, 0.0300),
     (0.0600, 0.0800), (0.0620, 0.1100), (0.0550, 0.1500), (0.0400, 0.1900), (0.0360, 0.2150),
     (0.0420, 0.2400), (0.0500, 0.2500)),
    ((0.0, 0.0100), (0.0320, 0.0100), (0.0366, 0.0140), (0.0458, 0.0310),
     (0.0560, 0.0805), (0.0580, 0.1100), (0.0512, 0.1484), (0.0362, 0.1884), (0.0320, 0.2150),
     (0.0386, 0.2424), (0.0470, 0.2500)),
)  # fmt: skip
BALL, BALL_WALL, BALL_FOOT, BALL_OPENING, BALL_FLOOR = 0.15, 0.004, 0.09, 0.09, 0.006
"""A fish bowl, metres: radius, wall, radii of foot and opening, thickness of the floor."""
LENS_CURVE, LENS_RADIUS, LENS_EDGE = 0.08, 0.04, 0.001
"""A lens, metres: radius of both faces, radius of the rim, half its thickness there."""
ARC_POINTS = 13
"""Of an arc of a bowl or a lens: less than 10° from one to the next."""

CORNER = math.radians(35.0)
"""Turn of a profile's sides from which on a point is a corner."""


def _arc(radius: float, centre: float, low: float, high: float) -> list[tuple[float, float]]:
    """Points of a circle about (0, centre), from height to height, radius and height."""
    begin, end = (math.asin((height - centre) / radius) for height in (low, high))
    angles = np.linspace(begin, end, ARC_POINTS)
    return [(radius * math.cos(a), centre + radius * math.sin(a)) for a in angles]


def _bowl() -> tuple:
    centre = math.sqrt(BALL**2 - BALL_FOOT**2)
    rim = centre + math.sqrt(BALL**2 - BALL_OPENING**2)
    outside = [(0.0, 0.0), *_arc(BALL, centre, 0.0, rim)]
    return outside, [(0.0, BALL_FLOOR), *_arc(BALL - BALL_WALL, centre, BALL_FLOOR, rim)]


def _lens() -> tuple:
    deep = LENS_CURVE - math.sqrt(LENS_CURVE**2 - LENS_RADIUS**2)
    top = LENS_EDGE + deep
    above = _arc(LENS_CURVE, top - LENS_CURVE, LENS_EDGE, top)
    above[-1] = (0.0, top)
    return ([*((radius, -height) for radius, height in reversed(above)), *above],)


PROFILES = {
    "WINE": (WINE_OUTSIDE, WINE_INSIDE),
    "BOTTLE": BOTTLE,
    "VASE": VASE,
    "BOWL": _bowl(),
    "LENS": _lens(),
}
"""Everyday profiles: the outside and, if it is hollow, the inside, from the axis up."""


def form_profile(
    glass: bpy.types.Object, form: str, height: float | None = None
) -> bpy.types.Object:
    """A new curve object with a profile of ``PROFILES``, beside a glass and not rendered.

    ``height`` : metres; None: as the profile has it.
    """
    own = float(np.ptp(np.array(PROFILES[form][0])[:, 1]))
    factor = 1.0 if height is None else height / own
    sides = tuple(factor * np.array(side) for side in PROFILES[form])
    if form != "WINE":
        return _profile(glass, sides)
    data = _curve()
    for points in sides:
        spline = data.splines.new("BEZIER")
        spline.bezier_points.add(len(points) - 1)
        for point, (radius, height) in zip(spline.bezier_points, points, strict=True):
            point.co = (radius, 0.0, height)
            point.handle_left_type = point.handle_right_type = "AUTO"
        # Level where it meets the axis: no cone's tip.
        first = spline.bezier_points[0]
        first.handle_left_type = first.handle_right_type = "ALIGNED"
        step = points[1][0] / 3.0
        first.handle_right = (step, 0.0, points[0][1])
        first.handle_left = (-step, 0.0, points[0][1])
    return _beside(glass, data)


def turned_profile(glass: bpy.types.Object, lathe: Lathe) -> bpy.types.Object:
    """A new curve object with the profile of a turned mesh, beside its glass and not rendered.

    It runs through the mesh's points, smooth but where the mesh has a corner.
    """
    return _profile(glass, (lathe.outer, lathe.inner))


def _profile(glass: bpy.types.Object, sides: Sequence[np.ndarray | None]) -> bpy.types.Object:
    """A curve through points (K, 2) of each side, smooth but at corners, beside its glass."""
    data = _curve()
    for points in sides:
        if points is None:
            continue
        spline = data.splines.new("BEZIER")
        spline.bezier_points.add(len(points) - 1)
        handles = zip(spline.bezier_points, *_handles(points), strict=True)
        for point, left, place, right in handles:
            point.handle_left_type = point.handle_right_type = "FREE"
            point.co = (place[0], 0.0, place[1])
            point.handle_left = (left[0], 0.0, left[1])
            point.handle_right = (right[0], 0.0, right[1])
    return _beside(glass, data)


def _handles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left handles, points and right handles (K, 2) of a curve through points (K, 2)."""
    steps = np.diff(points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    ways = steps / length[:, None]
    # On the axis the other half of the turned body goes on: its side is the mirror image.
    mirror = np.array((1.0, -1.0))
    before = np.concatenate((ways[:1] * mirror if points[0, 0] == 0.0 else ways[:1], ways))
    behind = np.concatenate((ways, ways[-1:] * mirror if points[-1, 0] == 0.0 else ways[-1:]))
    smooth = np.einsum("nk,nk->n", before, behind) > np.cos(CORNER)
    mean = before + behind
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    left, right = (np.where(smooth[:, None], mean, way) for way in (before, behind))
    thirds = np.concatenate((length[:1], length, length[-1:]))[:, None] / 3.0
    return points - left * thirds[:-1], points, points + right * thirds[1:]


def _curve() -> bpy.types.Curve:
    data = bpy.data.curves.new("Glass Profile", "CURVE")
    data.dimensions = "3D"
    return data


def _beside(glass: bpy.types.Object, data: bpy.types.Curve) -> bpy.types.Object:
    """The curve as an object that moves with a glass and is not rendered."""
    profile = bpy.data.objects.new("Glass Profile", data)
    for collection in glass.users_collection:
        collection.objects.link(profile)
    profile.parent = glass
    profile.hide_render = True
    return profile
