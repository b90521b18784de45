# SPDX-License-Identifier: GPL-3.0-or-later
"""What an image's alpha cuts out of a surface: rays pass there, as if the mesh had the hole."""

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.scene import update as door
from glass_refraction.scene.rays.hits import Scene
from glass_refraction.scene.rays.things import Met, read_things
from glass_refraction.scene.read.cutouts import Cutout, Mask, cutout_of

SIZE = 64
"""Pixels of the images, a side."""


def _image(alpha, **given):
    """A packed image whose alpha (H, W) is given and whose colour is as light as that."""
    height, width = alpha.shape
    image = bpy.data.images.new("Cut", width, height, alpha=True, **given)
    pixels = np.repeat(alpha[..., None], 4, axis=2).astype(np.float32)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def _right_half():
    alpha = np.zeros((SIZE, SIZE))
    alpha[:, SIZE // 2 :] = 1.0
    return alpha


class Nodes:
    """A material's tree, for short."""

    def __init__(self, rgb=(0.9, 0.3, 0.1)):
        self.material = bpy.data.materials.new("Cut")
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.end = self.new("OutputMaterial")
        self.image = self.new("TexImage")
        self.light = self.new("Emission")
        self.light.inputs["Color"].default_value = (*rgb, 1.0)

    def new(self, kind, **values):
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in values.items():
            setattr(node, name, value)
        return node

    def link(self, output, wanted):
        self.tree.links.new(output, wanted)

    def mixed(self, factor, *, clear_first=True):
        """A mix of light and nothing, with an output as its factor."""
        mix, clear = self.new("MixShader"), self.new("BsdfTransparent")
        both = (clear, self.light) if clear_first else (self.light, clear)
        for number, shader in enumerate(both, 1):
            self.link(shader.outputs[0], mix.inputs[number])
        self.link(factor, mix.inputs[0])
        self.link(mix.outputs[0], self.end.inputs["Surface"])
        return self.material


def _principled(nodes):
    shader = nodes.new("BsdfPrincipled")
    nodes.link(nodes.image.outputs["Alpha"], shader.inputs["Alpha"])
    nodes.link(shader.outputs[0], nodes.end.inputs["Surface"])


def _mixed(nodes):
    nodes.mixed(nodes.image.outputs["Alpha"])


def _turned_round(nodes):
    turned = nodes.new("Math", operation="SUBTRACT")
    turned.inputs[0].default_value = 1.0
    nodes.link(nodes.image.outputs["Alpha"], turned.inputs[1])
    nodes.mixed(turned.outputs[0], clear_first=False)


def _by_colour(nodes):
    above, reroute = (
        nodes.new("Math", operation="GREATER_THAN"),
        nodes.tree.nodes.new("NodeReroute"),
    )
    above.inputs[1].default_value = 0.6
    nodes.link(nodes.image.outputs["Color"], reroute.inputs[0])
    nodes.link(reroute.outputs[0], above.inputs[0])
    nodes.mixed(above.outputs[0])


def _mapped(nodes):
    place, moved = nodes.new("TexCoord"), nodes.new("Mapping")
    # Half a turn and a move by the whole image: right is left, and it is repeated.
    moved.inputs["Rotation"].default_value[2] = np.pi
    moved.inputs["Scale"].default_value[0] = -1.0
    nodes.link(place.outputs["UV"], moved.inputs[0])
    nodes.link(moved.outputs[0], nodes.image.inputs[0])
    _mixed(nodes)


def _fence(nodes):
    """A plane that faces -y, 1 m wide, and a wall behind it."""
    bpy.ops.mesh.primitive_plane_add(size=1.0, rotation=(np.pi / 2, 0, 0))
    fence = bpy.context.object
    fence.data.materials.append(nodes.material)
    bpy.ops.mesh.primitive_plane_add(size=4.0, location=(0, 1, 0), rotation=(np.pi / 2, 0, 0))
    return fence


class _Straight:
    """Meets the triangles of two walls across y, by closed form: the nearer one, then the other."""

    def __init__(self, things):
        self.things = things
        self.y = things.points[things.triangles].mean(axis=1)[:, 1]

    def cast(self, origins, directions):
        distance, triangle = np.full(len(origins), np.inf), np.full(len(origins), -1)
        for number, corners in enumerate(self.things.points[self.things.triangles][..., ::2]):
            (a, b, c), place = corners, origins[:, ::2]
            sides = [
                (q[0] - p[0]) * (place[:, 1] - p[1]) - (q[1] - p[1]) * (place[:, 0] - p[0])
                for p, q in ((a, b), (b, c), (c, a))
            ]
            inside = (np.array(sides) >= 0.0).all(axis=0) | (np.array(sides) <= 0.0).all(axis=0)
            way = self.y[number] - origins[:, 1]
            better = inside & (way > 0.0) & (way < distance)
            distance[better], triangle[better] = way[better], number
        return distance, triangle


@pytest.mark.parametrize(
    "make", [_principled, _mixed, _turned_round, _by_colour, _mapped], ids=lambda f: f.__name__[1:]
)
def test_rays_pass_where_alpha_is_nil(make):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    nodes.image.image = _image(_right_half())
    make(nodes)
    _fence(nodes)
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "CYCLES", {})
    # Beside the middle and the outer edges alpha is interpolated.
    x = np.concatenate((np.linspace(-0.47, -0.02, 40), np.linspace(0.02, 0.47, 40)))
    origins = np.stack((x, np.full(80, -1.0), np.linspace(-0.4, 0.4, 80)), axis=1)
    directions = np.tile((0.0, 1.0, 0.0), (80, 1))
    scene = Scene(_Straight(things), things, None, skin=1e-6)
    distance, _ = scene.caster.cast(origins, directions)
    assert distance == pytest.approx(np.where(x < 0.0, 2.0, 1.0))


