# SPDX-License-Identifier: GPL-3.0-or-later
"""The command ``./run benchmark``: exit status 0 on success, 2 and one line on bad input."""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from . import plots, runner
from .settings import Settings

SCENES = ("eraser", "eraser_unlit", "panes", "pencil", "fishbowl", "verge", "still_life")
"""Demo scenes that are rendered; the first one with every setting."""
DEMO = Path(__file__).resolve().parents[1] / "demo_scenes"
UNLIT = "_unlit"
"""Ends the names of scenes without light."""
DOCS = Path(__file__).resolve().parents[1] / "docs"


def main(argv: list[str] | None = None) -> int:
    """Run what the arguments ask for; returns the exit status."""
    try:
        options = _parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        _run(options)
    except (ValueError, plots.MissingMatplotlib) as error:
        line = str(error)
    except OSError as error:
        line = f"{error.filename}: {error.strerror}; give another place"
    else:
        return 0
    print(f"benchmark: {line}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str):
        self.exit(2, f"{self.prog}: {message} (--help lists all arguments)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="benchmark", description="Speed against error, and hard cases.")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--quick", action="store_true", help="less of everything, two minutes")
    parser.add_argument(
        "--only",
        nargs="*",
        metavar="PART",
        help=f"of {', '.join(runner.PARTS)}, or none; the folder keeps the others",
    )
    parser.add_argument(
        "--scenes",
        nargs="+",
        type=Path,
        default=(),
        metavar="SCENE.blend",
        help="for the parts that render, the first one with all settings; default: demo scenes",
    )
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    parser.add_argument(
        "--docs", action="store_true", help="write docs/benchmark.md and its pictures as well"
    )
    parser.add_argument("--no-plots", action="store_true", help="tables only")
    return parser


def _run(options: argparse.Namespace) -> None:
    for path in options.scenes:
        if not path.is_file() or path.suffix.lower() != ".blend":
            raise ValueError(f"{path}: no such .blend file")
    if options.output == Path() or (options.output.exists() and not options.output.is_dir()):
        raise ValueError(f"{options.output}: give a folder of its own for what is written")
    if options.seed < 0:
        raise ValueError(f"--seed {options.seed}: must not be negative")
    if options.docs and options.no_plots:
        raise ValueError("--docs needs plots: leave out --no-plots")
    scenes = tuple(options.scenes) or tuple(_demo_scene(name, options.output) for name in SCENES)
    size = "quick" if options.quick else "full"
    settings = Settings(size, options.seed, scenes, options.output)
    parts = runner.chosen(options.only, settings)
    if not options.no_plots:
        plots.check()
    if importlib.util.find_spec("bpy") is not None:
        _register()
    if not (options.scenes or options.quick) and runner.SCENE_PARTS.intersection(parts):
        options.output.mkdir(parents=True, exist_ok=True)
        _build_unlit(scenes)
    report = runner.run(
        settings,
        options.output,
        only=parts,
        with_charts=not options.no_plots,
        progress=lambda line: print(f"benchmark: {line}", file=sys.stderr, flush=True),
    )
    print(f"{options.output}: report.md, report.json")
    if options.docs:
        runner.write_docs(report, options.output, DOCS)
        print(f"{DOCS}: benchmark.md, pictures/benchmark")


def _demo_scene(name: str, folder: Path) -> Path:
    """Where a demo scene lies, or will: one without light is built for the run."""
    return (folder if name.endswith(UNLIT) else DEMO) / f"{name}.blend"


def _build_unlit(scenes: Sequence[Path]) -> None:
    """Make the demo scenes without light, each by its own script."""
    for path in scenes:
        if path.stem.endswith(UNLIT):
            script = DEMO / f"{path.stem.removesuffix(UNLIT)}.py"
            command = [sys.executable, str(script), "--unlit", "-o", str(path.resolve())]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _register() -> None:
    """Register the extension unless it is."""
    import bpy

    import glass_refraction

    if not hasattr(bpy.types.Scene, "refractive_glass"):
        glass_refraction.register()
