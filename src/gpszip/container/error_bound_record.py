"""What an archive promises, and how its log was sampled, in two to six bytes."""

from __future__ import annotations

from dataclasses import replace

from gpszip.container.layout import OLDEST_VERSION, Cursor
from gpszip.model.error_bound import DIGITS, EXPONENTS, GROWN_DIGITS, GROWTH_STEPS, ErrorBound

__all__ = ["encode_error_bound", "read_error_bound"]

_DIGIT_BITS, _EXPONENT_MASK, _SAMPLED, _MAXIMUM = 10, 0b1111, 1 << 14, 1 << 15

#: What stands for the exponent where a maximum is promised, too, and where its own is then.
_BOTH, _OVER_SHIFT = 15, 14


def encode_error_bound(error_bound: ErrorBound | None, sampling: int | None) -> bytes:
    """Ten bits of digits, four of the exponent plus 8, one if a byte for the sampling follows, one for a maximum; zeros promise nothing.

    Digits beyond 999, and a byte that comes next, number the pairs of digits and steps of a promise that has grown. An exponent of 7
    says that a maximum is promised, too; two more bytes hold its digits, the exponent plus 8, and how much larger its exponent is.
    """
    packed, grown = 0 if sampling is None else _SAMPLED, b""
    if error_bound is not None:
        digits = error_bound.digits
        if error_bound.growth:
            high, low = divmod(
                (error_bound.growth - GROWTH_STEPS.start) * len(GROWN_DIGITS)
                + digits
                - GROWN_DIGITS.start,
                256,
            )
            digits, grown = DIGITS.stop + high, bytes([low])
        exponent = error_bound.exponent - EXPONENTS.start
        if error_bound.max_digits:
            over = error_bound.max_exponent - error_bound.exponent
            grown += (
                error_bound.max_digits | exponent << _DIGIT_BITS | over << _OVER_SHIFT
            ).to_bytes(2, "little")
            exponent = _BOTH
        packed |= digits | exponent << _DIGIT_BITS | error_bound.maximum * _MAXIMUM
    return packed.to_bytes(2, "little") + grown + (b"" if sampling is None else bytes([sampling]))


def read_error_bound(cursor: Cursor, version: int) -> tuple[ErrorBound | None, int | None]:
    """Undo :func:`encode_error_bound`; in version 2, an exponent of 7 is one."""
    packed = int.from_bytes(cursor.read_bytes(2, "the promise"), "little")
    digits, grown = packed & (1 << _DIGIT_BITS) - 1, 0
    if digits >= DIGITS.stop:
        steps, few = divmod(
            256 * (digits - DIGITS.stop) + cursor.read_byte("the growth of the promise"),
            len(GROWN_DIGITS),
        )
        digits, grown = few + GROWN_DIGITS.start, steps + GROWTH_STEPS.start
    exponent = packed >> _DIGIT_BITS & _EXPONENT_MASK
    both = exponent == _BOTH and version > OLDEST_VERSION and packed & ~_SAMPLED > 0
    most = int.from_bytes(cursor.read_bytes(2, "the maximum"), "little") if both else 0
    sampling = cursor.read_byte("the sampling") if packed & _SAMPLED else None
    if packed & ~_SAMPLED == 0:
        return None, sampling
    if digits not in DIGITS or grown >= GROWTH_STEPS.stop:
        raise cursor.error(f"a promise of {digits} digits, grown by {grown} steps")
    if not both:
        return ErrorBound(
            digits, exponent + EXPONENTS.start, bool(packed & _MAXIMUM), grown
        ), sampling
    return _both(cursor, ErrorBound(digits, 0, bool(packed & _MAXIMUM), grown), most), sampling


def _both(cursor: Cursor, rms: ErrorBound, most: int) -> ErrorBound:
    """A promise of both kinds from what follows it."""
    exponent = (most >> _DIGIT_BITS & _EXPONENT_MASK) + EXPONENTS.start
    digits = most & (1 << _DIGIT_BITS) - 1
    if rms.maximum or rms.growth or exponent not in EXPONENTS or digits not in DIGITS:
        raise cursor.error("a promise of two kinds that no writer makes")
    return replace(
        rms, exponent=exponent, max_digits=digits, max_exponent=exponent + (most >> _OVER_SHIFT)
    )
