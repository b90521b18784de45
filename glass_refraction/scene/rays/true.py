# SPDX-License-Identifier: GPL-3.0-or-later
"""The door of True shading: make what renders need, once, and write a frame's values into it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import bpy
import numpy as np
from mathutils import Matrix

from ..build.compositor import group_node, has_group, insert_group
from ..build.material_tree import prepare_fields
from ..build.mirrored import prepare_mirrored, remove_mirrored, write_mirrored
from ..build.own_scenes import (
    find_own_scenes,
    match_settings,
    new_collection,
    new_object,
    own_scene,
    remove_own_scenes,
    synchronise,
    write_setting,
)
from ..build.shaders import new_surface, own_material
from ..light.emitters import read_emitters
from ..light.light import KeptLight, LightSettings
from ..memory import Status, counters, memory_of
from ..names import TAG, hidden_name, own
from ..progress import check
from ..read.animation import may_move
from ..read.arrays import write_polygons
from ..read.glasses import (
    all_glasses,
    as_bodies,
    glass_objects,
    instanced_glasses,
    is_mesh_glass,
    is_shown,
    read_glasses,
)
from ..read.glassy_materials import glassy_materials
from ..read.light_linking import is_mirrored
from ..read.modifier_inputs import glass_modifier, has_input, read_input
from ..read.sources import source_objects
from ..read.viewpoint import (
    Viewpoint,
    border_window,
    clamp_settings,
    render_size,
    samples_setting,
    shutter_times,
)
from ..read.visibility import rendered_layer
from ..read.world import film_exposure, shown_world
from .caster import Casters, fill_cast_collection
from .curtain import pane
from .exits import WORKBENCH_MANY, WORKBENCH_SIGMA
from .follow import Kept
from .frame import NO_CURTAIN, ROOMY, FrameResult, Placed, Room, compute, expose
from .hits import CAPTURE_WORTH, LIT_ELSEWHERE_WORTH
from .lamps import sun_of
from .radiance import Clamp
from .samples import EARLY, LEVELS
from .shutter import Moment, Shutter
from .sky import sky_of
from .stage import FrameInput
from .sum_tree import SHARPENINGS, TENT_PX, Pictures, SumTree
from .things import Things, read_things
from .views import RadianceView

CURTAIN = "curtain"
"""Role of what hides the pixels of a view that nobody looks up."""
PANE = "pane"
"""Role of what light of a view has come through, where cameras see another sky or other things."""
PANE_MESH = (
    np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]),
    np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]),
)
"""Points (8, 3) and faces (6, 4) of a box round a camera, metres."""
CAPTURE, SKY, CAST = "capture", "sky", "cast"
"""Roles of own scenes: for captures, for views of the world alone, and to cast rays in."""
ROOM = Room(captures=3, skies=3)
"""Views that the compositor tree has room for."""
LEAST_CLIP = 1e-6
"""Metres: where a view begins to see at least, as near as Blender lets a camera see."""
UNCOVERED = 0.5
"""Part of a pixel beside all glasses from which on it counts as not covered."""
WORLD_MAP = 2048
"""Pixels: how wide a map of the world small captures choose its light by. Cycles' own is 4096 wide
where there is an image, and takes seconds. With half of it a hard sun gives 0.9 dB more noise."""
FEW_PATHS = 4_000_000
"""Of a capture: up to so many the larger map takes longer than as much noise less by samples."""
UNREADY = "The render began before the last setting was taken up: render again"
TOLD_LIGHT = 0.01
"""Part of the light in the glasses that is told of if it is lit otherwise than the picture."""
TOLD_MIRRORED = 0.003
"""Part of the picture's light that is told of if it should be a glass's mirror image."""
TOLD_VEILED = 0.003
"""Part of the picture that is told of if a glass is hidden there by what is seen through."""
_STRUCTURE = "refractive_glass_structure"
_COLOURS = "use_pass_diffuse_color"
_LENT = "refractive_glass_lent"
"""Property of the own scene for casts: name of the user's layer that was given a pass."""
_PLACE = "refractive_glass_place"
"""Another: that layer's place among the layers, and how many these were."""
_kept_sizes: dict[int, tuple[int, int]] = {}
"""View's session uid -> pixels of the picture of it that Blender has kept. The compositor takes it
where the view is not rendered, and reads past its end where it is smaller than the user's: so it is
rendered once more, though nothing is looked up in it."""


