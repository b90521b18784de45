# SPDX-License-Identifier: GPL-3.0-or-later
"""The eye: an evaluated camera and the render size as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ... import optics
from ..names import RefractiveGlassError
from .arrays import affine
from .glasses import Glass

_SHEAR = 1e-3
"""By how much a camera's axes may differ from right angles, as a part: a pixel in a thousand."""


@dataclass(frozen=True)
class Lens:
    """A camera's opening: a thin lens that shows one plane sharply.

    Attributes
    ----------
    radius : metres. focus : metres along the view direction to that plane.
    ratio : by how much the opening is narrower than high.
    blades : corners of the opening; below 3 it is round. rotation : of these, radians.
    """

    radius: float
    focus: float
    ratio: float = 1.0
    blades: int = 0
    rotation: float = 0.0

    def blur(self, depths: np.ndarray) -> np.ndarray:
        """(N,) half widths, in slopes from the eye, of what points so deep (N,) are seen as."""
        return self.radius / min(self.ratio, 1.0) * np.abs(1.0 / depths - 1.0 / self.focus)

    def places(self, unit: np.ndarray) -> np.ndarray:
        """Places (N, 2) in the opening, metres, of places (N, 2) in a square of 1: how far from the
        middle, squared, and which part of a turn. Equal areas stay equal."""
        far, turn = unit.T
        angle, border = 2.0 * np.pi * turn, 1.0
        if self.blades > 2:
            half = np.pi / self.blades
            blade = np.floor(turn * self.blades)
            within = np.arctan((2.0 * (turn * self.blades - blade) - 1.0) * np.tan(half))
            angle = self.rotation + half * (2.0 * blade + 1.0) + within
            border = np.cos(half) / np.cos(within)
        long = self.radius * np.sqrt(far) * border
        return np.stack((long * np.cos(angle) / self.ratio, long * np.sin(angle)), axis=1)


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A perspective or parallel view.

    Attributes
    ----------
    eye : (3,) world position of the camera.
    to_camera : (4, 4) float64, rigid: world to camera space (looking along -z).
    projection : (4, 4) float64: camera space to normalised device coordinates.
    size : (width, height) of the whole frame in pixels.
    window : (x0, y0, x1, y1), half open: the pixels that the picture holds; less than the frame
        where only a border is rendered and the picture is cropped to it.
    is_parallel : orthographic camera.
    lens : of a camera with depth of field.
    """

    eye: np.ndarray
    to_camera: np.ndarray
    projection: np.ndarray
    size: tuple[int, int]
    window: tuple[int, int, int, int]
    is_parallel: bool
    lens: Lens | None = None

    def stamp(self) -> tuple:
        """What the place of things in the picture depends on: the lens only blurs them."""
        return (
            self.to_camera.tobytes(),
            self.projection.tobytes(),
            self.size,
            self.window,
            self.is_parallel,
        )

    @property
    def forward(self) -> np.ndarray:
        """World direction (3,) into the scene."""
        return -self.to_camera[2, :3]

    @property
    def focal_px(self) -> float:
        """Pixels per radian at the picture's centre; in a parallel view pixels per metre."""
        width, height = self.size
        return 0.5 * max(abs(self.projection[0, 0]) * width, abs(self.projection[1, 1]) * height)

    def eye_for(self, glass: Glass):
        """The eye as the optics take it, in the glass's frame."""
        if self.is_parallel:
            return optics.ParallelView(glass.direction_to_local(self.forward))
        return glass.to_local(self.eye)

    def clip(self, points: np.ndarray) -> np.ndarray:
        """Homogeneous picture coordinates (N, 4) of world points (N, 3): x, y, w, depth.

        ``x / w`` and ``y / w`` run from 0 to 1 over the picture from its lower left corner. x, y
        and w are linear in the point, so they may be interpolated over a triangle before the
        division. ``depth`` is the distance along the view direction, metres.
        """
        return affine(points, self._clip_matrix(), np.empty((len(points), 4)))

    def _clip_matrix(self) -> np.ndarray:
        """(4, 4): all four coordinates are linear in the point."""
        x, y, _, w = self.projection @ self.to_camera
        return np.stack((0.5 * (x + w), 0.5 * (y + w), w, -self.to_camera[2]))

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixel coordinates (N, 2) of world points in front of the camera, from the lower left."""
        clip = self.clip(points)
        return clip[:, :2] / clip[:, 2:3] * np.array(self.size, float)

    def covered(self, points: np.ndarray, margin: int) -> tuple[int, int, int, int]:
        """Pixels (x0, y0, x1, y1), half open, that what lies between points (N, 3) can cover."""
        clip = self.clip(points)
        width, height = self.size
        if np.any(clip[:, 2] <= 0):
            # Some of it is behind the eye, or the eye is in it.
            return (0, 0, 0, 0) if np.all(clip[:, 2] <= 0) else (0, 0, width, height)
        xy = clip[:, :2] / clip[:, 2:3] * (width, height)
        low = np.floor(np.clip(xy.min(axis=0) - margin, 0, (width, height))).astype(int)
        high = np.ceil(np.clip(xy.max(axis=0) + margin, 0, (width, height))).astype(int)
        return (int(low[0]), int(low[1]), int(high[0]), int(high[1]))

    def rays(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World origins and unit directions (M, 3) of the rays through pixel coordinates (M,)."""
        found = affine(_in_plane(x, y), self.ray_matrix(), np.empty((len(x), 3)))
        if self.is_parallel:
            return found, np.broadcast_to(self.forward, found.shape)
        found /= np.sqrt(np.einsum("mk,mk->m", found, found))[:, None]
        return np.broadcast_to(self.eye, found.shape), found

    def rays_in(self, glass: Glass, x: np.ndarray, y: np.ndarray):
        """The eye (3,) or origins (M, 3), and directions (M, 3), not unit, in a glass's frame."""
        pose, matrix = glass.from_world(), self.ray_matrix()
        local = pose[:, :3] @ matrix
        if self.is_parallel:
            local[:, 3] += pose[:, 3]
        found = affine(_in_plane(x, y), local, np.empty((len(x), 3)))
        if self.is_parallel:
            return found, np.broadcast_to(glass.direction_to_local(self.forward), found.shape)
        return glass.to_local(self.eye), found

    def ray_matrix(self) -> np.ndarray:
        """(3, 4): takes (x, y, 0) in pixels to a direction, in a parallel view to an origin."""
        width, height = self.size
        p = self.projection
        rotation = self.to_camera[:3, :3].T
        if self.is_parallel:
            centre = ((-1 - p[0, 3]) / p[0, 0], (-1 - p[1, 3]) / p[1, 1], 0.0)
        else:
            centre = ((p[0, 2] - 1) / p[0, 0], (p[1, 2] - 1) / p[1, 1], -1.0)
        found = np.zeros((3, 4))
        found[:, 0] = rotation[:, 0] * 2.0 / (width * p[0, 0])
        found[:, 1] = rotation[:, 1] * 2.0 / (height * p[1, 1])
        found[:, 3] = rotation @ np.array(centre) + (self.eye if self.is_parallel else 0.0)
        return found


