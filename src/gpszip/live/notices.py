"""What a listener tells: counts of everything it met, and lines for a person.

A line is told when something happens to an agent for the first time, and again when it has
happened 10, 100, 1,000, ... times.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable

from gpszip.model.text import count_phrase

__all__ = ["Notices", "printable"]

#: Pairs of agent and event whose counts are kept; of more, the one unused for longest goes.
_MAX_PAIRS = 20_000

#: Different events that are counted; senders can't invent any, so that this is never reached.
_MAX_EVENTS = 1_000

#: Letters of a value that a line shows.
_MAX_VALUE_LETTERS = 160


class Notices:
    """Counts events, and tells of them.

    Parameters
    ----------
    tell : callable
        Called with each line.

    Examples
    --------
    >>> notices = Notices(print)
    >>> for _ in range(10):
    ...     notices.note("positions at 0,0 left out", "bus")
    bus: positions at 0,0 left out
    bus: positions at 0,0 left out (10 by now)
    >>> notices.counts["positions at 0,0 left out"]
    10
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self.counts: Counter[str] = Counter()
        self._pairs: OrderedDict[tuple[str, str], int] = OrderedDict()

    def count(self, event: str, number: int = 1) -> None:
        """Count an event of normal operation, without a line."""
        if len(self.counts) < _MAX_EVENTS or event in self.counts:
            self.counts[event] += number

    def add(self, event: str, number: int, where: str, value: str = "") -> None:
        """Count an event that happened so often, and tell of it when its count has a digit more.

        Examples
        --------
        >>> notices = Notices(print)
        >>> for number in (3, 6, 9):
        ...     notices.add("rows without a time dropped", number, "robot: row 7")
        robot: row 7: 3 rows without a time dropped
        rows without a time dropped (18 by now)
        """
        known = self.counts[event]
        self.count(event, number)
        if not known:
            place = f"{printable(where)}: " if where else ""
            shown = f" ({printable(value)})" if value else ""
            self._tell(f"{place}{count_phrase(number, event)}{shown}")
        elif len(str(known + number)) > len(str(known)):
            self._tell(f"{event} ({known + number:,} by now)")

    def note(self, event: str, agent: str = "", value: str = "") -> None:
        """Count an event, and tell of it if it is new or has become ten times as frequent."""
        # Count it for the agent; those whose last event is longest ago are forgotten.
        self.count(event)
        pair = agent, event
        number = self._pairs.pop(pair, 0) + 1
        self._pairs[pair] = number
        if len(self._pairs) > _MAX_PAIRS:
            self._pairs.popitem(last=False)

        # Tell of the first, tenth, hundredth, ...
        if str(number).rstrip("0") != "1":
            return
        whose = f"{printable(agent)}: " if agent else ""
        shown = f" ({printable(value)})" if value else ""
        often = f" ({number:,} by now)" if number > 1 else shown
        self._tell(f"{whose}{event}{often}")


def printable(text: str) -> str:
    r"""Return a text that can't drive a terminal, cut to a length for messages.

    Examples
    --------
    >>> printable("a\x1b[2Jb")
    'a\\x1b[2Jb'
    """
    cut = text[:_MAX_VALUE_LETTERS] + ("..." if len(text) > _MAX_VALUE_LETTERS else "")
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode()
        for letter in cut
    )
