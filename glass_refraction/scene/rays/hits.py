# SPDX-License-Identifier: GPL-3.0-or-later
"""What the ways of rays meet at last, and which radiance view shows that best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .caster import Caster
from .sky import Sky
from .things import Things
from .views import WIDEST, RadianceView, aimed_view, virtual_eye

UNSEEN, KNOWN = -1, -2
"""In place of a view's number: no view shows the hit; its radiance is known without one."""
SKIN = 1e-4
"""Of a sight's length: a surface nearer than this before a hit is the hit's own."""
CAPTURE_WORTH = 0.4
"""A capture's resolution counts this much of the direct picture's: it has fewer samples."""
ENOUGH_SEEN = 0.002
"""Part of all light: while less than this is unseen no further capture is placed."""
STRONG = 0.1
"""Part of a ray's light from which on the sharpest view is looked for."""
FAINT_SKY = 0.002
"""Part of the sky's light: while less than this is unseen no further view of it is placed."""
ENOUGH_FINE = 0.02
"""Part of all light: what lacks in fineness may be so much before a capture is placed for it."""
SEEN = 0.8
"""Of a hit's worth: to be seen at all, however coarsely."""
COARSE = 0.1
"""Of a hit's worth: while less than this lacks, no capture need show it better."""
KINDS = 5
"""Of light paths whose virtual eyes are tried for a capture, those with most unseen light."""
NEAR_SHARE = 0.5
"""Part of the distance to the nearest hit from where a capture sees."""
TRIED = 4000
"""Ways that decide how well a place for a capture suits."""
GRAZING = 1.0 / 64.0
"""A view that meets a surface at so much less than the way does, by sines, shows only streaks."""
GLOSSY_POWER = 8.0
"""Of the cosine between way and sight, by which a view of a glossy surface is judged."""


