# SPDX-License-Identifier: GPL-3.0-or-later
"""What the ways of rays meet at last, and which radiance view shows that best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...optics.vectors import dot
from ..read.arrays import unit
from .caster import Caster, Past
from .columns import Columns, joined
from .sketches import Sketch, Sketches
from .sky import Sky
from .things import Met, Things
from .views import WIDEST, RadianceView, aimed_view, quantiles, squares, virtual_eye

UNSEEN, KNOWN = -1, -2
"""In place of a view's number: no view shows the hit; its radiance is known without one."""
SKIN = 1e-4
"""Of a sight's length: a surface nearer than this before a hit is the hit's own."""
CAPTURE_WORTH = 0.4
"""A capture's resolution counts this much of the direct picture's: it has fewer samples."""
LIT_ELSEWHERE_WORTH = 1e-6
"""The same where a capture's camera brings its own light: it stands in where nothing else sees."""
ENOUGH_SEEN = 0.002
"""Part of all light: while less than this is unseen no further capture is placed."""
STRONG = 0.1
"""Part of a ray's light from which on the sharpest view is looked for."""
FAINT_SKY = 0.002
"""Part of the sky's light: while less than this is unseen no further view of it is placed."""
DISPENSABLE = 0.0035
"""Part of all light: a capture without which less than this is unseen goes, see `DULLER` too."""
DULLER = 0.0045
"""Part of all light, by `SEEN`: so much may be less fine without a capture that goes."""
ENOUGH_FINE = 0.02
"""Part of all light: what lacks in fineness may be so much before a capture is placed for it."""
SEEN = 0.8
"""Of a hit's worth: to be seen at all, however coarsely."""
COARSE = 0.1
"""Of a hit's worth: while less than this lacks, no capture need show it better."""
TOGETHER = 200_000
"""Ways that are looked for in the views together: while they are, each takes half a kilobyte."""
KINDS = 5
"""Of light paths whose virtual eyes are tried for a capture, those with most unseen light."""
NEAR_SHARE = 0.5
"""Part of the distance to the nearest hit from where a capture sees."""
BACK = 1.0
"""How far before surfaces an eye stands that sees them squarely, in their hits' spread."""
TRIED = 4000
"""Ways that decide how well a place for a capture suits."""
GRAZING = 1.0 / 64.0
"""A view that meets a surface at so much less than the way does, by sines, shows only streaks."""
JUDGED = 20_000
"""Ways by which captures are compared."""
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""The golden ratio: fractions of its multiples are spread evenly and never come again."""
LEAST_LENGTH = 1e-300
"""Metres: keeps a quotient finite."""
LEAST_MATCH = 1e-3
"""Of a glossy hit's worth, whatever the direction: it is better seen so than not."""
GLOSSY_POWER = 8.0
"""Of the cosine between way and sight, by which a view of a glossy surface is judged."""


@dataclass(frozen=True, eq=False)
class Ways(Columns):
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

    def scaled(self, factor: np.ndarray) -> Ways:
        """The same with other weights: times a factor (K,)."""
        return replace(self, weight=self.weight * factor, colour=self.colour * factor[:, None])

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

    def points(self, rows: np.ndarray) -> np.ndarray:
        """The same (n, 3) of some of them, by their numbers."""
        far = np.where(self.triangle[rows] < 0, 0.0, self.distance[rows])
        return self.origin.take(rows, axis=0) + self.direction.take(rows, axis=0) * far[:, None]


@dataclass(frozen=True, eq=False)
class Shown(Columns):
    """By which view each way's hit is shown: (K,) number or `UNSEEN` or `KNOWN`, and its frame
    pixels (K, 2) there."""

    view: np.ndarray
    pixels: np.ndarray


Views = Sequence[RadianceView | None]
"""By number; None where a frame needs fewer."""


