# SPDX-License-Identifier: GPL-3.0-or-later
"""What ways see that meet nothing: the world, or the hole that a transparent film leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..read.world import BLACK, Radiance, is_of_cameras, uniform_radiance
from .lamps import Sun

if TYPE_CHECKING:
    from .hits import Ways


@dataclass(frozen=True)
class Sky:
    """What rays that meet nothing see.

    Attributes
    ----------
    radiance : (red, green, blue) of a sky of one colour; None: views show it.
    suns : discs of light in it.
    is_cut_out : the film is transparent: pictures have a hole where the sky is, in glass too.
    mirrors_world : mirrors show the world although the film is transparent.
    is_of_cameras : what glass shows of it is not what a camera sees.
    """

    radiance: Radiance | None
    suns: tuple[Sun, ...] = ()
    is_cut_out: bool = False
    mirrors_world: bool = True
    is_of_cameras: bool = False

    @property
    def is_in_pictures(self) -> bool:
        """Whether cameras that show things show the sky behind them as glass does."""
        return not (self.is_cut_out or self.is_of_cameras)

    def is_clear(self, ways: Ways) -> np.ndarray:
        """(K,) which show a hole in the picture where they meet nothing, or a holdout."""
        clear = np.full(len(ways), self.is_cut_out)
        return clear & ~ways.is_mirrored if self.mirrors_world else clear


def sky_of(scene: bpy.types.Scene, suns: tuple[Sun, ...], world: bpy.types.World | None) -> Sky:
    """The sky of an evaluated scene with a world, as its engine draws it.

    A transparent film shows through glass as it does beside it: as in Cycles with *Transparent
    Glass*, in every engine.
    """
    engine, cut_out = scene.render.engine, scene.render.film_transparent
    if engine == "BLENDER_WORKBENCH":
        return Sky(BLACK if cut_out else None, (), cut_out, mirrors_world=False)
    apart = is_of_cameras(world, engine)
    return Sky(uniform_radiance(world, engine), suns, cut_out, is_of_cameras=apart)
