# SPDX-License-Identifier: GPL-3.0-or-later
"""What the demo scenes share: an empty file, engine settings, materials, camera, light, saving.

All lengths are metres and all angles radians. Every picture and mesh is computed here, so the
scenes are free of outside material (CC0).

Textures use UV coordinates only: a copy seen through a glass keeps its UVs, whereas Object and
Generated coordinates would follow the displaced vertices and slide over the surface.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector

FOLDER = Path(__file__).resolve().parent
RESOLUTION = (800, 600)
SAMPLES = 64
THICKNESS = 0.01
"""Metres: how thick EEVEE takes things for where it traces light on the screen. Its own 0.25 is
more than these scenes' glasses are large, and darkens walls round what stands before them."""

Colour = tuple[float, float, float]
"""Linear red, green, blue."""

ColourNodes = Callable[[bpy.types.NodeTree, bpy.types.NodeSocket], bpy.types.NodeSocket]
"""Adds the nodes of a texture to a tree: takes the UV socket, returns the colour socket."""


# --- file and engine -----------------------------------------------------------------------------


def empty_scene(name: str) -> bpy.types.Scene:
    """Drop whatever is loaded and return the empty scene, set up for a Cycles picture.

    800 x 600, 64 samples on the CPU. Neither denoising nor adaptive sampling, because both would
    blur or vary the noise that ``compare`` measures; the Standard view keeps colours linear up to
    the sRGB curve, so that PSNR figures mean the same in every scene.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = RESOLUTION
    render.resolution_percentage = 100
    render.image_settings.file_format = "PNG"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.eevee.fast_gi_thickness_near = THICKNESS
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.unit_settings.system = "METRIC"
    return scene


def save(path: str | Path) -> Path:
    """Write the loaded file to ``path``, compressed, without a backup copy beside it."""
    path = Path(path).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    # Blender would otherwise move the old file to NAME.blend1.
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    return path


def run(
    name: str, build: Callable[..., bpy.types.Scene], arguments: Sequence[str] | None = None
) -> int:
    """Command line of a demo script: build the scene and write its .blend file."""
    parser = argparse.ArgumentParser(
        prog=f"{name}.py", description=f"Build the demo scene '{name}' and write it as .blend."
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="default: beside the script")
    parser.add_argument("--unlit", action="store_true", help="emissive materials, no light")
    parser.add_argument("--no-glass", action="store_true", help="leave the refractive glass out")
    options = parser.parse_args(arguments)
    output = options.output or FOLDER / (
        f"{name}_unlit.blend" if options.unlit else f"{name}.blend"
    )
    build(unlit=options.unlit, with_glass=not options.no_glass)
    print(f"wrote {save(output)}")
    return 0


def register_extension() -> None:
    """Make the extension's operators available (a no-op where it is installed or registered)."""
    if hasattr(bpy.types, "OBJECT_OT_refractive_glass_add"):
        return
    sys.path.insert(0, str(FOLDER.parent))
    import glass_refraction

    glass_refraction.register()


# --- objects -------------------------------------------------------------------------------------


def link(scene: bpy.types.Scene, name: str, data: bpy.types.ID | None) -> bpy.types.Object:
    """Return a new object of ``scene`` that shows ``data``."""
    obj = bpy.data.objects.new(name, data)
    scene.collection.objects.link(obj)
    return obj


def place(obj: bpy.types.Object, position: Sequence[float], rotation: Matrix | Quaternion) -> None:
    """Put ``obj`` at ``position`` (metres), turned by ``rotation``, with a scale of exactly one.

    Assigning ``matrix_world`` would leave rounding errors in the scale.
    """
    obj.location = position
    obj.rotation_euler = rotation.to_euler()


def settle(scene: bpy.types.Scene, frame: int) -> None:
    """Go to ``frame`` and bring all matrices up to date, as they will be when the file is read."""
    scene.frame_set(frame)


SAMPLE_LIMIT = 10.0
"""Radiance; Blender limits indirect light to as much by default."""


