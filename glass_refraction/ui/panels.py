# SPDX-License-Identifier: GPL-3.0-or-later
"""A glass's panel in its object and modifier properties, the scene's in the render properties.

Both are in the 3D view's sidebar too, tab *Glass*.
"""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as _iface

from ..scene import changes
from ..scene import update as door
from ..scene.names import own
from ..scene.read.glassy_materials import (
    glassy_materials,
    interface_node,
    opaque_bits,
    opaque_materials,
)
from ..scene.read.mesh_corners import is_hidden
from ..scene.read.mesh_glasses import open_edges
from ..scene.read.modifier_inputs import glass_modifier, has_input, read_input, value_place
from ..scene.read.orientation import Orientation, orientation_of
from . import bake, staying
from .compare import SCENE_OT_refractive_glass_compare
from .lines import draw_lines
from .menus import VIEW3D_MT_refractive_glass_add
from .operators import (
    SIZES,
    OBJECT_OT_refractive_glass_modifier_add,
    OBJECT_OT_refractive_glass_turn_normals,
    SCENE_OT_refractive_glass_update,
)

_SIZES = {
    shape.title(): tuple(name.replace("_", " ").title() for name in names)
    for shape, names in SIZES.items()
} | {"Revolution": ("Profile",)}
"""Shape -> the inputs that say how large it is."""
_CONTENTS = {
    "Slab": "Behind",
    "Cylinder": "Contents",
    "Sphere": "Contents",
    "Tumbler": "Liquid",
    "Revolution": "Liquid",
}
_LEVEL = "Liquid Level"
_SHORT = {
    "Wall Thickness": "Wall",
    "Bottom Thickness": "Bottom",
    _LEVEL: "Level",
    "Contents IOR": "IOR",
    "Contents Abbe Number": "Abbe Number",
    "Absorption Color": "Color",
    "Absorption Distance": "at a Depth of",
    "Contents Absorption Color": "Contents",
    "Contents Absorption Distance": "at a Depth of",
}
"""Labels where the input's name is cut off at the sidebar's usual width, or its part says it."""
_OF_GLASS = ("Abbe Number", "Priority")
_COLOUR = ("Absorption Color", "Absorption Distance")
_DISPLAY = ("Seen Through", "Casts Shadow", "Segments", "Material")
_ARRANGED = {
    *(name for names in _SIZES.values() for name in names),
    *("Shape", "IOR", "Contents IOR", _LEVEL, "Contents Abbe Number"),
    *(f"{medium}{name}" for medium in ("", "Contents ") for name in _COLOUR),
    *_OF_GLASS,
    *_DISPLAY,
}
_LISTS = {
    "NodeSocketObject": "objects",
    "NodeSocketCollection": "collections",
    "NodeSocketMaterial": "materials",
}


def draw_input(
    layout: bpy.types.UILayout,
    modifier: bpy.types.NodesModifier,
    name: str,
) -> None:
    """Draw an input of the glass's modifier, to be keyframed and driven as any property.

    An older file's glass may lack it: nothing is drawn then.
    """
    if not has_input(modifier, name):
        return
    owner, place = value_place(modifier, name)
    items = modifier.node_group.interface.items_tree
    kind = next(i.socket_type for i in items if i.name == name and i.item_type == "SOCKET")
    text = _iface(_SHORT.get(name, name))
    if kind in _LISTS:
        layout.prop_search(owner, place, bpy.data, _LISTS[kind], text=text, translate=False)
    else:
        layout.prop(owner, place, text=text, translate=False)


def _more_inputs(modifier: bpy.types.NodesModifier) -> list[str]:
    """The inputs that have no place of their own in the panel."""
    return [
        item.name
        for item in modifier.node_group.interface.items_tree
        if item.item_type == "SOCKET"
        and item.in_out == "INPUT"
        and item.socket_type != "NodeSocketGeometry"
        and not item.hide_in_modifier
        and item.name not in _ARRANGED
    ]


def describe_path(events: str) -> str:
    """A light path in words."""
    through, mirrored = events.count("T"), events.count("R")
    words = []
    if through:
        words.append(_iface("refracted {} times").format(through))
    if mirrored:
        words.append(_iface("mirrored {} times").format(mirrored))
    return f"{events}: {', '.join(words)}"


