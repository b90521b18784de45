# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames cost and how right they are, by operations and errors: never by time.

The limits are a tenth above what is followed today. Who lowers what a frame costs lowers them; who
must raise one says why.
"""

from functools import cache
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from benchmarks import frames, pictures  # noqa: E402
from benchmarks.settings import Settings  # noqa: E402
from glass_refraction.reference.cycles import render_reference  # noqa: E402
from glass_refraction.reference.metrics import to_srgb  # noqa: E402
from glass_refraction.scene.update import memory_of  # noqa: E402

SIZE = (120, 90)
ERASER = Path(__file__).parents[2] / "demo_scenes" / "eraser.blend"


def scene_named(name):
    if name == "eraser":
        return pictures.open_scene(ERASER, SIZE)
    if name == "four glasses":
        return frames._row_of_glasses(4, SIZE)
    return frames._mesh_glass(1_000, SIZE)[0]


@cache
def moves(name):
    """What frames of a scene cost."""
    return frames._moves(scene_named(name))


@pytest.mark.parametrize(
    ("name", "rays", "ways", "casts", "cast"),
    [
        # A pixel of glass: rays that bring light, ways. A frame: casts, rays that are cast.
        ("eraser", 3.1, 10.2, 34, 60_000),
        ("four glasses", 3.8, 9.9, 20, 27_500),
        # Strong light is followed however long it runs round: few rays in many casts.
        ("ball of a thousand triangles", 5.8, 14.7, 364, 158_000),
    ],
)
def test_a_frame_follows_and_casts_no_more_rays(name, rays, ways, casts, cast):
    first = moves(name)["first"]
    assert first["rays"] < rays * first["covered"]
    assert first["ways"] < ways * first["covered"]
    assert first["counts"]["casts"] <= casts
    assert first["counts"]["cast_rays"] < cast


def test_what_moves_beside_the_glass_costs_casts_only():
    found = moves("eraser")
    assert found["thing moved"]["counts"]["exit_rays"] < 0.1 * found["first"]["counts"]["exit_rays"]
    assert found["thing moved"]["counts"]["cast_rays"] < 24_000


def test_the_picture_is_as_right_as_it_was():
    scene = scene_named("eraser")
    halves = [
        to_srgb(render_reference(scene, samples=24, seed=seed, surface="GLASS"))
        for seed in (101, 102)
    ]
    kind = pictures.Kind(pictures.RAYS, (16,))
    ((picture, row),) = pictures._pictures(scene, kind, "GLASS")
    inside = memory_of(scene).covered
    beside = ~pictures.grown(inside, pictures.MARGIN_PX)
    shown = to_srgb(picture)
    # Sixteen samples' noise is most of both.
    assert pictures.error(shown, halves, inside) < 0.016
    assert pictures.error(shown, halves, beside) < 0.013
    assert row["unseen"] < 0.002 and row["views"] <= 4


def test_the_settings_of_a_run_do_not_change_what_a_scene_is():
    """Every size measures the same kinds of pictures, but EEVEE's in tests."""
    names = [
        {kind.name for kind in pictures.kinds(Settings(size), whole)}
        for size, whole in (("tiny", True), ("quick", True), ("full", True), ("full", False))
    ]
    assert names[1] == names[2] == names[3] == names[0] | set(pictures.IN_EEVEE)
