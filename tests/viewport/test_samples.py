# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the samples of a pixel lie, and how a view tells that its engine changed the picture."""

from types import SimpleNamespace

import bpy  # noqa: F401 - finds the module gpu, which paint imports
import numpy as np
import pytest

from glass_refraction.viewport import paint, views


def test_samples_lie_evenly_in_the_pixel():
    places = np.array([views._jitter(number) for number in range(1 + sum(views.ROUNDS))])
    assert np.abs(places).max() < 0.5
    for axis in range(2):
        # In as many rows and columns there is one each.
        assert np.diff(np.sort(places[:, axis])) == pytest.approx(1.0 / len(places))
    for count in np.cumsum((1, *views.ROUNDS)):
        assert places[:count].mean(axis=0) == pytest.approx((0.0, 0.0), abs=1e-12)
    # Of three colours in turn each has two further samples.
    assert places[1:4] + places[4:7] == pytest.approx(0.0, abs=1e-12)
    # An edge along a row or a column is seen by the first round already.
    assert (np.ptp(places[: 1 + views.ROUNDS[0]], axis=0) > 0.5).all()


@pytest.mark.parametrize("listed", [None, "some"])
def test_colours_that_part_have_as_many_samples_each(listed):
    """A whole sample is of all colours, and each of listed pixels of one; their parts are told."""
    blocks = [(None, name) for name in ("mean", "red", "green", "blue")]
    painter = SimpleNamespace(colours=3, _blocks=blocks)
    (rounds,) = views._rounds(painter)
    samples = 1 if listed is None else rounds
    drawn = []
    for number in range(samples):
        painter._drawn = SimpleNamespace(listed=listed, samples=number)
        drawn += paint.Painter._passes(painter, True)
    parts = dict.fromkeys(("red", "green", "blue"), 0.0)
    for number, (name, band) in enumerate(drawn):
        assert band[:3] == tuple(np.eye(3)[number % 3])
        parts[name] += band[3]
    counted = 1.0 if listed is None else rounds / 3
    assert sum(parts.values()) == pytest.approx(counted)
    assert len(set(parts.values())) == 1


