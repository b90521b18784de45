# SPDX-License-Identifier: GPL-3.0-or-later
"""The same frame with real glass, rendered in Cycles."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial

import bpy
import numpy as np
from mathutils import Matrix

from .. import optics
from ..scene.build.glass_material import SURFACES, Interface, glass_shader, surface_look
from ..scene.build.glass_mesh import FILM, Surface, fill_mesh, film, glass_surfaces
from ..scene.build.mirrored import INPUT as MIRROR
from ..scene.build.shaders import math_node, met_where, new_surface
from ..scene.names import REFERENCE, TAG, RefractiveGlassError, own
from ..scene.rays.looks import look_of
from ..scene.read.arrays import write_attribute
from ..scene.read.glasses import Glass, read_glasses
from ..scene.read.glassy_materials import (
    CLEAR,
    PAINTED,
    glassy_materials,
    interface_node,
    material_interface,
    opaque_bits,
)
from ..scene.read.light_linking import lights_any
from ..scene.read.material_recipe import recipes_of
from ..scene.read.modifier_inputs import glass_modifier, read_input, write_input
from ..scene.read.paint import FINISH
from ..scene.read.viewpoint import clamp_settings, samples_setting
from .interfaces import Interfaces, interfaces, near_shells, overlapping
from .picture import Request, finished, rendering_picture

# Light that runs round inside a wall dies off by Fresnel's losses, not by the number of bounces:
# with 64, one path in 16,000 through a filled cup went dark.
_BOUNCES = 256
LOOKS = "refracted", "reflected", "roughness"
"""What the inputs of `PAINTED` are, in their order."""
FINISH_ATTRIBUTE = "rg_{}"
"""Attribute of the corners of painted surfaces, of each of these."""
BY_CORNERS = None, None, None
"""Roughness and colours of a kind of surface that its corners tell of."""


@dataclass
class _Style:
    """How all glasses are rendered, and the materials that they have.

    Attributes
    ----------
    surface, shadows : see `rendering_reference`. rough : any glass is. polished : what glossy rays
        come from shows images.
    temporary : undoes what is made and set, with the reference.
    """

    surface: str
    shadows: bool
    rough: bool
    polished: bool
    temporary: ExitStack
    _materials: dict[tuple, bpy.types.Material] = field(default_factory=dict)

    def material(self, kind: tuple, like: bpy.types.Material | None = None) -> bpy.types.Material:
        """The material of a kind, see `_kind` and `_become_glass`, with the textures of another."""
        key = *kind, like
        if key not in self._materials:
            if like is None:
                material = bpy.data.materials.new(f"{self.surface.title()} {kind[0]:g} {REFERENCE}")
                material.node_tree.nodes.clear()
                is_painted = kind[3:] == BY_CORNERS
                ends = _attribute_sockets(material.node_tree) if is_painted else {}
            else:
                material = like.copy()
                ends = _texture_sockets(material)
            self._materials[key] = material
            self.temporary.callback(bpy.data.materials.remove, material)
            material[TAG] = REFERENCE
            _become_glass(material.node_tree, self, ends, *kind)
        return self._materials[key]

    def set(self, owner, name: str, value) -> None:
        """Set a property until the reference ends."""
        self.temporary.callback(setattr, owner, name, getattr(owner, name))
        setattr(owner, name, value)


def render_reference(scene: bpy.types.Scene, **settings) -> np.ndarray:
    """What :func:`rendering_reference` ends with, where Blender's window may wait."""
    return finished(rendering_reference(scene, **settings))


