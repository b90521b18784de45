# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: add a glass, make a mesh a glass, update."""

from __future__ import annotations

from contextlib import closing

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as _iface
from bpy.app.translations import pgettext_rpt as _rpt
from bpy_extras.object_utils import AddObjectHelper, object_data_add

from ..scene import update as door
from ..scene.build.materials import glass_material
from ..scene.names import MODIFIER, load_group, own
from ..scene.read.arrays import positions
from ..scene.read.glasses import LEAST_LENGTH, put_last
from ..scene.read.glassy_materials import glassy_materials, interface_of
from ..scene.read.lathe import Lathe, lathe_of
from ..scene.read.mesh_corners import triangles_of
from ..scene.read.mesh_glasses import open_edges
from ..scene.read.modifier_inputs import glass_modifier, write_input
from ..scene.read.orientation import orientation_of, turn_all, turn_outwards
from ..scene.read.profile_curves import form_profile, turned_profile
from ..scene.steps import Apart, Step
from . import staying
from .lines import draw_lines
from .media import CUSTOM, MEDIUM_ITEMS, choose_ior
from .overlay import show_first_glass
from .stepwise import Steps, Stepwise

SHAPES = (
    ("SLAB", "Slab", "A flat pane; a mesh's flat face is its outline"),
    ("CYLINDER", "Cylinder", "A hollow cylinder, empty or filled"),
    ("ROD", "Rod", "A solid cylinder"),
    ("SPHERE", "Sphere", "A hollow ball, or a solid one with wall thickness 0"),
    ("TUMBLER", "Tumbler", "A drinking glass with a bottom, filled up to a level"),
    (
        "REVOLUTION",
        "Revolution",
        "A profile curve turned about the upright axis: a wine glass, a carafe, a lens",
    ),
)
OWN_MESH = (
    "MESH",
    "Mesh",
    "The object's own mesh with its modifiers, closed, or open as Cycles treats it",
)

FORMS = (
    ("WINE", "Wine Glass", "A foot, a stem and a bowl"),
    ("BOTTLE", "Bottle", "A bottle with a neck"),
    ("VASE", "Vase", "A belly, a waist and a rim"),
    ("BOWL", "Bowl", "A ball with a foot and an opening"),
    ("LENS", "Lens", "Solid, with two curved faces; its axis is upright"),
)

SIZES = {
    "SLAB": ("wall_thickness",),
    "CYLINDER": ("radius", "wall_thickness", "height"),
    "ROD": ("radius", "height"),
    "SPHERE": ("radius", "wall_thickness"),
    "TUMBLER": ("radius", "wall_thickness", "height", "bottom_thickness"),
    "REVOLUTION": (),
    "MESH": (),
}
"""The lengths that a shape has."""
WITHOUT_CONTENTS = {"ROD", "MESH"}
"""Shapes that hold nothing of their own."""

MIN_LENGTH, MAX_LENGTH = LEAST_LENGTH, 1e6
"""Metres. Beyond, Blender's own float32 meshes lose their shape."""
MAX_IOR = 100.0
FLATNESS = 1e-4
"""Of a slab's outline, relative to its size."""

_LENGTH = {"subtype": "DISTANCE", "unit": "LENGTH", "precision": 4}


