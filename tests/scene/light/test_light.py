# SPDX-License-Identifier: GPL-3.0-or-later
"""Light through the glass in whole pictures: against closed forms, plain Snell and itself."""

import itertools

import bpy
import numpy as np
import pytest
import scenes

from glass_refraction.optics import fresnel
from glass_refraction.scene import update as door
from glass_refraction.scene.build.own_scenes import find_own_scenes
from glass_refraction.scene.light import density as densities
from glass_refraction.scene.light.density import Seen, density
from glass_refraction.scene.light.landed import Landed
from glass_refraction.scene.memory import counters
from glass_refraction.scene.rays import frame as frames
from glass_refraction.scene.rays import true
from glass_refraction.scene.rays.views import RadianceView
from glass_refraction.scene.read.modifier_inputs import glass_modifier, write_input
from glass_refraction.scene.read.viewpoint import read_viewpoint

TINT = np.array([0.9, 0.5, 0.2])


def _diffuse(reflectance=1.0):
    material = bpy.data.materials.new("White")
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*(reflectance,) * 3, 1.0)
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], end.inputs["Surface"])
    return material


def _lamp(kind, location=(0.0, 0.0, 2.0), tilt=0.0, **values):
    data = bpy.data.lights.new("Lamp", kind)
    for name, value in values.items():
        setattr(data, name, value)
    obj = bpy.data.objects.new("Lamp", data)
    obj.location, obj.rotation_euler = location, (0.0, tilt, 0.0)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _floor(width=60, height=45, wide=0.4, size=4.0, **settings):
    """A white floor seen squarely from 3 m above, by direct light alone."""
    camera = scenes.camera(location=(0.0, 0.0, 3.0), tilt=0.0, type="ORTHO", ortho_scale=wide)
    camera.data.clip_end = 10.0
    bpy.ops.mesh.primitive_plane_add(size=size)
    bpy.context.object.data.materials.append(_diffuse())
    scene = scenes.settings(width, height, samples=4, shading="TRUE", **settings)
    scene.eevee.taa_render_samples = 4
    scene.world = None
    scene.cycles.max_bounces = 0
    scene.refractive_glass.light_rays = 20_000
    return scene


def _both(scene, folder):
    """The picture without and with what glasses do to the light."""
    scene.refractive_glass.shadow = "STRAIGHT"
    plain = scenes.picture(scene, folder, "plain")
    scene.refractive_glass.shadow = "LIGHT"
    return plain, scenes.picture(scene, folder, "lit")


def _pane(height=0.5, radius=0.5, thickness=0.01):
    obj = scenes.glass(shape="SLAB", radius=radius, wall_thickness=thickness, ior=1.5)
    # Not before the camera: what is seen through it is tested elsewhere.
    obj.location.z = height
    return obj


def _slab_transmittance(cosine, depth=0.0):
    """Of all ways through a slab together: (1 − F)² a / (1 − F² a²), a = exp(−depth)."""
    reflected, left = fresnel(cosine, 1 / 1.5), np.exp(-depth)
    return (1 - reflected) ** 2 * left / (1 - (reflected * left) ** 2)


# ------------------------------------------------------------------------------------ closed forms


@pytest.mark.parametrize(
    ("engine", "angle"), [("CYCLES", 0.0), ("CYCLES", 1.1), ("BLENDER_EEVEE", 0.6)]
)
def test_a_panes_shadow_is_what_fresnel_and_beer_leave(tmp_path, engine, angle):
    scene = _floor(min_weight=1e-3)
    if engine == "BLENDER_EEVEE":
        scenes.coarse_eevee(scene)
    scene.render.engine = engine
    # Below the pane, whose shadow is in the picture; what its narrow sides turn aside falls beside.
    scene.camera.location.z = 0.4
    pane = _pane()
    pane.location.x = 0.5 * np.tan(angle) + 0.1
    modifier = glass_modifier(pane)
    write_input(modifier, "Absorption Color", (*TINT, 1.0))
    write_input(modifier, "Absorption Distance", 0.01)
    _lamp("SUN", tilt=angle, angle=0.02, energy=np.pi / np.cos(angle))
    plain, lit = _both(scene, tmp_path)
    np.testing.assert_allclose(plain[..., :3], 1.0, atol=0.01)
    inside = np.sqrt(1 - (np.sin(angle) / 1.5) ** 2)
    expected = _slab_transmittance(np.cos(angle), -np.log(TINT) / inside)
    left = lit[..., :3] / plain[..., :3].mean()
    np.testing.assert_allclose(left.mean(axis=(0, 1)), expected, rtol=4e-3)
    assert np.abs(left - expected).max() < 0.02


