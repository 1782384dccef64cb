"""Arrays of numbers as text for a page: integers, their differences, bytes by significance."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["LARGEST_INTEGER", "pack_lines", "pack_numbers"]

#: Integers of a block have absolute values below this: the page computes with 53 bits, and undoing
#: the zigzag and two differences takes a few of them.
LARGEST_INTEGER = 1 << 47

#: Largest number of differences.
_MAX_ORDER = 2

#: Level of deflate; 9 takes twice as long as 6 for half a percent.
_DEFLATE_LEVEL = 6

Block = dict[str, Any]


def pack_numbers(values: ArrayLike, step: float = 1.0, *, with_nan: bool = False) -> Block:
    """Pack numbers, rounded to multiples of a step.

    The page undoes this: inflate, join the byte planes, undo the zigzag and the differences, and
    multiply by the step.

    Parameters
    ----------
    values : array_like, shape (n,)
        Numbers; finite unless ``with_nan``.
    step : float, default 1
        Numbers come back to within half of this.
    with_nan : bool, default False
        Whether NaN may occur. Such a block has no differences.

    Returns
    -------
    dict
        ``type``, ``count``, ``scale``, ``offset``, ``order`` (differences to undo), ``bytes`` (of
        an integer) and ``data`` (base64 of raw deflate); ``nan`` where that may occur.

    Raises
    ------
    OverflowError
        If the numbers span more steps than the page can count.

    Examples
    --------
    >>> block = pack_numbers([10.0, 10.5, 11.0, 11.5], 0.5)
    >>> block["count"], block["scale"], block["offset"], block["order"], block["bytes"]
    (4, 0.5, 10.0, 2, 1)
    """
    # Whole numbers of steps from the smallest number.
    numbers = np.asarray(values, np.float64)
    known = numbers[~np.isnan(numbers)] if with_nan else numbers
    offset = float(known.min()) if len(known) else 0.0
    if len(known) and float(known.max()) - offset >= LARGEST_INTEGER * step:
        raise OverflowError(f"numbers from {offset:g} to {known.max():g} in steps of {step:g}")
    integers = np.rint((numbers - offset) / step)

    # NaN is 0, and other integers move up by one.
    if with_nan:
        unsigned = np.where(np.isnan(integers), 0, 2 * integers + 1).astype(np.uint64)
        order = 0
    else:
        order, differences = _best_differences(integers.astype(np.int64))
        unsigned = _zigzag(differences)

    block = {
        "type": "number",
        "count": len(numbers),
        "scale": step,
        "offset": offset,
        "order": order,
        **_deflate(unsigned),
    }
    return {**block, "nan": True} if with_nan else block


def pack_lines(
    points: NDArray[np.float64], offsets: NDArray[np.int64], step: float
) -> dict[str, Block]:
    """Pack lines: points of shape (N, d), of which the first two coordinates count.

    Parameters
    ----------
    points : float64 array, shape (N, d)
        Points of all lines.
    offsets : int64 array, shape (lines + 1,)
        Line i has the points ``points[offsets[i]:offsets[i + 1]]``.
    step : float
        Metres to which coordinates are rounded.
    """
    return {
        "x": pack_numbers(points[:, 0], step),
        "y": pack_numbers(points[:, 1], step),
        "offsets": pack_numbers(offsets),
    }


def _best_differences(integers: NDArray[np.int64]) -> tuple[int, NDArray[np.int64]]:
    """Return how often differences are taken, and these: those with the fewest binary digits."""
    best_order, best, fewest = 0, integers, _count_digits(integers)
    differences = integers
    for order in range(1, _MAX_ORDER + 1):
        differences = np.diff(differences, prepend=0)
        digits = _count_digits(differences)
        if digits < fewest:
            best_order, best, fewest = order, differences, digits
    return best_order, best


def _count_digits(integers: NDArray[np.int64]) -> float:
    return float(np.log2(np.abs(integers.astype(np.float64)) + 1).sum())


def _zigzag(integers: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Fold integers of either sign: 0, -1, 1, -2, ... become 0, 1, 2, 3, ..."""
    return np.where(integers < 0, -2 * integers - 1, 2 * integers).astype(np.uint64)


def _deflate(unsigned: NDArray[np.uint64]) -> dict[str, Any]:
    """Deflate integers as byte planes, the least significant first.

    High bytes are mostly zero and compress to nothing once they stand together.
    """
    if not len(unsigned):
        return {"bytes": 1, "data": ""}
    width = max(-(-int(unsigned.max()).bit_length() // 8), 1)
    planes = unsigned.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T
    deflate = zlib.compressobj(_DEFLATE_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    data = deflate.compress(planes.tobytes()) + deflate.flush()
    return {"bytes": width, "data": base64.b64encode(data).decode("ascii")}
