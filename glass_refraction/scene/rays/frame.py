# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame: from the evaluated scene to the pictures that the compositor sums.

It reads nothing of Blender's and writes nothing: :mod:`true` does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..light.light import KeptLight, light_maps
from ..progress import tell
from ..read.viewpoint import Viewpoint
from .blur import blurred_glasses, blurred_parts, blurred_things, keep_near
from .caster import Casters
from .columns import joined
from .curtain import curtain, looked_up
from .edges import off_edges, shining_looks
from .exits import (
    BLURRED,
    FinerRays,
    Neighbours,
    PictureRays,
    between,
    centre_rays,
    ending,
    filter_sigma,
    grid,
    neighbours,
    spacing,
)
from .follow import Follower, Kept
from .glints import evened
from .hits import (
    KNOWN,
    UNSEEN,
    Scene,
    Shown,
    Views,
    Ways,
    blocks_of,
    judged,
    place_captures,
    place_skies,
    show,
)
from .looks import Clear
from .mirrors import mirrors_of, veils_of
from .polish import amendments, polished
from .radiance import Lookups, stand_ins
from .samples import Packed, PackedPixels, pack, strongest
from .small_lights import small_lights
from .stage import FrameInput, Stage, corners_of, shining, staged
from .suns import out_of_focus, sun_light
from .things import Things
from .views import RadianceView

NEAREST = 1e-3
"""Part of the glasses' size from where captures see at least."""
FAR, FARTHER = 1e3, 1.1
"""Metres that a view sees where there is nothing, and how far beyond the farthest thing, times."""
PART_OF_LENS = 0.3
"""Of a lens's radius: a pixel's rays come from places all over it, each of which stands for so much
round it. A view through so large a lens shows what lies between them."""
NO_CURTAIN = np.zeros((0, 3)), np.zeros((0, 4), int)
NOISIEST, MOST_NOISE = 2.0, 0.7
"""Variance of what a view shows, over that of what the direct picture shows: see `_worth`."""
ROOMY = 2
"""Captures from which on a blurred glass's twin view has room."""
FOLLOWING = "following light through the glass"
"""What users are told meanwhile."""


@dataclass(frozen=True)
class Room:
    """Views that the compositor has room for, beside the direct picture."""

    captures: int
    skies: int


@dataclass(frozen=True, eq=False)
class Placed:
    """A frame's views.

    Attributes
    ----------
    views : the direct picture and those beside it, by number; None where fewer are needed.
    twin : number of the one that shows blurred rays what the direct picture shows, through a part
        of the lens and at the frame's own time; it has no place in ``views``. None: there is none.
    """

    views: tuple[RadianceView | None, ...]
    twin: int | None = None

    def with_twin(self, direct: RadianceView) -> Views:
        """All views."""
        if self.twin is None:
            return self.views
        lens = direct.lens and replace(direct.lens, radius=PART_OF_LENS * direct.lens.radius)
        views = list(self.views)
        views[self.twin] = replace(direct, lens=lens)
        return views


