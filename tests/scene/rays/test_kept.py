# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept of the frame before changes the time of a frame, never a bit of it."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.optics.vectors import rotated
from glass_refraction.reference.cycles import scene_depsgraph
from glass_refraction.scene import update as door
from glass_refraction.scene.memory import counters, memory_of
from glass_refraction.scene.rays import edges, exits, follow, hits, sketches, true
from glass_refraction.scene.rays.looks import Look
from glass_refraction.scene.rays.moved import Boxes, Known
from glass_refraction.scene.rays.things import Things
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint


def _computed(scene, monkeypatch):
    """The frame's pictures, and how many rays were followed for them."""
    results = []
    compute = true.compute

    def kept(*arguments):
        results.append(compute(*arguments))
        return results[-1]

    before = counters["exit_rays"]
    with monkeypatch.context() as patch:
        patch.setattr(true, "compute", kept)
        patch.setattr(true, "_write", lambda *_: None)
        depsgraph = scene_depsgraph(scene)
        true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
    (result,) = results
    pictures = [result.spread, result.known]
    for view, weight in zip(result.views, result.weights, strict=True):
        pictures += [view.where, view.colour, weight, *view.into, *sum(view.pairs, ())]
    return pictures, counters["exit_rays"] - before


def _bowl(inside=True):
    """A hollow ball before a wall, and a cube in it or behind it."""
    scenes.camera()
    scenes.striped_wall(0.4, stripes=6)
    scene = scenes.settings(48, 36, samples=1, shading="TRUE", surface="GLASS")
    scenes.glass(shape="SPHERE", radius=0.06, wall_thickness=0.002, location=(0.0, 0.0, 0.08))
    return scene, _cube((0, 0, 0.08) if inside else (0.1, 0.2, 0.1))


def _cube(location, size=0.02):
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    return bpy.context.active_object


def _same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("inside", [False, True])
def test_a_frame_in_many_blocks_is_the_same_to_the_bit(monkeypatch, inside):
    """Whether a thing in the glass moves or one behind it: most rays are followed once. Those that
    a floor mirrors are followed in every frame."""
    scene, cube = _bowl(inside)
    bpy.ops.mesh.primitive_plane_add(location=(0.0, 0.0, -0.01))
    bpy.context.object.data.materials.append(bpy.data.materials.new("Polished"))
    shader = bpy.context.object.active_material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.05
    followed = []
    onward = follow.Follower.onward
    monkeypatch.setattr(
        follow.Follower, "onward", lambda *given: followed.append(given) or onward(*given)
    )
    frames = []
    for together in (100_000, 60):
        monkeypatch.setattr(follow, "TOGETHER", together)
        for module in (hits, exits, edges, sketches):
            monkeypatch.setattr(module, "TOGETHER", 10 * together)
        door.forget()
        door.prepare(scene, scene_depsgraph(scene), strict=True)
        cube.delta_location.y = 0.0
        first, rays = _computed(scene, monkeypatch)
        cube.delta_location.y = 0.004
        second, again = _computed(scene, monkeypatch)
        frames.append((first, second))
        assert again < (0.7 if inside else 0.3) * rays
        blocks = sum(len(kept) for kept in memory_of(scene).kept.parts.values())
        assert (blocks > 10) == (together == 60)
    assert followed
    for one, other in zip(*frames, strict=True):
        _same(one, other)


def _moves(scene, cube):
    cube.location.x += 0.003


def _leaves(scene, cube):
    cube.location.z = 0.3


def _hides(scene, cube):
    cube.hide_viewport = cube.hide_render = True


def _deforms(scene, cube):
    cube.data.vertices[0].co.z *= 1.3
    cube.data.update()


def _a_lamp_comes(scene, cube):
    # Between cube and wall of glass.
    bpy.ops.object.light_add(type="AREA", radius=0.02, location=(0.0, 0.0, 0.11))


def _one_behind_it_comes(scene, cube):
    # The numbers of all triangles change.
    _cube((0.03, 0.2, 0.05)).name = "A first one"


def _one_before_it_comes(scene, cube):
    _cube((0.02, -0.2, 0.08), 0.01)


def _wall_goes(scene, cube):
    bpy.data.objects.remove(bpy.data.objects["Wall"])


def _is_not_seen_through_the_glass(scene, cube):
    chosen = bpy.data.collections.new("Seen")
    chosen.objects.link(bpy.data.objects["Wall"])
    glass = next(obj for obj in scene.objects if glass_modifier(obj) is not None)
    write_input(glass_modifier(glass), "Seen Through", chosen)
    glass.update_tag()


def _glass_moves(scene, cube):
    glass = next(obj for obj in scene.objects if glass_modifier(obj) is not None)
    glass.location.x += 0.003


HAPPENS = {
    _moves: 0.75,
    _leaves: 1.0,
    _hides: 1.0,
    _deforms: 0.75,
    _a_lamp_comes: 0.75,
    _one_behind_it_comes: 0.8,
    _one_before_it_comes: 0.6,
    _wall_goes: 1.0,
    _is_not_seen_through_the_glass: 1.0,
    _glass_moves: 1.0,
}
"""What happens in a frame, and the part of all rays that is followed for it at most, with a cube in
the bowl."""


