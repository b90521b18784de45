# SPDX-License-Identifier: GPL-3.0-or-later
"""Places of rays in pixels, neighbours, and the energy of the suns' light."""

from dataclasses import replace
from statistics import NormalDist

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction import optics
from glass_refraction.scene.rays.exits import (
    BRIGHTEST,
    FINER,
    LATTICE,
    MOST_BLURRED,
    Endings,
    FinerRays,
    PictureRays,
    _lattice,
    bell_means,
    between,
    blurred_places,
    centre_rays,
    ending,
    filter_sigma,
    grid,
    neighbours,
    together,
)
from glass_refraction.scene.rays.follow import Part, unsettled
from glass_refraction.scene.rays.hits import Shown, Ways
from glass_refraction.scene.rays.lamps import Sun
from glass_refraction.scene.rays.suns import out_of_focus, sun_light
from glass_refraction.scene.rays.true import _filter_size
from glass_refraction.scene.read.viewpoint import Viewpoint

SIZE = (64, 48)


def view_of(focal=1.5, size=SIZE):
    """A camera at the origin that looks along −z; ``focal``: half widths of the picture a slope."""
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = focal, focal * size[0] / size[1]
    projection[3, 2] = -1.0
    return Viewpoint(np.zeros(3), np.eye(4), projection, size, (0, 0, *size), False)


def sky_ways(ray, direction, weight=None, path=None):
    """Ways that meet nothing."""
    count = len(ray)
    weight = np.ones(count) if weight is None else weight
    path = np.ones(count, np.int64) if path is None else path
    return Ways(
        ray, path, weight, np.repeat(weight[:, None], 3, axis=1), np.zeros((count, 3)), direction,
        np.full(count, np.inf), np.full(count, -1), np.full(count, 2),
        np.zeros(count, bool),
    )  # fmt: skip


