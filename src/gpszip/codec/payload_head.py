"""The first bytes of a walks payload, read without decoding it and without the compiler."""

from __future__ import annotations

__all__ = ["has_times"]

#: A first byte below this names modes (docs/format.md); after a zero, one more byte does.
_FIRST_VARINT = 4

#: Flag in the varint that follows: times are kept.
_TIMED = 1


def has_times(payload: bytes) -> bool:
    """Whether a payload keeps times of any track.

    Examples
    --------
    >>> has_times(bytes.fromhex("05efbdc0")), has_times(bytes([4]))
    (True, False)
    """
    # skip the modes
    skipped = 0
    if payload and payload[0] < _FIRST_VARINT:
        skipped = 1 if payload[0] else 2

    # a payload without knots is one byte, which is the varint
    head = 0
    if payload:
        head = payload[skipped] if skipped < len(payload) else payload[0]
    return bool(head & _TIMED)
