# SPDX-License-Identifier: GPL-3.0-or-later
"""Large triangles in small ones: a moved triangle stays straight, and its true image is curved."""

from __future__ import annotations

import numpy as np

FINEST = 1.0 / 16.0
"""Of a glass's reach: the longest edge at the glass that is left as it is."""
BY_DISTANCE = 1.0 / 16.0
"""Of the distance from the glass: the longest edge farther off."""
ROOM = 1.5
"""Reaches of a glass: what is farther off it cannot hold, also when it has moved a little."""
MOST_TRIANGLES = 150_000
"""Of a mesh's large triangles, after which they are left as they are."""
MOST_ROUNDS = 60
"""Each round halves the longest edge of a triangle: 20 halvings of all three."""


def is_large(
    points: np.ndarray, triangles: np.ndarray, glasses: list[tuple[np.ndarray, float]]
) -> np.ndarray:
    """(T,) which triangles have an edge that is too long for one of the glasses.

    Parameters
    ----------
    points : (V, 3). triangles : (T, 3). glasses : middle and reach of each, in the points' frame.
    """
    found = np.zeros(len(triangles), bool)
    if not glasses:
        return found
    # Most triangles are small by any measure.
    shortest = FINEST * min(reach for _, reach in glasses)
    for k in range(3):
        edge = points[triangles[:, k]] - points[triangles[:, k - 1]]
        found |= np.einsum("nk,nk->n", edge, edge) > shortest**2
    some = np.flatnonzero(found)
    ends = points[triangles[some]]
    found[some] = (_excess(ends, np.roll(ends, -1, axis=1), glasses) > 1.0).any(axis=1)
    return found


def refined(
    points: np.ndarray, triangles: np.ndarray, glasses: list[tuple[np.ndarray, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of which no edge is too long.

    An edge is halved, and its halves, as long as they are too long for where they lie. Both
    triangles at an edge come to the same parts, so that no gap opens between them.
    """
    for _ in range(MOST_ROUNDS):
        if len(triangles) > MOST_TRIANGLES:
            break
        ends = points[triangles]
        excess = _excess(ends, np.roll(ends, -1, axis=1), glasses)
        length = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2)
        longest = np.where(excess > 1.0, length, 0.0).argmax(axis=1)
        split = np.flatnonzero((excess > 1.0).any(axis=1))
        if not len(split):
            break
        some = triangles[split]
        side = longest[split]
        rows = np.arange(len(split))
        a, b, c = (some[rows, (side + k) % 3] for k in range(3))
        pairs = np.sort(np.stack((a, b), axis=1), axis=1).astype(np.int64)
        _, first, new = np.unique(
            pairs[:, 0] * len(points) + pairs[:, 1], return_index=True, return_inverse=True
        )
        middles = 0.5 * (points[pairs[first, 0]] + points[pairs[first, 1]])
        new = new.reshape(-1) + len(points)
        points = np.concatenate((points, middles))
        halves = np.concatenate((np.stack((a, new, c), axis=1), np.stack((new, b, c), axis=1)))
        kept = np.delete(triangles, split, axis=0)
        triangles = np.concatenate((kept, halves.astype(triangles.dtype)))
    return points, triangles


def is_far(
    points: np.ndarray, triangles: np.ndarray, glasses: list[tuple[np.ndarray, float]]
) -> np.ndarray:
    """(T,) which triangles, none of them large, no glass can hold, even if it moves a little."""
    far = np.ones(len(triangles), bool)
    for centre, reach in glasses:
        away = np.linalg.norm(points - centre, axis=1)
        far &= (away[triangles] > ROOM * reach).all(axis=1)
    return far


def _excess(begin: np.ndarray, end: np.ndarray, glasses) -> np.ndarray:
    """How much longer edges (…, 3) are than they may be, for the glass that allows least."""
    length = np.linalg.norm(end - begin, axis=-1)
    middle = 0.5 * (begin + end)
    found = np.zeros(length.shape)
    for centre, reach in glasses:
        away = np.maximum(np.linalg.norm(middle - centre, axis=-1) - reach, 0.0)
        found = np.maximum(found, length / np.maximum(FINEST * reach, BY_DISTANCE * away))
    return found
