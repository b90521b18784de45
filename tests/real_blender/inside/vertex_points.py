# SPDX-License-Identifier: GPL-3.0-or-later
"""Where points appear as the live view's vertex shader finds it."""

import importlib

import gpu
import numpy as np

# One point per vertex, whose pixel takes where it appears in the picture (-1 to 1) and the length
# of the way there.
VERTEX = """
void main()
{
  vec3 v = bent((place * vec4(pos, 1.0)).xyz, miss);
  vec4 clip = bend.to_clip * vec4(v, 0.0) + bend.clip_eye;
  at = vec3(clip.xy / clip.w, length(v));
  vec2 pixel = vec2(float(gl_VertexID % COLUMNS), float(gl_VertexID / COLUMNS)) + 0.5;
  gl_Position = vec4(2.0 * pixel / float(COLUMNS) - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}
"""
FRAGMENT = """
void main() { frag = vec4(at, miss); }
"""


def apparent_points(package, one, block, points, held, to_world):
    """Where points appear; needs a GPU context.

    Parameters
    ----------
    package : name of ``glass_refraction``, by whatever it was loaded.
    one, block : a `Bending` and its block. held : whether the glass holds the points.
    points : (N, 3), of a mesh that ``to_world`` (4, 4) places.

    Returns
    -------
    places, ways, misses : (N, 2) in the picture, -1 to 1; (N,) lengths of the light path in units
        of the glass; (N,) by how much the ray that was found misses the point.
    """
    glsl, bending, paint = (
        importlib.import_module(f"{package}.viewport.{name}")
        for name in ("vertex_glsl", "bending", "paint")
    )
    side = int(np.ceil(np.sqrt(len(points))))
    info = gpu.types.GPUShaderCreateInfo()
    face = gpu.types.GPUStageInterfaceInfo(f"apparent_{one.kind}_{side}")
    face.flat("VEC3", "at")
    face.flat("FLOAT", "miss")
    info.define("KIND", str(one.kind))
    info.define("COLUMNS", str(side))
    info.push_constant("MAT4", "place")
    info.push_constant("INT", "held")
    info.typedef_source(glsl.BLOCKS)
    info.uniform_buf(0, "Bend", "bend")
    info.vertex_in(0, "VEC3", "pos")
    info.vertex_out(face)
    info.fragment_out(0, "VEC4", "frag")
    info.vertex_source(glsl.BEND + VERTEX)
    info.fragment_source(FRAGMENT)
    shader = gpu.shader.create_from_info(info)
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(points))
    vertices.attr_fill("pos", np.ascontiguousarray(points, np.float32))
    texture = gpu.types.GPUTexture((side, side), format="RGBA32F")
    target = gpu.types.GPUFrameBuffer(color_slots=[texture])
    buffer = paint._uniform(block)
    with target.bind():
        target.clear(color=(0.0, 0.0, 0.0, 0.0))
        gpu.state.viewport_set(0, 0, side, side)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")
        shader.bind()
        shader.uniform_block("bend", buffer)
        shader.uniform_float("place", (one.from_world @ to_world).T.ravel().tolist())
        if one.kind != bending.SLAB:
            shader.uniform_int("held", int(held))
        gpu.types.GPUBatch(type="POINTS", buf=vertices).draw(shader)
        found = np.asarray(target.read_color(0, 0, side, side, 4, 0, "FLOAT"))
    found = found.reshape(-1, 4)[: len(points)]
    return found[:, :2], found[:, 2], found[:, 3]
