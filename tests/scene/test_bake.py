# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked frames: the same pictures without the extension, and nothing lost on the way back."""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.bake.baking import Baking
from glass_refraction.scene.bake.playback import baked, is_held
from glass_refraction.scene.build.layers import find_layers
from glass_refraction.scene.names import RefractiveGlassError, own

# What a render farm does: no extension, the file, a part of the range.
PLAIN_RENDER = """
import sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types.Scene, "refractive_glass")
scene = bpy.context.scene
scene.render.filepath = sys.argv[2]
scene.frame_start, scene.frame_end = int(sys.argv[3]), int(sys.argv[4])
bpy.ops.render.render(animation=True)
"""


def _scene(folder, **settings):
    """A wall that moves behind a glass, and a curve before it; saved in the folder."""
    scenes.camera()
    wall = scenes.striped_wall()
    for frame, x in ((1, 0.0), (5, 0.06)):
        wall.location.x = x
        wall.keyframe_insert("location", frame=frame)
    # Renders and viewport differ: what is baked must be what renders see.
    subdivision = wall.modifiers.new("Subdivision", "SUBSURF")
    subdivision.subdivision_type = "SIMPLE"
    subdivision.levels, subdivision.render_levels = 0, 1
    glass = scenes.glass(shape="CYLINDER")
    settings.setdefault("surface", "REFRACTION")
    scene = scenes.settings(**settings)
    scene.frame_start, scene.frame_end = 1, 3
    image = scene.render.image_settings
    image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"
    _save(folder)
    return scene, wall, glass


def _save(folder):
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))


def _bake(**given):
    return bpy.ops.scene.refractive_glass_bake(**given)


def _files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _baked_folder(folder):
    return folder / "scene_bake_Scene"


def _pixels(path):
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels


def _pictures(scene, folder, name, frames=(1, 2, 3)):
    scene.render.filepath = str(folder / f"{name}_")
    scene.frame_start, scene.frame_end = min(frames), max(frames)
    bpy.ops.render.render(animation=True, scene=scene.name)
    return [_pixels(folder / f"{name}_{frame:04d}.exr") for frame in frames]


def _pictures_without_the_extension(folder, name, first, last):
    arguments = [folder / "scene.blend", folder / f"{name}_", first, last]
    subprocess.run(
        [sys.executable, "-c", PLAIN_RENDER, *map(str, arguments)],
        check=True,
        cwd=folder,
        stdout=subprocess.DEVNULL,
    )
    return [_pixels(folder / f"{name}_{frame:04d}.exr") for frame in range(first, last + 1)]


def _counted(action):
    before = door.counters.copy()
    action()
    after = door.counters.copy()
    after.subtract(before)
    return {key: count for key, count in after.items() if count}


@pytest.mark.parametrize(
    ("engine", "shading"),
    [("CYCLES", "DISPLACED"), ("BLENDER_WORKBENCH", "DISPLACED")],
)
def test_the_same_pictures_without_the_extension(tmp_path, engine, shading):
    scene, _, _ = _scene(tmp_path, shading=shading)
    scene.render.engine, scene.display.render_aa = engine, "OFF"
    # Workbench's very first picture of a session differs from all later ones.
    _pictures(scene, tmp_path, "warm")
    live = _pictures(scene, tmp_path, "live")
    assert not np.array_equal(live[0], live[1])
    assert _bake() == {"FINISHED"}
    _save(tmp_path)
    with_extension = []
    assert _counted(lambda: with_extension.extend(_pictures(scene, tmp_path, "with"))) == {}
    # Each part of the range by a Blender of its own; Workbench's first picture counts for nothing.
    first = 1 if engine == "CYCLES" else 0
    parts = _pictures_without_the_extension(tmp_path, "first", first, 2)[-2:]
    parts += _pictures_without_the_extension(tmp_path, "second", first + 2, 3)[-1:]
    for number in range(3):
        np.testing.assert_array_equal(live[number], with_extension[number])
        np.testing.assert_array_equal(live[number], parts[number])