def _in_plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack((x, y, np.zeros(len(x))), axis=1)


def read_viewpoint(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> Viewpoint:
    """The scene's camera as it is evaluated in the depsgraph, at the render size.

    Raises
    ------
    RefractiveGlassError
        No camera, or one whose rays do not come from one point or one direction.
    """
    camera = scene.camera
    if camera is None:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" has no camera: add one (Add > Camera) or choose the active one'
        )
    if camera.type != "CAMERA":
        raise RefractiveGlassError(
            f'The active camera "{camera.name}" is no camera object: choose one'
        )
    evaluated = camera.evaluated_get(depsgraph)
    data = evaluated.data
    if data.type not in {"PERSP", "ORTHO"}:
        raise RefractiveGlassError(
            f'Camera "{camera.name}" is neither perspective nor orthographic: change its lens type'
        )
    render = scene.render
    size = render_size(scene)
    window = render_window(scene)
    if window[0] >= window[2] or window[1] >= window[3]:
        raise RefractiveGlassError(
            f'The picture of scene "{scene.name}" has no pixels: raise its resolution or enlarge '
            "its render region"
        )
    projection = np.array(
        evaluated.calc_matrix_camera(
            depsgraph,
            x=size[0],
            y=size[1],
            scale_x=render.pixel_aspect_x,
            scale_y=render.pixel_aspect_y,
        ),
        float,
    )
    # Cameras ignore their scale, as Blender does.
    to_world = np.array(evaluated.matrix_world.normalized(), float)
    if not (np.isfinite(projection).all() and np.isfinite(to_world).all()):
        raise RefractiveGlassError(
            f'Camera "{camera.name}" has a place or a lens that is no number: enter its values anew'
        )
    u, stretch, vt = np.linalg.svd(to_world[:3, :3])
    if np.ptp(stretch) > _SHEAR:
        raise RefractiveGlassError(
            f'Camera "{camera.name}" is sheared by an uneven scale of its parents: apply that '
            "scale (Ctrl A), or clear the camera's parent"
        )
    rotation = (u @ vt).T
    eye = to_world[:3, 3].copy()
    to_camera = np.eye(4)
    to_camera[:3, :3] = rotation
    to_camera[:3, 3] = -rotation @ eye
    is_parallel = data.type == "ORTHO"
    lens = _read_lens(data, eye, rotation[2], depsgraph) if not is_parallel else None
    return Viewpoint(eye, to_camera, projection, size, window, is_parallel, lens)


