# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that the extension registers, in order, and the way back."""

from __future__ import annotations

from . import handlers
from .ui import (
    asset_library,
    bake,
    command,
    compare,
    everyday,
    icons,
    media,
    menus,
    operators,
    overlay,
    panels,
    progress,
    properties,
    starter,
    stepwise,
    translations,
)

_PARTS = (
    translations,
    properties,
    media,
    operators,
    everyday,
    starter,
    bake,
    compare,
    icons,
    menus,
    overlay,
    progress,
    panels,
    asset_library,
    command,
    handlers,
)


def register() -> None:
    """Register all parts."""
    for part in _PARTS:
        part.register()


def unregister() -> None:
    """Stop what goes on and unregister all parts, last first."""
    stepwise.stop_all()
    for part in reversed(_PARTS):
        part.unregister()