def test_a_cup_and_what_it_holds_without_the_extension(tmp_path):
    """Rays are baked as any own mesh: as many cells as each frame has."""
    scene, _, glass = _scene(tmp_path)
    bpy.data.objects.remove(glass)
    scenes.glass(shape="TUMBLER", radius=0.036, height=0.11, liquid_level=0.06, contents_ior=1.333)
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(0.0, 0.0, 0.06))
    cube = bpy.context.object
    cube.data.materials.append(scenes.emissive("cube", (0.9, 0.6, 0.1)))
    for frame, z in ((1, 0.04), (2, 0.08)):
        cube.location.z = z
        cube.keyframe_insert("location", frame=frame)
    scenes.settings(40, 30, min_weight=0.2)
    _save(tmp_path)
    before = _pictures(scene, tmp_path, "before", frames=(1, 2))
    assert np.abs(before[0] - before[1]).max() > 0.3
    assert _bake(frame_start=1, frame_end=2) == {"FINISHED"}
    _save(tmp_path)
    after = _pictures_without_the_extension(tmp_path, "after", 1, 2)
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


def test_frames_beside_the_range_hold_the_nearest(tmp_path):
    scene, _, _ = _scene(tmp_path)
    scene.render.film_transparent = True
    assert _bake(frame_start=2, frame_end=3) == {"FINISHED"}
    # Beside the glass the wall moves on; through it, where only the baked copy is, nothing does.
    pictures = _pictures(scene, tmp_path, "beside", frames=(0, 1, 2, 3, 4, 5))
    shape = (scene.render.resolution_y, scene.render.resolution_x, 4)
    centre = [p.reshape(shape)[25:35, 38:42] for p in pictures]
    assert not np.array_equal(centre[2], centre[3])
    displaced = find_layers(scene).displaced
    for own_scene in find_layers(scene).all():
        assert own_scene.render.engine == "CYCLES"
    found = {}
    for frame in (0, 1, 2, 3, 4, 5):
        scene.frame_set(frame)
        displaced.frame_set(frame)
        layer = displaced.view_layers[0]
        layer.update()
        copy = next(o for o in layer.objects if own(o, "copy"))
        mesh = copy.evaluated_get(layer.depsgraph).data
        found[frame] = np.array([v.co for v in mesh.vertices])
    for frame, nearest in ((0, 2), (1, 2), (4, 3), (5, 3)):
        np.testing.assert_array_equal(found[frame], found[nearest])
    assert not np.array_equal(found[2], found[3])


def test_a_part_baked_again_replaces_only_its_frames(tmp_path):
    scene, wall, _ = _scene(tmp_path)
    assert _bake() == {"FINISHED"}
    folder = _baked_folder(tmp_path)
    before = _files(folder)
    pictures = _pictures(scene, tmp_path, "before")
    wall.scale.x = 0.9
    assert _bake(frame_start=2, frame_end=2) == {"FINISHED"}
    assert baked(scene).frames == "1-3"
    after = _files(folder)
    for path, data in before.items():
        if path.suffix in {".json", ".exr"} and path.name != "bake.json":
            if path.name != "00002_00000.json":
                assert after[path] == data, path
            elif path.parent.parent.name.startswith("copy_0_0_"):
                # Copies in the slots that no light path needs stay empty.
                assert after[path] != data
    # No array is left that no frame names.
    text = "".join(d.decode() for p, d in after.items() if p.parent.name == "meta")
    assert all(p.name in text for p in after if p.suffix == ".blob")
    wall.scale.x = 1.0
    again = _pictures(scene, tmp_path, "again")
    np.testing.assert_array_equal(pictures[0], again[0])
    np.testing.assert_array_equal(pictures[2], again[2])
    assert not np.array_equal(pictures[1], again[1])


def test_a_gap_between_baked_frames_holds_the_nearest(tmp_path):
    scene, _, _ = _scene(tmp_path)
    _bake(frame_start=1, frame_end=1)
    assert _bake(frame_start=5, frame_end=5) == {"FINISHED"}
    assert baked(scene).frames == "1, 5"
    for meta in _baked_folder(tmp_path).glob("geometry/*/meta"):
        texts = [(meta / f"{frame:05d}_00000.json").read_text() for frame in range(1, 6)]
        assert texts[1] == texts[0]
        assert texts[3] == texts[4]
    for folder in _baked_folder(tmp_path).glob("images/*"):
        assert len(list(folder.glob("*_000[0-5].exr"))) == 6


