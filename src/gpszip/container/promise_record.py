"""What an archive promises, in two bytes."""

from __future__ import annotations

from gpszip.container.layout import Cursor
from gpszip.model.promise import Promise

__all__ = ["PROMISE_BYTES", "promise_bytes", "read_promise"]

PROMISE_BYTES = 2

_DIGIT_BITS, _EXPONENT_BITS, _FINEST = 10, 5, -8


def promise_bytes(promise: Promise | None) -> bytes:
    """Ten bits of digits, five of the exponent plus 8, one for a maximum; zeros where nothing is promised."""
    if promise is None:
        return bytes(PROMISE_BYTES)
    packed = promise.digits | (promise.exponent - _FINEST) << _DIGIT_BITS | promise.maximum << _DIGIT_BITS + _EXPONENT_BITS
    return packed.to_bytes(PROMISE_BYTES, "little")


def read_promise(cursor: Cursor) -> Promise | None:
    """Undo :func:`promise_bytes`."""
    packed = int.from_bytes(cursor.take(PROMISE_BYTES, "the promise"), "little")
    if packed == 0:
        return None
    digits, rest = packed & (1 << _DIGIT_BITS) - 1, packed >> _DIGIT_BITS
    if not 1 <= digits < 1000:
        raise cursor.fail(f"a promise of {digits} digits")
    return Promise(digits, (rest & (1 << _EXPONENT_BITS) - 1) + _FINEST, bool(rest >> _EXPONENT_BITS))
