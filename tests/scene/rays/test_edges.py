# SPDX-License-Identifier: GPL-3.0-or-later
"""Lookups beside silhouettes: moved to what they look for, and no farther than they must."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from glass_refraction.scene.rays.edges import off_edges
from glass_refraction.scene.rays.hits import KNOWN
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.sketches import Sketch
from glass_refraction.scene.rays.things import Things
from glass_refraction.scene.rays.views import RadianceView

WIDTH, HEIGHT = 64, 48
CARD, WALL = 0, 1
CARD_AT, WALL_AT = 1.0, 3.0
SLANT = 0.3
"""Of the card's border: x = SLANT · y in slopes."""


class Card:
    """A card before a wall, seen along −z from the origin; it covers all left of a slanted line."""

    def __init__(self, wall=WALL_AT, width=np.inf):
        self.wall, self.width = wall, width

    def cast(self, origins, directions):
        slope = directions[:, :2] / -directions[:, 2:]
        x = slope[:, 0] - SLANT * slope[:, 1]
        on = (x < 0.0) & (x > -self.width)
        return np.where(on, CARD_AT, self.wall) / -directions[:, 2], np.where(on, CARD, WALL)


def _scene(caster, looks=(), surfaces=(CARD, WALL)):
    normals = np.tile((0.0, 0.0, 1.0), (2, 1))
    things = Things(np.zeros((0, 3)), np.zeros((0, 3), int), np.array(surfaces), looks, ())
    return SimpleNamespace(things=things, sketch=lambda view: Sketch(view, things, normals, caster))


def _view():
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2.0, 2.0 * WIDTH / HEIGHT
    frame = (0, 0, WIDTH, HEIGHT)
    return RadianceView(np.zeros(3), np.eye(4), projection, (WIDTH, HEIGHT), frame, frame, 1e-3)


def _lookups(count=20_000, seed=0):
    random = np.random.default_rng(seed)
    return random.uniform((2.0, 2.0), (WIDTH - 2.0, HEIGHT - 2.0), (count, 2))


def _moved(caster, pixels, triangle, view=0, looks=()):
    moved = pixels.copy()
    off_edges(_scene(caster, looks), [_view()], np.full(len(pixels), view), moved, triangle)
    return moved


def _from_border(pixels):
    """Pixels (K,) along x from the card's border."""
    ndc = 2.0 * pixels / (WIDTH, HEIGHT) - 1.0
    slope = ndc / (2.0, 2.0 * WIDTH / HEIGHT)
    return (slope[:, 0] - SLANT * slope[:, 1]) * WIDTH


def _met(caster, pixels):
    return caster.cast(*_view().rays(np.floor(pixels) + 0.5))[1]


@pytest.mark.parametrize("wanted", [CARD, WALL])
def test_what_is_looked_for_fills_the_pixels_middle(wanted):
    pixels = _lookups()
    # Seen is what lies on its side of the border, if the pixel's middle does or not.
    away = _from_border(pixels) * (1.0 if wanted == WALL else -1.0)
    pixels = pixels[away > 0.0]
    caster = Card()
    assert (_met(caster, pixels) != wanted).sum() > 20
    found = _moved(caster, pixels, np.full(len(pixels), wanted))
    assert (_met(caster, found) == wanted).all()
    assert np.abs(found - pixels).max() < 2.0


@pytest.mark.parametrize("wanted", [CARD, WALL])
def test_lookups_away_from_silhouettes_stay_to_the_bit(wanted):
    pixels = _lookups()
    away = _from_border(pixels) * (1.0 if wanted == WALL else -1.0)
    pixels = pixels[away > 1.5]
    assert len(pixels) > 500
    assert np.array_equal(_moved(Card(), pixels, np.full(len(pixels), wanted)), pixels)


def test_none_lies_between_a_pixels_middle_and_a_border_beside_it():
    pixels = _lookups()
    triangle = _met(Card(), pixels)
    found = _moved(Card(), pixels, triangle)
    at = np.floor(found)
    middle, right = _met(Card(), at), _met(Card(), at + np.array((1.0, 0.0)))
    beside = (middle == CARD) & (right == WALL)
    assert beside.sum() > 20
    assert (found[beside, 0] <= at[beside, 0] + 0.5).all()
    # It is moved no farther than there.
    assert (np.abs(found - pixels).max(axis=1) <= 0.5).all()


def test_surfaces_that_touch_are_left_as_they_are():
    """What a surface shows close to its border is there to be seen."""
    pixels = _lookups()
    touching = Card(wall=CARD_AT)
    assert np.array_equal(_moved(touching, pixels, _met(touching, pixels)), pixels)


def test_beside_what_shines_one_pixel_more_is_kept_off():
    """The pixel filter takes light into the pixels beside a lamp: a ring stood in the glass."""
    pixels = _lookups()
    pixels = pixels[_from_border(pixels) > 0.0]
    wanted = np.full(len(pixels), WALL)
    lit = _moved(Card(), pixels, wanted, looks=(Look(radiance=(9.0, 0.0, 0.0)), Look()))
    beside = product((-1.0, 0.0, 1.0), repeat=2)
    assert all((_met(Card(), lit + step) == WALL).all() for step in beside)
    assert np.abs(lit - pixels).max() < 3.0
    dim = _moved(Card(), pixels, wanted, looks=(Look(radiance=(0.9, 0.0, 0.0)), Look()))
    assert np.array_equal(dim, _moved(Card(), pixels, wanted))
    far = _from_border(pixels) > 3.5
    assert np.array_equal(lit[far], pixels[far])


def test_what_shines_is_looked_up_where_it_fills_the_pixel():
    pixels = _lookups()
    pixels = pixels[_from_border(pixels) < 0.0]
    looks = (Look(radiance=(9.0, 0.0, 0.0)), Look())
    lit = _moved(Card(), pixels, np.full(len(pixels), CARD), looks=looks)
    beside = product((-1.0, 0.0, 1.0), repeat=2)
    assert all((_met(Card(), np.floor(lit) + step) == CARD).all() for step in beside)
    assert np.abs(lit - pixels).max() < 3.0


def test_what_shines_may_be_all_there_is():
    """What nobody has looked at was taken for a surface before the first one: IndexError."""
    pixels = _lookups(5)
    scene = _scene(Card(), (Look(radiance=(9.0, 0.0, 0.0)),), (CARD, CARD))
    moved = pixels.copy()
    off_edges(scene, [_view()], np.zeros(5, int), moved, np.full(5, CARD))
    assert np.array_equal(moved, pixels)


def test_what_is_too_thin_for_a_pixel_stays_where_it_is():
    thin = Card(width=0.02 / WIDTH)
    pixels = _lookups()
    pixels = pixels[np.abs(_from_border(pixels)) < 1.0]
    found = _moved(thin, pixels, np.full(len(pixels), CARD))
    hit = (_met(thin, found) == CARD) | (found == pixels).all(axis=1)
    assert hit.all()
    assert (found == pixels).all(axis=1).sum() > 20


def test_what_no_view_shows_is_not_looked_for():
    pixels = _lookups(100)
    caster = SimpleNamespace(cast=None)
    assert np.array_equal(_moved(caster, pixels, np.zeros(100, int), view=KNOWN), pixels)
