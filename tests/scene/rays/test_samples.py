# SPDX-License-Identifier: GPL-3.0-or-later
"""Packed samples: looked up and added in pairs, they are the plain sum of each pixel's samples."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene.rays.radiance import NO_LIMIT
from glass_refraction.scene.rays.samples import (
    EARLY,
    LEVELS,
    MOST,
    WIDTH,
    PackedPixels,
    pack,
    strongest,
)
from glass_refraction.scene.rays.sum_tree import (
    Pictures,
    SumTree,
    sharpening_factors,
)
from glass_refraction.scene.read.viewpoint import render_size


def map_uv(picture, where):
    """What the compositor's Map UV finds: nearest pixels, extended at the border; 0 by alpha 0."""
    height, width = picture.shape[:2]
    x = np.clip(np.floor(where[..., 0].astype(float) * width), 0, width - 1).astype(int)
    y = np.clip(np.floor(where[..., 1].astype(float) * height), 0, height - 1).astype(int)
    return picture[y, x] * where[..., 2:3]


def summed(packed, looked_up, spread):
    """Follow the compositor's way through the pictures of one view: (height, width, 3) float32."""
    found = looked_up * packed.colour[..., :3]
    for level, (first, second) in enumerate(packed.pairs):
        if level == EARLY:
            done = map_uv(found, packed.into[0])
        found = map_uv(found, first) + map_uv(found, second)
    rest = map_uv(found, packed.into[1])
    if rest.shape != done.shape:
        # Blender takes what lies beyond a picture's border for nothing.
        assert len(rest) == 1 and not rest.any()
        rest = 0.0
    return map_uv(done + rest, spread)


def _samples(random, most, pixels=300, size=(40, 30)):
    """Samples of some of the picture's pixels; values are whole numbers, whose sums are exact."""
    chosen = np.sort(random.choice(size[0] * size[1], pixels, replace=False))
    count = random.integers(1, most + 1, pixels)
    count[0], count[-1] = most, most
    pixel = np.repeat(chosen, count)
    colour = random.integers(0, 8, (len(pixel), 3)).astype(float)
    uv = random.uniform(0, 1, (len(pixel), 2))
    return chosen, pixel, uv, colour


@pytest.mark.parametrize("most", [1, 2, 3, 16, 25, MOST - 1, MOST])
def test_the_pictures_add_up_each_pixels_samples_exactly(most):
    random = np.random.default_rng(most)
    size = (40, 30)
    pixels, pixel, uv, colour = _samples(random, most, 1200 if most < 4 else 40, size)
    everywhere = PackedPixels(np.unique(np.concatenate((pixels, [0, 1199]))))
    packed = pack(everywhere, pixel, uv, colour, np.ones(len(pixel)))
    assert len(packed.pairs) == LEVELS
    # What each sample finds in its view: another whole number.
    looked_up = np.zeros((*packed.where.shape[:2], 3), np.float32)
    value = random.integers(0, 8, (len(pixel), 3))
    looked_up.reshape(-1, 3)[: len(pixel)] = value
    expected = np.zeros((size[0] * size[1], 3))
    np.add.at(expected, pixel, colour * value)
    found = summed(packed, looked_up, everywhere.spread(np.ones(size[::-1])))
    np.testing.assert_array_equal(found.reshape(-1, 3), expected)


def test_places_of_samples_stand_in_the_picture_one_after_another():
    random = np.random.default_rng(0)
    pixels, pixel, uv, colour = _samples(random, 25)
    packed = pack(PackedPixels(pixels), pixel, uv, colour, np.ones(len(pixel)))
    where = packed.where.reshape(-1, 4)[: len(pixel)]
    np.testing.assert_array_equal(where[:, :2], uv.astype(np.float32))
    np.testing.assert_array_equal(where[:, 2], 1.0)
    assert not packed.where.reshape(-1, 4)[len(pixel) :, :3].any()
    assert packed.where.shape[1] == WIDTH


