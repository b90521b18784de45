# SPDX-License-Identifier: GPL-3.0-or-later
"""What all tests share: Blender as it comes from the factory, an empty file for each test.

Only modules that import ``bpy`` get it: the optics' tests run where Blender is not installed.
"""

import atexit
import os
import shutil
import tempfile
from collections import Counter

import pytest

# The user's own preferences, start-up file and extensions are none of the tests' business; an
# installed copy of this very extension would even be tested in place of the checkout.
_resources = tempfile.mkdtemp(prefix="refractive_glass_tests_")
atexit.register(shutil.rmtree, _resources, ignore_errors=True)
os.environ["BLENDER_USER_RESOURCES"] = _resources

_LONG = ("real_blender/", "/test_no_harm.py", "/test_growth.py", "/test_mesh_scene.py")
"""Parts of the names of files that take long."""
_HALF = ("real_blender/test_viewport.py", "real_blender/test_no_harm.py")
"""As long as all others there together."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Several processes share the files among them, each file whole: modules share fixtures.

    The real Blender's are two parts: it is installed for each, and then for all of its tests.
    """
    from xdist.scheduler import LoadScopeScheduling

    # By itself a file of few tests comes late, however long they take.
    config.option.loadscopereorder = False

    class Files(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            path = nodeid.split("::", 1)[0]
            if "/real_blender/" not in path:
                return path
            return f"real_blender {path.endswith(_HALF)}"

    return Files(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Long files first: one that begins late leaves other processes with nothing to do.

    Of tests that are marked ``in_turn`` CI runs some of the cases: which ones, the seed says.
    """
    items.sort(key=lambda item: not any(part in str(item.path) for part in _LONG))
    seed = os.environ.get("REFRACTIVE_GLASS_SEED")
    if seed:
        left_out = set(_left_out(items, int(seed)))
        config.hook.pytest_deselected(items=[item for item in items if item in left_out])
        items[:] = [item for item in items if item not in left_out]


def _left_out(items, seed: int):
    """The cases whose turn it is not, of tests that are marked ``in_turn(parts)``."""
    seen = Counter()
    for item in items:
        mark = item.get_closest_marker("in_turn")
        if mark is not None:
            test = item.nodeid.split("[", 1)[0]
            if (seen[test] + seed) % mark.args[0]:
                yield item
            seen[test] += 1


def _register(bpy) -> None:
    import glass_refraction

    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()


def _keeps_file(module) -> bool:
    marks = getattr(module, "pytestmark", [])
    marks = marks if isinstance(marks, list) else [marks]
    return any(mark.name == "keeps_file" for mark in marks)


@pytest.fixture(scope="module", autouse=True)
def _empty_file_for_the_module(request):
    bpy = getattr(request.module, "bpy", None)
    if bpy is not None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        _register(bpy)


@pytest.fixture(autouse=True)
def _empty_file(request, _empty_file_for_the_module):
    """An empty file with the extension registered, unless the module is marked ``keeps_file``.

    The preferences are the module's: to read those anew takes five times as long.
    """
    bpy = getattr(request.module, "bpy", None)
    if bpy is not None and not _keeps_file(request.module):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        _register(bpy)