def limit_samples(scene: bpy.types.Scene) -> None:
    """Limit what one sample brings of the sun.

    One in thousands finds the sun's mirror images in small curves of glass: without a limit Cycles'
    own picture of such a glass has a white dot wherever one did.
    """
    scene.cycles.sample_clamp_direct = SAMPLE_LIMIT


def settle_cup(scene: bpy.types.Scene, frame: int, *, unlit: bool) -> None:
    """End a scene with a cup: its settings for being unlit or not, then :func:`settle`."""
    scene.refractive_glass.shading = "DISPLACED" if unlit else "TRUE"
    scene.refractive_glass.surface = "REFRACTION" if unlit else "GLASS"
    settle(scene, frame)


def activate(obj: bpy.types.Object) -> None:
    """Make ``obj`` the active and the only selected object, as the operators expect."""
    view_layer = bpy.context.view_layer
    for other in view_layer.objects:
        other.select_set(other == obj)
    view_layer.objects.active = obj


def mesh(
    name: str,
    positions: np.ndarray,
    faces: Sequence[Sequence[int]],
    *,
    uv: np.ndarray | None = None,
    materials: Sequence[bpy.types.Material] = (),
    material_index: np.ndarray | None = None,
    smooth: bool = False,
) -> bpy.types.Mesh:
    """Return a mesh from arrays.

    ``positions`` (V, 3) in metres, ``faces`` as vertex indices counter-clockwise seen from
    outside, ``uv`` (corners, 2) in the order of the faces' corners, ``material_index`` (faces,).
    """
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.asarray(positions, dtype=np.float64).tolist(), [], [*faces])
    if uv is not None:
        layer = data.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", np.ascontiguousarray(uv, dtype=np.float32).ravel())
    for material in materials:
        data.materials.append(material)
    if material_index is not None:
        data.polygons.foreach_set(
            "material_index", np.ascontiguousarray(material_index, dtype=np.int32)
        )
    if smooth:
        data.shade_smooth()
    data.update()
    return data


def quad(
    name: str, corner: Sequence[float], side_u: Sequence[float], side_v: Sequence[float]
) -> bpy.types.Mesh:
    """Return a rectangle with a corner and two sides (metres); its UVs are metres as well.

    The normal is ``side_u`` x ``side_v``.
    """
    corner, side_u, side_v = (np.asarray(v, dtype=np.float64) for v in (corner, side_u, side_v))
    width, height = np.linalg.norm(side_u), np.linalg.norm(side_v)
    positions = np.array([corner, corner + side_u, corner + side_u + side_v, corner + side_v])
    uv = np.array([(0, 0), (width, 0), (width, height), (0, height)])
    return mesh(name, positions, [(0, 1, 2, 3)], uv=uv)