def test_free_restores_and_removes_only_its_own_files(tmp_path):
    scene, _, glass = _scene(tmp_path)
    live = _pictures(scene, tmp_path, "live")
    names = {(type(b).__name__, b.name) for b in [*scene.objects, *bpy.data.materials]}
    _bake()
    folder = _baked_folder(tmp_path)
    mine = [folder / "notes.txt", next(folder.glob("geometry/*/meta")) / "mine.json"]
    for path in mine:
        path.write_text("mine")
    assert bpy.ops.scene.refractive_glass_bake_free() == {"FINISHED"}
    assert baked(scene) is None
    assert sorted(p for p in folder.rglob("*") if p.is_file()) == sorted(mine)
    for now, then in zip(_pictures(scene, tmp_path, "freed"), live, strict=True):
        np.testing.assert_array_equal(now, then)
    assert {(type(b).__name__, b.name) for b in [*scene.objects, *bpy.data.materials]} == names
    bpy.data.objects.remove(glass)
    door.prepare(scene, scenes.depsgraph())
    kinds = ("scenes", "objects", "collections", "images", "node_groups", "meshes")
    left = [b for k in kinds for b in getattr(bpy.data, k) if own(b) and b.users]
    assert not left


def test_free_leaves_no_folder(tmp_path):
    _scene(tmp_path)
    _bake()
    assert _baked_folder(tmp_path).is_dir()
    bpy.ops.scene.refractive_glass_bake_free()
    assert not _baked_folder(tmp_path).exists()


def test_the_users_scene_is_as_before(tmp_path):
    scene, _, _ = _scene(tmp_path)
    scene.frame_set(2, subframe=0.25)
    render = {
        p.identifier: getattr(scene.render, p.identifier)
        for p in scene.render.bl_rna.properties
        if p.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"}
        if not getattr(p, "is_array", False)
    }
    objects = {o.name: (len(o.modifiers), o.hide_render) for o in scene.objects}
    _bake()
    assert (scene.frame_current, scene.frame_subframe) == (2, 0.25)
    assert {name: getattr(scene.render, name) for name in render} == render
    assert {o.name: (len(o.modifiers), o.hide_render) for o in scene.objects} == objects
    assert not scene.timeline_markers


def test_a_baked_scene_is_not_solved_until_freed(tmp_path):
    scene, wall, _ = _scene(tmp_path)
    _bake()

    def work():
        wall.location.y += 0.05
        bpy.context.view_layer.update()
        assert bpy.ops.scene.refractive_glass_update() == {"FINISHED"}
        scenes.picture(scene, tmp_path)

    assert _counted(work) == {}
    bpy.ops.scene.refractive_glass_bake_free()
    assert _counted(work)["solves"] > 0


def test_a_bake_survives_saving_loading_and_renaming(tmp_path):
    scene, _, _ = _scene(tmp_path)
    live = _pictures(scene, tmp_path, "live")
    _bake()
    scene.name = "Still Life"
    _save(tmp_path)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    assert baked(scene).frames == "1-3"
    for now, then in zip(_pictures(scene, tmp_path, "loaded"), live, strict=True):
        np.testing.assert_array_equal(now, then)
    # Another scene's tidying leaves alone what is played back under another name.
    other = bpy.data.scenes.new("Other")
    door.remove(other)
    for now, then in zip(_pictures(scene, tmp_path, "tidied"), live, strict=True):
        np.testing.assert_array_equal(now, then)
    bpy.ops.scene.refractive_glass_bake_free()
    assert not _baked_folder(tmp_path).exists()
    assert find_layers(scene) is not None
    assert len([s for s in bpy.data.scenes if own(s)]) == len(find_layers(scene).all())


def test_cameras_are_switched_by_markers_without_the_extension(tmp_path):
    scene, _, _ = _scene(tmp_path)
    first = scene.camera
    second = scenes.camera(location=(0.05, -0.45, 0.09))
    for frame, camera in ((1, first), (2, second)):
        scene.timeline_markers.new(camera.name, frame=frame).camera = camera
    scene.frame_set(1)
    live = _pictures(scene, tmp_path, "live")
    assert _bake() == {"FINISHED"}
    _save(tmp_path)
    plain = _pictures_without_the_extension(tmp_path, "plain", 1, 3)
    for now, then in zip(plain, live, strict=True):
        np.testing.assert_array_equal(now, then)


