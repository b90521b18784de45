# SPDX-License-Identifier: GPL-3.0-or-later
"""What no module may do, read from the source itself."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "glass_refraction"
MODULES = sorted(PACKAGE.rglob("*.py"))
OPTICS = sorted((PACKAGE / "optics").rglob("*.py"))
BLENDER = {"bpy", "bpy_extras", "mathutils", "bmesh", "gpu", "gpu_extras", "blf", "bl_ext"}
# Blender's own Python brings no more than this; the package may not ask for anything else.
THIRD_PARTY = {"numpy"}
# The benchmark's charts alone need matplotlib, and only once they are drawn.
BENCHMARKS = sorted((ROOT / "benchmarks").rglob("*.py"))


def project_files():
    """Every text file under version control, this one left out: it names what it forbids."""
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("git does not tell which files are the project's")
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    suffixes = {".py", ".md", ".toml", ".txt", ".sh", ".cfg", ".yml", ".glsl", ""}
    files = (ROOT / name for name in listed.stdout.splitlines())
    return [f for f in files if f.is_file() and f.suffix in suffixes and f != Path(__file__)]


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imports(path, *, at_load_only=False):
    """Top-level names of the packages that a module imports (relative imports left out)."""
    found = set()
    stack = [tree(path)]
    while stack:
        node = stack.pop()
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module.split(".")[0])
        if at_load_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        stack += ast.iter_child_nodes(node)
    return found


def name_of(path):
    return str(path.relative_to(ROOT))


def test_optics_is_free_of_blender():
    assert {name_of(p): imports(p) & BLENDER for p in OPTICS if imports(p) & BLENDER} == {}


def test_blender_is_not_loaded_before_it_is_asked_for():
    doors = (ROOT / "__init__.py", *(PACKAGE / n for n in ("__init__.py", "__main__.py", "cli.py")))
    assert [name_of(p) for p in doors if imports(p, at_load_only=True) & BLENDER] == []


def test_package_imports_itself_relatively_and_nothing_that_blender_lacks():
    # By its absolute name the package is not found where it is installed as an extension.
    allowed = BLENDER | THIRD_PARTY | set(sys.stdlib_module_names)
    foreign = {p: imports(p) - allowed for p in MODULES if imports(p) - allowed}
    assert foreign == {}


def test_the_benchmark_loads_without_matplotlib():
    allowed = BLENDER | THIRD_PARTY | {"glass_refraction"} | set(sys.stdlib_module_names)
    assert BENCHMARKS
    early = {p: imports(p, at_load_only=True) - allowed for p in BENCHMARKS}
    assert not any(early.values())
    drawn = {name_of(p): imports(p) - allowed for p in BENCHMARKS if imports(p) - allowed}
    assert drawn == {"benchmarks/plots.py": {"matplotlib"}}


def test_optics_does_not_import_the_rest_of_the_package():
    upwards = [
        name_of(path)
        for path in OPTICS
        for node in ast.walk(tree(path))
        if isinstance(node, ast.ImportFrom) and node.level > 1
    ]
    assert upwards == []


def test_handlers_neither_evaluate_nor_operate():
    source = ast.unparse(tree(PACKAGE / "handlers.py"))
    for banned in ("view_layer.update(", "evaluated_depsgraph_get", "bpy.ops", "frame_set("):
        assert banned not in source


def test_no_error_is_swallowed():
    swallowed = [
        f"{name_of(path)}:{node.lineno}"
        for path in MODULES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.ExceptHandler)
        and (node.type is None or all(isinstance(line, ast.Pass) for line in node.body))
    ]
    assert swallowed == []


def test_no_path_of_any_machine():
    machine = re.compile(r"(?<![\w.$}])/(work|home|Users|root|opt)/\w|[A-Z]:\\\\?Users")
    found = [
        f"{name_of(path)}:{number}"
        for path in project_files()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if machine.search(line)
    ]
    assert found == []


def test_every_module_names_its_licence():
    line = "# SPDX-License-Identifier: GPL-3.0-or-later\n"
    unnamed = [p for p in MODULES if not p.read_text(encoding="utf-8").startswith(line)]
    assert [name_of(p) for p in unnamed] == []
