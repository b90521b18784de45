# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh's own material and the modifier both have its glass's ior: change one, the other follows.

What was seen last tells which of the two was changed. Nothing is written before a change is seen,
nor where animation or drivers decide. The modifier also follows in which of the mesh's materials
are no glass, and in the UV map that they look up.
"""

from __future__ import annotations

import bpy

from .read.animation import may_change
from .read.glasses import is_mesh_glass
from .read.glassy_materials import (
    OPAQUE,
    glassy_materials,
    interface_node,
    wanted_bits,
)
from .read.material_fields import UV_MAP, wanted_map
from .read.modifier_inputs import data_path, glass_modifier, has_input, read_input, write_input

CLOSE = 1e-6
"""Float32 keeps an ior to this."""

_seen: dict[int, tuple[float, float]] = {}
"""Object's session uid -> its modifier's ior and its material's, as last seen."""


def remember() -> None:
    """Take the values of all glasses as seen, those of a file that was opened."""
    _seen.clear()
    for obj in bpy.data.objects:
        _follow(obj, write=False)


def follow(depsgraph: bpy.types.Depsgraph) -> None:
    """Let iors follow what was changed, after an evaluation; for its handler."""
    ids = [update.id for update in depsgraph.updates]
    changed = any(isinstance(i, (bpy.types.Material, bpy.types.ShaderNodeTree)) for i in ids)
    for obj in (i.original for i in ids if isinstance(i, bpy.types.Object)):
        changed |= _follow(obj)
    if changed:
        # Others may be of the same material.
        for obj in bpy.data.objects:
            _follow(obj)


def tell_modifier(obj: bpy.types.Object) -> None:
    """Have a glass that can be written know which material slots of its mesh are no glass, and
    which UV map its materials look up."""
    modifier, is_mesh = glass_modifier(obj), is_mesh_glass(obj)
    for name, wanted in (
        (OPAQUE, wanted_bits(obj) if is_mesh else 0),
        (UV_MAP, wanted_map(obj) if is_mesh else ""),
    ):
        if has_input(modifier, name):
            write_input(modifier, name, wanted)


def _follow(obj: bpy.types.Object, *, write: bool = True) -> bool:
    """Let an object and its material follow each other; returns whether the material did."""
    if not is_mesh_glass(obj):
        return False
    modifier = glass_modifier(obj)
    if write and obj.is_editable:
        tell_modifier(obj)
    material = next(iter(glassy_materials(obj)), None)
    if material is None:
        _seen.pop(obj.session_uid, None)
        return False
    socket = interface_node(material).inputs["IOR"]
    mine, theirs = float(read_input(modifier, "IOR")), float(socket.default_value)
    last = _seen.get(obj.session_uid)
    _seen[obj.session_uid] = mine, theirs
    if last is None or not write or abs(mine - theirs) <= CLOSE:
        return False
    path = data_path(modifier, "IOR")
    if abs(theirs - last[1]) > CLOSE:
        if obj.is_editable and not may_change(obj, path):
            write_input(modifier, "IOR", theirs)
            _seen[obj.session_uid] = theirs, theirs
    elif abs(mine - last[0]) > CLOSE and material.is_editable and not socket.is_linked:
        tree = material.node_tree
        if not may_change(tree, socket.path_from_id("default_value")):
            socket.default_value = mine
            _seen[obj.session_uid] = mine, mine
            return True
    return False
