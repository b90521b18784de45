# SPDX-License-Identifier: GPL-3.0-or-later
"""Exit rays: time a ray by shape, calls of the caster, and hard cases."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import bmesh
import bpy
import numpy as np

from glass_refraction import optics
from glass_refraction.scene.build.own_scenes import new_collection, own_scene, synchronise
from glass_refraction.scene.rays import true
from glass_refraction.scene.rays.caster import Casters, fill_cast_collection
from glass_refraction.scene.rays.meshes import GlassMeshes
from glass_refraction.scene.rays.stage import placed_glasses
from glass_refraction.scene.read.glasses import Glass
from glass_refraction.scene.read.mesh_glasses import MeshGlass, placed_triangles

from .cases import BALL, BOWL, BUBBLE, TUMBLER
from .measure import cpu_seconds, seconds, spread
from .plots import Chart
from .settings import Settings
from .text import table

TITLE = "Exit rays"

EYE = (0.5, 0.02, 0.1)
MIN_WEIGHT = 0.01
"""As a scene's default."""
WALL = -0.3
"""Where a wall across x stands behind the glass, metres: the one thing that rays are cast at."""

_SQUARE = ((-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, 0.05))
_EXTENT = (0.0, 0.12)
SLAB = optics.FlatGlass((0.01,), (1.5,), outline=_SQUARE)
UPRIGHT = np.array(
    (
        (0.0, 0.0, 1.0, 0.0),
        (0.0, 1.0, 0.0, 0.0),
        (-1.0, 0.0, 0.0, 0.06),
        (0.0, 0.0, 0.0, 1.0),
    )
)
"""Pose of a slab that stands, its face towards the eye."""
NEARER = UPRIGHT.copy()
NEARER[0, 3] = 0.1

SHAPES = {
    "slab": ((SLAB, UPRIGHT),),
    "hollow cylinder": ((optics.CylinderGlass((0.04, 0.037), (1.5, 1.0), extent=_EXTENT), None),),
    "filled cylinder": ((optics.CylinderGlass((0.04, 0.037), (1.5, 1.333), extent=_EXTENT), None),),
    "rod": ((optics.CylinderGlass((0.02,), (1.5,), extent=_EXTENT), None),),
    "hollow sphere": ((BUBBLE, None),),
    "ball": ((BALL, None),),
    "tumbler of water": ((TUMBLER, None),),
    "bowl of water": ((BOWL, None),),
    "slab before tumbler": ((SLAB, NEARER), (TUMBLER, None)),
}


@dataclass
class Wall:
    """A caster (``optics.Cast``) that knows one wall and counts what it is asked."""

    calls: int = 0
    rays: int = 0

    def __call__(self, origins: np.ndarray, directions: np.ndarray):
        self.calls += 1
        self.rays += len(origins)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (WALL - origins[:, 0]) / directions[:, 0]
        ahead = way > 0.0
        return np.where(ahead, way, np.inf), np.where(ahead, 0, -1)


def run(settings: Settings) -> dict:
    """All figures of this part."""
    return {
        "shapes": [_shape(settings, place, name) for place, name in enumerate(SHAPES)],
        "meshes": list(_meshes(settings)),
        "hard": [row for case in _hard_cases(settings) for row in _hard(case)],
    }


def placed(parts: Sequence) -> list[optics.PlacedGlass]:
    """Glasses in the world from descriptions and poses (None: the world's own frame)."""
    return [
        optics.PlacedGlass(optics.body(glass), np.eye(4) if pose is None else pose)
        for glass, pose in parts
    ]


def aimed(random: np.random.Generator, count: int, eye=EYE) -> np.ndarray:
    """Directions (count, 3) from an eye towards a box in which the shapes stand."""
    return random.uniform((-0.04, -0.04, 0.0), (0.04, 0.04, 0.1), (count, 3)) - eye


def imbalance(found: optics.ExitRays) -> float:
    """The largest difference from 1 of a ray's light: followed to its end, and lost."""
    total = np.bincount(found.ray, found.weight, len(found.lost)) + found.lost
    return float(np.abs(total - 1.0).max(initial=0.0))


