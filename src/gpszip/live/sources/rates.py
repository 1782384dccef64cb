"""Limits on how fast each of many senders may come."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

__all__ = ["Rates"]

#: Seconds for which a sender may come at the rate at once, such as after it was offline.
_BURST_SECONDS = 10.0

#: Senders that are kept in memory; of more, the one unused for longest goes.
_MAX_SENDERS = 20_000


@dataclass(slots=True)
class _Allowance:
    """Requests that a sender may send at once, and when that was counted."""

    left: float
    at: float


class Rates:
    """Lets each sender come a number of times a second, and ten seconds' worth at once.

    Parameters
    ----------
    per_second : float
        Requests of one sender in a second, in the long run.

    Examples
    --------
    >>> rates = Rates(1.0)
    >>> [rates.wait("ann", 0.0) for _ in range(11)][-2:], rates.wait("bob", 0.0)
    ([0.0, 1.0], 0.0)
    >>> rates.wait("ann", 1.0)
    0.0
    """

    def __init__(self, per_second: float) -> None:
        self._rate, self._burst = per_second, max(_BURST_SECONDS * per_second, 1.0)
        self._senders: OrderedDict[str, _Allowance] = OrderedDict()

    def wait(self, sender: str, now: float) -> float:
        """Count a request, and return 0; or the seconds after which it may come again."""
        allowance = self._senders.pop(sender, None) or _Allowance(self._burst, now)
        self._senders[sender] = allowance
        if len(self._senders) > _MAX_SENDERS:
            self._senders.popitem(last=False)

        # What was used comes back with time.
        earned = max(now - allowance.at, 0.0) * self._rate
        allowance.left = min(allowance.left + earned, self._burst)
        allowance.at = now
        if allowance.left < 1.0:
            return (1.0 - allowance.left) / self._rate
        allowance.left -= 1.0
        return 0.0
