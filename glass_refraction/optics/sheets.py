# SPDX-License-Identifier: GPL-3.0-or-later
"""All images of points in one coaxial passage, separated into sheets.

For a target at radius r, height z and azimuth φ, the rays that reach *some* point of its circle
(same r and z) on one leg of the passage form a curve: ζ follows from ℓ, and the azimuth F at which
the ray meets the circle is a function of one parameter τ. F is odd in ℓ, so only ℓ ≥ 0 is looked
at, with ℓ = upper · sin τ up to the limit of the domain, which takes the square-root end out.
Every solution of F = ±φ (mod 2π) is an image, and F turns round exactly where the curve meets a
caustic. Its monotone *pieces* are the sheets: at most one image each, found by a bracket that
cannot lose it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .coaxial import CoaxialPassage
from .solver import newton

Floats = NDArray[np.float64]

HALF_TURN = np.pi
EDGE = 0.5 * np.pi
"""τ at the edge of the domain."""


@dataclass
class State:
    """A curve at τ and ζ: azimuth F, height Z, and their derivatives by τ and ζ."""

    ell: Floats
    turn: Floats
    height: Floats
    turn_tau: Floats
    turn_zeta: Floats
    height_tau: Floats
    height_zeta: Floats

    def slope(self, free: bool) -> Floats:
        """dF/dτ along the curve (at the target's height where ζ is free)."""
        if not free:
            return self.turn_tau
        height_zeta = np.where(np.abs(self.height_zeta) > FLOOR, self.height_zeta, FLOOR)
        return self.turn_tau - self.turn_zeta * self.height_tau / height_zeta


class Curves:
    """The curves of n targets on one leg (`side` −1: before the foot, 1: after) of a passage."""

    def __init__(self, passage: CoaxialPassage, side: int, x: Floats, y: Floats, z: Floats) -> None:
        self.passage, self.side = passage, side
        self.radius = np.hypot(x, y)
        self.height = np.abs(z)
        self.sign = np.where(z < 0.0, -1.0, 1.0)
        centre = (passage.turn + (side < 0)) % 2 * HALF_TURN
        azimuth = np.arctan2(y, x) if centre == 0.0 else np.arctan2(-y, -x)
        self.azimuth = azimuth
        self.free = passage.frame.zeta is None
        self.known = None if self.free else abs(passage.frame.zeta)
        self.zeta_max = passage.zeta_max
        # Squared radii and counts of all terms by index; None stands for the target's radius.
        terms: dict[float, list] = {}
        for term in passage.terms:
            terms.setdefault(term.ior, []).append((term.radius * term.radius, term.count))
        terms.setdefault(passage.ior, []).append((None, -side))
        self.terms = tuple(terms.items())

    def take(self, which) -> Curves:
        part = object.__new__(Curves)
        part.__dict__.update(self.__dict__)
        part.radius, part.height = self.radius[which], self.height[which]
        part.sign, part.azimuth = self.sign[which], self.azimuth[which]
        return part

    def zeta(self, tangent: Floats) -> Floats:
        """ζ ≥ 0 from its unbounded parameter."""
        if not self.free:
            return np.full(len(self.radius), self.known)
        return self.zeta_max * tangent / np.sqrt(1.0 + tangent * tangent)

    def state(self, tau: Floats, tangent: Floats, turning: bool = True) -> State:
        """F, Z and derivatives at τ and ζ, (n,) or (k, n); without F unless `turning`."""
        passage = self.passage
        zeta = self.zeta(tangent)
        zeta2 = zeta * zeta
        r2 = self.radius * self.radius
        upper2, upper_r2 = passage.upper_limit(zeta2, r2)
        upper2 = np.maximum(upper2, FLOOR)
        upper = np.sqrt(upper2)
        # Lengths are told from the edge of the domain, where w of the limiting term vanishes with
        # cos τ: so no difference of large numbers is left in F, Z and their derivatives.
        half2 = np.maximum(np.sin(0.5 * (EDGE - tau)) ** 2, ROUNDING)
        sine, cosine2 = np.sin(tau), 4.0 * half2 * (1.0 - half2)
        ell = upper * sine
        below = upper2 * cosine2  # upper² − ℓ²
        at_edge = upper_r2 / upper2  # 1 / P² of the limiting term
        within = upper_r2 * cosine2
        within -= upper_r2
        turn = None
        way, way_zeta, spread, twist, lift = np.zeros((5, *below.shape))
        ell2 = ell * ell
        odd = {}  # for each count the direction cosines of a term that awaits another
        for ior, terms in self.terms:
            p2 = ior * ior - zeta2
            per = 1.0 / p2
            inverses = ways = falls = None
            for radius2, count in terms:
                if radius2 is None:
                    radius2 = r2
                w = p2 * radius2
                w -= upper2
                np.maximum(w, 0.0, out=w)
                w = w + below
                np.sqrt(w, out=w)
                inverse = count / w
                fall = within + radius2
                fall *= inverse
                falls = _plus(falls, fall)
                if turning:
                    # Two angles at once: the argument of a product.
                    size = abs(count)
                    if size in odd:
                        other, side = odd.pop(size)
                        same = side * count > 0
                        real = w * other
                        if same:
                            real -= ell2
                            imag = other + w
                        else:
                            real += ell2
                            imag = w - other
                        imag *= ell
                        angle = np.arctan2(imag, real, out=imag)
                        angle *= side * size
                        turn = _plus(turn, angle)
                    else:
                        odd[size] = w, (1 if count > 0 else -1)
                    inverses = _plus(inverses, inverse)
                ways = _plus(ways, w * count)
            ways *= per
            way -= ways
            if turning:
                spread += inverses
                lift += per * inverses
                inverses *= per - at_edge
                twist += inverses
            falls *= -1.0
            falls += 2.0 * ways
            falls *= zeta2 * per
            falls += ways
            way_zeta -= falls
        for size, (w, side) in odd.items():
            turn = _plus(turn, side * size * np.arctan2(ell, w))
        ell_tau = upper * np.sqrt(cosine2)
        return State(
            ell,
            turn,
            zeta * way,
            ell_tau * spread,
            zeta * ell * twist,
            zeta * ell * ell_tau * lift,
            way_zeta,
        )

    def invariants(self, tau: Floats, tangent: Floats, mirror: Floats) -> tuple[Floats, Floats]:
        """ℓ and ζ with their signs."""
        sign = self.sign if self.free else np.sign(self.passage.frame.zeta)
        zeta = self.zeta(tangent)
        upper2, _ = self.passage.upper_limit(zeta * zeta, self.radius * self.radius)
        ell = np.sqrt(np.maximum(upper2, FLOOR)) * np.sin(tau)
        return mirror * ell, sign * zeta

    def start(self, tau: Floats) -> Floats:
        """A first tangent: as if ways across the axis did not depend on ζ."""
        zero = np.zeros(np.broadcast_shapes(np.shape(tau), self.radius.shape))
        if not self.free:
            return zero
        here = self.state(tau, zero, turning=False)
        return np.minimum(self.height / np.maximum(here.height_zeta * self.zeta_max, FLOOR), STEEP)

    def corner(self) -> Floats:
        """The ζ* at which the limit of the domain changes; 0 where it does not."""
        corner2 = np.zeros(len(self.radius))
        lines = [*self.passage.limits, (self.passage.ior**2, self.radius * self.radius)]
        for number, (n2, r2) in enumerate(lines):
            for m2, s2 in lines[:number]:
                apart = r2 - s2
                square = (n2 * r2 - m2 * s2) / np.where(apart == 0.0, np.inf, apart)
                inner = (square > 0.0) & (square < self.zeta_max**2 * (1.0 - 1e-9))
                # Only where the two lines that cross are the least of all.
                least, _ = self.passage.upper_limit(
                    np.where(inner, square, 0.0), self.radius * self.radius
                )
                inner &= (n2 - square) * r2 <= least * (1.0 + 1e-9)
                corner2 = np.where(inner, square, corner2)
        return np.sqrt(corner2)

    def folded(self, corner: Floats) -> NDArray[np.bool_]:
        """Targets at whose height the height may fall with ζ near a corner of the domain."""
        some = np.flatnonzero(corner > 0.0)
        result = np.zeros(len(corner), dtype=bool)
        if not len(some):
            return result
        here = self.take(some)
        part = np.geomspace(1e-4, 0.9, 12)[:, None]
        corner = corner[some]
        zeta = np.concatenate(
            [corner * (1.0 - part[::-1]), corner[None], corner + (self.zeta_max - corner) * part]
        )
        tangent = zeta / np.sqrt((self.zeta_max - zeta) * (self.zeta_max + zeta))
        height = here.state(np.full((1, 1), EDGE), tangent, turning=False).height
        highest = np.maximum.accumulate(height, axis=0)
        lowest = np.minimum.accumulate(height[::-1], axis=0)[::-1]
        falls = highest > lowest * (1.0 + 1e-12)
        top = np.where(falls, highest, -np.inf).max(axis=0)
        bottom = np.where(falls, lowest, np.inf).min(axis=0)
        room = np.where(falls.any(axis=0), top - bottom, 0.0)
        result[some] = (here.height < top + room) & (here.height > bottom - 2.0 * room)
        return result

    def lean(self, tangent: Floats, state: State) -> Floats:
        """Change of the tangent with τ along the curve, 0 where it would lead far."""
        if not self.free:
            return np.zeros(len(tangent))
        square = 1.0 + tangent * tangent
        slope = state.height_zeta * self.zeta_max / (square * np.sqrt(square))
        steep = np.abs(slope) <= 1e-3 * np.abs(state.height_tau)
        lean = -state.height_tau / np.where(steep, 1.0, slope)
        return np.where(steep | (tangent > 10.0), 0.0, lean)

    def climbed(
        self, tau: Floats, tangent: Floats, small: float, most: int
    ) -> tuple[Floats, State]:
        """`climb`, and the state there."""
        tangent = self.climb(tau, tangent, small, most)
        return tangent, self.state(tau, tangent)

    def climb(self, tau: Floats, tangent: Floats, small: float, most: int) -> Floats:
        """The tangent at which rays with this τ reach the target's height.

        Newton's steps, halved back into a bracket; the height grows with ζ along τ.
        """
        if not self.free:
            return tangent
        curves, low, high, index = self, 0.0, np.inf, None
        place, moving = tau, np.ones(1, dtype=bool)
        here = tangent
        for _ in range(most):
            state = curves.state(place, here, turning=False)
            miss = state.height - curves.height
            low = np.where(miss < 0.0, np.maximum(low, here), low)
            high = np.where(miss > 0.0, np.minimum(high, here), high)
            square = 1.0 + here * here
            slope = state.height_zeta * self.zeta_max / (square * np.sqrt(square))
            new = here - miss / np.where(np.abs(slope) > FLOOR, slope, FLOOR)
            middle = np.where(high < STEEP, 0.5 * (low + high), 2.0 * low + 1.0)
            new = np.minimum(np.where((new >= low) & (new <= high), new, middle), STEEP)
            # Every element takes one step that follows a small one, and stops: none depends on
            # its neighbours.
            change = np.abs(new - here) > small * (1.0 + here)
            here = np.where(moving, new, here)
            moving = moving & change
            count = np.count_nonzero(moving)
            if not count or count < 0.6 * moving.size:
                if index is None:
                    tangent = here
                else:
                    tangent.ravel()[index] = here
                if not count:
                    break
                # Go on with those that still move.
                some = np.flatnonzero(moving)
                place = np.broadcast_to(place, moving.shape).ravel()[some]
                curves = curves.take(some % len(curves.radius))
                index = some if index is None else index[some]
                here, low, high = (part.ravel()[some] for part in (here, low, high))
                moving = np.ones(count, dtype=bool)
        else:
            if index is None:
                tangent = here
            else:
                tangent.ravel()[index] = here
        return tangent

    def along(self, taus: Floats) -> tuple[Floats, Floats, Floats]:
        """Tangent, F and its slope at each of `taus` (k,), the last of them the edge: (k, n)."""
        if not self.free:
            tangent = self.start(taus[:, None])
            state = self.state(taus[:, None], tangent)
            return tangent, state.turn, np.array(state.slope(False))
        # A few places from the start, those between from these.
        last = len(taus) - 1
        few = np.unique(np.linspace(0, last, max(2, last // 3 + 1)).round().astype(np.intp))
        rest = np.setdiff1d(np.arange(last + 1), few)
        known = self.climb(taus[few, None], self.start(taus[few, None]), 3e-3, 30)
        tangent = np.empty((last + 1, len(self.radius)))
        tangent[few] = known
        for row in rest:
            between = 0.0
            for one, value in zip(few, known, strict=True):
                others = few[few != one]
                part = np.prod((taus[row] - taus[others]) / (taus[one] - taus[others]))
                between = between + part * value
            tangent[row] = between
        np.clip(tangent, 0.0, STEEP, out=tangent)
        tau = np.broadcast_to(taus[:, None], tangent.shape)
        tangent, turn, slope, off = self._corrected(tau, tangent)
        for steps in (0, 30):
            # Once more for those that are not near, and at last as long as it takes.
            far = np.flatnonzero(off > NEAR)
            if not len(far):
                break
            place, curves = tau.ravel()[far], self.take(far % len(self.radius))
            climbed = curves.climb(place, tangent.ravel()[far], NEAR, steps)
            for whole, part in zip(
                (tangent, turn, slope, off), curves._corrected(place, climbed), strict=True
            ):
                whole.ravel()[far] = part
        # The edge tells which targets have an image at all.
        tangent[-1], state = self.climbed(taus[-1:], tangent[-1], 1e-9, 30)
        turn[-1], slope[-1] = state.turn, state.slope(True)
        return tangent, turn, slope

    def _corrected(self, tau: Floats, tangent: Floats) -> tuple[Floats, ...]:
        """Tangent and F after what is left of the way to the target's height, to first order;
        the slope before it, and that way in parts of the tangent."""
        state = self.state(tau, tangent)
        square = 1.0 + tangent * tangent
        gain = np.where(np.abs(state.height_zeta) > FLOOR, state.height_zeta, FLOOR)
        fall = (state.height - self.height) / gain
        move = fall * (square * np.sqrt(square)) / self.zeta_max
        off = np.abs(move) / (1.0 + tangent)
        some = off <= FIRST_ORDER
        tangent = np.where(some, np.maximum(tangent - move, 0.0), tangent)
        turn = np.where(some, state.turn - state.turn_zeta * fall, state.turn)
        return tangent, turn, np.array(state.slope(True)), off


def _plus(total: Floats | None, part: Floats) -> Floats:
    """The sum, in the total's place; the first part becomes the total."""
    if total is None:
        return part
    total += part
    return total


def strays(curves: Curves, targets, known) -> tuple[NDArray[np.intp], ...]:
    """Images off the curves that `Leg` follows: index, ℓ, ζ, upright.

    Where the limit of the domain passes from one radius to another at some ζ*, its edge has a
    corner, and near it the height may fall with ζ along τ. The circle's curve then has a second
    part near the corner. The few targets at such heights are searched on a lattice of τ and ζ;
    every cell in which azimuth and height both change their sign starts Newton's steps. `known`
    (index, ℓ, ζ) are images found already.
    """
    passage = curves.passage
    none = np.zeros(0, dtype=np.intp)
    if not curves.free:
        return none, none, none, none
    corner = curves.corner()
    some = np.flatnonzero(curves.folded(corner))
    if not len(some):
        return none, none, none, none
    here = curves.take(some)
    tau = EDGE * (1.0 - np.linspace(1.0, 0.0, 24) ** 2)[:, None, None]
    spread = np.linspace(0.0, 1.0, 16)[:, None] ** 2
    zeta = np.concatenate(
        [
            corner[some] * (1.0 - spread[:0:-1]),
            corner[some] + (curves.zeta_max * (1.0 - 1e-9) - corner[some]) * spread,
        ]
    )
    tangent = zeta / np.sqrt((curves.zeta_max - zeta) * (curves.zeta_max + zeta))
    state = here.state(tau, np.broadcast_to(tangent, (24, *tangent.shape)))
    crosses = _changes(state.height - here.height)
    turns = 2.0 * HALF_TURN * np.arange(-3, 4)
    starts = []
    for mirror in (1.0, -1.0):
        wanted = mirror * (here.azimuth + turns[:, None])
        for aim in wanted:
            cell = np.nonzero(crosses & _changes(state.turn - aim))
            row, column, index = cell
            middle = 0.5 * (tau[row, 0, 0] + tau[row + 1, 0, 0])
            rise = 0.5 * (tangent[column, index] + tangent[column + 1, index])
            ell, tilt = here.take(index).invariants(middle, rise, np.full(len(index), mirror))
            starts.append((index, ell, tilt))
    index, ell, tilt = (np.concatenate(part) for part in zip(*starts, strict=True))
    index = some[index]
    solved = [target[index] for target in targets]
    (ell, tilt), steps = newton(passage, [ell, tilt], solved, small=1e-9, most=30)
    line = passage.follow(ell, tilt)
    along, across, rise = line.misses(*solved)
    good = (steps <= 30) & (along * curves.side >= 0.0)
    good &= np.abs(across) + np.abs(rise) <= 1e-10 * (1.0 + np.hypot(along, rise + solved[2]))
    good &= ~_same(index, ell, tilt, *known)
    index, ell, tilt = index[good], ell[good], tilt[good]
    first = np.ones(len(index), dtype=bool)
    for number in range(1, len(index)):
        earlier = slice(0, number)
        first[number] = not (
            first[earlier]
            & (index[earlier] == index[number])
            & (np.abs(ell[earlier] - ell[number]) < 1e-7)
            & (np.abs(tilt[earlier] - tilt[number]) < 1e-7)
        ).any()
    index, ell, tilt = index[first], ell[first], tilt[first]
    upright = passage.upright(ell, tilt, *(target[index] for target in targets))
    return index, ell, tilt, upright


def _changes(values: Floats) -> NDArray[np.bool_]:
    """Cells of a lattice (rows, columns, n) whose corners differ in sign."""
    high = values > 0.0
    corners = high[1:, 1:], high[1:, :-1], high[:-1, 1:], high[:-1, :-1]
    count = sum(corner.astype(np.int8) for corner in corners)
    return (count > 0) & (count < 4)


def _same(index, ell, zeta, other_index, other_ell, other_zeta) -> NDArray[np.bool_]:
    """Which of the first images are among the others."""
    order = np.argsort(other_index, kind="stable")
    found = np.zeros(len(index), dtype=bool)
    low = np.searchsorted(other_index[order], index, side="left")
    high = np.searchsorted(other_index[order], index, side="right")
    for step in range(int((high - low).max(initial=0))):
        at = order[np.minimum(low + step, len(order) - 1)]
        near = (np.abs(other_ell[at] - ell) < 1e-7) & (np.abs(other_zeta[at] - zeta) < 1e-7)
        found |= (low + step < high) & near
    return found


@dataclass
class Roots:
    """Images found: which target, its sheet (`key`), and τ and tangent, with the side of ℓ."""

    index: NDArray[np.intp]
    tau: Floats
    tangent: Floats
    mirror: Floats  # ±1, the sign of ℓ
    piece: NDArray[np.intp]
    rising: NDArray[np.bool_]
    winding: NDArray[np.intp]


class Leg:
    """Curves cut into monotone parts, and the images on them.

    A *part* is a stretch of one target's curve on which F is monotone, no longer than a cell; all
    parts lie in flat arrays, those of one target together and in order. A *piece* is a sheet: the
    parts between two places where F turns round, numbered from ℓ = 0.
    """

    def __init__(self, curves: Curves, cells: int) -> None:
        self.curves = curves
        count = len(curves.radius)
        taus = np.linspace(0.0, EDGE, cells + 1)
        if cells > 1 and curves.free and curves.corner().any():
            # Where two limits of the domain cross, F may turn round very close to its edge.
            taus = np.concatenate([taus[:-1], EDGE - (EDGE / cells) * NEAR_EDGE, taus[-1:]])
        tangent, turn, slope = curves.along(taus)
        self.last_turn, self.last_tangent = turn[-1], tangent[-1]
        self.first_tangent = tangent[0]
        # Ends of parts, target by target.
        tau, index = np.tile(taus, count), np.repeat(np.arange(count), len(taus))
        ends = [part.T.ravel() for part in (tangent, turn, slope)]
        ends = self._dips(index, [tau, *ends], len(taus))
        self._cut(*ends)

    def _dips(self, index, ends, rows):
        """More ends where the slope dips towards zero between two of the same sign."""
        tau, tangent, turn, slope = ends
        size = np.abs(slope).reshape(-1, rows)
        up = slope.reshape(-1, rows) > 0.0
        inner = size[:, 1:-1]
        dip = (inner < size[:, :-2]) & (inner < size[:, 2:])
        dip &= (up[:, 1:-1] == up[:, :-2]) & (up[:, 1:-1] == up[:, 2:])
        # The parabola through three slopes: is its top anywhere near zero?
        left, right = size[:, :-2] - inner, size[:, 2:] - inner
        bend, lean = 0.5 * (left + right), 0.5 * (right - left)
        shift = -lean / np.where(dip, 2.0 * bend, 1.0)
        low = inner + 0.5 * lean * shift
        dip &= low < 0.5 * inner
        where = np.flatnonzero(np.pad(dip, ((0, 0), (1, 1))))
        if not len(where):
            return index, tau, tangent, turn, slope
        shift = shift[dip]
        neighbour = np.where(shift > 0.0, where + 1, where - 1)
        new_tau = tau[where] + np.abs(shift) * (tau[neighbour] - tau[where])
        curves = self.curves.take(index[where])
        new_tangent, state = curves.climbed(new_tau, tangent[where], 1e-5, 30)
        before = np.where(shift > 0.0, where + 1, where)
        fields = (index[where], new_tau, new_tangent, state.turn, state.slope(curves.free))
        return tuple(
            np.insert(old, before, new)
            for old, new in zip((index, tau, tangent, turn, slope), fields, strict=True)
        )

    def _cut(self, index, tau, tangent, turn, slope) -> None:
        """Cut parts where F turns round and count the pieces."""
        rising = slope > 0.0
        joined = index[1:] == index[:-1]
        cut = np.flatnonzero(joined & (rising[1:] != rising[:-1]))
        top_tau, top_tangent, top_turn = self._turning(
            self.curves.take(index[cut]),
            *(np.stack([part[cut], part[cut + 1]]) for part in (tau, slope)),
            tangent[cut],
            self._foreseen(index, tau, slope, cut),
        )
        # After a cut the slope that counts is that of the next end.
        index, tau, tangent, turn, rising = (
            np.insert(old, cut + 1, new)
            for old, new in (
                (index, index[cut]),
                (tau, top_tau),
                (tangent, top_tangent),
                (turn, top_turn),
                (rising, rising[cut + 1]),
            )
        )
        turned = np.zeros(len(index), dtype=bool)
        turned[cut + 1 + np.arange(len(cut))] = True
        piece = np.cumsum(turned)
        begins = np.append(True, index[1:] != index[:-1])
        piece = piece - piece[begins][index]
        part = np.flatnonzero(np.append(index[1:] == index[:-1], False))
        self.index, self.piece, self.rising = index[part], piece[part], rising[part]
        self.tau_low, self.tau_high = tau[part], tau[part + 1]
        self.turn_low, self.turn_high = turn[part], turn[part + 1]
        self.tangent_low = tangent[part]
        # Where the next part goes on, the bracket may reach into it a little: F at the ends of
        # cells is known to first order only. Not over a turning place, nor out of the domain.
        self.room_low = np.where(turned[part] | (tau[part] == 0.0), 0.0, SLACK)
        self.room_high = np.where(turned[part + 1] | (tau[part + 1] == EDGE), 0.0, SLACK)
        count = len(self.curves.radius)
        self.rising_first = rising[begins]
        self.last_piece = np.bincount(index[turned], minlength=count)
        # Where pieces end, as a table: row p holds the end of piece p.
        rows = int(self.last_piece.max(initial=0)) + 1
        self.ends_tau = np.full((rows, count), EDGE)
        self.ends_turn = np.repeat(self.last_turn[None], rows, axis=0)
        self.ends_tangent = np.repeat(self.last_tangent[None], rows, axis=0)
        place = piece[turned] - 1, index[turned]
        self.ends_tau[place] = tau[turned]
        self.ends_turn[place] = turn[turned]
        self.ends_tangent[place] = tangent[turned]

    @staticmethod
    def _foreseen(index, tau, slope, cut) -> Floats:
        """Where the slope will be 0: the cubic for τ through the four slopes round a cut."""
        around = cut + np.arange(-1, 3)[:, None]
        last = len(index) - 1
        inside = np.clip(around, 0, last)
        whole = ((inside == around) & (index[inside] == index[cut])).all(axis=0)
        slopes, taus = slope[inside], tau[inside]
        whole &= (np.diff(slopes, axis=0) > 0.0).all(axis=0) | (np.diff(slopes, axis=0) < 0.0).all(
            axis=0
        )
        result = np.zeros(len(cut))
        for one in range(4):
            part = taus[one]
            for other in range(4):
                if other != one:
                    apart = np.where(whole, slopes[one] - slopes[other], 1.0)
                    part = part * (-slopes[other] / apart)
            result = result + part
        return np.where(whole, result, np.nan)

    @staticmethod
    def _turning(curves: Curves, taus, slopes, tangent, first):
        """τ, tangent and F where the slope of F changes its sign within a part."""
        low, high = taus
        slope_low, slope_high = slopes
        tau = turn = low
        before, lean = tau, np.zeros(len(low))
        index = np.arange(len(low))
        result = [np.array(part) for part in (low, tangent, low)]
        last_tau, last_slope, here = low, slope_low, slope_low
        tau = first
        for number in range(60):
            if not len(index):
                break
            # A secant through the last two places (first: the place foreseen), or Illinois: a
            # secant that halves the weight of an end that stays.
            between = (low * slope_high - high * slope_low) / (slope_high - slope_low)
            if 1 < number < 8:
                rise = here - last_slope
                flat = rise == 0.0
                tau, last_tau, last_slope = (
                    before - here * (before - last_tau) / np.where(flat, 1.0, rise),
                    before,
                    here,
                )
                tau = np.where(flat, between, tau)
            elif number:
                tau = between
                last_tau, last_slope = before, here
            tau = np.where((tau > low) & (tau < high), tau, between)
            tau = np.where((tau > low) & (tau < high), tau, 0.5 * (low + high))
            tangent, state = curves.climbed(
                tau, np.maximum(tangent + lean * (tau - before), 0.0), 1e-6, 30
            )
            turn, here = state.turn, state.slope(curves.free)
            before, lean = tau, curves.lean(tangent, state)
            for old, new in zip(result, (tau, tangent, turn), strict=True):
                old[index] = new
            left = (here > 0.0) == (slope_low > 0.0)
            low = np.where(left, tau, low)
            high = np.where(left, high, tau)
            slope_high = np.where(left, 0.5 * slope_high, here)
            slope_low = np.where(left, here, 0.5 * slope_low)
            # F is flat here: an error of 1e-8 in τ is one of 1e-16 in F.
            going = np.flatnonzero(np.minimum(high - low, np.abs(here)) > 1e-9)
            if len(going) < len(index):
                index, curves = index[going], curves.take(going)
                low, high, slope_low, slope_high, here = (
                    part[going] for part in (low, high, slope_low, slope_high, here)
                )
                tangent, before, lean, last_tau, last_slope = (
                    part[going] for part in (tangent, before, lean, last_tau, last_slope)
                )
        return result

    def roots(self) -> Roots:
        """All images of all targets on this leg."""
        azimuth = self.curves.azimuth[self.index]
        top = np.maximum(self.turn_low, self.turn_high)
        bottom = np.minimum(self.turn_low, self.turn_high)
        at_start = self.tau_low == 0.0
        at_end = self.tau_high == EDGE
        found = []
        reach = max(top.max(initial=0.0), -bottom.min(initial=0.0))
        most = int(np.ceil((reach + HALF_TURN) / (2.0 * HALF_TURN)))
        for winding in range(-most, most + 1):
            for mirror in (1.0, -1.0):
                wanted = mirror * (azimuth + 2.0 * HALF_TURN * winding)
                # Begins belong to a part, ends do not; ℓ = 0 belongs to one side only, and the
                # edge of the domain to the last part, with what rounding does to it.
                low, high = self.turn_low, self.turn_high
                inside = ((wanted - low) * (wanted - high) < 0.0) | (wanted == low)
                if mirror < 0.0:
                    inside &= ~(at_start & (wanted == low))
                inside |= at_end & (np.abs(wanted - high) < 4e-15)
                which = np.flatnonzero(inside)
                if len(which):
                    found.append((which, wanted[which], mirror, winding))
        if not found:
            nothing = np.zeros(0)
            none = np.zeros(0, dtype=np.intp)
            return Roots(none, nothing, nothing, nothing, none, none > 0, none)
        which = np.concatenate([part[0] for part in found])
        wanted = np.concatenate([part[1] for part in found])
        mirror = np.concatenate([np.full(len(part[0]), part[2]) for part in found])
        winding = np.concatenate([np.full(len(part[0]), part[3]) for part in found])
        index = self.index[which]
        tau, tangent = self._solve(which, wanted)
        return Roots(index, tau, tangent, mirror, self.piece[which], self.rising[which], winding)

    def _solve(self, which, wanted):
        """Newton's steps in τ and ζ together, held in the bracket of a monotone part."""
        curves = self.curves.take(self.index[which])
        low = self.tau_low[which] - self.room_low[which]
        high = self.tau_high[which] + self.room_high[which]
        first, last = self.turn_low[which], self.turn_high[which]
        rising = last > first
        share = (wanted - first) / np.where(last == first, 1.0, last - first)
        tau = self.tau_low[which]
        tau = tau + np.clip(share, 0.0, 1.0) * (self.tau_high[which] - tau)
        tangent = self.tangent_low[which].copy()
        index = np.arange(len(tau))
        result_tau, result_tangent = tau.copy(), tangent.copy()
        here = [curves, low, high, rising, wanted, tau, tangent]
        for _ in range(100):
            curves, low, high, rising, wanted, tau, tangent = here
            state = curves.state(tau, tangent)
            miss = state.turn - wanted
            new_tangent, sure = tangent, True
            if curves.free:
                root = np.sqrt(1.0 + tangent * tangent)
                stretch = curves.zeta_max / (root * root * root)
                off = state.height - curves.height
                slope = state.height_zeta
                slope = np.where(np.abs(slope) > FLOOR, slope, FLOOR)
                # Azimuth where this τ reaches the target's height, to first order.
                correction = state.turn_zeta * off / slope
                # Far from the curve the correction may lie; then it must not move the bracket.
                sure = np.abs(correction) <= np.maximum(0.3 * np.abs(miss), 1e-6)
                miss = miss - correction
            along = state.slope(curves.free)
            ahead = (miss < 0.0) == rising
            low = np.where(sure & ahead, tau, low)
            high = np.where(sure & ~ahead, tau, high)
            new = tau - miss / np.where(np.abs(along) > FLOOR, along, FLOOR)
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            change = np.abs(new - tau)
            if curves.free:
                move = -(off + state.height_tau * (new - tau)) / slope / stretch
                new_tangent = tangent + move
                # A step this wild comes from a bracket far too wide: keep the tilt's sign.
                new_tangent = np.where(new_tangent < 0.0, 0.5 * tangent, new_tangent)
                new_tangent = np.minimum(new_tangent, np.minimum(4.0 * tangent + 1e3, STEEP))
                change = np.maximum(change, np.abs(new_tangent - tangent) / (1.0 + tangent**2))
            result_tau[index], result_tangent[index] = new, new_tangent
            moving = change > SETTLED
            if not moving.any():
                break
            index = index[moving]
            here = [
                curves.take(moving),
                *(part[moving] for part in (low, high, rising, wanted, new, new_tangent)),
            ]
        return result_tau, result_tangent


class Placing:
    """What stays of a leg for vertices without an image: the ends of the pieces."""

    def __init__(self, leg: Leg) -> None:
        self.curves = leg.curves
        self.last_piece = leg.last_piece
        self.rising_first = leg.rising_first
        self.ends_tau, self.ends_turn = leg.ends_tau, leg.ends_turn
        self.ends_tangent = leg.ends_tangent
        self.first_tangent = leg.first_tangent

    def nearest(self, upright: bool, rank: int, winding: int, index) -> tuple[Floats, ...]:
        """The edge of a sheet nearest to targets `index`: ℓ, ζ, and the gap in azimuth.

        Where the target's curve has no such piece (gap `NO_PIECE`) the middle of the curve: the
        sheet begins there, at a cusp.
        """
        curves = self.curves.take(index)
        orient = curves.passage.orientation(curves.side)
        wanted = curves.azimuth + 2.0 * HALF_TURN * winding
        same = (self.rising_first[index] == (orient > 0)) == upright
        odd = ~same
        piece = np.where(odd, 2 * (rank // 2) + 1, 2 * ((rank + 1) // 2))
        mirror = np.where(odd == (rank % 2 == 1), 1.0, -1.0)
        missing = piece > self.last_piece[index]
        row = np.clip(piece, 0, len(self.ends_tau) - 1)
        end_turn = self.ends_turn[row, index]
        # The piece through ℓ = 0 ends on both sides alike.
        mirror = np.where(piece == 0, np.where(wanted * end_turn < 0.0, -1.0, 1.0), mirror)
        wanted = mirror * wanted
        before = np.maximum(row - 1, 0)
        begin_turn = self.ends_turn[before, index]
        first = (piece > 0) & (np.abs(wanted - begin_turn) < np.abs(wanted - end_turn))
        row = np.where(first, before, row)
        tau, tangent = self.ends_tau[row, index], self.ends_tangent[row, index]
        gap = np.abs(wanted - np.where(first, begin_turn, end_turn))
        tau = np.where(missing, 0.0, tau)
        tangent = np.where(missing, self.first_tangent[index], tangent)
        gap = np.where(missing, NO_PIECE, gap)
        ell, zeta = curves.invariants(tau, tangent, mirror)
        return ell, zeta, gap


def rank_of(piece, mirror):
    """Number of a piece among those of its orientation: the middle one, then left, right, …"""
    return np.where(piece > 0, piece - 1 + (mirror > 0.0), 0)


NEAR_EDGE = np.array([0.3, 0.1, 0.03, 0.01, 0.003])
"""Places within the last cell, in parts of it, that get cells of their own near a corner."""

ROUNDING = 1e-32
"""Floor of sin²((π/2 − τ)/2): the edge of the domain to float64."""

SLACK = 1e-4
"""Overlap of brackets in τ."""

FIRST_ORDER = 0.1
"""Step of the tilt, in parts of it, that is worth taking."""

NEAR = 1e-5
"""Step of the tilt, in parts of it, after which nothing more is needed for a bracket."""

SETTLED = 1e-9
"""Step in τ and tilt that Newton's next one would not change."""

NO_PIECE = 1e3
"""Gap that stands for a piece that a target's curve does not have."""

FLOOR = 1e-40
STEEP = 1e6
"""Largest tangent of the tilt: beyond it a ray runs along the axis."""