def rendering_reference(
    scene: bpy.types.Scene,
    *,
    samples: int | None = None,
    seed: int = 0,
    surface: str = "GLASS",
    glass_shadows: bool = False,
    denoised: bool = False,
    glasses: Sequence[Glass] | None = None,
) -> Generator[Request, object, np.ndarray]:
    """Render the scene's current frame in Cycles with its glasses as real meshes, in steps.

    Camera, world, lights, resolution, border, pixel filter and film are the scene's own. Bounces
    suffice for glass, caustics are on; adaptive sampling is off. Samples are clamped as the scene's
    own engine clamps them. The scene itself, the selection and all data-blocks are left as they
    were.

    Parameters
    ----------
    samples : per pixel; by default as many as the scene's own renders take.
    seed : of the noise, instead of the scene's; the same number repeats the scene's own noise.
    surface : "GLASS" refracts and mirrors by Fresnel's laws; "REFRACTION" refracts all light, and
        is black where it is reflected totally.
    glass_shadows : False lights every surface as though there were no glass: it is there for the
        camera and behind mirrors and other clear glass. True lets it block lamps, cast caustics
        and be mirrored in rough surfaces of scenes in which nothing is polished.
    denoised : by the denoiser of the scene's settings.
    glasses : by default those of the scene.

    Returns
    -------
    (H, W, 4) float32, linear scene-referred RGBA, alpha premultiplied, bottom row first.

    Raises
    ------
    ValueError
        Unknown ``surface``, ``samples`` below 1.
    RefractiveGlassError
        No camera, no view layer in use, a glass that cannot be computed.
    RuntimeError
        The render was cancelled.
    """
    if surface not in SURFACES:
        raise ValueError(f"surface must be one of {', '.join(SURFACES)}, not {surface!r}")
    if samples is not None and samples < 1:
        raise ValueError(f"samples must be at least 1, not {samples}")
    if scene.camera is None:
        raise RefractiveGlassError(f'Scene "{scene.name}" has no camera: add one (Add > Camera)')
    if glasses is None:
        glasses = read_glasses(scene_depsgraph(scene))
    rough = any(glass.is_mesh and glass.description.roughness > 0.0 for glass in glasses)

    def drawing(glasses: Sequence[Glass]) -> Generator[Request, object, np.ndarray]:
        with _reference_scene(scene) as reference, ExitStack() as temporary:
            _set_up_cycles(reference, scene, samples or getattr(*samples_setting(scene)), seed)
            reference.cycles.use_denoising = denoised
            polished = _is_polished(reference)
            style = _Style(surface, glass_shadows, rough, polished, temporary)
            yield from _show_glasses(reference, glasses, style)
            return (yield from rendering_picture(reference))

    if not any(glass.disperses and not glass.band for glass in glasses):
        return (yield from drawing(glasses))
    # Red, green and blue each of a picture with the glasses as such light finds them.
    pictures = []
    for band in optics.LINES:
        pictures.append((yield from drawing([glass.in_light(band) for glass in glasses])))
    channels = [picture[..., number] for number, picture in enumerate(pictures)]
    return np.stack((*channels, np.mean([p[..., 3] for p in pictures], axis=0)), axis=-1)


def _show_glasses(
    reference: bpy.types.Scene, glasses: Sequence[Glass], style: _Style
) -> Generator[Request, object, None]:
    """Put the glasses into a reference's scene, those that overlap as one object."""
    closed, meshes = _objects(glasses)
    shells = near_shells(glasses)
    together = (yield partial(overlapping, shells)) if shells else frozenset()
    joint = [shell for shell in shells if shell.glass.name in together]
    shown = {
        obj: glass
        for obj, glass in meshes.items()
        if glass.name not in together and not opaque_bits(glass_modifier(obj))
    }
    _leave_out((*closed, *(obj for obj in meshes if obj not in shown)), style.temporary)
    for obj, glass in shown.items():
        _show_mesh(obj, glass, style)
    standing = {*together, *(glass.name for glass in shown.values())}
    made = {
        _glass_object(glass, style): [glass.name] for glass in glasses if glass.name not in standing
    }
    if joint:
        found = yield partial(interfaces, joint)
        made[_joint_object([shell.glass for shell in joint], found, style)] = list(together)
    for obj, names in made.items():
        obj.visible_shadow = obj.visible_diffuse = style.shadows
        reference.collection.objects.link(obj)
        _receive_as(obj, names)
    if reference.render.use_motion_blur:
        depsgraph = scene_depsgraph(reference)
        for obj, names in made.items():
            _go_with(obj, names, depsgraph)


def _go_with(obj: bpy.types.Object, names: list[str], depsgraph: bpy.types.Depsgraph) -> None:
    """Have an object move as the one glass does that it stands for; one of several stands still."""
    owners = [bpy.data.objects.get(name) for name in names]
    if len(owners) == 1 and owners[0] is not None:
        place = obj.matrix_basis.copy()
        obj.parent = owners[0]
        moved = owners[0].evaluated_get(depsgraph).matrix_world
        obj.matrix_parent_inverse = moved.inverted_safe()
        obj.matrix_basis = place