@pytest.mark.parametrize(
    ("engine", "kind", "values"),
    [
        ("CYCLES", "POINT", {"shadow_soft_size": 0.0}),
        ("CYCLES", "SPOT", {"shadow_soft_size": 0.02, "spot_size": 0.6, "spot_blend": 0.4}),
        ("CYCLES", "AREA", {"shape": "DISK", "size": 0.4}),
        ("BLENDER_EEVEE", "AREA", {"shape": "RECTANGLE", "size": 0.1, "size_y": 0.3}),
    ],
)
def test_every_kind_of_lamp_gives_what_its_engine_gives(tmp_path, engine, kind, values):
    scene = _floor(min_weight=1e-3)
    if engine == "BLENDER_EEVEE":
        scenes.coarse_eevee(scene)
    scene.render.engine = engine
    scene.cycles.samples = 64
    scene.camera.location.z = 0.4
    _pane(thickness=1e-3)
    place = np.array((0.2, 0.1, 1.5))
    _lamp(kind, place, tilt=0.1, energy=30.0, **values)
    plain, lit = _both(scene, tmp_path)
    row, column = np.mgrid[:45, :60]
    x, y = (column - 29.5) * 0.4 / 60, (row - 22) * 0.4 / 60
    cosine = place[2] / np.sqrt((x - place[0]) ** 2 + (y - place[1]) ** 2 + place[2] ** 2)
    expected = _slab_transmittance(cosine.ravel()).reshape(cosine.shape)
    bright = plain[..., 1] > 0.5 * plain[..., 1].max()
    assert bright.mean() > 0.3
    ratio = lit[bright][:, 1] / plain[bright][:, 1] / expected[bright]
    assert abs(ratio.mean() - 1.0) < 0.01
    # The pane's narrow sides throw faint streaks.
    assert np.quantile(np.abs(ratio - 1.0), 0.95) < 0.02


RADIUS, IOR = 0.05, 1.5


def _ball_light(depth, half_angle, edges, count=300_000):
    """Irradiance by rings on a floor ``depth`` below a ball's centre: by plain Snell and chance."""
    rng = np.random.default_rng(5)
    aside = RADIUS * np.sqrt(rng.random(count))
    turn = 2 * np.pi * rng.random((2, count))
    slope = np.tan(half_angle) * np.sqrt(rng.random(count))
    along = np.stack((slope * np.cos(turn[0]), slope * np.sin(turn[0]), -np.ones(count)), axis=1)
    along /= np.linalg.norm(along, axis=1)[:, None]
    place = np.stack((aside * np.cos(turn[1]), aside * np.sin(turn[1]), np.zeros(count)), axis=1)
    back = (place * along).sum(axis=1)
    inner = back**2 - (place**2).sum(axis=1) + RADIUS**2
    meets = inner > 0.0
    along = along[meets]
    place = place[meets] + along * (-back[meets] - np.sqrt(inner[meets]))[:, None]
    light = np.full(len(place), np.pi * RADIUS**2 / count)
    sums = np.zeros(len(edges) - 1)

    def land(directions, lights):
        down = directions[:, 2] < -1e-9
        way = -(place[down, 2] + depth) / directions[down, 2]
        there = place[down, :2] + way[:, None] * directions[down, :2]
        sums[:] += np.histogram(np.hypot(*there.T), edges, weights=lights[down])[0]

    normal = place / RADIUS
    cosine = -(along * normal).sum(axis=1)
    mirrored = fresnel(cosine, 1 / IOR)
    land(along + 2 * cosine[:, None] * normal, light * mirrored)
    inside = np.sqrt(1 - (1 - cosine**2) / IOR**2)
    along = along / IOR + (cosine / IOR - inside)[:, None] * normal
    light = light * (1 - mirrored)
    for _ in range(8):
        place = place - 2 * (place * along).sum(axis=1)[:, None] * along
        normal = -place / RADIUS
        inner = -(along * normal).sum(axis=1)
        outer = np.sqrt(np.maximum(1 - IOR**2 * (1 - inner**2), 0.0))
        land(along * IOR + (IOR * inner - outer)[:, None] * normal, light * (1 - mirrored))
        light = light * mirrored
        along = along + 2 * inner[:, None] * normal
    return sums / (np.pi * np.diff(edges**2))


