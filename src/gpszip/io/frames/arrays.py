"""Arrays of any package as Arrow columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.frames.stream import frame_errors

__all__ = ["to_arrow"]

#: Units of NumPy's times that Arrow has, too. Others are days, hours and so on.
_ARROW_UNITS = ("s", "ms", "us", "ns")


def to_arrow(values: Any, name: str, where: str) -> Any:
    """Turn an array into an Arrow column. NaN, NaT and masked values become null.

    Parameters
    ----------
    values : array_like, shape (n,)
        An array of NumPy, pandas, polars or Arrow, or a list.
    name : str
        Name of the column, for messages.
    where : str
        Name of the frame, for messages.

    Returns
    -------
    pyarrow.ChunkedArray

    Raises
    ------
    InputError
        If it has not one axis, or Arrow can't hold it, such as numbers among texts.

    Examples
    --------
    >>> to_arrow(np.array(["2024-05-01", "NaT"], "datetime64[h]"), "t", "dict").null_count
    1
    """
    # A single value is no column.
    if isinstance(values, str | bytes) or not hasattr(values, "__len__"):
        raise InputError(
            f"column {name!r} is a {type(values).__name__}, not an array",
            path=where,
            remedy="give one value for each row",
        )

    # NumPy has types that Arrow lacks; others convert themselves.
    with frame_errors(where, name):
        if isinstance(values, np.ndarray):
            column = _from_numpy(values, name, where)
        elif hasattr(values, "__arrow_c_stream__"):
            column = _from_stream(values, name, where)
        else:
            column = pa.array(values, from_pandas=True)
    return column if isinstance(column, pa.ChunkedArray) else pa.chunked_array([column])


def _from_stream(values: Any, name: str, where: str) -> Any:
    # pandas marks missing values by NaN, which its own conversion turns into null. Arrow would take
    # a period for its number, such as that of a day, which is no time in seconds.
    if type(values).__module__.startswith("pandas"):
        if str(values.dtype).startswith("period"):
            raise InputError(
                f"column {name!r} holds periods, not times",
                path=where,
                remedy=f"frame[{name!r}].dt.to_timestamp()",
            )
        return pa.array(values, from_pandas=True)
    return pa.chunked_array(values)


def _from_numpy(values: Any, name: str, where: str) -> Any:
    """Turn a NumPy array into an Arrow array."""
    # Rows are along the only axis; a masked array has its own missing values.
    if values.ndim != 1:
        raise InputError(
            f"column {name!r} has {values.ndim} axes, not 1", path=where, remedy="one for each axis"
        )
    mask = np.ma.getmaskarray(values) if isinstance(values, np.ma.MaskedArray) else None
    plain: Any = np.ma.getdata(values)

    # Arrow has no days or hours, no floats of 16 bytes, and no foreign byte order.
    kind = plain.dtype.kind
    if kind in "Mm" and np.datetime_data(plain.dtype)[0] not in _ARROW_UNITS:
        plain = plain.astype(f"{'datetime' if kind == 'M' else 'timedelta'}64[s]")
    if kind == "f" and plain.dtype.itemsize > 8:
        plain = plain.astype(np.float64)
    if not plain.dtype.isnative:
        plain = plain.astype(plain.dtype.newbyteorder("="))
    return pa.array(plain, mask=mask, from_pandas=True)
