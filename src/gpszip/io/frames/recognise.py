"""What counts as a frame. Nothing is imported here: whoever passes a frame has its package."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["class_names", "is_frame"]

#: Classes that hold a table, without a method that would tell.
_CLASSES = {
    ("pandas", "DataFrame"),  # before version 2.2, without __arrow_c_stream__
    ("polars", "LazyFrame"),
    ("movingpandas", "Trajectory"),
    ("movingpandas", "TrajectoryCollection"),
}


def is_frame(value: object) -> bool:
    """Whether a value is a table of another package, or columns by name.

    Parameters
    ----------
    value : object
        Anything with ``__arrow_c_stream__`` (pyarrow, polars, pandas, GeoDataFrame, DuckDB, ibis),
        a ``Trajectory`` or ``TrajectoryCollection`` of movingpandas, an xarray ``Dataset`` or any
        other mapping, or a structured NumPy array.

    Examples
    --------
    >>> is_frame({"t": [0, 1], "x": [0, 1], "y": [0, 0]}), is_frame("walk.csv"), is_frame([0, 1])
    (True, False, False)
    """
    if hasattr(value, "__arrow_c_stream__") or isinstance(value, Mapping):
        return True
    if isinstance(value, np.ndarray):
        return value.dtype.names is not None
    return bool(class_names(value) & _CLASSES)


def class_names(value: Any) -> set[tuple[str, str]]:
    """Top package and name of the class of a value, and of each class that it inherits from.

    Examples
    --------
    >>> ("numpy", "ndarray") in class_names(np.zeros(1))
    True
    """
    return {(cls.__module__.partition(".")[0], cls.__name__) for cls in type(value).__mro__}
