# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that is known without a view: lamps, the sky of one colour, and what no view shows."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import ArrayLike

from .hits import KNOWN, UNSEEN, Shown, Ways
from .lamps import Sun
from .things import Things

COMPARED = 400
"""Hits of one surface among which the nearest is looked for, for one that no view shows."""
BLOCK = 4096
"""Hits compared at a time."""


@dataclass(frozen=True)
class Clamp:
    """Most light of one sample, as the user's engine has it: the mean of red, green and blue.

    An engine follows one way of a sample and finds the light undimmed by Fresnel's laws: a sun's
    image in a glass is in few samples, and as bright as the sun. So it is the light along a whole
    way that is limited, not what the way brings to a pixel.

    Attributes
    ----------
    direct : of ways with one event, such as a lamp's mirror image. indirect : of all others.
        0: no limit.
    """

    direct: float = 0.0
    indirect: float = 0.0

    def limited(self, radiance: ArrayLike, ways: Ways, part: ArrayLike = 1.0) -> np.ndarray:
        """Light (K, 3) of radiances (3,) or (K, 3) along ways, of which none is above its limit.

        ``part``: (K,) of a way's light that is of that radiance. Behind a sharp surface few samples
        find a small lamp and many do not. A rough one gathers it in each sample, by its part.
        """
        light = np.broadcast_to(np.asarray(radiance, float), (len(ways), 3))
        tint = ways.colour / np.where(ways.weight > 0.0, ways.weight, 1.0)[:, None]
        most = np.where(ways.events > 1, self.indirect, self.direct)
        found = (np.abs(light) * tint).mean(axis=1) * np.where(ways.rough, part, 1.0)
        over = (most > 0.0) & (found > most)
        return light * (part * np.where(over, most / np.where(over, found, 1.0), 1.0))[:, None]


UNLIMITED = Clamp()


@dataclass(frozen=True)
class Sky:
    """What rays that meet nothing see.

    Attributes
    ----------
    radiance : (red, green, blue) of a sky of one colour; None: views show it.
    alpha : of the sky: 0 where the film is transparent.
    suns : discs of light in it.
    """

    radiance: tuple[float, float, float] | None
    alpha: float
    suns: tuple[Sun, ...] = ()


def sky_of(
    scene: bpy.types.Scene, suns: tuple[Sun, ...], override: bpy.types.World | None = None
) -> Sky:
    """The sky of an evaluated scene's world, or of a view layer's own, as its engine draws it."""
    if scene.render.engine == "BLENDER_WORKBENCH":
        suns = ()
    if scene.render.film_transparent:
        return Sky((0.0, 0.0, 0.0), 0.0, suns)
    if scene.render.engine == "BLENDER_WORKBENCH":
        return Sky(None, 1.0)
    return Sky(uniform_radiance(override or scene.world), 1.0, suns)


def uniform_radiance(world: bpy.types.World | None) -> tuple[float, float, float] | None:
    """The radiance of a world of one colour, None of any other. No world is black."""
    if world is None:
        return (0.0, 0.0, 0.0)
    if world.node_tree is None:
        return tuple(float(c) for c in world.color)
    output = next(
        (
            n
            for n in world.node_tree.nodes
            if n.type == "OUTPUT_WORLD" and n.is_active_output and n.target != "CYCLES"
        ),
        None,
    )
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return (0.0, 0.0, 0.0)
    node = links[0].from_node
    plain = node.type == "BACKGROUND" and not node.mute and not links[0].is_muted
    if not plain or any(socket.is_linked for socket in node.inputs):
        return None
    strength = float(node.inputs["Strength"].default_value)
    return tuple(float(c) * strength for c in node.inputs["Color"].default_value[:3])


def known_light(
    things: Things, normals: np.ndarray, sky: Sky, ways: Ways, shown: Shown
) -> np.ndarray:
    """(K, 3) radiance of ways whose light is known; 0 of the others."""
    out = np.zeros((len(ways), 3))
    known = shown.view == KNOWN
    is_sky = ways.is_sky
    if sky.radiance is not None:
        out[known & is_sky] = sky.radiance
    some = np.flatnonzero(known & ~is_sky)
    triangle = ways.triangle[some]
    surface = things.surface[triangle]
    radiance = np.array([look.radiance for look in things.looks]).reshape(-1, 3)
    faces = np.array([look.faces for look in things.looks], int)
    facing = np.einsum("nk,nk->n", normals[triangle], ways.direction[some]) < 0.0
    out[some] = radiance[surface] * (facing | (faces[surface] == 0))[:, None]
    return out


def stand_ins(things: Things, ways: Ways, shown: Shown) -> tuple[Shown, np.ndarray]:
    """For hits that no view shows: the nearest hit of the same surface that one shows.

    Returns what is shown by which view then, and the radiance (K, 3) of hits that have not even
    that: their surface's own light, and its colour under a mean light of 1/2.
    """
    view, pixels = shown.view.copy(), shown.pixels.copy()
    out = np.zeros((len(ways), 3))
    lacking = np.flatnonzero(shown.view == UNSEEN)
    if not len(lacking):
        return shown, out
    surface = np.full(len(ways), -1)
    met = np.flatnonzero(~ways.is_sky)
    surface[met] = things.surface[ways.triangle[met]]
    # A place of a hit: the point, or in the sky the direction.
    place = np.where(ways.is_sky[:, None], ways.direction, ways.point)
    for number in np.unique(surface[lacking]):
        here = lacking[surface[lacking] == number]
        seen = np.flatnonzero((surface == number) & (shown.view >= 0))
        if not len(seen):
            if number >= 0:
                look = things.looks[number]
                out[here] = np.array(look.radiance) + 0.5 * np.array(look.albedo)
            view[here] = KNOWN
            continue
        seen = seen[:: max(1, len(seen) // COMPARED)]
        for start in range(0, len(here), BLOCK):
            part = here[start : start + BLOCK]
            apart = ((place[part, None] - place[None, seen]) ** 2).sum(axis=-1)
            nearest = seen[apart.argmin(axis=1)]
            view[part], pixels[part] = shown.view[nearest], shown.pixels[nearest]
    return Shown(view, pixels), out