@pytest.mark.parametrize("depth", [0.055, 0.09, 0.16])
def test_a_ball_gathers_light_as_snell_says(tmp_path, monkeypatch, depth):
    """Before, near and behind its focus, n R / 2 (n − 1) = 75 mm below its centre."""
    scene = _floor(160, 160, wide=0.15, min_weight=2e-3)
    scene.refractive_glass.light_rays = 80_000
    ball = scenes.glass(shape="SPHERE", radius=RADIUS, wall_thickness=0.0, ior=IOR)
    ball.location.z = depth
    half = np.radians(0.5)
    _lamp("SUN", angle=2 * half, energy=np.pi)
    maps = _maps(monkeypatch)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    row, column = np.mgrid[:160, :160]
    ring = np.hypot(row - 79.5, column - 79.5) * 0.15 / 160
    edges = np.concatenate((np.linspace(0.0, 0.046, 12), np.linspace(0.056, 0.074, 5)))
    ours = np.array(
        [maps[0][0][(ring >= a) & (ring < b)].mean() for a, b in itertools.pairwise(edges)]
    )
    expected = _ball_light(depth, half, edges)
    expected[edges[1:] <= RADIUS - 0.003] -= 1.0
    clear = np.ones(len(ours), bool)
    # Between lies the edge of the straight shadow.
    clear[11] = False
    assert np.abs(ours - expected)[clear].mean() < 0.03 * np.abs(expected[clear]).mean()
    assert np.abs(ours - expected)[clear & (edges[:-1] > 0.008)].max() < 0.1


TUBE, WALL, WATER = 0.04, 0.003, 1.333


def _tube_light(depth, half_angle, edges, count=200_000):
    """What a lying tube of water changes, by strips of a floor ``depth`` below its axis.

    By Snell in its cross-section; slopes along the tube are too small to count.
    """
    rng = np.random.default_rng(5)
    radii, iors = (TUBE, TUBE - WALL), (1.0, IOR, WATER)
    slope = np.tan(half_angle) * np.sqrt(rng.random(count)) * np.cos(2 * np.pi * rng.random(count))
    along = np.stack((slope, -np.ones(count)), axis=1)
    along /= np.linalg.norm(along, axis=1)[:, None]
    aside = TUBE * (2 * (np.arange(count) + rng.random(count)) / count - 1)
    place = aside[:, None] * np.stack((-along[:, 1], along[:, 0]), axis=1)
    sums = np.zeros(len(edges) - 1)

    def land(place, along, light):
        down = along[:, 1] < -1e-9
        way = -(place[down, 1] + depth) / along[down, 1]
        there = place[down, 0] + way * along[down, 0]
        sums[:] += np.histogram(there, edges, weights=light[down])[0]

    light = np.full(count, 2 * TUBE / count)
    land(place, along, -light)
    place = place - 2 * TUBE * along
    # The medium a ray is in: 0 outside, 1 in the wall, 2 in the water.
    medium = np.zeros(count, int)
    for _ in range(12):
        middle = (place * along).sum(axis=1)
        apart = middle**2 - (place**2).sum(axis=1)
        way, circle = np.full(len(place), np.inf), np.zeros(len(place), int)
        for number, radius in enumerate(radii):
            inner = apart + radius**2
            for sign in (-1, 1):
                found = -middle + sign * np.sqrt(np.maximum(inner, 0.0))
                nearer = (inner > 0.0) & (found > 1e-9) & (found < way)
                way[nearer], circle[nearer] = found[nearer], number
        left = np.isinf(way)
        land(place[left], along[left], light[left])
        place, along, light, medium, way, circle = (
            part[~left] for part in (place, along, light, medium, way, circle)
        )
        place = place + way[:, None] * along
        normal = place / np.linalg.norm(place, axis=1)[:, None]
        normal *= -np.sign((normal * along).sum(axis=1))[:, None]
        cosine = -(along * normal).sum(axis=1)
        beyond = np.where(medium == circle, circle + 1, circle)
        eta = np.take(iors, medium) / np.take(iors, beyond)
        mirrored = fresnel(cosine, eta)
        through = np.sqrt(np.maximum(1 - eta**2 * (1 - cosine**2), 0.0))
        bent = eta[:, None] * along + (eta * cosine - through)[:, None] * normal
        mirror = along + 2 * cosine[:, None] * normal
        place, along = np.concatenate((place, place)), np.concatenate((bent, mirror))
        light = np.concatenate((light * (1 - mirrored), light * mirrored))
        medium = np.concatenate((beyond, medium))
        strong = light > 1e-3 * 2 * TUBE / count
        place, along, light, medium = (part[strong] for part in (place, along, light, medium))
    return sums / np.diff(edges)


