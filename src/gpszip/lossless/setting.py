"""How a column is coded: what encoder and decoder agree on before its first number."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["EXACT", "LAST_BIN", "NEAR", "Setting"]

#: Orders of thresholds: near the prediction, and exact.
NEAR = 0
EXACT = 1

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
    """

    order: int
    usual: int
    unit: int
    shift: int
    scale: int
    first_bin: int
