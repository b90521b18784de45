# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own tool for extensions, out of the bpy wheel: ``extension.py build|validate …``.

The same as ``blender --command extension …``, for machines where only the wheel is installed.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import bpy


def main() -> None:
    """Run the tool with this command's arguments."""
    tool = Path(bpy.utils.resource_path("LOCAL"), "scripts/addons_core/bl_pkg/cli/blender_ext.py")
    sys.argv[0] = str(tool)
    runpy.run_path(str(tool), run_name="__main__")


if __name__ == "__main__":
    main()