@pytest.mark.parametrize("count", [1, 16, 1000, 12345])
def test_listed_pixels_lie_side_by_side(count):
    column, row = paint._in_list(count)
    assert column.max() < paint.LISTED
    assert len(set(zip(column.tolist(), row.tolist(), strict=True))) == count
    # In whole blocks, of which all but the last is full.
    blocks = set(zip((column // paint.BLOCK).tolist(), (row // paint.BLOCK).tolist(), strict=True))
    assert len(blocks) == -(-count // paint.BLOCK**2)


@pytest.mark.parametrize("pixels", [1, 5_000, 323_186])
@pytest.mark.parametrize("speed", [1e4, 3e5, 1e8])
@pytest.mark.parametrize("colours", [1, 3])
@pytest.mark.parametrize("share", [views.SHARE_OF_REDRAW, views.SHARE_OF_ENGINE])
def test_a_moving_picture_is_as_fine_as_it_can_be_in_its_time(pixels, speed, colours, share):
    painter = SimpleNamespace(pixels=pixels)
    is_open = share == views.SHARE_OF_REDRAW
    view = SimpleNamespace(speed=speed, plain_seconds=0.1, painter=painter, is_open=is_open)
    divisor = views._divisor(view, colours)
    affordable = share * 0.1 * speed / colours
    assert 1.0 <= divisor <= views.MOST_PIXELS
    if divisor < views.MOST_PIXELS:
        assert pixels / divisor**2 <= affordable
    if divisor > 1.0:
        assert pixels / (divisor - views.PIXELS_STEP) ** 2 > affordable


@pytest.mark.parametrize("divisor", [1.0, 1.25, 2.0, 3.75, 6.0])
@pytest.mark.parametrize("rect", [(-1.0, -1.0, 1.0, 1.0), (-0.31, 0.2, 0.67, 0.93)])
def test_samples_cover_the_part_of_the_view_that_they_are_of(divisor, rect):
    view = np.array((1048, 693))
    size = np.ceil(view / divisor)
    painter = SimpleNamespace(
        _drawn=SimpleNamespace(divisor=divisor, size=tuple(size)),
        _view=SimpleNamespace(size=tuple(view)),
    )
    found = np.array(paint.Painter._in_layer(painter, rect)).reshape(2, 2)
    seen = 0.5 * (found + 1.0) * size * divisor
    wanted = np.minimum(0.5 * (np.array(rect).reshape(2, 2) + 1.0) * view, size * divisor)
    spare = np.stack((wanted[0] - seen[0], seen[1] - wanted[1]))
    assert (spare > -1e-6).all() and (spare < divisor + 1e-6).all()


@pytest.mark.parametrize("pixels", [1, 300, 5_000])
@pytest.mark.parametrize("rect", [(-1.0, -1.0, 1.0, 1.0), (-0.31, 0.2, 0.67, 0.93)])
def test_strips_draw_each_pixel_once_and_end_between_blocks(pixels, rect):
    size = np.array((148, 93))
    painter = paint.Painter.__new__(paint.Painter)
    painter._drawn, painter._strips = SimpleNamespace(size=tuple(size)), [rect]
    middles = [(np.arange(n) + 0.5) * 2.0 / n - 1.0 for n in size]
    drawn = np.zeros(size, int)
    while painter._strips:
        strip = painter._take(pixels)
        x, y = ((m > strip[k]) & (m < strip[k + 2]) for k, m in enumerate(middles))
        drawn += x[:, None] & y
        for place, count in zip(strip, (*size, *size), strict=True):
            blocks = 0.5 * (place + 1.0) * count / paint.BLOCK
            assert place in rect or blocks == pytest.approx(round(blocks))
        # The first and the last block of a row or column may be a part of one.
        assert x.sum() * y.sum() <= max(2 * pixels, (2 * paint.BLOCK) ** 2)
    x, y = ((m > rect[k]) & (m < rect[k + 2]) for k, m in enumerate(middles))
    assert (drawn == (x[:, None] & y)).all()


def test_textures_have_no_size_that_is_a_power_of_two():
    for size in range(1, 1030):
        found = paint.odd_size(size)
        assert found >= size and found & (found - 1)


class _Shown:
    """A frame buffer that can be read."""

    def __init__(self, pixels):
        self.pixels, self.read = pixels, 0

    def read_color(self, x, y, width, height, channels, slot, kind):
        assert (channels, slot, kind) == (4, 0, "FLOAT")
        self.read += width * height
        return self.pixels[y : y + height, x : x + width].copy()


@pytest.mark.parametrize("size", [(64, 48), (200, 690), (5, 9)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_glance_sees_what_is_longer_than_the_gaps_between_its_lines(size, axis):
    width, height = size
    direct = paint.Direct()
    shown = _Shown(np.zeros((height, width, 4), np.float32))
    assert direct.glance(shown, size)
    assert not direct.glance(shown, size)
    long, across = (height, width) if axis == 0 else (width, height)
    gap = int(np.ceil(long / min(long, paint.GLANCED)))
    for begin in range(long - gap + 1):
        there = (slice(begin, begin + gap), begin % across)
        shown.pixels[there if axis == 0 else there[::-1]] += 1.0
        assert direct.glance(shown, size)
    assert not direct.glance(shown, size)


def test_a_glance_reads_a_small_part():
    size = (1000, 700)
    shown = _Shown(np.zeros((700, 1000, 4), np.float32))
    paint.Direct().glance(shown, size)
    assert shown.read < 0.03 * 1000 * 700


def test_captures_of_another_engine_are_drawn_anew():
    """Cycles draws nothing off-screen: what it left stayed, black, in EEVEE's captures."""
    rendered = SimpleNamespace(shading=SimpleNamespace(type="RENDERED"))
    solid = SimpleNamespace(shading=SimpleNamespace(type="SOLID"))
    engines = "CYCLES", "BLENDER_EEVEE"
    assert len({views._looks(rendered, engine) for engine in engines}) == 2
    assert len({views._looks(solid, engine) for engine in engines}) == 1


@pytest.mark.parametrize("is_playing", [False, True])
def test_what_is_evaluated_anew_has_the_engine_begin_anew(monkeypatch, is_playing):
    """Though nothing that is seen moved: its picture was read before its last sample."""
    generations = iter((1, 1, 2, 2))
    monkeypatch.setattr(views, "generation", lambda scene: next(generations))
    monkeypatch.setattr(views, "is_compiling", lambda: False)
    space = SimpleNamespace(local_view=None)
    scene = SimpleNamespace(session_uid=7, refractive_glass=SimpleNamespace(shading="TRUE"))
    screen = SimpleNamespace(is_animation_playing=is_playing)
    context = SimpleNamespace(space_data=space, scene=scene, view_layer=None, screen=screen)
    view = views._View()
    view.model.read = lambda layer, space, told, anew: False
    found = []
    for _ in range(4):
        views._read_glasses(view, context, None)
        # As `_draw` counts a redraw in which nothing moved.
        view.refinements += 1
        found.append(view.refinements)
    assert found == [1, 2, 1, 2]
