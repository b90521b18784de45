# SPDX-License-Identifier: GPL-3.0-or-later
"""What was computed for a scene and for what it was, kept from one update to the next."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import bpy
import numpy as np

from .. import optics
from .ray_screen import RayScreen
from .read.sources import Snapshot
from .vertices.appearance import Appearance, Source
from .vertices.regions import Regions
from .vertices.tessellation import Probe

counters: Counter[str] = Counter()
"""Operations since start: ``solves``, ``masks``, ``mask_pixels``, ``copies``, ``structures``,
``settings``, ``listed`` (glasses of which paths were listed)."""


@dataclass
class Status:
    """What the panel shows of a scene's last update."""

    vertices: int = 0
    paths: tuple[str, ...] = ()
    milliseconds: float = 0.0
    bound_px: float = 0.0
    problems: list[str] = field(default_factory=list)
    views: tuple = ()
    unseen: float = 0.0
    rays: int = 0
    ways: int = 0
    covered: int = 0


@dataclass(frozen=True)
class Step:
    """How far an update has come: the part that is done (0 to 1), and what comes next."""

    share: float
    label: str


@dataclass
class Memory:
    """What was computed for a scene, with the stamps that it was computed from."""

    regions: dict[str, tuple[tuple, Regions]] = field(default_factory=dict)
    copies: dict[tuple[str, str, int], tuple[tuple, Source, Appearance]] = field(
        default_factory=dict
    )
    occluders: dict[int, Snapshot] = field(default_factory=dict)
    probes: dict[tuple[str, optics.LightPath], tuple[tuple, Probe]] = field(default_factory=dict)
    borders: dict[str, tuple[tuple, tuple[np.ndarray, np.ndarray]]] = field(default_factory=dict)
    """Of each glass: the pixels where its paths end, and those that it covers."""
    ray_screens: dict[str, tuple[tuple, RayScreen]] = field(default_factory=dict)
    still: tuple | None = None
    centre: float | None = None
    """The rendered frame's own time, once it is known; motion blur asks for others round it."""
    moments: dict[float, dict[tuple[str, str, int], np.ndarray]] = field(default_factory=dict)
    """Where the vertices of each copy are at these times."""
    paths: dict[str, tuple[tuple, tuple[optics.LightPath, ...], np.ndarray]] = field(
        default_factory=dict
    )
    chains: dict[str, tuple[tuple, tuple[optics.ChainedPath, ...]]] = field(default_factory=dict)
    status: Status = field(default_factory=Status)
    caster: object | None = None


_memories: dict[int, Memory] = {}


def memory_of(scene: bpy.types.Scene) -> Memory:
    """The scene's runtime memory; lost on undo and file load, then computed anew."""
    return _memories.setdefault(scene.original.session_uid, Memory())


def forget(scene: bpy.types.Scene | None = None) -> None:
    """Drop all that was computed, for a scene or for all.

    References and arrays may be stale (undo, redo, file load).
    """
    if scene is None:
        _memories.clear()
    else:
        _memories.pop(scene.session_uid, None)


def status(scene: bpy.types.Scene) -> Status:
    """What the last update of the scene did."""
    return memory_of(scene).status
