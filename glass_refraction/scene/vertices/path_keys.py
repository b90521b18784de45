# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths as strings, for reports and the panel."""

from __future__ import annotations

from ... import optics


def path_key(path: optics.LightPath) -> str:
    """A string that tells the path from all others: its events, with interfaces if it has any."""
    return str(path)


def path_of(key: str) -> optics.LightPath:
    """The path of a key."""
    if " " not in key:
        return optics.LightPath(key)
    named = key.removesuffix(", ...")
    steps = [step.split(" ") for step in named.split(", ")]
    events, interfaces = "".join(s[0] for s in steps), tuple(s[1] for s in steps)
    return optics.LightPath(events, interfaces, open=named != key)
