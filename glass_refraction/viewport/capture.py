# SPDX-License-Identifier: GPL-3.0-or-later
"""What a view does not show and rays from a glass may meet: the scene all round it, captured.

A capture is a cube: six square pictures, seen from a place in the glass, each with the distances of
what it shows. The view's own engine draws them off-screen, from a timer and never while a view is
drawn, one face at a time: that holds Blender up for as long as such a small picture takes. They
are drawn again when the scene changes, and stay as they are when only the eye moves.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ..optics.vectors import perpendiculars
from ..scene.changes import put_back
from .description import Frame, Posed
from .eye import CAPTURES, WORLD
from .jobs import amends_depths, draws_off_screen, is_compiling
from .paint import _shader, filling, odd_size
from .wires import Wires

FACES = 6
CLOSE = FACES
"""Number of a capture's close picture, which comes after its faces: it looks where a curved glass
magnifies most, ahead of the eye through the glass's middle."""
OPENING = 0.35
"""Half of a close picture's side at a distance of 1; of a face it is 1."""
AIM_KEPT = 0.15
"""As much, in the same measure, a close picture may look beside where it should."""
LEAST_SHARE = 0.05
"""Of the view's pixels: glasses that may cover less have no close picture."""
EEVEE_SAMPLES = 2
"""Of a face that EEVEE draws, at most: it draws all samples of a view in one go, 16 by default.
More bring the picture in the glass no nearer to F12's; with one it is 0.3 dB farther off."""
SIDES = {"SOLID": 256, "MATERIAL": 320, "RENDERED": 320}
"""Pixels a side of a face, by the view's shading. One size each: engines compile for it."""
NEAR = 0.02
"""Of the glass's reach: what is nearer to the capture's centre is not drawn."""
FAR = 100.0
"""Least distance drawn, in reaches of the glass."""
BEYOND = 2.0
"""The world alone is drawn from that many times the distance on in which all things lie."""
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Parts of a glass's box at which a capture's centre may lie."""
MIDDLE = 0.5
"""How much nearer to a thing a centre may lie for being nearer to the middle."""

BLOCKED = 0.2
"""Of the places in a glass: if things hide that many from its capture, it has a second one."""

KEPT = 0.2
"""Of a glass's reach: a centre that much better is worth all faces anew."""
LEAST_HALF = 1e-6
"""Metres: flat things have a box too."""

STEP_BACK = 0.1
"""How far a camera that brings the light stands behind a capture's centre, in least distances."""
SMALL = 1e-6
"""What its projection is multiplied by, which changes no picture."""

OVERLAYS = (
    "show_annotation",
    "show_axis_x",
    "show_axis_y",
    "show_axis_z",
    "show_bones",
    "show_cursor",
    "show_extras",
    "show_face_orientation",
    "show_floor",
    "show_light_colors",
    "show_look_dev",
    "show_motion_paths",
    "show_object_origins",
    "show_object_origins_all",
    "show_ortho_grid",
    "show_outline_selected",
    "show_reconstruction",
    "show_relationship_lines",
    "show_stats",
    "show_text",
    "show_wireframes",
    "show_viewer_attribute",
)
"""Settings of overlays that may draw something of objects."""

STUDIO = (
    "studio_light",
    "studiolight_intensity",
    "studiolight_rotate_z",
    "studiolight_background_alpha",
)
"""Settings of a view's own world, where the scene's is not wanted."""
KINDS = "show_object_viewport_"
"""Begins the names of settings that tell which kinds of objects a view shows."""

_drawing = False


def is_drawing() -> bool:
    """Whether a capture is being drawn: draw handlers are called for it too."""
    return _drawing


