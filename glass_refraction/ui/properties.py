# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a scene: ``scene.refractive_glass``."""

from __future__ import annotations

import bpy

from .. import handlers
from . import staying


def _changed(_settings, context: bpy.types.Context) -> None:
    handlers.request_update(context.scene)


_QUALITIES = {
    "DRAFT": {"captures": 1, "min_weight": 0.03, "tolerance_px": 1.0, "light_rays": 30_000},
    "GOOD": {"captures": 3, "min_weight": 0.01, "tolerance_px": 0.25, "light_rays": 80_000},
    "FINAL": {"captures": 3, "min_weight": 0.003, "tolerance_px": 0.1, "light_rays": 400_000},
}
"""The settings that a quality stands for."""
_OWN = "CUSTOM"


def _read_quality(settings: SceneSettings) -> int:
    """Number of the quality that all settings agree with."""
    for number, values in enumerate(_QUALITIES.values()):
        if all(abs(getattr(settings, name) - v) < 1e-6 for name, v in values.items()):
            return number
    return len(_QUALITIES)


def _write_quality(settings: SceneSettings, number: int) -> None:
    if number < len(_QUALITIES):
        for name, value in list(_QUALITIES.values())[number].items():
            setattr(settings, name, value)


class SceneSettings(bpy.types.PropertyGroup):
    """How the scene's glasses are computed and composited."""

    enabled: bpy.props.BoolProperty(
        name="Refractive Glass",
        description="Compute what is seen through the scene's refractive glasses. When off, "
        "renders show the glasses as ordinary meshes",
        default=True,
        update=_changed,
    )
    shading: bpy.props.EnumProperty(
        name="Shading",
        description="Where what is seen through the glass gets its light from",
        items=(
            (
                "TRUE",
                "True",
                "Lit where it is, as beside the glass: for all that has light and shadow",
            ),
            (
                "DISPLACED",
                "Displaced",
                "Lit where it appears: exact for unlit materials, and faster",
            ),
        ),
        default="TRUE",
        update=_changed,
    )
    surface: bpy.props.EnumProperty(
        name="Surface",
        description="How the glass's surfaces treat light",
        items=(
            ("GLASS", "Glass", "Refracts and mirrors as glass does (Glass BSDF)"),
            ("REFRACTION", "Refraction", "Refracts only, without loss (Refraction BSDF)"),
        ),
        default="GLASS",
        update=_changed,
    )
    shadow: bpy.props.EnumProperty(
        name="Shadow",
        description="What the glasses do to the light of lamps that falls through them",
        items=(
            ("STRAIGHT", "Straight", "Nothing, or with Casts Shadow a straight, tinted shadow"),
            (
                "LIGHT",
                "Light",
                "Light is bent and mirrored as it falls through the glasses: shadows and caustics "
                "of sun, point, spot and area lamps, in Cycles and EEVEE. In renders only, and "
                "with True shading",
            ),
        ),
        default="STRAIGHT",
        update=_changed,
    )
    light_rays: bpy.props.IntProperty(
        name="Light Rays",
        description="How many rays of each lamp are followed through the glasses, about",
        default=80_000,
        min=1000,
        soft_max=1_000_000,
        update=_changed,
    )
    light_softness: bpy.props.FloatProperty(
        name="Softness",
        description="How far the light of one ray is spread where it falls. Below 1 the rays show "
        "as a pattern, above edges are softer than they are",
        default=1.0,
        min=0.1,
        soft_max=4.0,
        update=_changed,
    )
    quality: bpy.props.EnumProperty(
        name="Quality",
        description="Sets what is under Advanced",
        items=(
            ("DRAFT", "Draft", "What is bright in the glass: for a quick look"),
            ("GOOD", "Good", "All that carries more than a hundredth of the light"),
            ("FINAL", "Final", "Faint reflections, too. Takes two to three times as long"),
            (_OWN, "Custom", "As set under Advanced"),
        ),
        get=_read_quality,
        set=_write_quality,
    )
    min_weight: bpy.props.FloatProperty(
        name="Minimum Weight",
        description="Light paths that carry less than this part of the light of every ray are "
        "left out",
        default=0.01,
        min=1e-4,
        max=1.0,
        precision=4,
        subtype="FACTOR",
        update=_changed,
    )
    tolerance_px: bpy.props.FloatProperty(
        name="Tolerance",
        description="How far, in pixels, the straight image of an edge may lie from its true "
        "image before the edge is subdivided",
        default=0.25,
        min=0.01,
        soft_max=4.0,
        subtype="PIXEL",
        update=_changed,
    )
    captures: bpy.props.IntProperty(
        name="Captures",
        description="Cameras at most that are placed to show what is seen through the glasses and "
        "the picture itself does not show. Each is rendered once more, with as few samples as its "
        "light allows",
        default=3,
        min=0,
        max=3,
        update=_changed,
    )
    bake_directory: bpy.props.StringProperty(
        name="Bake Folder",
        description="Where baked frames are written; empty for a folder beside the file",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )


_register, _unregister = staying.classes((SceneSettings,))


def register() -> None:
    """Register the settings and hang them on the scene."""
    _register()
    new = bpy.props.PointerProperty(type=SceneSettings)
    staying.hang(bpy.types.Scene, "refractive_glass", new)


def unregister() -> None:
    """Undo :func:`register`."""
    staying.take_off(bpy.types.Scene, "refractive_glass")
    _unregister()
