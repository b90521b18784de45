# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender with the extension installed from its zip, in a home folder of its own.

``REFRACTIVE_GLASS_REAL_BLENDER`` names a program that runs it:

    PROGRAM run ARG...      blender ARG... without a window
    PROGRAM command ARG...  blender --command ARG...
    PROGRAM gui ARG...      blender ARG... in a window on a virtual screen

It takes ``REAL_BLENDER_HOME`` (the home folder) and ``REAL_BLENDER_DISPLAY`` (the screen's number)
from the environment and shows Blender the folder for temporary files.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import pytest

PROGRAM = os.environ.get("REFRACTIVE_GLASS_REAL_BLENDER")
ROOT = Path(__file__).parents[2]
SHARED = ("windowed.py", "passes.py", "vertex_points.py")
"""What scripts of that folder import."""
INSIDE = Path(__file__).with_name("inside")
SHADERS = Path(tempfile.gettempdir()) / f"refractive_glass_shaders_{os.getuid()}"
"""Where Mesa keeps what it compiled, for all homes and workers: EEVEE alone takes it 20 CPU
seconds in each Blender that starts without."""

SMALL = (640, 420)
"""Pixels of Blender's window, at the lower left of the screen: by software each takes its time."""

# Blender itself says "Error" in warnings about libraries that a machine does not have.
TROUBLE = re.compile(r"Traceback|^Error\b|\w(Error|Exception): |\bcrash|Segmentation", re.M)


def pytest_collection_modifyitems(items):
    here = str(Path(__file__).parent)
    for item in items:
        if str(item.path).startswith(here):
            item.add_marker(pytest.mark.real_blender)
            if not PROGRAM:
                item.add_marker(
                    pytest.mark.skip(reason="REFRACTIVE_GLASS_REAL_BLENDER names no Blender")
                )


@dataclass
class Blender:
    """The installed Blender: how it is run, and the folder that it and the tests share."""

    folder: Path
    screen: int

    def run(self, arguments, seconds):
        """Run Blender with arguments; returns the finished process, whatever its status."""
        environment = {
            **{k: v for k, v in os.environ.items() if not k.startswith("BLENDER_USER")},
            "REAL_BLENDER_HOME": str(self.folder / "home"),
            "REAL_BLENDER_DISPLAY": str(self.screen),
            "MESA_SHADER_CACHE_DIR": str(SHADERS),
        }
        process = subprocess.Popen(
            [PROGRAM, *map(str, arguments)],
            cwd=tempfile.gettempdir(),
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            output = _ended(process)
            pytest.fail(f"Blender did not end within {seconds} s:\n{output}")
        # Where Blender crashed, that file alone tells where.
        for path in map(Path, re.findall(r"^Writing: (.+\.crash\.txt)$", output, re.MULTILINE)):
            output += path.read_text(errors="replace") if path.is_file() else ""
        return subprocess.CompletedProcess(arguments, process.returncode, output)

    def command(self, *arguments, seconds=300):
        """``blender --command ...``; returns the finished process, whatever its status."""
        return self.run(["command", *arguments], seconds)

    def script(self, name, *arguments, how="run", size=SMALL, seconds=600, trouble=TROUBLE):
        """Run a script of the folder ``inside``; returns what it wrote as ``result.json``.

        The script finds a folder for its output as its first argument. Any trace of ``trouble`` in
        what Blender prints fails the test.
        """
        output = Path(tempfile.mkdtemp(prefix=f"{name}_", dir=self.folder))
        script = shutil.copy(INSIDE / f"{name}.py", output)
        for shared in SHARED:
            shutil.copy(INSIDE / shared, output)
        window = ["--window-geometry", 0, 0, *size] if how == "gui" else []
        given = ["--python-exit-code", 3, "--python", script, "--", output, *arguments]
        found = self.run([how, *window, *given], seconds)
        assert found.returncode == 0, found.stdout
        assert not trouble.search(found.stdout), found.stdout
        assert (output / "result.json").is_file(), found.stdout
        result = json.loads((output / "result.json").read_text())
        result["folder"] = output
        result["printed"] = found.stdout
        keep(output)
        return result


def _ended(process):
    """What a process printed that is asked to end, and made to where it does not."""
    os.killpg(process.pid, signal.SIGTERM)
    try:
        return process.communicate(timeout=20)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.communicate(timeout=20)[0]


def keep(folder):
    """Copy a script's pictures to where a person finds them, if there is such a place."""
    target = os.environ.get("REFRACTIVE_GLASS_PICTURES")
    if target:
        for picture in folder.glob("*.png"):
            Path(target).mkdir(parents=True, exist_ok=True)
            shutil.copy(picture, target)


def free_screen():
    """A screen number that no X server uses."""
    first = 100 + os.getpid() % 400
    return next(n for n in range(first, first + 500) if not Path(f"/tmp/.X11-unix/X{n}").exists())


@pytest.fixture(scope="session")
def blender():
    """A Blender whose home folder is still empty."""
    folder = Path(tempfile.mkdtemp(prefix="refractive_glass_real_"))
    (folder / "home").mkdir()
    yield Blender(folder, free_screen())
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def archive(blender):
    """The extension's zip, built by Blender from a copy of the files under version control."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    source = blender.folder / "source"
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    found = blender.command(
        "extension", "build", "--source-dir", source, "--output-dir", blender.folder
    )
    assert found.returncode == 0, found.stdout
    (path,) = blender.folder.glob("*.zip")
    return path


@pytest.fixture(scope="session")
def installed(blender, archive):
    """Blender with the extension installed and enabled, whose windows open without a splash."""
    found = blender.command("extension", "install-file", "-r", "user_default", "--enable", archive)
    assert found.returncode == 0, found.stdout
    assert not TROUBLE.search(found.stdout), found.stdout
    blender.script("no_splash")
    return blender
