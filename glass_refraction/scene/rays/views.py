# SPDX-License-Identifier: GPL-3.0-or-later
"""Radiance views: cameras of the user's engine in whose pictures hits are looked up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...optics.vectors import dot, rotated
from ..read.viewpoint import Lens, Viewpoint

WIDEST = np.radians(70.0)
"""Half angle that a capture opens to: beyond, pixels at its border are eight times as dense."""
NARROWEST = np.radians(2.0)
"""Half angle that a capture opens to at least: float32 cameras stay exact."""
MARGIN = 1.04
"""What a capture shows more than it must, for its pixel filter and the spline of a lookup."""


LEAST_AHEAD = 1e-12
"""Metres before the eye from where on a place is projected."""
BINS = 256
"""In which values are sorted before they are put in order."""


def squares(vectors: np.ndarray) -> np.ndarray:
    """Squared lengths (N,) of vectors (N, 3)."""
    return np.einsum("nk,nk->n", vectors, vectors)


@dataclass(frozen=True, eq=False)
class RadianceView:
    """A pinhole or parallel camera, the pixels that it draws, and the picture they lie in.

    Attributes
    ----------
    eye : (3,) world.
    to_camera : (4, 4) rigid: world to camera space, looking along −z.
    projection : (4, 4): camera space to normalised device coordinates.
    size : (width, height) of the whole frame, pixels.
    region : (x0, y0, x1, y1) pixels of the frame that are drawn.
    picture : (x0, y0, x1, y1) pixels of the frame that the picture holds.
    near, far : metres before the eye, along the view direction, between which it sees things.
    is_parallel : orthographic.
    sky_only : it shows the world alone.
    is_paned : it looks through a pane, behind which rays are no camera's any more.
    lens : it shows one plane sharply; None: all.
    """

    eye: np.ndarray
    to_camera: np.ndarray
    projection: np.ndarray
    size: tuple[int, int]
    region: tuple[int, int, int, int]
    picture: tuple[int, int, int, int]
    near: float
    is_parallel: bool = False
    sky_only: bool = False
    far: float = np.inf
    is_paned: bool = False
    lens: Lens | None = None

    @property
    def stamp(self) -> tuple:
        """The same for views that show the same of the same things."""
        arrays = (self.eye, self.to_camera, self.projection)
        kind = self.size, self.region, self.near, self.far, self.is_paned, self.lens
        return *(array.tobytes() for array in arrays), *kind

    @property
    def forward(self) -> np.ndarray:
        """World direction (3,) into the scene."""
        return -self.to_camera[2, :3]

    @property
    def focal_px(self) -> float:
        """Pixels per unit of slope; in a parallel view pixels per metre."""
        width, height = self.size
        return 0.5 * min(abs(self.projection[0, 0]) * width, abs(self.projection[1, 1]) * height)

    def turned(self, directions: np.ndarray) -> np.ndarray:
        """World directions (N, 3) in camera space."""
        return rotated(self.to_camera[:3, :3], directions.T).T

    def local(self, points: np.ndarray) -> np.ndarray:
        """World points (N, 3) in camera space."""
        return self.turned(points) + self.to_camera[:3, 3]

    def pixels(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frame pixels (N, 2) of world points, and which (N,) lie in what is drawn."""
        return self.project(self.local(points), self.near)

    def pixels_of_sky(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of points infinitely far away in world directions (N, 3)."""
        if self.is_parallel:
            return np.zeros((len(directions), 2)), np.zeros(len(directions), bool)
        return self.project(self.turned(directions), 0.0)

    def project(self, local: np.ndarray, near: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of places (N, 3) in camera space, from ``near`` metres on."""
        p = self.projection
        ahead = -local[:, 2]
        found, inside = np.empty((len(local), 2)), ahead > near
        w = 1.0 if self.is_parallel else np.where(ahead > LEAST_AHEAD, ahead, 1.0)
        for axis in range(2):
            shift = p[axis, 3] if self.is_parallel else p[axis, 2] * local[:, 2]
            ndc = (local[:, axis] * p[axis, axis] + shift) / w
            place = (0.5 * ndc + 0.5) * self.size[axis]
            # The outermost half pixel has nothing to be interpolated with.
            inside &= (place >= self.region[axis] + 0.5) & (place <= self.region[axis + 2] - 0.5)
            found[:, axis] = place
        return found, inside

    def uv(self, pixels: np.ndarray) -> np.ndarray:
        """Places (N, 2) in the picture, 0 to 1 from its lower left corner."""
        found = np.empty((len(pixels), 2))
        for axis, (low, high) in enumerate(zip(self.picture[:2], self.picture[2:], strict=True)):
            found[:, axis] = (pixels[:, axis] - low) / (high - low)
        return found

    def opened(self, factor: float) -> RadianceView:
        """The same view, what it draws by a factor wider and higher, round its middle."""
        p = self.projection.copy()
        for axis in range(2):
            low, high = self.region[axis], self.region[axis + 2]
            middle = (low + high) / self.size[axis] - 1.0
            p[axis, axis] /= factor
            p[axis, 2] = (p[axis, 2] + middle) / factor - middle
        return replace(self, projection=p)

    def sight(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays from where the view begins to see: origins, unit directions (N, 3), lengths (N,)."""
        if self.is_parallel:
            ahead = dot((points - self.eye).T, self.forward) - self.near
            origins = points - ahead[:, None] * self.forward
            return origins, np.broadcast_to(self.forward, points.shape), ahead
        towards = points - self.eye
        length = np.sqrt(squares(towards))
        directions = towards / np.maximum(length, 1e-300)[:, None]
        skipped = self.near / np.maximum(dot(directions.T, self.forward), 1e-6)
        return self.eye + directions * skipped[:, None], directions, length - skipped

    def lengths(self, points: np.ndarray) -> np.ndarray:
        """Metres (N,) to points (N, 3) from where the view begins to see, along its rays."""
        towards = points - self.eye
        ahead = dot(towards.T, self.forward)
        if self.is_parallel:
            return ahead - self.near
        return np.sqrt(squares(towards)) * (1.0 - self.near / np.maximum(ahead, LEAST_AHEAD))

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rays through places (N, 2) of the frame, from where the view begins to see: origins and
        unit directions (N, 3)."""
        p = self.projection
        local = np.empty((len(pixels), 3))
        local[:, 2] = -max(self.near, 1.0)
        for axis in range(2):
            ndc = 2.0 * pixels[:, axis] / self.size[axis] - 1.0
            if self.is_parallel:
                local[:, axis] = (ndc - p[axis, 3]) / p[axis, axis]
            else:
                local[:, axis] = (ndc + p[axis, 2]) / p[axis, axis] * -local[:, 2]
        points = rotated(self.to_camera[:3, :3].T, (local - self.to_camera[:3, 3]).T).T
        return self.sight(points)[:2]

    def lens_rays(self, pixels: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same as `rays`, through places (N, 2) in the opening as the lens takes them, if there
        is one. All rays of one place of the frame meet in the plane that is seen sharply.
        """
        if self.lens is None:
            return self.rays(pixels)
        _, directions = self.rays(pixels)
        ahead = dot(directions.T, self.forward)
        sharp = directions * (self.lens.focus / ahead)[:, None]
        across, up = self.to_camera[:2, :3]
        x, y = self.lens.places(unit).T[..., None]
        through = x * across + y * up
        directions = sharp - through
        origins = self.eye + through + directions * (self.near / self.lens.focus)
        return origins, directions / np.sqrt(squares(directions))[:, None]

    def sky_sight(self, directions: np.ndarray) -> np.ndarray:
        """Origins (N, 3) of the rays by which the view sees into these directions."""
        skipped = self.near / np.maximum(dot(directions.T, self.forward), 1e-6)
        return self.eye + directions * skipped[:, None]


def direct_view(
    view: Viewpoint, region: tuple[int, int, int, int], near: float, far: float
) -> RadianceView:
    """The user's own camera."""
    return RadianceView(
        view.eye,
        view.to_camera,
        view.projection,
        view.size,
        region,
        view.window,
        near,
        view.is_parallel,
        far=far,
        lens=view.lens,
    )


def aimed_view(
    eye: np.ndarray,
    directions: np.ndarray,
    weights: np.ndarray,
    near: float,
    frame: RadianceView,
    aspect: float,
    most: float = 0.98,
) -> RadianceView:
    """A view from an eye, turned and opened to show directions.

    Parameters
    ----------
    eye : (3,) world.
    directions : (N, 3) unit, world, N ≥ 1. weights : (N,) what each is worth.
    near : metres from where it sees.
    frame : the direct view, for the frame's size, region and picture.
    aspect : height of a pixel over its width.
    most : share of the worth that decides how wide it opens.
    """
    directions = np.ascontiguousarray(directions.T)
    axis = (weights * directions).sum(axis=1)
    length = np.linalg.norm(axis)
    axis = axis / length if length > 1e-9 else directions[:, np.argmax(weights)]
    up = np.array((0.0, 0.0, 1.0)) if abs(axis[2]) < 0.95 else np.array((0.0, 1.0, 0.0))
    right = _cross(axis, up)
    right /= np.linalg.norm(right)
    rotation = np.stack((right, _cross(right, axis), -axis))
    local = rotated(rotation, directions)
    ahead = np.flatnonzero(local[2] < -np.cos(WIDEST))
    slopes = local[:2].take(ahead, axis=1) / -local[2].take(ahead)
    bounds = np.array([[-1.0, -1.0], [1.0, 1.0]]) * np.tan(NARROWEST)
    if len(ahead):
        for axis_number in range(2):
            tail = 0.5 * (1.0 - most)
            low, high = quantiles(slopes[axis_number], weights.take(ahead), tail, 1.0 - tail)
            limit = np.tan(WIDEST)
            low, high = max(low, -limit), min(high, limit)
            middle, half = 0.5 * (low + high), 0.5 * (high - low) * MARGIN
            half = max(half, np.tan(NARROWEST))
            bounds[:, axis_number] = middle - half, middle + half
    x0, y0, x1, y1 = frame.region
    wide, high = bounds[1] - bounds[0]
    # A pixel is `aspect` times as high as wide: as many slopes.
    per_slope = min((x1 - x0) / wide, (y1 - y0) * aspect / high)
    centre = 0.5 * (bounds[0] + bounds[1])
    origin_x = 0.5 * (x0 + x1) - per_slope * centre[0]
    origin_y = 0.5 * (y0 + y1) - per_slope / aspect * centre[1]
    width, height = frame.size
    projection = np.zeros((4, 4))
    projection[0, 0] = 2.0 * per_slope / width
    projection[1, 1] = 2.0 * per_slope / aspect / height
    projection[0, 2] = 1.0 - 2.0 * origin_x / width
    projection[1, 2] = 1.0 - 2.0 * origin_y / height
    projection[3, 2] = -1.0
    to_camera = np.eye(4)
    to_camera[:3, :3] = rotation
    to_camera[:3, 3] = -rotation @ eye
    return RadianceView(
        np.array(eye, float), to_camera, projection, frame.size, frame.region, frame.picture, near
    )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector product (3,) of two vectors: `numpy.cross` takes ten times as long for so few."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def quantiles(values: np.ndarray, weights: np.ndarray, *parts: float) -> list[float]:
    """The values below which parts of the weight lie."""
    low, found = values.min(), []
    bins = ((values - low) * (BINS / max(values.max() - low, 1e-300))).astype(np.intp)
    light = np.bincount(bins, weights)
    summed = np.cumsum(light)
    for part in parts:
        # Only what lies about there is put in order.
        wanted = part * summed[-1]
        number = np.searchsorted(summed, wanted)
        here = np.flatnonzero(bins == number)
        here = here[np.argsort(values[here])]
        past = summed[number] - light[number] + np.cumsum(weights[here])
        found.append(float(values[here[min(np.searchsorted(past, wanted), len(here) - 1)]]))
    return found


def virtual_eye(origins: np.ndarray, directions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The point (3,) nearest to rays (N, 3) in weighted least squares: where they seem to meet.

    It solves Σ w (1 − d dᵀ) c = Σ w (1 − d dᵀ) o; of parallel rays it is their mean origin.
    """
    outer = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    left = np.einsum("n,nij->ij", weights, outer)
    mean = (weights[:, None] * origins).sum(axis=0) / weights.sum()
    right = np.einsum("n,nij,nj->i", weights, outer, origins - mean)
    offset, *_ = np.linalg.lstsq(left, right, rcond=1e-4)
    return mean + offset