class _Glass:
    """Draws the active object's glass."""

    bl_label = "Refractive Glass"

    @classmethod
    def suits(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        return obj is not None and obj.type == "MESH" and glass_modifier(obj) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        obj = context.object
        modifier = glass_modifier(obj)
        shape = read_input(modifier, "Shape")
        _draw_problems(layout, context, obj, modifier)
        draw_input(layout.column(), modifier, "Shape")
        column = layout.column(align=True)
        for name in _SIZES[shape]:
            draw_input(column, modifier, name)
        if shape == "Slab":
            draw_lines(layout, context, _iface("The object's flat mesh is the outline"), "INFO")
        if shape == "Mesh":
            _draw_mesh(layout, context, obj.evaluated_get(context.evaluated_depsgraph_get()))
        else:
            text = _iface("Exact shape: its surfaces are perfectly smooth")
            draw_lines(layout, context, text, "INFO")
        body = _section(layout, "Glass")
        if body is not None:
            if shape == "Mesh":
                _draw_material(body, context, obj)
            column = body.column(align=True)
            column.prop(obj, "refractive_glass_medium")
            for name in ("IOR", *_OF_GLASS):
                draw_input(column, modifier, name)
        if shape in _CONTENTS:
            body = _section(layout, _CONTENTS[shape])
            if body is not None:
                _draw_contents(body, obj, modifier, shape)
        body = _section(layout, "Color", closed=True)
        if body is not None:
            for medium in ("", "Contents ") if shape in _CONTENTS else ("",):
                column = body.column(align=True)
                for name in _COLOUR:
                    draw_input(column, modifier, f"{medium}{name}")
        body = _section(layout, "Display", closed=True)
        if body is not None:
            column = body.column(align=True)
            for name in (*_DISPLAY, *_more_inputs(modifier)):
                draw_input(column, modifier, name)


def _section(
    layout: bpy.types.UILayout, name: str, *, closed: bool = False
) -> bpy.types.UILayout | None:
    """A part of a panel with a header to fold it by; None while it is folded."""
    header, body = layout.panel(f"refractive_glass_{name.lower()}", default_closed=closed)
    header.label(text=name)
    return body


def _draw_problems(layout: bpy.types.UILayout, context: bpy.types.Context, obj, modifier) -> None:
    """What keeps the glass from being shown, before all that can be set."""
    for problem in door.status(context.scene).problems:
        if f'"{obj.name}"' in problem:
            draw_lines(layout, context, problem, "ERROR")
    if not modifier.show_render:
        text = _iface("The modifier is off in renders: switch it on to see through the glass")
        draw_lines(layout, context, text, "ERROR")


def _draw_contents(layout: bpy.types.UILayout, obj, modifier, shape: str) -> None:
    """What is in a glass or behind a pane; an empty glass holds air, whatever it may hold."""
    empty = False
    if _CONTENTS[shape] == "Liquid":
        draw_input(layout.column(), modifier, _LEVEL)
        empty = read_input(modifier, _LEVEL) <= 0.0
    if empty:
        layout.label(text="Empty: it holds air", icon="INFO")
    column = layout.column(align=True)
    column.active = not empty
    column.prop(obj, "refractive_glass_contents", text=_CONTENTS[shape])
    draw_input(column, modifier, "Contents IOR")
    draw_input(column, modifier, "Contents Abbe Number")


def _draw_mesh(
    layout: bpy.types.UILayout, context: bpy.types.Context, evaluated: bpy.types.Object
) -> None:
    """Say that the mesh is the glass, and what of it is not closed."""
    draw_lines(layout, context, _iface("The object's own mesh is the glass"), "INFO")
    mesh = evaluated.data
    # While a 3D view draws what is seen through it, the glass's modifier leaves no face of glass.
    hidden = is_hidden(mesh)
    if hidden and len(evaluated.modifiers) == 1:
        hidden, mesh = False, evaluated.original.data
    if hidden:
        text = _iface("Switch Refracted Picture off to see here whether the mesh is a whole glass")
        draw_lines(layout, context, text, "INFO")
        return
    key = evaluated.session_uid
    state = (changes.shape_generation(evaluated), len(mesh.vertices), len(mesh.loops))
    if key not in _looked_at or _looked_at[key][0] != state:
        _looked_at[key] = state, open_edges(mesh), orientation_of(mesh)
    _, (border, branched), orientation = _looked_at[key]
    if border:
        said = _iface("Open: {} edges have one face. A face's front is outside, as in Cycles")
        draw_lines(layout, context, said.format(border), "ERROR")
    if branched:
        said = _iface("{} edges have more than two faces: what is inside is not clear there")
        draw_lines(layout, context, said.format(branched), "ERROR")
    if orientation.edges:
        said = _iface("Normals disagree along {} edges: a face's front must be outside")
        draw_lines(layout, context, said.format(orientation.edges), "ERROR")
    if orientation.bodies:
        text = _iface("Inside out: its normals look inwards, where the glass is")
        draw_lines(layout, context, text, "ERROR")
    if not orientation.is_right:
        layout.operator(OBJECT_OT_refractive_glass_turn_normals.bl_idname)


_looked_at: dict[int, tuple[tuple[int, int, int], tuple[int, int], Orientation]] = {}
"""Object's session uid -> state of its mesh, its open edges, its normals: looked at once, not at
each draw."""


def _draw_material(
    layout: bpy.types.UILayout, context: bpy.types.Context, obj: bpy.types.Object
) -> None:
    """Say which of the mesh's materials is the glass, and draw what it has beside the ior."""
    materials = glassy_materials(obj)
    if not materials:
        return
    first = materials[0]
    said = _iface('Material "{}" is the glass: its IOR and this one follow each other')
    if len(materials) > 1:
        said = _iface('The first of its glassy materials counts for all of it: "{}"')
    draw_lines(layout, context, said.format(first.name), "MATERIAL")
    opaque = opaque_materials(obj, opaque_bits(glass_modifier(obj)))
    names = sorted(material.name for material in opaque if material is not None)
    if names:
        said = _iface('Faces of "{}" are no glass')
        draw_lines(layout, context, said.format('", "'.join(names)), "MATERIAL")
    node = interface_node(first)
    column = layout.column(align=True)
    column.enabled = first.is_editable
    for name in ("Base Color", "Color", "Roughness"):
        socket = node.inputs.get(name)
        if socket is not None:
            column.prop(socket, "default_value", text=_iface(name), translate=False)


_OF_SHADING = {"TRUE": "captures", "DISPLACED": "tolerance_px"}
"""The setting that a shading alone has."""
_SHADOW_OF = {"TRUE": ("shadow",), "DISPLACED": ()}
_OF_LIGHT = ("light_rays", "light_softness")
"""Settings of *Light* as Shadow."""


class _Scene:
    """Draws the scene's settings."""

    bl_label = "Refractive Glass"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def suits(cls, context: bpy.types.Context) -> bool:
        return not own(context.scene)

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.refractive_glass, "enabled", text="")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.refractive_glass
        column = layout.column()
        column.active = settings.enabled
        for name in ("shading", "surface", *_SHADOW_OF[settings.shading], "quality"):
            column.prop(settings, name)
        body = _section(layout, "Advanced", closed=True)
        if body is not None:
            column = body.column()
            column.active = settings.enabled
            lit = settings.shading == "TRUE" and settings.shadow == "LIGHT"
            for name in (_OF_SHADING[settings.shading], "min_weight", *(_OF_LIGHT if lit else ())):
                column.prop(settings, name)
        for problem in door.status(context.scene).problems:
            draw_lines(layout, context, problem, "ERROR")
        row = layout.row(align=True)
        if settings.shading == "DISPLACED":
            # In the other shading renders compute all there is.
            row.operator(SCENE_OT_refractive_glass_update.bl_idname, text="Update")
        row.operator(SCENE_OT_refractive_glass_compare.bl_idname, text="Compare")


