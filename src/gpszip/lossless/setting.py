"""How a column is coded: what encoder and decoder agree on before its first number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["EXACT", "FEW", "LAST_BIN", "MANY", "NEAR", "Guide", "Setting"]

#: Orders of thresholds: near the prediction, and exact.
NEAR = 0
EXACT = 1

#: Contexts of a decision, with that of a guide: two, or three and that of the guide. More than two
#: take 10 to 20 % of the time, and save 0.2 % of the bytes.
FEW = 2
MANY = 3

#: Bins of a side are 0 to this.
LAST_BIN = 15


class Setting(NamedTuple):
    """How a column is coded.

    Parameters
    ----------
    order : int
        ``NEAR`` or ``EXACT``.
    usual : int
        Usual step, about which exact steps are found.
    unit : int
        Power of two of the exact bins' unit.
    shift : int
        Power of two by which inputs of the filter are divided.
    scale : int
        First mean error, in sixteenths of a step.
    first_bin : int
        Bin whose bound is asked for first, 1 to 15.
    contexts : int, default 2
        Contexts of a decision, 2 or 3.
    """

    order: int
    usual: int
    unit: int
    shift: int
    scale: int
    first_bin: int
    contexts: int = FEW


class Guide(NamedTuple):
    """What a walk says of a column.

    Parameters
    ----------
    values : int64 array, shape (m,)
        In sixteenths of the column's steps.
    classes : uint8 array, shape (m,)
        What kind of a value; 0 for none.
    run_rows, run_events : int64 array, shape (r + 1,)
        Rows and values of runs.
    slack : int
        Values less than this past the last number are no longer to come.
    """

    values: NDArray[np.int64]
    classes: NDArray[np.uint8]
    run_rows: NDArray[np.int64]
    run_events: NDArray[np.int64]
    slack: int


def no_guide() -> Guide:
    zero = np.zeros(0, np.int64)
    return Guide(zero, np.zeros(0, np.uint8), zero, zero, 0)
