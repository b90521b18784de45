# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method drawn: what it costs that the vertex shader solves Snell's law.

    blender --factory-startup --python scripts/displaced_vertices.py -- FILE.json

A wavy sheet behind a tube of air, 800 x 600 pixels, drawn displaced by the live view's own shaders,
and the same triangles drawn plainly. Prints milliseconds a frame (with a read-back that waits for
the GPU), frames a second displaced over plainly, and the largest error in pixels against
``optics.apparent_points`` in double precision. Needs a window; quits Blender at the end.

"Plainly" is said twice: with the shader that colours by lookup in the view's picture, as the
displaced triangles are, and with one colour.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
import traceback
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = str(ROOT), str(ROOT / "tests" / "real_blender" / "inside")
FILE = Path(sys.argv[sys.argv.index("--") + 1])
SIDES = (316, 632, 894)
"""Vertices a side of the sheet: about 100,000, 400,000 and 800,000 of them."""
SIZE = (800, 600)
NEAR, FAR = 0.01, 10.0
HALF_ANGLE = 6.0
"""Of the view, degrees up and down: the tube fills two thirds of its width."""
EYE = 0.5
FRAMES = 15
PLAIN = """
void main()
{
  vec3 q = (place * vec4(pos, 1.0)).xyz;
  at = q;
  miss = 0.0;
  gl_Position = bend.to_clip * vec4(q - bend.eye.xyz, 0.0) + bend.clip_eye;
}
"""
"""The vertex shader of the same triangles where they are."""


def sheet(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3), metres, and triangles (T, 3)."""
    y, z = np.meshgrid(np.linspace(-0.03, 0.03, side), np.linspace(-0.05, 0.05, side))
    y, z = y.ravel(), z.ravel()
    points = np.stack((-0.15 + 0.01 * np.sin(200.0 * y), y, z), axis=1).astype(np.float32)
    i = np.arange(side * side).reshape(side, side)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    halves = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
    return points, np.concatenate(halves).astype(np.uint32)


def view_of_tube():
    from glass_refraction.scene.read.viewpoint import Viewpoint

    to_camera = np.array([(0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, -EYE), (0, 0, 0, 1)], float)
    f = 1.0 / np.tan(np.radians(HALF_ANGLE))
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = f * SIZE[1] / SIZE[0], f
    projection[2, 2] = (NEAR + FAR) / (NEAR - FAR)
    projection[2, 3], projection[3, 2] = 2.0 * NEAR * FAR / (NEAR - FAR), -1.0
    eye = np.array((EYE, 0.0, 0.0))
    return Viewpoint(eye, to_camera, projection, SIZE, (0, 0, *SIZE), False)


class Bench:
    """A tube, a view of it, and the textures that the fragments look colours up in."""

    def __init__(self) -> None:
        from glass_refraction import optics
        from glass_refraction.viewport import bending, description, eye, paint

        self.glass = optics.CylinderGlass((0.040, 0.037), (1.5, 1.0), extent=(-1.0, 1.0))
        posed = description.Posed(optics.body(self.glass), np.eye(4))
        self.view = view_of_tube()
        self.frame = description.common_frame([posed])
        self.one = bending.bending(0, posed, self.view)
        self.block = self.one.block(self.view, self.frame, np.eye(4))
        self.uniform = paint._uniform(self.block)
        self.line = eye.common_line(self.view, self.frame)
        self.view_block = paint._uniform(eye.pack_view(self.view, self.frame, [], 0, 1.0))
        self.target = gpu.types.GPUOffScreen(*SIZE, format="RGBA16F")
        colours = np.random.default_rng(1).uniform(size=(SIZE[1], SIZE[0], 4)).astype(np.float32)
        self.direct = gpu.types.GPUTexture(
            SIZE, format="RGBA16F", data=gpu.types.Buffer("FLOAT", colours.shape, colours)
        )
        self.depth = self.blank = gpu.types.GPUTexture((1, 1), format="R32F")

    def draw(self, shader, batch) -> None:
        with self.target.bind():
            buffer = gpu.state.active_framebuffer_get()
            buffer.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
            gpu.state.depth_test_set("LESS_EQUAL")
            gpu.state.depth_mask_set(True)
            shader.bind()
            shader.uniform_block("bend", self.uniform)
            shader.uniform_float("place", self.one.from_world.T.ravel().tolist())
            for name, value in self.settings.items():
                getattr(shader, f"uniform_{name[0]}")(name[1], value)
            batch.draw(shader)
            buffer.read_color(0, 0, 4, 4, 4, 0, "FLOAT")

    def frame_ms(self, shader, batch, settings) -> float:
        self.settings = settings
        began = time.perf_counter()
        self.draw(shader, batch)
        return 1e3 * (time.perf_counter() - began)

    def looks(self) -> dict:
        """Uniforms of the shader that looks colours up."""
        return {
            ("block", "view"): self.view_block,
            ("sampler", "direct_tx"): self.direct,
            ("sampler", "depth_tx"): self.depth,
            ("sampler", "capture_tx"): self.direct,
            ("sampler", "reach_tx"): self.blank,
            ("int", "has_depth"): 1,
            ("int", "slot"): -1,
            ("int", "held"): 0,
            ("float", "base"): (0.5, 0.5, 0.5, 1.0),
        }

    def take_depths(self) -> None:
        """What is drawn now is what the view shows: fragments find it there."""
        from glass_refraction.viewport.eye import depths

        with self.target.bind():
            buffer = gpu.state.active_framebuffer_get()
            values = np.asarray(buffer.read_depth(0, 0, *SIZE)).reshape(SIZE[::-1])
        far = values >= 1.0
        found = np.where(far, 1e20, depths(self.line, np.where(far, 0.0, values)))
        found = np.ascontiguousarray(found, np.float32)
        self.depth = gpu.types.GPUTexture(
            SIZE, format="R32F", data=gpu.types.Buffer("FLOAT", found.shape, found)
        )


def one_colour():
    """The plain vertex shader with a fragment shader that does nothing."""
    from glass_refraction.viewport import vertex_glsl
    from glass_refraction.viewport.bending import TUBE

    info = gpu.types.GPUShaderCreateInfo()
    face = gpu.types.GPUStageInterfaceInfo("one_colour")
    face.smooth("VEC3", "at")
    face.smooth("FLOAT", "miss")
    info.define("KIND", str(TUBE))
    info.push_constant("MAT4", "place")
    info.typedef_source(vertex_glsl.BLOCKS)
    info.uniform_buf(0, "Bend", "bend")
    info.vertex_in(0, "VEC3", "pos")
    info.vertex_out(face)
    info.fragment_out(0, "VEC4", "frag")
    info.vertex_source(PLAIN)
    info.fragment_source("void main() { frag = vec4(fract(at.yz), 0.5, 1.0); }")
    return gpu.shader.create_from_info(info)


def largest_error(bench: Bench, points: np.ndarray) -> float:
    """Pixels between the shader's images and those in double precision."""
    from vertex_points import apparent_points

    from glass_refraction import optics

    unbounded = optics.CylinderGlass(bench.glass.radius, bench.glass.ior)
    true = optics.apparent_points(unbounded, "TTTT", bench.view.eye, points.astype(float))
    slot = int(np.flatnonzero(true.stretch == 4)[0])
    clip = np.column_stack((true.position[slot], np.ones(len(points))))
    clip = clip @ (bench.view.projection @ bench.view.to_camera).T
    places, _, _ = apparent_points(
        "glass_refraction", bench.one, bench.block, points, False, np.eye(4)
    )
    off = 0.5 * (places - clip[:, :2] / clip[:, 3:]) * SIZE
    return float(np.linalg.norm(off, axis=1)[true.valid[slot]].max())


