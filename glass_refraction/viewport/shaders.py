# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled shaders, and what else on the GPU all views share.

They are let go when the extension is switched off, which Blender also does while it quits: they
must not outlive the GPU's context.
"""

from __future__ import annotations

kept: dict[object, object] = {}
"""By name."""