def _culled(nodes):
    nodes.material.use_backface_culling = True
    return "BLENDER_EEVEE", 1.0


def _by_backfacing(nodes):
    nodes.mixed(nodes.new("NewGeometry").outputs["Backfacing"], clear_first=False)
    return "CYCLES", 1.0


def _only_behind(nodes):
    nodes.mixed(nodes.new("NewGeometry").outputs["Backfacing"])
    return "CYCLES", -1.0


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
@pytest.mark.parametrize(
    "make", [_culled, _by_backfacing, _only_behind], ids=lambda f: f.__name__[1:]
)
def test_rays_pass_what_shows_its_other_side_alone(make, mirrored):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    engine, side = make(nodes)
    fence = _fence(nodes)
    fence.scale.x = mirrored
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), engine, {})
    outwards = fence.matrix_world.to_3x3().inverted().transposed() @ fence.data.polygons[0].normal
    scene = Scene(_Straight(things), things, None, skin=1e-6)
    distance, _ = scene.caster.cast(np.array([(0.1, -1.0, 0.2)]), np.array([(0.0, 1.0, 0.0)]))
    assert distance[0] == pytest.approx(1.0 if side * outwards.y < 0.0 else 2.0)


def test_what_is_not_understood_is_there():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    nodes.image.image = _image(_right_half())
    _mixed(nodes)
    assert cutout_of(nodes.material, {}) is not None
    wave = nodes.new("TexWave")
    nodes.link(wave.outputs["Color"], nodes.image.inputs[0])
    assert cutout_of(nodes.material, {}) is None
    nodes.image.image = None
    assert cutout_of(nodes.material, {}) is None
    assert cutout_of(None, {}) is None


def _volume(nodes):
    nodes.link(nodes.new("VolumeScatter").outputs[0], nodes.end.inputs["Volume"])


def _clear(nodes):
    nodes.link(nodes.new("BsdfTransparent").outputs[0], nodes.end.inputs["Surface"])


def _faded(nodes):
    shader = nodes.new("BsdfPrincipled")
    shader.inputs["Alpha"].default_value = 0.0
    nodes.link(shader.outputs[0], nodes.end.inputs["Surface"])


def _mixed_away(nodes):
    one = nodes.new("Value")
    nodes.mixed(one.outputs[0], clear_first=False)
    mix = next(n for n in nodes.tree.nodes if n.type == "MIX_SHADER")
    nodes.tree.links.remove(mix.inputs[0].links[0])
    mix.inputs[0].default_value = 1.0


@pytest.mark.parametrize(
    "make", [_volume, _clear, _faded, _mixed_away], ids=lambda f: f.__name__[1:]
)
def test_what_has_no_surface_is_not_met(make):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    make(nodes)
    fence = _fence(nodes)
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "CYCLES", {})
    assert fence.name not in things.owners
    assert len(things.triangles) == 2
    # Workbench draws them.
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "BLENDER_WORKBENCH", {})
    assert len(things.triangles) == 4


def test_an_opaque_image_cuts_nothing_out():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    nodes.image.image = _image(np.ones((8, 8)))
    _mixed(nodes)
    assert cutout_of(nodes.material, {}) is None