def _shape(settings: Settings, place: int, name: str) -> dict:
    glasses = placed(SHAPES[name])
    count = settings.pick(100, 3_000, 30_000)
    directions = aimed(settings.random(20, place), count)

    def follow(cast=None):
        return optics.exit_rays(glasses, EYE, directions, min_weight=MIN_WEIGHT, cast=cast)

    wall = Wall()
    found = follow(wall)
    return {
        "name": name,
        "rays": count,
        "ways": len(found.ray),
        "met": int(np.unique(found.ray[found.events > 0]).size),
        "steps": found.steps,
        "casts": wall.calls,
        "rays_cast": wall.rays,
        "lost": float(found.lost.mean()),
        "imbalance": imbalance(found),
        "seconds": spread([seconds(follow) for _ in range(settings.pick(1, 2, 3))]),
    }


# --- meshes against closed forms -----------------------------------------------------------------

TRIANGLES = (1_000, 10_000, 100_000)
SIDEWAYS = np.array([(-1.0, 0.0, 0.0)])


def _meshes(settings: Settings) -> Iterator[dict]:
    """A ball as meshes of more and more triangles: CPU time of a ray, and the closed form's."""
    side = settings.pick(10, 140, 320)
    # Row by row, as a picture's: neighbours meet the same boxes of the tree.
    y, z = np.linspace(-0.04, 0.04, side), np.linspace(0.0, 0.08, side)
    directions = np.stack(np.broadcast_arrays(0.0, y, z[:, None]), axis=-1).reshape(-1, 3) - EYE
    count = len(directions)

    def follow(glasses, **named):
        return optics.exit_rays(glasses, EYE, directions, min_weight=MIN_WEIGHT, **named)

    def timed(glasses, **named) -> dict:
        ways = len(follow(glasses, **named).ray)
        repeats = range(settings.pick(1, 2, 3))
        taken = [cpu_seconds(lambda: follow(glasses, **named)) for _ in repeats]
        return {"rays": count, "ways": ways, "seconds": spread(taken)}

    yield {"triangles": 0, "built": 0.0, **timed(placed(SHAPES["ball"]))}
    for triangles in settings.pick(TRIANGLES[:1], TRIANGLES, TRIANGLES):
        mesh = _ball(triangles)
        glass = Glass("Ball", mesh, np.eye(4), CLEAR_MEDIA)

        def build(glass=glass) -> GlassMeshes:
            met = GlassMeshes(_casters().meshes, [glass], NO_SHIFT, 2.0 * BALL.radius[0])
            # The first cast makes the tree of boxes.
            met.meet(np.array([EYE]), SIDEWAYS)
            return met

        built = cpu_seconds(build)
        row = timed(placed_glasses([glass]), meet=build().meet)
        yield {"triangles": len(mesh.points), "built": built, **row}


def _ball(triangles: int) -> MeshGlass:
    """The ball as a mesh of about so many triangles, with its true normals at their corners."""
    rings = round((triangles / 4.0) ** 0.5)
    mesh = bpy.data.meshes.new("Ball")
    ball = bmesh.new()
    bmesh.ops.create_uvsphere(
        ball, u_segments=2 * rings, v_segments=rings + 1, radius=BALL.radius[0]
    )
    ball.to_mesh(mesh)
    ball.free()
    mesh.shade_smooth()
    return MeshGlass(*placed_triangles(mesh, np.eye(4)), BALL.ior[0])


# --- hard cases ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Box:
    """A block of glass: corners (3,), metres; `priority` as of a scene's glass."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    ior: float = 1.5
    priority: int = 0

    def scaled(self, size: float, shift: Sequence[float]) -> Box:
        """The same, `size` times as large, and moved."""
        ends = (tuple(size * np.array(end) + shift) for end in (self.low, self.high))
        return replace(self, **dict(zip(("low", "high"), ends, strict=True)))

    def closed(self) -> optics.PlacedGlass:
        """As a slab with its sides."""
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        middle = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        x, y = 0.5 * (x1 - x0), 0.5 * (y1 - y0)
        pose = np.eye(4)
        pose[:3, 3] = (*middle, z1)
        outline = ((-x, -y), (x, -y), (x, y), (-x, y))
        body = optics.body(optics.FlatGlass((z1 - z0,), (self.ior,), outline=outline))
        return optics.PlacedGlass(body, pose, None, self.priority)

    def triangles(self) -> np.ndarray:
        """(12, 3, 3): corners of its faces' halves, anticlockwise seen from outside."""
        corners = np.array(list(itertools.product(*zip(self.low, self.high, strict=True))))
        faces = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return corners[[(f[0], f[k], f[k + 1]) for f in faces for k in (1, 2)]]


