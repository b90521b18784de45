# SPDX-License-Identifier: GPL-3.0-or-later
"""CPU seconds that Shadow: Light takes of a frame of 480 × 360 pixels, and when a thing has moved.

python scripts/light_times.py SCENE.blend [--frame N] [--moves NAME] [--quality NAME]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import glass_refraction
from glass_refraction.scene.memory import counters
from glass_refraction.scene.rays import frame as frames

WIDTH, HEIGHT = 480, 360
STEP = 1e-3
"""Metres that the thing moves."""


def main() -> None:
    """Render twice by one sample a pixel."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("--frame", type=int)
    parser.add_argument("--moves")
    parser.add_argument("--quality", default="GOOD")
    args = parser.parse_args()
    glass_refraction.register()
    bpy.ops.wm.open_mainfile(filepath=str(args.scene.resolve()))
    scene = bpy.context.scene
    scene.frame_set(scene.frame_current if args.frame is None else args.frame)
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = 100
    settings = scene.refractive_glass
    settings.shading, settings.shadow, settings.quality = "TRUE", "LIGHT", args.quality
    computed = frames.light_maps

    def timed(light, *given):
        begun = time.process_time()
        found = computed(light, *given)
        seconds = time.process_time() - begun
        print(f"{len(light.emitters)} lamps, {seconds:.2f} CPU s, {counters['bells']} bells")
        return found

    frames.light_maps = timed
    for moved in (None, args.moves):
        if moved:
            bpy.data.objects[moved].location.x += STEP
        counters["bells"] = 0
        bpy.ops.render.render()


if __name__ == "__main__":
    main()