@dataclass(frozen=True, eq=False)
class Ways:
    """Ways that light takes to the eye's rays, from where it last left a glass or thing.

    Attributes
    ----------
    ray : (K,) number of the ray. path : (K,) equal for ways through the same interfaces, odd for
        those of which one mirrored.
    weight : (K,) part of the ray's light. colour : (K, 3) the same with tints.
    origin, direction : (K, 3), world; the direction leads away from the eye.
    distance : (K,) metres to what is met; infinite: the sky.
    triangle : (K,) of the things; −1: none.
    events : (K,) interfaces at which they were refracted or reflected.
    rough : (K,) bool, whether one of these was a rough one's facet.
    """

    ray: np.ndarray
    path: np.ndarray
    weight: np.ndarray
    colour: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    distance: np.ndarray
    triangle: np.ndarray
    events: np.ndarray
    rough: np.ndarray

    def __len__(self) -> int:
        return len(self.ray)

    def take(self, which: np.ndarray) -> Ways:
        """Some of them."""
        return Ways(*(part[which] for part in vars(self).values()))

    def scaled(self, factor: np.ndarray) -> Ways:
        """The same with other weights: times a factor (K,)."""
        return replace(self, weight=self.weight * factor, colour=self.colour * factor[:, None])

    @staticmethod
    def joined(parts: list[Ways]) -> Ways:
        """All of several bundles, whose rays are numbered together."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Ways(*(np.concatenate(column) for column in columns))

    @property
    def is_sky(self) -> np.ndarray:
        """(K,) which meet nothing."""
        return self.triangle < 0

    @property
    def is_mirrored(self) -> np.ndarray:
        """(K,) which were reflected anywhere."""
        return (self.path & 1).astype(bool)

    @property
    def point(self) -> np.ndarray:
        """(K, 3) where they meet a thing; their origin where they meet none."""
        far = np.where(self.is_sky, 0.0, self.distance)
        return self.origin + self.direction * far[:, None]


@dataclass(frozen=True, eq=False)
class Shown:
    """By which view each way's hit is shown: (K,) number or `UNSEEN` or `KNOWN`, and its frame
    pixels (K, 2) there."""

    view: np.ndarray
    pixels: np.ndarray

    def take(self, which: np.ndarray) -> Shown:
        """Some of them."""
        return Shown(self.view[which], self.pixels[which])

    @staticmethod
    def joined(parts: list[Shown]) -> Shown:
        """All of several."""
        return Shown(
            np.concatenate([part.view for part in parts]),
            np.concatenate([part.pixels for part in parts]),
        )


Views = Sequence[RadianceView | None]
"""By number; None where a frame needs fewer."""


class Scene:
    """The things that ways meet, ready to be looked for in views.

    sky : what those see that meet nothing.
    """

    def __init__(self, caster: Caster, things: Things, sky: Sky) -> None:
        self.caster, self.things, self.sky = caster, things, sky
        a, b, c = (things.points[things.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        self.normals = normals / np.where(length > 0.0, length, 1.0)
        looks = things.looks
        self._is_lamp = np.array([look.is_lamp for look in looks], bool)
        self._is_glossy = np.array([look.is_glossy for look in looks], bool)

    def is_known(self, ways: Ways) -> np.ndarray:
        """(K,) whose light is known without a view: lamps, a sky of one colour, and none."""
        known = ways.is_sky & (self.sky.radiance is not None or self.sky.is_clear(ways))
        some = np.flatnonzero(~ways.is_sky)
        known[some] = self._is_lamp[self.things.surface[ways.triangle[some]]]
        known |= ~ways.colour.any(axis=1)
        return known

    def is_glossy(self, ways: Ways) -> np.ndarray:
        """(K,) whose hit looks different from elsewhere."""
        found = np.zeros(len(ways), bool)
        some = np.flatnonzero(~ways.is_sky)
        found[some] = self._is_glossy[self.things.surface[ways.triangle[some]]]
        return found

    def worth(self, view: RadianceView, ways: Ways, direct: bool) -> tuple[np.ndarray, np.ndarray]:
        """How well a view shows each hit (K,), 0 where it lies outside, and its pixels there."""
        pixels = np.zeros((len(ways), 2))
        worth = np.zeros(len(ways))
        sky = np.flatnonzero(ways.is_sky)
        if len(sky) and (view.sky_only or not self.sky.is_cut_out):
            pixels[sky], inside = view.pixels_of_sky(ways.direction[sky])
            worth[sky] = inside * view.focal_px
        some = np.flatnonzero(~ways.is_sky)
        if len(some) and not view.sky_only:
            points = ways.point[some]
            pixels[some], inside = view.pixels(points)
            if view.is_parallel:
                towards = np.broadcast_to(view.forward, points.shape)
                density = np.full(len(some), view.focal_px)
            else:
                towards = points - view.eye
                length = np.maximum(np.linalg.norm(towards, axis=1), 1e-300)
                towards = towards / length[:, None]
                density = view.focal_px / length
            triangle = ways.triangle[some]
            tilt = np.abs(np.einsum("nk,nk->n", towards, self.normals[triangle]))
            along = np.einsum("nk,nk->n", towards, ways.direction[some])
            facing = np.einsum("nk,nk->n", ways.direction[some], self.normals[triangle])
            sides = np.einsum("nk,nk->n", towards, self.normals[triangle])
            # The other side of a face may look different.
            same_side = np.sign(facing) == np.sign(sides)
            enough = tilt > GRAZING * np.abs(facing)
            glossy = self._is_glossy[self.things.surface[triangle]]
            match = np.where(glossy, np.clip(0.5 + 0.5 * along, 0.0, 1.0) ** GLOSSY_POWER, 1.0)
            worth[some] = inside * same_side * enough * density * np.sqrt(tilt) * (match + 1e-3)
        return worth * (1.0 if direct else CAPTURE_WORTH), pixels

    def sees(self, view: RadianceView, ways: Ways) -> np.ndarray:
        """(K,) whether nothing stands between a view and the hits, which lie in its frame."""
        if view.sky_only:
            return ways.is_sky
        sky = ways.is_sky
        origins, directions, lengths = view.sight(ways.point)
        if sky.any():
            origins, directions = origins.copy(), directions.copy()
            directions[sky] = ways.direction[sky]
            origins[sky] = view.sky_sight(ways.direction[sky])
        distance, triangle = self.caster.cast(origins, directions)
        met = (triangle == ways.triangle) | (distance >= lengths * (1.0 - SKIN))
        return np.where(sky, triangle < 0, met)


def show(scene: Scene, views: Views, ways: Ways) -> Shown:
    """For each way the view that shows its hit best; the first view is the direct picture."""
    total = len(ways)
    chosen = np.full(total, UNSEEN, np.intp)
    pixels = np.zeros((total, 2))
    known = scene.is_known(ways)
    chosen[known] = KNOWN
    rows = np.flatnonzero(~known)
    numbered = {number: view for number, view in enumerate(views) if view is not None}
    # All views are compared where much light comes along a way, and where what a surface shows
    # depends on where it is seen from. Else the direct picture shows what it can.
    compared = (scene.is_glossy(ways) | (ways.weight > STRONG))[rows]
    _choose(scene, numbered, ways, rows[compared], chosen, pixels)
    rest = rows[~compared]
    _choose(scene, {0: numbered[0]}, ways, rest, chosen, pixels)
    captures = {number: view for number, view in numbered.items() if number}
    _choose(scene, captures, ways, rest[chosen[rest] == UNSEEN], chosen, pixels)
    return Shown(chosen, pixels)


def _choose(scene: Scene, views: dict[int, RadianceView], ways: Ways, rows, chosen, pixels) -> None:
    """Put the view that shows each of some ways' hits best, and its pixels there, into arrays."""
    if not len(rows) or not views:
        return
    numbers = list(views)
    some = ways.take(rows)
    judged = [scene.worth(views[number], some, number == 0) for number in numbers]
    worth = np.stack([w for w, _ in judged])
    for _ in numbers:
        best = worth.argmax(axis=0)
        live = worth[best, np.arange(len(rows))] > 0.0
        for place, number in enumerate(numbers):
            here = np.flatnonzero(live & (best == place))
            if not len(here):
                continue
            seen = scene.sees(views[number], some.take(here))
            found = here[seen]
            chosen[rows[found]] = number
            pixels[rows[found]] = judged[place][1][found]
            worth[place, here] = 0.0
            worth[:, found] = 0.0


