"""What an agent has travelled, until those who watch all agents take it; late fixes revise it."""

from __future__ import annotations

from typing import Generic, TypeVar

__all__ = ["Travelled"]

Item = TypeVar("Item")


class Travelled(Generic[Item]):
    """Passes or paths of an agent in the order of travel, until they are taken.

    Examples
    --------
    >>> passes = Travelled()
    >>> for name in "abc":
    ...     passes.add(name)
    >>> passes.take(), passes.count
    ((0, ['a', 'b', 'c']), 3)
    >>> passes.go_back(1)
    >>> passes.add("d")
    >>> passes.take()
    (1, ['d'])
    """

    def __init__(self) -> None:
        self._items: list[Item] = []

        #: How many there were, with those that were taken.
        self.count = 0

    def add(self, item: Item) -> None:
        """Add the next one."""
        self._items.append(item)
        self.count += 1

    def take(self) -> tuple[int, list[Item]]:
        """Return those since the last call, and how many precede them: others did not happen."""
        items, self._items = self._items, []
        return self.count - len(items), items

    def go_back(self, count: int) -> None:
        """Go back to the first ones: those after them did not happen."""
        taken = self.count - len(self._items)
        del self._items[max(count - taken, 0) :]
        self.count = count