@dataclass(frozen=True, eq=False)
class Hits(Columns):
    """What is known of the hits of ways, whichever view is asked for them.

    Attributes
    ----------
    point, direction : (K, 3) the hit, or where the way begins that meets none; the way's direction.
    triangle : (K,) −1: the sky. normal : (K, 3) of the triangle, 0 for the sky.
    side : (K,) 1 or −1 for the side of the triangle that the way comes from.
    sine : (K,) of the angle between way and triangle.
    glossy : (K,) whether it looks different from elsewhere.
    uncaptured : (K,) whether the direct picture alone may show it.
    captured : (K,) whether captures alone may.
    """

    point: np.ndarray
    direction: np.ndarray
    triangle: np.ndarray
    normal: np.ndarray
    side: np.ndarray
    sine: np.ndarray
    glossy: np.ndarray
    uncaptured: np.ndarray
    captured: np.ndarray

    @property
    def is_sky(self) -> np.ndarray:
        """(K,) which are none."""
        return self.triangle < 0


class Scene:
    """The things that ways meet, ready to be looked for in views.

    sky : what those see that meet nothing.
    capture_worth : how much a capture's resolution counts of the direct picture's.
    sketches : what is known of views; of a frame that follows none, new ones.
    skin : metres by which a ray is put behind a lamp that it passes, at least.

    Attributes
    ----------
    caster : of what light meets that leaves a glass: of lamps it passes what is dark for it, of
        what an image cuts out the holes.
    eyes : of what cameras show: lamps are hidden from most.
    normals : (T + 1, 3) unit vectors of the triangles, and 0: the sky's, by its number −1.
    is_shining : (L,) surfaces whose light is known without a view.
    is_paned : captures look through a pane: something looks otherwise to cameras.
    """

    def __init__(
        self,
        caster: Caster,
        things: Things,
        sky: Sky,
        capture_worth: float = CAPTURE_WORTH,
        sketches: Sketches | None = None,
        skin: float = 0.0,
    ) -> None:
        self.things, self.sky = things, sky
        self.capture_worth = capture_worth
        self._sketches = Sketches() if sketches is None else sketches
        a, b, c = (things.points[things.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        self.normals = np.append(unit(normals), np.zeros((1, 3)), 0)
        looks = things.looks
        # The sky is the last, by its number −1.
        self._is_lamp = np.array([*(look.is_lamp for look in looks), False], bool)
        self.is_shining = np.array([look.is_lamp or look.is_plain for look in looks], bool)
        self._is_glossy = np.array([*(look.is_glossy for look in looks), False], bool)
        self._is_hole = np.array([*(look.is_hole for look in looks), True], bool)
        self._is_hidden = np.array([*(look.is_hidden for look in looks), False], bool)
        self._is_uncaptured = np.array([*(look.is_uncaptured for look in looks), False], bool)
        self._is_captured = np.array([*(look.is_of_cameras for look in looks), False], bool)
        self.is_paned = self._is_captured.any()
        self._is_cut = np.array([look.cutout is not None or look.faces for look in looks], bool)
        varies = self._is_lamp.any() or self._is_cut.any()
        self.caster = Past(caster, self._is_there, skin) if varies else caster
        hides = self._is_hidden.any()
        self.eyes = Past(self.caster, self._is_shown, skin) if hides else self.caster

    def _is_there(self, met: Met) -> np.ndarray:
        """(K,) whether rays meet what is there.

        Lamps are there for light of their own only, and what a material cuts out is there in part.
        """
        surface = self.things.surface[met.triangle]
        there = np.ones(len(surface), bool)
        for number in np.unique(surface[(self._is_lamp[:-1] | self._is_cut)[surface]]):
            here = np.flatnonzero(surface == number)
            look, found = self.things.looks[number], met.take(here)
            sides = self.normals[found.triangle], found.direction
            if look.is_lamp:
                there[here] = any(look.radiance) & (look.lights(*sides) > 0.0)
                continue
            there[here] = look.is_before(*sides)
            if look.cutout is not None:
                there[here] &= ~look.cutout.clears(self.things.mapped(found))
        return there

    def _is_shown(self, met: Met) -> np.ndarray:
        """(K,) whether cameras show what their rays meet."""
        return ~self._is_hidden[self.things.surface[met.triangle]]

    def is_known(self, ways: Ways) -> np.ndarray:
        """(K,) whose light is known without a view: lamps and what shines in one colour, a sky of
        one colour, and none."""
        known = np.append(self.is_shining, False).take(self.things.surfaces(ways.triangle))
        if self.sky.radiance is not None:
            known |= ways.is_sky
        red, green, blue = ways.colour.T
        dark = (red == 0.0) & (green == 0.0) & (blue == 0.0)
        return known | self.is_clear(ways) | dark

    def is_clear(self, ways: Ways) -> np.ndarray:
        """(K,) which show a hole in the picture: the sky or a holdout, of a transparent film.

        So does a lamp: what is behind it is there beside it.
        """
        if not self.sky.is_cut_out:
            return np.zeros(len(ways), bool)
        hole = (self._is_hole | self._is_lamp).take(self.things.surfaces(ways.triangle))
        return hole & self.sky.is_clear(ways)

    def side(self, ways: Ways) -> np.ndarray:
        """(K,) 1 or -1 for the side of the triangle that ways meet, 0 of the sky."""
        normal = self.normals.take(ways.triangle, axis=0)
        facing = np.einsum("nk,nk->n", ways.direction, normal)
        side = np.where(facing > 0.0, np.int8(-1), np.int8(1))
        return np.where(ways.is_sky, np.int8(0), side)

    def hits(self, ways: Ways, rows: np.ndarray) -> Hits:
        """The hits of some ways, by their numbers."""
        triangle, direction = ways.triangle[rows], ways.direction.take(rows, axis=0)
        normal = self.normals.take(triangle, axis=0)
        surface = self.things.surfaces(triangle)
        marks = self._is_glossy, self._is_uncaptured, self._is_captured
        facing = np.einsum("nk,nk->n", direction, normal)
        side, sine = np.sign(facing), np.abs(facing)
        known = ways.points(rows), direction, triangle, normal, side, sine
        return Hits(*known, *(mark.take(surface) for mark in marks))

    def worth(self, view: RadianceView, hits: Hits, direct: bool) -> tuple[np.ndarray, np.ndarray]:
        """How well a view shows each hit (K,), 0 where it lies outside, and its pixels there."""
        sky = np.flatnonzero(hits.is_sky)
        local = view.local(hits.point)
        near = view.near
        if len(sky):
            local[sky] = view.turned(hits.direction[sky])
            near = np.where(hits.is_sky, 0.0, view.near)
        pixels, inside = view.project(local, near)
        inside &= hits.is_sky | (-local[:, 2] < view.far)
        if view.is_parallel:
            towards = np.broadcast_to(view.forward, local.shape)
            length = 1.0
        else:
            towards = hits.point - view.eye
            length = np.maximum(np.sqrt(squares(local)), LEAST_LENGTH)
        sides = np.einsum("nk,nk->n", towards, hits.normal)
        # The other side of a face may look different.
        shown = inside & (sides * hits.side > GRAZING * hits.sine * length)
        worth = shown * (view.focal_px / length) * np.sqrt(np.abs(sides) / length)
        glossy = np.flatnonzero(hits.glossy & shown)
        if len(glossy):
            along = np.einsum("nk,nk->n", towards[glossy], hits.direction[glossy])
            along /= 1.0 if view.is_parallel else length[glossy]
            worth[glossy] *= np.clip(0.5 + 0.5 * along, 0.0, 1.0) ** GLOSSY_POWER + LEAST_MATCH
        if view.sky_only:
            worth[:] = 0.0
        if not direct:
            worth[hits.uncaptured] = 0.0
        if view.is_parallel or not (view.sky_only or self.sky.is_in_pictures):
            worth[sky] = 0.0
        else:
            worth[sky] = inside[sky] * view.focal_px
        return worth * (1.0 if direct else self.capture_worth), pixels

    def sketch(self, view: RadianceView) -> Sketch:
        """What the middles of a view's pixels meet."""
        return self._sketches.of(view, self.things, self.normals, self._eyes_of(view))

    def _eyes_of(self, view: RadianceView) -> Caster | Past:
        return self.caster if view.is_paned else self.eyes

    def shows(
        self, view: RadianceView, hits: Hits, some: np.ndarray, pixels: np.ndarray
    ) -> np.ndarray:
        """(K,) whether a view's picture shows some hits, by their numbers, at pixels (K, 2).

        Beside silhouettes it takes a look: what its pixels' middles meet tells of all others.
        """
        triangle = hits.triangle[some]
        if view.sky_only:
            return triangle < 0
        length = np.where(triangle < 0, np.inf, view.lengths(hits.point.take(some, axis=0)))
        found, hidden = self.sketch(view).shows(pixels, triangle, length)
        left = np.flatnonzero(~(found | hidden))
        found[left] = self.sees(view, hits.take(some[left]))
        return found

    def sees(self, view: RadianceView, hits: Hits) -> np.ndarray:
        """(K,) whether nothing stands between a view and the hits, which lie in its frame."""
        sky = hits.is_sky
        origins, directions, lengths = view.sight(hits.point)
        if sky.any():
            origins, directions = origins.copy(), directions.copy()
            directions[sky] = hits.direction[sky]
            origins[sky] = view.sky_sight(hits.direction[sky])
        distance, triangle = self._eyes_of(view).cast(origins, directions)
        met = (triangle == hits.triangle) | (distance >= lengths * (1.0 - SKIN))
        return np.where(sky, triangle < 0, met)


def show(scene: Scene, views: Views, ways: Ways) -> Shown:
    """For each way the view that shows its hit best; the first view is the direct picture."""
    if len(ways) <= TOGETHER:
        return _show(scene, views, ways)
    return joined(Shown, (_show(scene, views, ways.take(b)) for b in blocks_of(len(ways))))


def blocks_of(count: int) -> Iterator[np.ndarray]:
    """Numbers up to a count, at most so many together as are looked for together; one block at
    least."""
    for first in range(0, max(1, count), TOGETHER):
        yield np.arange(first, min(first + TOGETHER, count))


def _show(scene: Scene, views: Views, ways: Ways) -> Shown:
    total = len(ways)
    chosen = np.full(total, UNSEEN, np.int8)
    pixels = np.zeros((total, 2))
    known = scene.is_known(ways)
    chosen[known] = KNOWN
    rows = np.flatnonzero(~known)
    numbered = {number: view for number, view in enumerate(views) if view is not None}
    hits = scene.hits(ways, rows)
    # All views are compared where much light comes along a way, and where what a surface shows
    # depends on where it is seen from. Else the direct picture shows what it can.
    captures = {number: view for number, view in numbered.items() if number}
    captured = hits.captured & any(not view.sky_only for view in captures.values())
    compared = (hits.glossy | (ways.weight[rows] > STRONG)) & ~captured
    some, rest = np.flatnonzero(compared), np.flatnonzero(~(compared | captured))
    _choose(scene, numbered, hits.take(some), rows[some], chosen, pixels)
    _choose(scene, {0: numbered[0]}, hits.take(rest), rows[rest], chosen, pixels)
    rest = np.flatnonzero(~compared & (chosen[rows] == UNSEEN))
    _choose(scene, captures, hits.take(rest), rows[rest], chosen, pixels)
    return Shown(chosen, pixels)


def _choose(scene: Scene, views: dict[int, RadianceView], hits: Hits, rows, chosen, pixels) -> None:
    """Put the view that shows each of some ways' hits best, and its pixels there, into arrays."""
    if not len(rows) or not views:
        return
    numbers = list(views)
    judged = [scene.worth(views[number], hits, number == 0) for number in numbers]
    worth = np.stack([w for w, _ in judged], axis=1)
    left = np.arange(len(rows))
    for _ in numbers:
        best = worth[left].argmax(axis=1)
        shown = worth[left, best] > 0.0
        left, best = left[shown], best[shown]
        lacking = []
        for place, number in enumerate(numbers):
            here = left[best == place]
            if not len(here):
                continue
            at = judged[place][1].take(here, axis=0)
            seen = scene.shows(views[number], hits, here, at)
            found, hidden = here[seen], here[~seen]
            chosen[rows[found]] = number
            pixels[rows[found]] = at[seen]
            worth[hidden, place] = 0.0
            lacking.append(hidden)
        left = np.concatenate([left[:0], *lacking])


def judged(count: int, wanted: int = JUDGED) -> np.ndarray:
    """Numbers of the ways, of so many, by which captures are compared.

    One in each of equal parts, all if they are fewer than twice those wanted. Each ray has its ways
    in a row: where all have as many, every second or fourth way would be of one path alone. So the
    places in the parts differ, by the golden ratio.
    """
    step = max(1, count // wanted)
    parts = np.arange(count // step)
    return parts * step + (step * (parts * GOLDEN % 1.0)).astype(int)


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
    ways : of one ray a pixel, as `judged` chooses them.
    spacing : (K,) metres between their hits in neighbouring pixels.
    most : captures at most. aspect : height of a pixel over its width.
    near : metres, the least distance from where a camera sees.
    """
    known = scene.is_known(ways)
    total = ways.weight.sum()
    hits = scene.hits(ways, np.arange(len(ways)))
    # Captures of less worth are not placed for what they would show more finely.
    fine = spacing * (CAPTURE_WORTH / scene.capture_worth)
    shown = _seen(scene, direct, hits, _quality(scene, direct, hits, fine))
    shown[hits.captured] = 0.0
    # Views of the sky alone show one that the film leaves out, or that cameras see otherwise.
    shown[known | hits.uncaptured | (ways.is_sky & (not scene.sky.is_in_pictures))] = 1.0
    begin = shown
    captures: list[RadianceView] = []
    qualities: list[np.ndarray] = []
    while len(captures) < most and len(ways):
        lacking = ways.weight * (1.0 - shown)
        unseen = ways.weight[shown == 0.0].sum()
        if unseen < ENOUGH_SEEN * total and lacking.sum() < ENOUGH_FINE * total:
            break
        some = np.flatnonzero(1.0 - shown > COARSE)
        if not len(some):
            break
        left = replace(ways.take(some), weight=lacking[some])
        found = _best_capture(
            scene, direct, left, hits.take(some), spacing[some], shown[some], aspect, near
        )
        if found is None:
            break
        view, quality = found
        captures.append(view)
        qualities.append(np.zeros(len(ways)))
        qualities[-1][some] = quality
        shown = np.maximum(shown, qualities[-1])
    for number in reversed(range(len(captures))):
        # Some captures show little that those after them do not show as well.
        others = qualities[:number] + qualities[number + 1 :]
        without = np.maximum.reduce([begin, *others])
        unseen = ways.weight[without == 0.0].sum()
        less = (ways.weight * (shown - without)).sum()
        if unseen < DISPENSABLE * total and less < DULLER * total:
            shown = without
            del captures[number], qualities[number]
    return captures


def _quality(scene: Scene, view: RadianceView, hits: Hits, spacing: np.ndarray) -> np.ndarray:
    """(K,) how well a view shows hits that nothing hides: 0 not at all, else from `SEEN` to 1."""
    worth, _ = scene.worth(view, hits, True)
    shown = np.flatnonzero(worth > 0.0)
    quality = np.zeros(len(hits))
    # The sky has no fine detail.
    fine = np.where(hits.is_sky[shown], 1.0, np.minimum(worth[shown] * spacing[shown], 1.0))
    quality[shown] = SEEN + (1.0 - SEEN) * fine
    return quality


def _seen(scene: Scene, view: RadianceView, hits: Hits, quality: np.ndarray) -> np.ndarray:
    """(K,) the quality of hits that a view sees, 0 of the others."""
    here = np.flatnonzero(quality > 0.0)
    hidden = here[~scene.sees(view, hits.take(here))]
    found = quality.copy()
    found[hidden] = 0.0
    return found


def _best_capture(
    scene: Scene,
    direct: RadianceView,
    ways: Ways,
    hits: Hits,
    spacing: np.ndarray,
    shown: np.ndarray,
    aspect: float,
    near: float,
):
    """The capture that adds most, by the ways' weights, and how well (K,) it shows each."""
    kinds, kind = np.unique(ways.path, return_inverse=True)
    light = np.bincount(kind, ways.weight, len(kinds))
    groups = [np.flatnonzero(kind == k) for k in np.argsort(-light, kind="stable")[:KINDS]]
    groups.append(np.arange(len(ways)))
    groups = [group[judged(len(group), TRIED)] for group in groups]
    aims = [(hits.take(group), ways.weight[group]) for group in groups]
    parts = [(ways.origin[group], ways.direction[group], ways.weight[group]) for group in groups]
    tried = [(virtual_eye(*part), aim) for part, aim in zip(parts, aims, strict=True)]
    # From where the light leaves the glass it sees what the exit rays see.
    tried += [
        (np.average(origin, axis=0, weights=weight), aim)
        for (origin, _, weight), aim in zip(parts, aims, strict=True)
    ]
    tried += [(eye, aims[-1]) for eye, aim in tried if aim is not aims[-1]]
    tried += [(eye, aims[-1]) for eye in (_eye_before(*aim) for aim in aims) if eye is not None]

    def gain(quality: np.ndarray) -> float:
        # What lacks counts by its share: ways.weight holds what each lacks already.
        return float((ways.weight * np.maximum(quality - shown, 0.0) / (1.0 - shown)).sum())

    views = [_capture_from(eye, *aim, direct, aspect, near) for eye, aim in tried]
    views = [replace(v, is_paned=scene.is_paned) for v in views if v is not None]
    rated = [(v, _quality(scene, v, hits, spacing)) for v in views]
    most = [gain(quality) for _, quality in rated]
    best, found = 0.0, None
    # No view adds more than if nothing hid its hits: most need no look.
    for number in np.argsort([-value for value in most], kind="stable"):
        if most[number] <= best:
            break
        view, quality = rated[number]
        quality = _seen(scene, view, hits, quality)
        if gain(quality) > best:
            best, found = gain(quality), (view, quality)
    if found is None:
        return None
    # No finer than the picture: what it shows takes fewer of its pixels then, and of its time.
    worth, _ = scene.worth(found[0], hits, True)
    fine = np.flatnonzero((found[1] > 0.0) & np.isfinite(spacing) & ~hits.is_sky)
    if not len(fine):
        return found
    (too_fine,) = quantiles(worth[fine] * spacing[fine], ways.weight[fine], 0.5)
    if too_fine <= 1.0:
        return found
    view = found[0].opened(too_fine)
    return view, _seen(scene, view, hits, _quality(scene, view, hits, spacing))


def _eye_before(hits: Hits, weight: np.ndarray) -> np.ndarray | None:
    """(3,) from where surfaces that are met from all sides are seen squarely; None of the sky."""
    some = np.flatnonzero(~hits.is_sky)
    if not len(some):
        return None
    points, weight = hits.point[some], weight[some]
    middle = np.average(points, axis=0, weights=weight)
    reach = np.sqrt(np.average(squares(points - middle), weights=weight))
    towards = -np.average(hits.normal[some] * hits.side[some, None], axis=0, weights=weight)
    length = np.linalg.norm(towards)
    return middle + towards * (BACK * reach / length) if length > 0.0 else None


def _capture_from(
    eye, hits: Hits, weight: np.ndarray, direct: RadianceView, aspect: float, near: float
):
    """A view from an eye that shows as many hits as it can open to."""
    point, direction = (np.ascontiguousarray(part.T) for part in (hits.point, hits.direction))
    towards, sky = point - eye[:, None], np.flatnonzero(hits.is_sky)
    towards[:, sky] = direction[:, sky]
    length = np.sqrt(dot(towards, towards))
    usable = np.flatnonzero(length > near)
    if not len(usable):
        return None
    length = length.take(usable)
    directions = towards.take(usable, axis=1) / length
    view = aimed_view(eye, directions.T, weight.take(usable), near, direct, aspect)
    # What stands between the eye and the nearest hit need not be in the way.
    ahead = dot(directions, view.forward) * length
    ahead = ahead[~hits.is_sky.take(usable) & (ahead > near)]
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
    ways = ways.take(sky[judged(len(sky), TRIED)])
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
