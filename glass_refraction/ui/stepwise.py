# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that work in steps while Blender's windows go on: progress, Esc and tidying up."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import closing

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene.names import RefractiveGlassError
from ..scene.steps import Step
from ..viewport.jobs import holds_data

SLICE_SECONDS = 0.05
"""An operator goes on with short steps for so long before windows are drawn again."""
TROUBLE = (RefractiveGlassError, RuntimeError, OSError)
"""What is reported in a line; all else is a fault of the extension's."""

Steps = Generator[Step | None, None, object]
"""The steps of an operator: each tells how far the work is and what comes next.

It may be closed at each and leaves all as it was then. None in place of a step: something goes on
elsewhere, there is nothing to do before the next look, and closing must wait."""


def _alone(steps: Steps) -> Steps:
    """The steps, none of them while a render or the compositor reads what they would write.

    One that works already is a reason not to begin; another window may begin one later.
    """
    if holds_data():
        raise RefractiveGlassError(_rpt("A render is going on: wait for its end"))
    with closing(steps):
        while True:
            try:
                step = next(steps)
            except StopIteration as end:
                return end.value
            yield step
            while holds_data():
                yield None


_going: list[Stepwise] = []
"""Operators whose work is not done."""


class Stepwise:
    """What such an operator has beside its properties: a subclass gives `_steps` and `_end`."""

    look_seconds = 0.01
    """Between two times that it works, in which windows are drawn."""
    _work: Steps | None = None
    _timer = None
    _said: str | None = None
    """What the status bar says; renders that go on say their own there."""
    _is_modal = _waits = _stopped = False

    def _steps(self, context: bpy.types.Context) -> Steps:
        """The work; what it returns goes to `_end`."""
        raise NotImplementedError

    def _end(self, found) -> set[str]:
        """Report what was found."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        """Begin; :meth:`modal` goes on."""
        self._is_modal = True
        self._work = _alone(self._steps(context))
        try:
            self._tell(context, next(self._work))
        except TROUBLE as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(self.look_seconds, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        _going.append(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """All steps at once, for scripts and without a window."""
        work = _alone(self._steps(context))
        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            while True:
                step = next(work)
                if step is None:
                    time.sleep(self.look_seconds)
                else:
                    manager.progress_update(int(100 * step.share))
        except StopIteration as end:
            return self._end(end.value)
        except TROUBLE as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            manager.progress_end()

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Do some steps, or stop where Esc was pressed."""
        if event.type == "ESC":
            self._stopped = True
        elif event.type != "TIMER":
            return {"RUNNING_MODAL"}
        until = time.perf_counter() + SLICE_SECONDS
        try:
            while True:
                if self._stopped and not self._waits:
                    self.cancel(context)
                    self.report({"WARNING"}, _rpt("{}: cancelled").format(_rpt(self.bl_label)))
                    return {"CANCELLED"}
                self._tell(context, next(self._work))
                if self._waits or time.perf_counter() >= until:
                    return {"RUNNING_MODAL"}
        except StopIteration as end:
            self.cancel(context)
            return self._end(end.value)
        except TROUBLE as error:
            self.cancel(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except BaseException:
            # A fault: the status bar and the timer must not stay.
            self.cancel(context)
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Leave all as it was. Blender calls it too, when it closes the operator's window."""
        if self._timer is None:
            return
        self._work.close()
        _going.remove(self)
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        self._timer = None
        manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)

    def stop(self) -> None:
        """As Esc does. What nothing waits for ends at once, while scenes still have settings."""
        self._stopped = True
        if not self._waits:
            self._work.close()

    def _tell(self, context: bpy.types.Context, step: Step | None) -> None:
        self._waits = step is None
        if step is not None:
            context.window_manager.progress_update(int(100 * step.share))
            self._said = _rpt("{}: {} ({:.0%})   Esc: cancel").format(
                _rpt(self.bl_label), _rpt(step.label), step.share
            )
        if context.workspace is not None:
            context.workspace.status_text_set(self._said)


def stop_all() -> None:
    """Stop what goes on."""
    for operator in list(_going):
        operator.stop()
