# SPDX-License-Identifier: GPL-3.0-or-later
"""All that a frame's picture depends on, ready for rays to meet it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ... import optics
from ..light.light import LightSettings
from ..read.glasses import Glass, as_bodies
from ..read.mesh_glasses import MeshGlass
from ..read.viewpoint import Viewpoint
from .caster import Casters
from .follow import CONTACT, Band, Follower, Kept
from .hits import CAPTURE_WORTH, Scene
from .meshes import GlassMeshes
from .radiance import Clamp
from .shutter import Shutter
from .sky import Sky
from .things import Things
from .views import RadianceView, direct_view

BAND_COLOURS = {"": (1.0, 1.0, 1.0), "red": (1.0, 0, 0), "green": (0, 1.0, 0), "blue": (0, 0, 1.0)}
"""What light of each band brings to a pixel's colours."""


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
    shutter : motion is blurred; None: it is not.
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
    shutter: Shutter | None = None


@dataclass(frozen=True, eq=False)
class Stage:
    """A frame's things and glasses, which rays can meet now.

    Attributes
    ----------
    scene : the things. bodies : the glasses. direct : the user's camera.
    follower : of rays through the glasses.
    centre, scale : (3,) and metres, of the box round all glasses: in these casters count.
    """

    scene: Scene
    bodies: Sequence[Glass]
    direct: RadianceView
    follower: Follower
    centre: np.ndarray
    scale: float


def staged(frame: FrameInput, casters: Casters, kept: Kept, like: Stage | None = None) -> Stage:
    """Have rays meet a frame's things and glasses.

    ``like``: another stage of the frame, by whose centre and size casters count on.
    """
    bodies = as_bodies(frame.glasses)
    placed = _place_and_size(bodies, frame.view) if like is None else (like.centre, like.scale)
    meshes = aim(casters, frame.things, bodies, *placed)
    scene = Scene(
        casters.things,
        frame.things,
        frame.sky,
        frame.capture_worth,
        kept.sketches,
        CONTACT * placed[1],
    )
    direct = direct_view(frame.view, frame.region, frame.near, frame.far)
    follower = Follower(
        direct,
        _bands(frame.glasses),
        scene.caster,
        scene.eyes,
        meshes,
        frame.things,
        _boxes(frame.things),
        _hull(bodies),
        (frame.min_weight, frame.fresnel, *(glass.stamp() for glass in frame.glasses)),
        frame.min_weight,
        frame.fresnel,
        kept,
        shining(frame).max(),
        _through(frame),
    )
    return Stage(scene, bodies, direct, follower, *placed)


def aim(
    casters: Casters, things: Things, bodies: Sequence[Glass], centre: np.ndarray, scale: float
) -> GlassMeshes:
    """Hand things and glasses to the casters; what is there already stays."""
    casters.things.aim(things, centre, scale)
    return GlassMeshes(casters.meshes, bodies, centre, scale)


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
    corners = np.concatenate([corners_of(body) for body in bodies])
    return np.array((corners.min(axis=0), corners.max(axis=0)))


def corners_of(body: Glass) -> np.ndarray:
    """The corners (8, 3), in the world, of a box round a glass."""
    box = body.description.box
    return body.points_to_world(np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3))


def shining(frame: FrameInput) -> np.ndarray:
    """(L + 1,) how much brighter than white surfaces shine, 1 at least; of the sky 1 is known."""
    light = [frame.exposure * max(look.radiance) for look in frame.things.looks]
    return np.maximum([*light, 0.0], 1.0)


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
    corners = np.array([corners_of(body) for body in bodies]).reshape(-1, 8, 3)
    lows, highs = corners.min(axis=1), corners.max(axis=1)
    depths = [
        int(((low > lows) & (high < highs)).all(axis=1).sum())
        for low, high in zip(lows, highs, strict=True)
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
            mesh.paint is not None,
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
