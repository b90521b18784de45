# SPDX-License-Identifier: GPL-3.0-or-later
"""Demo scene `diamond`: a brilliant of 58 facets under a studio's sky.

The cut is cut: planes take away what is beyond them. Diamond bends light so much that most of it is
reflected totally, again and again, and red, green and blue part.

    python demo_scenes/diamond.py [-o FILE] [--unlit]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import common  # the script's own folder is not on the path when it is imported

IOR, ABBE = 2.4175, 55.0
# Metres; a gem for a museum.
RADIUS = 0.02
# Of the girdle's radius: half the table, half the girdle's thickness.
TABLE, GIRDLE, GIRDLE_SIDES = 0.56, 0.02, 64
# Angles to the girdle's plane of each kind of facet (round brilliant after Tolkowsky, 1919).
CROWN, STAR, UPPER = (math.radians(a) for a in (34.5, 21.5, 40.0))
PAVILION, LOWER = math.radians(40.75), math.radians(41.8)
TILT, TURN = math.radians(-28.0), math.radians(11.0)
EYE = (0.0, -0.16, 0.10)


def build(*, unlit: bool = False, with_glass: bool = True) -> bpy.types.Scene:
    """Build the scene from an empty file and return it.

    ``unlit``: the ground emits its texture; the sky is seen either way.
    ``with_glass``: add the diamond.
    """
    scene = common.empty_scene("diamond")
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    ground = common.quad("Ground", (-0.5, -0.5, -0.03), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    ground.materials.append(common.material("Slate", (0.05, 0.055, 0.065), unlit=unlit))
    common.link(scene, "Ground", ground)
    common.sky_world(scene)
    common.camera(scene, EYE, (0.0, 0.0, 0.0), 0.085)
    if with_glass:
        add_diamond(scene)
    scene.refractive_glass.shading = "TRUE"
    common.settle(scene, 1)
    return scene


def add_diamond(scene: bpy.types.Scene) -> bpy.types.Object:
    """Hold the diamond up and return it."""
    gem = common.link(scene, "Diamond", brilliant())
    gem.rotation_euler = (-TILT, 0.0, TURN)
    return common.own_mesh_glass(gem, IOR, abbe=ABBE)


def planes() -> list[tuple[np.ndarray, float]]:
    """The facets' planes in units of the girdle's radius: outward normals (3,) and distances."""
    height = (1.0 - TABLE) * math.tan(CROWN) + GIRDLE
    found = [(np.array((0.0, 0.0, 1.0)), height)]

    def ring(count: int, first: float, angle: float, through: tuple[float, float], sign: int):
        for number in range(count):
            azimuth = 2.0 * math.pi * (number + first) / count
            across = math.sin(angle)
            normal = np.array(
                (across * math.cos(azimuth), across * math.sin(azimuth), sign * math.cos(angle))
            )
            radius, z = through
            found.append((normal, across * radius + sign * math.cos(angle) * z))

    # Each kind goes through one point of its own middle line.
    ring(8, 0.0, CROWN, (1.0, GIRDLE), 1)
    ring(8, 0.5, STAR, (TABLE * math.cos(math.pi / 8.0), height), 1)
    ring(16, 0.5, UPPER, (1.0 * math.cos(math.pi / 64.0), GIRDLE), 1)
    ring(8, 0.0, PAVILION, (1.0, -GIRDLE), -1)
    ring(16, 0.5, LOWER, (1.0, -GIRDLE), -1)
    return found


def brilliant() -> bpy.types.Mesh:
    """A cylinder of which the facets' planes leave a brilliant."""
    import bmesh  # there once bpy is imported

    body = bmesh.new()
    bmesh.ops.create_cone(
        body, cap_ends=True, segments=GIRDLE_SIDES, radius1=1.0, radius2=1.0, depth=4.0
    )
    for normal, distance in planes():
        cut = bmesh.ops.bisect_plane(
            body,
            geom=[*body.verts, *body.edges, *body.faces],
            dist=1e-6,
            plane_co=normal * distance,
            plane_no=normal,
            clear_outer=True,
        )
        rim = [part for part in cut["geom_cut"] if isinstance(part, bmesh.types.BMEdge)]
        if rim:
            bmesh.ops.contextual_create(body, geom=rim)
    bmesh.ops.recalc_face_normals(body, faces=body.faces)
    bmesh.ops.scale(body, vec=(RADIUS,) * 3, verts=body.verts)
    data = bpy.data.meshes.new("Diamond")
    body.to_mesh(data)
    body.free()
    return data


if __name__ == "__main__":
    common.register_extension()
    sys.exit(common.run("diamond", build))