BLOCK = Box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.0))
NO_SHIFT = np.zeros(3)
CLEAR_MEDIA = ((0.0, 0.0, 0.0),) * 2
"""Absorption of the medium around a glass and of its own."""


@dataclass(frozen=True)
class Hard:
    """A hard case of boxes.

    `like`: boxes that it must equal, where they stand `size` times as large and moved by `shift`;
    by default a mesh must equal its own closed form. `broken`: triangles without area are added.
    """

    name: str
    why: str
    boxes: tuple[Box, ...]
    eye: np.ndarray
    directions: np.ndarray
    like: tuple[Box, ...] | None = None
    size: float = 1.0
    shift: np.ndarray = field(default_factory=lambda: NO_SHIFT)
    broken: bool = False

    @property
    def plain_eye(self) -> np.ndarray:
        """The eye before boxes and eye were moved."""
        return (np.asarray(self.eye) - self.shift) / self.size


def _hard_cases(settings: Settings) -> Iterator[Hard]:
    count = settings.pick(60, 1_000, 5_000)
    random = settings.random(22)
    above = np.array((0.0, 0.0, 0.05))
    down = random.uniform((-0.8, -0.8, -1.0), (0.8, 0.8, -0.9), (count, 3))
    one, eye = (BLOCK,), np.array((0.3, 0.1, 0.2))
    rays = random.uniform(BLOCK.low, BLOCK.high, (count, 3)) - eye
    for size in (1e-6, 1e6):
        boxes = (BLOCK.scaled(size, NO_SHIFT),)
        yield Hard(f"block of {0.1 * size:g} m", "scale", boxes, size * eye, rays, one, size)
    for metres, coarse in ((1e3, "0.06"), (1e5, "8")):
        far = metres * np.array((1.0, -1.0, 1.0))
        yield Hard(
            f"{metres:g} m from the origin",
            f"a float32 there is {coarse} mm coarse",
            (BLOCK.scaled(1.0, far),),
            eye + far,
            rays,
            one,
            shift=far,
        )
    grazing = random.uniform((-1.0, -0.1, -2e-4), (-0.9, 0.1, -1e-4), (count, 3))
    yield Hard("at 89.99 degrees", "nearly all is reflected", one, (0.049, 0, 1e-6), grazing)
    turn = random.uniform(0.0, 2.0 * np.pi, count)
    sine = 1.0 / 1.5 + np.resize((1e-7, -1e-7), count)
    aims = np.stack((sine * np.cos(turn), sine * np.sin(turn), -np.sqrt(1.0 - sine**2)), axis=1)
    thin = (replace(BLOCK, ior=1.0 / 1.5),)
    yield Hard(
        "critical angle, 1e-7 to either side",
        "all is reflected, or nearly all",
        thin,
        (0.0, 0.0, 0.02),
        aims,
    )
    rod = Box((-1.0, -0.005, -0.005), (0.0, 0.005, 0.005))
    into = random.uniform((-1.0, -1.0, -1.0), (-0.8, 1.0, 1.0), (count, 3))
    yield Hard("rod of 1 m, 1 cm thick", "chains of total reflection", (rod,), (0.002, 0, 0), into)
    lower = Box((-0.05, -0.05, -0.03), (0.05, 0.05, -0.01))
    thick = Box(lower.low, BLOCK.high)
    yield Hard("two blocks that touch", "faces coincide", (BLOCK, lower), above, down, (thick,))
    gap = replace(lower, high=(0.05, 0.05, -0.01 - 1e-6))
    yield Hard("a gap of 1e-6 m", "two faces nearly one", (BLOCK, gap), above, down)
    yield Hard("triangles without area", "they have no normal", one, above, down, broken=True)
    strong, weak = replace(BLOCK, priority=1), Box(lower.low, (0.05, 0.05, -0.004), 1.333)
    layers = (strong, replace(lower, ior=1.333))
    yield Hard(
        "6 mm of overlap, priorities", "one medium holds", (strong, weak), above, down, layers
    )
    faint = (replace(BLOCK, ior=1.0 + 1e-9),)
    yield Hard("ior 1 + 1e-9", "nothing bends", faint, eye, rays, ())


