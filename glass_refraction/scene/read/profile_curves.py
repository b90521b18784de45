# SPDX-License-Identifier: GPL-3.0-or-later
"""Profile curves of glasses of revolution."""

from __future__ import annotations

import bpy

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


def wine_profile(glass: bpy.types.Object) -> bpy.types.Object:
    """A new curve object with the profile of a wine glass, beside a glass and not rendered."""
    data = bpy.data.curves.new("Glass Profile", "CURVE")
    data.dimensions = "3D"
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
    profile = bpy.data.objects.new("Glass Profile", data)
    for collection in glass.users_collection:
        collection.objects.link(profile)
    profile.parent = glass
    profile.hide_render = True
    return profile
