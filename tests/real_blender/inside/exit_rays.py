# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: exit rays of the live view's shader beside those of ``optics``.

Argument: output folder. For each shape the differences are the result; tests judge them.
"""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector
from mathutils.bvhtree import BVHTree

sys.path.insert(0, str(Path(__file__).parent))
import passes

FOLDER = Path(sys.argv[-1])
NAME = "bl_ext.user_default.refractive_glass.glass_refraction"
ROWS, COLUMNS = 50, 400
FEW_ROWS = {"revolution": 25}
"""As many of them through what the reference is slow in."""
CUT_ROWS, MESH_ROWS = 28, 16
LEAST = 0.01
WAYS = 24

CUT = ("filled", "tumbler", "revolution", "sphere")
NEAR = 1.9
"""Reaches of the glass to the near plane that cuts some: it lies before, in or behind it."""

CHAOTIC = 8
"""Events from which on rounding grows beyond what single precision can tell."""

STAR = np.array(
    [
        (np.cos(0.2 * np.pi * k) / (1 + k % 2), np.sin(0.2 * np.pi * k) / (1 + k % 2))
        for k in range(10)
    ]
)
BESIDE = 1.0
"""How far from an edge a colour is to be its thing's own, pixels: nearer, all pixels round a place
may be mixed."""
_TURN = 2.0 * np.pi * np.arange(45) / 45
ROUND = np.stack((np.cos(_TURN), np.sin(_TURN)), axis=1)
"""Sides in bunches, of which the last one is not whole."""


def shapes(optics):
    """Name: glass."""
    bowl = [(0.0, 0.0), (0.03, 0.004), (0.042, 0.05), (0.035, 0.09)]
    inside = [(0.0, 0.006), (0.026, 0.01), (0.038, 0.05), (0.033, 0.09)]
    return {
        "slab": optics.FlatGlass((0.01,), (1.5,), outline=[(-0.1, -0.1), (0.1, -0.1), (0, 0.15)]),
        "star": optics.FlatGlass((0.02, 0.01), (1.5, 1.7), outline=STAR * 0.1),
        "disc": optics.FlatGlass((0.04, 0.02), (1.5, 1.7), outline=ROUND * 0.1),
        "tank": optics.FlatGlass(
            (0.01,), (1.5,), ior_below=1.333, outline=[(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1)]
        ),
        "cylinder": optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=(0.0, 0.12)),
        "filled": optics.CylinderGlass((0.04, 0.03), (1.5, 1.333), extent=(0.0, 0.12)),
        "rod": optics.CylinderGlass((0.02,), (1.5,), extent=(0.0, 0.1)),
        "sphere": optics.SphereGlass((0.05,), (1.5,)),
        "bowl": optics.SphereGlass((0.15, 0.147), (1.5, 1.333)),
        "tumbler": optics.Tumbler(0.04, 0.003, 0.1, 0.008, 1.5, 1.333, 0.06),
        "empty": optics.Tumbler(0.04, 0.003, 0.1, 0.008),
        "revolution": optics.RevolutionGlass(bowl, inside, 1.5, 1.333, 0.05),
        "lens": optics.RevolutionGlass([(0.0, 0.0), (0.03, 0.006), (0.0, 0.012)], None, 1.6),
    }


def random_rays(body, count, seed):
    """Rays from all round a glass to places in its box: origins and unit directions (N, 3)."""
    random = np.random.default_rng(seed)
    low, high = body.box
    reach = np.linalg.norm(high - low)
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # In a tank nobody stands on the water's side.
    if body.endless != (0, 0) and 0 not in body.endless[1:]:
        away[:, 2] = np.abs(away[:, 2])
    origins = 0.5 * (low + high) + reach * random.uniform(0.8, 3.0, (count, 1)) * away
    targets = low + (high - low) * random.uniform(size=(count, 3))
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def ball(rings, sides, radius=1.0):
    """Triangles (T, 3, 3) of a ball of radius 1, or a part of its size, and its normals."""
    up = np.linspace(0.0, np.pi, rings + 1)[:, None]
    round_ = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[None]
    grid = np.stack(
        np.broadcast_arrays(np.sin(up) * np.cos(round_), np.sin(up) * np.sin(round_), np.cos(up)),
        axis=-1,
    )
    beside = np.roll(grid, -1, axis=1)
    a, b, c, d = grid[:-1], grid[1:], beside[1:], beside[:-1]
    upper = np.stack((a, b, c), axis=2)[1:].reshape(-1, 3, 3)
    lower = np.stack((a, c, d), axis=2)[:-1].reshape(-1, 3, 3)
    normals = np.concatenate((upper, np.stack((a, b, c), axis=2)[:1].reshape(-1, 3, 3)))
    normals = np.concatenate((normals, lower))
    first = np.stack((a, b, c), axis=2)[:1].reshape(-1, 3, 3)
    first[:, 0] = (0.0, 0.0, 1.0)
    return radius * np.concatenate((upper, first, lower)), normals


def flat(points):
    """A mesh's triangles with the normals of its faces."""
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    return points, np.repeat(across[:, None], 3, axis=1)


