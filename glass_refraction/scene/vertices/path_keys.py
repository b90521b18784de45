# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths as strings: keys of what is made for each of them, and back."""

from __future__ import annotations

import zlib

from ... import optics

Path = optics.LightPath | optics.ChainedPath
"""Of one glass, or of it and another behind it."""


def path_key(path: Path) -> str:
    """A string that tells the path from all others: its events, with interfaces if it has any."""
    return str(path)


def path_of(key: str) -> Path:
    """The path of a key."""
    if " > " in key:
        first, rest = key.split(" > ", 1)
        second, name = rest.split(" (", 1)
        return optics.ChainedPath(path_of(first), path_of(second), name.removesuffix(")"))
    if " " not in key:
        return optics.LightPath(key)
    named = key.removesuffix(", ...")
    steps = [step.split(" ") for step in named.split(", ")]
    events, names = "".join(s[0] for s in steps), tuple(s[1] for s in steps)
    return optics.LightPath(events, names, open=named != key)


def short_key(path: Path) -> str:
    """The same in a few letters, for names that Blender cuts off.

    The interfaces of a glass begin with different letters.
    """
    if isinstance(path, optics.ChainedPath):
        name = zlib.crc32(path.behind.encode()) & 0xFFFF
        return f"{short_key(path.first)}>{short_key(path.second)} {name:04x}"
    if path.interfaces is None:
        return path.events
    steps = "".join(e + name[0] for e, name in zip(path.events, path.interfaces, strict=True))
    return f"{steps}+" if path.open else steps
