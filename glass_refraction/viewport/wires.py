# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges by which a view shows that its glasses can be clicked at, drawn as depths.

A glass leaves its edges only while a view shows it refracted. Blender's overlay draws
them, with their depths, over what the engine drew. Where they lie tells which pixels are to be
cleared of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import gpu
import numpy as np

from ..scene.read.arrays import edges, positions
from . import glsl
from .news import News
from .places import Place
from .shaders import kept

NOTHING = 2.0
"""Of a depth buffer, whose values run from 0 to 1: no edge is here."""
BESIDE = tuple(shift for k in (-2, -1, 1, 2) for shift in ((k, 0), (0, k)))
"""Pixels by which edges are drawn shifted, too: Blender smooths them, and may round their places
otherwise. Slanted shifts alone would leave gaps beside a slanted edge."""
HERE = (0, 0)


class Wires:
    """The edges of a view's glasses on the GPU."""

    def __init__(self) -> None:
        self._targets: dict[tuple[int, int], tuple] = {}
        self._batches: dict[int, tuple[tuple, gpu.types.GPUBatch | None]] = {}
        self._poses: dict[int, list[np.ndarray]] = {}
        self.hosts: set[int] = set()
        """Session uids of the objects with which what is drawn is selected."""

    def read(self, places: list[Place], depsgraph: bpy.types.Depsgraph, news: News) -> None:
        """Take over what is drawn by lines, as it is evaluated."""
        self._poses = {}
        self.hosts = {place.host.session_uid for place in places}
        for place in places:
            uid = place.obj.session_uid
            if uid not in self._poses:
                self._poses[uid] = []
                self._read_object(place.obj, depsgraph, news)
            self._poses[uid].append(place.to_world)
        for uid in self._batches.keys() - self._poses.keys():
            del self._batches[uid]

    def _read_object(self, obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph, news: News):
        uid = obj.session_uid
        evaluated = obj.evaluated_get(depsgraph)
        is_mesh = obj.type == "MESH"
        mesh = evaluated.data if is_mesh else evaluated.to_mesh()
        key = (news.shape_of(obj), len(mesh.vertices), len(mesh.edges)) if mesh else ()
        if uid not in self._batches or self._batches[uid][0] != key:
            self._batches[uid] = key, _batch(mesh) if mesh else None
        if not is_mesh:
            evaluated.to_mesh_clear()

    def _placed(self) -> Iterator[tuple[int, np.ndarray]]:
        return ((uid, pose) for uid, poses in self._poses.items() for pose in poses)

    def draw(self, view_to_clip: np.ndarray, size: tuple[int, int], nearer: float = 0.0):
        """Draw the depths of edges.

        Parameters
        ----------
        view_to_clip : (4, 4) from the world to clip space. size : pixels.
        nearer : see `eye.overlay_nearer`.

        Returns
        -------
        gpu.types.GPUTexture
            Values as in a depth buffer, `NOTHING` where nothing is; valid until the next call with
            this size.
        """
        width, height = size
        view_to_clip = view_to_clip.copy()
        view_to_clip[2] -= nearer * view_to_clip[3]
        if size not in self._targets:
            # A view has one size, and its captures another.
            while len(self._targets) > 1:
                self._targets.pop(next(iter(self._targets)))
            depth = gpu.types.GPUTexture(size, format="R32F")
            hidden = gpu.types.GPUTexture(size, format="DEPTH_COMPONENT32F")
            target = gpu.types.GPUFrameBuffer(depth_slot=hidden, color_slots=[depth])
            # Framebuffers hold no textures: one that Python lets go of is attached no more.
            self._targets[size] = depth, target, hidden
        texture, target, _ = self._targets[size]
        shader = _shader()
        with target.bind():
            gpu.state.viewport_set(0, 0, width, height)
            target.clear(color=(NOTHING, 0.0, 0.0, 0.0), depth=1.0)
            gpu.state.blend_set("NONE")
            gpu.state.depth_test_set("LESS_EQUAL")
            gpu.state.depth_mask_set(True)
            shader.bind()
            # What lies only beside an edge comes second: it must not hide another edge.
            for begin, shifts in enumerate(((HERE,), BESIDE)):
                shader.uniform_float("begin", float(begin))
                for uid, pose in self._placed():
                    batch = self._batches[uid][1]
                    for columns in _shifted(view_to_clip @ pose, shifts, size) if batch else ():
                        shader.uniform_float("to_clip", columns)
                        batch.draw(shader)
            gpu.state.depth_mask_set(False)
            gpu.state.depth_test_set("NONE")
        return texture


def _shifted(to_clip: np.ndarray, shifts, size: tuple[int, int]) -> list[list[float]]:
    """A matrix that also shifts by some pixels (right, up), column by column as GLSL keeps it."""
    moved = np.repeat(to_clip.T[None], len(shifts), axis=0)
    moved[:, :, :2] += 2.0 * (np.array(shifts) / size)[:, None] * to_clip[3, :, None]
    return moved.reshape(-1, 16).tolist()


def _batch(mesh: bpy.types.Mesh) -> gpu.types.GPUBatch | None:
    ends = edges(mesh)
    if not len(ends):
        return None
    places = np.ascontiguousarray(positions(mesh), np.float32)
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="place", comp_type="F32", len=3, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(places))
    vertices.attr_fill("place", places)
    indices = gpu.types.GPUIndexBuf(type="LINES", seq=ends)
    return gpu.types.GPUBatch(type="LINES", buf=vertices, elem=indices)


def _shader():
    if "wires" not in kept:
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC3", "place")
        info.push_constant("MAT4", "to_clip")
        info.push_constant("FLOAT", "begin")
        info.fragment_out(0, "VEC4", "frag")
        info.vertex_source(glsl.WIRES_VERTEX)
        info.fragment_source(glsl.WIRES)
        kept["wires"] = gpu.shader.create_from_info(info)
    return kept["wires"]
