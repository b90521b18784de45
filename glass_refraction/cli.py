# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: ``python -m glass_refraction`` and ``blender --command refractive_glass``.

Exit status 0 on success, 2 and one line on bad input.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

LAST_FRAME = 1_048_574
"""Blender's."""
MOST_SAMPLES = 16_777_216
"""Cycles'."""

FORMATS = {".png": "PNG", ".exr": "OPEN_EXR", ".jpg": "JPEG", ".jpeg": "JPEG", ".tif": "TIFF"}


class _BadInput(Exception):
    """One line that says what is wrong and what to do."""


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    parser = _parser()
    try:
        options = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    from .scene.names import RefractiveGlassError

    try:
        options.run(options)
    except (_BadInput, RefractiveGlassError) as error:
        line = str(error)
    except OSError as error:
        line = f"{error.filename}: {error.strerror}; give another place"
    else:
        return 0
    print(f"refractive_glass: {line}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str):
        self.exit(2, f"{self.prog}: {message} (--help lists all arguments)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="refractive_glass", description="Objects seen through glass, computed by Snell's law."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    render = commands.add_parser("render", help="render as F12 would")
    render.add_argument("scene", metavar="SCENE.blend", type=Path)
    render.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.png")
    render.add_argument("--frames", type=_frames, metavar="FIRST-LAST", help="one frame or a range")
    render.add_argument(
        "--regions",
        action="store_true",
        help="write how often each pixel's light is refracted, one colour a count, instead",
    )
    render.set_defaults(run=_render)

    compare = commands.add_parser("compare", help="render with real glass in Cycles too")
    compare.add_argument("scene", metavar="SCENE.blend", type=Path)
    compare.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    compare.add_argument("--samples", type=_samples, help="of the reference; default: the scene's")
    compare.add_argument(
        "--surface", choices=("GLASS", "REFRACTION"), help="of both pictures; default: the scene's"
    )
    compare.add_argument("--shading", choices=("TRUE", "DISPLACED"), help="default: the scene's")
    compare.add_argument("--frame", type=_frame, help="default: the file's current frame")
    compare.set_defaults(run=_compare)

    bake = commands.add_parser("bake", help="make a file that renders without the extension")
    bake.add_argument("scene", metavar="SCENE.blend", type=Path)
    bake.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.blend")
    bake.add_argument("--frames", type=_frames, metavar="FIRST-LAST", help="default: the scene's")
    bake.add_argument(
        "--folder", type=Path, help="for the baked frames; default: one beside OUT.blend"
    )
    bake.set_defaults(run=_bake)
    return parser


def _frames(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(-?\d+)(?:-(-?\d+))?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a frame nor FIRST-LAST")
    first = _frame(match[1])
    last = _frame(match[2]) if match[2] is not None else first
    if last < first:
        raise argparse.ArgumentTypeError(f"{text!r}: the last frame is before the first")
    return first, last


def _frame(text: str) -> int:
    return _whole_number(text, -LAST_FRAME, LAST_FRAME)


def _samples(text: str) -> int:
    return _whole_number(text, 1, MOST_SAMPLES)


def _whole_number(text: str, least: int, most: int) -> int:
    try:
        value = int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from error
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text} must be between {least} and {most}")
    return value


def _folder(path: Path) -> Path:
    """The folder that an argument names, whether it is there or not."""
    if path == Path():
        raise _BadInput(f"{path}: give a folder of its own for what is written")
    if path.exists() and not path.is_dir():
        raise _BadInput(f"{path}: a file, where a folder is to be; give another place")
    return path


def _file(path: Path, *endings: str) -> Path:
    """The whole path of a file to be written."""
    if path.suffix.lower() not in endings:
        wanted = endings[0] if len(endings) == 1 else f"one of {', '.join(endings)}"
        raise _BadInput(f"{path}: the file name must end in {wanted}")
    if path.is_dir():
        raise _BadInput(f"{path}: a folder, where a file is to be; give another place")
    return path.resolve()


def _open(path: Path):
    """Open a .blend with the extension registered; returns its active scene."""
    import bpy

    if not path.is_file():
        raise _BadInput(f"{path}: no such file")
    _register()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()))
    except RuntimeError as error:
        raise _BadInput(f"{path}: not a readable .blend file") from error
    return bpy.context.scene


