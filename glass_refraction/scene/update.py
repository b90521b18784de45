# SPDX-License-Identifier: GPL-3.0-or-later
"""The one door: whatever changed, ``update`` brings what renders show up to date.

Two steps, because Blender allows data-blocks to be made in some places only:

* :func:`prepare` makes own scenes, objects and nodes match the scene's glasses and sources. Called
  by operators, timers and before a render starts.
* :func:`update` solves and writes arrays. It makes no data-block and may run in a frame-change
  handler of a render.

Both compare with what stands and do only what differs; ``counters`` tells how much that was. What
is common to all ways to a picture is checked here; ``rays.true`` and ``vertices.displaced`` do
the rest.
"""

from __future__ import annotations

from collections.abc import Generator

import bpy
import numpy as np

from .bake.playback import bake_problems, is_held
from .build.compositor import can_insert, remove_group, remove_stray_nodes, shown_scenes
from .build.own_scenes import find_own_scenes, own_blocks, remove_leftovers, remove_own_scenes
from .build.standing import blocks_of, made_for, strays
from .changes import generation
from .material_link import tell_modifier
from .memory import Status, counters, forget, memory_of, status
from .names import RefractiveGlassError, own
from .progress import tell
from .rays import true
from .rays.true import finish
from .read.glasses import (
    all_glasses,
    glass_objects,
    instanced_glasses,
    is_mesh_glass,
    merged_glasses,
    put_last,
    read_glass,
)
from .read.glassy_materials import opaque_bits
from .read.modifier_inputs import glass_modifier, write_input
from .read.unread import unread
from .read.viewpoint import read_viewpoint
from .read.visibility import rendered_layer
from .steps import Do, Step, at_once
from .vertices import displaced

__all__ = [
    "Status",
    "counters",
    "finish",
    "finished",
    "forget",
    "free_leftovers",
    "memory_of",
    "prepare",
    "put_back",
    "remove",
    "set_aside",
    "set_aside_strays",
    "status",
    "update",
    "updating",
    "withdraw",
]


def prepare(
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph,
    *,
    strict: bool = False,
    rendering: bool = False,
) -> None:
    """Make own scenes, copies and the compositor's node group match the scene.

    Parameters
    ----------
    strict : a scene without a glass is an error, not an order to clean up.
    rendering : a render has begun; what it may hold is not freed before the next time.

    Raises
    ------
    RefractiveGlassError
        No camera, a camera or a glass that cannot be computed; nothing is changed then.
    """
    if is_held(scene):
        status(scene).problems = bake_problems(scene)
        return
    _check_scene(scene)
    if _is_broken(scene):
        remove(scene, rendering=rendering)
        forget(scene)
    view_layer = rendered_layer(scene)
    problems = _uncomputed(scene, depsgraph)
    placed = glass_objects(view_layer, ever=True)
    instanced = instanced_glasses(view_layer)
    glasses = _editable(placed, problems)
    is_true = scene.refractive_glass.shading == "TRUE"
    if is_true:
        glasses += _editable(instanced, problems)
        for obj in filter(is_mesh_glass, glasses):
            tell_modifier(obj)
            problems += unread(obj, opaque_bits(glass_modifier(obj)))
    else:
        for obj in instanced:
            if obj.is_editable:
                _show_mesh(scene, obj, True)
        glasses = _closed_forms(glasses, instanced, problems)
    shown_as_meshes = [obj for obj in placed if obj not in glasses and obj.is_editable]
    if strict and not glasses:
        raise RefractiveGlassError(
            " ".join(problems)
            or f'Scene "{scene.name}" has no refractive glass: add one (Add > Mesh > Refractive '
            "Glass)"
        )
    if not scene.refractive_glass.enabled or not glasses:
        remove(scene, rendering=rendering)
        status(scene).problems = problems if scene.refractive_glass.enabled else []
        return
    for obj in glasses:
        # Blender lets no modifier be moved that an overridden object has of its library.
        if obj.override_library is None:
            put_last(obj)
    # What it cannot show it says now.
    read_viewpoint(scene, depsgraph)
    if not can_insert(scene):
        raise RefractiveGlassError(
            f'The compositor tree of scene "{scene.name}" has no Render Layers node of it: add one'
        )
    if is_true:
        if find_own_scenes(scene, displaced.ROLES):
            displaced.remove(scene)
        true.prepare(scene)
        memory_of(scene).standing = list(problems)
    else:
        true.remove(scene)
        displaced.prepare(scene, depsgraph, glasses, problems)
    status(scene).problems = problems
    memory_of(scene).made = made_for(scene)
    for obj in glasses:
        _show_mesh(scene, obj, not _can_be_read(obj, depsgraph))
    for obj in shown_as_meshes:
        _show_mesh(scene, obj, True)
    if not rendering:
        free_leftovers()


