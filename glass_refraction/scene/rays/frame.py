# SPDX-License-Identifier: GPL-3.0-or-later
"""One frame: from the evaluated scene to the pictures that the compositor sums.

It reads nothing of Blender's and writes nothing: :mod:`true` does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ... import optics
from ..light.light import KeptLight, LightSettings, light_maps
from ..progress import tell
from ..read.glasses import Glass, as_bodies
from ..read.mesh_glasses import MeshGlass
from ..read.viewpoint import Viewpoint
from .caster import Casters
from .columns import joined
from .curtain import curtain, looked_up
from .edges import off_edges
from .exits import (
    LENS,
    MARGIN_PX,
    FinerRays,
    between,
    centre_rays,
    ending,
    filter_sigma,
    grid,
    neighbours,
    spacing,
)
from .follow import CONTACT, Band, Follower, Kept
from .hits import (
    CAPTURE_WORTH,
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
from .meshes import GlassMeshes
from .mirrors import mirrors_of, veils_of
from .polish import amendments, polished
from .radiance import Clamp, Lookups, stand_ins
from .samples import Packed, PackedPixels, pack, strongest
from .sky import Sky
from .suns import out_of_focus, sun_light
from .things import Things
from .views import RadianceView, direct_view

BAND_COLOURS = {"": (1.0, 1.0, 1.0), "red": (1.0, 0, 0), "green": (0, 1.0, 0), "blue": (0, 0, 1.0)}
"""What light of each band brings to a pixel's colours."""
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
FOLLOWING = "following light through the glass"
"""What users are told meanwhile."""


@dataclass(frozen=True, eq=False)
class FrameInput:
    """All that a frame's picture depends on.

    Attributes
    ----------
    glasses : those that can be computed. things, sky : what rays meet beside them.
    view : the camera. near, far : its clipping, metres. region : pixels that are rendered.
    aspect : height of a pixel over its width.
    engine, filter_size : of the user's render. samples : a pixel, of the direct picture.
    captures : captures at most. min_weight : part of a ray's light that ways must carry.
    fresnel : surfaces mirror and refract; else they only refract.
    clamp : of the light of lamps and of the sky.
    seen_through : names of what is seen through the glasses; None: all.
    exposure : by what the engine multiplies radiance in its pictures.
    capture_worth : see :class:`hits.Scene`.
    light : of lamps through the glasses; None: they light all as though there were none.
    mirrors : the engine has things mirrored in others.
    """

    glasses: tuple[Glass, ...]
    things: Things
    sky: Sky
    view: Viewpoint
    near: float
    far: float
    region: tuple[int, int, int, int]
    aspect: float
    engine: str
    filter_size: float
    samples: int
    captures: int
    min_weight: float
    fresnel: bool
    clamp: Clamp
    seen_through: frozenset[str] | None = None
    exposure: float = 1.0
    capture_worth: float = CAPTURE_WORTH
    light: LightSettings | None = None
    mirrors: bool = False


