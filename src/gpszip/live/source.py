"""The seam for sources: whatever brings fixes has one method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gpszip.live.fix import Fix, Unusable

__all__ = ["FixSource", "Receiver"]


class Receiver(Protocol):
    """Takes what a source brings."""

    async def store(self, items: Sequence[Fix | Unusable]) -> None:
        """Return once all fixes are stored durably.

        Raises
        ------
        OutputError
            If they could not be stored; the source then keeps them, or tells its sender.
        """
        ...


class FixSource(Protocol):
    """A source of fixes: a server, a subscription, a receiver, a stream."""

    async def run(self, receiver: Receiver) -> None:
        """Bring fixes to the receiver until there are no more, or until it is cancelled."""
        ...