@dataclass(eq=False)
class Exposure:
    """A frame with motion blur whose picture waits for the moments that its render goes through.

    Attributes
    ----------
    frame : what is known at its own time. placed : its views. white : see `_write_pictures`.
    moments : that came since.
    """

    frame: FrameInput
    placed: Placed
    white: float
    moments: list[Moment] = field(default_factory=list)


def prepare(scene: bpy.types.Scene) -> None:
    """Make the own scenes and the compositor tree of True shading, unless they stand.

    What is made depends on the scene's settings only, never on what a frame shows.
    """
    cast = own_scene(scene, CAST)
    if not cast.collection.children:
        fill_cast_collection(new_collection(CAST, cast))
        # Evaluated, never rendered.
        cast.view_layers[0].use = False
        synchronise(cast.view_layers[0])
    glasses = glass_objects(rendered_layer(scene), ever=True)
    of_meshes = (m for glass in _mesh_glasses(scene) for m in glassy_materials(glass))
    prepare_fields(cast.collection.children[0], dict.fromkeys(of_meshes))
    prepare_mirrored(scene, cast, [glass for glass in glasses if glass.is_editable])
    views = [own_scene(scene, CAPTURE, number) for number in range(ROOM.captures)]
    views += [own_scene(scene, SKY, number) for number in range(ROOM.skies)]
    for view in views:
        _fill_view(scene, view)
    _match_views(scene, views)
    lit = has_light(scene)
    _ask_for_colours(scene, cast, views, lit)
    if not _stands(scene):
        counters["structures"] += 1
        tree = SumTree(scene, views, alpha=scene.render.film_transparent, light=lit).tree
        tree[_STRUCTURE] = _structure(scene)
        insert_group(scene, tree, views)
    # Whatever was linked above put all scenes off; Blender 5.2 crashes where a render finds it so.
    for changed in (scene, cast, *views):
        for layer in changed.view_layers:
            synchronise(layer)


