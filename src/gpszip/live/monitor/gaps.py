"""Agents that are not heard of any more, and those that are heard of again."""

from __future__ import annotations

import numpy as np

from gpszip.live.events import Event
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.text import duration_text
from gpszip.live.monitor.window import Window

__all__ = ["GapTracker"]

_KINDS = frozenset({"silent", "back"})


class GapTracker:
    """Tells gaps between the fixes of one agent, and the one after the last fix.

    Parameters
    ----------
    window : Window
        Its last fixes.
    known : KnownEvents
        What was told.
    longest : float
        Seconds; a longer gap is told.
    """

    def __init__(self, window: Window, known: KnownEvents, longest: float) -> None:
        self._window, self._known, self._longest = window, known, longest

        #: Whether the agent was told to be silent.
        self.is_silent = False

    def take(self, received: float, settled: float) -> list[Event]:
        """Return the events after a fix, the newest of the window."""
        window = self._window
        count = len(window)
        is_gap = count > 1 and window.last - window.time(count - 2) > self._longest
        return self.read(received, settled) if is_gap or self.is_silent else []

    def read(self, received: float, settled: float, *, is_silent: bool = False) -> list[Event]:
        """Compare all gaps of the window with what was told.

        Parameters
        ----------
        received : float
            When the last fix was received, or now.
        settled : float
            What was told up to this time stays.
        is_silent : bool
            Whether the last fix is too long ago.
        """
        window, times = self._window, self._window.times
        findings = []
        for row in np.flatnonzero(np.diff(times) > self._longest).tolist():
            seconds = float(times[row + 1] - times[row])
            findings.append(self._silent(row))
            why, details = f"after {duration_text(seconds)}", {"start": round(times[row], 3)}
            findings.append(
                Finding("back", window.time(row + 1), window.position(row + 1), "", why, details)
            )
        if is_silent and len(times):
            findings.append(self._silent(len(times) - 1))
        self.is_silent = is_silent
        return self._known.update(findings, received, after=settled, kinds=_KINDS)

    def _silent(self, row: int) -> Finding:
        why = f"no fix in {duration_text(self._longest)}"
        return Finding("silent", self._window.time(row), self._window.position(row), why=why)