class Captures:
    """The captures of a view's glasses, side by side in one texture.

    Attributes
    ----------
    glasses : how many have captures. centres : of their captures, then of their second ones, as far
        as there is room; `listed` tells which are there.
    """

    def __init__(self) -> None:
        self.glasses = 0
        self.centres: list[np.ndarray] = []
        self._seconds: set[int] = set()
        self._has_world = False
        self._world_key: tuple = ()
        self.side = 0
        self.version = 0
        self.seconds = 0.0
        self._samples = 1
        """Of the last face, which took so long."""
        self._is_rough = False
        """Faces were drawn in haste since all were outdated."""
        self._stale: set[tuple[int, int]] = set()
        self._ages: dict[tuple[int, int], int] = {}
        """Of faces that were drawn, the version that came with each."""
        self._drawn: set[tuple[int, int]] = set()
        self._atlas = None
        self._face = None
        self._key: tuple = ()
        self._boxes: list[Box] = []
        self._wanted: dict[int, np.ndarray] = {}
        self._closes: dict[int, np.ndarray] = {}
        """Of close pictures by the number of their capture: where they are to look, and where those
        looked that are drawn; see `aimed`."""

    @property
    def textures(self) -> tuple:
        """Colours and depths of all faces, once they were arranged."""
        return self._atlas[:2]

    def _make_atlas(self, width: int, height: int) -> None:
        colour = gpu.types.GPUTexture((width, height), format="RGBA16F")
        depth = gpu.types.GPUTexture((width, height), format="R32F")
        target = gpu.types.GPUFrameBuffer(color_slots=[colour, depth])
        self._atlas = (colour, depth, target)

    @property
    def left(self) -> int:
        """Faces that are still to be drawn."""
        return len(self._stale)

    @property
    def least_seconds(self) -> float:
        """Of a face that is drawn in haste, as the last one tells; 0 before there is one."""
        return self.seconds / self._samples

    @property
    def total(self) -> int:
        cubes = self.glasses + len(self._seconds) + self._has_world
        return FACES * cubes + len(self._wanted)

    def listed(self) -> list[tuple[np.ndarray, int, np.ndarray | None]]:
        """Centre, side and close picture of each, for `eye.pack_view`; side 0 until all its faces
        are drawn.
        """
        found = []
        for k in range(WORLD + 1 if self.centres else 0):
            is_drawn = all((k, f) in self._drawn for f in range(FACES))
            found.append((self._centre(k), self.side if is_drawn else 0, self._closes.get(k)))
        return found

    def _centre(self, number: int) -> np.ndarray:
        """Where a capture is seen from; those that are none, and the world, from the first's."""
        return self.centres[number if number < len(self.centres) else 0]

    def aim(self, targets: dict[int, np.ndarray]) -> None:
        """Have close pictures look at places (3,), by the number of their capture.

        Those that look nearly there already stay as they are. Faces are drawn before: only then a
        capture's centre is known.
        """
        for number in self._wanted.keys() - targets.keys():
            del self._wanted[number]
            self._closes.pop(number, None)
            self._stale.discard((number, CLOSE))
        for number, target in targets.items():
            wanted = aimed(target - self.centres[number])
            last = self._wanted.get(number)
            if last is None or np.linalg.norm(wanted[2] - last[2]) > AIM_KEPT:
                self._wanted[number] = wanted
                self._stale.add((number, CLOSE))

    def arrange(
        self, glasses: list[Posed], shading: tuple, boxes: list[Box], everything: int
    ) -> None:
        """See that every glass has a capture, to be drawn when there is time.

        Until then the last ones are looked up, from where they were drawn. Equal numbers
        ``everything``, and equal shading: the world is as it was.
        """
        side = SIDES.get(shading[0], SIDES["SOLID"])
        glasses = glasses[:CAPTURES]
        key = (side, len(glasses))
        if key != self._key:
            if side != self.side:
                self._face = None
            self._key, self.side = key, side
            self._drawn.clear()
            self._ages.clear()
            self._wanted.clear()
            self._closes.clear()
            # As large as it will be: drivers compile shaders anew for textures of another kind.
            self.glasses = len(glasses)
            self.centres = [glass.middle() for glass in [*glasses, *glasses][:CAPTURES]]
            self._seconds.clear()
            self._has_world = shading[0] != "SOLID" and bool(glasses)
            rows = max(1, len(self.centres) + self._has_world)
            self._make_atlas((FACES + 1) * side, odd_size(rows * side))
            self._world_key = ()
        self._boxes = boxes
        world_key = (shading, everything)
        self.outdate(world=world_key != self._world_key)
        self._world_key = world_key

    def outdate(self, world: bool = False) -> None:
        """The scene or its looks changed, and with them the world or not."""
        faces = set(product((WORLD,) if self._has_world else (), range(FACES)))
        kept = faces if world else faces & self._stale
        self._stale = set(product((*range(self.glasses), *self._seconds), range(FACES))) | kept
        self._stale |= {(number, CLOSE) for number in self._wanted}

    def leave(self) -> None:
        """Draw no more until the scene or its looks change: no engine can."""
        self._stale.clear()

    def smooth(self) -> None:
        """Have all faces drawn anew if some were drawn in haste."""
        if self._is_rough:
            self._is_rough = False
            self.outdate()

    def draw(
        self,
        frame: Frame,
        glasses: list[Posed],
        view_3d: tuple,
        wires: Wires,
        turned: np.ndarray | None = None,
        hastily: bool = False,
    ) -> None:
        """Draw the next face. From a timer only.

        Parameters
        ----------
        view_3d : scene, view layer, space and region that it is drawn as.
        wires : of the view's glasses, which overlays draw.
        turned : (3, 3) from the world to the camera that brings its light, if one does.
        hastily : with one sample a pixel; see `smooth`.
        """
        number, face = self._next()
        glass = glasses[number % self.glasses]
        if number < self.glasses and all((number, k) in self._stale for k in range(FACES)):
            before = self.centres[number]
            self.centres[number] = centre_of(glass, self._boxes, before)
            if not np.array_equal(before, self.centres[number]):
                # It was seen from elsewhere.
                self._wanted.pop(number, None)
                self._closes.pop(number, None)
                self._stale.discard((number, CLOSE))
            self._look_behind(number, glass)
        side, centre = self.side, self._centre(number)
        is_first = self._face is None
        if is_first:
            self._face = gpu.types.GPUOffScreen(side, side, format="RGBA16F")
        scene, layer, space, region = view_3d
        reach = glass.reach()
        near, far = NEAR * reach, max(FAR * reach, space.clip_end)
        if number == WORLD:
            ways = (np.linalg.norm(box.corners - centre, axis=1).max() for box in self._boxes)
            near = BEYOND * max(far, *ways)
            far = BEYOND * near
        began = time.perf_counter()
        if face == CLOSE:
            rows, projection = self._wanted[number], face_projection(near, far, OPENING)
        else:
            rows, projection = axes(face), face_projection(near, far)
        to_camera = face_view(rows, centre)
        if turned is not None:
            to_camera, projection = lit_as_beside(to_camera, projection, turned, near)
        amended = amends_depths(scene, space)
        self._samples = EEVEE_SAMPLES if amended and not (is_first or hastily) else 1
        self._is_rough |= amended and hastily
        quick = _quickly(layer, self._samples) if amended else nullcontext()
        with quick, _plainly(space, bpy.context.preferences):
            self._face.draw_view3d(
                scene,
                layer,
                space,
                region,
                Matrix(to_camera),
                Matrix(projection),
                do_color_management=False,
                draw_background=False,
            )
        self.seconds = time.perf_counter() - began
        if is_compiling():
            # To be drawn again. And by an engine of its own: Blender 5.2 crashes where one goes on
            # that has drawn stand-ins.
            self._face = None
            return
        if is_first and amended:
            # What EEVEE makes at its start it makes anew for each sample that it draws in that go.
            # The next one has more samples, and takes as much longer.
            self.seconds *= EEVEE_SAMPLES
            return
        depth = gpu.types.Buffer("FLOAT", (side, side))
        with self._face.bind():
            gpu.state.active_framebuffer_get().read_depth(0, 0, side, side, data=depth)
        wire_depth = wires.draw(projection @ to_camera, (side, side))
        self._keep(number, face, depth, wire_depth, near / frame.unit, far / frame.unit, amended)
        self.seconds = time.perf_counter() - began
        self._stale.discard((number, face))
        if face == CLOSE:
            self._closes[number] = rows * ((1.0 / OPENING,), (1.0 / OPENING,), (1.0,))
        else:
            self._drawn.add((number, face))
        self._note(number, face)

    def _next(self) -> tuple[int, int]:
        """The face to draw: what moves may outdate all of them before the last one is drawn."""
        return min(self._stale, key=lambda one: (self._ages.get(one, -1), one))

    def _note(self, number: int, face: int) -> None:
        """A face was drawn."""
        self.version += 1
        self._ages[number, face] = self.version

    def _look_behind(self, number: int, glass: Posed) -> None:
        """See whether a glass needs a second capture, behind what hides much from its first."""
        second = number + self.glasses
        if second >= len(self.centres):
            return
        centre = second_centre_of(glass, self._boxes, self.centres[number])
        faces = set(product((second,), range(FACES)))
        if centre is None:
            self._seconds.discard(second)
            self._stale -= faces
            self._drawn -= faces
        else:
            self._seconds.add(second)
            self.centres[second] = centre
            self._stale |= faces

    def _keep(
        self, number: int, face: int, depth, wire_depth, near: float, far: float, amended: bool
    ) -> None:
        side = self.side
        texture = gpu.types.GPUTexture((side, side), format="R32F", data=depth)
        width, height = self._atlas[0].width, self._atlas[0].height
        x, y = face * side, min(number, len(self.centres)) * side
        low = 2.0 * x / width - 1.0, 2.0 * y / height - 1.0
        high = 2.0 * (x + side) / width - 1.0, 2.0 * (y + side) / height - 1.0
        box = (*low, *high)
        with filling(self._atlas[2], (width, height), _shader("face"), (box,)) as shader:
            shader.uniform_sampler("face_tx", self._face.texture_color)
            shader.uniform_sampler("depth_tx", texture)
            shader.uniform_sampler("wire_tx", wire_depth)
            shader.uniform_float("line", (near * far, 0.0, far, near - far))
            shader.uniform_float("least", 1.0)
            shader.uniform_int("origin", (x, y))
            shader.uniform_int("amended", int(amended))