class Following:
    """Follows rays of a view by a function of their origins and directions."""

    def __init__(self, view, follow):
        self._view, self._follow = view, follow

    fine_weight = 0.0
    fresnel, rough, only_meshes = True, False, False

    def blocks(self, sets, settled=None):
        for pixels, places in sets:
            yield self._part(pixels, places, settled)

    def _part(self, pixels, places, settled):
        width = self._view.size[0]
        pixel = np.repeat(pixels, len(places))
        x, y = np.tile(places, (len(pixels), 1)).T
        rays = self._view.rays(pixel % width + 0.5 + x, pixel // width + 0.5 + y)
        ways, lost, stuck = (*self._follow(*rays), np.zeros(len(rays[0])))[:3]
        lost = lost - stuck
        rows = unsettled(ways, np.arange(len(ways)), ways.ray, lost, pixels, settled)
        return Part(pixels, places, ways.take(rows), lost, stuck)

    def before(self, pixels, places, rays):
        """Nothing stands before the glasses."""
        return sky_ways(rays[:0], np.zeros((0, 3)))


def straight(origins, directions):
    """Follow nothing: each ray leaves as it came."""
    return sky_ways(np.arange(len(origins)), directions), np.zeros(len(origins))


# --------------------------------------------------------------------------------- places of rays


@pytest.mark.parametrize("side", [1, 2, 3, 5, 8])
def test_places_are_the_means_of_equal_parts_of_the_bell(side):
    random = np.random.default_rng(0)
    drawn = np.sort(random.normal(0, 1, 400 * 840)).reshape(side, -1).mean(axis=1)
    np.testing.assert_allclose(bell_means(side), drawn, atol=0.01)


def test_the_more_places_the_nearer_their_variance_is_to_the_filters():
    variance = [(bell_means(side) ** 2).mean() for side in (2, 3, 5, 9, 33)]
    assert np.all(np.diff(variance) > 0.0)
    assert variance[0] == pytest.approx(2.0 / np.pi)
    assert variance[-1] == pytest.approx(1.0, abs=0.02)


def _edge_variance(scene, folder):
    """Second moment, pixels squared, of the engine's filter: of a slanting edge's profile."""
    found = scenes.picture(scene, folder)[..., 0].astype(float)
    found = (found - found.min()) / np.ptp(found)
    height, width = found.shape
    y, x = np.mgrid[0:height, 0:width] + 0.5
    # The edge runs through the picture's middle.
    slope = scene["edge slope"]
    normal = np.array((1.0, -slope)) / np.hypot(1.0, slope)
    apart = (x - width / 2) * normal[0] + (y - height / 2) * normal[1]
    near = np.abs(apart) < 4.0
    order = np.argsort(apart[near])
    place, value = apart[near][order], found[near][order]
    # With F the profile and H a sharp edge's, 2 ∫ x (H − F) dx is the variance.
    step = np.gradient(place)
    return 2.0 * float((place * ((place > 0) - value) * step).sum())


@pytest.mark.parametrize(
    ("engine", "size", "aa"),
    [
        ("CYCLES", 1.5, "8"),
        ("CYCLES", 4.0, "8"),
        *(("BLENDER_WORKBENCH", 1.5, aa) for aa in ("OFF", "FXAA", "5", "8", "32")),
    ],
)
def test_the_filters_sigma_is_that_of_the_engine(tmp_path, engine, size, aa):
    scene = scenes.settings(64, 48, samples=256)
    scene.render.engine = engine
    scene.cycles.filter_width, scene.render.filter_size = size, size
    scene.display.shading.light, scene.display.shading.color_type = "FLAT", "MATERIAL"
    scene.display.render_aa = aa
    scenes.camera(location=(0, 0, 1), tilt=0.0, type="ORTHO", ortho_scale=1.0)
    scene["edge slope"] = 0.13
    mesh = bpy.data.meshes.new("Edge")
    slope = scene["edge slope"]
    mesh.from_pydata([(-slope, -1, 0), (2, -1, 0), (2, 1, 0), (slope, 1, 0)], [], [(0, 1, 2, 3)])
    # Dark: Workbench adds up samples in a logarithmic scale.
    material = scenes.emissive("grey", (0.05, 0.05, 0.05))
    material.diffuse_color = (0.05, 0.05, 0.05, 1)
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Edge", mesh))
    sigma = filter_sigma(engine, _filter_size(scene))
    assert np.sqrt(_edge_variance(scene, tmp_path)) == pytest.approx(sigma, rel=0.05, abs=0.02)


def _ends(coarse, pixel, way=1.0):
    """Endings of so much light in some pixels, and of all ways."""
    found = np.zeros(SIZE[0] * SIZE[1])
    found[list(pixel)] = list(pixel.values())
    return Endings(found, np.full(len(coarse.ways), way), np.zeros(len(coarse.ways)))


@pytest.mark.parametrize("count", [count for count, _ in FINER])
def test_places_of_many_rays_share_no_row_and_no_column(count):
    places = _lattice(count)
    for axis in range(2):
        np.testing.assert_allclose(np.sort(places[:, axis]), bell_means(count), atol=1e-12)
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=1e-12)
    # No direction is preferred by much.
    assert abs(np.corrcoef(places.T)[0, 1]) < 0.25


def _finer(coarse, ends, sigma, follower):
    """Numbers of the ways that stay, these of the centres, and the finer rays."""
    finer = FinerRays(coarse, ends, sigma, follower, np.zeros(len(ends.pixel)))
    more = together(list(finer.parts()))
    centre = replace(coarse, dark=finer.dark, ways=coarse.ways.take(finer.kept))
    centre = replace(centre, ways=centre.ways.scaled(finer.factor))
    return finer.kept, centre, more


def test_finer_rays_lie_in_their_pixels_and_share_it():
    follower = Following(view_of(), straight)
    coarse = centre_rays(np.array([5, 200, 3000, 3001]), follower)
    pixel = {5: 0.1, 200: 0.3, 3000: 1.0}
    kept, centre, rays = _finer(coarse, _ends(coarse, pixel), 0.25, follower)
    np.testing.assert_array_equal(kept, [3])
    np.testing.assert_array_equal(centre.pixel[centre.ways.ray], [3001])
    assert [int((rays.pixel == p).sum()) for p in pixel] == [count for count, _ in FINER]
    np.testing.assert_allclose(np.bincount(rays.pixel, rays.share)[list(pixel)], 1.0)
    slope = rays.ways.direction[:, :2] / -rays.ways.direction[:, 2:]
    x = (slope[:, 0] * 1.5 + 1.0) * 0.5 * SIZE[0]
    y = (slope[:, 1] * 1.5 * SIZE[0] / SIZE[1] + 1.0) * 0.5 * SIZE[1]
    np.testing.assert_array_equal(np.floor(x) + SIZE[0] * np.floor(y), rays.pixel)
    middle = [x[rays.pixel == p].mean() % 1 for p in pixel]
    np.testing.assert_allclose(middle, 0.5, atol=1e-9)


