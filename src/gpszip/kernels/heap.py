"""A binary heap on two arrays, for Dijkstra's search and greedy merging: the smallest key first.

Entry i is ``(keys[i], items[i])``. The children of entry i are 2 i + 1 and 2 i + 2, and no child
has a smaller key than its parent. The caller owns the arrays and keeps the size.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted

__all__ = ["pop", "push"]


@inner_uncounted
def push(keys: NDArray[Any], items: NDArray[Any], size: int, key: float, item: int) -> int:
    """Add an item; return the new size. The arrays must have space for it."""
    # Move parents with larger keys down until the new entry fits.
    i = size
    while i > 0:
        parent = (i - 1) // 2
        if keys[parent] <= key:
            break
        keys[i], items[i] = keys[parent], items[parent]
        i = parent

    keys[i], items[i] = key, item
    return size + 1


@inner_uncounted
def pop(keys: NDArray[Any], items: NDArray[Any], size: int) -> tuple[int, int]:
    """Remove the item with the smallest key; return it and the new size."""
    # The root has the smallest key.
    first = items[0]

    # The last entry fills the root; move it down below all children with smaller keys.
    size -= 1
    key, item = keys[size], items[size]
    i = 0
    while 2 * i + 1 < size:
        child = 2 * i + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i], items[i] = keys[child], items[child]
        i = child

    # Place the entry where no child has a smaller key.
    keys[i], items[i] = key, item
    return first, size
