# SPDX-License-Identifier: GPL-3.0-or-later
"""Hard cases, by name: what was tried, how many images held, the largest error, and why."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from glass_refraction import optics
from glass_refraction.optics.glasses import Glass

from .cases import BALL, FILLED, HOLLOW, SLAB
from .forward import FOCAL_PX, Checked, check, direction_errors
from .plots import Chart
from .settings import Settings
from .text import number, table

TITLE = "Stability"

ASKED_PX = 1e-6
"""What images of ordinary cases must reach."""
SIDE = np.array([0.5, 0.02, 0.1])
ABOVE = np.array([0.05, 0.0, 0.3])
FOLD_GAPS = (1e-3, 1e-6, 1e-9, 1e-12)


@dataclass(frozen=True)
class Trial:
    """A glass, a path, an eye and points, and where the result is held against something else.

    Attributes
    ----------
    compare : takes the result and returns errors in pixels, one an image, beside the trace's.
    """

    glass: Glass
    path: str
    eye: np.ndarray
    points: np.ndarray
    compare: Callable[[optics.ApparentPoints], np.ndarray] | None = None


def run(settings: Settings) -> dict:
    """All figures of this part."""
    rows = []
    for place, (name, why, trials) in enumerate(_groups()):
        random = settings.random(9, place)
        rows.append(_row(name, why, trials(settings, random)))
    return {"rows": rows, "random": _random_cases(settings)}


def _row(name: str, why: str, trials: Iterator[Trial]) -> dict:
    points = images = held = traced = disturbed = 0
    worst = condition = 0.0
    compared: float | None = None
    for trial in trials:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            found = optics.apparent_points(trial.glass, trial.path, trial.eye, trial.points)
        numbers = (found.direction, found.distance, found.position, found.residual)
        disturbed += len(warned) + sum(int((~np.isfinite(n)).sum()) for n in numbers)
        points += len(trial.points)
        if trial.compare is not None:
            compared = max(compared or 0.0, float(trial.compare(found).max(initial=0.0)))
        if isinstance(trial.eye, optics.ParallelView):
            continue
        checked = check(trial.glass, trial.path, trial.eye, trial.points, found)
        images, held = images + checked.images, held + checked.held
        traced += len(checked.errors_px)
        worst = max(worst, checked.worst_px)
        condition = max(condition, _condition(trial, found))
    return {
        "name": name,
        "why": why,
        "points": points,
        "images": images,
        "held": held,
        "traced": traced,
        "worst_px": worst,
        "compared_px": compared,
        "condition": condition,
        "warnings_and_nonfinite": disturbed,
    }


def _condition(trial: Trial, found: optics.ApparentPoints) -> float:
    """Largest relative condition of the images: how much an image turns, as an angle, when its
    point moves across the ray by so much of its distance. 1 without glass, infinite on a caustic.
    """
    finite = np.isfinite(trial.points).all(axis=1)
    points = trial.points[finite]
    if not len(points):
        return 0.0
    size = 1e-9
    away = np.linalg.norm(points - trial.eye, axis=1)
    largest = 0.0
    for axis in np.eye(3):
        moved = points + (size * away)[:, None] * axis
        again = optics.apparent_points(trial.glass, trial.path, trial.eye, moved)
        whole = replace_points(found, finite)
        errors, _ = direction_errors(again, whole)
        largest = max(largest, float(errors.max(initial=0.0)) / FOCAL_PX / size)
    return largest


def replace_points(found: optics.ApparentPoints, which: np.ndarray) -> optics.ApparentPoints:
    """A result for some of its points only."""
    columns = {
        name: getattr(found, name)[:, which]
        for name in ("direction", "distance", "position", "valid", "residual")
    }
    return replace(found, **columns)


# --- the cases -----------------------------------------------------------------------------------


def _groups():
    """(what was tried, why it is hard, trials) of every row."""
    return (
        ("ior equal on both sides", "must be the identity", _equal_media),
        ("ior 1 + 1e-9", "nothing bends, differences vanish", partial(_iors, ior=1 + 1e-9)),
        ("ior 2.417 (diamond)", "critical angle at 24 degrees", partial(_iors, ior=2.417)),
        ("wall of 1e-6 R", "radii differ in the seventh digit", _thin_wall),
        ("rays at 89.99 degrees", "radial momenta vanish: 1/w terms", _grazing),
        ("eye 1e-6 m before the glass", "eye and face nearly one", _near_eye),
        ("eye on the axis, in the cavity", "no azimuth", _inner_eye),
        ("point on the axis", "no azimuth", _axis_points),
        ("point on an interface", "end of a stretch", _interface_points),
        ("point at 1e6 m", "images of millions of glass sizes", _far_points),
        ("glass of 1e-6 m", "scale", partial(_scaled, size=1e-6)),
        ("glass of 1e6 m", "scale", partial(_scaled, size=1e6)),
        ("1e5 m from the origin", "seven digits lost before the start", _far_from_origin),
        ("critical angle, 1e-12 to either side", "image there or not", _critical),
        *(
            (
                f"{gap:g} m to either side of a caustic",
                "two images meet",
                lambda s, r, g=gap: _fold(s, r, g),
            )
            for gap in FOLD_GAPS
        ),
        ("parallel view against an eye at 1e6 m", "a limit of the other equations", _parallel),
        ("NaN and infinite points among good ones", "must disturb none", _broken),
        ("0 points, 1 point", "no reduction over nothing", _few),
    )


def _cloud(settings, random, centre=(-0.12, 0.0, 0.0), half=0.04) -> np.ndarray:
    count = settings.pick(50, 500, 5000)
    return random.uniform(-half, half, (count, 3)) + np.asarray(centre)


def _standard(settings, random):
    """The shapes that most rows go through."""
    yield HOLLOW, "TTTT", SIDE, _cloud(settings, random)
    yield FILLED, "TTTT", SIDE, _cloud(settings, random)
    yield BALL, "TT", SIDE, _cloud(settings, random)
    yield SLAB, "TT", ABOVE, _cloud(settings, random, (0.0, 0.0, -0.2), 0.1)


def _equal_media(settings, random):
    for glass, path, eye in (
        (optics.CylinderGlass((0.04, 0.037), (1.0, 1.0)), "TTTT", SIDE),
        (optics.SphereGlass((0.04, 0.037), (1.0, 1.0)), "TTTT", SIDE),
        (optics.CylinderGlass((0.04,), (1.333,), ior_outside=1.333), "TT", SIDE),
        (optics.FlatGlass((0.01, 0.02), (1.0, 1.0)), "TTT", ABOVE),
    ):
        flat = isinstance(glass, optics.FlatGlass)
        points = _cloud(settings, random, (0.0, 0.0, -0.2) if flat else (-0.1, 0.0, 0.0), 0.02)
        direct = points - eye
        direct /= np.linalg.norm(direct, axis=1, keepdims=True)

        def compare(found, direct=direct):
            off = np.linalg.norm(found.direction - direct, axis=2)
            return FOCAL_PX * off[found.valid]

        yield Trial(glass, path, eye, points, compare)


def _iors(settings, random, ior):
    for shape in (optics.CylinderGlass, optics.SphereGlass):
        yield Trial(shape((0.04, 0.037), (ior, 1.0)), "TTTT", SIDE, _cloud(settings, random))
        yield Trial(shape((0.04,), (ior,)), "TT", SIDE, _cloud(settings, random))
    below = _cloud(settings, random, (0.0, 0.0, -0.2))
    yield Trial(optics.FlatGlass((0.01,), (ior,)), "TT", ABOVE, below)


def _thin_wall(settings, random):
    for shape in (optics.CylinderGlass, optics.SphereGlass):
        glass = shape((0.04, 0.04 * (1.0 - 1e-6)), (1.5, 1.0))
        yield Trial(glass, "TTTT", SIDE, _cloud(settings, random))


def _grazing(settings, random):
    """Points picked on rays that meet the outer face at 89.99 degrees."""
    count = settings.pick(10, 100, 1000)
    sine = 0.04 * np.sin(np.radians(89.99)) / 0.5
    eye = np.array([0.5, 0.0, 0.0])
    climb = random.uniform(-0.2, 0.2, count)
    aims = np.stack([np.full(count, -np.sqrt(1 - sine * sine)), np.full(count, sine), climb], 1)
    aims /= np.linalg.norm(aims, axis=1, keepdims=True)
    for glass in (HOLLOW, FILLED, BALL):
        for path in optics.light_paths(glass, eye)[:4]:
            rays = optics.trace(glass, eye, aims, path)
            way = random.uniform(0.01, 0.3, count)[:, None]
            points = (rays.origin + way * rays.direction)[rays.valid]
            if len(points):
                yield Trial(glass, path.events, eye, points)
    low = np.array([0.0, 0.0, 0.1])
    reach = 0.2 * np.tan(np.radians(89.99))
    turn = random.uniform(0, 2 * np.pi, count)
    points = np.stack([reach * np.cos(turn), reach * np.sin(turn), np.full(count, -0.1)], 1)
    yield Trial(SLAB, "TT", low, points)


def _near_eye(settings, random):
    for glass, path, _, points in _standard(settings, random):
        eye = np.array([0.0, 0.0, 1e-6])
        if not isinstance(glass, optics.FlatGlass):
            eye = np.array([glass.radius[0] + 1e-6, 0.0, 0.01])
        yield Trial(glass, path, eye, points)


def _inner_eye(settings, random):
    for glass in (HOLLOW, FILLED):
        for eye in (np.zeros(3), np.array([1e-12, 0.0, 0.0]), np.array([0.01, 0.005, 0.02])):
            yield Trial(glass, "TT", eye, _cloud(settings, random))


def _axis_points(settings, random):
    height = random.uniform(-0.1, 0.1, settings.pick(10, 100, 1000))
    points = np.stack([np.zeros_like(height), np.zeros_like(height), height], axis=1)
    for glass, path in ((HOLLOW, "TTTT"), (FILLED, "TTTT"), (BALL, "TT")):
        yield Trial(glass, path, SIDE, points)


def _interface_points(settings, random):
    turn = random.uniform(0.5 * np.pi, 1.5 * np.pi, settings.pick(10, 100, 1000))
    height = random.uniform(-0.05, 0.05, len(turn))
    for glass, path in ((HOLLOW, "TTTT"), (FILLED, "TTTT")):
        for radius in glass.radius:
            points = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
            yield Trial(glass, path, SIDE, points)


def _far_points(settings, random):
    count = settings.pick(10, 100, 1000)
    for glass, path in ((HOLLOW, "TTTT"), (FILLED, "TTTT"), (BALL, "TT")):
        across = random.uniform(-2e5, 2e5, (count, 2))
        yield Trial(glass, path, SIDE, np.column_stack([np.full(count, -1e6), across]))
    across = random.uniform(-1e6, 1e6, (count, 2))
    yield Trial(SLAB, "TT", ABOVE, np.column_stack([across, np.full(count, -1e6)]))


def _scaled(settings, random, size):
    factor = size / 0.04
    for glass, path, eye, points in _standard(settings, random):
        if isinstance(glass, optics.FlatGlass):
            larger = optics.FlatGlass((0.01 * factor,), glass.ior)
        else:
            larger = type(glass)(tuple(r * factor for r in glass.radius), glass.ior)
        yield Trial(larger, path, eye * factor, points * factor)


def _far_from_origin(settings, random):
    """Against the same scene at the origin; the coordinates' own rounding limits the answer."""
    for glass, path, eye, points in _standard(settings, random):
        if isinstance(glass, optics.SphereGlass):
            continue
        flat = isinstance(glass, optics.FlatGlass)
        far = np.array([1e5, -1e5, 0.0]) if flat else np.array([0.0, 0.0, 1e5])
        near = optics.apparent_points(glass, path, eye, points)

        def compare(found, near=near):
            return direction_errors(found, near)[0]

        yield Trial(glass, path, eye + far, points + far, compare)


