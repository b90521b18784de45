# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths as strings: keys of what is made for each of them, and back."""

from __future__ import annotations

from .. import optics


def path_key(path: optics.LightPath) -> str:
    """A string that tells the path from all others: its events, with interfaces if it has any."""
    return str(path)


def path_of(key: str) -> optics.LightPath:
    """The path of a key."""
    if " " not in key:
        return optics.LightPath(key)
    named = key.removesuffix(", ...")
    steps = [step.split(" ") for step in named.split(", ")]
    events, names = "".join(s[0] for s in steps), tuple(s[1] for s in steps)
    return optics.LightPath(events, names, open=named != key)


def short_key(path: optics.LightPath) -> str:
    """The same in a few letters, for names that Blender cuts off.

    The interfaces of a glass begin with different letters.
    """
    if path.interfaces is None:
        return path.events
    steps = "".join(e + name[0] for e, name in zip(path.events, path.interfaces, strict=True))
    return f"{steps}+" if path.open else steps