@pytest.mark.parametrize("count", LATTICE)
def test_an_edge_along_a_row_or_column_is_told_to_a_ray(count):
    """Whatever part of the filter lies beyond an edge, the rays beyond it are as many."""
    places = _lattice(count)
    for edge in np.linspace(-2.5, 2.5, 41):
        beyond = 1.0 - NormalDist().cdf(edge)
        np.testing.assert_allclose((places > edge).mean(axis=0), beyond, atol=1.0 / count)


def test_rays_of_which_no_way_was_followed_are_dark_and_cover_their_pixel():
    def follow(origins, directions):
        ways, _ = straight(origins, directions)
        lost = np.arange(len(origins)) < 4
        return ways.take(np.flatnonzero(~lost)), lost.astype(float)

    rays = centre_rays(np.arange(10), Following(view_of(), follow))
    np.testing.assert_array_equal(rays.dark, np.arange(10) < 4)
    np.testing.assert_array_equal(rays.ways.weight, 1.0)


def test_what_total_reflection_keeps_is_no_light_of_other_ways():
    """Of the other half, which nobody followed, they bring what they bring of their own."""

    def follow(origins, directions):
        ways, _ = straight(origins, directions)
        count = np.ones(len(origins))
        return ways.scaled(0.3 * count), 0.7 * count, 0.4 * count

    rays = centre_rays(np.arange(10), Following(view_of(), follow))
    np.testing.assert_allclose(rays.dark, 0.4)
    np.testing.assert_allclose(rays.ways.weight, 0.6)


@pytest.mark.parametrize("wide", [1, 9])
def test_the_border_of_what_stays_dark_is_as_smooth_as_any(wide):
    """Light of some columns stays in the glass; beside them is none, or glass that brings all."""
    focal, size = 1.5, SIZE
    low = (2.0 * 20.3 / size[0] - 1.0) / focal
    high = (2.0 * (20.3 + wide) / size[0] - 1.0) / focal

    def follow(origins, directions):
        ways, _ = straight(origins, directions)
        slope = directions[:, 0] / -directions[:, 2]
        lost = ((slope > low) & (slope < high)).astype(float)
        return ways.take(np.flatnonzero(slope >= high)), lost, lost

    follower = Following(view_of(focal, size), follow)
    coarse = centre_rays(np.arange(size[0] * size[1]), follower)
    shown = Shown(np.zeros(len(coarse.ways), int), np.zeros((len(coarse.ways), 2)))
    label = np.zeros(len(coarse.ways), int)
    ends = ending(coarse, neighbours(coarse, size), shown, label, size)
    _, centre, _ = _finer(coarse, ends, 0.3, follower)
    columns = centre.dark.reshape(size[1], size[0])
    assert np.ptp(columns, axis=0).max() == 0.0
    row, x = columns[0], np.arange(size[0]) + 0.5
    bell = NormalDist(sigma=0.3)
    wanted = [bell.cdf(20.3 + wide - a) - bell.cdf(20.3 - a) for a in x]
    np.testing.assert_allclose(row, wanted, atol=1.1 / FINER[1][0])


def test_rays_that_nobody_followed_to_the_end_are_not_dark_where_others_were():
    """Of each second pixel's rays those of one half are lost: the other half stands for all."""
    focal, size = 1.5, (8, 4)

    def follow(origins, directions):
        ways, _ = straight(origins, directions)
        x = 0.5 * size[0] * (1.0 - focal * directions[:, 0] / directions[:, 2])
        lost = (np.floor(x) % 2 == 1) & (x % 1.0 > 0.5)
        return ways.take(np.flatnonzero(~lost)), lost.astype(float)

    follower = Following(view_of(focal, size), follow)
    coarse = centre_rays(np.arange(size[0] * size[1]), follower)
    count = len(coarse.ways)
    ends = Endings(np.ones(len(coarse.pixel)), np.ones(count), np.zeros(count))
    _, centre, finer = _finer(coarse, ends, 0.3, follower)
    assert not centre.dark.any()
    weight = finer.ways.weight * finer.share[finer.ways.ray]
    np.testing.assert_allclose(np.bincount(finer.pixel[finer.ways.ray], weight), 1.0)


