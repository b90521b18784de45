# SPDX-License-Identifier: GPL-3.0-or-later
"""What each pixel sees: the weight of every light path, anti-aliased where a region ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ... import optics
from ..progress import check
from ..read.glasses import Glass, read_glasses
from ..read.viewpoint import Viewpoint, read_viewpoint
from .hull import first_face
from .path_keys import path_key

FILTER_WIDTH = 1.5
"""Width of the pixel filter (Blackman-Harris), as Cycles counts it and has it by default."""
SUPPORT = 2.0 * FILTER_WIDTH
"""Pixels across which that filter is not zero: twice its width (Cycles, scene/film.cpp)."""
ENOUGH = 0.7
"""Part of the light that kept paths must bring for them to stand for all of it."""
BLOCK = 65536
"""Rays whose weights are found at once."""
SUBSAMPLES = 24
"""Rays a side across the filter's support, in pixels where a region ends."""

PATH_SEARCH_SIDE = 96
"""Rays across a glass, its shorter way, with which the paths' mean weights are found: a verge of a
hundredth of it is met by one of them, however few pixels the glass has in the picture."""
PATH_SEARCH_RAYS = 16 * PATH_SEARCH_SIDE**2
"""Of these in all, about: a glass in the picture may be 16 times as long as wide."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Weights of a glass's light paths over a part of the picture.

    A ray that enters the glass but would meet a later face beyond its extent (it leaves through
    the open top, or a table stops it before) is given to the path that it would take in the
    unbounded glass: the nearest kept path stands in, and no hole is left.

    Attributes
    ----------
    rect : (x0, y0, x1, y1) pixels, half open, from the picture's lower left corner.
    paths : the paths, in the order of ``weights``.
    weights : (P, h, w) float32: of the light that reaches the eye through the glass, the part
        along each path; also given a few pixels beyond the outline.
    hit : (h, w) bool: the ray through the pixel's centre meets the glass.
    shares : (P, h, w) float32: as ``weights``, but with the light of paths that were left out
        shared out among these in proportion, ray by ray: they sum to one. Without Fresnel's
        equations the same as ``weights``.
    """

    rect: tuple[int, int, int, int]
    paths: tuple[optics.LightPath, ...]
    weights: np.ndarray
    hit: np.ndarray
    shares: np.ndarray

    def importance(self, path: optics.LightPath) -> float:
        """The weight that the path's light has on average where it has one: sum w^2 / sum w."""
        return self._importances[self.paths.index(path)]

    @cached_property
    def _importances(self) -> list[float]:
        found = []
        for weights in self.weights.astype(float):
            total = weights.sum()
            found.append(float((weights**2).sum() / total) if total > 0 else 0.0)
        return found

    def left_out(self) -> np.ndarray:
        """(h, w) float32: the part of the light for which no kept path stands."""
        whole = np.array([not path.open for path in self.paths], bool)
        known = self.shares[whole].sum(axis=0)
        return np.where(known > 0, np.clip(1.0 - known, 0.0, 1.0), 0.0).astype(np.float32)


def in_picture(values: np.ndarray, rect: tuple, size: tuple[int, int]) -> np.ndarray:
    """Values (..., h, w) of a rectangle in a picture of ``size``, zero elsewhere."""
    x0, y0, x1, y1 = rect
    out = np.zeros((*values.shape[:-2], size[1], size[0]), values.dtype)
    out[..., y0:y1, x0:x1] = values
    return out


def blackman_harris(x: np.ndarray) -> np.ndarray:
    """The window over its support -0.5 to 0.5 (Harris 1978, four terms)."""
    angle = 2.0 * np.pi * np.asarray(x)
    return (
        0.35875
        + 0.48829 * np.cos(angle)
        + 0.14128 * np.cos(2 * angle)
        + 0.01168 * np.cos(3 * angle)
    )