def test_a_view_without_samples_adds_nothing():
    everywhere = PackedPixels(np.array([3, 5]))
    packed = pack(everywhere, np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))
    looked_up = np.full((*packed.where.shape[:2], 3), 7.0)
    assert not summed(packed, looked_up, everywhere.spread(np.ones((2, 4)))).any()
    nowhere = PackedPixels(np.zeros(0, int))
    packed = pack(nowhere, np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))
    assert not summed(packed, looked_up, nowhere.spread(np.ones((2, 4)))).any()
    assert not nowhere.known(np.zeros((0, 3)), np.zeros(0, int))[..., :3].any()


def test_what_is_known_adds_up_in_its_pixel():
    random = np.random.default_rng(1)
    pixels, pixel, _, colour = _samples(random, 9)
    pixel, colour = pixel[::-1], colour[::-1]
    everywhere = PackedPixels(pixels)
    known = everywhere.known(colour, pixel)[..., :3]
    expected = np.zeros((1200, 3))
    np.add.at(expected, pixel, colour)
    found = map_uv(known, everywhere.spread(np.ones((30, 40))))
    np.testing.assert_array_equal(found.reshape(-1, 3), expected)


def test_the_strongest_samples_are_kept_where_there_are_too_many():
    random = np.random.default_rng(2)
    pixel = np.repeat((4, 9, 12), (MOST + 40, 5, MOST))
    weight = random.uniform(0, 1, len(pixel))
    keep = strongest(pixel, weight)
    assert keep[pixel == 9].all()
    assert keep[pixel == 12].all()
    some = weight[pixel == 4]
    assert keep[pixel == 4].sum() == MOST
    assert some[keep[pixel == 4]].min() > some[~keep[pixel == 4]].max()
    assert strongest(np.zeros(0, int), np.zeros(0)).shape == (0,)


def blurred(picture):
    """What a cubic B-spline finds at the pixels' centres, the border continued."""
    for axis in range(2):
        wide = np.pad(picture, [(1, 1) if axis == k else (0, 0) for k in range(2)], mode="edge")
        parts = (wide.take(np.arange(k, k + picture.shape[axis]), axis=axis) for k in range(3))
        picture = sum(
            weight * part for weight, part in zip((1 / 6, 2 / 3, 1 / 6), parts, strict=True)
        )
    return picture


def sharpened(picture):
    """What the compositor's steps make of a picture."""
    found = picture
    for factor in sharpening_factors():
        found = found + factor * (picture - blurred(found))
    return found


@pytest.mark.parametrize("period", [2, 3, 4, 7, 20, 60])
def test_a_spline_of_a_sharpened_picture_goes_through_lines_of_any_width(period):
    lines = np.tile(np.cos(2.0 * np.pi * np.arange(240) / period), (12, 1))
    for picture in (lines, lines.T):
        left = (blurred(sharpened(picture)) - picture)[8:-8, 8:-8]
        assert np.abs(left).max(initial=0.0) < 0.012
    # And noise becomes no louder than an exact inverse would make it.
    board = (-1.0) ** np.add.outer(np.arange(60), np.arange(60))
    assert 1.0 < np.abs(sharpened(board)[9:-9, 9:-9]).max() < 9.0


def test_a_white_picture_stays_white_up_to_its_border():
    for size in ((40, 30), (5, 60), (1, 1)):
        np.testing.assert_allclose(sharpened(np.ones(size)), 1.0, atol=1e-12)