def _mesh_glasses(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The glasses that are meshes, in whatever frame, and those that are instanced."""
    layer = rendered_layer(scene)
    glasses = glass_objects(layer, ever=True) + instanced_glasses(layer)
    return list(filter(is_mesh_glass, glasses))


def _structure(scene: bpy.types.Scene) -> str:
    """What the scene's settings ask of its compositor tree."""
    light = " light" if has_light(scene) else ""
    sums = f"sum {ROOM} {EARLY} {LEVELS} {SHARPENINGS} {TENT_PX:.3f}"
    return f"{sums} {scene.render.film_transparent}{light}"


def _stands(scene: bpy.types.Scene) -> bool:
    """Whether the compositor tree is the one that the scene's settings ask for."""
    # A copied scene comes with the other's.
    return has_group(scene) and group_node(scene).node_tree.get(_STRUCTURE) == _structure(scene)


def has_light(scene: bpy.types.Scene) -> bool:
    """Whether lamps' light is followed through the scene's glasses; Workbench has no lamps."""
    lit = scene.refractive_glass.shadow == "LIGHT"
    return lit and scene.render.engine != "BLENDER_WORKBENCH"


def _ask_for_colours(
    scene: bpy.types.Scene, cast: bpy.types.Scene, views: list[bpy.types.Scene], lit: bool
) -> None:
    """Have the engine write what part of matte light surfaces send back, if light is followed.

    The user's layer gets that pass for as long; the own scene for casts remembers that it had not.
    """
    for view in views:
        if own(view, CAPTURE):
            write_setting(view.view_layers[0], _COLOURS, lit)
    layer = rendered_layer(scene)
    if _LENT in cast:
        lent = _lent_layer(scene, cast)
        if not (lit and lent == layer):
            if lent is not None:
                write_setting(lent, _COLOURS, False)
            del cast[_LENT]
    if lit and not getattr(layer, _COLOURS):
        write_setting(layer, _COLOURS, True)
        cast[_LENT] = layer.name
        cast[_PLACE] = scene.view_layers[:].index(layer), len(scene.view_layers)


def _lent_layer(scene: bpy.types.Scene, cast: bpy.types.Scene) -> bpy.types.ViewLayer | None:
    """The user's layer that was given a pass, by another name perhaps; None if it was deleted."""
    layers, (place, count) = scene.view_layers, cast[_PLACE]
    found = layers.get(cast[_LENT])
    return layers[place] if found is None and len(layers) == count else found


def set_aside(scene: bpy.types.Scene) -> None:
    """Take out of the user's data what they would not find without the own scenes."""
    for cast in find_own_scenes(scene, (CAST,)):
        _ask_for_colours(scene, cast, [], False)
        remove_mirrored(cast)


def remove(scene: bpy.types.Scene) -> None:
    """Remove the own scenes of True shading."""
    set_aside(scene)
    remove_own_scenes(scene, (CAPTURE, SKY, CAST))


def _fill_view(scene: bpy.types.Scene, view: bpy.types.Scene) -> None:
    """A camera of its own with what hangs before it, and in a capture all of the user's scene."""
    if view[TAG] == CAPTURE and view.background_set != scene:
        view.background_set = scene
    if view.collection.children:
        return
    collection = new_collection(view[TAG], view)
    camera = new_object(view[TAG], bpy.data.cameras.new(hidden_name(view[TAG])), collection)
    view.camera = camera
    for role in (CURTAIN, PANE):
        mesh = bpy.data.meshes.new(hidden_name(role))
        before = new_object(role, mesh, collection)
        mesh.materials.append(_material(role))
        for kind in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(before, f"visible_{kind}", False)
    # Until a frame's values are written: a new scene's thousands of samples are nobody's.
    view.view_layers[0].use = False
    synchronise(view.view_layers[0])


def _material(role: str) -> bpy.types.Material:
    """The material of curtains, which ends a camera's rays and gives no light, or of panes, which
    lets them through as they come: they are a camera's no more."""

    def build(tree: bpy.types.NodeTree) -> None:
        shader = tree.nodes.new(
            "ShaderNodeEmission" if role == CURTAIN else "ShaderNodeBsdfRefraction"
        )
        for name, value in _SHADERS[role].items():
            shader.inputs[name].default_value = value
        new_surface(tree, shader.outputs[0])

    return own_material(role, build)


_SHADERS = {
    CURTAIN: {"Strength": 0.0},
    PANE: {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.0, "IOR": 1.0},
}
"""Inputs of these materials' shaders."""


_OF_LAYERS = ("material_override", "world_override", "use_sky", "use_ao", "use_solid")
_OF_LAYERS += ("use_strand", "use_volumes", "use_motion_blur")
"""What captures show as the user's view layer does."""


def _match_views(scene: bpy.types.Scene, views: list[bpy.types.Scene]) -> None:
    """Give the views the user's settings; cameras and samples are a frame's.

    A denoiser takes colours, albedo and normals of views at once: to clean the latter two before,
    which hardly any noise is in without glass, costs two runs more in each view, and 1 % of the
    error inside the glass.
    """
    user_layer = rendered_layer(scene)
    sharp = {"use_motion_blur": False} if _is_exposed(scene) else {}
    for capture in views:
        kept = {
            "scene": {"camera": capture.camera},
            "render": dict.fromkeys(("use_compositing", "use_sequencer", "use_multiview"), False)
            | sharp,
            "cycles": {"samples": capture.cycles.samples, "denoising_prefilter": "FAST"},
            "eevee": {"taa_render_samples": capture.eevee.taa_render_samples},
        }
        if own(capture, SKY):
            # What the film leaves out mirrors may show.
            kept["render"]["film_transparent"] = False
            # Of the pane.
            kept["cycles"] |= {"max_bounces": 1, "transmission_bounces": 1}
            # Of the world's own sun, which EEVEE sets up for each sample.
            kept["eevee"]["use_shadows"] = False
        match_settings(scene, capture, kept)
        layer = capture.view_layers[0]
        # A pane has its own material.
        for name in ("world_override",) if own(capture, SKY) else _OF_LAYERS:
            if hasattr(layer, name):
                write_setting(layer, name, getattr(user_layer, name))


def update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, view: Viewpoint) -> Status:
    """Write one frame's pictures, cameras and samples.

    Motion blur asks for other times round the frame's own, which comes first: what stands where is
    noted then, see `finish`.
    """
    started = time.perf_counter()
    memory = memory_of(scene)
    moment = scene.frame_current + scene.frame_subframe
    if scene.render.use_motion_blur and memory.centre is not None:
        if moment != memory.centre:
            _note(scene, depsgraph, view, moment)
        if moment != memory.centre or memory.exposure is not None:
            return memory.status
    memory.centre = moment
    problems = [*memory.standing, *_blurred(scene)]
    if not _stands(scene):
        # A render's thread can build nothing.
        problems.append(UNREADY)
    views = find_own_scenes(scene, (CAPTURE, SKY))
    read = _read(scene, depsgraph, view, moment, problems)
    result = compute(read, _casters(scene), ROOM, _kept(scene), _kept_light(scene))
    # From here on all is written: a picture of two frames' halves would be none.
    check()
    white = 2.0**-depsgraph.scene_eval.view_settings.exposure
    _write(scene, views, result, read.sky.is_of_cameras, white)
    if result.placed.twin is not None and read.shutter is not None:
        memory.exposure = Exposure(read, result.placed, white)
    problems += _lit_from_elsewhere(scene, result)
    problems += _thickened(scene, read)
    problems += [
        f'Rays do not meet "{owner}": no volume or Grease Pencil is refracted, and no more hair '
        "and points than two million triangles stand for"
        for owner in read.things.unmet
    ]
    looks = zip(read.things.owners, read.things.looks, strict=True)
    problems += [
        f'"{owner}" asks for more of a ray than if it is a camera\'s (Light Path node), and looks '
        "in the glass as behind a pane"
        for owner in dict.fromkeys(owner for owner, look in looks if look.is_of_paths)
    ]
    veils = dict(result.veils)
    if not _show_real(scene, depsgraph, read, result):
        problems += [
            f'"{owner}" mirrors a glass, and what mirrors show is rendered without glasses'
            for owner, share in result.mirrors.items()
            if share > TOLD_MIRRORED
        ]
        veils |= result.windows
    problems += [
        f'"{owner}" is before a glass and is seen through, but without that glass behind it: '
        "if it is glass, make it one"
        for owner, share in veils.items()
        if share > TOLD_VEILED
    ]
    status = Status(
        milliseconds=1e3 * (time.perf_counter() - started),
        problems=problems,
        views=result.reports,
        unseen=result.unseen,
        rays=result.rays,
        ways=result.ways,
        covered=result.covered,
    )
    memory.status = status
    memory.covered = result.spread[..., 3] < UNCOVERED
    return status


