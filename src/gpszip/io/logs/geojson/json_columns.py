"""Lists of JSON values as columns of a table, and JSON values in messages."""

from __future__ import annotations

import json
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from gpszip.io.storage.display_name import printable_name

__all__ = ["abbreviate", "as_json", "build_column", "concatenate_columns"]

#: Letters of a value that messages show.
_MAX_SHOWN_LETTERS = 60


def as_json(value: Any) -> str:
    """Return a value as JSON.

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
    """Return a value as JSON, in one line and cut if it is long.

    Examples
    --------
    >>> abbreviate("x" * 100)
    '"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...'
    """
    text = printable_name(as_json(value))
    return text if len(text) <= _MAX_SHOWN_LETTERS else text[: _MAX_SHOWN_LETTERS - 3] + "..."


def build_column(values: list[Any]) -> Any:
    """Make a column of values: values of one kind stay as they are, of several become texts.

    Parameters
    ----------
    values : list
        None, numbers, texts, lists or objects.

    Returns
    -------
    pyarrow.Array
        Integers, floats, texts, booleans, or only nulls.

    Examples
    --------
    >>> build_column([1, None, 2.5]).to_pylist(), build_column([1, "b", True]).to_pylist()
    ([1.0, None, 2.5], ['1', 'b', 'true'])
    """
    # Types are compared, so that booleans are no numbers.
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


def concatenate_columns(chunks: list[Any]) -> Any:
    """Concatenate chunks of a column: integers and floats become floats, other mixtures texts.

    Parameters
    ----------
    chunks : list of pyarrow.Array
        As :func:`build_column` makes them.

    Returns
    -------
    pyarrow.ChunkedArray

    Examples
    --------
    >>> chunks = [build_column([1]), build_column([None]), build_column(["b"])]
    >>> concatenate_columns(chunks).to_pylist()
    ['1', None, 'b']
    """
    # A chunk of nulls fits any type.
    kinds = {chunk.type for chunk in chunks if not pa.types.is_null(chunk.type)}
    if len(kinds) > 1:
        kinds = {pa.float64() if kinds == {pa.int64(), pa.float64()} else pa.string()}
    kind = kinds.pop() if kinds else pa.null()
    # A safe cast would raise for integers beyond 2**53 that become floats.
    return pa.chunked_array([pc.cast(chunk, kind, safe=False) for chunk in chunks], kind)