def _register() -> None:
    """Register the extension unless it is."""
    import bpy

    from . import register

    if not hasattr(bpy.types.Scene, "refractive_glass"):
        register()


def _prepare(scene) -> None:
    """Check the scene before minutes of rendering, and say what will be left out."""
    import bpy

    from .scene import update as door

    door.prepare(scene, bpy.context.evaluated_depsgraph_get(), strict=True)
    for problem in door.status(scene).problems:
        print(f"refractive_glass: {problem}", file=sys.stderr)


def _render(options: argparse.Namespace) -> None:
    import bpy

    output = _file(options.output, *FORMATS)
    scene = _open(options.scene)
    _prepare(scene)
    output.parent.mkdir(parents=True, exist_ok=True)
    first, last = options.frames or (scene.frame_current, scene.frame_current)
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        path = output
        if last > first:
            path = output.with_stem(f"{output.stem}{frame:04d}")
        if options.regions:
            _write_regions(scene, path)
            continue
        image = scene.render.image_settings
        image.media_type = "IMAGE"
        image.file_format = FORMATS[path.suffix.lower()]
        scene.render.use_file_extension = False
        scene.render.filepath = str(path)
        try:
            bpy.ops.render.render(write_still=True, scene=scene.name)
        except RuntimeError as error:
            raise _BadInput(f"{path}: {_said(error)}") from error
        if not path.is_file():
            raise _BadInput(f"{path}: the picture could not be written")


def _said(error: RuntimeError) -> str:
    """What an operator of Blender's has reported, as one line."""
    return " ".join(str(error).split()).removeprefix("Error: ")


def _write_regions(scene, path: Path) -> None:
    import bpy

    from .scene.vertices.region_map import write_region_map

    write_region_map(scene, bpy.context.evaluated_depsgraph_get(), path)


def _bake(options: argparse.Namespace) -> None:
    import bpy

    from .scene.bake.baking import Baking
    from .scene.bake.files import frame_ranges

    output = _file(options.output, ".blend")
    if output == options.scene.resolve():
        raise _BadInput(f"{options.output}: this is the scene itself; give another file")
    scene = _open(options.scene)
    output.parent.mkdir(parents=True, exist_ok=True)
    # First, for the paths in it are relative to it.
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(output))
    except RuntimeError as error:
        raise _BadInput(f"{options.output}: {_said(error)}") from error
    first, last = options.frames or (scene.frame_start, scene.frame_end)
    folder = "" if options.folder is None else str(options.folder.resolve())
    baking = Baking(scene, bpy.context.evaluated_depsgraph_get(), folder, first, last)
    try:
        for step in baking.steps():
            print(f"bake: frame {step.label}, {100 * step.share:3.0f} %", file=sys.stderr)
    except BaseException:
        baking.cancel()
        raise
    contents = baking.finish()
    for problem in baking.problems:
        print(f"refractive_glass: {problem}", file=sys.stderr)
    bpy.ops.wm.save_mainfile()
    print(f"{options.output}: frames {frame_ranges(contents.frames)} in {baking.folder}")


def _compare(options: argparse.Namespace) -> None:
    from .reference.compare import compare

    output = _folder(options.output)
    scene = _open(options.scene)
    if options.frame is not None:
        scene.frame_set(options.frame)
    for name in ("surface", "shading"):
        if getattr(options, name) is not None:
            setattr(scene.refractive_glass, name, getattr(options, name))
    _prepare(scene)

    def progress(share: float, label: str) -> None:
        print(f"compare: {100 * share:3.0f} %: {label}", file=sys.stderr)

    found = compare(scene, output, samples=options.samples, progress=progress)
    print(
        f"{options.output}: PSNR {found['psnr_db']:.2f} dB, FLIP {found['flip_mean']:.4f}, "
        f"{found['seconds_composite']:.1f} s composited, {found['seconds_reference']:.1f} s Cycles"
    )
