# SPDX-License-Identifier: GPL-3.0-or-later
"""What of the picture mirrors a glass: engines render it without one."""

from __future__ import annotations

import numpy as np

from ...optics import reflect
from ...optics.exit_rays import meets_boxes
from .hits import SKIN, Scene
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
    low, high = np.array(view.region[:2]), np.array(view.region[2:])
    step = (high - low).max() / LOOKED
    x, y = (np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True))
    origins, directions = view.rays(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
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
    # Schlick's approximation of Fresnel's equations.
    part = straight + (1.0 - straight) * (1.0 - cosine[met]) ** 5
    found: dict[str, float] = {}
    for number in np.unique(surface):
        owner = things.owners[number]
        found[owner] = found.get(owner, 0.0) + float(part[surface == number].sum()) / total
    return found
