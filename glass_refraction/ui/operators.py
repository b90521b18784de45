# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: add a glass, make a mesh a glass, update, compare."""

from __future__ import annotations

import math
import time
from pathlib import Path

import bpy
from bpy_extras.object_utils import AddObjectHelper, object_data_add

from ..scene import update as door
from ..scene.glasses import glass_modifier
from ..scene.materials import glass_material
from ..scene.modifier_inputs import write_input
from ..scene.names import MODIFIER, RefractiveGlassError, load_group

SHAPES = (
    ("SLAB", "Slab", "A flat pane; a mesh's flat face is its outline"),
    ("CYLINDER", "Cylinder", "A hollow cylinder, empty or filled"),
    ("ROD", "Rod", "A solid cylinder"),
    ("SPHERE", "Sphere", "A hollow ball, or a solid one with wall thickness 0"),
)

SLICE_SECONDS = 0.05
"""Work between two looks at the keyboard; one copy may take longer."""


class GlassProperties:
    """What both adding operators ask for; lengths in metres."""

    shape: bpy.props.EnumProperty(name="Shape", items=SHAPES, default="CYLINDER")
    radius: bpy.props.FloatProperty(
        name="Radius", description="Outer radius", default=0.04, subtype="DISTANCE", unit="LENGTH"
    )
    wall_thickness: bpy.props.FloatProperty(
        name="Wall Thickness",
        description="Of the wall, or of the slab",
        default=0.003,
        subtype="DISTANCE",
        unit="LENGTH",
        precision=4,
    )
    height: bpy.props.FloatProperty(
        name="Height",
        description="Of a cylinder or rod",
        default=0.12,
        subtype="DISTANCE",
        unit="LENGTH",
    )
    ior: bpy.props.FloatProperty(
        name="IOR", description="Index of refraction of the glass", default=1.5, precision=4
    )
    contents_ior: bpy.props.FloatProperty(
        name="Contents IOR",
        description="Index of refraction of the contents: 1 for air, 1.333 for water",
        default=1.0,
        precision=4,
    )

    def problem(self) -> str | None:
        """What is wrong with the values, as one line, or None."""
        lengths = {"Radius": self.radius, "Wall thickness": self.wall_thickness}
        if self.shape in {"CYLINDER", "ROD"}:
            lengths["Height"] = self.height
        if self.shape == "SLAB":
            lengths.pop("Radius")
        if self.shape == "ROD":
            lengths.pop("Wall thickness")
        for name, value in lengths.items():
            solid = self.shape == "SPHERE" and name == "Wall thickness" and value == 0
            if not (math.isfinite(value) and value > 0) and not solid:
                return f"{name} {value:g} m must be positive"
        for name, value in (("IOR", self.ior), ("Contents IOR", self.contents_ior)):
            if not (math.isfinite(value) and value > 0):
                return f"{name} {value:g} must be positive"
        if self.shape in {"CYLINDER", "SPHERE"} and self.wall_thickness >= self.radius:
            return (
                f"Wall thickness {self.wall_thickness:g} m must be smaller than "
                f"the radius {self.radius:g} m"
            )
        return None

    def apply(self, obj: bpy.types.Object) -> None:
        """Put the modifier on the object with these values."""
        modifier = obj.modifiers.new(MODIFIER, "NODES")
        modifier.node_group = load_group(MODIFIER)
        write_input(modifier, "Shape", self.shape.title())
        for socket, value in (
            ("Radius", self.radius),
            ("Wall Thickness", self.wall_thickness),
            ("Height", self.height),
            ("IOR", self.ior),
            ("Contents IOR", self.contents_ior),
            ("Material", glass_material(self.ior)),
        ):
            write_input(modifier, socket, value)

    def draw(self, _context: bpy.types.Context) -> None:
        """The redo panel: only what the shape uses."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "shape")
        if self.shape != "SLAB":
            layout.prop(self, "radius")
        if self.shape != "ROD":
            layout.prop(self, "wall_thickness")
        if self.shape in {"CYLINDER", "ROD"}:
            layout.prop(self, "height")
        layout.prop(self, "ior")
        if self.shape in {"CYLINDER", "SPHERE"}:
            layout.prop(self, "contents_ior")


class OBJECT_OT_refractive_glass_add(bpy.types.Operator, AddObjectHelper, GlassProperties):
    """Add a glass through which objects are seen refracted"""

    bl_idname = "object.refractive_glass_add"
    bl_label = "Refractive Glass"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and context.scene.library is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        problem = self.problem()
        if problem is not None:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        mesh = bpy.data.meshes.new("Refractive Glass")
        if self.shape == "SLAB":
            half = self.radius
            corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
            mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        obj = object_data_add(context, mesh, operator=self, name="Refractive Glass")
        self.apply(obj)
        return {"FINISHED"}


class OBJECT_OT_refractive_glass_modifier_add(bpy.types.Operator, GlassProperties):
    """Make the active mesh object a glass through which objects are seen refracted"""

    bl_idname = "object.refractive_glass_modifier_add"
    bl_label = "Refractive Glass"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        return obj is not None and obj.type == "MESH" and context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.object
        problem = self.problem()
        if obj.library is not None:
            problem = f'"{obj.name}" is linked from a library: make it local first'
        elif glass_modifier(obj) is not None:
            problem = f'"{obj.name}" is a refractive glass already'
        if problem is not None:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        self.apply(obj)
        return {"FINISHED"}


class SCENE_OT_refractive_glass_update(bpy.types.Operator):
    """Bring what is seen through the scene's glasses up to date"""

    bl_idname = "scene.refractive_glass_update"
    bl_label = "Update Refractive Glass"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            return self._end(door.finished(self._steps_of(context)))
        except RefractiveGlassError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        try:
            self._steps = self._steps_of(context)
        except RefractiveGlassError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        manager = context.window_manager
        self._timer = manager.event_timer_add(SLICE_SECONDS, window=context.window)
        manager.progress_begin(0, 100)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._steps.close()
            self._tidy(context)
            self.report({"WARNING"}, "Update of the refractive glass cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        until = time.perf_counter() + SLICE_SECONDS
        try:
            while time.perf_counter() < until:
                step = next(self._steps)
                context.window_manager.progress_update(int(100 * step.share))
                context.workspace.status_text_set(
                    f"Refractive glass: {step.label} ({step.share:.0%})   Esc: cancel"
                )
        except StopIteration as end:
            self._tidy(context)
            return self._end(end.value)
        except RefractiveGlassError as error:
            self._tidy(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def _steps_of(self, context: bpy.types.Context):
        door.prepare(context.scene, context.evaluated_depsgraph_get(), strict=True)
        return door.updating(context.scene, context.evaluated_depsgraph_get(), exact=True)

    def _end(self, found: door.Status) -> set[str]:
        for problem in found.problems:
            self.report({"WARNING"}, problem)
        self.report(
            {"INFO"},
            f"{found.vertices} vertices, paths {', '.join(found.paths) or 'none'}, "
            f"{found.milliseconds:.0f} ms, interpolation within {found.bound_px:.2f} px",
        )
        return {"FINISHED"}

    def _tidy(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)


class SCENE_OT_refractive_glass_compare(bpy.types.Operator):
    """Render the frame with real glass in Cycles and report the difference"""

    bl_idname = "scene.refractive_glass_compare"
    bl_label = "Compare with Cycles"

    directory: bpy.props.StringProperty(
        name="Folder", description="Where pictures and report are written", subtype="DIR_PATH"
    )
    samples: bpy.props.IntProperty(
        name="Samples",
        description="Of the reference; 0 takes the scene's own number",
        default=0,
        min=0,
    )

    def invoke(self, context: bpy.types.Context, _event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        # The reference is a tool of its own; nothing of it loads before it is asked for.
        from ..reference.compare import compare

        folder = Path(bpy.path.abspath(self.directory or "//refractive_glass_compare"))
        manager = context.window_manager
        manager.progress_begin(0, 100)
        try:
            found = compare(
                context.scene,
                folder,
                samples=self.samples or None,
                progress=lambda share: manager.progress_update(int(100 * share)),
            )
        except (RefractiveGlassError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            manager.progress_end()
        self.report({"INFO"}, f"PSNR {found['psnr_db']:.1f} dB, report in {folder}")
        return {"FINISHED"}


CLASSES = (
    OBJECT_OT_refractive_glass_add,
    OBJECT_OT_refractive_glass_modifier_add,
    SCENE_OT_refractive_glass_update,
    SCENE_OT_refractive_glass_compare,
)


def register() -> None:
    """Register the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo :func:`register`."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
