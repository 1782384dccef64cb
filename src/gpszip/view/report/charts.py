"""Small pictures of a report: bars, hours of the week, speeds by hour, as inline SVG.

Colours are classes of report.css, so that they follow light, dark and print. Each picture has
a text for those who don't see it, and each bar a title.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Bar", "draw_bars", "draw_speeds", "draw_week"]

#: Width of a picture, and the margins for labels, in its own units: pixels in a window as wide.
_WIDTH, _LEFT, _BOTTOM, _TOP = 720, 62, 20, 8

#: Height of bars, and of a row of the week.
_HEIGHT, _ROW = 130, 19

#: Labels along the bars at most.
_MAX_LABELS = 8

#: Days of the week.
_DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")

#: Least and full opacity of an hour of the week in which something moves.
_FAINT, _FULL = 0.1, 1.0


@dataclass(frozen=True)
class Bar:
    """A bar of a picture.

    Parameters
    ----------
    value : float
        Its height.
    label : str
        What stands below it.
    title : str
        What it says when it is pointed at.
    marked : bool
        Whether it has the colour of what is to be looked at.
    """

    value: float
    label: str
    title: str
    marked: bool = False


def draw_bars(bars: Sequence[Bar], text: str, top: str) -> str:
    """Draw bars.

    Parameters
    ----------
    bars : sequence of Bar
        From left to right.
    text : str
        What the picture says, in words.
    top : str
        Value of the highest bar, with its unit.

    Examples
    --------
    >>> picture = draw_bars([Bar(2, "a", "a: 2"), Bar(1, "<b>", "b: 1")], "two bars", "2")
    >>> picture.count("<rect"), "&lt;b&gt;" in picture
    (2, True)
    """
    # Bars as wide as there is space for, with a pixel between them.
    most = max((bar.value for bar in bars), default=0.0) or 1.0
    step = (_WIDTH - _LEFT) / max(len(bars), 1)
    width = max(min(step - 1, 40.0), step * 0.6)
    shapes = []
    for i, bar in enumerate(bars):
        height = bar.value / most * _HEIGHT
        kind = "marked" if bar.marked else "bar"
        shapes.append(
            f'<rect class="{kind}" x="{_LEFT + i * step + (step - width) / 2:.1f}" '
            f'y="{_TOP + _HEIGHT - height:.1f}" width="{width:.1f}" height="{height:.1f}">'
            f"<title>{html.escape(bar.title)}</title></rect>"
        )

    # Labels below some of them, and the axis.
    every = -(-len(bars) // _MAX_LABELS)
    labels = [
        _text(_LEFT + (i + 0.5) * step, _TOP + _HEIGHT + 14, bars[i].label, "middle")
        for i in range(0, len(bars), max(every, 1))
    ]
    return _frame(_TOP + _HEIGHT + _BOTTOM, text, [*shapes, *labels, *_axis(top)])


def draw_week(
    values: Sequence[float], text: str, titles: Sequence[str], days: Sequence[str] = _DAYS
) -> str:
    """Draw 168 hours of a week: the darker, the more.

    Parameters
    ----------
    values : sequence of float
        One for each hour, from Monday 0 o'clock.
    text : str
        What the picture says, in words.
    titles : sequence of str
        What each hour says when it is pointed at.
    days : sequence of str
        Labels of the seven days; by default those of a week.
    """
    # The square root of the share: what is rare is seen, too.
    most = max(values) or 1.0
    step = (_WIDTH - _LEFT) / 24
    shapes = []
    for i, (value, title) in enumerate(zip(values, titles, strict=True)):
        day, hour = divmod(i, 24)
        opacity = _FAINT + (_FULL - _FAINT) * (value / most) ** 0.5 if value > 0 else 0.0
        look = f'class="bar" fill-opacity="{opacity:.2f}"' if value > 0 else 'class="empty"'
        shapes.append(
            f'<rect {look} x="{_LEFT + hour * step:.1f}" y="{_TOP + day * _ROW}" '
            f'width="{step - 2:.1f}" height="{_ROW - 2}" rx="2">'
            f"<title>{html.escape(title)}</title></rect>"
        )
    rows = [_text(_LEFT - 6, _TOP + i * _ROW + 13, day, "end") for i, day in enumerate(days)]
    hours = [
        _text(_LEFT + hour * step, _TOP + 7 * _ROW + 13, f"{hour}", "start")
        for hour in range(0, 24, 3)
    ]
    return _frame(_TOP + 7 * _ROW + _BOTTOM, text, [*shapes, *rows, *hours])


def draw_speeds(
    hours: Sequence[int], quartiles: Sequence[tuple[float, float, float]], text: str, top: str
) -> str:
    """Draw the median speed of hours of the day as dots, and the middle half as bars.

    Parameters
    ----------
    hours : sequence of int
        Hours in which something moves.
    quartiles : sequence of (float, float, float)
        Quartiles of the speeds in each.
    text : str
        What the picture says, in words.
    top : str
        The largest quartile, with its unit.
    """
    # The middle half of the speeds, and the median on it.
    most = max((high for _, _, high in quartiles), default=0.0) or 1.0
    step = (_WIDTH - _LEFT) / 24
    shapes = []
    for hour, (low, middle, high) in zip(hours, quartiles, strict=True):
        x = _LEFT + (hour + 0.5) * step
        y_low, y_middle, y_high = (_TOP + _HEIGHT * (1 - v / most) for v in (low, middle, high))
        shapes.append(
            f'<rect class="half" x="{x - 5:.1f}" y="{y_high:.1f}" width="10" '
            f'height="{max(y_low - y_high, 1):.1f}" rx="3"/>'
            f'<circle class="marked" cx="{x:.1f}" cy="{y_middle:.1f}" r="3.5"/>'
        )

    # Hours below them.
    labels = [
        _text(_LEFT + hour * step, _TOP + _HEIGHT + 14, str(hour), "middle")
        for hour in range(0, 24, 3)
    ]
    return _frame(_TOP + _HEIGHT + _BOTTOM, text, [*_axis(top), *shapes, *labels])


def _axis(top: str) -> list[str]:
    """The line at 0, and the value at the top."""
    foot = _TOP + _HEIGHT
    return [
        f'<path class="axis" d="M{_LEFT} {foot}H{_WIDTH}M{_LEFT} {_TOP}H{_WIDTH}"/>',
        _text(_LEFT - 6, foot + 1, "0", "end"),
        _text(_LEFT - 6, _TOP + 5, top, "end"),
    ]


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(text)}</text>'


def _frame(height: float, text: str, shapes: Sequence[str]) -> str:
    return (
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {height:.0f}" role="img" '
        f'aria-label="{html.escape(text)}">{"".join(shapes)}</svg>'
    )
