# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewpoints and glasses as the scene's modules take them, without a scene."""

from __future__ import annotations

import numpy as np

from glass_refraction.optics.glasses import Glass as Description
from glass_refraction.scene.read.glasses import Glass
from glass_refraction.scene.read.viewpoint import Viewpoint


def viewpoint(eye, target, focal_px: float, size: tuple[int, int]) -> Viewpoint:
    """A perspective view from `eye` to `target`, metres; z is up."""
    eye = np.asarray(eye, float)
    back = eye - np.asarray(target, float)
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    to_camera = np.eye(4)
    to_camera[:3, :3] = (right, np.cross(back, right), back)
    to_camera[:3, 3] = -to_camera[:3, :3] @ eye
    near, far = 0.01, 100.0
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2.0 * focal_px / size[0], 2.0 * focal_px / size[1]
    projection[2, 2], projection[2, 3] = (near + far) / (near - far), 2 * near * far / (near - far)
    projection[3, 2] = -1.0
    return Viewpoint(eye, to_camera, projection, size, (0, 0, *size), False)


def standing(description: Description) -> Glass:
    """A glass whose frame is the world's."""
    return Glass("Glass", description, np.eye(4))
