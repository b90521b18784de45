# SPDX-License-Identifier: GPL-3.0-or-later
"""What single passes of the live view's drawing give for arrays; needs a GPU context.

``paint`` is the installed extension's module.
"""

from importlib import import_module

import gpu
import numpy as np

AT_ONCE = 3
"""Ways of which exit rays are written, two textures each: Blender draws into six at once."""
EXITS = """
/* Exit rays of the ways from number `wanted` on of the ray in each pixel. */
vec4 exit_places[AT_ONCE];
vec4 exit_alongs[AT_ONCE];

void note(vec3 p, vec3 d, float part, float green, int number)
{
  for (int k = 0; k < AT_ONCE; k++) {
    if (number == wanted + k) {
      exit_places[k] = vec4(p, part);
      exit_alongs[k] = vec4(d, green);
    }
  }
}

void darken(vec3 p, vec3 d, float part, int number) { note(p, d, part, 0.0, number); }
void lose(vec4 light) {}
bool covered(vec3 p) { return false; }
bool ends(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  if (way >= NOWHERE) {
    note(p, d, light.w, light.g, number);
  }
  return way >= NOWHERE;
}
bool touches(vec3 p, vec3 d, vec4 light, int g, int number) { return false; }

void main()
{
  for (int k = 0; k < AT_ONCE; k++) {
    exit_places[k] = exit_alongs[k] = vec4(0.0);
  }
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 p = texelFetch(origin_tx, pixel, 0).xyz;
  vec3 d = normalize(texelFetch(along_tx, pixel, 0).xyz);
  sampled = pixel;
  follow(p, d, starting(false), least, most, true, unseen);
"""
_EXITS_OUT = (
    "\n".join(
        f"  place_{k} = exit_places[{k}];\n  along_{k} = exit_alongs[{k}];" for k in range(AT_ONCE)
    )
    + "\n}\n"
)


def _constant(paint, module: str, name: str):
    return getattr(import_module(f".{module}", paint.__package__), name)


