"""Charts of curves with their names, over two axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gpszip.drawing.chart import chart_figure
from gpszip.drawing.style import CYCLE, INK, FigureType, Layout, require_matplotlib, style

__all__ = ["Curve", "draw_curves"]

#: Width of charts in millimetres.
_WIDTH = 120.0

#: Place of the label of the upright axis, relative to the width of the axes.
_LABEL = -0.09

#: The same where a legend stands beside the axes.
_NARROW_LABEL = -0.14

#: Millimetres of a legend beside the axes.
_LEGEND = 42.0

#: Colours and markers of curves, one after the other.
_COLORS, _MARKERS = (*CYCLE, INK, "#7F7F7F"), "os^vDPX<"

#: Range, from which on a logarithmic scale has ticks at powers of ten only.
_DECADES = 500.0

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
    curves: Sequence[Curve],
    x_label: str,
    y_label: str,
    *,
    log_x: bool = False,
    log_y: bool = False,
    beside: bool = False,
) -> FigureType:
    """Draw curves on linear or logarithmic axes, with a legend of their names.

    The legend stands within the axes, or beside them where it would cover curves. The first curve
    is the widest.
    """
    require_matplotlib()
    with style():
        # Curves, whose colours and markers tell them apart.
        figure, axes = chart_figure(Layout(_WIDTH, legend=beside), _ASPECT, _LEGEND)
        for number, curve in enumerate(curves):
            axes.plot(
                curve.xs,
                curve.ys,
                color=_COLORS[number % len(_COLORS)],
                linestyle="--" if curve.dashed else "-",
                marker=_MARKERS[number % len(_MARKERS)] if beside else "o",
                markersize=3,
                linewidth=1.8 if beside and number == 0 else 1,
                label=curve.name,
            )

        # Scales, and ticks as plain numbers: on a logarithmic scale at 1, 2 and 5.
        axes.set_xscale("log" if log_x else "linear")
        axes.set_yscale("log" if log_y else "linear")
        for axis, is_log in ((axes.xaxis, log_x), (axes.yaxis, log_y)):
            if is_log:
                axis.set_ticks(_round_numbers(*axis.get_view_interval()))
                axis.set_ticks([], minor=True)
            axis.set_major_formatter(lambda value, _: _plain(value))

        # What the axes and curves are.
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.yaxis.set_label_coords(_LABEL if not beside else _NARROW_LABEL, 0.5)
        if beside:
            axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        else:
            axes.legend(frameon=False)
    return figure


def _round_numbers(low: float, high: float) -> list[float]:
    """Return 1, 2 and 5 times powers of ten in a range, of a long range the powers only.

    Examples
    --------
    >>> _round_numbers(0.3, 12.0)
    [0.5, 1.0, 2.0, 5.0, 10.0]
    >>> _round_numbers(1.0, 1e4)
    [1.0, 10.0, 100.0, 1000.0, 10000.0]
    """
    digits = (1, 2, 5) if high < _DECADES * low else (1,)
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    numbers = [digit * 10.0**power for power in powers for digit in digits]
    return [number for number in numbers if low <= number <= high]


def _plain(value: float) -> str:
    """Format a number without an exponent.

    Examples
    --------
    >>> _plain(1e6), _plain(0.2)
    ('1,000,000', '0.2')
    """
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.6g}"
