# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked frames on disk: geometry as Blender's Bake node reads it, pictures as image sequences.

A bake's folder holds nothing that only the extension could read, save its own list of contents::

    bake.json                        what is in the folder (:class:`Contents`)
    geometry/OBJECT/meta/*.json      one file a frame, in the Bake node's format
    geometry/OBJECT/blobs/*.blob     the arrays that those name
    images/IMAGE/IMAGE_0010.exr      one file a frame, 32-bit floats

Arrays that do not change (faces, UVs) are stored once and named by every frame. New frames are
written beside the old ones and take their place only in :func:`commit`; until then
:func:`discard` leaves the folder as it was.

The Bake node's format is Blender's "bake_items_serialize": a JSON description a frame, the arrays
as slices of raw little-endian files. Version 3 is what Blender 5.0 to 5.2 write and read.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path

import bpy
import numpy as np

from ..names import RefractiveGlassError, hidden_name
from ..read.arrays import KINDS, read_attribute

BAKE = "refractive_glass_bake"
"""Custom property of a baked scene's composite group, and on own scenes the pointer to it."""
CONTENTS = "bake.json"
GEOMETRY, IMAGES = "geometry", "images"

_FORMAT = 3
_NEW = "new"
_META_NAME = re.compile(r"\d{5,}_\d{5}\.json")

# Attribute kinds that are stored in fewer bytes than they are read in.
_NARROW = {"BYTE_COLOR": "u1", "INT8": "i1", "INT16_2D": "<i2"}
# Without these there is no mesh; other names with a dot are selections and the like.
_TOPOLOGY = {".edge_verts", ".corner_vert", ".corner_edge"}
# Read by the extension's own node group only, whose result is what is stored.
_CONSUMED = {"rg_seen", "rg_normal"}


@dataclass
class Contents:
    """What a bake's folder holds.

    Attributes
    ----------
    scene, file : names of the scene and of the .blend it was baked from.
    frames : the baked frames, ascending. Frames between them hold the nearest one.
    prepared : the frame at which light paths were chosen.
    size : width and height of the rendered picture, pixels.
    shading : ``TRUE`` or ``DISPLACED``, as it took effect.
    border : share of the picture (x0, y0, x1, y1) that glasses cover in any baked frame.
    layers : names of the own view layers that any baked frame shows.
    moments : frame -> further times (frames) at which its geometry is stored, for motion blur.
    objects : folder names of the baked objects.
    images : folder names of the baked images.
    """

    scene: str
    file: str
    frames: list[int] = field(default_factory=list)
    prepared: int = 0
    size: tuple[int, int] = (0, 0)
    shading: str = "TRUE"
    border: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    layers: list[str] = field(default_factory=list)
    moments: dict[int, list[float]] = field(default_factory=dict)
    objects: list[str] = field(default_factory=list)
    images: list[str] = field(default_factory=list)

    @property
    def span(self) -> range:
        """All frames from the first baked one to the last, those between included."""
        return range(self.frames[0], self.frames[-1] + 1) if self.frames else range(0)


def read_contents(folder: Path) -> Contents | None:
    """What the folder says that it holds; None if it is no bake's.

    Raises
    ------
    RefractiveGlassError
        The list is there but cannot be read.
    """
    path = folder / CONTENTS
    if not path.is_file():
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        found = Contents(**values)
        found.size, found.border = tuple(found.size), tuple(found.border)
        # JSON's keys are text.
        found.moments = {int(frame): times for frame, times in found.moments.items()}
    except (ValueError, TypeError) as error:
        raise RefractiveGlassError(f"{path} is no list of baked frames: {error}") from error
    return found


def write_contents(folder: Path, contents: Contents) -> None:
    """Write the list of what the folder holds."""
    path = folder / CONTENTS
    new = path.with_suffix(".new")
    new.write_text(json.dumps(asdict(contents), indent=1), encoding="utf-8")
    os.replace(new, path)


def geometry_bytes(folder: Path) -> int:
    """Size of the stored arrays. A Blender that renders all frames comes to hold them all."""
    return sum(path.stat().st_size for path in (folder / GEOMETRY).glob("*/blobs/*.blob"))


def frame_ranges(frames: list[int]) -> str:
    """Frames as a reader writes them: ``1-24, 30``."""
    ranges: list[list[int]] = []
    for frame in frames:
        if ranges and frame == ranges[-1][1] + 1:
            ranges[-1][1] = frame
        else:
            ranges.append([frame, frame])
    return ", ".join(f"{a}-{b}" if b > a else str(a) for a, b in ranges)


def file_name(*parts: str) -> str:
    """A name that every file system takes, different for different parts."""
    whole = " ".join(parts)
    plain = re.sub(r"\W+", "_", whole, flags=re.ASCII).strip("_")
    if plain == whole.replace(" ", "_") and len(plain) < 60:
        return plain
    return f"{plain[:48]}_{hashlib.blake2b(whole.encode(), digest_size=4).hexdigest()}"


class GeometryWriter:
    """Stores one object's geometry, frame by frame."""

    def __init__(self, folder: Path, name: str, session: str) -> None:
        self._folder = folder / GEOMETRY / name
        self._session = session
        self._stored: dict[bytes, dict] = {}
        (self._folder / "blobs").mkdir(parents=True, exist_ok=True)
        (self._folder / _NEW).mkdir(exist_ok=True)

    def write(self, time: float, mesh: bpy.types.Mesh) -> None:
        """Store the mesh (evaluated, world space) as the geometry at that time (frames)."""
        name = f"{Path(meta_file(time)).stem}_{self._session}.blob"
        fresh: list[bytes] = []
        size = 0

        def stored(values: np.ndarray) -> dict:
            nonlocal size
            data = np.ascontiguousarray(values).tobytes()
            digest = hashlib.blake2b(data, digest_size=16).digest()
            if digest not in self._stored:
                self._stored[digest] = {"name": name, "start": size, "size": len(data)}
                fresh.append(data)
                size += len(data)
            return self._stored[digest]

        geometry = {"mesh": _described(mesh, stored)} if len(mesh.polygons) else {}
        if fresh:
            (self._folder / "blobs" / name).write_bytes(b"".join(fresh))
        root = {"version": _FORMAT, "items": {"0": {"type": "GEOMETRY", "data": geometry}}}
        meta = self._folder / _NEW / meta_file(time)
        meta.write_text(json.dumps(root, separators=(",", ":")), encoding="utf-8")


def meta_file(time: float) -> str:
    """Name of the Bake node's description of a time (frames), as that node reads it."""
    return f"{time:011.5f}.json".replace(".", "_", 1)


def _described(mesh: bpy.types.Mesh, stored) -> dict:
    """The Bake node's description of a mesh with faces; ``stored`` keeps an array."""
    starts = np.empty(len(mesh.polygons) + 1, np.int32)
    mesh.polygons.foreach_get("loop_start", starts[:-1])
    starts[-1] = len(mesh.loops)
    described = {
        "num_vertices": len(mesh.vertices),
        "num_edges": len(mesh.edges),
        "num_polygons": len(mesh.polygons),
        "num_corners": len(mesh.loops),
        "poly_offsets": stored(starts.astype("<i4")),
        # Empty slots, for the object's own to fill: 5.2 shows none where the mesh has none.
        "materials": [None] * len(mesh.materials),
    }
    # 5.2 is told which UV map and colour count where a material names none; 5.0 takes the first.
    uv_maps = [layer.name for layer in mesh.uv_layers]
    default = next((layer.name for layer in mesh.uv_layers if layer.active_render), None)
    if default is not None:
        described["default_uv_map_name"] = default
        uv_maps.sort(key=lambda name: name != default)
    colour = mesh.color_attributes.default_color_name
    if colour:
        described["default_color_name"] = colour
    order = {name: number for number, name in enumerate(uv_maps)}
    attributes = [a for a in mesh.attributes if _is_kept(a)]
    described["attributes"] = [
        {
            "name": attribute.name,
            "domain": attribute.domain,
            "type": attribute.data_type,
            "data": stored(_values(attribute)),
        }
        for attribute in sorted(attributes, key=lambda a: order.get(a.name, -1))
    ]
    return described


def _is_kept(attribute: bpy.types.Attribute) -> bool:
    if attribute.name.startswith("."):
        return attribute.name in _TOPOLOGY
    known = attribute.data_type in KINDS and attribute.name not in _CONSUMED
    return known and len(attribute.data) > 0


def _values(attribute: bpy.types.Attribute) -> np.ndarray:
    kind = attribute.data_type
    if kind == "BYTE_COLOR":
        values = np.rint(255.0 * read_attribute(attribute, "color_srgb"))
    else:
        values = read_attribute(attribute)
    return values.astype(_NARROW.get(kind, values.dtype.newbyteorder("<")))


class ImageWriter:
    """Stores one image, frame by frame."""

    def __init__(self, folder: Path, name: str) -> None:
        self._name = name
        self._folder = folder / IMAGES / name / _NEW
        self._folder.mkdir(parents=True, exist_ok=True)
        self._last: tuple[bytes, Path] | None = None

    def write(self, frame: int, image: bpy.types.Image) -> None:
        """Store the image's present pixels as that frame's."""
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        digest = hashlib.blake2b(pixels.data, digest_size=16).digest()
        path = self._folder / image_file(self._name, frame)
        if self._last is not None and self._last[0] == digest:
            _same_file(self._last[1], path)
        else:
            _save(pixels, image.size, path)
        self._last = (digest, path)


def _save(pixels: np.ndarray, size, path: Path) -> None:
    # The image itself may be one of those that Blender saves without their alpha.
    whole = bpy.data.images.new(hidden_name("saved"), *size, alpha=True, float_buffer=True)
    try:
        whole.colorspace_settings.is_data = True
        whole.alpha_mode = "CHANNEL_PACKED"
        whole.pixels.foreach_set(pixels)
        whole.file_format = "OPEN_EXR"
        whole.save(filepath=str(path), save_copy=True)
    finally:
        bpy.data.images.remove(whole)


def image_file(name: str, frame: int) -> str:
    """Name of a baked image's file."""
    return f"{name}_{frame:04d}.exr"


def _same_file(path: Path, other: Path) -> None:
    """Make ``other`` the same as ``path``, without taking space twice where that can be had."""
    other.unlink(missing_ok=True)
    try:
        os.link(path, other)
    except OSError:
        shutil.copyfile(path, other)


def commit(folder: Path, contents: Contents, *, replaced: Contents | None = None) -> None:
    """Let the new frames take the old ones' place; ``contents`` says what then is there.

    Parameters
    ----------
    replaced : what was there before and goes altogether; None to keep the other frames.
    """
    if replaced is not None:
        remove(folder, replaced)
    before = read_contents(folder)
    old = before.moments if before is not None else {}
    stale = [t for f, times in old.items() if times != contents.moments.get(f) for t in times]
    # One frame more at both ends. A sequence shows the file before its first frame's up to there,
    # and of geometry the last moment would be held, not the last frame.
    span = range(max(0, contents.span.start - 1), contents.span.stop + 1)
    for name in contents.objects:
        target = folder / GEOMETRY / name / "meta"
        for time in stale:
            (target / meta_file(time)).unlink(missing_ok=True)
        _take_place(target.with_name(_NEW), target)
        known = {n: target / meta_file(n) for n in contents.frames}
        _fill(known, span, lambda n, t=target: t / meta_file(n))
        _drop_unnamed_blobs(target.parent)
    for name in contents.images:
        target = folder / IMAGES / name
        _take_place(target / _NEW, target)
        known = {n: target / image_file(name, n) for n in contents.frames}
        _fill(known, span, lambda n, t=target, k=name: t / image_file(k, n))
    write_contents(folder, contents)


def discard(folder: Path) -> None:
    """Remove new frames that were not committed; what stood before stays."""
    for kind in (GEOMETRY, IMAGES):
        for new in sorted((folder / kind).glob(f"*/{_NEW}")):
            _remove_files(new, new.parent.name)
            if kind == GEOMETRY:
                _drop_unnamed_blobs(new.parent)
    _remove_empty_folders(folder)


