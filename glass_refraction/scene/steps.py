# SPDX-License-Identifier: GPL-3.0-or-later
"""An update in steps, and the work of it for which windows need not wait."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

from .progress import given_up_by

WAIT_SECONDS = 0.01
"""Between two looks at whether work is done."""


@dataclass(frozen=True)
class Step:
    """How far an update has come: the part that is done (0 to 1), and what comes next."""

    share: float
    label: str


Work = Callable[[], object]
"""Work that touches nothing of Blender's."""
Do = Callable[[Hashable, str, Work], Future]
"""Does work of a subject; the word says which."""


def at_once(_subject: Hashable, _what: str, work: Work) -> Future:
    """Do the work here and now, and raise what it raises."""
    done: Future = Future()
    done.set_result(work())
    return done


def wait_for(work: Future) -> None:
    """Wait a moment for work to be done."""
    wait((work,), timeout=WAIT_SECONDS)


class Apart:
    """Does one work after another in a thread of its own.

    What was asked for of one subject is not done again until another subject's turn comes: steps
    that wait for it may be begun anew. More is not kept, for some of it is large.
    """

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(max_workers=1)
        self._subject: Hashable = None
        self._works: dict[str, Future] = {}
        self._given_up = threading.Event()

    def __call__(self, subject: Hashable, what: str, work: Work) -> Future:
        if subject != self._subject:
            self._subject, self._works = subject, {}
        if what not in self._works:
            self._works[what] = self._threads.submit(given_up_by, self._given_up, work)
        return self._works[what]

    def goes_on(self) -> bool:
        """Whether work is not done yet, after a moment's wait for it."""
        for work in self._works.values():
            wait_for(work)
        return not all(work.done() for work in self._works.values())

    def close(self) -> None:
        """Wait for nothing more: what is under way ends where it asks whether to go on."""
        self._given_up.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
