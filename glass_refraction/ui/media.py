# SPDX-License-Identifier: GPL-3.0-or-later
"""Media by name: a menu beside a number that is an index of refraction.

The number is what is stored; the name follows from it, so that keyframes, drivers and scripts that
change the number never leave a wrong name behind.
"""

from __future__ import annotations

import re

import bpy

from ..optics import MEDIA
from ..scene.read.modifier_inputs import glass_modifier, read_input, write_input
from . import staying

CUSTOM = "CUSTOM"
_CLOSE = 5e-5
"""Float32 and four decimals in a field are this far from the table's number at most."""

_NAMES = (None, *MEDIA)


def medium_identifier(name: str) -> str:
    """The medium's name as an enum item's identifier."""
    return re.sub(r"\W+", "_", name).strip("_").upper()


MEDIUM_ITEMS = (
    (CUSTOM, "Custom", "An index of refraction that is none of the media's", 0),
    *(
        (medium_identifier(name), name, f"Index of refraction {MEDIA[name]:.5f}", number)
        for number, name in enumerate(_NAMES)
        if name is not None
    ),
)


def medium_number(ior: float) -> int:
    """The item's number of the medium with this index of refraction; 0 if none has it."""
    near = (n for n, name in enumerate(_NAMES) if name and abs(MEDIA[name] - ior) <= _CLOSE)
    return next(near, 0)


def choose_ior(medium: str) -> float | None:
    """The index of refraction of the medium with this identifier; None for *Custom*."""
    number = next(item[3] for item in MEDIUM_ITEMS if item[0] == medium)
    return None if _NAMES[number] is None else MEDIA[_NAMES[number]]


def _input_medium(label: str, description: str, socket: str):
    """An enum of the medium that an input of an object's glass modifier is, and sets.

    Choosing *Custom* changes nothing: the number stays to be edited.
    """

    def read(obj: bpy.types.Object) -> int:
        modifier = glass_modifier(obj)
        return 0 if modifier is None else medium_number(read_input(modifier, socket))

    def write(obj: bpy.types.Object, number: int) -> None:
        modifier = glass_modifier(obj)
        if modifier is not None and _NAMES[number] is not None:
            write_input(modifier, socket, MEDIA[_NAMES[number]])

    return bpy.props.EnumProperty(
        name=label,
        description=description,
        items=MEDIUM_ITEMS,
        get=read,
        set=write,
        options={"SKIP_SAVE"},
    )


_INPUTS = (
    (
        "refractive_glass_medium",
        "Medium",
        "What the glass is made of: sets its index of refraction",
        "IOR",
    ),
    (
        "refractive_glass_contents",
        "Contents",
        "What the glass holds, or what lies behind a slab: sets its index of refraction",
        "Contents IOR",
    ),
)


def register() -> None:
    """Hang the media of a glass on the object."""
    for name, *of_input in _INPUTS:
        staying.hang(bpy.types.Object, name, _input_medium(*of_input))


def unregister() -> None:
    """Undo :func:`register`."""
    for name, *_ in _INPUTS:
        staying.take_off(bpy.types.Object, name)