def test_ways_that_do_not_end_stay_with_the_pixels_centre_and_all_light_comes():
    """Of two ways one ends, by half of the pixel; a part of the light is never followed."""

    def follow(origins, directions):
        count = len(origins)
        ray, path = np.tile(np.arange(count), 2), np.repeat((1, 2), count)
        weight = np.repeat((0.3, 0.5), count)
        keep = np.flatnonzero((path == 1) | (directions[ray, 0] > 0.0))
        ways = sky_ways(ray, np.tile(directions, (2, 1)), weight, path).take(keep)
        return ways, 1.0 - np.bincount(ways.ray, ways.weight, count)

    follower = Following(view_of(size=(5, 3)), follow)
    coarse = centre_rays(np.arange(15), follower)
    middle = 7
    rough = np.zeros(15)
    rough[middle] = 0.3
    way = np.where(coarse.ways.path == 1, 0.0, 0.3)
    ends = Endings(rough, way, np.zeros_like(way))
    _, centre, finer = _finer(coarse, ends, 0.4, follower)
    assert set(finer.ways.path) == {2} and set(finer.pixel) == {middle}
    there = centre.pixel[centre.ways.ray] == middle
    np.testing.assert_array_equal(centre.ways.path[there], [1])
    share = finer.share[finer.ways.ray]
    light = np.bincount(centre.pixel[centre.ways.ray], centre.ways.weight, 15)
    light += np.bincount(finer.pixel[finer.ways.ray], finer.ways.weight * share, 15)
    np.testing.assert_allclose(light, 1.0)


def test_light_that_was_not_followed_goes_with_what_was():
    def follow(origins, directions):
        ways, _ = straight(origins, directions)
        count = len(origins)
        weight = np.repeat((0.6, 0.2), count)
        both = sky_ways(
            np.tile(np.arange(count), 2), np.tile(ways.direction, (2, 1)), weight,
            np.repeat((1, 2), count),
        )  # fmt: skip
        return both, np.full(count, 0.2)

    rays = centre_rays(np.arange(10), Following(view_of(), follow))
    sums = np.bincount(rays.ways.ray, rays.ways.weight)
    np.testing.assert_allclose(sums, 1.0)
    np.testing.assert_allclose(rays.ways.weight[:10] / rays.ways.weight[10:], 3.0)


def test_a_grid_holds_each_pixel_once():
    found = grid([(0, 0, 3, 2), (2, 1, 5, 4), (-4, -4, 0, 0), (60, 40, 90, 90)], SIZE)
    assert np.all(np.diff(found) > 0)
    assert len(found) == 6 + 9 - 1 + 4 * 8


# ------------------------------------------------------------------------------------- neighbours


