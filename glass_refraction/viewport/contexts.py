# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose GPU context is current: each of Blender's windows has one, and views are drawn in another.

Textures are shared between them, frame buffers are not. A timer finds the context of the window
that was drawn last, and that is another one once a render has opened its own window.
"""

from __future__ import annotations

import gpu


def is_any() -> bool:
    """Whether a context is current. Once a window was closed none is, until one is drawn; Blender
    5.2 crashes where the state of none is asked for."""
    try:
        gpu.types.GPUTexture((1, 1))
    except RuntimeError:
        return False
    return True


class Home:
    """The context that is current when this is made, to be told from others.

    Between redraws a window's own frame buffer is bound. Nothing else is bound to find out: what
    is made in the context of a window that is closed later would be freed twice.
    """

    def __init__(self) -> None:
        self._framebuffer = gpu.state.active_framebuffer_get()

    def is_current(self) -> bool:
        """Whether this context is current, so that its frame buffers may be used."""
        try:
            return self._framebuffer.is_bound
        except ReferenceError:
            # Its window is closed.
            return False
