# SPDX-License-Identifier: GPL-3.0-or-later
"""What a render's thread has the main thread do."""

import threading
import time

import pytest

from glass_refraction.scene import progress


def _asked(work):
    """A thread that asks for work, and what comes of it, once there is an end."""
    found = []

    def ask():
        try:
            found.append(progress.in_main_thread(work))
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    return thread, found


def _until_over(thread, serve=lambda: None):
    end = time.monotonic() + 10.0
    while thread.is_alive() and time.monotonic() < end:
        serve()
        time.sleep(0.005)
    assert not thread.is_alive()


def test_work_is_done_in_the_main_thread_and_waited_for():
    where = []
    thread, found = _asked(lambda: where.append(threading.current_thread()))
    _until_over(thread, progress.run_errands)
    assert where == [threading.main_thread()] and found == [True]
    # There it is done at once.
    assert progress.in_main_thread(lambda: where.append(None)) and len(where) == 2


def test_errors_are_raised_where_work_was_asked_for():
    def fail():
        raise KeyError("no such mesh")

    thread, found = _asked(fail)
    _until_over(thread, progress.run_errands)
    assert isinstance(found[0], KeyError)
    with pytest.raises(KeyError):
        progress.in_main_thread(fail)


def test_a_main_thread_without_time_does_it_no_more(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE_SECONDS", 0.05)
    done = []
    thread, found = _asked(lambda: done.append(1))
    _until_over(thread)
    progress.run_errands()
    assert found == [False] and not done


def test_who_is_stopped_waits_no_longer():
    done = []
    progress.ask_to_stop()
    try:
        thread, found = _asked(lambda: done.append(1))
        _until_over(thread)
    finally:
        progress.go_on()
    progress.run_errands()
    assert isinstance(found[0], progress.Stopped) and not done
