# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadows and caustics: what glasses change in the light that lamps give to all that views show.

The user's engine lights everything as though there were no glass. In each pixel of each view the
light is known that would come straight and does not, and the light that comes by glasses. Their
difference, times the part that a surface sends back, is added to the view's picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..progress import check, tell
from ..rays.caster import Past
from ..rays.curtain import BLOCK_PX, looked_up
from ..rays.follow import CONTACT, Follower, Kept
from ..rays.hits import Scene, Views
from ..rays.views import RadianceView
from .density import Seen, density
from .emitters import Emitter
from .landed import follow_light, grids


@dataclass(frozen=True)
class LightSettings:
    """How light through glasses is computed.

    Attributes
    ----------
    emitters : the lamps. rays : of each, about. softness : of its bells.
    """

    emitters: tuple[Emitter, ...]
    rays: int
    softness: float


@dataclass
class KeptLight:
    """What earlier frames followed, by lamp."""

    lamps: dict[str, Kept] = field(default_factory=dict)


def light_maps(
    settings: LightSettings,
    scene: Scene,
    views: Views,
    places: Sequence[np.ndarray],
    follower: Follower,
    boxes: list[np.ndarray],
    sigma_px: float,
    kept: KeptLight,
) -> tuple[np.ndarray, ...]:
    """What is added to the radiance of white matte surfaces in each view's picture.

    Parameters
    ----------
    places : (K, 2) pixels of each that are looked up; of the first one all are seen.
    follower : the picture's, for its glasses. boxes : corners (8, 3) of each glass's box.
    sigma_px : standard deviation of the pixel filter.

    Returns
    -------
    (height, width, 3) for each view; a pixel for one that is None or of the sky.
    """
    found = [np.zeros(_shape(view)) for view in views]
    if not (boxes and settings.emitters):
        return tuple(found)
    corners = np.concatenate(boxes)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    reach = float(np.linalg.norm(np.ptp(corners, axis=0)))
    skin = CONTACT * reach
    things = scene.things
    is_lamp = np.array([look.is_lamp for look in things.looks], bool)[things.surface]
    # Lamps do not stand in the way of each other's light.
    caster = Past(scene.caster, lambda met: ~is_lamp[met.triangle], skin)
    # In large steps: ways are kept while it stays, though things move.
    farthest = (
        np.linalg.norm(np.abs(things.box() - middle).max(axis=0)) if things.points.size else 0.0
    )
    back = reach * 2.0 ** np.ceil(np.log2(1.0 + farthest / reach))

    seen = {}
    for number, view in enumerate(views):
        if view is not None and not view.sky_only:
            used = looked_up(view, places[number]) if number else None
            seen[number] = _seen(view, used, scene, is_lamp)
    names = {emitter.name for emitter in settings.emitters}
    kept.lamps = {name: known for name, known in kept.lamps.items() if name in names}
    for emitter in settings.emitters:
        tell(f'following the light of "{emitter.name}"')
        grid = grids(emitter, boxes, settings.rays, back)
        known = kept.lamps.setdefault(emitter.name, Kept())
        of_lamp = replace(follower, view=grid, caster=caster, eyes=caster, kept=known, through=None)
        landed = follow_light(emitter, grid, scene, of_lamp, settings.softness, reach)
        for number, one in seen.items():
            found[number] += density(landed, one, sigma_px) * (emitter.power / np.pi)
    return tuple(found)


def _shape(view: RadianceView | None) -> tuple[int, int, int]:
    if view is None or view.sky_only:
        return 1, 1, 3
    x0, y0, x1, y1 = view.picture
    return y1 - y0, x1 - x0, 3


def _seen(view: RadianceView, used, scene: Scene, is_lamp: np.ndarray) -> Seen:
    """What the middles of a picture's pixels show, of those that are drawn and looked up.

    ``is_lamp``: (T,) which triangles are lamps'; no light is added to them.
    """
    check()
    x0, y0, x1, y1 = view.picture
    drawn = np.zeros((y1, x1), bool)
    left, low, right, top = view.region
    drawn[low:top, left:right] = True
    if used is not None:
        drawn &= used.repeat(BLOCK_PX, axis=0).repeat(BLOCK_PX, axis=1)[:y1, :x1]
    y, x = np.nonzero(drawn[y0:, x0:])
    pixel = y * (x1 - x0) + x
    place = np.stack((x + x0, y + y0), axis=1)
    # Most are known: of the last frame, and of hits that were looked for.
    triangle, way = scene.sketch(view).met(place)
    met = np.flatnonzero((triangle >= 0) & ~is_lamp[triangle])
    origins, directions = view.rays(place[met] + 0.5)
    normal = scene.normals[triangle[met]]
    side = np.sign(np.einsum("nk,nk->n", normal, directions))
    points = origins + way[met, None] * directions
    return Seen.of(view, used, pixel[met], points, -side[:, None] * normal)