@pytest.mark.in_turn(4)
@pytest.mark.parametrize("inside", [True, False], ids=["in the bowl", "behind it"])
@pytest.mark.parametrize("happens", HAPPENS, ids=lambda f: f.__name__.strip("_"))
def test_a_frame_after_others_is_the_frame_alone(monkeypatch, happens, inside):
    scene, cube = _bowl(inside)
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    first, _ = _computed(scene, monkeypatch)
    happens(scene, cube)
    found = [_computed(scene, monkeypatch), _computed(scene, monkeypatch)]
    door.forget()
    alone, rays = _computed(scene, monkeypatch)
    for pictures, _ in found:
        _same(pictures, alone)
    # The first followed what it must, the second nothing.
    most = HAPPENS[happens] if inside else 1.0
    assert found[0][1] <= most * rays and found[1][1] == 0
    assert not inside or any(not np.array_equal(a, b) for a, b in zip(first, alone, strict=True))


def test_hits_that_no_moved_thing_changed_are_known(monkeypatch):
    scene, cube = _bowl(inside=False)
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    looked = []

    def end(self, ways, rows, end=follow.Follower._end):
        before = counters["cast_rays"]
        end(self, ways, rows)
        looked.append(counters["cast_rays"] - before)

    monkeypatch.setattr(follow.Follower, "_end", end)
    cast = []
    for step in (0.0, 0.003, 0.0):
        cube.delta_location.x += step
        _computed(scene, monkeypatch)
        cast.append(sum(looked))
        looked.clear()
    assert 0 < cast[1] < 0.3 * cast[0] and cast[2] == 0


def test_rays_of_all_finenesses_are_followed_together(monkeypatch):
    """Each call takes as many steps as its longest way, few rays in most of them."""
    scene, cube = _bowl()
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    monkeypatch.setattr(exits, "FINER", ((4, 0.05), (12, 0.1)))
    calls = []

    def exit_rays(*arguments, exit_rays=follow.optics.exit_rays, **named):
        if "most_events" not in named:
            calls.append(set(np.unique(named["pixel"], return_counts=True)[1]))
        return exit_rays(*arguments, **named)

    monkeypatch.setattr(follow.optics, "exit_rays", exit_rays)
    for _ in range(2):
        _computed(scene, monkeypatch)
        cube.delta_location.x += 0.003
    first, moved = calls[:2], calls[2:]
    assert first == [{1}, {4, 12}] and moved == [{1}, {12}]


def test_no_more_is_kept_than_there_is_room_for(monkeypatch):
    scene, _ = _bowl()
    monkeypatch.setattr(follow, "TOGETHER", 60)
    monkeypatch.setattr(follow, "MOST_KEPT", 500)
    door.prepare(scene, scene_depsgraph(scene), strict=True)
    _computed(scene, monkeypatch)
    assert memory_of(scene).kept.size <= 500


def _soup(random, count, owners=("one", "other")):
    points = random.uniform(-1, 1, (3 * count, 3))
    surface = random.integers(0, 2, count).astype(np.int32)
    corners = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Things(points, corners, surface, (Look(), Look()), tuple(owners))


def test_triangles_are_known_again_by_their_corners_and_owners():
    random = np.random.default_rng(2)
    things = _soup(random, 200)
    order = random.permutation(200)
    points = things.points.copy()
    gone = random.permutation(200)[:20]
    points[things.triangles[gone, 1], 2] += 1e-12
    other = Things(points, things.triangles[order], things.surface[order], *_names(things))
    boxes, number = Known(things, None).moved_to(Known(other, None))
    here = np.setdiff1d(np.arange(200), gone)
    np.testing.assert_array_equal(np.flatnonzero(number >= 0), here)
    np.testing.assert_array_equal(order[number[here]], here)
    for soup in (things, other):
        rows = gone if soup is things else np.flatnonzero(np.isin(order, gone))
        for corners in soup.points[soup.triangles[rows]]:
            along = rotated(boxes.axes, corners.T).T
            inside = (along >= boxes.bounds[:, None, 0]) & (along <= boxes.bounds[:, None, 1])
            assert inside.all(axis=(1, 2)).any()
    # The same triangles of another owner, or seen otherwise, are others.
    renamed = Things(points, other.triangles, other.surface, other.looks, ("one", "third"))
    _, number = Known(other, None).moved_to(Known(renamed, None))
    np.testing.assert_array_equal(number >= 0, other.surface == 0)
    counts = random.random(200) < 0.5
    _, number = Known(other, np.ones(200, bool)).moved_to(Known(other, counts))
    np.testing.assert_array_equal(number >= 0, counts)


def _names(things):
    return things.looks, things.owners


def test_stretches_touch_boxes_as_places_along_them_tell():
    random = np.random.default_rng(4)
    low = random.uniform(-1, 1, (5, 3))
    bounds = np.stack((low, low + random.uniform(0.05, 0.4, (5, 3))), axis=1)
    axes, _ = np.linalg.qr(random.normal(size=(3, 3)))
    begin, end = random.uniform(-2, 2, (2, 3000, 3))
    end[:300, 0] = begin[:300, 0]
    end[300:400] = begin[300:400]
    margin = 0.05
    # The same boxes and stretches, turned.
    found = Boxes(axes, bounds).touched(margin, begin @ axes, end @ axes)
    steps = np.linspace(0, 1, 400)[:, None, None]
    for sign in (-1.0, 1.0):
        # Boxes a little smaller and a little larger than they are.
        slack = margin + sign * 0.012
        inside = np.zeros(3000, bool)
        for some in np.array_split(np.arange(3000), 10):
            places = begin[some] + steps * (end - begin)[some]
            for a, b in bounds:
                within = ((places >= a - slack) & (places <= b + slack)).all(axis=2)
                inside[some] |= within.any(axis=0)
        assert np.all(found | ~inside) if sign < 0 else np.all(inside | ~found)
    assert 0.05 < found.mean() < 0.9