@dataclass(frozen=True)
class ViewReport:
    """What one radiance view gives: its name, samples a pixel, part of the light of all hits."""

    name: str
    samples: int
    share: float


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What a frame's compositor sums, and what is told of it.

    Attributes
    ----------
    placed : the views. cameras : of each beside the direct picture, None where it is not needed.
    samples : a pixel, of each of these. far : metres, how far each must see.
    curtains : of each, see :func:`curtain.curtain`.
    views : the pictures of each view's samples, the direct picture's first.
    weights : (K,) without tints, of the same samples.
    spread, known, known_alpha : see :mod:`sum_tree`.
    light : of each view, what white matte surfaces show more; none without `FrameInput.light`.
    mirrors : see :func:`mirrors.mirrors_of`. windows, veils : see :func:`mirrors.veils_of`, of
        what refracts and of what does not.
    reports : of each view. unseen : part of the hits' light that no view shows.
    rays : that bring any light. ways : of these. covered : pixels that any glass covers.
    """

    placed: Placed
    cameras: tuple[RadianceView | None, ...]
    samples: tuple[int, ...]
    far: tuple[float, ...]
    curtains: tuple[tuple[np.ndarray, np.ndarray], ...]
    views: list[Packed]
    weights: list[np.ndarray]
    spread: np.ndarray
    known: np.ndarray
    known_alpha: np.ndarray
    reports: tuple[ViewReport, ...]
    unseen: float
    rays: int
    ways: int
    covered: int
    light: tuple[np.ndarray, ...] = ()
    mirrors: dict[str, float] = field(default_factory=dict)
    windows: dict[str, float] = field(default_factory=dict)
    veils: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Rays:
    """What a picture's rays bring.

    Attributes
    ----------
    lookups : what shows the hits of their ways. count : rays that have ways.
    lit_pixel, lit : (G,) pixels of the picture that suns shine into straight, and colours (G, 3).
    dark_pixel, dark : (D,) pixels of which no way brings some light, and part of the pixel's.
    several : (height, width) rays of each pixel.
    """

    lookups: Lookups
    count: int
    lit_pixel: np.ndarray
    lit: np.ndarray
    dark_pixel: np.ndarray
    dark: np.ndarray
    several: np.ndarray


def compute(
    frame: FrameInput, casters: Casters, room: Room, kept: Kept, kept_light: KeptLight
) -> FrameResult:
    """The pictures of one frame.

    Parameters
    ----------
    kept, kept_light : what earlier frames found and this one may use; it changes the time, never
        the answer.
    """
    tell(FOLLOWING)
    stage = staged(frame, casters, kept)
    rays, placed = _followed(frame, stage, casters, room)
    tell("adding up the light")
    result = _summed(frame, stage, placed, rays)
    boxes = [corners_of(body) for body in stage.bodies]
    if boxes and frame.engine != "BLENDER_WORKBENCH":
        sides = np.array([(box.min(axis=0), box.max(axis=0)) for box in boxes])
        scene, direct = stage.scene, stage.direct
        mirrors = mirrors_of(scene, direct, sides) if frame.mirrors else {}
        windows, veils = (veils_of(scene, direct, sides, kind) for kind in Clear)
        result = replace(result, mirrors=mirrors, windows=windows, veils=veils)
    if frame.light is None:
        return result
    sigma = filter_sigma(frame.engine, frame.filter_size)
    found = rays.lookups
    views = placed.with_twin(stage.direct)
    places = [found.place[found.view == number] for number in range(len(views))]
    added = light_maps(
        frame.light, stage.scene, views, places, stage.follower, boxes, sigma, kept_light
    )
    return replace(result, light=tuple(_opaque(frame.exposure * part) for part in added))


def expose(frame: FrameInput, casters: Casters, kept: Kept, placed: Placed) -> FrameResult:
    """The picture of a frame that was computed before, now that more of its moments are known.

    ``placed``: its views.
    """
    tell(FOLLOWING)
    stage = staged(frame, casters, kept)
    rays, _ = _followed(frame, stage, casters, placed)
    tell("adding up the light")
    return _summed(frame, stage, placed, rays)


def _followed(
    frame: FrameInput, stage: Stage, casters: Casters, room: Room | Placed
) -> tuple[Rays, Placed]:
    """What the picture's rays bring, and the views that show it; these may have been placed."""
    view, scene, follower = frame.view, stage.scene, stage.follower
    if frame.captures < ROOMY:
        frame = replace(frame, shutter=None, view=replace(view, lens=None))
    soft, blur, rects = blurred_glasses(frame, stage.bodies)
    pixels = grid(rects, view.size)
    coarse = centre_rays(pixels, follower)
    beside = neighbours(coarse, view.size)
    blurred_things(frame, blur, rects, coarse.ways, beside.pixel)
    met = np.append(beside.pixel, pixels[coarse.dark > 0.0])
    keep_near(blur, np.bincount(met, minlength=blur.size).reshape(blur.shape) > 0)
    if isinstance(room, Placed):
        placed = room
    else:
        is_blurred = frame.shutter is not None or (blur > BLURRED[0][1]).any()
        placed = _placed(frame, stage, coarse, beside, room, is_blurred)
    views = placed.views
    shown = show(scene, views, coarse.ways)
    surface = frame.things.surfaces(coarse.ways.triangle)
    shines = np.append(shining_looks(frame.things), False)
    light = shining(frame)
    small = small_lights(scene, coarse.ways, beside, light)
    ends = ending(coarse, beside, shown, surface, view.size, light[surface], shines[surface], small)
    # A way's end may lie in the next pixel, which a cropped picture need not hold.
    drawn = np.zeros(len(ends.pixel), bool)
    drawn[grid([frame.region], view.size)] = True
    ends = replace(ends, pixel=np.where(drawn, ends.pixel, 0.0))
    sigma = filter_sigma(frame.engine, frame.filter_size)
    glints = sun_light(coarse, beside, frame.sky.suns, sigma, follower, frame.clamp)
    lit = np.flatnonzero(glints.any(axis=1))
    lit_pixel, lit = out_of_focus(
        beside.pixel[lit],
        glints[lit] * coarse.ways.colour[lit],
        np.where(soft > BLURRED[0][1], soft, 0.0),
    )
    inside = drawn[lit_pixel]
    lit, lit_pixel = lit[inside], _window_pixels(lit_pixel[inside], view)
    tell(FOLLOWING)
    finer = FinerRays(coarse, ends, sigma, follower, blur.ravel())
    centres = (coarse, shown, beside)
    counts: list[int] = []
    blurred = blurred_parts(frame, stage, casters, finer, float(blur.max()))
    parts = _lookups(frame, scene, placed, finer, blurred, follower, [centres], counts)
    # The largest arrays are held no longer than they are needed.
    del beside, coarse, ends, glints, shown, centres
    found = joined(Lookups, parts)
    views = placed.with_twin(stage.direct)
    stay, factor = len(finer.kept), finer.factor
    found.weight[:stay] *= factor
    found.colour[:stay] *= factor[:, None]
    found.most[:stay] *= factor
    unmet = np.flatnonzero(finer.unmet)
    if len(unmet):
        rows = np.isin(found.pixel, _window_pixels(unmet, view))
        for part in (found.weight, found.share, found.most):
            part[rows] = 0.0
    off_edges(scene, views, found.view, found.place, frame.things.surfaces(found.triangle))
    dark = finer.dark
    some = np.flatnonzero(dark)
    dark_pixel = _window_pixels(finer.pixel[some], view)
    x0, y0, x1, y1 = view.window
    several = finer.rays.reshape(view.size[::-1])[y0:y1, x0:x1]
    return Rays(found, sum(counts), lit_pixel, lit, dark_pixel, dark[some], several), placed


