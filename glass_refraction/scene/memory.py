# SPDX-License-Identifier: GPL-3.0-or-later
"""What was computed for a scene and for what it was, kept from one update to the next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import bpy
import numpy as np

if TYPE_CHECKING:
    from .. import optics
    from .light.light import KeptLight
    from .plan import Plan
    from .rays.caster import Casters
    from .rays.follow import Kept
    from .rays.frame import ViewReport
    from .rays.true import Exposure
    from .read.cutouts import Masks
    from .read.glasses import Glass
    from .read.sources import Snapshot
    from .vertices.appearance import Appearance, Source
    from .vertices.regions import Regions
    from .vertices.tessellation import Probe

counters: Counter[str] = Counter()
"""Operations since start: ``solves``, ``masks``, ``mask_pixels``, ``copies``, ``structures``,
``settings``, ``mirrored`` (meshes of real glass that were written), ``listed`` (glasses of which
paths were listed)."""


@dataclass
class Status:
    """What the panel shows of a scene's last update.

    Attributes
    ----------
    vertices, paths, bound_px : of displaced copies.
    views : radiance views of True shading. unseen : part of the light that none of them shows.
    rays : that bring any light. ways : of these. covered : pixels that any glass covers.
    milliseconds : of the last update. problems : a line for each thing that is not shown.
    """

    vertices: int = 0
    paths: tuple[str, ...] = ()
    milliseconds: float = 0.0
    bound_px: float = 0.0
    problems: list[str] = field(default_factory=list)
    views: tuple[ViewReport, ...] = ()
    unseen: float = 0.0
    rays: int = 0
    ways: int = 0
    covered: int = 0


CopyKey = tuple[int, int, int]
"""Number of the pane, of the slot, and the source's session uid."""


@dataclass
class Memory:
    """What was computed for a scene, with the stamps that it was computed from.

    Attributes
    ----------
    plan : what the own scenes of displaced copies were made for; None if there are none.
    regions : pane -> of its light paths.
    weights : (pane, slot) -> what those were found from that its image holds.
    shown : pane -> the glass, and the paths by their slots, as they were at the last update.
    copies : what each copy holds; no entry where it is empty.
    occluders : session uid -> of objects that Geometry Nodes cannot take.
    probes : (pane, path) -> rays of the path.
    hulls : glass -> stamp of its outline.
    centre : the rendered frame's own time, once it is known; motion blur asks for others round it.
    exposure : that frame in True shading, while other moments of its shutter are awaited.
    moments : time -> where the vertices of each copy are then.
    paths : glass with its colour, and the kind of paths -> the paths that are kept.
    casters : of rays, which know what stands in their targets.
    kept, kept_light : ways of rays that the next frame may use, of the eye's and of the lamps'.
    mirrored : session uid of an own object that mirrors show -> stamp of what it holds.
    masks : what was read of images in this render.
    made : session uids of the data-blocks that were made when the scene was prepared.
    covered : (height, width) pixels of the last picture that a glass covers, in True shading.
    """

    plan: Plan | None = None
    regions: dict[int, tuple[tuple, Regions]] = field(default_factory=dict)
    weights: dict[tuple[int, int], tuple] = field(default_factory=dict)
    shown: dict[int, tuple[Glass | None, dict[int, optics.LightPath]]] = field(default_factory=dict)
    copies: dict[CopyKey, tuple[tuple, Source, Appearance]] = field(default_factory=dict)
    occluders: dict[int, Snapshot] = field(default_factory=dict)
    probes: dict[tuple[int, optics.LightPath], tuple[tuple, Probe]] = field(default_factory=dict)
    hulls: dict[int, tuple | None] = field(default_factory=dict)
    still: tuple | None = None
    centre: float | None = None
    exposure: Exposure | None = None
    moments: dict[float, dict[CopyKey, np.ndarray]] = field(default_factory=dict)
    paths: dict[Hashable, tuple[tuple, tuple[optics.LightPath, ...]]] = field(default_factory=dict)
    standing: list[str] = field(default_factory=list)
    """What was wrong when the scene was prepared; a frame's own problems come on top."""
    last: list[str] = field(default_factory=list)
    """What was wrong with the last picture, for who looks at it when the scene is prepared anew."""
    casters: Casters | None = None
    made: frozenset[int] = frozenset()
    covered: np.ndarray | None = None
    mirrored: dict[int, tuple] = field(default_factory=dict)
    masks: Masks = field(default_factory=dict)
    kept: Kept | None = None
    kept_light: KeptLight | None = None
    status: Status = field(default_factory=Status)


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