def picture_rect(glass: Glass, view: Viewpoint, margin: int = 3) -> tuple[int, int, int, int]:
    """The pixels that the glass can cover: (x0, y0, x1, y1), half open; empty if x0 >= x1."""
    vertices, _ = first_face(glass, view.eye_for(glass))
    return view.covered(glass.points_to_world(vertices), margin)


def path_regions(
    glass: Glass,
    view: Viewpoint,
    paths: tuple[optics.LightPath, ...],
    *,
    fresnel: bool = True,
) -> Regions:
    """The weights of ``paths`` for every pixel that the glass can cover.

    Parameters
    ----------
    fresnel : weigh by Fresnel's equations, as a glass surface; else as a surface that only
        refracts: 1 where the ray takes the path, and nothing along paths with a reflection.
    """
    rays = PathRays(glass, view, paths, fresnel)
    weights, hit, taken = rays.at_centres()
    # The paths' weights first, then their shares.
    weights = np.concatenate((weights, rays.shared(weights)))
    # The filter reaches beyond the next pixel.
    border = border_pixels(np.concatenate((taken, hit[None])))
    rows, columns = np.nonzero(border_pixels(border[None]) | border)
    x0, y0, *_ = rays.rect
    weights[:, rows, columns], cover = rays.filtered(x0 + 0.5 + columns, y0 + 0.5 + rows)
    known = hit.copy()
    known[rows, columns] = cover > 0
    _spread(weights, known)
    weights, shares = weights.astype(np.float32).reshape(2, len(paths), *hit.shape)
    return Regions(rays.rect, paths, weights, hit, shares)