@pytest.mark.parametrize("depth", [0.045, 0.1])
def test_a_tube_of_water_gathers_light_as_snell_says(tmp_path, monkeypatch, depth):
    """Its caustic's edges too, before and behind where its light crosses."""
    width, wide = 160, 0.12
    scene = _floor(width, 24, wide=wide, min_weight=2e-3)
    scene.refractive_glass.light_rays = 80_000
    tube = scenes.glass(
        shape="CYLINDER", radius=TUBE, wall_thickness=WALL, height=0.12, ior=IOR, contents_ior=WATER
    )
    tube.location, tube.rotation_euler = (0.0, 0.06, depth), (np.pi / 2, 0.0, 0.0)
    half = np.radians(0.4)
    _lamp("SUN", angle=2 * half, energy=np.pi)
    maps = _maps(monkeypatch)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    ours = maps[0][0][..., 0].mean(axis=0)
    # As the pixel filter sees it, which is a bell of 0.42 pixels.
    fine = 10
    expected = _tube_light(depth, half, np.linspace(-wide / 2, wide / 2, width * fine + 1))
    bell = np.exp(-0.5 * (np.arange(-30, 31) / (0.417 * fine)) ** 2)
    expected = np.convolve(expected, bell / bell.sum(), "same")
    there = (np.arange(width * fine) + 0.5) / fine
    at = np.arange(width) + 0.5
    middle = slice(3, -3)
    error = np.abs(ours - np.interp(at, there, expected))[middle]
    assert error.mean() < 0.03 * np.abs(expected).mean()
    for ours_at, expected_at in zip(_edges(at, ours), _edges(there, expected), strict=True):
        assert abs(ours_at - expected_at) < 1.0


def _edges(at, light):
    """Where light falls to half of its maximum, left and right of the middle's brightest place."""
    level = 0.5 * light.max()
    above = np.flatnonzero(light > level)
    found = []
    for inner, outer in ((above[0], above[0] - 1), (above[-1], above[-1] + 1)):
        part = (light[inner] - level) / (light[inner] - light[outer])
        found.append(at[inner] + part * (at[outer] - at[inner]))
    return found


def _maps(monkeypatch):
    """What every frame adds to the light of white surfaces, over π; the last frame's last."""
    found = []
    computed = frames.light_maps

    def keep(*given):
        found.append(computed(*given))
        return found[-1]

    monkeypatch.setattr(frames, "light_maps", keep)
    return found


def test_a_sun_along_a_rods_axis_shines_through_its_ends(tmp_path, monkeypatch):
    scene = _floor(wide=0.05, min_weight=1e-3)
    scenes.glass(shape="ROD", radius=0.04, height=0.1, ior=IOR).location.z = 0.01
    _lamp("SUN", angle=1e-3, energy=np.pi)
    maps = _maps(monkeypatch)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    np.testing.assert_allclose(maps[0][0] + 1.0, _slab_transmittance(1.0), atol=0.01)


