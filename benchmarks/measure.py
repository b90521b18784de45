# SPDX-License-Identifier: GPL-3.0-or-later
"""Times, and the machine that they hold for."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np


def timings(
    candidates: Mapping[str, Callable[[], object]],
    repeats: int,
    judge: Callable[[str, object], None] = lambda name, result: None,
) -> dict[str, dict[str, float]]:
    """Seconds that each candidate takes, in turns, so that a slow spell of the machine hits all.

    Parameters
    ----------
    judge : takes each candidate's name and result, once, out of the time.

    Returns
    -------
    dict : name -> as :func:`spread`. A first turn of each is not counted.
    """
    samples: dict[str, list[float]] = {name: [] for name in candidates}
    for name, candidate in candidates.items():
        judge(name, candidate())
    for _ in range(repeats):
        for name, candidate in candidates.items():
            samples[name].append(seconds(candidate))
    return {name: spread(found) for name, found in samples.items()}


def seconds(function: Callable[[], object]) -> float:
    """Wall time of one call."""
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def cpu_seconds(function: Callable[[], object]) -> float:
    """CPU time of one call, all threads."""
    started = time.process_time()
    function()
    return time.process_time() - started


def spread(samples: list[float]) -> dict[str, float]:
    """Median, least and greatest of some samples, and all of them."""
    return {
        "median": float(np.median(samples)),
        "low": min(samples),
        "high": max(samples),
        "samples": list(samples),
    }


def machine() -> dict[str, str | int]:
    """Processor, cores and versions."""
    if "bpy" in sys.modules:
        import bpy

        blender = bpy.app.version_string
    else:
        blender = "not loaded"
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 0,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "blender": blender,
    }


def _processor() -> str:
    table = Path("/proc/cpuinfo")
    fields = {}
    if table.exists():
        lines = (line.partition(":") for line in table.read_text().splitlines())
        for name, _, value in lines:
            fields.setdefault(name.strip(), value.strip())
    if "model name" not in fields:
        return platform.processor() or platform.machine()
    details = (("cpu family", "family"), ("model", "model"), ("cpu MHz", "MHz"))
    known = ", ".join(f"{word} {fields[name]}" for name, word in details if name in fields)
    return f"{fields['model name']} ({known})"
