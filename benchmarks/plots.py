# SPDX-License-Identifier: GPL-3.0-or-later
"""Line charts as PNG. The only module that needs matplotlib, which Blender does not bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

COLOURS = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"),
    *("#8C6D31", "#999999"),
)
"""Told apart by colour-blind readers too (Okabe and Ito; the last two added)."""
MARKERS = "osD^vP*Xh"
FAINT = "#666666"


class MissingMatplotlib(Exception):
    """One line that says what to install."""


@dataclass(frozen=True)
class Curve:
    """A line of a chart.

    Attributes
    ----------
    x, y : same length; points of which either is not positive are left out on logarithmic axes.
    dashed : for what stands beside the subject, as a bound or a rival.
    number : of the colour and the mark; by default the curve's place in the chart.
    labels : a few words beside each point.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    number: int | None = None
    labels: Sequence[str] = ()


@dataclass(frozen=True)
class Chart:
    """What one picture shows; ``name`` is the file's, without the ending.

    An axis that is not logarithmic begins at zero.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    level: tuple[float, str] | None = None
    log_x: bool = True
    log_y: bool = True


def check() -> None:
    """Raise MissingMatplotlib where no chart can be drawn."""
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingMatplotlib(
            "plots need matplotlib: install it into the Python that runs this "
            "(python -m pip install matplotlib), or leave the plots out (--no-plots)"
        ) from error


def draw(chart: Chart, folder: Path) -> None:
    """Write a chart into a folder."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        """Numbers without powers, where the logarithmic axis labels anything at all."""

        def __call__(self, value, position=None):
            if not super().__call__(value, position):
                return ""
            return f"{value:,.0f}" if value >= 10 else f"{value:g}"

    figure = Figure(figsize=(8.4, 5.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_title(chart.title, fontsize=12, loc="left")
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel(chart.y_label)
    if chart.log_x:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(Plain())
        axes.xaxis.set_minor_formatter(Plain(minor_thresholds=(1.2, 0.4)))
    if chart.log_y:
        axes.set_yscale("log")
    for place, curve in enumerate(chart.curves):
        number = place if curve.number is None else curve.number
        colour = COLOURS[number % len(COLOURS)]
        points = [
            (x, y, curve.labels[k] if curve.labels else "")
            for k, (x, y) in enumerate(zip(curve.x, curve.y, strict=True))
            if (x > 0 or not chart.log_x) and (y > 0 or not chart.log_y)
        ]
        if not points:
            continue
        axes.plot(
            [point[0] for point in points],
            [point[1] for point in points],
            color=colour,
            marker=MARKERS[number % len(MARKERS)],
            markersize=5,
            linewidth=1.6,
            linestyle="--" if curve.dashed else "-",
            label=curve.label,
        )
        for at_x, at_y, words in points:
            if words:
                axes.annotate(
                    words,
                    (at_x, at_y),
                    xytext=(5, 4),
                    textcoords="offset points",
                    fontsize=7.5,
                    color=colour,
                )
    if not chart.log_y:
        axes.set_ylim(0.0, 1.1 * max(max(curve.y) for curve in chart.curves))
    if chart.level is not None:
        height, words = chart.level
        axes.axhline(height, color=FAINT, linewidth=1, linestyle=":")
        axes.annotate(
            words,
            (1, height),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 3),
            textcoords="offset points",
            ha="right",
            fontsize=8,
            color=FAINT,
        )
    axes.grid(which="major", color="#DDDDDD", linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", fontsize=8.5, frameon=False)
    figure.savefig(folder / f"{chart.name}.png")
