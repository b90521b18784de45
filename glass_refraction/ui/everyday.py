# SPDX-License-Identifier: GPL-3.0-or-later
"""Add an everyday glass, at a size that fits the scene."""

from __future__ import annotations

import math

import bpy
import numpy as np
from bpy_extras.object_utils import AddObjectHelper, add_object_align_init, object_data_add
from mathutils import Euler, Matrix, Vector

from ..scene.read.modifier_inputs import glass_modifier, write_input
from . import staying
from .operators import MAX_LENGTH, MIN_LENGTH, can_edit
from .presets import LENGTHS, PRESETS, Part

FITS = 4.0
"""A glass keeps its real size where the scene asks for up to so many times more or less."""
VIEW_SHARE = 0.25
"""Of the view's height: as large as a glass is made where nothing is selected."""
_QUAD = 4
"""Corners of a face that may be smooth; those of more end a tube."""
_TIDY = (1.0, 2.0, 5.0, 10.0)
"""Sizes are made larger or smaller by such numbers and their powers of ten."""

_BY_NAME = {preset.identifier: preset for preset in PRESETS}


class OBJECT_OT_refractive_glass_everyday_add(bpy.types.Operator, AddObjectHelper):
    """Add an everyday glass, through which objects are seen refracted"""

    bl_idname = "object.refractive_glass_everyday_add"
    bl_label = "Add Everyday Glass"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Glass",
        description="Which glass",
        items=[(p.identifier, p.label, p.description) for p in PRESETS],
        default="GLASS_OF_WATER",
        options={"SKIP_SAVE"},
    )
    size: bpy.props.FloatProperty(
        name="Size",
        description="Its largest extent; 0 is that of a real one",
        default=0.0,
        min=0.0,
        subtype="DISTANCE",
        unit="LENGTH",
        precision=4,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_edit(cls, context)

    @classmethod
    def description(cls, _context: bpy.types.Context, properties) -> str:
        return _BY_NAME[properties.kind].description

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        if not self.properties.is_property_set("size"):
            self.size = fitting_size(context, _BY_NAME[self.kind].size)
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        preset = _BY_NAME[self.kind]
        size = self.size or preset.size
        if not MIN_LENGTH <= size <= MAX_LENGTH:
            self.report({"ERROR"}, f"Size is {size:g} m: give a length up to {MAX_LENGTH:g} m")
            return {"CANCELLED"}
        place = add_object_align_init(context, self)
        factor = size / preset.size
        made: list[bpy.types.Object] = []
        for part in preset.parts:
            obj = _add(context, part, factor)
            if obj is None:
                return {"CANCELLED"}
            obj.name = f"{preset.label} {part.name}".strip()
            turn = Euler(part.rotation).to_matrix().to_4x4()
            matrix = Matrix.Translation(factor * Vector(part.location)) @ turn
            if made:
                obj.parent = made[0]
                obj.matrix_parent_inverse = Matrix()
                first = preset.parts[0]
                base = Matrix.Translation(factor * Vector(first.location))
                base @= Euler(first.rotation).to_matrix().to_4x4()
                obj.matrix_local = base.inverted() @ matrix
            else:
                obj.matrix_world = place @ matrix
            made.append(obj)
        for obj in made[1:]:
            obj.select_set(False)
        made[0].select_set(True)
        context.view_layer.objects.active = made[0]
        return {"FINISHED"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("kind", "size", "align", "location", "rotation"):
            layout.prop(self, name)


def _add(context: bpy.types.Context, part: Part, factor: float) -> bpy.types.Object | None:
    """The object of a part, at the origin; None where Blender's operators said why not."""
    values = {k: factor * v if k in LENGTHS else v for k, v in part.values.items()}
    if part.vertices is None:
        ended = bpy.ops.object.refractive_glass_add(
            **values, location=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0)
        )
    else:
        mesh = bpy.data.meshes.new("Refractive Glass")
        mesh.from_pydata((factor * part.vertices).tolist(), [], part.faces)
        if part.smooth:
            smooth = [len(face) == _QUAD for face in part.faces]
            mesh.polygons.foreach_set("use_smooth", smooth)
        object_data_add(context, mesh, name="Refractive Glass")
        ended = bpy.ops.object.refractive_glass_modifier_add(shape="MESH", **values)
    if "FINISHED" not in ended:
        return None
    obj = context.object
    write_input(glass_modifier(obj), "Priority", part.priority)
    return obj


def fitting_size(context: bpy.types.Context, real: float) -> float:
    """A glass's largest extent, metres, for what is selected or for what the view shows.

    ``real`` : that of a real one, which is kept where it is not much too large or too small.
    """
    wanted = _selected_size(context) or VIEW_SHARE * _view_height(context)
    if not wanted or real / FITS <= wanted <= real * FITS:
        return real
    power = 10.0 ** math.floor(math.log10(wanted / real))
    return real * power * max(t for t in _TIDY if t * power * real <= wanted)


def _selected_size(context: bpy.types.Context) -> float:
    """The largest extent of the selected objects that have one, metres."""
    sizes = [max(obj.dimensions) for obj in context.selected_objects if obj.type == "MESH"]
    return max(sizes, default=0.0)


def _view_height(context: bpy.types.Context) -> float:
    """Metres that the 3D view shows from top to bottom, at the 3D cursor; 0 without a view."""
    view = getattr(context.space_data, "region_3d", None)
    if view is None:
        return 0.0
    # Column of clip coordinates: one metre upwards in the view, at the cursor's depth.
    depth = float((view.perspective_matrix @ context.scene.cursor.location.to_4d())[3])
    per_metre = float(np.abs(view.window_matrix[1][1])) / abs(depth)
    return 2.0 / per_metre if depth > 0.0 else 0.0


register, unregister = staying.classes((OBJECT_OT_refractive_glass_everyday_add,))
