# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifier and everyday glasses as assets: libraries in the preferences, by a button."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene.names import NODE_GROUPS, RefractiveGlassError
from ..scene.steps import Step
from . import staying
from .everyday_assets import writing
from .stepwise import Steps, Stepwise

NAME, EVERYDAY = "Refractive Glass", "Everyday Glasses"
_FILE = "everyday.blend"
PAUSE_SECONDS = 0.02
"""Between two looks at whether the file is written."""
_PACKAGE = __package__.removesuffix(".glass_refraction.ui").removesuffix(".ui")


def everyday_folder() -> Path:
    """Where the file of everyday glasses is written: the extension's place for users' files."""
    try:
        return Path(bpy.utils.extension_path_user(_PACKAGE, path="assets"))
    except ValueError:
        # Not installed as an extension.
        return Path(bpy.utils.user_resource("DATAFILES", path="refractive_glass/assets"))


def find_libraries() -> list[bpy.types.UserAssetLibrary]:
    """The extension's libraries in the preferences, whatever their names."""
    folders = (NODE_GROUPS.parent, everyday_folder().resolve())
    return [
        library
        for library in bpy.context.preferences.filepaths.asset_libraries
        if library.path and Path(bpy.path.abspath(library.path)).resolve() in folders
    ]


def remove_libraries() -> bool:
    """Take the libraries out of the preferences; whether any was there."""
    found = find_libraries()
    for path in sorted((library.path for library in found), reverse=True):
        libraries = bpy.context.preferences.filepaths.asset_libraries
        libraries.remove(next(library for library in libraries if library.path == path))
    if found:
        bpy.context.preferences.is_dirty = True
        shutil.rmtree(everyday_folder(), ignore_errors=True)
    return bool(found)


class PREFERENCES_OT_refractive_glass_asset_library_add(Stepwise, bpy.types.Operator):
    """List the Refractive Glass modifier and the everyday glasses in the asset browser, until \
this is taken back or the extension is disabled"""

    bl_idname = "preferences.refractive_glass_asset_library_add"
    bl_label = "Add Refractive Glass Asset Library"
    look_seconds = 0.1

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if find_libraries():
            cls.poll_message_set(_rpt("The asset library is there already"))
            return False
        return True

    def _steps(self, context: bpy.types.Context) -> Steps:
        folder = everyday_folder()
        work = writing(folder / _FILE)
        try:
            while work.poll() is None:
                yield Step(0.0, "the everyday glasses")
                time.sleep(PAUSE_SECONDS)
        finally:
            # Nobody waits for it any more where this was cancelled.
            work.kill()
        if work.returncode:
            raise RefractiveGlassError(f"The everyday glasses could not be written to {folder}")
        filepaths = context.preferences.filepaths
        for name, place in ((NAME, NODE_GROUPS.parent), (EVERYDAY, folder)):
            filepaths.asset_libraries.new(name=name, directory=str(place))
        context.preferences.is_dirty = True

    def _end(self, _found: None) -> set[str]:
        said = _rpt("Listed in the asset browser: {} and {}").format(NAME, EVERYDAY)
        self.report({"INFO"}, said)
        return {"FINISHED"}


class PREFERENCES_OT_refractive_glass_asset_library_remove(bpy.types.Operator):
    """Take the Refractive Glass modifier and the everyday glasses out of the asset browser again; \
files keep theirs"""

    bl_idname = "preferences.refractive_glass_asset_library_remove"
    bl_label = "Remove Refractive Glass Asset Library"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not find_libraries():
            cls.poll_message_set(_rpt("The asset library is not there"))
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        remove_libraries()
        return {"FINISHED"}


class RefractiveGlassPreferences(bpy.types.AddonPreferences):
    """In Edit > Preferences > Add-ons"""

    bl_idname = _PACKAGE

    show_first_glass: bpy.props.BoolProperty(
        name="Show Refraction with the First Glass",
        description="Adding the first glass of a scene switches the refracted picture on in the "
        "3D view where it is added",
        default=True,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.prop(self, "show_first_glass")
        column.label(text="Modifier and everyday glasses in the asset browser")
        here = PREFERENCES_OT_refractive_glass_asset_library_add
        gone = PREFERENCES_OT_refractive_glass_asset_library_remove
        chosen = here if not find_libraries() else gone
        column.operator(chosen.bl_idname, icon="ASSET_MANAGER")


def shows_first_glass(context: bpy.types.Context) -> bool:
    """The setting of that name; its default where the extension is not installed as one."""
    addon = context.preferences.addons.get(_PACKAGE)
    return addon is None or addon.preferences is None or addon.preferences.show_first_glass


_register, _unregister = staying.classes(
    (
        PREFERENCES_OT_refractive_glass_asset_library_add,
        PREFERENCES_OT_refractive_glass_asset_library_remove,
        RefractiveGlassPreferences,
    )
)


def register() -> None:
    """Register the operators and the preferences; the libraries only when asked for."""
    _register()


def unregister() -> None:
    """Undo :func:`register`; the libraries go with the extension."""
    remove_libraries()
    _unregister()
