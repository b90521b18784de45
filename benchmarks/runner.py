# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the benchmark's parts and writes ``report.json``, ``report.md`` and the charts."""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import re
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType

from .measure import machine
from .plots import draw
from .settings import Settings

PARTS = ("pictures", "frames", "solver", "stability", "rays", "left_out", "live")
"""In the report's order; each the name of a module."""

BLENDER_PARTS = frozenset(PARTS) - {"solver", "stability", "live"}
"""Parts that need Blender as a module; the others run on NumPy alone, or start a Blender."""
SCENE_PARTS = frozenset({"pictures", "frames", "left_out"})
"""Parts that render the scenes of the settings."""

FORMAT = 3
"""Of ``report.json``, to be raised with every change of what a part tells: a report of another
format is not added to."""


def run(
    settings: Settings,
    folder: Path,
    *,
    only: Iterable[str] | None = None,
    with_charts: bool = True,
    progress: Callable[[str], None] = print,
) -> dict:
    """Run parts and write the report of all that the folder now holds.

    Parameters
    ----------
    folder : made if need be. Parts that are not run now are kept in its ``report.json``, and so
        are scenes that are not rendered now.
    only : names of :data:`PARTS`; all by default, none of an empty list.
    with_charts : draw them, which needs matplotlib.
    progress : takes a line when a part begins and when it ends.

    Returns
    -------
    dict : what ``report.json`` holds.

    Raises
    ------
    ValueError
        A part that does not exist, or that lacks Blender or scenes.
    OSError
        The folder cannot be written.
    """
    names = chosen(only, settings)
    folder.mkdir(parents=True, exist_ok=True)
    report = _kept(folder)
    for place, name in enumerate(names, 1):
        part = _part(name)
        progress(f"[{place}/{len(names)}] {part.TITLE} ...")
        started = time.perf_counter()
        kept = report["parts"].get(name, {}).get("found", {})
        found = part.run(settings)
        taken = time.perf_counter() - started
        report["parts"][name] = {
            "seconds": taken,
            "size": settings.size,
            "seed": settings.seed,
            "machine": machine(),
            "found": _plain(found),
        }
        if name in SCENE_PARTS:
            _keep_scenes(report["parts"][name]["found"], kept)
        progress(f"[{place}/{len(names)}] {part.TITLE}: {taken:.1f} s")
        # After each part: an interrupted run keeps what it has.
        write(report, folder, with_charts=with_charts)
    if not names:
        write(report, folder, with_charts=with_charts)
    return report


def write_docs(report: dict, folder: Path, docs: Path) -> None:
    """Write a folder's report as ``benchmark.md`` and its pictures into the documentation."""
    pictures = docs / "pictures" / "benchmark"
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir(parents=True)

    def moved(link: re.Match) -> str:
        shutil.copy(folder / link[2], pictures)
        return f"![{link[1]}](pictures/benchmark/{link[2]})"

    page = re.sub(r"!\[(.*?)\]\((.*?)\)", moved, markdown(report))
    (docs / "benchmark.md").write_text(page, encoding="utf-8")


def write(report: dict, folder: Path, *, with_charts: bool = True) -> None:
    """Write a report into a folder: ``report.json``, ``report.md`` and the charts."""
    text = json.dumps(report, indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.md").write_text(markdown(report), encoding="utf-8")
    if not with_charts:
        return
    for name, part in report["parts"].items():
        for chart in _part(name).charts(part["found"]):
            draw(chart, folder)


def markdown(report: dict) -> str:
    """The report as a page of Markdown that shows the charts."""
    lines = [
        "# Benchmark",
        "",
        "All figures come from `./run benchmark -o FOLDER --docs`, which writes this page; "
        "`--only PART` runs a part alone. A time is the median of its repeats, with the least and "
        "the greatest in brackets. Times compare within one part: its rivals take turns in one "
        "process.",
        "",
    ]
    parts = [(name, report["parts"][name]) for name in PARTS if name in report["parts"]]
    lines += _provenance(parts)
    for name, part in parts:
        module = _part(name)
        lines += [f"## {module.TITLE}", "", *module.describe(part["found"])]
    return "\n".join(lines).rstrip() + "\n"


def _provenance(parts: list[tuple[str, dict]]) -> list[str]:
    """What ran where: one line if all parts agree."""
    stated: dict[str, list[str]] = {}
    for name, part in parts:
        where = part["machine"]
        line = (
            f"{where['processor']}, {where['cores']} cores, {where['system']}; "
            f"Python {where['python']}, NumPy {where['numpy']}, Blender {where['blender']}; "
            f"{part['size']} run, seed {part['seed']}"
        )
        stated.setdefault(line, []).append(f"{name} {part['seconds']:.0f} s")
    lines = []
    for line, which in stated.items():
        lines += [f"- {line}: {', '.join(which)}."]
    return [*lines, ""]


def chosen(only: Iterable[str] | None, settings: Settings) -> tuple[str, ...]:
    """The parts to run, in the report's order; ValueError where one cannot be."""
    wanted = PARTS if only is None else tuple(only)
    unknown = [name for name in wanted if name not in PARTS]
    if unknown:
        raise ValueError(f"no part {unknown[0]!r}: choose from {', '.join(PARTS)}")
    names = tuple(name for name in PARTS if name in wanted)
    for name in names:
        if name in BLENDER_PARTS and importlib.util.find_spec("bpy") is None:
            raise ValueError(
                f"part {name!r} needs Blender (the bpy module); without it choose from "
                f"{', '.join(other for other in PARTS if other not in BLENDER_PARTS)}"
            )
        if name in SCENE_PARTS and not settings.scenes:
            raise ValueError(
                f"part {name!r} needs scenes: name some (--scenes), or choose other parts (--only)"
            )
    return names


def _part(name: str) -> ModuleType:
    return importlib.import_module(f".{name}", __package__)


def _kept(folder: Path) -> dict:
    """An earlier report of the folder, or an empty one."""
    path = folder / "report.json"
    if path.is_file():
        report = json.loads(path.read_text(encoding="utf-8"))
        if report.get("benchmark") == FORMAT:
            return report
    return {"benchmark": FORMAT, "parts": {}}


def _keep_scenes(found: dict, before: dict) -> None:
    """Put an earlier run's other scenes before those of this one."""
    names = {scene["scene"] for scene in found["scenes"]}
    others = [scene for scene in before.get("scenes", []) if scene["scene"] not in names]
    found["scenes"] = others + found["scenes"]


def _plain(value: object) -> object:
    """The same in JSON's types: numbers to six digits, None for those that JSON has not."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