def _is_broken(scene: bpy.types.Scene) -> bool:
    """Whether somebody else deleted what was made for the scene."""
    return not memory_of(scene).made <= made_for(scene)


def _check_scene(scene: bpy.types.Scene) -> None:
    """Raise what is wrong with the scene's settings."""
    if scene.library is not None:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" is linked from a library: make it local (Object > Relations)'
        )
    settings = scene.refractive_glass
    for name in ("min_weight", "tolerance_px", "light_softness"):
        if not np.isfinite(getattr(settings, name)):
            label = settings.bl_rna.properties[name].name
            raise RefractiveGlassError(
                f'{label} of scene "{scene.name}" is no number: enter it anew (Render Properties)'
            )
    if not settings.enabled or not all_glasses(rendered_layer(scene)):
        return
    if not scene.render.use_compositing:
        raise RefractiveGlassError(
            f'Compositing is off in scene "{scene.name}": switch it on (Output Properties > Post '
            "Processing)"
        )
    if scene.render.use_multiview:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" renders two eyes, and the glass is computed for one: switch off '
            "Stereoscopy (Output Properties)"
        )
    if scene.render.use_single_layer:
        raise RefractiveGlassError(
            f'Scene "{scene.name}" renders a single layer, which leaves out the compositor: switch '
            "off Render Single Layer (View Layer Properties)"
        )


def _uncomputed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> list[str]:
    """A line for each glass that the scene takes into something else, where nobody computes it."""
    found = [
        f'Geometry Nodes of "{host.name}" merge glass "{glass.name}" into its mesh, where it is no '
        "glass: switch on As Instance in Object Info, and realize no instances"
        for host, glass in merged_glasses(scene, depsgraph)
    ]
    found += [
        f'Scene "{scene.name}" shows the layers of scene "{other.name}", whose glasses are '
        "computed where it is rendered itself only: render it to a file, and show that by an Image "
        "node"
        for other in shown_scenes(scene)
        if other.refractive_glass.enabled and all_glasses(rendered_layer(other))
    ]
    found += [
        f'Glass "{glass.name}" is not computed in scene "{scene.name}", which has it by its '
        "background set: link it to the scene (Object > Link/Transfer Data)"
        for glass in _in_background(scene)
    ]
    return found


