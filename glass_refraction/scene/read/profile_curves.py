# SPDX-License-Identifier: GPL-3.0-or-later
"""Profile curves of glasses of revolution."""

from __future__ import annotations

import math

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


CORNER = math.radians(35.0)
"""Turn of a profile's sides from which on a point is a corner."""


def wine_profile(glass: bpy.types.Object) -> bpy.types.Object:
    """A new curve object with the profile of a wine glass, beside a glass and not rendered."""
    data = _curve()
    for points in (WINE_OUTSIDE, WINE_INSIDE):
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
    data = _curve()
    for points in (lathe.outer, lathe.inner):
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