# --------------------------------------------------------------------------------------------- laws


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_light_through_a_scaled_glass_is_the_same_light(tmp_path, monkeypatch, factor):
    """A sun knows no size: a scene that is scaled as a whole looks alike."""
    scene = _floor(48, 48, wide=0.2)
    glass = scenes.glass(shape="CYLINDER", radius=0.03, height=0.08, contents_ior=WATER)
    glass.location = (-0.03, 0.0, 0.01)
    _lamp("SUN", tilt=-0.6, angle=0.02, energy=np.pi)
    maps = _maps(monkeypatch)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    camera = scene.camera
    for obj in scene.objects:
        obj.location *= factor
        if obj.type == "MESH":
            obj.scale *= factor
    camera.data.ortho_scale *= factor
    camera.data.clip_start *= factor
    camera.data.clip_end *= factor
    scenes.picture(scene, tmp_path)
    plain, scaled = (found[0] for found in maps)
    assert plain.max() > 0.5 and plain.min() < -0.5
    assert np.sqrt(((scaled - plain) ** 2).mean()) < 1e-3


def test_in_a_closed_box_all_light_that_is_taken_is_put(monkeypatch, tmp_path):
    from glass_refraction.scene.light import light as module

    landed = []
    follow = module.follow_light

    def keep(*given):
        landed.append(follow(*given))
        return landed[-1]

    monkeypatch.setattr(module, "follow_light", keep)
    scenes.camera(location=(0.0, -0.4, 0.1))
    bpy.ops.mesh.primitive_cube_add(size=1.0)
    bpy.context.object.data.materials.append(_diffuse())
    scenes.glass(shape="CYLINDER", radius=0.04)
    rod = scenes.glass(shape="ROD", radius=0.02)
    rod.location.x = 0.1
    _lamp("POINT", (0.2, 0.1, 0.35), shadow_soft_size=0.02)
    _lamp("AREA", (-0.1, -0.2, 0.4), size=0.1)
    scene = scenes.settings(32, 24, shading="TRUE", shadow="LIGHT")
    scenes.picture(scene, tmp_path)
    assert len(landed) == 2
    for found in landed:
        light = found.flux.sum(axis=1)
        taken, put = -light[light < 0.0].sum(), light[light > 0.0].sum()
        assert taken > 0.0
        assert abs(put / taken - 1.0) < 5e-3


def test_bells_bring_all_their_light_to_the_pixels(monkeypatch, tmp_path):
    """A ball's whole light on a floor: what it adds in the picture is what it takes, but for what
    it sends up."""
    scene = _floor(96, 96, wide=1.2)
    ball = scenes.glass(shape="SPHERE", radius=RADIUS, wall_thickness=0.0, ior=IOR)
    ball.location.z = 0.1
    _lamp("SUN", angle=0.01, energy=np.pi)
    maps = _maps(monkeypatch)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    expected = _ball_light(0.1, 0.005, np.array((0.0, 0.6)))[0] * np.pi * 0.36
    added = maps[-1][0][..., 0].sum() * (1.2 / 96) ** 2 + np.pi * RADIUS**2
    assert added == pytest.approx(expected, rel=0.005)


def _on_a_floor(landed, width=64):
    """Irradiance of landed light on a floor of 1 m, seen squarely; bells and pixels summed."""
    eye, to_camera = np.array((0.0, 0.0, 1.0)), np.eye(4)
    to_camera[2, 3] = -1.0
    frame = (0, 0, width, width)
    view = RadianceView(
        eye, to_camera, np.diag((2.0, 2.0, 0.0, 1.0)), frame[2:], frame, frame, 0.1, True
    )
    row, column = np.mgrid[:width, :width]
    points = np.stack(((column + 0.5) / width - 0.5, (row + 0.5) / width - 0.5, 0.0 * row), -1)
    points = points.reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    counters["bells"] = counters["bell_pixels"] = 0
    seen = Seen.of(view, None, np.arange(len(points)), points, normals)
    return density(landed, seen, 0.4), counters["bells"], counters["bell_pixels"]


