"""The kind ``rate``: bytes against error, of several archives of one log."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.chart import chart_figure
from gpszip.drawing.style import CYCLE, EDGE_COLOR, printable
from gpszip.errors import OptionError
from gpszip.geo.planes import reproject_track
from gpszip.view.plots.subject import Subject
from gpszip.walks.error import measure_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gpszip.archive import Archive
    from gpszip.drawing.style import Layout

__all__ = ["draw_rates"]

#: Height of the picture relative to its width.
_ASPECT = 0.62

#: Factors by which the axes reach beyond the data.
_SPACE = 1.3

#: Least value on a logarithmic scale, in place of zero.
_LEAST = 1e-9

#: Decades that an axis spans at most, and the digits of its ticks then.
_STEPS = ((1.2, (1, 1.5, 2, 3, 5, 7)), (3.0, (1, 2, 5)), (math.inf, (1,)))

#: With more archives, their names would overlap.
_MAX_NAMED = 8

#: Name, colour and marker of each curve.
_CURVES = (("RMSE", EDGE_COLOR, "o"), ("maximum", CYCLE[-1], "s"))

Floats = NDArray[np.float64]


def draw_rates(subject: Subject, layout: Layout) -> Figure:
    """Draw the bytes of archives over their RMSE and maximum error, on logarithmic scales.

    The errors are measured at the samples of the log if it is given; else they are the bounds that
    the archives state.
    """
    # Sizes and errors.
    sizes = np.array([archive.size for archive in subject.archives], np.float64)
    errors = np.array([_errors(subject, archive) for archive in subject.archives])
    if np.isnan(errors).all():
        raise OptionError("the archives state no error bound", remedy="give the log to measure it")

    # A curve for the RMSE, and one for the maximum.
    figure, axes = chart_figure(layout, _ASPECT)
    _set_scales(axes, errors, sizes)
    for number, (name, color, marker) in enumerate(_CURVES):
        _draw_curve(axes, errors[:, number], sizes, color, marker)
        if layout.legend:
            _label_curve(axes, errors[:, number], sizes, name, color)

    # What the axes and points are.
    if layout.legend:
        _label_archives(axes, subject, errors, sizes)
    axes.set_xlabel(f"{'' if subject.tracks else 'bound on the '}error in metres")
    axes.set_ylabel("bytes")
    return figure


def _errors(subject: Subject, archive: Archive) -> tuple[float, float]:
    """Return the RMSE and the maximum error of an archive in metres; NaN for what is unknown."""
    # Measure both at the samples.
    if subject.tracks:
        plane = archive.grid.plane
        tracks = [
            track if plane is None else reproject_track(track, plane) for track in subject.tracks
        ]
        walks = [archive.walk(track.id) for track in tracks]
        measured = measure_errors(tracks, walks, archive.road_map.nodes)
        return measured.rmse, measured.max_error

    # Take what the archive states.
    bound = archive.error_bound
    if bound is None:
        return math.nan, math.nan
    if bound.maximum:
        return math.nan, bound.metres
    return bound.metres, math.nan if bound.max_error is None else bound.max_error


def _draw_curve(axes: Axes, errors: Floats, sizes: Floats, color: str, marker: str) -> None:
    """Draw the archives whose error is known, in the order of their errors."""
    order = np.lexsort([-sizes, errors])
    order = order[~np.isnan(errors[order])]
    axes.plot(
        errors[order], sizes[order], color=color, marker=marker, markersize=4, linewidth=1, zorder=3
    )


def _label_curve(axes: Axes, errors: Floats, sizes: Floats, name: str, color: str) -> None:
    """Write the name of a curve below its end at the largest error."""
    if np.isnan(errors).all():
        return
    last = int(np.nanargmax(errors))
    axes.annotate(
        name,
        (errors[last], sizes[last]),
        xytext=(0, -5),
        textcoords="offset points",
        ha="center",
        va="top",
        color=color,
        fontweight="bold",
    )


def _label_archives(axes: Axes, subject: Subject, errors: Floats, sizes: Floats) -> None:
    """Write the name of each archive at the right of its smallest error."""
    if len(subject.names) > _MAX_NAMED:
        return
    for name, known, size in zip(subject.names, errors, sizes, strict=True):
        if not np.isnan(known).all():
            axes.annotate(
                printable(name),
                (np.nanmin(known), size),
                xytext=(5, 1),
                textcoords="offset points",
                ha="left",
                va="bottom",
                fontsize=6,
                parse_math=False,
            )


def _set_scales(axes: Axes, errors: Floats, sizes: Floats) -> None:
    """Set logarithmic scales that hold the data, with ticks at round numbers."""
    known = errors[~np.isnan(errors)]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*_limits(known))
    axes.set_ylim(*_limits(sizes))
    for axis, limits in ((axes.xaxis, _limits(known)), (axes.yaxis, _limits(sizes))):
        ticks = _round_numbers(*limits)
        axis.set_ticks(ticks, [f"{tick:,.6g}" for tick in ticks])
        axis.set_ticks([], minor=True)


def _limits(values: Floats) -> tuple[float, float]:
    """Return the ends of a logarithmic axis that shows all values."""
    low, high = (max(float(value), _LEAST) for value in (values.min(), values.max()))
    return low / _SPACE, high * _SPACE


def _round_numbers(low: float, high: float) -> list[float]:
    """Return the round numbers in a range: few digits times powers of ten, fewer in a large one.

    Examples
    --------
    >>> _round_numbers(60.0, 400.0), _round_numbers(0.3, 12.0), _round_numbers(9.0, 4e4)
    ([70.0, 100.0, 150.0, 200.0, 300.0], [0.5, 1.0, 2.0, 5.0, 10.0], [10.0, 100.0, 1000.0, 10000.0])
    """
    decades = math.log10(high / low)
    steps = next(digits for most, digits in _STEPS if decades <= most)
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    numbers = [step * 10.0**power for power in range(first, last + 1) for step in steps]
    return [number for number in numbers if low <= number <= high]