def _placed(
    frame: FrameInput,
    stage: Stage,
    coarse: PictureRays,
    beside: Neighbours,
    room: Room,
    is_blurred: bool,
) -> Placed:
    """The views that a frame needs; one capture less where its twin needs room."""
    tell("placing cameras for what else is seen in the glass")
    rows = judged(len(coarse.ways))
    captures = place_captures(
        stage.scene,
        stage.direct,
        coarse.ways.take(rows),
        spacing(coarse.ways, beside, rows),
        min(frame.captures, room.captures) - is_blurred,
        frame.aspect,
        NEAREST * stage.scale,
    )
    views = [stage.direct, *captures, *[None] * (room.captures - len(captures))]
    skies = place_skies(stage.scene, views, coarse.ways, room.skies, frame.aspect)
    views += [*skies, *[None] * (room.skies - len(skies))]
    return Placed(tuple(views), 1 + len(captures) if is_blurred else None)


def _lookups(
    frame: FrameInput,
    scene: Scene,
    placed: Placed,
    finer: FinerRays,
    blurred: Iterator[PictureRays],
    follower: Follower,
    centres: list,
    counts: list,
) -> Iterator[Lookups]:
    """What shows the ways of the centres that stay, and of the finer rays.

    Parameters
    ----------
    blurred : rays of the pixels that a lens or motion blurs.
    centres : one ray a pixel, what shows its ways, and their neighbours; it is emptied.
    counts : gets how many rays have ways, of each part.
    """
    coarse, shown, beside = centres.pop()
    views = placed.views
    counts.append(np.count_nonzero(np.bincount(coarse.ways.ray[finer.kept])))
    stay = np.intersect1d(polished(scene, coarse.ways, shown), finer.kept)
    amended = _amended(frame, scene, views, follower, coarse.ways, shown, stay)
    for rows in blocks_of(len(finer.kept)):
        some = finer.kept[rows]
        places = between(shown.pixels, beside, some, finer.offset[rows], views[0].region)
        yield Lookups.of(
            scene,
            coarse.ways.take(some),
            Shown(shown.view[some], places),
            _window_pixels(beside.pixel[some], frame.view),
            finer.share[rows],
            frame.clamp,
        )
    stay_pixel = _window_pixels(beside.pixel[stay], frame.view)
    of_stay = np.flatnonzero(np.isin(finer.kept, stay))
    which = np.searchsorted(stay, finer.kept[of_stay])
    del coarse, shown, beside
    for parts, are_blurred in ((finer.parts(), False), (blurred, True)):
        for rays in parts:
            ways, pixel = rays.ways, _window_pixels(rays.pixel[rays.ways.ray], frame.view)
            counts.append(np.count_nonzero(np.bincount(ways.ray)))
            shown, share = show(scene, views, ways), rays.share[ways.ray]
            rows = polished(scene, ways, shown)
            for lookups_of in _amended(frame, scene, views, follower, ways, shown, rows):
                yield lookups_of(pixel[rows], share[rows])
            if are_blurred and placed.twin is not None:
                shown.view[shown.view == 0] = placed.twin
            yield Lookups.of(scene, ways, shown, pixel, share, frame.clamp)
    # All shares are known now.
    share = (finer.share * finer.factor)[of_stay]
    share = np.bincount(which, share, len(stay))
    for lookups_of in amended:
        yield lookups_of(stay_pixel, share)


