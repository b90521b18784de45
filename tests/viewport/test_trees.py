# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes as the shader reads them: the tree is walked as it is there, beside a plain search."""

import numpy as np
import pytest

from glass_refraction import optics
from glass_refraction.viewport.description import (
    GLASS_ROWS,
    HOLDS,
    INTERFACE_ROWS,
    MESH,
    Posed,
    common_frame,
    pack,
    trees_of,
)
from glass_refraction.viewport.trees import (
    BITS,
    LEAF,
    NODE_TEXELS,
    TRIANGLE_TEXELS,
    MeshBody,
    grow,
    halved,
    polar,
    shaped,
)


def soup(count, seed=0):
    """Small triangles all over the place, and unit normals."""
    random = np.random.default_rng(seed)
    points = random.uniform(-1.0, 1.0, (count, 1, 3)) + random.normal(0.0, 0.1, (count, 3, 3))
    normals = random.normal(size=(count, 3, 3))
    return points, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def grown(points, normals):
    *steps, tree = grow(points, normals)
    assert all(step is None for step in steps)
    return tree


def ways(points, edges, origin, direction):
    """(T,) how far along a ray each triangle is met; inf where it is not."""
    one, other = edges
    across = np.cross(direction, other)
    determinant = np.einsum("nk,nk->n", one, across)
    scale = 1.0 / np.where(determinant == 0.0, np.nan, determinant)
    away = origin - points
    u = scale * np.einsum("nk,nk->n", away, across)
    turned = np.cross(away, one)
    v = scale * (turned @ direction)
    way = scale * np.einsum("nk,nk->n", other, turned)
    met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way >= 0.0)
    return np.where(met, way, np.inf)


def walked(tree, origin, direction):
    """The nearest meeting and the triangles that were looked at, without a stack."""
    texels = tree.texels.astype(float)
    nodes = texels[: tree.triangles].reshape(-1, NODE_TEXELS, 4)
    grid, steps = nodes[0, :, :3]
    upper, lower = np.divmod(nodes, 2.0**BITS)
    third = upper[..., ::2] + 2.0 ** (BITS // 2) * upper[..., 1::2]
    boxes = np.stack((lower[..., ::2], lower[..., 1::2], third), axis=-1)
    boxes = grid + boxes / steps
    triangles = texels[tree.triangles :].reshape(-1, TRIANGLE_TEXELS, 4)[..., :3]
    nearest, seen, node, waits = np.inf, 0, 1, 0
    while True:
        down = False
        if node >= tree.leaves:
            part = triangles[LEAF * (node - tree.leaves) :][:LEAF]
            edges = part[:, 1], part[:, 2]
            nearest = min(nearest, ways(part[:, 0], edges, origin, direction).min())
            seen += LEAF
        else:
            with np.errstate(divide="ignore"):
                ends = (boxes[node] - origin) / direction
            enter = np.maximum(ends.min(axis=1).max(axis=1), 0.0)
            leave = np.minimum(ends.max(axis=1).min(axis=1), nearest)
            met = enter <= leave
            enter = np.where(met, enter, np.inf)
            down = bool(met.any())
            if down:
                node = 2 * node + int(enter[1] < enter[0])
                waits = 2 * waits + int(met.all())
        if not down:
            while waits and not waits & 1:
                waits, node = waits >> 1, node >> 1
            if not waits:
                return nearest, seen
            waits, node = waits ^ 1, node ^ 1


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 1000])
def test_the_tree_finds_what_a_plain_search_finds(count):
    points, normals = soup(count)
    tree = grown(points, normals)
    assert sorted(tree.order[tree.order >= 0]) == list(range(count))
    edges = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    random = np.random.default_rng(1)
    looked, hits = 0, 0
    for _ in range(200):
        origin, target = random.uniform(-2.0, 2.0, 3), random.uniform(-1.0, 1.0, 3)
        direction = (target - origin) / np.linalg.norm(target - origin)
        expected = ways(points[:, 0], edges, origin, direction).min()
        found, seen = walked(tree, origin, direction)
        assert found == pytest.approx(expected, abs=1e-4)
        looked += seen
        hits += np.isfinite(expected)
    if count == 1000:
        assert hits > 50
        # Most are not looked at.
        assert looked < 0.2 * 200 * count


def test_nodes_are_halved_where_rays_look_at_the_fewest_triangles():
    """Needles that lie side by side: to cut across them, the longest way, parts nothing."""
    random = np.random.default_rng(4)
    middles = random.uniform(-1.0, 1.0, (600, 1, 3)) * (1.0, 0.8, 0.8)
    needles = np.array([(-0.8, 0.0, 0.0), (0.8, 0.0, 0.0), (0.8, 0.02, 0.02)])
    points = middles + needles
    tree = grown(points, np.ones_like(points))
    looked = []
    for _ in range(100):
        origin, target = random.uniform(-2.0, 2.0, 3), random.uniform(-0.8, 0.8, 3)
        direction = (target - origin) / np.linalg.norm(target - origin)
        looked.append(walked(tree, origin, direction)[1])
    # Halved across the longest side of what they span, nine.
    assert np.mean(looked) < 7.5


def fan(count):
    """Slivers of a slanted face of many corners, all from one of them, and normals that differ."""
    angle = np.linspace(0.0, 2.0 * np.pi, count + 2, endpoint=False)
    rim = np.stack(
        (np.cos(angle), np.sin(angle), 0.3 * np.cos(angle) + 0.2 * np.sin(angle)), axis=1
    )
    points = np.stack((np.tile(rim[:1], (count, 1)), rim[1:-1], rim[2:]), axis=1)
    return points, points + np.array((0.0, 0.0, 3.0))


