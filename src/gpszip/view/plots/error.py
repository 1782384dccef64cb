"""The kind ``error``: the distance between each sample and the walk at its time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.chart import chart_figure
from gpszip.drawing.elapsed import time_unit
from gpszip.drawing.map_lines import draw_samples
from gpszip.drawing.style import EDGE_COLOR, INK, MM_PER_INCH
from gpszip.errors import OptionError
from gpszip.view.plots.subject import Subject, require_times
from gpszip.walks.error import synchronised_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gpszip.drawing.style import Layout

__all__ = ["draw_errors"]

#: Height of the picture relative to its width.
_ASPECT = 0.42

#: Space above the largest error, relative to it.
_SPACE = 0.06

#: Least distance of two labels of two lines each, in millimetres.
_LABEL_DISTANCE = 7.0

#: Most intervals between the numbers of the axis of errors.
_INTERVALS = 5

Floats = NDArray[np.float64]


def draw_errors(subject: Subject, layout: Layout) -> Figure:
    """Draw the error at each sample over time, with the RMSE and the maximum."""
    from matplotlib.ticker import MaxNLocator

    # Errors of the samples that the walks cover.
    require_times(subject, "error")
    times, errors = _errors(subject)
    rmse, largest = float(np.sqrt(np.mean(errors**2))), float(errors.max())
    seconds, label = time_unit(float(times.min()), float(times.max()))

    # Dots.
    figure, axes = chart_figure(layout, _ASPECT)
    elapsed = (times - times.min()) / seconds
    draw_samples(axes, [np.column_stack([elapsed, errors])], EDGE_COLOR)
    axes.set_xlabel(label)
    axes.set_ylabel("error in metres")
    axes.yaxis.set_major_locator(MaxNLocator(_INTERVALS, steps=[1, 2, 5, 10]))
    axes.set_xlim(0, float(elapsed.max()) or 1.0)
    axes.set_ylim(0, largest * (1 + _SPACE) or 1.0)

    # Labels at their heights, right of the axes.
    top = axes.get_ylim()[1]
    axes.axhline(rmse, color=INK, linewidth=0.9, zorder=3, gid="rmse")
    at_largest = elapsed[errors.argmax()]
    axes.plot(at_largest, largest, marker="o", markersize=4, mfc="none", mec=INK, mew=0.8, zorder=3)
    if layout.legend:
        height = axes.get_position().height * figure.get_figheight() * MM_PER_INCH
        low = min(rmse, largest - _LABEL_DISTANCE / height * top)
        _label(axes, low, f"RMSE\n{rmse:.3g} m")
        _label(axes, largest, f"maximum\n{largest:.3g} m")
    return figure


def _label(axes: Axes, height: float, text: str) -> None:
    """Write a text right of the axes at a height of the data."""
    axes.text(
        1.02, height, text, transform=axes.get_yaxis_transform(), va="center", linespacing=1.1
    )


def _errors(subject: Subject) -> tuple[Floats, Floats]:
    """Return time and error of each sample of all tracks with times that a walk covers."""
    archive, times, errors = subject.archive, [np.empty(0)], [np.empty(0)]
    for track in subject.tracks:
        if track.timed:
            each = synchronised_errors(track, archive.walk(track.id), archive.road_map.nodes)
            covered = ~np.isnan(each)
            times.append(track.times[covered])
            errors.append(each[covered])
    if not sum(map(len, times)):
        raise OptionError(
            "the walks cover no sample of the log, so there is no error over time",
            remedy="give the log that was compressed, with its times",
        )
    return np.concatenate(times), np.concatenate(errors)