@dataclass(frozen=True)
class Room:
    """Views that the compositor has room for, beside the direct picture."""

    captures: int
    skies: int


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
    cameras : of each view beside the direct picture, None where it is not needed.
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
    """

    lookups: Lookups
    count: int
    lit_pixel: np.ndarray
    lit: np.ndarray
    dark_pixel: np.ndarray
    dark: np.ndarray


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
    bodies = as_bodies(frame.glasses)
    centre, scale = _place_and_size(bodies, frame.view)
    casters.things.aim(frame.things, centre, scale)
    meshes = GlassMeshes(casters.meshes, bodies, centre, scale)
    scene = Scene(
        casters.things,
        frame.things,
        frame.sky,
        frame.capture_worth,
        kept.sketches,
        CONTACT * scale,
    )
    direct = direct_view(frame.view, frame.region, frame.near, frame.far)
    follower = _follower(frame, scene, direct, bodies, meshes, kept)
    rays, views = _followed(frame, scene, direct, bodies, follower, scale, room)
    tell("adding up the light")
    result = _summed(frame, scene, views, rays)
    boxes = [_corners(body) for body in bodies]
    if bodies and frame.engine != "BLENDER_WORKBENCH":
        sides = np.array([(box.min(axis=0), box.max(axis=0)) for box in boxes])
        mirrors = mirrors_of(scene, direct, sides) if frame.mirrors else {}
        windows, veils = (veils_of(scene, direct, sides, kind) for kind in Clear)
        result = replace(result, mirrors=mirrors, windows=windows, veils=veils)
    if frame.light is None:
        return result
    sigma = filter_sigma(frame.engine, frame.filter_size)
    found = rays.lookups
    places = [found.place[found.view == number] for number in range(len(views))]
    added = light_maps(frame.light, scene, views, places, follower, boxes, sigma, kept_light)
    return replace(result, light=tuple(_opaque(frame.exposure * part) for part in added))


def _place_and_size(bodies: Sequence[Glass], view: Viewpoint) -> tuple[np.ndarray, float]:
    """The middle (3,) and the size, metres, of a box round all glasses."""
    if not bodies:
        return view.eye, 1.0
    low, high = _hull(bodies)
    return 0.5 * (low + high), float(np.linalg.norm(high - low))


def _hull(bodies: Sequence[Glass]) -> np.ndarray:
    """(2, 3): a box round all glasses, in the world; of none, one point."""
    if not bodies:
        return np.zeros((2, 3))
    corners = np.concatenate([_corners(body) for body in bodies])
    return np.array((corners.min(axis=0), corners.max(axis=0)))


def _corners(body: Glass) -> np.ndarray:
    """The corners (8, 3), in the world, of a box round a glass."""
    box = body.description.box
    return body.points_to_world(np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))


def _cut(rect, region) -> tuple[int, int, int, int]:
    return (
        max(rect[0], region[0]),
        max(rect[1], region[1]),
        min(rect[2], region[2]),
        min(rect[3], region[3]),
    )


def _follower(
    frame: FrameInput,
    scene: Scene,
    direct: RadianceView,
    bodies: Sequence[Glass],
    meshes: GlassMeshes,
    kept: Kept,
) -> Follower:
    """Follows the rays of the picture."""
    glasses = tuple(glass.stamp() for glass in frame.glasses)
    return Follower(
        direct,
        _bands(frame.glasses),
        scene.caster,
        scene.eyes,
        meshes,
        frame.things,
        _boxes(frame.things),
        _hull(bodies),
        (frame.min_weight, frame.fresnel, *glasses),
        frame.min_weight,
        frame.fresnel,
        kept,
        _shining(frame).max(),
        _through(frame),
    )


def _followed(
    frame: FrameInput,
    scene: Scene,
    direct: RadianceView,
    bodies: Sequence[Glass],
    follower: Follower,
    scale: float,
    room: Room,
) -> tuple[Rays, Views]:
    """What the picture's rays bring, and all views."""
    view = frame.view
    most = min(frame.captures, room.captures)
    blur, rects = _blurred(frame, direct if most > 1 else replace(direct, lens=None), bodies)
    is_blurred = (blur > LENS[0][1]).any()
    most -= is_blurred
    pixels = grid(rects, view.size)
    coarse = centre_rays(pixels, follower)
    beside = neighbours(coarse, view.size)
    tell("placing cameras for what else is seen in the glass")
    rows = judged(len(coarse.ways))
    captures = place_captures(
        scene,
        direct,
        coarse.ways.take(rows),
        spacing(coarse.ways, beside, rows),
        most,
        frame.aspect,
        NEAREST * scale,
    )
    sharp = 1 + len(captures)
    views = [direct, *captures, *[None] * (room.captures - len(captures))]
    skies = place_skies(scene, views, coarse.ways, room.skies, frame.aspect)
    views += [*skies, *[None] * (room.skies - len(skies))]
    shown = show(scene, views, coarse.ways)
    surface = frame.things.surfaces(coarse.ways.triangle)
    ends = ending(coarse, beside, shown, surface, view.size, _shining(frame)[surface])
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
        np.where(blur > LENS[0][1], blur, 0.0).reshape(view.size[::-1]),
    )
    inside = drawn[lit_pixel]
    lit, lit_pixel = lit[inside], _window_pixels(lit_pixel[inside], view)
    tell(FOLLOWING)
    finer = FinerRays(coarse, ends, sigma, follower, blur)
    centres = (coarse, shown, beside)
    counts: list[int] = []
    parts = _lookups(frame, scene, views, finer, follower, [centres], counts, sharp)
    # The largest arrays are held no longer than they are needed.
    del beside, coarse, ends, glints, shown, centres
    found = joined(Lookups, parts)
    if is_blurred:
        part = replace(direct.lens, radius=PART_OF_LENS * direct.lens.radius)
        views[sharp] = replace(direct, lens=part)
    stay, factor = len(finer.kept), finer.factor
    found.weight[:stay] *= factor
    found.colour[:stay] *= factor[:, None]
    found.most[:stay] *= factor
    off_edges(scene, views, found.view, found.place, frame.things.surfaces(found.triangle))
    dark = finer.dark
    some = np.flatnonzero(dark)
    dark_pixel = _window_pixels(finer.pixel[some], view)
    return Rays(found, sum(counts), lit_pixel, lit, dark_pixel, dark[some]), views