def looked_at(tree, count=100):
    """Triangles that rays to places near the middle look at, in the mean."""
    random = np.random.default_rng(1)
    seen = []
    for _ in range(count):
        origin, target = random.uniform(-2.0, 2.0, 3), random.uniform(-0.6, 0.6, 3)
        direction = (target - origin) / np.linalg.norm(target - origin)
        seen.append(walked(tree, origin, direction)[1])
    return np.mean(seen)


def test_pieces_are_their_triangles():
    """They cover as much, lie in the same planes, and normals run on."""
    points, normals = fan(400)
    small = 0.01 * points[:900:3] + np.random.default_rng(2).uniform(-1.0, 1.0, (134, 1, 3))
    points = np.concatenate((points[:200], np.tile(small, (4, 1, 1))))
    normals = points + np.array((0.0, 0.0, 3.0))
    pieces = halved(points)
    parts = pieces.of(points)
    assert len(points) < len(parts) <= 2 * len(points)
    # Normals of the fan are linear in the place, so those of its pieces are too.
    assert pieces.of(normals) == pytest.approx(parts + np.array((0.0, 0.0, 3.0)))

    def areas(triangles):
        return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])

    own = areas(points)
    covered = np.zeros_like(own)
    np.add.at(covered, pieces.parted, areas(parts[len(pieces.whole) :]))
    covered[pieces.whole] = own[pieces.whole]
    assert covered == pytest.approx(own, abs=1e-12)


def test_slivers_of_a_face_of_many_corners_are_not_all_looked_at():
    """One face of 160 corners beside many small triangles, as the back of a wavy pane."""
    slivers, _ = fan(160)
    small, _ = soup(6000, 3)
    points = np.concatenate((slivers, small.mean(axis=1, keepdims=True) + 0.02 * small + 4.0))
    tree = grown(points, np.ones_like(points))
    # As they are: 51.
    assert looked_at(tree) < 35.0


def test_a_deformed_mesh_keeps_its_order():
    points, normals = soup(300)
    points = np.concatenate((points, 3.0 * fan(40)[0]))
    normals = np.concatenate((normals, fan(40)[1]))
    tree = grown(points, normals)
    assert len(tree.order[tree.order >= 0]) > len(points) == tree.count
    moved = points * (1.0, 2.0, 0.5) + 0.1
    again = tree.refitted(moved, normals)
    assert again is not tree
    assert np.array_equal(again.order, tree.order)
    origin, direction = np.array((0.1, -3.0, 0.2)), np.array((0.0, 1.0, 0.0))
    edges = moved[:, 1] - moved[:, 0], moved[:, 2] - moved[:, 0]
    expected = ways(moved[:, 0], edges, origin, direction).min()
    assert walked(again, origin, direction)[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_matrix_is_a_turn_after_a_stretch(mirror):
    linear = np.array([(1.0, 0.3, -0.2), (0.1, 2.4, 0.9), (-0.3, 1.0, 0.5)])
    linear[2] *= mirror * np.sign(np.linalg.det(linear))
    turn, stretch = polar(linear)
    assert turn @ stretch == pytest.approx(linear)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    # A face that looks outwards still does, and so does its normal.
    corners = np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    form = shaped(corners[None], np.full((1, 3, 3), 3.0**-0.5), stretch)
    points = form.points[0] * form.scale + form.middle
    outward = np.cross(points[1] - points[0], points[2] - points[0])
    assert outward @ points.mean(axis=0) > 0.0
    assert form.normals[0] == pytest.approx(np.tile(outward / np.linalg.norm(outward), (3, 1)))
    assert sorted(np.linalg.norm(points @ turn.T, axis=1)) == pytest.approx(
        sorted(np.linalg.norm(corners @ linear.T, axis=1))
    )


def test_a_mesh_without_size_is_none():
    with pytest.raises(ValueError, match="no area"):
        shaped(np.zeros((1, 3, 3)), np.ones((1, 3, 3)), np.eye(3))


def test_glasses_with_one_mesh_share_its_texels():
    trees = [grown(*soup(50, seed)) for seed in range(2)]
    bodies = [
        MeshBody(trees[k], ior, 0.1, (0.1, 0.1, 0.1)) for k, ior in ((0, 1.5), (1, 1.3), (0, 1.7))
    ]
    closed = Posed(optics.body(optics.SphereGlass((0.05,), (1.4,))), np.eye(4))
    glasses = [closed, *(Posed(body, np.eye(4), priority=k) for k, body in enumerate(bodies))]
    assert trees_of(glasses) == tuple(trees)
    block = pack(glasses, common_frame(glasses))
    starts = []
    for number, body in enumerate(bodies, 1):
        record = block[1 + GLASS_ROWS * number :]
        first, count, media, _ = record[0].astype(int)
        assert count == 1
        assert block[first, 0] == MESH
        start, leaves, triangles, _ = block[first + 1].astype(int)
        assert leaves == body.tree.leaves
        assert triangles - start == NODE_TEXELS * leaves
        assert block[media + 2, 0] == pytest.approx(body.ior)
        assert int(block[media + 2, 1]) & HOLDS
        assert record[9, 0] == number - 1
        starts.append(start)
        assert first + INTERFACE_ROWS == media
    assert starts == [0, len(trees[0].texels), 0]
