# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects seen through glass, computed vertex by vertex with Snell's law.

``glass_refraction.optics`` is pure NumPy and imports without Blender; that is why nothing here
imports ``bpy`` before :func:`register` is called.
"""


def register() -> None:
    """Register the extension's properties, operators, panels and handlers with Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Take everything that :func:`register` registered out of Blender again."""
    from . import registration

    registration.unregister()