def _amended(
    frame: FrameInput,
    scene: Scene,
    views: Views,
    follower: Follower,
    ways: Ways,
    shown: Shown,
    rows: np.ndarray,
) -> list[Callable[[np.ndarray, np.ndarray], Lookups]]:
    """What amends the mirror images in polished faces that some ways meet, by their numbers (n,).

    The ways' own colours become those of the matte parts. Returns what makes lookups of the pixels
    (n,) and the shares (n,) of the ways' rays.
    """
    if not len(rows):
        return []
    matte, *both = amendments(scene, views, follower, ways.take(rows), shown.take(rows))
    ways.colour[rows] *= matte[:, None]
    # A lamp's image in a glass is too small a thing to be taken away where it is to the pixel.
    cautious = replace(frame.clamp, indirect=1.0 / frame.exposure)

    def lookups_of(owner, mirrored, clamp, pixel, share) -> Lookups:
        at = show(scene, views, mirrored)
        found = Lookups.of(scene, mirrored, at, pixel[owner], share[owner], clamp)
        # The face's own lookup stands for the pixel.
        found.weight[:] = 0.0
        return found

    clamps = frame.clamp, cautious
    return [partial(lookups_of, *one, clamp) for one, clamp in zip(both, clamps, strict=True)]


def _summed(frame: FrameInput, stage: Stage, placed: Placed, rays: Rays) -> FrameResult:
    """The samples of all ways, packed for the compositor."""
    views = placed.with_twin(stage.direct)
    lookups = rays.lookups
    pixel, weight, view_number = lookups.pixel, lookups.weight, lookups.view
    light = weight.sum() + rays.dark.sum()
    unseen = weight[view_number == UNSEEN].sum() + rays.dark.sum()
    unseen = float(unseen / light) if light > 0.0 else 0.0
    known = np.flatnonzero(view_number == KNOWN)
    lacking, guessed = stand_ins(stage.scene, lookups)
    # A quarter of all that is held, and no longer needed.
    lookups.at = lookups.at[:0].copy()
    known, radiance = np.concatenate((known, lacking)), np.concatenate((lookups.light, guessed))
    order = np.argsort(known, kind="stable")
    known = known[order]
    colour = radiance.take(order, axis=0) * lookups.colour.take(known, axis=0)
    colour *= lookups.share[known, None]
    is_known = view_number[known] == KNOWN
    is_lamp = is_known & (lookups.triangle[known] >= 0)
    opaque = is_known & ~lookups.clear[known]
    opaque = (opaque * weight[known])[:, None] * np.ones(3)
    width, height = _window_size(frame.view)
    covering = np.bincount(pixel, weight, width * height)
    colour *= frame.exposure
    glint_pixel, glints = evened(pixel[known][is_lamp], colour[is_lamp], rays.several)
    brought = np.bincount(np.concatenate((pixel, rays.lit_pixel, glint_pixel)))
    packed = PackedPixels(np.flatnonzero(brought))
    covering += np.bincount(rays.dark_pixel, rays.dark, width * height)
    beside = np.clip(1.0 - covering, 0.0, 1.0)
    samples, parts, weights, reports, curtains = [], [], [], [], []
    skies = [n for n, view in enumerate(views) if view is not None and view.sky_only]
    for number, view in enumerate(views):
        some = np.flatnonzero(view_number == number)
        order = some[np.argsort(pixel[some], kind="stable")]
        order = order[strongest(pixel[order], weight[order])]
        uv = view.uv(lookups.place.take(order, axis=0)) if len(order) else np.zeros((0, 2))
        tinted = lookups.colour.take(order, axis=0) * lookups.share[order, None]
        most = frame.exposure * lookups.most[order]
        part = pack(packed, pixel[order], uv, tinted, most)
        parts.append(part)
        weights.append(weight[order].astype(np.float32))
        count, hidden = 1, NO_CURTAIN
        if view is not None and number:
            # In Cycles it saves the pixels' samples. In EEVEE it would stand in the way of what is
            # traced on the screen.
            if frame.shutter is None and frame.engine == "CYCLES":
                hidden = curtain(view, looked_up(view, lookups.place.take(some, axis=0)))
            lit = order
            if frame.shutter is not None and number == placed.twin:
                # Until more moments are known the direct picture shows what it will.
                lit = np.flatnonzero((view_number == 0) | (view_number == number))
            worth = _worth(pixel[lit], weight[lit], covering.sum())
            # Rounded: little more than one sample is not worth two.
            count = max(1, round(worth * frame.samples))
        samples.append(count)
        curtains.append(hidden)
        if view is not None:
            count = count if number else frame.samples
            name = f"capture {number}" if number else "direct"
            name = f"sky {skies.index(number) + 1}" if view.sky_only else name
            carried = float(weight[order].sum() / light) if light > 0.0 else 0.0
            reports.append(ViewReport(name, count, carried))
    return FrameResult(
        placed=placed,
        cameras=tuple(views[1:]),
        samples=tuple(samples[1:]),
        far=tuple(_far(frame.things, view) for view in views[1:]),
        curtains=tuple(curtains[1:]),
        views=parts,
        weights=weights,
        spread=packed.spread(beside.reshape(height, width)),
        known=packed.known(
            np.concatenate((colour[~is_lamp], glints, frame.exposure * rays.lit)),
            np.concatenate((pixel[known][~is_lamp], glint_pixel, rays.lit_pixel)),
        ),
        known_alpha=packed.known(opaque, pixel[known]),
        reports=tuple(reports),
        unseen=unseen,
        rays=rays.count,
        ways=len(lookups),
        covered=int((covering > 0.0).sum()),
    )