def test_neighbours_are_the_same_way_one_pixel_further():
    view = view_of(size=(6, 5))
    pixels = np.array([7, 8, 9, 13, 14, 27])
    ways = sky_ways(
        np.array([0, 1, 1, 2, 3, 4, 5]), np.tile((0, 0, -1.0), (7, 1)),
        path=np.array([1, 1, 2, 2, 1, 3, 1]),
    )  # fmt: skip
    rays = PictureRays(pixels, np.ones(6), np.zeros(6), ways)
    found = neighbours(rays, view.size)
    np.testing.assert_array_equal(found.pixel, pixels[ways.ray])
    # By hand: path 1 in 7 and 8 and 13; path 2 in 8 and 9; 3 in 14 alone; 27 in the last column.
    np.testing.assert_array_equal(found.ahead[0], [1, -1, 3, -1, -1, -1, -1])
    np.testing.assert_array_equal(found.behind[0], [-1, 0, -1, 2, -1, -1, -1])
    np.testing.assert_array_equal(found.ahead[1], [4, -1, -1, -1, -1, -1, -1])
    np.testing.assert_array_equal(found.behind[1], [-1, -1, -1, -1, 0, -1, -1])
    assert found.inner[1][0].all() == (27 // 6 < 4) and not found.inner[1][0][-1]


def test_each_of_several_ways_through_the_same_interfaces_has_neighbours():
    """The facets of rough glass: all of a ray's go one way."""
    pixels = np.arange(3)
    ways = sky_ways(np.repeat(pixels, 2), np.tile((0, 0, -1.0), (6, 1)))
    found = neighbours(PictureRays(pixels, np.ones(3), np.zeros(3), ways), (3, 1))
    np.testing.assert_array_equal(found.ahead[0] >= 0, ways.ray < 2)
    np.testing.assert_array_equal(found.behind[0] >= 0, ways.ray > 0)


def test_neighbours_of_no_ways():
    nothing = sky_ways(np.zeros(0, int), np.zeros((0, 3)))
    rays = PictureRays(np.arange(4), np.ones(4), np.zeros(4), nothing)
    found = neighbours(rays, SIZE)
    assert all(len(part) == 0 for pair in (found.ahead, found.behind) for part in pair)
    shown = Shown(np.zeros(0, int), np.zeros((0, 2)))
    ends = ending(rays, found, shown, np.zeros(0, int), SIZE)
    assert not ends.pixel.any() and not len(ends.way)


def test_where_all_is_smooth_nothing_ends():
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), Following(view_of(), straight))
    beside = neighbours(rays, SIZE)
    count = len(rays.ways)
    y, x = np.divmod(rays.pixel[rays.ways.ray], SIZE[0])
    shown = Shown(np.zeros(count, int), np.stack((x, y), axis=1) + 0.5)
    label = np.zeros(count, int)
    ends = ending(rays, beside, shown, label, SIZE)
    assert not ends.pixel.any() and not ends.way.any()
    # Another thing in the right half: pixels on either side of its border, whole columns.
    label[x >= 30] = 1
    shown.view[x >= 30] = 1
    ends = ending(rays, beside, shown, label, SIZE)
    np.testing.assert_array_equal(ends.pixel, ends.way)
    rough = ends.pixel.reshape(SIZE[::-1])
    assert (rough[:, 29:31] > 0.2).all()
    assert not np.delete(rough, (29, 30), axis=1).any()
    # What shines counts as what is seen of it, up to a limit; darker things as before.
    for radiance, times in ((0.1, 1.0), (1.5, 1.5), (1e6, BRIGHTEST)):
        bright = ending(rays, beside, shown, label, SIZE, np.where(label, radiance, 1.0))
        np.testing.assert_allclose(bright.pixel, times * ends.pixel)
    # In one view its filter mixes both, but lookups keep off what shines: an edge was a stair.
    shown.view[:] = 0
    assert not ending(rays, beside, shown, label, SIZE).pixel.any()
    beside_it = ending(rays, beside, shown, label, SIZE, shines=label == 1)
    np.testing.assert_array_equal(beside_it.pixel, ends.pixel)


def _magnified(factor, bend=0.0):
    """A picture whose one way runs on, what shows it, and what its neighbours are.

    The hits of neighbouring pixels lie so many pixels apart in a view, and their places bend.
    """
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), Following(view_of(), straight))
    y, x = np.divmod(rays.pixel, SIZE[0])
    pixels = _places_in_view(np.stack((x, y), axis=1) + 0.5, factor, bend)
    shown = Shown(np.zeros(len(rays.ways), int), pixels)
    return rays, shown, neighbours(rays, SIZE)


def _places_in_view(place, factor, bend):
    x, y = np.moveaxis(place, -1, 0)
    return np.stack((factor * x + bend * y**2, 0.5 * factor * y - bend * x**2), axis=-1)


