# SPDX-License-Identifier: GPL-3.0-or-later
"""What to upload to the extension platform: the zip, the listing's text and pictures, the changes.

    ./run release

Builds ``build/release``, after the zip was validated by Blender's own tool. A version that the
changelog does not know is an error.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build" / "release"
PICTURE = re.compile(r"^!\[.*?\]\((.*?)\)$", re.M)
COMMAND = re.compile(r": \[command\]\([^)]*\)| \(\[command\]\([^)]*\)\)")
"""Where a figure's command stands: of use to those who have the checkout."""
LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")


def changes(version: str) -> str:
    """The changelog's section of a version."""
    sections = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.M)
    found = [part for part in sections if part.split("\n", 1)[0].strip() == version]
    if not found:
        raise SystemExit(f"release: CHANGELOG.md has no section {version}")
    return found[0].split("\n", 1)[1].strip() + "\n"


def listing() -> tuple[str, list[Path]]:
    """The README up to its first heading without links, and the pictures that it shows."""
    introduction = (ROOT / "README.md").read_text().split("\n## ", 1)[0]
    pictures = [ROOT / name for name in PICTURE.findall(introduction)]
    text = LINK.sub(r"\1", COMMAND.sub("", PICTURE.sub("", introduction)))
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n", pictures


def extension(*arguments: object) -> None:
    tool = [sys.executable, ROOT / "scripts" / "extension.py"]
    subprocess.run([*tool, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Write the folder anew."""
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    text, pictures = listing()
    changed = changes(version)
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    extension("build", "--source-dir", ROOT, "--output-dir", FOLDER)
    (archive,) = FOLDER.glob("*.zip")
    extension("validate", archive)
    (FOLDER / "listing.md").write_text(text)
    (FOLDER / "changes.md").write_text(changed)
    for picture in pictures:
        shutil.copy(picture, FOLDER)
    print(
        f"wrote {FOLDER.relative_to(ROOT)}: {', '.join(sorted(p.name for p in FOLDER.iterdir()))}"
    )


if __name__ == "__main__":
    main()