def _note(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, view: Viewpoint, time: float
) -> None:
    """Note where all stands at another moment of the frame's shutter."""
    exposure = memory_of(scene).exposure
    if exposure is not None:
        # What is wrong with a glass the frame itself has told.
        glasses = tuple(read_glasses(depsgraph, []))
        things = _read_things(scene, depsgraph, frozenset(glass.name for glass in glasses))
        exposure.moments.append(Moment(time, view, glasses, things))


def finish(scene: bpy.types.Scene) -> None:
    """Write the picture of a frame that motion blurs, once its render has gone through all moments.

    It changes pictures alone: cameras of its own scenes may be in use.
    """
    memory = memory_of(scene)
    exposure, memory.exposure = memory.exposure, None
    if exposure is None or not exposure.moments:
        return
    shutter = exposure.frame.shutter.with_moments(exposure.moments)
    if shutter.is_still:
        return
    frame = replace(exposure.frame, shutter=shutter)
    result = expose(frame, _casters(scene), _kept(scene), exposure.placed)
    check()
    memory.covered = result.spread[..., 3] < UNCOVERED
    _write_pictures(Pictures(scene), result, exposure.white)
    status = memory.status
    status.rays, status.ways, status.covered = result.rays, result.ways, result.covered
    status.views, status.unseen = result.reports, result.unseen


