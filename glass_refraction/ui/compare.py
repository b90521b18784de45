# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare: the frame held against real glass in Cycles, while Blender's windows go on."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene.names import RefractiveGlassError, own

PICTURE = "comparison.png"
"""The strip, of the files that a comparison writes."""
LOOK_SECONDS = 0.1
"""Between two looks at whether a render has ended."""
_TROUBLE = (RefractiveGlassError, RuntimeError, OSError)


class SCENE_OT_refractive_glass_compare(bpy.types.Operator):
    """Render the frame again with real glass in Cycles, and show both pictures and their \
difference"""

    bl_idname = "scene.refractive_glass_compare"
    bl_label = "Compare with Cycles"

    directory: bpy.props.StringProperty(
        name="Folder", description="Where pictures and report are written", subtype="DIR_PATH"
    )
    samples: bpy.props.IntProperty(
        name="Samples",
        description="Of both pictures; 0 takes the scene's own number",
        default=0,
        min=0,
    )
    filter_folder: bpy.props.BoolProperty(
        name="Folders",
        description="Whether the file browser lists folders only",
        default=True,
        options={"HIDDEN", "SKIP_SAVE"},
    )

    _chosen = False
    """Whether the folder was asked for, and Blender calls with the answer."""
    _steps = None
    _said: str | None = None
    """What the status bar says; renders that go on say their own there."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if own(context.scene):
            cls.poll_message_set(_rpt("This scene is made by the extension: choose your own"))
            return False
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set(_rpt("A render is going on: wait for its end"))
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        # The reference is a tool of its own; nothing of it loads before it is asked for.
        from ..reference.compare import check_comparable

        try:
            check_comparable(context.scene)
        except RefractiveGlassError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.properties.is_property_set("directory"):
            return self._begin(context)
        self._chosen = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self._chosen:
            return bpy.ops.scene.refractive_glass_compare(
                "INVOKE_DEFAULT", directory=self.directory, samples=self.samples
            )
        from ..reference.compare import compare

        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            found = compare(
                context.scene,
                self._folder(),
                samples=self.samples or None,
                progress=lambda share, _label: manager.progress_update(int(100 * share)),
            )
        except _TROUBLE as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            manager.progress_end()
        return self._end(found)

    def _folder(self) -> Path:
        return Path(bpy.path.abspath(self.directory or "//refractive_glass_compare"))

    def _end(self, found: dict) -> set[str]:
        said = _rpt("PSNR {:.1f} dB, report in {}").format(found["psnr_db"], self._folder())
        self.report({"INFO"}, said)
        return {"FINISHED"}

    def _begin(self, context: bpy.types.Context) -> set[str]:
        """Start what :meth:`modal` goes on with."""
        from ..reference.compare import comparing

        self._steps = comparing(
            context.scene,
            self._folder(),
            samples=self.samples or None,
            progress=lambda share, label: self._tell(context, share, label),
        )
        self._work: Future | None = None
        self._stopped = False
        self._threads = ThreadPoolExecutor(max_workers=1)
        view = context.preferences.view
        self._display = view.render_display_type
        # The pictures go on to the comparison; Blender's status bar shows how far each is.
        view.render_display_type = "NONE"
        manager = context.window_manager
        self._timer = manager.event_timer_add(LOOK_SECONDS, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def _tell(self, context: bpy.types.Context, share: float, label: str) -> None:
        context.window_manager.progress_update(int(100 * share))
        self._said = _rpt("Compare ({:.0%}): {}   Esc: cancel").format(share, _rpt(label))

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # A render that goes on takes Esc for itself, and ends without a picture.
        if event.type == "ESC":
            self._stopped = True
        if event.type == "TIMER" and self._said is not None:
            context.workspace.status_text_set(self._said)
        if event.type != "TIMER" or bpy.app.is_job_running("RENDER"):
            return {"RUNNING_MODAL"}
        if self._work is not None and not self._work.done():
            return {"RUNNING_MODAL"}
        if self._stopped:
            self.cancel(context)
            self.report({"WARNING"}, _rpt("The comparison was cancelled"))
            return {"CANCELLED"}
        try:
            value, self._work = None if self._work is None else self._work.result(), None
            self._ask(self._steps.send(value))
        except StopIteration as end:
            self.cancel(context)
            path = self._folder() / PICTURE
            # A window that opens within a modal operator keeps the operator from ending.
            bpy.app.timers.register(lambda: show_picture(path), first_interval=0.0)
            return self._end(end.value)
        except _TROUBLE as error:
            self.cancel(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except BaseException:
            # Whatever it is: the scene must not be left as it is rendered for a comparison.
            self.cancel(context)
            raise
        return {"RUNNING_MODAL"}

    def _ask(self, request) -> None:
        """Begin what the steps ask for; it goes on while Blender draws."""
        if isinstance(request, bpy.types.Scene):
            bpy.ops.render.render("INVOKE_DEFAULT", write_still=True, scene=request.name)
        else:
            self._work = self._threads.submit(request)

    def cancel(self, context: bpy.types.Context) -> None:
        """Leave all as it was. Also called by Blender, when it closes the operator's window, and
        where no folder was chosen."""
        if self._steps is None:
            return
        self._steps.close()
        self._threads.shutdown()
        context.preferences.view.render_display_type = self._display
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def show_picture(path: Path) -> None:
    """Show a file in an Image Editor: one that is open, else in a new window."""
    image = bpy.data.images.load(str(path), check_existing=True)
    image.reload()
    manager = bpy.context.window_manager
    places = [
        (w, a) for w in manager.windows for a in w.screen.areas if a.ui_type == "IMAGE_EDITOR"
    ]
    if not places:
        with bpy.context.temp_override(window=manager.windows[0]):
            bpy.ops.wm.window_new()
        window = manager.windows[-1]
        places = [(window, window.screen.areas[0])]
    window, area = places[0]
    area.ui_type = "IMAGE_EDITOR"
    area.spaces.active.image = image
    region = next(r for r in area.regions if r.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)


register, unregister = bpy.utils.register_classes_factory((SCENE_OT_refractive_glass_compare,))
