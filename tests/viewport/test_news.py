# SPDX-License-Identifier: GPL-3.0-or-later
"""What the live view reads anew: the objects that changed, or everything."""

import bpy
import pytest

from glass_refraction.scene import changes
from glass_refraction.viewport import news


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_empty=True)
    for name in ("Thing", "Other"):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    bpy.context.view_layer.update()
    noted = []

    def note(scene, depsgraph):
        news.note(scene, depsgraph, new_frame=False)
        noted.append([update.id.name for update in depsgraph.updates])

    bpy.app.handlers.depsgraph_update_post.append(note)
    yield bpy.context.scene
    bpy.app.handlers.depsgraph_update_post.remove(note)


def test_a_thing_that_moves_is_all_that_changed(scene):
    one = news.news(scene)
    everything, seen = one.everything, one.seen
    thing, other = bpy.data.objects["Thing"], bpy.data.objects["Other"]
    thing.location.x = 1.0
    bpy.context.view_layer.update()
    assert one.objects[thing.session_uid] == one.serial
    assert one.objects.get(other.session_uid, 0) < one.serial
    assert (one.everything, one.seen) == (everything, seen + 1)
    assert one.shape_of(thing) < one.serial


@pytest.mark.parametrize("kind", ["cameras", "speakers"])
def test_what_no_view_shows_may_move_unseen(scene, kind):
    """Else each step of a camera has every capture drawn anew, which shows the same."""
    data = getattr(bpy.data, kind).new("Unseen")
    unseen = bpy.data.objects.new("Unseen", data)
    scene.collection.objects.link(unseen)
    bpy.context.view_layer.update()
    one = news.news(scene)
    before = one.seen
    unseen.location.x = 1.0
    bpy.context.view_layer.update()
    assert one.objects[unseen.session_uid] == one.serial
    assert one.seen == before


def test_a_mesh_that_is_edited_has_another_shape(scene):
    one, thing = news.news(scene), bpy.data.objects["Thing"]
    before = one.shape_of(thing)
    thing.data.vertices[0].co.x = 2.0
    thing.data.update()
    bpy.context.view_layer.update()
    assert one.shape_of(thing) > before


def test_what_is_no_object_may_change_everything(scene):
    one = news.news(scene)
    before = one.everything
    material = bpy.data.materials.new("Glass")
    bpy.data.objects["Thing"].data.materials.append(material)
    bpy.context.view_layer.update()
    material.diffuse_color = (1.0, 0.0, 0.0, 1.0)
    bpy.context.view_layer.update()
    assert one.everything > before


def test_after_undo_everything_and_every_shape_is_new(scene):
    one, thing = news.news(scene), bpy.data.objects["Thing"]
    before = one.shape_of(thing)
    news.forget()
    assert one.everything == one.serial
    assert one.shape_of(thing) > before


@pytest.fixture
def told(scene):
    """Of each evaluation, how often anything changed so far and whether it was an echo."""
    found = []

    def note(scene, depsgraph):
        # The extension's own handlers come first.
        found.append((changes.generation(scene), changes.is_echo(scene)))

    bpy.app.handlers.depsgraph_update_post.append(note)
    yield found
    bpy.app.handlers.depsgraph_update_post.remove(note)


def write_and_put_back(scene):
    """What a capture does with EEVEE's samples."""
    layer = bpy.context.view_layer
    before = scene.eevee.taa_samples
    with changes.put_back(scene, layer):
        layer.depsgraph.scene_eval.eevee.taa_samples = 1
        layer.depsgraph.scene_eval.eevee.taa_samples = before
    return before


def test_a_setting_that_is_put_back_is_no_news(scene, told):
    before = changes.generation(scene)
    samples = write_and_put_back(scene)
    assert scene.eevee.taa_samples == samples
    assert told and told[-1] == (before, True)
    # Nothing of it is left for the next evaluation.
    bpy.context.view_layer.update()
    assert changes.generation(scene) == before and not changes.is_echo(scene)


@pytest.mark.parametrize("late", [False, True])
def test_what_changes_just_before_it_or_after_is_news(scene, told, late):
    """Also a setting of the scene alone, which is all that an echo names."""
    before = changes.generation(scene)
    for _ in range(2):
        if not late:
            scene.render.fps += 1
            scene.update_tag()
        write_and_put_back(scene)
        if late:
            scene.render.fps += 1
            scene.update_tag()
            bpy.context.view_layer.update()
        before += 1
        assert changes.generation(scene) == before
    assert (before, False) in told


def test_a_failure_meanwhile_leaves_no_echo(scene, told):
    with pytest.raises(RuntimeError), changes.put_back(scene, bpy.context.view_layer):
        raise RuntimeError
    assert not changes.is_echo(scene)