def table_before_wall(
    scene: bpy.types.Scene,
    edge: float,
    distance: float,
    height: float,
    tiles: ColourNodes,
    *,
    unlit: bool,
) -> None:
    """A wooden table from y = ``edge`` to a wall at y = ``distance``, both a metre wide.

    ``height``: z of the table's top and the wall's foot, metres.
    """
    table = quad("Table", (0.5, edge, height), (0.0, distance - edge, 0.0), (-1.0, 0.0, 0.0))
    grain = wood((0.50, 0.31, 0.16), (0.36, 0.20, 0.09))
    table.materials.append(material("Table wood", grain, unlit=unlit))
    link(scene, "Table", table)
    wall = quad("Wall", (-0.5, distance, height), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    wall.materials.append(material("Wall tiles", tiles, unlit=unlit))
    link(scene, "Wall", wall)


def glass_of_water(
    radius: float,
    wall: float,
    height: float,
    bottom: float,
    level: float,
    ior: float,
    water: float,
) -> bpy.types.Object:
    """Stand a glass of water at the origin, by the extension's operator, and return it."""
    register_extension()
    bpy.ops.object.refractive_glass_add(
        shape="TUMBLER",
        radius=radius,
        wall_thickness=wall,
        height=height,
        bottom_thickness=bottom,
        liquid_level=level,
        ior=ior,
        contents_ior=water,
    )
    glass = bpy.context.active_object
    glass.name = "Glass"
    return glass


def own_mesh_glass(
    obj: bpy.types.Object, ior: float, *, abbe: float = 0.0, priority: int = 0
) -> bpy.types.Object:
    """Make ``obj`` a glass of its own mesh, by the extension's operator, and return it."""
    register_extension()
    from glass_refraction.scene.read.glasses import glass_modifier
    from glass_refraction.scene.read.modifier_inputs import write_input

    activate(obj)
    bpy.ops.object.refractive_glass_modifier_add(shape="MESH", ior=ior)
    modifier = glass_modifier(obj)
    write_input(modifier, "Abbe Number", abbe)
    write_input(modifier, "Priority", priority)
    return obj


def camera(
    scene: bpy.types.Scene,
    position: Sequence[float],
    target: Sequence[float],
    focal_length: float,
) -> bpy.types.Object:
    """Add the scene's camera at ``position``, looking at ``target`` (metres).

    ``focal_length`` is in metres too, for a sensor 36 mm wide.
    """
    data = bpy.data.cameras.new("Camera")
    data.sensor_width = 36.0
    data.lens = focal_length * 1000.0
    data.clip_start = 0.01
    data.clip_end = 100.0
    obj = link(scene, "Camera", data)
    position = Vector(position)
    rotation = (Vector(target) - position).to_track_quat("-Z", "Y")
    place(obj, position, rotation)
    scene.camera = obj
    return obj


def light_up(
    scene: bpy.types.Scene,
    *,
    unlit: bool,
    sun_direction: Sequence[float],
    sun_strength: float = 3.0,
    sky: Colour = (0.5, 0.55, 0.6),
) -> None:
    """Add a sun and a soft sky, or, if ``unlit``, a black world alone.

    ``sun_direction`` points the way its light travels; ``sun_strength`` is in W/m2.
    """
    world = bpy.data.worlds.new("World")
    scene.world = world
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*((0.0, 0.0, 0.0) if unlit else sky), 1.0)
    if unlit:
        return
    data = bpy.data.lights.new("Sun", "SUN")
    data.energy = sun_strength
    data.color = (1.0, 0.96, 0.9)
    data.angle = math.radians(0.8)  # the sun is 0.53 deg wide; a little haze round it
    obj = link(scene, "Sun", data)
    obj.rotation_euler = Vector(sun_direction).to_track_quat("-Z", "Y").to_euler()
    obj.location = -Vector(sun_direction).normalized()


def keyframe_location(obj: bpy.types.Object, keys: dict[int, Sequence[float]]) -> None:
    """Animate ``obj.location`` (metres) linearly through ``keys`` (frame -> position)."""
    for frame, position in keys.items():
        obj.location = position
        obj.keyframe_insert("location", frame=frame)
    for layer in obj.animation_data.action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                for curve in bag.fcurves:
                    for point in curve.keyframe_points:
                        point.interpolation = "LINEAR"


# --- mesh arrays ---------------------------------------------------------------------------------