def _critical(settings, random):
    """An eye under water: rays that leave it just inside the critical angle, and just outside."""
    count = settings.pick(10, 100, 1000)
    water = optics.FlatGlass((), (), ior_above=1.333)
    eye = np.array([0.0, 0.0, 0.1])
    critical = 1.0 / 1.333
    sine = critical * (1.0 - 1e-12)
    turn = random.uniform(0, 2 * np.pi, count)
    cosine = np.sqrt(1.0 - sine * sine)
    aims = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.full(count, -cosine)], axis=1)
    rays = optics.trace(water, eye, aims, "T")
    way = random.uniform(0.1, 10.0, count)[:, None]
    yield Trial(water, "T", eye, (rays.origin + way * rays.direction)[rays.valid])
    # Just beyond it the surface mirrors: points over water are seen by no such ray.
    sine = critical * (1.0 + 1e-12)
    cosine = np.sqrt(1.0 - sine * sine)
    aims = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.full(count, -cosine)], axis=1)
    mirrored = optics.trace(water, eye, aims, "R")
    points = (mirrored.origin + way * mirrored.direction)[mirrored.valid]
    yield Trial(water, "R", eye, points)


def _fold(settings, random, gap):
    """Points so far to either side of the fold of a filled cylinder, found by bisection."""
    eye = np.array([0.8, 0.0, 0.1])
    heights = random.uniform(-0.05, 0.05, settings.pick(5, 50, 500))

    def points(across):
        return np.stack([np.full(len(heights), -0.07), across, heights], axis=1)

    low, high = np.zeros(len(heights)), np.full(len(heights), 0.03)
    for _ in range(50):
        middle = 0.5 * (low + high)
        found = optics.apparent_points(FILLED, "TTTT", eye, points(middle))
        three = found.valid.sum(axis=0) == 3
        low, high = np.where(three, middle, low), np.where(three, high, middle)

    for across, images in ((low - gap, 3), (high + gap, 1)):

        def compare(found, images=images):
            """A missing or a false image counts as a picture's width off."""
            return np.where(found.valid.sum(axis=0) == images, 0.0, 1600.0)

        yield Trial(FILLED, "TTTT", eye, points(across), compare)


