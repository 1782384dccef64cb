"""Lists of JSON values as columns of a table."""

from __future__ import annotations

import json
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from gpszip.io.storage.display_name import printable_name

__all__ = ["abbreviate", "as_json", "build_column", "concatenate_columns"]

#: Letters of a value that a message shows.
_SHOWN = 60


def as_json(value: Any) -> str:
    """Return a value as JSON has it.

    Examples
    --------
    >>> as_json([None, 48.1])
    '[null, 48.1]'
    """
    try:
        return json.dumps(value, ensure_ascii=False)
    except RecursionError:
        return f"a deeply nested {type(value).__name__}"


def abbreviate(value: Any) -> str:
    """Return a value as JSON has it, in one line and cut where it is long.

    Examples
    --------
    >>> abbreviate("x" * 100)
    '"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...'
    """
    text = printable_name(as_json(value))
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def build_column(values: list[Any]) -> Any:
    """Make a column of values: of one kind as they are, of several kinds texts.

    Parameters
    ----------
    values : list
        None, numbers, texts, lists or objects.

    Returns
    -------
    pyarrow.Array
        Integers, floats, texts, booleans, or nulls only.

    Examples
    --------
    >>> build_column([1, None, 2.5]).to_pylist(), build_column([1, "b", True]).to_pylist()
    ([1.0, None, 2.5], ['1', 'b', 'true'])
    """
    kinds = set(map(type, values)) - {type(None)}
    if kinds <= {int, float} or (len(kinds) == 1 and kinds <= {str, bool}):
        try:
            return pa.array(values)
        except (pa.ArrowException, OverflowError):
            pass  # integers that are too long for either kind of numbers
    return pa.array(
        [value if value is None or isinstance(value, str) else as_json(value) for value in values],
        pa.string(),
    )


def concatenate_columns(parts: list[Any]) -> Any:
    """Join parts of a column: integers and floats become floats, and all else that differs becomes texts.

    Parameters
    ----------
    parts : list of pyarrow.Array
        As :func:`build_column` makes them.

    Returns
    -------
    pyarrow.ChunkedArray

    Examples
    --------
    >>> concatenate_columns([build_column([1]), build_column([None]), build_column(["b"])]).to_pylist()
    ['1', None, 'b']
    """
    kinds = {part.type for part in parts if not pa.types.is_null(part.type)}
    if len(kinds) > 1:
        kinds = {pa.float64() if kinds == {pa.int64(), pa.float64()} else pa.string()}
    kind = kinds.pop() if kinds else pa.null()
    return pa.chunked_array([pc.cast(part, kind, safe=False) for part in parts], kind)