def _far(things: Things, view: RadianceView | None) -> float:
    """Metres to the farthest thing. Engines lose depths where a view sees far and begins near."""
    box = things.box()
    if view is None or not np.isfinite(box).all():
        return FAR
    corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)
    return float(max(FARTHER * np.linalg.norm(corners - view.eye, axis=1).max(), 2.0 * view.near))


def _worth(pixel: np.ndarray, weight: np.ndarray, covered: float) -> float:
    """How many samples a view needs, over the direct picture's.

    With s a pixel's light from the view, n samples leave noise of s² / n in it. That shall be at
    most `NOISIEST` times s over the direct picture's samples, the mean by light, and over all that
    glasses cover at most `MOST_NOISE` times what as many pixels of the direct picture have.
    """
    if not weight.any():
        return 0.0
    sums = np.bincount(pixel, weight)
    squares = float((sums**2).sum())
    return max(squares / (NOISIEST * sums.sum()), squares / (MOST_NOISE * covered))


def _window_pixels(pixel: np.ndarray, view: Viewpoint) -> np.ndarray:
    """Numbers of frame pixels in the picture, which may be cropped."""
    x0, y0, x1, _ = view.window
    y, x = np.divmod(pixel, view.size[0])
    return (y - y0) * (x1 - x0) + (x - x0)


def _window_size(view: Viewpoint) -> tuple[int, int]:
    x0, y0, x1, y1 = view.window
    return x1 - x0, y1 - y0


def _opaque(colour: np.ndarray) -> np.ndarray:
    out = np.ones((*colour.shape[:2], 4), np.float32)
    out[..., :3] = colour
    return out