def _landed(count, major, minor, place=(0.1, 0.0, 0.0)):
    ones = np.ones((count, 3))
    axes = [length * ones * axis for length, axis in zip((major, minor), np.eye(3), strict=False)]
    return Landed(ones * place, ones * (0.0, 0.0, 1.0), ones / count, *axes, np.ones(count))


def test_bells_that_lie_together_cost_as_one():
    one, bells, pixels = _on_a_floor(_landed(1, 0.02, 0.015))
    many, *cost = _on_a_floor(_landed(20_000, 0.02, 0.015))
    assert one.sum() / 64**2 == pytest.approx(3.0, rel=0.01)
    np.testing.assert_allclose(many, one, rtol=1e-4, atol=1e-6)
    assert cost == [bells, pixels] and bells == 1


def test_bells_side_by_side_keep_their_light_and_its_spread():
    """Those of a cell are taken as one with their moments."""
    rng = np.random.default_rng(1)
    places = np.concatenate((0.1 * rng.standard_normal((5000, 2)), np.zeros((5000, 1))), axis=1)
    light, bells, _ = _on_a_floor(_landed(5000, 0.01, 0.0, places))
    column = (np.arange(64) + 0.5) / 64 - 0.5
    grey = light[..., 0] / light[..., 0].sum()
    assert light.sum() / 64**2 == pytest.approx(3.0, rel=0.01)
    np.testing.assert_allclose((grey * column).sum(), places[:, 0].mean(), atol=2e-4)
    spread = np.sqrt((grey * column**2).sum())
    expected = np.sqrt((places[:, 0] ** 2).mean() + 0.01**2 + (0.4 / 64) ** 2)
    assert spread == pytest.approx(expected, rel=0.01)
    assert bells < 5000


@pytest.mark.parametrize("apart", [0.75, 1.0, 1.25])
def test_even_light_is_even(apart):
    """Bells on a lattice, by its steps over their standard deviation: no end of one is seen."""
    sigma = 0.02
    row, column = np.mgrid[-60:61, -60:61] * apart * sigma
    places = np.stack((row, column, 0.0 * row), axis=-1).reshape(-1, 3)
    light, _, _ = _on_a_floor(_landed(len(places), sigma, sigma, places))
    middle = light[16:-16, 16:-16]
    expected = 1.0 / len(places) / (apart * sigma) ** 2
    assert middle.mean() == pytest.approx(expected, rel=2e-3)
    assert np.abs(middle / expected - 1.0).max() < 5e-3


@pytest.mark.parametrize("is_parallel", [False, True])
@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_a_wide_bell_is_round_on_its_floor_from_near_by(monkeypatch, tilt, is_parallel):
    """Perspective widens what is farther away; what each pixel shows is a Gauss bell's place."""
    monkeypatch.setattr(densities, "FINEST_PX", 100.0)
    width, sigma, away = 64, 0.05, 0.3
    to_camera, projection = np.eye(4), np.diag((2.0, 2.0, 1.0, 0.0))
    forward = np.array((0.0, np.sin(tilt), -np.cos(tilt)))
    to_camera[:3, :3] = (1.0, 0.0, 0.0), (0.0, np.cos(tilt), np.sin(tilt)), -forward
    to_camera[2, 3] = -away
    projection[3] = (0.0, 0.0, 0.0, 1.0) if is_parallel else (0.0, 0.0, -1.0, 0.0)
    frame = (0, 0, width, width)
    eye = -away * forward
    view = RadianceView(eye, to_camera, projection, frame[2:], frame, frame, 0.1, is_parallel)
    row, column = np.mgrid[:width, :width].reshape(2, -1) + 0.5
    origins, directions = view.rays(np.stack((column, row), axis=1))
    points = origins - directions * (origins[:, 2:] / directions[:, 2:])
    met = np.flatnonzero(directions[:, 2] < 0.0)
    normals = np.broadcast_to((0.0, 0.0, 1.0), (len(met), 3))
    seen = Seen.of(view, None, met, points[met], normals)
    found = density(_landed(1, sigma, sigma, (0.0, 0.0, 0.0)), seen, 0.01)[..., 0].ravel()
    aside, wide = np.linalg.norm(points, axis=1), densities.WIDTH * sigma
    # Farther out its picture ends.
    middle = np.flatnonzero(aside < 1.5 * sigma)
    bell = np.exp(-0.5 * (aside[middle] / wide) ** 2) - densities.LEFT
    expected = bell / (2.0 * np.pi * densities.WITHIN * wide**2)
    assert len(middle) > 30
    np.testing.assert_allclose(found[middle], expected, rtol=0.01)