def test_curves_and_instances_are_baked(tmp_path):
    scene, _, _ = _scene(tmp_path)
    bpy.ops.object.text_add(location=(-0.02, 0.1, 0.05), rotation=(np.pi / 2, 0, 0))
    text = bpy.context.object
    text.data.size = 0.05
    text.data.materials.append(scenes.emissive("letters", (1.0, 1.0, 0.2)))
    for frame, x in ((1, -0.02), (3, 0.01)):
        text.location.x = x
        text.keyframe_insert("location", frame=frame)
    group = bpy.data.collections.new("Cubes")
    bpy.ops.mesh.primitive_cube_add(size=0.02, location=(0, 0, 0))
    cube = bpy.context.object
    cube.data.materials.append(scenes.emissive("cube", (0.1, 0.9, 0.9)))
    group.objects.link(cube)
    scene.collection.objects.unlink(cube)
    empty = bpy.data.objects.new("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.location = (0.01, 0.12, 0.11)
    scene.collection.objects.link(empty)
    live = _pictures(scene, tmp_path, "live")
    assert _bake() == {"FINISHED"}
    _save(tmp_path)
    plain = _pictures_without_the_extension(tmp_path, "plain", 1, 3)
    for now, then in zip(plain, live, strict=True):
        np.testing.assert_array_equal(now, then)


def test_materials_read_the_same_attributes(tmp_path):
    """Two UV maps of which the second counts, a colour, Generated coordinates, a driven value."""
    scene, wall, _ = _scene(tmp_path)
    mesh = wall.data
    rng = np.random.default_rng(4)
    for name in ("First", "Second"):
        layer = mesh.uv_layers.new(name=name)
        layer.uv.foreach_set("vector", rng.random(2 * len(mesh.loops)).astype(np.float32))
    mesh.uv_layers["Second"].active_render = True
    colour = mesh.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    colour.data.foreach_set("color", rng.random(4 * len(mesh.loops)).astype(np.float32))
    mesh.attributes.new("Height", "FLOAT", "POINT").data.foreach_set(
        "value", rng.random(len(mesh.vertices)).astype(np.float32)
    )
    for number, slot in enumerate(wall.material_slots):
        tree = slot.material.node_tree
        emission = next(n for n in tree.nodes if n.type == "EMISSION")
        if number == 0:
            value = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        elif number == 1:
            attribute = tree.nodes.new("ShaderNodeAttribute")
            attribute.attribute_name = "Paint"
            value = attribute.outputs["Color"]
        else:
            noise = tree.nodes.new("ShaderNodeTexNoise")
            height = tree.nodes.new("ShaderNodeAttribute")
            height.attribute_name = "Height"
            tree.links.new(height.outputs["Fac"], noise.inputs["Distortion"])
            value = noise.outputs["Color"]
        tree.links.new(value, emission.inputs["Color"])
    drawn = _pictures(scene, tmp_path, "drawn")
    assert _bake() == {"FINISHED"}
    for now, then in zip(_pictures(scene, tmp_path, "now"), drawn, strict=True):
        np.testing.assert_array_equal(now, then)


def _bake_one(baking):
    frame = baking.frame
    next((step for step in baking.steps() if baking.frame != frame), None)


def test_cancelling_leaves_everything_as_it_was(tmp_path):
    scene, _, _ = _scene(tmp_path)
    _bake(frame_start=1, frame_end=2)
    before = _files(_baked_folder(tmp_path))
    pictures = _pictures(scene, tmp_path, "before", frames=(1, 2))
    baking = Baking(scene, scenes.depsgraph(), "", 2, 3)
    _bake_one(baking)
    baking.cancel()
    assert _files(_baked_folder(tmp_path)) == before
    assert baked(scene).frames == "1-2"
    for now, then in zip(_pictures(scene, tmp_path, "after", (1, 2)), pictures, strict=True):
        np.testing.assert_array_equal(now, then)


def test_cancelling_the_first_bake_leaves_no_file(tmp_path):
    scene, _, _ = _scene(tmp_path)
    baking = Baking(scene, scenes.depsgraph(), "", 1, 3)
    _bake_one(baking)
    assert _baked_folder(tmp_path).is_dir()
    baking.cancel()
    assert not _baked_folder(tmp_path).exists()
    assert baked(scene) is None
    assert _counted(lambda: scenes.picture(scene, tmp_path))["solves"] > 0


def test_a_frame_in_parts_is_the_frame_at_once(tmp_path, monkeypatch):
    scene, _, _ = _scene(tmp_path)
    scene.render.use_motion_blur = True
    for x in (-0.02, 0.02):
        bpy.ops.mesh.primitive_cube_add(size=0.02, location=(x, 0.1, 0.06))
    at_once = _counted(lambda: _bake(frame_start=2, frame_end=2))["solves"]
    (picture,) = _pictures(scene, tmp_path, "whole", (2,))
    monkeypatch.setattr("glass_refraction.scene.bake.baking.RENDER_SECONDS", 0.0)
    baking = Baking(scene, scenes.depsgraph(), "", 2, 2)
    steps = []
    assert _counted(lambda: steps.extend(baking.steps()))["solves"] == at_once
    shares = [step.share for step in steps]
    assert len(shares) > 2 and shares == sorted(shares)
    baking.finish()
    np.testing.assert_array_equal(_pictures(scene, tmp_path, "parts", (2,))[0], picture)


def test_nobody_bakes_or_updates_while_a_render_goes_on(tmp_path, monkeypatch):
    scene, _, _ = _scene(tmp_path)
    monkeypatch.setattr("glass_refraction.ui.stepwise.holds_data", lambda: True)
    for operator in (_bake, bpy.ops.scene.refractive_glass_update):
        with pytest.raises(RuntimeError, match="wait for its end"):
            operator()
    assert not is_held(scene)
    assert find_layers(scene) is None


def test_nobody_prepares_a_scene_that_is_being_baked(tmp_path):
    scene, _, glass = _scene(tmp_path)
    baking = Baking(scene, scenes.depsgraph(), "", 1, 3)
    _bake_one(baking)
    glass.location.x += 0.01
    found = _counted(lambda: door.prepare(scene, scenes.depsgraph()))
    assert found == {}
    baking.cancel()


def test_frames_that_no_longer_fit_go(tmp_path):
    scene, _, _ = _scene(tmp_path)
    _bake()
    scene.render.resolution_x += 8
    baking = Baking(scene, scenes.depsgraph(), "", 2, 2)
    _bake_one(baking)
    assert baking.dropped == [1, 3]
    baking.finish()
    assert baked(scene).frames == "2"
    for meta in _baked_folder(tmp_path).glob("geometry/*/meta"):
        # The other frames hold the one that there is.
        assert len({p.read_text() for p in meta.iterdir()}) == 1


def test_what_no_longer_fits_is_said(tmp_path):
    scene, _, _ = _scene(tmp_path)
    _bake()
    scene.render.resolution_x += 8
    scene.refractive_glass.shading = "TRUE"
    door.prepare(scene, scenes.depsgraph())
    said = " ".join(door.status(scene).problems)
    assert "Baked for 80 x 60" in said
    assert "Baked for shading Displaced" in said
    for path in _baked_folder(tmp_path).glob("bake.json"):
        path.unlink()
    door.prepare(scene, scenes.depsgraph())
    assert "missing" in " ".join(door.status(scene).problems)


def test_an_unsaved_file_is_told_so():
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    scenes.settings()
    with pytest.raises(RuntimeError, match="not been saved"):
        _bake()


def test_an_unsaved_file_may_name_a_folder(tmp_path):
    scenes.camera()
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    scene = scenes.settings(surface="REFRACTION")
    assert _bake(directory=str(tmp_path / "bake"), frame_start=1, frame_end=1) == {"FINISHED"}
    assert Path(baked(scene).directory) == tmp_path / "bake"


def test_paths_are_relative_to_the_file(tmp_path):
    scene, _, _ = _scene(tmp_path)
    assert _bake(directory=str(tmp_path / "sub" / "bake")) == {"FINISHED"}
    assert baked(scene).directory == "//sub/bake"
    for image in bpy.data.images:
        if own(image, "weights"):
            assert image.filepath.startswith("//sub/bake/images/")
    for obj in bpy.data.objects:
        for modifier in obj.modifiers if own(obj) else ():
            assert all(b.directory.startswith("//sub/bake/geometry/") for b in modifier.bakes)


def test_another_scenes_bake_is_not_overwritten(tmp_path):
    scene, _, _ = _scene(tmp_path)
    _bake(directory="//bake")
    before = _files(tmp_path / "bake")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "second.blend"))
    with pytest.raises(RuntimeError, match=r"holds the bake of scene \"Scene\" of scene.blend"):
        _bake()
    # Nor are its files removed by a copy of the file.
    bpy.ops.scene.refractive_glass_bake_free()
    assert baked(scene) is None
    assert _files(tmp_path / "bake") == before


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"frame_start": 3, "frame_end": 2}, "Frames 3 to 2"),
        ({"directory": "//scene.blend"}, "cannot be made"),
    ],
)
def test_bad_input_is_one_line_and_changes_nothing(tmp_path, values, message):
    scene, _, _ = _scene(tmp_path)
    with pytest.raises(RuntimeError, match=message):
        _bake(**values)
    assert baked(scene) is None
    assert scene.frame_current == 1
    assert [p.name for p in tmp_path.iterdir() if p.suffix != ".blend1"] == ["scene.blend"]