def _parallel(settings, random):
    view = optics.ParallelView((-0.8, 0.1, -0.59))
    away = 1e6
    for glass, path, _, points in _standard(settings, random):
        far = optics.apparent_points(glass, path, -away * np.asarray(view.direction), points)

        def compare(found, far=far):
            """Pixels as though the view were a metre away."""
            both = found.valid & far.valid
            return FOCAL_PX * np.linalg.norm(found.position - far.position, axis=2)[both]

        yield Trial(glass, path, view, points, compare)


def _broken(settings, random):
    for glass, path, eye, points in _standard(settings, random):
        whole = optics.apparent_points(glass, path, eye, points)
        mixed = points.copy()
        broken = np.arange(0, len(points), 7)
        mixed[broken, 0] = np.resize([np.nan, np.inf, -np.inf], len(broken))
        good = np.setdiff1d(np.arange(len(points)), broken)

        def compare(found, whole=whole, broken=broken, good=good):
            """The good ones bit for bit, or a picture's width off."""
            same = np.array_equal(found.direction[:, good], whole.direction[:, good])
            same &= not found.valid[:, broken].any()
            return np.array([0.0 if same else 1600.0])

        yield Trial(glass, path, eye, mixed, compare)


def _few(settings, random):
    for glass, path, eye, points in _standard(settings, random):
        yield Trial(glass, path, eye, points[:0])
        yield Trial(glass, path, eye, points[:1])


