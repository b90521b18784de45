# SPDX-License-Identifier: GPL-3.0-or-later
"""The live view in a Blender with a window: drawn frames of displaced vertices, and redraws.

Two scripts measure in that Blender and write JSON; this part starts it and reads them.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path

from .plots import Chart
from .settings import Settings
from .solver import TABLE_2
from .text import table

TITLE = "Live view"

PROGRAM = "REFRACTIVE_GLASS_REAL_BLENDER"
"""Names the program that starts a Blender with a window; see tests/real_blender/conftest.py."""
ROOT = Path(__file__).resolve().parents[1]
SCENES = ("eraser", "pencil", "still_life")
MEASURED = "final,redraws,f12"
"""Parts of the script that measures redraws."""
LIMIT_SECONDS = 600.0


def run(settings: Settings) -> dict:
    """All figures of this part; nothing where no Blender with a window is known."""
    program = os.environ.get(PROGRAM)
    if not program:
        return {"drawn": [], "scenes": {}}
    with tempfile.TemporaryDirectory(prefix="refractive_glass_") as folder:
        drawn = Path(folder) / "drawn.json"
        _start(program, "displaced_vertices.py", str(drawn))
        scenes = [ROOT / "demo_scenes" / f"{name}.blend" for name in SCENES]
        if settings.size != "full":
            scenes = scenes[:1]
        _start(program, "live_view.py", folder, "SOLID", MEASURED, *map(str, scenes))
        return {
            "drawn": json.loads(drawn.read_text()),
            "scenes": json.loads((Path(folder) / "live_view.json").read_text()),
        }


def _start(program: str, script: str, *arguments: str) -> None:
    """Run a script in a Blender with a window; RuntimeError where it fails."""
    command = [program, "gui", "--factory-startup", "--python", str(ROOT / "scripts" / script)]
    done = subprocess.run(
        [*command, "--", *arguments],
        cwd=ROOT,
        timeout=LIMIT_SECONDS,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or "Traceback" in done.stdout + done.stderr:
        raise RuntimeError(f"{script} failed:\n{(done.stdout + done.stderr)[-2000:]}")


def describe(found: dict) -> list[str]:
    """Lines of Markdown."""
    if not found["drawn"]:
        return [
            f"Left out: it needs a Blender with a window, which the environment variable {PROGRAM} "
            "names.",
            "",
        ]
    drawn = found["drawn"]
    lines = [
        f"Drawn by {drawn[0]['renderer']}.",
        "",
        "Beside the paper's table 2: frames a second **drawn**, a wavy sheet behind a hollow "
        "glass at 800 x 600, each read back so that the drawing has ended. *Plain*: the same "
        "triangles without glass. *Displaced*: the vertex shader solves each vertex's path anew in "
        "each frame. The paper's are of a GPU of 2013 (average of its table).",
        "",
    ]
    rows = []
    for row in drawn:
        nearest = TABLE_2.get(round(row["vertices"], -5))
        rows.append(
            (
                row["vertices"],
                nearest[2] if nearest else None,
                nearest[3] if nearest else None,
                1e3 / row["plain"],
                1e3 / row["displaced"],
                row["ratio"],
                row["error_px"],
            )
        )
    lines += table(
        (
            "vertices",
            "paper",
            "OptiX",
            "ours, plain",
            "ours, displaced",
            "displaced of plain",
            "largest error, px",
        ),
        rows,
    )
    lines += [
        "Redraws of the 3D view in solid shading from the camera, milliseconds, medians: without "
        "and with the refracted picture. *Python*: its part in Python. No redraw solves anything "
        "in NumPy: the shader follows the rays. *Final*: seconds from the last motion to the "
        "anti-aliased picture. *Moving*: PSNR of what is shown meanwhile against it; *F12*: of the "
        "final picture against Workbench's render, in the glass.",
        "",
    ]
    motions = ("still", "eye", "object")
    lines += table(
        (
            "scene",
            *(
                f"{motion}, {what}"
                for motion in motions
                for what in ("plain, ms", "with glass, ms", "Python, ms")
            ),
            "first, s",
            "final, s",
            "moving, dB",
            "F12, dB",
        ),
        [
            (
                name,
                *(
                    row[motion][key]
                    for motion in motions
                    for key in ("plain_ms", "ms", "python_ms")
                ),
                row["first_s"],
                row["final_s"],
                row["moving_db"],
                row["f12_db"],
            )
            for name, row in found["scenes"].items()
        ],
    )
    return lines


def charts(found: dict) -> list[Chart]:
    """None: the tables say it all."""
    return []