@contextmanager
def _quickly(layer: bpy.types.ViewLayer, samples: int) -> Iterator[None]:
    """While EEVEE draws a capture: few samples. The user's own setting is not touched.

    What EEVEE reads is the evaluated scene's, and to write that has Blender evaluate the scene.
    """
    scene = layer.depsgraph.scene_eval
    before = scene.eevee.taa_samples
    if before <= samples:
        # 0 is without end in a view, and one sample here.
        yield
        return
    with put_back(scene, layer):
        settings = layer.depsgraph.scene_eval.eevee
        settings.taa_samples = samples
        try:
            yield
        finally:
            settings.taa_samples = before


@contextmanager
def _plainly(space: bpy.types.SpaceView3D, preferences: bpy.types.Preferences) -> Iterator[None]:
    """While a capture is drawn: no overlays in Solid, and one sample a pixel; for EEVEE, which else
    writes no depths, as few overlays as there can be.

    More samples are for smooth edges, of which a capture's depths know nothing. To take them
    Blender shakes a projection as if it were not turned.
    """
    global _drawing
    if space.shading.type == "SOLID":
        wanted = [
            (space.overlay, "show_overlays", False),
            (preferences.system, "viewport_aa", "OFF"),
        ]
    else:
        names = ("show_overlays", *(name for name in OVERLAYS if hasattr(space.overlay, name)))
        wanted = [(space.overlay, name, name == "show_overlays") for name in names]
    unsaved = preferences.is_dirty
    _drawing = True
    try:
        with _set(wanted):
            yield
    finally:
        preferences.is_dirty = unsaved
        _drawing = False


