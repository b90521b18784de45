# SPDX-License-Identifier: GPL-3.0-or-later
"""What will be rendered for displaced copies: decided once, then read by all that build and write.

Nothing of it depends on what one frame shows. Each glass has a fixed number of slots for light
paths and a copy for each slot and source; a frame gives its paths to slots and leaves the others
empty.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pane:
    """One glass in light of one colour.

    Attributes
    ----------
    number : among all panes of the scene; own layers and images are found by it.
    band : "red", "green" or "blue"; empty where light of all colours goes one way.
    slots : light paths that a frame may show.
    open_slots : how many of these, the last ones, are for open paths, which end in what the glass
        holds.
    """

    number: int
    band: str
    slots: int
    open_slots: int = 0

    @property
    def whole_slots(self) -> int:
        """How many slots are for paths that leave the glass."""
        return self.slots - self.open_slots

    def layer(self, slot: int) -> str:
        """Name of the view layer of one slot's copies."""
        return f"{self.number} {slot}"


@dataclass(frozen=True)
class GlassPlan:
    """One glass.

    Attributes
    ----------
    number : among the glasses of the scene.
    uid, name : the object's session uid, and what it is called, for messages.
    panes : one, or three where the glass may disperse light.
    sources : session uids of the objects that may be seen through it.
    """

    number: int
    uid: int
    name: str
    panes: tuple[Pane, ...]
    sources: tuple[int, ...]

    @property
    def mask_layer(self) -> str:
        """Name of the view layer that shows where the glass is seen."""
        return f"{self.number}"


@dataclass(frozen=True)
class Plan:
    """The whole scene.

    Attributes
    ----------
    beyond : what is seen where no copy covers a path's region: ``WORLD`` its one colour,
        ``DIRECT`` the direct picture (a world of many colours), ``NOTHING`` a transparent film.
    """

    glasses: tuple[GlassPlan, ...]
    beyond: str

    @property
    def panes(self) -> tuple[Pane, ...]:
        """All panes, by their numbers."""
        return tuple(pane for glass in self.glasses for pane in glass.panes)

    @property
    def structure(self) -> tuple:
        """What view layers and nodes depend on; sources come and go without."""
        return (self.beyond, tuple(glass.panes for glass in self.glasses))

    @property
    def sources(self) -> tuple[int, ...]:
        """Session uids of all objects that are seen through any glass, each once."""
        return tuple(dict.fromkeys(uid for glass in self.glasses for uid in glass.sources))
