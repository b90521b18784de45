# SPDX-License-Identifier: GPL-3.0-or-later
"""Glasses as floats for the shader: what is written down is what ``optics`` describes."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.viewport import description
from glass_refraction.viewport.description import (
    CYLINDER,
    GLASS_ROWS,
    INTERFACE_ROWS,
    LID,
    PLANE,
    PROFILE,
    ROWS,
    SHELL,
    SIDE,
    SIDE_BUNCH,
    Posed,
    TooMuch,
    common_frame,
    pack,
)

OUTLINE = [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]
BOWL = [(0.0, 0.0), (0.03, 0.004), (0.042, 0.05), (0.035, 0.09)]
INSIDE = [(0.0, 0.006), (0.026, 0.01), (0.038, 0.05), (0.033, 0.09)]
GLASSES = {
    "slab": optics.FlatGlass((0.01, 0.02), (1.5, 1.7), outline=OUTLINE),
    "tank": optics.FlatGlass((0.01,), (1.5,), ior_below=1.333, outline=OUTLINE),
    "cylinder": optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.0, 0.12)),
    "rod": optics.CylinderGlass((0.02,), (1.5,), extent=(0.0, 0.1)),
    "bowl": optics.SphereGlass((0.15, 0.147), (1.5, 1.333)),
    "tumbler": optics.Tumbler(0.04, 0.003, 0.1, 0.008, 1.5, 1.333, 0.06),
    "revolution": optics.RevolutionGlass(BOWL, INSIDE, 1.5, 1.333, 0.05),
}
KINDS = {
    "Cylinder": CYLINDER,
    "Plane": PLANE,
    "Lid": LID,
    "Side": SIDE,
    "Shell": SHELL,
    "Profile": PROFILE,
}


def posed(glass, place=(0.0, 0.0, 0.0), **more):
    matrix = np.eye(4)
    turn, _ = np.linalg.qr([(1.0, 0.3, -0.2), (0.1, 0.4, 0.9), (-0.3, 1.0, 0.5)])
    matrix[:3, :3] = turn * np.sign(np.linalg.det(turn))
    matrix[:3, 3] = place
    return Posed(optics.body(glass), matrix, **more)


@pytest.mark.parametrize("name", GLASSES)
def test_interfaces_and_media_are_those_of_optics(name):
    glass = posed(GLASSES[name])
    block = pack([glass], common_frame([glass]))
    assert block.shape == (ROWS, 4)
    assert block.dtype == np.float32
    first, count, media, _ = block[1].astype(int)
    assert count == len(glass.body.interfaces)
    for number, interface in enumerate(glass.body.interfaces):
        kind, front, back, is_end = block[first + INTERFACE_ROWS * number]
        assert kind == KINDS[type(interface.surface).__name__]
        assert (front, back) == (interface.front, interface.back)
        assert bool(is_end) == (number in glass.body.ends)
    iors = block[media : media + 2 * len(glass.body.media) : 2, 0]
    assert iors == pytest.approx(glass.body.media, rel=1e-6)


def test_the_frames_lead_there_and_back_wherever_the_glasses_are():
    far = np.array((5000.0, -3000.0, 20.0))
    near = far + np.array((0.3, 0.1, 0.0))
    glasses = [posed(GLASSES["rod"], far), posed(GLASSES["bowl"], near)]
    frame = common_frame(glasses)
    block = pack(glasses, frame).astype(float)
    for number, glass in enumerate(glasses):
        record = block[1 + GLASS_ROWS * number :]
        inward, outward = record[2:5], record[5:8]
        local = np.random.default_rng(number).uniform(-1.0, 1.0, (50, 3))
        common = local @ outward[:, :3].T + outward[:, 3]
        assert np.abs(common).max() < 10.0
        assert common @ inward[:, :3].T + inward[:, 3] == pytest.approx(local, abs=1e-5)
        world = local * glass.body.scale @ glass.to_world[:3, :3].T + glass.to_world[:3, 3]
        assert frame.place(world) == pytest.approx(common, abs=1e-5)
    assert frame.reach < 10.0


@pytest.mark.parametrize("name", GLASSES)
def test_the_box_of_a_glass_holds_it_with_some_room(name):
    glass = posed(GLASSES[name])
    record = pack([glass], common_frame([glass]))[1 : 1 + GLASS_ROWS]
    middle, half = record[1, :3], record[10, :3]
    low, high = glass.body.box / glass.body.scale
    assert (middle - half < low).all()
    assert (middle + half > high).all()
    assert 2.0 * half == pytest.approx(high - low, abs=0.005 * record[1, 3])


def test_every_chord_lies_on_the_curve_and_within_its_bunch():
    glass = posed(GLASSES["revolution"])
    block = pack([glass], common_frame([glass])).astype(float)
    first = int(block[1, 0])
    seen = 0
    for number, interface in enumerate(glass.body.interfaces):
        at = first + INTERFACE_ROWS * number
        if block[at, 0] != PROFILE:
            continue
        bunches, count = int(block[at + 2, 0]), int(block[at + 2, 1])
        for bunch in range(count):
            low, high, widest, chord = block[bunches + 2 * bunch]
            for k in range(int(block[bunches + 2 * bunch + 1, 0])):
                r0, z0, dr, dz = block[int(chord) + 2 * k]
                t0, dt, length, _ = block[int(chord) + 2 * k + 1]
                ends = np.array([(r0, z0), (r0 + dr * length, z0 + dz * length)])
                r, z, *_ = interface.surface.on_curve(np.array([t0, t0 + dt]))
                assert ends == pytest.approx(np.column_stack((r, z)), abs=1e-5)
                assert ends[:, 0].max() <= widest + 1e-6
                assert low - 1e-6 <= ends[:, 1].min() <= ends[:, 1].max() <= high + 1e-6
                seen += 1
    assert seen > 50


@pytest.mark.parametrize("shape", ["square", "star", "crescent"])
def test_rays_in_the_circle_of_an_outline_meet_no_side(shape):
    corner = np.arange(10)
    turn = corner * np.pi / 5.0
    outline = {
        "square": np.add(OUTLINE, (0.3, -0.2)),
        "star": np.stack((np.cos(turn), np.sin(turn)), axis=1) / (1.0 + corner % 2)[:, None],
        # The middle of its box lies outside.
        "crescent": np.array([(0, 0), (3, 0), (3, 3), (2.9, 0.1), (0.1, 0.1)]),
    }[shape]
    glass = posed(optics.FlatGlass((0.01,), (1.5,), outline=outline))
    block = pack([glass], common_frame([glass])).astype(float)
    lid, middle = int(block[1, 0]), block[2, :2]
    assert block[lid, 0] == LID
    circle = np.linspace(0.0, 2.0 * np.pi, 2_000)
    around = np.stack((np.cos(circle), np.sin(circle)))
    holds = glass.body.interfaces[0].surface.outline.holds
    radius = np.sqrt(block[lid + 1, 3])
    assert (radius == 0.0) == (shape == "crescent")
    assert radius == 0.0 or holds(*(middle[:, None] + 0.999 * radius * around)).all()
    assert not holds(*(middle[:, None] + 1.001 * radius * around)).all()


@pytest.mark.parametrize("corners", [5, 16, 45])
def test_sides_lie_in_the_circle_of_their_bunch(corners):
    turn = 2.0 * np.pi * np.arange(corners) / corners
    outline = (
        np.stack((np.cos(turn), 0.6 * np.sin(turn)), axis=1)
        / (1.0 + np.arange(corners) % 2)[:, None]
    )
    glass = posed(optics.FlatGlass((0.01, 0.02), (1.5, 1.7), outline=outline))
    block = pack([glass], common_frame([glass])).astype(float)
    first, count = block[1, :2].astype(int)
    rows = block[first : first + INTERFACE_ROWS * count].reshape(count, INTERFACE_ROWS, 4)
    sides = rows[rows[:, 0, 0] == SIDE]
    assert np.array_equal(rows[-len(sides) :], sides)
    for number, side in enumerate(sides):
        head = number - number % SIDE_BUNCH
        room = sides[head, 2, 3]
        assert (room > 0.0) == (head + SIDE_BUNCH <= len(sides))
        if room > 0.0:
            middle = sides[head + SIDE_BUNCH // 2, 1, :2]
            for end in (side[1, :2], side[1, :2] + side[2, 0] * side[1, 2:]):
                assert np.linalg.norm(end - middle) < np.sqrt(room)


def test_more_than_fits_is_told_and_nothing_is_cut():
    glass = posed(optics.FlatGlass((0.01,), (1.5,), outline=_round(600)))
    two = [glass, glass]
    assert pack(two[:1], common_frame(two)).any()
    with pytest.raises(TooMuch):
        pack(two, common_frame(two))


def test_boxes_of_things_are_told_only_if_they_hold_all():
    glass = posed(GLASSES["slab"])
    frame = common_frame([glass])
    place = np.eye(4)
    place[:3, 3] = (-1.0, -2.0, -3.0)
    first, count = pack([glass], frame, [np.eye(4), place])[0, 2:].astype(int)
    block = pack([glass], frame, [np.eye(4), place])
    assert count == 2
    # The middle of the second box, in its own frame.
    middle = np.append(frame.place(np.array((1.0, 2.0, 3.0))), 1.0)
    second = block[first + description.THING_ROWS :][: description.THING_ROWS]
    assert second @ middle == pytest.approx(np.zeros(3), abs=1e-5)
    assert pack([glass], frame, [])[0, 3] == 0
    # Anything may be anywhere: nothing is known, or more than there is room for.
    many = [np.eye(4)] * description.ROWS
    for boxes in (None, many):
        assert pack([glass], frame, boxes)[0, 3] == description.UNKNOWN_BOXES


def _round(count):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def test_absorption_is_by_the_glasss_own_unit_of_length():
    glass = posed(GLASSES["tumbler"], absorption=((0, 0, 0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))
    block = pack([glass], common_frame([glass]))
    media = int(block[1, 2])
    assert block[media + 3, :3] == pytest.approx(np.array((1.0, 2.0, 3.0)) * 0.04)
    assert block[media + 5, :3] == pytest.approx(np.array((4.0, 5.0, 6.0)) * 0.04)


def test_where_things_may_stand():
    hollow = description.HOLLOW
    for name, expected in {
        "slab": {0},
        "tank": {0, 2},
        "cylinder": {0},
        "rod": {0},
        "bowl": {0, 2},
        "tumbler": {0, 2},
    }.items():
        glass = posed(GLASSES[name])
        block = pack([glass], common_frame([glass]))
        media = int(block[1, 2])
        flags = block[media : media + 2 * len(glass.body.media) : 2, 1].astype(int)
        assert {k for k, flag in enumerate(flags) if flag & hollow} == expected, name
