# SPDX-License-Identifier: GPL-3.0-or-later
"""The door of True shading: make what a render needs, and write a frame's values into it."""

from __future__ import annotations

from ..names import RefractiveGlassError


def prepare(scene, depsgraph, glasses, view, problems) -> None:
    """Make own scenes and nodes of True shading."""
    raise RefractiveGlassError("True shading is being rebuilt: choose Displaced")


def update(scene, depsgraph, view):
    """Write one frame's values."""
    raise RefractiveGlassError("True shading is being rebuilt: choose Displaced")


def remove(scene) -> None:
    """Remove what :func:`prepare` made."""
