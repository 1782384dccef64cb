"""What an archive promises, and how its log was sampled, in two to six bytes."""

from __future__ import annotations

from dataclasses import replace

from gpszip.container.layout import OLDEST, Cursor
from gpszip.model.promise import DIGITS, EXPONENTS, FEW_DIGITS, GROWN, Promise

__all__ = ["promise_bytes", "read_promise"]

_DIGIT_BITS, _EXPONENT_MASK, _SAMPLED, _MAXIMUM = 10, 0b1111, 1 << 14, 1 << 15

#: What stands for the exponent where a maximum is promised, too, and where its own is then.
_BOTH, _OVER_SHIFT = 15, 14


def promise_bytes(promise: Promise | None, sampling: int | None) -> bytes:
    """Ten bits of digits, four of the exponent plus 8, one if a byte for the sampling follows, one for a maximum; zeros promise nothing.

    Digits beyond 999, and a byte that comes next, number the pairs of digits and steps of a promise that has grown. An exponent of 7
    says that a maximum is promised, too; two more bytes hold its digits, the exponent plus 8, and how much larger its exponent is.
    """
    packed, grown = 0 if sampling is None else _SAMPLED, b""
    if promise is not None:
        digits = promise.digits
        if promise.grown:
            high, low = divmod((promise.grown - GROWN.start) * len(FEW_DIGITS) + digits - FEW_DIGITS.start, 256)
            digits, grown = DIGITS.stop + high, bytes([low])
        exponent = promise.exponent - EXPONENTS.start
        if promise.most_digits:
            over = promise.most_exponent - promise.exponent
            grown += (promise.most_digits | exponent << _DIGIT_BITS | over << _OVER_SHIFT).to_bytes(2, "little")
            exponent = _BOTH
        packed |= digits | exponent << _DIGIT_BITS | promise.maximum * _MAXIMUM
    return packed.to_bytes(2, "little") + grown + (b"" if sampling is None else bytes([sampling]))


def read_promise(cursor: Cursor, version: int) -> tuple[Promise | None, int | None]:
    """Undo :func:`promise_bytes`; in version 2, an exponent of 7 is one."""
    packed = int.from_bytes(cursor.take(2, "the promise"), "little")
    digits, grown = packed & (1 << _DIGIT_BITS) - 1, 0
    if digits >= DIGITS.stop:
        steps, few = divmod(256 * (digits - DIGITS.stop) + cursor.byte("the growth of the promise"), len(FEW_DIGITS))
        digits, grown = few + FEW_DIGITS.start, steps + GROWN.start
    exponent = packed >> _DIGIT_BITS & _EXPONENT_MASK
    both = exponent == _BOTH and version > OLDEST and packed & ~_SAMPLED > 0
    most = int.from_bytes(cursor.take(2, "the maximum"), "little") if both else 0
    sampling = cursor.byte("the sampling") if packed & _SAMPLED else None
    if packed & ~_SAMPLED == 0:
        return None, sampling
    if digits not in DIGITS or grown >= GROWN.stop:
        raise cursor.fail(f"a promise of {digits} digits, grown by {grown} steps")
    if not both:
        return Promise(digits, exponent + EXPONENTS.start, bool(packed & _MAXIMUM), grown), sampling
    return _both(cursor, Promise(digits, 0, bool(packed & _MAXIMUM), grown), most), sampling


def _both(cursor: Cursor, rms: Promise, most: int) -> Promise:
    """A promise of both kinds from what follows it."""
    exponent = (most >> _DIGIT_BITS & _EXPONENT_MASK) + EXPONENTS.start
    digits = most & (1 << _DIGIT_BITS) - 1
    if rms.maximum or rms.grown or exponent not in EXPONENTS or digits not in DIGITS:
        raise cursor.fail("a promise of two kinds that no writer makes")
    return replace(rms, exponent=exponent, most_digits=digits, most_exponent=exponent + (most >> _OVER_SHIFT))