def rendering_direct(scene: bpy.types.Scene) -> Generator[Request, object, np.ndarray]:
    """The scene's current frame without its glasses, by its own engine: (H, W, 4), in steps."""
    closed, meshes = _objects(read_glasses(scene_depsgraph(scene), []))
    with _reference_scene(scene) as direct, ExitStack() as temporary:
        _leave_out((*closed, *meshes), temporary)
        return (yield from rendering_picture(direct))


def _leave_out(glasses: Iterable[bpy.types.Object], temporary: ExitStack) -> None:
    """Have renders show no glass; what is opaque of a glass's mesh stays."""
    for obj in glasses:
        modifier = glass_modifier(obj)
        if not opaque_bits(modifier):
            temporary.callback(setattr, obj, "hide_render", obj.hide_render)
            obj.hide_render = True
            continue
        for name, value in (("Show in Render", False), ("Casts Shadow", False), (MIRROR, None)):
            temporary.callback(write_input, modifier, name, read_input(modifier, name))
            write_input(modifier, name, value)


def _is_polished(scene: bpy.types.Scene) -> bool:
    """Whether anything in a scene shows images, such as a floor that is not quite sharp."""
    slots = (slot for obj in scene.objects if not obj.hide_render for slot in obj.material_slots)
    return any(look_of(material).is_mirror for material in {slot.material for slot in slots})


def _objects(
    glasses: Sequence[Glass],
) -> tuple[list[bpy.types.Object], dict[bpy.types.Object, Glass]]:
    """The objects of glasses of closed form, and those of meshes with the glass, each once."""
    found = {glass.name: glass for glass in glasses}
    pairs = [(bpy.data.objects.get(name), glass) for name, glass in found.items()]
    pairs = [(obj, glass) for obj, glass in pairs if obj is not None]
    closed = [obj for obj, glass in pairs if not glass.is_mesh]
    return closed, {obj: glass for obj, glass in pairs if obj not in closed}


def _receive_as(obj: bpy.types.Object, names: list[str]) -> None:
    """Have light linking take an object for the glasses that it stands for.

    What is entered in the lamps' collections goes with the object.
    """
    for lamp in bpy.data.objects:
        wanted = lights_any(lamp, names)
        if lights_any(lamp, [obj.name]) == wanted:
            continue
        collection = lamp.light_linking.receiver_collection
        if collection.is_editable:
            collection.objects.link(obj)
            link = collection.collection_objects[collection.objects.find(obj.name)]
            link.light_linking.link_state = "INCLUDE" if wanted else "EXCLUDE"


def _show_mesh(obj: bpy.types.Object, glass: Glass, style: _Style) -> None:
    """Have a glass that is a mesh rendered as its own object, of the reference's material."""
    modifier = glass_modifier(obj)
    shown = read_input(modifier, "Show in Render")
    style.temporary.callback(write_input, modifier, "Show in Render", shown)
    write_input(modifier, "Show in Render", True)
    if obj.is_editable:
        # A film of air, see `film`: half of it, against the normals.
        thinner = obj.modifiers.new(REFERENCE, "DISPLACE")
        thinner.strength = -FILM * float(np.ptp(np.array(obj.bound_box), axis=0).max())
        style.temporary.callback(obj.modifiers.remove, thinner)
    absorption = glass.absorption if glass.is_tinted else (None, None)
    own_ones = glassy_materials(obj)

    def like(own_one: bpy.types.Material | None) -> bpy.types.Material:
        look = surface_look(glass)
        if own_one is not None:
            said = material_interface(own_one)
            look = said.roughness, said.refracted, said.reflected
        kind = glass.description.ior, *absorption, *look
        return style.material(kind, own_one if own_one and recipes_of(own_one) else None)

    first = next(iter(own_ones), None)
    if not obj.material_slots:
        obj.data.materials.append(like(first))
        style.temporary.callback(obj.data.materials.pop)
    for slot in obj.material_slots:
        own_one = slot.material if slot.material in own_ones else first
        style.set(slot, "link", "OBJECT")
        style.set(slot, "material", like(own_one))
    style.set(obj, "visible_shadow", style.shadows)
    style.set(obj, "visible_diffuse", style.shadows)


