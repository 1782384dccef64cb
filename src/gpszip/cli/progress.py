"""A line of progress on standard error, if that is a terminal that can redraw it."""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text

    from gpszip.model import Listener, Progress

__all__ = ["ProgressLine", "progress_bar"]

#: Times a second that the line is drawn: a person sees no more, and a slow terminal keeps up.
_UPDATES_PER_SECOND = 10

#: Seconds of a stage before its speed and the time left are shown: at first they jump.
_MIN_SECONDS = 2.0

#: Steps of a stage that are done before the time left is shown.
_MIN_STEPS = 2

#: Letters of the bar at least; a narrower line has none.
_MIN_BAR = 10

#: Letters of the bar at most.
_MAX_BAR = 40


@contextmanager
def progress_bar(*, quiet: bool) -> Iterator[Listener | None]:
    """Show the progress of a long computation.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Yields
    ------
    callable or None
        Listener for each :class:`~gpszip.model.Progress`; None if nothing is shown.
    """
    # The line is redrawn in its place, which files, pipes and TERM=dumb can't do.
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.live import Live

    from gpszip.kernels.compiling import on_compile

    console = Console(stderr=True)
    if console.is_dumb_terminal:
        yield None
        return

    # A thread draws the line, so that seconds go on while a stage works; it is erased at the end.
    line = ProgressLine()
    live = Live(
        get_renderable=lambda: line.draw(console.width - 1),
        console=console,
        refresh_per_second=_UPDATES_PER_SECOND,
        transient=True,
        redirect_stdout=False,
    )

    # While the caller works, say when a kernel compiles: it would look like a stalled stage.
    with live, on_compile(line.note_compiling):
        yield line.show


class ProgressLine:
    """The text of the line: stage, share done, points per second, time left.

    A stage that begins again, because the archive missed its bound, is another try of its own. The
    share of a try never goes back. The time left follows from the shares so far. It counts down
    from one step to the next, and is left out once it has passed without a step, so that it never
    says 0 s.

    Parameters
    ----------
    clock : callable, optional
        Returns seconds; by default :func:`time.monotonic`.

    Examples
    --------
    >>> from gpszip.model import Progress
    >>> now = [0.0]
    >>> line = ProgressLine(lambda: now[0])
    >>> line.show(Progress("encode", 0.0, 8000))
    >>> for now[0], share in [(5.0, 0.25), (10.0, 0.5)]:
    ...     line.show(Progress("encode", share, 8000))
    >>> line.draw(60).plain
    'encode  [########........]  50 %  400 points/s  10 s left'
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._stage = "read"  # what all commands begin with
        self._points = 0
        self._tries: Counter[str] = Counter()
        self._kernels = 0
        self._is_compiling = False
        self._begin_try()

    def _begin_try(self) -> None:
        self._done = 0.0
        self._steps = 0
        self._start = self._last = self._clock()

    def show(self, event: Progress) -> None:
        """Take in which share of a stage is done."""
        # Another stage, or the same one anew.
        self._is_compiling = False
        began_again = event.done < self._done or self._done >= 1.0
        if event.stage != self._stage or began_again:
            self._stage = event.stage
            self._tries[event.stage] += 1
            self._begin_try()

        # One step more of it.
        self._points = event.points
        if event.done > self._done:
            self._done = min(event.done, 1.0)
            self._steps += 1
            self._last = self._clock()

    def note_compiling(self) -> None:
        """Take in that a kernel begins to compile; how many are left is unknown."""
        self._kernels += 1
        self._is_compiling = True

    @property
    def seconds_left(self) -> float | None:
        """Time until the stage is done; None if there is no estimate."""
        elapsed = self._last - self._start
        if self._steps < _MIN_STEPS or elapsed < _MIN_SECONDS or self._done >= 1.0:
            return None

        # Once it has passed without a step, nothing is known any more.
        left = elapsed * (1.0 - self._done) / self._done - (self._clock() - self._last)
        return left if left > 0 else None

    @property
    def points_per_second(self) -> float | None:
        """Points of the stage that are done in a second; None before that is known."""
        elapsed = self._last - self._start
        if not self._points or not self._done or elapsed < _MIN_SECONDS:
            return None
        return self._points * self._done / elapsed

    def draw(self, width: int) -> Text:
        """Return the line, in at most ``width`` letters."""
        from rich.text import Text

        # What is left out first where the line is narrow comes last here.
        parts = _choose_parts(self._list_parts(), width)
        text = "  ".join(part for part in parts if part)

        # The bar stands behind the stage, and takes the letters that are left.
        line = Text(parts[0], no_wrap=True, overflow="crop")
        bar_width = min(width - len(text) - len("  []"), _MAX_BAR)
        if not self._is_compiling and self._done > 0 and bar_width >= _MIN_BAR:
            full = int(self._done * bar_width)
            line.append("  [").append("#" * full, "green").append("." * (bar_width - full), "dim")
            line.append("]")
        line.append(text[len(parts[0]) :])
        line.truncate(width)
        return line

    def _list_parts(self) -> list[str]:
        """Return the parts of the line; those that are missing are empty."""
        if self._is_compiling:
            return [f"compile kernel {self._kernels}", "once for this installation"]

        # The stage, then what is known of it.
        tries = self._tries[self._stage]
        stage = self._stage if tries < 2 else f"{self._stage}, try {tries}"
        left, speed = self.seconds_left, self.points_per_second
        share = f"{math.floor(100 * self._done):2d} %" if self._done > 0 else ""
        points = f"{self._points:,} points" if self._points else ""
        if speed is not None:
            points = f"{speed:,.0f} points/s"
        ending = _clock_text(self._clock() - self._start)
        if left is not None:
            ending = f"{_duration_text(left)} left"
        return [stage, share, points, ending]


def _choose_parts(parts: list[str], width: int) -> list[str]:
    """Return the parts that a width allows: points go first, then the share, at last the time."""
    for dropped in ((), (2,), (1, 2), range(1, len(parts))):
        kept = [part for number, part in enumerate(parts) if number not in dropped]
        if len("  ".join(part for part in kept if part)) <= width:
            return kept
    return parts[:1]


def _clock_text(seconds: float) -> str:
    """Return the time since a stage began, such as ``0:07``."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _duration_text(seconds: float) -> str:
    """Return the time left with as many digits as are worth it; never 0."""
    if seconds < 90:
        return f"{math.ceil(seconds)} s"
    if seconds < 5400:
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"
