# SPDX-License-Identifier: GPL-3.0-or-later
"""Refractive Glass: the door by which Blender loads the extension.

Nothing is imported before Blender asks to register: test runners read this file too.
"""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from . import glass_refraction

    glass_refraction.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    from . import glass_refraction

    glass_refraction.unregister()