class _Status:
    """Draws what the last update did."""

    bl_label = "Status"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        found = door.status(context.scene)
        for problem in door.memory_of(context.scene).last:
            if problem not in found.problems:
                text = _iface("Last picture: {}").format(problem)
                draw_lines(layout, context, text, "ERROR")
        if found.covered:
            self._draw_rays(layout, found)
        elif found.paths:
            self._draw_copies(layout, found)
        else:
            text = _iface("Nothing computed yet: render a picture")
            draw_lines(layout.column(), context, text, "INFO")

    def _draw_rays(self, layout: bpy.types.UILayout, found: door.Status) -> None:
        """What the last picture of True shading took, and what it lacks."""
        _draw_rows(
            layout,
            ("Glass Covers", _iface("{:,} pixels").format(found.covered)),
            ("Computed in", f"{1e-3 * found.milliseconds:.1f} s"),
            ("Light Not Seen", f"{found.unseen:.1%}"),
        )
        body = _section(layout, "Details", closed=True)
        if body is None:
            return
        column = body.column(align=True)
        column.label(text="Light Comes from")
        for view in found.views:
            text = _iface("{}: {:.0%} of the light, {} samples")
            text = text.format(view.name, view.share, view.samples)
            column.label(text=text, icon="BLANK1", translate=False)

    def _draw_copies(self, layout: bpy.types.UILayout, found: door.Status) -> None:
        """What the last update of displaced copies made."""
        _draw_rows(layout, ("Computed in", f"{1e-3 * found.milliseconds:.1f} s"))
        body = _section(layout, "Details", closed=True)
        if body is None:
            return
        _draw_rows(
            body,
            ("Vertices", f"{found.vertices:,}"),
            ("Error Bound", f"{found.bound_px:.2f} px"),
        )
        column = body.column(align=True)
        column.label(text="Light Paths in Use")
        for events in found.paths:
            column.label(text=describe_path(events), icon="BLANK1", translate=False)


