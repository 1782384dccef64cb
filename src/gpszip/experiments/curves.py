"""Charts of curves with their names, over two axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gpszip.drawing.chart import chart_figure
from gpszip.drawing.style import CYCLE, FigureType, Layout, require_matplotlib, style

__all__ = ["Curve", "draw_curves"]

#: Width of charts in millimetres.
_WIDTH = 120.0

#: Height of charts relative to their width.
_ASPECT = 0.6


@dataclass(frozen=True)
class Curve:
    """One curve.

    Parameters
    ----------
    name : str
        Stands in the legend.
    xs, ys : sequence of float
        Its points.
    dashed : bool, default False
        Whether it is dashed, for numbers that were not computed here.
    """

    name: str
    xs: Sequence[float]
    ys: Sequence[float]
    dashed: bool = False


def draw_curves(
    curves: Sequence[Curve], x_label: str, y_label: str, *, log_x: bool = False, log_y: bool = False
) -> FigureType:
    """Draw curves on linear or logarithmic axes, with a legend of their names."""
    require_matplotlib()
    with style():
        # The legend stands within the axes.
        figure, axes = chart_figure(Layout(_WIDTH, legend=False), _ASPECT)
        for number, curve in enumerate(curves):
            axes.plot(
                curve.xs,
                curve.ys,
                color=CYCLE[number % len(CYCLE)],
                linestyle="--" if curve.dashed else "-",
                marker="o",
                markersize=3,
                linewidth=1,
                label=curve.name,
            )

        # Scales, ticks as plain numbers, and names.
        if log_x:
            axes.set_xscale("log")
        if log_y:
            axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _: f"{value:,.6g}")
            axis.set_minor_formatter(lambda *_: "")
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.legend(frameon=False)
    return figure