def _blurred(
    frame: FrameInput, direct: RadianceView, bodies: Sequence[Glass]
) -> tuple[np.ndarray, list[tuple[int, int, int, int]]]:
    """By how many pixels (width · height,) the lens blurs the glasses in each, and the rectangles
    (x0, y0, x1, y1) of pixels in which these are seen."""
    width, height = frame.view.size
    blur, rects = np.zeros((height, width)), []
    for body in bodies:
        corners, radius = _corners(body), 0.0
        if direct.lens is not None:
            depths = np.maximum(-direct.local(corners)[:, 2], direct.near)
            radius = direct.focal_px * float(direct.lens.blur(depths).max())
        margin = MARGIN_PX + math.ceil(min(radius, width + height))
        x0, y0, x1, y1 = rect = _cut(frame.view.covered(corners, margin), frame.region)
        rects.append(rect)
        if x0 < x1 and y0 < y1:
            part = blur[y0:y1, x0:x1]
            np.maximum(part, radius, out=part)
    return blur.ravel(), rects


def _shining(frame: FrameInput) -> np.ndarray:
    """(L + 1,) how much brighter than white surfaces shine, 1 at least; of the sky 1 is known."""
    light = [frame.exposure * max(look.radiance) for look in frame.things.looks]
    return np.maximum([*light, 0.0], 1.0)


def _lookups(
    frame: FrameInput,
    scene: Scene,
    views: Views,
    finer: FinerRays,
    follower: Follower,
    centres: list,
    counts: list,
    sharp: int,
) -> Iterator[Lookups]:
    """What shows the ways of the centres that stay, and of the finer rays.

    Parameters
    ----------
    centres : one ray a pixel, what shows its ways, and their neighbours; it is emptied.
    counts : gets how many rays have ways, of each part.
    sharp : number of the view that shows to rays from all over the lens what the direct picture
        shows, through a part of the lens.
    """
    coarse, shown, beside = centres.pop()
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
    for parts, is_of_lens in ((finer.parts(), False), (finer.lens_parts(), True)):
        for rays in parts:
            ways, pixel = rays.ways, _window_pixels(rays.pixel[rays.ways.ray], frame.view)
            counts.append(np.count_nonzero(np.bincount(ways.ray)))
            shown, share = show(scene, views, ways), rays.share[ways.ray]
            rows = polished(scene, ways, shown)
            for lookups_of in _amended(frame, scene, views, follower, ways, shown, rows):
                yield lookups_of(pixel[rows], share[rows])
            if is_of_lens:
                shown.view[shown.view == 0] = sharp
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


def _bands(glasses: Sequence[Glass]) -> list[Band]:
    """The glasses as the tracer takes them, in light of each band; one band without dispersion."""
    names = list(optics.LINES) if any(glass.disperses for glass in glasses) else [""]
    found = []
    for band in names:
        seen = [glass.in_light(band) if glass.disperses and band else glass for glass in glasses]
        found.append((BAND_COLOURS[band], placed_glasses(as_bodies(seen))))
    return found


def placed_glasses(bodies: Sequence[Glass]) -> list[optics.Placed]:
    """Glasses with all the faces that bound them, as the tracer takes them."""
    ranks = _ranks(bodies)
    return [_placed(body, rank) for body, rank in zip(bodies, ranks, strict=True)]


def _ranks(bodies: Sequence[Glass]) -> list[int]:
    """Priorities of glasses as the tracer takes them.

    Of equal priorities a glass within another's box holds: a ball in a tank of water is seen.
    """
    boxes = [(c.min(axis=0), c.max(axis=0)) for c in map(_corners, bodies)]
    depths = [
        sum(bool((low > a).all() and (high < b).all()) for a, b in boxes) for low, high in boxes
    ]
    return [body.priority * len(bodies) + depth for body, depth in zip(bodies, depths, strict=True)]