def test_a_scene_that_cannot_be_prepared_keeps_its_bake(tmp_path):
    scene, _, _ = _scene(tmp_path)
    pictures = _pictures(scene, tmp_path, "live")
    _bake()
    camera, scene.camera = scene.camera, None
    with pytest.raises(RuntimeError, match="no camera"):
        _bake()
    scene.camera = camera
    assert baked(scene).frames == "1-3"
    for now, then in zip(_pictures(scene, tmp_path, "still"), pictures, strict=True):
        np.testing.assert_array_equal(now, then)


def test_prepare_raises_no_error_for_a_baked_scene_without_glass(tmp_path):
    scene, _, glass = _scene(tmp_path)
    _bake()
    bpy.data.objects.remove(glass)
    door.prepare(scene, scenes.depsgraph())
    assert baked(scene) is not None
    with pytest.raises(RefractiveGlassError, match="no refractive glass"):
        Baking(scene, scenes.depsgraph(), "", 1, 1)
    assert baked(scene) is not None


@pytest.mark.in_turn(2)
@pytest.mark.parametrize("position", ["CENTER", "START"])
def test_motion_blur_without_the_extension(tmp_path, position, capfd):
    scene, _, _ = _scene(tmp_path, shading="DISPLACED", samples=8)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.03, location=(0, 0.1, 0.06))
    ball = bpy.context.object
    ball.data.materials.append(scenes.emissive("ball", (1.0, 1.0, 0.2)))
    for frame, x in ((1, -0.02), (5, 0.02)):
        ball.location.x = x
        ball.keyframe_insert("location", frame=frame)
    still = _pictures(scene, tmp_path, "still")
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 0.5
    scene.render.motion_blur_position = position
    live = _pictures(scene, tmp_path, "live")
    assert not np.array_equal(still[1], live[1])
    assert _bake() == {"FINISHED"}
    _save(tmp_path)
    plain = _pictures_without_the_extension(tmp_path, "plain", 1, 3)
    for now, then in zip(plain, live, strict=True):
        np.testing.assert_array_equal(now, then)
    assert "Error" not in capfd.readouterr().err
    # Baked again without, the moments beside the frames are gone.
    scene.render.use_motion_blur = False
    assert _bake() == {"FINISHED"}
    times = {p.stem for p in _baked_folder(tmp_path).rglob("meta/*.json")}
    assert times == {f"{frame:05d}_00000" for frame in range(5)}
    for now, then in zip(_pictures(scene, tmp_path, "again"), still, strict=True):
        np.testing.assert_array_equal(now, then)