# --- many random cases ---------------------------------------------------------------------------


def _random_cases(settings: Settings) -> dict:
    """Random glasses, eyes and points of all shapes; every image is traced."""
    random = settings.random(10)
    glasses = settings.pick(6, 60, 400)
    count = settings.pick(20, 200, 1000)
    totals = {"glasses": glasses, "points": 0, "images": 0, "held": 0, "over": 0}
    worst = 0.0
    for case in range(glasses):
        glass, eye = random_glass(random, ("flat", "cylinder", "sphere")[case % 3])
        for path in optics.light_paths(glass, eye, min_weight=0.03)[:3]:
            points = eye + random.normal(size=(count, 3)) * 10.0 ** random.uniform(-1, 1)
            found = optics.apparent_points(glass, path, eye, points)
            checked: Checked = check(glass, path.events, eye, points, found)
            totals["points"] += count
            totals["images"] += checked.images
            totals["held"] += checked.held
            totals["over"] += int((checked.errors_px > ASKED_PX).sum())
            worst = max(worst, checked.worst_px)
    return totals | {"worst_px": worst, "asked_px": ASKED_PX}


def random_glass(random: np.random.Generator, kind: str):
    """A glass of outer size 1 m, indices 1.05 to 2.42, and an eye from 1.05 to 100 m off."""
    far = 10.0 ** random.uniform(np.log10(1.05), 2.0)
    if kind == "flat":
        layers = int(random.integers(0, 4))
        glass = optics.FlatGlass(
            tuple(random.uniform(0.001, 0.3, layers)),
            tuple(random.uniform(1.05, 2.42, layers)),
            ior_below=float(random.choice([1.0, 1.333])),
        )
        return glass, np.array([*random.normal(size=2), far])
    inner = random.uniform(0.5, 0.99, int(random.integers(0, 2)))
    media = [*random.uniform(1.05, 2.42, len(inner)), random.uniform(1.05, 2.42)]
    if len(inner):
        media[-1] = float(random.choice([1.0, 1.333]))
    shape = optics.CylinderGlass if kind == "cylinder" else optics.SphereGlass
    away = random.normal(size=3)
    away[2] *= kind == "sphere"
    eye = far * away / np.linalg.norm(away)
    if kind == "cylinder":
        eye[2] = random.normal()
    return shape((1.0, *inner), tuple(media)), eye


