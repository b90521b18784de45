# SPDX-License-Identifier: GPL-3.0-or-later
"""500 random steps by operators and settings: one line where something is wrong, and panels draw.

What happens to the user's data meanwhile is the business of ``tests/no_harm``.
"""

import random
import sys
from pathlib import Path

import bpy
import pytest

from glass_refraction import handlers
from glass_refraction.scene.read.modifier_inputs import glass_modifier, has_input, write_input
from glass_refraction.ui import menus, overlay, panels, presets

sys.path.insert(0, str(Path(__file__).parent))
from drawing import Layout, labels_of

STEPS = 500
MOST_OBJECTS = 8
SIZES = (0.0, -1.0, 1e-9, 0.01, 1.0, 50.0, 1e9, float("nan"))
SHAPES = ("SLAB", "CYLINDER", "ROD", "SPHERE", "TUMBLER", "REVOLUTION")


def _some_object(walk):
    objects = [o for o in bpy.context.view_layer.objects if not o.name.startswith(".")]
    chosen = walk.choice([None, *objects])
    bpy.context.view_layer.objects.active = chosen
    for obj in objects:
        obj.select_set(obj is chosen)
    return chosen


def add(walk):
    bpy.ops.object.refractive_glass_add(
        shape=walk.choice(SHAPES),
        radius=walk.choice(SIZES),
        height=walk.choice(SIZES),
        liquid_level=walk.choice((0.0, 0.05)),
        contents=walk.choice(("CUSTOM", "WATER")),
    )


def add_everyday(walk):
    kind = walk.choice(presets.PRESETS).identifier
    bpy.ops.object.refractive_glass_everyday_add(kind=kind, size=walk.choice((0.0, 1.0, 1e8)))


def add_mesh(walk):
    kind = walk.choice(("cube", "plane", "uv_sphere", "torus"))
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")()


def make_glass(walk):
    _some_object(walk)
    bpy.ops.object.refractive_glass_modifier_add(shape=walk.choice((*SHAPES, "MESH")))


def turn_normals(walk):
    _some_object(walk)
    bpy.ops.object.refractive_glass_turn_normals()


def choose_medium(walk):
    obj = _some_object(walk)
    if obj is not None and obj.type == "MESH" and glass_modifier(obj) is not None:
        obj.refractive_glass_medium = walk.choice(("WATER", "DIAMOND", "CUSTOM"))


def write(walk):
    obj = _some_object(walk)
    modifier = glass_modifier(obj) if obj is not None and obj.type == "MESH" else None
    name = walk.choice(("Radius", "Wall Thickness", "Height", "IOR", "Liquid Level"))
    if modifier is not None and has_input(modifier, name):
        write_input(modifier, name, walk.choice((0.0, -1.0, 1e-6, 0.5, 1.4, 1e6)))


def settings(walk):
    found = bpy.context.scene.refractive_glass
    name = walk.choice(("enabled", "shading", "surface", "quality", "captures", "min_weight"))
    values = {
        "enabled": (True, True, False),
        "shading": ("TRUE", "DISPLACED"),
        "surface": ("GLASS", "REFRACTION"),
        "quality": ("DRAFT", "GOOD", "FINAL"),
        "captures": (0, 1, 3),
        "min_weight": (0.01, 0.3),
    }
    setattr(found, name, walk.choice(values[name]))


def prepare(_walk):
    bpy.context.scene.refractive_glass.shading = "TRUE"
    # As the timer does, once Blender has brought the scene up to date.
    bpy.context.view_layer.update()
    handlers._prepare(bpy.context.scene)


def camera(walk):
    if walk.random() < 0.5:
        bpy.ops.object.camera_add()
    bpy.context.scene.camera = next(
        (o for o in bpy.context.scene.objects if o.type == "CAMERA"), None
    )


def mode(walk):
    if _some_object(walk) is not None and bpy.ops.object.mode_set.poll():
        bpy.ops.object.mode_set(mode="EDIT")


def delete(walk):
    obj = _some_object(walk)
    if obj is not None:
        bpy.data.objects.remove(obj)


def compare(_walk):
    # Without a camera, with none that can be compared, or with one switched off.
    if bpy.context.scene.camera is None:
        bpy.ops.scene.refractive_glass_compare(directory="//nowhere")


def undo(_walk):
    bpy.ops.ed.undo_push(message="step")
    bpy.ops.ed.undo()


WAYS = (
    *(add, add_everyday, add_mesh, make_glass, write, settings) * 3,
    *(turn_normals, choose_medium, prepare, camera, mode, compare, undo),
    *(delete,) * 6,
)


def _draw_all():
    for panel in (*panels.CLASSES, overlay.VIEW3D_PT_refractive_glass_view):
        if getattr(panel, "poll", bool)(bpy.context):
            labels_of(panel)
    for menu in (menus.VIEW3D_MT_refractive_glass_add, menus.VIEW3D_MT_refractive_glass_shapes):
        menu.draw(type("_", (), {"layout": Layout()})(), bpy.context)


@pytest.mark.parametrize("seed", [17, 2013])
def test_random_steps_are_done_or_refused_in_one_line(seed):
    walk = random.Random(seed)
    done, refused = 0, 0
    for number in range(STEPS):
        way = walk.choice(WAYS)
        if bpy.context.mode != "OBJECT" and walk.random() < 0.5:
            bpy.ops.object.mode_set(mode="OBJECT")
        if len(bpy.context.scene.objects) > MOST_OBJECTS:
            way = delete
        try:
            way(walk)
            done += 1
        except RuntimeError as error:
            lines = str(error).strip().splitlines()
            assert len(lines) == 1 and "Traceback" not in lines[0], (seed, number, way, lines)
            refused += 1
        _draw_all()
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    assert done > STEPS / 3
    assert refused > STEPS / 20
