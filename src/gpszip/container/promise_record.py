"""What an archive promises, and how its log was sampled, in two to four bytes."""

from __future__ import annotations

from gpszip.container.layout import Cursor
from gpszip.model.promise import DIGITS, EXPONENTS, FEW_DIGITS, GROWN, Promise

__all__ = ["promise_bytes", "read_promise"]

_DIGIT_BITS, _EXPONENT_MASK, _SAMPLED, _MAXIMUM = 10, 0b1111, 1 << 14, 1 << 15


def promise_bytes(promise: Promise | None, sampling: int | None) -> bytes:
    """Ten bits of digits, four of the exponent plus 8, one if a byte for the sampling follows, one for a maximum; zeros promise nothing.

    Digits beyond 999, and a byte that comes next, number the pairs of digits and steps of a promise that has grown.
    """
    packed, grown = 0 if sampling is None else _SAMPLED, b""
    if promise is not None:
        digits = promise.digits
        if promise.grown:
            high, low = divmod((promise.grown - GROWN.start) * len(FEW_DIGITS) + digits - FEW_DIGITS.start, 256)
            digits, grown = DIGITS.stop + high, bytes([low])
        packed |= digits | (promise.exponent - EXPONENTS.start) << _DIGIT_BITS | promise.maximum * _MAXIMUM
    return packed.to_bytes(2, "little") + grown + (b"" if sampling is None else bytes([sampling]))


def read_promise(cursor: Cursor) -> tuple[Promise | None, int | None]:
    """Undo :func:`promise_bytes`."""
    packed = int.from_bytes(cursor.take(2, "the promise"), "little")
    digits, grown = packed & (1 << _DIGIT_BITS) - 1, 0
    if digits >= DIGITS.stop:
        steps, few = divmod(256 * (digits - DIGITS.stop) + cursor.byte("the growth of the promise"), len(FEW_DIGITS))
        digits, grown = few + FEW_DIGITS.start, steps + GROWN.start
    sampling = cursor.byte("the sampling") if packed & _SAMPLED else None
    if packed & ~_SAMPLED == 0:
        return None, sampling
    if digits not in DIGITS or grown >= GROWN.stop:
        raise cursor.fail(f"a promise of {digits} digits, grown by {grown} steps")
    return Promise(digits, (packed >> _DIGIT_BITS & _EXPONENT_MASK) + EXPONENTS.start, bool(packed & _MAXIMUM), grown), sampling