def _hard(case: Hard) -> Iterator[dict]:
    """Rows of a case: as closed forms, and as meshes by the caster of renders."""
    closed = [box.closed() for box in case.boxes]
    like = None
    if case.like is not None:
        like = optics.exit_rays(
            [box.closed() for box in case.like],
            case.plain_eye,
            case.directions,
            min_weight=MIN_WEIGHT,
        )
    found = optics.exit_rays(closed, case.eye, case.directions, min_weight=MIN_WEIGHT)
    if not case.broken:
        yield _judged(case, "closed form", found, like)
    glasses = [_mesh(box, case.broken) for box in case.boxes]
    glasses = [
        Glass(f"Glass {n}", mesh, np.eye(4), CLEAR_MEDIA, priority=box.priority)
        for n, (mesh, box) in enumerate(zip(glasses, case.boxes, strict=True))
    ]
    low = np.min([b.low for b in case.boxes], axis=0)
    high = np.max([b.high for b in case.boxes], axis=0)
    met = GlassMeshes(
        _casters().meshes, glasses, 0.5 * (low + high), float(np.linalg.norm(high - low))
    )
    as_meshes = optics.exit_rays(
        placed_glasses(glasses), case.eye, case.directions, min_weight=MIN_WEIGHT, meet=met.meet
    )
    yield _judged(case, "mesh", as_meshes, found if like is None else like)


def _mesh(box: Box, broken: bool) -> MeshGlass:
    """The box as renders read it of a mesh."""
    points, middle = box.triangles(), 0.5 * (np.array(box.low) + box.high)
    if broken:
        # Of two equal corners, of three, and three corners in line.
        a, b = points[:, 0], points[:, 1]
        flat = [np.stack(three, axis=1) for three in ((a, b, b), (a, a, a), (a, b, 0.5 * (a + b)))]
        points = np.concatenate((points, *flat))
    mesh = bpy.data.meshes.new("Box")
    faces = np.arange(3 * len(points)).reshape(-1, 3)
    mesh.from_pydata((points - middle).reshape(-1, 3).tolist(), [], faces.tolist())
    to_world = np.eye(4)
    to_world[:3, 3] = middle
    return MeshGlass(*placed_triangles(mesh, to_world), box.ior)


def _casters() -> Casters:
    """Those that renders have, in an own scene of the present file."""
    cast = own_scene(bpy.context.scene, true.CAST)
    if not cast.collection.children:
        fill_cast_collection(new_collection(true.CAST, cast))
    synchronise(cast.view_layers[0])
    return Casters.of(cast)


def _judged(case: Hard, kind: str, found: optics.ExitRays, true_rays) -> dict:
    numbers = (found.weight, found.origin, found.direction, found.lost)
    row = {
        "name": case.name,
        "why": case.why,
        "kind": kind,
        "rays": len(case.directions),
        "ways": len(found.ray),
        "events": int(found.events.max(initial=0)),
        "nonfinite": int(sum((~np.isfinite(part)).sum() for part in numbers)),
        "imbalance": imbalance(found),
        "lost": float(found.lost.mean()),
        "compared": None,
        "turned": None,
        "moved": None,
    }
    if true_rays is not None:
        moved_back = (case.shift, case.size) if case.like is not None else (NO_SHIFT, 1.0)
        row |= _difference(found, true_rays, lambda at: (at - moved_back[0]) / moved_back[1])
    return row


