"""What an archive promises, and how its log was sampled, in two or three bytes."""

from __future__ import annotations

from gpszip.container.layout import Cursor
from gpszip.model.promise import DIGITS, EXPONENTS, Promise

__all__ = ["promise_bytes", "read_promise"]

_DIGIT_BITS, _EXPONENT_MASK, _SAMPLED, _MAXIMUM = 10, 0b1111, 1 << 14, 1 << 15


def promise_bytes(promise: Promise | None, sampling: int | None) -> bytes:
    """Ten bits of digits, four of the exponent plus 8, one if a byte for the sampling follows, one for a maximum; zeros promise nothing."""
    packed = 0 if sampling is None else _SAMPLED
    if promise is not None:
        packed |= promise.digits | (promise.exponent - EXPONENTS.start) << _DIGIT_BITS | promise.maximum * _MAXIMUM
    return packed.to_bytes(2, "little") + (b"" if sampling is None else bytes([sampling]))


def read_promise(cursor: Cursor) -> tuple[Promise | None, int | None]:
    """Undo :func:`promise_bytes`."""
    packed = int.from_bytes(cursor.take(2, "the promise"), "little")
    sampling = cursor.byte("the sampling") if packed & _SAMPLED else None
    if packed & ~_SAMPLED == 0:
        return None, sampling
    digits = packed & (1 << _DIGIT_BITS) - 1
    if digits not in DIGITS:
        raise cursor.fail(f"a promise of {digits} digits")
    return Promise(digits, (packed >> _DIGIT_BITS & _EXPONENT_MASK) + EXPONENTS.start, bool(packed & _MAXIMUM)), sampling