def scene_depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph:
    """The scene's first rendered view layer, evaluated at the current frame."""
    layer = main_view_layer(scene)
    layer.update()
    return layer.depsgraph


def main_view_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The first view layer that takes part in renders.

    Raises
    ------
    RefractiveGlassError
        There is none.
    """
    for layer in scene.view_layers:
        if layer.use:
            return layer
    raise RefractiveGlassError(
        f'Scene "{scene.name}" renders none of its view layers: switch one on '
        "(View Layer properties > Use for Rendering)"
    )


@contextmanager
def _reference_scene(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    """A linked copy of the scene without the extension's objects, layers and compositing."""
    kept = main_view_layer(scene).name
    reference = scene.copy()
    try:
        reference[TAG] = REFERENCE
        for layer in list(reference.view_layers):
            if layer.name != kept:
                reference.view_layers.remove(layer)
        _exclude_own(reference.view_layers[0].layer_collection)
        for obj in [o for o in reference.collection.objects if own(o)]:
            reference.collection.objects.unlink(obj)
        reference.render.use_compositing = False
        reference.render.use_sequencer = False
        reference.render.use_multiview = False
        reference.render.use_persistent_data = False
        _check_bodies(scene, reference)
        yield reference
    finally:
        bpy.data.scenes.remove(reference)


def _check_bodies(scene: bpy.types.Scene, copy: bpy.types.Scene) -> None:
    """Raise where rigid bodies have moved: Blender copies a scene without what it simulated."""
    world = scene.rigidbody_world
    if world is None or world.collection is None:
        return
    copy.view_layers[0].update()
    depsgraphs = scene_depsgraph(scene), copy.view_layers[0].depsgraph
    for obj in world.collection.objects:
        places = [np.array(obj.evaluated_get(d).matrix_world, float) for d in depsgraphs]
        if not np.allclose(*places, rtol=1e-4, atol=1e-6):
            raise RefractiveGlassError(
                f'Rigid body "{obj.name}" has moved, which the reference cannot know: bake the '
                "simulation to keyframes first (Object > Rigid Body > Bake to Keyframes)"
            )


def _exclude_own(layer_collection: bpy.types.LayerCollection) -> None:
    for child in layer_collection.children:
        if own(child.collection):
            child.exclude = True
        else:
            _exclude_own(child)


def _set_up_cycles(
    reference: bpy.types.Scene, scene: bpy.types.Scene, samples: int, seed: int
) -> None:
    """Unbiased path tracing with bounces enough for glass; all else as the scene has it."""
    cycles = reference.cycles
    if scene.render.engine != "CYCLES":
        cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        cycles.filter_width = max(scene.render.filter_size, 0.01)
    reference.render.engine = "CYCLES"
    cycles.samples = samples
    cycles.seed = seed
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_sample_subset = False
    cycles.time_limit = 0.0
    cycles.use_layer_samples = "IGNORE"
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = clamp_settings(
        scene, scene.render.engine
    )
    cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    # Diffuse light must not gain bounces from the limit that is raised for the glass.
    cycles.diffuse_bounces = min(cycles.diffuse_bounces, cycles.max_bounces)
    cycles.volume_bounces = min(cycles.volume_bounces, cycles.max_bounces)
    cycles.max_bounces = cycles.transmission_bounces = cycles.glossy_bounces = _BOUNCES
    # Enough for what a rough surface gathers through a filled glass, beside the user's own.
    cycles.transparent_max_bounces += 16
    # A transparent film shows through the glass as it does beside it.
    cycles.film_transparent_glass = reference.render.film_transparent


def _glass_object(glass: Glass, style: _Style) -> bpy.types.Object:
    """An object of the glass's interfaces."""
    surfaces = glass_surfaces(glass.description)
    kinds = [_kind(glass, interface) for interface in surfaces]
    obj = _object_of(glass.name, surfaces, kinds, style)
    obj.matrix_world = Matrix(glass.to_world.tolist()) @ _shrunk(obj.data)
    return obj


