# SPDX-License-Identifier: GPL-3.0-or-later
"""Exit rays: time a ray by shape, calls of the caster, and hard cases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from glass_refraction import optics

from .cases import BALL, BOWL, BUBBLE, TUMBLER
from .measure import seconds, spread
from .plots import Chart
from .settings import Settings
from .text import number, table

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
        "hard": [_hard(settings, place, *case) for place, case in enumerate(_hard_cases(settings))],
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


# --- hard cases ----------------------------------------------------------------------------------


def _tumbler(size: float, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> list[optics.PlacedGlass]:
    """The tumbler of water, `size` times as large, elsewhere."""
    pose = np.eye(4)
    pose[:3, 3] = origin
    glass = optics.Tumbler(size * 0.040, size * 0.003, size * 0.12, size * 0.008, level=size * 0.07)
    return placed([(glass, pose)])


def _hard_cases(settings: Settings) -> Iterator[tuple]:
    """Name, why it is hard, glasses, eye, directions, and what it must equal (or None).

    The last is glasses, eye, the scale of lengths and the shift of places.
    """
    count = settings.pick(100, 2_000, 20_000)
    rays = aimed(settings.random(21), count)
    plain, eye = _tumbler(1.0), np.array(EYE)
    for size in (1e-6, 1e6):
        yield (
            f"tumbler of {0.04 * size:g} m",
            "scale",
            _tumbler(size),
            size * eye,
            rays,
            (plain, eye, size, 0.0),
        )
    far = np.array((1e5, -1e5, 1e5))
    yield (
        "1e5 m from the origin",
        "seven digits lost before the start",
        _tumbler(1.0, far),
        eye + far,
        rays,
        (plain, eye, 1.0, far),
    )
    slab = placed([(SLAB, None)])
    random = settings.random(22)
    grazing = random.uniform((-1.0, -0.1, -1e-4), (-0.9, 0.1, 0.0), (count, 3))
    yield "slab at 89.99 degrees", "nearly all is reflected", slab, (0.3, 0.0, 1e-5), grazing, None
    below = np.eye(4)
    below[2, 3] = -0.01
    two = placed([(SLAB, None), (SLAB, below)])
    thick = placed([(optics.FlatGlass((0.02,), (1.5,), outline=_SQUARE), None)])
    down = random.uniform((-0.3, -0.3, -1.0), (0.3, 0.3, -0.9), (count, 3))
    yield (
        "two slabs that touch",
        "faces coincide: one thick slab",
        two,
        (0.0, 0.0, 0.05),
        down,
        (thick, np.array((0.0, 0.0, 0.05)), 1.0, 0.0),
    )
    faint = optics.SphereGlass((0.04,), (1.0 + 1e-9,))
    yield (
        "ball of ior 1 + 1e-9",
        "nothing bends",
        placed([(faint, None)]),
        EYE,
        rays,
        ([], eye, 1.0, 0.0),
    )


def _hard(settings: Settings, place: int, name, why, glasses, eye, directions, same) -> dict:
    found = optics.exit_rays(glasses, eye, directions, min_weight=MIN_WEIGHT)
    numbers = (found.weight, found.origin, found.direction, found.lost)
    row = {
        "name": name,
        "why": why,
        "rays": len(directions),
        "ways": len(found.ray),
        "nonfinite": int(sum((~np.isfinite(part)).sum() for part in numbers)),
        "imbalance": imbalance(found),
        "compared": None,
        "turned": None,
        "moved": None,
    }
    if same is not None:
        others, other_eye, size, shift = same
        true = optics.exit_rays(others, other_eye, directions, min_weight=MIN_WEIGHT)
        row |= _difference(found, true, lambda place: (place - shift) / size)
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
    # Ways of equal weight may change places: the median cannot be fooled by these.
    return {
        "compared": float(alike.mean()),
        "turned": float(np.median(turned)) if len(turned) else 0.0,
        "moved": float(np.median(beside)) if len(beside) else 0.0,
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
    lines += [
        "Hard cases. *Compared*: rays that split into as many ways as in the case that this one "
        "must equal; *turned*, *moved*: median difference of their exit rays, radians and metres "
        "(in the size of the plain case).",
        "",
    ]
    lines += table(
        (
            "tried",
            "hard because",
            "rays",
            "ways",
            "NaN or infinite",
            "imbalance",
            "compared, %",
            "turned",
            "moved",
        ),
        [
            (
                row["name"],
                row["why"],
                row["rays"],
                row["ways"],
                row["nonfinite"],
                row["imbalance"],
                None if row["compared"] is None else 100.0 * row["compared"],
                row["turned"],
                row["moved"],
            )
            for row in found["hard"]
        ],
    )
    fastest = min(found["shapes"], key=lambda row: row["seconds"]["median"] / row["rays"])
    lines += [
        f"The least is {number(1e6 * fastest['seconds']['median'] / fastest['rays'])} µs a ray "
        f"({fastest['name']}).",
        "",
    ]
    return lines


def charts(found: dict) -> list[Chart]:
    """None: the table says it all."""
    return []