def _show_real(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, read: FrameInput, result: FrameResult
) -> bool:
    """Have the engine's mirrors and windows show the glasses, and tell whether they show all."""
    # Before a capture that looks through a pane, as through a window, would stand the glass.
    through = not any(camera is not None and camera.is_paned for camera in result.cameras)
    is_asked = result.mirrors or (result.windows and through)
    glasses = read.glasses if is_asked else ()
    places = {
        obj.name: np.array(obj.evaluated_get(depsgraph).matrix_world, float)
        for obj in glass_objects(rendered_layer(scene), ever=True)
        if is_shown(obj, depsgraph)
    }
    cast = find_own_scenes(scene, (CAST,))[0]
    found = write_mirrored(cast, glasses, places, memory_of(scene).mirrored, through=through)
    return {glass.name for glass in read.glasses} <= found and (through or not result.windows)


def ease_world(depsgraph: bpy.types.Depsgraph) -> None:
    """Have Cycles draw no large map of the world's light for a view that is about to be rendered.

    Views of the world alone light nothing; of captures what the user set by hand stays. Only the
    render's own copy of the world is written, which goes with it, and as files hold it: a write by
    Cycles' property would have all windows told.
    """
    view = depsgraph.scene_eval
    world = shown_world(view, depsgraph.view_layer_eval)
    if view.render.engine != "CYCLES" or world is None or not world.is_evaluated:
        return
    methods = world.cycles.bl_rna.properties["sampling_method"].enum_items
    paths = math.prod(render_size(view)) * view.cycles.samples
    if own(view, SKY):
        values = {"sampling_method": methods["NONE"].value}
    elif world.original.cycles.sampling_method == "AUTOMATIC" and paths <= FEW_PATHS:
        values = {"sampling_method": methods["MANUAL"].value, "sample_map_resolution": WORLD_MAP}
    else:
        return
    stored = world.bl_system_properties_get(do_create=True)
    if "cycles" not in stored:
        stored["cycles"] = {}
    for name, value in values.items():
        stored["cycles"][name] = value


def _blurred(scene: bpy.types.Scene) -> list[str]:
    """A line for each blur that the glass has no part in, or not all."""
    camera, found = scene.camera, []
    if _has_lens(scene) and camera.data.type == "ORTHO":
        found.append(
            f'Camera "{camera.name}" is orthographic and has depth of field: what is seen in the '
            "glass is blurred where the picture shows it, else sharp"
        )
    elif _has_lens(scene) and scene.refractive_glass.captures < ROOMY:
        found.append(
            f'Camera "{camera.name}" has depth of field, and a glass out of focus is sharp: choose '
            "two captures or more"
        )
    moving = _moving(scene)
    if moving is not None and scene.refractive_glass.captures < ROOMY:
        found.append(
            f'Motion blur is on and "{moving.name}" may move: the glass is sharp, and what is seen '
            "in it has sharp outlines: choose two captures or more"
        )
    return found