def meshes(optics):
    """Name: list of (points, normals, ior, priority, perhaps its finish) or (closed form,
    priority), in metres."""
    round_, normals = ball(24, 48)
    tall = round_ * (0.02, 0.02, 0.05)
    squeezed = normals / (0.02, 0.02, 0.05)
    squeezed /= np.linalg.norm(squeezed, axis=2, keepdims=True)
    solid = flat(ball(3, 5, 0.04)[0])
    return {
        "smooth": [(0.04 * round_, normals, 1.5, 0)],
        "painted": [(0.04 * round_, normals, 1.5, 0, colours(round_))],
        "faceted": [(*solid, 1.6, 0)],
        "overlap": [(0.04 * round_, normals, 1.5, 0), (tall, squeezed, 1.333, 1)],
        "inside": [(tall, squeezed, 1.333, 1), (optics.SphereGlass((0.06,), (1.5,)), 0)],
        "small": [(0.04 * round_, normals, 1.333, 0), (optics.SphereGlass((0.01,), (1.5,)), 1)],
    }


def colours(points):
    """A finish that differs from corner to corner (T, 3, 3), see `Paint.at`."""
    finish = np.zeros((*points.shape[:2], 7))
    finish[..., 1:4] = 0.2 + 0.8 * points**2
    # As many steps as the shader has of these.
    finish[..., 4:] = np.round(255.0 * (0.3 + 0.7 * np.abs(points))) / 255.0
    return finish


def meeting(parts):
    """The callback ``meet`` of ``optics.exit_rays`` for (number, points, normals, finish) each."""
    trees = [
        BVHTree.FromPolygons(
            points.reshape(-1, 3).tolist(), np.arange(3 * len(points)).reshape(-1, 3).tolist()
        )
        for _, points, _, _ in parts
    ]

    def meet(origins, directions):
        shape = (len(parts), len(origins))
        glass, way = np.full(shape, -1), np.full(shape, np.inf)
        true, smooth = np.zeros((2, *shape, 3))
        finish = np.ones((*shape, 7))
        finish[..., 0] = 0.0
        for row, (part, tree) in enumerate(zip(parts, trees, strict=True)):
            number, points, normals, painted = part
            rays = zip(origins.tolist(), directions.tolist(), strict=True)
            faces = [tree.ray_cast(*ray)[2] for ray in rays]
            (met,) = np.nonzero([face is not None for face in faces])
            face = np.array([faces[k] for k in met], int)
            # More exactly than the tree's single precision.
            corner, sides = points[face, 0], points[face, 1:] - points[face, :1]
            matrix = np.concatenate((sides, -directions[met, None]), axis=1).transpose(0, 2, 1)
            lies = np.linalg.det(matrix) != 0.0
            met, face, sides = met[lies], face[lies], sides[lies]
            away = (origins[met] - corner[lies])[..., None]
            u, v, t = np.linalg.solve(matrix[lies], away)[..., 0].T
            glass[row, met], way[row, met] = number, t
            true[row, met] = np.cross(sides[:, 0], sides[:, 1])
            smooth[row, met] = np.einsum("ck,kcx->kx", (1.0 - u - v, u, v), normals[face])
            if painted is not None:
                finish[row, met] = np.einsum("ck,kcx->kx", (1.0 - u - v, u, v), painted[face])
        return glass, way, true, smooth, finish

    return meet


