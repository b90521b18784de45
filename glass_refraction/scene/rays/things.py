# SPDX-License-Identifier: GPL-3.0-or-later
"""All that rays can meet beside the glasses: the scene's evaluated surfaces and its lamps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...optics.vectors import rotated
from ..names import own
from ..read.arrays import corner_normals, mesh_triangles, positions, triangle_slots, uv_map
from ..read.cutouts import Masks, cutout_of, faces_of, is_invisible
from ..read.glasses import is_mesh_glass
from ..read.glassy_materials import opaque_bits, opaque_materials
from ..read.light_linking import is_mirrored
from ..read.modifier_inputs import glass_modifier
from ..read.strands import MOST_TRIANGLES, balls, fur, strands
from .columns import Columns
from .lamps import lamp_shape
from .looks import (
    Look,
    LookOf,
    card_look,
    hole_look,
    look_among,
    look_of,
    marked_look,
    softbox_look,
)


@dataclass(frozen=True, eq=False)
class Triangles:
    """One soup of triangles.

    Attributes
    ----------
    points : (V, 3) float64, world, metres.
    triangles : (T, 3) int32, vertices of each triangle.
    """

    points: np.ndarray
    triangles: np.ndarray

    def same(self, other: Triangles | None) -> bool:
        """Whether the other has the same triangles in the same places."""
        return (
            other is not None
            and np.array_equal(self.triangles, other.triangles)
            and np.array_equal(self.points, other.points)
        )


@dataclass(frozen=True, eq=False)
class Met(Columns):
    """What rays meet.

    Attributes
    ----------
    triangle : (K,) its number. distance : (K,) metres to it.
    origin, direction : (K, 3) of the rays, world.
    """

    triangle: np.ndarray
    distance: np.ndarray
    origin: np.ndarray
    direction: np.ndarray


UNMET = frozenset(("VOLUME", "GREASEPENCIL"))
"""Types of what is drawn without faces and not met."""
FLAT = 1e-3
"""Difference between the normals of a face's corners up to which it is flat."""
Drawn = bpy.types.Mesh | bpy.types.Curves | bpy.types.PointCloud | bpy.types.ParticleSystem
"""What is met."""


@dataclass(frozen=True, eq=False)
class Things(Triangles):
    """All that rays can meet beside the glasses, as one soup.

    Attributes
    ----------
    surface : (T,) int32, number of the look of each triangle.
    looks : what is known of each surface without rendering it.
    owners : of each look, the name of the object that shows it: of an instance, its instancer.
    unmet : names of the objects that show what no ray meets, see `UNMET`.
    uv_row : (T,) int32, row in ``uv`` of the triangles whose look has a cutout; −1: of others.
    uv : (U, 3, 2) float32, where their corners lie on the cutout's UV map. None: no look has one.
    """

    surface: np.ndarray
    looks: tuple[Look, ...]
    owners: tuple[str, ...]
    unmet: tuple[str, ...] = ()
    uv_row: np.ndarray | None = None
    uv: np.ndarray | None = None

    def surfaces(self, triangle: np.ndarray) -> np.ndarray:
        """(K,) numbers of the looks of triangles (K,); −1 for −1, where none is met."""
        return np.append(self.surface, -1).astype(np.int32).take(triangle)

    def mapped(self, met: Met) -> np.ndarray:
        """(K, 2) where rays meet triangles with a cutout, on its UV map."""
        return np.einsum("nk,nkd->nd", self.shares(met), self.uv[self.uv_row[met.triangle]])

    def shares(self, met: Met) -> np.ndarray:
        """(K, 3) shares of their triangles' corners in where rays meet them."""
        a, b, c = (self.points[self.triangles[met.triangle, k]] for k in range(3))
        place = met.origin + met.distance[:, None] * met.direction - a
        b, c = b - a, c - a
        normal = np.cross(b, c)
        area = np.einsum("nk,nk->n", normal, normal)
        area = np.where(area > 0.0, area, 1.0)
        second = np.einsum("nk,nk->n", np.cross(place, c), normal) / area
        third = np.einsum("nk,nk->n", np.cross(b, place), normal) / area
        return np.stack((1.0 - second - third, second, third), axis=1)

    def box(self) -> np.ndarray:
        """(2, 3): the lowest and the highest coordinates; of nothing, an empty box."""
        if not len(self.points):
            return np.array([(np.inf,) * 3, (-np.inf,) * 3])
        return np.array((self.points.min(axis=0), self.points.max(axis=0)))