def centre_weights(
    glass: Glass, view: Viewpoint, paths, *, fresnel: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Weights (P, h, w) float32 along the rays of pixels' centres, and (h, w) which meet the glass.

    Of the pixels of `picture_rect`; ``fresnel`` as of `path_regions`.
    """
    weights, hit, _ = PathRays(glass, view, paths, fresnel).at_centres()
    return weights.astype(np.float32), hit


def mean_weights(glass: Glass, view: Viewpoint, paths, *, fresnel: bool) -> np.ndarray:
    """(P,) mean weights of paths over rays spread over the glass's pixels."""
    x0, y0, x1, y1 = picture_rect(glass, view, margin=0)
    width, height = max(1, x1 - x0), max(1, y1 - y0)
    finer = PATH_SEARCH_SIDE / min(width, height)
    # Of a glass that only a column of the picture shows, that would be millions of rays.
    finer = min(finer, math.sqrt(PATH_SEARCH_RAYS / (width * height)))
    size = tuple(max(1, round(n * finer)) for n in view.size)
    coarse = replace(view, size=size, window=(0, 0, *size))
    weights, hit = centre_weights(glass, coarse, paths, fresnel=fresnel)
    return weights[:, hit].mean(axis=1) if hit.any() else np.zeros(len(paths))


class PathRays:
    """optics.LightPath weights of a glass along rays through pixel coordinates."""

    def __init__(self, glass: Glass, view: Viewpoint, paths, fresnel: bool) -> None:
        self.glass, self.view, self.paths, self.fresnel = glass, view, paths, fresnel
        self.rect = picture_rect(glass, view)
        """Of the pixels that the glass can cover: (h, w) of them."""
        self.named = any(path.interfaces is not None for path in paths)
        """Whether rays may be met that hardly take any of the paths: there are dozens."""
        self.whole = np.array([not path.open for path in paths], bool)
        self.refracting = np.array(["R" not in p.events for p in paths], bool)

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y (h, w) of the pixels' centres."""
        x0, y0, x1, y1 = self.rect
        return np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5)

    def at_centres(self):
        """Of the rays through these what `weights` tells: (P, h, w), (h, w) and (P, h, w)."""
        x, y = self.centres()
        found = self.weights(x.ravel(), y.ravel())
        return tuple(part.reshape(*part.shape[:-1], *x.shape) for part in found)

    def whole_pixels(self) -> np.ndarray:
        """(P, h, w) bool: pixels that lie wholly in the region where rays take the path."""
        x, y = self.centres()
        inside = self.bounded(x.ravel(), y.ravel()).reshape(len(self.paths), *x.shape)
        return inside & ~border_pixels(inside)

    def weights(self, x: np.ndarray, y: np.ndarray):
        """(P, M) weights, (M,) whether the glass is met, (P, M) whether the path is taken."""
        if not len(x):
            none = np.zeros((len(self.paths), 0))
            return none, np.zeros(0, bool), none > 0
        starts = range(0, len(x), BLOCK)
        parts = [self._weights(x[start:][:BLOCK], y[start:][:BLOCK]) for start in starts]
        return tuple(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))

    def _weights(self, x: np.ndarray, y: np.ndarray):
        """Of some of the rays: all of a large picture take many seconds, in which Esc is heeded."""
        check()
        eye, directions = self.view.rays_in(self.glass, x, y)
        description = self.glass.description
        missed, _ = optics.path_weights(description, eye, directions, (optics.LightPath(""),))
        hit = missed[0] < 0.5
        found, _ = optics.path_weights(description.unbounded, eye, directions, self.paths)
        taken = (found > 0) & hit
        if not self.fresnel:
            found = (taken & self.refracting[:, None]).astype(float)
        return found, hit, taken

    def shared(self, weights: np.ndarray) -> np.ndarray:
        """(P, M) weights that sum to one: what other paths bring is shared out among these.

        Of glasses with dozens of paths, rays may be met that hardly take any of these: there they
        sum to less.
        """
        if not self.fresnel:
            return weights
        total = weights[self.whole].sum(axis=0)
        if self.named:
            total = np.maximum(total, ENOUGH)
        return weights / np.where(total > 0, total, 1.0)

    def transmittance(self, path: optics.LightPath, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(M, 3) what the media let through along a path."""
        return self.glass.transmittance(*self.view.rays_in(self.glass, x, y), path)

    def bounded(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(P, M) whether the path is taken with every face met within its extent."""
        eye, directions = self.view.rays_in(self.glass, x, y)
        found, _ = optics.path_weights(self.glass.description, eye, directions, self.paths)
        return (found > 0) & ~self._leaves_sideways(eye, directions)

    def _leaves_sideways(self, eye: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(M,) rays that enter and leave a slab by its faces but pass its notches between them."""
        description = self.glass.description
        outline = getattr(description, "outline", None)
        if outline is None:
            return np.zeros(len(directions), bool)
        eye = np.broadcast_to(eye, directions.shape)
        height = np.where(directions[:, 2] < 0, 0.0, -sum(description.thickness))
        down = np.where(directions[:, 2] == 0, 1.0, directions[:, 2])
        a = eye[:, :2] + ((height - eye[:, 2]) / down)[:, None] * directions[:, :2]
        # Layers bend the way between; straight from face to face is near enough for a notch.
        leave = optics.trace(description, eye, directions, "T" * (len(description.ior) + 1))
        b = np.where(leave.valid[:, None], leave.origin[:, :2], a)
        crossed = np.zeros(len(a), bool)
        corners = np.asarray(outline, float)
        for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            sides = _turn(a, b, p) * _turn(a, b, q)
            crossed |= (sides < 0) & (_turn(p, q, a) * _turn(p, q, b) < 0)
        return crossed

    def filtered(self, x: np.ndarray, y: np.ndarray):
        """Means over the pixel filter (2 P, M), and the part of its rays that meets the glass (M,).

        The means are those of the weights, then of the shares. Rays beside the glass count as the
        nearest that meets it: so do those of a screen.
        """
        dx, dy = _filter_places()
        found, hit, _ = self.weights((x[:, None] + dx).ravel(), (y[:, None] + dy).ravel())
        hit = hit.reshape(len(x), len(dx))
        found = found.reshape(len(found), *hit.shape)
        apart = np.hypot(dx[:, None] - dx, dy[:, None] - dy)
        mixed = np.flatnonzero(hit.any(axis=1) & ~hit.all(axis=1))
        nearest = np.where(hit[mixed, None, :], apart, np.inf).argmin(axis=2)
        found[:, mixed] = np.take_along_axis(found[:, mixed], nearest[None], axis=2)
        found[:, ~hit.any(axis=1)] = 0.0
        means = found.mean(axis=2)
        shares = self.shared(found).mean(axis=2)
        return np.concatenate((means, shares)), hit.mean(axis=1)


def tints(glass: Glass, view: Viewpoint, path: optics.LightPath) -> np.ndarray:
    """(h, w, 3) what the glass's media let through along a path, for every pixel's centre.

    A few pixels beyond the path's region those of the nearest pixels in it.
    """
    rays = PathRays(glass, view, (path,), True)
    x, y = rays.centres()
    _, _, (known,) = rays.at_centres()
    found = np.ones((3, *x.shape))
    rows, columns = np.nonzero(known)
    found[:, rows, columns] = rays.transmittance(path, x[known], y[known]).T
    _spread(found, known)
    return np.moveaxis(found, 0, 2)


def _filter_places() -> np.ndarray:
    """Offsets (2, SUBSAMPLES) in pixels, spread as densely as the pixel filter is high.

    Hammersley's points: every one has an x and a y of its own, so that borders along either are
    met at many places.
    """
    fine = (np.arange(4096) + 0.5) / 4096 - 0.5
    below = np.cumsum(blackman_harris(fine))
    number = np.arange(SUBSAMPLES)
    mirrored = np.zeros(SUBSAMPLES)
    for bit in range(SUBSAMPLES.bit_length()):
        mirrored += (number >> bit & 1) * 0.5 ** (bit + 1)
    shares = np.stack((number / SUBSAMPLES, mirrored)) + 0.5 / SUBSAMPLES
    return SUPPORT * np.interp(shares * below[-1], below, fine)


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of the triangles a, b, c (..., 2)."""
    ab, ac = b - a, c - a
    return ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]


def border_pixels(labels: np.ndarray) -> np.ndarray:
    """Pixels (h, w) of which a neighbour differs in any of the boolean labels (K, h, w)."""
    border = np.zeros(labels.shape[1:], bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            a, b = _shifted(labels, dy, dx)
            differs = np.any(a != b, axis=0)
            target, _ = _shifted(border[None], dy, dx)
            target[0] |= differs
    return border


def _shifted(values: np.ndarray, dy: int, dx: int) -> tuple[np.ndarray, np.ndarray]:
    """Views (K, h', w') of the pixels with a neighbour at that offset, and of the neighbours."""
    h, w = values.shape[1:]
    here = values[:, max(0, -dy) : h - max(0, dy), max(0, -dx) : w - max(0, dx)]
    there = values[:, max(0, dy) : h + min(0, dy), max(0, dx) : w + min(0, dx)]
    return here, there


def _spread(weights: np.ndarray, known: np.ndarray, steps: int = 3) -> None:
    """Carry the weights a few pixels beyond the outline, in place.

    The rendered outline may cover a trace of a pixel of which no ray here met the glass.
    """
    height, width = known.shape
    for _ in range(steps):
        reached = np.zeros_like(known)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                here, there = _shifted(known[None], dy, dx)
                target, _ = _shifted(reached[None], dy, dx)
                target[0] |= there[0] & ~here[0]
        rows, columns = np.nonzero(reached)
        total, count = np.zeros((len(weights), len(rows))), np.zeros(len(rows))
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y, x = np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)
                counts = known[y, x]
                total += np.where(counts, weights[:, y, x], 0.0)
                count += counts
        weights[:, rows, columns] = total / count
        known |= reached


def left_out_pixels(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, kept: tuple[optics.LightPath, ...]
) -> float:
    """The part of the glasses' pixels of whose light kept paths bring less than half.

    With surfaces that only refract: whose ray takes a path, but none of these.
    """
    view = read_viewpoint(scene, depsgraph)
    fresnel = scene.refractive_glass.surface == "GLASS"
    count = left_out = 0
    for glass in _closed_forms(depsgraph):
        if glass.description.names_interfaces:
            missing = _dark_rays(glass, view, scene.refractive_glass.min_weight, fresnel)
            count, left_out = count + missing.size, left_out + int(missing.sum())
            continue
        paths = tuple(path for path in kept if path.interfaces is None)
        if not fresnel:
            listed = optics.light_paths(glass.description, view.eye_for(glass))
            through = [path for path in listed if "R" not in path.events]
            paths = tuple(dict.fromkeys((*paths, *through)))
        weights, hit = centre_weights(glass, view, paths, fresnel=fresnel)
        weights = weights[:, hit]
        brought = weights[[path in kept for path in paths]].sum(axis=0)
        missing = brought < 0.5 if fresnel else (brought == 0.0) & weights.any(axis=0)
        count, left_out = count + missing.size, left_out + int(missing.sum())
    return left_out / max(1, count)


def _dark_rays(glass: Glass, view: Viewpoint, min_weight: float, fresnel: bool) -> np.ndarray:
    """(M,) of rays through the pixels of a cup: whether most of their light was not followed."""
    x, y = PathRays(glass, view, (), fresnel).centres()
    eye, directions = view.rays_in(glass, x.ravel(), y.ravel())
    placed = optics.PlacedGlass(glass.description, np.eye(4))
    ends = optics.exit_rays([placed], eye, directions, min_weight=min_weight)
    through = np.ones(len(directions), bool)
    through[ends.ray[ends.events == 0]] = False
    # Where surfaces only refract, what is reflected is lost, not left out.
    return (ends.lost[through] > 0.5) & fresnel


def _closed_forms(depsgraph: bpy.types.Depsgraph) -> list[Glass]:
    """The glasses that have light paths: all but meshes."""
    return [g for g in read_glasses(depsgraph) if not g.is_mesh]


MOST_MASKS = 12
"""Of glasses whose paths name their interfaces, so many paths get a mask, the brightest."""


def region_masks(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> dict[str, np.ndarray]:
    """The pixels that lie wholly in each light path's region, over all glasses of the scene.

    Returns
    -------
    dict : path key -> (H, W) bool, bottom row first; ``""`` holds the pixels beside all glasses.
    """
    view = read_viewpoint(scene, depsgraph)
    width, height = view.size
    masks: dict[str, np.ndarray] = {}
    beside = np.ones((height, width), bool)
    least = scene.refractive_glass.min_weight
    for glass in _closed_forms(depsgraph):
        paths = optics.light_paths(glass.description, view.eye_for(glass), min_weight=least)
        named = bool(paths) and paths[0].interfaces is not None
        if named:
            paths = paths[:MOST_MASKS]
        found = path_regions(glass, view, paths)
        covered = found.hit if named else found.weights.sum(axis=0) > 0
        beside &= ~in_picture(covered, found.rect, view.size)
        for path, whole in zip(
            paths, PathRays(glass, view, paths, True).whole_pixels(), strict=True
        ):
            mask = masks.setdefault(path_key(path), np.zeros((height, width), bool))
            mask |= in_picture(whole, found.rect, view.size)
    masks[""] = beside
    return masks


def crossing_counts(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """How often each pixel's strongest path is refracted (H, W), int: the paper's figure 8."""
    view = read_viewpoint(scene, depsgraph)
    counts = np.zeros((view.size[1], view.size[0]), int)
    for glass in _closed_forms(depsgraph):
        paths = optics.light_paths(glass.description, view.eye_for(glass))
        weights, hit = centre_weights(glass, view, paths)
        refractions = np.array([p.events.count("T") for p in paths] or [0])
        strongest = np.argmax(weights, axis=0) if paths else np.zeros(hit.shape, int)
        here = np.where(hit, refractions[strongest], 0)
        counts = np.maximum(counts, in_picture(here, picture_rect(glass, view), view.size))
    return counts