@pytest.mark.parametrize("long", [0.3, 10.0, 1e4])
def test_a_long_bell_costs_no_more_than_its_row(long):
    light, bells, pixels = _on_a_floor(_landed(1, long, 1e-3))
    assert np.isfinite(light).all() and light.max() > 0.0
    assert bells <= 32
    assert pixels < 32 * 13**2


# ------------------------------------------------------------------------------ switched on and off


def test_when_off_nothing_of_it_is_there(tmp_path):
    scene = _floor()
    _pane()
    _lamp("SUN", energy=np.pi)
    layer = scene.view_layers[0]
    before = scenes.picture(scene, tmp_path)
    assert not layer.use_pass_diffuse_color
    done, images = counters.copy(), len(bpy.data.images)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    assert layer.use_pass_diffuse_color
    assert len(bpy.data.images) > images
    scene.refractive_glass.shadow = "STRAIGHT"
    np.testing.assert_array_equal(scenes.picture(scene, tmp_path), before)
    assert not layer.use_pass_diffuse_color
    captures = find_own_scenes(scene, ("capture",))
    assert not any(c.view_layers[0].use_pass_diffuse_color for c in captures)
    assert counters["structures"] == done["structures"] + 2
    done = counters.copy()
    scenes.picture(scene, tmp_path)
    assert counters["structures"] == done["structures"]


@pytest.mark.parametrize("name", ["ViewLayer", "Renamed meanwhile"])
@pytest.mark.parametrize("kept", [False, True])
def test_the_users_own_pass_is_left_as_it_is(kept, name):
    scene = _floor()
    _pane()
    layer = scene.view_layers[0]
    layer.use_pass_diffuse_color = kept
    scene.refractive_glass.shadow = "LIGHT"
    door.prepare(scene, scenes.depsgraph())
    assert layer.use_pass_diffuse_color
    layer.name = name
    door.prepare(scene, scenes.depsgraph())
    assert layer.use_pass_diffuse_color
    door.remove(scene)
    assert layer.use_pass_diffuse_color == kept


def test_a_glass_that_goes_takes_its_light_along(tmp_path):
    scene = _floor(32, 24)
    scene.refractive_glass.shadow = "LIGHT"
    scene.camera.location.z = 0.4
    _lamp("SUN", energy=np.pi)
    glass = _pane()
    scenes.glass(shape="ROD", radius=0.01).location = (5.0, 0.0, 0.0)
    scenes.key(glass, "hide_render", [False, True, False])
    found = []
    for frame in scenes.FRAMES:
        scene.frame_set(frame)
        found.append(scenes.picture(scene, tmp_path)[..., :3].mean())
    assert found[0] == pytest.approx(found[2])
    assert found[0] < 0.95 < found[1]


@pytest.mark.in_turn(4)
@pytest.mark.parametrize("moves", ["thing", "lamp", "lamp's parent", "glass"])
def test_a_frame_of_an_animation_is_the_frame_alone(tmp_path, moves):
    scene = _floor(32, 24)
    scene.refractive_glass.light_rays = 5000
    scene.refractive_glass.shadow = "LIGHT"
    glass = scenes.glass(shape="ROD", radius=0.03)
    lamp = _lamp("AREA", (0.3, 0.0, 0.5), tilt=0.5, size=0.1, energy=5.0)
    bpy.ops.mesh.primitive_cube_add(size=0.03, location=(-0.1, 0.0, 0.05))
    thing = bpy.context.object
    thing.data.materials.append(_diffuse(0.5))
    moved = {"thing": thing, "lamp": lamp, "lamp's parent": lamp, "glass": glass}[moves]
    if "parent" in moves:
        moved = lamp.parent = bpy.data.objects.new("Parent", None)
        bpy.context.scene.collection.objects.link(moved)
    steps = np.array([(0.0, 0.0, 0.0), (0.0, 0.02, 0.0), (0.02, 0.0, 0.01)])
    scenes.key(moved, "location", np.array(moved.location) + steps)
    together = []
    for frame in scenes.FRAMES:
        scene.frame_set(frame)
        together.append(scenes.picture(scene, tmp_path))
    for frame, found in zip(scenes.FRAMES, together, strict=True):
        door.forget(scene)
        scene.frame_set(frame)
        np.testing.assert_array_equal(scenes.picture(scene, tmp_path), found)
    assert np.abs(together[0] - together[2]).max() > 0.01


