"""Figure 6-3: the cost over m, the line through its extremes, and the elbow farthest below it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.chart import chart_figure
from gpszip.drawing.style import CYCLE, GREY, INK, FigureType, Layout, style
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.table import Column, Table
from gpszip.model import Track
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.search import find_elbow
from gpszip.testing import quadrotor

__all__ = ["run"]

#: Samples of the log, and those of a quick run.
_SAMPLES, _QUICK = 6_000, 1_500

#: Number of parts, and m up to which costs are computed; of a quick run, a third of both.
_K, _MOST = 60, 40

#: Samples of a part at least, so that a short log has fewer parts.
_PER_PART = 4

#: Width in millimetres, and height relative to it.
_WIDTH, _ASPECT = 85.0, 0.75

#: Place of the label of the upright axis, relative to the width of the axes.
_LABEL = -0.16


def run(setting: Setting) -> Outcome:
    """Compute the cost for each m, and compare the elbow with what algorithm 3 finds."""
    # The log, and numbers that suit its length.
    whole = setting.logs[0] if setting.logs else quadrotor(seed=setting.seed).tracks[0]
    track = first_samples(whole, _QUICK if setting.quick else _SAMPLES)
    k, most = (number // 3 if setting.quick else number for number in (_K, _MOST))
    k = max(min(k, len(track) // _PER_PART), 1)
    ms = np.arange(1, min(most, k) + 1)

    # Costs, their distances from the line, the elbow, and what the trinary search returns.
    costs = _costs(track, k, ms)
    depths = _depths(ms, costs)
    elbow = int(ms[depths.argmax()])
    found = find_elbow(1, int(ms[-1]), lambda some: [float(costs[m - 1]) for m in some])
    notes = (
        f"The elbow is m = {elbow}; the trinary search of algorithm 3 finds m = {found}.",
        "Distances are those below the line, with both axes scaled to 1.",
    )
    caption = f"Cost over m for k = {k}, and its distance below the line through the extremes."
    figure = _draw(ms, costs, elbow)
    return Outcome((_table(k, ms, costs, depths),), (Picture("", caption, figure),), notes)


def _costs(track: Track, k: int, ms: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.array([segment_mean(track, k, int(m)).cost for m in ms])


def _depths(ms: NDArray[np.int64], costs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance below the line through the extremes, with both axes scaled to 1."""
    if len(ms) == 1 or costs[0] == costs[-1]:
        return np.zeros(len(ms))
    right = (ms - ms[0]) / (ms[-1] - ms[0])
    up = (costs - costs[-1]) / (costs[0] - costs[-1])
    depths: NDArray[np.float64] = (1 - right - up) / np.sqrt(2)
    return depths


def _table(
    k: int, ms: NDArray[np.int64], costs: NDArray[np.float64], depths: NDArray[np.float64]
) -> Table:
    columns = (
        Column("m", "m"),
        Column("cost_m2", "cost m²", 0),
        Column("distance", "distance", 3),
    )
    rows = tuple(
        {"m": int(m), "cost_m2": float(cost), "distance": float(depth)}
        for m, cost, depth in zip(ms, costs, depths, strict=True)
    )
    return Table("", f"Cost of the (k,m)-segment mean, k = {k}", columns, rows)


def _draw(ms: NDArray[np.int64], costs: NDArray[np.float64], elbow: int) -> FigureType:
    """Draw the cost, the line through its extremes, and the distances between them."""
    with style():
        # Costs in a power of a thousand, of which few digits are left.
        power = 3 * int(np.log10(max(float(costs.max()), 1.0)) // 3)
        costs = costs / 10.0**power

        # Distances below, then the line and the costs.
        figure, axes = chart_figure(Layout(_WIDTH, legend=False), _ASPECT)
        line = np.interp(ms, ms[[0, -1]], costs[[0, -1]])
        axes.vlines(ms, costs, line, color=GREY, linewidth=0.6, zorder=1, label="distance to it")
        axes.plot(
            ms[[0, -1]],
            costs[[0, -1]],
            color=INK,
            linewidth=1,
            linestyle="--",
            label="line through the extremes",
        )
        axes.plot(ms, costs, color=CYCLE[0], marker="o", markersize=2.5, linewidth=1, label="cost")

        # The elbow.
        axes.plot(
            elbow,
            costs[elbow - 1],
            linestyle="",
            marker="o",
            markersize=6,
            markerfacecolor="none",
            color=CYCLE[5],
            label=f"elbow, m = {elbow}",
        )

        # What the axes are.
        axes.set_xlabel("m, number of segments")
        axes.set_ylabel("cost in m²" if power == 0 else f"cost in $10^{{{power}}}$ m²")
        axes.yaxis.set_label_coords(_LABEL, 0.5)
        axes.legend(frameon=False)
    return figure
