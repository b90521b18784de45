# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as eyes: places on them, what each sees of the glasses, and how much light it sends there.

A lamp of a size is a square lattice of places. Each stands for a cell of the lamp, and is the same
in every frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ...optics.vectors import dot, perpendiculars
from ..rays.beams import Beam, beam_of
from ..rays.lamps import lamp_is_normalised, lamp_power
from ..read.viewpoint import Viewpoint

LATTICE, LARGE_LATTICE = 3, 5
"""Places along either side of a lamp's lattice; of one that is seen larger than `LARGE`."""
LARGE = 0.03
"""Half width of a lamp over its distance."""
CELL = 0.5
"""Standard deviation of the bell that stands for a cell, in cells: bells side by side are smooth to
1.5 %, and sharper ones are not."""
NEAR_COSINE = 0.25
"""A lamp that sees a glass farther aside than this from its axis looks all round itself."""
WIDEST_SUN = np.radians(80.0)
"""Half angle of a sun, at most."""
FACES = np.array([[axis, np.roll(axis, 1)] for axis in (*np.eye(3), *-np.eye(3))])
"""(6, 2, 3): directions of the faces of a cube, and one along each face."""


@dataclass(frozen=True, eq=False)
class Emitter:
    """A lamp that lights matte surfaces.

    Attributes
    ----------
    name : of its object.
    power : (3,) by colour: irradiance across a sun's light, else what 1 steradian gets, W.
    place : (3,) world. axes : (3, 3) unit columns; its light goes along the last one, reversed.
    half : half its width along both axes: metres, of a sun the tangent of the half angle.
    is_sun, is_round, is_flat : a flat one sends light by the cosine, on one side.
    beam : how its light falls off beside its axis; None: not at all.
    """

    name: str
    power: np.ndarray
    place: np.ndarray
    axes: np.ndarray
    half: tuple[float, float]
    is_sun: bool = False
    is_round: bool = True
    is_flat: bool = False
    beam: Beam | None = None

    def side(self, towards: np.ndarray) -> int:
        """Places along either side of its lattice, as seen from a place."""
        if not any(self.half):
            return 1
        apart = 1.0 if self.is_sun else float(np.linalg.norm(towards - self.place))
        return LARGE_LATTICE if max(self.half) > LARGE * apart else LATTICE

    def lattice(self, side: int) -> np.ndarray:
        """Places (side², 2) of the lattice in half widths, so far within that the bells round them
        have the lamp's second moments."""
        if side == 1:
            return np.zeros((1, 2))
        steps = (2.0 * np.arange(side) + 1.0) / side - 1.0
        places = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        if self.is_round:
            places = on_disc(places)
        wanted = 0.25 if self.is_round else 1.0 / 3.0
        cell = (2.0 * CELL / side) ** 2
        return places * np.sqrt(wanted / ((places**2).mean() + cell))

    def facing(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Two unit vectors (3,) along which places on it are counted, as seen from a target."""
        if self.is_sun or self.is_flat:
            return self.axes[:, 0], self.axes[:, 1]
        return perpendiculars(_unit(target - self.place))

    def places(self, offsets: np.ndarray, target: np.ndarray) -> np.ndarray:
        """World places (S, 3) of offsets (S, 2) in half widths; of a sun unit directions to it."""
        right, up = self.facing(target)
        away = offsets[:, :1] * self.half[0] * right + offsets[:, 1:] * self.half[1] * up
        if self.is_sun:
            return _unit(self.axes[:, 2] + away)
        return self.place + away

    def sent(self, directions: np.ndarray) -> np.ndarray:
        """(N,) what it sends in unit directions (N, 3), over its power."""
        found = np.ones(len(directions))
        if self.is_flat:
            found = np.maximum(-dot(directions.T, self.axes[:, 2]), 0.0)
        return found if self.beam is None else found * self.beam.part(directions)

    def eyes(
        self, places: np.ndarray, corners: np.ndarray, centre: np.ndarray, back: float
    ) -> list[list[Viewpoint]]:
        """Through what each of its places (S, 3) sees all corners (C, 3): one view, or the six
        faces of a cube.

        Parameters
        ----------
        centre : the middle of the corners. back : metres before it that a sun's rays begin.
        """
        whole = np.array([(-1.0, -1.0), (1.0, 1.0)])
        if not self.is_sun and self._is_near(places, corners, centre):
            return [[_viewpoint(p, _turned(*face), whole) for face in FACES] for p in places]
        poses, planes = [], []
        for place in places:
            if self.is_sun:
                pose = centre + back * place, _turned(-place, self.axes[:, 0]), None
            else:
                depth = float(np.linalg.norm(centre - place))
                pose = place, _turned((centre - place) / depth, self.facing(centre)[0]), depth
            poses.append(pose)
            place, axes, depth = pose
            local = (corners - place) @ axes
            planes.append(local[:, :2] if depth is None else local[:, :2] * depth / local[:, 2:])
        # The same frame for all: a place in it is the same place among the glasses.
        frame = np.array([f(np.concatenate(planes), axis=0) for f in (np.min, np.max)])
        return [[_viewpoint(place, axes, frame, depth)] for place, axes, depth in poses]

    def _is_near(self, places, corners, centre) -> bool:
        """Whether glasses lie so far aside from the view to their middle that a cube is needed."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        if np.all((places > low) & (places < high), axis=1).any():
            return True
        for place in places:
            if (_unit(corners - place) @ _unit(centre - place)).min() < NEAR_COSINE:
                return True
        return False


def _viewpoint(
    place: np.ndarray, axes: np.ndarray, frame: np.ndarray, depth: float | None = 1.0
) -> Viewpoint:
    """What is seen from a place (3,) in a frame, as one pixel.

    Parameters
    ----------
    axes : (3, 3) unit columns: right, up, ahead.
    frame : (2, 2) low and high corner in a plane across, metres right and up.
    depth : metres ahead of that plane; None: a parallel view.
    """
    to_camera, projection = np.eye(4), np.diag((0.0, 0.0, 1.0, 0.0))
    to_camera[:3, :3] = (axes * (1.0, 1.0, -1.0)).T
    to_camera[:3, 3] = -to_camera[:3, :3] @ place
    size = np.ptp(frame, axis=0)
    middle = frame.sum(axis=0) / size
    projection[(0, 1), (0, 1)] = 2.0 * (1.0 if depth is None else depth) / size
    if depth is None:
        projection[:2, 3], projection[3, 3] = -middle, 1.0
    else:
        projection[:2, 2], projection[3, 2] = middle, -1.0
    return Viewpoint(place, to_camera, projection, (1, 1), (0, 0, 1, 1), depth is None)


def on_disc(places: np.ndarray) -> np.ndarray:
    """Places (N, 2) of the square from −1 to 1 on the unit disc, areas kept in proportion.

    P. Shirley and K. Chiu, A Low Distortion Map Between Disk and Square, 1997.
    """
    x, y = places.T
    steep = np.abs(y) > np.abs(x)
    radius = np.where(steep, y, x)
    part = np.divide(np.where(steep, x, y), radius, out=np.zeros(len(x)), where=radius != 0.0)
    angle = np.where(steep, 0.5 * np.pi - 0.25 * np.pi * part, 0.25 * np.pi * part)
    return radius[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _turned(forward: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(3, 3): unit columns right, up and ahead."""
    right = _unit(right - (right @ forward) * forward)
    return np.stack((right, np.cross(right, forward), forward), axis=1)


def read_emitters(
    depsgraph: bpy.types.Depsgraph, engine: str, problems: list[str]
) -> tuple[Emitter, ...]:
    """The lamps whose light glasses turn aside; a line for each that cannot be taken as it is.

    Lamps that cast no shadow shine through glasses as through all else.
    """
    found = []
    for instance in depsgraph.object_instances:
        obj = instance.object
        if obj.type != "LIGHT" or not obj.data.use_shadow or not obj.visible_diffuse:
            continue
        emitter = emitter_of(
            obj.data, np.array(instance.matrix_world, float), obj.original.name, engine
        )
        if not emitter.power.any():
            continue
        found.append(emitter)
        if obj.data.use_nodes and _has_nodes(obj.data):
            problems.append(
                f'Lamp "{emitter.name}" has nodes, and its light through the glass is that of its '
                "Power alone"
            )
    return tuple(found)


def _has_nodes(light: bpy.types.Light) -> bool:
    """Whether its nodes are more than what a new lamp's nodes are."""
    kinds = sorted(node.bl_idname for node in light.node_tree.nodes) if light.node_tree else []
    return kinds not in ([], ["ShaderNodeEmission", "ShaderNodeOutputLight"])


def emitter_of(light: bpy.types.Light, to_world: np.ndarray, name: str, engine: str) -> Emitter:
    """A lamp as the engine has it; see `rays.lamps` for its power."""
    scale = np.linalg.norm(to_world[:3, :3], axis=0)
    axes = to_world[:3, :3] / np.where(scale > 0.0, scale, 1.0)
    power = lamp_power(light, engine)
    beam = beam_of(light, to_world, engine)
    if engine != "CYCLES":
        power = power * float(light.diffuse_factor)
    normalised = lamp_is_normalised(light)
    place = to_world[:3, 3]
    if light.type == "SUN":
        tangent = float(np.tan(min(0.5 * light.angle, WIDEST_SUN)))
        if not normalised and tangent:
            power = power * np.pi * np.sin(0.5 * light.angle) ** 2
        return Emitter(name, power, place, axes, (tangent, tangent), is_sun=True)
    if light.type == "AREA":
        wide = float(light.size)
        high = float(light.size_y) if light.shape in {"RECTANGLE", "ELLIPSE"} else wide
        half = 0.5 * wide * float(scale[0]), 0.5 * high * float(scale[1])
        is_round = light.shape in {"DISK", "ELLIPSE"}
        area = half[0] * half[1] * (np.pi if is_round else 4.0)
        power = power / np.pi * (1.0 if normalised else area)
        return Emitter(name, power, place, axes, half, is_round=is_round, is_flat=True, beam=beam)
    radius = float(light.shadow_soft_size)
    power = power / (4.0 * np.pi) if normalised else power * radius**2
    return Emitter(name, power, place, axes, (radius, radius), beam=beam)
