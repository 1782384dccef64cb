"""What is wrong with the source of an agent's fixes: one event when it begins, one when it ends."""

from __future__ import annotations

from typing import Any

from gpszip.live.events import Event
from gpszip.live.fix import Fix, Marks, distance
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.text import duration_text

__all__ = ["MAX_AHEAD", "SourceTracker"]

#: Seconds by which a fix may be ahead of its receipt.
MAX_AHEAD = 86_400.0

#: Seconds after which a fix is stale.
_STALE = 3_600.0

#: Times below are seconds since some other zero than 1970.
_FIRST_DATE = 1e8

#: Fixes at exactly one position, and their seconds, that are taken for one that a receiver repeats.
_MIN_REPEATS = 10
_MIN_REPEATED = 60.0

#: Metres per second at which an agent was moving when its position began to be repeated: whoever
#: parks sends the same position rightly.
_MOVING = 3.0

#: Seconds of a step that shows whether it was.
_MAX_STEP = 60.0

#: Metres per second that a source states while its position stays.
_STATED = 1.0


class SourceTracker:
    """Watches clock, age and repeats of one agent's fixes.

    Parameters
    ----------
    known : KnownEvents
        Makes the events.
    """

    def __init__(self, known: KnownEvents) -> None:
        self._known = known
        self._wrong: dict[str, float] = {}
        self._last: Fix | None = None
        self._first: Fix | None = None
        self._repeats = 0
        self._was_moving = False

    def take(self, fix: Fix) -> list[Event]:
        """Return the events after a fix."""
        events = []
        is_stale = fix.time >= _FIRST_DATE and fix.age > _STALE
        events += self._note(
            "source.stale", fix, is_stale, f"{duration_text(max(fix.age, 0.0))} old"
        )
        is_repaired = Marks.ROLLOVER in fix.quality
        events += self._note("source.clock", fix, is_repaired, "1024 weeks were added to its time")
        events += self._note(
            "source.repeat", fix, self._is_repeated(fix), "at one position exactly"
        )
        return events

    def refuse(self, time: float, received: float) -> list[Event]:
        """Return the events after a fix that was refused for its time."""
        why = f"{duration_text(time - received)} ahead"
        fix = Fix("", "", received, received, ())
        return self._note("source.clock", fix, True, why)

    def _note(self, kind: str, fix: Fix, is_wrong: bool, why: str) -> list[Event]:
        """Tell a change: one event when something begins to be wrong, one when it is right."""
        if is_wrong == (kind in self._wrong):
            return []
        details: dict[str, Any] = {"wrong": is_wrong}
        if is_wrong:
            self._wrong[kind] = fix.time
        else:
            since = self._wrong.pop(kind)
            details["start"], why = round(since, 3), f"after {duration_text(fix.time - since)}"
        finding = Finding(kind, fix.time, fix.position or None, "", why, details)
        return [self._known.tell(finding, fix.received, like=f"{fix.time:.3f} {is_wrong}")]

    def _is_repeated(self, fix: Fix) -> bool:
        """Whether the source repeats a position while the agent moves."""
        last, self._last = self._last, fix
        if last is None or fix.position != last.position:
            seconds = 0.0 if last is None else fix.time - last.time
            is_near = last is not None and 0 < seconds <= _MAX_STEP
            self._was_moving = is_near and distance(last or fix, fix) > _MOVING * seconds
            self._first, self._repeats = fix, 1
            return False

        # The same position again: is it contradicted?
        self._repeats += 1
        moves = self._was_moving or (fix.speed is not None and fix.speed > _STATED)
        since = fix.time - (self._first or fix).time
        is_long = self._repeats >= _MIN_REPEATS and since >= _MIN_REPEATED
        return "source.repeat" in self._wrong or (moves and is_long)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "wrong": self._wrong,
            "last": None if self._last is None else self._last.to_row(),
            "first": None if self._first is None else self._first.to_row(),
            "repeats": self._repeats,
            "moving": self._was_moving,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._wrong = dict(row["wrong"])
        self._last = None if row["last"] is None else Fix.from_row(row["last"])
        self._first = None if row["first"] is None else Fix.from_row(row["first"])
        self._repeats, self._was_moving = row["repeats"], row["moving"]