def read_things(
    depsgraph: bpy.types.Depsgraph,
    left_out: frozenset[str],
    mirrors: frozenset[str],
    engine: str,
    masks: Masks,
) -> Things:
    """The evaluated surfaces that a camera sees, instances realised, and the lamps of a size.

    What is hidden from cameras and emits one colour is such a lamp: a softbox. In Cycles light
    through glass meets all that is hidden from cameras alone.

    Parameters
    ----------
    left_out : names of the glasses, of other scenes too: rays meet their opaque faces alone here.
    mirrors : names of the glasses, whose light linking counts for lamps and softboxes.
    engine : of the render; Workbench is lit by no lamps and cuts nothing out.
    masks : what was read of images in this render.
    """
    culls = depsgraph.scene_eval.display.shading.show_backface_culling
    builder = _Builder(engine, depsgraph.mode, masks, int(culls and engine == "BLENDER_WORKBENCH"))
    # Other engines have no rays that a material could tell apart.
    is_overridden = depsgraph.view_layer.material_override is not None
    told_apart = engine == "CYCLES" and not is_overridden
    for instance in depsgraph.object_instances:
        obj = instance.object
        original = obj.original
        owner = instance.parent.original if instance.is_instance else original
        if own(original) or (owner.name in left_out and owner != original):
            continue
        opaque = None
        if original.name in left_out:
            bits = opaque_bits(glass_modifier(obj)) if is_mesh_glass(obj) else 0
            opaque = opaque_materials(obj, bits)
            if not opaque:
                continue
        drawn = [obj.data] if instance.show_self and isinstance(obj.data, Drawn) else []
        drawn += _furs(obj) if instance.show_particles else []
        if obj.type == "LIGHT":
            if engine != "BLENDER_WORKBENCH" and is_mirrored(obj, mirrors):
                builder.add_lamp(obj, np.array(instance.matrix_world, float), engine)
            continue
        is_transmitted = obj.visible_transmission and owner.visible_transmission
        look = hole_look if owner.holdout_get(view_layer=depsgraph.view_layer) else look_of
        is_indirect = engine == "CYCLES" and owner.indirect_only_get(
            view_layer=depsgraph.view_layer
        )
        if is_indirect or not (obj.visible_camera and owner.visible_camera):
            if engine == "BLENDER_WORKBENCH" or not (
                obj.visible_glossy and is_mirrored(owner, mirrors)
            ):
                continue
            is_shown = told_apart and is_transmitted
            look = card_look if is_shown else softbox_look
        if engine == "CYCLES" and not is_transmitted:
            look = marked_look(look, is_passed=True)
        if not told_apart:
            # Nor do their pictures mirror as the material tells.
            look = marked_look(look, is_of_cameras=False, is_of_paths=False, polish=None)
        if engine == "BLENDER_WORKBENCH" or is_overridden:
            look = marked_look(look, is_plain=False)
        if owner.type == "META":
            # Captures have the user's scene as their set, and Blender leaves a set's metaballs out.
            look = marked_look(look, is_uncaptured=True)
        if opaque is not None:
            look = look_among(look, opaque)
        if obj.type in UNMET and instance.show_self:
            builder.unmet[owner.name] = None
        for part in drawn:
            builder.add_drawn(obj, owner, part, np.array(instance.matrix_world, float), look)
    return builder.things()


