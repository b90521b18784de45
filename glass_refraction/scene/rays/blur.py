# SPDX-License-Identifier: GPL-3.0-or-later
"""What blurs a picture's glasses: a lens, and motion while the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..read.glasses import Glass, as_bodies
from .caster import Casters
from .exits import MARGIN_PX, FinerRays, PictureRays, TimePiece
from .follow import Kept
from .hits import Ways
from .shutter import Moment, Shutter, put_back, spots
from .stage import FrameInput, Stage, aim, corners_of, staged
from .views import RadianceView, direct_view

Rect = tuple[int, int, int, int]
"""Pixels (x0, y0, x1, y1), half open."""
SHOTS = 64
"""Moments among which rays choose where the camera alone moves."""
PARTS, MOST_TURNS, STEP_PX = 12, 3, 2.0
"""Where glasses or things move: parts of the time that the shutter is open, at how many moments of
each at most all is looked at, and how far all moves between two, pixels, with fewer."""
FAINT = 0.02
"""Part of a pixel's light: what brings less may move there, and the pixel is as it is."""


def blurred_glasses(
    frame: FrameInput, bodies: Sequence[Glass]
) -> tuple[np.ndarray, np.ndarray, list[Rect]]:
    """By how many pixels (height, width) the lens, and lens and motion together, blur the glasses
    in each, and the rectangles in which these are seen."""
    width, height = frame.view.size
    (soft, blur), rects = np.zeros((2, height, width)), []
    direct = direct_view(frame.view, frame.region, frame.near, frame.far)
    moments = () if frame.shutter is None else frame.shutter.moments
    poses = [(moment.view, as_bodies(moment.glasses)) for moment in moments]
    for number, body in enumerate(bodies):
        corners, radius = corners_of(body), 0.0
        if direct.lens is not None:
            depths = np.maximum(-direct.local(corners)[:, 2], direct.near)
            radius = direct.focal_px * float(direct.lens.blur(depths).max())
        margin = MARGIN_PX + math.ceil(min(radius, width + height))
        seen = [(frame.view, corners)]
        seen += [(view, corners_of(moved[number])) for view, moved in poses]
        found = np.array([view.covered(at, margin) for view, at in seen])
        found = found[(found[:, 0] < found[:, 2]) & (found[:, 1] < found[:, 3])]
        if not len(found):
            continue
        rect = _cut((*found[:, :2].min(axis=0), *found[:, 2:].max(axis=0)), frame.region)
        rects.append(rect)
        _spread(soft, rect, radius)
        _spread(blur, rect, math.hypot(radius, _half_way(seen)))
    return soft, blur, rects


def _half_way(seen: list) -> float:
    """Half of how far any corner goes in the picture, pixels; of what is behind the eye, 0.

    ``seen``: views and corners (8, 3) of a box, moment by moment.
    """
    clips = np.array([view.clip(corners) for view, corners in seen])
    if (clips[..., 2] <= 0.0).any():
        return 0.0
    places = clips[..., :2] / clips[..., 2:3] * np.array(seen[0][0].size, float)
    return 0.5 * float(np.linalg.norm(np.ptp(places, axis=0), axis=1).max())


def _spread(blur: np.ndarray, rect: Rect, radius: float) -> None:
    """Have all pixels in a rectangle blurred by a radius, if they are not by more."""
    x0, y0, x1, y1 = rect
    if x0 < x1 and y0 < y1:
        part = blur[y0:y1, x0:x1]
        np.maximum(part, radius, out=part)


def blurred_things(
    frame: FrameInput, blur: np.ndarray, rects: list[Rect], ways: Ways, pixel: np.ndarray
) -> None:
    """Blur all of a glass in which anything is seen that goes on in the picture, by as much.

    How far it goes is told as though no glass were there.

    ``pixel``: (K,) of the ways of one ray a pixel.
    """
    if frame.shutter is None or frame.shutter.is_still:
        return
    some = np.flatnonzero(~ways.is_sky & (ways.weight > FAINT))
    off = _way_gone(frame.shutter, ways.take(some))
    y, x = np.divmod(pixel[some], frame.view.size[0])
    for rect in rects:
        x0, y0, x1, y1 = rect
        inside = (x >= x0) & (x < x1) & (y >= y0) & (y < y1)
        _spread(blur, rect, float(off[inside].max(initial=0.0)))