@pytest.mark.parametrize("factor", [2.0, 3.5, 9.0, 40.0])
def test_stretched_ways_that_run_on_take_places_in_place_of_rays(factor):
    rays, shown, beside = _magnified(factor)
    ends = ending(rays, beside, shown, np.zeros(len(rays.ways), int), SIZE)
    assert not ends.pixel.any() and not ends.way.any()
    finer = FinerRays(rays, ends, 0.4, Following(view_of(), straight), 0.0 * ends.pixel)
    assert not [part for part in finer.parts() if len(part.pixel)]
    times = np.bincount(finer.kept, minlength=len(rays.ways))
    wanted = [count for count, least in FINER if ends.stretched[0] > least] or [1]
    np.testing.assert_array_equal(times, wanted[-1])
    np.testing.assert_allclose(np.bincount(finer.kept, finer.share), 1.0)
    for axis in range(2):
        middle = np.bincount(finer.kept, finer.offset[:, axis]) / times
        np.testing.assert_allclose(middle, 0.0, atol=1e-12)
    np.testing.assert_allclose(finer.factor, 1.0)
    assert not finer.dark.any()


@pytest.mark.parametrize("reason", ["surface", "view", "way", "rough", "light"])
def test_stretched_ways_end_where_their_neighbours_do_not_tell_what_lies_between(reason):
    rays, shown, beside = _magnified(3.0)
    label = np.zeros(len(rays.ways), int)
    column = rays.pixel % SIZE[0]
    near = (column == 29) | (column == 30)
    if reason == "surface":
        label[column >= 30] = 1
    elif reason == "view":
        shown.view[column >= 30] = 1
    elif reason == "light":
        rays.ways.weight[column >= 30] = 0.6
    elif reason == "rough":
        near = column >= 30
        rays.ways.rough[near] = True
    else:
        rays = replace(rays, ways=rays.ways.take(np.flatnonzero(column != 30)))
        shown, label = shown.take(np.flatnonzero(column != 30)), label[column != 30]
        beside = neighbours(rays, SIZE)
        column = rays.pixel[rays.ways.ray] % SIZE[0]
        near = (column == 29) | (column == 31)
    ends = ending(rays, beside, shown, label, SIZE)
    np.testing.assert_array_equal(ends.way > 0.05, near)
    np.testing.assert_array_equal(ends.stretched > 0.05, ~near)


def test_places_between_pixels_lie_on_a_parabola_through_neighbours():
    """So a place that neighbours tell is that of a ray, where places bend as slowly."""
    rays, shown, beside = _magnified(3.0, bend=0.02)
    rows = np.repeat(np.arange(len(rays.ways)), 6)
    offset = np.tile(0.4 * _lattice(6), (len(rays.ways), 1))
    offset[::12] = 0.0
    found = between(shown.pixels, beside, rows, offset, (-500, -500, 500, 500))
    y, x = np.divmod(rays.pixel[rows], SIZE[0])
    places = np.stack((x, y), axis=1) + 0.5 + offset
    inner = (x > 0) & (x < SIZE[0] - 1) & (y > 0) & (y < SIZE[1] - 1)
    wanted = _places_in_view(places, 3.0, 0.02)
    np.testing.assert_allclose(found[inner], wanted[inner], atol=1e-9)
    # At the picture's border the line through two pixels.
    np.testing.assert_allclose(found[~inner], wanted[~inner], atol=0.02)
    np.testing.assert_array_equal(found[::12], shown.pixels[rows[::12]])


def test_places_between_pixels_stay_in_what_views_draw():
    rays, shown, beside = _magnified(3.0)
    shown.pixels[:] = np.clip(shown.pixels, 20.5, 99.5)
    rows = np.repeat(np.arange(len(rays.ways)), 12)
    offset = np.tile(_lattice(12), (len(rays.ways), 1))
    found = between(shown.pixels, beside, rows, offset, (20, 20, 100, 100))
    assert found.min() >= 20.5 and found.max() <= 99.5


# ------------------------------------------------------------------------------------------- suns


def _through_a_slab(origins, directions):
    """A pane across the view: light goes on in its direction."""
    pane = optics.body(
        optics.FlatGlass((0.01,), (1.5,), outline=((-9, -9), (9, -9), (9, 9), (-9, 9)))
    )
    pose = np.eye(4)
    pose[2, 3] = -1.0
    ends = optics.exit_rays([optics.PlacedGlass(pane, pose)], origins, directions, min_weight=1e-3)
    keep = ends.path == ends.path[np.argmax(ends.weight)]
    return sky_ways(ends.ray[keep], ends.direction[keep], ends.weight[keep]), ends.lost


