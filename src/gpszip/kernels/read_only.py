"""Arrays of one kind for kernels, which are compiled again for arrays that can't be written to."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["read_only"]

Number = TypeVar("Number", bound=np.generic)


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """View an array that can't be written to.

    The arrays of a track are such, and computed ones are not. A kernel that takes either gets views
    of both, and is compiled once.

    Examples
    --------
    >>> zeros = np.zeros(3)
    >>> read_only(zeros).flags.writeable, zeros.flags.writeable
    (False, True)
    """
    view = array.view()
    view.flags.writeable = False
    return view
