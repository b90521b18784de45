# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's manifest and zip, by Blender's own tool."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).parents[2]


def extension(*arguments):
    """Run Blender's tool for extensions; returns what it printed."""
    found = subprocess.run(
        [sys.executable, ROOT / "scripts" / "extension.py", *arguments],
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("zip")
    extension("build", "--source-dir", ROOT, "--output-dir", folder)
    (path,) = folder.glob("*.zip")
    return path


@pytest.fixture(scope="module")
def names(archive):
    with zipfile.ZipFile(archive) as content:
        return content.namelist()


def manifest():
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text())


def test_manifest_and_zip_are_valid(archive):
    extension("validate", ROOT)
    extension("validate", archive)


def test_zip_is_named_after_the_version(archive):
    assert archive.name == f"refractive_glass-{manifest()['version']}.zip"


def test_zip_holds_what_blender_needs(names):
    needed = {
        "blender_manifest.toml",
        "__init__.py",
        "LICENSE",
        "glass_refraction/__init__.py",
        "glass_refraction/optics/__init__.py",
        "node_groups/refractive_glass.blend",
    }
    assert needed <= set(names)


@pytest.mark.parametrize("kind", ["py", "glsl"])
def test_zip_holds_every_module_and_shader_of_the_package(names, kind):
    found = (ROOT / "glass_refraction").rglob(f"*.{kind}")
    files = {str(path.relative_to(ROOT)) for path in found}
    assert files and files <= set(names)


def test_zip_holds_nothing_else(names):
    allowed = re.compile(
        r"(blender_manifest\.toml|__init__\.py|LICENSE"
        r"|node_groups/refractive_glass\.blend|glass_refraction/[\w/]+\.(py|glsl)|glass_refraction/ui/icons/\w+\.png)"
    )
    assert [name for name in names if not allowed.fullmatch(name)] == []


def test_zip_is_small(archive):
    assert archive.stat().st_size < 785_000


def test_changelog_tells_of_the_version():
    assert f"## {manifest()['version']}" in (ROOT / "CHANGELOG.md").read_text()