def _composited(scene, tmp_path, fill, alpha=False, white=1.0):
    """Render a scene whose compositor has the sum tree of no captures; ``fill`` writes pictures."""
    tree = SumTree(scene, [], alpha=alpha).tree
    outer = bpy.data.node_groups.new("Mine", "CompositorNodeTree")
    outer.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    layers, group, end = (
        outer.nodes.new(kind)
        for kind in ("CompositorNodeRLayers", "CompositorNodeGroup", "NodeGroupOutput")
    )
    layers.scene = scene
    group.node_tree = tree
    for name in ("Image", "Alpha"):
        outer.links.new(layers.outputs[name], group.inputs[name])
    outer.links.new(group.outputs["Image"], end.inputs["Image"])
    scene.compositing_node_group = outer
    pictures = Pictures(scene)
    width, height = render_size(scene)
    pictures.write(np.full((height, width, 4), white, np.float32), "white")
    fill(pictures)
    return scenes.picture(scene, tmp_path)


def test_blenders_compositor_adds_up_the_same(tmp_path):
    """The engine draws one colour: each pixel is it times the sum of its samples' colours."""
    scene = scenes.settings(32, 24, samples=1)
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = (0.25, 0.5, 1.0)
    scene.display.shading.background_type = "WORLD"
    scenes.camera()
    random = np.random.default_rng(3)
    pixels = np.sort(random.choice(32 * 24, 250, replace=False))
    count = random.integers(1, MOST // 8, len(pixels))
    count[7] = MOST
    pixel = np.repeat(pixels, count)
    colour = random.integers(0, 8, (len(pixel), 3)) / 64.0
    everywhere = PackedPixels(pixels)
    uv, most = random.uniform(0.1, 0.9, (len(pixel), 2)), np.ones(len(pixel))
    packed = pack(everywhere, pixel, uv, colour, most)
    known = random.integers(0, 8, (len(pixels), 3)) / 8.0

    def fill(pictures):
        pictures.write_view(0, packed, colour[:, 0])
        pictures.write(everywhere.spread(np.full((24, 32), 0.5)), "spread")
        pictures.write(everywhere.known(known, pixels), "known")

    # Workbench draws in few bits: what it drew counts.
    world = scenes.picture(scene, tmp_path, "plain")[0, 0, :3]
    found = _composited(scene, tmp_path, fill)
    expected = np.zeros((32 * 24, 3))
    np.add.at(expected, pixel, colour)
    expected *= world
    np.add.at(expected, pixels, known)
    expected += 0.5 * world
    np.testing.assert_allclose(found[..., :3].reshape(-1, 3), expected, rtol=2e-4)
    np.testing.assert_allclose(found[..., 3], 1.0, atol=2e-3)


@pytest.mark.parametrize("white", [1.0, 0.4])
def test_a_view_looked_up_at_its_own_pixels_is_itself(tmp_path, white):
    """Edges along the picture's axes are as sharp as they were, up to the picture's border, also of
    what is brighter than white."""
    scene = scenes.settings(32, 24, samples=1)
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.light = "FLAT"
    scene.display.shading.color_type = "MATERIAL"
    scene.display.render_aa = "OFF"
    scenes.camera(tilt=np.pi / 2)
    wall = scenes.striped_wall()
    for number, material in enumerate(wall.data.materials):
        material.diffuse_color = (0.2 + 0.3 * number, 0.5, 0.9 - 0.4 * number, 1.0)
    pixel = np.arange(32 * 24)
    everywhere = PackedPixels(pixel)
    own_places = (np.stack((pixel % 32, pixel // 32), axis=1) + 0.5) / (32, 24)

    def fill(pictures):
        packed = pack(everywhere, pixel, own_places, np.ones((768, 3)), np.full(768, NO_LIMIT))
        pictures.write_view(0, packed, pixel)
        pictures.write(everywhere.spread(np.zeros((24, 32))), "spread")
        pictures.write(everywhere.known(np.zeros((768, 3)), pixel), "known")

    plain = scenes.picture(scene, tmp_path, "plain")[..., :3]
    assert np.abs(np.diff(plain, axis=1)).max() > 0.3
    found = _composited(scene, tmp_path, fill, white=white)[..., :3]
    np.testing.assert_allclose(found, plain, rtol=0.0, atol=0.012 * np.ptp(plain))