def place_captures(
    scene: Scene,
    direct: RadianceView,
    ways: Ways,
    spacing: np.ndarray,
    most: int,
    aspect: float,
    near: float,
) -> list[RadianceView]:
    """Cameras for what the direct picture does not show, or not finely, the most useful first.

    A path's rays seem to come from their virtual eye. A camera there sees what they see, nearly
    from their direction.

    Parameters
    ----------
    ways : of one ray a pixel. spacing : (K,) metres between their hits in neighbouring pixels.
    most : captures at most. aspect : height of a pixel over its width.
    near : metres, the least distance from where a camera sees.
    """
    rows = np.arange(0, len(ways), max(1, len(ways) // (TRIED * 5)))
    ways, spacing = ways.take(rows), spacing[rows]
    known = scene.is_known(ways)
    total = ways.weight.sum()
    shown = _quality(scene, direct, ways, spacing)
    # No capture shows a sky that the film leaves out.
    shown[known | (ways.is_sky & scene.sky.is_cut_out)] = 1.0
    captures: list[RadianceView] = []
    while len(captures) < most and len(ways):
        lacking = ways.weight * (1.0 - shown)
        unseen = ways.weight[shown == 0.0].sum()
        if unseen < ENOUGH_SEEN * total and lacking.sum() < ENOUGH_FINE * total:
            break
        some = np.flatnonzero(1.0 - shown > COARSE)
        if not len(some):
            break
        left = replace(ways.take(some), weight=lacking[some])
        found = _best_capture(scene, direct, left, spacing[some], shown[some], aspect, near)
        if found is None:
            break
        view, quality = found
        captures.append(view)
        shown[some] = np.maximum(shown[some], quality)
    return captures


def _quality(scene: Scene, view: RadianceView, ways: Ways, spacing: np.ndarray) -> np.ndarray:
    """(K,) how well a view shows hits: 0 not at all, `SEEN` at least, 1 pixel for pixel."""
    worth, _ = scene.worth(view, ways, True)
    here = np.flatnonzero(worth > 0.0)
    here = here[scene.sees(view, ways.take(here))]
    quality = np.zeros(len(ways))
    # The sky has no fine detail.
    fine = np.where(ways.is_sky[here], 1.0, np.minimum(worth[here] * spacing[here], 1.0))
    quality[here] = SEEN + (1.0 - SEEN) * fine
    return quality


def _best_capture(
    scene: Scene, direct: RadianceView, ways: Ways, spacing, shown, aspect: float, near: float
):
    """The capture that adds most, by the ways' weights, and how well (K,) it shows each."""
    kinds, kind = np.unique(ways.path, return_inverse=True)
    light = np.bincount(kind, ways.weight, len(kinds))
    groups = [np.flatnonzero(kind == k) for k in np.argsort(-light, kind="stable")[:KINDS]]
    groups.append(np.arange(len(ways)))
    parts = [ways.take(group[:: max(1, len(group) // TRIED)]) for group in groups]
    tried = [(virtual_eye(p.origin, p.direction, p.weight), p) for p in parts]
    # From where the light leaves the glass it sees what the exit rays see.
    tried += [(np.average(p.origin, axis=0, weights=p.weight), p) for p in parts]
    best = None
    for eye, part in tried:
        for opened in (part, ways):
            view = _capture_from(eye, opened, direct, aspect, near)
            if view is None:
                continue
            quality = _quality(scene, view, ways, spacing)
            # What lacks counts by its share: ways.weight holds what each lacks already.
            gain = (ways.weight * np.maximum(quality - shown, 0.0) / (1.0 - shown)).sum()
            if gain > 0.0 and (best is None or gain > best[0]):
                best = gain, view, quality
    return None if best is None else best[1:]


def _capture_from(eye, ways: Ways, direct: RadianceView, aspect: float, near: float):
    """A view from an eye that shows as many of the ways' hits as it can open to."""
    towards = np.where(ways.is_sky[:, None], ways.direction, ways.point - eye)
    length = np.linalg.norm(towards, axis=1)
    usable = length > near
    if not usable.any():
        return None
    directions = towards[usable] / length[usable, None]
    weights = ways.weight[usable]
    view = aimed_view(eye, directions, weights, near, direct, aspect)
    # What stands between the eye and the nearest hit need not be in the way.
    ahead = (directions * length[usable, None]) @ view.forward
    ahead = ahead[~ways.is_sky[usable] & (ahead > near)]
    if not len(ahead):
        return view
    nearer = max(near, NEAR_SHARE * float(ahead.min()))
    return replace(view, near=nearer)


def place_skies(
    scene: Scene, views: Views, ways: Ways, most: int, aspect: float
) -> list[RadianceView]:
    """Cameras that show the world alone, for directions in which no other view shows it."""
    direct = views[0]
    sky = np.flatnonzero(ways.is_sky & ~scene.is_known(ways))
    if not len(sky):
        return []
    ways = ways.take(sky[:: max(1, len(sky) // TRIED)])
    total = ways.weight.sum()
    left = ways.take(np.flatnonzero(show(scene, views, ways).view == UNSEEN))
    found: list[RadianceView] = []
    while len(found) < most and left.weight.sum() > FAINT_SKY * total:
        # Round the direction near which most of the light comes from.
        near = left.direction @ left.direction[:: max(1, len(left) // 200)].T > np.cos(WIDEST)
        axis = int((left.weight[:, None] * near).sum(axis=0).argmax())
        here = np.flatnonzero(near[:, axis])
        view = aimed_view(
            direct.eye, left.direction[here], left.weight[here], 0.0, direct, aspect, 1.0
        )
        view = replace(view, sky_only=True)
        _, inside = view.pixels_of_sky(left.direction)
        if not inside.any():
            break
        found.append(view)
        left = left.take(np.flatnonzero(~inside))
    return found