def _joint_object(glasses: Sequence[Glass], found: Interfaces, style: _Style) -> bpy.types.Object:
    """One object of all interfaces of glasses that overlap."""
    tinted = bool(found.absorption.any())
    rows = np.column_stack((found.glass, found.ior, found.absorption.reshape(-1, 6)))
    rows, of_row = np.unique(rows, axis=0, return_inverse=True)
    surfaces, kinds = [], []
    for number, (owner, ior, *absorption) in enumerate(rows.tolist()):
        some = np.flatnonzero(of_row.ravel() == number)
        glass, corners = glasses[int(owner)], np.arange(3 * len(some))
        surfaces.append(
            Surface(
                name=glass.name,
                vertices=found.points[some].reshape(-1, 3),
                corners=corners,
                sizes=np.full(len(some), 3),
                normals=found.normals[some].reshape(-1, 3),
                ior_inside=ior,
                ior_outside=1.0,
            )
        )
        sides = (tuple(absorption[:3]), tuple(absorption[3:])) if tinted else (None, None)
        kinds.append((ior, *sides, *surface_look(glass)))
    obj = _object_of("Glasses", surfaces, kinds, style)
    obj.matrix_world = _shrunk(obj.data)
    return obj


def _object_of(
    name: str, surfaces: Sequence[Surface], kinds: Sequence[tuple], style: _Style
) -> bpy.types.Object:
    """An object of surfaces, each of the material of its kind; it goes with the reference."""
    mesh = bpy.data.meshes.new(f"{name} {REFERENCE}")
    style.temporary.callback(bpy.data.meshes.remove, mesh)
    mesh[TAG] = REFERENCE
    fill_mesh(mesh, surfaces)
    _write_finish(mesh, surfaces)
    slots = list(dict.fromkeys(kinds))
    for kind in slots:
        mesh.materials.append(style.material(kind))
    index = np.repeat([slots.index(kind) for kind in kinds], [len(s.sizes) for s in surfaces])
    mesh.polygons.foreach_set("material_index", index.astype(np.int32))
    obj = bpy.data.objects.new(mesh.name, mesh)
    style.temporary.callback(bpy.data.objects.remove, obj)
    obj[TAG] = REFERENCE
    return obj


def _write_finish(mesh: bpy.types.Mesh, surfaces: Sequence[Surface]) -> None:
    """Have the corners of painted surfaces know what they are like, see `_attribute_sockets`."""
    if all(surface.finish is None for surface in surfaces):
        return
    plain = (np.ones((len(s.corners), FINISH)) if s.finish is None else s.finish for s in surfaces)
    finish = np.concatenate(list(plain))
    for name, part in zip(LOOKS, (finish[:, 1:4], finish[:, 4:], finish[:, :1]), strict=True):
        kind = "FLOAT" if part.shape[1] == 1 else "FLOAT_VECTOR"
        write_attribute(mesh, FINISH_ATTRIBUTE.format(name), part, kind, "CORNER")


def _attribute_sockets(tree: bpy.types.NodeTree) -> dict[str, bpy.types.NodeSocket]:
    """What the corners of painted surfaces know, as `_texture_sockets`."""
    found = {}
    for name in LOOKS:
        node = tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = FINISH_ATTRIBUTE.format(name)
        found[name] = node.outputs["Fac" if name == "roughness" else "Color"]
    return found


def _shrunk(mesh: bpy.types.Mesh) -> Matrix:
    """Leaves a film of air round a mesh, see `film`."""
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    return Matrix(film(points).tolist())


def _kind(glass: Glass, surface: Surface) -> tuple:
    """What a surface's material depends on, see `_become_glass`."""
    sides = (None, None)
    if glass.is_tinted:
        sides = [glass.absorption[medium] for medium in surface.media]
    look = surface_look(glass) if surface.finish is None else BY_CORNERS
    return (surface.ior_inside / surface.ior_outside, *sides, *look)