def _difference(
    found: optics.ExitRays, true: optics.ExitRays, back: Callable[[np.ndarray], np.ndarray]
) -> dict:
    """Of rays that split into as many ways in both: how many, and the worst of all their ways.

    `moved` is how far an exit ray passes beside the true one, metres; `turned` in radians.
    """
    count = len(found.lost)
    alike = np.bincount(found.ray, minlength=count) == np.bincount(true.ray, minlength=count)
    one, other = alike[found.ray], alike[true.ray]
    order = np.lexsort((found.weight[one], found.ray[one]))
    order_true = np.lexsort((true.weight[other], true.ray[other]))
    direction = found.direction[one][order]
    true_direction = true.direction[other][order_true]
    shift = back(found.origin[one][order]) - true.origin[other][order_true]
    beside = np.linalg.norm(np.cross(shift, true_direction), axis=1)
    turned = np.linalg.norm(direction - true_direction, axis=1)
    # Ways of equal weight may change places, and a ray may meet an edge: 99 % tell of the others.
    return {
        "compared": float(alike.mean()),
        "turned": float(np.quantile(turned, 0.99)) if len(turned) else 0.0,
        "moved": float(np.quantile(beside, 0.99)) if len(beside) else 0.0,
    }


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    lines = [
        f"Rays from an eye at {EYE} m towards a box in which the glass stands, all ways that carry "
        f"more than {MIN_WEIGHT:.0%} of the light. *Cast calls*: how often the caster is asked in "
        "all, once a step at most; *rays cast*: for each ray followed. *Lost*: light that was not "
        "followed to its end. *Imbalance*: the largest difference from 1 of the light of one ray, "
        "lost light included.",
        "",
    ]
    lines += table(
        (
            "shape",
            "rays",
            "meet glass, %",
            "ways a ray",
            "steps",
            "cast calls",
            "rays cast a ray",
            "µs a ray",
            "µs a way",
            "lost, %",
            "imbalance",
        ),
        [
            (
                row["name"],
                row["rays"],
                100.0 * row["met"] / row["rays"],
                row["ways"] / row["rays"],
                row["steps"],
                row["casts"],
                row["rays_cast"] / row["rays"],
                1e6 * row["seconds"]["median"] / row["rays"],
                1e6 * row["seconds"]["median"] / max(1, row["ways"]),
                100.0 * row["lost"],
                row["imbalance"],
            )
            for row in found["shapes"]
        ],
    )
    closed, *meshes = found["meshes"]
    lines += [
        f"The ball as a mesh with interpolated normals: {closed['rays']} rays of a picture, by the "
        "caster of renders; CPU time of all threads. *Handed over*: the mesh to the caster, once, "
        "with its tree of boxes.",
        "",
    ]
    lines += table(
        ("triangles", "ways a ray", "µs a ray", "over the closed form", "handed over, ms"),
        [
            (
                row["triangles"] or "closed form",
                row["ways"] / row["rays"],
                1e6 * row["seconds"]["median"] / row["rays"],
                row["seconds"]["median"] / closed["seconds"]["median"],
                1e3 * row["built"],
            )
            for row in (closed, *meshes)
        ],
    )
    lines += [
        "Hard cases, each of blocks as closed forms and as meshes by the caster of renders, which "
        "has float32. *Events*: the most of any way. *Compared*: rays that split into as many ways "
        "as in what the case must equal (the plain block, one thick block, layers, no glass; a "
        "mesh else its closed form); *turned*, *moved*: by how much less than 99 % of their exit "
        "rays differ, radians and metres (in the size of the plain case).",
        "",
    ]
    lines += table(
        (
            "tried",
            "hard because",
            "as",
            "rays",
            "ways",
            "events",
            "NaN or infinite",
            "imbalance",
            "lost, %",
            "compared, %",
            "turned",
            "moved",
        ),
        [
            (
                row["name"],
                row["why"],
                row["kind"],
                row["rays"],
                row["ways"],
                row["events"],
                row["nonfinite"],
                row["imbalance"],
                100.0 * row["lost"],
                None if row["compared"] is None else 100.0 * row["compared"],
                row["turned"],
                row["moved"],
            )
            for row in found["hard"]
        ],
    )
    return lines


def charts(found: dict) -> list[Chart]:
    """None: the table says it all."""
    return []