# --- words ---------------------------------------------------------------------------------------


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    random = found["random"]
    lines = [
        "Every image is traced forward from the eye with plain vector refraction. *Held*: its ray "
        "takes the path and meets the point, on its stretch and at its distance. *Error*: the "
        "angle at the eye by which the ray passes the point. *Compared*: the largest difference "
        "from what the case must equal (identity, the same scene at the origin, good points alone, "
        "a far eye at one metre's scale, three images on one side of the fold, one on the other), "
        "where there is such a thing. *Condition*: how many times more an image turns than its "
        "point moves, seen from the eye; an error up to condition times 1e-16 is the input's own "
        "rounding. It is found by moving points by 1e-9 of their distance, which limits what it "
        "can tell.",
        "",
    ]
    lines += table(
        (
            "tried",
            "hard because",
            "points",
            "images",
            "held",
            "largest error, px",
            "compared, px",
            "condition",
            "NaN or warnings",
        ),
        [
            (
                row["name"],
                row["why"],
                row["points"],
                row["images"],
                row["held"],
                row["worst_px"] if row["traced"] else None,
                row["compared_px"],
                row["condition"] if row["traced"] else None,
                row["warnings_and_nonfinite"],
            )
            for row in found["rows"]
        ],
    )
    lines += [
        f"Random glasses of all shapes: {number(random['glasses'])} glasses, "
        f"{number(random['points'])} points, {number(random['images'])} images, of which "
        f"{number(random['held'])} held; largest error {number(random['worst_px'])} px, "
        f"{random['over']} above {random['asked_px']:g} px.",
        "",
    ]
    return lines


def charts(found: dict) -> list[Chart]:
    """None: names are no axis."""
    return []