def run() -> None:
    from glass_refraction.viewport.bending import TUBE
    from glass_refraction.viewport.displaced import things_shader

    bench, found = Bench(), []
    shaders = {
        "plain_colour": one_colour(),
        "plain": things_shader(TUBE, PLAIN),
        "displaced": things_shader(TUBE),
    }
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    for side in SIDES:
        points, triangles = sheet(side)
        vertices = gpu.types.GPUVertBuf(layout, len(points))
        vertices.attr_fill("pos", points)
        indices = gpu.types.GPUIndexBuf(type="TRIS", seq=triangles)
        batch = gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=indices)
        bench.depth = bench.blank
        bench.frame_ms(shaders["plain"], batch, bench.looks())
        bench.take_depths()
        times: dict[str, list[float]] = {name: [] for name in shaders}
        # In turn, so that whatever else the machine does slows all of them.
        for _ in range(FRAMES):
            for name, shader in shaders.items():
                settings = {} if name == "plain_colour" else bench.looks()
                times[name].append(bench.frame_ms(shader, batch, settings))
        line = {name: statistics.median(values) for name, values in times.items()}
        line["vertices"] = len(points)
        line["renderer"] = gpu.platform.renderer_get()
        line["ratio"] = line["plain"] / line["displaced"]
        line["ratio_to_colour"] = line["plain_colour"] / line["displaced"]
        line["error_px"] = largest_error(bench, points)
        print("DISPLACED", json.dumps(line), flush=True)
        found.append(line)
    FILE.write_text(json.dumps(found, indent=1))


def start() -> None:
    try:
        run()
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()


bpy.app.timers.register(start, first_interval=1.0)