@pytest.mark.parametrize(
    ("extension", "wanted"),
    [
        # At u = −0.75, −0.25, 0.25, 0.75, 1.25, 1.75 of an image whose left half is clear.
        ("REPEAT", (1, 0, 1, 0, 1, 0)),
        ("EXTEND", (1, 1, 1, 0, 0, 0)),
        ("CLIP", (1, 1, 1, 0, 1, 1)),
        ("MIRROR", (0, 1, 1, 0, 0, 1)),
    ],
)
@pytest.mark.parametrize("is_smooth", [False, True])
def test_beside_the_image(extension, wanted, is_smooth):
    mask = Mask.of(_right_half() == 0.0)
    cutout = Cutout("", mask, extension, np.eye(2, 3), is_smooth)
    u = np.array((-0.75, -0.25, 0.25, 0.75, 1.25, 1.75))
    assert list(cutout.clears(np.stack((u, np.full(6, 0.5)), axis=1)).astype(int)) == list(wanted)


def test_places_on_the_map_are_those_of_the_mesh():
    """Of any triangles: the mapped place is the same mix of the corners as the place in space."""
    rng = np.random.default_rng(3)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    nodes = Nodes()
    nodes.image.image = _image(_right_half())
    _mixed(nodes)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=9, ring_count=7)
    bpy.context.object.data.materials.append(nodes.material)
    things = read_things(scenes.depsgraph(), frozenset(), frozenset(), "CYCLES", {})
    triangle = rng.integers(len(things.triangles), size=200)
    part = rng.dirichlet(np.ones(3), 200)
    point = np.einsum("nk,nkd->nd", part, things.points[things.triangles[triangle]])
    direction = rng.normal(size=(200, 3))
    met = Met(triangle, np.full(200, 2.0), point - 2.0 * direction, direction)
    wanted = np.einsum("nk,nkd->nd", part, things.uv[things.uv_row[triangle]])
    assert things.mapped(met) == pytest.approx(wanted, abs=1e-6)


def _glazed(cut):
    """A fence before a wall, in and behind a glass; cut by an image, or its mesh is."""
    scene = scenes.settings(96, 72, samples=16, shading="TRUE")
    scene.render.engine = "CYCLES"
    scenes.camera(location=(0.0, -0.5, 0.09))
    scenes.striped_wall()
    scenes.glass(shape="CYLINDER")
    nodes = Nodes()
    nodes.image.image = _image(_right_half())
    nodes.image.interpolation = "Closest"
    nodes.mixed(nodes.image.outputs["Alpha"])
    for y in (-0.08, 0.12):
        bpy.ops.mesh.primitive_plane_add(
            size=0.12, location=(0, y, 0.08), rotation=(np.pi / 2, 0, 0)
        )
        fence = bpy.context.object
        if cut == "mesh":
            # Its right half alone.
            for vertex in fence.data.vertices:
                vertex.co.x = max(vertex.co.x, 0.0)
            material = scenes.emissive("Cut", nodes.light.inputs["Color"].default_value[:3])
            fence.data.materials.append(material)
        else:
            fence.data.materials.append(nodes.material)
    return scene


def test_a_hole_by_an_image_is_like_one_of_the_mesh(tmp_path):
    found = []
    for cut in ("mesh", "image"):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        found.append(scenes.picture(_glazed(cut), tmp_path, cut)[..., :3])
    wanted, shown = found
    assert np.abs(shown - wanted).mean() < 0.003
    assert (np.abs(shown - wanted).max(axis=2) > 0.1).mean() < 0.01


def test_a_frame_in_which_the_image_moved_is_the_frame_alone(tmp_path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = _glazed("image")
    tree = bpy.data.materials["Cut"].node_tree
    image = next(n for n in tree.nodes if n.type == "TEX_IMAGE")
    moved, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeUVMap")
    tree.links.new(place.outputs[0], moved.inputs[0])
    tree.links.new(moved.outputs[0], image.inputs[0])
    pictures = []
    for shift in (0.0, 0.25):
        moved.inputs["Location"].default_value[0] = shift
        pictures.append(scenes.picture(scene, tmp_path, f"moved_{shift}"))
    assert np.abs(pictures[1] - pictures[0]).mean() > 0.005
    door.forget()
    alone = scenes.picture(scene, tmp_path, "alone")
    assert np.abs(alone - pictures[1]).max() < 1e-3