def _in_background(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The glasses of a scene's background set, and of that one's, that are not its own."""
    found, behind = [], scene.background_set
    while behind is not None:
        found += [glass for glass in all_glasses(rendered_layer(behind)) if glass not in found]
        behind = behind.background_set
    own_ones = all_glasses(rendered_layer(scene)) if found else ()
    return [glass for glass in found if glass not in own_ones]


def _editable(glasses: list[bpy.types.Object], problems: list[str]) -> list[bpy.types.Object]:
    """The glasses that can be shown; a line for each that is linked."""
    found = []
    for obj in glasses:
        if obj.is_editable:
            found.append(obj)
        else:
            problems.append(
                f'Glass "{obj.name}" is linked from a library: make it local (Object > Relations)'
            )
    return found


def _closed_forms(
    glasses: list[bpy.types.Object], instanced: list[bpy.types.Object], problems: list[str]
) -> list[bpy.types.Object]:
    """The glasses that displaced copies can show; a line for each of the others."""
    for obj in instanced:
        problems.append(
            f'Glass "{obj.name}" is instanced and Displaced shading shows it as a mesh: choose '
            "True shading (Render Properties), or make the instance real (Object > Apply)"
        )
    for obj in glasses:
        if is_mesh_glass(obj):
            problems.append(
                f'Glass "{obj.name}" is a mesh, which Displaced shading does not know: choose True '
                "shading (Render Properties)"
            )
    return [obj for obj in glasses if not is_mesh_glass(obj)]


def _can_be_read(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    try:
        read_glass(obj, depsgraph)
    except RefractiveGlassError:
        return False
    return True


def remove(scene: bpy.types.Scene, *, rendering: bool = False) -> None:
    """Remove all that was made for the scene's glasses, and only that; renders show them.

    Parameters
    ----------
    rendering : a render has begun; what it may hold is not freed before the next time.
    """
    if scene.library is not None:
        return
    memory_of(scene).made = frozenset()
    true.remove(scene)
    displaced.remove(scene)
    remove_group(scene)
    remove_own_scenes(scene)
    if not rendering:
        free_leftovers()
    _show_meshes(scene)


def free_leftovers() -> None:
    """Remove what nothing needs any more, in any scene. Not while a render goes on."""
    remove_stray_nodes()
    remove_leftovers()


def withdraw(scene: bpy.types.Scene) -> bool:
    """Take out of the file what :func:`prepare` can make again, and tell whether there was any.

    Without the extension it would be a burden: stale layers, and a hole where the glass is. What
    is baked stays.
    """
    if is_held(scene) or scene.library is not None:
        return False
    stood = bool(find_own_scenes(scene))
    known = memory_of(scene)
    remove(scene)
    memory = memory_of(scene)
    memory.paths, memory.status = known.paths, known.status
    return stood


def set_aside(scene: bpy.types.Scene, *, rendering: bool = False) -> None:
    """Have a file that is written now hold nothing of what :func:`prepare` can make again.

    In True shading all that was made stays, with what was rendered: where an Image Editor shows a
    render's picture, Blender composites it once more after a save. In Displaced shading it is
    withdrawn. Scenes of that come first: to withdraw frees what no tree holds, also of others.

    Parameters
    ----------
    rendering : something may hold what would be freed.
    """
    if is_held(scene) or scene.library is not None or not find_own_scenes(scene, (true.CAST,)):
        if not rendering:
            withdraw(scene)
        return
    # The materials and the modifier of glasses are the file's.
    blocks = [block for block in blocks_of(scene) if not own(block, "glass")]
    true.set_aside(scene)
    remove_group(scene)
    memory_of(scene).made = made_for(scene)
    for block in blocks:
        block.is_runtime_data = True
    _show_meshes(scene)


def set_aside_strays() -> None:
    """Have a file that is written now hold nothing of scenes and trees that the user took away.

    A tree that nothing uses any more is not written, but what is in it would be.
    """
    remove_stray_nodes()
    for block in strays():
        block.is_runtime_data = True


def put_back() -> None:
    """Have undo know data-blocks again that were set aside."""
    for block in own_blocks():
        block.is_runtime_data = False


def _show_meshes(scene: bpy.types.Scene) -> None:
    """Let renders show the meshes of all the scene's glasses."""
    for obj in bpy.data.objects:
        if obj.type != "MESH" or not obj.is_editable or glass_modifier(obj) is None:
            continue
        # One that stands in no scene is shown by instances.
        if obj.name in scene.objects or not obj.users_scene:
            _show_mesh(scene, obj, True)


def _show_mesh(scene: bpy.types.Scene, glass: bpy.types.Object, shown: bool) -> None:
    """Let renders show the glass's own mesh, unless another scene computes the same glass.

    What is set aside there does not count.
    """
    others = (s for s in bpy.data.scenes if s != scene and glass.name in s.objects)
    made = (own_scene for other in others for own_scene in find_own_scenes(other))
    if not shown or all(own_scene.is_runtime_data for own_scene in made):
        write_input(glass_modifier(glass), "Show in Render", shown)


def update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> Status:
    """Solve what changed and write it into what :func:`prepare` made.

    Parameters
    ----------
    scene : the user's (original) scene.
    depsgraph : evaluated; of a render or of the viewport.
    """
    return finished(updating(scene, depsgraph))


def finished(steps: Generator[Step, None, Status]) -> Status:
    """What an update ends with that is not asked to stop between."""
    try:
        while True:
            try:
                tell(next(steps).label)
            except StopIteration as end:
                return end.value
    finally:
        tell(None)


def updating(
    scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, do: Do = at_once
) -> Generator[Step, None, Status]:
    """:func:`update` in steps: each may be the last, what stands is then what it was.

    ``do`` does the long work. A step comes again while that goes on.
    """
    memory = memory_of(scene)
    if not scene.refractive_glass.enabled or is_held(scene):
        return memory.status
    if _is_broken(scene):
        # A render's thread can build nothing.
        raise RefractiveGlassError(
            f'What was made for the glasses of scene "{scene.name}" was deleted: render again'
        )
    if not find_own_scenes(scene) or _is_of_another_layer(scene, depsgraph):
        return memory.status
    view = read_viewpoint(scene, depsgraph)
    is_render = depsgraph.mode == "RENDER"
    if scene.refractive_glass.shading == "TRUE":
        # Of use to renders alone; 3D views follow rays in their own way.
        return true.update(scene, depsgraph, view) if is_render else memory.status
    # Renders send no update notifications, so nothing may be taken to be as it was.
    still = None if is_render else (generation(scene), view.stamp(), _settings_stamp(scene))
    if still is not None and memory.still == still:
        return memory.status
    found = yield from displaced.updating(scene, depsgraph, view, do)
    memory.still = still
    return found


def _is_of_another_layer(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether a render evaluates a view layer in which the glass is not computed."""
    name = depsgraph.view_layer.name
    return depsgraph.mode == "RENDER" and name != rendered_layer(scene).name


def _settings_stamp(scene: bpy.types.Scene) -> tuple:
    settings = scene.refractive_glass
    return (settings.surface, settings.tolerance_px, settings.min_weight, scene.camera.name)