@pytest.mark.parametrize("place", ["GeometryWriter.write", "attach"])
def test_a_failure_leaves_no_scene_in_the_middle_of_a_bake(tmp_path, monkeypatch, place):
    scene, _, _ = _scene(tmp_path)

    def fail(*_):
        raise ArithmeticError("for the test")

    with monkeypatch.context() as patch:
        patch.setattr(f"glass_refraction.scene.bake.baking.{place}", fail)
        with pytest.raises(RuntimeError, match="for the test"):
            _bake()
    assert not is_held(scene)
    assert scene.frame_current == 1
    assert scene.render.engine == "CYCLES"
    if place != "attach":
        assert not _baked_folder(tmp_path).exists()
    assert _bake() == {"FINISHED"}
    assert baked(scene).frames == "1-3"


def test_true_shading_cannot_be_baked_and_nothing_is_changed(tmp_path):
    scene, _, _ = _scene(tmp_path, shading="TRUE")
    before = [block.name for kind in ("scenes", "images") for block in getattr(bpy.data, kind)]
    with pytest.raises(RuntimeError, match=r"True shading.*cannot be baked: choose Displaced"):
        _bake()
    after = [block.name for kind in ("scenes", "images") for block in getattr(bpy.data, kind)]
    assert after == before
    assert not _baked_folder(tmp_path).exists()
    assert baked(scene) is None
    scene.refractive_glass.shading = "DISPLACED"
    assert _bake() == {"FINISHED"}
