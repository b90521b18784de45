# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view's shader follows rays as ``optics.exit_rays`` does, many of each shape."""

import math

import pytest

SHAPES = (
    "slab",
    "star",
    "disc",
    "tank",
    "cylinder",
    "filled",
    "rod",
    "sphere",
    "bowl",
    "tumbler",
    "empty",
    "revolution",
    "lens",
)


OFF_SHORT = {"lens": 5e-3}
"""Part of the ways of fewer than eight events that may be off; at a lens's sharp rim the profile's
chords miss some."""


MESHES = {
    "smooth": 5e-3,
    "painted": 5e-3,
    "faceted": 1e-3,
    "overlap": 5e-2,
    "inside": 4e-2,
    "small": 5e-3,
}
"""Part of the light that may be off. Interpolated normals turn a little way on a facet into an
angle, which grows from facet to facet: most in the slim ball of two of them, whose ends are sharp.
"""


@pytest.fixture(scope="module")
def found(installed):
    return installed.script("exit_rays", how="gui", seconds=1800)


@pytest.mark.parametrize("shape", SHAPES)
def test_exit_rays_are_those_of_optics(found, shape):
    result = found[shape]
    assert result["rays"] > 8_000
    assert result["ways"] > 20_000
    assert result["median"] < 1e-6
    # But for ways that end where another begins, and those that go on until rounding shows.
    assert result["off_short"] < OFF_SHORT.get(shape, 2e-3)
    assert result["light_off"] < 1e-2
    assert result["weight_off"] < 1e-3
    assert result["shift_off"] < 1e-3
    assert result["ways_of_shader"] <= 1.01 * result["ways"]


@pytest.mark.parametrize("shape", ["filled", "tumbler", "revolution", "sphere"])
def test_rays_before_the_near_plane_are_not_bent(found, shape):
    """A camera's *Clip Start* cuts glasses in renders; in the view they stayed whole."""
    result = found[f"{shape}, cut"]
    assert result["rays"] > 4_000
    assert result["median"] < 1e-6
    assert result["light_off"] < 1e-2
    assert result["weight_off"] < 1e-3


@pytest.mark.parametrize("scene", MESHES)
def test_exit_rays_of_meshes_are_those_of_optics(found, scene):
    result = found[scene]
    assert result["rays"] > 2_500
    assert result["ways"] > 10_000
    assert result["median"] < 1e-5
    assert result["off_short"] < MESHES[scene]
    assert result["light_off"] < MESHES[scene]
    assert result["weight_off"] < 2e-3
    # Of what surfaces and media take.
    assert result["dimmed_off"] < 2e-3
    assert result["ways_of_shader"] <= 1.02 * result["ways"]


@pytest.mark.parametrize("roughness", ["0.1", "0.3"])
def test_rough_meshes_spread_light_as_in_optics(found, roughness):
    """They were drawn smooth."""
    shader, exact = found["rough"][roughness]
    assert exact > 1e-4
    assert shader == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("degrees", [3, 12, 27, 45, 63, 78, 87])
def test_edges_of_things_run_straighter_than_pixels(found, degrees):
    """Held against the corners of single pixels; nine of them cannot tell of the longest stairs."""
    turn = math.radians(degrees)
    corner = 0.5 * (math.sin(turn) + math.cos(turn))
    viewed, captured = found["straight"][str(degrees)]
    assert viewed < (0.85 if degrees in (3, 87) else 0.75) * corner
    # Of a capture four vote.
    assert captured < (1.0 if degrees in (3, 87) else 0.85) * corner


def test_beside_an_edge_things_have_their_own_colours(found):
    """The engine's samples mix both sides of an edge, and what is looked up there mixed them into
    two pixels on either side: pencil had a seam."""
    assert found["beside"] < 0.02


def test_the_edge_of_a_round_thing_lies_as_deep_as_its_axis(found):
    """Near an edge a circle is a parabola, but for a part."""
    assert found["rods"] < 0.1


def test_what_comes_before_a_things_edge_meets_it(found):
    """A look lies up to two pixels within a thing, which is nearer there than the ray: it was taken
    to pass behind the edge, and a capture that sees the place was asked. Edges behind glass had
    teeth."""
    hit, missed = found["met"]
    assert hit > 0.98
    assert missed < 0.01


def test_what_begins_on_a_table_meets_it(found):
    """Just behind its box it met nothing: meshes that stand on a flat table had a dark foot."""
    assert found["on"] == 1.0


def test_behind_a_post_the_view_itself_shows_what_captures_see_no_nearer(found):
    """Whichever saw it nearer by rounding was shown, and the two are lit from other sides: walls
    that a ray met behind a pencil were a comb of hairs."""
    assert found["post"] == 1.0


def test_behind_a_leaf_is_the_world_where_no_box_is(found):
    """What no view shows to its end looked like what is beside the edge that hides it: in leaves
    before an HDRI most of a carafe was table."""
    open_, boxed, _ = found["world"]
    assert open_ == 1.0
    assert boxed < 0.2


def test_behind_a_leaf_is_the_wall_beside_it_where_that_goes_on(found):
    """In Solid shading it was the leaf's back, or the world."""
    assert found["world"][2] == 1.0


def test_of_two_edges_the_nearer_one_is_drawn(found):
    """Python let go of their depth buffer: black lines were left of double glazing."""
    assert found["edges"] == pytest.approx([0.25, 0.25], abs=1e-5)


@pytest.mark.parametrize("view", ["eye", "parallel"])
def test_a_plane_is_a_plane_between_pixels(found, view):
    """Rays that begin on a table met it or not by where in a pixel they began."""
    assert found["planes"][view] < 1e-5


def test_tiles_hold_the_nearest_and_farthest_of_their_pixels(found):
    assert found["tiles"] < 1e-6


def test_depths_are_freed_of_what_eevee_adds_to_them(found):
    """It adds to each how much those beside it differ: ends of things lay as far as what is behind.

    Corners of a disc's edge that one block cuts more than once cannot all be told. Where it cuts
    one pixel off, values are as a plane's: in captures such pixels lay far too near.
    """
    freed, amended = found["amended"]
    assert amended > 0.015
    assert freed < 0.0005


def test_lamps_shine_as_their_triangles_do(found):
    """Balls and discs of triangles are a little smaller. Lamps were missing in Material Preview."""
    assert len(found["lamps"]) == 4
    assert max(found["lamps"].values()) < 0.03
