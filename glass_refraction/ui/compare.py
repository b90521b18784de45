# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare: the frame held against real glass in Cycles, while Blender's windows go on."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene.names import RefractiveGlassError, own
from ..scene.steps import Step
from . import staying
from .stepwise import Steps, Stepwise

PICTURE = "comparison.png"
"""The strip, of the files that a comparison writes."""


class SCENE_OT_refractive_glass_compare(Stepwise, bpy.types.Operator):
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

    look_seconds = 0.1
    _chosen = False
    """Whether the folder was asked for, and Blender calls with the answer."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if own(context.scene):
            cls.poll_message_set(_rpt("This scene is made by the extension: choose your own"))
            return False
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set(_rpt("A render is going on: wait for its end"))
            return False
        return True

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # The reference is a tool of its own; nothing of it loads before it is asked for.
        from ..reference.compare import check_comparable

        try:
            check_comparable(context.scene)
        except RefractiveGlassError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.properties.is_property_set("directory"):
            return super().invoke(context, event)
        self._chosen = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self._chosen:
            return bpy.ops.scene.refractive_glass_compare(
                "INVOKE_DEFAULT", directory=self.directory, samples=self.samples
            )
        return super().execute(context)

    def _folder(self) -> Path:
        return Path(bpy.path.abspath(self.directory or "//refractive_glass_compare"))

    def _end(self, found: dict) -> set[str]:
        said = _rpt("PSNR {:.1f} dB, report in {}").format(found["psnr_db"], self._folder())
        self.report({"INFO"}, said)
        if self._is_modal:
            path = self._folder() / PICTURE
            # A window that opens within a modal operator keeps the operator from ending.
            bpy.app.timers.register(lambda: show_picture(path), first_interval=0.0)
        return {"FINISHED"}

    def _steps(self, context: bpy.types.Context) -> Steps:
        from ..reference.compare import comparing
        from ..reference.picture import Requests

        told = Step(0.0, "preparing")

        def progress(share: float, label: str) -> None:
            nonlocal told
            told = Step(share, label)

        steps = comparing(
            context.scene, self._folder(), samples=self.samples or None, progress=progress
        )
        requests = Requests(steps)
        yield told
        with closing(steps), ThreadPoolExecutor(max_workers=1) as threads, _no_window():
            for request in requests:
                if isinstance(request, bpy.types.Scene):
                    how = "INVOKE_DEFAULT" if self._is_modal else "EXEC_DEFAULT"
                    bpy.ops.render.render(how, write_still=True, scene=request.name)
                    while bpy.app.is_job_running("RENDER"):
                        yield None
                else:
                    work = threads.submit(request)
                    while not work.done():
                        yield None
                    requests.answer = work.result()
                # A place where it may be closed.
                yield told
        return requests.result


@contextmanager
def _no_window() -> Iterator[None]:
    """Let renders open no window: their pictures go on to the comparison."""
    view = bpy.context.preferences.view
    display = view.render_display_type
    # Blender's status bar shows how far each is.
    view.render_display_type = "NONE"
    try:
        yield
    finally:
        view.render_display_type = display


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


register, unregister = staying.classes((SCENE_OT_refractive_glass_compare,))
