# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint of glasses that are meshes: colours and roughness that differ from place to place."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import bpy
import numpy as np

from .glassy_materials import Interface, glassy_materials, interface_node, material_interface
from .material_fields import Fields, NotReady, frame_of, maps_of, painted
from .material_recipe import paint_of
from .mesh_corners import Corners

FINISH = 7
"""Numbers of what a surface is like in a place: roughness, and the parts of the light, red, green,
blue, that get through where it is refracted, and where it is reflected."""


@dataclass(frozen=True, eq=False)
class Paint:
    """What the surface of a mesh is like in each place.

    Attributes
    ----------
    sources : of each material what is the same everywhere, (`FINISH`,), or how it is evaluated.
    kind : (T,) number of each triangle's material among these.
    rows : (T, 3, 6 + 2 · maps) of the corners place and normal in the object's own frame, and UV
        maps.
    roughness : at least that of its roughest place; 0 if it is smooth everywhere.
    stamp : equal ones, equal paint on equal triangles.
    """

    sources: tuple[np.ndarray | Fields, ...]
    kind: np.ndarray
    rows: np.ndarray
    roughness: float
    stamp: bytes

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Paint) and self.stamp == other.stamp

    __hash__ = None

    @property
    def is_ready(self) -> bool:
        """Whether all of it can be evaluated."""
        return all(s.is_ready for s in self.sources if isinstance(s, Fields))

    def of_some(self, which: np.ndarray) -> Paint:
        """On some of the triangles."""
        return replace(self, kind=self.kind[which], rows=self.rows[which])

    def in_parts(self, source: tuple[np.ndarray, np.ndarray]) -> Paint:
        """On parts of the triangles, see `Corners`."""
        triangle, shares = source
        return replace(self, kind=self.kind[triangle], rows=shares @ self.rows[triangle])

    def at(self, triangle: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """(N, `FINISH`) in places on triangles (N,), by the shares (N, 3) of their corners.

        Raises
        ------
        NotReady
        """
        return self.on(self.kind[triangle], np.einsum("nk,nkr->nr", shares, self.rows[triangle]))

    def on(self, kind: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """The same of places (N, R) as `rows` has them, on triangles of some kinds (N,)."""
        found = np.empty((len(rows), FINISH))
        for number, source in enumerate(self.sources):
            some = np.flatnonzero(kind == number)
            if len(some):
                found[some] = _evaluated(source, rows[some])
        return found


def _evaluated(source: np.ndarray | Fields, rows: np.ndarray) -> np.ndarray:
    if not isinstance(source, Fields):
        return source
    (stage,), points = source.recipe.stages, rows[:, :3]
    ((colour, mirrored, rough),) = source.evaluated(points, points, rows[:, 6:], rows[:, 3:6])
    colour, mirrored = (np.clip(part, 0.0, 1.0) for part in (colour, mirrored))
    if stage.kind == "BSDF_PRINCIPLED":
        # As in `glassy_materials`.
        colour = np.sqrt(colour)
    return np.concatenate((np.clip(rough[:, :1], 0.0, 1.0), colour, mirrored), axis=1)


def paint_on(
    obj: bpy.types.Object,
    depsgraph: bpy.types.Depsgraph,
    corners: Corners,
    to_world: np.ndarray,
    pixels: dict[tuple, int],
) -> Paint | None:
    """The paint of an evaluated glass; None: it is everywhere as its material says.

    Parameters
    ----------
    corners : of its mesh.
    to_world : (4, 4).
    pixels : sums of images' pixels that are known already.
    """
    materials = glassy_materials(obj)
    seen = [m.evaluated_get(depsgraph) for m in materials]
    recipes = [paint_of(material)[0] for material in seen]
    looks = {plain_finish(material_interface(material)) for material in seen}
    if not any(recipes) and len(looks) < 2:
        return None
    names = sorted(set().union(*(recipe.coordinates for recipe in recipes if recipe)))
    maps = maps_of(obj, corners, names)
    rows = np.concatenate((corners.points, corners.normals, *maps.values()), axis=2)
    sources, roughness, digest = [], 0.0, hashlib.blake2b(rows[..., 6:].tobytes())
    for material, recipe in zip(seen, recipes, strict=True):
        plain = np.array(plain_finish(material_interface(material)))
        is_linked = interface_node(material).inputs["Roughness"].is_linked
        roughness = max(roughness, 1.0 if is_linked else plain[0])
        if recipe is None:
            sources.append(plain)
            digest.update(plain.tobytes())
            continue
        place = frame_of(recipe, to_world)
        fields = Fields(material.name_full, recipe, obj.original.data, place, list(maps))
        sources.append(_settled(fields, len(maps)))
        for part in (recipe.stamp(), painted(recipe, pixels), fields.is_ready, place.tolist()):
            digest.update(repr(part).encode())
    # A glassy mesh is all glass where no other material says otherwise: by the first then.
    slots = [slot.material for slot in obj.original.material_slots]
    kinds = [materials.index(m) if m in materials else 0 for m in slots]
    kind = np.array([*kinds, 0])[np.clip(corners.slots, 0, len(kinds))]
    digest.update(kind.tobytes())
    return Paint(tuple(sources), kind, rows, float(roughness), digest.digest())


def plain_finish(look: Interface) -> tuple[float, ...]:
    """`FINISH` numbers of a surface that is the same everywhere, or of a mesh that has one."""
    return (look.roughness, *look.refracted, *look.reflected)


def _settled(fields: Fields, maps: int) -> np.ndarray | Fields:
    """What nodes make that is the same everywhere is evaluated once."""
    if fields.recipe.coordinates:
        return fields
    try:
        return _evaluated(fields, np.zeros((1, 6 + 2 * maps)))[0]
    except NotReady:
        return fields
