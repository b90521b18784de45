# SPDX-License-Identifier: GPL-3.0-or-later
"""Light paths: what a ray does at each interface it meets, in order from the eye."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .glasses import FlatGlass, Glass


@dataclass(frozen=True)
class LightPath:
    """One way of light from the eye through a glass.

    Parameters
    ----------
    events : str
        One letter an interface, in order from the eye: ``T`` refracted through, ``R`` reflected.
        Empty: the direct view.
    interfaces : tuple of str, optional
        Names of the interfaces met, one an event, for glasses whose interfaces have names
        (`Tumbler.interfaces`), where the events alone do not tell a path. None: whichever.
    open : bool
        Only the beginning of paths: after these events the ray may go on as it likes. What all
        paths with one beginning show on its last stretch is found once so. Needs `interfaces`.

    Raises
    ------
    ValueError
        For any other letter, if `interfaces` are not one name an event, or missing where `open`.
    """

    events: str
    interfaces: tuple[str, ...] | None = None
    open: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.events, str) or set(self.events) - {"T", "R"}:
            raise ValueError(f"events must be a string of T and R, not {self.events!r}")
        if self.interfaces is None:
            if self.open:
                raise ValueError(f"open paths need interfaces: {self.events!r}")
            return
        names = self.interfaces
        if isinstance(names, str) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"interfaces must be a tuple of names, not {names!r}")
        if len(names) != len(self.events):
            raise ValueError(f"interfaces must be one name an event of {self.events!r}: {names!r}")
        object.__setattr__(self, "interfaces", tuple(names))

    def __len__(self) -> int:
        return len(self.events)

    def __str__(self) -> str:
        """The events, with the interfaces where they are named: "T outer, T wet, R surface".

        Dots follow where the path is open.
        """
        if not self.interfaces:
            return self.events
        steps = [" ".join(step) for step in zip(self.events, self.interfaces, strict=True)]
        return ", ".join([*steps, "..."] if self.open else steps)

    def begins(self, other: "LightPath") -> bool:
        """Whether the other path starts with all of this one's events at its interfaces."""
        count = len(self)
        return other.events[:count] == self.events and (other.interfaces or ())[:count] == (
            self.interfaces or ()
        )


@dataclass(frozen=True)
class ParallelView:
    """An orthographic camera: all rays run along one direction.

    Parameters
    ----------
    direction : array_like, (3,)
        From the camera into the scene, in the glass's frame; need not be unit.

    Raises
    ------
    ValueError
        If it is not three finite numbers, or zero.
    """

    direction: tuple[float, float, float]

    def __post_init__(self) -> None:
        try:
            vector = np.asarray(self.direction, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"direction must be (3,), not {self.direction!r}") from None
        if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
            raise ValueError(
                f"direction must be three finite numbers, not all 0, not {self.direction!r}"
            )
        # Scaled first, so that the squares of tiny or huge components survive.
        vector = vector / np.abs(vector).max()
        vector = vector / np.sqrt(vector @ vector)
        object.__setattr__(self, "direction", tuple(float(part) for part in vector))


def as_path(path: LightPath | str) -> LightPath:
    """`path`, or the path of these events."""
    return path if isinstance(path, LightPath) else LightPath(path)


def as_eye(eye: ArrayLike | ParallelView) -> np.ndarray | ParallelView:
    """The viewpoint as (3,) float64, or the parallel view as it is; ValueError otherwise."""
    if isinstance(eye, ParallelView):
        return eye
    point = np.asarray(eye, dtype=float)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ValueError(f"eye must be three finite numbers, not {eye!r}")
    return point


@dataclass(frozen=True)
class Stretch:
    """A straight piece of a branch.

    `medium`: the medium it runs in. `enters` and `leaves`: whether it runs deeper (+1) or back
    out (−1) at its begin and end; a coaxial stretch that passes its nearest point to the axis
    changes from +1 to −1.
    """

    medium: int
    enters: int
    leaves: int

    @property
    def turns(self) -> bool:
        return self.enters != self.leaves


@dataclass(frozen=True)
class Branch:
    """One ordered list of (interface, event) that realises a path, with its stretches.

    The letters of a path leave open which interfaces are met: a ray that turns round in the wall
    meets the outer face where another one meets the inner. Every ray takes one branch only.
    """

    interfaces: tuple[int, ...]
    events: str
    stretches: tuple[Stretch, ...]


def branches(
    glass: Glass,
    medium: int,
    path: LightPath,
    possible: Callable[[Branch], bool] = lambda begun: True,
) -> Iterator[Branch]:
    """All branches of `path` for rays that start in `medium`.

    A branch is listed if the order of the interfaces allows it; whether any ray takes it is
    decided by its domain (ray invariants), which depends on the radii and indices. `possible`
    tells so of one that has begun: with every reflection in a wall the branches are twice as many.
    """
    innermost = len(glass.media) - 1
    flat = isinstance(glass, FlatGlass)

    def leave(where: int, heading: int) -> Iterator[int]:
        """Headings with which a stretch in medium `where` can reach its end."""
        if flat or heading < 0:
            yield heading
            return
        if where < innermost:
            yield 1
        yield -1

    def follow(where: int, heading: int, interfaces: tuple, stretches: tuple) -> Iterator[Branch]:
        done = len(interfaces)
        for leaves in leave(where, heading):
            here = (*stretches, Stretch(where, heading, leaves))
            if not possible(Branch(interfaces, path.events[:done], here)):
                continue
            escapes = where == (0 if leaves < 0 else innermost) and (flat or leaves < 0)
            if escapes or done == len(path.events):
                if escapes and done == len(path.events):
                    yield Branch(interfaces, path.events, here)
                continue
            interface = where if leaves > 0 else where - 1
            met = (*interfaces, interface)
            if path.events[done] == "R":
                yield from follow(where, -leaves, met, here)
            else:
                yield from follow(where + leaves, leaves, met, here)

    for heading in (1, -1):
        yield from follow(medium, heading, (), ())
