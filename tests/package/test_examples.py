# SPDX-License-Identifier: GPL-3.0-or-later
"""What the documents tell people to run does run."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("document", ["docs/api.md"])
def test_code_in_documents_runs(document, capsys):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, document, "exec"), {})
    assert capsys.readouterr().out.startswith("TTTT")


def test_documents_link_to_files_that_are_there():
    for document in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
            if not link.startswith("http"):
                assert (document.parent / link).is_file(), f"{document.name}: {link}"


def test_turntable_builds_a_scene_that_renders(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["turntable.py", str(tmp_path)])
    example = runpy.run_path(str(ROOT / "examples" / "turntable.py"))
    scene = example["build"]()
    scene.frame_end, scene.cycles.samples = 2, 1
    scene.render.resolution_percentage = 25
    scene.render.filepath = str(tmp_path / "turn_")
    bpy.ops.render.render(animation=True)
    assert {p.name for p in tmp_path.iterdir()} == {"turn_0001.png", "turn_0002.png"}
    from glass_refraction.scene.update import status

    assert status(scene).paths == ("TTTT",)


def test_farm_script_is_a_shell_script():
    subprocess.run(["sh", "-n", str(ROOT / "examples" / "farm.sh")], check=True)