def tiles_of(paint, depths: np.ndarray) -> np.ndarray:
    """Nearest and farthest depths (rows, columns, 2) of tiles.

    ``depths``: (height, width) of pixels.
    """
    height, width = depths.shape
    rows, columns = -(-height // paint.TILE), -(-width // paint.TILE)
    direct = paint.Direct()
    direct._plain = paint._texture(np.ascontiguousarray(depths, np.float32), "R32F")
    _, target = paint._target((columns, rows), "RGBA32F")
    direct._take_tiles(target, (columns, rows))
    with target.bind():
        read = target.read_color(0, 0, columns, rows, 4, 0, "FLOAT")
    return np.asarray(read).reshape(rows, columns, 4)[..., :2]


def exit_rays(
    paint, block, origins, directions, least: float, ways: int, trees=(), unseen: float = 0.0
):
    """Exit rays as the shader finds them.

    Parameters
    ----------
    block, trees : see `description.pack` and `description.trees_of`.
    origins, directions : (rows, columns, 3), common frame.
    ways : how many to return of each ray. unseen : how far rays run before they can be bent.

    Returns
    -------
    places, alongs : (ways, rows, columns, 4): origin and part of the light, which is 0 where the
        ray has no such way; direction, and what of green light gets through.
    """
    rows, columns, _ = origins.shape
    size = (columns, rows)
    inputs = []
    for values in (origins, directions):
        filled = np.ones((rows, columns, 4), np.float32)
        filled[..., :3] = values
        inputs.append(paint._texture(filled, "RGBA32F"))
    outputs = [gpu.types.GPUTexture(size, format="RGBA32F") for _ in range(2 * AT_ONCE)]
    target = gpu.types.GPUFrameBuffer(color_slots=outputs)
    glsl = import_module(".glsl", paint.__package__)
    shader = paint.compiled(
        constants=[
            ("VEC4", "box"),
            ("FLOAT", "least"),
            ("FLOAT", "unseen"),
            ("INT", "most"),
            ("INT", "wanted"),
        ],
        samplers=["origin_tx", "along_tx"],
        outputs=[f"{n}_{k}" for k in range(AT_ONCE) for n in ("place", "along")],
        fragment=f"{glsl.HOOKS}{glsl.FOLLOW}#define AT_ONCE {AT_ONCE}\n{EXITS}{_EXITS_OUT}",
        glasses=True,
        meshes=bool(trees),
    )
    glasses = paint._uniform(block)
    mesh = paint.mesh_texture(trees) if trees else None
    found = np.zeros((2, ways, rows, columns, 4), np.float32)
    for first in range(0, ways, AT_ONCE):
        count = min(AT_ONCE, ways - first)
        with paint.filling(target, size, shader):
            shader.uniform_block("glasses", glasses)
            shader.uniform_sampler("origin_tx", inputs[0])
            shader.uniform_sampler("along_tx", inputs[1])
            if mesh is not None:
                shader.uniform_sampler("mesh_tx", mesh)
            shader.uniform_float("least", least)
            shader.uniform_float("unseen", unseen)
            # Ways come in the same order, wherever it ends.
            shader.uniform_int("most", first + count)
            shader.uniform_int("wanted", first)
        with target.bind():
            for slot in range(2 * count):
                data = target.read_color(0, 0, columns, rows, 4, slot, "FLOAT")
                found[slot % 2, first + slot // 2] = np.asarray(data).reshape(rows, columns, 4)
        if not found[0, first, ..., 3].any():
            break
    return found[0], found[1]


def plain_values(paint, values: np.ndarray) -> np.ndarray:
    """Values (height, width) of a depth buffer without what EEVEE adds to them."""
    height, width = values.shape
    nothing = np.full((height, width), _constant(paint, "wires", "NOTHING"), np.float32)
    inputs = {
        "raw_tx": paint._texture(np.ascontiguousarray(values, np.float32), "R32F"),
        "wire_tx": paint._texture(nothing, "R32F"),
    }
    _, target = paint._target((width, height), "RGBA32F")
    glsl = import_module(".glsl", paint.__package__)
    main = "void main() { frag = vec4(value_of(raw_tx, ivec2(gl_FragCoord.xy))); }"
    shader = paint.compiled(**paint.DESCRIPTIONS["depth"] | {"fragment": glsl.AMENDED + main})
    with paint.filling(target, (width, height), shader):
        shader.uniform_int("amended", 1)
        for name, texture in inputs.items():
            shader.uniform_sampler(name, texture)
    with target.bind():
        read = target.read_color(0, 0, width, height, 4, 0, "FLOAT")
    return np.asarray(read).reshape(height, width, 4)[..., 0]


def depths_between(
    paint, values: np.ndarray, width: float, parts: int, *, parallel: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Depths that count at ``parts``² places in each pixel.

    Parameters
    ----------
    values : (height, width) depths of pixels. width : of a pixel, in the depths' unit.
    parallel : what kind of view they are depths of.

    Returns
    -------
    (rows, columns) each: the depths, those of a round thing's edge to the left of each place, those
    of a surface that goes on from pixel to pixel, and those that count where the values are a
    capture's, of which a face is a square.
    """
    height, columns = values.shape
    direct = paint.Direct()
    direct.size = (columns, height)
    direct.depth = direct._plain = paint._texture(np.ascontiguousarray(values, np.float32), "R32F")
    direct._stepped, direct._to_stepped = paint._target(direct.size, "RG32F")
    direct._mark_steps((width, 0.0))
    block = np.zeros((_constant(paint, "eye", "VIEW_ROWS"), 4), np.float32)
    block[5, 0], block[10, :2] = width, direct.size
    block[9, 3] = not parallel
    block[12, 3] = min(direct.size)
    size = (parts * columns, parts * height)
    _, target = paint._target(size, "RGBA32F")
    shader = paint._shader("between")
    # Held until they were drawn with.
    glasses, view = (
        paint._uniform(np.zeros((_constant(paint, "description", "ROWS"), 4))),
        paint._uniform(block),
    )
    none = paint._texture(np.zeros((3, 3, 4), np.float32), "RGBA32F")
    with target.bind():
        gpu.state.viewport_set(0, 0, *size)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")
        shader.bind()
        shader.uniform_block("glasses", glasses)
        shader.uniform_block("view", view)
        for name in paint.DESCRIPTIONS["between"]["samplers"]:
            textures = {"depth_tx": direct.depth, "reach_tx": direct._plain}
            shader.uniform_sampler(name, textures.get(name, none))
        shader.uniform_float("parts", float(parts))
        shader.uniform_float("box", paint.WHOLE)
        paint._quad().draw(shader)
        read = np.asarray(target.read_color(0, 0, *size, 4, 0, "FLOAT"))
    read = read.reshape(size[1], size[0], 4)
    return tuple(np.moveaxis(read, 2, 0))


THINGS = """
void main()
{
  vec2 at = texelFetch(origin_tx, ivec2(gl_FragCoord.xy), 0).xy;
  frag = has_depth != 0 ? thing_at(at) : vec4(0.0);
}
"""


def colours_of_things(
    paint, depths: np.ndarray, colours: np.ndarray, width: float, places: np.ndarray
) -> np.ndarray:
    """(rows, columns, 3) colours that a parallel view shows at places, each of one thing.

    ``depths``, ``colours``: (height, width), (height, width, 3) of pixels. ``width``: of a pixel,
    in the depths' unit. ``places``: (rows, columns, 2), in pixels.
    """
    height, columns = depths.shape
    direct = paint.Direct()
    direct.size = (columns, height)
    direct._plain = paint._texture(np.ascontiguousarray(depths, np.float32), "R32F")
    direct._stepped, direct._to_stepped = paint._target(direct.size, "RG32F")
    direct._mark_steps((width, 0.0))
    block = np.zeros((_constant(paint, "eye", "VIEW_ROWS"), 4), np.float32)
    block[5, 0], block[10, :2] = width, direct.size
    shown = np.ones((height, columns, 4), np.float32)
    shown[..., :3] = colours
    origins = np.concatenate((places, np.zeros_like(places[..., :1])), axis=2)
    inputs = {"depth_tx": direct.depth, "direct_tx": paint._texture(shown, "RGBA32F")}
    return _looked_up(paint, THINGS, block, origins, origins, inputs, [])[..., :3]


MARCH = """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 o = texelFetch(origin_tx, pixel, 0).xyz, d = texelFetch(along_tx, pixel, 0).xyz;
  vec2 at;
  float way;
  bool hidden;
  float far = view.start.z;
  bool found = may_meet_any(o, d, far) && march_direct(o, d, far, 0, -1, at, way, hidden);
  frag = vec4(at, way, float(found));
}
"""
NOTHING = 1e20
"""What a capture's face has where it shows no thing."""


SEEN = """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 o = texelFetch(origin_tx, pixel, 0).xyz, d = texelFetch(along_tx, pixel, 0).xyz;
  float way;
  if (!seen(o, d, view.start.z, 0, -1, frag, way)) {
    frag = vec4(0.0);
  }
}
"""


def marched(
    paint, depths: np.ndarray, origins: np.ndarray, directions: np.ndarray, box=None, wall=None
) -> np.ndarray:
    """Where rays meet what a parallel view shows, beside a capture that shows nothing.

    With a ``wall``, so far away, the capture shows that, in red, and the view shows all in green:
    then colours are returned.

    Parameters
    ----------
    depths : (height, width) of pixels, in pixels. origins, directions : (rows, columns, 3), in
        pixels: right, up, away.
    box : (3, 4) from there to where the only thing's box runs from -1 to 1; None: who knows.

    Returns
    -------
    (rows, columns, 4): place in the picture, way, and whether anything is met.
    """
    height, width = depths.shape
    direct = paint.Direct()
    direct.size = (width, height)
    direct.depth = direct._plain = paint._texture(np.ascontiguousarray(depths, np.float32), "R32F")
    direct._stepped, direct._to_stepped = paint._target(direct.size, "RG32F")
    direct._mark_steps((1.0, 0.0))
    tiles = tuple(-(-n // paint.TILE) for n in direct.size)
    tile_tx, to_tiles = paint._target(tiles, "RGBA32F")
    direct._take_tiles(to_tiles, tiles)
    block = np.zeros((_constant(paint, "eye", "VIEW_ROWS"), 4))
    # Column by column.
    block[:4] = np.diag((2.0 / width, 2.0 / height, 1e-4, 1.0))
    block[3, :2] = -1.0
    block[4, 2], block[5, 0] = 1.0, 1.0
    block[10] = width, height, -1e3, 1e4
    block[11, 2] = width + height
    side = 8
    block[12] = 0.0, 0.0, 0.0, side
    faces = _constant(paint, "capture", "FACES") + 1
    reach = np.full((side, faces * side), wall or NOTHING, np.float32)
    inputs = {
        "depth_tx": direct.depth,
        "tile_tx": tile_tx,
        "reach_tx": paint._texture(reach, "R32F"),
    }
    if wall:
        for name, shape, colour in (("direct", depths.shape, 1), ("capture", reach.shape, 0)):
            filled = np.zeros((*shape, 4), np.float32)
            filled[..., colour] = filled[..., 3] = 1.0
            inputs[f"{name}_tx"] = paint._texture(filled, "RGBA32F")
    text, boxes = SEEN if wall else MARCH, [] if box is None else [box]
    return _looked_up(paint, text, block, origins, directions, inputs, boxes)


BEHIND = """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 o = texelFetch(origin_tx, pixel, 0).xyz, d = texelFetch(along_tx, pixel, 0).xyz;
  float way;
  if (!seen(o, d, NOWHERE, 0, -1, frag, way)) {
    frag = beyond(o, d, 0);
  }
}
"""


def behind_a_leaf(
    paint, origins: np.ndarray, directions: np.ndarray, boxes: list[np.ndarray], wall: float = 0.0
) -> np.ndarray:
    """(rows, columns, 4) what rays show that no view sees to their end: green is the world alone.

    A capture at the origin shows a flat leaf at x = 2, where y > 0. ``boxes``: see `marched`.
    ``wall``: x of a blue wall beside the leaf, in Solid shading; 0: there is none.
    """
    side, faces = 8, _constant(paint, "capture", "FACES") + 1
    world = _constant(paint, "eye", "WORLD")
    block = np.zeros((_constant(paint, "eye", "VIEW_ROWS"), 4))
    block[11, 2] = 50.0
    block[12, 3] = block[12 + world, 3] = side
    reach = np.full((2 * side, faces * side), -NOTHING, np.float32)
    reach[:side, side // 2 : side] = 2.0
    colours = np.zeros((*reach.shape, 4), np.float32)
    colours[:side, :, 0] = colours[side:, :, 1] = 1.0
    if wall:
        reach[:side, : side // 2] = wall
        colours[:side, : side // 2] = 0.0, 0.0, 1.0, 0.0
    inputs = {
        "reach_tx": paint._texture(reach, "R32F"),
        "capture_tx": paint._texture(colours, "RGBA32F"),
    }
    return _looked_up(paint, BEHIND, block, origins, directions, inputs, boxes, bool(wall))


def _looked_up(
    paint, text: str, block, origins, directions, inputs: dict, boxes: list, solid: bool = False
):
    """(rows, columns, 4) that a text gives for rays; ``boxes`` of all things, none: who knows."""
    rows, columns, _ = origins.shape
    for name, values in (("origin_tx", origins), ("along_tx", directions)):
        filled = np.ones((rows, columns, 4), np.float32)
        filled[..., :3] = values
        inputs[name] = paint._texture(filled, "RGBA32F")
    glsl = import_module(".glsl", paint.__package__)
    between = paint.DESCRIPTIONS["between"]
    shader = paint.compiled(
        **between
        | {
            "constants": [c for c in between["constants"] if c[1] != "parts"],
            "samplers": [*between["samplers"], "origin_tx", "along_tx"],
            "fragment": f"{glsl.HOOKS}{glsl.SMOOTH}{glsl.FOLLOW}{glsl.LOOKUP}{text}",
        }
    )
    things = np.zeros((_constant(paint, "description", "ROWS"), 4))
    things[0, 2:] = 1, len(boxes) or -1
    things[1 : 1 + 3 * len(boxes)] = np.reshape(boxes, (-1, 4))
    glasses, view = paint._uniform(things), paint._uniform(block)
    none = paint._texture(np.zeros((3, 3, 4), np.float32), "RGBA32F")
    _, target = paint._target((columns, rows), "RGBA32F")
    with paint.filling(target, (columns, rows), shader):
        if solid:
            shader.uniform_float("backdrop", (0.0, 0.0, 0.0, 1.0))
        shader.uniform_block("glasses", glasses)
        shader.uniform_block("view", view)
        if "direct_tx" in inputs:
            shader.uniform_int("has_depth", 1)
        for name in (*between["samplers"], "origin_tx", "along_tx"):
            shader.uniform_sampler(name, inputs.get(name, none))
    with target.bind():
        read = target.read_color(0, 0, columns, rows, 4, 0, "FLOAT")
    return np.asarray(read).reshape(rows, columns, 4)


LAMPS = """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 o = texelFetch(origin_tx, pixel, 0).xyz, d = texelFetch(along_tx, pixel, 0).xyz;
  frag = vec4(lamps(o, d, reach, vec3(1.0)), 1.0);
}
"""


def lamps_light(
    paint, block: np.ndarray, origins: np.ndarray, directions: np.ndarray, reach: float
) -> np.ndarray:
    """(rows, columns, 3) light of lamps along mirrored ways, see `eye.pack_view`."""
    rows, columns, _ = origins.shape
    inputs = {}
    for name, values in (("origin_tx", origins), ("along_tx", directions)):
        filled = np.ones((rows, columns, 4), np.float32)
        filled[..., :3] = values
        inputs[name] = paint._texture(filled, "RGBA32F")
    glsl = import_module(".glsl", paint.__package__)
    shader = paint.compiled(
        constants=[("VEC4", "box"), ("FLOAT", "reach")],
        samplers=list(inputs),
        outputs=["frag"],
        fragment=f"int events = 2; bool by_mirror = true;{glsl.LAMPS_LIGHT}{LAMPS}",
        view=True,
    )
    view = paint._uniform(block)
    _, target = paint._target((columns, rows), "RGBA32F")
    with paint.filling(target, (columns, rows), shader):
        shader.uniform_block("view", view)
        shader.uniform_float("reach", reach)
        for name, texture in inputs.items():
            shader.uniform_sampler(name, texture)
    with target.bind():
        read = target.read_color(0, 0, columns, rows, 4, 0, "FLOAT")
    return np.asarray(read).reshape(rows, columns, 4)[..., :3]