class GlassProperties:
    """What both adding operators ask for; lengths in metres."""

    shape: bpy.props.EnumProperty(
        name="Shape", description="What the glass is", items=SHAPES, default="CYLINDER"
    )
    radius: bpy.props.FloatProperty(
        name="Radius",
        description="Outer radius; of a new slab half its width",
        default=0.04,
        soft_min=0.001,
        **_LENGTH,
    )
    wall_thickness: bpy.props.FloatProperty(
        name="Wall Thickness",
        description="Of the wall, or of the slab; a sphere with 0 is a solid ball",
        default=0.003,
        soft_min=0.0,
        **_LENGTH,
    )
    height: bpy.props.FloatProperty(
        name="Height",
        description="Of a cylinder, rod or tumbler",
        default=0.12,
        soft_min=0.001,
        **_LENGTH,
    )
    bottom_thickness: bpy.props.FloatProperty(
        name="Bottom Thickness",
        description="Of a tumbler's bottom",
        default=0.006,
        soft_min=0.0,
        **_LENGTH,
    )
    liquid_level: bpy.props.FloatProperty(
        name="Liquid Level",
        description="Height of the liquid above the lowest point inside; 0: empty",
        default=0.0,
        min=0.0,
        **_LENGTH,
    )
    profile: bpy.props.StringProperty(
        name="Profile",
        description="Name of the curve object that is turned: x is the radius, z the height; its "
        "first spline is the outside, its second the inside. Empty: that of the mesh where it is a "
        "turned body, else a wine glass is made",
    )
    form: bpy.props.EnumProperty(
        name="Form", description="The profile that is made where none is named", items=FORMS
    )
    ior: bpy.props.FloatProperty(
        name="IOR",
        description="Index of refraction of the glass",
        default=1.5,
        soft_min=1.0,
        soft_max=3.0,
        precision=4,
    )
    contents_ior: bpy.props.FloatProperty(
        name="Contents IOR",
        description="Index of refraction of the contents, or of what lies behind a slab: "
        "1 for air, 1.333 for water",
        default=1.0,
        soft_min=1.0,
        soft_max=3.0,
        precision=4,
    )
    medium: bpy.props.EnumProperty(
        name="Medium",
        description="What the glass is made of; Custom takes the index of refraction below",
        items=MEDIUM_ITEMS,
        default=CUSTOM,
        options={"SKIP_SAVE"},
    )
    contents: bpy.props.EnumProperty(
        name="Contents",
        description="What the glass holds, or what lies behind a slab; Custom takes the index of "
        "refraction below",
        items=MEDIUM_ITEMS,
        default=CUSTOM,
        options={"SKIP_SAVE"},
    )

    def take_media(self) -> None:
        """Give the indices of refraction the values of the media that are named."""
        for field, medium in (("ior", self.medium), ("contents_ior", self.contents)):
            ior = choose_ior(medium)
            if ior is not None:
                setattr(self, field, ior)

    def problem(self) -> str | None:
        """What is wrong with the values, as one line, or None."""
        turned = self.shape == "REVOLUTION"
        curve = bpy.data.objects.get(self.profile)
        if turned and self.profile and (curve is None or curve.type != "CURVE"):
            return _rpt('"{}" is no curve object: choose one as the profile').format(self.profile)
        own_height = turned and self._own_height is not None
        for name in (*self._lengths, "height") if own_height else self._lengths:
            value = getattr(self, name)
            solid = self.shape == "SPHERE" and name == "wall_thickness" and value == 0
            if not (MIN_LENGTH <= value <= MAX_LENGTH) and not solid:
                label = _rpt(name.replace("_", " ").capitalize())
                said = _rpt("{} is {:g} m: give a length between {:g} and {:g} m")
                return said.format(label, value, MIN_LENGTH, MAX_LENGTH)
        iors = {"IOR": self.ior}
        if self.shape not in WITHOUT_CONTENTS:
            iors["Contents IOR"] = self.contents_ior
        for name, value in iors.items():
            if not (0 < value <= MAX_IOR):
                return _rpt("{} is {:g}: give a number above 0, up to {:g}").format(
                    _rpt(name), value, MAX_IOR
                )
        if self.shape in {"CYLINDER", "SPHERE", "TUMBLER"} and self.wall_thickness >= self.radius:
            return _rpt("Wall thickness {:g} m must be smaller than the radius {:g} m").format(
                self.wall_thickness, self.radius
            )
        if self.shape == "TUMBLER" and self.bottom_thickness >= self.height:
            return _rpt("Bottom thickness {:g} m must be smaller than the height {:g} m").format(
                self.bottom_thickness, self.height
            )
        return None

    @property
    def _lengths(self) -> tuple[str, ...]:
        """The lengths that are asked for."""
        outline = ("radius",) if self.shape == "SLAB" and self.makes_outline else ()
        return outline + SIZES[self.shape]

    @property
    def _own_height(self) -> float | None:
        """Height that was asked for; None: that of the shape."""
        return self.height if self.properties.is_property_set("height") else None

    makes_outline = False
    """Whether a slab's outline is made from the radius; else the object's mesh is the outline."""

    def apply(
        self, obj: bpy.types.Object, group: bpy.types.NodeTree, lathe: Lathe | None = None
    ) -> None:
        """Put the modifier on the object with these values; ``lathe`` is the mesh's profile."""
        modifier = obj.modifiers.new(MODIFIER, "NODES")
        modifier.node_group = group
        put_last(obj)
        write_input(modifier, "Shape", self.shape.title())
        material = glass_material(self.ior)
        if self.shape == "MESH" and not obj.material_slots:
            obj.data.materials.append(material)
        for socket, value in (
            ("Radius", self.radius),
            ("Wall Thickness", self.wall_thickness),
            ("Height", self.height),
            ("Bottom Thickness", self.bottom_thickness),
            ("Liquid Level", self.liquid_level),
            ("IOR", self.ior),
            ("Contents IOR", self.contents_ior),
            ("Material", material),
        ):
            write_input(modifier, socket, value)
        if self.shape == "REVOLUTION":
            profile = bpy.data.objects.get(self.profile)
            if profile is None:
                if lathe is None:
                    profile = form_profile(obj, self.form, self._own_height)
                else:
                    profile = turned_profile(obj, lathe)
            write_input(modifier, "Profile", profile)

    def draw(self, _context: bpy.types.Context) -> None:
        """The redo panel: only what the shape uses."""
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "shape")
        column = layout.column(align=True)
        if self.shape == "REVOLUTION":
            column.prop_search(self, "profile", bpy.data, "objects")
            if not self.profile:
                column.prop(self, "form")
                column.prop(self, "height")
        for name in self._lengths:
            column.prop(self, name)
        if self.shape in {"REVOLUTION", "TUMBLER"}:
            column.prop(self, "liquid_level")
        self._draw_medium("medium", "ior", "Medium")
        if self.shape not in WITHOUT_CONTENTS:
            label = "Behind" if self.shape == "SLAB" else "Contents"
            self._draw_medium("contents", "contents_ior", label)

    def _draw_medium(self, medium: str, ior: str, label: str) -> None:
        column = self.layout.column(align=True)
        column.prop(self, medium, text=label)
        number = column.row()
        number.enabled = getattr(self, medium) == CUSTOM
        number.prop(self, ior, text="IOR")


