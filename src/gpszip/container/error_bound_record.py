"""The error bound of an archive, and how its log was sampled, in two to six bytes."""

from __future__ import annotations

from dataclasses import replace

from gpszip.container.layout import OLDEST_VERSION, Cursor
from gpszip.model.error_bound import DIGITS, EXPONENTS, GROWN_DIGITS, GROWTH_STEPS, ErrorBound

__all__ = ["encode_error_bound", "read_error_bound"]

#: Bits of the digits, below those of the exponent, and the mask of the four bits of the exponent.
_DIGIT_BITS = 10
_EXPONENT_MASK = 0b1111

#: Flags: a byte of the sampling follows; the bound is of the largest distance.
_SAMPLED = 1 << 14
_MAXIMUM = 1 << 15

#: The four bits of the exponent where there are two bounds.
_BOTH = 15

#: First bit, in the bytes of the second bound, of how much larger its exponent is.
_OVER_SHIFT = 14


def encode_error_bound(error_bound: ErrorBound | None, sampling: int | None) -> bytes:
    """Encode the error bound and the sampling.

    The first two bytes hold ten bits of digits, four of the exponent plus 8, one if a byte of the
    sampling follows, and one for a bound of the largest distance; without a bound they are zero.

    Digits beyond 999, with the next byte, number the pairs of digits and growth steps of a bound
    that merges have extended. Where the four bits are 15, there are two bounds: of the root mean
    square and of the largest distance. Two more bytes then hold the digits of the second, the
    exponent of the first plus 8, and how much larger that of the second is.
    """
    # Without a bound, only the flag of the sampling can be set.
    flags = 0 if sampling is None else _SAMPLED
    sampling_byte = b"" if sampling is None else bytes([sampling])
    if error_bound is None:
        return flags.to_bytes(2, "little") + sampling_byte

    # Digits, or the number of a pair of digits and growth steps.
    digits, more = error_bound.digits, b""
    if error_bound.growth:
        steps = error_bound.growth - GROWTH_STEPS.start
        pair = steps * len(GROWN_DIGITS) + digits - GROWN_DIGITS.start
        digits, more = DIGITS.stop + pair // 256, bytes([pair % 256])

    # Exponent, which moves to the second bound if there are two.
    exponent = error_bound.exponent - EXPONENTS.start
    if error_bound.max_digits:
        over = error_bound.max_exponent - error_bound.exponent
        second = error_bound.max_digits | exponent << _DIGIT_BITS | over << _OVER_SHIFT
        more += second.to_bytes(2, "little")
        exponent = _BOTH
    packed = flags | digits | exponent << _DIGIT_BITS | error_bound.maximum * _MAXIMUM
    return packed.to_bytes(2, "little") + more + sampling_byte


def read_error_bound(cursor: Cursor, version: int) -> tuple[ErrorBound | None, int | None]:
    """Undo :func:`encode_error_bound`; in version 2, there is never a second bound.

    Returns
    -------
    ErrorBound or None
        The bound.
    int or None
        The sampling.
    """
    # Take the first two bytes apart; without a bound, only the flag of the sampling is set.
    packed = int.from_bytes(cursor.read_bytes(2, "the error bound"), "little")
    exponent = packed >> _DIGIT_BITS & _EXPONENT_MASK
    maximum = bool(packed & _MAXIMUM)
    has_bound = packed & ~_SAMPLED > 0

    # Digits, or the number of a pair of digits and growth steps.
    digits, growth = packed & (1 << _DIGIT_BITS) - 1, 0
    if digits >= DIGITS.stop:
        pair = 256 * (digits - DIGITS.stop) + cursor.read_byte("the growth of the error bound")
        steps, rest = divmod(pair, len(GROWN_DIGITS))
        digits, growth = rest + GROWN_DIGITS.start, steps + GROWTH_STEPS.start

    # The second bound, and the sampling.
    # In version 2, 15 is an exponent like any other.
    has_both = exponent == _BOTH and version > OLDEST_VERSION and has_bound
    second = int.from_bytes(cursor.read_bytes(2, "the maximum"), "little") if has_both else 0
    sampling = cursor.read_byte("the sampling") if packed & _SAMPLED else None
    if not has_bound:
        return None, sampling
    if digits not in DIGITS or growth >= GROWTH_STEPS.stop:
        raise cursor.error(f"an error bound of {digits} digits, grown by {growth} steps")
    if has_both:
        return _with_maximum(cursor, ErrorBound(digits, 0, maximum, growth), second), sampling
    return ErrorBound(digits, exponent + EXPONENTS.start, maximum, growth), sampling


def _with_maximum(cursor: Cursor, rms: ErrorBound, second: int) -> ErrorBound:
    """Add the bytes of the second bound to the first, whose exponent they hold."""
    exponent = (second >> _DIGIT_BITS & _EXPONENT_MASK) + EXPONENTS.start
    digits = second & (1 << _DIGIT_BITS) - 1
    if rms.maximum or rms.growth or exponent not in EXPONENTS or digits not in DIGITS:
        raise cursor.error("an error bound of two kinds that no writer makes")
    return replace(
        rms, exponent=exponent, max_digits=digits, max_exponent=exponent + (second >> _OVER_SHIFT)
    )