def grid_faces(rows: int, columns: int, *, flip: bool) -> np.ndarray:
    """Return the quads (F, 4) of a grid of ``rows`` x ``columns`` vertices, row by row."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.stack((corner, corner + columns, corner + columns + 1, corner + 1), axis=-1)
    return faces[:, ::-1] if flip else faces


def weld(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge points that agree to a nanometre."""
    _, first, index = np.unique(
        np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return points[first], index.reshape(-1)[faces]


# --- materials -----------------------------------------------------------------------------------


def material(name: str, colour: Colour | ColourNodes, *, unlit: bool) -> bpy.types.Material:
    """Return a diffuse material or, if ``unlit``, one that emits the same colour.

    Diffuse and not glossy: a highlight changes with the direction it is seen from, which would
    blur the question that these scenes ask (is the point seen where it should be seen?).
    """
    result = bpy.data.materials.new(name)
    tree = result.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    shader = tree.nodes.new("ShaderNodeEmission" if unlit else "ShaderNodeBsdfDiffuse")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if callable(colour):
        uv = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        tree.links.new(colour(tree, uv), shader.inputs["Color"])
        _arrange(tree)
    else:
        shader.inputs["Color"].default_value = (*colour, 1.0)
        shader.location.x = -200.0
        result.diffuse_color = (*colour, 1.0)
    return result


def _arrange(tree: bpy.types.NodeTree) -> None:
    """Lay the nodes out from left to right in the order they were added, output last."""
    nodes = [*tree.nodes]
    for column, node in enumerate([*nodes[2:], nodes[1], nodes[0]]):
        node.location = (220.0 * (column - len(nodes)), 0.0)


def scaled_uv(
    tree: bpy.types.NodeTree,
    uv: bpy.types.NodeSocket,
    scale: Sequence[float],
    *,
    turn: float = 0.0,
) -> bpy.types.NodeSocket:
    """UV times ``scale`` (x, y), turned by ``turn`` radians."""
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (*scale, 1.0)
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
    tree.links.new(uv, mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def mix(
    tree: bpy.types.NodeTree, factor: bpy.types.NodeSocket, low: Colour, high: Colour
) -> bpy.types.NodeSocket:
    """Blend two colours: ``low`` where ``factor`` is 0, ``high`` where it is 1."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type = "RGBA"
    tree.links.new(factor, next(s for s in node.inputs if s.identifier == "Factor_Float"))
    for identifier, colour in (("A_Color", low), ("B_Color", high)):
        socket = next(s for s in node.inputs if s.identifier == identifier)
        socket.default_value = (*colour, 1.0)
    return next(s for s in node.outputs if s.identifier == "Result_Color")


def tiles(
    width: float,
    height: float,
    joint: float,
    colours: tuple[Colour, Colour],
    joint_colour: Colour,
) -> ColourNodes:
    """Tiles of ``width`` x ``height`` with joints ``joint`` wide (metres, on metric UVs)."""

    def nodes(tree: bpy.types.NodeTree, uv: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        brick = tree.nodes.new("ShaderNodeTexBrick")
        brick.offset = 0.0
        brick.squash = 1.0
        # The node wants sizes above 0.01, so one unit of it is a tile's width.
        brick.inputs["Scale"].default_value = 1.0
        brick.inputs["Brick Width"].default_value = 1.0
        brick.inputs["Row Height"].default_value = height / width
        brick.inputs["Mortar Size"].default_value = 0.5 * joint / width
        brick.inputs["Mortar Smooth"].default_value = 0.0
        for name, colour in (
            ("Color1", colours[0]),
            ("Color2", colours[1]),
            ("Mortar", joint_colour),
        ):
            brick.inputs[name].default_value = (*colour, 1.0)
        tree.links.new(scaled_uv(tree, uv, (1 / width, 1 / width)), brick.inputs["Vector"])
        return brick.outputs["Color"]

    return nodes


def stripes(count: int, share: float, ground: Colour, colour: Colour) -> ColourNodes:
    """``count`` stripes across U = 0..1, each taking ``share`` of its period."""

    def nodes(tree: bpy.types.NodeTree, uv: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        u = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(scaled_uv(tree, uv, (count, 1.0)), u.inputs[0])
        fraction = tree.nodes.new("ShaderNodeMath")
        fraction.operation = "FRACT"
        tree.links.new(u.outputs["X"], fraction.inputs[0])
        striped = tree.nodes.new("ShaderNodeMath")
        striped.operation = "LESS_THAN"
        striped.inputs[1].default_value = share
        tree.links.new(fraction.outputs[0], striped.inputs[0])
        return mix(tree, striped.outputs[0], ground, colour)

    return nodes


def wood(light: Colour, dark: Colour, *, ring: float = 0.016) -> ColourNodes:
    """Grain along U with rings about ``ring`` metres apart (on metric UVs)."""

    def nodes(tree: bpy.types.NodeTree, uv: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        # Noise drawn out twelvefold along U; its distortion makes the lines wander and split.
        noise = tree.nodes.new("ShaderNodeTexNoise")
        noise.noise_dimensions = "2D"
        noise.inputs["Scale"].default_value = 1.0
        noise.inputs["Detail"].default_value = 4.0
        noise.inputs["Roughness"].default_value = 0.6
        noise.inputs["Distortion"].default_value = 0.4
        scale = (1.0 / (12.0 * ring), 1.0 / ring)
        tree.links.new(scaled_uv(tree, uv, scale), noise.inputs["Vector"])
        contrast = tree.nodes.new("ShaderNodeMapRange")
        contrast.inputs["From Min"].default_value = 0.35
        contrast.inputs["From Max"].default_value = 0.65
        tree.links.new(noise.outputs[0], contrast.inputs["Value"])
        return mix(tree, contrast.outputs[0], light, dark)

    return nodes


def picture(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """Return ``pixels`` (height, width, 3), sRGB in 0..1, top row first, packed as an image."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    return image


def sky_picture(width: int = 512, height: int = 256) -> np.ndarray:
    """Return an environment (height, width, 3), linear, top row first, over all directions.

    A sky above a warm ground, three soft boxes as in a photographer's studio, and a row of lamps:
    bright and dark, small and large, so that a glance shows whether directions are right.
    Columns are longitudes, rows run from the zenith down.
    """
    longitude = (np.arange(width) + 0.5) / width * 360.0 - 180.0
    latitude = 90.0 - (np.arange(height) + 0.5) / height * 180.0
    longitude, latitude = np.meshgrid(longitude, latitude)

    def soft(distance: np.ndarray, blur: float) -> np.ndarray:
        # 1 inside, 0 outside, smooth over ``blur`` degrees.
        step = np.clip(0.5 - distance / blur, 0.0, 1.0)
        return (step * step * (3.0 - 2.0 * step))[..., None]

    up = soft(-latitude, 6.0)
    height_share = np.clip(latitude / 90.0, 0.0, 1.0)[..., None]
    sky = np.array((0.75, 0.82, 0.90)) * (1 - height_share) + np.array((0.16, 0.30, 0.62)) * (
        height_share
    )
    ground = (
        np.array((0.22, 0.17, 0.12)) * (1.0 + 0.25 * np.cos(np.radians(6.0 * longitude)))[..., None]
    )
    result = up * sky + (1.0 - up) * ground
    for middle, low, wide, high, light in (
        (-150.0, 40.0, 34.0, 40.0, 2.4),
        (-40.0, 30.0, 24.0, 56.0, 1.6),
        (120.0, 25.0, 60.0, 16.0, 1.2),
    ):
        away = np.abs((longitude - middle + 180.0) % 360.0 - 180.0)
        box = np.maximum(away - wide / 2, np.abs(latitude - low) - high / 2)
        result = result + soft(box, 4.0) * (light - result)
    for number in range(9):
        away = (longitude - (number * 40.0 - 160.0) + 180.0) % 360.0 - 180.0
        lamp = np.hypot(away, latitude - 8.0) - 2.5
        result = result + soft(lamp, 2.0) * (np.array((3.0, 2.4, 1.5)) - result)
    return result


def sky_world(scene: bpy.types.Scene) -> bpy.types.World:
    """Give the scene a world with :func:`sky_picture`, packed into the file."""
    pixels = sky_picture()
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Studio sky", width, height, float_buffer=True, is_data=False)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    world = bpy.data.worlds.new("World")
    scene.world = world
    tree = world.node_tree
    background = next(n for n in tree.nodes if n.type == "BACKGROUND")
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    texture.location = (-320.0, 300.0)
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return world


def image_texture(image: bpy.types.Image) -> ColourNodes:
    """``image`` laid over the UVs, repeated beyond 0..1."""

    def nodes(tree: bpy.types.NodeTree, uv: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        node.extension = "REPEAT"
        tree.links.new(uv, node.inputs["Vector"])
        return node.outputs["Color"]

    return nodes