def _texture_sockets(material: bpy.types.Material) -> dict[str, bpy.types.NodeSocket]:
    """What is linked to a glassy material's shader, and to the Displacement of its output, which is
    taken out; by "Normal", "Displacement", and as `PAINTED` has them "refracted", "reflected" and
    "roughness"."""
    tree, shader = material.node_tree, interface_node(material)
    end = tree.get_output_node("CYCLES")
    inputs = {"Normal": shader.inputs["Normal"], "Displacement": end.inputs["Displacement"]}
    for name, painted in zip(LOOKS, PAINTED[shader.type], strict=True):
        inputs[name] = shader.inputs[painted]
    found = {
        name: i.links[0].from_socket
        for name, i in inputs.items()
        if i.links and not i.links[0].is_muted
    }
    if shader.type == "BSDF_PRINCIPLED" and "refracted" in found:
        # It refracts by the root of its colour.
        root = tree.nodes.new("ShaderNodeGamma")
        root.inputs["Gamma"].default_value = 0.5
        tree.links.new(found["refracted"], root.inputs["Color"])
        found["refracted"] = root.outputs["Color"]
    for node in [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL"]:
        tree.nodes.remove(node)
    return found


def _become_glass(
    tree: bpy.types.NodeTree,
    style: _Style,
    textures: dict[str, bpy.types.NodeSocket],
    eta: float,
    before: tuple | None,
    behind: tuple | None,
    roughness: float | None = 0.0,
    colour: tuple[float, float, float] | None = CLEAR,
    mirrored: tuple[float, float, float] | None = CLEAR,
) -> None:
    """Have a material's tree be of a clear one whose back is ``eta`` times as dense as its front.

    ``textures``: see `_texture_sockets`. ``before`` and ``behind`` are the absorption coefficients
    (red, green, blue, per metre) of the media at its front and back, or None: what a ray lost on
    its way to the surface, it loses there.
    """
    absorption = None if before is None else (before, behind)
    sockets = [textures.get(name) for name in LOOKS]
    roughness = sockets[2] or roughness
    if sockets[0] is not None:
        colour = _channels(tree, sockets[0])
    if sockets[1] is not None:
        mirrored = colour if sockets[1] == sockets[0] else _channels(tree, sockets[1])
    interface = Interface(eta, absorption, roughness, colour, mirrored)
    shader = glass_shader(tree, interface, style.surface)
    if "Normal" in textures:
        tree.links.new(textures["Normal"], shader.inputs["Normal"])
    surface = shader.outputs["BSDF"]
    end = new_surface(tree, surface if style.shadows else _without_shadow(tree, style, surface))
    if "Displacement" in textures:
        tree.links.new(textures["Displacement"], end.inputs["Displacement"])


def _channels(tree: bpy.types.NodeTree, colour: bpy.types.NodeSocket) -> list:
    """Red, green and blue of a socket."""
    parts = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(colour, parts.inputs["Color"])
    return list(parts.outputs)


def _without_shadow(
    tree: bpy.types.NodeTree, style: _Style, shader: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """The shader as it is seen by cameras, mirrors and glasses alone."""
    # Light that a rough surface gathers must pass the glass unbent: bent, it would find lamps
    # that the surface has already counted through the glass that casts no shadow.
    ray = tree.nodes.new("ShaderNodeLightPath").outputs
    meets = math_node(tree, "MAXIMUM", ray["Is Camera Ray"], ray["Is Singular Ray"])
    if style.polished:
        seen = math_node(tree, "LESS_THAN", ray["Diffuse Depth"], 0.5)
        mirrored = math_node(tree, "MULTIPLY", ray["Is Glossy Ray"], seen)
        meets = math_node(tree, "MAXIMUM", meets, mirrored)
    if style.rough:
        # No ray is singular behind a rough surface. Those that a glass has let through or mirrored
        # within meet it, but not those of a matt or rough thing, which come from outside.
        back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
        bent = math_node(tree, "LESS_THAN", ray["Transparent Depth"], 0.5)
        within = math_node(tree, "MULTIPLY", back, bent)
        kept = math_node(tree, "MAXIMUM", ray["Is Transmission Ray"], within)
        for name, operation in (("Transmission", "GREATER_THAN"), ("Diffuse", "LESS_THAN")):
            counted = math_node(tree, operation, ray[f"{name} Depth"], 0.5)
            kept = math_node(tree, "MULTIPLY", kept, counted)
        meets = math_node(tree, "MAXIMUM", meets, kept)
    return met_where(tree, meets, shader)