def remove(folder: Path, contents: Contents) -> None:
    """Remove a bake's committed files, and its folders where nothing else is in them."""
    for name in contents.objects:
        _remove_files(folder / GEOMETRY / name / "meta", name)
        _drop_unnamed_blobs(folder / GEOMETRY / name)
    for name in contents.images:
        _remove_files(folder / IMAGES / name, name)
    (folder / CONTENTS).unlink(missing_ok=True)
    _remove_empty_folders(folder)


def _remove_files(folder: Path, name: str) -> None:
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.is_file() and _is_ours(path, name):
            path.unlink()


def _is_ours(path: Path, name: str) -> bool:
    image = rf"{re.escape(name)}_\d{{4,}}\.exr"
    return bool(
        _META_NAME.fullmatch(path.name)
        or re.fullmatch(r"\d{5,}_\d{5}_[0-9a-f]{8}\.blob", path.name)
        or re.fullmatch(image, path.name)
    )


def _take_place(new: Path, target: Path) -> None:
    if not new.is_dir():
        return
    target.mkdir(exist_ok=True)
    for path in new.iterdir():
        os.replace(path, target / path.name)
    new.rmdir()


def _fill(known: dict[int, Path], span: range, place) -> None:
    """Give every frame of the span that has no file of its own the nearest one's."""
    frames = np.array(sorted(known))
    for frame in span:
        if frame not in known:
            nearest = int(frames[np.argmin(np.abs(frames - frame))])
            _same_file(known[nearest], place(frame))


def _drop_unnamed_blobs(folder: Path) -> None:
    """Remove the arrays that no frame names any more."""
    named = set()
    for meta in folder.glob("*/*.json"):
        named |= set(re.findall(r'"name":\s*"([^"]+\.blob)"', meta.read_text(encoding="utf-8")))
    for blob in (folder / "blobs").glob("*.blob"):
        if blob.name not in named and _is_ours(blob, folder.name):
            blob.unlink()


def _remove_empty_folders(folder: Path) -> None:
    for kind in (GEOMETRY, IMAGES):
        # The innermost first.
        for path in sorted((folder / kind).glob("**/"), reverse=True):
            _remove_empty(path)
    _remove_empty(folder)


def _remove_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
