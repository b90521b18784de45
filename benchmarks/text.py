# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures as Markdown."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

_FIGURE = re.compile(r"(> |< )?-?\d[\d.,e-]*( %| \(.*\))?")


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a Markdown table; numbers stand on the right."""
    rows = [[cell if isinstance(cell, str) else number(cell) for cell in row] for row in rows]
    marks = []
    for column in range(len(header)):
        cells = [row[column] for row in rows if row[column] not in ("", "-")]
        numeric = bool(cells) and all(_FIGURE.fullmatch(cell) for cell in cells)
        marks.append("---:" if numeric else "---")
    lines = [header, marks, *rows]
    return ["| " + " | ".join(line) + " |" for line in lines] + [""]


def number(value: float | int | None) -> str:
    """Three digits that count; - for None, and for what is no number."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, int) or 100 <= abs(value) < 1e6:
        return f"{value:,.0f}"
    if value != 0 and (abs(value) < 1e-3 or abs(value) >= 1e6):
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    return f"{value:.3g}"


def milliseconds(timing: Mapping[str, float]) -> str:
    """The median of a time in milliseconds, and its spread."""
    middle, low, high = (1e3 * timing[name] for name in ("median", "low", "high"))
    return f"{number(middle)} ({number(low)} to {number(high)})"