def compare_meshes(optics, description, trees, paint, scene, seed):
    """As `compare`, of some glasses of which meshes are."""
    posed, placed, parts = [], [], []
    for number, one in enumerate(scene):
        if len(one) == 2:
            body = optics.body(one[0])
            posed.append(description.Posed(body, np.eye(4), priority=one[1]))
            placed.append(optics.PlacedGlass(body, np.eye(4), priority=one[1]))
            continue
        points, normals, ior, priority, *finish = one
        finish = finish[0] if finish else None
        form = trees.shaped(points, normals, np.eye(3), finish=finish)
        *_, tree = trees.grow(form.points, form.normals, finish=form.finish)
        pose = np.eye(4)
        pose[:3, 3] = form.middle
        body = trees.MeshBody(tree, ior, form.scale, form.half)
        posed.append(description.Posed(body, pose, priority=priority))
        is_painted = finish is not None
        placed.append(optics.PlacedMesh(ior, priority=priority, is_painted=is_painted))
        parts.append((number, points, normals, finish))
    return differences(
        optics, description, paint, posed, placed, seed, MESH_ROWS, meet=meeting(parts)
    )


ROUGH = (0.1, 0.3)


def compare_rough(optics, description, trees, paint):
    """By roughness: mean square of the sine by which a pane turns light that it lets through, as
    shader and NumPy find it. Each pixel's sample has facets of its own."""
    found = {}
    corners = 0.5 * np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    corners *= (1.0, 1.0, 0.1)
    quads = (0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)
    points, normals = flat(
        np.array([corners[[q[0], q[k], q[k + 1]]] for q in quads for k in (1, 2)])
    )
    form = trees.shaped(points, normals, np.eye(3))
    *_, tree = trees.grow(form.points, form.normals)
    origins = np.zeros((MESH_ROWS, COLUMNS, 3))
    origins[..., :2] = np.random.default_rng(8).uniform(-0.2, 0.2, (MESH_ROWS, COLUMNS, 2))
    origins[..., 2] = 0.4
    down = np.broadcast_to((0.0, 0.0, -1.0), origins.shape)
    for roughness in ROUGH:
        body = trees.MeshBody(tree, 1.5, form.scale, form.half, roughness=roughness)
        posed = [description.Posed(body, np.eye(4))]
        frame = description.common_frame(posed)
        places, alongs = passes.exit_rays(
            paint,
            description.pack(posed, frame),
            frame.place(origins.reshape(-1, 3)).reshape(origins.shape),
            down,
            LEAST,
            WAYS,
            description.trees_of(posed),
        )
        weight, z = places[..., 3].ravel(), alongs[..., 2].ravel()
        seen = [_turned(weight, z)]
        ends = optics.exit_rays(
            [optics.PlacedMesh(1.5, roughness=roughness)],
            origins.reshape(-1, 3),
            down.reshape(-1, 3),
            min_weight=LEAST,
            meet=meeting([(0, points, normals, None)]),
        )
        found[roughness] = [*seen, _turned(ends.weight, ends.direction[:, 2])]
    return found


def _turned(weight, z):
    through = z < 0.0
    return float((weight * (1.0 - z**2))[through].sum() / weight[through].sum())


