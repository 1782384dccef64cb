"""The figure: bytes over CPU seconds, one panel for each log."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .codecs import Codec
from .report import SHORTEST
from .results import Results

#: Color and marker of each codec: those of Okabe and Ito, which the colour-blind tell apart.
STYLES = {
    "gpszip": ("#0072B2", "o"),
    "td-tr": ("#D55E00", "s"),
    "cised-s": ("#009E73", "^"),
    "cised-wide": ("#009E73", "v"),
    "bottom-up": ("#B0578D", "D"),
    "sz3": ("#8A6D00", "P"),
    "pco": ("#4D4D4D", "X"),
    "bzip2": ("#4D4D4D", "<"),
    "zstd": ("#4D4D4D", ">"),
}

#: Inches of a panel with its margins; two of them are as wide as a page's text.
PANEL = (3.7, 2.7)

#: Inches to the left, right, bottom and top of the axes of a panel: numbers, names, and titles.
MARGINS = (0.6, 0.92, 0.44, 0.42)

#: Points of height of a label.
LABEL_SIZE = 7.5

#: Points between the baselines of two labels.
LABEL_PITCH = 9.5

#: Points between two efforts with labels of their own.
EFFORT_PITCH = 9.0

#: Points between the axes and the labels.
LABEL_GAP = 12

#: Speed that the vertical line shows, in points per second.
GOAL = 1e6

SETTINGS = {
    "svg.fonttype": "path",
    "svg.hashsalt": "gpszip",
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}


def draw(results: Results, codecs: list[Codec], path: Path) -> None:
    """Draw the panels of all logs; the suffix of the path says in which format."""
    columns = min(2, len(results.logs))
    rows = math.ceil(len(results.logs) / columns)
    with mpl.rc_context(SETTINGS):
        # One panel for each log.
        figure = plt.figure(figsize=(PANEL[0] * columns, PANEL[1] * rows))
        for number, title in enumerate(results.logs):
            panel = add_panel(figure, divmod(number, columns), rows, columns)
            draw_panel(panel, results, title, codecs)
            place_labels(panel, results, title, codecs)
            if number % columns == 0:
                panel.set_ylabel("Compressed size (bytes)")
            if number + columns >= len(results.logs):
                panel.set_xlabel("CPU time after start-up (s)")

        # No date, so that the same results give the same file.
        metadata = {"Date": None} if path.suffix == ".svg" else None
        figure.savefig(path, metadata=metadata, dpi=200)
        plt.close(figure)


def add_panel(figure: Figure, place: tuple[int, int], rows: int, columns: int) -> Axes:
    """Add the axes of the panel in a row and column, with its margins."""
    row, column = place
    left, right, low, high = MARGINS
    width, height = PANEL[0] * columns, PANEL[1] * rows
    return figure.add_axes(
        (
            (column * PANEL[0] + left) / width,
            ((rows - 1 - row) * PANEL[1] + low) / height,
            (PANEL[0] - left - right) / width,
            (PANEL[1] - low - high) / height,
        )
    )


def draw_panel(panel: Axes, results: Results, title: str, codecs: list[Codec]) -> None:
    """Draw one log: a line for each codec from its quick to its thorough level."""
    # Logarithmic axes, and the title.
    log = results.logs[title]
    panel.set(xscale="log", yscale="log")
    facts = f"{log['points']:,} points, {log['tracks']} track{'s' * (log['tracks'] > 1)}, "
    panel.set_title(title, loc="left", fontweight="bold", fontsize=8.5, pad=13)
    panel.text(0, 1.02, f"{facts}within {log['bound']:g} m", transform=panel.transAxes, va="bottom")

    # The codecs.
    for codec in codecs:
        points = [result for _, result in results.points_of(title, codec)]
        color, marker = STYLES[codec.name]
        is_ours = codec.name == "gpszip"
        panel.plot(
            [max(result["seconds"], SHORTEST) for result in points],
            [result["bytes"] for result in points],
            color=color,
            marker=marker,
            markersize=5 if is_ours else 4,
            linewidth=2 if is_ours else 0.8,
            zorder=3 if is_ours else 2,
            clip_on=False,
        )

    # Space for the efforts below the points and for the speed below them, and few ticks.
    low, high = panel.get_ylim()
    panel.set_ylim(low / (high / low) ** 0.22, high)
    draw_goal(panel, log["points"] / GOAL)
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0,)))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_minor_formatter(NullFormatter())
        axis.set_tick_params(which="minor", size=0)


def draw_goal(panel: Axes, seconds: float) -> None:
    """Draw the CPU time of a million points a second, where the panel has it."""
    left, right = panel.get_xlim()
    if left < seconds < right:
        panel.axvline(seconds, color="#888888", linewidth=0.6, linestyle=(0, (3, 3)), zorder=1)
        panel.annotate(
            "1 million points/s",
            (seconds, 0),
            xycoords=("data", "axes fraction"),
            xytext=(3, 3),
            textcoords="offset points",
            fontsize=6.5,
            color="#666666",
        )


def place_labels(panel: Axes, results: Results, title: str, codecs: list[Codec]) -> None:
    """Write the names of the codecs in a column on the right, and the efforts beside GPSZip."""
    # The last point of each codec, in points on the page.
    to_page = 72 / panel.figure.dpi
    ends = []
    for codec in codecs:
        points = results.points_of(title, codec)
        if points:
            result = points[-1][1]
            place = (max(result["seconds"], SHORTEST), result["bytes"])
            height = panel.transData.transform(place)[1] * to_page
            ends.append((height, place, codec))
    ends.sort(key=lambda end: end[0])

    # Names, with a thin line to their points.
    heights = spread([height for height, _, _ in ends])
    right = panel.transAxes.transform((1.0, 0))[0] * to_page + LABEL_GAP
    for (_, place, codec), height in zip(ends, heights, strict=True):
        at = panel.transData.inverted().transform((right / to_page, height / to_page))
        panel.annotate(
            codec.label,
            place,
            xytext=at,
            textcoords="data",
            fontsize=LABEL_SIZE,
            fontweight="bold" if codec.name == "gpszip" else "normal",
            color=STYLES[codec.name][0],
            va="center",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "linewidth": 0.4,
                "color": "#AAAAAA",
                "shrinkA": 0,
                "shrinkB": 3,
            },
        )

    # Efforts; those at one place share a label, and the last of a place is where it stands.
    groups: list[tuple[list[str], tuple[float, float]]] = []
    for level, result in results.points_of(title, codecs[0]):
        place = (max(result["seconds"], SHORTEST), result["bytes"])
        if groups:
            distance = math.dist(*panel.transData.transform([groups[-1][1], place])) * to_page
            if distance < EFFORT_PITCH:
                groups[-1] = ([*groups[-1][0], level], place)
                continue
        groups.append(([level], place))
    for levels, place in groups:
        panel.annotate(
            ", ".join(levels),
            place,
            xytext=(0, -10),
            textcoords="offset points",
            fontsize=6.5,
            ha="center",
            color=STYLES["gpszip"][0],
        )


def spread(heights: list[float]) -> list[float]:
    """Move ascending heights apart to the pitch of labels, by as little as that takes."""
    # Groups of touching labels share the mean of where they would be.
    groups: list[list[float]] = []
    for height in heights:
        groups.append([height])
        while len(groups) > 1 and bottom(groups[-1]) - top(groups[-2]) < LABEL_PITCH:
            last = groups.pop()
            groups[-1] += last
    return [bottom(group) + i * LABEL_PITCH for group in groups for i in range(len(group))]


def bottom(group: list[float]) -> float:
    """Height of the lowest label of a group that is centered on the mean of its points."""
    return sum(group) / len(group) - (len(group) - 1) * LABEL_PITCH / 2


def top(group: list[float]) -> float:
    """Height of the highest label of a group."""
    return bottom(group) + (len(group) - 1) * LABEL_PITCH
