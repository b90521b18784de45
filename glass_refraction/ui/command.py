# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender --command refractive_glass COMMAND ...``: the installed extension's command line."""

from __future__ import annotations

import bpy

_handle = None


def _run(arguments: list[str]) -> int:
    # The tools behind the commands load only when one is called.
    from .. import cli

    return cli.main(arguments)


def register() -> None:
    """Register the command."""
    global _handle
    _handle = bpy.utils.register_cli_command("refractive_glass", _run)


def unregister() -> None:
    """Undo :func:`register`."""
    global _handle
    bpy.utils.unregister_cli_command(_handle)
    _handle = None
