"""The order of time in a stream: rows that go back, and clocks that do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ordered", "order_rows", "sort_rows"]

#: Rows at the end of a batch that go back, from which on the clock went back rather than a row.
_MIN_RESET = 2

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Ordered:
    """Rows of one name, divided by time.

    Parameters
    ----------
    runs : list of int array
        Numbers of the rows that continue the track, then of those of each track that begins where
        the clock went back. In each, times increase.
    repeated : int array
        Rows at the time of the one before.
    late : int array
        Rows from before the end of their track, after which the clock goes on as before.
    """

    runs: list[Rows]
    repeated: Rows
    late: Rows


def order_rows(times: Floats, end: float, *, split: bool = False) -> Ordered:
    """Divide rows by whether time goes on, stands still or goes back.

    A row that goes back is late, if a later one goes on. If none does up to the end of the batch,
    the clock went back: a robot was started again, or a wrong time was set right.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, in the order in which they came.
    end : float
        Time of the last row before them; minus infinity if there is none.
    split : bool
        Whether a track ends wherever time goes back.

    Examples
    --------
    >>> ordered = order_rows(np.array([1.0, 2.0, 1.5, 3.0, 0.0, 1.0]), 0.0)
    >>> [run.tolist() for run in ordered.runs], ordered.late.tolist()
    ([[0, 1, 3], [4, 5]], [2])
    """
    runs: list[Rows] = []
    repeated: list[Rows] = []
    late: list[Rows] = []
    first = 0
    while True:
        # The highest time so far tells which rows go on.
        rest = times[first:]
        before = np.maximum.accumulate(np.append(end, rest))[:-1]
        goes_on, goes_back = rest > before, rest < before
        after = _start_of_reset(goes_on, goes_back, split=split)

        # What goes on up to there; the clock goes back behind it.
        runs.append(first + np.flatnonzero(goes_on[:after]))
        repeated.append(first + np.flatnonzero(~goes_on[:after] & ~goes_back[:after]))
        late.append(first + np.flatnonzero(goes_back[:after]))
        if after == len(rest):
            break
        first, end = first + after, -np.inf
    return Ordered(runs, np.concatenate(repeated), np.concatenate(late))


def _start_of_reset(
    goes_on: NDArray[np.bool_], goes_back: NDArray[np.bool_], *, split: bool
) -> int:
    """Number of the first row of a clock that went back; that of all rows if none did."""
    back = np.flatnonzero(goes_back)
    if not split:
        # Those behind the last row that goes on.
        on = np.flatnonzero(goes_on)
        back = back[back > (on[-1] if len(on) else -1)]
    return int(back[0]) if len(back) >= (1 if split else _MIN_RESET) else len(goes_back)


def sort_rows(times: Floats, known: Floats, end: float) -> tuple[Ordered, int]:
    """Put rows in the order of time, as far as the rows around them are still at hand.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, in the order in which they came.
    known : float64 array, shape (m,)
        Times of the rows at hand, increasing.
    end : float
        Time up to which no row can be put any more.

    Returns
    -------
    Ordered
        The only run has the rows that can be used; of several at one time, the first one.
    int
        Rows of it that go back.

    Examples
    --------
    >>> ordered, back = sort_rows(np.array([5.0, 2.5]), np.array([1.0, 2.0, 3.0]), 0.0)
    >>> ordered.runs[0].tolist(), back
    ([1, 0], 1)
    """
    # Sort, and leave out what can't be put.
    late = np.flatnonzero(times <= end)
    order = np.argsort(times, kind="stable")
    order = order[times[order] > end]

    # Of several rows at one time, the first one counts.
    is_new = np.append(np.ones(min(len(order), 1), np.bool_), np.diff(times[order]) > 0)
    is_new &= ~np.isin(times[order], known)
    rows = order[is_new]

    # Count those that came after a later one.
    last = known[-1] if len(known) else end
    before = np.maximum.accumulate(np.append(last, times))[:-1]
    back = int(np.count_nonzero(times[rows] < before[rows]))
    return Ordered([rows], order[~is_new], late), back