def drawn_as(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> bpy.types.SpaceView3D | None:
    """The space as which captures of a view are drawn, see `drawable`; None if there is none."""
    if draws_off_screen(scene, space):
        return space
    return _hidden_space() if _shows_all(space) else None


@contextmanager
def drawable(
    scene: bpy.types.Scene, space: bpy.types.SpaceView3D
) -> Iterator[bpy.types.SpaceView3D | None]:
    """`drawn_as`, with the settings that captures take.

    For Cycles EEVEE draws them, lit by the same lamps and world. To set that in the user's own view
    would have Cycles begin anew: it is set in a view of a screen that is not shown.
    """
    hidden = drawn_as(scene, space)
    if hidden in (None, space):
        yield hidden
        return
    # The type comes first: it tells of what the others are.
    shading, wanted = hidden.shading, [(hidden.shading, "type", "MATERIAL")]
    for name in ("use_scene_lights", "use_scene_world"):
        wanted.append((shading, name, getattr(space.shading, f"{name}_render")))
    wanted += [(shading, name, getattr(space.shading, name)) for name in STUDIO]
    wanted += [
        (hidden, name, getattr(space, name)) for name in dir(space) if name.startswith(KINDS)
    ]
    with _set(wanted):
        yield hidden


def _shows_all(space: bpy.types.SpaceView3D) -> bool:
    """Whether a view shows what the view layer does, and nothing less."""
    return not (space.local_view or space.use_local_collections)


def _hidden_space() -> bpy.types.SpaceView3D | None:
    """A 3D view that no window shows and that shows what others do."""
    shown = {
        area.spaces.active.as_pointer()
        for window in bpy.context.window_manager.windows
        for area in window.screen.areas
    }
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if (
                    space.type == "VIEW_3D"
                    and space.as_pointer() not in shown
                    and _shows_all(space)
                ):
                    return space
    return None


@contextmanager
def _set(wanted: list[tuple]) -> Iterator[None]:
    """Settings (owner, name, value) for a while, one after the other; only those that differ."""
    before = []
    try:
        for owner, name, value in wanted:
            last = getattr(owner, name)
            if last != value:
                before.append((owner, name, last))
                setattr(owner, name, value)
        yield
    finally:
        for setting in reversed(before):
            setattr(*setting)


def lit_as_beside(
    to_face: np.ndarray, projection: np.ndarray, turned: np.ndarray, near: float
) -> tuple[np.ndarray, np.ndarray]:
    """(4, 4) twice: another camera and projection that draw the same picture, lit as the view is.

    The light of Solid shading comes with the camera. So the camera stands as the view's, (3, 3)
    ``turned``, and its projection is turned instead.

    Blender leaves out things that lie beside the eight corners of what a camera sees. It works
    these out as if no projection were turned. The corners of a parallel projection with small
    numbers lie far out on all sides, and Blender takes a projection for parallel whose last number
    is not 0: so the camera stands a little behind the capture's centre.
    """
    back = np.eye(4)
    back[2, 3] = -STEP_BACK * near
    turn = np.eye(4)
    turn[:3, :3] = turned @ to_face[:3, :3].T
    to_camera = turn @ back @ to_face
    return to_camera, SMALL * projection @ to_face @ np.linalg.inv(to_camera)


def axes(face: int) -> np.ndarray:
    """(3, 3) rows: right, up and forward of a face's picture; the shader's ``face_of`` agrees."""
    axis, turn = face // 2, 1.0 - 2.0 * (face % 2)
    unit = np.eye(3)
    return np.stack((unit[(axis + 1) % 3], -turn * unit[(axis + 2) % 3], turn * unit[axis]))


def aimed(along: np.ndarray) -> np.ndarray:
    """(3, 3) rows: right, up and forward of a picture that looks along a direction (3,)."""
    forward = along / np.linalg.norm(along)
    return np.stack((*perpendiculars(forward), forward))


def face_view(rows: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(4, 4): world to the camera that looks as `axes` or `aimed` tells."""
    matrix = np.eye(4)
    matrix[:3, :3] = rows * ((1.0,), (1.0,), (-1.0,))
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def face_projection(near: float, far: float, opening: float = 1.0) -> np.ndarray:
    """(4, 4): a square picture, half of whose side at a distance of 1 is ``opening``."""
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = 1.0 / opening
    matrix[2, 2], matrix[2, 3] = (near + far) / (near - far), 2.0 * near * far / (near - far)
    matrix[3, 2] = -1.0
    return matrix


def centre_of(glass: Posed, boxes: list[Box], last: np.ndarray) -> np.ndarray:
    """(3,) the place in a glass that is far from all things, and near the middle where it may.

    Parameters
    ----------
    last : where the last capture was drawn from: it stays if it is nearly as good, so that faces
        that were drawn before go on to fit.
    """
    places = np.concatenate((last[None], _places(glass)))
    away = np.linalg.norm(places - glass.middle(), axis=1)
    room, reach = _room(glass, boxes, places), glass.reach()
    # What is nearer than that is not drawn: from there one sees into things.
    score = room - MIDDLE * away - np.where(room < NEAR * reach, reach, 0.0)
    best = int(np.argmax(score))
    return places[0 if score[best] - score[0] < KEPT * reach else best]


def second_centre_of(glass: Posed, boxes: list[Box], first: np.ndarray) -> np.ndarray | None:
    """(3,) the place that is far from all things among those that they hide from a first one.

    None where little is hidden.
    """
    places = _places(glass)
    hidden = np.zeros(len(places), bool)
    for box in boxes:
        # What holds the first place, a room for instance, hides nothing from it.
        if not box.holds(first):
            hidden |= box.lies_between(first, places)
    if hidden.mean() < BLOCKED:
        return None
    return places[hidden][np.argmax(_room(glass, boxes, places[hidden]))]


def _places(glass: Posed) -> np.ndarray:
    """(N, 3) places in a glass, in the world."""
    low, high = glass.body.box
    parts = np.array(list(product(PLACES, repeat=3)))
    return (low + (high - low) * parts) @ glass.to_world[:3, :3].T + glass.to_world[:3, 3]


def _room(glass: Posed, boxes: list[Box], places: np.ndarray) -> np.ndarray:
    """Metres (N,) from places (N, 3) to the nearest thing, no more than the glass's reach."""
    room = np.full(len(places), glass.reach())
    for box in boxes:
        room = np.minimum(room, box.distance(places))
    return room


@dataclass(frozen=True)
class Box:
    """A thing's bounding box. to_box: (4, 4) world to its frame, metres there. half: (3,) sizes."""

    to_box: np.ndarray
    half: np.ndarray

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Metres (N,) from world places (N, 3) to the box; below 0 inside."""
        local = np.abs(places @ self.to_box[:3, :3].T + self.to_box[:3, 3]) - self.half
        outside = np.linalg.norm(np.maximum(local, 0.0), axis=1)
        return outside + np.minimum(local.max(axis=1), 0.0)

    def holds(self, place: np.ndarray) -> bool:
        """Whether a place (3,) is in the box."""
        local = np.abs(self.to_box[:3, :3] @ place + self.to_box[:3, 3])
        return bool(np.all(local <= self.half))

    def lies_between(self, one: np.ndarray, places: np.ndarray) -> np.ndarray:
        """(N,) whether the box is met on the straight way from one place to each of (N, 3)."""
        enter, leave = self._crossed(one, places - one)
        return np.maximum(enter, 0.0) <= np.minimum(leave, 1.0)

    def way_from(self, one: np.ndarray, along: np.ndarray) -> float:
        """Metres from a place (3,) along a unit direction to the box's surface; inf: not met."""
        enter, leave = (float(part[0]) for part in self._crossed(one, along[None]))
        if leave < max(enter, 0.0):
            return np.inf
        return enter if enter > 0.0 else leave

    def _crossed(self, one: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) twice: parts of ways (N, 3) from a place at which they enter and leave the box."""
        start = self.to_box[:3, :3] @ one + self.to_box[:3, 3]
        way = ways @ self.to_box[:3, :3].T
        way = np.where(np.abs(way) < LEAST_HALF, LEAST_HALF, way)
        ends = np.stack(((-self.half - start) / way, (self.half - start) / way))
        return ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)

    def unit(self) -> np.ndarray:
        """(4, 4): from the world to a frame in which the box runs from -1 to 1."""
        half = np.maximum(self.half, LEAST_HALF)
        return np.diag([*(1.0 / half), 1.0]) @ self.to_box

    def is_near(self, place: np.ndarray, reach: float) -> bool:
        """Whether the box may come within a distance of a place."""
        local = self.to_box[:3, :3] @ place + self.to_box[:3, 3]
        return bool(np.all(np.abs(local) < self.half + reach))

    @cached_property
    def corners(self) -> np.ndarray:
        """(8, 3) in the world."""
        local = np.array(list(product((-1.0, 1.0), repeat=3))) * self.half
        return np.linalg.solve(self.to_box[:3, :3], (local - self.to_box[:3, 3]).T).T


@dataclass(frozen=True)
class FramedBox(Box):
    """That of a glass's opaque faces: they leave room in it, as a frame does round its panes.

    faces : (T, 3, 3) corners of triangles, in the box's frame.
    """

    faces: np.ndarray

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Metres (N,) from world places (N, 3) to the faces."""
        local = places @ self.to_box[:3, :3].T + self.to_box[:3, 3]
        return np.array([_to_triangles(place, self.faces) for place in local])


MOST_FACES = 2000
"""Of a glass's frame: the largest ones, which tell of hundreds of places in a tenth of a second."""


def _to_triangles(place: np.ndarray, corners: np.ndarray) -> float:
    """Metres from a place (3,) to the nearest of triangles (T, 3, 3)."""
    ways, away = np.roll(corners, -1, axis=1) - corners, place - corners
    square = np.maximum((ways * ways).sum(axis=2), np.finfo(float).tiny)
    part = np.clip((away * ways).sum(axis=2) / square, 0.0, 1.0)
    nearest = np.linalg.norm(away - part[..., None] * ways, axis=2).min(axis=1)
    normal = np.cross(ways[:, 0], ways[:, 1])
    size = np.linalg.norm(normal, axis=1)
    above = (np.cross(ways, away) * normal[:, None]).sum(axis=2).min(axis=1) >= 0.0
    height = np.abs((away[:, 0] * normal).sum(axis=1)) / np.where(size > 0.0, size, 1.0)
    return float(np.where(above & (size > 0.0), height, nearest).min())


def framed(box: Box, faces: np.ndarray) -> Box:
    """The box of a glass whose opaque faces (T, 3, 3), in the world, are these."""
    if not len(faces):
        return box
    ways = faces[:, 1:] - faces[:, :1]
    area = np.linalg.norm(np.cross(ways[:, 0], ways[:, 1]), axis=1)
    largest = faces[np.argsort(-area, kind="stable")[:MOST_FACES]]
    local = largest @ box.to_box[:3, :3].T + box.to_box[:3, 3]
    return FramedBox(box.to_box, box.half, local)


def box_of(
    obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, to_world: np.ndarray | None = None
) -> Box | None:
    """The bounding box of an object as it is evaluated; None where its matrix has no inverse.

    Parameters
    ----------
    to_world : (4, 4) of an instance of it; by default the object's own.
    """
    evaluated = obj.evaluated_get(depsgraph)
    corners = np.array(evaluated.bound_box, float)
    low, high = corners.min(axis=0), corners.max(axis=0)
    matrix = np.array(evaluated.matrix_world, float) if to_world is None else to_world
    if not (np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3])):
        return None
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    to_box = np.diag([*size, 1.0]) @ np.linalg.inv(matrix)
    to_box[:3, 3] -= size * 0.5 * (low + high)
    return Box(to_box, 0.5 * size * (high - low))