def _placed(body: Glass, priority: int) -> optics.Placed:
    mesh = body.description
    if isinstance(mesh, MeshGlass):
        return optics.PlacedMesh(
            mesh.ior,
            body.absorption[1],
            priority,
            mesh.roughness,
            mesh.box,
            (mesh.refracted, mesh.reflected),
        )
    media = len(body.description.media)
    absorption = np.zeros((media, 3))
    known = np.array(body.absorption[:media]).reshape(-1, 3)
    absorption[: len(known)] = known
    return optics.PlacedGlass(body.description, body.to_world, absorption, priority)


def _through(frame: FrameInput) -> np.ndarray | None:
    """(T,) which triangles are seen through the glasses, None: all; lamps always are."""
    things, named = frame.things, frame.seen_through
    seen = [
        look.is_lamp or (not look.is_passed and (named is None or owner in named))
        for look, owner in zip(things.looks, things.owners, strict=True)
    ]
    return None if all(seen) else np.array(seen, bool)[things.surface]


def _boxes(things: Things) -> np.ndarray:
    """(B, 2, 3): a box round the triangles of each owner."""
    owners = {name: number for number, name in enumerate(dict.fromkeys(things.owners))}
    if not len(things.triangles):
        return np.zeros((0, 2, 3))
    owner = np.array([owners[name] for name in things.owners])[things.surface]
    boxes = np.empty((len(owners), 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    corners = things.points[things.triangles]
    np.minimum.at(boxes[:, 0], owner, corners.min(axis=1))
    np.maximum.at(boxes[:, 1], owner, corners.max(axis=1))
    return boxes[np.isfinite(boxes).all(axis=(1, 2))]


def _summed(
    frame: FrameInput,
    scene: Scene,
    views: Views,
    rays: Rays,
) -> FrameResult:
    """The samples of all ways, packed for the compositor."""
    lookups = rays.lookups
    pixel, weight, view_number = lookups.pixel, lookups.weight, lookups.view
    light = weight.sum() + rays.dark.sum()
    unseen = weight[view_number == UNSEEN].sum() + rays.dark.sum()
    unseen = float(unseen / light) if light > 0.0 else 0.0
    known = np.flatnonzero(view_number == KNOWN)
    lacking, guessed = stand_ins(scene, lookups)
    # A quarter of all that is held, and no longer needed.
    lookups.at = lookups.at[:0].copy()
    known, radiance = np.concatenate((known, lacking)), np.concatenate((lookups.light, guessed))
    order = np.argsort(known, kind="stable")
    known, radiance = known[order], radiance[order]
    colour = radiance * lookups.colour[known] * lookups.share[known, None]
    opaque = (view_number[known] == KNOWN) & ~lookups.clear[known]
    opaque = (opaque * weight[known])[:, None] * np.ones(3)
    width, height = _window_size(frame.view)
    covering = np.bincount(pixel, weight, width * height)
    brought = np.bincount(np.concatenate((pixel, rays.lit_pixel)))
    packed = PackedPixels(np.flatnonzero(brought))
    covering += np.bincount(rays.dark_pixel, rays.dark, width * height)
    beside = np.clip(1.0 - covering, 0.0, 1.0)
    samples, parts, weights, reports, curtains = [], [], [], [], []
    skies = [n for n, view in enumerate(views) if view is not None and view.sky_only]
    for number, view in enumerate(views):
        some = np.flatnonzero(view_number == number)
        order = some[np.argsort(pixel[some], kind="stable")]
        order = order[strongest(pixel[order], weight[order])]
        uv = view.uv(lookups.place[order]) if len(order) else np.zeros((0, 2))
        tinted = lookups.colour[order] * lookups.share[order, None]
        most = frame.exposure * lookups.most[order]
        part = pack(packed, pixel[order], uv, tinted, most)
        parts.append(part)
        weights.append(weight[order].astype(np.float32))
        count, hidden = 1, NO_CURTAIN
        if view is not None and number:
            used = looked_up(view, lookups.place[some])
            hidden = curtain(view, used)
            worth = _worth(pixel[order], weight[order], covering.sum())
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
        cameras=tuple(views[1:]),
        samples=tuple(samples[1:]),
        far=tuple(_far(frame.things, view) for view in views[1:]),
        curtains=tuple(curtains[1:]),
        views=parts,
        weights=weights,
        spread=packed.spread(beside.reshape(height, width)),
        known=packed.known(
            frame.exposure * np.concatenate((colour, rays.lit)),
            np.concatenate((pixel[known], rays.lit_pixel)),
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
