# SPDX-License-Identifier: GPL-3.0-or-later
"""The modifier as an asset: a library in the preferences, for who asks for it by a button."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as _rpt

from ..scene.names import NODE_GROUPS

NAME = "Refractive Glass"
_PACKAGE = __package__.removesuffix(".glass_refraction.ui").removesuffix(".ui")


def find_library() -> bpy.types.UserAssetLibrary | None:
    """The extension's library in the preferences, whatever its name."""
    for library in bpy.context.preferences.filepaths.asset_libraries:
        if library.path and Path(bpy.path.abspath(library.path)).resolve() == NODE_GROUPS.parent:
            return library
    return None


def remove_library() -> bool:
    """Take the library out of the preferences; whether it was there."""
    library = find_library()
    if library is None:
        return False
    bpy.context.preferences.filepaths.asset_libraries.remove(library)
    bpy.context.preferences.is_dirty = True
    return True


class PREFERENCES_OT_refractive_glass_asset_library_add(bpy.types.Operator):
    """List the Refractive Glass modifier in the asset browser, until this is undone or the \
extension is disabled"""

    bl_idname = "preferences.refractive_glass_asset_library_add"
    bl_label = "Add Refractive Glass Asset Library"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if find_library() is not None:
            cls.poll_message_set(_rpt("The asset library is there already"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.preferences.filepaths.asset_libraries.new(
            name=NAME, directory=str(NODE_GROUPS.parent)
        )
        context.preferences.is_dirty = True
        self.report(
            {"INFO"}, _rpt("The modifier is listed in the asset browser, library {}").format(NAME)
        )
        return {"FINISHED"}


class PREFERENCES_OT_refractive_glass_asset_library_remove(bpy.types.Operator):
    """Take the Refractive Glass modifier out of the asset browser again; files keep theirs"""

    bl_idname = "preferences.refractive_glass_asset_library_remove"
    bl_label = "Remove Refractive Glass Asset Library"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if find_library() is None:
            cls.poll_message_set(_rpt("The asset library is not there"))
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        remove_library()
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
        column.label(text="The modifier in the asset browser, to be dragged onto objects")
        here = PREFERENCES_OT_refractive_glass_asset_library_add
        gone = PREFERENCES_OT_refractive_glass_asset_library_remove
        chosen = here if find_library() is None else gone
        column.operator(chosen.bl_idname, icon="ASSET_MANAGER")


def preferences(context: bpy.types.Context) -> RefractiveGlassPreferences | _Defaults:
    """The extension's preferences; the defaults where it is not installed as one."""
    addon = context.preferences.addons.get(_PACKAGE)
    return _Defaults() if addon is None or addon.preferences is None else addon.preferences


@dataclass(frozen=True)
class _Defaults:
    """What :class:`RefractiveGlassPreferences` holds where nobody has changed it."""

    show_first_glass: bool = True


_register, _unregister = bpy.utils.register_classes_factory(
    (
        PREFERENCES_OT_refractive_glass_asset_library_add,
        PREFERENCES_OT_refractive_glass_asset_library_remove,
        RefractiveGlassPreferences,
    )
)


def register() -> None:
    """Register the operators and the preferences; the library itself only when asked for."""
    _register()


def unregister() -> None:
    """Undo :func:`register`; the library goes with the extension."""
    remove_library()
    _unregister()
