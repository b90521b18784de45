# SPDX-License-Identifier: GPL-3.0-or-later
"""The optics without Blender; the extension registered and taken out again, without a trace."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

needs_bpy = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None, reason="bpy is not installed"
)


def python(code):
    """Run code in a fresh Python at the root of the project."""
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert found.returncode == 0, found.stderr
    return found.stdout


def test_optics_works_where_blender_cannot_be_imported():
    python(
        """
import sys
for name in ("bpy", "mathutils", "bpy_extras"):
    sys.modules[name] = None  # importing it now raises ImportError
import numpy as np
from glass_refraction import optics
glass = optics.FlatGlass((0.01,), (1.5,))
found = optics.apparent_points(glass, "TT", (0, 0, 1), np.array([[0.1, 0.0, -0.5]]))
assert found.valid.all()
"""
    )


def test_root_module_loads_without_blender():
    python(
        """
import sys
sys.modules["bpy"] = None
import importlib.util
spec = importlib.util.spec_from_file_location("extension", "__init__.py",
                                              submodule_search_locations=["."])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
assert callable(module.register) and callable(module.unregister)
"""
    )


SNAPSHOT = """
import bpy

def traces():
    classes = {
        name for name in dir(bpy.types)
        if getattr(getattr(bpy.types, name), "__module__", "").startswith("glass_refraction")
    }
    handlers = {
        (event, getattr(function, "__module__", ""))
        for event in dir(bpy.app.handlers)
        if isinstance(functions := getattr(bpy.app.handlers, event), list)
        for function in functions
    }
    properties = {
        (kind, name)
        for kind in ("Scene", "Object", "Mesh", "Collection", "ViewLayer", "WindowManager",
                     "Camera", "Material", "World", "Image", "NodeTree")
        for name in getattr(bpy.types, kind).bl_rna.properties.keys()
    }
    menus = {
        (name, function.__module__, function.__name__)
        for name in dir(bpy.types)
        for function in getattr(getattr(getattr(bpy.types, name), "draw", None), "_draw_funcs", ())
        if function.__module__.startswith("glass_refraction")
    }
    return classes, handlers, properties, menus
"""


@needs_bpy
def test_unregister_leaves_nothing_behind():
    python(
        SNAPSHOT
        + """
import glass_refraction
bpy.ops.wm.read_factory_settings(use_empty=True)
before = traces()
glass_refraction.register()
during = traces()
assert all(len(a) > len(b) for a, b in zip(during, before, strict=True)), "the test sees nothing"
# Shaders that outlive Blender's graphics crash it as it quits.
from glass_refraction.viewport import shaders
shaders.kept["one"] = "compiled"
glass_refraction.unregister()
assert traces() == before
assert not shaders.kept
"""
    )


@needs_bpy
def test_registers_again_after_unregister():
    python(
        """
import bpy, glass_refraction
for _ in range(3):
    glass_refraction.register()
    bpy.ops.object.refractive_glass_add()
    glass_refraction.unregister()
"""
    )


@needs_bpy
def test_handlers_live_through_loading_a_file():
    python(
        SNAPSHOT
        + """
import glass_refraction
glass_refraction.register()
before = traces()
bpy.ops.wm.read_factory_settings(use_empty=True)
assert {h for h in before[1] if h[1].startswith("glass")} <= traces()[1]
"""
    )
