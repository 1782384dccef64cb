"""What the first bytes of a walks payload tell, without decoding it and without the compiler."""

from __future__ import annotations

__all__ = ["has_times"]

#: Bytes below this name modes, see docs/format.md; a zero is followed by one more byte of them.
_MODES = 4

#: Flag of the first number: times are kept.
_TIMED = 1


def has_times(payload: bytes) -> bool:
    """Whether a payload keeps times, of any track.

    Examples
    --------
    >>> has_times(bytes.fromhex("05efbdc0")), has_times(bytes([4]))
    (True, False)
    """
    skipped = 0 if not payload or payload[0] >= _MODES else 1 if payload[0] else 2
    # a payload of no knots at all is one byte, the number
    head = payload[skipped] if skipped < len(payload) else payload[0] if payload else 0
    return bool(head & _TIMED)
