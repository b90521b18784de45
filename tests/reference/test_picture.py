# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures come back in full floats, bottom row first, and the output settings as they were."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from glass_refraction.reference.picture import load_picture, render_picture  # noqa: E402
from glass_refraction.reference.png import write_png  # noqa: E402


def test_a_png_holds_the_picture_with_its_top_row_first(tmp_path):
    picture = np.random.default_rng(3).integers(0, 256, (5, 7, 3)) / 255
    write_png(tmp_path / "a.png", picture)
    image = bpy.data.images.load(str(tmp_path / "a.png"))
    assert tuple(image.size) == (7, 5)
    loaded = np.array(image.pixels[:]).reshape(5, 7, 4)
    bpy.data.images.remove(image)
    assert loaded[..., :3] == pytest.approx(picture, abs=1e-6)
    assert loaded[..., 3].min() == 1


def test_a_png_has_three_channels(tmp_path):
    with pytest.raises(ValueError, match="3 channels is needed, not 4"):
        write_png(tmp_path / "a.png", np.zeros((2, 2, 4)))


FORMATS = [
    {"file_format": "PNG", "color_mode": "RGBA", "color_depth": "16", "compression": 40},
    {"file_format": "JPEG", "color_mode": "BW", "quality": 33},
    {"file_format": "OPEN_EXR", "color_depth": "16", "exr_codec": "PIZ"},
    {"media_type": "MULTI_LAYER_IMAGE", "file_format": "OPEN_EXR_MULTILAYER"},
    {"media_type": "VIDEO", "file_format": "FFMPEG"},
]


@pytest.mark.parametrize("chosen", FORMATS, ids=lambda f: f["file_format"])
def test_a_render_returns_floats_and_restores_the_output(chosen, tmp_path):
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("World")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.1, 3.0, 70.0, 1)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 6, 4
    scene.render.filepath = str(tmp_path / "mine")
    scene.render.use_file_extension = False
    for name, value in chosen.items():
        setattr(scene.render.image_settings, name, value)

    def output():
        return [
            (p.identifier, str(getattr(group, p.identifier)))
            for group in (scene.render, scene.render.image_settings)
            for p in group.bl_rna.properties
            if not p.is_readonly and p.type != "POINTER"
        ]

    before = output()
    images = [i.name for i in bpy.data.images if i.type == "IMAGE"]
    picture = render_picture(scene)
    assert picture.shape == (4, 6, 4) and picture.dtype == np.float32
    assert picture[..., :3] == pytest.approx(np.broadcast_to((0.1, 3.0, 70.0), (4, 6, 3)), rel=1e-6)
    assert output() == before
    assert [i.name for i in bpy.data.images if i.type == "IMAGE"] == images
    assert not list(tmp_path.iterdir())


def test_a_failed_load_leaves_no_image(tmp_path):
    before = len(bpy.data.images)
    with pytest.raises(RuntimeError):
        load_picture(tmp_path / "missing.exr")
    assert len(bpy.data.images) == before
