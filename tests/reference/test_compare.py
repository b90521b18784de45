# SPDX-License-Identifier: GPL-3.0-or-later
"""A whole comparison, small: files, figures by the contract, and nothing changed after it."""

import json
from contextlib import closing

import pytest

bpy = pytest.importorskip("bpy")

from glass_refraction.scene import update as door  # noqa: E402
from glass_refraction.scene.names import REFERENCE, RefractiveGlassError, own  # noqa: E402

FIGURES = {
    "psnr_db",
    "flip_mean",
    "max_abs_error",
    "seconds_composite",
    "seconds_reference",
    "reference_samples",
    "reference_noise_psnr_db",
    "vertices",
    "paths",
    "blender_version",
}


@pytest.fixture
def scene():
    """A hollow glass before a wall of light, half of it red."""
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, -0.5, 0)
    camera.rotation_euler = (1.5707963, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    for name, x, colour in (("White", -1, (1, 1, 1, 1)), ("Red", 0, (1, 0, 0, 1))):
        material = bpy.data.materials.new(name)
        tree = material.node_tree
        tree.nodes.clear()
        light = tree.nodes.new("ShaderNodeEmission")
        light.inputs["Color"].default_value = colour
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(light.outputs[0], output.inputs["Surface"])
        wall = bpy.data.objects.new(name, bpy.data.meshes.new(name))
        corners = [(x, 0.2, -1), (x + 1, 0.2, -1), (x + 1, 0.2, 1), (x, 0.2, 1)]
        wall.data.from_pydata(corners, [], [(0, 1, 2, 3)])
        wall.data.materials.append(material)
        scene.collection.objects.link(wall)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.cycles.samples = 2
    scene.cycles.use_denoising = False
    return scene


def add_glass(scene):
    bpy.ops.object.refractive_glass_add(shape="CYLINDER", height=0.6, location=(0.02, 0, -0.3))
    scene.refractive_glass.surface = "REFRACTION"
    scene.refractive_glass.shading = "DISPLACED"


def test_a_comparison_reports_by_the_contract(scene, tmp_path):
    from glass_refraction.reference.compare import compare

    add_glass(scene)
    scene.render.use_border = True
    scene.render.border_min_x = 0.25
    shares = []
    report = compare(scene, tmp_path, samples=4, progress=lambda share, _: shares.append(share))
    assert set(report) >= FIGURES
    assert shares == pytest.approx([0, 1 / 4, 2 / 4, 3 / 4, 1])
    assert report["reference_samples"] == 4 and scene.cycles.samples == 2
    assert report["surface"] == "REFRACTION" and report["paths"] == ["TTTT"]
    assert report["pixels"] == 36 * 32
    assert set(report["regions"]) == {"TTTT"}
    # The same seed: beside the glass the two pictures are one.
    assert report["outside"]["psnr_db"] > 100
    assert report["reference_noise_psnr_db"] < 60
    assert json.loads((tmp_path / "report.json").read_text())["vertices"] == report["vertices"] > 0
    assert not bpy.data.objects["Refractive Glass"].hide_render


def test_a_comparison_with_another_surface_tells_what_that_leaves_out(scene, tmp_path):
    from glass_refraction.reference.compare import compare

    add_glass(scene)
    same, other = (
        compare(scene, tmp_path, samples=16, surface=surface) for surface in (None, "GLASS")
    )
    assert (same["surface"], other["surface"]) == ("REFRACTION", "GLASS")
    assert scene.refractive_glass.surface == "REFRACTION"
    # Beside the glass nothing changes, inside reflections are left out.
    assert other["outside"]["psnr_db"] > 100
    assert other["inside"]["psnr_db"] < same["inside"]["psnr_db"]


def test_what_cannot_be_compared_is_not_rendered(scene, tmp_path):
    from glass_refraction.reference.compare import compare

    with pytest.raises(RefractiveGlassError, match='"Scene" has no refractive glass'):
        compare(scene, tmp_path)
    add_glass(scene)
    scene.refractive_glass.enabled = False
    with pytest.raises(RefractiveGlassError, match='switched off in scene "Scene"'):
        compare(scene, tmp_path)
    scene.camera = None
    with pytest.raises(RefractiveGlassError, match='"Scene" has no camera'):
        compare(scene, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_comparison_that_is_stopped_leaves_the_scene_as_it_was(scene, tmp_path):
    from glass_refraction.reference.compare import comparing

    def kept(block):
        """Renders may make what stands for glasses anew, but nothing of a reference may stay."""
        return not own(block) or own(block, REFERENCE)

    def state():
        names = {
            kind: sorted(b.name for b in getattr(bpy.data, kind) if kept(b))
            for kind in ("scenes", "objects", "meshes", "materials")
        }
        hidden = {o.name: (o.hide_render, o.visible_shadow) for o in scene.objects}
        output = scene.render.filepath, scene.render.image_settings.file_format
        return names, hidden, output, scene.cycles.samples

    add_glass(scene)
    bpy.ops.scene.refractive_glass_update()
    before = state()
    renders = 0
    # At each render in turn, at the listing of paths, and once at its end.
    for stop in range(6):
        with closing(comparing(scene, tmp_path, samples=1)) as steps:
            value = None
            for number in range(stop + 1):
                request = steps.send(value)
                if number == stop:
                    break
                if isinstance(request, bpy.types.Scene):
                    renders += 1
                    value = bpy.ops.render.render(write_still=True, scene=request.name)
                else:
                    value = request()
        assert state() == before, stop
        assert not list(tmp_path.iterdir()), stop
    assert renders == 11


def test_what_timers_do_meanwhile_takes_nothing_of_a_comparison_away(scene, tmp_path):
    from glass_refraction import handlers
    from glass_refraction.reference.compare import comparing

    add_glass(scene)
    bpy.ops.scene.refractive_glass_update()
    with closing(comparing(scene, tmp_path, samples=1)) as steps:
        value = None
        while True:
            request = steps.send(value)
            if isinstance(request, bpy.types.Scene):
                if own(request, REFERENCE):
                    break
                value = bpy.ops.render.render(write_still=True, scene=request.name)
            else:
                value = request()
        # The glasses are hidden now, and a reference stands.
        before = {s.name for s in bpy.data.scenes}
        handlers._asked.add(scene.session_uid)
        assert handlers._serve() == handlers.REST_SECONDS
        door.free_leftovers()
        assert {s.name for s in bpy.data.scenes} == before
        # As saving does.
        door.withdraw(scene)
        assert request.name in bpy.data.scenes
    assert handlers._serve() is None
    assert not any(own(s, REFERENCE) for s in bpy.data.scenes)


def test_a_render_without_a_picture_ends_the_comparison(scene, tmp_path):
    from glass_refraction.reference.compare import comparing

    add_glass(scene)
    with closing(comparing(scene, tmp_path, samples=1)) as steps:
        next(steps)
        with pytest.raises(RuntimeError, match='"Scene" was cancelled'):
            steps.send({"CANCELLED"})
    assert scene.cycles.samples == 2


def test_what_fails_between_steps_leaves_the_scene_as_it_was_at_once(scene, tmp_path):
    """Steps that Python closes some day write to a scene that may be gone by then: a crash."""
    from glass_refraction.reference.compare import comparing
    from glass_refraction.reference.picture import finished

    def failing():
        def fail():
            assert scene.cycles.samples == 1
            raise OSError("the disk is full")

        with closing(comparing(scene, tmp_path, samples=1)) as steps:
            next(steps)
            yield fail

    add_glass(scene)
    # The traceback of the error holds all that goes on.
    with pytest.raises(OSError, match="the disk is full") as kept:
        finished(failing())
    assert kept.tb is not None
    assert scene.cycles.samples == 2
