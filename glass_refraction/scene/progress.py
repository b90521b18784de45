# SPDX-License-Identifier: GPL-3.0-or-later
"""What an update is at: told where it is computed, read where it is shown. And how it is stopped.

A render computes in a thread of its own, and Blender lets the main thread alone touch windows. Esc
comes in there, and Blender tells no thread of Python's that it was pressed. What 3D views have
evaluated may be written there only, too: they may be reading it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

PATIENCE_SECONDS = 3.0
"""So long a render waits for the main thread, which may be drawing or ending that render."""
_ASK_SECONDS = 0.02

_doing: str | None = None
_stopping = False
_here = threading.local()


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
    given_up = getattr(_here, "given_up", None)
    if _stopping or (given_up is not None and given_up.is_set()):
        raise Stopped


def given_up_by(given_up: threading.Event, work: Callable[[], object]) -> object:
    """Do work that is stopped, too, when an event tells that nobody waits for it any more."""
    _here.given_up = given_up
    return work()


def tell(doing: str | None) -> None:
    """Say in words what comes next; None: nothing of ours goes on. Raises :class:`Stopped`."""
    global _doing
    _doing = doing
    if doing is not None:
        check()


def doing() -> str | None:
    """What goes on."""
    return _doing


class _Errand:
    """Work for the main thread, and whether it was done."""

    def __init__(self, work: Callable[[], None]) -> None:
        self.work, self.done = work, threading.Event()
        self.error: Exception | None = None

    def run(self) -> None:
        try:
            self.work()
        except Exception as error:
            # Raised where it was asked for.
            self.error = error
        self.done.set()


_errands: deque[_Errand] = deque()


def in_main_thread(work: Callable[[], None]) -> bool:
    """Do something in the main thread, whichever calls; False if that had no time for it.

    Raises :class:`Stopped`, and what the work raises.
    """
    errand = _Errand(work)
    if threading.current_thread() is threading.main_thread():
        errand.run()
    else:
        _errands.append(errand)
        _wait_for(errand)
    if errand.error is not None:
        raise errand.error
    return errand.done.is_set()


def _wait_for(errand: _Errand) -> None:
    end = time.monotonic() + PATIENCE_SECONDS
    try:
        while not errand.done.wait(_ASK_SECONDS):
            check()
            if time.monotonic() > end:
                return
    finally:
        try:
            _errands.remove(errand)
        except ValueError:
            # The main thread has taken it, and writes what nobody else may read meanwhile.
            errand.done.wait()


def run_errands() -> None:
    """Do what :func:`in_main_thread` waits for. For the main thread."""
    while True:
        try:
            errand = _errands.popleft()
        except IndexError:
            return
        errand.run()