def _off_a_mirror(origins, directions):
    """A flat mirror at 40 degrees: light goes on in the mirrored direction."""
    normal = np.array((0.0, np.sin(0.7), np.cos(0.7)))
    mirrored = directions - 2.0 * (directions @ normal)[:, None] * normal
    return sky_ways(np.arange(len(origins)), mirrored), np.zeros(len(origins))


def _flux(view, rays, light):
    """Light of a picture over the solid angles of its pixels."""
    x, y = rays.pixel % SIZE[0] + 0.5, rays.pixel // SIZE[0] + 0.5
    _, directions = view.rays(x, y)
    per_pixel = (2.0 / (SIZE[0] * view.projection[0, 0])) * (
        2.0 / (SIZE[1] * view.projection[1, 1])
    )
    solid = per_pixel * np.abs(directions[:, 2]) ** 3
    return float((light[:, 0] * rays.ways.weight * solid[rays.ways.ray]).sum())


@pytest.mark.parametrize("through", [_through_a_slab, _off_a_mirror], ids=lambda f: f.__name__)
@pytest.mark.parametrize("half_px", [0.02, 0.2, 0.28, 0.3, 0.5, 1.0, 3.0, 12.0])
def test_all_pixels_together_get_the_suns_flux(through, half_px):
    """In the mean over places of a pixel: a filter sees a point of light now more, now less."""
    view = view_of(3.0)
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), Following(view, through))
    beside = neighbours(rays, SIZE)
    pixel = 2.0 / (SIZE[0] * view.projection[0, 0])
    half = half_px * pixel
    solid = 2.0 * np.pi * (1.0 - np.cos(half))
    found, brightest = [], 0.0
    for x, y in np.stack(np.meshgrid(np.arange(3), np.arange(3)), axis=-1).reshape(-1, 2):
        seen = np.array(((x / 3 + 0.1) * pixel, (y / 3 + 0.1) * pixel, -1.0))
        ways, _ = through(np.zeros((1, 3)), seen[None] / np.linalg.norm(seen))
        sun = Sun(tuple(ways.direction[0]), float(np.cos(half)), (7.0, 7.0, 7.0))
        light = sun_light(
            rays, beside, (sun,), filter_sigma("CYCLES", 1.5), Following(view, through)
        )
        found.append(_flux(view, rays, light) / (7.0 * solid * ways.weight[0]))
        brightest = max(brightest, light.max() / 7.0)
    assert np.mean(found) == pytest.approx(1.0, rel=0.015)
    assert np.ptp(found) < 0.4
    assert brightest < 1.0 + 1e-9


def test_a_sun_is_as_bright_as_it_is_and_ends_at_its_border():
    view = view_of(3.0)
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), Following(view, straight))
    half = 10.0 * 2.0 / (SIZE[0] * view.projection[0, 0])
    sun = Sun((0.0, 0.0, -1.0), float(np.cos(half)), (5.0, 2.0, 1.0))
    light = sun_light(rays, neighbours(rays, SIZE), (sun,), 0.25, Following(view, straight))
    apart = np.arccos(np.clip(-rays.ways.direction[:, 2], -1, 1)) / half
    np.testing.assert_allclose(light[apart < 0.9], [sun.radiance] * (apart < 0.9).sum())
    assert not light[apart > 1.1].any()


def test_a_sun_as_wide_as_half_the_sky():
    view = view_of(3.0)
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), Following(view, straight))
    sun = Sun((0.0, 0.0, -1.0), 0.0, (5.0, 2.0, 1.0), (1.0, 0.5))
    light = sun_light(rays, neighbours(rays, SIZE), (sun,), 0.25, Following(view, straight))
    # The paths are those of mirrored light.
    assert rays.ways.is_mirrored.all()
    np.testing.assert_allclose(light, np.broadcast_to(0.5 * np.array(sun.radiance), light.shape))


def _spread(origins, directions):
    """Nine times as far from the axis from row to row."""
    bent = directions * (1.0, 9.0, 1.0)
    bent /= np.linalg.norm(bent, axis=1, keepdims=True)
    return sky_ways(np.arange(len(origins)), bent), np.zeros(len(origins))