def _furs(obj: bpy.types.Object) -> list[bpy.types.ParticleSystem]:
    """Particles of an object that are drawn as strands."""
    shown = (m for m in obj.modifiers if m.type == "PARTICLE_SYSTEM" and m.show_render)
    kinds = ((m.particle_system, m.particle_system.settings) for m in shown)
    return [one for one, kind in kinds if (kind.type, kind.render_type) == ("HAIR", "PATH")]


class _Builder:
    def __init__(self, engine: str, mode: str, masks: Masks, faces: int) -> None:
        self._engine, self._mode, self._masks, self._faces = engine, mode, masks, faces
        self.unmet: dict[str, None] = {}
        self.points: list[np.ndarray] = [np.empty((0, 3))]
        self.triangles: list[np.ndarray] = [np.empty((0, 3), np.int32)]
        self.surface: list[np.ndarray] = [np.empty(0, np.int32)]
        self.looks: list[Look] = []
        self.owners: list[str] = []
        self.uv_row: list[np.ndarray] = [np.empty(0, np.int32)]
        self.uv: list[np.ndarray] = []
        self._mapped = 0
        self._meshes: dict[int, tuple] = {}
        self._numbers: dict[tuple, int] = {}
        self._count = self._round = 0

    def add_drawn(
        self,
        obj: bpy.types.Object,
        owner: bpy.types.Object,
        drawn: Drawn,
        to_world: np.ndarray,
        look: LookOf,
    ) -> None:
        """The triangles of what is drawn that have a look; instances share what was read."""
        key = drawn.as_pointer()
        if key not in self._meshes:
            is_fur = isinstance(drawn, bpy.types.ParticleSystem)
            self._meshes[key] = _checked(fur(obj, drawn, self._mode) if is_fur else _read(drawn))
        found = self._meshes[key]
        if found is None:
            self.unmet[owner.name] = None
            return
        local, corners, slots, loops = found
        if not len(corners):
            return
        if np.linalg.det(to_world[:3, :3]) < 0.0:
            # A mirrored mesh looks outwards as it did.
            corners, loops = corners[:, ::-1], loops[:, ::-1]
        if not isinstance(drawn, bpy.types.Mesh):
            self._round += len(corners)
            if self._round > MOST_TRIANGLES:
                self.unmet[owner.name] = None
                return
        surface = self._look_numbers(obj, owner, type(drawn), int(slots.max()), look)[slots]
        if (surface < 0).any():
            met = surface >= 0
            corners, loops, surface = corners[met], loops[met], surface[met]
        if isinstance(drawn, bpy.types.Mesh):
            surface = self._curved(drawn, loops, surface)
        if len(corners):
            points = rotated(to_world[:3, :3], local.T).T + to_world[:3, 3]
            self._add(points, corners, surface, self._uv_rows(obj.data, loops, surface))

    def _curved(self, mesh: bpy.types.Mesh, loops, surface) -> np.ndarray:
        """Surfaces' numbers in which those of curved faces are others: what these mirror is not
        told by their triangles."""
        for number in np.unique(surface):
            if self.looks[number].polish is None:
                continue
            here = np.flatnonzero(surface == number)
            normals = corner_normals(mesh)[loops[here]]
            curved = (np.ptp(normals, axis=1) > FLAT).any(axis=1)
            if not curved.any():
                continue
            key = ("curved", number)
            if key not in self._numbers:
                self._numbers[key] = len(self.looks)
                self.looks.append(replace(self.looks[number], polish=None))
                self.owners.append(self.owners[number])
            surface[here[curved]] = self._numbers[key]
        return surface

    def _uv_rows(self, mesh: bpy.types.Mesh, loops, surface) -> np.ndarray:
        """Of triangles, by their face corners, the rows in ``uv``; −1 where nothing is cut out."""
        rows = np.full(len(surface), -1, np.int32)
        for number in np.unique(surface):
            cutout = self.looks[number].cutout
            if cutout is None:
                continue
            here = np.flatnonzero(surface == number)
            rows[here] = self._mapped + np.arange(len(here), dtype=np.int32)
            self._mapped += len(here)
            self.uv.append(uv_map(mesh, cutout.uv_map)[loops[here]])
        return rows

    def add_lamp(self, obj: bpy.types.Object, to_world: np.ndarray, engine: str) -> None:
        """A lamp that has a size, as the surface that gives its light."""
        shape = lamp_shape(obj.data, to_world, engine)
        if shape is None:
            return
        points, corners, look = shape
        self.looks.append(replace(look, is_hidden=not obj.visible_camera))
        self.owners.append(obj.original.name)
        number = len(self.looks) - 1
        surface, rows = np.full((2, len(corners)), ((number,), (-1,)), np.int32)
        self._add(points, corners, surface, rows)

    def _look_numbers(self, obj, owner, kind: type, highest: int, look_of) -> np.ndarray:
        """The number of the look of each material slot up to the highest in use; −1: of none."""
        numbers = []
        for slot in range(highest + 1):
            if slot < len(obj.material_slots):
                material = obj.material_slots[slot].material
            else:
                materials = obj.data.materials
                material = materials[slot] if slot < len(materials) else None
            key = (kind, owner.name, obj.original.name, material.name if material else "")
            if key not in self._numbers:
                look = self._cut(look_of(material), material, kind is bpy.types.Mesh)
                self._numbers[key] = -1 if look is None else len(self.looks)
                if look is not None:
                    self.looks.append(look)
                    self.owners.append(owner.name)
            numbers.append(self._numbers[key])
        return np.array(numbers, np.int32)

    def _cut(
        self, look: Look | None, material: bpy.types.Material | None, is_mapped: bool
    ) -> Look | None:
        """The look with what its material cuts out; None where nothing is left."""
        if look is None:
            return None
        if self._engine == "BLENDER_WORKBENCH":
            return replace(look, faces=self._faces)
        if is_invisible(material):
            return None
        cutout = cutout_of(material, self._masks) if is_mapped else None
        return replace(look, cutout=cutout, faces=faces_of(material, self._engine))

    def _add(self, points, corners, surface, uv_rows) -> None:
        self.uv_row.append(uv_rows)
        self.points.append(points)
        self.triangles.append(corners + self._count)
        self.surface.append(surface)
        self._count += len(points)

    def things(self) -> Things:
        return Things(
            np.concatenate(self.points),
            np.concatenate(self.triangles).astype(np.int32),
            np.concatenate(self.surface).astype(np.int32),
            tuple(self.looks),
            tuple(self.owners),
            tuple(self.unmet),
            np.concatenate(self.uv_row) if self.uv else None,
            np.concatenate(self.uv) if self.uv else None,
        )


def _read(mesh: Drawn) -> tuple[np.ndarray, ...]:
    """Points (V, 3) and triangles (T, 3) of a mesh, slots (T,) and, if it has any, face corners."""
    if isinstance(mesh, bpy.types.Curves):
        return strands(mesh)
    if isinstance(mesh, bpy.types.PointCloud):
        return balls(mesh)
    points, corners = positions(mesh).astype(float), mesh_triangles(mesh)
    return points, corners, triangle_slots(mesh), mesh_triangles(mesh, "loops")


def _checked(shape: tuple[np.ndarray, ...] | None) -> tuple[np.ndarray, ...] | None:
    """The same without triangles that lie nowhere; what has no face corners gets its points'."""
    if shape is None:
        return None
    local, corners, slots = shape[:3]
    loops = shape[-1] if len(shape) > 3 else corners
    finite = np.isfinite(local).all(axis=1)
    if not finite.all():
        keep = finite[corners].all(axis=1)
        corners, slots, loops = corners[keep], slots[keep], loops[keep]
        local = np.where(finite[:, None], local, 0.0)
    return local, corners, np.maximum(slots, 0), loops
