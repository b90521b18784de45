# SPDX-License-Identifier: GPL-3.0-or-later
"""Inside Blender with a window: displaced things in a 3D view, beside the same view by rays.

Argument: output folder. Writes screenshots, and what the view says, as the result.
"""

import importlib
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from windowed import until, walk

FOLDER = Path(sys.argv[-1])
NAME = "bl_ext.user_default.refractive_glass.glass_refraction"
result = {"psnr": {}, "status": {}, "uploads": {}}


def part(name):
    return importlib.import_module(f"{NAME}.{name}")


def space():
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    return area.spaces.active, next(r for r in area.regions if r.type == "WINDOW")


def thing(name, points, faces, colour):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    material = bpy.data.materials.new(name)
    material.diffuse_color = (*colour, 1.0)
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    return obj


def box(name, middle, half, colour):
    corners = [
        [middle[k] + half[k] * (1 if n >> k & 1 else -1) for k in range(3)] for n in range(8)
    ]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return thing(name, corners, faces, colour)


def scene():
    """A tube with a box in it and one behind it, a pane before a third, on a large floor."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    large = [(-3, -3, -0.001), (3, -3, -0.001), (3, 3, -0.001), (-3, 3, -0.001)]
    thing("floor", large, [(0, 1, 2, 3)], (0.2, 0.3, 0.5))
    box("behind", (0.0, 0.12, 0.03), (0.03, 0.01, 0.02), (0.8, 0.2, 0.1))
    box("held", (0.008, 0.0, 0.05), (0.006, 0.006, 0.05), (0.9, 0.8, 0.1))
    box("third", (0.13, 0.1, 0.04), (0.03, 0.01, 0.03), (0.1, 0.7, 0.2))
    add = bpy.ops.object.refractive_glass_add
    add(shape="CYLINDER", radius=0.04, wall_thickness=0.004, height=0.12)
    add(shape="SLAB", radius=0.05, wall_thickness=0.02)
    bpy.context.object.location = 0.13, 0.03, 0.05
    bpy.context.object.rotation_euler = 1.2, 0.2, 0.3
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0.06, -0.45, 0.14), (1.38, 0.0, 0.0)
    camera.data.clip_start = 0.01
    bpy.context.scene.camera = camera
    bpy.context.scene.refractive_glass.enabled = True
    one, _ = space()
    one.region_3d.view_perspective = "CAMERA"
    # Its frame is as wide as the view.
    one.region_3d.view_camera_zoom = 29
    one.overlay.show_extras = one.overlay.show_floor = one.overlay.show_cursor = False
    one.overlay.show_axis_x = one.overlay.show_axis_y = False
    one.overlay.show_object_origins = one.overlay.show_outline_selected = False
    one.overlay.show_text = one.show_gizmo = False
    one.show_region_toolbar = one.show_region_ui = False
    shading = one.shading
    shading.type, shading.light, shading.color_type = "SOLID", "FLAT", "MATERIAL"
    shading.show_object_outline = shading.show_cavity = False
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    bpy.context.view_layer.objects.active = bpy.data.objects["floor"]


def rest():
    yield 0.2
    if not (yield from until(part("viewport.views").at_rest)):
        raise RuntimeError("the view did not come to rest")
    yield 0.2


def picture(name):
    """The middle of the view as it is on screen, (H, W, 3)."""
    path = FOLDER / f"{name}.png"
    subprocess.run(["import", "-window", "root", path], check=True)
    image = bpy.data.images.load(str(path))
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    _, region = space()
    pixels = pixels.reshape(height, width, 4)[..., :3]
    pixels = pixels[region.y : region.y + region.height, region.x : region.x + region.width]
    high, wide, _ = pixels.shape
    return pixels[high // 6 : -high // 6, wide // 8 : -wide // 8]


def psnr(a, b):
    return float(-10.0 * np.log10(max(np.mean((a - b) ** 2), 1e-12)))


def of_view():
    (view,) = part("viewport.views")._views.values()
    return view


def both(name):
    """The view by rays and displaced, and how far they are apart."""
    settings = bpy.context.scene.refractive_glass
    settings.shading = "TRUE"
    space()[1].tag_redraw()
    yield from rest()
    by_rays = picture(f"{name}_rays")
    settings.shading = "DISPLACED"
    space()[1].tag_redraw()
    yield from rest()
    result["psnr"][name] = psnr(by_rays, picture(f"{name}_displaced"))
    result["status"][name] = part("viewport.views").status(space()[0])


def uploads(name, change):
    """How many meshes a change had handed over."""
    before = of_view().displaced.things.version
    change()
    yield from rest()
    result["uploads"][name] = of_view().displaced.things.version - before


def steps():
    scene()
    yield 0.2
    part("viewport.views").show(space()[0], True)
    yield from both("first")
    behind = bpy.data.objects["behind"]

    def move():
        behind.location.x += 0.01

    def edit():
        for vertex in behind.data.vertices:
            vertex.co.z *= 1.5
        behind.data.update()

    yield from uploads("moved", move)
    yield from uploads("edited", edit)
    yield from both("after")
    part("viewport.views").doubt()
    space()[1].tag_redraw()
    yield from rest()
    result["uploads"]["doubted"] = of_view().displaced.things.version
    glass = next(o for o in bpy.data.objects if o.name.startswith("Refractive") or "lass" in o.name)
    settings = part("scene.read.modifier_inputs")
    modifier = part("scene.read.glasses").glass_modifier(glass)
    settings.write_input(modifier, "Contents IOR", 1.33)
    glass.update_tag()
    yield from both("filled")
    settings.write_input(modifier, "Contents IOR", 1.0)
    glass.update_tag()
    bpy.context.scene.camera.data.type = "ORTHO"
    bpy.context.scene.camera.data.ortho_scale = 0.3
    yield from both("parallel")
    result["failures"] = [v.failure for v in part("viewport.views")._views.values() if v.failure]


walk(steps(), result, FOLDER)
