# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures rendered by Blender as arrays of full floats, bottom row first."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import bpy
import numpy as np

_OUTPUT = {
    "filepath": None,
    "use_file_extension": True,
    "use_overwrite": True,
    "use_placeholder": False,
    "use_stamp": False,
}
# The media type decides which formats, and the format which depths and modes, can be set.
_FORMAT = {
    "media_type": "IMAGE",
    "file_format": "OPEN_EXR",
    "color_mode": "RGBA",
    "color_depth": "32",
    "exr_codec": "ZIP",
    "color_management": "FOLLOW_SCENE",
}


Request = bpy.types.Scene | Callable[[], object]
"""What steps ask for: that a scene's still is rendered and written, or that a function is called.

A function touches no data of Blender's, so that it may run in a thread. Its value is sent back.
"""


def render_picture(scene: bpy.types.Scene) -> np.ndarray:
    """Render the scene's current frame as its settings say and return what would be saved.

    Returns
    -------
    (H, W, 4) float32, linear scene-referred RGBA, alpha premultiplied, bottom row first.

    Raises
    ------
    RuntimeError
        The render was cancelled or wrote no file.
    """
    return finished(rendering_picture(scene))


def rendering_picture(scene: bpy.types.Scene) -> Generator[Request, object, np.ndarray]:
    """:func:`render_picture` in steps, for who lets Blender's window go on meanwhile."""
    with tempfile.TemporaryDirectory(prefix="refractive_glass_") as folder:
        path = Path(folder) / "picture.exr"
        with _output_to(scene, path):
            yield scene
        if not path.exists():
            raise RuntimeError(f'the render of scene "{scene.name}" was cancelled')
        return load_picture(path)


class Requests:
    """What steps ask for, one after the other.

    Attributes
    ----------
    answer : to the last request; set before the next one is taken.
    result : what the steps ended with.
    """

    def __init__(self, steps: Generator[Request, object, object]) -> None:
        self._steps = steps
        self.answer: object = None
        self.result: object = None

    def __iter__(self) -> Iterator[Request]:
        while True:
            try:
                request = self._steps.send(self.answer)
            except StopIteration as end:
                self.result = end.value
                return
            self.answer = None
            yield request


def finished(steps: Generator[Request, object, object]) -> object:
    """What steps end with, where each request is met at once."""
    requests = Requests(steps)
    # Whatever fails meanwhile, what the steps put in place is taken back here and now: later
    # Python would close them at some time of its own, when the file may be another one.
    with closing(steps):
        for request in requests:
            if isinstance(request, bpy.types.Scene):
                bpy.ops.render.render(write_still=True, scene=request.name)
            else:
                requests.answer = request()
    return requests.result


def load_picture(path: Path | str) -> np.ndarray:
    """Colours of an OpenEXR file, (H, W, 4) float32, linear, bottom row first."""
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(height, width, image.channels)
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _output_to(scene: bpy.types.Scene, path: Path) -> Iterator[None]:
    """Let renders of the scene write 32-bit OpenEXR to the path; the user's settings come back."""
    output = dict(_OUTPUT, filepath=str(path))
    if hasattr(scene.render, "save_output"):  # since Blender 5.2
        output["save_output"] = True
    picture_format = scene.render.image_settings
    kept = {name: getattr(scene.render, name) for name in output}
    kept_format = {
        p.identifier: getattr(picture_format, p.identifier)
        for p in picture_format.bl_rna.properties
        if not p.is_readonly
    }
    try:
        _assign(scene.render, output)
        _assign(picture_format, _FORMAT)
        yield
    finally:
        _assign(scene.render, kept)
        leading = {name: kept_format.pop(name) for name in list(_FORMAT)[:2]}
        _assign(picture_format, leading | kept_format)


def _assign(settings: bpy.types.bpy_struct, values: dict[str, object]) -> None:
    for name, value in values.items():
        setattr(settings, name, value)