class OBJECT_OT_refractive_glass_add(bpy.types.Operator, AddObjectHelper, GlassProperties):
    """Add a glass through which objects are seen refracted"""

    bl_idname = "object.refractive_glass_add"
    bl_label = "Add Refractive Glass"
    bl_options = {"REGISTER", "UNDO"}

    makes_outline = True

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_edit(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.take_media()
        problem = self.problem()
        if problem is None and not context.collection.is_editable:
            problem = _rpt(
                'Collection "{}" is linked from a library: choose another in the outliner'
            ).format(context.collection.name)
        if problem is not None:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        group = load_group(MODIFIER)
        mesh = bpy.data.meshes.new("Refractive Glass")
        if self.shape == "SLAB":
            half = self.radius
            corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
            mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        obj = object_data_add(context, mesh, operator=self, name="Refractive Glass")
        self.apply(obj, group)
        show_first_glass(context)
        return {"FINISHED"}

    def draw(self, context: bpy.types.Context) -> None:
        GlassProperties.draw(self, context)
        for name in ("align", "location", "rotation"):
            self.layout.prop(self, name)


class OBJECT_OT_refractive_glass_modifier_add(bpy.types.Operator, GlassProperties):
    """Make the active mesh object a glass, through which objects are seen refracted"""

    bl_idname = "object.refractive_glass_modifier_add"
    bl_label = "Make Refractive Glass"
    bl_options = {"REGISTER", "UNDO"}

    shape: bpy.props.EnumProperty(
        name="Shape",
        description="What the glass is; if none is chosen a flat mesh is a slab, any other a mesh",
        items=(*SHAPES, OWN_MESH),
        default="MESH",
    )
    is_turned: bpy.props.BoolProperty(
        name="Is Turned",
        description="Whether the mesh was found to be a body that is turned about its z axis",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        if obj is None or obj.type != "MESH":
            cls.poll_message_set(
                _rpt("Select a mesh object: it becomes the glass (text, curves: Object > Convert)")
            )
            return False
        return can_edit(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.object
        problem = None
        if not obj.is_editable:
            problem = _rpt('"{}" is linked from a library: make it local first').format(obj.name)
        elif glass_modifier(obj) is not None:
            problem = _rpt('"{}" is a refractive glass already').format(obj.name)
        else:
            depsgraph = context.evaluated_depsgraph_get()
            evaluated = obj.evaluated_get(depsgraph)
            if not self.properties.is_property_set("shape"):
                self.shape = "SLAB" if _is_flat(evaluated) else "MESH"
            lathe = lathe_of(evaluated.data)
            self.is_turned = lathe is not None
            problem = self._problem_of(obj, depsgraph)
        if problem is not None:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        said = self._said(obj, evaluated, lathe)
        self.apply(obj, load_group(MODIFIER), lathe)
        self.report({"INFO"}, said)
        show_first_glass(context)
        return {"FINISHED"}

    def _said(self, obj: bpy.types.Object, evaluated: bpy.types.Object, lathe: Lathe | None) -> str:
        """What was done, in one line."""
        kind = next(item for item in (*SHAPES, OWN_MESH) if item[0] == self.shape)
        if self.shape == "REVOLUTION" and lathe is not None and not self.profile:
            said = _rpt('"{}" is a glass in place of its mesh: {} of its profile')
        elif self.shape != "MESH":
            said = _rpt('"{}" is a glass in place of its mesh: {}')
        elif lathe is not None:
            said = _rpt('"{}" is a glass: its own mesh. It is turned: {} below is exact')
            kind = next(item for item in SHAPES if item[0] == "REVOLUTION")
        elif any(open_edges(evaluated.data)):
            said = _rpt('"{}" is a glass: its own mesh, which is not closed (see its panel)')
        elif not orientation_of(evaluated.data).is_right:
            said = _rpt('"{}" is a glass: its own mesh, whose normals are wrong (see its panel)')
        elif len(glassy_materials(obj)) > 1:
            said = _rpt('"{}" is a glass: its own mesh, all of its first material of glass')
        else:
            said = _rpt('"{}" is a glass: its own mesh')
        return said.format(obj.name, _iface(kind[1]))

    def draw(self, context: bpy.types.Context) -> None:
        if self.is_turned and self.shape == "MESH":
            text = _iface("The mesh is turned: Revolution takes its profile")
            draw_lines(self.layout, context, text, "INFO")
        GlassProperties.draw(self, context)

    def _problem_of(self, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> str | None:
        """What keeps the object from being a glass of the shape; takes size and ior where not."""
        evaluated = obj.evaluated_get(depsgraph)
        if self.shape == "SLAB" and not _is_flat(obj):
            return _rpt(
                '"{}" is not flat: a slab takes a flat mesh with a face as its outline'
            ).format(obj.name)
        if self.shape == "MESH":
            try:
                triangles_of(evaluated.data)
            except ValueError as error:
                return f'"{obj.name}": {error}'
            if not self.properties.is_property_set("ior"):
                self.ior = interface_of(obj, depsgraph, self.ior).ior
        self._take_size(obj)
        self.take_media()
        problem = self.problem()
        return None if problem is None else f'"{obj.name}": {problem}'

    def _take_size(self, obj: bpy.types.Object) -> None:
        """Give what was not asked for the size of the object's mesh."""
        size = _extent(obj)
        largest = float(size.max())
        radius = largest if self.shape == "SPHERE" else float(size[:2].max())
        for name, value in (
            ("radius", radius / 2),
            ("height", float(size[2])),
            ("wall_thickness", min(self.wall_thickness, largest / 20)),
            ("bottom_thickness", min(self.bottom_thickness, float(size[2]) / 10)),
        ):
            # Flat to rounding in that direction: no size to take.
            if value > FLATNESS * largest and not self.properties.is_property_set(name):
                setattr(self, name, value)


class OBJECT_OT_refractive_glass_turn_normals(bpy.types.Operator):
    """Make the active glass's faces look outwards, so that what is behind them is glass"""

    bl_idname = "object.refractive_glass_turn_normals"
    bl_label = "Turn Normals Outwards"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        if obj is None or obj.type != "MESH" or glass_modifier(obj) is None:
            cls.poll_message_set(_rpt("Select a glass that is a mesh"))
            return False
        return can_edit(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.object
        mesh = obj.data
        if not (obj.is_editable and mesh.is_editable):
            said = _rpt('The mesh of "{}" is linked from a library: make it local first')
            self.report({"ERROR"}, said.format(obj.name))
            return {"CANCELLED"}
        turned = turn_outwards(mesh)
        found = self._found(context, obj)
        if found.bodies:
            # A modifier makes faces of its own, such as Screw of a profile, and they look in.
            screws = [m for m in obj.modifiers if m.type == "SCREW" and m.show_render]
            if screws:
                screws[-1].use_normal_flip = not screws[-1].use_normal_flip
            else:
                turn_all(mesh)
            turned = max(turned, 1)
            found = self._found(context, obj)
        if not found.is_right:
            said = _rpt('Modifiers of "{}" turn faces against each other: correct them there')
            self.report({"WARNING"}, said.format(obj.name))
        else:
            said = _rpt('All faces of "{}" look outwards: {} turned')
            self.report({"INFO"}, said.format(obj.name, turned))
        return {"FINISHED"}

    @staticmethod
    def _found(context: bpy.types.Context, obj: bpy.types.Object):
        """What is wrong with the mesh that the glass's modifier gets."""
        modifier = glass_modifier(obj)
        shown = modifier.show_viewport
        modifier.show_viewport = False
        context.view_layer.update()
        found = orientation_of(obj.evaluated_get(context.evaluated_depsgraph_get()).data)
        modifier.show_viewport = shown
        context.view_layer.update()
        return found


def can_edit(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether objects can be added and changed now; tells the reason where not."""
    if context.mode != "OBJECT":
        operator.poll_message_set(_rpt("Go to Object Mode first"))
        return False
    if own(context.scene):
        operator.poll_message_set(_rpt("This scene is made by the extension: choose your own"))
        return False
    if context.scene.library is not None:
        operator.poll_message_set(_rpt("The scene is linked from a library: make it local first"))
        return False
    return True


def _vertices(obj: bpy.types.Object) -> np.ndarray:
    """The mesh's own vertices (N, 3), in the object's frame."""
    return positions(obj.data).reshape(-1, 3)


def _extent(obj: bpy.types.Object) -> np.ndarray:
    """Size (3,) of the mesh along its axes; zeros without vertices or with impossible ones."""
    points = _vertices(obj)
    if not len(points) or not np.isfinite(points).all():
        return np.zeros(3)
    return np.ptp(points, axis=0)


def _is_flat(obj: bpy.types.Object) -> bool:
    """Whether the mesh has a face and all of it lies in one plane."""
    points = _vertices(obj)
    if not len(obj.data.polygons) or not np.isfinite(points).all():
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 0 and spread[2] <= FLATNESS * spread[0])


class SCENE_OT_refractive_glass_update(Stepwise, bpy.types.Operator):
    """Bring what is seen through the scene's glasses up to date"""

    bl_idname = "scene.refractive_glass_update"
    bl_label = "Update Refractive Glass"

    def _steps(self, context: bpy.types.Context) -> Steps:
        yield Step(0.0, "preparing")
        door.prepare(context.scene, context.evaluated_depsgraph_get(), strict=True)
        depsgraph = context.evaluated_depsgraph_get()
        with closing(Apart()) as apart:
            return (yield from door.updating(context.scene, depsgraph, apart))

    def _end(self, found: door.Status) -> set[str]:
        for problem in found.problems:
            self.report({"WARNING"}, problem)
        said = _rpt("Ready: a render computes what is seen through the glass")
        if found.paths:
            said = _rpt("{:,} vertices moved to where they appear, in {:.1f} s")
            said = said.format(found.vertices, 1e-3 * found.milliseconds)
        self.report({"INFO"}, said)
        return {"FINISHED"}


CLASSES = (
    OBJECT_OT_refractive_glass_add,
    OBJECT_OT_refractive_glass_modifier_add,
    OBJECT_OT_refractive_glass_turn_normals,
    SCENE_OT_refractive_glass_update,
)


register, unregister = staying.classes(CLASSES)
