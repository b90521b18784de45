# SPDX-License-Identifier: GPL-3.0-or-later
"""Where in the picture the light paths of slabs, cylinders and balls end.

Within its region a path is smooth, and displaced copies show it. Where regions end, at the outline,
at the verge, at rims and side faces and where rays leave by an open end, several paths meet in a
pixel, and what lies beside a border must not be taken as the mean over the whole pixel. There rays
show everything, as in cups (`ray_screen.py`); and in between, what mirrors show.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..optics.axial import BoundedGlass
from .ray_screen import Zone, met_pixels, path_kind, widened
from .read.glasses import Glass, as_body
from .read.things import body_corners
from .read.viewpoint import Viewpoint
from .vertices.path_keys import Path
from .vertices.regions import PathRays, Regions, border_pixels, covered_rect

SEEN = 0.03
"""Part of the light from which on a path's border is shown so: weaker ones are not noticed."""
CUT_OFF = 0.01
"""Part of the light that paths may lose at the ends of faces before rays show the place."""


def has_borders(glass: Glass) -> bool:
    """Whether rays show where the glass's paths end: cups are another matter, all by rays."""
    return not isinstance(glass.description, BoundedGlass) and as_body(glass) is not None


def border_rect(glass: Glass, view: Viewpoint) -> tuple[int, int, int, int]:
    """The pixels that the glass's body can cover: (x0, y0, x1, y1), half open."""
    return covered_rect(view, body_corners(as_body(glass)), margin=3)


def border_pixels_of(
    glass: Glass, view: Viewpoint, regions: Regions, *, fresnel: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of a glass's rectangle of which rays are to show everything.

    Parameters
    ----------
    regions : of the same glass, as :func:`regions.path_regions` finds them.

    Returns
    -------
    cover : (h, w) bool. hit : (h, w) bool: the pixels whose rays meet the unbounded glass.
    """
    body, rect = as_body(glass), border_rect(glass, view)
    x0, y0, x1, y1 = rect
    if x0 >= x1 or y0 >= y1:
        none = np.zeros((max(0, y1 - y0), max(0, x1 - x0)), bool)
        return none, none

    def here(values: np.ndarray) -> np.ndarray:
        return regions.full(values, view.size)[..., y0:y1, x0:x1]

    met, hit = met_pixels(body, view, rect), here(regions.hit)
    border = border_pixels(np.concatenate((here(regions.weights > SEEN), hit[None], met[None])))
    rows, columns = np.nonzero(hit & met & ~border)
    rays = PathRays(glass, view, regions.paths, fresnel)
    cut = np.zeros_like(hit)
    cut[rows, columns] = rays.cut_off(columns + x0 + 0.5, rows + y0 + 0.5) > CUT_OFF
    cover = border | cut | (met & ~hit)
    # The pixel filter reaches one and a half pixels far.
    return cover | border_pixels(cover[None]), hit


def border_zone(
    glass: Glass,
    view: Viewpoint,
    parts: Sequence[tuple[np.ndarray, np.ndarray]],
    kept: Iterable[Path],
    bare: Iterable[Path],
) -> Zone:
    """What the screen of a glass's borders shows where.

    Parameters
    ----------
    parts : as :func:`border_pixels_of` finds them, in light of each colour: one zone serves all.
    kept, bare : the paths of the glass, and those of them that rays show without copies.
    """
    cover = np.logical_or.reduce([cover for cover, _ in parts])
    hit = np.logical_or.reduce([hit for _, hit in parts])
    kinds = frozenset(map(path_kind, bare))
    # The filter of the pixels beside the cover reaches into it.
    inner = ~widened(~cover)
    smooth = hit & ~inner
    return Zone(border_rect(glass, view), cover, smooth, frozenset(map(path_kind, kept)), kinds)