def test_ways_are_followed_once_while_lamp_and_glass_stay(tmp_path):
    scene = _floor(32, 24)
    scene.refractive_glass.light_rays = 5000
    scene.refractive_glass.shadow = "LIGHT"
    _pane()
    _lamp("SUN", angle=0.01)
    scenes.picture(scene, tmp_path)
    followed = counters["exit_rays"]
    scenes.picture(scene, tmp_path)
    # The picture's own finer rays are kept too.
    assert counters["exit_rays"] == followed


def test_all_places_of_a_lamp_are_followed_together(tmp_path):
    scene = _floor(32, 24)
    scene.refractive_glass.light_rays = 5000
    scene.refractive_glass.shadow = "LIGHT"
    scenes.glass(shape="ROD", radius=0.03)
    lamp = _lamp("SUN", angle=0.0)
    casts = []
    # One place, and nine.
    for angle in (0.0, 0.01):
        lamp.data.angle = angle
        door.forget(scene)
        before = counters["casts"]
        scenes.picture(scene, tmp_path)
        casts.append(counters["casts"] - before)
    assert casts[1] <= casts[0] + 2


# ------------------------------------------------------------------------------------- what is told


def test_a_setting_that_comes_too_late_for_a_render_is_told(tmp_path):
    """F12 right after a change: its thread finds what stood before, and can build nothing."""
    scene = _floor()
    _pane()
    _lamp("SUN")
    scene.refractive_glass.shadow = "STRAIGHT"
    door.prepare(scene, bpy.context.evaluated_depsgraph_get(), strict=True)
    found = []
    for shadow, ready in (("STRAIGHT", True), ("LIGHT", False)):
        scene.refractive_glass.shadow = shadow
        depsgraph = bpy.context.evaluated_depsgraph_get()
        status = true.update(scene, depsgraph, read_viewpoint(scene, depsgraph))
        found.append((true.UNREADY in status.problems) != ready)
    assert all(found)


def test_workbench_says_that_it_has_no_lamps(tmp_path):
    scene = _floor()
    _pane()
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    assert any("no lamps" in problem for problem in door.status(scene).problems)
    assert not scene.view_layers[0].use_pass_diffuse_color


def test_a_straight_shadow_beside_the_light_is_told(tmp_path):
    scene = _floor(16, 12)
    pane = _pane()
    write_input(glass_modifier(pane), "Casts Shadow", True)
    scene.refractive_glass.shadow = "LIGHT"
    scenes.picture(scene, tmp_path)
    assert any("Casts Shadow" in problem for problem in door.status(scene).problems)


@pytest.mark.parametrize("values", [{"energy": np.pi, "use_shadow": False}, {"energy": 0.0}])
def test_a_lamp_that_casts_no_shadow_shines_through(tmp_path, values):
    scene = _floor()
    _pane()
    _lamp("SUN", **values)
    plain, lit = _both(scene, tmp_path)
    np.testing.assert_array_equal(plain, lit)
    assert door.status(scene).problems == []


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.06), (0.0, 0.0, 0.11), (0.0, 0.0, 0.0)])
def test_a_lamp_in_or_on_a_glass_lights_what_is_round_it(tmp_path, place):
    scene = _floor(32, 24)
    glass = scenes.glass(shape="CYLINDER", radius=0.04, height=0.1)
    glass.location.z = 0.01
    _lamp("POINT", place, shadow_soft_size=0.005, energy=1.0)
    _, lit = _both(scene, tmp_path)
    assert np.isfinite(lit).all()
    assert door.status(scene).problems == []
