# SPDX-License-Identifier: GPL-3.0-or-later
"""What an update is at: told where it is computed, read where it is shown. And how it is stopped.

A render computes in a thread of its own, and Blender lets the main thread alone touch windows. Esc
comes in there, and Blender tells no thread of Python's that it was pressed.
"""

from __future__ import annotations

_doing: str | None = None
_stopping = False


class Stopped(Exception):
    """Esc was pressed: nobody waits for what is computed."""


def go_on() -> None:
    """A render begins or has ended: an Esc that was pressed before does not count any more."""
    global _stopping
    _stopping = False


def ask_to_stop() -> None:
    """Have the next :func:`check` stop what is computed. For the main thread."""
    global _stopping
    _stopping = True


def check() -> None:
    """Raise :class:`Stopped` where that was asked for. Called all few tenths of a second."""
    if _stopping:
        raise Stopped


def tell(doing: str | None) -> None:
    """Say in words what comes next; None: nothing of ours goes on. Raises :class:`Stopped`."""
    global _doing
    _doing = doing
    if doing is not None:
        check()


def doing() -> str | None:
    """What goes on."""
    return _doing
