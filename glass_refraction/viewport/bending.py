# SPDX-License-Identifier: GPL-3.0-or-later
"""Which glasses of a view displaced vertices can show, and what their shader needs to know of them.

The paper moves every vertex to where it appears along a light path. That is one picture where every
point has one image along it: through a stack of layers, and through both walls of a tube or hollow
ball that holds what is around it. Behind rods, filled glasses and cups a point has several images,
and so it has along every path that is mirrored: rays show those.

The shader computes in a frame that depends on the eye. Its unit is the glass's. A tube's and a
ball's eye is on the x axis, a tube's axis is z. Of layers the eye is on the z axis, which points to
it, and z = 0 is the first interface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..optics.bodies import Ball, Prism, Tube
from ..scene.read.viewpoint import Viewpoint
from .description import Frame, Posed

SLAB, TUBE, BALL = range(3)

MOST_LAYERS = 8
"""Media of a stack that the shader has room for, those above and below included."""
BLOCK_ROWS = 11 + MOST_LAYERS
COURSE_BASE = 32
"""A course is a number with one digit of this base for each interface that was crossed."""
MOST_DIGITS = 6
"""Interfaces that a course can tell: it is a 32 bit integer."""
LEAST_AWAY = 1e-4
"""How far outside the glass the eye must be, in units of the glass."""

SEVERAL = "its light paths have several images"
WITHIN = "the eye is in it"
PARALLEL = "orthographic views are drawn by rays"
DISPERSES = "it disperses light"
LAYERS = "it has too many layers"
CLEAR = "what it holds is not what is around it, or its wall is the thinner medium"


class ByRays(ValueError):
    """Displaced vertices cannot show a glass from this eye; the text says why."""


@dataclass(frozen=True)
class Bending:
    """A glass as the vertex shader bends light through it.

    Attributes
    ----------
    number : of the glass among the view's.
    kind : SLAB, TUBE or BALL.
    from_world : (4, 4) float64, to the frame described above; a rotation, a shift and a scale.
    eye : (3,) in that frame.
    inner : radius of a tube's or ball's inner face, the outer one's being 1.
    ior : of its wall, by that of what is around it.
    layers : (thickness, ior) from the eye down; of the last one the thickness is the vertex's own.
    floor : depth of the last interface below the first one.
    course : the interfaces that the whole path crosses, see `course_of`. held : those after which
        the contents of a tube or ball are seen; 0 for a slab.
    """

    number: int
    kind: int
    from_world: np.ndarray
    eye: np.ndarray
    inner: float = 0.0
    ior: float = 1.0
    layers: tuple[tuple[float, float], ...] = ()
    floor: float = 0.0
    course: int = 0
    held: int = 0

    def block(self, view: Viewpoint, frame: Frame, raster: np.ndarray) -> np.ndarray:
        """The shader's block, (BLOCK_ROWS, 4) float32; see ``Bend`` in :mod:`vertex_glsl`.

        Parameters
        ----------
        raster : (4, 4) from the view's clip space to that of the picture that is drawn.
        """
        to_world = np.linalg.inv(self.from_world)
        project = raster @ view.projection
        block = np.zeros((BLOCK_ROWS, 4))
        # Only turned: the eye's own place is far from every glass, and single precision short.
        turned = np.zeros((4, 4))
        turned[:3, :3] = view.to_camera[:3, :3] @ to_world[:3, :3]
        block[:4] = (project @ turned).T
        block[4:8] = (np.linalg.inv(frame.to_world()) @ to_world).T
        block[8] = project[:, 3]
        block[9, :3] = self.eye
        block[10] = self.inner, self.ior, len(self.layers), self.floor
        for number, (thickness, ior) in enumerate(self.layers):
            block[11 + number, :2] = thickness, ior
        return block.astype(np.float32)


def bending(number: int, glass: Posed, view: Viewpoint, disperses: bool = False) -> Bending:
    """How a glass bends what a vertex shader draws.

    Raises
    ------
    ByRays
        Vertices behind it may have several images from there, or none that is known.
    """
    if view.is_parallel:
        raise ByRays(PARALLEL)
    if disperses:
        raise ByRays(DISPERSES)
    body = glass.body
    eye = (view.eye - glass.to_world[:3, 3]) @ glass.to_world[:3, :3] / body.scale
    inward = np.eye(4)
    inward[:3, :3] = glass.to_world[:3, :3].T
    inward[:3, 3] = -inward[:3, :3] @ glass.to_world[:3, 3]
    inward[:3] /= body.scale
    if isinstance(body, Prism):
        return _slab(number, body, eye, inward)
    if isinstance(body, Tube | Ball):
        return _hollow(number, body, eye, inward)
    raise ByRays(SEVERAL)


def _slab(number: int, body: Prism, eye: np.ndarray, inward: np.ndarray) -> Bending:
    heights = np.asarray(body.glass.heights) / body.scale
    media = list(body.glass.media)
    faces = list(range(len(heights)))
    turn = np.eye(4)
    if eye[2] > heights[0] + LEAST_AWAY:
        turn[:3, 3] = -eye[0], -eye[1], -heights[0]
        height = eye[2] - heights[0]
    elif eye[2] < heights[-1] - LEAST_AWAY:
        # From below: half a turn about x puts the last interface first.
        turn[1, 1] = turn[2, 2] = -1.0
        turn[:3, 3] = -eye[0], eye[1], heights[-1]
        height = heights[-1] - eye[2]
        media.reverse()
        faces.reverse()
    else:
        raise ByRays(WITHIN)
    if len(media) > MOST_LAYERS or len(faces) > MOST_DIGITS:
        raise ByRays(LAYERS)
    thickness = [height, *np.abs(np.diff(heights)).tolist(), 0.0]
    if faces[0] != 0:
        thickness[1:-1] = thickness[-2:0:-1]
    return Bending(
        number,
        SLAB,
        turn @ inward,
        np.array((0.0, 0.0, height)),
        layers=tuple(zip(thickness, media, strict=True)),
        floor=float(heights[0] - heights[-1]),
        course=course_of(faces),
    )


def _hollow(number: int, body: Tube | Ball, eye: np.ndarray, inward: np.ndarray) -> Bending:
    glass = body.glass
    if len(glass.radius) != 2:
        raise ByRays(SEVERAL)
    wall, core = glass.ior
    if core != glass.ior_outside:
        raise ByRays(SEVERAL)
    if wall <= core:
        raise ByRays(CLEAR)
    along = eye.copy()
    shift = np.zeros(3)
    if isinstance(body, Tube):
        along[2] = 0.0
        shift[2] = eye[2]
    away = float(np.linalg.norm(along))
    if away < 1.0 + LEAST_AWAY:
        raise ByRays(WITHIN)
    turn = np.eye(4)
    turn[:3, :3] = _towards(along / away, upright=isinstance(body, Tube))
    turn[:3, 3] = -turn[:3, :3] @ shift
    names = [interface.name for interface in body.interfaces]
    outer, inner = names.index("wall 0"), names.index("wall 1")
    return Bending(
        number,
        TUBE if isinstance(body, Tube) else BALL,
        turn @ inward,
        np.array((away, 0.0, 0.0)),
        inner=glass.radius[1] / glass.radius[0],
        ior=wall / glass.ior_outside,
        course=course_of([outer, inner, inner, outer]),
        held=course_of([outer, inner]),
    )


def _towards(axis: np.ndarray, upright: bool) -> np.ndarray:
    """(3, 3) a rotation that brings a unit vector to the x axis; `upright`: z stays where it is."""
    up = np.array((0.0, 0.0, 1.0))
    if not upright and abs(axis[2]) > math.sqrt(0.5):
        up = np.array((0.0, 1.0, 0.0))
    side = np.cross(up, axis)
    side /= np.linalg.norm(side)
    return np.stack((axis, side, np.cross(axis, side)))


def course_of(interfaces: list[int]) -> int:
    """The number that tells a way which crosses these interfaces, by their place in the body."""
    course = 0
    for number in interfaces:
        course = course * COURSE_BASE + min(number, COURSE_BASE - 2) + 1
    return course