def _in_rows(origins, directions):
    """The same, each row of pixels by a way of its own."""
    row = np.floor(directions[:, 1] / -directions[:, 2] * 0.5 * SIZE[0] * 3.0 + 0.5 * SIZE[1])
    ways, lost = _spread(origins, directions)
    return replace(ways, path=2 * row.astype(np.int64) + 1), lost


def test_a_sun_in_a_way_as_narrow_as_a_pixel_is_no_brighter():
    """A rim that spreads the sun's light was a row of white pixels: no neighbour told how far."""
    view, found = view_of(3.0), []
    sun = Sun((0.0, 0.0, -1.0), float(np.cos(5e-3)), (5.0, 2.0, 1.0))
    for through in (_spread, _in_rows):
        follower = Following(view, through)
        rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), follower)
        light = sun_light(rays, neighbours(rays, SIZE), (sun,), 0.4, follower)
        found.append(_flux(view, rays, light))
    assert found[1] == pytest.approx(found[0], rel=0.2)


def test_a_sun_in_a_way_that_only_the_centre_has_is_not_seen():
    view = view_of(3.0)

    def centre_only(origins, directions):
        ways, lost = straight(origins, directions)
        return replace(ways, path=np.arange(2 * len(origins), step=2) + 1), lost

    follower = Following(view, centre_only)
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), follower)
    sun = Sun((0.0, 0.0, -1.0), float(np.cos(1e-3)), (5.0, 2.0, 1.0))
    some = np.flatnonzero(sun_light(rays, neighbours(rays, SIZE), (sun,), 0.4, follower)[:, 0])
    assert len(some) <= 1


def _over_an_edge(origins, directions):
    """A flat mirror above, and below another, that send light into directions far apart."""
    above = directions[:, 1] > 0.0
    turn = np.where(above, 0.6, -0.6)
    y, z = directions[:, 1], directions[:, 2]
    turned = (
        directions[:, 0],
        y * np.cos(turn) - z * np.sin(turn),
        y * np.sin(turn) + z * np.cos(turn),
    )
    return sky_ways(np.arange(len(origins)), np.stack(turned, axis=1)), np.zeros(len(origins))


def test_a_sun_between_what_both_sides_of_an_edge_mirror_is_not_seen():
    """Both have the same path, and a row of pixels along a cylinder's rim was white."""
    view = view_of(3.0)
    follower = Following(view, _over_an_edge)
    rays = centre_rays(np.arange(SIZE[0] * SIZE[1]), follower)
    sun = Sun((0.0, 0.0, -1.0), float(np.cos(0.05)), (5.0, 2.0, 1.0))
    assert not sun_light(rays, neighbours(rays, SIZE), (sun,), 0.4, follower).any()


def test_rays_from_all_over_a_lens_are_more_the_larger_its_blur_and_not_too_many():
    found = blurred_places(np.array((1.6, 3.9, 4.1, 50.0)))
    assert np.all(np.diff(found) >= 0) and found[0] < found[-1]
    for pixels in (100_000, 200_000, 600_000):
        found = blurred_places(np.full(pixels, 50.0))
        assert found.sum() <= MOST_BLURRED and found.min() in LATTICE
    assert (blurred_places(np.full(3 * MOST_BLURRED, 50.0)) == min(LATTICE)).all()


def test_a_sun_out_of_focus_is_a_disc_of_the_same_light():
    random, (width, height) = np.random.default_rng(3), SIZE
    pixel, light = np.array((10 * width + 12, 30 * width + 50)), random.random((2, 3))
    blur = np.zeros((height, width))
    blur[:20] = 5.2
    found, lights = out_of_focus(pixel, light, blur)
    np.testing.assert_allclose(lights.sum(axis=0), light.sum(axis=0))
    y, x = np.divmod(found, width)
    in_disc = y < 20
    far = np.hypot(x - 12, y - 10)[in_disc]
    assert 4.5 < far.max() <= 5.2 and in_disc.sum() == pytest.approx(np.pi * 5.2**2, rel=0.1)
    assert found[~in_disc].tolist() == pixel[1:].tolist()
    corner, _ = out_of_focus(np.array((0,)), light[:1], np.full((height, width), 1e3))
    assert corner.min() >= 0 and corner.max() < width * height
