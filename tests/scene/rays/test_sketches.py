# SPDX-License-Identifier: GPL-3.0-or-later
"""What the middles of a view's pixels tell of the hits that are looked for near them."""

from collections import Counter

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.reference.cycles import scene_depsgraph
from glass_refraction.scene import update as door
from glass_refraction.scene.rays import caster, hits, sketches, true
from glass_refraction.scene.rays.moved import Boxes
from glass_refraction.scene.rays.sketches import UNKNOWN, Sketch
from glass_refraction.scene.rays.things import Things
from glass_refraction.scene.rays.views import RadianceView
from glass_refraction.scene.read.viewpoint import read_viewpoint

WIDTH, HEIGHT = 64, 48
CARD_AT, WALL_AT = 1.0, 3.0
CARD, WALL, SKY = 0, 1, -1


class CardBeforeWall:
    """A card at x < 0 before a wall at x < 0.5, in slopes from the origin, seen along −z."""

    def __init__(self):
        self.rays = 0

    def cast(self, origins, directions):
        self.rays += len(origins)
        slope = directions[:, 0] / -directions[:, 2]
        met = np.select([slope < 0.0, slope < 0.5], [CARD, WALL], SKY)
        ahead = np.select([met == CARD, met == WALL], [CARD_AT, WALL_AT], np.inf)
        return ahead / -directions[:, 2], met


def _view(near=1e-3):
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 1.0, WIDTH / HEIGHT
    frame = (0, 0, WIDTH, HEIGHT)
    return RadianceView(np.zeros(3), np.eye(4), projection, (WIDTH, HEIGHT), frame, frame, near)


def _sketch():
    normals = np.tile((0.0, 0.0, 1.0), (2, 1))
    things = Things(np.zeros((0, 3)), np.zeros((0, 3), int), np.array([CARD, WALL]), (), ())
    return Sketch(_view(), things, normals, CardBeforeWall())


def _hits(kind, count=4000):
    """Pixels, triangles and lengths of hits of one kind all over the picture, seen or not."""
    pixels = np.random.default_rng(1).uniform((0.5, 0.5), (WIDTH - 0.5, HEIGHT - 0.5), (count, 2))
    directions = _view().rays(pixels)[1]
    ahead = {CARD: CARD_AT, WALL: WALL_AT, SKY: np.inf}[kind]
    return pixels, np.full(count, kind), ahead / -directions[:, 2] - _view().near


@pytest.mark.parametrize("kind", [CARD, WALL, SKY])
def test_middles_tell_what_rays_to_the_hits_tell(kind):
    sketch = _sketch()
    pixels, triangle, length = _hits(kind)
    shown, hidden = sketch.shows(pixels, triangle, length)
    _, met = CardBeforeWall().cast(*_view().rays(pixels))
    # A thing that is met where nothing of it is, as the card beside itself, does not occur.
    seen = met == kind
    before = (met == CARD) | ((met == WALL) & (kind == SKY))
    assert not (shown & ~seen).any() and not (hidden & ~before).any()
    # Only beside the two silhouettes they do not tell.
    slope = pixels[:, 0] / WIDTH * 2.0 - 1.0
    off = np.minimum(np.abs(slope), np.abs(slope - 0.5)) * WIDTH / 2.0 > 1.0
    assert off.mean() > 0.9
    assert (shown | hidden | ~before & ~seen)[off].all()
    assert np.array_equal(shown[off], seen[off])


def test_each_middle_is_cast_once():
    sketch = _sketch()
    for _ in range(3):
        sketch.shows(*_hits(WALL, 20_000))
    assert sketch._caster.rays <= (WIDTH + 1) * (HEIGHT + 1)


def _moved(place, size=0.05):
    low = np.array(place) - 0.5 * size
    axes, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    corners = np.stack(np.meshgrid(*np.stack((low, low + size)).T), axis=-1).reshape(-1, 3) @ axes.T
    return Boxes(axes, np.array([(corners.min(axis=0), corners.max(axis=0))]))


@pytest.mark.parametrize(
    "place, most", [((0.2, 0.1, -0.9), 0.1), ((0.2, 0.1, 0.9), 0.0), ((0.0, 0.0, 0.0), 1.0)]
)
def test_only_middles_are_forgotten_that_may_meet_what_moved(place, most):
    """Before the view, behind it, and round its eye, where all of them are."""
    sketch = _sketch()
    sketch.look(np.ones(sketch.triangle.shape, bool))
    boxes = _moved(place)
    assert sketch.still(boxes, np.arange(2), 0.0) == (most < 1.0)
    lost = sketch.triangle == UNKNOWN
    assert lost.mean() <= most
    y, x = np.indices(lost.shape).reshape(2, -1)
    origins, directions = _view().rays(np.stack((x, y), axis=1) + sketch.origin + 0.5)
    met = boxes.touched(0.0, origins, origins + 10.0 * directions)
    assert lost.ravel()[met].all() and met.any() == (most > 0.0)


def test_triangles_get_their_new_numbers():
    sketch = _sketch()
    sketch.look(np.ones(sketch.triangle.shape, bool))
    before = sketch.triangle.copy()
    sketch.still(Boxes(np.eye(3), np.zeros((0, 2, 3))), np.array([7, 4]), 0.0)
    for old, new in ((CARD, 7), (WALL, 4), (SKY, SKY)):
        assert ((sketch.triangle == new) == (before == old)).all()


def test_few_hits_have_rays_of_their_own_and_still_views_are_not_cast_again(monkeypatch):
    scenes.camera()
    scenes.striped_wall(0.4, stripes=6)
    scene = scenes.settings(160, 120, samples=1, shading="TRUE", surface="GLASS")
    scenes.glass(shape="SPHERE", radius=0.06, wall_thickness=0.002, location=(0.0, 0.0, 0.08))
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0.03, 0.15, 0.09))
    cube = bpy.context.active_object
    counted, within = Counter(), []

    def watched(name, function):
        def call(self, *arguments):
            within.append(name)
            if name == "shows":
                counted["hits"] += len(arguments[-1])
            try:
                return function(self, *arguments)
            finally:
                within.pop()

        return call

    def cast(self, origins, directions, cast=caster.Caster.cast):
        counted[within[-1] if within else ""] += len(origins)
        return cast(self, origins, directions)

    monkeypatch.setattr(caster.Caster, "cast", cast)
    for owner, name in ((hits.Scene, "shows"), (sketches.Sketch, "look")):
        monkeypatch.setattr(owner, name, watched(name, getattr(owner, name)))
    found = []
    for step in (0.0, 0.002, 0.0):
        cube.delta_location.x += step
        door.prepare(scene, scene_depsgraph(scene), strict=True)
        counted.clear()
        depsgraph = scene_depsgraph(scene)
        true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
        found.append(dict(counted))
    first, moved, still = found
    assert 0 < first["shows"] < 0.2 * first["hits"]
    assert 0 < moved["look"] < 0.5 * first["look"]
    assert still.get("look", 0) == 0