def compare(optics, description, paint, glass, seed, rows, unseen=0.0):
    """Shares of all light in ways that agree, and how exactly.

    ``unseen``: how far rays run before they can be bent, in reaches of the glass.
    """
    body = optics.body(glass)
    posed = [description.Posed(body, np.eye(4))]
    placed = [optics.PlacedGlass(body, np.eye(4))]
    return differences(optics, description, paint, posed, placed, seed, rows, unseen=unseen)


def differences(optics, description, paint, posed, placed, seed, rows, meet=None, unseen=0.0):
    frame = description.common_frame(posed)
    block = description.pack(posed, frame)
    largest = max((glass.body for glass in posed), key=lambda body: body.scale)
    origins, directions = random_rays(largest, rows * COLUMNS, seed)
    outside = largest.medium_at(origins) == 0
    skipped = unseen * np.linalg.norm(np.diff(largest.box, axis=0))
    shape = (rows, COLUMNS, 3)
    began = time.perf_counter()
    places, alongs = passes.exit_rays(
        paint,
        block,
        frame.place(origins).reshape(shape),
        directions.reshape(shape),
        LEAST,
        WAYS,
        description.trees_of(posed),
        skipped / frame.unit,
    )
    seconds = time.perf_counter() - began
    places, alongs = (v.reshape(WAYS, -1, 4).astype(float) for v in (places, alongs))
    begins = origins + skipped * directions
    ends = optics.exit_rays(placed, begins, directions, min_weight=LEAST, meet=meet)
    met = (ends.events > 0) & outside[ends.ray]
    ray, weight, events = ends.ray[met], ends.weight[met], ends.events[met]
    origin, direction = ends.origin[met], ends.direction[met]
    # The way of the shader that is nearest: in direction, and in weight where directions agree.
    off = np.linalg.norm(alongs[:, ray, :3] - direction, axis=2)
    change = np.abs(places[:, ray, 3] - weight)
    dimmed = np.abs(alongs[:, ray, 3] - np.exp(-ends.depth[met, 1]))
    missing = places[:, ray, 3] == 0.0
    apart = np.where(missing, 9.0, off + change)
    best = apart.argmin(axis=0)
    each = np.arange(len(ray))
    angle = np.where(apart[best, each] < 9.0, off[best, each], 9.0)
    shift = origin - (frame.origin + frame.unit * places[best, ray, :3])
    across = np.linalg.norm(np.cross(shift, direction), axis=1) / largest.scale
    return {
        "rays": len(np.unique(ray)),
        "ways": len(ray),
        "ways_of_shader": int((places[:, outside, 3] > 0.0).sum()),
        "off": float((angle > 1e-4).mean()),
        "off_short": float((angle > 1e-4)[events < CHAOTIC].mean()),
        "light_off": float(weight[angle > 1e-4].sum() / weight.sum()),
        "median": float(np.median(angle)),
        "weight_off": float((change[best, each] > 1e-3)[angle <= 1e-4].mean()),
        "dimmed_off": float((dimmed[best, each] > 1e-3)[angle <= 1e-4].mean()),
        "shift_off": float((across > 1e-4)[angle <= 1e-4].mean()),
        "seconds": seconds,
    }


def compare_tiles(paint):
    """By how much nearest and farthest depths of tiles are off."""
    worst = 0.0
    for height, width in ((64, 80), (61, 83), (5, 3)):
        values = np.random.default_rng(height).uniform(0.0, 0.99, (height, width))
        tiles = passes.tiles_of(paint, values)
        for row, column in np.ndindex(tiles.shape[:2]):
            part = values[8 * row : 8 * row + 8, 8 * column : 8 * column + 8]
            worst = max(worst, np.abs(tiles[row, column] - (part.min(), part.max())).max())
    return float(worst)