def _way_gone(shutter: Shutter, ways: Ways) -> np.ndarray:
    """(K,) pixels that what ways meet is away at most from its place in the frame; of what is
    behind the eye, 0."""
    own, found, gone = shutter.own, [], np.zeros(len(ways))
    for moment in (own, *shutter.moments):
        clip = moment.view.clip(spots(ways, own.things, moment.things))
        ahead = np.where(clip[:, 2] > 0.0, clip[:, 2], np.nan)
        found.append(clip[:, :2] / ahead[:, None] * np.array(moment.view.size, float))
        np.fmax(gone, np.linalg.norm(found[-1] - found[0], axis=1), out=gone)
    return gone


def keep_near(blur: np.ndarray, met: np.ndarray) -> None:
    """Blur no pixel so far from all that meet a glass at their centres (height, width) that no ray
    of its may meet one."""
    reach = math.ceil(2.0 * blur.max()) + 1
    # Sums of all that is below and to the left.
    sums = np.pad(np.cumsum(np.cumsum(met, axis=0), axis=1), ((1, 0), (1, 0)))
    low, high = (
        [np.clip(np.arange(n) + step, 0, n) for n in met.shape] for step in (-reach, reach + 1)
    )
    for axis in range(2):
        sums = sums.take(high[axis], axis=axis) - sums.take(low[axis], axis=axis)
    blur[sums == 0] = 0.0


def blurred_parts(
    frame: FrameInput, stage: Stage, casters: Casters, finer: FinerRays, radius: float
) -> Iterator[PictureRays]:
    """The rays of the blurred pixels, what they meet put where it is in the frame.

    Parameters
    ----------
    stage : of the frame itself; it stands again afterwards.
    radius : pixels, of the largest blur.
    """
    shutter, follower = frame.shutter, stage.follower
    if shutter is None or shutter.is_still:
        yield from finer.blurred_parts(follower, TimePiece())
    elif shutter.moves_camera_alone:
        parts = (shutter.at((number + 0.5) / SHOTS) for number in range(SHOTS))
        shots = tuple(_shot(frame, moment) for moment in parts)
        moving = replace(follower, kept=Kept(), shots=shots)
        yield from finer.blurred_parts(moving, TimePiece())
    else:
        yield from _moving_parts(frame, stage, casters, finer, shutter, radius)


def _shot(frame: FrameInput, moment: Moment) -> RadianceView:
    view = replace(moment.view, lens=frame.view.lens)
    return direct_view(view, frame.region, frame.near, frame.far)


def _moving_parts(
    frame: FrameInput,
    stage: Stage,
    casters: Casters,
    finer: FinerRays,
    shutter: Shutter,
    radius: float,
) -> list[PictureRays]:
    """See `blurred_parts`: moment by moment, for each has other targets of rays."""
    found: list[PictureRays] = []
    turns = min(max(1, math.ceil(2.0 * radius / (STEP_PX * PARTS))), MOST_TURNS)
    for number in range(PARTS * turns):
        piece = TimePiece(number, PARTS, turns)
        moment = shutter.at(piece.middle)
        now = replace(
            frame,
            view=replace(moment.view, lens=frame.view.lens),
            glasses=moment.glasses,
            things=moment.things,
        )
        follower = staged(now, casters, Kept(), stage).follower
        for rays in finer.blurred_parts(follower, piece):
            ways = put_back(rays.ways, moment.things, frame.things)
            found.append(replace(rays, ways=ways))
    aim(casters, frame.things, stage.bodies, stage.centre, stage.scale)
    return found


def _cut(rect: Rect, region: Rect) -> Rect:
    return (
        max(rect[0], region[0]),
        max(rect[1], region[1]),
        min(rect[2], region[2]),
        min(rect[3], region[3]),
    )
