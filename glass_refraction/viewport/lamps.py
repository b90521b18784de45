# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps that glasses of a 3D view mirror and let through: no view shows them, so rays meet them."""

from __future__ import annotations

import bpy
import numpy as np

from ..scene.rays.beams import SpotBeam, SpreadBeam
from ..scene.rays.lamps import LampBody, lamp_body, lamp_power
from ..scene.read.light_linking import is_mirrored
from ..scene.read.viewpoint import clamp_settings
from .description import Frame
from .eye import LAMP_ROWS, LAMPS

EVERYWHERE = (-2.0, 1.0)
"""A lamp's cosine and border, see `SpotBeam`, that let light go to all sides."""


class Lamps:
    """The lamps of a view that have a size, as bodies; `limits`: see `clamp_settings`."""

    def __init__(self) -> None:
        self.bodies: list[LampBody] = []
        self.limits = (0.0, 0.0)

    def read(
        self,
        layer: bpy.types.ViewLayer,
        space: bpy.types.SpaceView3D,
        names: list[str],
        glasses: set[str],
    ) -> None:
        """Read those of some names that shine in a view, and that one of the glasses mirrors."""
        scene = layer.depsgraph.scene
        engine = _lit_by(scene, space.shading)
        self.bodies = []
        if not engine:
            return
        self.limits = clamp_settings(scene, engine)
        found = [
            obj.evaluated_get(layer.depsgraph)
            for obj in map(layer.objects.get, names)
            if obj is not None
            and obj.visible_get(view_layer=layer, viewport=space)
            and is_mirrored(obj, glasses)
        ]
        found.sort(key=lambda obj: -float(np.max(lamp_power(obj.data, engine))))
        for obj in found:
            body = lamp_body(obj.data, np.array(obj.matrix_world, float), engine)
            if body is not None and np.linalg.det(body.to_world[:3, :3]):
                self.bodies.append(body)

    def packed(self, frame: Frame) -> np.ndarray:
        """Rows of four floats, see ``View`` in :mod:`glsl`: of as many lamps as it has room for."""
        rows = np.zeros((min(len(self.bodies), LAMPS), LAMP_ROWS, 4))
        for one, body in zip(rows, self.bodies, strict=False):
            one[:3] = (np.linalg.inv(body.to_world) @ frame.to_world())[:3]
            one[3] = *body.look.radiance, body.kind
            one[4] = *body.look.factors, *_beam(body.look.beam)
        return rows.reshape(-1, 4)


def _lit_by(scene: bpy.types.Scene, shading: bpy.types.View3DShading) -> str:
    """The engine by which the scene's lamps light a view; empty where they do not."""
    if shading.type == "MATERIAL" and shading.use_scene_lights:
        return "BLENDER_EEVEE"
    engine = scene.render.engine
    if shading.type == "RENDERED" and engine != "BLENDER_WORKBENCH":
        return engine if shading.use_scene_lights_render else ""
    return ""


def _beam(beam: SpotBeam | SpreadBeam | None) -> tuple[float, float]:
    """Two numbers: of a spot its cosine and border, of a spread the tangent, and half − tangent."""
    if beam is None:
        return EVERYWHERE
    if isinstance(beam, SpotBeam):
        return beam.cosine, beam.border
    tangent = float(np.tan(beam.half))
    return tangent, beam.half - tangent