def _moving(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """A thing that the engine may blur by its motion; None if there is none."""
    layer = rendered_layer(scene)
    if scene.render.engine == "BLENDER_WORKBENCH" or not scene.render.use_motion_blur:
        return None
    if scene.render.engine == "CYCLES" and not layer.use_motion_blur:
        return None
    objects = scene.camera, *glass_objects(layer, ever=True), *source_objects(layer, ever=True)
    return next(filter(may_move, objects), None)


def _is_exposed(scene: bpy.types.Scene) -> bool:
    """Whether what moves is blurred in the glass; the views show all where it is in the frame."""
    return scene.refractive_glass.captures >= ROOMY and _moving(scene) is not None


def _has_lens(scene: bpy.types.Scene) -> bool:
    """Whether the engine shows the camera's depth of field."""
    shown = scene.render.engine != "BLENDER_WORKBENCH" or scene.display.shading.use_dof
    return shown and scene.camera.data.dof.use_dof


def _light_comes_along(scene: bpy.types.Scene) -> bool:
    """Whether Workbench lights what a camera shows from where it looks."""
    shading = scene.display.shading
    if scene.render.engine != "BLENDER_WORKBENCH" or shading.light == "FLAT":
        return False
    return shading.light == "MATCAP" or not shading.use_world_space_lighting


def _lit_from_elsewhere(scene: bpy.types.Scene, result: FrameResult) -> list[str]:
    """A line where captures show what their own cameras light."""
    shading = scene.display.shading
    if not _light_comes_along(scene):
        return []
    share = sum(report.share for report in result.reports if report.name.startswith("capture"))
    if share < TOLD_LIGHT:
        return []
    remedy = (
        "choose Studio as Lighting, with World Space Lighting"
        if shading.light == "MATCAP"
        else "switch World Space Lighting on"
    )
    return [
        f"Workbench's light comes along with each camera, and {share:.0%} of what is seen in the "
        f"glass is lit from elsewhere: {remedy} (Render properties > Lighting)"
    ]


def _thickened(scene: bpy.types.Scene, read: FrameInput) -> list[str]:
    """A line where EEVEE takes all things for thicker than any glass is large.

    EEVEE sees one depth a pixel. Behind it it assumes a thickness, and light between things that
    are thinner is missing: round each outline of a view, so round others in the captures.
    """
    eevee = scene.eevee
    if scene.render.engine != "BLENDER_EEVEE" or not (eevee.use_raytracing and eevee.use_fast_gi):
        return []
    boxes = [body.description.box for body in as_bodies(read.glasses)]
    sizes = [float(np.linalg.norm(np.ptp(box, axis=0))) for box in boxes]
    if not sizes or eevee.fast_gi_thickness_near <= max(sizes):
        return []
    return [
        f"EEVEE takes things for {eevee.fast_gi_thickness_near:.2g} m thick, and the largest glass "
        f"is {max(sizes):.2g} m: round outlines it is too dark, and in the glass otherwise than "
        "beside it. Lower Thickness Near (Render properties > Raytracing > Fast GI Approximation)"
    ]


def _casters(scene: bpy.types.Scene) -> Casters:
    """The scene's casters; they remember their targets, so that these are not built again."""
    memory = memory_of(scene)
    cast = find_own_scenes(scene, (CAST,))[0]
    if memory.casters is None or memory.casters.scene != cast:
        memory.casters = Casters.of(cast)
    return memory.casters


def _kept(scene: bpy.types.Scene) -> Kept:
    memory = memory_of(scene)
    if memory.kept is None:
        memory.kept = Kept()
    return memory.kept


def _kept_light(scene: bpy.types.Scene) -> KeptLight:
    memory = memory_of(scene)
    if memory.kept_light is None:
        memory.kept_light = KeptLight()
    return memory.kept_light


def _read_things(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, mirrors: frozenset[str]
) -> Things:
    """All but glasses, of which those that are seen have their names in ``mirrors``."""
    left_out = frozenset(
        obj.name
        for obj in bpy.data.objects
        if obj.type == "MESH" and glass_modifier(obj) is not None
    )
    return read_things(depsgraph, left_out, mirrors, scene.render.engine, memory_of(scene).masks)


def _read(
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph,
    view: Viewpoint,
    moment: float,
    problems: list[str],
) -> FrameInput:
    settings, user = scene.refractive_glass, depsgraph.scene_eval
    glasses = tuple(read_glasses(depsgraph, problems))
    mirrors = frozenset(glass.name for glass in glasses)
    suns = []
    for instance in depsgraph.object_instances:
        obj = instance.object
        is_sun = obj.type == "LIGHT" and obj.data.type == "SUN"
        if is_sun and is_mirrored(obj, mirrors):
            sun = sun_of(obj.data, np.array(instance.matrix_world, float), scene.render.engine)
            if sun is not None:
                suns.append(sun)
    width, height = render_size(scene)
    render = scene.render
    region = border_window(scene) if render.use_border else (0, 0, width, height)
    samples, name = samples_setting(scene)
    camera = scene.camera.evaluated_get(depsgraph).data
    things = _read_things(scene, depsgraph, mirrors)
    shutter = None
    if _is_exposed(scene):
        own = Moment(moment, view, glasses, things)
        shutter = Shutter(*shutter_times(scene, moment), own, (own,))
    return FrameInput(
        glasses=glasses,
        things=things,
        sky=sky_of(user, tuple(suns), shown_world(user, depsgraph.view_layer)),
        view=view if _has_lens(scene) else replace(view, lens=None),
        near=float(camera.clip_start),
        far=float(camera.clip_end),
        region=region,
        aspect=render.pixel_aspect_y / render.pixel_aspect_x,
        engine=render.engine,
        filter_size=_filter_size(scene),
        samples=int(getattr(samples, name)),
        captures=settings.captures,
        min_weight=settings.min_weight,
        fresnel=settings.surface == "GLASS",
        clamp=Clamp(*clamp_settings(scene, render.engine)),
        seen_through=_seen_through(scene, problems),
        exposure=film_exposure(scene),
        capture_worth=LIT_ELSEWHERE_WORTH if _light_comes_along(scene) else CAPTURE_WORTH,
        light=_read_light(scene, depsgraph, problems),
        mirrors=render.engine == "CYCLES"
        or (render.engine == "BLENDER_EEVEE" and scene.eevee.use_raytracing),
        shutter=shutter,
    )


def _read_light(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, problems: list[str]
) -> LightSettings | None:
    """How lamps' light through the glasses is computed; None where it is not."""
    settings = scene.refractive_glass
    if settings.shadow != "LIGHT":
        return None
    if not has_light(scene):
        problems.append(
            "Workbench has no lamps whose light could fall through the glass: choose another "
            "engine, or Straight as Shadow"
        )
        return None
    problems += [
        f'Glass "{obj.name}" casts a straight shadow beside that of the light through it: switch '
        "off Casts Shadow"
        for obj in all_glasses(rendered_layer(scene))
        if has_input(glass_modifier(obj), "Casts Shadow")
        and read_input(glass_modifier(obj), "Casts Shadow")
    ]
    emitters = read_emitters(depsgraph, scene.render.engine, problems)
    return LightSettings(emitters, settings.light_rays, settings.light_softness)


def _seen_through(scene: bpy.types.Scene, problems: list[str]) -> frozenset[str] | None:
    """Names of what the glasses' collection lets be seen through them; None: all.

    What is opaque of a glass's own mesh is seen in any case.
    """
    chosen, glasses = {}, all_glasses(rendered_layer(scene))
    for obj in glasses:
        collection = read_input(glass_modifier(obj), "Seen Through")
        names = None if collection is None else frozenset(o.name for o in collection.all_objects)
        chosen.setdefault(names, obj.name)
    if len(chosen) > 1:
        one, other, *_ = chosen.values()
        problems.append(
            f'Glasses "{one}" and "{other}" have different Seen Through collections, and True '
            "shading shows everything then: choose the same, or Displaced as Shading"
        )
        return None
    names = next(iter(chosen), None)
    return None if names is None else names.union(glass.name for glass in glasses)


def _filter_size(scene: bpy.types.Scene) -> float:
    if scene.render.engine == "CYCLES":
        return float(scene.cycles.filter_width)
    if scene.render.engine == "BLENDER_WORKBENCH":
        return WORKBENCH_SIGMA.get(scene.display.render_aa, WORKBENCH_MANY)
    return float(scene.render.filter_size)


def _write(
    scene: bpy.types.Scene,
    views: list[bpy.types.Scene],
    result: FrameResult,
    through_panes: bool,
    white: float,
) -> None:
    """Write a frame's pictures and views; those of the sky are seen through panes, or not.

    ``white``: radiance that is shown as white.
    """
    pictures = Pictures(scene)
    height, width = result.spread.shape[:2]
    _write_pictures(pictures, result, white)
    for number, light in enumerate(result.light):
        pictures.write(light, number, "light")
    _match_views(scene, views)
    settings = zip(views, result.cameras, result.samples, result.far, result.curtains, strict=True)
    any_is_rendered = False
    for view, camera, samples, far, curtain in settings:
        kept = _kept_sizes.get(view.session_uid, (width, height))
        is_smaller = kept[0] < width or kept[1] < height
        is_rendered = camera is not None or is_smaller
        write_setting(view.view_layers[0], "use", is_rendered)
        any_is_rendered |= is_rendered
        if is_rendered:
            _kept_sizes[view.session_uid] = width, height
        if is_smaller:
            write_setting(*samples_setting(view), 1)
        if camera is not None:
            _aim_camera(view.camera, camera, far)
            write_setting(*samples_setting(view), samples)
            _hang(view, CURTAIN, curtain)
            if own(view, SKY):
                _hang(view, PANE, PANE_MESH if through_panes else NO_CURTAIN)
            else:
                _hang(view, PANE, pane(camera) if camera.is_paned else NO_CURTAIN)
    # Its size tells: 2 if there is a view that is drawn for this frame, else 1.
    pictures.write(np.zeros((1, 1 + any_is_rendered, 4), np.float32), "rendered")


def _write_pictures(pictures: Pictures, result: FrameResult, white: float) -> None:
    """Write what the compositor sums, but for the light through glasses; the result gives it up.

    ``white``: radiance that is shown as white.
    """
    for number in range(len(result.views)):
        pictures.write_view(number, result.views.pop(0), result.weights.pop(0))
    for name in ("spread", "known"):
        pictures.write(getattr(result, name), name)
    pictures.write(result.known_alpha, "known alpha")
    height, width = result.spread.shape[:2]
    pictures.write(np.full((height, width, 4), white, np.float32), "white")


def _hang(view: bpy.types.Scene, role: str, mesh: tuple[np.ndarray, np.ndarray]) -> None:
    """Hang points (V, 3) and quads (F, 4), in camera space, before a view's camera."""
    obj = next(o for o in view.collection.all_objects if own(o, role))
    obj.data.clear_geometry()
    if len(mesh[1]):
        write_polygons(obj.data, *mesh)
        obj.matrix_world = view.camera.matrix_world
    obj.data.update()


def _aim_camera(camera: bpy.types.Object, view: RadianceView, far: float) -> None:
    """Give a camera object the pose, lens and shift of a view, and let it see so far (metres)."""
    data, p = camera.data, view.projection
    data.type = "ORTHO" if view.is_parallel else "PERSP"
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 32.0
    if view.is_parallel:
        data.ortho_scale = 2.0 / p[0, 0]
    else:
        data.lens = 0.5 * data.sensor_width * p[0, 0]
    off = -p[:2, 3] if view.is_parallel else p[:2, 2]
    # Shifts count in widths, whatever the frame's height.
    data.shift_x, data.shift_y = 0.5 * off * p[0, 0] / p.diagonal()[:2]
    data.dof.use_dof = view.lens is not None
    if view.lens is not None:
        data.dof.focus_distance = view.lens.focus
        data.dof.aperture_fstop = 0.5e-3 * data.lens / view.lens.radius
        data.dof.aperture_ratio = view.lens.ratio
        data.dof.aperture_blades = view.lens.blades
        data.dof.aperture_rotation = view.lens.rotation
    data.clip_start = max(view.near, LEAST_CLIP)
    data.clip_end = max(far, 2.0 * data.clip_start)
    pose = np.eye(4)
    pose[:3, :3] = view.to_camera[:3, :3].T
    pose[:3, 3] = view.eye
    camera.matrix_world = Matrix(pose.tolist())
