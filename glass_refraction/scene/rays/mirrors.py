# SPDX-License-Identifier: GPL-3.0-or-later
"""What of the picture mirrors a glass or hides one that it lets through: engines render none."""

from __future__ import annotations

import numpy as np

from ...optics import reflect
from ...optics.boxes import meets_boxes
from .hits import SKIN, Scene
from .looks import Clear
from .views import RadianceView

LOOKED = 64
"""Places along the longer side of the picture where it is asked what is mirrored."""


def mirrors_of(scene: Scene, view: RadianceView, boxes: np.ndarray) -> dict[str, float]:
    """Part of the picture's light that would be a glass's mirror image, by the owner of the mirror.

    Parameters
    ----------
    view : the camera's. boxes : (B, 2, 3) round the glasses, in the world.
    """
    looks, things = scene.things.looks, scene.things
    if not any(look.is_mirror for look in looks):
        return {}
    origins, directions = _looked(view)
    total = len(origins)
    distance, triangle = scene.eyes.cast(origins, directions)
    mirrors = np.array([look.is_mirror for look in looks])[things.surfaces(triangle)]
    some = np.flatnonzero((triangle >= 0) & mirrors)
    normal, along = scene.normals[triangle[some]], directions[some]
    facing = np.einsum("nk,nk->n", along, normal)
    normal = normal * -np.sign(facing)[:, None]
    cosine, along = np.abs(facing), reflect(along, normal)
    lift = SKIN * distance[some, None]
    begin = origins[some] + directions[some] * distance[some, None] + normal * lift
    reach, _ = scene.caster.cast(begin, along)
    met = meets_boxes(boxes, 0.0, begin.T.copy(), along.T.copy(), reach)
    surface = things.surfaces(triangle[some])[met]
    straight = np.array([look.reflectance for look in looks])[surface]
    part = schlick(straight, cosine[met])
    found: dict[str, float] = {}
    for number in np.unique(surface):
        owner = things.owners[number]
        found[owner] = found.get(owner, 0.0) + float(part[surface == number].sum()) / total
    return found


def schlick(straight: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Reflectance at angles of incidence of these cosines, by that of what is seen squarely.

    C. Schlick's approximation of Fresnel's equations (1994).
    """
    return straight + (1.0 - straight) * (1.0 - cosine) ** 5


def veils_of(scene: Scene, view: RadianceView, boxes: np.ndarray, kind: Clear) -> dict[str, float]:
    """Part of the picture in which glasses are behind what is seen through, by the owner of that.

    Arguments as of `mirrors_of`; ``kind`` of what is seen through. What a material cuts out is no
    veil: rays pass its holes.
    """
    looks, things = scene.things.looks, scene.things
    clear = [look.clear is kind and look.cutout is None and not look.faces for look in looks]
    if not any(clear):
        return {}
    origins, directions = _looked(view)
    distance, triangle = scene.eyes.cast(origins, directions)
    surface = things.surfaces(triangle)
    some = np.flatnonzero((triangle >= 0) & np.array(clear)[surface])
    begin, along, reach = origins[some].T.copy(), directions[some].T.copy(), distance[some]
    before = meets_boxes(boxes, 0.0, begin, along, reach)
    behind = meets_boxes(boxes, 0.0, begin + along * reach, along, np.full(len(some), np.inf))
    veils = surface[some[behind & ~before]]
    return {
        things.owners[number]: float((veils == number).sum()) / len(origins)
        for number in np.unique(veils)
    }


def _looked(view: RadianceView) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (K, 3) of rays that are spread evenly over the picture."""
    low, high = np.array(view.region[:2]), np.array(view.region[2:])
    step = (high - low).max() / LOOKED
    x, y = (np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True))
    return view.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
