# SPDX-License-Identifier: GPL-3.0-or-later
"""What an update is at: told where it is computed, read where it is shown.

A render computes in a thread of its own, and Blender lets the main thread alone touch windows.
"""

from __future__ import annotations

_doing: str | None = None


def tell(doing: str | None) -> None:
    """Say in words what comes next; None: nothing of ours goes on."""
    global _doing
    _doing = doing


def doing() -> str | None:
    """What goes on."""
    return _doing
