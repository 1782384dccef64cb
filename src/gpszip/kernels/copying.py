"""Copying the numbers of short arrays, such as a position."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted

__all__ = ["copy_values"]


@inner_uncounted
def copy_values(source: NDArray[Any], target: NDArray[Any]) -> None:
    """Copy the numbers of a vector to another one of the same length: target[i] = source[i].

    An assignment to a slice also compiles a check of the lengths, with its message, and a copy for
    arrays that overlap: 2 s for the first one.
    """
    for i in range(len(target)):
        target[i] = source[i]