def _read_lens(
    data: bpy.types.Camera, eye: np.ndarray, axis: np.ndarray, depsgraph: bpy.types.Depsgraph
) -> Lens | None:
    """The opening of a perspective camera that looks against an axis, as engines take it."""
    dof = data.dof
    if not dof.use_dof:
        return None
    focus = float(dof.focus_distance)
    if dof.focus_object is not None:
        target = dof.focus_object.evaluated_get(depsgraph)
        place = target.matrix_world
        if target.type == "ARMATURE" and dof.focus_subtarget in target.pose.bones:
            place = place @ target.pose.bones[dof.focus_subtarget].matrix
        focus = abs(float(axis @ (np.array(place, float)[:3, 3] - eye)))
    # Lengths of lenses are millimetres, and metres the unit of the scene.
    radius = 0.5e-3 * data.lens / max(dof.aperture_fstop, 1e-5)
    return Lens(
        radius,
        max(focus, 1e-5),
        float(dof.aperture_ratio),
        int(dof.aperture_blades),
        float(dof.aperture_rotation),
    )


def render_window(scene: bpy.types.Scene) -> tuple[int, int, int, int]:
    """The pixels of the frame that the rendered picture holds: (x0, y0, x1, y1), half open."""
    render = scene.render
    if not (render.use_border and render.use_crop_to_border):
        return (0, 0, *render_size(scene))
    return border_window(scene)


def border_window(scene: bpy.types.Scene) -> tuple[int, int, int, int]:
    """The pixels of the frame within its border, whether it is used or not."""
    width, height = render_size(scene)
    render = scene.render
    # Rounded as Blender does when a render starts: 0.7 of 60 is 42 in single precision alone.
    x0, y0, x1, y1 = (
        int(np.float32(part) * np.float32(size))
        for part, size in (
            (render.border_min_x, width),
            (render.border_min_y, height),
            (render.border_max_x, width),
            (render.border_max_y, height),
        )
    )
    return (x0, y0, x1, y1)


def render_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height of the rendered frame in pixels."""
    render = scene.render
    factor = render.resolution_percentage / 100.0
    return int(render.resolution_x * factor), int(render.resolution_y * factor)


def shutter_times(scene: bpy.types.Scene, frame: float) -> tuple[float, float]:
    """When the shutter opens and closes, frames, as engines blur motion."""
    render = scene.render
    start = {"START": 0.0, "CENTER": -0.5, "END": -1.0}[render.motion_blur_position]
    opens = frame + start * render.motion_blur_shutter
    return opens, opens + render.motion_blur_shutter


def samples_setting(scene: bpy.types.Scene) -> tuple[bpy.types.bpy_struct, str]:
    """Settings of the scene's engine that hold its samples per pixel, and the property's name."""
    if scene.render.engine == "CYCLES":
        return scene.cycles, "samples"
    return scene.eevee, "taa_render_samples"


def clamp_settings(scene: bpy.types.Scene, engine: str) -> tuple[float, float]:
    """Most light of a sample by direct and by indirect light in an engine; 0: any."""
    if engine == "CYCLES":
        return float(scene.cycles.sample_clamp_direct), float(scene.cycles.sample_clamp_indirect)
    eevee = scene.eevee
    return float(eevee.clamp_surface_direct), float(eevee.clamp_surface_indirect)
