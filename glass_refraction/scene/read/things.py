# SPDX-License-Identifier: GPL-3.0-or-later
"""The things that a glass's rays may meet: before it, between glasses, and in it."""

from __future__ import annotations

import bpy
import numpy as np

from ...optics.axial import TOUCHING
from .glasses import Glass
from .mesh_arrays import read_triangles
from .obstacles import Obstacle
from .sources import pieces, world_positions
from .viewpoint import Viewpoint


def obstacle_of(source: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Obstacle | None:
    """A source for rays to meet; None if it has no triangle."""
    with pieces(source, depsgraph) as parts:
        corners = read_triangles(parts)
        return Obstacle(world_positions(parts), corners) if len(corners) else None


def may_hide(thing: Obstacle, view: Viewpoint, rect, depth: float) -> bool:
    """Whether a thing may stand before a glass.

    Parameters
    ----------
    rect : (x0, y0, x1, y1) pixels that the glass can cover.
    depth : along the view direction, metres: where the glass ends.
    """
    clip = view.clip(thing.box())
    if clip[:, 3].min() > depth:
        return False
    if clip[:, 2].min() <= 0:
        # It passes the eye: where it is seen its corners do not tell.
        return True
    places = clip[:, :2] / clip[:, 2:3] * view.size
    return bool((places.min(axis=0) < rect[2:]).all() and (places.max(axis=0) > rect[:2]).all())


def body_corners(glass: Glass) -> np.ndarray:
    """The corners (8, 3), in the world, of a box round a glass that is a body."""
    box = glass.description.box
    return glass.points_to_world(np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))


def within(thing: Obstacle, glass: Glass) -> bool:
    """Whether a thing may reach into a glass that is a body, or touch it."""
    corners, skin = body_corners(glass), TOUCHING * glass.description.scale
    return thing.overlaps(corners.min(axis=0) - skin, corners.max(axis=0) + skin)