def compare_amended(paint):
    """Part of depths that are off once what EEVEE adds to them was taken off again, and before.

    Of two discs before a tilted plane: values end at 1 beside the nearer one.
    """
    rows, columns = 96, 128
    y, x = np.mgrid[:rows, :columns] + 0.5
    values = 0.9 + 1e-4 * x - 2e-4 * y
    values[np.hypot(x - 40.3, y - 47.8) < 31.0] = 0.7
    values[np.hypot(x - 95.6, y - 40.2) < 21.0] = 0.82
    blocks = values.reshape(rows // 2, 2, columns // 2, 2)
    changes = np.abs(np.diff(blocks, axis=1)) + np.abs(np.diff(blocks, axis=3))
    amended = np.minimum(blocks + changes, 1.0).reshape(rows, columns)
    found = passes.plain_values(paint, amended)
    return [float((np.abs(v - values) > 1e-3).mean()) for v in (found, amended)]


PARTS = 8
"""Places a side of a pixel at which depths are asked for."""


def straight_edges(paint):
    """By how many pixels a half-plane's edge is off in a view and in a capture, by its angle."""
    worst = {}
    rows = columns = 60
    y, x = np.mgrid[:rows, :columns] + 0.5
    for degrees in (3, 12, 27, 45, 63, 78, 87):
        normal = np.array((np.cos(np.radians(degrees)), np.sin(np.radians(degrees))))
        place = (x - 30.3) * normal[0] + (y - 24.1) * normal[1]
        found = passes.depths_between(paint, np.where(place < 0.0, 5.0, 9.0), 0.01, PARTS)
        v, u = (np.mgrid[: PARTS * rows, : PARTS * columns] + 0.5) / PARTS
        apart = (u - 30.3) * normal[0] + (v - 24.1) * normal[1]
        # Beyond the picture's own edge nothing votes.
        inside = np.s_[PARTS:-PARTS, PARTS:-PARTS]
        wrong = [((found[k] < 7.0) != (apart < 0.0))[inside] for k in (0, 3)]
        apart = np.abs(apart[inside])
        worst[degrees] = [float(apart[one].max(initial=0.0)) for one in wrong]
    return worst


def colours_beside_edges(paint):
    """The most by which a colour is off its thing's own, beside an edge whose pixels are mixed."""
    worst, parts = 0.0, 8
    y, x = np.mgrid[:60, :60] + 0.5
    fine = (np.mgrid[: 60 * parts, : 60 * parts] + 0.5) / parts
    random = np.random.default_rng(3)
    places = random.uniform(10.0, 50.0, (40, 50, 2))
    for degrees in (3, 12, 27, 45, 63, 78, 87):
        normal = np.array((np.cos(np.radians(degrees)), np.sin(np.radians(degrees))))

        def apart(x, y, normal=normal):
            return (x - 30.3) * normal[0] + (y - 24.1) * normal[1]

        is_near = (apart(fine[1], fine[0]) < 0.0).reshape(60, parts, 60, parts)
        near = is_near.mean(axis=(1, 3))[..., None]
        colours = near * (0.9, 0.1, 0.2) + (1.0 - near) * (0.1, 0.6, 0.4)
        depths = np.where(apart(x, y) < 0.0, 5.0, 9.0)
        found = passes.colours_of_things(paint, depths, colours, 0.01, places)
        off = apart(places[..., 0], places[..., 1])[..., None]
        wanted = np.where(off < 0.0, (0.9, 0.1, 0.2), (0.1, 0.6, 0.4))
        worst = max(worst, float(np.abs(found - wanted)[np.abs(off[..., 0]) > BESIDE].max()))
    return worst


def edges_of_rods(paint):
    """By what part of its radius the depth is off that the edge of a round rod is said to have."""
    worst = 0.0
    radius, width = 20.0, 0.01
    for shift in np.linspace(0.0, 1.0, 7):
        x = np.arange(80) + 0.5 - (40.0 + shift)
        deep = 6.0 - width * np.sqrt(np.maximum(radius**2 - x**2, 0.0))
        row = np.where(np.abs(x) < radius, deep, 9.0)
        _, limbs, *_ = passes.depths_between(paint, np.tile(row, (9, 1)), width, PARTS)
        first = int(np.argmax(np.abs(x) < radius))
        found = limbs[4 * PARTS + PARTS // 2, (first + 1) * PARTS : (first + 2) * PARTS]
        worst = max(worst, float(np.abs(found - 6.0).max()) / (width * radius))
    return worst


def met_before_edges(paint):
    """Parts of rays that are met: of those that hit a ball before its edge, and that pass it."""
    size, radius, deep = 96, 20.0, 60.0
    y, x = np.mgrid[:size, :size] + 0.5
    rise = radius**2 - (x - 48.3) ** 2 - (y - 47.6) ** 2
    depths = np.where(rise > 0.0, deep - np.sqrt(np.maximum(rise, 0.0)), 200.0)
    random = np.random.default_rng(0)
    turn, off = random.uniform((0.0, -1.5), (2.0 * np.pi, 1.5), (50, 40, 2)).transpose(2, 0, 1)
    # How deep an edge lies is known to a tenth of the radius.
    before = random.uniform(0.1 * radius, radius - 2.0, (50, 40))
    along = np.stack((np.cos(turn), np.sin(turn), 0.0 * turn), axis=-1)
    across = np.stack((-np.sin(turn), np.cos(turn), 0.0 * turn), axis=-1)
    nearest = np.array((48.3, 47.6, deep)) + (off * radius)[..., None] * across
    nearest[..., 2] -= before
    found = passes.marched(paint, depths, nearest - 30.0 * along, along)[..., 3] > 0.5
    half = np.sqrt(radius**2 - before**2)
    hits = np.abs(off * radius) < half - 1.0
    misses = np.abs(off * radius) > radius + 1.0
    return [float(found[kind].mean()) for kind in (hits, misses)]


def met_on_a_table(paint):
    """Part of rays that meet a table on which they begin, or just behind its flat box."""
    size, deep = 96, 60.0
    random = np.random.default_rng(2)
    origins = random.uniform(20.0, 76.0, (20, 30, 3))
    origins[..., 2] = deep + random.choice((-1e-4, 0.0, 1e-4), (20, 30))
    along = random.normal(0.0, 1.0, origins.shape)
    along[..., 2] = 0.5 + np.abs(along[..., 2])
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    box = np.diag((1 / 48.0, 1 / 48.0, 1e5, 0.0))[:3]
    box[:, 3] = -1.0, -1.0, -1e5 * deep
    found = passes.marched(paint, np.full((size, size), deep), origins, along, box)
    return float((found[..., 3] > 0.5).mean())


def seen_behind_a_post(paint):
    """Part of rays that go behind a post and show a wall as the view does, where a capture shows it
    too, a little nearer.
    """
    depths = np.full((96, 96), 60.0)
    depths[:, 40:48] = 30.0
    random = np.random.default_rng(4)
    origins = random.uniform((20.0, 20.0, 40.0), (30.0, 55.0, 50.0), (20, 30, 3))
    along = random.uniform((52.0, 20.0, 60.0), (58.0, 55.0, 60.0), origins.shape) - origins
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    shown = passes.marched(paint, depths, origins, along, wall=59.9)
    return float((shown[..., 1] > 0.9).mean())


def world_behind_a_leaf(paint):
    """Parts of rays that show the world, of those that go behind a leaf: with a box before it, and
    with one there. And parts that show the wall that is seen beside it, which stands there.
    """
    random = np.random.default_rng(3)
    origins, through = np.ones((2, 20, 30, 3))
    origins[..., 1:] = random.uniform((-1.5, -0.5), (-0.6, 0.5), (20, 30, 2))
    through[..., 0] = 2.0
    through[..., 1:] = random.uniform((-0.4, -0.5), (-0.1, 0.5), (20, 30, 2))
    along = through - origins
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    leaf = np.array(((1e6, 0, 0, -2e6), (0, 1, 0, -1), (0, 0, 0.5, 0)))
    before = np.array(((5, 0, 0, -7), (0, 0.1, 0, 0), (0, 0, 0.1, 0)))
    there = np.array(((0.1, 0, 0, -1.3), (0, 0.1, 0, -0.5), (0, 0, 0.1, 0)))
    shown = (passes.behind_a_leaf(paint, origins, along, [leaf, box]) for box in (before, there))
    wall = np.array(((1e6, 0, 0, -4e6), (0, 0.01, 0, 0), (0, 0, 0.01, 0)))
    beside = passes.behind_a_leaf(paint, origins, along, [leaf, wall], 4.0)
    return [float((one[..., 1] > 0.9).mean()) for one in shown] + [
        float((beside[..., 2] > 0.9).mean())
    ]


def nearest_edges(paint):
    """Depths that are drawn where an edge lies before another, whichever comes first."""
    wires = __import__("importlib").import_module(f"{paint.__package__}.wires")
    mesh = bpy.data.meshes.new("Edge")
    mesh.from_pydata([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(0, 1)], [])
    drawn, found = wires.Wires(), []
    drawn._batches = {0: ((), wires._batch(mesh))}
    for places in ((-0.5, 0.5), (0.5, -0.5)):
        drawn._poses = {0: [np.array(Matrix.Translation((0, 0, z))) for z in places]}
        values = np.array(drawn.draw(np.eye(4), (17, 17)).read().to_list())
        found.append(float(values.reshape(17, 17)[8, 8]))
    return found


def planes(paint):
    """By what part depths between pixels are off on a plane, seen from an eye and in parallel."""
    rows, columns = 20, 30
    v, u = (np.mgrid[: PARTS * rows, : PARTS * columns] + 0.5) / PARTS
    y, x = np.mgrid[:rows, :columns] + 0.5
    worst = {}
    # The farther rows rise towards the horizon of a table.
    depths = {
        "eye": lambda x, y: 1.0 / (0.12 + 0.0004 * x - 0.0006 * y),
        "parallel": lambda x, y: 5.0 + 0.03 * x - 0.02 * y,
    }
    for view, depth in depths.items():
        parallel = view == "parallel"
        # No slope is taken for an edge.
        _, _, found, _ = passes.depths_between(paint, depth(x, y), 0.1, PARTS, parallel=parallel)
        inside = np.s_[PARTS:-PARTS, PARTS:-PARTS]
        worst[view] = float(np.abs(found / depth(u, v) - 1.0)[inside].max())
    return worst


LAMPS = (
    ("AREA", {"shape": "RECTANGLE", "size": 0.8, "size_y": 0.5}, "BLENDER_EEVEE"),
    ("AREA", {"shape": "ELLIPSE", "size": 0.8, "size_y": 0.5, "spread": 2.0}, "CYCLES"),
    ("POINT", {"shadow_soft_size": 0.4}, "BLENDER_EEVEE"),
    ("SPOT", {"shadow_soft_size": 0.4, "spot_size": 1.5, "spot_blend": 0.6}, "BLENDER_EEVEE"),
)


def compare_lamps(root, paint):
    """Of each lamp the part of the light that is off, along rays that meet its triangles."""
    view_lamps, eye, description, rays = (
        __import__("importlib").import_module(f"{root.__name__}.{name}")
        for name in ("viewport.lamps", "viewport.eye", "viewport.description", "scene.rays.lamps")
    )
    frame = description.Frame(np.array((0.1, -0.2, 0.3)), 0.5, 4.0)
    random = np.random.default_rng(1)
    pose = Matrix.LocRotScale((0.4, 0.3, 0.2), Euler((0.3, 2.0, -0.4)), (1.0, 1.3, 1.0))
    worst = {}
    for kind, settings, engine in LAMPS:
        light = bpy.data.lights.new(kind, kind)
        light.energy, light.color, light.specular_factor = 7.0, (1.0, 0.6, 0.3), 0.5
        for name, value in settings.items():
            setattr(light, name, value)
        lamps = view_lamps.Lamps()
        lamps.bodies = [rays.lamp_body(light, np.array(pose), engine)]
        points, corners, look = rays.lamp_shape(light, np.array(pose), engine)
        tree = BVHTree.FromPolygons(points.tolist(), corners.tolist())
        starts = random.normal(0.0, 1.5, (20, 50, 3))
        aims = np.array(pose.translation) + random.normal(0.0, 0.3, starts.shape)
        along = aims - starts
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        packed = lamps.packed(frame)
        block = np.zeros((eye.VIEW_ROWS, 4))
        block[5], block[11, 3] = eye.NO_LIMIT, 1.0
        block[12 + 4 * (eye.WORLD + 1) :][: len(packed)] = packed
        found = passes.lamps_light(paint, block, frame.place(starts), along, 1e9).reshape(-1, 3)
        wanted = np.zeros_like(found)
        rays_of = zip(starts.reshape(-1, 3), along.reshape(-1, 3), strict=True)
        for k, (start, way) in enumerate(rays_of):
            place, normal, *_ = tree.ray_cast(Vector(start), Vector(way))
            if place is not None:
                part = look.lights(np.array(normal)[None], way[None])
                wanted[k] = part * look.factors[1] * np.array(look.radiance)
        worst[f"{kind} {engine}"] = float(np.abs(found - wanted).sum() / wanted.sum())
    return worst


def run():
    result = {}
    try:
        root = __import__("importlib").import_module(NAME)
        optics = __import__("importlib").import_module(f"{root.__name__}.optics")
        description = __import__("importlib").import_module(f"{root.__name__}.viewport.description")
        paint = __import__("importlib").import_module(f"{root.__name__}.viewport.paint")
        trees = __import__("importlib").import_module(f"{root.__name__}.viewport.trees")
        result["tiles"] = compare_tiles(paint)
        result["beside"] = colours_beside_edges(paint)
        result["straight"], result["rods"] = straight_edges(paint), edges_of_rods(paint)
        result["planes"] = planes(paint)
        result["met"], result["on"] = met_before_edges(paint), met_on_a_table(paint)
        result["post"] = seen_behind_a_post(paint)
        result["world"] = world_behind_a_leaf(paint)
        result["edges"] = nearest_edges(paint)
        result["amended"] = compare_amended(paint)
        result["lamps"] = compare_lamps(root, paint)
        print("exit_rays:", result, flush=True)
        result["rough"] = compare_rough(optics, description, trees, paint)
        print("exit_rays: rough", result["rough"], flush=True)
        for seed, (name, glass) in enumerate(shapes(optics).items()):
            rows = FEW_ROWS.get(name, ROWS)
            result[name] = compare(optics, description, paint, glass, seed, rows)
            print("exit_rays:", name, json.dumps(result[name]), flush=True)
        for name in CUT:
            glass = shapes(optics)[name]
            cut = compare(optics, description, paint, glass, 0, CUT_ROWS, unseen=NEAR)
            result[f"{name}, cut"] = cut
            print("exit_rays:", name, json.dumps(result[f"{name}, cut"]), flush=True)
        for seed, (name, scene) in enumerate(meshes(optics).items()):
            result[name] = compare_meshes(optics, description, trees, paint, scene, seed)
            print("exit_rays:", name, json.dumps(result[name]), flush=True)
        (FOLDER / "result.json").write_text(json.dumps(result))
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()


bpy.app.timers.register(run, first_interval=1.0, persistent=True)