def _draw_rows(layout: bpy.types.UILayout, *rows: tuple[str, str]) -> None:
    """Lines of a name and a value."""
    column = layout.column(align=True)
    for label, value in rows:
        row = column.split(factor=0.4)
        row.label(text=label)
        row.label(text=value, translate=False)


class _Bake:
    """Draws the bake."""

    bl_label = "Bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        bake.draw(self.layout, context)


class _Properties(staying.StayingPanel):
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"


class _Sidebar(staying.StayingPanel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Glass"


class OBJECT_PT_refractive_glass(_Glass, _Properties, bpy.types.Panel):
    """In the object properties"""

    bl_context = "object"


class MODIFIER_PT_refractive_glass(_Glass, _Properties, bpy.types.Panel):
    """In the modifier properties"""

    bl_options = {"DEFAULT_CLOSED"}
    bl_context = "modifier"


class VIEW3D_PT_refractive_glass_object(_Glass, _Sidebar, bpy.types.Panel):
    """In the 3D view's sidebar; where the active object is no glass, the ways to one"""

    bl_label = "Glass"

    @classmethod
    def suits(cls, context: bpy.types.Context) -> bool:
        return not own(context.scene)

    def draw(self, context: bpy.types.Context) -> None:
        if _Glass.suits(context):
            _Glass.draw(self, context)
            return
        layout = self.layout
        layout.menu(VIEW3D_MT_refractive_glass_add.bl_idname, text="Add Glass", icon="ADD")
        layout.operator(
            OBJECT_OT_refractive_glass_modifier_add.bl_idname, text="Make Active a Glass"
        )


class RENDER_PT_refractive_glass(_Scene, _Properties, bpy.types.Panel):
    """In the render properties"""

    bl_context = "render"


class RENDER_PT_refractive_glass_status(_Status, _Properties, bpy.types.Panel):
    """In the render properties"""

    bl_parent_id = RENDER_PT_refractive_glass.__name__
    bl_context = "render"


class RENDER_PT_refractive_glass_bake(_Bake, _Properties, bpy.types.Panel):
    """In the render properties"""

    bl_parent_id = RENDER_PT_refractive_glass.__name__
    bl_context = "render"


class VIEW3D_PT_refractive_glass(_Scene, _Sidebar, bpy.types.Panel):
    """In the 3D view's sidebar"""

    bl_label = "Scene"
    bl_options = set()


class VIEW3D_PT_refractive_glass_status(_Status, _Sidebar, bpy.types.Panel):
    """In the 3D view's sidebar"""

    bl_parent_id = VIEW3D_PT_refractive_glass.__name__


class VIEW3D_PT_refractive_glass_bake(_Bake, _Sidebar, bpy.types.Panel):
    """In the 3D view's sidebar"""

    bl_parent_id = VIEW3D_PT_refractive_glass.__name__


CLASSES = (
    OBJECT_PT_refractive_glass,
    MODIFIER_PT_refractive_glass,
    RENDER_PT_refractive_glass,
    RENDER_PT_refractive_glass_status,
    RENDER_PT_refractive_glass_bake,
    VIEW3D_PT_refractive_glass_object,
    VIEW3D_PT_refractive_glass,
    VIEW3D_PT_refractive_glass_status,
    VIEW3D_PT_refractive_glass_bake,
)


# Parts of panels go before the panels.
register, unregister = staying.classes(CLASSES)
