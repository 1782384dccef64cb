"""Columns of integers to bytes and back, each with the help of those before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_signed, encode_varint
from gpszip.lossless.setting import EXACT, FEW, LAST_BIN, MANY, NEAR, Guide, Setting, no_guide

if TYPE_CHECKING:
    from gpszip.codec.kernels.range_coder import Coder

__all__ = [
    "MAX_VALUE",
    "CodedColumn",
    "decode_column",
    "encode_column",
    "skip_column",
]

#: Integers have absolute values below this.
MAX_VALUE = 1 << 57

#: Methods: one value for all rows, or an order of thresholds of the column coder plus 1; with a
#: guide 2 more; or runs of equal values. Older columns have three contexts, those of today two.
_CONSTANT = 0
_CODED_BEFORE = 1
_RUNS = 5
_CODED = 6
_GUIDED = 2
_METHODS = 10

#: Runs of equal values have so many rows on average at least. To code each row takes 130 ns, to
#: repeat it none.
_MIN_RUN = 256

#: Rows by which order and guide are chosen, and the shares by which exact steps, and those with a
#: guide, must be smaller: either takes about 1.5 times as long. With half as many rows, other logs
#: take up to 6 % more bytes: exact steps pay late.
_TRIAL_ROWS = 1 << 12
_EXACT_GAIN = 0.98
_GUIDE_GAIN = 0.985

#: Exact steps with a guide take twice as long as others, so they must be smaller by so much; where
#: they are so much smaller without one, they are chosen at once.
_GUIDED_EXACT_GAIN = 0.97
_SURE_GAIN = 0.9

#: Largest unit, shift and first mean error that a column may name.
_MAX_POWER = 40
_MAX_SCALE = 1 << 46

#: Binary digits of a usual step that filters keep, and quantile of steps within the exact bins.
_FILTER_DIGITS = 12
_EXACT_DIGITS = 14
_EXACT_QUANTILE = 0.995

#: Steps by which a setting is chosen: medians of all take as long as a tenth of the coding.
_CHOICE_STEPS = 1 << 11

#: First bin asked for near a prediction: the median error is about 0.7 mean errors.
_NEAR_BIN = 3

#: A buffer for the coder has this many bytes for each row: 64 digits, and headroom for bad luck.
_ROW_BYTES = 12
_FREE_BYTES = 256

_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CodedColumn:
    """A column that both encoder and decoder know, by which others are predicted.

    Parameters
    ----------
    values : int64 array, shape (n,)
        The integers.
    shift : int
        Power of two by which the column's steps are divided in filters.
    sizes : uint8 array, shape (n,)
        Classes of the errors of the column's predictions.
    """

    values: _Ints
    shift: int
    sizes: NDArray[np.uint8]

    @property
    def is_constant(self) -> bool:
        """Whether all values are the same, so that they predict nothing."""
        return len(self.values) == 0 or bool((self.values == self.values[0]).all())


def encode_column(
    values: _Ints,
    times: CodedColumn | None = None,
    sides: Sequence[CodedColumn] = (),
    guide: Guide | None = None,
) -> tuple[bytes, CodedColumn]:
    """Encode a column.

    Parameters
    ----------
    values : int64 array, shape (n,)
        Integers between -2**57 and 2**57.
    times : CodedColumn, optional
        Times of the rows, by which steps are in proportion.
    sides : sequence of CodedColumn, optional
        Columns that move together with this one; the first tells most.
    guide : Guide, optional
        What a walk says of the numbers; used where it helps.

    Returns
    -------
    bytes
        The column.
    CodedColumn
        What columns after it may use.

    Examples
    --------
    >>> data, _ = encode_column(np.arange(0, 5000, 5))
    >>> len(data) < 30, decode_column(Cursor(data), 1000)[0].tolist()[:3]
    (True, [0, 5, 10])
    """
    values = np.ascontiguousarray(values)
    sizes = np.zeros(len(values), np.uint8)
    if len(values) == 0:
        return b"", CodedColumn(values, 0, sizes)
    if (values == values[0]).all():
        column = CodedColumn(values, 0, sizes)
        return bytes([_CONSTANT]) + encode_signed(int(values[0])), column

    # A few long runs.
    starts = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    if len(starts) * _MIN_RUN <= len(values):
        return bytes([_RUNS]) + _encode_runs(values, starts), CodedColumn(values, 0, sizes)

    # The rows by which the setting was chosen are coded by then.
    work = _choose_work(_Column(values.copy(), times, sides), guide)
    work.code(len(values))
    setting, payload, sizes = work.setting, work.payload(), work.sizes

    # The setting stands before the payload.
    record = bytes([_CODED + setting.order + (_GUIDED if work.is_guided else 0)]) + b"".join(
        [
            encode_signed(int(values[0])),
            encode_signed(setting.usual),
            bytes([setting.unit, setting.shift, setting.first_bin]),
            encode_varint(setting.scale),
            encode_varint(len(payload)),
            payload,
        ]
    )
    return record, CodedColumn(values, setting.shift, sizes)


def decode_column(
    cursor: Cursor,
    count: int,
    times: CodedColumn | None = None,
    sides: Sequence[CodedColumn] = (),
    guide: Guide | None = None,
) -> tuple[_Ints, CodedColumn]:
    """Undo :func:`encode_column` for ``count`` values, with the same other columns.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no column of so many values.
    """
    sizes = np.zeros(count, np.uint8)
    if count == 0:
        return np.zeros(0, np.int64), CodedColumn(np.zeros(0, np.int64), 0, sizes)

    # The method and the first value; of a constant, that is all.
    method = _read_method(cursor)
    is_guided = _is_guided(method)
    if is_guided and guide is None:
        raise cursor.error(f"no column is coded by method {method}")
    if method == _RUNS:
        values = _decode_runs(cursor, count)
        return values, CodedColumn(values, 0, sizes)
    first = _read_value(cursor, "a first value")
    values = np.full(count, first, np.int64)
    if method == _CONSTANT:
        return values, CodedColumn(values, 0, sizes)

    # The setting and the payload.
    usual = _read_value(cursor, "a usual step")
    unit, shift, first_bin = cursor.read_bytes(3, "a column's setting")
    scale = cursor.read_varint("a first mean error")
    if max(unit, shift) > _MAX_POWER or not 1 <= first_bin <= LAST_BIN:
        raise cursor.error("the setting of a column is out of range")
    if scale > _MAX_SCALE:
        raise cursor.error("the setting of a column is out of range")

    # The values; a method may leave the guide out.
    guide = guide if is_guided else None
    contexts = FEW if method >= _CODED else MANY
    order = (method - _base(method)) % _GUIDED
    setting = Setting(order, usual, unit, shift, scale, first_bin, contexts)
    payload = cursor.read_bytes(cursor.read_varint("a payload's length"), "a payload")
    if not _decode_with(setting, payload, values, times, sides, sizes, guide):
        raise cursor.error(f"a column ends before its {count} values")
    return values, CodedColumn(values, shift, sizes)


def skip_column(cursor: Cursor, count: int) -> tuple[bool, bool]:
    """Pass over a column of ``count`` values; none of them is decoded.

    Returns
    -------
    differs : bool
        Whether any value differs from the first one.
    is_guided : bool
        Whether a guide predicts them.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no column.

    Examples
    --------
    >>> data, _ = encode_column(np.arange(100) ** 2)
    >>> skip_column(Cursor(data), 100)
    (True, False)
    """
    if count == 0:
        return False, False
    method = _read_method(cursor)
    if method == _RUNS:
        runs = _read_run_count(cursor, count)
        skip_column(cursor, runs)
        skip_column(cursor, runs)
        return True, False
    cursor.read_signed("a first value")
    if method == _CONSTANT:
        return False, False
    cursor.read_signed("a usual step")
    cursor.read_bytes(3, "a column's setting")
    cursor.read_varint("a first mean error")
    cursor.read_bytes(cursor.read_varint("a payload's length"), "a payload")
    return True, _is_guided(method)


def _read_method(cursor: Cursor) -> int:
    """Read the method with which a column begins."""
    method = cursor.read_byte("a column's method")
    if method >= _METHODS:
        raise cursor.error(f"no column is coded by method {method}")
    return method


def _base(method: int) -> int:
    """The first method with as many contexts."""
    return _CODED if method >= _CODED else _CODED_BEFORE


def _is_guided(method: int) -> bool:
    return method not in (_CONSTANT, _RUNS) and method - _base(method) >= _GUIDED


def _read_value(cursor: Cursor, what: str) -> int:
    """Read an integer within the limits."""
    value = cursor.read_signed(what)
    if abs(value) > 2 * MAX_VALUE:
        raise cursor.error(f"{what} is beyond 2^58")
    return value


def _encode_runs(values: _Ints, starts: NDArray[np.intp]) -> bytes:
    """Encode runs of equal values, which start at these rows: number, values and lengths."""
    lengths = np.diff(starts, append=len(values)).astype(np.int64)
    parts = encode_column(values[starts])[0], encode_column(lengths)[0]
    return encode_varint(len(starts)) + b"".join(parts)


def _read_run_count(cursor: Cursor, count: int) -> int:
    """Read the number of runs of ``count`` values: they are long, so runs of runs are few."""
    runs = cursor.read_varint("the number of runs")
    if not 0 < runs * _MIN_RUN <= count:
        raise cursor.error(f"{runs} runs of {count} values")
    return runs


def _decode_runs(cursor: Cursor, count: int) -> _Ints:
    """Undo :func:`_encode_runs`."""
    runs = _read_run_count(cursor, count)
    values, _ = decode_column(cursor, runs)
    lengths, _ = decode_column(cursor, runs)
    if lengths.min() < 1 or lengths.max() > count or int(lengths.sum()) != count:
        raise cursor.error(f"the runs do not have {count} values")
    return np.repeat(values, lengths)


def _choose_work(column: _Column, guide: Guide | None) -> _Work:
    """Choose order and guide by the first rows; return the work that has coded them."""
    # The order, then whether the guide helps.
    settings = [_choose(column.values, order) for order in (NEAR, EXACT)]
    near, exact = (_trial(column, setting, None) for setting in settings)
    is_exact = exact.bits() < _EXACT_GAIN * near.bits()
    best = exact if is_exact else near
    if guide is None:
        return best
    guided = _trial(column, best.setting, guide)
    if guided.bits() > _GUIDE_GAIN * min(near.bits(), exact.bits()):
        return best

    # Beside a guide, exact steps may help less.
    if is_exact and exact.bits() > _SURE_GAIN * near.bits():
        guided_near = _trial(column, settings[NEAR], guide)
        if guided.bits() > _GUIDED_EXACT_GAIN * guided_near.bits():
            return guided_near
    return guided


def _trial(column: _Column, setting: Setting, guide: Guide | None) -> _Work:
    """Work on a column that has coded the first rows."""
    work = _Work.encoding(column, setting, guide)
    work.code(_TRIAL_ROWS)
    return work


def _choose(values: _Ints, order: int) -> Setting:
    """Choose units by the steps of a column."""
    # Steps within the limits of values fit 64 bits. Some, all over the column, suffice.
    rows = np.arange(0, len(values) - 1, max((len(values) - 1) // _CHOICE_STEPS, 1))
    steps = values[rows + 1] - values[rows]
    sizes = np.sort(np.abs(steps))
    size = int(_quantile(sizes, 0.5))
    usual = int(_quantile(np.sort(steps), 0.5)) if order == EXACT else 0
    distances = np.sort(np.abs(steps - usual)) if order == EXACT else sizes
    far = int(_quantile(distances, _EXACT_QUANTILE))
    unit = min(max(far.bit_length() - _EXACT_DIGITS, 0), _MAX_POWER)
    first_bin = _NEAR_BIN
    if order == EXACT:
        median = int(_quantile(distances, 0.5))
        first_bin = min(max((median >> unit).bit_length(), 1), LAST_BIN)
    shift = min(max(size.bit_length() - _FILTER_DIGITS, 0), _MAX_POWER)
    return Setting(order, usual, unit, shift, min(16 * size + 8, _MAX_SCALE), first_bin)


def _quantile(ordered: _Ints, share: float) -> float:
    """A quantile of numbers in order; that of NumPy takes 10 times as long for so few."""
    place = share * (len(ordered) - 1)
    low, high = int(ordered[int(place)]), int(ordered[min(int(place) + 1, len(ordered) - 1)])
    return low + (high - low) * (place - int(place))


class _Column:
    """A column to code, and what helps to predict it, as kernels take it.

    Parameters
    ----------
    values : int64 array, shape (n,)
        The integers, of which a decoder knows the first; kernels write to them.
    times : CodedColumn, optional
        The column of times.
    sides : sequence of CodedColumn
        Other columns.
    """

    def __init__(
        self, values: _Ints, times: CodedColumn | None, sides: Sequence[CodedColumn]
    ) -> None:
        from gpszip.lossless.kernels.predictions import steps_of_sides

        rows, count = len(values), len(sides)
        self.values = values
        self.times = np.zeros(0, np.int64) if times is None else times.values
        self.side_shifts = np.array([side.shift for side in sides], np.int64)
        side_values = np.array([side.values for side in sides], np.int64).reshape(count, rows)
        self.side_steps = steps_of_sides(side_values)
        sizes = np.array([side.sizes for side in sides], np.uint8).reshape(count, rows)
        self.side_classes = np.minimum(sizes.max(axis=0, initial=0) // 3, 2)


class _Work:
    """The column coder at work on a column, in either direction, row by row.

    Parameters
    ----------
    column : _Column
        The column.
    setting : Setting
        How it is coded.
    guide : Guide, optional
        What a walk says of it.
    coder : Coder
        Encodes or decodes.
    """

    def __init__(
        self, column: _Column, setting: Setting, guide: Guide | None, coder: Coder
    ) -> None:
        # Kernels are compiled only where a column is coded.
        from gpszip.lossless.kernels.column_coder import WEIGHT_SETS, bounds_of_bins
        from gpszip.lossless.kernels.decisions import new_decisions
        from gpszip.lossless.kernels.guided import new_guide_state
        from gpszip.lossless.kernels.predictions import new_predictor

        # The kernel takes empty arrays for what there is not.
        rows = len(column.values)
        self.column, self.setting, self.is_guided = column, setting, guide is not None
        self.sizes = np.zeros(rows, np.uint8)
        self._guide = no_guide() if guide is None else guide
        self._coder, self._next = coder, min(rows, 1)
        self._decisions = new_decisions(WEIGHT_SETS)
        self._predictor = new_predictor(rows, setting.shift, column.side_steps, column.side_shifts)
        self._bounds = bounds_of_bins(setting)
        self._guide_state = new_guide_state(self._guide, setting.scale)
        self._state = np.array([setting.scale, setting.scale, 0, 0, 0], np.int64)

    @classmethod
    def encoding(cls, column: _Column, setting: Setting, guide: Guide | None) -> _Work:
        """Work of an encoder."""
        from gpszip.codec.kernels.range_coder import new_encoder

        coder = new_encoder(_ROW_BYTES * len(column.values) + _FREE_BYTES)
        return cls(column, setting, guide, coder)

    def code(self, end: int) -> bool:
        """Code rows up to this one; return whether a decoder had enough bytes."""
        from gpszip.lossless.kernels.column_coder import code_column

        first, self._next = self._next, min(end, len(self.column.values))
        return bool(
            code_column(
                self._coder,
                self._decisions,
                self._predictor,
                self.setting,
                self._bounds,
                self.column.values,
                self.column.times,
                self.column.side_classes,
                self.sizes,
                self._guide,
                self._guide_state,
                self._state,
                first,
                self._next,
            )
        )

    def bits(self) -> float:
        """Bits that an encoder has written."""
        from gpszip.codec.kernels.range_coder import bits_written

        return bits_written(self._coder)

    def payload(self) -> bytes:
        """Bytes that an encoder has written; nothing can follow."""
        from gpszip.codec.kernels.range_coder import finish

        payload = finish(self._coder)
        assert payload is not None
        return payload


def _encode_with(
    setting: Setting,
    values: _Ints,
    times: CodedColumn | None,
    sides: Sequence[CodedColumn],
    guide: Guide | None,
) -> tuple[bytes, NDArray[np.uint8]]:
    """Encode all values but the first; return payload and classes of errors."""
    work = _Work.encoding(_Column(values.copy(), times, sides), setting, guide)
    work.code(len(values))
    return work.payload(), work.sizes


def _decode_with(
    setting: Setting,
    payload: bytes,
    values: _Ints,
    times: CodedColumn | None,
    sides: Sequence[CodedColumn],
    sizes: NDArray[np.uint8],
    guide: Guide | None,
) -> bool:
    """Fill in all values but the first; return whether the payload was long enough."""
    from gpszip.codec.kernels.range_coder import new_decoder

    work = _Work(_Column(values, times, sides), setting, guide, new_decoder(payload))
    is_whole = work.code(len(values))
    sizes[:] = work.sizes
    return is_whole
